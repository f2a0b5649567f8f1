//! What is on the disk is never lost: a file holds what it held before, or all of what was to be written.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::workplace::{Workplace, text, with_fitted_ball};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use solidmap::Point;

/// How often a command is killed.
const MOMENTS: usize = 20;

fn program() -> std::path::PathBuf {
    assert_cmd::cargo::cargo_bin("solidmap")
}

/// A map, and points that take a while to write.
fn place() -> Workplace {
    let place = with_fitted_ball(|p| Point::new(1.5 * p.x, p.y + 0.2 * p.x * p.z, p.z));
    let mut points = String::from("x,y,z\n");
    for k in 0..60_000 {
        let t = f64::from(k) * 1e-5;
        points += &format!("{},{},{}\n", 0.5 * t, 0.3 - t, 0.2 * t);
    }
    std::fs::write(place.path("points.csv"), points).unwrap();
    place
}

/// Runs a command again and again and kills it, each time at another moment of the time that it takes.
fn killed_at_random(place: &Workplace, line: &str, output: &str, seed: u64) {
    let run = || {
        Command::new(program())
            .current_dir(place.folder.path())
            .args(line.split_whitespace())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    let begun = Instant::now();
    assert!(run().wait().unwrap().code().is_some_and(|code| code < 2), "{line}");
    let whole = begun.elapsed();
    let new = std::fs::read(place.path(output)).unwrap();
    let old = b"what was there before".to_vec();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut ends = [0; 2];
    for moment in 0..MOMENTS {
        std::fs::write(place.path(output), &old).unwrap();
        let mut child = run();
        // Every other time near the end, where it is written.
        let part = match moment % 2 {
            0 => random.random_range(0.0..1.0),
            _ => random.random_range(0.7..1.1),
        };
        std::thread::sleep(whole.mul_f64(part));
        child.kill().unwrap();
        child.wait().unwrap();
        let found = std::fs::read(place.path(output)).unwrap();
        assert!(
            found == old || found == new,
            "{line}: {} bytes, neither the old {} nor the new {}",
            found.len(),
            old.len(),
            new.len()
        );
        ends[usize::from(found == new)] += 1;
    }
    assert!(ends[0] > 0, "{line}: never killed before its end, of {ends:?}");
    // A file that was left half-written has a hidden name of its own, and hinders no later run.
    place.ends_with(0, line);
    assert_eq!(std::fs::read(place.path(output)).unwrap(), new, "{line}");
}

#[test]
fn a_fit_killed_at_any_moment_leaves_the_old_map_or_the_new_one() {
    let line = "fit domain.ply --image target.ply --tolerance 0.01 -o new.map";
    killed_at_random(&place(), line, "new.map", 1);
}

#[test]
fn images_killed_at_any_moment_are_the_old_ones_or_the_new_ones() {
    let line = "eval map.safetensors points.csv --jacobian -o images.csv";
    killed_at_random(&place(), line, "images.csv", 2);
}

/// Runs a command that can write no more than so many bytes to a file.
fn with_full_disk(folder: &Path, line: &str, blocks_of_512: usize) -> (i32, String) {
    // A limit on the size of files, with its signal ignored, is an error of writing, as a full disk is.
    let script = format!(
        "trap '' XFSZ; ulimit -f {blocks_of_512}; exec {} {line}",
        program().display()
    );
    let output = Command::new("sh")
        .current_dir(folder)
        .args(["-c", &script])
        .output()
        .unwrap();
    (output.status.code().unwrap_or(-1), text(&output.stderr))
}

#[test]
fn a_full_disk_is_an_error_that_names_the_file_and_leaves_the_old_one() {
    let place = place();
    let lines = [
        ("eval map.safetensors points.csv -o out.csv", "out.csv"),
        ("eval map.safetensors points.csv -o out.npy", "out.npy"),
        ("eval map.safetensors domain.ply -o out.vtu", "out.vtu"),
        (
            "fit domain.ply --image target.ply --tolerance 0.01 -o out.map",
            "out.map",
        ),
        ("energy map.safetensors --png out.png", "out.png"),
        ("transfer map.safetensors --distance -o carried.vtu", "carried.vtu"),
    ];
    for (line, output) in lines {
        std::fs::write(place.path(output), b"before").unwrap();
        let (code, said) = with_full_disk(place.folder.path(), line, 8);
        assert_eq!(code, 2, "{line}: {said}");
        assert!(said.contains(output) && !said.contains("panicked"), "{line}: {said}");
        assert_eq!(std::fs::read(place.path(output)).unwrap(), b"before", "{line}");
        std::fs::remove_file(place.path(output)).unwrap();
    }
    let names = std::fs::read_dir(place.folder.path()).unwrap().flatten();
    let hidden: Vec<_> = names
        .map(|e| e.file_name())
        .filter(|n| n.to_string_lossy().starts_with('.'))
        .collect();
    assert!(hidden.is_empty(), "{hidden:?} are left");
}

#[test]
fn a_folder_that_cannot_be_written_to_is_an_error_before_any_work() {
    let place = place();
    // Root may write to folders that forbid it, but not to this one.
    for folder in ["/proc", "/no/such/folder"] {
        let begun = Instant::now();
        let line = format!("fit domain.ply --image target.ply -o {folder}/out.map");
        let said = text(&place.ends_with(2, &line).stderr);
        assert!(said.contains(&format!("{folder}/out.map")), "{said}");
        assert!(begun.elapsed() < Duration::from_secs(10));
    }
}
