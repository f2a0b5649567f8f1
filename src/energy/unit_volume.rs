use super::EnergyError;

/// What scaling both solids to unit volume does to a map, so that energies of maps between different solids compare.
///
/// The map becomes `f̃(x̃) = s₂ f(x̃ / s₁)`, where `sᵢ = Vᵢ^(−1/3)` scales solid `i` to unit volume. Its Jacobian is
/// `J̃ = (s₂ / s₁) J = (V₁ / V₂)^(1/3) J`, its volume element `dx̃ = dx / V₁`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitVolumeScale {
    /// Factor of the Jacobian, `(V₁ / |V₂|)^(1/3)`: it scales the target to the volume of the domain.
    pub jacobian: f64,
    /// Factor of the volume element, `1 / V₁`.
    pub volume_element: f64,
}

impl UnitVolumeScale {
    /// Both solids at the size they have.
    pub const NONE: Self = Self {
        jacobian: 1.0,
        volume_element: 1.0,
    };

    /// The factors for these volumes; the target's is negative when the map reflects.
    ///
    /// # Errors
    ///
    /// [`EnergyError::Volume`] unless the volume of the domain is positive and finite, and that of the target finite
    /// and not zero.
    pub fn new(domain_volume: f64, target_volume: f64) -> Result<Self, EnergyError> {
        require_volume("domain", domain_volume)?;
        let (solid, volume) = ("target", target_volume);
        require_volume(solid, volume.abs()).map_err(|_| EnergyError::Volume { solid, volume })?;
        Ok(Self {
            jacobian: (domain_volume / target_volume.abs()).cbrt(),
            volume_element: 1.0 / domain_volume,
        })
    }
}

/// Refuses volumes that are not positive and finite.
pub(super) fn require_volume(solid: &'static str, volume: f64) -> Result<(), EnergyError> {
    if volume > 0.0 && volume.is_finite() {
        Ok(())
    } else {
        Err(EnergyError::Volume { solid, volume })
    }
}
