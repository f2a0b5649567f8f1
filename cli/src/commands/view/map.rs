//! The page of a map.

use anyhow::Context;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{AdaptiveOptions, EnergyOptions, EnergyReport, adaptive_energies, cell_quadrature, energies};
use solidmap::mesh::CellMesh;

use super::Shown;
use crate::args::ViewArgs;
use crate::shared::chosen_map::ChosenMap;
use crate::shared::input;
use crate::shared::map_page::MapPage;
use crate::shared::output::Output;

/// The text of the page.
pub fn page(args: &ViewArgs, output: &Output) -> anyhow::Result<(String, Shown)> {
    let (file, boundary) = input::read_fitted_map(&args.file)?;
    let chosen = ChosenMap::of(&file, &args.file, &args.choice)?;
    output.progress("integrating");
    let options = EnergyOptions::default();
    let cannot_measure = || format!("cannot measure `{}`", args.file.display());
    let energy = measured(chosen, &boundary, &options).with_context(cannot_measure)?;
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
    let shown = Shown::Map {
        samples: made.samples,
        coarser: made.is_coarser,
    };
    Ok((made.html, shown))
}

/// The energies of a map: a bijective one is integrated exactly by its own tetrahedra.
fn measured(chosen: ChosenMap, boundary: &BoundaryMap, options: &EnergyOptions) -> anyhow::Result<EnergyReport> {
    let target_volume = boundary.target_volume();
    if let ChosenMap::Bijective(map) = chosen {
        let quadrature = cell_quadrature(&CellMesh::from(map.domain().clone()))?;
        return Ok(energies(map, &quadrature, quadrature.volume(), target_volume, options)?);
    }
    let accuracy = AdaptiveOptions::default();
    let (_, report) = adaptive_energies(chosen.map(), boundary.domain(), target_volume, options, &accuracy)?;
    Ok(report)
}
