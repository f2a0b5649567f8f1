//! Cases of VOLMAP's group G1 (Cherchi & Livesu 2023): tetrahedral meshes and images of their boundary nodes. Each is
//! mapped by finite elements on its own tetrahedra, and repaired with the boundary fixed.
//!
//! `cargo bench --bench volmap -- FOLDER [CASE ...] [--svg=FILE]`; by hand, since all cases take minutes.

mod plot;
#[path = "../shared/mod.rs"]
mod shared;

use std::collections::HashMap;
use std::path::Path;

use solidmap::Point;
use solidmap::baseline::{HarmonicOptions, TetHarmonic};
use solidmap::boundary_map::BoundaryMap;
use solidmap::io::{read_cells, read_node_images};
use solidmap::mesh::{CellList, TetMesh};
use solidmap::remesh::{RemeshOptions, RemeshSource, remesh};

use plot::{Row, svg};
use shared::processor_seconds;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let picture = std::env::args().find_map(|argument| argument.strip_prefix("--svg=").map(str::to_owned));
    let mut arguments = std::env::args().skip(1).filter(|argument| !argument.starts_with("--"));
    let folder = arguments.next().ok_or("name the folder with the cases")?;
    let folder = Path::new(&folder);
    let mut cases: Vec<String> = arguments.collect();
    if cases.is_empty() {
        for entry in std::fs::read_dir(folder)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            cases.extend(name.strip_suffix(".txt").map(str::to_owned));
        }
        cases.sort();
    }
    println!("Finite elements on the given tetrahedra, and the repair; processor time without the former.\n");
    println!("| case | tets | inverted | now | tets added | least scaled Jacobian | its 1 % quantile | CPU s |");
    println!("|---|--:|--:|--:|--:|--:|--:|--:|");
    let (mut valid, mut rows) = (0, Vec::new());
    for case in &cases {
        let (is_valid, row) = run(folder, case)?;
        valid += usize::from(is_valid);
        rows.push(row);
    }
    println!("{valid} of {} valid", cases.len());
    if let Some(picture) = picture {
        std::fs::write(picture, svg(&rows))?;
    }
    Ok(())
}

fn run(folder: &Path, case: &str) -> Result<(bool, Row), Failure> {
    let (model, target) = case.rsplit_once('_').ok_or("cases are called MODEL_TARGET")?;
    let (nodes, cells, regions) = read_cells(folder.join(format!("{model}.mesh")))?.into_parts();
    let CellList::Tets(mut tets) = cells else {
        return Err("tetrahedra are needed".into());
    };
    let det = |t: &[u32; 4]| {
        let [a, b, c, d] = t.map(|v| nodes[v as usize]);
        (b - a).dot(&(c - a).cross(&(d - a)))
    };
    if tets.iter().map(det).sum::<f64>() < 0.0 {
        tets.iter_mut().for_each(|t| t.swap(0, 1));
    }
    let images = read_node_images(folder.join(format!("{case}.txt")))?;
    let images: HashMap<u32, Point> = images.into_iter().collect();
    let mesh = TetMesh::new(nodes.clone(), tets.clone())?;
    let harmonic = TetHarmonic::new(mesh, &HarmonicOptions::default())?;
    let outer = harmonic.boundary_vertices();
    let outer_images: Vec<Point> = outer.iter().map(|v| images[v]).collect();
    // The vertices of the surface are the boundary nodes, in the same order.
    let boundary = BoundaryMap::new(harmonic.mesh().boundary().surface, outer_images.clone())?;
    let map = harmonic.solve(&outer_images)?;

    let given = solidmap::mesh::CellMesh::new(nodes, CellList::Tets(tets), regions)?;
    let options = RemeshOptions {
        slide: false,
        ..RemeshOptions::default()
    };
    let used = processor_seconds();
    let remeshed = remesh(&boundary, &map, RemeshSource::Given(given), &options, &|_| {})?;
    let report = &remeshed.report;
    let quality = report.quality.ok_or("no quality")?;
    let row = Row {
        target: target.to_owned(),
        tets: report.cells - report.repair.split.cells_added,
        seconds: processor_seconds() - used,
        least: quality.min_scaled_jacobian,
    };
    println!(
        "| {case} | {} | {} | {} | {} | {:.1e} | {:.1e} | {:.1} |",
        row.tets,
        report.before.inverted,
        report.after.inverted,
        report.repair.split.cells_added,
        row.least,
        quality.p01_scaled_jacobian,
        row.seconds,
    );
    Ok((report.after.inverted == 0, row))
}
