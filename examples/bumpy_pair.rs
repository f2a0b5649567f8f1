//! Writes a procedural solid of any size, with the map of its boundary to a sphere, for measuring how time and memory
//! grow: `domain.ply` and `image.ply` of `10·f² + 2` vertices.
//!
//! `cargo run --release --example bumpy_pair -- FREQUENCY FOLDER`, for instance 100 for 100 002 vertices.

use std::path::PathBuf;

use solidmap::io;
use solidmap::mesh::shapes;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(frequency), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: bumpy_pair FREQUENCY FOLDER".into());
    };
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;
    let domain = shapes::bumpy_sphere(frequency.parse()?);
    let image = shapes::projected_to_sphere(&domain, 1.0);
    io::write_surface(folder.join("domain.ply"), &domain)?;
    io::write_surface(folder.join("image.ply"), &image)?;
    Ok(())
}
