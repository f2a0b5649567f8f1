//! What `solidmap sequence` measured of each frame, from its table.

use std::path::Path;

use anyhow::{Context, ensure};
use serde::Serialize;

/// The table beside the collection.
pub const TABLE: &str = "energy.csv";

/// A column that is drawn as a curve.
pub struct Quantity {
    /// Its head in the table.
    pub column: &'static str,
    pub label: &'static str,
    pub meaning: &'static str,
}

/// The columns that are drawn, the first one at first.
pub const QUANTITIES: [Quantity; 6] = [
    Quantity {
        column: "deformation_energy",
        label: "deformation energy",
        meaning: "mean of ½ σ : ε over the reference: the distance from its shape; a rigid motion has none",
    },
    Quantity {
        column: "harmonic_energy",
        label: "harmonic energy",
        meaning: "mean of ‖J‖² over the reference; 3 for a rigid motion",
    },
    Quantity {
        column: "deformation_density_p99",
        label: "deformation energy density, 99 %",
        meaning: "99 % of the volume have less",
    },
    Quantity {
        column: "boundary_error_p99",
        label: "boundary error, 99 %",
        meaning: "99 % of the boundary are met at least so well, as a fraction of the frame's diagonal",
    },
    Quantity {
        column: "folded_fraction",
        label: "folded share",
        meaning: "share of the volume where the map is folded",
    },
    Quantity {
        column: "volume_ratio",
        label: "volume ratio",
        meaning: "volume over the reference's",
    },
];

/// A row of the table.
#[derive(Debug, Clone, Serialize)]
pub struct EnergyRow {
    pub frame: usize,
    pub time: f64,
    /// Name of the file that the frame was read from, without its folder.
    pub file: String,
    /// One value for each of [`QUANTITIES`], in their order; NaN where the frame was skipped.
    #[serde(skip)]
    pub values: Vec<f64>,
    /// Why it was skipped; empty where it was not.
    pub skipped: String,
}

/// Reads the table.
pub fn read(path: &Path) -> anyhow::Result<Vec<EnergyRow>> {
    let shown = path.display();
    let advice = "run `solidmap sequence` again, or move it away to see the frames without it";
    let mut reader = csv::Reader::from_path(path).with_context(|| format!("cannot read `{shown}`; {advice}"))?;
    let heads = reader
        .headers()
        .with_context(|| format!("cannot read `{shown}`; {advice}"))?
        .clone();
    let column = |name: &str| {
        let found = heads.iter().position(|head| head == name);
        found.with_context(|| format!("`{shown}` has no column `{name}`; {advice}"))
    };
    let [frame, time, file, skipped] = [column("frame")?, column("time")?, column("file")?, column("skipped")?];
    let columns: Vec<usize> = QUANTITIES
        .iter()
        .map(|quantity| column(quantity.column))
        .collect::<anyhow::Result<_>>()?;
    let mut rows: Vec<EnergyRow> = Vec::new();
    for record in reader.records() {
        let record = record.with_context(|| format!("cannot read `{shown}`; {advice}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        let text = |column: usize| record.get(column).unwrap_or_default();
        let number = |column: usize| {
            let found = text(column).parse::<f64>();
            let head = &heads[column];
            found.with_context(|| format!("line {line} of `{shown}`: `{}` is no {head}; {advice}", text(column)))
        };
        let values = match text(skipped) {
            "" => columns
                .iter()
                .map(|&column| number(column))
                .collect::<anyhow::Result<_>>()?,
            _ => vec![f64::NAN; columns.len()],
        };
        let row = EnergyRow {
            frame: number(frame)? as usize,
            time: number(time)?,
            file: Path::new(text(file))
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            values,
            skipped: text(skipped).to_owned(),
        };
        ensure!(
            rows.last().is_none_or(|before| before.time < row.time),
            "line {line} of `{shown}`: times do not ascend; {advice}"
        );
        rows.push(row);
    }
    Ok(rows)
}
