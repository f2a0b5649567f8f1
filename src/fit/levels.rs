//! The levels of the Schwarz solver: from a few hundred sources for the whole domain to one per anchor.

use super::FitError;
use crate::geometry::SurfaceQuery;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::{self, Anchors, Collocation, HierarchyOptions, SiteLevel, SourceSite};
use crate::solver::Level;

/// Levels from coarse to fine; warns of sources of the finest that found no place.
pub(super) fn levels(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    collocation: &Collocation,
    alpha: f64,
    query: &SurfaceQuery,
    warnings: &mut Vec<String>,
) -> Result<Vec<Level>, FitError> {
    let finest = finest_level(domain, anchors, collocation);
    let mut levels: Vec<Level> = sampling::coarser_levels(&finest, &HierarchyOptions::default())
        .iter()
        .map(|sites| placed_level(sites, alpha, query).0)
        .collect();
    let (finest, dropped) = placed_level(&finest, alpha, query);
    if dropped > 0 {
        warnings.push(dropped_warning(dropped, anchors.vertices.len()));
    }
    if finest.sources.is_empty() {
        return Err(FitError::NoSources);
    }
    levels.push(finest);
    Ok(levels)
}

pub(super) fn dropped_warning(dropped: usize, asked: usize) -> String {
    format!(
        "{dropped} of {asked} sources had no place outside the domain (in gaps narrower than their spacing) and were left out"
    )
}

/// The sources at the sites of a level, and how many sites are left without one.
pub(super) fn placed_level(sites: &SiteLevel, alpha: f64, query: &SurfaceQuery) -> (Level, usize) {
    let placed = sampling::place_sources(&sites.sites, alpha, &|balls| query.are_outside(balls));
    let mut source_of_site = vec![Level::NO_OWNER; sites.sites.len()];
    for (source, &site) in placed.sites.iter().enumerate() {
        source_of_site[site as usize] = source as u32;
    }
    let spacing = |&site: &u32| sites.sites[site as usize].spacing;
    let level = Level {
        spacing: placed.sites.iter().map(spacing).collect(),
        rows: sites.rows.clone(),
        owner: sites.owner.iter().map(|&site| source_of_site[site as usize]).collect(),
        weights: sites.areas.clone(),
        sources: placed.positions,
    };
    (level, placed.dropped)
}

fn finest_level(domain: &SurfaceMesh, anchors: &Anchors, collocation: &Collocation) -> SiteLevel {
    let mut level = SiteLevel {
        sites: anchors.sites(domain),
        ..SiteLevel::default()
    };
    for (row, (point, &area)) in collocation.points.iter().zip(&collocation.areas).enumerate() {
        if let Some(owner) = owner(domain, anchors, point, &level.sites) {
            level.rows.push(row as u32);
            level.owner.push(owner);
            level.areas.push(area);
        }
    }
    level
}

/// The anchor nearest to a point, of those nearest to its triangle's corners.
fn owner(domain: &SurfaceMesh, anchors: &Anchors, point: &SurfacePoint, sites: &[SourceSite]) -> Option<u32> {
    let at = point.position(domain, domain.vertices());
    let distance = |anchor: &u32| (sites[*anchor as usize].position - at).norm_squared();
    let corners = domain.triangles()[point.triangle as usize];
    let candidates = corners.iter().filter_map(|&v| anchors.nearest[v as usize]);
    candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}
