use super::*;
use crate::mesh::shapes;

/// Values of one density, with a count of the points asked for.
fn integrated(
    surface: &SurfaceMesh,
    options: &AdaptiveOptions,
    density: impl Fn(&Point) -> f64,
) -> (AdaptiveQuadrature, f64, usize) {
    let mut values = Vec::new();
    let adapted = adaptive_quadrature::<QuadratureError>(surface, options, &[0.0], &mut |points| {
        let new: Vec<f64> = points.iter().map(&density).collect();
        values.extend(&new);
        Ok(vec![new])
    })
    .unwrap();
    let rows: Vec<f64> = adapted.rows.iter().map(|&row| values[row as usize]).collect();
    for (point, value) in adapted.quadrature.points().iter().zip(&rows) {
        assert_eq!(density(point), *value, "rows are those of the points");
    }
    let integral = adapted.quadrature.integrate(&rows);
    (adapted, integral, values.len())
}

fn options(cells: usize, tolerance: f64) -> AdaptiveOptions {
    AdaptiveOptions {
        resolution: GridResolution::CellsAlongLongestSide(cells),
        tolerance,
        max_points: None,
    }
}

#[test]
fn a_density_that_is_linear_needs_no_division() {
    let surface = shapes::torus(2.0, 0.7, 40, 20);
    let (adapted, integral, evaluated) = integrated(&surface, &options(20, 1e-6), |p| 3.0 + p.x - 0.5 * p.z);
    let undivided = super::super::clipped_grid(&surface, GridResolution::CellsAlongLongestSide(20)).unwrap();
    assert_eq!(adapted.quadrature.points().len(), undivided.points().len());
    assert!(evaluated as f64 <= 1.4 * undivided.points().len() as f64, "{evaluated}");
    assert!(adapted.is_converged);
    assert!((integral / (3.0 * surface.volume()) - 1.0).abs() < 1e-7, "{integral}");
}

#[test]
fn a_peak_is_found_and_its_error_known() {
    // exp(−|p − c|²/s²), with s down to a third of a cell of the undivided grid; over all space it is (π s²)^{3/2}.
    let cube = shapes::cube(1.0, 4);
    let centre = Point::new(0.11, -0.07, 0.03);
    for (width, tolerance) in [(0.05, 0.01), (0.05, 0.005), (0.02, 0.01)] {
        let exact = (std::f64::consts::PI * width * width).powf(1.5);
        let density = |p: &Point| (-(p - centre).norm_squared() / (width * width)).exp();
        let (adapted, integral, evaluated) = integrated(&cube, &options(16, tolerance), density);
        let error = (integral - exact).abs();
        assert!(
            adapted.is_converged && error <= adapted.errors[0],
            "{width}: {error:e} {:?}",
            adapted.errors
        );
        assert!(adapted.errors[0] <= tolerance * integral);
        // A grid as fine everywhere has 16³ · 8³ points.
        assert!(evaluated < 100_000, "{evaluated}");
    }
}

#[test]
fn a_layer_below_the_surface_is_resolved() {
    // exp(−depth/d) in a ball of radius 1: 4π (d − 2 d² + 2 d³ (1 − e^{−1/d})).
    let depth: f64 = 0.1;
    let exact =
        4.0 * std::f64::consts::PI * (depth - 2.0 * depth.powi(2) + 2.0 * depth.powi(3) * (1.0 - (-1.0 / depth).exp()));
    let ball = shapes::sphere(1.0, 5);
    // Depth is that below the polyhedron, to second order in its edges.
    let inner = (ball.volume() / (4.0 / 3.0 * std::f64::consts::PI)).cbrt();
    let density = |p: &Point| ((p.coords.norm() - inner) / depth).exp();
    let (adapted, integral, _) = integrated(&ball, &options(32, 0.01), density);
    assert!(adapted.is_converged);
    assert!(
        (integral / exact - 1.0).abs() < 0.02,
        "{integral} {exact} {:?}",
        adapted.errors
    );
    let weights: f64 = adapted.quadrature.weights().iter().sum();
    assert!((weights / ball.volume() - 1.0).abs() < 1e-12);
}

#[test]
fn few_cells_do_not_make_an_integral_look_exact() {
    let ball = shapes::sphere(1.0, 4);
    let density = |p: &Point| 1.0 + (4.0 * (p.x + 0.3)).exp();
    let (_, exact, _) = integrated(&ball, &options(128, 0.01), density);
    for cells in [1, 2, 3, 5, 8] {
        let (adapted, integral, _) = integrated(&ball, &options(cells, 0.01), density);
        assert!(adapted.quadrature.points().len() >= FEWEST_POINTS);
        let error = (integral - exact).abs();
        assert!(
            error > 0.0 && error <= adapted.errors[0],
            "{cells}: {error:e} {:?}",
            adapted.errors
        );
    }
}

#[test]
fn a_rod_has_points_enough() {
    // A rod of 80 times its thickness, with a bulge of density a twentieth of its length wide near one end.
    let rod = shapes::deformed(&shapes::cube(1.0, 16), |p| Point::new(p.x, 0.0125 * p.y, 0.0125 * p.z));
    let density = |p: &Point| {
        let across = (p.y * p.y + p.z * p.z) / 0.005f64.powi(2);
        1.0 + 1e3 * across * across * (-((p.x - 0.41) / 0.01).powi(2)).exp()
    };
    let (_, exact, _) = integrated(&rod, &options(3000, 1e-3), density);
    let (adapted, integral, _) = integrated(&rod, &options(48, 0.01), density);
    assert!(
        (integral - exact).abs() <= adapted.errors[0],
        "{integral} {exact} {:?}",
        adapted.errors
    );
    assert!(adapted.is_converged);
}

#[test]
fn the_limit_of_points_is_kept_and_told() {
    let cube = shapes::cube(1.0, 4);
    let options = AdaptiveOptions {
        max_points: Some(6000),
        ..options(16, 1e-6)
    };
    let (adapted, _, evaluated) = integrated(&cube, &options, |p| (40.0 * p.x).sin().powi(2));
    assert!(!adapted.is_converged);
    assert!(evaluated <= 6000, "{evaluated}");
}

#[test]
fn errors_of_densities_come_back() {
    #[derive(Debug, PartialEq)]
    struct Refused;
    impl From<QuadratureError> for Refused {
        fn from(_: QuadratureError) -> Self {
            panic!("the cube bounds a solid")
        }
    }
    let found = adaptive_quadrature(&shapes::cube(1.0, 2), &options(4, 0.01), &[0.0], &mut |_| Err(Refused));
    assert_eq!(found, Err(Refused));
}
