//! Points in tables and meshes, and warnings about their preimages.

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

/// The points of a table, or a mesh and its vertices.
pub fn read_points(path: &Path) -> anyhow::Result<(Option<SolidMesh>, Vec<Point>)> {
    if is_table(path) {
        return Ok((None, io::read_points(path)?));
    }
    let solid = io::read_solid(path)?;
    let points = solid.vertices().to_vec();
    Ok((Some(solid), points))
}

/// Writes a table with these columns: CSV with their names, or NPY, which has none.
pub fn write_table(path: &Path, names: &[&str], values: &[f64]) -> anyhow::Result<()> {
    if extension(path) == "csv" {
        io::write_csv(path, names, values)?;
    } else {
        io::write_npy(path, names.len(), values)?;
    }
    Ok(())
}

/// Warns of points without a preimage, and of those with several.
pub fn warn_of_preimages(output: &Output, report: &InverseReport) {
    let say = |count: usize, what: &str| {
        if count > 0 {
            output.warn(format!("{count} of {} points {what}", report.points));
        }
    };
    say(report.not_finite, "have NaN or infinite coordinates");
    say(report.outside, "lie outside the target, and have no preimage");
    say(report.not_converged, "lie in the target, but no preimage was found");
    say(
        report.folded,
        "lie where the map folds: they have several preimages, or one where the map is turned inside out, or one where \
         there must be more",
    );
}

/// The code of a preimage's status in files.
pub fn status_number(preimage: &Preimage) -> f64 {
    f64::from(preimage.status as u8)
}
