//! A surface prepared for alignment.

use nalgebra::SymmetricEigen;

use super::AlignError;
use crate::boundary_map::pair::oriented_query::{OrientedPoint, OrientedQuery, unit_or_zero, vertex_normals};
use crate::geometry::Similarity;
use crate::mesh::{SurfaceMesh, shapes};
use crate::sampling::{Collocation, thin};
use crate::{Matrix3, Point, Vector};

/// A closed surface prepared for alignment with any number of others: normalised, sampled, and in a search tree.
#[derive(Debug, Clone)]
pub struct AlignmentSurface {
    /// From its coordinates to the frame in which the surface has centroid 0 and root mean square radius 1.
    pub(super) to_frame: Similarity,
    /// In the frame.
    pub(in crate::boundary_map::pair) query: OrientedQuery,
    /// Farthest-point samples with their normals, in the frame; every prefix is a coarser sampling.
    pub(super) samples: Vec<(Point, Vector)>,
    /// The closest points of the first [`CANDIDATES`] samples: hints for queries near them.
    pub(super) hints: Vec<OrientedPoint>,
    /// Principal axes as columns, right-handed, the longest first.
    pub(super) axes: Matrix3,
    /// Variances along them.
    pub(super) variances: Vector,
    /// Twice the distance of the farthest vertex from the centroid, in the frame: unlike the diagonal of the bounding
    /// box, invariant under rotations.
    pub(in crate::boundary_map::pair) size: f64,
    /// Vertices and their unit normals, in the frame.
    pub(super) vertices: Vec<Point>,
    pub(super) normals: Vec<Vector>,
}

/// Weight of normals in the metric of closest points (`β` of [`OrientedQuery`]), as a fraction of the target's size.
pub(in crate::boundary_map::pair) const NORMAL_WEIGHT: f64 = 0.1;
/// Samples of a surface.
pub(super) const SAMPLES: usize = 1000;
/// Samples of the other surface that closest points are sought among.
pub(super) const CANDIDATES: usize = 600;
/// Principal axes are ambiguous if the variances along two of them are closer than this factor.
const AMBIGUOUS_RATIO: f64 = 1.25;
const SEED: u64 = 1;
/// Largest stretch to the extents of another surface: of flat ones an extent is 0.
const MOST_STRETCH: f64 = 10.0;

impl AlignmentSurface {
    /// Prepares a closed surface, its triangles facing outward; `side` names it in errors.
    ///
    /// # Errors
    ///
    /// When the surface has no area, or a vertex that is not finite.
    pub fn new(surface: &SurfaceMesh, side: &'static str) -> Result<Self, AlignError> {
        if !surface.vertices().iter().all(|p| p.iter().all(|c| c.is_finite())) {
            return Err(AlignError::NonFinite { side });
        }
        let (centre, covariance) = moments(surface).ok_or(AlignError::NoArea { side })?;
        let radius = covariance.trace().sqrt();
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(AlignError::NoArea { side });
        }
        let to_frame = Similarity {
            scale: 1.0 / radius,
            rotation: Matrix3::identity(),
            translation: -centre.coords / radius,
        };
        let framed = shapes::deformed(surface, |p| Point::from((p - centre) / radius));
        let normals = vertex_normals(&framed);
        let query = OrientedQuery::new(&framed, &normals).ok_or(AlignError::NoArea { side })?;
        let (axes, variances) = principal_axes(&(covariance / (radius * radius)));
        let samples = samples(&framed, &normals);
        let corners = framed.triangles().iter().flatten();
        let radii = corners.map(|&v| framed.vertices()[v as usize].coords.norm());
        let size = 2.0 * radii.fold(0.0, f64::max);
        let hints = query.closest_of_all(&samples[..CANDIDATES.min(samples.len())], NORMAL_WEIGHT * size);
        Ok(Self {
            to_frame,
            query,
            hints,
            axes: oriented_by_skewness(&axes, &samples),
            samples,
            variances,
            size,
            vertices: framed.into_parts().0,
            normals,
        })
    }

    pub(in crate::boundary_map::pair) fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// Vertices and their unit normals carried to the frame of `target`.
    pub(in crate::boundary_map::pair) fn vertices_in(
        &self,
        target: &Self,
        alignment: &Similarity,
    ) -> Vec<(Point, Vector)> {
        let to_target = target.to_frame.after(alignment).after(&self.to_frame.inverse());
        let moved = |(p, n): (&Point, &Vector)| (to_target.apply(p), to_target.rotation * n);
        self.vertices.iter().zip(&self.normals).map(moved).collect()
    }

    /// The surface that this one was prepared from, stretched along its principal axes until it has the extents of another along
    /// those of that one.
    pub(in crate::boundary_map::pair) fn with_extents_of(&self, other: &Self, surface: &SurfaceMesh) -> SurfaceMesh {
        let ratio = |k: usize| {
            let ratio = (other.variances[k] / self.variances[k]).sqrt();
            if ratio.is_finite() {
                ratio.clamp(1.0 / MOST_STRETCH, MOST_STRETCH)
            } else {
                1.0
            }
        };
        let stretch = self.axes * Matrix3::from_diagonal(&Vector::from([0, 1, 2].map(ratio))) * self.axes.transpose();
        shapes::deformed(surface, |p| Point::from(stretch * self.to_frame.apply(p).coords))
    }

    pub(super) fn has_ambiguous_axes(&self) -> bool {
        (0..2).any(|k| self.variances[k] < AMBIGUOUS_RATIO * self.variances[k + 1])
    }
}

/// Centroid and covariance of the surface, exact for its triangles; `None` without area.
fn moments(surface: &SurfaceMesh) -> Option<(Point, Matrix3)> {
    let (low, high) = surface.bounding_box()?;
    // About the middle of the box: far from the origin the variances would cancel.
    let middle = nalgebra::center(&low, &high);
    let mut area = 0.0;
    let mut first = Vector::zeros();
    let mut second = Matrix3::zeros();
    for t in 0..surface.triangles().len() {
        let weight = surface.area_vector(t).norm();
        let corners = surface.corners(t).map(|p| p - middle);
        let sum: Vector = corners.iter().sum();
        let squares: Matrix3 = corners.iter().map(|c| c * c.transpose()).sum();
        area += weight;
        first += weight / 3.0 * sum;
        second += weight / 12.0 * (squares + sum * sum.transpose());
    }
    let mean = first / area;
    let covariance = second / area - mean * mean.transpose();
    let is_sound = area > 0.0 && covariance.iter().chain(mean.iter()).all(|c| c.is_finite());
    is_sound.then_some((middle + mean, covariance))
}

/// Right-handed principal axes as columns and the variances along them, the largest first.
pub(super) fn principal_axes(covariance: &Matrix3) -> (Matrix3, Vector) {
    let eigen = SymmetricEigen::new(*covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [a, b] = [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned());
    let axes = Matrix3::from_columns(&[a, b, a.cross(&b)]);
    (axes, Vector::from(order.map(|k| eigen.eigenvalues[k].max(0.0))))
}

/// The axes with the signs of the first two chosen so that the samples have positive skewness along them: the axes are
/// then equivariant under rotations.
fn oriented_by_skewness(axes: &Matrix3, samples: &[(Point, Vector)]) -> Matrix3 {
    let [a, b] = [0, 1].map(|k| {
        let axis = axes.column(k).into_owned();
        let skewness: f64 = samples.iter().map(|(p, _)| axis.dot(&p.coords).powi(3)).sum();
        if skewness < 0.0 { -axis } else { axis }
    });
    Matrix3::from_columns(&[a, b, a.cross(&b)])
}

fn samples(surface: &SurfaceMesh, normals: &[Vector]) -> Vec<(Point, Vector)> {
    let candidates = Collocation::even(surface, 4 * SAMPLES, SEED).points;
    let positions = candidates.iter().map(|p| p.position(surface, surface.vertices()));
    let positions: Vec<Point> = positions.collect();
    let normals: Vec<Point> = normals.iter().map(|n| Point::from(*n)).collect();
    let sample = |k: usize| {
        let normal = candidates[k].position(surface, &normals).coords;
        (positions[k], unit_or_zero(&normal))
    };
    thin(&positions, SAMPLES).into_iter().map(sample).collect()
}
