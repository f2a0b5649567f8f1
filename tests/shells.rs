//! Maps between solids of several shells: components and cavities are matched, and each is mapped one to one.

use nalgebra::Rotation3;
use solidmap::boundary_map::check::{BijectivityVerdict, BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{Landmarks, PairError, PairMethod, PairOptions, PairReport, map_pair};
use solidmap::boundary_map::{BoundaryMap, BoundaryMapError, ShellMap};
use solidmap::check::ShellsError;
use solidmap::files::{BoundaryFile, BoundaryMetadata, read_boundary, write_boundary};
use solidmap::fit::{FitOptions, fit};
use solidmap::map::VolumeMap;
use solidmap::mesh::shapes::{deformed, joined};
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::{Point, Vector};

fn ball(centre: [f64; 3], radii: [f64; 3]) -> SurfaceMesh {
    let radii = Vector::from(radii);
    deformed(&shapes::sphere(1.0, 2), |p| {
        Point::from(p.coords.component_mul(&radii) + Vector::from(centre))
    })
}

fn joined_all(parts: &[SurfaceMesh]) -> SurfaceMesh {
    parts
        .iter()
        .skip(1)
        .fold(parts[0].clone(), |whole, part| joined(&whole, part))
}

/// A smooth deformation that moves points by up to a fifth, and a turn.
fn bent_and_turned(p: &Point) -> Point {
    let bent = Vector::new(
        1.2 * p.x + 0.1 * p.y * p.y,
        p.y + 0.1 * p.x * p.z,
        0.9 * p.z - 0.1 * p.x * p.x,
    );
    Rotation3::from_euler_angles(0.5, -0.8, 1.9) * Point::from(bent)
}

fn mapped(domain: &SurfaceMesh, target: &SurfaceMesh) -> (BoundaryMap, PairReport) {
    let (map, report) = map_pair(domain, target, &PairOptions::default(), &|_| ()).unwrap();
    let checked = check(&map, Some(target), &BoundaryCheckOptions::default(), None).unwrap();
    assert_eq!(checked.verdict, BijectivityVerdict::Bijective, "{checked}");
    let round_trip = checked.composition.unwrap().round_trip;
    assert!(round_trip.max < 1e-9, "{round_trip:?}");
    assert!(!report.looks_wrong(), "{report:?}");
    (map, report)
}

/// The largest distance from the true images, over the target's diagonal.
fn error(map: &BoundaryMap, truth: impl Fn(&Point) -> Point) -> f64 {
    let true_images: Vec<Point> = map.domain().vertices().iter().map(truth).collect();
    crate::common::largest_distance(map.image(), &true_images) / map.target_diagonal()
}

/// A lumpy solid with two cavities and a solid ball in one of them.
fn hollow() -> Vec<SurfaceMesh> {
    let outer = deformed(&shapes::bumpy_sphere(14), |p| {
        Point::new(1.4 * p.x + 0.3 * p.y * p.y, p.y + 0.2 * p.x, 0.8 * p.z)
    });
    vec![
        outer,
        ball([0.55, 0.1, 0.0], [0.3, 0.25, 0.2]).reversed(),
        ball([-0.5, 0.0, 0.05], [0.3, 0.25, 0.25]).reversed(),
        ball([-0.45, 0.0, 0.1], [0.12, 0.1, 0.1]),
    ]
}

#[test]
fn cavities_go_where_the_shell_around_them_goes() {
    let parts = hollow();
    let domain = joined_all(&parts);
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| deformed(&parts[k], bent_and_turned));
    let target = joined_all(&[c, d, a, b]);
    let (map, report) = mapped(&domain, &target);
    let found: Vec<(usize, bool, u64)> = report
        .shells
        .iter()
        .map(|shell| (shell.target, shell.is_cavity, shell.genus))
        .collect();
    assert_eq!(found, [(2, false, 0), (3, true, 0), (0, true, 0), (1, false, 0)]);
    let off = error(&map, bent_and_turned);
    assert!(off < 0.05, "{off}");

    // The images of all points lie on the target, those of subdivided triangles too.
    let fine = map.subdivided();
    assert_eq!(fine.domain().triangles().len(), 4 * domain.triangles().len());
    assert!(error(&fine, bent_and_turned) < 0.05);
    // The file has the same map.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shells.safetensors");
    for boundary in [map.clone(), fine] {
        let metadata = BoundaryMetadata::new(vec![]);
        write_boundary(
            &path,
            &BoundaryFile {
                boundary: boundary.clone(),
                metadata,
            },
        )
        .unwrap();
        let read = read_boundary(&path).unwrap();
        assert_eq!(read.boundary, boundary);
        assert_eq!(read.metadata.format_version, "1.3");
    }
    // And the inside follows.
    let fitted = fit(
        &map,
        &FitOptions {
            tolerance: 5e-3,
            ..FitOptions::default()
        },
        &|_| (),
    )
    .unwrap();
    assert!(
        fitted.report.boundary_error.rms < 5e-3,
        "{:?}",
        fitted.report.boundary_error
    );
    let inside = [Point::new(0.0, 0.1, 0.0), Point::new(-0.45, 0.0, 0.1)];
    for (p, image) in inside.iter().zip(fitted.map.evaluate(&inside)) {
        let off = (image - bent_and_turned(p)).norm() / map.target_diagonal();
        assert!(off < 0.05, "{p}: {off}");
    }
}

/// Nothing but its cavities says how an ellipsoid is turned: the search for the outer shell alone takes any of its symmetries.
#[test]
fn cavities_tell_how_a_symmetric_solid_is_turned() {
    let parts = [
        ball([0.0; 3], [1.0, 0.9, 0.8]),
        ball([0.45, 0.1, 0.0], [0.2; 3]).reversed(),
        ball([-0.4, 0.2, 0.2], [0.2; 3]).reversed(),
        ball([0.0, -0.5, -0.2], [0.15; 3]).reversed(),
    ];
    for seed in [1.0, 2.5] {
        let turn = Rotation3::from_euler_angles(seed, -0.7 * seed, 0.4 + seed);
        let moved = |p: &Point| turn * p * 1.7;
        let domain = joined_all(&parts);
        let target = joined_all(&[2, 0, 3, 1].map(|k| deformed(&parts[k], moved)));
        let (map, report) = mapped(&domain, &target);
        let found: Vec<usize> = report.shells.iter().map(|shell| shell.target).collect();
        assert_eq!(found, [1, 3, 0, 2]);
        let off = error(&map, moved);
        assert!(off < 0.02, "{off}");
    }
}

#[test]
fn components_are_matched_by_handles_size_and_place() {
    let parts = [
        shapes::torus(1.0, 0.35, 24, 12),
        ball([1.0, 0.0, 0.0], [0.15; 3]).reversed(),
        ball([3.0, 0.5, 0.0], [0.5, 0.4, 0.3]),
        ball([-3.0, 0.0, 1.0], [0.7, 0.4, 0.5]),
    ];
    let domain = joined_all(&parts);
    let target = joined_all(&[3, 1, 2, 0].map(|k| deformed(&parts[k], bent_and_turned)));
    let (_, report) = mapped(&domain, &target);
    let found: Vec<(usize, bool, u64)> = report
        .shells
        .iter()
        .map(|shell| (shell.target, shell.is_cavity, shell.genus))
        .collect();
    assert_eq!(found, [(3, false, 1), (1, true, 0), (2, false, 0), (0, false, 0)]);
}

#[test]
fn landmarks_say_which_shell_goes_where() {
    let parts = [ball([0.0; 3], [0.5; 3]), ball([2.0, 0.0, 0.0], [0.5, 0.4, 0.6])];
    let solid = joined_all(&parts);
    let count = parts[0].vertices().len() as u32;
    let with = |pairs: Vec<[u32; 2]>| PairOptions {
        landmarks: Landmarks::new(pairs, 2 * count as usize, 2 * count as usize).unwrap(),
        aligned: true,
        ..PairOptions::default()
    };
    let targets = |options: &PairOptions| -> Vec<usize> {
        let (_, report) = map_pair(&solid, &solid, options, &|_| ()).unwrap();
        report.shells.iter().map(|shell| shell.target).collect()
    };
    assert_eq!(targets(&with(vec![])), [0, 1]);
    assert_eq!(targets(&with(vec![[0, count]])), [1, 0]);
    let (map, report) = map_pair(&solid, &solid, &with(vec![[0, count + 3]]), &|_| ()).unwrap();
    assert_eq!(report.landmarks, 1);
    assert!((map.image()[0] - solid.vertices()[count as usize + 3]).norm() < 1e-9);
    let torn = map_pair(&solid, &solid, &with(vec![[0, 1], [1, count]]), &|_| ());
    assert!(matches!(torn, Err(PairError::NoMatchingShells { .. })));
}

#[test]
fn shells_that_do_not_match_are_refused() {
    let pair = |domain: &SurfaceMesh, target: &SurfaceMesh| {
        map_pair(domain, target, &PairOptions::default(), &|_| ())
            .map(|_| ())
            .unwrap_err()
    };
    let hollow = shapes::spherical_shell(1.0, 0.4, 2);
    let solid = shapes::sphere(1.0, 2);
    assert_eq!(pair(&hollow, &solid), PairError::UnequalShells { domain: 2, target: 1 });
    assert_eq!(pair(&solid, &hollow), PairError::UnequalShells { domain: 1, target: 2 });
    let apart = joined(&solid, &ball([5.0, 0.0, 0.0], [0.4; 3]));
    assert!(matches!(pair(&hollow, &apart), PairError::NoMatchingShells { .. }));
    let with_ring = joined(
        &solid,
        &deformed(&shapes::torus(0.5, 0.1, 16, 8), |p| p + Vector::x() * 0.1).reversed(),
    );
    assert!(matches!(pair(&hollow, &with_ring), PairError::NoMatchingShells { .. }));
    let overlapping = joined(&solid, &ball([1.0, 0.0, 0.0], [0.8; 3]));
    assert!(matches!(
        pair(&overlapping, &apart),
        PairError::Shells {
            side: "domain",
            error: ShellsError::Overlap { components: [0, 1] }
        }
    ));
    let start = Some(BoundaryMap::new(hollow.clone(), hollow.vertices().to_vec()).unwrap());
    let options = PairOptions {
        start,
        ..PairOptions::default()
    };
    let refused = map_pair(&hollow, &hollow, &options, &|_| ()).map(|_| ()).unwrap_err();
    assert!(matches!(refused, PairError::NotWithShells { .. }));
}

#[test]
fn maps_of_other_shells_are_refused() {
    let hollow = shapes::spherical_shell(1.0, 0.4, 2);
    let (map, _) = mapped(&hollow, &hollow);
    let shells = map.shells().unwrap().to_vec();
    let remade = BoundaryMap::by_shells(&hollow, &hollow, shells.clone()).unwrap();
    assert_eq!(remade, map);
    // The inverse of the inverse, too.
    assert_eq!(map.inverse().unwrap().inverse().unwrap(), map);
    let refused = |shells: Vec<ShellMap>| {
        let made = BoundaryMap::by_shells(&hollow, &hollow, shells);
        assert!(matches!(made, Err(BoundaryMapError::Shells { .. })), "{made:?}");
    };
    refused(vec![]);
    refused(shells[..1].to_vec());
    refused(vec![shells[0].clone(), shells[0].clone()]);
    refused(vec![shells[1].clone(), shells[0].clone()]);
    let elsewhere = |target: usize| ShellMap {
        target,
        ..shells[0].clone()
    };
    refused(vec![elsewhere(1), shells[1].clone()]);
    refused(vec![elsewhere(7), shells[1].clone()]);
}

/// A half turn of an ellipsoid, by landmarks: the cavity has to follow, although every alignment of the whole says otherwise.
#[test]
fn landmarks_count_more_than_what_is_inside() {
    let outer = ball([0.0; 3], [1.0, 0.8, 0.6]);
    let solid = joined(&outer, &ball([0.4, 0.0, 0.0], [0.2; 3]).reversed());
    let half_turn = |p: &Point| Point::new(-p.x, -p.y, p.z);
    let nearest = |p: Point| {
        let distance = |&v: &usize| (outer.vertices()[v] - p).norm();
        (0..outer.vertices().len())
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap() as u32
    };
    let ends = [[1.0, 0.0, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, 0.6], [-1.0, 0.0, 0.0]].map(Point::from);
    let pairs: Vec<[u32; 2]> = ends.iter().map(|p| [nearest(*p), nearest(half_turn(p))]).collect();
    let count = solid.vertices().len();
    let options = PairOptions {
        landmarks: Landmarks::new(pairs.clone(), count, count).unwrap(),
        ..PairOptions::default()
    };
    let (map, report) = map_pair(&solid, &solid, &options, &|_| ()).unwrap();
    assert_eq!(report.landmarks, 4);
    assert!(report.landmark_error < 1e-9, "{}", report.landmark_error);
    let [v, w] = pairs[0].map(|v| v as usize);
    assert!((map.image()[v] - solid.vertices()[w]).norm() < 1e-9);
}

#[test]
fn a_landmark_on_a_cavity_tells_where_the_shell_around_it_goes() {
    let at = |x: f64| {
        [
            ball([x, 0.0, 0.0], [0.8, 0.7, 0.6]),
            ball([x + 0.2, 0.0, 0.0], [0.2; 3]).reversed(),
        ]
    };
    let [[a, b], [c, d]] = [at(0.0), at(3.0)];
    let solid = joined_all(&[a, b, c, d]);
    let count = solid.vertices().len();
    let of_shell = (count / 4) as u32;
    let options = PairOptions {
        landmarks: Landmarks::new(vec![[of_shell, 3 * of_shell]], count, count).unwrap(),
        ..PairOptions::default()
    };
    let (_, report) = map_pair(&solid, &solid, &options, &|_| ()).unwrap();
    let targets: Vec<usize> = report.shells.iter().map(|shell| shell.target).collect();
    assert_eq!(targets, [2, 3, 0, 1]);
}

#[test]
fn cavities_turn_with_the_shell_around_them_by_conformal_maps_too() {
    let solid = joined_all(&hollow());
    let options = PairOptions {
        method: PairMethod::Conformal,
        ..PairOptions::default()
    };
    let (map, _) = map_pair(&solid, &solid, &options, &|_| ()).unwrap();
    let off = error(&map, |p| *p);
    assert!(off < 0.01, "{off}");
}

#[test]
fn a_small_shell_that_is_stretched_is_named() {
    let outer = ball([0.0; 3], [1.0, 0.9, 0.8]);
    let cavity = |radii: [f64; 3]| joined(&outer, &ball([0.1, 0.0, 0.0], radii).reversed());
    let (_, report) = map_pair(
        &cavity([0.05; 3]),
        &cavity([0.4, 0.004, 0.004]),
        &PairOptions::default(),
        &|_| (),
    )
    .unwrap();
    assert!(report.looks_wrong() && !report.stretch.looks_wrong(), "{report:?}");
    assert_eq!(report.stretched_shell(), Some(1));
}

#[test]
fn shells_with_a_common_vertex_are_refused() {
    let hollow = shapes::spherical_shell(1.0, 0.4, 2);
    let count = hollow.vertices().len() / 2;
    let mut triangles = hollow.triangles().to_vec();
    let shared = triangles.iter_mut().flatten().filter(|v| **v == count as u32);
    shared.for_each(|v| *v = 0);
    // A vertex too many would be refused, too.
    let vertices = hollow.vertices().to_vec();
    let pinched = SurfaceMesh::new(vertices, triangles).unwrap();
    let refused = map_pair(&pinched, &hollow, &PairOptions::default(), &|_| ())
        .map(|_| ())
        .unwrap_err();
    assert!(matches!(refused, PairError::Sphere { side: "domain", .. }), "{refused}");
    let (map, _) = mapped(&hollow, &hollow);
    let made = BoundaryMap::by_shells(&pinched, &hollow, map.shells().unwrap().to_vec());
    assert!(matches!(made, Err(BoundaryMapError::Shells { .. })), "{made:?}");
}
