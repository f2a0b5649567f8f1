//! Progress on stderr: a line that is redrawn on a terminal, lines of a log anywhere else.

use std::cell::Cell;
use std::io::{self, IsTerminal};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::output::to_stderr;

const SPINNER: &str = "{spinner} {msg} [{elapsed}]";
const BAR: &str = "{spinner} {msg} {bar:30} {human_pos}/{human_len} [{elapsed}]";

/// Where progress is shown.
pub struct Progress {
    bar: ProgressBar,
    ticking: Cell<bool>,
    log: Option<Arc<Mutex<Log>>>,
}

impl Progress {
    /// On stderr, from now on.
    pub fn on_stderr() -> Self {
        let on_terminal = io::stderr().is_terminal();
        let bar = if on_terminal {
            ProgressBar::new_spinner()
        } else {
            ProgressBar::hidden()
        };
        bar.set_style(style(SPINNER));
        Self {
            bar,
            ticking: Cell::new(false),
            log: (!on_terminal).then(write_log),
        }
    }

    /// A phase begins, or goes on: its name, and how far it has come in words, which may be empty.
    pub fn phase(&self, name: &str, detail: &str) {
        if self.bar.length().is_some() {
            self.bar.set_style(style(SPINNER));
            self.bar.unset_length();
        }
        self.show(name, detail.to_owned(), detail);
    }

    /// How much of a phase is done.
    pub fn share(&self, name: &str, done: usize, of: usize) {
        self.show(name, format!("{done}/{of}"), "");
        if self.bar.length().is_none() {
            self.bar.set_style(style(BAR));
        }
        self.bar.set_position(done as u64);
        self.bar.set_length(of as u64);
    }

    fn show(&self, name: &str, logged: String, drawn: &str) {
        if let Some(log) = &self.log {
            lock(log).report(name, logged);
            return;
        }
        self.bar.set_message(with_detail(name, drawn));
        if !self.ticking.replace(true) {
            // A line that was cleared shows the time since the beginning again.
            let elapsed = self.bar.elapsed();
            self.bar.reset();
            self.bar.set_elapsed(elapsed);
            self.bar.enable_steady_tick(Duration::from_millis(100));
        }
    }

    /// Clears the progress line, until there is more to show; ends the log's last phase.
    pub fn finish(&self) {
        self.ticking.set(false);
        self.bar.finish_and_clear();
        if let Some(log) = &self.log {
            lock(log).phase = None;
        }
    }

    /// Prints while no progress line is in the way.
    pub fn suspend(&self, print: impl FnOnce()) {
        self.bar.suspend(print);
    }

    /// The progress line, for the thread that ends the program.
    pub fn line(&self) -> ProgressBar {
        self.bar.clone()
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_spinner())
}

fn with_detail(name: &str, detail: &str) -> String {
    if detail.is_empty() {
        name.into()
    } else {
        format!("{name}: {detail}")
    }
}

/// The log keeps silent about a command that ends before this.
const QUIET: Duration = Duration::from_secs(1);
/// The longest time between two lines.
const INTERVAL: Duration = Duration::from_secs(10);
/// The log looks this often whether a line is due.
const LOOK: Duration = Duration::from_millis(100);

/// What is being done, for a log: every phase, with the time when it began, and how far it has come every ten seconds.
struct Log {
    start: Instant,
    /// Lines of phases that have begun while the log keeps silent.
    held_back: Vec<String>,
    phase: Option<[String; 2]>,
    last_line: Instant,
}

impl Log {
    fn report(&mut self, name: &str, detail: String) {
        match &mut self.phase {
            Some([latest, so_far]) if latest == name => *so_far = detail,
            phase => {
                let line = line(self.start.elapsed(), name);
                *phase = Some([name.into(), detail]);
                self.held_back.push(line);
                self.write_due();
            }
        }
    }

    /// Writes what is due.
    fn write_due(&mut self) {
        let elapsed = self.start.elapsed();
        if elapsed < QUIET {
            return;
        }
        if self.held_back.is_empty()
            && let Some([name, detail]) = &self.phase
            && self.last_line.elapsed() >= INTERVAL
        {
            let so_far = if detail.is_empty() { "still at it" } else { detail };
            self.held_back.push(line(elapsed, &with_detail(name, so_far)));
        }
        if !self.held_back.is_empty() {
            self.last_line = Instant::now();
            to_stderr(format_args!("{}", std::mem::take(&mut self.held_back).join("\n")));
        }
    }
}

fn line(elapsed: Duration, text: &str) -> String {
    format!("{:>7.1} s  {text}", elapsed.as_secs_f64())
}

fn lock(log: &Mutex<Log>) -> MutexGuard<'_, Log> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A log that begins now, and a thread that writes its lines when they are due.
fn write_log() -> Arc<Mutex<Log>> {
    let now = Instant::now();
    let log = Arc::new(Mutex::new(Log {
        start: now,
        held_back: Vec::new(),
        phase: None,
        last_line: now,
    }));
    let shared = Arc::downgrade(&log);
    // Where no thread can be made, lines come when there is something new.
    let _ = std::thread::Builder::new().spawn(move || {
        std::thread::sleep(QUIET);
        while let Some(log) = shared.upgrade() {
            lock(&log).write_due();
            drop(log);
            std::thread::sleep(LOOK);
        }
    });
    log
}

#[cfg(test)]
mod tests {
    use super::*;

    fn begun_before(seconds: u64) -> Log {
        let start = Instant::now() - Duration::from_secs(seconds);
        Log {
            start,
            held_back: Vec::new(),
            phase: None,
            last_line: start,
        }
    }

    #[test]
    fn a_short_command_logs_nothing_and_a_longer_one_all_its_phases() {
        let mut log = begun_before(0);
        log.report("reading", String::new());
        log.report("solving", "1/3".into());
        log.report("solving", "2/3".into());
        log.write_due();
        assert_eq!(log.held_back, ["    0.0 s  reading", "    0.0 s  solving"]);
        log.start -= QUIET;
        log.write_due();
        assert!(log.held_back.is_empty());
    }

    #[test]
    fn a_long_phase_is_logged_every_ten_seconds() {
        let mut log = begun_before(25);
        log.report("solving", "1/3".into());
        let begun = log.last_line;
        log.write_due();
        assert_eq!(log.last_line, begun, "nothing is due yet");
        log.last_line -= INTERVAL;
        log.write_due();
        assert!(log.last_line >= begun);
    }
}
