//! The page of a sequence: its frames' surfaces played one after another, and curves of what was measured of them.
//!
//! The frames are read from the collection that `solidmap sequence` writes for ParaView, or from that of another program;
//! what was measured comes from the table beside it. Where all frames would make the page too large, some are left out.

mod collection;
mod energies;

use std::path::Path;

use anyhow::ensure;
use serde::Serialize;
use solidmap::energy::Lame;
use solidmap::files::Provenance;
use solidmap::geometry::Axis;
use solidmap::io::SurfaceFields;
use solidmap::sequence::cycles;
use solidmap::statistics::quantiles;
use solidmap::{Point, Vector};

use super::input;
use super::page::{Framing, NumberTable, PackedArray, Page, PageField, Palette, megabytes};
use super::places::percent;
use crate::args::{PageSizeArgs, UpKind};
use crate::drawing::significant;
use collection::{Collection, SURFACES};
use energies::{EnergyRow, QUANTITIES, TABLE};

pub use collection::is_sequence;

/// Most values that the ends of a colour scale are found from.
const MOST_VALUES: usize = 2_000_000;
/// Name of the field of densities in the frames of `solidmap sequence`.
const DENSITY: &str = "deformation_energy";

/// A page of a sequence.
pub struct MadeSequencePage {
    /// Its text.
    pub html: String,
    /// Frames that can be shown.
    pub frames: usize,
    /// Frames that are in the page: fewer where it would be too large.
    pub shown: usize,
    /// Triangles of each.
    pub faces: usize,
}

/// What the scripts of the page read, besides the arrays: `frame-N`, the vertices of the N-th frame that is shown, and
/// `frame-N-FIELD`.
#[derive(Serialize)]
struct SequenceContent<'a> {
    kind: &'static str,
    framing: Framing,
    up: (usize, bool),
    fields: Vec<SequenceField>,
    /// Every frame that is known, also those without a surface.
    rows: &'a [EnergyRow],
    /// The rows of the frames that are shown.
    shown: &'a [usize],
    curves: Vec<Curve>,
    /// First rows of cycles, and of what follows them.
    cycles: Vec<[f64; 2]>,
    /// What is along the curves.
    across: &'static str,
    /// Whether places in the reference are those of the first frame.
    from_first: bool,
}

#[derive(Serialize)]
struct SequenceField {
    #[serde(flatten)]
    field: PageField,
    /// `vertices`, `triangles`, or `displacement` for what the page calculates.
    over: &'static str,
}

#[derive(Serialize)]
struct Curve {
    label: &'static str,
    meaning: &'static str,
    /// For each row; null where there is none.
    values: Vec<f64>,
}

/// What is known of all frames.
struct Sequence<'a> {
    collection: Collection,
    name: String,
    first: SurfaceFields,
    rows: Vec<EnergyRow>,
    /// The row of each step of the collection.
    row_of: Vec<usize>,
    is_measured: bool,
    files: &'a [Provenance],
    up: UpKind,
}

/// The page of a folder that `solidmap sequence` has written, or of a collection; `files` are what it comes from besides.
pub fn make(path: &Path, files: &[Provenance], up: UpKind, args: &PageSizeArgs) -> anyhow::Result<MadeSequencePage> {
    let sequence = Sequence::read(path, files, up)?;
    let frames = sequence.collection.steps.len();
    let made = |html: String, shown| MadeSequencePage {
        html,
        frames,
        shown,
        faces: sequence.first.surface.triangles().len(),
    };
    // Two sizes tell what a frame takes; the last one counts, too: the first is often undeformed, and packs well.
    let ends = sequence.spread(3);
    let (bare, few) = (sequence.html(&ends[..1])?.len() as f64, sequence.html(&ends)?);
    let each = (few.len() as f64 - bare) / (ends.len() - 1).max(1) as f64;
    let room = (args.max_size as f64 - bare) / each.max(1.0);
    let mut count = frames.min(1 + room.max(0.0) as usize).max(frames.min(2));
    loop {
        let html = match count == ends.len() {
            true => few.clone(),
            false => sequence.html(&sequence.spread(count))?,
        };
        let size = html.len() as u64;
        if size <= args.max_size {
            return Ok(made(html, count));
        }
        ensure!(
            count > 2,
            "the page of `{}` takes {:.1} MB even with {count} of its {frames} frames, but --max-size is {:.1} MB; allow more",
            sequence.collection.path.display(),
            megabytes(size),
            megabytes(args.max_size)
        );
        let fitting = count as f64 * args.max_size as f64 / size as f64;
        count = (fitting as usize).clamp(2, count - 1);
    }
}

impl<'a> Sequence<'a> {
    fn read(path: &Path, files: &'a [Provenance], up: UpKind) -> anyhow::Result<Self> {
        let collection = Collection::read(path)?;
        let table = collection.path.with_file_name(TABLE);
        let is_ours = collection.path.file_name().is_some_and(|name| name == SURFACES);
        let is_measured = is_ours && table.is_file();
        let rows = match is_measured {
            true => energies::read(&table)?,
            false => unmeasured(&collection),
        };
        let row_of = collection.steps.iter().map(|(time, file)| {
            let found = rows.binary_search_by(|row| row.time.total_cmp(time));
            found.map_err(|_| {
                anyhow::anyhow!(
                    "`{}` has no row for the time {time} of `{}`: the two are not of one run; run `solidmap sequence` again",
                    table.display(),
                    file.display()
                )
            })
        });
        let row_of = row_of.collect::<anyhow::Result<_>>()?;
        let name = path.file_name().unwrap_or(path.as_os_str());
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            first: collection.frame(0, None)?,
            collection,
            rows,
            row_of,
            is_measured,
            files,
            up,
        })
    }

    /// So many steps, evenly from the first to the last; that of most energy stands for its nearest neighbour.
    fn spread(&self, count: usize) -> Vec<usize> {
        let frames = self.collection.steps.len();
        if count >= frames {
            return (0..frames).collect();
        }
        let last = count.saturating_sub(1).max(1);
        let mut chosen: Vec<usize> = (0..count).map(|k| k * (frames - 1) / last).collect();
        let energy = |step: &usize| self.rows[self.row_of[*step]].values.first().copied();
        let most = (0..frames).filter(|step| energy(step).is_some_and(|e| e.is_finite()));
        let most = most.max_by(|a, b| energy(a).unwrap_or_default().total_cmp(&energy(b).unwrap_or_default()));
        if let Some(most) = most
            && let Some(nearest) = (1..last).min_by_key(|&k| chosen[k].abs_diff(most))
            && !chosen.contains(&most)
        {
            chosen[nearest] = most;
        }
        chosen
    }

    /// The page with some of the frames.
    fn html(&self, steps: &[usize]) -> anyhow::Result<String> {
        let (reference, is_given) = collection::reference(&self.first);
        // Coordinates relative to the reference keep their digits in single precision, wherever it is.
        let origin = reference.first().map_or(Vector::zeros(), |point| point.coords);
        let mut frames = Vec::new();
        for &step in steps {
            let frame = match step {
                0 => self.first.clone(),
                _ => self.collection.frame(step, Some(&self.first))?,
            };
            let places: Vec<[f32; 3]> = frame.surface.vertices().iter().map(|p| single(p, &origin)).collect();
            frames.push((places, collection::scalars(frame)));
        }
        let around = |place: &[f32; 3]| Point::from(place.map(f64::from)) + origin;
        let ends: Vec<Point> = frames
            .iter()
            .flat_map(|(places, _)| corners(places))
            .map(|p| around(&p))
            .collect();
        let framing = Framing::of(ends.iter().chain(&reference));

        let mut arrays = vec![
            PackedArray::floats("reference", framing.place(&reference)),
            PackedArray::indices("triangles", self.first.surface.triangles().iter().flatten().copied()),
        ];
        let mut displacement = Sampled::new(frames.len(), reference.len());
        let mut fields = Vec::new();
        let names: Vec<String> = frames
            .first()
            .map(|(_, scalars)| scalars.iter().map(|f| f.name.clone()).collect())
            .unwrap_or_default();
        let mut moved = vec![f64::NAN; self.rows.len()];
        for (n, (places, _)) in frames.iter().enumerate() {
            let places: Vec<Point> = places.iter().map(around).collect();
            let distances = || places.iter().zip(&reference).map(|(a, b)| (a - b).norm());
            displacement.extend(distances());
            let squares: f64 = distances().map(|distance| distance * distance).sum();
            moved[self.row_of[steps[n]]] = (squares / places.len().max(1) as f64).sqrt();
            arrays.push(PackedArray::floats(format!("frame-{n}"), framing.place(&places)));
        }
        for (k, name) in names.iter().enumerate() {
            let of = |scalars: &[solidmap::io::Field]| scalars.iter().position(|field| field.name == *name);
            let found: Option<Vec<&solidmap::io::Field>> =
                frames.iter().map(|(_, scalars)| Some(&scalars[of(scalars)?])).collect();
            let triangles = self.first.surface.triangles().len();
            // A field that some frames lack cannot be played.
            let Some(found) = found.filter(|all| all.iter().all(|field| field.values.len() == all[0].values.len()))
            else {
                continue;
            };
            let mut sampled = Sampled::new(frames.len(), found[0].values.len());
            for (n, field) in found.iter().enumerate() {
                sampled.extend(field.values.iter().copied());
                arrays.push(PackedArray::floats(
                    format!("frame-{n}-file-{k}"),
                    field.values.iter().copied(),
                ));
            }
            let (label, meaning) = match name.as_str() {
                DENSITY if self.is_measured => (
                    "deformation energy density".to_owned(),
                    "½ σ : ε of the map of the frame, in the middle of each triangle".to_owned(),
                ),
                _ => (name.clone(), format!("`{name}` of the files")),
            };
            let over = if found[0].values.len() == triangles {
                "triangles"
            } else {
                "vertices"
            };
            fields.push(SequenceField {
                field: sampled.field(format!("file-{k}"), label, meaning, ""),
                over,
            });
        }
        let from = if is_given { "the reference" } else { "the first frame" };
        fields.push(SequenceField {
            field: displacement.field(
                "displacement".into(),
                "displacement".into(),
                format!("distance from the place in {from}, motion as a whole included"),
                "model units",
            ),
            over: "displacement",
        });

        let energies: Vec<f64> = self
            .rows
            .iter()
            .map(|row| row.values.first().copied().unwrap_or(f64::NAN))
            .collect();
        let found = cycles(&energies, Lame::default().negligible_density()).ok();
        let shown: Vec<usize> = steps.iter().map(|&step| self.row_of[step]).collect();
        let content = SequenceContent {
            kind: "sequence",
            framing,
            up: (Axis::from(self.up).index(), self.up.is_upside_down()),
            fields,
            curves: self.curves(moved),
            rows: &self.rows,
            shown: &shown,
            cycles: found
                .as_ref()
                .map(|found| found.spans(self.rows.len()))
                .unwrap_or_default(),
            across: match self.rows.iter().all(|row| row.time == row.frame as f64) {
                true => "frame",
                false => "time",
            },
            from_first: !is_given,
        };
        let page = Page {
            title: format!("{}: sequence of {} frames", self.name, self.rows.len()),
            files: self.files(steps)?,
            notes: self.notes(steps.len(), is_given),
            tables: vec![self.numbers(steps.len(), found.as_ref())],
            arrays,
        };
        Ok(page.html(&content)?)
    }

    fn curves(&self, moved: Vec<f64>) -> Vec<Curve> {
        let mut curves = vec![];
        if self.is_measured {
            curves.extend(QUANTITIES.iter().enumerate().map(|(k, quantity)| Curve {
                label: quantity.label,
                meaning: quantity.meaning,
                values: self.rows.iter().map(|row| row.values[k]).collect(),
            }));
        }
        curves.push(Curve {
            label: "displacement",
            meaning: "root mean square over the vertices, of the frames in this page",
            values: moved,
        });
        curves
    }

    fn files(&self, steps: &[usize]) -> anyhow::Result<Vec<Provenance>> {
        let mut files = self.files.to_vec();
        files.push(input::provenance("collection", &self.collection.path)?);
        if self.is_measured {
            files.push(input::provenance("table", &self.collection.path.with_file_name(TABLE))?);
        }
        for &step in steps {
            files.push(input::provenance("surface", &self.collection.steps[step].1)?);
        }
        Ok(files)
    }

    fn notes(&self, shown: usize, is_given: bool) -> Vec<String> {
        let mut notes = vec![];
        let frames = self.collection.steps.len();
        if shown < frames {
            notes.push(format!(
                "{shown} of {frames} surfaces are in this page, evenly spaced, so that it keeps to --max-size; curves have all \
                 frames."
            ));
        }
        let skipped = self.rows.iter().filter(|row| !row.skipped.is_empty()).count();
        if skipped > 0 {
            notes.push(format!(
                "{skipped} frames could not be used, and are marked by × below the curve."
            ));
        }
        if !self.is_measured {
            notes.push(format!(
                "There are no energies: `{TABLE}` of `solidmap sequence` is not beside the collection."
            ));
        }
        if !is_given {
            notes.push(
                "The files do not say where vertices are in a reference: displacements are from the first frame."
                    .into(),
            );
        }
        notes
    }

    fn numbers(&self, shown: usize, cycles: Option<&solidmap::sequence::Cycles>) -> NumberTable {
        let mut table = NumberTable::new("Sequence");
        let surface = &self.first.surface;
        table.row(
            "frames",
            self.rows.len().to_string(),
            "",
            "also those that could not be used",
        );
        table.row("frames in this page", shown.to_string(), "", "");
        table.row("vertices", surface.vertices().len().to_string(), "", "of each surface");
        table.row(
            "triangles",
            surface.triangles().len().to_string(),
            "",
            "the same in all frames",
        );
        if !self.is_measured {
            return table;
        }
        let measured = || self.rows.iter().filter(|row| row.skipped.is_empty());
        let mut extreme = |name: &str, k: usize, largest: bool, value: fn(f64) -> String, meaning: &str| {
            let of = |row: &&EnergyRow| row.values[k];
            let found = match largest {
                true => measured().max_by(|a, b| of(a).total_cmp(&of(b))),
                false => measured().min_by(|a, b| of(a).total_cmp(&of(b))),
            };
            if let Some(row) = found {
                let frame = format!("{} (frame {}, {})", value(row.values[k]), row.frame, row.file);
                table.row(name, frame, "", meaning);
            }
        };
        let four = |value: f64| significant(value, 4);
        extreme("deformation energy, least", 0, false, four, QUANTITIES[0].meaning);
        extreme("deformation energy, largest", 0, true, four, "");
        extreme("harmonic energy, largest", 1, true, four, QUANTITIES[1].meaning);
        extreme(
            "boundary error, largest",
            3,
            true,
            |value| format!("{value:.2e}"),
            QUANTITIES[3].meaning,
        );
        extreme("folded share, largest", 4, true, percent, QUANTITIES[4].meaning);
        let (count, meaning) = match cycles {
            Some(found) => (
                found.whole().to_string(),
                format!(
                    "of {} frames; correlation {:.2}",
                    significant(found.period, 3),
                    found.strength
                ),
            ),
            None => (
                "none".into(),
                "the deformation energy does not repeat, or there are fewer than ten frames".into(),
            ),
        };
        table.row("cycles", count, "", meaning);
        table
    }
}

/// Rows of frames of which nothing was measured.
fn unmeasured(collection: &Collection) -> Vec<EnergyRow> {
    let rows = collection
        .steps
        .iter()
        .enumerate()
        .map(|(frame, (time, file))| EnergyRow {
            frame,
            time: *time,
            file: file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            values: vec![],
            skipped: String::new(),
        });
    rows.collect()
}

fn single(point: &Point, origin: &Vector) -> [f32; 3] {
    let moved = point - origin;
    [moved.x as f32, moved.y as f32, moved.z as f32]
}

/// Two corners of the box of some places.
fn corners(places: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let start = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    places.iter().fold(start, |[low, high], place| {
        [
            std::array::from_fn(|k| low[k].min(place[k])),
            std::array::from_fn(|k| high[k].max(place[k])),
        ]
    })
}

/// Values of all frames, thinned out, to find the ends of a colour scale.
struct Sampled {
    stride: usize,
    values: Vec<f64>,
    largest: f64,
}

impl Sampled {
    fn new(frames: usize, each: usize) -> Self {
        Self {
            stride: (frames * each).div_ceil(MOST_VALUES).max(1),
            values: vec![],
            largest: f64::NEG_INFINITY,
        }
    }

    fn extend(&mut self, values: impl Iterator<Item = f64>) {
        for (n, value) in values.enumerate().filter(|(_, value)| value.is_finite()) {
            self.largest = self.largest.max(value);
            if n % self.stride == 0 {
                self.values.push(value);
            }
        }
    }

    /// An amount, coloured from 0, or from the least value where there are negative ones, to what 99 % keep to.
    fn field(self, key: String, label: String, meaning: String, unit: &'static str) -> PageField {
        let [least, most] = quantiles(&self.values, [0.0, 0.99]).unwrap_or_default();
        let low = least.min(0.0);
        PageField {
            key: key.into(),
            label: label.into(),
            unit,
            meaning: meaning.into(),
            palette: Palette::Amount,
            logarithmic: false,
            low,
            high: if most > low { most } else { low + 1.0 },
            clamps: self.largest > most,
        }
    }
}
