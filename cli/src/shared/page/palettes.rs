//! The colour scales of pages: perceptually uniform, and told apart by colour-blind readers.

use serde::Serialize;

/// How many colours a scale is given by.
const STEPS: usize = 256;

/// Colours as `[red, green, blue]`, from 0 to 255.
#[derive(Debug, Clone, Serialize)]
pub struct Palettes {
    /// For amounts: viridis.
    amount: Vec<[u8; 3]>,
    /// For qualities: viridis from its other end.
    quality: Vec<[u8; 3]>,
    /// For ratios, with 1 in the middle: brown, white, blue-green.
    ratio: Vec<[u8; 3]>,
    /// For labels, in their order: those of Okabe and Ito (Color Universal Design, 2008) but black.
    labels: [[u8; 3]; 7],
    /// For what is folded or inverted: in no scale.
    wrong: [u8; 3],
}

impl Palettes {
    /// The scales of all pages.
    pub fn new() -> Self {
        let colours = |gradient: colorous::Gradient| {
            let steps = (0..STEPS).map(|k| gradient.eval_rational(k, STEPS));
            steps.map(|colour| colour.as_array()).collect::<Vec<_>>()
        };
        let amount = colours(colorous::VIRIDIS);
        Self {
            quality: amount.iter().rev().copied().collect(),
            amount,
            ratio: colours(colorous::BROWN_GREEN),
            labels: [
                [230, 159, 0],
                [86, 180, 233],
                [0, 158, 115],
                [240, 228, 66],
                [0, 114, 178],
                [213, 94, 0],
                [204, 121, 167],
            ],
            wrong: [255, 0, 128],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_has_a_colour_of_its_own() {
        let palettes = Palettes::new();
        let far = |colour: &[u8; 3]| {
            let parts = colour.iter().zip(palettes.wrong);
            parts
                .map(|(a, b)| (f64::from(*a) - f64::from(b)).powi(2))
                .sum::<f64>()
                .sqrt()
                > 100.0
        };
        let all = palettes.amount.iter().chain(&palettes.ratio).chain(&palettes.labels);
        assert!(all.into_iter().all(far));
        assert_eq!((palettes.amount.len(), palettes.ratio.len()), (STEPS, STEPS));
    }
}
