//! Compositions of spherical embeddings: a point goes to its direction on the domain's embedding, and from there to the
//! point of the target that has the same direction.
//!
//! Both embeddings are gnomonic maps of triangles and bijective, so that the composition is continuous across edges,
//! bijective, and its inverse is a composition too.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::spherical::{Locator, SphericalEmbedding};
use crate::{Point, Vector};

/// The composition of the domain's spherical embedding with the inverse of the target's. Copies share the embeddings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Composition {
    domain: Arc<LocatedEmbedding>,
    /// `None` when the unit sphere itself is the target.
    target: Option<Arc<LocatedEmbedding>>,
    /// How often each triangle of the embedded domain has been cut into four to make those of the boundary map's
    /// domain.
    subdivisions: u32,
}

/// A spherical embedding, with the search structure of its inverse, which is built when it is first needed.
#[derive(Debug)]
struct LocatedEmbedding {
    embedding: SphericalEmbedding,
    locator: OnceLock<Locator>,
}

impl PartialEq for LocatedEmbedding {
    fn eq(&self, other: &Self) -> bool {
        self.embedding == other.embedding
    }
}

impl LocatedEmbedding {
    fn new(embedding: SphericalEmbedding) -> Self {
        Self {
            embedding,
            locator: OnceLock::new(),
        }
    }

    fn locator(&self) -> &Locator {
        self.locator.get_or_init(|| Locator::new(&self.embedding))
    }
}

impl Composition {
    /// The map to the target, or to the unit sphere without one.
    pub fn new(domain: SphericalEmbedding, target: Option<SphericalEmbedding>) -> Self {
        Self {
            domain: Arc::new(LocatedEmbedding::new(domain)),
            target: target.map(|target| Arc::new(LocatedEmbedding::new(target))),
            subdivisions: 0,
        }
    }

    /// The domain's embedding, as it was before subdivision.
    pub fn domain(&self) -> &SphericalEmbedding {
        &self.domain.embedding
    }

    pub fn target(&self) -> Option<&SphericalEmbedding> {
        self.target.as_ref().map(|target| &target.embedding)
    }

    pub fn subdivisions(&self) -> u32 {
        self.subdivisions
    }

    /// The same map over a domain whose triangles are each cut into four.
    pub fn subdivided(&self) -> Self {
        Self {
            subdivisions: self.subdivisions + 1,
            ..self.clone()
        }
    }

    /// The map back to the domain as it was before subdivision; `None` from the unit sphere.
    pub fn inverse(&self) -> Option<Self> {
        Some(Self {
            domain: self.target.clone()?,
            target: Some(self.domain.clone()),
            subdivisions: 0,
        })
    }

    pub fn direction(&self, point: &SurfacePoint) -> Vector {
        let point = before_subdivision(point, self.subdivisions);
        let [l, m, n] = point.barycentric;
        let zeros = [m, n, l].map(|c| c == 0.0);
        // A vertex has its own direction, bit for bit, so that it goes exactly to a vertex of the target with the same.
        let corner = (0..3).find(|&k| zeros[k] && zeros[(k + 1) % 3] && point.barycentric[k] > 0.0);
        match corner {
            Some(k) => {
                let vertex = self.domain().surface().triangles()[point.triangle as usize][k];
                self.domain().directions()[vertex as usize]
            }
            None => self.domain().direction(&point),
        }
    }

    /// The image on the target's surface; `None` when the unit sphere is the target.
    pub fn on_target(&self, point: &SurfacePoint) -> Option<SurfacePoint> {
        let target = self.target.as_ref()?;
        Some(target.locator().locate(&self.direction(point)))
    }

    pub fn image(&self, point: &SurfacePoint) -> Point {
        match (self.target(), self.on_target(point)) {
            (Some(target), Some(found)) => found.position(target.surface(), target.surface().vertices()),
            _ => Point::from(self.direction(point)),
        }
    }

    /// Images of the vertices of `domain`, from index `first` on.
    pub fn images_of_vertices(&self, domain: &SurfaceMesh, first: usize) -> Vec<Point> {
        let places = vertex_places(domain);
        let new = places[first..].par_iter().with_min_len(256);
        new.map(|p| self.image(p)).collect()
    }
}

/// Each vertex as a corner of a triangle; vertices without triangles as the first corner of the first.
pub(super) fn vertex_places(mesh: &SurfaceMesh) -> Vec<SurfacePoint> {
    let mut places = vec![SurfacePoint::corner(0, 0); mesh.vertices().len()];
    for (t, corners) in mesh.triangles().iter().enumerate() {
        for (k, &v) in corners.iter().enumerate() {
            places[v as usize] = SurfacePoint::corner(t as u32, k);
        }
    }
    places
}

/// The same point, on the triangles as they were this many subdivisions ago.
pub(super) fn before_subdivision(point: &SurfacePoint, subdivisions: u32) -> SurfacePoint {
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
