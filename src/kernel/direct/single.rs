//! Sums and matrices in single precision, in half the time or less, for points that lie together: relative to their
//! middle, coordinates lose `10⁻⁷` of the points' extent, which is little of a distance unless it is short beside that.

use super::{BlockValues, Instructions, LANES, PackedSource, TargetBlock, add_potential, write_column};
use crate::Point;

/// Largest `1/r` of terms in single precision, in units in which points are about one apart: beyond, a term may be wrong
/// by more than `2·10⁻⁵` of itself.
pub(in crate::kernel) const LARGEST: f32 = 128.0;

/// The middle of some points' box, and the reciprocal of half its largest side.
struct Frame {
    centre: Point,
    up: f64,
}

impl Frame {
    fn of(points: &[Point], others: &[Point]) -> Option<Self> {
        let mut points = points.iter().chain(others);
        let first = *points.next()?;
        let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
        let up = 2.0 / (high - low).amax();
        let centre = low + 0.5 * (high - low);
        (up.is_finite() && centre.iter().all(|c| c.is_finite())).then_some(Self { centre, up })
    }

    fn unit(&self, p: &Point) -> [f64; 3] {
        ((p - self.centre) * self.up).into()
    }

    fn blocks(&self, targets: &[Point]) -> Vec<TargetBlock<f32>> {
        let blocks = targets.chunks(LANES);
        blocks.map(|t| TargetBlock::mapped(t, |p| self.unit(p))).collect()
    }
}

/// Potential at each of `at` of points with three weights each: see [`potential`](super::potential). `None` where that
/// needs double precision.
pub(crate) fn potential_in_single(from: &[Point], weights: &[[f64; 3]], at: &[Point]) -> Option<Vec<[f64; 3]>> {
    let frame = Frame::of(from, at)?;
    let greatest = weights.iter().flatten().fold(0.0f64, |most, w| most.max(w.abs()));
    if !(greatest > 0.0 && greatest.is_finite()) {
        return None;
    }
    let pack = |(p, w): (&Point, &[f64; 3])| {
        let ([x, y, z], [a, b, c]) = (frame.unit(p), w.map(|w| w / greatest));
        [x, y, z, a, b, c].map(|value| value as f32)
    };
    let sources: Vec<PackedSource<f32>> = from.iter().zip(weights).map(pack).collect();
    let blocks = frame.blocks(at);
    let mut sums: Vec<[BlockValues<f32>; 4]> = vec![[[0.0; LANES]; 4]; blocks.len()];
    add_potential(Instructions::detect(), &sources, &blocks, &mut sums);
    let down = greatest * frame.up / (4.0 * std::f64::consts::PI);
    let sum = |i: usize, k: usize| down * f64::from(sums[i / LANES][k][i % LANES]);
    are_right(&sums).then(|| (0..at.len()).map(|i| [0, 1, 2].map(|k| sum(i, k))).collect())
}

/// Whether sums of this precision are near those of double precision.
pub(in crate::kernel) fn are_right(sums: &[[BlockValues<f32>; 4]]) -> bool {
    let mut values = sums.iter().flatten().flatten();
    values.all(|sum| sum.is_finite()) && sums.iter().flat_map(|[.., largest]| largest).all(|g| *g <= LARGEST)
}

/// Writes the kernel between all of `at` and each of `from`, column after column: see [`fill_matrix`](super::fill_matrix).
/// `false`, and what is written is of no use, where that needs double precision.
pub(crate) fn fill_matrix_in_single(at: &[Point], from: &[Point], matrix: &mut [f32]) -> bool {
    if matrix.is_empty() {
        return true;
    }
    let Some(frame) = Frame::of(at, from) else {
        return false;
    };
    let (blocks, up) = (frame.blocks(at), frame.up / (4.0 * std::f64::consts::PI));
    if !(1e-30..1e30).contains(&up) {
        return false;
    }
    let most = LARGEST * up as f32;
    let mut columns = matrix.chunks_exact_mut(at.len()).zip(from);
    columns.all(|(column, source)| {
        let source = frame.unit(source).map(|c| c as f32);
        write_column(Instructions::detect(), source, up as f32, &blocks, column).is_some_and(|largest| largest <= most)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::direct;

    /// Two sheets, at a distance of a twentieth of their extent, anywhere in space.
    fn sheets(scale: f64) -> [Vec<Point>; 2] {
        let point = |i: usize, z: f64| Point::new((i % 20) as f64, (i / 20) as f64 + 0.3 * z, z) * scale;
        let sheet =
            |count: usize, z: f64| (0..count).map(move |i| point(i, z) + crate::Vector::new(70.0, -20.0, 5.0) * scale);
        [sheet(390, 0.0).collect(), sheet(270, 1.0).collect()]
    }

    /// Distances are rounded to `2·10⁻⁶` where they are least.
    #[test]
    fn values_are_near_those_in_double_precision_in_any_unit_of_length() {
        for scale in [1e-60, 1.0, 1e60] {
            let [from, at] = sheets(scale);
            let weights: Vec<[f64; 3]> = (0..from.len())
                .map(|i| [1, 2, 3].map(|k| scale * ((k * i) as f64).sin()))
                .collect();
            let found = potential_in_single(&from, &weights, &at).unwrap();
            let expected = direct::potential(&direct::Sources::new(&from, &weights).unwrap(), &at);
            let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
            let differences = found.iter().flatten().zip(expected.iter().flatten());
            let error = norm(&mut differences.map(|(a, b)| a - b)) / norm(&mut expected.iter().flatten().copied());
            assert!(error > 1e-12 && error < 1e-5, "{scale:e}: {error:e}");

            let mut matrix = vec![0.0f32; at.len() * from.len()];
            assert!(fill_matrix_in_single(&at, &from, &mut matrix) == (scale == 1.0));
            let mut exact = vec![0.0; matrix.len()];
            direct::fill_matrix(&at, &from, &mut exact).unwrap();
            let mut entries = matrix.iter().zip(&exact);
            assert!(scale != 1.0 || entries.all(|(&a, b)| (f64::from(a) / b - 1.0).abs() < 3e-6));
        }
    }

    #[test]
    fn points_that_are_close_or_not_finite_need_double_precision() {
        let [from, mut at] = sheets(1.0);
        let weights = vec![[1.0, 2.0, 3.0]; from.len()];
        let mut matrix = vec![0.0; at.len() * from.len()];
        for near in [
            from[7],
            from[7] + crate::Vector::new(1e-3, 0.0, 0.0),
            Point::new(f64::NAN, 0.0, 0.0),
            Point::new(0.0, f64::INFINITY, 0.0),
        ] {
            at[11] = near;
            assert!(potential_in_single(&from, &weights, &at).is_none());
            assert!(!fill_matrix_in_single(&at, &from, &mut matrix));
        }
    }

    #[test]
    fn there_may_be_no_points_and_no_weights() {
        let [from, at] = sheets(1.0);
        assert!(potential_in_single(&from, &vec![[0.0; 3]; from.len()], &at).is_none());
        assert!(potential_in_single(&[], &[], &[]).is_none());
        assert!(fill_matrix_in_single(&[], &from, &mut []));
        assert!(fill_matrix_in_single(&at, &[], &mut []));
    }
}
