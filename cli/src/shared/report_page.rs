//! The page of a report: a picture, words and tables. It needs no WebGL.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use solidmap::files::Provenance;

use super::page::Page;
use crate::drawing::TableContent;

/// A report to make a page of.
pub struct ReportPage<'a> {
    /// The title.
    pub title: String,
    /// A picture, where there is one.
    pub picture: Option<ReportPicture<'a>>,
    /// What stands below it, in order.
    pub parts: Vec<ReportPart>,
    /// The files that it is made from.
    pub files: Vec<Provenance>,
    /// What readers must know.
    pub notes: Vec<String>,
}

/// A picture, and the same in words for who does not see it.
pub struct ReportPicture<'a> {
    /// The bytes of a PNG file.
    pub png: &'a [u8],
    /// The words.
    pub alternative: &'a str,
}

/// A piece of a report.
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "kind", content = "content", rename_all = "snake_case")]
pub enum ReportPart {
    /// The heading of what follows.
    Title(String),
    /// Paragraphs, one on each line.
    Words(String),
    Table(ReportTable),
}

/// A table; a row with fewer entries than columns ends with one that fills the rest of its line.
#[derive(Debug, Clone, Serialize)]
pub struct ReportTable {
    #[serde(flatten)]
    pub content: TableContent,
    /// How many entries at the beginning of a row say what it is about.
    pub named: usize,
    /// What the columns mean, in one line each, or nothing.
    pub meanings: Vec<&'static str>,
}

/// What the scripts of the page read.
#[derive(Serialize)]
struct ReportContent<'a> {
    kind: &'static str,
    picture: Option<PictureContent<'a>>,
    parts: &'a [ReportPart],
}

#[derive(Serialize)]
struct PictureContent<'a> {
    /// An address that holds the picture itself.
    address: String,
    alternative: &'a str,
}

impl ReportPage<'_> {
    /// The text of the page.
    pub fn html(self) -> anyhow::Result<String> {
        let content = ReportContent {
            kind: "report",
            picture: self.picture.map(|picture| PictureContent {
                address: format!("data:image/png;base64,{}", STANDARD.encode(picture.png)),
                alternative: picture.alternative,
            }),
            parts: &self.parts,
        };
        let page = Page {
            title: self.title,
            files: self.files,
            notes: self.notes,
            tables: vec![],
            arrays: vec![],
        };
        Ok(page.html(&content)?)
    }
}
