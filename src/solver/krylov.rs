//! Flexible minimisation of a residual over given directions, one after the other: GCR (Eisenstat, Elman, Schultz,
//! *Variational iterative methods for nonsymmetric systems of linear equations*, SIAM J. Numer. Anal. 20, 1983), which
//! has the iterates of flexible GMRES. It lives in the space of the data, where a rectangular system has its residual,
//! as the AB-GMRES of Hayami, Yin and Ito (*GMRES methods for least squares problems*, SIAM J. Matrix Anal. Appl. 31,
//! 2010); the preconditioner may change from step to step.

use super::Values;

/// Directions kept; older ones are dropped.
const MOST_DIRECTIONS: usize = 24;

/// Right-hand sides in lock-step: each column has its own step lengths, all share directions' cost.
pub(super) struct Minimisation<'a> {
    weights: &'a [f64],
    /// Data minus the images of the solution.
    pub residual: Values,
    /// What the steps taken sum to.
    pub solution: Values,
    directions: Vec<Direction>,
}

struct Direction {
    step: Values,
    image: Values,
    /// Squared norms of the image's columns.
    squares: Vec<f64>,
}

impl<'a> Minimisation<'a> {
    /// Starts at a solution with this residual; norms are weighted by `weights`, one per row of the residual.
    pub fn new(weights: &'a [f64], residual: Values, solution: Values) -> Self {
        Self {
            weights,
            residual,
            solution,
            directions: Vec::new(),
        }
    }

    /// Goes along a step, whose image under the system's matrix is `image`, to the least residual over it and all the
    /// directions before.
    pub fn advance(&mut self, mut step: Values, mut image: Values) {
        for known in &self.directions {
            let overlap = image.dot(&known.image, self.weights);
            let factors = ratios(&overlap, &known.squares, -1.0);
            image.add_scaled(&factors, &known.image);
            step.add_scaled(&factors, &known.step);
        }
        let squares = image.dot(&image, self.weights);
        let lengths = ratios(&self.residual.dot(&image, self.weights), &squares, 1.0);
        let back: Vec<f64> = lengths.iter().map(|l| -l).collect();
        self.residual.add_scaled(&back, &image);
        self.solution.add_scaled(&lengths, &step);
        if self.directions.len() == MOST_DIRECTIONS {
            self.directions.remove(0);
        }
        self.directions.push(Direction { step, image, squares });
    }

    /// Starts anew from the present solution, whose residual was computed afresh.
    pub fn restart(&mut self, residual: Values) {
        self.residual = residual;
        self.directions.clear();
    }

    /// Squared norm of the residual, column by column.
    pub fn squares(&self) -> Vec<f64> {
        self.residual.dot(&self.residual, self.weights)
    }
}

/// `sign · a / b`, zero where `b` is.
fn ratios(a: &[f64], b: &[f64], sign: f64) -> Vec<f64> {
    let ratio = |(a, b): (&f64, &f64)| if *b > 0.0 { sign * a / b } else { 0.0 };
    a.iter().zip(b).map(ratio).collect()
}
