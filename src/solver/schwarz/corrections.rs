//! Corrections by groups of levels, and what they give at the collocation points.

use std::ops::Range;

use super::{LevelGroup, LevelSolver, SchwarzFactor};
use crate::Point;
use crate::kernel::Sums;
use crate::solver::krylov::Gcr;
use crate::solver::{SolveError, Values, affine_functions};

/// The values that later groups contribute are small, so their sums may be less accurate by this factor.
const LATER_GROUPS: f64 = 10.0;

impl SchwarzFactor {
    /// The correction by a group for a residual, as coefficients of all unknowns.
    pub(super) fn correction(
        &self,
        group: &LevelGroup,
        residual: &Values,
        accuracy: f64,
    ) -> Result<Values, SolveError> {
        let columns = residual.columns();
        let last = group.steps.len();
        let remaining = residual.gather(&self.levels[group.first + last].rows);
        let solved = self.correct_level(group, last, remaining, accuracy)?;
        let own = self.entries_of(group, columns);
        let (coefficients, affine) = solved.as_slice().split_at(own.len());
        let mut all = vec![0.0; self.unknowns() * columns];
        all[own].copy_from_slice(coefficients);
        if !affine.is_empty() {
            all[self.sources() * columns..].copy_from_slice(affine);
        }
        Ok(Values::new(columns, all))
    }

    /// Coefficients of the group's levels up to this one (and of the affine functions, in the first group) for a
    /// residual at this level's rows, by a few iterations of the same kind as those of the whole system.
    fn correct_level(
        &self,
        group: &LevelGroup,
        index: usize,
        residual: Values,
        accuracy: f64,
    ) -> Result<Values, SolveError> {
        let level = &self.levels[group.first + index];
        let columns = residual.columns();
        let patches = match &level.solver {
            LevelSolver::Dense(dense) => return dense.solve_columns(&residual),
            LevelSolver::Patches(patches) => patches,
        };
        if index == 0 {
            return Ok(patches.solve(&residual));
        }
        let step = &group.steps[index - 1];
        let coarser: usize = self.levels[group.first..group.first + index]
            .iter()
            .map(|level| level.sources)
            .sum();
        let affine = self.affine_functions();
        let unknowns = coarser + level.sources + affine;
        let mut gcr = Gcr::new(&level.weights, residual, Values::zeros(unknowns, columns));
        for iteration in 0..self.options.coarse_iterations {
            let accuracy = if iteration == 0 {
                accuracy
            } else {
                accuracy.max(self.options.later_accuracy)
            };
            let remaining = gcr.residual.gather(&step.coarser_rows);
            let solved = self.correct_level(group, index - 1, remaining, accuracy)?;
            let (own, linear) = solved.as_slice().split_at(coarser * columns);
            let potential = step.from_coarser.with_accuracy(accuracy).potential(own, columns)?;
            let mut image = Values::new(columns, potential);
            self.add_affine(&mut image, linear, |r| self.collocation[level.rows[r] as usize]);
            let gap = vec![0.0; level.sources * columns];
            gcr.advance(Values::new(columns, [own, &gap, linear].concat()), image);

            let solved = patches.solve(&gcr.residual);
            let own = step.from_own.with_accuracy(accuracy.max(self.options.later_accuracy));
            let image = Values::new(columns, own.potential(solved.as_slice(), columns)?);
            let (gap, no_affine) = (vec![0.0; coarser * columns], vec![0.0; affine * columns]);
            let correction = [&gap, solved.as_slice(), &no_affine].concat();
            gcr.advance(Values::new(columns, correction), image);
        }
        Ok(gcr.solution)
    }

    /// Where the coefficients of a group's sources are among those of all unknowns.
    fn entries_of(&self, group: &LevelGroup, columns: usize) -> Range<usize> {
        let before: usize = self.levels[..group.first].iter().map(|level| level.sources).sum();
        before * columns..(before + group.sources.len()) * columns
    }

    /// Values at the collocation points of the group's part of the coefficients, and of the affine functions in the
    /// first group.
    pub(super) fn image(&self, group: &LevelGroup, coefficients: &Values, accuracy: f64) -> Result<Values, SolveError> {
        let columns = coefficients.columns();
        let weights = &coefficients.as_slice()[self.entries_of(group, columns)];
        let sums = group.to_collocation.with_accuracy(accuracy);
        let mut image = Values::new(columns, sums.potential(weights, columns)?);
        if group.first == 0 && self.affine {
            let affine = &coefficients.as_slice()[self.sources() * columns..];
            self.add_affine(&mut image, affine, |r| self.collocation[r]);
        }
        Ok(image)
    }

    fn add_affine(&self, values: &mut Values, affine: &[f64], point: impl Fn(usize) -> Point) {
        if affine.is_empty() {
            return;
        }
        let columns = values.columns();
        for r in 0..values.rows() {
            let p = point(r);
            for (k, value) in values.row_mut(r).iter_mut().enumerate() {
                let a = |function: usize| affine[function * columns + k];
                *value += a(0) + a(1) * p.x + a(2) * p.y + a(3) * p.z;
            }
        }
    }

    /// Data minus the values of all coefficients, to a relative accuracy of the sums.
    pub(super) fn residual(&self, data: &Values, coefficients: &Values, accuracy: f64) -> Result<Values, SolveError> {
        let mut residual = data.clone();
        for group in &self.groups {
            let accuracy = accuracy * if group.first == 0 { 1.0 } else { LATER_GROUPS };
            let image = self.image(group, coefficients, accuracy)?;
            residual.add_scaled(&vec![-1.0; data.columns()], &image);
        }
        Ok(residual)
    }

    /// `Aᵀ W r` for all unknowns.
    pub(super) fn gradient(&self, transposed: &Sums, residual: &Values) -> Result<Values, SolveError> {
        let columns = residual.columns();
        let weighted: Vec<f64> = (0..self.rows())
            .flat_map(|r| residual.row(r).iter().map(move |value| self.weights[r] * value))
            .collect();
        let mut gradient = transposed.potential(&weighted, columns)?;
        if self.affine {
            let mut sums = vec![0.0; 4 * columns];
            for (row, p) in weighted.chunks_exact(columns).zip(&self.collocation) {
                for (k, value) in row.iter().enumerate() {
                    for (function, factor) in affine_functions(p).into_iter().enumerate() {
                        sums[function * columns + k] += factor * value;
                    }
                }
            }
            gradient.extend(sums);
        }
        Ok(Values::new(columns, gradient))
    }

    /// The solution of the patches' normal equations for a gradient; `None` for a group of several levels.
    pub(super) fn gradient_correction(&self, group: &LevelGroup, gradient: &Values) -> Option<Values> {
        if !group.steps.is_empty() {
            return None;
        }
        let columns = gradient.columns();
        let own = self.entries_of(group, columns);
        let (all, affine) = (gradient.as_slice(), self.sources() * columns..);
        let mut step = vec![0.0; all.len()];
        match &self.levels[group.first].solver {
            LevelSolver::Patches(patches) => {
                let solved = patches.solve_gradient(&Values::new(columns, all[own.clone()].to_vec()));
                step[own].copy_from_slice(solved.as_slice());
            }
            LevelSolver::Dense(dense) => {
                let gradient = [&all[own.clone()], &all[affine.clone()]].concat();
                let solved = dense.solve_normal(&Values::new(columns, gradient))?;
                let (coefficients, linear) = solved.as_slice().split_at(own.len());
                step[own].copy_from_slice(coefficients);
                step[affine].copy_from_slice(linear);
            }
        }
        Some(Values::new(columns, step))
    }
}
