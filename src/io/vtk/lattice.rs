//! Points on a lattice, whose cells become six tetrahedra each.

use crate::{
    Point, Vector,
    io::{IoError, contents::Contents, source::Source},
    mesh::KUHN,
};

/// Structured points become tetrahedra, which take up to two kilobytes a point by the time they are searched.
const MAX_STRUCTURED: usize = 1 << 22;

/// Points on a lattice, the first coordinate running fastest.
pub(super) struct Lattice {
    /// How many there are along each axis.
    pub counts: [usize; 3],
    /// The indices of the first one.
    pub first: [i64; 3],
    /// The point whose indices are 0.
    pub origin: Point,
    /// From each to the next along each axis.
    pub steps: [Vector; 3],
}

impl Lattice {
    /// How many points there are, and how many cells as VTK counts them: a lattice that is flat has flat ones.
    pub fn sizes(&self) -> [usize; 2] {
        let product = |counts: [usize; 3]| counts.into_iter().fold(1, usize::saturating_mul);
        let points = product(self.counts);
        let cells = product(self.counts.map(|n| n.saturating_sub(1).max(1)));
        [points, if points > 0 { cells } else { 0 }]
    }

    /// Refuses more points than become tetrahedra.
    pub fn require_few(&self, source: &Source) -> Result<(), IoError> {
        let [points, _] = self.sizes();
        if points <= MAX_STRUCTURED {
            return Ok(());
        }
        Err(source.unsupported(
            format!("{points} structured points"),
            "at most 4194304 are read, since six tetrahedra a cell take up to two kilobytes a point; take every \
             second point along each axis",
        ))
    }

    /// Adds the points, and the tetrahedra of the cells that are not flat.
    pub fn fill(&self, contents: &mut Contents) {
        let [nx, ny, nz] = self.counts;
        let [total, cells] = self.sizes();
        let at = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
        let place = |i: usize| {
            let steps = self.steps.iter().zip(self.first).zip(at(i));
            let steps = steps.map(|((step, first), k)| step * (first + k as i64) as f64);
            self.origin + steps.sum::<Vector>()
        };
        contents.vertices = (0..total).map(place).collect();
        contents.cells = cells;
        if self.counts.iter().any(|&n| n < 2) {
            return;
        }
        contents.tets.reserve_exact(6 * cells);
        contents.cell_of_tet.reserve_exact(6 * cells);
        let is_first = |i: &usize| at(*i)[0] + 1 < nx && at(*i)[1] + 1 < ny && at(*i)[2] + 1 < nz;
        for (cell, first) in (0..total).filter(is_first).enumerate() {
            let corner = |m: usize| (first + (m & 1) + (m >> 1 & 1) * nx + (m >> 2) * nx * ny) as i64;
            for tet in KUHN {
                contents.tets.push(tet.map(corner));
                contents.cell_of_tet.push(cell);
            }
        }
    }
}
