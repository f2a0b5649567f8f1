use super::boundary_surface::{BoundarySurface, boundary_surface};
use super::cell_faces::CellSlice;
use super::cell_mesh::tet_volume;
use super::surface_mesh::{MeshError, bounding_box, check_counts};
use crate::Point;

/// A tetrahedral mesh. A tetrahedron `[a, b, c, d]` is right-handed when `det(b-a, c-a, d-a) > 0`; both orientations
/// are accepted and none is changed, because in a pair of meshes that describes a map the sign of a tetrahedron is
/// data.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TetMesh {
    vertices: Vec<Point>,
    tets: Vec<[u32; 4]>,
}

impl TetMesh {
    /// A mesh of these vertices (`n`) and tetrahedra (`m`, 0-based).
    ///
    /// # Errors
    ///
    /// As [`super::SurfaceMesh::new`].
    pub fn new(vertices: Vec<Point>, tets: Vec<[u32; 4]>) -> Result<Self, MeshError> {
        check_counts(vertices.len(), "tetrahedron", &tets)?;
        Ok(Self { vertices, tets })
    }

    /// Vertex positions.
    pub fn vertices(&self) -> &[Point] {
        &self.vertices
    }

    /// Vertex indices of each tetrahedron.
    pub fn tets(&self) -> &[[u32; 4]] {
        &self.tets
    }

    /// The same tetrahedra over other vertex positions, such as their images. `None` when the count differs.
    pub fn with_vertices(&self, vertices: Vec<Point>) -> Option<Self> {
        (vertices.len() == self.vertices.len()).then(|| Self {
            vertices,
            tets: self.tets.clone(),
        })
    }

    /// Positions of the four corners of a tetrahedron.
    pub fn corners(&self, tet: usize) -> [Point; 4] {
        self.tets[tet].map(|v| self.vertices[v as usize])
    }

    /// Volume of a tetrahedron, positive when it is right-handed.
    pub fn signed_volume(&self, tet: usize) -> f64 {
        tet_volume(&self.corners(tet))
    }

    /// Sum of the signed volumes.
    pub fn volume(&self) -> f64 {
        (0..self.tets.len()).map(|t| self.signed_volume(t)).sum()
    }

    /// The vertices and the tetrahedra.
    pub fn into_parts(self) -> (Vec<Point>, Vec<[u32; 4]>) {
        (self.vertices, self.tets)
    }

    /// Lowest and highest corner of the axis-aligned box of all vertices; `None` without vertices.
    pub fn bounding_box(&self) -> Option<(Point, Point)> {
        bounding_box(self.vertices.iter())
    }

    /// The triangles that belong to one tetrahedron only, oriented outward.
    ///
    /// Outward is decided for the mesh as a whole by the sign of its volume, so that a few inverted tetrahedra do not
    /// punch holes. Only in a mesh where neighbours are oriented inconsistently does each tetrahedron's own sign
    /// decide.
    pub fn boundary(&self) -> BoundarySurface {
        boundary_surface(&self.vertices, CellSlice::Tets(&self.tets), |t| self.signed_volume(t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_tets(second: [u32; 4]) -> TetMesh {
        let p = |x, y, z| Point::new(x, y, z);
        let vertices = vec![
            p(9., 9., 9.),
            p(0., 0., 0.),
            p(1., 0., 0.),
            p(0., 1., 0.),
            p(0., 0., 1.),
            p(1., 1., 1.),
        ];
        TetMesh::new(vertices, vec![[1, 2, 3, 4], second]).unwrap()
    }

    #[test]
    fn boundary_is_closed_outward_and_names_its_vertices() {
        let mesh = two_tets([2, 3, 4, 5]);
        let boundary = mesh.boundary();
        assert_eq!(boundary.vertex_ids, [1, 2, 3, 4, 5]);
        assert_eq!(boundary.surface.triangles().len(), 6);
        assert!((boundary.surface.volume() - mesh.volume()).abs() < 1e-15);
    }

    #[test]
    fn boundary_is_outward_for_left_handed_and_for_mixed_orientations() {
        let right = two_tets([2, 3, 4, 5]);
        let volume = right.volume();
        let left = TetMesh::new(
            right.vertices().to_vec(),
            right.tets().iter().map(|&[a, b, c, d]| [b, a, c, d]).collect(),
        )
        .unwrap();
        let mixed = two_tets([3, 2, 4, 5]);
        for mesh in [left, mixed] {
            assert!((mesh.boundary().surface.volume() - volume).abs() < 1e-15);
        }
    }
}
