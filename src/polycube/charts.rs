//! Which coordinates of a polycube's nodes are equal: those of a chart, along its axis.

use super::axis_of;
use super::face_graph::{Charts, FaceGraph};
use crate::Point;
use crate::mesh::topology::DisjointSets;
use crate::remesh::SharedCoordinates;

/// A set for every chart, or for several charts across one axis that share a vertex.
pub(super) fn planes(graph: &FaceGraph, charts: &Charts) -> SharedCoordinates {
    let count = charts.labels.len();
    let mut sets = DisjointSets::new(count);
    let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(3 * graph.triangles.len());
    for (face, corners) in graph.triangles.iter().enumerate() {
        pairs.extend(corners.iter().map(|&v| (v, charts.of_face[face])));
    }
    pairs.sort_unstable();
    pairs.dedup();
    for at_vertex in pairs.chunk_by(|a, b| a.0 == b.0) {
        for (k, first) in at_vertex.iter().enumerate() {
            for second in &at_vertex[..k] {
                let [a, b] = [first.1, second.1].map(|chart| axis_of(charts.labels[chart as usize]));
                if a == b {
                    sets.unite(first.1, second.1);
                }
            }
        }
    }
    let mut members: Vec<Vec<u32>> = vec![vec![]; count];
    for &(v, chart) in &pairs {
        members[sets.find(chart) as usize].push(v);
    }
    let mut shared = SharedCoordinates::default();
    for (chart, mut members) in members.into_iter().enumerate() {
        members.dedup();
        if !members.is_empty() {
            shared.equal.push((axis_of(charts.labels[chart]), members));
        }
    }
    shared
}

/// Puts all nodes of a set into the plane through the mean of their coordinates.
pub(super) fn level(x: &mut [Point], planes: &SharedCoordinates) {
    for (axis, nodes) in &planes.equal {
        let mean = nodes.iter().map(|&v| x[v as usize][*axis]).sum::<f64>() / nodes.len() as f64;
        nodes.iter().for_each(|&v| x[v as usize][*axis] = mean);
    }
}
