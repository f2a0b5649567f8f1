//! `solidmap sequence`: the deformation energy of frames, one factorisation for all.

mod folder;
mod series;

use std::cmp::Ordering;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::drawing::{Axis, Chart, ColourBar, Figure, Panel, Scale, Section, ValueRange, significant};
use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::check::{ClosedHole, MOST_RIM_EDGES};
use solidmap::energy::{DensityQuantiles, GridResolution, Lame};
use solidmap::fit::BoundaryError;
use solidmap::io;
use solidmap::mesh::SurfaceMesh;
use solidmap::sequence::{Cycles, MeasuredFrame, NoCycles, Sequence, SequenceError, SequenceOptions, cycles};

use super::args::{SectionArgs, SequenceArgs};
use super::eval::outside;
use super::output::{Output, pairs, peak_rss_bytes};
use super::transfer::Given;
use super::{Outcome, fit, input};

use folder::{CELLS, MATERIAL, ResultFolder, SURFACE};
use series::{Material, Series};

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 480;
/// Width and height of the chart.
const CHART: [usize; 2] = [1200, 640];
/// A frame of more than this times the reference's volume, or less than its part, may be in another unit.
const OTHER_UNIT: f64 = 4.0;
/// Frames that a message lists.
const LISTED: usize = 20;
/// What the density is of in pictures.
const DENSITY: &str = "deformation energy density";

/// What `sequence --json` prints.
#[derive(Serialize)]
struct Report {
    reference: PathBuf,
    output: PathBuf,
    material: Option<PathBuf>,
    vertices: usize,
    faces: usize,
    closed_holes: Vec<ClosedHole>,
    /// Volume of the reference.
    volume: f64,
    /// Points that energies are integrated at.
    points: usize,
    frames_per_block: usize,
    own_volume: bool,
    frames: Vec<FrameRow>,
    skipped: usize,
    tolerance: f64,
    tolerance_met: bool,
    cycles: Option<Cycles>,
    no_cycles: Option<String>,
    seconds: Seconds,
    peak_rss_bytes: u64,
}

#[derive(Serialize, Default)]
struct Seconds {
    total: f64,
    /// Reading and factoring the reference.
    setup: f64,
    /// Reading, solving and measuring the frames.
    frames: f64,
    /// Pictures and the series.
    drawing: f64,
}

/// A frame, in the order given.
#[derive(Serialize)]
struct FrameRow {
    frame: usize,
    time: f64,
    file: PathBuf,
    #[serde(flatten)]
    found: Option<Found>,
    /// Why it was skipped.
    skipped: Option<String>,
}

#[derive(Serialize)]
struct Found {
    deformation_energy: f64,
    harmonic_energy: f64,
    deformation_density: DensityQuantiles,
    boundary_error: BoundaryError,
    inverted_fraction: f64,
    volume: f64,
}

impl Found {
    fn of(measured: &MeasuredFrame) -> Self {
        Self {
            deformation_energy: measured.deformation,
            harmonic_energy: measured.harmonic,
            deformation_density: measured.deformation_density,
            boundary_error: measured.boundary_error,
            inverted_fraction: measured.inverted_fraction,
            volume: measured.volume,
        }
    }
}

/// Measures every frame, block by block, and writes what was found.
pub fn run(args: &SequenceArgs, output: &Output) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    require_valid(args)?;
    let inputs = std::iter::once(&args.reference)
        .chain(&args.frames)
        .chain(&args.material);
    let energies = if args.no_vtu { &[][..] } else { &[CELLS, SURFACE] };
    let material = if args.material.is_some() { &[MATERIAL][..] } else { &[] };
    let results = ResultFolder::new(&args.output, inputs, &[energies, material].concat(), args.frames.len())?;
    if let Some([before, after]) = misordered(&args.frames) {
        output.warn(format!(
            "frames are taken in the order given, and `{}` comes before `{}`; a shell sorts numbers by their digits: give them \
             leading zeros, or sort with `ls -v`",
            before.display(),
            after.display()
        ));
    }
    output.progress("reading the reference");
    let reference = input::read_surface(&args.reference)?;
    let options = options(args)?;
    let sequence = Sequence::new(&reference, &options, &|phase| fit::show(phase, "", output));
    let sequence = sequence.map_err(|error| advised(error, args))?;
    let material = args
        .material
        .as_deref()
        .map(|path| read_material(path, &sequence, output));
    let material = material.transpose()?;
    for hole in sequence.holes() {
        output.note(format_args!(
            "closed a hole of {} edges at vertex {} by triangles over its rim, in the reference and in all frames",
            hole.rim.len(),
            hole.rim[0]
        ));
    }
    let mut seconds = Seconds {
        setup: start.elapsed().as_secs_f64(),
        ..Seconds::default()
    };
    let mut run = Run::new(args, results.scratch(), sequence, material, output)?;
    let per_block = run.sequence.frames_per_block();
    for first in (0..args.frames.len()).step_by(per_block) {
        run.block(first..args.frames.len().min(first + per_block), &mut seconds)?;
    }
    ensure!(
        run.rows.iter().any(|row| row.found.is_some()),
        "none of the {} frames can be used; the first: {}",
        run.rows.len(),
        run.rows[0].skipped.as_deref().unwrap_or_default()
    );
    let drawing = Instant::now();
    let cycles = run.cycles();
    output.progress("drawing");
    run.write_csv()?;
    run.write_chart(&cycles)?;
    run.write_sections()?;
    if let Some(series) = &run.series {
        series.finish()?;
    }
    if let Some(material) = &run.material {
        material.finish()?;
    }
    results.publish()?;
    seconds.drawing += drawing.elapsed().as_secs_f64();
    seconds.total = start.elapsed().as_secs_f64();
    run.finish(cycles, per_block, seconds)
}

/// The mesh that moves along.
fn read_material(path: &Path, sequence: &Sequence, output: &Output) -> anyhow::Result<Given> {
    let given = Given::read_mesh(path)?;
    let points = &given.carrier.points;
    let beyond = outside(sequence.domain(), points)?;
    if beyond > 0 {
        output.warn(format!(
            "{beyond} of the {} points of `{}` lie outside the reference; the formula has values there, but they are no map",
            points.len(),
            path.display()
        ));
    }
    Ok(given)
}

fn require_valid(args: &SequenceArgs) -> anyhow::Result<()> {
    args.section.require_valid()?;
    ensure!(
        args.lame.iter().all(|constant| constant.is_finite()),
        "--lame is {} {}, but must be two finite numbers",
        args.lame[0],
        args.lame[1]
    );
    ensure!(
        args.fps > 0.0 && args.fps.is_finite(),
        "--fps is {}, but must be positive",
        args.fps
    );
    ensure!(
        args.frames_per_block != Some(0),
        "--frames-per-block is 0, but must be at least 1"
    );
    ensure!(
        args.mend.is_none_or(|edges| edges <= MOST_RIM_EDGES),
        "--mend is {}, but must be at most {MOST_RIM_EDGES}",
        args.mend.unwrap_or_default()
    );
    let most = args.frames.len();
    let beyond = args.show.iter().find(|&&frame| frame >= most);
    ensure!(
        beyond.is_none(),
        "--show names frame {}, but there are {most}, counted from 0",
        beyond.copied().unwrap_or_default()
    );
    Ok(())
}

fn options(args: &SequenceArgs) -> anyhow::Result<SequenceOptions> {
    Ok(SequenceOptions {
        fit: fit::options(&args.method, args.tolerance)?,
        resolution: GridResolution::CellsAlongLongestSide(args.resolution),
        lame: Lame {
            lambda: args.lame[0],
            mu: args.lame[1],
        },
        own_volume: args.own_volume,
        close_holes: args.mend,
        frames_per_block: args.frames_per_block,
    })
}

/// An error of the reference, with its file and what helps.
fn advised(error: SequenceError, args: &SequenceArgs) -> anyhow::Error {
    let is_open = |report: &solidmap::check::CheckReport| !report.closed;
    let open =
        matches!(&error, SequenceError::Fit(solidmap::fit::FitError::DefectiveDomain(report)) if is_open(report));
    let hint = if open && args.mend.is_none() {
        "; --mend closes small holes and slits, in all frames alike"
    } else {
        ""
    };
    anyhow::anyhow!("cannot use `{}`: {error}{hint}", args.reference.display())
}

/// The first two neighbours whose names are in alphabetical order, but not in that of their numbers.
fn misordered(files: &[PathBuf]) -> Option<[&Path; 2]> {
    let alphabetical = files.is_sorted();
    let pair = files
        .windows(2)
        .find(|pair| by_numbers(&pair[0], &pair[1]) == Ordering::Greater)?;
    alphabetical.then_some([pair[0].as_path(), pair[1].as_path()])
}

/// Names in the order of the numbers in them.
fn by_numbers(a: &Path, b: &Path) -> Ordering {
    let parts = |path: &Path| {
        let name = path.to_string_lossy().into_owned();
        let mut parts: Vec<(bool, String)> = Vec::new();
        for character in name.chars() {
            let digit = character.is_ascii_digit();
            match parts.last_mut() {
                Some((is_number, part)) if *is_number == digit => part.push(character),
                _ => parts.push((digit, character.into())),
            }
        }
        parts
    };
    let (a, b) = (parts(a), parts(b));
    for ((a_number, a), (b_number, b)) in a.iter().zip(&b) {
        let order = if *a_number && *b_number {
            let [a, b] = [a, b].map(|digits| digits.trim_start_matches('0'));
            a.len().cmp(&b.len()).then_with(|| a.cmp(b))
        } else {
            a.cmp(b)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    a.len().cmp(&b.len())
}

/// The cross-section that was asked for; of those across each axis the largest, where no axis was named.
fn section(asked: &SectionArgs, domain: &SurfaceMesh) -> anyhow::Result<Section> {
    let up = Axis::from(asked.up);
    let across = |axis| Section::with_up(domain, asked.plane_across(axis, domain), up, SECTION_PIXELS);
    if let Some(axis) = asked.axis {
        return Ok(across(Axis::from(axis))?);
    }
    // Of several alike the last is taken.
    let sections = [Axis::X, Axis::Y].map(across).into_iter().flatten();
    let last = across(Axis::Z);
    let largest = sections
        .chain(last.iter().cloned())
        .max_by(|a, b| a.area().total_cmp(&b.area()));
    Ok(largest.map_or(last, Ok)?)
}

/// What is gathered while the blocks go by: rows, and densities on the section for the frames that are shown.
struct Run<'a> {
    args: &'a SequenceArgs,
    /// Where files are written.
    folder: PathBuf,
    output: &'a Output,
    sequence: Sequence,
    section: Section,
    rows: Vec<FrameRow>,
    /// Sum of the densities on the section over all frames, and how many there are.
    sum: Vec<f64>,
    measured: usize,
    /// Frames asked for, with their densities on the section.
    shown: Vec<(usize, Vec<f64>)>,
    /// The same of the frame of most energy.
    most: Option<(usize, f64, Vec<f64>)>,
    series: Option<Series>,
    material: Option<Material>,
}

impl<'a> Run<'a> {
    fn new(
        args: &'a SequenceArgs,
        folder: &Path,
        sequence: Sequence,
        material: Option<Given>,
        output: &'a Output,
    ) -> anyhow::Result<Self> {
        let section = section(&args.section, sequence.domain())?;
        let series = (!args.no_vtu)
            .then(|| Series::new(folder, sequence.domain()))
            .transpose()?;
        let material = material.map(|given| Material::new(folder, given)).transpose()?;
        Ok(Self {
            args,
            folder: folder.to_owned(),
            output,
            sum: vec![0.0; section.points().len()],
            section,
            sequence,
            rows: Vec::new(),
            measured: 0,
            shown: Vec::new(),
            most: None,
            series,
            material,
        })
    }

    /// Reads, measures and writes some frames.
    fn block(&mut self, frames: Range<usize>, seconds: &mut Seconds) -> anyhow::Result<()> {
        let start = Instant::now();
        let output = self.output;
        let name = format!(
            "frames {} to {} of {}: ",
            frames.start,
            frames.end - 1,
            self.args.frames.len()
        );
        output.progress(format!("{name}reading"));
        let mut unusable = Vec::new();
        let (mut numbers, mut maps) = (Vec::new(), Vec::new());
        for frame in frames.clone() {
            match self.read(frame) {
                Ok(map) => {
                    numbers.push(frame);
                    maps.push(map);
                }
                Err(reason) => unusable.push((frame, reason)),
            }
        }
        let measured = self.sequence.measure(&maps, &|phase| fit::show(phase, &name, output));
        let mut found = Vec::new();
        for ((frame, map), measured) in numbers.into_iter().zip(&maps).zip(measured) {
            match measured {
                Ok(measured) => found.push((frame, map, measured)),
                Err(error) => unusable.push((frame, error.to_string())),
            }
        }
        output.progress(format!("{name}densities"));
        self.add_to_sections(&found);
        seconds.frames += start.elapsed().as_secs_f64();
        let start = Instant::now();
        output.progress(format!("{name}writing"));
        self.add_to_series(&found)?;
        seconds.drawing += start.elapsed().as_secs_f64();
        for (frame, _, measured) in &found {
            self.add_row(*frame, Some(Found::of(measured)), None);
        }
        for (frame, reason) in unusable {
            self.add_row(frame, None, Some(reason));
        }
        self.rows.sort_by_key(|row| row.frame);
        Ok(())
    }

    fn read(&self, frame: usize) -> Result<BoundaryMap, String> {
        let surface = input::read_surface(&self.args.frames[frame]).map_err(|error| super::describe(&error))?;
        self.sequence.frame(&surface).map_err(|error| error.to_string())
    }

    fn add_to_sections(&mut self, frames: &[(usize, &BoundaryMap, MeasuredFrame)]) {
        let measured: Vec<&MeasuredFrame> = frames.iter().map(|(_, _, measured)| measured).collect();
        let densities = self.sequence.densities_at(&measured, self.section.points());
        for ((frame, _, measured), densities) in frames.iter().zip(densities) {
            self.sum
                .iter_mut()
                .zip(&densities)
                .for_each(|(sum, density)| *sum += density);
            self.measured += 1;
            if self.args.show.contains(frame) {
                self.shown.push((*frame, densities.clone()));
            }
            if self
                .most
                .as_ref()
                .is_none_or(|(_, most, _)| measured.deformation > *most)
            {
                self.most = Some((*frame, measured.deformation, densities));
            }
        }
    }

    fn add_to_series(&mut self, frames: &[(usize, &BoundaryMap, MeasuredFrame)]) -> anyhow::Result<()> {
        let fps = self.args.fps;
        if let Some(material) = &mut self.material {
            for (frame, _, measured) in frames {
                material.add((*frame, *frame as f64 / fps), &measured.map)?;
            }
        }
        let Some(series) = &mut self.series else { return Ok(()) };
        let measured: Vec<&MeasuredFrame> = frames.iter().map(|(_, _, measured)| measured).collect();
        let surfaces = self.sequence.densities_at(&measured, series.middles());
        for ((frame, map, measured), surface) in frames.iter().zip(surfaces) {
            let time = *frame as f64 / fps;
            series.add((*frame, time), measured, map.image(), surface, &self.sequence)?;
        }
        Ok(())
    }

    fn add_row(&mut self, frame: usize, found: Option<Found>, skipped: Option<String>) {
        let file = self.args.frames[frame].clone();
        if let Some(reason) = &skipped {
            // Errors of files name them already.
            let name = format!("`{}`", file.display());
            let named = if reason.contains(&name) {
                reason.clone()
            } else {
                format!("{name}: {reason}")
            };
            self.output.warn(format!("frame {frame} is skipped: {named}"));
        }
        self.rows.push(FrameRow {
            frame,
            time: frame as f64 / self.args.fps,
            file,
            found,
            skipped,
        });
    }

    fn energies(&self) -> Vec<f64> {
        let energy = |row: &FrameRow| row.found.as_ref().map_or(f64::NAN, |found| found.deformation_energy);
        self.rows.iter().map(energy).collect()
    }

    fn cycles(&self) -> Result<Cycles, NoCycles> {
        cycles(&self.energies(), self.sequence.resolution_of_energy())
    }

    fn write_csv(&self) -> anyhow::Result<()> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record([
            "frame",
            "time",
            "file",
            "deformation_energy",
            "harmonic_energy",
            "deformation_density_p99",
            "deformation_density_max",
            "boundary_error_rms",
            "boundary_error_p99",
            "boundary_error_max",
            "inverted_fraction",
            "volume",
            "volume_ratio",
            "skipped",
        ])?;
        let volume = self.sequence.quadrature().volume();
        for row in &self.rows {
            let numbers = row.found.as_ref().map(|f| {
                [
                    f.deformation_energy,
                    f.harmonic_energy,
                    f.deformation_density.p99,
                    f.deformation_density.max,
                    f.boundary_error.rms,
                    f.boundary_error.p99,
                    f.boundary_error.max,
                    f.inverted_fraction,
                    f.volume,
                    f.volume / volume,
                ]
                .map(|number| format!("{number:e}"))
            });
            let mut record = vec![
                row.frame.to_string(),
                row.time.to_string(),
                row.file.display().to_string(),
            ];
            record.extend(numbers.unwrap_or_default());
            record.push(row.skipped.clone().unwrap_or_default());
            table.write_record(record)?;
        }
        let bytes = table.into_inner().context("cannot make the table of frames")?;
        Ok(io::atomic_write(self.folder.join("energy.csv"), |writer| {
            writer.write_all(&bytes)
        })?)
    }

    fn write_chart(&self, cycles: &Result<Cycles, NoCycles>) -> anyhow::Result<()> {
        let fps = self.args.fps;
        let points = self
            .energies()
            .iter()
            .zip(&self.rows)
            .map(|(&energy, row)| [row.time, energy])
            .collect();
        let across = if fps == 1.0 { "frame" } else { "time in seconds" };
        let reference = file_name(&self.args.reference);
        let mut chart = Chart::new(points, [across, "deformation energy"])
            .titled(format!("Deformation energy from {reference}"))
            .with_missing(
                self.rows
                    .iter()
                    .filter(|row| row.skipped.is_some())
                    .map(|row| row.time)
                    .collect(),
            );
        chart = match cycles {
            Ok(cycles) => {
                let last = (self.rows.len() - 1) as f64;
                let begins = |k: i32| cycles.first + f64::from(k) * cycles.period;
                let spans = (-1..)
                    .map(|k| [begins(k), begins(k + 1)])
                    .take_while(|span| span[0] < last);
                // Broken cycles at the ends are not numbered. The last frame lasts until the next would begin.
                let whole = spans.filter(|span| span[0] >= -0.5 && span[1] <= last + 1.5);
                chart
                    .noted(describe(cycles))
                    .with_spans(whole.map(|span| span.map(|frame| frame / fps)).collect())
            }
            Err(none) => chart.noted(format!("no cycles: {none}")),
        };
        let skipped = self.rows.iter().filter(|row| row.skipped.is_some()).count();
        if skipped > 0 {
            chart = chart.noted(format!("{skipped} frames could not be used (×)"));
        }
        let png = chart.to_png(CHART)?;
        Ok(io::atomic_write(self.folder.join("energy.png"), |writer| {
            writer.write_all(&png)
        })?)
    }

    /// The mean over all frames, the frames asked for and that of most energy, on the reference's section, with one bar.
    fn write_sections(&self) -> anyhow::Result<()> {
        let mean: Vec<f64> = self.sum.iter().map(|sum| sum / self.measured.max(1) as f64).collect();
        // A line of its own for the name of a file: panels are narrow.
        let file = |frame: usize| file_name(&self.args.frames[frame]);
        let mut pictures = vec![(format!("mean of {} frames", self.measured), None, &mean)];
        for (frame, densities) in &self.shown {
            pictures.push((format!("frame {frame}"), Some(file(*frame)), densities));
        }
        if let Some((frame, _, densities)) = &self.most
            && !self.args.show.contains(frame)
        {
            pictures.push((format!("most energy: frame {frame}"), Some(file(*frame)), densities));
        }
        let all = pictures.iter().flat_map(|(_, _, densities)| densities.iter().copied());
        // A few points at creases have densities far above all others; the bar says that it clamps. Nothing is blue.
        let most = ColourBar::new(DENSITY, all.clone(), ValueRange::Quantiles(0.0, 0.99), Scale::Linear)?
            .range()
            .1;
        let range = ValueRange::Fixed(0.0, most.max(self.sequence.resolution_of_energy()));
        let bar = ColourBar::new(DENSITY, all, range, Scale::Linear)?;
        let panels = pictures.iter().map(|(title, file, densities)| {
            let panel = Panel::of_section(&self.section, densities, &bar)?.titled(title);
            anyhow::Ok(file.iter().fold(panel, Panel::captioned))
        });
        let panels: Vec<Panel> = panels.collect::<Result<_, _>>()?;
        let rows: Vec<Vec<Panel>> = panels.chunks(3).map(<[Panel]>::to_vec).collect();
        let png = Figure::grid(rows)
            .titled(format!("Where {} is deformed", file_name(&self.args.reference)))
            .with_bar(&bar)
            .to_png()?;
        Ok(io::atomic_write(self.folder.join("sections.png"), |writer| {
            writer.write_all(&png)
        })?)
    }

    /// Prints the report and says how it went.
    fn finish(self, cycles: Result<Cycles, NoCycles>, per_block: usize, seconds: Seconds) -> anyhow::Result<Outcome> {
        self.warn_of_units();
        let tolerance = self.args.tolerance;
        let missed: Vec<&FrameRow> = self
            .rows
            .iter()
            .filter(|row| row.found.as_ref().is_some_and(|f| f.boundary_error.p99 > tolerance))
            .collect();
        if let Some(worst) = missed
            .iter()
            .filter_map(|row| Some(row.found.as_ref()?.boundary_error.p99))
            .reduce(f64::max)
        {
            self.output.warn(format!(
                "99 % of the boundary is met only to {worst:.1e} of the frame's diagonal, and the tolerance is {tolerance:.1e}, in {}; \
                 energies there are less certain. Raise --tolerance, or see where the frames jump or fold",
                listed(missed.iter().map(|row| row.frame))
            ));
        }
        let tolerance_met = missed.is_empty();
        let skipped = self.rows.iter().filter(|row| row.skipped.is_some()).count();
        let (found, none) = match cycles {
            Ok(cycles) => (Some(cycles), None),
            Err(none) => (None, Some(none.to_string())),
        };
        let domain = self.sequence.domain();
        let report = Report {
            reference: self.args.reference.clone(),
            output: self.args.output.clone(),
            vertices: domain.vertices().len(),
            faces: domain.triangles().len(),
            closed_holes: self.sequence.holes().to_vec(),
            volume: self.sequence.quadrature().volume(),
            points: self.sequence.quadrature().points().len(),
            frames_per_block: per_block,
            material: self.args.material.clone(),
            own_volume: self.args.own_volume,
            frames: self.rows,
            skipped,
            tolerance,
            tolerance_met,
            cycles: found,
            no_cycles: none,
            seconds,
            peak_rss_bytes: peak_rss_bytes(),
        };
        self.output.result(&report, || summary(&report, self.series.as_ref()))?;
        Ok(if skipped == 0 && tolerance_met {
            Outcome::Done
        } else {
            Outcome::CheckFailed
        })
    }

    fn warn_of_units(&self) {
        let own = self.sequence.quadrature().volume();
        let found = || {
            self.rows
                .iter()
                .filter_map(|row| Some((row.frame, row.found.as_ref()?.volume / own)))
        };
        let mirrored: Vec<usize> = found()
            .filter(|(_, ratio)| *ratio < 0.0)
            .map(|(frame, _)| frame)
            .collect();
        if !mirrored.is_empty() {
            self.output.warn(format!(
                "mirror images of the reference, or turned inside out, which strain does not see: {}",
                listed(mirrored.into_iter())
            ));
        }
        let is_other = |ratio: f64| !(1.0 / OTHER_UNIT..=OTHER_UNIT).contains(&ratio.abs());
        let other: Vec<usize> = found()
            .filter(|(_, ratio)| is_other(*ratio))
            .map(|(frame, _)| frame)
            .collect();
        if !other.is_empty() && !self.args.own_volume {
            self.output.warn(format!(
                "a volume far from the reference's, so that most of the energy is change of size: {}; if the unit is another, use \
                 --own-volume",
                listed(other.into_iter())
            ));
        }
    }
}

/// Numbers of frames, not too many.
fn listed(frames: impl ExactSizeIterator<Item = usize>) -> String {
    let count = frames.len();
    let mut text: Vec<String> = frames.take(LISTED).map(|frame| frame.to_string()).collect();
    if count > LISTED {
        text.push(format!("and {} more", count - LISTED));
    }
    format!("{} {}", if count == 1 { "frame" } else { "frames" }, text.join(", "))
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

fn describe(cycles: &Cycles) -> String {
    format!(
        "{} cycles of {} frames ({:.1} in all; correlation {:.2})",
        cycles.whole(),
        significant(cycles.period, 3),
        cycles.count,
        cycles.strength
    )
}

fn summary(report: &Report, series: Option<&Series>) -> String {
    let found: Vec<(usize, &Found)> = report
        .frames
        .iter()
        .filter_map(|row| Some((row.frame, row.found.as_ref()?)))
        .collect();
    let energy = |(_, found): &&(usize, &Found)| found.deformation_energy;
    let least = found.iter().min_by(|a, b| energy(a).total_cmp(&energy(b)));
    let most = found.iter().max_by(|a, b| energy(a).total_cmp(&energy(b)));
    let worst = |of: fn(&Found) -> f64| found.iter().map(|(_, f)| of(f)).fold(0.0, f64::max);
    let extreme = |frame: Option<&(usize, &Found)>| {
        frame.map_or(String::new(), |(frame, f)| {
            format!("{} (frame {frame})", significant(f.deformation_energy, 4))
        })
    };
    let mut rows = vec![
        [
            "reference".to_owned(),
            format!(
                "{} vertices, {} triangles, volume {}",
                report.vertices,
                report.faces,
                significant(report.volume, 5)
            ),
        ],
        [
            "frames".into(),
            format!(
                "{}, of which {} could not be used; {} in a block",
                report.frames.len(),
                report.skipped,
                report.frames_per_block.min(report.frames.len())
            ),
        ],
        [
            "deformation energy".into(),
            format!("{} to {}", extreme(least), extreme(most)),
        ],
        [
            String::new(),
            if report.own_volume {
                "mean density over the reference, every frame scaled to its volume".into()
            } else {
                "mean density over the reference; a frame that moves as a whole has none".into()
            },
        ],
        [
            "cycles".into(),
            report.cycles.as_ref().map_or_else(
                || format!("none: {}", report.no_cycles.as_deref().unwrap_or_default()),
                describe,
            ),
        ],
        [
            "boundary error".into(),
            format!(
                "99 % within {:.2e} of the diagonal in the worst frame, {:.2e} at most; tolerance {:.1e}",
                worst(|f| f.boundary_error.p99),
                worst(|f| f.boundary_error.max),
                report.tolerance
            ),
        ],
        [
            "folded".into(),
            format!(
                "{:.2} % of the volume in the worst frame",
                100.0 * worst(|f| f.inverted_fraction)
            ),
        ],
        [
            "time".into(),
            format!(
                "{:.1} s: reference {:.1}, frames {:.1}, pictures and series {:.1}",
                report.seconds.total, report.seconds.setup, report.seconds.frames, report.seconds.drawing
            ),
        ],
        [
            "memory".into(),
            format!("{:.0} MiB at most", report.peak_rss_bytes as f64 / 1_048_576.0),
        ],
        [
            "written".into(),
            format!("{}: energy.csv, energy.png, sections.png", report.output.display()),
        ],
    ];
    if let Some(series) = series {
        rows.push([String::new(), series.describe()]);
    }
    if let Some(material) = &report.material {
        rows.push([
            String::new(),
            format!("material.pvd: `{}` in every frame", material.display()),
        ]);
    }
    pairs(rows)
}
