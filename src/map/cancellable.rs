use std::ops::ControlFlow;

use super::VolumeMap;
use crate::progress::{ProgressResponse, ProgressSender, run_cancellable};
use crate::{Matrix3, Point};

/// Work with a map was cancelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled by the progress callback")]
pub struct Cancelled;

/// Runs work whose time goes into evaluating a map, such as [`energies`](crate::energy::energies), so that it can be
/// cancelled.
///
/// The work runs on rayon's threads, and `progress` is called ten times in a second on this one. When it cancels, the map
/// that the work was given answers NaN to everything, which ends the work soon after, and its result is dropped. An
/// evaluation that has begun is not interrupted: a million points with 100 000 sources take about a second.
///
/// ```
/// use std::ops::ControlFlow;
/// use solidmap::boundary_map::BoundaryMap;
/// use solidmap::energy::{AdaptiveOptions, EnergyOptions, adaptive_energies};
/// use solidmap::fit::{FitOptions, fit};
/// use solidmap::map::{Cancelled, with_cancellation};
/// use solidmap::mesh::shapes;
///
/// let domain = shapes::sphere(1.0, 2);
/// let boundary = BoundaryMap::new(domain.clone(), domain.vertices().to_vec())?;
/// let map = fit(&boundary, &FitOptions::default(), &|_| ())?.map;
/// let cancel = || ControlFlow::Break(());
/// let measured = with_cancellation(&map, &cancel, |map| {
///     let (options, accuracy) = (EnergyOptions::default(), AdaptiveOptions::default());
///     adaptive_energies(map, &domain, boundary.target_volume(), &options, &accuracy)
/// });
/// assert_eq!(measured.err(), Some(Cancelled));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`Cancelled`].
pub fn with_cancellation<R: Send, A: ProgressResponse>(
    map: &dyn VolumeMap,
    progress: &dyn Fn() -> A,
    work: impl FnOnce(&dyn VolumeMap) -> R + Send,
) -> Result<R, Cancelled> {
    if progress().control_flow().is_break() {
        return Err(Cancelled);
    }
    run_cancellable(&|()| progress().control(), |sender| {
        let _: ControlFlow<()> = sender.send(());
        work(&CancellableMap { map, sender })
    })
    .ok_or(Cancelled)
}

/// A map that answers NaN once it is cancelled.
struct CancellableMap<'a> {
    map: &'a dyn VolumeMap,
    sender: &'a ProgressSender<'a, ()>,
}

impl VolumeMap for CancellableMap<'_> {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        if self.sender.should_continue() {
            self.map.evaluate(points)
        } else {
            vec![Point::from([f64::NAN; 3]); points.len()]
        }
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        if self.sender.should_continue() {
            self.map.jacobian(points)
        } else {
            vec![Matrix3::from_element(f64::NAN); points.len()]
        }
    }

    fn evaluate_with_jacobian(&self, points: &[Point]) -> (Vec<Point>, Vec<Matrix3>) {
        if self.sender.should_continue() {
            self.map.evaluate_with_jacobian(points)
        } else {
            (self.evaluate(points), self.jacobian(points))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// The identity, which counts its calls.
    #[derive(Default)]
    struct Counted(AtomicUsize);

    impl VolumeMap for Counted {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            self.0.fetch_add(1, Ordering::Relaxed);
            points.to_vec()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            self.0.fetch_add(1, Ordering::Relaxed);
            vec![Matrix3::identity(); points.len()]
        }
    }

    #[test]
    fn a_cancelled_map_is_evaluated_no_more() {
        let (map, asked) = (Counted::default(), std::cell::Cell::new(0));
        let points = [Point::origin(); 4];
        let progress = || {
            asked.set(asked.get() + 1);
            match asked.get() {
                ..3 => ControlFlow::Continue(()),
                _ => ControlFlow::Break(()),
            }
        };
        let answered = AtomicUsize::new(0);
        let ended = with_cancellation(&map, &progress, |map| {
            while !map.evaluate(&points)[3].x.is_nan() {
                std::thread::yield_now();
            }
            let known = map.evaluate_with_jacobian(&points);
            assert!(known.0[0].y.is_nan() && known.1[3].iter().all(|x| x.is_nan()));
            answered.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!((ended, asked.get(), answered.into_inner()), (Err(Cancelled), 3, 1));
        let done = with_cancellation(&map, &|| (), |map| map.jacobian(&points).len());
        assert_eq!(done, Ok(4));
        let calls = map.0.into_inner();
        let never = with_cancellation(&Counted::default(), &|| ControlFlow::Break(()), |_| 0);
        assert!(calls > 1 && never == Err(Cancelled));
    }
}
