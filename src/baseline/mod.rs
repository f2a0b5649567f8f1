//! Maps by other methods, behind the same trait as the harmonic map, to compare it with.
//!
//! [`TetHarmonic`] and [`TetLaplacian`] minimise the same discrete harmonic energy on a tetrahedral mesh, whose edge
//! weights are those of [`TetStiffness`]: the one by a sparse factorisation that is kept for further boundary maps, or by
//! preconditioned conjugate gradients; the other by descent from an initial map, as Wang, Gu, Thompson and Yau do. Both
//! give a [`TetMap`], linear over each tetrahedron. [`MeanValueMap`] interpolates the boundary by mean value coordinates,
//! which need no tetrahedra and are not harmonic.

mod boundary;
mod conjugate_gradients;
mod dirichlet;
mod mean_value;
pub mod stiffness;
pub mod tet_harmonic;
pub mod tet_laplacian;
mod tet_map;

pub use boundary::{BoundaryImages, boundary_images, boundary_vertices};
pub use mean_value::{MeanValueError, MeanValueMap};
pub use stiffness::TetStiffness;
pub use tet_harmonic::{HarmonicOptions, HarmonicSolver, TetHarmonic};
pub use tet_laplacian::{Descended, DescentDirection, DescentOptions, DescentStop, TetLaplacian};
pub use tet_map::TetMap;

use crate::Point;
use crate::geometry::QueryError;

/// Why a map by one of these methods cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BaselineError {
    /// There is nothing to map.
    #[error("the mesh has no tetrahedra; tetrahedralise the domain first")]
    NoTets,
    /// A corner of a tetrahedron is NaN or infinite.
    #[error("vertex {vertex} of the tetrahedral mesh is not finite: {position}; mesh the domain again")]
    NonFiniteVertex {
        /// The vertex.
        vertex: u32,
        /// Its position.
        position: Point,
    },
    /// An image is NaN or infinite.
    #[error("image {index} is not finite: {position}; give finite boundary data")]
    NonFiniteImage {
        /// The first such image, in the order given.
        index: usize,
        /// The image.
        position: Point,
    },
    /// The number of images is not that of the vertices that need one.
    #[error("{found} images were given for {expected} vertices; give one for each, in their order")]
    ImageCount {
        /// Vertices that need an image.
        expected: usize,
        /// Images given.
        found: usize,
    },
    /// A tetrahedron without volume has no gradient.
    #[error(
        "tetrahedron {tet} (vertices {vertices:?}) is flat: its volume is {volume:e}; mesh the domain again with a \
         bound on the quality, or remove slivers"
    )]
    FlatTet {
        /// The first such tetrahedron.
        tet: usize,
        /// Its vertices.
        vertices: [u32; 4],
        /// Its volume.
        volume: f64,
    },
    /// All tetrahedra are flat.
    #[error("all {tets} tetrahedra are flat; there is no solid to map")]
    NoVolume {
        /// How many there are.
        tets: usize,
    },
    /// Part of the mesh has no boundary, so that its images are undetermined.
    #[error(
        "the part of the mesh around vertex {vertex} has no boundary; some of its tetrahedra may be listed twice: \
         remove the copies"
    )]
    NoBoundary {
        /// The first vertex of such a part.
        vertex: u32,
    },
    /// Rounding errors outweigh the smallest tetrahedra.
    #[error(
        "the matrix of the harmonic energy is not positive definite to rounding; some tetrahedra are too flat: mesh the \
         domain again with a bound on the quality"
    )]
    NotPositiveDefinite,
    /// The factorisation does not fit into memory.
    #[error("the factorisation of {unknowns} unknowns does not fit into memory; use the iterative solver")]
    OutOfMemory {
        /// Vertices off the boundary.
        unknowns: usize,
    },
    /// The iterative solver gave up.
    #[error(
        "the residual is {residual:.1e} of the data after {iterations} iterations, above the tolerance of \
         {tolerance:.1e}; use the direct solver, or a mesh without slivers"
    )]
    NotConverged {
        /// Norm of the residual over that of the data.
        residual: f64,
        /// The largest allowed.
        tolerance: f64,
        /// Iterations made.
        iterations: usize,
    },
    /// A tolerance or threshold is out of range.
    #[error("the {option} is {found}, but must be at least 0 and below 1")]
    Option {
        /// Which one.
        option: &'static str,
        /// Its value.
        found: f64,
    },
    /// Closest points on the boundary map's domain cannot be queried.
    #[error("the domain of the boundary map cannot be used: {0}")]
    Domain(#[from] QueryError),
}

/// Refuses images that are not finite, or not as many as expected.
fn check_images(images: &[Point], expected: usize) -> Result<(), BaselineError> {
    if images.len() != expected {
        let found = images.len();
        return Err(BaselineError::ImageCount { expected, found });
    }
    match images.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        Some(index) => Err(BaselineError::NonFiniteImage {
            index,
            position: images[index],
        }),
        None => Ok(()),
    }
}

fn check_fraction(option: &'static str, found: f64) -> Result<(), BaselineError> {
    if (0.0..1.0).contains(&found) {
        Ok(())
    } else {
        Err(BaselineError::Option { option, found })
    }
}

#[cfg(test)]
pub(crate) mod test_meshes;
