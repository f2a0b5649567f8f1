//! `solidmap fit`

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, MapFile, MapMetadata, Provenance};
use solidmap::fit::{Fit, FitMethod, FitOptions, FitReport, Phase, Placement, RefinementEnd, fit};
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::solver::{Decomposition, DenseOptions, SchwarzOptions, SchwarzStop};
use solidmap::spherical::SphereOptions;

use super::args::{FitArgs, MethodArgs, MethodKind, PairArgs, PlacementKind};
use super::boundary::{pair, sphere};
use super::output::{Output, pairs, peak_rss_bytes};
use super::{Outcome, input};

/// What `fit --json` prints.
#[derive(Serialize)]
struct Report {
    domain: Option<PathBuf>,
    image: Option<PathBuf>,
    boundary_file: Option<PathBuf>,
    target: Option<PathBuf>,
    map: PathBuf,
    #[serde(flatten)]
    fit: FitReport,
    tolerance: f64,
    tolerance_met: bool,
    peak_rss_bytes: u64,
}

/// Where the boundary map comes from.
enum Source<'a> {
    Image {
        domain: &'a Path,
        image: &'a Path,
    },
    Boundary {
        file: &'a Path,
        domain: Option<&'a Path>,
    },
    Sphere {
        domain: &'a Path,
    },
    Target {
        domain: &'a Path,
        target: &'a Path,
        pair: &'a PairArgs,
    },
}

/// What `--target` calls the unit sphere.
const SPHERE: &str = "sphere";

impl<'a> Source<'a> {
    fn of(args: &'a FitArgs) -> anyhow::Result<Self> {
        let domain = args.domain.as_deref();
        let target = args.target.as_deref();
        let onto_model = target.is_some_and(|target| target != Path::new(SPHERE));
        anyhow::ensure!(
            onto_model || args.pair.is_default(),
            "--landmarks, --via and --no-improve say how a solid is mapped to another: they need --target MODEL"
        );
        match (domain, args.image.as_deref(), args.boundary.as_deref(), target) {
            (_, None, Some(file), None) => Ok(Self::Boundary { file, domain }),
            (Some(domain), Some(image), None, None) => Ok(Self::Image { domain, image }),
            (Some(domain), None, None, Some(target)) if target == Path::new(SPHERE) => Ok(Self::Sphere { domain }),
            (Some(domain), None, None, Some(target)) => {
                let pair = &args.pair;
                Ok(Self::Target { domain, target, pair })
            }
            _ => anyhow::bail!("name a DOMAIN with its --image or --target, or a --boundary"),
        }
    }

    /// What is read, by role.
    fn files(&self) -> Vec<(&'static str, &'a Path)> {
        match *self {
            Self::Image { domain, image } => vec![("domain", domain), ("image", image)],
            Self::Boundary { file, domain } => {
                let domain = domain.map(|domain| ("domain", domain));
                domain.into_iter().chain([("boundary", file)]).collect()
            }
            Self::Sphere { domain } => vec![("domain", domain)],
            Self::Target { domain, target, pair } => {
                let landmarks = pair.landmarks.iter().map(|file| ("landmarks", file.as_path()));
                [("domain", domain), ("target", target)]
                    .into_iter()
                    .chain(landmarks)
                    .collect()
            }
        }
    }

    /// What to call the domain.
    fn name(&self) -> &'a Path {
        self.files()[0].1
    }

    /// Reads the boundary map, or makes it.
    fn boundary_map(&self, output: &Output) -> anyhow::Result<BoundaryMap> {
        match *self {
            Self::Image { domain, image } => input::read_boundary_map(domain, image),
            Self::Boundary { file, domain } => input::read_boundary_file(file, domain),
            Self::Sphere { domain } => onto_sphere(domain, output),
            Self::Target { domain, target, pair } => onto_model(domain, target, pair, output),
        }
    }
}

/// The map of a solid's boundary to the unit sphere.
fn onto_sphere(domain: &Path, output: &Output) -> anyhow::Result<BoundaryMap> {
    let surface = input::read_surface(domain)?;
    let (map, _) = sphere::map_with_progress(&surface, domain, &SphereOptions::default(), output)?;
    BoundaryMap::onto_sphere(map).with_context(|| format!("cannot map `{}` to the sphere", domain.display()))
}

/// The map of a solid's boundary to another's.
fn onto_model(domain: &Path, target: &Path, args: &PairArgs, output: &Output) -> anyhow::Result<BoundaryMap> {
    let surface = input::read_surface(domain)?;
    let (map, report) = pair::map_to(&surface, [domain, target], args, output)?;
    output.note(format_args!(
        "boundary map in {:.1} s: one to one; symmetric Dirichlet energy {:.2} at the median and {:.3e} at most, 4 of an \
         isometry. See `solidmap boundary pair`",
        report.timings.total, report.after.symmetric_dirichlet.p50, report.after.symmetric_dirichlet.max
    ));
    Ok(map)
}

/// Fits a map and writes it.
pub fn run(args: &FitArgs, output: &Output) -> anyhow::Result<Outcome> {
    let source = Source::of(args)?;
    let mut files: Vec<&Path> = source.files().iter().map(|(_, path)| *path).collect();
    input::require_writable(&args.output, &[], &files)?;
    if let Some(path) = &args.vtu {
        files.push(&args.output);
        input::require_writable(path, &["vtu"], &files)?;
    }
    output.progress("reading");
    let options = options(&args.method, args.tolerance)?;
    let boundary = source.boundary_map(output)?;
    let files = source.files();
    let inputs: anyhow::Result<Vec<Provenance>> = files.iter().map(|(role, path)| provenance(role, path)).collect();
    let inputs = inputs?;
    let name = source.name();
    output.progress("looking for self-intersections");
    let intersections = self_intersections(&boundary, name);
    let mut fit =
        fit_with_progress(&boundary, &options, output).with_context(|| format!("cannot map `{}`", name.display()))?;
    fit.report.warnings.extend(intersections);
    fit.report.warnings.iter().for_each(|warning| output.warn(warning));

    output.progress("writing");
    let metadata = MapMetadata::new(fit.report.clone(), inputs);
    let file = MapFile {
        map: fit.map,
        boundary: Some(fit.boundary),
        metadata,
    };
    files::write_map(&args.output, &file)?;
    if let (Some(path), Some(boundary)) = (&args.vtu, &file.boundary) {
        write_boundary(path, boundary, &file.map)?;
    }

    let tolerance_met = fit.report.boundary_error.p99 <= args.tolerance;
    let report = Report {
        domain: args.domain.clone(),
        image: args.image.clone(),
        boundary_file: args.boundary.clone(),
        target: args.target.clone(),
        map: args.output.clone(),
        fit: fit.report,
        tolerance: args.tolerance,
        tolerance_met,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    if tolerance_met {
        return Ok(Outcome::Done);
    }
    output.warn(format!(
        "99 % of the boundary is met only to {:.1e} of the target's diagonal, and the tolerance is {:.1e}; the map was \
         written all the same. {}",
        report.fit.boundary_error.p99,
        args.tolerance,
        advice(&report.fit)
    ));
    Ok(Outcome::CheckFailed)
}

/// Fits with the phases shown.
pub fn fit_with_progress(boundary: &BoundaryMap, options: &FitOptions, output: &Output) -> anyhow::Result<Fit> {
    Ok(fit(boundary, options, &|phase| show(phase, "", output))?)
}

/// Shows a phase of a fit, after a word on what is fitted.
pub fn show(phase: Phase, what: &str, output: &Output) {
    let step = match phase {
        Phase::Checking => "checking".into(),
        Phase::Sampling => "placing sources".into(),
        Phase::Decomposing { rows, columns } => format!("decomposing a {rows} × {columns} matrix"),
        Phase::Factoring { done, of } => {
            return output.progress_of(format!("{what}factoring local problems"), done, of);
        }
        Phase::Solving => "solving".into(),
        Phase::Iterating { iteration, residual } => format!("iteration {iteration}: residual {residual:.1e}"),
        Phase::Measuring => "measuring the boundary error".into(),
        Phase::Refining { round, error, sources } => {
            format!("refinement {round}: error {error:.1e}, {sources} sources")
        }
    };
    output.progress(format!("{what}{step}"));
}

/// The lines of the summary that say how good a fit is.
fn fit_rows(report: &FitReport) -> Vec<[String; 2]> {
    let error = report.boundary_error;
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
        0 => "none".into(),
        1 => "1 round".into(),
        rounds => format!("{rounds} rounds"),
    };
    let end = report.refinement_end.map(|end| match end {
        RefinementEnd::Tolerance => "the tolerance is met",
        RefinementEnd::Off => "not asked for",
        RefinementEnd::Fixed => "this method has none",
        RefinementEnd::MaxSources => "ended by --max-sources",
        RefinementEnd::Memory => "ended by --memory",
        RefinementEnd::InVain => "more sources did not help",
        RefinementEnd::NoRoom => "no room for more sources",
    });
    [rounds]
        .into_iter()
        .chain(end.map(Into::into))
        .collect::<Vec<_>>()
        .join(", ")
}

fn summary(report: &Report) -> String {
    let mut rows = fit_rows(&report.fit);
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
    rows.push([
        "memory".into(),
        format!("{:.0} MiB at most", report.peak_rss_bytes as f64 / 1048576.0),
    ]);
    rows.push(["map".into(), report.map.display().to_string()]);
    pairs(rows)
}

/// What most likely helps.
fn advice(fit: &FitReport) -> &'static str {
    let is_adaptive = matches!(fit.placement, Placement::Adaptive { .. });
    match fit.refinement_end {
        Some(RefinementEnd::MaxSources) => "Raise --max-sources, or the tolerance",
        Some(RefinementEnd::Memory) => "Raise --memory, or the tolerance",
        Some(RefinementEnd::Off) => "Leave out --no-refine: sources are then added where the error is large",
        Some(RefinementEnd::Fixed) if is_adaptive => "Use --method schwarz: it adds sources where the error is large",
        Some(RefinementEnd::Fixed) => "Use the adaptive placement: it adds sources where the error is large",
        Some(RefinementEnd::NoRoom) => {
            "No finer source finds a place outside the domain where the error is large (see --vtu): widen the gaps there"
        }
        Some(RefinementEnd::InVain | RefinementEnd::Tolerance) | None => {
            "More sources did not help: see with --vtu where the boundary map jumps, folds, or is too coarse"
        }
    }
}

/// What the options of the method ask for.
pub fn options(args: &MethodArgs, tolerance: f64) -> anyhow::Result<FitOptions> {
    let placement = args.placement.unwrap_or(match (args.offset, args.radius) {
        (Some(_), _) => PlacementKind::Offset,
        (None, Some(_)) => PlacementKind::Sphere,
        (None, None) if args.paper => PlacementKind::Offset,
        (None, None) => PlacementKind::Adaptive,
    });
    for (given, flag, kind) in [
        (args.alpha.is_some(), "--alpha", PlacementKind::Adaptive),
        (args.offset.is_some(), "--offset", PlacementKind::Offset),
        (args.radius.is_some(), "--radius", PlacementKind::Sphere),
    ] {
        anyhow::ensure!(
            !given || placement == kind,
            "{flag} has no meaning with the placement {placement:?}"
        );
    }
    // The paper's ratios belong to its placements; the overdetermined default to the adaptive one.
    let base = if args.paper || placement != PlacementKind::Adaptive {
        FitOptions::paper()
    } else {
        FitOptions::adaptive()
    };
    let placement = match placement {
        PlacementKind::Adaptive => Placement::Adaptive {
            alpha: args.alpha.unwrap_or(Placement::DEFAULT_ALPHA),
        },
        PlacementKind::Offset => Placement::Offset {
            distance: args.offset.unwrap_or(Placement::DEFAULT_DISTANCE),
        },
        PlacementKind::Sphere => Placement::Sphere {
            radius: args.radius.unwrap_or(Placement::DEFAULT_RADIUS),
        },
    };
    let kind = args.method.unwrap_or(match base.method {
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
            anyhow::ensure!(
                args.truncation.is_none(),
                "--truncation has a meaning with --method dense or svd only"
            );
            FitMethod::schwarz(placement, SchwarzOptions::default())?
        }
    };
    Ok(FitOptions {
        method,
        source_ratio: args.s_ratio.unwrap_or(base.source_ratio),
        collocation_ratio: args.c_ratio.unwrap_or(base.collocation_ratio),
        max_sources: args.max_sources.unwrap_or(method.default_max_sources()),
        affine: !args.no_affine,
        tolerance,
        refine: !args.no_refine,
        memory: args.memory,
        held_out: args.held_out,
        seed: args.seed,
    })
}

fn provenance(role: &str, path: &Path) -> anyhow::Result<Provenance> {
    Provenance::of(role, path).with_context(|| format!("cannot read `{}`", path.display()))
}

/// A remark when the domain intersects itself. The boundary can be fitted all the same, but there is no inside there.
#[cfg(feature = "native")]
fn self_intersections(boundary: &BoundaryMap, path: &Path) -> Option<String> {
    let shown = path.display();
    match solidmap::cgal_tetgen::self_intersections(boundary.domain()) {
        Ok(pairs) => pairs.first().map(|[a, b]| {
            format!(
                "`{shown}` intersects itself: {} pairs of triangles, the first {a} and {b}; the map is wrong there. See \
                 `solidmap check`",
                pairs.len()
            )
        }),
        Err(error) => Some(format!("self-intersections of `{shown}` could not be looked for: {error}")),
    }
}

#[cfg(not(feature = "native"))]
fn self_intersections(_: &BoundaryMap, _: &Path) -> Option<String> {
    None
}

/// The domain's surface with the image, the map's value and the error at each vertex.
fn write_boundary(path: &Path, boundary: &BoundaryMap, map: &HarmonicMap) -> anyhow::Result<()> {
    let domain = boundary.domain();
    let mapped = map.evaluate(domain.vertices());
    let errors = mapped.iter().zip(boundary.image()).map(|(f, exact)| (f - exact).norm());
    let vectors = |points: &[solidmap::Point]| points.iter().flat_map(|p| p.iter().copied()).collect();
    let fields = VtkFields {
        point: vec![
            Field {
                name: "image".into(),
                components: 3,
                values: vectors(boundary.image()),
            },
            Field {
                name: "mapped".into(),
                components: 3,
                values: vectors(&mapped),
            },
            Field {
                name: "error".into(),
                components: 1,
                values: errors.collect(),
            },
        ],
        ..VtkFields::default()
    };
    Ok(io::write_vtu(
        path,
        domain.vertices(),
        Cells::Triangles(domain.triangles()),
        &fields,
    )?)
}
