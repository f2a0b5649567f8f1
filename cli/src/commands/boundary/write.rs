//! Writing boundary maps.

use std::path::{Path, PathBuf};

use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::files::{self, BoundaryFile, BoundaryMetadata};
use solidmap::io;

use super::pictures;
use crate::args::{BoundaryOutputs, UpKind};
use crate::shared::boundary_page::BoundaryPage;
use crate::shared::output::{Output, write_file};
use crate::shared::{input, page};

impl BoundaryOutputs {
    /// Refuses outputs that cannot be written, or that are inputs, before any work is done.
    pub fn require_writable(&self, inputs: &[&Path]) -> anyhow::Result<()> {
        let outputs: [(Option<&PathBuf>, &[&str]); 5] = [
            (Some(&self.output), &["obj", "ply", "off"]),
            (self.boundary.as_ref(), &["safetensors"]),
            (self.png.as_ref(), &["png"]),
            (self.vtu.as_ref(), &["vtu"]),
            (self.html.as_ref(), &page::EXTENSIONS),
        ];
        input::require_all_writable(&outputs, inputs)
    }
}

/// Writes the image, and where asked for the boundary map, its fields, its picture and its page, which need what `checked` has
/// found in it. `inputs` are files by their roles.
pub fn outputs(
    map: &BoundaryMap,
    checked: Option<&BoundaryCheck>,
    outputs: &BoundaryOutputs,
    inputs: &[(&str, &Path)],
    target_up: UpKind,
    output: &Output,
) -> anyhow::Result<()> {
    let origins = || {
        inputs
            .iter()
            .map(|(role, path)| input::provenance(role, path))
            .collect()
    };
    if let Some(path) = &outputs.boundary {
        let origins: anyhow::Result<_> = origins();
        let file = BoundaryFile {
            boundary: map.clone(),
            metadata: BoundaryMetadata::new(origins?),
        };
        files::write_boundary(path, &file)?;
    }
    if let Some(path) = &outputs.vtu {
        files::write_boundary_fields(path, map)?;
    }
    if outputs.png.is_some() || outputs.html.is_some() {
        output.progress("drawing");
        let found = match checked {
            Some(checked) => checked,
            None => &check(map, None, &BoundaryCheckOptions::default(), None)?,
        };
        if let Some(path) = &outputs.png {
            let figure = pictures::boundary(map, found, [outputs.up, target_up])?;
            write_file(path, &figure.to_png()?)?;
        }
        if let Some(path) = &outputs.html {
            let page = BoundaryPage {
                path: &outputs.output,
                boundary: map,
                check: found,
                files: origins()?,
                up: outputs.up,
            };
            page::write(path, &page.make(&outputs.page)?.html)?;
        }
    }
    io::write_surface(&outputs.output, &map.target())?;
    Ok(())
}
