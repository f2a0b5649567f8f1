//! Rotations that alignments start from.

use std::f64::consts::PI;

use nalgebra::{Quaternion, Rotation3, UnitQuaternion};

use super::{AlignmentStart, AlignmentSurface};
use crate::geometry::Similarity;
use crate::{Matrix3, Vector};

/// Starts added where principal axes are ambiguous: every rotation is within 57° of one of them.
const SPREAD: usize = 72;
/// Turns about a given direction.
const UPRIGHT_TURNS: usize = 12;

/// Orthogonal matrices of determinant `sign`, between the frames of the two surfaces.
pub(super) fn starts(
    domain: &AlignmentSurface,
    target: &AlignmentSurface,
    sign: f64,
) -> Vec<(AlignmentStart, Similarity)> {
    let turned = |choice: &Matrix3| target.axes * choice * domain.axes.transpose();
    let choices = axis_choices(sign);
    let as_given = |r: &Matrix3| {
        if *r == Matrix3::identity() {
            AlignmentStart::AsGiven
        } else {
            AlignmentStart::CoordinateAxes
        }
    };
    let mut rotations: Vec<(AlignmentStart, Matrix3)> = choices.iter().map(|r| (as_given(r), *r)).collect();
    rotations.extend(choices.iter().map(|r| (AlignmentStart::PrincipalAxes, turned(r))));
    if domain.has_ambiguous_axes() || target.has_ambiguous_axes() {
        // Relative to the axes too, so that the result is equivariant under rotations.
        let spread = spread_rotations(SPREAD);
        rotations.extend(spread.iter().map(|r| (AlignmentStart::Spread, turned(&(sign * r)))));
    }
    let start = |(start, rotation)| {
        let similarity = Similarity {
            rotation,
            ..Similarity::identity()
        };
        (start, similarity)
    };
    rotations.into_iter().map(start).collect()
}

/// Orthogonal matrices of determinant `sign` that take the first direction to the second, evenly turned about it.
pub(super) fn upright([from, to]: &[Vector; 2], sign: f64) -> Vec<(AlignmentStart, Similarity)> {
    let (frame, image) = (right_handed(from), right_handed(to));
    let turned = |k: usize| {
        let about = Rotation3::new(Vector::z() * (2.0 * PI * k as f64 / UPRIGHT_TURNS as f64));
        let mirror = Matrix3::from_diagonal(&Vector::new(sign, 1.0, 1.0));
        let similarity = Similarity {
            rotation: image * about.matrix() * mirror * frame.transpose(),
            ..Similarity::identity()
        };
        (AlignmentStart::Upright, similarity)
    };
    (0..UPRIGHT_TURNS).map(turned).collect()
}

/// A rotation whose last column has this direction.
fn right_handed(direction: &Vector) -> Matrix3 {
    let z = direction.normalize();
    let x = z.cross(&Vector::ith(z.iamin(), 1.0)).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

/// The 24 signed permutation matrices of determinant `sign`.
fn axis_choices(sign: f64) -> Vec<Matrix3> {
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let choices = orders.iter().flat_map(|order| {
        (0..8).map(move |signs| {
            let turned = |axis: usize| if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
            Matrix3::from_columns(&[0, 1, 2].map(|axis| Vector::ith(order[axis], turned(axis))))
        })
    });
    choices.filter(|m| m.determinant() * sign > 0.0).collect()
}

/// Rotations spread uniformly over all rotations, on a spiral in the space of unit quaternions.
pub(in crate::boundary_map::pair) fn spread_rotations(count: usize) -> Vec<Matrix3> {
    /// The positive root of `x⁴ = x + 4`: with the square root of 2 the best spiral (Alexa, section 4).
    const PSI: f64 = 1.533_751_168_755_204_3;
    let rotation = |k: usize| {
        let s = k as f64 + 0.5;
        let t = s / count as f64;
        let (alpha, beta) = (2.0 * PI * s / 2f64.sqrt(), 2.0 * PI * s / PSI);
        let (r, rest) = (t.sqrt(), (1.0 - t).sqrt());
        let quaternion = Quaternion::new(rest * beta.cos(), r * alpha.sin(), r * alpha.cos(), rest * beta.sin());
        UnitQuaternion::from_quaternion(quaternion)
            .to_rotation_matrix()
            .into_inner()
    };
    (0..count).map(rotation).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::super::angle_between;
    use super::*;

    #[test]
    fn spread_rotations_reach_every_rotation() {
        let spread = spread_rotations(SPREAD);
        let mut random = StdRng::seed_from_u64(1);
        for _ in 0..20_000 {
            let any = Rotation3::new(Vector::from_fn(|_, _| random.random_range(-PI..PI))).into_inner();
            let nearest = spread
                .iter()
                .map(|r| angle_between(r, &any))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 57f64.to_radians(), "{nearest}");
        }
    }
}
