//! A boundary map made better for the inside: the harmonic energy of the volume is lowered over bijections of the boundaries, at
//! bounded distortion of the surface (the paper's section 6 leaves it open).
//!
//! The harmonic energy alone has no minimum among bijections: it falls towards zero as the images of all vertices run together. So
//! what is lowered is its sum with the symmetric Dirichlet energy of the map from surface to surface, and the first counts for more
//! and more, until the distortion has reached its bound.
//!
//! 1. The energy and its derivative by the image of every vertex come from the fitted map.
//! 2. The energy of a map nearby is at most that of the derivative and a quadratic form in the change `δ` of the boundary's images.
//!    For harmonic maps the form is `∫ δ · Λ δ dA` with the Dirichlet-to-Neumann operator `Λ`, on a smooth surface the root of its
//!    Laplacian `L` up to a smoother one. `κ + L / κ ≥ 2 √L` for any `κ`, so that masses and springs along the edges take its place.
//! 3. Sweeps lower the sum over the places of the domain's vertices on the sphere, the flat torus or the hyperbolic surface.
//!    No triangle is ever inverted there.
//! 4. The new map is certified as a bijection and fitted, and replaces the one before if the energy of the volume has fallen.
//!
//! The shells of a solid with several, components and cavities, move in the same rounds: the energy of the volume couples them. Those of
//! their surfaces are added by their areas in the domain.

mod shell;
mod volume;

use std::borrow::Cow;

use crate::boundary_map::{BoundaryMap, BoundaryMapError, SurfaceDistortion, triangle_distortions};
use crate::energy::EnergyError;
use crate::fit::{FitError, FitOptions, Phase};
use crate::hyperbolic::HyperbolicError;
use crate::mesh::triangle_area;
use crate::progress::{ProgressControl, ProgressResponse};
use crate::spherical::SphericalError;
use crate::statistics::weighted_quantiles;
use crate::toroidal::ToroidalError;
use shell::{ShellSlopes, ShellTarget, Sliding};
use volume::{VolumeEnergy, VolumeMeasure};

/// Sweeps in a round.
const SWEEPS: usize = 6;
/// Parts of a triangle's side as the energy of the surface sees it. With one, the distortion within triangles, which is bounded, goes
/// its own way.
const CUTS: usize = 2;
/// How far the energy of flat images is softened, a tenth as far as in the last rounds of
/// [`map_pair`](crate::boundary_map::pair::map_pair): all measurements were made with it.
const SOFTNESS: f64 = 1e-4;
/// A round that lowers the energy by a smaller share is followed by one where the volume counts for more.
const SMALL_DECREASE: f64 = 3e-3;
const MORE: f64 = 2.0;
/// The most that the volume counts for, over what it does at first.
const MOST_WEIGHT: f64 = 1000.0;
/// The quadratic form is this much larger after a step in vain, and this much smaller after one that lowers the energy.
const SHORTER: f64 = 4.0;
const LONGER: f64 = 0.7;
const LEAST_DAMPING: f64 = 0.25;
/// Steps in vain, one after the other, that end the work.
const MOST_IN_VAIN: usize = 3;

/// The default tolerance of the fits: energies are means over the solid, and less sensitive than the boundary error.
const TOLERANCE: f64 = 2e-3;
/// Points that say how well a fit meets its boundary map.
const HELD_OUT: usize = 4000;

/// Options of [`improve_boundary`].
#[derive(Debug, Clone)]
pub struct ImproveOptions {
    /// How the maps are fitted.
    pub fit: FitOptions,
    /// Rounds at most. Each fits a map.
    pub most_rounds: usize,
    /// How much the distortion of the surface, and of that of each shell, may grow: its symmetric Dirichlet energy, in the mean and at
    /// 99.9 % of the area, over those at the start.
    pub most_distortion: f64,
}

impl Default for ImproveOptions {
    fn default() -> Self {
        Self {
            fit: FitOptions {
                tolerance: TOLERANCE,
                held_out: HELD_OUT,
                ..FitOptions::adaptive()
            },
            most_rounds: 30,
            most_distortion: 1.5,
        }
    }
}

/// The current step of [`improve_boundary`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ImprovePhase {
    /// The harmonic map is fitted.
    Fitting(Phase),
    /// The boundary's images are moved.
    Moving {
        /// Rounds so far.
        rounds: usize,
        /// Rounds at most.
        most_rounds: usize,
        /// Harmonic energy so far.
        energy: f64,
    },
}

/// Why a boundary map cannot be improved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImproveError {
    /// The map knows the images of vertices only.
    #[error(
        "the boundary map gives images of vertices only, and cannot slide on the target; make one between two surfaces, as `boundary \
         pair` does"
    )]
    NoEmbedding,
    /// An option is out of range.
    #[error("`{option}` is {value}, but must be {range}")]
    Option {
        /// The field of [`ImproveOptions`].
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// The distortion of the map cannot be measured.
    #[error("the surface of the {side} has no area")]
    NoArea {
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
    /// A map cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The energy has no scale.
    #[error(transparent)]
    Energy(#[from] EnergyError),
    /// The embedding on the sphere.
    #[error(transparent)]
    Sphere(#[from] SphericalError),
    /// The embedding on the flat torus.
    #[error(transparent)]
    Torus(#[from] ToroidalError),
    /// The embedding on the hyperbolic surface.
    #[error(transparent)]
    Hyperbolic(#[from] HyperbolicError),
    /// The two are no boundary map.
    #[error(transparent)]
    BoundaryMap(#[from] BoundaryMapError),
}

impl ImproveError {
    /// Whether the progress callback cancelled the work.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Fit(FitError::Cancelled))
    }
}

/// Why [`improve_boundary`] ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ImproveEnd {
    /// More would distort the surface beyond the bound.
    Distortion,
    /// No step lowered the energy.
    Converged,
    /// There were as many rounds as allowed.
    Rounds,
    /// The progress callback concluded.
    Concluded,
}

/// What [`improve_boundary`] did.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ImproveReport {
    /// Harmonic energy of the map between the solids scaled to unit volume, at the start and after every round that lowered it.
    /// Integrals over the boundary of the fitted maps: see `boundary_error` for how well these meet the boundary maps.
    pub energies: Vec<f64>,
    /// Rounds, also those in vain.
    pub rounds: usize,
    /// Why there were no more.
    pub end: ImproveEnd,
    /// Distortion of the surface at the start.
    pub before: SurfaceDistortion,
    /// Distortion of the surface at the end.
    pub after: SurfaceDistortion,
    /// Symmetric Dirichlet energy of the surface at 99.9 % of the area, at the start and at the end.
    pub distortions: [f64; 2],
    /// Boundary errors of the fits (99 % of the area, over the target's diagonal), at the start and at the end.
    pub boundary_errors: [f64; 2],
    /// For the user to read.
    pub warnings: Vec<String>,
}

/// Moves the images of a boundary map on its target such that the harmonic energy of the inside falls.
///
/// Every map on the way is a bijection if the first is one, in the same class. A round takes a fit, with a system that is
/// factored once, and six sweeps: for 10 000 vertices some 2 s on two cores.
///
/// # Errors
///
/// When the map is not one between two surfaces ([`ImproveError::NoEmbedding`]), cannot be fitted, or `progress` cancels.
pub fn improve_boundary<R: ProgressResponse>(
    map: &BoundaryMap,
    options: &ImproveOptions,
    progress: &dyn Fn(ImprovePhase) -> R,
) -> Result<(BoundaryMap, ImproveReport), ImproveError> {
    require(
        "most_distortion",
        options.most_distortion,
        options.most_distortion >= 1.0,
        "at least 1",
    )?;
    let progress = |phase| progress(phase).control();
    let shells = map
        .shells()
        .map_or_else(|| vec![map], |shells| shells.iter().map(|shell| &shell.map).collect());
    let targets: Vec<ShellTarget> = shells
        .iter()
        .map(|map| ShellTarget::new(map))
        .collect::<Result<_, _>>()?;
    let sliders = targets.iter().zip(&shells).map(|(target, map)| target.slider(map));
    let improvement = Improvement {
        options,
        progress: &progress,
        given: map,
        vertices: map.shell_vertices(),
    };
    improvement.improved(sliders.collect::<Result<_, _>>()?)
}

fn require(option: &'static str, value: f64, is_met: bool, range: &'static str) -> Result<(), ImproveError> {
    match is_met {
        true => Ok(()),
        false => Err(ImproveError::Option { option, value, range }),
    }
}

struct Improvement<'a> {
    options: &'a ImproveOptions,
    progress: &'a dyn Fn(ImprovePhase) -> ProgressControl,
    given: &'a BoundaryMap,
    /// The vertices of each shell, where there are several.
    vertices: Option<Vec<Vec<u32>>>,
}

/// A map, and what counts of it.
struct Measured {
    map: BoundaryMap,
    volume: VolumeEnergy,
    surface: SurfaceDistortion,
    /// At 99.9 % of the area.
    distortion: f64,
    /// Both for each shell, in the mean and at 99.9 % of its area: a small one counts for little in the whole.
    of_shells: Vec<[f64; 2]>,
}

impl Measured {
    fn new(map: BoundaryMap, volume: VolumeEnergy) -> Result<Self, ImproveError> {
        let (surface, distortion) = distortions(&map)?;
        let of_shells = match map.shells() {
            Some(shells) => {
                let found = shells.iter().map(|shell| distortions(&shell.map));
                let found = found.map(|found| found.map(|(all, high)| [all.mean_symmetric_dirichlet, high]));
                found.collect::<Result<_, _>>()?
            }
            None => vec![[surface.mean_symmetric_dirichlet, distortion]],
        };
        Ok(Self {
            map,
            volume,
            surface,
            distortion,
            of_shells,
        })
    }
}

impl Improvement<'_> {
    /// The maps of all shells as one, before subdivision.
    fn whole(&self, shells: &[Box<dyn Sliding + '_>]) -> Result<BoundaryMap, ImproveError> {
        let mut maps = shells.iter().map(|shell| shell.map()).collect::<Result<Vec<_>, _>>()?;
        match self.given.with_shell_maps(&maps) {
            Some(whole) => Ok(whole?),
            None => maps.pop().ok_or(ImproveError::NoEmbedding),
        }
    }

    /// Moves each of the shells, whose energies of the surface count by `shares`.
    fn slide(
        &self,
        shells: &mut [Box<dyn Sliding + '_>],
        shares: &[f64],
        at: &Measured,
        [weight, of_form]: [f64; 2],
        go_on: &dyn Fn() -> Result<(), ImproveError>,
    ) -> Result<(), ImproveError> {
        for (k, (shell, share)) in shells.iter_mut().zip(shares).enumerate() {
            let own = self.vertices.as_ref().map(|vertices| &vertices[k]);
            let images = of_vertices(at.map.image(), own);
            let slopes = of_vertices(&at.volume.slopes, own);
            let slopes = ShellSlopes {
                images: &images,
                slopes: &slopes,
                weight: weight / share,
                of_form: of_form / share,
            };
            shell.slide(&slopes, go_on)?;
        }
        Ok(())
    }

    fn improved(&self, mut shells: Vec<Box<dyn Sliding + '_>>) -> Result<(BoundaryMap, ImproveReport), ImproveError> {
        let is_concluded = std::cell::Cell::new(false);
        let respond = |phase| {
            let control = (self.progress)(phase);
            is_concluded.set(is_concluded.get() || control == ProgressControl::Conclude);
            control
        };
        let fitting = |phase| respond(ImprovePhase::Fitting(phase));
        let map = self.whole(&shells)?;
        let (measure, volume) = VolumeMeasure::new(&map, &self.options.fit, &fitting)?;
        let mut best = Measured::new(map, volume)?;
        let (before, start, of_shells) = (best.surface, best.distortion, best.of_shells.clone());
        let first_error = best.volume.boundary_error;
        let mut energies = vec![best.volume.harmonic];
        // The energy of each surface is that of a layout of a fixed area, and counts by the area of its shell.
        let scales: Vec<f64> = shells.iter().map(|shell| shell.area_scale()).collect();
        let shares: Vec<f64> = scales.iter().map(|scale| scales[0] / scale).collect();
        let surface: f64 = shells
            .iter()
            .zip(&shares)
            .map(|(shell, share)| share * shell.energy())
            .sum();
        // Both energies count for the same at first.
        let mut steps = Steps::new(surface / best.volume.harmonic);
        let most = self.options.most_distortion;
        let is_within = |found: &Measured| {
            let mut pairs = found.of_shells.iter().flatten().zip(of_shells.iter().flatten());
            pairs.all(|(found, start)| *found <= most * start)
        };
        let mut rounds = 0;
        let end = loop {
            if let Some(end) = steps.end {
                break end;
            }
            if is_concluded.get() {
                break ImproveEnd::Concluded;
            }
            if rounds == self.options.most_rounds {
                break ImproveEnd::Rounds;
            }
            let moving = || match respond(ImprovePhase::Moving {
                rounds,
                most_rounds: self.options.most_rounds,
                energy: best.volume.harmonic,
            }) {
                ProgressControl::Cancel => Err(ImproveError::from(FitError::Cancelled)),
                ProgressControl::Continue | ProgressControl::Conclude => Ok(()),
            };
            moving()?;
            let of_form = steps.weight * steps.damping * measure.scale;
            self.slide(&mut shells, &shares, &best, [steps.weight, of_form], &moving)?;
            rounds += 1;
            // Rounding may leave no bijection.
            let Ok(map) = self.whole(&shells) else {
                steps.in_vain();
                continue;
            };
            let volume = measure.of(&map, &fitting)?;
            let found = Measured::new(map, volume)?;
            if !is_within(&found) {
                steps.too_distorted();
            } else if found.volume.harmonic < best.volume.harmonic {
                steps.lower(1.0 - found.volume.harmonic / best.volume.harmonic);
                energies.push(found.volume.harmonic);
                shells.iter_mut().for_each(|shell| shell.accept());
                best = found;
            } else if best.volume.change_to(best.map.image(), found.map.image()) > 0.0 {
                steps.surface_alone();
            } else {
                steps.in_vain();
            }
        };
        let mut map = best.map;
        for _ in 0..self.given.subdivisions() {
            map = map.subdivided();
        }
        let boundary_errors = [first_error, best.volume.boundary_error];
        let tolerance = self.options.fit.tolerance;
        let mut warnings = vec![];
        if boundary_errors.iter().any(|error| *error > tolerance) {
            warnings.push(format!(
                "the fitted maps miss their boundary maps by {:.2e} and {:.2e} of the diagonal (99 % of the area), more than the tolerance \
                 of {tolerance:.2e}: energies are less certain",
                boundary_errors[0], boundary_errors[1]
            ));
        }
        let report = ImproveReport {
            energies,
            rounds,
            end,
            before,
            after: best.surface,
            distortions: [start, best.distortion],
            boundary_errors,
            warnings,
        };
        Ok((map, report))
    }
}

/// What belongs to these vertices, or to all.
fn of_vertices<'a, T: Copy>(all: &'a [T], vertices: Option<&Vec<u32>>) -> Cow<'a, [T]> {
    match vertices {
        Some(vertices) => vertices.iter().map(|&v| all[v as usize]).collect(),
        None => Cow::Borrowed(all),
    }
}

/// How the next step is chosen.
struct Steps {
    /// How much the energy of the volume counts, beside that of the surface.
    weight: f64,
    most_weight: f64,
    /// Factor of the quadratic form.
    damping: f64,
    /// Steps in vain, one after the other.
    vain: usize,
    /// Whether a step has distorted the surface too much.
    is_bounded: bool,
    /// Why there is no next step.
    end: Option<ImproveEnd>,
}

impl Steps {
    fn new(weight: f64) -> Self {
        Self {
            weight,
            most_weight: MOST_WEIGHT * weight,
            damping: 1.0,
            vain: 0,
            is_bounded: false,
            end: None,
        }
    }

    /// The energy has fallen by this share.
    fn lower(&mut self, decrease: f64) {
        self.vain = 0;
        self.damping = (self.damping * LONGER).max(LEAST_DAMPING);
        if decrease < SMALL_DECREASE {
            match self.is_bounded {
                true => self.end = Some(ImproveEnd::Distortion),
                false => self.count_more(),
            }
        }
    }

    /// The step has lowered the surface's energy and raised that of the volume.
    fn surface_alone(&mut self) {
        self.count_more();
    }

    fn count_more(&mut self) {
        self.weight *= MORE;
        if self.weight > self.most_weight {
            self.end = Some(ImproveEnd::Converged);
        }
    }

    fn too_distorted(&mut self) {
        self.is_bounded = true;
        self.weight /= MORE;
        self.in_vain();
    }

    fn in_vain(&mut self) {
        self.damping *= SHORTER;
        self.vain += 1;
        if self.vain == MOST_IN_VAIN {
            self.end = Some(match self.is_bounded {
                true => ImproveEnd::Distortion,
                false => ImproveEnd::Converged,
            });
        }
    }
}

/// The distortion of the map itself, over triangles cut into four, and its symmetric Dirichlet energy at 99.9 % of the area.
fn distortions(map: &BoundaryMap) -> Result<(SurfaceDistortion, f64), ImproveError> {
    let fine = map.subdivided();
    let surface = fine.domain();
    let no_area = ImproveError::NoArea { side: "target" };
    let (Some(all), Some(found)) = (
        SurfaceDistortion::of(surface, fine.image()),
        triangle_distortions(surface, fine.image()),
    ) else {
        return Err(no_area);
    };
    let (values, weights): (Vec<f64>, Vec<f64>) = found
        .iter()
        .enumerate()
        .filter_map(|(t, of)| Some((of.as_ref()?.symmetric_dirichlet(), triangle_area(&surface.corners(t)))))
        .unzip();
    let [high] = weighted_quantiles(&values, &weights, [0.999]).ok_or(no_area)?;
    Ok((all, high))
}

#[cfg(test)]
mod tests;
