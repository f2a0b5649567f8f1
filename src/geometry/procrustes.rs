//! Rotations and similarities that fit points to other points best (Umeyama, *Least-squares estimation of
//! transformation parameters between two point patterns*, IEEE PAMI 13, 1991).

use nalgebra::SVD;

use crate::{Matrix3, Point, Vector};

/// A map `x ↦ scale · rotation · x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Ratio of lengths; positive.
    pub scale: f64,
    /// Orthogonal: a rotation, or a reflection where one was asked for.
    pub rotation: Matrix3,
    /// Where the origin goes.
    pub translation: Vector,
}

impl Similarity {
    /// The identity.
    pub fn identity() -> Self {
        Self {
            scale: 1.0,
            rotation: Matrix3::identity(),
            translation: Vector::zeros(),
        }
    }

    /// Image of a point.
    pub fn apply(&self, p: &Point) -> Point {
        Point::from(self.apply_vector(&p.coords) + self.translation)
    }

    /// Image of a displacement. Normals transform by `rotation` alone, also where that is a reflection.
    pub fn apply_vector(&self, v: &Vector) -> Vector {
        self.scale * (self.rotation * v)
    }

    /// The map back.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            scale: 1.0 / self.scale,
            rotation,
            translation: rotation * self.translation / -self.scale,
        }
    }

    /// This map after `first`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            scale: self.scale * first.scale,
            rotation: self.rotation * first.rotation,
            translation: self.apply_vector(&first.translation) + self.translation,
        }
    }
}

/// The best rotation, and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereRotation {
    /// The proper rotation that fits best.
    pub rotation: Matrix3,
    /// Weighted root mean square of `|R a − b|`.
    pub residual: f64,
    /// The residual of the best reflection: if it is much smaller, one set is the mirror image of the other.
    pub mirrored_residual: f64,
}

/// The rotation `R` with the least `Σ w |R a − b|²` over unit vectors `a` of `from` and `b` of `to`. With fewer than
/// two independent vectors many fit equally well, and one of them is returned.
///
/// `None` unless there are as many of each, at least one, all finite, and the weights are not negative and have a
/// positive finite sum.
pub fn sphere_rotation(from: &[Vector], to: &[Vector], weights: &[f64]) -> Option<SphereRotation> {
    if from.len() != to.len() || from.len() != weights.len() {
        return None;
    }
    let total: f64 = weights.iter().sum();
    let covariance: Matrix3 = (0..from.len()).map(|i| weights[i] * to[i] * from[i].transpose()).sum();
    if !(total > 0.0 && total.is_finite() && weights.iter().all(|&w| w >= 0.0)) {
        return None;
    }
    let rotation = closest_orthogonal(&covariance, 1.0)?;
    let mirrored = closest_orthogonal(&covariance, -1.0)?;
    let residual = |r: &Matrix3| {
        let squares = (0..from.len()).map(|i| weights[i] * (r * from[i] - to[i]).norm_squared());
        (squares.sum::<f64>() / total).sqrt()
    };
    Some(SphereRotation {
        rotation,
        residual: residual(&rotation),
        mirrored_residual: residual(&mirrored),
    })
}

/// The similarity with the least `Σ w |S(a) − b|²` over pairs `(a, b, w)`; its orthogonal part has determinant `sign`,
/// 1 or −1. With a fixed `scale`, the best of that scale.
///
/// `None` without pairs of positive weight, when something is not finite, or when all `a` coincide and the scale is not
/// given.
pub(crate) fn similarity(pairs: &[(Point, Point, f64)], sign: f64, scale: Option<f64>) -> Option<Similarity> {
    let total: f64 = pairs.iter().map(|pair| pair.2).sum();
    let mean = |of: fn(&(Point, Point, f64)) -> Point| {
        pairs.iter().map(|pair| pair.2 * of(pair).coords).sum::<Vector>() / total
    };
    let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let mut covariance = Matrix3::zeros();
    let mut spread = 0.0;
    for (a, b, w) in pairs {
        let a = a.coords - from;
        covariance += *w * (b.coords - to) * a.transpose();
        spread += w * a.norm_squared();
    }
    let rotation = closest_orthogonal(&covariance, sign)?;
    let scale = scale.unwrap_or_else(|| (rotation.transpose() * covariance).trace() / spread);
    let similarity = Similarity {
        scale,
        rotation,
        translation: to - scale * (rotation * from),
    };
    let is_sound = scale > 0.0 && scale.is_finite() && similarity.translation.iter().all(|c| c.is_finite());
    is_sound.then_some(similarity)
}

/// The orthogonal matrix of determinant `sign` with the largest `tr(Rᵀ C)`.
fn closest_orthogonal(covariance: &Matrix3, sign: f64) -> Option<Matrix3> {
    let largest = covariance.amax();
    if !(largest.is_finite() && covariance.iter().all(|c| c.is_finite())) {
        return None;
    }
    // Scaled, so that models in micrometres and in kilometres are decomposed alike.
    let scaled = covariance / largest.max(f64::MIN_POSITIVE);
    let SVD { u, v_t, .. } = SVD::try_new(scaled, true, true, f64::EPSILON, 1000)?;
    let (mut u, v_t) = (u?, v_t?);
    // The singular values are sorted: to flip the last direction costs least.
    if u.determinant() * v_t.determinant() * sign < 0.0 {
        u.column_mut(2).neg_mut();
    }
    Some(u * v_t)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    fn vectors(count: usize) -> Vec<Vector> {
        let mut random = StdRng::seed_from_u64(11);
        (0..count)
            .map(|_| Vector::from_fn(|_, _| random.random_range(-1.0..1.0)).normalize())
            .collect()
    }

    #[test]
    fn a_rotation_of_directions_is_recovered_and_a_reflection_detected() {
        let from = vectors(7);
        let turn = Rotation3::new(Vector::new(2.0, -1.0, 0.4)).into_inner();
        let to: Vec<Vector> = from.iter().map(|v| turn * v).collect();
        let weights = [1.0, 2.0, 0.5, 0.0, 1.0, 1.0, 3.0];
        let found = sphere_rotation(&from, &to, &weights).unwrap();
        assert!((found.rotation - turn).amax() < 1e-14 && found.residual < 1e-14);
        assert!(found.mirrored_residual > 0.1);
        let mirrored: Vec<Vector> = to.iter().map(|v| -v).collect();
        let found = sphere_rotation(&from, &mirrored, &weights).unwrap();
        assert!((found.rotation.determinant() - 1.0).abs() < 1e-14);
        assert!(found.mirrored_residual < 1e-14 && found.residual > 0.1);
    }

    #[test]
    fn three_directions_on_a_circle_get_a_rotation_not_a_reflection() {
        let from = [Vector::x(), Vector::y(), -Vector::x()];
        let to = [Vector::y(), Vector::x(), -Vector::y()];
        let found = sphere_rotation(&from, &to, &[1.0; 3]).unwrap();
        assert!((found.rotation.determinant() - 1.0).abs() < 1e-14 && found.residual < 1e-14);
    }

    #[test]
    fn sets_that_are_empty_unequal_or_not_finite_have_no_rotation() {
        assert!(sphere_rotation(&[], &[], &[]).is_none());
        assert!(sphere_rotation(&vectors(2), &vectors(3), &[1.0; 2]).is_none());
        assert!(sphere_rotation(&[Vector::repeat(f64::NAN)], &vectors(1), &[1.0]).is_none());
        assert!(sphere_rotation(&vectors(2), &vectors(2), &[1.0, -1.0]).is_none());
        let one = sphere_rotation(&[Vector::x()], &[Vector::z()], &[1.0]).unwrap();
        assert!((one.rotation * Vector::x() - Vector::z()).norm() < 1e-14);
    }

    #[test]
    fn similarities_are_recovered_inverted_and_chained() {
        let a: Vec<Point> = vectors(5).into_iter().map(Point::from).collect();
        let expected = Similarity {
            scale: 2.5,
            rotation: Rotation3::new(Vector::new(0.3, 3.0, -0.4)).into_inner(),
            translation: Vector::new(1.0, -7.0, 3.0),
        };
        let pairs: Vec<(Point, Point, f64)> = a.iter().map(|p| (*p, expected.apply(p), 0.7)).collect();
        let found = similarity(&pairs, 1.0, None).unwrap();
        let round_trip = found.inverse().after(&expected);
        for p in &a {
            assert!((found.apply(p) - expected.apply(p)).norm() < 1e-13);
            assert!((round_trip.apply(p) - p).norm() < 1e-14);
        }
    }
}
