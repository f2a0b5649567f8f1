//! Points on a lattice, whose cells become six tetrahedra each.

use crate::{
    Point,
    io::{IoError, contents::Contents, source::Source},
};

/// Structured points become tetrahedra, which take up to two kilobytes a point by the time they are searched.
const MAX_STRUCTURED: usize = 1 << 22;

/// Points on a lattice, the first coordinate running fastest.
pub(super) struct Lattice {
    /// How many there are along each axis.
    pub counts: [usize; 3],
    pub origin: Point,
    /// From each to the next along each axis.
    pub spacing: Point,
}

impl Lattice {
    /// Adds the points, and the tetrahedra of the cells.
    pub fn fill(&self, source: &Source, contents: &mut Contents) -> Result<(), IoError> {
        let [nx, ny, nz] = self.counts;
        let total = nx.saturating_mul(ny).saturating_mul(nz);
        if total > MAX_STRUCTURED {
            let found = format!("{total} structured points");
            return Err(source.unsupported(
                found,
                "at most 4194304 are read, since six tetrahedra a cell take up to two kilobytes a point; take every \
                 second point along each axis",
            ));
        }
        let at = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
        let place = |i: usize| {
            Point::from(std::array::from_fn::<f64, 3, _>(|k| {
                self.origin[k] + at(i)[k] as f64 * self.spacing[k]
            }))
        };
        contents.vertices = (0..total).map(place).collect();
        let cells = self.counts.iter().map(|n| n.saturating_sub(1)).product::<usize>();
        contents.tets.reserve_exact(6 * cells);
        contents.cell_of_tet.reserve_exact(6 * cells);
        let is_first = |i: &usize| at(*i)[0] + 1 < nx && at(*i)[1] + 1 < ny && at(*i)[2] + 1 < nz;
        for first in (0..total).filter(is_first) {
            let [x, y, z] = [1, nx, nx * ny];
            // Kuhn's split: every order of the axes from one corner to the opposite one, all of one hand.
            for [a, b, c] in [[x, y, z], [y, z, x], [z, x, y]] {
                let end = first + a + b + c;
                for tet in [
                    [first, first + a, first + a + b, end],
                    [first, first + a + c, first + a, end],
                ] {
                    contents.tets.push(tet.map(|v| v as i64));
                    contents.cell_of_tet.push(contents.cells);
                }
            }
            contents.cells += 1;
        }
        Ok(())
    }
}
