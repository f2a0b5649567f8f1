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
    let (mut from, mut to) = (vec![0.0; modes], vec![0.0; modes]);
    for MappedVertex { vertex, area, image } in vertices {
        domain.eigenfunctions_at(vertex, 1.0, &mut from);
        to.fill(0.0);
        let mut at_corner = vec![0.0; modes];
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
