//! Arguments of `polycube`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use solidmap::model_polycube::{MOST_VERTICES, PolycubeKind};
use solidmap::polycube::{Orientation, PolycubeOptions};

use super::section::UpKind;
use super::view::PageSizeArgs;

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "The model is filled with tetrahedra and deformed until each of its triangles lies across an axis; where that does not\n\
                  succeed, voxels fill it, and their boundary is mapped to the model's. A grid of the polycube is then carried into the\n\
                  model by\n  \
                  solidmap fit POLYCUBE --boundary FILE -o MAP\n  \
                  solidmap remesh MAP --kind hex -o HEXES\n\
                  The exit code is 1 if no polycube was found; then nothing is written but --best-attempt."
)]
pub struct PolycubeArgs {
    /// Closed surface, or a mesh of tetrahedra (.mesh, .msh, .vtk, .vtu), which is used as it is. Any genus
    pub model: PathBuf,
    /// Surface of the polycube to write (.obj, .ply)
    #[arg(short, long, value_name = "SURFACE")]
    pub output: PathBuf,
    /// Surface with the same triangles to write, every vertex where it is on the model. Where the model was deformed as it is, these are
    /// the triangles of MODEL, some of them split; else see --boundary
    #[arg(long, value_name = "SURFACE")]
    pub image: PathBuf,
    /// Also write the boundary map from the polycube to the model, which says where every point goes, for `fit --boundary`
    /// (.safetensors)
    #[arg(long, value_name = "FILE")]
    pub boundary: Option<PathBuf>,
    /// Where the polycube comes from
    #[arg(long, value_enum, default_value_t = PolycubeChoice::Auto)]
    pub polycube: PolycubeChoice,
    /// Largest surface that is deformed as it is; one with handles or long sharp edges may have 2.5 times as many vertices. Larger ones
    /// are simplified, and the boundary of their polycube is mapped to the model's own
    #[arg(long, value_name = "VERTICES", default_value_t = MOST_VERTICES)]
    pub max_vertices: usize,
    /// Also write the tetrahedra of the polycube (.mesh, .vtk, .vtu), of the simplified model if there is one. Voxels have none:
    /// with this option they are not tried
    #[arg(long, value_name = "TETS")]
    pub tets: Option<PathBuf>,
    /// Also write the same tetrahedra in the model, or the simplified one. Voxels have none: with this option they are not tried
    #[arg(long, value_name = "TETS")]
    pub model_tets: Option<PathBuf>,
    /// Use these labels instead of seeking some: a line with -x, +x, -y, +y, -z or +z (or 0 to 5) for each triangle of MODEL,
    /// in its order, as --write-model-labels writes them (of an image: as --write-labels); or a surface (.ply, .obj) with the
    /// property `label` of faces, or materials or groups of these names. One attempt; the exit code is 2
    /// if they cannot be those of a polycube, and the line is named
    #[arg(long, value_name = "LABELS", conflicts_with_all = ["smoothness", "features", "polycube", "max_vertices"])]
    pub labels: Option<PathBuf>,
    /// Also write the label of each triangle of the image, in its order: -x, +x, -y, +y, -z or +z in a line of its own, the
    /// direction that the triangle faces along in the polycube. With .ply or .obj the image with them is written
    #[arg(long, value_name = "LABELS")]
    pub write_labels: Option<PathBuf>,
    /// Also write the labels of the triangles of MODEL, before any was split: of its boundary where it is a mesh of
    /// tetrahedra, in the order of the cells. Polygons count as triangles. With .ply or .obj the surface with them is written.
    /// Where MODEL was not deformed as it is, a triangle gets the label of the face that its middle goes to
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
    /// Write a picture: the polycube and the model painted with one pattern, and coloured by distortion
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the map of the boundaries, as `view` does (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Axis that points up in the picture and the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

/// Where a polycube comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolycubeChoice {
    /// The model, deformed; voxels, if one attempt fails (with two handles or more: if all do). `hexmesh` takes voxels, too, if the
    /// deformed model leads to no valid mesh, or, with one handle at most, if its cells are poor and those by voxels better
    Auto,
    /// The model, deformed until each of its triangles lies across an axis, in up to five attempts. Any genus
    Deformed,
    /// Voxels that fill the model, their boundary mapped to the model's
    Voxels,
}

impl From<PolycubeChoice> for PolycubeKind {
    fn from(choice: PolycubeChoice) -> Self {
        match choice {
            PolycubeChoice::Auto => Self::Auto,
            PolycubeChoice::Deformed => Self::Deformed,
            PolycubeChoice::Voxels => Self::Voxels,
        }
    }
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
    /// Edges of the model with at least this angle, in degrees, between the normals beside them become edges of the polycube where
    /// the directions of their sides allow it, and the report says how many did. Without it borders between charts follow sharp edges
    /// as well, but are not free of cost there
    #[arg(long, value_name = "DEGREES")]
    pub features: Option<f64>,
}
