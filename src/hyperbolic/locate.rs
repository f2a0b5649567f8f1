//! The inverse of an embedding in a hyperbolic surface: the triangle that covers a place, and the point in it.
//!
//! A walk from triangle to triangle toward the place, on the universal cover: what is carried along is the place in the frame of the
//! present triangle. Of two sides that it might leave by one is drawn at random, so that it ends in any triangulation (Devillers, Pion, Teillaud,
//! *Walking in a triangulation*, 2002).

use std::sync::Arc;

use super::HyperbolicEmbedding;
use super::minkowski::{Chart, inverse, lifted, normalised};
use super::polygon::SurfaceGroup;
use super::word::Word;
use crate::mesh::SurfacePoint;
use crate::{Matrix3, Vector};

/// Evaluates the inverse of a [`HyperbolicEmbedding`].
#[derive(Debug, Clone)]
pub(crate) struct HyperbolicLocator {
    triangles: Vec<CoverTriangle>,
    starts: Starts,
    group: Arc<SurfaceGroup>,
}

/// A triangle in the frame of its first corner.
#[derive(Debug, Clone)]
struct CoverTriangle {
    corners: [Vector; 3],
    /// Their products with a place are its weights, up to a factor near 1; zero where rounding would magnify too much.
    by_corner: [Vector; 3],
    /// The triangle on the other side of each side.
    across: [u32; 3],
    /// From the frame of this triangle to that of the one across; `None` where they are the same.
    to_frame: [Option<Box<Matrix3>>; 3],
}

/// A point found, for the next search nearby.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Located {
    pub point: SurfacePoint,
    /// From the frame that the place was given in to that of the triangle.
    pub to_frame: Matrix3,
}

/// Where a search without a hint begins: triangles by cells of the disk that the polygon is in by the central projection of half the
/// distance (Poincaré's disk).
#[derive(Debug, Clone)]
struct Starts {
    cells: Vec<u32>,
    /// Frames of the triangles when they are brought into the polygon.
    to_frame: Vec<Matrix3>,
}

/// Cells along each side of the square around the disk.
const CELLS: usize = 64;
/// A place is in a triangle if its barycentric coordinates are above minus this.
const ROUNDING: f64 = 1e-12;
/// Quick weights are surely negative below minus this.
const SURELY: f64 = 0.01;
/// A place between two triangles that disagree about their side by rounding is in the first of them.
const GAP: f64 = 1e-7;

impl Starts {
    fn cell(x: &Vector) -> usize {
        let [u, v] = [x.x, x.y].map(|c| {
            let in_disk = c / (1.0 + x.z);
            (((0.5 * in_disk + 0.5) * CELLS as f64) as usize).min(CELLS - 1)
        });
        v * CELLS + u
    }
}

impl HyperbolicLocator {
    pub fn new(embedding: &HyperbolicEmbedding) -> Self {
        let group = embedding.group();
        let of_triangle = |(t, crossings): (usize, [(u32, Word); 3])| CoverTriangle {
            corners: embedding.corners(t),
            by_corner: by_corner(&embedding.corners(t)),
            across: [0, 1, 2].map(|side| crossings[side].0),
            to_frame: crossings.map(|(_, word)| (!word.is_identity()).then(|| Box::new(group.matrix(&word)))),
        };
        let crossings = embedding.crossings().into_iter().enumerate();
        let triangles: Vec<CoverTriangle> = crossings.map(of_triangle).collect();
        let mut cells = vec![u32::MAX; CELLS * CELLS];
        let mut to_frame = vec![Matrix3::identity(); CELLS * CELLS];
        for (t, triangle) in triangles.iter().enumerate() {
            let middle = normalised(&triangle.corners.iter().sum());
            let (middle, word) = group.in_polygon(&middle);
            let cell = Starts::cell(&middle);
            if cells[cell] == u32::MAX {
                cells[cell] = t as u32;
                to_frame[cell] = inverse(&group.matrix(&word));
            }
        }
        fill(&mut cells, &mut to_frame);
        Self {
            triangles,
            starts: Starts { cells, to_frame },
            group: group.clone(),
        }
    }

    /// The point at a place, in any frame.
    pub fn locate(&self, x: &Vector) -> Located {
        let (in_polygon, word) = self.group.in_polygon(x);
        let cell = Starts::cell(&in_polygon);
        let to_frame = self.starts.to_frame[cell];
        let found = self.walk(&lift(&(to_frame * in_polygon)), self.starts.cells[cell]);
        Located {
            point: found.point,
            to_frame: found.to_frame * to_frame * self.group.matrix(&word),
        }
    }

    /// The point at a place in the same frame as one found before, nearby.
    pub fn locate_near(&self, x: &Vector, hint: &Located) -> Located {
        let found = self.walk(&lift(&(hint.to_frame * x)), hint.point.triangle);
        Located {
            point: found.point,
            to_frame: found.to_frame * hint.to_frame,
        }
    }

    /// From a triangle, with the place in its frame.
    fn walk(&self, x: &Vector, triangle: u32) -> Located {
        let (mut x, mut t) = (*x, triangle);
        let mut to_frame = Matrix3::identity();
        let mut random = 0x9e37_79b9_7f4a_7c15u64 ^ u64::from(triangle);
        let mut last = u32::MAX;
        // Each step crosses a side; far more than any walk takes.
        let most = 1000 + 20 * (self.triangles.len() as f64).sqrt() as usize;
        let mut best: Option<(f64, Located)> = None;
        let mut steps = 0;
        loop {
            let own = &self.triangles[t as usize];
            // Quickly, and where that does not tell for sure precisely.
            let mut weights = own.by_corner.map(|side| side.dot(&x));
            let is_outside = weights.iter().any(|&weight| weight < -SURELY);
            if !is_outside {
                weights = barycentric(&x, &own.corners);
            }
            let least = weights.iter().copied().fold(f64::INFINITY, f64::min);
            let here = || Located {
                point: point(t, weights),
                to_frame,
            };
            if least >= -ROUNDING {
                return here();
            }
            if !is_outside && best.as_ref().is_none_or(|(so_far, _)| least > *so_far) {
                best = Some((least, here()));
            }
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            // The side opposite to a corner with a negative weight.
            let is_beyond = [2, 0, 1].map(|k| weights[k] < -ROUNDING);
            let count = is_beyond.iter().filter(|&&is| is).count();
            let drawn = (random >> 33) as usize % count.max(1);
            let side = (0..3).filter(|&side| is_beyond[side]).nth(drawn).unwrap_or(0);
            let is_between = own.across[side] == last && count == 1 && least > -GAP;
            if is_between || steps > most {
                return best.map_or_else(here, |(_, found)| found);
            }
            if let Some(m) = &own.to_frame[side] {
                x = lift(&(**m * x));
                to_frame = **m * to_frame;
            }
            (last, t) = (t, own.across[side]);
            steps += 1;
        }
    }
}

fn point(triangle: u32, weights: [f64; 3]) -> SurfacePoint {
    let kept = weights.map(|w| if w < ROUNDING { 0.0 } else { w });
    let sum: f64 = kept.iter().sum();
    SurfacePoint {
        triangle,
        barycentric: kept.map(|w| w / sum),
    }
}

fn by_corner([a, b, c]: &[Vector; 3]) -> [Vector; 3] {
    let det = crate::spherical::det(a, b, c);
    let size = a.z.max(b.z).max(c.z);
    if 1e-14 * size.powi(3) > SURELY * det {
        return [Vector::zeros(); 3];
    }
    // By differences, which keep the digits of small triangles.
    [[b, c], [c, a], [a, b]].map(|[p, q]| p.cross(&(q - p)) / det)
}

/// Back onto the hyperboloid, which products of matrices leave by rounding.
fn lift(x: &Vector) -> Vector {
    lifted([x.x, x.y])
}

/// Weights of the corners of which `x` is a multiple of the sum; they add up to 1.
fn barycentric(x: &Vector, corners: &[Vector; 3]) -> [f64; 3] {
    // Relative to the chart at the place, where it is the origin: small triangles keep their digits.
    let chart = Chart::at(*x);
    let (mut at, mut heights) = ([[0.0; 2]; 3], [0.0; 3]);
    for k in 0..3 {
        let (place, height) = chart.place_and_height(&corners[k]);
        (at[k], heights[k]) = ([place.x, place.y], height);
    }
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let areas = [cross(at[1], at[2]), cross(at[2], at[0]), cross(at[0], at[1])];
    // x is the sum of weights times corners: in the chart, of weights times heights times places.
    let shares = [0, 1, 2].map(|k| areas[k] / heights[k]);
    let sum: f64 = shares.iter().sum();
    shares.map(|share| share / sum)
}

/// Gives every cell the start of the nearest one that has one.
fn fill(cells: &mut [u32], to_frame: &mut [Matrix3]) {
    let mut queue: std::collections::VecDeque<usize> = (0..cells.len()).filter(|&c| cells[c] != u32::MAX).collect();
    while let Some(cell) = queue.pop_front() {
        let (u, v) = (cell % CELLS, cell / CELLS);
        let next = [
            (u > 0).then(|| cell - 1),
            (u + 1 < CELLS).then(|| cell + 1),
            (v > 0).then(|| cell - CELLS),
            (v + 1 < CELLS).then(|| cell + CELLS),
        ];
        for other in next.into_iter().flatten() {
            if cells[other] == u32::MAX {
                cells[other] = cells[cell];
                to_frame[other] = to_frame[cell];
                queue.push_back(other);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn points_are_found_again_from_any_frame() {
        let embedding = HyperbolicEmbedding::of_surface(&shapes::double_torus(3)).unwrap();
        let locator = HyperbolicLocator::new(&embedding);
        let mut rng = StdRng::seed_from_u64(5);
        for _ in 0..2000 {
            let weights = [0.0; 3].map(|_| rng.random_range(0.0..1.0));
            let sum: f64 = weights.iter().sum();
            let point = SurfacePoint {
                triangle: rng.random_range(0..embedding.surface().triangles().len() as u32),
                barycentric: weights.map(|w| w / sum),
            };
            let x = embedding.place(&point);
            let found = locator.locate(&x);
            assert_eq!(found.point.triangle, point.triangle);
            for k in 0..3 {
                assert!((found.point.barycentric[k] - point.barycentric[k]).abs() < 1e-9);
            }
            let again = locator.locate_near(&x, &found);
            assert_eq!(again.point.triangle, point.triangle);
        }
    }
}
