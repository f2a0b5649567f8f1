//! Maps between solids of several shells: components and cavities are matched, and each is mapped one to one.

use nalgebra::Rotation3;
use solidmap::boundary_map::check::{BijectivityVerdict, BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{
    ComponentMismatch, ComponentsError, LandmarkCurve, Landmarks, LoopError, PairError, PairMethod, PairOptions,
    PairReport, map_pair, map_pair_with_alternatives,
};
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

/// A ball and two rings. Each loop is of one ring, and errors name it as it is numbered in the file.
#[test]
fn loops_decide_on_each_ring_and_errors_name_them_by_their_numbers() {
    let ring = shapes::torus(1.0, 0.4, 24, 12);
    let beside = |x: f64| deformed(&ring, |p| Point::new(p.x + x, p.y, p.z));
    let small = ball([0.0, 4.0, 0.0], [0.5; 3]);
    let solid = joined_all(&[small.clone(), beside(0.0), beside(4.0)]);
    let first = |ring: usize| small.vertices().len() + ring * 24 * 12;
    // Once along the ring, and `across` times around the tube.
    let along = |ring: usize, across: usize| -> Vec<u32> {
        let vertex = |k: usize| first(ring) + k * 12 + (k * across / 2) % 12;
        (0..24).map(|k| vertex(k) as u32).collect()
    };
    let tried = |pairs: &[[Vec<u32>; 2]]| {
        let loops = pairs.iter().map(|[domain, target]| LandmarkCurve {
            domain: domain.clone(),
            target: target.clone(),
        });
        let options = PairOptions {
            loops: loops.collect(),
            aligned: true,
            ..PairOptions::default()
        };
        map_pair(&solid, &solid, &options, &|_| ())
    };
    let (map, report) = tried(&[[along(1, 0), along(1, 1)], [along(0, 0), along(0, 0)]]).unwrap();
    let targets: Vec<usize> = report.shells.iter().map(|shell| shell.target).collect();
    assert_eq!(targets, [0, 1, 2]);
    // How often the image of a walk along a ring turns about the circle in the middle of its tube.
    let turns = |ring: usize, centre: f64| {
        let angle = |&v: &u32| {
            let p = map.image()[v as usize];
            p.z.atan2((p.x - centre).hypot(p.y) - 1.0)
        };
        let angles: Vec<f64> = along(ring, 0).iter().map(angle).collect();
        let steps = (0..24).map(|k| (angles[(k + 1) % 24] - angles[k]).sin().asin());
        (steps.sum::<f64>() / std::f64::consts::TAU).round()
    };
    assert_eq!([turns(0, 0.0), turns(1, 4.0)].map(f64::abs), [0.0, 1.0]);
    let refused = |pairs: &[[Vec<u32>; 2]]| match tried(pairs).map(|_| ()) {
        Err(PairError::Shell { shell, error }) => match *error {
            PairError::Loops(error) => (shell, error),
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    };
    let around = |ring: usize| -> Vec<u32> { (0..12).map(|k| (first(ring) + k) as u32).collect() };
    let at_point = |ring: usize| -> Vec<u32> { [0, 1, 13].map(|k| (first(ring) + k) as u32).to_vec() };
    let straight = |ring: usize| [along(ring, 0), along(ring, 0)];
    let (shell, error) = refused(&[straight(0), straight(1), [along(1, 0), around(1)]]);
    assert_eq!(
        (shell, error),
        (
            2,
            LoopError::Bounds {
                index: 2,
                side: "target"
            }
        )
    );
    let (shell, error) = refused(&[straight(0), [at_point(1), along(1, 0)]]);
    assert_eq!(
        (shell, error),
        (
            2,
            LoopError::NoHandle {
                index: 1,
                side: "domain"
            }
        )
    );
    let (shell, error) = refused(&[straight(0), [vec![0, 1, 2], vec![0, 1, 2]]]);
    assert_eq!((shell, error), (0, LoopError::NoHandles));
}

/// What is around the cavity has a handle, on which a landmark would be refused.
#[test]
fn a_landmark_may_be_on_a_cavity_of_a_ring() {
    let ring = shapes::torus(1.0, 0.4, 24, 12);
    let cavity = ball([1.0, 0.0, 0.0], [0.15; 3]).reversed();
    let solid = joined(&ring, &cavity);
    let (count, on_cavity) = (solid.vertices().len(), ring.vertices().len() as u32 + 7);
    let with = |pair: [u32; 2]| PairOptions {
        landmarks: Landmarks::new(vec![pair], count, count).unwrap(),
        ..PairOptions::default()
    };
    let (map, report) = map_pair(&solid, &solid, &with([on_cavity; 2]), &|_| ()).unwrap();
    assert_eq!(report.landmarks, 1);
    assert!((map.image()[on_cavity as usize] - solid.vertices()[on_cavity as usize]).norm() < 1e-9);
    let refused = map_pair(&solid, &solid, &with([3, 3]), &|_| ())
        .map(|_| ())
        .unwrap_err();
    let words = "shell 0 of the domain, counted from 0: landmarks cannot be used with solids of genus 1";
    assert!(refused.to_string().starts_with(words), "{refused}");
}

/// All vertices of an icosahedron stay, but two that change places.
#[test]
fn landmarks_that_are_missed_are_named_by_their_numbers() {
    let icosahedron = deformed(&shapes::sphere(0.5, 0), |p| Point::new(p.x + 3.0, p.y, p.z));
    let large = ball([0.0; 3], [1.0; 3]);
    let solid = joined(&large, &icosahedron);
    let first = large.vertices().len() as u32;
    let own: Vec<u32> = (0..12).map(|k| first + k).collect();
    let mut pairs: Vec<[u32; 2]> = own.iter().map(|&v| [v, v]).collect();
    (pairs[3][1], pairs[8][1]) = (own[8], own[3]);
    pairs.insert(0, [5, 5]);
    let options = PairOptions {
        landmarks: Landmarks::new(pairs.clone(), solid.vertices().len(), solid.vertices().len()).unwrap(),
        ..PairOptions::default()
    };
    let error = map_pair(&solid, &solid, &options, &|_| ()).map(|_| ()).unwrap_err();
    let PairError::Shell { shell: 1, error } = error else {
        panic!("{error:?}");
    };
    let PairError::LandmarksMissed { missed, first, .. } = *error else {
        panic!("{error:?}");
    };
    assert!(missed.iter().all(|&k| (1..13).contains(&k)), "{missed:?}");
    assert_eq!(first, pairs[missed[0]]);
}

/// Maps with the shells of the domain going where they are to go; checks the map, and returns the targets of all shells.
fn mapped_by(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    components: &[[usize; 2]],
    aligned: bool,
) -> (BoundaryMap, Vec<usize>) {
    let options = PairOptions {
        components: components.to_vec(),
        aligned,
        ..PairOptions::default()
    };
    let (map, report) = map_pair(domain, target, &options, &|_| ()).unwrap();
    let checked = check(&map, Some(target), &BoundaryCheckOptions::default(), None).unwrap();
    assert_eq!(checked.verdict, BijectivityVerdict::Bijective, "{checked}");
    assert!(!report.looks_wrong(), "{report:?}");
    // Of a similarity, the energy is that of its scale, 4 for none.
    for (k, shell) in report.shells.iter().enumerate() {
        let own = &map.shells().unwrap()[k].map;
        let scale = own.target_surface().unwrap().area() / own.domain().area();
        let p99 = shell.distortion.symmetric_dirichlet.p99;
        assert!(p99 < 1.3 * 2.0 * (scale + 1.0 / scale), "{p99}");
    }
    (map, report.shells.iter().map(|shell| shell.target).collect())
}

#[test]
fn components_go_where_they_are_told() {
    let parts = [
        ball([0.0; 3], [0.5, 0.4, 0.6]),
        ball([2.0, 0.0, 0.0], [0.5, 0.4, 0.6]),
        ball([4.0, 0.0, 0.0], [0.5, 0.4, 0.6]),
    ];
    let solid = joined_all(&parts);
    for aligned in [false, true] {
        assert_eq!(mapped_by(&solid, &solid, &[], aligned).1, [0, 1, 2]);
        assert_eq!(mapped_by(&solid, &solid, &[[1, 1]], aligned).1, [0, 1, 2]);
        let (map, targets) = mapped_by(&solid, &solid, &[[0, 2], [2, 1]], aligned);
        assert_eq!(targets, [2, 0, 1]);
        // What is left is matched, and exchanged.
        assert_eq!(mapped_by(&solid, &solid, &[[1, 1], [2, 0]], aligned).1, [2, 1, 0]);
        if aligned {
            // In the same pose, the true map is a translation.
            let of_shell = solid.vertices().len() / 3;
            let shift = |v: usize| Vector::x() * [4.0, -2.0, -2.0][v / of_shell];
            let images = solid.vertices().iter().enumerate().map(|(v, p)| p + shift(v));
            let off = crate::common::largest_distance(map.image(), &images.collect::<Vec<Point>>());
            assert!(off < 0.02 * map.target_diagonal(), "{off}");
        }
    }
}

/// Two equal cavities, of which either could be the other one's image, if the shell around them is turned.
#[test]
fn cavities_go_where_they_are_told_and_turn_what_is_around_them() {
    let cavity = |x: f64| ball([x, 0.0, 0.0], [0.2; 3]).reversed();
    let solid = joined_all(&[ball([0.0; 3], [1.0, 0.8, 0.6]), cavity(0.5), cavity(-0.5)]);
    assert_eq!(mapped_by(&solid, &solid, &[[1, 1]], false).1, [0, 1, 2]);
    let (map, targets) = mapped_by(&solid, &solid, &[[1, 2]], false);
    assert_eq!(targets, [0, 2, 1]);
    // The outer shell is turned such that the cavity goes where it is to be.
    let nearest = |p: Point| {
        let distance = |v: &usize| (solid.vertices()[*v] - p).norm();
        (0..162).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
    };
    let image = map.image()[nearest(Point::new(1.0, 0.0, 0.0))];
    assert!(image.x < -0.9, "{image}");
    // A cavity told to go to one of another solid takes the shells around it along.
    let other = deformed(&solid, |p| p + 3.0 * Vector::y());
    let both = joined(&solid, &other);
    let aligned = mapped_by(&both, &both, &[[2, 5]], true).1;
    assert_eq!(aligned, [3, 4, 5, 0, 1, 2]);
}

/// The outer shell cannot be turned so that they come to lie there: the map of a cavity must still be a good one.
#[test]
fn cavities_that_are_told_to_go_elsewhere_are_not_distorted() {
    let outer = ball([0.0; 3], [2.0, 0.5, 0.5]);
    let uneven = deformed(&outer, |p| {
        Point::new(p.x, p.y * (1.0 + 0.3 * p.x), p.z * (1.0 + 0.3 * p.x))
    });
    let cavity = |x: f64, radius: f64| ball([x, 0.0, 0.0], [radius, 0.8 * radius, 0.8 * radius]).reversed();
    let solid = joined_all(&[uneven, cavity(1.2, 0.3), cavity(-1.0, 0.2)]);
    let (_, targets) = mapped_by(&solid, &solid, &[[2, 1]], false);
    assert_eq!(targets, [0, 2, 1]);
}

#[test]
fn components_that_cannot_go_where_they_are_told_are_refused() {
    let hollow = joined(
        &shapes::spherical_shell(1.0, 0.4, 2),
        &deformed(&shapes::torus(0.5, 0.1, 16, 8), |p| p + 3.0 * Vector::x()),
    );
    let with = |components: &[[usize; 2]]| PairOptions {
        components: components.to_vec(),
        ..PairOptions::default()
    };
    let refused = |components: &[[usize; 2]]| match map_pair(&hollow, &hollow, &with(components), &|_| ()) {
        Err(PairError::Components(error)) => error,
        other => panic!("{:?}", other.map(|(_, report)| report)),
    };
    let (side, shells) = ("domain", 3);
    assert_eq!(
        refused(&[[3, 0]]),
        ComponentsError::OutOfRange { side, shell: 3, shells }
    );
    let others = [1, 0];
    assert_eq!(
        refused(&[[1, 1], [1, 0]]),
        ComponentsError::Duplicate { side, shell: 1, others }
    );
    let mismatch = |error| match error {
        ComponentsError::Mismatch { mismatch, .. } => mismatch,
        error => panic!("{error}"),
    };
    let is_cavity = true;
    assert_eq!(mismatch(refused(&[[1, 0]])), ComponentMismatch::Kind { is_cavity });
    let (domain, target) = (0, 1);
    assert_eq!(
        mismatch(refused(&[[0, 2]])),
        ComponentMismatch::Genus { domain, target }
    );
    // Solids of one shell have a shell, too.
    let solid = shapes::sphere(1.0, 2);
    assert!(map_pair(&solid, &solid, &with(&[[0, 0]]), &|_| ()).is_ok());
    let error = map_pair(&solid, &solid, &with(&[[0, 1]]), &|_| ())
        .map(|_| ())
        .unwrap_err();
    let (side, shells) = ("target", 1);
    assert_eq!(error, ComponentsError::OutOfRange { side, shell: 1, shells }.into());
    assert!(error.to_string().contains("no shell 1 in the target"), "{error}");
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
    let ring = shapes::torus(3.0, 1.0, 24, 12);
    let held = joined(&hollow, &deformed(&ring, |p| p + 9.0 * Vector::x()));
    let from = |start: &SurfaceMesh| PairOptions {
        start: Some(BoundaryMap::new(start.clone(), start.vertices().to_vec()).unwrap()),
        ..PairOptions::default()
    };
    let refused = map_pair(&held, &held, &from(&held), &|_| ()).map(|_| ()).unwrap_err();
    let option = "a map to start from";
    let error = Box::new(PairError::NotWithHandles { option, genus: 1 });
    assert_eq!(refused, PairError::Shell { shell: 2, error });
    let refused = map_pair(&hollow, &hollow, &from(&solid), &|_| ())
        .map(|_| ())
        .unwrap_err();
    let [vertices, expected] = [&solid, &hollow].map(|surface| surface.vertices().len());
    assert_eq!(refused, PairError::Start { vertices, expected });
}

/// An ellipsoid maps to itself in four ways by its symmetry, and a cavity in its middle follows each.
#[test]
fn other_maps_change_an_outer_shell_and_what_is_inside() {
    let outer = ball([0.0; 3], [1.0, 0.75, 0.55]);
    let cavity = ball([0.0; 3], [0.4, 0.3, 0.2]).reversed();
    let far = ball([4.0, 0.0, 0.0], [0.6; 3]);
    let solid = joined_all(&[outer, cavity, far]);
    let options = PairOptions {
        alternatives: 2,
        ..PairOptions::default()
    };
    let found = map_pair_with_alternatives(&solid, &solid, &options, &|_| ()).unwrap();
    let (first, _) = map_pair(&solid, &solid, &PairOptions::default(), &|_| ()).unwrap();
    assert_eq!(found.map, first);
    assert!(!found.alternatives.is_empty());
    assert_eq!(found.alternatives.len(), found.report.alternatives.len());
    for (other, about) in found.alternatives.iter().zip(&found.report.alternatives) {
        let checked = check(other, Some(&solid), &BoundaryCheckOptions::default(), None).unwrap();
        assert_eq!(checked.verdict, BijectivityVerdict::Bijective, "{checked}");
        // The other outer shell stays, and the cavity goes with the shell around it.
        let changed = about.shell.unwrap();
        let shells = other.shells().unwrap().iter().zip(first.shells().unwrap());
        let is_other: Vec<bool> = shells.map(|(own, first)| own.map != first.map).collect();
        assert_eq!(
            is_other,
            if changed == 0 {
                [true, true, false]
            } else {
                [false, false, true]
            }
        );
        let distances = other.image().iter().zip(first.image()).map(|(p, q)| (p - q).norm());
        let mean = distances.sum::<f64>() / first.image().len() as f64 / first.target_diagonal();
        assert!((about.distance / mean - 1.0).abs() < 1e-9 && mean > 0.01, "{about:?}");
    }
}

#[test]
fn shells_start_from_their_parts_of_a_map() {
    let parts = hollow();
    let domain = joined_all(&parts);
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| deformed(&parts[k], bent_and_turned));
    let target = joined_all(&[c, d, a, b]);
    let first = PairOptions {
        improve: false,
        ..PairOptions::default()
    };
    let (start, before) = map_pair(&domain, &target, &first, &|_| ()).unwrap();
    let targets = |report: &PairReport| -> Vec<usize> { report.shells.iter().map(|shell| shell.target).collect() };
    assert_eq!(targets(&before), [2, 3, 0, 1]);
    let from = |start: &BoundaryMap, improve: bool| {
        let options = PairOptions {
            start: Some(start.clone()),
            improve,
            ..PairOptions::default()
        };
        map_pair(&domain, &target, &options, &|_| ()).unwrap()
    };
    // Its own embeddings are what each shell starts from.
    let (same, _) = from(&start, false);
    assert!(crate::common::largest_distance(same.image(), start.image()) < 1e-9);
    let (map, after) = from(&start, true);
    assert_eq!(targets(&after), [2, 3, 0, 1]);
    assert!(after.after.mean_symmetric_dirichlet <= before.after.mean_symmetric_dirichlet);
    assert!(error(&map, bent_and_turned) < 0.05);
    // The images of vertices are enough, and say which shell goes where.
    let straight = BoundaryMap::new(domain.clone(), map.image().to_vec()).unwrap();
    let (map, after) = from(&straight, true);
    assert_eq!(targets(&after), [2, 3, 0, 1]);
    assert!(error(&map, bent_and_turned) < 0.05);
}

#[test]
fn a_start_says_which_shell_goes_where_unless_components_do() {
    let parts = [0.0, 2.0].map(|x| ball([x, 0.0, 0.0], [0.5, 0.4, 0.6]));
    let solid = joined_all(&parts);
    let (swapped, targets) = mapped_by(&solid, &solid, &[[0, 1]], true);
    assert_eq!(targets, [1, 0]);
    for components in [vec![], vec![[1, 1]]] {
        let is_swapped = components.is_empty();
        let options = PairOptions {
            start: Some(swapped.clone()),
            components,
            ..PairOptions::default()
        };
        let (map, report) = map_pair(&solid, &solid, &options, &|_| ()).unwrap();
        let targets: Vec<usize> = report.shells.iter().map(|shell| shell.target).collect();
        assert_eq!(targets, if is_swapped { [1, 0] } else { [0, 1] });
        let expected = if is_swapped { swapped.image() } else { solid.vertices() };
        let off = crate::common::largest_distance(map.image(), expected);
        assert!(off < 0.02 * map.target_diagonal(), "{off}");
    }
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
