//! Invalid cells and cell quality, from node positions alone.

use std::cmp::Ordering;

use rayon::prelude::*;

use crate::geometry::{hex_scaled_jacobian, is_hex_positive, orientation, tet_scaled_jacobian};
pub(super) use crate::geometry::{lesser, trilinear_gradients};
pub(super) use crate::mesh::HEX_CORNERS;
use crate::mesh::{CellList, TET_FACES};
use crate::statistics::quantiles;
use crate::{Point, Vector};

/// Cells that are inverted or degenerate.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct InvalidCells {
    /// Tetrahedra, or corners of hexahedra, whose orientation was decided exactly.
    pub checked: usize,
    /// Cells with a tetrahedron at a corner that is inverted, flat or not finite.
    pub inverted: usize,
    /// Hexahedra with positive corners whose Jacobian determinant is not positive everywhere inside, or not proved to be:
    /// bounds decide it down to rounding (Johnen, Remacle & Geuzaine 2013).
    pub inverted_inside: usize,
    /// Indices of the cells, ascending.
    #[serde(skip)]
    pub cells: Vec<u32>,
}

/// Quality of cells.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CellQuality {
    /// Least scaled Jacobian over the cells: 1 for regular tetrahedra and cubes.
    pub min_scaled_jacobian: f64,
    /// 1st percentile of the scaled Jacobian over the cells.
    pub p01_scaled_jacobian: f64,
    /// Mean scaled Jacobian over the cells.
    pub mean_scaled_jacobian: f64,
    /// Least dihedral angle, degrees.
    pub min_dihedral: f64,
    /// Largest dihedral angle, degrees.
    pub max_dihedral: f64,
}

/// The axis of a hexahedron's box along which each neighbour in [`HEX_CORNERS`] lies.
pub(super) const HEX_AXES: [[usize; 3]; 8] = [
    [0, 1, 2],
    [1, 0, 2],
    [0, 1, 2],
    [1, 0, 2],
    [1, 0, 2],
    [0, 1, 2],
    [1, 0, 2],
    [0, 1, 2],
];

/// Position of a node; NaN for a missing one.
pub(super) fn at(x: &[Point], v: u32) -> Point {
    x.get(v as usize)
        .copied()
        .unwrap_or(Point::from(Vector::repeat(f64::NAN)))
}

/// Whether a determinant is positive; not for NaN.
pub(super) fn is_positive(det: f64) -> bool {
    det > 0.0
}

/// Whether a tetrahedron is right-handed, decided exactly; not with a missing node.
pub(crate) fn is_right_handed(x: &[Point], t: [u32; 4]) -> bool {
    let [a, b, c, d] = t.map(|v| at(x, v));
    orientation(&a, &b, &c, &d) == Some(Ordering::Greater)
}

/// Counts the cells that are not right-handed, exactly for the given positions.
pub fn invalid_cells(cells: &CellList, x: &[Point]) -> InvalidCells {
    // 0 for good, 1 for inverted at a corner, 2 for inverted inside.
    let states: Vec<u8> = match cells {
        CellList::Tets(tets) => tets.par_iter().map(|t| u8::from(!is_right_handed(x, *t))).collect(),
        CellList::Hexes(hexes) => hexes
            .par_iter()
            .map(|h| {
                if !HEX_CORNERS.iter().all(|c| is_right_handed(x, c.map(|k| h[k]))) {
                    1
                } else if is_hex_positive(&h.map(|v| at(x, v))) {
                    0
                } else {
                    2
                }
            })
            .collect(),
    };
    let per_cell = if matches!(cells, CellList::Tets(_)) { 1 } else { 8 };
    InvalidCells {
        checked: per_cell * cells.len(),
        inverted: states.iter().filter(|v| **v == 1).count(),
        inverted_inside: states.iter().filter(|v| **v == 2).count(),
        cells: (0..cells.len() as u32).filter(|&c| states[c as usize] > 0).collect(),
    }
}

/// Hexahedra whose determinant is not proved to be positive everywhere, ascending; none for tetrahedra.
pub(super) fn inverted_inside(cells: &CellList, x: &[Point]) -> Vec<u32> {
    match cells {
        CellList::Tets(_) => vec![],
        CellList::Hexes(hexes) => (0..hexes.len() as u32)
            .into_par_iter()
            .filter(|&h| !is_hex_positive(&hexes[h as usize].map(|v| at(x, v))))
            .collect(),
    }
}

/// Scaled Jacobian of every cell: for a tetrahedron √2 times its determinant over the largest product of the lengths of
/// the three edges at a corner, for a hexahedron the least determinant of the three unit edges at a corner (Knupp 2000;
/// Stimpson et al., *The Verdict geometric quality library*, 2007).
pub fn scaled_jacobians(cells: &CellList, x: &[Point]) -> Vec<f64> {
    match cells {
        CellList::Tets(tets) => tet_scaled_jacobians(tets, x),
        CellList::Hexes(hexes) => {
            let of_hex = |h: &[u32; 8]| hex_scaled_jacobian(&h.map(|v| at(x, v)));
            hexes.par_iter().map(of_hex).collect()
        }
    }
}

/// [`scaled_jacobians`] of tetrahedra.
pub(crate) fn tet_scaled_jacobians(tets: &[[u32; 4]], x: &[Point]) -> Vec<f64> {
    let of_tet = |t: &[u32; 4]| tet_scaled_jacobian(&t.map(|v| at(x, v)));
    tets.par_iter().map(of_tet).collect()
}

/// Six times the volume.
fn determinant(x: &[Point], t: [u32; 4]) -> f64 {
    let p = t.map(|v| at(x, v));
    (p[1] - p[0]).dot(&(p[2] - p[0]).cross(&(p[3] - p[0])))
}

/// Determinants of less than this, over their mean, are rounding errors of flat cells.
const FLAT: f64 = 1e-9;

/// Determinants of the map of the cells that takes nodes from `from` to `to`: one per tetrahedron; of a hexahedron,
/// eight, each comparing the tetrahedra at a corner. They are divided by the ratio of the sums of both, so that 1 is a
/// cell whose volume changes as the total does. NaN for what is flat or inverted in `from`: no map is meant there.
pub fn determinants(cells: &CellList, from: &[Point], to: &[Point]) -> Vec<f64> {
    let corners = |x: &[Point]| -> Vec<f64> {
        match cells {
            CellList::Tets(tets) => tets.par_iter().map(|t| determinant(x, *t)).collect(),
            CellList::Hexes(hexes) => hexes
                .par_iter()
                .flat_map_iter(|h| HEX_CORNERS.map(|c| determinant(x, c.map(|k| h[k]))))
                .collect(),
        }
    };
    let (images, shapes) = (corners(to), corners(from));
    let sum = |volumes: &[f64]| volumes.iter().sum::<f64>().abs();
    let change = sum(&images) / sum(&shapes);
    let flat = FLAT * sum(&shapes) / shapes.len() as f64;
    let ratio = |(&image, &shape): (&f64, &f64)| {
        if shape > flat { image / shape / change } else { f64::NAN }
    };
    images.iter().zip(&shapes).map(ratio).collect()
}

/// The quality of all cells; `None` without cells. Cells with edges of zero length, whose quality is not defined, count
/// with a scaled Jacobian of −1 and have no dihedral angles.
pub fn quality(cells: &CellList, x: &[Point]) -> Option<CellQuality> {
    let known = |s: f64| if s.is_finite() { s } else { -1.0 };
    let scaled: Vec<f64> = scaled_jacobians(cells, x).into_iter().map(known).collect();
    let [min, p01] = quantiles(&scaled, [0.0, 0.01])?;
    let angles = |flat: Vec<[f64; 2]>| {
        flat.into_iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], [a, b]| {
                [l.min(a), h.max(b)]
            })
    };
    let [min_dihedral, max_dihedral] = match cells {
        CellList::Tets(tets) => {
            let of_tet = |t: &[u32; 4]| {
                let p = t.map(|v| at(x, v));
                let normals = TET_FACES.map(|[a, b, c]| (p[b] - p[a]).cross(&(p[c] - p[a])));
                // The interior angle between two faces with outward normals.
                let angle = |[i, j]: [usize; 2]| 180.0 - normals[i].angle(&normals[j]).to_degrees();
                range((0..4).flat_map(|i| (0..i).map(move |j| [i, j])).map(angle))
            };
            angles(tets.par_iter().map(of_tet).collect())
        }
        CellList::Hexes(hexes) => {
            let of_hex = |h: &[u32; 8]| {
                let p = h.map(|v| at(x, v));
                // At each end of each edge, from the normals of the two faces there.
                let at_corner = |c: &[usize; 4]| {
                    let e = [1, 2, 3].map(|k| p[c[k]] - p[c[0]]);
                    [0, 1, 2].map(|k| {
                        let (a, b, along) = (e[(k + 1) % 3], e[(k + 2) % 3], e[k]);
                        let (a, b) = (along.cross(&a), along.cross(&b));
                        a.angle(&b).to_degrees()
                    })
                };
                range(HEX_CORNERS.iter().flat_map(at_corner))
            };
            angles(hexes.par_iter().map(of_hex).collect())
        }
    };
    Some(CellQuality {
        min_scaled_jacobian: min,
        p01_scaled_jacobian: p01,
        mean_scaled_jacobian: scaled.iter().sum::<f64>() / scaled.len() as f64,
        min_dihedral,
        max_dihedral,
    })
}

fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexahedra_of_different_sizes_are_compared_with_themselves() {
        // Layers of height 1, 2 and 4 that the map scales by 3 as a whole.
        let heights = [0.0, 1.0, 3.0, 7.0];
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let nodes: Vec<Point> = heights
            .iter()
            .flat_map(|&z| square.map(|[x, y]| Point::new(x, y, z)))
            .collect();
        let layer = |k: u32| std::array::from_fn(|n| 4 * k + n as u32);
        let cells = CellList::Hexes((0..3).map(layer).collect());
        let images: Vec<Point> = nodes.iter().map(|p| p * 3.0).collect();
        assert!(
            determinants(&cells, &nodes, &images)
                .iter()
                .all(|det| (det - 1.0).abs() < 1e-14)
        );
        // The lowest layer takes half of the next one's height.
        let mut moved = nodes.clone();
        moved[4..8].iter_mut().for_each(|p| p.z = 2.0);
        let found = determinants(&cells, &nodes, &moved);
        let expected = [2.0, 0.5, 1.0];
        assert!((0..24).all(|k| (found[k] - expected[k / 8]).abs() < 1e-14), "{found:?}");
        // Where there was no volume, its change is not defined.
        let mut flat = nodes.clone();
        flat[4..8].iter_mut().for_each(|p| p.z = 1e-15);
        let found = determinants(&cells, &flat, &images);
        assert!(
            found[..8].iter().all(|det| det.is_nan()) && found[8..].iter().all(|det| *det > 0.0),
            "{found:?}"
        );
    }
}
