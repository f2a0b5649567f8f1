//! The program `solidmap`: parses its arguments, runs one command and reports. Nothing else prints, exits or sets the
//! number of threads.

mod args;
mod commands;
pub mod drawing;
mod shared;

use std::process::ExitCode;

use clap::Parser;

pub use shared::picture_file::{PictureError, read_picture};

use args::{Cli, Command};
use commands::{boundary, certify, check, compare, demo, energy, eval, fit, remesh, sequence, texture, transfer};
use shared::interrupt;
use shared::output::{Output, describe, to_stderr};

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

/// Runs the program. Exit codes: 0 done, 1 ran but a check failed, 2 could not run, 130 interrupted.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    match execute(&cli) {
        Ok(CommandOutcome::Done) => ExitCode::SUCCESS,
        Ok(CommandOutcome::CheckFailed) => ExitCode::from(1),
        Err(error) => {
            to_stderr(format_args!("error: {}", describe(&error)));
            ExitCode::from(2)
        }
    }
}

fn execute(cli: &Cli) -> anyhow::Result<CommandOutcome> {
    if let Some(threads) = cli.threads {
        let threads = thread_count(threads.into());
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        faer::set_global_parallelism(faer::Par::rayon(threads));
    }
    #[cfg(feature = "native")]
    if let Command::NativeWorker = cli.command {
        shared::isolation::serve()?;
        return Ok(CommandOutcome::Done);
    }
    if cli.json {
        require_utf8(std::env::args_os())?;
    }
    let output = Output::new(cli.json);
    #[cfg(feature = "native")]
    shared::isolation::isolate(cli)?;
    interrupt::end_cleanly(&output);
    // `compare` limits each map by itself.
    if let (Some(limit), false) = (cli.time_limit, matches!(cli.command, Command::Compare(_))) {
        interrupt::end_after(limit, &output);
    }
    let outcome = match &cli.command {
        Command::Demo(args) => demo::run(args, &output),
        Command::Check(args) => check::run(args, &output),
        #[cfg(feature = "native")]
        Command::Tet(args) => commands::tet::run(args, &output),
        #[cfg(feature = "native")]
        Command::Offset(args) => commands::offset::run(args, &output),
        #[cfg(not(feature = "native"))]
        Command::Tet(_) | Command::Offset(_) => anyhow::bail!(
            "this solidmap was built without CGAL and TetGen; build it with the feature `native` (the default)"
        ),
        Command::Boundary(command) => boundary::run(command, &output),
        Command::Fit(args) => fit::run(args, &output),
        Command::Eval(args) => eval::run(args, &output),
        Command::Energy(args) => energy::run(args, &output),
        Command::Transfer(args) => transfer::run(args, &output),
        Command::Remesh(args) => remesh::run(args, &output),
        Command::Texture(args) => texture::run(args, &output),
        Command::Sequence(args) => sequence::run(args, &output),
        Command::Certify(args) => certify::run(args, &output),
        Command::Compare(args) => compare::run(args, cli.threads, &output),
        Command::CompareWorker(args) => compare::worker::run(args),
        Command::NativeWorker => anyhow::bail!("this solidmap was built without CGAL and TetGen"),
    };
    output.finish();
    outcome
}

/// Refuses arguments that are not UTF-8: reports name files, and JSON has to be UTF-8.
fn require_utf8(mut arguments: impl Iterator<Item = std::ffi::OsString>) -> anyhow::Result<()> {
    match arguments.find(|argument| argument.to_str().is_none()) {
        Some(name) => anyhow::bail!("`{}` is not UTF-8; with --json all names have to be", name.display()),
        None => Ok(()),
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
