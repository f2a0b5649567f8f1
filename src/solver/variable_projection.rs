//! Least squares for the positions of the sources and their coefficients together, by variable projection.
//!
//! The residual `W (A(Q) c − d)` is linear in the coefficients `c`, so that the best ones for positions `Q` are known, and
//! what is left is a function of the positions alone: the norm of `P d`, with `P(Q)` the projection onto the orthogonal
//! complement of the columns (Golub & Pereyra 1973). Kaufman (1975) leaves a term of its Jacobian out that lies in the span
//! of the columns. The gradient is exact nevertheless, and a column of the Jacobian is `−P g c`: `g` is the derivative of a
//! source's column by one coordinate of its position, and `c` the coefficient of that source.
//!
//! All columns of the data share the sources. Over the columns `k` the Gauss-Newton matrix is therefore
//! `Σ_k diag(c_k) B diag(c_k)`, with `B = (PG)ᵀ(PG)` for all derivatives `G`, or `B ∘ CCᵀ` entry by entry: `B` is formed
//! once, however many columns there are.
//!
//! A small ridge `μ² ‖S c‖²` over the sources, with the norms `S` of their columns at the start, bounds the coefficients where
//! sources come close to each other and their columns become dependent. It adds rows to `A`, and changes nothing else. The
//! affine part has no ridge: affine data leave no residual but rounding, wherever the sources are.
//!
//! Cost of a round for `m` collocation points and `n` sources, in flops: `2(m + n)n²` for the decomposition, `12(m + n)n²` for
//! `PG`, `9mn²` for `B`, and `9n³` for the step. A further step of the same round takes the first and the last. With `m = 3n`
//! that is `85n³`, sixteen times a dense fit. Memory `32(m + n)n + 72n²` bytes, or `8(m + n)n + 216n²` if that is more.
//!
//! # References
//!
//! - G. H. Golub, V. Pereyra, *The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
//!   separate*, SIAM J. Numer. Anal. 10 (1973).
//! - L. Kaufman, *A variable projection method for solving separable nonlinear least squares problems*, BIT 15 (1975).

use std::f64::consts::PI;

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Accum, Mat, MatRef, Side};
use rayon::prelude::*;

use super::dense::{householder_qr, rotate};
use super::{CollocationSystem, SolveError, Values, affine_functions};
use crate::{Point, Vector, kernel};

/// A least-squares problem for positions and coefficients: everything but the positions.
pub struct SeparableSystem<'a> {
    collocation: &'a [Point],
    row_weights: &'a [f64],
    /// Weighted.
    data: Mat<f64>,
    /// Norms of the columns at the start; 1 for a column of zeros.
    scales: Vec<f64>,
    /// The ridge for sources whose columns have norm 1.
    ridge: f64,
}

/// The best coefficients for some positions, and what they leave.
pub struct Projection {
    factored: Mat<f64>,
    householder: Mat<f64>,
    /// What is left of the data, in the coordinates of the rotated rows below the triangle.
    left: Mat<f64>,
    /// Half the sum of squares of what is left, the ridge's part included.
    objective: f64,
    /// A row for each source, with a column for each column of the data.
    coefficients: Mat<f64>,
}

/// Gradient and Gauss-Newton matrix of the objective by the positions: entries `3s` to `3s + 2` are those of source `s`.
pub struct GaussNewton {
    /// The lower triangle.
    normal: Mat<f64>,
    gradient: Vec<f64>,
}

impl<'a> SeparableSystem<'a> {
    /// For a system whose sources are the start, and boundary values for each of its collocation points. The `ridge` is a
    /// fraction of the norm of the matrix with columns of norm 1, as the truncation of a dense solver is.
    ///
    /// # Errors
    ///
    /// When there are fewer rows than columns, the number of values is not that of the rows, or an entry is not finite.
    pub fn new(system: &CollocationSystem<'a>, data: &Values, ridge: f64) -> Result<Self, SolveError> {
        let (collocation, unknowns) = (system.collocation.len(), system.unknowns());
        if collocation < unknowns || unknowns == 0 {
            return Err(SolveError::Underdetermined {
                collocation,
                unknowns,
                sources: system.sources.len(),
            });
        }
        if data.rows() != collocation {
            return Err(SolveError::DataLength {
                data: data.rows(),
                collocation,
            });
        }
        let weighted = |r: usize, k: usize| system.row_weights[r] * data.row(r)[k];
        let mut made = Self {
            collocation: system.collocation,
            row_weights: system.row_weights,
            data: Mat::from_fn(collocation, data.columns(), weighted),
            scales: vec![1.0; unknowns],
            ridge: ridge * (unknowns as f64).sqrt(),
        };
        let matrix = made.matrix(system.sources)?;
        let norms = (0..unknowns).map(|c| matrix.col(c).subrows(0, collocation).norm_l2());
        made.scales = norms.map(|norm| if norm > 0.0 { norm } else { 1.0 }).collect();
        Ok(made)
    }

    /// Number of collocation points.
    pub fn rows(&self) -> usize {
        self.collocation.len()
    }

    /// Weighted rows with scaled columns, and the rows of the ridge below.
    fn matrix(&self, sources: &[Point]) -> Result<Mat<f64>, SolveError> {
        let (rows, columns) = (self.collocation.len(), self.scales.len());
        let mut matrix = Mat::<f64>::zeros(rows + columns, columns);
        let are_finite: Vec<bool> = matrix
            .par_col_iter_mut()
            .enumerate()
            .map(|(column, entries)| {
                let entries = entries
                    .try_as_col_major_mut()
                    .expect("columns of an owned matrix are contiguous")
                    .as_slice_mut();
                entries[rows + column] = if column < sources.len() { self.ridge } else { 0.0 };
                self.fill_column(sources, column, &mut entries[..rows])
            })
            .collect();
        match are_finite.iter().position(|is_finite| !is_finite) {
            Some(column) => Err(SolveError::NonFinite { column }),
            None => Ok(matrix),
        }
    }

    fn fill_column(&self, sources: &[Point], column: usize, entries: &mut [f64]) -> bool {
        match sources.get(column) {
            Some(source) => {
                let filled = kernel::direct::fill_matrix(self.collocation, std::slice::from_ref(source), entries);
                debug_assert!(filled.is_ok(), "a column has one entry per row");
            }
            None => {
                let function = column - sources.len();
                for (entry, p) in entries.iter_mut().zip(self.collocation) {
                    *entry = affine_functions(p)[function];
                }
            }
        }
        let scale = self.scales[column];
        for (entry, weight) in entries.iter_mut().zip(self.row_weights) {
            *entry *= weight / scale;
        }
        entries.iter().all(|entry| entry.is_finite())
    }

    /// The best coefficients for sources at these positions, as many as at the start.
    ///
    /// # Errors
    ///
    /// [`SolveError::NonFinite`] when a source coincides with a collocation point.
    pub fn project(&self, sources: &[Point]) -> Result<Projection, SolveError> {
        let (factored, householder) = householder_qr(self.matrix(sources)?);
        let (unknowns, columns) = (self.scales.len(), self.data.ncols());
        let mut rotated = Mat::zeros(factored.nrows(), columns);
        rotated.as_mut().subrows_mut(0, self.data.nrows()).copy_from(&self.data);
        rotate(factored.as_ref(), householder.as_ref(), rotated.as_mut());
        let triangle = factored.as_ref().subrows(0, unknowns);
        let mut scaled = rotated.subrows(0, unknowns).to_owned();
        let par = faer::get_global_parallelism();
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(triangle, scaled.as_mut(), par);
        let left = rotated.subrows(unknowns, self.data.nrows()).to_owned();
        let of_sources = sources.len();
        Ok(Projection {
            coefficients: Mat::from_fn(of_sources, columns, |s, k| scaled[(s, k)] / self.scales[s]),
            objective: 0.5 * left.squared_norm_l2(),
            left,
            factored,
            householder,
        })
    }

    /// How the objective changes with the positions. `should_continue` is asked after every part of the work.
    ///
    /// # Errors
    ///
    /// [`SolveError::Cancelled`] when it should not.
    pub fn linearise(
        &self,
        sources: &[Point],
        projection: &Projection,
        should_continue: &dyn Fn() -> bool,
    ) -> Result<GaussNewton, SolveError> {
        let rotated = self.rotated_derivatives(sources, projection, should_continue)?;
        let derivatives = rotated.subrows(self.scales.len(), self.collocation.len());
        let size = 3 * sources.len();
        let mut normal = Mat::zeros(size, size);
        for (first, count) in parts(size) {
            require(should_continue)?;
            // The lower triangle, and the rest of the square blocks on the diagonal.
            matmul(
                normal.as_mut().submatrix_mut(first, 0, count, first + count),
                Accum::Replace,
                derivatives.subcols(first, count).transpose(),
                derivatives.subcols(0, first + count),
                1.0,
                faer::get_global_parallelism(),
            );
        }
        let coefficients = &projection.coefficients;
        let along = derivatives.transpose() * &projection.left;
        let gradient = (0..size).map(|i| -dot(coefficients.as_ref(), i / 3, along.as_ref(), i));
        let gradient = gradient.collect();
        let shared = coefficients * coefficients.transpose();
        normal.par_col_iter_mut().enumerate().for_each(|(j, mut column)| {
            (j..size).for_each(|i| column[i] *= shared[(i / 3, j / 3)]);
        });
        Ok(GaussNewton { normal, gradient })
    }

    /// `QᵀG` for the orthogonal `Q` of the decomposition: its rows below the triangle are those of `PG` in rotated coordinates.
    fn rotated_derivatives(
        &self,
        sources: &[Point],
        projection: &Projection,
        should_continue: &dyn Fn() -> bool,
    ) -> Result<Mat<f64>, SolveError> {
        let (rows, unknowns) = (self.collocation.len(), self.scales.len());
        let mut rotated = Mat::<f64>::zeros(rows + unknowns, 3 * sources.len());
        rotated
            .par_col_iter_mut()
            .enumerate()
            .for_each(|(column, mut entries)| {
                let (source, axis) = (sources[column / 3], column % 3);
                for (r, (p, weight)) in self.collocation.iter().zip(self.row_weights).enumerate() {
                    entries[r] = weight * source_derivative(p, &source)[axis];
                }
            });
        for (first, count) in parts(3 * sources.len()) {
            require(should_continue)?;
            let columns = rotated.as_mut().subcols_mut(first, count);
            rotate(projection.factored.as_ref(), projection.householder.as_ref(), columns);
        }
        Ok(rotated)
    }
}

/// Columns that are worked on at once: of 1000 sources, in some tenths of a second.
const COLUMNS: usize = 192;

/// The first column of each part, and how many it has.
fn parts(columns: usize) -> impl Iterator<Item = (usize, usize)> {
    let firsts = (0..columns).step_by(COLUMNS);
    firsts.map(move |first| (first, COLUMNS.min(columns - first)))
}

fn require(should_continue: &dyn Fn() -> bool) -> Result<(), SolveError> {
    match should_continue() {
        true => Ok(()),
        false => Err(SolveError::Cancelled),
    }
}

/// Derivative of the potential `1 / 4πr` at `p` by the position of its source.
fn source_derivative(p: &Point, source: &Point) -> Vector {
    let d = p - source;
    let r = d.norm();
    d / (4.0 * PI * r * r * r)
}

/// Product of row `i` of `a` with row `j` of `b`.
fn dot(a: MatRef<'_, f64>, i: usize, b: MatRef<'_, f64>, j: usize) -> f64 {
    (0..a.ncols()).map(|k| a[(i, k)] * b[(j, k)]).sum()
}

impl Projection {
    /// Half the weighted sum of squared residuals, with the ridge's part.
    pub fn objective(&self) -> f64 {
        self.objective
    }
}

impl GaussNewton {
    /// The Levenberg-Marquardt step of every source, and by how much it should lower the objective. Coordinates are in
    /// units of `lengths`, one for each source; `damping` is a multiple of the diagonal, and of its mean where an entry is
    /// far below that. `None` where the damped matrix is not positive definite in floating point.
    pub fn step(&self, damping: f64, lengths: &[f64]) -> Option<(Vec<Vector>, f64)> {
        let size = self.gradient.len();
        let scaled = |i: usize, j: usize| self.normal[(i, j)] * lengths[i / 3] * lengths[j / 3];
        let mean = (0..size).map(|i| scaled(i, i)).sum::<f64>() / size.max(1) as f64;
        let damped = |i: usize| damping * scaled(i, i).max(LEAST_DAMPED * mean);
        let matrix = Mat::from_fn(size, size, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => 0.0,
            std::cmp::Ordering::Equal => scaled(i, i) + damped(i),
            std::cmp::Ordering::Greater => scaled(i, j),
        });
        let downhill = Mat::from_fn(size, 1, |i, _| -self.gradient[i] * lengths[i / 3]);
        let factor = Llt::new(matrix.as_ref(), Side::Lower).ok()?;
        let step = factor.solve(&downhill);
        // The model's decrease: ½ hᵀ(Dh − g) for (H + D)h = −g.
        let decrease = (0..size).map(|i| 0.5 * step[(i, 0)] * (damped(i) * step[(i, 0)] + downhill[(i, 0)]));
        let decrease: f64 = decrease.sum();
        let moves = lengths.iter().enumerate();
        let moves = moves.map(|(s, length)| *length * Vector::from_fn(|axis, _| step[(3 * s + axis, 0)]));
        let moves: Vec<Vector> = moves.collect();
        (decrease.is_finite() && moves.iter().all(|m| m.iter().all(|x| x.is_finite()))).then_some((moves, decrease))
    }
}

/// Fraction of the mean diagonal entry below which an entry is not damped less: that of a source without a coefficient is
/// zero, and it must not fly off.
const LEAST_DAMPED: f64 = 1e-2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::sampling::bounding_sphere;
    use crate::solver::{DenseFactor, DenseOptions};

    /// A ball of radius 1 with 30 sources about it, and data from three sources that are none of these.
    struct Ball {
        collocation: Vec<Point>,
        weights: Vec<f64>,
        sources: Vec<Point>,
        data: Values,
    }

    impl Ball {
        fn new() -> Self {
            let collocation = shapes::sphere(1.0, 2).vertices().to_vec();
            let weights = (0..collocation.len()).map(|k| 1.0 + 0.3 * (k as f64).sin()).collect();
            let outer = [
                Point::new(1.5, 0.5, 0.0),
                Point::new(-1.0, 1.4, 1.0),
                Point::new(0.2, -0.4, -1.8),
            ];
            let potentials = |p: &Point| outer.map(|q| kernel::laplace_potential(*p, q));
            let data: Vec<[f64; 3]> = collocation.iter().map(potentials).collect();
            Self {
                data: Values::from_triples(&data),
                sources: bounding_sphere(Point::origin(), 1.6, 30),
                collocation,
                weights,
            }
        }

        fn system<'a>(&'a self, sources: &'a [Point]) -> CollocationSystem<'a> {
            CollocationSystem {
                collocation: &self.collocation,
                row_weights: &self.weights,
                sources,
                affine: true,
            }
        }

        fn separable(&self) -> SeparableSystem<'_> {
            SeparableSystem::new(&self.system(&self.sources), &self.data, 1e-14).unwrap()
        }

        /// What the dense solver leaves of `data`, weighted; formed term by term.
        fn left(&self, sources: &[Point], data: &Values) -> Vec<f64> {
            let options = DenseOptions {
                truncation: 0.0,
                ..DenseOptions::default()
            };
            let factor = DenseFactor::new(&self.system(sources), &options).unwrap();
            let c = factor.solve_columns(data).unwrap();
            let of_row = |(r, p): (usize, &Point)| {
                let mut functions: Vec<f64> = sources.iter().map(|q| kernel::laplace_potential(*p, *q)).collect();
                functions.extend(affine_functions(p));
                let value = |k: usize| functions.iter().enumerate().map(|(s, f)| f * c.row(s)[k]).sum::<f64>();
                let left: Vec<f64> = (0..data.columns())
                    .map(|k| self.weights[r] * (data.row(r)[k] - value(k)))
                    .collect();
                left
            };
            self.collocation.iter().enumerate().flat_map(of_row).collect()
        }

        fn moved(&self, coordinate: usize, by: f64) -> Vec<Point> {
            let mut sources = self.sources.clone();
            sources[coordinate / 3][coordinate % 3] += by;
            sources
        }

        /// The projection of the central difference of the residual by a coordinate, column by column: what Kaufman's
        /// Jacobian is, since the term that it leaves out lies in the span of the columns.
        fn projected_difference(&self, coordinate: usize, h: f64) -> Vec<f64> {
            let [ahead, behind] = [h, -h].map(|by| self.left(&self.moved(coordinate, by), &self.data));
            let slopes = ahead.iter().zip(&behind).enumerate();
            let unweighted = slopes.map(|(i, (a, b))| (a - b) / (2.0 * h) / self.weights[i / 3]);
            self.left(&self.sources, &Values::new(3, unweighted.collect()))
        }
    }

    /// The error of a central difference is `h²/6` times a third derivative, some `10²` times the value: `1e-6` of it.
    #[test]
    fn the_jacobian_is_that_of_finite_differences_after_projection() {
        let ball = Ball::new();
        let separable = ball.separable();
        let model = separable
            .linearise(&ball.sources, &separable.project(&ball.sources).unwrap(), &|| true)
            .unwrap();
        let coordinates = [0, 1, 2, 3, 40, 41, 88];
        let columns: Vec<Vec<f64>> = coordinates
            .iter()
            .map(|&i| ball.projected_difference(i, 1e-4))
            .collect();
        let largest = (0..90).map(|i| model.normal[(i, i)]).fold(0.0, f64::max);
        for (a, &i) in coordinates.iter().enumerate() {
            for (b, &j) in coordinates.iter().enumerate().filter(|(_, j)| **j <= i) {
                let product: f64 = columns[a].iter().zip(&columns[b]).map(|(x, y)| x * y).sum();
                let entry = model.normal[(i, j)];
                assert!(
                    (product - entry).abs() < 1e-5 * largest,
                    "({i}, {j}): {product:e}, {entry:e}"
                );
            }
        }
    }

    /// However large the ridge: it is on the coefficients of the sources alone.
    #[test]
    fn affine_data_leave_no_residual_but_rounding() {
        let mut ball = Ball::new();
        let image = |p: &Point| [2.0 * p.x + 1.0, p.y + 0.5 * p.z, p.z - p.x];
        let images: Vec<[f64; 3]> = ball.collocation.iter().map(image).collect();
        ball.data = Values::from_triples(&images);
        let separable = SeparableSystem::new(&ball.system(&ball.sources), &ball.data, 1e-2).unwrap();
        let objective = separable.project(&ball.sources).unwrap().objective();
        assert!(objective < 1e-26, "{objective:e}");
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let ball = Ball::new();
        let separable = ball.separable();
        let model = separable
            .linearise(&ball.sources, &separable.project(&ball.sources).unwrap(), &|| true)
            .unwrap();
        let objective = |sources: &[Point]| separable.project(sources).unwrap().objective();
        let largest = model.gradient.iter().fold(0f64, |m, g| m.max(g.abs()));
        for (i, gradient) in model.gradient.iter().enumerate() {
            let [ahead, behind] = [1e-4, -1e-4].map(|by| objective(&ball.moved(i, by)));
            let slope = (ahead - behind) / 2e-4;
            assert!(
                (slope - gradient).abs() < 1e-5 * largest,
                "{i}: {slope:e}, {gradient:e}"
            );
        }
    }

    /// The objective is the dense solver's, up to rounding.
    #[test]
    fn the_best_coefficients_leave_what_the_dense_solver_leaves() {
        let ball = Ball::new();
        let left = ball.left(&ball.sources, &ball.data);
        let dense = 0.5 * left.iter().map(|x| x * x).sum::<f64>();
        let objective = ball.separable().project(&ball.sources).unwrap().objective();
        assert!((objective / dense - 1.0).abs() < 1e-8, "{objective:e}, {dense:e}");
    }

    /// With a small step the model is right: that much damping makes the steps small.
    #[test]
    fn a_damped_step_lowers_the_objective_as_much_as_the_model_says() {
        let ball = Ball::new();
        let separable = ball.separable();
        let before = separable.project(&ball.sources).unwrap();
        let model = separable.linearise(&ball.sources, &before, &|| true).unwrap();
        let (steps, predicted) = model.step(1e4, &vec![0.6; 30]).unwrap();
        let moved: Vec<Point> = ball.sources.iter().zip(&steps).map(|(q, step)| q + step).collect();
        let decrease = before.objective() - separable.project(&moved).unwrap().objective();
        assert!((decrease / predicted - 1.0).abs() < 0.05, "{decrease:e}, {predicted:e}");
    }

    /// The ridge keeps coefficients of sources at the same place finite.
    #[test]
    fn sources_may_coincide() {
        let ball = Ball::new();
        let mut sources = ball.sources.clone();
        sources[1] = sources[0];
        let projection = ball.separable().project(&sources).unwrap();
        assert!(projection.objective().is_finite());
        assert!(
            projection.coefficients.norm_max() < 1e3,
            "{:e}",
            projection.coefficients.norm_max()
        );
    }

    #[test]
    fn linearising_ends_when_it_is_cancelled() {
        let ball = Ball::new();
        let separable = ball.separable();
        let projection = separable.project(&ball.sources).unwrap();
        for last in 0..2 {
            let asked = std::cell::Cell::new(0);
            let should_continue = || asked.replace(asked.get() + 1) < last;
            let ended = separable.linearise(&ball.sources, &projection, &should_continue);
            assert!(matches!(ended, Err(SolveError::Cancelled)));
            assert_eq!(asked.get(), last + 1);
        }
    }

    #[test]
    fn parts_have_all_columns() {
        for columns in [0, 1, COLUMNS, COLUMNS + 1, 5 * COLUMNS + 7] {
            let all: Vec<usize> = parts(columns).flat_map(|(first, count)| first..first + count).collect();
            assert!(all.into_iter().eq(0..columns));
        }
    }

    #[test]
    fn bad_systems_are_named() {
        let ball = Ball::new();
        let system = ball.system(&ball.sources);
        let few = CollocationSystem {
            collocation: &ball.collocation[..33],
            ..system
        };
        let error = SeparableSystem::new(&few, &ball.data, 1e-10).err();
        assert!(matches!(error, Some(SolveError::Underdetermined { unknowns: 34, .. })));
        let error = SeparableSystem::new(&system, &Values::zeros(7, 3), 1e-10).err();
        assert!(matches!(error, Some(SolveError::DataLength { data: 7, .. })));
        let mut sources = ball.sources.clone();
        sources[5] = ball.collocation[9];
        let hit = ball.separable().project(&sources).err();
        assert!(matches!(hit, Some(SolveError::NonFinite { column: 5 })));
    }
}
