//! Where a map is folded, or its energy is largest, at the points of a quadrature.

use super::quadrature::{CellLayout, Grid, Quadrature};
use super::{Densities, DensityQuantiles};
use crate::mesh::{CellMesh, faces};
use crate::worst_places::{BadPart, PlaceKind, WorstPlace, listed, places, sharing};
use crate::{Point, Vector};

/// The connected groups of cells with points where the map is folded, the largest first; then those where the harmonic
/// energy density exceeds what it does not on 99 percent of the volume, and its median by a hundredth, the steepest first.
/// At most `most` in all.
///
/// `densities` are those at the points of the quadrature, and `target_volume` is negative for a map that reflects. Of a
/// cell, the volume of its bad points alone counts. Cells touch where they share a face; those of a mesh, which
/// must be `mesh`, are all by themselves without it, or with one of another number of cells. Takes a small fraction of
/// the time of the densities.
pub fn worst_places(
    quadrature: &Quadrature,
    densities: &Densities,
    target_volume: f64,
    mesh: Option<&CellMesh>,
    most: usize,
) -> Vec<WorstPlace> {
    let orientation = if target_volume < 0.0 { -1.0 } else { 1.0 };
    let oriented: Vec<f64> = densities.det_jacobian.iter().map(|det| det * orientation).collect();
    let folded = found(quadrature, PlaceKind::Folded, &oriented, |det| det <= 0.0, mesh);
    let steepest = DensityQuantiles::weighted(&densities.harmonic, quadrature.weights());
    // Where the density hardly varies, no place is worse than others.
    let large = steepest.map_or(f64::INFINITY, |density| density.p99.max(1.01 * density.median));
    let steep = found(
        quadrature,
        PlaceKind::EnergyDensity,
        &densities.harmonic,
        |density| density > large,
        mesh,
    );
    listed([folded, steep], most)
}

/// The groups of cells with points whose values are bad.
fn found(
    quadrature: &Quadrature,
    kind: PlaceKind,
    values: &[f64],
    is_bad: impl Fn(f64) -> bool,
    mesh: Option<&CellMesh>,
) -> Vec<WorstPlace> {
    let (mut cells, mut parts) = (Vec::new(), Vec::new());
    let mut first = 0;
    for run in quadrature.cells().chunk_by(|a, b| a == b) {
        let range = first..first + run.len();
        first = range.end;
        let bad = range.filter(|&k| values.get(k).is_some_and(|&value| is_bad(value)));
        if let Some(part) = bad_part(quadrature, kind, values, bad) {
            cells.push(run[0]);
            parts.push(part);
        }
    }
    let touching = match (quadrature.layout(), mesh) {
        (CellLayout::Grid(grid), _) => {
            sharing(numbered(&cells).flat_map(|(cell, part)| faces_of_box(&grid, cell).map(move |face| (face, part))))
        }
        (CellLayout::Tets { count } | CellLayout::Hexes { count }, Some(mesh)) if mesh.cells().len() == count => {
            let bad = mesh.cells().select(&cells);
            sharing(faces(&bad).into_iter().map(|face| (face.nodes, face.cell)))
        }
        (CellLayout::Tets { .. } | CellLayout::Hexes { .. }, _) => vec![],
    };
    places(kind, &parts, touching, quadrature.volume())
}

fn numbered(cells: &[u32]) -> impl Iterator<Item = (u32, u32)> {
    cells.iter().copied().zip(0..)
}

/// The bad points of a cell as one part, the worst of them as its point; `None` without any.
fn bad_part(
    quadrature: &Quadrature,
    kind: PlaceKind,
    values: &[f64],
    bad: impl Iterator<Item = usize>,
) -> Option<BadPart> {
    let mut part: Option<BadPart> = None;
    for k in bad {
        let (point, weight) = (quadrature.points()[k], quadrature.weights()[k]);
        // A point stands for a cube of its volume.
        let half = Vector::repeat(0.5 * weight.cbrt());
        let (low, high): (Point, Point) = (point - half, point + half);
        let part = part.get_or_insert(BadPart {
            point,
            low,
            high,
            measure: 0.0,
            value: values[k],
        });
        part.measure += weight;
        (part.low, part.high) = (part.low.inf(&low), part.high.sup(&high));
        let is_worse = match kind {
            PlaceKind::Folded => values[k] < part.value,
            _ => values[k] > part.value,
        };
        if is_worse {
            (part.point, part.value) = (point, values[k]);
        }
    }
    part
}

/// The faces of a box, each by its axis and the box above it.
fn faces_of_box(grid: &Grid, cell: u32) -> [(u8, [usize; 3]); 6] {
    let steps = grid.steps(cell);
    std::array::from_fn(|face| {
        let mut above = steps;
        above[face / 2] += face % 2;
        ((face / 2) as u8, above)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::{EnergyOptions, GridResolution, clipped_grid, densities, tet_quadrature};
    use crate::map::VolumeMap;
    use crate::mesh::{TetMesh, shapes};
    use crate::{Matrix3, Point};

    /// `(x³ / 3 − x / 16, y, z)`: folded where `|x| < 1/4`.
    struct FoldedInTheMiddle;

    impl VolumeMap for FoldedInTheMiddle {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            points
                .iter()
                .map(|p| Point::new(p.x.powi(3) / 3.0 - p.x / 16.0, p.y, p.z))
                .collect()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            let det = |p: &Point| p.x * p.x - 1.0 / 16.0;
            points
                .iter()
                .map(|p| Matrix3::from_diagonal(&Vector::new(det(p), 1.0, 1.0)))
                .collect()
        }
    }

    const RAW: EnergyOptions = EnergyOptions {
        normalize: false,
        lame: crate::energy::Lame {
            lambda: 0.0335,
            mu: 0.0224,
        },
    };

    #[test]
    fn a_fold_is_one_place_with_its_box_and_volume() {
        let cube = shapes::cube(1.0, 2);
        let grid = clipped_grid(&cube, GridResolution::CellsAlongLongestSide(16)).unwrap();
        let found = densities(&FoldedInTheMiddle, grid.points(), 1.0, 1.0, &RAW).unwrap();
        let list = worst_places(&grid, &found, 1.0, None, 1);
        let place = list[0];
        assert_eq!(
            (list.len(), place.kind, place.count),
            (1, PlaceKind::Folded, 8 * 16 * 16)
        );
        assert!((place.share - 0.5).abs() < 1e-12 && (place.measure - 0.5).abs() < 1e-12);
        for (low, high, half) in [(place.low[0], place.high[0], 0.25), (place.low[1], place.high[1], 0.5)] {
            assert!((low + half).abs() < 1e-9 && (high - half).abs() < 1e-9, "{place:?}");
        }
        assert!(place.centre.iter().all(|x| x.abs() < 1e-9) && place.point[0].abs() < 1.0 / 16.0);
        assert!(place.value.unwrap() < -0.06);
        // Reflected as a whole, the rest is folded: two places.
        let outside = worst_places(&grid, &found, -1.0, None, 9);
        let folded = outside.iter().filter(|place| place.kind == PlaceKind::Folded);
        assert_eq!(folded.map(|place| place.count).collect::<Vec<_>>(), [4 * 16 * 16; 2]);
    }

    /// The cube of side 1 about the origin, each of `n³` boxes in the six tetrahedra along its diagonal.
    fn tet_grid(n: u32) -> TetMesh {
        let node = |i: u32, j: u32, k: u32| (i * (n + 1) + j) * (n + 1) + k;
        let along = |i: u32| f64::from(i) / f64::from(n) - 0.5;
        let nodes = (0..(n + 1).pow(3)).map(|v| {
            let (i, j, k) = (v / (n + 1).pow(2), v / (n + 1) % (n + 1), v % (n + 1));
            Point::new(along(i), along(j), along(k))
        });
        let mut tets = vec![];
        for (i, j, k) in (0..n.pow(3)).map(|b| (b / (n * n), b / n % n, b % n)) {
            for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                let mut at = [i, j, k];
                let mut tet = [node(i, j, k); 4];
                for (corner, axis) in order.into_iter().enumerate() {
                    at[axis] += 1;
                    tet[corner + 1] = node(at[0], at[1], at[2]);
                }
                tets.push(tet);
            }
        }
        TetMesh::new(nodes.collect(), tets).unwrap()
    }

    #[test]
    fn tets_are_grouped_across_faces() {
        let mesh = tet_grid(4);
        let rule = tet_quadrature(&mesh).unwrap();
        let found = densities(&FoldedInTheMiddle, rule.points(), 1.0, 1.0, &RAW).unwrap();
        let folded = |tets| {
            let list = worst_places(&rule, &found, 1.0, tets, usize::MAX);
            list.iter().filter(|place| place.kind == PlaceKind::Folded).count()
        };
        let cells = CellMesh::from(mesh);
        assert_eq!(folded(Some(&cells)), 1);
        assert!(folded(None) > 10);
        // Another mesh says nothing about these cells.
        assert_eq!(folded(Some(&CellMesh::from(tet_grid(1)))), folded(None));
    }

    #[test]
    fn a_map_of_one_density_has_no_worst_place() {
        struct Identity;
        impl VolumeMap for Identity {
            fn evaluate(&self, points: &[Point]) -> Vec<Point> {
                points.to_vec()
            }
            fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
                vec![Matrix3::identity(); points.len()]
            }
        }
        let ball = shapes::sphere(1.0, 2);
        let grid = clipped_grid(&ball, GridResolution::CellsAlongLongestSide(8)).unwrap();
        let found = densities(&Identity, grid.points(), 1.0, 1.0, &RAW).unwrap();
        assert_eq!(worst_places(&grid, &found, 1.0, None, 5), []);
    }
}
