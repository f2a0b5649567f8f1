//! Alignment (registration) of two solids of different meshes by similarities.
//!
//! The iterated closest point method (Besl & McKay, *A method for registration of 3-D shapes*, IEEE PAMI 14, 1992),
//! started from the principal axes of the surfaces and from the coordinates as given, and finished with point-to-plane
//! distances (Chen & Medioni, *Object modelling by registration of multiple range images*, Image Vis. Comput. 10,
//! 1992). Correspondences are sought from each surface to the other, so that a limb that only one of them has counts,
//! and in a metric that includes normals. Where the principal axes are ambiguous, uniformly spread rotations (Alexa,
//! *Super-Fibonacci spirals*, CVPR 2022) are starts too.

mod matching;
mod starts;
mod surface;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::geometry::{Similarity, similarity};
use crate::{Matrix3, Point, Vector};

pub(super) use starts::spread_rotations;
pub use surface::AlignmentSurface;
pub(super) use surface::NORMAL_WEIGHT;

use matching::{Correspondences, Refinement, Registration, Search};
use surface::principal_axes;

/// Why a solid cannot be aligned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AlignError {
    /// A coordinate is NaN or infinite.
    #[error("the {side} has a vertex that is not finite; see `solidmap check`")]
    NonFinite {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
    /// The surface has no area.
    #[error("the surface of the {side} has no area")]
    NoArea {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
    /// Fewer than three pairs leave a rotation free.
    #[error("{count} landmarks do not determine an alignment: give at least 3")]
    FewLandmarks {
        /// Number of landmarks given.
        count: usize,
    },
    /// Coincident or collinear landmarks leave a rotation free.
    #[error("the landmarks of the {side} lie on a line and do not determine a rotation; add one off the line")]
    CollinearLandmarks {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
}

/// What an alignment started from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum AlignmentStart {
    /// The coordinates as given, translated and scaled only.
    AsGiven,
    /// A rotation of the domain that maps coordinate axes to coordinate axes.
    CoordinateAxes,
    /// A rotation that maps principal axes to principal axes.
    PrincipalAxes,
    /// One of the uniformly spread rotations.
    Spread,
    /// A rotation that takes a given direction to another.
    Upright,
    /// Pairs of landmarks.
    Landmarks,
}

/// A similarity from the domain to the target, and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// From coordinates of the domain to those of the target.
    pub similarity: Similarity,
    /// Root mean square of distance and difference of normals (a right angle counts like 0.14 sizes), from points of
    /// each surface to the other, as a fraction of the target's size: twice the largest distance from its centroid.
    /// What alignments are ordered by.
    pub residual: f64,
    /// Root mean square of the distance alone, in the same unit.
    pub distance: f64,
    /// What it started from.
    pub start: AlignmentStart,
}

/// The best alignments of two solids.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignments {
    /// Orientation-preserving alignments, at least 20° apart, the least residual first; at least one, at most six. That
    /// from the coordinates as given is among them, unless a better one is close to it. The best is ambiguous if others
    /// have about the same residual.
    pub best: Vec<Alignment>,
    /// The best one with a reflection. If its residual is much lower than that of `best[0]`, the target looks like the
    /// mirror image of the domain.
    pub mirrored: Alignment,
}

impl AlignmentStart {
    /// Whether it depends on the coordinate frames of the solids.
    fn depends_on_frames(self) -> bool {
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

/// Samples of a surface for the choice of starts, and for their coarse improvement.
const START_SAMPLES: usize = 120;
const COARSE_SAMPLES: usize = 250;
/// Starts kept by their initial residual, and alignments kept after the coarse improvement.
const STARTS: usize = 20;
const FINALISTS: usize = 6;
/// Starts kept in the search with reflections.
const MIRRORED_STARTS: usize = 6;
const COARSE_STEPS: usize = 8;
/// Alignments closer than this angle are the same.
const DISTINCT_ANGLE: f64 = 20.0 * PI / 180.0;
/// Directions that correspond roughly are this close.
pub(super) const UPRIGHT: f64 = PI / 3.0;
/// Ratio of residuals below which the target looks like the mirror image.
const MIRRORED: f64 = 0.8;
/// Ratio of the second smallest residual to the smallest below which the best alignment is ambiguous.
const AMBIGUOUS: f64 = 1.05;
/// Alignments with residuals below this are all exact.
const EXACT: f64 = 1e-6;

/// Aligns the domain with the target by shape alone. The result is the same for any number of threads. Alignments
/// started from principal axes are equivariant under similarities of the solids; those from the coordinates as given
/// are not. Costs up to two seconds of processor time.
pub fn align(domain: &AlignmentSurface, target: &AlignmentSurface) -> Alignments {
    align_upright(domain, target, None)
}

/// As [`align`], with rotations alone that take the first of the directions `up` to within [`UPRIGHT`] of the second.
pub(super) fn align_upright(
    domain: &AlignmentSurface,
    target: &AlignmentSurface,
    up: Option<&[Vector; 2]>,
) -> Alignments {
    let pair = Registration {
        up: up.copied(),
        ..Registration::new(domain, target)
    };
    let (best, mirrored) = rayon::join(|| pair.search(1.0), || pair.search(-1.0));
    Alignments {
        best,
        mirrored: mirrored[0],
    }
}

/// Aligns the domain with the target by pairs of corresponding points, then by shape as well unless that moves the
/// pairs apart. The mirrored alignment is by the pairs alone.
///
/// # Errors
///
/// With fewer than three pairs, or when those of one side lie on a line.
pub fn align_by_landmarks(
    domain: &AlignmentSurface,
    target: &AlignmentSurface,
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
    let pair = Registration::new(domain, target);
    // Point sets that are far from similar have no positive scale: then the sizes of the solids give it.
    let fitted = |sign: f64| {
        similarity(&framed, sign, None)
            .or_else(|| similarity(&framed, sign, Some(1.0)))
            .expect("the landmarks are finite and not all in one place")
    };
    let start = fitted(1.0);
    let refined = pair.refine(
        &pair.refine(&start, &framed, Refinement::SAMPLES),
        &framed,
        Refinement::LANDMARKS,
    );
    let misfit = |s: &Similarity| -> f64 { framed.iter().map(|(a, b, _)| (s.apply(a) - b).norm_squared()).sum() };
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

/// A similarity with its residual and what it started from.
#[derive(Clone, Copy)]
struct AlignmentCandidate {
    residual: f64,
    similarity: Similarity,
    start: AlignmentStart,
}

impl Registration<'_> {
    /// Distinct alignments with orthogonal parts of determinant `sign`, the best first.
    fn search(&self, sign: f64) -> Vec<Alignment> {
        // Only the best alignment with a reflection is needed.
        let (most_starts, most) = if sign > 0.0 {
            (STARTS, FINALISTS)
        } else {
            (MIRRORED_STARTS, 1)
        };
        let scored = |(start, similarity)| {
            let found = self.correspondences(
                &similarity,
                Search::OnSamples(START_SAMPLES),
                &Correspondences::default(),
            );
            AlignmentCandidate {
                residual: self.residual(&similarity, &found),
                similarity,
                start,
            }
        };
        let mut starts = starts::starts(self.domain, self.target, sign);
        if let Some(up) = &self.up {
            starts.retain(|(_, similarity)| is_upright(&similarity.rotation, up));
            starts.extend(starts::upright(up, sign));
        }
        let starts = starts.into_par_iter().map(scored).collect();
        let improved = distinct(starts, most_starts)
            .par_iter()
            .map(|start| self.improve_coarsely(start))
            .collect();
        let mut refined: Vec<(Alignment, Similarity)> = distinct(improved, most)
            .par_iter()
            .map(|AlignmentCandidate { similarity, start, .. }| {
                let refined = self.refine(similarity, &[], Refinement::SAMPLES);
                let refined = self.refine(&refined, &[], Refinement::TRIANGLES);
                (self.describe(&refined, *start), refined)
            })
            .collect();
        refined.sort_by(|a, b| a.0.residual.total_cmp(&b.0.residual));
        if let Some(up) = &self.up
            && refined.iter().any(|(_, s)| is_upright(&s.rotation, up))
        {
            refined.retain(|(_, s)| is_upright(&s.rotation, up));
        }
        let best = spread_out(refined, usize::MAX, |(_, s)| s.rotation, DISTINCT_ANGLE);
        best.into_iter().map(|(alignment, _)| alignment).collect()
    }

    /// A few point-to-point steps with few samples, which converge from far.
    fn improve_coarsely(&self, start: &AlignmentCandidate) -> AlignmentCandidate {
        let sign = start.similarity.rotation.determinant().signum();
        let search = Search::OnSamples(COARSE_SAMPLES);
        let mut correspondences = self.correspondences(&start.similarity, search, &Correspondences::default());
        let mut best = AlignmentCandidate {
            residual: self.residual(&start.similarity, &correspondences),
            ..*start
        };
        for _ in 0..COARSE_STEPS {
            let matches = self.matches(&best.similarity, &correspondences);
            let inverse = best.similarity.inverse();
            let pairs = matches
                .iter()
                .map(|m| (inverse.apply(&m.moved), m.fixed, m.weight + 1e-3));
            let pairs: Vec<(Point, Point, f64)> = pairs.collect();
            let Some(next) = similarity(&pairs, sign, Some(best.similarity.scale)) else {
                break;
            };
            correspondences = self.correspondences(&next, search, &correspondences);
            let residual = self.residual(&next, &correspondences);
            if residual >= best.residual {
                break;
            }
            best = AlignmentCandidate {
                residual,
                similarity: next,
                ..best
            };
        }
        best
    }
}

/// Whether a rotation takes the first direction to within [`UPRIGHT`] of the second.
pub(super) fn is_upright(rotation: &Matrix3, [from, to]: &[Vector; 2]) -> bool {
    (rotation * from).angle(to) < UPRIGHT
}

/// The best `count` that are not close to a better one, always including that from the coordinates as given. Of close
/// ones, those that do not depend on the coordinate frames are preferred.
fn distinct(mut candidates: Vec<AlignmentCandidate>, count: usize) -> Vec<AlignmentCandidate> {
    // Stable, so that equals stay in the order of the starts.
    candidates.sort_by(|a, b| a.residual.total_cmp(&b.residual));
    let (given, equivariant): (Vec<AlignmentCandidate>, Vec<AlignmentCandidate>) =
        candidates.into_iter().partition(|c| c.start.depends_on_frames());
    let as_given = given.iter().copied().find(|c| c.start == AlignmentStart::AsGiven);
    let rotation = |c: &AlignmentCandidate| c.similarity.rotation;
    let mut kept = spread_out(
        equivariant.into_iter().chain(given),
        usize::MAX,
        rotation,
        DISTINCT_ANGLE,
    );
    kept.sort_by(|a, b| a.residual.total_cmp(&b.residual));
    kept.truncate(count);
    if let Some(as_given) = as_given
        && !kept
            .iter()
            .any(|other| angle_between(&rotation(other), &rotation(&as_given)) <= DISTINCT_ANGLE)
    {
        kept.truncate(count - 1);
        kept.push(as_given);
    }
    kept
}

/// The first `most` whose rotations are more than `apart` radians from those of all kept before them.
pub(super) fn spread_out<T>(
    items: impl IntoIterator<Item = T>,
    most: usize,
    rotation: impl Fn(&T) -> Matrix3,
    apart: f64,
) -> Vec<T> {
    let mut kept: Vec<T> = Vec::new();
    for next in items {
        if kept.len() == most {
            break;
        }
        let is_close = |other: &T| angle_between(&rotation(&next), &rotation(other)) <= apart;
        if !kept.iter().any(is_close) {
            kept.push(next);
        }
    }
    kept
}

/// Angle of the rotation between two orthogonal matrices of the same determinant.
pub(super) fn angle_between(a: &Matrix3, b: &Matrix3) -> f64 {
    (((a.transpose() * b).trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
}

/// Whether points lie on a line, to a thousandth of their extent.
fn are_collinear(points: &[Point]) -> bool {
    let mean = points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64;
    let offsets = points.iter().map(|p| p.coords - mean);
    let covariance: Matrix3 = offsets.map(|offset| offset * offset.transpose()).sum();
    let (_, variances) = principal_axes(&covariance);
    variances[1] <= 1e-6 * variances[0]
}
