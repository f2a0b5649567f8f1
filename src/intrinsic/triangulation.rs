//! The intrinsic Delaunay triangulation of a closed surface: triangles known by the lengths of their sides.
//!
//! Flips keep the lengths of a flat surface with cone points, so that the Laplacian of badly shaped or flat triangles
//! becomes that of well-shaped ones (Bobenko & Springborn, *A discrete Laplace-Beltrami operator for simplicial surfaces*,
//! 2007). Triangles without area get one first: all sides are made longer by the same tiny amount (Sharp & Crane, *A
//! Laplacian for nonmanifold triangle meshes*, 2020).

use crate::Point;

/// Slack of the triangle inequality, as a fraction of the mean length of sides.
const SLACK: f64 = 1e-5;
/// Sums of cotangents above minus this are those of Delaunay edges, up to rounding.
const TOLERANCE: f64 = 1e-9;
/// Flips per edge after which the triangulation is taken as it is.
const MOST_FLIPS: usize = 100;

/// Triangles over the vertices of a surface of area 1. Edges may join a vertex with itself, and two vertices may share
/// several.
#[derive(Debug, Clone)]
pub(super) struct IntrinsicTriangulation {
    /// Number of vertices.
    pub vertices: usize,
    /// Corners, counter-clockwise.
    pub triangles: Vec<[u32; 3]>,
    /// Lengths of the sides; side `k` joins the corners `k` and `k + 1`.
    pub lengths: Vec<[f64; 3]>,
    /// Side `k` of triangle `t` is glued to side `s % 3` of triangle `s / 3` with `s = glued[t][k]`.
    glued: Vec<[u32; 3]>,
}

impl IntrinsicTriangulation {
    /// The Delaunay triangulation of a closed oriented surface, scaled to area 1. `None` when a side has not exactly one
    /// other that runs along it in the opposite direction, or when the area is zero or not finite.
    pub fn delaunay(points: &[Point], triangles: &[[u32; 3]]) -> Option<Self> {
        let mut made = Self {
            vertices: points.len(),
            triangles: triangles.to_vec(),
            lengths: triangles
                .iter()
                .map(|t| [0, 1, 2].map(|k| (points[t[k] as usize] - points[t[(k + 1) % 3] as usize]).norm()))
                .collect(),
            glued: glue(triangles)?,
        };
        made.give_all_triangles_area();
        made.flip_to_delaunay();
        let area: f64 = made.lengths.iter().map(area).sum();
        let scale = area.sqrt().recip();
        made.lengths.iter_mut().flatten().for_each(|length| *length *= scale);
        (area > 0.0 && scale.is_finite() && scale > 0.0).then_some(made)
    }

    /// Mean length of the sides.
    pub fn mean_length(&self) -> f64 {
        self.lengths.iter().flatten().sum::<f64>() / (3 * self.lengths.len()) as f64
    }

    fn give_all_triangles_area(&mut self) {
        let slack = SLACK * self.mean_length();
        let missing = |l: &[f64; 3]| {
            (0..3)
                .map(|k| slack - (l[k] + l[(k + 1) % 3] - l[(k + 2) % 3]))
                .fold(0.0, f64::max)
        };
        let most = self.lengths.iter().map(missing).fold(0.0, f64::max);
        self.lengths.iter_mut().flatten().for_each(|length| *length += most);
    }

    fn flip_to_delaunay(&mut self) {
        // Whether a side of a triangle is in the queue. After a flip a side belongs to another edge, which takes its place there.
        let mut waits = vec![[true; 3]; self.triangles.len()];
        let mut queue: Vec<u32> = (0..3 * self.triangles.len() as u32).rev().collect();
        let mut left = MOST_FLIPS * queue.len();
        while let Some(side) = queue.pop() {
            let (t, k) = (side as usize / 3, side as usize % 3);
            if !std::mem::take(&mut waits[t][k]) || self.is_delaunay(side) {
                continue;
            }
            if left == 0 {
                return;
            }
            left -= 1;
            for changed in self.flip(side) {
                let wait = &mut waits[changed as usize / 3][changed as usize % 3];
                if !std::mem::replace(wait, true) {
                    queue.push(changed);
                }
            }
        }
    }

    /// Also true of edges that cannot be flipped.
    fn is_delaunay(&self, side: u32) -> bool {
        let (t, k) = (side as usize / 3, side as usize % 3);
        let other = self.glued[t][k] as usize;
        let (s, j) = (other / 3, other % 3);
        s == t || cotangents(&self.lengths[t])[k] + cotangents(&self.lengths[s])[j] >= -TOLERANCE
    }

    /// Replaces the edge of a side by the other diagonal of its two triangles. Returns the outer sides of the two.
    fn flip(&mut self, side: u32) -> [u32; 4] {
        let (t, k) = (side as usize / 3, side as usize % 3);
        let other = self.glued[t][k] as usize;
        let (s, j) = (other / 3, other % 3);
        // The quadrilateral a, d, b, c about the edge from a to b.
        let [a, b, c] = [0, 1, 2].map(|i| self.triangles[t][(k + i) % 3]);
        let d = self.triangles[s][(j + 2) % 3];
        let [ab, bc, ca] = [0, 1, 2].map(|i| self.lengths[t][(k + i) % 3]);
        let [_, ad, db] = [0, 1, 2].map(|i| self.lengths[s][(j + i) % 3]);
        let [beyond_bc, beyond_ca] = [1, 2].map(|i| self.glued[t][(k + i) % 3]);
        let [beyond_ad, beyond_db] = [1, 2].map(|i| self.glued[s][(j + i) % 3]);
        let apex = |from_a: f64, from_b: f64| {
            let along = (ab * ab + from_a * from_a - from_b * from_b) / (2.0 * ab);
            (along, 2.0 * area(&[ab, from_b, from_a]) / ab)
        };
        let ((x, y), (z, w)) = (apex(ca, bc), apex(ad, db));
        let cd = (x - z).hypot(y + w);
        self.triangles[t] = [c, a, d];
        self.lengths[t] = [ca, ad, cd];
        self.triangles[s] = [d, b, c];
        self.lengths[s] = [db, bc, cd];
        let place = |triangle: usize, k: usize| (3 * triangle + k) as u32;
        let outer = [
            (place(t, 0), place(t, (k + 2) % 3), beyond_ca),
            (place(t, 1), place(s, (j + 1) % 3), beyond_ad),
            (place(s, 0), place(s, (j + 2) % 3), beyond_db),
            (place(s, 1), place(t, (k + 1) % 3), beyond_bc),
        ];
        for (new, _, beyond) in outer {
            // Two of the outer sides may be glued to each other.
            let moved = outer.iter().find(|(_, old, _)| *old == beyond);
            let beyond = moved.map_or(beyond, |&(new, ..)| new);
            self.glued[new as usize / 3][new as usize % 3] = beyond;
            self.glued[beyond as usize / 3][beyond as usize % 3] = new;
        }
        self.glued[t][2] = place(s, 2);
        self.glued[s][2] = place(t, 2);
        outer.map(|(new, ..)| new)
    }
}

/// Area of a triangle with these sides, as Kahan computes it, without cancellation.
pub(super) fn area(lengths: &[f64; 3]) -> f64 {
    let mut l = *lengths;
    l.sort_unstable_by(|a, b| b.total_cmp(a));
    let [a, b, c] = l;
    ((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)))
        .max(0.0)
        .sqrt()
        / 4.0
}

/// The cotangents of the angles opposite to the sides.
pub(super) fn cotangents(lengths: &[f64; 3]) -> [f64; 3] {
    let squares = lengths.map(|l| l * l);
    let sum: f64 = squares.iter().sum();
    let four_areas = 4.0 * area(lengths).max(f64::MIN_POSITIVE);
    squares.map(|square| (sum - 2.0 * square) / four_areas)
}

fn glue(triangles: &[[u32; 3]]) -> Option<Vec<[u32; 3]>> {
    let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
    for (t, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let ends = [corners[k], corners[(k + 1) % 3]];
            sides.push(([ends[0].min(ends[1]), ends[0].max(ends[1])], (3 * t + k) as u32));
        }
    }
    sides.sort_unstable();
    let mut glued = vec![[0; 3]; triangles.len()];
    let start = |side: u32| triangles[side as usize / 3][side as usize % 3];
    for pair in sides.chunks(2) {
        let &[(edge, first), (again, second)] = pair else {
            return None;
        };
        if edge != again || start(first) == start(second) {
            return None;
        }
        glued[first as usize / 3][first as usize % 3] = second;
        glued[second as usize / 3][second as usize % 3] = first;
    }
    // Edges of four sides pass as two pairs.
    let repeated = sides
        .chunks(2)
        .zip(sides.chunks(2).skip(1))
        .any(|(a, b)| a[0].0 == b[0].0);
    (!repeated).then_some(glued)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};

    fn of(mesh: &SurfaceMesh) -> IntrinsicTriangulation {
        IntrinsicTriangulation::delaunay(mesh.vertices(), mesh.triangles()).unwrap()
    }

    fn assert_sound(made: &IntrinsicTriangulation) {
        for t in 0..made.triangles.len() {
            for k in 0..3 {
                let other = made.glued[t][k] as usize;
                let (s, j) = (other / 3, other % 3);
                assert_eq!(made.glued[s][j] as usize, 3 * t + k);
                assert_eq!(made.triangles[t][k], made.triangles[s][(j + 1) % 3]);
                assert_eq!(made.triangles[t][(k + 1) % 3], made.triangles[s][j]);
                assert_eq!(made.lengths[t][k], made.lengths[s][j]);
                assert!(made.is_delaunay((3 * t + k) as u32));
            }
        }
    }

    #[test]
    fn the_area_of_a_cube_stays_when_needles_are_flipped() {
        // Sheared within its faces: the same cube with other diagonals and long triangles.
        let cube = shapes::deformed(&shapes::cube(1.0, 8), |p| {
            let inside = |x: f64| (x.abs() - 0.5).abs() > 1e-9;
            let shift = if inside(p.x) && inside(p.y) {
                0.9 * (0.25 - p.x * p.x) * (p.y * 9.0).sin()
            } else {
                0.0
            };
            Point::new(p.x + shift, p.y, p.z)
        });
        let made = of(&cube);
        assert_sound(&made);
        let total: f64 = made.lengths.iter().map(area).sum();
        assert!((total - 1.0).abs() < 1e-12);
        let flipped = made
            .triangles
            .iter()
            .zip(cube.triangles())
            .filter(|(a, b)| a != b)
            .count();
        assert!(flipped > 10, "{flipped}");
    }

    #[test]
    fn triangles_without_area_and_coincident_vertices_are_triangulated() {
        // A cube whose upper face is squeezed to a segment, then to a point.
        for squeeze in [0.0, 1.0] {
            let mesh = shapes::deformed(&shapes::cube(1.0, 6), |p| {
                let s = if p.z > 0.49 { 0.0 } else { 1.0 };
                Point::new(p.x * s, p.y * f64::max(s, squeeze), p.z)
            });
            let made = of(&mesh);
            assert_sound(&made);
            assert!(made.lengths.iter().all(|l| area(l) > 0.0));
        }
    }

    #[test]
    fn open_surfaces_and_those_without_area_are_refused() {
        let sphere = shapes::sphere(1.0, 1);
        let open = &sphere.triangles()[1..];
        assert!(IntrinsicTriangulation::delaunay(sphere.vertices(), open).is_none());
        let doubled = [sphere.triangles(), sphere.triangles()].concat();
        assert!(IntrinsicTriangulation::delaunay(sphere.vertices(), &doubled).is_none());
        let nowhere = vec![Point::origin(); sphere.vertices().len()];
        assert!(IntrinsicTriangulation::delaunay(&nowhere, sphere.triangles()).is_none());
        let undefined = vec![Point::new(f64::NAN, 0.0, 0.0); sphere.vertices().len()];
        assert!(IntrinsicTriangulation::delaunay(&undefined, sphere.triangles()).is_none());
        assert!(IntrinsicTriangulation::delaunay(&[], &[]).is_none());
    }
}
