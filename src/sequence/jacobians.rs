//! Jacobians of several maps at the same points.

use std::ops::Range;

use super::FrameMap;
use crate::kernel::Sums;
use crate::map::{HarmonicMap, VolumeMap};
use crate::{Matrix3, Point};

/// Relative accuracy of the potential; gradients have a digit less. Fits have boundary errors of 1e-5 and more, and
/// their energies are less accurate than that.
const ACCURACY: f64 = 1e-7;
/// Bytes for the sums and Jacobians of frames that are evaluated together.
const MOST_BYTES: usize = 256 << 20;
/// Bytes for each point and frame: potential and gradient, the Jacobian, and densities.
const BYTES: usize = 200;

/// Number of frames whose Jacobians at this many points fit into [`MOST_BYTES`]; at least one.
pub(super) fn frames_at_a_time(points: usize) -> usize {
    (MOST_BYTES / (BYTES * points.max(1))).max(1)
}

/// The Jacobians of each map. Maps with the same sources as the first map that has any are evaluated together, with
/// each kernel value computed once.
pub(super) fn jacobians(maps: &[&FrameMap], points: &[Point]) -> Vec<Vec<Matrix3>> {
    let with_sources = |map: &&HarmonicMap| !map.sources().is_empty();
    let first = maps.iter().filter_map(|map| map.harmonic()).find(with_sources);
    let sources = first.map_or(&[][..], HarmonicMap::sources);
    let shares = |map: &&HarmonicMap| with_sources(map) && map.sources() == sources;
    let shared_by = |map: &FrameMap| map.harmonic().filter(shares).is_some();
    let sharing: Vec<&HarmonicMap> = maps.iter().filter_map(|map| map.harmonic()).filter(shares).collect();
    let mut shared = gradients(&sharing, sources, points).into_iter();
    let jacobians = maps.iter().map(|map| match shared_by(map) {
        true => shared.next().unwrap_or_default(),
        false => map.jacobian(points),
    });
    jacobians.collect()
}

fn gradients(maps: &[&HarmonicMap], sources: &[Point], points: &[Point]) -> Vec<Vec<Matrix3>> {
    if maps.is_empty() {
        return Vec::new();
    }
    let coefficients = (0..sources.len()).flat_map(|s| maps.iter().flat_map(move |map| map.coefficients().sources[s]));
    let coefficients: Vec<f64> = coefficients.collect();
    let columns = 3 * maps.len();
    let sums = Sums::new(sources, points, ACCURACY).expect("fewer points than 2³²");
    let (_, gradients) = sums
        .potential_and_gradient(&coefficients, columns)
        .expect("a coefficient for each source and column");
    let of_map = |(k, map): (usize, &&HarmonicMap)| {
        let affine = &map.coefficients().affine;
        let linear = Matrix3::from_fn(|i, axis| affine[axis + 1][i]);
        let own: Range<usize> = 9 * k..9 * (k + 1);
        let rows = gradients.chunks_exact(3 * columns);
        rows.map(|row| Matrix3::from_row_slice(&row[own.clone()]) + linear)
            .collect()
    };
    maps.iter().enumerate().map(of_map).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::Coefficients;

    /// A map with sources on a sphere of radius 3, its coefficients depending on `seed`.
    fn map(sources: usize, seed: usize) -> FrameMap {
        let place = |s: usize| {
            let (z, turn) = (2.0 * (s as f64 + 0.5) / sources as f64 - 1.0, 2.4 * s as f64);
            let r = f64::sqrt(1.0 - z * z);
            Point::new(3.0 * r * turn.cos(), 3.0 * r * turn.sin(), 3.0 * z)
        };
        let coefficient = |s: usize| [0, 1, 2].map(|i| ((seed + 1) * (3 * s + i + 1)) as f64).map(f64::sin);
        let coefficients = Coefficients {
            sources: (0..sources).map(coefficient).collect(),
            affine: [[0.0; 3], [1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [seed as f64, 0.0, 1.0]],
        };
        FrameMap::Harmonic(HarmonicMap::new((0..sources).map(place).collect(), coefficients).unwrap())
    }

    #[test]
    fn maps_have_the_same_jacobians_together_as_alone() {
        let points: Vec<Point> = (0..400)
            .map(|k| Point::new((0.3 * k as f64).sin(), (0.7 * k as f64).cos(), 0.2))
            .collect();
        let maps = [map(60, 0), map(0, 1), map(60, 2), map(41, 3)];
        let together = jacobians(&maps.iter().collect::<Vec<_>>(), &points);
        for (map, together) in maps.iter().zip(together) {
            let alone = map.jacobian(&points);
            let apart = alone
                .iter()
                .zip(&together)
                .map(|(a, b)| (a - b).norm())
                .fold(0.0, f64::max);
            assert!(together.len() == points.len() && apart < 1e-12, "{apart}");
        }
        assert!(jacobians(&[], &points).is_empty());
    }
}
