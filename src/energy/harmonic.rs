//! Harmonic energy: Li, Guo, Wang, He, Gu & Qin, *Harmonic volumetric mapping for solid modeling applications* (2007),
//! section 4.3.1, equation (2).

use crate::Matrix3;

/// Harmonic energy density `‖J‖² = |∇f₁|² + |∇f₂|² + |∇f₃|²`: 3 for a rigid motion.
///
/// Without the factor ½ that many texts give the Dirichlet energy.
pub fn density(jacobian: &Matrix3) -> f64 {
    jacobian.norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn density_is_the_sum_of_the_squared_gradients_of_the_coordinates() {
        let jacobian = Matrix3::new(1., 2., 3., 0., -1., 4., 5., 0., 1.);
        let gradients = (0..3).map(|i| jacobian.row(i).norm_squared());
        assert_eq!(density(&jacobian), gradients.sum::<f64>());
        assert_eq!(density(&Matrix3::identity()), 3.0);
    }
}
