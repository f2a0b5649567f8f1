//! Labels that are given instead of sought: matched to the boundary of the tetrahedra, and what keeps them from being those of
//! a polycube, by the triangle at which a user can mend it.

use std::collections::HashMap;
use std::fmt;

use super::chart_place::{ChartPlace, name};
use super::cut::direction;
use super::face_graph::{Charts, FaceGraph, LABELS, are_opposite};
use super::label_repair::{LEAST_CORNERS, MOST_BORDERS};
use super::layout::Layout;
use super::{MakePolycubeError, axis_of};
use crate::Point;

/// Of the area across each axis, weighted by how much triangles face along their labels: below, on all axes, no rotation of the
/// model makes them face along. The mean of the three is a third of the trace of a matrix, which is -1 or more for rotations.
const MIRRORED: f64 = -0.5;
/// Charts that a message names.
const MOST_NAMED: usize = 4;

/// Why a triangle's label cannot be one of a polycube.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum LabelProblem {
    /// The label is not one of 0 to 5.
    Unknown(u8),
    /// The triangle is not one of the boundary of the tetrahedra.
    NotOnBoundary,
    /// The triangle comes twice.
    Repeated,
    /// A triangle beside it has the opposite label.
    Opposite {
        /// Its label.
        label: u8,
        /// The other triangle, as they were given.
        other: usize,
    },
    /// More than three borders between charts meet at one of its corners.
    Crowded {
        /// How many.
        borders: usize,
    },
    /// Its chart has no border: it is a whole part of the surface.
    Whole(ChartPlace),
    /// It is at a border of a chart that has fewer than four corners.
    FewCorners {
        /// The chart.
        chart: ChartPlace,
        /// Corners of this border, which is all around the chart, or around one of its holes.
        corners: usize,
    },
    /// It is of the first of some charts whose borders cannot turn as those of a polycube: no choice of which edges are convex
    /// fits all of them.
    NoLayout(Vec<ChartPlace>),
}

impl fmt::Display for LabelProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(label) => write!(f, "has the label {label}, but labels are 0 to 5"),
            Self::NotOnBoundary => write!(f, "is not one of the boundary of the tetrahedra"),
            Self::Repeated => write!(f, "is there twice"),
            Self::Opposite { label, other } => {
                let [own, opposite] = [*label, label ^ 1].map(name);
                write!(
                    f,
                    "has the label {own}, and triangle {other} beside it {opposite}; there has to be another label between them"
                )
            }
            Self::Crowded { borders } => {
                write!(
                    f,
                    "has a corner where {borders} borders between charts meet; three can, or two"
                )
            }
            Self::Whole(chart) => {
                write!(
                    f,
                    "is of the chart {chart}, which is a whole part of the surface; it needs other charts around it"
                )
            }
            Self::FewCorners { chart, corners } => {
                write!(
                    f,
                    "is at a border of the chart {chart} with {corners} corners; it needs at least {LEAST_CORNERS}"
                )
            }
            Self::NoLayout(charts) => {
                let names: Vec<String> = charts.iter().take(MOST_NAMED).map(ToString::to_string).collect();
                let others = if charts.len() > MOST_NAMED { " and others" } else { "" };
                let named = names.join(", ");
                write!(
                    f,
                    "is of the first of the charts {named}{others}, whose borders cannot turn as those of a polycube, whichever edges are \
                     convex"
                )
            }
        }
    }
}

/// Labels in the order of the boundary of a solid.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GivenLabels<'a> {
    pub labels: Vec<u8>,
    /// Which of those given each triangle's label is.
    order: Vec<usize>,
    /// Nodes of the model, as it was given.
    nodes: &'a [Point],
}

impl<'a> GivenLabels<'a> {
    /// Matches labels to the triangles of a boundary with `nodes`, and checks all that single charts and corners of a polycube
    /// need.
    pub fn new(graph: &FaceGraph, nodes: &'a [Point], given: &[([u32; 3], u8)]) -> Result<Self, MakePolycubeError> {
        let found = Self::matched(graph, nodes, given)?;
        found.check_directions(graph)?;
        found.check_topology(graph)?;
        Ok(found)
    }

    fn matched(graph: &FaceGraph, nodes: &'a [Point], given: &[([u32; 3], u8)]) -> Result<Self, MakePolycubeError> {
        let sorted = |mut corners: [u32; 3]| {
            corners.sort_unstable();
            corners
        };
        let faces = (0..).zip(&graph.triangles).map(|(face, t)| (sorted(*t), face));
        let faces: HashMap<[u32; 3], usize> = faces.collect();
        let mut labels = vec![0; graph.triangles.len()];
        let mut order = vec![usize::MAX; graph.triangles.len()];
        for (triangle, &(corners, label)) in given.iter().enumerate() {
            let wrong = |problem| Err(MakePolycubeError::Labels { triangle, problem });
            let Some(&face) = faces.get(&sorted(corners)) else {
                return wrong(LabelProblem::NotOnBoundary);
            };
            if usize::from(label) >= LABELS {
                return wrong(LabelProblem::Unknown(label));
            }
            if order[face] != usize::MAX {
                return wrong(LabelProblem::Repeated);
            }
            (labels[face], order[face]) = (label, triangle);
        }
        match order.iter().position(|&triangle| triangle == usize::MAX) {
            Some(face) => Err(MakePolycubeError::MissingLabel(graph.triangles[face])),
            None => Ok(Self { labels, order, nodes }),
        }
    }

    /// Numbers of other programs have the positive direction first: all labels are then reflected.
    fn check_directions(&self, graph: &FaceGraph) -> Result<(), MakePolycubeError> {
        let mut along = [0.0; 3];
        let mut areas = [0.0; 3];
        for (t, &label) in graph.triangles.iter().zip(&self.labels) {
            let [a, b, c] = t.map(|v| self.nodes[v as usize]);
            let area = (b - a).cross(&(c - a));
            along[axis_of(label)] += area.dot(&direction(label));
            areas[axis_of(label)] += area.norm();
        }
        let is_mirrored = (0..3).all(|axis| along[axis] < MIRRORED * areas[axis]);
        match is_mirrored {
            true => Err(MakePolycubeError::MirroredLabels),
            false => Ok(()),
        }
    }

    fn check_topology(&self, graph: &FaceGraph) -> Result<(), MakePolycubeError> {
        let labels = &self.labels;
        let half_edges = 0..3 * labels.len() as u32;
        let pair = |h: u32| [h, graph.twin(h)].map(|h| h as usize / 3);
        let opposite = half_edges
            .map(pair)
            .filter(|[a, b]| are_opposite(labels[*a], labels[*b]));
        if let Some([face, other]) = opposite.min_by_key(|[face, _]| self.order[*face]) {
            let (label, other) = (labels[face], self.order[other]);
            return Err(self.wrong(face, LabelProblem::Opposite { label, other }));
        }
        let crowded = (0..graph.vertices() as u32).filter(|&v| graph.border_edges_at(v, labels) > MOST_BORDERS);
        let first = |v: u32| {
            graph
                .faces_at(v)
                .iter()
                .map(|&f| f as usize)
                .min_by_key(|&f| self.order[f])
        };
        let at_crowded = crowded.filter_map(|v| Some((v, first(v)?)));
        if let Some((v, face)) = at_crowded.min_by_key(|(_, face)| self.order[*face]) {
            let borders = graph.border_edges_at(v, labels);
            return Err(self.wrong(face, LabelProblem::Crowded { borders }));
        }
        let charts = graph.charts(labels);
        for (chart, loops) in charts.loops.iter().enumerate() {
            if loops.is_empty() {
                let place = ChartPlace::new(chart, graph, &charts, self.nodes);
                return Err(self.wrong_chart(chart, &charts, LabelProblem::Whole(place)));
            }
            if let Some(short) = loops.iter().find(|l| l.corners.len() < LEAST_CORNERS) {
                let problem = LabelProblem::FewCorners {
                    chart: ChartPlace::new(chart, graph, &charts, self.nodes),
                    corners: short.corners.len(),
                };
                let faces = short.vertices.iter().flat_map(|&v| graph.faces_at(v));
                let of_chart = faces
                    .map(|&f| f as usize)
                    .filter(|&f| charts.of_face[f] as usize == chart);
                let face = of_chart.min_by_key(|&f| self.order[f]).unwrap_or_default();
                return Err(self.wrong(face, problem));
            }
        }
        Ok(())
    }

    /// Checks whether there is a layout for a flattened solid: with its nodes at `x`.
    pub fn check_layout(&self, graph: &FaceGraph, x: &[Point]) -> Result<(), MakePolycubeError> {
        let charts = graph.charts(&self.labels);
        if Layout::new(graph, &charts, x).is_some_and(|layout| layout.is_possible()) {
            return Ok(());
        }
        let at_fault = Layout::contradiction(graph, &charts, x);
        let place = |&chart: &usize| ChartPlace::new(chart, graph, &charts, self.nodes);
        let problem = LabelProblem::NoLayout(at_fault.iter().map(place).collect());
        let first = at_fault.first().copied().unwrap_or_default();
        Err(self.wrong_chart(first, &charts, problem))
    }

    fn wrong(&self, face: usize, problem: LabelProblem) -> MakePolycubeError {
        let triangle = self.order.get(face).copied().unwrap_or_default();
        MakePolycubeError::Labels { triangle, problem }
    }

    /// A problem of a whole chart, by its first triangle.
    fn wrong_chart(&self, chart: usize, charts: &Charts, problem: LabelProblem) -> MakePolycubeError {
        let faces = (0..self.order.len()).filter(|&f| charts.of_face[f] as usize == chart);
        let face = faces.min_by_key(|&f| self.order[f]).unwrap_or_default();
        self.wrong(face, problem)
    }
}
