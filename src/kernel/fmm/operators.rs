//! Expansions about the unit cell `[-1, 1]³` and the matrices that translate them.
//!
//! # Notation
//!
//! `E` and `C` are the points of an inner and an outer cube surface, [`INNER`] and [`OUTER`] times the cell, and
//! `K[i, j] = 1 / |C_i − E_j|`. With the singular value decomposition `K = U S Vᵀ`, truncated,
//!
//! - a *multipole* expansion `m` stands for the weights `V m` at `E`, which give the far potential of the cell's sources;
//! - a *local* expansion `l` holds `Vᵀ` times the potential of far sources at `E`, and stands for weights `U S⁻¹ l` at
//!   `C`, which give that potential inside the cell.
//!
//! Both are well conditioned, unlike the weights themselves, and no longer than the accuracy calls for. The surfaces
//! are symmetric in each coordinate plane and so is every singular vector, up to sign: one operator serves all octants
//! of a parent, and 56 serve all 316 offsets.
//!
//! # References
//!
//! Ying, Biros, Zorin, *A kernel-independent adaptive fast multipole algorithm in two and three dimensions*, J. Comput.
//! Phys. 196 (2004); Fong & Darve, *The black-box fast multipole method*, J. Comput. Phys. 228 (2009), for truncation.

use std::sync::{Arc, OnceLock};

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::DMatrix;

use super::lists::canonical_offsets;
use crate::kernel::direct::{LANES, TargetBlock};

const INNER: f64 = 1.05;
const OUTER: f64 = 2.95;

/// How finely expansions resolve the field, least accurate first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ExpansionResolution {
    /// Greatest relative error of a sum for which this one is chosen.
    pub(super) accuracy: f64,
    /// Points along an edge of the surfaces.
    order: usize,
    /// Singular values are kept above this, relative to the first.
    cutoff: f64,
    /// What is calculated in single precision.
    single: SinglePrecision,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum SinglePrecision {
    Nothing,
    /// Translations between multipole and local expansions.
    Translations,
    /// The kernel between points in sums of potentials, too.
    Kernel,
}

const fn resolution(accuracy: f64, order: usize, cutoff: f64, single: SinglePrecision) -> ExpansionResolution {
    ExpansionResolution {
        accuracy,
        order,
        cutoff,
        single,
    }
}

/// For each accuracy, the cheapest order and cutoff of those tried that reached about half of it: relative errors in
/// the Euclidean norm over all targets, three columns of weights of random sign, 20,000 sources about 20,000 targets on
/// a bumpy sphere, and as many in a cube.
///
/// | accuracy | order | rank | sphere | cube | cube, gradient |
/// |---|---|---|---|---|---|
/// | 1e-2 | 3 | 13 | 3.0e-3 | 4.6e-3 | 2.7e-3 |
/// | 1e-3 | 4 | 39 | 2.0e-4 | 3.0e-4 | 2.4e-4 |
/// | 1e-4 | 5 | 64 | 2.6e-5 | 4.0e-5 | 3.8e-5 |
/// | 1e-5 | 6 | 100 | 4.0e-6 | 5.8e-6 | 7.5e-6 |
/// | 3e-6 | 7 | 112 | 1.2e-6 | 1.8e-6 | 2.4e-6 |
/// | 1e-6 | 8 | 138 | 3.6e-7 | 5.4e-7 | 7.5e-7 |
/// | 1e-7 | 9 | 213 | 2.3e-8 | 3.3e-8 | 6.1e-8 |
/// | 1e-8 | 11 | 268 | 2.4e-9 | 3.3e-9 | 6.7e-9 |
/// | 1e-9 | 12 | 346 | 2.7e-10 | 3.9e-10 | 9.9e-10 |
/// | 1e-10 | 13 | 420 | 3.3e-11 | 6.7e-11 | 1.4e-10 |
///
/// With weights of one sign potentials are ten times as accurate, and gradients, whose terms cancel, up to five times
/// less accurate. Order 10 is left out: it gained nothing over order 9.
pub(super) const RESOLUTIONS: [ExpansionResolution; 10] = [
    resolution(1e-2, 3, 1e-2, SinglePrecision::Kernel),
    resolution(1e-3, 4, 3e-4, SinglePrecision::Kernel),
    resolution(1e-4, 5, 3e-5, SinglePrecision::Kernel),
    resolution(1e-5, 6, 3e-6, SinglePrecision::Translations),
    resolution(3e-6, 7, 3e-6, SinglePrecision::Translations),
    resolution(1e-6, 8, 1e-6, SinglePrecision::Translations),
    resolution(1e-7, 9, 3e-8, SinglePrecision::Nothing),
    resolution(1e-8, 11, 1e-8, SinglePrecision::Nothing),
    resolution(1e-9, 12, 1e-9, SinglePrecision::Nothing),
    resolution(1e-10, 13, 1e-10, SinglePrecision::Nothing),
];

/// The coarsest resolution that reaches `accuracy`, or the finest there is.
pub(super) fn resolution_for(accuracy: f64) -> usize {
    RESOLUTIONS
        .iter()
        // Some slack, so that an accuracy such as 1e-6 is not missed by the rounding of the caller's arithmetic.
        .position(|r| r.accuracy <= accuracy * 1.001)
        .unwrap_or(RESOLUTIONS.len() - 1)
}

#[derive(Debug)]
pub(super) struct Operators {
    /// Length of an expansion.
    pub(super) rank: usize,
    /// Whether the kernel between points is in single precision where potentials are summed.
    pub(super) has_single_sums: bool,
    /// Points of `E` and of `C`.
    pub(super) inner: Vec<[f64; 3]>,
    pub(super) outer: Vec<[f64; 3]>,
    pub(super) inner_blocks: SurfaceBlocks,
    pub(super) outer_blocks: SurfaceBlocks,
    /// `V`.
    pub(super) basis: Mat<f64>,
    /// `S⁻¹ Uᵀ`: from potentials at `C` to a multipole expansion; transposed, from a local expansion to weights at `C`.
    pub(super) inverse: Mat<f64>,
    /// From the multipole expansion of the child in the upper octant to its parent's; transposed and halved, from local
    /// expansions of parents to those of children.
    pub(super) upward: Mat<f64>,
    pub(super) translations: Translations,
    /// For each set of reflected axes, the sign that each entry of an expansion takes.
    pub(super) signs: [Vec<f64>; 8],
}

/// Operators from multipole to local expansions, in the order of [`canonical_offsets`].
#[derive(Debug)]
pub(super) enum Translations {
    Single(Vec<Mat<f32>>),
    Double(Vec<Mat<f64>>),
}

impl Operators {
    /// The operators of a resolution, formed when first asked for.
    pub(super) fn of(resolution: usize) -> Arc<Self> {
        static CACHE: [OnceLock<Arc<Operators>>; RESOLUTIONS.len()] = [const { OnceLock::new() }; RESOLUTIONS.len()];
        // Nothing in `new` may use the thread pool: a thread that waits there could take up work that waits here.
        CACHE[resolution]
            .get_or_init(|| Arc::new(Self::new(RESOLUTIONS[resolution])))
            .clone()
    }

    fn new(resolution: ExpansionResolution) -> Self {
        let inner = surface(resolution.order, INNER);
        let outer = surface(resolution.order, OUTER);
        let SymmetricSvd {
            left,
            values,
            right,
            parity,
        } = decompose(&inner, &outer, resolution.cutoff);
        let inverse = Mat::from_fn(values.len(), outer.len(), |i, j| left[(j, i)] / values[i]);
        let child: Vec<_> = inner.iter().map(|p| p.map(|c| 0.5 * (c + 1.0))).collect();
        let upward = product(
            inverse.as_ref(),
            product(kernel(&outer, &child).as_ref(), right.as_ref()).as_ref(),
        );
        let translations = canonical_offsets().map(|offset| {
            let there: Vec<_> = inner
                .iter()
                .map(|p| std::array::from_fn(|axis| p[axis] + 2.0 * offset[axis] as f64))
                .collect();
            product(
                right.transpose(),
                product(kernel(&there, &inner).as_ref(), right.as_ref()).as_ref(),
            )
        });
        Self {
            rank: values.len(),
            has_single_sums: resolution.single >= SinglePrecision::Kernel,
            inner_blocks: SurfaceBlocks::new(&inner),
            outer_blocks: SurfaceBlocks::new(&outer),
            inverse,
            upward,
            translations: if resolution.single >= SinglePrecision::Translations {
                let single = |m: Mat<f64>| Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] as f32);
                Translations::Single(translations.map(single).collect())
            } else {
                Translations::Double(translations.collect())
            },
            signs: std::array::from_fn(|flip| {
                let sign = |p: &usize| if (p & flip).count_ones() % 2 == 1 { -1.0 } else { 1.0 };
                parity.iter().map(sign).collect()
            }),
            basis: right,
            inner,
            outer,
        }
    }
}

/// Grid points with `order` along an edge on the surface of a cube of half-width `radius`.
fn surface(order: usize, radius: f64) -> Vec<[f64; 3]> {
    let last = order as i64 - 1;
    let mut points = Vec::new();
    for code in 0..order.pow(3) as i64 {
        let steps = [
            code / (order * order) as i64,
            code / order as i64 % order as i64,
            code % order as i64,
        ];
        if steps.iter().any(|&s| s == 0 || s == last) {
            // Symmetric to the last bit about zero.
            points.push(steps.map(|s| radius * (2 * s - last) as f64 / last as f64));
        }
    }
    points
}

fn kernel(targets: &[[f64; 3]], sources: &[[f64; 3]]) -> Mat<f64> {
    Mat::from_fn(targets.len(), sources.len(), |i, j| {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| targets[i][axis] - sources[j][axis]);
        1.0 / (x * x + y * y + z * z).sqrt()
    })
}

fn product(left: MatRef<'_, f64>, right: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(left.nrows(), right.ncols());
    matmul(out.as_mut(), Accum::Replace, left, right, 1.0, Par::Seq);
    out
}

/// The points of a surface as targets.
#[derive(Debug)]
pub(super) struct SurfaceBlocks {
    pub(super) double: Vec<TargetBlock>,
    pub(super) single: Vec<TargetBlock<f32>>,
}

impl SurfaceBlocks {
    fn new(points: &[[f64; 3]]) -> Self {
        let single = |p: &[f64; 3]| p.map(|c| c as f32);
        Self {
            double: blocks(points),
            single: points.chunks(LANES).map(|p| TargetBlock::mapped(p, single)).collect(),
        }
    }
}

pub(super) fn blocks(points: &[[f64; 3]]) -> Vec<TargetBlock> {
    points.chunks(LANES).map(|p| TargetBlock::mapped(p, |p| *p)).collect()
}

/// The truncated singular value decomposition of `K`, by symmetry classes.
struct SymmetricSvd {
    left: Mat<f64>,
    values: Vec<f64>,
    right: Mat<f64>,
    /// Bit `k` is set where a singular vector is odd in axis `k`.
    parity: Vec<usize>,
}

fn decompose(inner: &[[f64; 3]], outer: &[[f64; 3]], cutoff: f64) -> SymmetricSvd {
    let full = kernel(outer, inner);
    let mut triples = Vec::new();
    for parity in 0..8 {
        let class = symmetric_vectors(inner, parity);
        let part = product(class.transpose(), product(full.as_ref(), class.as_ref()).as_ref());
        let svd = DMatrix::from_fn(part.nrows(), part.ncols(), |i, j| part[(i, j)]).svd(true, true);
        let (Some(left), Some(right)) = (svd.u, svd.v_t) else {
            continue;
        };
        let left = product(
            class.as_ref(),
            Mat::from_fn(left.nrows(), left.ncols(), |i, j| left[(i, j)]).as_ref(),
        );
        let right = product(
            class.as_ref(),
            Mat::from_fn(right.ncols(), right.nrows(), |i, j| right[(j, i)]).as_ref(),
        );
        for (i, &value) in svd.singular_values.iter().enumerate() {
            triples.push((value, parity, left.col(i).to_owned(), right.col(i).to_owned()));
        }
    }
    let largest = triples.iter().map(|t| t.0).fold(0.0, f64::max);
    triples.retain(|t| t.0 > cutoff * largest);
    SymmetricSvd {
        left: Mat::from_fn(outer.len(), triples.len(), |i, j| triples[j].2[i]),
        right: Mat::from_fn(inner.len(), triples.len(), |i, j| triples[j].3[i]),
        values: triples.iter().map(|t| t.0).collect(),
        parity: triples.iter().map(|t| t.1).collect(),
    }
}

/// An orthonormal basis of the vectors over `points` that are odd in the axes of `parity` and even in the others.
fn symmetric_vectors(points: &[[f64; 3]], parity: usize) -> Mat<f64> {
    let odd = |axis: usize| parity >> axis & 1 == 1;
    let is_representative = |p: &[f64; 3]| (0..3).all(|axis| p[axis] > 0.0 || (p[axis] == 0.0 && !odd(axis)));
    let representatives: Vec<_> = points.iter().filter(|p| is_representative(p)).collect();
    Mat::from_fn(points.len(), representatives.len(), |i, j| {
        let (point, representative) = (points[i], representatives[j]);
        if (0..3).any(|axis| point[axis].abs() != representative[axis]) {
            return 0.0;
        }
        let images = representative.iter().filter(|&&c| c != 0.0).count() as i32;
        let flips = (0..3).filter(|&axis| odd(axis) && point[axis] < 0.0).count();
        let sign = if flips % 2 == 1 { -1.0 } else { 1.0 };
        sign * 0.5f64.powi(images).sqrt()
    })
}
