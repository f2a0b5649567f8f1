//! Correspondences between two surfaces under a similarity, its residual, and Levenberg-Marquardt steps.

use nalgebra::{Rotation3, SMatrix, SVector};
use rayon::prelude::*;

use super::surface::{AlignmentSurface, CANDIDATES, NORMAL_WEIGHT, SAMPLES};
use super::{Alignment, AlignmentStart};
use crate::boundary_map::pair::oriented_query::OrientedPoint;
use crate::geometry::Similarity;
use crate::{Matrix3, Point, Vector};

/// Two surfaces, each in its frame; similarities here map the domain's frame to the target's.
pub(super) struct Registration<'a> {
    pub(super) domain: &'a AlignmentSurface,
    pub(super) target: &'a AlignmentSurface,
    /// Weight of normals in the frame of the target.
    pub(super) beta: f64,
    /// Directions of the domain and the target that correspond roughly.
    pub(super) up: Option<[Vector; 2]>,
}

/// For each sample of the domain its closest point on the target, and vice versa.
#[derive(Clone, Default)]
pub(super) struct Correspondences {
    forward: Vec<Correspondence>,
    backward: Vec<Correspondence>,
}

#[derive(Clone, Copy)]
struct Correspondence {
    point: Point,
    normal: Vector,
    /// Normal of the plane that distances are measured from.
    plane: Vector,
    distance_squared: f64,
    /// The result of the query, if the triangles were searched.
    found: Option<OrientedPoint>,
}

/// Where closest points are sought, and for how many samples of each surface.
#[derive(Clone, Copy)]
pub(super) enum Search {
    OnSamples(usize),
    OnTriangles(usize),
}

/// Settings of a refinement.
pub(super) struct Refinement {
    search: Search,
    steps: usize,
}

/// A point of the domain under the similarity, and the corresponding point of the target, with the direction that their
/// distance is measured along.
pub(super) struct MatchedPoints {
    pub(super) moved: Point,
    pub(super) fixed: Point,
    pub(super) normal: Vector,
    /// Agreement of the normals: 0 to 1.
    pub(super) weight: f64,
}

/// Samples whose closest points are sought on the triangles.
const ON_TRIANGLES: usize = 150;
/// Samples for the reported residual.
const REPORTED: usize = 250;
const FINE_STEPS: usize = 12;
/// Steps with closest points on triangles.
const LAST_STEPS: usize = 4;
/// The scale stays within this factor of the ratio of the root mean square radii.
const SCALES: f64 = 1.5;
/// Weight of the landmarks in the cost, of 1 in total.
const LANDMARK_SHARE: f64 = 0.9;

impl Refinement {
    pub(super) const SAMPLES: Self = Self {
        search: Search::OnSamples(SAMPLES / 2),
        steps: FINE_STEPS,
    };
    pub(super) const TRIANGLES: Self = Self {
        search: Search::OnTriangles(ON_TRIANGLES),
        steps: LAST_STEPS,
    };
    pub(super) const LANDMARKS: Self = Self {
        search: Search::OnTriangles(SAMPLES),
        steps: FINE_STEPS,
    };
}

impl<'a> Registration<'a> {
    pub(super) fn new(domain: &'a AlignmentSurface, target: &'a AlignmentSurface) -> Self {
        Self {
            domain,
            target,
            beta: NORMAL_WEIGHT * target.size,
            up: None,
        }
    }

    /// Levenberg-Marquardt steps on point-to-plane distances, as long as the cost falls.
    pub(super) fn refine(
        &self,
        start: &Similarity,
        landmarks: &[(Point, Point, f64)],
        refinement: Refinement,
    ) -> Similarity {
        let Refinement { search, steps } = refinement;
        let mut best = *start;
        let mut correspondences = self.correspondences(&best, search, &Correspondences::default());
        let mut cost = self.cost(&best, &correspondences, landmarks);
        let mut damping = 1e-3;
        for _ in 0..steps {
            let (hessian, gradient) = self.normal_equations(&best, &correspondences, landmarks);
            let Some(next) = step(&best, &hessian, &gradient, damping) else {
                break;
            };
            let found = self.correspondences(&next, search, &correspondences);
            let next_cost = self.cost(&next, &found, landmarks);
            if next_cost < cost {
                let gain = (cost - next_cost) / cost;
                (best, correspondences, cost) = (next, found, next_cost);
                damping = (damping * 0.1).max(1e-12);
                if gain < 1e-4 {
                    break;
                }
            } else if damping > 1.0 {
                break;
            } else {
                damping *= 30.0;
            }
        }
        best
    }

    pub(super) fn correspondences(&self, s: &Similarity, search: Search, hints: &Correspondences) -> Correspondences {
        let (domain, target) = (self.domain, self.target);
        // In lengths of the domain's frame, so that both directions have the same metric.
        let backward_beta = self.beta / s.scale;
        Correspondences {
            forward: correspondences_on(target, domain, s, self.beta, search, &hints.forward),
            backward: correspondences_on(domain, target, &s.inverse(), backward_beta, search, &hints.backward),
        }
    }

    pub(super) fn matches(&self, s: &Similarity, correspondences: &Correspondences) -> Vec<MatchedPoints> {
        let forward = |((p, n), found): (&(Point, Vector), &Correspondence)| MatchedPoints {
            moved: s.apply(p),
            fixed: found.point,
            normal: found.plane,
            weight: (s.rotation * n).dot(&found.normal).max(0.0),
        };
        let backward = |((p, n), found): (&(Point, Vector), &Correspondence)| MatchedPoints {
            moved: s.apply(&found.point),
            fixed: *p,
            normal: s.rotation * found.plane,
            weight: (s.rotation * found.normal).dot(n).max(0.0),
        };
        let from_domain = self.domain.samples.iter().zip(&correspondences.forward);
        let from_target = self.target.samples.iter().zip(&correspondences.backward);
        from_domain.map(forward).chain(from_target.map(backward)).collect()
    }

    /// Root mean square distance in both directions, in lengths of the target's frame.
    pub(super) fn residual(&self, s: &Similarity, correspondences: &Correspondences) -> f64 {
        let mean = |found: &[Correspondence]| {
            found.iter().map(|f| f.distance_squared).sum::<f64>() / found.len().max(1) as f64
        };
        (0.5 * (mean(&correspondences.forward) + mean(&correspondences.backward) * s.scale * s.scale)).sqrt()
    }

    fn cost(&self, s: &Similarity, correspondences: &Correspondences, landmarks: &[(Point, Point, f64)]) -> f64 {
        let of_shape = self.residual(s, correspondences).powi(2);
        if landmarks.is_empty() {
            return of_shape;
        }
        let misfit: f64 = landmarks.iter().map(|(a, b, _)| (s.apply(a) - b).norm_squared()).sum();
        (1.0 - LANDMARK_SHARE) * of_shape + LANDMARK_SHARE * misfit / landmarks.len() as f64
    }

    fn normal_equations(
        &self,
        s: &Similarity,
        correspondences: &Correspondences,
        landmarks: &[(Point, Point, f64)],
    ) -> (NormalMatrix, Unknowns) {
        let mut hessian = NormalMatrix::zeros();
        let mut gradient = Unknowns::zeros();
        let mut add = |m: &MatchedPoints| {
            let row = derivative(&m.moved, &m.normal);
            hessian += m.weight * row * row.transpose();
            gradient += m.weight * m.normal.dot(&(m.moved - m.fixed)) * row;
        };
        let matches = self.matches(s, correspondences);
        matches.iter().for_each(&mut add);
        let share = LANDMARK_SHARE / (1.0 - LANDMARK_SHARE) * matches.len() as f64 / landmarks.len().max(1) as f64;
        for (a, b, _) in landmarks {
            for axis in 0..3 {
                add(&MatchedPoints {
                    moved: s.apply(a),
                    fixed: *b,
                    normal: Vector::ith(axis, 1.0),
                    weight: share,
                });
            }
        }
        (hessian, gradient)
    }

    /// The similarity in the coordinates of the two solids, with its residuals.
    pub(super) fn describe(&self, s: &Similarity, start: AlignmentStart) -> Alignment {
        let correspondences = self.correspondences(s, Search::OnTriangles(REPORTED), &Correspondences::default());
        let gaps = |points: &[(Point, Vector)], map: &Similarity, found: &[Correspondence]| {
            let squares = points
                .iter()
                .zip(found)
                .map(|((p, _), f)| (map.apply(p) - f.point).norm_squared());
            squares.sum::<f64>() / found.len().max(1) as f64
        };
        let forward = gaps(&self.domain.samples, s, &correspondences.forward);
        let backward = gaps(&self.target.samples, &s.inverse(), &correspondences.backward) * s.scale * s.scale;
        Alignment {
            similarity: self.target.to_frame.inverse().after(s).after(&self.domain.to_frame),
            residual: self.residual(s, &correspondences) / self.target.size,
            distance: (0.5 * (forward + backward)).sqrt() / self.target.size,
            start,
        }
    }
}

/// A rotation vector, a translation and the logarithm of a scale.
type Unknowns = SVector<f64, 7>;
type NormalMatrix = SMatrix<f64, 7, 7>;

/// For each of the first samples of `from`, moved by `map`, its closest point on `onto`.
fn correspondences_on(
    onto: &AlignmentSurface,
    from: &AlignmentSurface,
    map: &Similarity,
    beta: f64,
    search: Search,
    hints: &[Correspondence],
) -> Vec<Correspondence> {
    let correspondence = |(i, (p, n)): (usize, &(Point, Vector))| {
        let (p, n) = (map.apply(p), map.rotation * n);
        match search {
            Search::OnSamples(_) => {
                let (index, distance_squared) = closest_sample(onto, &p, &n, beta);
                let (point, normal) = onto.samples[index];
                Correspondence {
                    point,
                    normal,
                    plane: normal,
                    distance_squared,
                    found: None,
                }
            }
            Search::OnTriangles(_) => {
                let hint = hints.get(i).and_then(|correspondence| correspondence.found);
                let hint = hint.or_else(|| onto.hints.get(closest_sample(onto, &p, &n, beta).0).copied());
                let found = onto.query.closest(&p, &n, beta, hint.as_ref());
                Correspondence {
                    point: found.point,
                    normal: found.normal,
                    plane: plane_of(onto, &p, &found),
                    distance_squared: found.distance_squared,
                    found: Some(found),
                }
            }
        }
    };
    let (Search::OnSamples(count) | Search::OnTriangles(count)) = search;
    let samples = from.samples[..count.min(from.samples.len())].par_iter().enumerate();
    samples.with_min_len(64).map(correspondence).collect()
}

/// Index of the closest of the first [`CANDIDATES`] samples, and the square of its distance.
fn closest_sample(onto: &AlignmentSurface, p: &Point, n: &Vector, beta: f64) -> (usize, f64) {
    let squared = |(q, m): &(Point, Vector)| (p - q).norm_squared() + beta * beta * (n - m).norm_squared();
    let candidates = onto.samples[..CANDIDATES.min(onto.samples.len())].iter().enumerate();
    candidates.fold((0, f64::INFINITY), |best, (index, sample)| {
        let here = squared(sample);
        if here < best.1 { (index, here) } else { best }
    })
}

/// The gradient of the distance: the direction from the closest point, or the triangle's normal where the distance is
/// zero up to rounding. The normal is ambiguous on edges.
fn plane_of(onto: &AlignmentSurface, p: &Point, found: &OrientedPoint) -> Vector {
    let offset = p - found.point;
    if offset.norm() > 1e-6 * onto.size {
        offset.normalize()
    } else {
        onto.query.face_normal(found)
    }
}

/// Derivative of the distance along `normal` with respect to rotation, translation and logarithm of the scale.
fn derivative(p: &Point, normal: &Vector) -> Unknowns {
    let turn = p.coords.cross(normal);
    let by_scale = normal.dot(&p.coords);
    Unknowns::from([turn.x, turn.y, turn.z, normal.x, normal.y, normal.z, by_scale])
}

/// The step of the normal equations, damped by a fraction of the mean diagonal entry; `None` when they are singular.
fn step(s: &Similarity, hessian: &NormalMatrix, gradient: &Unknowns, damping: f64) -> Option<Similarity> {
    let damped = hessian + NormalMatrix::identity() * (damping * hessian.trace() / 7.0);
    let change = -damped.cholesky()?.solve(gradient);
    if !change.iter().all(|c| c.is_finite()) {
        return None;
    }
    let turn = Rotation3::new(change.fixed_rows::<3>(0).into_owned());
    let moved = change.fixed_rows::<3>(3).into_owned();
    let scale = (s.scale * change[6].clamp(-0.5, 0.5).exp()).clamp(1.0 / SCALES, SCALES);
    let grown = scale / s.scale;
    Some(Similarity {
        scale,
        rotation: orthogonal(&(turn.matrix() * s.rotation)),
        translation: grown * (turn * s.translation) + moved,
    })
}

/// Removes rounding errors from an orthogonal matrix by one Newton-Schulz step towards the polar factor.
fn orthogonal(r: &Matrix3) -> Matrix3 {
    0.5 * r * (Matrix3::from_diagonal_element(3.0) - r.transpose() * r)
}
