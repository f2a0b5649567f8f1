//! `solidmap boundary check`: is a boundary map one to one, and how far does it distort?

use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::fit::self_intersection_finder;
use solidmap::io;

use super::pictures;
use crate::CommandOutcome;
use crate::args::BoundaryCheckArgs;
use crate::shared::boundary_page::BoundaryPage;
use crate::shared::input;
use crate::shared::input::BoundarySource;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, peak_rss_bytes, write_file};
use crate::shared::page;

/// What `boundary check --json` prints.
#[derive(Serialize)]
struct BoundaryCheckSummary {
    domain: Option<FileName>,
    image: Option<FileName>,
    boundary_file: Option<FileName>,
    target: Option<FileName>,
    #[serde(flatten)]
    check: BoundaryCheck,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Reads, checks, draws and reports; findings make the exit code 1.
pub fn run(args: &BoundaryCheckArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    anyhow::ensure!(
        args.tolerance.is_finite() && args.tolerance >= 0.0,
        "--tolerance is {}, but must be a fraction of the target's diagonal, such as 0.01",
        args.tolerance
    );
    let source = source(args)?;
    let mut inputs = source.files();
    inputs.extend(args.target.as_deref());
    input::require_all_writable(
        &[(args.png.as_ref(), &["png"]), (args.html.as_ref(), &page::EXTENSIONS)],
        &inputs,
    )?;
    output.progress("reading");
    let map = source.read()?;
    let target = args.target.as_deref().map(input::read_surface).transpose()?;
    output.progress("checking");
    let options = BoundaryCheckOptions {
        tolerance: args.tolerance,
        seed: args.seed,
        worst_places: args.places.worst,
        ..BoundaryCheckOptions::default()
    };
    let check = check(&map, target.as_ref(), &options, self_intersection_finder())
        .with_context(|| format!("cannot check `{}`", source.image().display()))?;
    if let Some(png) = &args.png {
        output.progress("drawing");
        let figure = pictures::boundary(&map, &check, [args.up, args.target_up.or(args.up)])?;
        write_file(png, &figure.to_png()?)?;
        output.note(format_args!("picture in {}", png.display()));
    }
    if let Some(path) = &args.html {
        let files = source.files_by_role().into_iter();
        let files: anyhow::Result<_> = files.map(|(role, path)| input::provenance(role, path)).collect();
        let page = BoundaryPage {
            path: source.image(),
            boundary: &map,
            check: &check,
            files: files?,
            up: args.up,
        };
        page::write(path, &page.make(&args.page)?.html)?;
        output.note(format_args!("page in {}", path.display()));
    }
    let (domain, image, boundary_file) = match &source {
        BoundarySource::Image { domain, image } => (Some(domain.clone()), Some(image.clone()), None),
        BoundarySource::File { file, domain } => (domain.clone(), None, Some(file.clone())),
    };
    let report = BoundaryCheckSummary {
        domain: file_name(domain),
        image: file_name(image),
        boundary_file: file_name(boundary_file),
        target: file_name(args.target.as_ref()),
        check,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || {
        let files: Vec<String> = source.files().iter().map(|path| path.display().to_string()).collect();
        format!("{}\n{}", files.join(" → "), report.check)
    })?;
    Ok(CommandOutcome::from_check(report.check.findings.is_empty()))
}

/// Files that are not meshes are boundary files, which hold their domain.
fn source(args: &BoundaryCheckArgs) -> anyhow::Result<BoundarySource> {
    let (first, second) = (args.domain.clone(), args.image.clone());
    Ok(match second {
        Some(image) if io::is_mesh(&image) || input::is_node_images(&image) => {
            BoundarySource::Image { domain: first, image }
        }
        Some(file) => BoundarySource::File {
            file,
            domain: Some(first),
        },
        None if io::is_mesh(&first) && first.exists() => anyhow::bail!(
            "`{}` is a mesh, not a map of one: give its image as well, or a boundary file",
            first.display()
        ),
        None => BoundarySource::File {
            file: first,
            domain: None,
        },
    })
}
