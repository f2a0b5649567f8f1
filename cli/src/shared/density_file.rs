//! Writing energy densities, cell by cell.

use std::path::Path;

use solidmap::energy::{CellLayout, Densities, Quadrature};
use solidmap::io::{self, Cells, VtkFields};
use solidmap::mesh::TetMesh;

use super::fields::scalar;

/// The fields of a map at the points of a quadrature: its energies, and the target's distance field pulled back by it.
pub fn fields<'a>(densities: &'a Densities, distances: &'a [f64]) -> [(&'static str, &'a [f64]); 4] {
    [
        ("harmonic_energy", &densities.harmonic),
        ("deformation_energy", &densities.deformation),
        ("det_jacobian", &densities.det_jacobian),
        ("transferred_distance", distances),
    ]
}

/// Writes the cell means of fields given at the points of a quadrature. Cells are tetrahedra of a mesh, or boxes of a
/// grid, which are written whole where the surface cuts them.
pub fn write(
    path: &Path,
    quadrature: &Quadrature,
    mesh: Option<&TetMesh>,
    fields: &[(&str, &[f64])],
) -> anyhow::Result<()> {
    let means = |values| quadrature.cell_means(values).iter().map(|c| c.mean).collect();
    let cells = quadrature.cell_means(quadrature.weights());
    let volumes = scalar("volume_inside", cells.iter().map(|c| c.volume).collect());
    let cells: Vec<u32> = cells.iter().map(|c| c.cell).collect();
    let means = fields.iter().map(|&(name, values)| scalar(name, means(values)));
    let fields = VtkFields {
        cell: means.chain([volumes]).collect(),
        ..VtkFields::default()
    };
    match (quadrature.layout(), mesh) {
        (CellLayout::Tets { .. }, Some(mesh)) => {
            let tets: Vec<_> = cells.iter().map(|&c| mesh.tets()[c as usize]).collect();
            io::write_vtu(path, mesh.vertices(), Cells::Tets(&tets), &fields)?;
        }
        (CellLayout::Grid(grid), _) => {
            let (points, hexes) = grid.hexahedra(&cells);
            io::write_vtu(path, &points, Cells::Hexes(&hexes), &fields)?;
        }
        (CellLayout::Tets { .. }, None) => {
            anyhow::bail!("densities on tetrahedra cannot be written without their mesh")
        }
    }
    Ok(())
}
