//! The page of a boundary map: the domain's surface and its image, and how far the map distorts.

use std::path::Path;

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::boundary_map::{BoundaryMap, TriangleDistortion, triangle_distortions};
use solidmap::files::{BoundaryFile, Provenance};
use solidmap::fit::self_intersection_finder;
use solidmap::geometry::Axis;
use solidmap::statistics::quantiles;

use super::input;
use super::page::{Framing, NumberTable, PackedArray, Page, PageField, Palette, megabytes};
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

/// What the scripts of the page read, besides the arrays.
#[derive(Serialize)]
struct BoundaryContent {
    kind: &'static str,
    domain: Framing,
    target: Framing,
    fields: Vec<PageField>,
    up: (usize, bool),
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
        let (domain, image) = (boundary.domain(), boundary.image());
        let (fields, arrays) = distortions(boundary)?;
        let (framing, target_framing) = (Framing::of(domain.vertices()), Framing::of(image));
        let mut arrays = arrays;
        arrays.push(PackedArray::floats("domain", framing.place(domain.vertices())));
        arrays.push(PackedArray::floats("image", target_framing.place(image)));
        arrays.push(PackedArray::indices(
            "triangles",
            domain.triangles().iter().flatten().copied(),
        ));
        arrays.push(PackedArray::indices("flipped", found.flipped_triangles.iter().copied()));
        let mut notes: Vec<String> = found.findings.iter().map(|finding| finding.message.clone()).collect();
        if !boundary.is_linear() {
            notes.push(
            "The map is composed of embeddings of both surfaces: the page shows the images of the domain's vertices, and is \
             linear between them."
                .into(),
        );
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let page = Page {
            title: format!("{name}: boundary map of {} triangles", domain.triangles().len()),
            files,
            notes,
            tables: vec![numbers(found)],
            arrays,
        };
        let content = BoundaryContent {
            kind: "boundary",
            domain: framing,
            target: target_framing,
            fields,
            up: (Axis::from(up).index(), up.is_upside_down()),
        };
        let html = page.html(&content)?;
        let size = html.len() as u64;
        ensure!(
            size <= args.max_size,
            "the page of all {} triangles takes {:.1} MB, but --max-size is {:.1} MB; allow more",
            found.faces,
            megabytes(size),
            megabytes(args.max_size)
        );
        Ok(MadeBoundaryPage {
            html,
            faces: found.faces,
            flipped: found.flipped,
        })
    }
}

/// How far each triangle is from being mapped by a similarity, with arrays of the values.
fn distortions(boundary: &BoundaryMap) -> anyhow::Result<(Vec<PageField>, Vec<PackedArray>)> {
    let triangles = triangle_distortions(boundary.domain(), boundary.image());
    let triangles = triangles.context("the image has another number of vertices than the domain")?;
    let values = |of: fn(&TriangleDistortion) -> f64| -> Vec<f64> {
        let value = |triangle: &Option<TriangleDistortion>| triangle.as_ref().map_or(f64::NAN, of);
        triangles.iter().map(value).collect()
    };
    let (area, angle) = (
        values(TriangleDistortion::area_ratio),
        values(TriangleDistortion::angle),
    );
    let [few, most] = quantiles(&area, [0.01, 0.99]).unwrap_or([1.0; 2]);
    let factor = most.max(1.0 / few.max(f64::MIN_POSITIVE)).clamp(1.25, 32.0);
    let [widest] = quantiles(&angle, [0.99]).unwrap_or([2.0]);
    let fields = vec![
        PageField {
            key: "area".into(),
            label: "area ratio".into(),
            unit: "×",
            meaning: "σ₁σ₂, area of a triangle's image over its own, with both surfaces scaled to one area".into(),
            palette: Palette::Ratio,
            logarithmic: true,
            low: 1.0 / factor,
            high: factor,
            clamps: area.iter().any(|ratio| *ratio < 1.0 / factor || *ratio > factor),
        },
        PageField {
            key: "angle".into(),
            label: "σ₁ / σ₂".into(),
            unit: "×",
            meaning: "σ₁ / σ₂, largest stretch of a triangle over the smallest: 1 where angles are kept".into(),
            palette: Palette::Amount,
            logarithmic: false,
            low: 1.0,
            high: widest.clamp(1.05, 1e6),
            clamps: angle.iter().any(|value| *value > widest),
        },
    ];
    let arrays = vec![
        PackedArray::floats("field-area", area),
        PackedArray::floats("field-angle", angle),
    ];
    Ok((fields, arrays))
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
