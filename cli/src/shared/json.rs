//! The JSON that `--json` prints: reports and errors, with the version of their fields. `docs/json.md` has all fields.

use std::ops::Deref;
use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};
use solidmap::error_kind::ErrorKind;

/// Version of the fields: raised when one is removed, renamed, or changes its meaning. New fields do not raise it.
const SCHEMA: u32 = 1;

#[derive(Serialize)]
struct Version {
    schema: u32,
    program: &'static str,
}

/// What is printed: the version before the fields of a report or an error.
#[derive(Serialize)]
struct Document<'r, T> {
    version: Version,
    /// Whether file names that are not UTF-8 are replaced by similar ones.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    lossy_names: bool,
    #[serde(flatten)]
    content: &'r T,
}

/// A report, which is a struct or a map, as text.
pub fn document(report: &impl Serialize) -> serde_json::Result<String> {
    let version = Version {
        schema: SCHEMA,
        program: env!("CARGO_PKG_VERSION"),
    };
    serde_json::to_string_pretty(&Document {
        version,
        lossy_names: std::env::args_os().any(|argument| argument.to_str().is_none()),
        content: report,
    })
}

/// Why a command could not run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// Arguments that the program does not know, or that do not go together.
    Usage,
    /// Everything else, such as files that cannot be read.
    Failed,
    /// `--time-limit`.
    TimeLimit,
    /// Ctrl-C, or another signal that ends programs.
    Interrupted,
    // `out_of_memory` is written in `exhausted_memory`, without allocating.
}

#[derive(Serialize)]
struct ErrorReport<'e> {
    error: ErrorFields<'e>,
}

#[derive(Serialize)]
struct ErrorFields<'e> {
    kind: FailureKind,
    /// What it is about, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    about: Option<&'static str>,
    message: &'e str,
    exit_code: i32,
}

/// An error as text; the message does not begin with `error:`.
pub fn error(kind: FailureKind, message: &str, exit_code: i32) -> String {
    written(ErrorFields {
        kind,
        about: None,
        message,
        exit_code,
    })
}

/// The error of a command as text, with what it is about where the library or the system knows it.
pub fn failure(error: &anyhow::Error, message: &str, exit_code: i32) -> String {
    written(ErrorFields {
        kind: FailureKind::Failed,
        about: error.chain().find_map(ErrorKind::of).map(ErrorKind::name),
        message,
        exit_code,
    })
}

fn written(error: ErrorFields) -> String {
    // Strings and numbers alone can always be written.
    document(&ErrorReport { error }).unwrap_or_default()
}

/// The name of a file in a report. Bytes that are not UTF-8 are replaced, and the document says so.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileName(PathBuf);

impl Serialize for FileName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0.display())
    }
}

impl<P: AsRef<Path>> From<P> for FileName {
    fn from(path: P) -> Self {
        Self(path.as_ref().to_owned())
    }
}

impl Deref for FileName {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

/// Serialises seconds as other reports have them, which name the phases as well.
pub fn total_seconds<S: Serializer>(seconds: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Seconds {
        total: f64,
    }
    Seconds { total: *seconds }.serialize(serializer)
}

/// The name of a file that may not have been given.
pub fn file_name(path: Option<impl AsRef<Path>>) -> Option<FileName> {
    path.map(FileName::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_says_what_it_is() {
        let written: serde_json::Value = serde_json::from_str(&error(FailureKind::TimeLimit, "too late", 2)).unwrap();
        assert_eq!(written["version"]["schema"], SCHEMA);
        assert_eq!(
            written["error"],
            serde_json::json!({"kind": "time_limit", "message": "too late", "exit_code": 2})
        );
    }

    #[test]
    fn a_failure_says_what_it_is_about_also_behind_other_words() {
        let missing = solidmap::io::read_surface("/nowhere/a.obj").unwrap_err();
        let missing = anyhow::Error::new(missing).context("cannot map it");
        let written: serde_json::Value = serde_json::from_str(&failure(&missing, "no", 2)).unwrap();
        assert_eq!(written["error"]["about"], "not_found");
        let written: serde_json::Value = serde_json::from_str(&failure(&anyhow::anyhow!("other"), "no", 2)).unwrap();
        assert!(written["error"].get("about").is_none());
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_not_utf8_are_written_with_replacement_characters() {
        use std::os::unix::ffi::OsStrExt;

        let name = FileName::from(std::ffi::OsStr::from_bytes(b"\xff.obj"));
        assert_eq!(serde_json::to_string(&name).unwrap(), "\"\u{fffd}.obj\"");
    }
}
