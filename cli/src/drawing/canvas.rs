/// A colour in 8-bit sRGB: red, green, blue.
pub type Rgb = [u8; 3];

pub(super) const WHITE: Rgb = [255, 255, 255];
/// Text and outlines.
pub(super) const INK: Rgb = [28, 31, 38];
/// Secondary text: a contrast of 6.5:1 against white, so that it stays legible when small.
pub(super) const GREY_INK: Rgb = [88, 94, 104];
/// Axis lines and tick marks.
pub(super) const RULE: Rgb = [140, 146, 155];

/// A picture being drawn. The first row is the top one; coordinates in pixels, `(0, 0)` the top left corner of the
/// top left pixel. Drawing outside is ignored.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
}

impl Canvas {
    pub(super) fn new(width: usize, height: usize, colour: Rgb) -> Self {
        Self {
            width,
            height,
            pixels: vec![colour; width * height],
        }
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn height(&self) -> usize {
        self.height
    }

    pub(super) fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    pub(super) fn pixels_mut(&mut self) -> &mut [Rgb] {
        &mut self.pixels
    }

    /// Turns the picture by 180°.
    pub(super) fn turn(&mut self) {
        self.pixels.reverse();
    }

    #[cfg(test)]
    pub(super) fn get(&self, x: usize, y: usize) -> Rgb {
        self.pixels[y * self.width + x]
    }

    pub(super) fn set(&mut self, x: usize, y: usize, colour: Rgb) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// Blends `colour` over a pixel with opacity `alpha` in `[0, 1]`.
    pub(super) fn blend(&mut self, x: i64, y: i64, colour: Rgb, alpha: f32) {
        if (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y) {
            let pixel = &mut self.pixels[y as usize * self.width + x as usize];
            *pixel = mixed(*pixel, colour, alpha);
        }
    }

    /// Copies another canvas here with its top left corner at `(x, y)`.
    pub(super) fn paste(&mut self, other: &Canvas, x: usize, y: usize) {
        for row in 0..other.height {
            for column in 0..other.width {
                self.set(x + column, y + row, other.pixels[row * other.width + column]);
            }
        }
    }

    /// Draws segments of the given width, antialiased and with round ends.
    pub(super) fn stroke(&mut self, segments: &[[[f64; 2]; 2]], width: f64, colour: Rgb) {
        let reach = width / 2.0 + 1.0;
        let ends = || segments.iter().flatten();
        let low = |k: usize| ends().map(|p| p[k]).fold(f64::INFINITY, f64::min) - reach;
        let high = |k: usize| ends().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max) + reach;
        let (columns, rows) = (span(low(0), high(0), self.width), span(low(1), high(1), self.height));
        // Each pixel is covered once, by its nearest segment: blending segment by segment would darken joints.
        let mut coverage = vec![0f32; columns.len() * rows.len()];
        for &[p, q] in segments {
            for row in span(p[1].min(q[1]) - reach, p[1].max(q[1]) + reach, self.height) {
                for column in span(p[0].min(q[0]) - reach, p[0].max(q[0]) + reach, self.width) {
                    let centre = [column as f64 + 0.5, row as f64 + 0.5];
                    let covered = (width / 2.0 + 0.5 - distance_to_segment(centre, p, q)).clamp(0.0, width.min(1.0));
                    let pixel = &mut coverage[(row - rows.start) * columns.len() + column - columns.start];
                    *pixel = pixel.max(covered as f32);
                }
            }
        }
        let covered = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        for ((column, row), alpha) in covered.zip(coverage).filter(|(_, alpha)| *alpha > 0.0) {
            self.blend(column as i64, row as i64, colour, alpha);
        }
    }
}

/// `over` blended over `under` with opacity `alpha`.
pub(super) fn mixed(under: Rgb, over: Rgb, alpha: f32) -> Rgb {
    let channel = |k: usize| f32::from(under[k]) + (f32::from(over[k]) - f32::from(under[k])) * alpha;
    [0, 1, 2].map(|k| channel(k).round() as u8)
}

/// The pixels between two coordinates, within a picture of `size` pixels.
fn span(low: f64, high: f64, size: usize) -> std::ops::Range<usize> {
    let bounded = |x: f64| x.clamp(0.0, size as f64) as usize;
    let first = bounded(low.floor());
    first..bounded(high.ceil()).max(first)
}

fn distance_to_segment(x: [f64; 2], p: [f64; 2], q: [f64; 2]) -> f64 {
    let along = [q[0] - p[0], q[1] - p[1]];
    let length2 = along[0] * along[0] + along[1] * along[1];
    let t = if length2 > 0.0 {
        (((x[0] - p[0]) * along[0] + (x[1] - p[1]) * along[1]) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (x[0] - p[0] - t * along[0]).hypot(x[1] - p[1] - t * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stroke_covers_its_area_and_joints_are_no_darker() {
        let mut whole = Canvas::new(40, 20, WHITE);
        whole.stroke(&[[[5.0, 10.0], [35.0, 10.0]]], 4.0, [0; 3]);
        let mut parts = Canvas::new(40, 20, WHITE);
        let pieces: Vec<_> = (5..35)
            .map(|x| [[f64::from(x), 10.0], [f64::from(x + 1), 10.0]])
            .collect();
        parts.stroke(&pieces, 4.0, [0; 3]);
        assert_eq!(whole, parts);
        assert_eq!(whole.get(20, 8), [0; 3]);
        assert_eq!(whole.get(20, 7), WHITE);
        assert_eq!(whole.get(1, 10), WHITE);
    }

    #[test]
    fn drawing_outside_is_ignored() {
        let mut canvas = Canvas::new(4, 4, WHITE);
        canvas.blend(-1, 2, INK, 1.0);
        canvas.blend(2, 4, INK, 1.0);
        canvas.stroke(&[[[-50.0, -9.0], [90.0, -9.0]]], 2.0, INK);
        assert_eq!(canvas, Canvas::new(4, 4, WHITE));
    }
}
