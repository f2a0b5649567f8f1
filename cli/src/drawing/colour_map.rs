use super::DrawingError;
use super::canvas::Rgb;
use solidmap::statistics::quantiles;

/// The colour of NaN.
pub(super) const NO_VALUE: Rgb = [160, 160, 160];

/// Which colours a bar has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Colours {
    /// For amounts: viridis (Smith, van der Walt 2015), in which equal steps look equal, also to colour-blind readers.
    #[default]
    Amount,
    /// For qualities: viridis from its other end, so that bad ones are bright.
    Quality,
    /// For ratios, with 1 in the middle of the bar: brown, white, blue-green.
    Ratio,
    /// The scheme of the paper's figures. Its steps do not look equal: edges appear where colours change fast, not values.
    Rainbow,
}

impl Colours {
    /// The colour at a fraction of the bar; fractions outside `[0, 1]` are clamped.
    pub fn at(self, fraction: f64) -> Rgb {
        let t = fraction.clamp(0.0, 1.0);
        let of = |gradient: colorous::Gradient, t: f64| gradient.eval_continuous(t).as_array();
        match self {
            Self::Amount => of(colorous::VIRIDIS, t),
            Self::Quality => of(colorous::VIRIDIS, 1.0 - t),
            Self::Ratio => of(colorous::BROWN_GREEN, t),
            Self::Rainbow => rainbow(t),
        }
    }
}

/// The classic rainbow from blue at 0 through cyan, green and yellow to red at 1: hue falls from 240° to 0° at full
/// saturation. The scheme of the paper's figures, "red represents maximum while blue represents minimum". Fractions
/// outside `[0, 1]` are clamped.
fn rainbow(fraction: f64) -> Rgb {
    let t = 4.0 * fraction.clamp(0.0, 1.0);
    let rising = |from: f64| (255.0 * (t - from).clamp(0.0, 1.0)).round() as u8;
    [rising(2.0), rising(0.0) - rising(3.0), 255 - rising(1.0)]
}

/// How values are spread along a colour bar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// Linearly.
    #[default]
    Linear,
    /// By their logarithms; values that are not positive get the colour of the lowest.
    Log,
}

/// Which values the ends of a colour bar stand for. Values beyond are clamped, and the bar says so.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ValueRange {
    /// The smallest and the largest value.
    #[default]
    Full,
    /// These two values, so that pictures can be compared.
    Fixed(f64, f64),
    /// Two quantiles, as fractions: `Quantiles(0.01, 0.99)` keeps a few extremes from washing out the rest.
    Quantiles(f64, f64),
}

/// A colour for every value of a field, and what is written beside the bar that explains it.
#[derive(Debug, Clone, PartialEq)]
pub struct ColourBar {
    label: String,
    scale: Scale,
    colours: Colours,
    low: f64,
    high: f64,
    data_low: f64,
    data_high: f64,
    quantiles: Option<(f64, f64)>,
}

impl ColourBar {
    /// A bar for these values, named `label`: quantity and unit, as `"distance [mm]"`. Chain the values of several
    /// panels to give them one bar. Values that are not finite do not count.
    ///
    /// When all values agree to nine digits the bar is widened about them, so that rounding errors are not painted
    /// in all colours.
    ///
    /// # Errors
    ///
    /// [`DrawingError::NoFiniteValue`], [`DrawingError::NoPositiveValue`] for a logarithmic scale, and
    /// [`DrawingError::BadRange`] for a range that is empty, not finite or (logarithmic) not positive.
    pub fn new(
        label: impl Into<String>,
        values: impl IntoIterator<Item = f64>,
        range: ValueRange,
        scale: Scale,
    ) -> Result<Self, DrawingError> {
        let label = label.into();
        let finite: Vec<f64> = values.into_iter().filter(|x| x.is_finite()).collect();
        let Some([data_low, data_high]) = quantiles(&finite, [0.0, 1.0]) else {
            return Err(DrawingError::NoFiniteValue { label });
        };
        let shown: Vec<f64> = match scale {
            Scale::Linear => finite,
            Scale::Log => finite.into_iter().filter(|x| *x > 0.0).collect(),
        };
        let (low, high) = match range {
            ValueRange::Fixed(low, high) => (low, high),
            ValueRange::Full => widened(ends(&shown, [0.0, 1.0], &label)?, scale),
            ValueRange::Quantiles(low, high) if 0.0 <= low && low < high && high <= 1.0 => {
                widened(ends(&shown, [low, high], &label)?, scale)
            }
            ValueRange::Quantiles(low, high) => return Err(DrawingError::BadRange { label, low, high }),
        };
        let possible = low < high && (high - low).is_finite() && (scale == Scale::Linear || low > 0.0);
        if !possible {
            return Err(DrawingError::BadRange { label, low, high });
        }
        let quantiles = match range {
            ValueRange::Quantiles(low, high) => Some((low, high)),
            _ => None,
        };
        Ok(Self {
            label,
            scale,
            colours: Colours::default(),
            low,
            high,
            data_low,
            data_high,
            quantiles,
        })
    }

    /// The same bar in other colours.
    pub fn in_colours(self, colours: Colours) -> Self {
        Self { colours, ..self }
    }

    /// The values at the lower and at the upper end.
    pub fn range(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// The colour of a value: clamped to the range, grey when it is not a number.
    pub fn colour(&self, value: f64) -> Rgb {
        if value.is_nan() {
            return NO_VALUE;
        }
        self.colours.at(self.fraction(value))
    }

    /// The position of a value along the bar: 0 at the lower end, 1 at the upper end, outside `[0, 1]` beyond them.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            // Below the range, like every value without a logarithm.
            Scale::Log if value <= 0.0 => -1.0,
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    pub(super) fn label(&self) -> &str {
        &self.label
    }

    pub(super) fn colours(&self) -> Colours {
        self.colours
    }

    pub(super) fn scale(&self) -> Scale {
        self.scale
    }

    /// The smallest and the largest finite value.
    pub(super) fn data_range(&self) -> (f64, f64) {
        (self.data_low, self.data_high)
    }

    /// The quantiles at which the bar ends, if it was made by quantiles.
    pub(super) fn quantiles(&self) -> Option<(f64, f64)> {
        self.quantiles
    }
}

fn ends(shown: &[f64], fractions: [f64; 2], label: &str) -> Result<(f64, f64), DrawingError> {
    quantiles(shown, fractions)
        .map(|[low, high]| (low, high))
        .ok_or_else(|| DrawingError::NoPositiveValue {
            label: label.to_owned(),
        })
}

/// The range, widened by a tenth of its values when it is too narrow to mean anything.
pub(super) fn widened((low, high): (f64, f64), scale: Scale) -> (f64, f64) {
    let size = low.abs().max(high.abs());
    if high - low > 1e-9 * size {
        return (low, high);
    }
    match scale {
        Scale::Linear if size == 0.0 => (-1.0, 1.0),
        Scale::Linear => (low - 0.05 * size, high + 0.05 * size),
        Scale::Log => (low / 1.05, high * 1.05),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rainbow_runs_from_pure_blue_to_pure_red() {
        let stops = [
            (0.0, [0, 0, 255]),
            (0.25, [0, 255, 255]),
            (0.5, [0, 255, 0]),
            (0.75, [255, 255, 0]),
            (1.0, [255, 0, 0]),
            (-3.0, [0, 0, 255]),
            (f64::INFINITY, [255, 0, 0]),
        ];
        for (fraction, colour) in stops {
            assert_eq!(rainbow(fraction), colour, "{fraction}");
        }
    }

    /// Hue of a saturated colour, from 0 at red to 4 at blue.
    fn hue([r, g, b]: Rgb) -> f64 {
        let [r, g, b] = [r, g, b].map(|c| f64::from(c) / 255.0);
        match (r == 1.0, g == 1.0, b == 1.0) {
            (true, _, _) => g,
            (_, true, _) => 2.0 - r + b,
            (_, _, true) => 4.0 - g,
            _ => panic!("not saturated"),
        }
    }

    #[test]
    fn hue_falls_strictly_along_the_rainbow() {
        let hues: Vec<f64> = (0..=1020).map(|k| hue(rainbow(f64::from(k) / 1020.0))).collect();
        assert!(hues.windows(2).all(|pair| pair[1] < pair[0]));
    }

    /// Lightness (CIE L*) of an sRGB colour.
    fn lightness(colour: Rgb) -> f64 {
        let linear = colour.map(|c| {
            let c = f64::from(c) / 255.0;
            if c <= 0.04045 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        });
        let y: f64 = linear.iter().zip([0.2126, 0.7152, 0.0722]).map(|(c, w)| c * w).sum();
        if y > 0.008856 {
            116.0 * y.cbrt() - 16.0
        } else {
            903.3 * y
        }
    }

    #[test]
    fn amounts_grow_lighter_qualities_darker_and_ratios_are_lightest_in_the_middle() {
        let of =
            |colours: Colours| -> Vec<f64> { (0..=64).map(|k| lightness(colours.at(f64::from(k) / 64.0))).collect() };
        let grows = |values: &[f64]| values.windows(2).all(|pair| pair[1] > pair[0]);
        let (amount, mut quality, ratio) = (of(Colours::Amount), of(Colours::Quality), of(Colours::Ratio));
        assert!(grows(&amount) && amount[64] - amount[0] > 60.0);
        quality.reverse();
        assert_eq!(quality, amount);
        // The lightest is within a step of the middle.
        assert!(grows(&ratio[..32]) && ratio[32..].windows(2).all(|pair| pair[1] < pair[0]));
        assert!(!grows(&of(Colours::Rainbow)));
    }

    #[test]
    fn ranges_are_full_fixed_or_by_quantile() {
        let values = || (0..=100).map(f64::from).chain([f64::NAN, f64::INFINITY]);
        let bar = |range| ColourBar::new("v", values(), range, Scale::Linear).unwrap();
        assert_eq!(bar(ValueRange::Full).range(), (0.0, 100.0));
        assert_eq!(bar(ValueRange::Fixed(-1.0, 7.0)).range(), (-1.0, 7.0));
        assert_eq!(bar(ValueRange::Quantiles(0.1, 0.9)).range(), (10.0, 90.0));
        assert_eq!(bar(ValueRange::Quantiles(0.1, 0.9)).data_range(), (0.0, 100.0));
    }

    #[test]
    fn values_beyond_the_range_clamp_and_nan_is_grey() {
        let bar = ColourBar::new("v", [1.0, 2.0], ValueRange::Full, Scale::Linear).unwrap();
        assert_eq!(bar.colour(f64::NEG_INFINITY), bar.colour(1.0));
        assert_eq!(bar.colour(9.0), bar.colour(2.0));
        assert_eq!(bar.colour(f64::NAN), NO_VALUE);
    }

    #[test]
    fn the_middle_of_a_logarithmic_bar_is_the_geometric_mean() {
        let bar = ColourBar::new("v", [1e-6, 0.0, -3.0, 1e2], ValueRange::Full, Scale::Log).unwrap();
        assert_eq!(bar.range(), (1e-6, 1e2));
        let bar = bar.in_colours(Colours::Rainbow);
        assert_eq!(bar.colour(1e-2), [0, 255, 0]);
        assert_eq!(bar.colour(0.0), [0, 0, 255]);
    }

    #[test]
    fn a_constant_field_is_the_middle_of_its_bar() {
        for (value, scale) in [
            (3.0, Scale::Linear),
            (0.0, Scale::Linear),
            (-7.0, Scale::Linear),
            (3.0, Scale::Log),
        ] {
            let bar = ColourBar::new("v", [value, value * (1.0 + 1e-13)], ValueRange::Full, scale).unwrap();
            assert!((bar.fraction(value) - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn impossible_ranges_are_refused() {
        let bar = |values: [f64; 2], range, scale| ColourBar::new("v", values, range, scale).unwrap_err();
        let nan = [f64::NAN; 2];
        assert!(matches!(
            bar(nan, ValueRange::Full, Scale::Linear),
            DrawingError::NoFiniteValue { .. }
        ));
        assert!(matches!(
            bar([-1.0, 0.0], ValueRange::Full, Scale::Log),
            DrawingError::NoPositiveValue { .. }
        ));
        for (range, scale) in [
            (ValueRange::Fixed(2.0, 2.0), Scale::Linear),
            (ValueRange::Fixed(f64::NAN, 2.0), Scale::Linear),
            (ValueRange::Fixed(0.0, 2.0), Scale::Log),
            (ValueRange::Quantiles(0.9, 0.1), Scale::Linear),
            (ValueRange::Quantiles(0.5, 1.5), Scale::Linear),
        ] {
            assert!(matches!(bar([1.0, 2.0], range, scale), DrawingError::BadRange { .. }));
        }
    }
}
