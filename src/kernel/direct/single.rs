//! Values of the kernel in single precision, twice as many at once, for points that lie together: relative to their
//! middle, coordinates lose `10⁻⁷` of the points' extent, which is little of a distance unless it is short beside that.

use std::f64::consts::PI;

use super::loops::{self, BlockValues, LANES, SingleSource, TargetBlock};
use super::{Instructions, KernelError, require_length};
use crate::Point;

/// Largest `1/r` in single precision, in units in which points are about one apart: beyond, it may be wrong by more than
/// `2·10⁻⁵` of itself.
const LARGEST: f32 = 128.0;

/// The middle of some points' box, and the reciprocal of half its largest side.
struct Frame {
    centre: Point,
    up: f64,
}

impl Frame {
    /// `None` where points or the reciprocal leave the range of `f32`.
    fn of(points: &[Point], others: &[Point]) -> Option<Self> {
        let mut points = points.iter().chain(others);
        let first = *points.next()?;
        let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
        let up = 2.0 / (high - low).amax();
        let centre = low + 0.5 * (high - low);
        let is_in_range = (1e-30..1e30).contains(&up) && centre.iter().all(|c| c.is_finite());
        is_in_range.then_some(Self { centre, up })
    }

    fn unit(&self, p: &Point) -> [f32; 3] {
        ((p - self.centre) * self.up).map(|c| c as f32).into()
    }

    fn blocks(&self, targets: &[Point]) -> Vec<TargetBlock<f32>> {
        let blocks = targets.chunks(LANES);
        blocks.map(|t| TargetBlock::mapped(t, |p| self.unit(p))).collect()
    }
}

/// Adds the potential of three weights at each block of targets, in units in which points are about one apart. `false`
/// where that needs double precision, and what is added is of no use.
pub(in crate::kernel) fn add_near_potential_in_single(
    instructions: Instructions,
    sources: &[SingleSource],
    targets: &[TargetBlock<f32>],
    sums: &mut [[BlockValues; 3]],
) -> bool {
    let largest = loops::add_potential_in_single(instructions, sources, targets, sums);
    largest <= LARGEST && sums.iter().flatten().flatten().all(|sum| sum.is_finite())
}

/// [`potential`](super::potential) of `weights` at `points`, with values of the kernel in single precision. `None` where
/// that needs double precision: two points are close, or coordinates leave its range.
///
/// On the calling thread.
///
/// # Errors
///
/// [`KernelError::LengthMismatch`] when there are not as many weights as points.
pub(crate) fn potential_in_single(
    points: &[Point],
    weights: &[[f64; 3]],
    targets: &[Point],
) -> Result<Option<Vec<[f64; 3]>>, KernelError> {
    require_length("weights of sources", weights.len(), points.len())?;
    let Some(frame) = Frame::of(points, targets) else {
        return Ok(None);
    };
    let source = |(p, w): (&Point, &[f64; 3])| SingleSource {
        position: frame.unit(p),
        weights: *w,
    };
    let sources: Vec<SingleSource> = points.iter().zip(weights).map(source).collect();
    let blocks = frame.blocks(targets);
    let mut sums = vec![[[0.0; LANES]; 3]; blocks.len()];
    let are_right = add_near_potential_in_single(Instructions::detect(), &sources, &blocks, &mut sums);
    let up = frame.up / (4.0 * PI);
    let value = |i: usize| sums[i / LANES].map(|lanes| lanes[i % LANES] * up);
    Ok(are_right.then(|| (0..targets.len()).map(value).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use crate::kernel::direct;

    /// Two sheets, at a distance of a tenth of their extent, anywhere in space.
    fn sheets(scale: f64) -> [Vec<Point>; 2] {
        let point = |i: usize, z: f64| Point::new((i % 20) as f64, (i / 20) as f64 + 0.3 * z, z) * scale;
        let sheet = |count: usize, z: f64| (0..count).map(move |i| point(i, z) + Vector::new(70.0, -20.0, 5.0) * scale);
        [sheet(390, 0.0).collect(), sheet(270, 1.0).collect()]
    }

    /// One for each of the first sheet's points.
    fn weights(factor: f64) -> Vec<[f64; 3]> {
        (0..390)
            .map(|i| [0.0, 1.0, 2.0].map(|k| factor * (i as f64 + k).sin()))
            .collect()
    }

    /// Distances are rounded to `2·10⁻⁶` where they are least.
    #[test]
    fn the_potential_is_near_that_in_double_precision_unless_it_leaves_the_range() {
        for scale in [1e-60, 1e-3, 1.0, 1e60] {
            let [from, at] = sheets(scale);
            let potential = potential_in_single(&from, &weights(1.0), &at).unwrap();
            assert_eq!(potential.is_some(), [1e-3, 1.0].contains(&scale));
            let Some(potential) = potential else { continue };
            let potential_of =
                |weights: &[[f64; 3]]| direct::potential(&direct::Sources::new(&from, weights).unwrap(), &at);
            let (expected, sizes) = (potential_of(&weights(1.0)), potential_of(&[[1.0; 3]; 390]));
            for ((found, expected), size) in potential.iter().zip(&expected).zip(&sizes) {
                for k in 0..3 {
                    let error = (found[k] - expected[k]).abs() / size[k];
                    assert!(error < 3e-6 && error > 0.0, "{error:e}");
                }
            }
        }
    }

    /// To the digits of double precision, although values of the kernel have those of single.
    #[test]
    fn the_potential_is_linear_in_the_weights() {
        let [from, at] = sheets(1.0);
        let potential = |weights: &[[f64; 3]]| potential_in_single(&from, weights, &at).unwrap().unwrap();
        let expected = potential(&weights(1.0));
        let nearly = potential(&weights(1.0 + 1e-9));
        let large = potential(&weights(2f64.powi(300)));
        let size: f64 = 390.0 / (4.0 * PI);
        for i in 0..at.len() {
            for k in 0..3 {
                let growth = nearly[i][k] - expected[i][k];
                assert!((growth - 1e-9 * expected[i][k]).abs() < 1e-14 * size, "{growth:e}");
                assert_eq!(large[i][k], 2f64.powi(300) * expected[i][k]);
            }
        }
    }

    #[test]
    fn all_instructions_agree_to_single_precision() {
        let [from, at] = sheets(1.0 / 20.0);
        let frame = Frame::of(&from, &at).unwrap();
        let source = |(p, w): (&Point, &[f64; 3])| SingleSource {
            position: frame.unit(p),
            weights: *w,
        };
        let sources: Vec<SingleSource> = from.iter().zip(&weights(1.0)).map(source).collect();
        let blocks = frame.blocks(&at[..261]);
        let sums = Instructions::available().map(|instructions| {
            let mut sums = vec![[[0.0; LANES]; 3]; blocks.len()];
            let largest = loops::add_potential_in_single(instructions, &sources, &blocks, &mut sums);
            (largest, sums)
        });
        let sums: Vec<_> = sums.collect();
        let (largest, expected) = &sums[0];
        for (other_largest, other) in &sums[1..] {
            assert!((other_largest / largest - 1.0).abs() < 1e-6);
            // Lanes beyond the last target hold what the width of the vectors puts there.
            for target in 0..261 {
                let of_target = |sums: &[[BlockValues; 3]]| sums[target / LANES].map(|lanes| lanes[target % LANES]);
                let (values, expected) = (of_target(other), of_target(expected));
                let worst = values
                    .iter()
                    .zip(&expected)
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f64::max);
                assert!(worst < 1e-6 * 390.0, "{target}: {worst:e}");
            }
        }
    }

    #[test]
    fn points_that_are_close_or_not_finite_need_double_precision() {
        let [from, mut at] = sheets(1.0);
        for near in [
            from[7],
            from[7] + Vector::new(1e-3, 0.0, 0.0),
            Point::new(f64::NAN, 0.0, 0.0),
            Point::new(0.0, f64::INFINITY, 0.0),
        ] {
            at[11] = near;
            assert_eq!(potential_in_single(&from, &[[0.0; 3]; 390], &at).unwrap(), None);
        }
    }

    #[test]
    fn there_may_be_no_points() {
        let [from, at] = sheets(1.0);
        assert_eq!(
            potential_in_single(&from, &weights(1.0), &[]).unwrap(),
            Some(Vec::new())
        );
        let nothing = potential_in_single(&[], &[], &at).unwrap();
        assert_eq!(nothing, Some(vec![[0.0; 3]; at.len()]));
    }

    #[test]
    fn rejects_weights_of_another_number_of_points() {
        let [from, at] = sheets(1.0);
        assert!(potential_in_single(&from, &[[0.0; 3]; 2], &at).is_err());
    }
}
