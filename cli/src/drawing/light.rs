//! Lights in the camera's frame, and the sRGB encoding (IEC 61966-2-1), which is undone before light is added up.

use std::sync::OnceLock;

use solidmap::Vector;

/// The factor of reflected light for each colour channel at this normal, and the gloss added to it. With `even`, light
/// is more even and without gloss, so that the colours of fields can be compared with their bar.
pub(super) fn lighting(normal: &Vector, even: bool) -> ([f32; 3], f32) {
    let key = Vector::new(-0.40, 0.57, 0.72);
    let fill = Vector::new(0.80, 0.10, 0.59);
    let lambert = |light: &Vector| normal.dot(light).max(0.0);
    let sky = 0.5 + 0.5 * normal.y;
    let half = (key + Vector::z()).normalize();
    let gloss = 0.10 * normal.dot(&half).max(0.0).powi(40);
    let (ambient, key_power, fill_power) = if even { (0.66, 0.38, 0.16) } else { (0.34, 0.76, 0.22) };
    // A warm key and a cool sky tell the faces of a plain solid apart.
    let warm = [1.02, 1.0, 0.96];
    let cool = if even { [1.0; 3] } else { [0.93, 0.99, 1.10] };
    let diffuse = [0, 1, 2].map(|k| {
        let lit = warm[k] * key_power * lambert(&key) + fill_power * lambert(&fill);
        (cool[k] * ambient * (0.55 + 0.45 * sky) + lit) as f32
    });
    (diffuse, if even { 0.0 } else { gloss as f32 })
}

/// Linear light of an sRGB channel.
pub(super) fn to_linear(channel: u8) -> f32 {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    let decoded = |k: usize| {
        let c = k as f32 / 255.0;
        if c <= 0.04045 {
            c / 12.92
        } else {
            ((c + 0.055) / 1.055).powf(2.4)
        }
    };
    TABLE.get_or_init(|| std::array::from_fn(decoded))[channel as usize]
}

/// The sRGB channel of linear light, clamped.
pub(super) fn to_srgb(light: f32) -> u8 {
    let c = light.clamp(0.0, 1.0);
    let encoded = if c <= 0.003_130_8 {
        12.92 * c
    } else {
        1.055 * c.powf(1.0 / 2.4) - 0.055
    };
    (255.0 * encoded).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_to_linear_light_and_back_is_the_identity() {
        assert!((0..=255).all(|channel| to_srgb(to_linear(channel)) == channel));
        assert_eq!([to_linear(0), to_linear(255)], [0.0, 1.0]);
    }

    #[test]
    fn coloured_fields_keep_most_of_their_light_on_every_visible_side() {
        for (x, y) in [(0.0, 0.0), (0.7, 0.0), (-0.7, 0.0), (0.0, 0.7), (0.0, -0.7)] {
            let normal = Vector::new(x, y, f64::sqrt(1.0 - x * x - y * y));
            let (diffuse, gloss) = lighting(&normal, true);
            assert!(
                diffuse.iter().all(|d| (0.4..1.2).contains(d)) && gloss == 0.0,
                "{normal} {diffuse:?}"
            );
        }
    }
}
