//! Meshes of tetrahedra and hexahedra from the command line: what `check` says of their cells, and that every command takes
//! hexahedra where vertices or a boundary suffice.

use crate::workplace::{Workplace, json, stderr, text};
use solidmap::Point;
use solidmap::io::{self, Cells, Field, SolidMesh, VtkFields};
use solidmap::mesh::{CellList, CellMesh, HEXAHEDRON, tets_of_hex};

const FORMATS: [&str; 4] = ["mesh", "msh", "vtk", "vtu"];

/// A cube of `4³` hexahedra with an edge of 2, in two regions.
fn cube() -> CellMesh {
    let place = |k: u32| Point::from([k % 5, k / 5 % 5, k / 25].map(|k| 0.5 * f64::from(k) - 1.0));
    let hex = |c: u32| {
        let low = [c % 4, c / 4 % 4, c / 16];
        HEXAHEDRON.map(|corner| {
            (0..3)
                .map(|k| (low[k] + u32::from(corner[k])) * 5u32.pow(k as u32))
                .sum()
        })
    };
    let hexes = CellList::Hexes((0..64).map(hex).collect());
    CellMesh::new(
        (0..125).map(place).collect(),
        hexes,
        (0..64).map(|c| 1 + c / 32).collect(),
    )
    .unwrap()
}

fn in_tets(mesh: &CellMesh) -> CellMesh {
    let CellList::Hexes(hexes) = mesh.cells() else {
        unreachable!()
    };
    let tets: Vec<[u32; 4]> = hexes.iter().flat_map(tets_of_hex).collect();
    let regions = vec![0; tets.len()];
    CellMesh::new(mesh.nodes().to_vec(), CellList::Tets(tets), regions).unwrap()
}

fn stretched(mesh: &CellMesh) -> CellMesh {
    let nodes = mesh
        .nodes()
        .iter()
        .map(|p| Point::new(1.5 * p.x + 0.2 * p.y, p.y, p.z - 0.1 * p.x));
    mesh.with_nodes(nodes.collect()).unwrap()
}

/// The mesh with its middle node moved through its neighbours.
fn folded(mesh: &CellMesh) -> CellMesh {
    let mut nodes = mesh.nodes().to_vec();
    nodes[62] = Point::new(0.63, 0.71, 0.57);
    mesh.with_nodes(nodes).unwrap()
}

/// A folder with the cube and its image in every format.
fn cubes() -> Workplace {
    let place = Workplace::new();
    for format in FORMATS {
        io::write_cell_mesh(place.path(&format!("cube.{format}")), &cube()).unwrap();
        io::write_cell_mesh(place.path(&format!("image.{format}")), &stretched(&cube())).unwrap();
    }
    place
}

#[test]
fn check_finds_cells_that_are_inverted_and_says_how_to_repair_them() {
    let place = cubes();
    for mesh in [folded(&in_tets(&cube())), folded(&cube())] {
        io::write_cell_mesh(place.path("folded.vtu"), &mesh).unwrap();
        let report = place.report(1, "check folded.vtu --json");
        let (cells, findings) = (&report["models"][0]["cell_mesh"], &report["models"][0]["findings"]);
        assert!(
            findings.as_array().unwrap().is_empty(),
            "the boundary is healthy: {findings}"
        );
        let inverted = cells["inverted_cells"].as_u64().unwrap();
        assert!(inverted > 0, "{cells}");
        let found = &cells["findings"][0];
        assert_eq!(
            (&found["kind"], &found["severity"]),
            (&"inverted_cells".into(), &"error".into())
        );
        assert_eq!(found["count"], inverted);
        assert_eq!(
            found["cells"].as_array().unwrap().len(),
            found["places"].as_array().unwrap().len()
        );
        let said = text(&place.ends_with(1, "check folded.vtu").stdout);
        for part in [
            "NOT VALID",
            "inverted (decided exactly",
            "; first cell",
            " at (",
            "solidmap remesh",
            "Healthy",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }

        // As the advice says.
        place.ends_with(0, "fit folded.vtu --image folded.vtu -o same.map");
        place.ends_with(0, "remesh same.map --mesh folded.vtu -o repaired.vtu");
        let repaired = place.report(0, "check repaired.vtu --json");
        assert_eq!(repaired["models"][0]["cell_mesh"]["inverted_cells"], 0);
    }
}

#[test]
fn notes_on_cells_are_no_failure() {
    let place = cubes();
    let (mut nodes, cells, regions) = in_tets(&cube()).into_parts();
    nodes.push(Point::new(5.0, 5.0, 5.0));
    let CellList::Tets(mut tets) = cells else {
        unreachable!()
    };
    tets.iter_mut().for_each(|tet| tet.swap(0, 1));
    let mesh = CellMesh::new(nodes, CellList::Tets(tets), regions).unwrap();
    io::write_cell_mesh(place.path("left.vtk"), &mesh).unwrap();
    let report = place.report(0, "check left.vtk cube.msh --json");
    let cells = &report["models"][0]["cell_mesh"];
    let kinds: Vec<&str> = cells["findings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f["kind"].as_str().unwrap())
        .collect();
    assert_eq!(kinds, ["left_handed_cells", "unused_vertices"]);
    assert_eq!(
        (&cells["kind"], &cells["cells"], &cells["vertices"]),
        (&"tets".into(), &384.into(), &126.into())
    );
    let cube = &report["models"][1]["cell_mesh"];
    assert_eq!(
        (&cube["kind"], &cube["cells"], &cube["min_scaled_jacobian"]),
        (&"hexes".into(), &64.into(), &1.0.into())
    );
    assert!(
        place.report(0, "check image.mesh --json")["models"][0]["volume"]
            .as_f64()
            .is_some()
    );
}

#[test]
fn every_command_takes_hexahedra() {
    let place = cubes();
    for format in FORMATS {
        let fit = place.report(
            0,
            &format!("fit cube.{format} --image image.{format} -o cube.map --json"),
        );
        assert_eq!((&fit["vertices"], &fit["faces"]), (&98.into(), &192.into()), "{format}");
    }
    let expected = stretched(&cube());
    for format in FORMATS {
        let report = place.report(0, &format!("eval cube.map cube.{format} -o out.{format} --json"));
        assert_eq!(
            (&report["points"], &report["inverted_cells"], &report["outside"]),
            (&125.into(), &0.into(), &0.into())
        );
        let out = io::read_cells(place.path(&format!("out.{format}"))).unwrap();
        assert_eq!(out.cells(), expected.cells(), "{format}");
        let farthest = out
            .nodes()
            .iter()
            .zip(expected.nodes())
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(farthest < 1e-9, "{format}: {farthest}");
        let has_regions = ["mesh", "msh"].contains(&format);
        assert_eq!(out.regions() == cube().regions(), has_regions, "{format}");
    }
    place.ends_with(0, "eval cube.map image.vtk --inverse -o back.vtu");
    let back = io::read_cells(place.path("back.vtu")).unwrap();
    assert!(
        back.nodes()
            .iter()
            .zip(cube().nodes())
            .all(|(a, b)| (a - b).norm() < 1e-8)
    );
    place.ends_with(0, "boundary check cube.mesh image.vtu --target image.msh");

    // Both integrate the constant densities of an affine map exactly.
    let over_hexes = place.report(0, "energy cube.map --mesh cube.vtu --vtu energy.vtu --json");
    let over_grid = place.report(0, "energy cube.map --json");
    for key in ["harmonic_energy", "deformation_energy", "volume"] {
        let [a, b] = [&over_hexes, &over_grid].map(|report| report[key].as_f64().unwrap());
        assert!((a / b - 1.0).abs() < 1e-9, "{key}: {a} {b}");
    }
    assert_eq!((&over_hexes["cells"], &over_hexes["points"]), (&64.into(), &512.into()));
    assert_eq!(
        io::read_cells(place.path("energy.vtu")).unwrap().cells(),
        cube().cells()
    );

    let report = place.report(0, "transfer cube.map --distance --at image.vtu -o distance.vtu --json");
    assert_eq!(report["without_value"], 0);
    assert_eq!(
        io::read_cells(place.path("distance.vtu")).unwrap().cells(),
        cube().cells()
    );
    let of_cells = Field {
        name: "part".into(),
        components: 1,
        values: (0..64).map(f64::from).collect(),
    };
    let fields = VtkFields {
        cell: vec![of_cells.clone()],
        ..VtkFields::default()
    };
    io::write_vtu(
        place.path("field.vtu"),
        cube().nodes(),
        Cells::from(cube().cells()),
        &fields,
    )
    .unwrap();
    let report = place.report(0, "transfer cube.map field.vtu --label part -o carried.vtu --json");
    assert_eq!((&report["hexes"], &report["tets"]), (&64.into(), &0.into()));
    let carried = io::read_fields(place.path("carried.vtu")).unwrap();
    assert_eq!((&carried.cells, &carried.cell[0]), (cube().cells(), &of_cells));
}

#[test]
fn what_cannot_take_hexahedra_says_what_to_give() {
    let place = cubes();
    let (tets, cube) = (in_tets(&cube()), cube());
    let mut mixed = std::fs::read_to_string(place.path("cube.mesh")).unwrap();
    mixed = mixed.replace("End", "Tetrahedra\n1\n1 2 6 26 0\nEnd");
    std::fs::write(place.path("mixed.mesh"), mixed).unwrap();
    let said = text(&place.ends_with(2, "check mixed.mesh").stdout);
    assert!(
        said.contains("1 tetrahedra and 64 hexahedra") && said.contains("or the boundary as a surface"),
        "{said}"
    );
    io::write_cell_mesh(place.path("tets.vtk"), &tets).unwrap();
    let refused = place.ends_with(2, "fit cube.mesh --image tets.vtk -o x.map");
    assert!(
        stderr(&refused).contains("64 hexahedrons and the image 0"),
        "{}",
        stderr(&refused)
    );
    assert_eq!(io::read_solid(place.path("cube.msh")).unwrap(), SolidMesh::Cells(cube));
    assert!(json(&place.ends_with(0, "check tets.vtk --json"))["models"][0]["cell_mesh"].is_object());
}

#[test]
fn energies_are_not_measured_over_cells_that_do_not_fill_the_domain() {
    let place = cubes();
    place.ends_with(0, "fit cube.vtk --image image.vtk -o cube.map");
    let refused = |name: &str, mesh: &CellMesh, words: &str| {
        io::write_cell_mesh(place.path(name), mesh).unwrap();
        let said = stderr(&place.ends_with(2, &format!("energy cube.map --mesh {name}")));
        assert!(said.contains(words) && said.contains(name), "{said}");
    };
    refused("folded.vtu", &folded(&cube()), "inverted");
    refused("folded.mesh", &folded(&in_tets(&cube())), "inverted");
    let by = |mesh: &CellMesh, step: f64| {
        let nodes = mesh.nodes().iter().map(|p| Point::new(p.x + step, p.y, p.z)).collect();
        mesh.with_nodes(nodes).unwrap()
    };
    refused("moved.vtu", &by(&cube(), 0.1), "away from its surface");
    let CellList::Hexes(mut hexes) = cube().cells().clone() else {
        unreachable!()
    };
    hexes.push(hexes[7]);
    let twice = CellMesh::new(cube().nodes().to_vec(), CellList::Hexes(hexes), vec![0; 65]).unwrap();
    refused("twice.vtu", &twice, "earlier one");
    // A little beside the domain: measured, with a warning.
    io::write_cell_mesh(place.path("near.vtu"), &by(&cube(), 0.01)).unwrap();
    let near = place.ends_with(0, "energy cube.map --mesh near.vtu");
    assert!(stderr(&near).contains("warning: boundary vertex"), "{}", stderr(&near));
}

/// The format of VOLMAP's data: a mesh of tetrahedra, and a line for the image of each boundary node.
#[test]
fn images_of_nodes_in_a_text_are_a_boundary_map_and_maps_of_meshes_are_measured() {
    let place = cubes();
    let (mesh, image) = (in_tets(&cube()), in_tets(&stretched(&cube())));
    io::write_cell_mesh(place.path("tets.mesh"), &mesh).unwrap();
    io::write_cell_mesh(place.path("image.mesh"), &image).unwrap();
    let boundary = mesh.boundary().vertex_ids;
    let line = |v: &u32| {
        let p = image.nodes()[*v as usize];
        format!("{v} {:?} {:?} {:?}\n", p.x, p.y, p.z)
    };
    // In any order.
    let lines: Vec<String> = boundary.iter().rev().map(line).collect();
    let write = |name: &str, text: &str| std::fs::write(place.path(name), text).unwrap();
    write("image.txt", &lines.concat());
    place.ends_with(0, "fit tets.mesh --image image.txt -o text.map");
    place.ends_with(0, "fit tets.mesh --image image.mesh -o mesh.map");
    place.ends_with(0, "eval text.map cube.vtu -o text.csv");
    place.ends_with(0, "eval mesh.map cube.vtu -o mesh.csv");
    let read = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert_eq!(read("text.csv"), read("mesh.csv"));
    place.ends_with(0, "boundary check tets.mesh image.txt");
    let refused = |text: &str, words: &str| {
        write("wrong.txt", text);
        let said = stderr(&place.ends_with(2, "fit tets.mesh --image wrong.txt -o x.map"));
        assert!(said.contains(words) && said.contains("wrong.txt"), "{said}");
    };
    refused(&lines[1..].concat(), "has no image");
    refused(&format!("{}{}", lines.concat(), lines[0]), "has two images");
    refused(&format!("{}125 0 0 0\n", lines.concat()), "is not in the mesh");
    refused("0 1 2\n", "line 1");

    place.ends_with(
        0,
        "remesh text.map --mesh tets.mesh --fix-boundary -o tets_output.mesh --domain-mesh tets_input.mesh",
    );
    let out = io::read_cells(place.path("tets_output.mesh")).unwrap();
    assert!(
        boundary
            .iter()
            .all(|&v| out.nodes()[v as usize] == image.nodes()[v as usize])
    );
    place.ends_with(
        0,
        "compare tets_input.mesh --image tets_output.mesh --metrics volmap.csv",
    );
    let table = String::from_utf8(read("volmap.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(
        rows[0][..5],
        ["map", "num_tets", "num_inv_tets", "conformal_min", "conformal_max"]
    );
    assert_eq!(rows[0].len(), rows[1].len());
    let value = |column: &str| -> f64 {
        let k = rows[0].iter().position(|name| *name == column).unwrap();
        rows[1][k].parse().unwrap()
    };
    assert_eq!((value("num_tets"), value("num_inv_tets")), (384.0, 0.0));
    // The map is affine: every tetrahedron has the Dirichlet energy of its matrix.
    let dirichlet = 1.5f64.powi(2) + 0.2f64.powi(2) + 1.0 + 1.0 + 0.1f64.powi(2);
    for column in ["dirichlet_min", "dirichlet_max", "dirichlet_E"] {
        assert!((value(column) - dirichlet).abs() < 1e-3, "{column}: {}", value(column));
    }
    io::write_cell_mesh(place.path("folded.mesh"), &folded(&mesh)).unwrap();
    let report = place.report(1, "compare tets.mesh --image folded.mesh --metrics v.csv --json");
    assert!(report["metrics"]["inverted"].as_u64().unwrap() > 0, "{report}");
    let said = stderr(&place.ends_with(2, "compare tets.mesh --image cube.mesh --metrics v.csv"));
    assert!(said.contains("cube.mesh"), "{said}");
}
