//! The page of a solid texture: its surface, and its voxels, which a cut shows.

use anyhow::ensure;
use serde::Serialize;
use solidmap::files::Provenance;
use solidmap::geometry::Axis;
use solidmap::texture::{ColouredSurface, VoxelTexture};

use super::painted::PaintedSurface;
use super::summary::TextureSummary;
use crate::args::{PageSizeArgs, UpKind};
use crate::drawing::significant;
use crate::shared::page::{Framing, NumberTable, PackedArray, Page, megabytes};

/// Triangles that the surface is cut into.
const TRIANGLES: usize = 150_000;
/// How far colours are continued outside of the solid, in voxels: the colour at a point of the boundary comes from the eight
/// voxels around it.
const CONTINUED: usize = 2;

/// What the scripts of the page read, besides the arrays.
#[derive(Serialize)]
struct TextureContent {
    kind: &'static str,
    domain: Framing,
    voxels: VoxelContent,
    up: (usize, bool),
}

#[derive(Serialize)]
struct VoxelContent {
    /// Centre of the first voxel.
    origin: [f64; 3],
    spacing: f64,
    size: [usize; 3],
}

/// A texture to make a page of.
pub struct TexturePage<'a> {
    /// The surface.
    pub coloured: &'a ColouredSurface,
    /// The texture inside.
    pub volume: &'a VoxelTexture,
    /// The files it comes from.
    pub files: Vec<Provenance>,
    /// What is known of it.
    pub report: &'a TextureSummary,
    /// What points up.
    pub up: UpKind,
}

impl TexturePage<'_> {
    /// The text of the page.
    pub fn html(self, args: PageSizeArgs) -> anyhow::Result<String> {
        let painted = PaintedSurface::of(self.coloured, TRIANGLES);
        let framing = Framing::of(painted.mesh.vertices());
        let grid = &self.volume.grid;
        let arrays = vec![
            PackedArray::floats("surface", framing.place(painted.mesh.vertices())),
            PackedArray::indices("triangles", painted.mesh.triangles().iter().flatten().copied()),
            PackedArray::bytes("colours", painted.colours.as_flattened()),
            PackedArray::bytes("voxels", continued(self.volume).as_flattened()),
        ];
        let name = self.report.model.file_name().unwrap_or_default().to_string_lossy();
        let [x, y, z] = grid.size;
        let page = Page {
            title: format!("{name}: solid texture"),
            files: self.files,
            notes: vec![format!(
                "Cuts show {x} × {y} × {z} voxels, {} model units wide (--resolution), and what is between them is interpolated.",
                significant(grid.spacing, 4)
            )],
            tables: vec![numbers(self.report)],
            arrays,
        };
        let content = TextureContent {
            kind: "texture",
            domain: framing,
            voxels: VoxelContent {
                origin: grid.origin.into(),
                spacing: grid.spacing,
                size: grid.size,
            },
            up: (Axis::from(self.up).index(), self.up.is_upside_down()),
        };
        let html = page.html(&content)?;
        let size = html.len() as u64;
        ensure!(
            size <= args.max_size,
            "the page of {x} × {y} × {z} voxels takes {:.1} MB, but --max-size is {:.1} MB; allow more, or fewer voxels \
             (--resolution)",
            megabytes(size),
            megabytes(args.max_size)
        );
        Ok(html)
    }
}

/// The voxels; those just outside of the solid have the mean colour of their neighbours.
fn continued(volume: &VoxelTexture) -> Vec<[u8; 4]> {
    let size = volume.grid.size;
    let steps = |voxel: usize| [voxel % size[0], voxel / size[0] % size[1], voxel / size[0] / size[1]];
    let mut rgba = volume.rgba.clone();
    for _ in 0..CONTINUED {
        let before = rgba.clone();
        for voxel in (0..rgba.len()).filter(|&voxel| before[voxel][3] == 0) {
            let at = steps(voxel);
            let range = [0, 1, 2].map(|k| at[k].saturating_sub(1)..=(at[k] + 1).min(size[k] - 1));
            let (mut sum, mut count) = ([0u32; 3], 0);
            for z in range[2].clone() {
                for y in range[1].clone() {
                    for x in range[0].clone() {
                        let [r, g, b, a] = before[x + size[0] * (y + size[1] * z)];
                        if a > 0 {
                            count += 1;
                            sum = [sum[0] + u32::from(r), sum[1] + u32::from(g), sum[2] + u32::from(b)];
                        }
                    }
                }
            }
            if count > 0 {
                let [r, g, b] = sum.map(|of| ((of + count / 2) / count) as u8);
                rgba[voxel] = [r, g, b, 255];
            }
        }
    }
    rgba
}

fn numbers(report: &TextureSummary) -> NumberTable {
    let mut table = NumberTable::new("Texture");
    table.row("sources", report.fit.sources.to_string(), "", "of the harmonic part");
    let errors = [
        (
            "harmonic part",
            &report.harmonic_error,
            "difference of the harmonic part alone to the picture, rms over held-out points of the surface",
        ),
        (
            "texture",
            &report.surface_error,
            "difference of the texture to the picture, rms over the same points",
        ),
    ];
    for (name, error, meaning) in errors {
        if let Some(error) = error {
            let meaning = format!("{meaning}, as light: 1 from black to white");
            table.row(name, significant(error.rms, 3), "", meaning);
        }
    }
    let [median, _] = report.layer;
    table.row(
        "layer",
        significant(100.0 * median, 3),
        "% of the diagonal",
        "median thickness of the layer at the surface in which that difference is made up for",
    );
    table
}
