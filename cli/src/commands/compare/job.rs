//! Jobs of the worker processes of a comparison, and their results.
//!
//! Every map is made in a process of its own, so that its peak memory can be measured, a mesher that crashes fails one
//! map alone, and one that does not end can be ended.

use std::ops::Deref;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use solidmap::compare::{ComparedMethod, FrameTimings, MapFigures, MeshSpec};

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

impl MethodRow {
    pub fn map_figures(&self) -> Option<&MapFigures> {
        self.figures.as_deref()
    }
}

/// The figures of a map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Figures {
    #[serde(flatten)]
    pub map: MapFigures,
    /// Peak memory of the process until the map is made and before it is measured, program and inputs included.
    pub peak_rss_bytes: u64,
}

impl Deref for Figures {
    type Target = MapFigures;

    fn deref(&self) -> &MapFigures {
        &self.map
    }
}

/// The figures of a sequence.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct SequenceFigures {
    #[serde(flatten)]
    pub timings: FrameTimings,
    /// Frames that could not be used, and why.
    pub skipped: Vec<String>,
    pub peak_rss_bytes: u64,
}

impl Deref for SequenceFigures {
    type Target = FrameTimings;

    fn deref(&self) -> &FrameTimings {
        &self.timings
    }
}

/// Files in the scratch folder.
pub const RESULT: &str = "result.json";
pub const SAMPLES: &str = "samples.npy";
pub const SECTION_IMAGES: &str = "section_images.npy";
pub const SECTION_DENSITY: &str = "section_density.npy";
