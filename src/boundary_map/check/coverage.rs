//! Hausdorff distances between surfaces, with bounds.
//!
//! The largest distance is sought by branch and bound, as in Tang, Lee & Kim, *Interactive Hausdorff distance
//! computation for general polygonal models*, SIGGRAPH 2009: the distance to one triangle is a convex function, so that
//! over a triangle it is largest at a corner, and bounds the distance to the other surface.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use serde::Serialize;

use super::BoundaryCheckOptions;
use crate::Point;
use crate::geometry::{SurfaceQuery, closest_point_on_triangle};
use crate::mesh::SurfaceMesh;
use crate::sampling::Collocation;
use crate::statistics::Summary;

/// Distances between image and target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Coverage {
    /// From points of the image to the target: large where the image leaves it.
    pub image_to_target: SurfaceDistance,
    /// From points of the target to the image: large where the target is not covered.
    pub target_to_image: SurfaceDistance,
}

/// Distances of the points of a surface from another, as fractions of the target's diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SurfaceDistance {
    /// Root mean square over samples uniform by area.
    pub rms: f64,
    /// 99th percentile over these samples.
    pub p99: f64,
    /// Lower bound of the largest distance, the one-sided Hausdorff distance.
    pub max: f64,
    /// The largest distance is at most `max + max_error`.
    pub max_error: f64,
}

/// Largest number of distance queries in the search for the largest distance, not counting those at vertices.
const MOST_QUERIES: usize = 100_000;

impl Coverage {
    /// Lower bound of the Hausdorff distance, tight to `max_error`: the larger of both one-sided distances.
    pub fn hausdorff(&self) -> f64 {
        self.image_to_target.max.max(self.target_to_image.max)
    }

    pub(super) fn measure(
        (image, image_query): (&SurfaceMesh, &SurfaceQuery),
        (target, target_query): (&SurfaceMesh, &SurfaceQuery),
        options: &BoundaryCheckOptions,
    ) -> Self {
        let diagonal = target.diagonal();
        let distance = |from: &SurfaceMesh, to: &SurfaceMesh, query: &SurfaceQuery| {
            SurfaceDistance::measure(from, to, query, options, diagonal)
        };
        let (image_to_target, target_to_image) = rayon::join(
            || distance(image, target, target_query),
            || distance(target, image, image_query),
        );
        Self {
            image_to_target,
            target_to_image,
        }
    }
}

impl SurfaceDistance {
    /// The upper bound of the largest distance.
    pub fn most(&self) -> f64 {
        self.max + self.max_error
    }

    fn measure(
        from: &SurfaceMesh,
        to: &SurfaceMesh,
        query: &SurfaceQuery,
        options: &BoundaryCheckOptions,
        diagonal: f64,
    ) -> Self {
        let search = DistanceSearch { from, to, query };
        let (least, most) = search.largest(options.distance_error * diagonal);
        let spread = Collocation::even(from, options.samples, options.seed).points;
        let spread: Vec<Point> = spread.iter().map(|p| p.position(from, from.vertices())).collect();
        let distances: Vec<f64> = query.closest_points(&spread).iter().map(|c| c.distance).collect();
        // A surface without area has no samples.
        let (rms, p99, found) = Summary::of(&distances).map_or((least, least, least), |s| (s.rms, s.p99, s.max));
        let max = least.max(found);
        Self {
            rms: rms / diagonal,
            p99: p99 / diagonal,
            max: max / diagonal,
            max_error: (most - max).max(0.0) / diagonal,
        }
    }
}

/// A point with its distance and the closest triangle.
#[derive(Clone, Copy)]
struct Probe {
    place: Point,
    distance: f64,
    closest: usize,
}

/// A part of a triangle, ordered by the upper bound of its distances, then by `number`.
struct TrianglePart {
    most: f64,
    corners: [Probe; 3],
    /// The other surface's triangle closest to the centroid of the whole triangle. The closest triangles of the corners
    /// may be the wrong ones of several that meet at an edge.
    facing: usize,
    number: usize,
}

struct DistanceSearch<'a> {
    from: &'a SurfaceMesh,
    to: &'a SurfaceMesh,
    query: &'a SurfaceQuery,
}

impl DistanceSearch<'_> {
    /// Bounds of the largest distance, `error` apart unless the queries run out.
    fn largest(&self, error: f64) -> (f64, f64) {
        let used = self.used_vertices();
        let places: Vec<Point> = used.iter().map(|&v| self.from.vertices()[v as usize]).collect();
        let mut probes = vec![None; self.from.vertices().len()];
        for (&v, found) in used.iter().zip(self.query.closest_points(&places)) {
            probes[v as usize] = Some(Probe {
                place: self.from.vertices()[v as usize],
                distance: found.distance,
                closest: found.triangle,
            });
        }
        let mut least = probes.iter().flatten().map(|p| p.distance).fold(0.0, f64::max);
        let corners = self.from.triangles().iter().map(|t| t.map(|v| probes[v as usize]));
        let facing = self.query.closest_points(&self.centroids());
        let whole = corners
            .zip(&facing)
            .enumerate()
            .filter_map(|(number, ([a, b, c], facing))| Some(self.part([a?, b?, c?], facing.triangle, number)));
        let mut parts: BinaryHeap<TrianglePart> = whole.collect();
        for query in 0..MOST_QUERIES {
            match parts.peek() {
                Some(part) if part.most > least + error => {}
                _ => break,
            }
            let Some(part) = parts.pop() else { break };
            let (middle, halves) = self.halved(&part.corners);
            least = least.max(middle.distance);
            let number = self.from.triangles().len() + 2 * query;
            let [first, second] = halves;
            parts.push(self.part(first, part.facing, number));
            parts.push(self.part(second, part.facing, number + 1));
        }
        let most = parts.peek().map_or(least, |part| part.most.max(least));
        (least, most)
    }

    fn used_vertices(&self) -> Vec<u32> {
        let mut used: Vec<u32> = self.from.triangles().iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        used
    }

    fn centroids(&self) -> Vec<Point> {
        let centroid = |t: usize| {
            let [a, b, c] = self.from.corners(t).map(|p| p.coords);
            Point::from((a + b + c) / 3.0)
        };
        (0..self.from.triangles().len()).map(centroid).collect()
    }

    fn part(&self, corners: [Probe; 3], facing: usize, number: usize) -> TrianglePart {
        let to_triangle = |t: usize| {
            let triangle = self.to.corners(t);
            let distance = |p: &Probe| closest_point_on_triangle(&p.place, &triangle).offset.norm();
            corners.iter().map(distance).fold(0.0, f64::max)
        };
        let nearby = corners.iter().map(|p| p.closest).chain([facing]);
        let convex = nearby.map(to_triangle).fold(f64::INFINITY, f64::min);
        // No point of a triangle is farther from its nearest corner than the longest side over √3.
        let sides = (0..3).map(|k| (corners[(k + 1) % 3].place - corners[k].place).norm());
        let longest = sides.fold(0.0, f64::max);
        let farthest = corners.iter().map(|p| p.distance).fold(0.0, f64::max);
        TrianglePart {
            most: convex.min(farthest + longest / 3f64.sqrt()),
            corners,
            facing,
            number,
        }
    }

    /// The midpoint of the longest side, and the two halves.
    fn halved(&self, corners: &[Probe; 3]) -> (Probe, [[Probe; 3]; 2]) {
        let side = |k: usize| (corners[(k + 1) % 3].place - corners[k].place).norm_squared();
        let longest = (0..3).max_by(|&i, &j| side(i).total_cmp(&side(j))).unwrap_or(0);
        let [a, b, c] = [0, 1, 2].map(|k| corners[(longest + k) % 3]);
        let place = nalgebra::center(&a.place, &b.place);
        let found = self.query.closest_point(&place);
        let middle = Probe {
            place,
            distance: found.distance,
            closest: found.triangle,
        };
        (middle, [[a, middle, c], [middle, b, c]])
    }
}

impl Ord for TrianglePart {
    fn cmp(&self, other: &Self) -> Ordering {
        self.most.total_cmp(&other.most).then(other.number.cmp(&self.number))
    }
}

impl PartialOrd for TrianglePart {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for TrianglePart {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for TrianglePart {}
