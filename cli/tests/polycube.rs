//! `solidmap polycube`: files that `fit` and `remesh` take, and what is said where there is none.

use solidmap::io;
use solidmap::mesh::shapes;

use crate::workplace::{Workplace, text, write_impossible_stairs, write_turned_boxes};

/// Tetrahedra of a bent bar, made by the program, in `bar.mesh`; their surface in `bar.obj`.
fn bar() -> Workplace {
    let place = Workplace::new();
    let boxes = shapes::polycube(&[[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0]], 1);
    let bent = |p: &solidmap::Point| solidmap::Point::new(p.x, p.y + 0.1 * p.x * p.x, p.z + 0.15 * p.y * p.x);
    place.surface("boxes.obj", &boxes);
    place.surface("bent.obj", &shapes::deformed(&boxes, bent));
    place.ends_with(0, "fit boxes.obj --image bent.obj -o bent.map --tolerance 0.01");
    place.ends_with(0, "remesh bent.map --cells 9 -o bar.mesh");
    let surface = io::read_tets(place.path("bar.mesh")).unwrap().boundary().surface;
    place.surface("bar.obj", &surface);
    place
}

#[test]
fn a_polycube_is_fitted_and_its_hexahedra_are_carried_into_the_model() {
    let place = bar();
    let report = place.report(
        0,
        "polycube bar.mesh -o p.obj --image m.ply --tets p.mesh --model-tets m.vtu --json",
    );
    let found = &report["polycube"];
    assert_eq!(
        (found["charts"].as_u64(), found["labels"].as_str()),
        (Some(8), Some("cut"))
    );
    assert_eq!(
        (found["inverted"].as_u64(), found["crossings"].as_u64()),
        (Some(0), Some(0))
    );
    assert_eq!(
        (&report["output"], &report["image"]),
        (&"p.obj".into(), &"m.ply".into())
    );
    let [polycube, model] = ["p.obj", "m.ply"].map(|name| io::read_surface(place.path(name)).unwrap());
    assert_eq!(polycube.triangles(), model.triangles());
    let given = io::read_surface(place.path("bar.obj")).unwrap();
    assert!((model.volume() - given.volume()).abs() < 1e-6 * given.volume());
    let [images, cells] = ["p.mesh", "m.vtu"].map(|name| io::read_tets(place.path(name)).unwrap());
    assert_eq!(images.tets(), cells.tets());
    assert!((0..cells.tets().len()).all(|t| images.signed_volume(t) > 0.0 && cells.signed_volume(t) > 0.0));

    place.ends_with(0, "fit p.obj --image m.ply -o p.map --tolerance 0.01");
    let report = place.report(0, "remesh p.map --kind hex --cells 12 -o hexes.vtu --json");
    assert_eq!(report["after"]["inverted"].as_u64(), Some(0), "{report}");
    let hexes = io::read_cells(place.path("hexes.vtu")).unwrap();
    assert!((hexes.volume() / given.volume() - 1.0).abs() < 0.05);

    // Another number of charts is asked for, and the text says what was found.
    let output = place.ends_with(
        0,
        "polycube bar.mesh -o q.obj --image n.obj --smoothness 0.005 --features 40",
    );
    let text = text(&output.stdout);
    assert!(
        text.contains("graph cut with smoothness 0.005")
            && text.contains("100 % of the length of edges sharper than 40°")
            && text.contains("written"),
        "{text}"
    );
}

#[test]
fn planes_are_on_the_lattice_that_is_asked_for_or_it_is_said() {
    let place = bar();
    let line = "polycube bar.mesh -o p.obj --image m.obj --lattice 0.25 --json";
    let report = place.report(0, line);
    assert_eq!(report["polycube"]["lattice"].as_f64(), Some(0.25));
    let polycube = io::read_surface(place.path("p.obj")).unwrap();
    let planes = solidmap::remesh::Polycube::of(&polycube).unwrap();
    for plane in planes.planes().iter().flatten() {
        assert!((plane / 0.25 - (plane / 0.25).round()).abs() < 1e-9, "{plane}");
    }
    place.fails(
        "polycube bar.mesh -o p.obj --image m.obj --lattice 0",
        &["bar.mesh", "size 0"],
    );
}

#[test]
fn a_model_is_meshed_in_one_go_and_what_led_there_is_kept() {
    let place = bar();
    let report = place.report(
        0,
        "hexmesh bar.mesh -o hexes.msh --cells 12 --keep kept --png hexes.png --json",
    );
    assert_eq!(report["mesh"]["inverted_cells"].as_u64(), Some(0), "{report}");
    assert!(report["mesh"]["quality"]["min_scaled_jacobian"].as_f64() > Some(0.05));
    assert!(report["polycube"]["lattice"].as_f64() > Some(0.0) && report["problem"].is_null());
    assert_eq!(
        (&report["output"], &report["keep"]),
        (&"hexes.msh".into(), &"kept".into())
    );
    let given = io::read_tets(place.path("bar.mesh")).unwrap().volume();
    let hexes = io::read_cells(place.path("hexes.msh")).unwrap();
    assert!((hexes.volume() / given - 1.0).abs() < 0.05);
    assert!(place.path("hexes.png").exists());

    // What is kept is what the single commands take.
    let again = place.report(
        0,
        "remesh kept/map.safetensors --kind hex --cells 12 -o again.vtu --json",
    );
    assert_eq!(again["after"]["inverted"].as_u64(), Some(0));
    place.ends_with(
        0,
        "fit kept/polycube.obj --image kept/model.obj -o q.map --tolerance 0.01",
    );
    let [domain, image] =
        ["polycube_tets", "model_tets"].map(|name| io::read_tets(place.path(&format!("kept/{name}.vtu"))).unwrap());
    assert_eq!(domain.tets(), image.tets());
    assert_eq!(
        io::read_cells(place.path("kept/domain.vtu")).unwrap().cells().len(),
        hexes.cells().len()
    );

    // What is kept never replaces the model or the mesh.
    std::fs::copy(place.path("kept/model.obj"), place.path("model.obj")).unwrap();
    place.fails("hexmesh model.obj -o other.msh --keep .", &["model.obj"]);
    place.fails("hexmesh bar.mesh -o kept/domain.vtu --keep kept", &["domain.vtu"]);

    let output = place.ends_with(0, "hexmesh bar.mesh -o tets.vtu --kind tet --cell-size 0.3");
    let text = text(&output.stdout);
    assert!(
        text.contains("tetrahedra") && text.contains("in all") && text.contains("lattice"),
        "{text}"
    );
}

#[test]
fn voxels_are_a_polycube_too_and_a_mesh_that_misses_a_part_of_the_model_is_no_success() {
    let place = bar();
    let line = "hexmesh bar.mesh -o v.vtu --polycube voxels --cells 16 --keep voxels";
    let report = place.report(0, &format!("{line} --json"));
    assert_eq!(report["mesh"]["inverted_cells"].as_u64(), Some(0), "{report}");
    assert!(report["polycube"].is_null() && report["voxels"]["missed"].as_u64() == Some(0));
    let given = io::read_tets(place.path("bar.mesh")).unwrap().volume();
    let hexes = io::read_cells(place.path("v.vtu")).unwrap();
    assert!((hexes.volume() / given - 1.0).abs() < 0.05);
    // The map is kept, and the polycube, of which there are no tetrahedra.
    let again = place.report(0, "remesh voxels/map.safetensors --kind hex --cells 16 -o a.vtu --json");
    assert_eq!(again["after"]["inverted"].as_u64(), Some(0));
    let polycube = io::read_surface(place.path("voxels/polycube.obj")).unwrap();
    let voxels = report["voxels"]["voxels"].as_f64().unwrap() * report["voxels"]["size"].as_f64().unwrap().powi(3);
    assert!((polycube.volume() / voxels - 1.0).abs() < 1e-9);
    assert!(!place.path("voxels/polycube_tets.vtu").exists());

    let output = place.ends_with(1, &format!("{line} --max-distance 1e-9"));
    let (text, said) = (text(&output.stdout), text(&output.stderr));
    assert!(
        text.contains("voxels of") && said.contains("--max-distance"),
        "{text}{said}"
    );
    assert!(place.path("v.vtu").exists());
    place.fails(&format!("{line} --max-distance 0"), &["--max-distance"]);
    let ring = [
        [0, 0, 0],
        [1, 0, 0],
        [2, 0, 0],
        [2, 1, 0],
        [2, 2, 0],
        [1, 2, 0],
        [0, 2, 0],
        [0, 1, 0],
    ];
    let second = [[3, 0, 0], [4, 0, 0], [4, 1, 0], [4, 2, 0], [3, 2, 0]];
    let place_of = |name: &str, voxels: &[[i32; 3]]| {
        place.surface(name, &solidmap::mesh::shapes::polycube(voxels, 1));
    };
    place_of("ring.obj", &ring);
    place_of("rings.obj", &[ring.as_slice(), &second].concat());
    if cfg!(feature = "native") {
        for rings in ["ring.obj", "rings.obj"] {
            let report = place.report(
                0,
                &format!("hexmesh {rings} -o r.vtu --polycube voxels --cells 15 --json"),
            );
            assert!(report["voxels"]["voxels"].as_u64() > Some(8) && report["mesh"]["inverted_cells"] == 0);
        }
    }
}

/// Voxels, and simplified models, have a boundary map whose images lie on the model's own surface.
#[test]
fn polycubes_with_other_triangles_than_the_model_s_come_with_a_boundary_file() {
    let place = bar();
    let given = io::read_surface(place.path("bar.obj")).unwrap();
    let on_model = solidmap::geometry::SurfaceQuery::new(&given).unwrap();
    let fits = |options: &str, found: &str| {
        let line = "polycube bar.mesh -o p.obj --image m.obj --boundary b.safetensors --lattice 0.25 --write-labels l.txt \
                    --write-model-labels given.txt --png p.png --html p.html --json";
        let report = place.report(0, &format!("{line} {options}"));
        assert!(
            report[found].is_object() && report["boundary_file"] == "b.safetensors",
            "{report}"
        );
        let image = io::read_surface(place.path("m.obj")).unwrap();
        let farthest = image
            .vertices()
            .iter()
            .map(|p| on_model.closest_point(p).distance)
            .fold(0.0, f64::max);
        assert!(farthest < 1e-9, "{farthest}");
        let lines = |name: &str| std::fs::read_to_string(place.path(name)).unwrap().lines().count();
        assert_eq!(lines("l.txt"), image.triangles().len());
        assert_eq!(lines("given.txt"), given.triangles().len());
        assert!(place.path("p.png").exists() && place.path("p.html").exists());
        place.ends_with(0, "fit p.obj --boundary b.safetensors -o b.map --tolerance 0.01");
        let report = place.report(0, "remesh b.map --kind hex --cell-size 0.25 -o hexes.vtu --json");
        assert_eq!(report["after"]["inverted"].as_u64(), Some(0), "{report}");
        let hexes = io::read_cells(place.path("hexes.vtu")).unwrap();
        assert!((hexes.volume() / given.volume() - 1.0).abs() < 0.05);
    };
    fits("--polycube voxels", "voxels");
    let planes = solidmap::remesh::Polycube::of(&io::read_surface(place.path("p.obj")).unwrap()).unwrap();
    // The lattice of voxels lies as the model does, not through the origin.
    for planes in planes.planes() {
        for plane in planes {
            let cells = (plane - planes[0]) / 0.25;
            assert!((cells - cells.round()).abs() < 1e-9, "{plane}");
        }
    }
    if cfg!(feature = "native") {
        fits("--polycube deformed --max-vertices 50", "simplified");
    }
    place.fails(
        "polycube bar.mesh -o p.obj --image m.obj --polycube voxels --tets t.vtu",
        &["--tets", "voxels"],
    );
    place.fails(
        "polycube bar.mesh -o p.obj --image m.obj --polycube voxels --lattice -1",
        &["bar.mesh", "size -1"],
    );
}

#[test]
fn labels_are_written_and_used_again() {
    let place = bar();
    let report = place.report(
        0,
        "polycube bar.mesh -o p.obj --image m.obj --write-labels l.txt --write-model-labels given.txt --tets p.vtu --json",
    );
    assert_eq!(
        (&report["labels"], &report["model_labels"]),
        (&"l.txt".into(), &"given.txt".into())
    );
    // A label for each triangle of the image, in its order: the direction that the polycube's triangle faces along.
    let names = ["-x", "+x", "-y", "+y", "-z", "+z"];
    let polycube = io::read_surface(place.path("p.obj")).unwrap();
    let written = std::fs::read_to_string(place.path("l.txt")).unwrap();
    let faces_along = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| polycube.vertices()[v as usize]);
        let area = (b - a).cross(&(c - a));
        let axis = area.iamax();
        names[2 * axis + usize::from(area[axis] > 0.0)]
    };
    let expected: Vec<&str> = polycube.triangles().iter().map(faces_along).collect();
    assert_eq!(written.lines().collect::<Vec<_>>(), expected);

    // The same polycube, byte for byte, from the labels of the model; also by their numbers.
    let given = std::fs::read_to_string(place.path("given.txt")).unwrap();
    let numbers = given
        .lines()
        .map(|name| format!("{}\n", names.iter().position(|n| *n == name).unwrap()));
    std::fs::write(place.path("numbers.txt"), numbers.collect::<String>()).unwrap();
    for labels in ["given.txt", "numbers.txt"] {
        let line = format!("polycube bar.mesh -o q.obj --image n.obj --tets q.vtu --labels {labels} --json");
        let report = place.report(0, &line);
        assert_eq!(report["polycube"]["labels"].as_str(), Some("given"));
        for [first, second] in [["p.obj", "q.obj"], ["m.obj", "n.obj"], ["p.vtu", "q.vtu"]] {
            let [first, second] = [first, second].map(|name| std::fs::read(place.path(name)).unwrap());
            assert!(first == second, "{labels}");
        }
    }
    // Beside the surface in place of text.
    for surface in ["given.ply", "given.obj"] {
        let line =
            format!("polycube bar.mesh -o q.obj --image n.obj --labels given.txt --write-model-labels {surface}");
        place.ends_with(0, &line);
        let found = io::read_surface(place.path(surface)).unwrap();
        assert_eq!(found, io::read_surface(place.path("bar.obj")).unwrap());
        let line =
            format!("polycube bar.mesh -o q.obj --image n.obj --tets q.vtu --labels {surface} --write-labels l.ply");
        place.ends_with(0, &line);
        assert!(std::fs::read(place.path("p.obj")).unwrap() == std::fs::read(place.path("q.obj")).unwrap());
        assert_eq!(
            io::read_surface(place.path("l.ply")).unwrap(),
            io::read_surface(place.path("m.obj")).unwrap()
        );
    }
    place.fails(
        "polycube bar.mesh -o q.obj --image n.obj --labels bar.obj",
        &["bar.obj", "line", "+x"],
    );
    // The image has triangles of its own, and their labels.
    if cfg!(feature = "native") {
        let report = place.report(0, "polycube m.obj -o q.obj --image n.obj --labels l.txt --json");
        assert_eq!(report["polycube"]["charts"].as_u64(), Some(8));
    }

    // What cannot be used is refused by file and line.
    let with = |name: &str, lines: &[&str]| std::fs::write(place.path(name), lines.join("\n")).unwrap();
    let lines: Vec<&str> = given.lines().collect();
    let line = "polycube bar.mesh -o q.obj --image n.obj --labels";
    with("short.txt", &lines[..lines.len() - 1]);
    let end = format!("line {}", lines.len() - 1);
    place.fails(&format!("{line} short.txt"), &["short.txt", "bar.mesh", &end]);
    with("long.txt", &[&lines[..], &["+x"]].concat());
    let end = format!("line {}", lines.len() + 1);
    place.fails(&format!("{line} long.txt"), &["long.txt", &end]);
    with("word.txt", &[&["+x", "up"], &lines[2..]].concat());
    place.fails(&format!("{line} word.txt"), &["word.txt", "line 2", "`up`", "+z"]);
    with("all.txt", &vec!["+x"; lines.len()]);
    place.fails(&format!("{line} all.txt"), &["all.txt", "line 1", "whole part"]);
    let opposite = |name: &&str| names[names.iter().position(|n| n == name).unwrap() ^ 1];
    with("mirrored.txt", &lines.iter().map(opposite).collect::<Vec<_>>());
    place.fails(&format!("{line} mirrored.txt"), &["mirrored.txt", "exchanged"]);
    place.fails(&format!("{line} none.txt"), &["none.txt"]);
    place.fails(&format!("{line} given.txt --smoothness 0.01"), &["--smoothness"]);
    place.fails(
        "polycube bar.mesh -o q.obj --image n.obj --labels l --write-labels l",
        &["`l`"],
    );
}

#[test]
fn a_turned_model_has_a_polycube_along_the_axes() {
    let place = Workplace::new();
    write_turned_boxes(&place);
    let line = "polycube turned.mesh -o q.obj --image n.obj --orient";
    let report = place.report(0, &format!("{line} principal --json"));
    let energy = report["polycube"]["energy"].as_f64().unwrap();
    assert!((energy - 7.0).abs() < 1e-6, "{energy}");
    assert!(report["polycube"]["turn"][0][0].as_f64() < Some(1.0));
    let best = place.report(0, &format!("{line} best --json"));
    assert!(best["polycube"]["energy"].as_f64() <= Some(energy));
    let given = place.report(0, &format!("{line} given --json"));
    assert!(given["polycube"]["turn"].is_null());
    let said = text(&place.ends_with(0, &format!("{line} principal")).stdout);
    assert!(said.contains("turned") && said.contains('°'), "{said}");
}

#[test]
fn where_no_polycube_is_found_the_best_attempt_is_written_and_its_bad_places_are_named() {
    let place = Workplace::new();
    write_impossible_stairs(&place);
    let line = "polycube block.mesh -o q.obj --image n.obj --labels stairs.txt --best-attempt";
    for file in ["best.vtu", "best.vtk"] {
        let report = place.report(1, &format!("{line} {file} --json"));
        assert_eq!(report["best_attempt"].as_str(), Some(file));
        assert!(report["output"].is_null() && !place.path("q.obj").exists());
        let problem = report["problem"].as_str().unwrap();
        assert!(
            problem.contains("near (") && problem.contains("`--polycube voxels`, without labels"),
            "{problem}"
        );
        let places = report["bad_places"].as_array().unwrap();
        let cells: u64 = places.iter().map(|place| place["cells"].as_u64().unwrap()).sum();
        let written = io::read_fields(place.path(file)).unwrap();
        let field = |name: &str| &written.cell.iter().find(|field| field.name == name).unwrap().values;
        assert_eq!(field("bad").iter().sum::<f64>() as u64, cells);
        assert!(cells > 0 && field("bad").iter().all(|bad| *bad == 0.0 || *bad == 1.0));
        assert!(field("label").contains(&-1.0) && field("label").contains(&5.0));
        // The points of the model, and the cells where they are in the attempt.
        let model = &written.point.iter().find(|field| field.name == "model").unwrap().values;
        let given = io::read_tets(place.path("block.mesh")).unwrap();
        for (p, values) in given.vertices().iter().zip(model.chunks(3)) {
            assert!((p - solidmap::Point::from_slice(values)).norm() < 1e-12);
        }
    }
    let said = text(&place.ends_with(1, &format!("{line} best.vtu")).stderr);
    assert!(
        said.contains("only the best attempt") && said.contains("best.vtu"),
        "{said}"
    );
    place.fails(&format!("{line} best.mesh"), &["best.mesh", ".vtu"]);
    // Nothing is written where a polycube is found.
    let line = "polycube block.mesh -o q.obj --image n.obj --best-attempt none.vtu --json";
    assert!(place.report(0, line)["best_attempt"].is_null() && !place.path("none.vtu").exists());
}

#[cfg(feature = "native")]
#[test]
fn a_surface_is_filled_and_the_result_is_that_of_its_tetrahedra() {
    let place = bar();
    let report = place.report(0, "polycube bar.obj -o p.obj --image m.obj --json");
    assert_eq!(report["polycube"]["charts"].as_u64(), Some(8));
    assert!(report["tets"].is_null() && report["problem"].is_null());
}

#[test]
fn models_and_options_that_cannot_be_used_are_refused() {
    let place = Workplace::new();
    place.surface("cube.obj", &shapes::cube(1.0, 2));
    place.fails("polycube cube.obj -o p.obj --image p.obj", &["p.obj"]);
    place.fails("polycube cube.obj -o p.stl --image m.obj", &["p.stl", ".obj"]);
    place.fails("polycube missing.obj -o p.obj --image m.obj", &["missing.obj"]);
    place.fails("hexmesh missing.obj -o h.msh --keep kept", &["missing.obj"]);
    assert!(!place.path("kept").exists(), "no empty folder is left");
    place.fails("hexmesh cube.obj -o h.stl", &["h.stl", ".msh"]);
    place.fails("hexmesh cube.obj -o h.msh --cells 0", &["--cells"]);
    if cfg!(feature = "native") {
        place.fails(
            "polycube cube.obj -o p.obj --image m.obj --features 180",
            &["cube.obj", "angle of sharp edges is 180"],
        );
        place.fails(
            "polycube cube.obj -o p.obj --image m.obj --smoothness 0",
            &["cube.obj", "smoothness is 0"],
        );
    } else {
        place.fails("polycube cube.obj -o p.obj --image m.obj", &["TetGen", "tet mesh"]);
    }
}
