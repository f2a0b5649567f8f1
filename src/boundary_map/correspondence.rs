//! A boundary map: the image of every vertex of the domain, and of every point between them.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

use rayon::prelude::*;

use super::composition::{Composition, LocatedEmbedding};
use super::function::Function;
use crate::mesh::{SurfaceMesh, SurfacePoint, TetMesh};
use crate::spherical::SphericalEmbedding;
use crate::{Point, Vector};

/// A boundary map `f'`: where each point of the domain's surface goes.
///
/// Given by images of the vertices alone, it is linear over the triangles in between. By way of the sphere
/// ([`Self::onto_sphere`], [`Self::through_sphere`]) it is a bijection with the target's surface, and the images of points
/// between vertices lie on that surface, not on the straight triangles over the images of the vertices.
///
/// Copies share the domain and what the ways by the sphere need.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryMap {
    domain: Arc<SurfaceMesh>,
    image: Vec<Point>,
    /// `None` for straight ways, and for those of a function.
    composition: Option<Composition>,
    function: Option<Function>,
}

/// Why a domain and an image do not make a boundary map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundaryMapError {
    /// The image must have one position per vertex of the domain.
    #[error(
        "the domain has {domain} vertices and the image {image}; the image must be the domain's mesh with other vertex \
         positions (STL files lose the vertex order: use OBJ or PLY)"
    )]
    VertexCount {
        /// Vertices of the domain.
        domain: usize,
        /// Vertices of the image.
        image: usize,
    },
    /// The image's mesh has another number of faces.
    #[error(
        "the domain has {domain} {element}s and the image {image}; the image must be the domain's mesh with other \
         vertex positions"
    )]
    FaceCount {
        /// `"triangle"` or `"tetrahedron"`.
        element: &'static str,
        /// Elements of the domain.
        domain: usize,
        /// Elements of the image.
        image: usize,
    },
    /// The image's mesh connects other vertices.
    #[error(
        "{element} {index} joins vertices {domain:?} in the domain but {image:?} in the image; the image must be the \
         domain's mesh with other vertex positions, in the same order"
    )]
    Connectivity {
        /// `"triangle"` or `"tetrahedron"`.
        element: &'static str,
        /// The first that differs, 0-based.
        index: usize,
        /// Its vertices in the domain.
        domain: Vec<u32>,
        /// Its vertices in the image.
        image: Vec<u32>,
    },
    /// An image position is NaN or infinite.
    #[error("the image of vertex {vertex} is not finite: ({}, {}, {})", position[0], position[1], position[2])]
    NonFinite {
        /// The first such vertex.
        vertex: usize,
        /// Its image.
        position: [f64; 3],
    },
    /// Squares of lengths would leave the range of numbers.
    #[error("the {solid} has a size of {diagonal:e}; scale it to between 1e-100 and 1e100")]
    OutOfScale {
        /// `"domain"` or `"target"`.
        solid: &'static str,
        /// Diagonal of its bounding box.
        diagonal: f64,
    },
    /// Vertices or triangles are not those of the domain.
    #[error("the boundary map belongs to another domain: {difference}")]
    OtherDomain {
        /// The first difference.
        difference: String,
    },
    /// All image positions coincide, so that there is no target to measure errors by.
    #[error("all {vertices} image positions coincide; there is no target solid")]
    NoExtent {
        /// How many positions there are.
        vertices: usize,
    },
}

impl BoundaryMap {
    /// The map that sends vertex `v` of `domain` to `image[v]`.
    ///
    /// # Errors
    ///
    /// When the counts differ, or the image is not finite or has no extent.
    pub fn new(domain: impl Into<Arc<SurfaceMesh>>, image: Vec<Point>) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        if domain.vertices().len() != image.len() {
            return Err(BoundaryMapError::VertexCount {
                domain: domain.vertices().len(),
                image: image.len(),
            });
        }
        if let Some(vertex) = image.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            return Err(BoundaryMapError::NonFinite {
                vertex,
                position: image[vertex].coords.into(),
            });
        }
        require_extent(&domain, &image, extent(&domain, &image))?;
        Ok(Self {
            domain,
            image,
            composition: None,
            function: None,
        })
    }

    /// The map that sends each point of `domain` where `function` takes it: for data that vary within triangles, such as
    /// the colours of a texture (section 5.4 of the paper). The function has finite values; at an edge, what it says of
    /// the two triangles may differ. Errors are measured in the diagonal of the box from `low` to `high`, which stands for
    /// the target's. Files keep the images of the vertices only.
    ///
    /// # Errors
    ///
    /// When the image of a vertex is not finite, the box has no extent, or the domain or the box is out of scale.
    pub fn by_function(
        domain: SurfaceMesh,
        (low, high): (Point, Point),
        function: impl Fn(&SurfacePoint) -> Point + Send + Sync + 'static,
    ) -> Result<Self, BoundaryMapError> {
        let function = Function::new(function, (low, high));
        let image = function.images_of_vertices(&domain);
        if let Some(vertex) = image.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            return Err(BoundaryMapError::NonFinite {
                vertex,
                position: image[vertex].coords.into(),
            });
        }
        let diagonal = (high - low).norm();
        if diagonal.is_nan() {
            return Err(BoundaryMapError::OutOfScale {
                solid: "target",
                diagonal,
            });
        }
        require_extent(&domain, &[low, high], diagonal)?;
        Ok(Self {
            domain: Arc::new(domain),
            image,
            composition: None,
            function: Some(function),
        })
    }

    /// The map that sends each point of a surface to its direction, a point of the unit sphere about the origin.
    ///
    /// # Errors
    ///
    /// When the surface is too small or too large to calculate with.
    pub fn onto_sphere(domain: SphericalEmbedding) -> Result<Self, BoundaryMapError> {
        Self::by_sphere(Composition {
            domain: Arc::new(LocatedEmbedding::new(domain)),
            target: None,
            subdivisions: 0,
        })
    }

    /// The map that sends each point of one surface to the point of the other that has the same direction. A vertex whose
    /// direction is that of a vertex of the target, bit for bit, goes exactly there.
    ///
    /// # Errors
    ///
    /// When a surface is too small or too large to calculate with.
    pub fn through_sphere(domain: SphericalEmbedding, target: SphericalEmbedding) -> Result<Self, BoundaryMapError> {
        Self::by_sphere(Composition {
            domain: Arc::new(LocatedEmbedding::new(domain)),
            target: Some(Arc::new(LocatedEmbedding::new(target))),
            subdivisions: 0,
        })
    }

    fn by_sphere(composition: Composition) -> Result<Self, BoundaryMapError> {
        let domain = composition.domain.map.surface().clone();
        let image = match &composition.target {
            Some(target) => {
                let surface = target.map.surface();
                require_extent(&domain, surface.vertices(), extent(surface, surface.vertices()))?;
                images_of_vertices(&composition, &domain, 0)
            }
            None => {
                let image: Vec<Point> = composition.domain.map.directions().iter().map(|&x| x.into()).collect();
                require_extent(&domain, &image, extent(&domain, &image))?;
                image
            }
        };
        Ok(Self {
            domain: Arc::new(domain),
            image,
            composition: Some(composition),
            function: None,
        })
    }

    /// The map from the target's surface back to the domain's; `None` unless it goes through the sphere to another surface.
    /// Subdivided domains are as they were before.
    pub fn inverse(&self) -> Option<Self> {
        let composition = self.composition.as_ref()?;
        let back = Composition {
            domain: composition.target.clone()?,
            target: Some(composition.domain.clone()),
            subdivisions: 0,
        };
        // Both surfaces have passed the checks.
        Self::by_sphere(back).ok()
    }

    /// The same map over this domain, which has the same vertices and triangles. A straight map's may be turned over.
    ///
    /// # Errors
    ///
    /// [`BoundaryMapError::OtherDomain`] with the first difference.
    pub fn over(&self, domain: impl Into<Arc<SurfaceMesh>>) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        let other = |difference: String| BoundaryMapError::OtherDomain { difference };
        let (own, given) = (self.domain.vertices(), domain.vertices());
        if own.len() != given.len() {
            return Err(other(format!(
                "it has {} vertices, and this {}",
                own.len(),
                given.len()
            )));
        }
        let show = |p: &Point| format!("({}, {}, {})", p.x, p.y, p.z);
        if let Some(v) = (0..own.len()).find(|&v| own[v] != given[v]) {
            let (own, given) = (show(&own[v]), show(&given[v]));
            return Err(other(format!("vertex {v} is at {own} there, and at {given} here")));
        }
        require_same_elements("triangle", self.domain.triangles(), domain.triangles())
            .map_err(|e| other(e.to_string()))?;
        let is_straight = self.composition.is_none() && self.function.is_none();
        if !is_straight && self.domain.triangles() != domain.triangles() {
            return Err(other("triangles are turned; let them face outward".into()));
        }
        Ok(Self { domain, ..self.clone() })
    }

    /// The map from a mesh to one of the same connectivity.
    ///
    /// # Errors
    ///
    /// As [`BoundaryMap::new`], and when the meshes join different vertices. The corners of a triangle may be listed
    /// in any order: a reflecting map turns its image inside out, and that is no defect of the files.
    pub fn between(domain: impl Into<Arc<SurfaceMesh>>, image: &SurfaceMesh) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        if domain.vertices().len() != image.vertices().len() {
            let (domain, image) = (domain.vertices().len(), image.vertices().len());
            return Err(BoundaryMapError::VertexCount { domain, image });
        }
        require_same_elements("triangle", domain.triangles(), image.triangles())?;
        Self::new(domain, image.vertices().to_vec())
    }

    /// The map between the boundaries of two tetrahedral meshes of the same connectivity. The boundary's vertices keep
    /// the order they have in the meshes.
    ///
    /// # Errors
    ///
    /// As [`BoundaryMap::between`].
    pub fn between_tets(domain: &TetMesh, image: &TetMesh) -> Result<Self, BoundaryMapError> {
        if domain.vertices().len() != image.vertices().len() {
            let (domain, image) = (domain.vertices().len(), image.vertices().len());
            return Err(BoundaryMapError::VertexCount { domain, image });
        }
        require_same_elements("tetrahedron", domain.tets(), image.tets())?;
        let boundary = domain.boundary();
        let images = boundary
            .vertex_ids
            .iter()
            .map(|&v| image.vertices()[v as usize])
            .collect();
        Self::new(boundary.surface, images)
    }

    /// The surface being mapped.
    pub fn domain(&self) -> &SurfaceMesh {
        &self.domain
    }

    /// The image of each vertex.
    pub fn image(&self) -> &[Point] {
        &self.image
    }

    /// The domain's triangles over the image positions. For a map by the sphere they only come near the target: see
    /// [`Self::target_surface`].
    pub fn target(&self) -> SurfaceMesh {
        self.domain
            .with_vertices(self.image.clone())
            .expect("counts were compared when the map was made")
    }

    /// The target as the boundary of a solid, oriented outward: a reflecting map has turned it inside out.
    pub fn outward_target(&self) -> SurfaceMesh {
        let target = self.target_surface().cloned().unwrap_or_else(|| self.target());
        if target.volume() < 0.0 {
            target.reversed()
        } else {
            target
        }
    }

    /// The surface that points are carried onto, where it has triangles of its own.
    pub fn target_surface(&self) -> Option<&SurfaceMesh> {
        self.target_embedding().map(SphericalEmbedding::surface)
    }

    /// The domain on the sphere, of a map by way of it; as it was before it was subdivided.
    pub fn domain_embedding(&self) -> Option<&SphericalEmbedding> {
        self.composition.as_ref().map(|composition| &composition.domain.map)
    }

    /// The target on the sphere, of a map through it to another surface.
    pub fn target_embedding(&self) -> Option<&SphericalEmbedding> {
        Some(&self.composition.as_ref()?.target.as_ref()?.map)
    }

    /// How often the domain was subdivided since it was drawn on the sphere; 0 for straight maps.
    pub fn subdivisions(&self) -> u32 {
        self.composition
            .as_ref()
            .map_or(0, |composition| composition.subdivisions)
    }

    /// Whether a function says where points go, so that the images need not bound a solid.
    pub(crate) fn is_by_function(&self) -> bool {
        self.function.is_some()
    }

    /// Lowest and highest corner of the target's bounding box.
    pub fn target_box(&self) -> (Point, Point) {
        if let Some(function) = &self.function {
            return function.target_box();
        }
        let corner = Point::new(1.0, 1.0, 1.0);
        match (&self.composition, self.target_surface()) {
            (_, Some(surface)) => surface.bounding_box().unwrap_or_default(),
            (Some(_), None) => (-corner, corner),
            (None, None) => self.target().bounding_box().unwrap_or_default(),
        }
    }

    /// Diagonal of the target's bounding box, the unit of reported errors.
    pub fn target_diagonal(&self) -> f64 {
        let (low, high) = self.target_box();
        (high - low).norm()
    }

    /// Volume of the target; negative when the map turns the solid inside out.
    pub fn target_volume(&self) -> f64 {
        match (&self.composition, self.target_surface()) {
            (_, Some(surface)) => surface.volume(),
            (Some(_), None) => 4.0 / 3.0 * PI,
            (None, None) => self.target().volume(),
        }
    }

    /// The same map over a domain whose triangles are each cut into four at the midpoints of their edges: triangle `t`
    /// becomes `4t` to `4t + 3`. The first vertices are the old ones, and the others go where the map takes them.
    pub fn subdivided(&self) -> Self {
        let mut vertices = self.domain.vertices().to_vec();
        let mut image = self.image.clone();
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                for points in [&mut vertices, &mut image] {
                    let between = nalgebra::center(&points[a as usize], &points[b as usize]);
                    points.push(between);
                }
                vertices.len() as u32 - 1
            })
        };
        let mut triangles = Vec::with_capacity(4 * self.domain.triangles().len());
        for &[a, b, c] in self.domain.triangles() {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        let domain = SurfaceMesh::new(vertices, triangles).expect("corners are vertices");
        let composition = self.composition.as_ref().map(|composition| Composition {
            subdivisions: composition.subdivisions + 1,
            ..composition.clone()
        });
        if let Some(composition) = &composition {
            let old = self.image.len();
            image.truncate(old);
            image.extend(images_of_vertices(composition, &domain, old));
        }
        let function = self.function.as_ref().map(Function::subdivided);
        if let Some(function) = &function {
            image = function.images_of_vertices(&domain);
        }
        Self {
            domain: Arc::new(domain),
            image,
            composition,
            function,
        }
    }

    /// Positions of surface points in the domain.
    pub fn positions(&self, points: &[SurfacePoint]) -> Vec<Point> {
        points
            .iter()
            .map(|p| p.position(&self.domain, self.domain.vertices()))
            .collect()
    }

    /// Images of surface points. By way of the sphere each costs some microseconds, in parallel.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Point> {
        if let Some(function) = &self.function {
            return points.par_iter().with_min_len(256).map(|p| function.image(p)).collect();
        }
        match &self.composition {
            None => points.iter().map(|p| p.position(&self.domain, &self.image)).collect(),
            Some(composition) => points
                .par_iter()
                .with_min_len(256)
                .map(|p| composition.image(p))
                .collect(),
        }
    }

    /// Images of surface points as points of [`Self::target_surface`]; `None` where that is.
    pub fn evaluate_on_target(&self, points: &[SurfacePoint]) -> Option<Vec<SurfacePoint>> {
        let composition = self.composition.as_ref()?;
        points
            .par_iter()
            .with_min_len(256)
            .map(|p| composition.on_target(p))
            .collect()
    }

    /// Directions of surface points, unit vectors, of a map by way of the sphere.
    pub fn directions(&self, points: &[SurfacePoint]) -> Option<Vec<Vector>> {
        let composition = self.composition.as_ref()?;
        Some(
            points
                .par_iter()
                .with_min_len(256)
                .map(|p| composition.direction(p))
                .collect(),
        )
    }
}

/// Images of the vertices from number `first` on, each asked for at a corner of a triangle.
fn images_of_vertices(composition: &Composition, domain: &SurfaceMesh, first: usize) -> Vec<Point> {
    let mut places = vec![SurfacePoint::corner(0, 0); domain.vertices().len() - first];
    for (t, corners) in domain.triangles().iter().enumerate() {
        for (k, &v) in corners.iter().enumerate() {
            if v as usize >= first {
                places[v as usize - first] = SurfacePoint::corner(t as u32, k);
            }
        }
    }
    places
        .par_iter()
        .with_min_len(256)
        .map(|p| composition.image(p))
        .collect()
}

/// Diagonal of the bounding box of the triangles at these positions, without squares that over- or underflow.
fn extent(surface: &SurfaceMesh, positions: &[Point]) -> f64 {
    let used = || surface.triangles().iter().flatten().map(|&v| positions[v as usize]);
    let sides = (0..3).map(|k| {
        let along = used().map(|p| p[k]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    });
    sides.fold(0.0, |diagonal: f64, side| diagonal.hypot(side.max(0.0)))
}

/// # Errors
///
/// When the target has no extent, or one of the two is out of scale.
fn require_extent(domain: &SurfaceMesh, image: &[Point], target: f64) -> Result<(), BoundaryMapError> {
    if target == 0.0 {
        return Err(BoundaryMapError::NoExtent { vertices: image.len() });
    }
    let finite_domain = domain.vertices().iter().flat_map(|p| p.iter()).all(|c| c.is_finite());
    let domain = extent(domain, domain.vertices());
    for (solid, diagonal, looked_at) in [("domain", domain, finite_domain), ("target", target, true)] {
        // Without an extent, or not finite, the domain is defective, which is for the input doctor to say.
        if looked_at && (diagonal > 1e100 || (diagonal > 0.0 && diagonal < 1e-100)) {
            return Err(BoundaryMapError::OutOfScale { solid, diagonal });
        }
    }
    Ok(())
}

/// Compares connectivity up to the order of corners within an element.
///
/// # Errors
///
/// [`BoundaryMapError::FaceCount`], or [`BoundaryMapError::Connectivity`] for the first element that differs.
fn require_same_elements<const N: usize>(
    element: &'static str,
    domain: &[[u32; N]],
    image: &[[u32; N]],
) -> Result<(), BoundaryMapError> {
    if domain.len() != image.len() {
        return Err(BoundaryMapError::FaceCount {
            element,
            domain: domain.len(),
            image: image.len(),
        });
    }
    let sorted = |mut corners: [u32; N]| {
        corners.sort_unstable();
        corners
    };
    match (0..domain.len()).find(|&i| domain[i] != image[i] && sorted(domain[i]) != sorted(image[i])) {
        None => Ok(()),
        Some(index) => Err(BoundaryMapError::Connectivity {
            element,
            index,
            domain: domain[index].to_vec(),
            image: image[index].to_vec(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{FitOptions, fit};
    use crate::geometry::SurfaceQuery;
    use crate::mesh::shapes;
    use crate::sampling::held_out;
    use crate::spherical::testing::{graded_spindle, radial_embedding};

    #[test]
    fn is_linear_over_triangles_and_exact_at_corners() {
        let domain = shapes::cube(2.0, 2);
        let stretched = shapes::deformed(&domain, |p| Point::new(3.0 * p.x, p.y - 1.0, p.z));
        let map = BoundaryMap::between(domain, &stretched).unwrap();
        let points = [
            SurfacePoint::corner(5, 2),
            SurfacePoint {
                triangle: 7,
                barycentric: [0.2, 0.3, 0.5],
            },
        ];
        for (x, y) in map.positions(&points).iter().zip(map.evaluate(&points)) {
            assert!((Point::new(3.0 * x.x, x.y - 1.0, x.z) - y).norm() < 1e-15);
        }
    }

    #[test]
    fn rejects_what_does_not_correspond() {
        let domain = shapes::cube(1.0, 2);
        let finer = shapes::cube(1.0, 3);
        assert!(matches!(
            BoundaryMap::between(domain.clone(), &finer),
            Err(BoundaryMapError::VertexCount { domain: 26, image: 56 })
        ));
        let mut triangles = domain.triangles().to_vec();
        triangles.swap(3, 4);
        let shuffled = SurfaceMesh::new(domain.vertices().to_vec(), triangles).unwrap();
        assert!(matches!(
            BoundaryMap::between(domain.clone(), &shuffled),
            Err(BoundaryMapError::Connectivity { index: 3, .. })
        ));
        let mut image = domain.vertices().to_vec();
        image[7].y = f64::NAN;
        assert!(matches!(
            BoundaryMap::new(domain.clone(), image),
            Err(BoundaryMapError::NonFinite { vertex: 7, .. })
        ));
        let point = vec![Point::origin(); 26];
        assert!(matches!(
            BoundaryMap::new(domain, point),
            Err(BoundaryMapError::NoExtent { vertices: 26 })
        ));
    }

    #[test]
    fn accepts_an_image_whose_faces_are_turned_over() {
        let domain = shapes::sphere(1.0, 1);
        assert!(BoundaryMap::between(domain.clone(), &domain.reversed()).is_ok());
    }

    const SEED: u64 = 3;

    fn bumpy_to_cube() -> BoundaryMap {
        let [bumpy, cube] = [shapes::bumpy_sphere(14), shapes::cube(2.0, 9)].map(radial_embedding);
        BoundaryMap::through_sphere(bumpy, cube).unwrap()
    }

    /// How far points of the domain are from where they come back to, over the domain's diagonal.
    fn round_trip(map: &BoundaryMap) -> f64 {
        let points = held_out(map.domain(), 3000, 3000, SEED);
        let there = map.evaluate_on_target(&points).unwrap();
        let back = map.inverse().unwrap().evaluate(&there);
        let pairs = map.positions(&points).into_iter().zip(back);
        pairs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max) / map.domain().diagonal()
    }

    /// The direction carries the rounding error of a unit vector, which over the length of a triangle's sides on the sphere
    /// is that of the barycentric coordinates.
    #[test]
    fn there_and_back_returns_to_the_point() {
        assert!(round_trip(&bumpy_to_cube()) < 1e-13);
        assert!(round_trip(&bumpy_to_cube().inverse().unwrap()) < 1e-13);
        assert!(round_trip(&bumpy_to_cube().subdivided()) < 1e-13);
        // Heights of 0.02 and 4e-7 on the sphere.
        let small = |power| {
            BoundaryMap::through_sphere(graded_spindle(power, 12), radial_embedding(shapes::sphere(1.0, 3))).unwrap()
        };
        assert!(round_trip(&small(1.5)) < 1e-12);
        assert!(round_trip(&small(6.0)) < 1e-9);
        let both = BoundaryMap::through_sphere(graded_spindle(6.0, 12), graded_spindle(6.0, 10)).unwrap();
        assert!(round_trip(&both) < 1e-9);
    }

    #[test]
    fn images_between_vertices_lie_on_the_target_and_not_on_straight_triangles() {
        let map = bumpy_to_cube();
        let points = held_out(map.domain(), 2000, 2000, SEED);
        let images = map.evaluate(&points);
        let on_target = SurfaceQuery::new(map.target_surface().unwrap()).unwrap();
        let farthest = |query: &SurfaceQuery| {
            let found = query.closest_points(&images);
            found.iter().map(|c| c.distance).fold(0.0, f64::max)
        };
        assert!(farthest(&on_target) < 1e-14);
        assert!(farthest(&SurfaceQuery::new(&map.target()).unwrap()) > 0.01);

        let onto = BoundaryMap::onto_sphere(radial_embedding(shapes::cube(2.0, 4))).unwrap();
        let points = held_out(onto.domain(), 500, 500, SEED);
        for (p, image) in onto.positions(&points).iter().zip(onto.evaluate(&points)) {
            assert!((image.coords.norm() - 1.0).abs() < 1e-15);
            // The corners' rays and the points' are the same only at vertices, and near.
            assert!((image.coords - p.coords.normalize()).norm() < 0.1);
        }
        assert_eq!(onto.image()[5].coords, onto.domain_embedding().unwrap().directions()[5]);
        assert!(onto.target_surface().is_none() && onto.inverse().is_none());
        assert!((onto.target_volume() - 4.18879).abs() < 1e-5 && (onto.target_diagonal() - 12f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_surface_goes_to_itself_and_common_directions_are_met_exactly() {
        let bumpy = radial_embedding(shapes::bumpy_sphere(9));
        let map = BoundaryMap::through_sphere(bumpy.clone(), bumpy).unwrap();
        assert_eq!(map.image(), map.domain().vertices());
        let points = held_out(map.domain(), 2000, 2000, SEED);
        for (p, image) in map.positions(&points).iter().zip(map.evaluate(&points)) {
            assert!((p - image).norm() < 1e-13);
        }
        let corners: Vec<_> = (0..20).map(|t| SurfacePoint::corner(t, t as usize % 3)).collect();
        assert_eq!(map.positions(&corners), map.evaluate(&corners));

        // The cube's corners, at which neither surface has anything else in common.
        let cube = radial_embedding(shapes::cube(2.0, 2));
        let corner = cube
            .surface()
            .vertices()
            .iter()
            .position(|p| p.x > 0.9 && p.y > 0.9 && p.z > 0.9)
            .unwrap();
        let sphere = shapes::sphere(1.0, 3);
        let mut directions: Vec<Vector> = sphere.vertices().iter().map(|p| p.coords).collect();
        let near = (0..directions.len()).max_by(|&i, &j| {
            let along = |i: usize| directions[i].dot(&cube.directions()[corner]);
            along(i).total_cmp(&along(j))
        });
        directions[near.unwrap()] = cube.directions()[corner];
        let pinned = SphericalEmbedding::new(sphere, &directions).unwrap();
        let expected = cube.surface().vertices()[corner];
        let map = BoundaryMap::through_sphere(pinned, cube).unwrap();
        assert_eq!(map.image()[near.unwrap()], expected);
    }

    #[test]
    fn neighbours_agree_on_the_edge_they_share() {
        for map in [bumpy_to_cube(), bumpy_to_cube().subdivided()] {
            let mut sides = HashMap::new();
            for (t, corners) in map.domain().triangles().iter().enumerate() {
                for k in 0..3 {
                    sides.insert((corners[k], corners[(k + 1) % 3]), (t as u32, k));
                }
            }
            let on_side = |(triangle, k): (u32, usize), part: f64| {
                let mut barycentric = [0.0; 3];
                (barycentric[k], barycentric[(k + 1) % 3]) = (1.0 - part, part);
                SurfacePoint { triangle, barycentric }
            };
            for (&(a, b), &side) in &sides {
                let pair = [on_side(side, 0.3), on_side(sides[&(b, a)], 0.7)];
                let images = map.evaluate(&pair);
                assert!((images[0] - images[1]).norm() < 1e-13, "{a} {b}");
            }
        }
    }

    #[test]
    fn subdivision_changes_no_image_and_carries_midpoints_onto_the_target() {
        let map = bumpy_to_cube();
        let finer = map.subdivided().subdivided();
        let old = map.image().len();
        assert_eq!(&finer.image()[..old], map.image());
        let points = held_out(finer.domain(), 2000, 2000, SEED);
        let query = SurfaceQuery::new(map.domain()).unwrap();
        let on_coarse = |c: crate::geometry::ClosestPoint| SurfacePoint {
            triangle: c.triangle as u32,
            barycentric: c.barycentric,
        };
        let coarse: Vec<_> = query
            .closest_points(&finer.positions(&points))
            .into_iter()
            .map(on_coarse)
            .collect();
        for (p, q) in map.evaluate(&coarse).iter().zip(finer.evaluate(&points)) {
            assert!((p - q).norm() < 1e-12);
        }
        let target = SurfaceQuery::new(map.target_surface().unwrap()).unwrap();
        assert!(target.closest_points(finer.image()).iter().all(|c| c.distance < 1e-14));
        assert_eq!(finer.inverse().unwrap().target_surface(), Some(map.domain()));
    }

    #[test]
    fn holds_over_the_same_domain_only() {
        let map = bumpy_to_cube();
        assert_eq!(map.over(map.domain().clone()).unwrap(), map);
        let difference = |domain: SurfaceMesh| match map.over(domain) {
            Err(BoundaryMapError::OtherDomain { difference }) => difference,
            other => panic!("{other:?}"),
        };
        assert!(difference(shapes::bumpy_sphere(3)).contains("1962 vertices"));
        let moved = shapes::deformed(map.domain(), |p| if p.x > 1.0 { p + Vector::x() } else { *p });
        assert!(difference(moved).starts_with("vertex "));
        assert!(difference(map.domain().reversed()).contains("outward"));
        let straight = BoundaryMap::new(shapes::cube(1.0, 2), shapes::cube(2.0, 2).vertices().to_vec()).unwrap();
        assert!(straight.over(shapes::cube(1.0, 2).reversed()).is_ok());
    }

    #[test]
    fn out_of_scale_surfaces_are_refused() {
        let sized = |size: f64| radial_embedding(shapes::sphere(size, 1));
        assert!(matches!(
            BoundaryMap::through_sphere(sized(1.0), sized(1e101)),
            Err(BoundaryMapError::OutOfScale { solid: "target", .. })
        ));
        assert!(matches!(
            BoundaryMap::onto_sphere(sized(1e-101)),
            Err(BoundaryMapError::OutOfScale { solid: "domain", .. })
        ));
    }

    #[test]
    fn a_fit_meets_the_curved_target_and_not_the_straight_triangles() {
        let ellipsoid = shapes::deformed(&shapes::geodesic_sphere(1.0, 24), |p| {
            Point::new(1.5 * p.x, p.y, 0.8 * p.z)
        });
        let map =
            BoundaryMap::through_sphere(radial_embedding(shapes::sphere(1.0, 2)), radial_embedding(ellipsoid)).unwrap();
        let options = FitOptions {
            tolerance: 2e-3,
            ..FitOptions::default()
        };
        let fitted = fit(&map, &options, &|_| {}).unwrap();
        assert!(
            fitted.report.boundary_error.p99 < 2e-3,
            "{:?}",
            fitted.report.boundary_error
        );
        assert_eq!(fitted.boundary, map);
        let straight = BoundaryMap::new(map.domain().clone(), map.image().to_vec()).unwrap();
        let points = held_out(map.domain(), 500, 500, SEED);
        let pairs = map.evaluate(&points).into_iter().zip(straight.evaluate(&points));
        let apart = pairs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
        assert!(apart > 0.01, "{apart}");
    }
}
