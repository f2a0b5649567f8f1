use super::quadrature::{CellLayout, Quadrature, QuadratureError};
use crate::{Point, Vector, mesh::TetMesh};

/// Quadrature over the tetrahedra of a mesh: four points each, exact for polynomials of degree 2.
///
/// Every tetrahedron counts with its absolute volume. Flat tetrahedra have no points.
///
/// # Errors
///
/// [`QuadratureError::Empty`], [`QuadratureError::NonFinite`], and [`QuadratureError::NoVolume`] when all tetrahedra
/// are flat.
///
/// # References
///
/// Hammer, Marlowe & Stroud, *Numerical integration over simplexes and cones*, Math. Tables Aids Comput. 10 (1956).
pub fn tet_quadrature(mesh: &TetMesh) -> Result<Quadrature, QuadratureError> {
    over_tets(mesh.vertices(), mesh.tets())
}

/// [`tet_quadrature`] over tetrahedra that name these vertices.
pub(super) fn over_tets(vertices: &[Point], tets: &[[u32; 4]]) -> Result<Quadrature, QuadratureError> {
    let count = tets.len();
    if count == 0 {
        return Err(QuadratureError::Empty { element: "tetrahedron" });
    }
    require_finite(vertices, tets)?;
    let (mut points, mut weights, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    for (tet, corners) in tets.iter().enumerate() {
        let [a, b, c, d] = corners.map(|v| vertices[v as usize]);
        let volume = ((b - a).dot(&(c - a).cross(&(d - a))) / 6.0).abs();
        if volume > 0.0 {
            points.extend(rule_points([a, b, c, d]));
            weights.extend([volume / 4.0; 4]);
            cells.extend([tet as u32; 4]);
        }
    }
    let volume: f64 = weights.iter().sum();
    if !(volume > 0.0 && volume.is_finite()) {
        return Err(QuadratureError::NoVolume { volume });
    }
    Ok(Quadrature::new(points, weights, cells, CellLayout::Tets { count }))
}

/// Refuses elements with a vertex that is NaN or infinite.
pub(super) fn require_finite<const N: usize>(vertices: &[Point], elements: &[[u32; N]]) -> Result<(), QuadratureError> {
    for vertex in elements.iter().flatten().map(|&v| v as usize) {
        let position = vertices[vertex];
        if position.iter().any(|c| !c.is_finite()) {
            return Err(QuadratureError::NonFinite { vertex, position });
        }
    }
    Ok(())
}

/// Each point is nearest to one corner: barycentric weights `(5 + 3√5) / 20` and three times `(5 − √5) / 20`.
fn rule_points(corners: [Point; 4]) -> [Point; 4] {
    let near = (5.0 + 3.0 * 5f64.sqrt()) / 20.0;
    let far = (5.0 - 5f64.sqrt()) / 20.0;
    let sum: Vector = corners.iter().map(|c| c.coords).sum();
    corners.map(|corner| Point::from(sum * far + corner.coords * (near - far)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(vertices: &[[f64; 3]], tets: &[[u32; 4]]) -> TetMesh {
        TetMesh::new(vertices.iter().map(|&v| Point::from(v)).collect(), tets.to_vec()).unwrap()
    }

    fn unit(tets: &[[u32; 4]]) -> TetMesh {
        mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]], tets)
    }

    #[test]
    fn integrates_quadratics_exactly_and_cubics_not() {
        // ∫ x^a y^b z^c over the unit tetrahedron is a! b! c! / (a + b + c + 3)!.
        let rule = tet_quadrature(&unit(&[[0, 1, 2, 3]])).unwrap();
        let integral = |g: fn(&Point) -> f64| rule.integrate(&rule.points().iter().map(g).collect::<Vec<_>>());
        assert!((integral(|_| 1.0) - 1.0 / 6.0).abs() < 1e-16);
        assert!((integral(|p| p.y) - 1.0 / 24.0).abs() < 1e-16);
        assert!((integral(|p| p.x * p.x) - 2.0 / 120.0).abs() < 1e-16);
        assert!((integral(|p| p.x * p.z) - 1.0 / 120.0).abs() < 1e-16);
        assert!((integral(|p| p.x.powi(3)) - 6.0 / 720.0).abs() > 1e-4);
    }

    #[test]
    fn either_orientation_counts_positively_and_flat_tets_not_at_all() {
        let rule = tet_quadrature(&unit(&[[0, 1, 1, 3], [0, 1, 2, 3], [0, 2, 1, 3]])).unwrap();
        assert!((rule.volume() - 1.0 / 3.0).abs() < 1e-16);
        assert_eq!(rule.cells(), [1, 1, 1, 1, 2, 2, 2, 2]);
        assert_eq!(rule.layout(), CellLayout::Tets { count: 3 });
    }

    #[test]
    fn cell_means_average_over_each_tet() {
        let rule = tet_quadrature(&unit(&[[0, 1, 1, 3], [0, 1, 2, 3]])).unwrap();
        let x: Vec<f64> = rule.points().iter().map(|p| p.x).collect();
        let means = rule.cell_means(&x);
        assert_eq!(means.len(), 1);
        assert_eq!(means[0].cell, 1);
        assert!((means[0].volume - 1.0 / 6.0).abs() < 1e-16);
        assert!((means[0].mean - 0.25).abs() < 1e-15);
    }

    #[test]
    fn rejects_meshes_without_volume_or_with_bad_coordinates() {
        assert_eq!(
            tet_quadrature(&unit(&[])),
            Err(QuadratureError::Empty { element: "tetrahedron" })
        );
        assert_eq!(
            tet_quadrature(&unit(&[[0, 1, 2, 2]])),
            Err(QuadratureError::NoVolume { volume: 0.0 })
        );
        let broken = mesh(
            &[[0., 0., 0.], [1., 0., 0.], [0., f64::INFINITY, 0.], [0., 0., 1.]],
            &[[0, 1, 2, 3]],
        );
        assert!(matches!(
            tet_quadrature(&broken),
            Err(QuadratureError::NonFinite { vertex: 2, .. })
        ));
    }
}
