//! Meshes the target of a map from a polycube with hexahedra, and repairs those that the map inverts.
//!
//! `cargo run --release --example remesh_polycube -- MAP MESH [CELLS]`: a map file whose domain is a polycube, the mesh
//! to write (.mesh, .vtk, .vtu), and the number of cells along the longest side (32). `docs/remeshing.md` says how it
//! works.

use solidmap::files;
use solidmap::io;
use solidmap::remesh::{CellKind, CellSize, RemeshOptions, RemeshSource, remesh};

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (map, output, cells) = match &arguments[..] {
        [map, output] => (map, output, 32),
        [map, output, cells] => (map, output, cells.parse()?),
        _ => return Err("usage: remesh_polycube MAP MESH [CELLS]".into()),
    };
    let file = files::read_map(map.as_ref())?;
    let grid = RemeshSource::Regular {
        kind: CellKind::Hexes,
        size: CellSize::Along(cells),
        most_cells: 10_000_000,
    };
    let boundary = file.boundary.ok_or("the map file has no boundary map")?;
    let remeshed = remesh(&boundary, &file.map, grid, &RemeshOptions::default(), &|phase| {
        eprintln!("{phase:?}");
    })?;

    let report = &remeshed.report;
    println!(
        "{} hexahedra, {} inverted as mapped, {} after repair",
        report.cells,
        report.before.cells.len(),
        report.after.cells.len()
    );
    io::write_cells(output, &remeshed.images, remeshed.mesh.cells().into())?;
    Ok(())
}
