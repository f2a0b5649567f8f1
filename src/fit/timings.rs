use std::time::Instant;

/// Wall time by phase, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct FitTimings {
    /// Everything.
    pub total: f64,
    /// Checking the domain and placing points.
    pub sampling: f64,
    /// Factoring the system: patches of the Schwarz solver, or assembling and decomposing a dense matrix.
    pub factor: f64,
    /// Solving for the boundary data, by iterations or by the decomposition; moving free sources, if there are any.
    pub solve: f64,
    /// Measuring the boundary error.
    pub check: f64,
}

impl FitTimings {
    /// The timings of a factorisation with those of solving and measuring added.
    pub(super) fn with(self, solve: f64, check: f64) -> Self {
        let (solve, check) = (self.solve + solve, self.check + check);
        Self {
            total: self.sampling + self.factor + solve + check,
            solve,
            check,
            ..self
        }
    }
}

/// Measures the phases of a fit one after the other.
pub(super) struct Stopwatch(Instant);

impl Stopwatch {
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Seconds since the start or the latest lap.
    pub fn lap(&mut self) -> f64 {
        let seconds = self.0.elapsed().as_secs_f64();
        self.0 = Instant::now();
        seconds
    }
}
