//! Layouts on a flat torus, and the target as they see it.

use super::{Layout, TargetAround};
use crate::toroidal::{PartialLayout, Periods, TORUS_AREA, ToroidalEmbedding, ToroidalLocator};
use crate::{Point, Vector};

/// The target as the domain's layouts see it: from places in the plane to points of it.
pub(crate) struct TargetTorus {
    pub embedding: ToroidalEmbedding,
    locator: ToroidalLocator,
    pub periods: Periods,
    /// Lengths of the target are multiplied by this, so that its area is that of the torus.
    pub scale: f64,
}

/// The image of a place.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Image {
    pub point: Point,
    /// The copy of the triangle of the target, for the next search nearby.
    pub copy: u32,
}

impl TargetTorus {
    pub fn new(embedding: &ToroidalEmbedding, periods: Periods) -> Self {
        Self {
            embedding: embedding.clone(),
            locator: ToroidalLocator::new(embedding),
            periods,
            scale: (TORUS_AREA / embedding.surface().area()).sqrt(),
        }
    }

    pub fn image(&self, x: &Vector, copy: u32) -> Image {
        let found = self.locator.locate_from(self.periods.coordinates(x), copy);
        let surface = self.embedding.surface();
        Image {
            point: found.point.position(surface, surface.vertices()) * self.scale,
            copy: found.copy,
        }
    }

    /// Diagonal of the target.
    pub fn diagonal(&self) -> f64 {
        self.embedding.surface().diagonal()
    }

    /// The point of the target itself.
    pub fn position(&self, x: &Vector) -> Point {
        self.image(x, u32::MAX).point / self.scale
    }
}

impl Layout for PartialLayout {
    type Target = TargetTorus;
    type Around<'t> = &'t TargetTorus;

    fn inserted(&self) -> &[u32] {
        &self.inserted
    }

    fn ring(&self, v: u32) -> impl ExactSizeIterator<Item = u32> {
        self.rings.of(v).iter().map(|r| r.0)
    }

    fn area_scale(&self, points: &[Point]) -> f64 {
        self.area_scale(points)
    }

    fn star<'t>(&self, target: &'t TargetTorus, v: u32) -> Option<(&'t TargetTorus, Vector, Vec<Vector>)> {
        let place = |&(r, shift): &(u32, _)| self.places[r as usize] + self.periods.translation(shift);
        let ring = self.rings.of(v).iter().map(place).collect();
        Some((target, self.places[v as usize], ring))
    }

    fn move_to(&mut self, v: u32, place: &Vector) {
        self.places[v as usize] = *place;
    }
}

impl TargetAround for &TargetTorus {
    type Hint = u32;

    fn hint(&self) -> u32 {
        u32::MAX
    }

    fn image(&self, x: &Vector, hint: &mut u32) -> Point {
        let found = TargetTorus::image(self, x, *hint);
        *hint = found.copy;
        found.point
    }
}
