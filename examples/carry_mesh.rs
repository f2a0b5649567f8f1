//! Carries a tet mesh of the domain by a fitted map, and says what the map does to it.
//!
//! `cargo run --release --example carry_mesh -- MAP TETS CARRIED`: a map file, a tet mesh of its domain (.mesh, .vtk,
//! .vtu; for instance from `solidmap tet`), and the mesh to write.

use solidmap::energy::{EnergyOptions, energies, tet_quadrature};
use solidmap::files;
use solidmap::geometry::flipped_tets;
use solidmap::inverse::{InverseMap, InverseOptions};
use solidmap::io;
use solidmap::map::VolumeMap;
use solidmap::mesh::TetMesh;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [map, tets, output] = &arguments[..] else {
        return Err("usage: carry_mesh MAP TETS CARRIED".into());
    };
    let file = files::read_map(map.as_ref())?;
    let tets = io::read_tets(tets)?;

    let boundary = file.boundary.ok_or("the map file has no boundary map")?;

    // The map has a value and a Jacobian at any point of the domain.
    let images = file.map.evaluate(tets.vertices());
    let quadrature = tet_quadrature(&tets)?;
    let volume = boundary.target_volume();
    let energy = energies(
        &file.map,
        &quadrature,
        quadrature.volume(),
        volume,
        &EnergyOptions::default(),
    )?;
    println!(
        "harmonic energy {:.4}, deformation energy {:.4}",
        energy.harmonic, energy.deformation
    );
    let flipped = flipped_tets(&tets, &images).ok_or("the map has no value at a node")?;
    println!("{} of {} tets are inverted", flipped.negative, tets.tets().len());

    // The inverse: which point of the domain goes to the first image?
    let inverse = InverseMap::new(&file.map, &boundary, &InverseOptions::default())?;
    let (preimages, _) = inverse.preimages(&images[..1]);
    let found = &preimages[0];
    println!("{} is the image of {} ({:?})", images[0], found.point, found.status);

    io::write_tets(output, &TetMesh::new(images, tets.tets().to_vec())?)?;
    Ok(())
}
