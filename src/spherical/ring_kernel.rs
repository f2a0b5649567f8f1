//! The kernel of the ring of a vertex's neighbours: the directions of the vertex for which all its triangles are
//! positive.

use crate::Vector;

/// Larger rings are not searched for the best point: the search costs the fourth power of their size.
const MAX_SEARCHED: usize = 14;

/// Rounding errors of a determinant, over the product of the lengths of two sides: a few units in the last place.
const NOISE: f64 = 1e-14;

/// Determinant of three directions, positive when they are counter-clockwise seen from outside. By differences, which
/// keeps the sign for small triangles.
pub(crate) fn det(a: &Vector, b: &Vector, c: &Vector) -> f64 {
    a.dot(&(b - a).cross(&(c - a)))
}

/// The determinant, if it is positive beyond rounding errors.
pub(crate) fn positive_det(a: &Vector, b: &Vector, c: &Vector) -> Option<f64> {
    let (first, last) = (b - a, c - a);
    let det = a.dot(&first.cross(&last));
    (det > NOISE * first.norm() * last.norm() && det.is_finite()).then_some(det)
}

/// The smallest determinant of the triangles between `x` and the sides of a ring; −∞ when one is not certainly
/// positive.
pub(super) fn smallest_det(x: &Vector, ring: &[Vector]) -> f64 {
    let sides = ring.iter().zip(ring.iter().cycle().skip(1));
    let mut smallest = f64::INFINITY;
    for (a, b) in sides {
        let Some(det) = positive_det(x, a, b) else {
            return f64::NEG_INFINITY;
        };
        smallest = smallest.min(det);
    }
    smallest
}

/// A direction for a vertex with neighbours at `ring`, for which all its triangles are positive: the centre of the
/// largest spherical cap inside the great circles of all sides, or else the mean of the ring or a point near `ring[0]`.
///
/// The triangles that the vertex replaces are a fan about `ring[0]` and all positive, so that the kernel is not empty;
/// `None` when it is empty up to rounding.
pub(crate) fn point_in_kernel(ring: &[Vector]) -> Option<Vector> {
    let is_inside = |x: &Vector| smallest_det(x, ring) > 0.0;
    let centre = (ring.len() <= MAX_SEARCHED).then(|| cap_centre(ring)).flatten();
    let middle = || -> Vector { ring.iter().sum::<Vector>().normalize() };
    centre
        .filter(is_inside)
        .or_else(|| Some(middle()).filter(is_inside))
        .or_else(|| near_first(ring))
}

/// Maximises the distance from the nearest great circle, over the unit vectors at equal distance from two or three of
/// them: one of these is the optimum.
fn cap_centre(ring: &[Vector]) -> Option<Vector> {
    let k = ring.len();
    let normals: Vec<Vector> = (0..k)
        .map(|i| {
            let (a, b) = (ring[i], ring[(i + 1) % k]);
            a.cross(&(b - a)).normalize()
        })
        .collect();
    let mut best: Option<(f64, Vector)> = None;
    let mut consider = |x: Vector| {
        let x = x.normalize();
        let mut nearest = f64::INFINITY;
        let least = best.map_or(0.0, |(least, _)| least);
        for n in &normals {
            let distance = n.dot(&x);
            if distance.is_nan() || distance <= least {
                return;
            }
            nearest = nearest.min(distance);
        }
        best = Some((nearest, x));
    };
    for i in 0..k {
        for j in 0..i {
            consider(normals[i] + normals[j]);
            for l in 0..j {
                let x = (normals[i] - normals[j]).cross(&(normals[i] - normals[l]));
                consider(x);
                consider(-x);
            }
        }
    }
    best.map(|(_, x)| x)
}

/// A point of the kernel near the first neighbour, by backtracking from a step into the ring.
fn near_first(ring: &[Vector]) -> Option<Vector> {
    let (first, k) = (ring[0], ring.len());
    let (left, right) = (ring[1] - first, ring[k - 1] - first);
    // Inward of both sides at the first neighbour, also at a reflex corner.
    let inward = first.cross(&left).normalize() - first.cross(&right).normalize();
    let mut step = left.norm().min(right.norm());
    for _ in 0..200 {
        let x = (first + step * inward).normalize();
        if smallest_det(&x, ring) > 0.0 {
            return Some(x);
        }
        step *= 0.7;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(angles: &[f64], radius: impl Fn(usize) -> f64) -> Vec<Vector> {
        let corner = |(i, &t): (usize, &f64)| Vector::new(radius(i) * t.cos(), radius(i) * t.sin(), 1.0).normalize();
        angles.iter().enumerate().map(corner).collect()
    }

    #[test]
    fn the_cap_of_a_regular_polygon_is_centred() {
        for (k, radius) in [(3, 0.5), (6, 1e-3), (8, 1e-7), (12, 2.0)] {
            let angles: Vec<f64> = (0..k).map(|i| std::f64::consts::TAU * i as f64 / k as f64).collect();
            let x = point_in_kernel(&polygon(&angles, |_| radius)).unwrap();
            let off_centre = x.x.hypot(x.y);
            assert!(off_centre < 1e-8 * radius, "{k} {radius}: {off_centre}");
        }
    }

    #[test]
    fn a_star_shaped_ring_with_a_tiny_kernel_has_a_point() {
        // Spikes: the kernel is the small polygon in the middle.
        for k in [5, 10, 14, 40] {
            let angles: Vec<f64> = (0..2 * k).map(|i| std::f64::consts::PI * i as f64 / k as f64).collect();
            let ring = polygon(&angles, |i| if i % 2 == 0 { 1.0 } else { 0.1 });
            let x = point_in_kernel(&ring).unwrap();
            assert!(smallest_det(&x, &ring) > 0.0);
        }
    }

    #[test]
    fn a_reflex_corner_at_the_first_neighbour_has_a_point() {
        // A thin arrow head about the z axis: the kernel touches its inner corner.
        let at = |x: f64, y: f64| Vector::new(x, y, 1.0).normalize();
        let ring = [at(0.0, 0.0), at(-1.0, -1.0), at(1.0, 0.0), at(-1.0, 1.0)];
        let ring: Vec<Vector> = ring.into();
        let x = point_in_kernel(&ring).unwrap();
        assert!(smallest_det(&x, &ring) > 0.0 && x.x > 0.0);
        let many: Vec<Vector> = ring
            .iter()
            .copied()
            .chain((0..15).map(|i| {
                at(
                    -1.0 + 0.06 * f64::from(i),
                    1.0 - 0.06 * f64::from(i) + 1e-4 * f64::from(i),
                )
            }))
            .collect();
        assert!(point_in_kernel(&many).is_none_or(|x| smallest_det(&x, &many) > 0.0));
    }
}
