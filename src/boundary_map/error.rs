//! Why vertex positions are not a boundary map, and the checks for it.

use crate::Point;
use crate::mesh::SurfaceMesh;

/// Why a domain and an image do not make a boundary map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundaryMapError {
    /// The embeddings are in different hyperbolic surfaces.
    #[error("the embeddings of the domain and the target are in different hyperbolic surfaces: their relators differ")]
    OtherRelator,
    /// The image must have one position per vertex of the domain.
    #[error(
        "the domain has {domain} vertices and the image {image}; the image must be the domain's mesh with other vertex \
         positions (STL files lose the vertex order: use OBJ or PLY)"
    )]
    VertexCount {
        /// Vertices of the domain.
        domain: usize,
        /// Vertices of the image.
        image: usize,
    },
    /// The image's mesh has a different number of triangles or cells, or another kind of cells.
    #[error(
        "the domain has {domain} {element}s and the image {image}; the image must be the domain's mesh with other \
         vertex positions"
    )]
    FaceCount {
        /// `"triangle"`, `"tetrahedron"` or `"hexahedron"`.
        element: &'static str,
        /// Elements of the domain.
        domain: usize,
        /// Elements of the image.
        image: usize,
    },
    /// The image's mesh connects other vertices.
    #[error(
        "{element} {index} joins vertices {domain:?} in the domain but {image:?} in the image; the image must be the \
         domain's mesh with other vertex positions, in the same order"
    )]
    Connectivity {
        /// `"triangle"`, `"tetrahedron"` or `"hexahedron"`.
        element: &'static str,
        /// The first that differs, 0-based.
        index: usize,
        /// Its vertices in the domain.
        domain: Vec<u32>,
        /// Its vertices in the image.
        image: Vec<u32>,
    },
    /// The images of nodes are not those of the boundary's nodes.
    #[error("node {node} {problem}; give the image of every boundary node once, with nodes counted from 0")]
    NodeImages {
        /// The first node at fault.
        node: u32,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// An image position is NaN or infinite.
    #[error("the image of vertex {vertex} is not finite: ({}, {}, {})", position[0], position[1], position[2])]
    NonFinite {
        /// The first such vertex.
        vertex: usize,
        /// Its image.
        position: [f64; 3],
    },
    /// Squares of lengths would over- or underflow.
    #[error("the {solid} has a size of {diagonal:e}; scale it to between 1e-100 and 1e100")]
    OutOfScale {
        /// `"domain"` or `"target"`.
        solid: &'static str,
        /// Diagonal of its bounding box.
        diagonal: f64,
    },
    /// Vertices or triangles are not those of the domain.
    #[error("the boundary map belongs to another domain: {difference}")]
    OtherDomain {
        /// The first difference.
        difference: String,
    },
    /// Maps of shells are not those of these solids.
    #[error("the maps of shells do not belong to these solids: {problem}")]
    Shells {
        /// What is wrong.
        problem: String,
    },
    /// All image positions coincide, so that errors cannot be related to the target's size.
    #[error("all {vertices} image positions coincide; there is no target solid")]
    NoExtent {
        /// Number of positions.
        vertices: usize,
    },
}

/// Diagonal of the bounding box of the triangles at these positions, for coordinates of any size.
pub(super) fn extent(surface: &SurfaceMesh, positions: &[Point]) -> f64 {
    let used = || surface.triangles().iter().flatten().map(|&v| positions[v as usize]);
    let sides = (0..3).map(|k| {
        let along = used().map(|p| p[k]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    });
    sides.fold(0.0, |diagonal: f64, side| diagonal.hypot(side.max(0.0)))
}

/// # Errors
///
/// [`BoundaryMapError::VertexCount`] unless every vertex of the domain has one image.
pub(super) fn require_same_count(domain: &[Point], image: &[Point]) -> Result<(), BoundaryMapError> {
    let (domain, image) = (domain.len(), image.len());
    if domain == image {
        Ok(())
    } else {
        Err(BoundaryMapError::VertexCount { domain, image })
    }
}

/// # Errors
///
/// [`BoundaryMapError::NonFinite`] for the first such vertex.
pub(super) fn require_finite(image: &[Point]) -> Result<(), BoundaryMapError> {
    match image.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        None => Ok(()),
        Some(vertex) => Err(BoundaryMapError::NonFinite {
            vertex,
            position: image[vertex].coords.into(),
        }),
    }
}

/// # Errors
///
/// When the target has no extent, or one of the two is out of scale.
pub(super) fn require_extent(domain: &SurfaceMesh, image: &[Point], target: f64) -> Result<(), BoundaryMapError> {
    if target == 0.0 {
        return Err(BoundaryMapError::NoExtent { vertices: image.len() });
    }
    let finite_domain = domain.vertices().iter().flat_map(|p| p.iter()).all(|c| c.is_finite());
    let domain = extent(domain, domain.vertices());
    for (solid, diagonal, looked_at) in [("domain", domain, finite_domain), ("target", target, true)] {
        // A domain without extent, or not finite, is left to `check`, which reports it in more detail.
        if looked_at && (diagonal > 1e100 || (diagonal > 0.0 && diagonal < 1e-100)) {
            return Err(BoundaryMapError::OutOfScale { solid, diagonal });
        }
    }
    Ok(())
}

/// Compares connectivity up to the order of corners within an element.
///
/// # Errors
///
/// [`BoundaryMapError::FaceCount`], or [`BoundaryMapError::Connectivity`] for the first element that differs.
pub(super) fn require_same_elements<const N: usize>(
    element: &'static str,
    domain: &[[u32; N]],
    image: &[[u32; N]],
) -> Result<(), BoundaryMapError> {
    if domain.len() != image.len() {
        return Err(BoundaryMapError::FaceCount {
            element,
            domain: domain.len(),
            image: image.len(),
        });
    }
    let sorted = |mut corners: [u32; N]| {
        corners.sort_unstable();
        corners
    };
    match (0..domain.len()).find(|&i| domain[i] != image[i] && sorted(domain[i]) != sorted(image[i])) {
        None => Ok(()),
        Some(index) => Err(BoundaryMapError::Connectivity {
            element,
            index,
            domain: domain[index].to_vec(),
            image: image[index].to_vec(),
        }),
    }
}
