//! A curve over numbered frames or time.

use super::canvas::{Canvas, GREY_INK, INK, Rgb, WHITE};
use super::panel::{LEAST_SIDE, check_size};
use super::plot::{PlotArea, TICK, regular};
use super::text::{Anchor, TextStyle, Weight};
use super::ticks::{Ticks, linear_ticks};
use super::{DrawingError, png};

/// Red, as the energies in the paper's figures.
const CURVE: Rgb = [196, 30, 30];
const MARK: Rgb = [205, 214, 228];
/// With more points than this, none has a circle.
const MOST_CIRCLES: usize = 150;
/// Lengths in ems.
const CIRCLE: f64 = 0.32;

/// A line chart from zero up, with circles at its points.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    title: String,
    notes: Vec<String>,
    axes: [String; 2],
    points: Vec<[f64; 2]>,
    spans: Vec<[f64; 2]>,
    missing: Vec<f64>,
}

impl Chart {
    /// A chart of these points, whose first coordinates ascend, with the names of its axes. Points that are not finite
    /// leave a gap.
    pub fn new(points: Vec<[f64; 2]>, [across, up]: [&str; 2]) -> Self {
        Self {
            title: String::new(),
            notes: Vec::new(),
            axes: [across.to_owned(), up.to_owned()],
            points,
            spans: Vec::new(),
            missing: Vec::new(),
        }
    }

    /// The same chart under this title.
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// The same chart with one more line below the title.
    pub fn noted(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// The same chart with these intervals marked and numbered from 1.
    pub fn with_spans(mut self, spans: Vec<[f64; 2]>) -> Self {
        self.spans = spans;
        self
    }

    /// The same chart with crosses on its axis at these places, where values are missing.
    pub fn with_missing(mut self, places: Vec<f64>) -> Self {
        self.missing = places;
        self
    }

    /// The chart as the bytes of a PNG file (8-bit sRGB) of this size in pixels, texts included.
    ///
    /// # Errors
    ///
    /// [`DrawingError::NoFiniteValue`], [`DrawingError::TooSmall`] when the texts leave no room for the curve,
    /// [`DrawingError::TooLarge`], [`DrawingError::Encode`].
    pub fn to_png(&self, [width, height]: [usize; 2]) -> Result<Vec<u8>, DrawingError> {
        check_size(width, height)?;
        let finite = self.points.iter().filter(|p| p.iter().all(|c| c.is_finite()));
        let highest = finite.map(|p| p[1]).reduce(f64::max);
        let label = || self.axes[1].clone();
        let highest = highest.ok_or_else(|| DrawingError::NoFiniteValue { label: label() })?;
        let places = || {
            self.points
                .iter()
                .map(|p| p[0])
                .chain(self.missing.iter().copied())
                .filter(|x| x.is_finite())
        };
        let (low, high) = (
            places().fold(f64::INFINITY, f64::min),
            places().fold(f64::NEG_INFINITY, f64::max),
        );
        let margin = if high > low { 0.02 * (high - low) } else { 0.5 };
        let top = if highest > 0.0 { 1.1 * highest } else { 1.0 };
        let mut canvas = Canvas::new(width, height, WHITE);
        let drawing = ChartDrawing::new(self, [width, height], [low - margin, high + margin], top);
        let PlotArea {
            left,
            top,
            right,
            bottom,
            ..
        } = drawing.area;
        if right - left < LEAST_SIDE as f64 || bottom - top < LEAST_SIDE as f64 {
            return Err(DrawingError::TooSmall { least: LEAST_SIDE });
        }
        drawing.draw(&mut canvas);
        png::encode(&canvas)
    }
}

/// A chart with the positions of its axes.
struct ChartDrawing<'a> {
    chart: &'a Chart,
    area: PlotArea,
    /// Values at the left and right edge.
    across: [f64; 2],
    /// Value at the upper edge.
    highest: f64,
    ticks: [Ticks; 2],
    /// Width of the picture.
    width: f64,
    notes: Vec<String>,
}

impl<'a> ChartDrawing<'a> {
    fn new(chart: &'a Chart, [width, height]: [usize; 2], across: [f64; 2], highest: f64) -> Self {
        let (width, height) = (width as f64, height as f64);
        let em = (width.min(1.6 * height) / 52.0).max(9.0);
        let text = regular(em, INK);
        let notes: Vec<String> = chart
            .notes
            .iter()
            .flat_map(|note| text.wrapped(note, width - 2.0 * em))
            .collect();
        let top = (2.6 + 1.4 * notes.len() as f64 + if chart.spans.is_empty() { 0.4 } else { 1.6 }) * em;
        let bottom = height - 4.2 * em;
        let up = linear_ticks(0.0, highest, ((bottom - top) / (3.0 * em)).clamp(2.0, 8.0) as usize);
        let widest = up.labels.iter().map(|label| text.width(label)).fold(0.0, f64::max);
        let left = widest + (TICK + 2.8) * em;
        let right = width - 1.5 * em;
        let most = ((right - left) / (5.0 * em)).clamp(2.0, 16.0);
        // Frame numbers are whole.
        let is_whole = chart.points.iter().all(|p| p[0].fract() == 0.0);
        let most = if is_whole {
            most.min((across[1] - across[0]).ceil())
        } else {
            most
        };
        Self {
            chart,
            area: PlotArea {
                em,
                left,
                top,
                right,
                bottom,
            },
            across,
            highest,
            ticks: [linear_ticks(across[0], across[1], most as usize), up],
            width,
            notes,
        }
    }

    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let PlotArea { left, right, .. } = self.area;
        let [low, high] = self.across;
        [
            left + (x - low) / (high - low) * (right - left),
            self.area.height_of(y, self.highest),
        ]
    }

    fn draw(&self, canvas: &mut Canvas) {
        self.draw_spans(canvas);
        self.draw_axes(canvas);
        self.draw_curve(canvas);
        let title = TextStyle {
            size: 1.25 * self.area.em,
            weight: Weight::Bold,
            colour: INK,
        };
        title.draw(
            canvas,
            &self.chart.title,
            [self.width / 2.0, 1.9 * self.area.em],
            Anchor::Middle,
        );
        for (k, note) in self.notes.iter().enumerate() {
            let baseline = (3.5 + 1.4 * k as f64) * self.area.em;
            self.area
                .text(GREY_INK)
                .draw(canvas, note, [self.width / 2.0, baseline], Anchor::Middle);
        }
    }

    /// Marks the spans, and numbers those with room for it.
    fn draw_spans(&self, canvas: &mut Canvas) {
        let PlotArea {
            left,
            top,
            right,
            bottom,
            ..
        } = self.area;
        let text = regular(0.9 * self.area.em, GREY_INK);
        for (k, span) in self.chart.spans.iter().enumerate() {
            let [from, to] = span.map(|x| self.place([x, 0.0])[0]);
            let [begin, end] = [from, to].map(|x| x.clamp(left, right));
            if k % 2 == 0 {
                let tint: Rgb = [244, 247, 251];
                let columns = begin.round() as i64..end.round() as i64;
                for row in top.round() as i64..bottom.round() as i64 {
                    columns.clone().for_each(|column| canvas.blend(column, row, tint, 1.0));
                }
            }
            for x in [from, to].into_iter().filter(|x| (left..=right).contains(x)) {
                canvas.stroke(&[[[x, top], [x, bottom]]], 1.5, MARK);
            }
            let name = (k + 1).to_string();
            if end - begin > 1.5 * text.width(&name) {
                text.draw(
                    canvas,
                    &name,
                    [(begin + end) / 2.0, top - 0.5 * self.area.em],
                    Anchor::Middle,
                );
            }
        }
    }

    fn draw_axes(&self, canvas: &mut Canvas) {
        let [across, up] = &self.ticks;
        let [name_across, name_up] = &self.chart.axes;
        let height = |value: f64| self.place([0.0, value])[1];
        self.area.draw_ticks_up(canvas, up, height, name_up);
        let place = |value: f64| self.place([value, 0.0])[0];
        self.area
            .draw_ticks_across(canvas, across, place, name_across, TICK + 2.9);
        self.area.draw_axes(canvas);
    }

    fn draw_curve(&self, canvas: &mut Canvas) {
        let is_there = |p: &[f64; 2]| p.iter().all(|c| c.is_finite());
        for run in self.chart.points.chunk_by(|a, b| is_there(a) && is_there(b)) {
            let places: Vec<[f64; 2]> = run.iter().filter(|p| is_there(p)).map(|&p| self.place(p)).collect();
            let segments: Vec<[[f64; 2]; 2]> = places.windows(2).map(|pair| [pair[0], pair[1]]).collect();
            if !segments.is_empty() {
                canvas.stroke(&segments, 0.12 * self.area.em, CURVE);
            }
            if self.chart.points.len() <= MOST_CIRCLES || segments.is_empty() {
                for &place in &places {
                    // A stroke of no length is a disc.
                    canvas.stroke(&[[place, place]], 2.0 * CIRCLE * self.area.em, CURVE);
                    canvas.stroke(&[[place, place]], 1.2 * CIRCLE * self.area.em, WHITE);
                }
            }
        }
        for &x in self.chart.missing.iter().filter(|x| x.is_finite()) {
            self.area.draw_missing(canvas, self.place([x, 0.0])[0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::png::decode;
    use super::*;

    fn drawn(points: Vec<[f64; 2]>) -> Canvas {
        decode(&Chart::new(points, ["frame", "energy"]).to_png([640, 400]).unwrap())
    }

    /// Pixels in the colour of the curve: lowest and highest column and row.
    fn reddest(canvas: &Canvas) -> [usize; 4] {
        let mut found = [usize::MAX, 0, usize::MAX, 0];
        for (x, y) in (0..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y))) {
            let [r, g, _] = canvas.get(x, y);
            if r > 150 && g < 90 {
                found = [found[0].min(x), found[1].max(x), found[2].min(y), found[3].max(y)];
            }
        }
        found
    }

    #[test]
    fn the_curve_spans_the_frame_and_higher_is_higher() {
        let canvas = drawn(vec![[0.0, 0.0], [1.0, 1.0], [2.0, 0.2]]);
        let [left, right, top, bottom] = reddest(&canvas);
        assert!(
            left < 120 && right > 580 && top < 110 && bottom > 320,
            "{left} {right} {top} {bottom}"
        );
        let low = drawn(vec![[0.0, 1.0], [1.0, 1.0]]);
        let [_, _, top, bottom] = reddest(&low);
        assert!(bottom - top < 20);
    }

    #[test]
    fn a_gap_stays_empty_and_a_chart_of_nothing_is_refused() {
        let canvas = drawn(vec![[0.0, 1.0], [1.0, 1.0], [2.0, f64::NAN], [3.0, 1.0], [4.0, 1.0]]);
        let [left, right, top, bottom] = reddest(&canvas);
        let middle = (left + right) / 2;
        assert!((top..=bottom).all(|y| canvas.get(middle, y)[1] > 90));
        for none in [vec![], vec![[0.0, f64::NAN]]] {
            let chart = Chart::new(none, ["frame", "energy"]);
            assert!(matches!(
                chart.to_png([640, 400]),
                Err(DrawingError::NoFiniteValue { .. })
            ));
        }
        let lone = Chart::new(vec![[3.0, 0.0]], ["frame", "energy"])
            .with_spans(vec![[0.0, 9.0]])
            .with_missing(vec![1.0]);
        assert!(lone.to_png([640, 400]).is_ok());
        assert!(matches!(lone.to_png([4, 4]), Err(DrawingError::TooSmall { .. })));
    }

    #[test]
    fn a_picture_without_room_between_its_texts_is_refused() {
        let chart = Chart::new(vec![[0.0, 1.0], [9.0, 2.0]], ["frame", "energy"])
            .noted("a note that takes lines")
            .with_spans(vec![[0.0, 3.0], [3.0, 6.0]]);
        for size in [[16, 16], [40, 40], [40, 400], [400, 40]] {
            let drawn = chart.to_png(size);
            assert!(matches!(drawn, Err(DrawingError::TooSmall { .. })), "{size:?}");
        }
        assert!(chart.to_png([200, 200]).is_ok());
    }
}
