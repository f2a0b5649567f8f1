use crate::Matrix3;

/// The determinant of a Jacobian with the right sign, also where its size is beyond the range of `f64`: it then is the
/// largest or smallest normal number. NaN when an entry is not finite.
///
/// A model in nanometres that is mapped to one in kilometres is not folded.
pub(super) fn determinant(jacobian: &Matrix3) -> f64 {
    if !jacobian.iter().all(|x| x.is_finite()) {
        return f64::NAN;
    }
    let plain = jacobian.determinant();
    let size = jacobian.amax();
    if plain.is_normal() || size == 0.0 {
        return plain;
    }
    let scaled = (jacobian / size).determinant();
    if scaled == 0.0 {
        return 0.0;
    }
    let product = (scaled * size * size * size).abs();
    product.clamp(f64::MIN_POSITIVE, f64::MAX).copysign(scaled)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    #[test]
    fn the_sign_survives_overflow_and_underflow() {
        for size in [1e-200, 1e-110, 1e110, 1e200, 1e300] {
            let stretched = Matrix3::from_diagonal(&Vector::new(size, 2.0 * size, 3.0 * size));
            assert!(
                determinant(&stretched) > 0.0 && determinant(&stretched).is_finite(),
                "{size}"
            );
            assert!(determinant(&-stretched) < 0.0, "{size}");
            let sheared = stretched + Matrix3::new(0.0, size, -size, size, 0.0, 0.5 * size, 0.0, size, 0.0);
            assert_eq!(determinant(&sheared).signum(), (sheared / size).determinant().signum());
        }
        let flat = Matrix3::new(1.0, 2.0, 3.0, 2.0, 4.0, 6.0, 0.0, 0.0, 1.0);
        assert_eq!(determinant(&flat), 0.0);
        assert_eq!(determinant(&(flat * 1e200)), 0.0);
        assert_eq!(determinant(&Matrix3::zeros()), 0.0);
    }

    #[test]
    fn ordinary_determinants_are_unchanged_and_nan_stays() {
        let jacobian = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        assert_eq!(determinant(&jacobian), jacobian.determinant());
        for odd in [f64::NAN, f64::INFINITY] {
            let mut broken = jacobian;
            broken[(1, 2)] = odd;
            assert!(determinant(&broken).is_nan());
        }
    }
}
