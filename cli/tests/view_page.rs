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
