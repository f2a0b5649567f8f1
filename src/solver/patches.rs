//! Least-squares solves on overlapping patches of sources, each with the collocation points around it: a restricted
//! additive Schwarz method (Cai and Sarkis, *A restricted additive Schwarz preconditioner for general sparse linear
//! systems*, SIAM J. Sci. Comput. 21, 1999) with rectangular matrices.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

use super::schwarz::Level;
use super::{SolveError, Values};
use crate::Point;
use crate::kernel::direct;
use crate::partition::Partition;
use crate::progress::ProgressResponse;

/// Added to the unit diagonal of a patch's normal matrix; raised a hundredfold until that is positive definite.
const RIDGE: f64 = 1e-13;
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

struct Patch {
    /// Those of the overlap, then those of the core. Solutions are kept in the core only.
    sources: Vec<u32>,
    core: usize,
    /// Among the level's rows.
    rows: Vec<u32>,
    /// The columns of the inverse normal matrix that belong to the core: `sources × core`.
    inverse: Mat<f64>,
}

impl Patches {
    /// Partitions the level's sources into cores of at most `core`, and factors each with the sources up to `overlap`
    /// spacings around it.
    ///
    /// Costs about `rows · sources²` flops per patch; keeps `8 · core · sources` bytes of each.
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
            let make = |core: &&[u32]| {
                let mut sources = partition.reaching(core);
                let mut ascending: Vec<u32> = core.to_vec();
                ascending.sort_unstable();
                sources.retain(|s| ascending.binary_search(s).is_err());
                sources.extend(&ascending);
                Patch::new(level, &points, sources, core.len(), &rows_of)
            };
            patches.par_extend(chunk.par_iter().map(make));
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
        let solve = |patch: &Patch| {
            let mut solution = Mat::zeros(patch.core, columns);
            matmul(
                solution.as_mut(),
                Accum::Replace,
                patch.inverse.transpose(),
                &rhs(patch),
                1.0,
                Par::Seq,
            );
            solution
        };
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
    fn new(level: &Level, points: &[Point], sources: Vec<u32>, core: usize, rows_of: &[Vec<u32>]) -> Self {
        let rows: Vec<u32> = sources.iter().flat_map(|&s| &rows_of[s as usize]).copied().collect();
        let at: Vec<Point> = rows.iter().map(|&r| points[r as usize]).collect();
        let from: Vec<Point> = sources.iter().map(|&s| level.sources[s as usize]).collect();
        let mut matrix = local_matrix(&at, &from);
        let roots: Vec<f64> = rows.iter().map(|&r| level.weights[r as usize].sqrt()).collect();
        for column in matrix.chunks_exact_mut(rows.len().max(1)) {
            column.iter_mut().zip(&roots).for_each(|(entry, root)| *entry *= root);
        }
        let inverse = core_inverse(
            MatRef::from_column_major_slice(&matrix, rows.len(), sources.len()),
            core,
        );
        Self {
            sources,
            core,
            rows,
            inverse,
        }
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
            let reversed = direct::Sources::new(&from, &weights).expect("a weight for each row");
            for (i, sums) in direct::potential(&reversed, &at).iter().enumerate() {
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

/// Kernel values: a row per point of `at`, column after column of points of `from`.
fn local_matrix(at: &[Point], from: &[Point]) -> Vec<f64> {
    let mut matrix = vec![0.0; at.len() * from.len()];
    direct::fill_matrix(at, from, &mut matrix).expect("an entry for each pair");
    matrix
}

/// The last `core` columns of `(AᵀA)⁻¹`, by Cholesky of the matrix scaled to a unit diagonal.
fn core_inverse(matrix: MatRef<'_, f64>, core: usize) -> Mat<f64> {
    let n = matrix.ncols();
    let mut normal = Mat::<f64>::zeros(n, n);
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
    let reciprocal_roots = (0..n).map(|i| normal[(i, i)].sqrt().recip());
    let scales: Vec<f64> = reciprocal_roots.map(|s| if s.is_finite() { s } else { 0.0 }).collect();
    let scratch = cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let mut ridge = RIDGE;
    let factor = loop {
        let mut scaled = Mat::<f64>::zeros(n, n);
        for j in 0..n {
            let below = scaled.col_as_slice_mut(j)[j..].iter_mut();
            let entries = below.zip(&normal.col_as_slice(j)[j..]).zip(&scales[j..]);
            entries.for_each(|((out, entry), scale)| *out = entry * scale * scales[j]);
            scaled[(j, j)] = 1.0 + ridge;
        }
        let result = cholesky_in_place(
            scaled.as_mut(),
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        if result.is_ok() || ridge > 1.0 {
            break scaled;
        }
        ridge *= 100.0;
    };
    let mut inverse = Mat::<f64>::zeros(n, core);
    (0..core).for_each(|c| inverse[(n - core + c, c)] = 1.0);
    let overlap = n - core;
    // The right-hand sides vanish above the core, also after the forward substitution.
    let trailing = factor.submatrix(overlap, overlap, core, core);
    triangular_solve::solve_lower_triangular_in_place(trailing, inverse.as_mut().subrows_mut(overlap, core), Par::Seq);
    triangular_solve::solve_upper_triangular_in_place(factor.transpose(), inverse.as_mut(), Par::Seq);
    for c in 0..core {
        let own = scales[overlap + c];
        let column = inverse.col_as_slice_mut(c).iter_mut();
        column.zip(&scales).for_each(|(entry, scale)| *entry *= scale * own);
    }
    inverse
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

    /// The condition number is about 1e3, so the normal equations lose six of sixteen digits. Up to three columns are
    /// projected by kernel sums, more by matrix products.
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
            let size = expected.as_slice().iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for (a, b) in found.as_slice().iter().zip(expected.as_slice()) {
                assert!((a - b).abs() < 1e-8 * size, "{columns} columns: {a} and {b}");
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
