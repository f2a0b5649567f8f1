//! The area between the axes of a chart or a histogram.

use super::canvas::{Canvas, GREY_INK, INK, RULE, Rgb};
use super::text::{Anchor, TextStyle, Weight};
use super::ticks::Ticks;

/// Colour of the horizontal lines at the ticks of the vertical axis.
pub(super) const GRID: Rgb = [232, 234, 238];
/// Length of a tick in ems.
pub(super) const TICK: f64 = 0.35;

/// The area between the axes in pixels, and the size of text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlotArea {
    /// Size of text in pixels.
    pub(super) em: f64,
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl PlotArea {
    /// Regular text in this colour.
    pub(super) fn text(&self, colour: Rgb) -> TextStyle {
        regular(self.em, colour)
    }

    /// The vertical pixel position of a value, 0 at the lower edge and `top` at the upper one.
    pub(super) fn height_of(&self, value: f64, top: f64) -> f64 {
        self.bottom - value / top * (self.bottom - self.top)
    }

    /// Draws the left and the lower edge.
    pub(super) fn draw_axes(&self, canvas: &mut Canvas) {
        let corner = [self.left, self.bottom];
        let axes = [[[self.left, self.top], corner], [corner, [self.right, self.bottom]]];
        canvas.stroke(&axes, 1.0, RULE);
    }

    /// Ticks and labels along the left edge, a line across the area at each, and the name of the axis, which reads upwards;
    /// `place` gives the pixel of a value.
    pub(super) fn draw_ticks_up(&self, canvas: &mut Canvas, ticks: &Ticks, place: impl Fn(f64) -> f64, name: &str) {
        let Self {
            em,
            left,
            top,
            right,
            bottom,
        } = *self;
        let text = self.text(INK);
        for (value, label) in ticks.positions.iter().zip(&ticks.labels) {
            let y = place(*value);
            if y < bottom {
                canvas.stroke(&[[[left, y], [right, y]]], 1.0, GRID);
            }
            canvas.stroke(&[[[left - TICK * em, y], [left, y]]], 1.0, RULE);
            let end = [left - (TICK + 0.25) * em, y + text.cap_height() / 2.0];
            text.draw(canvas, label, end, Anchor::End);
        }
        let middle = [1.4 * em, (top + bottom) / 2.0];
        text.draw_upward(canvas, &ticks.named(name), middle, Anchor::Middle);
    }

    /// A cross on the lower edge at the pixel `x`, where a value is missing.
    pub(super) fn draw_missing(&self, canvas: &mut Canvas, x: f64) {
        let arm = 0.3 * self.em;
        let y = self.bottom - 1.6 * arm;
        let cross = [
            [[x - arm, y - arm], [x + arm, y + arm]],
            [[x - arm, y + arm], [x + arm, y - arm]],
        ];
        canvas.stroke(&cross, 0.12 * self.em, GREY_INK);
    }

    /// Ticks and labels along the lower edge, and `baseline` ems below it the name of the axis; `place` gives the pixel
    /// of a value.
    pub(super) fn draw_ticks_across(
        &self,
        canvas: &mut Canvas,
        ticks: &Ticks,
        place: impl Fn(f64) -> f64,
        name: &str,
        baseline: f64,
    ) {
        let (em, bottom, text) = (self.em, self.bottom, self.text(INK));
        for (value, label) in ticks.positions.iter().zip(&ticks.labels) {
            let x = place(*value);
            canvas.stroke(&[[[x, bottom], [x, bottom + TICK * em]]], 1.0, RULE);
            text.draw(canvas, label, [x, bottom + (TICK + 1.1) * em], Anchor::Middle);
        }
        let middle = (self.left + self.right) / 2.0;
        let name = ticks.named(name);
        text.draw(canvas, &name, [middle, bottom + baseline * em], Anchor::Middle);
    }
}

/// Regular text of this size and colour.
pub(super) fn regular(size: f64, colour: Rgb) -> TextStyle {
    TextStyle {
        size,
        weight: Weight::Regular,
        colour,
    }
}
