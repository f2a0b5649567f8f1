//! Minimisation by L-BFGS (Nocedal, *Updating quasi-Newton matrices with limited storage*, 1980) with a line search for
//! the weak Wolfe conditions by bisection (Lewis, Overton, *Nonsmooth optimization via quasi-Newton methods*, 2013).

use std::collections::VecDeque;
use std::ops::Mul;

use rayon::prelude::*;

use super::foldover::{EnergyValue, FoldoverEnergy};
use super::shared_coordinates::SharedCoordinates;
use crate::progress::ProgressSender;
use crate::{Matrix3, Point, Vector};

/// Steps in the memory of the Hessian approximation.
const MEMORY: usize = 8;
/// Largest number of evaluations of a line search.
const MAX_EVALUATIONS: usize = 20;
/// Constants of the Wolfe conditions, for the value and for the slope.
const DECREASE: f64 = 1e-4;
const CURVATURE: f64 = 0.9;
/// Iterations over which the decrease is measured: single steps may be short.
const WINDOW: usize = 5;
/// Vectors per task of a dot product. Sums of tasks are added in order, so that the result does not depend on the
/// threads.
const RUN: usize = 4096;

/// An energy of node positions that grows without bound, for a small ε, where cells get flat.
pub(crate) trait DescentEnergy {
    /// The energy, and its gradient with respect to the nodes `free` into `gradient`. `parts` is scratch space.
    fn evaluate(
        &self,
        x: &[Point],
        epsilon: f64,
        free: &[u32],
        parts: &mut Vec<Vector>,
        gradient: &mut [Vector],
    ) -> EnergyValue;

    /// For each of the nodes `free` an approximation of the 3 × 3 block of the Hessian on its diagonal, positive
    /// semi-definite.
    fn diagonal_blocks(&self, x: &[Point], epsilon: f64, free: &[u32]) -> Vec<Matrix3>;
}

/// Minimises an energy over the positions of some nodes.
pub(crate) struct Lbfgs<'a, Energy = FoldoverEnergy, Report = (usize, usize)> {
    energy: &'a Energy,
    free: &'a [u32],
    /// Constraints on some of the free nodes.
    pub constraints: Vec<TangentConstraint>,
    /// Coordinates of the free nodes that are fixed, or that are equal and stay so.
    pub shared: Option<&'a SharedCoordinates>,
    /// Whether directions are preconditioned by the blocks of the Hessian on its diagonal, one for each node, as they
    /// are at the start of a run.
    pub has_block_preconditioner: bool,
    parts: Vec<Vector>,
    /// Largest displacement of a node in a first step without a preconditioner.
    step: f64,
    /// Asked in every iteration whether to continue.
    monitor: &'a ProgressSender<'a, Report>,
}

/// Keeps a free node in a plane and near a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TangentConstraint {
    /// Its index among the free nodes.
    pub free: usize,
    /// Unit normal of the plane that it moves in.
    pub normal: Vector,
    /// Unit vector of the line that it moves along, if it may not move in the whole plane.
    pub along: Option<Vector>,
    /// A spring pulls it here: `stiffness` times the squared distance is added to the energy.
    pub anchor: Point,
    pub stiffness: f64,
    /// What else pulls it.
    pub pull: Pull,
}

/// A quadratic energy of a node's position `x`: with `d = x − from`, `dᵀ matrix d − 2 vector · d`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pull {
    pub from: Point,
    pub matrix: Matrix3,
    pub vector: Vector,
}

impl Pull {
    /// None, of a node at `from`.
    pub fn none(from: Point) -> Self {
        Self {
            from,
            matrix: Matrix3::zeros(),
            vector: Vector::zeros(),
        }
    }
}

impl Mul<f64> for Pull {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self {
            matrix: self.matrix * factor,
            vector: self.vector * factor,
            ..self
        }
    }
}

impl TangentConstraint {
    /// The inverse of a block with the spring's, in the directions that the node moves in, and zero in the others.
    fn inverse_block(&self, block: &Matrix3) -> Matrix3 {
        let allowed = match self.along {
            Some(along) => along * along.transpose(),
            None => Matrix3::identity() - self.normal * self.normal.transpose(),
        };
        let spring = Matrix3::identity() * (2.0 * self.stiffness) + self.pull.matrix * 2.0;
        let others = (Matrix3::identity() - allowed) * block.trace();
        allowed * inverse_block(&(allowed * (block + spring) * allowed + others)) * allowed
    }
}

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StoppingRule {
    pub iterations: usize,
    /// Relative decrease of the energy over [`WINDOW`] iterations below which to stop.
    pub gain: f64,
    /// Stop as soon as all determinants are positive.
    pub until_positive: bool,
}

struct LbfgsState {
    x: Vec<Point>,
    gradient: Vec<Vector>,
    value: EnergyValue,
}

impl<'a, Energy: DescentEnergy, Report> Lbfgs<'a, Energy, Report> {
    pub fn new(energy: &'a Energy, free: &'a [u32], step: f64, monitor: &'a ProgressSender<'a, Report>) -> Self {
        Self {
            energy,
            free,
            constraints: vec![],
            shared: None,
            has_block_preconditioner: false,
            parts: vec![],
            step,
            monitor,
        }
    }

    /// Lowers the energy; returns its last value and the number of iterations.
    pub fn run(&mut self, x: &mut Vec<Point>, epsilon: f64, rule: &StoppingRule) -> (EnergyValue, usize) {
        self.run_watched(x, epsilon, rule, &mut |_, _| true)
    }

    /// As [`Lbfgs::run`]; `watch` sees the number of iterations and the positions after each, and says whether to go
    /// on.
    pub fn run_watched(
        &mut self,
        x: &mut Vec<Point>,
        epsilon: f64,
        rule: &StoppingRule,
        watch: &mut dyn FnMut(usize, &[Point]) -> bool,
    ) -> (EnergyValue, usize) {
        let mut state = self.state(std::mem::take(x), epsilon);
        let blocks = self.has_block_preconditioner.then(|| {
            let blocks = self.energy.diagonal_blocks(&state.x, epsilon, self.free);
            let mut inverse: Vec<Matrix3> = blocks.iter().map(inverse_block).collect();
            for constraint in &self.constraints {
                inverse[constraint.free] = constraint.inverse_block(&blocks[constraint.free]);
            }
            if let Some(shared) = self.shared {
                shared.restrict(&blocks, &mut inverse);
            }
            inverse
        });
        let preconditioner = blocks.as_deref().map(|blocks| Preconditioner {
            blocks,
            shared: self.shared,
        });
        let mut memory: VecDeque<(Vec<Vector>, Vec<Vector>, f64)> = VecDeque::with_capacity(MEMORY);
        let (mut iterations, mut energies) = (0, VecDeque::with_capacity(WINDOW));
        while self.monitor.should_continue()
            && iterations < rule.iterations
            && !(rule.until_positive && state.value.least > 0.0)
        {
            let mut direction = search_direction(&state.gradient, &memory, preconditioner.as_ref());
            let mut slope = dot(&direction, &state.gradient);
            let descends = slope < 0.0;
            if !descends && !memory.is_empty() {
                // Rounding errors have spoilt the memory.
                memory.clear();
                direction = search_direction(&state.gradient, &memory, preconditioner.as_ref());
                slope = dot(&direction, &state.gradient);
            }
            // The negative gradient is no descent direction at a minimum, nor where it is not finite.
            let descends = slope < 0.0;
            if !descends {
                break;
            }
            let first = if memory.is_empty() && preconditioner.is_none() {
                self.step / direction.iter().map(|d| d.norm()).fold(0.0, f64::max)
            } else {
                1.0
            };
            let Some(next) = self.search(&state, &direction, slope, first, epsilon) else {
                // Try again from here, along the negative gradient.
                if memory.is_empty() {
                    break;
                }
                memory.clear();
                continue;
            };
            iterations += 1;
            let shift = |&v: &u32| next.x[v as usize] - state.x[v as usize];
            let displacement: Vec<Vector> = self.free.iter().map(shift).collect();
            let gradients = next.gradient.iter().zip(&state.gradient);
            let gradient_change: Vec<Vector> = gradients.map(|(new, old)| new - old).collect();
            let curvature = dot(&displacement, &gradient_change);
            if curvature > 0.0 {
                if memory.len() == MEMORY {
                    memory.pop_front();
                }
                memory.push_back((displacement, gradient_change, curvature));
            }
            energies.push_back(state.value.energy);
            state = next;
            if !watch(iterations, &state.x) {
                break;
            }
            if energies.len() == WINDOW {
                let before = energies.pop_front().unwrap_or(f64::INFINITY);
                if before - state.value.energy < rule.gain * before.abs() {
                    break;
                }
            }
        }
        *x = state.x;
        (state.value, iterations)
    }

    fn state(&mut self, x: Vec<Point>, epsilon: f64) -> LbfgsState {
        let mut gradient = vec![Vector::zeros(); self.free.len()];
        let parts = &mut self.parts;
        let mut value = self.energy.evaluate(&x, epsilon, self.free, parts, &mut gradient);
        for constraint in &self.constraints {
            let away = x[self.free[constraint.free] as usize] - constraint.anchor;
            value.energy += constraint.stiffness * away.norm_squared();
            let pull = &constraint.pull;
            let d = x[self.free[constraint.free] as usize] - pull.from;
            let force = pull.matrix * d - pull.vector;
            value.energy += d.dot(&(force - pull.vector));
            let slope = &mut gradient[constraint.free];
            *slope += 2.0 * (constraint.stiffness * away + force);
            *slope -= constraint.normal * constraint.normal.dot(slope);
            if let Some(along) = constraint.along {
                *slope = along * along.dot(slope);
            }
        }
        if let Some(shared) = self.shared {
            shared.project(&mut gradient);
        }
        LbfgsState { x, gradient, value }
    }

    /// A point along the direction where both weak Wolfe conditions hold, or at least the one on the value.
    fn search(
        &mut self,
        from: &LbfgsState,
        direction: &[Vector],
        slope: f64,
        first: f64,
        epsilon: f64,
    ) -> Option<LbfgsState> {
        let (mut low, mut high, mut length) = (0.0, f64::INFINITY, first);
        let mut best: Option<LbfgsState> = None;
        for _ in 0..MAX_EVALUATIONS {
            let mut x = from.x.clone();
            for (&v, d) in self.free.iter().zip(direction) {
                x[v as usize] += d * length;
            }
            let state = self.state(x, epsilon);
            let falls = state.value.energy <= from.value.energy + DECREASE * length * slope;
            if !falls {
                high = length;
            } else if dot(direction, &state.gradient) < CURVATURE * slope {
                low = length;
                best = Some(state);
            } else {
                return Some(state);
            }
            length = if high.is_finite() {
                0.5 * (low + high)
            } else {
                2.0 * length
            };
        }
        best
    }
}

/// The search direction: the two-loop recursion of L-BFGS.
fn search_direction(
    gradient: &[Vector],
    memory: &VecDeque<(Vec<Vector>, Vec<Vector>, f64)>,
    preconditioner: Option<&Preconditioner>,
) -> Vec<Vector> {
    let mut q: Vec<Vector> = gradient.iter().map(|g| -g).collect();
    let mut alphas = Vec::with_capacity(memory.len());
    for (displacement, gradient_change, curvature) in memory.iter().rev() {
        let alpha = dot(displacement, &q) / curvature;
        add(&mut q, gradient_change, -alpha);
        alphas.push(alpha);
    }
    if let Some(preconditioner) = preconditioner {
        let scale = memory.back().map_or(1.0, |(_, gradient_change, curvature)| {
            curvature / dot(gradient_change, &preconditioner.products(gradient_change))
        });
        let rows = q.par_iter_mut().zip(preconditioner.blocks).with_min_len(RUN);
        rows.for_each(|(q, block)| *q = block * *q * scale);
        if let Some(shared) = preconditioner.shared {
            shared.project(&mut q);
        }
    } else if let Some((_, gradient_change, curvature)) = memory.back() {
        let scale = curvature / dot(gradient_change, gradient_change);
        q.par_iter_mut().with_min_len(RUN).for_each(|q| *q *= scale);
    }
    for ((displacement, gradient_change, curvature), alpha) in memory.iter().zip(alphas.into_iter().rev()) {
        let beta = dot(gradient_change, &q) / curvature;
        add(&mut q, displacement, alpha - beta);
    }
    q
}

/// Inverse blocks, in the subspace in which the free nodes move.
struct Preconditioner<'a> {
    blocks: &'a [Matrix3],
    shared: Option<&'a SharedCoordinates>,
}

impl Preconditioner<'_> {
    fn products(&self, vectors: &[Vector]) -> Vec<Vector> {
        let rows = self.blocks.par_iter().zip(vectors).with_min_len(RUN);
        let mut products: Vec<Vector> = rows.map(|(block, vector)| block * vector).collect();
        if let Some(shared) = self.shared {
            shared.project(&mut products);
        }
        products
    }
}

/// The inverse of a positive semi-definite block, positive definite: small eigenvalues are raised.
pub(super) fn inverse_block(block: &Matrix3) -> Matrix3 {
    const RAISED: f64 = 1e-12;
    /// Ratio of a determinant to a power of the trace above which rounding does not change the sign of an eigenvalue of the
    /// inverse.
    const SAFE: f64 = 1e-9;
    let trace = block.trace();
    if !(trace > 0.0 && trace.is_finite()) {
        return Matrix3::identity();
    }
    if block.determinant() > SAFE * trace.powi(3) {
        return block.try_inverse().unwrap_or_else(Matrix3::identity);
    }
    // Where cells are squeezed, entries of the inverse would cancel.
    let eigen = (block / trace).symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|value| 1.0 / (value.max(RAISED) * trace));
    let inverse = eigen.eigenvectors * Matrix3::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    if inverse.iter().all(|x| x.is_finite()) {
        inverse
    } else {
        Matrix3::identity()
    }
}

fn add(to: &mut [Vector], vectors: &[Vector], factor: f64) {
    if to.len() <= RUN {
        to.iter_mut()
            .zip(vectors)
            .for_each(|(to, vector)| *to += vector * factor);
        return;
    }
    let pairs = to.par_iter_mut().zip(vectors).with_min_len(RUN);
    pairs.for_each(|(to, vector)| *to += vector * factor);
}

fn dot(a: &[Vector], b: &[Vector]) -> f64 {
    if a.len() <= RUN {
        return sum_of_products(a, b);
    }
    let runs = a.par_chunks(RUN).zip(b.par_chunks(RUN));
    runs.map(|(a, b)| sum_of_products(a, b))
        .collect::<Vec<f64>>()
        .into_iter()
        .sum()
}

fn sum_of_products(a: &[Vector], b: &[Vector]) -> f64 {
    let mut sums = [0.0; 3];
    for (a, b) in a.iter().zip(b) {
        for k in 0..3 {
            sums[k] += a[k] * b[k];
        }
    }
    sums[0] + sums[1] + sums[2]
}
