//! The page of a boundary map: the domain's surface and its image, and how far the map distorts.

mod mapped_surface;

use std::path::Path;

use anyhow::Context;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::files::{BoundaryFile, Provenance};
use solidmap::fit::self_intersection_finder;

pub use mapped_surface::MappedSurface;

use super::input;
use super::page::NumberTable;
use super::places::percent;
use crate::args::{PageSizeArgs, UpKind};

/// A page of a boundary map.
pub struct MadeBoundaryPage {
    /// Its text.
    pub html: String,
    /// Triangles of the domain.
    pub faces: usize,
    /// How many of them have inverted images.
    pub flipped: usize,
}

/// A boundary map to make a page of.
pub struct BoundaryPage<'a> {
    /// The file that the page is named after.
    pub path: &'a Path,
    /// The boundary map.
    pub boundary: &'a BoundaryMap,
    /// What was found in it.
    pub check: &'a BoundaryCheck,
    /// The files that it comes from.
    pub files: Vec<Provenance>,
    /// What points up.
    pub up: UpKind,
}

/// The page of a boundary file.
pub fn of_file(path: &Path, file: &BoundaryFile, up: UpKind, args: &PageSizeArgs) -> anyhow::Result<MadeBoundaryPage> {
    let options = BoundaryCheckOptions::default();
    let found = check(&file.boundary, None, &options, self_intersection_finder());
    let mut files = vec![input::provenance("boundary", path)?];
    files.extend(file.metadata.inputs.iter().cloned());
    let page = BoundaryPage {
        path,
        boundary: &file.boundary,
        check: &found.with_context(|| format!("cannot check `{}`", path.display()))?,
        files,
        up,
    };
    page.make(args)
}

impl BoundaryPage<'_> {
    /// The page, with all triangles.
    pub fn make(self, args: &PageSizeArgs) -> anyhow::Result<MadeBoundaryPage> {
        let Self {
            path,
            boundary,
            check: found,
            files,
            up,
        } = self;
        let mut notes: Vec<String> = found.findings.iter().map(|finding| finding.message.clone()).collect();
        if !boundary.is_linear() {
            notes.push(
                "The map is composed of embeddings of both surfaces: the page shows the images of the domain's vertices, and \
                 is linear between them."
                    .into(),
            );
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let surface = MappedSurface {
            title: format!("{name}: boundary map of {} triangles", found.faces),
            names: ["domain", "image"],
            domain: boundary.domain(),
            image: boundary.image(),
            outline: None,
            flipped: &found.flipped_triangles,
            files,
            notes,
            tables: vec![numbers(found)],
            up,
        };
        Ok(MadeBoundaryPage {
            html: surface.html(args)?,
            faces: found.faces,
            flipped: found.flipped,
        })
    }
}

/// What the check found.
fn numbers(check: &BoundaryCheck) -> NumberTable {
    let mut table = NumberTable::new("Boundary map");
    let share = |count: usize| percent(count as f64 / check.faces.max(1) as f64);
    table.row("vertices", check.vertices.to_string(), "", "of the domain");
    table.row("triangles", check.faces.to_string(), "", "of the domain");
    table.row(
        "inverted triangles",
        format!("{} ({})", check.flipped, share(check.flipped)),
        "",
        "whose images face the wrong way",
    );
    table.row(
        "flat images",
        check.degenerate.to_string(),
        "",
        "triangles with an area whose images have none",
    );
    table.row(
        "folded edges",
        check.folded_edges.to_string(),
        "",
        "where the image is folded by more than 150°, and the domain is not",
    );
    if let Some(degree) = &check.degree {
        table.row(
            "degree",
            degree.value.to_string(),
            "",
            "how often, with sign, the image covers the target",
        );
    }
    table
}
