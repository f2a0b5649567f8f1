//! Sums at the targets of a leaf with values of the kernel in single precision: twice as many at once, for accuracies that
//! do not call for more.
//!
//! All points are relative to the leaf's cell, in units of its half-width, so that near ones lose no digits to where
//! the cell is. What they lose is `1.5·10⁻⁷` of the half-width. That is little of a distance unless source and target
//! are so close that the leaf is summed in double precision.

use super::evaluate::{WeightedSurface, packed, unit_blocks};
use super::expansions::Pass;
use crate::kernel::direct::{self, BlockValues, LANES, PackedSource, SingleSource};

/// Sums of three columns at the targets of a leaf; `None` if they need double precision.
pub(super) fn sum_leaf<'a>(
    pass: &Pass,
    leaf: usize,
    triple: usize,
    surfaces: impl Iterator<Item = WeightedSurface<'a>>,
) -> Option<Vec<[BlockValues; 3]>> {
    let leaf_cell = &pass.tree.cells[pass.lists.leaves[leaf].cell as usize];
    let to_unit = pass.tree.to_unit(leaf_cell);
    let mut sources: Vec<SingleSource> = Vec::new();
    for near in pass.lists.near.row(leaf) {
        sources.extend(unit_sources(&pass.weights.triples[triple][near.clone()], &to_unit));
    }
    for surface in surfaces {
        let to_absolute = pass.tree.to_absolute(surface.cell);
        let points = packed(&surface, triple, pass.columns());
        sources.extend(unit_sources(&points, |p| to_unit(to_absolute(p))));
    }
    let targets = &pass.tree.targets.positions[pass.lists.leaves[leaf].targets.clone()];
    let blocks = unit_blocks(targets, |p| to_unit(p).map(|c| c as f32));
    let mut sums = vec![[[0.0; LANES]; 3]; blocks.len()];
    if !direct::add_near_potential_in_single(pass.instructions, &sources, &blocks, &mut sums) {
        return None;
    }
    let up = 1.0 / pass.tree.half_width(leaf_cell);
    sums.iter_mut().flatten().flatten().for_each(|sum| *sum *= up);
    Some(sums)
}

/// Sources at points that `to_unit` takes to the units of a cell.
pub(super) fn unit_sources(
    sources: &[PackedSource],
    to_unit: impl Fn([f64; 3]) -> [f64; 3],
) -> impl Iterator<Item = SingleSource> {
    sources.iter().map(move |&[x, y, z, w0, w1, w2]| SingleSource {
        position: to_unit([x, y, z]).map(|c| c as f32),
        weights: [w0, w1, w2],
    })
}
