//! Möbius transformations: the conformal, orientation-preserving maps of the sphere onto itself.
//!
//! They map circles to circles, but great circles in general not to great circles: geodesic triangles may flip when
//! only their corners are transformed, so an embedding must be checked again afterwards.
//!
//! Centring is Newton's method of Baden, Crane & Kazhdan, *Möbius registration*, Computer Graphics Forum 37 (2018).

use nalgebra::{Complex, Matrix2};

use super::distortion_energy::is_positive;
use crate::{Matrix3, Vector};

/// A Möbius transformation: a complex matrix of determinant other than 0 that acts on the homogeneous coordinates of
/// directions, `(x + iy : 1 − z)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moebius {
    matrix: Matrix2<Complex<f64>>,
}

const MAX_ITERATIONS: usize = 200;
/// Distance from the centre that counts as zero.
const CENTRED: f64 = 1e-12;
/// Longest step, and halvings of one that would invert a triangle or not come closer to the centre.
const LONGEST_STEP: f64 = 0.5;
const MAX_HALVINGS: usize = 20;
/// Landmarks closer than this angle coincide.
const MIN_ANGLE: f64 = 1e-12;

impl Moebius {
    /// The unique transformation that maps three directions to three images; exact up to rounding.
    ///
    /// `None` when two of the directions, or of the images, coincide, or one is zero or not finite.
    pub(crate) fn of_three(from: &[Vector; 3], to: &[Vector; 3]) -> Option<Self> {
        let matrix = frame(to)? * inverse(&frame(from)?);
        matrix.iter().all(|c| c.is_finite()).then_some(Self { matrix })
    }

    /// The transformation that undoes this one.
    #[cfg(test)]
    pub(crate) fn inverse(&self) -> Self {
        Self {
            matrix: inverse(&self.matrix),
        }
    }

    /// The image of a direction of any positive length: a unit vector.
    pub(crate) fn apply(&self, direction: &Vector) -> Vector {
        let [p, q] = homogeneous(direction);
        direction_of([
            self.matrix[(0, 0)] * p + self.matrix[(0, 1)] * q,
            self.matrix[(1, 0)] * p + self.matrix[(1, 1)] * q,
        ])
    }
}

/// Moves the weighted mean of unit vectors to the centre by Möbius transformations, as far as no triangle is inverted
/// (decided exactly). The mean never moves away from the centre.
///
/// Does nothing when the lengths differ, the weights are negative, not finite, or all zero, or a triangle is inverted
/// at the start. If one vertex has half of the weight, no transformation centres, and the mean comes as close as the
/// steps reach.
pub(crate) fn centre(triangles: &[[u32; 3]], weights: &[f64], x: &mut [Vector]) {
    let total: f64 = weights.iter().sum();
    let mut mean = mean_of(weights, x, total);
    let is_usable =
        weights.len() == x.len() && weights.iter().all(|&w| w >= 0.0) && total > 0.0 && mean.norm().is_finite();
    if !is_usable || !all_positive(triangles, x) {
        return;
    }
    for _ in 0..MAX_ITERATIONS {
        if mean.norm() <= CENTRED {
            break;
        }
        let Some((moved, new_mean)) = step(triangles, weights, x, total, &mean) else {
            break;
        };
        x.copy_from_slice(&moved);
        mean = new_mean;
    }
}

/// One step: the transformed vectors and their mean, which is closer to the centre; `None` when no step is.
fn step(
    triangles: &[[u32; 3]],
    weights: &[f64],
    x: &[Vector],
    total: f64,
    mean: &Vector,
) -> Option<(Vec<Vector>, Vector)> {
    let products = weights.iter().zip(x).map(|(w, x)| x * x.transpose() * (w / total));
    let spread: Matrix3 = products.sum();
    let jacobian = 2.0 * (Matrix3::identity() - spread);
    // Singular only when all the weight is on one line.
    let newton = jacobian.cholesky().map_or(-0.5 * mean, |factor| -factor.solve(mean));
    let mut towards = newton * (LONGEST_STEP / newton.norm()).min(1.0);
    for _ in 0..MAX_HALVINGS {
        let moved: Vec<Vector> = x.iter().map(|x| translated(x, &towards)).collect();
        let new_mean = mean_of(weights, &moved, total);
        if new_mean.norm() < mean.norm() && all_positive(triangles, &moved) {
            return Some((moved, new_mean));
        }
        towards *= 0.5;
    }
    None
}

/// The Möbius transformation without rotation (a translation of hyperbolic space) that moves the centre of the ball to
/// `centre`.
fn translated(x: &Vector, centre: &Vector) -> Vector {
    let from = x + centre;
    ((1.0 - centre.norm_squared()) / from.norm_squared() * from + centre).normalize()
}

fn mean_of(weights: &[f64], x: &[Vector], total: f64) -> Vector {
    weights.iter().zip(x).map(|(w, x)| x * *w).sum::<Vector>() / total
}

fn all_positive(triangles: &[[u32; 3]], x: &[Vector]) -> bool {
    let corner = |v: u32| x.get(v as usize).copied();
    let corners = |&[a, b, c]: &[u32; 3]| Some([corner(a)?, corner(b)?, corner(c)?]);
    triangles.iter().all(|t| corners(t).is_some_and(|t| is_positive(&t)))
}

/// In the stereographic chart from the pole that the direction is farther from.
fn homogeneous(direction: &Vector) -> [Complex<f64>; 2] {
    let x = direction.normalize();
    let across = Complex::new(x.x, x.y);
    if x.z <= 0.0 {
        [across, Complex::new(1.0 - x.z, 0.0)]
    } else {
        [Complex::new(1.0 + x.z, 0.0), across.conj()]
    }
}

fn direction_of([p, q]: [Complex<f64>; 2]) -> Vector {
    let across = p * q.conj() * 2.0;
    Vector::new(across.re, across.im, p.norm_sqr() - q.norm_sqr()).normalize()
}

/// The matrix that carries `(1 : 0)`, `(0 : 1)` and `(1 : 1)` to three directions.
fn frame(directions: &[Vector; 3]) -> Option<Matrix2<Complex<f64>>> {
    let [[a, b], [c, d], [e, f]] = directions.each_ref().map(homogeneous);
    let determinant = |p: Complex<f64>, q: Complex<f64>, r: Complex<f64>, s: Complex<f64>| p * s - q * r;
    let whole = determinant(a, c, b, d);
    let (first, second) = (determinant(e, c, f, d) / whole, determinant(a, e, b, f) / whole);
    // Not apart, also when NaN.
    let apart = |c: Complex<f64>| c.norm() > MIN_ANGLE && c.is_finite();
    (apart(whole) && apart(first) && apart(second)).then(|| Matrix2::new(a * first, c * second, b * first, d * second))
}

/// The inverse up to a factor, which does not change the transformation.
fn inverse(m: &Matrix2<Complex<f64>>) -> Matrix2<Complex<f64>> {
    Matrix2::new(m[(1, 1)], -m[(0, 1)], -m[(1, 0)], m[(0, 0)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::spherical::check_embedding;

    fn unit(x: f64, y: f64, z: f64) -> Vector {
        Vector::new(x, y, z).normalize()
    }

    fn sphere() -> (Vec<[u32; 3]>, Vec<Vector>) {
        let mesh = shapes::sphere(1.0, 4);
        (
            mesh.triangles().to_vec(),
            mesh.vertices().iter().map(|p| p.coords).collect(),
        )
    }

    #[test]
    fn carries_three_directions_to_three_also_at_the_poles() {
        let from = [Vector::z(), -Vector::z(), unit(1.0, 0.2, -0.4)];
        let to = [unit(0.3, -1.0, 0.2), Vector::z(), unit(0.31, -1.0, 0.2)];
        let map = Moebius::of_three(&from, &to).unwrap();
        for (a, b) in from.iter().zip(&to) {
            assert!((map.apply(a) - b).norm() < 1e-13);
            assert!((map.inverse().apply(b) - a).norm() < 1e-12);
        }
    }

    #[test]
    fn keeps_angles_and_orientation() {
        let from = [unit(1.0, 0.0, 0.1), unit(0.0, 1.0, 0.2), unit(-0.3, 0.1, 1.0)];
        let to = [unit(1.0, 0.2, 0.1), unit(0.2, 1.0, -0.5), unit(-1.0, 0.3, 1.0)];
        let map = Moebius::of_three(&from, &to).unwrap();
        let (h, x) = (1e-6, unit(0.2, -0.5, 0.7));
        let [u, v] = crate::spherical::distortion_energy::tangents(&x);
        let moved = |u: &Vector| (map.apply(&(x + h * u)) - map.apply(&(x - h * u))) / (2.0 * h);
        let (u, v) = (moved(&u), moved(&v));
        // Central differences err by h² times third derivatives, and by rounding over h.
        assert!(u.dot(&v).abs() < 1e-8 * u.norm_squared());
        assert!((u.norm() / v.norm() - 1.0).abs() < 1e-8);
        assert!(map.apply(&x).dot(&u.cross(&v)) > 0.0);
    }

    #[test]
    fn three_rotated_directions_give_the_rotation() {
        let rotation = nalgebra::Rotation3::new(Vector::new(0.4, -1.0, 2.0));
        let from = [unit(1.0, 0.0, 0.1), unit(0.0, 1.0, 0.2), unit(-0.3, 0.1, 1.0)];
        let map = Moebius::of_three(&from, &from.map(|x| rotation * x)).unwrap();
        for x in sphere().1 {
            assert!((map.apply(&x) - rotation * x).norm() < 1e-13);
        }
    }

    #[test]
    fn refuses_landmarks_that_coincide_or_are_no_directions() {
        let good = [Vector::x(), Vector::y(), Vector::z()];
        for bad in [Vector::y(), Vector::zeros(), Vector::new(f64::NAN, 0.0, 1.0)] {
            let bad = [bad, Vector::y(), Vector::z()];
            assert_eq!(Moebius::of_three(&bad, &good), None);
            assert_eq!(Moebius::of_three(&good, &bad), None);
        }
    }

    #[test]
    fn centring_undoes_a_translation_up_to_rotation() {
        let (triangles, directions) = sphere();
        let weights = vec![1.0; directions.len()];
        let away = Vector::new(0.3, -0.5, 0.6);
        let mut x: Vec<Vector> = directions.iter().map(|x| translated(x, &away)).collect();
        let off_centre = |x: &[Vector]| mean_of(&weights, x, weights.iter().sum()).norm();
        assert!(off_centre(&x) > 0.5);
        centre(&triangles, &weights, &mut x);
        assert!(off_centre(&x) <= CENTRED, "{}", off_centre(&x));
        assert!(check_embedding(&triangles, &x).is_bijective());
        // The centred embedding is unique up to rotation: dot products are those of the sphere.
        for (k, m) in [(0, 100), (7, 1000), (500, 2000)] {
            assert!((x[k].dot(&x[m]) - directions[k].dot(&directions[m])).abs() < 1e-9);
        }
    }

    #[test]
    fn centring_stops_before_a_triangle_inverts() {
        // A vertex is moved almost onto the opposite side of one of its triangles: transformations bend the side over
        // it.
        let mesh = shapes::sphere(1.0, 1);
        let mut x: Vec<Vector> = mesh.vertices().iter().map(|p| p.coords).collect();
        let [a, b, c] = mesh.triangles()[0].map(|v| v as usize);
        x[a] = (x[b] + x[c] + 1e-4 * x[a]).normalize();
        let start = check_embedding(mesh.triangles(), &x);
        let mut weights = vec![0.01; x.len()];
        weights[b] = 0.1;
        let off_centre = |x: &[Vector]| mean_of(&weights, x, weights.iter().sum()).norm();
        let before = off_centre(&x);
        centre(mesh.triangles(), &weights, &mut x);
        assert!(off_centre(&x) <= before);
        assert_eq!(check_embedding(mesh.triangles(), &x).flipped, start.flipped);
    }

    #[test]
    fn leaves_alone_what_it_cannot_centre() {
        let (triangles, directions) = sphere();
        let count = directions.len();
        for weights in [vec![0.0; count], vec![f64::NAN; count], vec![-1.0; count], vec![1.0; 3]] {
            let mut x = directions.clone();
            centre(&triangles, &weights, &mut x);
            assert_eq!(x, directions);
        }
        // Half of the weight on one vertex cannot be centred.
        let mut weights = vec![1.0 / count as f64; count];
        weights[0] = 2.0;
        let mut x = directions.clone();
        centre(&triangles, &weights, &mut x);
        assert!(check_embedding(&triangles, &x).is_bijective());
    }
}
