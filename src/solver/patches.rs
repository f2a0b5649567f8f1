//! Least-squares solves on overlapping patches of sources, each with the collocation points around it: a restricted
//! additive Schwarz method (Cai and Sarkis, *A restricted additive Schwarz preconditioner for general sparse linear
//! systems*, SIAM J. Sci. Comput. 21, 1999) with rectangular matrices.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::schwarz::Level;
use super::{SolveError, Values};
use crate::Point;
use crate::kernel::direct;
use crate::partition::Partition;
use crate::progress::ProgressResponse;

/// Added to the unit diagonal of a patch's normal matrix, whose entries are rounded to single precision; raised tenfold until that
/// is positive definite. Of 1e-13 (with double precision) and 1e-8 to 1e-3, fits of five polycubes to three tolerances took about
/// the fewest sources with this; without, where sources are dense along creases, up to four times as many.
const RIDGE: f64 = 1e-5;
/// Patches factored between two reports of progress.
const PATCHES_PER_REPORT: usize = 64;

/// The patches of one level.
pub(super) struct Patches {
    patches: Vec<Patch>,
    sources: Vec<Point>,
    /// Positions and weights of the level's rows.
    points: Vec<Point>,
    weights: Vec<f64>,
}

/// Memory that a thread uses for one patch after the other.
#[derive(Default)]
struct Workspace {
    matrix: Vec<f64>,
    unit_matrix: Vec<f32>,
    normal: Vec<f32>,
    /// The factor of the normal matrix, then the right-hand sides.
    factor: Vec<f64>,
}

struct Patch {
    /// Those of the overlap, then those of the core. Solutions are kept in the core only.
    sources: Vec<u32>,
    core: usize,
    /// Among the level's rows.
    rows: Vec<u32>,
    /// Reciprocal norms of the sources' columns.
    scales: Vec<f64>,
    /// The columns of the inverse normal matrix of unit columns that belong to the core: `sources × core`. A correction need not
    /// be exact.
    inverse: Mat<f32>,
}

impl Patches {
    /// Partitions the level's sources into cores of at most `core`, and factors each with the sources up to `overlap`
    /// spacings around it.
    ///
    /// Costs about `rows · sources²` flops per patch; keeps `4 · core · sources` bytes of each.
    pub fn new<A: ProgressResponse>(
        level: &Level,
        points: Vec<Point>,
        core: usize,
        overlap: f64,
        progress: &dyn Fn(usize, usize) -> A,
    ) -> Result<Self, SolveError> {
        let partition = partition(level, core, overlap);
        let rows_of = rows_of_sources(level);
        let cores: Vec<&[u32]> = partition.parts().collect();
        let mut patches = Vec::with_capacity(cores.len());
        for chunk in cores.chunks(PATCHES_PER_REPORT) {
            if progress(patches.len(), cores.len()).control_flow().is_break() {
                return Err(SolveError::Cancelled);
            }
            let make = |memory: &mut Workspace, core: &&[u32]| {
                let mut sources = partition.reaching(core);
                let mut ascending: Vec<u32> = core.to_vec();
                ascending.sort_unstable();
                sources.retain(|s| ascending.binary_search(s).is_err());
                sources.extend(&ascending);
                Patch::new(level, &points, sources, core.len(), &rows_of, memory)
            };
            patches.par_extend(chunk.par_iter().map_init(Workspace::default, make));
        }
        Ok(Self {
            patches,
            sources: level.sources.clone(),
            points,
            weights: level.weights.clone(),
        })
    }

    /// Number of matrix entries that [`Self::new`] keeps, found without factoring. Overlaps grow where spacings change.
    pub fn count_entries(level: &Level, core: usize, overlap: f64) -> u64 {
        let partition = partition(level, core, overlap);
        let cores: Vec<&[u32]> = partition.parts().collect();
        let entries = |core: &&[u32]| (core.len() * partition.reaching(core).len()) as u64;
        cores.par_iter().map(entries).sum()
    }

    /// Corrections for a residual at the level's rows: coefficients, one row per source. Each patch takes its own rows
    /// only.
    pub fn solve(&self, residual: &Values) -> Values {
        self.solve_cores(residual.columns(), |patch| patch.project(self, residual))
    }

    /// The same for the gradient `Aᵀ W r` of the whole residual, given at the level's sources.
    pub fn solve_gradient(&self, gradient: &Values) -> Values {
        let local = |patch: &Patch| {
            Mat::from_fn(patch.sources.len(), gradient.columns(), |i, k| {
                gradient.row(patch.sources[i] as usize)[k]
            })
        };
        self.solve_cores(gradient.columns(), local)
    }

    /// Solves the normal equations of each patch for a right-hand side at its sources, and keeps the cores' part.
    fn solve_cores(&self, columns: usize, rhs: impl Fn(&Patch) -> Mat<f64> + Sync) -> Values {
        let solve = |patch: &Patch| patch.solve_core(&rhs(patch));
        let solved: Vec<Mat<f64>> = self.patches.par_iter().map(solve).collect();
        let mut solution = Values::zeros(self.sources.len(), columns);
        for (patch, part) in self.patches.iter().zip(&solved) {
            let core = &patch.sources[patch.sources.len() - patch.core..];
            for (i, &source) in core.iter().enumerate() {
                for (k, value) in solution.row_mut(source as usize).iter_mut().enumerate() {
                    *value = part[(i, k)];
                }
            }
        }
        solution
    }
}

/// The cores of a level, for sources that reach `overlap` spacings.
fn partition(level: &Level, core: usize, overlap: f64) -> Partition<'_> {
    let radii = level.spacing.iter().map(|h| overlap * h).collect();
    Partition::compact(&level.sources, radii, core)
}

impl Patch {
    fn new(
        level: &Level,
        points: &[Point],
        sources: Vec<u32>,
        core: usize,
        rows_of: &[Vec<u32>],
        memory: &mut Workspace,
    ) -> Self {
        let rows: Vec<u32> = sources.iter().flat_map(|&s| &rows_of[s as usize]).copied().collect();
        let at: Vec<Point> = rows.iter().map(|&r| points[r as usize]).collect();
        let from: Vec<Point> = sources.iter().map(|&s| level.sources[s as usize]).collect();
        let roots: Vec<f64> = rows.iter().map(|&r| level.weights[r as usize].sqrt()).collect();
        let matrix = first(&mut memory.matrix, rows.len() * sources.len());
        fill_local_matrix(&at, &from, matrix);
        let unit = first(&mut memory.unit_matrix, matrix.len());
        let scales = unit_columns(matrix, &roots, sources.len(), unit);
        let unit = MatRef::from_column_major_slice(unit, rows.len(), sources.len());
        Self {
            inverse: core_inverse(unit, core, &mut memory.normal, &mut memory.factor),
            sources,
            core,
            rows,
            scales,
        }
    }

    /// The core's part of the solution of the normal equations.
    ///
    /// Summed in double precision: in single precision, right-hand sides that differ by rounding would have solutions that differ
    /// by much more.
    fn solve_core(&self, rhs: &Mat<f64>) -> Mat<f64> {
        let (sources, columns) = (self.sources.len(), rhs.ncols());
        let own = &self.scales[sources - self.core..];
        let inverse = Mat::from_fn(sources, self.core, |i, j| f64::from(self.inverse[(i, j)]) * own[j]);
        let scaled = Mat::from_fn(sources, columns, |i, k| rhs[(i, k)] * self.scales[i]);
        let mut solution = Mat::zeros(self.core, columns);
        matmul(
            solution.as_mut(),
            Accum::Replace,
            inverse.transpose(),
            &scaled,
            1.0,
            Par::Seq,
        );
        solution
    }

    /// `Aᵀ W r` with the patch's rows and sources.
    fn project(&self, patches: &Patches, residual: &Values) -> Mat<f64> {
        let at: Vec<Point> = self.sources.iter().map(|&s| patches.sources[s as usize]).collect();
        let from: Vec<Point> = self.rows.iter().map(|&r| patches.points[r as usize]).collect();
        let columns = residual.columns();
        let weighted = |r: u32, k: usize| patches.weights[r as usize] * residual.row(r as usize)[k];
        let mut projected = Mat::zeros(at.len(), columns);
        if columns <= 3 {
            // The kernel is symmetric: the transposed product is the potential of the rows at the sources.
            let weight = |&r: &u32| std::array::from_fn(|k| if k < columns { weighted(r, k) } else { 0.0 });
            let weights: Vec<[f64; 3]> = self.rows.iter().map(weight).collect();
            for (i, sums) in potential(&from, &weights, &at).iter().enumerate() {
                (0..columns).for_each(|k| projected[(i, k)] = sums[k]);
            }
        } else {
            let matrix = local_matrix(&from, &at);
            let matrix = MatRef::from_column_major_slice(&matrix, from.len(), at.len());
            let rhs = Mat::from_fn(from.len(), columns, |i, k| weighted(self.rows[i], k));
            matmul(
                projected.as_mut(),
                Accum::Replace,
                matrix.transpose(),
                &rhs,
                1.0,
                Par::Seq,
            );
        }
        projected
    }
}

/// With values of the kernel in single precision, unless two points are so close that they need double.
fn potential(points: &[Point], weights: &[[f64; 3]], at: &[Point]) -> Vec<[f64; 3]> {
    let in_single = direct::potential_in_single(points, weights, at).expect("a weight for each row");
    in_single.unwrap_or_else(|| {
        let sources = direct::Sources::new(points, weights).expect("a weight for each row");
        direct::potential(&sources, at)
    })
}

/// Kernel values: a row per point of `at`, column after column of points of `from`.
fn local_matrix(at: &[Point], from: &[Point]) -> Vec<f64> {
    let mut matrix = vec![0.0; at.len() * from.len()];
    fill_local_matrix(at, from, &mut matrix);
    matrix
}

fn fill_local_matrix(at: &[Point], from: &[Point], matrix: &mut [f64]) {
    direct::fill_matrix(at, from, matrix).expect("an entry for each pair");
}

/// Writes the columns of a matrix with `weights` on its rows, each divided by its norm. Returns the reciprocal norms, zero for
/// columns that have none.
fn unit_columns(matrix: &[f64], weights: &[f64], columns: usize, unit: &mut [f32]) -> Vec<f64> {
    let rows = weights.len();
    let column = |j: usize| {
        let (column, unit) = (&matrix[j * rows..][..rows], &mut unit[j * rows..][..rows]);
        let weighted = || column.iter().zip(weights).map(|(entry, weight)| entry * weight);
        let scale = weighted().map(|entry| entry * entry).sum::<f64>().sqrt().recip();
        let scale = if scale.is_finite() { scale } else { 0.0 };
        unit.iter_mut()
            .zip(weighted())
            .for_each(|(out, entry)| *out = (entry * scale) as f32);
        scale
    };
    (0..columns).map(column).collect()
}

/// The first entries of memory that is used again, extended where it is too short.
fn first<T: Copy + Default>(memory: &mut Vec<T>, len: usize) -> &mut [T] {
    if memory.len() < len {
        memory.resize(len, T::default());
    }
    &mut memory[..len]
}

/// The last `core` columns of `(AᵀA)⁻¹` for a matrix with columns of norm one.
///
/// The normal matrix, most of the work, is summed in single precision, in half the time. It is factored in double precision:
/// with factors in single precision fits took up to a fifth less time, but that of an L, with sources dense along its creases,
/// a tenth more sources.
fn core_inverse(matrix: MatRef<'_, f32>, core: usize, normal: &mut Vec<f32>, factor: &mut Vec<f64>) -> Mat<f32> {
    let n = matrix.ncols();
    let mut normal = MatMut::from_column_major_slice_mut(first(normal, n * n), n, n);
    triangular::matmul(
        normal.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Replace,
        matrix.transpose(),
        BlockStructure::Rectangular,
        matrix,
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
    let (factor, right) = first(factor, n * (n + core)).split_at_mut(n * n);
    let mut factor = MatMut::from_column_major_slice_mut(factor, n, n);
    let scratch = cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let mut ridge = RIDGE;
    loop {
        for j in 0..n {
            (j + 1..n).for_each(|i| factor[(i, j)] = f64::from(normal[(i, j)]));
            factor[(j, j)] = 1.0 + ridge;
        }
        let result = cholesky_in_place(
            factor.as_mut(),
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        if result.is_ok() || ridge > 1.0 {
            break;
        }
        ridge *= 10.0;
    }
    let overlap = n - core;
    let mut right = MatMut::from_column_major_slice_mut(right, n, core);
    right.fill(0.0);
    (0..core).for_each(|c| right[(overlap + c, c)] = 1.0);
    // The right-hand sides vanish above the core, also after the forward substitution.
    let trailing = factor.as_ref().submatrix(overlap, overlap, core, core);
    triangular_solve::solve_lower_triangular_in_place(trailing, right.as_mut().subrows_mut(overlap, core), Par::Seq);
    triangular_solve::solve_upper_triangular_in_place(factor.as_ref().transpose(), right.as_mut(), Par::Seq);
    Mat::from_fn(n, core, |i, j| right[(i, j)] as f32)
}

/// The rows that each source owns.
fn rows_of_sources(level: &Level) -> Vec<Vec<u32>> {
    let mut rows_of = vec![Vec::new(); level.sources.len()];
    for (row, &source) in level.owner.iter().enumerate() {
        if source != Level::NO_OWNER {
            rows_of[source as usize].push(row as u32);
        }
    }
    rows_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::solver::{CollocationSystem, DenseFactor, DenseOptions};

    /// Sources at 1.2 spacings over the vertices of a ball; each owns its vertex and two points near it.
    fn level() -> (Level, Vec<Point>) {
        let anchors = shapes::sphere(1.0, 2).vertices().to_vec();
        let spacing = (4.0 * std::f64::consts::PI / anchors.len() as f64).sqrt();
        let near = |p: &Point, i: usize| {
            let side = p
                .coords
                .cross(&crate::Vector::new(0.3, 0.5 + i as f64, -0.7))
                .normalize();
            Point::from((p.coords + 0.35 * spacing * i as f64 * side).normalize())
        };
        let points: Vec<Point> = anchors.iter().flat_map(|p| [0, 1, 2].map(|i| near(p, i))).collect();
        let level = Level {
            sources: anchors.iter().map(|p| p * (1.0 + 1.2 * spacing)).collect(),
            spacing: vec![spacing; anchors.len()],
            rows: (0..points.len() as u32).collect(),
            owner: (0..points.len() as u32).map(|r| r / 3).collect(),
            weights: (0..points.len()).map(|r| 1.0 + 0.3 * (r as f64).sin()).collect(),
        };
        (level, points)
    }

    fn data(points: &[Point], columns: usize) -> Values {
        let value = |p: &Point, k: usize| (p.x + 0.3 * k as f64).exp() * (2.0 * p.y).cos() + p.z;
        let values = points.iter().flat_map(|p| (0..columns).map(move |k| value(p, k)));
        Values::new(columns, values.collect())
    }

    /// Up to three columns are projected by kernel sums, more by matrix products. The condition number is about 1e3, and its
    /// square times the rounding of single precision leaves some percent in the least singular directions. An iteration makes
    /// the residual some ten times smaller, and does not notice.
    #[test]
    fn a_single_patch_is_dense_least_squares() {
        let (level, points) = level();
        let patches = Patches::new(&level, points.clone(), level.sources.len(), 3.0, &|_, _| {}).unwrap();
        assert_eq!(patches.patches.len(), 1);
        let system = CollocationSystem {
            collocation: &points,
            row_weights: &level.weights.iter().map(|w| w.sqrt()).collect::<Vec<_>>(),
            sources: &level.sources,
            affine: false,
        };
        let dense = DenseFactor::new(&system, &DenseOptions::default()).unwrap();
        assert!(dense.condition() < 1e4, "{:e}", dense.condition());
        for columns in [1, 3, 5] {
            let data = data(&points, columns);
            let (found, expected) = (patches.solve(&data), dense.solve_columns(&data).unwrap());
            let size = |values: &Values| values.as_slice().iter().map(|v| v * v).sum::<f64>().sqrt();
            let difference = size(&found.minus(&expected));
            assert!(
                difference < 1e-2 * size(&expected),
                "{columns} columns: {:e}",
                difference / size(&expected)
            );
            let image = |coefficients: &Values| {
                let sums = crate::kernel::Sums::new(&level.sources, &points, 0.0).unwrap();
                Values::new(columns, sums.potential(coefficients.as_slice(), columns).unwrap())
            };
            let difference = size(&image(&found).minus(&image(&expected)));
            assert!(
                difference < 1e-2 * size(&data),
                "{columns} columns: {:e}",
                difference / size(&data)
            );
        }
    }

    /// Weights and data of any size are brought into the range of single precision.
    #[test]
    fn solutions_scale_with_data_and_weights() {
        let (level, points) = level();
        let data = data(&points, 3);
        let expected = Patches::new(&level, points.clone(), 30, 2.0, &|_, _| {})
            .unwrap()
            .solve(&data);
        for (of_data, of_weights) in [
            (2f64.powi(-200), 1.0),
            (2f64.powi(200), 2f64.powi(-160)),
            (1.0, 2f64.powi(160)),
        ] {
            let mut level = level.clone();
            level.weights.iter_mut().for_each(|w| *w *= of_weights);
            let scaled = Values::new(3, data.as_slice().iter().map(|v| v * of_data).collect());
            let found = Patches::new(&level, points.clone(), 30, 2.0, &|_, _| {})
                .unwrap()
                .solve(&scaled);
            for (found, expected) in found.as_slice().iter().zip(expected.as_slice()) {
                assert!(
                    (found / of_data - expected).abs() <= 1e-12 * expected.abs().max(1e-3),
                    "{found} {expected}"
                );
            }
        }
    }

    #[test]
    fn cores_partition_the_sources_and_patches_overlap() {
        let (level, points) = level();
        let patches = Patches::new(&level, points, 20, 2.0, &|_, _| {}).unwrap();
        let mut cores: Vec<u32> = Vec::new();
        for patch in &patches.patches {
            assert!(patch.core <= 20 && patch.sources.len() > patch.core);
            assert_eq!(patch.rows.len(), 3 * patch.sources.len());
            cores.extend(&patch.sources[patch.sources.len() - patch.core..]);
        }
        cores.sort_unstable();
        assert!(cores.into_iter().eq(0..162));
    }

    /// A source without rows of its own has a column at its neighbours' rows; coinciding sources make the normal matrix
    /// singular. Either way solutions are finite.
    #[test]
    fn doubled_and_empty_sources_stay_finite() {
        let (mut level, points) = level();
        level.sources[5] = level.sources[6];
        level.owner[27..30].fill(Level::NO_OWNER);
        let data = data(&points, 3);
        let solution = Patches::new(&level, points, 30, 2.0, &|_, _| {}).unwrap().solve(&data);
        assert!(solution.as_slice().iter().all(|v| v.is_finite()));
        level.owner.fill(Level::NO_OWNER);
        let nothing = Patches::new(&level, data_points(&level), 30, 2.0, &|_, _| {})
            .unwrap()
            .solve(&data);
        assert!(nothing.as_slice().iter().all(|v| *v == 0.0));
    }

    fn data_points(level: &Level) -> Vec<Point> {
        vec![Point::origin(); level.rows.len()]
    }
}
