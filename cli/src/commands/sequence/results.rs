//! The table, the chart and the pictures of a sequence.

use std::path::Path;

use anyhow::Context;
use solidmap::sequence::{CycleError, Cycles};

use super::measure::Measurement;
use super::summary::describe;
use crate::drawing::{Chart, ColourBar, Figure, Panel, Scale, ValueRange};
use crate::shared::output::write_file;

/// Width and height of the chart.
const CHART: [usize; 2] = [1200, 640];
/// Name of the density in pictures.
const DENSITY: &str = "deformation energy density";

impl Measurement<'_> {
    /// Writes what was found of all frames.
    pub fn write_results(&self, cycles: &Result<Cycles, CycleError>) -> anyhow::Result<()> {
        self.write_csv()?;
        self.write_chart(cycles)?;
        self.write_sections()?;
        if let Some(series) = &self.series {
            series.finish()?;
        }
        if let Some(material) = &self.material {
            material.finish()?;
        }
        Ok(())
    }

    fn write_csv(&self) -> anyhow::Result<()> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record([
            "frame",
            "time",
            "file",
            "deformation_energy",
            "deformation_energy_error",
            "harmonic_energy",
            "deformation_density_p99",
            "deformation_density_max",
            "boundary_error_rms",
            "boundary_error_p99",
            "boundary_error_max",
            "folded_fraction",
            "volume",
            "volume_ratio",
            "skipped",
        ])?;
        let volume = self.sequence.quadrature().volume();
        for row in &self.rows {
            let numbers = row.found.as_ref().map(|f| {
                [
                    f.deformation_energy,
                    f.errors.deformation,
                    f.harmonic_energy,
                    f.deformation_density.p99,
                    f.deformation_density.max,
                    f.boundary_error.rms,
                    f.boundary_error.p99,
                    f.boundary_error.max,
                    f.folded_fraction,
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
        write_file(self.folder.join("energy.csv"), &bytes)
    }

    fn write_chart(&self, cycles: &Result<Cycles, CycleError>) -> anyhow::Result<()> {
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
                let spans = cycles.spans(self.rows.len()).into_iter();
                chart
                    .noted(describe(cycles))
                    .with_spans(spans.map(|span| span.map(|frame| frame / fps)).collect())
            }
            Err(none) => chart.noted(format!("no cycles: {none}")),
        };
        let skipped = self.rows.iter().filter(|row| row.skipped.is_some()).count();
        if skipped > 0 {
            chart = chart.noted(format!("{skipped} frames could not be used (×)"));
        }
        let png = chart.to_png(CHART)?;
        write_file(self.folder.join("energy.png"), &png)
    }

    /// The mean over all frames, the frames asked for and that of most energy, on the reference's section, with one
    /// bar.
    fn write_sections(&self) -> anyhow::Result<()> {
        let mean: Vec<f64> = self.sum.iter().map(|sum| sum / self.measured.max(1) as f64).collect();
        // File names get a line of their own: panels are narrow.
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
        // A few points at creases have densities far above all others; the colour bar says that it clamps them.
        let most = ColourBar::new(DENSITY, all.clone(), ValueRange::Quantiles(0.0, 0.99), Scale::Linear)?
            .range()
            .1;
        let range = ValueRange::Fixed(0.0, most.max(self.sequence.resolution_of_energy()));
        let bar = ColourBar::new(DENSITY, all, range, Scale::Linear)?.in_colours(self.args.section.colours());
        let panels = pictures.iter().map(|(title, file, densities)| {
            let panel = Panel::of_section(&self.section, densities, &bar)?
                .turned_if(self.args.section.up.is_upside_down())
                .titled(title);
            anyhow::Ok(file.iter().fold(panel, Panel::captioned))
        });
        let panels: Vec<Panel> = panels.collect::<Result<_, _>>()?;
        let rows: Vec<Vec<Panel>> = panels.chunks(3).map(<[Panel]>::to_vec).collect();
        let png = Figure::grid(rows)
            .titled(format!("Where {} is deformed", file_name(&self.args.reference)))
            .with_bar(&bar)
            .to_png()?;
        write_file(self.folder.join("sections.png"), &png)
    }
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}
