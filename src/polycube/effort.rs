//! The work that an attempt at a polycube may take, counted so that it ends at the same place in every run.

use std::cell::Cell;

/// Iterations of descent, each times the number of cells that moved, that are left.
#[derive(Debug)]
pub(super) struct Effort {
    left: Cell<f64>,
}

impl Effort {
    /// So many iterations for each of the cells; as many as for [`CELLS_IN_ANY`] where there are fewer.
    pub fn new(iterations_per_cell: f64, cells: usize) -> Self {
        Self {
            left: Cell::new(iterations_per_cell * cells.max(CELLS_IN_ANY) as f64),
        }
    }

    pub fn spend(&self, iterations: usize, cells: usize) {
        self.left.set(self.left.get() - iterations as f64 * cells as f64);
    }

    pub fn is_spent(&self) -> bool {
        self.left.get() <= 0.0
    }
}

/// Cells whose effort any model gets, however small.
const CELLS_IN_ANY: usize = 20_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effort_is_in_proportion_to_the_cells_and_never_regained() {
        let effort = Effort::new(10.0, 50_000);
        effort.spend(9, 50_000);
        assert!(!effort.is_spent());
        effort.spend(1, 50_000);
        assert!(effort.is_spent());
        let small = Effort::new(1.0, 10);
        small.spend(1999, 10);
        assert!(!small.is_spent());
        let endless = Effort::new(f64::INFINITY, 10);
        endless.spend(usize::MAX, usize::MAX);
        assert!(!endless.is_spent());
        assert!(Effort::new(0.0, 10).is_spent());
    }
}
