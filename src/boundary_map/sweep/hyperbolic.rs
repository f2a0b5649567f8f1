//! Layouts in the hyperbolic plane, and the target as they see it.

use super::{Layout, TargetAround};
use crate::hyperbolic::{Chart, HyperbolicEmbedding, HyperbolicLayout, HyperbolicLocator, Located};
use crate::{Point, Vector};

/// From places on the hyperboloid to points of the target.
pub(crate) struct HyperbolicTarget {
    pub embedding: HyperbolicEmbedding,
    locator: HyperbolicLocator,
    /// Lengths of the target are multiplied by this, so that its area is that of the hyperbolic surface.
    pub scale: f64,
}

impl HyperbolicTarget {
    pub fn new(embedding: HyperbolicEmbedding) -> Self {
        Self {
            locator: HyperbolicLocator::new(&embedding),
            scale: (embedding.group().area() / embedding.surface().area()).sqrt(),
            embedding,
        }
    }

    /// The point of the target at a place.
    pub fn position(&self, x: &Vector) -> Point {
        let surface = self.embedding.surface();
        self.locator.locate(x).point.position(surface, surface.vertices())
    }
}

/// The target in the chart at a place.
pub(crate) struct InChart<'t> {
    target: &'t HyperbolicTarget,
    chart: Chart,
    centre: Located,
}

impl TargetAround for InChart<'_> {
    type Hint = Located;

    fn hint(&self) -> Located {
        self.centre
    }

    fn image(&self, x: &Vector, hint: &mut Located) -> Point {
        *hint = self.target.locator.locate_near(&self.chart.point(x), hint);
        let surface = self.target.embedding.surface();
        hint.point.position(surface, surface.vertices()) * self.target.scale
    }
}

impl Layout for HyperbolicLayout {
    type Target = HyperbolicTarget;
    type Around<'t> = InChart<'t>;

    fn inserted(&self) -> &[u32] {
        &self.inserted
    }

    fn ring(&self, v: u32) -> impl ExactSizeIterator<Item = u32> {
        self.rings.of(v).iter().map(|r| r.0)
    }

    fn area_scale(&self, points: &[Point]) -> f64 {
        self.area_scale(points)
    }

    fn star<'t>(&self, target: &'t HyperbolicTarget, v: u32) -> Option<(InChart<'t>, Vector, Vec<Vector>)> {
        let place = self.places[v as usize];
        let chart = Chart::at(place);
        let ring = self.ring_places(v).map(|x| chart.place(&x)).collect();
        let centre = target.locator.locate(&place);
        Some((InChart { target, chart, centre }, Vector::z(), ring))
    }

    fn move_to(&mut self, v: u32, place: &Vector) {
        // Beyond the unit circle there is no plane, and near to it a step has overshot.
        if place.xy().norm() < 0.9 {
            self.places[v as usize] = Chart::at(self.places[v as usize]).point(place);
        }
    }
}
