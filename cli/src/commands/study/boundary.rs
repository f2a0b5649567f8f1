//! The study of several boundary maps of one domain (figure 3): how harmonic their maps are, and where they are not.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::outward;
use solidmap::energy::{EnergyOptions, densities};
use solidmap::files::Provenance;
use solidmap::fit::FitOptions;
use solidmap::geometry::PlaneSection;
use solidmap::io;
use solidmap::mesh::SurfaceMesh;
use solidmap::statistics::quantiles;

use super::measured::Measured;
use super::page::StudyPage;
use super::results::{Row, Rows, Varied, hashes, measured_fit, provenances};
use super::summary::WrittenFiles;
use super::sweep::require_writable;
use super::table::StudyTable;
use crate::CommandOutcome;
use crate::args::StudyBoundaryArgs;
use crate::drawing::{Align, Figure, Scale, Table, ValueRange, significant};
use crate::shared::boundary_map::self_intersections;
use crate::shared::fitting::fit_options;
use crate::shared::input::{self, BoundarySource};
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns, write_file};
use crate::shared::page;
use crate::shared::pictures::{largest_section, panels_with_one_bar};
use crate::shared::places::percent;
use crate::shared::report_page::ReportPicture;

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 420;
/// With more maps than this, each has a row of its own.
const IN_A_ROW: usize = 4;
/// Densities whose percentiles span more than this factor have a logarithmic colour scale.
const WIDE: f64 = 20.0;
/// The columns of what is varied.
const COLUMNS: [&str; 1] = ["map"];
/// Domains are the same solid if their boxes and volumes differ by no more than this, relative to their size.
const SAME: f64 = 1e-6;

/// What `study boundary --json` prints.
#[derive(Serialize)]
struct BoundaryStudySummary {
    study: &'static str,
    domain: Option<FileName>,
    #[serde(flatten)]
    written: WrittenFiles,
    vertices: usize,
    tolerance: f64,
    rows: Vec<Row<MapName>>,
    reused: usize,
    failed: usize,
    /// Rows that miss the tolerance.
    missed: usize,
    least_harmonic_energy: Option<FileName>,
    least_deformation_energy: Option<FileName>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

#[derive(Debug, Serialize)]
struct MapName {
    map: FileName,
}

/// A boundary map, and where it comes from.
struct Studied {
    source: BoundarySource,
    boundary: BoundaryMap,
    files: Vec<Provenance>,
}

impl Studied {
    fn name(&self) -> String {
        file_part(self.source.image())
    }
}

/// Harmonic and deformation energy densities on the section.
struct SectionDensities {
    name: String,
    harmonic: Vec<f64>,
    deformation: Vec<f64>,
}

/// Fits every map, and measures and pictures them alike.
pub fn run(args: &StudyBoundaryArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    args.section.require_valid()?;
    let energy = EnergyOptions {
        lame: args.lame.constants()?,
        ..EnergyOptions::default()
    };
    let options = fit_options(&args.method, args.tolerance)?;
    let sources: Vec<BoundarySource> = args
        .maps
        .iter()
        .map(|map| source(map, args))
        .collect::<anyhow::Result<_>>()?;
    let inputs: Vec<&Path> = sources.iter().flat_map(BoundarySource::files).collect();
    require_writable(&args.outputs, &inputs)?;
    let table = StudyTable::open(args.outputs.output.as_deref(), &COLUMNS)?;
    let maps: Vec<Studied> = sources
        .into_iter()
        .map(|source| read(source, output))
        .collect::<anyhow::Result<_>>()?;
    let first = &maps[0];
    for other in &maps[1..] {
        ensure!(
            is_same_solid(first.boundary.domain(), other.boundary.domain()),
            "`{}` is a map of another domain than `{}`, so that they cannot be compared",
            other.source.image().display(),
            first.source.image().display()
        );
    }
    let domain = first.boundary.domain();
    let warning = self_intersections(domain, first.source.domain(), output);
    warning.iter().for_each(|warning| output.warn_of_fit(warning));
    let is_pictured = args.outputs.png.is_some() || args.outputs.html.is_some();
    let section = is_pictured.then(|| largest_section(&args.section, domain, SECTION_PIXELS));
    let section = section.transpose()?;

    let settings = settings_in_common(args, &options);
    let mut rows = Rows::new("boundary", &settings, table, output);
    let mut pictured = Vec::new();
    let count = maps.len();
    let measured = maps.iter().enumerate().map(|(k, studied)| {
        let varied = Varied {
            setting: MapName {
                map: studied.source.image().into(),
            },
            cells: vec![studied.name()],
            label: studied.name(),
            inputs: hashes(&studied.files),
        };
        let what = format!("{} of {count}, {}", k + 1, studied.name());
        let boundary = &studied.boundary;
        rows.row(varied, !is_pictured, || {
            let accuracy = args.accuracy.options();
            let (fit, measured) = measured_fit(boundary, &options, (&energy, &accuracy), &what, output)?;
            if let Some(section) = &section {
                let volumes = [fit.boundary.domain().volume(), boundary.target_volume()];
                let found = densities(&fit.map, section.points(), volumes[0], volumes[1], &energy)?;
                pictured.push(SectionDensities {
                    name: studied.name(),
                    harmonic: found.harmonic,
                    deformation: found.deformation,
                });
            }
            Ok((measured.with_distortion_of(boundary), fit.report.warnings))
        })
    });
    let measured: Vec<Row<MapName>> = measured.collect::<anyhow::Result<_>>()?;

    if let Some(section) = section.filter(|_| !pictured.is_empty()) {
        output.progress("drawing");
        let title = format!("Maps of {}", file_part(first.source.domain()));
        let png = figure(args, &section, &pictured)?.titled(&title).to_png()?;
        if let Some(path) = &args.outputs.png {
            write_file(path, &png)?;
        }
        if let Some(path) = &args.outputs.html {
            let mut files: Vec<Provenance> = Vec::new();
            for file in maps.iter().flat_map(|studied| &studied.files) {
                if !files.contains(file) {
                    files.push(file.clone());
                }
            }
            let page = StudyPage {
                title,
                picture: ReportPicture {
                    png: &png,
                    alternative: "Harmonic and deformation energy densities of all maps on one cross-section, in one colour \
                                  scale for each; the table below has the totals",
                },
                files,
                notes: vec![],
            };
            let rows = measured
                .iter()
                .zip(&maps)
                .map(|(row, studied)| (vec![studied.name()], row));
            page::write(path, &page.html(&COLUMNS, rows)?)?;
        }
    }
    BoundaryStudySummary::new(args, domain.vertices().len(), measured).finish(start, output)
}

/// Files that are not meshes are boundary files, which hold their domain.
fn source(map: &Path, args: &StudyBoundaryArgs) -> anyhow::Result<BoundarySource> {
    if !io::is_mesh(map) && !input::is_node_images(map) {
        return Ok(BoundarySource::File {
            file: map.to_owned(),
            domain: args.domain.clone(),
        });
    }
    let domain = args.domain.clone().with_context(|| {
        format!(
            "`{}` is an image, not a boundary file: name the domain that it is of by --domain",
            map.display()
        )
    })?;
    Ok(BoundarySource::Image {
        domain,
        image: map.to_owned(),
    })
}

fn read(source: BoundarySource, output: &Output) -> anyhow::Result<Studied> {
    output.progress(format!("reading {}", source.image().display()));
    let boundary = outward(source.read()?).with_context(|| format!("cannot map `{}`", source.domain().display()))?;
    input::require_solvable(boundary.domain(), source.domain())?;
    let files = provenances(&source.files_by_role())?;
    Ok(Studied {
        source,
        boundary,
        files,
    })
}

/// Whether two surfaces bound the same solid, as far as their boxes and volumes say; their meshes may differ.
fn is_same_solid(a: &SurfaceMesh, b: &SurfaceMesh) -> bool {
    let size = a.diagonal();
    let ends = |surface: &SurfaceMesh| surface.bounding_box().unwrap_or_default();
    let ((low_a, high_a), (low_b, high_b)) = (ends(a), ends(b));
    (low_a - low_b).norm() <= SAME * size
        && (high_a - high_b).norm() <= SAME * size
        && (a.volume() - b.volume()).abs() <= SAME * a.volume().abs()
}

/// What all rows of a table have in common, besides the files. The limit on memory is left out: it changes no result but that
/// of a refinement that it ends.
fn settings_in_common(args: &StudyBoundaryArgs, options: &FitOptions) -> String {
    let lame = args
        .lame
        .constants()
        .map(|lame| [lame.lambda, lame.mu])
        .unwrap_or_default();
    let options = FitOptions {
        memory: None,
        ..options.clone()
    };
    let FitOptions {
        method,
        source_ratio,
        collocation_ratio,
        max_sources,
        max_source_ratio,
        affine,
        tolerance,
        max_error_ratio,
        max_local_error,
        refine,
        free_sources,
        memory: _,
        held_out,
        seed,
    } = options;
    let energies = args.accuracy.options();
    // Rows of tables that were made before there were free sources stay as they are.
    let free_sources = if free_sources { " free-sources" } else { "" };
    format!(
        "{method:?} s-ratio={source_ratio} c-ratio={collocation_ratio} max-sources={max_sources} \
         max-s-ratio={max_source_ratio} affine={affine} tolerance={tolerance} max-error={max_error_ratio} \
         max-local-error={max_local_error} refine={refine}{free_sources} held-out={held_out} \
         seed={seed} \
         resolution={:?} energy-tolerance={} lame={lame:?}",
        energies.resolution, energies.tolerance
    )
}

/// The densities of all maps, in one colour scale for each of the two.
fn figure(args: &StudyBoundaryArgs, section: &PlaneSection, maps: &[SectionDensities]) -> anyhow::Result<Figure> {
    let panels = |label: &str, of: fn(&SectionDensities) -> &Vec<f64>| {
        let fields: Vec<(String, Vec<f64>)> = maps.iter().map(|map| (map.name.clone(), of(map).clone())).collect();
        let all: Vec<f64> = fields.iter().flat_map(|(_, values)| values.iter().copied()).collect();
        let [low, high] = quantiles(&all, [0.01, 0.99]).unwrap_or([0.0; 2]);
        // A few points at creases have densities far above all others; the colour bar says that it clamps them.
        let (range, scale) = if low > 0.0 && high > WIDE * low {
            (ValueRange::Quantiles(0.01, 0.99), Scale::Log)
        } else {
            (ValueRange::Quantiles(0.0, 0.99), Scale::Linear)
        };
        panels_with_one_bar((section, &args.section), &fields, label, range, scale)
    };
    let harmonic = panels("harmonic energy density", |map| &map.harmonic)?;
    let deformation = panels("deformation energy density", |map| &map.deformation)?;
    let rows = if maps.len() > IN_A_ROW {
        let pairs = harmonic.into_iter().zip(deformation);
        pairs.map(|(first, second)| vec![first, second]).collect()
    } else {
        vec![harmonic, deformation]
    };
    Ok(Figure::grid(rows))
}

impl BoundaryStudySummary {
    fn new(args: &StudyBoundaryArgs, vertices: usize, rows: Vec<Row<MapName>>) -> Self {
        let least = |of: fn(&Measured) -> f64| {
            let found = rows
                .iter()
                .filter_map(|row| Some((&row.setting.map, of(row.found.as_ref()?))));
            found.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(map, _)| map.clone())
        };
        let misses = |row: &&Row<MapName>| {
            let found = row.found.as_ref();
            found.is_some_and(|m| m.boundary_error.p99 > args.tolerance)
        };
        Self {
            study: "boundary",
            domain: file_name(args.domain.as_ref()),
            written: WrittenFiles::new(&args.outputs),
            vertices,
            tolerance: args.tolerance,
            reused: rows.iter().filter(|row| row.reused).count(),
            failed: rows.iter().filter(|row| row.error.is_some()).count(),
            missed: rows.iter().filter(misses).count(),
            least_harmonic_energy: least(|m| m.harmonic_energy),
            least_deformation_energy: least(|m| m.deformation_energy),
            rows,
            seconds: 0.0,
            peak_rss_bytes: 0,
        }
    }

    fn finish(mut self, start: Instant, output: &Output) -> anyhow::Result<CommandOutcome> {
        self.seconds = start.elapsed().as_secs_f64();
        self.peak_rss_bytes = peak_rss_bytes();
        if self.missed > 0 {
            output.warn(format!(
                "{} of {} maps miss the tolerance of {} on 99 % of the boundary; their energies are those of the best maps \
                 that were found",
                self.missed,
                self.rows.len(),
                self.tolerance
            ));
        }
        output.result(&self, || format!("{}\n{}", self.table(), two_columns(self.lines())))?;
        Ok(CommandOutcome::from_check(self.failed == 0 && self.missed == 0))
    }

    fn table(&self) -> Table<9> {
        let right = |name, unit| (name, unit, Align::Right);
        let mut table = Table::new([
            ("map", "", Align::Left),
            right("angles", "median σ₁/σ₂"),
            right("sym. Dirichlet", "mean"),
            right("sources", ""),
            right("boundary error", "99 %"),
            right("harmonic", "energy"),
            right("deformation", "energy"),
            right("folded", ""),
            right("time", "s"),
        ]);
        for row in &self.rows {
            let optional = |value: Option<f64>| value.map_or(String::new(), |value| significant(value, 4));
            let measured = row.found.as_ref().map(|m| {
                [
                    optional(m.surface_angle),
                    optional(m.surface_dirichlet),
                    m.sources.to_string(),
                    format!("{:.2e}", m.boundary_error.p99),
                    significant(m.harmonic_energy, 5),
                    significant(m.deformation_energy, 4),
                    percent(m.folded_fraction),
                    format!("{:.1}", m.seconds),
                ]
            });
            let [a, b, c, d, e, f, g, h] = measured.unwrap_or_else(|| {
                let mut cells: [String; 8] = Default::default();
                cells[0] = "failed".into();
                cells
            });
            table.row([file_part(&row.setting.map), a, b, c, d, e, f, g, h]);
        }
        table
    }

    fn lines(&self) -> Vec<[String; 2]> {
        let mut lines = Vec::new();
        if self.rows.len() > 1 {
            let least = [
                ("least harmonic energy", &self.least_harmonic_energy),
                ("least deformation energy", &self.least_deformation_energy),
            ];
            let named = least.iter().filter_map(|(what, map)| {
                let map = map.as_ref()?;
                Some([(*what).to_owned(), file_part(map)])
            });
            lines.extend(named);
        }
        lines.push(["time".into(), format!("{:.1} s", self.seconds)]);
        lines.push(memory_row(self.peak_rss_bytes));
        lines.extend(self.written.lines());
        lines
    }
}

/// The name of a file without its folder.
fn file_part(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}
