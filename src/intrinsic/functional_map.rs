//! A functional map from matched points, and how close it is to that of an isometry.
//!
//! Ovsjanikov, Ben-Chen, Solomon, Butscher, Guibas, *Functional maps: a flexible representation of maps between shapes*,
//! ACM Trans. Graph. 31 (2012): a map between surfaces is a small matrix between their eigenfunctions, orthogonal if the
//! map keeps areas and commuting with the Laplacians if it is an isometry. The matrix is refined as there, by nearest
//! neighbours in turn with least squares.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DMatrixView};

use super::IntrinsicShape;
use super::descriptors::map_of_descriptors;
use super::spectral::{Rows, descend, nearest_rows};
use crate::geometry::solid_angle;
use crate::{Point, Vector};

/// Eigenfunctions of a map that assignments are compared by.
pub(super) const MODES: usize = 20;
/// Rounds of refinement.
const ROUNDS: usize = 6;

/// A map from the samples of one surface to another surface.
#[derive(Debug, Clone)]
pub(super) struct SampledMap {
    /// For each sample of the domain, the vertex of the target's simplified surface.
    pub images: Vec<u32>,
    /// `‖CᵀC − I‖² / 20` of the functional map `C` of 20 modes.
    pub defect: f64,
    /// How much of the target's sphere it covers: see [`coverage`].
    pub coverage: f64,
}

/// Distances of all vertices of the simplified surfaces from a point of the domain and from its partner on the target.
pub(super) type PointPair<'a> = [&'a [f64]; 2];

/// Triangles with a larger solid angle do not count as covered: their corners are on different limbs.
const MOST_COVERED: f64 = std::f64::consts::FRAC_PI_2;

/// The map that matched points determine: that which preserves functions of the distances from them, refined by nearest
/// neighbours in turn with least squares. `directions` are those of the target's vertices, before simplification.
pub(super) fn map_of_points(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    directions: &[Vector],
    pairs: &[PointPair],
) -> Option<SampledMap> {
    let modes = MODES.min(domain.modes()).min(target.modes());
    let mut matrix = map_of_descriptors(domain, target, pairs, modes)?;
    let mut images = Vec::new();
    for _ in 0..ROUNDS {
        let next = images_of_samples(domain, target, &matrix);
        if next == images {
            break;
        }
        images = next;
        matrix = fit(domain, target, &images, modes)?;
    }
    let places = images
        .iter()
        .map(|&v| directions[target.simplified.originals[v as usize] as usize]);
    let coverage = coverage(&domain.simplified.sample_triangles, &places.collect::<Vec<_>>());
    Some(SampledMap {
        images,
        defect: defect(&matrix),
        coverage,
    })
}

/// The solid angle that triangles cover with their front less that with their back, as a fraction of the sphere: about 1 when
/// the map preserves orientation, −1 when it reverses it. In contrast to the degree, one rough triangle does not change it by
/// 1: those whose corners are far apart do not count.
fn coverage(triangles: &[[u32; 3]], directions: &[Vector]) -> f64 {
    let angle = |corners: &[u32; 3]| {
        let corners = corners.map(|v| directions[v as usize].into());
        solid_angle(&Point::origin(), &corners)
    };
    let angles = triangles.iter().map(angle).filter(|angle| angle.abs() < MOST_COVERED);
    angles.sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// The matrix `C` of `modes` modes for which rows of the domain's eigenfunctions at its samples, times `C`, are closest to
/// those of the target's at the samples' images: weighted least squares. `None` when the samples do not determine it.
pub(super) fn fit(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    images: &[u32],
    modes: usize,
) -> Option<DMatrix<f64>> {
    let (count, stride) = (images.len(), target.modes());
    let mut at_images = Vec::with_capacity(count * modes);
    for (&image, weight) in images.iter().zip(&domain.sample_weights) {
        at_images.extend(target.eigenpairs.at(image)[..modes].iter().map(|x| weight * x));
    }
    debug_assert!(modes <= stride);
    let mut products = DMatrix::zeros(modes, modes);
    matmul(
        MatMut::from_column_major_slice_mut(products.as_mut_slice(), modes, modes),
        Accum::Replace,
        MatRef::from_row_major_slice_with_stride(&domain.sample_rows, count, modes, domain.modes()).transpose(),
        MatRef::from_row_major_slice(&at_images, count, modes),
        1.0,
        Par::Seq,
    );
    let factor = domain.gram_factor.view((0, 0), (modes, modes));
    let is_solved =
        factor.solve_lower_triangular_mut(&mut products) && factor.tr_solve_lower_triangular_mut(&mut products);
    (is_solved && products.iter().all(|x| x.is_finite())).then_some(products)
}

/// The vertices of the target nearest to the domain's samples under a functional map.
pub(super) fn images_of_samples(domain: &IntrinsicShape, target: &IntrinsicShape, matrix: &DMatrix<f64>) -> Vec<u32> {
    nearest_vertices(&mapped(domain.sampled_rows(matrix.nrows()), matrix), target)
}

/// The vertices of a surface whose eigenfunctions are nearest to rows of as many entries as count.
pub(super) fn nearest_vertices(queries: &DMatrix<f64>, target: &IntrinsicShape) -> Vec<u32> {
    let modes = queries.nrows();
    let queries = Rows {
        entries: queries.as_slice(),
        stride: modes,
        used: modes,
    };
    let nearest = nearest_rows(queries, target.sampled_rows(modes));
    let rows = target.all_rows(modes);
    let finer = nearest.iter().enumerate().map(|(q, &sample)| {
        let start = target.simplified.samples[sample as usize];
        descend(queries.of(q), rows, &target.neighbours, start)
    });
    finer.collect()
}

/// Rows times a matrix: the rows of the product are the columns of the result.
pub(super) fn mapped(rows: Rows, matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let (modes, count) = (matrix.nrows(), rows.count());
    let mut out = DMatrix::zeros(modes, count);
    matmul(
        MatMut::from_column_major_slice_mut(out.as_mut_slice(), modes, count),
        Accum::Replace,
        MatRef::from_column_major_slice(matrix.as_slice(), modes, modes).transpose(),
        rows.matrix(0, count).transpose(),
        1.0,
        Par::Seq,
    );
    out
}

/// `‖CᵀC − I‖²` over the number of columns.
pub(super) fn defect(matrix: &DMatrix<f64>) -> f64 {
    let n = matrix.ncols();
    (matrix.transpose() * matrix - DMatrix::identity(n, n)).norm_squared() / n as f64
}

/// The Cholesky factor of the weighted products of eigenfunctions over the samples. Those of fewer modes are its leading
/// blocks.
pub(super) fn gram_factor(rows: &[f64], weights: &[f64], modes: usize) -> Option<DMatrix<f64>> {
    let rows = DMatrixView::from_slice(rows, modes, weights.len());
    let mut weighted = rows.clone_owned();
    for (mut column, weight) in weighted.column_iter_mut().zip(weights) {
        column *= *weight;
    }
    let gram = weighted * rows.transpose();
    Some(gram.cholesky()?.unpack())
}
