//! Triangles whose images bend: the map goes through the sphere and follows the target, while the straight triangle between
//! the images of the corners may cut through a limb, and has little distortion where the map has much. Their energy is that of
//! four pieces, cut at the midpoints of their sides on the sphere.

use nalgebra::{SMatrix, SVector};

use super::inter_surface::{DomainTriangle, InverseEmbedding, VertexImage, jacobian_invariants};
use crate::{Matrix3, Point, Vector};

/// The corners of the pieces: 0 to 2 are those of the triangle, 3 to 5 the midpoints of [`SIDES`]. All pieces are similar to
/// the triangle, their corners in its order.
const PIECES: [[usize; 3]; 4] = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [4, 5, 3]];
const SIDES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// The images of the corners of the pieces, and their derivatives by `N` coordinates.
pub(super) struct BentImage<const N: usize> {
    points: [Point; 6],
    chains: [SMatrix<f64, 3, N>; 6],
}

/// Energy of a triangle's image, over 4: `(|J|² + |J⁻¹|²) / 4` times its area.
pub(super) fn straight_energy([y, a, b]: [&Point; 3], triangle: &DomainTriangle) -> f64 {
    let (s, c, _) = jacobian_invariants(y, a, b, triangle);
    0.25 * triangle.rest.area * (s + s / (c * c))
}

/// The same of the four pieces. `hints` are triangles of the target near the middles of [`SIDES`].
pub(super) fn bent_energy(
    inverse: &InverseEmbedding,
    x: [&Vector; 3],
    corners: [&VertexImage; 3],
    hints: [u32; 3],
    triangle: &DomainTriangle,
) -> f64 {
    let middles = middles(inverse, x, hints);
    pieces_energy(
        corners.map(|corner| &corner.point),
        middles.each_ref().map(|middle| &middle.point),
        triangle,
    )
}

/// The energy of the four pieces between the images of the corners and of the middles of [`SIDES`].
pub(super) fn pieces_energy(corners: [&Point; 3], middles: [&Point; 3], triangle: &DomainTriangle) -> f64 {
    let [a, b, c] = corners;
    let [d, e, f] = middles;
    let points = [a, b, c, d, e, f];
    let piece = triangle.piece();
    PIECES
        .iter()
        .map(|p| straight_energy(p.map(|k| points[k]), &piece))
        .sum()
}

/// The images of the middles of [`SIDES`].
pub(super) fn middles(inverse: &InverseEmbedding, x: [&Vector; 3], hints: [u32; 3]) -> [VertexImage; 3] {
    [0, 1, 2].map(|k| {
        let [m, n] = SIDES[k];
        middle(inverse, x[m], x[n], hints[k])
    })
}

/// The image of the middle of a side on the sphere.
pub(super) fn middle(inverse: &InverseEmbedding, a: &Vector, b: &Vector, hint: u32) -> VertexImage {
    inverse.image(&(a + b).normalize(), hint)
}

/// The same, with derivatives: `moved` are those of `a + b`.
pub(super) fn moved_middle<const N: usize>(
    inverse: &InverseEmbedding,
    a: &Vector,
    b: &Vector,
    hint: u32,
    moved: &SMatrix<f64, 3, N>,
) -> (Point, SMatrix<f64, 3, N>) {
    let sum = a + b;
    let (middle, length) = (sum.normalize(), sum.norm());
    let image = inverse.image(&middle, hint);
    let turn = (Matrix3::identity() - middle * middle.transpose()) / length;
    (image.point, inverse.derivative(&middle, &image) * turn * moved)
}

/// [`moved_middle`] of all [`SIDES`], from the derivatives of the directions of the corners (tangent to the sphere).
pub(super) fn moved_middles<const N: usize>(
    inverse: &InverseEmbedding,
    x: [&Vector; 3],
    hints: [u32; 3],
    directions: &[SMatrix<f64, 3, N>; 3],
) -> [(Point, SMatrix<f64, 3, N>); 3] {
    [0, 1, 2].map(|k| {
        let [m, n] = SIDES[k];
        moved_middle(inverse, x[m], x[n], hints[k], &(directions[m] + directions[n]))
    })
}

impl<const N: usize> BentImage<N> {
    /// From the images of the corners and of the middles of [`SIDES`], and their derivatives by the coordinates.
    pub fn new(
        corners: [&Point; 3],
        chains: [SMatrix<f64, 3, N>; 3],
        middles: [(Point, SMatrix<f64, 3, N>); 3],
    ) -> Self {
        let [a, b, c] = corners;
        let [(d, of_d), (e, of_e), (f, of_f)] = middles;
        let [of_a, of_b, of_c] = chains;
        Self {
            points: [*a, *b, *c, d, e, f],
            chains: [of_a, of_b, of_c, of_d, of_e, of_f],
        }
    }

    /// First derivatives of the [energy](pieces_energy), and semidefinite ones in place of the second.
    pub fn derivatives(&self, triangle: &DomainTriangle) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let (mut gradient, mut hessian) = (SVector::zeros(), SMatrix::zeros());
        let piece = triangle.piece();
        for corners in PIECES {
            let points = corners.map(|k| &self.points[k]);
            let chains = corners.map(|k| &self.chains[k]);
            add_straight(points, chains, &piece, &mut gradient, &mut hessian);
        }
        (gradient, hessian)
    }
}

/// Adds the derivatives of [`straight_energy`] by `N` coordinates, from those of the corners.
pub(super) fn add_straight<const N: usize>(
    [y, a, b]: [&Point; 3],
    chains: [&SMatrix<f64, 3, N>; 3],
    triangle: &DomainTriangle,
    gradient: &mut SVector<f64, N>,
    hessian: &mut SMatrix<f64, N, N>,
) {
    let DomainTriangle {
        rest, reference_area, ..
    } = triangle;
    let [cy, ca, cb] = rest.cotangents;
    let (s, c, normal) = jacobian_invariants(y, a, b, triangle);
    let ds = [
        ca * (y - b) + cb * (y - a),
        cb * (a - y) + cy * (a - b),
        cy * (b - a) + ca * (b - y),
    ];
    let dc = [b - a, y - b, a - y].map(|v| normal.cross(&v) / (2.0 * reference_area));
    let (mut gs, mut gc, mut metric) = (SVector::<f64, N>::zeros(), SVector::<f64, N>::zeros(), SMatrix::zeros());
    for (k, chain) in chains.iter().enumerate() {
        gs += chain.tr_mul(&(ds[k] / *reference_area));
        gc += chain.tr_mul(&dc[k]);
        let side = chains[(k + 1) % 3] - chains[(k + 2) % 3];
        metric += side.tr_mul(&side) * (rest.cotangents[k] / reference_area);
    }
    let (c2, c3) = (c * c, c * c * c);
    let w = 0.25 * rest.area;
    // The second derivatives of c are left out, and the mixed term is bounded so that the rest is semidefinite: s is half a
    // quadratic form, so that its second derivatives are at least gs gsᵀ / 2s, and what is left is a form in two
    // variables. The bound takes effect where c² < 1/3, and changes the term by less than a seventh.
    let mixed = (2.0 / c3).min((3.0 * (1.0 + 1.0 / c2)).sqrt() / c2);
    let cross = gs * gc.transpose();
    *gradient += (gs * (1.0 + 1.0 / c2) - gc * (2.0 * s / c3)) * w;
    *hessian += (metric * (1.0 + 1.0 / c2) - (cross + cross.transpose()) * mixed
        + gc * gc.transpose() * (6.0 * s / (c2 * c2)))
        * w;
}
