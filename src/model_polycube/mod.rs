//! A polycube of a model of any size, with the map from its boundary to the model's.
//!
//! The polycube is the model itself, deformed ([`make_polycube`]); of a large model a simplified one, deformed; or voxels
//! ([`VoxelPolycube`]). The boundaries of the last two are mapped to the model's own
//! ([`map_pair`](crate::boundary_map::pair::map_pair)).

mod labels;
mod simplified;
pub(crate) mod voxels;

use crate::boundary_map::pair::{PairError, PairPhase};
use crate::boundary_map::{BoundaryMap, BoundaryMapError};
use crate::mesh::{FEATURE_ANGLE, SurfaceMesh, TetMesh, creases, feature_curves};
use crate::polycube::{
    MakePolycubeError, PolycubeMap, PolycubeOptions, PolycubePhase, VoxelPolycube, VoxelPolycubeError, make_polycube,
};
use crate::progress::{ProgressControl, ProgressResponse};
use crate::remesh::CellSize;
use crate::spherical::{SphericalError, genus};

pub use simplified::SimplifiedReport;
pub use voxels::VoxelReport;

/// Where a polycube comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PolycubeKind {
    /// A deformation of the model if one attempt finds one (with two handles or more: if any attempt does), else voxels.
    #[default]
    Auto,
    /// The model, deformed ([`make_polycube`]), or a simplified one.
    Deformed,
    /// Voxels ([`VoxelPolycube`]).
    Voxels,
}

/// Attempts at a deformation where voxels are left as well. For scale: an attempt that fails takes up to a minute for 50 000
/// tetrahedra, voxels 20 s, with cells no worse.
const ATTEMPTS_BEFORE_VOXELS: usize = 1;
/// Most of the effort of such an attempt ([`PolycubeOptions::effort`]).
const EFFORT_BEFORE_VOXELS: f64 = 2000.0;

/// Handles of a model, at most, whose voxels are tried after a few attempts at a deformation, and not after all: the more handles, the
/// less often voxels show all of them.
const HANDLES_OF_FEW_ATTEMPTS: u64 = 1;

/// Vertices of a model with handles or feature curves that is deformed as it is, over [`ModelPolycubeOptions::most_vertices`]. A
/// simplified ring leads to
/// a polycube less often than the ring itself, and voxels, which follow, to worse cells: the kitten's, of 9447 vertices, have a least
/// scaled Jacobian of 0.61 by its own deformation in 22 s, 0.43 by voxels in 43 s. And the map from a simplified model knows nothing of
/// its feature curves.
const ROOM: f64 = 2.5;

/// Least length of connected feature curves, over the root of the surface's area: less is noise of a scanned surface.
const LEAST_FEATURES: f64 = 0.5;

/// Cells along the longest side of the lattice that voxels are on, where no lattice is asked for.
const CELLS_ALONG: usize = 32;

/// Options of [`make_model_polycube`].
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPolycubeOptions {
    /// Where the polycube comes from.
    pub kind: PolycubeKind,
    /// A model of genus 0 whose surface has more vertices, or one with handles or feature curves with more than 2.5 times as many, is simplified, and its
    /// polycube is made from the simplified one. The polycube's boundary is mapped to the model's own. Without the feature `native` it
    /// is deformed as it is.
    pub most_vertices: usize,
    /// How the model is deformed. Voxels are on the same lattice, or one of 32 cells along the longest side of the model.
    pub deformation: PolycubeOptions,
}

impl Default for ModelPolycubeOptions {
    fn default() -> Self {
        Self {
            kind: PolycubeKind::Auto,
            most_vertices: MOST_VERTICES,
            deformation: PolycubeOptions::default(),
        }
    }
}

/// The default of [`ModelPolycubeOptions::most_vertices`].
pub const MOST_VERTICES: usize = 6000;

/// The current step of [`make_model_polycube`], for progress callbacks.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelPolycubePhase {
    /// A large model is simplified.
    Simplifying,
    /// The model, or the simplified one, is deformed.
    Deforming(PolycubePhase),
    /// The boundary of voxels, or of a simplified model, is mapped to the model's.
    Pairing(PairPhase),
}

/// Why there is no polycube.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelPolycubeError {
    /// The model cannot be deformed to a polycube, or cannot be used.
    #[error(transparent)]
    Deformation(#[from] MakePolycubeError),
    /// There is no polycube of voxels.
    #[error(transparent)]
    Voxels(#[from] VoxelPolycubeError),
    /// The boundary of the polycube of voxels, or of the simplified model, cannot be mapped to the model's.
    #[error(
        "the boundary of the polycube of voxels, or of the simplified model, cannot be mapped to the model's (the target): {0}"
    )]
    Pair(#[from] PairError),
    /// The polycube's boundary and the model's are no boundary map.
    #[error(transparent)]
    BoundaryMap(#[from] BoundaryMapError),
    /// The surface of the model encloses no volume, or it is inside out.
    #[error("the surface of the model encloses no volume")]
    NoVolume,
    /// The model cannot be deformed to a polycube, and there is none of voxels.
    #[error("{deformed}; and by voxels instead: {voxels}")]
    Neither {
        /// Why there is no deformed model.
        deformed: Box<Self>,
        /// Why there are no voxels.
        voxels: Box<Self>,
    },
}

impl ModelPolycubeError {
    /// Whether no polycube was found, though the model is one that can be used.
    pub fn is_without_polycube(&self) -> bool {
        matches!(
            self,
            Self::Deformation(MakePolycubeError::NotFound { .. } | MakePolycubeError::NoLabels) | Self::Neither { .. }
        )
    }

    /// Whether voxels may be a polycube all the same.
    pub(crate) fn may_be_voxels(&self) -> bool {
        self.is_without_polycube() || matches!(self, Self::Pair(_)) && !self.is_cancelled()
    }

    /// Whether the progress callback cancelled the work.
    pub fn is_cancelled(&self) -> bool {
        matches!(
            self,
            Self::Deformation(MakePolycubeError::Cancelled) | Self::Pair(PairError::Cancelled)
        )
    }
}

/// A polycube of a model.
#[derive(Debug)]
pub enum Polycube {
    /// The model, deformed; or a simplified one.
    Deformed(Box<PolycubeMap>, Option<Box<SimplifiedReport>>),
    /// Voxels.
    Voxels(VoxelPolycube, Box<VoxelReport>),
}

/// A polycube of a model, and the map between their boundaries.
#[derive(Debug)]
pub struct ModelPolycube {
    /// The polycube.
    pub polycube: Polycube,
    /// The map from its boundary to the model's. Where it is the model itself that was deformed, it is linear over the triangles;
    /// else it goes through embeddings of both surfaces, and every point of the boundary has its point on the model's own surface.
    pub boundary: BoundaryMap,
}

impl ModelPolycube {
    /// The polycube of a model that was deformed itself, with the linear map over its triangles.
    ///
    /// # Errors
    ///
    /// None for a [`PolycubeMap`] as it is made.
    pub fn of_deformed(polycube: PolycubeMap) -> Result<Self, BoundaryMapError> {
        let [domain, image] = polycube.surfaces();
        Ok(Self {
            polycube: Polycube::Deformed(Box::new(polycube), None),
            boundary: BoundaryMap::between(domain, &image)?,
        })
    }
}

/// The polycube of a model, given as tetrahedra: a deformation or voxels ([`PolycubeKind`]).
///
/// The boundary map is one to one, decided exactly; [`make_polycube`] says what else is checked of deformations. How much the map onto
/// voxels distorts is measured, and not judged.
///
/// # Errors
///
/// Where no polycube is found, and where the model cannot be used.
pub fn make_model_polycube<R: ProgressResponse>(
    model: &TetMesh,
    options: &ModelPolycubeOptions,
    progress: &dyn Fn(ModelPolycubePhase) -> R,
) -> Result<ModelPolycube, ModelPolycubeError> {
    let progress = |phase| progress(phase).control();
    let model = Model::new(model);
    let lattice = options.deformation.lattice.unwrap_or(CellSize::Along(CELLS_ALONG));
    let by_voxels = || voxels::coarser_until_mapped(&model, lattice, &progress);
    let may_be_voxels = match options.kind {
        PolycubeKind::Auto => model.has_pairs(),
        PolycubeKind::Deformed => false,
        PolycubeKind::Voxels => return by_voxels(),
    };
    let deformation = match may_be_voxels && model.has_few_handles() {
        true => with_few_attempts(&options.deformation),
        false => options.deformation,
    };
    match deformed(&model, options.most_vertices, &deformation, &progress) {
        Err(deformed) if may_be_voxels && deformed.may_be_voxels() => by_voxels().map_err(|voxels| {
            if voxels.is_cancelled() {
                return voxels;
            }
            let [deformed, voxels] = [deformed, voxels].map(Box::new);
            ModelPolycubeError::Neither { deformed, voxels }
        }),
        made => made,
    }
}

/// A model with its surface.
pub(crate) struct Model<'a> {
    tets: &'a TetMesh,
    surface: SurfaceMesh,
    genus: Result<u64, SphericalError>,
    /// Whether it has feature curves, as CAD parts have: edges of [`FEATURE_ANGLE`] and more that are connected and end nowhere.
    has_features: bool,
}

impl<'a> Model<'a> {
    pub(crate) fn new(tets: &'a TetMesh) -> Self {
        let surface = tets.boundary().surface;
        let least_length = LEAST_FEATURES * surface.area().sqrt();
        let sharp = creases(&surface, FEATURE_ANGLE.to_radians().cos());
        Self {
            tets,
            genus: genus(&surface),
            has_features: !feature_curves(&surface, &sharp, least_length).is_empty(),
            surface,
        }
    }

    /// Whether the boundaries of other solids are mapped to this one ([`map_pair`](crate::boundary_map::pair::map_pair)).
    pub(crate) fn has_pairs(&self) -> bool {
        self.genus.is_ok()
    }

    /// Whether it has so few handles that voxels are tried after few attempts at a deformation.
    pub(crate) fn has_few_handles(&self) -> bool {
        self.genus.as_ref().is_ok_and(|genus| *genus <= HANDLES_OF_FEW_ATTEMPTS)
    }

    /// Whether it has so many vertices that a simplified model is deformed in its place.
    fn is_large(&self, most_vertices: usize) -> bool {
        let most = most_vertices as f64;
        let is_simplified_well = self.genus == Ok(0) && !self.has_features;
        let most = if is_simplified_well { most } else { ROOM * most };
        self.surface.vertices().len() as f64 > most
    }
}

/// Options of a deformation where voxels are left as well.
pub(crate) fn with_few_attempts(options: &PolycubeOptions) -> PolycubeOptions {
    PolycubeOptions {
        attempts: options.attempts.min(ATTEMPTS_BEFORE_VOXELS),
        effort: options.effort.min(EFFORT_BEFORE_VOXELS),
        ..*options
    }
}

/// By a deformation of the model, or of a simplified one.
pub(crate) fn deformed(
    model: &Model,
    most_vertices: usize,
    options: &PolycubeOptions,
    progress: &dyn Fn(ModelPolycubePhase) -> ProgressControl,
) -> Result<ModelPolycube, ModelPolycubeError> {
    let deforming = |phase| progress(ModelPolycubePhase::Deforming(phase));
    if model.has_pairs()
        && model.is_large(most_vertices)
        && let Some(simplified) = simplified::simplified(model, most_vertices, progress)?
    {
        let polycube = make_polycube(&simplified, options, &deforming)?;
        let [domain, image] = polycube.surfaces();
        match simplified::onto_model(domain, &image, &model.surface, progress) {
            Ok((boundary, report)) => {
                return Ok(ModelPolycube {
                    polycube: Polycube::Deformed(Box::new(polycube), Some(Box::new(report))),
                    boundary,
                });
            }
            // With many handles closest points may not say which goes where: then the model is deformed as it is.
            Err(ModelPolycubeError::Pair(PairError::NoClass { .. })) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(ModelPolycube::of_deformed(make_polycube(
        model.tets, options, &deforming,
    )?)?)
}

#[cfg(test)]
mod tests;
