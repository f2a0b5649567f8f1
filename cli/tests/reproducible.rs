//! The same input, options and number of threads give the same bytes, in every file that is written.

use std::path::Path;

use crate::workplace::{Workplace, text, with_fitted_ball};
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::shapes;

/// What the commands below need; `map.safetensors` is there.
fn place() -> Workplace {
    let bend = |p: &Point| Point::new(p.x + 0.2 * p.y * p.y, p.y, p.z - 0.1 * p.x * p.y);
    let place = with_fitted_ball(bend);
    let cube = shapes::cube(2.0, 6);
    io::write_surface(place.path("cube.ply"), &cube).unwrap();
    io::write_surface(place.path("round.ply"), &shapes::projected_to_sphere(&cube, 1.0)).unwrap();
    let bumpy = shapes::bumpy_sphere(6);
    io::write_surface(place.path("bumpy.ply"), &bumpy).unwrap();
    io::write_surface(place.path("bent.ply"), &shapes::deformed(&shapes::sphere(1.0, 3), bend)).unwrap();
    let mut points = String::from("x,y,z,heat\n");
    for k in 0..500 {
        let t = f64::from(k) * 1e-3;
        points += &format!("{},{},{},{k}\n", t, 0.4 - t, 0.3 * t);
    }
    std::fs::write(place.path("points.csv"), points).unwrap();
    place
}

const FIT: &str = "fit domain.ply --image target.ply --tolerance 1e-3 -o out/fitted.map";
const IMAGES: &str = "eval out/fitted.map points.csv --jacobian -o out/images.csv";

/// Each writes into `out`, and may read what those before it have written.
const COMMANDS: [&str; 12] = [
    FIT,
    "fit domain.ply --image target.ply --method dense --s-ratio 0.3 -o out/dense.map",
    "fit cube.ply --image round.ply --tolerance 0.01 -o out/cube.map",
    "boundary sphere bumpy.ply -o out/sphere.ply",
    IMAGES,
    "eval out/fitted.map points.csv --inverse -o out/preimages.csv",
    "energy out/fitted.map --vtu out/energy.vtu --png out/energy.png",
    "certify out/fitted.map -o out/certificate.vtu",
    "transfer out/fitted.map --distance -o out/distance.vtu",
    "remesh out/cube.map --cells 8 --kind hex -o out/hexes.vtu --png out/hexes.png",
    "sequence domain.ply target.ply bent.ply -o out/sequence",
    "demo --out out/demo",
];

/// All files below a folder with what they hold.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().display().to_string();
                found.push((name, std::fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

/// Names of the files that differ.
fn differing(a: &[(String, Vec<u8>)], b: &[(String, Vec<u8>)]) -> Vec<String> {
    let names = |files: &[(String, Vec<u8>)]| files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(a), names(b));
    a.iter()
        .zip(b)
        .filter(|(a, b)| a != b)
        .map(|(a, _)| a.0.clone())
        .collect()
}

#[test]
fn the_same_run_gives_the_same_bytes() {
    let place = place();
    let run = |threads: usize, commands: &[&str]| {
        std::fs::create_dir(place.path("out")).unwrap();
        for command in commands {
            let output = place.run(&format!("{command} --threads {threads}"));
            assert!(
                output.status.code().is_some_and(|code| code < 2),
                "{command}: {}",
                text(&output.stderr)
            );
        }
        let found = contents(&place.path("out"));
        std::fs::remove_dir_all(place.path("out")).unwrap();
        found
    };
    let [first, second] = [2, 2].map(|threads| run(threads, &COMMANDS));
    let alone = run(1, &[FIT, IMAGES]);
    assert!(first.len() > 20, "{} files", first.len());
    assert_eq!(differing(&first, &second), [""; 0]);
    // With another number of threads, the dense coarsest level of a fit is rounded differently, and nothing else.
    let images = |files: &[(String, Vec<u8>)]| -> Vec<f64> {
        let (_, bytes) = files.iter().find(|(name, _)| name == "images.csv").unwrap();
        let table = text(bytes);
        let rows = table.lines().skip(1);
        rows.flat_map(|row| row.split(','))
            .map(|value| value.parse().unwrap())
            .collect()
    };
    let [first, alone] = [&first, &alone].map(|files| images(files));
    assert_eq!((first.len(), alone.len()), (500 * 16, 500 * 16));
    let furthest = first.iter().zip(&alone).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(furthest < 1e-6, "{furthest:e}");
}
