use super::number::{ten_to_the, typeset};

/// Positions and labels of the marks on an axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Ticks {
    pub(super) positions: Vec<f64>,
    pub(super) labels: Vec<String>,
    /// A power of ten that multiplies all labels, to be written once: `×10⁻⁴`.
    pub(super) factor: Option<String>,
}

impl Ticks {
    /// The name of an axis with the factor of its labels.
    pub(super) fn named(&self, name: &str) -> String {
        match &self.factor {
            Some(factor) => format!("{name} ({factor})"),
            None => name.to_owned(),
        }
    }
}

/// At most about `count` round positions in `[low, high]`, in steps of 1, 2 or 5 times a power of ten; none when the
/// interval is empty or not finite.
pub(super) fn linear_ticks(low: f64, high: f64, count: usize) -> Ticks {
    let Some((step, step_exponent)) = round_step((high - low) / count.max(1) as f64) else {
        return Ticks::default();
    };
    // The ends count when they are multiples of the step up to rounding errors.
    let (first, last) = ((low / step - 1e-6).ceil(), (high / step + 1e-6).floor());
    let steps = (0..2 * count.max(1) + 2)
        .map(|k| first + k as f64)
        .take_while(|k| *k <= last);
    let positions: Vec<f64> = steps.map(|k| k * step + 0.0).collect();

    let largest = positions.iter().fold(0f64, |a, x| a.max(x.abs()));
    let exponent = if largest > 0.0 {
        largest.log10().floor() as i32
    } else {
        0
    };
    let shift = if (-3..5).contains(&exponent) { 0 } else { exponent };
    let decimals = (shift - step_exponent).clamp(0, 12) as usize;
    let label = |x: &f64| format!("{:.decimals$}", x / 10f64.powi(shift) + 0.0).replace('-', "−");
    Ticks {
        labels: positions.iter().map(label).collect(),
        positions,
        factor: (shift != 0).then(|| format!("×{}", ten_to_the(shift))),
    }
}

/// Round positions for a logarithmic axis from `low > 0` to `high`: powers of ten; with 2 and 5 times them when there
/// are fewer than three; those of a linear axis when there are still fewer than three.
pub(super) fn logarithmic_ticks(low: f64, high: f64, count: usize) -> Ticks {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let within = |x: &f64| *x >= low * (1.0 - 1e-9) && *x <= high * (1.0 + 1e-9);
    let decades = (last - first).max(1) as usize;
    let stride = decades.div_ceil(count.max(1));
    let mut positions: Vec<f64> = (first..=last)
        .filter(|e| e.rem_euclid(stride as i32) == 0)
        .map(|e| 10f64.powi(e))
        .filter(within)
        .collect();
    let powers = positions.len();
    if powers < 3 {
        positions = (first..=last)
            .flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e)))
            .filter(within)
            .collect();
    }
    if positions.len() < 3 {
        return linear_ticks(low, high, count);
    }
    // One notation along the whole axis: plain numbers only when all of them are short.
    let exponent = |x: f64| (x.log10() + 1e-9).floor() as i32;
    let lowest = exponent(positions[0]);
    let plain = lowest >= -3 && last < 6;
    let label = |x: &f64| match (plain, positions.len() == powers) {
        (true, _) => typeset(*x, 3),
        (false, true) => ten_to_the(exponent(*x)),
        (false, false) => typeset(x / 10f64.powi(lowest), 3),
    };
    Ticks {
        labels: positions.iter().map(label).collect(),
        factor: (!plain && positions.len() != powers).then(|| format!("×{}", ten_to_the(lowest))),
        positions,
    }
}

/// The least of 1, 2, 5 and 10 times a power of ten that is at least `raw`, and the exponent of its leading digit.
fn round_step(raw: f64) -> Option<(f64, i32)> {
    if !(raw > 0.0 && raw.is_finite()) {
        return None;
    }
    let exponent = raw.log10().floor() as i32;
    let candidates = [(1.0, 0), (2.0, 0), (5.0, 0), (1.0, 1)];
    candidates
        .iter()
        .map(|(digit, carry)| (digit * 10f64.powi(exponent + carry), exponent + carry))
        .find(|(step, _)| *step >= raw * (1.0 - 1e-9) && *step > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_ticks_are_round_and_inside() {
        let ticks = linear_ticks(0.0, 1.0, 5);
        assert_eq!(ticks.labels, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(linear_ticks(-7.3, 12.1, 5).labels, ["−5", "0", "5", "10"]);
        let small = linear_ticks(1.13e-6, 4.4e-6, 4);
        assert_eq!(small.labels, ["2", "3", "4"]);
        assert_eq!(small.factor.as_deref(), Some("×10⁻⁶"));
        assert_eq!(
            linear_ticks(0.0, 250_000.0, 5).labels,
            ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5"]
        );
    }

    #[test]
    fn steps_are_one_two_or_five_and_counts_bounded() {
        for k in 1..400 {
            let width = 1.037f64.powi(k) * 1e-4;
            let ticks = linear_ticks(-0.3 * width, 0.7 * width, 5);
            let step = ticks.positions[1] - ticks.positions[0];
            let digit = step / 10f64.powi((step * 1.000001).log10().floor() as i32);
            assert!([1.0, 2.0, 5.0].iter().any(|d| (digit / d - 1.0).abs() < 1e-6), "{step}");
            assert!((2..=6).contains(&ticks.positions.len()));
        }
    }

    #[test]
    fn impossible_intervals_have_no_ticks() {
        for (low, high) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (-1e308, 1e308)] {
            assert_eq!(linear_ticks(low, high, 5), Ticks::default());
        }
    }

    #[test]
    fn logarithmic_ticks_thin_out_with_the_decades() {
        assert_eq!(logarithmic_ticks(1e-3, 1.0, 5).labels, ["0.001", "0.01", "0.1", "1"]);
        assert_eq!(logarithmic_ticks(1.0, 20.0, 5).labels, ["1", "2", "5", "10", "20"]);
        assert_eq!(
            logarithmic_ticks(1e-12, 1.0, 5).labels,
            ["10⁻¹²", "10⁻⁹", "10⁻⁶", "10⁻³", "10⁰"]
        );
        let few = logarithmic_ticks(1.5e-5, 2.2e-4, 5);
        assert_eq!(few.labels, ["2", "5", "10", "20"]);
        assert_eq!(few.factor.as_deref(), Some("×10⁻⁵"));
        assert_eq!(
            logarithmic_ticks(3.0, 4.0, 5).labels,
            ["3.0", "3.2", "3.4", "3.6", "3.8", "4.0"]
        );
    }
}
