//! A solid as alignments need it.

use nalgebra::SymmetricEigen;

use super::AlignError;
use crate::boundary_map::pair::oriented_query::{OrientedPoint, OrientedQuery, unit_or_zero, vertex_normals};
use crate::geometry::Similarity;
use crate::mesh::SurfaceMesh;
use crate::sampling::{Collocation, thin};
use crate::{Matrix3, Point, Vector};

/// A solid as alignments need it: built once, aligned to any number of others.
#[derive(Debug, Clone)]
pub struct AlignmentSurface {
    /// Its own coordinates to those in which its surface has the centroid 0 and the root mean square radius 1.
    pub(super) to_frame: Similarity,
    /// In the frame.
    pub(super) query: OrientedQuery,
    /// Well-spread points with their normals, in the frame; every prefix is a coarser choice.
    pub(super) samples: Vec<(Point, Vector)>,
    /// What the query answers for the samples that correspondences are sought among: where other queries near them begin.
    pub(super) found: Vec<OrientedPoint>,
    /// Principal axes as columns, right-handed, the longest first.
    pub(super) axes: Matrix3,
    /// Mean squares along them.
    pub(super) extents: Vector,
    /// Twice the distance of the farthest vertex from the centroid, in the frame.
    pub(super) size: f64,
    pub(super) vertices: Vec<Point>,
    pub(super) normals: Vec<Vector>,
}

/// Length that a normal is worth, as a fraction of the target's size.
pub(in crate::boundary_map::pair) const REACH: f64 = 0.1;
/// Samples of a surface.
pub(super) const SAMPLES: usize = 1000;
/// Points that correspondences are sought among.
pub(super) const CANDIDATES: usize = 600;
/// Mean squares along two axes closer than this factor leave it open which is which.
const ALIKE: f64 = 1.25;
const SEED: u64 = 1;

impl AlignmentSurface {
    /// Prepares a closed surface, its triangles facing outward; `side` names it in errors. Costs a tree of its triangles.
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
        let vertices = surface
            .vertices()
            .iter()
            .map(|p| Point::from((p - centre) / radius))
            .collect();
        let framed = surface.with_vertices(vertices).expect("one position per vertex");
        let normals = vertex_normals(&framed);
        let query = OrientedQuery::new(&framed, &normals).ok_or(AlignError::NoArea { side })?;
        let (axes, extents) = principal_axes(&(covariance / (radius * radius)));
        let samples = samples(&framed, &normals);
        let corners = framed.triangles().iter().flatten();
        let radii = corners.map(|&v| framed.vertices()[v as usize].coords.norm());
        let size = 2.0 * radii.fold(0.0, f64::max);
        let found = query.closest_of_all(&samples[..CANDIDATES.min(samples.len())], REACH * size, &[]);
        Ok(Self {
            to_frame,
            query,
            found,
            axes: towards_the_long_end(&axes, &samples),
            samples,
            extents,
            size,
            vertices: framed.into_parts().0,
            normals,
        })
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

    pub(in crate::boundary_map::pair) fn query(&self) -> &OrientedQuery {
        &self.query
    }

    /// Twice the distance of the farthest vertex from the centroid, in the frame: unlike the diagonal of a box it stays
    /// as the solid turns.
    pub(in crate::boundary_map::pair) fn size(&self) -> f64 {
        self.size
    }

    pub(super) fn has_axes_alike(&self) -> bool {
        (0..2).any(|k| self.extents[k] < ALIKE * self.extents[k + 1])
    }
}

/// Centroid and covariance of the surface, exact for its triangles; `None` without area.
fn moments(surface: &SurfaceMesh) -> Option<(Point, Matrix3)> {
    let (low, high) = surface.bounding_box()?;
    // About the middle of the box: far from the origin the squares would cancel.
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

/// Right-handed principal axes as columns and the mean squares along them, the largest first.
pub(super) fn principal_axes(covariance: &Matrix3) -> (Matrix3, Vector) {
    let eigen = SymmetricEigen::new(*covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [a, b] = [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned());
    let axes = Matrix3::from_columns(&[a, b, a.cross(&b)]);
    (axes, Vector::from(order.map(|k| eigen.eigenvalues[k].max(0.0))))
}

/// The first two axes turned to the side on which the samples reach farther, so that axes turn with the solid.
fn towards_the_long_end(axes: &Matrix3, samples: &[(Point, Vector)]) -> Matrix3 {
    let [a, b] = [0, 1].map(|k| {
        let axis = axes.column(k).into_owned();
        let skewness: f64 = samples.iter().map(|(p, _)| axis.dot(&p.coords).powi(3)).sum();
        if skewness < 0.0 { -axis } else { axis }
    });
    Matrix3::from_columns(&[a, b, a.cross(&b)])
}

fn samples(surface: &SurfaceMesh, normals: &[Vector]) -> Vec<(Point, Vector)> {
    let candidates = Collocation::even(surface, 4 * SAMPLES, SEED).points;
    let positions: Vec<Point> = candidates
        .iter()
        .map(|p| p.position(surface, surface.vertices()))
        .collect();
    let normals: Vec<Point> = normals.iter().map(|n| Point::from(*n)).collect();
    let sample = |k: usize| {
        let normal = candidates[k].position(surface, &normals).coords;
        (positions[k], unit_or_zero(&normal))
    };
    thin(&positions, SAMPLES).into_iter().map(sample).collect()
}
