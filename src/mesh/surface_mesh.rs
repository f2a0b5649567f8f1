use crate::{Point, Vector};

/// Why arrays do not make a mesh.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A face or tetrahedron refers to a vertex that is not there.
    #[error("{element} {index} refers to vertex {vertex}, but there are only {vertices} vertices (0-based)")]
    IndexOutOfRange {
        /// `"triangle"`, `"tetrahedron"` or `"hexahedron"`.
        element: &'static str,
        /// Which element, 0-based.
        index: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// More elements than 32-bit (signed, as TetGen counts) indices can name.
    #[error(
        "the {element} count {count} exceeds {limit}, the most that 31-bit indices can name; split the mesh into parts",
        limit = i32::MAX
    )]
    TooLarge {
        /// `"vertex"`, `"triangle"`, `"tetrahedron"` or `"hexahedron"`.
        element: &'static str,
        /// How many there are.
        count: usize,
    },
    /// The number of regions is not that of the cells.
    #[error("{regions} regions are given for {cells} cells; give the region of every cell")]
    RegionCount {
        /// How many cells there are.
        cells: usize,
        /// How many regions are given.
        regions: usize,
    },
}

/// A triangle surface: the boundary of a solid when it is closed, counter-clockwise from outside.
///
/// The type guarantees only that indices are in range. Coordinates may be infinite or NaN and the surface open or
/// tangled: what is wrong with it is for [`crate::check`] to say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SurfaceMesh {
    vertices: Vec<Point>,
    triangles: Vec<[u32; 3]>,
}

impl SurfaceMesh {
    /// A mesh of these vertices (`n`) and triangles (`m`, 0-based, counter-clockwise from outside).
    ///
    /// # Errors
    ///
    /// [`MeshError::IndexOutOfRange`] for the first triangle that names a missing vertex, [`MeshError::TooLarge`]
    /// beyond 31-bit counts.
    pub fn new(vertices: Vec<Point>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        check_counts(vertices.len(), "triangle", &triangles)?;
        Ok(Self { vertices, triangles })
    }

    /// Vertex positions.
    pub fn vertices(&self) -> &[Point] {
        &self.vertices
    }

    /// Vertex indices of each triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The vertex and triangle arrays, without a copy.
    pub fn into_parts(self) -> (Vec<Point>, Vec<[u32; 3]>) {
        (self.vertices, self.triangles)
    }

    /// The same triangles over other vertex positions, such as their images. `None` when the count of positions is not
    /// that of the vertices.
    pub fn with_vertices(&self, vertices: Vec<Point>) -> Option<Self> {
        (vertices.len() == self.vertices.len()).then(|| Self {
            vertices,
            triangles: self.triangles.clone(),
        })
    }

    /// The same surface with every triangle reversed.
    pub fn reversed(&self) -> Self {
        Self {
            vertices: self.vertices.clone(),
            triangles: self.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        }
    }

    /// Positions of the three corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Point; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }

    /// Area times unit normal of a triangle; the normal points outward on an outward-oriented surface.
    #[inline]
    pub fn area_vector(&self, triangle: usize) -> Vector {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a)) / 2.0
    }

    /// Total area.
    pub fn area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| self.area_vector(t).norm()).sum()
    }

    /// A third of the area of the triangles at each vertex.
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.vertices().len()];
        for (index, corners) in self.triangles().iter().enumerate() {
            let third = self.area_vector(index).norm() / 3.0;
            corners.iter().for_each(|&v| areas[v as usize] += third);
        }
        areas
    }

    /// Enclosed volume by the divergence theorem: positive when the surface is closed and oriented outward; shells
    /// that bound cavities are oriented into the cavity and count negatively.
    pub fn volume(&self) -> f64 {
        // About the box centre: a solid far from the origin would lose its volume to cancellation.
        let Some((low, high)) = self.bounding_box() else {
            return 0.0;
        };
        let centre = nalgebra::center(&low, &high);
        let volume = |t: usize| {
            let [a, b, c] = self.corners(t).map(|p| p - centre);
            a.dot(&b.cross(&c)) / 6.0
        };
        (0..self.triangles.len()).map(volume).sum()
    }

    /// Lowest and highest corner of the axis-aligned box of the triangles: vertices that none of them uses do not
    /// count. `None` without triangles. NaN coordinates are passed over.
    pub fn bounding_box(&self) -> Option<(Point, Point)> {
        bounding_box(self.triangles.iter().flatten().map(|&v| &self.vertices[v as usize]))
    }

    /// Length of the diagonal of the bounding box, of which reported errors are fractions; 0 without triangles.
    pub fn diagonal(&self) -> f64 {
        self.bounding_box().map_or(0.0, |(low, high)| (high - low).norm())
    }
}

pub(crate) fn triangle_area([a, b, c]: &[Point; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

pub(super) fn bounding_box<'a>(mut points: impl Iterator<Item = &'a Point>) -> Option<(Point, Point)> {
    let first = points.next()?;
    Some(points.fold((*first, *first), |(low, high), p| {
        (
            Point::new(low.x.min(p.x), low.y.min(p.y), low.z.min(p.z)),
            Point::new(high.x.max(p.x), high.y.max(p.y), high.z.max(p.z)),
        )
    }))
}

pub(super) fn check_counts<const N: usize>(
    vertices: usize,
    element: &'static str,
    elements: &[[u32; N]],
) -> Result<(), MeshError> {
    for (element, count) in [("vertex", vertices), (element, elements.len())] {
        if count > i32::MAX as usize {
            return Err(MeshError::TooLarge { element, count });
        }
    }
    for (index, corners) in elements.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices) {
            return Err(MeshError::IndexOutOfRange {
                element,
                index,
                vertex,
                vertices,
            });
        }
    }
    Ok(())
}
