use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::*;
use crate::geometry::test_models;
use crate::mesh::shapes;

fn map(domain: &SurfaceMesh, f: impl Fn(&Point) -> Point) -> MeanValueMap {
    let image = domain.vertices().iter().map(f).collect();
    MeanValueMap::new(&BoundaryMap::new(domain.clone(), image).unwrap()).unwrap()
}

/// A map of the boundary that is nowhere affine.
fn bend(p: &Point) -> Point {
    Point::new(
        p.x + 0.3 * (2.0 * p.y).sin(),
        p.y * (1.0 + 0.2 * p.z) - 0.1 * p.x * p.x,
        1.5 * p.z + 0.2 * (p.x * p.y).cos(),
    )
}

fn affine(p: &Point) -> Point {
    let m = Matrix3::new(1.1, -0.4, 0.2, 0.3, 0.9, -0.7, -0.2, 0.5, 1.3);
    m * p + Vector::new(0.3, -2.0, 5.0)
}

/// An L of three cubes: seen from inside one arm, part of the other is hidden.
fn bent_bar() -> SurfaceMesh {
    shapes::polycube(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], 3)
}

fn points_inside(mesh: &SurfaceMesh, count: usize) -> Vec<Point> {
    let query = SurfaceQuery::new(mesh).unwrap();
    let (low, high) = mesh.bounding_box().unwrap();
    let mut random = StdRng::seed_from_u64(7);
    let mut points = Vec::new();
    while points.len() < count {
        let p = Point::from(Vector::from_fn(|k, _| random.random_range(low[k]..high[k])));
        if query.contains(&p) {
            points.push(p);
        }
    }
    points
}

/// Points at a distance from random places of random triangles, on the inner side.
fn points_below(mesh: &SurfaceMesh, distance: f64, count: usize) -> Vec<Point> {
    let mut random = StdRng::seed_from_u64(11);
    (0..count)
        .map(|_| {
            let t = random.random_range(0..mesh.triangles().len());
            let [a, b, c] = mesh.corners(t);
            let (u, v): (f64, f64) = (random.random_range(0.1..0.45), random.random_range(0.1..0.45));
            a + (b - a) * u + (c - a) * v - mesh.area_vector(t).normalize() * distance
        })
        .collect()
}

fn assert_close(found: &[Point], expected: &[Point], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).norm();
        assert!(
            error <= tolerance,
            "point {k}: {found} not {expected}, off by {error:e}"
        );
    }
}

#[test]
fn reproduces_affine_maps_to_rounding() {
    for mesh in [
        shapes::sphere(1.0, 3),
        shapes::cube(2.0, 4),
        bent_bar(),
        shapes::torus(1.0, 0.3, 40, 16),
    ] {
        let map = map(&mesh, affine);
        let mut points = points_inside(&mesh, 200);
        for distance in [1e-2, 1e-4, 1e-6, 1e-9, 1e-11] {
            points.extend(points_below(&mesh, distance, 50));
        }
        let expected: Vec<Point> = points.iter().map(affine).collect();
        assert_close(&map.evaluate(&points), &expected, 1e-12);
    }
}

/// A rounding error of the image divided by the step leaves 5e-14 over the distance; the rest is for the differences'
/// own error, with the seventh derivative.
#[test]
fn jacobian_matches_differences_at_all_distances() {
    for mesh in [shapes::sphere(1.0, 3), shapes::cube(2.0, 4), bent_bar()] {
        let map = map(&mesh, bend);
        for distance in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
            let points = points_below(&mesh, distance, 30);
            for (p, jacobian) in points.iter().zip(map.jacobian(&points)) {
                let error = (differences(&map, p, 0.02 * distance) - jacobian).amax();
                assert!(
                    error < 1e-9 + 1e-13 / distance,
                    "off by {error:e} at distance {distance:e}"
                );
            }
        }
    }
}

/// Central differences of sixth order.
fn differences(map: &MeanValueMap, p: &Point, h: f64) -> Matrix3 {
    let mut result = Matrix3::zeros();
    for k in 0..3 {
        let step = Vector::ith(k, h);
        let slope = |m: f64| {
            let f = map.evaluate(&[p + step * m, p - step * m]);
            (f[0] - f[1]) / (2.0 * m * h)
        };
        result.set_column(k, &(slope(1.0) * 1.5 - slope(2.0) * 0.6 + slope(3.0) * 0.1));
    }
    result
}

/// The image carries a rounding error of a few 1e-16, which the Jacobian divides by the distance.
#[test]
fn jacobian_of_an_affine_map_is_its_matrix() {
    for mesh in [shapes::sphere(1.0, 3), bent_bar(), shapes::torus(1.0, 0.3, 40, 16)] {
        let map = map(&mesh, affine);
        let matrix = Matrix3::from_fn(|i, k| (affine(&Vector::ith(k, 1.0).into()) - affine(&Point::origin()))[i]);
        for distance in [1e-1, 1e-3, 1e-6, 1e-8, 0.0] {
            for jacobian in map.jacobian(&points_below(&mesh, distance, 50)) {
                let error = (jacobian - matrix).amax();
                assert!(
                    error < 1e-12 + 1e-14 / f64::max(distance, 1e-8),
                    "{error:e} at {distance:e}"
                );
            }
        }
    }
}

#[test]
fn interpolates_vertices_edges_and_faces() {
    for mesh in [shapes::sphere(1.0, 2), bent_bar()] {
        let map = map(&mesh, bend);
        let image: Vec<Point> = mesh.vertices().iter().map(bend).collect();
        assert_eq!(map.evaluate(mesh.vertices()), image);
        for [u, v, w] in [
            [0.5, 0.5, 0.0],
            [0.3, 0.0, 0.7],
            [0.2, 0.3, 0.5],
            [1e-9, 0.6, 0.4 - 1e-9],
        ] {
            let blend = |of: &[Point]| -> Vec<Point> {
                let corners = mesh.triangles().iter().map(|t| t.map(|v| of[v as usize].coords));
                corners.map(|[a, b, c]| (a * u + b * v + c * w).into()).collect()
            };
            assert_close(&map.evaluate(&blend(mesh.vertices())), &blend(&image), 1e-14);
        }
    }
}

/// The map is Lipschitz with a constant of a few here, off edges and vertices too.
#[test]
fn approaches_the_boundary_without_noise() {
    for mesh in [shapes::cube(2.0, 3), bent_bar()] {
        let map = map(&mesh, bend);
        for (scale, direction) in [(1e-3, 1.0), (1e-6, 2.0), (1e-9, 3.0), (1e-11, 4.0)] {
            let step = Vector::new(0.4, -0.7 * direction, 0.3).normalize() * scale;
            let edges = mesh.triangles().iter().map(|t| {
                let [a, b] = [mesh.vertices()[t[0] as usize], mesh.vertices()[t[1] as usize]];
                (nalgebra::center(&a, &b), nalgebra::center(&bend(&a), &bend(&b)))
            });
            let vertices = mesh.vertices().iter().map(|p| (*p, bend(p)));
            let (points, images): (Vec<Point>, Vec<Point>) = edges.chain(vertices).unzip();
            let near: Vec<Point> = points.iter().map(|p| p + step).collect();
            assert_close(&map.evaluate(&near), &images, 20.0 * scale);
        }
    }
}

#[test]
fn jacobian_is_finite_next_to_and_on_the_boundary() {
    let mut meshes = vec![
        shapes::sphere(1.0, 2),
        shapes::cube(1.0, 3),
        bent_bar(),
        shapes::spherical_shell(2.0, 1.0, 2),
    ];
    meshes.extend(test_models::load("surfaces/kitten_g1_9k.obj"));
    for mesh in meshes {
        let size = mesh.diagonal();
        let map = map(&mesh, |p| bend(&(p / size)));
        let mut points = points_below(&mesh, 1e-6 * size, 40);
        points.extend(points_below(&mesh, 0.0, 20));
        for [a, b, _] in mesh
            .triangles()
            .iter()
            .step_by(mesh.triangles().len() / 20)
            .map(|t| t.map(|v| v as usize))
        {
            let (a, b) = (mesh.vertices()[a], mesh.vertices()[b]);
            let middle = nalgebra::center(&a, &b);
            points.extend([a, middle]);
            let step = Vector::new(0.6, 0.0, -0.8) * 1e-6 * size;
            points.extend([a, middle].into_iter().flat_map(|p| [p + step, p - step]));
        }
        for (p, jacobian) in points.iter().zip(map.jacobian(&points)) {
            // Steep where a vertex is passed on the outside, but no more than that.
            assert!(jacobian.amax() < 1e3 / size, "{p}: {jacobian}");
        }
    }
}

/// Along the boundary it is the gradient of the boundary map, across it the limit from inside, which is reached in
/// proportion to the distance.
#[test]
fn jacobian_on_the_boundary_is_the_limit_from_inside() {
    let mesh = shapes::sphere(1.0, 2);
    let map = map(&mesh, bend);
    let [on, inside] = [0.0, 1e-6].map(|distance| map.jacobian(&points_below(&mesh, distance, 50)));
    for (on, inside) in on.iter().zip(inside) {
        assert!((on - inside).amax() < 1e-4, "{on} {inside}");
    }
}

/// In the plane of the inner faces of an L the closed form of their integrals is 0/0.
#[test]
fn is_smooth_across_the_planes_of_faces() {
    let mesh = bent_bar();
    let map = map(&mesh, bend);
    let (low, high) = mesh.bounding_box().unwrap();
    let on = low + Vector::new(0.4, 1.0, 0.37) * (high.z - low.z);
    let (image, jacobian) = (map.evaluate(&[on])[0], map.jacobian(&[on])[0]);
    assert!((differences(&map, &on, 2e-3) - jacobian).amax() < 1e-9);
    for offset in [1e-15, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3] {
        for offset in [offset, -offset] {
            let p = on + Vector::new(0.0, offset, 0.0);
            assert!((map.evaluate(&[p])[0] - image).norm() < 1e-14 + 3.0 * offset.abs());
            let change = (map.jacobian(&[p])[0] - jacobian).amax();
            assert!(change < 1e-10 + 10.0 * offset.abs(), "{change:e} at {offset:e}");
        }
    }
}

/// The definition: every intersection of every direction, `sign · f / distance`, over a lattice of directions.
fn mean_over_directions(mesh: &SurfaceMesh, p: &Point, f: impl Fn(&Point) -> Point) -> Point {
    let count = 40_000;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let (mut numerator, mut denominator) = (Vector::zeros(), 0.0);
    for k in 0..count {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let (angle, radius) = (golden * k as f64, (1.0 - z * z).sqrt());
        let direction = Vector::new(radius * angle.cos(), radius * angle.sin(), z);
        for t in 0..mesh.triangles().len() {
            let corners = mesh.corners(t);
            let [a, b, c] = corners.map(|q| q - p);
            let volumes = [b.cross(&c), c.cross(&a), a.cross(&b)].map(|n| n.dot(&direction));
            let total: f64 = volumes.iter().sum();
            if volumes.iter().any(|v| v * total < 0.0) || a.dot(&b.cross(&c)) * total <= 0.0 {
                continue;
            }
            let weight = total / a.dot(&b.cross(&c)).abs();
            let mixed: Vector = (0..3).map(|k| f(&corners[k]).coords * (volumes[k] / total)).sum();
            numerator += mixed * weight;
            denominator += weight;
        }
    }
    (numerator / denominator).into()
}

/// The lattice's error is about the jump across edges over the root of the count, less as they cancel.
#[test]
fn matches_the_mean_over_directions() {
    for mesh in [
        shapes::cube(2.0, 1),
        shapes::sphere(1.0, 1),
        shapes::polycube(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], 1),
    ] {
        let map = map(&mesh, bend);
        let points = points_inside(&mesh, 4);
        let expected: Vec<Point> = points.iter().map(|p| mean_over_directions(&mesh, p, bend)).collect();
        assert_close(&map.evaluate(&points), &expected, 1e-3);
    }
}

#[test]
fn is_invariant_under_similarities_of_the_domain() {
    let mesh = bent_bar();
    let image: Vec<Point> = mesh.vertices().iter().map(bend).collect();
    let plain = MeanValueMap::new(&BoundaryMap::new(mesh.clone(), image.clone()).unwrap()).unwrap();
    let points = points_inside(&mesh, 100);
    let (images, jacobians) = (plain.evaluate(&points), plain.jacobian(&points));
    let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
    for (scale, shift, tolerance) in [
        (1.0, 0.0, 1e-12),
        (3e-90, 0.0, 1e-12),
        (7e90, 0.0, 1e-12),
        (1.0, 1e4, 1e-10),
    ] {
        let carry = |p: &Point| turn * p * scale + Vector::new(1.0, -2.0, 0.5) * shift;
        let carried = shapes::deformed(&mesh, carry);
        let map = MeanValueMap::new(&BoundaryMap::new(carried, image.clone()).unwrap()).unwrap();
        let places: Vec<Point> = points.iter().map(carry).collect();
        assert_close(&map.evaluate(&places), &images, tolerance);
        for (found, expected) in map.jacobian(&places).iter().zip(&jacobians) {
            assert!((found * scale * turn.matrix() - expected).amax() < 1e3 * tolerance);
        }
    }
}

#[test]
fn reversing_the_domain_changes_nothing() {
    let mesh = bent_bar();
    let points = points_inside(&mesh, 50);
    let (map, turned) = (map(&mesh, bend), map(&mesh.reversed(), bend));
    assert_close(&turned.evaluate(&points), &map.evaluate(&points), 1e-14);
    let on = points_below(&mesh, 0.0, 10);
    for (a, b) in map.jacobian(&on).iter().zip(turned.jacobian(&on)) {
        assert!((a - b).amax() < 1e-6);
    }
}

#[test]
fn results_do_not_depend_on_threads_or_other_points() {
    let mesh = shapes::torus(1.0, 0.3, 40, 16);
    let map = map(&mesh, bend);
    let points = points_inside(&mesh, 101);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (map.evaluate(&points), map.jacobian(&points)))
    };
    let one = run(1);
    assert_eq!(one, run(3));
    for (k, p) in points.iter().enumerate() {
        assert_eq!(map.evaluate(&[*p])[0], one.0[k]);
        assert_eq!(map.jacobian(&[*p])[0], one.1[k]);
    }
}

#[test]
fn all_instruction_sets_agree() {
    let mesh = bent_bar();
    let fastest = map(&mesh, bend);
    let mut points = points_inside(&mesh, 61);
    points.extend(points_below(&mesh, 1e-3, 20));
    for instructions in Instructions::available() {
        let map = MeanValueMap {
            instructions,
            ..fastest.clone()
        };
        assert_close(&map.evaluate(&points), &fastest.evaluate(&points), 1e-13);
        for (a, b) in map.jacobian(&points).iter().zip(fastest.jacobian(&points)) {
            assert!((a - b).amax() < 1e-10);
        }
    }
}

#[test]
fn points_that_are_not_finite_map_to_nan() {
    let mesh = shapes::cube(1.0, 2);
    let map = map(&mesh, bend);
    let inside = mesh
        .bounding_box()
        .map(|(low, high)| nalgebra::center(&low, &high))
        .unwrap();
    let mut points = vec![inside];
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        points.extend([0, 1, 2].map(|k| {
            let mut p = inside;
            p[k] = bad;
            p
        }));
    }
    let (images, jacobians) = (map.evaluate(&points), map.jacobian(&points));
    assert!(images[0].iter().chain(jacobians[0].iter()).all(|c| c.is_finite()));
    for (image, jacobian) in images.iter().zip(&jacobians).skip(1) {
        assert!(
            image.iter().chain(jacobian.iter()).all(|c| c.is_nan()),
            "{image} {jacobian}"
        );
    }
    for far in [1e30, 1e150, f64::MAX] {
        map.evaluate(&[Point::new(far, -far, 0.0)]);
        map.jacobian(&[Point::new(far, -far, 0.0)]);
    }
    assert!(map.evaluate(&[]).is_empty());
    assert!(map.jacobian(&[]).is_empty());
}

fn build(mesh: SurfaceMesh) -> Result<MeanValueMap, MeanValueError> {
    let image = (0..mesh.vertices().len())
        .map(|k| Point::new(k as f64, 0.0, 1.0))
        .collect();
    MeanValueMap::new(&BoundaryMap::new(mesh, image).unwrap())
}

#[test]
fn says_why_a_surface_has_no_coordinates() {
    let cube = shapes::cube(1.0, 2);
    let with = |triangles: Vec<[u32; 3]>| SurfaceMesh::new(cube.vertices().to_vec(), triangles).unwrap();
    let open = build(with(cube.triangles()[1..].to_vec()));
    assert!(
        matches!(open, Err(MeanValueError::NotClosed { edges: 3, .. })),
        "{open:?}"
    );
    let mut turned = cube.triangles().to_vec();
    turned[5].swap(0, 1);
    assert!(matches!(
        build(with(turned)),
        Err(MeanValueError::NotClosed { edges: 3, .. })
    ));
    let mut vertices = cube.vertices().to_vec();
    vertices[4].y = f64::NAN;
    let non_finite = build(cube.with_vertices(vertices).unwrap());
    assert!(
        matches!(non_finite, Err(MeanValueError::Surface(QueryError::NonFinite { .. }))),
        "{non_finite:?}"
    );
    for flat in [
        shapes::deformed(&cube, |p| Point::new(p.x, 0.0, 0.0)),
        shapes::deformed(&cube, |_| Point::origin()),
    ] {
        assert!(matches!(build(flat), Err(MeanValueError::NoArea { triangles: 48 })));
    }
}

/// Two sets of instructions round differently, so that their difference shows what rounding does to the Jacobian.
#[test]
fn a_real_model_reproduces_affine_maps_and_keeps_digits() {
    let Some(mesh) = test_models::load("surfaces/igea_15k.obj") else {
        return;
    };
    let size = mesh.diagonal();
    let mut points = points_inside(&mesh, 200);
    points.extend(points_below(&mesh, 1e-6 * size, 50));
    let straight = map(&mesh, |p| affine(&(p / size)));
    let expected: Vec<Point> = points.iter().map(|p| affine(&(p / size))).collect();
    assert_close(&straight.evaluate(&points), &expected, 1e-12);

    let bent = map(&mesh, |p| bend(&(p / size)));
    let portable = MeanValueMap {
        instructions: Instructions::PORTABLE,
        ..bent.clone()
    };
    let jacobians = bent.jacobian(&points).into_iter().zip(portable.jacobian(&points));
    for (k, (a, b)) in jacobians.enumerate() {
        let error = (a - b).amax() * size;
        assert!(error < if k < 200 { 1e-11 } else { 1e-8 }, "point {k} off by {error:e}");
    }
}
