//! How a solid is brought to the middle of a view.

use serde::Serialize;
use solidmap::Point;

/// How a solid is moved and scaled to be seen: `(p − centre) / radius` lies in the ball of radius 1.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Framing {
    centre: [f64; 3],
    radius: f64,
}

impl Framing {
    /// Of the box of points with finite coordinates; whatever, where there are none.
    pub fn of<'p>(points: impl IntoIterator<Item = &'p Point>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in points.into_iter().filter(|point| point.iter().all(|x| x.is_finite())) {
            for k in 0..3 {
                low[k] = low[k].min(point[k]);
                high[k] = high[k].max(point[k]);
            }
        }
        let halves = [0, 1, 2].map(|k| (high[k] - low[k]) / 2.0);
        let radius = halves.iter().map(|half| half * half).sum::<f64>().sqrt();
        if radius > 0.0 && radius.is_finite() {
            let centre = [0, 1, 2].map(|k| low[k] + halves[k]);
            Self { centre, radius }
        } else {
            Self {
                centre: [0.0; 3],
                radius: 1.0,
            }
        }
    }

    /// Coordinates of points in the view.
    pub fn place<'p>(self, points: impl IntoIterator<Item = &'p Point>) -> impl Iterator<Item = f64> {
        let placed = move |p: &Point| [0, 1, 2].map(|k| (p[k] - self.centre[k]) / self.radius);
        points.into_iter().flat_map(placed)
    }
}
