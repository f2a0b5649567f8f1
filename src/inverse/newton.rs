//! Newton's method for many points together.
//!
//! `x ← x − J⁻¹ (f(x) − y)`, the step no longer than a trust length, halved until the residual falls (Armijo's rule:
//! Nocedal & Wright, *Numerical Optimization*, 2006, chapters 3 and 11). All points of a round are evaluated in one
//! call, which costs far less than one by one; those that are done drop out.

use rayon::prelude::*;

use crate::map::VolumeMap;
use crate::{Matrix3, Point, Vector};

/// Tolerances and limits, in model units.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewtonLimits {
    /// Residual at which a search has converged, in units of the target.
    pub tolerance: f64,
    /// Residual below which the last Jacobian is kept, in units of the target.
    pub near: f64,
    /// Longest first step, in units of the domain; it may double with every step that succeeds.
    pub first_step: f64,
    /// Longest step.
    pub longest_step: f64,
    pub iterations: usize,
}

/// Result of a search.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewtonRoot {
    /// The point with the smallest residual that was found.
    pub x: Point,
    /// `|f(x) − y|`; infinite if no value was finite.
    pub residual: f64,
    /// The Jacobian at `x`, or unless `is_fresh` that at an earlier point near it.
    pub jacobian: Matrix3,
    pub is_fresh: bool,
    pub converged: bool,
}

impl NewtonRoot {
    /// Bound of the distance from `x` to the preimage, to first order.
    pub fn uncertainty(&self) -> f64 {
        let inverse = self.jacobian.try_inverse();
        self.residual * inverse.map_or(f64::INFINITY, |inverse| inverse.norm())
    }
}

/// Cost of a batch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NewtonEffort {
    /// Rounds of the batch.
    pub iterations: usize,
    /// Points at which the map was evaluated.
    pub evaluations: usize,
}

impl NewtonEffort {
    /// Adds the cost of further work.
    pub fn add(&mut self, next: Self) {
        self.iterations += next.iterations;
        self.evaluations += next.evaluations;
    }
}

/// Required decrease of the residual, as a fraction of what the step predicts.
const ARMIJO: f64 = 1e-4;
/// A search stops when its step is shorter than this fraction of the first.
const SHORTEST: f64 = 1e-9;
/// Determinant over the cube of the norm below which a Jacobian counts as singular, and the damping used then.
const SINGULAR: f64 = 1e-12;
const DAMPING: f64 = 1e-3;

struct NewtonSearch {
    y: Point,
    x: Point,
    residual: f64,
    jacobian: Matrix3,
    is_fresh: bool,
    /// The next step to try.
    step: Vector,
    /// Its length as a fraction of the Newton step's.
    fraction: f64,
    /// Longest length of the step after it.
    trust: f64,
    state: SearchState,
}

#[derive(Clone, Copy, PartialEq)]
enum SearchState {
    Running,
    /// So near that the Jacobian is kept: only values are needed.
    Near,
    Converged,
    Stuck,
}

/// Searches preimages from pairs `(y, seed)` of a point and a start.
pub(super) fn solve(
    map: &dyn VolumeMap,
    starts: &[(Point, Point)],
    limits: &NewtonLimits,
    should_continue: &dyn Fn() -> bool,
) -> (Vec<NewtonRoot>, NewtonEffort) {
    let mut searches: Vec<NewtonSearch> = starts
        .iter()
        .map(|&(y, seed)| NewtonSearch::new(y, seed, limits))
        .collect();
    let mut effort = NewtonEffort::default();
    while effort.iterations < limits.iterations && should_continue() {
        let (running, near) = split_by_need(&mut searches);
        if running.is_empty() && near.is_empty() {
            break;
        }
        effort.iterations += 1;
        effort.evaluations += running.len() + near.len();
        // Maps may take time to prepare, also for an empty list.
        if !running.is_empty() {
            let (images, jacobians) = map.evaluate_with_jacobian(&trials(&running));
            let found = running.into_par_iter().zip(images).zip(jacobians);
            found.for_each(|((search, image), jacobian)| search.take(image, Some(jacobian), limits));
        }
        if !near.is_empty() {
            let images = map.evaluate(&trials(&near));
            let found = near.into_par_iter().zip(images);
            found.for_each(|(search, image)| search.take(image, None, limits));
        }
    }
    (searches.iter().map(NewtonSearch::root).collect(), effort)
}

/// The searches that need a Jacobian, and those that need a value only.
fn split_by_need(searches: &mut [NewtonSearch]) -> (Vec<&mut NewtonSearch>, Vec<&mut NewtonSearch>) {
    let open = searches.iter_mut().filter(|search| !search.is_done());
    open.partition(|search| search.state == SearchState::Running)
}

fn trials(searches: &[&mut NewtonSearch]) -> Vec<Point> {
    searches.iter().map(|search| search.x + search.step).collect()
}

impl NewtonSearch {
    fn new(y: Point, seed: Point, limits: &NewtonLimits) -> Self {
        Self {
            y,
            x: seed,
            residual: f64::INFINITY,
            jacobian: Matrix3::zeros(),
            is_fresh: false,
            step: Vector::zeros(),
            fraction: 0.0,
            trust: limits.first_step,
            state: SearchState::Running,
        }
    }

    fn is_done(&self) -> bool {
        matches!(self.state, SearchState::Converged | SearchState::Stuck)
    }

    /// Continues with the value of the map at the point tried.
    fn take(&mut self, image: Point, jacobian: Option<Matrix3>, limits: &NewtonLimits) {
        let difference = image - self.y;
        let residual = difference.norm();
        let enough = (1.0 - ARMIJO * self.fraction) * self.residual;
        if residual >= enough || residual.is_nan() {
            self.retreat(limits);
            return;
        }
        let gain = residual / self.residual;
        self.x += self.step;
        self.residual = residual;
        self.jacobian = jacobian.unwrap_or(self.jacobian);
        self.is_fresh = jacobian.is_some();
        if residual <= limits.tolerance {
            self.state = SearchState::Converged;
            return;
        }
        // A kept Jacobian that gains little is evaluated anew.
        let near = residual <= limits.near && (jacobian.is_some() || gain < 0.05);
        self.state = if near { SearchState::Near } else { SearchState::Running };
        self.advance(&difference, limits);
    }

    fn advance(&mut self, difference: &Vector, limits: &NewtonLimits) {
        let step = newton_step(&self.jacobian, difference);
        let length = step.norm();
        if !length.is_finite() {
            self.state = SearchState::Stuck;
            return;
        }
        self.fraction = (self.trust / length).min(1.0);
        self.step = step * self.fraction;
        self.trust = (2.0 * self.trust).min(limits.longest_step);
    }

    fn retreat(&mut self, limits: &NewtonLimits) {
        self.step *= 0.5;
        self.fraction *= 0.5;
        self.trust = self.step.norm();
        self.state = if self.trust > SHORTEST * limits.first_step {
            SearchState::Running
        } else {
            SearchState::Stuck
        };
    }

    fn root(&self) -> NewtonRoot {
        NewtonRoot {
            x: self.x,
            residual: self.residual,
            jacobian: self.jacobian,
            is_fresh: self.is_fresh,
            converged: self.state == SearchState::Converged,
        }
    }
}

/// `−J⁻¹ r`, damped where `J` is singular.
fn newton_step(jacobian: &Matrix3, difference: &Vector) -> Vector {
    let norm = jacobian.norm();
    if jacobian.determinant().abs() > SINGULAR * norm.powi(3)
        && let Some(inverse) = jacobian.try_inverse()
    {
        return -(inverse * difference);
    }
    let damped = jacobian.transpose() * jacobian + Matrix3::identity() * (DAMPING * norm).powi(2);
    damped.try_inverse().map_or(Vector::repeat(f64::NAN), |inverse| {
        -(inverse * jacobian.transpose() * difference)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `x²` along the first axis.
    struct Square;

    impl VolumeMap for Square {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            points.iter().map(|p| Point::new(p.x * p.x, p.y, p.z)).collect()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            let at = |p: &Point| Matrix3::from_diagonal(&Vector::new(2.0 * p.x, 1.0, 1.0));
            points.iter().map(at).collect()
        }
    }

    /// From 0.5 to 0.3 with a residual of 1e-9, for which the last Jacobian may be kept, and of 1e-3, for which it may
    /// not.
    #[test]
    fn jacobians_said_to_be_fresh_are_those_at_the_root() {
        let start = [(Point::new(0.09, 0.0, 0.0), Point::new(0.5, 0.0, 0.0))];
        for (tolerance, near, fresh) in [(1e-9, 1e-2, false), (1e-3, 1e-5, true)] {
            let limits = NewtonLimits {
                tolerance,
                near,
                first_step: 1.0,
                longest_step: 1.0,
                iterations: 60,
            };
            let root = solve(&Square, &start, &limits, &|| true).0[0];
            let error = (root.jacobian[(0, 0)] - 2.0 * root.x.x).abs();
            assert!(
                root.converged && root.is_fresh == fresh && (error == 0.0) == fresh,
                "{error}"
            );
            assert!((root.x.x - 0.3).abs() <= 1.01 * root.uncertainty());
        }
    }
}
