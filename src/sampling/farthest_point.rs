//! Farthest-point selection: a well-spread subset of the vertices (Gonzalez, *Clustering to minimize the maximum
//! intercluster distance*, Theor. Comput. Sci. 38, 1985). A tree of boxes finds the points that a new choice is nearest
//! to, as in Han et al., *QuickFPS: architecture and algorithms for farthest point sampling in large-scale point
//! clouds*, IEEE TCAD 42, 2023.

use rayon::prelude::*;

use super::SourceSite;
use crate::geometry::Aabb;
use crate::mesh::{SurfaceMesh, lowest_coincident_vertices};
use crate::{Point, Vector};

/// Vertices with a source each, with the area and the outward normal of their neighbourhood.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchors {
    /// Vertex indices: all vertices in order, or a selection in the order of choice, every prefix of which is a coarser
    /// selection.
    pub vertices: Vec<u32>,
    /// Local spacing `h`: the square root of the area that is nearest to each anchor.
    pub spacing: Vec<f64>,
    /// Unit vertex normals, triangles weighted by their angle.
    pub normals: Vec<Vector>,
    /// For each vertex of the surface, the nearest anchor; `None` for vertices that cannot be anchors.
    pub nearest: Vec<Option<u32>>,
}

impl Anchors {
    /// Up to `count` anchors among the vertices of the surface's triangles, well spread. Coincident vertices and
    /// vertices without area are left out.
    ///
    /// For `n` vertices costs time `n log n`, whatever the count, and a third of that when the count is `n` or more.
    pub fn choose(domain: &SurfaceMesh, count: usize) -> Self {
        let (areas, normals) = vertex_areas_and_normals(domain);
        let is_usable = |v: &u32| areas[*v as usize] > 0.0 && normals[*v as usize] != Vector::zeros();
        let usable: Vec<u32> = (0..areas.len() as u32).filter(is_usable).collect();
        let positions: Vec<Point> = usable.iter().map(|&v| domain.vertices()[v as usize]).collect();
        let selection = if count >= usable.len() {
            all_distinct(&positions)
        } else {
            select(&positions, count)
        };
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

    /// The sites of one source per anchor; `domain` is the surface that the anchors were chosen on.
    pub(crate) fn sites(&self, domain: &SurfaceMesh) -> Vec<SourceSite> {
        let site = |k: usize| SourceSite {
            position: domain.vertices()[self.vertices[k] as usize],
            normal: self.normals[k],
            spacing: self.spacing[k],
        };
        (0..self.vertices.len()).map(site).collect()
    }

    /// The anchors at `wanted` vertices, with the spacing that they have here. `nearest` is `None` for vertices whose
    /// anchor is left out.
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

/// All points in order, but only the first of coincident ones.
fn all_distinct(points: &[Point]) -> Selection {
    let mut chosen = Vec::with_capacity(points.len());
    let mut nearest = Vec::with_capacity(points.len());
    for (k, &lowest) in lowest_coincident_vertices(points).iter().enumerate() {
        if lowest as usize == k {
            nearest.push(chosen.len() as u32);
            chosen.push(k);
        } else {
            nearest.push(nearest[lowest as usize]);
        }
    }
    Selection { chosen, nearest }
}

fn select(points: &[Point], count: usize) -> Selection {
    let mut chosen = Vec::with_capacity(count.min(points.len()));
    // Start far from the middle, so that the first point is a tip whatever the order of the points.
    let middle = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / points.len().max(1) as f64);
    let mut next = farthest(points.iter().map(|p| (p - middle).norm_squared()).zip(0..));
    let mut tree = DistanceTree::new(points);
    while chosen.len() < count && (next.0 > 0.0 || (next.0 == 0.0 && chosen.is_empty())) {
        let index = next.1 as usize;
        tree.visit(0, &points[index], chosen.len() as u32);
        chosen.push(index);
        next = tree.farthest();
    }
    Selection {
        chosen,
        nearest: tree.nearest(),
    }
}

/// Points with their distance to the nearest chosen one, in a tree whose nodes store their farthest point. A new choice
/// visits only nodes with points that may be nearer to it: after `k` choices about `n/k` points.
struct DistanceTree {
    nodes: Vec<DistanceNode>,
    /// In the order of the leaves.
    points: Vec<Candidate>,
}

#[derive(Clone, Copy)]
struct Candidate {
    position: Point,
    /// Square of the distance to the nearest chosen point.
    distance: f64,
    /// Index of that one among the chosen.
    nearest: u32,
    index: u32,
}

/// A distance below all others, with no index.
const NOTHING: (f64, u32) = (-1.0, u32::MAX);

struct DistanceNode {
    bounds: Aabb,
    /// The largest squared distance below this node, and the lowest index that has it.
    farthest_point: (f64, u32),
    begin: u32,
    end: u32,
    /// Nodes from this one to its second child; the first child is the next node. 0 in a leaf.
    second: u32,
}

/// Points in a leaf; with fewer, tests of boxes cost more than they save.
const LEAF: usize = 8;

impl DistanceTree {
    fn new(points: &[Point]) -> Self {
        let candidate = |(index, position): (usize, &Point)| Candidate {
            position: *position,
            // Points that are not finite are never chosen.
            distance: if is_finite(position) { f64::INFINITY } else { -1.0 },
            nearest: 0,
            index: index as u32,
        };
        let mut points: Vec<Candidate> = points.iter().enumerate().map(candidate).collect();
        let mut nodes = Vec::with_capacity(4 * points.len() / LEAF + 1);
        if !points.is_empty() {
            build(&mut points, 0, &mut nodes);
        }
        Self { nodes, points }
    }

    /// Squared distance and index of the point farthest from all chosen ones.
    fn farthest(&self) -> (f64, u32) {
        self.nodes.first().map_or(NOTHING, |root| root.farthest_point)
    }

    /// Updates the distances below a node for a new choice at `centre`, which has the index `order` among the chosen.
    fn visit(&mut self, at: usize, centre: &Point, order: u32) {
        let node = &self.nodes[at];
        // Rounding is monotone: where the box is too far, so are its points.
        if node.bounds.distance_squared(centre) >= node.farthest_point.0 {
            return;
        }
        let farthest_point = if node.second == 0 {
            let points = &mut self.points[node.begin as usize..node.end as usize];
            for point in points.iter_mut() {
                let distance = distance_squared(&point.position, centre);
                if distance < point.distance {
                    (point.distance, point.nearest) = (distance, order);
                }
            }
            farthest(points.iter().map(|p| (p.distance, p.index)))
        } else {
            let (first, second) = (at + 1, at + node.second as usize);
            self.visit(first, centre, order);
            self.visit(second, centre, order);
            farther(self.nodes[first].farthest_point, self.nodes[second].farthest_point)
        };
        self.nodes[at].farthest_point = farthest_point;
    }

    fn nearest(self) -> Vec<u32> {
        let mut nearest = vec![0; self.points.len()];
        for point in &self.points {
            nearest[point.index as usize] = point.nearest;
        }
        nearest
    }
}

/// Appends the nodes of the subtree over these points, the first of which is point `begin` of all.
fn build(points: &mut [Candidate], begin: usize, nodes: &mut Vec<DistanceNode>) {
    let bounds = points.iter().fold(Aabb::empty(), |all, p| Aabb {
        low: all.low.inf(&p.position),
        high: all.high.sup(&p.position),
    });
    let root = nodes.len();
    nodes.push(DistanceNode {
        bounds,
        farthest_point: farthest(points.iter().map(|p| (p.distance, p.index))),
        begin: begin as u32,
        end: (begin + points.len()) as u32,
        second: 0,
    });
    if points.len() <= LEAF {
        return;
    }
    let axis = bounds.extent().imax();
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| {
        let along = a.position[axis].total_cmp(&b.position[axis]);
        along.then(a.index.cmp(&b.index))
    });
    let (first, second) = points.split_at_mut(middle);
    build(first, begin, nodes);
    nodes[root].second = (nodes.len() - root) as u32;
    build(second, begin + middle, nodes);
}

fn is_finite(p: &Point) -> bool {
    p.coords.iter().all(|x| x.is_finite())
}

/// In the order of summation of [`Aabb::distance_squared`].
fn distance_squared(p: &Point, q: &Point) -> f64 {
    let (x, y, z) = (p.x - q.x, p.y - q.y, p.z - q.z);
    x * x + y * y + z * z
}

/// The largest distance and the lowest index that has it; [`NOTHING`] when all are NaN.
fn farthest(distances: impl Iterator<Item = (f64, u32)>) -> (f64, u32) {
    distances.fold(NOTHING, farther)
}

fn farther(a: (f64, u32), b: (f64, u32)) -> (f64, u32) {
    if b.0 > a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a }
}

fn vertex_areas_and_normals(domain: &SurfaceMesh) -> (Vec<f64>, Vec<Vector>) {
    let shares: Vec<(f64, [Vector; 3])> = (0..domain.triangles().len())
        .into_par_iter()
        .map(|t| shares_of_corners(domain, t))
        .collect();
    let mut areas = vec![0.0; domain.vertices().len()];
    let mut normals = vec![Vector::zeros(); domain.vertices().len()];
    for (corners, (area, weighted)) in domain.triangles().iter().zip(&shares) {
        for (&vertex, normal) in corners.iter().zip(weighted) {
            areas[vertex as usize] += area / 3.0;
            normals[vertex as usize] += normal;
        }
    }
    normals
        .par_iter_mut()
        .for_each(|n| *n = n.try_normalize(1e-12).unwrap_or_default());
    (areas, normals)
}

/// Area of a triangle, and its unit normal times the angle at each corner. Zeros without area.
fn shares_of_corners(domain: &SurfaceMesh, triangle: usize) -> (f64, [Vector; 3]) {
    let area_vector = domain.area_vector(triangle);
    let Some(normal) = area_vector.try_normalize(0.0) else {
        return Default::default();
    };
    let corners = domain.corners(triangle);
    let weighted = [0, 1, 2].map(|k| {
        let (ahead, behind) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
        normal * ahead.angle(&behind)
    });
    (area_vector.norm(), weighted)
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

    /// The chosen points are at least their covering radius apart, and `k` caps of radius `r` cover the unit sphere
    /// only if `k π r² ≥ 4 π`.
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
            "closest pair {closest}, covering radius at least {covering}"
        );
    }

    /// The plain algorithm: one pass over the points for each choice.
    fn select_by_full_passes(points: &[Point], count: usize) -> (Vec<usize>, Vec<u32>) {
        let mut nearest = vec![(f64::INFINITY, 0u32); points.len()];
        let middle = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64);
        let mut next = farthest(points.iter().map(|p| (p - middle).norm_squared()).zip(0..));
        let mut chosen = Vec::new();
        while chosen.len() < count && (next.0 > 0.0 || chosen.is_empty()) {
            for (best, p) in nearest.iter_mut().zip(points) {
                let d = distance_squared(p, &points[next.1 as usize]);
                if d < best.0 {
                    *best = (d, chosen.len() as u32);
                }
            }
            chosen.push(next.1 as usize);
            next = farthest(nearest.iter().map(|best| best.0).zip(0..));
        }
        (chosen, nearest.into_iter().map(|best| best.1).collect())
    }

    /// A lattice, where most distances are tied, and a ball with vertices crowded at a pole, each of them twice.
    #[test]
    fn the_tree_chooses_the_same_points_as_the_plain_algorithm() {
        let ball = shapes::deformed(&shapes::sphere(1.0, 4), |p| {
            Point::new(p.x, p.y, p.z + 0.9 * (1.0 - p.z * p.z))
        });
        let twice = [ball.vertices(), ball.vertices()].concat();
        for points in [shapes::polycube(&[[0; 3], [1, 0, 0]], 9).vertices(), &twice] {
            for count in [1, 7, 300, points.len()] {
                let selection = select(points, count);
                assert_eq!(
                    (selection.chosen, selection.nearest),
                    select_by_full_passes(points, count)
                );
            }
        }
    }

    #[test]
    fn all_vertices_are_anchors_in_their_order_and_coincident_ones_share_theirs() {
        let (mut vertices, mut triangles) = shapes::cube(1.0, 2).into_parts();
        let count = vertices.len() as u32;
        vertices.push(Point::new(9.0, 9.0, 9.0));
        vertices.push(vertices[3]);
        let corner = triangles.iter_mut().flatten().find(|v| **v == 3).unwrap();
        *corner = count + 1;
        let domain = SurfaceMesh::new(vertices, triangles).unwrap();
        let anchors = Anchors::choose(&domain, usize::MAX);
        assert_eq!(anchors.vertices, (0..count).collect::<Vec<_>>());
        assert_eq!(anchors.nearest[count as usize], None);
        assert_eq!(anchors.nearest[count as usize + 1], Some(3));
        let area: f64 = anchors.spacing.iter().map(|h| h * h).sum();
        assert!((area / 6.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn coincident_points_are_taken_once() {
        let p = Point::new(1.0, 2.0, 3.0);
        assert_eq!(thin(&[p, p, Point::origin(), p], 4), [2, 0]);
        assert!(thin(&[], 4).is_empty());
        assert!(thin(&[p, Point::new(f64::NAN, 0.0, 0.0)], 4).is_empty());
        assert_eq!(thin(&[p; 3], 2), [0]);
    }
}
