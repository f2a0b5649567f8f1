//! Landmark curves: paths along edges of the domain that are to go to paths on the target.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::Landmarks;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// A path on the domain and the path on the target that it is to go to, each as vertices in order. Vertices that no edge
/// joins are joined by the shortest path along edges. Points go to points at the same share of the length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LandmarkCurve {
    /// Vertices of the domain, at least two.
    pub domain: Vec<u32>,
    /// Vertices of the target, at least two.
    pub target: Vec<u32>,
}

/// Why vertices are not a landmark curve. Curves count from 0, in the order given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CurveError {
    /// A vertex that does not exist.
    #[error("curve {curve} names vertex {vertex} of the {side}, which has {vertices} vertices (counted from 0)")]
    OutOfRange {
        /// The curve.
        curve: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// Fewer than two distinct vertices.
    #[error("curve {curve} has no length on the {side}; give at least two different vertices")]
    NoLength {
        /// The curve.
        curve: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
}

/// A vertex of the domain on a landmark curve, and where it is to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CurvePoint {
    pub vertex: u32,
    pub place: SurfacePoint,
}

/// The vertices of all curves, each once: of those that several curves pass the first counts, and vertices that are landmarks are
/// left out.
pub(super) fn traced(
    curves: &[LandmarkCurve],
    landmarks: &Landmarks,
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
) -> Result<Vec<CurvePoint>, CurveError> {
    let mut is_taken = vec![false; domain.vertices().len()];
    for pair in landmarks.pairs() {
        is_taken[pair[0] as usize] = true;
    }
    let mut points = Vec::new();
    for (
        curve,
        LandmarkCurve {
            domain: from,
            target: to,
        },
    ) in curves.iter().enumerate()
    {
        let from = Path::along(from, domain, "domain", curve)?;
        let to = Path::along(to, target, "target", curve)?;
        for (&vertex, length) in from.vertices.iter().zip(&from.lengths) {
            if !std::mem::replace(&mut is_taken[vertex as usize], true) {
                let place = to.point(length / from.length(), target);
                points.extend(place.map(|place| CurvePoint { vertex, place }));
            }
        }
    }
    Ok(points)
}

/// A path along edges, with the length from its start to each vertex.
pub(super) struct Path {
    pub vertices: Vec<u32>,
    lengths: Vec<f64>,
}

impl Path {
    pub fn along(corners: &[u32], surface: &SurfaceMesh, side: &'static str, curve: usize) -> Result<Self, CurveError> {
        let count = surface.vertices().len();
        if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= count) {
            return Err(CurveError::OutOfRange {
                curve,
                side,
                vertex,
                vertices: count,
            });
        }
        let neighbours = neighbours(surface);
        let mut vertices: Vec<u32> = corners.first().copied().into_iter().collect();
        for pair in corners.windows(2) {
            vertices.extend(shortest_path(pair[0], pair[1], surface, &neighbours));
        }
        let mut lengths = vec![0.0; vertices.len()];
        for i in 1..vertices.len() {
            lengths[i] = lengths[i - 1] + distance(surface, vertices[i - 1], vertices[i]);
        }
        match lengths.last() {
            Some(length) if *length > 0.0 => Ok(Self { vertices, lengths }),
            _ => Err(CurveError::NoLength { curve, side }),
        }
    }

    fn length(&self) -> f64 {
        self.lengths.last().copied().unwrap_or(0.0)
    }

    /// The point at a share of the length.
    fn point(&self, share: f64, surface: &SurfaceMesh) -> Option<SurfacePoint> {
        let at = share * self.length();
        let last = self.lengths.len() - 2;
        let i = self
            .lengths
            .partition_point(|length| *length <= at)
            .saturating_sub(1)
            .min(last);
        let step = self.lengths[i + 1] - self.lengths[i];
        let t = if step > 0.0 {
            ((at - self.lengths[i]) / step).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let [a, b] = [self.vertices[i], self.vertices[i + 1]];
        let triangle = surface
            .triangles()
            .iter()
            .position(|t| t.contains(&a) && t.contains(&b))?;
        let weight = |v: u32| match v {
            v if v == a => 1.0 - t,
            v if v == b => t,
            _ => 0.0,
        };
        Some(SurfacePoint {
            triangle: triangle as u32,
            barycentric: surface.triangles()[triangle].map(weight),
        })
    }
}

fn distance(surface: &SurfaceMesh, a: u32, b: u32) -> f64 {
    (surface.vertices()[a as usize] - surface.vertices()[b as usize]).norm()
}

fn neighbours(surface: &SurfaceMesh) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); surface.vertices().len()];
    for &[a, b, c] in surface.triangles() {
        // Each edge of a closed oriented surface once in each direction.
        for [v, w] in [[a, b], [b, c], [c, a]] {
            neighbours[v as usize].push(w);
        }
    }
    neighbours
}

/// The vertices after `from` of the shortest path along edges to `to` (Dijkstra); none when they are the same or not
/// connected.
fn shortest_path(from: u32, to: u32, surface: &SurfaceMesh, neighbours: &[Vec<u32>]) -> Vec<u32> {
    let mut length = vec![f64::INFINITY; neighbours.len()];
    let mut before = vec![from; neighbours.len()];
    // Lengths are not negative, so that their bits are ordered as they are.
    let mut queue = BinaryHeap::from([Reverse((0u64, from))]);
    length[from as usize] = 0.0;
    while let Some(Reverse((bits, v))) = queue.pop() {
        let so_far = f64::from_bits(bits);
        if v == to {
            break;
        }
        if so_far > length[v as usize] {
            continue;
        }
        for &w in &neighbours[v as usize] {
            let through = so_far + distance(surface, v, w);
            if through < length[w as usize] {
                length[w as usize] = through;
                before[w as usize] = v;
                queue.push(Reverse((through.to_bits(), w)));
            }
        }
    }
    if from == to || !length[to as usize].is_finite() {
        return vec![];
    }
    let mut path = vec![to];
    let mut v = before[to as usize];
    while v != from {
        path.push(v);
        v = before[v as usize];
    }
    path.reverse();
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn points_are_at_the_same_share_of_the_length() {
        // Edges of cubes of 4 and 6 squares along a side.
        let (domain, target) = (shapes::cube(1.0, 4), shapes::cube(2.0, 6));
        let corner = |surface: &SurfaceMesh, signs: [f64; 3]| {
            let size = surface.vertices().iter().map(|p| p.coords.amax()).fold(0.0, f64::max);
            let is_there = |p: &crate::Point| (0..3).all(|k| p[k] == signs[k] * size);
            surface.vertices().iter().position(is_there).unwrap() as u32
        };
        let ends = |surface: &SurfaceMesh| vec![corner(surface, [-1.0, 1.0, 1.0]), corner(surface, [1.0, 1.0, 1.0])];
        let curve = LandmarkCurve {
            domain: ends(&domain),
            target: ends(&target),
        };
        let points = traced(&[curve.clone(), curve], &Landmarks::default(), &domain, &target).unwrap();
        assert_eq!(points.len(), 5);
        for CurvePoint { vertex, place } in points {
            let from = domain.vertices()[vertex as usize];
            let to = place.position(&target, target.vertices());
            assert!((to - 2.0 * from.coords).coords.norm() < 1e-14, "{from} {to}");
        }
    }

    #[test]
    fn vertices_that_do_not_exist_and_single_ones_are_refused() {
        let cube = shapes::cube(1.0, 2);
        let refused = |domain: Vec<u32>, target: Vec<u32>| {
            traced(&[LandmarkCurve { domain, target }], &Landmarks::default(), &cube, &cube).unwrap_err()
        };
        let count = cube.vertices().len() as u32;
        assert!(matches!(
            refused(vec![0, 1], vec![0, count]),
            CurveError::OutOfRange { side: "target", .. }
        ));
        assert!(matches!(
            refused(vec![3, 3], vec![0, 1]),
            CurveError::NoLength { side: "domain", .. }
        ));
        assert!(matches!(
            refused(vec![], vec![0, 1]),
            CurveError::NoLength { side: "domain", .. }
        ));
    }
}
