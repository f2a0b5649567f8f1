use std::hint::black_box;

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
        assert!(error <= tolerance, "point {k}: {found} not {expected}, off by {error:e}");
    }
}

#[test]
fn reproduces_affine_maps_to_rounding() {
    for mesh in [shapes::sphere(1.0, 3), shapes::cube(2.0, 4), bent_bar(), shapes::torus(1.0, 0.3, 40, 16)] {
        let map = map(&mesh, affine);
        let mut points = points_inside(&mesh, 200);
        for distance in [1e-2, 1e-4, 1e-6, 1e-9, 1e-11] {
            points.extend(points_below(&mesh, distance, 50));
        }
        let expected: Vec<Point> = points.iter().map(affine).collect();
        assert_close(&map.evaluate(&points), &expected, 1e-12);
    }
}

#[test]
#[ignore]
fn speed() {
    let mesh = test_models::load("surfaces/igea_15k.obj").unwrap();
    let map = map(&mesh, bend);
    let points = points_inside(&mesh, 2000);
    for instructions in Instructions::available() {
        let map = MeanValueMap { instructions, ..map.clone() };
        let start = std::time::Instant::now();
        black_box(map.evaluate(&points));
        let value = start.elapsed().as_secs_f64();
        let start = std::time::Instant::now();
        black_box(map.jacobian(&points));
        let both = start.elapsed().as_secs_f64();
        let pairs = (points.len() * mesh.triangles().len()) as f64;
        println!("{instructions:?} {:.2} {:.2} ns", value / pairs * 1e9, both / pairs * 1e9);
    }
}

#[test]
fn jacobian_matches_differences_at_all_distances() {
    for mesh in [shapes::sphere(1.0, 3), shapes::cube(2.0, 4), bent_bar()] {
        let map = map(&mesh, bend);
        for distance in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
            let points = points_below(&mesh, distance, 40);
            let mut worst = 0.0f64;
            for (p, jacobian) in points.iter().zip(map.jacobian(&points)) {
                worst = worst.max((differences(&map, p, 0.02 * distance) - jacobian).amax());
            }
            println!("{distance:e}: {worst:e}");
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
