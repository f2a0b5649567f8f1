//! Fits: their options from the arguments, and their progress.

use std::cell::Cell;

use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{COLLOCATION_PER_FREE_SOURCE, Fit, FitMethod, FitOptions, Phase, Placement, fit};
use solidmap::solver::{Decomposition, DenseOptions, SchwarzOptions};

use super::interrupt;
use super::output::Output;
use crate::args::{MethodArgs, MethodKind, PlacementKind};

/// Fits, and shows the progress.
pub fn fit_with_progress(boundary: &BoundaryMap, options: &FitOptions, output: &Output) -> anyhow::Result<Fit> {
    Ok(fit(boundary, options, &|phase| show_phase(phase, "", output))?)
}

/// Fits, and shows the progress. At the time limit the best map so far is taken, if there is one.
pub fn fit_in_time(boundary: &BoundaryMap, options: &FitOptions, output: &Output) -> anyhow::Result<Fit> {
    let has_result = Cell::new(false);
    let progress = |phase| {
        show_phase(phase, "", output);
        has_result.set(has_result.get() || matches!(phase, Phase::Measuring));
        interrupt::control(has_result.get())
    };
    Ok(fit(boundary, options, &progress)?)
}

/// Shows a phase of a fit; `what` is put before it.
pub fn show_phase(phase: Phase, what: &str, output: &Output) {
    match phase {
        Phase::Factoring { done, of } => output.progress_of(format!("{what}factoring patches"), done, of),
        Phase::Iterating { iteration, residual } => {
            let detail = format!("iteration {iteration}, residual {residual:.1e}");
            output.progress_in(format!("{what}solving"), detail);
        }
        other => output.progress(format!("{what}{}", in_words(other))),
    }
}

/// Shows that a fit among many is being made, and how far it has come: a log has one line for each of them.
pub fn show_one_of_many(phase: Phase, what: &str, output: &Output) {
    output.progress_in(what, in_words(phase));
}

fn in_words(phase: Phase) -> String {
    match phase {
        Phase::Checking => "checking".into(),
        Phase::Sampling => "placing sources".into(),
        Phase::Decomposing { rows, columns } => format!("decomposing a {rows} × {columns} matrix"),
        Phase::Factoring { .. } => "factoring patches".into(),
        Phase::Solving | Phase::Iterating { .. } => "solving".into(),
        Phase::Measuring => "measuring the boundary error".into(),
        Phase::MovingSources { round, residual } => format!("moving sources, round {round}: residual {residual:.1e}"),
        Phase::Refining { round, error, sources } => {
            format!("refinement {round}: error {error:.1e}, {sources} sources")
        }
    }
}

/// The library's options, from the arguments.
pub fn fit_options(args: &MethodArgs, tolerance: f64) -> anyhow::Result<FitOptions> {
    let default = match args.paper {
        true => PlacementKind::Offset,
        false => PlacementKind::Adaptive,
    };
    let (placement, parameter) = args.place.chosen(args.placement, default)?;
    // The paper's placements come with its ratios, the adaptive one with an overdetermined system.
    let base = if args.paper || placement != PlacementKind::Adaptive {
        FitOptions::paper()
    } else {
        FitOptions::adaptive()
    };
    let placement = match placement {
        PlacementKind::Adaptive => Placement::Adaptive { alpha: parameter },
        PlacementKind::Offset => Placement::Offset { distance: parameter },
        PlacementKind::Sphere => Placement::Sphere { radius: parameter },
    };
    let kind = args.method.unwrap_or(match base.method {
        FitMethod::Schwarz { .. } if args.free_sources => MethodKind::Dense,
        FitMethod::Schwarz { .. } => MethodKind::Schwarz,
        FitMethod::Dense { options, .. } if options.decomposition == Decomposition::Qr => MethodKind::Dense,
        FitMethod::Dense { .. } => MethodKind::Svd,
    });
    let dense = |decomposition| FitMethod::Dense {
        placement,
        options: DenseOptions {
            decomposition,
            truncation: args.truncation.unwrap_or(DenseOptions::default().truncation),
        },
    };
    let method = match kind {
        MethodKind::Dense => dense(Decomposition::Qr),
        MethodKind::Svd => dense(Decomposition::Svd),
        MethodKind::Schwarz => {
            anyhow::ensure!(args.truncation.is_none(), "--truncation needs --method dense or svd");
            anyhow::ensure!(!args.free_sources, "--free-sources needs --method dense or svd");
            FitMethod::schwarz(placement, SchwarzOptions::default())
                .map_err(|error| anyhow::anyhow!("{error} (--placement adaptive; --method dense or svd)"))?
        }
    };
    let source_ratio = args.s_ratio.unwrap_or(base.source_ratio);
    let collocation_ratio = match args.free_sources {
        true => COLLOCATION_PER_FREE_SOURCE * source_ratio,
        false => base.collocation_ratio,
    };
    Ok(FitOptions {
        method,
        source_ratio,
        collocation_ratio: args.c_ratio.unwrap_or(collocation_ratio),
        max_sources: args.max_sources.unwrap_or(method.default_max_sources()),
        max_source_ratio: args.max_s_ratio.unwrap_or(base.max_source_ratio),
        affine: !args.no_affine,
        tolerance,
        max_error_ratio: base.max_error_ratio,
        max_local_error: base.max_local_error,
        refine: !args.no_refine,
        free_sources: args.free_sources,
        memory: args.memory,
        held_out: args.held_out,
        seed: args.seed,
    })
}
