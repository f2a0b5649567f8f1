//! Output: results to stdout, messages and progress to stderr, progress only on a terminal.

use std::cell::Cell;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use solidmap::compare::CompareError;
use solidmap::fit::FitError;
use solidmap::sequence::SequenceError;
use solidmap::texture::TextureError;

/// Where results and messages go.
pub struct Output {
    json: bool,
    bar: ProgressBar,
    ticking: Cell<bool>,
}

const SPINNER: &str = "{spinner} {msg} [{elapsed}]";
const BAR: &str = "{spinner} {msg} {bar:30} {human_pos}/{human_len} [{elapsed}]";

impl Output {
    /// Results as JSON, or as text.
    pub fn new(json: bool) -> Self {
        let bar = if io::stderr().is_terminal() {
            ProgressBar::new_spinner()
        } else {
            ProgressBar::hidden()
        };
        bar.set_style(style(SPINNER));
        Self {
            json,
            bar,
            ticking: Cell::new(false),
        }
    }

    /// Shows what is being done now, with the time since the command began.
    pub fn progress(&self, step: impl Into<String>) {
        if self.bar.length().is_some() {
            self.bar.set_style(style(SPINNER));
            self.bar.unset_length();
        }
        self.show(step.into());
    }

    /// Shows how much of a step is done.
    pub fn progress_of(&self, step: impl Into<String>, done: usize, of: usize) {
        self.show(step.into());
        if self.bar.length().is_none() {
            self.bar.set_style(style(BAR));
        }
        self.bar.set_position(done as u64);
        self.bar.set_length(of as u64);
    }

    fn show(&self, step: String) {
        self.bar.set_message(step);
        if !self.ticking.replace(true) {
            // A line that was cleared shows the time since the beginning again.
            let elapsed = self.bar.elapsed();
            self.bar.reset();
            self.bar.set_elapsed(elapsed);
            self.bar.enable_steady_tick(Duration::from_millis(100));
        }
    }

    /// Clears the progress line, until there is more to show.
    pub fn finish(&self) {
        self.ticking.set(false);
        self.bar.finish_and_clear();
    }

    /// The progress line, for the thread that ends the program.
    pub fn progress_line(&self) -> ProgressBar {
        self.bar.clone()
    }

    /// A warning, such as what was repaired.
    pub fn warn(&self, message: impl std::fmt::Display) {
        self.bar.suspend(|| to_stderr(format_args!("warning: {message}")));
    }

    /// A warning of a fit, which may name settings.
    pub fn warn_of_fit(&self, message: impl std::fmt::Display) {
        self.warn(with_option_names(message));
    }

    /// A remark, such as on a file that was written. Not shown with `--json`.
    pub fn note(&self, message: impl std::fmt::Display) {
        if !self.json {
            self.bar.suspend(|| to_stderr(format_args!("{message}")));
        }
    }

    /// The result: `report` as JSON, or `text`.
    pub fn result(&self, report: &impl Serialize, text: impl FnOnce() -> String) -> anyhow::Result<()> {
        self.finish();
        let content = if self.json {
            serde_json::to_string_pretty(report)?
        } else {
            text()
        };
        let mut stdout = io::stdout().lock();
        match writeln!(stdout, "{}", content.trim_end()).and_then(|()| stdout.flush()) {
            // A reader such as `head` may close the pipe early.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            written => Ok(written?),
        }
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_spinner())
}

/// A message about a fit with the names of the library's settings replaced by those of the options. Not for messages that
/// may name files, which can be called `alpha`.
pub fn with_option_names(message: impl std::fmt::Display) -> String {
    const OPTIONS: [[&str; 2]; 8] = [
        ["`max_sources`", "--max-sources"],
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

/// Lines of a name and a text, with texts aligned.
pub fn two_columns(rows: Vec<[String; 2]>) -> String {
    let width = rows.iter().map(|[name, _]| name.chars().count()).max().unwrap_or(0);
    let lines = rows
        .into_iter()
        .map(|[name, text]| format!("{name:<width$}  {text}").trim_end().to_owned());
    lines.collect::<Vec<_>>().join("\n")
}
