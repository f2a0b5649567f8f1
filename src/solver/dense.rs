//! Dense least squares: the paper's truncated singular value decomposition (section 4.2), and a QR decomposition at a
//! tenth of the cost. Either is computed once and solves for any number of right-hand sides (section 4.6).
//!
//! Cost for `m` rows and `n` columns: QR `2mn²` flops in matrix products; SVD some `4mn² + 22n³`, a good part of them
//! bound by memory. Memory `8mn` bytes for QR, about three times that for the SVD.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::householder::{
    apply_block_householder_sequence_transpose_on_the_left_in_place_scratch,
    apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj,
};
use faer::linalg::qr::no_pivoting::factor::{qr_in_place, qr_in_place_scratch, recommended_block_size};
use faer::linalg::solvers::ColPivQr;
use faer::linalg::triangular_solve;
use faer::{Conj, Mat, MatMut, MatRef, Par};

use super::{Coefficients, CollocationSystem, SolveError, Values};
use crate::progress::{ON_RAYON, ProgressResponse, run_abandonable};

/// How the dense system is decomposed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Decomposition {
    /// Householder QR. When the condition number exceeds the reciprocal of the truncation, a column-pivoted QR of the
    /// triangular factor follows and small pivots are cut off: equivalent to pivoting throughout, but most of the work
    /// stays in matrix products.
    #[default]
    Qr,
    /// Thin singular value decomposition; small singular values are cut off.
    Svd,
}

/// Options of [`DenseFactor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseOptions {
    /// Which decomposition.
    pub decomposition: Decomposition,
    /// Singular values (or pivots) below this fraction of the largest are cut off; 1e-14 to 1e-6 is usual.
    pub truncation: f64,
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self {
            decomposition: Decomposition::default(),
            truncation: 1e-10,
        }
    }
}

/// A system before its decomposition.
struct UnfactoredMatrix {
    matrix: Mat<f64>,
    options: DenseOptions,
    scales: Vec<f64>,
    row_weights: Vec<f64>,
    sources: usize,
}

impl UnfactoredMatrix {
    fn new(system: &CollocationSystem<'_>, options: &DenseOptions) -> Result<Self, SolveError> {
        let (collocation, unknowns, sources) = (system.collocation.len(), system.unknowns(), system.sources.len());
        if collocation < unknowns || unknowns == 0 {
            return Err(SolveError::Underdetermined {
                collocation,
                unknowns,
                sources,
            });
        }
        let (matrix, scales) = system.matrix()?;
        Ok(Self {
            matrix,
            options: *options,
            scales,
            row_weights: system.row_weights.to_vec(),
            sources,
        })
    }

    fn decomposed(self) -> Result<DenseFactor, SolveError> {
        let truncation = self.options.truncation;
        let (decomposition, rank, condition) = match self.options.decomposition {
            Decomposition::Svd => svd(self.matrix, truncation)?,
            Decomposition::Qr => qr(self.matrix, truncation),
        };
        if rank == 0 {
            return Err(SolveError::RankZero { truncation });
        }
        Ok(DenseFactor {
            decomposition,
            scales: self.scales,
            row_weights: self.row_weights,
            sources: self.sources,
            rank,
            condition,
        })
    }
}

/// A decomposed system.
pub struct DenseFactor {
    decomposition: Factors,
    scales: Vec<f64>,
    row_weights: Vec<f64>,
    sources: usize,
    rank: usize,
    condition: f64,
}

enum Factors {
    Svd {
        u: Mat<f64>,
        s: Vec<f64>,
        v: Mat<f64>,
    },
    /// The factored matrix holds `R` on and above the diagonal and the Householder vectors below it.
    Qr {
        factored: Mat<f64>,
        coefficients: Mat<f64>,
        pivoted: Option<ColPivQr<f64>>,
    },
}

impl DenseFactor {
    /// Assembles and decomposes a system.
    ///
    /// # Errors
    ///
    /// When there are fewer rows than columns, a matrix entry is not finite, or nothing is left after truncation.
    pub fn new(system: &CollocationSystem<'_>, options: &DenseOptions) -> Result<Self, SolveError> {
        let unfactored = UnfactoredMatrix::new(system, options)?;
        unfactored.decomposed()
    }

    /// As [`Self::new`]. `progress` is called ten times in a second. A decomposition cannot be interrupted: when it is
    /// cancelled, this returns at once, but the processors and the memory that it takes are free only when it is done.
    ///
    /// # Errors
    ///
    /// As [`Self::new`], and [`SolveError::Cancelled`].
    pub fn new_with_progress<A: ProgressResponse>(
        system: &CollocationSystem<'_>,
        options: &DenseOptions,
        progress: &dyn Fn() -> A,
    ) -> Result<Self, SolveError> {
        let unfactored = UnfactoredMatrix::new(system, options)?;
        run_abandonable(ON_RAYON, &|| progress().control_flow(), || unfactored.decomposed())
            .unwrap_or(Err(SolveError::Cancelled))
    }

    /// Number of singular values or pivots kept.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Condition number of the weighted and scaled matrix in the 2-norm before truncation: exact for the SVD, from
    /// power iterations for QR. Beyond 1e15 it only says "singular to working precision".
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// The least-squares coefficients for boundary values `data`, one per collocation point.
    ///
    /// # Errors
    ///
    /// When the number of values is not that of the rows.
    pub fn solve(&self, data: &[[f64; 3]]) -> Result<Coefficients, SolveError> {
        let solution = self.solve_columns(&Values::from_triples(data))?;
        Ok(Coefficients::of_columns(&solution, 0, self.sources))
    }

    /// As [`Self::solve`] for any number of right-hand sides, one per column: a row per source, then the rows of the
    /// affine functions if the system has them.
    ///
    /// # Errors
    ///
    /// As [`Self::solve`].
    pub fn solve_columns(&self, data: &Values) -> Result<Values, SolveError> {
        let collocation = self.row_weights.len();
        if data.rows() != collocation {
            return Err(SolveError::DataLength {
                data: data.rows(),
                collocation,
            });
        }
        let rhs = Mat::from_fn(collocation, data.columns(), |r, k| self.row_weights[r] * data.row(r)[k]);
        let scaled = match &self.decomposition {
            Factors::Svd { u, s, v } => {
                let mut projected = u.as_ref().subcols(0, self.rank).transpose() * &rhs;
                for (r, &singular) in s.iter().take(self.rank).enumerate() {
                    (0..data.columns()).for_each(|k| projected[(r, k)] /= singular);
                }
                v.as_ref().subcols(0, self.rank) * projected
            }
            Factors::Qr {
                factored,
                coefficients,
                pivoted,
            } => {
                let projected = apply_q_transpose(factored.as_ref(), coefficients.as_ref(), rhs);
                match pivoted {
                    None => solve_upper(factored.as_ref().subrows(0, self.scales.len()), projected),
                    Some(pivoted) => solve_pivoted(pivoted, self.rank, projected),
                }
            }
        };
        Ok(self.unscaled(&scaled))
    }

    /// The coefficients, from those of the scaled columns.
    fn unscaled(&self, scaled: &Mat<f64>) -> Values {
        let mut solution = Values::zeros(self.scales.len(), scaled.ncols());
        // A column of zeros (the function z on a flat boundary) has scale 0 and no coefficient.
        for (c, &scale) in self.scales.iter().enumerate().filter(|(_, scale)| **scale > 0.0) {
            for (k, value) in solution.row_mut(c).iter_mut().enumerate() {
                *value = scaled[(c, k)] / scale;
            }
        }
        solution
    }

    /// `(AᵀA)⁻¹ gradient` up to a common factor, for given `gradient = Aᵀr`; `None` for an SVD, a pivoted QR or a
    /// column of zeros.
    pub(super) fn solve_normal(&self, gradient: &Values) -> Option<Values> {
        let Factors::Qr {
            factored,
            pivoted: None,
            ..
        } = &self.decomposition
        else {
            return None;
        };
        if self.scales.contains(&0.0) {
            return None;
        }
        let (rows, columns) = (self.scales.len(), gradient.columns());
        let mut solution = Mat::from_fn(rows, columns, |c, k| gradient.row(c)[k] / self.scales[c]);
        let triangle = factored.as_ref().subrows(0, rows);
        let par = faer::get_global_parallelism();
        triangular_solve::solve_lower_triangular_in_place(triangle.transpose(), solution.as_mut(), par);
        triangular_solve::solve_upper_triangular_in_place(triangle, solution.as_mut(), par);
        Some(self.unscaled(&solution))
    }
}

fn svd(matrix: Mat<f64>, truncation: f64) -> Result<(Factors, usize, f64), SolveError> {
    let svd = matrix.thin_svd().map_err(|_| SolveError::NoConvergence)?;
    drop(matrix);
    let s: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let rank = s.iter().take_while(|&&value| value > truncation * s[0]).count();
    let condition = s[0] / s[s.len() - 1];
    let (u, v) = (svd.U().to_owned(), svd.V().to_owned());
    Ok((Factors::Svd { u, s, v }, rank, condition))
}

/// Householder vectors below the diagonal with `R` above, and the factors of their blocks.
pub(super) fn householder_qr(mut matrix: Mat<f64>) -> (Mat<f64>, Mat<f64>) {
    let (rows, columns) = matrix.shape();
    let block = recommended_block_size::<f64>(rows, columns);
    let mut coefficients = Mat::zeros(block, columns);
    let par = faer::get_global_parallelism();
    let scratch = qr_in_place_scratch::<f64>(rows, columns, block, par, Default::default());
    qr_in_place(
        matrix.as_mut(),
        coefficients.as_mut(),
        par,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    );
    (matrix, coefficients)
}

fn qr(matrix: Mat<f64>, truncation: f64) -> (Factors, usize, f64) {
    let (matrix, coefficients) = householder_qr(matrix);
    let columns = matrix.ncols();
    let condition = triangular_condition(matrix.as_ref().subrows(0, columns));
    let (mut pivoted, mut rank) = (None, columns);
    let is_well_conditioned = condition * truncation < 1.0;
    if !is_well_conditioned {
        let triangle = Mat::from_fn(columns, columns, |i, j| if i <= j { matrix[(i, j)] } else { 0.0 });
        let decomposed = triangle.col_piv_qr();
        let pivot = |k: usize| decomposed.R()[(k, k)].abs();
        rank = (0..columns).take_while(|&k| pivot(k) > truncation * pivot(0)).count();
        pivoted = Some(decomposed);
    }
    let factors = Factors::Qr {
        factored: matrix,
        coefficients,
        pivoted,
    };
    (factors, rank, condition)
}

/// Condition number of an upper triangle by power iterations on `RᵀR` and its inverse. Ten steps give
/// a lower bound, usually within a few per cent, which is accurate enough. Infinite when a diagonal entry is zero.
fn triangular_condition(r: MatRef<'_, f64>) -> f64 {
    let n = r.ncols();
    if (0..n).any(|k| r[(k, k)] == 0.0) {
        return f64::INFINITY;
    }
    // Not constant: for a symmetric domain, a constant start can be orthogonal to the wanted eigenvector.
    let start = || Mat::from_fn(n, 1, |i, _| 1.0 + 0.5 * ((i * i % 101) as f64).sin());
    let par = faer::get_global_parallelism();
    let (mut largest, mut smallest) = (0.0, f64::INFINITY);
    let (mut up, mut down) = (start(), start());
    for _ in 0..10 {
        largest = normalise(&mut up).max(largest);
        let mut image = Mat::zeros(n, 1);
        multiply_upper(&mut image, r, &up);
        let mut back = Mat::zeros(n, 1);
        multiply_upper_transposed(&mut back, r, &image);
        up = back;

        smallest = normalise(&mut down).recip().min(smallest);
        triangular_solve::solve_lower_triangular_in_place(r.transpose(), down.as_mut(), par);
        triangular_solve::solve_upper_triangular_in_place(r, down.as_mut(), par);
        if !down.norm_l2().is_finite() {
            return f64::INFINITY;
        }
    }
    largest = normalise(&mut up).max(largest);
    smallest = normalise(&mut down).recip().min(smallest);
    (largest / smallest).sqrt()
}

fn normalise(vector: &mut Mat<f64>) -> f64 {
    let norm = vector.norm_l2();
    *vector *= faer::Scale(norm.recip());
    norm
}

fn multiply_upper(out: &mut Mat<f64>, r: MatRef<'_, f64>, x: &Mat<f64>) {
    for j in 0..r.ncols() {
        let xj = x[(j, 0)];
        for i in 0..=j {
            out[(i, 0)] += r[(i, j)] * xj;
        }
    }
}

fn multiply_upper_transposed(out: &mut Mat<f64>, r: MatRef<'_, f64>, x: &Mat<f64>) {
    for j in 0..r.ncols() {
        out[(j, 0)] = (0..=j).map(|i| r[(i, j)] * x[(i, 0)]).sum();
    }
}

/// The first `n` rows of `Qᵀ rhs`.
fn apply_q_transpose(factored: MatRef<'_, f64>, coefficients: MatRef<'_, f64>, mut rhs: Mat<f64>) -> Mat<f64> {
    rotate_with(factored, coefficients, rhs.as_mut(), Par::Seq);
    rhs.truncate(factored.ncols(), rhs.ncols());
    rhs
}

/// `Qᵀ rhs` in the place of `rhs`, of many columns.
pub(super) fn rotate(factored: MatRef<'_, f64>, coefficients: MatRef<'_, f64>, rhs: MatMut<'_, f64>) {
    rotate_with(factored, coefficients, rhs, faer::get_global_parallelism());
}

fn rotate_with(factored: MatRef<'_, f64>, coefficients: MatRef<'_, f64>, rhs: MatMut<'_, f64>, par: Par) {
    let scratch = apply_block_householder_sequence_transpose_on_the_left_in_place_scratch::<f64>(
        factored.nrows(),
        coefficients.nrows(),
        rhs.ncols(),
    );
    apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj(
        factored,
        coefficients,
        Conj::No,
        rhs,
        par,
        MemStack::new(&mut MemBuffer::new(scratch)),
    );
}

fn solve_upper(triangle: MatRef<'_, f64>, mut rhs: Mat<f64>) -> Mat<f64> {
    triangular_solve::solve_upper_triangular_in_place(triangle, rhs.as_mut(), faer::get_global_parallelism());
    rhs
}

/// The basic solution: unknowns whose pivots were cut off are set to zero.
fn solve_pivoted(pivoted: &ColPivQr<f64>, rank: usize, rhs: Mat<f64>) -> Mat<f64> {
    let columns = rhs.nrows();
    let mut projected = apply_q_transpose(pivoted.Q_basis(), pivoted.Q_coeff(), rhs);
    let leading = pivoted.R().submatrix(0, 0, rank, rank);
    let kept = projected.as_mut().subrows_mut(0, rank);
    triangular_solve::solve_upper_triangular_in_place(leading, kept, faer::get_global_parallelism());
    let mut solution = Mat::zeros(columns, projected.ncols());
    let (order, _) = pivoted.P().arrays();
    for k in 0..rank {
        (0..projected.ncols()).for_each(|c| solution[(order[k], c)] = projected[(k, c)]);
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::{Point, kernel};

    /// A ball of radius 1 with `sources` evenly at `distance` from it, and data from three sources farther out.
    struct Ball {
        collocation: Vec<Point>,
        weights: Vec<f64>,
        sources: Vec<Point>,
    }

    impl Ball {
        fn new(sources: usize, distance: f64) -> Self {
            let collocation = shapes::sphere(1.0, 3).vertices().to_vec();
            let weights = (0..collocation.len()).map(|k| 1.0 + 0.3 * (k as f64).sin()).collect();
            let sources = crate::sampling::bounding_sphere(Point::origin(), 1.0 + distance, sources);
            Self {
                collocation,
                weights,
                sources,
            }
        }

        fn system(&self, affine: bool) -> CollocationSystem<'_> {
            let (collocation, row_weights, sources) = (&self.collocation, &self.weights, &self.sources);
            CollocationSystem {
                collocation,
                row_weights,
                sources,
                affine,
            }
        }

        fn data(&self) -> Vec<[f64; 3]> {
            let outer = [
                Point::new(3.0, 0.5, 0.0),
                Point::new(-1.0, 2.8, 1.0),
                Point::new(0.2, -0.4, -3.1),
            ];
            self.collocation
                .iter()
                .map(|p| outer.map(|q| kernel::laplace_potential(*p, q)))
                .collect()
        }

        fn residual(&self, coefficients: &Coefficients) -> f64 {
            let (p, data) = (&self.collocation, self.data());
            let rows = (0..p.len()).map(|r| {
                (0..3)
                    .map(|k| {
                        let kernels = self.sources.iter().map(|q| kernel::laplace_potential(p[r], *q));
                        let sum: f64 = kernels.zip(&coefficients.sources).map(|(g, w)| g * w[k]).sum();
                        let a = coefficients.affine;
                        let value = sum + a[0][k] + a[1][k] * p[r].x + a[2][k] * p[r].y + a[3][k] * p[r].z;
                        (self.weights[r] * (value - data[r][k])).powi(2)
                    })
                    .sum::<f64>()
            });
            rows.sum::<f64>().sqrt()
        }
    }

    fn factor(system: &CollocationSystem<'_>, decomposition: Decomposition, truncation: f64) -> DenseFactor {
        DenseFactor::new(
            system,
            &DenseOptions {
                decomposition,
                truncation,
            },
        )
        .unwrap()
    }

    /// Both give the least-squares solution up to rounding, amplified by the condition number of about 200.
    #[test]
    fn svd_and_qr_agree_on_a_well_conditioned_system() {
        let ball = Ball::new(200, 0.3);
        let (svd, qr) = (
            factor(&ball.system(true), Decomposition::Svd, 0.0),
            factor(&ball.system(true), Decomposition::Qr, 0.0),
        );
        let (x, y) = (svd.solve(&ball.data()).unwrap(), qr.solve(&ball.data()).unwrap());
        let size = x.sources.iter().flatten().fold(0f64, |m, v| m.max(v.abs()));
        let pairs = x.sources.iter().zip(&y.sources).chain(x.affine.iter().zip(&y.affine));
        for (a, b) in pairs.flat_map(|(a, b)| a.iter().zip(b)) {
            assert!((a - b).abs() < 1e-10 * size);
        }
        assert_eq!((svd.rank(), qr.rank()), (204, 204));
        let ratio = qr.condition() / svd.condition();
        assert!(
            (0.9..=1.0 + 1e-9).contains(&ratio),
            "condition by power iteration is {ratio} of the exact one"
        );
    }

    /// Far sources make the matrix singular to working precision. Truncation must lower the rank and still
    /// resolve these smooth data, which take some tens of functions: a residual of 1e-6 is generous.
    #[test]
    fn truncation_solves_a_numerically_singular_system() {
        let ball = Ball::new(400, 4.0);
        for decomposition in [Decomposition::Svd, Decomposition::Qr] {
            let factor = factor(&ball.system(true), decomposition, 1e-11);
            assert!(factor.rank() < 400, "{decomposition:?} keeps {}", factor.rank());
            assert!(factor.condition() > 1e12, "{decomposition:?} {:e}", factor.condition());
            let residual = ball.residual(&factor.solve(&ball.data()).unwrap());
            assert!(residual < 1e-6, "{decomposition:?} leaves {residual:e}");
        }
    }

    #[test]
    fn a_repeated_source_does_not_matter() {
        let mut ball = Ball::new(100, 0.4);
        let alone = ball.residual(
            &factor(&ball.system(true), Decomposition::Qr, 1e-10)
                .solve(&ball.data())
                .unwrap(),
        );
        ball.sources.push(ball.sources[17]);
        let factor = factor(&ball.system(true), Decomposition::Qr, 1e-10);
        assert_eq!(factor.rank(), 104);
        let doubled = ball.residual(&factor.solve(&ball.data()).unwrap());
        assert!((doubled / alone - 1.0).abs() < 1e-6);
    }

    #[test]
    fn affine_data_need_no_sources() {
        let ball = Ball::new(50, 0.5);
        let data: Vec<_> = ball
            .collocation
            .iter()
            .map(|p| [1.0 + p.x, 2.0 * p.y - p.z, 3.0 * p.z])
            .collect();
        for decomposition in [Decomposition::Svd, Decomposition::Qr] {
            let solution = factor(&ball.system(true), decomposition, 1e-12).solve(&data).unwrap();
            assert!(solution.sources.iter().flatten().all(|w| w.abs() < 1e-11));
            let exact = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, -1.0, 3.0]];
            for (row, expected) in solution.affine.iter().zip(exact) {
                assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-11));
            }
        }
    }

    #[test]
    fn bad_systems_are_named() {
        let mut ball = Ball::new(100, 0.4);
        let few = CollocationSystem {
            collocation: &ball.collocation[..103],
            ..ball.system(true)
        };
        assert!(matches!(
            DenseFactor::new(&few, &DenseOptions::default()),
            Err(SolveError::Underdetermined {
                collocation: 103,
                unknowns: 104,
                sources: 100
            })
        ));
        let good = factor(&ball.system(false), Decomposition::Qr, 0.0);
        assert!(matches!(
            good.solve(&[[0.0; 3]]),
            Err(SolveError::DataLength { data: 1, .. })
        ));
        ball.sources[7] = ball.collocation[3];
        let hit = DenseFactor::new(&ball.system(true), &DenseOptions::default());
        assert!(matches!(hit, Err(SolveError::NonFinite { column: 7 })));
    }
}
