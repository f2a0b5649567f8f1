//! Mean value coordinates of closed triangle meshes, as a map of the solid inside.
//!
//! The image of a point is the mean of the boundary's images over all directions, weighted by the reciprocal of the
//! distance to the boundary. A direction that meets a surface more than once counts every intersection, with the sign
//! of the crossing, so that the map is smooth inside solids that are not star-shaped too. It carries the boundary
//! exactly and reproduces affine maps, but it is not harmonic, and weights may be negative.
//!
//! # Accuracy
//!
//! Sums are over all triangles, without approximation. The weights of Ju et al. divide by the volume of the tetrahedron
//! of point and triangle; here the integrals are arranged by edges and triangles so that what they divide by does not
//! vanish, and images are taken relative to that of the closest boundary point. Value and Jacobian thus stay accurate
//! where a few triangles outweigh all others. [`sums`] has the formulas.
//!
//! # References
//!
//! Ju, Schaefer, Warren, *Mean value coordinates for closed triangular meshes*, SIGGRAPH 2005. Floater, Kós, Reimers,
//! *Mean value coordinates in 3D*, Computer Aided Geometric Design 22 (2005).

use rayon::prelude::*;

use crate::boundary_map::BoundaryMap;
use crate::geometry::{Aabb, Bvh, ClosestPoint, QueryError, SurfaceQuery, morton_order};
use crate::map::VolumeMap;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;
use crate::simd::Instructions;
use crate::{Matrix3, Point, Vector};

mod sums;

use sums::{LANES, PatchEdge, PatchTriangle, PointBlock, TrianglePatch};

/// The map of a solid by mean value coordinates of its boundary.
///
/// On the boundary (within 1e-12 of the domain's diagonal) the image is the boundary map's. Where the boundary has
/// edges the Jacobian jumps; closer to it than 1e-8 of the diagonal the Jacobian is that at 1e-8, in the direction of
/// the point, and into the solid from points on the boundary. Outside, the same formula continues the map; it is
/// defined nearly everywhere there but means little, and loses digits far away. NaN where the point is not finite.
///
/// Parallel over points. A point costs some 4 ns per triangle and core with AVX-512, its Jacobian 7 ns; half as much
/// again with AVX2. Images and Jacobians do not depend on the number of threads, nor on which points are asked for
/// together.
#[derive(Debug, Clone)]
pub struct MeanValueMap {
    frame: Normalisation,
    /// Queries on the domain, in its normalised frame.
    query: SurfaceQuery,
    domain: SurfaceMesh,
    image: Vec<Point>,
    /// Unit normals into the solid, averaged over the triangles at each vertex.
    inward: Vec<Vector>,
    patches: Vec<TrianglePatch>,
    instructions: Instructions,
}

/// Why a boundary has no mean value coordinates.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeanValueError {
    /// There are no triangles, or some have vertices that are not finite.
    #[error(transparent)]
    Surface(#[from] QueryError),
    /// The surface is open or inconsistently oriented: directions would be missed, or counted wrongly.
    #[error(
        "{edges} edges do not have equally many triangles in both directions, such as that from vertex {from} to {to}; \
         the surface must be closed and consistently oriented"
    )]
    NotClosed {
        /// How many edges.
        edges: usize,
        /// A vertex of the first of them.
        from: u32,
        /// Its other vertex.
        to: u32,
    },
    /// No triangle has an area.
    #[error("none of the {triangles} triangles has an area; there is no solid")]
    NoArea {
        /// How many triangles there are.
        triangles: usize,
    },
}

impl MeanValueMap {
    /// The map that carries the boundary as `boundary` does. Time and memory are linear in the number of triangles.
    ///
    /// The surface may have several components, cavities and handles, and need not be manifold. It may be oriented
    /// inward as a whole.
    ///
    /// # Errors
    ///
    /// When the domain is empty, not finite, not closed, not consistently oriented, or without area.
    pub fn new(boundary: &BoundaryMap) -> Result<Self, MeanValueError> {
        let frame = Normalisation::of(boundary.domain());
        let positions = boundary.domain().vertices().iter().map(|p| frame.localise(p)).collect();
        let domain = boundary
            .domain()
            .with_vertices(positions)
            .expect("there are as many positions as before");
        let query = SurfaceQuery::new(&domain)?;
        check_closed(&domain)?;
        let patches = cut_into_patches(&domain, boundary.image());
        if patches.iter().all(|patch| patch.triangles.is_empty()) {
            let triangles = domain.triangles().len();
            return Err(MeanValueError::NoArea { triangles });
        }
        Ok(Self {
            frame,
            query,
            inward: inward_normals(&domain),
            domain,
            image: boundary.image().to_vec(),
            patches,
            instructions: Instructions::detect(),
        })
    }

    /// Sums at each point, with the image that they are relative to and how far the boundary is; `place` says where to
    /// take them.
    fn sums(
        &self,
        points: &[Point],
        with_gradient: bool,
        place: impl Fn(Point, &ClosestPoint) -> Point,
    ) -> Vec<PointSums> {
        let local: Vec<Point> = points.iter().map(|p| self.frame.localise(p)).collect();
        // Neighbours together: the formulas for near triangles then run for few blocks.
        let order = morton_order(&local);
        let local: Vec<Point> = order.iter().map(|&i| local[i as usize]).collect();
        let closest = self.query.closest_points(&local);
        let mut samples: Vec<PointSums> = local
            .iter()
            .zip(&closest)
            .map(|(p, closest)| PointSums {
                place: place(*p, closest),
                origin: self.image_of(closest),
                distance: closest.distance,
                sums: [0.0; 16],
            })
            .collect();
        samples.par_chunks_mut(LANES * BLOCKS).for_each(|samples| {
            let blocks: Vec<PointBlock> = samples.chunks(LANES).map(gather).collect();
            let sums = sums::sum(self.instructions, &self.patches, &blocks, with_gradient);
            for (samples, sums) in samples.chunks_mut(LANES).zip(&sums) {
                for (lane, sample) in samples.iter_mut().enumerate() {
                    sample.sums = sums.map(|lanes| lanes[lane]);
                }
            }
        });
        let mut in_order = samples.clone();
        for (sample, &i) in samples.iter().zip(&order) {
            in_order[i as usize] = *sample;
        }
        in_order
    }

    fn image_of(&self, closest: &ClosestPoint) -> Point {
        let corners = self.domain.triangles()[closest.triangle];
        let weighted = (0..3).map(|k| self.image[corners[k] as usize].coords * closest.barycentric[k]);
        Point::from(weighted.sum::<Vector>())
    }

    /// Where to take the Jacobian: at the point, or off the boundary along the same direction.
    fn off_boundary(&self, point: Point, closest: &ClosestPoint) -> Point {
        if closest.distance >= CLEAR || closest.distance.is_nan() {
            return point;
        }
        let away = if closest.distance > ON_BOUNDARY {
            (point - closest.point) / closest.distance
        } else {
            self.inward_at(closest)
        };
        closest.point + away * CLEAR
    }

    fn inward_at(&self, closest: &ClosestPoint) -> Vector {
        let corners = self.domain.triangles()[closest.triangle];
        let averages = corners.map(|v| self.inward[v as usize]);
        let average: Vector = (0..3).map(|k| averages[k] * closest.barycentric[k]).sum();
        if closest.barycentric.iter().any(|&weight| weight < AT_AN_EDGE) {
            // Tilted, since symmetry can put the average into the plane of a face.
            let tilted = average + Vector::new(0.031, 0.017, -0.023);
            return tilted.try_normalize(0.0).unwrap_or_else(Vector::zeros);
        }
        let normal = self.domain.area_vector(closest.triangle);
        let inward = if normal.dot(&average) < 0.0 { -normal } else { normal };
        inward.try_normalize(0.0).unwrap_or_else(Vector::zeros)
    }
}

impl VolumeMap for MeanValueMap {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        self.sums(points, false, |p, _| p)
            .iter()
            .map(|sample| {
                if sample.distance <= ON_BOUNDARY {
                    sample.origin
                } else {
                    sample.origin + sample.offset()
                }
            })
            .collect()
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        self.sums(points, true, |p, closest| self.off_boundary(p, closest))
            .iter()
            .map(|sample| sample.jacobian() * self.frame.scale)
            .collect()
    }
}

/// Distance in the normalised frame up to which a point is on the boundary.
const ON_BOUNDARY: f64 = 1e-12;
/// Distance in the normalised frame to which points are moved off the boundary for their Jacobian. The image's rounding
/// error over this distance is about the distance itself, which makes the total error smallest.
const CLEAR: f64 = 1e-8;
/// Weight of the opposite corner below which a point of a triangle counts as on the edge.
const AT_AN_EDGE: f64 = 1e-6;
/// Blocks of points that a task takes together through all patches.
const BLOCKS: usize = 4;
/// Triangles per patch: its edges' integrals fill half of a first-level cache.
const PATCH: usize = 64;

/// Moves the domain to the origin and scales it by a power of two, which is exact, to a diagonal between one and two.
#[derive(Debug, Clone, Copy)]
struct Normalisation {
    centre: Point,
    scale: f64,
}

impl Normalisation {
    fn of(mesh: &SurfaceMesh) -> Self {
        let centre = mesh.bounding_box().map_or_else(Point::origin, |(low, high)| {
            Point::from(low.coords / 2.0 + high.coords / 2.0)
        });
        let diagonal = mesh.diagonal();
        let scale = if diagonal.is_normal() {
            2f64.powi(-(diagonal.log2().floor() as i32))
        } else {
            1.0
        };
        Self { centre, scale }
    }

    fn localise(&self, p: &Point) -> Point {
        ((p - self.centre) * self.scale).into()
    }
}

/// A point of the normalised frame, and the sums there.
#[derive(Debug, Clone, Copy)]
struct PointSums {
    place: Point,
    /// Image of the closest boundary point.
    origin: Point,
    distance: f64,
    /// As [`sums::BlockSums`] has them, for this point.
    sums: [f64; 16],
}

impl PointSums {
    /// From the origin to the image.
    fn offset(&self) -> Vector {
        Vector::from_column_slice(&self.sums[..3]) / self.sums[3]
    }

    fn jacobian(&self) -> Matrix3 {
        let numerator = Matrix3::from_row_slice(&self.sums[4..13]);
        let denominator = Vector::from_column_slice(&self.sums[13..]);
        (numerator - self.offset() * denominator.transpose()) / self.sums[3]
    }
}

/// A block of up to [`LANES`] samples, the last repeated to fill the lanes.
fn gather(samples: &[PointSums]) -> PointBlock {
    let lanes = |of: fn(&PointSums) -> Point| {
        std::array::from_fn(|k| std::array::from_fn(|lane| of(&samples[lane.min(samples.len() - 1)])[k]))
    };
    PointBlock {
        points: lanes(|sample| sample.place),
        origins: lanes(|sample| sample.origin),
    }
}

/// Refuses surfaces with an edge that does not have equally many triangles in both directions.
fn check_closed(mesh: &SurfaceMesh) -> Result<(), MeanValueError> {
    let topology = Topology::new(mesh);
    let unbalanced: Vec<[u32; 2]> = (0..topology.edges().len())
        .filter(|&edge| {
            let sides = topology.sides(edge);
            2 * sides.iter().filter(|&&side| topology.runs_forward(side)).count() != sides.len()
        })
        .map(|edge| topology.edges()[edge])
        .collect();
    match unbalanced.first() {
        None => Ok(()),
        Some(&[from, to]) => Err(MeanValueError::NotClosed {
            edges: unbalanced.len(),
            from,
            to,
        }),
    }
}

/// The triangles in the order of a tree of boxes, [`PATCH`] at a time.
fn cut_into_patches(mesh: &SurfaceMesh, image: &[Point]) -> Vec<TrianglePatch> {
    let boxes: Vec<Aabb> = (0..mesh.triangles().len())
        .map(|t| Aabb::around(&mesh.corners(t)))
        .collect();
    let bvh = Bvh::new(&boxes);
    bvh.order()
        .par_chunks(PATCH)
        .map(|triangles| build_patch(mesh, image, triangles))
        .collect()
}

fn build_patch(mesh: &SurfaceMesh, image: &[Point], triangles: &[u32]) -> TrianglePatch {
    let side = |corners: [u32; 3], k: usize| {
        let (start, end) = (corners[k], corners[(k + 1) % 3]);
        [start.min(end), start.max(end)]
    };
    let corners_of = |&t: &u32| mesh.triangles()[t as usize];
    let mut keys: Vec<[u32; 2]> = triangles
        .iter()
        .map(corners_of)
        .flat_map(|corners| (0..3).map(move |k| side(corners, k)))
        .collect();
    keys.sort_unstable();
    keys.dedup();
    let position = |v: u32| mesh.vertices()[v as usize];
    let mut edges: Vec<PatchEdge> = keys
        .iter()
        .map(|&[a, b]| PatchEdge::new(position(a), position(b)))
        .collect();
    let mut kept = Vec::with_capacity(triangles.len());
    for corners in triangles.iter().map(corners_of) {
        let sides: [usize; 3] = std::array::from_fn(|k| {
            keys.binary_search(&side(corners, k))
                .expect("the side of every triangle is a key")
        });
        let images = corners.map(|v| image[v as usize]);
        let Some(triangle) = PatchTriangle::new(corners.map(position), images, sides.map(|e| e as u32)) else {
            continue;
        };
        for k in 0..3 {
            edges[sides[k]].attach(&triangle, corners[k] < corners[(k + 1) % 3]);
        }
        kept.push(triangle);
    }
    TrianglePatch { edges, triangles: kept }
}

fn inward_normals(mesh: &SurfaceMesh) -> Vec<Vector> {
    let outward = if mesh.volume() < 0.0 { -1.0 } else { 1.0 };
    let mut normals = vec![Vector::zeros(); mesh.vertices().len()];
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let area = mesh.area_vector(t);
        for &v in corners {
            normals[v as usize] -= area * outward;
        }
    }
    for normal in &mut normals {
        *normal = normal.try_normalize(0.0).unwrap_or_else(Vector::zeros);
    }
    normals
}

#[cfg(test)]
mod tests;
