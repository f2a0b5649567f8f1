//! The program `solidmap`: parses its arguments, runs one command and reports. Nothing else prints, exits or sets the
//! number of threads.

mod args;
mod commands;
pub mod drawing;
mod shared;

use std::process::ExitCode;

use anyhow::Context;
use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory, Parser};

pub use shared::exhausted_memory::NotingAllocator;
pub use shared::picture_file::{PictureError, read_picture};

use args::{Cli, Command};
use commands::{boundary, certify, check, compare, demo, energy, eval, fit, remesh, sequence, texture, transfer, view};
use shared::json::{self, FailureKind};
use shared::output::{Output, describe, to_stderr, to_stdout};
use shared::{exhausted_memory, interrupt};

/// How a command that could run ended.
pub enum CommandOutcome {
    /// Exit code 0.
    Done,
    /// Exit code 1: it ran, but what it checks does not hold.
    CheckFailed,
}

impl CommandOutcome {
    fn from_check(holds: bool) -> Self {
        if holds { Self::Done } else { Self::CheckFailed }
    }
}

/// The exit code when a command could not run.
const COULD_NOT_RUN: u8 = 2;

/// Runs the program. Exit codes: 0 done, 1 ran but a check failed, 2 could not run, 130 interrupted.
pub fn run() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => refuse_arguments(&without_hidden_commands(error)),
    };
    let output = Output::new(cli.json);
    let ended = execute(&cli, &output);
    output.finish();
    match ended {
        Ok(CommandOutcome::Done) => ExitCode::SUCCESS,
        Ok(CommandOutcome::CheckFailed) => ExitCode::from(1),
        Err(error) => {
            let message = describe(&error);
            to_stderr(format_args!("error: {message}"));
            if output.errors_as_json() {
                // A failure to write cannot be reported anywhere.
                let _ = to_stdout(&json::failure(&error, &message, COULD_NOT_RUN.into()));
            }
            ExitCode::from(COULD_NOT_RUN)
        }
    }
}

/// The error without the commands that only the program itself calls.
fn without_hidden_commands(mut error: clap::Error) -> clap::Error {
    if let Some(ContextValue::Strings(commands)) = error.get(ContextKind::ValidSubcommand) {
        let program = Cli::command();
        let is_shown = |name: &&String| {
            program
                .find_subcommand(name)
                .is_some_and(|command| !command.is_hide_set())
        };
        let shown = commands.iter().filter(is_shown).cloned().collect();
        error.insert(ContextKind::ValidSubcommand, ContextValue::Strings(shown));
    }
    error
}

/// Prints help, the version, or what is wrong with the arguments, and exits.
fn refuse_arguments(error: &clap::Error) -> ! {
    let as_json = std::env::args_os().any(|argument| argument == "--json");
    if as_json && error.use_stderr() {
        let text = error.to_string();
        // What is wrong comes first, on one or several lines; then usage and advice.
        let lines = text.lines().take_while(|line| !line.is_empty()).map(str::trim);
        let message = lines.collect::<Vec<_>>().join(" ");
        let message = message.trim_start_matches("error: ");
        let _ = to_stdout(&json::error(FailureKind::Usage, message, error.exit_code()));
    }
    error.exit()
}

fn execute(cli: &Cli, output: &Output) -> anyhow::Result<CommandOutcome> {
    let threads = cli.threads.map_or(0, |threads| thread_count(threads.into()));
    // Here rather than by its first use, where it would not be an error but a panic.
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    built.context("cannot start threads (--threads takes fewer, `ulimit -v` limits the memory for them)")?;
    if threads > 0 {
        faer::set_global_parallelism(faer::Par::rayon(threads));
    }
    #[cfg(feature = "native")]
    if let Command::NativeWorker = cli.command {
        shared::isolation::serve()?;
        return Ok(CommandOutcome::Done);
    }
    // The worker's end is for the program to tell, whatever its cause.
    exhausted_memory::end_with_an_error(cli.json);
    #[cfg(feature = "native")]
    shared::isolation::isolate(cli)?;
    interrupt::end_cleanly(output);
    // `compare` limits each map by itself.
    if let (Some(limit), false) = (cli.time_limit, matches!(cli.command, Command::Compare(_))) {
        interrupt::end_after(limit, output);
    }
    match &cli.command {
        Command::Demo(args) => demo::run(args, output),
        Command::Check(args) => check::run(args, output),
        #[cfg(feature = "native")]
        Command::Tet(args) => commands::tet::run(args, output),
        #[cfg(feature = "native")]
        Command::Offset(args) => commands::offset::run(args, output),
        #[cfg(not(feature = "native"))]
        Command::Tet(_) | Command::Offset(_) => anyhow::bail!(
            "this solidmap was built without CGAL and TetGen; build it with the feature `native` (the default)"
        ),
        Command::Boundary(command) => boundary::run(command, output),
        Command::Bijective(args) => commands::bijective::run(args, output),
        Command::Fit(args) => fit::run(args, output),
        Command::Eval(args) => eval::run(args, output),
        Command::Energy(args) => energy::run(args, output),
        Command::Transfer(args) => transfer::run(args, output),
        Command::Polycube(args) => commands::polycube::run(args, output),
        Command::Hexmesh(args) => commands::hexmesh::run(args, output),
        Command::Remesh(args) => remesh::run(args, output),
        Command::Texture(args) => texture::run(args, output),
        Command::Sequence(args) => sequence::run(args, output),
        Command::Certify(args) => certify::run(args, output),
        Command::View(args) => view::run(args, output),
        Command::Compare(args) => compare::run(args, cli.threads, output),
        Command::Study(command) => commands::study::run(command, output),
        Command::CompareWorker(args) => compare::worker::run(args),
        Command::NativeWorker => anyhow::bail!("this solidmap was built without CGAL and TetGen"),
    }
}

/// At most eight threads per core: many more spend their time waiting for one another. A second's work took ten minutes
/// with 1024 threads on two cores.
fn thread_count(threads: usize) -> usize {
    const PER_CORE: usize = 8;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    threads.min(PER_CORE * cores)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_as_many_as_asked_for_up_to_eight_for_each_core() {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        assert_eq!(
            [thread_count(1), thread_count(8 * cores), thread_count(8 * cores + 1)],
            [1, 8 * cores, 8 * cores]
        );
    }
}
