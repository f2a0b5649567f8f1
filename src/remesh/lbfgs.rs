//! Descent by L-BFGS (Nocedal, *Updating quasi-Newton matrices with limited storage*, 1980) with a line search for the weak
//! Wolfe conditions by bisection (Lewis, Overton, *Nonsmooth optimization via quasi-Newton methods*, 2013).

use std::collections::VecDeque;

use rayon::prelude::*;

use super::foldover::{EnergyValue, FoldoverEnergy};
use crate::progress::ProgressMonitor;
use crate::{Point, Vector};

/// Steps that are remembered.
const MEMORY: usize = 8;
/// Values that a line search takes at most.
const MOST_TRIALS: usize = 20;
/// Of the slope at the start: how much of it the value has to follow, and how much may be left.
const DECREASE: f64 = 1e-4;
const CURVATURE: f64 = 0.9;
/// Iterations over which the gain is taken: single ones may be short.
const WINDOW: usize = 5;
/// Numbers per task of dot products, whose order is that of the tasks.
const RUN: usize = 4096;

/// Moves some nodes of a mesh.
pub(super) struct Lbfgs<'a> {
    energy: &'a FoldoverEnergy,
    free: &'a [u32],
    /// Constraints on some of the free nodes.
    tethers: Vec<TangentConstraint>,
    parts: Vec<Vector>,
    /// Length that a first step moves a node at most.
    step: f64,
    /// Asked in every iteration whether to go on.
    monitor: &'a ProgressMonitor<'a, (usize, usize)>,
}

/// What holds a free node.
#[derive(Debug, Clone, Copy)]
pub(super) struct TangentConstraint {
    /// Its number among the free nodes.
    pub free: usize,
    /// It moves across this unit vector only.
    pub normal: Vector,
    /// It is pulled there, by the stiffness times the squared distance.
    pub place: Point,
    pub stiffness: f64,
}

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(super) struct StoppingRule {
    pub iterations: usize,
    /// Fall of the energy over [`WINDOW`] iterations, as a fraction, below which it is done.
    pub gain: f64,
    /// Stop as soon as all determinants are positive.
    pub until_positive: bool,
}

struct LbfgsState {
    x: Vec<Point>,
    gradient: Vec<Vector>,
    value: EnergyValue,
}

impl<'a> Lbfgs<'a> {
    pub fn new(
        energy: &'a FoldoverEnergy,
        free: &'a [u32],
        step: f64,
        monitor: &'a ProgressMonitor<'a, (usize, usize)>,
    ) -> Self {
        Self {
            energy,
            free,
            tethers: vec![],
            parts: vec![],
            step,
            monitor,
        }
    }

    /// Keeps some of the free nodes in planes, and near places.
    pub fn tethered(mut self, tethers: Vec<TangentConstraint>) -> Self {
        self.tethers = tethers;
        self
    }

    /// Lowers the energy; returns its last value and the number of iterations.
    pub fn run(&mut self, x: &mut Vec<Point>, epsilon: f64, limits: &StoppingRule) -> (EnergyValue, usize) {
        let mut state = self.state(std::mem::take(x), epsilon);
        let mut memory: VecDeque<(Vec<Vector>, Vec<Vector>, f64)> = VecDeque::with_capacity(MEMORY);
        let (mut iterations, mut energies) = (0, VecDeque::with_capacity(WINDOW));
        while self.monitor.should_continue()
            && iterations < limits.iterations
            && !(limits.until_positive && state.value.least > 0.0)
        {
            let mut direction = newton_like(&state.gradient, &memory);
            let mut slope = dot(&direction, &state.gradient);
            let descends = slope < 0.0;
            if !descends {
                memory.clear();
                direction = state.gradient.iter().map(|g| -g).collect();
                slope = dot(&direction, &state.gradient);
            }
            // Neither does it at a minimum, or where the gradient is not finite.
            let descends = slope < 0.0;
            if !descends {
                break;
            }
            let first = if memory.is_empty() {
                self.step / direction.iter().map(|d| d.norm()).fold(0.0, f64::max)
            } else {
                1.0
            };
            let Some(next) = self.search(&state, &direction, slope, first, epsilon) else {
                // Once more from here, straight down.
                if memory.is_empty() {
                    break;
                }
                memory.clear();
                continue;
            };
            iterations += 1;
            let moved: Vec<Vector> = self
                .free
                .iter()
                .map(|&v| next.x[v as usize] - state.x[v as usize])
                .collect();
            let bent: Vec<Vector> = next
                .gradient
                .iter()
                .zip(&state.gradient)
                .map(|(new, old)| new - old)
                .collect();
            let curvature = dot(&moved, &bent);
            if curvature > 0.0 {
                if memory.len() == MEMORY {
                    memory.pop_front();
                }
                memory.push_back((moved, bent, curvature));
            }
            energies.push_back(state.value.energy);
            state = next;
            if energies.len() == WINDOW {
                let before = energies.pop_front().unwrap_or(f64::INFINITY);
                if before - state.value.energy < limits.gain * before.abs() {
                    break;
                }
            }
        }
        *x = state.x;
        (state.value, iterations)
    }

    fn state(&mut self, x: Vec<Point>, epsilon: f64) -> LbfgsState {
        let mut gradient = vec![Vector::zeros(); self.free.len()];
        let mut value = self
            .energy
            .evaluate(&x, epsilon, self.free, &mut self.parts, &mut gradient);
        for tether in &self.tethers {
            let away = x[self.free[tether.free] as usize] - tether.place;
            value.energy += tether.stiffness * away.norm_squared();
            let slope = &mut gradient[tether.free];
            *slope += 2.0 * tether.stiffness * away;
            *slope -= tether.normal * tether.normal.dot(slope);
        }
        LbfgsState { x, gradient, value }
    }

    /// A point along the direction where the weak Wolfe conditions hold, or at least the first of them.
    fn search(
        &mut self,
        from: &LbfgsState,
        direction: &[Vector],
        slope: f64,
        first: f64,
        epsilon: f64,
    ) -> Option<LbfgsState> {
        let (mut low, mut high, mut share) = (0.0, f64::INFINITY, first);
        let mut best: Option<LbfgsState> = None;
        for _ in 0..MOST_TRIALS {
            let mut x = from.x.clone();
            for (&v, d) in self.free.iter().zip(direction) {
                x[v as usize] += d * share;
            }
            let state = self.state(x, epsilon);
            let falls = state.value.energy <= from.value.energy + DECREASE * share * slope;
            if !falls {
                high = share;
            } else if dot(direction, &state.gradient) < CURVATURE * slope {
                low = share;
                best = Some(state);
            } else {
                return Some(state);
            }
            share = if high.is_finite() {
                0.5 * (low + high)
            } else {
                2.0 * share
            };
        }
        best
    }
}

/// The two loops of L-BFGS.
fn newton_like(gradient: &[Vector], memory: &VecDeque<(Vec<Vector>, Vec<Vector>, f64)>) -> Vec<Vector> {
    let mut q: Vec<Vector> = gradient.iter().map(|g| -g).collect();
    let mut shares = Vec::with_capacity(memory.len());
    for (moved, bent, curvature) in memory.iter().rev() {
        let share = dot(moved, &q) / curvature;
        add(&mut q, bent, -share);
        shares.push(share);
    }
    if let Some((_, bent, curvature)) = memory.back() {
        let scale = curvature / dot(bent, bent);
        q.par_iter_mut().with_min_len(RUN).for_each(|q| *q *= scale);
    }
    for ((moved, bent, curvature), share) in memory.iter().zip(shares.into_iter().rev()) {
        let back = dot(bent, &q) / curvature;
        add(&mut q, moved, share - back);
    }
    q
}

fn add(to: &mut [Vector], what: &[Vector], share: f64) {
    let pairs = to.par_iter_mut().zip(what).with_min_len(RUN);
    pairs.for_each(|(to, what)| *to += what * share);
}

fn dot(a: &[Vector], b: &[Vector]) -> f64 {
    let runs = a.par_chunks(RUN).zip(b.par_chunks(RUN));
    let sums: Vec<f64> = runs
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum())
        .collect();
    sums.into_iter().sum()
}
