//! More sources where the boundary error is too large, until the tolerance is met.

use super::levels::placed_level;
use super::{FitError, FitOptions};
use crate::geometry::SurfaceQuery;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::{Anchors, SiteLevel, SurfaceCells};
use crate::solver::Level;

/// Fraction of the area left unrefined though the error there exceeds the tolerance: less than the hundredth that
/// [`BoundaryError::p99`] allows, since the error stays too large on some of the refined area.
///
/// [`BoundaryError::p99`]: super::BoundaryError
const LEFT_OUT: f64 = 0.003;
/// Points at which the error is estimated, at least one in each cell.
const PROBES: usize = 50_000;

/// Adds sources round by round, in cells of the surface that record the spacing of their sources.
pub(super) struct Refiner {
    cells: SurfaceCells,
    query: SurfaceQuery,
    alpha: f64,
    rounds: u64,
}

/// A finer level of sources, and its collocation points with their areas.
pub(super) struct FinerLevel {
    pub points: Vec<SurfacePoint>,
    pub areas: Vec<f64>,
    pub level: Level,
}

impl Refiner {
    pub fn new(domain: &SurfaceMesh, anchors: &Anchors, alpha: f64) -> Result<Self, FitError> {
        Ok(Self {
            cells: SurfaceCells::of_anchors(domain, anchors),
            query: SurfaceQuery::with_winding_sign(domain)?,
            alpha,
            rounds: 0,
        })
    }

    /// The level to add where `errors_at` points of the boundary, as fractions of the target's diagonal, exceed the
    /// tolerance. `rows` is the number of collocation points so far; the new ones follow. `None` when no new source finds a
    /// place.
    pub fn refine(
        &mut self,
        domain: &SurfaceMesh,
        rows: usize,
        options: &FitOptions,
        errors_at: &dyn Fn(&[SurfacePoint]) -> Vec<f64>,
        spacing_at: &dyn Fn(&SurfacePoint) -> Option<f64>,
    ) -> Option<FinerLevel> {
        let marked = self.marked(options, errors_at, spacing_at);
        let refinement = self.cells.refine(domain, &marked);
        let sites = SiteLevel {
            rows: (rows as u32..).take(refinement.owner.len()).collect(),
            owner: refinement.owner,
            areas: refinement.collocation.areas.clone(),
            sites: refinement.sites,
        };
        let (level, _) = placed_level(&sites, self.alpha, &self.query);
        (!level.sources.is_empty()).then_some(FinerLevel {
            points: refinement.collocation.points,
            areas: refinement.collocation.areas,
            level,
        })
    }

    /// Marks the cells with the most area where the error exceeds the tolerance, until at most [`LEFT_OUT`] of the
    /// whole area is left; and all where it exceeds a limit on the largest error.
    fn marked(
        &mut self,
        options: &FitOptions,
        errors_at: &dyn Fn(&[SurfacePoint]) -> Vec<f64>,
        spacing_at: &dyn Fn(&SurfacePoint) -> Option<f64>,
    ) -> Vec<bool> {
        let tolerance = options.tolerance;
        let limit = options.max_error_ratio * tolerance;
        self.rounds += 1;
        let per_cell = PROBES.div_ceil(self.cells.len().max(1));
        let (points, cell_of) = self.cells.probes(per_cell, options.seed.wrapping_add(self.rounds));
        // For each cell, the area on which the error is too large, and the largest error.
        let mut excess = vec![(0.0, 0.0f64); self.cells.len()];
        let local_limit = |point| match spacing_at(point) {
            Some(spacing) if options.max_local_error.is_finite() => options.max_local_error * spacing,
            _ => f64::INFINITY,
        };
        let limits = points.iter().map(|point| limit.min(local_limit(point)));
        let mut marked = vec![false; self.cells.len()];
        for ((error, limit), cell) in errors_at(&points).into_iter().zip(limits).zip(cell_of) {
            marked[cell as usize] |= error > limit;
            let (area, worst) = &mut excess[cell as usize];
            *worst = worst.max(error);
            if error > tolerance {
                *area += self.cells.area(cell as usize) / per_cell as f64;
            }
        }
        let mut order: Vec<usize> = (0..excess.len()).collect();
        order.sort_unstable_by(|&a, &b| {
            let ((area_a, worst_a), (area_b, worst_b)) = (excess[a], excess[b]);
            area_b
                .total_cmp(&area_a)
                .then(worst_b.total_cmp(&worst_a))
                .then(a.cmp(&b))
        });
        let total: f64 = (0..excess.len()).map(|cell| self.cells.area(cell)).sum();
        let mut left = excess.iter().map(|(area, _)| area).sum::<f64>();
        // At least the worst cell, even if the error is not too large at any probe.
        for (rank, cell) in order.into_iter().enumerate() {
            if rank > 0 && left <= LEFT_OUT * total {
                break;
            }
            marked[cell] = true;
            left -= excess[cell].0;
        }
        marked
    }
}
