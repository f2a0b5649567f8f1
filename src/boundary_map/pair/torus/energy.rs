//! The energy of a map between two surfaces that are laid out on one flat torus, as a function of the domain's layout.
//!
//! A layout is linear in every triangle. So a triangle is cut into `k × k` parts whose corners are linear in its own, and its
//! energy is that of the parts: on coarse levels these see the surface of the target between the images of vertices.
//!
//! The map from the torus to the target is linear over small triangles. For moves that are longer, the derivative that counts
//! is the mean over the parts around a sample: it follows from their images alone.

use std::collections::HashMap;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use nalgebra::Matrix3x2;
use rayon::prelude::*;

use crate::boundary_map::sweep::{
    Chain, Cut, Derivatives, TargetTorus, add_image_derivatives, barrier, barrier_derivatives, image_energy, secant,
};
use crate::spherical::{Curvature, ElementDerivatives, Objective, RestShape};
use crate::toroidal::{PartialLayout, TORUS_AREA};
use crate::{Point, Vector};

/// The energy as a function of the places of all vertices, for Newton's method.
pub(super) struct TorusEnergy<'a> {
    target: &'a TargetTorus,
    cut: Cut,
    softness: f64,
    triangles: Vec<[u32; 3]>,
    /// Translations of the corners in the plane.
    shifts: Vec<[Vector; 3]>,
    rests: Vec<RestShape>,
    /// The samples of each triangle, in the order of the cut; neighbours share those of their edge.
    samples: Vec<Vec<u32>>,
    /// A triangle that has the sample, and its place in the cut.
    owners: Vec<(u32, u32)>,
    /// Where each sample was found last. Affects the time of the next search, not its result.
    hints: Vec<AtomicU32>,
}

impl<'a> TorusEnergy<'a> {
    pub fn new(target: &'a TargetTorus, layout: &PartialLayout, points: &[Point], cut: Cut, softness: f64) -> Self {
        let (triangles, shifts) = layout.triangles();
        let area_scale = layout.area_scale(points);
        let rest = |t: &[u32; 3]| RestShape::of_triangle(t.map(|v| &points[v as usize]), area_scale);
        let rests = triangles.iter().map(rest).collect();
        let (mut index, mut owners) = (HashMap::new(), Vec::new());
        let mut samples = Vec::with_capacity(triangles.len());
        for (i, t) in triangles.iter().enumerate() {
            let of_triangle = cut.samples.iter().enumerate().map(|(local, weights)| {
                // Known by its vertices and their weights, lowest vertex first.
                let parts = weights.map(|w| (w * cut.cuts as f64).round() as u32);
                let mut key = [0, 1, 2].map(|k| if parts[k] > 0 { (t[k], parts[k]) } else { (u32::MAX, 0) });
                key.sort_unstable();
                *index.entry(key).or_insert_with(|| {
                    owners.push((i as u32, local as u32));
                    owners.len() as u32 - 1
                })
            });
            samples.push(of_triangle.collect());
        }
        Self {
            target,
            cut,
            softness,
            triangles,
            shifts,
            rests,
            samples,
            hints: owners.iter().map(|_| AtomicU32::new(u32::MAX)).collect(),
            owners,
        }
    }

    /// The mean energy, where that of a triangle counts up to `most` times that of an isometry.
    pub fn mean(&self, x: &[Vector], most: f64) -> f64 {
        let images = self.images(x);
        let capped = |t: usize| self.triangle_energy(t, &images).min(most * self.rests[t].area);
        let values: Vec<f64> = (0..self.triangles.len()).into_par_iter().map(capped).collect();
        values.iter().sum::<f64>() / TORUS_AREA
    }

    fn images(&self, x: &[Vector]) -> Vec<Point> {
        let of_sample = |(&(t, local), hint): (&(u32, u32), &AtomicU32)| {
            let corners = self.corners(t as usize, x);
            let [l, m, n] = self.cut.samples[local as usize];
            let image = self
                .target
                .image(&(corners[0] * l + corners[1] * m + corners[2] * n), hint.load(Relaxed));
            hint.store(image.copy, Relaxed);
            image.point
        };
        let samples = self.owners.par_iter().zip(&self.hints).with_min_len(64);
        samples.map(of_sample).collect()
    }

    fn triangle_energy(&self, t: usize, images: &[Point]) -> f64 {
        let part = self.cut.part_of(&self.rests[t]);
        let energy = |corners: &[usize; 3]| {
            let points = corners.map(|k| &images[self.samples[t][k] as usize]);
            image_energy(points, &part, self.softness)
        };
        self.cut.parts.iter().map(energy).sum()
    }

    /// For every sample the mean derivative of the image by the place.
    fn slopes(&self, x: &[Vector], images: &[Point]) -> Vec<Matrix3x2<f64>> {
        let of_triangle = |t: usize| -> Vec<(Matrix3x2<f64>, f64)> {
            let corners = self.corners(t, x);
            let place = |k: usize| {
                let [l, m, n] = self.cut.samples[k];
                corners[0] * l + corners[1] * m + corners[2] * n
            };
            let of_part = |part: &[usize; 3]| {
                let points = part.map(|k| &images[self.samples[t][k] as usize]);
                secant(part.map(place).each_ref(), points)
            };
            self.cut.parts.iter().map(of_part).collect()
        };
        let parts: Vec<_> = (0..self.triangles.len()).into_par_iter().map(of_triangle).collect();
        let mut sums = vec![(Matrix3x2::zeros(), 0.0); images.len()];
        // In order, so that the sums are the same for any number of threads.
        for (samples, of_parts) in self.samples.iter().zip(&parts) {
            for (part, (slope, area)) in self.cut.parts.iter().zip(of_parts) {
                for &k in part {
                    let sum = &mut sums[samples[k] as usize];
                    sum.0 += slope;
                    sum.1 += area;
                }
            }
        }
        sums.into_iter().map(|(slope, area)| slope / area).collect()
    }
}

impl Objective for TorusEnergy<'_> {
    fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn curvature(&self) -> Curvature {
        Curvature::Flat
    }

    fn corners(&self, triangle: usize, x: &[Vector]) -> [Vector; 3] {
        let (corners, shifts) = (self.triangles[triangle], self.shifts[triangle]);
        std::array::from_fn(|k| x[corners[k] as usize] + shifts[k])
    }

    fn value(&self, x: &[Vector]) -> f64 {
        let all = (0..self.triangles.len()).into_par_iter();
        let of_plane = |t: usize| barrier(self.corners(t, x).each_ref(), &self.rests[t]);
        let Some(barriers) = all.clone().map(of_plane).collect::<Option<Vec<f64>>>() else {
            return f64::INFINITY;
        };
        let images = self.images(x);
        let values: Vec<f64> = all.map(|t| self.triangle_energy(t, &images)).collect();
        let sum = values.iter().sum::<f64>() + barriers.iter().sum::<f64>();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    fn write_elements(&self, x: &[Vector], _: &[[Vector; 2]], elements: &mut Vec<ElementDerivatives>) {
        let images = self.images(x);
        let slopes = self.slopes(x, &images);
        let of_triangle = |t: usize| {
            let rest = &self.rests[t];
            let mut sum = barrier_derivatives(self.corners(t, x).each_ref(), rest);
            let chains: Vec<Chain<6>> = self
                .cut
                .samples
                .iter()
                .zip(&self.samples[t])
                .map(|(weights, &sample)| {
                    let slope = &slopes[sample as usize];
                    Chain::from_fn(|row, i| weights[i / 2] * slope[(row, i % 2)])
                })
                .collect();
            let part = self.cut.part_of(rest);
            for corners in &self.cut.parts {
                let points = corners.map(|k| &images[self.samples[t][k] as usize]);
                add_image_derivatives(points, corners.map(|k| &chains[k]), &part, self.softness, &mut sum);
            }
            let Derivatives { gradient, hessian } = sum;
            ElementDerivatives {
                gradient: gradient.into(),
                hessian,
            }
        };
        let triangles = (0..self.triangles.len()).into_par_iter();
        triangles.map(of_triangle).collect_into_vec(elements);
    }
}
