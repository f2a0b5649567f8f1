//! Nonlinear Gauss-Seidel relaxation: moves one vertex at a time to lower the distortion of its triangles, with the
//! others held.
//!
//! The energy of one vertex is a function of two variables: a Newton step takes a few hundred nanoseconds and no sparse
//! matrix. Such moves smooth only errors that vary over a few triangles; in a hierarchy, where every level starts from
//! the solution of a coarser one, no others are left.

use smallvec::SmallVec;

use super::curvature::Curvature;
use super::distortion_energy::EnergyWeights;
use super::progressive::PartialEmbedding;
use super::rest_shape::RestShape;
use super::ring_kernel::{det, positive_det};
use crate::{Matrix3, Point, Vector};

/// The energy that relaxation lowers, and the vertices that it holds.
pub(crate) struct Relaxation<'a> {
    /// The vertices of the surface, in space.
    pub points: &'a [Point],
    pub weights: EnergyWeights,
    /// Soft target of a vertex, with its weight: its energy is the weight times the squared distance.
    pub soft_target: &'a dyn Fn(u32) -> Option<(Vector, f64)>,
    pub is_fixed: &'a dyn Fn(u32) -> bool,
}

impl Relaxation<'_> {
    /// Moves every vertex that is not fixed, `sweeps` times over.
    pub fn run(&self, embedding: &mut PartialEmbedding, sweeps: usize) {
        let area_scale = embedding.area_scale(self.points);
        let mut star = RelaxationStar::new();
        for _ in 0..sweeps {
            for i in 0..embedding.inserted.len() {
                let v = embedding.inserted[i];
                if (self.is_fixed)(v) {
                    continue;
                }
                self.gather(embedding, v, area_scale, &mut star);
                let x = &embedding.directions[v as usize];
                if let Some(x) = better_place(Curvature::Spherical, x, &star, self.weights, (self.soft_target)(v)) {
                    embedding.directions[v as usize] = x;
                }
            }
        }
    }

    fn gather(&self, embedding: &PartialEmbedding, v: u32, area_scale: f64, star: &mut RelaxationStar) {
        let ring = embedding.rings.of(v);
        star.clear();
        star.extend(ring.iter().enumerate().map(|(i, &r)| {
            let next = ring[(i + 1) % ring.len()];
            let corners = [v, r, next].map(|u| &self.points[u as usize]);
            (
                embedding.directions[r as usize],
                RestShape::of_triangle(corners, area_scale),
            )
        }));
    }
}

/// The neighbours of a vertex: their directions, and the rest shape of the triangle of the vertex, the neighbour and
/// the next one.
pub(crate) type RelaxationStar = SmallVec<[(Vector, RestShape); 12]>;

/// Energy of the triangles of a vertex at `x`; `None` when one of them is not positive.
fn energy_at(x: &Vector, star: &RelaxationStar, weights: EnergyWeights) -> Option<f64> {
    let mut energy = 0.0;
    for (i, (a, rest)) in star.iter().enumerate() {
        let b = &star[(i + 1) % star.len()].0;
        let d = positive_det(x, a, b)? / (2.0 * rest.area);
        // Squared norm of the Jacobian from the rest shape to the chord triangle.
        let q = rest.dirichlet(x, a, b) / (2.0 * rest.area);
        energy += rest.area * (weights.angle * q / (2.0 * d) + weights.area * 0.5 * (d + 1.0 / d));
    }
    Some(energy)
}

/// A place of lower energy for the vertex at `x`, by a Newton step with backtracking; `None` when there is none.
pub(crate) fn better_place(
    curvature: Curvature,
    x: &Vector,
    star: &RelaxationStar,
    weights: EnergyWeights,
    soft_target: Option<(Vector, f64)>,
) -> Option<Vector> {
    let target_energy = |x: &Vector| soft_target.map_or(0.0, |(to, weight)| weight * (x - to).norm_squared());
    let value = |x: &Vector| energy_at(x, star, weights).map(|energy| energy + target_energy(x));
    let before = value(x)?;
    let mut gradient = Vector::zeros();
    let mut hessian = Matrix3::zeros();
    for (i, (a, rest)) in star.iter().enumerate() {
        let b = &star[(i + 1) % star.len()].0;
        let [_, ca, cb] = rest.cotangents;
        let d = det(x, a, b) / (2.0 * rest.area);
        let q = rest.dirichlet(x, a, b) / (2.0 * rest.area);
        let dq = (ca * (x - b) + cb * (x - a)) / rest.area;
        let n = a.cross(&(b - a)) / (2.0 * rest.area);
        let (w, v) = (0.5 * rest.area * weights.angle, 0.5 * rest.area * weights.area);
        gradient += w * (dq / d - q / (d * d) * n) + v * (1.0 - 1.0 / (d * d)) * n;
        let cross = dq * n.transpose();
        let squared = n * n.transpose();
        let cubed = d * d * d;
        hessian += w * (Matrix3::identity() * ((ca + cb) / rest.area / d) - (cross + cross.transpose()) / (d * d))
            + (2.0 * (w * q + v) / cubed) * squared;
    }
    if let Some((to, weight)) = soft_target {
        gradient += 2.0 * weight * (x - to);
        hessian += Matrix3::identity() * (2.0 * weight);
    }
    let step = curvature.newton_step(x, &gradient, &hessian)?;
    let mut share = 1.0;
    for _ in 0..12 {
        let to = curvature.step(x, &(share * step));
        if value(&to).is_some_and(|after| after < before) {
            return Some(to);
        }
        share *= 0.5;
    }
    None
}
