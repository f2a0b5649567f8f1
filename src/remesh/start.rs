//! Where a repair starts: the nodes as mapped, or as finite elements on these cells place them.

use super::bounded_mesh::BoundedMesh;
use super::quality::invalid_cells;
use crate::Point;
use crate::baseline::{HarmonicOptions, HarmonicSolver, TetHarmonic};
use crate::mesh::{CellList, TetMesh, tets_of_hex};

/// The images by finite elements, if fewer cells are inverted by them than as mapped. `None` also where there are none,
/// as for a mesh with flat tetrahedra.
pub(super) fn better_start(mesh: &BoundedMesh, carried: &[Point]) -> Option<Vec<Point>> {
    let found = by_finite_elements(mesh, carried)?;
    let [by_elements, as_mapped] = [&found, carried].map(|x| invalid_cells(&mesh.cells, x).cells.len());
    (by_elements < as_mapped).then_some(found)
}

/// The images of all nodes by linear finite elements from those on the boundary; hexahedra are cut into tetrahedra. `None` where
/// there are none, as for a mesh with flat tetrahedra.
pub(super) fn by_finite_elements(mesh: &BoundedMesh, carried: &[Point]) -> Option<Vec<Point>> {
    let tets = match &mesh.cells {
        CellList::Tets(tets) => tets.clone(),
        CellList::Hexes(hexes) => hexes.iter().flat_map(tets_of_hex).collect(),
    };
    let domain = TetMesh::new(mesh.nodes.clone(), tets).ok()?;
    // A factor of a regular grid would take more memory than all the rest.
    let options = HarmonicOptions {
        solver: HarmonicSolver::Iterative,
        tolerance: 1e-8,
        ..HarmonicOptions::default()
    };
    let harmonic = TetHarmonic::new(domain, &options).ok()?;
    let boundary = harmonic.boundary_vertices().iter();
    let boundary: Vec<Point> = boundary.map(|&v| carried[v as usize]).collect();
    Some(harmonic.solve(&boundary).ok()?.images().to_vec())
}
