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
fn add_straight<const N: usize>(
    points: [&Point; 3],
    chains: [&SMatrix<f64, 3, N>; 3],
    triangle: &DomainTriangle,
    gradient: &mut SVector<f64, N>,
    hessian: &mut SMatrix<f64, N, N>,
) {
    let slopes = InvariantSlopes::new(points, triangle);
    let (mut by_s, mut by_c, mut metric) = (SVector::zeros(), SVector::zeros(), SMatrix::zeros());
    for (k, chain) in chains.iter().enumerate() {
        by_s += chain.tr_mul(&slopes.by_s[k]);
        by_c += chain.tr_mul(&slopes.by_c[k]);
        let side = chains[(k + 1) % 3] - chains[(k + 2) % 3];
        metric += side.tr_mul(&side) * slopes.cotangents[k];
    }
    slopes.add(&by_s, &by_c, &metric, gradient, hessian);
}

/// The same by two coordinates of each corner, which move that corner alone.
pub(super) fn add_straight_of_corners(
    points: [&Point; 3],
    chains: [&[Vector; 2]; 3],
    triangle: &DomainTriangle,
    gradient: &mut SVector<f64, 6>,
    hessian: &mut SMatrix<f64, 6, 6>,
) {
    let slopes = InvariantSlopes::new(points, triangle);
    let by = |slopes: &[Vector; 3]| SVector::from_fn(|i, _| slopes[i / 2].dot(&chains[i / 2][i % 2]));
    let (by_s, by_c) = (by(&slopes.by_s), by(&slopes.by_c));
    let cotangents = slopes.cotangents;
    let mut metric = SMatrix::<f64, 6, 6>::zeros();
    for i in 0..6 {
        for j in 0..=i {
            let (m, n) = (i / 2, j / 2);
            let weight = match m == n {
                true => cotangents[(m + 1) % 3] + cotangents[(m + 2) % 3],
                false => -cotangents[3 - m - n],
            };
            let entry = weight * chains[m][i % 2].dot(&chains[n][j % 2]);
            metric[(i, j)] = entry;
            metric[(j, i)] = entry;
        }
    }
    slopes.add(&by_s, &by_c, &metric, gradient, hessian);
}

/// The derivatives of the squared norm `s` of the Jacobian and of its determinant `c` by the corners of the image.
struct InvariantSlopes {
    s: f64,
    c: f64,
    /// Area of the triangle, over 4.
    weight: f64,
    by_s: [Vector; 3],
    by_c: [Vector; 3],
    /// The second derivatives of `s` are those of the squared sides opposite to the corners, times these.
    cotangents: [f64; 3],
}

impl InvariantSlopes {
    fn new([y, a, b]: [&Point; 3], triangle: &DomainTriangle) -> Self {
        let reference_area = triangle.reference_area;
        let [cy, ca, cb] = triangle.rest.cotangents;
        let (s, c, normal) = jacobian_invariants(y, a, b, triangle);
        let by_s = [
            ca * (y - b) + cb * (y - a),
            cb * (a - y) + cy * (a - b),
            cy * (b - a) + ca * (b - y),
        ];
        Self {
            s,
            c,
            weight: 0.25 * triangle.rest.area,
            by_s: by_s.map(|v| v / reference_area),
            by_c: [b - a, y - b, a - y].map(|v| normal.cross(&v) / (2.0 * reference_area)),
            cotangents: triangle.rest.cotangents.map(|cotangent| cotangent / reference_area),
        }
    }

    /// Adds the derivatives of the energy by `N` coordinates, from those of `s` and `c`, and the second ones of `s`.
    fn add<const N: usize>(
        &self,
        by_s: &SVector<f64, N>,
        by_c: &SVector<f64, N>,
        metric: &SMatrix<f64, N, N>,
        gradient: &mut SVector<f64, N>,
        hessian: &mut SMatrix<f64, N, N>,
    ) {
        let &Self { s, c, weight, .. } = self;
        let (c2, c3) = (c * c, c * c * c);
        // The second derivatives of c are left out, and the mixed term is bounded so that the rest is semidefinite: s is half a
        // quadratic form, so that its second derivatives are at least gs gsᵀ / 2s, and what is left is a form in two
        // variables. The bound takes effect where c² < 1/3, and changes the term by less than a seventh.
        let mixed = (2.0 / c3).min((3.0 * (1.0 + 1.0 / c2)).sqrt() / c2);
        let cross = by_s * by_c.transpose();
        *gradient += (by_s * (1.0 + 1.0 / c2) - by_c * (2.0 * s / c3)) * weight;
        *hessian += (metric * (1.0 + 1.0 / c2) - (cross + cross.transpose()) * mixed
            + by_c * by_c.transpose() * (6.0 * s / (c2 * c2)))
            * weight;
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::spherical::RestShape;

    #[test]
    fn derivatives_by_corners_of_their_own_are_those_by_all_coordinates() {
        let mut random = StdRng::seed_from_u64(7);
        let mut vector = || Vector::from_fn(|_, _| random.random_range(-1.0..1.0));
        for _ in 0..50 {
            let corners: [Point; 3] = std::array::from_fn(|_| vector().into());
            let image: [Point; 3] = std::array::from_fn(|_| vector().into());
            let chains: [[Vector; 2]; 3] = std::array::from_fn(|_| [vector(), vector()]);
            let rest = RestShape::of_triangle(corners.each_ref(), 1.0);
            let triangle = DomainTriangle {
                rest,
                reference_area: 0.7 * rest.area,
                is_bent: false,
            };
            let in_columns: [SMatrix<f64, 3, 6>; 3] = std::array::from_fn(|k| {
                let mut all = SMatrix::<f64, 3, 6>::zeros();
                all.set_column(2 * k, &chains[k][0]);
                all.set_column(2 * k + 1, &chains[k][1]);
                all
            });
            let [mut expected, mut found] = [(SVector::zeros(), SMatrix::zeros()); 2];
            let points = image.each_ref();
            add_straight(
                points,
                in_columns.each_ref(),
                &triangle,
                &mut expected.0,
                &mut expected.1,
            );
            add_straight_of_corners(points, chains.each_ref(), &triangle, &mut found.0, &mut found.1);
            assert!((found.0 - expected.0).norm() < 1e-12 * expected.0.norm());
            assert!((found.1 - expected.1).norm() < 1e-12 * expected.1.norm());
        }
    }
}
