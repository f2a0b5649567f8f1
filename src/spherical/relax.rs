//! Moves one vertex at a time to where the distortion of its triangles is least, the others held.
//!
//! One vertex sees a function of two variables, so that Newton's method takes a few hundred nanoseconds and no matrix.
//! Alone such moves smooth errors over few triangles only; in a hierarchy, where every level starts from the solution of
//! a coarser one, that is all that is left to smooth.

use smallvec::SmallVec;

use super::energy::{Weights, tangents};
use super::kernel::{det, positive_det};
use super::progressive::Drawing;
use super::rest::Rest;
use crate::{Point, Vector};

/// What a drawing is relaxed to.
pub(crate) struct Relaxation<'a> {
    /// The vertices of the surface, in space.
    pub points: &'a [Point],
    pub weights: Weights,
    /// Where springs pull a vertex, and their weight: the energy is the weight times the squared distance.
    pub pull: &'a dyn Fn(u32) -> Option<(Vector, f64)>,
    /// Whether a vertex stays where it is.
    pub is_fixed: &'a dyn Fn(u32) -> bool,
}

impl Relaxation<'_> {
    /// Moves every vertex once, `sweeps` times over, to where its triangles are distorted less.
    pub fn run(&self, drawing: &mut Drawing, sweeps: usize) {
        let unit = drawing.area_unit(self.points);
        let mut star = Star::new();
        for _ in 0..sweeps {
            for i in 0..drawing.there.len() {
                let v = drawing.there[i];
                if (self.is_fixed)(v) {
                    continue;
                }
                self.gather(drawing, v, unit, &mut star);
                let x = &drawing.directions[v as usize];
                if let Some(x) = better_place(x, &star, self.weights, (self.pull)(v)) {
                    drawing.directions[v as usize] = x;
                }
            }
        }
    }

    fn gather(&self, drawing: &Drawing, v: u32, unit: f64, star: &mut Star) {
        let ring = drawing.neighbours.of(v);
        star.clear();
        star.extend(ring.iter().enumerate().map(|(i, &r)| {
            let next = ring[(i + 1) % ring.len()];
            let corners = [v, r, next].map(|u| &self.points[u as usize]);
            (drawing.directions[r as usize], Rest::of(corners, unit))
        }));
    }
}

/// A vertex's neighbours: their directions, and what the triangle with the next neighbour is on the surface, its first
/// corner being the vertex.
pub(super) type Star = SmallVec<[(Vector, Rest); 12]>;

/// Energy, gradient and a positive semidefinite second derivative of a vertex's triangles, as functions of its
/// direction; `None` when one is not positive.
fn energy_at(x: &Vector, star: &Star, weights: Weights) -> Option<f64> {
    let mut energy = 0.0;
    for (i, (a, rest)) in star.iter().enumerate() {
        let b = &star[(i + 1) % star.len()].0;
        let d = positive_det(x, a, b)? / (2.0 * rest.area);
        let q = stretch(x, a, b, rest);
        energy += rest.area * (weights.angle * q / (2.0 * d) + weights.area * 0.5 * (d + 1.0 / d));
    }
    Some(energy)
}

/// Squared norm of the Jacobian from the triangle on the surface to the chords.
fn stretch(x: &Vector, a: &Vector, b: &Vector, rest: &Rest) -> f64 {
    let [cx, ca, cb] = rest.cotangents;
    (cx * (b - a).norm_squared() + ca * (b - x).norm_squared() + cb * (a - x).norm_squared()) / (2.0 * rest.area)
}

/// Where the vertex at `x` had better stand; `None` when there is no gain.
pub(super) fn better_place(x: &Vector, star: &Star, weights: Weights, pull: Option<(Vector, f64)>) -> Option<Vector> {
    let pulled = |x: &Vector| pull.map_or(0.0, |(to, weight)| weight * (x - to).norm_squared());
    let value = |x: &Vector| energy_at(x, star, weights).map(|energy| energy + pulled(x));
    let before = value(x)?;
    let mut gradient = Vector::zeros();
    let mut hessian = crate::Matrix3::zeros();
    for (i, (a, rest)) in star.iter().enumerate() {
        let b = &star[(i + 1) % star.len()].0;
        let [_, ca, cb] = rest.cotangents;
        let d = det(x, a, b) / (2.0 * rest.area);
        let q = stretch(x, a, b, rest);
        let slope = (ca * (x - b) + cb * (x - a)) / rest.area;
        let bend = (ca + cb) / rest.area;
        let n = a.cross(&(b - a)) / (2.0 * rest.area);
        let (w, v) = (0.5 * rest.area * weights.angle, 0.5 * rest.area * weights.area);
        gradient += w * (slope / d - q / (d * d) * n) + v * (1.0 - 1.0 / (d * d)) * n;
        let cross = slope * n.transpose();
        let squared = n * n.transpose();
        let cubed = d * d * d;
        hessian += w * (crate::Matrix3::identity() * (bend / d) - (cross + cross.transpose()) / (d * d))
            + (2.0 * (w * q + v) / cubed) * squared;
    }
    if let Some((to, weight)) = pull {
        gradient += 2.0 * weight * (x - to);
        hessian += crate::Matrix3::identity() * (2.0 * weight);
    }
    let step = newton_step(x, &gradient, &hessian)?;
    let mut share = 1.0;
    for _ in 0..12 {
        let to = (x + share * step).normalize();
        if value(&to).is_some_and(|after| after < before) {
            return Some(to);
        }
        share *= 0.5;
    }
    None
}

/// The step in the tangent plane of the sphere at `x`.
pub(crate) fn newton_step(x: &Vector, gradient: &Vector, hessian: &crate::Matrix3) -> Option<Vector> {
    let [s, t] = tangents(x);
    let g = [s.dot(gradient), t.dot(gradient)];
    // On the sphere a gradient along the radius bends the function, and only a bend upwards is kept.
    let bend = (-x.dot(gradient)).max(0.0);
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
    // Farther than a fraction of the sphere the model says nothing.
    let length = step.norm();
    let most = 0.5;
    length
        .is_finite()
        .then(|| if length > most { step * (most / length) } else { step })
}
