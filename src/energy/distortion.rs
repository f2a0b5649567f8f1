//! Distortion of angles, lengths and volumes: the five metrics of Cherchi & Livesu, *VOLMAP: a large scale benchmark
//! for volume mappings to simple base domains*, Computer Graphics Forum 42 (2023), with the normalisation of the
//! program published there.
//!
//! All metrics are functions of the principal stretches `σ₁ ≥ σ₂ ≥ |σ₃|`, the singular values of the Jacobian, of which
//! the smallest carries the sign of the determinant.

use rayon::prelude::*;

use super::{
    CHUNK, EnergyError, Quadrature, UnitVolumeScale, determinant::determinant, quadrature::sum, require_count,
};
use crate::statistics::weighted_quantiles;
use crate::{Matrix3, Point, map::VolumeMap, mesh::TetMesh};

/// Upper bound that values are clamped to in [`DistortionReport::volmap`].
pub const VOLMAP_BOUND: f64 = 100.0;

/// Largest number of sweeps over the three pairs of columns: far more than needed, because convergence is quadratic.
const MAX_SWEEPS: usize = 30;

/// The five metrics, of one Jacobian or as a mean.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DistortionMetrics {
    /// [`conformal`].
    pub conformal: f64,
    /// [`dirichlet`].
    pub dirichlet: f64,
    /// [`symmetric_dirichlet`].
    pub symmetric_dirichlet: f64,
    /// [`arap`].
    pub arap: f64,
    /// [`mips`].
    pub mips: f64,
}

/// Distortion of a map over a domain.
///
/// Means are over the part of the domain where the map is regular: the Jacobian finite and `det J` of the sign of the
/// target's volume. Three of the metrics are infinite elsewhere, and VOLMAP leaves folded elements out too.
/// `left_out_fraction` says how much the means leave out.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DistortionReport {
    /// Means over the volume of the domain, in model units. `None` when the map is regular nowhere.
    pub mean: Option<DistortionMetrics>,
    /// The same with the target scaled to the volume of the domain, as [`super::EnergyOptions::normalize`] scales both
    /// to 1: how Dirichlet, symmetric Dirichlet and ARAP of different targets compare. The other two do not change.
    pub mean_normalized: Option<DistortionMetrics>,
    /// Means as VOLMAP's program forms them: over the volume of the *image*, of values clamped to the range from that
    /// of a rigid motion to [`VOLMAP_BOUND`], in model units.
    pub volmap: Option<DistortionMetrics>,
    /// Determinants of the Jacobians that are finite, in model units. `None` when none is.
    pub determinants: Option<Determinants>,
    /// Fraction of the domain's volume that the means leave out.
    pub left_out_fraction: f64,
    /// Points or tetrahedra whose Jacobian is not finite; left out, also by `determinants`.
    pub not_finite: usize,
    /// Volume of the domain that those represent.
    pub not_finite_volume: f64,
}

/// Determinants of a map's Jacobians, times −1 when the target's volume is negative, so that they are positive where a
/// map that mirrors as a whole is not folded. Quantiles are over the volume of the domain, as in
/// [`super::DensityQuantiles`].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Determinants {
    /// Points or tetrahedra where the map is folded: zero or negative.
    pub negative: usize,
    /// Volume of the domain that those represent.
    pub negative_volume: f64,
    /// Smallest value.
    pub min: f64,
    /// Value that one percent of the volume does not exceed.
    pub p1: f64,
    /// Value that half of the volume does not exceed.
    pub median: f64,
    /// Largest value.
    pub max: f64,
}

impl DistortionMetrics {
    /// The values of a rigid motion: the least of every metric but Dirichlet, whose least is 0.
    pub const RIGID: Self = Self {
        conformal: 1.0,
        dirichlet: 3.0,
        symmetric_dirichlet: 6.0,
        arap: 0.0,
        mips: 1.0,
    };

    /// The metrics of a Jacobian.
    pub fn of_jacobian(jacobian: &Matrix3) -> Self {
        Self::of_stretches(&stretches(jacobian))
    }

    /// The metrics of three principal stretches, as [`stretches`] gives them.
    pub fn of_stretches(stretches: &[f64; 3]) -> Self {
        Self {
            conformal: conformal(stretches),
            dirichlet: dirichlet(stretches),
            symmetric_dirichlet: symmetric_dirichlet(stretches),
            arap: arap(stretches),
            mips: mips(stretches),
        }
    }
}

/// Principal stretches of a Jacobian: its singular values in descending order, the last one negative or 0 when `det J`
/// is. NaN when an entry is not finite.
///
/// Each is exact to rounding relative to itself when the columns of `J` merely differ in length, and relative to the
/// largest otherwise.
///
/// # References
///
/// Hestenes, *Inversion of matrices by biorthogonalization and related results*, J. SIAM 6 (1958): columns are rotated
/// in pairs until they are orthogonal. `JᵀJ`, whose condition is squared, is never formed.
pub fn stretches(jacobian: &Matrix3) -> [f64; 3] {
    let size = jacobian.amax();
    if !jacobian.iter().all(|x| x.is_finite()) {
        return [f64::NAN; 3];
    }
    if size == 0.0 {
        return [0.0; 3];
    }
    // Divided by the largest entry, so that squares and products of three stay in range.
    let scaled = jacobian / size;
    let mut columns = scaled;
    for _ in 0..MAX_SWEEPS {
        if !orthogonalise_columns(&mut columns) {
            break;
        }
    }
    let mut lengths = [0, 1, 2].map(|k| columns.column(k).norm() * size);
    lengths.sort_unstable_by(|a, b| b.total_cmp(a));
    let [first, second, third] = lengths;
    let determinant = scaled.determinant();
    let sign = if determinant == 0.0 { 0.0 } else { determinant.signum() };
    [first, second, sign * third]
}

/// Conformal distortion `(σ₁² + σ₂² + σ₃²) / (3 (σ₁ σ₂ σ₃)^⅔)`: 1 for similarities and more for everything else,
/// whatever the scale; infinite where the map folds.
pub fn conformal([a, b, c]: &[f64; 3]) -> f64 {
    if folded(*c) {
        return f64::INFINITY;
    }
    // By ratios to the middle stretch, so that nothing overflows.
    let (large, small) = (a / b, c / b);
    (large * large + 1.0 + small * small) / (3.0 * (large * small).cbrt().powi(2))
}

/// Dirichlet energy `σ₁² + σ₂² + σ₃²`, the harmonic energy density of [`super::harmonic_density()`]: 3 for rigid
/// motions, and less for maps that shrink. Depends on the scale; finite where the map folds.
pub fn dirichlet([a, b, c]: &[f64; 3]) -> f64 {
    a * a + b * b + c * c
}

/// Symmetric Dirichlet energy `Σ σᵢ² + σᵢ⁻²`: 6 for rigid motions and more for everything else. Depends on the scale;
/// infinite where the map folds.
pub fn symmetric_dirichlet(stretches: &[f64; 3]) -> f64 {
    if folded(stretches[2]) {
        return f64::INFINITY;
    }
    dirichlet(stretches) + dirichlet(&stretches.map(f64::recip))
}

/// As rigid as possible: `Σ (σᵢ − 1)²`, the squared Frobenius distance to the nearest rotation, 0 for rigid motions.
/// Depends on the scale; finite where the map folds, and there, by the sign of `σ₃`, more than its mirror image has.
pub fn arap(stretches: &[f64; 3]) -> f64 {
    stretches.iter().map(|stretch| (stretch - 1.0).powi(2)).sum()
}

/// Most isometric parametrisation, in three dimensions `⅛ (σ₁/σ₂ + σ₂/σ₁) (σ₂/σ₃ + σ₃/σ₂) (σ₃/σ₁ + σ₁/σ₃)`: 1 for
/// similarities and more for everything else, whatever the scale; infinite where the map folds.
pub fn mips([a, b, c]: &[f64; 3]) -> f64 {
    if folded(*c) {
        return f64::INFINITY;
    }
    let pair = |x: f64, y: f64| (x / y + y / x) / 2.0;
    pair(*a, *b) * pair(*b, *c) * pair(*c, *a)
}

/// Distortion of a map at the points of a quadrature.
///
/// The volumes are those of the two solids in model units, as for [`super::energies`]; the target's is negative when
/// the map reflects.
///
/// # Errors
///
/// [`EnergyError::Volume`], [`EnergyError::JacobianCount`].
pub fn distortion(
    map: &dyn VolumeMap,
    quadrature: &Quadrature,
    domain_volume: f64,
    target_volume: f64,
) -> Result<DistortionReport, EnergyError> {
    let scale = UnitVolumeScale::new(domain_volume, target_volume)?.jacobian;
    let orientation = target_volume.signum();
    let mut samples = Vec::with_capacity(quadrature.points().len());
    let weights = quadrature.weights().chunks(CHUNK);
    for (points, weights) in quadrature.points().chunks(CHUNK).zip(weights) {
        add_samples(&mut samples, &map.jacobian(points), weights, orientation)?;
    }
    Ok(report(&samples, scale))
}

/// [`distortion`] of a map whose Jacobians at the points of the quadrature are known already.
///
/// # Errors
///
/// As [`distortion`].
pub fn distortion_of_jacobians(
    jacobians: &[Matrix3],
    quadrature: &Quadrature,
    domain_volume: f64,
    target_volume: f64,
) -> Result<DistortionReport, EnergyError> {
    let scale = UnitVolumeScale::new(domain_volume, target_volume)?.jacobian;
    let orientation = target_volume.signum();
    let mut samples = Vec::with_capacity(jacobians.len());
    add_samples(&mut samples, jacobians, quadrature.weights(), orientation)?;
    Ok(report(&samples, scale))
}

fn add_samples(
    samples: &mut Vec<StretchSample>,
    jacobians: &[Matrix3],
    weights: &[f64],
    orientation: f64,
) -> Result<(), EnergyError> {
    require_count(jacobians.len(), weights.len())?;
    let sample = |(jacobian, &weight)| StretchSample::new(jacobian, weight, orientation);
    samples.par_extend(jacobians.par_iter().zip(weights).map(sample));
    Ok(())
}

/// Distortion of the map that is linear over each tetrahedron of a mesh and carries its vertices to `images`: one
/// Jacobian per tetrahedron, weighted by its absolute volume.
///
/// The volume of the target is that of the images; so a map that mirrors the domain is not folded. Tetrahedra that are
/// flat in the domain have no Jacobian and no volume, and count as not finite.
///
/// # Errors
///
/// [`EnergyError::ImageCount`], and [`EnergyError::Volume`] for meshes without volume or with coordinates that are not
/// finite in the domain.
pub fn tet_distortion(domain: &TetMesh, images: &[Point]) -> Result<DistortionReport, EnergyError> {
    if images.len() != domain.vertices().len() {
        return Err(EnergyError::ImageCount {
            expected: domain.vertices().len(),
            found: images.len(),
        });
    }
    let linear = |tet: &[u32; 4]| {
        let edges = |points: &[Point]| {
            let [a, b, c, d] = tet.map(|v| points[v as usize]);
            Matrix3::from_columns(&[b - a, c - a, d - a])
        };
        let edges_in_domain = edges(domain.vertices());
        let inverse = edges_in_domain.try_inverse().unwrap_or(Matrix3::repeat(f64::NAN));
        (edges(images) * inverse, edges_in_domain.determinant().abs() / 6.0)
    };
    let parts: Vec<(Matrix3, f64)> = domain.tets().par_iter().map(linear).collect();

    let volume = sum(parts.iter().map(|(_, weight)| *weight));
    let signed = parts.iter().map(|(jacobian, weight)| jacobian.determinant() * weight);
    let target_volume = sum(signed.filter(|volume| volume.is_finite()));
    let scale = UnitVolumeScale::new(volume, target_volume)?.jacobian;
    let orientation = target_volume.signum();
    let sample = |(jacobian, weight): &(Matrix3, f64)| StretchSample::new(jacobian, *weight, orientation);
    let samples: Vec<StretchSample> = parts.par_iter().map(sample).collect();
    Ok(report(&samples, scale))
}

/// The stretches, determinant and weight of one Jacobian.
struct StretchSample {
    /// The last one with the sign of `determinant`.
    stretches: [f64; 3],
    /// Times the orientation of the target.
    determinant: f64,
    weight: f64,
}

impl StretchSample {
    fn new(jacobian: &Matrix3, weight: f64, orientation: f64) -> Self {
        let [first, second, third] = stretches(jacobian);
        Self {
            stretches: [first, second, third * orientation],
            determinant: determinant(jacobian) * orientation,
            weight,
        }
    }

    fn is_finite(&self) -> bool {
        self.stretches.iter().all(|stretch| stretch.is_finite())
    }

    fn is_regular(&self) -> bool {
        self.is_finite() && !folded(self.stretches[2])
    }
}

fn folded(smallest_stretch: f64) -> bool {
    smallest_stretch <= 0.0
}

fn report(samples: &[StretchSample], scale: f64) -> DistortionReport {
    let regular = || samples.iter().filter(|sample| sample.is_regular());
    let not_finite = || samples.iter().filter(|sample| !sample.is_finite());
    let left_out = samples.iter().filter(|sample| !sample.is_regular());
    DistortionReport {
        mean: mean(regular().map(|sample| (DistortionMetrics::of_stretches(&sample.stretches), sample.weight))),
        mean_normalized: mean(regular().map(|sample| {
            let scaled = sample.stretches.map(|s| s * scale);
            (DistortionMetrics::of_stretches(&scaled), sample.weight)
        })),
        volmap: mean(regular().map(|sample| {
            let metrics = DistortionMetrics::of_stretches(&sample.stretches);
            (clamped(&metrics), sample.weight * sample.determinant)
        })),
        determinants: determinants(samples),
        left_out_fraction: sum(left_out.map(|sample| sample.weight)) / sum(samples.iter().map(|sample| sample.weight)),
        not_finite: not_finite().count(),
        not_finite_volume: sum(not_finite().map(|sample| sample.weight)),
    }
}

fn mean(values: impl Iterator<Item = (DistortionMetrics, f64)> + Clone) -> Option<DistortionMetrics> {
    let total = sum(values.clone().map(|(_, weight)| weight));
    let mean = |metric: fn(&DistortionMetrics) -> f64| {
        sum(values.clone().map(|(value, weight)| metric(&value) * weight)) / total
    };
    (total > 0.0 && total.is_finite()).then(|| DistortionMetrics {
        conformal: mean(|d| d.conformal),
        dirichlet: mean(|d| d.dirichlet),
        symmetric_dirichlet: mean(|d| d.symmetric_dirichlet),
        arap: mean(|d| d.arap),
        mips: mean(|d| d.mips),
    })
}

fn clamped(value: &DistortionMetrics) -> DistortionMetrics {
    let rigid = DistortionMetrics::RIGID;
    DistortionMetrics {
        conformal: value.conformal.clamp(rigid.conformal, VOLMAP_BOUND),
        dirichlet: value.dirichlet.clamp(rigid.dirichlet, VOLMAP_BOUND),
        symmetric_dirichlet: value.symmetric_dirichlet.clamp(rigid.symmetric_dirichlet, VOLMAP_BOUND),
        arap: value.arap.clamp(rigid.arap, VOLMAP_BOUND),
        mips: value.mips.clamp(rigid.mips, VOLMAP_BOUND),
    }
}

fn determinants(samples: &[StretchSample]) -> Option<Determinants> {
    let finite = samples.iter().filter(|sample| sample.is_finite());
    let folded = finite.clone().filter(|sample| !sample.is_regular());
    let (values, weights): (Vec<f64>, Vec<f64>) = finite.map(|sample| (sample.determinant, sample.weight)).unzip();
    let [min, p1, median, max] = weighted_quantiles(&values, &weights, [0.0, 0.01, 0.5, 1.0])?;
    Some(Determinants {
        negative: folded.clone().count(),
        negative_volume: sum(folded.map(|sample| sample.weight)),
        min,
        p1,
        median,
        max,
    })
}

/// Rotates each pair of columns in turn until they are orthogonal; returns whether any pair was not, up to rounding.
fn orthogonalise_columns(columns: &mut Matrix3) -> bool {
    let mut rotated = false;
    for (p, q) in [(0, 1), (0, 2), (1, 2)] {
        let (first, second) = (columns.column(p).into_owned(), columns.column(q).into_owned());
        let (dot, product) = (first.dot(&second), first.norm() * second.norm());
        if dot.abs() <= f64::EPSILON * product {
            continue;
        }
        rotated = true;
        let cotangent = (second.norm_squared() - first.norm_squared()) / (2.0 * dot);
        let tangent = 1f64.copysign(cotangent) / (cotangent.abs() + cotangent.hypot(1.0));
        let cosine = tangent.hypot(1.0).recip();
        let sine = cosine * tangent;
        columns.set_column(p, &(first * cosine - second * sine));
        columns.set_column(q, &(first * sine + second * cosine));
    }
    rotated
}

#[cfg(test)]
mod tests;
