//! A boundary map given by an image position for every vertex of the domain, straight in between.

use std::collections::HashMap;

use crate::Point;
use crate::mesh::{SurfaceMesh, SurfacePoint, TetMesh};

/// A boundary map `f'`: the image of every vertex of the domain's surface, linear over its triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryMap {
    domain: SurfaceMesh,
    image: Vec<Point>,
}

/// Why a domain and an image do not make a boundary map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundaryMapError {
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
    /// The image's mesh has another number of faces.
    #[error(
        "the domain has {domain} {element}s and the image {image}; the image must be the domain's mesh with other \
         vertex positions"
    )]
    FaceCount {
        /// `"triangle"` or `"tetrahedron"`.
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
        /// `"triangle"` or `"tetrahedron"`.
        element: &'static str,
        /// The first that differs, 0-based.
        index: usize,
        /// Its vertices in the domain.
        domain: Vec<u32>,
        /// Its vertices in the image.
        image: Vec<u32>,
    },
    /// An image position is NaN or infinite.
    #[error("the image of vertex {vertex} is not finite: ({}, {}, {})", position[0], position[1], position[2])]
    NonFinite {
        /// The first such vertex.
        vertex: usize,
        /// Its image.
        position: [f64; 3],
    },
    /// Squares of lengths would leave the range of numbers.
    #[error("the {solid} has a size of {diagonal:e}; scale it to between 1e-100 and 1e100")]
    OutOfScale {
        /// `"domain"` or `"target"`.
        solid: &'static str,
        /// Diagonal of its bounding box.
        diagonal: f64,
    },
    /// All image positions coincide, so that there is no target to measure errors by.
    #[error("all {vertices} image positions coincide; there is no target solid")]
    NoExtent {
        /// How many positions there are.
        vertices: usize,
    },
}

impl BoundaryMap {
    /// The map that sends vertex `v` of `domain` to `image[v]`.
    ///
    /// # Errors
    ///
    /// When the counts differ, or the image is not finite or has no extent.
    pub fn new(domain: SurfaceMesh, image: Vec<Point>) -> Result<Self, BoundaryMapError> {
        if domain.vertices().len() != image.len() {
            return Err(BoundaryMapError::VertexCount {
                domain: domain.vertices().len(),
                image: image.len(),
            });
        }
        if let Some(vertex) = image.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            return Err(BoundaryMapError::NonFinite {
                vertex,
                position: image[vertex].coords.into(),
            });
        }
        let map = Self { domain, image };
        let (domain, target) = (map.extent(map.domain.vertices()), map.extent(&map.image));
        if target == 0.0 {
            return Err(BoundaryMapError::NoExtent {
                vertices: map.image.len(),
            });
        }
        let finite_domain = map
            .domain
            .vertices()
            .iter()
            .flat_map(|p| p.iter())
            .all(|c| c.is_finite());
        for (solid, diagonal, looked_at) in [("domain", domain, finite_domain), ("target", target, true)] {
            // Without an extent, or not finite, the domain is defective, which is for the input doctor to say.
            if looked_at && (diagonal > 1e100 || (diagonal > 0.0 && diagonal < 1e-100)) {
                return Err(BoundaryMapError::OutOfScale { solid, diagonal });
            }
        }
        Ok(map)
    }

    /// The map from a mesh to one of the same connectivity.
    ///
    /// # Errors
    ///
    /// As [`BoundaryMap::new`], and when the meshes join different vertices. The corners of a triangle may be listed
    /// in any order: a reflecting map turns its image inside out, and that is no defect of the files.
    pub fn between(domain: SurfaceMesh, image: &SurfaceMesh) -> Result<Self, BoundaryMapError> {
        if domain.vertices().len() != image.vertices().len() {
            let (domain, image) = (domain.vertices().len(), image.vertices().len());
            return Err(BoundaryMapError::VertexCount { domain, image });
        }
        require_same_elements("triangle", domain.triangles(), image.triangles())?;
        Self::new(domain, image.vertices().to_vec())
    }

    /// The map between the boundaries of two tetrahedral meshes of the same connectivity. The boundary's vertices keep
    /// the order they have in the meshes.
    ///
    /// # Errors
    ///
    /// As [`BoundaryMap::between`].
    pub fn between_tets(domain: &TetMesh, image: &TetMesh) -> Result<Self, BoundaryMapError> {
        if domain.vertices().len() != image.vertices().len() {
            let (domain, image) = (domain.vertices().len(), image.vertices().len());
            return Err(BoundaryMapError::VertexCount { domain, image });
        }
        require_same_elements("tetrahedron", domain.tets(), image.tets())?;
        let boundary = domain.boundary();
        let images = boundary
            .vertex_ids
            .iter()
            .map(|&v| image.vertices()[v as usize])
            .collect();
        Self::new(boundary.surface, images)
    }

    /// The surface being mapped.
    pub fn domain(&self) -> &SurfaceMesh {
        &self.domain
    }

    /// The image of each vertex.
    pub fn image(&self) -> &[Point] {
        &self.image
    }

    /// The domain's triangles over the image positions: the boundary of the target.
    pub fn target(&self) -> SurfaceMesh {
        self.domain
            .with_vertices(self.image.clone())
            .expect("counts were compared when the map was made")
    }

    /// Diagonal of the target's bounding box, the unit of reported errors.
    pub fn target_diagonal(&self) -> f64 {
        self.extent(&self.image)
    }

    /// Diagonal of the bounding box of the triangles at these positions, without squares that over- or underflow.
    fn extent(&self, positions: &[Point]) -> f64 {
        let used = || self.domain.triangles().iter().flatten().map(|&v| positions[v as usize]);
        let sides = (0..3).map(|k| {
            let along = used().map(|p| p[k]);
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        });
        sides.fold(0.0, |diagonal: f64, side| diagonal.hypot(side.max(0.0)))
    }

    /// The same map over a domain whose triangles are each cut into four at the midpoints of their edges. The first vertices
    /// are the old ones.
    pub fn subdivided(&self) -> Self {
        let mut vertices = self.domain.vertices().to_vec();
        let mut image = self.image.clone();
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                for points in [&mut vertices, &mut image] {
                    let between = nalgebra::center(&points[a as usize], &points[b as usize]);
                    points.push(between);
                }
                vertices.len() as u32 - 1
            })
        };
        let mut triangles = Vec::with_capacity(4 * self.domain.triangles().len());
        for &[a, b, c] in self.domain.triangles() {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        let domain = SurfaceMesh::new(vertices, triangles).expect("corners are vertices");
        Self { domain, image }
    }

    /// Positions of surface points in the domain.
    pub fn positions(&self, points: &[SurfacePoint]) -> Vec<Point> {
        points
            .iter()
            .map(|p| p.position(&self.domain, self.domain.vertices()))
            .collect()
    }

    /// Images of surface points.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Point> {
        points.iter().map(|p| p.position(&self.domain, &self.image)).collect()
    }
}

/// Compares connectivity up to the order of corners within an element.
///
/// # Errors
///
/// [`BoundaryMapError::FaceCount`], or [`BoundaryMapError::Connectivity`] for the first element that differs.
fn require_same_elements<const N: usize>(
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn is_linear_over_triangles_and_exact_at_corners() {
        let domain = shapes::cube(2.0, 2);
        let stretched = shapes::deformed(&domain, |p| Point::new(3.0 * p.x, p.y - 1.0, p.z));
        let map = BoundaryMap::between(domain, &stretched).unwrap();
        let points = [
            SurfacePoint::corner(5, 2),
            SurfacePoint {
                triangle: 7,
                barycentric: [0.2, 0.3, 0.5],
            },
        ];
        for (x, y) in map.positions(&points).iter().zip(map.evaluate(&points)) {
            assert!((Point::new(3.0 * x.x, x.y - 1.0, x.z) - y).norm() < 1e-15);
        }
    }

    #[test]
    fn rejects_what_does_not_correspond() {
        let domain = shapes::cube(1.0, 2);
        let finer = shapes::cube(1.0, 3);
        assert!(matches!(
            BoundaryMap::between(domain.clone(), &finer),
            Err(BoundaryMapError::VertexCount { domain: 26, image: 56 })
        ));
        let mut triangles = domain.triangles().to_vec();
        triangles.swap(3, 4);
        let shuffled = SurfaceMesh::new(domain.vertices().to_vec(), triangles).unwrap();
        assert!(matches!(
            BoundaryMap::between(domain.clone(), &shuffled),
            Err(BoundaryMapError::Connectivity { index: 3, .. })
        ));
        let mut image = domain.vertices().to_vec();
        image[7].y = f64::NAN;
        assert!(matches!(
            BoundaryMap::new(domain.clone(), image),
            Err(BoundaryMapError::NonFinite { vertex: 7, .. })
        ));
        let point = vec![Point::origin(); 26];
        assert!(matches!(
            BoundaryMap::new(domain, point),
            Err(BoundaryMapError::NoExtent { vertices: 26 })
        ));
    }

    #[test]
    fn accepts_an_image_whose_faces_are_turned_over() {
        let domain = shapes::sphere(1.0, 1);
        assert!(BoundaryMap::between(domain.clone(), &domain.reversed()).is_ok());
    }
}
