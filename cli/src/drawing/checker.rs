//! A chequered pattern, evaluated at every sample, so that it is sharp also inside triangles.

use super::canvas::Rgb;
use solidmap::Point;
use solidmap::geometry::Axis;

/// A chequered pattern in space, coloured by position, and where each vertex of a surface is in it.
///
/// Painted on a domain and on its image with the same places, it shows what the map does: where cells grow and shrink,
/// shear and fold.
#[derive(Debug, Clone, PartialEq)]
pub struct Checker {
    /// Where each vertex is in the pattern; linear over triangles.
    pub places: Vec<Point>,
    /// The pattern.
    pub pattern: Pattern,
}

/// A chequered pattern.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pattern {
    /// Space, in cubes, of which the box from `low` to `high` has this many along its longest side. Red, green and blue
    /// grow along the axes of the box.
    Cubes {
        /// Lowest corner of the box.
        low: Point,
        /// Highest corner of the box.
        high: Point,
        /// Cubes along its longest side.
        cells: usize,
    },
    /// Directions from the origin, by longitude and latitude. Red, green and blue grow along the axes.
    Graticule {
        /// The axis through the poles.
        pole: Axis,
        /// Cells from pole to pole; twice as many go round.
        cells: usize,
    },
}

/// Offset of the cubes from the lowest corner of the box, so that faces of the box lie inside cubes, not between them.
const PHASE: f64 = 0.381_966;

impl Pattern {
    /// The colour at a place.
    pub(super) fn colour(&self, place: &Point) -> Rgb {
        let (share, odd) = match self {
            Self::Cubes { low, high, cells } => {
                let extent = high - low;
                let from_low = place - low;
                let size = extent.amax() / *cells as f64;
                let steps: f64 = from_low.iter().map(|x| (x / size + PHASE).floor()).sum();
                let share = [0, 1, 2].map(|k| if extent[k] > 0.0 { from_low[k] / extent[k] } else { 0.5 });
                (share, is_odd(steps))
            }
            Self::Graticule { pole, cells } => {
                let direction = place.coords.try_normalize(0.0).unwrap_or_default();
                let step = std::f64::consts::PI / *cells as f64;
                let [right, ahead, up] = [1, 2, 0].map(|k| direction[(pole.index() + k) % 3]);
                let angles = [ahead.atan2(right), up.clamp(-1.0, 1.0).asin()];
                let share = [0, 1, 2].map(|k| 0.5 + 0.5 * direction[k]);
                (share, is_odd(angles.iter().map(|angle| (angle / step).floor()).sum()))
            }
        };
        let shade = if odd { 0.64 } else { 1.0 };
        share.map(|t| (255.0 * shade * (0.24 + 0.76 * t.clamp(0.0, 1.0))).round() as u8)
    }
}

fn is_odd(steps: f64) -> bool {
    steps.rem_euclid(2.0) >= 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shades differ by 0.64 in every channel, and the colour itself hardly between neighbours.
    fn is_darker(a: Rgb, b: Rgb) -> bool {
        a.iter().zip(b).all(|(a, b)| f64::from(*a) < 0.75 * f64::from(b))
    }

    #[test]
    fn neighbouring_cells_differ_and_those_beyond_them_do_not() {
        let (low, high) = (Point::new(1.0, 2.0, 3.0), Point::new(11.0, 12.0, 13.0));
        let pattern = Pattern::Cubes { low, high, cells: 100 };
        let at = |x: f64, y: f64| pattern.colour(&Point::new(x, y, 7.0));
        let pairs = [(at(6.0, 7.0), at(6.1, 7.0)), (at(6.0, 7.0), at(6.0, 7.1))];
        assert!(pairs.iter().all(|&(a, b)| is_darker(a, b) || is_darker(b, a)));
        let (here, there) = (at(6.0, 7.0), at(6.1, 7.1));
        assert!(!is_darker(here, there) && !is_darker(there, here));
    }

    #[test]
    fn cells_alternate_across_the_longitude_of_180_degrees() {
        let pattern = Pattern::Graticule {
            pole: Axis::Z,
            cells: 12,
        };
        let at = |degrees: f64| {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            pattern.colour(&Point::new(2.0 * cosine, 2.0 * sine, 0.1))
        };
        // 24 cells of 15° go round: those on both sides of 180° differ as all neighbours do.
        for (a, b) in [(178.0, -178.0), (164.0, 166.0), (-1.0, 1.0)] {
            assert!(is_darker(at(a), at(b)) != is_darker(at(b), at(a)), "{a} {b}");
        }
        assert_ne!(pattern.colour(&Point::origin()), [0; 3]);
    }
}
