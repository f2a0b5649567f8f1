//! The numbers of a map's reports in a page.

use solidmap::energy::{DensityQuantiles, EnergyReport};
use solidmap::files::MapMetadata;

use crate::drawing::significant;
use crate::shared::page::NumberTable;
use crate::shared::places::percent;

/// A number with four significant digits.
fn four(value: f64) -> String {
    significant(value, 4)
}

/// What the energies of the map are.
pub fn energies(report: &EnergyReport) -> NumberTable {
    let mut table = NumberTable::new("Energy");
    table.row(
        "harmonic energy",
        four(report.harmonic),
        "",
        "integral of ‖J‖² with both solids at unit volume; 3 for a rigid motion",
    );
    table.row(
        "deformation energy",
        four(report.deformation),
        "",
        "integral of ½ σ:ε with both solids at unit volume; 0 for a rigid motion",
    );
    let folded = percent(report.folded.fraction);
    table.row(
        "folded",
        folded,
        "of the volume",
        "where det J has not the sign of the target's orientation",
    );
    table.row("volume of the domain", four(report.volume), "model units³", "");
    table.row(
        "volume of the target",
        four(report.target_volume),
        "model units³",
        "negative where the map mirrors the domain",
    );
    let mut quantiles = |name: &str, of: &DensityQuantiles, meaning: &str| {
        let values = [of.min, of.median, of.p99, of.max].map(four).join(" · ");
        table.row(
            name,
            values,
            "",
            format!("{meaning}: least · median · 99 % · most, by volume"),
        );
    };
    quantiles("harmonic energy density", &report.harmonic_density, "‖J‖²");
    quantiles("deformation energy density", &report.deformation_density, "½ σ:ε");
    quantiles("det J", &report.det_jacobian, "in model units");
    table
}

/// What the fit reported, if the file says so.
pub fn fit(metadata: &MapMetadata) -> Option<NumberTable> {
    let report = metadata.fit.as_ref()?;
    let mut table = NumberTable::new("Fit of the harmonic map");
    let diagonal = "of the target's diagonal";
    let error = &report.boundary_error;
    table.row(
        "boundary error, rms",
        four(error.rms),
        diagonal,
        "at boundary points that the fit has not seen",
    );
    table.row(
        "boundary error, 99 %",
        four(error.p99),
        diagonal,
        "99 % of the boundary's area is nearer to its image",
    );
    table.row(
        "boundary error, most",
        four(error.max),
        diagonal,
        "the largest at those points; creases have it",
    );
    table.row("boundary vertices", report.vertices.to_string(), "", "of the domain");
    table.row(
        "sources",
        report.sources.to_string(),
        "",
        "singularities outside the domain",
    );
    table.row(
        "collocation points",
        report.collocation.to_string(),
        "",
        "boundary points where equations are posed",
    );
    table.row("method", report.method.clone(), "", "of the solver");
    Some(table)
}
