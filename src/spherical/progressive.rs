//! Progressive spherical embedding: the vertices of a hierarchy are inserted one by one, each inside the ring of its
//! neighbours.
//!
//! No triangle is ever inverted: the coarsest mesh, a tetrahedron, becomes a regular one, and a vertex is inserted
//! where all its triangles are positive (Praun and Hoppe, *Spherical parametrization and remeshing*, 2003; Shen, Jiang,
//! Zorin, Panozzo, *Progressive embedding*, 2019).

use super::hierarchy::{Hierarchy, VertexRings};
use super::ring_kernel::{point_in_kernel, smallest_det};
use crate::geometry::sphere_rotation;
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::{Point, Vector};

/// An embedding of a simplified mesh, some of whose vertices are still to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct PartialEmbedding {
    pub rings: VertexRings,
    /// The unit vector of each inserted vertex.
    pub directions: Vec<Vector>,
    /// The inserted vertices, in the order of their insertion.
    pub inserted: Vec<u32>,
    /// The vertices of the last level are `inserted[level_start..]`.
    pub level_start: usize,
    /// Number of levels inserted.
    levels: usize,
}

/// The inserted part of an embedding, with its vertices numbered without gaps.
#[derive(Debug, Clone)]
pub(crate) struct InsertedMesh {
    /// The inserted vertices, ascending.
    pub vertices: Vec<u32>,
    /// Corners are places in `vertices`; in the order of [`VertexRings::triangles`].
    pub triangles: Vec<[u32; 3]>,
}

impl InsertedMesh {
    /// The vertices of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [u32; 3]> {
        self.triangles.iter().map(|t| t.map(|i| self.vertices[i as usize]))
    }

    /// The entries of these vertices in a list of all.
    pub fn of<T: Copy>(&self, all: &[T]) -> Vec<T> {
        self.vertices.iter().map(|&v| all[v as usize]).collect()
    }
}

impl PartialEmbedding {
    /// The inserted vertices and the triangles between them.
    pub fn inserted_mesh(&self) -> InsertedMesh {
        let mut vertices = self.inserted.clone();
        vertices.sort_unstable();
        let mut place = vec![0; self.directions.len()];
        for (i, &v) in vertices.iter().enumerate() {
            place[v as usize] = i as u32;
        }
        let triangles = self.rings.triangles().into_iter();
        InsertedMesh {
            triangles: triangles.map(|t| t.map(|v| place[v as usize])).collect(),
            vertices,
        }
    }

    /// Inserts vertices, level by level, until there are at least `enough`. After each level `improve` may move
    /// vertices, keeping all triangles positive.
    ///
    /// `None` when rounding leaves no position for a vertex: its ring is smaller than the spacing of coordinates.
    pub fn refine(&mut self, hierarchy: &Hierarchy, enough: usize, mut improve: impl FnMut(&mut Self)) -> Option<()> {
        for level in hierarchy.refinements().skip(self.levels) {
            if self.inserted.len() >= enough {
                break;
            }
            self.level_start = self.inserted.len();
            for insertion in level {
                let ring: Vec<Vector> = insertion.ring.iter().map(|&r| self.directions[r as usize]).collect();
                self.directions[insertion.vertex as usize] = point_in_kernel(&ring)?;
                self.rings.insert(&insertion);
                self.inserted.push(insertion.vertex);
            }
            self.levels += 1;
            improve(self);
        }
        Some(())
    }

    /// The coarsest mesh as a regular tetrahedron, rotated to bring its corners close to their targets.
    pub fn of_base(hierarchy: &Hierarchy, target: impl Fn(u32) -> Option<Vector>) -> Self {
        let mut directions = vec![Vector::zeros(); hierarchy.vertices];
        let third = (1f64 / 3.0).sqrt();
        let corners = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]];
        let [top, a, b] = hierarchy.base[0];
        // Counter-clockwise seen from outside, as `hierarchy.base[0]` is.
        let base = [top, a, b, hierarchy.base[1][2]];
        let regular = corners.map(|corner| third * Vector::from(corner));
        let targets = base.map(target);
        for (v, corner) in base.into_iter().zip(rotated_towards(regular, &targets)) {
            directions[v as usize] = corner;
        }
        Self {
            rings: VertexRings::new(hierarchy.vertices, &hierarchy.base),
            directions,
            inserted: base.to_vec(),
            level_start: 0,
            levels: 0,
        }
    }

    /// The embedding of a whole surface by these unit vectors.
    pub fn complete(surface: &SurfaceMesh, directions: &[Vector]) -> Self {
        let count = surface.vertices().len();
        Self {
            rings: VertexRings::new(count, surface.triangles()),
            directions: directions.to_vec(),
            inserted: (0..count as u32).collect(),
            level_start: 0,
            levels: usize::MAX,
        }
    }

    /// Whether the triangles of a vertex stay positive, beyond rounding, when it moves to `x`.
    pub fn stays_positive(&self, v: u32, x: &Vector) -> bool {
        let ring: Vec<Vector> = self.ring(v).collect();
        smallest_det(x, &ring) > 0.0
    }

    /// Directions of the neighbours of a vertex, counter-clockwise.
    fn ring(&self, v: u32) -> impl Iterator<Item = Vector> {
        self.rings.of(v).iter().map(|&r| self.directions[r as usize])
    }

    /// The factor that scales the area of the simplified mesh, with its vertices at `points`, to 4π.
    pub fn area_scale(&self, points: &[Point]) -> f64 {
        let area = |t: &[u32; 3]| triangle_area(&t.map(|v| points[v as usize]));
        let total: f64 = self.rings.triangles().iter().map(area).sum();
        4.0 * std::f64::consts::PI / total.max(f64::MIN_POSITIVE)
    }
}

/// The corners under the rotation that brings them closest to their targets.
fn rotated_towards(corners: [Vector; 4], targets: &[Option<Vector>; 4]) -> [Vector; 4] {
    let pairs = corners.iter().zip(targets).filter_map(|(c, w)| w.map(|w| (*c, w)));
    let (from, to): (Vec<Vector>, Vec<Vector>) = pairs.unzip();
    match sphere_rotation(&from, &to, &vec![1.0; from.len()]) {
        Some(turn) => corners.map(|c| (turn.rotation * c).normalize()),
        None => corners,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::spherical::check_embedding;

    #[test]
    fn every_level_is_one_to_one() {
        for mesh in [
            shapes::sphere(1.0, 4),
            shapes::cube(1.0, 10),
            shapes::polycube(&[[0, 0, 0], [1, 0, 0], [1, 1, 0]], 6),
        ] {
            let hierarchy = Hierarchy::new(mesh.vertices(), mesh.triangles(), &[]).unwrap();
            let mut embedding = PartialEmbedding::of_base(&hierarchy, |_| None);
            let completed = embedding.refine(&hierarchy, usize::MAX, |embedding| {
                let inserted = embedding.inserted_mesh();
                assert!(inserted.corners().eq(embedding.rings.triangles()));
                assert!(inserted.vertices.is_sorted() && inserted.vertices.len() == embedding.inserted.len());
                let first = hierarchy.coarsest(embedding.inserted.len());
                assert!(embedding.inserted.iter().all(|v| first.contains(v)));
                let check = check_embedding(&embedding.rings.triangles(), &embedding.directions);
                assert!(check.is_bijective(), "{check:?}");
            });
            assert!(completed.is_some());
            let check = check_embedding(mesh.triangles(), &embedding.directions);
            assert!(check.is_bijective() && (check.degree - 1.0).abs() < 1e-9);
        }
    }
}
