//! How far a map is from preserving angles, lengths and volumes: the five metrics of Cherchi & Livesu, *VOLMAP: a large
//! scale benchmark for volume mappings to simple base domains*, Computer Graphics Forum 42 (2023), with the
//! normalisation of the program published there.
//!
//! All are functions of the principal stretches `σ₁ ≥ σ₂ ≥ |σ₃|`, the singular values of the Jacobian, of which the
//! smallest carries the sign of the determinant.

use rayon::prelude::*;

use super::{CHUNK, EnergyError, Quadrature, quadrature::sum, require_count};
use crate::statistics::weighted_quantiles;
use crate::{Matrix3, Point, map::VolumeMap, mesh::TetMesh};

/// Values above this count as this much in [`DistortionReport::volmap`].
pub const VOLMAP_BOUND: f64 = 100.0;

/// Sweeps over the three pairs of columns: far more than needed, because convergence is quadratic.
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
/// target's volume. Three of the metrics are infinite elsewhere, and VOLMAP too leaves folded elements out; how much
/// that is stands beside the means, and they are to be read together.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DistortionReport {
    /// Means over the volume of the domain, of the map as it is. `None` when the map is regular nowhere.
    pub mean: Option<DistortionMetrics>,
    /// The same with the target scaled to the volume of the domain, as [`super::EnergyOptions::normalize`] scales both
    /// to 1: how Dirichlet, symmetric Dirichlet and ARAP of different targets compare. The other two do not change.
    pub mean_normalized: Option<DistortionMetrics>,
    /// Means as VOLMAP's program forms them: over the volume of the *image*, of values clamped to between the value of
    /// a rigid motion and [`VOLMAP_BOUND`], of the map as it is.
    pub volmap: Option<DistortionMetrics>,
    /// Determinants of the Jacobians that are finite, in model units. `None` when none is.
    pub determinants: Option<Determinants>,
    /// Share of the domain's volume that the means leave out.
    pub left_out_fraction: f64,
    /// Points or tetrahedra whose Jacobian is not finite; left out, also by `determinants`.
    pub not_finite: usize,
    /// Volume of the domain that those stand for.
    pub not_finite_volume: f64,
}

/// Determinants of a map's Jacobians, times −1 when the target's volume is negative, so that they are positive where a
/// map that mirrors as a whole is not folded. Quantiles count volume of the domain, as [`super::DensityQuantiles`] does.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Determinants {
    /// Points or tetrahedra where the map is folded: zero or negative.
    pub negative: usize,
    /// Volume of the domain that those stand for.
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
    /// What a rigid motion has: the least value of every metric but Dirichlet, whose least is 0.
    pub const RIGID: Self = Self {
        conformal: 1.0,
        dirichlet: 3.0,
        symmetric_dirichlet: 6.0,
        arap: 0.0,
        mips: 1.0,
    };

    /// The metrics of a Jacobian.
    pub fn density(jacobian: &Matrix3) -> Self {
        Self::of(&stretches(jacobian))
    }

    /// The metrics of three principal stretches, as [`stretches`] gives them.
    pub fn of(stretches: &[f64; 3]) -> Self {
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
    // Divided by the largest entry: squares and products of three then stay in range.
    let scaled = jacobian / size;
    let mut columns = scaled;
    for _ in 0..MAX_SWEEPS {
        if !orthogonalize_columns(&mut columns) {
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
    // By ratios to the middle stretch, so that the scale cannot leave the range.
    let (large, small) = (a / b, c / b);
    (large * large + 1.0 + small * small) / (3.0 * (large * small).cbrt().powi(2))
}

/// Dirichlet energy `σ₁² + σ₂² + σ₃²`, the harmonic energy density of [`super::harmonic`]: 3 for rigid motions, and less
/// for maps that shrink. Depends on the scale; finite where the map folds.
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
    let scale = Scale::new(domain_volume, target_volume)?;
    let mut samples = Vec::with_capacity(quadrature.points().len());
    for (points, weights) in quadrature
        .points()
        .chunks(CHUNK)
        .zip(quadrature.weights().chunks(CHUNK))
    {
        add_samples(&mut samples, &map.jacobian(points), weights, &scale)?;
    }
    Ok(report(&samples, scale.stretch))
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
    let scale = Scale::new(domain_volume, target_volume)?;
    let mut samples = Vec::with_capacity(jacobians.len());
    add_samples(&mut samples, jacobians, quadrature.weights(), &scale)?;
    Ok(report(&samples, scale.stretch))
}

fn add_samples(
    samples: &mut Vec<StretchSample>,
    jacobians: &[Matrix3],
    weights: &[f64],
    scale: &Scale,
) -> Result<(), EnergyError> {
    require_count(jacobians.len(), weights.len())?;
    let sample = |(jacobian, &weight)| StretchSample::new(jacobian, weight, scale);
    samples.par_extend(jacobians.par_iter().zip(weights).map(sample));
    Ok(())
}

/// Distortion of the map that is linear over each tetrahedron of a mesh and carries its vertices to `images`: one
/// Jacobian a tetrahedron, weighted by its volume without regard to its hand.
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
    let scale = Scale::new(volume, sum(signed.filter(|volume| volume.is_finite())))?;
    let sample = |(jacobian, weight): &(Matrix3, f64)| StretchSample::new(jacobian, *weight, &scale);
    let samples: Vec<StretchSample> = parts.par_iter().map(sample).collect();
    Ok(report(&samples, scale.stretch))
}

/// How sizes and orientations of the two solids compare.
struct Scale {
    /// Factor that brings the target to the volume of the domain.
    stretch: f64,
    /// −1 when the map mirrors as a whole.
    orientation: f64,
}

impl Scale {
    fn new(domain_volume: f64, target_volume: f64) -> Result<Self, EnergyError> {
        let unusable = |volume: f64| !(volume > 0.0 && volume.is_finite());
        if unusable(domain_volume) {
            let (solid, volume) = ("domain", domain_volume);
            return Err(EnergyError::Volume { solid, volume });
        }
        if unusable(target_volume.abs()) {
            let (solid, volume) = ("target", target_volume);
            return Err(EnergyError::Volume { solid, volume });
        }
        Ok(Self {
            stretch: (domain_volume / target_volume.abs()).cbrt(),
            orientation: target_volume.signum(),
        })
    }
}

/// What is kept of one Jacobian.
struct StretchSample {
    /// With the sign of `determinant` on the last.
    stretches: [f64; 3],
    /// Times the orientation of the target.
    determinant: f64,
    weight: f64,
}

impl StretchSample {
    fn new(jacobian: &Matrix3, weight: f64, scale: &Scale) -> Self {
        let [first, second, third] = stretches(jacobian);
        Self {
            stretches: [first, second, third * scale.orientation],
            determinant: jacobian.determinant() * scale.orientation,
            weight,
        }
    }

    fn is_finite(&self) -> bool {
        self.stretches[0].is_finite() && self.determinant.is_finite()
    }

    fn is_regular(&self) -> bool {
        self.is_finite() && !folded(self.stretches[2])
    }
}

fn folded(smallest_stretch: f64) -> bool {
    smallest_stretch <= 0.0
}

fn report(samples: &[StretchSample], stretch: f64) -> DistortionReport {
    let regular = || samples.iter().filter(|sample| sample.is_regular());
    let not_finite = || samples.iter().filter(|sample| !sample.is_finite());
    let left_out = samples.iter().filter(|sample| !sample.is_regular());
    DistortionReport {
        mean: mean(regular().map(|sample| (DistortionMetrics::of(&sample.stretches), sample.weight))),
        mean_normalized: mean(regular().map(|sample| {
            let scaled = sample.stretches.map(|s| s * stretch);
            (DistortionMetrics::of(&scaled), sample.weight)
        })),
        volmap: mean(regular().map(|sample| {
            let image_volume = sample.weight * sample.determinant;
            (clamped(&DistortionMetrics::of(&sample.stretches)), image_volume)
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
    (total > 0.0).then(|| DistortionMetrics {
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

/// Rotates each pair of columns to a right angle, in turn; whether any was not at one, to rounding.
fn orthogonalize_columns(columns: &mut Matrix3) -> bool {
    let mut turned = false;
    for (p, q) in [(0, 1), (0, 2), (1, 2)] {
        let (first, second) = (columns.column(p).into_owned(), columns.column(q).into_owned());
        let (dot, product) = (first.dot(&second), first.norm() * second.norm());
        if dot.abs() <= f64::EPSILON * product {
            continue;
        }
        turned = true;
        let cotangent = (second.norm_squared() - first.norm_squared()) / (2.0 * dot);
        let tangent = 1f64.copysign(cotangent) / (cotangent.abs() + cotangent.hypot(1.0));
        let cosine = tangent.hypot(1.0).recip();
        let sine = cosine * tangent;
        columns.set_column(p, &(first * cosine - second * sine));
        columns.set_column(q, &(first * sine + second * cosine));
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Vector, energy::tet_quadrature};
    use rand::{Rng, SeedableRng, rngs::StdRng};

    fn diagonal(a: f64, b: f64, c: f64) -> Matrix3 {
        Matrix3::from_diagonal(&Vector::new(a, b, c))
    }

    fn rotation(random: &mut StdRng) -> Matrix3 {
        let axis = Vector::from_fn(|_, _| random.random_range(-3.0..3.0));
        nalgebra::Rotation3::new(axis).into_inner()
    }

    fn fields(d: &DistortionMetrics) -> [f64; 5] {
        [d.conformal, d.dirichlet, d.symmetric_dirichlet, d.arap, d.mips]
    }

    #[track_caller]
    fn assert_close(found: &DistortionMetrics, expected: [f64; 5], tolerance: f64) {
        for (x, y) in fields(found).iter().zip(expected) {
            assert!((x - y).abs() <= tolerance * (1.0 + y.abs()), "{found:?} {expected:?}");
        }
    }

    /// The cube [0, 1]³ as six tetrahedra about its diagonal, of both hands.
    fn cube() -> TetMesh {
        let corner = |n: usize| [n & 1, n >> 1 & 1, n >> 2 & 1].map(|bit| bit as f64);
        let vertices = (0..8).map(|n| Point::from(corner(n))).collect();
        let orders = [[1, 2], [1, 4], [2, 1], [2, 4], [4, 1], [4, 2]];
        TetMesh::new(vertices, orders.map(|[a, b]: [u32; 2]| [0, a, a + b, 7]).to_vec()).unwrap()
    }

    fn carried(mesh: &TetMesh, map: impl Fn(&Point) -> Point) -> Vec<Point> {
        mesh.vertices().iter().map(map).collect()
    }

    /// A map given by its Jacobian alone.
    struct Jacobians<J>(J);

    impl<J: Fn(&Point) -> Matrix3 + Sync> VolumeMap for Jacobians<J> {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            points.to_vec()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            points.iter().map(&self.0).collect()
        }
    }

    #[test]
    fn rigid_motions_have_the_ideal_values() {
        assert_eq!(
            DistortionMetrics::density(&Matrix3::identity()),
            DistortionMetrics::RIGID
        );
        let mut random = StdRng::seed_from_u64(1);
        for _ in 0..100 {
            let found = DistortionMetrics::density(&rotation(&mut random));
            assert_close(&found, fields(&DistortionMetrics::RIGID), 1e-14);
        }
    }

    #[test]
    fn uniform_scale_has_its_closed_form() {
        for s in [0.25_f64, 2.0, 3.0] {
            let expected = [
                1.0,
                3.0 * s * s,
                3.0 * (s * s + 1.0 / (s * s)),
                3.0 * (s - 1.0).powi(2),
                1.0,
            ];
            assert_close(
                &DistortionMetrics::density(&Matrix3::from_diagonal_element(s)),
                expected,
                1e-15,
            );
        }
    }

    #[test]
    fn stretch_along_an_axis_has_its_closed_form() {
        // σ = 2, 1, 1: (4 + 1 + 1) / (3 · 2^⅔); 6; 6 + 2¼; 1; ⅛ · 2½ · 2 · 2½.
        let expected = [2.0 / 4f64.cbrt(), 6.0, 8.25, 1.0, 1.5625];
        for jacobian in [
            diagonal(2.0, 1.0, 1.0),
            diagonal(1.0, 1.0, 2.0),
            diagonal(1.0, -2.0, -1.0),
        ] {
            assert_close(&DistortionMetrics::density(&jacobian), expected, 1e-15);
        }
    }

    #[test]
    fn simple_shear_has_its_closed_form() {
        // I + g e₁e₂ᵀ has det 1 and σ₁, 1, 1/σ₁ with σ₁ + 1/σ₁ = √(4 + g²): for g = 3/2 it is 5/2, and σ₁ is 2.
        let mut shear = Matrix3::identity();
        shear[(0, 1)] = 1.5;
        assert_close(
            &DistortionMetrics::of(&stretches(&shear)),
            [5.25 / 3.0, 5.25, 10.5, 1.25, 2.5 * 2.5 * 4.25 / 8.0],
            1e-14,
        );
    }

    #[test]
    fn rotations_before_or_after_change_nothing() {
        let mut random = StdRng::seed_from_u64(2);
        for _ in 0..200 {
            let jacobian = Matrix3::from_fn(|_, _| random.random_range(-1.0..1.0));
            let turned = rotation(&mut random) * jacobian * rotation(&mut random);
            let (here, there) = (stretches(&jacobian), stretches(&turned));
            for k in 0..3 {
                assert!((here[k] - there[k]).abs() < 1e-14, "{here:?} {there:?}");
            }
        }
    }

    #[test]
    fn stretches_recover_singular_values_down_to_rounding() {
        let mut random = StdRng::seed_from_u64(3);
        for exponents in [
            [0, 0, 0],
            [0, -1, -2],
            [0, -5, -10],
            [0, 0, -15],
            [0, -15, -15],
            [0, -16, -30],
        ] {
            for scale in [1e-200, 1.0, 1e200] {
                let expected = exponents.map(|e| scale * 10f64.powi(e));
                let [a, b, c] = expected;
                for _ in 0..20 {
                    let (left, right) = (rotation(&mut random), rotation(&mut random));
                    let found = stretches(&(left * diagonal(a, b, c) * right));
                    // Products with rotations move each singular value by a few ulp of the largest.
                    for k in 0..3 {
                        assert!(
                            (found[k].abs() - expected[k]).abs() < 4e-15 * a,
                            "{found:?} {expected:?}"
                        );
                    }
                    // Columns of different lengths, at right angles to rounding, lose nothing.
                    let found = stretches(&(left * diagonal(b, c, a)));
                    for k in 0..3 {
                        assert!(
                            (found[k].abs() / expected[k] - 1.0).abs() < 4e-15,
                            "{found:?} {expected:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_smallest_stretch_has_the_sign_of_the_determinant() {
        let mut random = StdRng::seed_from_u64(4);
        for _ in 0..200 {
            let jacobian = Matrix3::from_fn(|_, _| random.random_range(-1.0..1.0));
            let found = stretches(&jacobian);
            assert!(found[0] >= found[1] && found[1] >= found[2].abs());
            let product: f64 = found.iter().product();
            assert!((product - jacobian.determinant()).abs() < 1e-14);
        }
        assert_eq!(stretches(&diagonal(3.0, 0.0, -4.0)), [4.0, 3.0, 0.0]);
        assert_eq!(stretches(&Matrix3::zeros()), [0.0; 3]);
        assert!(stretches(&diagonal(1.0, f64::NAN, 1.0))[0].is_nan());
        assert!(stretches(&diagonal(1.0, f64::INFINITY, 1.0))[2].is_nan());
    }

    #[test]
    fn conformal_and_mips_are_least_at_similarities_and_nowhere_else() {
        let mut random = StdRng::seed_from_u64(5);
        for scale in [1e-180, 1e-3, 1.0, 40.0, 1e180] {
            let similarity = DistortionMetrics::density(&(rotation(&mut random) * scale));
            assert!((similarity.conformal - 1.0).abs() < 1e-14 && (similarity.mips - 1.0).abs() < 1e-14);
            for _ in 0..50 {
                // Stretches 1, 1 + x, 1 + y raise both by at least (x² + y² − x y) / 3 to leading order, which is at
                // least a quarter of the square of the larger.
                let stretches = [
                    scale,
                    scale * random.random_range(0.9..0.99),
                    scale * random.random_range(0.8..0.9),
                ];
                let [a, b, c] = stretches;
                let other =
                    DistortionMetrics::density(&(rotation(&mut random) * diagonal(a, b, c) * rotation(&mut random)));
                assert!(other.conformal > 1.0 + 1e-3 && other.mips > 1.0 + 1e-3, "{other:?}");
            }
        }
    }

    #[test]
    fn flip_preventing_metrics_blow_up_towards_the_fold_and_are_infinite_beyond() {
        let mut last = DistortionMetrics::RIGID;
        for exponent in 1..12 {
            let jacobian = diagonal(1.0, 1.0, 10f64.powi(-exponent));
            let next = DistortionMetrics::density(&jacobian);
            assert!(next.conformal > 2.0 * last.conformal);
            assert!(next.symmetric_dirichlet > 10.0 * last.symmetric_dirichlet);
            assert!(next.mips > 10.0 * last.mips);
            last = next;
        }
        for smallest in [0.0_f64, -1e-9, -1.0] {
            let beyond = DistortionMetrics::density(&diagonal(1.0, 1.0, smallest));
            assert!(
                [beyond.conformal, beyond.symmetric_dirichlet, beyond.mips]
                    .iter()
                    .all(|x| x.is_infinite())
            );
            assert_eq!(beyond.dirichlet, 2.0 + smallest * smallest);
            assert_eq!(beyond.arap, (smallest - 1.0).powi(2));
        }
    }

    #[test]
    fn affine_maps_have_the_density_of_their_matrix_over_points_and_over_tets() {
        let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        let mesh = cube();
        let volume = matrix.determinant();
        let scaled = matrix * volume.cbrt().recip();
        let over_points = distortion(
            &Jacobians(|_: &Point| matrix),
            &tet_quadrature(&mesh).unwrap(),
            1.0,
            volume,
        );
        let over_tets = tet_distortion(&mesh, &carried(&mesh, |p| Point::from(matrix * p.coords)));
        for report in [over_points.unwrap(), over_tets.unwrap()] {
            assert_close(
                &report.mean.unwrap(),
                fields(&DistortionMetrics::density(&matrix)),
                1e-13,
            );
            assert_close(
                &report.mean_normalized.unwrap(),
                fields(&DistortionMetrics::density(&scaled)),
                1e-13,
            );
            let determinants = report.determinants.unwrap();
            assert!((determinants.p1 / volume - 1.0).abs() < 1e-14 && determinants.negative == 0);
            assert_eq!((report.left_out_fraction, report.not_finite), (0.0, 0));
        }
    }

    #[test]
    fn means_weigh_by_volume_of_the_domain_and_volmap_by_that_of_the_image() {
        // Two boxes of volume 3 and 1, stretched by 2 along x and left alone.
        let mut mesh = cube();
        let stretched = carried(&mesh, |p| Point::new(3.0 * p.x, p.y, p.z));
        let moved = carried(&mesh, |p| p + Vector::new(9.0, 0.0, 0.0));
        let tets = mesh.tets().iter().flat_map(|t| [*t, t.map(|v| v + 8)]).collect();
        mesh = TetMesh::new([stretched, moved].concat(), tets).unwrap();
        let images = carried(&mesh, |p| {
            if p.x <= 3.0 {
                Point::new(2.0 * p.x, p.y, p.z)
            } else {
                *p
            }
        });
        let report = tet_distortion(&mesh, &images).unwrap();
        // Symmetric Dirichlet 8.25 and 6, MIPS 1.5625 and 1; volumes 3 : 1 in the domain and 6 : 1 in the image.
        let (mean, volmap) = (report.mean.unwrap(), report.volmap.unwrap());
        assert!((mean.symmetric_dirichlet - (3.0 * 8.25 + 6.0) / 4.0).abs() < 1e-13);
        assert!((mean.mips - (3.0 * 1.5625 + 1.0) / 4.0).abs() < 1e-13);
        assert!((volmap.symmetric_dirichlet - (6.0 * 8.25 + 6.0) / 7.0).abs() < 1e-13);
        assert!((volmap.mips - (6.0 * 1.5625 + 1.0) / 7.0).abs() < 1e-13);
        let determinants = report.determinants.unwrap();
        assert!((determinants.median - 2.0).abs() < 1e-14 && (determinants.p1 - 1.0).abs() < 1e-14);
    }

    #[test]
    fn volmap_clamps_and_the_plain_mean_does_not() {
        let mesh = cube();
        let report = tet_distortion(&mesh, &carried(&mesh, |p| Point::new(p.x / 50.0, p.y / 2.0, p.z / 2.0))).unwrap();
        let (mean, volmap) = (report.mean.unwrap(), report.volmap.unwrap());
        assert!((mean.symmetric_dirichlet - (2508.0 + 0.5004)).abs() < 1e-9);
        assert!((volmap.symmetric_dirichlet / VOLMAP_BOUND - 1.0).abs() < 1e-14);
        assert!((volmap.dirichlet / 3.0 - 1.0).abs() < 1e-14);
        assert!((mean.dirichlet - 0.5004).abs() < 1e-14);
    }

    #[test]
    fn scaling_the_target_changes_all_but_what_is_normalised() {
        let mesh = cube();
        let map = |p: &Point| Point::new(p.x + 0.3 * p.y * p.z, 1.4 * p.y, p.z - 0.2 * p.x * p.y);
        let here = tet_distortion(&mesh, &carried(&mesh, map)).unwrap();
        let there = tet_distortion(&mesh, &carried(&mesh, |p| map(p) * 1000.0)).unwrap();
        let (a, b) = (here.mean.unwrap(), there.mean.unwrap());
        assert!((b.dirichlet / a.dirichlet / 1e6 - 1.0).abs() < 1e-13);
        assert!((b.mips / a.mips - 1.0).abs() < 1e-12);
        assert_close(
            &there.mean_normalized.unwrap(),
            fields(&here.mean_normalized.unwrap()),
            1e-12,
        );
    }

    #[test]
    fn a_map_that_mirrors_as_a_whole_is_not_folded() {
        let mesh = cube();
        let report = tet_distortion(&mesh, &carried(&mesh, |p| Point::new(p.x, -2.0 * p.y, p.z))).unwrap();
        assert_close(
            &report.mean.unwrap(),
            [2.0 / 4f64.cbrt(), 6.0, 8.25, 1.0, 1.5625],
            1e-14,
        );
        assert_eq!(
            (report.left_out_fraction, report.determinants.unwrap().median),
            (0.0, 2.0)
        );
    }

    #[test]
    fn folds_and_broken_jacobians_are_left_out_and_counted() {
        let mesh = cube();
        let rule = tet_quadrature(&mesh).unwrap();
        let (below, above) = (0.3, 0.8);
        let of_height = |z: f64| match z {
            z if z < below => diagonal(1.0, 1.0, -3.0),
            z if z > above => diagonal(1.0, f64::NAN, 1.0),
            _ => Matrix3::identity(),
        };
        let report = distortion(&Jacobians(|p: &Point| of_height(p.z)), &rule, 1.0, 1.0).unwrap();
        let share = |keep: &dyn Fn(f64) -> bool| {
            let kept = rule.points().iter().zip(rule.weights()).filter(|(p, _)| keep(p.z));
            kept.fold((0, 0.0), |(count, volume), (_, weight)| (count + 1, volume + weight))
        };
        let (folded, broken) = (share(&|z| z < below), share(&|z| z > above));
        assert!(folded.0 > 0 && broken.0 > 0);
        assert_close(&report.mean.unwrap(), fields(&DistortionMetrics::RIGID), 1e-15);
        let determinants = report.determinants.unwrap();
        assert_eq!((determinants.negative, report.not_finite), (folded.0, broken.0));
        assert!((determinants.negative_volume - folded.1).abs() < 1e-15);
        assert!((report.not_finite_volume - broken.1).abs() < 1e-15);
        assert!((report.left_out_fraction - folded.1 - broken.1).abs() < 1e-15);
        assert_eq!((determinants.min, determinants.max), (-3.0, 1.0));

        let nowhere = distortion(&Jacobians(|_: &Point| Matrix3::repeat(f64::NAN)), &rule, 1.0, 1.0).unwrap();
        assert_eq!((nowhere.mean, nowhere.volmap, nowhere.determinants), (None, None, None));
        assert_eq!(
            (nowhere.not_finite, nowhere.left_out_fraction),
            (rule.points().len(), 1.0)
        );
    }

    #[test]
    fn flat_tets_of_the_domain_are_counted_and_weigh_nothing() {
        let mesh = cube();
        let mut tets = mesh.tets().to_vec();
        tets.push([0, 1, 2, 3]);
        let mesh = TetMesh::new(mesh.vertices().to_vec(), tets).unwrap();
        let report = tet_distortion(&mesh, mesh.vertices()).unwrap();
        assert_close(&report.mean.unwrap(), fields(&DistortionMetrics::RIGID), 1e-15);
        assert_eq!(
            (report.not_finite, report.not_finite_volume, report.left_out_fraction),
            (1, 0.0, 0.0)
        );
    }

    #[test]
    fn names_what_stops_it() {
        let mesh = cube();
        let count = EnergyError::ImageCount { expected: 8, found: 7 };
        assert_eq!(tet_distortion(&mesh, &mesh.vertices()[1..]), Err(count));
        let flat = tet_distortion(&mesh, &[Point::origin(); 8]);
        assert!(matches!(flat, Err(EnergyError::Volume { solid: "target", .. })));
        let empty = TetMesh::new(vec![], vec![]).unwrap();
        assert!(matches!(
            tet_distortion(&empty, &[]),
            Err(EnergyError::Volume { solid: "domain", .. })
        ));
        let rule = tet_quadrature(&mesh).unwrap();
        let identity = Jacobians(|_: &Point| Matrix3::identity());
        let broken = distortion(&identity, &rule, f64::NAN, 1.0);
        assert!(matches!(broken, Err(EnergyError::Volume { solid: "domain", .. })));
    }

    #[test]
    fn a_published_map_with_flipped_and_flat_tets_has_finite_means() {
        let Ok(folder) = std::env::var("SOLIDMAP_MODELS") else {
            eprintln!("SKIPPED: no published map is tested; set SOLIDMAP_MODELS to the folder of models");
            return;
        };
        let read = |name: &str| crate::io::read_tets(std::path::Path::new(&folder).join("maps").join(name)).unwrap();
        let (object, cube) = (read("max_planck_object.mesh"), read("max_planck_cube.mesh"));
        let report = tet_distortion(&object, cube.vertices()).unwrap();
        let flipped = crate::geometry::flipped_tets(&object, cube.vertices()).unwrap();
        // Jacobians are rounded, so that an exactly flat image may have either sign here.
        let folded = report.determinants.unwrap().negative;
        assert!((flipped.negative..=flipped.count()).contains(&folded), "{folded}");
        assert_eq!(report.not_finite, 0);
        assert!(report.left_out_fraction > 0.0 && report.left_out_fraction < 0.05);
        for values in [report.mean, report.mean_normalized, report.volmap] {
            let values = values.unwrap();
            assert!(fields(&values).iter().all(|x| x.is_finite()), "{values:?}");
            assert!(values.conformal > 1.0 && values.mips > values.conformal);
        }
    }
}
