use nalgebra::{Rotation3, Unit};
use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::StdRng};

use super::*;
use crate::geometry::{test_models, winding_number};
use crate::mesh::shapes;

const SEED: u64 = 23;

/// An inscribed mesh with sides `h` lies within `h² / 8r` of a surface with radius of curvature `r`, twice that
/// where it is curved both ways; the distances to both differ no more.
#[test]
fn distances_are_those_to_the_sphere_and_the_torus() {
    let (major, minor) = (1.0, 0.3);
    let to_torus = |p: &Point| (p.x.hypot(p.y) - major).hypot(p.z) - minor;
    let to_sphere = |p: &Point| p.coords.norm() - 1.0;
    let torus = shapes::torus(major, minor, 200, 60);
    let sphere = shapes::sphere(1.0, 5);
    for (mesh, exact, radius) in [
        (&torus, &to_torus as &dyn Fn(&Point) -> f64, minor),
        (&sphere, &to_sphere, 1.0),
    ] {
        let query = SurfaceQuery::new(mesh).unwrap();
        let bound = 2.0 * query.longest_side.powi(2) / (8.0 * radius);
        for p in points_about(&query.bounds(), 0.5, 2000) {
            let signed = query.signed_distance(&p);
            assert!((signed - exact(&p)).abs() < bound, "{signed} at {p}");
        }
    }
}

#[test]
fn the_tree_finds_exactly_what_a_search_of_all_triangles_finds() {
    for (seed, mesh) in [
        (1, random_soup(1, 300)),
        (2, random_soup(2, 7)),
        (3, shapes::double_torus(3)),
    ] {
        let query = SurfaceQuery::new(&mesh).unwrap();
        let mut random = StdRng::seed_from_u64(seed);
        for p in points_about(&query.bounds(), 1.0, 1000) {
            let all = (0..mesh.triangles().len())
                .map(|t| closest_point_on_triangle(&p, &mesh.corners(t)).offset.norm_squared());
            let (triangle, least) = all.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            let closest = query.closest_point(&p);
            assert_eq!((closest.triangle, closest.distance), (triangle, least.sqrt()));
            assert!(((closest.point - p).norm() - closest.distance).abs() < 1e-14);
            // Nor does it matter where the search starts.
            let start = random.random_range(0..mesh.triangles().len() as u32);
            assert_eq!(query.describe(&p, query.nearest(&p, start)), closest);
        }
    }
}

#[test]
fn the_sign_is_that_of_the_exact_winding_number() {
    let near = shapes::deformed(&shapes::cube(1.0, 2), |p| p + Vector::new(1.0 + 1e-3, 0.0, 0.0));
    for (mesh, count) in [
        (shapes::cube(1.0, 1), 10_000),
        (shapes::double_torus(2), 10_000),
        (shapes::spherical_shell(1.0, 0.9, 2), 10_000),
        (shapes::joined(&shapes::cube(1.0, 2), &near), 10_000),
        (knife(1e-3), 10_000),
        (star(), 10_000),
    ] {
        assert_signs_agree(&mesh, count);
    }
}

#[test]
fn the_sign_is_right_on_scanned_models() {
    for name in [
        "surfaces/kitten_g1_9k.obj",
        "surfaces/three_holes_g3_uv_2k.obj",
        "surfaces/goathead_2k8.obj",
    ] {
        let Some(mesh) = test_models::load(name) else { return };
        assert_signs_agree(&mesh, 300);
    }
}

/// Thin triangles, doubled vertices and pinches leave pseudonormals undecided; the winding number steps in.
#[test]
fn the_sign_survives_thin_triangles_doubled_vertices_and_touching_parts() {
    let cube = shapes::cube(1.0, 2);
    let soup = {
        let corners = (0..cube.triangles().len()).flat_map(|t| cube.corners(t)).collect();
        let triangles = (0..cube.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        SurfaceMesh::new(corners, triangles.collect()).unwrap()
    };
    let shifted = |x, y| shapes::deformed(&cube, |p| p + Vector::new(x, y, 0.0));
    let wall = shapes::joined(&cube, &shifted(1.0, 0.0));
    let edge = shapes::joined(&cube, &shifted(1.0, 1.0));
    for mesh in [
        with_a_thin_triangle(&cube),
        with_a_thin_triangle(&tetrahedron()),
        soup,
        wall,
        edge,
    ] {
        assert_signs_agree(&mesh, 4000);
    }
}

#[test]
fn the_winding_sign_holds_where_balls_overlap() {
    let ball = shapes::sphere(1.0, 3);
    let other = shapes::deformed(&ball, |p| p + Vector::new(1.2, 0.0, 0.0));
    let query = SurfaceQuery::with_winding_sign(&shapes::joined(&ball, &other)).unwrap();
    for p in points_about(&query.bounds(), 0.1, 3000) {
        let (a, b) = (p.coords.norm(), (p - Point::new(1.2, 0.0, 0.0)).norm());
        // Where the inscribed mesh and the ball agree: sides of 0.16 leave 0.16² / 4.
        if (a - 1.0).abs() > 0.01 && (b - 1.0).abs() > 0.01 {
            assert_eq!(query.contains(&p), a < 1.0 || b < 1.0, "{p}");
            assert_eq!(query.signed_distance(&p) < 0.0, a < 1.0 || b < 1.0, "{p}");
        }
    }
}

#[test]
fn points_on_corners_and_edges_are_at_no_distance() {
    let mesh = shapes::double_torus(2);
    let query = SurfaceQuery::new(&mesh).unwrap();
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let [a, b, _] = mesh.corners(t);
        let closest = query.closest_point(&a);
        assert_eq!((closest.point, closest.distance), (a, 0.0));
        let Feature::Corner(k) = closest.feature else {
            panic!("{closest:?}")
        };
        assert_eq!(mesh.triangles()[closest.triangle][k as usize], triangle[0]);
        assert_eq!(query.signed_distance(&a), 0.0);
        let middle = nalgebra::center(&a, &b);
        assert!(query.signed_distance(&middle).abs() < 1e-15);
    }
}

#[test]
fn batches_give_what_single_queries_give() {
    let mesh = shapes::torus(1.0, 0.4, 50, 30);
    let query = SurfaceQuery::new(&mesh).unwrap();
    let points = points_about(&query.bounds(), 0.2, 3000);
    let signed: Vec<f64> = points.iter().map(|p| query.signed_distance(p)).collect();
    assert_eq!(query.signed_distances(&points), signed);
    assert_eq!(
        query.contains_all(&points),
        signed.iter().map(|d| *d < 0.0).collect::<Vec<_>>()
    );
    assert_eq!(
        query.contains_all(&points),
        points.iter().map(|p| query.contains(p)).collect::<Vec<_>>()
    );
    let closest: Vec<_> = points.iter().map(|p| query.closest_point(p)).collect();
    assert_eq!(query.closest_points(&points), closest);
}

#[test]
fn inside_of_an_open_surface_is_told_by_its_winding_number() {
    let whole = shapes::sphere(1.0, 3);
    let most = whole.triangles()[10..].to_vec();
    let open = SurfaceMesh::new(whole.vertices().to_vec(), most).unwrap();
    let query = SurfaceQuery::new(&open).unwrap();
    assert!(query.sides.is_none());
    for p in points_about(&query.bounds(), 0.2, 2000)
        .iter()
        .filter(|p| (p.coords.norm() - 1.0).abs() > 0.3)
    {
        assert_eq!(query.contains(p), p.coords.norm() < 1.0);
    }
}

#[test]
fn points_that_are_not_finite_and_huge_surfaces_do_no_harm() {
    let query = SurfaceQuery::new(&shapes::cube(1.0, 1)).unwrap();
    let nan = Point::new(f64::NAN, 0.0, 0.0);
    assert!(query.signed_distance(&nan).is_nan() && query.closest_point(&nan).distance.is_nan());
    assert!(!query.contains(&nan));
    let far = Point::new(0.0, f64::INFINITY, 0.0);
    assert_eq!(query.signed_distance(&far), f64::INFINITY);
    assert!(!query.contains(&far));
    for size in [1e-200, 1e200, f64::MAX] {
        let query = SurfaceQuery::new(&shapes::cube(size, 2)).unwrap();
        let _ = (
            query.signed_distance(&Point::origin()),
            query.contains(&Point::new(size, 0.0, 0.0)),
        );
    }
}

/// Two balls that overlap, apart from a third, and a shell: what the union of the balls and the cavity say.
#[test]
fn balls_are_outside_when_clear_of_the_surface_and_of_winding_number_zero() {
    let moved = |x: f64| shapes::deformed(&shapes::sphere(1.0, 4), |p| p + Vector::x() * x);
    let mesh = shapes::joined(&shapes::joined(&moved(0.0), &moved(1.2)), &moved(4.0));
    let shell = shapes::deformed(&shapes::spherical_shell(1.0, 0.5, 4), |p| p - Vector::x() * 4.0);
    let query = SurfaceQuery::new(&shapes::joined(&mesh, &shell)).unwrap();
    let mut random = StdRng::seed_from_u64(SEED);
    let points = points_about(&query.bounds(), 0.1, 20_000);
    let balls: Vec<(Point, f64)> = points.iter().map(|&p| (p, random.random_range(0.01..0.3))).collect();
    let (mut inside, mut blocked, mut outside) = (0, 0, 0);
    for (&(p, radius), found) in balls.iter().zip(query.are_outside(&balls)) {
        // The meshes lie within 0.002 of their spheres.
        let gaps = [0.0, 1.2, 4.0, -4.0].map(|x| ((p - Point::new(x, 0.0, 0.0)).norm(), 1.0));
        let in_cavity = gaps[3].0 < 0.5;
        let clearance = gaps
            .iter()
            .map(|(d, r)| (d - r).abs())
            .fold((gaps[3].0 - 0.5).abs(), f64::min);
        if (clearance - radius).abs() < 0.005 {
            continue;
        }
        let within = gaps.iter().any(|(d, r)| d < r) && !in_cavity;
        assert_eq!(found, !within && clearance > radius, "{p} {radius}");
        inside += usize::from(within && clearance > radius);
        blocked += usize::from(clearance < radius);
        outside += usize::from(found);
    }
    assert!(
        inside > 500 && blocked > 500 && outside > 500,
        "{inside} {blocked} {outside}"
    );
    let nowhere = [
        (Point::new(f64::NAN, 0.0, 0.0), 0.1),
        (Point::new(f64::INFINITY, 0.0, 0.0), 0.1),
    ];
    assert_eq!(query.are_outside(&nowhere), [false; 2]);
}

#[test]
fn refuses_surfaces_without_triangles_or_with_non_finite_corners() {
    assert_eq!(
        SurfaceQuery::new(&SurfaceMesh::default()).unwrap_err(),
        QueryError::Empty
    );
    let mut mesh = shapes::cube(1.0, 1);
    let vertex = mesh.triangles()[5][1];
    let triangle = mesh.triangles().iter().position(|t| t.contains(&vertex)).unwrap();
    let mut vertices = mesh.vertices().to_vec();
    vertices[vertex as usize].y = f64::NAN;
    mesh = mesh.with_vertices(vertices).unwrap();
    assert_eq!(
        SurfaceQuery::new(&mesh).unwrap_err(),
        QueryError::NonFinite { vertex, triangle }
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

    /// Coordinates stay below 40, so that rounding leaves 1e-14 times a few tens.
    #[test]
    fn distances_turn_move_and_grow_with_the_surface(
        axis in prop::array::uniform3(-1.0..1.0f64), angle in 0.0..6.0f64,
        shift in prop::array::uniform3(-9.0..9.0f64), scale in 0.1..10.0f64,
    ) {
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(Vector::from(axis)), angle);
        let moved = |p: &Point| Point::from((turn * p).coords * scale + Vector::from(shift));
        let mesh = shapes::double_torus(1);
        let query = SurfaceQuery::new(&mesh).unwrap();
        let other = SurfaceQuery::new(&shapes::deformed(&mesh, moved)).unwrap();
        for p in points_about(&query.bounds(), 0.3, 100) {
            let (here, there) = (query.signed_distance(&p) * scale, other.signed_distance(&moved(&p)));
            prop_assert!((here - there).abs() < 1e-12);
        }
    }
}

fn assert_signs_agree(mesh: &SurfaceMesh, count: usize) {
    let query = SurfaceQuery::new(mesh).unwrap();
    assert!(query.sides.is_some());
    for p in points_about(&query.bounds(), 0.1, count) {
        let exact = winding_number(mesh, &p);
        assert!((exact - exact.round()).abs() < 1e-9, "{p} is on the surface");
        let fast = query.winding_number(&p);
        assert!((fast - exact).abs() < 0.1, "{fast} for {exact} at {p}");
        let signed = query.signed_distance(&p);
        assert_eq!(signed < 0.0, exact > 0.5, "{signed} for {exact} at {p}");
        assert_eq!(query.contains(&p), exact > 0.5, "{p}");
    }
}

/// Random points in a box larger than `bounds` on each side by the fraction `beyond` of its extent.
fn points_about(bounds: &Aabb, beyond: f64, count: usize) -> Vec<Point> {
    let mut random = StdRng::seed_from_u64(SEED);
    let mut coordinate = |e: f64| e * random.random_range(-beyond..1.0 + beyond);
    (0..count)
        .map(|_| bounds.low + bounds.extent().map(&mut coordinate))
        .collect()
}

fn random_soup(seed: u64, triangles: u32) -> SurfaceMesh {
    let mut random = StdRng::seed_from_u64(seed);
    let mut vector = |size: f64| Vector::from_fn(|_, _| random.random_range(-size..size));
    let vertices = (0..triangles)
        .flat_map(|_| {
            let centre = Point::from(vector(1.0));
            [0.2, 0.01, 0.3].map(|size| centre + vector(size))
        })
        .collect();
    SurfaceMesh::new(
        vertices,
        (0..triangles).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    )
    .unwrap()
}

/// A wedge whose edge has a thickness of this order: the normals on its two sides are almost opposite.
fn knife(thickness: f64) -> SurfaceMesh {
    shapes::deformed(&shapes::cube(2.0, 1), |p| {
        Point::new(p.x, p.y, p.z * if p.x > 0.0 { thickness / 9.0 } else { thickness })
    })
}

/// All edges sharper than a right angle.
fn tetrahedron() -> SurfaceMesh {
    let vertices = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Point::from);
    SurfaceMesh::new(vertices.to_vec(), vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]).unwrap()
}

/// A ball with spikes and pits: corners where the surface is neither convex nor concave.
fn star() -> SurfaceMesh {
    let mut random = StdRng::seed_from_u64(SEED);
    let ball = shapes::sphere(1.0, 2);
    let vertices = ball
        .vertices()
        .iter()
        .map(|p| p * random.random_range(0.2..1.0))
        .collect();
    ball.with_vertices(vertices).unwrap()
}

/// One edge is split on one side only; a triangle without area fills the slit.
fn with_a_thin_triangle(mesh: &SurfaceMesh) -> SurfaceMesh {
    let (mut vertices, mut triangles) = mesh.clone().into_parts();
    let [a, b, c] = triangles[0];
    let middle = vertices.len() as u32;
    vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
    triangles[0] = [a, middle, c];
    triangles.extend([[middle, b, c], [a, b, middle]]);
    SurfaceMesh::new(vertices, triangles).unwrap()
}
