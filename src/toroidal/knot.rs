//! Whether a closed polygon is knotted.
//!
//! Corners whose triangle no other side passes through are cut off (Koniaris & Muthukumar, *Knottedness in ring polymers*,
//! Phys. Rev. Lett. 66, 1991), until nothing is left or the Alexander polynomial of the rest tells. That polynomial is
//! evaluated at one residue modulo a large prime; it is a power of its argument, up to sign, for every polygon that is not
//! knotted. Of knots with up to ten crossings none has that value; some larger ones do, and pass for unknotted.

use rand::{Rng, SeedableRng, rngs::StdRng};

use crate::{Point, Vector};

/// A Mersenne prime.
const PRIME: u64 = (1 << 61) - 1;
const SEED: u64 = 17;
/// Above this many crossings the polynomial is not computed.
const MOST_CROSSINGS: usize = 600;

/// Whether a closed polygon that does not touch itself is certainly knotted.
pub(crate) fn is_knotted(polygon: &[Point]) -> bool {
    let reduced = reduced(polygon.to_vec());
    if reduced.len() < 6 {
        return false;
    }
    let mut rng = StdRng::seed_from_u64(SEED);
    let projections = (0..8).map(|_| crossings(&projected(&reduced, &mut rng)));
    let Some(crossings) = projections.min_by_key(Vec::len) else {
        return false;
    };
    crossings.len() >= 3 && crossings.len() <= MOST_CROSSINGS && !has_trivial_polynomial(&crossings, &mut rng)
}

/// The polygon without the corners that can be cut off.
fn reduced(mut polygon: Vec<Point>) -> Vec<Point> {
    loop {
        let before = polygon.len();
        let mut i = 0;
        while i < polygon.len() && polygon.len() > 3 {
            if is_free(&polygon, i) {
                polygon.remove(i);
            } else {
                i += 1;
            }
        }
        if polygon.len() == before {
            return polygon;
        }
    }
}

/// Whether no other side passes through the triangle of a corner and its neighbours, or close by.
fn is_free(polygon: &[Point], i: usize) -> bool {
    let n = polygon.len();
    let triangle = [(i + n - 1) % n, i, (i + 1) % n].map(|k| polygon[k]);
    // Sides from the one after the next corner to that before the last.
    (0..n - 3).all(|step| {
        let from = (i + 1 + step) % n;
        let touches = |p: &Point| triangle.iter().any(|q| q == p);
        let (a, b) = (polygon[from], polygon[(from + 1) % n]);
        // A side that begins at a corner of the triangle leaves it, unless it lies in its plane.
        match touches(&a) || touches(&b) {
            true => !passes_near(&triangle, &a, &b, 1.0 - 1e-9),
            false => !passes_near(&triangle, &a, &b, 1.0),
        }
    })
}

/// Whether a segment, the part about its middle of this share, meets the triangle, slightly enlarged.
fn passes_near([p, q, r]: &[Point; 3], a: &Point, b: &Point, share: f64) -> bool {
    let middle = nalgebra::center(a, b);
    let (a, b) = (middle + (a - middle) * share, middle + (b - middle) * share);
    let (e, f) = (q - p, r - p);
    let normal = e.cross(&f);
    let size = normal.norm();
    if size <= 1e-12 * e.norm_squared().max(f.norm_squared()) {
        // A straight corner.
        return false;
    }
    let (from, to) = (normal.dot(&(a - p)) / size, normal.dot(&(b - p)) / size);
    let margin = 1e-9 * (e.norm() + f.norm());
    if from.abs().min(to.abs()) > margin && from.signum() == to.signum() {
        return false;
    }
    let t = if from == to {
        0.5
    } else {
        (from / (from - to)).clamp(0.0, 1.0)
    };
    let at = a + (b - a) * t;
    let weight = |x: &Vector, y: &Vector| x.cross(y).dot(&normal) / (size * size);
    let d = at - p;
    let (l, m) = (weight(&d, &f), weight(&e, &d));
    let least = -1e-9;
    l >= least && m >= least && l + m <= 1.0 - least
}

/// Coordinates in a random frame.
fn projected(polygon: &[Point], rng: &mut StdRng) -> Vec<Vector> {
    let mut direction = || Vector::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let x = direction().normalize();
    let y = x.cross(&direction()).normalize();
    let z = x.cross(&y);
    polygon
        .iter()
        .map(|p| Vector::new(x.dot(&p.coords), y.dot(&p.coords), z.dot(&p.coords)))
        .collect()
}

/// Where the projections of two sides cross.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    /// Place along the polygon of the side that is above, and of the one below.
    over: f64,
    under: f64,
    is_positive: bool,
}

fn crossings(corners: &[Vector]) -> Vec<Crossing> {
    let n = corners.len();
    let mut found = Vec::new();
    let cross = |u: &Vector, v: &Vector| u.x * v.y - u.y * v.x;
    for i in 0..n {
        let (a, u) = (corners[i], corners[(i + 1) % n] - corners[i]);
        for j in i + 2..n {
            if (j + 1) % n == i {
                continue;
            }
            let (b, v) = (corners[j], corners[(j + 1) % n] - corners[j]);
            let area = cross(&u, &v);
            let (s, t) = (cross(&(b - a), &v) / area, cross(&(b - a), &u) / area);
            if !((0.0..1.0).contains(&s) && (0.0..1.0).contains(&t)) {
                continue;
            }
            let first_is_over = a.z + s * u.z > b.z + t * v.z;
            let (first, second) = (i as f64 + s, j as f64 + t);
            found.push(match first_is_over {
                true => Crossing {
                    over: first,
                    under: second,
                    is_positive: area > 0.0,
                },
                false => Crossing {
                    over: second,
                    under: first,
                    is_positive: area < 0.0,
                },
            });
        }
    }
    found.sort_by(|a, b| a.under.total_cmp(&b.under));
    found
}

/// Whether the Alexander polynomial has the value of that of the unknot, up to a power of its argument.
fn has_trivial_polynomial(crossings: &[Crossing], rng: &mut StdRng) -> bool {
    let n = crossings.len();
    let t = rng.random_range(2..PRIME - 1);
    // Arc `i` ends where crossing `i` passes below.
    let arc_of = |place: f64| crossings.partition_point(|c| c.under < place) % n;
    let mut matrix = vec![vec![0u64; n]; n];
    for (i, crossing) in crossings.iter().enumerate() {
        let (before, after) = if crossing.is_positive {
            (PRIME - 1, t)
        } else {
            (t, PRIME - 1)
        };
        let row = &mut matrix[i];
        let mut add = |k: usize, x: u64| row[k] = (row[k] + x) % PRIME;
        add(arc_of(crossing.over), PRIME + 1 - t);
        add(i, before);
        add((i + 1) % n, after);
    }
    let value = minor(matrix);
    let inverse = power(t, PRIME - 2);
    // Up to n factors t.
    let mut candidate = value;
    (0..=n).any(|_| {
        let is_one = candidate == 1 || candidate == PRIME - 1;
        candidate = times(candidate, inverse);
        is_one
    })
}

/// The determinant without the last row and column.
fn minor(mut matrix: Vec<Vec<u64>>) -> u64 {
    matrix.pop();
    let n = matrix.len();
    let mut determinant = 1;
    for k in 0..n {
        let Some(pivot) = (k..n).find(|&i| matrix[i][k] != 0) else {
            return 0;
        };
        if pivot != k {
            matrix.swap(pivot, k);
            determinant = PRIME - determinant;
        }
        determinant = times(determinant, matrix[k][k]);
        let inverse = power(matrix[k][k], PRIME - 2);
        let (upper, lower) = matrix.split_at_mut(k + 1);
        for row in lower {
            let factor = times(row[k], inverse);
            if factor != 0 {
                for (x, y) in row[k..n].iter_mut().zip(&upper[k][k..n]) {
                    *x = (*x + PRIME - times(factor, *y)) % PRIME;
                }
            }
        }
    }
    determinant
}

fn times(a: u64, b: u64) -> u64 {
    (u128::from(a) * u128::from(b) % u128::from(PRIME)) as u64
}

fn power(mut base: u64, mut exponent: u64) -> u64 {
    let mut result = 1;
    while exponent > 0 {
        if exponent & 1 == 1 {
            result = times(result, base);
        }
        base = times(base, base);
        exponent >>= 1;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The curve with these windings on a torus.
    fn torus_curve(around: f64, through: f64, count: usize) -> Vec<Point> {
        let at = |i: usize| {
            let t = std::f64::consts::TAU * i as f64 / count as f64;
            let r = 2.0 + (through * t).cos();
            Point::new(r * (around * t).cos(), r * (around * t).sin(), (through * t).sin())
        };
        (0..count).map(at).collect()
    }

    #[test]
    fn torus_knots_are_knotted_and_curves_that_wind_once_are_not() {
        for (around, through, expected) in [
            (2.0, 3.0, true),
            (3.0, 2.0, true),
            (2.0, 5.0, true),
            (3.0, 4.0, true),
            (1.0, 7.0, false),
            (9.0, 1.0, false),
            (1.0, 0.0, false),
        ] {
            assert_eq!(
                is_knotted(&torus_curve(around, through, 240)),
                expected,
                "{around} {through}"
            );
        }
    }

    /// Without a corner cut off, by the polynomial alone.
    #[test]
    fn the_polynomial_of_a_coil_is_trivial_and_that_of_a_trefoil_is_not() {
        let mut rng = StdRng::seed_from_u64(3);
        for (around, through, expected) in [(1.0, 7.0, true), (5.0, 1.0, true), (2.0, 3.0, false)] {
            let crossings = crossings(&projected(&torus_curve(around, through, 101), &mut rng));
            assert_eq!(
                has_trivial_polynomial(&crossings, &mut rng),
                expected,
                "{around} {through}"
            );
        }
    }
}
