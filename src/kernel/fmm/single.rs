//! Sums at the targets of a leaf in single precision: twice as many at once, for accuracies that do not call for more.
//!
//! All points are relative to the leaf's cell, in units of its half-width, so that near ones lose no digits to where
//! the cell is. What they lose is `1.5·10⁻⁷` of the half-width. That is little of a distance unless source and target
//! are so close that the leaf is summed in double precision.

use faer::{MatMut, MatRef};

use super::evaluate::{WeightedSurface, packed, unit_blocks};
use super::expansions::{Pass, unit_sources};
use crate::kernel::direct::{self, BlockValues, LANES, PackedSource, TargetBlock};

/// Sums of three columns at the targets of a leaf; `None` if they need double precision.
pub(super) fn sum_leaf<'a>(
    pass: &Pass,
    leaf: usize,
    triple: usize,
    surfaces: impl Iterator<Item = WeightedSurface<'a>>,
) -> Option<Vec<[BlockValues; 3]>> {
    let cell = &pass.tree.cells[pass.lists.leaves[leaf].cell as usize];
    let to_unit = pass.tree.to_unit(cell);
    let mut sources: Vec<PackedSource<f32>> = Vec::new();
    for near in pass.lists.near.row(leaf) {
        sources.extend(unit_sources(&pass.weights.triples[triple][near.clone()], &to_unit));
    }
    for surface in surfaces {
        let to_absolute = pass.tree.to_absolute(surface.cell);
        let of_surface = packed(&surface, triple, pass.columns());
        sources.extend(unit_sources(&of_surface, |p| to_unit(to_absolute(p))));
    }
    let blocks = target_blocks(pass, leaf);
    let mut sums = vec![[[0.0; LANES]; 4]; blocks.len()];
    direct::add_potential(pass.instructions, &sources, &blocks, &mut sums);
    let up = 1.0 / pass.tree.half_width(cell);
    let scaled = |[a, b, c, _]: &[BlockValues<f32>; 4]| [a, b, c].map(|lanes| lanes.map(|sum| up * f64::from(sum)));
    direct::are_right(&sums).then(|| sums.iter().map(scaled).collect())
}

/// Adds all columns at the targets of a leaf to `out`, `targets × columns`; `false`, and nothing is added, if they need
/// double precision.
pub(super) fn add_leaf_by_rows<'a>(
    pass: &Pass,
    leaf: usize,
    surfaces: impl Iterator<Item = WeightedSurface<'a>>,
    out: &mut [f64],
) -> bool {
    let columns = pass.columns();
    let cell = &pass.tree.cells[pass.lists.leaves[leaf].cell as usize];
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut weights: Vec<f32> = Vec::new();
    for near in pass.lists.near.row(leaf) {
        positions.extend(pass.unit_positions::<f32>(near.clone(), cell));
        let rows = &pass.weights.rows[near.start * columns..near.end * columns];
        weights.extend(rows.iter().map(|&weight| weight as f32));
    }
    let to_unit = pass.tree.to_unit(cell);
    for surface in surfaces {
        let to_absolute = pass.tree.to_absolute(surface.cell);
        positions.extend(
            surface
                .points
                .iter()
                .map(|&p| to_unit(to_absolute(p)).map(|c| c as f32)),
        );
        let points = surface.points.len();
        let entry = |i: usize, column: usize| surface.weights[column * points + i] as f32;
        weights.extend((0..points).flat_map(|i| (0..columns).map(move |column| entry(i, column))));
    }
    let blocks = target_blocks(pass, leaf);
    let mut sums = vec![0.0; out.len()];
    let mut largest = Some(0.0f32);
    direct::add_products(
        &positions,
        MatRef::from_row_major_slice(&weights, positions.len(), columns),
        1.0,
        MatMut::from_row_major_slice_mut(&mut sums, out.len() / columns, columns),
        |position, column| {
            let written = direct::write_column(pass.instructions, *position, 1.0, &blocks, column);
            largest = largest.zip(written).map(|(a, b)| a.max(b));
        },
    );
    let are_right = largest.is_some_and(|g| g <= direct::LARGEST) && sums.iter().all(|sum| sum.is_finite());
    if are_right {
        let up = 1.0 / pass.tree.half_width(cell);
        for (out, sum) in out.iter_mut().zip(sums) {
            *out += up * f64::from(sum);
        }
    }
    are_right
}

fn target_blocks(pass: &Pass, leaf: usize) -> Vec<TargetBlock<f32>> {
    let leaf = &pass.lists.leaves[leaf];
    let cell = &pass.tree.cells[leaf.cell as usize];
    unit_blocks(&pass.tree.targets.positions[leaf.targets.clone()], cell, pass.tree)
}
