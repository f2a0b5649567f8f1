//! The program run in a folder of its own.

use std::path::PathBuf;
use std::process::Output;
use std::time::Duration;

use assert_cmd::Command;
use serde_json::Value;
use solidmap::Point;
use solidmap::io;
use solidmap::mesh::shapes;

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

    /// Runs `solidmap` in the folder, whatever comes of it; words are separated by blanks.
    pub fn run(&self, line: &str) -> Output {
        let mut command = Command::cargo_bin("solidmap").unwrap();
        command.current_dir(self.folder.path()).args(line.split_whitespace());
        command.timeout(Duration::from_secs(120)).output().unwrap()
    }

    /// The same, with this exit code.
    pub fn ends_with(&self, code: i32, line: &str) -> Output {
        let output = self.run(line);
        let said = format!("{line}: {}{}", text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{said}");
        output
    }

    /// What `--json` prints.
    pub fn report(&self, code: i32, line: &str) -> Value {
        json(&self.ends_with(code, line))
    }
}

/// With `map.safetensors`, the map of a ball whose surface goes by a formula.
pub fn with_fitted_ball(image: impl Fn(&Point) -> Point) -> Workplace {
    let place = Workplace::new();
    let domain = shapes::sphere(1.0, 3);
    io::write_surface(place.path("domain.ply"), &domain).unwrap();
    io::write_surface(place.path("target.ply"), &shapes::deformed(&domain, image)).unwrap();
    place.ends_with(
        0,
        "fit domain.ply --image target.ply --tolerance 0.01 -o map.safetensors",
    );
    place
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

pub fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}
