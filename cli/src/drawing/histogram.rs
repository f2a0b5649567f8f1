//! Histograms: columns over a logarithmic or linear axis, several fields over one another.

use super::DrawingError;
use super::canvas::{Canvas, GREY_INK, INK, Rgb, WHITE};
use super::colour_map::{Scale, widened};
use super::number::typeset;
use super::panel::{Panel, check_size};
use super::plot::{GRID, PlotArea};
use super::text::Anchor;
use super::ticks::{linear_ticks, logarithmic_ticks};

/// Columns along the axis.
const COLUMNS: usize = 60;
/// Most decades shown, down from the largest value.
const DECADES: f64 = 8.0;
/// Colours of the fields, in order.
const COLOURS: [Rgb; 3] = [[214, 96, 77], [67, 117, 180], [90, 160, 90]];

/// Fractions of values in intervals of equal ratio, or of equal length.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    label: String,
    scale: Scale,
    low: f64,
    high: f64,
    fields: Vec<Shares>,
    /// What values that are not positive are called in the legend.
    uncounted: String,
}

#[derive(Debug, Clone, PartialEq)]
struct Shares {
    name: String,
    /// Fraction of the values in each column.
    columns: Vec<f64>,
    /// Values that are not positive, or not finite.
    not_positive: usize,
}

impl Histogram {
    /// The distribution of fields with positive values, over a common logarithmic axis with this name. Values that are
    /// not positive or not finite are counted in the legend; those more than eight decades below the largest are in
    /// the first column.
    ///
    /// # Errors
    ///
    /// [`DrawingError::NoPositiveValue`] when no value is positive.
    pub fn logarithmic(label: impl Into<String>, fields: &[(&str, &[f64])]) -> Result<Self, DrawingError> {
        let label = label.into();
        let positive = |x: &&f64| x.is_finite() && **x > 0.0;
        let all = || fields.iter().flat_map(|(_, values)| values.iter()).filter(positive);
        let (Some(least), Some(most)) = (all().copied().reduce(f64::min), all().copied().reduce(f64::max)) else {
            return Err(DrawingError::NoPositiveValue { label });
        };
        let (low, high) = widened((least.max(most / 10f64.powf(DECADES)), most), Scale::Log);
        Ok(Self::over(label, fields, Scale::Log, [low, high]))
    }

    /// The distribution of fields over a linear axis from 0 to 1 with this name. Values that are not positive or not
    /// finite are counted in the legend; those above 1 are in the last column.
    pub fn from_0_to_1(label: impl Into<String>, fields: &[(&str, &[f64])]) -> Self {
        Self::over(label.into(), fields, Scale::Linear, [0.0, 1.0])
    }

    fn over(label: String, fields: &[(&str, &[f64])], scale: Scale, [low, high]: [f64; 2]) -> Self {
        let positive = |x: &&f64| x.is_finite() && **x > 0.0;
        let shares = |(name, values): &(&str, &[f64])| {
            let mut columns = vec![0.0; COLUMNS];
            let mut not_positive = 0;
            for value in values.iter() {
                if !positive(&value) {
                    not_positive += 1;
                    continue;
                }
                let along = match scale {
                    Scale::Log => (value / low).ln() / (high / low).ln(),
                    Scale::Linear => (value - low) / (high - low),
                };
                let column = ((along * COLUMNS as f64).max(0.0) as usize).min(COLUMNS - 1);
                columns[column] += 1.0 / values.len() as f64;
            }
            Shares {
                name: (*name).to_owned(),
                columns,
                not_positive,
            }
        };
        Self {
            fields: fields.iter().map(shares).collect(),
            label,
            scale,
            low,
            high,
            uncounted: "not positive".into(),
        }
    }

    /// The same, with values that are not positive called this in the legend.
    pub fn counting(mut self, uncounted: impl Into<String>) -> Self {
        self.uncounted = uncounted.into();
        self
    }
}

impl Panel {
    /// A histogram on `width × height` pixels, with its axes inside.
    ///
    /// # Errors
    ///
    /// [`DrawingError::TooSmall`] and [`DrawingError::TooLarge`].
    pub fn of_histogram(histogram: &Histogram, [width, height]: [usize; 2]) -> Result<Self, DrawingError> {
        check_size(width, height)?;
        let mut canvas = Canvas::new(width, height, WHITE);
        let em = (height as f64 / 34.0).max(9.0);
        let area = PlotArea {
            em,
            left: 4.0 * em,
            top: 1.5 * em,
            right: width as f64 - 1.5 * em,
            bottom: height as f64 - 3.6 * em,
        };
        let highest = histogram
            .fields
            .iter()
            .flat_map(|f| &f.columns)
            .fold(0.0, |a: f64, b| a.max(*b));
        let drawing = HistogramDrawing {
            histogram,
            area,
            // Room for the legend.
            highest: if highest > 0.0 { 1.2 * highest } else { 1.0 },
        };
        drawing.draw(&mut canvas);
        Ok(Self::of_canvas(canvas))
    }
}

struct HistogramDrawing<'a> {
    histogram: &'a Histogram,
    area: PlotArea,
    /// Share at the upper edge.
    highest: f64,
}

impl HistogramDrawing<'_> {
    fn draw(&self, canvas: &mut Canvas) {
        self.draw_axes(canvas);
        for (field, colour) in self.histogram.fields.iter().zip(COLOURS.into_iter().cycle()) {
            self.draw_columns(canvas, field, colour);
        }
        self.draw_legend(canvas);
    }

    fn height_of(&self, share: f64) -> f64 {
        self.area.height_of(share, self.highest)
    }

    fn draw_axes(&self, canvas: &mut Canvas) {
        let PlotArea { em, left, right, .. } = self.area;
        let text = self.area.text(INK);
        let up = linear_ticks(0.0, 100.0 * self.highest, 5);
        for (percent, label) in up.positions.iter().zip(&up.labels) {
            let y = self.height_of(percent / 100.0);
            canvas.stroke(&[[[left, y], [right, y]]], 1.0, GRID);
            let place = [left - 0.4 * em, y + text.cap_height() / 2.0];
            text.draw(canvas, &format!("{label} %"), place, Anchor::End);
        }
        let Histogram { low, high, label, .. } = self.histogram;
        match self.histogram.scale {
            Scale::Log => {
                let place = |value: f64| left + (value / low).ln() / (high / low).ln() * (right - left);
                let across = logarithmic_ticks(*low, *high, 8);
                self.area.draw_ticks_across(canvas, &across, place, label, 3.0);
            }
            Scale::Linear => {
                let place = |value: f64| left + (value - low) / (high - low) * (right - left);
                self.area
                    .draw_ticks_across(canvas, &linear_ticks(*low, *high, 6), place, label, 3.0);
            }
        }
        self.area.draw_axes(canvas);
    }

    fn draw_columns(&self, canvas: &mut Canvas, field: &Shares, colour: Rgb) {
        let PlotArea {
            left, right, bottom, ..
        } = self.area;
        let edge = |k: usize| left + k as f64 / COLUMNS as f64 * (right - left);
        let mut outline = Vec::new();
        let mut last = bottom;
        for (k, share) in field.columns.iter().enumerate() {
            let (from, to, y) = (edge(k), edge(k + 1), self.height_of(*share));
            for column in from.round() as i64..to.round() as i64 {
                (y.round() as i64..bottom.round() as i64).for_each(|row| canvas.blend(column, row, colour, 0.3));
            }
            outline.extend([[[from, last], [from, y]], [[from, y], [to, y]]]);
            last = y;
        }
        outline.push([[right, last], [right, bottom]]);
        canvas.stroke(&outline, 0.14 * self.area.em, colour);
    }

    fn draw_legend(&self, canvas: &mut Canvas) {
        let PlotArea { em, top, right, .. } = self.area;
        for (k, (field, colour)) in self
            .histogram
            .fields
            .iter()
            .zip(COLOURS.into_iter().cycle())
            .enumerate()
        {
            let y = top + (1.2 + 1.5 * k as f64) * em;
            let below = match field.not_positive {
                0 => "all positive".to_owned(),
                count => format!("{} {}", typeset(count as f64, 6), self.histogram.uncounted),
            };
            let text = format!("{}: {below}", field.name);
            let ink = self.area.text(if field.not_positive == 0 { GREY_INK } else { INK });
            ink.draw(canvas, &text, [right - 0.5 * em, y], Anchor::End);
            let x = right - 1.0 * em - ink.width(&text);
            let middle = y - ink.cap_height() / 2.0;
            canvas.stroke(&[[[x - 1.2 * em, middle], [x, middle]]], 0.5 * em, colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_counted_where_they_are() {
        let values = [1.0, 1.0, 100.0, -1.0, f64::NAN, 1e-30];
        let histogram = Histogram::logarithmic("det J", &[("a", &values), ("b", &[10.0])]).unwrap();
        assert_eq!(histogram.fields[0].not_positive, 2);
        let sum = |k: usize| histogram.fields[k].columns.iter().sum::<f64>();
        assert!((sum(0) - 4.0 / 6.0).abs() < 1e-15 && (sum(1) - 1.0).abs() < 1e-15);
        assert!((histogram.fields[0].columns[0] - 1.0 / 6.0).abs() < 1e-15, "far below");
        assert!((histogram.fields[0].columns[COLUMNS - 1] - 1.0 / 6.0).abs() < 1e-15);
        assert!(matches!(
            Histogram::logarithmic("x", &[("a", &[-1.0, f64::NAN])]),
            Err(DrawingError::NoPositiveValue { .. })
        ));
        assert!(Histogram::logarithmic("x", &[("a", &[3.0; 5])]).is_ok(), "one value");
        let linear = Histogram::from_0_to_1("x", &[("a", &[0.01, 0.5, 1.0, -0.2])]);
        assert_eq!(linear.fields[0].not_positive, 1);
        for column in [0, COLUMNS / 2, COLUMNS - 1] {
            assert!((linear.fields[0].columns[column] - 0.25).abs() < 1e-15);
        }
        assert!(Panel::of_histogram(&linear, [400, 300]).is_ok());
        let panel = Panel::of_histogram(&histogram, [400, 300]).unwrap();
        assert!(panel.canvas.pixels().iter().any(|p| *p != WHITE));
        assert!(matches!(
            Panel::of_histogram(&histogram, [4, 4]),
            Err(DrawingError::TooSmall { .. })
        ));
    }
}
