//! Sources and collocation points of a domain.

use super::frame::Frame;
use super::levels::remark_on_dropped;
use super::options::Size;
use super::{FitError, FitOptions, Placement};
use crate::Point;
use crate::geometry::SurfaceQuery;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;
use crate::sampling::{self, Anchors, Collocation};

/// Where the sources stand, and remarks on those that found no place.
pub(super) fn place_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    size: &Size,
    options: &FitOptions,
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, FitError> {
    let sources = match options.placement {
        Placement::Adaptive { alpha } => near_sources(domain, anchors, alpha, warnings)?,
        Placement::Offset { distance } => {
            let (within, count) = in_cavities(domain, anchors, size);
            let around = offset_sources(domain, distance, count, options.seed, warnings)?;
            [around, near_sources(domain, &within, 1.0, warnings)?].concat()
        }
        Placement::Sphere { radius } => {
            let (within, count) = in_cavities(domain, anchors, size);
            let frame = Frame::of(domain);
            let around = sampling::bounding_sphere(frame.centre, radius * frame.diagonal, count);
            [around, near_sources(domain, &within, 1.0, warnings)?].concat()
        }
    };
    if sources.is_empty() {
        Err(FitError::NoSources)
    } else {
        Ok(sources)
    }
}

fn near_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    alpha: f64,
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, FitError> {
    let query = SurfaceQuery::with_winding_sign(domain)?;
    let placed = sampling::adaptive_sources(domain, anchors, alpha, &|balls| query.are_outside(balls));
    if placed.dropped > 0 {
        warnings.push(remark_on_dropped(placed.dropped, anchors.vertices.len()));
    }
    Ok(placed.positions)
}

/// The anchors on cavities, which no surface around the domain serves, and how many sources are left for that surface.
fn in_cavities(domain: &SurfaceMesh, anchors: &Anchors, size: &Size) -> (Anchors, usize) {
    let in_cavity = cavity_vertices(domain);
    let within = anchors.only(|v| in_cavity[v as usize]);
    let count = size.sources.saturating_sub(within.vertices.len());
    (within, count)
}

/// Whether each vertex lies on a shell that encloses a cavity: one that, on a repaired surface, has a negative volume.
fn cavity_vertices(domain: &SurfaceMesh) -> Vec<bool> {
    let components = Topology::new(domain).components();
    let centre = Frame::of(domain).centre;
    let mut volumes = vec![0.0; components.shapes.len()];
    let parts = |t: usize| Some(components.of_triangle[t] as usize).filter(|&c| c < components.shapes.len());
    for t in 0..domain.triangles().len() {
        let [a, b, c] = domain.corners(t).map(|p| p - centre);
        if let Some(component) = parts(t) {
            volumes[component] += a.dot(&b.cross(&c));
        }
    }
    let mut in_cavity = vec![false; domain.vertices().len()];
    for (t, corners) in domain.triangles().iter().enumerate() {
        if parts(t).is_some_and(|component| volumes[component] < 0.0) {
            corners.iter().for_each(|&v| in_cavity[v as usize] = true);
        }
    }
    in_cavity
}

#[cfg(not(feature = "native"))]
fn offset_sources(_: &SurfaceMesh, _: f64, _: usize, _: u64, _: &mut Vec<String>) -> Result<Vec<Point>, FitError> {
    Err(FitError::NeedsNative)
}

#[cfg(feature = "native")]
fn offset_sources(
    domain: &SurfaceMesh,
    distance: f64,
    count: usize,
    seed: u64,
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, FitError> {
    let distance = distance * Frame::of(domain).diagonal;
    let offset = crate::cgal_tetgen::offset_surface(domain, distance, &crate::cgal_tetgen::OffsetOptions::default())?;
    if offset.raw_wrap {
        warnings.push("the offset surface is the wrap as it came, about 1 % off its distance".into());
    }
    if offset.model_genus.is_some_and(|genus| genus != offset.genus) {
        warnings.push(format!(
            "the offset surface has genus {} and the domain {}: it closes holes, and has no sources in them",
            offset.genus,
            offset.model_genus.unwrap_or_default()
        ));
    }
    Ok(sampling::even_points(&offset.mesh, count, seed))
}

pub(super) fn place_collocation(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    size: &Size,
    options: &FitOptions,
) -> Collocation {
    if options.collocation_ratio <= 1.0 {
        return Collocation::vertices(domain, &Anchors::choose(domain, size.collocation).vertices);
    }
    if options.collocation_ratio == 3.0 && size.is_whole() {
        return Collocation::vertices_and_centroids(domain);
    }
    match options.placement {
        Placement::Adaptive { .. } => {
            let extra = size.collocation.div_ceil(anchors.vertices.len().max(1)) - 1;
            Collocation::around(domain, anchors, extra, options.seed)
        }
        Placement::Offset { .. } | Placement::Sphere { .. } => {
            Collocation::even(domain, size.collocation, options.seed)
        }
    }
}
