//! `solidmap fit`: the harmonic map of a solid, from a map of its boundary.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use solidmap::bijective::{Bijective, RefinementOptions};
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::pair::PairMaps;
use solidmap::files::{self, MapFile, MapMetadata};
use solidmap::fit::{FitOptions, FitReport, FreeSourcesEnd, FreeSourcesReport, LocalError, Placement, RefinementEnd};
use solidmap::io;
use solidmap::map::HarmonicMap;
use solidmap::remesh::DEFAULT_EFFORT;
use solidmap::solver::SchwarzStop;
use solidmap::spherical::SphereOptions;
use solidmap::worst_places::WorstPlace;

use crate::CommandOutcome;
use crate::args::{FitArgs, PairArgs};
use crate::drawing::significant;
use crate::shared::bijective::{BijectiveSummary, Making};
use crate::shared::fitting::{fit_in_time, fit_options};
use crate::shared::input::BoundarySource;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, describe, memory_row, peak_rss_bytes, two_columns};
use crate::shared::places::with_places;
use crate::shared::{bijective, boundary_map, input, interrupt};

/// What `fit --json` prints.
#[derive(Serialize)]
struct FitSummary {
    domain: Option<FileName>,
    image: Option<FileName>,
    boundary_file: Option<FileName>,
    target: Option<FileName>,
    map: FileName,
    #[serde(flatten)]
    fit: FitReport,
    tolerance: f64,
    tolerance_met: bool,
    /// The bijective map, where it was asked for and found.
    bijective: Option<BijectiveSummary>,
    /// Where the boundary error is largest.
    worst_places: Vec<WorstPlace>,
    peak_rss_bytes: u64,
}

/// Where the boundary map comes from: it is read, or made.
enum BoundaryInput<'a> {
    Files(BoundarySource),
    ToSphere {
        domain: &'a Path,
    },
    ToTorus {
        domain: &'a Path,
    },
    ToModel {
        domain: &'a Path,
        target: &'a Path,
        pair: &'a PairArgs,
    },
}

/// The names for `--target` of the unit sphere, and of the torus of revolution that fits the domain best.
const SPHERE: &str = "sphere";
const TORUS: &str = "torus";

impl<'a> BoundaryInput<'a> {
    fn new(args: &'a FitArgs) -> anyhow::Result<Self> {
        let target = args.target.as_deref();
        let is_name = |target: &Path| [SPHERE, TORUS].iter().any(|name| target == Path::new(name));
        let to_model = target.is_some_and(|target| !is_name(target));
        anyhow::ensure!(
            to_model || args.pair.is_default(),
            "--landmarks, --components, --start, --via, --aligned and the like say how a solid is mapped to another: they need --target MODEL, a file"
        );
        if let Some(target) = target.filter(|target| to_model && !target.exists()) {
            anyhow::bail!(
                "there is no file `{}`; --target takes a model, `{SPHERE}` or `{TORUS}`",
                target.display()
            );
        }
        let pair = &args.pair;
        match (args.files.source(), args.files.domain.as_deref(), target) {
            (Some(source), _, None) => Ok(Self::Files(source)),
            (None, Some(domain), Some(target)) if to_model => Ok(Self::ToModel { domain, target, pair }),
            (None, Some(domain), Some(target)) if target == Path::new(TORUS) => Ok(Self::ToTorus { domain }),
            (None, Some(domain), Some(_)) => Ok(Self::ToSphere { domain }),
            _ => anyhow::bail!("name a DOMAIN with its --image or --target, or a --boundary"),
        }
    }

    /// The files that are read, by their roles; the first is the domain, or holds it.
    fn files_by_role(&self) -> Vec<(&'static str, &Path)> {
        match self {
            Self::Files(source) => source.files_by_role(),
            Self::ToSphere { domain } | Self::ToTorus { domain } => vec![("domain", domain)],
            Self::ToModel { domain, target, pair } => {
                let pair = pair.files_by_role();
                [("domain", *domain), ("target", *target)]
                    .into_iter()
                    .chain(pair)
                    .collect()
            }
        }
    }

    /// Reads the boundary map, or makes it; and whether it looks right, as far as that is known.
    fn boundary_map(&self, output: &Output) -> anyhow::Result<(BoundaryMap, bool)> {
        match self {
            Self::Files(source) => Ok((source.read()?, true)),
            Self::ToSphere { domain } => {
                let surface = input::read_surface(domain)?;
                let (map, report) = boundary_map::to_sphere(
                    &surface,
                    domain,
                    &SphereOptions::default(),
                    SHARE_OF_BOUNDARY_MAP,
                    output,
                )?;
                if report.concluded {
                    output.warn(interrupt::concluded("boundary map"));
                }
                let map = BoundaryMap::onto_sphere(map).with_context(|| boundary_map::cannot_map(domain))?;
                Ok((map, true))
            }
            Self::ToTorus { domain } => {
                let surface = input::read_surface(domain)?;
                let (made, _) = boundary_map::to_torus(&surface, domain, SHARE_OF_BOUNDARY_MAP, output)?;
                Ok(used(made, output))
            }
            Self::ToModel { domain, target, pair } => to_model(domain, target, pair, output),
        }
    }
}

/// The share of a time limit after which the best boundary map so far is taken.
const SHARE_OF_BOUNDARY_MAP: f64 = 0.5;

/// The map of a solid's boundary to another's, and whether it looks right.
fn to_model(domain: &Path, target: &Path, args: &PairArgs, output: &Output) -> anyhow::Result<(BoundaryMap, bool)> {
    let surface = input::read_surface(domain)?;
    let files = [domain, target];
    let made = boundary_map::to_model(&surface, files, args, 0, SHARE_OF_BOUNDARY_MAP, output)?;
    Ok(used(made, output))
}

/// The map, and whether it looks right, after what there is to say of it.
fn used(PairMaps { map, report, .. }: PairMaps, output: &Output) -> (BoundaryMap, bool) {
    if report.concluded {
        output.warn(interrupt::concluded("boundary map"));
    }
    output.note(format_args!(
        "boundary map in {:.1} s: one to one; symmetric Dirichlet energy {:.2} at the median and {:.3e} at most (that of \
         an isometry is 4). See `solidmap boundary pair`",
        report.timings.total, report.after.symmetric_dirichlet.p50, report.after.symmetric_dirichlet.max
    ));
    (map, !report.looks_wrong())
}

/// Fits a map and writes it.
pub fn run(args: &FitArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let source = BoundaryInput::new(args)?;
    let files = source.files_by_role();
    let paths: Vec<&Path> = files.iter().map(|(_, path)| *path).collect();
    let outputs: [(Option<&PathBuf>, &[&str]); 2] = [
        (Some(&args.output), &["safetensors", "map"]),
        (args.vtu.as_ref(), &["vtu"]),
    ];
    input::require_all_writable(&outputs, &paths)?;
    output.progress("reading");
    let name = paths[0];
    let cannot_map = || format!("cannot map `{}`", name.display());
    let options = FitOptions {
        max_error_ratio: args.max_error,
        max_local_error: args.max_local_error,
        ..fit_options(&args.method, args.tolerance).with_context(cannot_map)?
    };
    let (boundary, looks_right) = source.boundary_map(output)?;
    let inputs: anyhow::Result<_> = files.iter().map(|(role, path)| input::provenance(role, path)).collect();
    let inputs = inputs?;
    let intersections = boundary_map::self_intersections(boundary.domain(), name, output);
    let mut fit = fit_in_time(&boundary, &options, output).with_context(cannot_map)?;
    fit.report
        .warnings
        .iter()
        .for_each(|warning| output.warn_of_fit(warning));
    intersections.iter().for_each(|warning| output.warn(warning));
    fit.report.warnings.extend(intersections);

    let worst_places = fit.worst_places(args.places.worst);
    output.progress("writing");
    let metadata = MapMetadata::new(fit.report.clone(), inputs);
    let mut file = MapFile {
        map: fit.map,
        boundary: Some(fit.boundary),
        bijective: None,
        metadata,
    };
    files::write_map(&args.output, &file)?;
    let mut of_bijective = None;
    if let (true, Some(boundary)) = (args.bijective, file.boundary.clone()) {
        match bijective(args, &file.map, &boundary, output) {
            Ok((bijective, summary)) => {
                file = file.with_bijective(bijective);
                files::write_map(&args.output, &file)?;
                of_bijective = Some(summary);
            }
            Err(error) => output.warn(format!(
                "no bijective map was made; the harmonic one was written all the same: {}",
                describe(&error)
            )),
        }
    }
    if let (Some(path), Some(boundary)) = (&args.vtu, &file.boundary) {
        files::write_fit_fields(path, boundary, &file.map)?;
    }

    let tolerance_met = options.is_met_by(&fit.report);
    let report = FitSummary {
        domain: file_name(args.files.domain.as_ref()),
        image: file_name(args.files.image.as_ref()),
        boundary_file: file_name(args.files.boundary.as_ref()),
        target: file_name(args.target.as_ref()),
        map: (&args.output).into(),
        fit: fit.report,
        tolerance: args.tolerance,
        tolerance_met,
        bijective: of_bijective,
        worst_places,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || with_places(summary(&report), &report.worst_places))?;
    if let Some(local) = report.fit.local_error.filter(|local| local.p99 > 1.0) {
        output.warn(format!(
            "on a hundredth of the boundary the map misses its place by {} times the spacing of the image's vertices or more: \
             what is that fine there, such as a squeezed limb, is lost or folded. --max-local-error 1 adds sources there",
            significant(local.p99, 2)
        ));
    }
    if tolerance_met {
        return Ok(CommandOutcome::from_check(
            looks_right && (!args.bijective || report.bijective.is_some()),
        ));
    }
    let error = &report.fit.boundary_error;
    let local = report.fit.local_error.unwrap_or_default();
    let missed = match error.p99 <= args.tolerance {
        true if local.max > options.max_local_error => format!(
            "the boundary is off by up to {} times the spacing of the image's vertices around, and --max-local-error is {}",
            significant(local.max, 2),
            options.max_local_error
        ),
        true => format!(
            "the boundary is met only to {:.1e} of the target's diagonal at its worst place (above), and {:.1e} is allowed \
             there (--max-error {} times the tolerance)",
            error.max,
            options.max_error_ratio * args.tolerance,
            options.max_error_ratio
        ),
        false => format!(
            "99 % of the boundary is met only to {:.1e} of the target's diagonal, and the tolerance is {:.1e}",
            error.p99, args.tolerance
        ),
    };
    output.warn(format!(
        "{missed}; the map was written all the same. {}",
        advice(&report.fit)
    ));
    Ok(CommandOutcome::CheckFailed)
}

/// The bijective map, over the tetrahedra of the domain if it has any.
fn bijective(
    args: &FitArgs,
    map: &HarmonicMap,
    boundary: &BoundaryMap,
    output: &Output,
) -> anyhow::Result<(Bijective, BijectiveSummary)> {
    let domain = args.files.domain.as_deref();
    let solid = domain.map(io::read_solid).transpose()?;
    let making = Making {
        mesh: solid.map(bijective::own_tets).transpose()?.flatten(),
        refinement: RefinementOptions::default(),
        split_stuck: None,
        effort: DEFAULT_EFFORT,
        memory: input::most_memory(),
    };
    Ok(bijective::make(map, boundary, making, output)??)
}

/// The lines of the summary that say how good a fit is.
fn fit_rows(report: &FitReport) -> Vec<[String; 2]> {
    let error = report.boundary_error;
    let local = |local: LocalError| {
        let (p99, max) = (significant(local.p99, 2), significant(local.max, 2));
        format!("99 % {p99}   max {max}, of the spacing of the image's vertices around")
    };
    vec![
        [
            "boundary".into(),
            format!("{} vertices, {} triangles", report.vertices, report.faces),
        ],
        [
            "system".into(),
            format!("{} sources, {} collocation points", report.sources, report.collocation),
        ],
        ["solver".into(), solver(report)],
        ["refinement".into(), refinement(report)],
        [
            "boundary error".into(),
            format!("rms {:.2e}   99 % {:.2e}   max {:.2e}", error.rms, error.p99, error.max),
        ],
        [
            "".into(),
            "at held-out points, as fractions of the target's diagonal".into(),
        ],
        ["local error".into(), report.local_error.map_or("none".into(), local)],
        [
            "residual".into(),
            format!(
                "rms {:.2e} at the collocation points (C-Error {:.2e})",
                report.residual_rms, report.c_error
            ),
        ],
    ]
}

fn solver(report: &FitReport) -> String {
    match (report.rank, report.stop) {
        (Some(rank), _) => {
            let condition = report.condition.map_or("singular".into(), |c| format!("{c:.1e}"));
            format!("{}, rank {rank}, condition {condition}", report.method)
        }
        (None, Some(stop)) => {
            let why = match stop {
                SchwarzStop::Goal => "far below the tolerance",
                SchwarzStop::Plateau => "at the least-squares optimum",
                SchwarzStop::Iterations => "before it converged",
            };
            format!(
                "{}, stopped after {} iterations {why}",
                report.method, report.iterations
            )
        }
        (None, None) => report.method.clone(),
    }
}

fn refinement(report: &FitReport) -> String {
    let rounds = match report.refinements {
        0 => "none".to_owned(),
        1 => "1 round".into(),
        rounds => format!("{rounds} rounds"),
    };
    let end = report.refinement_end.map(|end| match end {
        RefinementEnd::Tolerance => "the tolerance is met",
        RefinementEnd::Off => "not asked for",
        RefinementEnd::Fixed => "this method does not refine",
        RefinementEnd::MaxSources => "ended by --max-sources",
        RefinementEnd::MaxSourceRatio => "ended by --max-s-ratio",
        RefinementEnd::Memory => "ended by --memory",
        RefinementEnd::InVain => "more sources did not help",
        RefinementEnd::NoRoom => "no room for more sources",
        RefinementEnd::Concluded => "ended by --time-limit",
    });
    end.map_or(rounds.clone(), |end| format!("{rounds}, {end}"))
}

fn free_sources(moved: FreeSourcesReport) -> String {
    let rounds = match moved.rounds {
        1 => "1 round".to_owned(),
        rounds => format!("{rounds} rounds"),
    };
    let end = match moved.end {
        FreeSourcesEnd::Converged => "",
        FreeSourcesEnd::Rounds => ", the most that are made",
        FreeSourcesEnd::Concluded => ", ended by --time-limit",
    };
    let kept = match moved.kept {
        true => "",
        false => "; not used, since the boundary error rose",
    };
    format!(
        "{rounds}{end}, residual {:.2e} to {:.2e}{kept}",
        moved.residual_before, moved.residual_after
    )
}

fn summary(report: &FitSummary) -> String {
    let mut rows = fit_rows(&report.fit);
    rows.extend(
        report
            .fit
            .free_sources
            .map(|moved| ["free sources".into(), free_sources(moved)]),
    );
    rows.push([
        "tolerance".into(),
        format!(
            "{:.1e}, {}",
            report.tolerance,
            if report.tolerance_met { "met" } else { "missed" }
        ),
    ]);
    if let Some(seconds) = report.fit.seconds {
        rows.push([
            "time".into(),
            format!("{:.2} s, of which factoring {:.2} s", seconds.total, seconds.factor),
        ]);
    }
    rows.extend(report.bijective.as_ref().map_or(vec![], bijective::rows));
    rows.push(memory_row(report.peak_rss_bytes));
    rows.push(["map".into(), report.map.display().to_string()]);
    two_columns(rows)
}

/// What most likely helps when the tolerance was missed.
fn advice(fit: &FitReport) -> &'static str {
    let is_adaptive = matches!(fit.placement, Placement::Adaptive { .. });
    match fit.refinement_end {
        Some(RefinementEnd::MaxSources) => "Raise --max-sources, or the tolerance",
        Some(RefinementEnd::MaxSourceRatio) => {
            "More sources helped little: --vtu shows where the boundary map jumps, folds, or is too coarse. Or raise \
             --max-s-ratio, or the tolerance"
        }
        Some(RefinementEnd::Concluded) => "Raise --time-limit, or the tolerance",
        _ if fit.free_sources.is_some() => {
            "Raise --max-sources, or leave out --free-sources: sources are then added where the error is large"
        }
        Some(RefinementEnd::Memory) => "Raise --memory, or the tolerance",
        Some(RefinementEnd::Off) => "Leave out --no-refine: sources are then added where the error is large",
        Some(RefinementEnd::Fixed) if is_adaptive => "Use --method schwarz: it adds sources where the error is large",
        Some(RefinementEnd::Fixed) => "Use the adaptive placement: it adds sources where the error is large",
        Some(RefinementEnd::NoRoom) => {
            "There is no room for finer sources outside the domain where the error is large (see --vtu): widen the \
             gaps there"
        }
        Some(RefinementEnd::InVain | RefinementEnd::Tolerance) | None => {
            "More sources did not help: --vtu shows where the boundary map jumps, folds, or is too coarse"
        }
    }
}
