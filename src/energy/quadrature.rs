use std::collections::HashMap;

use super::clipped_grid::GridResolution;
use crate::mesh::HEXAHEDRON;
use crate::{Point, Vector};

/// Why a solid has no quadrature.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum QuadratureError {
    /// Nothing to integrate over.
    #[error("the mesh has no {element}; give a closed surface, or a mesh of the solid by tetrahedra or hexahedra")]
    Empty {
        /// `"triangle"`, `"tetrahedron"` or `"hexahedron"`.
        element: &'static str,
    },
    /// A vertex in use has a coordinate that is NaN or infinite.
    #[error("vertex {vertex} is at {position}; repair the mesh so that all coordinates are finite")]
    NonFinite {
        /// Which vertex, 0-based.
        vertex: usize,
        /// Its position.
        position: Point,
    },
    /// The grid has no cells, or cells without size.
    #[error("a grid cannot have {0}; ask for at least one cell, of positive finite size")]
    NoCells(GridResolution),
    /// The grid has too many cells.
    #[error(
        "the grid would have {} × {} × {} cells, more than {limit} in all or {axis_limit} along one side; \
         choose larger cells",
        cells[0], cells[1], cells[2]
    )]
    TooManyCells {
        /// Cells along each axis.
        cells: [u64; 3],
        /// Most cells in all.
        limit: u64,
        /// Most cells along an axis.
        axis_limit: u64,
    },
    /// The surface is open: a vertical line enters the solid without leaving it.
    #[error(
        "the surface is open: near x = {x}, y = {y} a line along z enters and leaves it unequally often; \
         close its holes and orient its triangles consistently"
    )]
    Open {
        /// Where the hole is, to the width of a cell.
        x: f64,
        /// Where the hole is, to the width of a cell.
        y: f64,
    },
    /// The tolerance is not positive.
    #[error("the integrals cannot have an error of {0} of themselves; give a positive tolerance, such as 0.01")]
    Tolerance(f64),
    /// The volume is zero, negative or not a number.
    #[error("the mesh encloses a volume of {volume}; it must bound a solid, with its triangles oriented outward")]
    NoVolume {
        /// Signed volume.
        volume: f64,
    },
    /// Parts of the surface are inside out.
    #[error(
        "parts of the surface enclose a negative volume of {negative}, against {volume} in all; orient every component \
         outward (cavities into the cavity) and remove folds"
    )]
    InsideOut {
        /// Sum of the negative cell volumes.
        negative: f64,
        /// Signed volume of the whole.
        volume: f64,
    },
}

/// Points inside a solid and the volume that each represents: `∫ g ≈ Σ weights · g(points)`.
///
/// The points lie in cells, boxes of a [`Grid`], tetrahedra or hexahedra, so that a density at the points also gives
/// means over cells; the points of a cell are consecutive.
#[derive(Debug, Clone, PartialEq)]
pub struct Quadrature {
    points: Vec<Point>,
    weights: Vec<f64>,
    cells: Vec<u32>,
    layout: CellLayout,
}

/// What the cells of a [`Quadrature`] are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CellLayout {
    /// Boxes of a regular grid, clipped by the solid; boxes outside it have no points.
    Grid(Grid),
    /// The tetrahedra of a mesh, numbered as there; flat ones have no points.
    Tets {
        /// How many tetrahedra the mesh has.
        count: usize,
    },
    /// The hexahedra of a mesh, numbered as there; flat ones have no points.
    Hexes {
        /// How many hexahedra the mesh has.
        count: usize,
    },
}

/// A regular grid of cubes. Cell `(i · dims[1] + j) · dims[2] + k` is the `i`-th along x, `j`-th along y and `k`-th
/// along z: z runs fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Lowest corner of the first cell.
    pub origin: Point,
    /// Edge length of a cell.
    pub cell_size: f64,
    /// Cells along x, y and z.
    pub dims: [usize; 3],
}

/// Mean of a density over one cell's part of the solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellMean {
    /// Index of the cell, as in [`CellLayout`].
    pub cell: u32,
    /// Volume of the part of the cell inside the solid.
    pub volume: f64,
    /// Weighted mean of the density at the points of the cell.
    pub mean: f64,
}

impl Quadrature {
    /// A quadrature from parallel arrays of points, weights and cells; `cells` ascends.
    pub(super) fn new(points: Vec<Point>, weights: Vec<f64>, cells: Vec<u32>, layout: CellLayout) -> Self {
        debug_assert!(points.len() == weights.len() && points.len() == cells.len());
        debug_assert!(cells.is_sorted());
        Self {
            points,
            weights,
            cells,
            layout,
        }
    }

    /// Where to evaluate; all inside the solid or on its boundary.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Volume that each point represents; positive.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The cell that each point lies in; ascending.
    pub fn cells(&self) -> &[u32] {
        &self.cells
    }

    /// What the cells are.
    pub fn layout(&self) -> CellLayout {
        self.layout
    }

    /// Volume of the solid: the sum of the weights.
    pub fn volume(&self) -> f64 {
        sum(self.weights.iter().copied())
    }

    /// `Σ weights · density`. Densities beyond the points, or points beyond the densities, are left out.
    pub fn integrate(&self, density: &[f64]) -> f64 {
        sum(self.weights.iter().zip(density).map(|(w, d)| w * d))
    }

    /// Means over the cells of a density at the points; cells without points are left out.
    pub fn cell_means(&self, density: &[f64]) -> Vec<CellMean> {
        let mut means = Vec::new();
        let mut first = 0;
        for run in self.cells.chunk_by(|a, b| a == b) {
            let range = first..first + run.len();
            first = range.end;
            let weights = &self.weights[range.clone()];
            let Some(values) = density.get(range) else { break };
            let volume: f64 = weights.iter().sum();
            let sum: f64 = weights.iter().zip(values).map(|(w, d)| w * d).sum();
            means.push(CellMean {
                cell: run[0],
                volume,
                mean: sum / volume,
            });
        }
        means
    }
}

impl Grid {
    /// Steps `[i, j, k]` of a cell from the first one along x, y and z.
    pub fn steps(&self, cell: u32) -> [usize; 3] {
        self.steps_of(cell.into())
    }

    /// As [`Self::steps`], for grids of more cells than 32 bits can number.
    pub(super) fn steps_of(&self, cell: u64) -> [usize; 3] {
        let [_, y, z] = self.dims.map(|count| count as u64);
        [cell / (y * z), cell / z % y, cell % z].map(|steps| steps as usize)
    }

    /// Number of the cell that is so many steps from the first one.
    pub(super) fn index_of(&self, [i, j, k]: [usize; 3]) -> u64 {
        let [_, y, z] = self.dims.map(|count| count as u64);
        (i as u64 * y + j as u64) * z + k as u64
    }

    /// Cells as hexahedra with their corners, shared between neighbours, in the order of [`HEXAHEDRON`].
    pub fn hexahedra(&self, cells: &[u32]) -> (Vec<Point>, Vec<[u32; 8]>) {
        let mut index = HashMap::new();
        let mut points = Vec::new();
        let hexes = cells.iter().map(|&cell| {
            let steps = self.steps(cell);
            HEXAHEDRON.map(|corner| {
                let key: [usize; 3] = std::array::from_fn(|k| steps[k] + usize::from(corner[k]));
                *index.entry(key).or_insert_with(|| {
                    let along = |k: usize| self.origin[k] + key[k] as f64 * self.cell_size;
                    points.push(Point::new(along(0), along(1), along(2)));
                    (points.len() - 1) as u32
                })
            })
        });
        let hexes = hexes.collect();
        (points, hexes)
    }

    /// Lowest corner of a cell.
    pub fn corner(&self, cell: u32) -> Point {
        let [i, j, k] = self.steps(cell).map(|s| s as f64);
        self.origin + Vector::new(i, j, k) * self.cell_size
    }
}

/// Compensated sum (Neumaier 1974). A plain sum of a million equal weights always rounds the same way, and has an error
/// of `10⁻¹¹`.
pub(super) fn sum(terms: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut lost) = (0.0_f64, 0.0);
    for term in terms {
        let next = sum + term;
        lost += if sum.abs() >= term.abs() {
            (sum - next) + term
        } else {
            (term - next) + sum
        };
        sum = next;
    }
    sum + lost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_cells_share_the_corners_of_their_face() {
        let grid = Grid {
            origin: Point::new(1.0, 2.0, 3.0),
            cell_size: 0.5,
            dims: [2, 3, 4],
        };
        // The first cell, and the next along z.
        let (points, hexes) = grid.hexahedra(&[0, 1]);
        assert_eq!((points.len(), hexes.len()), (12, 2));
        let shared = hexes[0].iter().filter(|v| hexes[1].contains(v)).count();
        assert_eq!(shared, 4);
        let mean = hexes[1].iter().map(|&v| points[v as usize].coords).sum::<Vector>() / 8.0;
        assert_eq!(mean, grid.corner(1).coords + Vector::repeat(0.25));
    }

    #[test]
    fn a_sum_of_many_equal_terms_is_exact_to_rounding() {
        let count = 10_000_000;
        let plain: f64 = std::iter::repeat_n(0.1, count).sum();
        let carried = sum(std::iter::repeat_n(0.1, count));
        assert!((plain / 1e6 - 1.0).abs() > 1e-11);
        assert!((carried / 1e6 - 1.0).abs() < 1e-15);
    }

    #[test]
    fn cells_are_numbered_with_z_fastest() {
        let grid = Grid {
            origin: Point::new(1.0, 2.0, 3.0),
            cell_size: 0.5,
            dims: [4, 3, 2],
        };
        assert_eq!(grid.steps(1), [0, 0, 1]);
        assert_eq!(grid.steps(2), [0, 1, 0]);
        assert_eq!(grid.steps(23), [3, 2, 1]);
        assert_eq!(grid.corner(23), Point::new(2.5, 3.0, 3.5));
    }
}
