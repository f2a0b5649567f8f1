//! The program from the command line: files in, files out, exit codes.

use std::path::Path;
use std::process::Output;

use crate::workplace::{Workplace, json, solidmap, stderr, text};
use serde_json::Value;
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, BoundaryFile, BoundaryMetadata};
use solidmap::io::{self, read_points};
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::SphericalEmbedding;

/// A ball and its affine image, fitted.
fn with_affine_map() -> Workplace {
    let place = Workplace::new();
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    place.surface("image.ply", &shapes::deformed(&shapes::sphere(1.0, 2), affine));
    place.ends_with(0, "fit ball.obj --image image.ply -o ball.map");
    place
}

fn affine(p: &Point) -> Point {
    Point::new(2.0 * p.x + 1.0, p.y - 0.5 * p.z, 0.5 * p.z)
}

fn columns(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names = lines.next().unwrap().split(',').map(String::from).collect();
    (
        names,
        lines
            .map(|l| l.split(',').map(|x| x.parse().unwrap()).collect())
            .collect(),
    )
}

#[test]
fn outputs_and_settings_that_make_no_sense_are_refused_before_the_work() {
    let place = Workplace::new();
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    let fit = "fit ball.obj --image ball.obj";
    place.fails(
        &format!("{fit} -o map.txt"),
        &["`map.txt`", "name it .safetensors or .map"],
    );
    place.fails(
        &format!("{fit} -o out.map --alpha 1e9"),
        &["--alpha is 1000000000", "at most 5"],
    );
    place.fails(&format!("{fit} -o out.map --alpha nan"), &["--alpha is NaN"]);
    place.fails(
        "fit ball.obj --target spere -o out.map",
        &["no file `spere`", "a model, `sphere` or `torus`"],
    );
    place.fails(
        "fit ball.obj --image . -o out.map",
        &["cannot read `.`: it is a folder"],
    );
    let folder = place.ends_with(2, "check .");
    let said = String::from_utf8_lossy(&folder.stdout).into_owned();
    assert!(
        said.contains("cannot read `.`: it is a folder") && !said.contains("cannot be read"),
        "{said}"
    );
    let energy = "energy out.map --energy-tolerance";
    place.ends_with(0, &format!("{fit} -o out.map"));
    place.fails(&format!("{energy} 0"), &["give a positive tolerance"]);
    place.fails(&format!("{energy} nan"), &["give a positive tolerance"]);
    let undivided = json(&place.ends_with(0, &format!("{energy} inf --json")));
    assert_eq!(undivided["errors"]["within_tolerance"], Value::from(true));
    assert!(undivided["errors"]["harmonic_energy"].as_f64().unwrap() < 1e-6);
}

#[test]
fn files_that_are_called_as_settings_keep_their_names() {
    let place = Workplace::new();
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    std::fs::create_dir(place.path("memory")).unwrap();
    for command in [
        "boundary sphere ball.obj -o alpha",
        "eval memory ball.obj -o x.csv",
        "fit offset --target sphere -o out.map",
    ] {
        let said = stderr(&place.ends_with(2, command));
        let named = ["`alpha`", "`memory`", "`offset`"]
            .iter()
            .any(|name| said.contains(name));
        assert!(named && !said.contains("--"), "{command}: {said}");
    }
}

#[test]
fn fit_reports_what_scripts_rely_on() {
    let place = with_affine_map();
    let report = json(&place.ends_with(
        0,
        "fit ball.obj --image image.ply -o again.map --json --vtu boundary.vtu",
    ));
    for key in [
        "vertices",
        "faces",
        "sources",
        "collocation",
        "method",
        "iterations",
        "c_error",
        "tolerance_met",
    ] {
        assert!(!report[key].is_null(), "{key} is missing from {report}");
    }
    for key in ["rms", "p99", "max"] {
        assert!(report["boundary_error"][key].as_f64().unwrap() < 1e-9);
    }
    for key in ["total", "sampling", "factor", "solve", "check"] {
        assert!(report["seconds"][key].as_f64().unwrap() >= 0.0);
    }
    assert!(report["peak_rss_bytes"].as_u64().unwrap() > 1_000_000);
    let worst = &report["worst_places"][0];
    assert_eq!(worst["kind"], "boundary_error", "{report}");
    assert!(worst["value"].as_f64().unwrap() < 1e-9 && worst["share"].as_f64().unwrap() < 0.011);
    let again = std::fs::read(place.path("again.map")).unwrap();
    let twice = json(&place.ends_with(0, "fit ball.obj --image image.ply -o twice.map --json"));
    assert_eq!(twice["boundary_error"], report["boundary_error"]);
    assert!(
        again == std::fs::read(place.path("twice.map")).unwrap(),
        "the same fit gives the same file"
    );
    assert_eq!(
        io::read_surface(place.path("boundary.vtu")).unwrap().vertices().len(),
        162
    );
}

/// A bumpy ball, a box-shaped target, and the map between them through the sphere, in `ball.obj` and `ball.boundary`.
fn with_boundary_file() -> (Workplace, BoundaryMap) {
    let place = Workplace::new();
    let by_rays = |surface: SurfaceMesh| {
        let directions: Vec<_> = surface.vertices().iter().map(|p| p.coords).collect();
        SphericalEmbedding::new(surface, &directions).unwrap()
    };
    let ball = shapes::bumpy_sphere(8);
    place.surface("ball.obj", &ball);
    let target = shapes::deformed(&shapes::sphere(1.0, 3), |p| Point::new(1.5 * p.x, p.y, 0.8 * p.z));
    let boundary = BoundaryMap::through_sphere(by_rays(ball), by_rays(target)).unwrap();
    let file = BoundaryFile {
        boundary: boundary.clone(),
        metadata: BoundaryMetadata::new(vec![]),
    };
    files::write_boundary(&place.path("ball.boundary"), &file).unwrap();
    (place, boundary)
}

#[test]
fn fit_takes_a_boundary_file_with_or_without_its_domain() {
    let (place, boundary) = with_boundary_file();
    let report = json(&place.ends_with(
        0,
        "fit ball.obj --boundary ball.boundary -o ball.map --tolerance 0.02 --json",
    ));
    assert_eq!(report["boundary_file"], "ball.boundary");
    assert!(report["image"].is_null());
    let alone = json(&place.ends_with(0, "fit --boundary ball.boundary -o alone.map --tolerance 0.02 --json"));
    assert!(alone["domain"].is_null());
    assert_eq!(alone["boundary_error"], report["boundary_error"]);
    let (with_domain, alone) = ["ball.map", "alone.map"]
        .map(|name| files::read_map(&place.path(name)).unwrap())
        .into();
    assert_eq!(with_domain.boundary, Some(boundary));
    assert_eq!(with_domain.map.coefficients(), alone.map.coefficients());
    let roles = |file: &files::MapFile| file.metadata.inputs.iter().map(|i| i.role.clone()).collect::<Vec<_>>();
    assert_eq!(roles(&with_domain), ["domain", "boundary"]);
    assert_eq!(roles(&alone), ["boundary"]);
    place.ends_with(0, "energy ball.map --json");
    place.ends_with(0, "eval ball.map ball.obj -o mapped.obj");

    // A domain whose triangles face inward is the same one.
    place.surface("inward.obj", &shapes::bumpy_sphere(8).reversed());
    place.ends_with(
        0,
        "fit inward.obj --boundary ball.boundary -o inward.map --tolerance 0.02",
    );
}

#[test]
fn fit_refuses_boundary_files_that_do_not_fit() {
    let (place, _) = with_boundary_file();
    place.surface("other.obj", &shapes::sphere(1.0, 2));
    place.surface("moved.obj", &shapes::deformed(&shapes::bumpy_sphere(8), |p| p * 1.5));
    for (domain, found) in [("other.obj", "162"), ("moved.obj", "vertex 0 is at")] {
        let line = format!("fit {domain} --boundary ball.boundary -o out.map");
        place.fails(
            &line,
            &[domain, "is not the domain of `ball.boundary`", "leave it out", found],
        );
    }
    place.fails("fit --boundary none.boundary -o out.map", &["none.boundary"]);
    place.fails(
        "fit --boundary ball.obj -o out.map",
        &["ball.obj", "not a boundary file"],
    );
    place.fails("fit --boundary ball.boundary -o ball.boundary", &["overwritten"]);
    for line in [
        "fit ball.obj -o out.map",
        "fit -o out.map",
        "fit --image ball.obj -o out.map",
        "fit ball.obj --image ball.obj --boundary ball.boundary -o out.map",
    ] {
        let output = place.run(line);
        assert_eq!(output.status.code(), Some(2), "{line}");
        assert!(stderr(&output).contains("Usage"), "{line}: {}", stderr(&output));
    }
    place.fails(
        "fit ball.obj --image ball.obj --method schwarz --placement sphere -o out.map",
        &["cannot map `ball.obj`", "--placement adaptive", "--method dense"],
    );
    assert!(!place.path("out.map").exists());
}

#[test]
fn eval_maps_points_and_meshes_and_gives_jacobians() {
    let place = with_affine_map();
    std::fs::write(place.path("points.csv"), "name,z,y,x\na,0.1,0.2,0.3\nb,-0.5,0,0\n").unwrap();
    place.ends_with(0, "eval ball.map points.csv -o images.csv --jacobian");
    let (names, rows) = columns(&place.path("images.csv"));
    assert_eq!(
        names.join(","),
        "x,y,z,fx,fy,fz,j00,j01,j02,j10,j11,j12,j20,j21,j22,inside"
    );
    for row in &rows {
        let expected = affine(&Point::new(row[0], row[1], row[2]));
        assert!((Point::new(row[3], row[4], row[5]) - expected).norm() < 1e-9);
        let jacobian = [2.0, 0.0, 0.0, 0.0, 1.0, -0.5, 0.0, 0.0, 0.5];
        assert!(
            row[6..15].iter().zip(jacobian).all(|(a, b)| (a - b).abs() < 1e-8),
            "{row:?}"
        );
    }
    assert_eq!(rows[0][..3], [0.3, 0.2, 0.1]);

    place.ends_with(0, "eval ball.map points.csv -o images.npy");
    let from_npy = read_points(place.path("images.npy")).unwrap();
    assert_eq!(from_npy[1], Point::new(rows[1][3], rows[1][4], rows[1][5]));

    place.ends_with(0, "eval ball.map ball.obj -o mapped.obj");
    let (mapped, image) = (
        io::read_surface(place.path("mapped.obj")).unwrap(),
        io::read_surface(place.path("image.ply")).unwrap(),
    );
    assert_eq!(mapped.triangles(), image.triangles());
    assert!(
        mapped
            .vertices()
            .iter()
            .zip(image.vertices())
            .all(|(a, b)| (a - b).norm() < 1e-9)
    );

    place.fails(
        "eval ball.map points.csv -o images.obj",
        &["points.csv", ".csv or .npy"],
    );
    place.fails("eval ball.map ball.obj -o out.ply --jacobian", &["Jacobians"]);
    place.fails(
        "eval ball.obj points.csv -o images.csv",
        &["ball.obj", "not a map file"],
    );
    place.fails("eval none.map points.csv -o images.csv", &["none.map"]);
}

/// With both solids at unit volume the identity has harmonic energy 3, and no deformation energy. The affine map keeps
/// the volume, so its energy is the squared Frobenius norm of its matrix: 4 + 1 + ¼ + ¼ = 5.5.
#[test]
fn energy_measures_and_pictures() {
    let place = with_affine_map();
    place.ends_with(0, "fit ball.obj --image ball.obj -o identity.map");
    let identity = json(&place.ends_with(0, "energy identity.map --json"));
    assert!(
        (identity["harmonic_energy"].as_f64().unwrap() - 3.0).abs() < 1e-9,
        "{identity}"
    );
    assert!(identity["deformation_energy"].as_f64().unwrap() < 1e-12);

    let report = json(&place.ends_with(0, "energy ball.map --json --png section.png --axis x --vtu cells.vtu"));
    assert!(
        (report["harmonic_energy"].as_f64().unwrap() - 5.5).abs() < 1e-8,
        "{report}"
    );
    assert_eq!(report["folded"]["points"], Value::from(0));
    let png = std::fs::read(place.path("section.png")).unwrap();
    assert_eq!(png[..8], *b"\x89PNG\r\n\x1a\n");
    assert!(
        std::fs::read_to_string(place.path("cells.vtu")).is_ok_and(|t| t.contains("harmonic_energy")) || {
            let bytes = std::fs::read(place.path("cells.vtu")).unwrap();
            bytes.windows(15).any(|w| w == b"harmonic_energy")
        }
    );
    place.fails("energy ball.map --position 1.5", &["--position", "from 0 to 1"]);
    let words = text(
        &place
            .ends_with(0, "energy ball.map --png again.png --vtu again.vtu")
            .stdout,
    );
    for file in ["again.png", "again.vtu"] {
        let is_listed = |line: &str| line.starts_with("written") && line.ends_with(file);
        assert!(words.lines().any(is_listed), "{words}");
    }
}

#[test]
fn energies_that_miss_their_tolerance_exit_with_1_and_say_so() {
    let place = Workplace::new();
    let ball = shapes::sphere(1.0, 3);
    place.surface("ball.obj", &ball);
    let bent = |p: &Point| Point::new(p.x + 0.5 * p.y * p.y, p.y, p.z + 0.3 * (5.0 * p.x).sin());
    place.surface("bent.obj", &shapes::deformed(&ball, bent));
    place.ends_with(0, "fit ball.obj --image bent.obj -o bent.map");
    let within = json(&place.ends_with(0, "energy bent.map --json"));
    assert_eq!(within["errors"]["within_tolerance"], true);
    let missed = place.ends_with(1, "energy bent.map --energy-tolerance 1e-9 --resolution 8 --json");
    assert_eq!(json(&missed)["errors"]["within_tolerance"], false);
    assert!(stderr(&missed).contains("--energy-tolerance is"), "{}", stderr(&missed));
}

#[test]
fn a_missed_tolerance_exits_with_1_and_still_writes_the_map() {
    let place = Workplace::new();
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    let bent = |p: &Point| Point::new(p.x + p.y * p.y, p.y, p.z + (5.0 * p.x).sin());
    place.surface("bent.obj", &shapes::deformed(&shapes::sphere(1.0, 2), bent));
    let output = place.run("fit ball.obj --image bent.obj -o bent.map --tolerance 1e-9 --max-sources 2000 --json");
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(json(&output)["tolerance_met"], Value::from(false));
    assert!(stderr(&output).contains("tolerance"));
    place.ends_with(0, "eval bent.map ball.obj -o out.csv");
    place.ends_with(0, "fit ball.obj --image bent.obj -o bent.map --tolerance 0.5");
}

#[test]
fn memory_is_a_limit_on_fits_and_on_refinement() {
    let place = Workplace::new();
    let cube = shapes::cube(1.0, 12);
    place.surface("cube.obj", &cube);
    let bent = |p: &Point| Point::new(p.x + p.y * p.y, p.y, p.z + (5.0 * p.x).sin());
    place.surface("bent.obj", &shapes::deformed(&cube, bent));
    let fit = "fit cube.obj --image bent.obj -o out.map";
    for needs in ["--memory", "--max-sources", "--s-ratio", "coarser mesh"] {
        place.fails(&format!("{fit} --memory 2MB"), &["MiB", needs]);
    }
    assert!(!place.path("out.map").exists());
    place.fails(
        &format!("{fit} --method dense --memory 100MiB --max-sources 100000 --c-ratio 5000"),
        &["GiB", "100 MiB are allowed"],
    );
    for size in ["4stones", "0", "-1GiB", "GiB", "1e400"] {
        let output = place.run(&format!("{fit} --memory={size}"));
        assert_eq!(output.status.code(), Some(2), "{size}");
        assert!(stderr(&output).contains("500MB"), "{size}: {}", stderr(&output));
    }

    let output = place.run(&format!("{fit} --memory 80MB --tolerance 1e-7 --json"));
    let report = json(&output);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert_eq!(report["refinement_end"], "memory");
    assert_eq!(report["tolerance_met"], false);
    assert!(stderr(&output).contains("Raise --memory"), "{}", stderr(&output));
    assert!(place.path("out.map").exists());
}

#[test]
fn a_missed_tolerance_comes_with_advice_that_fits() {
    let place = Workplace::new();
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    let bent = |p: &Point| Point::new(p.x + p.y * p.y, p.y, p.z + (5.0 * p.x).sin());
    place.surface("bent.obj", &shapes::deformed(&shapes::sphere(1.0, 2), bent));
    for (options, end, advice) in [
        ("--no-refine", "off", "Leave out --no-refine"),
        ("--method dense", "fixed", "Use --method schwarz"),
        ("--placement sphere", "fixed", "Use the adaptive placement"),
        ("--max-sources 200", "max_sources", "Raise --max-sources"),
    ] {
        let output = place.run(&format!(
            "fit ball.obj --image bent.obj -o out.map --tolerance 1e-9 --json {options}"
        ));
        assert_eq!(json(&output)["refinement_end"], end, "{options}");
        assert!(stderr(&output).contains(advice), "{options}: {}", stderr(&output));
    }
    let output = place.ends_with(0, "fit ball.obj --image bent.obj -o out.map --tolerance 0.5 --json");
    assert_eq!(json(&output)["refinement_end"], "tolerance");
}

#[test]
fn free_sources_meet_the_boundary_better_than_as_many_fixed_ones_and_are_refused_where_they_are_many() {
    let place = Workplace::new();
    let ball = shapes::sphere(1.0, 5);
    place.surface("ball.ply", &ball);
    let near = Point::new(1.5, 0.4, 0.2);
    let pulled = |p: &Point| p + (p - near) * 0.3 / (p - near).norm().powi(3);
    place.surface("pulled.ply", &shapes::deformed(&ball, pulled));
    let fit = "fit ball.ply --image pulled.ply --tolerance 0.1 --json --max-sources";
    let fixed = json(&place.ends_with(0, &format!("{fit} 50 --method dense --c-ratio 16 -o fixed.map")));
    let free = json(&place.ends_with(0, &format!("{fit} 50 --free-sources -o free.map")));
    let error = |report: &Value| report["boundary_error"]["p99"].as_f64().unwrap();
    assert!(error(&free) < 0.5 * error(&fixed), "{free}");
    let moved = &free["free_sources"];
    assert_eq!(moved["boundary_error_before"], fixed["boundary_error"]);
    assert_eq!(
        (&moved["kept"], &free["sources"]),
        (&serde_json::json!(true), &fixed["sources"])
    );
    assert!(moved["residual_after"].as_f64() < moved["residual_before"].as_f64());
    assert!(fixed.get("free_sources").is_none());
    let shown = place.ends_with(
        0,
        "fit ball.ply --image pulled.ply --tolerance 0.1 --max-sources 50 --free-sources -o x.map",
    );
    assert!(text(&shown.stdout).contains("free sources"), "{}", text(&shown.stdout));

    // The file is a map like any other.
    std::fs::write(place.path("at.csv"), "x,y,z\n0.1,0.2,0.3\n").unwrap();
    place.ends_with(0, "eval free.map at.csv -o images.csv");
    place.ends_with(0, "energy free.map --resolution 8");

    let fit = "fit ball.ply --image pulled.ply -o x.map --free-sources";
    place.fails(fit, &["cannot map `ball.ply`", "free sources", "--max-sources"]);
    place.fails(&format!("{fit} --max-sources 50 --method schwarz"), &["--method dense"]);
    place.fails(
        &format!("{fit} --max-sources 50 --c-ratio 1.5"),
        &["--c-ratio", "--s-ratio"],
    );
    let missed = place.ends_with(1, &format!("{fit} --max-sources 20 --tolerance 1e-9"));
    assert!(
        stderr(&missed).contains("leave out --free-sources"),
        "{}",
        stderr(&missed)
    );
}

/// Starts the program in the folder and interrupts it once `is_time`; its output, and how long it took to end.
#[cfg(unix)]
fn interrupted(place: &Workplace, line: &str, is_time: impl Fn() -> bool) -> (Output, std::time::Duration) {
    use std::process::Stdio;
    use std::time::{Duration, Instant};

    let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin!("solidmap"));
    command.current_dir(place.folder.path()).args(line.split_whitespace());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    while !is_time() {
        assert!(
            child.try_wait().unwrap().is_none(),
            "it ended before it was interrupted"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
    let start = Instant::now();
    let kill = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(kill.unwrap().success());
    let output = child.wait_with_output().unwrap();
    (output, start.elapsed())
}

/// Names in the folder that begin with a dot.
#[cfg(unix)]
fn hidden_files(place: &Workplace) -> Vec<String> {
    let names = std::fs::read_dir(place.folder.path()).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with('.')).collect()
}

#[cfg(unix)]
#[test]
fn an_interrupted_fit_ends_at_once_and_leaves_nothing() {
    let place = Workplace::new();
    let ball = shapes::sphere(1.0, 6);
    place.surface("ball.ply", &ball);
    place.surface("image.ply", &shapes::deformed(&ball, affine));
    let start = std::time::Instant::now();
    let line = "fit ball.ply --image image.ply -o out.map --method dense --max-sources 5000";
    let (output, waited) = interrupted(&place, line, || start.elapsed().as_millis() > 300);
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(waited.as_secs_f64() < 1.0, "{waited:?}");
    assert!(!place.path("out.map").exists());
    assert_eq!(hidden_files(&place), Vec::<String>::new());
}

#[cfg(unix)]
#[test]
fn an_interrupted_write_keeps_the_old_file_and_leaves_no_other() {
    let place = with_affine_map();
    let points: Vec<f64> = (0..1_500_000).map(|k| 0.3 * f64::from(k).sin()).collect();
    io::write_npy(place.path("points.npy"), 3, &points).unwrap();
    std::fs::write(place.path("out.csv"), "old").unwrap();
    let is_writing = || !hidden_files(&place).is_empty();
    let (output, waited) = interrupted(&place, "eval ball.map points.npy -o out.csv --jacobian", is_writing);
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(waited.as_secs_f64() < 1.0, "{waited:?}");
    assert_eq!(std::fs::read(place.path("out.csv")).unwrap(), b"old");
    assert_eq!(hidden_files(&place), Vec::<String>::new());
}

#[test]
fn what_cannot_run_says_why_and_exits_with_2() {
    let place = with_affine_map();
    place.surface("cube.obj", &shapes::cube(1.0, 3));
    place.surface("open.obj", &{
        let (vertices, mut triangles) = shapes::cube(1.0, 3).into_parts();
        triangles.truncate(100);
        SurfaceMesh::new(vertices, triangles).unwrap()
    });
    place.fails("fit none.obj --image ball.obj -o out.map", &["none.obj"]);
    place.fails(
        "fit ball.obj --image cube.obj -o out.map",
        &["162 vertices", "56", "ball.obj", "cube.obj"],
    );
    place.fails(
        "fit open.obj --image open.obj -o out.map",
        &["open.obj", "open edges", "fill"],
    );
    place.fails(
        "fit ball.obj --image ball.obj -o no/such/folder/out.map",
        &["no/such/folder/out.map"],
    );
    place.fails(
        "fit ball.obj --image ball.obj -o out.map --alpha -1",
        &["alpha", "positive"],
    );
    place.fails(
        "fit ball.obj --image ball.obj -o out.map --radius 0.2",
        &["radius", "0.5"],
    );
    place.fails("fit ball.obj --image ball.obj -o out.map --c-ratio 0.5", &["c-ratio"]);
    place.fails("fit ball.xyz --image ball.obj -o out.map", &["ball.xyz"]);
    std::fs::write(
        place.path("nan.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n",
    )
    .unwrap();
    place.fails("fit nan.obj --image nan.obj -o out.map", &["nan.obj", "vertex 3"]);
    std::fs::write(
        place.path("inf.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv inf 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n",
    )
    .unwrap();
    std::fs::write(
        place.path("tet.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n",
    )
    .unwrap();
    place.fails("fit inf.obj --image tet.obj -o out.map", &["inf.obj", "first vertex 3"]);
    assert!(!place.path("out.map").exists());
    assert_eq!(place.run("fit ball.obj").status.code(), Some(2));
    assert_eq!(place.run("frobnicate").status.code(), Some(2));
}

/// A cause stands in the message once, and names of temporary files never do.
#[test]
fn errors_are_said_once() {
    let place = with_affine_map();
    let lines = [
        "fit none.obj --image ball.obj -o out.map",
        "eval none.map ball.obj -o out.csv",
        "fit ball.obj --image ball.obj -o out.map --s-ratio 1 --c-ratio 1",
        "eval ball.map ball.obj -o /dev/full",
    ];
    for line in lines
        .iter()
        .filter(|line| !line.contains("/dev/full") || Path::new("/dev/full").exists())
    {
        let text = stderr(&place.run(line));
        let parts: Vec<&str> = text.trim().split(": ").collect();
        let mut unique = parts.clone();
        unique.sort_unstable();
        unique.dedup();
        assert_eq!(parts.len(), unique.len(), "{line}: {text}");
        assert!(!text.contains(".tmp"), "{line}: {text}");
    }
}

#[test]
fn options_out_of_range_are_refused_at_once() {
    let place = with_affine_map();
    for (line, fragment) in [
        (
            "fit ball.obj --image ball.obj -o out.map --held-out 1000000000000",
            "held-out",
        ),
        ("fit ball.obj --image ball.obj -o out.map --c-ratio 1e15", "c-ratio"),
        ("fit ball.obj --image ball.obj -o out.map --tolerance nan", "tolerance"),
        ("fit ball.obj --image ball.obj -o out.map --alpha nan", "alpha"),
        ("fit ball.obj --image ball.obj -o out.map --s-ratio 2", "s-ratio"),
        (
            "fit ball.obj --image ball.obj -o out.map --placement sphere --alpha 2",
            "--alpha",
        ),
        ("fit ball.obj --image ball.obj -o out.map --threads 100000", "--threads"),
        ("fit ball.obj --image ball.obj -o out.map --threads 0", "--threads"),
        ("fit ball.obj --image ball.obj -o .", "folder"),
        ("fit ball.obj --image ball.obj -o out.map --vtu out.txt", ".vtu"),
        ("energy ball.map --resolution 100000", "cells"),
        ("energy ball.map --lame nan 1", "--lame"),
        ("energy ball.map --lame 1 -1", "MU positive"),
        (
            "fit ball.obj --image ball.obj -o out.map --max-local-error 0",
            "--max-local-error",
        ),
        ("energy ball.map --png out.jpg", ".png"),
        ("eval ball.map ball.obj -o out.xyz", "out.xyz"),
    ] {
        place.fails(line, &[fragment]);
    }
}

/// Faces that look the wrong way are repaired before the fit; what follows must see the repaired solid.
#[test]
fn energies_are_those_of_the_repaired_domain() {
    let place = Workplace::new();
    let (outer, inner) = (shapes::sphere(1.0, 2), shapes::sphere(0.5, 2));
    place.surface("inward.obj", &outer.reversed());
    place.surface("nested.obj", &shapes::joined(&outer, &inner));
    for (model, volume) in [("inward", outer.volume()), ("nested", outer.volume() - inner.volume())] {
        let fit = place.ends_with(0, &format!("fit {model}.obj --image {model}.obj -o {model}.map"));
        assert!(stderr(&fit).contains("warning"), "{model}: {}", stderr(&fit));
        let report = json(&place.ends_with(0, &format!("energy {model}.map --json")));
        assert!(
            (report["volume"].as_f64().unwrap() / volume - 1.0).abs() < 1e-9,
            "{model}: {report}"
        );
        assert!(
            (report["harmonic_energy"].as_f64().unwrap() - 3.0).abs() < 1e-6,
            "{model}: {report}"
        );
        assert_eq!(report["folded"]["points"], Value::from(0));
    }
}

/// A reflection reverses the orientation everywhere, which is no fold.
#[test]
fn a_reflecting_map_is_not_folded() {
    let place = with_affine_map();
    place.surface(
        "mirror.obj",
        &shapes::deformed(&shapes::sphere(1.0, 2), |p| Point::new(-p.x, p.y, p.z)),
    );
    place.ends_with(0, "fit ball.obj --image mirror.obj -o mirror.map");
    let report = json(&place.ends_with(0, "energy mirror.map --json --png mirror.png"));
    assert_eq!(report["folded"]["points"], Value::from(0));
    assert_eq!(report["folded"]["fraction"], Value::from(0.0));
    assert!((report["harmonic_energy"].as_f64().unwrap() - 3.0).abs() < 1e-9);
}

#[test]
fn extreme_sizes_are_mapped_or_refused_never_passed_unmeasured() {
    let place = Workplace::new();
    for (name, scale) in [("tiny", 1e-9), ("huge", 1e9)] {
        place.surface(&format!("{name}.obj"), &shapes::sphere(scale, 2));
        let report = json(&place.ends_with(0, &format!("fit {name}.obj --image {name}.obj -o {name}.map --json")));
        assert!(report["boundary_error"]["max"].as_f64().unwrap() < 1e-9);
    }
    for (name, scale) in [("absurd", 1e160), ("nothing", 1e-160)] {
        place.surface(&format!("{name}.obj"), &shapes::sphere(scale, 2));
        place.surface("ball.obj", &shapes::sphere(1.0, 2));
        place.fails(&format!("fit ball.obj --image {name}.obj -o out.map"), &["scale"]);
        place.fails(&format!("fit {name}.obj --image ball.obj -o out.map"), &["scale"]);
    }
}

/// Every choice of the method reaches the library: on smooth data each meets its own bound.
#[test]
fn methods_and_placements_can_be_chosen() {
    let place = with_affine_map();
    let bent = |p: &Point| Point::new(p.x + 0.2 * p.y * p.y, p.y, p.z + 0.1 * p.x * p.y);
    place.surface("bent.obj", &shapes::deformed(&shapes::sphere(1.0, 2), bent));
    for (options, method, bound) in [
        ("--method svd", "dense-svd", 5e-3),
        ("--method qr --alpha 1.5", "dense-qr", 5e-3),
        ("--placement sphere", "dense-svd", 5e-2),
        ("--radius 0.7 --c-ratio 3", "dense-svd", 2e-2),
        ("--no-affine", "schwarz", 2e-2),
        ("--c-ratio 5 --seed 7 --held-out 5000", "schwarz", 5e-3),
    ] {
        let report = json(&place.ends_with(
            0,
            &format!("fit ball.obj --image bent.obj -o bent.map --json --tolerance 1 {options}"),
        ));
        assert_eq!(report["method"], Value::from(method), "{options}");
        let rms = report["boundary_error"]["rms"].as_f64().unwrap();
        assert!(rms < bound, "{options}: {rms:e}");
    }
}

/// A vertex that no triangle uses has an image like all others, but is no part of either solid.
#[test]
fn unused_vertices_do_not_change_the_diagonal_that_errors_are_fractions_of() {
    let place = Workplace::new();
    let with_unused = |mesh: &SurfaceMesh, far: f64| {
        let (mut vertices, triangles) = mesh.clone().into_parts();
        vertices.push(Point::new(far, far, far));
        SurfaceMesh::new(vertices, triangles).unwrap()
    };
    let ball = shapes::sphere(1.0, 2);
    let bent = shapes::deformed(&ball, |p| Point::new(p.x + 0.2 * p.y * p.y, p.y, p.z));
    place.surface("ball.obj", &ball);
    place.surface("bent.obj", &bent);
    place.surface("ball_far.obj", &with_unused(&ball, 100.0));
    place.surface("bent_far.obj", &with_unused(&bent, -1e4));
    let plain = json(&place.ends_with(0, "fit ball.obj --image bent.obj -o m.map --json"));
    let output = place.ends_with(0, "fit ball_far.obj --image bent_far.obj -o far.map --json");
    assert_eq!(json(&output)["boundary_error"], plain["boundary_error"]);
    assert!(
        stderr(&output).contains("belongs to no triangle"),
        "{}",
        stderr(&output)
    );
    place.ends_with(0, "energy far.map --png far.png");
}

#[test]
fn outputs_do_not_overwrite_inputs() {
    let place = with_affine_map();
    for line in [
        "fit ball.obj --image image.ply -o ball.obj",
        "fit ball.obj --image image.ply -o out.map --vtu image.ply",
        "eval ball.map ball.obj -o ball.obj",
        "eval ball.map ball.obj -o ./ball.obj",
    ] {
        let before = std::fs::read(place.path("ball.obj")).unwrap();
        assert_eq!(place.run(line).status.code(), Some(2), "{line}");
        assert_eq!(std::fs::read(place.path("ball.obj")).unwrap(), before, "{line}");
    }
}

#[test]
fn flat_and_mirrored_targets_are_warned_of() {
    let place = with_affine_map();
    place.surface(
        "flat.obj",
        &shapes::deformed(&shapes::sphere(1.0, 2), |p| Point::new(p.x, p.y, 0.0)),
    );
    let flat = place.ends_with(0, "fit ball.obj --image flat.obj -o flat.map");
    assert!(stderr(&flat).contains("no volume"), "{}", stderr(&flat));
    place.fails("energy flat.map", &["flat.map", "volume"]);
    place.ends_with(0, "energy flat.map --no-normalize");
    place.surface(
        "mirror.obj",
        &shapes::deformed(&shapes::sphere(1.0, 2), |p| Point::new(-p.x, p.y, p.z)),
    );
    let mirror = place.ends_with(0, "fit ball.obj --image mirror.obj -o mirror.map");
    assert!(stderr(&mirror).contains("inside out"), "{}", stderr(&mirror));
}

#[test]
fn points_without_an_image_and_points_outside_are_counted() {
    let place = with_affine_map();
    std::fs::write(place.path("points.csv"), "x,y,z\n0,0,0\nnan,0,0\n5,0,0\n").unwrap();
    let output = place.ends_with(0, "eval ball.map points.csv -o images.csv --json");
    let report = json(&output);
    assert_eq!(
        (&report["not_finite"], &report["outside"]),
        (&Value::from(1), &Value::from(1))
    );
    assert!(stderr(&output).contains("point 1"));
    let inside = |rows: &[Vec<f64>]| rows.iter().map(|row| row[6]).collect::<Vec<_>>();
    let (names, rows) = columns(&place.path("images.csv"));
    assert_eq!((names[6].as_str(), inside(&rows)), ("inside", vec![1.0, 0.0, 0.0]));

    // The ball has edges inside of the unit sphere, by less than 5 %.
    place.ends_with(0, "eval ball.map points.csv -o far.csv --distance");
    let (names, rows) = columns(&place.path("far.csv"));
    assert_eq!((names[7].as_str(), inside(&rows)), ("distance", vec![1.0, 0.0, 0.0]));
    assert!(
        (rows[0][7] - 0.97).abs() < 0.03 && (rows[2][7] + 4.0).abs() < 0.05,
        "{rows:?}"
    );
    place.fails(
        "eval ball.map ball.obj -o mapped.obj --distance",
        &["Distances go into .csv"],
    );
}

#[test]
fn check_exits_with_0_1_or_2() {
    let place = with_affine_map();
    place.surface("inward.obj", &shapes::sphere(1.0, 1).reversed());
    assert!(String::from_utf8_lossy(&place.ends_with(0, "check ball.obj").stdout).contains("ball.obj"));
    let output = place.run("check ball.obj inward.obj --json");
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(json(&output)["models"][1]["findings"][0]["kind"], Value::from("inward"));
    let output = place.run("check none.obj inward.obj");
    assert_eq!(output.status.code(), Some(2));
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("inward.obj"),
        "the others are checked all the same"
    );
}

/// With one thread or two the sums may be cut differently, and round differently.
#[test]
fn the_number_of_threads_does_not_change_the_map() {
    let place = Workplace::new();
    place.surface("torus.obj", &shapes::torus(1.0, 0.4, 30, 14));
    place.surface(
        "image.obj",
        &shapes::deformed(&shapes::torus(1.0, 0.4, 30, 14), |p| {
            Point::new(p.x * (1.0 + p.z), p.y + p.x * p.x, p.z)
        }),
    );
    let images = [1, 2].map(|threads| {
        place.ends_with(
            0,
            &format!("fit torus.obj --image image.obj -o t.map --threads {threads}"),
        );
        place.ends_with(0, &format!("eval t.map torus.obj -o out.npy --threads {threads}"));
        read_points(place.path("out.npy")).unwrap()
    });
    assert!(images[0].iter().zip(&images[1]).all(|(a, b)| (a - b).norm() < 1e-9));
}

#[test]
fn version_names_the_licence_of_the_binary() {
    let text = String::from_utf8(Workplace::new().ends_with(0, "--version").stdout).unwrap();
    let licence = if cfg!(feature = "native") {
        "AGPL"
    } else {
        "MIT OR Apache-2.0"
    };
    assert!(text.contains(licence), "{text}");
}

#[cfg(feature = "native")]
#[test]
fn tet_and_offset_write_meshes() {
    let place = with_affine_map();
    for mesher in ["tetgen", "cgal"] {
        for extension in ["mesh", "vtk", "vtu"] {
            let report =
                json(&place.ends_with(0, &format!("tet ball.obj -o tets.{extension} --mesher {mesher} --json")));
            let tets = io::read_tets(place.path(&format!("tets.{extension}"))).unwrap();
            assert_eq!(report["tets"], Value::from(tets.tets().len()));
            assert!((tets.volume() - report["volume"].as_f64().unwrap()).abs() < 1e-9);
        }
    }
    place.ends_with(0, "tet ball.obj -o tets.vtu");
    place.ends_with(0, "eval ball.map tets.vtu -o carried.vtu");
    let report = json(&place.ends_with(0, "energy ball.map --mesh tets.vtu --vtu energy.vtu --json"));
    assert!(
        (report["harmonic_energy"].as_f64().unwrap() - 5.5).abs() < 1e-8,
        "{report}"
    );
    place.surface("large.obj", &shapes::sphere(3.0, 2));
    place.ends_with(0, "tet large.obj -o large.vtu");
    place.fails(
        "energy ball.map --mesh tets.vtu --vtu tets.vtu",
        &["tets.vtu", "overwritten"],
    );
    place.fails("energy ball.map --mesh large.vtu", &["large.vtu", "volume"]);
    place.fails("tet ball.obj -o tets.xyz", &["tets.xyz", ".vtu"]);
    let report = json(&place.ends_with(0, "offset ball.obj --distance 0.1 --relative -o offset.ply --json"));
    let offset = io::read_surface(place.path("offset.ply")).unwrap();
    assert_eq!(report["faces"], Value::from(offset.triangles().len()));
    let distance = report["distance"].as_f64().unwrap();
    assert!(
        offset
            .vertices()
            .iter()
            .all(|p| (p.coords.norm() - 1.0 - distance).abs() < 0.1 * distance)
    );
    place.ends_with(0, "fit ball.obj --image image.ply --paper -o paper.map");
    place.fails("tet ball.obj -o tets.obj", &["tets.obj"]);
}

#[cfg(not(feature = "native"))]
#[test]
fn commands_that_need_cgal_or_tetgen_say_so_in_a_build_without_them() {
    let place = with_affine_map();
    place.fails("tet ball.obj -o tets.mesh", &["native"]);
    place.fails("offset ball.obj --distance 0.1 -o offset.ply", &["native"]);
    place.fails(
        "fit ball.obj --image image.ply --paper -o paper.map",
        &["native", "adaptive"],
    );
}

#[test]
fn demo_writes_maps_and_pictures() {
    let place = Workplace::new();
    let report = json(&place.ends_with(0, "demo --out shown --json"));
    for (k, name) in ["animal", "knot"].iter().enumerate() {
        assert!(report["pairs"][k]["fit"]["boundary_error"]["rms"].as_f64().unwrap() < 2e-3);
        for file in [
            "map.safetensors",
            "map.png",
            "map.html",
            "sections.png",
            "energy.vtu",
            "domain.obj",
            "image.obj",
        ] {
            assert!(place.path("shown").join(name).join(file).exists(), "{name}/{file}");
        }
    }
    assert!(report["peak_rss_bytes"].as_u64().unwrap() < 1 << 30);
    let remesh = &report["pairs"][0]["remesh"];
    assert_eq!(
        (&remesh["after"]["inverted"], &remesh["after"]["inverted_inside"]),
        (&0.into(), &0.into())
    );
    assert!(remesh["cells"].as_u64().unwrap() > 1000 && report["pairs"][1]["remesh"].is_null());
    for file in ["hexahedra.vtu", "hexahedra.png"] {
        assert!(place.path("shown/animal").join(file).exists(), "{file}");
    }
}

#[test]
fn a_polycube_is_remeshed_in_every_format() {
    let place = Workplace::new();
    let cube = shapes::cube(2.0, 6);
    place.surface("cube.obj", &cube);
    place.surface("ball.obj", &shapes::projected_to_sphere(&cube, 1.0));
    place.run("fit cube.obj --image ball.obj -o cube.map");
    let words = |output: &Output| String::from_utf8_lossy(&output.stdout).into_owned();
    let tets = place.ends_with(0, "remesh cube.map --cells 6 -o tets.mesh --domain-mesh grid.vtu");
    for fragment in [
        "1296 tetrahedra",
        "0 now, decided exactly",
        "scaled Jacobian",
        "tets.mesh",
    ] {
        assert!(words(&tets).contains(fragment), "{fragment}: {}", words(&tets));
    }
    let [grid, mesh] = ["grid.vtu", "tets.mesh"].map(|name| io::read_tets(place.path(name)).unwrap());
    assert_eq!((grid.tets(), mesh.tets().len()), (mesh.tets(), 1296));
    assert!((grid.volume() - 8.0).abs() < 1e-12);
    assert!((0..1296).all(|t| mesh.signed_volume(t) > 0.0));
    assert!(
        mesh.boundary()
            .surface
            .vertices()
            .iter()
            .all(|p| p.coords.norm() < 1.0 + 1e-12)
    );

    let hexes = json(&place.ends_with(0, "remesh cube.map --cell-size 0.334 --kind hex -o hexes.vtu --json"));
    assert_eq!((&hexes["cells"], &hexes["inverted_cells"]), (&432.into(), &0.into()));
    assert!(hexes["min_scaled_jacobian"].as_f64().unwrap() > 0.2, "{hexes}");
    assert!(hexes["seconds"]["total"].as_f64().unwrap() > 0.0);
    let vtu = std::fs::read(place.path("hexes.vtu")).unwrap();
    for field in [
        "scaled_jacobian",
        "det_jacobian",
        "region",
        "inverted",
        "obstacle",
        "domain",
        "on_boundary",
    ] {
        assert!(
            String::from_utf8_lossy(&vtu).contains(&format!("Name=\"{field}\"")),
            "{field}"
        );
    }
    place.ends_with(0, "remesh cube.map --cells 2 --kind hex -o hexes.msh");
    let msh = std::fs::read_to_string(place.path("hexes.msh")).unwrap();
    assert!(msh.starts_with("$MeshFormat\n2.2") && msh.contains("cube.map") && msh.contains("\"face 1 ("));
    let elements = msh.split("$Elements\n").nth(1).unwrap();
    let of_kind = |kind: &str| elements.lines().filter(|l| l.split(' ').nth(1) == Some(kind)).count();
    assert_eq!((of_kind("3"), of_kind("5")), (24, 32), "quads and hexahedra");

    // A mesh of the domain with regions, its tetrahedra inverted.
    let labelled = grid.tets().iter().enumerate().map(|(k, t)| (t.map(|v| v + 1), k % 3));
    let [vertices, tets] = [
        grid.vertices()
            .iter()
            .map(|p| format!("{:?} {:?} {:?} 0\n", p.x, p.y, p.z))
            .collect::<String>(),
        labelled
            .map(|([a, b, c, d], region)| format!("{b} {a} {c} {d} {region}\n"))
            .collect(),
    ];
    let text = format!(
        "MeshVersionFormatted 2\nDimension 3\nVertices\n{}\n{vertices}Tetrahedra\n1296\n{tets}End\n",
        grid.vertices().len()
    );
    std::fs::write(place.path("given.mesh"), text).unwrap();
    let given = place.ends_with(0, "remesh cube.map --mesh given.mesh -o carried.mesh --png carried.png");
    assert!(
        words(&given).contains("0 now") && words(&given).contains("given"),
        "{}",
        words(&given)
    );
    let carried = io::read_cells(place.path("carried.mesh")).unwrap();
    assert!(carried.regions().iter().enumerate().all(|(k, r)| *r == k as i32 % 3));
    let text = std::fs::read_to_string(place.path("carried.mesh")).unwrap();
    assert!(
        text.contains("# solidmap") && text.contains("from given.mesh"),
        "{text:.300}"
    );
    assert!(
        std::fs::read(place.path("carried.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
}

#[test]
fn what_cannot_be_remeshed_is_named() {
    let place = with_affine_map();
    place.fails(
        "remesh ball.map -o m.vtu",
        &["ball.map", "not a polycube", "not axis-aligned"],
    );
    place.fails("remesh missing.map -o m.vtu", &["missing.map"]);
    place.fails("remesh ball.map -o m.obj", &["m.obj", ".vtu"]);
    place.fails("remesh ball.map -o m.vtu --domain-mesh m.vtu", &["m.vtu"]);
    place.fails("remesh ball.map -o m.vtu --cells 0", &["--cells"]);
    place.fails(
        "remesh ball.map -o m.vtu --mesh ball.obj --cells 4",
        &["--mesh", "--cells"],
    );
    place.fails(
        "remesh ball.map -o m.vtu --mesh ball.obj",
        &["ball.obj", "tetrahedra or hexahedra is needed"],
    );
    place.fails(
        "remesh ball.map -o given.mesh --mesh given.mesh",
        &["given.mesh", "overwrit"],
    );
    place.surface("cube.obj", &shapes::cube(2.0, 2));
    place.ends_with(0, "fit cube.obj --image cube.obj -o cube.map");
    place.fails("remesh cube.map -o m.vtu --cell-size -1", &["cell size of -1"]);
    place.fails("remesh cube.map -o m.vtu --cell-size 0", &["cell size of 0"]);
    place.fails(
        "remesh cube.map -o m.vtu --cells 1000 --max-cells 100",
        &["limit of 100"],
    );
    // A mirrored target: no cell could be repaired. Unrepaired, they are written, with a warning.
    place.surface(
        "mirrored.obj",
        &shapes::deformed(&shapes::cube(2.0, 2), |p| Point::new(-p.x, p.y, p.z)),
    );
    let fitted = place.run("fit cube.obj --image mirrored.obj -o mirrored.map");
    assert_eq!(fitted.status.code(), Some(0), "{}", stderr(&fitted));
    place.fails("remesh mirrored.map --cells 4 -o mirrored.vtu", &["mirrors the solid"]);
    let output = place.run("remesh mirrored.map --cells 4 -o mirrored.vtu --no-repair");
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("cells stay inverted") && place.path("mirrored.vtu").exists());
}

#[test]
fn a_self_intersecting_boundary_is_reported_though_no_cell_is_inverted() {
    let place = Workplace::new();
    let bar = shapes::polycube(&[0, 1, 2, 3, 4, 5].map(|k| [k, 0, 0]), 3);
    // More than one turn about an axis: the ends overlap, and every cell keeps its orientation.
    let wound = shapes::deformed(&bar, |p| {
        let (angle, radius) = (400f64.to_radians() * p.x / 6.0, 2.0 + p.y);
        Point::new(radius * angle.sin(), radius * angle.cos(), p.z + 0.03 * p.x)
    });
    place.surface("bar.obj", &bar);
    place.surface("wound.obj", &wound);
    place.surface("straight.obj", &bar);
    for (image, crossing) in [("straight", false), ("wound", true)] {
        place.run(&format!("fit bar.obj --image {image}.obj -o {image}.map"));
        let output = place.run(&format!("remesh {image}.map --cells 18 -o {image}.vtu --json"));
        let report = json(&output);
        assert_eq!(report["inverted_cells"], 0, "{report}");
        let crossings = &report["crossings"];
        if cfg!(feature = "native") {
            assert_eq!(crossings["result"].as_u64().map(|n| n > 0), Some(crossing), "{report}");
            assert_eq!(output.status.code(), Some(i32::from(crossing)), "{}", stderr(&output));
            assert_eq!(stderr(&output).contains("passes through itself"), crossing);
        } else {
            assert_eq!(crossings["status"], "not_counted", "{report}");
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        }
    }
}

#[test]
fn names_of_any_length_are_written() {
    let place = with_affine_map();
    // The longest that the system has, in characters of one byte and of four.
    for name in [format!("{}.obj", "a".repeat(251)), format!("{}.obj", "𝄞".repeat(62))] {
        place.ends_with(0, &format!("eval ball.map ball.obj -o {name}"));
        assert!(place.path(&name).exists());
    }
}

#[cfg(unix)]
#[test]
fn names_that_are_not_utf8_are_accepted_and_marked_in_json() {
    use std::os::unix::ffi::OsStrExt;
    let place = with_affine_map();
    let run = |arguments: &[&[u8]]| {
        let mut command = solidmap();
        command.current_dir(place.folder.path());
        command.args(arguments.iter().map(|argument| std::ffi::OsStr::from_bytes(argument)));
        command.output().unwrap()
    };
    let plain = run(&[b"eval", b"ball.map", b"ball.obj", b"-o", b"x.obj", b"--json"]);
    assert!(json(&plain).get("lossy_names").is_none());
    let output = run(&[b"eval", b"ball.map", b"ball.obj", b"-o", b"\xfe.obj", b"--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = json(&output);
    assert_eq!(
        (&report["lossy_names"], &report["output"]),
        (&true.into(), &"\u{fffd}.obj".into())
    );
    let written = place.folder.path().join(std::ffi::OsStr::from_bytes(b"\xfe.obj"));
    assert_eq!(
        std::fs::read(&written).unwrap(),
        std::fs::read(place.path("x.obj")).unwrap()
    );
    // It is read too, also by the processes of `compare`.
    let fitted = run(&[
        b"fit",
        b"\xfe.obj",
        b"--image",
        b"image.ply",
        b"-o",
        b"\xfe.map",
        b"--json",
    ]);
    assert_eq!(json(&fitted)["map"], "\u{fffd}.map");
    let compared = run(&[
        b"compare",
        b"\xfe.obj",
        b"--image",
        b"image.ply",
        b"--methods",
        b"mean-value",
        b"--no-reference",
        b"--json",
    ]);
    let row = &json(&compared)["methods"][0];
    assert!(row["name"] == "mean_value" && row.get("error").is_none(), "{row}");
}

#[test]
fn errors_are_json_too() {
    let place = with_affine_map();
    let error = |code: i32, line: &str| {
        let report = place.report(code, &format!("{line} --json"));
        assert_eq!(report["version"]["program"], env!("CARGO_PKG_VERSION"), "{line}");
        assert_eq!(report["error"]["exit_code"], code, "{line}");
        let message = report["error"]["message"].as_str().unwrap().to_owned();
        (report["error"]["kind"].as_str().unwrap().to_owned(), message)
    };
    let (kind, message) = error(2, "eval none.map ball.obj -o x.obj");
    assert!(
        kind == "failed" && message.contains("none.map") && !message.starts_with("error"),
        "{message}"
    );
    let (kind, message) = error(2, "fit ball.obj -o x.map");
    assert!(kind == "usage" && message.contains("--target"), "{message}");
    assert!(!message.contains("Usage"), "{message}");
    let (kind, message) = error(2, "fit ball.obj --image image.ply -o x.map --time-limit 0.001");
    assert!(kind == "time_limit" && message.contains("0.001"), "{message}");
    let (_, message) = error(2, "");
    assert!(message.contains("certify") && !message.contains("worker"), "{message}");
    // A report that says more is not followed by another document.
    let report = place.report(2, "check none.obj ball.obj --json");
    assert!(report.get("error").is_none() && report["models"][0]["unreadable"].is_string());
    // Help is no error.
    let help = place.ends_with(0, "fit --help --json");
    assert!(String::from_utf8_lossy(&help.stdout).contains("Usage"));
}

/// The ends of the letter L are concave: by the order of their corners they would be cut into triangles that overlap.
#[test]
fn concave_faces_are_cut_by_their_shape_and_alike_in_an_image() {
    let place = Workplace::new();
    let letter = |outline: [[f64; 2]; 6]| {
        let ends = [0.0, 1.0].map(|z| outline.map(|[x, y]| format!("v {x} {y} {z}\n")).concat());
        let sides: String = (0..6)
            .map(|k| format!("f {} {} {} {}\n", k + 1, (k + 1) % 6 + 1, (k + 1) % 6 + 7, k + 7))
            .collect();
        format!("{}f 6 5 4 3 2 1\nf 7 8 9 10 11 12\n{sides}", ends.concat())
    };
    let outline = [[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 4.], [0., 4.]];
    // The inner corner pulled outward until no corner is concave; then the order would do.
    let convex = [[0., 0.], [3., 0.], [3.2, 1.], [2.6, 3.], [1.5, 4.], [0., 4.]];
    std::fs::write(place.path("letter.obj"), letter(outline)).unwrap();
    std::fs::write(place.path("convex.obj"), letter(convex)).unwrap();
    if cfg!(feature = "native") {
        let report = place.report(0, "check letter.obj --json");
        assert_eq!(report["models"][0]["self_intersections"]["pairs"], 0, "{report}");
    }
    let check = place.report(0, "boundary check letter.obj convex.obj --json");
    assert_eq!(check["findings"].as_array().unwrap().len(), 0, "{check}");
    // The other way round the domain's cut, which is by order, folds in the image: said of the map, not of the files.
    let check = place.report(1, "boundary check convex.obj letter.obj --json");
    assert_eq!(check["findings"][0]["kind"], "flipped", "{check}");
    if cfg!(feature = "native") {
        let tets = place.report(0, "tet letter.obj -o letter.mesh --json");
        assert!((tets["volume"].as_f64().unwrap() - 6.0).abs() < 1e-12, "{tets}");
    }
}

#[test]
fn piped_progress_names_the_phases_of_long_work_and_keeps_silent_about_short() {
    let place = with_affine_map();
    assert_eq!(stderr(&place.ends_with(0, "eval ball.map ball.obj -o x.obj")), "");
    place.surface("large.ply", &shapes::sphere(1.0, 6));
    let said = stderr(&place.run("fit large.ply --image large.ply -o x.map --tolerance 1e-7 --time-limit 8"));
    let phases: Vec<&str> = said
        .lines()
        .filter_map(|line| line.split_once(" s  "))
        .map(|(_, phase)| phase)
        .collect();
    let place_of = |name: &str| phases.iter().position(|phase| *phase == name);
    let order = ["reading", "checking", "placing sources", "factoring patches"].map(place_of);
    assert!(order[0].is_some() && order.is_sorted(), "{said}");
}

#[test]
fn messages_of_the_library_name_the_options_of_the_program() {
    let place = with_affine_map();
    let fit = "fit ball.obj --image image.ply -o x.map";
    for (option, said) in [
        ("--max-sources 0", "--max-sources is 0"),
        ("--s-ratio 0", "--s-ratio is 0"),
        ("--c-ratio 0", "--c-ratio is 0, but must be at least --s-ratio"),
        ("--held-out 0", "--held-out is 0"),
        ("--memory 1MB", "(--memory)"),
    ] {
        place.fails(&format!("{fit} {option}"), &[said]);
    }
}

#[test]
fn text_in_utf16_is_named() {
    let place = Workplace::new();
    let wide: Vec<u8> = "\u{feff}v 0 0 0\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    std::fs::write(place.path("wide.obj"), wide).unwrap();
    let output = place.run("check wide.obj");
    assert!(String::from_utf8_lossy(&output.stdout).contains("UTF-16"));
    assert_eq!(output.status.code(), Some(2));
}
