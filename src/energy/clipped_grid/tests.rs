use rand::{Rng, SeedableRng, rngs::StdRng};

use super::*;
use crate::mesh::shapes;

const SEED: u64 = 7;

fn by_count(surface: &SurfaceMesh, cells: usize) -> Quadrature {
    clipped_grid(surface, GridResolution::CellsAlongLongestSide(cells)).unwrap()
}

fn grid_of(rule: &Quadrature) -> Grid {
    match rule.layout() {
        CellLayout::Grid(grid) => grid,
        CellLayout::Tets { .. } | CellLayout::Hexes { .. } => panic!("not a grid"),
    }
}

fn rotated(surface: &SurfaceMesh) -> SurfaceMesh {
    let rotation = nalgebra::Rotation3::new(Vector::new(0.4, -0.7, 0.5));
    shapes::deformed(surface, |p| rotation * p)
}

fn star(rng: &mut StdRng) -> SurfaceMesh {
    let waves: Vec<Vector> = (0..4)
        .map(|_| Vector::from_fn(|_, _| rng.random_range(-4.0..4.0)))
        .collect();
    shapes::deformed(&shapes::sphere(1.0, 3), |p| {
        let bump: f64 = waves.iter().map(|wave| wave.dot(&p.coords).sin()).sum();
        p * (1.0 + 0.15 * bump)
    })
}

/// A shell so thin that nearly all centroids of clipped cells lie outside it.
fn foil() -> SurfaceMesh {
    shapes::spherical_shell(1.0, 0.9995, 3)
}

fn solids() -> Vec<(&'static str, SurfaceMesh)> {
    let mut rng = StdRng::seed_from_u64(SEED);
    let apart = shapes::deformed(&shapes::cube(0.7, 1), |p| p + Vector::new(3.0, 0.3, -0.2));
    let far = shapes::deformed(&shapes::sphere(1.0, 3), |p| p + Vector::new(1e4, -2e4, 3e4));
    vec![
        ("sphere", shapes::sphere(1.3, 3)),
        ("aligned cube", shapes::cube(1.0, 3)),
        ("rotated cube", rotated(&shapes::cube(1.0, 1))),
        ("torus", shapes::torus(1.0, 0.3, 40, 20)),
        ("rotated torus", rotated(&shapes::torus(1.0, 0.3, 40, 20))),
        ("double torus", shapes::double_torus(2)),
        ("rotated double torus", rotated(&shapes::double_torus(2))),
        ("shell", shapes::spherical_shell(1.0, 0.6, 3)),
        ("foil", foil()),
        ("two components", shapes::joined(&shapes::sphere(1.0, 3), &apart)),
        ("far from the origin", far),
        ("star", star(&mut rng)),
        ("another star", star(&mut rng)),
    ]
}

/// `∫ x dV` of a closed surface by the divergence theorem, and its volume, about the box centre.
fn first_moment(surface: &SurfaceMesh) -> Vector {
    let (low, high) = surface.bounding_box().unwrap();
    let centre = nalgebra::center(&low, &high);
    let about_centre: Vector = (0..surface.triangles().len())
        .map(|t| {
            let [a, b, c] = surface.corners(t).map(|p| p - centre);
            (a + b + c) * (a.dot(&b.cross(&c)) / 24.0)
        })
        .sum();
    about_centre + centre.coords * surface.volume()
}

/// Winding number by solid angles (van Oosterom & Strackee 1983), no code in common with the ray test.
fn winding_number(surface: &SurfaceMesh, point: &Point) -> f64 {
    let angles = (0..surface.triangles().len()).map(|t| {
        let [a, b, c] = surface.corners(t).map(|p| p - point);
        let (na, nb, nc) = (a.norm(), b.norm(), c.norm());
        let below = na * nb * nc + a.dot(&b) * nc + b.dot(&c) * na + c.dot(&a) * nb;
        a.dot(&b.cross(&c)).atan2(below)
    });
    angles.sum::<f64>() / (2.0 * std::f64::consts::PI)
}

#[test]
fn weights_add_up_to_the_volume() {
    for (name, surface) in solids() {
        let (low, high) = surface.bounding_box().unwrap();
        // What a thin solid leaves of its box is a difference of large prisms. Coordinates far away carry their
        // own rounding, up to 3e4 · 1e-16 of the side.
        let difference = (high - low).product() / surface.volume();
        let tolerance = 1e-13 * difference + if name == "far from the origin" { 1e-11 } else { 0.0 };
        for cells in [1, 5, 16, 33] {
            let error = by_count(&surface, cells).volume() / surface.volume() - 1.0;
            assert!(error.abs() < tolerance, "{name} at {cells}: {error:e}");
        }
    }
}

#[test]
fn linear_densities_are_integrated_exactly() {
    for (name, surface) in solids() {
        for cells in [1, 7, 16] {
            let rule = by_count(&surface, cells);
            let found: Vector = rule
                .points()
                .iter()
                .zip(rule.weights())
                .map(|(p, w)| p.coords * *w)
                .sum();
            let expected = first_moment(&surface);
            let error = (found - expected).norm() / surface.volume();
            // Neglected parts, each below 1e-9 of a cell, are a thousandth of the cells at most. Only in the foil are
            // points off their centroids, and then within a piece of the smallest size, a 32nd of a cell.
            let tolerance = match name {
                "foil" => 3f64.sqrt() / 32.0 * grid_of(&rule).cell_size,
                "far from the origin" => 1e-10,
                _ => 1e-11,
            };
            assert!(error < tolerance, "{name} at {cells}: {error:e}");
        }
    }
}

#[test]
fn every_point_lies_in_the_solid_and_in_its_cell() {
    for (name, surface) in solids() {
        let rule = by_count(&surface, 5);
        let grid = grid_of(&rule);
        for (point, &cell) in rule.points().iter().zip(rule.cells()) {
            // On the surface itself the angles add up to a half; rounding decides which side is seen.
            let winding = winding_number(&surface, point);
            assert!(winding > 0.4, "{name}: winding number {winding} at {point}");
            let within = (point - grid.corner(cell)) / grid.cell_size;
            assert!(within.min() > -1e-6 && within.max() < 1.0 + 1e-6, "{name}: {within}");
        }
    }
}

#[test]
fn each_weight_is_the_volume_of_its_cell_in_the_solid() {
    // A rotated cube again, now cell by cell against 40³ probes per cell: each of at most three faces through a cell
    // misjudges less than half a layer of probes, 3 · 0.5 · √3 / 40 of the cell in all.
    let side = 1.0;
    let rotation = nalgebra::Rotation3::new(Vector::new(0.4, -0.7, 0.5));
    let surface = shapes::deformed(&shapes::cube(side, 2), |p| rotation * p);
    let rule = by_count(&surface, 6);
    let grid = grid_of(&rule);
    let mut weights = vec![0.0; grid.dims.iter().product()];
    for (weight, &cell) in rule.weights().iter().zip(rule.cells()) {
        weights[cell as usize] += weight / grid.cell_size.powi(3);
    }
    let probes = 40;
    for (cell, weight) in weights.iter().enumerate() {
        let corner = grid.corner(cell as u32);
        let mut inside = 0;
        for n in 0..probes * probes * probes {
            let step = [n % probes, n / probes % probes, n / probes / probes];
            let step = Vector::from(step.map(|s| (s as f64 + 0.5) / probes as f64));
            let probe = rotation.inverse() * (corner + step * grid.cell_size);
            inside += usize::from(probe.coords.amax() < side / 2.0);
        }
        let expected = inside as f64 / (probes * probes * probes) as f64;
        assert!((weight - expected).abs() < 0.065, "{weight} against {expected}");
    }
}

#[test]
fn a_cube_on_grid_planes_fills_its_cells_and_no_others() {
    for divisions in [1, 3, 8] {
        let rule = by_count(&shapes::cube(2.0, divisions), 8);
        let grid = grid_of(&rule);
        assert_eq!(grid.dims, [8; 3]);
        assert_eq!(rule.points().len(), 512);
        for (n, (point, weight)) in rule.points().iter().zip(rule.weights()).enumerate() {
            let centre = grid.corner(n as u32) + Vector::repeat(0.125);
            assert!((point - centre).norm() < 1e-14);
            assert!((weight - 0.25f64.powi(3)).abs() < 1e-16);
        }
    }
}

#[test]
fn holes_and_cavities_on_grid_planes_stay_empty() {
    let rule = by_count(&shapes::double_torus(1), 5);
    assert_eq!(grid_of(&rule).dims, [5, 3, 1]);
    assert_eq!(rule.points().len(), 13);
    let hollow = shapes::joined(&shapes::cube(3.0, 3), &shapes::cube(1.0, 1).reversed());
    let rule = by_count(&hollow, 3);
    assert_eq!(rule.points().len(), 26);
    assert!(rule.weights().iter().all(|w| (w - 1.0).abs() < 1e-14));
}

#[test]
fn a_cell_size_is_kept() {
    let rule = clipped_grid(&shapes::double_torus(1), GridResolution::CellSize(0.4)).unwrap();
    let grid = grid_of(&rule);
    assert_eq!(grid.cell_size, 0.4);
    assert_eq!(grid.dims, [13, 8, 3]);
    assert!((rule.volume() - 13.0).abs() < 1e-12);
}

#[test]
fn quadratic_densities_converge_with_second_order() {
    // A full cell errs by h² / 24 · Δg times its volume, a clipped one by the same order: halving h quarters the
    // error. The reference is exact on the polyhedron, so that nothing but the rule is measured.
    let surface = shapes::sphere(1.0, 4);
    let exact: f64 = (0..surface.triangles().len())
        .map(|t| {
            // ∫ |x|² over the tetrahedron (0, a, b, c) is V / 20 · (Σ |v|² + |Σ v|²).
            let [a, b, c] = surface.corners(t).map(|p| p.coords);
            let volume = a.dot(&b.cross(&c)) / 6.0;
            let squares = a.norm_squared() + b.norm_squared() + c.norm_squared();
            volume / 20.0 * (squares + (a + b + c).norm_squared())
        })
        .sum();
    let error = |cells| {
        let rule = by_count(&surface, cells);
        let density: Vec<f64> = rule.points().iter().map(|p| p.coords.norm_squared()).collect();
        (rule.integrate(&density) - exact).abs() / exact
    };
    let errors = [8, 16, 32].map(error);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.15, "order {order}, errors {errors:?}");
    }
}

#[test]
fn rejects_surfaces_that_bound_no_solid() {
    let sphere = shapes::sphere(1.0, 2);
    let rule = |surface: &SurfaceMesh| clipped_grid(surface, GridResolution::CellsAlongLongestSide(8));
    let with = |triangles: Vec<[u32; 3]>| SurfaceMesh::new(sphere.vertices().to_vec(), triangles).unwrap();

    assert_eq!(rule(&with(vec![])), Err(QuadratureError::Empty { element: "triangle" }));
    assert!(matches!(
        rule(&with(sphere.triangles()[1..].to_vec())),
        Err(QuadratureError::Open { .. })
    ));
    assert!(matches!(
        rule(&sphere.reversed()),
        Err(QuadratureError::NoVolume { .. })
    ));
    let flat = shapes::deformed(&sphere, |p| Point::new(p.x, p.y, 0.0));
    assert!(matches!(rule(&flat), Err(QuadratureError::NoVolume { .. })));
    let point = shapes::deformed(&sphere, |_| Point::origin());
    assert!(matches!(rule(&point), Err(QuadratureError::NoVolume { .. })));
    let small = shapes::deformed(&shapes::sphere(0.5, 2).reversed(), |p| p + Vector::new(3.0, 0.0, 0.0));
    assert!(matches!(
        rule(&shapes::joined(&sphere, &small)),
        Err(QuadratureError::InsideOut { .. })
    ));
    let broken = shapes::deformed(
        &sphere,
        |p| if p.x > 0.99 { Point::new(f64::NAN, 0.0, 0.0) } else { *p },
    );
    assert!(matches!(rule(&broken), Err(QuadratureError::NonFinite { .. })));
    let huge = shapes::deformed(&sphere, |p| p * 1.5e308);
    assert!(matches!(rule(&huge), Err(QuadratureError::NoVolume { .. })));
}

#[test]
fn rejects_grids_without_cells_or_with_too_many() {
    let cube = shapes::cube(1.0, 1);
    for none in [
        GridResolution::CellsAlongLongestSide(0),
        GridResolution::CellSize(0.0),
        GridResolution::CellSize(f64::NAN),
    ] {
        assert!(matches!(clipped_grid(&cube, none), Err(QuadratureError::NoCells(_))));
    }
    for many in [
        GridResolution::CellsAlongLongestSide(1025),
        GridResolution::CellsAlongLongestSide(usize::MAX),
        GridResolution::CellSize(1e-300),
    ] {
        assert!(matches!(
            clipped_grid(&cube, many),
            Err(QuadratureError::TooManyCells { .. })
        ));
    }
}

#[test]
fn does_not_depend_on_the_number_of_threads() {
    let surface = rotated(&shapes::torus(1.0, 0.3, 40, 20));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| by_count(&surface, 20))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn stray_vertices_do_not_matter() {
    let cube = shapes::cube(1.0, 1);
    let mut vertices = cube.vertices().to_vec();
    vertices.extend([Point::new(f64::NAN, 0.0, 0.0), Point::new(1e9, 0.0, 0.0)]);
    let stray = SurfaceMesh::new(vertices, cube.triangles().to_vec()).unwrap();
    assert_eq!(by_count(&stray, 4), by_count(&cube, 4));
}
