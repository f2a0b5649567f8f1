//! Distortion of angles, areas and lengths by a map of surfaces.
//!
//! Over a triangle the map is linear, and everything follows from the singular values `σ₁ ≥ σ₂` of its 2 × 2 Jacobian:
//! Sander, Snyder, Gortler & Hoppe, *Texture mapping progressive meshes*, SIGGRAPH 2001; the symmetric Dirichlet energy
//! is that of Smith & Schaefer, *Bijective parameterization with free boundaries*, SIGGRAPH 2015.

use std::fmt;

use rayon::prelude::*;
use serde::Serialize;

use crate::mesh::{SurfaceMesh, triangle_area};
use crate::statistics::weighted_quantiles;
use crate::{Point, Vector};

/// A triangle whose height is below this fraction of its longest side is flat up to rounding, and has no Jacobian.
const NO_HEIGHT: f64 = 1e-12;

/// What a map does to one triangle, its image scaled so that the whole surface keeps its area.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TriangleDistortion {
    /// Singular values `σ₁ ≥ σ₂ ≥ 0` of the Jacobian: the largest and the smallest ratio of lengths. Flips do not show.
    pub stretches: [f64; 2],
    /// The largest change of an angle of the triangle, in degrees.
    pub angle_change: f64,
}

/// Distortion of a map over the area of its domain.
///
/// The image is scaled so that both surfaces have the same area: a similarity has no distortion. Quantiles are weighted
/// by the domain's area; they are infinite (`null` in JSON) where the image of a triangle has no area.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SurfaceDistortion {
    /// Number of triangles measured.
    pub triangles: usize,
    /// Triangles of the domain without an area up to rounding, or with a corner or image that is not finite; left out.
    pub left_out: usize,
    /// The factor that images were divided by: the square root of the ratio of the total areas.
    pub scale: f64,
    /// `σ₁ / σ₂`: 1 where angles are kept.
    pub angle: DistortionQuantiles,
    /// The largest change of an angle of the triangle, in degrees.
    pub angle_change: DistortionQuantiles,
    /// `max(σ₁σ₂, 1 / σ₁σ₂)`: 1 where areas are kept in proportion, 2 where they are doubled or halved.
    pub area: DistortionQuantiles,
    /// `max(σ₁, 1 / σ₂)`: 1 where lengths are kept in proportion.
    pub length: DistortionQuantiles,
    /// `σ₁² + σ₂² + σ₁⁻² + σ₂⁻²`: 4 where lengths are kept in proportion.
    pub symmetric_dirichlet: DistortionQuantiles,
    /// Mean of the symmetric Dirichlet energy over the domain's area.
    pub mean_symmetric_dirichlet: f64,
}

/// Quantiles over the domain's area.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DistortionQuantiles {
    /// Median.
    #[serde(rename = "median")]
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    /// The largest value.
    pub max: f64,
}

impl TriangleDistortion {
    /// `σ₁ / σ₂`, 1 where angles are kept; infinite for a flat image.
    pub fn angle(&self) -> f64 {
        let [largest, smallest] = self.stretches;
        if smallest > 0.0 {
            largest / smallest
        } else {
            f64::INFINITY
        }
    }

    /// `σ₁σ₂`: the ratio of areas.
    pub fn area_ratio(&self) -> f64 {
        self.stretches[0] * self.stretches[1]
    }

    /// `σ₁² + σ₂² + σ₁⁻² + σ₂⁻²`, 4 for rigid motions; infinite for a flat image.
    pub fn symmetric_dirichlet(&self) -> f64 {
        self.stretches.iter().map(|s| s * s + 1.0 / (s * s)).sum()
    }
}

impl SurfaceDistortion {
    /// Distortion of the map that takes the vertices of `domain` to `image`. `None` when the counts differ, or no
    /// triangle of the domain, or of the image, has an area.
    pub fn of(domain: &SurfaceMesh, image: &[Point]) -> Option<Self> {
        let (all, scale) = measured(domain, image)?;
        let areas = areas(domain.vertices(), domain);
        let (kept, weights): (Vec<TriangleDistortion>, Vec<f64>) = all
            .iter()
            .zip(&areas)
            .filter_map(|(d, area)| Some(((*d)?, *area)))
            .unzip();
        let over_area = |value: fn(&TriangleDistortion) -> f64| {
            let values: Vec<f64> = kept.iter().map(value).collect();
            weighted_quantiles(&values, &weights, [0.5, 0.9, 0.99, 1.0])
                .map(|[p50, p90, p99, max]| DistortionQuantiles { p50, p90, p99, max })
        };
        let total: f64 = weights.iter().sum();
        let weighted = kept.iter().zip(&weights);
        Some(Self {
            triangles: kept.len(),
            left_out: all.len() - kept.len(),
            scale,
            angle: over_area(TriangleDistortion::angle)?,
            angle_change: over_area(|d| d.angle_change)?,
            area: over_area(|d| d.area_ratio().max(1.0 / d.area_ratio()))?,
            length: over_area(|d| d.stretches[0].max(1.0 / d.stretches[1]))?,
            symmetric_dirichlet: over_area(TriangleDistortion::symmetric_dirichlet)?,
            mean_symmetric_dirichlet: weighted.map(|(d, w)| d.symmetric_dirichlet() * (w / total)).sum(),
        })
    }
}

impl fmt::Display for SurfaceDistortion {
    /// A table of the quantiles.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let head = ["distortion over the area", "50 %", "90 %", "99 %", "max", "undistorted"];
        let [name, p50, p90, p99, max, best] = head;
        writeln!(f, "{name:<24}  {p50:>9}  {p90:>9}  {p99:>9}  {max:>9}  {best:>11}")?;
        for (name, row, best) in [
            ("angle, σ₁/σ₂", &self.angle, "1"),
            ("angle, degrees", &self.angle_change, "0"),
            ("area, ratio or inverse", &self.area, "1"),
            ("length, ratio or inverse", &self.length, "1"),
            ("symmetric Dirichlet", &self.symmetric_dirichlet, "4"),
        ] {
            let [p50, p90, p99, max] = [row.p50, row.p90, row.p99, row.max].map(short);
            writeln!(f, "{name:<24}  {p50:>9}  {p90:>9}  {p99:>9}  {max:>9}  {best:>11}")?;
        }
        Ok(())
    }
}

/// The distortion of every triangle of the map that takes the vertices of `domain` to `image`; `None` for triangles
/// that are flat in the domain up to rounding, or not finite. `None` altogether when the counts differ, or no triangle
/// of the domain, or of the image, has an area.
pub fn triangle_distortions(domain: &SurfaceMesh, image: &[Point]) -> Option<Vec<Option<TriangleDistortion>>> {
    measured(domain, image).map(|(distortions, _)| distortions)
}

/// The distortions, and the scale that images were divided by.
fn measured(domain: &SurfaceMesh, image: &[Point]) -> Option<(Vec<Option<TriangleDistortion>>, f64)> {
    if image.len() != domain.vertices().len() {
        return None;
    }
    let total = |positions: &[Point]| {
        let finite = areas(positions, domain).into_iter().filter(|area| area.is_finite());
        Some(finite.sum::<f64>()).filter(|total| *total > 0.0 && total.is_finite())
    };
    let scale = (total(image)? / total(domain.vertices())?).sqrt();
    let of_triangle = |triangle: &[u32; 3]| {
        let corners = |positions: &[Point]| triangle.map(|v| positions[v as usize]);
        triangle_distortion(&corners(domain.vertices()), &corners(image), scale)
    };
    let distortions: Vec<_> = domain.triangles().par_iter().map(of_triangle).collect();
    distortions.iter().any(Option::is_some).then_some((distortions, scale))
}

fn areas(positions: &[Point], mesh: &SurfaceMesh) -> Vec<f64> {
    let area = |t: &[u32; 3]| triangle_area(&t.map(|v| positions[v as usize]));
    mesh.triangles().par_iter().map(area).collect()
}

fn triangle_distortion(domain: &[Point; 3], image: &[Point; 3], scale: f64) -> Option<TriangleDistortion> {
    // In a frame along the longest side, which is well conditioned also for needles.
    let side = |k: usize| (domain[(k + 1) % 3] - domain[k]).norm();
    let start = (0..3).max_by(|&i, &j| side(i).total_cmp(&side(j)))?;
    let along = |p: &[Point; 3], scale: f64| {
        let [a, b, c] = [0, 1, 2].map(|k| p[(start + k) % 3]);
        [(b - a) / scale, (c - a) / scale]
    };
    let [base, other] = along(domain, 1.0);
    let [image_base, image_other] = along(image, scale);
    let length = base.norm();
    let foot = base.dot(&other) / length;
    let height = base.cross(&other).norm() / length;
    let is_finite = |v: &Vector| v.iter().all(|x| x.is_finite());
    if height.is_nan() || height <= NO_HEIGHT * length || !is_finite(&image_base) || !is_finite(&image_other) {
        return None;
    }
    let first = image_base / length;
    let second = (image_other - first * foot) / height;
    Some(TriangleDistortion {
        stretches: singular_values(&first, &second),
        angle_change: (0..3)
            .map(|k| (angle_at(domain, k) - angle_at(image, k)).abs().to_degrees())
            .fold(0.0, f64::max),
    })
}

/// Singular values of the matrix with these columns. By their sum and difference, so that neither loses digits where
/// they are nearly equal or one is far smaller.
fn singular_values(first: &Vector, second: &Vector) -> [f64; 2] {
    let (a, b, c) = (first.norm_squared(), second.norm_squared(), first.dot(second));
    let product = first.cross(second).norm();
    let sum = (a + b + 2.0 * product).sqrt();
    if sum == 0.0 {
        return [0.0; 2];
    }
    let difference = (a - b).hypot(2.0 * c) / sum;
    let largest = (sum + difference) / 2.0;
    [largest, product / largest]
}

fn angle_at(corners: &[Point; 3], k: usize) -> f64 {
    let [u, v] = [1, 2].map(|step| corners[(k + step) % 3] - corners[k]);
    u.cross(&v).norm().atan2(u.dot(&v))
}

/// Three or four significant digits.
fn short(x: f64) -> String {
    match x.abs() {
        _ if x == 0.0 => "0".into(),
        size if !size.is_finite() => "infinite".into(),
        size if !(1e-3..1e6).contains(&size) => format!("{x:.2e}"),
        size => format!("{x:.*}", (3 - size.log10().floor() as i32).max(0) as usize),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix3;
    use crate::mesh::shapes;

    /// Singular values of the matrix restricted to the plane of a triangle, by its 3 × 2 matrix in an orthonormal basis
    /// of the plane.
    fn restricted(matrix: &Matrix3, corners: &[Point; 3]) -> [f64; 2] {
        let u = (corners[1] - corners[0]).normalize();
        let normal = u.cross(&(corners[2] - corners[0])).normalize();
        let v = normal.cross(&u);
        let columns = nalgebra::Matrix3x2::from_columns(&[matrix * u, matrix * v]);
        let values = columns.singular_values();
        [values[0].max(values[1]), values[0].min(values[1])]
    }

    #[test]
    fn an_affine_map_has_the_singular_values_of_its_matrix_in_each_triangle() {
        let domain = shapes::bumpy_sphere(6);
        let matrix = Matrix3::new(2.0, 0.3, -0.1, 0.0, 0.5, 0.4, 0.2, -0.6, 1.5);
        let image = shapes::deformed(&domain, |p| {
            Point::from(matrix * p.coords + Vector::new(3.0, 1.0, -2.0))
        });
        let scale = (image.area() / domain.area()).sqrt();
        let found = triangle_distortions(&domain, image.vertices()).unwrap();
        for (t, distortion) in found.iter().enumerate() {
            let expected = restricted(&matrix, &domain.corners(t)).map(|s| s / scale);
            let stretches = distortion.unwrap().stretches;
            for (x, y) in stretches.iter().zip(expected) {
                assert!((x / y - 1.0).abs() < 1e-12, "{stretches:?} {expected:?}");
            }
            let area = image.area_vector(t).norm() / domain.area_vector(t).norm() / (scale * scale);
            assert!((distortion.unwrap().area_ratio() / area - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn similarities_have_no_distortion_whatever_their_size() {
        let domain = shapes::bumpy_sphere(5);
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        for size in [1.0, 1e-60, 1e60] {
            let image = shapes::deformed(&domain, |p| Point::from((turn * p * size).coords));
            let found = SurfaceDistortion::of(&domain, image.vertices()).unwrap();
            assert!((found.scale / size - 1.0).abs() < 1e-12);
            assert_eq!((found.triangles, found.left_out), (domain.triangles().len(), 0));
            // Rounding of coordinates of size 1 in triangles of size 1/5.
            for quantiles in [found.angle, found.area, found.length] {
                assert!((1.0..1.0 + 1e-12).contains(&quantiles.max), "{found:?}");
            }
            assert!(found.angle_change.max < 1e-10 && (found.mean_symmetric_dirichlet - 4.0).abs() < 1e-12);
        }
    }

    /// Two rectangles, the smaller stretched to twice its height: σ = 2 and 1 there, before scaling.
    #[test]
    fn quantiles_are_weighted_by_area_and_show_a_collapsed_part() {
        let square = |y: f64, h: f64| [[0.0, y], [1.0, y], [1.0, y + h], [0.0, y + h]];
        let points = |squares: [[[f64; 2]; 4]; 2]| -> Vec<Point> {
            squares.iter().flatten().map(|[x, y]| Point::new(*x, *y, 7.0)).collect()
        };
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let domain = SurfaceMesh::new(points([square(0.0, 0.75), square(2.0, 0.25)]), triangles).unwrap();
        let image = points([square(0.0, 0.75), square(2.0, 0.5)]);
        let found = SurfaceDistortion::of(&domain, &image).unwrap();
        assert!((found.scale - 1.25f64.sqrt()).abs() < 1e-14);
        assert!((found.angle.p50 - 1.0).abs() < 1e-14 && (found.angle.p90 - 2.0).abs() < 1e-14);
        assert!((found.area.p50 - 1.25).abs() < 1e-14 && (found.area.p90 - 1.6).abs() < 1e-14);
        let flat = points([square(0.0, 0.75), square(2.0, 0.0)]);
        let found = SurfaceDistortion::of(&domain, &flat).unwrap();
        assert_eq!(
            (found.angle.p90, found.symmetric_dirichlet.max),
            (f64::INFINITY, f64::INFINITY)
        );
        assert!((found.angle.p50 - 1.0).abs() < 1e-14);
        assert!(found.to_string().contains("infinite"));
    }

    #[test]
    fn triangles_without_a_jacobian_are_left_out_and_counted() {
        let (mut vertices, mut triangles) = shapes::cube(1.0, 1).into_parts();
        vertices.push(nalgebra::center(&vertices[0], &vertices[1]));
        triangles.push([0, 1, 8]);
        let domain = SurfaceMesh::new(vertices.clone(), triangles).unwrap();
        let found = SurfaceDistortion::of(&domain, &vertices).unwrap();
        assert_eq!((found.triangles, found.left_out), (12, 1));
        vertices[3].x = f64::NAN;
        let found = SurfaceDistortion::of(&domain, &vertices).unwrap();
        assert!(found.left_out > 1 && found.angle.max.is_finite());
        assert_eq!(SurfaceDistortion::of(&domain, &vertices[1..]), None);
        assert_eq!(SurfaceDistortion::of(&domain, &[Point::origin(); 9]), None);
        assert_eq!(SurfaceDistortion::of(&SurfaceMesh::default(), &[]), None);
    }
}
