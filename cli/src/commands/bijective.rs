//! `solidmap bijective`: adds the one-to-one map to a map file.

use anyhow::Context;
use serde::Serialize;
use solidmap::bijective::RefinementOptions;
use solidmap::files;
use solidmap::io;

use crate::CommandOutcome;
use crate::args::BijectiveArgs;
use crate::shared::bijective::{BijectiveSummary, Making, is_verdict, make, rows};
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns};

/// What `bijective --json` prints.
#[derive(Serialize)]
struct Summary {
    map: FileName,
    mesh: Option<FileName>,
    /// None where no map was found.
    output: Option<FileName>,
    /// Why no map was found.
    problem: Option<String>,
    bijective: Option<BijectiveSummary>,
    peak_rss_bytes: u64,
}

/// Makes the bijective map, and writes it beside the harmonic one.
pub fn run(args: &BijectiveArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let written = args.output.as_ref().unwrap_or(&args.map);
    let mesh: Vec<_> = args.mesh.iter().map(std::path::PathBuf::as_path).collect();
    input::require_writable(written, &["safetensors", "map"], &mesh)?;
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let mesh = args.mesh.as_ref().map(io::read_tets).transpose()?;
    let making = Making {
        mesh,
        refinement: RefinementOptions {
            tolerance: args.tolerance.unwrap_or(RefinementOptions::default().tolerance),
            ..RefinementOptions::default()
        },
        split_stuck: args.split_stuck,
        effort: args.effort,
        memory: args.memory.or_else(input::most_memory),
    };
    let cannot_make = || format!("cannot make a bijective map of `{}`", args.map.display());
    let (summary, problem) = match make(&file.map, &boundary, making, output).with_context(cannot_make)? {
        Ok((bijective, summary)) => {
            output.progress("writing");
            files::write_map(written, &file.with_bijective(bijective))?;
            (Some(summary), None)
        }
        Err(error) if is_verdict(&error) => (None, Some(error.to_string())),
        Err(error) => return Err(error).with_context(cannot_make),
    };
    if let Some(problem) = &problem {
        output.warn(format!(
            "no bijective map was found, and nothing was written: {problem}"
        ));
    }
    let report = Summary {
        map: (&args.map).into(),
        mesh: file_name(args.mesh.as_ref()),
        output: summary.as_ref().map(|_| written.into()),
        problem,
        bijective: summary,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || {
        let mut lines = report.bijective.as_ref().map_or(vec![], rows);
        lines.push(memory_row(report.peak_rss_bytes));
        lines.extend(
            report
                .output
                .as_ref()
                .map(|file| ["written".into(), file.display().to_string()]),
        );
        two_columns(lines)
    })?;
    Ok(CommandOutcome::from_check(report.bijective.is_some()))
}
