//! `solidmap view` writes a page, or says why not. What browsers make of it is tested by `scripts/test-view.sh`.

use serde_json::json;
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::shapes;
use solidmap::remesh::{CellKind, Polycube, regular_mesh};

use crate::workplace::{Workplace, with_fitted_ball};

#[test]
fn a_page_holds_everything_and_is_the_same_each_time() {
    let place = with_fitted_ball(|p| Point::new(2.0 * p.x, p.y, p.z));
    let report = place.report(0, "view map.safetensors -o page.html --samples 16 --json");
    let page = std::fs::read(place.path("page.html")).unwrap();
    assert_eq!(report["bytes"], page.len());
    assert_eq!(report["samples"], json!([17, 17, 17]));
    place.ends_with(0, "view map.safetensors -o page.html --samples 16 --json");
    assert!(page == std::fs::read(place.path("page.html")).unwrap());
    let text = String::from_utf8(page).unwrap();
    // Addresses stand in licences and comments, which are packed or no links: nothing has to be fetched.
    for fetched in ["src=\"http", "href=\"http", "url(http", "@import"] {
        assert!(!text.contains(fetched), "{fetched}");
    }
}

#[test]
fn a_page_that_cannot_be_written_is_refused_before_the_work() {
    let place = with_fitted_ball(|p| Point::new(2.0 * p.x, p.y, p.z));
    place.fails(
        "view map.safetensors -o page.png",
        &["`page.png`", "name it .html or .htm"],
    );
    place.fails("view none.map -o page.html", &["none.map"]);
    place.fails("view domain.ply -o page.html", &["domain.ply", "is a surface"]);
    place.fails(
        "view map.safetensors -o page.html --max-size 1kB",
        &["even with 8 samples", "--max-size is 0.0 MB"],
    );
    assert!(!place.path("page.html").exists());
    let bad = place.run("view map.safetensors -o page.html --samples 2");
    assert_eq!(bad.status.code(), Some(2));
}

#[test]
fn a_page_of_a_certificate_has_its_boxes() {
    let place = with_fitted_ball(|p| Point::new(p.x + 1.2 * p.x * p.x, p.y, p.z));
    let line = "certify map.safetensors --finest 64 --html page.html --samples 8 --json";
    let report = place.report(1, line);
    assert_eq!(report["page"], "page.html");
    let text = std::fs::read_to_string(place.path("page.html")).unwrap();
    for array in ["folded", "undecided"] {
        assert!(text.contains(&format!("data-array=\"{array}\"")), "{array}");
    }
    place.fails(
        "certify map.safetensors --html page.png",
        &["`page.png`", "name it .html"],
    );
}

#[test]
fn a_mesh_is_shown_whole_or_not_at_all() {
    let place = Workplace::new();
    let cube = Polycube::of(&shapes::cube(1.0, 1)).unwrap();
    for kind in [CellKind::Hexes, CellKind::Tets] {
        let mesh = regular_mesh(&cube, 0.125, kind, 10_000).unwrap();
        io::write_cells(place.path("cube.vtu"), mesh.nodes(), io::Cells::from(mesh.cells())).unwrap();
        let report = place.report(0, "view cube.vtu -o page.html --json");
        let found = [&report["kind"], &report["cells"], &report["inverted_cells"]];
        assert_eq!(found, [&json!("mesh"), &json!(mesh.cells().len()), &json!(0)]);
    }
    place.fails(
        "view cube.vtu -o small.html --max-size 10kB",
        &["the page of all", "allow more"],
    );
    assert!(!place.path("small.html").exists());
}

/// A folder with `run`, a sequence of 12 frames of a ball, and what `sequence` reported.
fn with_sequence(options: &str) -> Workplace {
    let place = Workplace::new();
    let ball = shapes::sphere(1.0, 2);
    place.surface("ball.ply", &ball);
    let mut names = String::new();
    for k in 0..12 {
        let bend = 0.02 * f64::from(k);
        let name = format!("bend{k:02}.ply");
        place.surface(
            &name,
            &shapes::deformed(&ball, |p| Point::new(p.x + bend * p.z * p.z, p.y, p.z)),
        );
        names += &format!("{name} ");
    }
    place.ends_with(0, &format!("sequence ball.ply {names} -o run --resolution 8 {options}"));
    place
}

#[test]
fn a_sequence_is_shown_from_its_folder_or_its_collection() {
    let place = with_sequence("--html made.html --fps 5");
    assert!(place.path("made.html").is_file());
    let report = place.report(0, "view run -o folder.html --json");
    assert_eq!(report["kind"], "sequence");
    let found = ["frames", "shown", "faces"].map(|key| report[key].as_u64().unwrap());
    assert_eq!(found, [12, 12, shapes::sphere(1.0, 2).triangles().len() as u64]);
    let whole = report["bytes"].as_u64().unwrap();
    assert_eq!(whole, std::fs::metadata(place.path("folder.html")).unwrap().len());
    let report = place.report(0, "view run/surface.pvd -o collection.html --json");
    assert_eq!(report["shown"], 12);
    let smaller = whole - 10_000;
    let report = place.report(0, &format!("view run -o small.html --max-size {smaller} --json"));
    let shown = report["shown"].as_u64().unwrap();
    assert!(
        (2..12).contains(&shown) && report["bytes"].as_u64().unwrap() <= smaller,
        "{report}"
    );
    place.fails(
        "view run -o tiny.html --max-size 1kB",
        &["surface.pvd", "even with 2 of its 12 frames", "allow more"],
    );
    assert!(!place.path("tiny.html").exists());
}

#[test]
fn what_is_no_sequence_is_refused_with_advice() {
    let place = with_sequence("");
    std::fs::create_dir(place.path("empty")).unwrap();
    place.fails(
        "view empty -o page.html",
        &["`empty` has no `surface.pvd`", "without --no-vtu"],
    );
    place.fails("view none.pvd -o page.html", &["none.pvd"]);
    let collection = std::fs::read_to_string(place.path("run/surface.pvd")).unwrap();
    let with = |text: String, fragments: &[&str]| {
        std::fs::write(place.path("run/surface.pvd"), text).unwrap();
        place.fails("view run -o page.html", fragments);
    };
    with(collection[..collection.len() / 2].into(), &["run/surface.pvd"]);
    with("frames".into(), &["run/surface.pvd", "VTKFile"]);
    let empty = "<VTKFile type=\"Collection\"><Collection></Collection></VTKFile>";
    with(empty.into(), &["run/surface.pvd", "lists no files"]);
    with(
        collection.replace("timestep=\"3\"", "timestep=\"2\""),
        &["run/surface.pvd", "one surface for each time"],
    );
    with(
        collection.replace("timestep=\"11\"", "timestep=\"12\""),
        &["energy.csv", "has no row for the time 12"],
    );
    with(
        collection.replace("surface/frame_00004.vtu", "surface/gone.vtu"),
        &["surface/gone.vtu"],
    );
    with(
        collection.replace("surface/frame_00004.vtu", "cells/frame_00004.vtu"),
        &["cells/frame_00004.vtu", "files of surfaces"],
    );
    std::fs::write(place.path("run/surface.pvd"), &collection).unwrap();
    place.fails("view run/cells.pvd -o page.html", &["cells.pvd", "`surface.pvd`"]);

    let table = std::fs::read_to_string(place.path("run/energy.csv")).unwrap();
    let with_table = |text: String, fragments: &[&str]| {
        std::fs::write(place.path("run/energy.csv"), text).unwrap();
        place.fails("view run -o page.html", fragments);
    };
    let renamed = table.replace("deformation_energy,", "energy,");
    with_table(
        renamed,
        &["energy.csv` has no column `deformation_energy`", "move it away"],
    );
    with_table(table.replace("0e0", "zero"), &["energy.csv", "`zero` is no"]);
    std::fs::write(place.path("run/energy.csv"), &table).unwrap();

    let other = shapes::sphere(1.0, 1);
    io::write_surface(place.path("run/surface/frame_00005.vtu"), &other).unwrap();
    place.fails("view run -o page.html", &["frame_00005.vtu", "one connectivity"]);
    assert!(!place.path("page.html").exists());
}

#[test]
fn a_sequence_without_surfaces_has_no_page() {
    let place = Workplace::new();
    place.surface("ball.ply", &shapes::sphere(1.0, 1));
    let line = "sequence ball.ply ball.ply -o run --resolution 6";
    let refused = place.run(&format!("{line} --no-vtu --html page.html"));
    assert_eq!(refused.status.code(), Some(2));
    place.fails(
        &format!("{line} --html page.png"),
        &["`page.png`", "name it .html or .htm"],
    );
    assert!(!place.path("run").exists());
}
