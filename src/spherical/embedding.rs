//! From a surface to its map to the sphere: the hierarchy, the drawing level by level, Newton's method, the certificate.

use super::cmcf::{FlowOptions, flow};
use super::energy::{Energy, Objective, Weights};
use super::hierarchy::Hierarchy;
use super::moebius::centre;
use super::newton::{Newton, NewtonError, NewtonOptions, Stop};
use super::progressive::{Drawing, embed};
use super::relax::Relaxation;
use super::rest::RestShapes;
use super::{SphericalError, SphericalMap, certify, require_scale, require_sphere};
use crate::geometry::sphere_rotation;
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressMonitor, ProgressResponse};
use crate::{Point, Vector};

/// What a map to the sphere keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SphereEnergy {
    /// Angles, as far as triangles can (Gu, Wang, Chan, Thompson, Yau, *Genus zero surface conformal mapping*, 2004).
    /// Limbs shrink to specks.
    Conformal,
    /// Angles, with areas kept in bounds.
    Balanced,
}

/// Where the optimisation starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SphereStart {
    /// The drawing level by level, which never folds.
    Progressive,
    /// The conformalised mean curvature flow, where it comes out one to one and without specks; the other where it does
    /// not.
    Flow,
}

/// How a surface is mapped to the sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereOptions {
    /// What is kept.
    pub energy: SphereEnergy,
    /// Where the optimisation starts.
    pub start: SphereStart,
    /// Iterations of Newton's method at most.
    pub most_iterations: usize,
    /// Fall of the energy in one iteration, as a fraction of it, at which it ends.
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

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpherePhase {
    /// The surface is taken down to a tetrahedron.
    Coarsening,
    /// Vertices are put back.
    Drawing {
        /// How many are there.
        vertices: usize,
        /// Of how many.
        of: usize,
    },
    /// The flow runs.
    Flowing,
    /// Newton's method runs.
    Optimising,
}

/// What was done.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SphereReport {
    /// What was kept.
    pub energy: SphereEnergy,
    /// Where the optimisation started; not what was asked for where the flow is of no use.
    pub start: SphereStart,
    /// Energy per area before Newton's method: angles count 1 where they are kept, and areas with their weight.
    pub energy_before: f64,
    /// The same after it.
    pub energy_after: f64,
    /// Iterations of Newton's method.
    pub iterations: usize,
    /// Whether it ended because there was no more to gain.
    pub converged: bool,
}

/// Rounds of relaxation on each level.
const SWEEPS: usize = 5;
/// The flow shrinks long limbs to specks; where its energy is larger than this many times the other start's, the way back
/// is too long.
const MOST_START: f64 = 1e3;
/// Newton's method also runs on the levels with these shares of the vertices: there limbs are carried as a whole, which
/// moves of single vertices do not, at a small part of the cost.
const COARSE_SHARES: [usize; 3] = [64, 16, 4];
/// Iterations at most on such a level, and the fall of the energy that ends them.
const COARSE_ITERATIONS: usize = 25;
const COARSE_TOLERANCE: f64 = 1e-3;
/// Weight of areas where they are to be kept in bounds: on bodies with limbs areas then shrink to a hundredth at most, and
/// half of the triangles are stretched by less than 2.
const AREA_WEIGHT: f64 = 0.1;
/// Weight of areas while a conformal drawing is built: without it, coarse drawings may contract to a point of the sphere.
const AREA_WEIGHT_OF_START: f64 = 0.01;

/// A map of a closed surface of genus 0 to the unit sphere, turned so that directions lie near those from the surface's
/// centre. It is a bijection, by exact predicates, or there is an error.
///
/// Linear in the number of vertices `n` but for Newton's method, whose factorisation takes `n^1.5`: 134 000 vertices take
/// some 7 s and 0.6 GiB on two cores. The same for any number of threads.
///
/// # Errors
///
/// As [`require_sphere`], [`SphericalError::TooFine`] when rounding leaves no place for a vertex, and
/// [`SphericalError::Cancelled`] when `progress` says so ([`ProgressResponse`]), which is heard between levels and iterations.
pub fn map_to_sphere<A: ProgressResponse>(
    surface: &SurfaceMesh,
    options: &SphereOptions,
    progress: &dyn Fn(SpherePhase) -> A,
) -> Result<(SphericalMap, SphereReport), SphericalError> {
    let surface = require_sphere(surface)?;
    require_scale(&surface)?;
    let told = |phase| progress(phase).control_flow();
    let watch = ProgressMonitor::new(SpherePhase::Coarsening, &told);
    let drawn = draw(&surface, options, &watch)?;
    let rest = RestShapes::new(surface.triangles(), surface.vertices());
    let energy = Energy {
        rest: &rest,
        weights: final_weights(options.energy),
        pulls: &[],
    };
    let (mut directions, start) = match options.start {
        SphereStart::Progressive => (drawn, SphereStart::Progressive),
        SphereStart::Flow => {
            watch.report(SpherePhase::Flowing);
            let flowed = flow(surface.triangles(), surface.vertices(), &FlowOptions::default());
            let most = MOST_START * energy.value(&drawn);
            let flowed = flowed.filter(|x| energy.value(x) <= most);
            flowed.map_or((drawn, SphereStart::Progressive), |x| (x, SphereStart::Flow))
        }
    };
    watch.report(SpherePhase::Optimising);
    require_going_on(&watch)?;
    let failed = |error: NewtonError| match error {
        NewtonError::OutOfMemory { unknowns } => SphericalError::OutOfMemory { vertices: unknowns / 2 },
        // The drawing is one to one; only its energy can be too large for a number.
        _ => SphericalError::TooFine,
    };
    let mut newton = Newton::new(surface.triangles(), &[]).map_err(failed)?;
    let newton_options = NewtonOptions {
        most_iterations: options.most_iterations,
        tolerance: options.tolerance,
    };
    let descent = newton
        .minimise(&energy, &mut directions, &newton_options, &|| watch.should_continue())
        .map_err(failed)?;
    require_going_on(&watch)?;
    if options.energy == SphereEnergy::Conformal {
        centre(surface.triangles(), &vertex_areas(&surface), &mut directions);
    }
    turn_to_surface(&surface, &mut directions);
    let report = SphereReport {
        energy: options.energy,
        start,
        energy_before: descent.energy_before / (4.0 * std::f64::consts::PI),
        energy_after: descent.energy_after / (4.0 * std::f64::consts::PI),
        iterations: descent.iterations,
        converged: descent.stop != Stop::MostIterations,
    };
    Ok((SphericalMap::new(surface, &directions)?, report))
}

fn require_going_on(watch: &ProgressMonitor<SpherePhase>) -> Result<(), SphericalError> {
    if watch.should_continue() {
        Ok(())
    } else {
        Err(SphericalError::Cancelled)
    }
}

fn final_weights(energy: SphereEnergy) -> Weights {
    match energy {
        SphereEnergy::Conformal => Weights { angle: 1.0, area: 0.0 },
        SphereEnergy::Balanced => Weights {
            angle: 1.0,
            area: AREA_WEIGHT,
        },
    }
}

/// The drawing level by level.
fn draw(
    surface: &SurfaceMesh,
    options: &SphereOptions,
    watch: &ProgressMonitor<SpherePhase>,
) -> Result<Vec<Vector>, SphericalError> {
    require_going_on(watch)?;
    let points = surface.vertices();
    let hierarchy = Hierarchy::new(points, surface.triangles(), &[]).ok_or(SphericalError::TooFine)?;
    let area = match options.energy {
        SphereEnergy::Conformal => AREA_WEIGHT_OF_START,
        SphereEnergy::Balanced => AREA_WEIGHT,
    };
    let relaxation = Relaxation {
        points,
        weights: Weights { angle: 1.0, area },
        pull: &|_| None,
        is_fixed: &|_| false,
    };
    let mut shares = COARSE_SHARES.iter().peekable();
    let drawing = embed(
        &hierarchy,
        |_| None,
        |drawing| {
            let there = drawing.there.len();
            watch.report(SpherePhase::Drawing {
                vertices: there,
                of: points.len(),
            });
            // What is left then is quick, and of no use.
            if watch.is_cancelled() {
                return;
            }
            relaxation.run(drawing, SWEEPS);
            if shares.next_if(|&&share| there >= points.len() / share).is_some() && there < points.len() {
                optimise_coarse(drawing, points, relaxation.weights);
            }
        },
    );
    require_going_on(watch)?;
    Ok(drawing.ok_or(SphericalError::TooFine)?.directions)
}

/// Newton's method on a level of the drawing. What fails here is left to the finest level.
fn optimise_coarse(drawing: &mut Drawing, points: &[Point], weights: Weights) {
    let triangles = drawing.neighbours.triangles();
    let rest = RestShapes::new(&triangles, points);
    let energy = Energy {
        rest: &rest,
        weights,
        pulls: &[],
    };
    let options = NewtonOptions {
        most_iterations: COARSE_ITERATIONS,
        tolerance: COARSE_TOLERANCE,
    };
    let _ = Newton::new(&triangles, &[])
        .and_then(|mut newton| newton.minimise(&energy, &mut drawing.directions, &options, &|| true));
}

/// A third of the area of the triangles at each vertex.
fn vertex_areas(surface: &SurfaceMesh) -> Vec<f64> {
    let mut areas = vec![0.0; surface.vertices().len()];
    for (t, corners) in surface.triangles().iter().enumerate() {
        let third = surface.area_vector(t).norm() / 3.0;
        corners.iter().for_each(|&v| areas[v as usize] += third);
    }
    areas
}

/// Turns the drawing so that the directions of vertices are as near as can be to those from the surface's centre, unless
/// rounding would fold it.
fn turn_to_surface(surface: &SurfaceMesh, directions: &mut Vec<Vector>) {
    let weights = vertex_areas(surface);
    let total: f64 = weights.iter().sum();
    let positions = surface.vertices().iter().zip(&weights);
    let centre: Vector = positions.map(|(p, w)| *w / total * p.coords).sum();
    let outward = |p: &Point| (p.coords - centre).try_normalize(0.0).unwrap_or_default();
    let outward: Vec<Vector> = surface.vertices().iter().map(outward).collect();
    let Some(turn) = sphere_rotation(directions, &outward, &weights) else {
        return;
    };
    let turned: Vec<Vector> = directions.iter().map(|x| (turn.rotation * x).normalize()).collect();
    if certify(surface.triangles(), &turned).is_bijective() {
        *directions = turned;
    }
}
