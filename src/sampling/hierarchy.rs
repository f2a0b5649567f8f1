//! Successively coarser sets of source sites, for a multilevel solver: each compact group of neighbouring sites becomes
//! one site.

use super::SourceSite;
use crate::partition::Partition;
use crate::{Point, Vector};

/// The source sites of one level, and the collocation points of their sources.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SiteLevel {
    /// The sites of the sources.
    pub sites: Vec<SourceSite>,
    /// Collocation points of the level, as indices into all of them.
    pub rows: Vec<u32>,
    /// For each of `rows`, the site it is nearest to.
    pub owner: Vec<u32>,
    /// For each of `rows`, the area it stands for.
    pub areas: Vec<f64>,
}

/// Sizes of the levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HierarchyOptions {
    /// Sites for each site of the next coarser level.
    pub ratio: usize,
    /// Up to this many sites need no coarser level.
    pub dense: usize,
    /// With more sites than `dense`, the coarsest level has at most this many, and at least about a third of it.
    pub coarsest: usize,
    /// Collocation points kept for each site of a coarser level.
    pub rows_per_site: usize,
}

impl Default for HierarchyOptions {
    fn default() -> Self {
        Self {
            ratio: 12,
            dense: 1500,
            coarsest: 800,
            rows_per_site: 6,
        }
    }
}

/// Levels coarser than the given one, coarsest first; none when it is small enough itself. The rows of each level are a
/// subset of those of the next finer one. From one level to the next the spacing grows by the square root of the ratio,
/// everywhere in proportion to the finest. Costs `n log n`.
pub fn coarser_levels(finest: &SiteLevel, options: &HierarchyOptions) -> Vec<SiteLevel> {
    let mut levels: Vec<SiteLevel> = Vec::new();
    let mut fine = finest;
    if fine.sites.len() <= options.dense {
        return levels;
    }
    while fine.sites.len() > options.coarsest {
        // A smaller ratio where the coarsest level would otherwise have very few sources.
        let ratio = options
            .ratio
            .min((2 * fine.sites.len()).div_ceil(options.coarsest))
            .max(2);
        let (coarse, parent) = coarsen(&fine.sites, ratio);
        levels.push(thinned(coarse, &parent, fine, options.rows_per_site));
        fine = &levels[levels.len() - 1];
    }
    levels.reverse();
    levels
}

/// One site per group of up to `ratio`, and the group of each site.
fn coarsen(sites: &[SourceSite], ratio: usize) -> (Vec<SourceSite>, Vec<u32>) {
    let positions: Vec<Point> = sites.iter().map(|site| site.position).collect();
    let partition = Partition::equal(&positions, ratio);
    let mut parent = vec![0; sites.len()];
    let mut coarse = Vec::with_capacity(partition.parts().len());
    for (group, members) in partition.parts().enumerate() {
        members.iter().for_each(|&m| parent[m as usize] = group as u32);
        let area: f64 = members.iter().map(|&m| sites[m as usize].spacing.powi(2)).sum();
        let moment: Vector = members
            .iter()
            .map(|&m| positions[m as usize].coords * sites[m as usize].spacing.powi(2))
            .sum();
        let centre = Point::from(moment / area);
        let distance = |m: &u32| (positions[*m as usize] - centre).norm_squared();
        // The site nearest to the mean, since it is on the surface and has a normal.
        let middle = members
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        coarse.extend(middle.map(|&m| SourceSite {
            spacing: area.sqrt(),
            ..sites[m as usize]
        }));
    }
    (coarse, parent)
}

/// The coarse sites, each with up to `count` of the finer level's rows that it owns, evenly picked.
fn thinned(sites: Vec<SourceSite>, parent: &[u32], finer: &SiteLevel, count: usize) -> SiteLevel {
    let owners = finer.owner.iter().map(|&o| parent[o as usize]);
    let mut owned = vec![0usize; sites.len()];
    owners.clone().for_each(|o| owned[o as usize] += 1);
    let mut seen = vec![0usize; sites.len()];
    let mut level = SiteLevel::default();
    for (o, &row) in owners.zip(&finer.rows) {
        let (all, place) = (owned[o as usize], seen[o as usize]);
        seen[o as usize] += 1;
        let kept = all.min(count);
        // The rows whose share of `kept` passes an integer.
        if place * kept / all != (place + 1) * kept / all {
            level.rows.push(row);
            level.owner.push(o);
            level.areas.push(sites[o as usize].spacing.powi(2) / kept as f64);
        }
    }
    level.sites = sites;
    level
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn sphere_level(subdivisions: u32) -> SiteLevel {
        let sphere = shapes::sphere(1.0, subdivisions);
        let spacing = (sphere.area() / sphere.vertices().len() as f64).sqrt();
        let sites: Vec<SourceSite> = sphere
            .vertices()
            .iter()
            .map(|p| SourceSite {
                position: *p,
                normal: p.coords,
                spacing,
            })
            .collect();
        let rows: Vec<u32> = (0..3 * sites.len() as u32).collect();
        SiteLevel {
            owner: rows.iter().map(|r| r / 3).collect(),
            areas: vec![spacing * spacing / 3.0; rows.len()],
            rows,
            sites,
        }
    }

    #[test]
    fn levels_shrink_to_the_coarsest_and_share_out_the_same_area() {
        let finest = sphere_level(5);
        let options = HierarchyOptions::default();
        let levels = coarser_levels(&finest, &options);
        assert_eq!(levels.len(), 2);
        assert!((265..=800).contains(&levels[0].sites.len()));
        let area: f64 = finest.areas.iter().sum();
        for level in &levels {
            assert!((level.areas.iter().sum::<f64>() / area - 1.0).abs() < 1e-12);
            let per_site = level.rows.len() as f64 / level.sites.len() as f64;
            assert_eq!(per_site, options.rows_per_site as f64);
            for (&row, &owner) in level.rows.iter().zip(&level.owner) {
                let site = &level.sites[owner as usize];
                let point = finest.sites[row as usize / 3].position;
                assert!((point - site.position).norm() < 3.0 * site.spacing);
            }
        }
        assert!(coarser_levels(&sphere_level(2), &options).is_empty());
    }
}
