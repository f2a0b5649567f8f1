//! Remeshing: its options from the arguments, and its progress.

use solidmap::remesh::{RemeshOptions, RemeshPhase};

use super::input;
use super::output::Output;
use crate::args::RepairArgs;

/// The library's options, from the arguments.
pub fn remesh_options(args: &RepairArgs) -> RemeshOptions {
    RemeshOptions {
        slide: !args.fix_boundary,
        most_added: args.split_stuck,
        effort: args.effort,
        memory: args.memory.or_else(input::most_memory),
        ..RemeshOptions::default()
    }
}

/// Shows the progress of a remeshing.
pub fn show_phase(phase: RemeshPhase, what: &str, output: &Output) {
    match phase {
        RemeshPhase::Meshing => output.progress(format!("{what}meshing the domain")),
        RemeshPhase::Mapping { nodes } => output.progress(format!("{what}mapping {nodes} nodes")),
        RemeshPhase::MappingBoundary => output.progress(format!("{what}seeking another boundary map")),
        RemeshPhase::Repairing { round, inverted } => {
            let detail = format!("round {round}, {inverted} cells inverted");
            output.progress_in(format!("{what}repairing"), detail);
        }
        RemeshPhase::Verifying => output.progress(format!("{what}counting and measuring")),
    }
}
