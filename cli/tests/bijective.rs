//! `solidmap bijective` and `fit --bijective`: made, stored, chosen by other commands, and refused where there is none.

use crate::workplace::Workplace;
#[cfg(feature = "native")]
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::shapes;

fn bent(p: &solidmap::Point) -> solidmap::Point {
    solidmap::Point::new(p.x + 0.3 * p.y * p.y, 1.5 * p.y, p.z + 0.2 * p.x * p.y)
}

/// A folder with `cube.map`, the map of a bent cube, and `cube.mesh`, tetrahedra of the cube.
fn cube() -> Workplace {
    let place = Workplace::new();
    let cube = shapes::cube(2.0, 4);
    place.surface("cube.obj", &cube);
    place.surface("bent.obj", &shapes::deformed(&cube, bent));
    place.ends_with(0, "fit cube.obj --image bent.obj -o cube.map");
    place.ends_with(0, "remesh cube.map --cells 6 -o out.mesh --domain-mesh cube.mesh");
    place
}

#[test]
fn the_bijective_map_is_stored_and_used_unless_the_harmonic_one_is_asked_for() {
    let place = cube();
    place.fails(
        "eval cube.map cube.obj -o x.csv --map bijective",
        &["holds no bijective map", "solidmap bijective cube.map"],
    );
    let report = place.report(0, "bijective cube.map --mesh cube.mesh -o both.map --json");
    assert_eq!(report["output"], "both.map");
    assert!(report["problem"].is_null() && report["bijective"]["refinement"]["deviation"].as_f64() <= Some(1e-3));
    let of_map = &report["bijective"];
    let number = |key: &str| of_map[key].as_f64().unwrap();
    assert!(
        number("min_scaled_jacobian") > 0.01 && number("difference_max") < 0.05,
        "{report}"
    );
    assert!(number("difference_rms") > 0.0 && number("tets") > 1000.0);
    let proof = if cfg!(feature = "native") {
        "one_to_one"
    } else {
        "not_checked"
    };
    assert_eq!(of_map["boundary"], proof);

    // Points inside, by either map; the boundary's vertices are the same by both.
    let points: Vec<f64> = (0..3000).map(|k| 0.97 * (1.7 * f64::from(k)).sin()).collect();
    io::write_npy(place.path("points.npy"), 3, &points).unwrap();
    for (choice, kind) in [
        ("", "bijective"),
        (" --map bijective", "bijective"),
        (" --map harmonic", "harmonic"),
    ] {
        let report = place.report(0, &format!("eval both.map points.npy -o {kind}.npy{choice} --json"));
        assert_eq!(report["map_kind"], kind);
    }
    let report = place.report(0, "eval cube.map points.npy -o old.npy --json");
    assert_eq!(report["map_kind"], "harmonic");
    let bytes = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert!(bytes("old.npy") == bytes("harmonic.npy") && bytes("old.npy") != bytes("bijective.npy"));
    let report = place.report(0, "eval both.map bijective.npy -o back.csv --inverse --json");
    assert_eq!(
        (&report["ok"], &report["map_kind"]),
        (&1000.into(), &"bijective".into())
    );
    assert!(report["round_trip_max"].as_f64().unwrap() <= 1e-12, "{report}");
    let back = io::read_points(place.path("back.csv")).unwrap();
    for (given, found) in points.chunks(3).zip(&back) {
        assert!((0..3).all(|k| (given[k] - found[k]).abs() < 1e-12), "{given:?} {found}");
    }

    let exact = place.report(0, "energy both.map --json");
    assert_eq!(
        (&exact["map_kind"], &exact["folded"]["points"]),
        (&"bijective".into(), &0.into())
    );
    assert_eq!(exact["cells"], of_map["tets"]);
    let harmonic = place.report(0, "energy both.map --map harmonic --json");
    let energy = |report: &serde_json::Value| report["harmonic_energy"].as_f64().unwrap();
    // Dirichlet's principle, up to the boundary error of the one and the coarse tetrahedra of the other.
    assert!(
        energy(&exact) > energy(&harmonic) && energy(&exact) < 1.1 * energy(&harmonic),
        "{exact}"
    );

    let proved = place.report(0, "certify both.map --json");
    assert_eq!(proved["one_to_one"], cfg!(feature = "native"));
    assert_eq!((&proved["tets"], &proved["mirrored"]), (&of_map["tets"], &false.into()));
    place.fails("certify both.map --png x.png", &["--map harmonic"]);
    let report = place.report(0, "certify both.map --map harmonic --finest 64 --json");
    assert_eq!(report["map_kind"], "harmonic");

    let report = place.report(0, "transfer both.map --distance --at bent.obj -o distance.vtu --json");
    assert_eq!(
        (&report["map_kind"], &report["inverse"]["ok"]),
        (&"bijective".into(), &report["inverse"]["points"])
    );
}

#[test]
fn where_there_is_no_bijective_map_nothing_is_written_and_the_reason_is_told() {
    let place = cube();
    place.surface(
        "mirrored.obj",
        &shapes::deformed(&shapes::cube(2.0, 4), |p| [-p.x, p.y, p.z].into()),
    );
    place.ends_with(0, "fit cube.obj --image mirrored.obj -o mirrored.map");
    let before = std::fs::read(place.path("mirrored.map")).unwrap();
    place.fails(
        "bijective mirrored.map --mesh cube.mesh",
        &["mirrored.map", "mirrors the solid"],
    );
    place.fails(
        "remesh mirrored.map --cells 4 -o x.mesh",
        &["mirrored.map", "mirrors the solid"],
    );
    assert_eq!(std::fs::read(place.path("mirrored.map")).unwrap(), before);
    place.surface("large.obj", &shapes::cube(3.0, 4));
    place.ends_with(0, "remesh cube.map --cells 4 -o other.mesh");
    place.fails("bijective cube.map --mesh other.mesh", &["cube.map"]);
    place.fails("bijective cube.map -o x.txt", &["x.txt"]);
}

#[test]
fn a_fit_of_a_tet_mesh_makes_the_bijective_map_over_its_tetrahedra() {
    let place = cube();
    let mesh = io::read_cells(place.path("cube.mesh")).unwrap();
    let moved = mesh.with_nodes(mesh.nodes().iter().map(bent).collect()).unwrap();
    io::write_cell_mesh(place.path("moved.mesh"), &moved).unwrap();
    let report = place.report(0, "fit cube.mesh --image moved.mesh -o fitted.map --bijective --json");
    assert_eq!(report["bijective"]["tets"], mesh.cells().len());
    place.ends_with(0, "certify fitted.map");
}

/// Directions of a cube's points: bent within its two triangles on each side, so that the boundary is refined first.
#[cfg(feature = "native")]
#[test]
fn a_boundary_map_that_bends_within_triangles_is_followed() {
    let place = Workplace::new();
    place.surface(
        "cube.obj",
        &shapes::deformed(&shapes::cube(2.0, 2), |p| Point::new(p.x, 1.2 * p.y, p.z)),
    );
    let report = place.report(0, "fit cube.obj --target sphere -o ball.map --bijective --json");
    let found = &report["bijective"];
    assert!(found["refinement"]["nodes_added"].as_f64().unwrap() > 100.0, "{found}");
    assert!(found["refinement"]["deviation"].as_f64().unwrap() <= 1e-3, "{found}");
    assert_eq!(found["boundary"], "one_to_one");
    assert!(found["gap"].as_f64().unwrap() < 2e-3, "{found}");
    place.surface("sphere.obj", &shapes::sphere(0.98, 3));
    let report = place.report(0, "eval ball.map sphere.obj -o back.obj --inverse --json");
    assert_eq!(report["ok"], report["points"], "{report}");
}
