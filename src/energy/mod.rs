//! Energies of a map between solids, as totals and as distributions over the domain.
//!
//! Sections 4.3.1 and 4.3.2 of Li, Guo, Wang, He, Gu & Qin, *Harmonic volumetric mapping for solid modeling
//! applications* (2007). A [`Quadrature`] of the domain says where a density is evaluated and what volume each point
//! stands for: [`clipped_grid`] makes one from a surface, as the paper does, [`cell_quadrature`] from a mesh of tetrahedra
//! or hexahedra; [`adaptive_quadrature`] divides the cells of a grid until the integrals are accurate.
//! [`mod@distortion`] measures the quality of a map by the metrics that are usual elsewhere.

mod adaptive;
mod clipped_grid;
mod density;
mod determinant;
pub mod distortion;
mod distribution;
mod domain_mesh;
mod hex_quadrature;
mod quadrature;
mod tet_quadrature;
mod unit_volume;
mod volmap;
mod worst_places;

pub(crate) use adaptive::undivided_grid;
pub use adaptive::{AdaptiveOptions, AdaptiveQuadrature, adaptive_quadrature};
pub use clipped_grid::{GridResolution, clipped_grid};
pub use density::{Lame, deformation_density, harmonic_density};
pub use distortion::{
    Determinants, DistortionMetrics, DistortionReport, distortion, distortion_of_jacobians, tet_distortion,
};
pub use distribution::DensityQuantiles;
pub use domain_mesh::{DomainMeshError, DomainMeshQuadrature, domain_mesh_quadrature};
pub use hex_quadrature::cell_quadrature;
pub use quadrature::{CellLayout, CellMean, Grid, Quadrature, QuadratureError};
pub use tet_quadrature::tet_quadrature;
pub use unit_volume::UnitVolumeScale;
pub use volmap::{VolmapMetrics, VolmapRange, volmap_metrics};
pub use worst_places::worst_places;

use std::ops::Range;

use crate::{Matrix3, Point, map::VolumeMap, mesh::SurfaceMesh};
use adaptive::AdaptiveStart;
use determinant::determinant;

/// Points whose Jacobians are held at a time: enough for all cores, and small compared with the densities.
const CHUNK: usize = 1 << 16;

/// Options of [`energies`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnergyOptions {
    /// Scale domain and target to unit volume first, as the paper does, so that energies of different solids compare:
    /// the identity then has harmonic energy 3. Otherwise energies are the plain integrals in model units.
    pub normalize: bool,
    /// Material of the deformation energy.
    pub lame: Lame,
}

impl Default for EnergyOptions {
    fn default() -> Self {
        Self {
            normalize: true,
            lame: Lame::default(),
        }
    }
}

/// Energies of a map.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct EnergyReport {
    /// Integral of [`harmonic_density()`].
    #[serde(rename = "harmonic_energy")]
    pub harmonic: f64,
    /// Integral of [`deformation_density()`].
    #[serde(rename = "deformation_energy")]
    pub deformation: f64,
    /// Estimated errors of both, where the quadrature was adaptive.
    pub errors: Option<EnergyErrors>,
    /// Whether energies and their densities are those of the map between the solids scaled to unit volume.
    pub normalized: bool,
    /// Volume of the domain, in model units.
    pub volume: f64,
    /// Volume of the target, in model units.
    pub target_volume: f64,
    /// Harmonic energy density over the domain.
    pub harmonic_density: DensityQuantiles,
    /// Deformation energy density over the domain.
    pub deformation_density: DensityQuantiles,
    /// `det J` in model units, also when energies are normalised. Where its sign is not that of `target_volume`, the
    /// map is folded.
    pub det_jacobian: DensityQuantiles,
    /// Where the map is folded.
    pub folded: FoldedVolume,
    /// The values at the points of the quadrature.
    #[serde(skip)]
    pub densities: Densities,
}

/// Where a map is folded, at the points of a quadrature: `det J` is zero or does not have the sign of the target's volume.
///
/// A [certificate](crate::certificate) proves the same of whole cells.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct FoldedVolume {
    /// How many of the points.
    pub points: usize,
    /// Volume of the domain that those represent.
    pub volume: f64,
    /// That as a fraction of the domain's.
    pub fraction: f64,
    /// Estimated error of the fraction, where the quadrature was adaptive: `det J` may change its sign between points, and
    /// folds that are thinner than the cells hide there. Not a bound.
    pub error: Option<f64>,
}

/// Estimated errors of energies that an [`adaptive_quadrature`] gave.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EnergyErrors {
    /// Error of [`EnergyReport::harmonic`].
    #[serde(rename = "harmonic_energy")]
    pub harmonic: f64,
    /// Error of [`EnergyReport::deformation`].
    #[serde(rename = "deformation_energy")]
    pub deformation: f64,
    /// Whether both are within the tolerance.
    pub within_tolerance: bool,
}

/// Values at given points, in order; [`Quadrature::cell_means`] turns those at a quadrature's points into values per
/// cell.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Densities {
    /// Harmonic energy density.
    pub harmonic: Vec<f64>,
    /// Deformation energy density.
    pub deformation: Vec<f64>,
    /// Determinant of the Jacobian, in model units.
    pub det_jacobian: Vec<f64>,
}

impl EnergyOptions {
    /// The scale that energies are taken at.
    fn scale(&self, domain_volume: f64, target_volume: f64) -> Result<UnitVolumeScale, EnergyError> {
        if self.normalize {
            UnitVolumeScale::new(domain_volume, target_volume)
        } else {
            Ok(UnitVolumeScale::NONE)
        }
    }
}

impl Densities {
    /// Adds the densities of `scale · J`, and the determinant of `J` itself.
    fn push(&mut self, jacobian: &Matrix3, scale: f64, lame: &Lame) {
        let scaled = jacobian * scale;
        self.harmonic.push(harmonic_density(&scaled));
        self.deformation.push(deformation_density(&scaled, lame));
        self.det_jacobian.push(determinant(jacobian));
    }

    /// Adds those of several Jacobians, one for each point, which must be finite.
    fn extend(&mut self, jacobians: &[Matrix3], points: &[Point], scale: f64, lame: &Lame) -> Result<(), EnergyError> {
        for (jacobian, &point) in jacobians.iter().zip(points) {
            if jacobian.iter().any(|entry| !entry.is_finite()) {
                return Err(EnergyError::NonFiniteJacobian { point });
            }
            self.push(jacobian, scale, lame);
        }
        Ok(())
    }

    /// The values at some of the points.
    fn rows(&self, rows: &[u32]) -> Self {
        let of = |list: &[f64]| rows.iter().map(|&row| list[row as usize]).collect();
        Self {
            harmonic: of(&self.harmonic),
            deformation: of(&self.deformation),
            det_jacobian: of(&self.det_jacobian),
        }
    }
}

/// Why the energy of a map cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EnergyError {
    /// A volume is not positive and finite, so that it cannot be scaled to one.
    #[error("the {solid} has a volume of {volume}; give a closed solid that is oriented outward")]
    Volume {
        /// `"domain"` or `"target"`.
        solid: &'static str,
        /// Its volume.
        volume: f64,
    },
    /// The map has no finite derivative at a point of the domain.
    #[error(
        "the map's Jacobian at {point} is not finite; a singularity of the map or a hole in its mesh is inside the \
         domain"
    )]
    NonFiniteJacobian {
        /// The point.
        point: Point,
    },
    /// The map did not return a Jacobian for every point.
    #[error("the map gave {found} Jacobians for {expected} points; its `jacobian` must give one for each, in order")]
    JacobianCount {
        /// Points asked for.
        expected: usize,
        /// Jacobians given.
        found: usize,
    },
    /// The domain cannot be integrated over.
    #[error(transparent)]
    Quadrature(#[from] QuadratureError),
    /// The number of images is not that of the mesh's vertices.
    #[error("{found} images for the {expected} vertices of the domain; give the image of every vertex, in order")]
    ImageCount {
        /// Vertices of the domain.
        expected: usize,
        /// Images given.
        found: usize,
    },
}

/// Energy densities of a map at any points, such as those of a [plane section](crate::geometry::PlaneSection); not
/// finite where the Jacobian is not. The volumes are those of the two solids; they matter only with
/// [`EnergyOptions::normalize`].
///
/// # Errors
///
/// [`EnergyError::Volume`] for a volume that cannot be scaled to one.
pub fn densities(
    map: &dyn VolumeMap,
    points: &[Point],
    domain_volume: f64,
    target_volume: f64,
    options: &EnergyOptions,
) -> Result<Densities, EnergyError> {
    let scale = options.scale(domain_volume, target_volume)?;
    let mut densities = Densities::default();
    for jacobian in map.jacobian(points) {
        densities.push(&jacobian, scale.jacobian, &options.lame);
    }
    Ok(densities)
}

/// Harmonic and deformation energy of a map over a domain, with their distributions.
///
/// `domain_volume` and `target_volume` are those of the two solids, in model units; `domain_volume` is usually
/// [`Quadrature::volume`]. The target's is negative when the map reflects.
///
/// With [`EnergyOptions::normalize`] the energies are those of the map between the solids scaled to unit volume
/// ([`UnitVolumeScale`]), which do not depend on the units of either solid.
///
/// # Errors
///
/// [`EnergyError`], for volumes that are not positive and Jacobians that are not finite.
pub fn energies(
    map: &dyn VolumeMap,
    quadrature: &Quadrature,
    domain_volume: f64,
    target_volume: f64,
    options: &EnergyOptions,
) -> Result<EnergyReport, EnergyError> {
    measure(quadrature, domain_volume, target_volume, options, |chunk| {
        map.jacobian(&quadrature.points()[chunk])
    })
}

/// Harmonic and deformation energy of a map over the inside of a closed surface, to a relative tolerance, with the
/// quadrature that gives them. As [`energies`] otherwise.
///
/// # Errors
///
/// As [`energies`], and [`EnergyError::Quadrature`] for a surface that bounds no solid.
pub fn adaptive_energies(
    map: &dyn VolumeMap,
    domain: &SurfaceMesh,
    target_volume: f64,
    options: &EnergyOptions,
    accuracy: &AdaptiveOptions,
) -> Result<(Quadrature, EnergyReport), EnergyError> {
    let mut found = adaptive_energies_of_maps(domain, &[target_volume], options, accuracy, |_, points, add| {
        for chunk in points.chunks(CHUNK) {
            add(0, &map.jacobian(chunk));
        }
    })?;
    found.pop().expect("one result for each target volume")
}

/// [`adaptive_energies`] of several maps of one domain, which all begin with the same points.
///
/// `jacobians` is called with a range of maps and with points, and adds the Jacobians of each of these maps, counted from
/// the first of the range, at all of the points, in order, in one piece or more. A map that cannot be measured does not
/// stop the others, and the result for one does not depend on the others.
#[expect(clippy::type_complexity, reason = "a list with the result of each map")]
pub(crate) fn adaptive_energies_of_maps(
    domain: &SurfaceMesh,
    target_volumes: &[f64],
    options: &EnergyOptions,
    accuracy: &AdaptiveOptions,
    mut jacobians: impl FnMut(Range<usize>, &[Point], &mut dyn FnMut(usize, &[Matrix3])),
) -> Result<Vec<Result<(Quadrature, EnergyReport), EnergyError>>, EnergyError> {
    let domain_volume = domain.volume();
    unit_volume::require_volume("domain", domain_volume)?;
    let start = AdaptiveStart::new(domain, accuracy)?;
    let sampled = |&volume: &f64| Ok(MapSamples::new(options.scale(domain_volume, volume)?, options.lame));
    let mut samples: Vec<Result<MapSamples, EnergyError>> = target_volumes.iter().map(sampled).collect();
    jacobians(0..samples.len(), start.points(), &mut |map, list| {
        if let Ok(samples) = &mut samples[map] {
            samples.add(list, start.points());
        }
    });
    let negligible = [0.0, options.lame.negligible_density() * domain_volume];
    let samples = samples.into_iter().zip(target_volumes).enumerate();
    let measured = samples.map(|(map, (samples, &target_volume))| {
        let mut samples = samples?;
        let first = samples.take(start.points().len())?;
        let (adapted, cells) = start.refined(&negligible, &first, &mut |points| {
            jacobians(map..map + 1, points, &mut |_, list| samples.add(list, points));
            samples.take(points.len())
        })?;
        let folded_error = cells.sign_error(&samples.densities.det_jacobian);
        let (quadrature, scale) = (adapted.quadrature, samples.scale);
        let densities = samples.densities.rows(&adapted.rows);
        let mut report = report(
            densities,
            &quadrature,
            quadrature.volume(),
            target_volume,
            options,
            scale,
        )?;
        report.errors = Some(EnergyErrors {
            harmonic: adapted.errors[0] * scale.volume_element,
            deformation: adapted.errors[1] * scale.volume_element,
            within_tolerance: adapted.is_converged,
        });
        report.folded.error = Some(folded_error);
        Ok((quadrature, report))
    });
    Ok(measured.collect())
}

/// Densities of a map at points that come in batches.
struct MapSamples {
    scale: UnitVolumeScale,
    lame: Lame,
    densities: Densities,
    /// Points before the batch.
    known: usize,
    error: Option<EnergyError>,
}

impl MapSamples {
    fn new(scale: UnitVolumeScale, lame: Lame) -> Self {
        Self {
            scale,
            lame,
            densities: Densities::default(),
            known: 0,
            error: None,
        }
    }

    /// Adds the Jacobians at the next points of a batch.
    fn add(&mut self, jacobians: &[Matrix3], batch: &[Point]) {
        let done = self.densities.det_jacobian.len() - self.known;
        let points = batch.get(done..).unwrap_or_default();
        if let Err(error) = self
            .densities
            .extend(jacobians, points, self.scale.jacobian, &self.lame)
        {
            self.error.get_or_insert(error);
        }
    }

    /// Ends a batch of so many points: the values of both energy densities at them.
    fn take(&mut self, count: usize) -> Result<Vec<Vec<f64>>, EnergyError> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        require_count(self.densities.det_jacobian.len() - self.known, count)?;
        let densities = [&self.densities.harmonic, &self.densities.deformation];
        let values = densities.map(|list| list[self.known..].to_vec()).to_vec();
        self.known += count;
        Ok(values)
    }
}

/// Energies from the Jacobians at ranges of the quadrature's points.
fn measure(
    quadrature: &Quadrature,
    domain_volume: f64,
    target_volume: f64,
    options: &EnergyOptions,
    jacobians: impl Fn(Range<usize>) -> Vec<Matrix3>,
) -> Result<EnergyReport, EnergyError> {
    unit_volume::require_volume("domain", domain_volume)?;
    let scale = options.scale(domain_volume, target_volume)?;
    let points = quadrature.points();
    let mut densities = Densities::default();
    for first in (0..points.len()).step_by(CHUNK) {
        let chunk = &points[first..points.len().min(first + CHUNK)];
        let jacobians = jacobians(first..first + chunk.len());
        require_count(jacobians.len(), chunk.len())?;
        densities.extend(&jacobians, chunk, scale.jacobian, &options.lame)?;
    }
    report(densities, quadrature, domain_volume, target_volume, options, scale)
}

/// What densities at the points of a quadrature say.
fn report(
    densities: Densities,
    quadrature: &Quadrature,
    domain_volume: f64,
    target_volume: f64,
    options: &EnergyOptions,
    scale: UnitVolumeScale,
) -> Result<EnergyReport, EnergyError> {
    let weights = quadrature.weights();
    let (solid, volume) = ("domain", 0.0);
    let distribution =
        |values: &[f64]| DensityQuantiles::weighted(values, weights).ok_or(EnergyError::Volume { solid, volume });
    // A map that reflects as a whole is folded where it preserves the orientation.
    let orientation = if target_volume < 0.0 { -1.0 } else { 1.0 };
    let points = densities.det_jacobian.iter().zip(weights);
    let folded = points.filter(|(det, _)| **det * orientation <= 0.0);
    let folded_volume = folded.clone().fold(0.0, |sum, (_, weight)| sum + weight);
    Ok(EnergyReport {
        harmonic: quadrature.integrate(&densities.harmonic) * scale.volume_element,
        deformation: quadrature.integrate(&densities.deformation) * scale.volume_element,
        errors: None,
        normalized: options.normalize,
        volume: domain_volume,
        target_volume,
        harmonic_density: distribution(&densities.harmonic)?,
        deformation_density: distribution(&densities.deformation)?,
        det_jacobian: distribution(&densities.det_jacobian)?,
        folded: FoldedVolume {
            points: folded.count(),
            volume: folded_volume,
            fraction: folded_volume / quadrature.volume(),
            error: None,
        },
        densities,
    })
}

fn require_count(found: usize, expected: usize) -> Result<(), EnergyError> {
    if found == expected {
        Ok(())
    } else {
        Err(EnergyError::JacobianCount { expected, found })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Matrix3, Vector,
        mesh::{SurfaceMesh, TetMesh, shapes},
    };

    /// A map given by its formula and that of its Jacobian.
    struct Formula<F, J>(F, J);

    impl<F: Fn(&Point) -> Point + Sync, J: Fn(&Point) -> Matrix3 + Sync> VolumeMap for Formula<F, J> {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            points.iter().map(&self.0).collect()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            points.iter().map(&self.1).collect()
        }
    }

    fn affine(matrix: Matrix3) -> impl VolumeMap {
        Formula(move |p: &Point| Point::from(matrix * p.coords), move |_: &Point| matrix)
    }

    /// `(x² − y², 2 x y, z)`, harmonic, with `‖J‖² = 8 (x² + y²) + 1` and `det J = 4 (x² + y²)`.
    fn squaring() -> impl VolumeMap {
        Formula(
            |p: &Point| Point::new(p.x * p.x - p.y * p.y, 2.0 * p.x * p.y, p.z),
            |p: &Point| Matrix3::new(2.0 * p.x, -2.0 * p.y, 0.0, 2.0 * p.y, 2.0 * p.x, 0.0, 0.0, 0.0, 1.0),
        )
    }

    const RAW: EnergyOptions = EnergyOptions {
        normalize: false,
        lame: Lame {
            lambda: 0.0335,
            mu: 0.0224,
        },
    };

    fn grid(surface: &SurfaceMesh, cells: usize) -> Quadrature {
        clipped_grid(surface, GridResolution::CellsAlongLongestSide(cells)).unwrap()
    }

    fn measured(map: &dyn VolumeMap, rule: &Quadrature, target_volume: f64, options: &EnergyOptions) -> EnergyReport {
        energies(map, rule, rule.volume(), target_volume, options).unwrap()
    }

    #[test]
    fn identity_has_three_times_the_volume_or_three() {
        let rule = grid(&shapes::torus(2.0, 0.7, 40, 20), 12);
        let volume = rule.volume();
        let identity = affine(Matrix3::identity());
        let raw = measured(&identity, &rule, volume, &RAW);
        assert!((raw.harmonic / (3.0 * volume) - 1.0).abs() < 1e-13);
        let normalized = measured(&identity, &rule, volume, &EnergyOptions::default());
        assert!((normalized.harmonic - 3.0).abs() < 1e-13);
        assert!(normalized.deformation.abs() < 1e-28);
        assert_eq!(normalized.det_jacobian.min, 1.0);
        assert_eq!(normalized.folded.points, 0);
    }

    #[test]
    fn rotation_has_the_energy_of_the_identity() {
        let rotation = nalgebra::Rotation3::new(Vector::new(0.3, -1.2, 2.0)).into_inner();
        let rule = grid(&shapes::double_torus(1), 9);
        let report = measured(&affine(rotation), &rule, rule.volume(), &EnergyOptions::default());
        assert!((report.harmonic - 3.0).abs() < 1e-13);
        assert!(report.deformation < 1e-28);
    }

    #[test]
    fn affine_maps_have_the_energy_of_their_matrix() {
        let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        let rule = grid(&shapes::spherical_shell(1.0, 0.5, 3), 10);
        let report = measured(&affine(matrix), &rule, rule.volume() * matrix.determinant(), &RAW);
        let expected = rule.volume() * matrix.norm_squared();
        assert!((report.harmonic / expected - 1.0).abs() < 1e-13);
        let expected = rule.volume() * deformation_density(&matrix, &Lame::default());
        assert!((report.deformation / expected - 1.0).abs() < 1e-13);
    }

    #[test]
    fn normalised_energies_do_not_depend_on_the_units_of_either_solid() {
        let (s1, s2) = (0.01, 250.0);
        let surface = shapes::sphere(1.0, 3);
        let rule = grid(&surface, 10);
        let target_volume = 2.0;
        let here = measured(&squaring(), &rule, target_volume, &EnergyOptions::default());

        // s₂ f(x / s₁) between the scaled solids, with Jacobian (s₂ / s₁) J(x / s₁).
        let scaled = Formula(
            |p: &Point| squaring().evaluate(&[p / s1])[0] * s2,
            |p: &Point| squaring().jacobian(&[p / s1])[0] * (s2 / s1),
        );
        let rule = grid(&shapes::deformed(&surface, |p| p * s1), 10);
        let there = measured(&scaled, &rule, target_volume * s2.powi(3), &EnergyOptions::default());
        assert!((there.harmonic / here.harmonic - 1.0).abs() < 1e-12);
        assert!((there.deformation / here.deformation - 1.0).abs() < 1e-12);
        assert!((there.harmonic_density.p99 / here.harmonic_density.p99 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_similarity_is_the_identity_once_normalised() {
        let rule = grid(&shapes::cube(1.0, 1), 4);
        let report = measured(
            &affine(Matrix3::identity() * 7.0),
            &rule,
            343.0,
            &EnergyOptions::default(),
        );
        assert!((report.harmonic - 3.0).abs() < 1e-13);
        assert!(report.deformation < 1e-28);
        assert!((report.det_jacobian.median - 343.0).abs() < 1e-10);
    }

    #[test]
    fn squaring_the_cube_misses_its_closed_form_by_the_midpoint_error() {
        // ∫ 8 (x² + y²) + 1 over the unit cube is 7/3; midpoints lose h²/12 of ∫ x² and of ∫ y².
        for cells in [4, 8, 16] {
            let h = 1.0 / cells as f64;
            let report = measured(&squaring(), &grid(&shapes::cube(1.0, 2), cells), 1.0, &RAW);
            assert!((report.harmonic - (7.0 / 3.0 - 4.0 / 3.0 * h * h)).abs() < 1e-13);
        }
    }

    #[test]
    fn squaring_the_ball_converges_to_its_closed_form_with_second_order() {
        // ∫ 8 (x² + y²) + 1 over the unit ball is 64π/15 + 4π/3. The sphere is refined with the grid, so that its own
        // error, of second order in the edge length, falls alike.
        let exact = std::f64::consts::PI * (64.0 / 15.0 + 4.0 / 3.0);
        let errors = [(3, 8), (4, 16), (5, 32)].map(|(levels, cells)| {
            let rule = grid(&shapes::sphere(1.0, levels), cells);
            (measured(&squaring(), &rule, 1.0, &RAW).harmonic / exact - 1.0).abs()
        });
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 2.0).abs() < 0.15, "order {order}, errors {errors:?}");
        }
    }

    #[test]
    fn squaring_is_integrated_exactly_over_tets() {
        // The cube [-1/2, 1/2]³ as six tetrahedra about its diagonal, one along each order of the axes.
        let corner = |n: usize| [n & 1, n >> 1 & 1, n >> 2 & 1].map(|bit| bit as f64 - 0.5);
        let vertices = (0..8).map(|n| Point::from(corner(n))).collect();
        let orders = [[1, 2, 4], [1, 4, 2], [2, 1, 4], [2, 4, 1], [4, 1, 2], [4, 2, 1]];
        let tets = orders.map(|[a, b, _]: [u32; 3]| [0, a, a + b, 7]).to_vec();
        let rule = tet_quadrature(&TetMesh::new(vertices, tets).unwrap()).unwrap();
        let report = measured(&squaring(), &rule, 1.0, &RAW);
        assert!((report.volume - 1.0).abs() < 1e-15);
        assert!((report.harmonic - 7.0 / 3.0).abs() < 1e-14);
    }

    #[test]
    fn a_steep_place_in_a_rod_is_resolved_to_the_tolerance() {
        // z ↦ z + a exp(−x²/w²), with w half of a cell: ‖J‖² = 3 + g'², and ∫ g'² dx = a² √(π/2) / w.
        let rod = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 0.1 * p.y, 0.1 * p.z));
        let (a, w) = (0.1, 0.01);
        let slope = move |x: f64| -2.0 * a * x / (w * w) * (-x * x / (w * w)).exp();
        let bump = Formula(
            move |p: &Point| p + Vector::new(0.0, 0.0, a * (-p.x * p.x / (w * w)).exp()),
            move |p: &Point| Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, slope(p.x), 0.0, 1.0),
        );
        let exact = 0.01 * (3.0 + a * a * std::f64::consts::FRAC_PI_2.sqrt() / w);
        let coarse = measured(&bump, &grid(&rod, 48), 0.01, &RAW);
        assert!(
            (coarse.harmonic / exact - 1.0).abs() > 0.1,
            "{} {exact}",
            coarse.harmonic
        );

        // The deformation energy has the fourth power of the slope.
        let accuracy = AdaptiveOptions {
            max_points: Some(1_000_000),
            ..AdaptiveOptions::default()
        };
        let (quadrature, report) = adaptive_energies(&bump, &rod, 0.01, &RAW, &accuracy).unwrap();
        let errors = report.errors.unwrap();
        assert!(errors.within_tolerance && errors.harmonic <= 0.01 * report.harmonic);
        assert!(
            (report.harmonic - exact).abs() <= errors.harmonic,
            "{} {exact} {errors:?}",
            report.harmonic
        );
        assert_eq!(report.densities.harmonic.len(), quadrature.points().len());
        let again = measured(&bump, &quadrature, 0.01, &RAW);
        assert!((again.deformation / report.deformation - 1.0).abs() < 1e-13);
    }

    #[test]
    fn a_map_that_is_not_finite_does_not_stop_the_others() {
        let cube = shapes::cube(1.0, 2);
        let accuracy = AdaptiveOptions {
            resolution: GridResolution::CellsAlongLongestSide(4),
            ..AdaptiveOptions::default()
        };
        let jacobians = |_: Range<usize>, points: &[Point], add: &mut dyn FnMut(usize, &[Matrix3])| {
            add(0, &vec![Matrix3::identity(); points.len()]);
            add(1, &vec![Matrix3::repeat(f64::NAN); points.len()]);
            add(2, &vec![Matrix3::identity(); points.len() - 1]);
            add(3, &[]);
        };
        let volumes = [1.0, 1.0, 1.0, 0.0];
        let reports =
            adaptive_energies_of_maps(&cube, &volumes, &EnergyOptions::default(), &accuracy, jacobians).unwrap();
        assert!((reports[0].as_ref().unwrap().1.harmonic - 3.0).abs() < 1e-13);
        assert!(matches!(reports[1], Err(EnergyError::NonFiniteJacobian { .. })));
        assert!(matches!(reports[2], Err(EnergyError::JacobianCount { .. })));
        assert!(matches!(reports[3], Err(EnergyError::Volume { solid: "target", .. })));
        let none = AdaptiveOptions {
            tolerance: f64::NAN,
            ..accuracy
        };
        let refused = adaptive_energies(&affine(Matrix3::identity()), &cube, 1.0, &RAW, &none);
        assert!(matches!(
            refused,
            Err(EnergyError::Quadrature(QuadratureError::Tolerance(_)))
        ));
    }

    #[test]
    fn inverted_parts_are_counted_by_volume() {
        // x ↦ x² − x is inverted where 2x < 1: in three of eight layers of cells, since x runs from 1/8 to 9/8.
        let surface = shapes::deformed(&shapes::cube(1.0, 1), |p| p + Vector::new(0.625, 0.0, 0.0));
        let fold = Formula(
            |p: &Point| Point::new(p.x * p.x - p.x, p.y, p.z),
            |p: &Point| Matrix3::from_diagonal(&Vector::new(2.0 * p.x - 1.0, 1.0, 1.0)),
        );
        let report = measured(&fold, &grid(&surface, 8), 1.0, &RAW);
        assert_eq!(report.folded.points, 3 * 64);
        assert!((report.folded.fraction - 0.375).abs() < 1e-13);
        assert!((report.det_jacobian.min - -0.625).abs() < 1e-13);
        assert!((report.det_jacobian.max - 1.125).abs() < 1e-13);
    }

    #[test]
    fn densities_at_other_points_are_those_of_the_formulas() {
        let points = [Point::new(0.5, 0.25, 0.0), Point::new(f64::NAN, 0.0, 0.0)];
        let raw = densities(&squaring(), &points, 2.0, 16.0, &RAW).unwrap();
        assert_eq!([raw.harmonic[0], raw.det_jacobian[0]], [3.5, 1.25]);
        assert!(raw.harmonic[1].is_nan() && raw.deformation[1].is_nan());
        let at_unit_volume = densities(&squaring(), &points, 2.0, 16.0, &EnergyOptions::default()).unwrap();
        assert_eq!(
            [at_unit_volume.harmonic[0], at_unit_volume.det_jacobian[0]],
            [3.5 / 4.0, 1.25]
        );
    }

    #[test]
    fn cell_means_integrate_to_the_total() {
        let rule = grid(&shapes::spherical_shell(1.0, 0.99, 3), 6);
        let report = measured(&squaring(), &rule, 1.0, &RAW);
        let means = rule.cell_means(&report.densities.harmonic);
        let total: f64 = means.iter().map(|cell| cell.mean * cell.volume).sum();
        assert!((total / report.harmonic - 1.0).abs() < 1e-13);
        assert!(means.windows(2).all(|pair| pair[0].cell < pair[1].cell));
        assert!(means.len() < rule.points().len(), "some cells hold several points");
    }

    #[test]
    fn bad_volumes_and_jacobians_are_refused() {
        let rule = grid(&shapes::cube(1.0, 1), 2);
        let identity = affine(Matrix3::identity());
        let options = EnergyOptions::default();
        assert!(matches!(
            energies(&identity, &rule, 1.0, 0.0, &options),
            Err(EnergyError::Volume { solid: "target", .. })
        ));
        assert!(matches!(
            energies(&identity, &rule, f64::NAN, 1.0, &options),
            Err(EnergyError::Volume { solid: "domain", .. })
        ));
        let broken = Formula(|p: &Point| *p, |p: &Point| Matrix3::repeat((p.x - 0.25).recip()));
        let rule_point = Point::new(0.25, -0.25, -0.25);
        assert_eq!(
            energies(&broken, &rule, 1.0, 1.0, &options),
            Err(EnergyError::NonFiniteJacobian { point: rule_point })
        );

        struct Mute;
        impl VolumeMap for Mute {
            fn evaluate(&self, _: &[Point]) -> Vec<Point> {
                Vec::new()
            }
            fn jacobian(&self, _: &[Point]) -> Vec<Matrix3> {
                Vec::new()
            }
        }
        assert!(matches!(
            energies(&Mute, &rule, 1.0, 1.0, &options),
            Err(EnergyError::JacobianCount { expected: 8, found: 0 })
        ));
    }
}
