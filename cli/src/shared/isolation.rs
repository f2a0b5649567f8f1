//! CGAL and TetGen in a process of their own, so that a crash does not end this one.

use anyhow::Context;
use solidmap::cgal_tetgen::{self, Isolation};

use crate::args::{Cli, Command};

/// Makes CGAL and TetGen run in a process of their own from now on. In the worker of `compare` they do already.
pub fn isolate(cli: &Cli) -> anyhow::Result<()> {
    if matches!(cli.command, Command::CompareWorker(_)) {
        return Ok(());
    }
    let program = std::env::current_exe().context("cannot find the program itself, to run CGAL and TetGen in it")?;
    let threads = cli.threads.map(|n| ["--threads".to_owned(), n.to_string()]);
    cgal_tetgen::isolate(Some(Isolation {
        program,
        arguments: threads.into_iter().flatten().chain(["native-worker".into()]).collect(),
        time_limit: None,
    }));
    Ok(())
}

/// Serves calls of CGAL and TetGen, in the process that [`isolate`] starts.
pub fn serve() -> anyhow::Result<()> {
    cgal_tetgen::serve_calls().context("`native-worker` is for solidmap itself: it serves the process that starts it")
}
