use std::collections::HashMap;

use super::*;
use crate::fit::{FitOptions, fit};
use crate::geometry::SurfaceQuery;
use crate::mesh::shapes;
use crate::sampling::held_out;
use crate::spherical::testing::{graded_spindle, radial_embedding};

#[test]
fn is_linear_over_triangles_and_exact_at_corners() {
    let domain = shapes::cube(2.0, 2);
    let stretched = shapes::deformed(&domain, |p| Point::new(3.0 * p.x, p.y - 1.0, p.z));
    let map = BoundaryMap::between(domain, &stretched).unwrap();
    let points = [
        SurfacePoint::corner(5, 2),
        SurfacePoint {
            triangle: 7,
            barycentric: [0.2, 0.3, 0.5],
        },
    ];
    for (x, y) in map.positions(&points).iter().zip(map.evaluate(&points)) {
        assert!((Point::new(3.0 * x.x, x.y - 1.0, x.z) - y).norm() < 1e-15);
    }
}

#[test]
fn rejects_what_does_not_correspond() {
    let domain = shapes::cube(1.0, 2);
    let finer = shapes::cube(1.0, 3);
    assert!(matches!(
        BoundaryMap::between(domain.clone(), &finer),
        Err(BoundaryMapError::VertexCount { domain: 26, image: 56 })
    ));
    let mut triangles = domain.triangles().to_vec();
    triangles.swap(3, 4);
    let shuffled = SurfaceMesh::new(domain.vertices().to_vec(), triangles).unwrap();
    assert!(matches!(
        BoundaryMap::between(domain.clone(), &shuffled),
        Err(BoundaryMapError::Connectivity { index: 3, .. })
    ));
    let mut image = domain.vertices().to_vec();
    image[7].y = f64::NAN;
    assert!(matches!(
        BoundaryMap::new(domain.clone(), image),
        Err(BoundaryMapError::NonFinite { vertex: 7, .. })
    ));
    let point = vec![Point::origin(); 26];
    assert!(matches!(
        BoundaryMap::new(domain, point),
        Err(BoundaryMapError::NoExtent { vertices: 26 })
    ));
}

#[test]
fn accepts_an_image_with_reversed_triangles() {
    let domain = shapes::sphere(1.0, 1);
    assert!(BoundaryMap::between(domain.clone(), &domain.reversed()).is_ok());
}

const SEED: u64 = 3;

fn bumpy_to_cube() -> BoundaryMap {
    let [bumpy, cube] = [shapes::bumpy_sphere(14), shapes::cube(2.0, 9)].map(radial_embedding);
    BoundaryMap::through_sphere(bumpy, cube).unwrap()
}

/// Largest distance of points of the domain from their round trips, over the domain's diagonal.
fn round_trip(map: &BoundaryMap) -> f64 {
    let points = held_out(map.domain(), 3000, 3000, SEED);
    let on_target = map.evaluate_on_target(&points).unwrap();
    let back = map.inverse().unwrap().evaluate(&on_target);
    let pairs = map.positions(&points).into_iter().zip(back);
    pairs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max) / map.domain().diagonal()
}

/// The direction carries the rounding error of a unit vector, which over the length of a triangle's sides on the sphere
/// is that of the barycentric coordinates.
#[test]
fn the_inverse_returns_to_the_point() {
    assert!(round_trip(&bumpy_to_cube()) < 1e-13);
    assert!(round_trip(&bumpy_to_cube().inverse().unwrap()) < 1e-13);
    assert!(round_trip(&bumpy_to_cube().subdivided()) < 1e-13);
    // Heights of 0.02 and 4e-7 on the sphere.
    let small = |power| {
        BoundaryMap::through_sphere(graded_spindle(power, 12), radial_embedding(shapes::sphere(1.0, 3))).unwrap()
    };
    assert!(round_trip(&small(1.5)) < 1e-12);
    assert!(round_trip(&small(6.0)) < 1e-9);
    let both = BoundaryMap::through_sphere(graded_spindle(6.0, 12), graded_spindle(6.0, 10)).unwrap();
    assert!(round_trip(&both) < 1e-9);
}

#[test]
fn images_between_vertices_lie_on_the_target_and_not_on_straight_triangles() {
    let map = bumpy_to_cube();
    let points = held_out(map.domain(), 2000, 2000, SEED);
    let images = map.evaluate(&points);
    let on_target = SurfaceQuery::new(map.target_surface().unwrap()).unwrap();
    let farthest = |query: &SurfaceQuery| {
        let found = query.closest_points(&images);
        found.iter().map(|c| c.distance).fold(0.0, f64::max)
    };
    assert!(farthest(&on_target) < 1e-14);
    assert!(farthest(&SurfaceQuery::new(&map.target()).unwrap()) > 0.01);

    let onto = BoundaryMap::onto_sphere(radial_embedding(shapes::cube(2.0, 4))).unwrap();
    let points = held_out(onto.domain(), 500, 500, SEED);
    for (p, image) in onto.positions(&points).iter().zip(onto.evaluate(&points)) {
        assert!((image.coords.norm() - 1.0).abs() < 1e-15);
        // The image is the radial projection at vertices only, and near it elsewhere.
        assert!((image.coords - p.coords.normalize()).norm() < 0.1);
    }
    assert_eq!(onto.image()[5].coords, onto.domain_embedding().unwrap().directions()[5]);
    assert!(onto.target_surface().is_none() && onto.inverse().is_none());
    assert!((onto.target_volume() - 4.18879).abs() < 1e-5 && (onto.target_diagonal() - 12f64.sqrt()).abs() < 1e-15);
}

#[test]
fn a_surface_goes_to_itself_and_common_directions_are_met_exactly() {
    let bumpy = radial_embedding(shapes::bumpy_sphere(9));
    let map = BoundaryMap::through_sphere(bumpy.clone(), bumpy).unwrap();
    assert_eq!(map.image(), map.domain().vertices());
    let points = held_out(map.domain(), 2000, 2000, SEED);
    for (p, image) in map.positions(&points).iter().zip(map.evaluate(&points)) {
        assert!((p - image).norm() < 1e-13);
    }
    let corners: Vec<_> = (0..20).map(|t| SurfacePoint::corner(t, t as usize % 3)).collect();
    assert_eq!(map.positions(&corners), map.evaluate(&corners));

    // The cube's corners, at which neither surface has anything else in common.
    let cube = radial_embedding(shapes::cube(2.0, 2));
    let corner = cube
        .surface()
        .vertices()
        .iter()
        .position(|p| p.x > 0.9 && p.y > 0.9 && p.z > 0.9)
        .unwrap();
    let sphere = shapes::sphere(1.0, 3);
    let mut directions: Vec<Vector> = sphere.vertices().iter().map(|p| p.coords).collect();
    let near = (0..directions.len()).max_by(|&i, &j| {
        let along = |i: usize| directions[i].dot(&cube.directions()[corner]);
        along(i).total_cmp(&along(j))
    });
    directions[near.unwrap()] = cube.directions()[corner];
    let pinned = SphericalEmbedding::new(sphere, &directions).unwrap();
    let expected = cube.surface().vertices()[corner];
    let map = BoundaryMap::through_sphere(pinned, cube).unwrap();
    assert_eq!(map.image()[near.unwrap()], expected);
}

#[test]
fn neighbours_agree_on_the_edge_they_share() {
    for map in [bumpy_to_cube(), bumpy_to_cube().subdivided()] {
        let mut sides = HashMap::new();
        for (t, corners) in map.domain().triangles().iter().enumerate() {
            for k in 0..3 {
                sides.insert((corners[k], corners[(k + 1) % 3]), (t as u32, k));
            }
        }
        let on_side = |(triangle, k): (u32, usize), part: f64| {
            let mut barycentric = [0.0; 3];
            (barycentric[k], barycentric[(k + 1) % 3]) = (1.0 - part, part);
            SurfacePoint { triangle, barycentric }
        };
        for (&(a, b), &side) in &sides {
            let pair = [on_side(side, 0.3), on_side(sides[&(b, a)], 0.7)];
            let images = map.evaluate(&pair);
            assert!((images[0] - images[1]).norm() < 1e-13, "{a} {b}");
        }
    }
}

#[test]
fn subdivision_changes_no_image_and_carries_midpoints_onto_the_target() {
    let map = bumpy_to_cube();
    let finer = map.subdivided().subdivided();
    let old = map.image().len();
    assert_eq!(&finer.image()[..old], map.image());
    let points = held_out(finer.domain(), 2000, 2000, SEED);
    let query = SurfaceQuery::new(map.domain()).unwrap();
    let on_coarse = |c: crate::geometry::ClosestPoint| c.surface_point();
    let coarse: Vec<_> = query
        .closest_points(&finer.positions(&points))
        .into_iter()
        .map(on_coarse)
        .collect();
    for (p, q) in map.evaluate(&coarse).iter().zip(finer.evaluate(&points)) {
        assert!((p - q).norm() < 1e-12);
    }
    let target = SurfaceQuery::new(map.target_surface().unwrap()).unwrap();
    assert!(target.closest_points(finer.image()).iter().all(|c| c.distance < 1e-14));
    assert_eq!(finer.inverse().unwrap().target_surface(), Some(map.domain()));
}

#[test]
fn over_accepts_the_same_domain_only() {
    let map = bumpy_to_cube();
    assert_eq!(map.over(map.domain().clone()).unwrap(), map);
    let difference = |domain: SurfaceMesh| match map.over(domain) {
        Err(BoundaryMapError::OtherDomain { difference }) => difference,
        other => panic!("{other:?}"),
    };
    assert!(difference(shapes::bumpy_sphere(3)).contains("1962 vertices"));
    let moved = shapes::deformed(map.domain(), |p| if p.x > 1.0 { p + Vector::x() } else { *p });
    assert!(difference(moved).starts_with("vertex "));
    assert!(difference(map.domain().reversed()).contains("outward"));
    let straight = BoundaryMap::new(shapes::cube(1.0, 2), shapes::cube(2.0, 2).vertices().to_vec()).unwrap();
    assert!(straight.over(shapes::cube(1.0, 2).reversed()).is_ok());
}

#[test]
fn out_of_scale_surfaces_are_refused() {
    let sized = |size: f64| radial_embedding(shapes::sphere(size, 1));
    assert!(matches!(
        BoundaryMap::through_sphere(sized(1.0), sized(1e101)),
        Err(BoundaryMapError::OutOfScale { solid: "target", .. })
    ));
    assert!(matches!(
        BoundaryMap::onto_sphere(sized(1e-101)),
        Err(BoundaryMapError::OutOfScale { solid: "domain", .. })
    ));
}

#[test]
fn a_fit_meets_the_curved_target_and_not_the_straight_triangles() {
    let ellipsoid = shapes::deformed(&shapes::geodesic_sphere(1.0, 24), |p| {
        Point::new(1.5 * p.x, p.y, 0.8 * p.z)
    });
    let map =
        BoundaryMap::through_sphere(radial_embedding(shapes::sphere(1.0, 2)), radial_embedding(ellipsoid)).unwrap();
    let options = FitOptions {
        tolerance: 2e-3,
        ..FitOptions::default()
    };
    let fitted = fit(&map, &options, &|_| {}).unwrap();
    assert!(
        fitted.report.boundary_error.p99 < 2e-3,
        "{:?}",
        fitted.report.boundary_error
    );
    assert_eq!(fitted.boundary, map);
    let straight = BoundaryMap::new(map.domain().clone(), map.image().to_vec()).unwrap();
    let points = held_out(map.domain(), 500, 500, SEED);
    let pairs = map.evaluate(&points).into_iter().zip(straight.evaluate(&points));
    let apart = pairs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
    assert!(apart > 0.01, "{apart}");
}
