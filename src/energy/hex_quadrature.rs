//! Quadrature over the hexahedra of a mesh.

use super::quadrature::{CellLayout, Quadrature, QuadratureError};
use super::tet_quadrature::{over_tets, require_finite};
use crate::geometry::trilinear_gradients;
use crate::mesh::{CellList, CellMesh, HEXAHEDRON};
use crate::{Matrix3, Point, Vector};

/// Quadrature over the cells of a mesh: over tetrahedra as [`super::tet_quadrature`]; over hexahedra with eight points
/// each, the product of Gauss rules of two points on the cube that the trilinear map takes to the hexahedron.
///
/// The weight of a point is the absolute value of the trilinear map's determinant there. Their sum over a hexahedron that
/// is not inverted is its volume exactly; densities are integrated exactly when they are linear, on parallelepipeds when
/// they are cubic. Points where the determinant is zero are left out. Neither rule asks how neighbours list their common
/// face, so that hexahedra are not cut into tetrahedra.
///
/// # Errors
///
/// [`QuadratureError::Empty`], [`QuadratureError::NonFinite`], and [`QuadratureError::NoVolume`] when all cells are flat.
pub fn cell_quadrature(mesh: &CellMesh) -> Result<Quadrature, QuadratureError> {
    match mesh.cells() {
        CellList::Tets(tets) => over_tets(mesh.nodes(), tets),
        CellList::Hexes(hexes) => over_hexes(mesh.nodes(), hexes),
    }
}

fn over_hexes(nodes: &[Point], hexes: &[[u32; 8]]) -> Result<Quadrature, QuadratureError> {
    let count = hexes.len();
    if count == 0 {
        return Err(QuadratureError::Empty { element: "hexahedron" });
    }
    require_finite(nodes, hexes)?;
    let rule = HEXAHEDRON.map(rule_point);
    let (mut points, mut weights, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    for (cell, hex) in hexes.iter().enumerate() {
        let corners = hex.map(|v| nodes[v as usize].coords);
        for shape in &rule {
            let jacobian: Matrix3 = corners
                .iter()
                .zip(shape)
                .map(|(x, (_, slope))| x * slope.transpose())
                .sum();
            let weight = jacobian.determinant().abs() / 8.0;
            if weight > 0.0 {
                let place: Vector = corners.iter().zip(shape).map(|(x, (value, _))| x * *value).sum();
                points.push(Point::from(place));
                weights.push(weight);
                cells.push(cell as u32);
            }
        }
    }
    let volume: f64 = weights.iter().sum();
    if !(volume > 0.0 && volume.is_finite()) {
        return Err(QuadratureError::NoVolume { volume });
    }
    Ok(Quadrature::new(points, weights, cells, CellLayout::Hexes { count }))
}

/// Values and gradients of the eight trilinear shape functions on the unit cube, at the Gauss point nearest to a corner.
fn rule_point(near: [u8; 3]) -> [(f64, Vector); 8] {
    let offset = 0.5 / 3f64.sqrt();
    let at = near.map(|upper| if upper == 1 { 0.5 + offset } else { 0.5 - offset });
    let slopes = trilinear_gradients(at);
    std::array::from_fn(|c| {
        let along = |k: usize| if HEXAHEDRON[c][k] == 1 { at[k] } else { 1.0 - at[k] };
        (along(0) * along(1) * along(2), slopes[c])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TetMesh;

    /// The unit cube, deformed.
    fn hex(image: impl Fn(Point) -> Point) -> CellMesh {
        let nodes = HEXAHEDRON
            .map(|corner| image(Point::from(corner.map(f64::from))))
            .to_vec();
        CellMesh::new(nodes, CellList::Hexes(vec![[0, 1, 2, 3, 4, 5, 6, 7]]), vec![0]).unwrap()
    }

    #[test]
    fn cubics_are_exact_on_a_parallelepiped_and_quartics_not() {
        let rule = cell_quadrature(&hex(|p| Point::new(2.0 * p.x + p.y, 3.0 * p.y, p.z + p.x))).unwrap();
        let integral = |g: fn(&Point) -> f64| rule.integrate(&rule.points().iter().map(g).collect::<Vec<_>>());
        assert!((rule.volume() - 6.0).abs() < 1e-14);
        assert_eq!(rule.layout(), CellLayout::Hexes { count: 1 });
        // ∫ (2 x + y)³ over the unit cube is 8/4 + 12/6 + 6/6 + 1/4.
        assert!((integral(|p| p.x.powi(3)) - 6.0 * 5.25).abs() < 1e-12);
        assert!((integral(|p| p.y * p.y * p.z) - 6.0 * 3.0).abs() < 1e-12);
        assert!((integral(|p| p.y.powi(4)) - 6.0 * 81.0 / 5.0).abs() > 1.0);
    }

    #[test]
    fn the_volume_and_the_centre_of_a_trilinear_hexahedron_are_exact() {
        let mesh = hex(|p| {
            Point::new(
                p.x + 0.3 * p.y * p.z,
                p.y - 0.2 * p.x * p.z,
                p.z + 0.25 * p.x * p.y * p.z,
            )
        });
        let rule = cell_quadrature(&mesh).unwrap();
        assert!((rule.volume() - mesh.signed_volume(0)).abs() < 1e-15);
        assert_eq!(rule.cells(), [0; 8]);
        // Against fine cells of the same trilinear map, whose own rule is exact for the volume.
        let fine = 8;
        let place = |p: [f64; 3]| {
            let corner = |c: [u8; 3]| {
                (0..3)
                    .map(|k| if c[k] == 1 { p[k] } else { 1.0 - p[k] })
                    .product::<f64>()
            };
            let sum: Vector = HEXAHEDRON
                .iter()
                .zip(mesh.nodes())
                .map(|(c, x)| x.coords * corner(*c))
                .sum();
            Point::from(sum)
        };
        let mut centre = Vector::zeros();
        for n in 0..fine * fine * fine {
            let low = [n % fine, n / fine % fine, n / (fine * fine)];
            let cell = hex(|p| place(std::array::from_fn(|k| (low[k] as f64 + p[k]) / fine as f64)));
            let rule = cell_quadrature(&cell).unwrap();
            centre += rule
                .points()
                .iter()
                .zip(rule.weights())
                .map(|(p, w)| p.coords * *w)
                .sum::<Vector>();
        }
        let own: Vector = rule
            .points()
            .iter()
            .zip(rule.weights())
            .map(|(p, w)| p.coords * *w)
            .sum();
        assert!((own - centre).norm() < 1e-14, "{own} {centre}");
    }

    #[test]
    fn inverted_hexahedra_count_positively_and_flat_ones_not_at_all() {
        let inverted = cell_quadrature(&hex(|p| Point::new(-p.x, p.y, p.z))).unwrap();
        assert!((inverted.volume() - 1.0).abs() < 1e-15);
        let flat = cell_quadrature(&hex(|p| Point::new(p.x, p.y, 0.0)));
        assert_eq!(flat, Err(QuadratureError::NoVolume { volume: 0.0 }));
        let broken = cell_quadrature(&hex(|p| Point::new(p.x, p.y / (1.0 - p.x), p.z)));
        assert!(matches!(broken, Err(QuadratureError::NonFinite { .. })));
        let empty = CellMesh::new(vec![], CellList::Hexes(vec![]), vec![]).unwrap();
        assert_eq!(
            cell_quadrature(&empty),
            Err(QuadratureError::Empty { element: "hexahedron" })
        );
    }

    #[test]
    fn tetrahedra_get_the_rule_for_tetrahedra() {
        let vertices = hex(|p| p).nodes().to_vec();
        let mesh = TetMesh::new(vertices, vec![[0, 1, 3, 4]]).unwrap();
        assert_eq!(
            cell_quadrature(&mesh.clone().into()),
            super::super::tet_quadrature(&mesh)
        );
    }
}
