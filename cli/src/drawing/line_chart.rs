//! Several curves over one quantity, with linear or logarithmic axes.

use super::DrawingError;
use super::canvas::{Canvas, GREY_INK, INK, Rgb, WHITE};
use super::colour_map::{Scale, widened};
use super::panel::{Panel, check_size};
use super::plot::{PlotArea, TICK, regular};
use super::text::{Anchor, TextStyle};
use super::ticks::{Ticks, linear_ticks, logarithmic_ticks};

/// Colours that are told apart also by those who see few (Okabe & Ito 2008).
const COLOURS: [Rgb; 6] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [204, 147, 0],
    [86, 180, 233],
];
/// Lengths in ems: the radius of a circle, a dash and the gap after it, a line of the legend, the line beside a name.
const CIRCLE: f64 = 0.3;
const DASH: [f64; 2] = [0.55, 0.4];
const LEGEND_LINE: f64 = 1.4;
const SWATCH: f64 = 1.6;

/// One curve of a [`LineChart`].
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its name in the legend; curves without one are not in it.
    pub name: String,
    /// Its points, in ascending order along the horizontal axis. Points that the axes cannot show leave a gap.
    pub points: Vec<[f64; 2]>,
    /// Which of the colours it has; curves of one number have one colour.
    pub colour: usize,
    /// Whether it is dashed, without circles at its points.
    pub dashed: bool,
}

/// Curves in a frame with an axis below and one at the left, and a legend above where curves have names.
#[derive(Debug, Clone, PartialEq)]
pub struct LineChart {
    axes: [String; 2],
    scales: [Scale; 2],
    curves: Vec<Curve>,
    missing: Vec<f64>,
    heights: Option<[f64; 2]>,
}

impl LineChart {
    /// A chart of these curves, with the names and the scales of its axes, horizontal and vertical.
    pub fn new(curves: Vec<Curve>, [across, up]: [&str; 2], scales: [Scale; 2]) -> Self {
        Self {
            axes: [across.to_owned(), up.to_owned()],
            scales,
            curves,
            missing: Vec::new(),
            heights: None,
        }
    }

    /// The same chart with crosses on its lower edge at these places, where values are missing.
    pub fn with_missing(mut self, places: Vec<f64>) -> Self {
        self.missing = places;
        self
    }

    /// The same chart with values from `low` to `high` along its vertical axis, for charts that are compared.
    pub fn with_heights(mut self, heights: [f64; 2]) -> Self {
        self.heights = Some(heights);
        self
    }

    /// The least and the largest value along an axis that its scale can show, widened where they are the same.
    fn range(&self, axis: usize) -> Option<[f64; 2]> {
        let points = self.curves.iter().flat_map(|curve| curve.points.iter());
        let values = points.filter(|p| self.is_shown(p)).map(|p| p[axis]);
        let missing = self.missing.iter().copied().filter(|x| x.is_finite() && axis == 0);
        let values: Vec<f64> = values.chain(missing).collect();
        let (low, high) = (
            values.iter().copied().reduce(f64::min)?,
            values.iter().copied().reduce(f64::max)?,
        );
        let (low, high) = widened((low, high), self.scales[axis]);
        Some([low, high])
    }

    fn is_shown(&self, point: &[f64; 2]) -> bool {
        let fits = |(value, scale): (&f64, Scale)| value.is_finite() && (scale == Scale::Linear || *value > 0.0);
        point.iter().zip(self.scales).all(fits)
    }
}

impl Panel {
    /// A chart of this size in pixels. One without any value says so.
    ///
    /// # Errors
    ///
    /// [`DrawingError::TooSmall`], [`DrawingError::TooLarge`].
    pub fn of_line_chart(chart: &LineChart, [width, height]: [usize; 2]) -> Result<Self, DrawingError> {
        check_size(width, height)?;
        let mut canvas = Canvas::new(width, height, WHITE);
        let em = (width as f64 / 36.0).min(height as f64 / 22.0).max(9.0);
        match (chart.range(0), chart.heights.or_else(|| chart.range(1))) {
            (Some(across), Some(up)) => {
                LineChartDrawing::new(chart, [width, height], em, [across, up]).draw(&mut canvas);
            }
            _ => {
                let middle = [width as f64 / 2.0, height as f64 / 2.0];
                let text = format!("{}: no value", chart.axes[1]);
                regular(em, GREY_INK).draw(&mut canvas, &text, middle, Anchor::Middle);
            }
        }
        Ok(Self::of_canvas(canvas))
    }
}

/// A chart with the positions of its axes.
struct LineChartDrawing<'a> {
    chart: &'a LineChart,
    area: PlotArea,
    /// Values at the left and right edge, and at the lower and upper one.
    ends: [[f64; 2]; 2],
    ticks: [Ticks; 2],
    legend: Vec<Vec<&'a Curve>>,
}

impl<'a> LineChartDrawing<'a> {
    fn new(chart: &'a LineChart, [width, height]: [usize; 2], em: f64, ranges: [[f64; 2]; 2]) -> Self {
        let (width, height) = (width as f64, height as f64);
        let text = regular(0.9 * em, INK);
        let legend = legend(chart, &text, em, width - 3.0 * em);
        let ends = [0, 1].map(|axis| with_margins(ranges[axis], chart.scales[axis], [0.04, 0.08][axis]));
        let (top, bottom) = ((0.8 + LEGEND_LINE * legend.len() as f64) * em, height - 3.8 * em);
        let up = ticks(ends[1], chart.scales[1], (bottom - top) / (2.4 * em));
        let widest = up
            .labels
            .iter()
            .map(|label| regular(em, INK).width(label))
            .fold(0.0, f64::max);
        let (left, right) = (widest + (TICK + 2.6) * em, width - 1.2 * em);
        Self {
            chart,
            area: PlotArea {
                em,
                left,
                top,
                right,
                bottom,
            },
            ends,
            ticks: [ticks(ends[0], chart.scales[0], (right - left) / (4.0 * em)), up],
            legend,
        }
    }

    fn place(&self, point: [f64; 2]) -> [f64; 2] {
        let PlotArea {
            left,
            top,
            right,
            bottom,
            ..
        } = self.area;
        let along = |axis: usize| {
            let [low, high] = self.ends[axis];
            match self.chart.scales[axis] {
                Scale::Linear => (point[axis] - low) / (high - low),
                Scale::Log => (point[axis] / low).ln() / (high / low).ln(),
            }
        };
        [left + along(0) * (right - left), bottom - along(1) * (bottom - top)]
    }

    fn draw(&self, canvas: &mut Canvas) {
        let [across, up] = &self.ticks;
        let [name_across, name_up] = &self.chart.axes;
        let [left, low] = self.ends.map(|ends| ends[0]);
        self.area
            .draw_ticks_up(canvas, up, |value| self.place([left, value])[1], name_up);
        self.area.draw_ticks_across(
            canvas,
            across,
            |value| self.place([value, low])[0],
            name_across,
            TICK + 2.7,
        );
        self.area.draw_axes(canvas);
        self.draw_legend(canvas);
        // The first curve is on top.
        for curve in self.chart.curves.iter().rev() {
            self.draw_curve(canvas, curve);
        }
        for &x in self.chart.missing.iter().filter(|x| x.is_finite()) {
            self.area.draw_missing(canvas, self.place([x, low])[0]);
        }
    }

    fn draw_curve(&self, canvas: &mut Canvas, curve: &Curve) {
        let colour = COLOURS[curve.colour % COLOURS.len()];
        let em = self.area.em;
        let is_there = |p: &[f64; 2]| self.chart.is_shown(p);
        for run in curve.points.chunk_by(|a, b| is_there(a) && is_there(b)) {
            let places: Vec<[f64; 2]> = run.iter().filter(|p| is_there(p)).map(|&p| self.place(p)).collect();
            stroke(canvas, &places, curve.dashed, em, colour);
            if curve.dashed && places.len() > 1 {
                continue;
            }
            for &place in &places {
                // A stroke of no length is a disc.
                canvas.stroke(&[[place, place]], 2.0 * CIRCLE * em, colour);
                canvas.stroke(&[[place, place]], 1.1 * CIRCLE * em, WHITE);
            }
        }
    }

    fn draw_legend(&self, canvas: &mut Canvas) {
        let em = self.area.em;
        let text = regular(0.9 * em, INK);
        for (k, line) in self.legend.iter().enumerate() {
            let mut x = self.area.left;
            let baseline = (1.2 + LEGEND_LINE * k as f64) * em;
            for curve in line {
                let y = baseline - text.cap_height() / 2.0;
                let colour = COLOURS[curve.colour % COLOURS.len()];
                stroke(canvas, &[[x, y], [x + SWATCH * em, y]], curve.dashed, em, colour);
                text.draw(canvas, &curve.name, [x + (SWATCH + 0.4) * em, baseline], Anchor::Start);
                x += legend_width(curve, &text, em);
            }
        }
    }
}

/// Names of curves in lines of at most this width.
fn legend<'a>(chart: &'a LineChart, text: &TextStyle, em: f64, width: f64) -> Vec<Vec<&'a Curve>> {
    let mut lines: Vec<(f64, Vec<&Curve>)> = Vec::new();
    for curve in chart.curves.iter().filter(|curve| !curve.name.is_empty()) {
        let wanted = legend_width(curve, text, em);
        match lines.last_mut() {
            Some((used, line)) if *used + wanted <= width => {
                *used += wanted;
                line.push(curve);
            }
            _ => lines.push((wanted, vec![curve])),
        }
    }
    lines.into_iter().map(|(_, line)| line).collect()
}

fn legend_width(curve: &Curve, text: &TextStyle, em: f64) -> f64 {
    text.width(&curve.name) + (SWATCH + 1.6) * em
}

/// A line through points, with circles left out.
fn stroke(canvas: &mut Canvas, places: &[[f64; 2]], dashed: bool, em: f64, colour: Rgb) {
    let whole = places.windows(2).map(|pair| [pair[0], pair[1]]);
    let segments: Vec<[[f64; 2]; 2]> = match dashed {
        false => whole.collect(),
        true => whole.flat_map(|segment| dashes(segment, em)).collect(),
    };
    if !segments.is_empty() {
        canvas.stroke(&segments, 0.14 * em, colour);
    }
}

fn dashes([from, to]: [[f64; 2]; 2], em: f64) -> Vec<[[f64; 2]; 2]> {
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let length = dx.hypot(dy);
    let [dash, gap] = DASH.map(|part| part * em);
    let at = |s: f64| {
        let share = (s / length).min(1.0);
        [from[0] + share * dx, from[1] + share * dy]
    };
    let count = (length / (dash + gap)).ceil().max(0.0) as usize;
    (0..count)
        .map(|k| k as f64 * (dash + gap))
        .map(|start| [at(start), at(start + dash)])
        .collect()
}

/// A range with a share of its length added at either end.
fn with_margins([low, high]: [f64; 2], scale: Scale, share: f64) -> [f64; 2] {
    match scale {
        Scale::Linear => {
            let margin = share * (high - low);
            [low - margin, high + margin]
        }
        Scale::Log => {
            let factor = (high / low).powf(share);
            [low / factor, high * factor]
        }
    }
}

fn ticks([low, high]: [f64; 2], scale: Scale, room: f64) -> Ticks {
    let count = room.clamp(2.0, 8.0) as usize;
    match scale {
        Scale::Linear => linear_ticks(low, high, count),
        Scale::Log => logarithmic_ticks(low, high, count),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[[f64; 2]], colour: usize, dashed: bool) -> Curve {
        Curve {
            name: "a".into(),
            points: points.to_vec(),
            colour,
            dashed,
        }
    }

    fn drawn(curves: Vec<Curve>, scales: [Scale; 2]) -> Canvas {
        let chart = LineChart::new(curves, ["x", "y"], scales);
        Panel::of_line_chart(&chart, [400, 300]).unwrap().canvas
    }

    /// Rows below the legend and columns with pixels of a colour.
    fn extent(canvas: &Canvas, colour: usize) -> Option<[usize; 4]> {
        let mut found: Option<[usize; 4]> = None;
        for (x, y) in (30..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y))) {
            if canvas.get(x, y) == COLOURS[colour] {
                let [left, right, top, bottom] = found.unwrap_or([x, x, y, y]);
                found = Some([left.min(x), right.max(x), top.min(y), bottom.max(y)]);
            }
        }
        found
    }

    #[test]
    fn decades_are_equally_high_on_a_logarithmic_axis() {
        let flat = |y: f64, colour| curve(&[[0.0, y], [1.0, y]], colour, false);
        let curves = vec![flat(1e-4, 0), flat(1e-2, 1), flat(1.0, 2)];
        let canvas = drawn(curves, [Scale::Linear, Scale::Log]);
        let middle = |colour| {
            let [_, _, top, bottom] = extent(&canvas, colour).unwrap();
            (top + bottom) as f64 / 2.0
        };
        let [low, between, high] = [0, 1, 2].map(middle);
        assert!(low > between && between > high);
        assert!(
            ((low - between) - (between - high)).abs() <= 2.0,
            "{low} {between} {high}"
        );
    }

    #[test]
    fn values_without_a_place_leave_gaps() {
        let points = [
            [1.0, 1.0],
            [2.0, 10.0],
            [3.0, -1.0],
            [4.0, f64::NAN],
            [5.0, 2.0],
            [6.0, 1.0],
        ];
        let canvas = drawn(vec![curve(&points, 0, false)], [Scale::Linear, Scale::Log]);
        let [left, right, ..] = extent(&canvas, 0).unwrap();
        let column = left + (right - left) / 2;
        assert!((30..canvas.height()).all(|y| canvas.get(column, y) != COLOURS[0]));
        let none = drawn(vec![curve(&[[1.0, -1.0]], 0, false)], [Scale::Linear, Scale::Log]);
        assert!(extent(&none, 0).is_none());
        let nothing = drawn(vec![], [Scale::Linear; 2]);
        assert!(
            nothing.pixels().iter().any(|p| *p != WHITE),
            "it says that there is no value"
        );
    }

    #[test]
    fn a_dashed_curve_has_less_ink_than_a_solid_one() {
        let ink = |dashed| {
            let canvas = drawn(vec![curve(&[[0.0, 0.0], [1.0, 1.0]], 0, dashed)], [Scale::Linear; 2]);
            canvas.pixels().iter().filter(|p| **p == COLOURS[0]).count()
        };
        assert!(
            ink(true) > 100 && 3 * ink(true) < 2 * ink(false),
            "{} {}",
            ink(true),
            ink(false)
        );
    }

    #[test]
    fn one_value_and_tiny_panels_are_drawn_or_refused() {
        let chart = LineChart::new(vec![curve(&[[2.0, 3.0]], 0, false)], ["x", "y"], [Scale::Log; 2]);
        let chart = chart.with_missing(vec![1.0]).with_heights([1.0, 10.0]);
        assert!(Panel::of_line_chart(&chart, [200, 150]).is_ok());
        assert!(Panel::of_line_chart(&chart, [16, 16]).is_ok());
        assert!(matches!(
            Panel::of_line_chart(&chart, [4, 4]),
            Err(DrawingError::TooSmall { .. })
        ));
    }
}
