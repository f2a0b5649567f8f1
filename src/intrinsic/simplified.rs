//! A surface simplified to a bounded number of vertices, where all vertices of the surface lie on it, and samples.

use rayon::prelude::*;

use crate::Point;
use crate::geometry::closest_point_on_triangle;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::spherical::{Hierarchy, VertexRings};

/// A surface of at most [`MOST_VERTICES`] vertices, all of them vertices of the original surface.
#[derive(Debug, Clone)]
pub(super) struct SimplifiedSurface {
    /// Which vertices of the original surface its vertices are, ascending.
    pub originals: Vec<u32>,
    pub points: Vec<Point>,
    pub triangles: Vec<[u32; 3]>,
    /// Where each vertex of the original surface lies on this one.
    pub places: Vec<SurfacePoint>,
    /// The vertices of a surface that is simplified further, of this one.
    pub samples: Vec<u32>,
    /// The triangles of that surface, by places in `samples`.
    pub sample_triangles: Vec<[u32; 3]>,
}

/// Surfaces with more vertices are simplified, to [`SIMPLIFIED_VERTICES`].
pub(super) const MOST_VERTICES: usize = 7000;
const SIMPLIFIED_VERTICES: usize = 6000;
/// Number of samples, if the surface has so many vertices.
pub(super) const SAMPLES: usize = 1000;
/// Triangle fans to move through in search of a vertex's place.
const MOST_STEPS: usize = 8;

impl SimplifiedSurface {
    /// Simplifies a closed oriented manifold of genus 0; anything else may have no result.
    pub fn new(surface: &SurfaceMesh) -> Option<Self> {
        let count = surface.vertices().len();
        let hierarchy = Hierarchy::new(surface.vertices(), surface.triangles(), &[])?;
        let mut rings = VertexRings::new(hierarchy.vertices, &hierarchy.base);
        let kept = if count > MOST_VERTICES {
            SIMPLIFIED_VERTICES
        } else {
            count
        };
        let mut inserted: Vec<u32> = hierarchy.base.iter().flatten().copied().collect();
        inserted.sort_unstable();
        inserted.dedup();
        let mut sample_triangles = Vec::new();
        let mut nearest: Vec<u32> = (0..count as u32).collect();
        for insertion in hierarchy.refinements().flatten() {
            if inserted.len() == SAMPLES {
                sample_triangles = rings.triangles();
            }
            if inserted.len() < kept {
                rings.insert(&insertion);
                inserted.push(insertion.vertex);
            } else {
                let position = |v: u32| surface.vertices()[v as usize];
                let distance = |v: u32| (position(v) - position(insertion.vertex)).norm_squared();
                let candidates = insertion.ring.iter().map(|&r| nearest[r as usize]);
                let best = candidates.map(|v| (distance(v), v)).min_by(|a, b| a.0.total_cmp(&b.0));
                nearest[insertion.vertex as usize] = best?.1;
            }
        }
        let samples = inserted[..inserted.len().min(SAMPLES)].to_vec();
        if inserted.len() <= SAMPLES {
            sample_triangles = rings.triangles();
        }
        inserted.sort_unstable();
        let index = |v: u32| inserted.binary_search(&v).map_or(0, |place| place as u32);
        let triangles: Vec<[u32; 3]> = match kept == count {
            true => surface.triangles().to_vec(),
            false => rings.triangles().iter().map(|t| t.map(index)).collect(),
        };
        let mut place_of_sample = vec![0; count];
        samples
            .iter()
            .zip(0..)
            .for_each(|(&v, place)| place_of_sample[v as usize] = place);
        let mut made = Self {
            points: inserted.iter().map(|&v| surface.vertices()[v as usize]).collect(),
            triangles,
            places: Vec::new(),
            samples: samples.iter().map(|&v| index(v)).collect(),
            sample_triangles: sample_triangles
                .iter()
                .map(|t| t.map(|v| place_of_sample[v as usize]))
                .collect(),
            originals: Vec::new(),
        };
        let fans = Fans::new(made.points.len(), &made.triangles);
        let starts = nearest.par_iter().map(|&v| index(v));
        made.places = starts
            .zip(surface.vertices())
            .map(|(start, p)| made.place(&fans, start, p))
            .collect();
        made.originals = inserted;
        Some(made)
    }

    /// The vertex of this surface with the largest weight at the place of an original vertex.
    pub fn nearest(&self, original: u32) -> u32 {
        let place = &self.places[original as usize];
        let corners = self.triangles[place.triangle as usize];
        corners[largest(&place.barycentric)]
    }

    /// A function of the original vertices that is linear over the triangles.
    pub fn interpolated(&self, values: &[f64]) -> Vec<f64> {
        let value = |place: &SurfacePoint| {
            let corners = self.triangles[place.triangle as usize];
            (0..3).map(|k| place.barycentric[k] * values[corners[k] as usize]).sum()
        };
        self.places.iter().map(value).collect()
    }

    /// A point that is closest to `p` among those of the triangles around it: found by walking from the vertex `start`,
    /// so that it is not on another part of the surface that comes near.
    fn place(&self, fans: &Fans, start: u32, p: &Point) -> SurfacePoint {
        let mut best = (
            f64::INFINITY,
            SurfacePoint {
                triangle: 0,
                barycentric: [1.0, 0.0, 0.0],
            },
        );
        let mut at = start;
        for _ in 0..MOST_STEPS {
            let before = best.0;
            for &triangle in fans.of(at) {
                let corners = self.triangles[triangle as usize].map(|v| self.points[v as usize]);
                let found = closest_point_on_triangle(p, &corners);
                let distance = found.offset.norm_squared();
                if distance < best.0 {
                    let barycentric = found.barycentric;
                    best = (distance, SurfacePoint { triangle, barycentric });
                }
            }
            let next = self.triangles[best.1.triangle as usize][largest(&best.1.barycentric)];
            if best.0 >= before || next == at {
                break;
            }
            at = next;
        }
        best.1
    }
}

/// The triangles at each vertex.
struct Fans {
    begin: Vec<u32>,
    triangles: Vec<u32>,
}

impl Fans {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut begin = vec![0u32; vertices + 1];
        triangles.iter().flatten().for_each(|&v| begin[v as usize + 1] += 1);
        (0..vertices).for_each(|v| begin[v + 1] += begin[v]);
        let mut next = begin.clone();
        let mut list = vec![0; 3 * triangles.len()];
        for (triangle, corners) in (0..).zip(triangles) {
            for &v in corners {
                list[next[v as usize] as usize] = triangle;
                next[v as usize] += 1;
            }
        }
        Self { begin, triangles: list }
    }

    fn of(&self, vertex: u32) -> &[u32] {
        &self.triangles[self.begin[vertex as usize] as usize..self.begin[vertex as usize + 1] as usize]
    }
}

fn largest(weights: &[f64; 3]) -> usize {
    (1..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::mesh::topology::Topology;

    #[test]
    fn small_surfaces_stay_as_they_are() {
        let mesh = shapes::bumpy_sphere(12);
        let made = SimplifiedSurface::new(&mesh).unwrap();
        assert_eq!(made.triangles, mesh.triangles());
        assert_eq!(made.points, mesh.vertices());
        assert!((0..mesh.vertices().len() as u32).all(|v| made.nearest(v) == v));
        assert_eq!(made.samples.len(), SAMPLES);
    }

    /// Sides of the simplified bumpy ball are about 1.2/√600 long; it is smooth to curvatures of about 10 and steep slopes
    /// are rare.
    #[test]
    fn large_surfaces_keep_their_genus_and_all_vertices_lie_on_them() {
        let mesh = shapes::bumpy_sphere(40);
        let made = SimplifiedSurface::new(&mesh).unwrap();
        assert_eq!(made.points.len(), SIMPLIFIED_VERTICES);
        for (points, triangles) in [
            (made.points.clone(), made.triangles.clone()),
            (
                made.samples.iter().map(|&v| made.points[v as usize]).collect(),
                made.sample_triangles.clone(),
            ),
        ] {
            let surface = SurfaceMesh::new(points, triangles).unwrap();
            let topology = Topology::new(&surface);
            let shapes = topology.components().shapes;
            assert_eq!(
                (shapes.len(), shapes[0].genus(), shapes[0].vertices),
                (1, Some(0), surface.vertices().len())
            );
            assert!(topology.orientation().inconsistent_edges.is_empty() && surface.volume() > 0.0);
        }
        for axis in 0..3 {
            let values: Vec<f64> = made.points.iter().map(|p| p[axis]).collect();
            let found = made.interpolated(&values);
            let far = found
                .iter()
                .zip(mesh.vertices())
                .map(|(x, p)| (x - p[axis]).abs())
                .fold(0.0, f64::max);
            assert!(far < 0.03, "{far}");
        }
        for (place, &original) in made.originals.iter().enumerate() {
            assert_eq!(made.nearest(original), place as u32);
        }
    }
}
