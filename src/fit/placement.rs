//! Placement of sources and collocation points (sections 4.1 and 4.5).

use super::levels::{dropped_warning, levels};
use super::options::PointCounts;
use super::phase::Progress;
use super::unit_frame::UnitFrame;
use super::{FitError, FitMethod, FitOptions, Placement};
use crate::Point;
use crate::geometry::SurfaceQuery;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;
use crate::sampling::{self, Anchors, Collocation};
use crate::solver::{DenseOptions, Level, SchwarzOptions};

/// The points of a fit, in model units.
pub(super) struct PlacedPoints {
    /// The vertices that sources of the finest level belong to.
    pub anchors: Anchors,
    pub collocation: Collocation,
    pub sources: SourceSets,
}

/// Sources, as the solver takes them.
pub(super) enum SourceSets {
    Levels(Vec<Level>, SchwarzOptions),
    Dense(Vec<Point>, DenseOptions),
}

impl PlacedPoints {
    /// Adds a warning where there are fewer sources than asked for.
    pub fn new(
        domain: &SurfaceMesh,
        options: &FitOptions,
        warnings: &mut Vec<String>,
        progress: &Progress,
    ) -> Result<Self, FitError> {
        let counts = PointCounts::of(domain, options);
        warnings.extend(counts.warning());
        let anchors = Anchors::choose(domain, counts.sources);
        let collocation = place_collocation(domain, &anchors, &counts, options);
        let sources = match options.method {
            FitMethod::Schwarz { alpha, options } => {
                let query = SurfaceQuery::with_winding_sign(domain)?;
                let levels = levels(domain, &anchors, &collocation, alpha, &query, warnings)?;
                SourceSets::Levels(levels, options)
            }
            FitMethod::Dense {
                placement,
                options: dense,
            } => {
                let sources = place_sources(domain, &anchors, &counts, placement, options.seed, warnings, progress)?;
                SourceSets::Dense(sources, dense)
            }
        };
        Ok(Self {
            anchors,
            collocation,
            sources,
        })
    }
}

/// Sources of a dense system, on a single level; warns of those that found no place.
fn place_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    counts: &PointCounts,
    placement: Placement,
    seed: u64,
    warnings: &mut Vec<String>,
    progress: &Progress,
) -> Result<Vec<Point>, FitError> {
    let sources = match placement {
        Placement::Adaptive { alpha } => near_sources(domain, anchors, alpha, warnings)?,
        Placement::Offset { distance } => {
            let (cavity, count) = cavity_anchors(domain, anchors, counts);
            let mut sources = offset_sources(domain, distance, count, seed, warnings, progress)?;
            sources.extend(near_sources(domain, &cavity, Placement::DEFAULT_ALPHA, warnings)?);
            sources
        }
        Placement::Sphere { radius } => {
            let (cavity, count) = cavity_anchors(domain, anchors, counts);
            let UnitFrame { centre, diagonal } = UnitFrame::of(domain);
            let mut sources = sampling::bounding_sphere(centre, radius * diagonal, count);
            sources.extend(near_sources(domain, &cavity, Placement::DEFAULT_ALPHA, warnings)?);
            sources
        }
    };
    if sources.is_empty() {
        Err(FitError::NoSources)
    } else {
        Ok(sources)
    }
}

/// Sources beside the anchors, as by [`Placement::Adaptive`].
fn near_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    alpha: f64,
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, FitError> {
    let query = SurfaceQuery::with_winding_sign(domain)?;
    let placed = sampling::adaptive_sources(domain, anchors, alpha, &|balls| query.are_outside(balls));
    if placed.dropped > 0 {
        warnings.push(dropped_warning(placed.dropped, anchors.vertices.len()));
    }
    Ok(placed.positions)
}

/// The anchors on the walls of cavities, which need sources inside the cavity, and how many sources are left for a
/// surface around the domain.
fn cavity_anchors(domain: &SurfaceMesh, anchors: &Anchors, counts: &PointCounts) -> (Anchors, usize) {
    let in_cavity = cavity_vertices(domain);
    let cavity = anchors.only(|v| in_cavity[v as usize]);
    let count = counts.sources.saturating_sub(cavity.vertices.len());
    (cavity, count)
}

/// Whether each vertex lies on a shell that encloses a cavity: one that has a negative volume on a repaired surface.
fn cavity_vertices(domain: &SurfaceMesh) -> Vec<bool> {
    let components = Topology::new(domain).components();
    let UnitFrame { centre, .. } = UnitFrame::of(domain);
    // Six times the signed volume of each component. Some triangles may belong to none.
    let mut volumes = vec![0.0; components.shapes.len()];
    for (t, &component) in components.of_triangle.iter().enumerate() {
        if let Some(volume) = volumes.get_mut(component as usize) {
            let [a, b, c] = domain.corners(t).map(|p| p - centre);
            *volume += a.dot(&b.cross(&c));
        }
    }
    let mut in_cavity = vec![false; domain.vertices().len()];
    for (corners, &component) in domain.triangles().iter().zip(&components.of_triangle) {
        if volumes.get(component as usize).is_some_and(|&volume| volume < 0.0) {
            corners.iter().for_each(|&v| in_cavity[v as usize] = true);
        }
    }
    in_cavity
}

#[cfg(not(feature = "native"))]
fn offset_sources(
    _: &SurfaceMesh,
    _: f64,
    _: usize,
    _: u64,
    _: &mut Vec<String>,
    _: &Progress,
) -> Result<Vec<Point>, FitError> {
    Err(FitError::NeedsNative)
}

#[cfg(feature = "native")]
fn offset_sources(
    domain: &SurfaceMesh,
    distance: f64,
    count: usize,
    seed: u64,
    warnings: &mut Vec<String>,
    progress: &Progress,
) -> Result<Vec<Point>, FitError> {
    use super::Phase;
    use crate::cgal_tetgen::{OffsetOptions, cancellable, offset_surface};
    let distance = distance * UnitFrame::of(domain).diagonal;
    let surface = domain.clone();
    let offset = cancellable(&|| progress.report(Phase::Sampling), move || {
        offset_surface(&surface, distance, &OffsetOptions::default())
    })?;
    if offset.raw_wrap {
        warnings.push("no projected offset surface is valid: the wrap itself is used, about 1 % off".into());
    }
    if offset.model_genus.is_some_and(|genus| genus != offset.genus) {
        warnings.push(format!(
            "the offset surface has genus {} and the domain {}: it closes holes, so that no sources are placed in them",
            offset.genus,
            offset.model_genus.unwrap_or_default()
        ));
    }
    Ok(sampling::even_points(&offset.mesh, count, seed))
}

fn place_collocation(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    counts: &PointCounts,
    options: &FitOptions,
) -> Collocation {
    if options.collocation_ratio <= 1.0 {
        return Collocation::vertices(domain, &Anchors::choose(domain, counts.collocation).vertices);
    }
    if options.collocation_ratio == 3.0 && !counts.is_limited() {
        return Collocation::vertices_and_centroids(domain);
    }
    match options.method.placement() {
        Placement::Adaptive { .. } => {
            let extra = counts.collocation.div_ceil(anchors.vertices.len().max(1)) - 1;
            Collocation::around(domain, anchors, extra, options.seed)
        }
        Placement::Offset { .. } | Placement::Sphere { .. } => {
            Collocation::even(domain, counts.collocation, options.seed)
        }
    }
}
