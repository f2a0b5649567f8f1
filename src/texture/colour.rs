//! Linear colours and their 8-bit sRGB codes (IEC 61966-2-1).

/// Red, green and blue as linear intensities from 0 to 1. Intensities are what eyes and cameras average, so that
/// colours are interpolated and extended in these, not in sRGB codes.
pub type LinearRgb = [f64; 3];

/// The linear colour of an 8-bit sRGB code.
pub fn from_srgb(code: [u8; 3]) -> LinearRgb {
    code.map(|c| LIGHT[c as usize])
}

/// The linear colour of an sRGB code from 0 to 1, clamped to that range.
pub fn decoded(code: [f64; 3]) -> LinearRgb {
    code.map(|c| decode(c.clamp(0.0, 1.0)))
}

/// The nearest 8-bit sRGB code; intensities are clamped to 0 to 1, and NaN gives 0.
pub fn to_srgb(light: LinearRgb) -> [u8; 3] {
    light.map(|l| (255.0 * encode(l.clamp(0.0, 1.0))).round() as u8)
}

static LIGHT: std::sync::LazyLock<[f64; 256]> =
    std::sync::LazyLock::new(|| std::array::from_fn(|code| decode(code as f64 / 255.0)));

fn decode(code: f64) -> f64 {
    if code <= 0.04045 {
        code / 12.92
    } else {
        ((code + 0.055) / 1.055).powf(2.4)
    }
}

fn encode(light: f64) -> f64 {
    if light <= 0.003_130_8 {
        12.92 * light
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_comes_back() {
        for code in 0..=255 {
            assert_eq!(to_srgb(from_srgb([code; 3])), [code; 3]);
        }
    }

    /// `255 (1.055 · 0.5^(1/2.4) − 0.055) = 187.5`, rounded up.
    #[test]
    fn half_of_the_light_is_coded_as_188() {
        assert_eq!(to_srgb([0.5; 3]), [188; 3]);
    }

    #[test]
    fn light_out_of_gamut_is_cut_off() {
        assert_eq!(to_srgb([-0.2, 1.7, f64::NAN]), [0, 255, 0]);
    }
}
