//! `solidmap certify` from the command line: a map file in, what is proved and pictures out.

use crate::workplace::{Workplace, json, text};
use serde_json::Value;
use solidmap::Point;
use solidmap::mesh::shapes;

/// A cube that is made round, `good.map`, and one whose halves are pushed through each other, `folded.map`.
fn with_maps() -> Workplace {
    let place = Workplace::new();
    let cube = shapes::cube(1.0, 8);
    let round = shapes::deformed(&cube, |p| Point::from(p.coords.normalize()));
    let pushed = shapes::deformed(&cube, |p| Point::new(4.0 * p.x.powi(3) - 0.2 * p.x, p.y, p.z));
    place.surface("domain.obj", &cube);
    for (name, image) in [("good", round), ("folded", pushed)] {
        place.surface("image.obj", &image);
        place.ends_with(
            0,
            &format!("fit domain.obj --image image.obj -o {name}.map --tolerance 0.05"),
        );
    }
    place
}

#[test]
fn what_is_proved_is_printed_written_and_drawn() {
    let place = with_maps();
    let said = text(&place.ends_with(0, "certify good.map").stdout);
    for fragment in [
        "folded",
        "undecided",
        "singular values",
        "99 %",
        "locally one to one everywhere",
    ] {
        assert!(said.contains(fragment), "{said}");
    }
    // A quarter of the cube's side leaves cells of its boundary undecided.
    let said = text(&place.ends_with(0, "certify good.map --finest 4").stdout);
    assert!(said.contains("No fold is proved, and none is excluded"), "{said}");

    let line = "certify folded.map --finest 128 --json -o cells.vtu --png section.png --axis x --position 0.3";
    let report: Value = serde_json::from_slice(&place.ends_with(1, line).stdout).unwrap();
    let share = |name: &str| report[name]["fraction"].as_f64().unwrap();
    assert!(
        share("folded") > 0.02 && share("positive") > 0.5 && share("undecided") < 0.1,
        "{report}"
    );
    let sum = share("folded") + share("positive") + share("undecided");
    assert!((sum - 1.0).abs() < 1e-9 && report["volume_error"].as_f64().unwrap().abs() < 1e-9);
    assert_eq!(
        (&report["locally_one_to_one"], &report["stop_reason"]),
        (&false.into(), &"finest".into())
    );
    let png = std::fs::read(place.path("section.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 10_000);
    let cells = text(&std::fs::read(place.path("cells.vtu")).unwrap());
    for field in [
        "verdict",
        "sigma_min_bound",
        "det_bound",
        "det_centre",
        "level",
        "volume_inside",
    ] {
        assert!(cells.contains(&format!("\"{field}\"")), "{field}");
    }

    let said = text(&place.ends_with(1, "certify folded.map --finest 64").stdout);
    assert!(said.contains("The map folds: it is not one to one."), "{said}");
}

/// The middle of the cube is turned inside out: one place about its centre, in every command that measures it.
#[test]
fn the_place_of_a_fold_is_listed_drawn_and_the_same_in_energy() {
    let place = with_maps();
    let line = "certify folded.map --finest 128 --json --png through.png";
    let report = json(&place.ends_with(1, line));
    let places = report["worst_places"].as_array().unwrap();
    assert!((2..=5).contains(&places.len()), "{report}");
    let worst = &places[0];
    assert_eq!(worst["kind"], "folded");
    let number = |value: &Value| value.as_f64().unwrap();
    let sides = |name: &str| [0, 1, 2].map(|k| number(&worst[name][k]));
    let (low, high) = (sides("low"), sides("high"));
    for k in 0..3 {
        assert!(low[k] <= sides("point")[k] && sides("point")[k] <= high[k], "{worst}");
        assert!(sides("centre")[k].abs() < 0.05, "{worst}");
    }
    assert!(high[0] - low[0] < 0.5 && number(&worst["value"]) < 0.0, "{worst}");
    assert!(
        (number(&worst["share"]) - number(&report["folded"]["fraction"])).abs() < 0.01,
        "{report}"
    );
    assert!(report["folded_places"].as_u64().unwrap() >= 1 && report["undecided_places"].as_u64().unwrap() >= 1);
    let png = |name: &str| std::fs::read(place.path(name)).unwrap();
    place.ends_with(
        1,
        "certify folded.map --finest 128 --png across.png --axis x --position 0.9",
    );
    assert!(png("through.png").len() > 10_000 && png("through.png") != png("across.png"));

    let said = text(&place.ends_with(1, "certify folded.map --finest 64 --worst 1").stdout);
    assert!(
        said.contains("worst places") && said.matches("det J").count() == 1,
        "{said}"
    );
    let said = text(&place.ends_with(1, "certify folded.map --finest 64 --worst 0").stdout);
    assert!(!said.contains("worst places"), "{said}");

    let energy = json(&place.ends_with(0, "energy folded.map --json"));
    let (found, error) = (
        number(&energy["folded"]["fraction"]),
        number(&energy["folded"]["error"]),
    );
    let proved = number(&report["folded"]["fraction"]);
    let possible = proved + number(&report["undecided"]["fraction"]);
    assert!(
        found + error >= proved && found - error <= possible,
        "{energy} {report}"
    );
    let same = &energy["worst_places"][0];
    assert_eq!(same["kind"], "folded");
    for k in 0..3 {
        assert!(
            (number(&same["centre"][k]) - sides("centre")[k]).abs() < 0.05,
            "{same} {worst}"
        );
    }
    let said = text(&place.ends_with(0, "energy folded.map").stdout);
    assert!(said.contains("worst places") && said.contains(" ± "), "{said}");
}

/// A cube beside another that is reflected.
#[test]
fn a_part_that_is_mirrored_is_said_to_be() {
    let place = Workplace::new();
    let right = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x + 3.0, p.y, p.z));
    let domain = shapes::joined(&shapes::cube(1.2, 4), &right);
    place.surface("domain.obj", &domain);
    let mirrored = shapes::deformed(
        &domain,
        |p| if p.x > 1.5 { Point::new(6.0 - p.x, p.y, p.z) } else { *p },
    );
    place.surface("image.obj", &mirrored);
    place.ends_with(0, "fit domain.obj --image image.obj -o mirrored.map --tolerance 0.05");
    let said = text(&place.ends_with(1, "certify mirrored.map --finest 64").stdout);
    assert!(
        said.contains("turns 1 of the 2 parts of the domain inside out"),
        "{said}"
    );
    assert!(!said.contains("The map folds"), "{said}");
}

#[test]
fn what_cannot_run_is_refused_before_any_work() {
    let place = with_maps();
    for (line, fragment) in [
        ("certify good.map -o cells.obj", "name it .vtu"),
        ("certify good.map --png good.vtu", "name it .png"),
        ("certify good.map -o nowhere/cells.vtu", "there is no folder"),
        ("certify good.map --finest 1", "from 2 to 1048576"),
        ("certify good.map --max-cells 7", "at least 8"),
        ("certify good.map --undecided 1", "less than 1"),
        ("certify good.map --position 2", "--position"),
        ("certify domain.obj", "domain.obj"),
        ("certify missing.map", "missing.map"),
    ] {
        let said = text(&place.ends_with(2, line).stderr);
        assert!(said.contains(fragment), "{line}: {said}");
    }
}
