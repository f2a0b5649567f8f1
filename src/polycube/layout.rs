//! The layout of a polycube, from its charts alone: which of its edges are convex, and in which order its planes come.
//!
//! Seen from a chart with outward normal `n`, an edge towards a chart with normal `m` has that chart's side in the direction
//! `m` if it is convex, and `-m` if it is concave. So the edges' signs say how the boundary of every chart turns at its corners:
//! it has to turn by 360° in all, and the three edges at a corner have to be those of some octants around it. Labels can pass
//! all tests of single charts and corners while no choice of signs does that; and a deformation can have signs that do not fit
//! although others would. With signs that fit, the direction of each edge is known, and with it the order of the two planes that
//! it runs between.

use std::collections::HashMap;

use super::axis_of;
use super::face_graph::{BoundaryLoop, Charts, FaceGraph, next_in_face};
use crate::{Point, Vector};

/// Choices after which a search for signs is given up.
const MOST_CHOICES: usize = 20_000;
/// The same for each of the searches that find out which charts contradict each other.
const FEW_CHOICES: usize = 500;

/// The turn of a chart's boundary at a corner: its paths before and after the corner, and the determinant of the outward normals
/// of the charts across them and the chart itself. The boundary turns to the left if the product of the determinant and both
/// signs is positive.
#[derive(Debug, Clone, Copy)]
struct Turn {
    paths: [usize; 2],
    determinant: i8,
}

/// A boundary loop of a chart.
#[derive(Debug, Clone)]
struct LoopTurns {
    chart: usize,
    turns: Vec<Turn>,
    /// How many of the turns are to the right.
    right: usize,
}

/// A corner: its three paths, and the determinant of the normals of its charts.
#[derive(Debug, Clone)]
struct Corner {
    paths: [usize; 3],
    determinant: i8,
}

/// A sign that was chosen in a search.
#[derive(Debug, Clone, Copy)]
struct Choice {
    path: usize,
    sign: i8,
    /// Length of the trail before.
    trail: usize,
    /// Whether the other sign was tried.
    is_last: bool,
}

/// What the signs of edges have to fulfil.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    corners: Vec<Corner>,
    loops: Vec<LoopTurns>,
    /// By how much each path is convex, as it is now: the mean of the angle between the triangles along it.
    convexity: Vec<f64>,
}

/// The outward normal of a label.
fn normal(label: u8) -> Vector {
    let mut normal = Vector::zeros();
    normal[axis_of(label)] = if label % 2 == 1 { 1.0 } else { -1.0 };
    normal
}

fn edge([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl Layout {
    /// The layout of charts with their vertices at `x`. `None` where charts are none of a polycube: a corner without three axes, a border
    /// without corners, or a loop with an odd number of them.
    pub fn new(graph: &FaceGraph, charts: &Charts, x: &[Point]) -> Option<Self> {
        let mut path_of: HashMap<[u32; 2], usize> = HashMap::new();
        for (path, of) in charts.paths.iter().enumerate() {
            if of.is_closed {
                return None;
            }
            for pair in of.vertices.windows(2) {
                path_of.insert(edge([pair[0], pair[1]]), path);
            }
        }
        let mut layout = Self {
            convexity: convexities(graph, &path_of, charts.paths.len(), x),
            ..Self::default()
        };
        let mut paths_at: HashMap<u32, (Vec<usize>, i8)> = HashMap::new();
        for (chart, loops) in charts.loops.iter().enumerate() {
            let label = charts.labels[chart];
            let outer = outer_loop(loops, label, x);
            for (number, of) in loops.iter().enumerate() {
                let count = of.vertices.len();
                let path_after = |k: usize| path_of[&edge([of.vertices[k % count], of.vertices[(k + 1) % count]])];
                let mut turns = vec![];
                for &k in &of.corners {
                    let k = k as usize;
                    let before = (k + count - 1) % count;
                    let across = [before, k].map(|k| normal(charts.labels[of.across[k] as usize]));
                    let determinant = across[0].cross(&across[1]).dot(&normal(label)) as i8;
                    let paths = [path_after(before), path_after(k)];
                    let (at, all) = paths_at.entry(of.vertices[k]).or_default();
                    at.extend(paths);
                    *all = determinant;
                    turns.push(Turn { paths, determinant });
                }
                // Left turns are four more than right ones, or four fewer around a hole.
                let corners = turns.len();
                let right = match number == outer {
                    true => corners.checked_sub(4)?,
                    false => corners + 4,
                };
                if corners % 2 == 1 || right / 2 > corners {
                    return None;
                }
                layout.loops.push(LoopTurns {
                    chart,
                    turns,
                    right: right / 2,
                });
            }
        }
        let mut corners: Vec<(u32, (Vec<usize>, i8))> = paths_at.into_iter().collect();
        corners.sort_unstable_by_key(|(v, _)| *v);
        for (_, (mut paths, determinant)) in corners {
            paths.sort_unstable();
            paths.dedup();
            let paths: [usize; 3] = paths.try_into().ok()?;
            if determinant == 0 {
                return None;
            }
            layout.corners.push(Corner { paths, determinant });
        }
        Some(layout)
    }

    /// Whether there are signs for which the charts are those of a polycube; false, too, where the search for them was given up.
    pub fn is_possible(&self) -> bool {
        self.signs().is_some()
    }

    /// Charts of labels without a layout that contradict each other: one with an odd number of corners at a border, or so few
    /// that without any of them there would be no contradiction.
    pub fn contradiction(graph: &FaceGraph, charts: &Charts, x: &[Point]) -> Vec<usize> {
        let is_odd = |loops: &Vec<BoundaryLoop>| loops.iter().any(|of| of.corners.len() % 2 == 1);
        if let Some(odd) = charts.loops.iter().position(is_odd) {
            return vec![odd];
        }
        let mut left: Vec<usize> = (0..charts.labels.len()).collect();
        let Some(layout) = Self::new(graph, charts, x) else {
            return left;
        };
        for chart in 0..charts.labels.len() {
            let others: Vec<usize> = left.iter().copied().filter(|other| *other != chart).collect();
            // A corner counts if one of its charts does.
            let is_at = |corner: &Corner| {
                let beside = corner.paths.iter().flat_map(|&path| charts.paths[path].charts);
                beside.into_iter().any(|chart| others.contains(&(chart as usize)))
            };
            let mut fewer = layout.clone();
            fewer.loops.retain(|of| others.contains(&of.chart));
            fewer.corners.retain(is_at);
            if fewer.search(FEW_CHOICES) == Some(None) {
                left = others;
            }
        }
        left
    }

    /// A sign for each path, 1 where it is convex and -1 where it is concave, so that all corners and loops are those of a
    /// polycube: those of the paths as they are now, and others where these do not fit. `None` if none were found.
    fn signs(&self) -> Option<Vec<i8>> {
        self.search(MOST_CHOICES).flatten()
    }

    /// The signs, or that there are none; `None` where that was not found out with so many choices.
    fn search(&self, most_choices: usize) -> Option<Option<Vec<i8>>> {
        let mut order: Vec<usize> = (0..self.convexity.len()).collect();
        order.sort_by(|&a, &b| self.convexity[b].abs().total_cmp(&self.convexity[a].abs()));
        let mut signs = vec![0; self.convexity.len()];
        let mut trail = vec![];
        if !self.propagated(&mut signs, &mut trail) {
            return Some(None);
        }
        let mut choices: Vec<Choice> = vec![];
        for _ in 0..most_choices {
            let Some(&path) = order.iter().find(|&&path| signs[path] == 0) else {
                return Some(Some(signs));
            };
            let mut choice = Choice {
                path,
                sign: if self.convexity[path] > 0.0 { 1 } else { -1 },
                trail: trail.len(),
                is_last: false,
            };
            loop {
                signs[choice.path] = choice.sign;
                trail.push(choice.path);
                choices.push(choice);
                if self.propagated(&mut signs, &mut trail) {
                    break;
                }
                // Back to the last choice with a sign that was not tried.
                choice = loop {
                    let Some(last) = choices.pop() else {
                        return Some(None);
                    };
                    trail.drain(last.trail..).for_each(|path| signs[path] = 0);
                    if !last.is_last {
                        break Choice {
                            sign: -last.sign,
                            is_last: true,
                            ..last
                        };
                    }
                };
            }
        }
        None
    }

    /// Sets signs that follow from others, and appends their paths to `trail`; false on a contradiction.
    fn propagated(&self, signs: &mut [i8], trail: &mut Vec<usize>) -> bool {
        loop {
            let before = trail.len();
            let mut set = |signs: &mut [i8], path: usize, sign: i8| {
                if signs[path] == 0 {
                    signs[path] = sign;
                    trail.push(path);
                }
                signs[path] == sign
            };
            for corner in &self.corners {
                let at = corner.paths.map(|path| signs[path]);
                if corner.determinant > 0 {
                    // One octant, or all but one.
                    if let Some(&sign) = at.iter().find(|sign| **sign != 0)
                        && !corner.paths.iter().all(|&path| set(signs, path, sign))
                    {
                        return false;
                    }
                } else {
                    // Three octants, or five: not all the same.
                    for k in 0..3 {
                        let [a, b] = [at[(k + 1) % 3], at[(k + 2) % 3]];
                        if a != 0 && a == b && !set(signs, corner.paths[k], -a) {
                            return false;
                        }
                    }
                }
            }
            for of in &self.loops {
                let turn = |turn: &Turn, signs: &[i8]| {
                    turn.paths.iter().map(|&path| signs[path]).product::<i8>() * turn.determinant
                };
                let known = |side: i8, signs: &[i8]| of.turns.iter().filter(|t| turn(t, signs) == side).count();
                let [right, left] = [known(-1, signs), known(1, signs)];
                if right > of.right || left > of.turns.len() - of.right {
                    return false;
                }
                // The rest turns to one side where there are enough to the other.
                let rest = match (right == of.right, left == of.turns.len() - of.right) {
                    (true, false) => 1,
                    (false, true) => -1,
                    _ => continue,
                };
                for t in &of.turns {
                    let [a, b] = t.paths;
                    let unknown = match [signs[a], signs[b]] {
                        [0, other] if other != 0 => Some((a, other)),
                        [other, 0] if other != 0 => Some((b, other)),
                        _ => None,
                    };
                    if let Some((path, other)) = unknown
                        && !set(signs, path, rest * other * t.determinant)
                    {
                        return false;
                    }
                }
            }
            if trail.len() == before {
                return true;
            }
        }
    }
}

/// The mean angle between the triangles along each path, positive where it is convex.
fn convexities(graph: &FaceGraph, path_of: &HashMap<[u32; 2], usize>, paths: usize, x: &[Point]) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; paths];
    for half_edge in 0..3 * graph.triangles.len() as u32 {
        let twin = graph.twin(half_edge);
        let [a, b] = [graph.start(half_edge), graph.start(next_in_face(half_edge))];
        let path = path_of.get(&edge([a, b]));
        if let Some(&path) = path.filter(|_| half_edge < twin) {
            let normals = [half_edge, twin].map(|half_edge| {
                let [a, b, c] = graph.triangles[half_edge as usize / 3].map(|v| x[v as usize]);
                (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector::zeros)
            });
            let along = x[b as usize] - x[a as usize];
            let length = along.norm();
            let sine = normals[0].cross(&normals[1]).dot(&along) / length.max(f64::MIN_POSITIVE);
            sums[path][0] += sine.atan2(normals[0].dot(&normals[1])) * length;
            sums[path][1] += length;
        }
    }
    sums.into_iter()
        .map(|[angle, length]| angle / length.max(f64::MIN_POSITIVE))
        .collect()
}

/// The loop around a chart; the others are around its holes. The one of largest area across the chart's axis.
fn outer_loop(loops: &[BoundaryLoop], label: u8, x: &[Point]) -> usize {
    let area = |of: &BoundaryLoop| {
        let count = of.vertices.len();
        let corner = |k: usize| x[of.vertices[k % count] as usize].coords;
        let sum: Vector = (0..count).map(|k| corner(k).cross(&corner(k + 1))).sum();
        sum.dot(&normal(label)).abs()
    };
    let areas: Vec<f64> = loops.iter().map(area).collect();
    (0..loops.len())
        .max_by(|&a, &b| areas[a].total_cmp(&areas[b]))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::super::face_graph::shapes;
    use super::*;

    /// The labels that triangles have by their normals.
    fn labels(graph: &FaceGraph, x: &[Point]) -> Vec<u8> {
        let label = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| x[v as usize]);
            let area = (b - a).cross(&(c - a));
            let axis = area.iamax();
            (2 * axis + usize::from(area[axis] > 0.0)) as u8
        };
        graph.triangles.iter().map(label).collect()
    }

    /// How many paths have to be bent to the other side.
    fn changes(graph: &FaceGraph, labels: &[u8], x: &[Point]) -> Option<usize> {
        let layout = Layout::new(graph, &graph.charts(labels), x)?;
        let signs = layout.signs()?;
        let differs = |(sign, convexity): (&i8, &f64)| (*sign > 0) != (*convexity > 0.0);
        Some(
            signs
                .iter()
                .zip(&layout.convexity)
                .filter(|pair| differs(*pair))
                .count(),
        )
    }

    #[test]
    fn solids_of_boxes_have_a_layout_and_need_no_change() {
        type Cells = fn([i32; 3]) -> bool;
        let solids: [(Cells, usize); 5] = [
            (|_| true, 6),
            (|c| c[0] < 2 || c[1] < 2, 8),
            (|c| c[0] != 2 || c[1] != 2, 10),
            // A step on a step, with saddles; and a bump.
            (|c| c[2] < 2 || (c[0] < 2 && c[1] < 3), 9),
            (|c| c[2] < 2 || (c[0] == 2 && c[1] == 2), 11),
        ];
        for (is_solid, charts) in solids {
            let (graph, x) = shapes::voxels([5, 5, 4], is_solid);
            let labels = labels(&graph, &x);
            assert_eq!(graph.charts(&labels).labels.len(), charts);
            assert_eq!(changes(&graph, &labels, &x), Some(0), "{charts}");
        }
    }

    #[test]
    fn the_sides_of_a_bump_may_be_turned_but_not_reflected() {
        let (graph, x) = shapes::voxels([5, 5, 4], |c| c[2] < 2 || (c[0] == 2 && c[1] == 2));
        let labels = labels(&graph, &x);
        let is_side = |face: usize| {
            graph.triangles[face]
                .iter()
                .all(|&v| (2.0..=3.0).contains(&x[v as usize].x) && (2.0..=3.0).contains(&x[v as usize].y))
        };
        let swapped = |axes: &[u8]| -> Vec<u8> {
            let swap = |(face, &label): (usize, &u8)| {
                if is_side(face) && axes.contains(&(label / 2)) {
                    label ^ 1
                } else {
                    label
                }
            };
            labels.iter().enumerate().map(swap).collect()
        };
        // Turned about z it is a bump again, and the walls of a pit have the same labels in the same order. Exchanged along one
        // axis they come in the other order, which corners have no room for.
        assert_eq!(changes(&graph, &swapped(&[0, 1]), &x), Some(0));
        assert_eq!(changes(&graph, &swapped(&[1]), &x), None);
        assert_eq!(changes(&graph, &swapped(&[0]), &x), None);
        // Two sides that both face along +x.
        let mut impossible = labels.clone();
        (0..labels.len())
            .filter(|&face| is_side(face) && labels[face] == 0)
            .for_each(|face| impossible[face] = 1);
        assert_eq!(changes(&graph, &impossible, &x), None);
    }

    #[test]
    fn a_border_without_corners_has_no_layout() {
        let (graph, x) = shapes::voxels([4, 4, 4], |_| true);
        let natural = labels(&graph, &x);
        // A patch in the middle of a side.
        let in_middle = |face: usize| {
            graph.triangles[face].iter().all(|&v| {
                let p = x[v as usize];
                p.z == 4.0 && (1.0..=3.0).contains(&p.x) && (1.0..=3.0).contains(&p.y)
            })
        };
        let with_patch: Vec<u8> = (natural.iter().enumerate())
            .map(|(f, &l)| if in_middle(f) { 1 } else { l })
            .collect();
        assert_eq!(changes(&graph, &with_patch, &x), None);
        assert_eq!(
            changes(&graph, &vec![0; natural.len()], &x).map(|_| ()),
            Some(()),
            "no borders, and nothing to ask for"
        );
    }
}
