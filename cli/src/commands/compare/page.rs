//! The page of a comparison: its picture, all words and tables, and where they come from.

use solidmap::files::Provenance;

use super::Comparison;
use super::pictures::ComparisonPicture;
use super::runner::Runner;
use super::tables::{Part, parts};
use crate::drawing::{Align, TableContent};
use crate::shared::input;
use crate::shared::report_page::{ReportPage, ReportPart, ReportPicture, ReportTable};

/// The text of the page; there is no picture where no map could be made. `notes` are what readers must know.
pub fn html(
    runner: &Runner,
    comparison: &Comparison,
    picture: Option<&ComparisonPicture>,
    notes: Vec<String>,
) -> anyhow::Result<String> {
    let image = runner.source.image();
    let name = image.file_name().unwrap_or(image.as_os_str()).to_string_lossy();
    let page = ReportPage {
        title: format!("{name}: one boundary map by several methods"),
        picture: picture.map(|picture| ReportPicture {
            png: &picture.png,
            alternative: &picture.alternative,
        }),
        parts: parts(comparison).into_iter().map(ReportPart::from).collect(),
        files: files(runner)?,
        notes,
    };
    page.html()
}

impl From<Part> for ReportPart {
    fn from(part: Part) -> Self {
        match part {
            Part::Title(title) => Self::Title(title.into()),
            Part::Words(words) => Self::Words(words),
            Part::Table(content) => Self::Table(ReportTable {
                named: named(&content),
                content,
                meanings: vec![],
            }),
        }
    }
}

/// Words come first in a row: the method, and how it was varied.
fn named(content: &TableContent) -> usize {
    let words = content.columns.iter().take_while(|column| column.align == Align::Left);
    words.count()
}

/// The files that were read. Frames that cannot be read are named among those that were left out.
fn files(runner: &Runner) -> anyhow::Result<Vec<Provenance>> {
    let tets = runner.args.tets.mesh.as_deref().map(|path| ("tets", path));
    let named = runner.source.files_by_role().into_iter().chain(tets);
    let mut files: Vec<Provenance> = named
        .map(|(role, path)| input::provenance(role, path))
        .collect::<anyhow::Result<_>>()?;
    let frames = runner.args.frames.iter();
    files.extend(frames.filter_map(|path| input::provenance("frame", path).ok()));
    Ok(files)
}
