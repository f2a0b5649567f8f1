//! Maps a surface to the sphere: hierarchy, progressive embedding, Newton's method, exact check.

use std::cell::Cell;

use super::cmcf::flow;
use super::distortion_energy::{DistortionEnergy, EnergyWeights, Objective};
use super::hierarchy::Hierarchy;
use super::moebius::centre;
use super::newton::{Newton, NewtonError, NewtonOptions, NewtonStop};
use super::progressive::PartialEmbedding;
use super::relax::Relaxation;
use super::rest_shape::RestShapes;
use super::{SphericalEmbedding, SphericalError, check_embedding, require_genus_0, require_scale};
use crate::geometry::sphere_rotation;
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressMonitor, ProgressResponse};
use crate::{Point, Vector};

/// What a map to the sphere preserves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SphereEnergy {
    /// Angles, as far as triangles can (Gu, Wang, Chan, Thompson, Yau, *Genus zero surface conformal mapping*, 2004).
    /// Long limbs shrink to tiny areas.
    Conformal,
    /// Angles, with a bound on the distortion of areas.
    Balanced,
}

/// Where the optimisation starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SphereStart {
    /// The progressive embedding, which is always a bijection.
    Progressive,
    /// The conformalised mean curvature flow, if it ends in a bijection without tiny triangles; otherwise
    /// [`SphereStart::Progressive`].
    Flow,
}

/// How a surface is mapped to the sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereOptions {
    /// What the map preserves.
    pub energy: SphereEnergy,
    /// Where the optimisation starts.
    pub start: SphereStart,
    /// Maximum number of iterations of Newton's method.
    pub most_iterations: usize,
    /// Relative decrease of the energy in an iteration below which Newton's method ends.
    pub tolerance: f64,
}

impl Default for SphereOptions {
    fn default() -> Self {
        Self {
            energy: SphereEnergy::Balanced,
            start: SphereStart::Progressive,
            most_iterations: 20,
            tolerance: 1e-5,
        }
    }
}

/// The current step of [`map_to_sphere`], for progress callbacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpherePhase {
    /// The surface is simplified to a tetrahedron.
    Coarsening,
    /// Vertices are inserted into the embedding.
    Embedding {
        /// Vertices inserted so far.
        vertices: usize,
        /// Vertices of the surface.
        total: usize,
    },
    /// The mean curvature flow runs.
    Flowing,
    /// Newton's method runs.
    Optimising {
        /// Iterations so far.
        iterations: usize,
        /// It ends after at most this many, usually long before.
        most_iterations: usize,
    },
}

/// What [`map_to_sphere`] did.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SphereReport {
    /// What the map preserves.
    pub energy: SphereEnergy,
    /// Where the optimisation started: [`SphereStart::Progressive`] if the result of the flow could not be used.
    pub start: SphereStart,
    /// Energy per unit area before Newton's method. An isometry has 1 (for angles) plus the weight of areas.
    pub energy_before: f64,
    /// The same after Newton's method.
    pub energy_after: f64,
    /// Iterations of Newton's method.
    pub iterations: usize,
    /// Whether it ended before the maximum number of iterations.
    pub converged: bool,
    /// Whether the optimisation was ended by the progress callback
    /// ([`ProgressControl::Conclude`](crate::progress::ProgressControl::Conclude)).
    pub concluded: bool,
}

/// Rounds of relaxation on each level.
const SWEEPS: usize = 5;
/// The flow shrinks long limbs to tiny areas, from which Newton's method would need many iterations: its result is not
/// used if its energy is above this many times that of the progressive embedding.
const MAX_FLOW_ENERGY_RATIO: f64 = 1e3;
/// Newton's method also runs on the levels with the number of vertices divided by these: it moves whole limbs, as
/// relaxation of single vertices does not, at a fraction of the cost on the finest level.
const COARSE_SHARES: [usize; 3] = [64, 16, 4];
/// Maximum iterations on such a level, and the relative decrease of the energy that ends them.
const COARSE_ITERATIONS: usize = 25;
const COARSE_TOLERANCE: f64 = 1e-3;
/// Weight of areas in [`SphereEnergy::Balanced`]: on solids with limbs, areas shrink to a hundredth at most, and half
/// of the triangles are stretched by less than 2.
const AREA_WEIGHT: f64 = 0.1;
/// Weight of areas during the progressive embedding for [`SphereEnergy::Conformal`]: without it, coarse embeddings can
/// contract to a point.
const AREA_WEIGHT_OF_START: f64 = 0.01;

/// Maps a closed surface of genus 0 to the unit sphere, rotated so that directions are close to those from the
/// surface's centroid. The result is a bijection, checked by exact predicates.
///
/// Cost is linear in the number of vertices `n`, except for the factorisation in Newton's method, `n^1.5`: 134 000
/// vertices take some 7 s and 0.6 GiB on two cores. The result is the same for any number of threads.
///
/// # Errors
///
/// As [`require_genus_0`], [`SphericalError::TooFine`] when rounding leaves no position for a vertex, and
/// [`SphericalError::Cancelled`] when `progress` asks to stop ([`ProgressResponse`]), which takes effect between levels
/// and iterations.
pub fn map_to_sphere<A: ProgressResponse>(
    surface: &SurfaceMesh,
    options: &SphereOptions,
    progress: &dyn Fn(SpherePhase) -> A,
) -> Result<(SphericalEmbedding, SphereReport), SphericalError> {
    let surface = require_genus_0(surface)?;
    require_scale(&surface)?;
    let respond = |phase| progress(phase).control();
    let monitor = ProgressMonitor::new(SpherePhase::Coarsening, &respond);
    let progressive = progressive_embedding(&surface, options, &monitor)?;
    let rest = RestShapes::new(surface.triangles(), surface.vertices());
    let [_, area] = area_weights(options.energy);
    let weights = EnergyWeights { angle: 1.0, area };
    let energy = DistortionEnergy { rest: &rest, weights };
    let (mut directions, start) = match options.start {
        SphereStart::Progressive => (progressive, SphereStart::Progressive),
        SphereStart::Flow => {
            monitor.report(SpherePhase::Flowing);
            let flowed = flow(surface.triangles(), surface.vertices());
            let most = MAX_FLOW_ENERGY_RATIO * energy.value(&progressive);
            let flowed = flowed.filter(|x| energy.value(x) <= most);
            flowed.map_or((progressive, SphereStart::Progressive), |x| (x, SphereStart::Flow))
        }
    };
    let most_iterations = options.most_iterations;
    let iterations = Cell::new(0);
    let optimising = || {
        let at = iterations.replace(iterations.get() + 1);
        monitor.report(SpherePhase::Optimising {
            iterations: at,
            most_iterations,
        });
        monitor.should_improve()
    };
    require_not_cancelled(&monitor)?;
    let failed = |error: NewtonError| match error {
        NewtonError::OutOfMemory { unknowns } => SphericalError::OutOfMemory { vertices: unknowns / 2 },
        // The start is a bijection; only its energy can overflow.
        _ => SphericalError::TooFine,
    };
    let mut newton = Newton::new(surface.triangles(), &[]).map_err(failed)?;
    let newton_options = NewtonOptions {
        most_iterations,
        tolerance: options.tolerance,
    };
    let descent = newton
        .minimise(&energy, &mut directions, &newton_options, &optimising)
        .map_err(failed)?;
    require_not_cancelled(&monitor)?;
    if options.energy == SphereEnergy::Conformal {
        centre(surface.triangles(), &surface.vertex_areas(), &mut directions);
    }
    rotate_to_surface(&surface, &mut directions);
    let report = SphereReport {
        energy: options.energy,
        start,
        energy_before: descent.energy_before / (4.0 * std::f64::consts::PI),
        energy_after: descent.energy_after / (4.0 * std::f64::consts::PI),
        iterations: descent.iterations,
        converged: descent.stop != NewtonStop::MaxIterations,
        concluded: monitor.is_concluded(),
    };
    Ok((SphericalEmbedding::new(surface, &directions)?, report))
}

fn require_not_cancelled(monitor: &ProgressMonitor<SpherePhase>) -> Result<(), SphericalError> {
    if monitor.should_continue() {
        Ok(())
    } else {
        Err(SphericalError::Cancelled)
    }
}

/// Weights of areas: during the progressive embedding, and at the end.
fn area_weights(energy: SphereEnergy) -> [f64; 2] {
    match energy {
        SphereEnergy::Conformal => [AREA_WEIGHT_OF_START, 0.0],
        SphereEnergy::Balanced => [AREA_WEIGHT; 2],
    }
}

/// Directions of the vertices, by inserting them level by level.
fn progressive_embedding(
    surface: &SurfaceMesh,
    options: &SphereOptions,
    monitor: &ProgressMonitor<SpherePhase>,
) -> Result<Vec<Vector>, SphericalError> {
    require_not_cancelled(monitor)?;
    let points = surface.vertices();
    let hierarchy = Hierarchy::new(points, surface.triangles(), &[]).ok_or(SphericalError::TooFine)?;
    let [area, _] = area_weights(options.energy);
    let relaxation = Relaxation {
        points,
        weights: EnergyWeights { angle: 1.0, area },
        soft_target: &|_| None,
        is_fixed: &|_| false,
    };
    let mut shares = COARSE_SHARES.iter().peekable();
    let mut embedding = PartialEmbedding::of_base(&hierarchy, |_| None);
    let completed = embedding.refine(&hierarchy, usize::MAX, |embedding| {
        let vertices = embedding.inserted.len();
        let total = points.len();
        monitor.report(SpherePhase::Embedding { vertices, total });
        // After a cancellation or conclusion the remaining levels are only inserted, which is quick.
        if monitor.is_cancelled() || monitor.is_concluded() {
            return;
        }
        relaxation.run(embedding, SWEEPS);
        if shares.next_if(|&&share| vertices >= total / share).is_some() && vertices < total {
            optimise_coarse(embedding, points, relaxation.weights);
        }
    });
    require_not_cancelled(monitor)?;
    completed.ok_or(SphericalError::TooFine)?;
    Ok(embedding.directions)
}

/// Newton's method on a coarse level. Errors are ignored: the finest level does without.
fn optimise_coarse(embedding: &mut PartialEmbedding, points: &[Point], weights: EnergyWeights) {
    let triangles = embedding.rings.triangles();
    let rest = RestShapes::new(&triangles, points);
    let energy = DistortionEnergy { rest: &rest, weights };
    let options = NewtonOptions {
        most_iterations: COARSE_ITERATIONS,
        tolerance: COARSE_TOLERANCE,
    };
    let _ = Newton::new(&triangles, &[])
        .and_then(|mut newton| newton.minimise(&energy, &mut embedding.directions, &options, &|| true));
}

/// Rotates the embedding so that the directions of vertices are as close as possible to those from the surface's
/// centroid, unless rounding would invert a triangle.
fn rotate_to_surface(surface: &SurfaceMesh, directions: &mut Vec<Vector>) {
    let weights = surface.vertex_areas();
    let total: f64 = weights.iter().sum();
    let positions = surface.vertices().iter().zip(&weights);
    let centre: Vector = positions.map(|(p, w)| *w / total * p.coords).sum();
    let outward = |p: &Point| (p.coords - centre).try_normalize(0.0).unwrap_or_default();
    let outward: Vec<Vector> = surface.vertices().iter().map(outward).collect();
    let Some(turn) = sphere_rotation(directions, &outward, &weights) else {
        return;
    };
    let turned: Vec<Vector> = directions.iter().map(|x| (turn.rotation * x).normalize()).collect();
    if check_embedding(surface.triangles(), &turned).is_bijective() {
        *directions = turned;
    }
}
