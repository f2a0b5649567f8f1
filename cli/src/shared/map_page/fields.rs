//! What a page colours a map by.

use solidmap::Point;
use solidmap::energy::distortion::stretches;
use solidmap::energy::{EnergyOptions, UnitVolumeScale, deformation_density, harmonic_density};
use solidmap::geometry::distance_field;
use solidmap::mesh::SurfaceMesh;
use solidmap::statistics::quantiles;

use super::lattice::LatticeSamples;
use crate::shared::page::{PackedArray, PageField, Palette};

/// A scalar over the domain, besides those that a map has itself.
pub struct CarriedScalar {
    /// Its name.
    pub name: String,
    /// Its values at the points that were asked for.
    pub values: Vec<f64>,
    /// Whether they are labels, such as numbers of parts, which have no values between them.
    pub is_label: bool,
}

/// The scalars at points of the domain.
pub type CarriedScalars<'a> = &'a dyn Fn(&[Point]) -> anyhow::Result<Vec<CarriedScalar>>;

/// Values of one scalar, and how to show them.
struct Scalar {
    field: PageField,
    values: Vec<f64>,
}

/// The share of the samples whose values the colour scale holds: few points at creases have values far above all others.
const SHOWN: f64 = 0.99;
/// Least and most factor that the end of the scale of a ratio is away from 1.
const RATIOS: [f64; 2] = [1.25, 32.0];

/// The scalars of a map with their arrays, those that it carries first.
pub fn fields(
    samples: &LatticeSamples,
    target: &SurfaceMesh,
    scale: &UnitVolumeScale,
    orientation: f64,
    options: &EnergyOptions,
    carried: Option<CarriedScalars>,
) -> anyhow::Result<(Vec<PageField>, Vec<PackedArray>)> {
    let scaled = || samples.jacobians.iter().map(|jacobian| jacobian * scale.jacobian);
    let carried = carried.map_or(Ok(vec![]), |carried| carried(&samples.points))?;
    let carried = carried.into_iter().enumerate();
    let carried = carried.map(|(k, scalar)| of_carried(samples, k, scalar));
    let scalars = [
        amount(samples, scaled().map(|j| harmonic_density(&j)).collect()).named(
            "harmonic",
            "harmonic energy density",
            "",
            "‖J‖², with both solids at unit volume: 3 where the map is a rigid motion",
        ),
        amount(
            samples,
            scaled().map(|j| deformation_density(&j, &options.lame)).collect(),
        )
        .named(
            "deformation",
            "deformation energy density",
            "",
            "½ σ:ε of the strain JᵀJ − I, with both solids at unit volume: 0 where the map is a rigid motion",
        ),
        ratio(samples, scaled().map(|j| orientation * j.determinant()).collect()).named(
            "volume",
            "det J, both solids at unit volume",
            "×",
            "how much volume grows: 1 where it is kept, zero or less where the map is folded",
        ),
        anisotropy(samples).named(
            "anisotropy",
            "σ₁ / σ₃",
            "×",
            "largest stretch over the smallest: 1 where the map is a similarity",
        ),
        amount(samples, distance_field(target, &samples.images)?).named(
            "distance",
            "distance from the target's boundary",
            "model units",
            "the target's distance field, carried back by the map",
        ),
    ];
    Ok(carried
        .chain(scalars)
        .map(|Scalar { field, values }| {
            let array = PackedArray::floats(format!("field-{}", field.key), samples.spread(values));
            (field, array)
        })
        .unzip())
}

impl Scalar {
    /// `ends` makes the ends of the scale from the quantiles at 1 and 99 %.
    fn new(samples: &LatticeSamples, values: Vec<f64>, palette: Palette, ends: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        Self::with_ends(samples, values, palette, |[_, few, most_of, _]| ends([few, most_of]))
    }

    /// In the colours of labels.
    fn of_labels(samples: &LatticeSamples, values: Vec<f64>) -> Self {
        Self::with_ends(samples, values, Palette::Labels, |[least, _, _, most]| [least, most])
    }

    fn with_ends(
        samples: &LatticeSamples,
        values: Vec<f64>,
        palette: Palette,
        ends: impl Fn([f64; 4]) -> [f64; 2],
    ) -> Self {
        let inside = values.iter().zip(&samples.is_inside);
        let inside: Vec<f64> = inside
            .filter(|(v, inside)| **inside && v.is_finite())
            .map(|(v, _)| *v)
            .collect();
        let shown = quantiles(&inside, [0.0, 1.0 - SHOWN, SHOWN, 1.0]).unwrap_or_default();
        let [least, _, _, most] = shown;
        let [low, high] = ends(shown);
        let field = PageField {
            key: "".into(),
            label: "".into(),
            unit: "",
            meaning: "".into(),
            palette,
            logarithmic: false,
            low,
            high,
            clamps: least < low || most > high,
        };
        Self { field, values }
    }

    fn named(self, key: &'static str, label: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        let field = PageField {
            key: key.into(),
            label: label.into(),
            unit,
            meaning: meaning.into(),
            ..self.field
        };
        Self { field, ..self }
    }

    fn logarithmic(self) -> Self {
        let field = PageField {
            logarithmic: true,
            ..self.field
        };
        Self { field, ..self }
    }
}

/// From zero.
fn amount(samples: &LatticeSamples, values: Vec<f64>) -> Scalar {
    Scalar::new(samples, values, Palette::Amount, |[_, high]| {
        [0.0, high.max(f64::MIN_POSITIVE)]
    })
}

/// From the least to the most.
fn of_carried(samples: &LatticeSamples, number: usize, carried: CarriedScalar) -> Scalar {
    let scalar = match carried.is_label {
        true => Scalar::of_labels(samples, carried.values),
        false => Scalar::new(samples, carried.values, Palette::Amount, |[low, high]| {
            [low, high.max(low + f64::MIN_POSITIVE)]
        }),
    };
    let field = PageField {
        key: format!("carried-{number}").into(),
        label: carried.name.into(),
        meaning: "carried by the map: at a point of the domain and at its image".into(),
        ..scalar.field
    };
    Scalar { field, ..scalar }
}

/// As far below 1 as above, by factors.
fn ratio(samples: &LatticeSamples, values: Vec<f64>) -> Scalar {
    let ends = |[low, high]: [f64; 2]| {
        let low = if low > 0.0 { 1.0 / low } else { RATIOS[1] };
        let most = high.max(low).clamp(RATIOS[0], RATIOS[1]);
        [1.0 / most, most]
    };
    Scalar::new(samples, values, Palette::Ratio, ends).logarithmic()
}

/// From 1.
fn anisotropy(samples: &LatticeSamples) -> Scalar {
    let ratio = |[first, _, third]: [f64; 3]| first / third.abs();
    let values = samples.jacobians.iter().map(|j| ratio(stretches(j))).collect();
    Scalar::new(samples, values, Palette::Amount, |[_, high]| {
        [1.0, high.clamp(RATIOS[0], 1e6)]
    })
    .logarithmic()
}
