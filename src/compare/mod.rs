//! One boundary map through every method, measured alike (section 4.7 of the paper, and beyond it).
//!
//! [`build`] makes a map by one [`ComparedMethod`] and says what it cost, phase by phase. [`MapEvaluator`] fixes where maps are
//! measured: one quadrature for all energies, one set of points inside, one tetrahedral mesh to be carried. What it
//! gives is a [`MapMeasurements`] for each map. [`spread`] says how much the maps of one method differ among themselves.

mod build;
mod measure;

pub use build::{
    BuildOptions, BuildTimings, BuiltMap, ComparedMethod, MeshSpec, TetMesher, build, make_mesh, mesh_for,
};
pub use measure::{
    EvaluationOptions, FoldCount, InteriorImages, MapDifference, MapEvaluator, MapMeasurements, boundary_error,
    carried, spread,
};

use crate::baseline::{BaselineError, MeanValueError};
use crate::energy::{EnergyError, QuadratureError};
use crate::fit::FitError;
use crate::geometry::QueryError;

/// Why a method has no row in a comparison.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// The harmonic map by fundamental solutions.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A map on tetrahedra.
    #[error(transparent)]
    Baseline(#[from] BaselineError),
    /// Mean value coordinates.
    #[error(transparent)]
    MeanValue(#[from] MeanValueError),
    /// The mesher failed.
    #[cfg(feature = "native")]
    #[error("the domain could not be meshed: {0}")]
    Mesher(#[from] crate::cgal_tetgen::CgalTetgenError),
    /// There is no mesher.
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
        /// What was asked for.
        edge: f64,
        /// The limit.
        most: usize,
    },
    /// A tet mesh of something else.
    #[error(
        "the tet mesh has a volume of {found:.6}, and the domain {expected:.6}; give a mesh of the domain (`solidmap tet`)"
    )]
    OtherSolid {
        /// Of the mesh.
        found: f64,
        /// Of the domain.
        expected: f64,
    },
    /// A tet mesh in another place, or of another shape.
    #[error(
        "the boundary of the tet mesh is up to {distance:.3e} away from the domain's surface, whose diagonal is \
         {diagonal:.3e}; give a mesh of the domain (`solidmap tet`)"
    )]
    Elsewhere {
        /// Largest distance of a boundary vertex, in model units.
        distance: f64,
        /// Of the domain's bounding box.
        diagonal: f64,
    },
    /// A size that is none.
    #[error("the {what} is {value}, but must be {range}")]
    Option {
        /// What was set.
        what: &'static str,
        /// To what.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// No grid over the domain.
    #[error(transparent)]
    Quadrature(#[from] QuadratureError),
    /// A map without a finite energy.
    #[error(transparent)]
    Energy(#[from] EnergyError),
    /// A domain without an inside.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// No point of the domain was found.
    #[error("no point inside the domain was found in {tries} tries; it is too thin to compare maps inside of it")]
    NoInterior {
        /// How many.
        tries: usize,
    },
    /// A map without a finite value at a point inside or on the boundary.
    #[error("the map has no finite value at {points} of {of} points")]
    NonFinite {
        /// How many have none.
        points: usize,
        /// Of how many.
        of: usize,
    },
}
