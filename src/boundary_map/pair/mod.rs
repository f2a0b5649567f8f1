//! A bijective boundary map between two solids without a given correspondence: the composition of two embeddings, spherical
//! ones for solids of genus 0.
//!
//! 1. The target is embedded on the sphere ([`map_to_sphere`]).
//! 2. The domain is aligned with the target by similarities ([`align`]). The closest point of the target gives each
//!    vertex of the domain a soft target on the sphere ([`vertex_targets`]).
//! 3. The domain is embedded on the same sphere, coarse to fine, pulled towards the soft targets; several alignments
//!    and schedules are tried on coarse meshes and the best is refined.
//! 4. The domain's embedding is optimised for low distortion of the map from surface to surface.
//!
//! No step inverts a triangle on the sphere, so the result is a bijection at every point of the surface.
//!
//! Two solids of genus 1 are mapped through a flat torus instead, and two of more handles through a hyperbolic surface. Of solids with
//! several shells, which are components or cavities, each is mapped by itself.

mod alignment;
mod bent;
mod conformal;
mod curves;
mod drag;
mod embedder;
mod further_searches;
mod hyperbolic;
mod inter_surface;
mod isometry;
mod landmark_warp;
mod landmarks;
mod loops;
mod options;
mod oriented_query;
mod report;
mod rotation;
mod search;
mod shells;
mod soft_targets;
mod star;
mod starts;
mod stretch;
mod targets;
mod torus;

use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

pub use alignment::{AlignError, Alignment, AlignmentStart, AlignmentSurface, Alignments, align, align_by_landmarks};
pub use curves::{CurveError, LandmarkCurve};
pub use embedder::SoftTargetSchedule;
pub use landmarks::{LandmarkError, Landmarks};
pub use loops::LoopError;
pub use options::{PairMethod, PairOptions};
pub use oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
pub use report::{
    HyperbolicReport, NearerIsometry, PairAlternative, PairError, PairPhase, PairReport, PairStart, PairStartKind,
    PairTimings, ShellReport, TorusReport,
};
pub use rotation::{RotationMatch, search_rotations};
pub use shells::{ComponentMismatch, ComponentsError};
pub use stretch::{Stretch, StretchedArea};
pub use targets::{VertexTarget, vertex_targets};
pub use torus::{FittingTorus, fitting_torus};

use super::{BoundaryMap, SurfaceDistortion};
use crate::Vector;
use crate::hyperbolic::{HyperbolicError, require_genus_2_or_more};
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressControl, ProgressResponse, ProgressSender, run_cancellable};
use crate::spherical::{
    Hierarchy, SphereEnergy, SphereOptions, SphericalEmbedding, SphericalError, genus, map_to_sphere, require_genus,
    require_genus_0, require_scale,
};
use crate::toroidal::{ToroidalEmbedding, ToroidalError, require_genus_1};
use embedder::{DomainEmbedder, EmbeddingCandidate, Pin, Pins};
use hyperbolic::both_ways::by_both_ways;
use inter_surface::{InverseEmbedding, Spring};
use isometry::IntrinsicShapes;
use loops::LoopPair;

/// Vertices of landmark curves that coarse embeddings have.
const MOST_LATE_OF_CURVES: usize = 40;
/// Maps are alternatives to each other when their images of vertices are this far apart in the mean, as a fraction of the
/// target's diagonal.
const DISTINCT: f64 = 0.05;
/// Symmetric Dirichlet energy of an isometry.
const ISOMETRY_ENERGY: f64 = 4.0;
/// The error when the domain's vertices come too close together on the sphere.
const TOO_FINE: PairError = PairError::Sphere {
    side: "domain",
    error: SphericalError::TooFine,
};

/// A bijection from the boundary of one solid to that of another.
///
/// Takes some 7 s for 8000 vertices with limbs on two cores, less for solids of genus 1; two to three times as long where the map looks
/// wrong, since it is sought from the target to the domain, too. The result is the same for any number
/// of threads.
///
/// # Errors
///
/// When the solids are not of one genus, a hole is knotted, no class of maps between solids of genus 2 or more is found, or landmarks
/// cannot be met;
/// [`PairError::Cancelled`] when `progress` cancels it ([`ProgressResponse`]), which usually takes effect within a fraction of a
/// second.
pub fn map_pair<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<(BoundaryMap, PairReport), PairError> {
    let one = PairOptions {
        alternatives: 0,
        ..options.clone()
    };
    map_pair_with_alternatives(domain, target, &one, progress).map(|pair| (pair.map, pair.report))
}

/// As [`map_pair`], with up to [`PairOptions::alternatives`] other maps, each of which costs as much as refining one coarse
/// embedding.
///
/// # Errors
///
/// As [`map_pair`].
pub fn map_pair_with_alternatives<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let expected = domain.vertices().len();
    if let Some(start) = options.start.as_ref().filter(|start| start.image().len() != expected) {
        let vertices = start.image().len();
        return Err(PairError::Start { vertices, expected });
    }
    if [domain, target].iter().any(|surface| has_several_shells(surface)) {
        return shells::map_shells(domain, target, options, progress);
    }
    shells::require_pairs(&options.components, [1, 1])?;
    match common_genus([domain, target], options)? {
        0 => loops::require_none(&options.loops)?,
        1 => return map_tori(domain, target, options, progress),
        genus => return map_hyperbolic_surfaces(domain, target, genus, options, progress),
    }
    let of_side = |side| move |error| PairError::Sphere { side, error };
    let domain = require_genus_0(domain).map_err(of_side("domain"))?;
    let target = require_genus_0(target).map_err(of_side("target"))?;
    require_scale(&domain).map_err(of_side("domain"))?;
    require_scale(&target).map_err(of_side("target"))?;
    let landmarks = Landmarks::new(
        options.landmarks.pairs().to_vec(),
        domain.vertices().len(),
        target.vertices().len(),
    )?;
    let mut weights = options.landmarks_weight.into_iter().chain([options.curves_weight]);
    if let Some(weight) = weights.find(|weight| !(*weight > 0.0 && weight.is_finite())) {
        return Err(PairError::Weight(weight));
    }
    let is_direction = |up: &Vector| up.norm() > 0.0 && up.norm().is_finite();
    if !options.up.iter().flatten().all(is_direction) {
        return Err(PairError::Up);
    }
    let curves = curves::traced(&options.curves, &landmarks, &domain, &target)?;
    let given = Given {
        surfaces: [&domain, &target],
        landmarks: &landmarks,
        curves: &curves,
        loops: &[],
        options,
    };
    given.mapped(progress, |pair| match options.method {
        PairMethod::SoftTargets => pair.by_several_searches(),
        PairMethod::Conformal => pair.by_conformal_maps(),
        PairMethod::FlatTori | PairMethod::HyperbolicSurface => Err(of_no_handle("domain")),
    })
}

/// The checked inputs of a pair.
struct Given<'a> {
    /// Domain and target.
    surfaces: [&'a SurfaceMesh; 2],
    landmarks: &'a Landmarks,
    curves: &'a [curves::CurvePoint],
    loops: &'a [LoopPair],
    options: &'a PairOptions,
}

impl<'a> Given<'a> {
    /// Maps solids with handles, which take loops, and no landmarks or landmark curves.
    fn map_with_handles<A: ProgressResponse>(
        surfaces: [&SurfaceMesh; 2],
        options: &PairOptions,
        progress: &dyn Fn(PairPhase) -> A,
        work: impl FnOnce(PairMapping) -> Result<PairMaps, PairError> + Send,
    ) -> Result<PairMaps, PairError> {
        let (loops, points) = loops::traced(&options.loops, surfaces[0], surfaces[1])?;
        let given = Given {
            surfaces,
            landmarks: &Landmarks::none(),
            curves: &points,
            loops: &loops,
            options,
        };
        given.mapped(progress, work)
    }

    /// Does the work on other threads, so that `progress` can cancel it.
    fn mapped<A: ProgressResponse>(
        &self,
        progress: &dyn Fn(PairPhase) -> A,
        work: impl FnOnce(PairMapping) -> Result<PairMaps, PairError> + Send,
    ) -> Result<PairMaps, PairError> {
        let made = run_cancellable(&|phase| progress(phase).control(), |reporter| {
            work(PairMapping {
                domain: self.surfaces[0],
                target: self.surfaces[1],
                is_reversed: false,
                landmarks: self.landmarks,
                curves: self.curves,
                loops: self.loops,
                options: self.options,
                shapes: None,
                refined: None,
                begin: Instant::now(),
                reporter,
            })
        });
        made.unwrap_or(Err(PairError::Cancelled))
    }
}

fn of_no_handle(side: &'static str) -> PairError {
    let error = ToroidalError::Genus { genus: 0 };
    PairError::Torus { side, error }
}

/// Whether it is closed and manifold, and has more than one component.
fn has_several_shells(surface: &SurfaceMesh) -> bool {
    matches!(genus(surface), Err(SphericalError::Components { components }) if components > 1)
}

/// The same embeddings with another surface of the same triangles in place of the domain.
pub(crate) fn over_surface(map: &BoundaryMap, surface: SurfaceMesh) -> Result<BoundaryMap, PairError> {
    if let (Some(embedding), Some(target)) = (map.domain_embedding(), map.target_embedding()) {
        let embedding = SphericalEmbedding::new(surface, embedding.directions())
            .map_err(|error| PairError::Sphere { side: "domain", error })?;
        Ok(BoundaryMap::through_sphere(embedding, target.clone())?)
    } else if let Some([embedding, target]) = map.torus_embeddings() {
        let embedding = ToroidalEmbedding::new(surface, embedding.positions(), embedding.translations())
            .map_err(|error| PairError::Torus { side: "domain", error })?;
        Ok(BoundaryMap::through_torus(embedding, target.clone())?)
    } else if let Some([embedding, target]) = map.hyperbolic_embeddings() {
        let embedding = embedding
            .over(surface)
            .map_err(|error| PairError::Hyperbolic { side: "domain", error })?;
        Ok(BoundaryMap::through_hyperbolic_surface(embedding, target.clone())?)
    } else {
        Err(PairError::NoEmbedding)
    }
}

/// The genus of both solids.
///
/// # Errors
///
/// When a surface is not one closed manifold, or has another number of handles than the other.
fn common_genus([domain, target]: [&SurfaceMesh; 2], options: &PairOptions) -> Result<u64, PairError> {
    let genus = |side, surface| genus(surface).map_err(|error| PairError::Sphere { side, error });
    match [genus("domain", domain)?, genus("target", target)?] {
        [0, 0] => Ok(0),
        [domain, target] if domain != target => Err(PairError::UnequalGenus { domain, target }),
        [genus, _] => torus::require_options(options, genus).map(|()| genus),
    }
}

fn map_tori<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let of_side = |side| move |error| PairError::Torus { side, error };
    let domain = require_genus_1(domain).map_err(of_side("domain"))?;
    let target = require_genus_1(target).map_err(of_side("target"))?;
    let of_scale = |side| {
        move |error| PairError::Torus {
            side,
            error: ToroidalError::Surface(error),
        }
    };
    require_scale(&domain).map_err(of_scale("domain"))?;
    require_scale(&target).map_err(of_scale("target"))?;
    Given::map_with_handles([&domain, &target], options, progress, |pair| pair.by_tori())
}

fn map_hyperbolic_surfaces<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    genus: u64,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let oriented = |side, surface| -> Result<(SurfaceMesh, usize), PairError> {
        let of_side = |error| PairError::Hyperbolic { side, error };
        let handles = require_genus_2_or_more(surface).map_err(of_side)?;
        let oriented = require_genus(surface, genus).map_err(|error| of_side(HyperbolicError::Surface(error)))?;
        require_scale(&oriented).map_err(|error| of_side(HyperbolicError::Surface(error)))?;
        Ok((oriented, handles))
    };
    let (domain, genus) = oriented("domain", domain)?;
    let (target, _) = oriented("target", target)?;
    let is_concluded = Cell::new(false);
    let noting = |phase| {
        let control = progress(phase).control();
        is_concluded.set(is_concluded.get() || control == ProgressControl::Conclude);
        control
    };
    let make = |options: &PairOptions, is_exchanged: bool| {
        if is_exchanged && noting(PairPhase::Reversed) == ProgressControl::Cancel {
            return Err(PairError::Cancelled);
        }
        let surfaces = match is_exchanged {
            false => [&domain, &target],
            true => [&target, &domain],
        };
        Given::map_with_handles(surfaces, options, &noting, |pair| pair.by_hyperbolic_surface(genus))
    };
    by_both_ways(options, || is_concluded.get(), make)
}

/// The map of a pair, and others.
#[derive(Debug, Clone)]
pub struct PairMaps {
    /// The map with the least energy.
    pub map: BoundaryMap,
    /// What was done and found.
    pub report: PairReport,
    /// Other maps, in the order of [`PairReport::alternatives`], as many as were asked for; fewer where no more were found, or one
    /// misses a landmark.
    pub alternatives: Vec<BoundaryMap>,
}

struct PairMapping<'a> {
    domain: &'a SurfaceMesh,
    target: &'a SurfaceMesh,
    /// Whether these are the pair's target and domain: the map is sought the other way.
    is_reversed: bool,
    landmarks: &'a Landmarks,
    /// Vertices along landmark curves or loops, with their places on the target.
    curves: &'a [curves::CurvePoint],
    /// Loops that decide how handles go to handles.
    loops: &'a [LoopPair],
    options: &'a PairOptions,
    /// The intrinsic shapes, where they are known.
    shapes: Option<&'a IntrinsicShapes>,
    /// A map through the target's sphere that is the only start, once it is refined by eigenfunctions.
    refined: Option<&'a BoundaryMap>,
    begin: Instant,
    reporter: &'a ProgressSender<'a, PairPhase>,
}

impl PairMapping<'_> {
    /// Reports rounds of lowering the distortion; a cancellation takes effect in them.
    fn improving(&self, rounds: usize) {
        let _ = self.reporter.send(PairPhase::Improving {
            rounds,
            most_rounds: DomainEmbedder::MOST_ROUNDS,
        });
    }

    fn report(&self, phase: PairPhase) -> Result<(), PairError> {
        match self.reporter.send(phase) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(PairError::Cancelled),
        }
    }

    fn elapsed(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    fn sphere(
        &self,
        side: &'static str,
        surface: &SurfaceMesh,
        energy: SphereEnergy,
    ) -> Result<SphericalEmbedding, PairError> {
        let options = SphereOptions {
            energy,
            ..SphereOptions::default()
        };
        let forward = |phase| {
            let _ = self.reporter.send(PairPhase::Sphere(side, phase));
            self.reporter.control()
        };
        match map_to_sphere(surface, &options, &forward) {
            Ok((map, _)) => Ok(map),
            Err(SphericalError::Cancelled) => Err(PairError::Cancelled),
            Err(error) => Err(PairError::Sphere { side, error }),
        }
    }

    fn embedder<'a>(
        &'a self,
        target: &SphericalEmbedding,
        inverse: &'a InverseEmbedding<'a>,
    ) -> Result<DomainEmbedder<'a>, PairError> {
        let (vertices, pairs) = (self.domain.vertices(), self.landmarks.pairs());
        let metric = |to: &Vector| inverse.length_ratio(to).powi(2);
        let of_pairs = pairs.iter().map(|&[v, w]| (v, target.directions()[w as usize]));
        let of_curves = self
            .curves
            .iter()
            .map(|point| (point.vertex, target.direction(&point.place)));
        let (mut pins, mut springs) = (Vec::new(), BTreeMap::new());
        for (vertex, to) in of_pairs {
            match self.options.landmarks_weight {
                None => pins.push(Pin {
                    vertex,
                    to,
                    metric: metric(&to),
                }),
                Some(weight) => {
                    let weight = weight * metric(&to);
                    springs.insert(vertex, Spring { to, weight });
                }
            }
        }
        for (vertex, to) in of_curves {
            let weight = self.options.curves_weight / self.curves.len() as f64 * metric(&to);
            springs.entry(vertex).or_insert(Spring { to, weight });
        }
        // A few points of the curves are enough for coarse embeddings.
        let of_curves = self
            .curves
            .iter()
            .step_by(self.curves.len().div_ceil(MOST_LATE_OF_CURVES).max(1));
        let late = pairs
            .iter()
            .map(|pair| pair[0])
            .chain(of_curves.map(|point| point.vertex));
        let late: Vec<u32> = late.collect();
        Ok(DomainEmbedder {
            domain: self.domain,
            hierarchy: Hierarchy::new(vertices, self.domain.triangles(), &late).ok_or(TOO_FINE)?,
            inverse,
            shapes: None,
            pins: Pins::new(pins, vertices.len()),
            springs,
            reporter: self.reporter,
        })
    }

    fn require_landmarks(&self, candidate: &EmbeddingCandidate) -> Result<(), PairError> {
        let missed = candidate.missed();
        match missed.first() {
            None => Ok(()),
            Some(&first) => Err(PairError::LandmarksMissed {
                landmarks: self.landmarks.pairs().len(),
                first: self.landmarks.pairs()[first],
                missed,
            }),
        }
    }

    /// The better one of the maps before and after optimisation, with the distortion before and that of the map itself, and
    /// how far that stretches.
    fn measured(
        &self,
        target: &SphericalEmbedding,
        before: &EmbeddingCandidate,
        after: &EmbeddingCandidate,
    ) -> Result<(BoundaryMap, [SurfaceDistortion; 2], Stretch), PairError> {
        self.report(PairPhase::Measuring { done: 0, of: 2 })?;
        let no_area = || PairError::from(AlignError::NoArea { side: "domain" });
        let (first, last) = (self.through(before, target)?, self.through(after, target)?);
        let of_first = distortion(&first).ok_or_else(no_area)?;
        self.report(PairPhase::Measuring { done: 1, of: 2 })?;
        let of_last = distortion(&last).ok_or_else(no_area)?;
        let (map, distortions) = match before.missed().is_empty() && !is_lower(&of_last, &of_first) {
            true => (first, [of_first; 2]),
            false => (last, [of_first, of_last]),
        };
        let stretch = Stretch::of(&map, self.options.most_stretched).ok_or_else(no_area)?;
        Ok((map, distortions, stretch))
    }

    /// The map of an embedding of all vertices.
    fn through(&self, candidate: &EmbeddingCandidate, target: &SphericalEmbedding) -> Result<BoundaryMap, PairError> {
        let domain = SphericalEmbedding::new(self.domain.clone(), &candidate.embedding.directions)
            .map_err(|error| PairError::Sphere { side: "domain", error })?;
        Ok(BoundaryMap::through_sphere(domain, target.clone())?)
    }

    /// The largest distance of an image of a landmark, or of a vertex of a landmark curve, from where it is to be.
    fn landmark_error(&self, map: &BoundaryMap) -> f64 {
        let pairs = self.landmarks.pairs().iter();
        let of_pairs = pairs.map(|&[v, w]| (map.image()[v as usize] - self.target.vertices()[w as usize]).norm());
        let of_curves = self.curves.iter().map(|point| {
            let place = point.place.position(self.target, self.target.vertices());
            (map.image()[point.vertex as usize] - place).norm()
        });
        of_pairs.chain(of_curves).fold(0.0, f64::max) / self.target.diagonal()
    }
}

/// Whether optimisation was of use: it lowers the distortion of straight triangles, which can raise that of the map itself,
/// and it may trade one part of the surface for another. Compared by the mean, or by the product of three quantiles: a few
/// triangles across narrow limbs may dominate the mean, and one quantile alone does not see what lies above it.
fn is_lower(after: &SurfaceDistortion, before: &SurfaceDistortion) -> bool {
    product_of_quantiles(after) <= product_of_quantiles(before)
        || after.mean_symmetric_dirichlet <= before.mean_symmetric_dirichlet
}

fn product_of_quantiles(of: &SurfaceDistortion) -> f64 {
    let quantiles = of.symmetric_dirichlet;
    quantiles.p50 * quantiles.p90 * quantiles.p99
}

/// Distortion of the map itself rather than of straight triangles: over triangles cut into four, whose new vertices go
/// through the sphere.
fn distortion(map: &BoundaryMap) -> Option<SurfaceDistortion> {
    let fine = map.subdivided();
    SurfaceDistortion::of(fine.domain(), fine.image())
}
