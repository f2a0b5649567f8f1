//! GCR, flexible minimisation of a residual over given directions one after the other (Eisenstat, Elman, Schultz,
//! *Variational iterative methods for nonsymmetric systems of linear equations*, SIAM J. Numer. Anal. 20, 1983), with
//! the iterates of flexible GMRES. Directions are orthogonalised in the space of the data, as a rectangular system
//! requires; compare the AB-GMRES of Hayami, Yin and Ito (*GMRES methods for least squares problems*, SIAM J. Matrix
//! Anal. Appl. 31, 2010); the preconditioner may change from step to step.

use super::Values;

/// Directions kept; older ones are dropped.
const MOST_DIRECTIONS: usize = 24;

/// A direction whose squared image is below this fraction of the squared residual consists of rounding errors, as when
/// a level has nothing left to correct. A step along it would make the result depend on the order of summation.
const NOISE: f64 = 1e-12;

/// The minimisation for several right-hand sides at a time: each column has its own step lengths.
pub(super) struct Gcr<'a> {
    weights: &'a [f64],
    /// Data minus the images of the solution.
    pub residual: Values,
    /// The sum of all steps.
    pub solution: Values,
    directions: Vec<Direction>,
}

struct Direction {
    step: Values,
    image: Values,
    /// Squared norms of the image's columns.
    squares: Vec<f64>,
}

impl<'a> Gcr<'a> {
    /// Starts at a solution with this residual; norms are weighted by `weights`, one per row of the residual.
    pub fn new(weights: &'a [f64], residual: Values, solution: Values) -> Self {
        Self {
            weights,
            residual,
            solution,
            directions: Vec::new(),
        }
    }

    /// Adds a direction with its image under the system's matrix, and minimises the residual over it and all directions
    /// before.
    pub fn advance(&mut self, mut step: Values, mut image: Values) {
        for earlier in &self.directions {
            let overlap = image.dot(&earlier.image, self.weights);
            let factors = ratios(&overlap, &earlier.squares, -1.0);
            image.add_scaled(&factors, &earlier.image);
            step.add_scaled(&factors, &earlier.step);
        }
        let mut squares = image.dot(&image, self.weights);
        for (square, left) in squares.iter_mut().zip(self.squares()) {
            if *square < NOISE * left {
                *square = 0.0;
            }
        }
        let lengths = ratios(&self.residual.dot(&image, self.weights), &squares, 1.0);
        let back: Vec<f64> = lengths.iter().map(|l| -l).collect();
        self.residual.add_scaled(&back, &image);
        self.solution.add_scaled(&lengths, &step);
        if self.directions.len() == MOST_DIRECTIONS {
            self.directions.remove(0);
        }
        self.directions.push(Direction { step, image, squares });
    }

    /// Forgets all directions; `residual` is that of the current solution, recomputed.
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

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 12;
    const UNKNOWNS: usize = 5;

    fn matrix(r: usize, c: usize) -> f64 {
        ((3 * r + 7 * c) as f64).sin() + if r == c { 2.0 } else { 0.0 }
    }

    fn times_matrix(x: &Values) -> Values {
        let entry = |r: usize, k: usize| (0..UNKNOWNS).map(|c| matrix(r, c) * x.row(c)[k]).sum();
        let entries = (0..ROWS).flat_map(|r| (0..x.columns()).map(move |k| entry(r, k)));
        Values::new(x.columns(), entries.collect())
    }

    fn weights() -> Vec<f64> {
        (0..ROWS).map(|r| 1.0 + 0.5 * (r as f64).cos()).collect()
    }

    fn data() -> Values {
        Values::new(2, (0..2 * ROWS).map(|i| (i as f64 * 1.3).cos()).collect())
    }

    /// Some directions, no two the same in the two columns.
    fn direction(i: usize) -> Values {
        Values::new(
            2,
            (0..2 * UNKNOWNS)
                .map(|j| ((i * i + 1) as f64 * (j + 1) as f64).sin())
                .collect(),
        )
    }

    fn after(directions: usize) -> Gcr<'static> {
        let weights: &'static [f64] = weights().leak();
        let mut gcr = Gcr::new(weights, data(), Values::zeros(UNKNOWNS, 2));
        for i in 0..directions {
            gcr.advance(direction(i), times_matrix(&direction(i)));
        }
        gcr
    }

    /// Then the directions span all there is, and the residual is orthogonal to every column of the matrix.
    #[test]
    fn as_many_directions_as_unknowns_give_least_squares() {
        let gcr = after(UNKNOWNS);
        for c in 0..UNKNOWNS {
            for k in 0..2 {
                let rows = 0..ROWS;
                let slope: f64 = rows.map(|r| weights()[r] * matrix(r, c) * gcr.residual.row(r)[k]).sum();
                assert!(slope.abs() < 1e-12, "{slope:e}");
            }
        }
        let mut expected = data();
        expected.add_scaled(&[-1.0, -1.0], &times_matrix(&gcr.solution));
        let pairs = expected.as_slice().iter().zip(gcr.residual.as_slice());
        assert!(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-13);
    }

    #[test]
    fn every_direction_lowers_the_residual_and_a_repeated_one_changes_nothing() {
        let squares: Vec<Vec<f64>> = (0..=UNKNOWNS).map(|count| after(count).squares()).collect();
        assert!(squares.windows(2).all(|pair| (0..2).all(|k| pair[1][k] < pair[0][k])));
        let mut gcr = after(3);
        gcr.advance(direction(1), times_matrix(&direction(1)));
        let pairs = gcr.squares().into_iter().zip(&squares[3]);
        assert!(pairs.into_iter().all(|(a, b)| (a / b - 1.0).abs() < 1e-12));
    }

    #[test]
    fn a_direction_with_zero_image_is_ignored() {
        let mut gcr = after(2);
        let before = gcr.solution.clone();
        gcr.advance(direction(9), Values::zeros(ROWS, 2));
        assert_eq!(gcr.solution, before);
    }
}
