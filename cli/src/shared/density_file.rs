//! Writing energy densities, cell by cell.

use std::path::Path;

use solidmap::energy::{CellLayout, Densities, Quadrature};
use solidmap::io::{self, Cells, VtkFields};
use solidmap::mesh::{CellList, CellMesh};

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

/// Writes the cell means of fields given at the points of a quadrature. Cells are those of a mesh, or boxes of a grid,
/// which are written whole where the surface cuts them.
pub fn write(
    path: &Path,
    quadrature: &Quadrature,
    mesh: Option<&CellMesh>,
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
        (CellLayout::Grid(grid), _) => {
            let (points, hexes) = grid.hexahedra(&cells);
            io::write_vtu(path, &points, Cells::Hexes(&hexes), &fields)?;
        }
        (_, Some(mesh)) => {
            let with_points = match mesh.cells() {
                CellList::Tets(tets) => CellList::Tets(cells.iter().map(|&c| tets[c as usize]).collect()),
                CellList::Hexes(hexes) => CellList::Hexes(cells.iter().map(|&c| hexes[c as usize]).collect()),
            };
            io::write_vtu(path, mesh.nodes(), Cells::from(&with_points), &fields)?;
        }
        (_, None) => anyhow::bail!("densities on the cells of a mesh cannot be written without it"),
    }
    Ok(())
}
