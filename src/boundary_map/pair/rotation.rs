//! Registration of two spherical embeddings by rotation.
//!
//! The score is the correlation of the area distortions, which are large at limbs and bumps. Their logarithms are
//! rasterised and smoothed on the sphere, and compared under uniformly spread rotations (Alexa, *Super-Fibonacci
//! spirals*, CVPR 2022); the best are refined by compass search (Kolda, Lewis & Torczon, SIAM Review 45, 2003).

use std::f64::consts::PI;

use nalgebra::Rotation3;
use rayon::prelude::*;

use super::alignment::{spread_out, spread_rotations};
use super::oriented_query::vertex_normals;
use crate::geometry::{Similarity, solid_angle};
use crate::sampling::bounding_sphere;
use crate::spherical::SphericalEmbedding;
use crate::{Matrix3, Point, Vector};

/// A rotation of the domain's embedding, and its score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotationMatch {
    /// Maps directions of the domain to directions of the target.
    pub rotation: Matrix3,
    /// Correlation of the logarithms of the area distortions; with an alignment, the mean of that and of the cosine
    /// between the normals.
    pub score: f64,
}

/// The best rotations, at least 15° apart, the highest score first: at least one, at most four. Two of about the same
/// score mean that the solids are symmetric or have too little in common.
///
/// With an `alignment` of the solids, their normals are compared too. Costs about half a second of one core.
pub fn search_rotations(
    domain: &SphericalEmbedding,
    target: &SphericalEmbedding,
    alignment: Option<&Similarity>,
) -> Vec<RotationMatch> {
    let turn = alignment.map(|s| s.rotation);
    let (from, to) = rayon::join(
        || Raster::new(domain, &turn.unwrap_or_else(Matrix3::identity)),
        || Raster::new(target, &Matrix3::identity()),
    );
    let matcher = |count: usize| Matcher::new(&from, &to, count, turn.is_some());
    let few = matcher(FEW);
    let starts = spread_rotations(STARTS).into_par_iter().map(|r| few.scored(r));
    let candidates = distinct(starts.collect(), CANDIDATES).into_par_iter();
    let improved = candidates.map(|start| few.improve(start, SPACING / 2.0, 5e-3));
    let many = matcher(MANY);
    let finalists = distinct(improved.collect(), FINALISTS).into_par_iter();
    let refined = finalists.map(|start| many.improve(many.scored(start.rotation), 1e-2, 1e-5));
    distinct(refined.collect(), FINALISTS)
}

/// Number of rotations to start from, and their spacing in radians.
const STARTS: usize = 4608;
const SPACING: f64 = 0.2;
/// Directions at which the embeddings are compared: at first, and for the finalists.
const FEW: usize = 700;
const MANY: usize = 6000;
const CANDIDATES: usize = 20;
const FINALISTS: usize = 4;
/// Rotations closer than this angle are the same.
const DISTINCT_ANGLE: f64 = 15.0 * PI / 180.0;
/// Rings from pole to pole.
const RINGS: usize = 128;
/// Angle at which the weight of the smoothing has fallen to zero.
const SMOOTHING: f64 = 0.12;

/// What is compared at a direction: the logarithm of the area distortion, and the normal of the surface.
type Descriptor = nalgebra::Vector4<f64>;

/// Descriptors in cells of about equal area between circles of latitude.
struct Raster {
    /// First cell of each ring, and after the last one the number of cells.
    starts: Vec<usize>,
    values: Vec<Descriptor>,
}

/// Compares the embeddings at fixed directions of the domain.
struct Matcher<'a> {
    at: Vec<(Vector, Descriptor)>,
    target: &'a Raster,
    with_normals: bool,
}

impl<'a> Matcher<'a> {
    fn new(domain: &Raster, target: &'a Raster, count: usize, with_normals: bool) -> Self {
        let directions = bounding_sphere(Point::origin(), 1.0, count);
        let at = directions.iter().map(|p| (p.coords, domain.value(&p.coords))).collect();
        Self {
            at,
            target,
            with_normals,
        }
    }

    fn scored(&self, rotation: Matrix3) -> RotationMatch {
        let (mut areas, mut normals) = (0.0, 0.0);
        for (direction, ours) in &self.at {
            let theirs = self.target.value(&(rotation * direction));
            areas += ours[0] * theirs[0];
            normals += ours.fixed_rows::<3>(1).dot(&theirs.fixed_rows::<3>(1));
        }
        let sum = if self.with_normals {
            0.5 * (areas + normals)
        } else {
            areas
        };
        let score = sum / self.at.len() as f64;
        RotationMatch { rotation, score }
    }

    /// Compass search by rotations about the axes, whose angle is halved from `step` to `least` radians.
    fn improve(&self, start: RotationMatch, mut step: f64, least: f64) -> RotationMatch {
        let mut best = start;
        while step > least {
            let turned = |axis: usize, angle: f64| {
                let turn = Rotation3::new(Vector::ith(axis, angle));
                self.scored(turn.matrix() * best.rotation)
            };
            let next = (0..6)
                .map(|k| turned(k / 2, if k % 2 == 0 { step } else { -step }))
                .fold(best, |best, other| if other.score > best.score { other } else { best });
            if next.score > best.score {
                best = next;
            } else {
                step *= 0.5;
            }
        }
        best
    }
}

/// The best `count` of those that are not close to a better one.
fn distinct(mut matches: Vec<RotationMatch>, count: usize) -> Vec<RotationMatch> {
    matches.sort_by(|a, b| b.score.total_cmp(&a.score));
    spread_out(matches, count, |found| found.rotation, DISTINCT_ANGLE)
}

impl Raster {
    /// The descriptors of an embedding, smoothed; area distortions are standardised to mean 0 and variance 1, normals
    /// rotated by `turn`.
    fn new(map: &SphericalEmbedding, turn: &Matrix3) -> Self {
        let mut raster = Self::empty();
        let sampled = raster.rasterise(map, &vertex_descriptors(map, turn));
        raster.values = raster.smoothed(&sampled);
        raster.standardise();
        raster
    }

    fn empty() -> Self {
        let height = PI / RINGS as f64;
        let mut starts = vec![0];
        for ring in 0..RINGS {
            let circumference = 2.0 * RINGS as f64 * ((ring as f64 + 0.5) * height).sin();
            starts.push(starts[ring] + circumference.round().max(3.0) as usize);
        }
        Self {
            values: vec![Descriptor::zeros(); starts[RINGS]],
            starts,
        }
    }

    fn cells_of(&self, ring: usize) -> usize {
        self.starts[ring + 1] - self.starts[ring]
    }

    /// Centre of a cell.
    fn direction(&self, ring: usize, cell: usize) -> Vector {
        let (sine, cosine) = ((ring as f64 + 0.5) * PI / RINGS as f64).sin_cos();
        let (y, x) = (2.0 * PI * (cell as f64 + 0.5) / self.cells_of(ring) as f64).sin_cos();
        Vector::new(sine * x, sine * y, cosine)
    }

    /// Interpolated linearly along and between rings.
    fn value(&self, direction: &Vector) -> Descriptor {
        let row = direction.z.clamp(-1.0, 1.0).acos() / PI * RINGS as f64 - 0.5;
        let turn = direction.y.atan2(direction.x) / (2.0 * PI);
        let turn = if turn < 0.0 { turn + 1.0 } else { turn };
        let below = row.floor().clamp(0.0, (RINGS - 2) as f64);
        let part = (row - below).clamp(0.0, 1.0);
        let ring = below as usize;
        self.value_on(ring, turn) * (1.0 - part) + self.value_on(ring + 1, turn) * part
    }

    fn value_on(&self, ring: usize, turn: f64) -> Descriptor {
        let cells = self.cells_of(ring);
        let place = turn * cells as f64 + (cells as f64 - 0.5);
        let (first, part) = (place.floor(), place.fract());
        let values = &self.values[self.starts[ring]..self.starts[ring + 1]];
        values[first as usize % cells] * (1.0 - part) + values[(first as usize + 1) % cells] * part
    }

    /// Calls `visit` with the cells whose centre is within `angle` of a direction, and some more around them.
    fn visit_cap(&self, centre: &Vector, angle: f64, mut visit: impl FnMut(usize, Vector)) {
        let height = PI / RINGS as f64;
        let colatitude = centre.z.clamp(-1.0, 1.0).acos();
        let longitude = centre.y.atan2(centre.x);
        let first = (((colatitude - angle) / height - 0.5).floor().max(0.0)) as usize;
        let last = (((colatitude + angle) / height - 0.5).ceil().max(0.0) as usize).min(RINGS - 1);
        for ring in first..=last {
            let cells = self.cells_of(ring);
            let here = (ring as f64 + 0.5) * height;
            // Spherical law of cosines; at the poles all longitudes are near.
            let cosine = (angle.cos() - colatitude.cos() * here.cos()) / (colatitude.sin() * here.sin());
            let half = if angle >= PI || cosine.is_nan() || cosine <= -1.0 {
                PI
            } else {
                cosine.min(1.0).acos()
            };
            let per_cell = 2.0 * PI / cells as f64;
            let begin = ((longitude - half) / per_cell - 0.5).floor() as i64;
            let count = ((2.0 * half / per_cell).ceil() as usize + 2).min(cells);
            for k in 0..count as i64 {
                let cell = (begin + k).rem_euclid(cells as i64) as usize;
                visit(self.starts[ring] + cell, self.direction(ring, cell));
            }
        }
    }

    /// Descriptors at the centres of the cells; `None` where rounding leaves no triangle.
    fn rasterise(&self, map: &SphericalEmbedding, values: &[Descriptor]) -> Vec<Option<Descriptor>> {
        let mut sampled = vec![None; self.values.len()];
        for corners in map.surface().triangles() {
            let [a, b, c] = corners.map(|v| map.directions()[v as usize]);
            let middle = (a + b + c).try_normalize(0.0).unwrap_or(a);
            let angle = [a, b, c].iter().map(|x| middle.angle(x)).fold(0.0, f64::max);
            // The cap about the corners holds a triangle within a hemisphere; a larger one may be anywhere.
            let angle = if angle < 1.5 { angle } else { PI };
            self.visit_cap(&middle, angle, |cell, x| {
                let weights = [x.dot(&b.cross(&c)), x.dot(&c.cross(&a)), x.dot(&a.cross(&b))];
                let sum: f64 = weights.iter().sum();
                if sum > 0.0 && weights.iter().all(|&w| w >= -1e-12) {
                    let weighted = (0..3).map(|k| values[corners[k] as usize] * (weights[k] / sum));
                    sampled[cell] = Some(weighted.sum());
                }
            });
        }
        sampled
    }

    fn smoothed(&self, sampled: &[Option<Descriptor>]) -> Vec<Descriptor> {
        let centres = (0..RINGS).flat_map(|ring| (0..self.cells_of(ring)).map(move |cell| (ring, cell)));
        let centres: Vec<(usize, usize)> = centres.collect();
        let (near, scale) = (SMOOTHING.cos(), 1.0 / (1.0 - SMOOTHING.cos()));
        let smooth = |&(ring, cell): &(usize, usize)| {
            let centre = self.direction(ring, cell);
            let mut sum = Descriptor::zeros();
            let mut total = 0.0;
            self.visit_cap(&centre, SMOOTHING, |other, x| {
                let cosine = centre.dot(&x);
                if let Some(value) = sampled[other].filter(|_| cosine > near) {
                    let weight = ((cosine - near) * scale).powi(2);
                    sum += weight * value;
                    total += weight;
                }
            });
            if total > 0.0 { sum / total } else { sum }
        };
        centres.par_iter().map(smooth).collect()
    }

    fn standardise(&mut self) {
        let count = self.values.len() as f64;
        let mean = self.values.iter().map(|v| v[0]).sum::<f64>() / count;
        let variance = self.values.iter().map(|v| (v[0] - mean).powi(2)).sum::<f64>() / count;
        // Without any distortion all scores are 0.
        let scale = if variance > 1e-20 { 1.0 / variance.sqrt() } else { 0.0 };
        self.values.iter_mut().for_each(|v| v[0] = (v[0] - mean) * scale);
    }
}

/// Descriptors of each vertex: the logarithm of the area of its triangles on the surface over that on the sphere, and
/// the normal.
fn vertex_descriptors(map: &SphericalEmbedding, turn: &Matrix3) -> Vec<Descriptor> {
    let surface = map.surface();
    let unit = 1.0 / surface.area().max(f64::MIN_POSITIVE);
    let mut areas = vec![(0.0, 0.0); surface.vertices().len()];
    for (t, corners) in surface.triangles().iter().enumerate() {
        let area = surface.area_vector(t).norm() * unit;
        let on_sphere = solid_angle(
            &Point::origin(),
            &corners.map(|v| Point::from(map.directions()[v as usize])),
        );
        for &v in corners {
            areas[v as usize].0 += area;
            areas[v as usize].1 += on_sphere;
        }
    }
    // Bounded below: the logarithm of zero would make every mean infinite.
    let logarithm = |x: f64| x.max(1e-30).ln();
    let descriptor = |(&(area, on_sphere), normal): (&(f64, f64), &Vector)| {
        let normal = turn * normal;
        Descriptor::new(logarithm(area) - logarithm(on_sphere), normal.x, normal.y, normal.z)
    };
    areas.iter().zip(&vertex_normals(surface)).map(descriptor).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boundary_map::pair::alignment::angle_between;
    use crate::mesh::{SurfaceMesh, shapes};

    fn radially_embedded(surface: &SurfaceMesh, turn: &Matrix3) -> SphericalEmbedding {
        let directions: Vec<Vector> = surface.vertices().iter().map(|p| turn * p.coords).collect();
        SphericalEmbedding::new(surface.clone(), &directions).unwrap()
    }

    /// The smoothed values change by a tenth over a cell of 0.03 rad, and are averaged over thousands of cells.
    #[test]
    fn recovers_a_rotation() {
        let surface = shapes::bumpy_sphere(20);
        for axis in [
            Vector::new(0.3, -0.1, 0.2),
            Vector::new(-2.0, 1.5, 1.0),
            Vector::new(0.1, 2.9, 0.6),
        ] {
            let turn = Rotation3::new(axis).into_inner();
            let (domain, target) = (
                radially_embedded(&surface, &Matrix3::identity()),
                radially_embedded(&surface, &turn),
            );
            let found = search_rotations(&domain, &target, None);
            let error = angle_between(&found[0].rotation, &turn);
            assert!(error < 1e-3 && found[0].score > 0.99, "{error:e} {}", found[0].score);
            assert!(found.get(1).is_none_or(|second| second.score < 0.9));
        }
    }

    #[test]
    fn normals_under_an_alignment_tell_symmetric_rotations_apart() {
        let brick = shapes::deformed(&shapes::sphere(1.0, 4), |p| Point::new(p.x, 1.5 * p.y, 2.2 * p.z));
        let map = radially_embedded(&brick, &Matrix3::identity());
        let found = search_rotations(&map, &map, None);
        assert_eq!(found.len(), FINALISTS);
        assert!(found[3].score > 0.99 * found[0].score);
        let half_turn = Rotation3::new(Vector::x() * PI).into_inner();
        for turn in [Matrix3::identity(), half_turn] {
            let alignment = Similarity {
                rotation: turn,
                ..Similarity::identity()
            };
            let best = search_rotations(&map, &map, Some(&alignment))[0];
            assert!(angle_between(&best.rotation, &turn) < 5e-3 && best.score > 0.98);
        }
    }

    #[test]
    fn an_embedding_without_distortion_has_some_rotation_and_no_correlation() {
        let map = radially_embedded(&shapes::sphere(1.0, 0), &Matrix3::identity());
        let found = search_rotations(&map, &map, None);
        assert!(!found.is_empty() && found.iter().all(|m| m.score.abs() < 1e-9));
    }

    #[test]
    fn every_cell_is_covered_by_a_triangle() {
        let raster = Raster::empty();
        for surface in [shapes::sphere(1.0, 0), shapes::bumpy_sphere(30), shapes::cube(1.0, 1)] {
            let map = radially_embedded(&surface, &Rotation3::new(Vector::new(0.1, 0.2, 0.3)).into_inner());
            let sampled = raster.rasterise(&map, &vec![Descriptor::repeat(2.0); surface.vertices().len()]);
            assert!(
                sampled
                    .iter()
                    .all(|v| v.is_some_and(|v| (v - Descriptor::repeat(2.0)).amax() < 1e-12))
            );
        }
    }
}
