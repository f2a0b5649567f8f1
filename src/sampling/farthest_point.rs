//! Farthest-point selection: a well-spread subset of the vertices (Gonzalez, *Clustering to minimize the maximum
//! intercluster distance*, Theor. Comput. Sci. 38, 1985).

use rayon::prelude::*;

use crate::mesh::SurfaceMesh;
use crate::{Point, Vector};

/// Vertices that carry a source each, with the area and the outward normal of their neighbourhood.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchors {
    /// Vertex indices, well spread: every prefix is a coarser choice.
    pub vertices: Vec<u32>,
    /// Local spacing `h`: the square root of the area that is nearest to each anchor.
    pub spacing: Vec<f64>,
    /// Unit vertex normals, triangles weighted by their angle.
    pub normals: Vec<Vector>,
    /// For each vertex of the surface, which anchor is nearest; `None` for vertices that could not carry one.
    pub nearest: Vec<Option<u32>>,
}

impl Anchors {
    /// Up to `count` anchors among the vertices of the surface's triangles. Coincident vertices and vertices without
    /// area carry none. Costs `count` passes over the vertices.
    pub fn choose(domain: &SurfaceMesh, count: usize) -> Self {
        let (areas, normals) = vertex_areas_and_normals(domain);
        let usable: Vec<u32> = (0..areas.len() as u32)
            .filter(|&v| areas[v as usize] > 0.0 && normals[v as usize] != Vector::zeros())
            .collect();
        let positions: Vec<Point> = usable.iter().map(|&v| domain.vertices()[v as usize]).collect();
        let selection = select(&positions, count);
        let mut gathered = vec![0.0; selection.chosen.len()];
        let mut nearest = vec![None; areas.len()];
        for (&v, &anchor) in usable.iter().zip(&selection.nearest) {
            gathered[anchor as usize] += areas[v as usize];
            nearest[v as usize] = Some(anchor);
        }
        let vertices: Vec<u32> = selection.chosen.iter().map(|&k| usable[k]).collect();
        let normals = vertices.iter().map(|&v| normals[v as usize]).collect();
        Self {
            vertices,
            spacing: gathered.into_iter().map(f64::sqrt).collect(),
            normals,
            nearest,
        }
    }

    /// Those anchors whose vertex is wanted. `nearest` keeps only the vertices that belong to one of them.
    pub fn only(&self, wanted: impl Fn(u32) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.vertices.len()).filter(|&k| wanted(self.vertices[k])).collect();
        let mut renumbered = vec![None; self.vertices.len()];
        for (new, &old) in kept.iter().enumerate() {
            renumbered[old] = Some(new as u32);
        }
        Self {
            vertices: kept.iter().map(|&k| self.vertices[k]).collect(),
            spacing: kept.iter().map(|&k| self.spacing[k]).collect(),
            normals: kept.iter().map(|&k| self.normals[k]).collect(),
            nearest: self
                .nearest
                .iter()
                .map(|anchor| anchor.and_then(|a| renumbered[a as usize]))
                .collect(),
        }
    }
}

/// Indices of up to `count` well-spread points, none of them coincident.
pub fn thin(points: &[Point], count: usize) -> Vec<usize> {
    select(points, count).chosen
}

struct Selection {
    chosen: Vec<usize>,
    /// For each point, which of `chosen` is nearest (the earlier one of equals).
    nearest: Vec<u32>,
}

fn select(points: &[Point], count: usize) -> Selection {
    let mut nearest = vec![(f64::INFINITY, 0u32); points.len()];
    let mut chosen = Vec::with_capacity(count.min(points.len()));
    // Start far from the middle, so that the first point is a tip whatever the order of the points.
    let middle = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / points.len().max(1) as f64);
    let mut next = farthest(points.iter().map(|p| (p - middle).norm_squared()));
    while let Some((index, distance)) = next {
        if chosen.len() == count || (distance == 0.0 && !chosen.is_empty()) {
            break;
        }
        let (centre, order) = (points[index], chosen.len() as u32);
        chosen.push(index);
        nearest
            .par_iter_mut()
            .zip(points)
            .with_min_len(1 << 13)
            .for_each(|(best, p)| {
                let d = (p - centre).norm_squared();
                if d < best.0 {
                    *best = (d, order);
                }
            });
        next = farthest(nearest.iter().map(|best| best.0));
    }
    Selection {
        chosen,
        nearest: nearest.into_iter().map(|best| best.1).collect(),
    }
}

/// The largest value and its index, the first of equals; NaN is never taken.
fn farthest(distances: impl Iterator<Item = f64>) -> Option<(usize, f64)> {
    distances.enumerate().fold(None, |best, (i, d)| match best {
        Some((_, most)) if most >= d => best,
        _ if d.is_nan() => best,
        _ => Some((i, d)),
    })
}

fn vertex_areas_and_normals(domain: &SurfaceMesh) -> (Vec<f64>, Vec<Vector>) {
    let mut areas = vec![0.0; domain.vertices().len()];
    let mut normals = vec![Vector::zeros(); domain.vertices().len()];
    for t in 0..domain.triangles().len() {
        let area_vector = domain.area_vector(t);
        let Some(normal) = area_vector.try_normalize(0.0) else {
            continue;
        };
        let corners = domain.corners(t);
        for k in 0..3 {
            let vertex = domain.triangles()[t][k] as usize;
            let (ahead, behind) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
            areas[vertex] += area_vector.norm() / 3.0;
            normals[vertex] += normal * ahead.angle(&behind);
        }
    }
    let normals = normals
        .into_iter()
        .map(|n| n.try_normalize(1e-12).unwrap_or_default())
        .collect();
    (areas, normals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn anchors_share_out_the_area_and_point_outward() {
        let domain = shapes::sphere(2.0, 3);
        for count in [50, 642, 10_000] {
            let anchors = Anchors::choose(&domain, count);
            assert_eq!(anchors.vertices.len(), count.min(642));
            let area: f64 = anchors.spacing.iter().map(|h| h * h).sum();
            assert!((area / domain.area() - 1.0).abs() < 1e-12);
            for (&v, normal) in anchors.vertices.iter().zip(&anchors.normals) {
                assert!(domain.vertices()[v as usize].coords.normalize().dot(normal) > 0.99);
            }
        }
    }

    /// No two of `k` chosen points are closer than the covering radius that `k` discs of that radius would need.
    #[test]
    fn chosen_points_are_well_spread() {
        let points = shapes::sphere(1.0, 4).vertices().to_vec();
        let chosen = thin(&points, 100);
        let closest = (0..100)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| (points[chosen[i]] - points[chosen[j]]).norm())
            .fold(f64::INFINITY, f64::min);
        let covering = (4.0 / 100f64).sqrt();
        assert!(
            closest > covering,
            "closest pair {closest}, discs of radius {covering} cover the sphere at best"
        );
    }

    #[test]
    fn coincident_points_are_taken_once() {
        let p = Point::new(1.0, 2.0, 3.0);
        assert_eq!(thin(&[p, p, Point::origin(), p], 4), [2, 0]);
        assert!(thin(&[], 4).is_empty());
        assert_eq!(thin(&[p; 3], 2), [0]);
    }
}
