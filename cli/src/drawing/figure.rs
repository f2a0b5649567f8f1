use super::canvas::{Canvas, GREY_INK, INK, RULE, WHITE};
use super::colour_bar::{BarLayout, GAP};
use super::colour_map::ColourBar;
use super::panel::{LEAST_SIDE, Panel, PanelAxis, check_size};
use super::text::{Anchor, TextStyle, Weight};
use super::ticks::{Ticks, linear_ticks};
use super::{DrawingError, png};

/// Lengths in ems.
const BORDER: f64 = 1.0;
const LINE: f64 = 1.35;
const TITLE_LINE: f64 = 1.6;
const TICK: f64 = 0.3;

/// Panels in a row or a grid, with a title and, where they share one, a colour bar on the right.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    title: String,
    rows: Vec<Vec<Panel>>,
    bar: Option<ColourBar>,
}

impl Figure {
    /// Panels side by side.
    pub fn row(panels: Vec<Panel>) -> Self {
        Self::grid(vec![panels])
    }

    /// Rows of panels, from the top; rows may differ in length.
    pub fn grid(rows: Vec<Vec<Panel>>) -> Self {
        Self {
            title: String::new(),
            rows,
            bar: None,
        }
    }

    /// The same figure under this title.
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// The same figure with one colour bar for all panels.
    pub fn with_bar(mut self, bar: &ColourBar) -> Self {
        self.bar = Some(bar.clone());
        self
    }

    /// The figure as the bytes of a PNG file (8-bit sRGB). Panels keep their pixels; text is sized to them.
    ///
    /// # Errors
    ///
    /// [`DrawingError::TooSmall`] without panels, [`DrawingError::TooLarge`], [`DrawingError::Encode`].
    pub fn to_png(&self) -> Result<Vec<u8>, DrawingError> {
        png::encode(&self.draw()?)
    }

    fn draw(&self) -> Result<Canvas, DrawingError> {
        let layout = FigureLayout::of(self).ok_or(DrawingError::TooSmall { least: LEAST_SIDE })?;
        let (width, height) = (layout.width.ceil() as usize, layout.height.ceil() as usize);
        check_size(width, height)?;
        let mut canvas = Canvas::new(width, height, WHITE);
        let title = layout.style.figure_title();
        for (k, line) in layout.title.iter().enumerate() {
            let baseline = (BORDER + 1.1 + 1.25 * TITLE_LINE * k as f64) * layout.style.em;
            title.draw(&mut canvas, line, [layout.width / 2.0, baseline], Anchor::Middle);
        }
        for (panels, (y, height)) in layout.panels.iter().zip(&layout.rows) {
            for (panel, (x, width)) in panels.iter().zip(&layout.columns) {
                let [left, top] = [x + panel.inset(0, *width), y + panel.inset(1, *height)];
                panel.draw(&mut canvas, &layout.style, left.floor(), top.floor());
            }
        }
        if let Some((bar, x, y)) = &layout.bar {
            bar.draw(&mut canvas, *x, *y);
        }
        Ok(canvas)
    }
}

/// The styles of a figure's texts.
#[derive(Debug, Clone, Copy)]
struct TextSizes {
    em: f64,
}

impl TextSizes {
    fn text(&self) -> TextStyle {
        TextStyle {
            size: self.em,
            weight: Weight::Regular,
            colour: INK,
        }
    }

    fn caption(&self) -> TextStyle {
        TextStyle {
            colour: GREY_INK,
            ..self.text()
        }
    }

    fn panel_title(&self) -> TextStyle {
        TextStyle {
            size: 1.1 * self.em,
            weight: Weight::Bold,
            colour: INK,
        }
    }

    fn figure_title(&self) -> TextStyle {
        TextStyle {
            size: 1.35 * self.em,
            weight: Weight::Bold,
            colour: INK,
        }
    }
}

/// A panel, and the space for texts around its picture.
struct PanelLayout<'a> {
    panel: &'a Panel,
    title: Vec<String>,
    captions: Vec<String>,
    bar: Option<BarLayout<'a>>,
    /// Additional space between the picture and its bar, for lines wider than the picture.
    aside: f64,
    /// Left, top, right, bottom.
    margins: [f64; 4],
}

impl<'a> PanelLayout<'a> {
    fn new(panel: &'a Panel, style: &TextSizes) -> Self {
        let em = style.em;
        let size = [panel.canvas.width() as f64, panel.canvas.height() as f64];
        let bar = panel.bar.as_ref().map(|bar| BarLayout::new(bar, em, size[1]));
        let (mut left, mut right, mut bottom) = (0.0, 0.0, 0.0);
        if let Some(axes) = &panel.axes {
            let labels = ticks_along(axes, 1, size[1], em).labels;
            let widest = labels.iter().map(|label| style.text().width(label)).fold(0.0, f64::max);
            left = widest + (TICK + 0.8) * em + style.text().width(&axes[1].name);
            // The last label below the horizontal axis may extend by half its width.
            right = 0.8 * em;
            bottom = (TICK + 2.6) * em;
        }
        let free = if bar.is_some() { 0.8 * GAP * em } else { right };
        let room = size[0] + left.min(free) * 2.0;
        let title = style.panel_title().wrapped(&panel.title, room);
        let captions: Vec<String> = panel
            .captions
            .iter()
            .flat_map(|text| style.caption().wrapped(text, room))
            .collect();
        let widest = |text: TextStyle, lines: &[String]| lines.iter().map(|l| text.width(l)).fold(0.0, f64::max);
        let overhang = (widest(style.panel_title(), &title).max(widest(style.caption(), &captions)) - size[0]) / 2.0;
        let mut aside = 0.0;
        if let Some(bar) = &bar {
            aside = (overhang - free).max(0.0);
            right = aside + bar.width();
        }
        bottom += LINE * em * captions.len() as f64 + 0.4 * em;
        bottom = bar.as_ref().map_or(bottom, |bar| bottom.max(bar.below()));
        let top = TITLE_LINE * em * title.len() as f64 + 0.4 * em;
        let top = bar.as_ref().map_or(top, |bar| top.max(bar.above()));
        Self {
            panel,
            title,
            captions,
            bar,
            aside,
            margins: [left.max(overhang), top, right.max(overhang), bottom],
        }
    }

    fn size(&self, direction: usize) -> f64 {
        [self.panel.canvas.width(), self.panel.canvas.height()][direction] as f64
    }

    /// Space on either side of the picture, centred in its column (0) or row (1) of this extent.
    fn inset(&self, direction: usize, extent: f64) -> f64 {
        (extent - self.size(direction)) / 2.0
    }

    /// Draws the panel with the top left corner of its picture at `(x, y)`.
    fn draw(&self, canvas: &mut Canvas, style: &TextSizes, x: f64, y: f64) {
        let em = style.em;
        let (width, height) = (self.panel.canvas.width() as f64, self.panel.canvas.height() as f64);
        canvas.paste(&self.panel.canvas, x as usize, y as usize);
        for (k, line) in self.title.iter().rev().enumerate() {
            let baseline = y - (0.75 + TITLE_LINE * k as f64) * em;
            style
                .panel_title()
                .draw(canvas, line, [x + width / 2.0, baseline], Anchor::Middle);
        }
        let mut below = y + height;
        if let Some(axes) = &self.panel.axes {
            draw_axes(canvas, style, axes, [x, y, width, height]);
            below += (TICK + 2.6) * em;
        }
        for (k, line) in self.captions.iter().enumerate() {
            let baseline = below + (1.15 + LINE * k as f64) * em;
            style
                .caption()
                .draw(canvas, line, [x + width / 2.0, baseline], Anchor::Middle);
        }
        if let Some(bar) = &self.bar {
            bar.draw(canvas, x + width + self.aside, y);
        }
    }
}

/// The positions of all parts of a figure, in pixels.
struct FigureLayout<'a> {
    style: TextSizes,
    width: f64,
    height: f64,
    title: Vec<String>,
    panels: Vec<Vec<PanelLayout<'a>>>,
    /// Left edge and width of the pictures in each column.
    columns: Vec<(f64, f64)>,
    /// Upper edge and height of the pictures in each row.
    rows: Vec<(f64, f64)>,
    bar: Option<(BarLayout<'a>, f64, f64)>,
}

impl<'a> FigureLayout<'a> {
    /// `None` without panels.
    fn of(figure: &'a Figure) -> Option<Self> {
        let longest = figure
            .rows
            .iter()
            .flatten()
            .map(|p| p.canvas.width().max(p.canvas.height()))
            .max()?;
        let style = TextSizes {
            em: (longest as f64 / 30.0).clamp(11.0, 48.0),
        };
        let em = style.em;
        let panels: Vec<Vec<PanelLayout>> = figure
            .rows
            .iter()
            .map(|row| row.iter().map(|panel| PanelLayout::new(panel, &style)).collect())
            .collect();

        let mut right = BORDER * em;
        let columns: Vec<(f64, f64)> = (0..panels.iter().map(Vec::len).max()?)
            .map(|k| {
                let column: Vec<&PanelLayout> = panels.iter().filter_map(|row| row.get(k)).collect();
                let (before, width, after) = band(&column, 0);
                let left = (right + if k > 0 { em } else { 0.0 } + before).ceil();
                right = left + width + after;
                (left, width)
            })
            .collect();
        let mut bottom = 0.0;
        let mut rows: Vec<(f64, f64)> = panels
            .iter()
            .enumerate()
            .map(|(k, row)| {
                let (before, height, after) = band(&row.iter().collect::<Vec<_>>(), 1);
                let top = bottom + if k > 0 { em } else { 0.0 } + before;
                bottom = top + height + after;
                (top, height)
            })
            .collect();
        let (first, last) = (*rows.first()?, *rows.last()?);
        let bar = figure
            .bar
            .as_ref()
            .map(|bar| BarLayout::new(bar, em, last.0 + last.1 - first.0));
        let bar_extent = bar
            .as_ref()
            .map_or([0.0; 3], |bar| [bar.width(), bar.above(), bar.below()]);

        let width = right + bar_extent[0] + BORDER * em;
        let title = style.figure_title().wrapped(&figure.title, width - 2.0 * BORDER * em);
        let above = (BORDER + 1.25 * TITLE_LINE * title.len() as f64) * em + (bar_extent[1] - first.0).max(0.0);
        rows.iter_mut().for_each(|row| row.0 = (row.0 + above).ceil());
        let height = above + bottom.max(last.0 + last.1 + bar_extent[2]) + BORDER * em;
        let bar = bar.map(|bar| (bar, right, rows[0].0));
        Some(Self {
            style,
            width,
            height,
            title,
            panels,
            columns,
            rows,
            bar,
        })
    }
}

/// The largest picture of a column (0) or row (1) of panels, and the margins beyond it before and after.
fn band(panels: &[&PanelLayout], direction: usize) -> (f64, f64, f64) {
    let extent = panels.iter().map(|c| c.size(direction)).fold(0.0, f64::max);
    let margin = |side: usize| {
        panels
            .iter()
            .map(|c| c.margins[side] - c.inset(direction, extent))
            .fold(0.0, f64::max)
    };
    (margin(direction), extent, margin(direction + 2))
}

/// Round coordinates along the horizontal (0) or vertical (1) edge of a picture, as many as are legible.
fn ticks_along(axes: &[PanelAxis; 2], direction: usize, length: f64, em: f64) -> Ticks {
    let spacing = [5.0, 2.6][direction] * em;
    let axis = &axes[direction];
    let count = (length / spacing).clamp(1.0, 6.0) as usize;
    let ticks = |count| linear_ticks(axis.low.min(axis.high), axis.low.max(axis.high), count);
    // A scale needs two labels: on a short edge they are closer together, as long as they do not touch.
    let several = |ticks: &Ticks| match ticks.positions[..] {
        [first, second, ..] => (second - first) / (axis.high - axis.low).abs() * length > spacing / 2.0,
        _ => false,
    };
    (count..count + 5)
        .map(ticks)
        .find(several)
        .unwrap_or_else(|| ticks(count))
}

/// Lines along the left and lower edge of a picture, with round coordinates and the names of the axes.
fn draw_axes(canvas: &mut Canvas, style: &TextSizes, axes: &[PanelAxis; 2], [x, y, width, height]: [f64; 4]) {
    let em = style.em;
    let text = style.text();
    let [across, up] = axes;
    let (left, bottom) = (x - 0.5, y + height + 0.5);
    let mut lines = vec![[[left, y], [left, bottom]], [[left, bottom], [x + width, bottom]]];

    let ticks = ticks_along(axes, 0, width, em);
    for (position, label) in ticks.positions.iter().zip(&ticks.labels) {
        let place = x + (position - across.low) / (across.high - across.low) * width;
        lines.push([[place, bottom], [place, bottom + TICK * em]]);
        text.draw(canvas, label, [place, bottom + (TICK + 1.05) * em], Anchor::Middle);
    }
    let name = ticks.named(&across.name);
    text.draw(
        canvas,
        &name,
        [x + width / 2.0, bottom + (TICK + 2.3) * em],
        Anchor::Middle,
    );

    let ticks = ticks_along(axes, 1, height, em);
    let mut widest = 0f64;
    for (position, label) in ticks.positions.iter().zip(&ticks.labels) {
        let place = bottom - (position - up.low) / (up.high - up.low) * height;
        lines.push([[left - TICK * em, place], [left, place]]);
        let end = left - (TICK + 0.25) * em;
        text.draw(canvas, label, [end, place + text.cap_height() / 2.0], Anchor::End);
        widest = widest.max(text.width(label));
    }
    let end = left - (TICK + 0.6) * em - widest;
    let name = ticks.named(&up.name);
    text.draw_upward(canvas, &name, [end, y + height / 2.0], Anchor::Middle);
    canvas.stroke(&lines, 1.0, RULE);
}

#[cfg(test)]
mod tests {
    use super::super::png::decode;
    use super::super::{Camera, Colours, Scale, SurfaceStyle, ValueRange};
    use super::*;
    use solidmap::geometry::{Axis, AxisPlane, PlaneSection};
    use solidmap::mesh::shapes;

    /// The section of the unit ball at z = 0.1, coloured by x, and its bar.
    fn ball_by_x() -> (PlaneSection, Vec<f64>, ColourBar) {
        let plane = AxisPlane {
            axis: Axis::Z,
            position: 0.1,
        };
        let section = PlaneSection::new(&shapes::sphere(1.0, 4), plane, Axis::Z, 200).unwrap();
        let values: Vec<f64> = section.points().iter().map(|p| p.x).collect();
        let bar = ColourBar::new("x", [-1.0, 1.0], ValueRange::Full, Scale::Linear).unwrap();
        let bar = bar.in_colours(Colours::Rainbow);
        (section, values, bar)
    }

    #[test]
    fn a_panel_upside_down_has_its_pixels_and_coordinates_turned() {
        let (section, values, bar) = ball_by_x();
        let upright = Panel::of_section(&section, &values, &bar).unwrap();
        let turned = upright.clone().turned_if(true);
        assert_eq!(upright.clone().turned_if(false), upright);
        let (width, height) = (upright.canvas.width(), upright.canvas.height());
        for (x, y) in [(width / 4, height / 2), (width / 2, height / 3)] {
            assert_eq!(
                turned.canvas.get(x, y),
                upright.canvas.get(width - 1 - x, height - 1 - y)
            );
        }
        let ends = |panel: &Panel| {
            panel
                .axes
                .as_ref()
                .map(|axes| axes.each_ref().map(|axis| [axis.low, axis.high]))
        };
        assert_eq!(
            ends(&turned),
            ends(&upright).map(|axes| axes.map(|[low, high]| [high, low]))
        );
        // Its coordinates are written as often as before.
        let labels = |panel: &Panel| {
            let ticks = ticks_along(panel.axes.as_ref().unwrap(), 0, 400.0, 12.0);
            ticks.labels
        };
        assert_eq!(labels(&turned), labels(&upright));
        assert_ne!(
            Figure::row(vec![turned]).to_png().unwrap(),
            Figure::row(vec![upright]).to_png().unwrap()
        );
    }

    #[test]
    fn a_ball_coloured_by_x_is_blue_on_the_left_and_red_on_the_right() {
        let (section, values, bar) = ball_by_x();
        let canvas = Panel::of_section(&section, &values, &bar).unwrap().canvas;
        assert_eq!((canvas.width(), canvas.height()), (200, 200));
        // A pixel is 2/190 wide; at x = ±0.9 the hue is a fifth of the way from the end stop to the next one.
        let near = |found: [u8; 3], wanted: [u8; 3]| found.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 6);
        assert!(near(canvas.get(14, 100), bar.colour(-0.9)), "{:?}", canvas.get(14, 100));
        assert!(
            near(canvas.get(185, 100), bar.colour(0.9)),
            "{:?}",
            canvas.get(185, 100)
        );
        assert!(near(canvas.get(100, 40), [0, 255, 0]), "{:?}", canvas.get(100, 40));
        assert_eq!(canvas.get(10, 10), WHITE);
    }

    #[test]
    fn values_that_are_not_numbers_are_grey() {
        let (section, mut values, bar) = ball_by_x();
        values.fill(f64::NAN);
        let canvas = Panel::of_section(&section, &values, &bar).unwrap().canvas;
        assert_eq!(canvas.get(100, 100), [160; 3]);
    }

    #[test]
    fn the_file_holds_the_figure_and_every_run_gives_the_same() {
        let (section, values, bar) = ball_by_x();
        let panel = Panel::of_section(&section, &values, &bar)
            .unwrap()
            .titled("Ball")
            .with_bar(&bar);
        let view = Panel::of_surface(
            &shapes::sphere(1.0, 3),
            &SurfaceStyle::default(),
            &Camera::default(),
            [120, 90],
        );
        let figure = Figure::grid(vec![vec![panel.clone(), view.unwrap()], vec![panel]])
            .titled("Twice")
            .with_bar(&bar);
        let file = figure.to_png().unwrap();
        assert_eq!(decode(&file), figure.draw().unwrap());
        assert_eq!(file, figure.clone().to_png().unwrap());
    }

    /// Texts that overrun the picture would be cut at its edge: the border must stay white.
    #[test]
    fn nothing_is_cut_at_the_edge_of_the_figure() {
        let rod = shapes::deformed(&shapes::cube(2.0, 1), |p| {
            solidmap::Point::new(6.0 * p.x, p.y, 0.3 * p.z)
        });
        let plane = AxisPlane {
            axis: Axis::Y,
            position: 0.0,
        };
        let label = "elastic potential density of the deformation [J/m³]";
        for size in [16, 60, 300] {
            let section = PlaneSection::new(&rod, plane, Axis::Z, size).unwrap();
            let values: Vec<f64> = section.points().iter().map(|p| 1e7 + 3e6 * p.x).collect();
            let bar = ColourBar::new(label, values.clone(), ValueRange::Quantiles(0.1, 0.9), Scale::Linear).unwrap();
            let panel = Panel::of_section(&section, &values, &bar).unwrap();
            let told = panel
                .clone()
                .titled("A long title that needs several lines")
                .captioned("and a remark that does");
            for figure in [
                Figure::row(vec![told.with_bar(&bar)]),
                Figure::row(vec![panel]).with_bar(&bar),
            ] {
                let canvas = figure.titled("A title of the whole figure").draw().unwrap();
                let (width, height) = (canvas.width(), canvas.height());
                let border = (0..width).flat_map(|x| [(x, 0), (x, 1), (x, height - 1)]);
                let border = border.chain((0..height).flat_map(|y| [(0, y), (1, y), (width - 1, y)]));
                assert!(border.into_iter().all(|(x, y)| canvas.get(x, y) == WHITE), "{size}");
            }
        }
    }

    #[test]
    fn figures_without_panels_and_beyond_the_limit_are_refused() {
        assert!(matches!(
            Figure::row(Vec::new()).to_png(),
            Err(DrawingError::TooSmall { .. })
        ));
        assert!(matches!(
            Figure::grid(vec![Vec::new()]).to_png(),
            Err(DrawingError::TooSmall { .. })
        ));
        let (section, values, bar) = ball_by_x();
        let panel = Panel::of_section(&section, &values, &bar).unwrap();
        let far_too_many = Figure::row(vec![panel; 2000]);
        assert!(matches!(far_too_many.to_png(), Err(DrawingError::TooLarge { .. })));
        assert!(matches!(
            Panel::of_section(&section, &values[1..], &bar),
            Err(DrawingError::ValueCount { .. })
        ));
    }
}
