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
use super::spectral::{Rows, descend, nearest_rows};
use crate::Vector;
use crate::spherical::check_embedding;

/// Eigenfunctions of a map that assignments are compared by.
pub(super) const MODES: usize = 20;
/// Length over which a point's descriptor falls by a factor of e, where the area is 1.
const RANGE: f64 = 0.5;
/// Rounds of refinement.
const ROUNDS: usize = 6;

/// A map from the samples of one surface to another surface.
#[derive(Debug, Clone)]
pub(super) struct SampledMap {
    /// For each sample of the domain, the vertex of the target's simplified surface.
    pub images: Vec<u32>,
    /// `‖CᵀC − I‖² / 20` of the functional map `C` of 20 modes.
    pub defect: f64,
    /// How often it covers the target's sphere.
    pub degree: f64,
}

/// Distances of all vertices of the simplified surfaces from a point of the domain and from its partner on the target.
pub(super) type PointPair<'a> = [&'a [f64]; 2];

/// The map that matched points determine. `directions` are those of the target's vertices, before simplification.
pub(super) fn map_of_points(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    directions: &[Vector],
    pairs: &[PointPair],
) -> Option<SampledMap> {
    let modes = MODES.min(domain.modes()).min(target.modes());
    let mut images = nearest_by_distances(domain, target, pairs);
    let mut matrix = fit(domain, target, &images, modes)?;
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
    let check = check_embedding(&domain.simplified.sample_triangles, &places.collect::<Vec<_>>());
    Some(SampledMap {
        images,
        defect: defect(&matrix),
        degree: check.degree,
    })
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
fn defect(matrix: &DMatrix<f64>) -> f64 {
    let n = matrix.ncols();
    (matrix.transpose() * matrix - DMatrix::identity(n, n)).norm_squared() / n as f64
}

/// For each sample of the domain, the vertex of the target whose distances from the points are the most similar.
fn nearest_by_distances(domain: &IntrinsicShape, target: &IntrinsicShape, pairs: &[PointPair]) -> Vec<u32> {
    let rows = |side: usize, samples: &[u32]| -> Vec<f64> {
        let row = |&v: &u32| pairs.iter().map(move |pair| (-pair[side][v as usize] / RANGE).exp());
        samples.iter().flat_map(row).collect()
    };
    let [from, to] = [rows(0, &domain.simplified.samples), rows(1, &target.simplified.samples)];
    let [from, to] = [&from, &to].map(|entries| Rows {
        entries,
        stride: pairs.len(),
        used: pairs.len(),
    });
    let nearest = nearest_rows(from, to);
    nearest
        .iter()
        .map(|&sample| target.simplified.samples[sample as usize])
        .collect()
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
