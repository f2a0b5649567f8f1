//! Sliding of a few boundary nodes along the target, where the boundary map folds quads and moving inner nodes cannot
//! help.

use super::foldover::FoldoverEnergy;
use super::lbfgs::{Lbfgs, Pull, StoppingRule, TangentConstraint};
use super::repair::{Best, next_epsilon};
use crate::geometry::SurfaceQuery;
use crate::mesh::SurfaceMesh;
use crate::progress::ProgressSender;
use crate::{Point, Vector};

/// Rings of cells around inverted ones whose boundary nodes slide, at first and at most.
const FIRST_RINGS: usize = 2;
const MAX_RINGS: usize = 6;
/// Largest part of the boundary nodes that may slide: if all did, the result would no longer follow the boundary map.
const MAX_SLIDING_PART: f64 = 0.1;
/// Rounds without fewer inverted corners after which another ring slides.
const MAX_STALLED: usize = 4;
/// Iterations before nodes are projected back to the target.
const ROUND: StoppingRule = StoppingRule {
    iterations: 40,
    gain: 1e-5,
    until_positive: true,
};
/// Stiffness of the springs that hold sliding nodes: to slide by a whole cell costs this many times the mean energy of
/// a cell.
const STIFFNESS: f64 = 100.0;

/// How boundary nodes slid.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct SlideReport {
    /// Boundary nodes that were free to slide.
    pub nodes: usize,
    /// Rounds of descent in tangent planes and projection to the target.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
}

/// Stiffness of the springs in a mesh of `cells` cells, with boundary edges of length `edge`.
pub(super) fn stiffness(cells: usize, edge: f64) -> f64 {
    STIFFNESS / (cells as f64 * edge * edge)
}

/// The surface that nodes slide on.
pub(super) struct SlidingSurface<'a> {
    pub target: &'a SurfaceMesh,
    pub query: SurfaceQuery,
    /// Stiffness of the springs that hold sliding nodes, in units of the whole energy.
    pub stiffness: f64,
}

/// What slides, and how.
pub(super) struct Sliding<'a> {
    pub energy: &'a FoldoverEnergy,
    /// Largest displacement of a node in a first step.
    pub step: f64,
    pub surface: &'a SlidingSurface<'a>,
    pub on_boundary: &'a [bool],
    /// Iterations after which no further round begins.
    pub most_iterations: usize,
    pub monitor: &'a ProgressSender<'a, (usize, usize)>,
}

impl Sliding<'_> {
    /// Lets boundary nodes near inverted cells slide on the target until no cell is inverted or sliding stops helping.
    /// Inner nodes move with them.
    pub fn run(&self, x: &mut Vec<Point>) -> SlideReport {
        let (energy, on_boundary) = (self.energy, self.on_boundary);
        let mut report = SlideReport::default();
        let start = x.clone();
        let bad = energy.inverted(x);
        let (mut best, mut rings) = (Best::new(bad.len(), x), FIRST_RINGS);
        let mut epsilon = 1.0;
        let mut sliding = near(energy, &bad, rings, on_boundary);
        let most = MAX_SLIDING_PART * on_boundary.iter().filter(|is| **is).count() as f64;
        let mut slid = 0;
        let may_go_on = |iterations: usize| self.monitor.should_continue() && iterations < self.most_iterations;
        while best.inverted > 0 && may_go_on(report.iterations) && rings <= MAX_RINGS && sliding.len() as f64 <= most {
            slid = sliding.len();
            let free: Vec<u32> = (0..x.len() as u32)
                .filter(|&v| !on_boundary[v as usize] || sliding.binary_search(&v).is_ok())
                .collect();
            let mut descent = Lbfgs::new(energy, &free, self.step, self.monitor);
            descent.constraints = self.surface.constraints(x, &start, &free, on_boundary);
            let (value, iterations) = descent.run(x, epsilon, &ROUND);
            report.rounds += 1;
            report.iterations += iterations;
            self.surface.project(x, &sliding);
            epsilon = next_epsilon(epsilon, value.least);
            best.update(energy.inverted(x).len(), x);
            if best.stalled == MAX_STALLED {
                (best.stalled, rings, epsilon) = (0, rings + 1, 1.0);
                x.clone_from(&best.nodes);
                sliding = near(energy, &energy.inverted(x), rings, on_boundary);
            }
        }
        *x = best.nodes;
        report.nodes = slid;
        report
    }
}

/// Boundary nodes within `rings` rings of these cells, ascending.
fn near(energy: &FoldoverEnergy, cells: &[u32], rings: usize, on_boundary: &[bool]) -> Vec<u32> {
    let mut nodes = energy.rings(cells, rings);
    nodes.retain(|&v| on_boundary[v as usize]);
    nodes
}

impl SlidingSurface<'_> {
    /// For the boundary nodes among the free ones, the tangent planes of the target and springs to their start.
    fn constraints(&self, x: &[Point], start: &[Point], free: &[u32], on_boundary: &[bool]) -> Vec<TangentConstraint> {
        let sliding = free.iter().enumerate().filter(|(_, v)| on_boundary[**v as usize]);
        let constraint = |(free, &v): (usize, &u32)| {
            let found = self.query.closest_point(&x[v as usize]);
            let area = self.target.area_vector(found.triangle);
            TangentConstraint {
                free,
                normal: area.try_normalize(0.0).unwrap_or_else(Vector::zeros),
                along: None,
                anchor: start[v as usize],
                stiffness: self.stiffness,
                pull: Pull::none(x[v as usize]),
            }
        };
        sliding.map(constraint).collect()
    }

    fn project(&self, x: &mut [Point], slid: &[u32]) {
        for &v in slid {
            x[v as usize] = self.query.closest_point(&x[v as usize]).point;
        }
    }
}
