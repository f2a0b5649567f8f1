//! Antialiased text in DejaVu Sans, horizontal or rotated to read upwards.

use std::sync::OnceLock;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};

use super::canvas::{Canvas, Rgb};

/// Regular for labels, bold for titles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Weight {
    Regular,
    Bold,
}

/// Which point of the text is at its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// How text looks; `size` is the em in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TextStyle {
    pub(super) size: f64,
    pub(super) weight: Weight,
    pub(super) colour: Rgb,
}

impl TextStyle {
    /// Width of one line in pixels.
    pub(super) fn width(&self, text: &str) -> f64 {
        f64::from(self.glyphs(text).1)
    }

    /// Height of the capitals and figures above the baseline, for centring on a tick.
    pub(super) fn cap_height(&self) -> f64 {
        // DejaVu Sans: capitals of 1493 units in an em of 2048.
        self.size * 0.729
    }

    /// The text broken at spaces into lines of at most `width` pixels, unless a word is longer.
    pub(super) fn wrapped(&self, text: &str, width: f64) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if self.width(&format!("{line} {word}")) <= width => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(word.to_owned()),
            }
        }
        lines
    }

    /// Draws one line with its baseline at height `y`, and at `x` its start, middle or end.
    pub(super) fn draw(&self, canvas: &mut Canvas, text: &str, [x, y]: [f64; 2], anchor: Anchor) {
        let start = (x - self.before_anchor(text, anchor)).round() as i64;
        let baseline = y.round() as i64;
        self.cover(text, |right, down, alpha| {
            canvas.blend(start + right, baseline + down, self.colour, alpha);
        });
    }

    /// Draws one line that reads upwards, its baseline at `x`, and at height `y` its start, middle or end.
    pub(super) fn draw_upward(&self, canvas: &mut Canvas, text: &str, [x, y]: [f64; 2], anchor: Anchor) {
        let start = (y + self.before_anchor(text, anchor)).round() as i64;
        let baseline = x.round() as i64;
        self.cover(text, |right, down, alpha| {
            canvas.blend(baseline + down, start - 1 - right, self.colour, alpha);
        });
    }

    fn before_anchor(&self, text: &str, anchor: Anchor) -> f64 {
        match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => self.width(text) / 2.0,
            Anchor::End => self.width(text),
        }
    }

    /// Calls `blend(right, down, coverage)` for the pixels of the text, relative to the start of its baseline.
    fn cover(&self, text: &str, mut blend: impl FnMut(i64, i64, f32)) {
        for glyph in self.glyphs(text).0 {
            if let Some(outline) = font(self.weight).outline_glyph(glyph) {
                let bounds = outline.px_bounds();
                let (left, top) = (bounds.min.x as i64, bounds.min.y as i64);
                outline.draw(|x, y, coverage| blend(left + i64::from(x), top + i64::from(y), coverage.min(1.0)));
            }
        }
    }

    /// Glyphs set along a baseline from the origin, and the width of the line.
    fn glyphs(&self, text: &str) -> (Vec<ab_glyph::Glyph>, f32) {
        let font = font(self.weight);
        // ab_glyph scales by the line height, `size` is the em.
        let units_per_em = font.units_per_em().unwrap_or(2048.0);
        let scale = PxScale::from(self.size as f32 * font.height_unscaled() / units_per_em);
        let scaled = font.as_scaled(scale);
        let mut glyphs: Vec<ab_glyph::Glyph> = Vec::with_capacity(text.len());
        let mut pen = 0.0;
        for character in text.chars() {
            let id = font.glyph_id(character);
            if let Some(previous) = glyphs.last() {
                pen += scaled.kern(previous.id, id);
            }
            glyphs.push(id.with_scale_and_position(scale, point(pen, 0.0)));
            pen += scaled.h_advance(id);
        }
        (glyphs, pen)
    }
}

fn font(weight: Weight) -> &'static FontRef<'static> {
    static REGULAR: OnceLock<FontRef<'static>> = OnceLock::new();
    static BOLD: OnceLock<FontRef<'static>> = OnceLock::new();
    let (cell, bytes): (_, fn() -> &'static [u8]) = match weight {
        Weight::Regular => (&REGULAR, dejavu::sans::regular),
        Weight::Bold => (&BOLD, dejavu::sans::bold),
    };
    cell.get_or_init(|| FontRef::try_from_slice(bytes()).expect("the embedded font is well formed"))
}

#[cfg(test)]
mod tests {
    use super::super::canvas::WHITE;
    use super::*;

    const STYLE: TextStyle = TextStyle {
        size: 20.0,
        weight: Weight::Regular,
        colour: [0; 3],
    };

    fn dark_box(canvas: &Canvas) -> [usize; 4] {
        let mut bounds = [usize::MAX, usize::MAX, 0, 0];
        for (x, y) in (0..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y))) {
            if canvas.get(x, y)[0] < 128 {
                bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
            }
        }
        bounds
    }

    /// The `H` of DejaVu Sans is 1493 of 2048 units high and 201 to 1339 units wide within its advance.
    #[test]
    fn a_capital_has_the_size_asked_for() {
        let mut canvas = Canvas::new(60, 60, WHITE);
        STYLE.draw(&mut canvas, "H", [10.0, 40.0], Anchor::Start);
        let [left, top, right, bottom] = dark_box(&canvas);
        assert_eq!(bottom, 39);
        assert!((40.0 - top as f64 - STYLE.cap_height()).abs() <= 1.0);
        assert!((left as f64 - 10.0 - 20.0 * 201.0 / 2048.0).abs() <= 1.0);
        assert!((right as f64 + 1.0 - 10.0 - 20.0 * 1339.0 / 2048.0).abs() <= 1.0);
    }

    #[test]
    fn upward_text_is_the_text_turned() {
        let mut level = Canvas::new(80, 80, WHITE);
        STYLE.draw(&mut level, "min 4", [10.0, 50.0], Anchor::Start);
        let mut upward = Canvas::new(80, 80, WHITE);
        STYLE.draw_upward(&mut upward, "min 4", [50.0, 70.0], Anchor::Start);
        for (x, y) in (0..80).flat_map(|y| (0..80).map(move |x| (x, y))) {
            assert_eq!(level.get(x, y), upward.get(y, 79 - x));
        }
    }

    #[test]
    fn every_character_of_the_labels_has_a_glyph() {
        for weight in [Weight::Regular, Weight::Bold] {
            for character in "−×⁰¹²³⁴⁵⁶⁷⁸⁹⁻‖∇∂²·°µσε≤≥–%".chars() {
                assert_ne!(font(weight).glyph_id(character).0, 0, "{character}");
            }
        }
    }

    #[test]
    fn wrapping_keeps_the_words_and_the_width() {
        let text = "harmonic energy density of the map from the polycube to the solid";
        let lines = STYLE.wrapped(text, 200.0);
        assert!(lines.len() > 2);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| STYLE.width(line) <= 200.0));
    }
}
