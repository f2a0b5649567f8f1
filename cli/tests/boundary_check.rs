//! `solidmap boundary check` and `compare` on boundary files: verdicts, numbers and pictures.

use crate::workplace::{Workplace, json, text, with_ball};
use solidmap::Point;
use solidmap::Vector;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, BoundaryFile, BoundaryMetadata};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::SphericalEmbedding;

/// Boundary files from a bumpy ball, `domain.obj`, through and onto the sphere, by rays from the centres.
fn with_boundary_files() -> Workplace {
    let place = with_ball();
    let by_rays = |mesh: SurfaceMesh| {
        let directions: Vec<Vector> = mesh.vertices().iter().map(|p| p.coords).collect();
        SphericalEmbedding::new(mesh, &directions).unwrap()
    };
    // Read back, so that it is the domain of the file to the last bit.
    let domain = by_rays(io::read_surface(place.path("domain.obj")).unwrap());
    let cube = by_rays(shapes::cube(2.0, 6));
    for (name, map) in [
        ("through.safetensors", BoundaryMap::through_sphere(domain.clone(), cube)),
        ("onto.safetensors", BoundaryMap::onto_sphere(domain)),
    ] {
        let file = BoundaryFile {
            boundary: map.unwrap(),
            metadata: BoundaryMetadata::new(vec![]),
        };
        files::write_boundary(&place.path(name), &file).unwrap();
    }
    place
}

/// The command succeeds, says all `fragments`, and draws a picture of more than a blank page.
fn assert_words_and_picture(place: &Workplace, line: &str, fragments: &[&str]) {
    let words = text(&place.ends_with(0, &format!("{line} --png map.png")).stdout);
    for fragment in fragments {
        assert!(words.contains(fragment), "{words}");
    }
    let png = std::fs::read(place.path("map.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 50_000);
}

#[test]
fn a_map_to_the_sphere_is_reported_one_to_one_in_words_numbers_and_pictures() {
    let place = with_ball();
    let fragments = [
        "decided exactly",
        "degree",
        "flipped triangles",
        "symmetric Dirichlet",
        "99 %",
    ];
    assert_words_and_picture(&place, "boundary check domain.obj sphere.ply", &fragments);
    let report = json(&place.ends_with(0, "boundary check domain.obj sphere.ply --json"));
    assert_eq!(report["verdict"], "bijective");
    assert_eq!(report["compared_with"]["surface"], "sphere");
    let places = report["worst_places"].as_array().unwrap();
    assert!(
        (1..=5).contains(&places.len()) && places[0]["kind"] == "distortion",
        "{report}"
    );
    assert_eq!((&report["degree"]["value"], &report["flipped"]), (&1.into(), &0.into()));
    assert!(report["distortion"]["angle"]["p90"].as_f64().unwrap() >= 1.0);
    assert!(report["coverage"].is_null() && report["seconds"]["total"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_target_adds_coverage_both_ways() {
    let place = with_ball();
    place.surface("fine.obj", &shapes::bumpy_sphere(24));
    let line = "boundary check domain.obj domain.obj --target fine.obj";
    let report = json(&place.ends_with(0, &format!("{line} --json")));
    assert_eq!(
        (&report["verdict"], &report["compared_with"]["surface"]),
        (&"no_defect_found".into(), &"target".into())
    );
    for way in ["image_to_target", "target_to_image"] {
        let max = report["coverage"][way]["max"].as_f64().unwrap();
        assert!(max > 0.0 && max < 0.01, "{report}");
    }
    let words = text(&place.ends_with(1, &format!("{line} --tolerance 1e-6")).stdout);
    assert!(
        words.contains("from target to image") && words.contains("the target is not covered"),
        "{words}"
    );
}

#[test]
fn folds_and_mirror_images_end_with_1() {
    let place = with_ball();
    let domain = shapes::bumpy_sphere(8);
    let mut vertices = domain.vertices().to_vec();
    vertices[0] = -vertices[0];
    place.surface("folded.obj", &domain.with_vertices(vertices).unwrap());
    let words = text(
        &place
            .ends_with(1, "boundary check domain.obj folded.obj --target domain.obj")
            .stdout,
    );
    assert!(
        words.contains("NOT one to one") && words.contains("repair: "),
        "{words}"
    );
    place.surface(
        "mirrored.obj",
        &shapes::deformed(&domain, |p| Point::new(p.x, p.y, -p.z)),
    );
    let report = json(&place.ends_with(1, "boundary check domain.obj mirrored.obj --json --png mirrored.png"));
    assert_eq!(
        (&report["findings"][0]["kind"], &report["degree"]["value"]),
        (&"mirrored".into(), &(-1).into())
    );
    assert!(place.path("mirrored.png").exists());
}

#[test]
fn boundary_files_are_decided_exactly_with_and_without_their_domain() {
    let place = with_boundary_files();
    let fragments = [
        "One to one with the target, decided exactly",
        "domain, target, domain",
        "true images",
        "through the sphere",
    ];
    assert_words_and_picture(&place, "boundary check through.safetensors", &fragments);
    let report = json(&place.ends_with(0, "boundary check domain.obj through.safetensors --json"));
    assert_eq!(
        (&report["verdict"], &report["domain"], &report["boundary_file"]),
        (&"bijective".into(), &"domain.obj".into(), &"through.safetensors".into())
    );
    // Some roundings of coordinates of size 1 and of barycentric coordinates.
    assert!(report["composition"]["round_trip"]["max"].as_f64().unwrap() < 1e-13);
    assert!(report["coverage"]["target_to_image"]["max"].as_f64().unwrap() < 1e-13);
    let report = json(&place.ends_with(0, "boundary check onto.safetensors --json --png onto.png"));
    assert_eq!(
        (&report["verdict"], &report["compared_with"]["surface"]),
        (&"bijective".into(), &"sphere".into())
    );
    assert!(place.path("onto.png").exists());
}

#[test]
fn methods_are_compared_on_a_boundary_file() {
    let place = with_boundary_files();
    let line = "compare --boundary through.safetensors --methods mfs,mean-value --no-reference --resolution 8 \
                --tolerance 0.05 --json";
    let rows = json(&place.run(line));
    let rows = &rows["methods"];
    for row in rows.as_array().unwrap() {
        assert!(row["boundary_error"]["rms"].as_f64().unwrap() < 0.05, "{row}");
    }
    assert_eq!(rows.as_array().unwrap().len(), 2, "{rows}");
    let rows = json(&place.ends_with(
        1,
        "compare sphere.ply --boundary through.safetensors --methods mfs --json",
    ));
    assert!(
        rows["methods"][0]["error"].as_str().unwrap().contains("another domain"),
        "{rows}"
    );
}

#[test]
fn what_cannot_be_checked_ends_with_2_and_says_why() {
    let place = with_ball();
    place.surface("other.obj", &shapes::sphere(1.0, 2));
    let good = std::fs::read_to_string(place.path("domain.obj")).unwrap();
    let bad = good.replacen(good.lines().find(|l| l.starts_with("v ")).unwrap(), "v nan 0 0", 1);
    std::fs::write(place.path("nan.obj"), bad).unwrap();
    for (line, fragments) in [
        ("domain.obj missing.obj", vec!["missing.obj"]),
        ("domain.obj other.obj", vec!["vertices", "domain.obj"]),
        ("domain.obj nan.obj", vec!["vertex 0 is not finite"]),
        ("nan.obj domain.obj", vec!["domain cannot be examined", "vertex 0"]),
        (
            "domain.obj domain.obj --target nan.obj",
            vec!["target cannot be examined"],
        ),
        ("domain.obj", vec!["is a mesh", "boundary file"]),
        ("missing.safetensors", vec!["missing.safetensors"]),
        ("domain.obj domain.txt", vec!["domain.txt"]),
        ("domain.obj sphere.ply --tolerance nan", vec!["--tolerance"]),
        ("domain.obj sphere.ply --png map.jpg", vec![".png"]),
        ("domain.obj sphere.ply --png sphere.ply", vec!["overwritten"]),
    ] {
        let words = text(&place.ends_with(2, &format!("boundary check {line}")).stderr);
        for fragment in fragments {
            assert!(words.contains("error: ") && words.contains(fragment), "{line}: {words}");
        }
    }
}

#[test]
fn the_bird_and_its_polycube_are_told_apart_from_their_mirror_images() {
    let Some(models) = crate::common::models() else { return };
    let place = Workplace::new();
    let [bird, polycube] = ["bird_object.vtk", "bird_polycube.vtk"].map(|name| models.join("maps").join(name));
    let line = format!("boundary check {} {} --json", bird.display(), polycube.display());
    let report = json(&place.run(&line));
    assert_eq!(
        (&report["faces"], &report["degree"]["value"]),
        (&8658.into(), &1.into()),
        "{report}"
    );
    let image = match io::read_solid(&polycube).unwrap() {
        io::SolidMesh::Surface(surface) => surface,
        io::SolidMesh::Cells(cells) => cells.boundary().surface,
    };
    place.surface(
        "mirrored.ply",
        &shapes::deformed(&image, |p| Point::new(-p.x, p.y, p.z)),
    );
    let line = format!("boundary check {} mirrored.ply --json", bird.display());
    let report = json(&place.ends_with(1, &line));
    assert_eq!(report["findings"][0]["kind"], "mirrored", "{report}");
}
