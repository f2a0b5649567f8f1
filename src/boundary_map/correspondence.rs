//! A boundary map: the image of every vertex of the domain, and of every point between them.

use std::f64::consts::PI;
use std::sync::Arc;

use rayon::prelude::*;

use super::BoundaryMapError;
use super::composition::{Composition, SurfaceEmbedding, images_of_vertices};
use super::error::{extent, require_extent, require_finite, require_same_count, require_same_elements};
use super::function::PointFunction;
use super::shells::{ShellMap, ShellMaps};
use crate::hyperbolic::HyperbolicEmbedding;
use crate::mesh::shapes::quartered;
use crate::mesh::{CellList, CellMesh, SurfaceMesh, SurfacePoint};
use crate::spherical::SphericalEmbedding;
use crate::toroidal::ToroidalEmbedding;
use crate::{Point, Vector};

/// A boundary map `f'`: where each point of the domain's surface goes.
///
/// Given by images of the vertices alone, it is linear over the triangles in between. As a composition of embeddings
/// ([`Self::onto_sphere`], [`Self::through_sphere`], [`Self::through_torus`], [`Self::through_hyperbolic_surface`], and
/// [`Self::by_shells`] with one for each shell) it is a bijection with the target's surface, and the images of points
/// between vertices lie on that surface, not on the straight triangles between the images of the vertices.
///
/// Copies share the domain, the embeddings and the function.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryMap {
    domain: Arc<SurfaceMesh>,
    image: Vec<Point>,
    interpolation: Interpolation,
}

/// How a boundary map sends the points between vertices.
#[derive(Debug, Clone, PartialEq)]
enum Interpolation {
    /// Linearly over each triangle.
    Linear,
    /// By embeddings in the sphere, in a flat torus or in a hyperbolic surface.
    Composition(Composition),
    /// By one composition for each shell.
    Shells(ShellMaps),
    /// By a function of the surface's points.
    Function(PointFunction),
}

impl BoundaryMap {
    /// The map that sends vertex `v` of `domain` to `image[v]`.
    ///
    /// # Errors
    ///
    /// When the counts differ, or the image is not finite or has no extent.
    pub fn new(domain: impl Into<Arc<SurfaceMesh>>, image: Vec<Point>) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        require_same_count(domain.vertices(), &image)?;
        require_finite(&image)?;
        require_extent(&domain, &image, extent(&domain, &image))?;
        Ok(Self {
            domain,
            image,
            interpolation: Interpolation::Linear,
        })
    }

    /// The map that sends each point of `domain` to the value of `function`: for data that vary within triangles, such
    /// as the colours of a texture (section 5.4 of the paper). Values must be finite; on an edge, those of its two
    /// triangles may differ. Errors are relative to the diagonal of the box from `low` to `high`, in place of the
    /// target's bounding box. Files store the images of the vertices only.
    ///
    /// # Errors
    ///
    /// When the image of a vertex is not finite, the box has no extent, or the domain or the box is out of scale.
    pub fn by_function(
        domain: SurfaceMesh,
        (low, high): (Point, Point),
        function: impl Fn(&SurfacePoint) -> Point + Send + Sync + 'static,
    ) -> Result<Self, BoundaryMapError> {
        let function = PointFunction::new(function, (low, high));
        let image = function.images_of_vertices(&domain);
        require_finite(&image)?;
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
            interpolation: Interpolation::Function(function),
        })
    }

    /// The map that sends each point of a surface to its direction, a point of the unit sphere about the origin.
    ///
    /// # Errors
    ///
    /// When the surface is too small or too large to calculate with.
    pub fn onto_sphere(domain: SphericalEmbedding) -> Result<Self, BoundaryMapError> {
        Self::by_composition(Composition::onto_sphere(domain))
    }

    /// The map that sends each point of one surface to the point of the other that has the same direction. A vertex
    /// whose direction is that of a vertex of the target, bit for bit, goes exactly there.
    ///
    /// # Errors
    ///
    /// When a surface is too small or too large to calculate with.
    pub fn through_sphere(domain: SphericalEmbedding, target: SphericalEmbedding) -> Result<Self, BoundaryMapError> {
        Self::by_composition(Composition::through_sphere(domain, target))
    }

    /// The map that sends each point of one surface to the point of the other at the same place of the flat torus.
    ///
    /// # Errors
    ///
    /// When a surface is too small or too large to calculate with.
    pub fn through_torus(domain: ToroidalEmbedding, target: ToroidalEmbedding) -> Result<Self, BoundaryMapError> {
        Self::by_composition(Composition::through_torus(domain, target))
    }

    /// The map that sends each point of one surface to the point of the other at the same place of a hyperbolic surface.
    ///
    /// # Errors
    ///
    /// When the embeddings have different relators, or a surface is too small or too large to calculate with.
    pub fn through_hyperbolic_surface(
        domain: HyperbolicEmbedding,
        target: HyperbolicEmbedding,
    ) -> Result<Self, BoundaryMapError> {
        if domain.relator() != target.relator() {
            return Err(BoundaryMapError::OtherRelator);
        }
        Self::by_composition(Composition::through_hyperbolic_surface(domain, target))
    }

    fn by_composition(composition: Composition) -> Result<Self, BoundaryMapError> {
        let domain = composition.domain().surface().clone();
        let image = match composition.target() {
            Some(target) => {
                let surface = target.surface();
                require_extent(&domain, surface.vertices(), extent(surface, surface.vertices()))?;
                images_of_vertices(&domain, 0, |p| composition.image(p))
            }
            None => {
                let image = images_of_vertices(&domain, 0, |p| composition.image(p));
                require_extent(&domain, &image, extent(&domain, &image))?;
                image
            }
        };
        Ok(Self {
            domain: Arc::new(domain),
            image,
            interpolation: Interpolation::Composition(composition),
        })
    }

    /// The map between solids of several shells, from the maps of the domain's, which count in the order of their first triangles.
    /// Solids are turned to face outward, and cavities inward.
    ///
    /// # Errors
    ///
    /// [`BoundaryMapError::Shells`] when the shells of a surface cannot be told apart, or the maps are not those of all of them; and
    /// when a surface is too small or too large to calculate with.
    pub fn by_shells(
        domain: &SurfaceMesh,
        target: &SurfaceMesh,
        maps: Vec<ShellMap>,
    ) -> Result<Self, BoundaryMapError> {
        Self::by_shell_maps(ShellMaps::new(domain, target, maps)?)
    }

    fn by_shell_maps(maps: ShellMaps) -> Result<Self, BoundaryMapError> {
        let (domain, target) = (maps.domain().clone(), maps.target());
        require_extent(&domain, target.vertices(), extent(target, target.vertices()))?;
        Ok(Self {
            image: images_of_vertices(&domain, 0, |p| maps.image(p)),
            domain: Arc::new(domain),
            interpolation: Interpolation::Shells(maps),
        })
    }

    /// The map from the target's surface back to the domain's as it was before subdivision; `None` unless the map, or that of
    /// each shell, goes through the sphere, a torus or a hyperbolic surface to another surface.
    pub fn inverse(&self) -> Option<Self> {
        if let Some(maps) = self.shell_maps() {
            return Self::by_shell_maps(maps.inverse()?).ok();
        }
        // Cannot fail: both surfaces have passed the checks.
        Self::by_composition(self.composition()?.inverse()?).ok()
    }

    /// The same map over this domain, which must have the same vertices and triangles. The orientation of triangles may
    /// differ if the map is linear over them.
    ///
    /// # Errors
    ///
    /// [`BoundaryMapError::OtherDomain`] with the first difference.
    pub fn over(&self, domain: impl Into<Arc<SurfaceMesh>>) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        let other = |difference: String| BoundaryMapError::OtherDomain { difference };
        let (own, given) = (self.domain.vertices(), domain.vertices());
        if own.len() != given.len() {
            let (own, given) = (own.len(), given.len());
            return Err(other(format!("its domain has {own} vertices, and this one {given}")));
        }
        let show = |p: &Point| format!("({}, {}, {})", p.x, p.y, p.z);
        if let Some(v) = (0..own.len()).find(|&v| own[v] != given[v]) {
            let (own, given) = (show(&own[v]), show(&given[v]));
            return Err(other(format!(
                "vertex {v} is at {own} in its domain, and at {given} in this one"
            )));
        }
        require_same_elements("triangle", self.domain.triangles(), domain.triangles())
            .map_err(|e| other(e.to_string()))?;
        let is_linear = matches!(self.interpolation, Interpolation::Linear);
        if !is_linear && self.domain.triangles() != domain.triangles() {
            return Err(other("triangles are reversed; orient them outward".into()));
        }
        Ok(Self { domain, ..self.clone() })
    }

    /// The map from a mesh to one of the same connectivity.
    ///
    /// # Errors
    ///
    /// As [`BoundaryMap::new`], and when the meshes differ in connectivity. The corners of a triangle may be listed
    /// in any order: a map that reverses the orientation turns its image inside out, which is not a defect of the
    /// files.
    pub fn between(domain: impl Into<Arc<SurfaceMesh>>, image: &SurfaceMesh) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        require_same_count(domain.vertices(), image.vertices())?;
        require_same_elements("triangle", domain.triangles(), image.triangles())?;
        Self::new(domain, image.vertices().to_vec())
    }

    /// The map of a mesh's boundary that takes its nodes to given places, in any order; places of nodes inside are left out.
    /// The vertices of the domain are the nodes of the boundary, ascending ([`CellMesh::boundary`]).
    ///
    /// # Errors
    ///
    /// [`BoundaryMapError::NodeImages`] when a node of the boundary has no place or any node two, or when there is no such
    /// node; else as [`BoundaryMap::new`].
    pub fn of_nodes(domain: &CellMesh, images: &[(u32, Point)]) -> Result<Self, BoundaryMapError> {
        let boundary = domain.boundary();
        let images = images_of(&boundary.vertex_ids, domain.nodes().len(), images)?;
        Self::new(boundary.surface, images)
    }

    /// As [`Self::of_nodes`], for a surface, all of whose vertices need a place.
    ///
    /// # Errors
    ///
    /// As [`Self::of_nodes`].
    pub fn of_vertices(domain: impl Into<Arc<SurfaceMesh>>, images: &[(u32, Point)]) -> Result<Self, BoundaryMapError> {
        let domain = domain.into();
        let all: Vec<u32> = (0..domain.vertices().len() as u32).collect();
        let images = images_of(&all, all.len(), images)?;
        Self::new(domain, images)
    }

    /// The map between the boundaries of two meshes of the same cells ([`CellMesh::boundary`]). The boundary's vertices
    /// keep the order they have in the meshes.
    ///
    /// # Errors
    ///
    /// As [`BoundaryMap::between`].
    pub fn between_cells(domain: &CellMesh, image: &CellMesh) -> Result<Self, BoundaryMapError> {
        require_same_count(domain.nodes(), image.nodes())?;
        match (domain.cells(), image.cells()) {
            (CellList::Tets(own), CellList::Tets(other)) => require_same_elements("tetrahedron", own, other)?,
            (CellList::Hexes(own), CellList::Hexes(other)) => require_same_elements("hexahedron", own, other)?,
            (own, _) => {
                return Err(BoundaryMapError::FaceCount {
                    element: own.element(),
                    domain: own.len(),
                    image: 0,
                });
            }
        }
        let boundary = domain.boundary();
        let images = boundary.vertex_ids.iter().map(|&v| image.nodes()[v as usize]);
        Self::new(boundary.surface, images.collect())
    }

    /// The surface being mapped.
    pub fn domain(&self) -> &SurfaceMesh {
        &self.domain
    }

    /// The image of each vertex.
    pub fn image(&self) -> &[Point] {
        &self.image
    }

    /// The domain's triangles with the images of their vertices. For a composition these triangles only approximate the
    /// target: see [`Self::target_surface`].
    pub fn target(&self) -> SurfaceMesh {
        self.domain
            .with_vertices(self.image.clone())
            .expect("counts were compared when the map was made")
    }

    /// The target with its triangles facing outward; those of [`Self::target`] face inward if the map reverses
    /// the orientation.
    pub fn outward_target(&self) -> SurfaceMesh {
        let target = self.target_surface().cloned().unwrap_or_else(|| self.target());
        if target.volume() < 0.0 {
            target.reversed()
        } else {
            target
        }
    }

    /// The target, if it has a mesh of its own.
    pub fn target_surface(&self) -> Option<&SurfaceMesh> {
        match self.shell_maps() {
            Some(maps) => Some(maps.target()),
            None => self.composition()?.target().map(SurfaceEmbedding::surface),
        }
    }

    /// The maps of the domain's shells, before subdivision; `None` unless the map was made of such.
    pub fn shells(&self) -> Option<&[ShellMap]> {
        self.shell_maps().map(ShellMaps::maps)
    }

    /// The vertices of the domain's shells, before subdivision, in the order of those of the shells' own surfaces; `None` unless the map
    /// was made of maps of shells.
    pub(crate) fn shell_vertices(&self) -> Option<Vec<Vec<u32>>> {
        self.shell_maps().map(ShellMaps::vertices)
    }

    /// The map of the same shells, before subdivision, by other maps between them; `None` unless it was made of such.
    ///
    /// # Errors
    ///
    /// When these are not maps between the same surfaces.
    pub(crate) fn with_shell_maps(&self, maps: &[Self]) -> Option<Result<Self, BoundaryMapError>> {
        let shells = self.shell_maps()?;
        Some(shells.with_maps(maps).and_then(Self::by_shell_maps))
    }

    /// The spherical embedding of the domain before subdivision; `None` unless the map goes onto or through the sphere.
    pub fn domain_embedding(&self) -> Option<&SphericalEmbedding> {
        self.composition()?.domain().as_sphere()
    }

    /// The spherical embedding of the target; `None` unless the map goes through the sphere to another surface.
    pub fn target_embedding(&self) -> Option<&SphericalEmbedding> {
        self.composition()?.target()?.as_sphere()
    }

    /// The embeddings of the domain, before subdivision, and of the target in the flat torus; `None` unless the map goes through
    /// one.
    pub fn torus_embeddings(&self) -> Option<[&ToroidalEmbedding; 2]> {
        let composition = self.composition()?;
        Some([composition.domain().as_torus()?, composition.target()?.as_torus()?])
    }

    /// The embeddings of the domain, as it was before subdivision, and of the target in one hyperbolic surface; `None` unless the map
    /// goes through one.
    pub fn hyperbolic_embeddings(&self) -> Option<[&HyperbolicEmbedding; 2]> {
        let composition = self.composition()?;
        Some([
            composition.domain().as_hyperbolic()?,
            composition.target()?.as_hyperbolic()?,
        ])
    }

    /// The domain as it was before subdivision.
    #[cfg(feature = "io")]
    pub(crate) fn unsubdivided_domain(&self) -> &SurfaceMesh {
        match &self.interpolation {
            Interpolation::Composition(composition) => composition.domain().surface(),
            Interpolation::Shells(maps) => maps.domain(),
            Interpolation::Linear | Interpolation::Function(_) => &self.domain,
        }
    }

    /// How often the domain was subdivided since it was embedded; 0 for other maps.
    pub fn subdivisions(&self) -> u32 {
        match &self.interpolation {
            Interpolation::Composition(composition) => composition.subdivisions(),
            Interpolation::Shells(maps) => maps.subdivisions(),
            Interpolation::Linear | Interpolation::Function(_) => 0,
        }
    }

    pub(super) fn composition(&self) -> Option<&Composition> {
        match &self.interpolation {
            Interpolation::Composition(composition) => Some(composition),
            Interpolation::Linear | Interpolation::Shells(_) | Interpolation::Function(_) => None,
        }
    }

    pub(super) fn shell_maps(&self) -> Option<&ShellMaps> {
        match &self.interpolation {
            Interpolation::Shells(maps) => Some(maps),
            _ => None,
        }
    }

    /// Whether the map is linear over the triangles of the domain.
    pub fn is_linear(&self) -> bool {
        matches!(self.interpolation, Interpolation::Linear)
    }

    /// Whether the map is given by a function, so that the images need not bound a solid.
    pub(crate) fn is_by_function(&self) -> bool {
        matches!(self.interpolation, Interpolation::Function(_))
    }

    /// Lowest and highest corner of the target's bounding box.
    pub fn target_box(&self) -> (Point, Point) {
        let corner = Point::new(1.0, 1.0, 1.0);
        match &self.interpolation {
            Interpolation::Linear => self.target().bounding_box().unwrap_or_default(),
            Interpolation::Composition(composition) => match composition.target() {
                Some(target) => target.surface().bounding_box().unwrap_or_default(),
                None => (-corner, corner),
            },
            Interpolation::Shells(maps) => maps.target().bounding_box().unwrap_or_default(),
            Interpolation::Function(function) => function.target_box(),
        }
    }

    /// Diagonal of the target's bounding box, the unit of reported errors.
    pub fn target_diagonal(&self) -> f64 {
        let (low, high) = self.target_box();
        (high - low).norm()
    }

    /// Volume of the target; negative when the map turns the solid inside out.
    pub fn target_volume(&self) -> f64 {
        match (self.target_surface(), self.composition()) {
            (Some(target), _) => target.volume(),
            (None, Some(_)) => 4.0 / 3.0 * PI,
            (None, None) => self.target().volume(),
        }
    }

    /// The same map over a domain whose triangles are each cut into four at the midpoints of their edges: triangle `t`
    /// becomes `4t` to `4t + 3`. The old vertices come first; the new ones go where the map takes the midpoints.
    pub fn subdivided(&self) -> Self {
        let domain = quartered(&self.domain);
        let (image, interpolation) = match &self.interpolation {
            Interpolation::Linear => (quartered(&self.target()).into_parts().0, Interpolation::Linear),
            Interpolation::Composition(composition) => {
                let composition = composition.subdivided();
                let new = images_of_vertices(&domain, self.image.len(), |p| composition.image(p));
                (
                    [&self.image[..], &new].concat(),
                    Interpolation::Composition(composition),
                )
            }
            Interpolation::Shells(maps) => {
                let maps = maps.subdivided();
                let new = images_of_vertices(&domain, self.image.len(), |p| maps.image(p));
                ([&self.image[..], &new].concat(), Interpolation::Shells(maps))
            }
            Interpolation::Function(function) => {
                let function = function.subdivided();
                (function.images_of_vertices(&domain), Interpolation::Function(function))
            }
        };
        Self {
            domain: Arc::new(domain),
            image,
            interpolation,
        }
    }

    /// Positions of surface points in the domain.
    pub fn positions(&self, points: &[SurfacePoint]) -> Vec<Point> {
        let position = |p: &SurfacePoint| p.position(&self.domain, self.domain.vertices());
        points.iter().map(position).collect()
    }

    /// Images of surface points. For a composition each costs some microseconds; they are computed in parallel.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Point> {
        match &self.interpolation {
            Interpolation::Linear => points.iter().map(|p| p.position(&self.domain, &self.image)).collect(),
            Interpolation::Composition(composition) => in_parallel(points, |p| composition.image(p)),
            Interpolation::Shells(maps) => in_parallel(points, |p| maps.image(p)),
            Interpolation::Function(function) => in_parallel(points, |p| function.image(p)),
        }
    }

    /// Images of surface points as points of [`Self::target_surface`]; `None` without one.
    pub fn evaluate_on_target(&self, points: &[SurfacePoint]) -> Option<Vec<SurfacePoint>> {
        let found = match &self.interpolation {
            Interpolation::Composition(composition) => in_parallel(points, |p| composition.on_target(p)),
            Interpolation::Shells(maps) => in_parallel(points, |p| maps.on_target(p)),
            Interpolation::Linear | Interpolation::Function(_) => return None,
        };
        found.into_iter().collect()
    }

    /// Directions of surface points, as unit vectors; `None` unless the map goes onto or through the sphere.
    pub fn directions(&self, points: &[SurfacePoint]) -> Option<Vec<Vector>> {
        let composition = self.composition()?;
        in_parallel(points, |p| composition.direction(p)).into_iter().collect()
    }
}

/// The values of `f` at the points, in their order.
fn in_parallel<T: Send>(points: &[SurfacePoint], f: impl Fn(&SurfacePoint) -> T + Sync + Send) -> Vec<T> {
    points.par_iter().with_min_len(256).map(f).collect()
}

/// The images of some nodes of a mesh that has `count`, by a list of them.
fn images_of(nodes: &[u32], count: usize, images: &[(u32, Point)]) -> Result<Vec<Point>, BoundaryMapError> {
    let mut image_of: Vec<Option<Point>> = vec![None; count];
    let failed = |node, problem| BoundaryMapError::NodeImages { node, problem };
    for &(node, image) in images {
        match image_of.get_mut(node as usize) {
            None => return Err(failed(node, "is not in the mesh")),
            Some(Some(_)) => return Err(failed(node, "has two images")),
            Some(place) => *place = Some(image),
        }
    }
    let of_node =
        |&node: &u32| image_of[node as usize].ok_or_else(|| failed(node, "is on the boundary and has no image"));
    nodes.iter().map(of_node).collect()
}

#[cfg(test)]
mod tests;
