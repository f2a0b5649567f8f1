//! A step of its own length for every vertex.
//!
//! One length for all is that of the worst place: a few dozen triangles that soon become flat, or where the energy bends up, hold
//! back all others. Here they hold back their own vertices, and the neighbours of these, less with every ring.

use rayon::prelude::*;

use super::{ARMIJO, AcceptedStep, SHARE_OF_LONGEST, determinant_along, first_root};
use crate::Vector;
use crate::spherical::distortion_energy::{Objective, is_positive};

/// Trials before the step is given up.
const MOST_TRIALS: usize = 12;
/// The shares of the corners of a triangle differ by at most this factor: where they differ more, the step shears.
const MOST_GRADED: f64 = 2.0;
/// Rounds of grading; each goes one ring farther, or several.
const MOST_ROUNDS: usize = 30;
/// Triangles hold back their corners when their energies rise by more than this share of the largest rise.
const RISEN: f64 = 0.1;

/// What a step starts from.
pub(super) struct LocalStep<'a, E> {
    pub energy: &'a E,
    pub x: &'a [Vector],
    /// The whole step of every vertex.
    pub tangent: &'a [Vector],
    /// The slope of the energy along the step of each vertex.
    pub slopes: &'a [f64],
    pub before: f64,
}

impl<E: Objective> LocalStep<'_, E> {
    /// A step that lowers the energy by a share of what its slope promises, if one is found.
    pub fn taken(&self) -> Option<AcceptedStep> {
        let mut shares = self.shares_to_flips();
        let mut values_before = None;
        for _ in 0..MOST_TRIALS {
            self.grade(&mut shares);
            let directions = self.moved(&shares);
            let flipped = self.triangles_where(|t| !is_positive(&self.energy.corners(t, &directions)));
            if !flipped.is_empty() {
                self.hold_back(&flipped, &mut shares);
                continue;
            }
            let values = self.energy.values(&directions)?;
            let after: f64 = values.iter().sum();
            let slope: f64 = self.slopes.iter().zip(&shares).map(|(slope, share)| slope * share).sum();
            if slope < 0.0 && after < self.before && after <= self.before + ARMIJO * slope {
                return Some(AcceptedStep {
                    directions,
                    energy: after,
                });
            }
            if values_before.is_none() {
                values_before = self.energy.values(self.x);
            }
            let rise = |t: usize| values[t] - values_before.as_ref().map_or(f64::INFINITY, |before| before[t]);
            let largest = (0..values.len()).map(rise).fold(0.0, f64::max);
            let risen = self.triangles_where(|t| rise(t) > RISEN * largest);
            if risen.is_empty() {
                return None;
            }
            self.hold_back(&risen, &mut shares);
        }
        None
    }

    /// Shares of the step before a triangle of the vertex becomes flat, if the others moved as far.
    fn shares_to_flips(&self) -> Vec<f64> {
        let triangles = self.energy.triangles().par_iter().enumerate();
        let to_flips: Vec<f64> = triangles
            .map(|(i, t)| {
                let corners = self.energy.corners(i, self.x);
                first_root(&determinant_along(&corners, &t.map(|v| self.tangent[v as usize])))
            })
            .collect();
        let mut shares = vec![1.0f64; self.x.len()];
        for (t, to_flip) in self.energy.triangles().iter().zip(to_flips) {
            for &v in t {
                shares[v as usize] = shares[v as usize].min(SHARE_OF_LONGEST * to_flip);
            }
        }
        shares
    }

    fn grade(&self, shares: &mut [f64]) {
        for _ in 0..MOST_ROUNDS {
            let mut has_changed = false;
            for t in self.energy.triangles() {
                let most = MOST_GRADED * t.map(|v| shares[v as usize]).into_iter().fold(f64::INFINITY, f64::min);
                for &v in t {
                    if shares[v as usize] > most {
                        shares[v as usize] = most;
                        has_changed = true;
                    }
                }
            }
            if !has_changed {
                break;
            }
        }
    }

    fn moved(&self, shares: &[f64]) -> Vec<Vector> {
        let curvature = self.energy.curvature();
        let moved = |((x, u), share): ((&Vector, &Vector), &f64)| match *u == Vector::zeros() {
            true => *x,
            false => curvature.step(x, &(u * *share)),
        };
        self.x.par_iter().zip(self.tangent).zip(shares).map(moved).collect()
    }

    fn triangles_where(&self, is: impl Fn(usize) -> bool + Sync) -> Vec<usize> {
        let all = (0..self.energy.triangles().len()).into_par_iter();
        all.filter(|&t| is(t)).collect()
    }

    fn hold_back(&self, triangles: &[usize], shares: &mut [f64]) {
        let mut corners: Vec<u32> = triangles.iter().flat_map(|&t| self.energy.triangles()[t]).collect();
        corners.sort_unstable();
        corners.dedup();
        for v in corners {
            shares[v as usize] *= 0.25;
        }
    }
}
