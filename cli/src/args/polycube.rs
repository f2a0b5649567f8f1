//! Arguments of `polycube`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use solidmap::polycube::{Orientation, PolycubeOptions};

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "The model is filled with tetrahedra and deformed until each of its triangles lies across an axis. A grid of the\n\
                  polycube is then carried into the model by\n  \
                  solidmap fit POLYCUBE --image IMAGE -o MAP\n  \
                  solidmap remesh MAP --kind hex -o HEXES\n\
                  The exit code is 1 if no polycube was found; then nothing is written but --best-attempt."
)]
pub struct PolycubeArgs {
    /// Closed surface, or a mesh of tetrahedra (.mesh, .msh, .vtk, .vtu), which is used as it is. Any genus
    pub model: PathBuf,
    /// Surface of the polycube to write (.obj, .ply)
    #[arg(short, long, value_name = "SURFACE")]
    pub output: PathBuf,
    /// Surface of the model to write, with the same triangles: those of MODEL, some of them split
    #[arg(long, value_name = "SURFACE")]
    pub image: PathBuf,
    /// Also write the tetrahedra of the polycube (.mesh, .vtk, .vtu)
    #[arg(long, value_name = "TETS")]
    pub tets: Option<PathBuf>,
    /// Also write the same tetrahedra in the model
    #[arg(long, value_name = "TETS")]
    pub model_tets: Option<PathBuf>,
    /// Use these labels instead of seeking some: a line with -x, +x, -y, +y, -z or +z (or 0 to 5) for each triangle of MODEL,
    /// in its order, as --write-model-labels writes them (of an image: as --write-labels). One attempt; the exit code is 2
    /// if they cannot be those of a polycube, and the line is named
    #[arg(long, value_name = "LABELS", conflicts_with = "smoothness")]
    pub labels: Option<PathBuf>,
    /// Also write the label of each triangle of the image, in its order: -x, +x, -y, +y, -z or +z in a line of its own, the
    /// direction that the triangle faces along in the polycube
    #[arg(long, value_name = "LABELS")]
    pub write_labels: Option<PathBuf>,
    /// Also write the labels of the triangles of MODEL, before any was split: of its boundary where it is a mesh of
    /// tetrahedra, in the order of the cells. Polygons count as triangles
    #[arg(long, value_name = "LABELS")]
    pub write_model_labels: Option<PathBuf>,
    /// If no polycube is found, write the tetrahedra of the best attempt (.vtu, .vtk), with the fields `bad`: 1 where they are
    /// inverted or have a boundary triangle that faces against its direction or passes through another; `label`: 0 to 5 for the
    /// direction of the boundary triangle, -1 for inner ones; and `model`: where points are in the model
    #[arg(long, value_name = "TETS")]
    pub best_attempt: Option<PathBuf>,
    #[command(flatten)]
    pub smoothness: SmoothnessArgs,
    #[command(flatten)]
    pub orient: OrientArgs,
    /// Put the planes of the polycube on a lattice with cells of this size, in the units of the model, so that `remesh
    /// --cell-size SIZE` makes no thin cells. The exit code is 1 if that was not possible; the polycube is then written without
    #[arg(long, value_name = "SIZE")]
    pub lattice: Option<f64>,
}

/// Which way up a model is deformed.
#[derive(Debug, Args)]
pub struct OrientArgs {
    /// Turn the model before it is deformed: `principal` so that its normals are as close to the axes as possible, `best`
    /// makes each attempt both ways and takes the polycube with less energy. Only the polycube is turned
    #[arg(long, value_enum, value_name = "HOW", default_value_t)]
    pub orient: OrientationName,
}

/// How a model is turned before it is deformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum OrientationName {
    #[default]
    Given,
    Principal,
    Best,
}

impl From<OrientationName> for Orientation {
    fn from(name: OrientationName) -> Self {
        match name {
            OrientationName::Given => Self::Given,
            OrientationName::Principal => Self::Principal,
            OrientationName::Best => Self::Best,
        }
    }
}

/// How many charts a polycube gets.
#[derive(Debug, Args)]
pub struct SmoothnessArgs {
    /// How much borders between charts of the polycube count against directions: 0.005 gives many charts, 0.04 few. Others
    /// are tried where no polycube is found
    #[arg(long, value_name = "FRACTION", default_value_t = PolycubeOptions::default().smoothness)]
    pub smoothness: f64,
}
