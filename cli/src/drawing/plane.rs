//! Triangles of the plane, painted with the pattern that a surface in space has.

use super::DrawingError;
use super::canvas::{Canvas, INK, Rgb, WHITE};
use super::checker::Pattern;
use super::panel::{Panel, check_count, check_size};
use solidmap::Point;

/// A surface laid out in the plane.
pub struct PlaneDrawing<'a> {
    /// Its triangles.
    pub triangles: &'a [[[f64; 2]; 3]],
    /// Where the corners of each are in the pattern.
    pub places: &'a [[Point; 3]],
    pub pattern: Pattern,
    /// Lines drawn over the triangles.
    pub outline: &'a [[[f64; 2]; 2]],
}

/// Samples along each side of a pixel.
const SAMPLES: usize = 3;
/// Share of the panel around the drawing.
const MARGIN: f64 = 0.04;

impl PlaneDrawing<'_> {
    /// The drawing, fitted into `width × height` pixels, with y upwards.
    ///
    /// # Errors
    ///
    /// [`DrawingError::EmptySurface`], [`DrawingError::NotFinite`], [`DrawingError::ValueCount`], [`DrawingError::TooSmall`] and
    /// [`DrawingError::TooLarge`].
    pub fn panel(&self, [width, height]: [usize; 2]) -> Result<Panel, DrawingError> {
        check_size(width, height)?;
        check_count("triangle", self.triangles.len(), self.places.len())?;
        let corners = || self.triangles.iter().flatten().chain(self.outline.iter().flatten());
        if self.triangles.is_empty() {
            return Err(DrawingError::EmptySurface);
        }
        if let Some(index) = corners().position(|p| !p.iter().all(|c| c.is_finite())) {
            return Err(DrawingError::NotFinite { vertex: index });
        }
        let end = |k: usize, of: fn(f64, f64) -> f64, from: f64| corners().map(|p| p[k]).fold(from, of);
        let (low, high) = (
            [0, 1].map(|k| end(k, f64::min, f64::INFINITY)),
            [0, 1].map(|k| end(k, f64::max, f64::NEG_INFINITY)),
        );
        let size = [width, height].map(|n| n as f64);
        let scales = [0, 1].map(|k| (1.0 - 2.0 * MARGIN) * size[k] / (high[k] - low[k]).max(f64::MIN_POSITIVE));
        let scale = scales[0].min(scales[1]);
        let on_picture = |p: [f64; 2]| {
            let from_middle = [0, 1].map(|k| (p[k] - 0.5 * (low[k] + high[k])) * scale);
            [0.5 * size[0] + from_middle[0], 0.5 * size[1] - from_middle[1]]
        };
        let mut canvas = self.painted([width, height], on_picture);
        let outline: Vec<[[f64; 2]; 2]> = self.outline.iter().map(|s| s.map(on_picture)).collect();
        canvas.stroke(&outline, 1.6, INK);
        Ok(Panel::of_canvas(canvas))
    }

    fn painted(&self, [width, height]: [usize; 2], on_picture: impl Fn([f64; 2]) -> [f64; 2]) -> Canvas {
        let (columns, rows) = (SAMPLES * width, SAMPLES * height);
        let mut samples = vec![WHITE; columns * rows];
        for (t, places) in self.triangles.iter().zip(self.places) {
            let [a, b, c] = t.map(|p| on_picture(p).map(|x| x * SAMPLES as f64));
            let doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            let span = |k: usize, most: usize| {
                let ends = [a[k], b[k], c[k]];
                let low = ends.iter().copied().fold(f64::INFINITY, f64::min);
                let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                ((low - 0.5).ceil().max(0.0) as usize)..((high + 0.5).floor().max(0.0) as usize).min(most)
            };
            for y in span(1, rows) {
                for x in span(0, columns) {
                    let p = [x as f64 + 0.5, y as f64 + 0.5];
                    let share = |q: [f64; 2], r: [f64; 2]| {
                        ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])) / doubled
                    };
                    let weights = [share(b, c), share(c, a), share(a, b)];
                    if weights.iter().all(|w| *w >= 0.0) {
                        let place = places
                            .iter()
                            .zip(weights)
                            .map(|(q, w)| q.coords * w)
                            .sum::<solidmap::Vector>();
                        samples[x + columns * y] = self.pattern.colour(&Point::from(place));
                    }
                }
            }
        }
        let mut canvas = Canvas::new(width, height, WHITE);
        let mean = |x: usize, y: usize| -> Rgb {
            let mut sum = [0u32; 3];
            for k in 0..SAMPLES * SAMPLES {
                let sample = samples[SAMPLES * x + k % SAMPLES + columns * (SAMPLES * y + k / SAMPLES)];
                sum = [0, 1, 2].map(|c| sum[c] + u32::from(sample[c]));
            }
            sum.map(|c| (c / (SAMPLES * SAMPLES) as u32) as u8)
        };
        for y in 0..height {
            for x in 0..width {
                canvas.set(x, y, mean(x, y));
            }
        }
        canvas
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_are_painted_and_the_rest_is_paper() {
        let triangles = [[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]];
        let places = [[Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0)]];
        let pattern = Pattern::Cubes {
            low: Point::origin(),
            high: Point::new(1.0, 1.0, 0.0),
            cells: 1,
        };
        let drawing = PlaneDrawing {
            triangles: &triangles,
            places: &places,
            pattern,
            outline: &[],
        };
        let canvas = drawing.panel([100, 100]).unwrap().canvas;
        // The lower left half, with y upwards.
        assert_eq!(canvas.get(95, 50), WHITE);
        assert_eq!(canvas.get(80, 20), WHITE);
        let expected = pattern.colour(&Point::new(0.25, 0.25, 0.0));
        let found = canvas.get(27, 73);
        assert!(
            found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) < 6),
            "{found:?} {expected:?}"
        );
        let wrong = PlaneDrawing { places: &[], ..drawing };
        assert!(matches!(wrong.panel([100, 100]), Err(DrawingError::ValueCount { .. })));
    }
}
