//! Relaxation of the boundary where the grid is too coarse for the target or the boundary map distorts much: boundary
//! triangles pass through each other, or cells cannot be repaired while the boundary stays.
//!
//! Patches of cells around such places get the foldover-free energy relative to cells of their own sizes. Their inner
//! nodes are free; their boundary nodes move in the target's tangent planes, held by springs where the boundary map
//! sends them, and are put back on the target after every round. Nodes on creases of the target stay on them.

use std::collections::HashMap;

use rayon::prelude::*;

use super::bounded_mesh::BoundedMesh;
use super::cells_at_nodes::CellsAtNodes;
use super::crossings::crossing_triangles;
use super::foldover::length_or_one;
use super::lbfgs::{Lbfgs, Pull, StoppingRule, TangentConstraint};
use super::own_size::{OwnShape, own_size_energy};
use super::quality::{invalid_cells, inverted_inside};
use super::repair::{Best, DescentCounts, next_epsilon};
use crate::geometry::SurfaceQuery;
use crate::mesh::topology::DisjointSets;
use crate::mesh::{CellList, FEATURE_ANGLE, SurfaceMesh, creases, feature_curves};
use crate::progress::ProgressSender;
use crate::{Point, Vector};

/// Passes: rings of cells around bad places that are relaxed, and how the springs hold. A node that slides by as much as
/// the edges at it are long adds that much to an energy whose cells have a weight of 1 each. In the first pass the boundary
/// stays.
const PASSES: [(usize, f64); 7] = [
    (2, f64::INFINITY),
    (2, 1.0),
    (2, 0.1),
    (3, 0.1),
    (4, 0.1),
    (4, 0.01),
    (6, 0.01),
];
/// Where only boundary triangles count that pass through each other, because the inside is not yet repaired: with softer springs
/// more of them did.
const PASSES_FOR_CROSSINGS: [(usize, f64); 1] = [(2, 1.0)];
/// Iterations before nodes are put back on the target.
const ROUND: StoppingRule = StoppingRule {
    iterations: 20,
    gain: 1e-5,
    until_positive: true,
};
const MAX_ROUNDS: usize = 60;
/// Rounds without fewer faults before a patch is given up.
const MAX_STALLED: usize = 12;
/// How often a pass is repeated as long as it helps.
const MAX_REPEATS: usize = 3;
/// The first ε. With 1 the free boundary would let cells collapse.
const FIRST_EPSILON: f64 = 0.3;
/// Cosine of the angle between the normals at an edge of the target below which it is a crease.
const CREASE: f64 = 0.7;
/// Points that feature curves are represented by, at most, beside one for each edge.
const MOST_POINTS: f64 = 1e5;
/// Barycentric coordinate below which a point of a triangle is on the side across.
const ON_EDGE: f64 = 1e-6;

/// How boundary nodes were relaxed.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RelaxReport {
    /// Boundary nodes that were moved along the target.
    pub nodes: usize,
    /// Rounds of descent in tangent planes and projection to the target, in all patches.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
}

/// The target's surface for relaxation.
pub(super) struct RelaxationSurface<'a> {
    target: &'a SurfaceMesh,
    query: &'a SurfaceQuery,
    /// The edges at which the target has a crease, by their ends.
    creases: Vec<[u32; 2]>,
    /// Directions of the creases from each of their ends.
    at_vertices: HashMap<u32, Vec<Vector>>,
}

/// How a boundary node may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NodeFreedom {
    OnSurface,
    AlongCrease,
    None,
}

impl<'a> RelaxationSurface<'a> {
    pub fn new(target: &'a SurfaceMesh, query: &'a SurfaceQuery) -> Self {
        let creases = creases(target, CREASE);
        let mut at_vertices: HashMap<u32, Vec<Vector>> = HashMap::new();
        for &[a, b] in &creases {
            let along = target.vertices()[b as usize] - target.vertices()[a as usize];
            let along = along.try_normalize(0.0).unwrap_or_else(Vector::zeros);
            at_vertices.entry(a).or_default().push(along);
            at_vertices.entry(b).or_default().push(-along);
        }
        Self {
            target,
            query,
            creases,
            at_vertices,
        }
    }

    /// How a node at a point of the target may move, so that the target's creases and their corners stay.
    pub fn freedom(&self, p: &Point) -> NodeFreedom {
        let found = self.query.closest_point(p);
        let t = self.target.triangles()[found.triangle];
        let near: Vec<u32> = (0..3)
            .filter(|&k| found.barycentric[k] > ON_EDGE)
            .map(|k| t[k])
            .collect();
        match near[..] {
            [vertex] => match self.at_vertices.get(&vertex).map(Vec::as_slice) {
                // A crease that ends here is noise of the surface.
                None | Some([_]) => NodeFreedom::OnSurface,
                Some([a, b]) if a.dot(b) < -CREASE => NodeFreedom::AlongCrease,
                Some(_) => NodeFreedom::None,
            },
            [a, b] if self.creases.binary_search(&[a.min(b), a.max(b)]).is_ok() => NodeFreedom::AlongCrease,
            _ => NodeFreedom::OnSurface,
        }
    }

    /// Points along feature curves ([`feature_curves`]) at most `spacing` apart, each with the length of curve that it stands for.
    pub fn feature_points(&self, spacing: f64, least_length: f64) -> Vec<(Point, f64)> {
        let sharp = creases(self.target, FEATURE_ANGLE.to_radians().cos());
        let curves = feature_curves(self.target, &sharp, least_length);
        let ends_of = |ends: [u32; 2]| ends.map(|v| self.target.vertices()[v as usize]);
        let lengths = curves.iter().map(|ends| {
            let [a, b] = ends_of(*ends);
            (b - a).norm()
        });
        let spacing = spacing.max(lengths.sum::<f64>() / MOST_POINTS);
        let points = curves.into_iter().flat_map(|ends| {
            let [a, b] = ends_of(ends);
            let length = (b - a).norm();
            let count = (length / spacing).ceil().max(1.0);
            (0..count as usize).map(move |k| (a + (b - a) * ((k as f64 + 0.5) / count), length / count))
        });
        points.collect()
    }

    /// The closest point of a crease, and its direction there.
    pub fn closest_on_crease(&self, p: &Point) -> Option<(Point, Vector)> {
        let on_edge = |ends: &[u32; 2]| {
            let [a, b] = ends.map(|v| self.target.vertices()[v as usize]);
            let edge = b - a;
            let along = (edge.dot(&(p - a)) / edge.norm_squared()).clamp(0.0, 1.0);
            (a + edge * along, edge.try_normalize(0.0).unwrap_or_else(Vector::zeros))
        };
        let places = self.creases.iter().map(on_edge);
        places.min_by(|(a, _), (b, _)| (a - p).norm_squared().total_cmp(&(b - p).norm_squared()))
    }

    /// The target's normal where it is closest to a point.
    pub fn normal_near(&self, p: &Point) -> Vector {
        normal(self.target, self.query.closest_point(p).triangle)
    }

    /// Keeps a node in the target's tangent plane, or along its crease, with a spring to its anchor.
    pub fn constraint(&self, glider: &Glider, x: &[Point], anchors: &[Point], stiffness: f64) -> TangentConstraint {
        let p = &x[glider.node];
        let crease = (glider.freedom == NodeFreedom::AlongCrease)
            .then(|| self.closest_on_crease(p))
            .flatten();
        TangentConstraint {
            free: glider.free,
            normal: self.normal_near(p),
            along: crease.map(|(_, along)| along),
            anchor: anchors[glider.node],
            stiffness: stiffness / (glider.edge * glider.edge),
            pull: Pull::none(*p),
        }
    }

    /// Where a node is put back on the target: no farther than an edge from where it was, and where the normal has turned
    /// by an angle of a larger cosine than the given one, so not on the other side of a thin part.
    pub fn put_back(&self, glider: &Glider, from: &Point, to: &Point, least_cosine: f64) -> Point {
        let step = to - from;
        let capped = from + step * (glider.edge / step.norm()).min(1.0);
        if glider.freedom == NodeFreedom::AlongCrease {
            return self.closest_on_crease(&capped).map_or(*from, |(point, _)| point);
        }
        let [old, new] = [from, &capped].map(|p| self.query.closest_point(p));
        let [old, facing] = [old.triangle, new.triangle].map(|t| normal(self.target, t));
        if old.dot(&facing) > least_cosine {
            new.point
        } else {
            *from
        }
    }
}

/// What a relaxation works on.
pub(super) struct Relaxation<'a> {
    pub mesh: &'a BoundedMesh,
    /// Where springs hold boundary nodes.
    pub anchors: &'a [Point],
    pub surface: &'a RelaxationSurface<'a>,
    pub monitor: &'a ProgressSender<'a, (usize, usize)>,
}

/// Cells that are relaxed together.
struct RelaxedPatch {
    /// Nodes of the patch's cells, in the mesh.
    nodes: Vec<u32>,
    /// Free nodes, in the patch.
    free: Vec<u32>,
    /// The patch's cells in the domain.
    cells: BoundedMesh,
}

/// What is wrong with a mesh.
struct Faults {
    /// Invalid cells.
    cells: Vec<u32>,
    /// Pairs of boundary triangles that pass through each other.
    crossings: Vec<[u32; 2]>,
}

impl Faults {
    fn count(&self) -> usize {
        self.cells.len() + self.crossings.len()
    }
}

/// A free boundary node of a patch.
pub(super) struct Glider {
    /// Its index among the free nodes, and in the patch.
    pub free: usize,
    pub node: usize,
    pub freedom: NodeFreedom,
    /// Mean length of the boundary edges at it.
    pub edge: f64,
}

impl Relaxation<'_> {
    /// Relaxes the boundary near the places where its triangles pass through each other and, if `cells` says so, near invalid
    /// cells, until there are none, passes stop helping, or `most_work` is done. No pass adds such places, nor invalid
    /// cells if `cells`. Returns whether any pass helped, and the work that was done.
    pub fn run(&self, x: &mut Vec<Point>, cells: bool, most_work: u64, report: &mut RelaxReport) -> (bool, u64) {
        let faults = |x: &[Point]| Faults {
            cells: match cells {
                true => invalid_cells(&self.mesh.cells, x).cells,
                false => vec![],
            },
            crossings: crossing_triangles(&self.mesh.boundary, x),
        };
        let (start, mut left) = (x.clone(), faults(x));
        let cells_at = CellsAtNodes::new(&self.mesh.cells, self.mesh.nodes.len());
        let (mut any_helped, mut work) = (false, 0);
        let passes = if cells { &PASSES[..] } else { &PASSES_FOR_CROSSINGS };
        for &(rings, stiffness) in passes {
            for _ in 0..MAX_REPEATS {
                if left.count() == 0 || work >= most_work || !self.monitor.should_continue() {
                    break;
                }
                let mut moved = x.clone();
                let counts = self.pass(&cells_at, &mut moved, &left, rings, stiffness);
                report.rounds += counts.rounds;
                report.iterations += counts.iterations;
                work += counts.work;
                let found = faults(&moved);
                let helps = found.count() < left.count()
                    && found.cells.len() <= left.cells.len()
                    && found.crossings.len() <= left.crossings.len();
                if !helps {
                    break;
                }
                (*x, left) = (moved, found);
                any_helped = true;
            }
        }
        let boundary = (0..x.len()).filter(|&v| self.mesh.on_boundary[v]);
        report.nodes = report.nodes.max(boundary.filter(|&v| x[v] != start[v]).count());
        (any_helped, work)
    }

    /// Relaxes the patches within `rings` rings of cells around faults.
    fn pass(
        &self,
        cells_at: &CellsAtNodes,
        x: &mut [Point],
        faults: &Faults,
        rings: usize,
        stiffness: f64,
    ) -> DescentCounts {
        let edge_lengths = self.edge_lengths();
        let patches = self.patches(cells_at, x, faults, rings, stiffness.is_finite());
        let relaxed: Vec<(Vec<Point>, usize, usize)> = patches
            .par_iter()
            .with_max_len(1)
            .map(|(patch, freedoms)| self.relax_patch(patch, freedoms, x, &edge_lengths, stiffness))
            .collect();
        let mut counts = DescentCounts::default();
        for ((patch, _), (nodes, rounds, iterations)) in patches.iter().zip(relaxed) {
            for &v in &patch.free {
                x[patch.nodes[v as usize] as usize] = nodes[v as usize];
            }
            counts.add(rounds, iterations, patch.cells.cells.len());
        }
        counts
    }

    /// The connected parts of the cells at nodes near the given ones, with the freedom of each free node.
    fn patches(
        &self,
        cells_at: &CellsAtNodes,
        x: &[Point],
        faults: &Faults,
        rings: usize,
        slides: bool,
    ) -> Vec<(RelaxedPatch, Vec<NodeFreedom>)> {
        let mesh = self.mesh;
        let unique = |ids: &mut Vec<u32>| {
            ids.sort_unstable();
            ids.dedup();
        };
        let cells_of = |nodes: &[u32]| {
            let mut cells: Vec<u32> = nodes.iter().flat_map(|&v| cells_at.of(v)).copied().collect();
            unique(&mut cells);
            cells
        };
        let corners = |t: &u32| mesh.boundary[*t as usize];
        let mut near: Vec<u32> = faults.crossings.as_flattened().iter().flat_map(corners).collect();
        near.extend(faults.cells.iter().flat_map(|&c| mesh.cells.corners(c as usize)));
        unique(&mut near);
        for _ in 1..rings {
            let cells = cells_of(&near);
            near = cells
                .iter()
                .flat_map(|&c| mesh.cells.corners(c as usize))
                .copied()
                .collect();
            unique(&mut near);
        }
        let freedom = |&v: &u32| match mesh.on_boundary[v as usize] {
            true if !slides || x[v as usize].iter().any(|x| !x.is_finite()) => NodeFreedom::None,
            true => self.surface.freedom(&x[v as usize]),
            false => NodeFreedom::OnSurface,
        };
        let freedoms: Vec<NodeFreedom> = near.par_iter().map(freedom).collect();
        let free = near
            .iter()
            .zip(&freedoms)
            .filter(|(_, freedom)| **freedom != NodeFreedom::None);
        let (near, freedoms): (Vec<u32>, Vec<NodeFreedom>) = free.map(|(v, freedom)| (*v, *freedom)).unzip();
        let cells = cells_of(&near);
        let position = |v: &u32| near.binary_search(v).ok().map(|k| k as u32);
        let mut sets = DisjointSets::new(near.len());
        for &cell in &cells {
            let mut free = mesh.cells.corners(cell as usize).iter().filter_map(position);
            if let Some(first) = free.next() {
                free.for_each(|other| sets.unite(first, other));
            }
        }
        // Triangles that pass through each other are relaxed together.
        for pair in &faults.crossings {
            let mut free = pair.iter().flat_map(corners).filter_map(|v| position(&v));
            if let Some(first) = free.next() {
                free.for_each(|other| sets.unite(first, other));
            }
        }
        let mut parts: Vec<(u32, Vec<u32>)> = Vec::new();
        let mut part_of_root: HashMap<u32, usize> = HashMap::new();
        for cell in cells {
            let first = mesh.cells.corners(cell as usize).iter().find_map(position);
            let Some(root) = first.map(|k| sets.find(k)) else {
                continue;
            };
            let part = *part_of_root.entry(root).or_insert_with(|| {
                parts.push((root, Vec::new()));
                parts.len() - 1
            });
            parts[part].1.push(cell);
        }
        let patch = |(_, cells): (u32, Vec<u32>)| {
            let corners = cells.iter().flat_map(|&c| mesh.cells.corners(c as usize));
            let mut nodes: Vec<u32> = corners.copied().collect();
            unique(&mut nodes);
            let number = |v: u32| nodes.binary_search(&v).unwrap_or_default() as u32;
            let (free, freedoms) = (0..nodes.len() as u32)
                .filter_map(|k| Some((k, freedoms[position(&nodes[k as usize])? as usize])))
                .unzip();
            let cells = match &mesh.cells {
                CellList::Tets(tets) => CellList::Tets(cells.iter().map(|&c| tets[c as usize].map(number)).collect()),
                CellList::Hexes(hexes) => {
                    CellList::Hexes(cells.iter().map(|&c| hexes[c as usize].map(number)).collect())
                }
            };
            let in_domain = nodes.iter().map(|&v| mesh.nodes[v as usize]).collect();
            let on_boundary = nodes.iter().map(|&v| mesh.on_boundary[v as usize]).collect();
            let local = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| nodes.binary_search(&v).ok().map(|k| k as u32));
                Some([a?, b?, c?])
            };
            let boundary = mesh.boundary.iter().filter_map(local).collect();
            let cells = BoundedMesh {
                nodes: in_domain,
                cells,
                on_boundary,
                boundary,
                regions: vec![],
                parts: vec![],
                part_names: vec![],
            };
            (RelaxedPatch { nodes, free, cells }, freedoms)
        };
        parts.into_iter().map(patch).collect()
    }

    /// Relaxes one patch; returns the positions of its nodes with the fewest invalid cells, and the rounds and iterations.
    fn relax_patch(
        &self,
        patch: &RelaxedPatch,
        freedoms: &[NodeFreedom],
        x: &[Point],
        edge_lengths: &HashMap<u32, f64>,
        stiffness: f64,
    ) -> (Vec<Point>, usize, usize) {
        let mut own: Vec<Point> = patch.nodes.iter().map(|&v| x[v as usize]).collect();
        let anchors: Vec<Point> = patch.nodes.iter().map(|&v| self.anchors[v as usize]).collect();
        let gliders = patch.free.iter().enumerate().zip(freedoms);
        let gliders = gliders.filter(|((_, v), _)| patch.cells.on_boundary[**v as usize]);
        let gliders: Vec<Glider> = gliders
            .map(|((free, &v), &freedom)| Glider {
                free,
                node: v as usize,
                freedom,
                edge: edge_lengths.get(&patch.nodes[v as usize]).copied().unwrap_or(1.0),
            })
            .collect();
        let stiffness = stiffness / patch.cells.cells.len() as f64;
        let mut energy = own_size_energy(&patch.cells, &own, OwnShape::Regular, None);
        let faults = |x: &[Point]| {
            [
                invalid_cells(&patch.cells.cells, x).cells.len(),
                crossing_triangles(&patch.cells.boundary, x).len(),
            ]
        };
        let [cells, mut crossings] = faults(&own);
        let mut best = Best::new(cells + crossings, &own);
        let (mut rounds, mut iterations, mut epsilon) = (0, 0, FIRST_EPSILON);
        let mut is_hidden = false;
        while rounds < MAX_ROUNDS && self.monitor.should_continue() {
            if best.inverted == 0 || best.stalled >= MAX_STALLED {
                break;
            }
            let constraints = gliders
                .iter()
                .map(|glider| self.surface.constraint(glider, &own, &anchors, stiffness));
            let constraints = constraints.collect();
            let before = own.clone();
            let mut descent = Lbfgs::new(&energy, &patch.free, 1.0, self.monitor);
            descent.has_block_preconditioner = true;
            descent.constraints = constraints;
            let rule = StoppingRule {
                until_positive: crossings == 0 && !is_hidden,
                ..ROUND
            };
            let (value, made) = descent.run(&mut own, epsilon, &rule);
            rounds += 1;
            iterations += made;
            if !value.energy.is_finite() {
                break;
            }
            for glider in &gliders {
                let v = glider.node;
                own[v] = self.surface.put_back(glider, &before[v], &own[v], 0.0);
            }
            epsilon = next_epsilon(epsilon, value.least);
            let cells;
            [cells, crossings] = faults(&own);
            best.update(cells + crossings, &own);
            if cells > 0 && energy.inverted(&own).is_empty() {
                energy.check_inside(&inverted_inside(&patch.cells.cells, &own));
                // Hexahedra that are positive at all samples, and not between them, have to get better still.
                is_hidden = energy.inverted(&own).is_empty();
            } else {
                is_hidden = false;
            }
        }
        (best.nodes, rounds, iterations)
    }

    /// Mean length of the boundary triangles' sides at each boundary node, where the boundary map sends them.
    fn edge_lengths(&self) -> HashMap<u32, f64> {
        let mut sums: HashMap<u32, (f64, f64)> = HashMap::new();
        for ends in self.mesh.boundary.iter().flat_map(|t| edges(*t)) {
            let length = (self.anchors[ends[0] as usize] - self.anchors[ends[1] as usize]).norm();
            for v in ends {
                let sum = sums.entry(v).or_default();
                *sum = (sum.0 + length, sum.1 + 1.0);
            }
        }
        let mean = |(v, (sum, count)): (u32, (f64, f64))| (v, length_or_one(sum / count));
        sums.into_iter().map(mean).collect()
    }
}

fn normal(surface: &SurfaceMesh, triangle: usize) -> Vector {
    surface
        .area_vector(triangle)
        .try_normalize(0.0)
        .unwrap_or_else(Vector::zeros)
}

fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn nodes_stay_on_creases_and_corners_of_the_target() {
        let cube = shapes::cube(2.0, 4);
        let query = SurfaceQuery::new(&cube).unwrap();
        let surface = RelaxationSurface::new(&cube, &query);
        let (low, high) = cube.bounding_box().unwrap();
        let side = high.x - low.x;
        for (at, freedom) in [
            ([0.31, 0.42, 1.0], NodeFreedom::OnSurface),
            ([0.25, 0.5, 1.0], NodeFreedom::OnSurface),
            ([0.31, 1.0, 1.0], NodeFreedom::AlongCrease),
            ([0.5, 0.0, 1.0], NodeFreedom::AlongCrease),
            ([1.0, 0.0, 1.0], NodeFreedom::None),
        ] {
            let p = low + Vector::from(at) * side;
            assert_eq!(surface.freedom(&p), freedom, "{at:?}");
        }
        let (on, along) = surface
            .closest_on_crease(&(low + Vector::new(0.31, 0.9, 0.99) * side))
            .unwrap();
        assert!((on - (low + Vector::new(0.31, 1.0, 1.0) * side)).norm() < 1e-12);
        assert_eq!(along.x.abs(), 1.0);
    }
}
