//! What an attempt that found no polycube left: its cells, which of them are bad, and at which charts these are.

use std::collections::HashMap;
use std::fmt::Write as _;

use super::attempt::{Attempt, graph_of};
use super::chart_place::{ChartPlace, position_text};
use super::solid::Solid;
use super::{LabelSource, MakePolycubeError, PolycubeReport};
use crate::mesh::topology::DisjointSets;
use crate::mesh::{TET_FACES, TetMesh};
use crate::remesh::{CellsAtNodes, crossing_triangles};
use crate::{Point, Vector};

/// Places, and charts of each, that a message names.
const MOST_NAMED: usize = 3;

/// The best attempt where no polycube was found, for inspection.
#[derive(Debug, Clone, PartialEq)]
pub struct BestAttempt {
    /// The model's tetrahedra, with nodes and cells that splitting added.
    pub model: TetMesh,
    /// The same tetrahedra as they were when the attempt was given up.
    pub polycube: TetMesh,
    /// Boundary triangles, facing outward in the model.
    pub boundary: Vec<[u32; 3]>,
    /// The direction that each boundary triangle should face along: 0 to 5 for -x, +x, -y, +y, -z, +z.
    pub labels: Vec<u8>,
    /// Whether each tetrahedron is inverted, or has a boundary triangle that faces against its direction or passes through
    /// another.
    pub bad: Vec<bool>,
    /// The label of the boundary triangle of each tetrahedron, the first if there are several; `None` for inner ones.
    pub cell_labels: Vec<Option<u8>>,
    /// Connected groups of bad tetrahedra, the largest first.
    pub places: Vec<BadPlace>,
    /// What was done.
    pub report: PolycubeReport,
}

/// A connected group of bad tetrahedra.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BadPlace {
    /// How many there are.
    pub cells: usize,
    /// The mean of their corners in the model.
    pub position: [f64; 3],
    /// The charts at them or nearest to them, first those with the most triangles there.
    pub charts: Vec<ChartPlace>,
}

impl BestAttempt {
    /// An attempt of a solid that was scaled by `scale`.
    pub(super) fn new(attempt: Attempt, scale: f64) -> Result<Self, MakePolycubeError> {
        let Attempt { solid, report, .. } = attempt;
        let unscaled = |nodes: &[Point]| -> Vec<Point> { nodes.iter().map(|p| p / scale).collect() };
        let nodes = unscaled(&solid.mesh.nodes);
        let tet_of = tets_of_boundary(&solid);
        let bad = bad_tets(&solid, &tet_of);
        let mut cell_labels = vec![None; solid.tets().len()];
        for (face, tet) in tet_of.iter().enumerate() {
            if let Some(tet) = *tet {
                cell_labels[tet as usize].get_or_insert(solid.label(face));
            }
        }
        let places = places(&solid, &bad, &nodes)?;
        let tets = solid.tets().to_vec();
        Ok(Self {
            places,
            bad,
            cell_labels,
            labels: solid.labels(),
            polycube: TetMesh::new(unscaled(&solid.x), tets.clone())?,
            model: TetMesh::new(nodes, tets)?,
            boundary: solid.mesh.boundary,
            report,
        })
    }

    /// Where the bad cells are, and what to do, for the message of an error.
    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        let count = self.places.len();
        if count > 0 {
            let places = if count == 1 { "place" } else { "places" };
            let _ = write!(text, "; bad cells are in {count} {places}: ");
            for (k, place) in self.places.iter().take(MOST_NAMED).enumerate() {
                let separator = if k > 0 { "; " } else { "" };
                let charts: Vec<String> = place.charts.iter().take(MOST_NAMED).map(ToString::to_string).collect();
                let charts = match charts.is_empty() {
                    true => String::new(),
                    false => format!(" at the charts {}", charts.join(", ")),
                };
                let (cells, position) = (place.cells, position_text(place.position));
                let _ = write!(text, "{separator}{cells} near {position}{charts}");
            }
            if count > MOST_NAMED {
                text.push_str("; and others");
            }
        }
        text.push_str(match self.report.labels {
            LabelSource::Given => ". Other labels there may help",
            LabelSource::Cut | LabelSource::Sphere => ". Try another smoothness or orientation, or give labels",
        });
        text
    }
}

fn sorted(mut corners: [u32; 3]) -> [u32; 3] {
    corners.sort_unstable();
    corners
}

/// The tetrahedron of each boundary triangle.
fn tets_of_boundary(solid: &Solid) -> Vec<Option<u32>> {
    let mut tet_of = vec![None; solid.mesh.boundary.len()];
    let faces: HashMap<[u32; 3], usize> = (0..)
        .zip(&solid.mesh.boundary)
        .map(|(face, t)| (sorted(*t), face))
        .collect();
    for (tet, corners) in (0..).zip(solid.tets()) {
        for side in TET_FACES {
            if let Some(&face) = faces.get(&sorted(side.map(|k| corners[k]))) {
                tet_of[face] = Some(tet);
            }
        }
    }
    tet_of
}

fn bad_tets(solid: &Solid, tet_of: &[Option<u32>]) -> Vec<bool> {
    let inverted = solid.inverted();
    let crossing = crossing_triangles(&solid.mesh.boundary, &solid.x);
    let faces = inverted.faces.iter().chain(crossing.iter().flatten());
    let beside = faces.filter_map(|&face| tet_of[face as usize]);
    let mut bad = vec![false; solid.tets().len()];
    inverted
        .tets
        .iter()
        .copied()
        .chain(beside)
        .for_each(|tet| bad[tet as usize] = true);
    bad
}

/// Groups of bad tetrahedra that share nodes.
fn places(solid: &Solid, bad: &[bool], nodes: &[Point]) -> Result<Vec<BadPlace>, MakePolycubeError> {
    let bad_tets: Vec<[u32; 4]> = solid
        .tets()
        .iter()
        .zip(bad)
        .filter(|(_, bad)| **bad)
        .map(|(t, _)| *t)
        .collect();
    let mut sets = DisjointSets::new(nodes.len());
    for [a, b, c, d] in &bad_tets {
        [b, c, d].into_iter().for_each(|&other| sets.unite(*a, other));
    }
    let mut groups: Vec<Vec<[u32; 4]>> = vec![];
    let mut group_of: HashMap<u32, usize> = HashMap::new();
    for tet in bad_tets {
        let group = *group_of.entry(sets.find(tet[0])).or_insert(groups.len());
        if group == groups.len() {
            groups.push(vec![]);
        }
        groups[group].push(tet);
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let at_nodes = CellsAtNodes::new(&solid.mesh.cells, nodes.len());
    let graph = graph_of(solid)?;
    let charts = graph.charts(&solid.labels());
    let place = |group: &Vec<[u32; 4]>| {
        let corners: Vec<Vector> = group.iter().flatten().map(|&v| nodes[v as usize].coords).collect();
        let mut here: Vec<u32> = group.iter().flatten().copied().collect();
        here.sort_unstable();
        here.dedup();
        let mut triangles_of: HashMap<u32, usize> = HashMap::new();
        for &face in boundary_near(solid, &at_nodes, here)
            .iter()
            .flat_map(|&v| graph.faces_at(v))
        {
            *triangles_of.entry(charts.of_face[face as usize]).or_default() += 1;
        }
        let mut at: Vec<(u32, usize)> = triangles_of.into_iter().collect();
        at.sort_unstable_by_key(|&(chart, count)| (std::cmp::Reverse(count), chart));
        BadPlace {
            cells: group.len(),
            position: (corners.iter().sum::<Vector>() / corners.len() as f64).into(),
            charts: at
                .iter()
                .map(|&(chart, _)| ChartPlace::new(chart as usize, &graph, &charts, nodes))
                .collect(),
        }
    };
    Ok(groups.iter().map(place).collect())
}

/// Those of some nodes that are on the boundary; where there are none, the boundary nodes fewest tetrahedra away.
fn boundary_near(solid: &Solid, at_nodes: &CellsAtNodes, start: Vec<u32>) -> Vec<u32> {
    let mut seen = vec![false; solid.x.len()];
    start.iter().for_each(|&v| seen[v as usize] = true);
    let mut ring = start;
    loop {
        let on_boundary: Vec<u32> = ring
            .iter()
            .copied()
            .filter(|&v| solid.mesh.on_boundary[v as usize])
            .collect();
        if !on_boundary.is_empty() || ring.is_empty() {
            return on_boundary;
        }
        let tets = ring.iter().flat_map(|&v| at_nodes.of(v));
        let around: Vec<u32> = tets.flat_map(|&t| solid.tets()[t as usize]).collect();
        ring = around
            .into_iter()
            .filter(|&v| !std::mem::replace(&mut seen[v as usize], true))
            .collect();
    }
}
