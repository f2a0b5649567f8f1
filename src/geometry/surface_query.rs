//! Closest points, signed distances and inside tests on a surface.
//!
//! The sign comes from the closest point's pseudonormal (Baerentzen & Aanaes, *Signed distance computation using the
//! angle weighted pseudonormal*, IEEE TVCG 11, 2005): the normal of its triangle, the sum of those of its edge's two
//! triangles, or the sum around its corner weighted by angle. That is exact for surfaces that bound a solid and cheap.
//! Where a pseudonormal does not decide (thin triangles, edges with more than two triangles, directions almost along
//! the surface), and everywhere on open surfaces, the generalised winding number does (see
//! [`super::winding_number()`]).

use rayon::prelude::*;

use super::closest_point::is_thin;
use super::winding_number::FarField;
use super::{Aabb, Bvh, Feature, TrianglePoint, closest_point_on_triangle};
use crate::mesh::topology::{NONE, Topology};
use crate::mesh::{SurfaceMesh, SurfacePoint, welded};
use crate::{Point, Vector};

/// Closest points, signed distances and inside tests on a surface, for any number of points.
///
/// The surface must be oriented outward, cavities into the cavity, as [`crate::check::repair()`] makes it. Building
/// takes a fraction of a second per million triangles, a query near the surface microseconds. Copies what it needs of
/// the mesh; can be shared between threads.
#[derive(Debug, Clone)]
pub struct SurfaceQuery {
    bvh: Bvh,
    /// Corners of the triangles in the order of the tree's leaves: the position in this order is a triangle's slot.
    corners: Vec<[Point; 3]>,
    slot_of_first_triangle: u32,
    longest_side: f64,
    far_field: FarField,
    sides: Option<Pseudonormals>,
}

/// The point of a surface closest to a query point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// Where it is.
    pub point: Point,
    /// The triangle it lies on; of several at exactly the same distance, the one with the lowest index.
    pub triangle: usize,
    /// Weights of the triangle's corners: not negative, with sum 1.
    pub barycentric: [f64; 3],
    /// Which part of the triangle it lies on.
    pub feature: Feature,
    /// How far it is; NaN when the query point has a NaN coordinate.
    pub distance: f64,
}

impl ClosestPoint {
    /// The same point by its triangle and weights.
    pub fn surface_point(&self) -> SurfacePoint {
        SurfacePoint {
            triangle: self.triangle as u32,
            barycentric: self.barycentric,
        }
    }
}

/// Why a surface cannot be queried.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QueryError {
    /// The surface has no triangles.
    #[error("the surface has no triangles")]
    Empty,
    /// A corner has a NaN or infinite coordinate.
    #[error("vertex {vertex} of triangle {triangle} has an infinite or undefined coordinate; remove or repair it")]
    NonFinite {
        /// The vertex.
        vertex: u32,
        /// The lowest triangle that names it.
        triangle: usize,
    },
}

/// Pseudonormals, by slot; zero where they do not decide.
#[derive(Debug, Clone)]
struct Pseudonormals {
    of_face: Vec<Vector>,
    /// Slot of the triangle across each side, [`NONE`] where there are more, or where one of the two is thin.
    across: Vec<[u32; 3]>,
    vertices: Vec<[u32; 3]>,
    of_vertex: Vec<Vector>,
}

/// Below this cosine between pseudonormal and direction the winding number decides: far above rounding, and rarely met.
const DECISIVE: f64 = 0.02;

/// Points of a batch that one task takes in turn, the search for each starting where that for the one before ended.
const RUN: usize = 512;

impl SurfaceQuery {
    /// Prepares queries on a surface that does not intersect itself.
    ///
    /// # Errors
    ///
    /// [`QueryError::Empty`] without triangles, [`QueryError::NonFinite`] when one has an infinite or NaN corner.
    pub fn new(mesh: &SurfaceMesh) -> Result<Self, QueryError> {
        let mut query = Self::with_winding_sign(mesh)?;
        query.sides = Pseudonormals::new(mesh, query.bvh.order());
        Ok(query)
    }

    /// Prepares queries on any surface. The winding number decides everywhere what is inside: also correct where parts
    /// overlap, but several times slower.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn with_winding_sign(mesh: &SurfaceMesh) -> Result<Self, QueryError> {
        check_corners(mesh)?;
        let count = mesh.triangles().len();
        let boxes: Vec<Aabb> = (0..count).map(|t| Aabb::around(&mesh.corners(t))).collect();
        let bvh = Bvh::new(&boxes);
        let corners: Vec<[Point; 3]> = bvh.order().iter().map(|&t| mesh.corners(t as usize)).collect();
        let longest = corners.iter().map(longest_side_squared).fold(0.0, f64::max);
        let first = bvh.order().iter().position(|&t| t == 0);
        Ok(Self {
            far_field: FarField::new(&bvh, &corners),
            slot_of_first_triangle: first.expect("every triangle is in the tree") as u32,
            longest_side: longest.sqrt(),
            sides: None,
            bvh,
            corners,
        })
    }

    /// The box of the surface.
    pub fn bounds(&self) -> Aabb {
        self.bvh.nodes()[0].bounds
    }

    /// The closest point of the surface.
    pub fn closest_point(&self, p: &Point) -> ClosestPoint {
        self.describe(p, self.nearest(p, self.slot_of_first_triangle))
    }

    /// Distance to the surface: negative inside, positive outside. Within rounding of the surface it may have either
    /// sign; NaN when the point has a NaN coordinate.
    pub fn signed_distance(&self, p: &Point) -> f64 {
        self.signed_distance_to(p, self.nearest(p, self.slot_of_first_triangle))
    }

    /// Whether the point is inside: whether the winding number exceeds one half.
    ///
    /// Away from the surface this is several times faster than [`Self::signed_distance`]. The two agree where the
    /// surface bounds a solid; where parts overlap, or the surface has holes, this is the one to trust.
    pub fn contains(&self, p: &Point) -> bool {
        self.bounds().contains(p) && self.winding_number(p) > 0.5
    }

    /// The generalised winding number about `p` by expansions of far parts: with an error of a few hundredths at most,
    /// where an inside test tolerates a half, in a time that grows with the logarithm of the number of triangles.
    pub fn winding_number(&self, p: &Point) -> f64 {
        self.far_field.winding_number(&self.bvh, &self.corners, p)
    }

    /// Whether each ball (centre and radius) lies outside the solid: no part of the surface is nearer to its centre
    /// than its radius, and the winding number about it is zero. Correct also where parts of the surface overlap,
    /// however the query was made. `false` for balls without a finite centre. In parallel.
    ///
    /// Several times faster than the signed distances of the centres: the search ends with the first triangle in the
    /// ball, and balls that overlap are on the same side of the surface, so that few of many close balls need a winding
    /// number.
    pub fn are_outside(&self, balls: &[(Point, f64)]) -> Vec<bool> {
        let centres: Vec<Point> = balls.iter().map(|ball| ball.0).collect();
        self.each(&centres, RecentBalls::default, |i, recent| {
            let (centre, radius) = balls[i];
            centre.coords.iter().all(|x| x.is_finite())
                && self.is_free(&centre, radius)
                && recent.is_outside(&centre, radius, || !self.contains(&centre))
        })
    }

    /// [`Self::closest_point`] of each point, in parallel.
    pub fn closest_points(&self, points: &[Point]) -> Vec<ClosestPoint> {
        self.each_nearest(points, |p, slot| self.describe(p, slot))
    }

    /// [`Self::signed_distance`] of each point, in parallel.
    pub fn signed_distances(&self, points: &[Point]) -> Vec<f64> {
        self.each_nearest(points, |p, slot| self.signed_distance_to(p, slot))
    }

    /// [`Self::contains`] of each point, in parallel.
    pub fn contains_all(&self, points: &[Point]) -> Vec<bool> {
        self.each(points, || (), |i, _| self.contains(&points[i]))
    }

    /// What follows from each point and the slot of its closest triangle.
    fn each_nearest<T: Send>(&self, points: &[Point], answer: impl Fn(&Point, u32) -> T + Sync) -> Vec<T> {
        let begin = || self.slot_of_first_triangle;
        self.each(points, begin, |i, slot| {
            *slot = self.nearest(&points[i], *slot);
            answer(&points[i], *slot)
        })
    }

    /// Answers queries along a space-filling curve: neighbours read the same part of the tree, and the state after one,
    /// such as its closest triangle, is a good start for the next. `answer` gets the index of a point and the state;
    /// `begin` makes the state for the first point of a run.
    fn each<K, T: Send>(
        &self,
        points: &[Point],
        begin: impl Fn() -> K + Sync,
        answer: impl Fn(usize, &mut K) -> T + Sync,
    ) -> Vec<T> {
        let order = morton_order(points);
        let runs = order.par_chunks(RUN).flat_map_iter(|run| {
            let mut state = begin();
            let answer = &answer;
            run.iter().map(move |&i| (i, answer(i as usize, &mut state)))
        });
        let mut answers: Vec<(u32, T)> = runs.collect();
        answers.par_sort_unstable_by_key(|&(i, _)| i);
        answers.into_iter().map(|(_, answer)| answer).collect()
    }

    /// Whether no triangle is nearer to `p` than `radius`.
    fn is_free(&self, p: &Point, radius: f64) -> bool {
        const STOP: f64 = -1.0;
        let mut free = true;
        self.bvh.visit_nearest(p, radius * radius, |mut slots, limit| {
            let is_in =
                |slot| closest_point_on_triangle(p, &self.corners[slot]).offset.norm_squared() < radius * radius;
            free &= !slots.any(is_in);
            if free { limit } else { STOP }
        });
        free
    }

    /// Slot of the closest triangle. The search starts from `start`, and is faster the closer that is.
    ///
    /// The result does not depend on it, nor on the shape of the tree: every triangle whose computed distance could be
    /// least is visited, and the lowest index wins a tie.
    fn nearest(&self, p: &Point, start: u32) -> u32 {
        let distance_to = |slot: usize| closest_point_on_triangle(p, &self.corners[slot]).offset.norm_squared();
        let mut best = start;
        let mut least = distance_to(start as usize);
        self.bvh.visit_nearest(p, self.limit(least), |slots, limit| {
            let before = least;
            for slot in slots {
                let distance = distance_to(slot);
                let lower = || self.bvh.order()[slot] < self.bvh.order()[best as usize];
                if distance < least || (distance == least && lower()) {
                    (best, least) = (slot as u32, distance);
                }
            }
            if least < before { self.limit(least) } else { limit }
        });
        best
    }

    /// Squared distance of boxes that may contain a triangle at the computed squared distance `least`: a triangle's
    /// offset has rounding errors relative to its distance and its sides.
    fn limit(&self, least: f64) -> f64 {
        let distance = least.sqrt();
        let slack = 32.0 * f64::EPSILON * (distance + self.longest_side);
        (distance + slack).powi(2)
    }

    fn describe(&self, p: &Point, slot: u32) -> ClosestPoint {
        let corners = &self.corners[slot as usize];
        let closest = closest_point_on_triangle(p, corners);
        let [u, v, w] = closest.barycentric;
        let point = match closest.feature {
            Feature::Corner(k) => corners[k as usize],
            _ => Point::from(corners[0].coords * u + corners[1].coords * v + corners[2].coords * w),
        };
        ClosestPoint {
            point,
            triangle: self.bvh.order()[slot as usize] as usize,
            barycentric: closest.barycentric,
            feature: closest.feature,
            distance: closest.offset.norm(),
        }
    }

    /// Distance to the surface, negative inside, given the slot of the closest triangle.
    fn signed_distance_to(&self, p: &Point, slot: u32) -> f64 {
        let closest = closest_point_on_triangle(p, &self.corners[slot as usize]);
        let distance = closest.offset.norm();
        if distance == 0.0 || distance.is_nan() {
            return distance;
        }
        if self.is_inside(p, slot, &closest, distance) {
            -distance
        } else {
            distance
        }
    }

    fn is_inside(&self, p: &Point, slot: u32, closest: &TrianglePoint, distance: f64) -> bool {
        let Some(sides) = &self.sides else {
            return self.contains(p);
        };
        let normal = sides.at(slot as usize, closest.feature);
        let along = -normal.dot(&closest.offset);
        // Within rounding of the surface no method decides, and the dot product is as good as any.
        let on_surface = distance < 32.0 * f64::EPSILON * self.longest_side;
        if on_surface || along.abs() > DECISIVE * normal.norm() * distance {
            along < 0.0
        } else {
            self.contains(p)
        }
    }
}

/// The last few balls that do not touch the surface, and whether they are outside.
#[derive(Default)]
struct RecentBalls {
    balls: [(Point, f64, bool); REMEMBERED],
    next: usize,
}

/// Number of remembered balls: along the curve, few points have all their neighbours farther back.
const REMEMBERED: usize = 16;

impl RecentBalls {
    /// Whether a ball that does not touch the surface is outside: as a remembered one that it overlaps, or else by
    /// `find_out`.
    fn is_outside(&mut self, centre: &Point, radius: f64, find_out: impl FnOnce() -> bool) -> bool {
        // Balls that only touch might touch across the surface.
        let overlaps = |ball: &&(Point, f64, bool)| {
            let reach = (1.0 - 1e-6) * (ball.1 + radius);
            ball.1 > 0.0 && (ball.0 - centre).norm_squared() < reach * reach
        };
        let outside = self.balls.iter().find(overlaps).map_or_else(find_out, |ball| ball.2);
        self.balls[self.next] = (*centre, radius, outside);
        self.next = (self.next + 1) % REMEMBERED;
        outside
    }
}

impl Pseudonormals {
    /// `None` when the surface, coincident vertices taken as one, is not closed or not consistently oriented.
    fn new(mesh: &SurfaceMesh, order: &[u32]) -> Option<Self> {
        let welded = welded(mesh);
        let topology = Topology::new(&welded);
        let mut slot_of = vec![NONE; order.len()];
        for (slot, &triangle) in order.iter().enumerate() {
            slot_of[triangle as usize] = slot as u32;
        }
        let mut of_face: Vec<Vector> = order.iter().map(|&t| unit_normal(&mesh.corners(t as usize))).collect();
        let across = triangles_across(&topology, &slot_of, &of_face)?;
        let of_vertex = vertex_normals(&welded, &slot_of, &of_face, &across);
        // A triangle without any regular side is at best a wall between two parts that touch.
        for (normal, across) in of_face.iter_mut().zip(&across) {
            if across.iter().all(|&slot| slot == NONE) {
                *normal = Vector::zeros();
            }
        }
        let vertices = order.iter().map(|&t| welded.triangles()[t as usize]).collect();
        Some(Self {
            of_face,
            across,
            vertices,
            of_vertex,
        })
    }

    fn at(&self, slot: usize, feature: Feature) -> Vector {
        match feature {
            Feature::Face => self.of_face[slot],
            Feature::Edge(side) => match self.across[slot][side as usize] {
                NONE => Vector::zeros(),
                other => self.of_face[slot] + self.of_face[other as usize],
            },
            Feature::Corner(k) => self.of_vertex[self.vertices[slot][k as usize] as usize],
        }
    }
}

/// Indices of the points along Morton's curve through their box.
pub(crate) fn morton_order(points: &[Point]) -> Vec<u32> {
    let bounds = Aabb::around(points);
    let scale = bounds.extent().map(|e| f64::from(1 << 21) / e);
    let key = |p: &Point| {
        // NaN and infinite values, from boxes without extent, saturate.
        let at = (p - bounds.low)
            .component_mul(&scale)
            .map(|x| spread((x as u64).min((1 << 21) - 1)));
        at.x | at.y << 1 | at.z << 2
    };
    let keys: Vec<u64> = points.par_iter().map(key).collect();
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.par_sort_unstable_by_key(|&i| (keys[i as usize], i));
    order
}

/// Puts two zero bits between the 21 bits of `x`.
fn spread(mut x: u64) -> u64 {
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        x = (x | x << shift) & mask;
    }
    x
}

fn check_corners(mesh: &SurfaceMesh) -> Result<(), QueryError> {
    if mesh.triangles().is_empty() {
        return Err(QueryError::Empty);
    }
    let is_finite = |v: u32| mesh.vertices()[v as usize].coords.iter().all(|x| x.is_finite());
    for (triangle, corners) in mesh.triangles().iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&v| !is_finite(v)) {
            return Err(QueryError::NonFinite { vertex, triangle });
        }
    }
    Ok(())
}

fn longest_side_squared([a, b, c]: &[Point; 3]) -> f64 {
    let squares = [b - a, c - b, a - c].map(|side| side.norm_squared());
    squares.into_iter().fold(0.0, f64::max)
}

/// Zero for a thin triangle.
fn unit_normal([a, b, c]: &[Point; 3]) -> Vector {
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(&ac);
    if is_thin(normal.norm_squared(), &ab, &ac) {
        return Vector::zeros();
    }
    normal.normalize()
}

/// Slot of the triangle across each side, by slot; `None` unless as many triangles run along each edge one way as the
/// other.
fn triangles_across(topology: &Topology, slot_of: &[u32], of_face: &[Vector]) -> Option<Vec<[u32; 3]>> {
    let mut across = vec![[NONE; 3]; of_face.len()];
    for edge in 0..topology.edges().len() {
        let sides = topology.sides(edge);
        let forward = sides.iter().filter(|&&side| topology.runs_forward(side)).count();
        if 2 * forward != sides.len() {
            return None;
        }
        let &[first, second] = sides else { continue };
        let slots = [first, second].map(|side| slot_of[side.triangle as usize]);
        if slots.iter().all(|&slot| of_face[slot as usize] != Vector::zeros()) {
            across[slots[0] as usize][first.corner as usize] = slots[1];
            across[slots[1] as usize][second.corner as usize] = slots[0];
        }
    }
    Some(across)
}

/// Sums of the normals around each vertex, weighted by angle; zero where a side at the vertex has none `across`.
fn vertex_normals(mesh: &SurfaceMesh, slot_of: &[u32], of_face: &[Vector], across: &[[u32; 3]]) -> Vec<Vector> {
    let mut normals = vec![Vector::zeros(); mesh.vertices().len()];
    let mut uncertain = vec![false; mesh.vertices().len()];
    for (t, vertices) in mesh.triangles().iter().enumerate() {
        let slot = slot_of[t] as usize;
        let corners = mesh.corners(t);
        for k in 0..3 {
            let (a, b, c) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let vertex = vertices[k] as usize;
            normals[vertex] += of_face[slot] * (b - a).angle(&(c - a));
            uncertain[vertex] |= across[slot][k] == NONE || across[slot][(k + 2) % 3] == NONE;
        }
    }
    for (normal, _) in normals.iter_mut().zip(uncertain).filter(|(_, uncertain)| *uncertain) {
        *normal = Vector::zeros();
    }
    normals
}

#[cfg(test)]
mod tests;
