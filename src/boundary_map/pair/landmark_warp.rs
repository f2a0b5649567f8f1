//! Deforms the domain smoothly so that its landmarks come to those of the target: what lies between landmarks comes close to
//! its counterpart, which a similarity does not reach where limbs are in other poses.
//!
//! The displacements of the landmarks are interpolated by radial basis functions φ(r) = r with a constant, the biharmonic
//! spline of space (Carr et al., *Reconstruction and representation of 3D objects with radial basis functions*, 2001).

use nalgebra::{DMatrix, DVector};

use crate::Point;
use crate::geometry::Similarity;
use crate::mesh::{SurfaceMesh, shapes};

/// Most landmarks that take part; of more, evenly spaced ones in their order. The cost grows with the cube.
const MOST_LANDMARKS: usize = 400;
/// How far the deformed landmarks may stay away, so that landmarks close to each other do not tear the domain: the diagonal
/// of the system, as a fraction of the largest distance of landmarks.
const SMOOTHING: f64 = 1e-3;

/// The domain, first moved by a similarity, then deformed so that pairs of corresponding points nearly meet. `None` where
/// they are all in one place.
pub(super) fn warped(domain: &SurfaceMesh, similarity: &Similarity, pairs: &[(Point, Point)]) -> Option<SurfaceMesh> {
    let every = pairs.len().div_ceil(MOST_LANDMARKS).max(1);
    let moved = pairs
        .iter()
        .step_by(every)
        .map(|(from, to)| (similarity.apply(from), *to));
    let (centres, to): (Vec<Point>, Vec<Point>) = moved.unzip();
    let n = centres.len();
    let mut system = DMatrix::from_fn(n + 1, n + 1, |i, j| match (i < n, j < n) {
        (true, true) => (centres[i] - centres[j]).norm(),
        (false, false) => 0.0,
        _ => 1.0,
    });
    let largest = system.view((0, 0), (n, n)).max();
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    // Distances are negative definite on weights whose sum is 0.
    (0..n).for_each(|i| system[(i, i)] -= SMOOTHING * largest);
    let factor = system.lu();
    let weights = [0, 1, 2].map(|k| {
        let displacements = centres.iter().zip(&to).map(|(from, to)| (to - from)[k]);
        factor.solve(&DVector::from_iterator(n + 1, displacements.chain([0.0])))
    });
    let [Some(x), Some(y), Some(z)] = weights else {
        return None;
    };
    let displacement = |p: &Point| {
        let of_centres = (0..n).map(|i| crate::Vector::new(x[i], y[i], z[i]) * (p - centres[i]).norm());
        of_centres.sum::<crate::Vector>() + crate::Vector::new(x[n], y[n], z[n])
    };
    let image = |p: &Point| {
        let moved = similarity.apply(p);
        moved + displacement(&moved)
    };
    Some(shapes::deformed(domain, image))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    /// A bent bar with landmarks along it comes to its target between them, too, and rounding does no harm to pairs in one
    /// place.
    #[test]
    fn between_landmarks_the_domain_comes_close_to_its_counterpart() {
        let bar = shapes::deformed(&shapes::cube(1.0, 8), |p| Point::new(4.0 * p.x, p.y, p.z));
        let bend = |p: &Point| Point::new(p.x, p.y, p.z + 0.2 * p.x * p.x);
        let mut pairs: Vec<(Point, Point)> = bar.vertices().iter().step_by(5).map(|p| (*p, bend(p))).collect();
        pairs.push(pairs[0]);
        let warped = warped(&bar, &Similarity::identity(), &pairs).unwrap();
        let before = bar.vertices().iter().map(|p| (p - bend(p)).norm()).fold(0.0, f64::max);
        let errors = bar
            .vertices()
            .iter()
            .zip(warped.vertices())
            .map(|(p, q)| (q - bend(p)).norm());
        let largest = errors.fold(0.0, f64::max);
        // 5 % by the same formula in numpy.
        assert!(largest < 0.07 * before, "{largest} of {before}");
    }

    #[test]
    fn a_translation_is_met_everywhere_and_points_in_one_place_are_refused() {
        let ball = shapes::sphere(1.0, 2);
        let shift = Vector::new(3.0, -1.0, 0.5);
        let pairs: Vec<(Point, Point)> = ball.vertices()[..5].iter().map(|p| (*p, p + shift)).collect();
        let moved = warped(&ball, &Similarity::identity(), &pairs).unwrap();
        for (p, q) in ball.vertices().iter().zip(moved.vertices()) {
            assert!((q - p - shift).norm() < 1e-9);
        }
        assert!(warped(&ball, &Similarity::identity(), &[pairs[0], pairs[0]]).is_none());
        assert!(warped(&ball, &Similarity::identity(), &[]).is_none());
    }
}
