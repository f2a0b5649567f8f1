//! Cutting triangles by a plane, and rows by the outline that results.

use super::{Axis, AxisPlane, SectionError};
use crate::Point;
use crate::mesh::SurfaceMesh;

/// Where the outline crosses a row of samples: row, position along it, change of the winding number.
pub(super) type Crossing = (u32, f64, i32);

/// The bounding box of the vertices that triangles use, all of them finite and far from overflow.
pub(super) fn finite_box(surface: &SurfaceMesh) -> Result<(Point, Point), SectionError> {
    const LARGEST: f64 = 1e70; // Squared areas stay finite.
    let mut bounds: Option<(Point, Point)> = None;
    for &vertex in surface.triangles().iter().flatten() {
        let p = surface.vertices()[vertex as usize];
        if p.iter().any(|c| c.is_nan() || c.abs() > LARGEST) {
            let vertex = vertex as usize;
            return Err(SectionError::NotFinite { vertex });
        }
        let (low, high) = bounds.unwrap_or((p, p));
        bounds = Some((low.inf(&p), high.sup(&p)));
    }
    bounds.ok_or(SectionError::EmptySurface)
}

/// The directed segments in which the plane cuts the triangles. Each crossed edge gives the same point, to the last
/// bit, in both of its triangles, so that the outline of a closed surface is closed.
pub(super) fn outline(
    surface: &SurfaceMesh,
    plane: AxisPlane,
    axes: [Axis; 2],
    on_plane_is_above: bool,
) -> Vec<[[f64; 2]; 2]> {
    let along = plane.axis.index();
    let above = |v: u32| {
        let height = surface.vertices()[v as usize][along];
        height > plane.position || (on_plane_is_above && height == plane.position)
    };
    let crossing = |a: u32, b: u32| {
        let [p, q] = [a.min(b), a.max(b)].map(|v| surface.vertices()[v as usize]);
        let t = (plane.position - p[along]) / (q[along] - p[along]);
        axes.map(|k| p[k.index()] + t * (q[k.index()] - p[k.index()]))
    };
    let mut segments = Vec::new();
    for corners in surface.triangles() {
        let is_above = corners.map(above);
        if is_above == [is_above[0]; 3] {
            continue;
        }
        let mut ends = [[0.0; 2]; 2];
        for (k, next) in [(0, 1), (1, 2), (2, 0)] {
            if is_above[k] != is_above[next] {
                ends[usize::from(is_above[next])] = crossing(corners[k], corners[next]);
            }
        }
        segments.push(ends);
    }
    segments
}

/// Where the segments cross the rows, at the heights `rows` in ascending order. A segment holds its lower end and not
/// its upper one, so that a vertex on a row counts once.
pub(super) fn crossings(outline: &[[[f64; 2]; 2]], rows: &[f64]) -> Vec<Crossing> {
    let mut crossings = Vec::new();
    for &[start, end] in outline {
        let (p, q, turn) = if start[1] <= end[1] {
            (start, end, 1)
        } else {
            (end, start, -1)
        };
        let first = rows.partition_point(|v| *v < p[1]);
        let last = rows.partition_point(|v| *v < q[1]);
        crossings.extend((first..last).map(|row| {
            let t = (rows[row] - p[1]) / (q[1] - p[1]);
            (row as u32, p[0] + t * (q[0] - p[0]), turn)
        }));
    }
    crossings
}

/// The intervals of a row with a winding number that is not zero; `None` when it does not return to zero.
pub(super) fn spans(row: &[Crossing]) -> Option<Vec<[f64; 2]>> {
    let mut spans = Vec::new();
    let (mut winding, mut entered) = (0, 0.0);
    for &(_, u, turn) in row {
        if winding == 0 {
            entered = u;
        }
        winding += turn;
        if winding == 0 && u > entered {
            spans.push([entered, u]);
        }
    }
    (winding == 0).then_some(spans)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_where_the_winding_number_is_not_zero() {
        let row = |turns: &[(f64, i32)]| spans(&turns.iter().map(|&(u, turn)| (0, u, turn)).collect::<Vec<_>>());
        assert_eq!(
            row(&[(1.0, -1), (2.0, 1), (4.0, -1), (5.0, 1)]),
            Some(vec![[1.0, 2.0], [4.0, 5.0]])
        );
        assert_eq!(row(&[(1.0, -1), (2.0, -1), (4.0, 1), (5.0, 1)]), Some(vec![[1.0, 5.0]]));
        assert_eq!(row(&[(1.0, -1), (1.0, 1)]), Some(vec![]));
        assert_eq!(row(&[(1.0, -1), (2.0, 1), (4.0, -1)]), None);
    }

    #[test]
    fn a_vertex_on_a_row_counts_once() {
        let kite = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [-2.0, 1.0]];
        let outline: Vec<_> = (0..4).map(|k| [kite[k], kite[(k + 1) % 4]]).collect();
        let found = crossings(&outline, &[0.0, 1.0, 2.0]);
        let on = |row| found.iter().filter(|c| c.0 == row).count();
        assert_eq!([on(0), on(1), on(2)], [2, 2, 0]);
    }
}
