//! Draws a surface on the sphere by putting the vertices of its hierarchy back, each inside the ring of its neighbours.
//!
//! Nothing ever folds: the tetrahedron at the bottom is drawn as a regular one, and a vertex is put where all its
//! triangles are positive (Praun and Hoppe, *Spherical parametrization and remeshing*, 2003; Shen, Jiang, Zorin, Panozzo,
//! *Progressive embedding*, 2019).

use super::hierarchy::{Hierarchy, Neighbours};
use super::kernel::{place_in_kernel, smallest_det};
use crate::geometry::sphere_rotation;
use crate::mesh::SurfaceMesh;
use crate::{Point, Vector};

/// A drawing with part of the vertices.
#[derive(Debug, Clone)]
pub(crate) struct Drawing {
    pub neighbours: Neighbours,
    /// The unit vector of each vertex that is there.
    pub directions: Vec<Vector>,
    /// The vertices that are there, in the order in which they came.
    pub there: Vec<u32>,
    /// Those of the last level are `there[arrived..]`.
    pub arrived: usize,
    /// Levels put back.
    levels: usize,
}

/// Puts all vertices back, beginning with four near `base` (see [`Drawing::of_base`]). After each level `improve` may move
/// them, keeping all triangles positive.
///
/// `None` when rounding leaves no place for a vertex: its ring is smaller than coordinates tell apart.
pub(crate) fn embed(
    hierarchy: &Hierarchy,
    base: impl Fn(u32) -> Option<Vector>,
    improve: impl FnMut(&mut Drawing),
) -> Option<Drawing> {
    let mut drawing = Drawing::of_base(hierarchy, base);
    drawing.refine(hierarchy, usize::MAX, improve)?;
    Some(drawing)
}

impl Drawing {
    /// Puts vertices back, level by level, until there are at least `enough`; goes on where it stopped before. After each
    /// level `improve` may move vertices, keeping all triangles positive.
    ///
    /// `None` when rounding leaves no place for a vertex.
    pub fn refine(&mut self, hierarchy: &Hierarchy, enough: usize, mut improve: impl FnMut(&mut Self)) -> Option<()> {
        for level in hierarchy.refinements().skip(self.levels) {
            if self.there.len() >= enough {
                break;
            }
            self.arrived = self.there.len();
            for insertion in level {
                let ring: Vec<Vector> = insertion.ring.iter().map(|&r| self.directions[r as usize]).collect();
                self.directions[insertion.vertex as usize] = place_in_kernel(&ring)?;
                self.neighbours.insert(&insertion);
                self.there.push(insertion.vertex);
            }
            self.levels += 1;
            improve(self);
        }
        Some(())
    }

    /// The tetrahedron: a regular one, turned to be close to the places that are wanted of its corners.
    pub fn of_base(hierarchy: &Hierarchy, wanted: impl Fn(u32) -> Option<Vector>) -> Self {
        let mut directions = vec![Vector::zeros(); hierarchy.vertices()];
        let third = (1f64 / 3.0).sqrt();
        let corners = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]];
        let [top, a, b] = hierarchy.base[0];
        // Counter-clockwise seen from outside, as `hierarchy.base[0]` is.
        let base = [top, a, b, hierarchy.base[1][2]];
        let regular = corners.map(|corner| third * Vector::from(corner));
        let wanted = base.map(wanted);
        for (v, corner) in base.into_iter().zip(turned_towards(regular, &wanted)) {
            directions[v as usize] = corner;
        }
        Self {
            neighbours: Neighbours::of_base(hierarchy),
            directions,
            there: base.to_vec(),
            arrived: 0,
            levels: 0,
        }
    }

    /// A whole surface at these unit vectors.
    pub fn of(surface: &SurfaceMesh, directions: &[Vector]) -> Self {
        let count = surface.vertices().len();
        Self {
            neighbours: Neighbours::of_surface(count, surface.triangles()),
            directions: directions.to_vec(),
            there: (0..count as u32).collect(),
            arrived: 0,
            levels: usize::MAX,
        }
    }

    /// Whether the triangles at a vertex are all positive, beyond rounding, with the vertex at `x`.
    pub fn fits(&self, v: u32, x: &Vector) -> bool {
        let ring: Vec<Vector> = self.ring(v).collect();
        smallest_det(x, &ring) > 0.0
    }

    /// Where the neighbours of a vertex stand, counter-clockwise.
    pub fn ring(&self, v: u32) -> impl Iterator<Item = Vector> {
        self.neighbours.of(v).iter().map(|&r| self.directions[r as usize])
    }

    /// What areas of the surface that is drawn, with its vertices at `points`, are to be multiplied by to make 4π.
    pub fn area_unit(&self, points: &[Point]) -> f64 {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        let total: f64 = self.neighbours.triangles().iter().map(area).sum();
        4.0 * std::f64::consts::PI / total.max(f64::MIN_POSITIVE)
    }
}

/// The corners, turned to be close to the places that are wanted of them.
fn turned_towards(corners: [Vector; 4], wanted: &[Option<Vector>; 4]) -> [Vector; 4] {
    let pairs = corners.iter().zip(wanted).filter_map(|(c, w)| w.map(|w| (*c, w)));
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
    use crate::spherical::certify;

    #[test]
    fn every_level_is_one_to_one() {
        for mesh in [
            shapes::sphere(1.0, 4),
            shapes::cube(1.0, 10),
            shapes::polycube(&[[0, 0, 0], [1, 0, 0], [1, 1, 0]], 6),
        ] {
            let hierarchy = Hierarchy::new(mesh.vertices(), mesh.triangles(), &[]).unwrap();
            let drawing = embed(
                &hierarchy,
                |_| None,
                |drawing| {
                    let certificate = certify(&drawing.neighbours.triangles(), &drawing.directions);
                    assert!(certificate.is_bijective(), "{certificate:?}");
                },
            );
            let certificate = certify(mesh.triangles(), &drawing.unwrap().directions);
            assert!(certificate.is_bijective() && (certificate.degree - 1.0).abs() < 1e-9);
        }
    }
}
