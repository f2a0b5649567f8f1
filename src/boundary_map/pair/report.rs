//! Progress, results and errors of [`map_pair`].

use serde::Serialize;

#[cfg(doc)]
use super::map_pair;
use super::{
    AlignError, ComponentsError, CurveError, LandmarkError, LoopError, PairMethod, SoftTargetSchedule, Stretch,
};
use crate::boundary_map::{BoundaryMapError, SurfaceDistortion};
use crate::check::ShellsError;
use crate::hyperbolic::HyperbolicError;
use crate::spherical::{SpherePhase, SphericalError};
use crate::toroidal::ToroidalError;

/// The current step of [`map_pair`], for progress callbacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairPhase {
    /// A solid (`"domain"` or `"target"`) is mapped to the sphere.
    Sphere(&'static str, SpherePhase),
    /// Both solids, of genus 1, are laid out on flat tori.
    Tori,
    /// The target, of genus 2 or more, is laid out on a hyperbolic surface; the domain where a map is sought the other way.
    HyperbolicSurface,
    /// A map is sought from the target to the domain, too.
    Reversed,
    /// The next shell, of solids with several, is mapped: what follows is of this one.
    Shell {
        /// From 1 on.
        shell: usize,
        /// How many there are.
        of: usize,
    },
    /// The solids are aligned in space, or their conformal embeddings by a rotation.
    Aligning {
        /// Steps done so far.
        done: usize,
        /// About as many steps; 0 where they are not counted.
        of: usize,
    },
    /// Correspondences are sought by intrinsic shape.
    Intrinsic {
        /// Steps done so far.
        done: usize,
        /// Steps in all.
        of: usize,
    },
    /// Coarse embeddings of the domain, one for each combination of start and schedule, are compared; then the better
    /// ones of them with more vertices.
    CoarseEmbeddings {
        /// About as many vertices each.
        vertices: usize,
        /// Embeddings made so far.
        done: usize,
        /// Embeddings to be made with that many vertices.
        of: usize,
    },
    /// The best coarse embedding is refined.
    Refining {
        /// Vertices embedded so far.
        vertices: usize,
        /// Vertices of the domain.
        total: usize,
        /// Mean symmetric Dirichlet energy, 4 for an isometry.
        energy: f64,
    },
    /// The distortion of the map with all vertices is minimised.
    Improving {
        /// Rounds so far.
        rounds: usize,
        /// It ends after at most this many, usually before.
        most_rounds: usize,
    },
    /// The distortion of the maps before and after is measured.
    Measuring {
        /// Maps measured so far.
        done: usize,
        /// Maps to be measured.
        of: usize,
    },
}

/// What [`map_pair`] did and found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairReport {
    /// How the domain was embedded on the target's sphere.
    #[serde(rename = "via")]
    pub method: PairMethod,
    /// Number of landmarks.
    pub landmarks: usize,
    /// The largest distance of the image of a landmark, or of a vertex of a landmark curve, from where it is to be, as a
    /// fraction of the target's diagonal: rounding where landmarks are met exactly.
    pub landmark_error: f64,
    /// Number of coarse embeddings that were compared.
    pub coarse_embeddings: usize,
    /// The starts of the search. Empty with [`PairMethod::Conformal`].
    pub starts: Vec<PairStart>,
    /// Index of the start that was taken; 0 with [`PairMethod::Conformal`].
    pub start: usize,
    /// Other maps that the starts led to, the most promising first: those whose images of vertices are, in the mean, more than a
    /// twentieth of the target's diagonal from this one's.
    pub alternatives: Vec<PairAlternative>,
    /// Correlation of the area distortions under each rotation of the spheres, best first. Empty with
    /// [`PairMethod::SoftTargets`].
    pub rotations: Vec<f64>,
    /// The schedule that was taken; `None` with [`PairMethod::Conformal`].
    pub schedule: Option<SoftTargetSchedule>,
    /// What was found for solids of genus 1; `None` for others.
    pub torus: Option<TorusReport>,
    /// What was found for solids of genus 2 and more; `None` for others.
    pub hyperbolic: Option<HyperbolicReport>,
    /// Distortion of the map before its distortion was minimised.
    pub before: SurfaceDistortion,
    /// Distortion of the map.
    pub after: SurfaceDistortion,
    /// How far the map is from an isometry: `‖CᵀC − I‖² / 20` of the functional map `C` of 20 eigenfunctions that it induces, 0
    /// for an isometry. Poses of one body have up to 0.1, different bodies 0.05 to 0.5; to be compared with those of
    /// [other maps](PairAlternative::isometry_defect) of the pair. `None` where the solids lie in the same place, a map was given, or
    /// a surface is too coarse for eigenfunctions, and with [`PairMethod::Conformal`].
    pub isometry_defect: Option<f64>,
    /// A correspondence by intrinsic shape that is clearly nearer to an isometry than the map and takes the surface elsewhere:
    /// then limbs are probably on wrong limbs.
    pub nearer_isometry: Option<NearerIsometry>,
    /// Whether the map was sought from the target to the domain: what is said of starts, schedules and other maps, and `before`, are of
    /// the first search, whose map was worse; of solids with handles these, `coarse_embeddings`, `torus` and `hyperbolic` are of the search
    /// from the target.
    pub is_reversed: bool,
    /// How much of the domain and the target is stretched so far that the map is probably wrong.
    pub stretch: Stretch,
    /// The shells of the domain in the order of their first triangles, where there are several. Then `after`, `stretch`, `landmarks`,
    /// `timings` and `warnings` are of all, `alternatives` are those that are returned, and all else is of the largest.
    pub shells: Vec<ShellReport>,
    /// Wall time by phase.
    #[serde(rename = "seconds")]
    pub timings: PairTimings,
    /// Whether the work was ended by the progress callback
    /// ([`ProgressControl::Conclude`](crate::progress::ProgressControl::Conclude)): the map is valid, but more
    /// distorted than it would have become.
    pub concluded: bool,
    /// What is unusual about the pair, for the user to read.
    pub warnings: Vec<String>,
}

/// Which class of maps between solids of genus 1 was taken.
///
/// Every map of the solids takes the loop that bounds a disk in one to that in the other. What is left is a sign, and how often
/// that loop is added to the one around the handle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TorusReport {
    /// Classes times translations that were compared before any was optimised.
    pub compared: usize,
    /// Whether both loops change their direction.
    pub is_turned: bool,
    /// How often the loop that bounds in the target is added to the image of one around the domain's handle, beyond the least
    /// twisted ones of both solids.
    pub twist: i32,
    /// Energy of the best map of another class, over that of the one taken, when they were last compared.
    pub runner_up: Option<f64>,
}

/// How the map between solids of genus 2 and more was found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HyperbolicReport {
    /// Handles of each solid.
    pub genus: usize,
    /// Alignments that were tried.
    pub alignments: usize,
    /// Those whose closest points take every handle to one of the target.
    pub classes: usize,
    /// Energy of the next best of them over that of the one taken, when they were compared.
    pub runner_up: Option<f64>,
}

impl PairReport {
    /// The report of a map that was found at once: without landmarks, starts or other maps.
    pub(super) fn of(method: PairMethod, [before, after]: [SurfaceDistortion; 2], stretch: Stretch) -> Self {
        Self {
            method,
            landmarks: 0,
            landmark_error: 0.0,
            coarse_embeddings: 1,
            starts: vec![],
            start: 0,
            alternatives: vec![],
            rotations: vec![],
            schedule: None,
            torus: None,
            hyperbolic: None,
            before,
            after,
            isometry_defect: None,
            nearer_isometry: None,
            is_reversed: false,
            stretch,
            shells: vec![],
            timings: PairTimings::default(),
            concluded: false,
            warnings: vec![],
        }
    }

    /// Whether the map is one to one but probably not the one that is wanted: a limb is in the wrong place.
    pub fn looks_wrong(&self) -> bool {
        self.stretch.looks_wrong() || self.nearer_isometry.is_some() || self.stretched_shell().is_some()
    }

    /// The first shell of which too much is stretched, by its index.
    pub fn stretched_shell(&self) -> Option<usize> {
        let Stretch { domain, target, .. } = &self.stretch;
        let is_stretched =
            |shell: &ShellReport| shell.stretched > domain.limit || shell.target_stretched > target.limit;
        self.shells.iter().position(is_stretched)
    }
}

/// How a shell was mapped, of a solid that has several.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ShellReport {
    /// The shell of the target that it goes to. Shells count from 0 in the order of their first triangles.
    pub target: usize,
    /// Whether it bounds a cavity.
    pub is_cavity: bool,
    /// Its handles.
    pub genus: u64,
    /// Its vertices.
    pub vertices: usize,
    /// Those of the target's shell.
    pub target_vertices: usize,
    /// How it was embedded.
    #[serde(rename = "via")]
    pub method: PairMethod,
    /// Distortion of its map.
    pub distortion: SurfaceDistortion,
    /// The share of its area that is stretched too far ([`Stretch::domain`]).
    pub stretched: f64,
    /// The share of the area of the target's shell ([`Stretch::target`]).
    pub target_stretched: f64,
}

/// A correspondence by intrinsic shape beside a map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NearerIsometry {
    /// How far it is from an isometry, as [`PairReport::isometry_defect`].
    pub isometry_defect: f64,
    /// Mean distance of its images of vertices from those of the map, as a fraction of the target's diagonal.
    pub distance: f64,
}

/// What soft targets come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum PairStartKind {
    /// Closest points of the solids as they lie.
    Aligned,
    /// Closest points once the solids are aligned by shape.
    Alignment,
    /// Closest points once the solids are aligned by landmarks.
    Landmarks,
    /// Closest points once the domain is deformed so that its landmarks come to those of the target.
    LandmarkWarp,
    /// A map of the surfaces cut open along loops, for solids with several handles.
    Loops,
    /// Intrinsic shape: distances along the surfaces and their eigenfunctions, whatever the pose.
    Intrinsic,
    /// The same, with strong pulls at the extremities.
    Extremities,
    /// A map that was found first, of which a part was out of order, refined by eigenfunctions.
    Refined,
    /// The map that was found without landmarks, which was then made to meet them.
    WithoutLandmarks,
    /// The boundary map that was given.
    Given,
    /// No soft targets: another class of maps between solids of genus 1.
    Class,
}

/// A start of the search for the best coarse embedding.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PairStart {
    /// What its soft targets come from.
    pub kind: PairStartKind,
    /// The lowest mean symmetric Dirichlet energy (4 for an isometry, 100 at most in any triangle) of its embeddings when they
    /// were last compared; protrusions of the target inside a triangle count. Infinite for an alignment of solids with several handles
    /// that leads to no map.
    pub energy: f64,
    /// Number of vertices that the embedding had.
    pub vertices: usize,
}

/// Another map that the search found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PairAlternative {
    /// For solids with several shells: the outermost shell of the domain whose map differs, together with those of the shells inside it.
    pub shell: Option<usize>,
    /// What its soft targets came from.
    pub kind: PairStartKind,
    /// Mean symmetric Dirichlet energy of its coarse embedding over that of the map that was taken, when both had as many
    /// vertices; of the maps themselves where a shell was mapped again because of those inside it.
    pub energy_ratio: f64,
    /// How far its coarse embedding was from an isometry, as [`PairReport::isometry_defect`].
    pub isometry_defect: Option<f64>,
    /// Mean distance of its images of vertices from those of the map that was taken, as a fraction of the target's diagonal.
    pub distance: f64,
}

/// Wall time of [`map_pair`] by phase, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PairTimings {
    /// Maps to the sphere, with the alignments and intrinsic shapes that are found beside them, or to flat tori.
    pub sphere: f64,
    /// Soft targets.
    pub align: f64,
    /// Coarse embeddings.
    pub coarse: f64,
    /// Refinement and optimisation of the best embedding.
    pub improve: f64,
    /// Further searches, where there were any: from the target to the domain, from a map of which a part was out of order, and without
    /// landmarks. Of solids with two handles or more that one, of both ways, whose map was not taken.
    pub reversed: f64,
    /// All phases.
    pub total: f64,
}

/// The time of several maps that are made one after the other.
impl std::iter::Sum for PairTimings {
    fn sum<I: Iterator<Item = Self>>(timings: I) -> Self {
        timings.fold(Self::default(), |a, b| Self {
            sphere: a.sphere + b.sphere,
            align: a.align + b.align,
            coarse: a.coarse + b.coarse,
            improve: a.improve + b.improve,
            reversed: a.reversed + b.reversed,
            total: a.total + b.total,
        })
    }
}

/// Why [`map_pair`] failed.
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
    /// The solids differ in the number of handles.
    #[error(
        "the domain has genus {domain} and the target genus {target} (handles), and only solids of the same genus map to each \
         other one to one; close handles of one, or give another solid"
    )]
    UnequalGenus {
        /// Handles of the domain.
        domain: u64,
        /// Handles of the target.
        target: u64,
    },
    /// No alignment of solids of genus 2 or more leads to a map.
    #[error(
        "no map of the handles was found: of {tried} alignments by shape none takes every handle of the domain to one of the target; \
         give loops around their holes that correspond, solids that are more alike, or a boundary map that was made elsewhere"
    )]
    NoClass {
        /// Alignments of the domain to the target that were tried.
        tried: usize,
    },
    /// An option has no meaning for solids with a handle.
    #[error("{option} cannot be used with solids of genus {genus}; leave the option out")]
    NotWithHandles {
        /// What was given.
        option: &'static str,
        /// Handles of each solid.
        genus: u64,
    },
    /// A solid has no map to a flat torus.
    #[error("the {side} has no map to a flat torus: {error}")]
    Torus {
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// Why not.
        error: ToroidalError,
    },
    /// A solid has no map to a hyperbolic surface.
    #[error("the {side} has no map to a hyperbolic surface: {error}")]
    Hyperbolic {
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// Why not.
        error: HyperbolicError,
    },
    /// The shells of a solid cannot be told apart.
    #[error("the shells of the {side} cannot be told apart: {error}")]
    Shells {
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// Why not.
        error: ShellsError,
    },
    /// The solids have different numbers of shells, which are components and cavities.
    #[error(
        "the domain has {domain} shells (components and cavities) and the target {target}; a boundary map needs as many in \
         both: `solidmap check` lists them"
    )]
    UnequalShells {
        /// Shells of the domain.
        domain: usize,
        /// Shells of the target.
        target: usize,
    },
    /// The shells do not match.
    #[error(
        "the shells (components and cavities) of the two solids do not match: {reason}; `solidmap check` lists them"
    )]
    NoMatchingShells {
        /// Which do not.
        reason: String,
    },
    /// Shells cannot go where they are to go.
    #[error(transparent)]
    Components(#[from] ComponentsError),
    /// A shell cannot be mapped.
    #[error("shell {shell} of the domain, counted from 0: {error}")]
    Shell {
        /// Which, in the order of their first triangles.
        shell: usize,
        /// Why not.
        error: Box<PairError>,
    },
    /// The solids cannot be aligned.
    #[error(transparent)]
    Align(#[from] AlignError),
    /// Landmarks are not pairs of vertices of these solids.
    #[error(transparent)]
    Landmarks(#[from] LandmarkError),
    /// Landmark curves are not paths on these solids.
    #[error(transparent)]
    Curves(#[from] CurveError),
    /// Loops do not decide on a class of maps.
    #[error(transparent)]
    Loops(#[from] LoopError),
    /// A weight is not a positive number.
    #[error("the weight of landmarks is {0}; give a positive number, or none for landmarks that are met exactly")]
    Weight(f64),
    /// A direction that points up has no length.
    #[error("the directions that point up are no directions: one is zero or not finite")]
    Up,
    /// No bijection was found that meets all landmarks.
    #[error(
        "{} of {landmarks} landmarks cannot be met without inverting triangles, the first is pair {}, counted from 0 \
         (domain vertex {}, target vertex {}): do they have the same cyclic order on both solids? Leave it out, or \
         correct it",
        missed.len(), missed[0], first[0], first[1]
    )]
    LandmarksMissed {
        /// Number of landmarks.
        landmarks: usize,
        /// Indices of the pairs that are not met.
        missed: Vec<usize>,
        /// The vertices of the first of them.
        first: [u32; 2],
    },
    /// The distortion of every coarse embedding overflowed, because triangles of the target are nearly flat.
    #[error(
        "no embedding of the domain on the target's sphere has a finite distortion; look for flat triangles with \
         `solidmap check`"
    )]
    NoEmbedding,
    /// The map to start from is of another mesh than the domain.
    #[error(
        "the map to start from is of {vertices} vertices, and the domain has {expected}; start from one of the same mesh"
    )]
    Start {
        /// Vertices of the map.
        vertices: usize,
        /// Vertices of the domain.
        expected: usize,
    },
    /// A surface is out of scale.
    #[error(transparent)]
    Boundary(#[from] BoundaryMapError),
    /// The progress callback cancelled the run.
    #[error("cancelled by the progress callback")]
    Cancelled,
}
