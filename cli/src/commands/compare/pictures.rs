//! Maps side by side in one colour scale: figure 6 of the paper.

use std::path::Path;

use crate::drawing::{Figure, Scale, ValueRange};
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::geometry::{Axis, AxisPlane, PlaneSection};
use solidmap::io;

use super::Comparison;
use super::job::{SECTION_DENSITY, SECTION_IMAGES, SECTION_PIXELS, SectionView};
use super::runner::Runner;
use crate::shared::pictures::panels_with_one_bar;

/// The cross-section of the domain that all maps are shown on.
pub fn section(view: SectionView, boundary: &BoundaryMap) -> anyhow::Result<PlaneSection> {
    let axis = |i: usize| [Axis::X, Axis::Y, Axis::Z][i];
    let plane = AxisPlane {
        axis: axis(view.axis),
        position: view.position,
    };
    Ok(PlaneSection::new(
        boundary.domain(),
        plane,
        axis(view.up),
        SECTION_PIXELS,
    )?)
}

/// The picture of a comparison.
pub struct ComparisonPicture {
    /// The bytes of a PNG file.
    pub png: Vec<u8>,
    /// The same in words.
    pub alternative: String,
}

/// The harmonic energy density of every map on the section, and its distance to the reference. `None` when there is
/// nothing to show.
pub fn draw(
    section: &PlaneSection,
    runner: &Runner,
    comparison: &Comparison,
) -> anyhow::Result<Option<ComparisonPicture>> {
    let mut densities = Vec::new();
    let mut distances = Vec::new();
    let reference = read_points(&runner.reference_files()[1], section);
    for row in comparison.methods.iter().filter(|row| row.figures.is_some()) {
        let own = runner.scratch.join(&row.name);
        let Some(values) = read_values(&own.join(SECTION_DENSITY), section) else {
            continue;
        };
        densities.push((row.name.clone(), values));
        let images = read_points(&own.join(SECTION_IMAGES), section);
        if let (Some(images), Some(reference)) = (images, &reference) {
            let pairs = images.iter().zip(reference);
            let distance = pairs.map(|(a, b)| (a - b).norm() / runner.diagonal).collect::<Vec<_>>();
            distances.push((row.name.clone(), distance));
        }
    }
    if densities.is_empty() {
        return Ok(None);
    }
    let asked = &runner.args.measure.section;
    let most = ValueRange::Quantiles(0.0, 0.99);
    let mut rows = vec![panels_with_one_bar(
        (section, asked),
        &densities,
        "harmonic energy density",
        most,
        Scale::Linear,
    )?];
    let names: Vec<&str> = densities.iter().map(|(name, _)| name.as_str()).collect();
    let mut alternative = format!(
        "Harmonic energy densities of the maps by {} on one cross-section, in one colour scale",
        names.join(", ")
    );
    if !distances.is_empty() {
        alternative += ", and the distances of their images from those of the reference";
        let range = ValueRange::Fixed(1e-6, 1e-2);
        rows.push(panels_with_one_bar(
            (section, asked),
            &distances,
            "distance to the reference / diagonal",
            range,
            Scale::Log,
        )?);
    }
    let png = Figure::grid(rows).titled("One boundary map, every method").to_png()?;
    alternative += "; the tables below have the numbers";
    Ok(Some(ComparisonPicture { png, alternative }))
}

fn read_points(path: &Path, section: &PlaneSection) -> Option<Vec<Point>> {
    let points = io::read_points(path).ok()?;
    (points.len() == section.points().len()).then_some(points)
}

fn read_values(path: &Path, section: &PlaneSection) -> Option<Vec<f64>> {
    let bytes = std::fs::read(path).ok()?;
    let count = section.points().len();
    // The values are at the end of an NPY file.
    let start = bytes.len().checked_sub(8 * count)?;
    let value = |chunk: &[u8]| Some(f64::from_le_bytes(chunk.try_into().ok()?));
    bytes[start..].chunks_exact(8).map(value).collect()
}
