//! Polycubes: the tetrahedra that they are made of, progress, and the lines of the summary.

use std::cell::Cell;
use std::path::Path;

use anyhow::Context;
use solidmap::boundary_map::{DistortionQuantiles, SurfaceDistortion};
use solidmap::io::SolidMesh;
use solidmap::mesh::TetMesh;
use solidmap::polycube::{LabelSource, PolycubePhase, PolycubeReport};

use super::bijective::own_tets;
use super::input;
use super::output::Output;
use crate::drawing::significant;

/// A model that is filled with tetrahedra.
pub struct Model {
    pub mesh: TetMesh,
    /// The triangles of its surface by their nodes in the mesh, in the order of the file: of the surface that was given, or of
    /// the boundary of the tetrahedra.
    pub triangles: Vec<[u32; 3]>,
}

/// The model's own tetrahedra, or TetGen's, with its triangles.
pub fn model(path: &Path, output: &Output) -> anyhow::Result<Model> {
    Ok(match input::read_solid(path)? {
        // TetGen keeps all triangles, and the numbers of their vertices.
        SolidMesh::Surface(surface) => Model {
            mesh: tetrahedra(path, output)?,
            triangles: surface.triangles().to_vec(),
        },
        SolidMesh::Cells(_) => {
            let mesh = tetrahedra(path, output)?;
            let boundary = mesh.boundary();
            let node = |v: u32| boundary.vertex_ids[v as usize];
            let triangles = boundary.surface.triangles().iter().map(|t| t.map(node)).collect();
            Model { mesh, triangles }
        }
    })
}

/// The model's own tetrahedra, or TetGen's.
pub fn tetrahedra(model: &Path, output: &Output) -> anyhow::Result<TetMesh> {
    let solid = input::read_solid(model)?;
    if let Some(mesh) = own_tets(solid)? {
        return Ok(mesh);
    }
    output.progress("tetrahedralising");
    filled(model).with_context(|| format!("cannot fill `{}` with tetrahedra", model.display()))
}

#[cfg(feature = "native")]
fn filled(model: &Path) -> anyhow::Result<TetMesh> {
    use solidmap::cgal_tetgen::{TetOptions, tetrahedralize};
    let options = TetOptions {
        memory: input::most_memory(),
        ..TetOptions::default()
    };
    Ok(tetrahedralize(&input::read_surface(model)?, &options)?)
}

#[cfg(not(feature = "native"))]
fn filled(_: &Path) -> anyhow::Result<TetMesh> {
    anyhow::bail!("it needs TetGen, and this solidmap was built without it; give a tet mesh in place of its surface")
}

/// Shows a phase of the making of a polycube; `attempt` keeps the number of the attempt.
pub fn show_phase(phase: PolycubePhase, attempt: &Cell<usize>, output: &Output) {
    match phase {
        PolycubePhase::Attempting { attempt: number } => attempt.set(number),
        PolycubePhase::Labelling { round } => {
            output.progress_in("directions", format!("attempt {}, round {round} of 4", attempt.get()));
        }
        PolycubePhase::Deforming { inverted } => {
            output.progress_in("deforming", format!("attempt {}, {inverted} inverted", attempt.get()));
        }
        PolycubePhase::Snapping => output.progress("moving planes to the lattice"),
    }
}

/// The lines about a polycube.
pub fn rows(found: &PolycubeReport) -> Vec<[String; 2]> {
    let mut rows = vec![];
    let directions = match found.labels {
        LabelSource::Cut => format!("graph cut with smoothness {}", found.smoothness),
        LabelSource::Given => "as given".into(),
        LabelSource::Sphere => "from the map to the sphere: no cut led to a polycube".into(),
    };
    let [x, y, z] = found.planes;
    rows.push(["directions".into(), format!("{directions}, attempt {}", found.attempts)]);
    if let Some([[a, _, _], [_, b, _], [_, _, c]]) = found.turn {
        // The trace of a rotation is 1 + 2 cos of its angle.
        let degrees = (0.5 * (a + b + c - 1.0)).clamp(-1.0, 1.0).acos().to_degrees();
        rows.push([
            "turned".into(),
            format!("by {}°, the polycube alone", significant(degrees, 3)),
        ]);
    }
    let lattice = match found.lattice {
        Some(size) => format!(", on a lattice with cells of {}", significant(size, 4)),
        None => String::new(),
    };
    rows.push([
        "polycube".into(),
        format!(
            "{} charts, {} corners, {x}, {y} and {z} planes across x, y and z{lattice}",
            found.charts, found.corners
        ),
    ]);
    rows.push([
        "tets".into(),
        format!(
            "{}, {} of them by splitting; none inverted, no triangle against its direction, decided exactly",
            found.tets,
            found.tets - found.tets_given
        ),
    ]);
    if let Some(distortion) = &found.distortion {
        rows.push(["distortion".into(), self::distortion(distortion)]);
    }
    rows
}

/// The distortion of the boundary in words.
pub fn distortion(found: &SurfaceDistortion) -> String {
    let of = |q: &DistortionQuantiles| format!("{:.2}, {:.2}, {:.2}", q.p50, q.p90, q.p99);
    format!(
        "ratio of stretches {}, of areas {} (50, 90 and 99 % of the area)",
        of(&found.angle),
        of(&found.area)
    )
}
