//! The page of a mesh of cells.

use anyhow::bail;
use solidmap::io::SolidMesh;

use super::Shown;
use crate::args::ViewArgs;
use crate::shared::output::Output;
use crate::shared::{input, mesh_page};

/// The text of the page.
pub fn page(args: &ViewArgs, output: &Output) -> anyhow::Result<(String, Shown)> {
    let SolidMesh::Cells(mesh) = input::read_solid(&args.file)? else {
        bail!(
            "`{}` is a surface, without cells to look into; give a map file, or a mesh of tetrahedra or hexahedra",
            args.file.display()
        );
    };
    output.progress("measuring the cells");
    let made = mesh_page::make(&args.file, mesh, args.up, &args.page.size)?;
    let shown = Shown::Mesh {
        cells: made.cells,
        inverted_cells: made.inverted_cells,
    };
    Ok((made.html, shown))
}
