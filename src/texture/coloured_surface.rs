//! Coloured surfaces and their seams.

use rayon::prelude::*;

use super::TextureError;
use super::colour::LinearRgb;
use super::picture::{Picture, Wrap};
use crate::Point;
use crate::check;
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// A surface with a colour everywhere: a picture laid over it, or colours of its vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct ColouredSurface {
    surface: SurfaceMesh,
    source: ColourSource,
}

/// Where the colours of a surface come from.
#[derive(Debug, Clone, PartialEq)]
pub enum ColourSource {
    /// A picture.
    Picture {
        /// Texture coordinates of the three corners of each triangle; `v` points up. Each triangle has its own, so that
        /// they may jump at an edge, as they do at the seams of an atlas.
        uv: Vec<[[f64; 2]; 3]>,
        /// The picture.
        picture: Picture,
        /// How it continues beyond its edges.
        wrap: Wrap,
    },
    /// A colour of each vertex, linear between them.
    Vertices(Vec<LinearRgb>),
}

/// Jumps of texture coordinates and colours between the two triangles at an edge.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct SeamReport {
    /// Edges between two triangles.
    pub edges: usize,
    /// Those at which the texture coordinates jump.
    pub seams: usize,
    /// Their length as a fraction of the length of all edges.
    pub length_fraction: f64,
    /// The largest jump of `u` or `v`.
    pub largest_uv_jump: f64,
    /// Root mean square jump of the colour along the seams: the largest of red, green and blue, in linear colours, 1
    /// from black to white.
    pub rms_colour_jump: f64,
    /// The largest such jump.
    pub largest_colour_jump: f64,
}

/// Texture coordinates that differ by less count as equal: files round them.
const SAME_UV: f64 = 1e-6;
/// Least and largest number of points along an edge at which colours are compared: one per pixel that the edge crosses.
const COMPARED_POINTS: (usize, usize) = (5, 200);

impl ColouredSurface {
    /// The surface with a picture laid over it. Its triangles are oriented outward, and their coordinates with them.
    ///
    /// # Errors
    ///
    /// [`TextureError::UvCount`], [`TextureError::UvNotFinite`].
    pub fn from_picture(
        surface: &SurfaceMesh,
        mut uv: Vec<[[f64; 2]; 3]>,
        picture: Picture,
        wrap: Wrap,
    ) -> Result<Self, TextureError> {
        if uv.len() != surface.triangles().len() {
            return Err(TextureError::UvCount {
                triangles: surface.triangles().len(),
                found: uv.len(),
            });
        }
        if let Some(triangle) = uv.iter().position(|t| t.as_flattened().iter().any(|x| !x.is_finite())) {
            return Err(TextureError::UvNotFinite { triangle });
        }
        let (repaired, _) = check::repair(surface);
        for (corners, (before, after)) in uv.iter_mut().zip(surface.triangles().iter().zip(repaired.triangles())) {
            if before != after {
                corners.swap(1, 2);
            }
        }
        Ok(Self {
            surface: repaired,
            source: ColourSource::Picture { uv, picture, wrap },
        })
    }

    /// The surface with a colour at each vertex. Its triangles are oriented outward.
    ///
    /// # Errors
    ///
    /// [`TextureError::ColourCount`], [`TextureError::ColourNotFinite`].
    pub fn from_vertex_colours(surface: &SurfaceMesh, colours: Vec<LinearRgb>) -> Result<Self, TextureError> {
        if colours.len() != surface.vertices().len() {
            return Err(TextureError::ColourCount {
                vertices: surface.vertices().len(),
                found: colours.len(),
            });
        }
        if let Some(vertex) = colours.iter().position(|c| c.iter().any(|x| !x.is_finite())) {
            return Err(TextureError::ColourNotFinite { vertex });
        }
        Ok(Self {
            surface: check::repair(surface).0,
            source: ColourSource::Vertices(colours),
        })
    }

    /// The surface, its triangles facing outward where it is closed.
    pub fn surface(&self) -> &SurfaceMesh {
        &self.surface
    }

    /// Where its colours come from.
    pub fn colour_source(&self) -> &ColourSource {
        &self.source
    }

    /// The colour at a point of the surface.
    pub fn colour(&self, point: &SurfacePoint) -> LinearRgb {
        match &self.source {
            ColourSource::Picture { uv, picture, wrap } => picture.light(uv_at(uv, point), *wrap),
            ColourSource::Vertices(colours) => {
                let corners = self.surface.triangles()[point.triangle as usize];
                interpolated(corners.map(|v| colours[v as usize]), point.barycentric)
            }
        }
    }

    /// The texture coordinates at a point of the surface; `None` where colours come from vertices.
    pub fn uv(&self, point: &SurfacePoint) -> Option<[f64; 2]> {
        match &self.source {
            ColourSource::Picture { uv, .. } => Some(uv_at(uv, point)),
            ColourSource::Vertices(_) => None,
        }
    }

    /// Lowest and highest texture coordinates; `None` where colours come from vertices.
    pub fn uv_box(&self) -> Option<[[f64; 2]; 2]> {
        let ColourSource::Picture { uv, .. } = &self.source else {
            return None;
        };
        let start = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        Some(uv.iter().flatten().fold(start, |[low, high], corner| {
            [
                [low[0].min(corner[0]), low[1].min(corner[1])],
                [high[0].max(corner[0]), high[1].max(corner[1])],
            ]
        }))
    }

    /// Compares the two triangles at each edge. Colours of vertices never jump.
    pub fn seams(&self) -> SeamReport {
        let topology = Topology::new(&self.surface);
        let edges: Vec<usize> = (0..topology.edges().len())
            .filter(|&e| topology.sides(e).len() == 2)
            .collect();
        let mut report = SeamReport {
            edges: edges.len(),
            ..SeamReport::default()
        };
        let ColourSource::Picture { uv, picture, .. } = &self.source else {
            return report;
        };
        let length = |e: usize| {
            let [a, b] = topology.edges()[e].map(|v| self.surface.vertices()[v as usize]);
            (b - a).norm()
        };
        let compared: Vec<(f64, Option<SeamJump>)> = edges
            .par_iter()
            .with_min_len(256)
            .map(|&e| {
                let [a, b] = topology.edges()[e];
                let sides = [0, 1].map(|k| topology.sides(e)[k].triangle as usize);
                let ends = sides.map(|t| [a, b].map(|v| self.corner_of(t, v)));
                (length(e), self.jump(uv, picture, sides, ends))
            })
            .collect();
        let total: f64 = compared.iter().map(|(length, _)| length).sum();
        let (mut seam_length, mut squares) = (0.0, 0.0);
        for (length, jump) in &compared {
            let Some(jump) = jump else { continue };
            report.seams += 1;
            report.largest_uv_jump = report.largest_uv_jump.max(jump.uv);
            report.largest_colour_jump = report.largest_colour_jump.max(jump.largest);
            seam_length += length;
            squares += length * jump.mean_square;
        }
        if seam_length > 0.0 {
            report.length_fraction = seam_length / total;
            report.rms_colour_jump = (squares / seam_length).sqrt();
        }
        report
    }

    fn corner_of(&self, triangle: usize, vertex: u32) -> usize {
        let corners = self.surface.triangles()[triangle];
        corners.iter().position(|&v| v == vertex).unwrap_or_default()
    }

    /// The jump between the two triangles along an edge, whose ends are these corners of each; `None` if their
    /// coordinates are equal.
    fn jump(
        &self,
        uv: &[[[f64; 2]; 3]],
        picture: &Picture,
        sides: [usize; 2],
        ends: [[usize; 2]; 2],
    ) -> Option<SeamJump> {
        let at = |side: usize, end: usize| uv[sides[side]][ends[side][end]];
        let differences = [0, 1].map(|end| distance(at(0, end), at(1, end)));
        let largest_uv = differences[0].max(differences[1]);
        if largest_uv <= SAME_UV {
            return None;
        }
        let pixels = picture.width().max(picture.height()) as f64;
        let crossed = [0, 1].map(|side| distance(at(side, 0), at(side, 1)) * pixels);
        let points = (crossed[0].max(crossed[1]).ceil() as usize).clamp(COMPARED_POINTS.0, COMPARED_POINTS.1);
        let (mut largest, mut squares) = (0f64, 0.0);
        for k in 0..points {
            let t = (k as f64 + 0.5) / points as f64;
            let [one, other] = [0, 1].map(|side| {
                let mut barycentric = [0.0; 3];
                barycentric[ends[side][0]] = 1.0 - t;
                barycentric[ends[side][1]] = t;
                self.colour(&SurfacePoint {
                    triangle: sides[side] as u32,
                    barycentric,
                })
            });
            let jump = (0..3).map(|c| (one[c] - other[c]).abs()).fold(0.0, f64::max);
            largest = largest.max(jump);
            squares += jump * jump;
        }
        Some(SeamJump {
            uv: largest_uv,
            largest,
            mean_square: squares / points as f64,
        })
    }
}

/// The jump at an edge.
struct SeamJump {
    uv: f64,
    largest: f64,
    mean_square: f64,
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
}

fn uv_at(uv: &[[[f64; 2]; 3]], point: &SurfacePoint) -> [f64; 2] {
    interpolated(uv[point.triangle as usize], point.barycentric)
}

fn interpolated<const N: usize>(corners: [[f64; N]; 3], weights: [f64; 3]) -> [f64; N] {
    std::array::from_fn(|k| (0..3).map(|corner| corners[corner][k] * weights[corner]).sum())
}

/// A colour as a point of the target of a boundary map.
pub(super) fn as_point(colour: LinearRgb) -> Point {
    Point::from(colour)
}
