//! `solidmap view`: a page to look into a map, a mesh, a boundary map or a sequence.

mod boundary;
mod map;
mod mesh;
mod sequence;

use serde::Serialize;
use solidmap::files;
use solidmap::io;

use crate::CommandOutcome;
use crate::args::ViewArgs;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, two_columns};
use crate::shared::page;
use crate::shared::sequence_page;

/// What `view --json` prints.
#[derive(Serialize)]
struct ViewSummary {
    file: FileName,
    output: FileName,
    /// Size of the page.
    bytes: usize,
    #[serde(flatten)]
    shown: Shown,
}

/// What a page shows.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Shown {
    Map {
        /// Samples along each axis of the domain.
        samples: [usize; 3],
        /// Whether those are fewer than asked for, because of `--max-size`.
        coarser: bool,
    },
    Mesh {
        cells: usize,
        inverted_cells: usize,
    },
    Boundary {
        faces: usize,
        flipped: usize,
    },
    Sequence {
        frames: usize,
        /// Frames that are in the page: fewer where `--max-size` asks for it.
        shown: usize,
        faces: usize,
    },
}

/// Writes the page.
pub fn run(args: &ViewArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    input::require_writable(&args.output, &page::EXTENSIONS, &[&args.file])?;
    output.progress("reading");
    let (html, shown) = if sequence_page::is_sequence(&args.file) {
        sequence::page(args, output)?
    } else if io::is_mesh(&args.file) {
        mesh::page(args, output)?
    } else {
        // What is neither is told as what most users mean.
        match files::read_boundary(&args.file) {
            Ok(file) => boundary::page(args, &file, output)?,
            Err(_) => map::page(args, output)?,
        }
    };
    output.progress("writing");
    page::write(&args.output, &html)?;
    let report = ViewSummary {
        file: (&args.file).into(),
        output: (&args.output).into(),
        bytes: html.len(),
        shown,
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::Done)
}

fn rows(report: &ViewSummary) -> Vec<[String; 2]> {
    let shown = match report.shown {
        Shown::Map {
            samples: [nx, ny, nz], ..
        } => ["samples", &format!("{nx} × {ny} × {nz}")],
        Shown::Mesh { cells, inverted_cells } => ["cells", &format!("{cells}, of which {inverted_cells} inverted")],
        Shown::Boundary { faces, flipped } => ["triangles", &format!("{faces}, of which {flipped} inverted")],
        Shown::Sequence { frames, shown, faces } => {
            let shown = if shown < frames {
                format!(", of which {shown} are in the page")
            } else {
                String::new()
            };
            ["frames", &format!("{frames} of {faces} triangles{shown}")]
        }
    };
    let size = page::megabytes(report.bytes as u64);
    vec![
        shown.map(String::from),
        ["written".into(), format!("{} ({size:.1} MB)", report.output.display())],
    ]
}
