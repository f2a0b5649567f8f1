//! Newton's method for embeddings in the sphere or in a flat torus.
//!
//! Two unknowns per vertex in its tangent plane; after a step on the sphere the vertex is normalised. Along a step the determinant of
//! a triangle is a cubic polynomial times a positive factor, so that the longest step without an inverted triangle is
//! known beforehand (as Smith & Schaefer, *Bijective parameterization with free boundaries*, ACM Trans. Graph. 34,
//! 2015, do in the plane).

use rayon::prelude::*;

use super::cholesky::{Cholesky, OutOfMemory};
use super::distortion_energy::{ElementDerivatives, Objective, is_positive};
use crate::Vector;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NewtonOptions {
    pub(crate) most_iterations: usize,
    /// Relative decrease of the energy in one iteration below which the descent ends.
    pub(crate) tolerance: f64,
}

/// What [`Newton::minimise`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NewtonReport {
    /// Steps taken.
    pub(crate) iterations: usize,
    pub(crate) energy_before: f64,
    /// Never above `energy_before`.
    pub(crate) energy_after: f64,
    pub(crate) stop: NewtonStop,
}

/// Why [`Newton::minimise`] ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NewtonStop {
    /// The energy fell by less than the tolerance.
    Converged,
    /// The maximum number of iterations was reached, or `should_continue` returned false.
    MaxIterations,
    /// No step along the last direction lowered the energy: rounding errors are as large as what is left to gain.
    Stalled,
}

/// Why an embedding cannot be optimised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum NewtonError {
    /// A triangle has a vertex without a direction.
    Count { vertex: u32, directions: usize },
    /// A triangle of the embedding is inverted, flat or not finite at the start.
    Flipped { triangle: usize },
    /// The energy is not finite at the start: its weights are not, or a triangle is nearly flat.
    NotFinite,
    /// The factorisation does not fit into memory.
    OutOfMemory { unknowns: usize },
}

/// Minimises energies over embeddings of one list of triangles; keeps the sparsity pattern and its symbolic
/// factorisation.
#[derive(Debug)]
pub(crate) struct Newton {
    /// The unknowns `2i` and `2i + 1` are tangent coordinates of vertex `free[i]`.
    free: Vec<u32>,
    /// Index of each vertex in `free`, or [`FIXED`].
    free_index: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// Where the blocks of each triangle's Hessian are added.
    scatter: Vec<[Block; 6]>,
    /// Where the diagonal block of each free vertex is.
    diagonal: Vec<Block>,
    values: Vec<f64>,
    /// Memory that is used again in every iteration: of the shifted values, and of the triangles' derivatives.
    shifted: Vec<f64>,
    elements: Vec<ElementDerivatives>,
    cholesky: Cholesky,
}

/// Where the entries of a block of two by two are in a matrix: the upper one of each column, or [`FIXED`].
type Block = [u32; 2];

const FIXED: u32 = u32::MAX;

/// Pairs of corners, the blocks of a triangle's matrix.
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]];

/// First shift of the matrix, as a fraction of its diagonal: it is singular along rotations of the sphere.
const MIN_SHIFT: f64 = 1e-9;
/// Above this the step is that of a scaled gradient descent, and a larger shift only shortens it.
const MAX_SHIFT: f64 = 1e3;

/// The longest step, as a fraction of the one at which the first triangle becomes flat.
const SHARE_OF_LONGEST: f64 = 0.9;
/// Decrease that a step must reach, as a fraction of that predicted by the slope (Armijo's condition).
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before it is given up.
const MAX_HALVINGS: usize = 40;

impl Newton {
    /// Prepares for these triangles with the vertices `fixed` held. Vertices without triangles are held too.
    ///
    /// # Errors
    ///
    /// [`NewtonError::OutOfMemory`].
    pub(crate) fn new(triangles: &[[u32; 3]], fixed: &[u32]) -> Result<Self, NewtonError> {
        let (free, free_index) = free_vertices(triangles, fixed);
        let neighbours = later_neighbours(triangles, &free_index, free.len());
        let (begin, rows) = pattern(&neighbours);
        let diagonal: Vec<Block> = (0..free.len()).map(|i| [begin[2 * i], begin[2 * i + 1]]).collect();
        let block = |t: &[u32; 3], [m, n]: [usize; 2]| -> Block {
            let (i, j) = (free_index[t[m] as usize], free_index[t[n] as usize]);
            if i == FIXED || j == FIXED {
                return [FIXED; 2];
            }
            let (row, column) = (i.max(j), i.min(j) as usize);
            if row as usize == column {
                return diagonal[column];
            }
            let k = neighbours[column].binary_search(&row).unwrap_or(0) as u32;
            [begin[2 * column] + 2 + 2 * k, begin[2 * column + 1] + 1 + 2 * k]
        };
        let scatter = triangles.par_iter().map(|t| PAIRS.map(|pair| block(t, pair))).collect();
        let values = vec![0.0; rows.len()];
        let unknowns = 2 * free.len();
        let cholesky = Cholesky::new(begin, rows).map_err(|OutOfMemory| NewtonError::OutOfMemory { unknowns })?;
        Ok(Self {
            free,
            free_index,
            triangles: triangles.to_vec(),
            scatter,
            diagonal,
            values,
            shifted: Vec::new(),
            elements: Vec::new(),
            cholesky,
        })
    }

    /// Lowers the energy of the embedding `x`, a unit vector per vertex, without ever inverting a triangle.
    ///
    /// `should_continue` is called before every iteration; the descent ends when it returns false. The result is the
    /// same for any number of threads.
    ///
    /// # Errors
    ///
    /// When directions are missing or a triangle is not positive at the start; `x` is then unchanged.
    ///
    /// # Panics
    ///
    /// In debug builds, when the energy has other triangles than those given to [`Newton::new`].
    pub(crate) fn minimise(
        &mut self,
        energy: &impl Objective,
        x: &mut [Vector],
        options: &NewtonOptions,
        should_continue: &dyn Fn() -> bool,
    ) -> Result<NewtonReport, NewtonError> {
        debug_assert!(self.triangles == energy.triangles());
        let energy_before = self.start(energy, x)?;
        let mut report = NewtonReport {
            iterations: 0,
            energy_before,
            energy_after: energy_before,
            stop: NewtonStop::MaxIterations,
        };
        let mut shift = MIN_SHIFT;
        while report.iterations < options.most_iterations && should_continue() {
            let curvature = energy.curvature();
            let frames: Vec<[Vector; 2]> = x.par_iter().map(|x| curvature.tangents(x)).collect();
            let gradient = self.assemble(energy, x, &frames);
            let Some(step) = self.descend(energy, x, &frames, &gradient, report.energy_after, &mut shift) else {
                report.stop = NewtonStop::Stalled;
                break;
            };
            x.copy_from_slice(&step.directions);
            report.iterations += 1;
            let fall = report.energy_after - step.energy;
            report.energy_after = step.energy;
            if fall <= options.tolerance * step.energy.abs() {
                report.stop = NewtonStop::Converged;
                break;
            }
        }
        Ok(report)
    }

    /// The energy at the start, after checks.
    fn start(&self, energy: &impl Objective, x: &[Vector]) -> Result<f64, NewtonError> {
        let corners = self.triangles.iter().flatten().copied();
        if let Some(vertex) = corners.filter(|&v| v as usize >= x.len()).max() {
            let directions = x.len();
            return Err(NewtonError::Count { vertex, directions });
        }
        let is_flipped = |t: usize| !is_positive(&energy.corners(t, x));
        if let Some(triangle) = (0..self.triangles.len()).into_par_iter().position_first(is_flipped) {
            return Err(NewtonError::Flipped { triangle });
        }
        Some(energy.value(x))
            .filter(|value| value.is_finite())
            .ok_or(NewtonError::NotFinite)
    }

    /// Assembles the Hessian, and returns the gradient.
    fn assemble(&mut self, energy: &impl Objective, x: &[Vector], frames: &[[Vector; 2]]) -> Vec<f64> {
        let mut gradient = vec![0.0; 2 * self.free.len()];
        self.values.fill(0.0);
        energy.write_elements(x, frames, &mut self.elements);
        // In the order of the triangles, so that the sums are the same for any number of threads.
        for ((triangle, blocks), element) in self.triangles.iter().zip(&self.scatter).zip(&self.elements) {
            for (c, &v) in triangle.iter().enumerate() {
                let i = self.free_index[v as usize];
                if i != FIXED {
                    gradient[2 * i as usize] += element.gradient[2 * c];
                    gradient[2 * i as usize + 1] += element.gradient[2 * c + 1];
                }
            }
            add_blocks(&mut self.values, triangle, &self.free_index, blocks, element);
        }
        gradient
    }

    /// A step that lowers the energy, if there is one.
    fn descend(
        &mut self,
        energy: &impl Objective,
        x: &[Vector],
        frames: &[[Vector; 2]],
        gradient: &[f64],
        before: f64,
        shift: &mut f64,
    ) -> Option<AcceptedStep> {
        while *shift <= MAX_SHIFT {
            if let Some(direction) = self.direction(gradient, *shift) {
                let slope: f64 = gradient.iter().zip(&direction).map(|(g, p)| g * p).sum();
                let tangent = self.displacements(frames, &direction);
                if slope < 0.0
                    && let Some(step) = self.line_search(energy, x, &tangent, before, slope)
                {
                    *shift = (*shift * 0.01).max(MIN_SHIFT);
                    return Some(step);
                }
            }
            // Also after a failed line search: a larger shift gives a shorter step, closer to the gradient.
            *shift *= 100.0;
        }
        None
    }

    /// The solution of the shifted system, unless it is not positive definite.
    fn direction(&mut self, gradient: &[f64], shift: f64) -> Option<Vec<f64>> {
        self.shifted.clone_from(&self.values);
        for &[first, second] in &self.diagonal {
            self.shifted[first as usize] *= 1.0 + shift;
            self.shifted[second as usize] *= 1.0 + shift;
        }
        if !self.cholesky.factor(&self.shifted) {
            return None;
        }
        let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
        self.cholesky.solve(&mut direction);
        direction.iter().all(|p| p.is_finite()).then_some(direction)
    }

    fn displacements(&self, frames: &[[Vector; 2]], direction: &[f64]) -> Vec<Vector> {
        let mut tangent = vec![Vector::zeros(); frames.len()];
        for (&v, p) in self.free.iter().zip(direction.chunks_exact(2)) {
            let [u, w] = frames[v as usize];
            tangent[v as usize] = u * p[0] + w * p[1];
        }
        tangent
    }

    /// Backtracking line search along `tangent`, from the longest step that inverts no triangle.
    fn line_search(
        &self,
        energy: &impl Objective,
        x: &[Vector],
        tangent: &[Vector],
        before: f64,
        slope: f64,
    ) -> Option<AcceptedStep> {
        let to_flip = self.triangles.par_iter().enumerate().map(|(i, t)| {
            let corners = energy.corners(i, x);
            first_root(&determinant_along(&corners, &t.map(|v| tangent[v as usize])))
        });
        let mut length = (SHARE_OF_LONGEST * to_flip.reduce(|| f64::INFINITY, f64::min)).min(1.0);
        if length == 0.0 {
            return None;
        }
        let curvature = energy.curvature();
        for _ in 0..MAX_HALVINGS {
            let moved = |(x, u): (&Vector, &Vector)| {
                if *u == Vector::zeros() {
                    *x
                } else {
                    curvature.step(x, &(u * length))
                }
            };
            let directions: Vec<Vector> = x.par_iter().zip(tangent).map(moved).collect();
            let after = energy.value(&directions);
            if after < before && after <= before + ARMIJO * length * slope {
                return Some(AcceptedStep {
                    directions,
                    energy: after,
                });
            }
            length *= 0.5;
        }
        None
    }
}

struct AcceptedStep {
    directions: Vec<Vector>,
    energy: f64,
}

fn free_vertices(triangles: &[[u32; 3]], fixed: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let count = triangles.iter().flatten().max().map_or(0, |&v| v as usize + 1);
    let mut is_free = vec![false; count];
    triangles.iter().flatten().for_each(|&v| is_free[v as usize] = true);
    for &v in fixed.iter().filter(|&&v| (v as usize) < count) {
        is_free[v as usize] = false;
    }
    let free: Vec<u32> = (0..count as u32).filter(|&v| is_free[v as usize]).collect();
    let mut free_index = vec![FIXED; count];
    for (i, &v) in free.iter().enumerate() {
        free_index[v as usize] = i as u32;
    }
    (free, free_index)
}

/// For each free vertex the indices of its free neighbours that are higher, sorted.
fn later_neighbours(triangles: &[[u32; 3]], free_index: &[u32], free: usize) -> Vec<Vec<u32>> {
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); free];
    for t in triangles {
        let [i, j, k] = t.map(|v| free_index[v as usize]);
        for (i, j) in [(i, j), (j, k), (k, i)] {
            if i != FIXED && j != FIXED && i != j {
                neighbours[i.min(j) as usize].push(i.max(j));
            }
        }
    }
    neighbours.par_iter_mut().for_each(|list| {
        list.sort_unstable();
        list.dedup();
    });
    neighbours
}

/// Sparsity pattern of the lower triangle by columns: where they begin, and row indices.
fn pattern(neighbours: &[Vec<u32>]) -> (Vec<u32>, Vec<u32>) {
    let mut begin = vec![0];
    let mut rows = Vec::new();
    for (column, list) in neighbours.iter().enumerate() {
        let column = 2 * column as u32;
        let below = || list.iter().flat_map(|&i| [2 * i, 2 * i + 1]);
        rows.extend([column, column + 1].into_iter().chain(below()));
        begin.push(rows.len() as u32);
        rows.extend([column + 1].into_iter().chain(below()));
        begin.push(rows.len() as u32);
    }
    (begin, rows)
}

fn add_blocks(
    values: &mut [f64],
    triangle: &[u32; 3],
    free_index: &[u32],
    blocks: &[Block; 6],
    element: &ElementDerivatives,
) {
    for (&[m, n], &[first, second]) in PAIRS.iter().zip(blocks) {
        if first == FIXED {
            continue;
        }
        let (first, second) = (first as usize, second as usize);
        if m == n {
            values[first] += element.hessian[(2 * m, 2 * m)];
            values[first + 1] += element.hessian[(2 * m + 1, 2 * m)];
            values[second] += element.hessian[(2 * m + 1, 2 * m + 1)];
            continue;
        }
        let below = free_index[triangle[m] as usize] > free_index[triangle[n] as usize];
        let (row, column) = if below { (2 * m, 2 * n) } else { (2 * n, 2 * m) };
        values[first] += element.hessian[(row, column)];
        values[first + 1] += element.hessian[(row + 1, column)];
        values[second] += element.hessian[(row, column + 1)];
        values[second + 1] += element.hessian[(row + 1, column + 1)];
    }
}

/// Coefficients of `det(a + tu, b + tv, c + tw)` by powers of `t`.
fn determinant_along([a, b, c]: &[Vector; 3], [u, v, w]: &[Vector; 3]) -> [f64; 4] {
    // By edges: products of the corners nearly cancel in small triangles.
    let (first, last) = (b - a, c - a);
    let (turn_first, turn_last) = (v - u, w - u);
    let normal = [
        first.cross(&last),
        first.cross(&turn_last) + turn_first.cross(&last),
        turn_first.cross(&turn_last),
    ];
    [
        a.dot(&normal[0]),
        a.dot(&normal[1]) + u.dot(&normal[0]),
        a.dot(&normal[2]) + u.dot(&normal[1]),
        u.dot(&normal[2]),
    ]
}

/// A close lower bound of the first root in (0, 1] of a cubic that is positive at 0; infinite without a root, and 0
/// when the cubic is not finite.
fn first_root(cubic: &[f64; 4]) -> f64 {
    if !cubic.iter().all(|c| c.is_finite()) {
        return 0.0;
    }
    let mut at = 0.0;
    let mut shifted = *cubic;
    for _ in 0..16 {
        let step = safe_step(&shifted);
        if at + step >= 1.0 {
            return f64::INFINITY;
        }
        at += step;
        let [c0, c1, c2, c3] = shifted;
        shifted = [
            c0 + step * (c1 + step * (c2 + step * c3)),
            c1 + step * (2.0 * c2 + 3.0 * step * c3),
            c2 + 3.0 * step * c3,
            c3,
        ];
        if shifted[0] <= 1e-3 * cubic[0] {
            break;
        }
    }
    at
}

/// A length up to which the cubic is positive, because its negative terms are below its value at 0.
fn safe_step(&[c0, c1, c2, c3]: &[f64; 4]) -> f64 {
    // Each of the three terms may be a third of it.
    let share = c0 / 3.0;
    let reach = |c: f64, root: fn(f64) -> f64| if c < 0.0 { root(share / -c) } else { f64::INFINITY };
    reach(c1, |r| r).min(reach(c2, f64::sqrt)).min(reach(c3, f64::cbrt))
}

#[cfg(test)]
mod tests;
