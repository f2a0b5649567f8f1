//! Reading, mapping and measuring frames, block by block.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::ensure;
use solidmap::boundary_map::BoundaryMap;
use solidmap::geometry::PlaneSection;
use solidmap::sequence::{CycleError, Cycles, FilledReference, FrameMeasurement, Sequence, SequencePhase, cycles};

use super::series::{Material, Series};
use super::summary::{FrameRow, MeasuredRow, SequenceTimings};
use crate::args::SequenceArgs;
use crate::shared::fields::MeshWithFields;
use crate::shared::fitting::show_phase;
use crate::shared::input;
use crate::shared::output::{Output, describe, with_option_names};
use crate::shared::pictures::largest_section;
use crate::shared::remeshing;

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 480;

/// What is gathered from all blocks: rows, and densities on the section of the frames to be shown.
pub struct Measurement<'a> {
    pub(super) args: &'a SequenceArgs,
    /// Where files are written.
    pub(super) folder: PathBuf,
    pub(super) output: &'a Output,
    pub(super) sequence: Sequence,
    /// With `--map bijective`.
    pub(super) filled: Option<FilledReference<'static>>,
    pub(super) section: PlaneSection,
    pub(super) rows: Vec<FrameRow>,
    /// Sum of the densities on the section over all frames, and how many there are.
    pub(super) sum: Vec<f64>,
    pub(super) measured: usize,
    /// Frames of `--show`, with their densities on the section.
    pub(super) shown: Vec<(usize, Vec<f64>)>,
    /// The frame of most energy, with its energy and densities.
    pub(super) most: Option<(usize, f64, Vec<f64>)>,
    pub(super) series: Option<Series>,
    pub(super) material: Option<Material>,
}

impl<'a> Measurement<'a> {
    pub fn new(
        args: &'a SequenceArgs,
        folder: &Path,
        sequence: Sequence,
        material: Option<MeshWithFields>,
        filled: Option<FilledReference<'static>>,
        output: &'a Output,
    ) -> anyhow::Result<Self> {
        let section = largest_section(&args.section, sequence.domain(), SECTION_PIXELS)?;
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
            filled,
            rows: Vec::new(),
            measured: 0,
            shown: Vec::new(),
            most: None,
            series,
            material,
        })
    }

    /// Number of frames to measure at once.
    pub fn frames_per_block(&self) -> usize {
        match &self.filled {
            Some(filled) => self.sequence.frames_per_block_of(filled),
            None => self.sequence.frames_per_block(),
        }
    }

    /// Reads, measures and writes some frames.
    pub fn block(&mut self, frames: Range<usize>, seconds: &mut SequenceTimings) -> anyhow::Result<()> {
        let start = Instant::now();
        let output = self.output;
        let name = format!(
            "frames {} to {} of {}: ",
            frames.start,
            frames.end - 1,
            self.args.frames.len()
        );
        output.progress(format!("{name}reading frames"));
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
        let measured = match &self.filled {
            None => self.sequence.measure(&maps, &|phase| show_phase(phase, &name, output)),
            Some(filled) => self.sequence.measure_bijective(filled, &maps, &|phase| match phase {
                SequencePhase::Fit(phase) => show_phase(phase, &name, output),
                SequencePhase::Repair { frame, phase } => {
                    let name = format!("{name}frame {}: ", numbers[frame]);
                    remeshing::show_phase(phase, &name, output);
                }
            }),
        };
        let mut found = Vec::new();
        for ((frame, map), measured) in numbers.into_iter().zip(&maps).zip(measured) {
            match measured {
                Ok(measured) => found.push((frame, map, measured)),
                Err(error) => unusable.push((frame, with_option_names(error))),
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
            self.add_row(*frame, Some(MeasuredRow::new(measured)), None);
        }
        for (frame, reason) in unusable {
            self.add_row(frame, None, Some(reason));
        }
        self.rows.sort_by_key(|row| row.frame);
        Ok(())
    }

    fn read(&self, frame: usize) -> Result<BoundaryMap, String> {
        let surface = input::read_image(&self.args.frames[frame], self.sequence.reference());
        let surface = surface.map_err(|error| describe(&error))?;
        self.sequence.frame(&surface).map_err(|error| error.to_string())
    }

    fn add_to_sections(&mut self, frames: &[(usize, &BoundaryMap, FrameMeasurement)]) {
        let measured: Vec<&FrameMeasurement> = frames.iter().map(|(_, _, measured)| measured).collect();
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

    fn add_to_series(&mut self, frames: &[(usize, &BoundaryMap, FrameMeasurement)]) -> anyhow::Result<()> {
        let fps = self.args.fps;
        if let Some(material) = &mut self.material {
            for (frame, _, measured) in frames {
                material.add((*frame, *frame as f64 / fps), &measured.map)?;
            }
        }
        let Some(series) = &mut self.series else { return Ok(()) };
        let measured: Vec<&FrameMeasurement> = frames.iter().map(|(_, _, measured)| measured).collect();
        let surfaces = self.sequence.densities_at(&measured, series.centroids());
        for ((frame, map, measured), surface) in frames.iter().zip(surfaces) {
            let time = *frame as f64 / fps;
            series.add((*frame, time), measured, map.image(), surface, &self.sequence)?;
        }
        Ok(())
    }

    fn add_row(&mut self, frame: usize, found: Option<MeasuredRow>, skipped: Option<String>) {
        let file = &self.args.frames[frame];
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
            file: file.into(),
            found,
            skipped,
        });
    }

    pub fn energies(&self) -> Vec<f64> {
        let energy = |row: &FrameRow| row.found.as_ref().map_or(f64::NAN, |found| found.deformation_energy);
        self.rows.iter().map(energy).collect()
    }

    pub fn cycles(&self) -> Result<Cycles, CycleError> {
        cycles(&self.energies(), self.sequence.resolution_of_energy())
    }

    /// Refuses a sequence of which no frame was measured.
    pub fn require_one_frame(&self) -> anyhow::Result<()> {
        ensure!(
            self.rows.iter().any(|row| row.found.is_some()),
            "none of the {} frames can be used; the first: {}",
            self.rows.len(),
            self.rows[0].skipped.as_deref().unwrap_or_default()
        );
        Ok(())
    }
}
