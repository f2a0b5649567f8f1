//! A triangulated surface embedded on the unit sphere.

use super::{EmbeddingCheck, check_embedding};
use crate::Vector;
use crate::check::repair;
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// A bijection of a closed surface of genus 0 with the unit sphere: a direction per vertex, and within each triangle
/// the normalised linear interpolation of its corners' directions (the gnomonic map of its geodesic triangle), which is
/// continuous across edges.
#[derive(Debug, Clone, PartialEq)]
pub struct SphericalEmbedding {
    surface: SurfaceMesh,
    directions: Vec<Vector>,
}

/// Why a surface has no spherical embedding, or directions are not one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SphericalError {
    /// The progress callback asked to stop.
    #[error("cancelled by the progress callback")]
    Cancelled,
    /// The surface has a boundary.
    #[error(
        "the surface is open: {open_edges} edges have one triangle, the first joins vertices {} and {}; close the \
         holes first", first[0], first[1]
    )]
    Open {
        /// Number of edges with one triangle.
        open_edges: usize,
        /// The first of them.
        first: [u32; 2],
    },
    /// Three or more triangles share an edge, or fans share a vertex.
    #[error("the surface is not a manifold: {found}; see `solidmap check`")]
    NotManifold {
        /// What was found, and where.
        found: String,
    },
    /// The surface is not connected.
    #[error("the surface has {components} components, but must have exactly one; map them one by one")]
    Components {
        /// Number of components; 0 without triangles.
        components: usize,
    },
    /// The surface has handles.
    #[error("the surface has genus {genus} (handles), and only a surface of genus 0 maps to the sphere one to one")]
    Genus {
        /// Number of handles.
        genus: u64,
    },
    /// The surface has only one side.
    #[error(
        "the surface is not orientable, like a Moebius strip: its orientation is inconsistent at the edge between \
         vertices {} and {}", edge[0], edge[1]
    )]
    NotOrientable {
        /// An edge whose two triangles cannot be oriented alike.
        edge: [u32; 2],
    },
    /// All vertices coincide, or areas would over- or underflow.
    #[error("the surface has a size of {diagonal:e}; scale it to between 1e-60 and 1e60")]
    OutOfScale {
        /// Diagonal of the bounding box.
        diagonal: f64,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite")]
    NonFinite {
        /// The first such vertex.
        vertex: usize,
    },
    /// A vertex belongs to no triangle.
    #[error("{count} vertices belong to no triangle, the first is {first}; remove them")]
    Unreferenced {
        /// How many there are.
        count: usize,
        /// The first of them.
        first: u32,
    },
    /// There must be one direction per vertex.
    #[error("the surface has {vertices} vertices, and {directions} directions were given")]
    Count {
        /// Vertices of the surface.
        vertices: usize,
        /// Directions given.
        directions: usize,
    },
    /// Vertices come closer together on the sphere than the resolution of coordinates.
    #[error(
        "the surface cannot be embedded on the sphere: its vertices come too close together for the precision of \
         coordinates; use a coarser surface"
    )]
    TooFine,
    /// The optimisation needs more memory than there is.
    #[error("the optimisation of {vertices} vertices does not fit into memory; use a coarser surface")]
    OutOfMemory {
        /// Vertices of the surface.
        vertices: usize,
    },
    /// Triangles on the sphere are flipped, or cover it several times.
    #[error(
        "the map to the sphere is not one to one: {} of its triangles are flipped, and it covers the sphere {:.3} \
         times", .0.flipped, .0.degree
    )]
    NotBijective(EmbeddingCheck),
}

impl SphericalEmbedding {
    /// The map that sends vertex `v` to the direction `directions[v]`, normalised. A surface whose triangles face
    /// inward or are inconsistently oriented is turned outward first.
    ///
    /// # Errors
    ///
    /// As [`require_genus_0`], and when the map is not a bijection; decided exactly.
    pub fn new(surface: SurfaceMesh, directions: &[Vector]) -> Result<Self, SphericalError> {
        let surface = require_genus_0(&surface)?;
        let (vertices, given) = (surface.vertices().len(), directions.len());
        if vertices != given {
            return Err(SphericalError::Count {
                vertices,
                directions: given,
            });
        }
        let directions: Vec<Vector> = directions.iter().map(unit).collect();
        let check = check_embedding(surface.triangles(), &directions);
        if !check.is_bijective() {
            return Err(SphericalError::NotBijective(check));
        }
        Ok(Self { surface, directions })
    }

    /// The surface, its triangles facing outward.
    pub fn surface(&self) -> &SurfaceMesh {
        &self.surface
    }

    /// The unit vector of each vertex.
    pub fn directions(&self) -> &[Vector] {
        &self.directions
    }

    /// The image of a point of the surface: a unit vector.
    pub fn direction(&self, point: &SurfacePoint) -> Vector {
        let corners = self.surface.triangles()[point.triangle as usize];
        let [a, b, c] = corners.map(|v| self.directions[v as usize]);
        let [l, m, n] = point.barycentric;
        (l * a + m * b + n * c).normalize()
    }
}

/// The normalised vector. One that has length 1 up to rounding keeps its bits, so that directions stay the same when
/// they are written to a file and read again.
pub(super) fn unit(x: &Vector) -> Vector {
    if (x.norm_squared() - 1.0).abs() <= 8.0 * f64::EPSILON {
        *x
    } else {
        x.normalize()
    }
}

/// The surface with its triangles facing outward.
///
/// # Errors
///
/// Unless it is one closed, orientable manifold of genus 0 with finite vertices, all of them used. It may intersect
/// itself.
pub fn require_genus_0(surface: &SurfaceMesh) -> Result<SurfaceMesh, SphericalError> {
    require_genus(surface, 0)
}

/// As [`require_genus_0`], with another number of handles.
pub(crate) fn require_genus(surface: &SurfaceMesh, wanted: u64) -> Result<SurfaceMesh, SphericalError> {
    if let Some(vertex) = surface.vertices().iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        return Err(SphericalError::NonFinite { vertex });
    }
    let topology = Topology::new(surface);
    let open = topology.open_edges();
    if let Some(&first) = open.first() {
        return Err(SphericalError::Open {
            open_edges: open.len(),
            first,
        });
    }
    require_manifold(surface, &topology)?;
    let components = topology.components().shapes;
    let [shape] = components[..] else {
        return Err(SphericalError::Components {
            components: components.len(),
        });
    };
    if let Some(&edge) = topology.orientation().twisted_edges.first() {
        return Err(SphericalError::NotOrientable {
            edge: topology.edges()[edge as usize],
        });
    }
    match shape.genus() {
        Some(genus) if genus == wanted => {}
        Some(genus) => return Err(SphericalError::Genus { genus }),
        None => {
            let found = format!("its Euler characteristic is {}", shape.euler_characteristic());
            return Err(SphericalError::NotManifold { found });
        }
    }
    let unreferenced = topology.unreferenced_vertices();
    if let Some(&first) = unreferenced.first() {
        return Err(SphericalError::Unreferenced {
            count: unreferenced.len(),
            first,
        });
    }
    if surface.vertices().len() < 4 {
        let found = "it has only three vertices and encloses no volume".into();
        return Err(SphericalError::NotManifold { found });
    }
    Ok(repair(surface).0)
}

/// The number of handles of a surface.
///
/// # Errors
///
/// As [`require_genus_0`], but for handles.
pub(crate) fn genus(surface: &SurfaceMesh) -> Result<u64, SphericalError> {
    match require_genus_0(surface) {
        Ok(_) => Ok(0),
        Err(SphericalError::Genus { genus }) => Ok(genus),
        Err(error) => Err(error),
    }
}

/// # Errors
///
/// [`SphericalError::OutOfScale`] when squares of areas could over- or underflow.
pub(crate) fn require_scale(surface: &SurfaceMesh) -> Result<(), SphericalError> {
    let diagonal = surface.diagonal();
    if (1e-60..=1e60).contains(&diagonal) {
        Ok(())
    } else {
        Err(SphericalError::OutOfScale { diagonal })
    }
}

fn require_manifold(surface: &SurfaceMesh, topology: &Topology) -> Result<(), SphericalError> {
    let found = |found: String| Err(SphericalError::NotManifold { found });
    let repeated = (0..surface.triangles().len()).find(|&t| topology.edges_of_triangle(t).is_none());
    if let Some(triangle) = repeated {
        return found(format!("triangle {triangle} has the same vertex twice"));
    }
    let edges = topology.non_manifold_edges();
    if let Some([a, b]) = edges.first() {
        return found(match edges.len() {
            1 => format!("the edge between vertices {a} and {b} has more than two triangles"),
            count => format!("{count} edges have more than two triangles, the first joins vertices {a} and {b}"),
        });
    }
    let vertices = topology.non_manifold_vertices();
    if let Some(v) = vertices.first() {
        return found(match vertices.len() {
            1 => format!("it touches itself at vertex {v}"),
            count => format!("it touches itself at {count} vertices, the first is {v}"),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;
    use crate::mesh::shapes;

    fn directions(mesh: &SurfaceMesh) -> Vec<Vector> {
        mesh.vertices().iter().map(|p| p.coords).collect()
    }

    #[test]
    fn directions_of_length_1_keep_their_bits() {
        let sphere = shapes::sphere(3.0, 3);
        let map = SphericalEmbedding::new(sphere.clone(), &directions(&sphere)).unwrap();
        let again = SphericalEmbedding::new(sphere, map.directions()).unwrap();
        assert_eq!(map, again);
    }

    #[test]
    fn refuses_surfaces_that_are_not_closed_manifolds_of_genus_0() {
        let sphere = shapes::sphere(1.0, 1);
        let open = SurfaceMesh::new(sphere.vertices().to_vec(), sphere.triangles()[1..].to_vec()).unwrap();
        assert!(matches!(
            require_genus_0(&open),
            Err(SphericalError::Open { open_edges: 3, .. })
        ));
        let torus = shapes::torus(1.0, 0.3, 12, 6);
        assert_eq!(require_genus_0(&torus), Err(SphericalError::Genus { genus: 1 }));
        let two = shapes::joined(&sphere, &shapes::deformed(&sphere, |p| p + Vector::new(3.0, 0.0, 0.0)));
        assert_eq!(require_genus_0(&two), Err(SphericalError::Components { components: 2 }));
        let none = SurfaceMesh::new(vec![], vec![]).unwrap();
        assert_eq!(
            require_genus_0(&none),
            Err(SphericalError::Components { components: 0 })
        );
        let mut vertices = sphere.vertices().to_vec();
        vertices.push(Point::origin());
        let loose = SurfaceMesh::new(vertices, sphere.triangles().to_vec()).unwrap();
        assert!(matches!(
            require_genus_0(&loose),
            Err(SphericalError::Unreferenced { count: 1, first: 42 })
        ));
        let doubled = SurfaceMesh::new(sphere.vertices()[..3].to_vec(), vec![[0, 1, 2], [0, 2, 1]]).unwrap();
        assert!(matches!(
            require_genus_0(&doubled),
            Err(SphericalError::NotManifold { .. })
        ));
        let bad = shapes::deformed(
            &sphere,
            |p| if p.x > 0.99 { Point::new(f64::NAN, 0.0, 0.0) } else { *p },
        );
        assert!(matches!(require_genus_0(&bad), Err(SphericalError::NonFinite { .. })));
    }

    #[test]
    fn turns_an_inward_surface_outward_and_refuses_a_reflection() {
        let sphere = shapes::sphere(2.0, 2);
        let map = SphericalEmbedding::new(sphere.reversed(), &directions(&sphere)).unwrap();
        assert!(map.surface().volume() > 0.0);
        let mirrored: Vec<Vector> = directions(&sphere).iter().map(|x| -x).collect();
        assert!(matches!(
            SphericalEmbedding::new(sphere, &mirrored),
            Err(SphericalError::NotBijective(_))
        ));
    }

    #[test]
    fn directions_of_surface_points_are_between_those_of_the_corners() {
        let sphere = shapes::sphere(2.0, 1);
        let map = SphericalEmbedding::new(sphere.clone(), &directions(&sphere)).unwrap();
        let point = SurfacePoint {
            triangle: 7,
            barycentric: [0.2, 0.3, 0.5],
        };
        let expected = point.position(&sphere, sphere.vertices()).coords.normalize();
        assert!((map.direction(&point) - expected).norm() < 1e-15);
    }
}
