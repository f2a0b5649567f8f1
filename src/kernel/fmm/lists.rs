//! Which cells act on which, and how: the U, V, W and X lists of the adaptive method.
//!
//! One descent over the cells that hold targets carries the source cells that touch the current one. What stops touching
//! it is far: a cell of the same size acts by a translation of expansions (V), a coarser leaf on the local expansion (X).
//! At a leaf, what still touches is opened until only leaves touch (U), and what is finer and does not touch acts by its
//! multipole expansion (W). Where so few points are involved that an expansion costs more than it saves, the sources
//! act directly, as in U.

use std::ops::Range;

use super::tree::{NONE, Tree};

/// A translation from the multipole expansion of one cell to the local expansion of another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Translation {
    /// Group of target slots. Translations are sorted by their fields in this order, and applied so.
    pub(super) group: u32,
    pub(super) operator: u8,
    /// Axes to reflect, one bit each.
    pub(super) flip: u8,
    pub(super) target: u32,
    pub(super) source: u32,
}

/// A list of values for each of many items.
#[derive(Debug, Default)]
pub(super) struct RaggedRows<T> {
    starts: Vec<u32>,
    values: Vec<T>,
}

impl<T> RaggedRows<T> {
    fn from_pairs(count: usize, mut pairs: Vec<(u32, T)>) -> Self {
        pairs.sort_by_key(|pair| pair.0);
        let mut starts = vec![0; count + 1];
        for (row, _) in &pairs {
            starts[*row as usize + 1] += 1;
        }
        for row in 0..count {
            starts[row + 1] += starts[row];
        }
        Self {
            starts,
            values: pairs.into_iter().map(|pair| pair.1).collect(),
        }
    }

    pub(super) fn row(&self, row: usize) -> &[T] {
        &self.values[self.starts[row] as usize..self.starts[row + 1] as usize]
    }
}

#[derive(Debug)]
pub(super) struct Lists {
    /// Slot of the multipole expansion of each cell, in the order of cells; [`NONE`] without sources.
    pub(super) source_slot: Vec<u32>,
    /// Slot of the local expansion of each cell; [`NONE`] without targets, and below a cell where the descent ends.
    pub(super) target_slot: Vec<u32>,
    /// Cells by slot.
    pub(super) source_cells: Vec<u32>,
    pub(super) target_cells: Vec<u32>,
    /// V lists, sorted.
    pub(super) translations: Vec<Translation>,
    /// Where each group of target slots begins in `translations`.
    pub(super) groups: Vec<u32>,
    /// Where targets are evaluated, in the order of the targets.
    pub(super) leaves: Vec<TargetLeaf>,
    /// For each of the leaves, ranges of sources that act directly, ascending.
    pub(super) near: RaggedRows<Range<usize>>,
    /// W lists: for each of the leaves, cells whose multipole expansions are evaluated at its targets.
    pub(super) finer: RaggedRows<u32>,
    /// X lists: for each target slot, leaves whose sources act on the local expansion.
    pub(super) coarser: RaggedRows<u32>,
}

/// Targets that are evaluated together, with the local expansion of one cell.
#[derive(Debug, Clone)]
pub(super) struct TargetLeaf {
    pub(super) cell: u32,
    pub(super) targets: Range<usize>,
}

/// Most targets of a leaf: a cell where the descent ends for lack of near sources may hold any number.
const LEAF_TARGETS: usize = 512;

/// Where an expansion becomes cheaper than its sources one by one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Thresholds {
    /// Pairs of a source and a target up to which two cells interact directly rather than by a translation (V).
    pub(super) pairs: usize,
    /// Sources up to which a cell acts directly rather than by its multipole expansion (W), and targets up to which a
    /// cell is acted on directly rather than by its local expansion (X).
    pub(super) points: usize,
}

/// Target slots of a group: enough to fill the columns of a product with each operator, few enough for many tasks.
pub(super) const GROUP: usize = 256;

impl Lists {
    pub(super) fn new(tree: &Tree, thresholds: Thresholds) -> Self {
        let (source_slot, source_cells) = slots(tree, |cell| !tree.cells[cell].sources.is_empty());
        let mut builder = ListBuilder {
            tree,
            thresholds,
            source_slot: &source_slot,
            translations: Vec::new(),
            leaves: Vec::new(),
            near: Vec::new(),
            finer: Vec::new(),
            coarser: Vec::new(),
            is_visited: vec![false; tree.cells.len()],
        };
        if !tree.cells[0].targets.is_empty() && !tree.cells[0].sources.is_empty() {
            builder.visit(0, &[0], &[]);
        }
        let (leaves, mut translations, mut coarser) = (builder.leaves, builder.translations, builder.coarser);
        let (target_slot, target_cells) = slots(tree, |cell| builder.is_visited[cell]);
        for translation in &mut translations {
            translation.target = target_slot[translation.target as usize];
            translation.group = translation.target / GROUP as u32;
        }
        translations.sort_unstable();
        for (target, _) in &mut coarser {
            *target = target_slot[*target as usize];
        }
        let group_count = target_cells.len().div_ceil(GROUP) as u32;
        let groups = (0..=group_count)
            .map(|g| translations.partition_point(|t| t.group < g) as u32)
            .collect();
        Self {
            translations,
            groups,
            near: RaggedRows::from_pairs(leaves.len(), builder.near),
            finer: RaggedRows::from_pairs(leaves.len(), builder.finer),
            coarser: RaggedRows::from_pairs(target_cells.len(), coarser),
            leaves,
            source_slot,
            target_slot,
            source_cells,
            target_cells,
        }
    }
}

/// The slot of each cell, [`NONE`] for those without one, and the cells by slot.
fn slots(tree: &Tree, has_slot: impl Fn(usize) -> bool) -> (Vec<u32>, Vec<u32>) {
    let mut slot = vec![NONE; tree.cells.len()];
    let mut cells = Vec::new();
    for (cell, slot) in slot.iter_mut().enumerate() {
        if has_slot(cell) {
            *slot = cells.len() as u32;
            cells.push(cell as u32);
        }
    }
    (slot, cells)
}

/// Names target cells by their index: they get slots when all visited cells are known.
struct ListBuilder<'a> {
    tree: &'a Tree,
    thresholds: Thresholds,
    source_slot: &'a [u32],
    translations: Vec<Translation>,
    leaves: Vec<TargetLeaf>,
    near: Vec<(u32, Range<usize>)>,
    finer: Vec<(u32, u32)>,
    coarser: Vec<(u32, u32)>,
    is_visited: Vec<bool>,
}

impl ListBuilder<'_> {
    /// `touching`: source cells of the level of `cell`, or coarser leaves, that touch it. `near`: further source cells
    /// that act directly on all its targets.
    ///
    /// Stops where hardly any sources touch, however many the targets: smaller cells would gain nothing, and gradients
    /// lose digits as the cell shrinks against the distance of the sources.
    fn visit(&mut self, cell: usize, touching: &[u32], near: &[u32]) {
        let tree = self.tree;
        self.is_visited[cell] = true;
        let touching_sources: usize = touching.iter().map(|&c| tree.cells[c as usize].sources.len()).sum();
        if touching_sources <= self.thresholds.points {
            return self.finish(cell, &[touching, near].concat(), &[]);
        }
        if tree.cells[cell].is_leaf() {
            let (more, finer) = self.open(cell, touching);
            return self.finish(cell, &[near, &more].concat(), &finer);
        }
        for child in tree.cells[cell].children.clone() {
            if tree.cells[child].targets.is_empty() {
                continue;
            }
            let mut child_touching = Vec::with_capacity(32);
            let mut child_near = near.to_vec();
            for &other in touching {
                self.relate(child, other, &mut child_touching, &mut child_near);
            }
            self.visit(child, &child_touching, &child_near);
        }
    }

    /// Sorts `other`, which touches the parent of `child`, or its children.
    fn relate(&mut self, child: usize, other: u32, touching: &mut Vec<u32>, near: &mut Vec<u32>) {
        let tree = self.tree;
        let target = &tree.cells[child];
        let source = &tree.cells[other as usize];
        if source.is_leaf() {
            if source.touches(target) {
                touching.push(other);
            } else if target.targets.len() <= self.thresholds.points {
                near.push(other);
            } else {
                self.coarser.push((child as u32, other));
            }
            return;
        }
        for part in source.children.clone() {
            let source = &tree.cells[part];
            if source.sources.is_empty() {
                continue;
            }
            if source.touches(target) {
                touching.push(part as u32);
            } else if source.sources.len() * target.targets.len() <= self.thresholds.pairs {
                near.push(part as u32);
            } else {
                let (operator, flip) = operator_of(target.offset_from(source));
                self.translations.push(Translation {
                    group: 0,
                    operator,
                    flip,
                    target: child as u32,
                    source: self.source_slot[part],
                });
            }
        }
    }

    /// Divides the cells that touch a leaf, and their descendants, into those that act on it directly and those that act
    /// through their multipole expansions, of which it returns the slots.
    fn open(&self, leaf: usize, touching: &[u32]) -> (Vec<u32>, Vec<u32>) {
        let (mut near, mut finer) = (Vec::new(), Vec::new());
        let mut open = touching.to_vec();
        while let Some(other) = open.pop() {
            let source = &self.tree.cells[other as usize];
            let touches = source.touches(&self.tree.cells[leaf]);
            if touches && !source.is_leaf() {
                let with_sources = |&part: &usize| !self.tree.cells[part].sources.is_empty();
                open.extend(source.children.clone().filter(with_sources).map(|part| part as u32));
            } else if touches || source.sources.len() <= self.thresholds.points {
                near.push(other);
            } else {
                finer.push(self.source_slot[other as usize]);
            }
        }
        (near, finer)
    }

    fn finish(&mut self, cell: usize, near: &[u32], finer: &[u32]) {
        let near = self.merged_sources(near);
        let targets = self.tree.cells[cell].targets.clone();
        for first in targets.clone().step_by(LEAF_TARGETS) {
            let number = self.leaves.len() as u32;
            self.leaves.push(TargetLeaf {
                cell: cell as u32,
                targets: first..targets.end.min(first + LEAF_TARGETS),
            });
            self.near.extend(near.iter().map(|range| (number, range.clone())));
            self.finer.extend(finer.iter().map(|&slot| (number, slot)));
        }
    }

    /// The sources of cells, as ascending ranges of which adjacent ones are merged.
    fn merged_sources(&self, cells: &[u32]) -> Vec<Range<usize>> {
        let sources = cells.iter().map(|&cell| self.tree.cells[cell as usize].sources.clone());
        let mut ranges: Vec<Range<usize>> = sources.collect();
        ranges.sort_unstable_by_key(|range| range.start);
        ranges.dedup_by(|next, last| {
            let follows = next.start == last.end;
            if follows {
                last.end = next.end;
            }
            follows
        });
        ranges
    }
}

/// Offsets with components from 0 to 3, at least one of them above 1; see [`operator_of`].
pub(super) fn canonical_offsets() -> impl Iterator<Item = [i64; 3]> {
    (0..64)
        .map(|code| [code >> 4, code >> 2 & 3, code & 3])
        .filter(|offset| offset.iter().any(|&c| c > 1))
}

/// The number of the operator for an offset between cells, and the axes to reflect before and after.
fn operator_of(offset: [i64; 3]) -> (u8, u8) {
    let flip = (0..3).fold(0u8, |bits, axis| bits | u8::from(offset[axis] < 0) << axis);
    let [x, y, z] = offset.map(|c| c.unsigned_abs() as u8);
    let code = x << 4 | y << 2 | z;
    // Offsets without a component above one are skipped: 0, 1, 4, 5, 16, 17, 20, 21.
    let skipped = [0, 1, 4, 5, 16, 17, 20, 21].iter().filter(|&&c| c < code).count() as u8;
    (code - skipped, flip)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_and_reflections_name_the_operator() {
        let canonical: Vec<_> = canonical_offsets().collect();
        assert_eq!(canonical.len(), 56);
        for code in 0..343 {
            let offset = [code / 49 - 3, code / 7 % 7 - 3, code % 7 - 3];
            if offset.iter().all(|c: &i64| c.abs() < 2) {
                continue;
            }
            let (operator, flip) = operator_of(offset);
            let reflected: [i64; 3] = std::array::from_fn(|axis| {
                canonical[operator as usize][axis] * if flip >> axis & 1 == 1 { -1 } else { 1 }
            });
            assert_eq!(reflected, offset);
        }
    }
}
