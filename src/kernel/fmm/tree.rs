//! An octree over two sets of points, without empty cells.
//!
//! Cells are stored level after level, the children of a cell next to each other, and points in the order of the leaves,
//! so that the points of any cell are one range. The size of the root has few significant bits and its centre is a
//! multiple of a coarse quantum, so that the centre of every cell is exact in floating point and a point's offset from
//! it is rounded once only.

use std::array::from_fn;
use std::ops::Range;

use rayon::prelude::*;

/// Index of no cell.
pub(super) const NONE: u32 = u32::MAX;

/// A cube of the tree that holds points.
#[derive(Debug, Clone)]
pub(super) struct TreeCell {
    pub(super) level: u32,
    /// Corner of least coordinates, in cells of this level.
    position: [i64; 3],
    pub(super) centre: [f64; 3],
    pub(super) parent: u32,
    /// Which child of its parent: bit `k` is set on the upper side of axis `k`.
    pub(super) octant: u8,
    pub(super) children: Range<usize>,
    pub(super) sources: Range<usize>,
    pub(super) targets: Range<usize>,
}

impl TreeCell {
    pub(super) fn is_leaf(&self) -> bool {
        self.children.is_empty()
    }

    /// Whether the closed cubes touch or overlap.
    pub(super) fn touches(&self, other: &Self) -> bool {
        let finest = self.level.max(other.level);
        let (own, others) = (finest - self.level, finest - other.level);
        (0..3).all(|axis| {
            let (a, b) = (self.position[axis], other.position[axis]);
            (a << own) <= ((b + 1) << others) && (b << others) <= ((a + 1) << own)
        })
    }

    /// Offset from `other`, a cell of the same level, in cells.
    pub(super) fn offset_from(&self, other: &Self) -> [i64; 3] {
        std::array::from_fn(|axis| self.position[axis] - other.position[axis])
    }
}

/// Points in the order of the leaves, with their indices in the order of the caller.
#[derive(Debug)]
pub(super) struct Ordered {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) original: Vec<u32>,
}

#[derive(Debug)]
pub(super) struct Tree {
    pub(super) cells: Vec<TreeCell>,
    /// Where each level begins in `cells`; at the end, the number of cells.
    pub(super) levels: Vec<usize>,
    pub(super) sources: Ordered,
    pub(super) targets: Ordered,
    root_half_width: f64,
}

/// The most sources and targets of a cell that is not divided.
#[derive(Debug, Clone, Copy)]
pub(super) struct Capacity {
    pub(super) sources: usize,
    pub(super) targets: usize,
}

impl Tree {
    /// Divides cells until none holds more than `capacity`, or the centres of the next level could not be represented.
    /// Coordinates are finite and at most `2^300`; `original` has their indices.
    pub(super) fn new(sources: Ordered, targets: Ordered, capacity: Capacity) -> Self {
        let root = RootCube::around(&sources.positions, &targets.positions);
        let mut tree = Self {
            cells: vec![TreeCell {
                level: 0,
                position: [0; 3],
                centre: root.centre,
                parent: NONE,
                octant: 0,
                children: 0..0,
                sources: 0..sources.positions.len(),
                targets: 0..targets.positions.len(),
            }],
            levels: vec![0, 1],
            sources,
            targets,
            root_half_width: root.half_width,
        };
        for level in 0..root.deepest {
            let begin = tree.levels[level as usize];
            let is_full = |c: &TreeCell| c.sources.len() > capacity.sources || c.targets.len() > capacity.targets;
            let full: Vec<usize> = (begin..tree.cells.len()).filter(|&i| is_full(&tree.cells[i])).collect();
            if full.is_empty() {
                break;
            }
            tree.divide(&full);
        }
        tree
    }

    pub(super) fn half_width(&self, cell: &TreeCell) -> f64 {
        // Exact, and levels are fewer than the exponents of f64.
        self.root_half_width * 0.5f64.powi(cell.level as i32)
    }

    /// From a point to the same one relative to the centre of a cell, in units of its half-width.
    pub(super) fn to_unit(&self, cell: &TreeCell) -> impl Fn([f64; 3]) -> [f64; 3] + use<> {
        let (centre, up) = (cell.centre, 1.0 / self.half_width(cell));
        move |p| from_fn(|axis| (p[axis] - centre[axis]) * up)
    }

    /// The inverse of [`Self::to_unit`].
    pub(super) fn to_absolute(&self, cell: &TreeCell) -> impl Fn([f64; 3]) -> [f64; 3] + use<> {
        let (centre, half_width) = (cell.centre, self.half_width(cell));
        move |p| from_fn(|axis| centre[axis] + half_width * p[axis])
    }

    fn divide(&mut self, full: &[usize]) {
        let cells = &self.cells;
        let (sources, targets) = (&mut self.sources, &mut self.targets);
        let (source_counts, target_counts) = rayon::join(
            || sources.sort_by_octant(full.iter().map(|&i| (cells[i].sources.clone(), cells[i].centre))),
            || targets.sort_by_octant(full.iter().map(|&i| (cells[i].targets.clone(), cells[i].centre))),
        );
        for ((&parent, source_counts), target_counts) in full.iter().zip(source_counts).zip(target_counts) {
            self.add_children(parent, source_counts, target_counts);
        }
        self.levels.push(self.cells.len());
    }

    fn add_children(&mut self, parent: usize, source_counts: [usize; 8], target_counts: [usize; 8]) {
        let cell = self.cells[parent].clone();
        let quarter = 0.5 * self.half_width(&cell);
        let first = self.cells.len();
        let (mut sources, mut targets) = (cell.sources.start, cell.targets.start);
        for octant in 0..8 {
            let (source_count, target_count) = (source_counts[octant], target_counts[octant]);
            if source_count + target_count == 0 {
                continue;
            }
            let upper: [bool; 3] = std::array::from_fn(|axis| octant >> axis & 1 == 1);
            self.cells.push(TreeCell {
                level: cell.level + 1,
                position: std::array::from_fn(|axis| 2 * cell.position[axis] + i64::from(upper[axis])),
                centre: std::array::from_fn(|axis| cell.centre[axis] + if upper[axis] { quarter } else { -quarter }),
                parent: parent as u32,
                octant: octant as u8,
                children: 0..0,
                sources: sources..sources + source_count,
                targets: targets..targets + target_count,
            });
            sources += source_count;
            targets += target_count;
        }
        self.cells[parent].children = first..self.cells.len();
    }
}

/// The root's size and centre are multiples of a quantum that is so many bits below the size.
const SIZE_BITS: i32 = 8;

struct RootCube {
    centre: [f64; 3],
    half_width: f64,
    /// Levels below the root whose centres can be represented.
    deepest: u32,
}

impl RootCube {
    fn around(sources: &[[f64; 3]], targets: &[[f64; 3]]) -> Self {
        let mut lower = [f64::INFINITY; 3];
        let mut upper = [f64::NEG_INFINITY; 3];
        for p in sources.iter().chain(targets) {
            for axis in 0..3 {
                lower[axis] = lower[axis].min(p[axis]);
                upper[axis] = upper[axis].max(p[axis]);
            }
        }
        let width = (0..3).map(|k| upper[k] - lower[k]).fold(0.0, f64::max);
        let largest = (0..3).map(|k| upper[k].abs().max(lower[k].abs())).fold(0.0, f64::max);
        if !(width > 0.0 && width.is_normal()) {
            return Self {
                centre: lower.map(|c| if c.is_finite() { c } else { 0.0 }),
                half_width: 1.0,
                deepest: 0,
            };
        }
        let quantum = power_of_two_below(width) * 0.5f64.powi(SIZE_BITS);
        // Rounding moves the centre by up to half a quantum; the rest of the margin keeps points off the faces.
        let half_width = 0.5 * ((width / quantum).ceil() + 2.0) * quantum;
        let centre = std::array::from_fn(|k| (0.5 * (lower[k] + upper[k]) / quantum).round() * quantum);
        // A centre at level L is a multiple of quantum / 2^(L + 2), which must not be below its unit in the last place.
        let bits = (power_of_two_below(largest) / quantum).log2();
        Self {
            centre,
            half_width,
            deepest: (48.0 - bits).clamp(0.0, 40.0) as u32,
        }
    }
}

/// The largest power of two that is not above a normal number.
fn power_of_two_below(value: f64) -> f64 {
    f64::from_bits(value.to_bits() & (0x7ff << 52))
}

impl Ordered {
    /// Sorts each of the ranges, which ascend, by octant about its centre, and counts each octant.
    fn sort_by_octant(&mut self, parts: impl Iterator<Item = (Range<usize>, [f64; 3])>) -> Vec<[usize; 8]> {
        let (mut positions, mut original) = (&mut self.positions[..], &mut self.original[..]);
        let mut at = 0;
        let mut slices = Vec::new();
        for (range, centre) in parts {
            let (skip, len) = (range.start - at, range.len());
            let (part, rest) = std::mem::take(&mut positions)[skip..].split_at_mut(len);
            let (indices, other_indices) = std::mem::take(&mut original)[skip..].split_at_mut(len);
            (positions, original, at) = (rest, other_indices, range.end);
            slices.push((part, indices, centre));
        }
        let sort = |(positions, original, centre): (&mut [[f64; 3]], &mut [u32], [f64; 3])| {
            sort_by_octant(positions, original, centre)
        };
        slices.into_par_iter().with_min_len(8).map(sort).collect()
    }
}

fn sort_by_octant(positions: &mut [[f64; 3]], original: &mut [u32], centre: [f64; 3]) -> [usize; 8] {
    let octant = |p: &[f64; 3]| (0..3).fold(0u8, |bits, k| bits | u8::from(p[k] >= centre[k]) << k);
    let octants: Vec<u8> = positions.iter().map(octant).collect();
    let mut counts = [0; 8];
    for &octant in &octants {
        counts[octant as usize] += 1;
    }
    if counts.contains(&positions.len()) {
        return counts;
    }
    let mut next = [0usize; 8];
    for octant in 1..8 {
        next[octant] = next[octant - 1] + counts[octant - 1];
    }
    let (old_positions, old_original) = (positions.to_vec(), original.to_vec());
    for ((octant, position), index) in octants.into_iter().zip(old_positions).zip(old_original) {
        let place = &mut next[octant as usize];
        positions[*place] = position;
        original[*place] = index;
        *place += 1;
    }
    counts
}
