//! Boundary maps as right-hand sides of the system.

use std::sync::Arc;

use super::FitError;
use super::image_spacing::ImageSpacing;
use crate::boundary_map::BoundaryMap;
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::solver::Values;
use crate::{Point, Vector};

/// Whether a volume is zero up to rounding, compared with the cube of the bounding box's diagonal.
pub(crate) fn is_flat(volume: f64, diagonal: f64) -> bool {
    volume.abs() < 1e-12 * diagonal.powi(3)
}

/// A boundary map of the factored domain, and the normalised coordinates in which its images are solved for: the target
/// has diagonal 1, so that all maps of a block have equal weight.
pub(super) struct BoundaryData {
    pub boundary: BoundaryMap,
    pub origin: Point,
    pub diagonal: f64,
    /// `None` where images are no positions.
    spacing: Option<ImageSpacing>,
}

impl BoundaryData {
    /// `affine` says whether the affine functions are in the basis.
    pub fn new(boundary: &BoundaryMap, domain: &Arc<SurfaceMesh>, affine: bool) -> Result<Self, FitError> {
        // The repaired domain has the same vertices and triangles; some triangles may be reversed.
        let boundary = boundary.over(domain.clone()).map_err(|_| FitError::OtherDomain)?;
        let (low, high) = boundary.target_box();
        // With the constant in the basis the shift changes nothing but rounding; without it, it would change the fit.
        let origin = if affine {
            nalgebra::center(&low, &high)
        } else {
            Point::origin()
        };
        let diagonal = (high - low).norm();
        let spacing = (!boundary.is_by_function()).then(|| ImageSpacing::of(&boundary, diagonal));
        Ok(Self {
            boundary,
            origin,
            diagonal,
            spacing,
        })
    }

    /// Spacing of the image's vertices around a point of the boundary, as a fraction of the target's diagonal; `None` where
    /// images are no positions.
    pub fn spacing_at(&self, point: &SurfacePoint) -> Option<f64> {
        let spacing = self.spacing.as_ref()?;
        Some(spacing.at(self.boundary.domain(), point))
    }

    /// Images of points of the boundary in the normalised coordinates.
    pub fn values_at(&self, points: &[SurfacePoint]) -> Vec<Vector> {
        let images = self.boundary.evaluate(points);
        images.iter().map(|p| (p - self.origin) / self.diagonal).collect()
    }

    /// Errors of a map at points of the boundary, as fractions of the target's diagonal.
    pub fn errors_of(&self, map: &HarmonicMap, points: &[SurfacePoint]) -> Vec<f64> {
        let values = map.evaluate(&self.boundary.positions(points));
        let pairs = values.iter().zip(self.boundary.evaluate(points));
        pairs.map(|(f, exact)| (f - exact).norm() / self.diagonal).collect()
    }

    /// A warning when the target encloses no volume or the map reverses the orientation; the fit goes ahead
    /// nevertheless.
    pub fn warning(&self) -> Option<String> {
        if self.boundary.is_by_function() {
            return None;
        }
        let volume = self.boundary.target_volume();
        let warning = if is_flat(volume, self.diagonal) {
            "the target encloses no volume, so it is not a solid; the map flattens the domain"
        } else if volume < 0.0 {
            "the boundary map reverses the orientation: it turns the solid inside out"
        } else {
            return None;
        };
        Some(warning.into())
    }
}

/// A row for each point, with three columns for each boundary map.
pub(super) fn right_hand_sides(data: &[BoundaryData], points: &[SurfacePoint]) -> Values {
    let values: Vec<Vec<Vector>> = data.iter().map(|data| data.values_at(points)).collect();
    let mut entries = Vec::with_capacity(3 * points.len() * data.len());
    for row in 0..points.len() {
        values.iter().for_each(|values| entries.extend(values[row].iter()));
    }
    Values::new(3 * data.len(), entries)
}
