//! Writing carried meshes: with labels, or with fields.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use solidmap::Point;
use solidmap::io::{self, CellGroup, Cells, Field, VtkFields};
use solidmap::remesh::{BoundedMesh, InversionCause, Remeshed, determinants, scaled_jacobians};

use super::input::extension;

/// Writes the mesh with its nodes at `positions`; `origin` says in one line where it comes from.
pub fn write(path: &Path, remeshed: &Remeshed, positions: &[Point], origin: &str) -> anyhow::Result<()> {
    let mesh = &remeshed.mesh;
    let cells = Cells::from(mesh.cells());
    let extension = extension(path);
    if matches!(extension.as_str(), "mesh" | "msh") {
        let (quads, names) = (mesh.quads(), numbered(mesh.part_names()));
        let (faces, face_labels): (Cells, Vec<i32>) = match &quads {
            // Two triangles stand for each quad.
            Some(quads) => (Cells::Quads(quads), mesh.parts().iter().step_by(2).copied().collect()),
            None => (Cells::Triangles(mesh.boundary()), mesh.parts().to_vec()),
        };
        let faces = CellGroup {
            cells: faces,
            labels: &face_labels,
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
            // Gmsh shows the names.
            _ => origin.to_owned(),
        };
        return Ok(io::write_groups(path, positions, &[faces, solid], &comment)?);
    }
    let report = &remeshed.report;
    let mut inverted = vec![0.0; cells.count()];
    let mut obstacle = vec![0.0; cells.count()];
    for &cell in &report.after.cells {
        inverted[cell as usize] = 1.0;
        obstacle[cell as usize] = f64::from(number_and_name(report.causes_after.of_cells[cell as usize]).0);
    }
    let on_boundary = mesh.on_boundary().iter().map(|&is| f64::from(u8::from(is))).collect();
    let fields = VtkFields {
        point: vec![
            Field::positions("domain", mesh.nodes()),
            Field::positions("image", &remeshed.images),
            Field::scalar("on_boundary", on_boundary),
        ],
        cell: vec![
            Field::scalar("region", mesh.regions().iter().map(|&r| f64::from(r)).collect()),
            Field::scalar("scaled_jacobian", scaled_jacobians(mesh.cells(), positions)),
            Field::scalar(
                "det_jacobian",
                least_of_cells(mesh, &determinants(mesh.cells(), mesh.nodes(), &remeshed.images)),
            ),
            Field::scalar("inverted", inverted),
            Field::scalar("obstacle", obstacle),
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

/// The label of each cell, and the names of labels that are not regions. Cells that stay inverted have a label of their
/// own for each region and obstacle: the smallest positive ones that neither a region nor a part of the boundary has.
fn labels(remeshed: &Remeshed) -> (Vec<i32>, Vec<(i32, String)>) {
    let (mesh, report) = (&remeshed.mesh, &remeshed.report);
    let regions: BTreeSet<i32> = mesh.regions().iter().copied().collect();
    let parts: BTreeSet<i32> = mesh.parts().iter().copied().collect();
    let mut groups: BTreeMap<(i32, u8), (&str, Vec<usize>)> = BTreeMap::new();
    for cell in report.after.cells.iter().map(|&cell| cell as usize) {
        let (number, obstacle) = number_and_name(report.causes_after.of_cells[cell]);
        let (_, cells) = groups
            .entry((mesh.regions()[cell], number))
            .or_insert((obstacle, vec![]));
        cells.push(cell);
    }
    let mut labels = mesh.regions().to_vec();
    let mut names = Vec::new();
    let free = (1..).filter(|label| !regions.contains(label) && !parts.contains(label));
    for (((region, number), (obstacle, cells)), label) in groups.into_iter().zip(free) {
        let mut name = String::from("inverted");
        if number > 0 {
            name += &format!(", obstacle {number} ({obstacle})");
        }
        if regions.len() > 1 {
            name += &format!(", of region {region}");
        }
        cells.into_iter().for_each(|cell| labels[cell] = label);
        names.push((label, name));
    }
    (labels, names)
}

/// The number and the name in files, where the cause of an inversion is called an obstacle.
fn number_and_name(cause: InversionCause) -> (u8, &'static str) {
    match cause {
        InversionCause::Unknown => (0, "unknown"),
        InversionCause::Boundary => (1, "corner on the boundary alone"),
        InversionCause::BlockedNode => (2, "node without a right place"),
        InversionCause::FoldedQuad => (3, "folded boundary quad"),
        InversionCause::WindingRing => (4, "ring that does not wind once"),
    }
}

/// Names with their numbers, from 1.
fn numbered(names: &[String]) -> Vec<(i32, String)> {
    (1..).zip(names.iter().cloned()).collect()
}

/// The smallest determinant of each cell, of those that are defined; NaN where none is.
pub fn least_of_cells(mesh: &BoundedMesh, determinants: &[f64]) -> Vec<f64> {
    let corners = determinants.len() / mesh.cells().len().max(1);
    let least = |dets: &[f64]| dets.iter().copied().fold(f64::NAN, f64::min);
    determinants.chunks(corners.max(1)).map(least).collect()
}
