//! The studies of placements (figure 5 a to c) and of ratios (figure 5 d).

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, ensure};
use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::outward;
use solidmap::energy::{AdaptiveOptions, EnergyOptions, GridResolution};
use solidmap::fit::{FitMethod, FitOptions};
use solidmap::solver::{Decomposition, DenseOptions};

use super::charts;
use super::measured::Measured;
use super::page::StudyPage;
use super::results::{Row, Rows, Varied, hashes, measured_fit, provenances};
use super::setting::{Setting, grid};
use super::summary::SweepSummary;
use super::table::StudyTable;
use crate::CommandOutcome;
use crate::args::{
    DecompositionKind, PlacementKind, StudyOutputs, StudyPlacementArgs, StudyRatiosArgs, StudySource, StudySystemArgs,
};
use crate::shared::input::{self, BoundarySource};
use crate::shared::output::{Output, write_file};
use crate::shared::page;
use crate::shared::report_page::ReportPicture;

/// Most points that energies are integrated with: where a map is wild between its sources, they are not worth minutes.
const MOST_POINTS: usize = 100_000;

/// What is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SweepKind {
    Placement,
    Ratios,
}

impl SweepKind {
    /// The name of the subcommand.
    pub fn name(self) -> &'static str {
        match self {
            Self::Placement => "placement",
            Self::Ratios => "ratios",
        }
    }
}

/// A study that varies settings of the method.
struct Sweep<'a> {
    kind: SweepKind,
    source: &'a StudySource,
    settings: Vec<Setting>,
    system: &'a StudySystemArgs,
    outputs: &'a StudyOutputs,
}

/// Errors, energies and conditioning over the place of the sources.
pub fn placement(args: &StudyPlacementArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let parameters = |kind: &PlacementKind| match kind {
        PlacementKind::Sphere => args.radius.as_slice(),
        PlacementKind::Offset => &args.offset,
        PlacementKind::Adaptive => &args.alpha,
    };
    let placements: Vec<_> = args.placements.iter().map(|kind| (*kind, parameters(kind))).collect();
    let sweep = Sweep {
        kind: SweepKind::Placement,
        source: &args.source,
        settings: grid(&placements, &args.s_ratio, &[args.c_ratio]),
        system: &args.system,
        outputs: &args.outputs,
    };
    sweep.run(output)
}

/// Errors, energies and conditioning over the numbers of sources and collocation points.
pub fn ratios(args: &StudyRatiosArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let (placement, parameter) = args.place.chosen(args.placement, PlacementKind::Offset)?;
    let sweep = Sweep {
        kind: SweepKind::Ratios,
        source: &args.source,
        settings: grid(&[(placement, &[parameter])], &args.s_ratio, &args.c_ratio),
        system: &args.system,
        outputs: &args.outputs,
    };
    sweep.run(output)
}

impl Sweep<'_> {
    fn run(&self, output: &Output) -> anyhow::Result<CommandOutcome> {
        let start = Instant::now();
        require_valid(self.system)?;
        let source = self.source.source();
        let source = source.context("name a DOMAIN with its IMAGE, or a --boundary")?;
        require_writable(self.outputs, &source.files())?;
        let table = StudyTable::open(self.outputs.output.as_deref(), &Setting::COLUMNS)?;
        output.progress("reading");
        let boundary =
            outward(source.read()?).with_context(|| format!("cannot map `{}`", source.domain().display()))?;
        input::require_solvable(boundary.domain(), source.domain())?;
        let files = provenances(&source.files_by_role())?;

        let mut rows = Rows::new(self.kind.name(), &settings_in_common(self.system), table, output);
        let count = self.settings.len();
        let measured = self.settings.iter().enumerate().map(|(k, setting)| {
            let varied = Varied {
                setting: *setting,
                cells: setting.cells().to_vec(),
                label: setting.label(),
                inputs: hashes(&files),
            };
            let what = format!("{} of {count}, {}", k + 1, setting.label());
            rows.row(varied, true, || measure(setting, self.system, &boundary, &what, output))
        });
        let measured: Vec<Row<Setting>> = measured.collect::<anyhow::Result<_>>()?;

        let title = title(self.kind, &source);
        let needs_picture = self.outputs.png.is_some() || self.outputs.html.is_some();
        if needs_picture {
            output.progress("drawing");
            let png = charts::figure(self.kind, &measured)?.titled(&title).to_png()?;
            if let Some(path) = &self.outputs.png {
                write_file(path, &png)?;
            }
            if let Some(path) = &self.outputs.html {
                let page = StudyPage {
                    title: title.clone(),
                    picture: ReportPicture {
                        png: &png,
                        alternative: charts::in_words(self.kind),
                    },
                    files,
                    notes: self.notes(&boundary),
                };
                let rows = measured.iter().map(|row| (row.setting.cells().to_vec(), row));
                page::write(path, &page.html(&Setting::COLUMNS, rows)?)?;
            }
        }
        let vertices = boundary.domain().vertices().len();
        SweepSummary::new(
            self.kind,
            &source,
            self.outputs,
            (vertices, self.points(vertices)),
            measured,
        )
        .finish(start, output)
    }

    fn points(&self, vertices: usize) -> usize {
        self.system.points.min(vertices)
    }

    /// What readers of a page must know.
    fn notes(&self, boundary: &BoundaryMap) -> Vec<String> {
        let vertices = boundary.domain().vertices().len();
        let points = self.points(vertices);
        let all = if points < vertices {
            format!("{points} of the domain's {vertices} vertices, evenly chosen")
        } else {
            format!("all {vertices} vertices of the domain")
        };
        vec![
            format!("Ratios are numbers of sources (s_ratio) and of collocation points (c_ratio) per boundary point: {all}."),
            "C-Error and residual are what the solver makes small, at the points where equations are posed. The boundary \
             error is measured at other points, and bounds the error inside."
                .into(),
        ]
    }
}

fn require_valid(system: &StudySystemArgs) -> anyhow::Result<()> {
    ensure!(system.points > 0, "--points is 0, but must be at least 1");
    ensure!(
        (1..=1000).contains(&system.resolution),
        "--resolution is {}, but must be from 1 to 1000",
        system.resolution
    );
    ensure!(
        (0.0..1.0).contains(&system.truncation),
        "--truncation is {}, but must be from 0 to below 1 (1e-10 is usual)",
        system.truncation
    );
    ensure!(
        (1..=10_000_000).contains(&system.held_out),
        "--held-out is {}, but must be from 1 to 10 million",
        system.held_out
    );
    Ok(())
}

/// Refuses outputs that cannot be written, before any work.
pub fn require_writable(outputs: &StudyOutputs, inputs: &[&Path]) -> anyhow::Result<()> {
    input::require_all_writable(
        &[
            (outputs.output.as_ref(), &["csv"]),
            (outputs.png.as_ref(), &["png"]),
            (outputs.html.as_ref(), &page::EXTENSIONS),
        ],
        inputs,
    )
}

/// What all rows of a table have in common, besides the files. Limits are left out: they change no result.
fn settings_in_common(system: &StudySystemArgs) -> String {
    let method = match system.method {
        DecompositionKind::Dense => "dense",
        DecompositionKind::Svd => "svd",
    };
    let affine = if system.no_affine { "no-affine" } else { "affine" };
    format!(
        "{method} truncation={:e} {affine} points={} held-out={} seed={} resolution={}",
        system.truncation, system.points, system.held_out, system.seed, system.resolution
    )
}

/// Fits and measures the map of a setting.
fn measure(
    setting: &Setting,
    system: &StudySystemArgs,
    boundary: &BoundaryMap,
    what: &str,
    output: &Output,
) -> anyhow::Result<(Measured, Vec<String>)> {
    let options = fit_options(setting, system, boundary.domain().vertices().len())?;
    let accuracy = AdaptiveOptions {
        resolution: GridResolution::CellsAlongLongestSide(system.resolution),
        max_points: Some(MOST_POINTS),
        ..AdaptiveOptions::default()
    };
    let (fit, measured) = measured_fit(boundary, &options, (&EnergyOptions::default(), &accuracy), what, output)?;
    Ok((measured, fit.report.warnings))
}

/// The library's options. Its ratios are of all vertices, those of the setting of the boundary points.
fn fit_options(setting: &Setting, system: &StudySystemArgs, vertices: usize) -> anyhow::Result<FitOptions> {
    let Setting { s_ratio, c_ratio, .. } = *setting;
    ensure!(
        s_ratio > 0.0 && s_ratio.is_finite() && c_ratio.is_finite(),
        "the ratios of sources and collocation points must be positive numbers"
    );
    let points = system.points.min(vertices) as f64;
    let (sources, collocation) = (s_ratio * points, c_ratio * points);
    ensure!(
        sources <= system.max_sources as f64,
        "it asks for {sources:.0} sources, and {} are allowed; lower --points, or raise --max-sources (time grows with the \
         cube of the sources)",
        system.max_sources
    );
    ensure!(
        c_ratio >= s_ratio,
        "{collocation:.0} collocation points cannot determine {sources:.0} sources; c-ratio must be larger than s-ratio"
    );
    let decomposition = match system.method {
        DecompositionKind::Dense => Decomposition::Qr,
        DecompositionKind::Svd => Decomposition::Svd,
    };
    let of_all = points / vertices as f64;
    Ok(FitOptions {
        method: FitMethod::Dense {
            placement: setting.library_placement(),
            options: DenseOptions {
                decomposition,
                truncation: system.truncation,
            },
        },
        source_ratio: s_ratio * of_all,
        collocation_ratio: c_ratio * of_all,
        // Checked above, since fewer sources would be another setting.
        max_sources: usize::MAX,
        affine: !system.no_affine,
        refine: false,
        memory: system.memory,
        held_out: system.held_out,
        seed: system.seed,
        ..FitOptions::paper()
    })
}

fn title(kind: SweepKind, source: &BoundarySource) -> String {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let files: Vec<String> = source.files().into_iter().map(name).collect();
    let what = match kind {
        SweepKind::Placement => "place of the sources",
        SweepKind::Ratios => "numbers of sources and collocation points",
    };
    format!("{}: {what}", files.join(" → "))
}
