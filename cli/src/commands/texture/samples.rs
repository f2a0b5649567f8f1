//! Sampling a texture: volumes, and colours of points.

use std::path::Path;

use anyhow::bail;
use solidmap::Point;
use solidmap::inverse::Inverse;
use solidmap::io::{self, Cells, Field, ImageGrid, SolidMesh, VtkFields};
use solidmap::texture::{LinearRgb, SolidTexture, VoxelGrid, VoxelTexture, to_srgb};

use super::summary::{PointsSummary, VolumeSummary};
use crate::shared::input::extension;
use crate::shared::output::Output;
use crate::shared::points::write_table;

/// The colours of a texture, or of the target that a map carries it to.
pub struct Colours<'a> {
    texture: &'a SolidTexture,
    inverse: Option<&'a dyn Inverse>,
    /// Points of the target that were sampled and have several preimages, or an inverted one.
    pub folded: usize,
    /// Points of the target that were sampled and for which no preimage was found.
    pub not_found: usize,
}

impl<'a> Colours<'a> {
    pub fn new(texture: &'a SolidTexture, inverse: Option<&'a dyn Inverse>) -> Self {
        Self {
            texture,
            inverse,
            folded: 0,
            not_found: 0,
        }
    }

    /// Colours of points; NaN outside of the solid and where there is no preimage.
    fn sample(&mut self, points: &[Point]) -> Vec<LinearRgb> {
        let Some(inverse) = self.inverse else {
            return self.texture.sample(points);
        };
        let (colours, report) = self.texture.sample_through(inverse, points);
        self.folded += report.folded;
        self.not_found += report.not_converged;
        colours
    }
}

/// Samples colours on a grid.
pub fn sampled_volume(colours: &mut Colours, grid: &VoxelGrid, output: &Output) -> VoxelTexture {
    let voxels = grid.voxels();
    output.progress_of("sampling voxels", 0, voxels);
    let progress = |done| output.progress_of("sampling voxels", done, voxels);
    VoxelTexture::sampled(grid, |centres| colours.sample(centres), &progress)
}

/// Writes a volume.
pub fn write_volume(path: &Path, volume: &VoxelTexture, output: &Output) -> anyhow::Result<VolumeSummary> {
    output.progress(format!("writing {}", path.display()));
    let grid = &volume.grid;
    let image = ImageGrid {
        origin: grid.origin,
        spacing: grid.spacing,
        size: grid.size,
    };
    io::write_vti(path, &image, "rgba", 4, volume.rgba.as_flattened())?;
    Ok(VolumeSummary {
        file: path.into(),
        size: grid.size,
        spacing: grid.spacing,
        inside: volume.inside,
        bytes: std::fs::metadata(path).map(|file| file.len()).unwrap_or_default(),
    })
}

/// The points of a file, or the vertices of a mesh, and where their colours go.
pub struct PointsToColour<'a> {
    points: &'a Path,
    path: &'a Path,
    solid: Option<SolidMesh>,
    positions: Vec<Point>,
}

impl<'a> PointsToColour<'a> {
    /// Reads the points; refuses a file of colours that cannot hold them.
    pub fn read(points: &'a Path, path: &'a Path) -> anyhow::Result<Self> {
        let solid = io::is_mesh(points).then(|| io::read_solid(points)).transpose()?;
        let shown = points.display();
        let positions = match (&solid, extension(path).as_str()) {
            (None, "vtu") => {
                bail!("`{shown}` holds points without a mesh; write their colours to .csv, .npy or .ply")
            }
            (Some(SolidMesh::Cells(mesh)), "ply") => {
                let elements = mesh.cells().elements();
                bail!("`{shown}` holds {elements}; write their colours to .vtu")
            }
            (None, _) => io::read_points(points)?,
            (Some(solid), _) => solid.vertices().to_vec(),
        };
        Ok(Self {
            points,
            path,
            solid,
            positions,
        })
    }

    fn cells(&self) -> Cells<'_> {
        let elements = self.solid.as_ref().map(SolidMesh::elements);
        elements.unwrap_or(Cells::Triangles(&[]))
    }
}

/// Writes the colours of points.
pub fn write_points(
    to_colour: &PointsToColour,
    colours: &mut Colours,
    output: &Output,
) -> anyhow::Result<PointsSummary> {
    let PointsToColour {
        points,
        path,
        positions,
        ..
    } = to_colour;
    output.progress(format!("colouring {}", points.display()));
    let not_found_before = colours.not_found;
    let found = colours.sample(positions);
    let without_colour = found.iter().filter(|colour| colour[0].is_nan()).count();
    let outside = without_colour - (colours.not_found - not_found_before);
    match (extension(path).as_str(), to_colour.cells()) {
        ("ply", Cells::Triangles(triangles)) => {
            let rgba: Vec<[u8; 4]> = found.iter().map(with_opacity).collect();
            io::write_coloured_ply(path, positions, &rgba, triangles)?;
        }
        ("vtu", cells) => write_cells(path, cells, positions, &found)?,
        _ => write_colours(path, positions, &found)?,
    }
    if outside > 0 {
        output.warn(format!(
            "{outside} of {} points lie outside the solid and have no colour",
            positions.len()
        ));
    }
    Ok(PointsSummary {
        file: path.into(),
        points: positions.len(),
        outside,
    })
}

fn with_opacity(light: &LinearRgb) -> [u8; 4] {
    let [r, g, b] = to_srgb(*light);
    if light[0].is_nan() { [0; 4] } else { [r, g, b, 255] }
}

/// sRGB colours from 0 to 1, as programs expect in floating point; NaN outside.
fn codes(light: &LinearRgb) -> [f64; 3] {
    if light[0].is_nan() {
        return [f64::NAN; 3];
    }
    to_srgb(*light).map(|code| f64::from(code) / 255.0)
}

fn write_cells(path: &Path, cells: Cells, positions: &[Point], colours: &[LinearRgb]) -> anyhow::Result<()> {
    let fields = VtkFields {
        point: vec![Field {
            name: "rgb".into(),
            components: 3,
            values: colours.iter().flat_map(codes).collect(),
        }],
        cell: vec![],
        ..VtkFields::default()
    };
    Ok(io::write_vtu(path, positions, cells, &fields)?)
}

/// CSV: the points and their colours. NPY has no names: the colours.
fn write_colours(path: &Path, positions: &[Point], colours: &[LinearRgb]) -> anyhow::Result<()> {
    if extension(path) != "csv" {
        let values: Vec<f64> = colours.iter().flat_map(codes).collect();
        return write_table(path, &["red", "green", "blue"], &values);
    }
    let rows = positions.iter().zip(colours);
    let values: Vec<f64> = rows
        .flat_map(|(p, light)| {
            let [r, g, b] = codes(light);
            [p.x, p.y, p.z, r, g, b]
        })
        .collect();
    write_table(path, &["x", "y", "z", "red", "green", "blue"], &values)
}
