//! The mesh in files: with labels, or with fields.

use std::path::Path;

use anyhow::Context;
use solidmap::Point;
use solidmap::io::{self, CellGroup, Cells, Field, MapMetadata, VtkFields};
use solidmap::remesh::{BoundedMesh, Obstacle, Remeshed, determinants, scaled_jacobians};

use crate::cli::args::RemeshArgs;

/// Where the mesh comes from, in one line.
pub fn origin(args: &RemeshArgs, map: &MapMetadata) -> anyhow::Result<String> {
    let mut origin = format!("solidmap {}: mesh", env!("CARGO_PKG_VERSION"));
    let mut add = |role: &str, file: &str, sha256: &str| {
        origin += &format!(" {role} {file} (SHA-256 {})", sha256.get(..16).unwrap_or(sha256));
    };
    if let Some(path) = &args.mesh {
        let mesh = io::Provenance::of("mesh", path).with_context(|| format!("cannot read `{}`", path.display()))?;
        add("from", &mesh.file, &mesh.sha256);
    }
    let by = io::Provenance::of("map", &args.map).with_context(|| format!("cannot read `{}`", args.map.display()))?;
    add("carried by", &by.file, &by.sha256);
    for input in &map.inputs {
        add(&format!("of {}", input.role), &input.file, &input.sha256);
    }
    Ok(origin)
}

/// The mesh with its nodes at `positions`.
pub fn mesh(path: &Path, remeshed: &Remeshed, positions: &[Point], origin: &str) -> anyhow::Result<()> {
    let mesh = &remeshed.mesh;
    let cells = Cells::from(mesh.cells());
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if matches!(extension.as_deref(), Some("mesh" | "msh")) {
        let (quads, names) = (mesh.quads(), names(mesh.part_names()));
        let (faces, of_faces): (Cells, Vec<i32>) = match &quads {
            // Two triangles stand for each quad.
            Some(quads) => (Cells::Quads(quads), mesh.parts().iter().step_by(2).copied().collect()),
            None => (Cells::Triangles(mesh.boundary()), mesh.parts().to_vec()),
        };
        let faces = CellGroup {
            cells: faces,
            labels: &of_faces,
            names: &names,
        };
        let solid = CellGroup {
            cells,
            labels: mesh.regions(),
            names: &[],
        };
        return Ok(io::write_groups(path, positions, &[faces, solid], origin)?);
    }
    let report = &remeshed.report;
    let mut inverted = vec![0.0; cells.count()];
    let mut obstacle = vec![0.0; cells.count()];
    for &cell in &report.after.cells {
        inverted[cell as usize] = 1.0;
        obstacle[cell as usize] = match report.obstacles_after.of_cells[cell as usize] {
            Obstacle::Unknown => 0.0,
            Obstacle::Boundary => 1.0,
            Obstacle::BlockedNode => 2.0,
            Obstacle::FoldedQuad => 3.0,
        };
    }
    let field = |name: &str, components, values| Field {
        name: name.into(),
        components,
        values,
    };
    let on_boundary = mesh.on_boundary().iter().map(|&is| f64::from(u8::from(is))).collect();
    let fields = VtkFields {
        point: vec![
            field("domain", 3, flat(mesh.nodes())),
            field("image", 3, flat(&remeshed.images)),
            field("on_boundary", 1, on_boundary),
        ],
        cell: vec![
            field("region", 1, mesh.regions().iter().map(|&r| f64::from(r)).collect()),
            field("scaled_jacobian", 1, scaled_jacobians(mesh.cells(), positions)),
            field(
                "det_jacobian",
                1,
                per_cell(mesh, &determinants(mesh.cells(), mesh.nodes(), &remeshed.images)),
            ),
            field("inverted", 1, inverted),
            field("obstacle", 1, obstacle),
        ],
        comment: origin.to_owned(),
    };
    if extension.as_deref() == Some("vtk") {
        io::write_vtk(path, positions, cells, &fields, io::VtkEncoding::Binary)?;
    } else {
        io::write_vtu(path, positions, cells, &fields)?;
    }
    Ok(())
}

/// Names with their numbers, from 1.
fn names(names: &[String]) -> Vec<(i32, String)> {
    (1..).zip(names.iter().cloned()).collect()
}

/// The least of each cell's determinants.
fn per_cell(mesh: &BoundedMesh, determinants: &[f64]) -> Vec<f64> {
    let corners = determinants.len() / mesh.cells().len().max(1);
    let least = |dets: &[f64]| {
        dets.iter()
            .copied()
            .fold(f64::INFINITY, |a: f64, b| if a.is_nan() || a < b { a } else { b })
    };
    determinants.chunks(corners.max(1)).map(least).collect()
}

fn flat(points: &[Point]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}
