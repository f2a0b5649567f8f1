//! Improvement of hexahedra in which boundary nodes slide on the target: first all cells, then patches around those with
//! the lowest scaled Jacobians, which get an energy in which their worst corners dominate.
//!
//! Many of the lowest cells lie at the boundary, where no position of inner nodes makes them better: the boundary map
//! shears their quads or makes them flat.

use std::sync::Arc;

use rayon::prelude::*;

use super::bounded_mesh::BoundedMesh;
use super::cells_at_nodes::CellsAtNodes;
use super::crossings::crossing_triangles;
use super::foldover::length_or_one;
use super::hex_corners::CornerPenalty;
use super::lbfgs::{Lbfgs, Pull, StoppingRule, TangentConstraint};
use super::own_size::{HEX_EDGES, OwnShape, own_size_energy};
use super::polish::{Floor, PolishReport};
use super::quality::{invalid_cells, is_positive, lesser, scaled_jacobians};
use super::relax::{Glider, NodeFreedom, RelaxationSurface};
use super::slide::SlidingSurface;
use crate::geometry::{ClosestPoint, SurfaceQuery};
use crate::mesh::topology::DisjointSets;
use crate::mesh::{CellList, SurfaceMesh};
use crate::progress::ProgressSender;
use crate::{Point, Vector};

/// ε of the descents: a step that inverts a corner costs more than any gain.
const EPSILON: f64 = 1e-9;
/// Iterations of a round, after which sliding nodes are put back on the target, and largest number of rounds of the
/// improvement of all cells and of a patch.
const ROUND: usize = 20;
const MAX_ROUNDS: usize = 6;
const GAIN: f64 = 1e-5;
/// Stiffness of the springs to where the boundary map sends nodes, and of the pulls to the target's vertices, in the
/// improvement of all cells. A node that slides by as much as the edges at it are long adds the first to an energy whose
/// cells have a weight of 1 each; vertices that are left at that distance from the boundary add the second.
const STIFFNESS: f64 = 1.0;
const FIT: f64 = 100.0;
/// Stiffness of the pulls in further attempts, which are made where the boundary gets farther from the target or a scaled Jacobian stays
/// below this.
const STIFF: f64 = 3.0 * FIT;
const STIFFEST: f64 = 10.0 * FIT;
const GOOD_ENOUGH: f64 = 0.3;
/// Passes over patches: the scaled Jacobian below which cells get one, as long as there are any, and how often all passes
/// are made.
const BOUNDS: [f64; 5] = [0.1, 0.2, 0.3, 0.45, 0.6];
const REPEATS: usize = 2;
/// A pass takes cells at least this far above the lowest.
const ABOVE_LOWEST: f64 = 0.05;
/// Rings of cells around the low ones whose nodes move.
const RINGS: usize = 2;
/// The corners of a patch are raised this far above the bound of the pass.
const MARGIN: f64 = 0.1;
const PENALTY: f64 = 1000.0;
/// The springs of a patch are soft, since it is small.
const PATCH_STIFFNESS: f64 = 0.01;
/// Largest number of rounds of a patch, and of those in a row that it bears although they leave more than this of its shortfall: where the
/// target is curved, nodes that are put back on it may make a round worse, and the next one better.
const PATCH_ROUNDS: usize = 9;
const MAX_STALLED: usize = 2;
const MAX_SHORTFALL_RATIO: f64 = 0.98;
/// Cosine of the angle by which the target's normal at a node may turn in a round: nodes do not slide over creases.
const MAX_TURN: f64 = 0.7;
/// Largest ratio of the boundary's mean and largest distance from the target's vertices to those before.
const MAX_MEAN_RATIO: f64 = 1.1;
const MAX_LARGEST_RATIO: f64 = 1.5;
/// Distances below this fraction of the mean edge are rounding errors, or as good.
const NO_DISTANCE: f64 = 1e-3;
/// Least length of the edges at a node that counts, as a fraction of the mean of all: where the boundary map makes quads flat,
/// nodes have to get away.
const LEAST_EDGE: f64 = 0.1;
/// Vertices of the target for each triangle of the boundary that the boundary is compared with: of finer targets only some.
const VERTICES_PER_TRIANGLE: usize = 4;
/// Least length of feature curves that pull the boundary to them, in mean edges, and how much more they pull than the vertices of a
/// strip of that width. With 1 they stayed twice as far away; with 100 single cells got worse.
const LEAST_FEATURE: f64 = 10.0;
const FEATURE_WEIGHT: f64 = 10.0;

/// The polish of hexahedra.
pub(super) struct HexPolish<'a> {
    mesh: &'a BoundedMesh,
    /// Where springs hold boundary nodes.
    anchors: &'a [Point],
    /// The surface that boundary nodes slide on, if they may.
    surface: Option<RelaxationSurface<'a>>,
    /// What cells are to be like.
    shape: OwnShape,
    /// Vertices of that surface and points of its feature curves that the boundary is compared with, and their areas.
    vertices: Vec<(Point, f64)>,
    /// How many of them are vertices; the points of feature curves follow.
    without_features: usize,
    /// Mean length of the boundary edges at each node; 1 for other nodes.
    edges: Vec<f64>,
    /// The mean over these nodes.
    edge: f64,
    /// Largest number of iterations of each pass over the whole mesh, and of all passes over patches together.
    iterations: usize,
    monitor: &'a ProgressSender<'a, (usize, usize)>,
}

/// How cells are improved.
#[derive(Debug, Clone, Copy)]
struct Improvement {
    rounds: usize,
    /// What low corners cost in addition.
    penalty: Option<CornerPenalty>,
    stiffness: f64,
}

/// One way to improve a mesh.
#[derive(Debug, Clone, Copy)]
struct Attempt {
    /// Whether all cells are improved first, or only the lowest.
    all: bool,
    /// Stiffness of the pulls.
    fit: f64,
    /// Whether no patch may get more boundary triangles that face away from the target.
    keeps_facing: bool,
}

impl Attempt {
    const fn new(all: bool, fit: f64, keeps_facing: bool) -> Self {
        Self { all, fit, keeps_facing }
    }
}

/// What is tried where boundary nodes slide, and where they do not.
const SLIDING: [Attempt; 5] = [
    Attempt::new(true, FIT, false),
    Attempt::new(true, FIT, true),
    Attempt::new(true, STIFF, true),
    Attempt::new(true, STIFFEST, true),
    Attempt::new(false, STIFFEST, true),
];
const FIXED: [Attempt; 2] = [Attempt::new(true, 0.0, false), Attempt::new(false, 0.0, false)];

/// Cells that are improved together.
struct Patch {
    /// Nodes of the patch's cells, in the mesh, ascending.
    nodes: Vec<u32>,
    /// Free nodes, in the patch.
    free: Vec<u32>,
    freedoms: Vec<NodeFreedom>,
    cells: BoundedMesh,
}

/// What of a patch may not get worse.
struct PatchMeasure {
    invalid: usize,
    /// Triangles of the boundary that face away from the target ([`BoundaryState::turned`]), where that counts.
    turned: usize,
    least: f64,
    /// Cells below each of two bounds.
    below: [usize; 2],
    /// Sum of squares by which cells are below the bound that they are raised to.
    shortfall: f64,
}

/// What of the boundary may not get worse.
#[derive(Debug, Clone, Copy)]
struct BoundaryState {
    /// Pairs of triangles that pass through each other.
    crossings: usize,
    /// Triangles that face away from the target where they are closest to it.
    turned: usize,
    /// Distances from the target's vertices: the mean by areas, and the largest.
    distances: [f64; 2],
}

impl BoundaryState {
    /// Written so that NaN is worse.
    fn is_no_worse_than(&self, before: &Self, edge: f64) -> bool {
        let [mean, largest] = self.distances.map(|distance| distance - NO_DISTANCE * edge);
        self.crossings <= before.crossings
            && self.turned <= before.turned
            && mean <= MAX_MEAN_RATIO * before.distances[0]
            && largest <= MAX_LARGEST_RATIO * before.distances[1]
    }
}

impl<'a> HexPolish<'a> {
    pub fn new(
        mesh: &'a BoundedMesh,
        anchors: &'a [Point],
        surface: Option<&'a SlidingSurface<'a>>,
        shape: OwnShape,
        iterations: usize,
        monitor: &'a ProgressSender<'a, (usize, usize)>,
    ) -> Self {
        let vertices = surface.map(|surface| {
            let areas = surface.target.vertex_areas();
            let used = surface.target.vertices().iter().copied().zip(areas);
            let used: Vec<(Point, f64)> = used.filter(|(_, area)| *area > 0.0).collect();
            let every = used
                .len()
                .div_ceil(VERTICES_PER_TRIANGLE * mesh.boundary.len().max(1))
                .max(1);
            let some = used.into_iter().step_by(every);
            some.map(|(p, area)| (p, area * every as f64)).collect()
        });
        let (edges, edge) = mean_edges(mesh, anchors);
        let surface = surface.map(|surface| RelaxationSurface::new(surface.target, &surface.query));
        let mut vertices: Vec<(Point, f64)> = vertices.unwrap_or_default();
        let without_features = vertices.len();
        if let Some(surface) = &surface {
            let points = surface.feature_points(0.5 * edge, LEAST_FEATURE * edge);
            let of_strip = |(p, length): (Point, f64)| (p, FEATURE_WEIGHT * length * edge);
            vertices.extend(points.into_iter().map(of_strip));
        }
        Self {
            mesh,
            anchors,
            edges,
            edge,
            shape,
            surface,
            vertices,
            without_features,
            iterations,
            monitor,
        }
    }

    /// Does without the points of feature curves from now on; whether there were any.
    pub fn leave_features(&mut self) -> bool {
        let had_some = self.vertices.len() > self.without_features;
        self.vertices.truncate(self.without_features);
        had_some
    }

    /// Improves all cells and then the lowest. Keeps that if neither more cells are invalid nor the least scaled Jacobian
    /// or its 1 % quantile is lower, and the boundary is not farther from the target. Where that is not so, or cells stay low, holds the
    /// boundary closer to the target, or improves only the lowest cells, and keeps the best.
    pub fn run(&self, x: &mut [Point], report: &mut PolishReport) {
        let floor = Floor::of(self.mesh, x);
        let boundary = self.boundary(x);
        let attempts = match self.surface {
            Some(_) => &SLIDING[..],
            None => &FIXED,
        };
        let mut best: Option<(Floor, Vec<Point>)> = None;
        // All cells improved, the stiffness of the pulls, and the iterations that it took.
        let mut improved: Option<(Vec<Point>, f64, usize)> = None;
        for attempt in attempts {
            if !self.monitor.should_continue() || (best.is_some() && !attempt.all) {
                break;
            }
            let (mut moved, of_all) = match improved.take_if(|(_, fit, _)| attempt.all && *fit == attempt.fit) {
                Some((moved, _, made)) => (moved, made),
                None => {
                    let mut moved = x.to_vec();
                    let made = if attempt.all {
                        self.improve_all(&mut moved, attempt.fit)
                    } else {
                        0
                    };
                    report.iterations += made;
                    improved = Some((moved.clone(), attempt.fit, made));
                    (moved, made)
                }
            };
            let of_lowest = self.raise_lowest(&mut moved, attempt);
            report.iterations += of_lowest;
            let is_sound = match (boundary, self.boundary(&moved)) {
                (Some(before), Some(found)) => found.is_no_worse_than(&before, self.edge),
                (None, _) => true,
                (Some(_), None) => false,
            };
            let is_moved = moved.as_slice() != x;
            let Some(found) = floor.raised(self.mesh, &moved).filter(|_| is_moved && is_sound) else {
                continue;
            };
            if best.as_ref().is_none_or(|(best, _)| found.rating() > best.rating()) {
                report.kept_iterations = of_all + of_lowest;
                best = Some((found, moved));
            }
            // A boundary that is fixed is as close as it was.
            if found.least >= GOOD_ENOUGH || self.surface.is_none() {
                break;
            }
        }
        if let Some((_, found)) = best {
            x.copy_from_slice(&found);
        }
    }

    /// Improves all cells; returns the iterations made.
    fn improve_all(&self, x: &mut [Point], fit: f64) -> usize {
        let improvement = Improvement {
            rounds: MAX_ROUNDS.min(self.iterations.div_ceil(ROUND)),
            penalty: None,
            stiffness: STIFFNESS,
        };
        let at_nodes = CellsAtNodes::new(&self.mesh.cells, self.mesh.nodes.len());
        let cells: Vec<u32> = (0..self.mesh.cells.len() as u32).collect();
        let mut total = 0;
        // More than one for a solid of several parts.
        for patch in self.patches(&at_nodes, x, &cells, 0) {
            let mut own = patch.of(x);
            let mut all = x.to_vec();
            let mut pulls = |own: &[Point]| {
                patch.put(own, &mut all);
                self.pulls(&all, fit).into()
            };
            total += self.improve(&patch, &mut own, &mut pulls, &improvement, &mut |_| true);
            patch.put(&own, x);
        }
        total
    }

    /// Raises the lowest cells in patches of their own, pass after pass; returns the iterations made, each counted for the
    /// part of the cells that took part.
    fn raise_lowest(&self, x: &mut [Point], attempt: &Attempt) -> usize {
        let (mut work, cells) = (0, self.mesh.cells.len());
        for bound in BOUNDS.repeat(REPEATS) {
            if !self.monitor.should_continue() || work >= self.iterations * cells {
                break;
            }
            let scaled = scaled_jacobians(&self.mesh.cells, x);
            let least = scaled.iter().copied().fold(f64::INFINITY, lesser);
            let bound = bound.max(least + ABOVE_LOWEST);
            let low: Vec<u32> = (0..)
                .zip(&scaled)
                .filter(|(_, s)| **s < bound)
                .map(|(cell, _)| cell)
                .collect();
            work += self.raise_patches(x, &low, &scaled, bound, attempt);
        }
        work.div_ceil(cells.max(1))
    }

    /// Raises patches around the cells `low`. Keeps of each patch the last positions in which it has no more invalid cells or
    /// turned triangles, its least scaled Jacobian is no lower, no more of its cells are below the 1 % quantile of the mesh, and its
    /// shortfall is less. Returns iterations times cells.
    fn raise_patches(&self, x: &mut [Point], low: &[u32], scaled: &[f64], bound: f64, attempt: &Attempt) -> usize {
        let at_nodes = CellsAtNodes::new(&self.mesh.cells, self.mesh.nodes.len());
        let mut ascending = scaled.to_vec();
        ascending.sort_unstable_by(f64::total_cmp);
        // The quantile is between these two.
        let last = ascending.len().saturating_sub(1);
        let rank = last / 100;
        let Some(bounds) = ascending.get(rank).zip(ascending.get((rank + 1).min(last))) else {
            return 0;
        };
        let bounds = [*bounds.0, *bounds.1];
        let improvement = Improvement {
            rounds: PATCH_ROUNDS.min(self.iterations.div_ceil(ROUND)),
            penalty: Some(CornerPenalty {
                bound: bound + MARGIN,
                weight: PENALTY,
            }),
            stiffness: PATCH_STIFFNESS,
        };
        let pulls: Arc<[Pull]> = self.pulls(x, attempt.fit).into();
        let facing = self.surface.as_ref().filter(|_| attempt.keeps_facing);
        let raise = |patch: &Patch| {
            let mut own = patch.of(x);
            let mut kept = own.clone();
            let measure = |at: &[Point]| PatchMeasure::of(&patch.cells, at, facing, bounds, bound + MARGIN);
            let mut best = measure(&own);
            let mut keep = |at: &[Point]| {
                let found = measure(at);
                let is_better = found.is_better_than(&best);
                let helps = is_better && found.shortfall < MAX_SHORTFALL_RATIO * best.shortfall;
                if is_better {
                    kept.copy_from_slice(at);
                    best = found;
                }
                helps
            };
            let iterations = self.improve(patch, &mut own, &mut |_| pulls.clone(), &improvement, &mut keep);
            (kept, iterations)
        };
        let patches = self.patches(&at_nodes, x, low, RINGS);
        let raised: Vec<(Vec<Point>, usize)> = patches.par_iter().with_max_len(1).map(raise).collect();
        let mut work = 0;
        for (patch, (kept, iterations)) in patches.iter().zip(raised) {
            patch.put(&kept, x);
            work += iterations * patch.cells.cells.len();
        }
        work
    }

    /// Rounds of descent; `pulls` says before each what pulls the nodes of the mesh, `keep` sees the patch's positions after
    /// it, and says whether it helped. No cell becomes invalid. Returns the iterations made.
    fn improve(
        &self,
        patch: &Patch,
        own: &mut Vec<Point>,
        pulls: &mut dyn FnMut(&[Point]) -> Arc<[Pull]>,
        improvement: &Improvement,
        keep: &mut dyn FnMut(&[Point]) -> bool,
    ) -> usize {
        let mesh = &patch.cells;
        let sliding = patch.free.iter().enumerate().zip(&patch.freedoms);
        let gliders: Vec<Glider> = sliding
            .filter(|((_, v), _)| mesh.on_boundary[**v as usize])
            .map(|((free, &v), &freedom)| Glider {
                free,
                node: v as usize,
                freedom,
                edge: self.edges[patch.nodes[v as usize] as usize],
            })
            .collect();
        let anchors = patch.of(self.anchors);
        let part = 1.0 / mesh.cells.len() as f64;
        let rule = StoppingRule {
            iterations: ROUND,
            gain: GAIN,
            until_positive: false,
        };
        let invalid = invalid_cells(&mesh.cells, own).cells;
        let (mut total, mut stalled) = (0, 0);
        // Of the planes that boundary nodes move in, where these are not the target's where the nodes are.
        let mut normals: Vec<Option<Vector>> = vec![None; gliders.len()];
        for _ in 0..improvement.rounds {
            if !self.monitor.should_continue() {
                break;
            }
            let mut energy = own_size_energy(mesh, own, self.shape, None);
            if let Some(penalty) = improvement.penalty {
                energy.penalize(penalty);
            }
            let before = own.clone();
            let mut descent = Lbfgs::new(&energy, &patch.free, 1.0, self.monitor);
            descent.has_block_preconditioner = true;
            if let Some(surface) = &self.surface {
                let pulls = pulls(own);
                let constraint = |(glider, normal): (&Glider, &Option<Vector>)| {
                    let found = surface.constraint(glider, own, &anchors, improvement.stiffness * part);
                    TangentConstraint {
                        pull: pulls[patch.nodes[glider.node] as usize] * part,
                        normal: normal.unwrap_or(found.normal),
                        ..found
                    }
                };
                descent.constraints = gliders.par_iter().zip(&normals).map(constraint).collect();
            }
            let (value, iterations) = descent.run(own, EPSILON, &rule);
            total += iterations;
            if !value.energy.is_finite() {
                own.clone_from(&before);
                break;
            }
            let headings = self.put_on_target(mesh, &gliders, &invalid, &before, own);
            // If neither plane helps, the first again.
            for (normal, heading) in normals.iter_mut().zip(headings) {
                *normal = normal.xor(heading);
            }
            stalled = if keep(own) { 0 } else { stalled + 1 };
            if stalled > MAX_STALLED || iterations == 0 {
                break;
            }
        }
        total
    }

    /// Puts boundary nodes back on the target, and where that makes cells invalid, moves all nodes of these cells half as far,
    /// again and again, and in the end not at all. Returns for each boundary node that went less far the target's normal
    /// where it was headed: a node on an edge of the target leaves it in the plane of either triangle, and if that is
    /// not the one it gets to, it is taken off its way even by a short step.
    fn put_on_target(
        &self,
        mesh: &BoundedMesh,
        gliders: &[Glider],
        invalid: &[u32],
        before: &[Point],
        x: &mut [Point],
    ) -> Vec<Option<Vector>> {
        /// How often a step is halved, and more turns than a good step needs.
        const HALVINGS: usize = 5;
        const MAX_TURNS: usize = 25;
        let headed = x.to_vec();
        let mut glider_of: Vec<Option<&Glider>> = vec![None; x.len()];
        gliders.iter().for_each(|glider| glider_of[glider.node] = Some(glider));
        let placed = |v: usize, part: f64| {
            let to = before[v] + (headed[v] - before[v]) * part;
            match (glider_of[v], &self.surface) {
                (Some(glider), Some(surface)) => surface.put_back(glider, &before[v], &to, MAX_TURN),
                _ => to,
            }
        };
        let on_target: Vec<Point> = gliders.par_iter().map(|glider| placed(glider.node, 1.0)).collect();
        gliders.iter().zip(on_target).for_each(|(glider, p)| x[glider.node] = p);
        let lost = |x: &[Point]| {
            let mut cells = invalid_cells(&mesh.cells, x).cells;
            cells.retain(|cell| invalid.binary_search(cell).is_err());
            let corners = cells.iter().flat_map(|&cell| mesh.cells.corners(cell as usize));
            let mut nodes: Vec<u32> = corners.copied().collect();
            nodes.sort_unstable();
            nodes.dedup();
            nodes
        };
        let mut parts = vec![1.0; x.len()];
        for turn in 0..=MAX_TURNS {
            let nodes = lost(x);
            if nodes.is_empty() {
                break;
            }
            if turn == MAX_TURNS {
                x.copy_from_slice(before);
                break;
            }
            for v in nodes.into_iter().map(|v| v as usize) {
                parts[v] *= 0.5;
                x[v] = match turn < HALVINGS {
                    true => placed(v, parts[v]),
                    false => before[v],
                };
            }
        }
        let heading = |glider: &Glider| {
            let surface = self.surface.as_ref().filter(|_| parts[glider.node] < 1.0)?;
            Some(surface.normal_near(&headed[glider.node]))
        };
        gliders.iter().map(heading).collect()
    }

    /// The connected parts of the cells with free nodes within `rings` rings around the cells `low`.
    fn patches(&self, at_nodes: &CellsAtNodes, x: &[Point], low: &[u32], rings: usize) -> Vec<Patch> {
        let mesh = self.mesh;
        let CellList::Hexes(hexes) = &mesh.cells else {
            return vec![];
        };
        let unique = |mut ids: Vec<u32>| {
            ids.sort_unstable();
            ids.dedup();
            ids
        };
        let cells_of = |nodes: &[u32]| unique(nodes.iter().flat_map(|&v| at_nodes.of(v)).copied().collect());
        let nodes_of = |cells: &[u32]| unique(cells.iter().flat_map(|&c| hexes[c as usize]).collect());
        let mut near = nodes_of(low);
        for _ in 0..rings {
            near = nodes_of(&cells_of(&near));
        }
        let freedom = |&v: &u32| match (mesh.on_boundary[v as usize], &self.surface) {
            (false, _) => NodeFreedom::OnSurface,
            (true, Some(surface)) if x[v as usize].iter().all(|x| x.is_finite()) => surface.freedom(&x[v as usize]),
            _ => NodeFreedom::None,
        };
        let freedoms: Vec<NodeFreedom> = near.par_iter().map(freedom).collect();
        let free = near.into_iter().zip(freedoms);
        let (near, freedoms): (Vec<u32>, Vec<NodeFreedom>) =
            free.filter(|(_, freedom)| *freedom != NodeFreedom::None).unzip();
        let mut position = vec![u32::MAX; mesh.nodes.len()];
        near.iter().zip(0..).for_each(|(&v, k)| position[v as usize] = k);
        let free_of = |cell: u32| {
            let places = hexes[cell as usize].map(|v| position[v as usize]);
            places.into_iter().filter(|&k| k != u32::MAX)
        };
        let mut sets = DisjointSets::new(near.len());
        let cells = cells_of(&near);
        for &cell in &cells {
            let mut free = free_of(cell);
            if let Some(first) = free.next() {
                free.for_each(|other| sets.unite(first, other));
            }
        }
        let mut part_of_root = vec![usize::MAX; near.len()];
        let mut parts: Vec<Vec<u32>> = Vec::new();
        for cell in cells {
            let Some(first) = free_of(cell).next() else { continue };
            let part = &mut part_of_root[sets.find(first) as usize];
            if *part == usize::MAX {
                *part = parts.len();
                parts.push(Vec::new());
            }
            parts[*part].push(cell);
        }
        let mut boundaries: Vec<Vec<[u32; 3]>> = vec![vec![]; parts.len()];
        for corners in &mesh.boundary {
            let places = corners.map(|v| position[v as usize]);
            if let Some(free) = places.into_iter().find(|&k| k != u32::MAX) {
                boundaries[part_of_root[sets.find(free) as usize]].push(*corners);
            }
        }
        let patch = |(cells, boundary): (&Vec<u32>, &Vec<[u32; 3]>)| {
            let nodes = nodes_of(cells);
            let local = |v: u32| nodes.binary_search(&v).unwrap_or_default() as u32;
            let places = (0..nodes.len() as u32).map(|k| (k, position[nodes[k as usize] as usize]));
            let (free, freedoms) = places
                .filter(|(_, place)| *place != u32::MAX)
                .map(|(k, place)| (k, freedoms[place as usize]))
                .unzip();
            let cells = BoundedMesh {
                cells: CellList::Hexes(cells.iter().map(|&c| hexes[c as usize].map(local)).collect()),
                on_boundary: nodes.iter().map(|&v| mesh.on_boundary[v as usize]).collect(),
                nodes: nodes.iter().map(|&v| mesh.nodes[v as usize]).collect(),
                boundary: boundary.iter().map(|corners| corners.map(local)).collect(),
                regions: vec![],
                parts: vec![],
                part_names: vec![],
            };
            Patch {
                nodes,
                free,
                freedoms,
                cells,
            }
        };
        parts.par_iter().zip(&boundaries).map(patch).collect()
    }

    /// What pulls boundary nodes so that the boundary gets closer to the target's vertices: for each vertex at `p`, closest
    /// to a point of the boundary with coordinates `bᵢ` and `r` away, the energy `Σ bᵢ (|r| − r · dᵢ / |r|)²` of
    /// displacements `dᵢ`, which is no less than the square of what is left. Nodes that slide off a tip are pulled back;
    /// where the target is flat, or curved the same way all around, it leaves them alone.
    fn pulls(&self, x: &[Point], fit: f64) -> Vec<Pull> {
        let mut pulls: Vec<Pull> = x.iter().map(|&from| Pull::none(from)).collect();
        let Some(found) = self.closest_on_boundary(x) else {
            return pulls;
        };
        for ((p, area), found) in self.vertices.iter().zip(found) {
            let away = p - found.point;
            let along = away.try_normalize(0.0).unwrap_or_else(Vector::zeros);
            for (v, share) in self.mesh.boundary[found.triangle].into_iter().zip(found.barycentric) {
                let weight = fit * share * area / self.edges[v as usize].powi(4);
                let pull = &mut pulls[v as usize];
                pull.matrix += along * along.transpose() * weight;
                pull.vector += away * weight;
            }
        }
        pulls
    }

    /// The point of the boundary with nodes at `x` closest to each of the target's vertices; `None` where nothing slides or nodes are not
    /// finite.
    fn closest_on_boundary(&self, x: &[Point]) -> Option<Vec<ClosestPoint>> {
        self.surface.as_ref()?;
        let boundary = SurfaceMesh::new(x.to_vec(), self.mesh.boundary.clone()).ok()?;
        let points: Vec<Point> = self.vertices.iter().map(|(p, _)| *p).collect();
        Some(SurfaceQuery::new(&boundary).ok()?.closest_points(&points))
    }

    fn boundary(&self, x: &[Point]) -> Option<BoundaryState> {
        let surface = self.surface.as_ref()?;
        let found = self.closest_on_boundary(x)?;
        let (mut sums, mut largest) = ([0.0; 2], 0.0f64);
        for ((_, area), found) in self.vertices.iter().zip(found) {
            sums = [sums[0] + area * found.distance, sums[1] + area];
            largest = largest.max(found.distance);
        }
        Some(BoundaryState {
            crossings: crossing_triangles(&self.mesh.boundary, x).len(),
            turned: turned_triangles(&self.mesh.boundary, x, surface),
            distances: [sums[0] / sums[1], largest],
        })
    }
}

/// How many triangles face away from the target where their centres are closest to it.
fn turned_triangles(triangles: &[[u32; 3]], x: &[Point], surface: &RelaxationSurface) -> usize {
    let faces_away = |corners: &&[u32; 3]| {
        let [a, b, c] = corners.map(|v| x[v as usize]);
        let centre = Point::from((a.coords + b.coords + c.coords) / 3.0);
        !is_positive((b - a).cross(&(c - a)).dot(&surface.normal_near(&centre)))
    };
    triangles.par_iter().filter(faces_away).count()
}

impl PatchMeasure {
    fn of(
        mesh: &BoundedMesh,
        x: &[Point],
        facing: Option<&RelaxationSurface>,
        bounds: [f64; 2],
        raised_to: f64,
    ) -> Self {
        let scaled = scaled_jacobians(&mesh.cells, x);
        Self {
            invalid: invalid_cells(&mesh.cells, x).cells.len(),
            turned: facing.map_or(0, |surface| turned_triangles(&mesh.boundary, x, surface)),
            least: scaled.iter().copied().fold(f64::INFINITY, lesser),
            // NaN counts as low.
            below: bounds.map(|bound| scaled.len() - scaled.iter().filter(|s| **s >= bound).count()),
            shortfall: scaled.iter().map(|s| (raised_to - s).max(0.0).powi(2)).sum(),
        }
    }

    /// Written so that NaN is worse.
    fn is_better_than(&self, other: &Self) -> bool {
        self.invalid <= other.invalid
            && self.turned <= other.turned
            && self.least >= other.least
            && self.below[0] <= other.below[0]
            && self.below[1] <= other.below[1]
            && self.shortfall < other.shortfall
    }
}

impl Patch {
    /// The positions of the patch's nodes.
    fn of(&self, x: &[Point]) -> Vec<Point> {
        self.nodes.iter().map(|&v| x[v as usize]).collect()
    }

    /// Moves the patch's free nodes.
    fn put(&self, own: &[Point], x: &mut [Point]) {
        for &v in &self.free {
            x[self.nodes[v as usize] as usize] = own[v as usize];
        }
    }
}

/// Mean length of the edges of hexahedra on the boundary at each node, 1 where there are none, and the mean over nodes.
fn mean_edges(mesh: &BoundedMesh, x: &[Point]) -> (Vec<f64>, f64) {
    let mut sums = vec![(0.0, 0.0); x.len()];
    if let CellList::Hexes(hexes) = &mesh.cells {
        for h in hexes {
            for &[a, b] in HEX_EDGES.as_flattened() {
                let ends = [h[a] as usize, h[b] as usize];
                let length = (x[ends[0]] - x[ends[1]]).norm();
                if ends.iter().all(|&v| mesh.on_boundary[v]) && length.is_finite() {
                    ends.iter()
                        .for_each(|&v| sums[v] = (sums[v].0 + length, sums[v].1 + 1.0));
                }
            }
        }
    }
    let means = sums.iter().filter(|(_, count)| *count > 0.0);
    let means: Vec<f64> = means.map(|(sum, count): &(f64, f64)| sum / count).collect();
    let mean = length_or_one(means.iter().sum::<f64>() / means.len() as f64);
    let edge = |(sum, count): (f64, f64)| match count > 0.0 {
        true => (sum / count).max(LEAST_EDGE * mean),
        false => 1.0,
    };
    (sums.into_iter().map(edge).collect(), mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{CellMesh, shapes};
    use crate::progress::{ProgressControl, run_cancellable};
    use crate::remesh::bounded_mesh::faces;

    const SIDE: usize = 6;

    /// A cube of hexahedra between −1 and 1.
    fn block() -> BoundedMesh {
        let count = SIDE + 1;
        let at = |n: usize| {
            let place = [n % count, n / count % count, n / count / count];
            Point::from(place.map(|k| 2.0 * k as f64 / SIDE as f64 - 1.0))
        };
        let corners = [0, 1, 1 + count, count].map(|n| [n, n + count * count]);
        let hex = |n: usize| {
            let first = n % SIDE + count * (n / SIDE % SIDE) + count * count * (n / SIDE / SIDE);
            std::array::from_fn(|k| (first + corners[k % 4][k / 4]) as u32)
        };
        let hexes = (0..SIDE.pow(3)).map(hex).collect();
        let nodes = (0..count.pow(3)).map(at).collect();
        let mesh = CellMesh::new(nodes, CellList::Hexes(hexes), vec![0; SIDE.pow(3)]).unwrap();
        let faces = faces(mesh.cells());
        BoundedMesh::of(mesh, &faces)
    }

    fn on_faces(p: &Point) -> usize {
        p.iter().filter(|x| (x.abs() - 1.0).abs() < 1e-9).count()
    }

    /// The nodes, displaced but along the faces and edges of the cube, and most where `x = y = z`.
    fn displaced(mesh: &BoundedMesh) -> Vec<Point> {
        let displace = |p: &Point| {
            let near = (-2.0 * (p - Point::new(0.6, 0.6, 0.6)).norm_squared()).exp();
            let wave =
                |k: usize| 0.2 * near * (4.0 * (p[(k + 1) % 3] + 0.7 * p[(k + 2) % 3])).sin() * (1.0 - p[k] * p[k]);
            Point::from(std::array::from_fn(|k| p[k] + wave(k)))
        };
        mesh.nodes.iter().map(displace).collect()
    }

    fn mean(mesh: &BoundedMesh, x: &[Point]) -> f64 {
        let scaled = scaled_jacobians(&mesh.cells, x);
        scaled.iter().sum::<f64>() / scaled.len() as f64
    }

    fn polished(
        mesh: &BoundedMesh,
        surface: Option<&SlidingSurface>,
        start: &[Point],
        control: ProgressControl,
    ) -> (Vec<Point>, PolishReport) {
        let (mut x, mut report) = (start.to_vec(), PolishReport::default());
        run_cancellable(&|_| control, |monitor| {
            let _ = monitor.send((0, 0));
            while control == ProgressControl::Cancel && monitor.should_continue() {
                std::thread::yield_now();
            }
            HexPolish::new(mesh, start, surface, OwnShape::Imaged, 200, monitor).run(&mut x, &mut report);
        });
        (x, report)
    }

    fn surface(target: &SurfaceMesh) -> SlidingSurface<'_> {
        SlidingSurface {
            target,
            query: SurfaceQuery::with_winding_sign(target).unwrap(),
            stiffness: 1.0,
        }
    }

    #[test]
    fn the_least_scaled_jacobian_rises_and_nodes_stay_on_faces_edges_and_corners() {
        let (mesh, cube) = (block(), shapes::cube(2.0, 3));
        let middle = cube.bounding_box().map(|(a, b)| (a.coords + b.coords) / 2.0).unwrap();
        let cube = shapes::deformed(&cube, |p| p - middle);
        let start = displaced(&mesh);
        let floor = Floor::of(&mesh, &start);
        assert!(floor.invalid == 0 && floor.least < 0.4, "{floor:?}");
        let (x, report) = polished(&mesh, Some(&surface(&cube)), &start, ProgressControl::Continue);
        assert!(report.kept_iterations > 0);
        let found = floor.raised(&mesh, &x).unwrap();
        assert!(found.least > 0.5, "{found:?}");
        let mut slid = 0;
        for (v, p) in mesh.nodes.iter().enumerate() {
            assert_eq!(on_faces(&x[v]), on_faces(p), "{p} {}", x[v]);
            slid += usize::from(mesh.on_boundary[v] && (x[v] - start[v]).norm() > 1e-3);
        }
        assert!(slid > 5, "{slid}");
        // With one thread and with several.
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let again = alone.install(|| polished(&mesh, Some(&surface(&cube)), &start, ProgressControl::Continue));
        assert_eq!(again.0, x);
    }

    #[test]
    fn a_fixed_boundary_does_not_move() {
        let mesh = block();
        let start = displaced(&mesh);
        let (x, report) = polished(&mesh, None, &start, ProgressControl::Continue);
        assert!(report.kept_iterations > 0);
        assert!(Floor::of(&mesh, &start).raised(&mesh, &x).is_some());
        assert!(mean(&mesh, &x) > mean(&mesh, &start) + 1e-3);
        assert!((0..x.len()).all(|v| !mesh.on_boundary[v] || x[v] == start[v]));
    }

    #[test]
    fn cancellation_ends_it_where_it_began() {
        let mesh = block();
        let start = displaced(&mesh);
        let (x, report) = polished(&mesh, None, &start, ProgressControl::Cancel);
        assert_eq!((x, report.iterations), (start, 0));
    }

    #[test]
    fn pulls_are_back_to_a_tip_and_nowhere_else() {
        // The boundary misses the cube's corners, as if its nodes had slid off.
        let mesh = block();
        let cube = shapes::cube(2.0, 3);
        let middle = cube.bounding_box().map(|(a, b)| (a.coords + b.coords) / 2.0).unwrap();
        let cube = shapes::deformed(&cube, |p| p - middle);
        let mut x = mesh.nodes.clone();
        let corner = x.len() - 1;
        x[corner] = Point::new(0.8, 0.8, 1.0);
        let surface = surface(&cube);
        run_cancellable(&|_: (usize, usize)| ProgressControl::Continue, |monitor| {
            let polish = HexPolish::new(&mesh, &x, Some(&surface), OwnShape::Imaged, 200, monitor);
            for (v, pull) in polish.pulls(&x, 1.0).into_iter().enumerate() {
                if v == corner {
                    assert!(pull.vector.x > 0.0 && pull.vector.y > 0.0, "{pull:?}");
                }
                let is_near = (x[v] - x[corner]).norm() < 1.0;
                assert!(is_near || pull.vector.norm() < 1e-9, "{pull:?}");
            }
        });
    }
}
