//! Output: results to stdout, messages and progress to stderr.

use std::cell::Cell;
use std::io::{self, Write};
use std::path::Path;

use indicatif::ProgressBar;
use serde::Serialize;
use solidmap::compare::CompareError;
use solidmap::fit::FitError;
use solidmap::sequence::SequenceError;
use solidmap::texture::TextureError;

use super::json::{self, FileName};
use super::progress::Progress;

/// Where results and messages go.
pub struct Output {
    json: bool,
    /// Whether a result has been printed.
    printed: Cell<bool>,
    progress: Progress,
}

impl Output {
    /// Results as JSON, or as text.
    pub fn new(json: bool) -> Self {
        Self {
            json,
            printed: Cell::new(false),
            progress: Progress::on_stderr(),
        }
    }

    /// Shows what is being done now, with the time since the command began.
    pub fn progress(&self, phase: impl AsRef<str>) {
        self.progress.phase(phase.as_ref(), "");
    }

    /// Shows what is being done now, and how far it has come in words.
    pub fn progress_in(&self, phase: impl AsRef<str>, detail: impl AsRef<str>) {
        self.progress.phase(phase.as_ref(), detail.as_ref());
    }

    /// Shows how much of a phase is done.
    pub fn progress_of(&self, phase: impl AsRef<str>, done: usize, of: usize) {
        self.progress.share(phase.as_ref(), done, of);
    }

    /// Clears the progress line, until there is more to show.
    pub fn finish(&self) {
        self.progress.finish();
    }

    /// The progress line, for the thread that ends the program.
    pub fn progress_line(&self) -> ProgressBar {
        self.progress.line()
    }

    /// Whether errors are to be printed as JSON: with `--json`, unless a report that says more has been printed.
    pub fn errors_as_json(&self) -> bool {
        self.json && !self.printed.get()
    }

    /// A warning, such as what was repaired.
    pub fn warn(&self, message: impl std::fmt::Display) {
        self.progress.suspend(|| to_stderr(format_args!("warning: {message}")));
    }

    /// A warning of a fit, which may name settings.
    pub fn warn_of_fit(&self, message: impl std::fmt::Display) {
        self.warn(with_option_names(message));
    }

    /// A remark, such as on a file that was written. Not shown with `--json`.
    pub fn note(&self, message: impl std::fmt::Display) {
        if !self.json {
            self.progress.suspend(|| to_stderr(format_args!("{message}")));
        }
    }

    /// The result: `report` as JSON, or `text`.
    pub fn result(&self, report: &impl Serialize, text: impl FnOnce() -> String) -> anyhow::Result<()> {
        self.finish();
        let content = if self.json { json::document(report)? } else { text() };
        self.printed.set(true);
        Ok(to_stdout(&content)?)
    }
}

/// Writes text that ends with a line to stdout.
pub fn to_stdout(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    match writeln!(stdout, "{}", text.trim_end()).and_then(|()| stdout.flush()) {
        // A reader such as `head` may close the pipe early.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

/// A message about a fit with the names of the library's settings replaced by those of the options. Not for messages that
/// may name files, which can be called `alpha`.
pub fn with_option_names(message: impl std::fmt::Display) -> String {
    const OPTIONS: [[&str; 2]; 11] = [
        ["`max_sources`", "--max-sources"],
        ["`max_source_ratio`", "--max-s-ratio"],
        ["`max_error_ratio`", "--max-error"],
        ["`max_local_error`", "--max-local-error"],
        ["`source_ratio`", "--s-ratio"],
        ["`collocation_ratio`", "--c-ratio"],
        ["`held_out`", "--held-out"],
        ["`memory`", "--memory"],
        ["`alpha`", "--alpha"],
        ["`offset`", "--offset"],
        ["`radius`", "--radius"],
    ];
    OPTIONS
        .iter()
        .fold(message.to_string(), |text, [field, option]| text.replace(field, option))
}

/// What an error says, with the names of options where it is about settings of the library.
fn message(error: &(dyn std::error::Error + 'static)) -> String {
    if error.is::<FitError>() || error.is::<SequenceError>() || error.is::<CompareError>() || error.is::<TextureError>()
    {
        with_option_names(error)
    } else {
        error.to_string()
    }
}

/// Writes a line to stderr. A failure cannot be reported anywhere.
pub fn to_stderr(message: std::fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{message}");
}

/// Largest resident set of this process so far, in bytes; 0 where the system does not say.
pub fn peak_rss_bytes() -> u64 {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else {
        return 0;
    };
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|rest| rest.trim().trim_end_matches("kB").trim().parse::<u64>().ok())
        .map_or(0, |kib| kib * 1024)
}

/// The error and its causes, each once: many errors quote their cause.
pub fn describe(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(message) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Writes a file, whole or not at all.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> anyhow::Result<()> {
    Ok(solidmap::io::atomic_write(path, |writer| writer.write_all(bytes))?)
}

/// A number of bytes in MiB.
pub fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

/// The line of a summary that gives the memory.
pub fn memory_row(peak_rss_bytes: u64) -> [String; 2] {
    ["memory".into(), format!("{:.0} MiB at most", mebibytes(peak_rss_bytes))]
}

/// The line of a summary that names the files that were written.
pub fn written_row<'f>(files: impl IntoIterator<Item = Option<&'f FileName>>) -> [String; 2] {
    let names = files.into_iter().flatten().map(|file| file.display().to_string());
    ["written".into(), names.collect::<Vec<_>>().join(", ")]
}

/// Lines of a name and a text, with texts aligned.
pub fn two_columns(rows: Vec<[String; 2]>) -> String {
    let width = rows.iter().map(|[name, _]| name.chars().count()).max().unwrap_or(0);
    let lines = rows
        .into_iter()
        .map(|[name, text]| format!("{name:<width$}  {text}").trim_end().to_owned());
    lines.collect::<Vec<_>>().join("\n")
}
