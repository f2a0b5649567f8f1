//! Energies and distortion of fitted maps.

use super::bridge::ffi;
use super::error::{Error, guarded};
use super::maps::Map;
use super::meshes::Cells;
use solidmap::energy::{
    DensityQuantiles, DistortionMetrics, DistortionReport, EnergyOptions, EnergyReport, GridResolution, Lame,
    Quadrature, clipped_grid, distortion, energies, tet_quadrature,
};

pub fn energies_on_grid(
    map: &Map,
    cells: usize,
    normalize: bool,
    lambda: f64,
    mu: f64,
) -> Result<ffi::EnergyReport, Error> {
    guarded(|| energies_over(map, &grid(map, cells)?, normalize, lambda, mu))
}

pub fn energies_in_tets(
    map: &Map,
    tets: &Cells,
    normalize: bool,
    lambda: f64,
    mu: f64,
) -> Result<ffi::EnergyReport, Error> {
    guarded(|| {
        let quadrature = tet_quadrature(&tets.tets("an energy")?)?;
        energies_over(map, &quadrature, normalize, lambda, mu)
    })
}

pub fn distortion_on_grid(map: &Map, cells: usize) -> Result<ffi::DistortionReport, Error> {
    guarded(|| distortion_over(map, &grid(map, cells)?))
}

pub fn distortion_in_tets(map: &Map, tets: &Cells) -> Result<ffi::DistortionReport, Error> {
    guarded(|| distortion_over(map, &tet_quadrature(&tets.tets("a distortion")?)?))
}

fn grid(map: &Map, cells: usize) -> Result<Quadrature, Error> {
    let resolution = GridResolution::CellsAlongLongestSide(cells);
    Ok(clipped_grid(map.boundary_map()?.domain(), resolution)?)
}

fn energies_over(
    map: &Map,
    quadrature: &Quadrature,
    normalize: bool,
    lambda: f64,
    mu: f64,
) -> Result<ffi::EnergyReport, Error> {
    if !(lambda.is_finite() && mu.is_finite()) {
        return Err(Error::invalid(format!(
            "lambda and mu are {lambda} and {mu}, but must be finite"
        )));
    }
    let options = EnergyOptions {
        normalize,
        lame: Lame { lambda, mu },
    };
    let target_volume = map.boundary_map()?.target_volume();
    let report: EnergyReport = energies(map.map(), quadrature, quadrature.volume(), target_volume, &options)?;
    let told = |d: &DensityQuantiles| ffi::Distribution {
        min: d.min,
        median: d.median,
        p99: d.p99,
        max: d.max,
    };
    Ok(ffi::EnergyReport {
        harmonic: report.harmonic,
        deformation: report.deformation,
        volume: report.volume,
        target_volume: report.target_volume,
        harmonic_density: told(&report.harmonic_density),
        deformation_density: told(&report.deformation_density),
        det_jacobian: told(&report.det_jacobian),
        inverted_points: report.inverted_points,
        inverted_fraction: report.inverted_fraction,
    })
}

fn distortion_over(map: &Map, quadrature: &Quadrature) -> Result<ffi::DistortionReport, Error> {
    let target_volume = map.boundary_map()?.target_volume();
    let report: DistortionReport = distortion(map.map(), quadrature, quadrature.volume(), target_volume)?;
    let value =
        |of: &Option<DistortionMetrics>, metric: fn(&DistortionMetrics) -> f64| of.as_ref().map_or(f64::NAN, metric);
    let told = |mean: &Option<DistortionMetrics>| ffi::Distortion {
        conformal: value(mean, |d| d.conformal),
        dirichlet: value(mean, |d| d.dirichlet),
        symmetric_dirichlet: value(mean, |d| d.symmetric_dirichlet),
        arap: value(mean, |d| d.arap),
        mips: value(mean, |d| d.mips),
    };
    Ok(ffi::DistortionReport {
        mean: told(&report.mean),
        mean_normalized: told(&report.mean_normalized),
        folded_points: report.determinants.map_or(0, |d| d.negative) + report.not_finite,
        left_out_fraction: report.left_out_fraction,
    })
}
