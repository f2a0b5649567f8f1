//! The page of a study: its picture, and a table of all rows with units and explanations.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use solidmap::files::Provenance;

use super::measured::{Measured, QUANTITIES, Quantity};
use super::results::Row;
use crate::drawing::significant;
use crate::shared::page::Page;

/// What the scripts of the page read.
#[derive(Serialize)]
struct StudyContent {
    kind: &'static str,
    /// An address that holds the picture itself.
    picture: String,
    alternative: &'static str,
    /// Names of the columns of the settings.
    varied: Vec<String>,
    quantities: Vec<Explained>,
    rows: Vec<PageRow>,
}

#[derive(Serialize)]
struct Explained {
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
}

#[derive(Serialize)]
struct PageRow {
    varied: Vec<String>,
    values: Vec<String>,
    error: Option<String>,
}

/// A study to make a page of.
pub struct StudyPage<'a> {
    /// The title.
    pub title: String,
    /// The picture, as the bytes of a PNG file.
    pub picture: &'a [u8],
    /// The same in words.
    pub alternative: &'static str,
    /// The files that the maps come from.
    pub files: Vec<Provenance>,
    /// What readers must know.
    pub notes: Vec<String>,
}

impl StudyPage<'_> {
    /// The text of the page, with the cells of each row's setting. Quantities that no row has are left out.
    pub fn html<'r, S: 'r>(
        self,
        varied: &[&str],
        rows: impl Iterator<Item = (Vec<String>, &'r Row<S>)>,
    ) -> anyhow::Result<String> {
        let rows: Vec<(Vec<String>, &Row<S>)> = rows.collect();
        let has = |quantity: &&Quantity| {
            let mut found = rows.iter().filter_map(|(_, row)| row.found.as_ref());
            found.any(|measured| (quantity.of)(measured).is_some())
        };
        let quantities: Vec<&Quantity> = QUANTITIES.iter().filter(has).collect();
        let values = |measured: &Measured| {
            let shown =
                |quantity: &&Quantity| (quantity.of)(measured).map_or("–".into(), |value| significant(value, 4));
            quantities.iter().map(shown).collect()
        };
        let content = StudyContent {
            kind: "study",
            picture: format!("data:image/png;base64,{}", STANDARD.encode(self.picture)),
            alternative: self.alternative,
            varied: varied.iter().map(|name| name.replace('_', "-")).collect(),
            rows: rows
                .iter()
                .map(|(cells, row)| PageRow {
                    varied: cells.clone(),
                    values: row.found.as_ref().map(values).unwrap_or_default(),
                    error: row.error.clone(),
                })
                .collect(),
            quantities: quantities
                .iter()
                .map(|quantity| Explained {
                    name: quantity.name,
                    unit: quantity.unit,
                    meaning: quantity.meaning,
                })
                .collect(),
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
