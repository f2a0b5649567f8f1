//! `solidmap sequence` from the command line: frames in; a chart, a table and series out; bad frames are named.

use std::ops::Deref;
use std::path::{Path, PathBuf};

use crate::common::{bent, horseshoe, rod, tets_of, with_hole};
use crate::workplace::{Workplace, json, text};
use solidmap::energy::{Lame, deformation_density};
use solidmap::io;
use solidmap::mesh::{CellList, CellMesh, SurfaceMesh, shapes};
use solidmap::{Matrix3, Point};

struct SequencePlace {
    place: Workplace,
    ball: SurfaceMesh,
}

impl Deref for SequencePlace {
    type Target = Workplace;

    fn deref(&self) -> &Workplace {
        &self.place
    }
}

impl SequencePlace {
    /// A ball, `ref.obj`.
    fn new() -> Self {
        let place = Self {
            place: Workplace::new(),
            ball: shapes::sphere(1.0, 2),
        };
        place.surface("ref.obj", &place.ball);
        place
    }

    fn frame(&self, name: &str, f: impl Fn(&Point) -> Point) {
        self.surface(name, &shapes::deformed(&self.ball, f));
    }

    /// Frames `bend00.ply` on, of a bend that comes and goes.
    fn bends(&self, count: usize, cycles: f64) -> String {
        let mut names = String::new();
        for k in 0..count {
            let a = 0.1 * (1.0 - (std::f64::consts::TAU * cycles * k as f64 / count as f64).cos());
            let name = format!("bend{k:02}.ply");
            self.frame(&name, bent(a));
            names += &format!("{name} ");
        }
        names
    }
}

/// All files in the folder and those in it, in order, with what they hold.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    let inner = |path: PathBuf| match path.is_dir() {
        true => contents(&path),
        false => vec![(path.clone(), std::fs::read(&path).unwrap())],
    };
    paths.into_iter().flat_map(inner).collect()
}

#[test]
fn a_sequence_gives_its_energies_cycles_chart_table_and_series() {
    let place = SequencePlace::new();
    let names = place.bends(24, 3.0);
    let line =
        format!("sequence ref.obj {names} -o out --resolution 12 --fps 25 --show 4,1 --frames-per-block 7 --json");
    let report = json(&place.ends_with(0, &line));
    assert_eq!(report["skipped"], 0);
    assert_eq!(report["frames"].as_array().unwrap().len(), 24);
    assert_eq!(report["cycles"]["count"].as_f64().unwrap().round(), 3.0);
    let energy = |k: usize| report["frames"][k]["deformation_energy"].as_f64().unwrap();
    assert!(energy(0) < 1e-20 && energy(4) > 10.0 * energy(1));
    assert_eq!(report["frames"][5]["time"].as_f64().unwrap(), 0.2);

    let table = std::fs::read_to_string(place.path("out/energy.csv")).unwrap();
    let rows: Vec<&str> = table.lines().collect();
    assert!(rows[0].starts_with("frame,time,file,deformation_energy,") && rows.len() == 25);
    let fields: Vec<&str> = rows[5].split(',').collect();
    assert_eq!((fields[0], fields[2]), ("4", "bend04.ply"));
    // `serde_json` reads numbers to a unit in the last place.
    assert!((fields[3].parse::<f64>().unwrap() / energy(4) - 1.0).abs() < 1e-15);
    for picture in ["energy.png", "sections.png"] {
        assert!(
            std::fs::read(place.path("out").join(picture))
                .unwrap()
                .starts_with(b"\x89PNG")
        );
    }
    let collection = std::fs::read_to_string(place.path("out/surface.pvd")).unwrap();
    assert_eq!(collection.matches("<DataSet").count(), 24);
    assert!(collection.contains("timestep=\"0.04\" part=\"0\" file=\"surface/frame_00001.vtu\""));
    let frame = io::read_surface(place.path("out/surface/frame_00004.vtu")).unwrap();
    assert_eq!(
        frame.vertices(),
        io::read_surface(place.path("bend04.ply")).unwrap().vertices()
    );
    assert!(place.path("out/cells/frame_00023.vtu").is_file());

    // A shorter sequence leaves nothing of the longer one.
    place.ends_with(0, "sequence ref.obj bend03.ply -o out --resolution 8");
    assert!(!place.path("out/cells/frame_00023.vtu").exists() && place.path("out/cells/frame_00000.vtu").is_file());
    place.ends_with(0, "sequence ref.obj bend03.ply -o bare --resolution 8 --no-vtu");
    assert!(!place.path("bare/cells").exists() && !place.path("bare/cells.pvd").exists());
}

#[test]
fn frames_that_cannot_be_used_are_named_and_skipped() {
    let place = SequencePlace::new();
    place.frame("good.obj", |p| Point::new(p.x + 0.1 * p.z * p.z, p.y, p.z));
    place.surface("fewer.obj", &shapes::sphere(1.0, 1));
    place.surface("turned.ply", &{
        let mut triangles = place.ball.triangles().to_vec();
        triangles.rotate_left(1);
        SurfaceMesh::new(place.ball.vertices().to_vec(), triangles).unwrap()
    });
    place.frame("nan.ply", |p| Point::new((p.x - 0.99).sqrt(), p.y, p.z));
    place.frame("flat.ply", |p| Point::new(p.x, p.y, 0.5));
    std::fs::write(place.path("broken.ply"), "ply\nformat ascii 1.0\nelement vertex 3\n").unwrap();
    let line = "sequence ref.obj good.obj fewer.obj turned.ply nan.ply flat.ply broken.ply none.obj good.obj -o out \
                --resolution 8 --json";
    let output = place.ends_with(1, line);
    let (report, said) = (json(&output), text(&output.stderr));
    assert_eq!(report["skipped"], 6);
    assert_eq!(report["tolerance_met"], true);
    let reasons = [
        "42",
        "triangle 0 joins",
        "not finite",
        "no volume",
        "broken.ply",
        "none.obj",
    ];
    let names = [
        "fewer.obj",
        "turned.ply",
        "nan.ply",
        "flat.ply",
        "broken.ply",
        "none.obj",
    ];
    for (k, (name, reason)) in names.iter().zip(reasons).enumerate() {
        let row = &report["frames"][k + 1];
        assert_eq!(row["file"], *name);
        assert!(row["skipped"].as_str().unwrap().contains(reason), "{row}");
        assert!(
            said.contains(&format!("frame {} is skipped: ", k + 1)) && said.contains(name),
            "{said}"
        );
    }
    // The same frame has the same energy, whatever was skipped between.
    let energy = |k: usize| report["frames"][k]["deformation_energy"].as_f64().unwrap();
    assert!((energy(0) / energy(7) - 1.0).abs() < 1e-9);
    assert_eq!(
        std::fs::read_to_string(place.path("out/surface.pvd"))
            .unwrap()
            .matches("<DataSet")
            .count(),
        2
    );
    let table = std::fs::read_to_string(place.path("out/energy.csv")).unwrap();
    assert_eq!(table.lines().count(), 9);

    let none = place.ends_with(2, "sequence ref.obj fewer.obj none.obj -o out");
    assert!(text(&none.stderr).contains("none of the 2 frames can be used"));
}

#[test]
fn a_slit_is_closed_when_asked_for() {
    let place = SequencePlace::new();
    place.surface("open.obj", &with_hole(&place.ball));
    let moved = shapes::deformed(&place.ball, |p| Point::new(p.x + 3.0, -p.y, -p.z));
    place.surface("moved.obj", &with_hole(&moved));
    let refused = place.ends_with(2, "sequence open.obj moved.obj -o out");
    assert!(text(&refused.stderr).contains("--close-holes closes small holes"));
    let large = place.ends_with(2, "sequence open.obj moved.obj -o out --close-holes=3");
    assert!(text(&large.stderr).contains("holes of up to 3 edges are closed"));
    // The option's former name is still taken.
    place.ends_with(0, "sequence open.obj moved.obj -o former --mend --no-vtu");
    let report = json(&place.ends_with(0, "sequence open.obj moved.obj -o out --close-holes --json"));
    assert_eq!(report["closed_holes"].as_array().unwrap().len(), 1);
    assert_eq!(report["faces"], place.ball.triangles().len());
    assert!(report["frames"][0]["deformation_energy"].as_f64().unwrap() < 1e-13);
}

#[test]
fn order_units_and_mirror_images_are_warned_of() {
    let place = SequencePlace::new();
    for name in ["f1.obj", "f2.obj", "f10.obj"] {
        place.frame(name, |p| Point::new(p.x, 1.1 * p.y, p.z));
    }
    let sorted = place.ends_with(
        0,
        "sequence ref.obj f1.obj f10.obj f2.obj -o out --no-vtu --resolution 8",
    );
    assert!(text(&sorted.stderr).contains("`f10.obj` comes before `f2.obj`"));
    let meant = place.ends_with(
        0,
        "sequence ref.obj f2.obj f10.obj f1.obj -o out --no-vtu --resolution 8",
    );
    assert!(!text(&meant.stderr).contains("comes before"));
    place.frame("large.obj", |p| Point::from(1000.0 * p.coords));
    place.frame("mirror.obj", |p| Point::new(-p.x, p.y, p.z));
    let odd = place.ends_with(
        0,
        "sequence ref.obj large.obj mirror.obj -o out --no-vtu --resolution 8",
    );
    let said = text(&odd.stderr);
    assert!(said.contains("--own-volume") && said.contains("mirror image"), "{said}");
}

#[test]
fn bad_requests_are_refused_before_any_work() {
    let place = SequencePlace::new();
    place.frame("f.obj", |p| *p);
    std::fs::create_dir_all(place.path("out/surface")).unwrap();
    place.frame("out/surface/frame_00000.vtu", |p| *p);
    for (line, said) in [
        ("sequence ref.obj f.obj -o out --show 1", "counted from 0"),
        ("sequence ref.obj f.obj -o out --fps 0", "--fps is 0"),
        (
            "sequence ref.obj f.obj -o out --frames-per-block 0",
            "--frames-per-block is 0",
        ),
        ("sequence ref.obj f.obj -o ref.obj", "cannot make the folder"),
        (
            "sequence ref.obj out/surface/frame_00000.vtu -o out",
            "would be overwritten",
        ),
        ("sequence none.obj f.obj -o out2", "none.obj"),
        ("sequence ref.obj f.obj -o out2 --tolerance -1", "tolerance"),
        (
            "sequence ref.obj f.obj -o out2 --close-holes=1001",
            "--close-holes is 1001, but must be at most 1000",
        ),
        ("sequence ref.obj f.obj -o out", "not by an earlier run"),
        ("sequence ref.obj -o out", "FRAME"),
    ] {
        let output = place.ends_with(2, line);
        assert!(text(&output.stderr).contains(said), "{line}: {}", text(&output.stderr));
    }
    assert!(place.path("out/surface/frame_00000.vtu").is_file());
}

#[test]
fn results_stay_until_new_ones_are_complete_and_other_files_for_ever() {
    let place = SequencePlace::new();
    place.frame("good.obj", |p| Point::new(p.x + 0.1 * p.z * p.z, p.y, p.z));
    place.surface("fewer.obj", &shapes::sphere(1.0, 1));
    place.ends_with(0, "sequence ref.obj good.obj -o out --resolution 8");
    let others = ["out/surface/frame_00001.vtu", "out/cells/frame_0007.vtu"].map(|name| place.path(name));
    others
        .iter()
        .for_each(|path| std::fs::write(path, "another program's").unwrap());
    let before = contents(&place.path("out"));
    assert_eq!(before.len(), 5 + 2 + 2);

    place.ends_with(2, "sequence ref.obj fewer.obj -o out");
    place.ends_with(2, "sequence fewer.obj good.obj -o out");
    let refused = place.ends_with(2, "sequence ref.obj good.obj good.obj -o out --resolution 8");
    let said = text(&refused.stderr);
    assert!(
        said.contains("frame_00001.vtu") && said.contains("not by an earlier run"),
        "{said}"
    );
    assert!(contents(&place.path("out")) == before);

    place.ends_with(1, "sequence ref.obj good.obj fewer.obj -o out --resolution 8 --no-vtu");
    let names: Vec<PathBuf> = contents(&place.path("out")).into_iter().map(|(path, _)| path).collect();
    assert_eq!(names.len(), 3 + 2, "{names:?}");
    assert!(
        others
            .iter()
            .all(|path| std::fs::read(path).unwrap() == b"another program's")
    );
    assert_eq!(
        std::fs::read_to_string(place.path("out/energy.csv"))
            .unwrap()
            .lines()
            .count(),
        3
    );
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_the_results_of_an_earlier_run() {
    use std::process::{Command, Stdio};

    let place = SequencePlace::new();
    place.ends_with(0, "sequence ref.obj ref.obj -o out --resolution 8");
    let before = contents(&place.path("out"));
    place.surface("fine.ply", &shapes::sphere(1.0, 6));
    let mut program = Command::new(assert_cmd::cargo::cargo_bin!("solidmap"))
        .current_dir(place.folder.path())
        .args("sequence fine.ply fine.ply fine.ply -o out".split_whitespace())
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let is_hidden = |entry: std::io::Result<std::fs::DirEntry>| {
        let name = entry.unwrap().file_name();
        name.to_string_lossy().starts_with(".sequence-")
    };
    while !std::fs::read_dir(place.path("out")).unwrap().any(is_hidden) {
        assert!(
            program.try_wait().unwrap().is_none(),
            "it ended before it was interrupted"
        );
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    std::thread::sleep(std::time::Duration::from_millis(50));
    let kill = Command::new("kill").args(["-INT", &program.id().to_string()]).status();
    assert!(kill.unwrap().success());
    assert_eq!(program.wait().unwrap().code(), Some(130));
    assert!(contents(&place.path("out")) == before);
    assert!(!std::fs::read_dir(place.path("out")).unwrap().any(is_hidden));
}

#[test]
fn the_largest_cross_section_is_pictured_unless_an_axis_is_named() {
    let place = SequencePlace::new();
    let thin = |p: &Point| Point::new(0.2 * p.x, p.y, p.z);
    place.frame("thin.obj", thin);
    place.frame("bent.obj", |p| thin(p) + 0.1 * p.z * p.z * solidmap::Vector::y());
    let picture = |options: &str| {
        place.ends_with(
            0,
            &format!("sequence thin.obj bent.obj -o out --resolution 8 --no-vtu {options}"),
        );
        std::fs::read(place.path("out/sections.png")).unwrap()
    };
    let own = picture("");
    assert!(own == picture("--axis x") && own != picture("--axis z"));
}

#[test]
fn material_moves_with_every_frame() {
    let place = SequencePlace::new();
    // Linear on the facets too, so that the map inside is known.
    let frame = |k: usize, p: &Point| {
        let a = 0.1 * k as f64;
        let image = Point::new(p.x + a * p.y, (1.0 + a) * p.y, p.z - a * p.x + a);
        (image, [1.0, 0.0, -a])
    };
    let mut names = String::new();
    for k in 0..6 {
        place.frame(&format!("shear{k}.ply"), |p| frame(k, p).0);
        names += &format!("shear{k}.ply ");
    }
    let nodes = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.1], [0.0, 0.6, 0.0], [0.1, 0.0, 0.4]].map(Point::from);
    let field = |name: &str, components, values| io::Field {
        name: String::from(name),
        components,
        values,
    };
    let fields = io::VtkFields {
        point: vec![
            field("heat", 1, vec![1.0, 2.0, 3.0, 4.0]),
            field("fibre", 3, [1.0, 0.0, 0.0].repeat(4)),
        ],
        cell: vec![field("part", 1, vec![7.0])],
        ..io::VtkFields::default()
    };
    let write = |name: &str, cells| io::write_vtu(place.path(name), &nodes, cells, &fields).unwrap();
    write("material.vtu", io::Cells::Tets(&[[0, 1, 2, 3]]));
    let line = format!("sequence ref.obj {names} -o out --material material.vtu --no-vtu --json");
    let report = json(&place.ends_with(0, &line));
    assert_eq!(report["material"], "material.vtu");
    assert!(!place.path("out/cells.pvd").exists() && !place.path("out/surface").exists());
    let collection = std::fs::read_to_string(place.path("out/material.pvd")).unwrap();
    for k in 0..6 {
        let name = format!("material/frame_{k:05}.vtu");
        assert!(collection.contains(&format!("file=\"{name}\"")), "{collection}");
        let carried = io::read_fields(place.path("out").join(name)).unwrap();
        assert_eq!(carried.cells, CellList::Tets(vec![[0, 1, 2, 3]]));
        let values = |name: &str| {
            let all = carried.point.iter().chain(&carried.cell);
            all.clone().find(|field| field.name == name).unwrap().values.clone()
        };
        assert_eq!((values("heat"), values("part")), (vec![1.0, 2.0, 3.0, 4.0], vec![7.0]));
        let fibres = values("fibre");
        for (v, p) in nodes.iter().enumerate() {
            let (image, fibre) = frame(k, p);
            assert!((carried.points[v] - image).norm() < 1e-9, "{k} {v}");
            assert!((0..3).all(|i| (fibres[3 * v + i] - fibre[i]).abs() < 1e-9), "{k} {v}");
        }
    }
    std::fs::write(place.path("points.csv"), "x,y,z,heat\n0,0,0,1\n").unwrap();
    let refused = place.ends_with(2, "sequence ref.obj shear0.ply -o out --material points.csv");
    assert!(text(&refused.stderr).contains("`points.csv` has no triangles and no cells"));
    let own = place.ends_with(
        2,
        "sequence ref.obj shear0.ply -o out --material out/material/frame_00000.vtu",
    );
    assert!(text(&own.stderr).contains("would be overwritten"));
    place.ends_with(
        0,
        "sequence ref.obj shear0.ply shear1.ply -o out --material material.vtu",
    );
    let frames = std::fs::read_dir(place.path("out/material")).unwrap().count();
    assert_eq!(frames, 2, "an earlier run's are removed");
}

#[test]
fn a_reference_that_intersects_itself_is_warned_of_as_by_fit() {
    let place = SequencePlace::new();
    // Two balls that overlap.
    let other = shapes::deformed(&place.ball, |p| Point::new(p.x + 1.0, p.y, p.z));
    let shift = place.ball.vertices().len() as u32;
    let vertices = [place.ball.vertices(), other.vertices()].concat();
    let shifted = other.triangles().iter().map(|t| t.map(|v| v + shift));
    let triangles: Vec<[u32; 3]> = place.ball.triangles().iter().copied().chain(shifted).collect();
    let both = SurfaceMesh::new(vertices, triangles).unwrap();
    place.surface("both.obj", &both);
    place.surface("bent.obj", &shapes::deformed(&both, bent(0.1)));
    let warning = |line: &str| {
        let output = place.run(line);
        let said = text(&output.stderr);
        let found = said
            .lines()
            .find(|line| line.contains("intersects itself"))
            .map(str::to_owned);
        (found, json(&output)["warnings"].as_array().unwrap().clone())
    };
    let (of_fit, _) = warning("fit both.obj --image bent.obj -o x.map --json --no-refine");
    let (of_sequence, listed) =
        warning("sequence both.obj bent.obj -o out --no-vtu --resolution 12 --json --no-refine");
    assert_eq!(of_fit, of_sequence);
    if cfg!(feature = "native") {
        let said = of_sequence.unwrap();
        assert!(said.contains("both.obj"), "{said}");
        assert!(
            listed.iter().any(|warning| said.ends_with(warning.as_str().unwrap())),
            "{listed:?}"
        );
    }
}

#[test]
fn messages_on_frames_name_their_files() {
    let place = SequencePlace::new();
    place.frame("grown.ply", |p| Point::from(p.coords * 3.0));
    place.frame("mirrored.ply", |p| Point::new(-p.x, p.y, p.z));
    let output = place.ends_with(
        0,
        "sequence ref.obj ref.obj grown.ply mirrored.ply -o out --no-vtu --resolution 12",
    );
    let said = text(&output.stderr);
    let warning = |word: &str| {
        said.lines()
            .find(|line| line.contains(word))
            .unwrap_or_default()
            .to_owned()
    };
    assert!(warning("mirror images").contains("`mirrored.ply`"), "{said}");
    assert!(warning("change of size").contains("`grown.ply`"), "{said}");
    assert!(
        text(&output.stdout).contains("`grown.ply`"),
        "the frame of most energy is named"
    );
}

#[cfg(unix)]
#[test]
fn an_interrupted_sequence_leaves_no_empty_folder() {
    let place = SequencePlace::new();
    let names = place.bends(12, 1.0);
    ends_without_a_folder(&place, &names, "INT", &[]);
    // What a script runs in the background ignores Ctrl-C, and under `nohup` the end of the session.
    ends_without_a_folder(&place, &names, "TERM", &[libc::SIGINT]);
    ends_without_a_folder(&place, &names, "TERM", &[libc::SIGHUP, libc::SIGINT]);
}

/// That a sequence that gets a signal while others are ignored ends and leaves nothing.
#[cfg(unix)]
fn ends_without_a_folder(place: &SequencePlace, names: &str, signal: &str, ignored: &'static [i32]) {
    use std::os::unix::process::CommandExt;

    let line = format!("sequence ref.obj {names} -o new/out --tolerance 1e-7 --resolution 64 --frames-per-block 1");
    let mut program = std::process::Command::new(assert_cmd::cargo::cargo_bin("solidmap"));
    program
        .current_dir(place.folder.path())
        .args(line.split_whitespace())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null());
    let ignore = move || {
        for &signal in ignored {
            // SAFETY: to ignore a signal runs no code of ours.
            unsafe { libc::signal(signal, libc::SIG_IGN) };
        }
        Ok(())
    };
    // SAFETY: between fork and exec only `signal` is called, which may be called there.
    unsafe { program.pre_exec(ignore) };
    let mut program = program.spawn().unwrap();
    let begun = std::time::Instant::now();
    while !place.path("new/out").exists() {
        assert!(begun.elapsed().as_secs() < 60 && program.try_wait().unwrap().is_none());
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let id = program.id().to_string();
    let asked = std::process::Command::new("kill")
        .args(["-s", signal, &id])
        .status()
        .unwrap();
    assert!(asked.success());
    assert_eq!(program.wait().unwrap().code(), Some(130));
    assert!(!place.path("new").exists());
}

/// A matrix, and the energy of the frame that it makes.
fn stretched() -> (Matrix3, f64) {
    let matrix = Matrix3::new(1.1, 0.2, 0.0, 0.0, 0.9, 0.1, -0.2, 0.0, 1.2);
    (matrix, deformation_density(&matrix, &Lame::default()))
}

/// A rod by tetrahedra, `rod.mesh`, frames of it: `affine.obj`, `horseshoe.obj`, whose harmonic map folds, and
/// `mirrored.obj`.
fn rod_of_tets() -> Workplace {
    let place = Workplace::new();
    let mesh = CellMesh::from(tets_of(&rod(), 16));
    io::write_cell_mesh(place.path("rod.mesh"), &mesh).unwrap();
    let surface = io::read_solid(place.path("rod.mesh")).unwrap().into_surface();
    let frame = |name: &str, f: &dyn Fn(&Point) -> Point| place.surface(name, &shapes::deformed(&surface, f));
    frame("affine.obj", &|p| Point::from(stretched().0 * p.coords));
    frame("horseshoe.obj", &horseshoe);
    frame("mirrored.obj", &|p| Point::new(-p.x, p.y, p.z));
    place
}

#[test]
fn bijective_maps_are_measured_over_the_tetrahedra_of_the_reference() {
    let place = rod_of_tets();
    let frames = "rod.mesh affine.obj mirrored.obj horseshoe.obj";
    let line = format!("sequence {frames} -o out --map bijective --material rod.mesh --resolution 12 --json");
    let output = place.ends_with(1, &line);
    let report = json(&output);
    let mesh = io::read_cells(place.path("rod.mesh")).unwrap();
    assert_eq!(
        (&report["map_kind"], &report["tets"]),
        (&"bijective".into(), &mesh.cells().len().into())
    );
    assert!(report["points"].is_null());
    let number = |frame: usize, key: &str| report["frames"][frame][key].as_f64().unwrap();
    // Rounding: coordinates are a hundred times as large as what differs within a tetrahedron at most.
    assert!((number(0, "deformation_energy") / stretched().1 - 1.0).abs() < 1e-11);
    for frame in [0, 2] {
        assert_eq!(number(frame, "folded_fraction"), 0.0);
        assert_eq!(report["frames"][frame]["errors"]["deformation_energy"], 0.0);
        // Every node of the boundary goes where the frame has it, and triangles with them.
        assert!(report["frames"][frame]["boundary_error"]["max"].as_f64().unwrap() < 1e-13);
    }
    assert_eq!(report["frames"][0]["inverted_as_mapped"], 0);
    assert!(number(2, "inverted_as_mapped") > 0.0);
    // No bijective map: skipped with the reason, in the table too; the others are measured.
    assert_eq!(report["skipped"], 1);
    let reason = report["frames"][1]["skipped"].as_str().unwrap();
    assert!(
        reason.contains("no bijective map") && reason.contains("mirrors the solid"),
        "{reason}"
    );
    assert!(text(&output.stderr).contains("frame 1 is skipped: `mirrored.obj`"));
    let table = std::fs::read_to_string(place.path("out/energy.csv")).unwrap();
    assert!(table.lines().nth(2).unwrap().contains("mirrors the solid"), "{table}");

    // The cells of a frame are the tetrahedra, with those that splitting added; the material is carried by the same map.
    let cells = io::read_cells(place.path("out/cells/frame_00000.vtu")).unwrap();
    assert_eq!((cells.cells(), cells.nodes()), (mesh.cells(), mesh.nodes()));
    let carried = io::read_cells(place.path("out/material/frame_00000.vtu")).unwrap();
    for (p, image) in mesh.nodes().iter().zip(carried.nodes()) {
        assert!((stretched().0 * p.coords - image.coords).norm() < 1e-13, "{p}");
    }

    // The harmonic maps of the same frames: the affine one has the same energy, the horseshoe folds.
    let line = "sequence rod.mesh affine.obj horseshoe.obj -o out --resolution 12 --no-vtu --no-refine";
    let harmonic = json(&place.run(&format!("{line} --map harmonic --json")));
    assert_eq!(harmonic["map_kind"], "harmonic");
    assert!(harmonic["tets"].is_null() && harmonic["frames"][0]["inverted_as_mapped"].is_null());
    let number = |frame: usize, key: &str| harmonic["frames"][frame][key].as_f64().unwrap();
    assert!((number(0, "deformation_energy") / stretched().1 - 1.0).abs() < 1e-11);
    assert!(number(1, "folded_fraction") > 0.005, "{harmonic}");
    let said = text(
        &place
            .ends_with(0, "sequence rod.mesh affine.obj -o out --map bijective")
            .stdout,
    );
    assert!(said.contains("bijective, linear over"), "{said}");
}

/// Surfaces are filled by TetGen, which keeps their triangles, and closed holes too.
#[cfg(feature = "native")]
#[test]
fn bijective_maps_of_surfaces_are_exact_on_them() {
    let place = SequencePlace::new();
    place.surface("open.obj", &with_hole(&place.ball));
    let shapes = [bent(0.1), bent(0.2)].map(|f| with_hole(&shapes::deformed(&place.ball, f)));
    for (k, shape) in shapes.iter().enumerate() {
        place.surface(&format!("bent{k}.obj"), shape);
    }
    // A vertex far beyond the other side: the frame passes through itself.
    let spike = shapes::deformed(
        &place.ball,
        |p| if p.z > 0.999 { Point::new(0.1, 0.2, -3.0) } else { *p },
    );
    place.surface("spike.obj", &with_hole(&spike));
    let line = "sequence open.obj bent0.obj bent1.obj spike.obj -o out --close-holes --map bijective --no-vtu --json";
    let report = json(&place.ends_with(1, line));
    let reason = report["frames"][2]["skipped"].as_str().unwrap();
    assert!(
        report["skipped"] == 1 && reason.contains("pairs of triangles intersect"),
        "{reason}"
    );
    assert_eq!(report["closed_holes"].as_array().unwrap().len(), 1);
    let number = |frame: usize, key: &str| report["frames"][frame][key].as_f64().unwrap();
    assert!(number(1, "deformation_energy") > 2.0 * number(0, "deformation_energy"));
    for frame in [0, 1] {
        assert!(report["frames"][frame]["boundary_error"]["max"].as_f64().unwrap() < 1e-13);
        assert_eq!(number(frame, "folded_fraction"), 0.0);
    }
}

#[cfg(not(feature = "native"))]
#[test]
fn without_tetgen_a_surface_has_no_bijective_maps_and_what_to_give_is_told() {
    let place = SequencePlace::new();
    place.fails(
        "sequence ref.obj ref.obj -o out --map bijective",
        &["ref.obj", "needs TetGen", "in place of its surface"],
    );
}
