//! Points in tables and meshes, and what is told of their preimages.

use std::path::Path;

use solidmap::Point;
use solidmap::inverse::{InverseReport, Preimage};
use solidmap::io::{self, SolidMesh};

use super::input::extension;
use super::output::Output;

/// Whether the file holds points without a mesh.
pub fn is_table(path: &Path) -> bool {
    ["csv", "npy"].contains(&extension(path).as_str())
}

/// The points of a table, or the vertices of a mesh with the mesh.
pub fn read_points(path: &Path) -> anyhow::Result<(Option<SolidMesh>, Vec<Point>)> {
    if is_table(path) {
        return Ok((None, io::read_points(path)?));
    }
    let solid = io::read_solid(path)?;
    let points = match &solid {
        SolidMesh::Surface(surface) => surface.vertices().to_vec(),
        SolidMesh::Tets(tets) => tets.vertices().to_vec(),
    };
    Ok((Some(solid), points))
}

/// Writes a table of so many columns: CSV with their names, or NPY, which has none.
pub fn write_table(path: &Path, names: &[&str], values: &[f64]) -> anyhow::Result<()> {
    if extension(path) == "csv" {
        io::write_csv(path, names, values)?;
    } else {
        io::write_npy(path, names.len(), values)?;
    }
    Ok(())
}

/// Says what has no preimage, or too many.
pub fn warn_of_preimages(output: &Output, report: &InverseReport) {
    let say = |count: usize, what: &str| {
        if count > 0 {
            output.warn(format!("{count} of {} points {what}", report.points));
        }
    };
    say(report.not_finite, "have NaN or infinite coordinates");
    say(
        report.outside,
        "lie outside of the target, and nothing in the domain goes there",
    );
    say(
        report.not_converged,
        "lie in the target, but no preimage was found in the domain",
    );
    say(
        report.folded,
        "lie where the map folds: they have several preimages, or one where the map is turned inside out, or one where \
         there must be more",
    );
}

/// The number that a status has in files.
pub fn status_number(preimage: &Preimage) -> f64 {
    f64::from(preimage.status as u8)
}
