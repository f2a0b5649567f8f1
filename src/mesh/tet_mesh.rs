use std::collections::HashMap;

use super::cell_mesh::TET_FACES;
use super::surface_mesh::{MeshError, SurfaceMesh, bounding_box, check_counts};
use crate::Point;

/// A tetrahedral mesh. A tetrahedron `[a, b, c, d]` is right-handed when `det(b-a, c-a, d-a) > 0`; both orientations
/// are accepted and none is changed, because in a pair of meshes that describes a map the sign of a tetrahedron is
/// data.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TetMesh {
    vertices: Vec<Point>,
    tets: Vec<[u32; 4]>,
}

/// The surface of a [`TetMesh`].
#[derive(Debug, Clone, PartialEq)]
pub struct BoundarySurface {
    /// The boundary triangles over the boundary vertices only, oriented outward.
    pub surface: SurfaceMesh,
    /// For each vertex of `surface`, its index in the tetrahedral mesh; ascending.
    pub vertex_ids: Vec<u32>,
}

impl TetMesh {
    /// A mesh of these vertices (`n`) and tetrahedra (`m`, 0-based).
    ///
    /// # Errors
    ///
    /// As [`SurfaceMesh::new`].
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
        let [a, b, c, d] = self.corners(tet);
        (b - a).dot(&(c - a).cross(&(d - a))) / 6.0
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
        let (faces, are_consistent) = self.boundary_faces(|_| false);
        let faces = if !are_consistent {
            self.boundary_faces(|t| self.signed_volume(t) < 0.0).0
        } else if self.volume() >= 0.0 {
            faces
        } else {
            faces.into_iter().map(|[a, b, c]| [a, c, b]).collect()
        };

        let mut on_boundary = vec![false; self.vertices.len()];
        faces.iter().flatten().for_each(|&v| on_boundary[v as usize] = true);
        let vertex_ids: Vec<u32> = (0..self.vertices.len() as u32)
            .filter(|&v| on_boundary[v as usize])
            .collect();
        let mut compact = vec![u32::MAX; self.vertices.len()];
        for (new, &old) in vertex_ids.iter().enumerate() {
            compact[old as usize] = new as u32;
        }
        let vertices = vertex_ids.iter().map(|&v| self.vertices[v as usize]).collect();
        let triangles = faces.iter().map(|f| f.map(|v| compact[v as usize])).collect();
        let surface = SurfaceMesh::new(vertices, triangles).expect("boundary faces name boundary vertices");
        BoundarySurface { surface, vertex_ids }
    }

    /// Faces that belong to one tetrahedron only, in the order of the tetrahedra, and whether the two tetrahedra at
    /// every other face orient it in opposite ways.
    fn boundary_faces(&self, reversed: impl Fn(usize) -> bool) -> (Vec<[u32; 3]>, bool) {
        let faces = || (0..self.tets.len()).flat_map(|t| self.faces(t, reversed(t)));
        let mut seen: HashMap<[u32; 3], (bool, u32)> = HashMap::with_capacity(2 * self.tets.len());
        let mut are_consistent = true;
        for (key, even) in faces().map(sorted_with_parity) {
            let (first, count) = seen.entry(key).or_insert((even, 0));
            *count += 1;
            are_consistent &= *count != 2 || *first != even;
        }
        let is_boundary = |&face: &[u32; 3]| seen[&sorted_with_parity(face).0].1 == 1;
        (faces().filter(is_boundary).collect(), are_consistent)
    }

    fn faces(&self, tet: usize, reversed: bool) -> [[u32; 3]; 4] {
        let corners = self.tets[tet];
        TET_FACES.map(|face| {
            let [a, b, c] = face.map(|k| corners[k]);
            if reversed { [a, c, b] } else { [a, b, c] }
        })
    }
}

/// The sorted triple, and whether sorting took an even permutation.
fn sorted_with_parity([a, b, c]: [u32; 3]) -> ([u32; 3], bool) {
    let mut key = [a, b, c];
    key.sort_unstable();
    let even = key == [a, b, c] || key == [b, c, a] || key == [c, a, b];
    (key, even)
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
