//! Drawing a colour bar: the ramp, its ticks, its name, and marks for values beyond its ends.

use super::canvas::{Canvas, GREY_INK, INK, RULE};
use super::colour_map::{ColourBar, Scale};
use super::number::typeset;
use super::plot::regular;
use super::text::{Anchor, TextStyle};
use super::ticks::{Ticks, linear_ticks, logarithmic_ticks};

/// Lengths in ems.
const RAMP: f64 = 1.0;
/// Between the picture and the ramp.
pub(super) const GAP: f64 = 1.2;
const TICK: f64 = 0.3;
const TIP: f64 = 0.8;
const LINE: f64 = 1.25;
const LEAST_HEIGHT: f64 = 9.0;

/// The layout of a colour bar beside a picture; it extends above and below a picture that is low.
pub(super) struct BarLayout<'a> {
    bar: &'a ColourBar,
    ticks: Ticks,
    name: Vec<String>,
    notes: Vec<String>,
    em: f64,
    /// Height of the ramp.
    height: f64,
    /// By how much the ramp extends above the picture, and below it.
    overhang: f64,
}

impl<'a> BarLayout<'a> {
    pub(super) fn new(bar: &'a ColourBar, em: f64, picture_height: f64) -> Self {
        let height = picture_height.max(LEAST_HEIGHT * em);
        let (low, high) = bar.range();
        let count = (height / (2.6 * em)).clamp(2.0, 8.0) as usize;
        let ticks = match bar.scale() {
            Scale::Linear => linear_ticks(low, high, count),
            Scale::Log => logarithmic_ticks(low, high, count),
        };
        let (least, most) = bar.data_range();
        let mut notes = vec![
            format!("max {}", typeset(most, 3)),
            format!("min {}", typeset(least, 3)),
        ];
        if let Some((from, to)) = bar.quantiles() {
            let percent = |p: f64| typeset(100.0 * p, 3);
            notes.push(format!("bar: {}–{} %", percent(from), percent(to)));
        }
        let mut layout = Self {
            bar,
            ticks,
            name: Vec::new(),
            notes,
            em,
            height,
            overhang: (height - picture_height) / 2.0,
        };
        layout.name = layout.text(INK).wrapped(bar.label(), height);
        layout
    }

    /// Width to the right of the picture.
    pub(super) fn width(&self) -> f64 {
        let ramp_and_labels = (RAMP + TICK + 0.3) * self.em + self.labels_width();
        let name = (0.4 + LINE * self.name.len() as f64) * self.em;
        let notes = self
            .notes
            .iter()
            .map(|note| self.note_text().width(note))
            .fold(0.0, f64::max);
        GAP * self.em + (ramp_and_labels + name).max(notes) + 0.2 * self.em
    }

    /// Height below the picture.
    pub(super) fn below(&self) -> f64 {
        self.overhang + (0.5 + LINE * self.notes.len() as f64) * self.em
    }

    /// Height above the picture.
    pub(super) fn above(&self) -> f64 {
        self.overhang
            + if self.ticks.factor.is_some() {
                1.6 * self.em
            } else {
                0.0
            }
    }

    /// Draws the bar beside a picture whose right edge is at `x` and whose top is at `y`.
    pub(super) fn draw(&self, canvas: &mut Canvas, x: f64, y: f64) {
        let y = (y - self.overhang).round();
        let left = (x + GAP * self.em).round();
        self.draw_ramp(canvas, left, y);
        let text = self.text(INK);
        let labels = left + (RAMP + TICK + 0.3) * self.em;
        for (position, label) in self.ticks.positions.iter().zip(&self.ticks.labels) {
            let height = self.tick_height(y, *position);
            let from = left + RAMP * self.em;
            canvas.stroke(&[[[from, height], [from + TICK * self.em, height]]], 1.0, RULE);
            text.draw(canvas, label, [labels, height + text.cap_height() / 2.0], Anchor::Start);
        }
        if let Some(factor) = &self.ticks.factor {
            text.draw(canvas, factor, [left, y - 0.6 * self.em], Anchor::Start);
        }
        for (k, line) in self.name.iter().enumerate() {
            let baseline = labels + self.labels_width() + (1.4 + LINE * k as f64) * self.em;
            text.draw_upward(canvas, line, [baseline, y + self.height / 2.0], Anchor::Middle);
        }
        for (k, note) in self.notes.iter().enumerate() {
            let baseline = y + self.height + (1.5 + LINE * k as f64) * self.em;
            self.note_text().draw(canvas, note, [left, baseline], Anchor::Start);
        }
    }

    /// The ramp, high values up; an end with values beyond it has a pointed tip.
    fn draw_ramp(&self, canvas: &mut Canvas, left: f64, top: f64) {
        let [upper, lower] = self.tips();
        let width = (RAMP * self.em).round();
        let rows = self.height.round();
        for row in 0..rows as i64 {
            let depth = row as f64 + 0.5;
            let share = (depth / upper).min((rows - depth) / lower).min(1.0);
            let colour = self.bar.colours().at(1.0 - (depth - upper) / (rows - upper - lower));
            for column in 0..width as i64 {
                let from_middle = (column as f64 + 0.5 - width / 2.0).abs();
                let covered = (share * width / 2.0 - from_middle + 0.5).clamp(0.0, 1.0);
                canvas.blend(left as i64 + column, top as i64 + row, colour, covered as f32);
            }
        }
    }

    fn tick_height(&self, top: f64, value: f64) -> f64 {
        let [upper, lower] = self.tips();
        top + upper + (1.0 - self.bar.fraction(value)) * (self.height - upper - lower)
    }

    /// Heights of the pointed tips at the upper and the lower end.
    fn tips(&self) -> [f64; 2] {
        let (low, high) = self.bar.range();
        let (least, most) = self.bar.data_range();
        [most > high, least < low].map(|beyond| if beyond { TIP * self.em } else { 0.0 })
    }

    fn labels_width(&self) -> f64 {
        let text = self.text(INK);
        self.ticks
            .labels
            .iter()
            .map(|label| text.width(label))
            .fold(0.0, f64::max)
    }

    fn text(&self, colour: [u8; 3]) -> TextStyle {
        regular(self.em, colour)
    }

    fn note_text(&self) -> TextStyle {
        TextStyle {
            size: 0.88 * self.em,
            ..self.text(GREY_INK)
        }
    }
}
