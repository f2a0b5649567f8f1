//! Inverse maps: images go back to their points, and points without a preimage are reported.

use crate::common::{boundary_map, fitted, interior_points, largest_distance};
use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::FitOptions;
use solidmap::inverse::{InverseError, InverseMap, InverseOptions, InverseReport, Preimage, PreimageStatus};
use solidmap::map::VolumeMap;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::{Matrix3, Point, Vector};

/// A map by formulas.
struct Formula {
    value: fn(&Point) -> Point,
    jacobian: fn(&Point) -> Matrix3,
}

impl VolumeMap for Formula {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(self.value).collect()
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        points.iter().map(self.jacobian).collect()
    }
}

const AFFINE: Formula = Formula {
    value: |p| {
        Point::new(
            2.0 * p.x + 0.3 * p.y,
            p.y - 0.4 * p.z + 1.0,
            0.2 * p.x + 0.8 * p.z - 3.0,
        )
    },
    jacobian: |_| Matrix3::new(2.0, 0.3, 0.0, 0.0, 1.0, -0.4, 0.2, 0.0, 0.8),
};

/// A quarter of a turn over a length of one.
const TWIST: f64 = std::f64::consts::FRAC_PI_2;

const TWISTED: Formula = Formula {
    value: |p| {
        let (s, c) = (TWIST * p.z).sin_cos();
        Point::new(c * p.x - s * p.y, s * p.x + c * p.y, p.z)
    },
    jacobian: |p| {
        let (s, c) = (TWIST * p.z).sin_cos();
        let (x, y) = (TWIST * (-s * p.x - c * p.y), TWIST * (c * p.x - s * p.y));
        Matrix3::new(c, -s, x, s, c, y, 0.0, 0.0, 1.0)
    },
};

/// Folds at x = 0: the points at `x` and `-x` go to the same place.
const FOLDED: Formula = Formula {
    value: |p| Point::new(p.x * p.x, p.y, p.z),
    jacobian: |p| Matrix3::from_diagonal(&Vector::new(2.0 * p.x, 1.0, 1.0)),
};

const REFLECTED: Formula = Formula {
    value: |p| Point::new(-p.x, p.y, 2.0 * p.z),
    jacobian: |_| Matrix3::from_diagonal(&Vector::new(-1.0, 1.0, 2.0)),
};

fn preimages(map: &dyn VolumeMap, boundary: &BoundaryMap, points: &[Point]) -> (Vec<Preimage>, InverseReport) {
    let inverse = InverseMap::new(map, boundary, &InverseOptions::default()).unwrap();
    inverse.preimages(points)
}

fn of_formula(formula: &Formula, domain: &SurfaceMesh, points: &[Point]) -> (Vec<Preimage>, InverseReport) {
    preimages(formula, &boundary_map(domain, formula.value), points)
}

fn places(found: &[Preimage]) -> Vec<Point> {
    found.iter().map(|preimage| preimage.point).collect()
}

fn statuses(found: &[Preimage]) -> Vec<PreimageStatus> {
    found.iter().map(|preimage| preimage.status).collect()
}

/// A residual of 1e-10 of the diagonal, at most 4 units, through inverse Jacobians of norm below 3.
#[test]
fn inverse_of_forward_is_the_identity_for_formulas() {
    for formula in [&AFFINE, &TWISTED, &REFLECTED] {
        for domain in [shapes::cube(1.0, 6), shapes::torus(0.5, 0.2, 40, 20)] {
            let points = interior_points(&domain, 700, 3);
            let (found, report) = of_formula(formula, &domain, &formula.evaluate(&points));
            assert!(largest_distance(&places(&found), &points) < 1.2e-9);
            assert_eq!((report.ok, report.points), (700, 700));
            assert!(report.round_trip_max <= 1e-10);
            assert!(
                found
                    .iter()
                    .all(|preimage| preimage.preimages == 1 && !preimage.beyond_boundary)
            );
        }
    }
}

#[test]
fn inverse_of_forward_is_the_identity_for_a_fitted_map() {
    let domain = shapes::cube(1.0, 8);
    let boundary = boundary_map(&domain, |p| {
        let q = (TWISTED.value)(p);
        Point::new(q.x + 0.2 * q.z * q.z, q.y, 1.5 * q.z)
    });
    let map = fitted(&boundary, &FitOptions::default()).map.with_error(0.0);
    let points = interior_points(&domain, 2000, 4);
    let (found, report) = preimages(&map, &boundary, &map.evaluate(&points));
    assert_eq!(report.ok, 2000);
    // Inverse Jacobians have norms of about 1, and the diagonal is 2.4.
    assert!(largest_distance(&places(&found), &points) < 1e-9);
    assert!(report.round_trip_max <= 1e-10 && report.round_trip_rms <= report.round_trip_max);

    // On the target's surface, which the map meets but for its error.
    let (found, report) = preimages(&map, &boundary, boundary.image());
    assert_eq!(report.ok, boundary.image().len());
    let distance = largest_distance(&places(&found), domain.vertices());
    assert!(
        distance < 4.0 * report.boundary_error * boundary.target_diagonal(),
        "{distance}"
    );
    assert!(report.beyond_boundary > 0 && report.farthest_beyond > 0.0);
    assert!(report.farthest_beyond < 2.0 * report.boundary_error);
}

#[test]
fn points_outside_and_points_that_are_not_finite_are_reported() {
    let domain = shapes::sphere(1.0, 3);
    let nowhere = [
        [f64::NAN, 0., 0.],
        [0., f64::INFINITY, 0.],
        [f64::NEG_INFINITY, f64::NAN, 1.],
    ];
    let outside = [[2.5, 0.0, 0.0], [0.0, 1.2, 3.0], [1e300, 0.0, 0.0], [-1e9, 1e9, 1.0]];
    let points: Vec<Point> = nowhere.into_iter().chain(outside).map(Point::from).collect();
    let (found, report) = of_formula(&TWISTED, &domain, &points);
    let expected = [vec![PreimageStatus::NotFinite; 3], vec![PreimageStatus::Outside; 4]].concat();
    assert_eq!(statuses(&found), expected);
    assert_eq!((report.not_finite, report.outside, report.ok), (3, 4, 0));
    assert!(found.iter().all(|p| p.round_trip == f64::INFINITY && p.preimages == 0));
    assert!(found[..3].iter().all(|p| p.point.iter().all(|c| c.is_nan())));
    // The nearest there is.
    assert!(found[3..].iter().all(|p| (p.point.coords.norm() - 1.0).abs() < 0.05));
}

#[test]
fn no_points_have_no_preimages() {
    let (found, report) = of_formula(&AFFINE, &shapes::cube(1.0, 2), &[]);
    assert!(found.is_empty());
    assert_eq!(
        (report.points, report.round_trip_max, report.round_trip_rms),
        (0, 0.0, 0.0)
    );
}

#[test]
fn a_fold_gives_several_preimages_and_the_orientation_preserving_one_is_returned() {
    // x from -0.5 to 1: two preimages up to 0.25, one beyond.
    let domain = shapes::deformed(&shapes::cube(1.5, 6), |p| p + Vector::new(0.25, 0.0, 0.0));
    let xs = [0.001, 0.01, 0.1, 0.2, 0.24, 0.26, 0.3, 0.9, -0.1, 1.1];
    let points: Vec<Point> = xs.into_iter().map(|x| Point::new(x, 0.21, -0.37)).collect();
    let (found, report) = of_formula(&FOLDED, &domain, &points);
    for (x, preimage) in xs.into_iter().zip(&found) {
        let (status, count) = match x {
            0.0..0.25 => (PreimageStatus::Folded, 2),
            0.25..1.0 => (PreimageStatus::Ok, 1),
            _ => (PreimageStatus::Outside, 0),
        };
        assert_eq!((preimage.status, preimage.preimages), (status, count), "{x}");
        if count > 0 {
            // The residual, over the slope of the fold.
            assert!((preimage.point.x - x.sqrt()).abs() < 1e-9 / x.sqrt(), "{x}");
        }
    }
    assert_eq!((report.folded, report.several, report.ok, report.outside), (5, 5, 3, 2));
}

#[test]
fn a_preimage_where_the_map_is_inverted_is_folded() {
    // For x from -1 to 0.5 the map inverts the greater part, so that the smaller one counts as the fold.
    let domain = shapes::deformed(&shapes::cube(1.5, 6), |p| p - Vector::new(0.25, 0.0, 0.0));
    let (found, _) = of_formula(
        &FOLDED,
        &domain,
        &[Point::new(0.5, 0.1, 0.1), Point::new(0.1, 0.1, 0.1)],
    );
    assert_eq!(statuses(&found), [PreimageStatus::Ok, PreimageStatus::Folded]);
    assert!(found[1].point.x < 0.0);
}

/// The identity, but for a cube around the origin that is shifted out of the target: like a fold that the search
/// missed.
const TORN: Formula = Formula {
    value: |p| match p.coords.amax() < 0.4 {
        true => p + Vector::new(2.0, 0.0, 0.0),
        false => *p,
    },
    jacobian: |_| Matrix3::identity(),
};

#[test]
fn a_single_preimage_of_a_point_far_outside_the_target_is_folded() {
    let domain = shapes::cube(1.0, 6);
    let points = [Point::new(2.3, 0.01, 0.02), Point::new(0.46, 0.01, 0.02)];
    let (found, report) = of_formula(&TORN, &domain, &points);
    assert_eq!(statuses(&found), [PreimageStatus::Folded, PreimageStatus::Ok]);
    assert_eq!((found[0].preimages, report.several, report.folded), (1, 0, 1));
    assert!((found[0].point - Point::new(0.3, 0.01, 0.02)).norm() < 1e-9);
}

/// Next to x = 0.01 a residual of 1.7e-5 leaves preimages undetermined by up to 1e-3.
#[test]
fn preimages_within_the_tolerance_of_each_other_are_no_fold() {
    let domain = shapes::deformed(&shapes::cube(0.99, 6), |p| p + Vector::new(0.505, 0.0, 0.0));
    let mut points = interior_points(&domain, 200, 7);
    points.extend([0.0101, 0.011, 0.012, 0.015, 0.02, 0.03].map(|x| Point::new(x, 0.1, -0.2)));
    let options = InverseOptions {
        tolerance: 1e-5,
        ..InverseOptions::default()
    };
    let boundary = boundary_map(&domain, FOLDED.value);
    let inverse = InverseMap::new(&FOLDED, &boundary, &options).unwrap();
    let (_, report) = inverse.preimages(&FOLDED.evaluate(&points));
    assert_eq!((report.folded, report.ok), (0, 206));
}

/// The domain begins at x = -0.02, and the preimages are at x = ±0.03: the negative one is in the gap that boundary
/// data off by 0.01 leave.
#[test]
fn a_preimage_in_the_domain_counts_before_those_in_the_gap() {
    let domain = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(1.02 * p.x + 0.49, p.y, p.z));
    let boundary = boundary_map(&domain, |p| (FOLDED.value)(p) - Vector::new(0.01, 0.0, 0.0));
    let (found, _) = preimages(&FOLDED, &boundary, &[Point::new(0.0009, 0.25, 0.0)]);
    assert_eq!((found[0].status, found[0].preimages), (PreimageStatus::Ok, 1));
    assert!(!found[0].beyond_boundary && (found[0].point.x - 0.03).abs() < 1e-7);
}

#[test]
fn a_search_that_is_cut_short_has_not_converged() {
    let domain = shapes::cube(1.0, 6);
    let points: Vec<Point> = interior_points(&domain, 100, 8).iter().map(|p| p * 0.8).collect();
    let options = InverseOptions {
        iterations: 1,
        ..InverseOptions::default()
    };
    let boundary = boundary_map(&domain, TWISTED.value);
    let inverse = InverseMap::new(&TWISTED, &boundary, &options).unwrap();
    let (found, report) = inverse.preimages(&TWISTED.evaluate(&points));
    assert_eq!((report.not_converged, report.ok), (100, 0));
    assert!(
        found
            .iter()
            .all(|p| p.status == PreimageStatus::NotConverged && p.preimages == 0)
    );
    // A node of the seed mesh, whose cells are 1/31 wide.
    assert!(largest_distance(&places(&found), &points) < 0.1);
}

/// Coordinates of 1e7 have a spacing of 1.9e-9: a tolerance of 1.7e-10 can only be met by chance.
#[test]
fn tolerances_below_rounding_are_raised_to_it() {
    const FAR: Formula = Formula {
        value: |p| p + Vector::repeat(1e7),
        jacobian: |_| Matrix3::identity(),
    };
    let domain = shapes::cube(1.0, 6);
    let points = interior_points(&domain, 300, 9);
    let (found, report) = of_formula(&FAR, &domain, &FAR.evaluate(&points));
    assert_eq!(report.ok, 300);
    assert!(largest_distance(&places(&found), &points) < 4e-8);

    let options = InverseOptions {
        tolerance: 1e-18,
        ..InverseOptions::default()
    };
    let boundary = boundary_map(&domain, AFFINE.value);
    let inverse = InverseMap::new(&AFFINE, &boundary, &options).unwrap();
    let (found, report) = inverse.preimages(&AFFINE.evaluate(&points));
    assert_eq!(report.ok, 300);
    assert!(largest_distance(&places(&found), &points) < 1e-13);
}

#[test]
fn thin_parts_that_the_lattice_misses_are_found() {
    let plate = shapes::deformed(&shapes::cube(1.0, 12), |p| Point::new(p.x, p.y, 0.004 * p.z));
    let ball = shapes::deformed(&shapes::sphere(1.0, 3), |p| p + Vector::new(3.0, 0.0, 0.0));
    let domain = shapes::joined(&plate, &ball);
    let across = |k: usize| -0.45 + 0.9 * (k % 20) as f64 / 19.0;
    let in_plate = (0..400).map(|k| Point::new(across(k), across(k / 20), 0.0015));
    let points: Vec<Point> = in_plate.chain(interior_points(&ball, 400, 5)).collect();
    let (found, report) = of_formula(&TWISTED, &domain, &TWISTED.evaluate(&points));
    assert_eq!(report.ok, 800);
    assert!(largest_distance(&places(&found), &points) < 1e-8);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let domain = shapes::torus(0.5, 0.2, 30, 15);
    let points = TWISTED.evaluate(&interior_points(&domain, 3000, 6));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| of_formula(&TWISTED, &domain, &points))
    };
    let ((one, mut first), (four, second)) = (run(1), run(4));
    assert_eq!(one, four);
    (first.seconds, first.seed_seconds) = (second.seconds, second.seed_seconds);
    assert_eq!(first, second);
}

#[test]
fn settings_out_of_range_and_maps_without_values_are_refused() {
    let boundary = boundary_map(&shapes::cube(1.0, 2), AFFINE.value);
    for tolerance in [0.0, -1.0, 2e-3, f64::NAN, f64::INFINITY] {
        let options = InverseOptions {
            tolerance,
            ..InverseOptions::default()
        };
        let error = InverseMap::new(&AFFINE, &boundary, &options).err();
        assert!(matches!(
            error,
            Some(InverseError::Option {
                option: "tolerance",
                ..
            })
        ));
    }
    let nowhere = Formula {
        value: |_| Point::from([f64::NAN; 3]),
        jacobian: |_| Matrix3::repeat(f64::NAN),
    };
    let error = InverseMap::new(&nowhere, &boundary, &InverseOptions::default()).err();
    assert_eq!(error, Some(InverseError::NoValues));
}
