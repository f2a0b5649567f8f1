//! Layouts on the unit sphere, and the target as they see it.

use std::f64::consts::PI;

use super::{Layout, TargetAround};
use crate::mesh::triangle_area;
use crate::spherical::{Locator, SphericalEmbedding, tangents};
use crate::toroidal::{LiftedRings, Translations};
use crate::{Point, Vector};

/// Neighbours in a direction with a smaller cosine are too far away for one plane.
const LEAST_COSINE: f64 = 0.1;

/// The directions of a surface's vertices.
#[derive(Debug, Clone)]
pub(crate) struct SphereLayout {
    pub directions: Vec<Vector>,
    /// Nothing is translated.
    rings: LiftedRings<Translations>,
    inserted: Vec<u32>,
}

impl SphereLayout {
    pub fn new(embedding: &SphericalEmbedding) -> Self {
        let triangles = embedding.surface().triangles();
        let directions = embedding.directions().to_vec();
        let none = vec![[[0; 2]; 3]; triangles.len()];
        Self {
            rings: LiftedRings::new(Translations, directions.len(), triangles, &none),
            inserted: (0..directions.len() as u32).collect(),
            directions,
        }
    }
}

/// From directions to points of the target, which may be the sphere itself.
pub(crate) struct SphereTarget {
    onto: Option<(SphericalEmbedding, Locator)>,
    /// Lengths of the target are multiplied by this, so that its area is that of the sphere.
    pub scale: f64,
}

impl SphereTarget {
    pub fn new(embedding: Option<&SphericalEmbedding>) -> Self {
        Self {
            scale: embedding.map_or(1.0, |embedding| (4.0 * PI / embedding.surface().area()).sqrt()),
            onto: embedding.map(|embedding| (embedding.clone(), Locator::new(embedding))),
        }
    }
}

/// The plane that touches the sphere at a direction, with the image of each of its points.
pub(crate) struct OnTangentPlane<'t> {
    target: &'t SphereTarget,
    frame: [Vector; 3],
}

/// Two unit vectors across and the direction itself.
fn frame(x: &Vector) -> [Vector; 3] {
    let [s, t] = tangents(x);
    [s, t, *x]
}

fn from_plane([s, t, x]: &[Vector; 3], place: &Vector) -> Vector {
    // Exactly there, so that what has not moved stays as it is.
    if place.x == 0.0 && place.y == 0.0 {
        return *x;
    }
    (s * place.x + t * place.y + x).normalize()
}

impl TargetAround for OnTangentPlane<'_> {
    type Hint = u32;

    fn hint(&self) -> u32 {
        u32::MAX
    }

    fn image(&self, x: &Vector, hint: &mut u32) -> Point {
        let direction = from_plane(&self.frame, x);
        match &self.target.onto {
            None => Point::from(direction),
            Some((embedding, locator)) => {
                let found = locator.locate_from(&direction, *hint);
                *hint = found.triangle;
                let surface = embedding.surface();
                found.position(surface, surface.vertices()) * self.target.scale
            }
        }
    }
}

impl Layout for SphereLayout {
    type Target = SphereTarget;
    type Around<'t> = OnTangentPlane<'t>;

    fn inserted(&self) -> &[u32] {
        &self.inserted
    }

    fn ring(&self, v: u32) -> impl ExactSizeIterator<Item = u32> {
        self.rings.of(v).iter().map(|r| r.0)
    }

    fn area_scale(&self, points: &[Point]) -> f64 {
        let area = |t: &[u32; 3]| triangle_area(&t.map(|v| points[v as usize]));
        let total: f64 = self.rings.triangles().0.iter().map(area).sum();
        4.0 * PI / total.max(f64::MIN_POSITIVE)
    }

    fn star<'t>(&self, target: &'t SphereTarget, v: u32) -> Option<(OnTangentPlane<'t>, Vector, Vec<Vector>)> {
        let frame = frame(&self.directions[v as usize]);
        let place = |r: u32| {
            let [u, w, height] = frame.map(|axis| axis.dot(&self.directions[r as usize]));
            (height > LEAST_COSINE).then(|| Vector::new(u / height, w / height, 1.0))
        };
        let ring = self.ring(v).map(place).collect::<Option<_>>()?;
        Some((OnTangentPlane { target, frame }, Vector::z(), ring))
    }

    fn move_to(&mut self, v: u32, place: &Vector) {
        self.directions[v as usize] = from_plane(&frame(&self.directions[v as usize]), place);
    }
}
