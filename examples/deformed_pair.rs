//! Writes a model and its image under a smooth deformation (a bend, a twist and a bulge), as a pair for `solidmap fit`
//! and `solidmap compare`: `domain.ply` and `image.ply`, the model scaled to a box of diagonal 1.
//!
//! `cargo run --release --example deformed_pair -- MODEL FOLDER`

use std::path::PathBuf;

use solidmap::Point;
use solidmap::io::{self, SolidMesh};
use solidmap::mesh::shapes;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(model), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: deformed_pair MODEL FOLDER".into());
    };
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;
    let model = match io::read_solid(model)? {
        SolidMesh::Surface(surface) => surface,
        SolidMesh::Cells(cells) => cells.boundary().surface,
    };
    let (low, high) = model.bounding_box().ok_or("the model has no vertices")?;
    let (centre, diagonal) = (nalgebra::center(&low, &high), (high - low).norm());
    let domain = shapes::deformed(&model, |p| Point::from((p - centre) / diagonal));
    io::write_surface(folder.join("domain.ply"), &domain)?;
    io::write_surface(folder.join("image.ply"), &shapes::deformed(&domain, bent))?;
    Ok(())
}

/// Injective with `det J > 0.3` in a box of diagonal 1 about the origin; no coordinate is harmonic.
fn bent(p: &Point) -> Point {
    let twist = 0.8 * p.z;
    let (cosine, sine) = (twist.cos(), twist.sin());
    let bulge = 1.0 + 0.3 * (3.0 * p.z).cos();
    Point::new(
        bulge * (cosine * p.x - sine * p.y) + 0.25 * p.z * p.z,
        bulge * (sine * p.x + cosine * p.y),
        p.z + 0.15 * (3.0 * p.x).sin(),
    )
}
