//! Similarities that lay one solid over another of any connectivity.
//!
//! Principal axes of the surfaces and the coordinates as given are starts, which the iterated closest point method
//! improves (Besl & McKay, *A method for registration of 3-D shapes*, IEEE PAMI 14, 1992), at the end with distances to
//! tangent planes (Chen & Medioni, *Object modelling by registration of multiple range images*, Image Vis. Comput. 10,
//! 1992). Points of either surface look for partners on the other, so that a limb that only one of them has is not passed
//! over; partners face the same way as far as there are such. Where the principal axes are ambiguous, rotations spread
//! evenly (Alexa, *Super-Fibonacci spirals*, CVPR 2022) are starts too.

use std::f64::consts::PI;

use nalgebra::{Quaternion, Rotation3, SMatrix, SVector, SymmetricEigen, UnitQuaternion};
use rayon::prelude::*;

use super::oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
use crate::geometry::{Similarity, similarity};
use crate::mesh::SurfaceMesh;
use crate::sampling::{Collocation, thin};
use crate::{Matrix3, Point, Vector};

/// Why a solid cannot be aligned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AlignError {
    /// A coordinate is not a number.
    #[error("the {side} has a vertex that is not finite; see `solidmap check`")]
    NonFinite {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
    /// There is no surface to align.
    #[error("the surface of the {side} has no area")]
    NoArea {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
    /// Two pairs leave a rotation free.
    #[error("{count} landmarks do not fix an alignment: give at least 3")]
    FewLandmarks {
        /// How many were given.
        count: usize,
    },
    /// Landmarks in one place or on a line leave a rotation free.
    #[error("the landmarks of the {side} lie on a line, so that they do not fix a rotation; add one beside it")]
    CollinearLandmarks {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
}

/// A solid as alignments need it: built once, aligned to any number of others.
#[derive(Debug, Clone)]
pub struct Body {
    /// Its own coordinates to those in which its surface has the centroid 0 and the root mean square radius 1.
    to_frame: Similarity,
    /// In the frame.
    query: OrientedQuery,
    /// Well-spread points with their normals, in the frame; every prefix is a coarser choice.
    samples: Vec<(Point, Vector)>,
    /// What the query answers for the samples that partners are sought among: where other queries near them begin.
    found: Vec<OrientedPoint>,
    /// Principal axes as columns, right-handed, the longest first.
    axes: Matrix3,
    /// Mean squares along them.
    extents: Vector,
    /// Twice the distance of the farthest vertex from the centroid, in the frame.
    size: f64,
    vertices: Vec<Point>,
    normals: Vec<Vector>,
}

/// Where an alignment was found from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum AlignmentStart {
    /// The solids as they lie, moved and scaled only.
    AsGiven,
    /// The domain turned so that coordinate axes meet coordinate axes.
    CoordinateAxes,
    /// Principal axes laid on principal axes.
    PrincipalAxes,
    /// One of the rotations spread evenly.
    Spread,
    /// Pairs of points.
    Landmarks,
}

/// A similarity from the domain to the target, and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// From coordinates of the domain to those of the target.
    pub similarity: Similarity,
    /// Root mean square of distance and difference of normals (a right angle counts like 0.14 sizes), from points of
    /// each surface to the other, as a fraction of the target's size: twice the largest distance from its centroid. What alignments are ordered by.
    pub residual: f64,
    /// The same of the distance alone.
    pub distance: f64,
    /// Where it was found from.
    pub start: AlignmentStart,
}

/// The best alignments of two solids.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignments {
    /// Proper ones, at least 20° apart, the least residual first; at least one, at most six. What the solids as they lie
    /// lead to is among them. Those that come close to the first say that it is ambiguous.
    pub best: Vec<Alignment>,
    /// The best one with a reflection. Where its residual is much less than that of the best proper one, the target looks
    /// like the mirror image of the domain.
    pub mirrored: Alignment,
}

impl AlignmentStart {
    /// Whether it depends on the coordinates that the solids are given in.
    fn is_given(self) -> bool {
        matches!(self, Self::AsGiven | Self::CoordinateAxes)
    }
}

impl Alignments {
    /// Whether the target fits the mirror image of the domain much better than the domain.
    pub fn looks_mirrored(&self) -> bool {
        self.mirrored.residual < MIRRORED * self.best[0].residual
    }

    /// Whether the second best alignment fits nearly as well as the best.
    pub fn is_ambiguous(&self) -> bool {
        let limit = (AMBIGUOUS * self.best[0].residual).max(EXACT);
        self.best.get(1).is_some_and(|second| second.residual < limit)
    }
}

/// Length that a normal is worth, as a fraction of the target's size.
pub(super) const REACH: f64 = 0.1;
/// Points of a surface that look for partners: to choose among the starts, to improve them, to refine what is left.
const FEW: usize = 120;
const SOME: usize = 250;
const MANY: usize = 1000;
/// Points that look for partners on the triangles.
const ON_TRIANGLES: usize = 150;
/// Points that partners are sought among.
const CANDIDATES: usize = 600;
/// Starts kept by their residual as they are, and alignments kept after the first stage.
const STARTS: usize = 20;
const FINALISTS: usize = 6;
/// Starts of the mirrored search.
const MIRRORED_STARTS: usize = 6;
const COARSE_STEPS: usize = 8;
const FINE_STEPS: usize = 12;
/// Steps on triangles.
const LAST_STEPS: usize = 4;
/// Alignments closer than this angle are one.
const APART: f64 = 20.0 * PI / 180.0;
/// Mean squares along two axes closer than this factor leave it open which is which.
const ALIKE: f64 = 1.25;
/// Starts added where axes are alike: every rotation is within about 50° of one of them.
const SPREAD: usize = 72;
const MIRRORED: f64 = 0.8;
const AMBIGUOUS: f64 = 1.05;
/// Residual below which two alignments are both exact.
const EXACT: f64 = 1e-6;
/// The scale stays within this factor of that which the sizes give.
const SCALES: f64 = 1.5;
/// Share of the landmarks in what an alignment with landmarks minimises.
const LANDMARK_SHARE: f64 = 0.9;
const SEED: u64 = 1;

impl Body {
    /// Prepares a closed surface, its triangles facing outward; `side` names it in errors. Costs a tree of its triangles.
    ///
    /// # Errors
    ///
    /// When the surface has no area, or a vertex that is not finite.
    pub fn new(surface: &SurfaceMesh, side: &'static str) -> Result<Self, AlignError> {
        if !surface.vertices().iter().all(|p| p.iter().all(|c| c.is_finite())) {
            return Err(AlignError::NonFinite { side });
        }
        let (centre, covariance) = moments(surface).ok_or(AlignError::NoArea { side })?;
        let radius = covariance.trace().sqrt();
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(AlignError::NoArea { side });
        }
        let to_frame = Similarity {
            scale: 1.0 / radius,
            rotation: Matrix3::identity(),
            translation: -centre.coords / radius,
        };
        let vertices = surface
            .vertices()
            .iter()
            .map(|p| Point::from((p - centre) / radius))
            .collect();
        let framed = surface.with_vertices(vertices).expect("one position per vertex");
        let normals = vertex_normals(&framed);
        let query = OrientedQuery::new(&framed, &normals).ok_or(AlignError::NoArea { side })?;
        let (axes, extents) = principal_axes(&(covariance / (radius * radius)));
        let samples = samples(&framed, &normals);
        let corners = framed.triangles().iter().flatten();
        let radii = corners.map(|&v| framed.vertices()[v as usize].coords.norm());
        let size = 2.0 * radii.fold(0.0, f64::max);
        let found = query.closest_of_all(&samples[..CANDIDATES.min(samples.len())], REACH * size, &[]);
        Ok(Self {
            to_frame,
            query,
            found,
            axes: towards_the_long_end(&axes, &samples),
            samples,
            extents,
            size,
            vertices: framed.into_parts().0,
            normals,
        })
    }

    /// Vertices and their unit normals carried to the frame of `target`.
    pub(super) fn vertices_in(&self, target: &Self, alignment: &Similarity) -> Vec<(Point, Vector)> {
        let to_target = target.to_frame.after(alignment).after(&self.to_frame.inverse());
        let moved = |(p, n): (&Point, &Vector)| (to_target.apply(p), to_target.rotation * n);
        self.vertices.iter().zip(&self.normals).map(moved).collect()
    }

    pub(super) fn query(&self) -> &OrientedQuery {
        &self.query
    }

    /// Twice the distance of the farthest vertex from the centroid, in the frame: unlike the diagonal of a box it stays
    /// as the solid turns.
    pub(super) fn size(&self) -> f64 {
        self.size
    }

    fn has_axes_alike(&self) -> bool {
        (0..2).any(|k| self.extents[k] < ALIKE * self.extents[k + 1])
    }
}

/// Lays the domain over the target by shape alone. The result is the same for any number of threads. Alignments found from
/// principal axes turn, move and grow with the solids; those found from the coordinates as given do not. Costs up to a
/// second or two of processor time.
pub fn align(domain: &Body, target: &Body) -> Alignments {
    let pair = Pair::new(domain, target);
    let (best, mirrored) = rayon::join(|| pair.search(1.0), || pair.search(-1.0));
    Alignments {
        best,
        mirrored: mirrored[0],
    }
}

/// Lays the domain over the target by pairs of points, in their own coordinates, that are to meet; then by shape, as far
/// as the pairs stay about as close. The reflection is of the pairs alone.
///
/// # Errors
///
/// With fewer than three pairs, or when those of one side lie on a line.
pub fn align_by_landmarks(
    domain: &Body,
    target: &Body,
    landmarks: &[(Point, Point)],
) -> Result<Alignments, AlignError> {
    let count = landmarks.len();
    if count < 3 {
        return Err(AlignError::FewLandmarks { count });
    }
    let framed = |&(a, b): &(Point, Point)| (domain.to_frame.apply(&a), target.to_frame.apply(&b), 1.0);
    let framed: Vec<(Point, Point, f64)> = landmarks.iter().map(framed).collect();
    for (side, points) in [
        ("domain", framed.iter().map(|pair| pair.0).collect::<Vec<_>>()),
        ("target", framed.iter().map(|pair| pair.1).collect()),
    ] {
        if !points.iter().flat_map(|p| p.iter()).all(|c| c.is_finite()) {
            return Err(AlignError::NonFinite { side });
        }
        if are_collinear(&points) {
            return Err(AlignError::CollinearLandmarks { side });
        }
    }
    let pair = Pair::new(domain, target);
    // Sides that are far from similar have no positive scale; the sizes of the solids give one then.
    let fitted = |sign: f64| {
        similarity(&framed, sign, None)
            .or_else(|| similarity(&framed, sign, Some(1.0)))
            .expect("the landmarks are finite and not all in one place")
    };
    let start = fitted(1.0);
    let refined = pair.refine(
        &pair.refine(&start, &framed, Effort::SAMPLES),
        &framed,
        Effort::LANDMARKS,
    );
    let misfit = |s: &Similarity| {
        framed
            .iter()
            .map(|(a, b, _)| (s.apply(a) - b).norm_squared())
            .sum::<f64>()
    };
    let allowed = 1.5 * misfit(&start).sqrt() + 0.01 * target.size * (count as f64).sqrt();
    let kept = if misfit(&refined).sqrt() <= allowed {
        refined
    } else {
        start
    };
    Ok(Alignments {
        best: vec![pair.describe(&kept, AlignmentStart::Landmarks)],
        mirrored: pair.describe(&fitted(-1.0), AlignmentStart::Landmarks),
    })
}

/// Two bodies, each in its frame; similarities here go from the one frame to the other.
struct Pair<'a> {
    domain: &'a Body,
    target: &'a Body,
    /// What a normal is worth in the frame of the target.
    reach: f64,
}

/// For each sample of the domain its partner on the target, and the other way round.
#[derive(Clone, Default)]
struct Partners {
    forward: Vec<Partner>,
    backward: Vec<Partner>,
}

#[derive(Clone, Copy)]
struct Partner {
    point: Point,
    normal: Vector,
    /// Normal of the plane that the distance is measured from to first order.
    plane: Vector,
    distance_squared: f64,
    /// On the triangles, if it was sought there.
    found: Option<OrientedPoint>,
}

/// Where partners are sought.
#[derive(Clone, Copy)]
enum Among {
    Samples,
    Triangles,
}

/// How far an alignment is refined.
#[derive(Clone, Copy)]
struct Effort {
    among: Among,
    count: usize,
    steps: usize,
}

impl Effort {
    const SAMPLES: Self = Self {
        among: Among::Samples,
        count: MANY / 2,
        steps: FINE_STEPS,
    };
    const TRIANGLES: Self = Self {
        among: Among::Triangles,
        count: ON_TRIANGLES,
        steps: LAST_STEPS,
    };
    const LANDMARKS: Self = Self {
        among: Among::Triangles,
        count: MANY,
        steps: FINE_STEPS,
    };
}

/// A similarity with its residual and where it was found from.
#[derive(Clone, Copy)]
struct Candidate {
    residual: f64,
    similarity: Similarity,
    start: AlignmentStart,
}

/// A point carried over from the domain and a point of the target that it should meet, with the normal that the distance
/// counts along.
struct Match {
    moved: Point,
    fixed: Point,
    normal: Vector,
    /// How far both face the same way: 0 to 1.
    weight: f64,
}

impl<'a> Pair<'a> {
    fn new(domain: &'a Body, target: &'a Body) -> Self {
        Self {
            domain,
            target,
            reach: REACH * target.size,
        }
    }

    /// Distinct alignments with orthogonal parts of determinant `sign`, the best first.
    fn search(&self, sign: f64) -> Vec<Alignment> {
        // Only the best reflection is asked for.
        let (most_starts, most) = if sign > 0.0 {
            (STARTS, FINALISTS)
        } else {
            (MIRRORED_STARTS, 1)
        };
        let scored = |(start, similarity)| Candidate {
            residual: self.residual(
                &similarity,
                &self.partners(&similarity, FEW, Among::Samples, &Partners::default()),
            ),
            similarity,
            start,
        };
        let starts = self.starts(sign).into_par_iter().map(scored).collect();
        let improved = distinct(starts, most_starts)
            .par_iter()
            .map(|start| self.improve_coarsely(start))
            .collect();
        let mut refined: Vec<(Alignment, Similarity)> = distinct(improved, most)
            .par_iter()
            .map(|Candidate { similarity, start, .. }| {
                let refined = self.refine(similarity, &[], Effort::SAMPLES);
                let refined = self.refine(&refined, &[], Effort::TRIANGLES);
                (self.describe(&refined, *start), refined)
            })
            .collect();
        refined.sort_by(|a, b| a.0.residual.total_cmp(&b.0.residual));
        let mut best: Vec<(Alignment, Similarity)> = Vec::with_capacity(refined.len());
        for (alignment, s) in refined {
            if best
                .iter()
                .all(|(_, other)| angle_between(&s.rotation, &other.rotation) > APART)
            {
                best.push((alignment, s));
            }
        }
        best.into_iter().map(|(alignment, _)| alignment).collect()
    }

    fn starts(&self, sign: f64) -> Vec<(AlignmentStart, Similarity)> {
        let turned = |choice: &Matrix3| self.target.axes * choice * self.domain.axes.transpose();
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
        if self.domain.has_axes_alike() || self.target.has_axes_alike() {
            // In the axes too, so that the result turns with the solids.
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

    /// A few steps with few points, by distances between points: it comes from far.
    fn improve_coarsely(&self, start: &Candidate) -> Candidate {
        let sign = start.similarity.rotation.determinant().signum();
        let mut partners = self.partners(&start.similarity, SOME, Among::Samples, &Partners::default());
        let mut best = Candidate {
            residual: self.residual(&start.similarity, &partners),
            ..*start
        };
        for _ in 0..COARSE_STEPS {
            let matches = self.matches(&best.similarity, &partners);
            let inverse = best.similarity.inverse();
            let pairs: Vec<(Point, Point, f64)> = matches
                .iter()
                .map(|m| (inverse.apply(&m.moved), m.fixed, m.weight + 1e-3))
                .collect();
            let Some(next) = similarity(&pairs, sign, Some(best.similarity.scale)) else {
                break;
            };
            partners = self.partners(&next, SOME, Among::Samples, &partners);
            let residual = self.residual(&next, &partners);
            if residual >= best.residual {
                break;
            }
            best = Candidate {
                residual,
                similarity: next,
                ..best
            };
        }
        best
    }

    /// Damped Gauss-Newton steps on distances along normals (Levenberg-Marquardt), as long as the residual falls.
    fn refine(&self, start: &Similarity, landmarks: &[(Point, Point, f64)], effort: Effort) -> Similarity {
        let Effort { among, count, steps } = effort;
        let mut best = *start;
        let mut partners = self.partners(&best, count, among, &Partners::default());
        let mut cost = self.cost(&best, &partners, landmarks);
        let mut damping = 1e-3;
        for _ in 0..steps {
            let (hessian, gradient) = self.normal_equations(&best, &partners, landmarks);
            let Some(next) = step(&best, &hessian, &gradient, damping) else {
                break;
            };
            let found = self.partners(&next, count, among, &partners);
            let next_cost = self.cost(&next, &found, landmarks);
            if next_cost < cost {
                let gain = (cost - next_cost) / cost;
                (best, partners, cost) = (next, found, next_cost);
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

    fn partners(&self, s: &Similarity, count: usize, among: Among, near: &Partners) -> Partners {
        let inverse = s.inverse();
        // The way back in lengths of the domain's frame, so that both use one metric.
        let back = self.reach / s.scale;
        Partners {
            forward: partners_on(self.target, self.domain, s, self.reach, (count, among), &near.forward),
            backward: partners_on(self.domain, self.target, &inverse, back, (count, among), &near.backward),
        }
    }

    fn matches(&self, s: &Similarity, partners: &Partners) -> Vec<Match> {
        let forward = self
            .domain
            .samples
            .iter()
            .zip(&partners.forward)
            .map(|((p, n), found)| Match {
                moved: s.apply(p),
                fixed: found.point,
                normal: found.plane,
                weight: (s.rotation * n).dot(&found.normal).max(0.0),
            });
        let backward = self
            .target
            .samples
            .iter()
            .zip(&partners.backward)
            .map(|((p, n), found)| Match {
                moved: s.apply(&found.point),
                fixed: *p,
                normal: s.rotation * found.plane,
                weight: (s.rotation * found.normal).dot(n).max(0.0),
            });
        forward.chain(backward).collect()
    }

    /// Root mean square over both directions, in lengths of the target's frame.
    fn residual(&self, s: &Similarity, partners: &Partners) -> f64 {
        let mean =
            |found: &[Partner]| found.iter().map(|f| f.distance_squared).sum::<f64>() / found.len().max(1) as f64;
        (0.5 * (mean(&partners.forward) + mean(&partners.backward) * s.scale * s.scale)).sqrt()
    }

    fn cost(&self, s: &Similarity, partners: &Partners, landmarks: &[(Point, Point, f64)]) -> f64 {
        let of_shape = self.residual(s, partners).powi(2);
        if landmarks.is_empty() {
            return of_shape;
        }
        let misfit: f64 = landmarks.iter().map(|(a, b, _)| (s.apply(a) - b).norm_squared()).sum();
        (1.0 - LANDMARK_SHARE) * of_shape + LANDMARK_SHARE * misfit / landmarks.len() as f64
    }

    fn normal_equations(
        &self,
        s: &Similarity,
        partners: &Partners,
        landmarks: &[(Point, Point, f64)],
    ) -> (Hessian, Unknowns) {
        let mut hessian = Hessian::zeros();
        let mut gradient = Unknowns::zeros();
        let mut add = |m: &Match| {
            let row = derivative(&m.moved, &m.normal);
            hessian += m.weight * row * row.transpose();
            gradient += m.weight * m.normal.dot(&(m.moved - m.fixed)) * row;
        };
        let matches = self.matches(s, partners);
        matches.iter().for_each(&mut add);
        let share = LANDMARK_SHARE / (1.0 - LANDMARK_SHARE) * matches.len() as f64 / landmarks.len().max(1) as f64;
        for (a, b, _) in landmarks {
            for axis in 0..3 {
                add(&Match {
                    moved: s.apply(a),
                    fixed: *b,
                    normal: Vector::ith(axis, 1.0),
                    weight: share,
                });
            }
        }
        (hessian, gradient)
    }

    /// The similarity in coordinates of the two solids, and its residuals with all samples.
    fn describe(&self, s: &Similarity, start: AlignmentStart) -> Alignment {
        let partners = self.partners(s, SOME, Among::Triangles, &Partners::default());
        let gaps = |points: &[(Point, Vector)], map: &Similarity, found: &[Partner]| {
            let sum: f64 = points
                .iter()
                .zip(found)
                .map(|((p, _), f)| (map.apply(p) - f.point).norm_squared())
                .sum();
            sum / found.len().max(1) as f64
        };
        let forward = gaps(&self.domain.samples, s, &partners.forward);
        let backward = gaps(&self.target.samples, &s.inverse(), &partners.backward) * s.scale * s.scale;
        Alignment {
            similarity: self.target.to_frame.inverse().after(s).after(&self.domain.to_frame),
            residual: self.residual(s, &partners) / self.target.size,
            distance: (0.5 * (forward + backward)).sqrt() / self.target.size,
            start,
        }
    }
}

/// A rotation vector, a translation and the logarithm of a scale.
type Unknowns = SVector<f64, 7>;
type Hessian = SMatrix<f64, 7, 7>;

/// For each of so many samples of `from`, carried over by `map`, its partner on `onto`.
fn partners_on(
    onto: &Body,
    from: &Body,
    map: &Similarity,
    reach: f64,
    (count, among): (usize, Among),
    near: &[Partner],
) -> Vec<Partner> {
    let partner = |(i, (p, n)): (usize, &(Point, Vector))| {
        let (p, n) = (map.apply(p), map.rotation * n);
        match among {
            Among::Samples => {
                let (index, distance_squared) = closest_sample(onto, &p, &n, reach);
                let (point, normal) = onto.samples[index];
                Partner {
                    point,
                    normal,
                    plane: normal,
                    distance_squared,
                    found: None,
                }
            }
            Among::Triangles => {
                let near = near.get(i).and_then(|partner| partner.found);
                let near = near.or_else(|| onto.found.get(closest_sample(onto, &p, &n, reach).0).copied());
                let found = onto.query.closest(&p, &n, reach, near.as_ref());
                Partner {
                    point: found.point,
                    normal: found.normal,
                    plane: plane_of(onto, &p, &found),
                    distance_squared: found.distance_squared,
                    found: Some(found),
                }
            }
        }
    };
    let samples = &from.samples[..count.min(from.samples.len())];
    samples.par_iter().enumerate().with_min_len(64).map(partner).collect()
}

/// Index of the closest of the first samples, and the square of its distance.
fn closest_sample(onto: &Body, p: &Point, n: &Vector, reach: f64) -> (usize, f64) {
    let squared = |(q, m): &(Point, Vector)| (p - q).norm_squared() + reach * reach * (n - m).norm_squared();
    let candidates = onto.samples[..CANDIDATES.min(onto.samples.len())].iter().enumerate();
    candidates.fold((0, f64::INFINITY), |best, (index, sample)| {
        let here = squared(sample);
        if here < best.1 { (index, here) } else { best }
    })
}

/// The direction to the closest point, along which the distance changes. On an edge several triangles have that point, and
/// rounding would choose among their normals; they count only where the direction is lost to rounding.
fn plane_of(onto: &Body, p: &Point, found: &OrientedPoint) -> Vector {
    let offset = p - found.point;
    if offset.norm() > 1e-6 * onto.size {
        offset.normalize()
    } else {
        onto.query.face_normal(found)
    }
}

/// How the distance along `normal` changes as a point turns about the origin, moves and grows.
fn derivative(p: &Point, normal: &Vector) -> Unknowns {
    let turn = p.coords.cross(normal);
    Unknowns::from([
        turn.x,
        turn.y,
        turn.z,
        normal.x,
        normal.y,
        normal.z,
        normal.dot(&p.coords),
    ])
}

/// The step of a system damped by a part of its mean diagonal entry; `None` when it has none, as without partners.
fn step(s: &Similarity, hessian: &Hessian, gradient: &Unknowns, damping: f64) -> Option<Similarity> {
    let damped = hessian + Hessian::identity() * (damping * hessian.trace() / 7.0);
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

/// One step of Newton's method towards the orthogonal matrix next to it, which rounding has led away.
fn orthogonal(r: &Matrix3) -> Matrix3 {
    0.5 * r * (Matrix3::from_diagonal_element(3.0) - r.transpose() * r)
}

/// The best `count` of those that are not close to a better one, and what began with the solids as given. Where starts
/// that turn with the solids lead to the same place as others, they stand for it.
fn distinct(mut candidates: Vec<Candidate>, count: usize) -> Vec<Candidate> {
    // Stable, so that equals stay in the order of the starts.
    candidates.sort_by(|a, b| a.residual.total_cmp(&b.residual));
    let (given, turning): (Vec<Candidate>, Vec<Candidate>) = candidates.into_iter().partition(|c| c.start.is_given());
    let mut kept: Vec<Candidate> = Vec::with_capacity(turning.len() + given.len());
    for next in turning.iter().chain(&given) {
        if !kept.iter().any(|other| is_same(other, next)) {
            kept.push(*next);
        }
    }
    kept.sort_by(|a, b| a.residual.total_cmp(&b.residual));
    kept.truncate(count);
    if let Some(as_given) = given.iter().find(|c| c.start == AlignmentStart::AsGiven)
        && !kept.iter().any(|other| is_same(other, as_given))
    {
        kept.truncate(count - 1);
        kept.push(*as_given);
    }
    kept
}

fn is_same(a: &Candidate, b: &Candidate) -> bool {
    angle_between(&a.similarity.rotation, &b.similarity.rotation) <= APART
}

/// Angle of the rotation from one orthogonal matrix to another of the same determinant.
pub(super) fn angle_between(a: &Matrix3, b: &Matrix3) -> f64 {
    (((a.transpose() * b).trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
}

/// The 24 matrices of determinant `sign` that carry axes to axes.
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

/// Rotations spread evenly over all of them, on a spiral in the space of unit quaternions.
pub(super) fn spread_rotations(count: usize) -> Vec<Matrix3> {
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

/// Centroid and covariance of the surface, exact for its triangles; `None` without area.
fn moments(surface: &SurfaceMesh) -> Option<(Point, Matrix3)> {
    let (low, high) = surface.bounding_box()?;
    // About the middle of the box: far from the origin the squares would cancel.
    let middle = nalgebra::center(&low, &high);
    let mut area = 0.0;
    let mut first = Vector::zeros();
    let mut second = Matrix3::zeros();
    for t in 0..surface.triangles().len() {
        let weight = surface.area_vector(t).norm();
        let corners = surface.corners(t).map(|p| p - middle);
        let sum: Vector = corners.iter().sum();
        let squares: Matrix3 = corners.iter().map(|c| c * c.transpose()).sum();
        area += weight;
        first += weight / 3.0 * sum;
        second += weight / 12.0 * (squares + sum * sum.transpose());
    }
    let mean = first / area;
    let covariance = second / area - mean * mean.transpose();
    let is_sound = area > 0.0 && covariance.iter().chain(mean.iter()).all(|c| c.is_finite());
    is_sound.then_some((middle + mean, covariance))
}

/// Right-handed principal axes as columns and the mean squares along them, the largest first.
fn principal_axes(covariance: &Matrix3) -> (Matrix3, Vector) {
    let eigen = SymmetricEigen::new(*covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [a, b] = [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned());
    let axes = Matrix3::from_columns(&[a, b, a.cross(&b)]);
    (axes, Vector::from(order.map(|k| eigen.eigenvalues[k].max(0.0))))
}

/// The first two axes turned to the side on which the samples reach farther, so that axes turn with the solid.
fn towards_the_long_end(axes: &Matrix3, samples: &[(Point, Vector)]) -> Matrix3 {
    let [a, b] = [0, 1].map(|k| {
        let axis = axes.column(k).into_owned();
        let skewness: f64 = samples.iter().map(|(p, _)| axis.dot(&p.coords).powi(3)).sum();
        if skewness < 0.0 { -axis } else { axis }
    });
    Matrix3::from_columns(&[a, b, a.cross(&b)])
}

fn samples(surface: &SurfaceMesh, normals: &[Vector]) -> Vec<(Point, Vector)> {
    let candidates = Collocation::even(surface, 4 * MANY, SEED).points;
    let positions: Vec<Point> = candidates
        .iter()
        .map(|p| p.position(surface, surface.vertices()))
        .collect();
    let normals: Vec<Point> = normals.iter().map(|n| Point::from(*n)).collect();
    let sample = |k: usize| {
        let normal = candidates[k].position(surface, &normals).coords;
        (positions[k], super::oriented_query::unit_or_zero(&normal))
    };
    thin(&positions, MANY).into_iter().map(sample).collect()
}

/// Whether points lie on a line, to a thousandth of their extent.
fn are_collinear(points: &[Point]) -> bool {
    let mean = points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64;
    let covariance: Matrix3 = points
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    let (_, extents) = principal_axes(&covariance);
    extents[1] <= 1e-6 * extents[0]
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::geometry::test_models;
    use crate::mesh::shapes;

    /// A ball with bumps and two horns of different length: no symmetry.
    fn horned(frequency: usize) -> SurfaceMesh {
        let horn = |p: &Point, axis: Vector, height: f64| {
            let cosine = p.coords.normalize().dot(&axis.normalize());
            height * (8.0 * (cosine - 1.0)).exp()
        };
        shapes::deformed(&shapes::bumpy_sphere(frequency), |p| {
            let longer = horn(p, Vector::new(1.0, 0.2, 0.3), 1.2) + horn(p, Vector::new(-0.2, 1.0, 0.5), 0.6);
            Point::from(p.coords.component_mul(&Vector::new(1.1, 0.9, 0.8)) * (1.0 + longer))
        })
    }

    fn body(surface: &SurfaceMesh) -> Body {
        Body::new(surface, "domain").unwrap()
    }

    fn random_similarity(seed: u64) -> Similarity {
        let mut random = StdRng::seed_from_u64(seed);
        let mut vector = || Vector::from_fn(|_, _| random.random_range(-1.0..1.0));
        Similarity {
            scale: 10f64.powf(3.0 * vector().x),
            rotation: Rotation3::new(vector() * PI).into_inner(),
            translation: vector() * 10.0,
        }
    }

    fn moved(surface: &SurfaceMesh, by: &Similarity) -> SurfaceMesh {
        shapes::deformed(surface, |p| by.apply(p))
    }

    fn largest_difference(surface: &SurfaceMesh, a: &Similarity, b: &Similarity) -> f64 {
        let gaps = surface.vertices().iter().map(|p| (a.apply(p) - b.apply(p)).norm());
        gaps.fold(0.0, f64::max) / (b.scale * surface.diagonal())
    }

    #[test]
    fn recovers_a_moved_turned_and_scaled_copy() {
        let surface = horned(10);
        for seed in 0..6 {
            let (first, second) = (random_similarity(seed), random_similarity(100 + seed));
            let (domain, target) = (moved(&surface, &first), moved(&surface, &second));
            let found = align(&body(&domain), &body(&target));
            let best = found.best[0];
            let error = largest_difference(&domain, &best.similarity, &second.after(&first.inverse()));
            assert!(error < 1e-8, "seed {seed}: {error:e}");
            assert!(best.residual < 1e-8 && !found.is_ambiguous() && !found.looks_mirrored());
        }
    }

    /// Sides are a ninth of the radius here, so that a chord is off a bump of a third of it by `h² / 8r` = 0.5 % of the
    /// radius, which is a fifth of the diagonal.
    #[test]
    fn recovers_a_copy_of_other_connectivity_to_the_error_of_the_meshes() {
        let (domain, target) = (horned(9), moved(&horned(13), &random_similarity(5)));
        let found = align(&body(&domain), &body(&target));
        let error = largest_difference(&domain, &found.best[0].similarity, &random_similarity(5));
        assert!(error < 5e-3, "{error:e}");
        assert!(!found.looks_mirrored());
    }

    #[test]
    fn knows_a_mirror_image() {
        let surface = horned(9);
        let mirrored = shapes::deformed(&surface, |p| Point::new(-p.x, p.y, p.z)).reversed();
        let found = align(&body(&surface), &body(&moved(&mirrored, &random_similarity(4))));
        assert!(found.looks_mirrored() && found.mirrored.residual < 1e-8);
        assert!(found.best.iter().all(|a| a.similarity.rotation.determinant() > 0.0));
        assert!(found.mirrored.similarity.rotation.determinant() < 0.0);
    }

    #[test]
    fn symmetric_solids_have_runners_up() {
        let brick = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 2.0 * p.y, 3.0 * p.z));
        let found = align(&body(&brick), &body(&brick));
        assert!(found.best.iter().filter(|a| a.residual < EXACT).count() == 4 && found.is_ambiguous());
        let cube = shapes::cube(1.0, 4);
        let turned = moved(&cube, &random_similarity(9));
        let found = align(&body(&cube), &body(&turned));
        assert!(found.best.len() == FINALISTS && found.is_ambiguous() && !found.looks_mirrored());
        assert!(found.best[1].residual < EXACT);
        let (fine, coarse) = (shapes::sphere(1.0, 3), shapes::sphere(2.0, 2));
        let found = align(&body(&fine), &body(&coarse));
        assert!(found.best[0].distance < 1e-2 && found.best[1].distance < 1e-2);
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let (a, b) = (
            body(&horned(7)),
            body(&shapes::polycube(&[[0, 0, 0], [1, 0, 0], [1, 1, 0]], 4)),
        );
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| align(&a, &b))
        };
        assert_eq!(with(1), with(4));
    }

    /// To the rounding of coordinates up to a thousand times as large as the solid, which the steps may amplify.
    #[test]
    fn turns_moves_and_scales_with_the_solids() {
        let bent = |p: &Point| Point::new(p.x + 0.2 * p.y * p.y, 1.3 * p.y, p.z + 0.1 * p.x * p.x);
        let (a, b) = (horned(7), shapes::deformed(&horned(8), bent));
        let (first, second) = (random_similarity(1), random_similarity(2));
        let plain = align(&body(&a), &body(&b)).best[0];
        let other = align(&body(&moved(&a, &first)), &body(&moved(&b, &second))).best[0];
        let expected = second.after(&plain.similarity);
        let error = largest_difference(&a, &other.similarity.after(&first), &expected);
        assert!(error < 1e-6, "{error:e}");
        assert!((plain.residual - other.residual).abs() < 1e-6);
    }

    #[test]
    fn flat_and_thin_solids_are_aligned_and_those_without_area_refused() {
        let flat = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 2.0 * p.y, 0.0));
        let found = align(&body(&flat), &body(&horned(5)));
        assert!(found.best[0].residual.is_finite());
        let needle = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 1e-4 * p.y, 1e-4 * p.z));
        assert!(align(&body(&needle), &body(&needle)).best[0].residual < 1e-6);
        let line = shapes::deformed(&shapes::cube(1.0, 2), |p| Point::new(p.x, 0.0, 0.0));
        assert!(matches!(
            Body::new(&line, "target"),
            Err(AlignError::NoArea { side: "target" })
        ));
        assert!(matches!(
            Body::new(&SurfaceMesh::default(), "domain"),
            Err(AlignError::NoArea { .. })
        ));
        let bad = shapes::deformed(&shapes::cube(1.0, 2), |p| Point::new(p.x, f64::INFINITY, 0.0));
        assert!(matches!(
            Body::new(&bad, "domain"),
            Err(AlignError::NonFinite { side: "domain" })
        ));
    }

    #[test]
    fn landmarks_decide_among_the_alignments_of_a_symmetric_solid() {
        let brick = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 2.0 * p.y, 3.0 * p.z));
        let half_turn = Rotation3::new(Vector::z() * PI).into_inner();
        let pairs: Vec<(Point, Point)> = brick.vertices()[..3].iter().map(|p| (*p, half_turn * p)).collect();
        let found = align_by_landmarks(&body(&brick), &body(&brick), &pairs).unwrap();
        assert!((found.best[0].similarity.rotation - half_turn).amax() < 1e-6);
    }

    #[test]
    fn landmarks_that_leave_a_rotation_free_are_refused() {
        let b = body(&shapes::sphere(1.0, 2));
        let line: Vec<(Point, Point)> = (0..4)
            .map(|k| (Point::new(f64::from(k), 0.0, 0.0), Point::new(0.0, f64::from(k), 0.0)))
            .collect();
        assert_eq!(
            align_by_landmarks(&b, &b, &line[..2]),
            Err(AlignError::FewLandmarks { count: 2 })
        );
        assert!(matches!(
            align_by_landmarks(&b, &b, &line),
            Err(AlignError::CollinearLandmarks { side: "domain" })
        ));
    }

    #[test]
    fn spread_rotations_reach_every_rotation() {
        let spread = spread_rotations(SPREAD);
        for seed in 0..200 {
            let any = random_similarity(seed).rotation;
            let nearest = spread
                .iter()
                .map(|r| angle_between(r, &any))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 50f64.to_radians(), "{nearest}");
        }
    }

    /// The hands differ in the pose of their fingers by up to a tenth of the diagonal.
    #[test]
    fn shape_alone_brings_the_landmarks_of_two_hands_together() {
        let hands = ["pairs/hand_plain.obj", "pairs/hand_vulcan.obj"].map(test_models::load);
        let [Some(plain), Some(vulcan)] = hands else {
            return;
        };
        let found = align(&body(&plain), &body(&vulcan));
        assert!(!found.looks_mirrored() && !found.is_ambiguous());
        for (a, b) in [(1191, 5864), (658, 5319), (205, 4772), (2751, 4053), (1512, 3166)] {
            let gap = found.best[0].similarity.apply(&plain.vertices()[a]) - vulcan.vertices()[b];
            assert!(gap.norm() < 0.15 * vulcan.diagonal(), "{a} {b} {}", gap.norm());
        }
    }
}
