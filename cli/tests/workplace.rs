//! The program run in a folder of its own.

use std::path::PathBuf;
use std::process::Output;
use std::time::Duration;

use assert_cmd::Command;
use serde_json::Value;
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::remesh::{CellKind, Polycube, regular_mesh};

/// How long a command on small models may take.
const LONGEST: Duration = Duration::from_secs(120);

/// A folder that is removed at the end.
pub struct Workplace {
    pub folder: tempfile::TempDir,
}

impl Workplace {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a surface to the folder.
    pub fn surface(&self, name: &str, mesh: &SurfaceMesh) {
        io::write_surface(self.path(name), mesh).unwrap();
    }

    /// Runs `solidmap` in the folder, with any exit code; words are separated by blanks.
    pub fn run(&self, line: &str) -> Output {
        self.run_within(LONGEST, line)
    }

    /// The same, ended when it takes longer than `limit`.
    pub fn run_within(&self, limit: Duration, line: &str) -> Output {
        let mut command = solidmap();
        command.current_dir(self.folder.path()).args(line.split_whitespace());
        command.timeout(limit).output().unwrap()
    }

    /// The same, and asserts this exit code.
    pub fn ends_with(&self, code: i32, line: &str) -> Output {
        let output = self.run(line);
        let said = format!("{line}: {}{}", text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{said}");
        output
    }

    /// The same for what cannot be run: asserts exit code 2, and an error with these fragments.
    pub fn fails(&self, line: &str, fragments: &[&str]) {
        let said = text(&self.ends_with(2, line).stderr);
        assert!(said.contains("error: "), "{line}: {said}");
        for fragment in fragments {
            assert!(said.contains(fragment), "{line}: no `{fragment}` in: {said}");
        }
    }

    /// What a command with `--json` prints, after [`Self::ends_with`].
    pub fn report(&self, code: i32, line: &str) -> Value {
        json(&self.ends_with(code, line))
    }
}

/// Writes a block with a tower, `block.mesh`, and labels for stairs around the tower that always rise, `stairs.txt`: each chart
/// and corner is possible, but no heights of the steps are, so that there is no polycube.
pub fn write_impossible_stairs(place: &Workplace) {
    let boxes: Vec<[i32; 3]> = (0..9).map(|k| [k % 3, k / 3, 0]).chain([[1, 1, 1]]).collect();
    let polycube = Polycube::of(&shapes::polycube(&boxes, 1)).unwrap();
    let block = regular_mesh(&polycube, 1.0 / 3.0, CellKind::Tets, 10_000).unwrap();
    io::write_cells(place.path("block.mesh"), block.nodes(), io::Cells::from(block.cells())).unwrap();
    let surface = io::read_tets(place.path("block.mesh")).unwrap().boundary().surface;
    let label = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| surface.vertices()[v as usize]);
        let (area, centre) = ((b - a).cross(&(c - a)), (a.coords + b.coords + c.coords) / 3.0);
        let axis = area.iamax();
        let label = (2 * axis + usize::from(area[axis] > 0.0)) as u8;
        let is_between = |c: f64| (4.0 / 3.0..5.0 / 3.0).contains(&c);
        match (is_between(centre.x), is_between(centre.y)) {
            _ if label != 5 || centre.z > 1.5 => label,
            (true, _) if centre.y < 1.0 => 0,
            (_, true) if centre.x > 2.0 => 2,
            (true, _) if centre.y > 2.0 => 1,
            (_, true) if centre.x < 1.0 => 3,
            _ => label,
        }
    };
    let labels: Vec<u8> = surface.triangles().iter().map(label).collect();
    io::write_triangle_labels(place.path("stairs.txt"), &labels).unwrap();
}

/// Writes an L of boxes, turned by an angle about a skew axis, `turned.mesh`.
pub fn write_turned_boxes(place: &Workplace) {
    let polycube = Polycube::of(&shapes::polycube(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], 1)).unwrap();
    let boxes = regular_mesh(&polycube, 0.34, CellKind::Tets, 10_000).unwrap();
    let turn = solidmap::nalgebra::Rotation3::new(solidmap::Vector::new(0.3, -0.2, 0.5));
    let nodes: Vec<Point> = boxes.nodes().iter().map(|p| turn * p).collect();
    io::write_cells(place.path("turned.mesh"), &nodes, io::Cells::from(boxes.cells())).unwrap();
}

/// The program, ended when it takes longer than [`LONGEST`].
pub fn solidmap() -> Command {
    let mut command = Command::cargo_bin("solidmap").unwrap();
    command.timeout(LONGEST);
    command
}

/// A folder with `map.safetensors`, the map of a ball whose boundary is mapped by `image`.
pub fn with_fitted_ball(image: impl Fn(&Point) -> Point) -> Workplace {
    let place = Workplace::new();
    let domain = shapes::sphere(1.0, 3);
    place.surface("domain.ply", &domain);
    place.surface("target.ply", &shapes::deformed(&domain, image));
    place.ends_with(
        0,
        "fit domain.ply --image target.ply --tolerance 0.01 -o map.safetensors",
    );
    place
}

/// A folder with a bumpy ball, `domain.obj`, and its projection to the unit sphere, `sphere.ply`.
pub fn with_ball() -> Workplace {
    let place = Workplace::new();
    let domain = shapes::bumpy_sphere(8);
    place.surface("domain.obj", &domain);
    place.surface("sphere.ply", &shapes::projected_to_sphere(&domain, 1.0));
    place
}

/// What the program says on stderr.
pub fn stderr(output: &Output) -> String {
    text(&output.stderr)
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

pub fn json(output: &Output) -> Value {
    let said = || format!("{}{}", text(&output.stdout), stderr(output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", said()))
}
