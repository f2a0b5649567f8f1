//! The inverse of an embedding in the flat torus: the triangle that covers a position, and the point in it.
//!
//! The search is that of the sphere ([`Locator`]), among the copies of triangles that touch the square.

use std::collections::HashMap;

use rayon::prelude::*;

use super::ToroidalEmbedding;
use super::rings::{Shift, minus, plus};
use crate::geometry::Aabb;
use crate::mesh::SurfacePoint;
use crate::mesh::topology::Topology;
use crate::spherical::{Locator, MAX_WALK};
use crate::{Point, Vector};

/// Evaluates the inverse of a [`ToroidalEmbedding`].
#[derive(Debug, Clone)]
pub(crate) struct ToroidalLocator {
    copies: Locator,
    /// The triangle of each copy.
    triangle_of_copy: Vec<u32>,
    /// Cells along a side of the square, and the copy at the middle of each cell, or near it, row by row: where the last point found is far, the
    /// search starts here.
    cells: usize,
    copy_of_cell: Vec<u32>,
}

/// Boxes are enlarged by this for rounding errors of positions.
const MARGIN: f64 = 64.0 * f64::EPSILON;

/// Triangles to walk through from the last point found before the search starts from a cell.
const SHORT_WALK: usize = 4;
/// Cells for each triangle.
const CELLS: f64 = 2.0;

/// A point found, with the copy of its triangle, near which the next search may start.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Located {
    pub point: SurfacePoint,
    pub copy: u32,
}

impl ToroidalLocator {
    pub fn new(embedding: &ToroidalEmbedding) -> Self {
        let surface = embedding.surface();
        let mut copies: Vec<(u32, Shift)> = Vec::new();
        let mut index_of = HashMap::new();
        for t in 0..surface.triangles().len() as u32 {
            let around = Aabb::around(&embedding.corners(t as usize).map(Point::from));
            let range = |axis: usize| {
                let (low, high) = (around.low[axis], around.high[axis]);
                -(high.floor() as i32)..=(1.0 - low).floor() as i32
            };
            for i in range(0) {
                for j in range(1) {
                    index_of.insert((t, [i, j]), copies.len() as u32);
                    copies.push((t, [i, j]));
                }
            }
        }
        let corners = |copy: u32| {
            let (t, [i, j]) = copies[copy as usize];
            let by = Vector::new(f64::from(i), f64::from(j), 0.0);
            embedding.corners(t as usize).map(|corner| corner + by)
        };
        let enlarged = |copy: u32| {
            let around = Aabb::around(&corners(copy).map(Point::from));
            Aabb {
                low: around.low - Vector::repeat(MARGIN),
                high: around.high + Vector::repeat(MARGIN),
            }
        };
        let boxes: Vec<Aabb> = (0..copies.len() as u32).map(enlarged).collect();
        let topology = Topology::new(surface);
        let across = |copy: u32, side: usize| {
            let (t, shift) = copies[copy as usize];
            let edges = topology.edges_of_triangle(t as usize).expect("three vertices");
            let mut sides = topology.sides(edges[side] as usize).iter();
            let other = sides
                .find(|side| side.triangle != t)
                .expect("a closed surface")
                .triangle;
            let v = surface.triangles()[t as usize][side];
            let place = surface.triangles()[other as usize].iter().position(|&w| w == v);
            let other_shift = embedding.translations()[other as usize][place.expect("a shared edge")];
            let by = minus(embedding.translations()[t as usize][side], other_shift);
            index_of.get(&(other, plus(shift, by))).copied().unwrap_or(u32::MAX)
        };
        let cells = (CELLS * surface.triangles().len() as f64).sqrt().ceil() as usize;
        let mut made = Self {
            copies: Locator::of_corners(&boxes, corners, across),
            triangle_of_copy: copies.iter().map(|copy| copy.0).collect(),
            cells,
            copy_of_cell: Vec::new(),
        };
        let middle = |k: usize| (k as f64 + 0.5) / cells as f64;
        let of_row = |i: usize| {
            let mut copy = u32::MAX;
            let mut next = |j: usize| {
                copy = made.located(&in_square([middle(i), middle(j)]), copy).copy;
                copy
            };
            (0..cells).map(&mut next).collect::<Vec<u32>>()
        };
        made.copy_of_cell = (0..cells).into_par_iter().flat_map_iter(of_row).collect();
        made
    }

    /// The point at a position, which may lie outside of the square.
    pub fn locate(&self, position: [f64; 2]) -> SurfacePoint {
        self.on_surface(self.copies.search(&in_square(position))).point
    }

    /// The same, faster when the point is near the last one found.
    pub fn locate_from(&self, position: [f64; 2], copy: u32) -> Located {
        let x = in_square(position);
        if let Some(found) = self.copies.walk(&x, copy, SHORT_WALK) {
            return self.on_surface(found);
        }
        let cell = |along: f64| ((along * self.cells as f64) as usize).min(self.cells - 1);
        let near = self.copy_of_cell.get(cell(x[0]) * self.cells + cell(x[1]));
        self.located(&x, near.copied().unwrap_or(u32::MAX))
    }

    fn located(&self, x: &Vector, copy: u32) -> Located {
        let found = self.copies.walk(x, copy, MAX_WALK);
        self.on_surface(found.unwrap_or_else(|| self.copies.search(x)))
    }

    fn on_surface(&self, found: SurfacePoint) -> Located {
        let triangle = self.triangle_of_copy[found.triangle as usize];
        Located {
            point: SurfacePoint { triangle, ..found },
            copy: found.triangle,
        }
    }
}

fn in_square([u, v]: [f64; 2]) -> Vector {
    Vector::new(u - u.floor(), v - v.floor(), 1.0)
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::super::testing::square_torus;
    use super::*;

    #[test]
    fn points_are_found_again_and_vertices_exactly() {
        let embedding = square_torus(12, 7);
        let locator = ToroidalLocator::new(&embedding);
        let mut rng = StdRng::seed_from_u64(5);
        let mut copy = u32::MAX;
        for _ in 0..2000 {
            let weights = [0.0; 3].map(|_| rng.random_range(0.0..1.0));
            let sum: f64 = weights.iter().sum();
            let point = SurfacePoint {
                triangle: rng.random_range(0..embedding.surface().triangles().len() as u32),
                barycentric: weights.map(|w| w / sum),
            };
            let [u, v] = embedding.position(&point);
            let at = [u + 3.0, v - 2.0];
            let found = locator.locate_from(at, copy);
            copy = found.copy;
            // Wherever the search starts.
            assert_eq!(locator.locate_from(at, u32::MAX).point, found.point);
            assert_eq!(locator.locate(at), found.point);
            assert_eq!(found.point.triangle, point.triangle);
            for k in 0..3 {
                assert!((found.point.barycentric[k] - point.barycentric[k]).abs() < 1e-12);
            }
        }
        for (t, corners) in embedding.surface().triangles().iter().enumerate() {
            for (k, &corner) in corners.iter().enumerate() {
                let found = locator.locate(embedding.position(&SurfacePoint::corner(t as u32, k)));
                let vertex = (0..3).find(|&k| found.barycentric[k] == 1.0).unwrap();
                assert_eq!(embedding.surface().triangles()[found.triangle as usize][vertex], corner);
            }
        }
    }
}
