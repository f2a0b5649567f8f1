//! The surface that a drawing lies on: the unit sphere, or the plane at height 1 over the origin.
//!
//! On both, a triangle is counter-clockwise when the determinant of its corners is positive, and a linear combination of
//! corners, scaled back onto the surface, has the same barycentric coordinates whatever the order of corners; so energies,
//! Newton's method and the search for points are written once.

use super::distortion_energy::tangents;
use crate::{Matrix3, Vector};

/// Gaussian curvature of the surface that is drawn on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Curvature {
    /// The unit sphere.
    Spherical,
    /// Points `(u, v, 1)`.
    Flat,
}

impl Curvature {
    /// Two unit vectors tangent to the surface at `x`.
    pub fn tangents(self, x: &Vector) -> [Vector; 2] {
        match self {
            Self::Spherical => tangents(x),
            Self::Flat => [Vector::x(), Vector::y()],
        }
    }

    /// The point of the surface at the end of a tangent vector, or nearest to it.
    pub fn step(self, x: &Vector, tangent: &Vector) -> Vector {
        match self {
            Self::Spherical => (x + tangent).normalize(),
            Self::Flat => x + tangent,
        }
    }

    /// Newton's step in the tangent plane at `x`, with the Hessian shifted to be positive definite.
    pub fn newton_step(self, x: &Vector, gradient: &Vector, hessian: &Matrix3) -> Option<Vector> {
        let [s, t] = self.tangents(x);
        let g = [s.dot(gradient), t.dot(gradient)];
        // The curvature of the sphere turns a radial gradient into curvature of the function; only a positive one is kept.
        let bend = match self {
            Self::Spherical => (-x.dot(gradient)).max(0.0),
            Self::Flat => 0.0,
        };
        let (hs, ht) = (hessian * s, hessian * t);
        let (a, b, c) = (s.dot(&hs) + bend, s.dot(&ht), t.dot(&ht) + bend);
        // Shifted so that both eigenvalues are positive.
        let (middle, radius) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
        let floor = 1e-9 * middle.abs().max(radius);
        let shift = floor + (radius - middle + 1e-3 * radius).max(0.0);
        let (a, c) = (a + shift, c + shift);
        let determinant = a * c - b * b;
        if !(determinant > 0.0 && determinant.is_finite()) {
            return None;
        }
        let step = [(b * g[1] - c * g[0]) / determinant, (b * g[0] - a * g[1]) / determinant];
        let step = step[0] * s + step[1] * t;
        // The quadratic model is of no use beyond a fraction of the radius.
        let length = step.norm();
        let most = 0.5;
        length
            .is_finite()
            .then(|| if length > most { step * (most / length) } else { step })
    }
}
