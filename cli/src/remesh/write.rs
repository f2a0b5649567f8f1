//! The mesh in files: with labels, or with fields.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::Context;
use solidmap::Point;
use solidmap::files::{self, MapMetadata};
use solidmap::io::{self, CellGroup, Cells, Field, VtkFields};
use solidmap::remesh::{BoundedMesh, InversionCause, Remeshed, determinants, scaled_jacobians};

use crate::args::RemeshArgs;

/// Where the mesh comes from, in one line.
pub fn origin(args: &RemeshArgs, map: &MapMetadata) -> anyhow::Result<String> {
    let mut origin = format!("solidmap {}: mesh", env!("CARGO_PKG_VERSION"));
    let mut add = |role: &str, file: &str, sha256: &str| {
        origin += &format!(" {role} {file} (SHA-256 {})", sha256.get(..16).unwrap_or(sha256));
    };
    if let Some(path) = &args.mesh {
        let mesh = files::Provenance::of("mesh", path).with_context(|| format!("cannot read `{}`", path.display()))?;
        add("from", &mesh.file, &mesh.sha256);
    }
    let by =
        files::Provenance::of("map", &args.map).with_context(|| format!("cannot read `{}`", args.map.display()))?;
    add("carried by", &by.file, &by.sha256);
    for input in &map.inputs {
        add(&format!("of {}", input.role), &input.file, &input.sha256);
    }
    Ok(origin)
}

/// The extension in lower case; empty when there is none.
pub fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// The mesh with its nodes at `positions`.
pub fn mesh(path: &Path, remeshed: &Remeshed, positions: &[Point], origin: &str) -> anyhow::Result<()> {
    let mesh = &remeshed.mesh;
    let cells = Cells::from(mesh.cells());
    let extension = extension(path);
    if matches!(extension.as_str(), "mesh" | "msh") {
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
        let (labels, inverted) = labels(remeshed);
        let solid = CellGroup {
            cells,
            labels: &labels,
            names: &inverted,
        };
        let explained = inverted
            .iter()
            .map(|(label, name)| format!("\ncells of reference {label}: {name}"));
        let comment = match extension.as_str() {
            "mesh" => origin.to_owned() + &explained.collect::<String>(),
            // Gmsh has names for them.
            _ => origin.to_owned(),
        };
        return Ok(io::write_groups(path, positions, &[faces, solid], &comment)?);
    }
    let report = &remeshed.report;
    let mut inverted = vec![0.0; cells.count()];
    let mut obstacle = vec![0.0; cells.count()];
    for &cell in &report.after.cells {
        inverted[cell as usize] = 1.0;
        obstacle[cell as usize] = f64::from(number_and_words(report.causes_after.of_cells[cell as usize]).0);
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
    if extension == "vtk" {
        io::write_vtk(path, positions, cells, &fields, io::VtkEncoding::Binary)?;
    } else {
        io::write_vtu(path, positions, cells, &fields)?;
    }
    Ok(())
}

/// The region of each cell, where those that stay inverted have labels of their own, one for each region and obstacle, and
/// the names of these. They are the least numbers that neither a region nor a part of the boundary has.
fn labels(remeshed: &Remeshed) -> (Vec<i32>, Vec<(i32, String)>) {
    let (mesh, report) = (&remeshed.mesh, &remeshed.report);
    let regions: BTreeSet<i32> = mesh.regions().iter().copied().collect();
    let parts: BTreeSet<i32> = mesh.parts().iter().copied().collect();
    let mut groups: BTreeMap<(i32, u8), (&str, Vec<usize>)> = BTreeMap::new();
    for cell in report.after.cells.iter().map(|&cell| cell as usize) {
        let (number, words) = number_and_words(report.causes_after.of_cells[cell]);
        let (_, cells) = groups.entry((mesh.regions()[cell], number)).or_insert((words, vec![]));
        cells.push(cell);
    }
    let mut labels = mesh.regions().to_vec();
    let mut names = Vec::new();
    let free = (1..).filter(|label| !regions.contains(label) && !parts.contains(label));
    for (((region, number), (words, cells)), label) in groups.into_iter().zip(free) {
        let mut name = String::from("inverted");
        if number > 0 {
            name += &format!(", obstacle {number} ({words})");
        }
        if regions.len() > 1 {
            name += &format!(", of region {region}");
        }
        cells.into_iter().for_each(|cell| labels[cell] = label);
        names.push((label, name));
    }
    (labels, names)
}

/// How files tell of an obstacle.
fn number_and_words(obstacle: InversionCause) -> (u8, &'static str) {
    match obstacle {
        InversionCause::Unknown => (0, "unknown"),
        InversionCause::Boundary => (1, "corner on the boundary alone"),
        InversionCause::BlockedNode => (2, "node without a right place"),
        InversionCause::FoldedQuad => (3, "folded boundary quad"),
    }
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
