//! Limits on time and memory: commands stop in time or are refused before they take memory; estimates can be relied on.

use std::time::{Duration, Instant};

use crate::common::models;
use crate::workplace::{Workplace, json, text};
use serde_json::Value;
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::shapes;

/// A folder with a ball, a cube, and a map from the cube to a ball.
fn place() -> Workplace {
    let place = Workplace::new();
    let cube = shapes::cube(2.0, 8);
    io::write_surface(place.path("ball.ply"), &shapes::sphere(1.0, 6)).unwrap();
    io::write_surface(place.path("cube.ply"), &cube).unwrap();
    io::write_surface(place.path("round.ply"), &shapes::projected_to_sphere(&cube, 1.0)).unwrap();
    place.ends_with(0, "fit cube.ply --image round.ply --tolerance 0.01 -o cube.map");
    place
}

#[test]
fn a_command_ends_at_its_time_limit_and_leaves_nothing() {
    let place = place();
    let begun = Instant::now();
    let refused = place.ends_with(
        2,
        "fit ball.ply --image ball.ply -o ball.map --tolerance 1e-9 --time-limit 0.3",
    );
    let said = text(&refused.stderr);
    assert!(said.contains("time limit of 0.3 s (--time-limit)"), "{said}");
    // Not a measure of speed: a fit of 40 962 vertices takes several times as long.
    assert!(begun.elapsed() < Duration::from_secs(3));
    assert!(!place.path("ball.map").exists());
    let files = std::fs::read_dir(place.folder.path()).unwrap().flatten();
    assert!(
        files
            .map(|e| e.file_name())
            .all(|name| !name.to_string_lossy().starts_with('.'))
    );
    // A limit that is long enough changes nothing.
    place.ends_with(0, "eval cube.map cube.ply -o images.csv --time-limit 1000");
    for limit in ["0", "-1", "nan", "inf", "soon"] {
        let said = text(
            &place
                .ends_with(2, &format!("check ball.ply --time-limit={limit}"))
                .stderr,
        );
        assert!(said.contains("--time-limit") && said.contains(limit), "{said}");
    }
}

#[test]
fn a_fit_that_runs_out_of_time_writes_the_best_map_so_far() {
    let place = place();
    // The first map is there in a fraction of a second; refining it to this tolerance takes far longer.
    let line = "fit cube.ply --image round.ply -o best.map --tolerance 1e-8 --max-s-ratio inf --json";
    let begun = Instant::now();
    let output = place.ends_with(1, &format!("{line} --time-limit 3"));
    assert!(begun.elapsed() < Duration::from_secs(30));
    let report = json(&output);
    assert_eq!(report["refinement_end"], "concluded", "{report}");
    assert!(report["boundary_error"]["p99"].as_f64().unwrap() < 0.1);
    let said = text(&output.stderr);
    assert!(said.contains("Raise --time-limit"), "{said}");
    place.ends_with(0, "eval best.map cube.ply -o images.csv");
}

#[test]
fn a_pair_that_runs_out_of_time_leaves_a_map_or_nothing_and_says_which() {
    let Some(models) = models() else { return };
    let place = Workplace::new();
    let model = |name: &str| models.join("surfaces").join(name).display().to_string();
    let line = format!(
        "fit {} --target {} -o best.map --json",
        model("spot_uv_2k9.obj"),
        model("goathead_2k8.obj")
    );
    // How long the pair takes depends on the machine. It has a valid map long before it has its best one, so that some of
    // these limits falls between.
    for limit in [1, 2, 4, 8, 16, 32, 64] {
        let output = place.run(&format!("{line} --time-limit {limit}"));
        let report = json(&output);
        match output.status.code() {
            Some(2) => {
                assert_eq!(report["error"]["kind"], "time_limit", "{report}");
                assert!(!place.path("best.map").exists());
            }
            Some(1) => {
                assert!(report["boundary_error"]["rms"].as_f64().unwrap() < 0.2, "{report}");
                let said = text(&output.stderr);
                assert!(said.contains("time limit") || said.contains("--time-limit"), "{said}");
                place.ends_with(0, &format!("eval best.map {} -o images.csv", model("spot_uv_2k9.obj")));
                return;
            }
            code => panic!("{code:?} at {limit} s: the limit was not reached"),
        }
    }
    panic!("no map in 64 s");
}

/// Address space that is too small for a command leads to an error, whatever it is doing then.
#[cfg(target_os = "linux")]
#[test]
fn memory_that_the_system_refuses_is_an_error_and_no_abort() {
    let place = place();
    let program = assert_cmd::cargo::cargo_bin("solidmap");
    let mut out_of_memory = 0;
    for kib in [60_000, 90_000, 120_000, 160_000, 200_000, 250_000] {
        for line in [
            "boundary pair ball.ply cube.ply -o image.ply --json --threads 2",
            "certify cube.map --json --threads 2",
            "fit ball.ply --image ball.ply -o out.map --json --threads 2",
        ] {
            let script = format!("ulimit -v {kib} && exec {} {line}", program.display());
            let output = std::process::Command::new("sh")
                .current_dir(place.folder.path())
                .args(["-c", &script])
                .output()
                .unwrap();
            let said = format!("{line} with {kib} KiB: {}", text(&output.stderr));
            match output.status.code() {
                Some(0 | 1) => {}
                Some(2) => {
                    let report = json(&output);
                    assert_eq!(report["error"]["exit_code"], 2, "{said}");
                    assert!(text(&output.stderr).contains("error: "), "{said}");
                    out_of_memory += usize::from(report["error"]["kind"] == "out_of_memory");
                }
                other => panic!("{other:?}: {said}"),
            }
            let files = std::fs::read_dir(place.folder.path()).unwrap().flatten();
            let left = files.filter(|file| file.file_name().to_string_lossy().starts_with('.'));
            assert_eq!(left.count(), 0, "{said}");
        }
    }
    assert!(out_of_memory > 0, "no limit was small enough");
}

#[test]
fn what_needs_more_memory_than_allowed_is_refused_before_it_is_taken() {
    let place = place();
    for (line, fragments) in [
        (
            "fit ball.ply --image ball.ply -o out.map --memory 60MB",
            ["60MB", "sources"],
        ),
        (
            "remesh cube.map --cells 200 -o out.vtu --memory 1GiB",
            ["48000000 cells", "1.0 GiB"],
        ),
        (
            "remesh cube.map --cells 200 --kind hex -o out.vtu --memory 1GiB",
            ["8240000 cells", "1.0 GiB"],
        ),
    ] {
        let line = match line.starts_with("remesh") {
            true => format!("{line} --max-cells 100000000"),
            false => line.to_owned(),
        };
        let begun = Instant::now();
        let said = text(&place.ends_with(2, &line).stderr);
        let found = fragments.iter().filter(|fragment| said.contains(**fragment)).count();
        assert!(found > 0 && said.contains("memory"), "{line}: {said}");
        // Nothing of that size was made.
        assert!(begun.elapsed() < Duration::from_secs(20), "{line}");
    }
}

/// The peak over the estimate.
fn ratio(report: &Value) -> f64 {
    let peak = report["peak_rss_bytes"].as_f64().unwrap();
    let estimate = match report["memory_estimate"].as_f64() {
        Some(estimate) => estimate,
        None => report["fit"]["memory_estimate"].as_f64().unwrap(),
    };
    peak / estimate
}

#[test]
fn estimates_of_meshes_are_within_30_percent_of_the_peak_on_models() {
    let Some(models) = models() else { return };
    let place = Workplace::new();
    let map = |name: &str| models.join("maps").join(name).display().to_string();
    for (domain, image, name) in [
        ("max_planck_cube.mesh", "max_planck_object.mesh", "head.map"),
        ("bird_polycube.vtk", "bird_object.vtk", "bird.map"),
    ] {
        place.ends_with(0, &format!("fit {} --image {} -o {name}", map(domain), map(image)));
    }
    for line in [
        "head.map --cells 24",
        "head.map --cells 40",
        "head.map --cells 28 --kind hex",
        "bird.map --cell-size 0.02",
        "bird.map --cell-size 0.03 --kind hex",
    ] {
        // Inverted cells or not, and a boundary that crosses itself or not: it is the memory that counts here.
        let run = place.run(&format!("remesh {line} --polish 3 -o mesh.vtu --json"));
        let ratio = ratio(&json(&run));
        assert!(
            (1.0 / 1.3..1.3).contains(&ratio),
            "{line}: the peak is {ratio:.2} of the estimate"
        );
    }
}

#[test]
fn estimates_of_fits_are_within_30_percent_of_the_peak_on_models() {
    let Some(models) = models() else { return };
    let place = Workplace::new();
    let solids = [
        "pairs/cat.obj",
        "surfaces/kitten_g1_9k.obj",
        "surfaces/igea_15k.obj",
        "surfaces/max_planck_27k.obj",
        "surfaces/igea_134k.ply",
    ];
    for model in solids {
        let model = models.join(model);
        let surface = io::read_surface(&model).unwrap();
        let size = surface.diagonal();
        let bent = shapes::deformed(&surface, |p| {
            let angle = 2.0 * p.z / size;
            Point::new(p.x + 0.1 * size * angle.sin(), p.y + 0.1 * p.x * p.z / size, p.z)
        });
        io::write_surface(place.path("image.ply"), &bent).unwrap();
        let line = format!(
            "fit {} --image image.ply --no-refine -o out.map --json",
            model.display()
        );
        let report = place.report(0, &line);
        let ratio = ratio(&report);
        assert!(
            (1.0 / 1.3..1.3).contains(&ratio),
            "{}: the peak is {ratio:.2} of the estimate",
            model.display()
        );
    }
}
