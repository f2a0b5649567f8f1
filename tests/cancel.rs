//! Callbacks can cancel work at any point, and what was there before stays usable.

use std::cell::{Cell, RefCell};
use std::ops::ControlFlow;

use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::pair::{PairError, PairOptions, PairPhase, map_pair};
use solidmap::certificate::{CertificateError, CertificateOptions, certify};
use solidmap::fit::{DomainFactor, FitError, FitOptions, Phase, RefinementEnd, fit};
use solidmap::inverse::{InverseError, InverseMap, InverseOptions};
use solidmap::mesh::shapes;
use solidmap::progress::ProgressControl;
use solidmap::remesh::{CellKind, CellSize, RemeshError, RemeshOptions, RemeshSource, remesh};
use solidmap::spherical::{SphereOptions, SpherePhase, map_to_sphere};
use solidmap::{Point, Vector};

/// A cube that becomes a ball: two rounds of refinement.
fn rounded_cube() -> BoundaryMap {
    let domain = shapes::cube(2.0, 8);
    let image = domain.vertices().iter().map(|p| p.coords.normalize().into()).collect();
    BoundaryMap::new(domain, image).unwrap()
}

/// Counts the calls of a callback, and breaks after `calls` of them.
fn break_after(calls: usize, count: &Cell<usize>) -> ControlFlow<()> {
    count.set(count.get() + 1);
    if count.get() > calls {
        ControlFlow::Break(())
    } else {
        ControlFlow::Continue(())
    }
}

#[test]
fn a_fit_can_be_cancelled_at_every_call_of_its_callback() {
    let boundary = rounded_cube();
    let calls = Cell::new(0);
    let whole = fit(&boundary, &FitOptions::default(), &|_| calls.set(calls.get() + 1)).unwrap();
    assert!(
        whole.report.refinements > 0 && calls.get() > 10,
        "{} calls",
        calls.get()
    );
    for last in 0..calls.get() {
        let count = Cell::new(0);
        let ended = fit(&boundary, &FitOptions::default(), &|_| break_after(last, &count));
        assert!(matches!(ended, Err(FitError::Cancelled)), "after {last} calls");
        assert_eq!(count.get(), last + 1, "called again after it broke off");
    }
}

#[test]
fn a_factor_solves_as_before_after_a_cancelled_refinement() {
    let boundary = rounded_cube();
    let mut factor = DomainFactor::new(boundary.domain(), &FitOptions::default(), &|_| {}).unwrap();
    let before = factor.solve(&boundary, &|_| {}).unwrap();
    let ended = factor.solve_refined(&boundary, &|phase| match phase {
        Phase::Factoring { .. } => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    assert!(matches!(ended, Err(FitError::Cancelled)));
    let after = factor.solve(&boundary, &|_| {}).unwrap();
    assert_eq!(after.map.coefficients(), before.map.coefficients());
    let refined = factor.solve_refined(&boundary, &|_| {}).unwrap();
    assert!(refined.report.boundary_error.p99 <= 1e-3);
}

#[test]
fn remeshing_can_be_cancelled_in_repair_and_polish() {
    let boundary = rounded_cube();
    let map = fit(&boundary, &FitOptions::default(), &|_| {}).unwrap().map;
    let source = RemeshSource::Regular {
        kind: CellKind::Hexes,
        size: CellSize::Along(20),
        most_cells: 100_000,
    };
    let options = RemeshOptions {
        polish_valid: true,
        ..RemeshOptions::default()
    };
    let calls = Cell::new(0);
    remesh(&boundary, &map, source.clone(), &options, &|_| {
        calls.set(calls.get() + 1)
    })
    .unwrap();
    // The work is done on other threads, and the callback called ten times in a second.
    assert!(calls.get() > 10, "{} calls", calls.get());
    for last in [0, 1, 2, 3, calls.get() / 2] {
        let count = Cell::new(0);
        let ended = remesh(&boundary, &map, source.clone(), &options, &|_| {
            break_after(last, &count)
        });
        // Calls are counted by the clock: a run that is twice as fast as the first ends before.
        if last > 3 && count.get() <= last {
            assert!(ended.is_ok(), "{} calls, to end after {last}", count.get());
            continue;
        }
        assert!(matches!(ended, Err(RemeshError::Cancelled)), "after {last} calls");
        assert_eq!(count.get(), last + 1, "called again after it broke off");
    }
}

#[test]
fn mapping_a_pair_can_be_cancelled_between_its_steps() {
    let target = shapes::deformed(&shapes::sphere(1.0, 2), |p| p + Vector::new(0.0, 0.0, 0.2 * p.x * p.x));
    let domain = shapes::cube(2.0, 4);
    let phases = RefCell::new(vec![]);
    let ended = map_pair(&domain, &target, &PairOptions::default(), &|phase| {
        phases.borrow_mut().push(phase);
        ControlFlow::Break(())
    });
    assert!(matches!(ended, Err(PairError::Cancelled)));
    assert!(phases.borrow().len() < 20);
}

#[test]
fn a_dense_decomposition_is_left_behind_when_it_is_cancelled() {
    let ball = shapes::sphere(1.0, 4);
    let boundary = BoundaryMap::new(ball.clone(), ball.vertices().to_vec()).unwrap();
    let polls = Cell::new(0);
    // Seconds of work, so that the callback is called in the middle of it.
    let ended = fit(&boundary, &FitOptions::paper(), &|phase| match phase {
        Phase::Decomposing { rows, columns } => {
            assert!(rows >= columns);
            break_after(2, &polls)
        }
        _ => ControlFlow::Continue(()),
    });
    assert!(matches!(ended, Err(FitError::Cancelled)));
    assert_eq!(polls.get(), 3);
}

#[test]
fn a_search_for_preimages_can_be_cancelled_at_every_call_of_its_callback() {
    let boundary = rounded_cube();
    let map = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap().map;
    let inverse = InverseMap::new(&map, &boundary, &InverseOptions::default()).unwrap();
    let points: Vec<Point> = (0..200).map(|k| Point::new(0.004 * f64::from(k), 0.1, 0.2)).collect();
    let calls = Cell::new(0);
    let whole = inverse
        .preimages_with_progress(&points, &|_| calls.set(calls.get() + 1))
        .unwrap();
    assert_eq!(whole.0, inverse.preimages(&points).0);
    assert!(calls.get() > 3, "{} calls", calls.get());
    for last in 0..calls.get() {
        let count = Cell::new(0);
        let ended = inverse.preimages_with_progress(&points, &|_| break_after(last, &count));
        assert_eq!(ended, Err(InverseError::Cancelled), "after {last} calls");
        assert_eq!(count.get(), last + 1, "called again after it broke off");
    }
}

#[test]
fn a_certificate_can_be_cancelled_at_every_call_of_its_callback() {
    let boundary = rounded_cube();
    let map = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap().map;
    let options = CertificateOptions {
        finest: 64,
        ..CertificateOptions::default()
    };
    let certified = |progress: &dyn Fn() -> ControlFlow<()>| {
        certify(&map, boundary.domain(), boundary.target_volume(), &options, &|_| {
            progress()
        })
    };
    let calls = Cell::new(0);
    assert!(certified(&|| break_after(usize::MAX, &calls)).is_ok());
    assert!(calls.get() > 3, "{} calls", calls.get());
    for last in 0..calls.get() {
        let count = Cell::new(0);
        let ended = certified(&|| break_after(last, &count)).map(|certificate| certificate.cells().len());
        assert_eq!(ended, Err(CertificateError::Cancelled), "after {last} calls");
    }
}

/// Asks for the best result from the first call on for which this holds.
fn conclude_from<T>(first: impl Fn(&T) -> bool) -> impl Fn(T) -> ProgressControl {
    let concluded = Cell::new(false);
    move |phase| {
        concluded.set(concluded.get() || first(&phase));
        if concluded.get() {
            ProgressControl::Conclude
        } else {
            ProgressControl::Continue
        }
    }
}

#[test]
fn a_fit_can_be_concluded_with_the_best_map_so_far() {
    let boundary = rounded_cube();
    let options = FitOptions::default();
    let coarse = FitOptions {
        refine: false,
        ..options
    };
    let unrefined = fit(&boundary, &coarse, &|_| ()).unwrap();
    // Whether it is asked for at once or in the refinement, the first map is the result.
    let at_once = fit(&boundary, &options, &|_| ProgressControl::Conclude).unwrap();
    let refining = conclude_from(|phase| matches!(phase, Phase::Refining { .. }));
    let later = fit(&boundary, &options, &refining).unwrap();
    for concluded in [at_once, later] {
        assert_eq!(concluded.report.refinement_end, Some(RefinementEnd::Concluded));
        assert_eq!(concluded.map.coefficients(), unrefined.map.coefficients());
        assert_eq!(concluded.report.boundary_error, unrefined.report.boundary_error);
    }
}

#[test]
fn a_map_of_a_pair_can_be_concluded_at_any_phase_and_is_a_bijection() {
    let domain = shapes::bumpy_sphere(10);
    let target = shapes::deformed(&domain, |p| [1.5 * p.x, p.y + 0.3 * p.x * p.x, p.z].into());
    let options = PairOptions::default();
    let (_, whole) = map_pair(&domain, &target, &options, &|_| ()).unwrap();
    assert!(!whole.concluded);
    for k in 0..5 {
        let progress = conclude_from(move |phase| match phase {
            PairPhase::Sphere(..)
            | PairPhase::Tori
            | PairPhase::HyperbolicSurface
            | PairPhase::Reversed
            | PairPhase::Shell { .. } => k == 0,
            PairPhase::Aligning { .. } | PairPhase::Intrinsic { .. } => k == 1,
            PairPhase::CoarseEmbeddings { .. } => k == 2,
            // This domain has all its vertices in the coarse embeddings.
            PairPhase::Refining { .. } | PairPhase::Improving { .. } => k == 3,
            PairPhase::Measuring { .. } => k == 4,
        });
        // Bijections of both surfaces with the sphere are checked exactly when they are made.
        let (map, report) = map_pair(&domain, &target, &options, &progress).unwrap();
        assert!(map.domain_embedding().is_some(), "phase {k}");
        // Measuring comes after all that could have been better.
        assert_eq!(report.concluded, k < 4, "phase {k}");
        let [found, best] = [&report, &whole].map(|report| report.after.mean_symmetric_dirichlet);
        assert!(
            found.is_finite() && found > 0.99 * best,
            "phase {k}: {found}, and {best} in the end"
        );
    }
}

#[test]
fn a_map_to_the_sphere_can_be_concluded() {
    let surface = shapes::bumpy_sphere(10);
    let options = SphereOptions::default();
    let (_, whole) = map_to_sphere(&surface, &options, &|_| ()).unwrap();
    let optimising = conclude_from(|phase| matches!(phase, SpherePhase::Optimising { .. }));
    let (_, report) = map_to_sphere(&surface, &options, &optimising).unwrap();
    assert!(report.concluded && !whole.concluded && report.iterations < whole.iterations);
}
