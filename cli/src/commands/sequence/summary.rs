//! The report on a sequence, as JSON and in words.

use serde::Serialize;
use solidmap::check::ClosedHole;
use solidmap::energy::{DensityQuantiles, EnergyErrors};
use solidmap::fit::{BoundaryError, self_intersection_finder};
use solidmap::sequence::{CycleError, Cycles, FrameMeasurement};

use super::measure::Measurement;
use super::series::Series;
use crate::CommandOutcome;
use crate::drawing::significant;
use crate::shared::chosen_map::MapName;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{memory_row, peak_rss_bytes, two_columns};

/// A frame whose volume is more than this times the reference's, or less than the inverse, may be in another unit.
const OTHER_UNIT: f64 = 4.0;
/// Most frames that a message lists.
const LISTED: usize = 20;

/// What `sequence --json` prints.
#[derive(Serialize)]
struct SequenceSummary {
    reference: FileName,
    map_kind: MapName,
    output: FileName,
    material: Option<FileName>,
    page: Option<FileName>,
    vertices: usize,
    faces: usize,
    closed_holes: Vec<ClosedHole>,
    /// Volume of the reference.
    volume: f64,
    /// Quadrature points of the harmonic maps.
    points: Option<usize>,
    /// Tetrahedra of the reference that bijective maps are made over.
    tets: Option<usize>,
    frames_per_block: usize,
    own_volume: bool,
    frames: Vec<FrameRow>,
    skipped: usize,
    tolerance: f64,
    tolerance_met: bool,
    cycles: Option<Cycles>,
    no_cycles: Option<String>,
    /// What is unusual about the reference.
    warnings: Vec<String>,
    seconds: SequenceTimings,
    peak_rss_bytes: u64,
}

/// Wall-clock seconds by phase.
#[derive(Serialize, Default)]
pub struct SequenceTimings {
    pub total: f64,
    /// Reading and factoring the reference.
    pub setup: f64,
    /// Reading, solving and measuring the frames.
    pub frames: f64,
    /// Pictures, and the series for ParaView.
    pub drawing: f64,
}

/// A frame, in the order given.
#[derive(Serialize)]
pub struct FrameRow {
    pub frame: usize,
    pub time: f64,
    pub file: FileName,
    #[serde(flatten)]
    pub found: Option<MeasuredRow>,
    /// Why it was skipped.
    pub skipped: Option<String>,
}

/// What was measured of a frame.
#[derive(Serialize)]
pub struct MeasuredRow {
    pub deformation_energy: f64,
    pub harmonic_energy: f64,
    /// Estimated errors of both energies by integration.
    pub errors: EnergyErrors,
    pub deformation_density: DensityQuantiles,
    pub boundary_error: BoundaryError,
    pub folded_fraction: f64,
    /// Tetrahedra that the harmonic map inverts, where the map is bijective.
    pub inverted_as_mapped: Option<usize>,
    pub volume: f64,
}

impl MeasuredRow {
    pub fn new(measured: &FrameMeasurement) -> Self {
        Self {
            deformation_energy: measured.deformation,
            harmonic_energy: measured.harmonic,
            errors: measured.errors,
            deformation_density: measured.deformation_density,
            boundary_error: measured.boundary_error,
            folded_fraction: measured.folded_fraction,
            inverted_as_mapped: measured.map.bijective().map(|made| made.report.inverted_as_mapped),
            volume: measured.volume,
        }
    }
}

impl Measurement<'_> {
    /// Prints the report, with warnings.
    pub fn finish(
        self,
        warnings: Vec<String>,
        cycles: Result<Cycles, CycleError>,
        per_block: usize,
        seconds: SequenceTimings,
    ) -> anyhow::Result<CommandOutcome> {
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
                "99 % of the boundary is met only to {worst:.1e} of the frame's diagonal, and the tolerance is \
                 {tolerance:.1e}, in {}; energies there are less certain. Raise --tolerance, or see where the frames \
                 jump or fold",
                listed(missed.iter().copied())
            ));
        }
        let tolerance_met = missed.is_empty();
        let wanted = self.args.accuracy.tolerance();
        let inaccurate = |found: &MeasuredRow| {
            let allowed = wanted * found.deformation_energy;
            found.errors.deformation > allowed.max(self.sequence.resolution_of_energy())
        };
        let inaccurate = |row: &&FrameRow| row.found.as_ref().is_some_and(inaccurate);
        let uncertain: Vec<&FrameRow> = self.rows.iter().filter(inaccurate).collect();
        if !uncertain.is_empty() {
            self.output.warn(format!(
                "the deformation energy is less accurate than --energy-tolerance {wanted} in {}; `energy.csv` has the \
                 errors. A larger --resolution allows more points",
                listed(uncertain.into_iter())
            ));
        }
        let skipped = self.rows.iter().filter(|row| row.skipped.is_some()).count();
        let (found, none) = match cycles {
            Ok(cycles) => (Some(cycles), None),
            Err(none) => (None, Some(none.to_string())),
        };
        let domain = self.sequence.domain();
        let tets = self.filled.as_ref().map(|filled| filled.mesh().tets().len());
        let report = SequenceSummary {
            reference: (&self.args.reference).into(),
            map_kind: self.args.map_kind.into(),
            output: (&self.args.output).into(),
            vertices: domain.vertices().len(),
            faces: domain.triangles().len(),
            closed_holes: self.sequence.holes().to_vec(),
            volume: self.sequence.quadrature().volume(),
            points: tets.is_none().then(|| self.sequence.quadrature().points().len()),
            tets,
            frames_per_block: per_block,
            material: file_name(self.args.material.as_ref()),
            page: file_name(self.args.html.as_ref()),
            own_volume: self.args.own_volume,
            frames: self.rows,
            skipped,
            tolerance,
            tolerance_met,
            cycles: found,
            no_cycles: none,
            warnings,
            seconds,
            peak_rss_bytes: peak_rss_bytes(),
        };
        self.output.result(&report, || summary(&report, self.series.as_ref()))?;
        Ok(CommandOutcome::from_check(skipped == 0 && tolerance_met))
    }

    fn warn_of_units(&self) {
        let own = self.sequence.quadrature().volume();
        let found = || {
            self.rows
                .iter()
                .filter_map(|row| Some((row, row.found.as_ref()?.volume / own)))
        };
        let mirrored: Vec<&FrameRow> = found().filter(|(_, ratio)| *ratio < 0.0).map(|(row, _)| row).collect();
        if !mirrored.is_empty() {
            self.output.warn(format!(
                "mirror images of the reference, or surfaces turned inside out, which the deformation energy does not \
                 show: {}",
                listed(mirrored.into_iter())
            ));
        }
        let is_other = |ratio: f64| !(1.0 / OTHER_UNIT..=OTHER_UNIT).contains(&ratio.abs());
        let other: Vec<&FrameRow> = found()
            .filter(|(_, ratio)| is_other(*ratio))
            .map(|(row, _)| row)
            .collect();
        if !other.is_empty() && !self.args.own_volume {
            self.output.warn(format!(
                "volumes far from the reference's, so that most of the energy is change of size: {}; if the unit of \
                 length is another, use --own-volume",
                listed(other.into_iter())
            ));
        }
    }
}

/// The files of frames, a few of them.
fn listed<'r>(frames: impl ExactSizeIterator<Item = &'r FrameRow>) -> String {
    let count = frames.len();
    let mut text: Vec<String> = frames
        .take(LISTED)
        .map(|row| format!("`{}`", row.file.display()))
        .collect();
    if count > LISTED {
        text.push(format!("and {} more frames", count - LISTED));
    }
    text.join(", ")
}

/// Cycles in words.
pub fn describe(cycles: &Cycles) -> String {
    format!(
        "{} cycles of {} frames ({:.1} in all; correlation {:.2})",
        cycles.whole(),
        significant(cycles.period, 3),
        cycles.count,
        cycles.strength
    )
}

fn summary(report: &SequenceSummary, series: Option<&Series>) -> String {
    let found: Vec<(&FrameRow, &MeasuredRow)> = report
        .frames
        .iter()
        .filter_map(|row| Some((row, row.found.as_ref()?)))
        .collect();
    let energy = |(_, found): &&(&FrameRow, &MeasuredRow)| found.deformation_energy;
    let least = found.iter().min_by(|a, b| energy(a).total_cmp(&energy(b)));
    let most = found.iter().max_by(|a, b| energy(a).total_cmp(&energy(b)));
    let worst = |of: fn(&MeasuredRow) -> f64| found.iter().map(|(_, f)| of(f)).fold(0.0, f64::max);
    let extreme = |frame: Option<&(&FrameRow, &MeasuredRow)>| {
        frame.map_or(String::new(), |(row, f)| {
            let (energy, file) = (significant(f.deformation_energy, 4), row.file.display());
            format!("{energy} (frame {}, `{file}`)", row.frame)
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
            "map".into(),
            report.tets.map_or("harmonic".into(), |tets| {
                let inverted = found.iter().filter_map(|(_, f)| f.inverted_as_mapped).max();
                format!(
                    "bijective, linear over {tets} tetrahedra, of which the harmonic one inverts {} in the worst frame{}",
                    inverted.unwrap_or(0),
                    match self_intersection_finder() {
                        Some(_) => "",
                        None => "; whether frames pass through themselves was not looked for, which needs CGAL",
                    }
                )
            }),
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
                "mean density over the reference; a rigid motion has none".into()
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
                100.0 * worst(|f| f.folded_fraction)
            ),
        ],
        [
            "time".into(),
            format!(
                "{:.1} s: reference {:.1}, frames {:.1}, pictures and series {:.1}",
                report.seconds.total, report.seconds.setup, report.seconds.frames, report.seconds.drawing
            ),
        ],
        memory_row(report.peak_rss_bytes),
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
    if let Some(page) = &report.page {
        rows.push([String::new(), format!("{}: the frames in a browser", page.display())]);
    }
    two_columns(rows)
}
