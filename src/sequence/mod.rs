//! Sequences of deformed solids: section 5.2 of Li, Guo, Wang, He, Gu & Qin,
//! *Harmonic volumetric mapping for solid modeling applications* (2007).
//!
//! The surface of every frame has the connectivity of the reference's, and the boundary map takes each vertex to its
//! position in the frame. The system depends on the reference alone (section 4.6): it is factored once, and frames are
//! solved for in blocks, for which each kernel value is computed once. The deformation energy of the maps (section
//! 4.3.2) says how far each frame is from the reference, and its density where.
//!
//! # Units of the energy
//!
//! Energies are means of the density over the reference's volume, so that they do not depend on the unit of length,
//! which must be the same for all. The paper scales both solids to unit volume. Here that is a choice
//! ([`SequenceOptions::own_volume`]): uniform growth would have no energy then. Green's strain is invariant under rigid
//! motions, so that frames need not be aligned.
//!
//! # Folds
//!
//! The harmonic map of a frame may fold. [`Sequence::measure_bijective`] measures one-to-one maps instead
//! ([`crate::bijective`]), over tetrahedra that fill the reference.

mod bijective;
mod cycles;
mod jacobians;

pub use bijective::{FilledReference, SequencePhase};
pub use cycles::{CycleError, Cycles, cycles};

use std::sync::Arc;

use crate::bijective::{Bijective, BijectiveError};
use crate::boundary_map::{BoundaryMap, BoundaryMapError};
use crate::check::{ClosedHole, HoleError, close_holes};
use crate::energy::{
    AdaptiveOptions, Densities, DensityQuantiles, EnergyError, EnergyErrors, EnergyOptions, EnergyReport, Lame,
    Quadrature, QuadratureError, UnitVolumeScale, adaptive_energies_of_maps, deformation_density, undivided_grid,
};
use crate::fit::{BoundaryError, DomainFactor, Fit, FitError, FitOptions, FitSize, Phase, RefinementEnd, is_flat};
use crate::map::{HarmonicMap, VolumeMap};
use crate::memory;
use crate::mesh::SurfaceMesh;
use crate::solver::Coefficients;
use crate::{Matrix3, Point, Vector};
use jacobians::{frames_at_a_time, jacobians};

/// Default number of frames in a block: larger blocks save little more.
const FRAMES: usize = 32;
/// Bytes that a frame keeps for each point of its quadrature: point, weight, cell and densities.
const BYTES_PER_POINT: u64 = 60;
/// Largest number of rounds of refinement for one block, each for the frame with the largest error.
const MOST_ROUNDS: usize = 8;
/// A frame counts as an affine image of the reference when an affine map meets it to this fraction of the tolerance.
const AFFINE: f64 = 0.01;

/// Settings of a [`Sequence`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SequenceOptions {
    /// How maps are fitted; without its limits on the largest error, for which all frames would get more sources.
    pub fit: FitOptions,
    /// How energies are integrated: all frames on the same grid, whose cells are divided as each frame needs it.
    pub quadrature: AdaptiveOptions,
    /// Material of the deformation energy.
    pub lame: Lame,
    /// Scale each frame to the reference's volume first, so that change of size has no energy.
    pub own_volume: bool,
    /// Close holes of up to this many edges in the reference, and the same holes in all frames; `None` to close none.
    pub close_holes: Option<usize>,
    /// Frames to solve for at once; `None` for 32, or as many as fit into memory.
    pub frames_per_block: Option<usize>,
}

/// Why a sequence, or one of its frames, cannot be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SequenceError {
    /// The holes cannot be closed.
    #[error("cannot close the reference: {0}")]
    Hole(#[from] HoleError),
    /// The reference has no inside to integrate over.
    #[error("cannot integrate over the reference: {0}")]
    Quadrature(#[from] QuadratureError),
    /// The frame has other vertices or faces than the reference, or positions that cannot be used.
    #[error(transparent)]
    Frame(#[from] BoundaryMapError),
    /// The frame encloses no volume.
    #[error("it encloses no volume ({volume:e} at a diagonal of {diagonal:e}), so it is not a solid")]
    Collapsed {
        /// Its volume.
        volume: f64,
        /// Diagonal of its bounding box.
        diagonal: f64,
    },
    /// The reference cannot be factored, or the frame cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The energy of the map cannot be computed.
    #[error(transparent)]
    Energy(#[from] EnergyError),
    /// No one-to-one map of the frame was found, or the mesh of the reference cannot be used.
    #[error("no bijective map: {0}")]
    Bijective(#[from] Box<BijectiveError>),
}

/// The map that a frame is measured of.
#[derive(Debug, Clone)]
pub enum FrameMap {
    /// The harmonic map, by [`Sequence::measure`].
    Harmonic(HarmonicMap),
    /// The one-to-one map, and how it was made, by [`Sequence::measure_bijective`].
    Bijective(Box<Bijective>),
}

impl FrameMap {
    /// The harmonic map, if it is one.
    pub fn harmonic(&self) -> Option<&HarmonicMap> {
        match self {
            Self::Harmonic(map) => Some(map),
            Self::Bijective(_) => None,
        }
    }

    /// The one-to-one map, if it is one.
    pub fn bijective(&self) -> Option<&Bijective> {
        match self {
            Self::Harmonic(_) => None,
            Self::Bijective(made) => Some(made),
        }
    }

    fn as_volume_map(&self) -> &dyn VolumeMap {
        match self {
            Self::Harmonic(map) => map,
            Self::Bijective(made) => &made.map,
        }
    }
}

impl VolumeMap for FrameMap {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        self.as_volume_map().evaluate(points)
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        self.as_volume_map().jacobian(points)
    }
}

/// Energies of a frame, and the map they are measured of.
#[derive(Debug, Clone)]
pub struct FrameMeasurement {
    /// Mean of the deformation energy's density over the reference.
    pub deformation: f64,
    /// Mean of the harmonic energy's density over the reference: 3 for a rigid motion.
    pub harmonic: f64,
    /// Distribution of the deformation energy's density.
    pub deformation_density: DensityQuantiles,
    /// Volume of the frame; negative when the map reverses the orientation.
    pub volume: f64,
    /// Fraction of the reference's volume where the map is folded: `det J` is zero or does not have the sign of
    /// `volume`.
    pub folded_fraction: f64,
    /// Error of the map on the frame's surface.
    pub boundary_error: BoundaryError,
    /// Estimated errors of both energies; zero for a one-to-one map, whose energies are sums over tetrahedra.
    pub errors: EnergyErrors,
    /// The points and weights that energies were integrated with.
    pub quadrature: Quadrature,
    /// Densities at the points of the quadrature.
    pub densities: Densities,
    /// The map from the reference to the frame.
    pub map: FrameMap,
    /// Factor on Jacobians before densities are computed.
    stretch: f64,
}

/// A reference with its holes closed, the system factored and the grid clipped.
pub struct Sequence {
    reference: Arc<SurfaceMesh>,
    domain: Arc<SurfaceMesh>,
    holes: Vec<ClosedHole>,
    factor: DomainFactor,
    quadrature: Quadrature,
    options: SequenceOptions,
    refinement_end: Option<RefinementEnd>,
}

impl Sequence {
    /// Prepares a reference, the closed surface of a solid.
    ///
    /// # Errors
    ///
    /// When holes stay open, the surface does not bound a solid, an option is out of range, or there is too little
    /// memory.
    pub fn new(
        reference: &SurfaceMesh,
        options: &SequenceOptions,
        progress: &dyn Fn(Phase),
    ) -> Result<Self, SequenceError> {
        let (domain, holes) = match options.close_holes {
            Some(most_edges) => close_holes(reference, most_edges)?,
            None => (reference.clone(), Vec::new()),
        };
        // A frame meets the tolerance on 99 % of the area; refining for its worst place would cost all frames.
        let fit = FitOptions {
            max_error_ratio: f64::INFINITY,
            max_local_error: f64::INFINITY,
            ..options.fit.clone()
        };
        let factor = DomainFactor::new(&domain, &fit, progress)?;
        let (outward, _) = crate::check::repair(&domain);
        Ok(Self {
            reference: Arc::new(reference.clone()),
            quadrature: undivided_grid(&outward, options.quadrature.resolution)?.1,
            domain: Arc::new(outward),
            holes,
            factor,
            options: options.clone(),
            refinement_end: None,
        })
    }

    /// The reference with its holes closed and its triangles oriented outward.
    pub fn domain(&self) -> &SurfaceMesh {
        &self.domain
    }

    /// The closed holes.
    pub fn holes(&self) -> &[ClosedHole] {
        &self.holes
    }

    /// The reference as it was given: frames have its triangles.
    pub fn reference(&self) -> &SurfaceMesh {
        &self.reference
    }

    /// What is unusual about the reference, and how it was repaired, for the user to read.
    pub fn warnings(&self) -> &[String] {
        self.factor.warnings()
    }

    /// The grid over the reference whose cells are divided where energies need it.
    pub fn quadrature(&self) -> &Quadrature {
        &self.quadrature
    }

    /// Why no more sources are added where frames miss the tolerance, once refinement has failed for one.
    pub fn refinement_end(&self) -> Option<RefinementEnd> {
        self.refinement_end
    }

    /// Number of frames to measure at once: as many as asked for, as far as their solution and densities fit into
    /// memory.
    pub fn frames_per_block(&self) -> usize {
        let points = self.options.quadrature.point_limit(self.quadrature.points().len());
        self.frames_that_fit(BYTES_PER_POINT.saturating_mul(points as u64))
    }

    /// As many frames as asked for, as far as their solution and so many bytes for each fit into memory.
    fn frames_that_fit(&self, measured: u64) -> usize {
        let budget = self.options.fit.memory.or_else(memory::default_solver_budget);
        let allowed = budget.unwrap_or(u64::MAX);
        let mut size = FitSize::of(&self.domain, &self.options.fit);
        size.maps = self.options.frames_per_block.unwrap_or(FRAMES).max(1);
        let bytes = |size: &FitSize| size.bytes().saturating_add(measured.saturating_mul(size.maps as u64));
        while size.maps > 1 && bytes(&size) > allowed {
            size.maps /= 2;
        }
        size.maps
    }

    /// The boundary map from the reference to a frame.
    ///
    /// # Errors
    ///
    /// When the frame has other triangles or another number of vertices than the reference, positions that are not
    /// finite, no extent or no volume.
    pub fn frame(&self, surface: &SurfaceMesh) -> Result<BoundaryMap, SequenceError> {
        let image = BoundaryMap::between(self.reference.clone(), surface)?.image().to_vec();
        let boundary = BoundaryMap::new(self.domain.clone(), image)?;
        let (volume, diagonal) = (boundary.target_volume(), boundary.target_diagonal());
        if is_flat(volume, diagonal) {
            return Err(SequenceError::Collapsed { volume, diagonal });
        }
        Ok(boundary)
    }

    /// Fits and measures frames, all at once. Sources are added where one misses the tolerance, and serve all later
    /// frames. A frame that cannot be solved or measured does not stop the others.
    ///
    /// Memory grows with the number of frames: see [`Self::frames_per_block`].
    pub fn measure(
        &mut self,
        frames: &[BoundaryMap],
        progress: &dyn Fn(Phase),
    ) -> Vec<Result<FrameMeasurement, SequenceError>> {
        let solved = self.solve(frames, progress);
        progress(Phase::Measuring);
        let mut maps = Vec::new();
        let mut volumes = Vec::new();
        for (solved, frame) in solved.iter().zip(frames) {
            if let Ok((map, _)) = solved {
                maps.push(map);
                volumes.push(frame.target_volume());
            }
        }
        let (options, accuracy) = (self.energy_options(), &self.options.quadrature);
        let energies = adaptive_energies_of_maps(&self.domain, &volumes, &options, accuracy, |range, points, add| {
            let at_a_time = frames_at_a_time(points.len());
            for (part, maps) in maps[range].chunks(at_a_time).enumerate() {
                for (k, list) in jacobians(maps, points).iter().enumerate() {
                    add(part * at_a_time + k, list);
                }
            }
        });
        let energies = energies.unwrap_or_else(|error| maps.iter().map(|_| Err(error.clone())).collect());
        let mut energies = energies.into_iter().zip(volumes);
        let measured = solved.into_iter().map(|solved| {
            let (map, error) = solved?;
            let (energy, volume) = energies.next().expect("one result for each map");
            self.measured(map, error, volume, energy?)
        });
        measured.collect()
    }

    /// Densities of the deformation energy at other points of the reference: a list for each frame.
    pub fn densities_at(&self, frames: &[&FrameMeasurement], points: &[Point]) -> Vec<Vec<f64>> {
        let mut densities = Vec::with_capacity(frames.len());
        for part in frames.chunks(frames_at_a_time(points.len())) {
            let maps: Vec<&FrameMap> = part.iter().map(|frame| &frame.map).collect();
            let density = |frame: &FrameMeasurement, jacobian: &Matrix3| {
                deformation_density(&(jacobian * frame.stretch), &self.options.lame)
            };
            let lists = jacobians(&maps, points).into_iter().zip(part);
            densities.extend(lists.map(|(list, frame)| list.iter().map(|j| density(frame, j)).collect::<Vec<_>>()));
        }
        densities
    }

    /// Differences of energies below this are rounding: the energy of strains of about a millionth.
    pub fn resolution_of_energy(&self) -> f64 {
        self.options.lame.negligible_density()
    }

    fn energy_options(&self) -> EnergyOptions {
        EnergyOptions {
            normalize: self.options.own_volume,
            lame: self.options.lame,
        }
    }

    /// The harmonic maps, and how well they meet the frames.
    fn solve(
        &mut self,
        frames: &[BoundaryMap],
        progress: &dyn Fn(Phase),
    ) -> Vec<Result<(FrameMap, BoundaryError), SequenceError>> {
        let tolerance = AFFINE * self.options.fit.tolerance;
        let affine: Vec<_> = frames.iter().map(|frame| affine_map(frame, tolerance)).collect();
        let others = frames.iter().zip(&affine).filter(|(_, affine)| affine.is_none());
        let others: Vec<BoundaryMap> = others.map(|(frame, _)| frame.clone()).collect();
        let mut fits = self.solve_block(&others, progress).into_iter();
        let of_others = |fit: Option<Result<Fit, FitError>>| {
            let fit = fit.expect("one fit for each frame that is not affine")?;
            Ok((fit.map, fit.report.boundary_error))
        };
        affine
            .into_iter()
            .map(|affine| affine.map_or_else(|| of_others(fits.next()), Ok))
            .map(|found| found.map(|(map, error)| (FrameMap::Harmonic(map), error)))
            .collect()
    }

    /// Fits of frames, in smaller blocks where the whole block fails.
    fn solve_block(&mut self, frames: &[BoundaryMap], progress: &dyn Fn(Phase)) -> Vec<Result<Fit, FitError>> {
        match self.factor.solve_block(frames, progress) {
            Ok(fits) => self.refined(frames, fits, progress).into_iter().map(Ok).collect(),
            Err(error) if frames.len() < 2 => vec![Err(error)],
            Err(_) => {
                let (first, second) = frames.split_at(frames.len() / 2);
                let mut fits = self.solve_block(first, progress);
                fits.extend(self.solve_block(second, progress));
                fits
            }
        }
    }

    /// The fits, with sources added for the frame with the largest error until all meet the tolerance or refinement
    /// fails.
    fn refined(&mut self, frames: &[BoundaryMap], mut fits: Vec<Fit>, progress: &dyn Fn(Phase)) -> Vec<Fit> {
        let p99 = |fit: &Fit| fit.report.boundary_error.p99;
        let tolerance = self.options.fit.tolerance;
        for _ in 0..MOST_ROUNDS {
            let worst = (0..fits.len()).max_by(|&a, &b| p99(&fits[a]).total_cmp(&p99(&fits[b])));
            let Some(worst) = worst.filter(|&k| p99(&fits[k]) > tolerance) else {
                break;
            };
            if self.refinement_end.is_some() {
                break;
            }
            let Ok(best) = self.factor.solve_refined(&frames[worst], progress) else {
                break;
            };
            if p99(&best) > tolerance {
                self.refinement_end = best.report.refinement_end;
            }
            if let Ok(again) = self.factor.solve_block(frames, progress) {
                // More sources make most frames better, but not all.
                for (fit, again) in fits.iter_mut().zip(again) {
                    if p99(&again) < p99(fit) {
                        *fit = again;
                    }
                }
            }
            if p99(&best) < p99(&fits[worst]) {
                fits[worst] = best;
            }
        }
        fits
    }

    fn measured(
        &self,
        map: FrameMap,
        boundary_error: BoundaryError,
        volume: f64,
        (quadrature, energy): (Quadrature, EnergyReport),
    ) -> Result<FrameMeasurement, SequenceError> {
        let own = quadrature.volume();
        let (stretch, per_volume) = if self.options.own_volume {
            (UnitVolumeScale::new(own, volume)?.jacobian, 1.0)
        } else {
            (1.0, 1.0 / own)
        };
        // Only an adaptive quadrature has errors.
        let errors = energy.errors.unwrap_or(EnergyErrors {
            harmonic: 0.0,
            deformation: 0.0,
            within_tolerance: true,
        });
        Ok(FrameMeasurement {
            deformation: energy.deformation * per_volume,
            harmonic: energy.harmonic * per_volume,
            deformation_density: energy.deformation_density,
            volume,
            folded_fraction: energy.folded.fraction,
            boundary_error,
            errors: EnergyErrors {
                harmonic: errors.harmonic * per_volume,
                deformation: errors.deformation * per_volume,
                ..errors
            },
            quadrature,
            densities: energy.densities,
            map,
            stretch,
        })
    }
}

/// The least-squares affine map, if its error at every vertex is at most `tolerance` of the target's diagonal. It is
/// harmonic, so that its error inside is no larger.
fn affine_map(frame: &BoundaryMap, tolerance: f64) -> Option<(HarmonicMap, BoundaryError)> {
    let (from, to) = (frame.domain().vertices(), frame.image());
    let count = from.len().max(1) as f64;
    let middle = |points: &[Point]| points.iter().map(|p| p.coords).sum::<Vector>() / count;
    let (middle_from, middle_to) = (middle(from), middle(to));
    let (mut normal, mut right) = (Matrix3::zeros(), Matrix3::zeros());
    for (p, q) in from.iter().zip(to) {
        let p = p.coords - middle_from;
        normal += p * p.transpose();
        right += p * (q.coords - middle_to).transpose();
    }
    let linear = normal.cholesky()?.solve(&right).transpose();
    let misfit = |(p, q): (&Point, &Point)| (linear * (p.coords - middle_from) + middle_to - q.coords).norm();
    let misfits = from.iter().zip(to).map(misfit);
    let misfits: Vec<f64> = misfits.map(|d| d / frame.target_diagonal()).collect();
    let max = misfits.iter().copied().fold(0.0, f64::max);
    if !(max <= tolerance && linear.iter().all(|a| a.is_finite())) {
        return None;
    }
    let constant = middle_to - linear * middle_from;
    let column = |k: usize| [linear[(0, k)], linear[(1, k)], linear[(2, k)]];
    let coefficients = Coefficients {
        sources: Vec::new(),
        affine: [constant.into(), column(0), column(1), column(2)],
    };
    let rms = (misfits.iter().map(|d| d * d).sum::<f64>() / count).sqrt();
    Some((
        HarmonicMap::new(Vec::new(), coefficients)?,
        BoundaryError { rms, p99: max, max },
    ))
}
