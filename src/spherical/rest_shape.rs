//! Rest shapes: the triangles of a surface in space, regularised so that their areas and heights can be divided by.

use rayon::prelude::*;

use crate::mesh::triangle_area;
use crate::{Point, Vector};

/// A triangle up to rigid motions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RestShape {
    /// Cotangents of its angles.
    pub cotangents: [f64; 3],
    /// Area in units in which the surface has 4π, the sphere's.
    pub area: f64,
}

/// The rest shapes of all triangles of a surface, scaled to the area 4π in total.
#[derive(Debug, Clone)]
pub(crate) struct RestShapes {
    triangles: Vec<[u32; 3]>,
    shapes: Vec<RestShape>,
}

/// Triangles thinner than this get this ratio of height to longest side: needles give rounding errors and
/// ill-conditioned systems.
const THINNEST: f64 = 0.02;

/// Twice the least area, relative to a surface of area 4π; smaller triangles get this.
const MIN_DOUBLE_AREA: f64 = 1e-12;

impl RestShape {
    /// The shape of a triangle in space; areas are multiplied by `area_scale`.
    pub fn of_triangle([a, b, c]: [&Point; 3], area_scale: f64) -> Self {
        let (ab, ac, bc) = (b - a, c - a, c - b);
        let double_area = ab.cross(&ac).norm();
        let squares = [bc.norm_squared(), ac.norm_squared(), ab.norm_squared()];
        let longest_squared = squares[0].max(squares[1]).max(squares[2]);
        let floored = double_area
            .max(THINNEST * longest_squared)
            .max(MIN_DOUBLE_AREA / area_scale);
        let dots = [ab.dot(&ac), -ab.dot(&bc), ac.dot(&bc)];
        let cotangents = if longest_squared > 0.0 && double_area >= THINNEST * longest_squared {
            dots.map(|dot| dot / double_area)
        } else {
            thickened_cotangents(squares, longest_squared)
        };
        Self {
            cotangents,
            area: 0.5 * floored * area_scale,
        }
    }

    /// Four times the Dirichlet energy of the linear map of the triangle to one with these corners.
    pub fn dirichlet(&self, a: &Vector, b: &Vector, c: &Vector) -> f64 {
        let [ca, cb, cc] = self.cotangents;
        ca * (c - b).norm_squared() + cb * (c - a).norm_squared() + cc * (b - a).norm_squared()
    }

    /// The inverse of the matrix whose columns are the edges from the first corner, to the next and to the last, in the
    /// triangle's plane with the first edge along the first axis: row `i` belongs to edge `i`.
    pub fn inverse(&self) -> [[f64; 2]; 2] {
        let [first, next, _] = self.cotangents;
        let double_area = 2.0 * self.area;
        // Both cotangents times the height make the first edge, and the height times the edge is twice the area.
        let base = (double_area * (first + next)).sqrt();
        let height = double_area / base;
        [[base.recip(), -first * height / double_area], [0.0, height.recip()]]
    }
}

/// Cotangents of the triangle on the same longest side whose apex is lifted to the least height.
fn thickened_cotangents(squares: [f64; 3], longest_squared: f64) -> [f64; 3] {
    if longest_squared.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return [(1f64 / 3.0).sqrt(); 3];
    }
    let apex = (0..3).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let (left, right) = (squares[(apex + 1) % 3], squares[(apex + 2) % 3]);
    // Foot of the apex on the side opposite to it, in units of that side.
    let foot = (0.5 * (1.0 + (right - left) / longest_squared)).clamp(0.0, 1.0);
    let mut cotangents = [0.0; 3];
    cotangents[(apex + 1) % 3] = foot / THINNEST;
    cotangents[(apex + 2) % 3] = (1.0 - foot) / THINNEST;
    cotangents[apex] = (THINNEST * THINNEST - foot * (1.0 - foot)) / THINNEST;
    cotangents
}

impl RestShapes {
    /// The shapes of these triangles between these points.
    ///
    /// Always finite: triangles that are too thin or too small are regularised, and those with a corner that is missing
    /// or not finite become small equilateral ones.
    pub fn new(triangles: &[[u32; 3]], positions: &[Point]) -> Self {
        // Coordinates of any size: products of them must not leave the range of f64.
        let size = positions.iter().map(|p| p.coords.amax()).filter(|c| c.is_finite());
        let scale = size.fold(0.0, f64::max).max(f64::MIN_POSITIVE).recip().min(f64::MAX);
        let corners = |t: &[u32; 3]| {
            let corners = t.map(|v| positions.get(v as usize).map(|p| p * scale));
            let is_usable = |p: &Option<Point>| p.is_some_and(|p| p.iter().all(|c| c.is_finite()));
            if corners.iter().all(is_usable) {
                corners.map(Option::unwrap_or_default)
            } else {
                [Point::origin(); 3]
            }
        };
        // In order, so that sums are the same for any number of threads.
        let areas: Vec<f64> = triangles.par_iter().map(|t| triangle_area(&corners(t))).collect();
        let unit = 4.0 * std::f64::consts::PI / areas.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        // Without any area all triangles are alike.
        let unit = unit.min(f64::MAX);
        let mut shapes: Vec<RestShape> = triangles
            .par_iter()
            .map(|t| RestShape::of_triangle(corners(t).each_ref(), unit))
            .collect();
        let total: f64 = shapes.iter().map(|shape| shape.area).sum();
        for shape in &mut shapes {
            shape.area *= 4.0 * std::f64::consts::PI / total;
        }
        Self {
            triangles: triangles.to_vec(),
            shapes,
        }
    }

    /// The triangles, as given.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The shape of each triangle.
    pub fn shapes(&self) -> &[RestShape] {
        &self.shapes
    }

    /// The rest area of each triangle; 4π in total.
    #[cfg(test)]
    pub fn areas(&self) -> impl Iterator<Item = f64> {
        self.shapes.iter().map(|shape| shape.area)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_shapes_are_finite_whatever_the_triangles() {
        let points = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.5, 1e-9, 0.0],
            [0.5, 0.0, 0.0],
            [f64::NAN, 0.0, 0.0],
            [1e-30, 1e-30, 0.0],
            [0.0, f64::INFINITY, 0.0],
        ];
        let triangles = [
            [0, 1, 2],
            [0, 1, 3],
            [0, 1, 4],
            [0, 0, 0],
            [0, 0, 1],
            [0, 1, 5],
            [0, 6, 4],
            [1, 2, 7],
            [0, 1, 99],
        ];
        for scale in [1.0, 1e-300, 1e200] {
            let positions = points.map(|p| Point::from(p) * scale);
            let rest = RestShapes::new(&triangles, &positions);
            assert!((rest.areas().sum::<f64>() / (4.0 * std::f64::consts::PI) - 1.0).abs() < 1e-12);
            for shape in rest.shapes() {
                assert!(shape.area > 1e-13 && shape.inverse().iter().flatten().all(|entry| entry.is_finite()));
            }
        }
        let none = RestShapes::new(&[[0, 0, 0], [0, 1, 2]], &[]);
        assert!(
            none.areas()
                .all(|area| (area / (2.0 * std::f64::consts::PI) - 1.0).abs() < 1e-12)
        );
        assert_eq!(RestShapes::new(&[], &[]).areas().count(), 0);
    }

    #[test]
    fn rest_shapes_within_bounds_are_kept() {
        let positions = [[0.0, 0.0, 1.0], [3.0, 0.0, 1.0], [1.0, 0.2, 1.0], [0.0, -1.0, 1.0]].map(Point::from);
        let rest = RestShapes::new(&[[0, 1, 2], [0, 3, 1]], &positions);
        // Areas 0.3 and 1.5; the Jacobian of a triangle to its own plane is the identity.
        let areas: Vec<f64> = rest.areas().collect();
        assert!((areas[1] / areas[0] - 5.0).abs() < 1e-12);
        let scale = (areas[0] / 0.3).sqrt();
        let [[p, r], [s, t]] = rest.shapes()[0].inverse();
        let (first, last) = (Vector::x() * 3.0 * scale, Vector::new(1.0, 0.2, 0.0) * scale);
        let z = [first * p + last * s, first * r + last * t];
        assert!(
            z[0].dot(&z[1]).abs() < 1e-12 && (z[0].norm() - 1.0).abs() < 1e-12 && (z[1].norm() - 1.0).abs() < 1e-12
        );
    }

    /// The angles `α, β, γ` of any triangle satisfy `cot α cot β + cot β cot γ + cot γ cot α = 1`.
    #[test]
    fn thin_triangles_become_triangles_of_the_least_height_on_their_longest_side() {
        let [a, b] = [Point::origin(), Point::new(2.0, 0.0, 0.0)];
        for (foot, height) in [(0.3, 1e-3), (1.9, 1e-9), (1.0, 0.0), (0.0, 1e-3), (2.5, 1e-6)] {
            let apex = Point::new(foot, height, 0.0);
            let longest: f64 = f64::max(2.0, foot);
            for corners in [[&a, &b, &apex], [&b, &apex, &a], [&apex, &a, &b]] {
                let RestShape {
                    cotangents: [x, y, z],
                    area,
                } = RestShape::of_triangle(corners, 1.0);
                assert!((x * y + y * z + z * x - 1.0).abs() < 1e-10, "{x} {y} {z}");
                assert!((area - 0.5 * THINNEST * longest * longest).abs() < 1e-5, "{area}");
            }
        }
    }
}
