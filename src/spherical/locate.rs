//! The inverse of a spherical embedding: the triangle that covers a direction, and the point in it.
//!
//! A direction `x` in the geodesic triangle of the unit vectors `a`, `b`, `c` is `m₀ a + m₁ b + m₂ c` up to length,
//! with `m₀ = det(x, b, c)` and so on by Cramer's rule. [`SphericalEmbedding::direction`] normalises
//! `l₀ a + l₁ b + l₂ c`, so that `l = m / Σm` are the barycentric coordinates that it came from: the gnomonic ones.
//! Determinants are those of `b − x` and `c − x`, which are the same but do not cancel in small triangles.

use rayon::prelude::*;

use super::SphericalEmbedding;
use super::spherical_embedding::unit;
use crate::geometry::{Aabb, Bvh};
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::{Point, Vector};

/// Evaluates the inverse of a [`SphericalEmbedding`]. Construction takes some 300 bytes and 0.7 µs per triangle.
///
/// Every direction has a point: where rounding leaves several triangles or none, it is in the triangle where the
/// smallest barycentric coordinate is largest, of equals in the first. The direction of a vertex, bit for bit, gives
/// exactly that vertex.
#[derive(Debug, Clone)]
pub struct Locator {
    tree: Bvh,
    /// In the order of the tree's leaves.
    triangles: Vec<Triangle>,
    /// Index in `triangles` of each triangle of the surface.
    leaf_of_triangle: Vec<u32>,
}

#[derive(Debug, Clone)]
struct Triangle {
    corners: [Vector; 3],
    /// Normals of the sides opposite to the corners, such that `m` are their products with a direction.
    normals: [Vector; 3],
    /// A bound above the rounding errors of these products.
    noise: f64,
    /// Indices of the triangles across the sides opposite to the corners, or `u32::MAX`.
    neighbours: [u32; 3],
    /// Index in the surface.
    index: u32,
}

/// The determinants `m` of a direction and a triangle.
struct EdgeDeterminants {
    m: [f64; 3],
    /// A bound above the rounding errors of `m`.
    noise: f64,
    /// The corner that has the direction, bit for bit.
    corner: Option<usize>,
}

/// Rounding errors of a determinant `x · (p × q)`, as a fraction of the larger of `|p|²` and `|q|²`: several times
/// those of its ten or so roundings.
const NOISE: f64 = 64.0 * f64::EPSILON;
/// Boxes are enlarged by this for rounding errors of directions.
const MARGIN: f64 = 64.0 * f64::EPSILON;
/// Triangles to walk through from a hint; a search from scratch is faster than a longer walk.
pub(crate) const MAX_WALK: usize = 48;
/// Directions that are located one after the other.
const CHUNK: usize = 256;

impl Locator {
    /// The inverse of an embedding.
    pub fn new(map: &SphericalEmbedding) -> Self {
        Self::of_directions(map.surface(), map.directions())
    }

    /// Prepares the search in a closed surface with these directions, whose triangles must all be positive.
    pub(crate) fn of_directions(surface: &SurfaceMesh, directions: &[Vector]) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| directions[v as usize]);
        let triangles = surface.triangles().par_iter();
        let boxes: Vec<Aabb> = triangles.map(|t| geodesic_box(&corners(t))).collect();
        let topology = Topology::new(surface);
        let across = |t: u32, side: usize| {
            let edges = topology.edges_of_triangle(t as usize).expect("three vertices");
            let mut sides = topology.sides(edges[side] as usize).iter();
            let other = sides.find(|side| side.triangle != t).expect("a closed surface");
            other.triangle
        };
        let corners = |t: u32| corners(&surface.triangles()[t as usize]);
        Self::of_corners(&boxes, corners, across)
    }

    /// Prepares the search among positive triangles with these boxes and corners; `across` gives the triangle beyond the
    /// side from corner `k` to the next, `u32::MAX` where there is none.
    pub(crate) fn of_corners(
        boxes: &[Aabb],
        corners: impl Fn(u32) -> [Vector; 3] + Sync,
        across: impl Fn(u32, usize) -> u32 + Sync,
    ) -> Self {
        let tree = Bvh::new(boxes);
        let mut leaf_of_triangle = vec![0; boxes.len()];
        for (place, &t) in tree.order().iter().enumerate() {
            leaf_of_triangle[t as usize] = place as u32;
        }
        let leaf = |t: u32| leaf_of_triangle.get(t as usize).copied().unwrap_or(u32::MAX);
        let triangle = |&t: &u32| {
            let corners = corners(t);
            let [a, b, c] = corners;
            let normals = [b.cross(&(c - b)), c.cross(&(a - c)), a.cross(&(b - a))];
            Triangle {
                corners,
                normals,
                noise: NOISE * normals.iter().map(Vector::norm).fold(0.0, f64::max),
                // Side `k` runs from corner `k` to the next, opposite to the one before.
                neighbours: [1, 2, 0].map(|side| leaf(across(t, side))),
                index: t,
            }
        };
        let triangles = tree.order().par_iter().map(triangle).collect();
        Self {
            tree,
            triangles,
            leaf_of_triangle,
        }
    }

    /// The point that has a direction, given by a vector of any positive length. Some 1 µs with 60 000 triangles.
    ///
    /// For a vector of length 0 or not finite, barycentric coordinates are NaN.
    pub fn locate(&self, direction: &Vector) -> SurfacePoint {
        unit_of(direction).map_or(NOWHERE, |x| self.search(&x))
    }

    /// The same as [`Self::locate`], several times faster when the point is in the triangle `hint` or near it.
    pub fn locate_from(&self, direction: &Vector, hint: u32) -> SurfacePoint {
        let Some(x) = unit_of(direction) else {
            return NOWHERE;
        };
        self.walk(&x, hint, MAX_WALK).unwrap_or_else(|| self.search(&x))
    }

    /// [`Self::locate`] for each direction, in parallel.
    pub fn locate_all(&self, directions: &[Vector]) -> Vec<SurfacePoint> {
        let directions = directions.par_iter().with_min_len(256);
        directions.map(|x| self.locate(x)).collect()
    }

    /// The triangles of directions of which each is near the next: then faster than [`Self::locate_all`].
    pub(crate) fn triangles_along(&self, directions: &[Vector]) -> Vec<u32> {
        let of_chunk = |chunk: &[Vector]| {
            let mut hint = u32::MAX;
            let mut of_next = |x: &Vector| {
                hint = self.locate_from(x, hint).triangle;
                hint
            };
            chunk.iter().map(&mut of_next).collect::<Vec<u32>>()
        };
        directions.par_chunks(CHUNK).flat_map_iter(of_chunk).collect()
    }

    /// `None` when the walk is longer than `most` or the point is on an edge up to rounding.
    pub(crate) fn walk(&self, x: &Vector, hint: u32, most: usize) -> Option<SurfacePoint> {
        let mut at = *self.leaf_of_triangle.get(hint as usize)?;
        for _ in 0..most {
            let triangle = self.triangles.get(at as usize)?;
            let products = triangle.normals.map(|normal| normal.dot(x));
            let farthest = if products[1] < products[0] { 1 } else { 0 };
            let farthest = if products[2] < products[farthest] { 2 } else { farthest };
            if products[farthest] < -triangle.noise {
                at = triangle.neighbours[farthest];
                continue;
            }
            let weights = triangle.weights(x);
            if weights.are_inside() {
                return Some(triangle.point(&weights, x));
            }
            let farthest = (0..3).min_by(|&i, &j| weights.m[i].total_cmp(&weights.m[j]))?;
            if weights.m[farthest] > -weights.noise {
                return None;
            }
            at = triangle.neighbours[farthest];
        }
        None
    }

    /// The point at `x`, from the triangle whose smallest barycentric coordinate there is largest.
    pub(crate) fn search(&self, x: &Vector) -> SurfacePoint {
        let mut best: Option<(f64, &Triangle, EdgeDeterminants)> = None;
        self.tree.visit_nearest(&Point::from(*x), 0.0, |leaf, limit| {
            for triangle in &self.triangles[leaf] {
                let weights = triangle.weights(x);
                if weights.are_inside() {
                    best = Some((f64::INFINITY, triangle, weights));
                    // A negative limit ends the search.
                    return -1.0;
                }
                let rating = weights.rating();
                let is_better = best.as_ref().is_none_or(|(highest, first, _)| {
                    rating > *highest || (rating == *highest && triangle.index < first.index)
                });
                if is_better {
                    best = Some((rating, triangle, weights));
                }
            }
            limit
        });
        best.map_or(NOWHERE, |(_, triangle, weights)| triangle.point(&weights, x))
    }
}

const NOWHERE: SurfacePoint = SurfacePoint {
    triangle: 0,
    barycentric: [f64::NAN; 3],
};

fn unit_of(direction: &Vector) -> Option<Vector> {
    let size = direction.amax();
    let is_usable = size > 0.0 && direction.iter().all(|c| c.is_finite());
    // A vector of about length 1 is not scaled, so that it keeps the bits that it may share with a vertex.
    let scale = if (0.5..2.0).contains(&size) { 1.0 } else { size };
    is_usable.then(|| unit(&(direction / scale)))
}

/// A box around a geodesic triangle of unit vectors.
///
/// A point `p = Σ l a` of the flat triangle has `|p|² = 1 − Σ l_i l_j |a_i − a_j|²`, and the products add up to a third
/// at most. The geodesic triangle is above it by no more than `1 − |p|`.
fn geodesic_box(corners: &[Vector; 3]) -> Aabb {
    let [a, b, c] = corners;
    let squares = [a - b, b - c, c - a].map(|side| side.norm_squared());
    let longest = squares.into_iter().fold(0.0, f64::max);
    let bulge = Vector::repeat(1.0 - (1.0 - longest / 3.0).max(0.0).sqrt() + MARGIN);
    let flat = Aabb::around(&corners.map(Point::from));
    Aabb {
        low: flat.low - bulge,
        high: flat.high + bulge,
    }
}

impl Triangle {
    #[inline]
    fn weights(&self, x: &Vector) -> EdgeDeterminants {
        let [a, b, c] = self.corners.map(|corner| corner - x);
        let squares = [a, b, c].map(|d| d.norm_squared());
        EdgeDeterminants {
            m: [x.dot(&b.cross(&c)), x.dot(&c.cross(&a)), x.dot(&a.cross(&b))],
            noise: NOISE * squares[0].max(squares[1]).max(squares[2]),
            corner: squares.iter().position(|&square| square == 0.0),
        }
    }

    fn point(&self, weights: &EdgeDeterminants, x: &Vector) -> SurfacePoint {
        if let Some(corner) = weights.corner {
            return SurfacePoint::corner(self.index, corner);
        }
        let l = self.refined(weights, x);
        let least = (0..3).min_by(|&i, &j| l[i].total_cmp(&l[j])).unwrap_or(0);
        let barycentric = if !l.iter().all(|l| l.is_finite()) {
            self.on_side(self.corner_opposite_longest_side(), x)
        } else if l[least] < 0.0 {
            self.on_side(least, x)
        } else {
            l.map(|weight| weight / (l[0] + l[1] + l[2]))
        };
        SurfacePoint {
            triangle: self.index,
            barycentric,
        }
    }

    /// Coefficients `l` such that `l₀ a + l₁ b + l₂ c` is the direction. One step of iterative refinement: in thin
    /// triangles rounding errors of the determinants would move the point.
    fn refined(&self, weights: &EdgeDeterminants, x: &Vector) -> [f64; 3] {
        let [a, b, c] = &self.corners;
        let [l, m, n] = weights.m;
        let scale = l * a.dot(x) + m * b.dot(x) + n * c.dot(x);
        let [l, m, n] = [l, m, n].map(|weight| weight / scale);
        let residual = x - (l * a + m * b + n * c);
        let determinant = a.dot(&(b - a).cross(&(c - a)));
        let correction = |p: &Vector, q: &Vector| residual.dot(&p.cross(&(q - p))) / determinant;
        [l + correction(b, c), m + correction(c, a), n + correction(a, b)]
    }

    /// Barycentric coordinates of the point closest to a direction on the side opposite to a corner.
    fn on_side(&self, corner: usize, x: &Vector) -> [f64; 3] {
        let (i, j) = ((corner + 1) % 3, (corner + 2) % 3);
        let (p, q) = (&self.corners[i], &self.corners[j]);
        let normal = p.cross(&(q - p));
        let to_p = normal.dot(&x.cross(&(q - x))).max(0.0);
        let to_q = normal.dot(&(p - x).cross(x)).max(0.0);
        let mut barycentric = [0.0; 3];
        barycentric[i] = if to_p + to_q > 0.0 { to_p / (to_p + to_q) } else { 1.0 };
        barycentric[j] = 1.0 - barycentric[i];
        barycentric
    }

    /// The corner opposite to the longest side.
    fn corner_opposite_longest_side(&self) -> usize {
        let length = |k: usize| (self.corners[(k + 1) % 3] - self.corners[(k + 2) % 3]).norm_squared();
        (0..3).max_by(|&i, &j| length(i).total_cmp(&length(j))).unwrap_or(0)
    }
}

impl EdgeDeterminants {
    /// Whether the direction is inside the triangle, beyond rounding errors: then it is in no other.
    #[inline]
    fn are_inside(&self) -> bool {
        self.m.iter().all(|&m| m > self.noise)
    }

    /// The least determinant, normalised: negative outside, −1/3 and less on the other side of the sphere.
    fn rating(&self) -> f64 {
        let sum: f64 = self.m.iter().map(|m| m.abs()).sum();
        let least = self.m.iter().copied().fold(f64::INFINITY, f64::min);
        match self.corner {
            Some(_) => f64::INFINITY,
            None if sum > 0.0 => least / sum,
            None => -1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::super::testing::{graded_spindle, radial_embedding};
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};

    const SEED: u64 = 11;

    fn solid_of(corners: &[[f64; 3]], triangles: &[[u32; 3]]) -> SphericalEmbedding {
        let vertices = corners.iter().map(|&p| Point::from(p)).collect();
        radial_embedding(SurfaceMesh::new(vertices, triangles.to_vec()).unwrap())
    }

    fn tetrahedron() -> SphericalEmbedding {
        solid_of(
            &[[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]],
            &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]],
        )
    }

    fn octahedron() -> SphericalEmbedding {
        solid_of(
            &[
                [1., 0., 0.],
                [-1., 0., 0.],
                [0., 1., 0.],
                [0., -1., 0.],
                [0., 0., 1.],
                [0., 0., -1.],
            ],
            &[
                [0, 2, 4],
                [2, 1, 4],
                [1, 3, 4],
                [3, 0, 4],
                [2, 0, 5],
                [1, 2, 5],
                [3, 1, 5],
                [0, 3, 5],
            ],
        )
    }

    /// Two rings a hundred-millionth apart: triangles of aspect 5e7.
    fn with_needles() -> SphericalEmbedding {
        let mut map = graded_spindle(1.0, 12);
        let mut directions = map.directions().to_vec();
        for j in 1..=12 {
            directions[j] = (directions[j + 12] - 1e-8 * Vector::z()).normalize();
        }
        map = SphericalEmbedding::new(map.surface().clone(), &directions).unwrap();
        map
    }

    fn maps() -> Vec<(&'static str, SphericalEmbedding)> {
        vec![
            ("tetrahedron", tetrahedron()),
            ("octahedron", octahedron()),
            ("bumpy", radial_embedding(shapes::bumpy_sphere(12))),
            ("cube", radial_embedding(shapes::cube(1.0, 6))),
            ("graded", graded_spindle(6.0, 10)),
            ("needles", with_needles()),
        ]
    }

    fn random_directions(count: usize) -> Vec<Vector> {
        let mut random = StdRng::seed_from_u64(SEED);
        let mut number = || random.random_range(-1.0..1.0);
        (0..count)
            .map(|_| Vector::from_fn(|_, _| number()).normalize())
            .collect()
    }

    /// Inside of the triangles, on their sides, and a few roundings off.
    fn awkward_directions(map: &SphericalEmbedding) -> Vec<Vector> {
        let mut random = StdRng::seed_from_u64(SEED);
        let mut directions = Vec::new();
        for triangle in 0..map.surface().triangles().len() as u32 {
            let mut weights: [f64; 3] = std::array::from_fn(|_| random.random_range(0.0..1.0));
            directions.push(map.direction(&SurfacePoint {
                triangle,
                barycentric: weights,
            }));
            weights[triangle as usize % 3] = 0.0;
            let on_side = map.direction(&SurfacePoint {
                triangle,
                barycentric: weights,
            });
            let mut nudge = || Vector::from_fn(|_, _| random.random_range(-3.0..3.0)) * f64::EPSILON;
            directions.extend([on_side, on_side + nudge(), on_side + nudge()]);
            let corner = map.directions()[map.surface().triangles()[triangle as usize][0] as usize];
            directions.extend([corner, corner + nudge(), corner * 1.5]);
        }
        directions
    }

    #[test]
    fn the_point_found_has_the_direction_asked_for() {
        for (name, map) in maps() {
            let locator = Locator::new(&map);
            for x in random_directions(3000).into_iter().chain(awkward_directions(&map)) {
                let point = locator.locate(&x);
                let [l, m, n] = point.barycentric;
                assert!(
                    l >= 0.0 && m >= 0.0 && n >= 0.0 && (l + m + n - 1.0).abs() < 1e-15,
                    "{name}"
                );
                let off = (map.direction(&point) - x.normalize()).norm();
                assert!(off < 32.0 * f64::EPSILON, "{name}: {off:e} at {x:?}, {point:?}");
            }
        }
    }

    /// A rounding error of the direction moves barycentric coordinates by as much over the height of the triangle.
    #[test]
    fn undoes_the_direction_of_a_point() {
        let mut random = StdRng::seed_from_u64(SEED);
        for (name, map) in maps() {
            let locator = Locator::new(&map);
            for (t, corners) in map.surface().triangles().iter().enumerate() {
                let weights: [f64; 3] = std::array::from_fn(|_| random.random_range(0.2..1.0));
                let barycentric = weights.map(|w| w / weights.iter().sum::<f64>());
                let point = SurfacePoint {
                    triangle: t as u32,
                    barycentric,
                };
                let found = locator.locate(&map.direction(&point));
                assert_eq!(found.triangle, point.triangle, "{name}");
                let [a, b, c] = corners.map(|v| map.directions()[v as usize]);
                let longest = (a - b).norm().max((b - c).norm()).max((c - a).norm());
                let height = (b - a).cross(&(c - a)).norm() / longest;
                for (l, m) in barycentric.iter().zip(found.barycentric) {
                    assert!(
                        (l - m).abs() < 16.0 * f64::EPSILON / height.min(0.5),
                        "{name}: {:e}",
                        l - m
                    );
                }
            }
        }
    }

    #[test]
    fn directions_of_vertices_are_located_exactly() {
        for (name, map) in maps() {
            let locator = Locator::new(&map);
            for (v, x) in map.directions().iter().enumerate() {
                let point = locator.locate(x);
                let corner = map.surface().triangles()[point.triangle as usize]
                    .iter()
                    .position(|&w| w as usize == v);
                assert_eq!(
                    point,
                    SurfacePoint::corner(point.triangle, corner.expect(name)),
                    "{name}"
                );
                assert_eq!(locator.locate_from(x, v as u32), point, "{name}");
            }
        }
    }

    #[test]
    fn hints_and_bulk_change_no_bit_of_the_answer() {
        let mut random = StdRng::seed_from_u64(SEED);
        for (name, map) in maps() {
            let locator = Locator::new(&map);
            let mut directions = awkward_directions(&map);
            directions.extend(random_directions(2000));
            let all = locator.locate_all(&directions);
            let triangles = map.surface().triangles().len() as u32;
            let along = locator.triangles_along(&directions);
            assert!(along.iter().zip(&all).all(|(&t, point)| t == point.triangle), "{name}");
            for (x, point) in directions.iter().zip(&all) {
                assert_eq!(&locator.locate(x), point, "{name}");
                for hint in [point.triangle, random.random_range(0..triangles), u32::MAX] {
                    assert_eq!(&locator.locate_from(x, hint), point, "{name}");
                }
            }
        }
    }

    #[test]
    fn rotating_the_sphere_changes_nothing() {
        let turn = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        for map in [octahedron(), radial_embedding(shapes::bumpy_sphere(10))] {
            let turned: Vec<Vector> = map.directions().iter().map(|x| turn * x).collect();
            let turned = SphericalEmbedding::new(map.surface().clone(), &turned).unwrap();
            let (before, after) = (Locator::new(&map), Locator::new(&turned));
            for x in random_directions(1000) {
                let (p, q) = (before.locate(&x), after.locate(&(turn * x)));
                assert_eq!(p.triangle, q.triangle);
                for (l, m) in p.barycentric.iter().zip(q.barycentric) {
                    assert!((l - m).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn lengths_do_not_matter_and_invalid_directions_have_no_point() {
        let map = octahedron();
        let locator = Locator::new(&map);
        let x = Vector::new(0.3, 0.5, -0.2);
        let expected = locator.locate(&x.normalize());
        for length in [1e-320, 1e-200, 0.7, 1e200, 1e308] {
            let point = locator.locate(&(x * length));
            assert_eq!(point.triangle, expected.triangle);
            let tolerance = if length < 1e-300 { 1e-3 } else { 1e-15 };
            for (l, m) in point.barycentric.iter().zip(expected.barycentric) {
                assert!((l - m).abs() < tolerance, "{length:e}");
            }
        }
        for bad in [
            Vector::zeros(),
            Vector::new(f64::NAN, 1.0, 0.0),
            Vector::new(0.0, f64::INFINITY, 1.0),
        ] {
            assert!(locator.locate(&bad).barycentric[0].is_nan());
            assert!(locator.locate_from(&bad, 3).barycentric[0].is_nan());
        }
    }
}
