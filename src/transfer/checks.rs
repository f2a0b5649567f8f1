//! How a map changes volumes, and the distribution of a field's values over them.

use std::collections::BTreeMap;

use crate::energy::Quadrature;
use crate::map::VolumeMap;
use crate::statistics::weighted_quantiles;

/// The volume that the map gives the domain, against that of the target.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct VolumeCheck {
    /// Volume of the domain.
    pub domain: f64,
    /// Volume of the target.
    pub target: f64,
    /// `|∫ det J dV|` over the domain: the volume of its image, in which folded parts count negative.
    pub carried: f64,
    /// `carried / target − 1`.
    pub relative_error: f64,
    /// Fraction of the domain's volume where the map has the opposite orientation to the whole.
    pub folded_share: f64,
    /// Points of the quadrature without a finite Jacobian, which `carried` and `folded_share` leave out.
    pub not_finite: usize,
}

/// How much of each solid has a label.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LabelShare {
    /// The label.
    pub label: f64,
    /// Fraction of the domain's volume.
    pub before: f64,
    /// Fraction of the volume of the image.
    pub after: f64,
}

/// How the values of a field are distributed over a volume.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ValueDistribution {
    /// Mean over the volume.
    pub mean: f64,
    /// The values below which 5, 25, 50, 75 and 95 % of the volume lie.
    pub quantiles: [f64; 5],
}

/// The distribution of a field over the domain, and over the target when every volume element keeps its value.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DistributionCheck {
    /// Over the domain's volume.
    pub before: ValueDistribution,
    /// Over the volume of the image: weighted by `|det J|`.
    pub after: ValueDistribution,
    /// Largest difference between the two cumulative distributions (Kolmogorov–Smirnov), from 0 to 1: 0 for a
    /// volume-preserving map.
    pub largest_shift: f64,
}

/// Integrates `det J` over the domain. Also returns the weights of the quadrature's points in the target, `w |det J|`,
/// which are 0 where the Jacobian is not finite.
pub fn volume_check(map: &dyn VolumeMap, quadrature: &Quadrature, target_volume: f64) -> (VolumeCheck, Vec<f64>) {
    let jacobians = map.jacobian(quadrature.points());
    let det: Vec<f64> = jacobians.iter().map(|j| j.determinant()).collect();
    let not_finite = det.iter().filter(|d| !d.is_finite()).count();
    let or_zero = |d: f64| if d.is_finite() { d } else { 0.0 };
    let whole = quadrature.integrate(&det.iter().map(|&d| or_zero(d)).collect::<Vec<_>>());
    let is_folded = |d: &f64| d.is_finite() && d * whole <= 0.0;
    let folded = det.iter().map(|d| if is_folded(d) { 1.0 } else { 0.0 });
    let (domain, target) = (quadrature.volume(), target_volume.abs());
    let check = VolumeCheck {
        domain,
        target,
        carried: whole.abs(),
        relative_error: whole.abs() / target - 1.0,
        folded_share: quadrature.integrate(&folded.collect::<Vec<_>>()) / domain,
        not_finite,
    };
    let weights = quadrature.weights().iter().zip(&det);
    (check, weights.map(|(w, &d)| w * or_zero(d).abs()).collect())
}

/// The fraction of each label, in ascending order, from the labels at points that represent the volumes `before` in the
/// domain and `after` in the image. NaN is no label.
///
/// # Panics
///
/// When the slices differ in length.
pub fn label_shares(labels: &[f64], before: &[f64], after: &[f64]) -> Vec<LabelShare> {
    assert!(
        labels.len() == before.len() && labels.len() == after.len(),
        "one volume per label"
    );
    let mut volumes: BTreeMap<u64, (f64, [f64; 2])> = BTreeMap::new();
    for ((&label, &before), &after) in labels.iter().zip(before).zip(after) {
        if !label.is_nan() {
            // -0 and 0 are one label.
            let label = label + 0.0;
            let entry = volumes.entry(ascending(label)).or_insert((label, [0.0; 2]));
            entry.1[0] += before;
            entry.1[1] += after;
        }
    }
    let total: [f64; 2] = std::array::from_fn(|k| volumes.values().map(|(_, v)| v[k]).sum());
    let share = |(label, volume): (f64, [f64; 2])| LabelShare {
        label,
        before: volume[0] / total[0],
        after: volume[1] / total[1],
    };
    volumes.into_values().map(share).collect()
}

/// An integer that sorts like the floating-point number.
fn ascending(x: f64) -> u64 {
    let bits = x.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// Compares the distributions of values at points over the volumes `before` and `after` that the points represent.
/// `None` without finite values that have volume.
///
/// # Panics
///
/// When the slices differ in length.
pub fn distribution_check(values: &[f64], before: &[f64], after: &[f64]) -> Option<DistributionCheck> {
    assert!(
        values.len() == before.len() && values.len() == after.len(),
        "one volume per value"
    );
    let mut order: Vec<usize> = (0..values.len()).filter(|&i| values[i].is_finite()).collect();
    order.sort_unstable_by(|&a, &b| values[a].total_cmp(&values[b]).then(a.cmp(&b)));
    let pick = |all: &[f64]| order.iter().map(|&i| all[i]).collect::<Vec<f64>>();
    let (values, before, after) = (pick(values), pick(before), pick(after));
    let total = [&before, &after].map(|weights| weights.iter().sum::<f64>());
    let mut below = [0.0; 2];
    let mut largest_shift: f64 = 0.0;
    for i in 0..values.len() {
        below = [below[0] + before[i], below[1] + after[i]];
        // The distribution functions jump after the last of several equal values.
        if values.get(i + 1) != Some(&values[i]) {
            largest_shift = largest_shift.max((below[0] / total[0] - below[1] / total[1]).abs());
        }
    }
    Some(DistributionCheck {
        before: distribution(&values, &before)?,
        after: distribution(&values, &after)?,
        largest_shift,
    })
}

fn distribution(values: &[f64], weights: &[f64]) -> Option<ValueDistribution> {
    let quantiles = weighted_quantiles(values, weights, [0.05, 0.25, 0.5, 0.75, 0.95])?;
    let sum: f64 = values.iter().zip(weights).map(|(value, weight)| value * weight).sum();
    Some(ValueDistribution {
        mean: sum / weights.iter().sum::<f64>(),
        quantiles,
    })
}
