//! How far a map between two surfaces is from an isometry, by the functional map that it induces.
//!
//! Ovsjanikov, Ben-Chen, Solomon, Butscher, Guibas, *Functional maps: a flexible representation of maps between shapes*,
//! ACM Trans. Graph. 31 (2012). Low eigenfunctions tell limbs apart: a map that takes a leg to another leg moves the ends of
//! its functional map's columns, however little it distorts each triangle.

use nalgebra::DMatrix;

use super::IntrinsicShape;
use super::functional_map::{MODES, defect};

/// A vertex of the domain with its image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MappedVertex {
    pub vertex: u32,
    /// The area that it stands for, in any unit.
    pub area: f64,
    /// Corners of the target's triangle with the image, with their barycentric coordinates.
    pub image: [(u32, f64); 3],
}

/// `‖CᵀC − I‖² / 20` of the functional map `C` of 20 modes that a map induces, given at some vertices: 0 for an isometry. `None`
/// when they do not determine it.
///
/// `C` is the solution of weighted least squares, as in [`super::functional_map::fit`]. Takes 2·20² multiplications for each
/// vertex.
pub(crate) fn isometry_defect(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    vertices: impl Iterator<Item = MappedVertex>,
) -> Option<f64> {
    let modes = MODES.min(domain.modes()).min(target.modes());
    let (mut gram, mut products) = (DMatrix::zeros(modes, modes), DMatrix::zeros(modes, modes));
    let [mut from, mut to, mut at_corner] = std::array::from_fn(|_| vec![0.0; modes]);
    for MappedVertex { vertex, area, image } in vertices {
        domain.eigenfunctions_at(vertex, 1.0, &mut from);
        to.fill(0.0);
        for (corner, weight) in image {
            target.eigenfunctions_at(corner, weight, &mut at_corner);
            to.iter_mut().zip(&at_corner).for_each(|(sum, x)| *sum += x);
        }
        for (j, (psi, phi_j)) in to.iter().zip(&from).enumerate() {
            for (i, phi) in from.iter().enumerate() {
                products[(i, j)] += area * phi * psi;
                gram[(i, j)] += area * phi * phi_j;
            }
        }
    }
    let matrix = gram.cholesky()?.solve(&products);
    let found = defect(&matrix);
    found.is_finite().then_some(found)
}

impl IntrinsicShape {
    /// The first eigenfunctions at a vertex of the surface as it was given, times a weight.
    fn eigenfunctions_at(&self, vertex: u32, weight: f64, out: &mut [f64]) {
        out.fill(0.0);
        let place = &self.simplified.places[vertex as usize];
        let corners = self.simplified.triangles[place.triangle as usize];
        for (corner, coordinate) in corners.iter().zip(place.barycentric) {
            let row = self.eigenpairs.at(*corner);
            out.iter_mut()
                .zip(row)
                .for_each(|(sum, x)| *sum += weight * coordinate * x);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::intrinsic::correspondence_of_map;
    use crate::mesh::{SurfaceMesh, shapes, triangle_area};
    use crate::spherical::{Locator, SphericalEmbedding};
    use crate::{Point, Vector};

    /// A ball with three limbs, star-shaped.
    fn star(lengths: [f64; 3]) -> SurfaceMesh {
        let limbs = [[1.0, 0.2, 0.1], [-0.6, 0.9, 0.0], [-0.1, -0.4, 1.0]].map(|d| Vector::from(d).normalize());
        let radius = |x: &Vector| {
            let limb = |(d, length): (&Vector, f64)| length * (-18.0 * (1.0 - x.dot(d))).exp();
            1.0 + limbs.iter().zip(lengths).map(limb).sum::<f64>()
        };
        shapes::deformed(&shapes::sphere(1.0, 4), |p| p * radius(&p.coords.normalize()))
    }

    /// The defect of the map that turns directions, from a star to another.
    fn defect_of_turn(from: &SurfaceMesh, to: &SurfaceMesh, turn: &Rotation3<f64>) -> f64 {
        let directions: Vec<Vector> = to.vertices().iter().map(|p| p.coords.normalize()).collect();
        let locator = Locator::new(&SphericalEmbedding::new(to.clone(), &directions).unwrap());
        let mut areas = vec![0.0; from.vertices().len()];
        for t in from.triangles() {
            let area = triangle_area(&t.map(|v| from.vertices()[v as usize]));
            t.iter().for_each(|&v| areas[v as usize] += area / 3.0);
        }
        let mapped = |(vertex, p): (u32, &Point)| {
            let place = locator.locate(&(turn * p.coords));
            let corners = to.triangles()[place.triangle as usize];
            MappedVertex {
                vertex,
                area: areas[vertex as usize],
                image: std::array::from_fn(|k| (corners[k], place.barycentric[k])),
            }
        };
        let [from_shape, to_shape] = [from, to].map(|surface| IntrinsicShape::new(surface, 60, &|| true).unwrap());
        isometry_defect(&from_shape, &to_shape, (0..).zip(from.vertices()).map(mapped)).unwrap()
    }

    #[test]
    fn an_isometry_has_no_defect_and_limbs_on_other_limbs_have_much() {
        let lengths = [2.0, 1.6, 1.3];
        let own = star(lengths);
        let none = Rotation3::identity();
        let identity = defect_of_turn(&own, &own, &none);
        assert!(identity < 1e-12, "{identity}");
        let [a, b] = [[1.0, 0.2, 0.1], [-0.6, 0.9, 0.0]].map(Vector::from);
        let to_other_limb = Rotation3::rotation_between(&a, &b).unwrap();
        let wrong = defect_of_turn(&own, &own, &to_other_limb);
        let longer = defect_of_turn(&own, &star([2.1, 1.6, 1.25]), &none);
        assert!(longer < 0.05 && wrong > 0.2, "{longer} {wrong}");
    }

    #[test]
    fn size_and_place_do_not_matter() {
        let (own, other) = (star([2.0, 1.6, 1.3]), star([1.8, 1.6, 1.5]));
        let turn = Rotation3::from_euler_angles(0.2, -0.1, 0.3);
        let scaled = shapes::deformed(&other, |p| p * 30.0);
        let [plain, scaled] = [&other, &scaled].map(|to| defect_of_turn(&own, to, &turn));
        assert!((plain - scaled).abs() < 1e-6 * plain, "{plain} {scaled}");
    }

    /// A map with a part out of order: the vertices around one limb's tip all go to one point. Refined by eigenfunctions it has them in
    /// their places again.
    #[test]
    fn a_part_of_a_map_that_is_out_of_order_is_set_right_by_eigenfunctions() {
        let surface = star([1.0, 0.7, 0.5]);
        let shape = IntrinsicShape::new(&surface, 60, &|| true).unwrap();
        let tip = (0..surface.vertices().len())
            .max_by(|&a, &b| {
                let length = |v: usize| surface.vertices()[v].coords.norm();
                length(a).total_cmp(&length(b))
            })
            .unwrap();
        let position = |v: u32| surface.vertices()[v as usize];
        let is_near = |v: u32| (position(v) - position(tip as u32)).norm() < 0.5;
        let broken = |v: u32| if is_near(v) { tip as u32 } else { v };
        let found = correspondence_of_map(&shape, &shape, broken, &|| true).unwrap();
        let vertices = (0..surface.vertices().len() as u32).filter(|&v| is_near(v));
        let error = |v: u32| found[v as usize].map_or(1.0, |(w, _)| (position(w) - position(v)).norm());
        let (mut errors, mut before): (Vec<f64>, Vec<f64>) = vertices
            .map(|v| (error(v), (position(v) - position(tip as u32)).norm()))
            .unzip();
        errors.sort_by(f64::total_cmp);
        before.sort_by(f64::total_cmp);
        let middle = errors.len() / 2;
        assert!(
            middle > 5 && errors[middle] < 0.3 * before[middle],
            "{} of {}",
            errors[middle],
            before[middle]
        );
    }
}
