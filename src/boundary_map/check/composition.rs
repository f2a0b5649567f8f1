//! Checks of compositions of embeddings: bijectivity follows exactly from the embeddings. Everything else is
//! measured on the map itself, not on the straight triangles between the images of vertices.

use rayon::prelude::*;
use serde::Serialize;

use super::covering::{
    ComparedWith, Covering, Degree, Facing, FoldedEdges, facings_on_sphere, facings_on_target, is_flat,
    triangles_facing,
};
use super::findings::Measurements;
use super::{BoundaryCheck, BoundaryCheckError, BoundaryCheckOptions, Coverage, SurfaceDistance};
use crate::Point;
use crate::boundary_map::composition::{Composition, SurfaceEmbedding, vertex_places};
use crate::boundary_map::{BoundaryMap, SurfaceDistortion};
use crate::check::{FindSelfIntersections, look_for_self_intersections, repair};
use crate::geometry::SurfaceQuery;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::Collocation;
use crate::spherical::EmbeddingCheck;
use crate::statistics::Summary;

/// Results of [`super::check`] for a composition: a map onto or through the sphere, through a flat torus, or through a hyperbolic surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CompositionCheck {
    /// The domain's embedding, and the target's where it has a mesh of its own. If each is a bijection, so is the map.
    pub embeddings: Vec<EmbeddingCheck>,
    /// Triangles of the target with corners exactly on a line: a bijection of the triangles, but not of the points.
    pub flat_in_target: usize,
    /// Distances between points and their images under the map and its inverse.
    pub round_trip: RoundTrip,
    /// Subdivisions of the domain, each triangle into four, before distortion was measured.
    pub cuts: u32,
    /// Triangles of the plain image, straight between the images of vertices, that face against the target: defects of
    /// the plain image, not of the map.
    pub plain_image_flipped: usize,
    /// Whether the embeddings are in a flat torus.
    pub through_torus: bool,
    /// Whether the embeddings are in a hyperbolic surface.
    pub through_hyperbolic_surface: bool,
}

/// Distances between points and their round trips, as fractions of the domain's diagonal: rounding errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RoundTrip {
    /// Number of points: vertices, and samples uniform by area.
    pub points: usize,
    /// Root mean square.
    pub rms: f64,
    /// 99th percentile.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

/// The domain is not subdivided beyond this number of triangles, nor more often than [`MOST_CUTS`].
const MOST_TRIANGLES: usize = 2_000_000;
pub(super) const MOST_CUTS: u32 = 2;

/// [`super::check`] for compositions.
pub(super) fn check(
    map: &BoundaryMap,
    shells: &[ComposedShell],
    target: Option<&SurfaceMesh>,
    options: &BoundaryCheckOptions,
    self_intersections: Option<FindSelfIntersections>,
) -> Result<BoundaryCheck, BoundaryCheckError> {
    let (domain, plain) = (map.domain(), map.target());
    let (fine, cuts) = subdivide(map);
    let given = target.map(|target| repair(target).0);
    let queried = |mesh: &SurfaceMesh| SurfaceQuery::new(mesh).map_err(BoundaryCheckError::Target);

    let mut plain_image_flipped = 0;
    let mut coverage = None;
    if let Some(own) = map.target_surface() {
        let query = queried(own)?;
        plain_image_flipped = triangles_facing(Facing::Inward, &facings_on_target(&plain, own, &query)).len();
        coverage = map
            .inverse()
            .map(|back| own_target_coverage(&fine, &back, &query, options));
    }
    if let Some(given) = &given {
        let covered = map.target_surface().cloned().unwrap_or_else(|| fine.target());
        let covered_query = queried(&covered)?;
        let pair = (given, &queried(given)?);
        coverage = Some(Coverage::measure((&covered, &covered_query), pair, options));
    }
    let embeddings = shells
        .iter()
        .flat_map(|(composition, _)| [Some(composition.domain()), composition.target()]);
    let embeddings: Vec<EmbeddingCheck> = embeddings.flatten().map(SurfaceEmbedding::check).collect();
    let flat = |mesh: &SurfaceMesh| -> Vec<u32> {
        let triangles = (0..mesh.triangles().len() as u32).into_par_iter();
        triangles.filter(|&t| is_flat(&mesh.corners(t as usize))).collect()
    };
    let folded = FoldedEdges::find(domain, &plain);
    let covering = Covering {
        triangles: domain.triangles().len(),
        compared_with: match shells.iter().all(|(composition, _)| composition.target().is_some()) {
            true => ComparedWith::Target,
            false => ComparedWith::Sphere {
                centre: [0.0; 3],
                radius: 1.0,
            },
        },
        degree: Some(Degree {
            value: embeddings.iter().map(|check| check.degree.round() as i64).product(),
            agreement: 1.0,
            points: 0,
        }),
        flipped: shells.iter().flat_map(flipped).collect(),
        degenerate: vec![],
        flat_in_domain: flat(domain),
    };
    let (self_intersections, _) = look_for_self_intersections(&plain, self_intersections);
    let measurements = Measurements {
        domain,
        target: given.as_ref(),
        covering: &covering,
        folded: &folded,
        coverage,
        elsewhere: false,
        crossing: &[],
        tolerance: options.tolerance,
    };
    let checked = CompositionCheck {
        embeddings,
        flat_in_target: map.target_surface().map_or(0, |mesh| flat(mesh).len()),
        round_trip: RoundTrip::measure(map, options),
        cuts,
        plain_image_flipped,
        through_torus: shells
            .iter()
            .any(|(composition, _)| composition.domain().as_torus().is_some()),
        through_hyperbolic_surface: shells
            .iter()
            .any(|(composition, _)| composition.domain().as_hyperbolic().is_some()),
    };
    let distortion = SurfaceDistortion::of(fine.domain(), fine.image());
    let worst_places = measurements.worst_places((fine.domain(), fine.image()), options.worst_places);
    Ok(BoundaryCheck {
        worst_places,
        ..measurements.report(distortion, self_intersections, Some(checked))
    })
}

/// The composition of a shell, and the shell's triangles in the domain; `None` where it is the whole domain.
pub(super) type ComposedShell<'a> = (&'a Composition, Option<&'a [u32]>);

/// The compositions that a map is made of; none for other maps.
pub(super) fn shells_of(map: &BoundaryMap) -> Vec<ComposedShell<'_>> {
    match (map.composition(), map.shell_maps()) {
        (Some(composition), _) => vec![(composition, None)],
        (None, Some(maps)) => {
            let compositions = maps.compositions();
            compositions
                .map(|(composition, triangles)| (composition, Some(triangles)))
                .collect()
        }
        (None, None) => vec![],
    }
}

/// Triangles of the domain that are inverted in the embedding.
fn flipped((composition, triangles): &ComposedShell) -> Vec<u32> {
    let own: Vec<u32> = match composition.domain() {
        SurfaceEmbedding::Sphere(embedding) => triangles_facing(
            Facing::Inward,
            &facings_on_sphere(embedding.surface(), embedding.directions()),
        ),
        // Whoever made or read it has refused flipped triangles.
        other => other.check().first_flipped.into_iter().collect(),
    };
    own.into_iter()
        .map(|t| triangles.map_or(t, |triangles| triangles[t as usize]))
        .collect()
}

/// The map over a subdivided domain, and the number of subdivisions.
fn subdivide(map: &BoundaryMap) -> (BoundaryMap, u32) {
    let (mut fine, mut cuts) = (map.clone(), 0);
    while cuts < MOST_CUTS && 4 * fine.domain().triangles().len() <= MOST_TRIANGLES {
        fine = fine.subdivided();
        cuts += 1;
    }
    (fine, cuts)
}

/// Distances from images to the map's own target, and from points of the target to the images of their preimages:
/// rounding errors.
fn own_target_coverage(
    fine: &BoundaryMap,
    back: &BoundaryMap,
    query: &SurfaceQuery,
    options: &BoundaryCheckOptions,
) -> Coverage {
    let diagonal = fine.target_diagonal();
    let forward = back.inverse().expect("the domain is a surface, not the unit sphere");
    let spread = Collocation::even(fine.domain(), options.samples, options.seed).points;
    let off = |images: &[Point]| query.closest_points(images).iter().map(|c| c.distance).collect();
    let image_to_target =
        SurfaceDistance::of_rounding_errors(off(&fine.evaluate(&spread)), off(fine.image()), diagonal);

    // The domain of `back` is the target.
    let missed = |points: &[SurfacePoint]| -> Vec<f64> {
        let preimages = back.evaluate_on_target(points).unwrap_or_default();
        distances(&back.positions(points), &forward.evaluate(&preimages))
    };
    let spread = Collocation::even(back.domain(), options.samples, options.seed).points;
    let target_to_image =
        SurfaceDistance::of_rounding_errors(missed(&spread), missed(&vertex_places(back.domain())), diagonal);
    Coverage {
        image_to_target,
        target_to_image,
    }
}

impl SurfaceDistance {
    /// From distances that are rounding errors everywhere, so that the largest needs no search: at samples uniform by
    /// area, and at other points.
    fn of_rounding_errors(spread: Vec<f64>, others: Vec<f64>, diagonal: f64) -> Self {
        let (rms, p99) = Summary::of(&spread).map_or((0.0, 0.0), |s| (s.rms, s.p99));
        let largest = [&spread, &others].into_iter().flatten().copied().fold(0.0, f64::max);
        Self {
            rms: rms / diagonal,
            p99: p99 / diagonal,
            max: largest / diagonal,
            max_error: 0.0,
        }
    }
}

impl RoundTrip {
    fn measure(map: &BoundaryMap, options: &BoundaryCheckOptions) -> Self {
        let domain = map.domain();
        let mut points = vertex_places(domain);
        points.extend(Collocation::even(domain, options.samples, options.seed).points);
        let returned = match (map.evaluate_on_target(&points), map.inverse(), map.composition()) {
            (Some(on_target), Some(back), _) => back.evaluate(&on_target),
            (_, _, None) => vec![],
            (_, _, Some(composition)) => {
                let surface = composition.domain().surface();
                let found = points
                    .par_iter()
                    .with_min_len(256)
                    .filter_map(|p| composition.back_in_domain(p));
                found.map(|p| p.position(surface, surface.vertices())).collect()
            }
        };
        let errors = distances(&map.positions(&points), &returned);
        let summary = Summary::of(&errors).map_or([0.0; 3], |s| [s.rms, s.p99, s.max]);
        let [rms, p99, max] = summary.map(|error| error / domain.diagonal());
        let points = points.len();
        Self { points, rms, p99, max }
    }
}

fn distances(a: &[Point], b: &[Point]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).collect()
}
