//! `compare --metrics`: the metrics of VOLMAP for a map that is given as two meshes of the same tetrahedra.

use std::path::Path;

use anyhow::Context;
use serde::Serialize;
use solidmap::energy::{VolmapMetrics, volmap_metrics};
use solidmap::io;

use crate::CommandOutcome;
use crate::args::CompareArgs;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, two_columns, write_file};

/// What `compare --metrics --json` prints.
#[derive(Serialize)]
struct MetricsSummary {
    domain: FileName,
    image: FileName,
    metrics: VolmapMetrics,
    output: FileName,
}

/// Measures the map from one mesh to the other, and writes a table of one row.
pub fn run(args: &CompareArgs, path: &Path, output: &Output) -> anyhow::Result<CommandOutcome> {
    let (domain, image) = args.files.domain.as_deref().zip(args.files.image.as_deref()).context(
        "--metrics measures a map from mesh to mesh: give DOMAIN and --image, two meshes of the same tetrahedra",
    )?;
    input::require_writable(path, &["csv"], &[domain, image])?;
    output.progress("reading");
    let (source, target) = rayon::join(|| io::read_tets(domain), || io::read_tets(image));
    let (source, target) = (source?, target?);
    anyhow::ensure!(
        source.tets() == target.tets() && source.vertices().len() == target.vertices().len(),
        "`{}` and `{}` are not meshes of the same tetrahedra in the same order",
        domain.display(),
        image.display()
    );
    output.progress("measuring");
    let metrics =
        volmap_metrics(&source, target.vertices()).with_context(|| format!("cannot measure `{}`", image.display()))?;
    // The name first, as in VOLMAP's own tables.
    let names = ["map".to_owned()].into_iter().chain(VolmapMetrics::columns());
    let name = image.to_string_lossy().into_owned();
    let values = metrics
        .row()
        .into_iter()
        .map(|x| if x.is_nan() { String::new() } else { x.to_string() });
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(names)?;
    table.write_record([name].into_iter().chain(values))?;
    write_file(path, &table.into_inner().context("cannot make the table")?)?;
    let report = MetricsSummary {
        domain: domain.into(),
        image: image.into(),
        metrics,
        output: path.into(),
    };
    output.result(&report, || {
        let numbers = VolmapMetrics::columns().into_iter().zip(report.metrics.row());
        let mut rows: Vec<[String; 2]> = numbers.map(|(name, value)| [name, value.to_string()]).collect();
        rows.push(["written".to_owned(), path.display().to_string()]);
        two_columns(rows)
    })?;
    Ok(CommandOutcome::from_check(report.metrics.inverted == 0))
}
