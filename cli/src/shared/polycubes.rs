//! Polycubes: the tetrahedra that they are made of, progress, and the lines of the summary.

use std::cell::Cell;
use std::path::Path;

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::{DistortionQuantiles, SurfaceDistortion};
use solidmap::io::SolidMesh;
use solidmap::mesh::TetMesh;
use solidmap::model_polycube::{ModelPolycubePhase, Polycube, SimplifiedReport, VoxelReport};
use solidmap::polycube::{LabelSource, PolycubePhase, PolycubeReport};

use super::bijective::own_tets;
use super::output::Output;
use super::{boundary_map, input};
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
pub fn show_phase(phase: ModelPolycubePhase, attempt: &Cell<usize>, output: &Output) {
    match phase {
        ModelPolycubePhase::Simplifying => output.progress("simplifying"),
        ModelPolycubePhase::Deforming(phase) => show_deformation(phase, attempt, output),
        ModelPolycubePhase::Pairing(phase) => boundary_map::show_phase(phase, output),
    }
}

/// Shows a phase of a deformation.
pub fn show_deformation(phase: PolycubePhase, attempt: &Cell<usize>, output: &Output) {
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

/// What the reports say of a polycube.
#[derive(Default, Serialize)]
pub struct PolycubeSummary {
    /// None where it consists of voxels, and where none was found.
    pub polycube: Option<PolycubeReport>,
    /// The simplified model that was deformed; none where it was the model itself.
    pub simplified: Option<SimplifiedReport>,
    /// None where it does not consist of voxels.
    pub voxels: Option<VoxelReport>,
}

impl PolycubeSummary {
    /// The summary of a polycube.
    pub fn of(found: &Polycube) -> Self {
        match found {
            Polycube::Deformed(found, simplified) => Self {
                polycube: Some(found.report.clone()),
                simplified: simplified.as_deref().cloned(),
                voxels: None,
            },
            Polycube::Voxels(_, report) => Self {
                voxels: Some(report.as_ref().clone()),
                ..Self::default()
            },
        }
    }

    /// The lines of the summary.
    pub fn rows(&self) -> Vec<[String; 2]> {
        let mut rows = self.polycube.as_ref().map_or(vec![], deformed_rows);
        if let Some(simplified) = &self.simplified {
            rows.push([
                "simplified".into(),
                format!(
                    "the polycube is that of a surface of {} of the model's {} vertices",
                    simplified.vertices, simplified.of
                ),
            ]);
            rows.push(["onto the model".into(), distortion(&simplified.distortion)]);
        }
        if let Some(voxels) = &self.voxels {
            rows.extend(voxel_rows(voxels));
        }
        rows
    }
}

fn voxel_rows(report: &VoxelReport) -> [[String; 2]; 2] {
    let missed = match report.missed {
        0 => String::new(),
        count => format!("; {count} vertices of the model are farther than a voxel from them"),
    };
    let polycube = format!(
        "{} voxels of {}, {} along each{missed}",
        report.voxels,
        significant(report.size, 4),
        match report.cells {
            1 => "1 cell".into(),
            count => format!("{count} cells"),
        }
    );
    [
        ["polycube".into(), polycube],
        ["distortion".into(), distortion(&report.distortion)],
    ]
}

/// The lines about a model that was deformed.
fn deformed_rows(found: &PolycubeReport) -> Vec<[String; 2]> {
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
    if let Some(features) = &found.features {
        let words = match features.length > 0.0 {
            false => format!("none sharper than {}°", features.angle),
            true => format!(
                "{} % of the length of edges sharper than {}° are edges of the polycube",
                significant(100.0 * features.on_borders / features.length, 3),
                features.angle
            ),
        };
        rows.push(["features".into(), words]);
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
    if let Some(found) = &found.distortion {
        rows.push(["distortion".into(), distortion(found)]);
    }
    rows
}

/// The distortion of the boundary in words.
fn distortion(found: &SurfaceDistortion) -> String {
    let of = |q: &DistortionQuantiles| format!("{:.2}, {:.2}, {:.2}", q.p50, q.p90, q.p99);
    format!(
        "ratio of stretches {}, of areas {} (50, 90 and 99 % of the area)",
        of(&found.angle),
        of(&found.area)
    )
}
