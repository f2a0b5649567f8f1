//! Repair of axis labels, so that charts, corners and borders can be those of a polycube.
//!
//! Every boundary loop of a chart needs four corners, a vertex has at most three border edges, opposite labels do not
//! touch, and no chart is a whole component. (Necessary conditions of polycubes; see Livesu, Vining, Sheffer, Gregson
//! and Scateni, *`PolyCut`: monotone graph-cuts for polycube base-complex construction*, ACM Trans. Graph. 32, 2013.)
//! Weighted faults make a score, which moves of whole charts or of rings of triangles lower: first greedily, then, where
//! none lowers it, by tabu search (Glover, *Tabu search, part I*, ORSA J. Computing 1, 1989) among labellings not seen
//! before. Among moves, those are preferred whose labels fit the normals.

use std::collections::BTreeSet;

use super::cut::data_costs;
use super::face_graph::{Charts, FaceGraph, LABELS, are_opposite};
use crate::Point;

/// Corners that a polycube's boundary loops have at least.
pub(super) const LEAST_CORNERS: usize = 4;
/// Border edges that a vertex has at most.
pub(super) const MOST_BORDERS: usize = 3;
/// What faults add to the score. They are doubled, for whole numbers.
const LOOP_WEIGHT: u64 = 6;
const VERTEX_WEIGHT: u64 = 2;
const EDGE_WEIGHT: u64 = 1;
const SINGLE_WEIGHT: u64 = 2000;
/// The data cost, a share of the area, that a unit of score is worth.
const COST_OF_SCORE: f64 = 0.003;
/// Passes over all faults in which moves must lower the score: the most data cost for a unit of it.
const GREEDY_PASSES: [f64; 8] = [1e-4, 3e-4, 1e-3, 1e-3, 3e-3, 3e-3, f64::INFINITY, f64::INFINITY];
/// Moves of the tabu search, and how many of them may go by without a new best score.
const TABU_MOVES: usize = 200;
const PATIENCE: usize = 40;
/// Faults whose moves a tabu step compares.
const FAULTS_COMPARED: usize = 24;
/// Triangles relabelled in trials, as a multiple of all, before the search ends.
const EFFORT: usize = 400;
/// The widest strip of triangles around a vertex or an edge that takes a label, in rings.
const RINGS: usize = 3;

/// Faults of a labelling by kind, with one vertex of each; a vertex may come more than once.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct LabelFaults {
    /// A vertex of each boundary loop with fewer than four corners.
    pub short_loops: Vec<u32>,
    /// Vertices with more than three border edges.
    pub crowded_vertices: Vec<u32>,
    /// The first vertex of each edge between opposite labels.
    pub opposite_edges: Vec<u32>,
    /// A vertex of each component that is a single chart.
    pub single_charts: Vec<u32>,
}

impl LabelFaults {
    /// The faults of a labelling, with one label a triangle.
    pub fn find(faces: &FaceGraph, labels: &[u8]) -> Self {
        Self::among(faces, labels, &faces.charts(labels))
    }

    fn among(faces: &FaceGraph, labels: &[u8], charts: &Charts) -> Self {
        let mut faults = Self::default();
        for loops in &charts.loops {
            let short = loops.iter().filter(|l| l.corners.len() < LEAST_CORNERS);
            faults.short_loops.extend(short.map(|l| l.vertices[0]));
        }
        let vertices = 0..faces.vertices() as u32;
        faults.crowded_vertices = vertices
            .filter(|&v| faces.border_edges_at(v, labels) > MOST_BORDERS)
            .collect();
        let edges = (0..3 * labels.len() as u32).filter(|&h| h < faces.twin(h));
        let opposite = edges.filter(|&h| are_opposite(labels[h as usize / 3], labels[faces.twin(h) as usize / 3]));
        faults.opposite_edges = opposite.map(|h| faces.start(h)).collect();
        let single = (0..charts.labels.len()).filter(|&c| charts.loops[c].is_empty());
        let first_vertex = |chart: usize| {
            let face = charts.of_face.iter().position(|&c| c as usize == chart);
            faces.triangles[face.unwrap_or(0)][0]
        };
        faults.single_charts = single.map(first_vertex).collect();
        faults
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.score() == 0
    }

    /// The weighted number of faults that the repair lowers: 6 a loop, 2 a vertex, 1 an edge, 2000 a single chart.
    pub fn score(&self) -> u64 {
        LOOP_WEIGHT * self.short_loops.len() as u64
            + VERTEX_WEIGHT * self.crowded_vertices.len() as u64
            + EDGE_WEIGHT * self.opposite_edges.len() as u64
            + SINGLE_WEIGHT * self.single_charts.len() as u64
    }
}

/// Changes `labels`, one a triangle, until they have no faults or no more moves are found, and returns the faults left.
///
/// Fits labels to the normals of `current` where there is a choice, weighted by the areas of `original`. The score of
/// the faults never ends higher than it was, and the result is the same on every run. The work is bounded by a few
/// hundred visits of every triangle.
pub(super) fn repair_labels(
    faces: &FaceGraph,
    original: &[Point],
    current: &[Point],
    labels: &mut [u8],
) -> LabelFaults {
    let mut faults = LabelFaults::find(faces, labels);
    if faults.is_empty() {
        return faults;
    }
    let mut search = Search::new(faces, data_costs(faces, original, current), labels);
    search.greedy();
    search.tabu();
    let found = LabelFaults::find(faces, &search.best);
    if found.score() < faults.score() {
        labels.copy_from_slice(&search.best);
        faults = found;
    }
    faults
}

/// Triangles that take a label together.
struct Move {
    faces: Vec<u32>,
    label: u8,
}

/// What a move does.
#[derive(Clone, Copy)]
struct Effect {
    score: i64,
    cost: f64,
    /// Changes the fingerprint of the labelling, by exclusive or.
    fingerprint: u64,
}

impl Effect {
    /// Lower is better.
    fn rank(&self) -> f64 {
        self.cost + COST_OF_SCORE * self.score as f64
    }
}

/// A place to repair.
enum Fault {
    /// A half-edge of a boundary loop with too few corners.
    Loop(u32),
    /// A vertex with too many border edges.
    Vertex(u32),
    /// Vertices of a border path between opposite labels.
    Edges(Vec<u32>),
    /// A triangle of a component without borders.
    Single(u32),
}

/// Marks of indices that are cleared all at once.
struct Marks {
    of: Vec<u32>,
    now: u32,
}

impl Marks {
    fn new(length: usize) -> Self {
        Self {
            of: vec![0; length],
            now: 0,
        }
    }

    fn clear(&mut self) {
        if self.now == u32::MAX {
            self.of.fill(0);
            self.now = 0;
        }
        self.now += 1;
    }

    /// Whether the index was not marked before.
    fn mark(&mut self, index: u32) -> bool {
        let is_new = self.of[index as usize] != self.now;
        self.of[index as usize] = self.now;
        is_new
    }

    fn is_marked(&self, index: u32) -> bool {
        self.of[index as usize] == self.now
    }
}

struct Search<'a> {
    faces: &'a FaceGraph,
    costs: Vec<[f64; LABELS]>,
    labels: Vec<u8>,
    score: i64,
    best: Vec<u8>,
    best_score: i64,
    component: Vec<u32>,
    /// The number of border edges of each component.
    borders: Vec<i64>,
    /// Triangles changed by the move on trial, and their labels before; a triangle may come more than once.
    changes: Vec<(u32, u8)>,
    face_marks: Marks,
    vertex_marks: Marks,
    edge_marks: Marks,
    effort: usize,
}

impl<'a> Search<'a> {
    fn new(faces: &'a FaceGraph, costs: Vec<[f64; LABELS]>, labels: &[u8]) -> Self {
        let mut labels = labels.to_vec();
        labels.iter_mut().for_each(|l| *l %= LABELS as u8);
        let (component, components) = faces.components();
        let mut borders = vec![0; components];
        for half_edge in (0..3 * labels.len() as u32).filter(|&h| h < faces.twin(h)) {
            borders[component[half_edge as usize / 3] as usize] += i64::from(faces.is_border(half_edge, &labels));
        }
        let score = LabelFaults::find(faces, &labels).score() as i64;
        Self {
            best: labels.clone(),
            best_score: score,
            score,
            component,
            borders,
            changes: Vec::new(),
            face_marks: Marks::new(labels.len()),
            vertex_marks: Marks::new(faces.vertices()),
            edge_marks: Marks::new(3 * labels.len()),
            effort: EFFORT * labels.len(),
            faces,
            costs,
            labels,
        }
    }

    /// Passes over all faults; each takes the best of those of its moves that lower the score.
    fn greedy(&mut self) {
        self.flip_all_ears();
        for most in GREEDY_PASSES {
            for fault in self.faults(usize::MAX) {
                let moves = self.moves(&fault);
                let improving = |effect: &Effect| effect.score < 0 && effect.cost <= -most * effect.score as f64;
                if let Some((chosen, _)) = self.best_move(moves, improving) {
                    self.take(&chosen);
                }
            }
            if self.score == 0 || self.effort == 0 {
                break;
            }
        }
    }

    /// Takes the best move even where it raises the score, but to no labelling twice.
    fn tabu(&mut self) {
        let mut fingerprint = 0;
        let mut seen = BTreeSet::from([fingerprint]);
        let mut idle = 0;
        for _ in 0..TABU_MOVES {
            if self.score == 0 || idle == PATIENCE || self.effort == 0 {
                break;
            }
            let mut moves = Vec::new();
            for fault in self.faults(FAULTS_COMPARED) {
                moves.extend(self.moves(&fault));
            }
            let is_new = |effect: &Effect| !seen.contains(&(fingerprint ^ effect.fingerprint));
            let Some((chosen, effect)) = self.best_move(moves, is_new) else {
                break;
            };
            fingerprint ^= effect.fingerprint;
            seen.insert(fingerprint);
            let best_before = self.best_score;
            self.take(&chosen);
            idle = if self.best_score < best_before { 0 } else { idle + 1 };
        }
    }

    /// The move of lowest rank among those allowed; the first of equal ones.
    fn best_move(&mut self, moves: Vec<Move>, is_allowed: impl Fn(&Effect) -> bool) -> Option<(Move, Effect)> {
        let mut best: Option<(Move, Effect)> = None;
        for candidate in moves {
            if self.effort == 0 {
                break;
            }
            let effect = self.try_move(&candidate);
            self.undo();
            let is_better = best.as_ref().is_none_or(|(_, least)| effect.rank() < least.rank());
            if effect.fingerprint != 0 && is_better && is_allowed(&effect) {
                best = Some((candidate, effect));
            }
        }
        best
    }

    fn take(&mut self, chosen: &Move) {
        let effect = self.try_move(chosen);
        self.changes.clear();
        self.score += effect.score;
        if self.score < self.best_score {
            self.best_score = self.score;
            self.best.copy_from_slice(&self.labels);
        }
    }

    /// Makes a move and flips the ears that it leaves. [`Self::undo`] takes both back.
    fn try_move(&mut self, candidate: &Move) -> Effect {
        self.changes.clear();
        for &face in &candidate.faces {
            self.relabel(face, candidate.label);
        }
        self.flip_ears_near_changes();
        self.effort = self.effort.saturating_sub(self.changes.len() + 20);
        self.effect_of_changes()
    }

    fn relabel(&mut self, face: u32, label: u8) {
        let old = self.labels[face as usize];
        if old != label {
            self.changes.push((face, old));
            self.labels[face as usize] = label;
            for k in 0..3 {
                let beside = self.labels[self.faces.neighbours[face as usize][k] as usize];
                self.borders[self.component[face as usize] as usize] += i64::from(beside == old);
                self.borders[self.component[face as usize] as usize] -= i64::from(beside == label);
            }
        }
    }

    fn undo(&mut self) {
        for (face, old) in std::mem::take(&mut self.changes).into_iter().rev() {
            self.relabel(face, old);
        }
        self.changes.clear();
    }

    /// The label of at least two neighbours of a triangle, if it is not its own.
    fn label_of_ear(&self, face: u32) -> Option<u8> {
        let [a, b, c] = self.faces.neighbours[face as usize].map(|n| self.labels[n as usize]);
        let common = if a == b || a == c { a } else { b };
        let is_common = a == b || b == c || c == a;
        (is_common && common != self.labels[face as usize]).then_some(common)
    }

    /// Each flip shortens the borders, so that this ends.
    fn flip_ears_near_changes(&mut self) {
        let mut next = 0;
        while next < self.changes.len() {
            let face = self.changes[next].0;
            let [a, b, c] = self.faces.neighbours[face as usize];
            for near in [face, a, b, c] {
                if let Some(label) = self.label_of_ear(near) {
                    self.relabel(near, label);
                }
            }
            next += 1;
        }
    }

    /// Flips all ears, unless that raises the score.
    fn flip_all_ears(&mut self) {
        self.changes.clear();
        for face in 0..self.labels.len() as u32 {
            if let Some(label) = self.label_of_ear(face) {
                self.relabel(face, label);
            }
        }
        self.flip_ears_near_changes();
        let after = LabelFaults::find(self.faces, &self.labels).score() as i64;
        if after <= self.score {
            self.score = after;
            self.best_score = after;
            self.best.copy_from_slice(&self.labels);
            self.changes.clear();
        } else {
            self.undo();
        }
    }

    /// Compares the labelling with that before the changes, in those loops, vertices and edges that they touch. All of
    /// the changes are in one component.
    fn effect_of_changes(&mut self) -> Effect {
        let changes = std::mem::take(&mut self.changes);
        let mut changed: Vec<(u32, u8)> = Vec::with_capacity(changes.len());
        self.face_marks.clear();
        for &(face, old) in &changes {
            if self.face_marks.mark(face) && self.labels[face as usize] != old {
                changed.push((face, old));
            }
        }
        let Some(&(first, _)) = changed.first() else {
            self.changes = changes;
            return Effect {
                score: 0,
                cost: 0.0,
                fingerprint: 0,
            };
        };
        // Only those whose label really differs stay marked.
        self.face_marks.clear();
        for &(face, _) in &changed {
            self.face_marks.mark(face);
        }
        let component = self.component[first as usize] as usize;
        let mut effect = Effect {
            score: self.local_score(&changed, component),
            cost: 0.0,
            fingerprint: 0,
        };
        for (face, old) in &mut changed {
            let new = self.labels[*face as usize];
            let costs = self.costs[*face as usize];
            effect.cost += costs[usize::from(new)] - costs[usize::from(*old)];
            effect.fingerprint ^= fingerprint(*face, new) ^ fingerprint(*face, *old);
        }
        let new = self.exchange(&changed);
        effect.score -= self.local_score(&changed, component);
        self.exchange(&new);
        self.changes = changes;
        effect
    }

    /// Sets labels, and returns those before.
    fn exchange(&mut self, labels: &[(u32, u8)]) -> Vec<(u32, u8)> {
        let mut before = Vec::with_capacity(labels.len());
        for &(face, label) in labels {
            before.push((face, self.labels[face as usize]));
            self.relabel(face, label);
        }
        before
    }

    /// The score of loops and vertices at triangles that are marked, of their edges, and of the component.
    fn local_score(&mut self, changed: &[(u32, u8)], component: usize) -> i64 {
        let mut score = if self.borders[component] == 0 { SINGLE_WEIGHT } else { 0 };
        self.vertex_marks.clear();
        self.edge_marks.clear();
        for &(face, _) in changed {
            let label = self.labels[face as usize];
            for k in 0..3 {
                let other = self.faces.neighbours[face as usize][k];
                let is_counted_there = self.face_marks.is_marked(other) && other < face;
                if are_opposite(label, self.labels[other as usize]) && !is_counted_there {
                    score += EDGE_WEIGHT;
                }
                let vertex = self.faces.triangles[face as usize][k];
                if self.vertex_marks.mark(vertex) {
                    score += self.score_at(vertex);
                }
            }
        }
        score as i64
    }

    /// The score of a vertex and of those loops through it that are not marked yet.
    fn score_at(&mut self, vertex: u32) -> u64 {
        let faces = self.faces;
        let borders = faces.border_edges_at(vertex, &self.labels);
        if borders == 0 {
            return 0;
        }
        let mut score = if borders > MOST_BORDERS { VERTEX_WEIGHT } else { 0 };
        for &face in faces.faces_at(vertex) {
            let half_edge = faces.leaving(vertex, face);
            if faces.is_border(half_edge, &self.labels) && !self.edge_marks.is_marked(half_edge) {
                score += if self.corners_of_loop(half_edge) < LEAST_CORNERS {
                    LOOP_WEIGHT
                } else {
                    0
                };
            }
        }
        score
    }

    /// The number of corners of the loop of a border half-edge, which marks its half-edges.
    fn corners_of_loop(&mut self, mut half_edge: u32) -> usize {
        let mut corners = 0;
        while self.edge_marks.mark(half_edge) {
            corners += usize::from(self.faces.border_edges_at(self.faces.start(half_edge), &self.labels) > 2);
            half_edge = self.faces.next_on_border(half_edge, &self.labels);
        }
        corners
    }

    /// At most so many faults, of small charts first.
    fn faults(&self, most: usize) -> Vec<Fault> {
        let faces = self.faces;
        let charts = faces.charts(&self.labels);
        let found = LabelFaults::among(faces, &self.labels, &charts);
        let mut sizes = vec![0_usize; charts.labels.len()];
        charts.of_face.iter().for_each(|&c| sizes[c as usize] += 1);
        let mut loops: Vec<(usize, u32)> = Vec::new();
        for (chart, borders) in charts.loops.iter().enumerate() {
            for border in borders.iter().filter(|l| l.corners.len() < LEAST_CORNERS) {
                loops.push((
                    sizes[chart],
                    self.border_from(border.vertices[0], chart as u32, &charts.of_face),
                ));
            }
        }
        loops.sort_unstable();
        let mut faults: Vec<Fault> = loops.into_iter().map(|(_, half_edge)| Fault::Loop(half_edge)).collect();
        faults.extend(found.single_charts.iter().map(|&v| Fault::Single(faces.faces_at(v)[0])));
        let opposite = charts.paths.into_iter().filter(|p| {
            let [left, right] = p.charts.map(|c| charts.labels[c as usize]);
            are_opposite(left, right)
        });
        faults.extend(opposite.map(|path| Fault::Edges(path.vertices)));
        faults.extend(found.crowded_vertices.iter().map(|&v| Fault::Vertex(v)));
        faults.truncate(most);
        faults
    }

    /// A half-edge of a chart's boundary that leaves this vertex.
    fn border_from(&self, vertex: u32, chart: u32, of_face: &[u32]) -> u32 {
        let fan = self
            .faces
            .faces_at(vertex)
            .iter()
            .filter(|&&face| of_face[face as usize] == chart);
        let mut leaving = fan.map(|&face| self.faces.leaving(vertex, face));
        leaving.find(|&h| self.faces.is_border(h, &self.labels)).unwrap_or(0)
    }

    /// Moves that may repair a fault; none if it has gone.
    fn moves(&mut self, fault: &Fault) -> Vec<Move> {
        match fault {
            Fault::Loop(half_edge) => self.moves_of_loop(*half_edge),
            Fault::Vertex(vertex) => self.moves_at_vertex(*vertex),
            Fault::Edges(vertices) => self.moves_along_edges(vertices),
            Fault::Single(face) => self.moves_of_single(*face),
        }
    }

    /// The chart takes the label of a neighbour, or a neighbour across the loop takes the chart's. Neighbours much
    /// larger than the chart do not.
    fn moves_of_loop(&mut self, half_edge: u32) -> Vec<Move> {
        if !self.faces.is_border(half_edge, &self.labels) {
            return Vec::new();
        }
        self.edge_marks.clear();
        if self.corners_of_loop(half_edge) >= LEAST_CORNERS {
            return Vec::new();
        }
        let label = self.labels[half_edge as usize / 3];
        let chart = self.chart_of(half_edge / 3, usize::MAX);
        let mut beside: Vec<u8> = Vec::new();
        for &face in &chart {
            let around = self.faces.neighbours[face as usize].map(|n| self.labels[n as usize]);
            beside.extend(around.iter().filter(|&&l| l != label));
        }
        beside.sort_unstable();
        beside.dedup();
        let most = 4 * chart.len() + 200;
        let mut moves: Vec<Move> = beside
            .into_iter()
            .map(|label| Move {
                faces: chart.clone(),
                label,
            })
            .collect();
        for across in self.faces_across_loop(half_edge) {
            let neighbour = self.chart_of(across, most);
            if neighbour.len() < most {
                moves.push(Move {
                    faces: neighbour,
                    label,
                });
            }
        }
        moves
    }

    /// A triangle across the loop for each of the paths that corners divide it into.
    fn faces_across_loop(&self, first: u32) -> Vec<u32> {
        let mut across = vec![self.faces.twin(first) / 3];
        let mut half_edge = self.faces.next_on_border(first, &self.labels);
        while half_edge != first {
            let face = self.faces.twin(half_edge) / 3;
            if self.faces.border_edges_at(self.faces.start(half_edge), &self.labels) > 2 {
                across.push(face);
            }
            half_edge = self.faces.next_on_border(half_edge, &self.labels);
        }
        across
    }

    /// Triangles of a chart, in a fixed order; the first `most` of them if it has more.
    fn chart_of(&mut self, seed: u32, most: usize) -> Vec<u32> {
        let label = self.labels[seed as usize];
        self.face_marks.clear();
        self.face_marks.mark(seed);
        let mut chart = vec![seed];
        let mut next = 0;
        while next < chart.len() && chart.len() < most {
            for other in self.faces.neighbours[chart[next] as usize] {
                if self.labels[other as usize] == label && self.face_marks.mark(other) {
                    chart.push(other);
                }
            }
            next += 1;
        }
        self.effort = self.effort.saturating_sub(chart.len());
        chart
    }

    /// One run of equal labels around the vertex takes the label beside it, or rings of triangles take any label.
    fn moves_at_vertex(&mut self, vertex: u32) -> Vec<Move> {
        let fan = self.faces.faces_at(vertex).to_vec();
        if self.faces.border_edges_at(vertex, &self.labels) <= MOST_BORDERS {
            return Vec::new();
        }
        let label_at = |i: usize| self.labels[fan[i % fan.len()] as usize];
        let starts: Vec<usize> = (0..fan.len())
            .filter(|&i| label_at(i) != label_at(i + fan.len() - 1))
            .collect();
        let mut moves = Vec::new();
        for (i, &start) in starts.iter().enumerate() {
            let end = starts.get(i + 1).copied().unwrap_or(starts[0] + fan.len());
            let run: Vec<u32> = (start..end).map(|j| fan[j % fan.len()]).collect();
            moves.push(Move {
                faces: run.clone(),
                label: label_at(start + fan.len() - 1),
            });
            moves.push(Move {
                faces: run,
                label: label_at(end),
            });
        }
        for faces in self.rings(&[vertex]) {
            moves.extend((0..LABELS as u8).map(|label| Move {
                faces: faces.clone(),
                label,
            }));
        }
        moves
    }

    /// Rings of triangles around the edges, or those of them on one side, take a label.
    fn moves_along_edges(&mut self, vertices: &[u32]) -> Vec<Move> {
        let mut moves = Vec::new();
        for faces in self.rings(vertices) {
            let mut sides: Vec<u8> = faces.iter().map(|&f| self.labels[f as usize]).collect();
            sides.sort_unstable();
            sides.dedup();
            let opposite = sides.iter().filter(|&&l| sides.iter().any(|&m| are_opposite(l, m)));
            let one_side = opposite.map(|&l| {
                faces
                    .iter()
                    .copied()
                    .filter(|&f| self.labels[f as usize] == l)
                    .collect()
            });
            let choices: Vec<Vec<u32>> = one_side.collect();
            for faces in choices.into_iter().chain([faces]) {
                moves.extend((0..LABELS as u8).map(|label| Move {
                    faces: faces.clone(),
                    label,
                }));
            }
        }
        moves
    }

    /// The triangles within 1, 2, … rings of some vertices.
    fn rings(&mut self, vertices: &[u32]) -> Vec<Vec<u32>> {
        self.vertex_marks.clear();
        self.face_marks.clear();
        for &vertex in vertices {
            self.vertex_marks.mark(vertex);
        }
        let mut front = vertices.to_vec();
        let mut within = Vec::new();
        let mut rings = Vec::new();
        for _ in 0..RINGS {
            let mut next_front = Vec::new();
            for vertex in front {
                for &face in self.faces.faces_at(vertex) {
                    if self.face_marks.mark(face) {
                        within.push(face);
                    }
                    let corners = self.faces.triangles[face as usize];
                    next_front.extend(corners.into_iter().filter(|&v| self.vertex_marks.mark(v)));
                }
            }
            front = next_front;
            rings.push(within.clone());
        }
        rings
    }

    /// Those triangles of a component that fit a label best take it.
    fn moves_of_single(&mut self, face: u32) -> Vec<Move> {
        let component = self.component[face as usize];
        if self.borders[component as usize] > 0 {
            return Vec::new();
        }
        let all = (0..self.labels.len() as u32).filter(|&f| self.component[f as usize] == component);
        let mut fitting = vec![Vec::new(); LABELS];
        for face in all {
            let costs = &self.costs[face as usize];
            let best = (0..LABELS).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
            fitting[best].push(face);
        }
        let moves = fitting.into_iter().enumerate().filter(|(_, faces)| !faces.is_empty());
        moves
            .map(|(label, faces)| Move {
                faces,
                label: label as u8,
            })
            .collect()
    }
}

/// Spreads triangle and label over 64 bits (the mixer of `SplitMix64`).
fn fingerprint(face: u32, label: u8) -> u64 {
    let mut x = (u64::from(face) * LABELS as u64 + u64::from(label) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polycube::cut::{BorderOptions, best_labels, cut_labels};
    use crate::polycube::face_graph::shapes;

    /// Labels by a cut, repaired; and the numbers of charts and corners.
    fn labelled(faces: &FaceGraph, points: &[Point], noise: bool) -> (Vec<u8>, [usize; 2], LabelFaults) {
        let mut labels = best_labels(&data_costs(faces, points, points));
        if noise {
            shapes::add_noise(&mut labels, 4);
        }
        let borders = BorderOptions {
            smoothness: 0.01,
            free_edges: &[],
        };
        cut_labels(faces, points, points, &borders, &mut labels);
        let faults = repair_labels(faces, points, points, &mut labels);
        assert_eq!(faults, LabelFaults::find(faces, &labels));
        let counts = counts(faces, &labels);
        (labels, counts, faults)
    }

    fn counts(faces: &FaceGraph, labels: &[u8]) -> [usize; 2] {
        let corners = (0..faces.vertices() as u32)
            .filter(|&v| faces.border_edges_at(v, labels) > 2)
            .count();
        [faces.charts(labels).labels.len(), corners]
    }

    #[test]
    fn a_turned_box_has_six_charts_also_from_noise() {
        for angle in [0.0, 0.1, 0.3] {
            let (faces, points) = shapes::turned_box(9, angle);
            let (clean, counts, faults) = labelled(&faces, &points, false);
            assert_eq!((counts, faults.score()), ([6, 8], 0));
            assert_eq!(labelled(&faces, &points, true).0, clean);
        }
    }

    #[test]
    fn noise_is_repaired_without_a_cut() {
        for (faces, points) in [shapes::turned_box(16, 0.1), shapes::sphere(16)] {
            let data = data_costs(&faces, &points, &points);
            let clean = best_labels(&data);
            for seed in 0..5 {
                let mut labels = clean.clone();
                shapes::add_noise(&mut labels, seed);
                let faults = repair_labels(&faces, &points, &points, &mut labels);
                assert!(faults.is_empty(), "{faults:?}");
                let cost = |labels: &[u8]| labels.iter().zip(&data).map(|(&l, d)| d[usize::from(l)]).sum::<f64>();
                // A hundredth of the area, where noise lay on the borders.
                assert!(cost(&labels) < cost(&clean) + 0.01);
            }
        }
    }

    #[test]
    fn a_sphere_has_six_charts_and_eight_corners() {
        for n in [4, 9, 20] {
            let (faces, points) = shapes::sphere(n);
            let (_, counts, faults) = labelled(&faces, &points, false);
            assert_eq!((counts, faults.score()), ([6, 8], 0));
        }
    }

    #[test]
    fn a_sphere_of_one_label_gets_charts() {
        let (faces, points) = shapes::sphere(10);
        let mut labels = vec![3; faces.triangles.len()];
        assert_eq!(LabelFaults::find(&faces, &labels).single_charts.len(), 1);
        let faults = repair_labels(&faces, &points, &points, &mut labels);
        assert!(faults.single_charts.is_empty());
    }

    #[test]
    fn bumps_are_repaired() {
        for n in [12, 20, 31] {
            let (faces, points) = shapes::bumpy_sphere(n);
            let mut labels = best_labels(&data_costs(&faces, &points, &points));
            assert!(!LabelFaults::find(&faces, &labels).is_empty());
            let faults = repair_labels(&faces, &points, &points, &mut labels);
            assert!(faults.is_empty(), "{faults:?}");
        }
    }

    #[test]
    fn an_l_and_a_frame_keep_their_charts() {
        let (faces, points) = shapes::voxels([8, 8, 4], |c| c[0] < 4 || c[1] < 4);
        let (_, counts, faults) = labelled(&faces, &points, true);
        assert_eq!((counts, faults.score()), ([8, 12], 0));
        let (faces, points) = shapes::voxels([9, 9, 3], |c| (c[0] - 4).abs() > 1 || (c[1] - 4).abs() > 1);
        let (_, counts, faults) = labelled(&faces, &points, true);
        assert_eq!((counts, faults.score()), ([10, 16], 0));
    }

    #[test]
    fn a_torus_gets_the_charts_of_a_frame() {
        let (faces, points) = shapes::torus(48);
        let (labels, counts, faults) = labelled(&faces, &points, true);
        assert_eq!((counts, faults.score()), ([10, 16], 0));
        let charts = faces.charts(&labels);
        let rings: Vec<usize> = (0..10).filter(|&c| charts.loops[c].len() == 2).collect();
        assert!(rings.len() == 2 && rings.iter().all(|&c| charts.labels[c] / 2 == 2));
    }

    #[test]
    fn components_are_repaired_each_by_itself() {
        let (faces, points) = shapes::voxels([9, 9, 9], |c| c.iter().any(|&x| !(3..6).contains(&x)));
        assert_eq!(faces.components().1, 2);
        let (_, counts, faults) = labelled(&faces, &points, true);
        assert_eq!((counts, faults.score()), ([12, 16], 0));
    }

    #[test]
    fn any_labels_end_with_no_higher_score_and_the_same_on_every_run() {
        let (faces, points) = shapes::bumpy_sphere(7);
        let mut random = shapes::numbers(9);
        for kinds in [2, 3, 6, 200] {
            let start: Vec<u8> = (0..faces.triangles.len()).map(|_| random(kinds) as u8).collect();
            let (mut once, mut again) = (start.clone(), start.clone());
            let faults = repair_labels(&faces, &points, &points, &mut once);
            assert_eq!(faults, repair_labels(&faces, &points, &points, &mut again));
            assert_eq!(once, again);
            assert_eq!(faults, LabelFaults::find(&faces, &once));
            assert!(faults.score() <= LabelFaults::find(&faces, &start).score());
        }
        let (faces, points) = shapes::octahedron([1.0, f64::NAN, 0.0]);
        repair_labels(&faces, &points, &points, &mut [0; 8]);
    }

    #[test]
    fn effects_are_the_difference_of_whole_scores() {
        let (faces, points) = shapes::torus(16);
        let mut random = shapes::numbers(10);
        let start: Vec<u8> = (0..faces.triangles.len()).map(|_| random(6) as u8).collect();
        let mut search = Search::new(&faces, data_costs(&faces, &points, &points), &start);
        for step in 0..2000 {
            let faces_moved = search.rings(&[random(256) as u32]).swap_remove(random(3) as usize);
            let chosen = Move {
                faces: faces_moved,
                label: random(6) as u8,
            };
            let before = search.labels.clone();
            let effect = search.try_move(&chosen);
            search.undo();
            assert_eq!(search.labels, before);
            search.take(&chosen);
            let whole = LabelFaults::find(&faces, &search.labels).score() as i64;
            assert_eq!(search.score, whole, "step {step}: {}", effect.score);
            let borders: i64 = (0..3 * start.len() as u32)
                .map(|h| i64::from(faces.is_border(h, &search.labels)))
                .sum();
            assert_eq!(search.borders, [borders / 2]);
        }
    }
}
