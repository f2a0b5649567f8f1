//! Compositions of embeddings: a point goes to its place on the sphere, on a flat torus or on a hyperbolic surface by the domain's
//! embedding, and from there to the point of the target that has the same place.
//!
//! Both embeddings are bijective and continuous across edges, so that the composition is, too, and its inverse is a
//! composition.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::hyperbolic::{HyperbolicEmbedding, HyperbolicLocator};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::spherical::{EmbeddingCheck, Locator, SphericalEmbedding, check_embedding};
use crate::toroidal::{ToroidalEmbedding, ToroidalLocator};
use crate::{Point, Vector};

/// The composition of the domain's embedding with the inverse of the target's. Copies share the embeddings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Composition {
    domain: Arc<LocatedEmbedding>,
    /// `None` when the unit sphere itself is the target.
    target: Option<Arc<LocatedEmbedding>>,
    /// How often each triangle of the embedded domain has been cut into four to make those of the boundary map's
    /// domain.
    subdivisions: u32,
}

/// An embedding of any kind.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum SurfaceEmbedding {
    Sphere(SphericalEmbedding),
    Torus(ToroidalEmbedding),
    Hyperbolic(HyperbolicEmbedding),
}

/// A place on the sphere, in the square of a flat torus, or on the hyperboloid.
#[derive(Debug, Clone, Copy)]
enum Place {
    Sphere(Vector),
    Torus([f64; 2]),
    Hyperbolic(Vector),
}

#[derive(Debug)]
enum EmbeddingLocator {
    Sphere(Locator),
    Torus(ToroidalLocator),
    Hyperbolic(HyperbolicLocator),
}

/// An embedding, with the search structure of its inverse, which is built when it is first needed.
#[derive(Debug)]
struct LocatedEmbedding {
    embedding: SurfaceEmbedding,
    locator: OnceLock<EmbeddingLocator>,
}

impl SurfaceEmbedding {
    pub fn surface(&self) -> &SurfaceMesh {
        match self {
            Self::Sphere(embedding) => embedding.surface(),
            Self::Torus(embedding) => embedding.surface(),
            Self::Hyperbolic(embedding) => embedding.surface(),
        }
    }

    /// Whether it is a bijection: decided again.
    pub fn check(&self) -> EmbeddingCheck {
        match self {
            Self::Sphere(embedding) => check_embedding(embedding.surface().triangles(), embedding.directions()),
            Self::Torus(embedding) => embedding.check(),
            Self::Hyperbolic(embedding) => embedding.check(),
        }
    }

    pub fn as_sphere(&self) -> Option<&SphericalEmbedding> {
        match self {
            Self::Sphere(embedding) => Some(embedding),
            _ => None,
        }
    }

    pub fn as_torus(&self) -> Option<&ToroidalEmbedding> {
        match self {
            Self::Torus(embedding) => Some(embedding),
            _ => None,
        }
    }

    pub fn as_hyperbolic(&self) -> Option<&HyperbolicEmbedding> {
        match self {
            Self::Hyperbolic(embedding) => Some(embedding),
            _ => None,
        }
    }

    fn place(&self, point: &SurfacePoint) -> Place {
        match self {
            Self::Sphere(embedding) => Place::Sphere(direction(embedding, point)),
            Self::Torus(embedding) => Place::Torus(embedding.position(point)),
            Self::Hyperbolic(embedding) => Place::Hyperbolic(embedding.place(point)),
        }
    }
}

/// The direction of a point. A vertex has its own, bit for bit, so that it goes exactly to a vertex of the target with the same.
fn direction(embedding: &SphericalEmbedding, point: &SurfacePoint) -> Vector {
    let [l, m, n] = point.barycentric;
    let zeros = [m, n, l].map(|c| c == 0.0);
    let corner = (0..3).find(|&k| zeros[k] && zeros[(k + 1) % 3] && point.barycentric[k] > 0.0);
    match corner {
        Some(k) => {
            let vertex = embedding.surface().triangles()[point.triangle as usize][k];
            embedding.directions()[vertex as usize]
        }
        None => embedding.direction(point),
    }
}

impl PartialEq for LocatedEmbedding {
    fn eq(&self, other: &Self) -> bool {
        self.embedding == other.embedding
    }
}

impl LocatedEmbedding {
    fn new(embedding: SurfaceEmbedding) -> Self {
        Self {
            embedding,
            locator: OnceLock::new(),
        }
    }

    /// The point at a place. `None` on the other kind of surface.
    fn locate(&self, place: &Place) -> Option<SurfacePoint> {
        let locator = self.locator.get_or_init(|| match &self.embedding {
            SurfaceEmbedding::Sphere(embedding) => EmbeddingLocator::Sphere(Locator::new(embedding)),
            SurfaceEmbedding::Torus(embedding) => EmbeddingLocator::Torus(ToroidalLocator::new(embedding)),
            SurfaceEmbedding::Hyperbolic(embedding) => EmbeddingLocator::Hyperbolic(HyperbolicLocator::new(embedding)),
        });
        match (locator, place) {
            (EmbeddingLocator::Sphere(locator), Place::Sphere(x)) => Some(locator.locate(x)),
            (EmbeddingLocator::Torus(locator), Place::Torus(x)) => Some(locator.locate(*x)),
            (EmbeddingLocator::Hyperbolic(locator), Place::Hyperbolic(x)) => Some(locator.locate(x).point),
            _ => None,
        }
    }
}

impl Composition {
    /// The map of an embedded surface to the unit sphere.
    pub fn onto_sphere(domain: SphericalEmbedding) -> Self {
        Self::new(SurfaceEmbedding::Sphere(domain), None)
    }

    /// The map between two surfaces that are embedded in the sphere.
    pub fn through_sphere(domain: SphericalEmbedding, target: SphericalEmbedding) -> Self {
        Self::new(SurfaceEmbedding::Sphere(domain), Some(SurfaceEmbedding::Sphere(target)))
    }

    /// The map between two surfaces that are embedded in the flat torus.
    pub fn through_torus(domain: ToroidalEmbedding, target: ToroidalEmbedding) -> Self {
        Self::new(SurfaceEmbedding::Torus(domain), Some(SurfaceEmbedding::Torus(target)))
    }

    /// The map between two surfaces that are embedded in one hyperbolic surface: their relators are the same.
    pub fn through_hyperbolic_surface(domain: HyperbolicEmbedding, target: HyperbolicEmbedding) -> Self {
        let domain = SurfaceEmbedding::Hyperbolic(domain);
        Self::new(domain, Some(SurfaceEmbedding::Hyperbolic(target)))
    }

    fn new(domain: SurfaceEmbedding, target: Option<SurfaceEmbedding>) -> Self {
        Self {
            domain: Arc::new(LocatedEmbedding::new(domain)),
            target: target.map(|target| Arc::new(LocatedEmbedding::new(target))),
            subdivisions: 0,
        }
    }

    /// The domain's embedding, as it was before subdivision.
    pub fn domain(&self) -> &SurfaceEmbedding {
        &self.domain.embedding
    }

    pub fn target(&self) -> Option<&SurfaceEmbedding> {
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

    fn place(&self, point: &SurfacePoint) -> Place {
        self.domain().place(&before_subdivision(point, self.subdivisions))
    }

    /// The direction of a point; `None` when the map does not go through the sphere.
    pub fn direction(&self, point: &SurfacePoint) -> Option<Vector> {
        match self.place(point) {
            Place::Sphere(x) => Some(x),
            _ => None,
        }
    }

    /// The point of the embedded domain at the place of this one: the round trip of a map onto the sphere.
    pub fn back_in_domain(&self, point: &SurfacePoint) -> Option<SurfacePoint> {
        self.domain.locate(&self.place(point))
    }

    /// The image on the target's surface; `None` when the unit sphere is the target.
    pub fn on_target(&self, point: &SurfacePoint) -> Option<SurfacePoint> {
        self.target.as_ref()?.locate(&self.place(point))
    }

    pub fn image(&self, point: &SurfacePoint) -> Point {
        match (self.target(), self.on_target(point), self.place(point)) {
            (Some(target), Some(found), _) => found.position(target.surface(), target.surface().vertices()),
            (_, _, Place::Sphere(x)) => Point::from(x),
            (_, _, Place::Torus([u, v])) => Point::new(u, v, 0.0),
            (_, _, Place::Hyperbolic(x)) => Point::from(x),
        }
    }
}

/// Images of the vertices of `domain`, from index `first` on.
pub(super) fn images_of_vertices(
    domain: &SurfaceMesh,
    first: usize,
    image: impl Fn(&SurfacePoint) -> Point + Sync + Send,
) -> Vec<Point> {
    let places = vertex_places(domain);
    let new = places[first..].par_iter().with_min_len(256);
    new.map(image).collect()
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
