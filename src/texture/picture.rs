//! Pictures, and interpolation between their pixels.

use super::TextureError;
use super::colour::{LinearRgb, from_srgb};

/// A picture of 8-bit sRGB pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    /// Row by row from the top.
    pixels: Vec<[u8; 3]>,
}

/// How a picture continues beyond its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// It repeats, the default of material files.
    #[default]
    Repeat,
    /// The colour of the nearest edge.
    Clamp,
}

impl Picture {
    /// A picture of `width × height` pixels, row by row from the top.
    ///
    /// # Errors
    ///
    /// [`TextureError::PictureSize`] when there are none, or not as many as that.
    pub fn new(width: usize, height: usize, pixels: Vec<[u8; 3]>) -> Result<Self, TextureError> {
        if pixels.is_empty() || width.checked_mul(height) != Some(pixels.len()) {
            return Err(TextureError::PictureSize {
                width,
                height,
                pixels: pixels.len(),
            });
        }
        Ok(Self { width, height, pixels })
    }

    /// A checkerboard of `squares` squares along each side. The dark ones show where they are: from blue on the left to
    /// red on the right, greener towards the top.
    ///
    /// # Errors
    ///
    /// [`TextureError::CheckerSquares`] unless `squares` is from 1 to 1024.
    pub fn checker(squares: usize) -> Result<Self, TextureError> {
        if !(1..=MAX_SQUARES).contains(&squares) {
            return Err(TextureError::CheckerSquares { squares });
        }
        let square = CHECKER_SIDE.div_ceil(squares);
        let side = square * squares;
        let last = (squares - 1).max(1) as f64;
        let tint = |k: usize, low: f64, high: f64| (low + (high - low) * k as f64 / last).round() as u8;
        let pixel = |i: usize| {
            let (column, row) = (i % side / square, i / side / square);
            if (column + row) % 2 == 0 {
                return [240, 232, 214];
            }
            let (red, blue) = (tint(column, 30.0, 205.0), tint(column, 190.0, 45.0));
            [red, tint(row, 150.0, 35.0), blue]
        };
        Self::new(side, side, (0..side * side).map(pixel).collect())
    }

    /// Pixels from left to right.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels from top to bottom.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels, row by row from the top.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// The linear colour at `(u, v)`: `u` runs from the left edge (0) to the right (1), `v` from the bottom up.
    /// Bilinear between the centres of the four nearest pixels, in linear colours. NaN where `u` or `v` is not finite.
    pub fn light(&self, [u, v]: [f64; 2], wrap: Wrap) -> LinearRgb {
        if !(u.is_finite() && v.is_finite()) {
            return [f64::NAN; 3];
        }
        let columns = nearest_two(u, self.width, wrap);
        let rows = nearest_two(1.0 - v, self.height, wrap);
        let mut light = [0.0; 3];
        for (row, by_row) in rows {
            for (column, by_column) in columns {
                let pixel = from_srgb(self.pixels[row * self.width + column]);
                for (sum, l) in light.iter_mut().zip(pixel) {
                    *sum += by_row * by_column * l;
                }
            }
        }
        light
    }
}

/// Largest number of squares along a side.
const MAX_SQUARES: usize = 1024;
/// Pixels along a side of a checker, or a few more.
const CHECKER_SIDE: usize = 1024;

/// The nearest two pixels of a row or column, and their weights.
fn nearest_two(coordinate: f64, count: usize, wrap: Wrap) -> [(usize, f64); 2] {
    let within = match wrap {
        Wrap::Repeat => coordinate - coordinate.floor(),
        Wrap::Clamp => coordinate.clamp(0.0, 1.0),
    };
    let position = within * count as f64 - 0.5;
    let first = position.floor();
    let fraction = position - first;
    let pixel = |k: f64| match wrap {
        Wrap::Repeat => k.rem_euclid(count as f64) as usize,
        Wrap::Clamp => k.clamp(0.0, count as f64 - 1.0) as usize,
    };
    [(pixel(first), 1.0 - fraction), (pixel(first + 1.0), fraction)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: [u8; 3] = [255, 0, 0];
    const BLUE: [u8; 3] = [0, 0, 255];
    const WHITE: [u8; 3] = [255; 3];
    const BLACK: [u8; 3] = [0; 3];

    /// Red and blue above, white and black below.
    fn four() -> Picture {
        Picture::new(2, 2, vec![RED, BLUE, WHITE, BLACK]).unwrap()
    }

    #[test]
    fn centres_of_pixels_have_their_colours_and_v_points_up() {
        let picture = four();
        for wrap in [Wrap::Repeat, Wrap::Clamp] {
            for (uv, pixel) in [
                ([0.25, 0.75], RED),
                ([0.75, 0.75], BLUE),
                ([0.25, 0.25], WHITE),
                ([0.75, 0.25], BLACK),
            ] {
                assert_eq!(picture.light(uv, wrap), from_srgb(pixel));
            }
        }
    }

    #[test]
    fn between_pixels_light_is_averaged() {
        let middle = four().light([0.5, 0.75], Wrap::Clamp);
        assert_eq!(middle, [0.5, 0.0, 0.5]);
    }

    #[test]
    fn beyond_the_edges_the_picture_repeats_or_stays() {
        let picture = four();
        assert_eq!(picture.light([1.25, -0.25], Wrap::Repeat), from_srgb(RED));
        assert_eq!(picture.light([-7.0, 9.0], Wrap::Clamp), from_srgb(RED));
        // Half-way between the right edge and the left one, which follows it.
        assert_eq!(picture.light([1.0, 0.75], Wrap::Repeat), [0.5, 0.0, 0.5]);
        assert_eq!(picture.light([1.0, 0.75], Wrap::Clamp), from_srgb(BLUE));
        for uv in [[1e300, -1e300], [-1e-320, 1.0 - 1e-17]] {
            assert!(picture.light(uv, Wrap::Repeat).iter().all(|l| (0.0..=1.0).contains(l)));
        }
        assert!(picture.light([f64::NAN, 0.0], Wrap::Clamp)[0].is_nan());
    }

    #[test]
    fn a_picture_has_its_pixels() {
        assert!(matches!(
            Picture::new(0, 5, vec![]),
            Err(TextureError::PictureSize { .. })
        ));
        assert!(matches!(
            Picture::new(2, 2, vec![RED]),
            Err(TextureError::PictureSize { .. })
        ));
        assert!(matches!(Picture::checker(0), Err(TextureError::CheckerSquares { .. })));
        let checker = Picture::checker(3).unwrap();
        let at = |column: f64, row: f64| checker.light([(column + 0.5) / 3.0, (row + 0.5) / 3.0], Wrap::Clamp);
        assert_eq!(at(0.0, 0.0), at(2.0, 0.0));
        assert_ne!(at(0.0, 0.0), at(1.0, 0.0));
    }
}
