//! The target as layouts of the domain in the hyperbolic plane see it, and the energy of these.

use rayon::prelude::*;

use super::super::torus::element::image_energy;
use super::super::torus::energy::Cut;
use super::super::torus::star::{Layout, TargetAround};
use crate::hyperbolic::{Chart, HyperbolicEmbedding, HyperbolicLayout, HyperbolicLocator, Located};
use crate::spherical::RestShape;
use crate::{Point, Vector};

/// From places on the hyperboloid to points of the target.
pub(in crate::boundary_map::pair) struct HyperbolicTarget {
    pub embedding: HyperbolicEmbedding,
    locator: HyperbolicLocator,
    /// Lengths of the target are multiplied by this, so that its area is that of the hyperbolic surface.
    scale: f64,
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
pub(in crate::boundary_map::pair) struct InChart<'t> {
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

    fn star<'t>(&self, target: &'t HyperbolicTarget, v: u32) -> (InChart<'t>, Vector, Vec<Vector>) {
        let place = self.places[v as usize];
        let chart = Chart::at(place);
        let ring = self.ring_places(v).map(|x| chart.place(&x)).collect();
        let centre = target.locator.locate(&place);
        (InChart { target, chart, centre }, Vector::z(), ring)
    }

    fn move_to(&mut self, v: u32, place: &Vector) {
        // Beyond the unit circle there is no plane, and near to it a step has overshot.
        if place.xy().norm() < 0.9 {
            self.places[v as usize] = Chart::at(self.places[v as usize]).point(place);
        }
    }
}

/// The mean energy of the images of triangles, 1 for an isometry, where that of a triangle counts up to `most` times that of an isometry.
pub(super) fn mean_energy(
    layout: &HyperbolicLayout,
    target: &HyperbolicTarget,
    points: &[Point],
    cuts: usize,
    softness: f64,
    most: f64,
) -> f64 {
    let cut = Cut::new(cuts);
    let area_scale = layout.area_scale(points);
    let of_vertex = |&v: &u32| -> [f64; 2] {
        let ids: Vec<u32> = layout.ring(v).collect();
        let (around, x, ring) = layout.star(target, v);
        let mut sums = [0.0; 2];
        for i in 0..ids.len() {
            let next = (i + 1) % ids.len();
            // Each triangle once.
            if v > ids[i] || v > ids[next] {
                continue;
            }
            let rest = RestShape::of_triangle([v, ids[i], ids[next]].map(|u| &points[u as usize]), area_scale);
            let part = cut.part_of(&rest);
            let mut hint = around.hint();
            let image = |[l, m, n]: &[f64; 3]| around.image(&(x * *l + ring[i] * *m + ring[next] * *n), &mut hint);
            let images: Vec<Point> = cut.samples.iter().map(image).collect();
            let energy = |corners: &[usize; 3]| image_energy(corners.map(|k| &images[k]), &part, softness);
            let energy: f64 = cut.parts.iter().map(energy).sum();
            sums[0] += energy.min(most * rest.area);
            sums[1] += rest.area;
        }
        sums
    };
    let parts: Vec<[f64; 2]> = layout.inserted.par_iter().map(of_vertex).collect();
    let sum = |k: usize| parts.iter().map(|part| part[k]).sum::<f64>();
    sum(0) / sum(1)
}
