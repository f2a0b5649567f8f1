//! Whether the trilinear map of a hexahedron has a positive determinant everywhere inside.
//!
//! Johnen, Remacle & Geuzaine, *Geometrical validity of curvilinear finite elements*, Journal of Computational Physics 233
//! (2013): the determinant is a polynomial of degree 2 in each coordinate, which is at least the least of its 27 Bernstein
//! coefficients; those at the corners are values. Where they do not decide, the cube is halved in each direction.

use super::cell_shape::lesser;
use crate::{Point, Vector};

/// How often a cube is halved before it counts as undecided.
const MOST_HALVINGS: u32 = 8;
/// Cubes looked at before a hexahedron counts as undecided. Nearly all hexahedra take one.
const MOST_CUBES: usize = 4096;
/// Rounding errors of a coefficient, as a multiple of the product of the longest edges in each direction: a mean of at most
/// eight determinants, with at most a dozen roundings each, and two more for each axis of each halving.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Bernstein coefficients of degree 2 in three variables, by steps along each.
type Coefficients = [[[f64; 3]; 3]; 3];

/// Whether the determinant of the trilinear map is proved to be positive in the whole of a hexahedron. `false` where it
/// is not, where rounding leaves it open (zero within about 1e-14 of the product of the edges), and where a corner is not
/// finite.
pub(crate) fn is_hex_positive(corners: &[Point; 8]) -> bool {
    let (coefficients, rounding) = determinant(corners);
    let mut open = vec![(coefficients, 0)];
    let mut cubes = 0;
    while let Some((coefficients, halvings)) = open.pop() {
        cubes += 1;
        if least(coefficients.as_flattened().as_flattened()) > rounding {
            continue;
        }
        let corner = |k: usize| coefficients[2 * (k & 1)][2 * (k >> 1 & 1)][2 * (k >> 2)];
        let is_possible = least(&std::array::from_fn::<f64, 8, _>(corner)) > rounding;
        if !is_possible || halvings == MOST_HALVINGS || cubes == MOST_CUBES {
            return false;
        }
        open.extend(halved(&coefficients).map(|part| (part, halvings + 1)));
    }
    true
}

fn least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, lesser)
}

/// The coefficients of the determinant, and a bound on their rounding errors.
fn determinant(corners: &[Point; 8]) -> (Coefficients, f64) {
    // A corner by its steps along each axis: the list goes around the bottom, then around the top.
    let at = |[u, v, w]: [usize; 3]| corners[4 * w + [[0, 3], [1, 2]][u][v]];
    // The derivative along an axis is linear along the two others; its coefficients are the edges.
    let edges = |axis: usize| -> [[Vector; 2]; 2] {
        let corner = |along: usize, b: usize, c: usize| {
            let mut steps = [0; 3];
            steps[axis] = along;
            steps[(axis + 1) % 3] = b;
            steps[(axis + 2) % 3] = c;
            at(steps)
        };
        std::array::from_fn(|b| std::array::from_fn(|c| corner(1, b, c) - corner(0, b, c)))
    };
    let [along_u, along_v, along_w] = [0, 1, 2].map(edges);
    let longest = |edges: &[[Vector; 2]; 2]| edges.as_flattened().iter().map(Vector::norm).fold(0.0, f64::max);
    let mut sums = Coefficients::default();
    for k in 0..64_usize {
        let bit = |n: usize| k >> n & 1;
        let (u, v, w) = (
            along_u[bit(0)][bit(1)],
            along_v[bit(2)][bit(3)],
            along_w[bit(4)][bit(5)],
        );
        // Along u, v and w: two of the three factors are linear in each.
        sums[bit(3) + bit(4)][bit(0) + bit(5)][bit(1) + bit(2)] += u.dot(&v.cross(&w));
    }
    // The product of two linear Bernstein polynomials is one of degree 2, but for the binomial coefficient.
    let binomial = [1.0, 2.0, 1.0];
    let mut coefficients = sums;
    for (i, plane) in coefficients.iter_mut().enumerate() {
        for (j, row) in plane.iter_mut().enumerate() {
            for (k, value) in row.iter_mut().enumerate() {
                *value /= binomial[i] * binomial[j] * binomial[k];
            }
        }
    }
    let rounding = ROUNDING * longest(&along_u) * longest(&along_v) * longest(&along_w);
    (coefficients, rounding)
}

/// The coefficients on the eight halves of a cube in each direction, by de Casteljau's algorithm.
fn halved(whole: &Coefficients) -> [Coefficients; 8] {
    std::array::from_fn(|part| {
        let mut found = *whole;
        let values = found.as_flattened_mut().as_flattened_mut();
        for (axis, stride) in [9, 3, 1].into_iter().enumerate() {
            for first in (0..27).filter(|n| n / stride % 3 == 0) {
                let line = [first, first + stride, first + 2 * stride];
                let halves = half(line.map(|n| values[n]), part >> axis & 1 == 1);
                line.into_iter().zip(halves).for_each(|(n, value)| values[n] = value);
            }
        }
        found
    })
}

fn half([a, b, c]: [f64; 3], upper: bool) -> [f64; 3] {
    let (ab, bc) = (0.5 * (a + b), 0.5 * (b + c));
    let middle = 0.5 * (ab + bc);
    if upper { [middle, bc, c] } else { [a, ab, middle] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix3;
    use crate::geometry::trilinear_gradients;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    fn cube() -> [Point; 8] {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        std::array::from_fn(|k| Point::new(square[k % 4][0], square[k % 4][1], if k > 3 { 1.0 } else { 0.0 }))
    }

    fn distorted_cube(by: f64, random: &mut StdRng) -> [Point; 8] {
        cube().map(|p| p + Vector::from_fn(|_, _| random.random_range(-by..by)))
    }

    fn determinant_at(corners: &[Point; 8], at: [f64; 3]) -> f64 {
        let slopes = trilinear_gradients(at);
        let jacobian: Matrix3 = (0..8).map(|c| corners[c].coords * slopes[c].transpose()).sum();
        jacobian.determinant()
    }

    #[test]
    fn coefficients_are_those_of_the_determinant() {
        let mut random = StdRng::seed_from_u64(11);
        let corners = distorted_cube(0.4, &mut random);
        let (coefficients, rounding) = determinant(&corners);
        let bernstein = |t: f64| [(1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t];
        let value = |coefficients: &Coefficients, at: [f64; 3]| -> f64 {
            let [u, v, w] = at.map(bernstein);
            (0..27)
                .map(|n| u[n / 9] * v[n / 3 % 3] * w[n % 3] * coefficients[n / 9][n / 3 % 3][n % 3])
                .sum()
        };
        for _ in 0..50 {
            let at: [f64; 3] = std::array::from_fn(|_| random.random_range(0.0..1.0));
            let expected = determinant_at(&corners, at);
            assert!((value(&coefficients, at) - expected).abs() < rounding, "{at:?}");
            for (part, coefficients) in halved(&coefficients).iter().enumerate() {
                let inside: [f64; 3] = std::array::from_fn(|axis| 0.5 * (at[axis] + (part >> axis & 1) as f64));
                let expected = determinant_at(&corners, inside);
                assert!((value(coefficients, at) - expected).abs() < rounding, "{part} {at:?}");
            }
        }
    }

    #[test]
    fn positive_hexahedra_are_positive_everywhere_also_between_the_points_of_a_lattice() {
        let mut random = StdRng::seed_from_u64(12);
        let least_of = |corners: &[Point; 8], steps: usize| {
            let points = (0..(steps + 1).pow(3))
                .map(|n| [n / (steps + 1).pow(2), n / (steps + 1) % (steps + 1), n % (steps + 1)]);
            let values = points.map(|at| determinant_at(corners, at.map(|step| step as f64 / steps as f64)));
            values.fold(f64::INFINITY, f64::min)
        };
        let (mut positive, mut hidden) = (0, 0);
        for _ in 0..20_000 {
            let corners = distorted_cube(0.8, &mut random);
            if least_of(&corners, 1) <= 0.0 {
                assert!(!is_hex_positive(&corners));
                continue;
            }
            // The least between the points of this lattice is lower by less than that.
            let least = least_of(&corners, 20);
            if is_hex_positive(&corners) {
                positive += 1;
                assert!(least > 0.0);
            } else {
                assert!(least < 0.02, "{least}");
                hidden += usize::from(least < 0.0 && least_of(&corners, 4) > 0.0);
            }
        }
        assert!(positive > 100 && hidden > 0, "{positive} {hidden}");
    }

    #[test]
    fn scaled_and_moved_cubes_are_positive_and_mirrored_flat_and_missing_ones_are_not() {
        for (scale, shift) in [(1.0, 0.0), (1e-9, 0.0), (1e9, 0.0), (1.0, 1e6)] {
            let corners = cube().map(|p| Point::from(p.coords * scale + Vector::repeat(shift)));
            assert!(is_hex_positive(&corners), "{scale} {shift}");
        }
        assert!(!is_hex_positive(&cube().map(|p| Point::new(p.x, p.y, -p.z))));
        assert!(!is_hex_positive(&cube().map(|p| Point::new(p.x, p.y, 0.0))));
        assert!(!is_hex_positive(&cube().map(|p| Point::new(p.x, p.y, f64::NAN))));
    }
}
