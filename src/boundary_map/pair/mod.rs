//! The boundary map between two solids of genus 0 of which no correspondence is known: through a common sphere.
//!
//! The target is mapped to the sphere; the domain is laid over it roughly; the domain is drawn on the target's sphere,
//! each vertex pulled towards the direction of the point that it lies on; and the drawing is moved so that the map from
//! surface to surface distorts least. No triangle ever turns over, so that the result is a bijection, at every point of
//! the surface: down to the domain's sphere and up from the target's.

mod alignment;
mod embedding;
mod landmarks;
mod lift;
mod oriented_query;
mod rotation;
mod targets;

use std::ops::ControlFlow;
use std::time::Instant;

use serde::Serialize;

pub use alignment::{AlignError, Alignment, AlignmentStart, Alignments, Body, align, align_by_landmarks};
pub use embedding::Schedule;
pub use landmarks::{LandmarkError, Landmarks};
pub use oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
pub use rotation::{RotationMatch, search_rotations};
pub use targets::{VertexTarget, vertex_targets};

use super::{BoundaryMap, BoundaryMapError, SurfaceDistortion};
use crate::geometry::sphere_rotation;
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressResponse, ProgressSender, run_cancellable};
use crate::spherical::{
    Hierarchy, Locator, Moebius, SphereEnergy, SphereOptions, SpherePhase, SphericalError, SphericalMap, certify,
    map_to_sphere, require_scale, require_sphere,
};
use crate::{Point, Vector};
use embedding::{Embedding, Guide, Pins, Sketch, best_sketch};
use lift::Lift;

/// How the domain comes to lie on the target's sphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Via {
    /// Drawn towards the closest points of the target, once the solids are laid over each other.
    Targets,
    /// Conformal maps of both to the sphere, centred, and the rotation under which their areas agree best: the paper's way.
    Conformal,
}

/// How a pair is mapped.
#[derive(Debug, Clone, PartialEq)]
pub struct PairOptions {
    /// The way through the sphere.
    pub via: Via,
    /// Vertices that go to vertices.
    pub landmarks: Landmarks,
    /// Whether the map is made to distort less once it is there.
    pub improve: bool,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            via: Via::Targets,
            landmarks: Landmarks::default(),
            improve: true,
        }
    }
}

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairPhase {
    /// A solid (`"domain"` or `"target"`) is mapped to the sphere.
    Sphere(&'static str, SpherePhase),
    /// The domain is laid over the target, or the spheres over each other.
    Aligning,
    /// Coarse drawings are tried.
    Sketching {
        /// How many.
        drawings: usize,
    },
    /// The best of them is refined.
    Drawing {
        /// Vertices that are there.
        vertices: usize,
        /// Of how many.
        of: usize,
        /// Mean symmetric Dirichlet energy, 4 of an isometry.
        energy: f64,
    },
    /// The map with all vertices is made to distort less.
    Improving,
    /// Distortion is measured.
    Measuring,
}

/// What was done and found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairReport {
    /// The way through the sphere.
    pub via: Via,
    /// Landmarks, all of which are met exactly.
    pub landmarks: usize,
    /// Coarse drawings that were tried.
    pub drawings: usize,
    /// Least mean symmetric Dirichlet energy (4 of an isometry) that a coarse drawing by each alignment came to; of those
    /// given up early, at that time. What triangles hide counts. Empty by way of conformal maps.
    pub alignments: Vec<f64>,
    /// The alignment that was taken, or the rotation.
    pub alignment: usize,
    /// Correlation of the areas under each rotation of the spheres, best first. Empty by way of targets.
    pub rotations: Vec<f64>,
    /// How the drawing was led, on the way through targets.
    pub schedule: Option<Schedule>,
    /// Distortion of the map before it was made to distort less.
    pub before: SurfaceDistortion,
    /// Distortion of the map.
    pub after: SurfaceDistortion,
    /// Wall time by step.
    pub seconds: PairSeconds,
    /// What is odd about the pair.
    pub warnings: Vec<String>,
}

/// Wall time by step.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PairSeconds {
    /// Maps to the sphere.
    pub sphere: f64,
    /// Alignments and targets.
    pub align: f64,
    /// Coarse drawings.
    pub sketch: f64,
    /// The best drawing, refined and improved.
    pub improve: f64,
    /// Everything.
    pub total: f64,
}

/// Why there is no map between two solids.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PairError {
    /// A solid has no map to the sphere.
    #[error("the {side} has no map to the sphere: {error}")]
    Sphere {
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// Why not.
        error: SphericalError,
    },
    /// The solids cannot be laid over each other.
    #[error(transparent)]
    Align(#[from] AlignError),
    /// Landmarks are no pairs of vertices of these solids.
    #[error(transparent)]
    Landmarks(#[from] LandmarkError),
    /// Landmarks are not reached by any bijection that was found.
    #[error(
        "{} of {landmarks} landmarks cannot be met without turning triangles over, the first is pair {}, counted from 0 \
         (domain vertex {}, target vertex {}): do they go round in the same order on both solids? Leave it out, or \
         correct it",
        missed.len(), missed[0], first[0], first[1]
    )]
    LandmarksMissed {
        /// How many there are.
        landmarks: usize,
        /// Numbers of the pairs that are not met.
        missed: Vec<usize>,
        /// The first of them.
        first: [u32; 2],
    },
    /// Every drawing that was tried had triangles of the target too flat to measure.
    #[error(
        "no drawing of the domain on the target's sphere has a finite distortion; look for flat triangles with `solidmap check`"
    )]
    NoDrawing,
    /// A surface is out of scale.
    #[error(transparent)]
    Boundary(#[from] BoundaryMapError),
    /// The progress callback asked for an end.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

/// Ways to lead a drawing. Which one ends best differs from pair to pair, and to try them coarsely is cheap.
const SCHEDULES: [Schedule; 8] = [
    Schedule { pull: 1.0, until: 60 },
    Schedule { pull: 1.0, until: 200 },
    Schedule { pull: 1.0, until: 800 },
    Schedule { pull: 10.0, until: 60 },
    Schedule { pull: 10.0, until: 200 },
    Schedule { pull: 10.0, until: 800 },
    Schedule { pull: 100.0, until: 60 },
    Schedule {
        pull: 100.0,
        until: 800,
    },
];
/// Vertices of the coarse drawings: of all, and of the better ones.
const SKETCHES: [usize; 2] = [1600, 4000];
/// Symmetric Dirichlet energy of an isometry.
const ISOMETRY: f64 = 4.0;
/// Scores of rotations this close are told as ambiguous.
const CLOSE: f64 = 0.05;

/// A bijection from the boundary of one solid to that of another.
///
/// Some 10 s for 15 000 vertices on two cores. The same for any number of threads.
///
/// # Errors
///
/// When a solid is not of genus 0, or landmarks cannot be met; [`PairError::Cancelled`] when `progress` says so
/// ([`ProgressResponse`]), which is heard within a fraction of a second as a rule.
pub fn map_pair<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<(BoundaryMap, PairReport), PairError> {
    let of_side = |side| move |error| PairError::Sphere { side, error };
    let domain = require_sphere(domain).map_err(of_side("domain"))?;
    let target = require_sphere(target).map_err(of_side("target"))?;
    require_scale(&domain).map_err(of_side("domain"))?;
    require_scale(&target).map_err(of_side("target"))?;
    let landmarks = Landmarks::new(
        options.landmarks.pairs().to_vec(),
        domain.vertices().len(),
        target.vertices().len(),
    )?;
    let made = run_cancellable(&|phase| progress(phase).control_flow(), |reporter| {
        let pair = Pair {
            domain: &domain,
            target: &target,
            landmarks: &landmarks,
            improve: options.improve,
            start: Instant::now(),
            reporter,
        };
        match options.via {
            Via::Targets => pair.via_targets(),
            Via::Conformal => pair.via_conformal(),
        }
    });
    made.unwrap_or(Err(PairError::Cancelled))
}

struct Pair<'a> {
    domain: &'a SurfaceMesh,
    target: &'a SurfaceMesh,
    landmarks: &'a Landmarks,
    improve: bool,
    start: Instant,
    reporter: &'a ProgressSender<'a, PairPhase>,
}

/// A drawing before and after improvement, and how it was come by.
struct Found {
    before: Vec<Vector>,
    after: Vec<Vector>,
    /// Whether the one before meets the landmarks too.
    before_meets: bool,
    alignments: Vec<f64>,
    alignment: usize,
    rotations: Vec<f64>,
    drawings: usize,
    schedule: Option<Schedule>,
    seconds: PairSeconds,
    warnings: Vec<String>,
}

impl Pair<'_> {
    fn via_targets(&self) -> Result<(BoundaryMap, PairReport), PairError> {
        let target = self.sphere("target", self.target, SphereEnergy::Balanced)?;
        let locator = Locator::new(&target);
        let lift = Lift::new(&target, &locator);
        let sphere = self.elapsed();

        self.tell(PairPhase::Aligning)?;
        let (guides, warnings) = self.guides(&target)?;
        let align = self.elapsed();

        let drawings = guides.len() * SCHEDULES.len();
        self.tell(PairPhase::Sketching { drawings })?;
        let hierarchy = self.hierarchy()?;
        let goes_on = || self.reporter.should_continue();
        let embedding = Embedding::new(self.domain, &hierarchy, &lift, self.pins(&target), &goes_on);
        let too_fine = || PairError::Sphere {
            side: "domain",
            error: SphericalError::TooFine,
        };
        let (sketch, [guide, schedule], alignments) =
            best_sketch(&embedding, &guides, &SCHEDULES, &SKETCHES).ok_or(PairError::NoDrawing)?;
        let sketched = self.elapsed();

        let (guide, chosen, schedule) = (&guides[guide], guide, SCHEDULES[schedule]);
        let told = |vertices, energy| {
            let of = self.domain.vertices().len();
            // An end is heard at the next level.
            let _ = self.tell(PairPhase::Drawing {
                vertices,
                of,
                energy: ISOMETRY * energy,
            });
        };
        let plain = embedding.guided(guide, &schedule).ok_or_else(too_fine)?;
        let mut after = plain.clone();
        if self.improve {
            let refined = embedding.refine(sketch, guide, &schedule, usize::MAX, &told);
            after = refined.ok_or_else(too_fine)?;
            self.tell(PairPhase::Improving)?;
            embedding.finish(&mut after);
            self.take_wanted(&embedding, guide, &mut after);
        }
        self.require_landmarks(&embedding, &after)?;
        let improved = self.elapsed();
        let found = Found {
            before_meets: embedding.missed(&plain).is_empty(),
            before: plain.drawing.directions,
            after: after.drawing.directions,
            alignments: alignments.iter().map(|energy| ISOMETRY * energy).collect(),
            rotations: vec![],
            alignment: chosen,
            drawings,
            schedule: Some(schedule),
            seconds: PairSeconds {
                sphere,
                align: align - sphere,
                sketch: sketched - align,
                improve: improved - sketched,
                total: 0.0,
            },
            warnings,
        };
        self.report(Via::Targets, target, found)
    }

    fn via_conformal(&self) -> Result<(BoundaryMap, PairReport), PairError> {
        let domain = self.sphere("domain", self.domain, SphereEnergy::Conformal)?;
        let target = self.sphere("target", self.target, SphereEnergy::Conformal)?;
        let sphere = self.elapsed();

        self.tell(PairPhase::Aligning)?;
        let mut warnings = Vec::new();
        let matches = search_rotations(&domain, &target, None);
        let rotations: Vec<f64> = matches.iter().map(|found| found.score).collect();
        if rotations.get(1).is_some_and(|second| *second > rotations[0] - CLOSE) && self.landmarks.pairs().len() < 2 {
            warnings.push(
                "several rotations of the spheres fit nearly as well; name landmarks if the map goes to the wrong place"
                    .into(),
            );
        }
        let turned = self.by_three_landmarks(&domain, &target).unwrap_or_else(|| {
            let rotation = self.rotation_of_landmarks(&domain, &target, &mut warnings);
            let rotation = rotation
                .or(matches.first().map(|found| found.rotation))
                .unwrap_or_else(crate::Matrix3::identity);
            domain.directions().iter().map(|x| (rotation * x).normalize()).collect()
        });
        // Rounding may fold the smallest triangles as they are turned; those of the other side may bear it.
        let (turned, target) = if certify(self.domain.triangles(), &turned).is_bijective() {
            (turned, target)
        } else {
            let back = sphere_rotation(&turned, domain.directions(), &vec![1.0; turned.len()]);
            let back = back.map_or_else(crate::Matrix3::identity, |back| back.rotation);
            let directions: Vec<Vector> = target.directions().iter().map(|x| back * x).collect();
            let turned_target = SphericalMap::new(target.surface().clone(), &directions);
            let error = |error| PairError::Sphere { side: "target", error };
            (domain.directions().to_vec(), turned_target.map_err(error)?)
        };
        let align = self.elapsed();

        self.tell(PairPhase::Improving)?;
        let locator = Locator::new(&target);
        let lift = Lift::new(&target, &locator);
        let hierarchy = self.hierarchy()?;
        let goes_on = || self.reporter.should_continue();
        let embedding = Embedding::new(self.domain, &hierarchy, &lift, self.pins(&target), &goes_on);
        let mut after = embedding.sketch_of(&turned);
        let (before, before_meets) = (after.drawing.directions.clone(), embedding.missed(&after).is_empty());
        if self.improve {
            embedding.finish(&mut after);
        }
        self.require_landmarks(&embedding, &after)?;
        let improved = self.elapsed();
        let found = Found {
            before,
            after: after.drawing.directions,
            alignment: 0,
            drawings: 1,
            schedule: None,
            before_meets,
            alignments: vec![],
            rotations,
            seconds: PairSeconds {
                sphere,
                align: align - sphere,
                sketch: 0.0,
                improve: improved - align,
                total: 0.0,
            },
            warnings,
        };
        self.report(Via::Conformal, target, found)
    }

    fn tell(&self, phase: PairPhase) -> Result<(), PairError> {
        match self.reporter.send(phase) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(PairError::Cancelled),
        }
    }

    fn elapsed(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn sphere(
        &self,
        side: &'static str,
        surface: &SurfaceMesh,
        energy: SphereEnergy,
    ) -> Result<SphericalMap, PairError> {
        let options = SphereOptions {
            energy,
            ..SphereOptions::default()
        };
        let told = |phase| self.reporter.send(PairPhase::Sphere(side, phase));
        match map_to_sphere(surface, &options, &told) {
            Ok((map, _)) => Ok(map),
            Err(SphericalError::Cancelled) => Err(PairError::Cancelled),
            Err(error) => Err(PairError::Sphere { side, error }),
        }
    }

    /// Where the vertices are wanted, by each alignment.
    fn guides(&self, target: &SphericalMap) -> Result<(Vec<Guide>, Vec<String>), PairError> {
        let (from, to) = (Body::new(self.domain, "domain")?, Body::new(self.target, "target")?);
        let pairs = self.landmarks.positions(self.domain.vertices(), self.target.vertices());
        let alignments = if pairs.len() < 3 {
            align(&from, &to)
        } else {
            align_by_landmarks(&from, &to, &pairs)?
        };
        let mut warnings = Vec::new();
        if alignments.looks_mirrored() {
            warnings.push(
                "the target looks like the mirror image of the domain; mirror one of them if that is not what you want"
                    .into(),
            );
        }
        let wanted = |alignment: &Alignment| {
            let found = vertex_targets(&from, &to, &alignment.similarity);
            let direction = |found: VertexTarget| (target.direction(&found.place), found.weight);
            Guide {
                wanted: found.into_iter().map(|found| found.map(direction)).collect(),
            }
        };
        Ok((alignments.best.iter().map(wanted).collect(), warnings))
    }

    fn hierarchy(&self) -> Result<Hierarchy, PairError> {
        let late: Vec<u32> = self.landmarks.pairs().iter().map(|pair| pair[0]).collect();
        let error = SphericalError::TooFine;
        Hierarchy::new(self.domain.vertices(), self.domain.triangles(), &late)
            .ok_or(PairError::Sphere { side: "domain", error })
    }

    fn pins(&self, target: &SphericalMap) -> Pins {
        let pin = |&[v, w]: &[u32; 2]| (v, target.directions()[w as usize]);
        Pins::new(
            self.landmarks.pairs().iter().map(pin).collect(),
            self.domain.vertices().len(),
        )
    }

    /// The domain's drawing under the conformal map of the sphere that meets the first three landmarks, unless straight
    /// sides fold there.
    fn by_three_landmarks(&self, domain: &SphericalMap, target: &SphericalMap) -> Option<Vec<Vector>> {
        let three = self.landmarks.pairs().first_chunk::<3>()?;
        let from = three.map(|[v, _]| domain.directions()[v as usize]);
        let to = three.map(|[_, w]| target.directions()[w as usize]);
        let moebius = Moebius::of_three(&from, &to)?;
        let moved: Vec<Vector> = domain.directions().iter().map(|x| moebius.apply(x)).collect();
        certify(self.domain.triangles(), &moved).is_bijective().then_some(moved)
    }

    fn rotation_of_landmarks(
        &self,
        domain: &SphericalMap,
        target: &SphericalMap,
        warnings: &mut Vec<String>,
    ) -> Option<crate::Matrix3> {
        let pairs = self.landmarks.pairs();
        if pairs.len() < 2 {
            return None;
        }
        let (from, to): (Vec<Vector>, Vec<Vector>) = pairs
            .iter()
            .map(|&[v, w]| (domain.directions()[v as usize], target.directions()[w as usize]))
            .unzip();
        let turn = sphere_rotation(&from, &to, &vec![1.0; from.len()])?;
        if pairs.len() > 3 && turn.mirrored_residual < 0.5 * turn.residual {
            warnings.push("the landmarks go round the other way on the target, as on a mirror image".into());
        }
        Some(turn.rotation)
    }

    /// Takes the wanted places themselves where they make a bijection that distorts less: of a solid and its copy, the
    /// exact answer.
    fn take_wanted(&self, embedding: &Embedding, guide: &Guide, sketch: &mut Sketch) {
        let wanted: Option<Vec<Vector>> = guide.wanted.iter().map(|wanted| wanted.map(|(to, _)| to)).collect();
        let Some(wanted) = wanted.filter(|x| certify(self.domain.triangles(), x).is_bijective()) else {
            return;
        };
        let direct = embedding.sketch_of(&wanted);
        let energy = embedding.energy_of(&direct.drawing);
        if embedding.missed(&direct).is_empty() && energy < sketch.energy {
            *sketch = Sketch { energy, ..direct };
        }
    }

    fn require_landmarks(&self, embedding: &Embedding, sketch: &Sketch) -> Result<(), PairError> {
        let missed = embedding.missed(sketch);
        match missed.first() {
            None => Ok(()),
            Some(&first) => Err(PairError::LandmarksMissed {
                landmarks: self.landmarks.pairs().len(),
                first: self.landmarks.pairs()[first],
                missed,
            }),
        }
    }

    fn report(&self, via: Via, target: SphericalMap, found: Found) -> Result<(BoundaryMap, PairReport), PairError> {
        self.tell(PairPhase::Measuring)?;
        let through = |directions: &[Vector]| -> Result<BoundaryMap, PairError> {
            let domain = SphericalMap::new(self.domain.clone(), directions)
                .map_err(|error| PairError::Sphere { side: "domain", error })?;
            Ok(BoundaryMap::through_sphere(domain, target.clone())?)
        };
        let (first, mut map) = (through(&found.before)?, through(&found.after)?);
        let (Some(before), Some(mut after)) = (distortion(&first), distortion(&map)) else {
            return Err(AlignError::NoArea { side: "domain" }.into());
        };
        // What is lowered is the distortion of straight triangles, which is not quite that of the map. The mean would not
        // tell: a few triangles across narrow limbs decide it.
        if found.before_meets && before.symmetric_dirichlet.p90 < after.symmetric_dirichlet.p90 {
            (map, after) = (first, before);
        }
        let mut seconds = found.seconds;
        seconds.total = self.elapsed();
        let report = PairReport {
            via,
            landmarks: self.landmarks.pairs().len(),
            drawings: found.drawings,
            alignments: found.alignments,
            alignment: found.alignment,
            rotations: found.rotations,
            schedule: found.schedule,
            before,
            after,
            seconds,
            warnings: found.warnings,
        };
        Ok((map, report))
    }
}

/// Of the true map: over triangles cut into four, between which it goes through the sphere.
fn distortion(map: &BoundaryMap) -> Option<SurfaceDistortion> {
    let fine = map.subdivided();
    let image: &[Point] = fine.image();
    SurfaceDistortion::of(fine.domain(), image)
}
