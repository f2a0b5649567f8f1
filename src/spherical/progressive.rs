//! Draws a surface on the sphere by putting the vertices of its hierarchy back, each inside the ring of its neighbours.
//!
//! Nothing ever folds: the tetrahedron at the bottom is drawn as a regular one, and a vertex is put where all its
//! triangles are positive (Praun and Hoppe, *Spherical parametrization and remeshing*, 2003; Shen, Jiang, Zorin, Panozzo,
//! *Progressive embedding*, 2019). Between levels vertices move towards the middle of their neighbours.

use super::hierarchy::{Hierarchy, Neighbours};
use super::kernel::{place_in_kernel, smallest_det};
use crate::Vector;

/// Rounds of relaxation after each level.
const SWEEPS: usize = 3;
/// A move may make the smallest triangle at a vertex smaller by this factor and no more.
const SHRINK: f64 = 0.1;

/// A drawing with part of the vertices.
pub(super) struct Drawing {
    pub neighbours: Neighbours,
    /// The unit vector of each vertex that is there.
    pub directions: Vec<Vector>,
    /// How many are there.
    pub present: usize,
}

/// Puts all vertices back. After each level `improve` may move them, keeping all triangles positive.
///
/// `None` when rounding leaves no place for a vertex: its ring is smaller than coordinates tell apart.
pub(super) fn embed(hierarchy: &Hierarchy, mut improve: impl FnMut(&mut Drawing)) -> Option<Drawing> {
    let mut drawing = Drawing::of_base(hierarchy);
    improve(&mut drawing);
    let mut there: Vec<u32> = drawing.neighbours.present();
    for level in hierarchy.refinements() {
        for insertion in level {
            let ring: Vec<Vector> = insertion.ring.iter().map(|&r| drawing.directions[r as usize]).collect();
            drawing.directions[insertion.vertex as usize] = place_in_kernel(&ring)?;
            drawing.neighbours.insert(&insertion);
            there.push(insertion.vertex);
        }
        drawing.present = there.len();
        for _ in 0..SWEEPS {
            drawing.relax(&there);
        }
        improve(&mut drawing);
    }
    Some(drawing)
}

impl Drawing {
    fn of_base(hierarchy: &Hierarchy) -> Self {
        let mut directions = vec![Vector::zeros(); hierarchy.vertices()];
        let third = (1f64 / 3.0).sqrt();
        let corners = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]];
        let [top, a, b] = hierarchy.base[0];
        let c = hierarchy.base[1][2];
        // Counter-clockwise seen from outside, as `hierarchy.base[0]` is.
        for (v, corner) in [top, a, b, c].into_iter().zip(corners) {
            directions[v as usize] = third * Vector::from(corner);
        }
        Self {
            neighbours: Neighbours::of_base(hierarchy),
            directions,
            present: 4,
        }
    }

    /// Moves each vertex towards the middle of its neighbours, as far as its triangles stay positive and do not shrink
    /// much.
    fn relax(&mut self, vertices: &[u32]) {
        let mut ring: smallvec::SmallVec<[Vector; 16]> = smallvec::SmallVec::new();
        for &v in vertices {
            ring.clear();
            ring.extend(self.neighbours.of(v).iter().map(|&r| self.directions[r as usize]));
            let here = self.directions[v as usize];
            let before = smallest_det(&here, &ring);
            let middle: Vector = ring.iter().sum();
            let length = middle.norm();
            if length < 1e-3 * ring.len() as f64 {
                continue;
            }
            let mut step = 1.0;
            for _ in 0..4 {
                let x = (here + step * (middle / length - here)).normalize();
                if smallest_det(&x, &ring) > SHRINK * before {
                    self.directions[v as usize] = x;
                    break;
                }
                step *= 0.4;
            }
        }
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
            let drawing = embed(&hierarchy, |drawing| {
                let certificate = certify(&drawing.neighbours.triangles(), &drawing.directions);
                assert!(certificate.is_bijective(), "{certificate:?}");
            });
            let certificate = certify(mesh.triangles(), &drawing.unwrap().directions);
            assert!(certificate.is_bijective() && (certificate.degree - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn try_models() {
        let folder = std::path::PathBuf::from(std::env::var("SOLIDMAP_MODELS").unwrap());
        for name in [
            "surfaces/goathead_2k8.obj",
            "surfaces/armadillo_15k.obj",
            "surfaces/igea_15k.obj",
            "surfaces/bunny_50k.obj",
            "surfaces/igea_134k.ply",
            "pairs/hand_plain.obj",
            "pairs/cat.obj",
            "pairs/horse.obj",
        ] {
            let mesh = crate::io::read_surface(folder.join(name)).unwrap();
            let t = std::time::Instant::now();
            let hierarchy = Hierarchy::new(mesh.vertices(), mesh.triangles(), &[]).unwrap();
            let t1 = t.elapsed().as_secs_f64();
            let drawing = embed(&hierarchy, |_| {}).unwrap();
            let t2 = t.elapsed().as_secs_f64();
            let c = certify(mesh.triangles(), &drawing.directions);
            let mut dets: Vec<f64> = mesh
                .triangles()
                .iter()
                .map(|t| {
                    let [a, b, c] = t.map(|v| drawing.directions[v as usize]);
                    crate::spherical::kernel::det(&a, &b, &c)
                })
                .collect();
            dets.sort_by(f64::total_cmp);
            println!(
                "{name} {} hierarchy {t1:.2} embed {:.2} levels {} {c:?} dets {:e} {:e} {:e}",
                mesh.vertices().len(),
                t2 - t1,
                hierarchy.refinements().count(),
                dets[0],
                dets[dets.len() / 100],
                dets[dets.len() / 2]
            );
        }
    }
}
