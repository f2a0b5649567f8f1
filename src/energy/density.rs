//! Energy densities of a map, from its Jacobian: Li, Guo, Wang, He, Gu & Qin, *Harmonic volumetric mapping for solid
//! modeling applications* (2007), the harmonic energy of section 4.3.1, equation (2), and the deformation energy of
//! section 4.3.2, equation (4).

use crate::Matrix3;

/// Harmonic energy density `‖J‖² = |∇f₁|² + |∇f₂|² + |∇f₃|²`: 3 for a rigid motion.
///
/// Without the factor ½ that many texts give the Dirichlet energy.
pub fn harmonic_density(jacobian: &Matrix3) -> f64 {
    jacobian.norm_squared()
}

/// The two constants of an isotropic elastic material. The default is the rubber of the paper.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Lame {
    /// First constant λ, the resistance to change of volume.
    pub lambda: f64,
    /// Second constant μ, the rigidity.
    pub mu: f64,
}

impl Lame {
    /// A deformation energy density that cannot be distinguished from rounding: that of strains of about a millionth.
    pub fn negligible_density(&self) -> f64 {
        1e-12 * (self.lambda.abs() + self.mu.abs())
    }
}

impl Default for Lame {
    fn default() -> Self {
        Self {
            lambda: 0.0335,
            mu: 0.0224,
        }
    }
}

/// The strain `ε = JᵀJ − I`, twice Green's, symmetric; zero exactly for rigid motions and reflections.
///
/// As the paper defines it, without the customary factor ½: strains are twice and energies four times those of texts
/// that have it.
fn green_strain(jacobian: &Matrix3) -> Matrix3 {
    jacobian.tr_mul(jacobian) - Matrix3::identity()
}

/// Stress `σ = λ tr(ε) I + 2 μ ε` of a strain.
fn stress(strain: &Matrix3, lame: &Lame) -> Matrix3 {
    Matrix3::from_diagonal_element(lame.lambda * strain.trace()) + strain * (2.0 * lame.mu)
}

/// Elastic potential density `η = ½ σ : ε`, the double sum over all nine components.
///
/// The paper prints both sums over `i`, as if only the diagonal counted; that would depend on the axes, so it is read
/// as a misprint for `i` and `j`.
pub fn deformation_density(jacobian: &Matrix3, lame: &Lame) -> f64 {
    let strain = green_strain(jacobian);
    stress(&strain, lame).dot(&strain) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    #[test]
    fn rigid_motions_cost_nothing() {
        let rotation = nalgebra::Rotation3::new(Vector::new(0.3, -1.2, 2.0)).into_inner();
        // Entries of JᵀJ err by a few ulp, and the density is quadratic in them.
        assert!(deformation_density(&rotation, &Lame::default()) < 1e-30);
    }

    #[test]
    fn uniform_stretch_costs_its_closed_form() {
        // ε = (s² − 1) I, σ = (3λ + 2μ)(s² − 1) I, η = ½ σ : ε.
        let lame = Lame { lambda: 0.7, mu: 0.2 };
        for s in [0.5, 1.1, 3.0] {
            let strain: f64 = s * s - 1.0;
            let expected = 1.5 * (3.0 * lame.lambda + 2.0 * lame.mu) * strain * strain;
            let found = deformation_density(&Matrix3::from_diagonal_element(s), &lame);
            assert!((found / expected - 1.0).abs() < 1e-13);
        }
    }

    #[test]
    fn simple_shear_costs_its_closed_form() {
        // J = I + g e₁e₂ᵀ: ε₁₂ = ε₂₁ = g, ε₂₂ = g², so η = ½ λ g⁴ + μ (2 g² + g⁴).
        let lame = Lame::default();
        let g: f64 = 0.4;
        let mut jacobian = Matrix3::identity();
        jacobian[(0, 1)] = g;
        let expected = 0.5 * lame.lambda * g.powi(4) + lame.mu * (2.0 * g * g + g.powi(4));
        assert!((deformation_density(&jacobian, &lame) / expected - 1.0).abs() < 1e-13);
    }

    #[test]
    fn deformation_density_does_not_depend_on_the_axes() {
        let jacobian = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        let rotation = nalgebra::Rotation3::new(Vector::new(1.0, 0.4, -0.8)).into_inner();
        let turned = rotation * jacobian * rotation.transpose();
        let (here, there) = (
            deformation_density(&jacobian, &Lame::default()),
            deformation_density(&turned, &Lame::default()),
        );
        assert!((there / here - 1.0).abs() < 1e-13);
    }

    #[test]
    fn harmonic_density_is_the_sum_of_the_squared_gradients_of_the_coordinates() {
        let jacobian = Matrix3::new(1., 2., 3., 0., -1., 4., 5., 0., 1.);
        let gradients = (0..3).map(|i| jacobian.row(i).norm_squared());
        assert_eq!(harmonic_density(&jacobian), gradients.sum::<f64>());
        assert_eq!(harmonic_density(&Matrix3::identity()), 3.0);
    }
}
