//! Writing boundary maps.

use std::path::{Path, PathBuf};

use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::files::{self, BoundaryFile, BoundaryMetadata};
use solidmap::io;

use super::pictures;
use crate::args::{BoundaryOutputs, UpKind};
use crate::shared::input;
use crate::shared::output::{Output, write_file};

impl BoundaryOutputs {
    /// Refuses outputs that cannot be written, or that are inputs, before any work is done.
    pub fn require_writable(&self, inputs: &[&Path]) -> anyhow::Result<()> {
        let outputs: [(Option<&PathBuf>, &[&str]); 4] = [
            (Some(&self.output), &["obj", "ply", "off"]),
            (self.boundary.as_ref(), &["safetensors"]),
            (self.png.as_ref(), &["png"]),
            (self.vtu.as_ref(), &["vtu"]),
        ];
        input::require_all_writable(&outputs, inputs)
    }
}

/// Writes the image, and where asked for the boundary map, its fields and its picture, which needs what
/// `checked` has found in it. `inputs` are files by their roles.
pub fn outputs(
    map: &BoundaryMap,
    checked: Option<&BoundaryCheck>,
    outputs: &BoundaryOutputs,
    inputs: &[(&str, &Path)],
    target_up: UpKind,
    output: &Output,
) -> anyhow::Result<()> {
    if let Some(path) = &outputs.boundary {
        let origins: anyhow::Result<_> = inputs
            .iter()
            .map(|(role, path)| input::provenance(role, path))
            .collect();
        let file = BoundaryFile {
            boundary: map.clone(),
            metadata: BoundaryMetadata::new(origins?),
        };
        files::write_boundary(path, &file)?;
    }
    if let Some(path) = &outputs.vtu {
        files::write_boundary_fields(path, map)?;
    }
    if let Some(path) = &outputs.png {
        output.progress("drawing");
        let ups = [outputs.up, target_up];
        let figure = match checked {
            Some(checked) => pictures::boundary(map, checked, ups)?,
            None => {
                let checked = check(map, None, &BoundaryCheckOptions::default(), None)?;
                pictures::boundary(map, &checked, ups)?
            }
        };
        write_file(path, &figure.to_png()?)?;
    }
    io::write_surface(&outputs.output, &map.target())?;
    Ok(())
}
