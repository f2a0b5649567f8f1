//! `solidmap eval --inverse` from the command line.

use std::path::Path;

use crate::workplace::{Workplace, with_fitted_ball};
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::shapes;

/// A folder with `map.safetensors`, from a ball to a longer one that is slightly bent.
fn with_map() -> Workplace {
    with_bent_ball(0.2)
}

/// The same with another bend. The map is close to `y + bend (x² + (1 − r²) / 3)`, which folds where
/// `y > 1.5 / bend`.
fn with_bent_ball(bend: f64) -> Workplace {
    with_fitted_ball(|p| Point::new(2.0 * p.x, p.y + bend * p.x * p.x, p.z))
}

/// The rows of a CSV file, and its header.
fn table(path: &Path) -> (String, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().to_owned();
    let rows = lines.map(|line| line.split(',').map(|word| word.parse().unwrap()).collect());
    (header, rows.collect())
}

#[test]
fn eval_there_and_back_gives_the_points_again() {
    let place = with_map();
    let points = [[0.0, 0.0, 0.0], [0.3, -0.4, 0.5], [-0.7, 0.2, 0.1], [0.1, 0.9, 0.0]];
    io::write_csv(place.path("points.csv"), &["x", "y", "z"], points.as_flattened()).unwrap();
    place.ends_with(0, "eval map.safetensors points.csv -o images.csv");
    let (_, images) = table(&place.path("images.csv"));
    let values: Vec<f64> = images.iter().flat_map(|row| row[3..6].to_vec()).collect();
    io::write_csv(place.path("targets.csv"), &["x", "y", "z"], &values).unwrap();

    let report = place.report(
        0,
        "eval map.safetensors targets.csv --inverse --jacobian -o back.csv --json",
    );
    assert_eq!((report["points"].as_u64(), report["ok"].as_u64()), (Some(4), Some(4)));
    assert!(report["round_trip_max"].as_f64().unwrap() <= 1e-10);
    let (header, rows) = table(&place.path("back.csv"));
    assert!(header.starts_with("x,y,z,fx,fy,fz,status,round_trip,j00"));
    for (row, point) in rows.iter().zip(points) {
        // The files hold all digits; `eval` sums as accurately as the map deserves.
        assert!(row[..3].iter().zip(point).all(|(a, b)| (a - b).abs() < 1e-6));
        assert_eq!((row[6], row.len()), (0.0, 17));
    }

    let report = place.report(0, "eval map.safetensors targets.csv --inverse -o back.npy --json");
    assert_eq!(report["output"], "back.npy");
    let size = std::fs::metadata(place.path("back.npy")).unwrap().len();
    assert_eq!(size, 128 + 4 * 5 * 8);
}

#[test]
fn points_outside_and_points_that_are_not_finite_are_counted() {
    let place = with_map();
    std::fs::write(place.path("points.csv"), "x,y,z\n0.1,0.1,0\nnan,0,0\n9,9,9\n").unwrap();
    let output = place.ends_with(0, "eval map.safetensors points.csv --inverse -o back.csv");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("1 of 3 points have NaN or infinite coordinates"),
        "{said}"
    );
    assert!(said.contains("1 of 3 points lie outside the target"), "{said}");
    let (_, rows) = table(&place.path("back.csv"));
    assert_eq!(rows.iter().map(|row| row[6]).collect::<Vec<_>>(), [0.0, 4.0, 2.0]);
    assert!(rows[1][0].is_nan() && rows[2][0].is_nan());
}

#[test]
fn a_mesh_comes_back_with_its_status() {
    let place = with_map();
    let inner = shapes::deformed(&shapes::cube(0.8, 2), |p| Point::new(1.3 * p.x, p.y, p.z));
    io::write_surface(place.path("inner.obj"), &inner).unwrap();
    for name in ["back.vtu", "back.vtk", "back.ply"] {
        place.ends_with(0, &format!("eval map.safetensors inner.obj --inverse -o {name}"));
        let back = io::read_surface(place.path(name)).unwrap();
        assert_eq!(back.triangles(), inner.triangles());
        assert!(
            back.vertices().iter().all(|p| p.x.abs() < 0.3 && p.y.abs() < 0.5),
            "{name}"
        );
    }
    let text = std::fs::read(place.path("back.vtu")).unwrap();
    assert!(String::from_utf8_lossy(&text).contains("Name=\"status\""));
}

/// With a bend of 4, `(0, 0.8, 0)` and `(0, -0.05, 0)` go to the same place.
#[test]
fn folds_are_counted_and_fail() {
    let place = with_bent_ball(4.0);
    std::fs::write(place.path("points.csv"), "x,y,z\n0,1.28,0\n0,0.5,0\n").unwrap();
    let report = place.report(1, "eval map.safetensors points.csv --inverse -o back.csv --json");
    assert_eq!(
        (report["folded"].as_u64(), report["several"].as_u64()),
        (Some(1), Some(1))
    );
    let (_, rows) = table(&place.path("back.csv"));
    assert_eq!(rows.iter().map(|row| row[6]).collect::<Vec<_>>(), [1.0, 0.0]);
    assert!((rows[0][1] + 0.05).abs() < 0.05, "{:?}", rows[0]);
}

#[test]
fn vertices_without_a_preimage_go_only_where_a_status_says_so() {
    let place = with_map();
    io::write_surface(place.path("wide.obj"), &shapes::cube(3.0, 2)).unwrap();
    for name in ["back.ply", "back.obj", "back.off"] {
        let output = place.ends_with(2, &format!("eval map.safetensors wide.obj --inverse -o {name}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains("have no preimage") && said.contains(".vtu"), "{said}");
        assert!(!place.path(name).exists());
    }
    place.ends_with(0, "eval map.safetensors wide.obj --inverse -o back.vtu");
    let back = io::read_surface(place.path("back.vtu")).unwrap();
    assert!(back.vertices().iter().all(|p| p.coords.norm() < 1.01));
}

#[test]
fn what_cannot_be_done_is_refused_before_the_work() {
    let place = with_map();
    std::fs::write(place.path("points.csv"), "x,y,z\n0,0,0\n").unwrap();
    for (line, message) in [
        (
            "eval map.safetensors points.csv --inverse -o back.vtu",
            "points without a mesh",
        ),
        (
            "eval map.safetensors points.csv --inverse --tolerance 0 -o back.csv",
            "tolerance is 0",
        ),
        (
            "eval map.safetensors points.csv --inverse --tolerance 0.01 -o back.csv",
            "at most 1e-3",
        ),
        (
            "eval map.safetensors points.csv --tolerance 1e-9 -o back.csv",
            "--inverse",
        ),
        ("eval map.safetensors none.csv --inverse -o back.csv", "none.csv"),
    ] {
        let output = place.ends_with(2, line);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(message), "{line}: {said}");
    }
    assert!(!place.path("back.csv").exists());
}
