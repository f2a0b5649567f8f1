//! `solidmap boundary`: maps of boundary surfaces.

mod check;
mod improve;
pub mod pair;
mod pictures;
pub mod sphere;
mod torus;
mod unfold;
mod unfold_page;
pub mod write;

use crate::CommandOutcome;
use crate::args::BoundaryCommand;
use crate::shared::output::Output;

/// Runs the subcommand.
pub fn run(command: &BoundaryCommand, output: &Output) -> anyhow::Result<CommandOutcome> {
    match command {
        BoundaryCommand::Pair(args) => pair::run(args, output),
        BoundaryCommand::Check(args) => check::run(args, output),
        BoundaryCommand::Sphere(args) => sphere::run(args, output),
        BoundaryCommand::Torus(args) => torus::run(args, output),
        BoundaryCommand::Unfold(args) => unfold::run(args, output),
        BoundaryCommand::Improve(args) => improve::run(args, output),
    }
}
