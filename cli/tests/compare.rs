//! `solidmap compare` from the command line: tables and files, rows that fail while others go on, processes that end.

use std::ops::Deref;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use crate::workplace::{Workplace, json, stderr};
use serde_json::Value;
use solidmap::geometry::SurfaceQuery;
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::{Point, Vector};

/// Coarse, and without what is not looked at.
const SMALL: &str = "--resolution 12 --interior 200";
const METHODS: [&str; 4] = ["mfs", "fem", "variational", "mean_value"];

struct ComparePlace {
    place: Workplace,
}

impl Deref for ComparePlace {
    type Target = Workplace;

    fn deref(&self) -> &Workplace {
        &self.place
    }
}

impl ComparePlace {
    /// A long ellipsoid and a bent one: a cross-section along it has few pixels, and takes little time.
    fn new() -> Self {
        let place = Self {
            place: Workplace::new(),
        };
        place.surface("domain.obj", &domain());
        place.surface("image.obj", &shapes::deformed(&domain(), bend));
        place
    }

    /// Compares `domain.obj` and `image.obj`; words are separated by blanks.
    fn run(&self, options: &str) -> Output {
        let line = format!("compare domain.obj --image image.obj {SMALL} {options}");
        self.place.run_within(Duration::from_secs(60), &line)
    }

    /// The rows that it prints as JSON.
    fn rows(&self, options: &str, code: i32) -> Vec<Value> {
        let output = self.run(&format!("{options} --json"));
        assert_eq!(output.status.code(), Some(code), "{options}: {}", stderr(&output));
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        report["methods"].as_array().unwrap().clone()
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// What the scripts of the page read.
    fn page(&self, folder: &str) -> Value {
        let text = std::fs::read_to_string(self.path(folder).join("comparison.html")).unwrap();
        let (_, data) = text.split_once("id=\"data\">").unwrap();
        serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap()
    }

    fn comparison(&self, folder: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.path(folder).join("comparison.json")).unwrap()).unwrap()
    }
}

fn domain() -> SurfaceMesh {
    shapes::deformed(&shapes::sphere(1.0, 2), |p| Point::new(4.0 * p.x, p.y, p.z))
}

fn bend(p: &Point) -> Point {
    Point::new(
        p.x + 0.1 * p.y * p.z,
        1.5 * p.y + 0.02 * p.x * p.x,
        p.z - 0.1 * p.y * p.x,
    )
}

/// The parts of a page that are tables, words or titles.
fn of_kind<'p>(page: &'p Value, kind: &str) -> Vec<&'p Value> {
    let parts = page["parts"].as_array().unwrap().iter();
    let found = parts.filter(|part| part["kind"] == kind);
    found.map(|part| &part["content"]).collect()
}

fn name(row: &Value) -> &str {
    row["name"].as_str().unwrap()
}

/// What every row with figures must have.
fn assert_has_figures(row: &Value) {
    for key in ["mesh", "factor", "solve", "evaluate"] {
        assert!(row["seconds"][key].as_f64().unwrap() >= 0.0, "{key} in {row}");
    }
    for key in ["harmonic_energy", "min_det_jacobian", "peak_rss_bytes"] {
        assert!(row[key].as_f64().unwrap() > 0.0, "{key} in {row}");
    }
    let error = row["errors"]["harmonic_energy"].as_f64().unwrap();
    assert!(
        (0.0..0.1).contains(&(error / row["harmonic_energy"].as_f64().unwrap())),
        "{row}"
    );
    for key in ["rms", "p99", "max"] {
        // Mesh_3 makes a surface of its own, at a distance from the domain's.
        assert!(row["boundary_error"][key].as_f64().unwrap() < 0.03, "{key} in {row}");
    }
    assert!(row.get("error").is_none(), "{row}");
}

fn assert_error(row: &Value, fragment: &str) {
    let error = row["error"].as_str().unwrap_or_else(|| panic!("no error in {row}"));
    assert!(error.contains(fragment), "no `{fragment}` in: {error}");
    assert!(row.get("harmonic_energy").is_none(), "{row}");
}

/// Figures of the methods without tetrahedra, errors of those with them.
fn assert_only_tets_fail(rows: &[Value], fragment: &str) {
    assert_eq!(rows.iter().map(name).collect::<Vec<_>>(), METHODS);
    for row in rows {
        match name(row) {
            "fem" | "variational" => assert_error(row, fragment),
            _ => {
                assert_has_figures(row);
                assert!(row["tets"].is_null() && row["inverted_tets"].is_null(), "{row}");
            }
        }
    }
}

/// Numbers of a file of comma-separated values without its header.
fn numbers(path: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().skip(1).flat_map(|line| line.split(','));
    lines.map(|word| word.parse().unwrap()).collect()
}

#[test]
fn every_method_gets_a_row_and_files_that_can_be_read() {
    let place = ComparePlace::new();
    let rows = place.rows("--out all", 0);
    assert_eq!(rows.iter().map(name).collect::<Vec<_>>(), METHODS);
    for row in &rows {
        assert_has_figures(row);
        assert!(row["tets"].as_u64().unwrap() > 100, "{row}");
        assert_eq!(row["inverted_tets"].as_u64(), Some(0), "{row}");
        let difference = &row["interior_difference"];
        let [rms, p99, max] = ["rms", "p99", "max"].map(|key| difference[key].as_f64().unwrap());
        assert!(0.0 < rms && rms <= p99 && p99 <= max && max < 0.02, "{row}");
    }
    let folder = place.path("all");
    let comparison = place.comparison("all");
    assert_eq!(comparison["methods"], Value::from(rows.clone()));
    assert!(comparison["reference"]["description"].as_str().unwrap().contains("mfs"));
    let times: Value = serde_json::from_slice(&std::fs::read(folder.join("times.json")).unwrap()).unwrap();
    for row in &rows {
        assert_eq!(times[name(row)], row["seconds"]);
    }
    for table in ["comparison.txt", "comparison.md", "comparison.csv"] {
        let text = std::fs::read_to_string(folder.join(table)).unwrap();
        assert!(METHODS.iter().all(|method| text.contains(method)), "{table}: {text}");
    }
    let csv = std::fs::read_to_string(folder.join("comparison.csv")).unwrap();
    let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert_eq!(columns.len(), 5);
    assert!(columns.iter().all(|&n| n == columns[0]), "{csv}");
    assert!(
        std::fs::read(folder.join("comparison.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    let page = place.page("all");
    assert_eq!(page["kind"], "report");
    let address = page["picture"]["address"].as_str().unwrap();
    assert!(address.starts_with("data:image/png;base64,"));
    let alternative = page["picture"]["alternative"].as_str().unwrap();
    assert!(
        METHODS.iter().all(|method| alternative.contains(method)),
        "{alternative}"
    );
    let files = page["files"].as_array().unwrap();
    let names: Vec<&Value> = files.iter().map(|file| &file["file"]).collect();
    assert_eq!(names, ["domain.obj", "image.obj"]);
    // The tables of the text, with all rows.
    let tables = of_kind(&page, "table");
    assert_eq!(tables.len(), 3);
    for table in tables {
        let rows = table["rows"].as_array().unwrap();
        let found: Vec<&Value> = rows.iter().map(|row| &row[0]).collect();
        assert_eq!(found, METHODS);
        let columns = table["columns"].as_array().unwrap().len();
        assert!(rows.iter().all(|row| row.as_array().unwrap().len() == columns));
    }
    let words = of_kind(&page, "words");
    assert!(words[0].as_str().unwrap().contains("held-out points"), "{words:?}");

    let points = io::read_points(folder.join("points.csv")).unwrap();
    assert_eq!(points.len(), 200);
    let query = SurfaceQuery::new(&domain()).unwrap();
    assert!(points.iter().all(|p| query.contains(p)));
    for method in METHODS {
        let table = numbers(&folder.join(format!("{method}.csv")));
        assert_eq!(table.len(), 6 * 200, "{method}");
        for (row, p) in table.chunks_exact(6).zip(&points) {
            assert_eq!(Point::new(row[0], row[1], row[2]), *p, "{method}");
            let image = Point::new(row[3], row[4], row[5]);
            // No coordinate bends by more than 0.6 anywhere, and harmonic maps bend less.
            assert!((image - bend(p)).norm() < 0.2, "{method}: {p} to {image}");
        }
        let tets = io::read_tets(folder.join(format!("{method}.vtu"))).unwrap();
        let row = rows.iter().find(|row| name(row) == method).unwrap();
        assert_eq!(Some(tets.tets().len() as u64), row["tets"].as_u64(), "{method}");
        assert!((tets.volume() / domain().volume() - 1.0).abs() < 1e-9, "{method}");
    }
    assert!(place.names("all").iter().all(|name| !name.contains("tmp")));
}

#[test]
fn only_the_methods_asked_for_are_compared() {
    let place = ComparePlace::new();
    let rows = place.rows("--methods mean_value,mfs --no-reference", 0);
    assert_eq!(rows.iter().map(name).collect::<Vec<_>>(), ["mfs", "mean_value"]);
    for row in &rows {
        assert_has_figures(row);
        assert!(row["interior_difference"].is_null(), "{row}");
    }
    assert_eq!(place.run("--methods magic").status.code(), Some(2));
}

#[cfg(feature = "native")]
#[test]
fn the_bijective_map_has_a_row_of_its_own_when_it_is_asked_for() {
    let place = ComparePlace::new();
    let rows = place.rows("--methods bijective,mfs --no-reference", 0);
    assert_eq!(rows.iter().map(name).collect::<Vec<_>>(), ["mfs", "bijective"]);
    rows.iter().for_each(assert_has_figures);
    let bijective = &rows[1];
    assert_eq!(
        (&bijective["inverted_tets"], &bijective["folded_fraction"]),
        (&0.into(), &0.0.into())
    );
    // Linear over the triangles of the boundary, as the boundary map is.
    assert!(
        bijective["boundary_error"]["max"].as_f64().unwrap() < 1e-12,
        "{bijective}"
    );
    let energy = |row: &Value| row["harmonic_energy"].as_f64().unwrap();
    assert!(energy(bijective) > 0.99 * energy(&rows[0]), "{rows:?}");
}

/// One vertex is pushed through the other side of the surface: TetGen refuses, and the other methods are not affected.
#[test]
fn a_mesher_that_fails_takes_its_own_rows_only() {
    let place = ComparePlace::new();
    let mut vertices = domain().vertices().to_vec();
    let lowest = (0..vertices.len())
        .min_by(|&a, &b| vertices[a].y.total_cmp(&vertices[b].y))
        .unwrap();
    vertices[lowest].y = 1.15;
    place.surface("domain.obj", &domain().with_vertices(vertices).unwrap());
    // A tolerance that asks for no refinement where the surface crosses itself.
    let output = place.run("--no-reference --tolerance 0.5 --json");
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("warning: fem: "), "{}", stderr(&output));
    let report = json(&output);
    for row in report["methods"].as_array().unwrap().clone() {
        match name(&row) {
            "fem" | "variational" => assert_error(&row, "intersects itself"),
            _ => assert!(
                row["harmonic_energy"].as_f64().unwrap() > 0.0 && row.get("error").is_none(),
                "{row}"
            ),
        }
    }
}

#[test]
fn a_mesh_of_another_solid_is_refused_by_all_that_need_one() {
    let place = ComparePlace::new();
    for (file, scale, shift, fragment) in [
        ("larger.mesh", 1.5, 0.0, "volume"),
        ("elsewhere.mesh", 1.0, 9.0, "away from the domain's surface"),
    ] {
        place.surface(
            "other.obj",
            &shapes::deformed(&domain(), |p| p * scale + Vector::repeat(shift)),
        );
        let made = place.place.run(&format!("tet other.obj -o {file}"));
        assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
        assert_only_tets_fail(&place.rows(&format!("--no-reference --mesh {file}"), 1), fragment);
    }
    let made = place.place.run("tet domain.obj -o own.mesh");
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let tets = io::read_tets(place.path("own.mesh")).unwrap().tets().len() as u64;
    for row in place.rows("--no-reference --mesh own.mesh", 0) {
        assert_has_figures(&row);
        assert_eq!(row["tets"].as_u64(), Some(tets), "{row}");
    }
}

#[test]
fn too_many_tets_take_their_own_rows_only() {
    let place = ComparePlace::new();
    assert_only_tets_fail(&place.rows("--no-reference --max-tets 10", 1), "10 are allowed");
    let output = place.run("--no-reference --max-tets 10 --out few");
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("10 are allowed") && text.contains("mean_value"), "{text}");
    assert!(place.path("few/mfs.csv").exists() && !place.path("few/fem.csv").exists());
    assert!(place.path("few/comparison.png").exists());
    let page = place.page("few");
    let words = of_kind(&page, "words");
    assert!(words[1].as_str().unwrap().contains("10 are allowed"), "{words:?}");
    let alternative = page["picture"]["alternative"].as_str().unwrap();
    assert!(
        alternative.contains("mfs, mean_value") && !alternative.contains("fem"),
        "{alternative}"
    );
}

#[test]
fn rows_that_take_too_long_say_so() {
    let place = ComparePlace::new();
    std::fs::create_dir(place.path("late")).unwrap();
    std::fs::write(place.path("late/comparison.html"), "of an earlier comparison").unwrap();
    let rows = place.rows("--time-limit 0.001 --out late", 1);
    assert_eq!(rows.len(), 4);
    for row in &rows {
        assert_error(row, "time limit of 0.001 s");
    }
    let comparison = place.comparison("late");
    assert!(comparison["reference"].is_null());
    // Without a map there is no picture, but a page all the same.
    assert!(!place.path("late/comparison.png").exists());
    let page = place.page("late");
    assert!(page["picture"].is_null());
    let words = of_kind(&page, "words");
    assert!(words[1].as_str().unwrap().contains("time limit"), "{words:?}");
    assert!(place.names("late").iter().all(|name| !name.contains("tmp")));
    assert_eq!(place.run("--time-limit 0").status.code(), Some(2));
}

#[test]
fn a_missing_reference_is_a_failed_check() {
    let place = ComparePlace::new();
    // The limit is on mfs, by which the reference is fitted; mean value coordinates do without.
    let rows = place.rows("--methods mean_value --memory 1", 1);
    assert_has_figures(&rows[0]);
    assert!(rows[0]["interior_difference"].is_null());
}

#[test]
fn surfaces_of_different_connectivity_are_named() {
    let place = ComparePlace::new();
    place.surface("finer.obj", &shapes::sphere(1.0, 3));
    let mut triangles = domain().triangles().to_vec();
    triangles.swap(0, 5);
    place.surface(
        "shuffled.obj",
        &SurfaceMesh::new(domain().vertices().to_vec(), triangles).unwrap(),
    );
    for (image, fragment) in [("finer.obj", "642"), ("shuffled.obj", "triangle 0 joins")] {
        let output = place.place.run(&format!("compare domain.obj --image {image} {SMALL}"));
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        let rows = String::from_utf8_lossy(&output.stdout).into_owned();
        for text in [text, rows.clone()] {
            for fragment in ["domain.obj", image, fragment] {
                assert!(text.contains(fragment), "no `{fragment}` in: {text}");
            }
        }
        for method in METHODS {
            assert!(rows.contains(method), "no {method} in: {rows}");
        }
    }
    let missing = place
        .place
        .run(&format!("compare domain.obj --image missing.obj {SMALL}"));
    assert_eq!(missing.status.code(), Some(2), "{}", stderr(&missing));
}

#[test]
fn finite_elements_are_refined_to_equal_accuracy() {
    let place = ComparePlace::new();
    let rows = place.rows("--methods mfs --equal-accuracy --out equal", 0);
    let goal = rows[0]["interior_difference"]["rms"].as_f64().unwrap();
    let comparison = place.comparison("equal");
    let steps = comparison["equal_accuracy"].as_array().unwrap();
    let (mfs, steps): (Vec<_>, Vec<_>) = steps.iter().partition(|step| step["name"] == "mfs");
    assert_eq!(mfs[0]["interior_difference"]["rms"].as_f64(), Some(goal));
    let reached: Vec<f64> = steps
        .iter()
        .map(|step| step["interior_difference"]["rms"].as_f64().unwrap())
        .collect();
    let (last, before) = reached.split_last().unwrap();
    assert!(
        *last <= goal && before.iter().all(|&rms| rms > goal),
        "{reached:?} for {goal}"
    );
    assert!(
        steps
            .windows(2)
            .all(|pair| pair[0]["tets"].as_u64() <= pair[1]["tets"].as_u64())
    );
    // Markdown, whose lines are not wrapped.
    let text = std::fs::read_to_string(place.path("equal/comparison.md")).unwrap();
    assert!(text.contains("Finite elements are as near with about"), "{text}");
}

#[test]
fn the_mesh_study_varies_meshes_and_sources() {
    let place = ComparePlace::new();
    place.rows("--methods mfs,fem --mesh-study --no-reference --out study", 0);
    let comparison = place.comparison("study");
    let studies = comparison["mesh_study"].as_array().unwrap();
    let methods: Vec<_> = studies.iter().map(|study| study["method"].as_str().unwrap()).collect();
    assert_eq!(methods, ["mfs", "fem"]);
    for study in studies {
        let runs = study["runs"].as_array().unwrap();
        assert_eq!(runs.len(), 4, "{study}");
        runs.iter().for_each(assert_has_figures);
        let spread = study["spread"]["rms"].as_f64().unwrap();
        assert!(0.0 < spread && spread < 0.01, "{study}");
    }
    let of_fem: Vec<&str> = studies[1]["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|run| run["what"].as_str().unwrap())
        .collect();
    assert!(
        of_fem[0].contains("TetGen") && of_fem[3].contains("Mesh_3"),
        "{of_fem:?}"
    );
}

#[test]
fn frames_that_cannot_be_used_are_named_and_passed_over() {
    let place = ComparePlace::new();
    let frame = |k: usize| shapes::deformed(&domain(), move |p| p + (bend(p) - p) * (0.5 * k as f64));
    place.surface("frame1.obj", &frame(1));
    place.surface("frame2.obj", &frame(2));
    place.surface("short.obj", &shapes::sphere(1.0, 1));
    let text = std::fs::read_to_string(place.path("frame1.obj")).unwrap();
    let first = text.lines().find(|line| line.starts_with("v ")).unwrap();
    std::fs::write(place.path("nan.obj"), text.replacen(first, "v nan 0 0", 1)).unwrap();
    let all = "frame1.obj short.obj nan.obj frame2.obj";
    place.rows(&format!("--no-reference --out bad --frames {all}"), 1);
    let comparison = place.comparison("bad");
    let sequence = comparison["sequence"].as_array().unwrap();
    assert_eq!(sequence.len(), 3, "mean values keep nothing from frame to frame");
    for row in sequence {
        let skipped = row["skipped"].as_array().unwrap();
        assert_eq!(skipped.len(), 2, "{row}");
        for (text, file) in skipped.iter().zip(["short.obj", "nan.obj"]) {
            assert!(text.as_str().unwrap().contains(file), "{text}");
        }
        assert_eq!(row["frame_seconds"].as_array().unwrap().len(), 2, "{row}");
        assert!(
            row["error"].is_null() && row["boundary_error_p99"].as_f64().unwrap() < 0.01,
            "{row}"
        );
    }
    let text = std::fs::read_to_string(place.path("bad/comparison.txt")).unwrap();
    assert!(text.contains("skipped"), "{text}");
    place.rows("--methods fem --no-reference --frames frame1.obj frame2.obj", 0);
    let none = place.run("--methods fem --no-reference --frames short.obj");
    assert_eq!(none.status.code(), Some(1));
    assert!(
        stderr(&none).contains("none of the 1 frames can be used"),
        "{}",
        stderr(&none)
    );
}

/// Figures that say what the map is, and not how long it took, are the same to the last bit on as many threads.
#[test]
fn the_same_comparison_gives_the_same_bytes() {
    let place = ComparePlace::new();
    for options in [
        "--threads 2 --out first",
        "--threads 2 --out second",
        "--threads 1 --out single",
    ] {
        assert_eq!(place.run(options).status.code(), Some(0));
    }
    for method in METHODS {
        let path = |folder: &str| place.path(folder).join(format!("{method}.csv"));
        let read = |folder| std::fs::read(path(folder)).unwrap();
        assert!(read("first") == read("second"), "{method}");
        let (two, one) = (numbers(&path("first")), numbers(&path("single")));
        assert_eq!(two.len(), one.len());
        for (a, b) in two.iter().zip(&one) {
            // 8 is the size of the target.
            assert!(
                (a - b).abs() <= 1e-9 * 8.0,
                "{method}: {a} on two threads and {b} on one"
            );
        }
    }
    assert_eq!(
        std::fs::read(place.path("first/points.csv")).unwrap(),
        std::fs::read(place.path("single/points.csv")).unwrap()
    );
}

#[test]
fn a_folder_that_cannot_be_written_is_found_at_once() {
    let place = ComparePlace::new();
    std::fs::write(place.path("file"), "text").unwrap();
    let mut folders = vec!["file", "file/below"];
    if cfg!(target_os = "linux") {
        // No one can write there, not even root.
        folders.push("/proc/self");
    }
    for folder in folders {
        let begun = Instant::now();
        let output = place.run(&format!("--out {folder}"));
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.starts_with("error: ") && text.contains(folder), "{text}");
        assert!(
            begun.elapsed() < Duration::from_secs(1),
            "work was done for a folder that cannot be written"
        );
    }
    assert_eq!(std::fs::read_to_string(place.path("file")).unwrap(), "text");
}

/// The processes whose command line says that they are workers of a comparison in `folder`.
#[cfg(target_os = "linux")]
fn workers(folder: &Path) -> Vec<u32> {
    let folder = folder.to_str().unwrap();
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let belongs = |id: &u32| {
        let line = std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).into_owned();
        line.contains("compare-worker") && line.contains(folder)
    };
    ids.filter(belongs).collect()
}

/// However the program ends, its processes do too, within two seconds, and leave nothing half written.
#[cfg(target_os = "linux")]
#[test]
fn processes_end_with_the_program() {
    for signal in ["KILL", "INT"] {
        let place = ComparePlace::new();
        // Large enough to be still at work when the signal comes.
        place.surface("domain.obj", &shapes::sphere(1.0, 5));
        place.surface("image.obj", &shapes::deformed(&shapes::sphere(1.0, 5), bend));
        std::fs::create_dir(place.path("scratch")).unwrap();
        let mut program = std::process::Command::new(assert_cmd::cargo::cargo_bin("solidmap"))
            .current_dir(place.folder.path())
            .args("compare domain.obj --image image.obj --out out --tolerance 1e-7".split(' '))
            // Where its processes have their jobs: this tells them from those of other tests.
            .env("TMPDIR", place.path("scratch"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        while workers(place.folder.path()).is_empty() {
            assert!(begun.elapsed() < Duration::from_secs(20), "no process was started");
            assert!(program.try_wait().unwrap().is_none(), "the comparison ended too soon");
            std::thread::sleep(Duration::from_millis(10));
        }
        let id = program.id().to_string();
        let killed = std::process::Command::new("kill")
            .args(["-s", signal, &id])
            .status()
            .unwrap();
        assert!(killed.success());
        program.wait().unwrap();
        let ended = Instant::now();
        while !workers(place.folder.path()).is_empty() {
            assert!(ended.elapsed() < Duration::from_secs(2), "{signal}: a process goes on");
            std::thread::sleep(Duration::from_millis(20));
        }
        // Maps that are complete may be there; without any the folder is gone too.
        if place.path("out").exists() {
            let names = place.names("out");
            assert!(signal == "KILL" || !names.is_empty(), "an empty folder is left");
            assert!(
                names
                    .iter()
                    .all(|name| !name.contains("tmp") && !name.starts_with("comparison")),
                "{names:?}"
            );
        }
    }
}
