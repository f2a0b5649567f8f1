//! What is measured of every map of a study, and how tables call it.

use serde::Serialize;
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion};
use solidmap::energy::EnergyReport;
use solidmap::fit::{BoundaryError, FitReport};

/// Measurements of one map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    pub sources: usize,
    pub collocation: usize,
    /// Columns of the system: sources, and the affine functions if they are in the basis.
    pub unknowns: usize,
    /// The paper's C-Error.
    pub c_error: f64,
    /// Root mean square misfit at the collocation points, as a fraction of the target's diagonal.
    pub residual_rms: f64,
    pub boundary_error: BoundaryError,
    pub harmonic_energy: f64,
    /// Estimated error of that by integration.
    pub harmonic_energy_error: Option<f64>,
    pub deformation_energy: f64,
    /// Estimated error of that by integration.
    pub deformation_energy_error: Option<f64>,
    /// Share of the domain's volume that is folded.
    pub folded_fraction: f64,
    /// Condition number of a dense system; `None` where it is singular to working precision, and for iterations.
    pub condition: Option<f64>,
    /// Singular values or pivots of a dense system that were kept.
    pub rank: Option<usize>,
    /// Median of `σ₁ / σ₂` of the boundary map over the area; in studies of boundary maps only.
    pub surface_angle: Option<f64>,
    /// Mean of `σ₁² + σ₂² + σ₁⁻² + σ₂⁻²` of the boundary map over the area; in studies of boundary maps only. Infinite where a
    /// triangle's image is flat.
    pub surface_dirichlet: Option<f64>,
    /// Wall-clock seconds for all of it.
    pub seconds: f64,
}

impl Measured {
    /// What a fit and the energies of its map say.
    pub fn new(fit: &FitReport, energy: &EnergyReport, seconds: f64) -> Self {
        const AFFINE: usize = 4;
        Self {
            sources: fit.sources,
            collocation: fit.collocation,
            unknowns: fit.sources + if fit.affine { AFFINE } else { 0 },
            c_error: fit.c_error,
            residual_rms: fit.residual_rms,
            boundary_error: fit.boundary_error,
            harmonic_energy: energy.harmonic,
            harmonic_energy_error: energy.errors.map(|errors| errors.harmonic),
            deformation_energy: energy.deformation,
            deformation_energy_error: energy.errors.map(|errors| errors.deformation),
            folded_fraction: energy.folded.fraction,
            condition: fit.condition,
            rank: fit.rank,
            surface_angle: None,
            surface_dirichlet: None,
            seconds,
        }
    }

    /// The same with the distortion of the boundary map.
    pub fn with_distortion_of(mut self, boundary: &BoundaryMap) -> Self {
        let distortion = SurfaceDistortion::of(boundary.domain(), boundary.image());
        self.surface_angle = distortion.as_ref().map(|found| found.angle.p50);
        self.surface_dirichlet = distortion.map(|found| found.mean_symmetric_dirichlet);
        self
    }

    /// Singular values or pivots that were kept, of all.
    pub fn kept_fraction(&self) -> Option<f64> {
        Some(self.rank? as f64 / self.unknowns.max(1) as f64)
    }

    /// The measurements, from the cells of a table by the keys of [`QUANTITIES`]; `None` where one is missing that every map
    /// has.
    pub fn from_cells(cell: impl Fn(&str) -> Option<f64>) -> Option<Self> {
        let whole = |key: &str| cell(key).map(|value| value as usize);
        Some(Self {
            sources: whole("sources")?,
            collocation: whole("collocation")?,
            unknowns: whole("unknowns")?,
            c_error: cell("c_error")?,
            residual_rms: cell("residual_rms")?,
            boundary_error: BoundaryError {
                rms: cell("boundary_error_rms")?,
                p99: cell("boundary_error_p99")?,
                max: cell("boundary_error_max")?,
            },
            harmonic_energy: cell("harmonic_energy")?,
            harmonic_energy_error: cell("harmonic_energy_error"),
            deformation_energy: cell("deformation_energy")?,
            deformation_energy_error: cell("deformation_energy_error"),
            folded_fraction: cell("folded_fraction")?,
            condition: cell("condition"),
            rank: whole("rank"),
            surface_angle: cell("surface_angle"),
            surface_dirichlet: cell("surface_dirichlet"),
            seconds: cell("seconds")?,
        })
    }
}

/// A column of tables.
pub struct Quantity {
    /// Its name in files.
    pub key: &'static str,
    /// Its name for people.
    pub name: &'static str,
    /// Its unit, or what it is a fraction of; empty for plain numbers.
    pub unit: &'static str,
    /// What it means, in one line.
    pub meaning: &'static str,
    /// Its value.
    pub of: fn(&Measured) -> Option<f64>,
}

/// All that is measured, in the order of tables.
pub const QUANTITIES: [Quantity; 18] = [
    Quantity {
        key: "sources",
        name: "sources",
        unit: "",
        meaning: "singularities outside the domain",
        of: |m| Some(m.sources as f64),
    },
    Quantity {
        key: "collocation",
        name: "collocation points",
        unit: "",
        meaning: "points of the boundary where equations are posed",
        of: |m| Some(m.collocation as f64),
    },
    Quantity {
        key: "unknowns",
        name: "unknowns",
        unit: "",
        meaning: "columns of the system: sources, and the four affine functions if they are in the basis",
        of: |m| Some(m.unknowns as f64),
    },
    Quantity {
        key: "c_error",
        name: "C-Error",
        unit: "diagonal²",
        meaning: "the paper's measure: Σ |f(p) − f′(p)|² over the collocation points p, over the target's diagonal squared",
        of: |m| Some(m.c_error),
    },
    Quantity {
        key: "residual_rms",
        name: "residual, rms",
        unit: "diagonal",
        meaning: "misfit at the collocation points, which the solver makes small, over the target's diagonal",
        of: |m| Some(m.residual_rms),
    },
    Quantity {
        key: "boundary_error_rms",
        name: "boundary error, rms",
        unit: "diagonal",
        meaning: "misfit at points of the boundary that the fit has not seen, over the target's diagonal; by the maximum \
                  principle no error inside is larger than the largest on the boundary",
        of: |m| Some(m.boundary_error.rms),
    },
    Quantity {
        key: "boundary_error_p99",
        name: "boundary error, 99 %",
        unit: "diagonal",
        meaning: "the same: 99 % of the area has no larger one",
        of: |m| Some(m.boundary_error.p99),
    },
    Quantity {
        key: "boundary_error_max",
        name: "boundary error, largest",
        unit: "diagonal",
        meaning: "the same: the largest that was found",
        of: |m| Some(m.boundary_error.max),
    },
    Quantity {
        key: "harmonic_energy",
        name: "harmonic energy",
        unit: "",
        meaning: "∫ |J|² with both solids scaled to volume 1; a similarity has 3",
        of: |m| Some(m.harmonic_energy),
    },
    Quantity {
        key: "harmonic_energy_error",
        name: "± harmonic energy",
        unit: "",
        meaning: "estimated error of that by integration",
        of: |m| m.harmonic_energy_error,
    },
    Quantity {
        key: "deformation_energy",
        name: "deformation energy",
        unit: "",
        meaning: "½ ∫ σ:ε with ε = JᵀJ − I and both solids scaled to volume 1; a similarity has 0",
        of: |m| Some(m.deformation_energy),
    },
    Quantity {
        key: "deformation_energy_error",
        name: "± deformation energy",
        unit: "",
        meaning: "estimated error of that by integration",
        of: |m| m.deformation_energy_error,
    },
    Quantity {
        key: "folded_fraction",
        name: "folded",
        unit: "of the volume",
        meaning: "where det J is zero or has not the sign of the target's orientation",
        of: |m| Some(m.folded_fraction),
    },
    Quantity {
        key: "condition",
        name: "condition number",
        unit: "",
        meaning: "largest singular value of the weighted and scaled system over the smallest; beyond 10¹⁵ it only says singular",
        of: |m| m.condition,
    },
    Quantity {
        key: "rank",
        name: "rank",
        unit: "",
        meaning: "singular values or pivots that are not cut off as zero",
        of: |m| m.rank.map(|rank| rank as f64),
    },
    Quantity {
        key: "surface_angle",
        name: "distortion of angles",
        unit: "×",
        meaning: "of the boundary map: σ₁ / σ₂, median over the area; 1 where angles are kept",
        of: |m| m.surface_angle,
    },
    Quantity {
        key: "surface_dirichlet",
        name: "symmetric Dirichlet energy",
        unit: "",
        meaning: "of the boundary map, scaled to one area: σ₁² + σ₂² + σ₁⁻² + σ₂⁻², mean over the area; an isometry has 4",
        of: |m| m.surface_dirichlet,
    },
    Quantity {
        key: "seconds",
        name: "time",
        unit: "s",
        meaning: "wall-clock time for fitting and measuring",
        of: |m| Some(m.seconds),
    },
];

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Measurements that differ from one another.
    pub fn sample() -> Measured {
        Measured {
            sources: 480,
            collocation: 800,
            unknowns: 484,
            c_error: 1.25e-7,
            residual_rms: 1e-5 / 3.0,
            boundary_error: BoundaryError {
                rms: 0.1,
                p99: 0.2,
                max: 0.3,
            },
            harmonic_energy: 3.25,
            harmonic_energy_error: None,
            deformation_energy: 0.5,
            deformation_energy_error: Some(0.01),
            folded_fraction: 0.0,
            condition: Some(1e18),
            rank: Some(300),
            surface_angle: None,
            surface_dirichlet: Some(f64::INFINITY),
            seconds: 2.5,
        }
    }

    #[test]
    fn measurements_survive_their_cells() {
        let measured = sample();
        let value = |key: &str| QUANTITIES.iter().find(|q| q.key == key).and_then(|q| (q.of)(&measured));
        assert_eq!(Measured::from_cells(value), Some(measured.clone()));
        assert_eq!(
            Measured::from_cells(|key| value(key).filter(|_| key != "c_error")),
            None
        );
        assert_eq!(measured.kept_fraction(), Some(300.0 / 484.0));
    }
}
