//! Which cells meet at each node of a mesh.

use crate::mesh::CellList;

/// The cells at each node, in one list.
pub(crate) struct CellsAtNodes {
    starts: Vec<u32>,
    cells: Vec<u32>,
}

impl CellsAtNodes {
    pub fn new(cells: &CellList, nodes: usize) -> Self {
        let mut starts = vec![0u32; nodes + 1];
        cells.iter().flatten().for_each(|&v| starts[v as usize + 1] += 1);
        (0..nodes).for_each(|v| starts[v + 1] += starts[v]);
        let mut next = starts.clone();
        let mut at = vec![0; starts.last().map_or(0, |end| *end as usize)];
        for (cell, corners) in (0..).zip(cells.iter()) {
            for &v in corners {
                at[next[v as usize] as usize] = cell;
                next[v as usize] += 1;
            }
        }
        Self { starts, cells: at }
    }

    /// The cells at a node, ascending.
    pub fn of(&self, node: u32) -> &[u32] {
        &self.cells[self.starts[node as usize] as usize..self.starts[node as usize + 1] as usize]
    }
}
