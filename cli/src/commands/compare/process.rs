//! Runs jobs in processes of their own.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;

use super::job::{Job, RESULT};
use crate::shared::output::{Output, write_file};

/// How often a process is checked while it prints nothing.
const TICK: Duration = Duration::from_millis(50);
/// How long a process may take to end when it is asked to.
const GRACE: Duration = Duration::from_secs(2);

/// Runs a job and returns its result, or why there is none. Its progress is shown after `label`.
pub fn run<T: DeserializeOwned>(
    job: &Job,
    label: &str,
    threads: Option<u16>,
    time_limit: f64,
    output: &Output,
) -> Result<T, String> {
    start(job, threads)
        .map_err(|error| format!("no process could be started: {error}"))
        .and_then(|child| wait(child, label, time_limit, output))?;
    let text = std::fs::read(job.scratch.join(RESULT)).map_err(|error| format!("the result is missing: {error}"))?;
    serde_json::from_slice(&text).map_err(|error| format!("the result cannot be read: {error}"))
}

fn start(job: &Job, threads: Option<u16>) -> anyhow::Result<Child> {
    std::fs::create_dir_all(&job.scratch)?;
    let path = job.scratch.join("job.json");
    write_file(&path, &serde_json::to_vec(job)?)?;
    let mut command = Command::new(std::env::current_exe()?);
    if let Some(threads) = threads {
        command.args(["--threads", &threads.to_string()]);
    }
    // The process ends itself when its standard input closes.
    command
        .arg("compare-worker")
        .arg(&path)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    Ok(command.spawn()?)
}

fn wait(mut child: Child, label: &str, time_limit: f64, output: &Output) -> Result<(), String> {
    let lines = lines_of(&mut child);
    let messages = child.stderr.take().map(|mut stderr| {
        std::thread::spawn(move || {
            let mut text = Vec::new();
            let _ = stderr.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        })
    });
    let begun = Instant::now();
    output.progress(label);
    let status = loop {
        match lines.recv_timeout(TICK) {
            Ok(line) => output.progress_in(label, line),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(TICK),
        }
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if begun.elapsed().as_secs_f64() > time_limit => {
                end(&mut child);
                return Err(format!(
                    "not done within the time limit of {time_limit} s (--time-limit)"
                ));
            }
            Ok(None) => {}
            Err(error) => return Err(format!("the process was lost: {error}")),
        }
    };
    let messages = messages.and_then(|thread| thread.join().ok()).unwrap_or_default();
    if status.success() {
        Ok(())
    } else {
        Err(reason(status, &messages))
    }
}

/// Ends a process, which gets a moment to remove what is half written.
fn end(child: &mut Child) {
    drop(child.stdin.take());
    let asked = Instant::now();
    while asked.elapsed() < GRACE && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(TICK);
    }
    let _ = child.kill();
    let _ = child.wait();
}

fn lines_of(child: &mut Child) -> Receiver<String> {
    let (send, lines) = channel();
    if let Some(stdout) = child.stdout.take() {
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                if send.send(line).is_err() {
                    return;
                }
            }
        });
    }
    lines
}

/// The error that a process printed, or how it ended where it printed none.
fn reason(status: ExitStatus, messages: &str) -> String {
    let error = messages.lines().find_map(|line| line.strip_prefix("error: "));
    match error {
        Some(error) => error.to_owned(),
        None => {
            let mut lines = messages.lines().skip_while(|line| !line.contains("panicked at"));
            let words = [lines.next(), lines.next()].map(Option::unwrap_or_default).join(" ");
            format!("its process ended with {status}. {words}")
                .trim_end()
                .to_owned()
        }
    }
}
