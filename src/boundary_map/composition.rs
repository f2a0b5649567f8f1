//! The ways of the points between vertices: where a boundary map that goes by the sphere takes them.
//!
//! Two surfaces on the sphere, each one to one, make a bijection between them: a point goes to its direction on the one,
//! and to the point of that direction on the other. Both are the gnomonic maps of triangles, so that neighbours agree on
//! the edge they share and the way back has the same form.

use std::sync::{Arc, OnceLock};

use crate::mesh::SurfacePoint;
use crate::spherical::{Locator, SphericalEmbedding};
use crate::{Point, Vector};

/// Ways by the sphere; data are shared between copies.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Composition {
    pub domain: Arc<LocatedEmbedding>,
    /// `None` when the unit sphere itself is the target.
    pub target: Option<Arc<LocatedEmbedding>>,
    /// How often the triangles of the drawn domain are cut into four to get those of the boundary map's.
    pub subdivisions: u32,
}

/// A surface on the sphere. What it takes to find points there is made when it is first asked for.
#[derive(Debug)]
pub(super) struct LocatedEmbedding {
    pub map: SphericalEmbedding,
    locator: OnceLock<Locator>,
}

impl PartialEq for LocatedEmbedding {
    fn eq(&self, other: &Self) -> bool {
        self.map == other.map
    }
}

impl LocatedEmbedding {
    pub fn new(map: SphericalEmbedding) -> Self {
        Self {
            map,
            locator: OnceLock::new(),
        }
    }

    fn locator(&self) -> &Locator {
        self.locator.get_or_init(|| Locator::new(&self.map))
    }
}

impl Composition {
    pub fn direction(&self, point: &SurfacePoint) -> Vector {
        let point = undivided(point, self.subdivisions);
        let [l, m, n] = point.barycentric;
        let zeros = [m, n, l].map(|c| c == 0.0);
        // A vertex has the direction that it was given, bit for bit, so that it meets a vertex of the target exactly.
        let corner = (0..3).find(|&k| zeros[k] && zeros[(k + 1) % 3] && point.barycentric[k] > 0.0);
        match corner {
            Some(k) => {
                let vertex = self.domain.map.surface().triangles()[point.triangle as usize][k];
                self.domain.map.directions()[vertex as usize]
            }
            None => self.domain.map.direction(&point),
        }
    }

    /// Where the point goes on the target's surface; `None` when that is the unit sphere.
    pub fn on_target(&self, point: &SurfacePoint) -> Option<SurfacePoint> {
        let target = self.target.as_ref()?;
        Some(target.locator().locate(&self.direction(point)))
    }

    pub fn image(&self, point: &SurfacePoint) -> Point {
        match (&self.target, self.on_target(point)) {
            (Some(target), Some(found)) => {
                let surface = target.map.surface();
                found.position(surface, surface.vertices())
            }
            _ => Point::from(self.direction(point)),
        }
    }
}

/// The same point over the triangles that there were before so many subdivisions.
pub(super) fn undivided(point: &SurfacePoint, subdivisions: u32) -> SurfacePoint {
    (0..subdivisions).fold(*point, |child, _| {
        let [l, m, n] = child.barycentric;
        let part = child.triangle as usize % 4;
        let barycentric = if part == 3 {
            [l + n, m + l, n + m].map(|c| 0.5 * c)
        } else {
            let mut halves = [l, m, n].map(|c| 0.5 * c);
            halves[part] += 0.5 * (l + m + n);
            halves
        };
        SurfacePoint {
            triangle: child.triangle / 4,
            barycentric,
        }
    })
}
