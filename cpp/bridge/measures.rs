//! Energies and distortion of fitted maps, and the plane sections that show them.

use std::ops::ControlFlow;

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, guarded};
use super::flat;
use super::maps::{Map, ask, share};
use super::meshes::{Surface, VolumeMesh, whole_points};
use solidmap::certificate::{CertificateOptions, CertificateProgress, StopReason, VerdictTotals, certify};
use solidmap::energy::{
    AdaptiveOptions, DensityQuantiles, DistortionMetrics, DistortionReport, EnergyErrors, EnergyOptions, EnergyReport,
    GridResolution, Lame, Quadrature, adaptive_energies, clipped_grid, densities, distortion, domain_mesh_quadrature,
    energies, worst_places,
};
use solidmap::fit;
use solidmap::geometry::{Axis, AxisPlane, PlaneSection};
use solidmap::map::with_cancellation;
use solidmap::mesh::CellMesh;
use solidmap::worst_places::{LISTED, PlaceKind, WorstPlace};

pub fn energies_on_grid(
    map: &Map,
    cells: usize,
    tolerance: f64,
    normalize: bool,
    lambda: f64,
    mu: f64,
    watcher: &Watcher,
) -> Result<ffi::EnergyReport, Error> {
    guarded(|| {
        let options = energy_options(normalize, lambda, mu)?;
        let accuracy = AdaptiveOptions {
            resolution: GridResolution::CellsAlongLongestSide(cells),
            tolerance,
            max_points: None,
        };
        let boundary = map.boundary_map()?;
        let (quadrature, report) = with_cancellation(map.map(), &|| integrating(watcher), |map| {
            adaptive_energies(map, boundary.domain(), boundary.target_volume(), &options, &accuracy)
        })??;
        Ok(converted(&report, &quadrature, None))
    })
}

pub fn energies_in_cells(
    map: &Map,
    mesh: &VolumeMesh,
    normalize: bool,
    lambda: f64,
    mu: f64,
    watcher: &Watcher,
) -> Result<ffi::EnergyReport, Error> {
    guarded(|| {
        let options = energy_options(normalize, lambda, mu)?;
        let boundary = map.boundary_map()?;
        let quadrature = domain_mesh_quadrature(&mesh.0, boundary.domain())?.quadrature;
        let target_volume = boundary.target_volume();
        let report = with_cancellation(map.map(), &|| integrating(watcher), |map| {
            energies(map, &quadrature, quadrature.volume(), target_volume, &options)
        })??;
        Ok(converted(&report, &quadrature, Some(&mesh.0)))
    })
}

pub fn energy_densities(
    map: &Map,
    points: &[f64],
    normalize: bool,
    lambda: f64,
    mu: f64,
) -> Result<ffi::EnergyDensities, Error> {
    guarded(|| {
        let options = energy_options(normalize, lambda, mu)?;
        let boundary = map.boundary_map()?;
        let (volume, target_volume) = (boundary.domain().volume(), boundary.target_volume());
        let points = whole_points("points", points)?;
        let found = densities(map.map(), points, volume, target_volume, &options)?;
        Ok(ffi::EnergyDensities {
            harmonic: found.harmonic,
            deformation: found.deformation,
            det_jacobian: found.det_jacobian,
        })
    })
}

pub fn plane_section(
    surface: &Surface,
    axis: u8,
    position: f64,
    up: u8,
    pixels: usize,
) -> Result<ffi::PlaneSection, Error> {
    let coordinate = |axis: u8| match axis {
        0 => Ok(Axis::X),
        1 => Ok(Axis::Y),
        2 => Ok(Axis::Z),
        _ => Err(Error::invalid(format!("the axis {axis} is not 0, 1 or 2"))),
    };
    guarded(|| {
        let plane = AxisPlane {
            axis: coordinate(axis)?,
            position,
        };
        let section = PlaneSection::new(&surface.0, plane, coordinate(up)?, pixels)?;
        let (pixels, coverage): (Vec<[usize; 2]>, Vec<f32>) = section.covered_pixels().unzip();
        Ok(ffi::PlaneSection {
            size: section.size(),
            pixel: section.pixel(),
            area: section.area(),
            points: flat(section.points()).to_vec(),
            pixels: pixels.into_iter().flatten().map(|k| k as u32).collect(),
            coverage,
        })
    })
}

pub fn distortion_on_grid(map: &Map, cells: usize, watcher: &Watcher) -> Result<ffi::DistortionReport, Error> {
    guarded(|| distortion_over(map, &grid(map, cells)?, watcher))
}

pub fn distortion_in_cells(map: &Map, mesh: &VolumeMesh, watcher: &Watcher) -> Result<ffi::DistortionReport, Error> {
    guarded(|| {
        let found = domain_mesh_quadrature(&mesh.0, map.boundary_map()?.domain())?;
        distortion_over(map, &found.quadrature, watcher)
    })
}

fn energy_options(normalize: bool, lambda: f64, mu: f64) -> Result<EnergyOptions, Error> {
    let lame = Lame { lambda, mu };
    if lambda.is_finite() && mu.is_finite() {
        Ok(EnergyOptions { normalize, lame })
    } else {
        Err(Error::invalid(format!(
            "lambda and mu are {lambda} and {mu}, but must be finite"
        )))
    }
}

fn integrating(watcher: &Watcher) -> ControlFlow<()> {
    ask(watcher, "integrating", f64::NAN, "")
}

fn grid(map: &Map, cells: usize) -> Result<Quadrature, Error> {
    let resolution = GridResolution::CellsAlongLongestSide(cells);
    Ok(clipped_grid(map.boundary_map()?.domain(), resolution)?)
}

/// What is proved where, in few enough words for C++.
pub fn certified(
    map: &Map,
    finest: usize,
    max_cells: usize,
    undecided: f64,
    watcher: &Watcher,
) -> Result<ffi::CertificateReport, Error> {
    guarded(|| {
        let options = CertificateOptions {
            finest,
            max_cells,
            undecided,
        };
        let boundary = map.boundary_map()?;
        let certificate = certify(
            map.map(),
            boundary.domain(),
            boundary.target_volume(),
            &options,
            &|CertificateProgress { level, done, of, .. }| {
                ask(watcher, "dividing cells", share(done, of), &format!("level {level}"))
            },
        )?;
        let report = certificate.report;
        let (folded, undecided) = (certificate.folded_places(), certificate.undecided_places());
        let totals = |found: &VerdictTotals, places| ffi::VerdictTotals {
            cells: found.cells,
            places,
            volume: found.volume,
            fraction: found.fraction,
        };
        Ok(ffi::CertificateReport {
            positive: totals(&report.positive, 0),
            folded: totals(&report.folded, folded.len()),
            undecided: totals(&report.undecided, undecided.len()),
            undecided_negative: report.undecided_negative,
            sigma_min_99: report.sigma_min_99.unwrap_or(f64::NAN),
            locally_one_to_one: report.stop_reason == StopReason::AllDecided && report.folded.cells == 0,
            mirrored_parts: report.mirrored.count,
            parts: report.mirrored.parts,
            worst_places: folded.iter().chain(&undecided).take(LISTED).map(worst_place).collect(),
        })
    })
}

pub fn worst_boundary_errors(map: &Map, most: usize) -> Result<Vec<ffi::WorstPlace>, Error> {
    guarded(|| {
        let found = fit::worst_places(map.map(), map.boundary_map()?, most);
        Ok(found.iter().map(worst_place).collect())
    })
}

/// A place with the number of its kind in C++.
pub fn worst_place(place: &WorstPlace) -> ffi::WorstPlace {
    ffi::WorstPlace {
        kind: match place.kind {
            PlaceKind::Folded => 0,
            PlaceKind::Undecided => 1,
            PlaceKind::EnergyDensity => 2,
            PlaceKind::Inverted => 3,
            // Checks of boundary maps, which have other kinds, are not passed to C++.
            _ => 4,
        },
        count: place.count,
        point: place.point,
        centre: place.centre,
        low: place.low,
        high: place.high,
        measure: place.measure,
        share: place.share,
        value: place.value.unwrap_or(f64::NAN),
    }
}

fn converted(report: &EnergyReport, quadrature: &Quadrature, mesh: Option<&CellMesh>) -> ffi::EnergyReport {
    let quantiles = |d: &DensityQuantiles| ffi::Distribution {
        min: d.min,
        median: d.median,
        p99: d.p99,
        max: d.max,
    };
    let error = |of: fn(&EnergyErrors) -> f64| report.errors.as_ref().map_or(f64::NAN, of);
    ffi::EnergyReport {
        harmonic: report.harmonic,
        deformation: report.deformation,
        harmonic_error: error(|errors| errors.harmonic),
        deformation_error: error(|errors| errors.deformation),
        volume: report.volume,
        target_volume: report.target_volume,
        harmonic_density: quantiles(&report.harmonic_density),
        deformation_density: quantiles(&report.deformation_density),
        det_jacobian: quantiles(&report.det_jacobian),
        folded_points: report.folded.points,
        folded_fraction: report.folded.fraction,
        folded_error: report.folded.error.unwrap_or(f64::NAN),
        worst_places: worst_places(quadrature, &report.densities, report.target_volume, mesh, LISTED)
            .iter()
            .map(worst_place)
            .collect(),
    }
}

fn distortion_over(map: &Map, quadrature: &Quadrature, watcher: &Watcher) -> Result<ffi::DistortionReport, Error> {
    let target_volume = map.boundary_map()?.target_volume();
    let report: DistortionReport = with_cancellation(map.map(), &|| integrating(watcher), |map| {
        distortion(map, quadrature, quadrature.volume(), target_volume)
    })??;
    let value =
        |of: &Option<DistortionMetrics>, metric: fn(&DistortionMetrics) -> f64| of.as_ref().map_or(f64::NAN, metric);
    let converted = |mean: &Option<DistortionMetrics>| ffi::Distortion {
        conformal: value(mean, |d| d.conformal),
        dirichlet: value(mean, |d| d.dirichlet),
        symmetric_dirichlet: value(mean, |d| d.symmetric_dirichlet),
        arap: value(mean, |d| d.arap),
        mips: value(mean, |d| d.mips),
    };
    Ok(ffi::DistortionReport {
        mean: converted(&report.mean),
        mean_normalized: converted(&report.mean_normalized),
        folded_points: report.determinants.map_or(0, |d| d.negative) + report.not_finite,
        left_out_fraction: report.left_out_fraction,
    })
}
