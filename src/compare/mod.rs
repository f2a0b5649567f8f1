//! Comparison of methods: maps of the same boundary map, measured in the same way (extends section 4.7 of the paper).
//!
//! [`build`] computes a map by one [`ComparedMethod`] and times its phases. [`MapEvaluator`] holds what all maps are
//! measured at: one grid to begin all integrals with, and one set of points inside. It returns [`MapMeasurements`] for each
//! map, and [`measured_map`] all [`MapFigures`]. [`reference()`] makes the map that others are compared with,
//! [`frame_timings`] times sequences, [`equal_accuracy`] refines finite elements, and [`spread`] measures how much the maps
//! of one method differ among themselves.

mod build;
mod figures;
mod frames;
mod measure;
mod reference;
mod variations;

pub use build::{
    BuildOptions, BuildTimings, BuiltMap, ComparedMethod, MeshSpec, TetMesher, build, make_mesh, mesh_for,
};
pub use figures::{MapFigures, MeasuredMap, measured_map};
pub use frames::{FrameTimings, frame_timings};
pub use measure::{
    EvaluationOptions, FoldCount, InteriorImages, MapDifference, MapEvaluator, MapMeasurements, boundary_error,
    carried, spread,
};
pub use reference::{Reference, outward, reference};
pub use variations::{Variation, equal_accuracy};

use crate::baseline::{BaselineError, MeanValueError};
use crate::bijective::BijectiveError;
use crate::energy::{EnergyError, QuadratureError};
use crate::fit::FitError;
use crate::geometry::QueryError;

/// Why a map cannot be computed or measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// The fit by fundamental solutions failed.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A method on tetrahedra failed.
    #[error(transparent)]
    Baseline(#[from] BaselineError),
    /// The map cannot be made one to one.
    #[error(transparent)]
    Bijective(#[from] Box<BijectiveError>),
    /// Mean value coordinates failed.
    #[error(transparent)]
    MeanValue(#[from] MeanValueError),
    /// The mesher failed.
    #[cfg(feature = "native")]
    #[error("the domain could not be meshed: {0}")]
    Mesher(#[from] crate::cgal_tetgen::CgalTetgenError),
    /// This build has no mesher.
    #[error("tetrahedra need TetGen or CGAL; build with the feature `native`, or give a tet mesh of the domain")]
    NoMesher,
    /// More tetrahedra than allowed.
    #[error(
        "about {tets:.1e} tetrahedra of edge length {edge:.3e} fill the domain, and {most} are allowed; ask for larger ones \
         (mesh-size) or raise the limit (max-tets)"
    )]
    TooManyTets {
        /// An estimate.
        tets: f64,
        /// The edge length asked for.
        edge: f64,
        /// The limit.
        most: usize,
    },
    /// The tet mesh does not have the volume of the domain.
    #[error(
        "the tet mesh has a volume of {found:.6}, and the domain {expected:.6}; give a mesh of the domain (`solidmap tet`)"
    )]
    OtherSolid {
        /// The mesh's volume.
        found: f64,
        /// The domain's volume.
        expected: f64,
    },
    /// The tet mesh has another position or shape than the domain.
    #[error(
        "the boundary of the tet mesh is up to {distance:.3e} away from the domain's surface, whose diagonal is \
         {diagonal:.3e}; give a mesh of the domain (`solidmap tet`)"
    )]
    Elsewhere {
        /// Largest distance of a boundary vertex, in model units.
        distance: f64,
        /// The diagonal of the domain's bounding box.
        diagonal: f64,
    },
    /// An option is out of its range.
    #[error("the {what} is {value}, but must be {range}")]
    Option {
        /// The option.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// The domain has no quadrature.
    #[error(transparent)]
    Quadrature(#[from] QuadratureError),
    /// The map has no finite energy.
    #[error(transparent)]
    Energy(#[from] EnergyError),
    /// The domain cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// No point of the domain was found.
    #[error("no point inside the domain was found in {tries} tries; it is too thin to compare maps inside it")]
    NoInterior {
        /// Points that were tried.
        tries: usize,
    },
    /// The map is not finite at points inside or on the boundary.
    #[error("the map has no finite value at {points} of {of} points")]
    NonFinite {
        /// Points without a finite value.
        points: usize,
        /// Points that were evaluated.
        of: usize,
    },
    /// The method keeps nothing from frame to frame.
    #[error("{method} keeps nothing from frame to frame")]
    NotPrepared {
        /// The method.
        method: &'static str,
    },
    /// The map is not finite on the boundary.
    #[error("the map has no finite value at points of the boundary")]
    NonFiniteBoundary,
}
