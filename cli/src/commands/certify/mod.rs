//! `solidmap certify`: where a map is proved to be one to one, and where it is proved to fold.

mod bijective;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::Point;
use solidmap::certificate::{
    Certificate, CertificateCell, CertificateOptions, CertificateReport, MirroredParts, StopReason, Verdict,
    VerdictTotals, certify,
};
use solidmap::energy::EnergyOptions;
use solidmap::files;
use solidmap::geometry::{Axis, AxisPlane, PlaneSection};
use solidmap::io::{Cells, VtkFields};
use solidmap::mesh::SurfaceMesh;
use solidmap::worst_places::{PlaceKind, WorstPlace};

use crate::CommandOutcome;
use crate::args::{CertifyArgs, SectionArgs};
use crate::drawing::{ColourBar, Colours, Figure, Panel, Scale, ValueRange, significant};
use crate::shared::chosen_map::{ChosenMap, MapName};
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::map_page::{MapPage, measured};
use crate::shared::output::{Output, peak_rss_bytes, two_columns, write_file};
use crate::shared::page;
use crate::shared::places::{percent, with_places};

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 640;

/// What `certify --json` prints.
#[derive(Serialize)]
struct CertifySummary {
    map: FileName,
    map_kind: MapName,
    page: Option<FileName>,
    cells: usize,
    /// Proved for the whole domain.
    locally_one_to_one: bool,
    #[serde(flatten)]
    certificate: CertificateReport,
    /// How many connected groups of cells are folded, and how many undecided.
    folded_places: usize,
    undecided_places: usize,
    worst_places: Vec<WorstPlace>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Certifies and writes.
pub fn run(args: &CertifyArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    args.section.require_valid()?;
    let outputs: [(Option<&PathBuf>, &[&str]); 3] = [
        (args.output.as_ref(), &["vtu"]),
        (args.png.as_ref(), &["png"]),
        (args.html.as_ref(), &page::EXTENSIONS),
    ];
    input::require_all_writable(&outputs, &[&args.map])?;
    let options = CertificateOptions {
        finest: args.finest,
        max_cells: args.max_cells,
        undecided: args.undecided,
    };
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let chosen = ChosenMap::of(&file, &args.map, &args.choice)?;
    if let ChosenMap::Bijective(map) = chosen {
        return bijective::run(args, map, output);
    }
    let plane = args.section.plane(boundary.domain());
    let asked = args.png.as_ref().map(|_| {
        let up = args.section.up.into();
        PlaneSection::new(boundary.domain(), plane, up, SECTION_PIXELS)
    });
    let asked = asked.transpose()?;
    let clock = Instant::now();
    let certificate = certify(
        &file.map,
        boundary.domain(),
        boundary.target_volume(),
        &options,
        &|at| {
            let step = format!("level {}, {:.2} % undecided", at.level, 100.0 * at.undecided);
            output.progress_of(step, at.done, at.of);
        },
    )
    .with_context(|| format!("cannot certify `{}`", args.map.display()))?;
    let (folded, undecided) = (certificate.folded_places(), certificate.undecided_places());
    let (folded_places, undecided_places) = (folded.len(), undecided.len());
    let worst = folded.first().or(undecided.first()).copied();
    let worst_places = folded.into_iter().chain(undecided).take(args.places.worst).collect();
    let seconds = clock.elapsed().as_secs_f64();

    if let Some(path) = &args.output {
        output.progress("writing");
        write(path, &certificate.merged(&file.map))?;
    }
    if let (Some(path), Some(asked)) = (&args.png, asked) {
        output.progress("drawing");
        let pictured = Pictured {
            certificate: &certificate,
            domain: boundary.domain(),
            worst,
        };
        write_file(path, &Figure::row(pictured.panels(&args.section, asked)?).to_png()?)?;
    }
    if let Some(path) = &args.html {
        output.progress("integrating");
        let options = EnergyOptions::default();
        let energy = measured(chosen, &boundary, &options);
        let page = MapPage {
            path: &args.map,
            chosen,
            boundary: &boundary,
            metadata: &file.metadata,
            energy: &energy.with_context(|| format!("cannot measure `{}`", args.map.display()))?,
            options,
            up: args.section.up,
            certificate: Some(&certificate.merged(&file.map)),
            carried: None,
        };
        page::write(path, &page.make(&args.page, output)?.html)?;
    }
    let found = certificate.report;
    let report = CertifySummary {
        map: (&args.map).into(),
        map_kind: chosen.name(),
        cells: certificate.cells().len(),
        locally_one_to_one: found.stop_reason == StopReason::AllDecided && found.folded.cells == 0,
        page: file_name(args.html.as_ref()),
        certificate: found,
        folded_places,
        undecided_places,
        worst_places,
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || with_places(summary(&report), &report.worst_places))?;
    Ok(CommandOutcome::from_check(found.folded.cells == 0))
}

fn write(path: &Path, certificate: &Certificate) -> anyhow::Result<()> {
    let (points, hexahedra) = certificate.hexahedra();
    let fields = VtkFields {
        cell: files::certificate_fields(certificate),
        ..VtkFields::default()
    };
    Ok(files::write_fields(path, &points, Cells::Hexes(&hexahedra), &fields)?)
}

/// A certificate to be pictured.
struct Pictured<'a> {
    certificate: &'a Certificate,
    domain: &'a SurfaceMesh,
    worst: Option<WorstPlace>,
}

impl Pictured<'_> {
    /// The verdicts on a section, the worst place on it enlarged, and the lower bounds of the least singular value. The
    /// section is through the worst place unless a position was `asked` for.
    fn panels(&self, args: &SectionArgs, asked: PlaneSection) -> anyhow::Result<Vec<Panel>> {
        let through = self.worst.filter(|_| args.position.is_none()).and_then(|worst| {
            let plane = plane_through(self.certificate, &worst, args.axis.map(Axis::from));
            // Cells across the boundary reach outside.
            PlaneSection::new(self.domain, plane, args.up.into(), SECTION_PIXELS).ok()
        });
        let section = through.unwrap_or(asked);
        let mut whole = verdicts(self.certificate, &section)?
            .titled("What is proved")
            .captioned("blue: locally one to one")
            .captioned("red: folded, grey: undecided");
        let mut panels = vec![];
        if let Some((worst, window)) = self.window(&section) {
            let [right, up] = section.axes().map(Axis::index);
            let corners = window.map(|corner| section.on_picture([corner[right], corner[up]]));
            whole = whole.marked(corners);
            if let Ok(part) =
                PlaneSection::enlarged(self.domain, section.plane(), args.up.into(), SECTION_PIXELS, window)
            {
                let name = if worst.kind == PlaceKind::Folded {
                    "folded"
                } else {
                    "undecided"
                };
                let panel = verdicts(self.certificate, &part)?
                    .titled("The worst place")
                    .captioned(format!("{name}: {} of the volume", percent(worst.share)));
                panels.push(panel);
            }
        }
        panels.insert(0, whole);
        panels.extend(bounds(self.certificate, &section, args.colours())?);
        let turned = panels
            .into_iter()
            .map(|panel| panel.turned_if(args.up.is_upside_down()));
        Ok(turned.collect())
    }

    /// The worst place and a cube around it, where the section passes through its box and it is small.
    fn window(&self, section: &PlaneSection) -> Option<(WorstPlace, [Point; 2])> {
        let (worst, plane) = (self.worst?, section.plane());
        let along = plane.axis.index();
        let meets = worst.low[along] <= plane.position && plane.position <= worst.high[along];
        let extent = (0..3).map(|k| worst.high[k] - worst.low[k]).fold(0.0, f64::max);
        let half = 1.5 * extent;
        let shown = [0, 1]
            .map(|direction| section.extent(direction))
            .map(|(low, high)| high - low);
        let is_small = 2.0 * half < 0.5 * shown[0].max(shown[1]);
        let corner = |sign: f64| Point::from([0, 1, 2].map(|k| (worst.low[k] + worst.high[k]) / 2.0 + sign * half));
        (meets && is_small).then(|| (worst, [corner(-1.0), corner(1.0)]))
    }
}

/// The plane across `axis`, or any axis, that shows most of a place: of the cells in its box with its verdict, the largest
/// area.
fn plane_through(certificate: &Certificate, place: &WorstPlace, axis: Option<Axis>) -> AxisPlane {
    const POSITIONS: usize = 256;
    let verdict = if place.kind == PlaceKind::Folded {
        Verdict::Folded
    } else {
        Verdict::Undecided
    };
    let is_in_box = |leaf: &&CertificateCell| {
        let centre = leaf.centre();
        leaf.verdict == verdict && (0..3).all(|k| place.low[k] < centre[k] && centre[k] < place.high[k])
    };
    let cells: Vec<&CertificateCell> = certificate.cells().iter().filter(is_in_box).collect();
    let largest = |axis: Axis| {
        let k = axis.index();
        let step = (place.high[k] - place.low[k]) / POSITIONS as f64;
        let mut areas = vec![0.0; POSITIONS];
        for leaf in &cells {
            // The positions in the cell's extent along the axis, of which there may be none.
            let from = ((leaf.low[k] - place.low[k]) / step - 0.5).ceil().max(0.0) as usize;
            let to = ((leaf.low[k] + leaf.size - place.low[k]) / step - 0.5).ceil().max(0.0) as usize;
            let part = leaf.volume / leaf.size;
            areas[from.min(POSITIONS)..to.min(POSITIONS)]
                .iter_mut()
                .for_each(|area| *area += part);
        }
        // The first of equal ones.
        let best = (0..POSITIONS)
            .rev()
            .max_by(|&i, &j| areas[i].total_cmp(&areas[j]))
            .unwrap_or(0);
        let position = place.low[k] + (best as f64 + 0.5) * step;
        (areas[best], AxisPlane { axis, position })
    };
    let axes = axis.map_or(vec![Axis::X, Axis::Y, Axis::Z], |axis| vec![axis]);
    let planes = axes.into_iter().map(largest);
    let best = planes.max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(
        AxisPlane {
            axis: Axis::Z,
            position: place.point[2],
        },
        |(_, plane)| plane,
    )
}

/// What is proved on a section.
fn verdicts(certificate: &Certificate, section: &PlaneSection) -> anyhow::Result<Panel> {
    let verdict = |p: &Point| match certificate.cell_at(p).map(|leaf| leaf.verdict) {
        Some(Verdict::Positive) => 0.0,
        Some(Verdict::Folded) => 1.0,
        // NaN is drawn grey.
        Some(Verdict::Undecided) | None => f64::NAN,
    };
    let verdicts: Vec<f64> = section.points().iter().map(verdict).collect();
    let colours = ColourBar::new("verdict", [0.0, 1.0], ValueRange::Full, Scale::Linear)?;
    // Blue and red.
    let colours = colours.in_colours(Colours::Rainbow);
    Ok(Panel::of_section(section, &verdicts, &colours)?)
}

/// Lower bounds of the least singular value on a section; none where nothing is decided.
fn bounds(certificate: &Certificate, section: &PlaneSection, colours: Colours) -> anyhow::Result<Option<Panel>> {
    let leaves: Vec<_> = section.points().iter().map(|p| certificate.cell_at(p)).collect();
    let bounds: Vec<f64> = leaves
        .iter()
        .map(|leaf| leaf.map_or(f64::NAN, |leaf| leaf.sigma_min))
        .map(|bound| if bound > 0.0 { bound } else { f64::NAN })
        .collect();
    if !bounds.iter().any(|bound| bound.is_finite()) {
        return Ok(None);
    }
    let range = ValueRange::Quantiles(0.01, 1.0);
    let bar = ColourBar::new("lower bound", bounds.iter().copied(), range, Scale::Log)?.in_colours(colours);
    let panel = Panel::of_section(section, &bounds, &bar)?
        .titled("Least singular value of J, proved")
        .with_bar(&bar);
    Ok(Some(panel))
}

fn summary(report: &CertifySummary) -> String {
    let found = &report.certificate;
    let row = |name: &str, share: &VerdictTotals, places: usize| {
        let places = match places {
            0 => String::new(),
            1 => " in 1 place".into(),
            places => format!(" in {places} places"),
        };
        [
            name.to_owned(),
            format!(
                "{:>10} of the volume, {} cells{places}",
                percent(share.fraction),
                share.cells
            ),
        ]
    };
    let mut rows = vec![
        row("locally one to one", &found.positive, 0),
        row("folded", &found.folded, report.folded_places),
        row("undecided", &found.undecided, report.undecided_places),
    ];
    if found.undecided.cells > 0 {
        rows.push([
            String::new(),
            format!(
                "{:>10} in cells folded at their centre",
                percent(found.undecided_negative)
            ),
        ]);
    }
    if let Some(sigma) = found.sigma_min_99 {
        let text = format!("{:>10} or more over 99 % of the volume", significant(sigma, 3));
        rows.push(["singular values".into(), text]);
    }
    rows.push([
        "cells".into(),
        format!(
            "{}, the smallest {} wide; {}",
            report.cells,
            significant(found.finest_cell, 3),
            match found.stop_reason {
                StopReason::AllDecided => "all are decided",
                StopReason::EnoughDecided => "enough is decided (--undecided)",
                StopReason::Finest => "the undecided ones are of the smallest size (--finest)",
                StopReason::CellLimit => "dividing the undecided ones would exceed --max-cells",
            }
        ),
    ]);
    rows.push([
        "volume".into(),
        format!(
            "{}; that of all cells differs by {:.0e} of it",
            significant(found.volume, 6),
            found.volume_error.abs()
        ),
    ]);
    rows.push(["time".into(), format!("{:.1} s", report.seconds)]);
    format!("{}\n\n{}", two_columns(rows), conclusion(found))
}

/// The conclusion, in words.
fn conclusion(found: &CertificateReport) -> String {
    let proved = match [found.positive, found.folded, found.undecided].map(|share| share.cells) {
        [_, 0, 0] => {
            "The map is locally one to one everywhere. If its boundary map has degree one (`solidmap boundary \
             check`), every point of\nthe target deeper than the boundary error has exactly one preimage."
        }
        [_, 0, _] => "No fold is proved, and none is excluded in undecided cells.",
        [0, _, _] => "The map inverts the solid wherever it is decided.",
        _ if found.mirrored.count > 0 => "The map does not have one orientation.",
        _ => "The map folds: it is not one to one.",
    };
    let MirroredParts { count, parts, fraction } = found.mirrored;
    if count == 0 {
        return proved.into();
    }
    let [it, its] = if count == 1 {
        ["it counts", "its image is"]
    } else {
        ["they count", "their images are"]
    };
    format!(
        "{proved} It turns {count} of the {parts} parts of the domain inside out ({} of the volume):\n{it} as folded \
         everywhere, because {its} mirrored as a whole.",
        percent(fraction)
    )
}
