//! The page of a map.

use anyhow::Context;
use solidmap::energy::EnergyOptions;

use super::Shown;
use crate::args::ViewArgs;
use crate::shared::chosen_map::ChosenMap;
use crate::shared::input;
use crate::shared::map_page::{MapPage, measured};
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
        certificate: None,
        carried: None,
    };
    let made = page.make(&args.page, output)?;
    let shown = Shown::Map {
        samples: made.samples,
        coarser: made.is_coarser,
    };
    Ok((made.html, shown))
}
