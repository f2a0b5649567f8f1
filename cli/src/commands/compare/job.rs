//! What a comparison asks of a process of its own, and what it gets back.
//!
//! Every map is made in a process of its own: its peak of memory is then its own, a mesher that crashes takes its own row
//! with it and no other, and one that does not end can be ended.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use solidmap::compare::{BuildTimings, ComparedMethod, MapDifference, MeshSpec};
use solidmap::energy::{DensityQuantiles, Determinants, DistortionMetrics};
use solidmap::fit::BoundaryError;

use crate::shared::input::BoundarySource;

/// A task, with all that it depends on.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Job {
    pub source: BoundarySource,
    pub task: Task,
    /// How the domain is meshed; `None` for the default.
    pub mesh: Option<MeshSpec>,
    /// A tet mesh of the domain to take instead.
    pub given: Option<PathBuf>,
    pub tolerance: f64,
    /// Distance of the sources over their spacing.
    pub alpha: f64,
    pub memory: Option<u64>,
    /// Part of the energy that the last step of the variational method lowers it by.
    pub threshold: f64,
    pub resolution: usize,
    pub interior: usize,
    pub seed: u64,
    /// Where to cut for the pictures, and what points up there.
    pub section: Option<Cut>,
    /// Images of the points inside, and of those of the section, by the reference.
    pub reference: Option<[PathBuf; 2]>,
    /// Folder for what the next process or the pictures need.
    pub scratch: PathBuf,
    /// Folder for what the user gets.
    pub keep: Option<PathBuf>,
}

/// What to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Task {
    /// Make a map and measure it.
    Method(ComparedMethod),
    /// Make a finer map that the others are held against.
    Reference,
    /// Map the domain to one frame after the other.
    Sequence(ComparedMethod, Vec<PathBuf>),
}

/// A plane perpendicular to a coordinate axis.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Cut {
    /// 0, 1 or 2.
    pub axis: usize,
    pub up: usize,
    /// In model units.
    pub position: f64,
}

/// Pixels along the longer side of a section.
pub const SECTION_PIXELS: usize = 420;

/// A line of the table.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    pub name: String,
    /// Why there are no figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    #[serde(flatten)]
    pub figures: Option<Figures>,
}

/// What is known of a map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Figures {
    pub seconds: BuildTimings,
    /// Peak memory of the process when the map was made, with the program and its inputs.
    pub peak_rss_bytes: u64,
    /// Tetrahedra that the map is made of, or that were carried to count folds.
    pub tets: Option<usize>,
    pub flipped_tets: Option<usize>,
    /// Unknowns per coordinate.
    pub unknowns: usize,
    pub iterations: Option<usize>,
    pub boundary_error: BoundaryError,
    /// Difference to the reference.
    pub interior_difference: Option<MapDifference>,
    /// With both solids at unit volume, as the deformation energy.
    pub harmonic_energy: f64,
    pub deformation_energy: f64,
    pub energy_density: DensityQuantiles,
    pub min_det_jacobian: f64,
    pub det_jacobian: Option<Determinants>,
    /// Part of the volume where the map is folded.
    pub folded_fraction: f64,
    /// Means over the volume where the map is not folded, the target scaled to the domain's volume.
    pub distortion: Option<DistortionMetrics>,
    /// As VOLMAP's program forms them.
    pub volmap: Option<DistortionMetrics>,
    pub quadrature_points: usize,
    /// What could not be found out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

impl Figures {
    /// Seconds to make the map.
    pub fn total_seconds(&self) -> f64 {
        self.seconds.mesh + self.seconds.factor + self.seconds.solve
    }
}

/// What is known of a sequence.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SequenceFigures {
    /// Meshing and factoring.
    pub setup_seconds: f64,
    /// One frame after the other, each on its own.
    pub frame_seconds: Vec<f64>,
    /// All frames together: in a block, or each from where the one before ended.
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
