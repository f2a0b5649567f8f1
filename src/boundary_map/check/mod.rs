//! Whether a boundary map is one to one, as far as can be told, and how well its image covers the target.
//!
//! The map is a drawing of the domain's triangles in space, of any genus, from any program. What can be said of it
//! depends on what it is held against ([`ComparedWith`]). A drawing on a sphere is decided exactly ([`crate::spherical`]), and
//! so is a map by way of the sphere, which is examined as it is and not as the mesh of its vertices' images.
//! One near a target surface has its triangles compared with the target's normals, its degree from winding numbers
//! inside the target, and both Hausdorff distances bounded. By itself, an image shows folds, and where it overlaps.

mod composition;
mod coverage;
mod covering;
mod display;
mod findings;
#[cfg(test)]
mod tests;

use serde::Serialize;

pub use composition::{CompositionCheck, RoundTrip};
pub use coverage::{Coverage, SurfaceDistance};
pub use covering::{ComparedWith, Degree};

use super::{BoundaryMap, SurfaceDistortion};
use crate::check::{FindSelfIntersections, SelfIntersections, Severity, repair};
use crate::geometry::{QueryError, SurfaceQuery};
use crate::mesh::SurfaceMesh;
use covering::{Covering, FoldedEdges};

/// How [`check`] looks.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryCheckOptions {
    /// Distance between image and target, as a fraction of the target's diagonal, beyond which they are said not to
    /// cover each other. A coarse image cuts corners: 0.01 is usual.
    pub tolerance: f64,
    /// The largest distances are sought until known to within this fraction of the target's diagonal.
    pub distance_error: f64,
    /// Points spread by area, over which distances are averaged.
    pub samples: usize,
    /// Seed of these points and of those inside.
    pub seed: u64,
}

impl Default for BoundaryCheckOptions {
    fn default() -> Self {
        Self {
            tolerance: 0.01,
            distance_error: 2e-4,
            samples: 20_000,
            seed: 1,
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
    /// What the image was held against.
    #[serde(rename = "against")]
    pub compared_with: ComparedWith,
    /// Whether the map is one to one.
    pub verdict: BijectivityVerdict,
    /// How often the image covers the target; `None` for domains that are open or have no orientation.
    pub degree: Option<Degree>,
    /// Triangles whose images are turned over. On a sphere: exactly. ComparedWith a target: those that face against the
    /// target's outward normals at the points closest to four points of theirs. By itself: those beside a folded edge
    /// that face against the triangles around them. With a degree below zero all are expected to be.
    pub flipped: usize,
    /// Triangles with an area whose images have none: corners exactly on a line (on a sphere: on a great circle).
    pub degenerate: usize,
    /// Triangles of the domain with corners exactly on a line; not held against the map.
    pub flat_in_domain: usize,
    /// Edges across which the image (by way of the sphere: the plain one) turns back by more than 150°, and the domain does
    /// not.
    pub folded_edges: usize,
    /// Distances between image and target; `None` without a target.
    pub coverage: Option<Coverage>,
    /// How far the map is from an isometry; `None` when a surface has no area.
    pub distortion: Option<SurfaceDistortion>,
    /// Pairs of image triangles (by way of the sphere: of the plain image) that pass through each other.
    pub self_intersections: SelfIntersections,
    /// What more is known of a map by way of the sphere; `None` for others.
    #[serde(rename = "by_sphere")]
    pub composition: Option<CompositionCheck>,
    /// What is wrong, errors first.
    pub findings: Vec<MapFinding>,
}

/// Whether a map is one to one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BijectivityVerdict {
    /// A bijection with the sphere, or by way of it, decided exactly; perhaps one that mirrors.
    Bijective,
    /// Nothing speaks against it.
    NoDefectFound,
    /// There are warnings.
    Doubtful,
    /// There are errors.
    NotBijective,
}

/// One thing that is wrong with a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapFinding {
    /// What sort of thing.
    pub kind: MapFindingKind,
    /// [`Severity::Error`] when the map cannot be one to one.
    pub severity: Severity,
    /// How many of them there are.
    pub count: usize,
    /// The first edges concerned, 20 at most, by their vertices.
    pub edges: Vec<[u32; 2]>,
    /// The first triangles concerned, 20 at most.
    pub faces: Vec<u32>,
    /// What was found.
    pub message: String,
    /// What to do about it.
    pub advice: String,
}

/// Sorts of findings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum MapFindingKind {
    /// The domain is open, or cannot be oriented.
    DomainBoundsNothing,
    /// The target is open, or cannot be oriented.
    TargetBoundsNothing,
    /// Domain and target have other numbers of components or handles.
    Topology,
    /// The target is covered not once.
    Degree,
    /// Parts of the target's inside are gone round another number of times than others.
    UnevenCovering,
    /// The map turns everything inside out.
    Mirrored,
    /// Triangles are turned over.
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
    /// There is nothing to map, or a corner of it is nowhere.
    #[error("the domain cannot be examined: {0}")]
    Domain(QueryError),
    /// There is nothing to map to, or a corner of it is nowhere.
    #[error("the target cannot be examined: {0}")]
    Target(QueryError),
    /// No triangle has an image with finite corners.
    #[error("the image cannot be examined: {0}")]
    Image(QueryError),
}

/// Examines a boundary map: whether it is one to one, and how far it distorts.
///
/// `target` is the surface that the image is meant to cover; without it, the map's own target, if it goes by way of the
/// sphere, or the sphere that the image lies on to 1e-6 of its radius, if it does. An image that is farther than a tenth
/// of the diagonal off its target is examined by itself. Surfaces are taken as [`repair()`] turns them. `self_intersections`
/// finds triangles that pass through each other, as CGAL does in builds with the `native` feature. Takes seconds per
/// 100 000 triangles with a target, and a fraction of one without.
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
    if let Some(drawn) = map.domain_embedding() {
        return composition::check(map, drawn, target, options, self_intersections);
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
    // Elsewhere, normals at closest points and points inside say nothing of the image.
    let near = pair.filter(|_| coverage.is_none_or(|coverage| coverage.image_to_target.p99 <= ELSEWHERE));
    let folded = FoldedEdges::find(&domain, &image);
    let covering = Covering::new(&domain, (&image, &image_query), near, &folded, off, options.seed);
    let (self_intersections, crossing) = look_for_self_intersections(&image, self_intersections);
    let evidence = findings::Evidence {
        domain: &domain,
        target: target.as_ref(),
        covering: &covering,
        folded: &folded,
        coverage,
        elsewhere: pair.is_some() && near.is_none(),
        crossing: &crossing,
        tolerance: options.tolerance,
    };
    let findings = evidence.findings();
    Ok(BoundaryCheck {
        vertices: domain.vertices().len(),
        faces: domain.triangles().len(),
        compared_with: covering.compared_with,
        verdict: match covering.compared_with {
            ComparedWith::Sphere { .. } => exact_verdict(&findings),
            ComparedWith::Target | ComparedWith::Itself => verdict(&findings),
        },
        degree: covering.degree,
        flipped: covering.flipped.len(),
        degenerate: covering.degenerate.len(),
        flat_in_domain: covering.flat_in_domain,
        folded_edges: folded.edges.len(),
        coverage,
        distortion: SurfaceDistortion::of(&domain, image.vertices()),
        self_intersections,
        composition: None,
        findings,
    })
}

/// Distance from the target, over its diagonal, beyond which an image is at another place or of another size.
const ELSEWHERE: f64 = 0.1;

fn verdict(findings: &[MapFinding]) -> BijectivityVerdict {
    match findings.iter().map(|finding| finding.severity).min() {
        Some(Severity::Error) => BijectivityVerdict::NotBijective,
        Some(Severity::Warning) => BijectivityVerdict::Doubtful,
        None => BijectivityVerdict::NoDefectFound,
    }
}

/// Of a map that has been decided: only errors speak against it.
fn exact_verdict(findings: &[MapFinding]) -> BijectivityVerdict {
    match verdict(findings) {
        BijectivityVerdict::NotBijective => BijectivityVerdict::NotBijective,
        _ => BijectivityVerdict::Bijective,
    }
}

fn look_for_self_intersections(
    image: &SurfaceMesh,
    find: Option<FindSelfIntersections>,
) -> (SelfIntersections, Vec<[u32; 2]>) {
    let not_checked = |reason: String| (SelfIntersections::NotChecked { reason }, Vec::new());
    match find.map(|find| find(image)) {
        None => not_checked("built without `native`".to_string()),
        Some(Err(reason)) => not_checked(reason),
        Some(Ok(pairs)) => (SelfIntersections::Checked { pairs: pairs.len() }, pairs),
    }
}
