//! Points on a lattice, whose cells are split into six tetrahedra each.

use crate::{
    Point, Vector,
    io::{IoError, input::InputFile, raw_mesh::RawMesh},
    mesh::KUHN,
};

/// Limit of structured points: the tetrahedra with their search tree take up to two kilobytes per point.
const MAX_STRUCTURED: usize = 1 << 22;

/// Points on a lattice, the first coordinate running fastest.
pub(super) struct Lattice {
    /// Number of points along each axis.
    pub counts: [usize; 3],
    /// Indices of the first point.
    pub first: [i64; 3],
    /// The point with indices 0.
    pub origin: Point,
    /// From one point to the next along each axis.
    pub steps: [Vector; 3],
}

impl Lattice {
    /// Numbers of points and of cells. As in VTK, a flat lattice has flat cells.
    pub fn sizes(&self) -> [usize; 2] {
        let product = |counts: [usize; 3]| counts.into_iter().fold(1, usize::saturating_mul);
        let points = product(self.counts);
        let cells = product(self.counts.map(|n| n.saturating_sub(1).max(1)));
        [points, if points > 0 { cells } else { 0 }]
    }

    /// Refuses more than [`MAX_STRUCTURED`] points.
    pub fn check_size(&self, file: &InputFile) -> Result<(), IoError> {
        let [points, _] = self.sizes();
        if points <= MAX_STRUCTURED {
            return Ok(());
        }
        Err(file.unsupported(
            format!("{points} structured points"),
            "at most 4194304 are read, since six tetrahedra per cell take up to two kilobytes per point; keep every \
             second point along each axis",
        ))
    }

    /// Adds the points, and the tetrahedra unless the lattice is flat.
    pub fn fill(&self, raw: &mut RawMesh) {
        let [nx, ny, nz] = self.counts;
        let [total, cells] = self.sizes();
        let at = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
        let place = |i: usize| {
            let steps = self.steps.iter().zip(self.first).zip(at(i));
            let steps = steps.map(|((step, first), k)| step * (first + k as i64) as f64);
            self.origin + steps.sum::<Vector>()
        };
        raw.vertices = (0..total).map(place).collect();
        raw.cells = cells;
        if self.counts.iter().any(|&n| n < 2) {
            return;
        }
        raw.tets.reserve_exact(6 * cells);
        raw.cell_of_volume.reserve_exact(6 * cells);
        let is_first = |i: &usize| at(*i)[0] + 1 < nx && at(*i)[1] + 1 < ny && at(*i)[2] + 1 < nz;
        for (cell, first) in (0..total).filter(is_first).enumerate() {
            let corner = |m: usize| (first + (m & 1) + (m >> 1 & 1) * nx + (m >> 2) * nx * ny) as i64;
            for tet in KUHN {
                raw.tets.push(tet.map(corner));
                raw.cell_of_volume.push(cell);
            }
        }
    }
}
