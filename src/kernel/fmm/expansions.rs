//! The sweeps over expansions: sources to multipoles up the tree, multipoles to locals across it, locals down.
//!
//! An expansion of `columns` right-hand sides is as many columns of `rank` entries, and the expansions of all cells lie
//! one after the other by slot. Each task owns the expansions that it writes and sums in a fixed order, so results do
//! not depend on threads.

use std::ops::{AddAssign, Mul, Range};

use faer::linalg::matmul::matmul;
use faer::traits::ComplexField;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::lists::{GROUP, Lists, Translation};
use super::operators::{Operators, SurfaceBlocks, Translations};
use super::single::unit_sources;
use super::tree::{Tree, TreeCell};
use super::weights::PassWeights;
use crate::kernel::direct::{self, Instructions, LANES, SingleSource, TargetBlock};

/// What a pass over the tree works with.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a> {
    pub(super) tree: &'a Tree,
    pub(super) lists: &'a Lists,
    pub(super) operators: &'a Operators,
    pub(super) instructions: Instructions,
    pub(super) weights: &'a PassWeights,
}

/// Cells of a task: enough columns for a product, and many tasks in a level.
const CELLS: usize = 32;
/// Columns of a product: with an operator they fit a second-level cache.
const PRODUCT_COLUMNS: usize = 256;

impl Pass<'_> {
    pub(super) fn columns(&self) -> usize {
        self.weights.columns
    }

    /// Entries of an expansion, all columns together.
    pub(super) fn stride(&self) -> usize {
        self.operators.rank * self.columns()
    }

    /// Multipole expansions of all cells with sources.
    pub(super) fn multipoles(&self) -> Vec<f64> {
        let (stride, cells) = (self.stride(), &self.lists.source_cells);
        let mut multipoles = vec![0.0; cells.len() * stride];
        for level in self.levels(cells).into_iter().rev() {
            let (upper, finer) = multipoles.split_at_mut(level.end * stride);
            upper[level.start * stride..]
                .par_chunks_mut(CELLS * stride)
                .zip(cells[level.clone()].par_chunks(CELLS))
                .for_each(|(expansions, cells)| {
                    self.collect_sources(cells, expansions);
                    self.raise_children(cells, level.end, finer, expansions);
                });
        }
        multipoles
    }

    /// Local expansions of all cells with targets.
    pub(super) fn locals(&self, multipoles: &[f64]) -> Vec<f64> {
        let mut locals = match &self.operators.translations {
            Translations::Single(operators) => self.translate(operators, multipoles),
            Translations::Double(operators) => self.translate(operators, multipoles),
        };
        let (stride, cells) = (self.stride(), &self.lists.target_cells);
        for level in self.levels(cells) {
            let (coarser, own) = locals.split_at_mut(level.start * stride);
            own[..level.len() * stride]
                .par_chunks_mut(CELLS * stride)
                .zip(cells[level.clone()].par_chunks(CELLS))
                .enumerate()
                .for_each(|(chunk, (expansions, cells))| {
                    self.lower_parents(cells, coarser, expansions);
                    self.collect_coarser(level.start + chunk * CELLS, expansions);
                });
        }
        locals
    }

    /// Slots of each level.
    fn levels(&self, cells: &[u32]) -> Vec<Range<usize>> {
        let starts: Vec<usize> = self
            .tree
            .levels
            .iter()
            .map(|&start| cells.partition_point(|&cell| (cell as usize) < start))
            .collect();
        starts.windows(2).map(|w| w[0]..w[1]).collect()
    }

    fn cell(&self, cell: u32) -> &TreeCell {
        &self.tree.cells[cell as usize]
    }

    /// Expansions of leaves, from the potential of their sources at the outer surface.
    fn collect_sources(&self, cells: &[u32], expansions: &mut [f64]) {
        let leaves: Vec<usize> = (0..cells.len()).filter(|&i| self.cell(cells[i]).is_leaf()).collect();
        if leaves.is_empty() {
            return;
        }
        let points = self.operators.outer.len();
        let mut potentials = vec![0.0; points * self.columns() * leaves.len()];
        for (&leaf, potentials) in leaves.iter().zip(potentials.chunks_mut(points * self.columns())) {
            let cell = self.cell(cells[leaf]);
            self.add_potential_of(cell.sources.clone(), cell, &self.operators.outer_blocks, potentials);
        }
        let found = self.product(self.operators.inverse.as_ref(), &potentials, 1.0);
        for (&leaf, found) in leaves.iter().zip(found.chunks(self.stride())) {
            expansions[leaf * self.stride()..][..self.stride()].copy_from_slice(found);
        }
    }

    /// Adds to `out` (points of `blocks` × columns) the potential of sources in units of `cell`.
    fn add_potential_of(&self, sources: Range<usize>, cell: &TreeCell, blocks: &SurfaceBlocks, out: &mut [f64]) {
        let points = out.len() / self.columns();
        let to_unit = self.tree.to_unit(cell);
        if !self.weights.rows.is_empty() {
            let positions = self.tree.sources.positions[sources.clone()].iter();
            let positions: Vec<_> = positions.map(|&p| to_unit(p)).collect();
            let out = MatMut::from_column_major_slice_mut(out, points, self.columns());
            return self.add_products(&positions, self.weight_rows(sources), &blocks.double, 1.0, out);
        }
        for (packed, out) in self.weights.triples.iter().zip(out.chunks_mut(3 * points)) {
            let packed = &packed[sources.clone()];
            let mut sums = vec![[[0.0; LANES]; 3]; blocks.double.len()];
            if self.operators.has_single_sums {
                // Nothing here is close: the surface is more than a half-width from all these sources.
                let local: Vec<SingleSource> = unit_sources(packed, &to_unit).collect();
                direct::add_potential_in_single(self.instructions, &local, &blocks.single, &mut sums);
            } else {
                let local = packed.iter().map(|&[x, y, z, w0, w1, w2]| {
                    let [x, y, z] = to_unit([x, y, z]);
                    [x, y, z, w0, w1, w2]
                });
                let local: Vec<_> = local.collect();
                direct::add_potential(self.instructions, &local, &blocks.double, &mut sums);
            }
            for (column, out) in out.chunks_mut(points).enumerate() {
                for (out, sums) in out.chunks_mut(LANES).zip(&sums) {
                    for (out, sum) in out.iter_mut().zip(&sums[column]) {
                        *out += sum;
                    }
                }
            }
        }
    }

    /// The weights of a range of sources, one row each.
    pub(super) fn weight_rows(&self, sources: Range<usize>) -> MatRef<'_, f64> {
        let (len, columns) = (sources.len(), self.columns());
        MatRef::from_row_major_slice(
            &self.weights.rows[sources.start * columns..][..len * columns],
            len,
            columns,
        )
    }

    /// Adds to `out` (targets × columns) `factor` times the potential of points with a row of weights each.
    pub(super) fn add_products(
        &self,
        points: &[[f64; 3]],
        weights: MatRef<'_, f64>,
        targets: &[TargetBlock],
        factor: f64,
        out: MatMut<'_, f64>,
    ) {
        direct::add_products(points, weights, factor, out, |point, column| {
            direct::write_column(self.instructions, *point, 1.0, targets, column);
        });
    }

    /// Expansions of inner cells, from those of their children, whose slots begin at `first`.
    fn raise_children(&self, cells: &[u32], first: usize, finer: &[f64], expansions: &mut [f64]) {
        let children: Vec<(usize, usize)> = cells
            .iter()
            .enumerate()
            .flat_map(|(i, &cell)| self.cell(cell).children.clone().map(move |child| (i, child)))
            .filter(|&(_, child)| !self.tree.cells[child].sources.is_empty())
            .collect();
        if children.is_empty() {
            return;
        }
        let mut gathered = vec![0.0; children.len() * self.stride()];
        for (&(_, child), to) in children.iter().zip(gathered.chunks_mut(self.stride())) {
            let slot = self.lists.source_slot[child] as usize - first;
            let expansion = &finer[slot * self.stride()..][..self.stride()];
            reflect(expansion, self.flip(child), to, |to, value| *to = value);
        }
        let raised = self.product(self.operators.upward.as_ref(), &gathered, 1.0);
        for (&(parent, child), raised) in children.iter().zip(raised.chunks(self.stride())) {
            let expansion = &mut expansions[parent * self.stride()..][..self.stride()];
            reflect(raised, self.flip(child), expansion, |to, value| *to += value);
        }
    }

    /// Adds the expansions of parents.
    fn lower_parents(&self, cells: &[u32], coarser: &[f64], expansions: &mut [f64]) {
        if coarser.is_empty() {
            return;
        }
        let mut gathered = vec![0.0; cells.len() * self.stride()];
        for (&cell, to) in cells.iter().zip(gathered.chunks_mut(self.stride())) {
            let slot = self.lists.target_slot[self.cell(cell).parent as usize] as usize;
            let parent = &coarser[slot * self.stride()..][..self.stride()];
            reflect(parent, self.flip(cell as usize), to, |to, value| *to = value);
        }
        // Potentials are in units of 1 / half-width, which halves from parent to child.
        let lowered = self.product(self.operators.upward.transpose(), &gathered, 0.5);
        let expansions = expansions.chunks_mut(self.stride());
        for ((&cell, lowered), expansion) in cells.iter().zip(lowered.chunks(self.stride())).zip(expansions) {
            reflect(lowered, self.flip(cell as usize), expansion, |to, value| *to += value);
        }
    }

    /// Adds what coarser leaves contribute source by source; `first` is the slot of the first expansion.
    fn collect_coarser(&self, first: usize, expansions: &mut [f64]) {
        for (i, expansion) in expansions.chunks_mut(self.stride()).enumerate() {
            let leaves = self.lists.coarser.row(first + i);
            if leaves.is_empty() {
                continue;
            }
            let cell = self.cell(self.lists.target_cells[first + i]);
            let mut potentials = vec![0.0; self.operators.inner.len() * self.columns()];
            for &leaf in leaves {
                let sources = self.cell(leaf).sources.clone();
                self.add_potential_of(sources, cell, &self.operators.inner_blocks, &mut potentials);
            }
            let found = self.product(self.operators.basis.transpose(), &potentials, 1.0);
            for (entry, found) in expansion.iter_mut().zip(found) {
                *entry += found;
            }
        }
    }

    /// Applies the V lists, in the precision of the operators throughout: single precision halves the memory traffic.
    fn translate<T: Real>(&self, operators: &[Mat<T>], multipoles: &[f64]) -> Vec<f64> {
        let stride = self.stride();
        let multipoles: Vec<T> = multipoles
            .par_iter()
            .with_min_len(1 << 14)
            .map(|&m| T::from_f64(m))
            .collect();
        let signs = self
            .operators
            .signs
            .each_ref()
            .map(|signs| signs.iter().map(|&s| T::from_f64(s)).collect());
        let mut locals = vec![0.0; self.lists.target_cells.len() * stride];
        locals
            .par_chunks_mut(GROUP * stride)
            .enumerate()
            .for_each(|(group, locals)| {
                let translations = self.lists.groups[group] as usize..self.lists.groups[group + 1] as usize;
                let sums = self.translate_group(operators, &signs, &multipoles, &self.lists.translations[translations]);
                for (local, sum) in locals.iter_mut().zip(sums) {
                    *local = sum.to_f64();
                }
            });
        locals
    }

    fn translate_group<T: Real>(
        &self,
        operators: &[Mat<T>],
        signs: &[Vec<T>; 8],
        multipoles: &[T],
        translations: &[Translation],
    ) -> Vec<T> {
        let (rank, stride) = (self.operators.rank, self.stride());
        let batch = PRODUCT_COLUMNS.div_ceil(self.columns());
        let mut sums = vec![T::default(); GROUP * stride];
        let mut gathered = vec![T::default(); batch * stride];
        let mut moved = vec![T::default(); batch * stride];
        for same in translations.chunk_by(|a, b| a.operator == b.operator) {
            let operator = operators[same[0].operator as usize].as_ref();
            for batch in same.chunks(batch) {
                for (translation, to) in batch.iter().zip(gathered.chunks_mut(stride)) {
                    let from = &multipoles[translation.source as usize * stride..][..stride];
                    reflect(from, &signs[translation.flip as usize], to, |to, value| *to = value);
                }
                let columns = batch.len() * self.columns();
                matmul(
                    MatMut::from_column_major_slice_mut(&mut moved[..rank * columns], rank, columns),
                    Accum::Replace,
                    operator,
                    MatRef::from_column_major_slice(&gathered[..rank * columns], rank, columns),
                    T::from_f64(1.0),
                    Par::Seq,
                );
                for (translation, from) in batch.iter().zip(moved.chunks(stride)) {
                    let to = &mut sums[translation.target as usize % GROUP * stride..][..stride];
                    reflect(from, &signs[translation.flip as usize], to, |to, value| *to += value);
                }
            }
        }
        sums
    }

    /// Signs of an expansion's entries under the reflection of a child's octant into the upper one.
    fn flip(&self, child: usize) -> &[f64] {
        &self.operators.signs[7 ^ self.tree.cells[child].octant as usize]
    }

    /// `factor × matrix × columns`, both column after column.
    pub(super) fn product(&self, matrix: MatRef<'_, f64>, columns: &[f64], factor: f64) -> Vec<f64> {
        let count = columns.len() / matrix.ncols();
        let mut out = vec![0.0; matrix.nrows() * count];
        matmul(
            MatMut::from_column_major_slice_mut(&mut out, matrix.nrows(), count),
            Accum::Replace,
            matrix,
            MatRef::from_column_major_slice(columns, matrix.ncols(), count),
            factor,
            Par::Seq,
        );
        out
    }
}

/// Hands each entry of an expansion, times its sign under a reflection, to `store`.
#[inline]
fn reflect<T: Copy + Mul<Output = T>>(from: &[T], signs: &[T], to: &mut [T], store: impl Fn(&mut T, T)) {
    let rank = signs.len();
    for (from, to) in from.chunks_exact(rank).zip(to.chunks_exact_mut(rank)) {
        for ((&from, &sign), to) in from.iter().zip(signs).zip(to) {
            store(to, from * sign);
        }
    }
}

/// A precision for the translations across the tree.
trait Real: ComplexField + Copy + Default + Mul<Output = Self> + AddAssign {
    fn from_f64(value: f64) -> Self;
    fn to_f64(self) -> f64;
}

impl Real for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }

    fn to_f64(self) -> f64 {
        self
    }
}

impl Real for f32 {
    fn from_f64(value: f64) -> Self {
        value as f32
    }

    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}
