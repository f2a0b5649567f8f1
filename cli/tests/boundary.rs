//! `solidmap boundary sphere` and `pair`: boundary maps made from solids alone, and fits to them.

use crate::workplace::{Workplace, json, text, with_ball};
use serde_json::Value;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, BoundaryFile, BoundaryMetadata};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::SphericalEmbedding;
use solidmap::{Point, Vector};

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
    assert!(report["composition"]["round_trip"]["max"].as_f64().unwrap() < 1e-9);

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
fn maps_that_stretch_too_much_end_with_1_and_the_place_is_named() {
    let place = with_two_solids();
    let line = "boundary pair domain.obj target.obj -o image.obj --max-stretched 0 --json";
    let report = json(&place.ends_with(0, line));
    assert_eq!(report["stretch"]["share"], 0.0);
    // A needle from a ball: no map keeps lengths.
    let needle = shapes::deformed(&shapes::sphere(1.0, 4), |p| {
        Point::new(0.01 * p.x, 0.01 * p.y, 5.0 * p.z)
    });
    place.surface("needle.obj", &needle);
    let output = place.ends_with(1, "boundary pair domain.obj needle.obj -o image.obj");
    let words = text(&output.stderr);
    assert!(words.contains("looks wrong") && words.contains("around ("), "{words}");
    assert!(place.path("image.obj").exists());
    place.ends_with(0, "boundary pair domain.obj needle.obj -o image.obj --max-stretched 1");
}

#[test]
fn a_speck_of_the_domain_that_covers_much_of_the_target_ends_with_1() {
    let place = Workplace::new();
    // A cap of 2° about the pole goes to one of 25°.
    let target = shapes::sphere(1.0, 5);
    let directions: Vec<Vector> = target.vertices().iter().map(|p| p.coords).collect();
    let domain = shapes::deformed(&target, |p| {
        let degrees = p.z.clamp(-1.0, 1.0).acos().to_degrees();
        let new = match degrees < 25.0 {
            true => degrees * 2.0 / 25.0,
            false => 180.0 - (180.0 - degrees) * 178.0 / 155.0,
        };
        let around = Vector::new(p.x, p.y, 0.0).try_normalize(1e-12).unwrap_or_default();
        Point::from(around * new.to_radians().sin() + Vector::z() * new.to_radians().cos())
    });
    place.surface("domain.ply", &domain);
    place.surface("target.ply", &target);
    let [domain, target] = [domain, target].map(|surface| SphericalEmbedding::new(surface, &directions).unwrap());
    let file = BoundaryFile {
        boundary: BoundaryMap::through_sphere(domain, target).unwrap(),
        metadata: BoundaryMetadata::new(vec![]),
    };
    files::write_boundary(&place.path("speck.safetensors"), &file).unwrap();
    let line = "boundary pair domain.ply target.ply --start speck.safetensors --no-improve -o image.ply";
    let words = text(&place.ends_with(1, line).stderr);
    assert!(
        words.contains("of the target's area") && !words.contains("domain's"),
        "{words}"
    );
    let report = json(&place.ends_with(0, &format!("{line} --max-stretched 0.02 --json")));
    let number = |name: &str| report["stretch"].pointer(name).unwrap().as_f64().unwrap();
    assert!(number("/share") < 0.001 && number("/target/share") > 0.04, "{report}");
    assert_eq!([number("/limit"), number("/target/limit")], [0.02, 0.08]);
}

#[test]
fn starts_curves_directions_and_alternatives_are_given_on_the_command_line() {
    let place = with_two_solids();
    place.ends_with(
        0,
        "boundary pair domain.obj target.obj -o first.obj --boundary first.safetensors --no-improve",
    );
    std::fs::write(place.path("curves.txt"), "0 5 9 > 3 4\n").unwrap();
    let line = "boundary pair domain.obj target.obj -o image.obj --start first.safetensors --landmark-curves curves.txt \
                --landmarks pairs.txt --landmarks-weight 5 --boundary way.safetensors --json";
    let report = json(&place.ends_with(0, line));
    assert_eq!(report["starts"][0]["kind"], "given");
    assert!(report["landmark_error"].as_f64().unwrap() > 0.0);
    let file = files::read_boundary(&place.path("way.safetensors")).unwrap();
    let roles: Vec<&str> = file.metadata.inputs.iter().map(|input| input.role.as_str()).collect();
    assert_eq!(roles, ["domain", "target", "landmarks", "landmark_curves", "start"]);

    let line = "boundary pair domain.obj target.obj -o image.obj --domain-up z --target-up=-z --alternatives 1 --json";
    let report = json(&place.ends_with(0, line));
    for name in report["written_alternatives"].as_array().unwrap() {
        assert_eq!(name, "image.2.obj");
        assert!(place.path("image.2.obj").exists());
    }
    for (line, expected) in [
        ("--domain-up z", "--target-up"),
        ("--landmarks pairs.txt --landmarks-weight=-1", "not a positive number"),
        ("--max-stretched 2", "not a share"),
    ] {
        let output = place.ends_with(2, &format!("boundary pair domain.obj target.obj -o image.obj {line}"));
        let words = text(&output.stderr);
        assert!(words.contains(expected), "{words}");
    }
    std::fs::write(place.path("curves.txt"), "0 99999 > 3 4\n").unwrap();
    let output = place.ends_with(
        2,
        "boundary pair domain.obj target.obj -o image.obj --landmark-curves curves.txt",
    );
    let words = text(&output.stderr);
    assert!(words.contains("curves.txt") && words.contains("99999"), "{words}");
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
    place.surface("plate.obj", &shapes::double_torus(1));
    let sphere = shapes::sphere(1.0, 1);
    let open = SurfaceMesh::new(sphere.vertices().to_vec(), sphere.triangles()[1..].to_vec()).unwrap();
    place.surface("open.obj", &open);
    std::fs::write(place.path("one.txt"), "0 0\n").unwrap();
    std::fs::write(place.path("far.txt"), "0 100000\n").unwrap();
    std::fs::write(place.path("words.txt"), "nose nose\n").unwrap();
    for (line, fragments) in [
        (
            "pair domain.obj ring.obj",
            vec![
                "cannot map `domain.obj` to `ring.obj`",
                "the domain has genus 0 and the target genus 1",
            ],
        ),
        (
            "pair ring.obj domain.obj",
            vec![
                "cannot map `ring.obj` to `domain.obj`",
                "the domain has genus 1 and the target genus 0",
            ],
        ),
        (
            "pair plate.obj plate.obj --via conformal",
            vec![
                "cannot map `plate.obj` to `plate.obj`",
                "cannot be used with solids of genus 2",
            ],
        ),
        (
            "pair ring.obj open.obj",
            vec!["cannot map `open.obj` to the sphere", "hole"],
        ),
        (
            "pair ring.obj ring.obj --landmarks one.txt",
            vec!["cannot map `ring.obj` to `ring.obj`", "landmarks cannot be used"],
        ),
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
    for options in ["--landmarks pairs.txt", "--via conformal", "--aligned", "--no-improve"] {
        let line = format!("fit domain.obj --target sphere {options} -o m.map");
        let words = text(&place.ends_with(2, &line).stderr);
        assert!(words.contains("--target MODEL"), "{line}: {words}");
    }
    assert!(!place.path("image.obj").exists());
}

/// A bar, and the same bent to a ring whose ends pass through each other.
#[test]
fn models_that_intersect_themselves_are_named() {
    let place = Workplace::new();
    let bar = shapes::polycube(&(0..8).map(|i| [i, 0, 0]).collect::<Vec<_>>(), 2);
    let bent = shapes::deformed(&bar, |p| {
        let (angle, radius) = (7.0 * p.x / 8.0, 1.2 + p.y);
        Point::new(radius * angle.sin(), radius * angle.cos(), p.z + 0.02 * p.x)
    });
    place.surface("bar.obj", &bar);
    assert!(bent.volume() > 0.0, "not inside out");
    place.surface("bent.obj", &bent);
    for (line, name) in [
        ("boundary pair bar.obj bent.obj -o image.obj --json", "bent.obj"),
        ("boundary pair bent.obj bar.obj -o image.obj --json", "bent.obj"),
        ("fit bar.obj --target bent.obj -o x.map --json --no-refine", "bent.obj"),
    ] {
        let output = place.run(&format!("{line} --max-stretched 1"));
        let said = text(&output.stderr);
        let count = said.lines().filter(|line| line.contains("intersects itself")).count();
        assert_eq!(count, usize::from(cfg!(feature = "native")), "{line}: {said}");
        assert!(
            count == 0 || said.contains(&format!("`{name}` intersects itself")),
            "{said}"
        );
    }
}

#[test]
fn a_ring_is_mapped_to_a_torus_of_revolution_and_fitted() {
    let place = Workplace::new();
    let ring = shapes::deformed(&shapes::torus(2.0, 0.8, 36, 18), |p| {
        Point::new(5.0 + p.z, p.x + 0.1 * p.y * p.y, p.y)
    });
    place.surface("ring.obj", &ring);
    let report = place.report(
        0,
        "boundary torus ring.obj -o image.obj --boundary way.safetensors --png way.png --html way.html --json",
    );
    let [major, minor] = ["major", "minor"].map(|radius| report[radius].as_f64().unwrap());
    let ratio = major / minor;
    assert!((ratio - 2.5).abs() < 0.3, "{ratio}");
    let image = io::read_surface(place.path("image.obj")).unwrap();
    // Every vertex goes to a triangle of the torus, whose axis is z, and which is 1 to 2 % off the round one.
    for p in image.vertices() {
        let off = (p.x.hypot(p.y) - major).hypot(p.z) / minor;
        assert!(off > 0.97 && off < 1.01, "{p}: {off}");
    }
    assert!((image.volume() / ring.volume() - 1.0).abs() < 0.1);
    let checked = place.report(0, "boundary check way.safetensors --json");
    assert_eq!(checked["verdict"], "bijective");
    let fitted = place.report(0, "fit ring.obj --target torus -o torus.map --tolerance 0.01 --json");
    assert_eq!(fitted["tolerance_met"], true);
    place.fails("boundary torus image.png -o i.obj", &["image.png"]);
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    place.fails(
        "boundary torus ball.obj -o i.obj",
        &["cannot map `ball.obj` to a torus", "genus 0"],
    );
    place.fails("fit ball.obj --target donut -o i.map", &["`sphere` or `torus`"]);
}

#[test]
fn surfaces_with_handles_are_unfolded_into_a_polygon() {
    let place = Workplace::new();
    place.surface("ring.obj", &shapes::torus(2.0, 0.8, 36, 18));
    place.surface("plate.obj", &shapes::double_torus(2));
    for (name, genus, sides) in [("ring", 1, 4), ("plate", 2, 8)] {
        let line = format!("boundary unfold {name}.obj -o {name}_flat.obj --png {name}.png --html {name}.html --json");
        let report = place.report(0, &line);
        assert_eq!(report["page"], format!("{name}.html"));
        assert_eq!((&report["genus"], &report["sides"]), (&genus.into(), &sides.into()));
        // The plate has right angles, and few triangles.
        assert!(report["angle_p50"].as_f64().unwrap() < 2.5, "{report}");
        let flat = io::read_surface(place.path(&format!("{name}_flat.obj"))).unwrap();
        let model = io::read_surface(place.path(&format!("{name}.obj"))).unwrap();
        assert_eq!(flat.triangles().len(), model.triangles().len());
        assert_eq!(
            flat.vertices().len() as u64,
            report["layout_vertices"].as_u64().unwrap()
        );
        assert!((0..flat.triangles().len()).all(|t| flat.area_vector(t).z > 0.0));
        assert!(place.path(&format!("{name}.png")).exists());
        let page = std::fs::read_to_string(place.path(&format!("{name}.html"))).unwrap();
        for array in ["domain", "image", "outline", "field-angle"] {
            assert!(page.contains(&format!("data-array=\"{array}\"")), "{array}");
        }
        assert!(page.contains("\"names\":[\"surface\",\"layout\"]"));
    }
    // A page alone will do.
    place.ends_with(0, "boundary unfold ring.obj --html alone.html --up y");
    place.fails(
        "boundary unfold ring.obj --html small.html --max-size 10kB",
        &["the page of all 1296 triangles", "allow more"],
    );
    assert!(!place.path("small.html").exists());
    place.fails(
        "boundary unfold ring.obj --html page.png",
        &["`page.png`", "name it .html"],
    );
    place.surface("ball.obj", &shapes::sphere(1.0, 2));
    place.fails(
        "boundary unfold ball.obj -o i.obj",
        &["cannot unfold `ball.obj`", "no handle", "boundary sphere"],
    );
    place.fails("boundary unfold ring.obj", &["--output"]);
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

#[test]
fn a_boundary_map_is_improved_and_what_cannot_be_is_refused() {
    let place = with_two_solids();
    place.ends_with(
        0,
        "boundary pair domain.obj target.obj -o image.obj --boundary way.safetensors --no-improve",
    );
    let line = "boundary improve way.safetensors -o better.obj --boundary better.safetensors --json";
    let report = place.report(0, line);
    let energies: Vec<f64> = report["energies"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e.as_f64().unwrap())
        .collect();
    assert!(
        energies.len() > 1 && energies.windows(2).all(|pair| pair[1] < pair[0]),
        "{energies:?}"
    );
    let distortions = [0, 1].map(|k| report["distortions"][k].as_f64().unwrap());
    assert!(distortions[1] <= 1.5 * distortions[0]);
    let checked = json(&place.ends_with(0, "boundary check better.safetensors --json"));
    assert_eq!(checked["verdict"], "bijective");
    let file = files::read_boundary(&place.path("better.safetensors")).unwrap();
    assert_eq!(file.metadata.inputs[0].role, "start");
    // Measured over the inside by other means, with other sources.
    let energy = |name: &str| {
        place.ends_with(0, &format!("fit --boundary {name}.safetensors -o {name}.map"));
        let report = json(&place.ends_with(0, &format!("energy {name}.map --json")));
        report["harmonic_energy"].as_f64().unwrap()
    };
    for (name, found) in [("way", energies[0]), ("better", energies[energies.len() - 1])] {
        let expected = energy(name);
        assert!((found / expected - 1.0).abs() < 0.02, "{name}: {found} {expected}");
    }
    let words = text(
        &place
            .ends_with(0, "boundary improve way.safetensors -o one.obj --rounds 1")
            .stdout,
    );
    assert!(
        words.contains("harmonic energy") && words.contains("--rounds"),
        "{words}"
    );
    for (line, fragment) in [
        ("way.safetensors -o way.safetensors", "would be overwritten"),
        ("way.safetensors -o i.obj --max-distortion 0.9", "1 or more"),
        ("domain.obj -o i.obj", "`domain.obj` is a mesh"),
    ] {
        let output = place.ends_with(2, &format!("boundary improve {line}"));
        let words = text(&output.stderr);
        assert!(words.contains(fragment), "{fragment}: {words}");
    }
}

/// Components and cavities, from the pair to cells: cavities must stay empty.
#[test]
fn a_hollow_solid_is_mapped_to_another_with_all_that_is_written() {
    let place = Workplace::new();
    let cavity = |centre: [f64; 3]| {
        let placed = |p: &Point| Point::from(0.25 * p.coords + solidmap::Vector::from(centre));
        shapes::deformed(&shapes::sphere(1.0, 2), placed).reversed()
    };
    let outer = shapes::deformed(&shapes::sphere(1.0, 3), |p| Point::new(1.5 * p.x, p.y, 0.8 * p.z));
    let cavities = [cavity([0.7, 0.0, 0.0]), cavity([-0.5, 0.2, 0.1])];
    let solid = |[a, b]: [&SurfaceMesh; 2]| shapes::joined(&shapes::joined(&outer, a), b);
    let bent = |p: &Point| Point::new(p.x, p.y + 0.2 * p.x * p.x, 1.1 * p.z);
    place.surface("domain.obj", &solid([&cavities[0], &cavities[1]]));
    place.surface(
        "target.obj",
        &shapes::deformed(&solid([&cavities[1], &cavities[0]]), bent),
    );
    let line = "boundary pair domain.obj target.obj -o image.ply --boundary way.safetensors --png map.png --vtu map.vtu \
                --html map.html";
    let words = text(&place.ends_with(0, line).stdout);
    for fragment in [
        "one to one, shell by shell",
        "0: solid of genus 0, 642 vertices, to shell 0 of 642 vertices",
        "1: cavity of genus 0, 162 vertices, to shell 2 of 162 vertices",
        "2: cavity of genus 0, 162 vertices, to shell 1 of 162 vertices",
    ] {
        assert!(words.contains(fragment), "{fragment}: {words}");
    }
    assert!(std::fs::read(place.path("map.png")).unwrap().starts_with(b"\x89PNG"));
    let words = text(
        &place
            .ends_with(0, "boundary check way.safetensors --png check.png")
            .stdout,
    );
    assert!(
        words.contains("One to one with the target, decided exactly") && words.contains("shell by shell"),
        "{words}"
    );
    // It is started from, and made better for the inside.
    let line = "boundary pair domain.obj target.obj -o i.ply --start way.safetensors --no-improve --json";
    let started = place.report(0, line);
    assert_eq!(started["shells"][2]["target"], 1);
    assert_eq!(started["starts"][0]["kind"], "given");
    let line = "boundary improve way.safetensors -o better.ply --boundary better.safetensors --rounds 4 --json";
    let improved = place.report(0, line);
    let energies = improved["energies"].as_array().unwrap();
    assert!(energies.len() > 1, "{improved}");
    let words = text(&place.ends_with(0, "boundary check better.safetensors").stdout);
    assert!(words.contains("One to one with the target, decided exactly"), "{words}");

    place.ends_with(0, "fit --boundary way.safetensors -o stored.map --tolerance 0.01");
    place.ends_with(0, "fit domain.obj --target target.obj -o direct.map --tolerance 0.01");
    let [stored, direct] = ["stored.map", "direct.map"].map(|map| {
        place.report(0, &format!("energy {map} --resolution 24 --json"))["harmonic_energy"]
            .as_f64()
            .unwrap()
    });
    assert_eq!(stored, direct);
    place.ends_with(0, "tet domain.obj -o domain.vtu");
    let report = place.report(0, "remesh direct.map --mesh domain.vtu -o target.vtu --json");
    assert_eq!(report["inverted_cells"], 0);
    let off = report["mesh_to_target"]["max"].as_f64().unwrap();
    assert!(off < 0.05, "{off}");

    let report = place.report(
        0,
        "boundary pair domain.obj domain.obj -o image.ply --alternatives 1 --json",
    );
    let written = report["written_alternatives"].as_array().unwrap();
    assert_eq!(written.len(), report["alternatives"].as_array().unwrap().len());
    for name in written {
        assert!(place.path(name.as_str().unwrap()).exists());
        assert_eq!(report["alternatives"][0]["shell"], 0);
    }
    place.surface("solid.obj", &outer);
    let words = text(
        &place
            .ends_with(2, "boundary pair domain.obj solid.obj -o image.ply")
            .stderr,
    );
    assert!(
        words.contains("the domain has 3 shells (components and cavities) and the target 1"),
        "{words}"
    );
}

#[test]
fn a_file_says_which_components_and_cavities_go_to_which() {
    let place = Workplace::new();
    let at = |x: f64| shapes::deformed(&shapes::sphere(1.0, 2), |p| Point::new(p.x + x, 1.2 * p.y, 0.7 * p.z));
    let cavity = shapes::deformed(&shapes::sphere(0.3, 1), |p| Point::new(p.x + 3.1, p.y, p.z)).reversed();
    let ring = shapes::deformed(&shapes::torus(1.0, 0.3, 16, 8), |p| Point::new(p.x + 9.0, p.y, p.z));
    let parts = [at(3.0), cavity, at(6.0), ring];
    let solid = parts.iter().fold(at(0.0), |whole, part| shapes::joined(&whole, part));
    place.surface("solid.obj", &solid);
    // `check` tells the numbers by places.
    let words = text(&place.ends_with(0, "check solid.obj").stdout);
    for fragment in ["centre", "3.100, 0, 0  a cavity in 1", "9.000, 0, 0  a solid"] {
        assert!(words.contains(fragment), "{fragment}: {words}");
    }
    let checked = place.report(0, "check solid.obj --json");
    assert_eq!(checked["models"][0]["components"][3]["centre"][0], 6.0);

    let targets = |report: &Value| -> Vec<u64> {
        let shells = report["shells"].as_array().unwrap().iter();
        shells.map(|shell| shell["target"].as_u64().unwrap()).collect()
    };
    let line = "boundary pair solid.obj solid.obj -o image.ply --boundary way.safetensors --aligned --json";
    assert_eq!(targets(&place.report(0, line)), [0, 1, 2, 3, 4]);
    std::fs::write(place.path("swap.txt"), "# balls\n3, 0\n").unwrap();
    let report = place.report(0, &format!("{line} --components swap.txt"));
    assert_eq!(targets(&report), [3, 1, 2, 0, 4]);
    let file = files::read_boundary(&place.path("way.safetensors")).unwrap();
    assert!(file.metadata.inputs.iter().any(|input| input.role == "components"));
    place.ends_with(
        0,
        "fit solid.obj --target solid.obj --aligned --components swap.txt -o swapped.map --tolerance 0.05",
    );
    for (content, fragment) in [
        ("3 0\n3\n", "line 2: found 1 number"),
        ("0 5\n", "no shell 5 in the target: it has 5"),
        (
            "0 3\n3 3\n",
            "shell 3 of the target is given twice, with shells 0 and 3 of the domain",
        ),
        ("0 4\n", "the first has genus 0 (handles), and the second genus 1"),
        ("2 3\n", "the first bounds a cavity, and the second a solid"),
        ("0 1\n", "no shell in the first, shell 2 in the second"),
    ] {
        std::fs::write(place.path("wrong.txt"), content).unwrap();
        let output = place.ends_with(2, "boundary pair solid.obj solid.obj -o i.ply --components wrong.txt");
        let words = text(&output.stderr);
        assert!(
            words.contains(fragment) && words.contains("wrong.txt"),
            "{fragment}: {words}"
        );
    }
    let output = place.ends_with(2, "fit solid.obj --target sphere -o i.map --components swap.txt");
    assert!(text(&output.stderr).contains("--target MODEL"));
}

#[test]
fn a_file_says_which_loops_go_to_which() {
    let place = Workplace::new();
    let ring = shapes::torus(1.0, 0.4, 24, 12);
    place.surface("ring.obj", &ring);
    let along = |k: usize, across: usize| (12 * (k % 24) + k * across / 2 % 12).to_string();
    let walk = |across: usize| (0..24).map(|k| along(k, across)).collect::<Vec<_>>().join(" ");
    let (straight, wound) = (walk(0), walk(1));
    let around = (0..12).map(|j| j.to_string()).collect::<Vec<_>>().join(" ");
    std::fs::write(
        place.path("loops.txt"),
        format!("# along the ring\n{straight} > {wound}\n"),
    )
    .unwrap();
    let line = "boundary pair ring.obj ring.obj -o image.ply --boundary way.safetensors --json --loops loops.txt";
    let report = place.report(0, line);
    assert_eq!(report["torus"]["is_turned"], false);
    assert_eq!(report["torus"]["twist"].as_i64().unwrap().abs(), 1, "{report}");
    let file = files::read_boundary(&place.path("way.safetensors")).unwrap();
    assert!(file.metadata.inputs.iter().any(|input| input.role == "loops"));
    for (content, fragment) in [
        (format!("{straight} > {around}"), "loop 0 bounds"),
        (
            format!("{straight} > 0 1"),
            "loop 0 goes around no handle of the target",
        ),
        (
            format!("{straight} > 0 999 3"),
            "vertex 999 of the target, which has 288",
        ),
        ("0 12 24".into(), "no single `>`"),
    ] {
        std::fs::write(place.path("wrong.txt"), content).unwrap();
        for command in [
            "boundary pair ring.obj ring.obj -o i.ply",
            "fit ring.obj --target ring.obj -o i.map",
        ] {
            let output = place.ends_with(2, &format!("{command} --loops wrong.txt"));
            let words = text(&output.stderr);
            assert!(
                words.contains(fragment) && words.contains("wrong.txt"),
                "{fragment}: {words}"
            );
        }
    }
    let output = place.ends_with(2, "fit ring.obj --target torus -o i.map --loops loops.txt");
    assert!(text(&output.stderr).contains("--target MODEL"));
}

#[test]
fn a_plate_with_a_hole_is_mapped_to_a_ring_and_its_cells_are_carried_there() {
    let place = Workplace::new();
    let cubes: Vec<[i32; 3]> = (0..9).filter(|k| *k != 4).map(|k| [k % 3, k / 3, 0]).collect();
    let plate = shapes::polycube(&cubes, 3);
    place.surface("plate.obj", &plate);
    let ring = shapes::torus(1.0, 0.4, 30, 14);
    place.surface("ring.obj", &ring);
    let line = "boundary pair plate.obj ring.obj -o image.ply --boundary way.safetensors --png map.png --vtu map.vtu \
                --alternatives 1";
    let words = text(&place.ends_with(0, line).stdout);
    for fragment in [
        "no triangle flipped on the torus",
        "flat tori of both",
        "the next class has",
    ] {
        assert!(words.contains(fragment), "{fragment}: {words}");
    }
    assert!(std::fs::read(place.path("map.png")).unwrap().starts_with(b"\x89PNG"));
    assert!(place.path("image.2.ply").exists() && place.path("way.2.safetensors").exists());
    let output = place.ends_with(0, "boundary check way.safetensors --png check.png");
    let words = text(&output.stdout);
    assert!(words.contains("One to one with the target, decided exactly") && words.contains("through a flat torus"));
    let report = place.report(0, "boundary check plate.obj way.safetensors --target ring.obj --json");
    assert_eq!(report["verdict"], "bijective");
    assert!(report["composition"]["round_trip"]["max"].as_f64().unwrap() < 1e-9);

    let direct = place.report(
        0,
        "fit plate.obj --target ring.obj -o direct.map --tolerance 0.01 --json",
    );
    let by_file = place.report(
        0,
        "fit --boundary way.safetensors -o by_file.map --tolerance 0.01 --json",
    );
    assert_eq!(direct["boundary_error"], by_file["boundary_error"]);
    let report = place.report(0, "remesh direct.map --kind hex --cells 12 -o cells.vtu --json");
    assert_eq!(report["after"]["inverted"].as_u64(), Some(0), "{report}");
    let volume = io::read_cells(place.path("cells.vtu")).unwrap().volume();
    assert!((volume / ring.volume() - 1.0).abs() < 0.05, "{volume}");
}
