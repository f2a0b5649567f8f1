//! `solidmap study`: the experiments of the paper (figures 3 and 5) on any pair.

mod boundary;
mod charts;
mod measured;
mod page;
mod results;
mod setting;
mod summary;
mod sweep;
mod table;

use crate::CommandOutcome;
use crate::args::StudyCommand;
use crate::shared::output::Output;

/// Runs the subcommand.
pub fn run(command: &StudyCommand, output: &Output) -> anyhow::Result<CommandOutcome> {
    match command {
        StudyCommand::Placement(args) => sweep::placement(args, output),
        StudyCommand::Ratios(args) => sweep::ratios(args, output),
        StudyCommand::Boundary(args) => boundary::run(args, output),
    }
}
