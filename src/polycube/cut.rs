//! Axis labels of a surface's triangles by a graph cut.
//!
//! Boykov, Veksler and Zabih, *Fast approximate energy minimization via graph cuts*, IEEE Trans. PAMI 23, 2001, by
//! expansions: each lets the triangles that gain from it take one label together, which is a minimum cut. The network
//! is that of Kolmogorov and Zabih, *What energy functions can be minimized via graph cuts?*, IEEE Trans. PAMI 26,
//! 2004, with no nodes besides the triangles. The cost of a border between two labels is 0 if they are equal, 2 if they
//! are opposite, else 1. That is a metric (2 ≤ 1 + 1), so that every expansion is a minimum cut without changes to the
//! energy.

use super::axis_of;
use super::face_graph::{FaceGraph, LABELS, are_opposite};
use super::max_flow::CubicNetwork;
use crate::{Point, Vector};

/// How often all labels are tried.
const SWEEPS: usize = 4;
/// By how much the cosine between a normal and its label's direction may fall short before it costs.
const DATA_WIDTH: f64 = 0.2;
/// The cost of a normal that points against its label's direction.
const BACKWARD: f64 = 3.0;
/// By how much the cosine between the normals beside an edge may fall short before it is a crease.
const CREASE_WIDTH: f64 = 0.25;
/// What a border along a sharp crease costs; one on a flat surface costs 1.
const CREASE_COST: f64 = 0.3;
/// The greatest weight of borders; data no longer matters then.
const LARGEST_SMOOTHNESS: f64 = 1e6;
/// What all costs together stay below as integers, far from overflow.
const LARGEST_ENERGY: f64 = (1_u64 << 60) as f64;

/// What borders between labels cost.
#[derive(Debug, Clone, Copy)]
pub(super) struct BorderOptions<'a> {
    /// The weight of borders.
    pub smoothness: f64,
    /// Edges along which they cost nothing, by their ends, ascending.
    pub free_edges: &'a [[u32; 2]],
}

/// Lowers the energy of `labels`, one a triangle, by at most 4 sweeps of expansions; from the labels of least data cost
/// if they have the wrong number or do not exist.
///
/// Data costs are shares of the area times how far the normals of `current`, perhaps deformed, are from the label's
/// direction; nothing for triangles without area. Borders cost the smoothness times their length, divided by the root of
/// the area; less along creases, nothing along free edges. Lengths, areas and creases are those of `original`. The labels that come out are the
/// same on every run, and never have a higher energy than those given.
pub(super) fn cut_labels(
    faces: &FaceGraph,
    original: &[Point],
    current: &[Point],
    borders: &BorderOptions,
    labels: &mut Vec<u8>,
) {
    let data = data_costs(faces, original, current);
    if labels.len() != data.len() || labels.iter().any(|&l| usize::from(l) >= LABELS) {
        *labels = best_labels(&data);
    }
    let energy = Energy::new(faces, &data, &border_costs(faces, original, borders));
    let mut network = CubicNetwork::new((0..3 * data.len() as u32).map(|h| faces.twin(h)).collect());
    let order = expansion_order(&data);
    let mut last_change = None;
    for turn in 0..SWEEPS * LABELS {
        // Another expansion of the same label changes nothing if no other label did.
        if turn >= last_change.map_or(LABELS, |t| t + LABELS) {
            break;
        }
        if energy.expand(order[turn % LABELS], labels, &mut network) {
            last_change = Some(turn);
        }
    }
}

/// The cost of each label on each triangle: its share of the original area, times 0 where the current normal has the
/// label's direction, nearly 1 where it is 45° away or more, and up to 4 where it is opposite. Costs of a triangle
/// without area, or with positions that are not finite, are 0.
pub(super) fn data_costs(faces: &FaceGraph, original: &[Point], current: &[Point]) -> Vec<[f64; LABELS]> {
    let areas: Vec<f64> = faces.triangles.iter().map(|t| area(area_vector(t, original))).collect();
    let total: f64 = areas.iter().sum();
    let costs = |(t, &area): (&[u32; 3], &f64)| {
        let share = area / total;
        let Some(normal) = area_vector(t, current).try_normalize(0.0) else {
            return [0.0; LABELS];
        };
        if share > 0.0 && normal.iter().all(|x| x.is_finite()) {
            std::array::from_fn(|label| share * misfit(normal.dot(&direction(label as u8))))
        } else {
            [0.0; LABELS]
        }
    };
    faces.triangles.iter().zip(&areas).map(costs).collect()
}

/// The label of least cost for each triangle; the first of equal ones.
pub(super) fn best_labels(data: &[[f64; LABELS]]) -> Vec<u8> {
    let best = |costs: &[f64; LABELS]| (0..LABELS).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0) as u8;
    data.iter().map(best).collect()
}

/// The unit vector that a label stands for.
pub(super) fn direction(label: u8) -> Vector {
    let mut direction = Vector::zeros();
    direction[axis_of(label)] = if label % 2 == 1 { 1.0 } else { -1.0 };
    direction
}

/// The cost of a unit of area, from the cosine between normal and label.
fn misfit(cosine: f64) -> f64 {
    1.0 - gaussian(cosine - 1.0, DATA_WIDTH) + BACKWARD * (-cosine).max(0.0)
}

fn gaussian(x: f64, width: f64) -> f64 {
    (-0.5 * (x / width).powi(2)).exp()
}

/// The normal of a triangle times twice its area.
fn area_vector(triangle: &[u32; 3], points: &[Point]) -> Vector {
    let [a, b, c] = triangle.map(|v| points[v as usize]);
    (b - a).cross(&(c - a))
}

/// An area of 0 for what is not finite.
fn area(area_vector: Vector) -> f64 {
    let area = 0.5 * area_vector.norm();
    if area.is_finite() { area } else { 0.0 }
}

/// The cost of a border along each half-edge between labels that are not opposite.
fn border_costs(faces: &FaceGraph, original: &[Point], borders: &BorderOptions) -> Vec<[f64; 3]> {
    let vectors: Vec<Vector> = faces.triangles.iter().map(|t| area_vector(t, original)).collect();
    let total: f64 = vectors.iter().map(|&v| area(v)).sum();
    let normals: Vec<Vector> = vectors
        .iter()
        .map(|v| v.try_normalize(0.0).unwrap_or_else(Vector::zeros))
        .collect();
    // What is not a number counts as 0.
    let smoothness = if borders.smoothness > 0.0 {
        borders.smoothness.min(LARGEST_SMOOTHNESS)
    } else {
        0.0
    };
    let weight = smoothness / total.sqrt();
    let cost = |face: usize, k: usize| {
        let t = faces.triangles[face];
        let [a, b] = [t[k], t[(k + 1) % 3]];
        if borders.free_edges.binary_search(&[a.min(b), a.max(b)]).is_ok() {
            return 0.0;
        }
        let length = (original[a as usize] - original[b as usize]).norm();
        let cosine = normals[face].dot(&normals[faces.neighbours[face][k] as usize]);
        let cost = weight * length * (CREASE_COST + (1.0 - CREASE_COST) * gaussian(cosine - 1.0, CREASE_WIDTH));
        if cost.is_finite() { cost } else { 0.0 }
    };
    (0..normals.len())
        .map(|face| std::array::from_fn(|k| cost(face, k)))
        .collect()
}

/// Labels by decreasing number of triangles that they fit best, so that turning the axes turns the result with them.
fn expansion_order(data: &[[f64; LABELS]]) -> [u8; LABELS] {
    let mut cover = [0_usize; LABELS];
    for label in best_labels(data) {
        cover[usize::from(label)] += 1;
    }
    let mut order: [u8; LABELS] = std::array::from_fn(|label| label as u8);
    order.sort_by_key(|&label| std::cmp::Reverse(cover[usize::from(label)]));
    order
}

/// The energy of labellings in integers, so that energies compare exactly.
struct Energy {
    /// The cost of each label on each triangle.
    data: Vec<[i64; LABELS]>,
    /// The cost of a border along each half-edge, the same for both of an edge.
    borders: Vec<i64>,
}

/// The cost of a border between two labels, as a multiple of the edge's.
fn label_distance(a: u8, b: u8) -> i64 {
    i64::from(a != b) + i64::from(are_opposite(a, b))
}

impl Energy {
    fn new(faces: &FaceGraph, data: &[[f64; LABELS]], borders: &[[f64; 3]]) -> Self {
        let borders = borders.as_flattened();
        // A half-edge's cost counts twice between opposite labels.
        let bound = data.as_flattened().iter().sum::<f64>() + 2.0 * borders.iter().sum::<f64>();
        let scale = LARGEST_ENERGY / bound.max(f64::MIN_POSITIVE.sqrt());
        let integer = |cost: f64| (cost * scale).round() as i64;
        let of_edge = |half_edge: usize| borders[half_edge.min(faces.twin(half_edge as u32) as usize)];
        Self {
            data: data.iter().map(|costs| costs.map(integer)).collect(),
            borders: (0..borders.len()).map(|h| integer(of_edge(h))).collect(),
        }
    }

    /// Lets triangles change to `label` so that the energy becomes the least possible by one such change; of equally
    /// good ones the fewest triangles. Whether any changed; the energy is lower then.
    fn expand(&self, label: u8, labels: &mut [u8], network: &mut CubicNetwork) -> bool {
        network.clear();
        for (face, costs) in self.data.iter().enumerate() {
            network.add_from_source(face, costs[usize::from(labels[face])] - costs[usize::from(label)]);
        }
        self.add_borders(label, labels, network);
        network.solve();
        let mut changed = false;
        for (face, old) in labels.iter_mut().enumerate() {
            // Nothing speaks for a triangle that has the label already to change, so that it may be on either side.
            if network.is_on_source_side(face) && *old != label {
                *old = label;
                changed = true;
            }
        }
        changed
    }

    /// The source's side takes the label. With the costs `both` of an edge if no side does, `first` if only the second
    /// side and `second` if only the first one, its cost is `both`, plus `second − both` if the first does, minus
    /// `second` if the second does, plus the rest of an arc from the second to the first.
    fn add_borders(&self, label: u8, labels: &[u8], network: &mut CubicNetwork) {
        for half_edge in 0..self.borders.len() {
            let twin = network.twin(half_edge);
            let (one, other) = (labels[half_edge / 3], labels[twin / 3]);
            if twin < half_edge || (one == label && other == label) {
                continue;
            }
            let cost = |a, b| self.borders[half_edge] * label_distance(a, b);
            let (both, first, second) = (cost(one, other), cost(one, label), cost(label, other));
            network.add_from_source(half_edge / 3, both - second);
            network.add_from_source(twin / 3, second);
            network.add_to_arc(twin, first + second - both);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polycube::face_graph::shapes;

    fn smooth(smoothness: f64) -> BorderOptions<'static> {
        BorderOptions {
            smoothness,
            free_edges: &[],
        }
    }

    /// The energy of a labelling, exactly.
    fn energy_of(energy: &Energy, faces: &FaceGraph, labels: &[u8]) -> i64 {
        let data: i64 = energy
            .data
            .iter()
            .zip(labels)
            .map(|(costs, &l)| costs[usize::from(l)])
            .sum();
        let borders: i64 = (0..energy.borders.len())
            .map(|h| {
                let twin = faces.twin(h as u32) as usize;
                energy.borders[h] * label_distance(labels[h / 3], labels[twin / 3])
            })
            .sum();
        // Each edge has two half-edges.
        data + borders / 2
    }

    fn energy(faces: &FaceGraph, points: &[Point], smoothness: f64) -> Energy {
        let data = data_costs(faces, points, points);
        Energy::new(faces, &data, &border_costs(faces, points, &smooth(smoothness)))
    }

    #[test]
    fn an_expansion_is_the_best_of_all_changes_to_one_label() {
        let (faces, points) = shapes::octahedron([1.0, 0.7, 1.3]);
        let mut random = shapes::numbers(5);
        let mut network = CubicNetwork::new((0..24).map(|h| faces.twin(h)).collect());
        for _ in 0..300 {
            let energy = energy(&faces, &points, 0.01 * random(20) as f64);
            let start: Vec<u8> = (0..8).map(|_| random(6) as u8).collect();
            let label = random(6) as u8;
            let after = |set: u32| -> Vec<u8> {
                (0..8)
                    .map(|f| if set >> f & 1 == 1 { label } else { start[f] })
                    .collect()
            };
            let best = (0..256)
                .map(|set| energy_of(&energy, &faces, &after(set)))
                .min()
                .unwrap();
            let mut labels = start.clone();
            let changed = energy.expand(label, &mut labels, &mut network);
            assert_eq!(energy_of(&energy, &faces, &labels), best);
            assert_eq!(changed, best < energy_of(&energy, &faces, &start));
        }
    }

    #[test]
    fn cuts_never_raise_the_energy_and_lower_that_of_noise() {
        let (faces, points) = shapes::sphere(16);
        let mut random = shapes::numbers(6);
        for smoothness in [0.0, 0.01, 0.1, 10.0] {
            let energy = energy(&faces, &points, smoothness);
            let noise: Vec<u8> = (0..faces.triangles.len()).map(|_| random(6) as u8).collect();
            let mut labels = noise.clone();
            cut_labels(&faces, &points, &points, &smooth(smoothness), &mut labels);
            let after = energy_of(&energy, &faces, &labels);
            assert!(after < energy_of(&energy, &faces, &noise));
            cut_labels(&faces, &points, &points, &smooth(smoothness), &mut labels);
            assert!(energy_of(&energy, &faces, &labels) <= after);
        }
    }

    #[test]
    fn without_smoothness_every_triangle_takes_its_best_label() {
        let (faces, points) = shapes::sphere(8);
        let mut labels = vec![0; faces.triangles.len()];
        cut_labels(&faces, &points, &points, &smooth(0.0), &mut labels);
        let data = data_costs(&faces, &points, &points);
        for (face, costs) in data.iter().enumerate() {
            // Up to what is lost by rounding to integers.
            let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(costs[usize::from(labels[face])] <= least + 1e-15);
        }
    }

    #[test]
    fn noise_on_a_turned_box_disappears() {
        let (faces, points) = shapes::turned_box(12, 0.2);
        let clean = best_labels(&data_costs(&faces, &points, &points));
        let mut labels = clean.clone();
        shapes::add_noise(&mut labels, 7);
        assert_ne!(labels, clean);
        cut_labels(&faces, &points, &points, &smooth(0.01), &mut labels);
        assert_eq!(labels, clean);
        assert_eq!(faces.charts(&labels).labels.len(), 6);
    }

    #[test]
    fn borders_follow_free_edges() {
        let (faces, points) = shapes::turned_box(12, 0.2);
        let free: Vec<[u32; 2]> = {
            let surface = crate::mesh::SurfaceMesh::new(points.clone(), faces.triangles.clone()).unwrap();
            crate::mesh::creases(&surface, 0.5)
        };
        let clean = best_labels(&data_costs(&faces, &points, &points));
        // With so much smoothness all triangles get one label.
        let smoothness = 100.0;
        let mut labels = clean.clone();
        cut_labels(&faces, &points, &points, &smooth(smoothness), &mut labels);
        assert_eq!(faces.charts(&labels).labels.len(), 1);
        let mut labels = clean.clone();
        let borders = BorderOptions {
            smoothness,
            free_edges: &free,
        };
        cut_labels(&faces, &points, &points, &borders, &mut labels);
        assert_eq!(labels, clean);
    }

    #[test]
    fn turning_the_axes_turns_the_labels() {
        let (faces, points) = shapes::bumpy_sphere(20);
        let turn = |p: &Point| Point::new(p.z, p.x, p.y);
        let turned: Vec<Point> = points.iter().map(turn).collect();
        let (mut labels, mut labels_of_turned) = (Vec::new(), Vec::new());
        cut_labels(&faces, &points, &points, &smooth(0.01), &mut labels);
        cut_labels(&faces, &turned, &turned, &smooth(0.01), &mut labels_of_turned);
        let expected: Vec<u8> = labels.iter().map(|l| (l + 2) % 6).collect();
        assert_eq!(labels_of_turned, expected);
    }

    #[test]
    fn defective_input_gives_labels() {
        let (faces, mut points) = shapes::octahedron([1.0, 1.0, 1.0]);
        let flat = vec![Point::origin(); points.len()];
        points[2].x = f64::NAN;
        for (original, current) in [(&flat, &flat), (&points, &flat), (&points, &points)] {
            for smoothness in [0.01, f64::NAN, f64::INFINITY, -1.0, f64::MAX] {
                let mut labels = vec![9; 8];
                cut_labels(&faces, original, current, &smooth(smoothness), &mut labels);
                assert!(labels.len() == 8 && labels.iter().all(|&l| l < 6));
            }
        }
    }
}
