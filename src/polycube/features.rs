//! Sharp edges of a model that the borders of charts are to follow.

use super::face_graph::FaceGraph;
use super::solid::Solid;
use crate::Point;
use crate::mesh::{SurfaceMesh, creases, feature_curves};

/// How much of a model's sharp edges became borders between charts, which are edges of the polycube.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct FeatureReport {
    /// Angle between the normals beside an edge from which it counts as sharp, in degrees.
    pub angle: f64,
    /// Length of the sharp edges, without those that end somewhere, in the units of the model.
    pub length: f64,
    /// Length of those of them that are borders. Others have one direction on both sides: as both edges of a bevel, whose normals are
    /// as close to one axis as to another.
    pub on_borders: f64,
}

/// The sharp edges of a surface with these triangles, by their ends, ascending.
pub(super) fn feature_edges(triangles: &[[u32; 3]], nodes: &[Point], degrees: f64) -> Vec<[u32; 2]> {
    let Ok(surface) = SurfaceMesh::new(nodes.to_vec(), triangles.to_vec()) else {
        return vec![];
    };
    feature_curves(&surface, &creases(&surface, degrees.to_radians().cos()), 0.0)
}

impl FeatureReport {
    /// Measures a solid with labels, whose nodes are those of the model times `scale`.
    pub(super) fn of(solid: &Solid, graph: &FaceGraph, degrees: f64, scale: f64) -> Self {
        let nodes = &solid.mesh.nodes;
        let edges = feature_edges(&graph.triangles, nodes, degrees);
        let labels = solid.labels();
        let (mut length, mut on_borders) = (0.0, 0.0);
        for (face, t) in graph.triangles.iter().enumerate() {
            for k in 0..3 {
                let [a, b] = [t[k], t[(k + 1) % 3]];
                if a < b && edges.binary_search(&[a, b]).is_ok() {
                    let edge = (nodes[b as usize] - nodes[a as usize]).norm() / scale;
                    length += edge;
                    if labels[face] != labels[graph.neighbours[face][k] as usize] {
                        on_borders += edge;
                    }
                }
            }
        }
        Self {
            angle: degrees,
            length,
            on_borders,
        }
    }
}
