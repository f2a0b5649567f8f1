//! More sources where the boundary error is too large, until the tolerance is met.

use super::FitError;
use super::frame::Frame;
use super::levels::placed_level;
use crate::geometry::SurfaceQuery;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::{Anchors, Cells, SiteLevel};
use crate::solver::Level;

/// Part of the area that may go on exceeding the tolerance: less than the hundredth that [`BoundaryError::p99`] allows, since new
/// sources do not make all of the refined area right.
///
/// [`BoundaryError::p99`]: super::BoundaryError
const LEFT_OUT: f64 = 0.003;
/// Points at which the error is estimated, at least one in each cell.
const PROBES: usize = 50_000;

/// The domain's surface cut into cells that know how finely the sources stand there.
pub(super) struct Grading {
    cells: Cells,
    query: SurfaceQuery,
    alpha: f64,
    rounds: u64,
}

/// New points of the surface with their areas, and the sources that are to be fitted to them.
pub(super) struct Finer {
    pub points: Vec<SurfacePoint>,
    pub areas: Vec<f64>,
    pub level: Level,
}

impl Grading {
    pub fn new(domain: &SurfaceMesh, anchors: &Anchors, alpha: f64) -> Result<Self, FitError> {
        Ok(Self {
            cells: Cells::of_anchors(domain, anchors),
            query: SurfaceQuery::with_winding_sign(domain)?,
            alpha,
            rounds: 0,
        })
    }

    /// Refines where `errors_at` some points (fractions of the target's diagonal) are too large for the tolerance.
    /// `rows` is the number of collocation points so far; the level's rows follow on it. `None` when there is nothing to refine
    /// or no new source finds a place.
    pub fn refine(
        &mut self,
        domain: &SurfaceMesh,
        frame: &Frame,
        tolerance: f64,
        rows: usize,
        seed: u64,
        errors_at: &dyn Fn(&[SurfacePoint]) -> Vec<f64>,
    ) -> Option<Finer> {
        let marked = self.marked(tolerance, seed, errors_at);
        let refinement = self.cells.refine(domain, &marked);
        let sites = SiteLevel {
            rows: (rows as u32..).take(refinement.owner.len()).collect(),
            owner: refinement.owner,
            areas: refinement.collocation.areas.clone(),
            sites: refinement.sites,
        };
        let (level, _) = placed_level(&sites, self.alpha, &self.query, frame);
        (!level.sources.is_empty()).then_some(Finer {
            points: refinement.collocation.points,
            areas: refinement.collocation.areas,
            level,
        })
    }

    /// The cells to refine so that all but a little of the area that errs too much is refined.
    fn marked(&mut self, tolerance: f64, seed: u64, errors_at: &dyn Fn(&[SurfacePoint]) -> Vec<f64>) -> Vec<bool> {
        self.rounds += 1;
        let per_cell = PROBES.div_ceil(self.cells.len().max(1));
        let (points, cell_of) = self.cells.probes(per_cell, seed.wrapping_add(self.rounds));
        // Of each cell, the area on which the error is too large, and the largest error.
        let mut excess = vec![(0.0, 0.0f64); self.cells.len()];
        for (error, cell) in errors_at(&points).into_iter().zip(cell_of) {
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
        let mut marked = vec![false; excess.len()];
        // The worst cell at least, though the probes met no error that is too large.
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
