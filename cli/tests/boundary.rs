//! `solidmap boundary` from the command line: files in, a verdict and pictures out.

use crate::workplace::{Workplace, json, text};
use serde_json::Value;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, BoundaryFile, BoundaryMetadata};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::SphericalEmbedding;
use solidmap::{Point, Vector};

/// A bumpy ball and its projection to the unit sphere.
fn with_ball() -> Workplace {
    let place = Workplace::new();
    let domain = shapes::bumpy_sphere(8);
    place.surface("domain.obj", &domain);
    place.surface("sphere.ply", &shapes::projected_to_sphere(&domain, 1.0));
    place
}

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

#[test]
fn a_map_to_the_sphere_is_reported_one_to_one_in_words_numbers_and_pictures() {
    let place = with_ball();
    let output = place.ends_with(0, "boundary check domain.obj sphere.ply --png map.png");
    let words = text(&output.stdout);
    for fragment in [
        "decided exactly",
        "degree",
        "flipped triangles",
        "symmetric Dirichlet",
        "99 %",
    ] {
        assert!(words.contains(fragment), "{words}");
    }
    let png = std::fs::read(place.path("map.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 50_000);
    let report = json(&place.ends_with(0, "boundary check domain.obj sphere.ply --json"));
    assert_eq!(report["verdict"], "bijective");
    assert_eq!(report["against"]["surface"], "sphere");
    assert_eq!((&report["degree"]["value"], &report["flipped"]), (&1.into(), &0.into()));
    assert!(report["distortion"]["angle"]["p90"].as_f64().unwrap() >= 1.0);
    assert!(report["coverage"].is_null() && report["seconds"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_target_adds_coverage_both_ways() {
    let place = with_ball();
    place.surface("fine.obj", &shapes::bumpy_sphere(24));
    let line = "boundary check domain.obj domain.obj --target fine.obj";
    let report = json(&place.ends_with(0, &format!("{line} --json")));
    assert_eq!(
        (&report["verdict"], &report["against"]["surface"]),
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
    let output = place.ends_with(0, "boundary check through.safetensors --png through.png");
    let words = text(&output.stdout);
    for fragment in [
        "One to one with the target, decided exactly",
        "domain, target, domain",
        "true images",
        "through the sphere",
    ] {
        assert!(words.contains(fragment), "{words}");
    }
    let png = std::fs::read(place.path("through.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 50_000);
    let report = json(&place.ends_with(0, "boundary check domain.obj through.safetensors --json"));
    assert_eq!(
        (&report["verdict"], &report["domain"], &report["boundary_file"]),
        (&"bijective".into(), &"domain.obj".into(), &"through.safetensors".into())
    );
    // Some roundings of coordinates of size 1 and of barycentric coordinates.
    assert!(report["by_sphere"]["round_trip"]["max"].as_f64().unwrap() < 1e-13);
    assert!(report["coverage"]["target_to_image"]["max"].as_f64().unwrap() < 1e-13);
    let report = json(&place.ends_with(0, "boundary check onto.safetensors --json --png onto.png"));
    assert_eq!(
        (&report["verdict"], &report["against"]["surface"]),
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
    for row in rows.as_array().unwrap() {
        assert!(row["boundary_error"]["rms"].as_f64().unwrap() < 0.05, "{row}");
    }
    assert_eq!(rows.as_array().unwrap().len(), 2, "{rows}");
    let rows = json(&place.ends_with(
        1,
        "compare sphere.ply --boundary through.safetensors --methods mfs --json",
    ));
    assert!(rows[0]["error"].as_str().unwrap().contains("another domain"), "{rows}");
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
        io::SolidMesh::Tets(tets) => tets.boundary().surface,
    };
    place.surface(
        "mirrored.ply",
        &shapes::deformed(&image, |p| Point::new(-p.x, p.y, p.z)),
    );
    let line = format!("boundary check {} mirrored.ply --json", bird.display());
    let report = json(&place.ends_with(1, &line));
    assert_eq!(report["findings"][0]["kind"], "mirrored", "{report}");
}

#[test]
fn a_model_is_mapped_to_the_sphere_in_every_form_asked_for() {
    let place = with_ball();
    let line = "boundary sphere domain.obj -o image.ply --boundary way.safetensors --png map.png --vtu map.vtu";
    let words = text(&place.ends_with(0, line).stdout);
    for fragment in [
        "one to one",
        "degree 1.000000",
        "before",
        "angle, degrees",
        "MiB",
        "way.safetensors",
    ] {
        assert!(words.contains(fragment), "{fragment}: {words}");
    }
    let (domain, image) = (
        shapes::bumpy_sphere(8),
        io::read_surface(place.path("image.ply")).unwrap(),
    );
    assert_eq!(image.triangles(), domain.triangles());
    assert!(image.vertices().iter().all(|p| (p.coords.norm() - 1.0).abs() < 1e-15));
    let file = files::read_boundary(&place.path("way.safetensors")).unwrap();
    assert_eq!(file.boundary.image(), image.vertices());
    let input = &file.metadata.inputs[0];
    assert_eq!((input.role.as_str(), input.file.as_str()), ("domain", "domain.obj"));
    let vtu = std::fs::read(place.path("map.vtu")).unwrap();
    for field in ["image", "area ratio", "angle distortion"] {
        assert!(
            String::from_utf8_lossy(&vtu).contains(&format!("Name=\"{field}\"")),
            "{field}"
        );
    }
    assert!(std::fs::read(place.path("map.png")).unwrap().starts_with(b"\x89PNG"));
    let report = json(&place.ends_with(0, "boundary check domain.obj image.ply --json"));
    assert_eq!(report["verdict"], "bijective");
}

#[test]
fn conformal_maps_keep_angles_better_and_may_start_from_the_flow() {
    let place = with_ball();
    let report =
        |options: &str| json(&place.ends_with(0, &format!("boundary sphere domain.obj -o i.obj --json {options}")));
    let (balanced, conformal) = (report(""), report("--energy conformal --start flow"));
    let angle = |report: &Value| report["distortion"]["angle"]["p90"].as_f64().unwrap();
    let area = |report: &Value| report["distortion"]["area"]["p90"].as_f64().unwrap();
    assert!(angle(&conformal) < angle(&balanced) && area(&conformal) > area(&balanced));
    assert_eq!(
        (&conformal["energy"], &conformal["start"]),
        (&"conformal".into(), &"flow".into())
    );
    assert_eq!(
        (&balanced["certificate"]["flipped"], &balanced["converged"]),
        (&0.into(), &true.into())
    );
}

#[test]
fn a_fit_to_the_sphere_is_the_fit_to_its_boundary_file() {
    let place = with_ball();
    place.ends_with(0, "boundary sphere domain.obj -o image.obj --boundary way.safetensors");
    let direct = json(&place.run("fit domain.obj --target sphere -o direct.map --json"));
    let by_file = json(&place.run("fit --boundary way.safetensors -o by_file.map --json"));
    assert!(direct["boundary_error"]["p99"].as_f64().unwrap() < 5e-3, "{direct}");
    assert_eq!(direct["boundary_error"], by_file["boundary_error"]);
    assert_eq!(
        (&direct["target"], &by_file["target"]),
        (&"sphere".into(), &Value::Null)
    );
    let map = files::read_map(&place.path("direct.map")).unwrap();
    let inputs: Vec<&str> = map.metadata.inputs.iter().map(|input| input.role.as_str()).collect();
    assert_eq!(inputs, ["domain"]);
    assert!(map.boundary.unwrap().domain_embedding().is_some());
}

/// `domain.obj` and another solid, `target.obj`, that it can be aligned with.
fn with_two_solids() -> Workplace {
    let place = with_ball();
    let stretched = |p: &Point| Point::new(1.4 * p.x + 0.2 * p.y * p.y, 0.9 * p.y, 1.1 * p.z - 0.1 * p.x);
    place.surface("target.obj", &shapes::deformed(&shapes::sphere(1.0, 3), stretched));
    std::fs::write(place.path("pairs.txt"), "# domain target\n0 3\n100 200\n").unwrap();
    std::fs::write(place.path("first.txt"), "0\n100\n").unwrap();
    std::fs::write(place.path("second.txt"), "3\n200\n").unwrap();
    place
}

#[test]
fn a_pair_is_mapped_in_every_form_asked_for_and_landmarks_are_met() {
    let place = with_two_solids();
    let line = "boundary pair domain.obj target.obj -o image.ply --boundary way.safetensors --png map.png --vtu map.vtu \
                --landmarks pairs.txt";
    let words = text(&place.ends_with(0, line).stdout);
    for fragment in [
        "one to one",
        "coarse embeddings",
        "2, all met exactly",
        "before",
        "after",
        "way.safetensors",
    ] {
        assert!(words.contains(fragment), "{fragment}: {words}");
    }
    let [domain, target, image] =
        ["domain.obj", "target.obj", "image.ply"].map(|name| io::read_surface(place.path(name)).unwrap());
    assert_eq!(image.triangles(), domain.triangles());
    for (v, w) in [(0, 3), (100, 200)] {
        assert!((image.vertices()[v] - target.vertices()[w]).norm() < 1e-9);
    }
    assert!(std::fs::read(place.path("map.png")).unwrap().starts_with(b"\x89PNG"));
    assert!(place.path("map.vtu").exists());
    let file = files::read_boundary(&place.path("way.safetensors")).unwrap();
    let roles: Vec<&str> = file.metadata.inputs.iter().map(|input| input.role.as_str()).collect();
    assert_eq!(roles, ["domain", "target", "landmarks"]);
    let report = json(&place.ends_with(0, "boundary check way.safetensors --json"));
    assert_eq!(report["verdict"], "bijective");
    assert!(report["by_sphere"]["round_trip"]["max"].as_f64().unwrap() < 1e-9);

    // The same landmarks in two files, and the other method.
    let line = "boundary pair domain.obj target.obj -o two.ply --json --landmarks first.txt --landmarks second.txt";
    let report = json(&place.ends_with(0, line));
    assert_eq!((&report["via"], &report["landmarks"]), (&"targets".into(), &2.into()));
    assert_eq!(
        io::read_surface(place.path("two.ply")).unwrap().vertices(),
        image.vertices()
    );
    let line = "boundary pair domain.obj target.obj -o conformal.ply --via conformal --no-improve --json";
    let report = json(&place.ends_with(0, line));
    assert_eq!(report["via"], "conformal");
    assert_eq!(report["before"], report["after"]);
    assert!(!report["rotations"].as_array().unwrap().is_empty());
}

#[test]
fn a_fit_to_a_model_is_the_fit_to_the_boundary_file_of_the_pair() {
    let place = with_two_solids();
    place.ends_with(
        0,
        "boundary pair domain.obj target.obj -o image.obj --boundary way.safetensors",
    );
    let direct = json(&place.run("fit domain.obj --target target.obj -o direct.map --json"));
    let by_file = json(&place.run("fit --boundary way.safetensors -o by_file.map --json"));
    assert!(direct["boundary_error"]["p99"].as_f64().unwrap() < 5e-3, "{direct}");
    assert_eq!(direct["boundary_error"], by_file["boundary_error"]);
    let map = files::read_map(&place.path("direct.map")).unwrap();
    let roles: Vec<&str> = map.metadata.inputs.iter().map(|input| input.role.as_str()).collect();
    assert_eq!(roles, ["domain", "target"]);
    // Boundary errors are distances from the target's surface: to be small, the map must follow the curved target.
    let checked = json(&place.ends_with(0, "boundary check way.safetensors --json"));
    assert_eq!(checked["verdict"], "bijective");
}

#[test]
fn pairs_that_cannot_be_mapped_end_with_2_and_name_the_side() {
    let place = with_two_solids();
    place.surface("ring.obj", &shapes::torus(1.0, 0.3, 12, 6));
    std::fs::write(place.path("far.txt"), "0 100000\n").unwrap();
    std::fs::write(place.path("words.txt"), "nose nose\n").unwrap();
    for (line, fragments) in [
        ("pair domain.obj ring.obj", vec!["target", "genus 1"]),
        ("pair ring.obj domain.obj", vec!["domain", "genus 1"]),
        ("pair domain.obj missing.obj", vec!["missing.obj"]),
        (
            "pair domain.obj target.obj --landmarks missing.txt",
            vec!["missing.txt"],
        ),
        (
            "pair domain.obj target.obj --landmarks far.txt",
            vec!["far.txt", "100000"],
        ),
        (
            "pair domain.obj target.obj --landmarks words.txt",
            vec!["words.txt", "line 1"],
        ),
        (
            "pair domain.obj target.obj --landmarks first.txt --landmarks far.txt",
            vec!["far.txt"],
        ),
    ] {
        let words = text(&place.ends_with(2, &format!("boundary {line} -o image.obj")).stderr);
        for fragment in fragments {
            assert!(words.contains("error: ") && words.contains(fragment), "{line}: {words}");
        }
    }
    for options in ["--landmarks pairs.txt", "--via conformal", "--no-improve"] {
        let line = format!("fit domain.obj --target sphere {options} -o m.map");
        let words = text(&place.ends_with(2, &line).stderr);
        assert!(words.contains("--target MODEL"), "{line}: {words}");
    }
    assert!(!place.path("image.obj").exists());
}

#[test]
fn what_does_not_go_to_the_sphere_ends_with_2_and_is_named() {
    let place = with_ball();
    let sphere = shapes::sphere(1.0, 1);
    place.surface("ring.obj", &shapes::torus(1.0, 0.3, 12, 6));
    place.surface(
        "two.obj",
        &shapes::joined(&sphere, &shapes::deformed(&sphere, |p| p * 3.0)),
    );
    let open = SurfaceMesh::new(sphere.vertices().to_vec(), sphere.triangles()[1..].to_vec()).unwrap();
    place.surface("open.obj", &open);
    let thrice = [sphere.triangles(), &[[0, 1, 2], [0, 2, 1]]].concat();
    place.surface(
        "fins.obj",
        &SurfaceMesh::new(sphere.vertices().to_vec(), thrice).unwrap(),
    );
    let good = std::fs::read_to_string(place.path("domain.obj")).unwrap();
    let bad = good.replacen(good.lines().find(|l| l.starts_with("v ")).unwrap(), "v nan 0 0", 1);
    std::fs::write(place.path("nan.obj"), bad).unwrap();
    for (model, fragment) in [
        ("ring.obj", "genus 1"),
        ("two.obj", "2 components"),
        ("open.obj", "3 edges have one triangle"),
        ("fins.obj", "not a manifold"),
        ("nan.obj", "vertex 0"),
        ("missing.obj", "No such file"),
    ] {
        for line in [
            format!("boundary sphere {model} -o image.obj --png image.png"),
            format!("fit {model} --target sphere -o image.map"),
        ] {
            let words = text(&place.ends_with(2, &line).stderr);
            assert!(
                words.contains("error: ") && words.contains(model) && words.contains(fragment),
                "{line}: {words}"
            );
        }
    }
    for (line, fragment) in [
        ("boundary sphere domain.obj -o image.stl", ".obj or .ply or .off"),
        ("boundary sphere domain.obj -o domain.obj", "overwritten"),
        ("boundary sphere domain.obj -o image.obj --vtu image.obj", "overwritten"),
        ("boundary sphere domain.obj -o image.obj --png map.jpg", ".png"),
        (
            "fit domain.obj --target sphere --image sphere.ply -o m.map",
            "cannot be used with",
        ),
    ] {
        let words = text(&place.ends_with(2, line).stderr);
        assert!(words.contains(fragment), "{line}: {words}");
    }
    assert!(!place.path("image.obj").exists() && !place.path("image.png").exists());
}
