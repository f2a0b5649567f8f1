use super::calls::{Operation, call_on};
use super::distance::SignedDistanceField;
use super::error::CgalTetgenError;
use super::input::{check_closed, check_numbers, enclosed_solid, intersecting_triangles, surface as surface_of};
use super::tetrahedra::{check_count, check_positive};
use crate::Point;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::{ComponentShape, Topology};

/// Newton steps of the projection. Away from creases one is enough; at a crease it does not converge.
const PROJECTION_STEPS: usize = 5;

/// Options of [`offset_surface`].
#[derive(Debug, Clone, PartialEq)]
pub struct OffsetOptions {
    /// Finest detail of the surface, in model units: about its edge length. Gaps narrower than twice this are filled.
    /// Half of the distance when `None`; larger values let the surface sink towards the model.
    pub alpha: Option<f64>,
    /// Rounds of remeshing and projection after the wrap; 0 returns the wrap, which keeps the distance to about 1 %.
    pub rounds: usize,
    /// How often `alpha` may be halved when a surface does not pass its checks.
    pub retries: usize,
    /// Smallest distance to the model that the surface may have, as a fraction of the distance asked for; measured at
    /// vertices and centroids.
    pub min_fraction: f64,
    /// Genus that the surface must have. The genus that an offset should have depends on the distance and is not
    /// known beforehand, so it is only reported when `None`.
    pub genus: Option<usize>,
    /// Triangles that may be asked for; time and memory grow with them.
    pub max_triangles: usize,
}

impl Default for OffsetOptions {
    fn default() -> Self {
        Self {
            alpha: None,
            rounds: 3,
            retries: 2,
            min_fraction: 0.5,
            genus: None,
            max_triangles: 2_000_000,
        }
    }
}

/// A surface around a model, as [`offset_surface`] makes it. Lengths are in model units.
#[derive(Debug, Clone, PartialEq)]
pub struct OffsetSurface {
    /// Closed, manifold, oriented outward, without self-intersections, and clear of the model.
    pub mesh: SurfaceMesh,
    /// Largest error of the distance at vertices. Large only at creases, where the projection does not converge.
    pub vertex_error: f64,
    /// Largest error of the distance at the triangles' centroids, which also measures the triangles' flatness.
    pub centroid_error: f64,
    /// Smallest signed distance to the model over vertices and centroids.
    pub min_distance: f64,
    /// Genus, summed over the components.
    pub genus: usize,
    /// Genus of the model's outer shells, when they are manifold. A distance of more than half of a hole's width closes
    /// the hole; otherwise a smaller genus of the offset is a sign of too large an `alpha`.
    pub model_genus: Option<usize>,
    /// Connected components. Parts closer than twice the distance share one.
    pub components: usize,
    /// `alpha` of the wrap it was made from.
    pub alpha: f64,
    /// How often `alpha` was halved.
    pub retries: usize,
    /// Whether this is the wrap itself, because no projected surface passed the checks.
    pub raw_wrap: bool,
}

/// A surface at `distance` (model units) outside a closed surface.
///
/// An alpha wrap is remeshed, its vertices are moved onto the level set of the distance, and the result is checked;
/// when it fails, the wrap is made finer, and when every projected surface fails, the wrap itself is returned. The
/// model may intersect itself. Cavities get no offset: the surface surrounds the model from outside only.
///
/// # Errors
///
/// [`CgalTetgenError::InvalidInput`] for a model that is empty, not finite or open, [`CgalTetgenError::TooFine`] when
/// `max_triangles` do not suffice, [`CgalTetgenError::Topology`] when the genus asked for was not found,
/// [`CgalTetgenError::OffsetFailed`] when no surface passed its checks.
///
/// # References
///
/// Portaneri, Rouxel-Labbé, Hemmer, Cohen-Steiner, Alliez, *Alpha wrapping with an offset*, ACM Trans. Graph. 41
/// (2022).
pub fn offset_surface(
    surface: &SurfaceMesh,
    distance: f64,
    options: &OffsetOptions,
) -> Result<OffsetSurface, CgalTetgenError> {
    check_positive("distance", distance)?;
    let first_alpha = options.alpha.unwrap_or(distance / 2.0);
    check_positive("alpha", first_alpha)?;
    check_numbers(surface)?;
    check_closed(&Topology::new(surface))?;

    let problem = OffsetProblem::new(surface, distance, options)?;
    let mut fallback = None;
    let mut failure = None;
    let mut alpha = first_alpha;
    for retries in 0..=options.retries {
        if let Err(error) = problem.check_size(alpha) {
            // An `alpha` halved here is not the caller's choice: then the failure that led to it is reported.
            failure.get_or_insert(error);
            break;
        }
        let wrap = problem.wrap(alpha)?;
        if options.rounds > 0 {
            let projected = problem
                .projected(&wrap, alpha)
                .and_then(|mesh| problem.checked(mesh, alpha, retries, false));
            match projected {
                Ok(result) => return Ok(result),
                Err(error) if error.is_final() => return Err(error),
                Err(error) => failure = Some(error),
            }
        }
        match problem.checked(wrap, alpha, retries, true) {
            Ok(result) if options.rounds == 0 => return Ok(result),
            Ok(result) => fallback = Some(result),
            Err(error) if error.is_final() => return Err(error),
            Err(error) => failure = Some(error),
        }
        alpha /= 2.0;
    }
    match (fallback, failure) {
        (Some(result), _) => Ok(result),
        (None, Some(error)) => Err(error),
        (None, None) => Err(CgalTetgenError::EmptyResult),
    }
}

/// What is common to all attempts.
struct OffsetProblem<'a> {
    model: &'a SurfaceMesh,
    model_genus: Option<usize>,
    field: SignedDistanceField,
    distance: f64,
    options: &'a OffsetOptions,
}

impl<'a> OffsetProblem<'a> {
    fn new(model: &'a SurfaceMesh, distance: f64, options: &'a OffsetOptions) -> Result<Self, CgalTetgenError> {
        let solid = enclosed_solid(model, &Topology::new(model)).ok();
        Ok(Self {
            model,
            model_genus: solid.and_then(|solid| solid.outer_genus).map(|genus| genus as usize),
            field: SignedDistanceField::new(model)?,
            distance,
            options,
        })
    }

    /// Refuses sizes that would take too many triangles. The offset's area is estimated by the model's area, or that of
    /// a sphere around it if smaller, plus the area of a sphere whose radius is the distance.
    fn check_size(&self, alpha: f64) -> Result<(), CgalTetgenError> {
        let reach = self.model.diagonal() + 2.0 * self.distance;
        let area = self.model.area().min(std::f64::consts::PI * reach * reach)
            + 4.0 * std::f64::consts::PI * self.distance * self.distance;
        // Wrap triangles have edges of about 1.36 alpha, and remeshing to alpha doubles their number.
        let triangles = 2.5 * area / (alpha * alpha);
        check_count("triangles", triangles, self.options.max_triangles as f64)
    }

    fn wrap(&self, alpha: f64) -> Result<SurfaceMesh, CgalTetgenError> {
        surface_of(&call_on(Operation::Wrap, self.model, &[alpha, self.distance])?)
    }

    fn projected(&self, wrap: &SurfaceMesh, alpha: f64) -> Result<SurfaceMesh, CgalTetgenError> {
        let mut mesh = wrap.clone();
        for _ in 0..self.options.rounds {
            let remeshed = call_on(Operation::Remesh, &mesh, &[alpha, 0.0])?;
            let (vertices, triangles) = surface_of(&remeshed)?.into_parts();
            mesh = SurfaceMesh::new(self.on_level_set(vertices)?, triangles)?;
        }
        Ok(mesh)
    }

    /// Points moved along the gradient of the distance to the level set.
    fn on_level_set(&self, mut points: Vec<Point>) -> Result<Vec<Point>, CgalTetgenError> {
        for _ in 0..PROJECTION_STEPS {
            let mut error = 0.0f64;
            let closest_points = self.field.try_closest_points(&points)?;
            for (p, closest) in points.iter_mut().zip(closest_points) {
                let away = *p - closest;
                let length = away.norm();
                if length > 0.0 {
                    error = error.max((length - self.distance).abs());
                    *p = closest + away * (self.distance / length);
                }
            }
            if error <= 1e-14 * self.distance {
                break;
            }
        }
        Ok(points)
    }

    /// The surface with its measures, or why it fails the checks.
    fn checked(
        &self,
        mesh: SurfaceMesh,
        alpha: f64,
        retries: usize,
        raw_wrap: bool,
    ) -> Result<OffsetSurface, CgalTetgenError> {
        let failed = |reason: String| CgalTetgenError::OffsetFailed {
            attempts: retries + 1,
            reason,
        };
        let topology = Topology::new(&mesh);
        let shapes = topology.components().shapes;
        let genus: Option<u64> = shapes.iter().map(ComponentShape::genus).sum();
        let (Some(genus), true) = (genus, bounds_a_solid(&mesh, &topology)) else {
            return Err(failed("the surface is not closed and manifold".into()));
        };
        let genus = genus as usize;
        let intersections = self.intersections(&mesh)?;
        if intersections > 0 {
            return Err(failed(format!("{intersections} pairs of triangles intersect")));
        }
        let at_vertices = self.field.try_distance(mesh.vertices())?;
        let centroid = |t: usize| Point::from(mesh.corners(t).iter().map(|p| p.coords).sum::<crate::Vector>() / 3.0);
        let centroids: Vec<Point> = (0..mesh.triangles().len()).map(centroid).collect();
        let at_centroids = self.field.try_distance(&centroids)?;
        let distances = at_vertices.iter().chain(&at_centroids).copied();
        let min_distance = distances.fold(f64::INFINITY, f64::min);
        if min_distance < self.options.min_fraction * self.distance {
            return Err(failed(format!("it comes as near as {min_distance:e} to the model")));
        }
        if let Some(want) = self.options.genus.filter(|&want| want != genus) {
            return Err(CgalTetgenError::Topology { got: genus, want });
        }
        let error = |distances: &[f64]| distances.iter().map(|d| (d - self.distance).abs()).fold(0.0, f64::max);
        Ok(OffsetSurface {
            vertex_error: error(&at_vertices),
            centroid_error: error(&at_centroids),
            mesh,
            min_distance,
            genus,
            model_genus: self.model_genus,
            components: shapes.len(),
            alpha,
            retries,
            raw_wrap,
        })
    }

    /// Number of intersections of `mesh` with itself and with the model.
    fn intersections(&self, mesh: &SurfaceMesh) -> Result<usize, CgalTetgenError> {
        let own = mesh.triangles().len();
        let shift = mesh.vertices().len() as u32;
        let vertices = [mesh.vertices(), self.model.vertices()].concat();
        let of_model = self.model.triangles().iter().map(|t| t.map(|v| v + shift));
        let triangles = mesh.triangles().iter().copied().chain(of_model).collect();
        let pairs = intersecting_triangles(&SurfaceMesh::new(vertices, triangles)?, f64::INFINITY)?;
        Ok(pairs.iter().filter(|pair| (pair[0] as usize) < own).count())
    }
}

/// Closed, manifold, and oriented outward.
fn bounds_a_solid(mesh: &SurfaceMesh, topology: &Topology) -> bool {
    let is_manifold = topology.is_edge_manifold() && topology.non_manifold_vertices().is_empty();
    let is_oriented = topology.orientation().inconsistent_edges.is_empty() && mesh.volume() > 0.0;
    topology.is_closed() && is_manifold && is_oriented
}
