//! Polycubes: the planes of a solid with axis-aligned faces, and the boxes between them that it fills.

use crate::Point;
use crate::geometry::{QueryError, SurfaceQuery};
use crate::mesh::SurfaceMesh;

/// A polycube: a solid made of boxes between axis-aligned planes, which need not be evenly spaced.
#[derive(Debug, Clone, PartialEq)]
pub struct Polycube {
    /// Coordinates of the planes perpendicular to each axis, ascending.
    pub(super) planes: [Vec<f64>; 3],
    /// Which of the boxes between neighbouring planes belong to the solid, `x` fastest.
    pub(super) inside: Vec<bool>,
}

/// Why a surface is not a polycube.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolycubeError {
    /// A face is not axis-aligned.
    #[error(
        "{count} triangles are not axis-aligned, the first is triangle {first}, {degrees:.2}° off: a regular mesh \
         needs a polycube; give a mesh of the domain instead"
    )]
    NotAligned {
        /// How many triangles.
        count: usize,
        /// The first of them.
        first: usize,
        /// Angle of its normal to the nearest axis.
        degrees: f64,
    },
    /// The surface faces inward.
    #[error("the surface of the polycube faces inward; reverse its triangles")]
    Inward,
    /// The boxes do not have the volume that the surface encloses, or its area.
    #[error(
        "the boxes between the planes have a volume of {:.4e} and a surface of {:.4e}, the polycube {:.4e} and {:.4e}: it \
         is not closed, or has slits or parts that touch",
        volumes[0], areas[0], volumes[1], areas[1]
    )]
    Different {
        /// Volume of the boxes, and that enclosed by the surface.
        volumes: [f64; 2],
        /// Area of the boxes, and of the surface.
        areas: [f64; 2],
    },
    /// Too many planes.
    #[error("{} × {} × {} planes are too many for a polycube", planes[0], planes[1], planes[2])]
    TooManyPlanes {
        /// Number of planes perpendicular to each axis.
        planes: [usize; 3],
    },
    /// Boxes touch only along an edge or in a corner.
    #[error("two boxes of the solid touch only along an edge or in a corner, at ({:.4}, {:.4}, {:.4})", at[0], at[1], at[2])]
    Pinched {
        /// Where.
        at: [f64; 3],
    },
    /// The surface cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
}

/// Tolerance over the diagonal: a face may deviate from its plane by this much, and planes closer than this are merged.
const THICKNESS: f64 = 1e-6;
/// Largest relative difference of volumes and of areas.
const MAX_DIFFERENCE: f64 = 1e-3;
/// Largest number of boxes between planes, inside and outside.
const MAX_BOXES: usize = 20_000_000;

impl Polycube {
    /// The polycube bounded by a closed surface whose triangles are all axis-aligned. Triangles without area are
    /// ignored.
    ///
    /// # Errors
    ///
    /// When a triangle is not axis-aligned, boxes touch only along edges, or the boxes' volume or area is not the
    /// surface's.
    pub fn of(surface: &SurfaceMesh) -> Result<Self, PolycubeError> {
        let query = SurfaceQuery::with_winding_sign(surface)?;
        let diagonal = surface.diagonal();
        let mut coordinates: [Vec<(f64, f64)>; 3] = Default::default();
        let (mut skew, mut first) = (0, None);
        for t in 0..surface.triangles().len() {
            let area = surface.area_vector(t);
            let size = area.norm();
            if size < 1e-12 * diagonal * diagonal {
                continue;
            }
            let axis = area.iamax();
            let corners = surface.corners(t);
            let heights = corners.map(|p| p[axis]);
            let [low, high] = [
                heights.iter().copied().fold(f64::INFINITY, f64::min),
                heights.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ];
            if high - low > THICKNESS * diagonal {
                let mut across = area / size;
                across[axis] = 0.0;
                skew += 1;
                first.get_or_insert((t, across.norm().min(1.0).asin().to_degrees()));
                continue;
            }
            coordinates[axis].extend(corners.map(|p| (p[axis], size)));
        }
        if let Some((first, degrees)) = first {
            return Err(PolycubeError::NotAligned {
                count: skew,
                first,
                degrees,
            });
        }
        let planes = coordinates.map(|found| merged(found, THICKNESS * diagonal));
        let mut polycube = Self { planes, inside: vec![] };
        let counts = polycube.counts();
        if counts
            .iter()
            .try_fold(1usize, |product, n| product.checked_mul(*n))
            .is_none_or(|n| n > MAX_BOXES)
        {
            return Err(PolycubeError::TooManyPlanes {
                planes: polycube.planes.each_ref().map(Vec::len),
            });
        }
        let enclosed = surface.volume();
        if enclosed < 0.0 {
            return Err(PolycubeError::Inward);
        }
        let centres: Vec<Point> = boxes(counts).map(|at| polycube.centre(at)).collect();
        polycube.inside = query.contains_all(&centres);
        let volume = |at| polycube.sides(at).iter().product::<f64>();
        let volumes = [polycube.filled().map(volume).sum(), enclosed];
        let face_area = |at, axis: usize| {
            let sides = polycube.sides(at);
            sides[(axis + 1) % 3] * sides[(axis + 2) % 3]
        };
        let areas = [polycube.sum_over_outer_faces(face_area), surface.area()];
        let is_close = |[a, b]: [f64; 2]| (a - b).abs() <= MAX_DIFFERENCE * b && a > 0.0;
        if !is_close(volumes) || !is_close(areas) {
            return Err(PolycubeError::Different { volumes, areas });
        }
        polycube.require_manifold()?;
        Ok(polycube)
    }

    /// Coordinates of the planes perpendicular to each axis, ascending.
    pub fn planes(&self) -> &[Vec<f64>; 3] {
        &self.planes
    }

    /// Number of boxes along each axis, inside and outside of the solid.
    pub fn counts(&self) -> [usize; 3] {
        self.planes.each_ref().map(|p| p.len().saturating_sub(1))
    }

    /// Whether a box belongs to the solid; those outside the planes do not.
    pub fn contains(&self, at: [isize; 3]) -> bool {
        let counts = self.counts();
        if (0..3).any(|k| at[k] < 0 || at[k] as usize >= counts[k]) {
            return false;
        }
        let [i, j, k] = at.map(|i| i as usize);
        self.inside[i + counts[0] * (j + counts[1] * k)]
    }

    /// Boxes of the solid.
    pub(crate) fn filled(&self) -> impl Iterator<Item = [usize; 3]> {
        boxes(self.counts()).filter(|at| self.contains(at.map(|i| i as isize)))
    }

    /// The faces of a box that bound the solid: their axis, and 0 for its lower side or 1 for the upper.
    pub(crate) fn outer_faces_of(&self, at: [usize; 3]) -> impl Iterator<Item = [usize; 2]> {
        let faces = (0..3).flat_map(|axis| [[axis, 0], [axis, 1]]);
        faces.filter(move |&[axis, side]| {
            let mut beyond = at.map(|i| i as isize);
            beyond[axis] += 2 * side as isize - 1;
            !self.contains(beyond)
        })
    }

    /// Sum of a function of box and axis over the outer faces of the solid's boxes.
    pub(super) fn sum_over_outer_faces(&self, value: impl Fn([usize; 3], usize) -> f64) -> f64 {
        let mut sum = 0.0;
        for at in self.filled() {
            self.outer_faces_of(at).for_each(|[axis, _]| sum += value(at, axis));
        }
        sum
    }

    fn centre(&self, at: [usize; 3]) -> Point {
        let middle = |k: usize| 0.5 * (self.planes[k][at[k]] + self.planes[k][at[k] + 1]);
        Point::from([0, 1, 2].map(middle))
    }

    pub(super) fn sides(&self, at: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.planes[k][at[k] + 1] - self.planes[k][at[k]])
    }

    /// Requires that the solid is a manifold: around every corner of the grid, the boxes inside are connected by faces,
    /// and so are those outside.
    fn require_manifold(&self) -> Result<(), PolycubeError> {
        let counts = self.counts();
        for at in boxes(counts.map(|n| n + 1)) {
            let inside: [bool; 8] = std::array::from_fn(|m| {
                self.contains(std::array::from_fn(|k| at[k] as isize - 1 + (m >> k & 1) as isize))
            });
            if !is_connected(inside, true) || !is_connected(inside, false) {
                return Err(PolycubeError::Pinched {
                    at: std::array::from_fn(|k| self.planes[k][at[k]]),
                });
            }
        }
        Ok(())
    }
}

/// Indices of all boxes, `x` fastest.
pub(super) fn boxes([x, y, z]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..z).flat_map(move |k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])))
}

/// Whether those of the eight boxes around a corner that are `kind` are connected by faces.
fn is_connected(inside: [bool; 8], kind: bool) -> bool {
    let members: Vec<usize> = (0..8).filter(|&m| inside[m] == kind).collect();
    let Some(&start) = members.first() else { return true };
    let mut reached = 1u8 << start;
    for _ in 0..8 {
        for &m in &members {
            if (0..3).any(|k| reached >> (m ^ (1 << k)) & 1 == 1) {
                reached |= 1 << m;
            }
        }
    }
    members.iter().all(|m| reached >> m & 1 == 1)
}

/// Weighted means of groups of values in which each is closer to the next than `tolerance`.
fn merged(mut values: Vec<(f64, f64)>, tolerance: f64) -> Vec<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    values
        .chunk_by(|a, b| b.0 - a.0 <= tolerance)
        .map(|group| {
            // Exact where all are the same.
            if group[0].0 == group[group.len() - 1].0 {
                return group[0].0;
            }
            let weight: f64 = group.iter().map(|g| g.1).sum();
            group.iter().map(|g| g.0 * (g.1 / weight)).sum()
        })
        .collect()
}
