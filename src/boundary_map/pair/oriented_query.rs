//! Closest points in a metric of position and normal.

use rayon::prelude::*;

use crate::geometry::{Aabb, Bvh, TrianglePoint, closest_point_on_triangle, morton_order};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::{Point, Vector};

/// Finds the point `y` of a surface that is closest to a point `p` with a unit normal `n` in the metric
/// `|p − y|² + β² |n − n(y)|²`, where `n(y)` is interpolated from normals at the vertices.
///
/// Unlike the closest point in space, it stays on the same side of a thin limb.
#[derive(Debug, Clone)]
pub struct OrientedQuery {
    bvh: Bvh,
    /// Corners of the triangles in the order of the tree's leaves. A triangle's index in this order is its slot.
    corners: Vec<[Point; 3]>,
    /// Normals at these corners.
    normals: Vec<[Vector; 3]>,
}

/// Points that are found one after the other.
const CHUNK: usize = 128;

/// The point of a surface closest in position and normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedPoint {
    /// Its position.
    pub point: Point,
    /// Its place on the surface.
    pub place: SurfacePoint,
    /// Interpolated unit normal there; zero where the surface has none.
    pub normal: Vector,
    /// Square of the distance in the metric of the query.
    pub distance_squared: f64,
    slot: u32,
}

impl OrientedQuery {
    /// Prepares queries on a surface with these unit normals, one per vertex. `None` without triangles, when a corner
    /// or a normal is not finite, or the counts differ.
    pub fn new(surface: &SurfaceMesh, normals: &[Vector]) -> Option<Self> {
        let is_finite = |v: &u32| {
            let v = *v as usize;
            surface.vertices()[v]
                .iter()
                .chain(normals[v].iter())
                .all(|c| c.is_finite())
        };
        let is_sound = normals.len() == surface.vertices().len() && !surface.triangles().is_empty();
        if !is_sound || !surface.triangles().iter().flatten().all(is_finite) {
            return None;
        }
        let boxes: Vec<Aabb> = (0..surface.triangles().len())
            .map(|t| Aabb::around(&surface.corners(t)))
            .collect();
        let bvh = Bvh::new(&boxes);
        let corners = bvh.order().iter().map(|&t| surface.corners(t as usize)).collect();
        let normals_at = |t: u32| surface.triangles()[t as usize].map(|v| normals[v as usize]);
        let normals = bvh.order().iter().map(|&t| normals_at(t)).collect();
        Some(Self { bvh, corners, normals })
    }

    /// The closest point, with the weight `β` of normals, a length. `hint` is the result of an earlier query: the
    /// closer it is, the faster the search. The result depends on it only in ties.
    pub fn closest(&self, p: &Point, normal: &Vector, beta: f64, hint: Option<&OrientedPoint>) -> OrientedPoint {
        let mut best = self.on_triangle(hint.map_or(0, |found| found.slot), p, normal, beta);
        self.bvh.visit_nearest(p, best.distance_squared, |slots, _| {
            for slot in slots {
                let nearest = closest_point_on_triangle(p, &self.corners[slot]);
                // The distance in space is a part of it.
                if nearest.offset.norm_squared() > best.distance_squared {
                    continue;
                }
                let here = self.at(slot as u32, &nearest, normal, beta);
                let lower = || self.bvh.order()[slot] < self.bvh.order()[best.slot as usize];
                if here.distance_squared < best.distance_squared
                    || (here.distance_squared == best.distance_squared && lower())
                {
                    best = here;
                }
            }
            best.distance_squared
        });
        best
    }

    /// [`Self::closest`] of every point with its normal, in parallel.
    pub fn closest_of_all(&self, points: &[(Point, Vector)], beta: f64) -> Vec<OrientedPoint> {
        let positions: Vec<Point> = points.iter().map(|(p, _)| *p).collect();
        let order = morton_order(&positions);
        // Each point is found from the one before it, which is near.
        let of_chunk = |chunk: &[u32]| {
            let mut hint = None;
            let mut of_next = |&i: &u32| {
                let (p, n) = &points[i as usize];
                let found = self.closest(p, n, beta, hint.as_ref());
                hint = Some(found);
                (i, found)
            };
            chunk.iter().map(&mut of_next).collect::<Vec<_>>()
        };
        let mut found: Vec<(u32, OrientedPoint)> = order.par_chunks(CHUNK).flat_map_iter(of_chunk).collect();
        found.sort_unstable_by_key(|(i, _)| *i);
        found.into_iter().map(|(_, found)| found).collect()
    }

    /// Unit normal of the triangle that a point was found on; zero for a triangle without area.
    pub fn face_normal(&self, found: &OrientedPoint) -> Vector {
        let [a, b, c] = self.corners[found.slot as usize];
        unit_or_zero(&(b - a).cross(&(c - a)))
    }

    fn on_triangle(&self, slot: u32, p: &Point, normal: &Vector, beta: f64) -> OrientedPoint {
        let nearest = closest_point_on_triangle(p, &self.corners[slot as usize]);
        self.at(slot, &nearest, normal, beta)
    }

    /// The triangle's point that is nearest in space, in the metric of the query.
    fn at(&self, slot: u32, closest: &TrianglePoint, normal: &Vector, beta: f64) -> OrientedPoint {
        let corners = &self.corners[slot as usize];
        let [u, v, w] = closest.barycentric;
        let [a, b, c] = &self.normals[slot as usize];
        let here = unit_or_zero(&(a * u + b * v + c * w));
        OrientedPoint {
            point: Point::from(corners[0].coords * u + corners[1].coords * v + corners[2].coords * w),
            place: SurfacePoint {
                triangle: self.bvh.order()[slot as usize],
                barycentric: closest.barycentric,
            },
            normal: here,
            distance_squared: closest.offset.norm_squared() + beta * beta * (normal - here).norm_squared(),
            slot,
        }
    }
}

/// Unit normals at the vertices, triangles weighted by area; zero where those cancel, and at vertices without
/// triangles.
pub fn vertex_normals(surface: &SurfaceMesh) -> Vec<Vector> {
    let mut normals = vec![Vector::zeros(); surface.vertices().len()];
    for (t, corners) in surface.triangles().iter().enumerate() {
        let area = surface.area_vector(t);
        corners.iter().for_each(|&v| normals[v as usize] += area);
    }
    normals.iter().map(unit_or_zero).collect()
}

pub(super) fn unit_or_zero(v: &Vector) -> Vector {
    // Scaled first: squares of very small lengths underflow.
    let largest = v.amax();
    if largest > 0.0 && largest.is_finite() {
        (v / largest).normalize()
    } else {
        Vector::zeros()
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn finds_the_minimum_over_all_triangles_for_any_hint() {
        let surface = shapes::bumpy_sphere(6);
        let query = OrientedQuery::new(&surface, &vertex_normals(&surface)).unwrap();
        let mut random = StdRng::seed_from_u64(3);
        let mut vector = || Vector::from_fn(|_, _| random.random_range(-1.5..1.5));
        for _ in 0..200 {
            let (p, n) = (Point::from(vector()), vector().normalize());
            let found = query.closest(&p, &n, 0.4, None);
            let least = (0..surface.triangles().len() as u32)
                .map(|slot| query.on_triangle(slot, &p, &n, 0.4).distance_squared)
                .fold(f64::INFINITY, f64::min);
            assert_eq!(found.distance_squared, least);
            let elsewhere = query.closest(&Point::from(vector()), &n, 0.4, None);
            assert_eq!(query.closest(&p, &n, 0.4, Some(&elsewhere)), found);
            let place = found.place.position(&surface, surface.vertices());
            assert!((place - found.point).norm() < 1e-15);
        }
    }

    #[test]
    fn points_together_are_found_as_one_by_one() {
        let surface = shapes::bumpy_sphere(6);
        let query = OrientedQuery::new(&surface, &vertex_normals(&surface)).unwrap();
        let mut random = StdRng::seed_from_u64(5);
        let mut vector = || Vector::from_fn(|_, _| random.random_range(-1.5..1.5));
        let points: Vec<(Point, Vector)> = (0..500).map(|_| (vector().into(), vector().normalize())).collect();
        let alone = points.iter().map(|(p, n)| query.closest(p, n, 0.4, None));
        assert_eq!(query.closest_of_all(&points, 0.4), alone.collect::<Vec<_>>());
        assert_eq!(query.closest_of_all(&[], 0.4), vec![]);
    }

    #[test]
    fn refuses_surfaces_and_normals_that_are_not_finite() {
        let surface = shapes::sphere(1.0, 1);
        let mut normals = vertex_normals(&surface);
        assert!(OrientedQuery::new(&surface, &normals[1..]).is_none());
        normals[4].x = f64::NAN;
        assert!(OrientedQuery::new(&surface, &normals).is_none());
        assert!(OrientedQuery::new(&SurfaceMesh::default(), &[]).is_none());
    }
}
