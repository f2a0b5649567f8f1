//! Fits with free sources: better than with fixed ones of the same number, outside the domain, never worse, and refused where they
//! take too long.

use std::cell::{Cell, RefCell};
use std::ops::ControlFlow;

use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{
    DomainFactor, Fit, FitError, FitMethod, FitOptions, FreeSourcesEnd, MOST_FREE_SOURCES, Phase, Placement,
    RefinementEnd, fit,
};
use solidmap::geometry::SurfaceQuery;
use solidmap::map::VolumeMap;
use solidmap::mesh::{SurfaceMesh, SurfacePoint, shapes};
use solidmap::progress::ProgressControl;
use solidmap::solver::{Decomposition, DenseOptions};
use solidmap::{Point, Vector};

use crate::common::{boundary_map, fitted, interior_points, largest_distance};

/// Potentials of charges at some distance from the solids here, of a diagonal of some 3.
fn charges(p: &Point) -> Point {
    let potential = |x, y, z| 1.0 / (p - Point::new(x, y, z)).norm();
    Point::new(
        potential(1.9, 0.5, 0.3) - potential(-1.4, 1.2, 0.0),
        potential(0.3, 1.9, -0.5),
        potential(1.0, -1.0, 1.4) + 0.5 * potential(0.0, 0.0, -1.8),
    )
}

/// The boundary map by a function at every point of the boundary: nothing but the sources limits the fit.
fn by_function(domain: &SurfaceMesh, f: fn(&Point) -> Point) -> BoundaryMap {
    let points: Vec<Point> = domain.vertices().iter().map(f).collect();
    let start = (points[0], points[0]);
    let bounds = points.iter().fold(start, |(low, high), p| (low.inf(p), high.sup(p)));
    let surface = domain.clone();
    let value = move |p: &SurfacePoint| f(&p.position(&surface, surface.vertices()));
    BoundaryMap::by_function(domain.clone(), bounds, value).unwrap()
}

fn options(sources: usize, free_sources: bool) -> FitOptions {
    FitOptions {
        max_sources: sources,
        free_sources,
        ..FitOptions::with_free_sources()
    }
}

fn rounded_cube() -> BoundaryMap {
    boundary_map(&shapes::cube(2.0, 8), |p| p.coords.normalize().into())
}

fn assert_outside(domain: &SurfaceMesh, fit: &Fit, least: f64) {
    let query = SurfaceQuery::new(domain).unwrap();
    for q in fit.map.sources() {
        let distance = query.signed_distance(q);
        assert!(distance > least, "a source is {distance} from the surface");
    }
}

#[test]
fn the_error_inside_is_below_that_with_as_many_fixed_sources() {
    for domain in [
        shapes::sphere(1.0, 3),
        shapes::bumpy_sphere(12),
        shapes::torus(0.8, 0.3, 40, 20),
        shapes::spherical_shell(1.0, 0.5, 3),
    ] {
        let boundary = by_function(&domain, charges);
        let inside = interior_points(&domain, 500, 3);
        let exact: Vec<Point> = inside.iter().map(charges).collect();
        let [fixed, free] = [false, true].map(|free| fitted(&boundary, &options(60, free)));
        assert_eq!(fixed.map.sources().len(), free.map.sources().len());
        let error = |fit: &Fit| largest_distance(&fit.map.evaluate(&inside), &exact);
        let (before, after) = (error(&fixed), error(&free));
        let moved = free.report.free_sources.unwrap();
        assert!(moved.kept && moved.rounds > 1, "{moved:?}");
        assert_eq!(moved.boundary_error_before, fixed.report.boundary_error);
        assert!(moved.residual_after < 0.5 * moved.residual_before, "{moved:?}");
        assert!(free.report.boundary_error.p99 < 0.5 * fixed.report.boundary_error.p99);
        assert!(after < 0.5 * before, "{before:e} to {after:e}");
        // The collocation points are some 0.2 apart at least.
        assert_outside(&domain, &free, 0.05);
    }
}

/// The callback hears of the residual in every round.
#[test]
fn every_round_lowers_the_residual() {
    let residuals = RefCell::new(vec![]);
    let found = fit(&rounded_cube(), &options(80, true), &|phase| {
        if let Phase::MovingSources { residual, .. } = phase {
            residuals.borrow_mut().push(residual);
        }
    });
    let moved = found.unwrap().report.free_sources.unwrap();
    // While a round lasts, its report is repeated.
    let mut residuals = residuals.into_inner();
    residuals.dedup();
    residuals.push(moved.residual_after);
    residuals.dedup();
    assert!(residuals.len() > moved.rounds, "{residuals:?}, {moved:?}");
    assert!(residuals.windows(2).all(|pair| pair[1] < pair[0]), "{residuals:?}");
    assert_eq!(residuals[0], moved.residual_before);
}

/// Sources on a sphere are nearly dependent, and those of the paper's decomposition are found by another solver.
#[test]
fn sources_are_free_whatever_the_placement_and_the_decomposition() {
    let boundary = by_function(&shapes::bumpy_sphere(12), charges);
    for (placement, decomposition) in [
        (Placement::Sphere { radius: 0.7 }, Decomposition::Qr),
        (Placement::Adaptive { alpha: 1.0 }, Decomposition::Svd),
    ] {
        let method = FitMethod::Dense {
            placement,
            options: DenseOptions {
                decomposition,
                ..DenseOptions::default()
            },
        };
        let with = |free_sources| FitOptions {
            method,
            ..options(50, free_sources)
        };
        let [fixed, free] = [false, true].map(|free| fitted(&boundary, &with(free)));
        let (a, b) = (fixed.report.boundary_error.p99, free.report.boundary_error.p99);
        assert!(b < 0.7 * a, "{placement:?}: {a:e} to {b:e}");
        assert!(free.report.residual_rms < fixed.report.residual_rms);
    }
}

#[test]
fn affine_maps_leave_sources_where_they_are() {
    let boundary = boundary_map(&shapes::cube(1.0, 5), |p| Point::new(2.0 * p.x, p.y + 0.5 * p.z, p.z));
    let [fixed, free] = [false, true].map(|free| fitted(&boundary, &options(40, free)));
    let moved = free.report.free_sources.unwrap();
    assert_eq!((moved.rounds, moved.end), (0, FreeSourcesEnd::Converged));
    assert_eq!(free.map.sources(), fixed.map.sources());
}

#[test]
fn the_same_fit_gives_the_same_bits() {
    let boundary = rounded_cube();
    let [first, second] = [(); 2].map(|()| fitted(&boundary, &options(60, true)));
    assert_eq!(first.map.sources(), second.map.sources());
    assert!(first.map.coefficients() == second.map.coefficients());
    assert_eq!(first.report.free_sources, second.report.free_sources);
}

/// In any unit of length the same sources are moved to the same places, up to rounding that the descent amplifies.
#[test]
fn the_unit_of_length_does_not_matter() {
    let domain = shapes::bumpy_sphere(10);
    let boundary = boundary_map(&domain, charges);
    let scaled = BoundaryMap::new(shapes::deformed(&domain, |p| p * 1024.0), boundary.image().to_vec()).unwrap();
    let [a, b] = [&boundary, &scaled].map(|boundary| fitted(boundary, &options(50, true)).report);
    assert!(
        (a.boundary_error.rms / b.boundary_error.rms - 1.0).abs() < 0.02,
        "{a:?} {b:?}"
    );
}

/// After a fit that moved them, other boundary maps are solved for with the moved sources.
#[test]
fn a_factor_keeps_the_moved_sources() {
    let boundary = rounded_cube();
    let mut factor = DomainFactor::new(boundary.domain(), &options(60, true), &|_| {}).unwrap();
    let placed = factor.solve(&boundary, &|_| {}).unwrap();
    assert_eq!(placed.report.free_sources, None);
    let moved = factor.solve_refined(&boundary, &|_| {}).unwrap();
    assert!(moved.map.sources() != placed.map.sources());
    let again = factor.solve(&boundary, &|_| {}).unwrap();
    assert_eq!(again.map.sources(), moved.map.sources());
    assert!(again.map.coefficients() == moved.map.coefficients());
    assert_eq!(again.report.boundary_error, moved.report.boundary_error);
}

#[test]
fn moving_can_be_cancelled_and_leaves_the_factor_as_it_was() {
    let boundary = rounded_cube();
    let mut factor = DomainFactor::new(boundary.domain(), &options(60, true), &|_| {}).unwrap();
    let before = factor.solve(&boundary, &|_| {}).unwrap();
    for last in [1, 3] {
        let (count, ended) = (Cell::new(0), Cell::new(false));
        let result = factor.solve_refined(&boundary, &|phase| {
            assert!(!ended.get(), "called again after it broke off");
            if matches!(phase, Phase::MovingSources { .. }) {
                count.set(count.get() + 1);
            }
            ended.set(count.get() == last);
            match ended.get() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        });
        assert!(matches!(result, Err(FitError::Cancelled)));
    }
    let after = factor.solve(&boundary, &|_| {}).unwrap();
    assert_eq!(after.map.sources(), before.map.sources());
    assert!(after.map.coefficients() == before.map.coefficients());
}

#[test]
fn a_concluded_fit_has_the_best_positions_so_far() {
    let boundary = rounded_cube();
    let concluded = |round: usize| {
        let found = fit(&boundary, &options(60, true), &|phase| match phase {
            Phase::MovingSources { round: at, .. } if at >= round => ProgressControl::Conclude,
            _ => ProgressControl::Continue,
        });
        found.unwrap().report
    };
    let whole = fitted(&boundary, &options(60, true)).report.free_sources.unwrap();
    assert!(whole.rounds > 3);
    for round in [1, 3] {
        let report = concluded(round);
        let moved = report.free_sources.unwrap();
        assert_eq!(report.refinement_end, Some(RefinementEnd::Concluded));
        assert_eq!(moved.end, FreeSourcesEnd::Concluded);
        // A round that was under way when the callback was asked is finished.
        assert!((round - 1..=round).contains(&moved.rounds), "{moved:?}");
        assert!(moved.residual_after >= whole.residual_after);
    }
}

#[test]
fn what_does_not_pay_is_refused() {
    let domain = shapes::sphere(1.0, 5);
    let refused = |options: &FitOptions| DomainFactor::new(&domain, options, &|_| {}).err();
    let too_many = options(MOST_FREE_SOURCES + 1, true);
    let Some(FitError::TooManyFreeSources { sources, most }) = refused(&too_many) else {
        panic!("{MOST_FREE_SOURCES} are the most");
    };
    assert_eq!((sources, most), (MOST_FREE_SOURCES + 1, MOST_FREE_SOURCES));
    let iterative = FitOptions {
        free_sources: true,
        max_sources: 100,
        ..FitOptions::default()
    };
    assert!(matches!(refused(&iterative), Some(FitError::FreeSourcesNeedDense)));
    let few_points = FitOptions {
        collocation_ratio: 1.9,
        ..options(100, true)
    };
    let error = refused(&few_points);
    assert!(
        matches!(
            error,
            Some(FitError::Option {
                option: "collocation_ratio",
                ..
            })
        ),
        "{error:?}"
    );
    let little_memory = FitOptions {
        memory: Some(200_000_000),
        ..options(600, true)
    };
    assert!(matches!(refused(&little_memory), Some(FitError::TooLarge { .. })));
    let fixed = FitOptions {
        free_sources: false,
        ..little_memory
    };
    assert!(refused(&fixed).is_none());
}

/// Sources in a gap of a twentieth of the diagonal stand nearer to the surface than the others, and stay in it.
#[test]
fn sources_in_a_gap_stay_outside() {
    let ball = shapes::sphere(1.0, 3);
    let cup = shapes::deformed(&ball, |p| {
        let dent = (1.0 - (p.x * p.x + p.y * p.y) / 0.15).max(0.0);
        match p.z > 0.0 {
            true => p - Vector::z() * 1.2 * dent,
            false => *p,
        }
    });
    let boundary = by_function(&cup, |p| Point::new(p.x, p.y, (p.z + 0.3 * p.x).abs()));
    let fit = fitted(&boundary, &options(200, true));
    assert!(fit.report.free_sources.unwrap().residual_after < fit.report.free_sources.unwrap().residual_before);
    assert_outside(&cup, &fit, 1e-3);
}
