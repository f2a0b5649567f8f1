//! The surface of a texture in triangles so small that colours at their corners show the picture.

use solidmap::mesh::{SurfaceMesh, SurfacePoint};
use solidmap::texture::{ColouredSurface, to_srgb};

use crate::drawing::Rgb;

/// A surface with the colours of its vertices.
pub struct PaintedSurface {
    pub mesh: SurfaceMesh,
    pub colours: Vec<Rgb>,
}

impl PaintedSurface {
    /// Cuts triangles into equal parts, so that there are about as many as asked for. Each triangle of the model has vertices
    /// of its own: colours may differ across seams.
    pub fn of(coloured: &ColouredSurface, triangles: usize) -> Self {
        let surface = coloured.surface();
        let own = surface.triangles().len().max(1);
        let parts = ((triangles as f64 / own as f64).sqrt() as usize).clamp(1, 256);
        let (mut vertices, mut corners, mut colours) = (vec![], vec![], vec![]);
        for t in 0..surface.triangles().len() {
            let first = vertices.len() as u32;
            // Row `i` of the subdivided triangle, counted from corner 0, has `i + 1` vertices.
            let place = |i: usize, j: usize| SurfacePoint {
                triangle: t as u32,
                barycentric: [parts - i, i - j, j].map(|n| n as f64 / parts as f64),
            };
            let places: Vec<SurfacePoint> = (0..=parts)
                .flat_map(|i| (0..=i).map(move |j| (i, j)))
                .map(|(i, j)| place(i, j))
                .collect();
            colours.extend(places.iter().map(|p| to_srgb(coloured.colour(p))));
            vertices.extend(places.iter().map(|p| p.position(surface, surface.vertices())));
            let at = |i: usize, j: usize| first + (i * (i + 1) / 2 + j) as u32;
            for i in 0..parts {
                for j in 0..=i {
                    corners.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                    if j < i {
                        corners.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                    }
                }
            }
        }
        Self {
            mesh: SurfaceMesh::new(vertices, corners).expect("corners are vertices"),
            colours,
        }
    }

    /// The colours of the corners of each triangle.
    pub fn by_corners(&self) -> Vec<[Rgb; 3]> {
        let corners = self.mesh.triangles().iter();
        corners.map(|t| t.map(|v| self.colours[v as usize])).collect()
    }
}
