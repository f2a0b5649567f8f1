//! Moves one vertex at a time to where the distortion of its triangles is least, the others held.
//!
//! One vertex sees a function of two variables, so that Newton's method takes a few hundred nanoseconds and no matrix.
//! Alone such moves smooth errors over few triangles only; in a hierarchy, where every level starts from the solution of
//! a coarser one, that is all that is left to smooth.

use smallvec::SmallVec;

use super::energy::{Weights, tangents};
use super::kernel::det;
use super::progressive::Drawing;
use crate::{Point, Vector};

/// What a triangle is on the surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rest {
    /// Cotangents of its angles.
    pub cotangents: [f64; 3],
    /// Area in units in which the surface has 4π, the sphere's.
    pub area: f64,
}

/// Triangles thinner than this count as if they had this ratio of height and longest side: their own shape would only
/// be a source of rounding.
const THINNEST: f64 = 0.02;

impl Rest {
    /// Of a triangle in space; `unit` scales areas.
    pub fn of([a, b, c]: [&Point; 3], unit: f64) -> Self {
        let (ab, ac, bc) = (b - a, c - a, c - b);
        let double_area = ab.cross(&ac).norm();
        let squares = [bc.norm_squared(), ac.norm_squared(), ab.norm_squared()];
        let longest = squares[0].max(squares[1]).max(squares[2]);
        let floored = double_area.max(THINNEST * longest).max(1e-12 / unit);
        let dots = [ab.dot(&ac), -ab.dot(&bc), ac.dot(&bc)];
        let cotangents = if longest > 0.0 && double_area >= THINNEST * longest {
            dots.map(|dot| dot / double_area)
        } else {
            thin(squares, longest)
        };
        Self {
            cotangents,
            area: 0.5 * floored * unit,
        }
    }
}

/// Cotangents of the triangle on the same longest side whose apex is lifted to the least height.
fn thin(squares: [f64; 3], longest: f64) -> [f64; 3] {
    if longest.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return [(1f64 / 3.0).sqrt(); 3];
    }
    let apex = (0..3).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let (left, right) = (squares[(apex + 1) % 3], squares[(apex + 2) % 3]);
    // Foot of the apex on its side, in units of the side; the neighbour next in order is opposite of `left`.
    let foot = (0.5 * (1.0 + (right - left) / longest)).clamp(0.0, 1.0);
    let mut cotangents = [0.0; 3];
    cotangents[(apex + 1) % 3] = foot / THINNEST;
    cotangents[(apex + 2) % 3] = (1.0 - foot) / THINNEST;
    cotangents[apex] = (THINNEST * THINNEST - foot * (1.0 - foot)) / THINNEST;
    cotangents
}

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
        let d = det(x, a, b) / (2.0 * rest.area);
        let q = stretch(x, a, b, rest);
        // Written so that NaN fails.
        if !(d > 0.0 && d.is_finite()) {
            return None;
        }
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
    let floor = 1e-9 * (a + c);
    let (a, c) = (a + floor, c + floor);
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
