//! What `certificate` proves, compared with dense sampling.

use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::certificate::{
    Certificate, CertificateCell, CertificateError, CertificateOptions, StopReason, Verdict, certify,
};
use solidmap::energy::{AdaptiveOptions, EnergyOptions, GridResolution, adaptive_energies, worst_places};
use solidmap::fit::FitOptions;
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::solver::Coefficients;
use solidmap::worst_places::{PlaceKind, WorstPlace};
use solidmap::{Matrix3, Point, Vector};

const IDENTITY: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn map(sources: &[(Point, [f64; 3])], affine: [[f64; 3]; 4]) -> HarmonicMap {
    let coefficients = Coefficients {
        sources: sources.iter().map(|s| s.1).collect(),
        affine,
    };
    HarmonicMap::new(sources.iter().map(|s| s.0).collect(), coefficients).unwrap()
}

fn options(finest: usize) -> CertificateOptions {
    CertificateOptions {
        finest,
        ..Default::default()
    }
}

fn certified(map: &HarmonicMap, domain: &SurfaceMesh, orientation: f64, finest: usize) -> Certificate {
    certify(map, domain, orientation, &options(finest), &|_| {}).unwrap()
}

/// A source above the cube pulls its top through itself: at the middle of the top face `∂f_z/∂z` is
/// `1 − 2 / (4π 0.25²) < 0`, while the far half is nearly the identity.
fn folding() -> HarmonicMap {
    map(&[(Point::new(0.0, 0.0, 0.75), [0.0, 0.0, -2.0])], IDENTITY)
}

/// Random points of a cell, and its corners.
fn samples(leaf: &CertificateCell, count: usize, random: &mut StdRng) -> Vec<Point> {
    let corners = (0..8).map(|n| Vector::from_fn(|k, _| f64::from(n >> k & 1)));
    let inner: Vec<Vector> = (0..count)
        .map(|_| Vector::from_fn(|_, _| random.random_range(0.0..1.0)))
        .collect();
    corners.chain(inner).map(|step| leaf.low + step * leaf.size).collect()
}

/// Signs and both bounds hold at samples of every decided cell; returns how many cells were tested.
fn assert_sound(map: &HarmonicMap, certificate: &Certificate, orientation: f64, count: usize) -> usize {
    let mut random = StdRng::seed_from_u64(11);
    let decided: Vec<&CertificateCell> = certificate
        .cells()
        .iter()
        .filter(|leaf| leaf.verdict != Verdict::Undecided)
        .collect();
    let points: Vec<Point> = decided
        .iter()
        .flat_map(|leaf| samples(leaf, count, &mut random))
        .collect();
    let jacobians = map.jacobian(&points);
    for (leaf, jacobians) in decided.iter().zip(jacobians.chunks(count + 8)) {
        let sign = if leaf.verdict == Verdict::Positive {
            orientation
        } else {
            -orientation
        };
        for jacobian in jacobians {
            assert!(
                sign * jacobian.determinant() >= leaf.det_bound && leaf.det_bound > 0.0,
                "{leaf:?}"
            );
            assert!(
                jacobian.singular_values().min() >= leaf.sigma_min && leaf.sigma_min > 0.0,
                "{leaf:?}"
            );
        }
    }
    decided.len()
}

#[test]
fn affine_maps_are_decided_at_once_by_their_own_singular_values() {
    let affine = [[0.3, 0.0, -1.0], [2.0, 0.1, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 3.0]];
    let linear = Matrix3::from_fn(|i, k| affine[k + 1][i]);
    let domain = shapes::sphere(1.3, 2);
    for (orientation, expected) in [(1.0, Verdict::Positive), (-1.0, Verdict::Folded)] {
        let certificate = certified(&map(&[], affine), &domain, orientation, 64);
        let report = certificate.report;
        assert_eq!(
            (certificate.cells().len(), report.stop_reason),
            (8, StopReason::AllDecided)
        );
        for leaf in certificate.cells() {
            assert_eq!(leaf.verdict, expected);
            // Norms of 3 × 3 matrices are over-estimated by up to 4 %.
            let least = linear.singular_values().min();
            assert!(leaf.sigma_min <= least && leaf.sigma_min > 0.96 * least);
            assert!((leaf.det_bound / linear.determinant().abs() - 1.0).abs() < 1e-9);
        }
        assert!(report.volume_error.abs() < 1e-12);
    }
}

#[test]
fn a_reflecting_map_of_a_reflected_target_is_not_folded() {
    let mut affine = IDENTITY;
    affine[1][0] = -1.0;
    let certificate = certified(&map(&[], affine), &shapes::cube(1.0, 1), -1.0, 8);
    assert_eq!(certificate.report.positive.cells, 8);
    assert!(
        certificate
            .cells()
            .iter()
            .all(|leaf| (leaf.det_centre - 1.0).abs() < 1e-12)
    );
}

#[test]
fn a_fold_is_proved_where_samples_find_it_and_nowhere_else() {
    let (map, domain) = (folding(), shapes::cube(1.0, 1));
    let certificate = certified(&map, &domain, 1.0, 64);
    let report = certificate.report;
    assert!(report.folded.cells > 100 && report.positive.cells > 100);
    assert!(assert_sound(&map, &certificate, 1.0, 12) > 1000);

    let points = crate::common::interior_points(&domain, 20_000, 5);
    let mut folded = 0;
    for (point, jacobian) in points.iter().zip(map.jacobian(&points)) {
        let det = jacobian.determinant();
        folded += usize::from(det < 0.0);
        match certificate.cell_at(point).unwrap().verdict {
            Verdict::Positive => assert!(det > 0.0),
            Verdict::Folded => assert!(det < 0.0),
            Verdict::Undecided => {}
        }
    }
    // Four standard deviations of a share of 20,000 samples.
    let sampled = folded as f64 / points.len() as f64;
    let tolerance = 4.0 * (sampled / points.len() as f64).sqrt();
    assert!(report.folded.fraction < sampled + tolerance);
    assert!(report.folded.fraction + report.undecided.fraction > sampled - tolerance);
}

/// The volume that [`folding`] folds: with `r` and `θ` about the source, `det J = 1 − cos θ / (2π r²)` is negative for
/// `r² < cos θ / 2π`, and the cube is where `r cos θ > 1/4`. Integrated over `r`, then over `c = cos θ`.
fn folded_volume() -> f64 {
    let tau = std::f64::consts::TAU;
    let least = (tau / 16.0).cbrt();
    let upper = tau.powf(-1.5) * 0.4 * (1.0 - least.powf(2.5));
    let lower = 0.25f64.powi(3) * 0.5 * (least.powi(-2) - 1.0);
    tau / 3.0 * (upper - lower)
}

/// Certificates prove bounds, energies estimate; both of the volume where `det J` has not the target's sign.
#[test]
fn certificates_and_energies_agree_with_the_volume_that_is_folded() {
    let (map, domain, exact) = (folding(), shapes::cube(1.0, 1), folded_volume());
    let certificate = certified(&map, &domain, 1.0, 128).report;
    let (least, most) = (
        certificate.folded.fraction,
        certificate.folded.fraction + certificate.undecided.fraction,
    );
    assert!(
        least < exact && exact < most && most - least < 0.01,
        "{least} {exact} {most}"
    );
    let mut found = vec![];
    for (cells, tolerance) in [(6, 0.5), (12, 0.05), (24, 0.01), (48, 0.01)] {
        let accuracy = AdaptiveOptions {
            resolution: GridResolution::CellsAlongLongestSide(cells),
            tolerance,
            max_points: None,
        };
        let options = EnergyOptions::default();
        let (quadrature, energy) = adaptive_energies(&map, &domain, 1.0, &options, &accuracy).unwrap();
        let folded = energy.folded;
        let error = folded.error.unwrap();
        assert!(
            (folded.fraction - exact).abs() <= error,
            "{cells}: {folded:?}, exactly {exact}"
        );
        assert!(
            folded.fraction - error < most && folded.fraction + error > least,
            "{folded:?}"
        );
        assert!((folded.volume - folded.fraction).abs() < 1e-12);
        let places = worst_places(&quadrature, &energy.densities, 1.0, None, 1);
        assert_eq!(places[0].kind, PlaceKind::Folded);
        assert!(
            (places[0].measure - folded.volume).abs() < 1e-12,
            "one place: {places:?}"
        );
        found.push(error);
    }
    assert!(found[3] < 0.3 * exact && found[3] < 0.5 * found[1], "{found:?}");
}

#[test]
fn a_fold_is_one_place_of_its_volume_and_position() {
    let (map, domain) = (folding(), shapes::cube(1.0, 1));
    let certificate = certified(&map, &domain, 1.0, 64);
    let places = certificate.worst_places(2);
    assert_eq!(places.len(), 2);
    assert_eq!(
        [places[0].kind, places[1].kind],
        [PlaceKind::Folded, PlaceKind::Undecided]
    );
    // The fold ends where `cos θ = 1` and `r² = 1 / 2π`, and at the cube's top.
    let (deepest, half) = (0.75 - std::f64::consts::TAU.sqrt().recip(), 0.2325);
    for place in &places {
        assert!(
            place.centre[0].abs() < 0.01 && place.centre[1].abs() < 0.01,
            "{place:?}"
        );
        assert!(
            (place.high[2] - 0.5).abs() < 1e-12 && (place.low[2] - deepest).abs() < 0.04,
            "{place:?}"
        );
        assert!(
            (place.high[0] - half).abs() < 0.04 && (place.low[1] + half).abs() < 0.04,
            "{place:?}"
        );
    }
    assert!((places[0].measure - certificate.report.folded.volume).abs() < 1e-12);
    assert_eq!(places[0].count, certificate.report.folded.cells);
    assert_eq!(
        certificate.cell_at(&places[0].point.into()).unwrap().verdict,
        Verdict::Folded
    );
    assert!(places[0].value.unwrap() < -0.9, "{places:?}");
}

/// Bounds of merged cells hold at samples all over them.
#[test]
fn merged_cells_are_fewer_and_prove_as_much() {
    let (map, domain) = (folding(), shapes::sphere(0.6, 3));
    let certificate = certified(&map, &domain, 1.0, 64);
    let merged = certificate.merged(&map);
    assert!(10 * merged.cells().len() < 9 * certificate.cells().len());
    assert!(assert_sound(&map, &merged, 1.0, 12) > 200);
    let volume = |certificate: &Certificate, verdict| {
        let cells = certificate.cells().iter().filter(|leaf| leaf.verdict == verdict);
        cells.map(|leaf| leaf.volume).sum::<f64>()
    };
    for verdict in [Verdict::Positive, Verdict::Folded, Verdict::Undecided] {
        assert!((volume(&merged, verdict) - volume(&certificate, verdict)).abs() < 1e-12);
    }
    for point in crate::common::interior_points(&domain, 2000, 8) {
        let (before, after) = (certificate.cell_at(&point).unwrap(), merged.cell_at(&point).unwrap());
        assert!(before.verdict == after.verdict && after.size >= before.size);
        assert!(after.det_bound <= before.det_bound && after.sigma_min <= before.sigma_min);
        let det = map.jacobian(&[after.centre()])[0].determinant();
        assert!(after.size == before.size || (after.det_centre / det - 1.0).abs() < 1e-6);
    }
    // Places of equal size may change their order.
    let (before, after) = (certificate.worst_places(1)[0], merged.worst_places(1)[0]);
    assert!((before.measure - after.measure).abs() < 1e-12 && after.count < before.count);
    let corners = |place: &WorstPlace| [Point::from(place.low), Point::from(place.high)];
    for (before, after) in corners(&before).iter().zip(corners(&after)) {
        assert!((before - after).norm() < 1e-12);
    }
    assert_eq!(certificate.undecided_places().len(), merged.undecided_places().len());
}

/// Two cubes, the second of which a map reflects in itself. `f = (x, y, z) + a ∇…` cannot be affine, so it is fitted.
#[test]
fn a_part_that_is_mirrored_as_a_whole_is_named() {
    let (left, right) = (shapes::cube(1.0, 4), shapes::cube(0.8, 4));
    let right = shapes::deformed(&right, |p| p + Vector::new(3.0, 0.0, 0.0));
    let domain = shapes::joined(&left, &right);
    let mirrored = crate::common::boundary_map(
        &domain,
        |p| {
            if p.x > 1.5 { Point::new(6.0 - p.x, p.y, p.z) } else { *p }
        },
    );
    let fit = crate::common::fitted(&mirrored, &FitOptions::default());
    let report = certified(&fit.map, &domain, mirrored.target_volume(), 64).report;
    assert_eq!((report.mirrored.count, report.mirrored.parts), (1, 2));
    let share = 0.512 / 1.512;
    assert!((report.mirrored.fraction - share).abs() < 1e-9, "{report:?}");
    assert!((report.folded.fraction - share).abs() < 0.05, "{report:?}");
    let straight = crate::common::boundary_map(&domain, |p| *p);
    let fit = crate::common::fitted(&straight, &FitOptions::default());
    let report = certified(&fit.map, &domain, straight.target_volume(), 64).report;
    assert_eq!((report.mirrored.count, report.folded.cells), (0, 0));
}

/// Cells that meet the surface `det J = 0` stay undecided, and the volume of a layer of cells halves with their size.
#[test]
fn the_undecided_volume_falls_with_the_size_of_the_cells() {
    let (map, domain) = (folding(), shapes::sphere(0.6, 3));
    let undecided: Vec<f64> = [16, 32, 64, 128]
        .map(|finest| certified(&map, &domain, 1.0, finest).report.undecided.fraction)
        .into();
    for pair in undecided.windows(2) {
        assert!(pair[1] < 0.6 * pair[0], "{undecided:?}");
    }
    assert!(undecided[3] < 0.02, "{undecided:?}");
}

/// Fits with thousands of sources near the boundary: a cube made round, the same reflected, and one whose halves are
/// pushed through each other.
#[test]
fn certified_cells_of_fitted_maps_agree_with_dense_sampling() {
    let cube = shapes::cube(1.0, 10);
    let round = crate::common::boundary_map(&cube, |p| Point::from(p.coords.normalize()));
    let mirrored = crate::common::boundary_map(&cube, |p| {
        let q = p.coords.normalize();
        Point::new(-q.x, q.y, 0.7 * q.z)
    });
    let pushed = crate::common::boundary_map(&cube, |p| Point::new(4.0 * p.x.powi(3) - 0.2 * p.x, p.y, p.z));
    for (boundary, folded) in [(round, 0.0..0.02), (mirrored, 0.0..0.02), (pushed, 0.02..0.5)] {
        let fit = crate::common::fitted(&boundary, &FitOptions::default());
        let orientation = boundary.target_volume().signum();
        let certificate = certified(&fit.map, &cube, boundary.target_volume(), 128);
        let report = certificate.report;
        assert!(folded.contains(&report.folded.fraction), "{report:?}");
        assert!(report.undecided.fraction < 0.05, "{report:?}");
        assert!(assert_sound(&fit.map, &certificate, orientation, 20) > 500);
    }
}

#[test]
fn cells_fill_the_domain_whatever_its_shape() {
    for (name, domain) in crate::common::solids(0) {
        let far = Point::from(domain.bounding_box().unwrap().1.coords * 1.5);
        let map = map(&[(far, [0.4, -0.3, 0.2])], IDENTITY);
        let certificate = certified(&map, &domain, 1.0, 64);
        let report = certificate.report;
        assert!(report.volume_error.abs() < 1e-10, "{name}: {report:?}");
        for point in crate::common::interior_points(&domain, 200, 3) {
            let leaf = certificate
                .cell_at(&point)
                .unwrap_or_else(|| panic!("{name}: no cell at {point}"));
            assert!((point - leaf.centre()).amax() <= 0.5 * leaf.size * (1.0 + 1e-12));
        }
        assert_eq!(certificate.cell_at(&(far + Vector::repeat(1.0))), None);
    }
}

#[test]
fn hexahedra_are_the_leaves() {
    let certificate = certified(&folding(), &shapes::cube(1.0, 1), 1.0, 16);
    let (points, hexahedra) = certificate.hexahedra();
    assert_eq!(hexahedra.len(), certificate.cells().len());
    for (hexahedron, leaf) in hexahedra.iter().zip(certificate.cells()) {
        let corner = |n: usize| points[hexahedron[n] as usize];
        assert!((corner(0) - leaf.low).norm() < 1e-12);
        assert!((corner(6) - leaf.low - Vector::repeat(leaf.size)).norm() < 1e-12);
    }
}

#[test]
fn does_not_depend_on_the_number_of_threads() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| certified(&folding(), &shapes::sphere(0.6, 3), 1.0, 32))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one.report, three.report);
    assert_eq!(one.cells().len(), three.cells().len());
    assert_eq!(one.worst_places(9), three.worst_places(9));
    for (a, b) in one.cells().iter().zip(three.cells()) {
        assert_eq!(
            (a.low, a.verdict, a.sigma_min.to_bits()),
            (b.low, b.verdict, b.sigma_min.to_bits())
        );
    }
}

#[test]
fn limits_end_the_work_and_are_named() {
    let domain = shapes::cube(1.0, 1);
    let with = |options| certify(&folding(), &domain, 1.0, &options, &|_| {}).unwrap();
    let few = with(CertificateOptions {
        max_cells: 2000,
        ..Default::default()
    });
    assert_eq!(few.report.stop_reason, StopReason::CellLimit);
    assert!(few.cells().len() <= 2000);
    let enough = with(CertificateOptions {
        undecided: 0.1,
        ..Default::default()
    });
    assert_eq!(enough.report.stop_reason, StopReason::EnoughDecided);
    assert!(enough.report.undecided.fraction <= 0.1);
    assert_eq!(with(options(16)).report.stop_reason, StopReason::Finest);
}

/// A source in the domain is never covered by a decided cell.
#[test]
fn a_source_inside_stays_undecided() {
    let source = Point::new(0.1, 0.05, -0.02);
    let map = map(&[(source, [0.1, 0.0, 0.0])], IDENTITY);
    let certificate = certified(&map, &shapes::cube(1.0, 1), 1.0, 64);
    assert_eq!(certificate.cell_at(&source).unwrap().verdict, Verdict::Undecided);
    assert!(assert_sound(&map, &certificate, 1.0, 12) > 300);
}

#[test]
fn what_cannot_be_certified_is_refused_by_name() {
    let cube = shapes::cube(1.0, 1);
    let good = folding();
    let with = |map: &HarmonicMap, domain: &SurfaceMesh, volume, options| {
        certify(map, domain, volume, &options, &|_| {}).unwrap_err()
    };
    let default = CertificateOptions::default();
    for volume in [0.0, f64::NAN, f64::INFINITY] {
        let error = with(&good, &cube, volume, default);
        assert!(matches!(error, CertificateError::NoOrientation { .. }));
    }
    let bad = map(&[(Point::new(0.0, f64::NAN, 1.0), [0.0; 3])], IDENTITY);
    assert_eq!(
        with(&bad, &cube, 1.0, default),
        CertificateError::NonFiniteSource { source_index: 0 }
    );
    let mut affine = IDENTITY;
    affine[2][1] = f64::INFINITY;
    assert_eq!(
        with(&map(&[], affine), &cube, 1.0, default),
        CertificateError::NonFiniteAffine
    );
    assert!(matches!(
        with(&good, &cube.reversed(), 1.0, default),
        CertificateError::NoVolume { .. }
    ));
    let opened = SurfaceMesh::new(cube.vertices().to_vec(), cube.triangles()[2..].to_vec()).unwrap();
    let error = with(&good, &opened, 1.0, default);
    assert!(
        matches!(error, CertificateError::Open { .. } | CertificateError::NoVolume { .. }),
        "{error}"
    );
    let empty = SurfaceMesh::new(vec![], vec![]).unwrap();
    assert!(matches!(
        with(&good, &empty, 1.0, default),
        CertificateError::NoVolume { .. }
    ));
    for options in [
        CertificateOptions { finest: 1, ..default },
        CertificateOptions {
            max_cells: 0,
            ..default
        },
        CertificateOptions {
            undecided: f64::NAN,
            ..default
        },
    ] {
        assert!(matches!(
            with(&good, &cube, 1.0, options),
            CertificateError::Option { .. }
        ));
    }
}

/// A needle that fills a trillionth of the first cells it is in is not passed over.
#[test]
fn thin_parts_are_examined() {
    let needle = shapes::deformed(&shapes::cube(1.0, 1), |p| {
        Point::new(0.8 + 0.5 * p.x, 1e-7 * p.y + 0.123, 1e-7 * p.z - 0.217)
    });
    let domain = shapes::joined(&shapes::cube(1.0, 2), &needle);
    // A source inside of the needle, where nothing can be proved.
    let inside = Point::new(0.9, 0.123, -0.217);
    let certificate = certified(&map(&[(inside, [1e-6, 0.0, 0.0])], IDENTITY), &domain, 1.0, 256);
    let leaf = certificate.cell_at(&inside).expect("the needle is in a cell");
    assert_eq!(leaf.verdict, Verdict::Undecided, "{:?}", certificate.report);
    // A domain that is nothing but a needle.
    let report = certified(&map(&[], IDENTITY), &needle, 1.0, 256).report;
    assert_eq!(report.stop_reason, StopReason::AllDecided, "{report:?}");
}

/// Far from the origin, cells and sources keep their places to each other.
#[test]
fn certificates_do_not_depend_on_where_the_solid_is() {
    let counts = |offset: f64| {
        let shift = Vector::repeat(offset);
        let domain = shapes::deformed(&shapes::cube(1.0, 2), |p| p + shift);
        let sources = [
            (Point::new(0.75, 0.25, 0.0) + shift, [0.5, 0.25, 0.0]),
            (Point::new(-0.75, 0.5, 0.25) + shift, [-0.25, 0.5, 0.125]),
        ];
        let report = certified(&map(&sources, IDENTITY), &domain, 1.0, 64).report;
        [report.positive.cells, report.folded.cells, report.undecided.cells]
    };
    assert_eq!(counts(0.0), counts(1e7));
}
