//! The harmonic energy of a boundary map's inside, and how it changes with the images of the vertices.
//!
//! By Green's formula `∫ |∇f|² dx = ∫ f · ∂f/∂n dA` for harmonic `f`, and the energy of the harmonic map with the boundary values
//! `f + δ` is `∫ |∇f|² dx + 2 ∫ δ · ∂f/∂n dA` to first order. The fitted map has the normal derivative in closed form: both
//! integrals need no tetrahedra.

use super::ImproveError;
use crate::boundary_map::BoundaryMap;
use crate::energy::UnitVolumeScale;
use crate::fit::{DomainFactor, FitOptions, Phase};
use crate::map::VolumeMap;
use crate::mesh::SurfaceMesh;
use crate::progress::ProgressControl;
use crate::{Matrix3, Point, Vector};

/// Points in each triangle, by two equal barycentric coordinates and the third, and their weights: exact for polynomials of degree 4
/// (Dunavant, *High degree efficient symmetrical Gaussian quadrature rules for the triangle*, 1985). Between near sources the normal
/// derivative varies within triangles: three points, exact to degree 2, give energies that are 1.5 % too low on coarse meshes.
const RULE: [(f64, f64); 2] = [
    (0.445_948_490_915_965, 0.223_381_589_678_011),
    (0.091_576_213_509_771, 0.109_951_743_655_322),
];
const POINTS: usize = 6;

/// Barycentric coordinates and weights.
fn rule() -> [([f64; 3], f64); POINTS] {
    std::array::from_fn(|i| {
        let (equal, weight) = RULE[i / 3];
        let mut barycentric = [equal; 3];
        barycentric[i % 3] = 1.0 - 2.0 * equal;
        (barycentric, weight)
    })
}

/// The energy of one boundary map.
#[derive(Debug, Clone)]
pub(super) struct VolumeEnergy {
    /// Harmonic energy of the map between the solids scaled to unit volume.
    pub harmonic: f64,
    /// Its derivative by the image of each vertex.
    pub slopes: Vec<Vector>,
    /// Boundary error of the fit (99 % of the area, over the target's diagonal).
    pub boundary_error: f64,
}

impl VolumeEnergy {
    /// By how much the energy changes, to first order, as vertices go from these images to others.
    pub fn change_to(&self, from: &[Point], to: &[Point]) -> f64 {
        let moves = from.iter().zip(to).zip(&self.slopes);
        moves.map(|((from, to), slope)| slope.dot(&(to - from))).sum()
    }
}

/// Measures boundary maps of one domain to one target: the system is factored once.
pub(super) struct VolumeMeasure {
    factor: DomainFactor,
    domain: SurfaceMesh,
    points: Vec<Point>,
    /// Normals times the area that each point represents.
    areas: Vec<Vector>,
    /// From integrals in model units to those between solids of unit volume.
    pub scale: f64,
}

impl VolumeMeasure {
    /// Factors the domain, and measures the first map, for which sources are added where its error is too large.
    pub fn new(
        map: &BoundaryMap,
        options: &FitOptions,
        progress: &dyn Fn(Phase) -> ProgressControl,
    ) -> Result<(Self, VolumeEnergy), ImproveError> {
        let domain = map.domain().clone();
        let scale = UnitVolumeScale::new(domain.volume(), map.target_volume())?;
        let mut factor = DomainFactor::new(&domain, options, progress)?;
        let fitted = factor.solve_refined(map, progress)?;
        let triangles = 0..domain.triangles().len();
        let of_triangle = |t: usize| {
            let corners = domain.corners(t);
            let area = domain.area_vector(t);
            rule().map(|([l, m, n], weight)| {
                let x = corners[0].coords * l + corners[1].coords * m + corners[2].coords * n;
                (Point::from(x), area * weight)
            })
        };
        let (points, areas) = triangles.flat_map(of_triangle).unzip();
        let measure = Self {
            factor,
            points,
            areas,
            scale: scale.jacobian * scale.jacobian * scale.volume_element,
            domain,
        };
        let energy = measure.energy(&fitted.map, fitted.report.boundary_error.p99);
        Ok((measure, energy))
    }

    /// The energy of another map of the same domain.
    pub fn of(
        &self,
        map: &BoundaryMap,
        progress: &dyn Fn(Phase) -> ProgressControl,
    ) -> Result<VolumeEnergy, ImproveError> {
        let fitted = self.factor.solve(map, progress)?;
        Ok(self.energy(&fitted.map, fitted.report.boundary_error.p99))
    }

    fn energy(&self, map: &dyn VolumeMap, boundary_error: f64) -> VolumeEnergy {
        let (images, jacobians): (Vec<Point>, Vec<Matrix3>) = map.evaluate_with_jacobian(&self.points);
        let centre = images.iter().map(|y| y.coords).sum::<Vector>() / images.len().max(1) as f64;
        let mut slopes = vec![Vector::zeros(); self.domain.vertices().len()];
        let (rule, mut harmonic) = (rule(), 0.0);
        for (i, ((image, jacobian), area)) in images.iter().zip(&jacobians).zip(&self.areas).enumerate() {
            let flux = jacobian * area * self.scale;
            harmonic += (image.coords - centre).dot(&flux);
            let corners = self.domain.triangles()[i / POINTS];
            for (v, share) in corners.into_iter().zip(rule[i % POINTS].0) {
                slopes[v as usize] += flux * (2.0 * share);
            }
        }
        VolumeEnergy {
            harmonic,
            slopes,
            boundary_error,
        }
    }
}
