//! More sources where the boundary error is too large, until the tolerance is met.

use super::FitError;
use super::frame::Frame;
use super::levels::placed_level;
use crate::geometry::SurfaceQuery;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::{Anchors, Cells, SiteLevel};
use crate::solver::Level;

/// Cells whose error exceeds this part of the tolerance are refined: halving the spacing more than halves the error.
const MARKED: f64 = 0.6;
/// Part of the area that is refined at least.
const LEAST_AREA: f64 = 0.01;
/// Points at which the error is estimated, at least one in each cell.
const PROBES: usize = 30_000;

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
        let marked = self.marked(domain, tolerance, seed, errors_at);
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

    fn marked(
        &mut self,
        domain: &SurfaceMesh,
        tolerance: f64,
        seed: u64,
        errors_at: &dyn Fn(&[SurfacePoint]) -> Vec<f64>,
    ) -> Vec<bool> {
        self.rounds += 1;
        let per_cell = PROBES.div_ceil(self.cells.len().max(1));
        let (points, cell_of) = self.cells.probes(per_cell, seed.wrapping_add(self.rounds));
        let mut worst = vec![0.0f64; self.cells.len()];
        for (error, cell) in errors_at(&points).iter().zip(cell_of) {
            worst[cell as usize] = worst[cell as usize].max(*error);
        }
        let threshold = self.largest(&worst, LEAST_AREA).min(MARKED * tolerance);
        let marked: Vec<bool> = worst.iter().map(|&error| error >= threshold && error > 0.0).collect();
        self.cells.grow(domain, &marked)
    }

    /// The error that this part of the area exceeds.
    fn largest(&self, worst: &[f64], part: f64) -> f64 {
        let mut order: Vec<usize> = (0..worst.len()).collect();
        order.sort_unstable_by(|&a, &b| worst[b].total_cmp(&worst[a]).then(a.cmp(&b)));
        let wanted = part * (0..worst.len()).map(|cell| self.cells.area(cell)).sum::<f64>();
        let mut area = 0.0;
        for cell in order {
            area += self.cells.area(cell);
            if area >= wanted {
                return worst[cell];
            }
        }
        0.0
    }
}
