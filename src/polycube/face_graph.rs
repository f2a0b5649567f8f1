//! The triangles of a closed surface and what lies beside them, and charts: connected parts of triangles that share
//! one of the six axis labels, with their boundary loops, corners and border paths.
//!
//! A label is `2 axis + 1` for a positive and `2 axis` for a negative direction: −x, +x, −y, +y, −z, +z. An edge lies
//! on a border when its two triangles have different labels; a corner is a vertex of three or more border edges.

/// The number of labels.
pub(super) const LABELS: usize = 6;

/// Whether two labels point in opposite directions of one axis.
pub(super) fn are_opposite(a: u8, b: u8) -> bool {
    a ^ b == 1
}

/// A closed oriented manifold of triangles, of any genus and number of components.
///
/// Half-edge `3 f + k` runs from corner `k` of triangle `f` to corner `k + 1`, with the triangle on its left when seen
/// from outside.
pub(super) struct FaceGraph {
    /// Vertices of each triangle, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// The triangle across the edge from corner `k` to corner `k + 1`.
    pub neighbours: Vec<[u32; 3]>,
    /// The same edge as a half-edge of the neighbour.
    twins: Vec<u32>,
    /// Where each vertex's triangles begin in `rows`; one more entry than vertices.
    row_starts: Vec<u32>,
    rows: Vec<u32>,
}

impl FaceGraph {
    /// `None` if a triangle names a vertex twice or one that does not exist, if an edge does not have exactly two
    /// triangles that run oppositely along it, or if the triangles at a vertex are not a single fan.
    pub fn new(triangles: &[[u32; 3]], vertices: usize) -> Option<Self> {
        let is_usable =
            |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < vertices) && t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        if triangles.len() > u32::MAX as usize / 3 || !triangles.iter().all(is_usable) {
            return None;
        }
        let twins = find_twins(triangles)?;
        let neighbours = twins.chunks_exact(3).map(|t| [t[0] / 3, t[1] / 3, t[2] / 3]).collect();
        let (row_starts, rows) = fans(triangles, &twins, vertices)?;
        Some(Self {
            triangles: triangles.to_vec(),
            neighbours,
            twins,
            row_starts,
            rows,
        })
    }

    /// The number of vertices, including those without triangles.
    pub fn vertices(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Triangles around a vertex, counter-clockwise as seen from outside; the last is a neighbour of the first.
    pub fn faces_at(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.rows[self.row_starts[v] as usize..self.row_starts[v + 1] as usize]
    }

    /// The half-edge of the neighbour along the same edge, in the opposite direction.
    pub fn twin(&self, half_edge: u32) -> u32 {
        self.twins[half_edge as usize]
    }

    /// The half-edge's first vertex.
    pub fn start(&self, half_edge: u32) -> u32 {
        self.triangles[half_edge as usize / 3][half_edge as usize % 3]
    }

    /// The half-edge that leaves `vertex` in one of its triangles.
    pub fn leaving(&self, vertex: u32, face: u32) -> u32 {
        let corner = self.triangles[face as usize].iter().position(|&v| v == vertex);
        3 * face + corner.unwrap_or(0) as u32
    }

    /// Whether the labels on the two sides differ.
    pub fn is_border(&self, half_edge: u32, labels: &[u8]) -> bool {
        labels[half_edge as usize / 3] != labels[self.twin(half_edge) as usize / 3]
    }

    /// The number of border edges at a vertex, which is that of changes of the label around it: 0, 2 or more.
    pub fn border_edges_at(&self, vertex: u32, labels: &[u8]) -> usize {
        let fan = self.faces_at(vertex);
        let Some(&last) = fan.last() else { return 0 };
        let mut before = labels[last as usize];
        let mut changes = 0;
        for &face in fan {
            let label = labels[face as usize];
            changes += usize::from(label != before);
            before = label;
        }
        changes
    }

    /// The border half-edge that follows a border half-edge along the boundary of the same chart.
    pub fn next_on_border(&self, half_edge: u32, labels: &[u8]) -> u32 {
        let mut next = next_in_face(half_edge);
        while !self.is_border(next, labels) {
            next = next_in_face(self.twin(next));
        }
        next
    }

    /// The charts of a labelling, with one label a triangle; numbered in the order of their first triangles.
    pub fn charts(&self, labels: &[u8]) -> Charts {
        let (of_face, chart_labels) = self.connected_parts(|a, b| labels[a] == labels[b], labels);
        let mut charts = Charts {
            loops: vec![Vec::new(); chart_labels.len()],
            neighbours: vec![Vec::new(); chart_labels.len()],
            of_face,
            labels: chart_labels,
            paths: Vec::new(),
        };
        self.trace_loops(labels, &mut charts);
        for (chart, loops) in charts.loops.iter().enumerate() {
            let beside = &mut charts.neighbours[chart];
            beside.extend(loops.iter().flat_map(|l| l.across.iter().copied()));
            beside.sort_unstable();
            beside.dedup();
            for border in loops {
                border.add_paths(chart as u32, &mut charts.paths);
            }
        }
        charts
    }

    /// The connected component of each triangle, and the number of components.
    pub fn components(&self) -> (Vec<u32>, usize) {
        let (of_face, first) = self.connected_parts(|_, _| true, &vec![0; self.triangles.len()]);
        (of_face, first.len())
    }

    /// Parts connected across edges whose triangles belong `together`: the part of each triangle, and the label of
    /// each part's first.
    fn connected_parts(&self, together: impl Fn(usize, usize) -> bool, labels: &[u8]) -> (Vec<u32>, Vec<u8>) {
        let mut of_face = vec![u32::MAX; self.triangles.len()];
        let mut part_labels = Vec::new();
        let mut stack = Vec::new();
        for seed in 0..self.triangles.len() {
            if of_face[seed] != u32::MAX {
                continue;
            }
            let part = part_labels.len() as u32;
            part_labels.push(labels[seed]);
            of_face[seed] = part;
            stack.push(seed);
            while let Some(face) = stack.pop() {
                for other in self.neighbours[face].map(|n| n as usize) {
                    if of_face[other] == u32::MAX && together(face, other) {
                        of_face[other] = part;
                        stack.push(other);
                    }
                }
            }
        }
        (of_face, part_labels)
    }

    fn trace_loops(&self, labels: &[u8], charts: &mut Charts) {
        let mut is_traced = vec![false; self.twins.len()];
        for first in 0..self.twins.len() as u32 {
            if is_traced[first as usize] || !self.is_border(first, labels) {
                continue;
            }
            let mut border = BoundaryLoop::default();
            let mut half_edge = first;
            while !is_traced[half_edge as usize] {
                is_traced[half_edge as usize] = true;
                let vertex = self.start(half_edge);
                if self.border_edges_at(vertex, labels) > 2 {
                    border.corners.push(border.vertices.len() as u32);
                }
                border.vertices.push(vertex);
                border.across.push(charts.of_face[self.twin(half_edge) as usize / 3]);
                half_edge = self.next_on_border(half_edge, labels);
            }
            charts.loops[charts.of_face[first as usize / 3] as usize].push(border);
        }
    }
}

/// The following half-edge of the same triangle.
pub(super) fn next_in_face(half_edge: u32) -> u32 {
    if half_edge % 3 == 2 {
        half_edge - 2
    } else {
        half_edge + 1
    }
}

/// Charts of a labelling: its largest connected parts of equal label.
pub(super) struct Charts {
    /// The chart of each triangle.
    pub of_face: Vec<u32>,
    /// The label of each chart.
    pub labels: Vec<u8>,
    /// Boundary loops of each chart; none if it is a whole component.
    pub loops: Vec<Vec<BoundaryLoop>>,
    /// Charts beside each chart, ascending.
    pub neighbours: Vec<Vec<u32>>,
    /// All borders, each once: the edges of the polycube.
    pub paths: Vec<BorderPath>,
}

/// One closed boundary curve of a chart, with the chart on its left.
#[derive(Debug, Clone, Default)]
pub(super) struct BoundaryLoop {
    /// Its vertices in order; one at which the loop touches itself comes more than once.
    pub vertices: Vec<u32>,
    /// The chart across the edge from each vertex to the next.
    pub across: Vec<u32>,
    /// Positions in `vertices` of its corners, ascending.
    pub corners: Vec<u32>,
}

/// A longest border without corners inside.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BorderPath {
    /// From corner to corner, both included, or all around if the path is closed.
    pub vertices: Vec<u32>,
    /// The charts on the left and on the right; the left one has the smaller number.
    pub charts: [u32; 2],
    /// Whether the last vertex is joined to the first, because the border has no corner.
    pub is_closed: bool,
}

impl BoundaryLoop {
    /// Appends those of its paths that have the larger number across.
    fn add_paths(&self, chart: u32, paths: &mut Vec<BorderPath>) {
        let length = self.vertices.len();
        for (i, &corner) in self.corners.iter().enumerate() {
            let begin = corner as usize;
            let end = match self.corners.get(i + 1) {
                Some(&next) => next as usize,
                None => self.corners[0] as usize + length,
            };
            let vertices = (begin..=end).map(|j| self.vertices[j % length]).collect();
            add_path(paths, vertices, [chart, self.across[begin]], false);
        }
        if self.corners.is_empty() {
            add_path(paths, self.vertices.clone(), [chart, self.across[0]], true);
        }
    }
}

fn add_path(paths: &mut Vec<BorderPath>, vertices: Vec<u32>, charts: [u32; 2], is_closed: bool) {
    if charts[0] < charts[1] {
        paths.push(BorderPath {
            vertices,
            charts,
            is_closed,
        });
    }
}

/// The opposite half-edge of each, or `None` if an edge does not have exactly two.
fn find_twins(triangles: &[[u32; 3]]) -> Option<Vec<u32>> {
    let mut by_edge: Vec<([u32; 2], u32)> = (0..3 * triangles.len() as u32)
        .map(|h| {
            let (face, corner) = (h as usize / 3, h as usize % 3);
            let (a, b) = (triangles[face][corner], triangles[face][(corner + 1) % 3]);
            ([a.min(b), a.max(b)], h)
        })
        .collect();
    by_edge.sort_unstable();
    let mut twins = vec![0; by_edge.len()];
    let mut edge_before = None;
    for pair in by_edge.chunks(2) {
        let &[(edge, one), (other_edge, other)] = pair else {
            return None;
        };
        let start = |h: u32| triangles[h as usize / 3][h as usize % 3];
        if edge != other_edge || edge_before == Some(edge) || start(one) == start(other) {
            return None;
        }
        edge_before = Some(edge);
        twins[one as usize] = other;
        twins[other as usize] = one;
    }
    Some(twins)
}

/// Triangles around each vertex as starts of rows and rows, or `None` if they are not a single fan.
fn fans(triangles: &[[u32; 3]], twins: &[u32], vertices: usize) -> Option<(Vec<u32>, Vec<u32>)> {
    let mut starts = vec![0_u32; vertices + 1];
    for &v in triangles.iter().flatten() {
        starts[v as usize + 1] += 1;
    }
    for v in 0..vertices {
        starts[v + 1] += starts[v];
    }
    let mut rows = vec![0; twins.len()];
    let mut is_filled = vec![false; vertices];
    for first in 0..twins.len() as u32 {
        let v = triangles[first as usize / 3][first as usize % 3] as usize;
        if is_filled[v] {
            continue;
        }
        is_filled[v] = true;
        let row = &mut rows[starts[v] as usize..starts[v + 1] as usize];
        let mut half_edge = first;
        for place in row.iter_mut() {
            *place = half_edge / 3;
            // The triangle's last half-edge before the vertex; across it lies the next triangle.
            half_edge = twins[next_in_face(next_in_face(half_edge)) as usize];
        }
        let returns_early = row[1..].contains(&row[0]);
        if half_edge != first || returns_early {
            return None;
        }
    }
    Some((starts, rows))
}

/// Surfaces for the tests of this module.
#[cfg(test)]
pub(super) mod shapes {
    use super::FaceGraph;
    use crate::Point;

    /// A repeatable sequence of numbers below `bound`.
    pub fn numbers(mut state: u64) -> impl FnMut(u64) -> u64 {
        move |bound| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % bound
        }
    }

    /// Replaces about one label in ten.
    pub fn add_noise(labels: &mut [u8], seed: u64) {
        let mut random = numbers(seed);
        for label in labels {
            if random(10) == 0 {
                *label = random(6) as u8;
            }
        }
    }

    pub fn octahedron(radii: [f64; 3]) -> (FaceGraph, Vec<Point>) {
        let tips = |axis: usize| {
            [-1.0, 1.0].map(|sign| Point::from(std::array::from_fn(|j| if j == axis { sign * radii[j] } else { 0.0 })))
        };
        let points: Vec<Point> = (0..3).flat_map(tips).collect();
        let triangles = (0..8_u32).map(|f| {
            let t = [f & 1, 2 + (f >> 1 & 1), 4 + (f >> 2 & 1)];
            if f.count_ones() % 2 == 1 { t } else { [t[0], t[2], t[1]] }
        });
        (FaceGraph::new(&triangles.collect::<Vec<_>>(), 6).unwrap(), points)
    }

    /// The boundary of the cells of a grid that `is_solid` names, two triangles a square, the cells' size being 1.
    pub fn voxels(size: [i32; 3], is_solid: impl Fn([i32; 3]) -> bool) -> (FaceGraph, Vec<Point>) {
        let solid = |c: [i32; 3]| (0..3).all(|i| (0..size[i]).contains(&c[i])) && is_solid(c);
        let mut numbers_of = std::collections::BTreeMap::new();
        let mut points = Vec::new();
        let mut triangles = Vec::new();
        let all = (0..size[0] * size[1] * size[2]).map(|i| [i % size[0], i / size[0] % size[1], i / size[0] / size[1]]);
        for cell in all.filter(|&c| solid(c)) {
            for side in 0..6_usize {
                let (axis, step) = (side / 2, (side % 2) as i32);
                let mut beyond = cell;
                beyond[axis] += 2 * step - 1;
                if solid(beyond) {
                    continue;
                }
                let corner = |along: [i32; 2]| {
                    let mut corner = cell;
                    corner[axis] += step;
                    corner[(axis + 1) % 3] += along[0];
                    corner[(axis + 2) % 3] += along[1];
                    corner
                };
                let mut square = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|along| {
                    *numbers_of.entry(corner(along)).or_insert_with(|| {
                        points.push(Point::from(corner(along).map(f64::from)));
                        points.len() as u32 - 1
                    })
                });
                if step == 0 {
                    square.reverse();
                }
                triangles.extend([[square[0], square[1], square[2]], [square[0], square[2], square[3]]]);
            }
        }
        (FaceGraph::new(&triangles, points.len()).unwrap(), points)
    }

    /// A box of `n × (n + 1) × (n + 2)` squares, turned by `angle` radians about a skew axis.
    pub fn turned_box(n: i32, angle: f64) -> (FaceGraph, Vec<Point>) {
        let (faces, points) = voxels([n, n + 1, n + 2], |_| true);
        let turn = nalgebra::Rotation3::new(crate::Vector::new(1.0, 2.0, -0.5).normalize() * angle);
        (faces, points.iter().map(|p| turn * p).collect())
    }

    /// A sphere of `12 n²` triangles.
    pub fn sphere(n: i32) -> (FaceGraph, Vec<Point>) {
        let (faces, points) = voxels([n; 3], |_| true);
        // Tangents make the squares about equally large.
        let spread = |x: f64| (std::f64::consts::FRAC_PI_4 * (2.0 * x / f64::from(n) - 1.0)).tan();
        let project = |p: &Point| Point::from(p.map(spread).coords.normalize());
        let points = points.iter().map(project).collect();
        (faces, points)
    }

    /// A sphere of `12 n²` triangles with irregular bumps, without symmetry.
    pub fn bumpy_sphere(n: i32) -> (FaceGraph, Vec<Point>) {
        let (faces, points) = sphere(n);
        let bump = |p: &Point| {
            let waves = (5.0 * p.x + 1.0).sin() + (6.0 * p.y + 2.0 * p.z).sin() + (4.0 * p.z - 3.0 * p.x + 0.3).cos();
            p * (1.0 + 0.12 * waves)
        };
        let points = points.iter().map(bump).collect();
        (faces, points)
    }

    /// A torus about the z axis with radii 1 and 0.45, of `2 n²` triangles.
    pub fn torus(n: u32) -> (FaceGraph, Vec<Point>) {
        let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
        let point = |i: u32| {
            let (around, across) = (angle(i / n), angle(i % n));
            let radius = 1.0 + 0.45 * across.cos();
            Point::new(radius * around.cos(), radius * around.sin(), 0.45 * across.sin())
        };
        let vertex = |i: u32, j: u32| i % n * n + j % n;
        let mut triangles = Vec::new();
        for square in 0..n * n {
            let (i, j) = (square / n, square % n);
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let points: Vec<Point> = (0..n * n).map(point).collect();
        (FaceGraph::new(&triangles, points.len()).unwrap(), points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The label of each triangle of a surface whose normals are axes.
    fn axis_labels(faces: &FaceGraph, points: &[crate::Point]) -> Vec<u8> {
        let label = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            let normal = (b - a).cross(&(c - a));
            let axis = normal.iamax();
            2 * axis as u8 + u8::from(normal[axis] > 0.0)
        };
        faces.triangles.iter().map(label).collect()
    }

    #[test]
    fn surfaces_that_are_not_closed_oriented_manifolds_are_refused() {
        let tetrahedron = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        assert!(FaceGraph::new(&tetrahedron, 4).is_some());
        assert!(FaceGraph::new(&[], 0).is_some());
        let refused = |triangles: &[[u32; 3]], vertices| FaceGraph::new(triangles, vertices).is_none();
        assert!(refused(&tetrahedron, 3), "a vertex that does not exist");
        assert!(refused(&tetrahedron[..3], 4), "open");
        assert!(
            refused(&[tetrahedron, tetrahedron].concat(), 4),
            "four triangles at an edge"
        );
        assert!(
            refused(&[[0, 1, 2], tetrahedron[1], tetrahedron[2], tetrahedron[3]], 4),
            "one turned"
        );
        assert!(refused(&[[0, 1, 1], [0, 1, 1]], 2), "a vertex twice");
        let second = tetrahedron.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 }));
        assert!(refused(&[tetrahedron, second].concat(), 7), "two fans at a vertex");
        // Two triangles back to back are a sphere.
        assert!(FaceGraph::new(&[[0, 1, 2], [0, 2, 1]], 3).is_some());
    }

    #[test]
    fn triangles_lie_counter_clockwise_around_their_vertices() {
        let (faces, points) = shapes::sphere(5);
        for v in 0..faces.vertices() as u32 {
            let fan = faces.faces_at(v);
            for (i, &face) in fan.iter().enumerate() {
                let next = fan[(i + 1) % fan.len()];
                assert!(faces.neighbours[face as usize].contains(&next));
                let centre = |f: u32| {
                    let corners = faces.triangles[f as usize].map(|v| points[v as usize].coords);
                    corners.iter().sum::<crate::Vector>() / 3.0
                };
                assert!(centre(face).cross(&centre(next)).dot(&points[v as usize].coords) > 0.0);
            }
        }
        assert_eq!(
            faces.twins.iter().map(|&t| faces.twin(t)).collect::<Vec<_>>(),
            (0..900).collect::<Vec<_>>()
        );
    }

    #[test]
    fn a_box_has_the_charts_corners_and_edges_of_a_box() {
        let (faces, points) = shapes::voxels([3, 4, 5], |_| true);
        let labels = axis_labels(&faces, &points);
        let charts = faces.charts(&labels);
        assert_eq!((charts.labels.len(), charts.paths.len()), (6, 12));
        for (chart, loops) in charts.loops.iter().enumerate() {
            let [border] = &loops[..] else { panic!("{loops:?}") };
            assert_eq!((border.corners.len(), charts.neighbours[chart].len()), (4, 4));
            let sides: usize = (0..3)
                .filter(|&a| a != usize::from(charts.labels[chart] / 2))
                .map(|a| a + 3)
                .sum();
            assert_eq!(border.vertices.len(), 2 * sides);
            // The chart lies on the left: the loop's area vector points outwards.
            let at = |i: usize| points[border.vertices[i % border.vertices.len()] as usize].coords;
            let area: crate::Vector = (0..border.vertices.len()).map(|i| at(i).cross(&at(i + 1))).sum();
            let axis = usize::from(charts.labels[chart] / 2);
            assert!((area[axis] > 0.0) == (charts.labels[chart] % 2 == 1) && area[axis] != 0.0);
        }
        for path in &charts.paths {
            let (first, last) = (path.vertices[0], path.vertices[path.vertices.len() - 1]);
            assert!(!path.is_closed && path.charts[0] < path.charts[1]);
            assert!([first, last].iter().all(|&v| faces.border_edges_at(v, &labels) == 3));
            assert!(
                path.vertices[1..path.vertices.len() - 1]
                    .iter()
                    .all(|&v| faces.border_edges_at(v, &labels) == 2)
            );
        }
    }

    #[test]
    fn charts_with_holes_have_several_loops_and_borders_without_corners_are_closed() {
        let (faces, points) = shapes::voxels([5, 5, 1], |c| c[0] != 2 || c[1] != 2);
        let charts = faces.charts(&axis_labels(&faces, &points));
        let rings = charts.loops.iter().filter(|loops| loops.len() == 2).count();
        assert_eq!((charts.labels.len(), charts.paths.len(), rings), (10, 24, 2));
        let (faces, points) = shapes::voxels([4, 4, 4], |_| true);
        let labels: Vec<u8> = axis_labels(&faces, &points).iter().map(|&l| u8::from(l == 5)).collect();
        let charts = faces.charts(&labels);
        assert_eq!((charts.labels.len(), charts.paths.len()), (2, 1));
        assert!(charts.paths[0].is_closed && charts.paths[0].vertices.len() == 16);
    }

    #[test]
    fn a_vertex_where_charts_meet_twice_is_a_corner() {
        let (faces, points) = shapes::voxels([2, 2, 1], |_| true);
        // A chessboard on top.
        let square = |face: usize| {
            let corners = faces.triangles[face].map(|v| points[v as usize].coords);
            let centre = corners.iter().sum::<crate::Vector>() / 3.0;
            u8::from((centre.x > 1.0) != (centre.y > 1.0)) + if centre.z > 0.99 { 2 } else { 0 }
        };
        let labels: Vec<u8> = (0..faces.triangles.len()).map(square).collect();
        let middle = points
            .iter()
            .position(|p| *p == crate::Point::new(1.0, 1.0, 1.0))
            .unwrap() as u32;
        assert_eq!(faces.border_edges_at(middle, &labels), 4);
        let charts = faces.charts(&labels);
        let at_middle = charts
            .paths
            .iter()
            .flat_map(|p| &p.vertices)
            .filter(|&&v| v == middle)
            .count();
        assert_eq!(at_middle, 4);
    }
}
