//! The functional map that preserves functions of the distances from matched points.
//!
//! Section 5 of Ovsjanikov et al. (2012): a linear problem with the whole surface in it. Comparing distances point by point
//! takes points of one flank to the other flank where poses change distances by more than the flanks differ.

use nalgebra::{DMatrix, DVector};

use super::IntrinsicShape;
use super::functional_map::PointPair;

/// Lengths over which the functions fall by a factor of e, where the area is 1: from the tip of a limb to the body.
const RANGES: [f64; 4] = [0.1, 0.2, 0.4, 0.8];
/// Weight of commuting with the Laplacians, per function.
const COMMUTING: f64 = 0.01;
/// Added to the diagonal, so that few functions determine a map, too.
const TINY: f64 = 1e-9;

/// The map `C` of `modes` modes that takes `exp(−d/r)` of distances `d` on the target to those on the domain: least squares of
/// `C b − a` over the functions' coefficients `a` and `b`, and of the entries by how much eigenvalues differ. `None` when it is
/// not determined.
pub(super) fn map_of_descriptors(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    pairs: &[PointPair],
    modes: usize,
) -> Option<DMatrix<f64>> {
    let mut from = coefficients(domain, pairs.iter().map(|pair| pair[0]), modes)?;
    let mut to = coefficients(target, pairs.iter().map(|pair| pair[1]), modes)?;
    for k in 0..to.ncols() {
        let length = to.column(k).norm();
        from.column_mut(k).scale_mut(1.0 / length);
        to.column_mut(k).scale_mut(1.0 / length);
    }
    let (of_domain, of_target) = (&domain.eigenpairs.values[..modes], &target.eigenpairs.values[..modes]);
    let largest = of_domain[modes - 1].max(of_target[modes - 1]);
    let (gram, products) = (&to * to.transpose(), &to * from.transpose());
    let weight = COMMUTING * to.ncols() as f64;
    let mut map = DMatrix::zeros(modes, modes);
    for (k, value) in of_domain.iter().enumerate() {
        let mut matrix = gram.clone();
        for (l, other) in of_target.iter().enumerate() {
            matrix[(l, l)] += weight * ((value - other) / largest).powi(2) + TINY;
        }
        let row: DVector<f64> = matrix.cholesky()?.solve(&products.column(k));
        map.set_row(k, &row.transpose());
    }
    map.iter().all(|x| x.is_finite()).then_some(map)
}

/// The coefficients of `exp(−d/r)` for each of the distances `d` and ranges `r`, as columns: weighted least squares over the
/// samples.
fn coefficients<'a>(
    shape: &IntrinsicShape,
    distances: impl Iterator<Item = &'a [f64]>,
    modes: usize,
) -> Option<DMatrix<f64>> {
    let rows = shape.sampled_rows(modes);
    let mut columns = Vec::new();
    for distances in distances {
        for range in RANGES {
            let mut column = DVector::zeros(modes);
            for (place, (&sample, weight)) in shape.simplified.samples.iter().zip(&shape.sample_weights).enumerate() {
                let value = weight * (-distances[sample as usize] / range).exp();
                column
                    .iter_mut()
                    .zip(rows.of(place))
                    .for_each(|(sum, x)| *sum += value * x);
            }
            columns.push(column);
        }
    }
    let mut products = DMatrix::from_columns(&columns);
    let factor = shape.gram_factor.view((0, 0), (modes, modes));
    let is_solved =
        factor.solve_lower_triangular_mut(&mut products) && factor.tr_solve_lower_triangular_mut(&mut products);
    is_solved.then_some(products)
}
