//! Finds the tetrahedron that contains a point, by exact predicates: no point falls between two tetrahedra.

use std::cmp::Ordering;
use std::ops::Range;

use rayon::prelude::*;

use super::{Aabb, Bvh, closest_point_on_triangle, orientation};
use crate::mesh::TetMesh;
use crate::{Matrix3, Point};

/// A tree over tetrahedra of a mesh, which is given again with every question.
#[derive(Debug, Clone)]
pub struct TetLocator {
    bvh: Bvh,
    /// The tetrahedra in the order of the tree's leaves.
    tets: Vec<u32>,
    longest_side: f64,
}

/// A point of a tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TetPoint {
    /// Which.
    pub tet: u32,
    /// Weights of its corners: not negative, with sum 1.
    pub barycentric: [f64; 4],
    /// Distance from the point that was asked for: 0 if a tetrahedron contains it.
    pub distance: f64,
}

/// Corners of the sides of a tetrahedron, each opposite to the corner of its number.
const SIDES: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];

impl TetLocator {
    /// A tree over the tetrahedra for which `is_wanted`; the others contain no point. Some tenths of a second for a
    /// million.
    pub fn new(mesh: &TetMesh, is_wanted: impl Fn(usize) -> bool + Sync) -> Self {
        let all = (0..mesh.tets().len() as u32).into_par_iter();
        let wanted: Vec<u32> = all.filter(|&t| is_wanted(t as usize)).collect();
        let corners = |&t: &u32| Aabb::around(&mesh.corners(t as usize));
        let boxes: Vec<Aabb> = wanted.par_iter().map(corners).collect();
        let bvh = Bvh::new(&boxes);
        let longest = boxes.iter().map(|b| b.extent().norm()).fold(0.0, f64::max);
        Self {
            tets: bvh.order().iter().map(|&i| wanted[i as usize]).collect(),
            bvh,
            longest_side: longest,
        }
    }

    /// The tetrahedron that contains `p`, else the closest one with its closest point. `None` for points that are not
    /// finite, and without tetrahedra.
    pub fn locate(&self, mesh: &TetMesh, p: &Point) -> Option<TetPoint> {
        let exactly = |corners: &[Point; 4], p: &Point| contains(corners, p).then(|| weights(corners, p)).flatten();
        self.locate_by(mesh, p, exactly)
    }

    /// As [`Self::locate`], where `weights_inside` decides which tetrahedra contain the point, and with which weights.
    pub(crate) fn locate_by(
        &self,
        mesh: &TetMesh,
        p: &Point,
        weights_inside: impl Fn(&[Point; 4], &Point) -> Option<[f64; 4]>,
    ) -> Option<TetPoint> {
        if !p.iter().all(|c| c.is_finite()) {
            return None;
        }
        self.containing(mesh, p, weights_inside)
            .or_else(|| self.closest(mesh, p))
    }

    /// The tetrahedron that contains the point; if it lies on a side common to several, the first in the order of the tree.
    fn containing(
        &self,
        mesh: &TetMesh,
        p: &Point,
        weights_inside: impl Fn(&[Point; 4], &Point) -> Option<[f64; 4]>,
    ) -> Option<TetPoint> {
        const STOP: f64 = -1.0;
        let mut found = None;
        self.bvh.visit_nearest(p, 0.0, |leaf: Range<usize>, limit| {
            for &tet in &self.tets[leaf] {
                if let Some(barycentric) = weights_inside(&mesh.corners(tet as usize), p) {
                    found = Some(TetPoint {
                        tet,
                        barycentric,
                        distance: 0.0,
                    });
                    return STOP;
                }
            }
            limit
        });
        found
    }

    /// The closest tetrahedron; of equally close ones that of the lowest index.
    fn closest(&self, mesh: &TetMesh, p: &Point) -> Option<TetPoint> {
        let mut least = f64::INFINITY;
        let mut best: Option<TetPoint> = None;
        self.bvh.visit_nearest(p, f64::INFINITY, |leaf: Range<usize>, _| {
            for &tet in &self.tets[leaf] {
                let corners = mesh.corners(tet as usize);
                for side in SIDES {
                    let closest = closest_point_on_triangle(p, &side.map(|k| corners[k]));
                    let distance = closest.offset.norm_squared();
                    let lower = || best.as_ref().is_none_or(|b| tet < b.tet);
                    if distance < least || (distance == least && lower()) {
                        least = distance;
                        let mut barycentric = [0.0; 4];
                        (0..3).for_each(|k| barycentric[side[k]] = closest.barycentric[k]);
                        best = Some(TetPoint {
                            tet,
                            barycentric,
                            distance: distance.sqrt(),
                        });
                    }
                }
            }
            // Distances are off by a few roundings of themselves and the sides.
            let distance = least.sqrt();
            (distance + 32.0 * f64::EPSILON * (distance + self.longest_side)).powi(2)
        });
        best
    }
}

/// Whether a tetrahedron contains the point, its sides included. The four volumes over the sides sum up to that of the
/// tetrahedron, so that they all have its sign, or are zero, if no two have opposite signs. Flat ones contain nothing.
fn contains(corners: &[Point; 4], p: &Point) -> bool {
    let mut sign = Ordering::Equal;
    for k in 0..4 {
        let mut with = *corners;
        with[k] = *p;
        let [a, b, c, d] = &with;
        match orientation(a, b, c, d) {
            None => return false,
            Some(Ordering::Equal) => {}
            Some(found) if sign == Ordering::Equal => sign = found,
            Some(found) if found != sign => return false,
            Some(_) => {}
        }
    }
    sign != Ordering::Equal
}

/// Weights of the corners at a point inside. Elimination with pivots gives the exact weights of a point that is a few
/// roundings away, however thin the tetrahedron; the inverse matrix would not.
fn weights(corners: &[Point; 4], p: &Point) -> Option<[f64; 4]> {
    let [a, b, c, d] = corners;
    let [second, third, fourth] = Matrix3::from_columns(&[b - a, c - a, d - a])
        .full_piv_lu()
        .solve(&(p - a))?
        .into();
    let weights = [1.0 - second - third - fourth, second, third, fourth].map(|w: f64| w.max(0.0));
    let sum: f64 = weights.iter().sum();
    (sum.is_finite() && sum > 0.0).then(|| weights.map(|w| w / sum))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    /// A cube of thin tetrahedra about its diagonal, far from the origin.
    fn mesh() -> TetMesh {
        let corner = |k: usize| {
            let bit = |axis: usize| ((k >> axis) & 1) as f64;
            Point::new(1000.0 + bit(0), 1e-7 * bit(1) - 3.0, 0.3 * bit(2))
        };
        let tets = vec![
            [0, 1, 3, 7],
            [0, 3, 2, 7],
            [0, 2, 6, 7],
            [0, 6, 4, 7],
            [0, 4, 5, 7],
            [0, 5, 1, 7],
        ];
        TetMesh::new((0..8).map(corner).collect(), tets).unwrap()
    }

    #[test]
    fn every_point_of_a_thin_mesh_is_in_a_tetrahedron_and_is_its_weighted_mean() {
        let mesh = mesh();
        let locator = TetLocator::new(&mesh, |_| true);
        let mut random = StdRng::seed_from_u64(3);
        for _ in 0..2000 {
            // Multiples of a power of two, many of them on sides, computed without rounding.
            let [x, z] = [0, 0].map(|_| f64::from(random.random_range(0..=8)) / 8.0);
            let p = Point::new(1000.0 + x, random.random_range(-3.0..=-3.0 + 1e-7), 0.3 * z);
            let found = locator.locate(&mesh, &p).unwrap();
            assert_eq!(found.distance, 0.0, "{p}");
            let corners = mesh.corners(found.tet as usize);
            let mean = corners.iter().zip(found.barycentric).map(|(c, w)| c.coords * w);
            let off = mean.sum::<crate::Vector>() - p.coords;
            assert!(off.norm() < 1e-12, "{off}");
        }
        let out = locator.locate(&mesh, &Point::new(1000.5, -3.0 - 1e-9, 0.1)).unwrap();
        assert!((out.distance - 1e-9).abs() < 1e-15, "{}", out.distance);
        assert!(locator.locate(&mesh, &Point::new(f64::NAN, 0.0, 0.0)).is_none());
    }

    #[test]
    fn flat_tetrahedra_contain_nothing() {
        let flat = TetMesh::new(
            [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.]]
                .map(Point::from)
                .to_vec(),
            vec![[0, 1, 2, 3]],
        );
        let mesh = flat.unwrap();
        let found = TetLocator::new(&mesh, |_| true).locate(&mesh, &Point::new(0.5, 0.5, 0.0));
        assert_eq!(found.map(|at| at.distance), Some(0.0), "the closest point");
        assert!(
            TetLocator::new(&mesh, |_| false)
                .locate(&mesh, &Point::origin())
                .is_none()
        );
    }
}
