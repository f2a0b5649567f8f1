//! `solidmap energy`: the energies of a map, and how they are distributed.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::energy::{
    DensityQuantiles, EnergyErrors, EnergyOptions, EnergyReport, Quadrature, adaptive_energies, cell_quadrature,
    domain_mesh_quadrature, energies, worst_places,
};
use solidmap::files;
use solidmap::geometry::distance_field;
use solidmap::io;
use solidmap::mesh::CellMesh;
use solidmap::worst_places::WorstPlace;

use crate::CommandOutcome;
use crate::args::EnergyArgs;
use crate::drawing::{Figure, significant};
use crate::shared::chosen_map::{ChosenMap, MapName};
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::map_page::MapPage;
use crate::shared::output::{Output, two_columns, write_file};
use crate::shared::page;
use crate::shared::pictures::Pictured;
use crate::shared::places::{percent, with_places};

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 640;

/// What `energy --json` prints.
#[derive(Serialize)]
struct EnergySummary {
    map: FileName,
    map_kind: MapName,
    cells: usize,
    points: usize,
    #[serde(flatten)]
    energy: EnergyReport,
    worst_places: Vec<WorstPlace>,
}

/// Measures the energies of a map, and writes and pictures their densities.
pub fn run(args: &EnergyArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    args.section.require_valid()?;
    let options = EnergyOptions {
        normalize: !args.no_normalize,
        lame: args.lame.constants()?,
    };
    let inputs: Vec<&Path> = std::iter::once(&args.map)
        .chain(&args.mesh)
        .map(PathBuf::as_path)
        .collect();
    input::require_all_writable(
        &[
            (args.vtu.as_ref(), &["vtu"]),
            (args.png.as_ref(), &["png"]),
            (args.html.as_ref(), &page::EXTENSIONS),
        ],
        &inputs,
    )?;
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let target = boundary.outward_target();
    let chosen = ChosenMap::of(&file, &args.map, &args.choice)?;
    // Its own tetrahedra integrate a map exactly that is linear over them.
    let own = match (chosen, &args.mesh) {
        (ChosenMap::Bijective(map), None) => Some(CellMesh::from(map.domain().clone())),
        _ => None,
    };
    let given = args.mesh.as_ref().map(io::read_cells).transpose()?;

    ensure!(
        args.no_normalize || target.volume() > 1e-12 * target.diagonal().powi(3),
        "the target of `{}` encloses no volume that could be scaled to one; use --no-normalize",
        args.map.display()
    );
    output.progress("integrating");
    let target_volume = boundary.target_volume();
    let cannot_measure_map = || format!("cannot measure `{}`", args.map.display());
    let over = |quadrature: Quadrature| {
        let energy = energies(chosen.map(), &quadrature, quadrature.volume(), target_volume, &options);
        anyhow::Ok((quadrature, energy.with_context(cannot_measure_map)?))
    };
    let (quadrature, energy) = match (&given, &args.mesh, &own) {
        (Some(mesh), Some(path), _) => {
            let cannot_measure = || format!("cannot measure over the mesh `{}`", path.display());
            let found = domain_mesh_quadrature(mesh, boundary.domain()).with_context(cannot_measure)?;
            found.warnings.into_iter().for_each(|warning| output.warn(warning));
            over(found.quadrature)?
        }
        (_, _, Some(own)) => over(cell_quadrature(own).with_context(cannot_measure_map)?)?,
        _ => adaptive_energies(
            chosen.map(),
            boundary.domain(),
            target_volume,
            &options,
            &args.accuracy.options(),
        )
        .with_context(cannot_measure_map)?,
    };
    let mesh = given.or(own);
    if let Some(errors) = energy.errors.filter(|errors| !errors.within_tolerance) {
        output.warn(format!(
            "--energy-tolerance is {}, but the errors are estimated at {:.1} % of the harmonic and {:.1} % of the \
             deformation energy; a larger --resolution allows more points",
            args.accuracy.tolerance(),
            100.0 * errors.harmonic / energy.harmonic,
            100.0 * errors.deformation / energy.deformation
        ));
    }

    if let Some(path) = &args.vtu {
        output.progress("writing");
        let distances = distance_field(&target, &chosen.map().evaluate(quadrature.points()))?;
        let fields = files::energy_fields(&energy.densities, &distances);
        files::write_cell_means(path, &quadrature, mesh.as_ref(), &fields)?;
    }
    if let Some(path) = &args.png {
        output.progress("drawing");
        let pictured = Pictured {
            map: chosen.map(),
            domain: boundary.domain(),
            target: &target,
            options,
            up: args.section.up,
            colours: args.section.colours(),
        };
        let panels = pictured.section(args.section.plane(boundary.domain()), SECTION_PIXELS)?;
        write_file(path, &Figure::row(panels).to_png()?)?;
    }
    if let Some(path) = &args.html {
        let page = MapPage {
            path: &args.map,
            chosen,
            boundary: &boundary,
            metadata: &file.metadata,
            energy: &energy,
            options,
            up: args.section.up,
            certificate: None,
            carried: None,
        };
        page::write(path, &page.make(&args.page, output)?.html)?;
    }

    let cells = quadrature.cell_means(&energy.densities.harmonic).len();
    let report = EnergySummary {
        map: (&args.map).into(),
        map_kind: chosen.name(),
        cells,
        points: quadrature.points().len(),
        worst_places: worst_places(
            &quadrature,
            &energy.densities,
            target_volume,
            mesh.as_ref(),
            args.places.worst,
        ),
        energy,
    };
    output.result(&report, || {
        let mut rows = energy_rows(&report.energy);
        for path in [&args.vtu, &args.png, &args.html].into_iter().flatten() {
            rows.push(["written".into(), path.display().to_string()]);
        }
        with_places(two_columns(rows), &report.worst_places)
    })?;
    let is_accurate = report.energy.errors.is_none_or(|errors| errors.within_tolerance);
    Ok(CommandOutcome::from_check(is_accurate))
}

/// The lines of the summary that say what energies a map has.
fn energy_rows(energy: &EnergyReport) -> Vec<[String; 2]> {
    let scaled = if energy.normalized {
        "both solids at unit volume"
    } else {
        "in model units"
    };
    let (harmonic, deformation, det) = (
        &energy.harmonic_density,
        &energy.deformation_density,
        &energy.det_jacobian,
    );
    let row = |name: &str, total: f64, error: Option<f64>, d: &DensityQuantiles| {
        let error = error.map_or(String::new(), |error| format!("± {error:.1e}"));
        [
            name.to_owned(),
            format!(
                "{:<12} {error:<10} density {:.3e} to {:.3e}, median {:.3e}",
                significant(total, 6),
                d.min,
                d.max,
                d.median
            ),
        ]
    };
    let error = |of: fn(&EnergyErrors) -> f64| energy.errors.as_ref().map(of);
    vec![
        row(
            "harmonic energy",
            energy.harmonic,
            error(|errors| errors.harmonic),
            harmonic,
        ),
        row(
            "deformation energy",
            energy.deformation,
            error(|errors| errors.deformation),
            deformation,
        ),
        [String::new(), scaled.into()],
        [
            "volume".into(),
            format!(
                "{} → {}",
                significant(energy.volume, 6),
                significant(energy.target_volume, 6)
            ),
        ],
        [
            "det J".into(),
            format!("{:.3e} to {:.3e}, median {:.3e}", det.min, det.max, det.median),
        ],
        [
            "folded".into(),
            format!(
                "{}{} of the volume, {} points",
                percent(energy.folded.fraction),
                energy
                    .folded
                    .error
                    .map_or(String::new(), |error| format!(" ± {}", percent(error))),
                energy.folded.points
            ),
        ],
    ]
}
