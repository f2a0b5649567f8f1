//! The surface of a mesh of cells.

use super::cell_faces::{CellFace, CellSlice, faces, outer};
use super::surface_mesh::SurfaceMesh;
use crate::Point;

/// The surface of a mesh of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundarySurface {
    /// The boundary triangles over the boundary vertices only, oriented outward.
    pub surface: SurfaceMesh,
    /// For each vertex of `surface`, its index in the mesh of cells; ascending.
    pub vertex_ids: Vec<u32>,
}

/// The faces that belong to one cell only, in the order of the cells and oriented outward: by the sign of the whole
/// volume, or where neighbours are oriented inconsistently by each cell's own.
pub(super) fn boundary_surface<'a>(
    vertices: &[Point],
    cells: impl Into<CellSlice<'a>>,
    signed_volume: impl Fn(usize) -> f64,
) -> BoundarySurface {
    let cells = cells.into();
    let faces = faces(cells);
    let are_consistent = faces
        .chunk_by(|a, b| a.nodes == b.nodes)
        .all(|group| group.len() < 2 || group[0].reversed != group[1].reversed);
    let mut outer: Vec<CellFace> = outer(&faces).copied().collect();
    drop(faces);
    outer.sort_unstable_by_key(|face| (face.cell, face.side));
    let whole: f64 = (0..cells.len()).map(&signed_volume).sum();
    let faces_inward = |face: &CellFace| match are_consistent {
        true => whole < 0.0,
        false => signed_volume(face.cell as usize) < 0.0,
    };
    let mut triangles: Vec<[u32; 3]> = Vec::with_capacity(2 * outer.len());
    for face in &outer {
        let inward = faces_inward(face);
        let outward = |[a, b, c]: [u32; 3]| if inward { [a, c, b] } else { [a, b, c] };
        triangles.extend(face.triangles(cells).map(outward));
    }

    let mut on_boundary = vec![false; vertices.len()];
    triangles.iter().flatten().for_each(|&v| on_boundary[v as usize] = true);
    let vertex_ids: Vec<u32> = (0..vertices.len() as u32)
        .filter(|&v| on_boundary[v as usize])
        .collect();
    let mut compact = vec![u32::MAX; vertices.len()];
    for (new, &old) in vertex_ids.iter().enumerate() {
        compact[old as usize] = new as u32;
    }
    let vertices = vertex_ids.iter().map(|&v| vertices[v as usize]).collect();
    let triangles = triangles.iter().map(|f| f.map(|v| compact[v as usize])).collect();
    let surface = SurfaceMesh::new(vertices, triangles).expect("boundary faces name boundary vertices");
    BoundarySurface { surface, vertex_ids }
}
