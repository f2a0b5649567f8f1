//! `solidmap view`: a page to look into a map.

use anyhow::Context;
use serde::Serialize;
use solidmap::energy::{AdaptiveOptions, EnergyOptions, EnergyReport, adaptive_energies, cell_quadrature, energies};
use solidmap::mesh::CellMesh;

use crate::CommandOutcome;
use crate::args::ViewArgs;
use crate::shared::chosen_map::ChosenMap;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::map_page::MapPage;
use crate::shared::output::{Output, two_columns};
use crate::shared::page;

/// What `view --json` prints.
#[derive(Serialize)]
struct ViewSummary {
    file: FileName,
    kind: &'static str,
    output: FileName,
    /// Size of the page.
    bytes: usize,
    /// Samples of a map along each axis of its domain.
    samples: [usize; 3],
    /// Whether those are fewer than asked for, because of `--max-size`.
    coarser: bool,
}

/// Writes the page.
pub fn run(args: &ViewArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    input::require_writable(&args.output, &["html", "htm"], &[&args.file])?;
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.file)?;
    let chosen = ChosenMap::of(&file, &args.file, &args.choice)?;

    output.progress("integrating");
    let options = EnergyOptions::default();
    let energy =
        measured(chosen, &boundary, &options).with_context(|| format!("cannot measure `{}`", args.file.display()))?;
    let page = MapPage {
        path: &args.file,
        chosen,
        boundary: &boundary,
        metadata: &file.metadata,
        energy: &energy,
        options,
        up: args.up,
    };
    let made = page.make(&args.page, output)?;
    if made.is_coarser {
        let [nx, ny, nz] = made.samples;
        output.warn(format!(
            "the map is sampled more coarsely than asked for, at {nx} × {ny} × {nz} points, to keep to --max-size"
        ));
    }
    output.progress("writing");
    page::write(&args.output, &made.html)?;
    let report = ViewSummary {
        file: (&args.file).into(),
        kind: "map",
        output: (&args.output).into(),
        bytes: made.html.len(),
        samples: made.samples,
        coarser: made.is_coarser,
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::Done)
}

/// The energies of a map: a bijective one is integrated exactly by its own tetrahedra.
fn measured(
    chosen: ChosenMap,
    boundary: &solidmap::boundary_map::BoundaryMap,
    options: &EnergyOptions,
) -> anyhow::Result<EnergyReport> {
    let target_volume = boundary.target_volume();
    if let ChosenMap::Bijective(map) = chosen {
        let quadrature = cell_quadrature(&CellMesh::from(map.domain().clone()))?;
        return Ok(energies(map, &quadrature, quadrature.volume(), target_volume, options)?);
    }
    let accuracy = AdaptiveOptions::default();
    let (_, report) = adaptive_energies(chosen.map(), boundary.domain(), target_volume, options, &accuracy)?;
    Ok(report)
}

fn rows(report: &ViewSummary) -> Vec<[String; 2]> {
    let [nx, ny, nz] = report.samples;
    vec![
        ["samples".into(), format!("{nx} × {ny} × {nz}")],
        [
            "written".into(),
            format!("{} ({:.1} MB)", report.output.display(), report.bytes as f64 / 1e6),
        ],
    ]
}
