//! Directions of triangles: of the polycube's, and of the model's by the faces that they go to.

use std::collections::HashMap;

use super::{ModelPolycube, Polycube};
use crate::mesh::{SurfaceMesh, SurfacePoint, TetMesh};

impl ModelPolycube {
    /// The direction that each triangle of the polycube's boundary faces along: 0 to 5 for -x, +x, -y, +y, -z, +z.
    pub fn labels(&self) -> Vec<u8> {
        directions(self.boundary.domain())
    }

    /// The directions of triangles of the model, by their nodes in `model`, the mesh that the polycube was made of: of all parts of each
    /// where the model itself was deformed
    /// ([`PolycubeMap::given_labels_of`](crate::polycube::PolycubeMap::given_labels_of)), else of the face of the polycube that its middle
    /// is mapped to. `None` where a triangle is none of the boundary.
    pub fn labels_of(&self, model: &TetMesh, triangles: &[[u32; 3]]) -> Option<Vec<u8>> {
        if let Polycube::Deformed(polycube, None) = &self.polycube {
            return Some(polycube.given_labels_of(triangles));
        }
        let boundary = model.boundary();
        let node = |v: u32| boundary.vertex_ids[v as usize];
        let labels = self.labels_of_middles()?;
        let of_surface = boundary.surface.triangles().iter().zip(labels);
        let by_corners: HashMap<[u32; 3], u8> = of_surface.map(|(t, label)| (sorted(t.map(node)), label)).collect();
        triangles.iter().map(|t| by_corners.get(&sorted(*t)).copied()).collect()
    }

    /// Of each triangle of the model's surface, by the face of the polycube that its middle is mapped to.
    fn labels_of_middles(&self) -> Option<Vec<u8>> {
        let count = self.boundary.target_surface()?.triangles().len();
        let middle = |triangle: usize| SurfacePoint {
            triangle: triangle as u32,
            barycentric: [1.0 / 3.0; 3],
        };
        let middles: Vec<SurfacePoint> = (0..count).map(middle).collect();
        let found = self.boundary.inverse()?.evaluate_on_target(&middles)?;
        let labels = self.labels();
        found
            .iter()
            .map(|point| labels.get(point.triangle as usize).copied())
            .collect()
    }
}

fn sorted(mut corners: [u32; 3]) -> [u32; 3] {
    corners.sort_unstable();
    corners
}

/// Triangles of a polycube lie across an axis: that of the largest component of the normal.
fn directions(surface: &SurfaceMesh) -> Vec<u8> {
    let vertices = surface.vertices();
    let is_outward = surface.volume() >= 0.0;
    let direction = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        let normal = (b - a).cross(&(c - a));
        let axis = normal.iamax();
        let is_positive = (normal[axis] > 0.0) == is_outward;
        2 * axis as u8 + u8::from(is_positive)
    };
    surface.triangles().iter().map(direction).collect()
}
