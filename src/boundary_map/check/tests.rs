use super::composition::MOST_CUTS;
use super::*;
use crate::mesh::shapes;
use crate::spherical::SphericalEmbedding;
use crate::spherical::testing::radial_embedding;
use crate::worst_places::PlaceKind;
use crate::{Point, Vector};

fn map(domain: &SurfaceMesh, f: impl Fn(&Point) -> Point) -> BoundaryMap {
    BoundaryMap::new(domain.clone(), domain.vertices().iter().map(f).collect()).unwrap()
}

fn checked(map: &BoundaryMap, target: Option<&SurfaceMesh>) -> BoundaryCheck {
    check(map, target, &BoundaryCheckOptions::default(), None).unwrap()
}

fn has(report: &BoundaryCheck, kind: MapFindingKind) -> bool {
    report.findings.iter().any(|finding| finding.kind == kind)
}

fn radially(p: &Point) -> Point {
    Point::from(p.coords.normalize() * 3.0 + Vector::new(5.0, -1.0, 0.5))
}

#[test]
fn a_radial_projection_is_one_to_one_with_the_sphere() {
    let report = checked(&map(&shapes::bumpy_sphere(8), radially), None);
    assert_eq!(
        (report.verdict, report.flipped, report.degenerate),
        (BijectivityVerdict::Bijective, 0, 0)
    );
    assert_eq!(report.degree.unwrap().value, 1);
    let ComparedWith::Sphere { centre, radius } = report.compared_with else {
        panic!("{report}");
    };
    assert!((Point::from(centre) - Point::new(5.0, -1.0, 0.5)).norm() < 1e-9 && (radius - 3.0).abs() < 1e-9);
    assert!(report.findings.is_empty(), "{report}");
}

#[test]
fn a_vertex_pulled_over_its_ring_is_caught_on_the_sphere_on_a_target_and_by_itself() {
    let domain = shapes::bumpy_sphere(8);
    for (smooth, with_target) in [(true, false), (false, true), (false, false)] {
        let place = |p: &Point| if smooth { radially(p) } else { *p };
        let mut image: Vec<Point> = domain.vertices().iter().map(place).collect();
        // Past the farthest neighbour of a neighbour: to the centroid of a triangle two rings away.
        let ring: Vec<u32> = domain
            .triangles()
            .iter()
            .filter(|t| t.contains(&100))
            .flatten()
            .copied()
            .collect();
        let beyond = domain
            .triangles()
            .iter()
            .find(|t| t.iter().any(|v| ring.contains(v)) && t.iter().filter(|v| ring.contains(v)).count() == 1);
        let [a, b, c] = beyond.unwrap().map(|v| image[v as usize].coords);
        image[100] = Point::from((a + b + c) / 3.0);
        if smooth {
            let centre = Point::new(5.0, -1.0, 0.5);
            image[100] = centre + (image[100] - centre).normalize() * 3.0;
        }
        let folded = BoundaryMap::new(domain.clone(), image).unwrap();
        let report = checked(&folded, with_target.then_some(&domain));
        assert_eq!(report.verdict, BijectivityVerdict::NotBijective, "{report}");
        assert!(
            has(&report, MapFindingKind::Flipped) && (1..8).contains(&report.flipped),
            "{report}"
        );
        assert_eq!(report.degree.unwrap().value, 1, "{report}");
        assert!(report.folded_edges > 0);
        let faces = &report
            .findings
            .iter()
            .find(|f| f.kind == MapFindingKind::Flipped)
            .unwrap()
            .faces;
        assert!(
            faces.iter().all(|&t| domain.triangles()[t as usize].contains(&100)),
            "{report}"
        );
    }
}

#[test]
fn identity_on_solids_of_any_genus_is_found_without_defect() {
    let solids = [
        shapes::torus(1.0, 0.4, 24, 10),
        shapes::double_torus(2),
        shapes::spherical_shell(1.0, 0.4, 2),
        shapes::bumpy_sphere(6),
    ];
    for domain in solids {
        for target in [None, Some(&domain)] {
            let report = checked(&map(&domain, |p| *p), target);
            assert_eq!(report.verdict, BijectivityVerdict::NoDefectFound, "{report}");
            assert_eq!(report.degree.unwrap().value, 1);
            assert!(
                report
                    .coverage
                    .is_none_or(|c| c.hausdorff() < 1e-14 && c.image_to_target.max_error < 1e-14)
            );
            assert!((report.distortion.unwrap().length.max - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn a_torus_turned_along_itself_covers_a_finer_torus_once() {
    let domain = shapes::torus(1.0, 0.4, 90, 40);
    let target = shapes::torus(1.0, 0.4, 120, 60);
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector::z_axis(), 0.7);
    let report = checked(&map(&domain, |p| turn * p), Some(&target));
    assert_eq!(
        (report.verdict, report.flipped),
        (BijectivityVerdict::NoDefectFound, 0),
        "{report}"
    );
    assert_eq!(report.degree.unwrap().value, 1);
    let distance = report.coverage.unwrap().hausdorff();
    // Chords of 1.4 (2π/90) and 0.4 (2π/40) leave gaps of c²/8R each at most; the diagonal is 4.04.
    assert!(distance > 1e-5 && distance < 2.0 * (0.0977f64.powi(2) / 11.2 + 0.0628f64.powi(2) / 3.2) / 4.04);
}

#[test]
fn mirror_images_are_flagged_but_none_of_their_triangles() {
    let domain = shapes::bumpy_sphere(6);
    let mirrored = |p: &Point| Point::new(-p.x, p.y, p.z);
    let target = map(&domain, mirrored).target();
    for (f, target) in [
        (&mirrored as &dyn Fn(&Point) -> Point, Some(&target)),
        (&mirrored, None),
        (&|p: &Point| mirrored(&radially(p)), None),
    ] {
        let report = checked(&map(&domain, f), target);
        assert_eq!(report.degree.unwrap().value, -1, "{report}");
        assert!(
            has(&report, MapFindingKind::Mirrored) && report.findings.len() == 1,
            "{report}"
        );
        assert_ne!(report.verdict, BijectivityVerdict::NotBijective);
    }
}

/// Longitudes are doubled: the sphere is covered twice, branching at the poles.
fn doubled(p: &Point) -> Point {
    let (angle, reach) = (2.0 * p.y.atan2(p.x), p.x.hypot(p.y));
    Point::new(reach * angle.cos(), reach * angle.sin(), p.z)
}

#[test]
fn a_double_cover_has_degree_two() {
    let sphere = shapes::geodesic_sphere(1.0, 12);
    let report = checked(&map(&sphere, doubled), None);
    assert!(matches!(report.compared_with, ComparedWith::Sphere { .. }));
    assert_eq!(
        (report.degree.unwrap().value, report.verdict),
        (2, BijectivityVerdict::NotBijective)
    );
    let torus = shapes::torus(1.0, 0.4, 96, 24);
    for target in [None, Some(&shapes::torus(1.0, 0.4, 48, 24))] {
        let report = checked(&map(&torus, doubled), target);
        assert_eq!(report.degree.unwrap().value, 2, "{report}");
        assert!(has(&report, MapFindingKind::Degree) && report.flipped == 0, "{report}");
    }
}

#[test]
fn an_image_that_covers_half_is_caught() {
    let sphere = shapes::geodesic_sphere(1.0, 10);
    let domain = shapes::bumpy_sphere(10);
    let ellipsoid = shapes::deformed(&sphere, |p| Point::new(2.0 * p.x, p.y, p.z));
    let half = |p: &Point| {
        let unit = p.coords.normalize();
        Point::new(2.0 * unit.x, unit.y, unit.z.abs())
    };
    let report = checked(&map(&domain, half), Some(&ellipsoid));
    assert!(
        has(&report, MapFindingKind::NotCovered) && has(&report, MapFindingKind::Degree),
        "{report}"
    );
    assert!(!has(&report, MapFindingKind::OffTarget), "{report}");
    // The lowest point is √2 from the rim, over a diagonal of √24.
    let gap = report.coverage.unwrap().target_to_image;
    assert!((gap.max - (1.0 / 12f64).sqrt()).abs() < 1e-3, "{report}");
}

#[test]
fn the_hausdorff_distance_of_an_offset_is_the_offset() {
    let domain = shapes::geodesic_sphere(1.0, 20);
    let report = checked(&map(&domain, |p| p * 1.25), Some(&domain));
    let coverage = report.coverage.unwrap();
    let expected = 0.25 / domain.diagonal();
    for distance in [coverage.image_to_target, coverage.target_to_image] {
        // Chords of 1/18 rad at most cut off 1/2600.
        assert!(
            (distance.max - expected).abs() < 5e-4 / domain.diagonal(),
            "{distance:?}"
        );
        assert!(
            distance.max_error <= 2e-4 && (distance.rms / expected - 1.0).abs() < 2e-3,
            "{distance:?}"
        );
    }
    // All vertices of both lie on a sphere, but not on the same one.
    assert_eq!(report.compared_with, ComparedWith::Target);
    assert_eq!(
        report.degree.unwrap(),
        Degree {
            value: 1,
            agreement: 1.0,
            points: report.degree.unwrap().points
        }
    );
}

/// The largest distance is in the middle of a face, where no vertex is: a cube's face over the sphere's flat top.
#[test]
fn largest_distances_are_found_between_vertices() {
    let cube = shapes::cube(2.0, 1);
    let sphere = shapes::geodesic_sphere(3f64.sqrt(), 24);
    let query = |mesh: &SurfaceMesh| SurfaceQuery::new(mesh).unwrap();
    let options = BoundaryCheckOptions {
        samples: 10,
        ..Default::default()
    };
    let coverage = Coverage::measure((&cube, &query(&cube)), (&sphere, &query(&sphere)), &options);
    let expected = (3f64.sqrt() - 1.0) / sphere.diagonal();
    for distance in [coverage.image_to_target, coverage.target_to_image] {
        assert!((distance.max - expected).abs() < 5e-4, "{distance:?} {expected}");
        assert!(distance.max_error <= 2e-4, "{distance:?}");
    }
}

#[test]
fn flat_images_and_other_topologies_are_errors() {
    let torus = shapes::torus(1.0, 0.4, 24, 10);
    let ball = shapes::bumpy_sphere(6);
    let flat = checked(&map(&ball, |p| Point::new(p.x, 0.0, 0.0)), None);
    assert_eq!(flat.degenerate, ball.triangles().len());
    assert!(
        flat.distortion.is_none() && has(&flat, MapFindingKind::Degenerate),
        "{flat}"
    );
    let report = checked(&map(&torus, |p| *p), Some(&ball));
    let topology = report
        .findings
        .iter()
        .find(|f| f.kind == MapFindingKind::Topology)
        .unwrap();
    assert!(
        topology.message.contains("genus 1") && topology.message.contains("genus 0"),
        "{report}"
    );
}

#[test]
fn an_image_far_from_its_target_is_reported_as_such_and_not_as_folded() {
    let torus = shapes::torus(1.0, 0.4, 24, 10);
    let report = checked(&map(&torus, |p| p + Vector::new(0.0, 5.0, 0.0)), Some(&torus));
    assert_eq!(
        (report.compared_with, report.flipped),
        (ComparedWith::Itself, 0),
        "{report}"
    );
    assert_eq!(report.degree.unwrap().value, 1);
    assert!(has(&report, MapFindingKind::NotCovered) && has(&report, MapFindingKind::OffTarget));
    assert!(report.findings[0].advice.contains("another place"), "{report}");
}

#[test]
fn open_domains_have_no_degree_and_inward_ones_are_reversed() {
    let ball = shapes::bumpy_sphere(6);
    let open = SurfaceMesh::new(ball.vertices().to_vec(), ball.triangles()[1..].to_vec()).unwrap();
    let report = checked(&map(&open, |p| *p), Some(&ball));
    assert_eq!(
        (report.degree, report.verdict),
        (None, BijectivityVerdict::NotBijective),
        "{report}"
    );
    let report = checked(&map(&ball.reversed(), |p| *p), Some(&ball.reversed()));
    assert_eq!(
        (report.degree.unwrap().value, report.verdict),
        (1, BijectivityVerdict::NoDefectFound)
    );
}

#[test]
fn non_finite_coordinates_are_refused_with_the_vertex_named() {
    let ball = shapes::bumpy_sphere(3);
    let mut image = ball.vertices().to_vec();
    image[7].y = f64::NAN;
    let error = BoundaryMap::new(ball.clone(), image.clone()).unwrap_err();
    assert!(error.to_string().contains("vertex 7"), "{error}");
    let bad = SurfaceMesh::new(image, ball.triangles().to_vec()).unwrap();
    let from_bad = BoundaryMap::new(bad.clone(), ball.vertices().to_vec()).unwrap();
    let options = BoundaryCheckOptions::default();
    let error = check(&from_bad, None, &options, None).unwrap_err();
    assert!(matches!(
        error,
        BoundaryCheckError::Domain(QueryError::NonFinite { vertex: 7, .. })
    ));
    let error = check(&map(&ball, |p| *p), Some(&bad), &options, None).unwrap_err();
    assert!(
        error.to_string().contains("vertex 7") && error.to_string().contains("target"),
        "{error}"
    );
}

#[test]
fn the_report_is_the_same_on_any_number_of_threads() {
    let torus = shapes::torus(1.0, 0.4, 30, 12);
    let target = shapes::torus(1.02, 0.41, 40, 20);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| checked(&map(&torus, |p| *p), Some(&target)))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn self_intersections_come_from_the_given_function() {
    let ball = shapes::bumpy_sphere(3);
    let find = |_: &SurfaceMesh| Ok(vec![[3, 9], [3, 11]]);
    let report = check(&map(&ball, |p| *p), None, &BoundaryCheckOptions::default(), Some(&find)).unwrap();
    assert_eq!(report.verdict, BijectivityVerdict::Doubtful);
    assert_eq!(report.findings[0].faces, [3, 9, 11]);
    assert!(
        report
            .to_string()
            .contains("2 pairs of image triangles pass through each other"),
        "{report}"
    );
}

#[test]
fn a_map_through_the_sphere_is_decided_exactly_and_covers_its_target() {
    let [domain, target] = [shapes::bumpy_sphere(6), shapes::cube(2.0, 5)].map(radial_embedding);
    let map = BoundaryMap::through_sphere(domain, target).unwrap();
    for map in [map.subdivided(), map] {
        let report = checked(&map, None);
        assert_eq!(
            (report.verdict, report.compared_with),
            (BijectivityVerdict::Bijective, ComparedWith::Target)
        );
        assert_eq!((report.degree.unwrap().value, report.flipped), (1, 0));
        assert!(report.findings.is_empty(), "{report}");
        let composition = report.composition.as_ref().unwrap();
        assert!(composition.embeddings.len() == 2 && composition.embeddings.iter().all(|d| d.is_bijective()));
        // Rounding of coordinates and of barycentric coordinates in triangles of size 1/5.
        assert!(report.coverage.unwrap().hausdorff() < 1e-13, "{report}");
        assert!(
            composition.round_trip.max < 1e-13 && composition.round_trip.points > 20_000,
            "{report}"
        );
        assert!(report.to_string().contains("One to one with the target"), "{report}");
    }
}

/// A slab twisted by two turns: coarse triangles between its points face anywhere. It has the embedding of a ball.
#[test]
fn folds_of_the_plain_image_are_remarks_not_defects_of_the_map() {
    let ball = shapes::geodesic_sphere(1.0, 40);
    let directions: Vec<Vector> = ball.vertices().iter().map(|p| p.coords).collect();
    let twisted = shapes::deformed(&ball, |p| {
        let (sin, cos) = (6.0 * p.z).sin_cos();
        let (x, y) = (3.0 * p.x, 0.3 * p.y);
        Point::new(cos * x - sin * y, sin * x + cos * y, 2.0 * p.z)
    });
    let target = SphericalEmbedding::new(twisted, &directions).unwrap();
    let domain = radial_embedding(shapes::geodesic_sphere(1.0, 5));
    let map = BoundaryMap::through_sphere(domain, target).unwrap();
    let report = checked(&map, None);
    let turned = report.composition.as_ref().unwrap().plain_image_flipped;
    assert!(
        turned > 0 && report.verdict == BijectivityVerdict::Bijective && report.findings.is_empty(),
        "{report}"
    );
    assert!(report.to_string().contains("use the boundary file"), "{report}");
    let plain = BoundaryMap::new(map.domain().clone(), map.image().to_vec()).unwrap();
    let report = checked(&plain, map.target_surface());
    assert_eq!(
        (report.flipped, report.verdict),
        (turned, BijectivityVerdict::NotBijective),
        "{report}"
    );
}

#[test]
fn distortion_through_the_sphere_is_that_of_the_true_map() {
    let bumpy = radial_embedding(shapes::bumpy_sphere(5));
    let map = BoundaryMap::through_sphere(bumpy.clone(), bumpy).unwrap();
    let report = checked(&map, None);
    assert_eq!(report.composition.as_ref().unwrap().cuts, MOST_CUTS);
    assert!((report.distortion.unwrap().length.max - 1.0).abs() < 1e-9, "{report}");
    // From the cube onto the sphere, areas at distance r from the centre change by 1/r³, and by 0.52 in the mean: in
    // the middle of a face by 1.9 times the mean, if the triangles are small enough to resolve it.
    let map = BoundaryMap::onto_sphere(radial_embedding(shapes::cube(2.0, 1))).unwrap();
    let report = checked(&map, None);
    assert_eq!(report.verdict, BijectivityVerdict::Bijective);
    assert!(report.coverage.is_none() && report.composition.as_ref().unwrap().embeddings.len() == 1);
    let straight = BoundaryMap::new(map.domain().clone(), map.image().to_vec()).unwrap();
    let straight = checked(&straight, None).distortion.unwrap();
    assert!(
        straight.area.max < 1.0 + 1e-12 && report.distortion.unwrap().area.max > 1.8,
        "{report}"
    );
}

#[test]
fn a_given_target_is_compared_with_the_surface_that_is_mapped_to() {
    let [domain, target] = [shapes::bumpy_sphere(5), shapes::cube(2.0, 4)].map(radial_embedding);
    let map = BoundaryMap::through_sphere(domain, target).unwrap();
    let report = checked(&map, Some(&shapes::cube(2.0, 1)));
    assert!(
        report.verdict == BijectivityVerdict::Bijective && report.coverage.unwrap().hausdorff() < 1e-13,
        "{report}"
    );
    let report = checked(&map, Some(&shapes::cube(3.0, 1)));
    assert!(
        has(&report, MapFindingKind::NotCovered) && report.verdict == BijectivityVerdict::NotBijective,
        "{report}"
    );
    let ball = BoundaryMap::onto_sphere(radial_embedding(shapes::bumpy_sphere(5))).unwrap();
    let report = checked(&ball, Some(&shapes::geodesic_sphere(1.0, 30)));
    assert!(
        report.findings.is_empty() && report.coverage.unwrap().hausdorff() < 0.01,
        "{report}"
    );
}

/// A triangle without area in the domain is no triangle of the map that could be inverted.
#[test]
fn a_mirrored_map_is_not_blamed_for_a_flat_triangle_of_its_domain() {
    let (mut vertices, mut triangles) = shapes::cube(1.0, 4).into_parts();
    // A vertex in the middle of an edge, and the flat triangle between its halves.
    let [a, b, c] = triangles[0];
    let other = triangles
        .iter()
        .position(|t| *t != [a, b, c] && t.contains(&a) && t.contains(&b));
    let middle = vertices.len() as u32;
    vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
    triangles[0] = [a, middle, c];
    triangles.push([middle, b, c]);
    triangles.push([a, b, middle]);
    assert!(other.is_some());
    let domain = SurfaceMesh::new(vertices, triangles).unwrap();
    let mirrored = map(&domain, |p| Point::new(-p.x, p.y, p.z));
    let target = shapes::cube(1.0, 4);
    let report = checked(&mirrored, Some(&target));
    assert_eq!(report.flat_in_domain, 1, "{report}");
    assert!(has(&report, MapFindingKind::Mirrored), "{report}");
    assert!(!has(&report, MapFindingKind::Flipped), "{report}");
    assert!(report.worst_places.iter().all(|place| place.kind != PlaceKind::Flipped));
}

/// Two folds far from each other, one of more triangles.
#[test]
fn flipped_triangles_are_listed_by_place_the_largest_first() {
    let domain = shapes::sphere(1.0, 3);
    let mut image = domain.vertices().to_vec();
    // Points near the two poles are reflected in a plane through the pole: their triangles turn over.
    for (vertex, place) in domain.vertices().iter().zip(&mut image) {
        if vertex.z > 0.9 || vertex.z < -0.97 {
            place.x = -place.x;
        }
    }
    let folded = BoundaryMap::new(domain.clone(), image).unwrap();
    let report = checked(&folded, Some(&domain));
    let flipped: Vec<_> = report
        .worst_places
        .iter()
        .filter(|place| place.kind == PlaceKind::Flipped)
        .collect();
    assert!(flipped.len() >= 2, "{report}");
    assert!(flipped[0].centre[2] > 0.8 && flipped[1].centre[2] < -0.8, "{flipped:?}");
    assert!(flipped[0].count > flipped[1].count && flipped[0].share > flipped[1].share);
    assert!(report.to_string().contains("worst places"), "{report}");
    let few = BoundaryCheckOptions {
        worst_places: 1,
        ..Default::default()
    };
    assert_eq!(
        check(&folded, Some(&domain), &few, None).unwrap().worst_places,
        [*flipped[0]]
    );
}

/// One bump of a sphere is stretched.
#[test]
fn the_most_distorted_place_is_found_on_a_map_without_defects() {
    let domain = shapes::sphere(1.0, 4);
    let stretched = map(&domain, |p| {
        let near = (-((p - Point::new(1.0, 0.0, 0.0)).norm_squared() / 0.05)).exp();
        Point::from(p.coords * (1.0 + 0.6 * near))
    });
    let report = checked(&stretched, None);
    let worst = report.worst_places[0];
    assert_eq!(worst.kind, PlaceKind::Distortion, "{report}");
    assert!(
        worst.centre[0] > 0.8 && worst.share < 0.011 && worst.value.unwrap() > 4.0,
        "{worst:?}"
    );
    assert!(
        report
            .worst_places
            .windows(2)
            .all(|pair| pair[0].value >= pair[1].value)
    );
}
