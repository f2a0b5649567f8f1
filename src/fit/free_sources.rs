//! Free sources: their positions are unknowns, too (the extension that section 6 of the paper names).
//!
//! The sources start where they are placed as always. Levenberg-Marquardt steps of the positions then lower the residual,
//! with the coefficients eliminated ([`SeparableSystem`]); every step that is taken lowers it. Sources stay outside the domain
//! and clear of its surface ([`SourceRoom`]). The map is solved for with the final positions as with any others, and its error
//! is measured at points that had no part in this.

use serde::{Deserialize, Serialize};

use super::source_room::SourceRoom;
use super::{BoundaryError, FitError, FitMethod, FitReport, FitSize, Phase};
use crate::Point;
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressControl, ProgressSender, run_cancellable};
use crate::solver::{CollocationSystem, Projection, SeparableSystem, SolveError, Values};

/// Most sources that may be free. They do as well as several times as many fixed ones, but the time grows with the cube of their number:
/// 1000 take minutes, in which fits with fixed sources are done a hundred times over.
pub const MOST_FREE_SOURCES: usize = 1000;
/// Good number of collocation points for each free source. With few, sources go where no equation sees what they do between
/// the points.
pub const COLLOCATION_PER_FREE_SOURCE: f64 = 16.0;
/// Rounds after which the positions are left as they are.
const MOST_ROUNDS: usize = 30;
/// Part of the residual that a round is to take away. Going on to a fifth of that takes up to two and a half times as long, and lowers the
/// boundary error by 1 %.
const LEAST_GAIN: f64 = 0.01;
/// Consecutive rounds of less gain after which there are no more.
const ROUNDS_IN_VAIN: usize = 2;
/// The residual, as a fraction of the target's diagonal, that is zero but for rounding.
const ROUNDING: f64 = 1e-12;

/// What became of free sources.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FreeSourcesReport {
    /// Rounds that moved the sources.
    pub rounds: usize,
    /// Why there were no more.
    pub end: FreeSourcesEnd,
    /// What is minimised, before: the root mean square misfit at the collocation points, over the area, as a fraction of the
    /// target's diagonal.
    pub residual_before: f64,
    /// The same afterwards.
    pub residual_after: f64,
    /// The error at held-out points with the sources where they were placed.
    pub boundary_error_before: BoundaryError,
    /// Whether the map has the moved sources. It has not if its boundary error would be larger, as where there are too few
    /// collocation points.
    pub kept: bool,
}

/// Why free sources were not moved any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FreeSourcesEnd {
    /// The residual hardly fell any more.
    Converged,
    /// As many rounds as are made.
    Rounds,
    /// The progress callback asked for the best map so far
    /// ([`ProgressControl::Conclude`](crate::progress::ProgressControl::Conclude)).
    Concluded,
}

/// Positions that lower the residual, in the unit frame.
pub(super) struct FreedSources {
    pub positions: Vec<Point>,
    pub rounds: usize,
    pub end: FreeSourcesEnd,
    pub residual_before: f64,
    pub residual_after: f64,
}

impl FreedSources {
    /// The positions, and what became of them, beside the report of the map before. Whether they are kept is not known yet.
    pub fn of(self, before: &FitReport) -> (Vec<Point>, FreeSourcesReport) {
        let report = FreeSourcesReport {
            rounds: self.rounds,
            end: self.end,
            residual_before: self.residual_before,
            residual_after: self.residual_after,
            boundary_error_before: before.boundary_error,
            kept: false,
        };
        (self.positions, report)
    }
}

/// Refuses what takes too long for what it gains, and the Schwarz solver.
pub(super) fn require_worth(size: &FitSize) -> Result<(), FitError> {
    let (sources, most) = (size.sources, MOST_FREE_SOURCES);
    match size.method {
        FitMethod::Schwarz { .. } => Err(FitError::FreeSourcesNeedDense),
        FitMethod::Dense { .. } if sources > most => Err(FitError::TooManyFreeSources { sources, most }),
        FitMethod::Dense { .. } => Ok(()),
    }
}

/// Moves the sources of a system, in the unit frame, for boundary values at its collocation points, whose shares of the area are
/// `areas`. The `ridge` is that of [`SeparableSystem::new`].
pub(super) fn freed(
    domain: &SurfaceMesh,
    (system, areas): (&CollocationSystem, &[f64]),
    data: &Values,
    ridge: f64,
    progress: &dyn Fn(Phase) -> ProgressControl,
) -> Result<FreedSources, FitError> {
    let separable = SeparableSystem::new(system, data, ridge)?;
    let room = SourceRoom::new(domain, system.collocation, areas, system.sources)?;
    let descent = |sender: &ProgressSender<Phase>| Descent::start(&separable, &room, system.sources)?.run(sender);
    run_cancellable(progress, descent).unwrap_or(Err(FitError::Cancelled))
}

/// A descent in the positions.
struct Descent<'a> {
    system: &'a SeparableSystem<'a>,
    room: &'a SourceRoom<'a>,
    rows: usize,
    sources: Vec<Point>,
    projection: Projection,
    damping: f64,
}

/// The damping at the start, and the largest; beyond, steps are too short to matter.
const DAMPING: f64 = 0.1;
const MOST_DAMPING: f64 = 1e8;
/// By how much the damping rises when a step does not lower the residual, and falls when a step does as much as the model says.
const RISE: f64 = 8.0;
const FALL: f64 = 0.25;
/// A step is as good as the model says from this fraction of the predicted decrease on.
const GOOD: f64 = 0.75;

impl<'a> Descent<'a> {
    fn start(system: &'a SeparableSystem, room: &'a SourceRoom, sources: &[Point]) -> Result<Self, FitError> {
        Ok(Self {
            projection: system.project(sources)?,
            rows: system.rows(),
            sources: sources.to_vec(),
            damping: DAMPING,
            system,
            room,
        })
    }

    fn residual(&self) -> f64 {
        (2.0 * self.projection.objective() / self.rows as f64).sqrt()
    }

    fn run(mut self, sender: &ProgressSender<Phase>) -> Result<FreedSources, FitError> {
        let residual_before = self.residual();
        let (mut rounds, mut in_vain) = (0, 0);
        let end = loop {
            if in_vain == ROUNDS_IN_VAIN || self.residual() < ROUNDING {
                break FreeSourcesEnd::Converged;
            }
            if rounds == MOST_ROUNDS {
                break FreeSourcesEnd::Rounds;
            }
            let before = self.residual();
            let phase = Phase::MovingSources {
                round: rounds + 1,
                residual: before,
            };
            if sender.send(phase).is_break() {
                return Err(FitError::Cancelled);
            }
            if sender.should_conclude() {
                break FreeSourcesEnd::Concluded;
            }
            match self.descend(sender)? {
                true => rounds += 1,
                false if sender.should_conclude() => break FreeSourcesEnd::Concluded,
                false => break FreeSourcesEnd::Converged,
            }
            in_vain = match self.residual() < (1.0 - LEAST_GAIN) * before {
                true => 0,
                false => in_vain + 1,
            };
        };
        Ok(FreedSources {
            residual_after: self.residual(),
            positions: self.sources,
            rounds,
            end,
            residual_before,
        })
    }

    /// Takes a step that lowers the objective; `false` where there is none.
    fn descend(&mut self, sender: &ProgressSender<Phase>) -> Result<bool, FitError> {
        let should_improve = || sender.should_improve();
        let model = match self.system.linearise(&self.sources, &self.projection, &should_improve) {
            Err(SolveError::Cancelled) if sender.should_continue() => return Ok(false),
            model => model?,
        };
        let distances = self.room.distances(&self.sources);
        while self.damping <= MOST_DAMPING {
            if !sender.should_continue() {
                return Err(FitError::Cancelled);
            }
            if sender.should_conclude() {
                return Ok(false);
            }
            if let Some((steps, predicted)) = model.step(self.damping, &distances) {
                let moved = self.room.moved(&self.sources, &distances, &steps);
                let next = match self.system.project(&moved) {
                    // Two sources at the same place are no obstacle, since there is a ridge; one at a collocation point is.
                    Err(SolveError::NonFinite { .. }) => None,
                    next => Some(next?),
                };
                if let Some(next) = next.filter(|next| next.objective() < self.projection.objective()) {
                    let decrease = self.projection.objective() - next.objective();
                    (self.sources, self.projection) = (moved, next);
                    if decrease > GOOD * predicted {
                        self.damping *= FALL;
                    }
                    return Ok(true);
                }
            }
            self.damping *= RISE;
        }
        Ok(false)
    }
}
