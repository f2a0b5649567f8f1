//! `solidmap remesh` from the command line: how files mark cells that stay inverted.

use std::collections::{BTreeMap, BTreeSet};

use crate::common::models;
use crate::workplace::{Workplace, text};
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::{CellMesh, shapes};

/// A folder with `cube.map`, the identity of a cube, and `mirrored.map`, which turns it inside out.
fn cubes() -> Workplace {
    let place = Workplace::new();
    let cube = shapes::cube(2.0, 2);
    io::write_surface(place.path("cube.obj"), &cube).unwrap();
    let mirrored = shapes::deformed(&cube, |p| Point::new(-p.x, p.y, p.z));
    io::write_surface(place.path("mirrored.obj"), &mirrored).unwrap();
    place.ends_with(0, "fit cube.obj --image cube.obj -o cube.map");
    place.ends_with(0, "fit cube.obj --image mirrored.obj -o mirrored.map");
    place
}

/// Names of physical groups of cells, and how many tetrahedra each has.
fn groups_of_tets(msh: &str) -> (BTreeMap<i32, String>, BTreeMap<i32, usize>) {
    let section = |name: &str| {
        let rest = msh.split(&format!("${name}\n")).nth(1).unwrap();
        rest.split("\n$End").next().unwrap().lines().skip(1)
    };
    let names = section("PhysicalNames").filter_map(|line| line.strip_prefix("3 "));
    let names = names.map(|line| line.split_once(' ').unwrap());
    let names = names.map(|(tag, name)| (tag.parse().unwrap(), name.trim_matches('"').to_owned()));
    let mut counts = BTreeMap::new();
    for line in section("Elements") {
        let numbers: Vec<i32> = line.split(' ').map(|n| n.parse().unwrap()).collect();
        if numbers[1] == 4 {
            assert_eq!((numbers[2], numbers[3]), (2, numbers[4]));
            *counts.entry(numbers[3]).or_insert(0) += 1;
        }
    }
    (names.collect(), counts)
}

#[test]
fn inverted_cells_have_groups_of_their_own() {
    let place = cubes();
    place.ends_with(0, "remesh cube.map --cells 4 -o right.mesh");
    let right = io::read_cells(place.path("right.mesh")).unwrap();
    let whole = right.cells().len();
    assert!(right.regions().iter().all(|region| *region == 1));
    let written = std::fs::read_to_string(place.path("right.mesh")).unwrap();
    assert!(!written.contains("inverted"), "{written:.300}");
    place.ends_with(0, "remesh cube.map --cells 4 -o right.msh");
    let (names, counts) = groups_of_tets(&std::fs::read_to_string(place.path("right.msh")).unwrap());
    assert_eq!(names, BTreeMap::from([(1, "label 1".to_owned())]));
    assert_eq!(counts, BTreeMap::from([(1, whole)]));

    // All cells are inverted, those with all corners on the boundary for a reason that is known.
    let report = place.report(1, "remesh mirrored.map --cells 4 -o all.msh --no-repair --json");
    assert_eq!(report["inverted_cells"], whole);
    let places = report["worst_places"].as_array().unwrap();
    assert_eq!((places.len(), &places[0]["kind"]), (1, &"inverted".into()), "{report}");
    assert_eq!(places[0]["count"], whole);
    assert!((places[0]["measure"].as_f64().unwrap() - 8.0).abs() < 1e-9, "{report}");
    assert_eq!(places[0]["low"], serde_json::json!([-1.0, -1.0, -1.0]));
    let (names, counts) = groups_of_tets(&std::fs::read_to_string(place.path("all.msh")).unwrap());
    for (reason, name) in [
        ("unknown", "inverted"),
        ("boundary", "inverted, obstacle 1 (corner on the boundary alone)"),
        ("blocked_node", "inverted, obstacle 2 (node without a right place)"),
        ("folded_quad", "inverted, obstacle 3 (folded boundary quad)"),
    ] {
        let tag = names.iter().find(|(_, found)| *found == name).map(|(tag, _)| tag);
        let count = tag.map_or(0, |tag| counts[tag]);
        assert_eq!(report["reasons"][reason], count, "{names:?}");
    }
    assert_eq!(counts.values().sum::<usize>(), whole);
    let msh = std::fs::read_to_string(place.path("all.msh")).unwrap();
    let of_faces = msh
        .lines()
        .filter_map(|line| line.strip_prefix("2 ")?.split_once(" \"face"));
    let of_faces: BTreeSet<i32> = of_faces.map(|(tag, _)| tag.parse().unwrap()).collect();
    assert!(of_faces.len() == 6 && names.keys().all(|tag| !of_faces.contains(tag)));
}

#[test]
fn references_of_inverted_cells_are_explained_and_know_their_region() {
    let place = cubes();
    place.ends_with(0, "remesh cube.map --cells 2 -o given.mesh");
    let written = std::fs::read_to_string(place.path("given.mesh")).unwrap();
    let (head, cells) = written.split_once("Tetrahedra\n").unwrap();
    let (count, cells) = cells.split_once('\n').unwrap();
    let in_two = cells
        .lines()
        .enumerate()
        .map(|(k, line)| match line.strip_suffix(" 1") {
            Some(cell) => format!("{cell} {}\n", if k % 3 == 0 { -4 } else { 7 }),
            None => format!("{line}\n"),
        });
    let given = format!("{head}Tetrahedra\n{count}\n{}", in_two.collect::<String>());
    std::fs::write(place.path("given.mesh"), given).unwrap();
    let output = place.ends_with(1, "remesh mirrored.map --mesh given.mesh --no-repair -o carried.mesh");
    assert!(text(&output.stderr).contains("their references are explained in its header"));

    let before = io::read_cells(place.path("given.mesh")).unwrap();
    let after = io::read_cells(place.path("carried.mesh")).unwrap();
    let written = std::fs::read_to_string(place.path("carried.mesh")).unwrap();
    let explained = written
        .lines()
        .filter_map(|line| line.strip_prefix("# cells of reference "));
    let explained: BTreeMap<i32, &str> = explained
        .map(|line| line.split_once(": ").unwrap())
        .map(|(reference, words)| (reference.parse().unwrap(), words))
        .collect();
    assert!(explained.len() >= 2 && explained.keys().all(|r| ![-4, 7].contains(r)));
    assert_eq!(before.regions().len(), after.regions().len());
    for (region, reference) in before.regions().iter().zip(after.regions()) {
        let words = explained[reference];
        assert!(
            words.starts_with("inverted") && words.ends_with(&format!(", of region {region}")),
            "{words}"
        );
    }
}

#[test]
fn every_file_that_was_written_is_listed() {
    let place = cubes();
    let line = "remesh cube.map --cells 4 -o mesh.vtu --domain-mesh grid.msh --png picture.png";
    let words = text(&place.ends_with(0, line).stdout);
    let written = words.lines().find_map(|line| line.strip_prefix("written")).unwrap();
    assert_eq!(written.trim(), "mesh.vtu, grid.msh, picture.png", "{words}");
    let report = place.report(0, &format!("{line} --json"));
    for (key, file) in [
        ("output", "mesh.vtu"),
        ("domain_mesh", "grid.msh"),
        ("picture", "picture.png"),
    ] {
        assert_eq!(report[key], file, "{report}");
        assert!(place.path(file).exists());
    }
    let report = place.report(0, "remesh cube.map --cells 4 -o mesh.vtu --json");
    assert!(
        report["domain_mesh"].is_null() && report["picture"].is_null(),
        "{report}"
    );
}

#[test]
fn a_mesh_in_which_nothing_is_inverted_is_polished_only_with_the_option_and_the_report_says_so() {
    let place = cubes();
    place.ends_with(0, "remesh cube.map --cells 4 --kind hex -o hexes.mesh");
    // The same with inner nodes elsewhere: in cubes there is nothing to polish.
    let cubes = io::read_cells(place.path("hexes.mesh")).unwrap();
    let is_inside = |p: &Point| p.iter().all(|x| x.abs() < 0.99);
    let uneven = |p: &Point| match is_inside(p) {
        true => Point::new(
            p.x + 0.1 * (5.0 * p.y).sin(),
            p.y - 0.1 * (3.0 * p.z).cos(),
            p.z + 0.1 * (4.0 * p.x).sin(),
        ),
        false => *p,
    };
    let uneven = cubes.nodes().iter().map(uneven).collect();
    let uneven = CellMesh::new(uneven, cubes.cells().clone(), cubes.regions().to_vec()).unwrap();
    io::write_cell_mesh(place.path("uneven.mesh"), &uneven).unwrap();
    for (line, are_cubes) in [
        ("remesh cube.map --mesh uneven.mesh -o mesh.vtu", false),
        ("remesh cube.map --cells 4 --kind hex -o mesh.vtu", true),
    ] {
        let report = place.report(0, &format!("{line} --json"));
        assert_eq!(report["repair"]["polish"]["outcome"], "nothing_inverted", "{report}");
        assert_eq!(report["quality"], report["quality_as_mapped"], "{report}");
        let words = text(&place.ends_with(0, line).stdout);
        assert!(
            words.contains("as mapped        at least") && words.contains("--polish asks for it"),
            "{words}"
        );

        let report = place.report(0, &format!("{line} --polish 50 --json"));
        let polish = &report["repair"]["polish"];
        assert_eq!(polish["iterations"].as_u64() == Some(0), are_cubes, "{report}");
        assert_eq!(polish["outcome"] == "no_gain", are_cubes, "{report}");
        for key in ["min_scaled_jacobian", "p01_scaled_jacobian"] {
            let [now, mapped] = ["quality", "quality_as_mapped"].map(|at| report[at][key].as_f64().unwrap());
            assert!(now >= mapped, "{key}: {now} {mapped}");
        }
        let words = text(&place.ends_with(0, &format!("{line} --polish 0")).stdout);
        assert!(!words.contains("\npolish"), "{words}");
    }
}

#[test]
fn poor_hexahedra_are_warned_of_with_what_helps() {
    let place = cubes();
    place.ends_with(0, "remesh cube.map --cells 4 --kind hex -o hexes.mesh");
    let cubes = io::read_cells(place.path("hexes.mesh")).unwrap();
    // The node in the middle gets near the plane of three neighbours: with t = 0.16 and edges of 0.5 one corner has the scaled Jacobian
    // 0.25 (0.5 - 3t) / ((0.5 - t)^2 + 2t^2)^1.5 = 0.073, and its cell the centre (0.25 + t/8) (1, 1, 1).
    let pushed = |p: &Point| {
        if p.coords.norm() < 1e-6 {
            Point::new(0.16, 0.16, 0.16)
        } else {
            *p
        }
    };
    let nodes = cubes.nodes().iter().map(pushed).collect();
    let poor = CellMesh::new(nodes, cubes.cells().clone(), cubes.regions().to_vec()).unwrap();
    io::write_cell_mesh(place.path("poor.mesh"), &poor).unwrap();
    let line = "remesh cube.map --mesh poor.mesh -o mesh.vtu";
    for options in ["", " --polish 0"] {
        let words = text(&place.ends_with(0, &format!("{line}{options}")).stderr);
        let warning = "1 hexahedron has a scaled Jacobian below 0.1, the least 0.073 near (0.2700, 0.2700, 0.2700)";
        assert!(
            words.contains(warning) && words.contains("--polish 200 may help"),
            "{words}"
        );
    }
    for options in [" --polish 200", " --no-repair"] {
        let words = text(&place.ends_with(0, &format!("{line}{options}")).stderr);
        assert!(!words.contains("scaled Jacobian"), "{options}: {words}");
    }
}

#[test]
fn every_cell_that_stays_inverted_has_a_reason_in_words() {
    let place = cubes();
    // A side is drawn through the opposite one and a part of it back.
    let cube = shapes::cube(2.0, 8);
    io::write_surface(place.path("fine.obj"), &cube).unwrap();
    let pulled = shapes::deformed(&cube, |p| match p.x == 1.0 && p.y.abs() < 0.4 && p.z.abs() < 0.4 {
        true => Point::new(-3.0, p.y, p.z),
        false => *p,
    });
    io::write_surface(place.path("pulled.obj"), &pulled).unwrap();
    place.run("fit fine.obj --image pulled.obj -o pulled.map --tolerance 0.1");
    for (options, unknown) in [
        ("--fix-boundary", "for an unknown reason"),
        ("--no-repair", "that a repair may help"),
    ] {
        let line = format!("remesh pulled.map --cells 8 -o all.vtu {options}");
        let report = place.report(1, &format!("{line} --json"));
        let reasons = report["reasons"].as_object().unwrap();
        let counts: u64 = reasons.values().map(|count| count.as_u64().unwrap()).sum();
        assert_eq!(report["inverted_cells"], counts, "{report}");
        let warning = text(&place.ends_with(1, &line).stderr);
        let expected = reasons["unknown"].as_u64() > Some(0);
        assert_eq!(warning.contains(unknown), expected, "{warning}");
        assert!(!warning.contains("no reason"), "{warning}");
    }
}

#[test]
fn stuck_tetrahedra_are_split_unless_the_option_forbids_it() {
    let Some(models) = models() else { return };
    let place = Workplace::new();
    let model = |name: &str| models.join("maps").join(name).display().to_string();
    let fit = format!(
        "fit {} --image {} -o bird.map",
        model("bird_polycube.vtk"),
        model("bird_object.vtk")
    );
    place.ends_with(0, &fit);
    let line = "remesh bird.map --cell-size 0.06 --fix-boundary -o tets.mesh";
    let report = place.report(0, &format!("{line} --json"));
    let added = report["repair"]["split"]["cells_added"].as_u64().unwrap();
    assert!(added > 0 && report["inverted_cells"] == 0, "{report}");
    let words = text(&place.ends_with(0, line).stdout);
    assert!(words.contains(&format!("{added} cells added")), "{words}");

    let report = place.report(1, &format!("{line} --split-stuck off --json"));
    assert_eq!(report["repair"]["split"]["cells_added"], 0, "{report}");
    let warning = text(&place.ends_with(1, &format!("{line} --split-stuck off")).stderr);
    assert!(warning.contains("Leave out --split-stuck off"), "{warning}");
    place.ends_with(2, &format!("{line} --split-stuck some"));
}
