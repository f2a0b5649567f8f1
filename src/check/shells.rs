//! The shells of a solid one by one: its components, and the cavities inside them.

use super::anatomy::{Anatomy, Shell, triangles_by_component};
use super::repair::oriented;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::NONE;

/// A component of a surface, as a surface of its own that faces outward.
#[derive(Debug, Clone)]
pub(crate) struct ShellSurface {
    /// Vertices and triangles keep their order. Those of a cavity are reversed: `[a, b, c]` becomes `[a, c, b]`.
    pub surface: SurfaceMesh,
    /// For each vertex its index in the whole surface, ascending.
    pub vertices: Vec<u32>,
    /// For each triangle its index in the whole surface, ascending.
    pub triangles: Vec<u32>,
    /// Whether it bounds a cavity of a solid.
    pub is_cavity: bool,
    /// The innermost shell that encloses it.
    pub inside: Option<usize>,
}

/// Why a surface has no shells that could be told apart.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShellsError {
    /// A triangle has no area because of its corners.
    #[error("triangle {triangle} names a vertex twice")]
    RepeatedVertex {
        /// The first such triangle.
        triangle: usize,
    },
    /// A vertex whose triangles form more than one fan.
    #[error("vertex {vertex} belongs to several components, or its component touches itself there")]
    SharedVertex {
        /// The first such vertex.
        vertex: u32,
    },
    /// A component has no inside: it is open, not manifold, not orientable, or flat.
    #[error("component {component} encloses no volume")]
    NoVolume {
        /// As [`CheckReport::components`](super::CheckReport::components) counts them.
        component: usize,
    },
    /// Two components are partly inside each other, as up to 32 vertices of each tell.
    #[error("components {} and {} are partly inside each other", components[0], components[1])]
    Overlap {
        /// As [`CheckReport::components`](super::CheckReport::components) counts them.
        components: [usize; 2],
    },
    /// There are too many components to find out which lie inside which.
    #[error("it has {components} components, too many to find out which lie inside which")]
    Crowd {
        /// How many.
        components: usize,
    },
}

/// The shells of a closed manifold surface in the order of their first triangles, and the surface with solids facing outward and
/// cavities inward ([`super::repair()`]).
pub(crate) fn shells_of(mesh: &SurfaceMesh) -> Result<(SurfaceMesh, Vec<ShellSurface>), ShellsError> {
    let anatomy = Anatomy::of(mesh);
    if let Some(components) = anatomy.crowd {
        return Err(ShellsError::Crowd { components });
    }
    if let Some(triangle) = anatomy.components.of_triangle.iter().position(|&c| c == NONE) {
        return Err(ShellsError::RepeatedVertex { triangle });
    }
    if let Some(&vertex) = anatomy.topology.non_manifold_vertices().first() {
        return Err(ShellsError::SharedVertex { vertex });
    }
    if let Some(component) = anatomy.shells.iter().position(|shell| !shell.has_volume()) {
        return Err(ShellsError::NoVolume { component });
    }
    if let Some(&components) = anatomy.overlaps.first() {
        return Err(ShellsError::Overlap { components });
    }
    let whole = oriented(&anatomy);
    let triangles = triangles_by_component(&anatomy.components);
    let shells = anatomy.shells.iter().zip(triangles);
    let shells = shells
        .map(|(shell, triangles)| extracted(&whole, shell, triangles))
        .collect();
    Ok((whole, shells))
}

fn extracted(whole: &SurfaceMesh, shell: &Shell, triangles: Vec<u32>) -> ShellSurface {
    let corners = || triangles.iter().map(|&t| whole.triangles()[t as usize]);
    let mut vertices: Vec<u32> = corners().flatten().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let own = |v: u32| vertices.partition_point(|&w| w < v) as u32;
    let outward = |t: [u32; 3]| {
        let [a, b, c] = t.map(own);
        if shell.is_cavity() { [a, c, b] } else { [a, b, c] }
    };
    let positions = vertices.iter().map(|&v| whole.vertices()[v as usize]).collect();
    let surface = SurfaceMesh::new(positions, corners().map(outward).collect());
    ShellSurface {
        surface: surface.expect("corners are among the vertices"),
        vertices,
        triangles,
        is_cavity: shell.is_cavity(),
        inside: shell.inside,
    }
}
