//! The generalised winding number of a surface, exactly and by dipoles.
//!
//! - Van Oosterom & Strackee, *The solid angle of a plane triangle*, IEEE Trans. Biomed. Eng. 30 (1983).
//! - Jacobson, Kavan & Sorkine-Hornung, *Robust inside-outside segmentation using generalized winding numbers*, 2013.
//! - Barill, Dickson, Schmidt, Levin & Jacobson, *Fast winding numbers for soups and clouds*, 2018: far parts of the
//!   surface are replaced by their expansion about a centre, here to first order.

use std::f64::consts::PI;

use super::Bvh;
use crate::mesh::SurfaceMesh;
use crate::{Point, Vector};

/// Solid angle of a triangle seen from `p`, positive when its inner side is seen: -2π to 2π, and 0 in its plane.
pub fn solid_angle(p: &Point, corners: &[Point; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - p);
    let volume = a.dot(&b.cross(&c));
    if volume == 0.0 {
        return 0.0;
    }
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * volume.atan2(denominator)
}

/// Winding number of the surface about `p`: 1 inside a closed outward-oriented surface and 0 outside, summed over
/// overlapping parts, and in between where the surface has holes. Sums over all triangles;
/// [`super::SurfaceQuery::winding_number`] is the fast one.
pub fn winding_number(mesh: &SurfaceMesh, p: &Point) -> f64 {
    let angles = (0..mesh.triangles().len()).map(|t| solid_angle(p, &mesh.corners(t)));
    angles.sum::<f64>() / (4.0 * PI)
}

/// Multipole expansions of the parts of a surface, one for each node of a tree.
#[derive(Debug, Clone)]
pub(super) struct FarField {
    expansions: Vec<Expansion>,
}

/// The solid angle of a part about its centre `c`: `Σ aᵢnᵢ·f(xᵢ)`, with `f(x) = (x - p) / |x - p|³`, area vectors
/// `aᵢnᵢ` and centroids `xᵢ`, is expanded to first order in `xᵢ - c`.
#[derive(Debug, Clone, Copy, Default)]
struct Expansion {
    /// Mean of the centroids, weighted by area.
    centre: Point,
    area: f64,
    /// Square of the distance beyond which the expansion holds.
    reach: f64,
    area_vector: Vector,
    /// `Σ aᵢnᵢ (xᵢ - c)ᵀ`, its symmetric part: xx, yy, zz, yz, zx, xy.
    first_moment: [f64; 6],
}

/// A part is far when its distance is this many times its radius (the paper's β).
const FAR: f64 = 2.0;

impl FarField {
    /// For the triangles with these corners, listed in the order of the tree's leaves.
    pub fn new(bvh: &Bvh, corners: &[[Point; 3]]) -> Self {
        let nodes = bvh.nodes();
        let mut expansions = vec![Expansion::default(); nodes.len()];
        // In pre-order, children follow their parent.
        for (at, node) in nodes.iter().enumerate().rev() {
            let mut expansion = if node.is_leaf() {
                Expansion::of_triangles(&corners[node.items()])
            } else {
                let first = at + 1;
                let second = first + nodes[first].size();
                expansions[first].merged(&expansions[second])
            };
            expansion.reach = FAR * FAR * node.bounds.farthest_distance_squared(&expansion.centre);
            expansions[at] = expansion;
        }
        Self { expansions }
    }

    /// Winding number of the triangles about `p`.
    pub fn winding_number(&self, bvh: &Bvh, corners: &[[Point; 3]], p: &Point) -> f64 {
        let mut angle = 0.0;
        let mut at = 0;
        while let Some(expansion) = self.expansions.get(at) {
            let node = &bvh.nodes()[at];
            let from_p = expansion.centre - p;
            if from_p.norm_squared() > expansion.reach {
                angle += expansion.solid_angle(&from_p);
                at += node.size();
            } else if node.is_leaf() {
                angle += corners[node.items()].iter().map(|c| solid_angle(p, c)).sum::<f64>();
                at += 1;
            } else {
                at += 1;
            }
        }
        angle / (4.0 * PI)
    }
}

impl Expansion {
    fn of_triangles(corners: &[[Point; 3]]) -> Self {
        let flat = |[a, b, c]: &[Point; 3]| {
            let area_vector = (b - a).cross(&(c - a)) / 2.0;
            Self {
                centre: a + ((b - a) + (c - a)) / 3.0,
                area: area_vector.norm(),
                area_vector,
                ..Self::default()
            }
        };
        let expansions = corners.iter().map(flat);
        expansions.reduce(|all, one| all.merged(&one)).unwrap_or_default()
    }

    fn merged(&self, other: &Self) -> Self {
        let area = self.area + other.area;
        let weight = if area > 0.0 { other.area / area } else { 0.5 };
        let centre = self.centre + (other.centre - self.centre) * weight;
        let (a, b) = (self.moment_about(&centre), other.moment_about(&centre));
        Self {
            centre,
            area,
            reach: 0.0,
            area_vector: self.area_vector + other.area_vector,
            first_moment: std::array::from_fn(|k| a[k] + b[k]),
        }
    }

    fn moment_about(&self, centre: &Point) -> [f64; 6] {
        let (n, x) = (self.area_vector, self.centre - centre);
        let [xx, yy, zz, yz, zx, xy] = self.first_moment;
        [
            xx + n.x * x.x,
            yy + n.y * x.y,
            zz + n.z * x.z,
            yz + (n.y * x.z + n.z * x.y) / 2.0,
            zx + (n.z * x.x + n.x * x.z) / 2.0,
            xy + (n.x * x.y + n.y * x.x) / 2.0,
        ]
    }

    fn solid_angle(&self, from_p: &Vector) -> f64 {
        let r = from_p;
        let squared = r.norm_squared();
        let cubed = squared * squared.sqrt();
        let [xx, yy, zz, yz, zx, xy] = self.first_moment;
        let across = xx * r.x * r.x + yy * r.y * r.y + zz * r.z * r.z;
        let mixed = 2.0 * (yz * r.y * r.z + zx * r.z * r.x + xy * r.x * r.y);
        (self.area_vector.dot(r) + xx + yy + zz - 3.0 * (across + mixed) / squared) / cubed
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::geometry::Aabb;
    use crate::mesh::shapes;

    const SEED: u64 = 11;

    #[test]
    fn an_octant_of_the_sphere_is_an_eighth_of_it() {
        let corners = [
            Point::new(1.0, 0.0, 0.0),
            Point::new(0.0, 1.0, 0.0),
            Point::new(0.0, 0.0, 1.0),
        ];
        assert!((solid_angle(&Point::origin(), &corners) - PI / 2.0).abs() < 1e-15);
        assert!((solid_angle(&Point::new(9.0, 9.0, 9.0), &corners)) < 0.0);
    }

    #[test]
    fn nothing_is_seen_from_its_own_plane_and_nothing_is_nan() {
        let corners = [Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0), Point::origin()];
        for p in [[0.2, 0.2, 0.0], [5.0, 3.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.5, 0.0]] {
            assert_eq!(solid_angle(&Point::from(p), &corners), 0.0);
        }
        assert_eq!(solid_angle(&Point::new(0.0, 0.0, 1.0), &[corners[0]; 3]), 0.0);
    }

    #[test]
    fn closed_surfaces_wind_once_and_cavities_not_at_all() {
        let shell = shapes::spherical_shell(1.0, 0.5, 2);
        for (x, expected) in [(0.1, 0.0), (0.7, 1.0), (1.5, 0.0)] {
            let p = Point::new(x, x / 100.0, -x / 70.0);
            assert!((winding_number(&shell, &p) - expected).abs() < 1e-13, "{x}");
        }
        let p = Point::new(0.1, 0.2, 0.3);
        assert!((winding_number(&shapes::sphere(1.0, 2).reversed(), &p) + 1.0).abs() < 1e-13);
    }

    /// An inside test needs the error below a half; a fifth of that leaves room for worse surfaces than these.
    #[test]
    fn expansions_agree_with_the_sum_over_all_triangles() {
        let mut random = StdRng::seed_from_u64(SEED);
        for mesh in [
            shapes::torus(1.0, 0.3, 40, 20),
            shapes::double_torus(8),
            shapes::spherical_shell(1.0, 0.9, 3),
        ] {
            let corners: Vec<_> = (0..mesh.triangles().len()).map(|t| mesh.corners(t)).collect();
            let boxes: Vec<_> = corners.iter().map(|c| Aabb::around(c)).collect();
            let bvh = Bvh::new(&boxes);
            let sorted: Vec<_> = bvh.order().iter().map(|&t| corners[t as usize]).collect();
            let field = FarField::new(&bvh, &sorted);
            let bounds = bvh.nodes()[0].bounds;
            let mut worst = 0.0f64;
            for _ in 0..500 {
                let p = bounds.low + bounds.extent().map(|e| e * random.random_range(-0.3..1.3));
                let error = (field.winding_number(&bvh, &sorted, &p) - winding_number(&mesh, &p)).abs();
                assert!(error < 0.1, "{error} at {p}");
                worst = worst.max(error);
            }
            // Otherwise no part was expanded.
            assert!(worst > 1e-6);
        }
    }
}
