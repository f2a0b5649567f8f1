//! Checks whether a boundary map is a bijection, as far as can be decided, and how well its image covers the target.
//!
//! The image is the domain's triangulation in space, of any genus and from any program. What can be decided depends on
//! what it is compared with ([`ComparedWith`]). On a sphere bijectivity is decided exactly ([`crate::spherical`]), and
//! so it is for a composition of spherical embeddings, which is checked itself instead of the mesh of its vertices'
//! images. Near a target surface, triangles are compared with the target's normals, the degree follows from winding
//! numbers inside the target, and both Hausdorff distances are bounded. On its own, an image is checked for folds and
//! overlaps.

mod composition;
mod coverage;
mod covering;
mod display;
mod findings;
#[cfg(test)]
mod tests;
mod worst;

use serde::Serialize;

pub use composition::{CompositionCheck, RoundTrip};
pub use coverage::{Coverage, SurfaceDistance};
pub use covering::{ComparedWith, Degree};

use super::{BoundaryMap, SurfaceDistortion};
use crate::check::{FindSelfIntersections, SelfIntersections, Severity, look_for_self_intersections, repair};
use crate::geometry::{QueryError, SurfaceQuery};
use crate::mesh::SurfaceMesh;
use crate::worst_places::{self, WorstPlace};
use covering::{Covering, FoldedEdges};
use findings::Measurements;

/// Settings of [`check`].
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryCheckOptions {
    /// Distance between image and target, as a fraction of the target's diagonal, beyond which they are reported not
    /// to cover each other. A coarse image cuts corners: 0.01 is usual.
    pub tolerance: f64,
    /// The largest distances are sought until known to within this fraction of the target's diagonal.
    pub distance_error: f64,
    /// Number of points spread by area, over which distances are averaged.
    pub samples: usize,
    /// Seed of these points and of those inside the target.
    pub seed: u64,
    /// Largest number of [`BoundaryCheck::worst_places`].
    pub worst_places: usize,
}

impl Default for BoundaryCheckOptions {
    fn default() -> Self {
        Self {
            tolerance: 0.01,
            distance_error: 2e-4,
            samples: 20_000,
            seed: 1,
            worst_places: worst_places::LISTED,
        }
    }
}

/// What [`check`] found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BoundaryCheck {
    /// Number of vertices of the domain.
    pub vertices: usize,
    /// Number of triangles of the domain.
    pub faces: usize,
    /// What the image was compared with.
    pub compared_with: ComparedWith,
    /// Whether the map is a bijection.
    pub verdict: BijectivityVerdict,
    /// How often the image covers the target; `None` for domains that are open or have no orientation.
    pub degree: Option<Degree>,
    /// Triangles whose images are inverted. On a sphere: exactly. Against a target: those that face against the
    /// target's outward normals at the points closest to four samples of the triangle. Otherwise: those beside a folded
    /// edge that face against the triangles around them. With a negative degree, all triangles are inverted if the map
    /// is a bijection.
    pub flipped: usize,
    /// Which triangles these are.
    #[serde(skip)]
    pub flipped_triangles: Vec<u32>,
    /// Triangles with an area whose images have none: corners exactly on a line (on a sphere: on a great circle).
    pub degenerate: usize,
    /// Triangles of the domain with corners exactly on a line; these are not defects of the map.
    pub flat_in_domain: usize,
    /// Edges at which the image (for a composition: the plain image) is folded by more than 150°, and the domain is
    /// not.
    pub folded_edges: usize,
    /// Distances between image and target; `None` without a target.
    pub coverage: Option<Coverage>,
    /// How far the map is from an isometry; `None` when a surface has no area.
    pub distortion: Option<SurfaceDistortion>,
    /// Pairs of triangles of the image (for a composition: of the plain image) that intersect.
    pub self_intersections: SelfIntersections,
    /// Results for a map onto or through the sphere; `None` for others.
    pub composition: Option<CompositionCheck>,
    /// Defects, errors first.
    pub findings: Vec<MapFinding>,
    /// Where on the domain triangles are inverted, then where their images have no area or pass through each other, then
    /// where they are distorted most; groups of triangles across edges.
    pub worst_places: Vec<WorstPlace>,
}

/// Whether a map is a bijection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BijectivityVerdict {
    /// A bijection with or through the sphere, decided exactly, or through a hyperbolic surface, up to rounding; it may reverse the orientation.
    Bijective,
    /// No error and no warning was found.
    NoDefectFound,
    /// There are warnings.
    Doubtful,
    /// There are errors.
    NotBijective,
}

/// A defect of a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapFinding {
    /// The kind of defect.
    pub kind: MapFindingKind,
    /// [`Severity::Error`] when the map cannot be one to one.
    pub severity: Severity,
    /// Number of triangles, edges, pairs or sampled points concerned; 1 for findings about the whole map.
    pub count: usize,
    /// The first 20 edges concerned, by their vertices.
    pub edges: Vec<[u32; 2]>,
    /// The first 20 triangles concerned.
    pub faces: Vec<u32>,
    /// What was found.
    pub message: String,
    /// What to do about it.
    pub advice: String,
}

/// Kinds of findings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum MapFindingKind {
    /// The domain is open, or cannot be oriented.
    DomainBoundsNothing,
    /// The target is open, or cannot be oriented.
    TargetBoundsNothing,
    /// Domain and target differ in their numbers of components or handles.
    Topology,
    /// The degree of the map is not 1 or −1.
    Degree,
    /// The winding number of the image differs between points inside.
    UnevenCovering,
    /// The map reverses the orientation.
    Mirrored,
    /// Triangles are inverted.
    Flipped,
    /// Triangles have no area.
    Degenerate,
    /// The image turns back on itself at edges.
    FoldedEdges,
    /// Parts of the target are far from the image.
    NotCovered,
    /// Parts of the image are far from the target.
    OffTarget,
    /// The image passes through itself.
    SelfIntersections,
}

/// Why a map cannot be checked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundaryCheckError {
    /// The domain has no triangles, or a corner that is not finite.
    #[error("the domain cannot be examined: {0}")]
    Domain(QueryError),
    /// The target has no triangles, or a corner that is not finite.
    #[error("the target cannot be examined: {0}")]
    Target(QueryError),
    /// No triangle has an image with finite corners.
    #[error("the image cannot be examined: {0}")]
    Image(QueryError),
}

/// Checks a boundary map: whether it is a bijection, and its distortion.
///
/// `target` is the surface that the image should cover. Without it, the image is compared with the map's own target, if
/// it is a composition, or with the sphere that its vertices lie on to 1e-6 of the radius, if there is one. An image
/// that is further than a tenth of the diagonal off its target is checked on its own. Surfaces are oriented as by
/// [`repair`]. `self_intersections` finds triangles that intersect, as CGAL does in builds with the `native` feature.
/// Takes seconds per 100 000 triangles with a target, and a fraction of one without.
///
/// # Errors
///
/// When a surface has no triangles, or one with a corner that is not finite.
pub fn check(
    map: &BoundaryMap,
    target: Option<&SurfaceMesh>,
    options: &BoundaryCheckOptions,
    self_intersections: Option<FindSelfIntersections>,
) -> Result<BoundaryCheck, BoundaryCheckError> {
    let shells = composition::shells_of(map);
    if !shells.is_empty() {
        return composition::check(map, &shells, target, options, self_intersections);
    }
    let (domain, _) = repair(map.domain());
    SurfaceQuery::with_winding_sign(&domain).map_err(BoundaryCheckError::Domain)?;
    let image = domain
        .with_vertices(map.image().to_vec())
        .expect("a map has an image for every vertex");
    let image_query = SurfaceQuery::with_winding_sign(&image).map_err(BoundaryCheckError::Image)?;
    let target = target.map(|target| repair(target).0);
    let target_query = target.as_ref().map(SurfaceQuery::new).transpose();
    let target_query = target_query.map_err(BoundaryCheckError::Target)?;
    let pair = target.as_ref().zip(target_query.as_ref());

    let coverage = pair.map(|pair| Coverage::measure((&image, &image_query), pair, options));
    let off = coverage.map_or(0.0, |coverage| coverage.image_to_target.most());
    // Further away, closest points and points inside do not correspond to the image.
    let near = pair.filter(|_| coverage.is_none_or(|coverage| coverage.image_to_target.p99 <= ELSEWHERE));
    let folded = FoldedEdges::find(&domain, &image);
    let covering = Covering::new(&domain, (&image, &image_query), near, &folded, off, options.seed);
    let (self_intersections, crossing) = look_for_self_intersections(&image, self_intersections);
    let measurements = Measurements {
        domain: &domain,
        target: target.as_ref(),
        covering: &covering,
        folded: &folded,
        coverage,
        elsewhere: pair.is_some() && near.is_none(),
        crossing: &crossing,
        tolerance: options.tolerance,
    };
    let distortion = SurfaceDistortion::of(&domain, image.vertices());
    let worst_places = measurements.worst_places((&domain, image.vertices()), options.worst_places);
    Ok(BoundaryCheck {
        worst_places,
        ..measurements.report(distortion, self_intersections, None)
    })
}

/// Distance from the target, over its diagonal, beyond which an image is at another place or of another size.
const ELSEWHERE: f64 = 0.1;

impl Measurements<'_> {
    /// The report on a map, with the results that only a composition has.
    fn report(
        &self,
        distortion: Option<SurfaceDistortion>,
        self_intersections: SelfIntersections,
        composition: Option<CompositionCheck>,
    ) -> BoundaryCheck {
        let findings = self.findings();
        let on_sphere = matches!(self.covering.compared_with, ComparedWith::Sphere { .. });
        BoundaryCheck {
            vertices: self.domain.vertices().len(),
            faces: self.domain.triangles().len(),
            compared_with: self.covering.compared_with,
            verdict: verdict(&findings, composition.is_some() || on_sphere),
            degree: self.covering.degree,
            flipped: self.covering.flipped.len(),
            flipped_triangles: self.covering.flipped.clone(),
            degenerate: self.covering.degenerate.len(),
            flat_in_domain: self.covering.flat_in_domain.len(),
            folded_edges: self.folded.edges.len(),
            coverage: self.coverage,
            distortion,
            self_intersections,
            composition,
            findings,
            worst_places: vec![],
        }
    }
}

/// Where bijectivity is decided exactly, warnings raise no doubt.
fn verdict(findings: &[MapFinding], is_exact: bool) -> BijectivityVerdict {
    match findings.iter().map(|finding| finding.severity).min() {
        Some(Severity::Error) => BijectivityVerdict::NotBijective,
        _ if is_exact => BijectivityVerdict::Bijective,
        Some(Severity::Warning) => BijectivityVerdict::Doubtful,
        Some(Severity::Note) | None => BijectivityVerdict::NoDefectFound,
    }
}
