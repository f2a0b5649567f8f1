//! Many right-hand sides expanded in few basis modes: proper orthogonal decomposition (Sirovich, *Turbulence and the
//! dynamics of coherent structures*, Quart. Appl. Math. 45, 1987).
//!
//! The frames of an animation resemble each other, and the system is linear: solving for the modes of the data and
//! combining the solutions with the same coefficients solves for all frames.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use super::{Values, affine_functions};
use crate::Point;

/// Rows that make a task worth handing to another thread.
const ROWS_PER_TASK: usize = 1 << 11;
/// Relative accuracy of the singular values.
const SVD_ACCURACY: f64 = 1e-14;
/// Modes are used when there are at most this many per column of data.
const WORTHWHILE: f64 = 0.9;

/// An orthonormal basis for many right-hand sides: each column of the data is an affine function of the points, which
/// the solver reproduces exactly, plus a combination of the modes. The rows of factors are orthonormal, so that the
/// norm over all modes equals that over all data.
///
/// The affine parts are removed first: nearly affine data are easy to fit, and would otherwise dominate the norm in
/// which the modes are truncated.
#[derive(Debug, Clone)]
pub struct BasisModes {
    factors: Values,
    /// Rows for the functions 1, x, y, z.
    affine: Option<Values>,
}

impl BasisModes {
    /// The modes of data at weighted points, and the basis that recovers the data from them. Every column is recovered
    /// within a root mean square of `truncation`; `None` where that takes nearly as many modes as columns. `affine`
    /// says whether the solver has the affine functions.
    ///
    /// Costs some `6 · rows · columns²` flops, about as much as one product with a block of `columns` sources.
    pub fn of(
        data: &Values,
        points: &[Point],
        weights: &[f64],
        affine: bool,
        truncation: f64,
    ) -> Option<(Values, Self)> {
        let affine = affine.then(|| affine_part(data, points, weights)).flatten();
        let mut rest = data.clone();
        if let Some(affine) = &affine {
            let mut values = Values::zeros(data.rows(), data.columns());
            values.add_affine(affine.as_slice(), points);
            rest = data.minus(&values);
        }
        let factors = factors_of(&rest, weights, truncation)?;
        let modes = product(&rest, as_matrix(&factors).transpose());
        Some((modes, Self { factors, affine }))
    }

    /// The coefficients for the data from those for the modes: rows for the sources, then for the affine functions if
    /// the solver has them.
    pub fn coefficients(&self, modes: &Values) -> Values {
        let mut combined = product(modes, as_matrix(&self.factors));
        if let Some(affine) = &self.affine {
            let first = combined.rows() - affine.rows();
            for function in 0..affine.rows() {
                let row = combined.row_mut(first + function).iter_mut();
                row.zip(affine.row(function)).for_each(|(sum, a)| *sum += a);
            }
        }
        combined
    }

    /// The values at points, from those of the modes there.
    pub fn values(&self, modes: &Values, points: &[Point]) -> Values {
        let mut combined = product(modes, as_matrix(&self.factors));
        if let Some(affine) = &self.affine {
            combined.add_affine(affine.as_slice(), points);
        }
        combined
    }
}

/// The least-squares affine function for each column of data; `None` where the points do not determine it.
fn affine_part(data: &Values, points: &[Point], weights: &[f64]) -> Option<Values> {
    let columns = data.columns();
    let mut normal = Matrix4::zeros();
    let mut products = vec![0.0; 4 * columns];
    for (r, (p, weight)) in points.iter().zip(weights).enumerate() {
        let functions = affine_functions(p);
        for (i, function) in functions.iter().enumerate() {
            let factor = weight * function;
            (0..4).for_each(|j| normal[(i, j)] += factor * functions[j]);
            let sums = products[i * columns..][..columns].iter_mut();
            sums.zip(data.row(r)).for_each(|(sum, value)| *sum += factor * value);
        }
    }
    let decomposed = normal.cholesky()?;
    let mut affine = Values::zeros(4, columns);
    for k in 0..columns {
        let solved = decomposed.solve(&Vector4::from_fn(|i, _| products[i * columns + k]));
        (0..4).for_each(|i| affine.row_mut(i)[k] = solved[i]);
    }
    affine.as_slice().iter().all(|a| a.is_finite()).then_some(affine)
}

/// As rows, the right singular vectors of the weighted data that `truncation` keeps, the largest singular value
/// first.
fn factors_of(data: &Values, weights: &[f64], truncation: f64) -> Option<Values> {
    let columns = data.columns();
    let total: f64 = weights.iter().sum();
    if columns < 2 || data.rows() == 0 {
        return None;
    }
    let triangle = triangular_factor(data, weights);
    if !triangle.is_all_finite() {
        return None;
    }
    let decomposed = triangle.thin_svd().ok()?;
    let sizes = decomposed.S().column_vector();
    let allowed = total * truncation * truncation;
    if allowed <= (SVD_ACCURACY * sizes[0]).powi(2) {
        return None;
    }
    let mut left_out = 0.0;
    let dropped = (0..sizes.nrows())
        .rev()
        .take_while(|&i| {
            left_out += sizes[i] * sizes[i];
            left_out <= allowed
        })
        .count();
    let kept = (sizes.nrows() - dropped).max(1);
    if kept as f64 > WORTHWHILE * columns as f64 {
        return None;
    }
    let rows = (0..kept).flat_map(|mode| (0..columns).map(move |column| (mode, column)));
    let entries = rows.map(|(mode, column)| decomposed.V()[(column, mode)]);
    Some(Values::new(columns, entries.collect()))
}

/// The triangular QR factor of the weighted data, with the same singular values and right singular vectors: of parts of
/// the rows, then of the stacked factors (Demmel, Grigori, Hoemmen, Langou, *Communication-optimal parallel and
/// sequential QR and LU factorizations*, SIAM J. Sci. Comput. 34, 2012).
fn triangular_factor(data: &Values, weights: &[f64]) -> Mat<f64> {
    let columns = data.columns();
    let part = |(rows, weights): (&[f64], &[f64])| {
        let entry = |r: usize, c: usize| weights[r].sqrt() * rows[r * columns + c];
        Mat::from_fn(weights.len(), columns, entry).qr().thin_R().to_owned()
    };
    let parts: Vec<Mat<f64>> = data
        .as_slice()
        .par_chunks(ROWS_PER_TASK * columns)
        .zip(weights.par_chunks(ROWS_PER_TASK))
        .map(part)
        .collect();
    let mut stacked = Mat::zeros(parts.iter().map(Mat::nrows).sum(), columns);
    let mut rows = 0;
    for part in &parts {
        stacked.submatrix_mut(rows, 0, part.nrows(), columns).copy_from(part);
        rows += part.nrows();
    }
    stacked.qr().thin_R().to_owned()
}

fn product(values: &Values, matrix: MatRef<'_, f64>) -> Values {
    let (from, to) = (values.columns(), matrix.ncols());
    let mut out = Values::zeros(values.rows(), to);
    out.as_mut_slice()
        .par_chunks_mut(ROWS_PER_TASK * to)
        .zip(values.as_slice().par_chunks(ROWS_PER_TASK * from))
        .for_each(|(out, rows)| {
            let count = rows.len() / from;
            matmul(
                MatMut::from_row_major_slice_mut(out, count, to),
                Accum::Replace,
                MatRef::from_row_major_slice(rows, count, from),
                matrix,
                1.0,
                Par::Seq,
            );
        });
    out
}

fn as_matrix(values: &Values) -> MatRef<'_, f64> {
    MatRef::from_row_major_slice(values.as_slice(), values.rows(), values.columns())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 5000;

    fn weights() -> Vec<f64> {
        (0..ROWS).map(|r| 1.0 + 0.5 * (r as f64).sin()).collect()
    }

    fn points() -> Vec<Point> {
        let coordinate = |r: usize, k: f64| (k * r as f64).cos();
        (0..ROWS)
            .map(|r| Point::new(coordinate(r, 1.1), coordinate(r, 2.3), coordinate(r, 0.7)))
            .collect()
    }

    /// Columns that combine `count` waves, each with another wave of size `own` added.
    fn data(columns: usize, count: usize, own: f64) -> Values {
        let wave = |r: usize, i: usize| (r as f64 * (0.01 + 0.37 * i as f64)).sin();
        let entry = |r: usize, c: usize| {
            let shared: f64 = (0..count).map(|i| ((c * (i + 2)) as f64).cos() * wave(r, i)).sum();
            shared + own * wave(r, 100 + c)
        };
        let entries = (0..ROWS).flat_map(|r| (0..columns).map(move |c| entry(r, c)));
        Values::new(columns, entries.collect())
    }

    fn modes_of(data: &Values, affine: bool, truncation: f64) -> Option<(Values, BasisModes)> {
        BasisModes::of(data, &points(), &weights(), affine, truncation)
    }

    fn largest_rms(a: &Values, b: &Values) -> f64 {
        let weights = weights();
        let total: f64 = weights.iter().sum();
        let square = |c: usize| {
            let rows = (0..ROWS).map(|r| weights[r] * (a.row(r)[c] - b.row(r)[c]).powi(2));
            (rows.sum::<f64>() / total).sqrt()
        };
        (0..a.columns()).map(square).fold(0.0, f64::max)
    }

    #[test]
    fn data_of_few_waves_have_as_many_modes() {
        let data = data(30, 4, 0.0);
        for affine in [false, true] {
            let (modes, basis) = modes_of(&data, affine, 1e-6).unwrap();
            assert_eq!(modes.columns(), 4);
            assert!(largest_rms(&basis.values(&modes, &points()), &data) < 1e-7);
        }
    }

    /// The modes leave out the wave that only one column has; its root mean square is `own / √2`.
    #[test]
    fn no_column_loses_more_than_the_truncation() {
        let own = 1e-4;
        let data = data(30, 4, own);
        let truncation = 30f64.sqrt() * own;
        let (modes, basis) = modes_of(&data, true, truncation).unwrap();
        assert_eq!(modes.columns(), 4);
        let lost = largest_rms(&basis.values(&modes, &points()), &data);
        assert!(lost > 0.5 * own && lost <= truncation, "{lost:e}");
        assert!(modes_of(&data, true, 0.1 * own).is_none());
    }

    #[test]
    fn norms_over_all_modes_are_those_over_all_data() {
        let data = data(12, 3, 0.0);
        let (modes, _) = modes_of(&data, false, 1e-6).unwrap();
        let square = |values: &Values| values.dot(values, &weights()).iter().sum::<f64>();
        assert!((square(&modes) / square(&data) - 1.0).abs() < 1e-12);
    }

    /// Errors of the modes do not enter an affine column.
    #[test]
    fn affine_columns_have_no_part_in_the_modes() {
        let (mut data, points) = (data(9, 2, 0.0), points());
        let affine = |p: &Point| 3.0 - p.x + 2.0 * p.z;
        (0..ROWS).for_each(|r| data.row_mut(r)[4] = affine(&points[r]));
        let (modes, basis) = modes_of(&data, true, 1e-6).unwrap();
        assert_eq!(modes.columns(), 2);
        let wrong = Values::new(2, modes.as_slice().iter().map(|v| v + 1.0).collect());
        let values = basis.values(&wrong, &points);
        assert!((0..ROWS).all(|r| (values.row(r)[4] - affine(&points[r])).abs() < 1e-12));
        let coefficients = basis.coefficients(&Values::zeros(7, 2));
        for (function, expected) in [3.0, -1.0, 0.0, 2.0].into_iter().enumerate() {
            assert!((coefficients.row(3 + function)[4] - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn data_that_are_not_finite_or_needed_to_the_last_digits_have_no_modes() {
        let mut bad = data(6, 2, 0.0);
        bad.row_mut(7)[3] = f64::NAN;
        assert!(modes_of(&bad, true, 1e-3).is_none());
        assert!(modes_of(&data(6, 2, 0.0), true, 1e-15).is_none());
        assert!(modes_of(&data(1, 1, 0.0), true, 1e-3).is_none());
    }
}
