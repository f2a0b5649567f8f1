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
use crate::mesh::{SurfaceMesh, welded};
use crate::{Point, Vector};

/// Answers where the surface is closest, how far, and on which side, of any number of points.
///
/// The surface is to be oriented outward, cavities into the cavity, as [`crate::check::repair()`] makes it. Building
/// takes a fraction of a second per million triangles, a query near the surface microseconds. Copies what it needs of
/// the mesh; shared between threads as it is.
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
    /// The triangle it lies on; of several with exactly the same distance, the lowest.
    pub triangle: usize,
    /// Weights of the triangle's corners: not negative, with sum 1.
    pub barycentric: [f64; 3],
    /// Which part of the triangle it lies on.
    pub feature: Feature,
    /// How far it is; NaN when the query point has a NaN coordinate.
    pub distance: f64,
}

/// Why a surface cannot be queried.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QueryError {
    /// There is nothing to be close to.
    #[error("the surface has no triangles")]
    Empty,
    /// A corner is nowhere.
    #[error("vertex {vertex} of triangle {triangle} has an infinite or undefined coordinate; remove or repair it")]
    NonFinite {
        /// The vertex.
        vertex: u32,
        /// The lowest triangle that names it.
        triangle: usize,
    },
}

/// Directions off the surface, by slot. A zero stands where they do not decide.
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

/// Points of a batch that one task takes in turn, each starting from the closest triangle of the one before.
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

    /// Prepares queries on any surface, the winding number deciding everywhere what is inside: also right where parts
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

    /// Distance to the surface: negative inside, positive outside. Within rounding of the surface either sign comes
    /// out; NaN when the point has a NaN coordinate.
    pub fn signed_distance(&self, p: &Point) -> f64 {
        self.sign(p, self.nearest(p, self.slot_of_first_triangle))
    }

    /// Whether the point is inside: whether the surface winds about it more than half a time.
    ///
    /// Away from the surface this is several times faster than [`Self::signed_distance`]. Both agree on the surface of
    /// a solid; where parts overlap, or the surface has holes, this is the one to trust.
    pub fn contains(&self, p: &Point) -> bool {
        self.bounds().contains(p) && self.winding_number(p) > 0.5
    }

    /// The generalised winding number about `p` by expansions of far parts: off by a few hundredths at most, where an
    /// inside test can bear a half, in a time that grows with the logarithm of the number of triangles.
    pub fn winding_number(&self, p: &Point) -> f64 {
        self.far_field.winding_number(&self.bvh, &self.corners, p)
    }

    /// Whether each ball (centre and radius) lies outside the solid: no part of the surface is nearer to its centre than
    /// its radius, and the surface does not wind about it. Right also where parts of the surface overlap, however the
    /// query was made. `false` for balls without a finite centre. In parallel.
    ///
    /// Several times faster than the signed distances of the centres: the search ends with the first triangle in the
    /// ball, and balls that overlap are on the same side of the surface, so that in a crowd few need a winding number.
    pub fn are_outside(&self, balls: &[(Point, f64)]) -> Vec<bool> {
        let centres: Vec<Point> = balls.iter().map(|ball| ball.0).collect();
        self.each(&centres, RecentBalls::default, |i, known| {
            let (centre, radius) = balls[i];
            centre.coords.iter().all(|x| x.is_finite())
                && self.is_free(&centre, radius)
                && known.is_outside(&centre, radius, || !self.contains(&centre))
        })
    }

    /// [`Self::closest_point`] of each point, in parallel.
    pub fn closest_points(&self, points: &[Point]) -> Vec<ClosestPoint> {
        self.each(
            points,
            || self.slot_of_first_triangle,
            |i, slot| {
                *slot = self.nearest(&points[i], *slot);
                self.describe(&points[i], *slot)
            },
        )
    }

    /// [`Self::signed_distance`] of each point, in parallel.
    pub fn signed_distances(&self, points: &[Point]) -> Vec<f64> {
        self.each(
            points,
            || self.slot_of_first_triangle,
            |i, slot| {
                *slot = self.nearest(&points[i], *slot);
                self.sign(&points[i], *slot)
            },
        )
    }

    /// [`Self::contains`] of each point, in parallel.
    pub fn contains_all(&self, points: &[Point]) -> Vec<bool> {
        self.each(points, || (), |i, _| self.contains(&points[i]))
    }

    /// Answers along a space-filling curve: neighbours read the same part of the tree, and what is known of one, such as
    /// its closest triangle, is a good start for the next. `answer` gets the index of a point and what the one before
    /// it left; `begin` makes that for the first of a run.
    fn each<K, T: Send>(
        &self,
        points: &[Point],
        begin: impl Fn() -> K + Sync,
        answer: impl Fn(usize, &mut K) -> T + Sync,
    ) -> Vec<T> {
        let order = morton_order(points);
        let runs = order.par_chunks(RUN).flat_map_iter(|run| {
            let mut known = begin();
            let answer = &answer;
            run.iter().map(move |&i| (i, answer(i as usize, &mut known)))
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

    /// Slot of the closest triangle. `start` is tried first: the closer it is, the faster.
    ///
    /// The answer does not depend on it, nor on the shape of the tree: every triangle whose distance as computed could
    /// be least is visited, and the lowest index wins a tie.
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

    /// Squared distance of the boxes that may hold a triangle at squared distance `least` as computed: a triangle's
    /// offset is off by a few roundings of its distance and its sides.
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

    fn sign(&self, p: &Point, slot: u32) -> f64 {
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
        // As close as rounding, no method decides, and the dot product is as good a guess as any.
        let on_surface = distance < 32.0 * f64::EPSILON * self.longest_side;
        if on_surface || along.abs() > DECISIVE * normal.norm() * distance {
            along < 0.0
        } else {
            self.contains(p)
        }
    }
}

/// The last few balls that were found free of the surface, and whether they are outside.
#[derive(Default)]
struct RecentBalls {
    balls: [(Point, f64, bool); REMEMBERED],
    next: usize,
}

/// Balls remembered: along the curve, few points have all their neighbours farther back than this.
const REMEMBERED: usize = 16;

impl RecentBalls {
    /// Whether a ball free of the surface is outside: as a known one that it overlaps, else as `find_out` says.
    fn is_outside(&mut self, centre: &Point, radius: f64, find_out: impl FnOnce() -> bool) -> bool {
        // Balls that only touch might do so through the surface.
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
        // Without one plain side, a triangle is at best a wall between two parts that touch.
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
        // NaN and what is infinite for want of an extent saturate.
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
    (b - a)
        .norm_squared()
        .max((c - b).norm_squared())
        .max((a - c).norm_squared())
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

/// Slot of the triangle across each side, by slot; `None` when as many triangles do not run along each edge one way as
/// the other.
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

/// Sums of the normals around each vertex, weighted by angle; zero where one of the triangles is thin.
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
mod tests {

    use nalgebra::{Rotation3, Unit};
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::geometry::{test_models, winding_number};
    use crate::mesh::shapes;

    const SEED: u64 = 23;

    /// An inscribed mesh with sides `h` lies within `h² / 8r` of a surface with radius of curvature `r`, twice that
    /// where it is curved both ways; the distances to both differ no more.
    #[test]
    fn distances_are_those_to_the_sphere_and_the_torus() {
        let (major, minor) = (1.0, 0.3);
        let to_torus = |p: &Point| (p.x.hypot(p.y) - major).hypot(p.z) - minor;
        let to_sphere = |p: &Point| p.coords.norm() - 1.0;
        let torus = shapes::torus(major, minor, 200, 60);
        let sphere = shapes::sphere(1.0, 5);
        for (mesh, exact, radius) in [
            (&torus, &to_torus as &dyn Fn(&Point) -> f64, minor),
            (&sphere, &to_sphere, 1.0),
        ] {
            let query = SurfaceQuery::new(mesh).unwrap();
            let bound = 2.0 * query.longest_side.powi(2) / (8.0 * radius);
            for p in points_about(&query.bounds(), 0.5, 2000) {
                let signed = query.signed_distance(&p);
                assert!((signed - exact(&p)).abs() < bound, "{signed} at {p}");
            }
        }
    }

    #[test]
    fn the_tree_finds_exactly_what_a_search_of_all_triangles_finds() {
        for (seed, mesh) in [
            (1, random_soup(1, 300)),
            (2, random_soup(2, 7)),
            (3, shapes::double_torus(3)),
        ] {
            let query = SurfaceQuery::new(&mesh).unwrap();
            let mut random = StdRng::seed_from_u64(seed);
            for p in points_about(&query.bounds(), 1.0, 1000) {
                let all = (0..mesh.triangles().len())
                    .map(|t| closest_point_on_triangle(&p, &mesh.corners(t)).offset.norm_squared());
                let (triangle, least) = all.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
                let closest = query.closest_point(&p);
                assert_eq!((closest.triangle, closest.distance), (triangle, least.sqrt()));
                assert!(((closest.point - p).norm() - closest.distance).abs() < 1e-14);
                // Nor does it matter where the search starts.
                let start = random.random_range(0..mesh.triangles().len() as u32);
                assert_eq!(query.describe(&p, query.nearest(&p, start)), closest);
            }
        }
    }

    #[test]
    fn the_sign_is_that_of_the_exact_winding_number() {
        let near = shapes::deformed(&shapes::cube(1.0, 2), |p| p + Vector::new(1.0 + 1e-3, 0.0, 0.0));
        for (mesh, count) in [
            (shapes::cube(1.0, 1), 10_000),
            (shapes::double_torus(2), 10_000),
            (shapes::spherical_shell(1.0, 0.9, 2), 10_000),
            (shapes::joined(&shapes::cube(1.0, 2), &near), 10_000),
            (knife(1e-3), 10_000),
            (star(), 10_000),
        ] {
            assert_signs_agree(&mesh, count);
        }
    }

    #[test]
    fn the_sign_is_right_on_scanned_models() {
        for name in [
            "surfaces/kitten_g1_9k.obj",
            "surfaces/three_holes_g3_uv_2k.obj",
            "surfaces/goathead_2k8.obj",
        ] {
            let Some(mesh) = test_models::load(name) else { return };
            assert_signs_agree(&mesh, 300);
        }
    }

    /// Thin triangles, doubled vertices and pinches leave pseudonormals undecided; the winding number steps in.
    #[test]
    fn the_sign_survives_thin_triangles_doubled_vertices_and_touching_parts() {
        let cube = shapes::cube(1.0, 2);
        let soup = {
            let corners = (0..cube.triangles().len()).flat_map(|t| cube.corners(t)).collect();
            let triangles = (0..cube.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
            SurfaceMesh::new(corners, triangles.collect()).unwrap()
        };
        let shifted = |x, y| shapes::deformed(&cube, |p| p + Vector::new(x, y, 0.0));
        let wall = shapes::joined(&cube, &shifted(1.0, 0.0));
        let edge = shapes::joined(&cube, &shifted(1.0, 1.0));
        for mesh in [
            with_a_thin_triangle(&cube),
            with_a_thin_triangle(&tetrahedron()),
            soup,
            wall,
            edge,
        ] {
            assert_signs_agree(&mesh, 4000);
        }
    }

    #[test]
    fn the_winding_sign_holds_where_balls_overlap() {
        let ball = shapes::sphere(1.0, 3);
        let other = shapes::deformed(&ball, |p| p + Vector::new(1.2, 0.0, 0.0));
        let query = SurfaceQuery::with_winding_sign(&shapes::joined(&ball, &other)).unwrap();
        for p in points_about(&query.bounds(), 0.1, 3000) {
            let (a, b) = (p.coords.norm(), (p - Point::new(1.2, 0.0, 0.0)).norm());
            // Where the inscribed mesh and the ball agree: sides of 0.16 leave 0.16² / 4.
            if (a - 1.0).abs() > 0.01 && (b - 1.0).abs() > 0.01 {
                assert_eq!(query.contains(&p), a < 1.0 || b < 1.0, "{p}");
                assert_eq!(query.signed_distance(&p) < 0.0, a < 1.0 || b < 1.0, "{p}");
            }
        }
    }

    #[test]
    fn points_on_corners_and_edges_are_at_no_distance() {
        let mesh = shapes::double_torus(2);
        let query = SurfaceQuery::new(&mesh).unwrap();
        for (t, triangle) in mesh.triangles().iter().enumerate() {
            let [a, b, _] = mesh.corners(t);
            let closest = query.closest_point(&a);
            assert_eq!((closest.point, closest.distance), (a, 0.0));
            let Feature::Corner(k) = closest.feature else {
                panic!("{closest:?}")
            };
            assert_eq!(mesh.triangles()[closest.triangle][k as usize], triangle[0]);
            assert_eq!(query.signed_distance(&a), 0.0);
            let middle = nalgebra::center(&a, &b);
            assert!(query.signed_distance(&middle).abs() < 1e-15);
        }
    }

    #[test]
    fn batches_give_what_single_queries_give() {
        let mesh = shapes::torus(1.0, 0.4, 50, 30);
        let query = SurfaceQuery::new(&mesh).unwrap();
        let points = points_about(&query.bounds(), 0.2, 3000);
        let signed: Vec<f64> = points.iter().map(|p| query.signed_distance(p)).collect();
        assert_eq!(query.signed_distances(&points), signed);
        assert_eq!(
            query.contains_all(&points),
            signed.iter().map(|d| *d < 0.0).collect::<Vec<_>>()
        );
        assert_eq!(
            query.contains_all(&points),
            points.iter().map(|p| query.contains(p)).collect::<Vec<_>>()
        );
        let closest: Vec<_> = points.iter().map(|p| query.closest_point(p)).collect();
        assert_eq!(query.closest_points(&points), closest);
    }

    #[test]
    fn an_open_surface_still_tells_inside_by_how_much_it_winds() {
        let whole = shapes::sphere(1.0, 3);
        let most = whole.triangles()[10..].to_vec();
        let open = SurfaceMesh::new(whole.vertices().to_vec(), most).unwrap();
        let query = SurfaceQuery::new(&open).unwrap();
        assert!(query.sides.is_none());
        for p in points_about(&query.bounds(), 0.2, 2000)
            .iter()
            .filter(|p| (p.coords.norm() - 1.0).abs() > 0.3)
        {
            assert_eq!(query.contains(p), p.coords.norm() < 1.0);
        }
    }

    #[test]
    fn points_that_are_not_finite_and_huge_surfaces_do_no_harm() {
        let query = SurfaceQuery::new(&shapes::cube(1.0, 1)).unwrap();
        let nan = Point::new(f64::NAN, 0.0, 0.0);
        assert!(query.signed_distance(&nan).is_nan() && query.closest_point(&nan).distance.is_nan());
        assert!(!query.contains(&nan));
        let far = Point::new(0.0, f64::INFINITY, 0.0);
        assert_eq!(query.signed_distance(&far), f64::INFINITY);
        assert!(!query.contains(&far));
        for size in [1e-200, 1e200, f64::MAX] {
            let query = SurfaceQuery::new(&shapes::cube(size, 2)).unwrap();
            let _ = (
                query.signed_distance(&Point::origin()),
                query.contains(&Point::new(size, 0.0, 0.0)),
            );
        }
    }

    /// Two balls that overlap, apart from a third, and a shell: what the union of the balls and the cavity say.
    #[test]
    fn balls_are_outside_when_clear_of_the_surface_and_not_wound_about() {
        let moved = |x: f64| shapes::deformed(&shapes::sphere(1.0, 4), |p| p + Vector::x() * x);
        let mesh = shapes::joined(&shapes::joined(&moved(0.0), &moved(1.2)), &moved(4.0));
        let shell = shapes::deformed(&shapes::spherical_shell(1.0, 0.5, 4), |p| p - Vector::x() * 4.0);
        let query = SurfaceQuery::new(&shapes::joined(&mesh, &shell)).unwrap();
        let mut random = StdRng::seed_from_u64(SEED);
        let points = points_about(&query.bounds(), 0.1, 20_000);
        let balls: Vec<(Point, f64)> = points.iter().map(|&p| (p, random.random_range(0.01..0.3))).collect();
        let (mut inside, mut blocked, mut outside) = (0, 0, 0);
        for (&(p, radius), found) in balls.iter().zip(query.are_outside(&balls)) {
            // The meshes lie within 0.002 of their spheres.
            let gaps = [0.0, 1.2, 4.0, -4.0].map(|x| ((p - Point::new(x, 0.0, 0.0)).norm(), 1.0));
            let in_cavity = gaps[3].0 < 0.5;
            let clearance = gaps
                .iter()
                .map(|(d, r)| (d - r).abs())
                .fold((gaps[3].0 - 0.5).abs(), f64::min);
            if (clearance - radius).abs() < 0.005 {
                continue;
            }
            let within = gaps.iter().any(|(d, r)| d < r) && !in_cavity;
            assert_eq!(found, !within && clearance > radius, "{p} {radius}");
            inside += usize::from(within && clearance > radius);
            blocked += usize::from(clearance < radius);
            outside += usize::from(found);
        }
        assert!(
            inside > 500 && blocked > 500 && outside > 500,
            "{inside} {blocked} {outside}"
        );
        let nowhere = [
            (Point::new(f64::NAN, 0.0, 0.0), 0.1),
            (Point::new(f64::INFINITY, 0.0, 0.0), 0.1),
        ];
        assert_eq!(query.are_outside(&nowhere), [false; 2]);
    }

    #[test]
    fn refuses_surfaces_without_triangles_or_with_corners_nowhere() {
        assert_eq!(
            SurfaceQuery::new(&SurfaceMesh::default()).unwrap_err(),
            QueryError::Empty
        );
        let mut mesh = shapes::cube(1.0, 1);
        let vertex = mesh.triangles()[5][1];
        let triangle = mesh.triangles().iter().position(|t| t.contains(&vertex)).unwrap();
        let mut vertices = mesh.vertices().to_vec();
        vertices[vertex as usize].y = f64::NAN;
        mesh = mesh.with_vertices(vertices).unwrap();
        assert_eq!(
            SurfaceQuery::new(&mesh).unwrap_err(),
            QueryError::NonFinite { vertex, triangle }
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

        /// Coordinates stay below 40, so that rounding leaves 1e-14 times a few tens.
        #[test]
        fn distances_turn_move_and_grow_with_the_surface(
            axis in prop::array::uniform3(-1.0..1.0f64), angle in 0.0..6.0f64,
            shift in prop::array::uniform3(-9.0..9.0f64), scale in 0.1..10.0f64,
        ) {
            let turn = Rotation3::from_axis_angle(&Unit::new_normalize(Vector::from(axis)), angle);
            let moved = |p: &Point| Point::from((turn * p).coords * scale + Vector::from(shift));
            let mesh = shapes::double_torus(1);
            let query = SurfaceQuery::new(&mesh).unwrap();
            let other = SurfaceQuery::new(&shapes::deformed(&mesh, moved)).unwrap();
            for p in points_about(&query.bounds(), 0.3, 100) {
                let (here, there) = (query.signed_distance(&p) * scale, other.signed_distance(&moved(&p)));
                prop_assert!((here - there).abs() < 1e-12);
            }
        }
    }

    fn assert_signs_agree(mesh: &SurfaceMesh, count: usize) {
        let query = SurfaceQuery::new(mesh).unwrap();
        assert!(query.sides.is_some());
        for p in points_about(&query.bounds(), 0.1, count) {
            let exact = winding_number(mesh, &p);
            assert!((exact - exact.round()).abs() < 1e-9, "{p} is on the surface");
            let fast = query.winding_number(&p);
            assert!((fast - exact).abs() < 0.1, "{fast} for {exact} at {p}");
            let signed = query.signed_distance(&p);
            assert_eq!(signed < 0.0, exact > 0.5, "{signed} for {exact} at {p}");
            assert_eq!(query.contains(&p), exact > 0.5, "{p}");
        }
    }

    /// In a box this much larger on each side, by the size of the smaller one.
    fn points_about(bounds: &Aabb, beyond: f64, count: usize) -> Vec<Point> {
        let mut random = StdRng::seed_from_u64(SEED);
        let mut coordinate = |e: f64| e * random.random_range(-beyond..1.0 + beyond);
        (0..count)
            .map(|_| bounds.low + bounds.extent().map(&mut coordinate))
            .collect()
    }

    fn random_soup(seed: u64, triangles: u32) -> SurfaceMesh {
        let mut random = StdRng::seed_from_u64(seed);
        let mut vector = |size: f64| Vector::from_fn(|_, _| random.random_range(-size..size));
        let vertices = (0..triangles)
            .flat_map(|_| {
                let centre = Point::from(vector(1.0));
                [0.2, 0.01, 0.3].map(|size| centre + vector(size))
            })
            .collect();
        SurfaceMesh::new(
            vertices,
            (0..triangles).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        )
        .unwrap()
    }

    /// A wedge with an edge as sharp as `thickness`, next to it all normals are almost opposite.
    fn knife(thickness: f64) -> SurfaceMesh {
        shapes::deformed(&shapes::cube(2.0, 1), |p| {
            Point::new(p.x, p.y, p.z * if p.x > 0.0 { thickness / 9.0 } else { thickness })
        })
    }

    /// All edges sharper than a right angle.
    fn tetrahedron() -> SurfaceMesh {
        let vertices = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Point::from);
        SurfaceMesh::new(vertices.to_vec(), vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]).unwrap()
    }

    /// A ball with spikes and pits: corners where the surface is neither convex nor concave.
    fn star() -> SurfaceMesh {
        let mut random = StdRng::seed_from_u64(SEED);
        let ball = shapes::sphere(1.0, 2);
        let vertices = ball
            .vertices()
            .iter()
            .map(|p| p * random.random_range(0.2..1.0))
            .collect();
        ball.with_vertices(vertices).unwrap()
    }

    /// One edge is split on one side only; a triangle without area fills the slit.
    fn with_a_thin_triangle(mesh: &SurfaceMesh) -> SurfaceMesh {
        let (mut vertices, mut triangles) = mesh.clone().into_parts();
        let [a, b, c] = triangles[0];
        let middle = vertices.len() as u32;
        vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
        triangles[0] = [a, middle, c];
        triangles.extend([[middle, b, c], [a, b, middle]]);
        SurfaceMesh::new(vertices, triangles).unwrap()
    }
}
