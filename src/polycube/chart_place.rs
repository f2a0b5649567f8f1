//! A chart as messages name it.

use std::fmt;

use super::face_graph::{Charts, FaceGraph};
use crate::mesh::DIRECTION_NAMES;
use crate::{Point, Vector};

/// A chart: its label, how large it is, and where it is.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ChartPlace {
    /// 0 to 5 for -x, +x, -y, +y, -z, +z.
    pub label: u8,
    /// Its triangles.
    pub triangles: usize,
    /// The centre of one of its triangles in the model, in its middle.
    pub position: [f64; 3],
}

impl ChartPlace {
    /// A chart with its nodes at `nodes`.
    pub(super) fn new(chart: usize, graph: &FaceGraph, charts: &Charts, nodes: &[Point]) -> Self {
        let is_of_chart = |(_, of): &(&[u32; 3], &u32)| **of as usize == chart;
        let faces = graph.triangles.iter().zip(&charts.of_face).filter(is_of_chart);
        let centres: Vec<Point> = faces.map(|(t, _)| centre(*t, nodes)).collect();
        let mean = centres.iter().map(|p| p.coords).sum::<Vector>() / centres.len().max(1) as f64;
        let distance = |p: &Point| (p.coords - mean).norm_squared();
        let nearest = centres.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        Self {
            label: charts.labels[chart],
            triangles: centres.len(),
            position: nearest.copied().unwrap_or_default().into(),
        }
    }
}

/// The centre of a triangle.
fn centre(corners: [u32; 3], nodes: &[Point]) -> Point {
    Point::from(corners.iter().map(|&v| nodes[v as usize].coords).sum::<Vector>() / 3.0)
}

/// The name of a label's direction.
pub(super) fn name(label: u8) -> &'static str {
    DIRECTION_NAMES.get(usize::from(label)).copied().unwrap_or("?")
}

/// A position to three digits.
pub(super) fn position_text(position: [f64; 3]) -> String {
    let [x, y, z] = position.map(|x| {
        // Numbers of ordinary size without exponents.
        if x == 0.0 || (1e-3..1e5).contains(&x.abs()) {
            let digits = (2 - x.abs().max(1e-3).log10().floor() as i32).clamp(0, 6) as usize;
            format!("{x:.digits$}")
        } else {
            format!("{x:.2e}")
        }
    });
    format!("({x}, {y}, {z})")
}

impl fmt::Display for ChartPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, count, position) = (name(self.label), self.triangles, position_text(self.position));
        let triangles = if count == 1 { "triangle" } else { "triangles" };
        write!(f, "{name} ({count} {triangles}, near {position})")
    }
}
