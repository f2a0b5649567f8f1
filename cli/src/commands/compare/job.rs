//! Jobs of the worker processes of a comparison, and their results.
//!
//! Every map is made in a process of its own, so that its peak memory can be measured, a mesher that crashes fails one
//! map alone, and one that does not end can be ended.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use solidmap::compare::{BuildTimings, ComparedMethod, MapDifference, MeshSpec};
use solidmap::energy::{DensityQuantiles, Determinants, DistortionMetrics, EnergyErrors};
use solidmap::fit::BoundaryError;

use crate::shared::input::BoundarySource;
use crate::shared::stored_paths;

/// A task, with all that it depends on.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Job {
    pub source: BoundarySource,
    pub task: Task,
    /// How the domain is meshed; `None` for the default.
    pub mesh: Option<MeshSpec>,
    /// A tet mesh of the domain to use instead.
    #[serde(with = "stored_paths")]
    pub given: Option<PathBuf>,
    pub tolerance: f64,
    /// Distance of the sources from the surface, over their spacing.
    pub alpha: f64,
    pub memory: Option<u64>,
    /// The variational method stops when a step lowers the energy by less than this fraction.
    pub threshold: f64,
    pub resolution: usize,
    pub interior: usize,
    pub seed: u64,
    /// The section that pictures show.
    pub section: Option<SectionView>,
    /// Files of images by the reference: of the points inside, and of those of the section.
    #[serde(with = "stored_paths")]
    pub reference: Option<[PathBuf; 2]>,
    /// Folder for what later processes and the pictures need.
    #[serde(with = "stored_paths")]
    pub scratch: PathBuf,
    /// Folder for results that the user gets.
    #[serde(with = "stored_paths")]
    pub keep: Option<PathBuf>,
}

/// What to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Task {
    /// Make a map and measure it.
    Method(ComparedMethod),
    /// Make a finer map that the others are compared with.
    Reference,
    /// Map the domain to one frame after the other.
    Sequence(ComparedMethod, #[serde(with = "stored_paths")] Vec<PathBuf>),
}

/// A plane perpendicular to a coordinate axis, and what points up in pictures of it.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct SectionView {
    /// Coordinate axes: 0, 1 or 2.
    pub axis: usize,
    pub up: usize,
    /// In model units.
    pub position: f64,
}

/// Pixels along the longer side of a section.
pub const SECTION_PIXELS: usize = 420;

/// A row of the tables: a map and its figures.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MethodRow {
    pub name: String,
    /// Why there are no figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    #[serde(flatten)]
    pub figures: Option<Figures>,
}

/// The figures of a map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Figures {
    pub seconds: BuildTimings,
    /// Peak memory of the process until the map is made and before it is measured, program and inputs included.
    pub peak_rss_bytes: u64,
    /// Tetrahedra that the map is linear over, or that were carried to count inverted ones.
    pub tets: Option<usize>,
    pub inverted_tets: Option<usize>,
    /// Unknowns per coordinate.
    pub unknowns: usize,
    pub iterations: Option<usize>,
    pub boundary_error: BoundaryError,
    /// Difference to the reference.
    pub interior_difference: Option<MapDifference>,
    /// With both solids at unit volume, as the deformation energy.
    pub harmonic_energy: f64,
    pub deformation_energy: f64,
    /// Estimated errors of the energies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub errors: Option<EnergyErrors>,
    pub harmonic_density: DensityQuantiles,
    pub min_det_jacobian: f64,
    pub det_jacobian: Option<Determinants>,
    /// Fraction of the volume where the map is folded.
    pub folded_fraction: f64,
    /// Means over the volume where the map is not folded, the target scaled to the domain's volume.
    pub distortion: Option<DistortionMetrics>,
    /// The same as computed by VOLMAP's program.
    pub volmap: Option<DistortionMetrics>,
    pub quadrature_points: usize,
    /// What could not be measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

impl Figures {
    /// Seconds to make the map, without evaluation.
    pub fn total_seconds(&self) -> f64 {
        self.seconds.mesh + self.seconds.factor + self.seconds.solve
    }
}

/// The figures of a sequence.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct SequenceFigures {
    /// Meshing and factoring.
    pub setup_seconds: f64,
    /// For each frame, solved on its own.
    pub frame_seconds: Vec<f64>,
    /// All frames together: in a block, or each starting from the frame before.
    pub together_seconds: f64,
    pub boundary_error_p99: f64,
    /// Frames that could not be used, and why.
    pub skipped: Vec<String>,
    pub peak_rss_bytes: u64,
}

/// Files in the scratch folder.
pub const RESULT: &str = "result.json";
pub const SAMPLES: &str = "samples.npy";
pub const SECTION_IMAGES: &str = "section_images.npy";
pub const SECTION_DENSITY: &str = "section_density.npy";
