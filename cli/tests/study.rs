//! `solidmap study` from the command line: values against other ways to the same, tables that later runs go on with, rows
//! that fail while others go on.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files;
use solidmap::io;
use solidmap::map::VolumeMap;
use solidmap::mesh::{SurfaceMesh, shapes};

use crate::common::bent;
use crate::workplace::{Workplace, stderr, text};

/// Coarse, and without what is not looked at.
const SMALL: &str = "--resolution 12 --held-out 2000";

/// A ball, and its image that is bent.
fn place() -> Workplace {
    let place = Workplace::new();
    place.surface("ball.ply", &ball());
    place.surface("bent.ply", &shapes::deformed(&ball(), bent(0.2)));
    place
}

fn ball() -> SurfaceMesh {
    shapes::sphere(1.0, 2)
}

fn rows(report: &Value) -> &[Value] {
    report["rows"].as_array().unwrap()
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("no {key} in {row}"))
}

/// A table by its lines, each a list of cells.
fn table(path: &Path) -> Vec<Vec<String>> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).unwrap();
    let records = reader.records().map(Result::unwrap);
    records
        .map(|record| record.iter().map(String::from).collect())
        .collect()
}

fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    let difference = (found - expected).abs();
    assert!(
        difference <= tolerance * expected.abs(),
        "{what}: {found}, not {expected}"
    );
}

/// The C-Error from the map itself: the sum over all vertices, which are the collocation points at a c-ratio of 1.
fn c_error_of(place: &Workplace, map: &str) -> f64 {
    let map = files::read_map(&place.path(map)).unwrap();
    let image = io::read_surface(place.path("bent.ply")).unwrap();
    let images = map
        .map
        .evaluate(io::read_surface(place.path("ball.ply")).unwrap().vertices());
    let squares = images.iter().zip(image.vertices()).map(|(a, b)| (a - b).norm_squared());
    squares.sum::<f64>() / image.diagonal().powi(2)
}

#[test]
fn a_row_has_what_a_fit_and_its_energies_have() {
    let place = place();
    let line = format!("study placement ball.ply bent.ply {SMALL} --radius 0.8 --offset 0.1 --alpha 1.5 --json");
    let report = place.report(0, &line);
    assert_eq!(report["points"], report["vertices"]);
    let options = [
        ("sphere", "--radius 0.8"),
        #[cfg(feature = "native")]
        ("offset", "--offset 0.1"),
        ("adaptive", "--alpha 1.5"),
    ];
    for (placement, option) in options {
        let row = rows(&report).iter().find(|row| row["placement"] == placement).unwrap();
        let fit = format!(
            "fit ball.ply --image bent.ply {option} --method svd --s-ratio 0.6 --c-ratio 1 --no-refine --held-out 2000 \
             --tolerance 1 -o one.map --json"
        );
        let fit = place.report(0, &fit);
        for key in [
            "sources",
            "collocation",
            "c_error",
            "residual_rms",
            "boundary_error",
            "condition",
            "rank",
        ] {
            assert_eq!(row[key], fit[key], "{key} of {placement}");
        }
        let energy = place.report(0, "energy one.map --resolution 12 --json");
        for key in ["harmonic_energy", "deformation_energy"] {
            assert_close(number(row, key), number(&energy, key), 0.02, key);
        }
        assert_close(number(row, "c_error"), c_error_of(&place, "one.map"), 1e-3, placement);
        assert_eq!(row["unknowns"], fit["sources"].as_u64().unwrap() + 4);
        assert!(row["reused"] == false && row.get("error").is_none(), "{row}");
    }
}

/// The condition number by power iterations is one from singular values; both decompositions solve the same problem.
#[test]
fn both_decompositions_say_the_same() {
    let place = place();
    let line = format!(
        "study placement ball.ply bent.ply {SMALL} --placements sphere,adaptive --radius 0.6 --alpha 1,2 --json"
    );
    let svd = place.report(0, &line);
    let qr = place.report(0, &format!("{line} --method dense"));
    for (a, b) in rows(&svd).iter().zip(rows(&qr)) {
        assert_close(number(b, "condition"), number(a, "condition"), 0.1, "condition");
        assert_close(number(b, "c_error"), number(a, "c_error"), 1e-3, "C-Error");
        assert_eq!(a["rank"], b["rank"]);
        assert_close(
            number(b, "harmonic_energy"),
            number(a, "harmonic_energy"),
            1e-3,
            "energy",
        );
    }
}

#[test]
fn a_similarity_has_no_error_and_the_energy_of_the_identity() {
    let place = place();
    place.surface(
        "same.ply",
        &shapes::deformed(&ball(), |p| Point::from(2.0 * p.coords) + solidmap::Vector::x()),
    );
    let line = format!("study ratios ball.ply same.ply {SMALL} --alpha 1 --s-ratio 0.3,0.6 --c-ratio 1,2 --json");
    let report = place.report(0, &line);
    assert_eq!(rows(&report).len(), 4);
    for row in rows(&report) {
        assert!(
            number(row, "c_error") < 1e-20 && number(&row["boundary_error"], "max") < 1e-10,
            "{row}"
        );
        assert_close(number(row, "harmonic_energy"), 3.0, 1e-9, "harmonic energy");
        assert!(number(row, "deformation_energy").abs() < 1e-12, "{row}");
    }
    // Numbers of points are ratios of the vertices. Beyond these, each source has as many collocation points.
    let vertices = number(&report, "vertices");
    let counts = |row: &Value| ["sources", "collocation"].map(|key| number(row, key));
    let sources = (0.6 * vertices).round();
    assert_eq!(counts(&rows(&report)[1]), [sources, vertices]);
    assert_eq!(
        counts(&rows(&report)[3]),
        [sources, sources * (2.0 * vertices / sources).ceil()]
    );
}

#[test]
fn ratios_are_of_as_many_boundary_points_as_are_asked_for() {
    let place = place();
    let line =
        format!("study ratios ball.ply bent.ply {SMALL} --points 100 --alpha 1 --s-ratio 0.5 --c-ratio 1.2 --json");
    let report = place.report(0, &line);
    let row = &rows(&report)[0];
    assert_eq!(
        [&row["sources"], &row["collocation"], &report["points"]],
        [50, 120, 100]
    );
    assert_eq!(row["placement"], "adaptive");
}

#[test]
fn a_table_is_gone_on_with_and_keeps_other_rows() {
    let place = place();
    let line = format!("study placement ball.ply --image bent.ply {SMALL} --placements sphere -o table.csv --json");
    let reused = |options: &str| {
        place.report(0, &format!("{line} {options}"))["reused"]
            .as_u64()
            .unwrap()
    };
    assert_eq!(reused("--radius 0.7,1"), 0);
    let first = table(&place.path("table.csv"));
    assert_eq!(first.len(), 3);
    assert_eq!(reused("--radius 0.7,1"), 2);
    assert_eq!(table(&place.path("table.csv")), first, "nothing has changed");
    assert_eq!(reused("--radius 0.7,0.8,1"), 2);
    assert_eq!(reused("--radius 1 --seed 2"), 0, "another setting");
    place.surface("bent.ply", &shapes::deformed(&ball(), bent(0.3)));
    assert_eq!(reused("--radius 1"), 0, "another image");
    let last = table(&place.path("table.csv"));
    assert_eq!(last.len(), 6);
    assert_eq!(last[..3], first[..]);
    // What is in the table is what is reported, and not measured again.
    let column = first[0].iter().position(|name| name == "c_error").unwrap();
    let text = std::fs::read_to_string(place.path("table.csv")).unwrap();
    let replaced = text.replace(&last[5][column], "0.125");
    std::fs::write(place.path("table.csv"), replaced).unwrap();
    let report = place.report(0, &format!("{line} --radius 1"));
    assert_eq!(number(&rows(&report)[0], "c_error"), 0.125);
}

#[test]
fn a_setting_that_fails_is_a_row_with_its_reason_and_is_tried_again() {
    let place = place();
    let line = format!(
        "study placement ball.ply bent.ply {SMALL} --placements sphere --radius 0.4,1 -o table.csv --png c.png"
    );
    for _ in 0..2 {
        let ended = place.ends_with(1, &format!("{line} --json"));
        let report: Value = serde_json::from_slice(&ended.stdout).unwrap();
        let [failed, done] = rows(&report) else {
            panic!("{report}")
        };
        let error = failed["error"].as_str().unwrap();
        assert!(
            error.contains("--radius is 0.4") && error.contains("more than 0.5"),
            "{error}"
        );
        assert!(
            stderr(&ended).contains("sphere 0.4") && stderr(&ended).contains(error),
            "{}",
            stderr(&ended)
        );
        assert!(failed.get("c_error").is_none() && number(done, "c_error") > 0.0);
        assert_eq!((&report["failed"], &failed["reused"]), (&1.into(), &false.into()));
    }
    let rows_of_table = table(&place.path("table.csv"));
    assert_eq!(rows_of_table.len(), 3);
    assert!(rows_of_table[1].last().unwrap().contains("more than 0.5"));
    assert!(place.path("c.png").exists());
    for (options, reason) in [
        ("--s-ratio 0.6 --max-sources 50", "97 sources, and 50 are allowed"),
        ("--s-ratio 1.5", "cannot determine"),
        ("--s-ratio 0.6 --memory 1MB", "are allowed"),
        ("--s-ratio -1", "must be positive"),
    ] {
        let line = format!("study ratios ball.ply bent.ply {SMALL} --radius 1 --c-ratio 1 {options} --json");
        let report = place.report(1, &line);
        let error = rows(&report)[0]["error"].as_str().unwrap();
        assert!(error.contains(reason), "{options}: {error}");
    }
    let said = text(&place.ends_with(1, &line).stdout);
    assert!(said.contains("failed") && said.contains("1 failed"), "{said}");
}

#[test]
fn what_cannot_be_studied_is_refused_before_the_work() {
    let place = place();
    place.surface("other.ply", &shapes::cube(1.0, 3));
    std::fs::write(place.path("points.csv"), "x,y,z\n0,0,0\n").unwrap();
    let line = "study placement ball.ply bent.ply";
    for (line, fragments) in [
        ("study placement ball.ply none.ply", &["none.ply"][..]),
        ("study placement ball.ply other.ply", &["ball.ply", "other.ply"]),
        ("study ratios --boundary none.safetensors", &["none.safetensors"]),
        (&format!("{line} -o table.txt"), &["`table.txt`", "name it .csv"]),
        (
            &format!("{line} -o points.csv"),
            &["`points.csv` is not a table of this study", "another file"],
        ),
        (&format!("{line} --png no/c.png"), &["no/c.png", "no folder"]),
        (&format!("{line} --png c.png --html c.png"), &["c.png"]),
        (&format!("{line} --points 0"), &["--points is 0"]),
        (&format!("{line} --truncation 2"), &["--truncation is 2"]),
        (
            "study ratios ball.ply bent.ply --placement offset --alpha 1",
            &["--alpha has no meaning with --placement offset"],
        ),
        ("study boundary bent.ply", &["`bent.ply` is an image", "--domain"]),
        ("study boundary none.safetensors", &["none.safetensors"]),
        (
            "study boundary bent.ply other.ply --domain ball.ply",
            &["other.ply", "ball.ply"],
        ),
    ] {
        place.fails(line, fragments);
    }
    assert_eq!(
        std::fs::read_to_string(place.path("points.csv")).unwrap(),
        "x,y,z\n0,0,0\n"
    );
    for line in [
        "study placement ball.ply",
        "study ratios",
        "study",
        "study placement ball.ply bent.ply --image bent.ply",
    ] {
        assert_eq!(place.run(line).status.code(), Some(2), "{line}");
    }
}

#[test]
fn boundary_maps_are_ordered_by_the_energy_of_their_maps() {
    let place = place();
    place.surface("same.ply", &ball());
    place.surface("more.ply", &shapes::deformed(&ball(), bent(0.4)));
    place.ends_with(
        0,
        "boundary pair ball.ply bent.ply --aligned -o p.ply --boundary pair.safetensors",
    );
    let line = "study boundary bent.ply more.ply same.ply pair.safetensors --domain ball.ply --tolerance 0.01 \
                --resolution 12 -o maps.csv --json";
    let report = place.report(0, line);
    let energies: Vec<f64> = rows(&report).iter().map(|row| number(row, "harmonic_energy")).collect();
    assert!(energies[2] < energies[0] && energies[0] < energies[1], "{energies:?}");
    assert_close(energies[2], 3.0, 1e-9, "the identity");
    let surfaces: Vec<f64> = rows(&report)
        .iter()
        .map(|row| number(row, "surface_dirichlet"))
        .collect();
    assert_close(surfaces[2], 4.0, 1e-9, "the identity of the boundary");
    assert!(surfaces[0] < surfaces[1], "{surfaces:?}");
    for key in ["least_harmonic_energy", "least_deformation_energy"] {
        assert_eq!(report[key], "same.ply");
    }
    // The same map as `fit` makes by itself.
    place.ends_with(0, "fit ball.ply --image more.ply --tolerance 0.01 -o more.map");
    let alone = place.report(0, "energy more.map --resolution 12 --json");
    assert_close(energies[1], number(&alone, "harmonic_energy"), 1e-9, "alone");

    let again = place.report(0, line);
    assert_eq!(again["reused"], 4);
    let pictured = place.report(0, &format!("{line} --png maps.png --html maps.html"));
    assert_eq!(pictured["reused"], 0, "maps are made again to be seen");
    assert_eq!(table(&place.path("maps.csv")).len(), 5);
    assert!(std::fs::read(place.path("maps.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn maps_of_other_domains_are_not_compared() {
    let place = place();
    let cube = shapes::cube(1.0, 3);
    let boundary = |name: &str, domain: &SurfaceMesh| {
        let map = BoundaryMap::between(domain.clone(), domain).unwrap();
        place.surface("d.ply", domain);
        files::write_boundary(
            &place.path(name),
            &files::BoundaryFile {
                boundary: map,
                metadata: files::BoundaryMetadata::new(vec![]),
            },
        )
        .unwrap();
    };
    boundary("a.safetensors", &ball());
    boundary("b.safetensors", &cube);
    place.fails(
        "study boundary a.safetensors b.safetensors",
        &["`b.safetensors`", "another domain than `a.safetensors`"],
    );
    let tolerance = "--tolerance 1e-9 --no-refine --resolution 12";
    let missed = place.ends_with(0, &format!("study boundary a.safetensors {tolerance}"));
    assert!(text(&missed.stdout).contains("a.safetensors"));
    place.surface("bent.ply", &shapes::deformed(&ball(), bent(0.2)));
    let missed = place.ends_with(1, &format!("study boundary bent.ply --domain ball.ply {tolerance}"));
    assert!(stderr(&missed).contains("miss the tolerance"), "{}", stderr(&missed));
}

#[test]
fn a_page_has_the_picture_the_rows_and_what_they_mean() {
    let place = place();
    let line = format!(
        "study placement ball.ply bent.ply {SMALL} --placements sphere,adaptive --radius 0.4,1 --alpha 1 --s-ratio 0.3,0.6 \
         --html page.html --png page.png"
    );
    place.ends_with(1, &line);
    let page = std::fs::read_to_string(place.path("page.html")).unwrap();
    for shown in [
        "data:image/png;base64,iVBORw0KGgo",
        "\"kind\":\"report\"",
        "C-Error",
        "diagonal²",
        "more than 0.5",
        "page/report",
        "ball.ply → bent.ply: place of the sources",
    ] {
        assert!(page.contains(shown), "{shown}");
    }
    for fetched in ["src=\"http", "href=\"http", "url(http", "@import"] {
        assert!(!page.contains(fetched), "{fetched}");
    }
}

#[test]
fn help_tells_the_studies_and_their_options() {
    let help = |line: &str| text(&Workplace::new().ends_with(0, line).stdout);
    let all = help("study --help");
    for word in [
        "placement",
        "ratios",
        "boundary",
        "figure 5 a to c",
        "figure 5 d",
        "figure 3",
    ] {
        assert!(all.contains(word), "{word}: {all}");
    }
    let placement = help("study placement --help");
    for word in [
        "R-Ratio",
        "O-Distance",
        "sRatio",
        "cRatio",
        "--points",
        "--output",
        "--png",
        "--html",
        "exit code 1",
    ] {
        assert!(placement.contains(word), "{word}: {placement}");
    }
}

/// Ctrl-C keeps what is done, and a later run goes on with it.
#[cfg(unix)]
#[test]
fn an_interrupted_study_resumes() {
    let place = place();
    let radii: Vec<String> = (0..200).map(|k| format!("{}", 0.6 + 0.01 * f64::from(k))).collect();
    let line = format!(
        "study placement ball.ply bent.ply --placements sphere -o table.csv --radius {}",
        radii.join(",")
    );
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("solidmap"))
        .current_dir(place.folder.path())
        .args(line.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let path = place.path("table.csv");
    let begun = Instant::now();
    while !path.exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no row after a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
    // SAFETY: sends a signal to a process that this test has started and not waited for.
    unsafe { libc::kill(child.id() as libc::pid_t, libc::SIGINT) };
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let done = table(&path).len() - 1;
    assert!((1..200).contains(&done), "{done} rows");
    let first = &radii[..done.min(3)];
    let line = format!(
        "study placement ball.ply bent.ply --placements sphere -o table.csv --json --radius {},9",
        first.join(",")
    );
    let report = place.report(0, &line);
    assert_eq!(report["reused"], first.len());
    assert_eq!(table(&path).len() - 1, done + 1);
}
