//! The distortion energy of a spherical embedding, with derivatives.
//!
//! The energy of a triangle is infinite where it inverts, so that a descent from an embedding never inverts one. Its
//! angle term is that of Hormann & Greiner, *MIPS: an efficient global parametrization method*, Curve and Surface
//! Design (2000); with the area term beside it, on the sphere and minimised by Newton's method, it is used by Schmidt,
//! Pieper & Kobbelt, *Surface maps via adaptive triangulations*, Computer Graphics Forum 42 (2023). Element Hessians
//! are made semidefinite as in Teran, Sifakis, Irving & Fedkiw, *Robust quasistatic finite elements and flesh
//! simulation*, Symposium on Computer Animation (2005).
//!
//! Notation: a triangle with corners `a, b, c` on the sphere has the Jacobian `z = [b − a, c − a] D` of the linear map
//! from its rest shape onto its chord, where `D` is the inverse of the rest shape's edges; `q = |z|²`, and
//! `d = det(a, b, c) det D`: the ratio of areas, times the distance of the chord's plane from the centre. It is
//! positive as long as the triangle is not inverted and spans less than a hemisphere.

use nalgebra::SMatrix;
use rayon::prelude::*;

use super::curvature::Curvature;
use super::rest_shape::{RestShape, RestShapes};
use crate::geometry::orientation;
use crate::{Point, Vector};

/// Weights of the two terms of the energy. The minimum of each term, without its weight, is 1 per unit of area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EnergyWeights {
    /// Weight of `q / 2d`, which is least where angles are kept.
    pub(crate) angle: f64,
    /// Weight of `(d + 1/d) / 2`, which is least where areas are kept; 0 for embeddings that are as conformal as
    /// possible.
    pub(crate) area: f64,
}

/// The energy `Σ A (w_angle q / 2d + w_area (d + 1/d) / 2)` over triangles of rest area `A`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DistortionEnergy<'a> {
    pub(crate) rest: &'a RestShapes,
    pub(crate) weights: EnergyWeights,
}

/// A function that Newton's method minimises over embeddings: a sum over triangles that is infinite unless they are all
/// positive.
pub(crate) trait Objective: Sync {
    /// The triangles of the sum.
    fn triangles(&self) -> &[[u32; 3]];

    /// The surface that vertices lie on.
    fn curvature(&self) -> Curvature {
        Curvature::Spherical
    }

    /// The corners of a triangle, from the positions of all vertices: on a torus, side by side in its universal cover.
    fn corners(&self, triangle: usize, x: &[Vector]) -> [Vector; 3] {
        self.triangles()[triangle].map(|v| x[v as usize])
    }

    /// The value; infinite when a triangle is inverted or flat (decided exactly), or anything is not finite.
    fn value(&self, x: &[Vector]) -> f64;

    /// Replaces `elements` by the derivatives of every triangle's energy in the tangent coordinates of `frames`. For many triangles
    /// they take much memory, which is used again from iteration to iteration.
    fn write_elements(&self, x: &[Vector], frames: &[[Vector; 2]], elements: &mut Vec<ElementDerivatives>);

    /// The same, in a list of their own.
    #[cfg(test)]
    fn elements(&self, x: &[Vector], frames: &[[Vector; 2]]) -> Vec<ElementDerivatives> {
        let mut elements = Vec::new();
        self.write_elements(x, frames, &mut elements);
        elements
    }
}

/// The second derivatives with respect to the two tangent coordinates of each corner.
pub(crate) type ElementHessian = SMatrix<f64, 6, 6>;

/// First and second derivatives of one triangle's energy, two tangent coordinates per corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ElementDerivatives {
    pub(crate) gradient: [f64; 6],
    /// Symmetric and positive semidefinite.
    pub(crate) hessian: ElementHessian,
}

#[cfg(test)]
impl RestShapes {
    /// For each triangle the angle term `q / 2d`, which is 1 where angles are kept, and `d`. Both are infinite or NaN
    /// for inverted triangles.
    pub(crate) fn distortions(&self, x: &[Vector]) -> Vec<[f64; 2]> {
        let distortion =
            |(t, shape): (&[u32; 3], &RestShape)| match SphericalTriangle::new(shape, t.map(|v| x[v as usize])) {
                Some(triangle) => [triangle.q / (2.0 * triangle.d), triangle.d],
                None => [f64::INFINITY, f64::NAN],
            };
        self.triangles().par_iter().zip(self.shapes()).map(distortion).collect()
    }
}

impl Objective for DistortionEnergy<'_> {
    fn triangles(&self) -> &[[u32; 3]] {
        self.rest.triangles()
    }

    fn value(&self, x: &[Vector]) -> f64 {
        let of_triangle = |(t, shape): (&[u32; 3], &RestShape)| {
            let triangle = SphericalTriangle::new(shape, t.map(|v| x[v as usize]));
            triangle.map_or(f64::INFINITY, |triangle| shape.area * triangle.energy(self.weights))
        };
        // Summed in order, so that the sum is the same for any number of threads.
        let triangles = self.rest.triangles().par_iter().zip(self.rest.shapes());
        let values: Vec<f64> = triangles.map(of_triangle).collect();
        let sum = values.iter().sum::<f64>();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    fn write_elements(&self, x: &[Vector], frames: &[[Vector; 2]], elements: &mut Vec<ElementDerivatives>) {
        self.write_elements_of(x, frames, elements, |triangle, weights, frames| {
            triangle.element(weights, frames)
        });
    }
}

impl DistortionEnergy<'_> {
    /// As [`Objective::write_elements`], with the terms alone that make the Hessians semidefinite without a projection: those of
    /// the flat triangle, without the second derivatives of `d` and the curvature of the sphere. For an energy that is a
    /// small part of another.
    pub(crate) fn write_convex_elements(
        &self,
        x: &[Vector],
        frames: &[[Vector; 2]],
        elements: &mut Vec<ElementDerivatives>,
    ) {
        self.write_elements_of(x, frames, elements, |triangle, weights, frames| {
            triangle.convex_element(weights, frames)
        });
    }

    fn write_elements_of(
        &self,
        x: &[Vector],
        frames: &[[Vector; 2]],
        elements: &mut Vec<ElementDerivatives>,
        element: impl Fn(&SphericalTriangle, EnergyWeights, &[[Vector; 2]; 3]) -> ElementDerivatives + Sync,
    ) {
        let of_triangle = |(t, shape): (&[u32; 3], &RestShape)| {
            let (corners, frames) = (t.map(|v| x[v as usize]), t.map(|v| frames[v as usize]));
            SphericalTriangle::new(shape, corners).map_or(ElementDerivatives::NOT_FINITE, |triangle| {
                element(&triangle, self.weights, &frames)
            })
        };
        let triangles = self.rest.triangles().par_iter().zip(self.rest.shapes());
        triangles.map(of_triangle).collect_into_vec(elements);
    }
}

#[cfg(test)]
impl DistortionEnergy<'_> {
    /// The gradient per vertex: a tangent vector of the sphere. Not finite where a triangle is inverted.
    pub(crate) fn gradient(&self, x: &[Vector]) -> Vec<Vector> {
        let frames: Vec<[Vector; 2]> = x.iter().map(tangents).collect();
        let mut gradient = vec![Vector::zeros(); x.len()];
        for (t, element) in self.rest.triangles().iter().zip(self.elements(x, &frames)) {
            for (c, &v) in t.iter().enumerate() {
                let [u, w] = frames[v as usize];
                gradient[v as usize] += u * element.gradient[2 * c] + w * element.gradient[2 * c + 1];
            }
        }
        gradient
    }
}

/// Two unit vectors that with `x` make a right-handed frame.
///
/// Duff et al., *Building an orthonormal basis, revisited*, Journal of Computer Graphics Techniques 6 (2017).
pub(crate) fn tangents(x: &Vector) -> [Vector; 2] {
    let sign = 1f64.copysign(x.z);
    let a = -1.0 / (sign + x.z);
    let b = x.x * x.y * a;
    [
        Vector::new(1.0 + sign * x.x * x.x * a, sign * b, -sign * x.x),
        Vector::new(b, sign + x.y * x.y * a, -x.y),
    ]
}

/// Whether the triangle is seen counter-clockwise from outside, decided exactly for the directions as given.
pub(super) fn is_positive([a, b, c]: &[Vector; 3]) -> bool {
    let (first, last) = (b - a, c - a);
    let determinant = a.dot(&first.cross(&last));
    // Far above the rounding error of the determinant, which is a few units in the last place of this product.
    let certain = 1e-14 * a.norm() * first.norm() * last.norm();
    if determinant.abs() > certain && certain.is_finite() {
        return determinant > 0.0;
    }
    let [a, b, c] = [a, b, c].map(|x| Point::from(*x));
    orientation(&Point::origin(), &a, &b, &c) == Some(std::cmp::Ordering::Greater)
}

/// A positive triangle on the sphere, with the quantities of the notation above.
struct SphericalTriangle<'a> {
    shape: &'a RestShape,
    /// `D`.
    inverse: [[f64; 2]; 2],
    corners: [Vector; 3],
    z: [Vector; 2],
    /// `(b − a) × (c − a)`.
    normal: Vector,
    q: f64,
    d: f64,
}

impl<'a> SphericalTriangle<'a> {
    fn new(shape: &'a RestShape, corners: [Vector; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        let (first, last) = (b - a, c - a);
        let inverse = shape.inverse();
        let [[p, r], [s, t]] = inverse;
        let z = [first * p + last * s, first * r + last * t];
        let normal = first.cross(&last);
        let triangle = Self {
            shape,
            inverse,
            corners,
            z,
            normal,
            q: z[0].norm_squared() + z[1].norm_squared(),
            d: a.dot(&normal) * determinant(shape),
        };
        (triangle.d > 0.0 && triangle.q.is_finite() && is_positive(&corners)).then_some(triangle)
    }

    fn energy(&self, weights: EnergyWeights) -> f64 {
        weights.angle * self.q / (2.0 * self.d) + weights.area * 0.5 * (self.d + self.d.recip())
    }

    /// Coefficients of the corners in the columns of `z`.
    fn shares(&self) -> [[f64; 2]; 3] {
        let [first, last] = self.inverse;
        [[-first[0] - last[0], -first[1] - last[1]], first, last]
    }

    /// Half the gradient of `q`, and the gradient of `d`: b × c and its cyclic permutations, by differences because the
    /// products of the corners nearly cancel.
    fn gradients(&self) -> [[Vector; 3]; 2] {
        let share = self.shares();
        let [a, b, c] = self.corners;
        let dq = std::array::from_fn(|k| self.z[0] * share[k][0] + self.z[1] * share[k][1]);
        let dd = [a.cross(&(c - b)), b.cross(&(a - c)), c.cross(&(b - a))];
        [dq, dd.map(|v| (v + self.normal) * determinant(self.shape))]
    }

    fn convex_element(&self, weights: EnergyWeights, frames: &[[Vector; 2]; 3]) -> ElementDerivatives {
        let (q, d, area) = (self.q, self.d, self.shape.area);
        let by_z = weights.angle / d;
        let by_d = 0.5 * (weights.area * (1.0 - 1.0 / (d * d)) - by_z * q / d);
        let by_d_twice = (by_z * q + weights.area / d) / (d * d);
        let share = self.shares();
        let [gq, gd] = self.gradients().map(|g| in_frames(&g, frames));
        let mut hessian = SMatrix::<f64, 6, 6>::zeros();
        for i in 0..6 {
            for j in 0..=i {
                let (m, n) = (i / 2, j / 2);
                let metric = share[m][0] * share[n][0] + share[m][1] * share[n][1];
                let cross = gq[i] * gd[j] + gd[i] * gq[j];
                let metric = metric * frames[m][i % 2].dot(&frames[n][j % 2]);
                let entry = area * (by_z * (metric - cross / d) + by_d_twice * gd[i] * gd[j]);
                hessian[(i, j)] = entry;
                hessian[(j, i)] = entry;
            }
        }
        ElementDerivatives {
            gradient: std::array::from_fn(|i| area * (by_z * gq[i] + by_d * gd[i])),
            hessian,
        }
    }

    fn element(&self, weights: EnergyWeights, frames: &[[Vector; 2]; 3]) -> ElementDerivatives {
        let (q, d, area) = (self.q, self.d, self.shape.area);
        let by_z = weights.angle / d;
        let by_d = 0.5 * (weights.area * (1.0 - 1.0 / (d * d)) - by_z * q / d);
        let by_d_twice = (by_z * q + weights.area / d) / (d * d);
        let share = self.shares();
        let [dq, dd] = self.gradients();
        let (gq, gd) = (in_frames(&dq, frames), in_frames(&dd, frames));

        let mut hessian = SMatrix::<f64, 6, 6>::zeros();
        for i in 0..6 {
            for j in 0..=i {
                let (m, n) = (i / 2, j / 2);
                let cross = gq[i] * gd[j] + gd[i] * gq[j];
                let mut entry = by_d_twice * gd[i] * gd[j] - by_z / d * cross;
                let (u, v) = (frames[m][i % 2], frames[n][j % 2]);
                let metric = share[m][0] * share[n][0] + share[m][1] * share[n][1];
                if m != n {
                    // det(u, v, ·) in the cyclic order of the corners m, n and the third; here m > n.
                    let third = self.corners[3 - m - n];
                    let sign = if m - n == 1 { -1.0 } else { 1.0 };
                    entry += by_z * metric * u.dot(&v);
                    entry += by_d * determinant(self.shape) * sign * third.dot(&u.cross(&v));
                } else if i == j {
                    // Curvature of the sphere.
                    entry += by_z * metric - by_z * dq[m].dot(&self.corners[m]) - by_d * d;
                }
                hessian[(i, j)] = area * entry;
                hessian[(j, i)] = area * entry;
            }
        }
        ElementDerivatives {
            gradient: std::array::from_fn(|i| area * (by_z * gq[i] + by_d * gd[i])),
            hessian: semidefinite(hessian),
        }
    }
}

/// Tangent coordinates of a vector at each corner.
fn in_frames(vectors: &[Vector; 3], frames: &[[Vector; 2]; 3]) -> [f64; 6] {
    std::array::from_fn(|i| vectors[i / 2].dot(&frames[i / 2][i % 2]))
}

/// Determinant of `D`.
fn determinant(shape: &RestShape) -> f64 {
    0.5 / shape.area
}

impl ElementDerivatives {
    const NOT_FINITE: Self = Self {
        gradient: [f64::NAN; 6],
        hessian: SMatrix::<f64, 6, 6>::from_array_storage(nalgebra::ArrayStorage([[f64::NAN; 6]; 6])),
    };
}

/// The closest positive semidefinite matrix: negative eigenvalues are set to 0. Matrices that are not finite are
/// unchanged.
pub(crate) fn semidefinite(matrix: ElementHessian) -> ElementHessian {
    let size = matrix.trace().abs();
    if !size.is_finite() || nalgebra::Cholesky::new(matrix).is_some() {
        return matrix;
    }
    let Some(eigen) = matrix.try_symmetric_eigen(f64::EPSILON, 1000) else {
        return SMatrix::from_diagonal(&matrix.diagonal().map(|entry| entry.abs() * 6.0));
    };
    let kept = eigen.eigenvalues.map(|value| value.max(0.0));
    eigen.eigenvectors * SMatrix::from_diagonal(&kept) * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};

    const WEIGHTS: [[f64; 2]; 3] = [[1.0, 0.0], [0.0, 1.0], [1.0, 0.5]];

    fn directions(mesh: &SurfaceMesh) -> Vec<Vector> {
        mesh.vertices().iter().map(|p| p.coords.normalize()).collect()
    }

    #[test]
    fn gradient_matches_central_differences() {
        let mesh = shapes::bumpy_sphere(5);
        let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
        let x = directions(&mesh);
        for [angle, area] in WEIGHTS {
            let energy = DistortionEnergy {
                rest: &rest,
                weights: EnergyWeights { angle, area },
            };
            let gradient = energy.gradient(&x);
            let h = 1e-5;
            for v in 0..x.len() {
                for tangent in tangents(&x[v]) {
                    let moved = |step: f64| {
                        let mut x = x.clone();
                        x[v] = (x[v] + step * tangent).normalize();
                        energy.value(&x)
                    };
                    let slope = (moved(h) - moved(-h)) / (2.0 * h);
                    assert!(
                        (slope - gradient[v].dot(&tangent)).abs() < 1e-6,
                        "{slope} {}",
                        gradient[v].dot(&tangent)
                    );
                }
            }
        }
    }

    #[test]
    fn hessians_match_second_differences_but_for_their_negative_part() {
        let mesh = shapes::bumpy_sphere(3);
        let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
        let x = directions(&mesh);
        for [angle, area] in WEIGHTS {
            let weights = EnergyWeights { angle, area };
            for (t, shape) in rest.triangles().iter().zip(rest.shapes()) {
                let corners = t.map(|v| x[v as usize]);
                let frames = corners.map(|x| tangents(&x));
                let of = |p: &SMatrix<f64, 6, 1>| {
                    let moved = std::array::from_fn(|c| {
                        (corners[c] + frames[c][0] * p[2 * c] + frames[c][1] * p[2 * c + 1]).normalize()
                    });
                    shape.area * SphericalTriangle::new(shape, moved).unwrap().energy(weights)
                };
                let h = 1e-4;
                let step = |i: usize| SMatrix::<f64, 6, 1>::ith(i, h);
                let difference = SMatrix::<f64, 6, 6>::from_fn(|i, j| {
                    let [p, q] = [step(i), step(j)];
                    (of(&(p + q)) - of(&(p - q)) - of(&(q - p)) + of(&-(p + q))) / (4.0 * h * h)
                });
                let found = SphericalTriangle::new(shape, corners)
                    .unwrap()
                    .element(weights, &frames)
                    .hessian;
                // Fourth derivatives over the second are about the inverse square of the size, 0.4.
                let tolerance = 1e-5 * difference.norm().max(1.0);
                assert!(
                    (found - semidefinite(difference)).norm() < tolerance,
                    "{found} {difference}"
                );
                assert!(found.symmetric_eigenvalues().min() > -1e-12 * found.norm());
            }
        }
    }

    #[test]
    fn convex_hessians_are_semidefinite_and_have_the_same_gradient() {
        let mesh = shapes::deformed(&shapes::bumpy_sphere(3), |p| {
            Point::new(4.0 * p.x + p.y, p.y, 0.2 * p.z)
        });
        let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
        let x = directions(&shapes::bumpy_sphere(3));
        let frames: Vec<[Vector; 2]> = x.iter().map(tangents).collect();
        for [angle, area] in WEIGHTS {
            let energy = DistortionEnergy {
                rest: &rest,
                weights: EnergyWeights { angle, area },
            };
            let mut convex = Vec::new();
            energy.write_convex_elements(&x, &frames, &mut convex);
            for (convex, exact) in convex.iter().zip(energy.elements(&x, &frames)) {
                assert_eq!(convex.gradient, exact.gradient);
                assert!(convex.hessian.symmetric_eigenvalues().min() > -1e-12 * convex.hessian.norm());
            }
        }
    }

    #[test]
    fn is_infinite_unless_all_triangles_are_positive() {
        let mesh = shapes::sphere(1.0, 2);
        let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
        let energy = DistortionEnergy {
            rest: &rest,
            weights: EnergyWeights { angle: 1.0, area: 1.0 },
        };
        let x = directions(&mesh);
        assert!(energy.value(&x).is_finite());
        for bad in [
            -x[7],
            x[8],
            Vector::repeat(f64::NAN),
            Vector::repeat(f64::INFINITY),
            Vector::zeros(),
        ] {
            let mut x = x.clone();
            x[7] = bad;
            assert_eq!(energy.value(&x), f64::INFINITY);
        }
    }
}
