//! The shape of tetrahedra and hexahedra.
//!
//! Knupp, *Achieving finite element mesh quality via optimization of the Jacobian matrix norm and associated quantities*,
//! International Journal for Numerical Methods in Engineering 48 (2000); Stimpson et al., *The Verdict geometric quality
//! library*, Sandia National Laboratories, 2007.

use crate::mesh::HEX_CORNERS;
use crate::{Point, Vector};

/// √2 times a tetrahedron's determinant over the largest product of the lengths of the three edges at a corner: 1 when it
/// is regular, negative when it is left-handed, NaN when its corners coincide.
pub(crate) fn tet_scaled_jacobian(p: &[Point; 4]) -> f64 {
    let length = |i: usize, j: usize| (p[i] - p[j]).norm();
    let largest = (0..4)
        .map(|i| (0..4).filter(|&j| j != i).map(|j| length(i, j)).product::<f64>())
        .fold(0.0, f64::max);
    std::f64::consts::SQRT_2 * (p[1] - p[0]).dot(&(p[2] - p[0]).cross(&(p[3] - p[0]))) / largest
}

/// The least determinant of the three unit edges at a corner of a hexahedron: 1 for a box, NaN where an edge has no
/// length.
pub(crate) fn hex_scaled_jacobian(p: &[Point; 8]) -> f64 {
    let corner = |[a, b, c, d]: &[usize; 4]| {
        let [a, b, c] = [p[*b] - p[*a], p[*c] - p[*a], p[*d] - p[*a]].map(|e| e.normalize());
        a.dot(&b.cross(&c))
    };
    HEX_CORNERS.iter().map(corner).fold(f64::INFINITY, lesser)
}

/// Gradients of the trilinear shape functions of a cube's corners.
pub(crate) fn trilinear_gradients(at: [f64; 3]) -> [Vector; 8] {
    std::array::from_fn(|k| {
        // Around the bottom, then the top.
        let upper = [matches!(k % 4, 1 | 2), k % 4 > 1, k > 3];
        let value = |m: usize| if upper[m] { at[m] } else { 1.0 - at[m] };
        let sign = |m: usize| if upper[m] { 1.0 } else { -1.0 };
        Vector::from_fn(|m, _| sign(m) * value((m + 1) % 3) * value((m + 2) % 3))
    })
}

/// The smaller of two numbers; NaN if one is, where `f64::min` would return the other.
pub(crate) fn lesser(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}
