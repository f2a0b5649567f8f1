//! `solidmap transfer` from the command line.

use crate::workplace::{Workplace, json, with_fitted_ball};
use serde_json::Value;
use solidmap::Point;
use solidmap::inverse::lattice_mesh;
use solidmap::io::{self, Cells, Field, VtkEncoding, VtkFields};
use solidmap::mesh::{CellList, CellMesh, shapes};

fn image(p: &Point) -> Point {
    Point::new(2.0 * p.x, p.y + 0.1 * p.x, 0.5 * p.z)
}

/// A folder with `map.safetensors`, an affine map of a ball.
fn with_map() -> Workplace {
    with_fitted_ball(image)
}

#[test]
fn columns_of_a_table_go_along_and_vectors_are_pushed_forward() {
    let place = with_map();
    let rows = "x,y,z,heat,vx,vy,vz\n0.1,0.2,0.3,7,1,0,0\n-0.4,0,0.2,8,0,0,1\n";
    std::fs::write(place.path("field.csv"), rows).unwrap();
    let report = place.report(0, "transfer map.safetensors field.csv -o out.csv --json");
    assert!(report["volume"]["relative_error"].as_f64().unwrap().abs() < 1e-3);
    let out = io::read_fields(place.path("out.csv")).unwrap();
    assert_eq!(out.point[0].values, [7.0, 8.0]);
    assert_eq!((out.point[1].name.as_str(), out.point[1].components), ("v", 3));
    let expected = [2.0, 0.1, 0.0, 0.0, 0.0, 0.5];
    let close = |a: &f64, b: &f64| (a - b).abs() < 1e-3;
    assert!(out.point[1].values.iter().zip(&expected).all(|(a, b)| close(a, b)));
    assert!((out.points[0] - image(&Point::new(0.1, 0.2, 0.3))).norm() < 1e-3);

    for option in ["--plain-vectors", "--plain-vectors=heat,v"] {
        place.ends_with(0, &format!("transfer map.safetensors {option} field.csv -o plain.csv"));
        let plain = io::read_fields(place.path("plain.csv")).unwrap();
        assert_eq!(plain.point[1].values, [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    }
    place.ends_with(
        0,
        "transfer map.safetensors field.csv --plain-vectors=heat -o other.csv",
    );
    assert_eq!(
        std::fs::read(place.path("other.csv")).unwrap(),
        std::fs::read(place.path("out.csv")).unwrap()
    );
    std::fs::write(place.path("normals.csv"), rows.replace('v', "Normals_")).unwrap();
    place.ends_with(0, "transfer map.safetensors normals.csv -o plain.csv");
    let plain = io::read_fields(place.path("plain.csv")).unwrap();
    assert_eq!(plain.point[1].values, [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);

    // A picture asks for an exact inverse, and that leaves the values alone.
    place.ends_with(0, "transfer map.safetensors field.csv --png out.png -o drawn.csv");
    assert_eq!(
        std::fs::read(place.path("drawn.csv")).unwrap(),
        std::fs::read(place.path("out.csv")).unwrap()
    );
}

#[test]
fn vectors_are_pushed_forward_where_they_are_asked_for() {
    let place = with_map();
    let rows = "x,y,z,vx,vy,vz\n0,0,0.5,1,0,0\n0,0,-0.5,0,0,1\n3,0,0,0,1,0\n";
    std::fs::write(place.path("field.csv"), rows).unwrap();
    std::fs::write(place.path("at.csv"), "x,y,z\n0,0,0.2\n9,0,0\n0,0,-0.3\n").unwrap();
    let report = place.report(0, "transfer map.safetensors field.csv --at at.csv -o out.csv --json");
    assert_eq!(
        (&report["without_value"], &report["outside"]),
        (&Value::from(1), &Value::Null)
    );
    let out = io::read_fields(place.path("out.csv")).unwrap();
    let expected = [[2.0, 0.1, 0.0], [f64::NAN; 3], [0.0, 0.0, 0.5]].concat();
    let close = |a: &f64, b: &f64| (a - b).abs() < 1e-3 || a.is_nan() && b.is_nan();
    assert!(out.point[0].values.iter().zip(&expected).all(|(a, b)| close(a, b)));
    assert_eq!(out.point[1].values, [0.0, 2.0, 0.0]);

    // Carried, the point outside of the domain is counted.
    let output = place.ends_with(0, "transfer map.safetensors field.csv -o out.csv --json");
    let report = json(&output);
    assert_eq!(report["outside"], 1);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("1 points of FIELD lie outside the domain"), "{said}");
}

/// The field fills an eighth of the ball: what lies outside it is in no share.
#[test]
fn shares_are_of_the_volume_that_the_field_covers() {
    let place = with_map();
    let mesh = lattice_mesh(&shapes::sphere(0.5, 3), 1500).unwrap();
    let scalar = |name: &str, values| Field {
        name: name.into(),
        components: 1,
        values,
    };
    let outer = mesh
        .vertices()
        .iter()
        .map(|p| if p.coords.norm() > 0.45 { 7.0 } else { 1.0 });
    let fields = VtkFields {
        point: vec![scalar("layer", outer.collect())],
        cell: vec![scalar("part", vec![1.0; mesh.tets().len()])],
        ..VtkFields::default()
    };
    let cells = Cells::Tets(mesh.tets());
    io::write_vtu(place.path("field.vtu"), mesh.vertices(), cells, &fields).unwrap();
    let line = "transfer map.safetensors field.vtu --label layer -o out.csv --json";
    let output = place.ends_with(0, line);
    let report = json(&output);
    let beyond = report["volume_beyond_field"].as_f64().unwrap();
    assert!((beyond - 0.875).abs() < 0.01, "{beyond}");
    // The outer layer would have more than 0.9 with all that lies beyond.
    let share = report["fields"][0]["labels"][1]["before"].as_f64().unwrap();
    assert!(share < 0.6, "{share}");
    // A table holds no cell data.
    let written = [0, 1].map(|k| report["fields"][k]["written"].as_bool().unwrap());
    assert_eq!(written, [true, false]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("cell data are not written: part"));
}

#[test]
fn meshes_keep_their_fields_and_are_resampled() {
    let place = with_map();
    let mesh = lattice_mesh(&shapes::sphere(1.0, 3), 1500).unwrap();
    let scalar = |name: &str, values| Field {
        name: name.into(),
        components: 1,
        values,
    };
    let fields = VtkFields {
        point: vec![scalar("height", mesh.vertices().iter().map(|p| p.z).collect())],
        cell: vec![scalar("part", (0..mesh.tets().len()).map(|t| (t % 3) as f64).collect())],
        ..VtkFields::default()
    };
    let cells = Cells::Tets(mesh.tets());
    io::write_vtu(place.path("field.vtu"), mesh.vertices(), cells, &fields).unwrap();
    for encoding in [VtkEncoding::Text, VtkEncoding::Binary] {
        io::write_vtk(place.path("field.vtk"), mesh.vertices(), cells, &fields, encoding).unwrap();
        assert_eq!(
            io::read_fields(place.path("field.vtk")).unwrap(),
            io::read_fields(place.path("field.vtu")).unwrap()
        );
    }
    let report = place.report(
        0,
        "transfer map.safetensors field.vtu --label part -o out.vtu --png out.png --json",
    );
    let shares = report["fields"][1]["labels"].as_array().unwrap().clone();
    let total: f64 = shares.iter().map(|share| share["after"].as_f64().unwrap()).sum();
    assert!(shares.len() == 3 && (total - 1.0).abs() < 1e-9);
    let out = io::read_fields(place.path("out.vtu")).unwrap();
    assert_eq!(
        (out.cells, &out.point, &out.cell),
        (CellList::Tets(mesh.tets().to_vec()), &fields.point, &fields.cell)
    );
    assert!(std::fs::read(place.path("out.png")).unwrap().starts_with(b"\x89PNG"));

    std::fs::write(place.path("at.csv"), "x,y,z\n0.2,0.1,0.2\n1,0,-0.1\n5,5,5\n").unwrap();
    place.ends_with(
        0,
        "transfer map.safetensors field.vtu --label part --at at.csv -o at_out.csv",
    );
    let at = io::read_fields(place.path("at_out.csv")).unwrap();
    let names: Vec<&str> = at.point.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names, ["height", "part", "status"]);
    assert!((at.point[0].values[0] - 0.4).abs() < 1e-3 && (at.point[0].values[1] + 0.2).abs() < 1e-3);
    assert!(at.point[0].values[2].is_nan());
    assert_eq!(at.point[2].values, [0.0, 0.0, 2.0]);
}

/// A box on a lattice: its values are linear, and so are those resampled.
#[test]
fn structured_points_are_a_mesh() {
    let place = with_map();
    let mut text = "# vtk DataFile Version 3.0\ngrid\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 5\n\
                    ORIGIN -0.3 -0.2 -0.4\nSPACING 0.2 0.2 0.2\nPOINT_DATA 60\nSCALARS sum double 1\n\
                    LOOKUP_TABLE default\n"
        .to_owned();
    let at = |i: usize| [i % 4, i / 4 % 3, i / 12].map(|k| 0.2 * k as f64);
    for i in 0..60 {
        let [x, y, z] = at(i);
        text += &format!("{}\n", (x - 0.3) + 2.0 * (y - 0.2) + 3.0 * (z - 0.4));
    }
    text += "CELL_DATA 24\nSCALARS cell int\nLOOKUP_TABLE default\n";
    (0..24).for_each(|c| text += &format!("{c} "));
    std::fs::write(place.path("grid.vtk"), &text).unwrap();
    let read = io::read_fields(place.path("grid.vtk")).unwrap();
    let mesh = CellMesh::new(read.points.clone(), read.cells.clone(), vec![0; read.cells.len()]).unwrap();
    assert_eq!(
        (read.points.len(), read.cells.len(), read.cell[0].values.len()),
        (60, 144, 144)
    );
    assert!((0..144).all(|t| (mesh.signed_volume(t) - 0.008 / 6.0).abs() < 1e-12));
    assert_eq!(read.cell[0].values[6..12], [1.0; 6]);
    // The boundary has two triangles for every outer square of a cell.
    assert_eq!(
        mesh.boundary().surface.triangles().len(),
        2 * 2 * (3 * 2 + 3 * 4 + 2 * 4)
    );

    std::fs::write(place.path("at.csv"), "x,y,z\n0.1,0.05,0.1\n").unwrap();
    place.ends_with(0, "transfer map.safetensors grid.vtk --at at.csv -o at_out.csv");
    let at = io::read_fields(place.path("at_out.csv")).unwrap();
    // The map is affine up to the error of its fit.
    let expected = 0.05 + 2.0 * (0.05 - 0.005) + 3.0 * 0.2;
    assert!(
        (at.point[0].values[0] - expected).abs() < 1e-2,
        "{}",
        at.point[0].values[0]
    );

    let large = text.replace("DIMENSIONS 4 3 5", "DIMENSIONS 4000 3000 5000");
    std::fs::write(place.path("large.vtk"), large).unwrap();
    assert!(io::read_fields(place.path("large.vtk")).is_err());
    // Long enough to hold the values.
    let large = text.replace("DIMENSIONS 4 3 5", "DIMENSIONS 2049 2048 1") + &" ".repeat(4_200_000);
    std::fs::write(place.path("large.vtk"), large).unwrap();
    let message = io::read_fields(place.path("large.vtk")).unwrap_err().to_string();
    assert!(
        message.contains("4196352 structured points") && message.contains("at most 4194304"),
        "{message}"
    );
}

#[test]
fn image_data_are_carried_as_a_mesh() {
    let place = with_map();
    let grid = io::ImageGrid {
        origin: Point::new(-0.3, -0.2, -0.4),
        spacing: 0.2,
        size: [4, 3, 5],
    };
    let bytes: Vec<u8> = (0..60).collect();
    io::write_vti(place.path("grid.vti"), &grid, "label", 1, &bytes).unwrap();
    place.ends_with(0, "transfer map.safetensors grid.vti --label label -o out.vtu");
    let carried = io::read_fields(place.path("out.vtu")).unwrap();
    assert_eq!((carried.points.len(), carried.cells.len()), (60, 144));
    assert!(
        carried.point[0]
            .values
            .iter()
            .zip(&bytes)
            .all(|(x, b)| *x == f64::from(*b))
    );
    for (i, p) in carried.points.iter().enumerate() {
        let [x, y, z] = [i % 4, i / 4 % 3, i / 12].map(|k| 0.2 * k as f64);
        let expected = image(&Point::new(x - 0.3, y - 0.2, z - 0.4));
        // The map is affine up to the error of its fit.
        assert!((p - expected).norm() < 1e-2, "{p} against {expected}");
    }
    let whole = std::fs::read(place.path("grid.vti")).unwrap();
    std::fs::write(place.path("cut.vti"), &whole[..whole.len() / 2]).unwrap();
    let output = place.ends_with(2, "transfer map.safetensors cut.vti -o cut.vtu");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("cut.vti") && said.contains("ends early"), "{said}");
    assert!(!place.path("cut.vtu").exists());
}

#[test]
fn the_distance_field_needs_no_file() {
    let place = with_map();
    let report = place.report(0, "transfer map.safetensors --distance -o out.vtu --json");
    let median = report["fields"][0]["distribution"]["before"]["quantiles"][2]
        .as_f64()
        .unwrap();
    // Half of the ball is within 1 - 2^(-1/3) of its surface.
    assert!((median - 0.2063).abs() < 0.02, "{median}");
    let out = io::read_fields(place.path("out.vtu")).unwrap();
    assert_eq!(out.point[0].name, "distance");
    let most = out.point[0].values.iter().copied().fold(0.0, f64::max);
    assert!(most > 0.9 && most < 1.0, "{most}");

    // 0 at the boundary, and not what the nearest node inside has.
    let target = io::read_surface(place.path("target.ply")).unwrap();
    place.ends_with(0, "transfer map.safetensors --distance --at target.ply -o at.csv");
    let at = io::read_fields(place.path("at.csv")).unwrap();
    assert_eq!(at.points.len(), target.vertices().len());
    // NaN where the boundary error puts the image of the boundary inside of the target.
    let found: Vec<f64> = at.point[0].values.iter().copied().filter(|d| !d.is_nan()).collect();
    assert!(
        found.len() > 100 && found.iter().all(|&d| (0.0..0.01).contains(&d)),
        "{found:?}"
    );
}

#[test]
fn what_cannot_be_done_is_refused() {
    let place = with_map();
    std::fs::write(place.path("bare.csv"), "x,y,z\n0,0,0\n").unwrap();
    std::fs::write(place.path("field.csv"), "x,y,z,a\n0,0,0,1\n").unwrap();
    std::fs::write(place.path("words.csv"), "x,y,z,a\n0,0,0,red\n").unwrap();
    std::fs::write(place.path("empty.csv"), "x,y,z,a\n").unwrap();
    std::fs::write(place.path("vectors.csv"), "x,y,z,vx,vy,vz\n0,0,0,1,0,0\n").unwrap();
    std::fs::write(place.path("names.csv"), "x,y,z,status,distance\n0,0,0,1,2\n").unwrap();
    std::fs::write(place.path("twice.csv"), "x,y,z,a,a\n0,0,0,1,2\n").unwrap();
    std::fs::write(place.path("columns.csv"), "x,y,z,vx,vy,vz,v_x\n0,0,0,1,0,0,4\n").unwrap();
    std::fs::write(place.path("out.csv"), "as it was").unwrap();
    for (line, message) in [
        ("transfer map.safetensors bare.csv -o out.csv", "has no fields"),
        (
            "transfer map.safetensors field.csv --label b -o out.csv",
            "its fields are a",
        ),
        ("transfer map.safetensors field.csv -o out.vtu", "points without a mesh"),
        ("transfer map.safetensors words.csv -o out.csv", "in the column `a`"),
        ("transfer map.safetensors -o out.csv", "<FIELD>"),
        ("transfer map.safetensors field.csv -o out.stl", "name it"),
        (
            "transfer map.safetensors field.csv --resolution 0 -o out.csv",
            "a grid cannot have",
        ),
        (
            "transfer map.safetensors empty.csv -o out.csv",
            "none of the points that carry the fields has finite coordinates",
        ),
        (
            "transfer map.safetensors vectors.csv --png out.png -o out.csv",
            "leave out --png",
        ),
        (
            "transfer map.safetensors vectors.csv --plain-vectors=w -o out.csv",
            "no field `w`",
        ),
        (
            "transfer map.safetensors names.csv --at bare.csv -o out.csv",
            "the name `status`",
        ),
        (
            "transfer map.safetensors names.csv --distance -o out.csv",
            "the name `distance`",
        ),
        ("transfer map.safetensors twice.csv -o out.csv", "the name `a`"),
        ("transfer map.safetensors columns.csv -o out.csv", "the name `v_x`"),
    ] {
        let said = place.ends_with(2, line).stderr;
        let said = String::from_utf8_lossy(&said);
        assert!(said.contains(message), "{line}: {said}");
        let kept = std::fs::read_to_string(place.path("out.csv")).unwrap();
        assert_eq!(kept, "as it was", "{line}");
    }
}
