//! Refinement of the boundary where its triangles pass through each other: where the target is thinner than a cell, or
//! chords of the boundary map's images cut across it.
//!
//! The edges of such triangles are split at their midpoints in the domain, and the new nodes go where the boundary map
//! sends them, so that the boundary comes closer to the target, which does not pass through itself.

use std::collections::{HashMap, HashSet};

use super::bounded_mesh::{BoundedMesh, sorted};
use super::crossings::crossing_triangles;
use super::quality::is_right_handed;
use crate::Point;
use crate::mesh::CellList;
use crate::progress::ProgressSender;

/// Turns of splitting at most. Each halves the triangles that cross.
const MAX_TURNS: usize = 12;
/// An edge is split if its image is at least this long, as a fraction of the longest of its triangle: maps distort, and
/// triangles are to get rounder in the target.
const LONG: f64 = 0.5;

/// How the boundary was split where its triangles passed through each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct BoundarySplitReport {
    /// Turns in which edges of the boundary were split.
    pub turns: usize,
    /// Edges of the boundary that were split: nodes that this added to it.
    pub edges: usize,
    /// Boundary triangles that were added.
    pub triangles_added: usize,
    /// Cells that were added.
    pub cells_added: usize,
    /// Pairs of boundary triangles that passed through each other as mapped.
    pub crossings_before: usize,
    /// Pairs that were left before the inside was repaired.
    pub crossings_after: usize,
}

impl BoundarySplitReport {
    /// The report of a boundary that is left unsplit after all.
    pub(super) fn undone(self) -> Self {
        Self {
            crossings_before: self.crossings_before,
            crossings_after: self.crossings_before,
            ..Self::default()
        }
    }
}

/// Images of points on the domain's surface.
pub(super) type BoundaryImage<'a> = &'a dyn Fn(&[Point]) -> Vec<Point>;

/// What a refinement of the boundary works on: a mesh of tetrahedra and the images of its nodes.
pub(super) struct BoundaryRefinement<'a> {
    pub mesh: &'a mut BoundedMesh,
    pub carried: &'a mut Vec<Point>,
    /// Images of points on the domain's surface.
    pub image: BoundaryImage<'a>,
    /// Largest number of tetrahedra that may be added.
    pub most_added: usize,
    pub monitor: &'a ProgressSender<'a, (usize, usize)>,
}

/// A mesh and the images of its nodes.
pub(super) type Unrefined = (BoundedMesh, Vec<Point>);

impl BoundaryRefinement<'_> {
    /// Splits the boundary until no triangles pass through each other, or as few as possible. Returns the mesh as it was,
    /// if anything was split.
    pub fn run(&mut self) -> (BoundarySplitReport, Option<Unrefined>) {
        let mut crossing = crossing_triangles(&self.mesh.boundary, self.carried);
        let mut report = BoundarySplitReport {
            crossings_before: crossing.len(),
            crossings_after: crossing.len(),
            ..BoundarySplitReport::default()
        };
        let mut fewest: Option<(BoundarySplitReport, Unrefined)> = None;
        let unrefined = (!crossing.is_empty()).then(|| self.state());
        while !crossing.is_empty() && report.turns < MAX_TURNS && self.monitor.should_continue() {
            let before = report;
            self.split(crossing.as_flattened().to_vec(), &mut report);
            if report.edges == before.edges {
                break;
            }
            crossing = crossing_triangles(&self.mesh.boundary, self.carried);
            report.crossings_after = crossing.len();
            let least = fewest
                .as_ref()
                .map_or(report.crossings_before, |(best, _)| best.crossings_after);
            if crossing.len() < least {
                fewest = Some((report, self.state()));
            }
        }
        let Some(unrefined) = unrefined else {
            return (report, None);
        };
        // A target that passes through itself is not to be refined for nothing.
        match fewest {
            Some((best, (mesh, carried))) => {
                (*self.mesh, *self.carried) = (mesh, carried);
                (best, Some(unrefined))
            }
            None => {
                (*self.mesh, *self.carried) = unrefined;
                (report.undone(), None)
            }
        }
    }

    fn state(&self) -> Unrefined {
        (self.mesh.clone(), self.carried.clone())
    }

    /// Splits the long edges of these boundary triangles.
    pub fn split(&mut self, mut triangles: Vec<u32>, report: &mut BoundarySplitReport) {
        triangles.sort_unstable();
        triangles.dedup();
        let edges_of = |t: &u32| {
            let [a, b, c] = self.mesh.boundary[*t as usize];
            [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
        };
        let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(edges_of).collect();
        edges.sort_unstable();
        edges.dedup();
        let middle = |[a, b]: &[u32; 2]| nalgebra::center(&self.mesh.nodes[*a as usize], &self.mesh.nodes[*b as usize]);
        let middles: Vec<Point> = edges.iter().map(middle).collect();
        let images = (self.image)(&middles);
        // A chord may be short although its edge goes around a limb.
        let length = |[a, b]: &[u32; 2], image: &Point| {
            let ends = [a, b].map(|v| (self.carried[*v as usize] - image).norm());
            ends[0] + ends[1]
        };
        let lengths: Vec<f64> = edges
            .iter()
            .zip(&images)
            .map(|(edge, image)| length(edge, image))
            .collect();
        let mut is_long = vec![false; edges.len()];
        for t in &triangles {
            let own = edges_of(t).map(|edge| edges.binary_search(&edge).unwrap_or_default());
            let longest = own.iter().map(|&k| lengths[k]).fold(0.0, f64::max);
            own.iter().for_each(|&k| is_long[k] |= lengths[k] >= LONG * longest);
        }
        let mut order: Vec<usize> = (0..edges.len()).filter(|&k| is_long[k]).collect();
        order.sort_by(|&a, &b| lengths[b].total_cmp(&lengths[a]).then(a.cmp(&b)));
        let new: Vec<NewNode> = order
            .into_iter()
            .map(|k| NewNode {
                edge: edges[k],
                at: middles[k],
                image: images[k],
            })
            .collect();
        let before = report.edges;
        split_boundary_edges(self.mesh, self.carried, &new, self.most_added, report);
        report.turns += usize::from(report.edges > before);
    }
}

/// The boundary triangles of the cells at the inner nodes of inverted cells.
pub(super) fn boundary_at_stuck(mesh: &BoundedMesh, inverted: &[u32]) -> Vec<u32> {
    let CellList::Tets(tets) = &mesh.cells else {
        return vec![];
    };
    let nodes = inverted.iter().flat_map(|&cell| tets[cell as usize]);
    let stuck: HashSet<u32> = nodes.filter(|&v| !mesh.on_boundary[v as usize]).collect();
    let at_stuck = tets.iter().filter(|t| t.iter().any(|v| stuck.contains(v)));
    let faces: HashSet<[u32; 3]> = at_stuck
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, b, d], [a, c, d], [b, c, d]])
        .map(sorted)
        .collect();
    let triangles = (0..).zip(&mesh.boundary);
    triangles
        .filter(|(_, t)| faces.contains(&sorted(**t)))
        .map(|(triangle, _)| triangle)
        .collect()
}

/// Splits edges of the boundary at their midpoints, in the mesh and in `x` alike. Returns how many edges were split; at
/// most about `most` cells are added.
pub(crate) fn halve_boundary_edges(
    mesh: &mut BoundedMesh,
    x: &mut Vec<Point>,
    edges: &[[u32; 2]],
    most: usize,
) -> usize {
    let middle = |at: &[Point], [a, b]: [u32; 2]| nalgebra::center(&at[a as usize], &at[b as usize]);
    let new = edges.iter().map(|&edge| NewNode {
        edge,
        at: middle(&mesh.nodes, edge),
        image: middle(x, edge),
    });
    let new: Vec<NewNode> = new.collect();
    let mut report = BoundarySplitReport::default();
    split_boundary_edges(mesh, x, &new, most, &mut report);
    report.edges
}

/// A node to be inserted in an edge of the boundary.
struct NewNode {
    edge: [u32; 2],
    at: Point,
    image: Point,
}

/// The cells and the boundary triangles at a node.
#[derive(Default)]
struct AtNode {
    cells: Vec<u32>,
    triangles: Vec<u32>,
}

/// Inserts nodes one after the other, as long as the mesh has no more than `most` cells more than at first. Edges are left
/// alone where a part of a cell would not be right-handed in the domain.
fn split_boundary_edges(
    mesh: &mut BoundedMesh,
    carried: &mut Vec<Point>,
    new_nodes: &[NewNode],
    most: usize,
    report: &mut BoundarySplitReport,
) {
    let CellList::Tets(tets) = &mut mesh.cells else {
        return;
    };
    let ends = new_nodes.iter().flat_map(|new| new.edge);
    let mut around: HashMap<u32, AtNode> = ends.map(|v| (v, AtNode::default())).collect();
    for (cell, t) in (0..).zip(tets.iter()) {
        for v in t {
            around.entry(*v).and_modify(|at| at.cells.push(cell));
        }
    }
    for (triangle, t) in (0..).zip(&mesh.boundary) {
        for v in t {
            around.entry(*v).and_modify(|at| at.triangles.push(triangle));
        }
    }
    for NewNode {
        edge: [a, b],
        at,
        image,
    } in new_nodes
    {
        let Some(at_a) = around.get(a) else {
            continue;
        };
        let cells: Vec<u32> = at_a
            .cells
            .iter()
            .copied()
            .filter(|&c| tets[c as usize].contains(b))
            .collect();
        let has_b = |t: &u32| mesh.boundary[*t as usize].contains(b);
        let triangles: Vec<u32> = at_a.triangles.iter().copied().filter(has_b).collect();
        if triangles.len() != 2 || cells.is_empty() || report.cells_added + cells.len() > most {
            continue;
        }
        let new = mesh.nodes.len() as u32;
        mesh.nodes.push(*at);
        let replaced = |cell: u32, gone: u32| tets[cell as usize].map(|v| if v == gone { new } else { v });
        let is_sound = |&cell: &u32| {
            !is_right_handed(&mesh.nodes, tets[cell as usize])
                || [*a, *b]
                    .iter()
                    .all(|&gone| is_right_handed(&mesh.nodes, replaced(cell, gone)))
        };
        if !cells.iter().all(is_sound) {
            mesh.nodes.pop();
            continue;
        }
        carried.push(*image);
        mesh.on_boundary.push(true);
        report.edges += 1;
        report.cells_added += cells.len();
        report.triangles_added += triangles.len();
        for &cell in &cells {
            let [near_a, near_b] = [*b, *a].map(|gone| tets[cell as usize].map(|v| if v == gone { new } else { v }));
            let added = tets.len() as u32;
            tets[cell as usize] = near_a;
            tets.push(near_b);
            mesh.regions.push(mesh.regions[cell as usize]);
            around
                .entry(*b)
                .and_modify(|at| at.cells.retain(|&other| other != cell));
            for v in near_b {
                around.entry(v).and_modify(|at| at.cells.push(added));
            }
        }
        for &triangle in &triangles {
            let whole = mesh.boundary[triangle as usize];
            let [near_a, near_b] = [*b, *a].map(|gone| whole.map(|v| if v == gone { new } else { v }));
            let added = mesh.boundary.len() as u32;
            mesh.boundary[triangle as usize] = near_a;
            mesh.boundary.push(near_b);
            mesh.parts.push(mesh.parts[triangle as usize]);
            around
                .entry(*b)
                .and_modify(|at| at.triangles.retain(|&other| other != triangle));
            for v in near_b {
                around.entry(v).and_modify(|at| at.triangles.push(added));
            }
        }
    }
}
