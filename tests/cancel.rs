//! Callbacks can cancel work at any point, and what was there before stays usable.

use std::cell::{Cell, RefCell};
use std::ops::ControlFlow;

use solidmap::Vector;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::pair::{PairError, PairOptions, map_pair};
use solidmap::fit::{DomainFactor, FitError, FitOptions, Phase, fit};
use solidmap::mesh::shapes;
use solidmap::remesh::{CellKind, CellSize, RemeshError, RemeshOptions, RemeshSource, remesh};

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
        size: CellSize::Along(8),
        most_cells: 100_000,
    };
    let (options, calls) = (RemeshOptions::default(), Cell::new(0));
    remesh(&boundary, &map, source.clone(), &options, &|_| {
        calls.set(calls.get() + 1)
    })
    .unwrap();
    assert!(calls.get() > 30, "{} calls", calls.get());
    for last in [0, 1, 2, 5, calls.get() / 2, calls.get() - 2] {
        let count = Cell::new(0);
        let ended = remesh(&boundary, &map, source.clone(), &options, &|_| {
            break_after(last, &count)
        });
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
