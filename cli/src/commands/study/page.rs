//! The page of a study: its picture, and a table of all rows with units and explanations.

use solidmap::files::Provenance;

use super::measured::{Measured, QUANTITIES, Quantity};
use super::results::Row;
use crate::drawing::{Align, Table, TableColumn, TableContent, significant};
use crate::shared::report_page::{ReportPage, ReportPart, ReportPicture, ReportTable};

/// A study to make a page of.
pub struct StudyPage<'a> {
    /// The title.
    pub title: String,
    /// The picture.
    pub picture: ReportPicture<'a>,
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
        let page = ReportPage {
            title: self.title,
            picture: Some(self.picture),
            parts: vec![
                ReportPart::Title("All rows".into()),
                ReportPart::Table(all_rows(varied, &quantities, rows)),
                ReportPart::Title("What the columns mean".into()),
                ReportPart::Table(meanings(&quantities)),
            ],
            files: self.files,
            notes: self.notes,
        };
        page.html()
    }
}

fn all_rows<S>(varied: &[&str], quantities: &[&Quantity], rows: Vec<(Vec<String>, &Row<S>)>) -> ReportTable {
    let values = |measured: &Measured| -> Vec<String> {
        let shown = |quantity: &&Quantity| (quantity.of)(measured).map_or("–".into(), |value| significant(value, 4));
        quantities.iter().map(shown).collect()
    };
    let of_settings = varied.iter().map(|name| TableColumn {
        head: name.replace('_', "-"),
        unit: String::new(),
        align: Align::Left,
    });
    let of_quantities = quantities.iter().map(|quantity| TableColumn {
        head: quantity.name.into(),
        unit: quantity.unit.into(),
        align: Align::Right,
    });
    let line = |(mut cells, row): (Vec<String>, &Row<S>)| {
        cells.extend(row.found.as_ref().map(values).unwrap_or_default());
        cells.extend(row.error.clone());
        cells
    };
    ReportTable {
        content: TableContent {
            columns: of_settings.chain(of_quantities).collect(),
            rows: rows.into_iter().map(line).collect(),
        },
        named: varied.len(),
        meanings: std::iter::repeat_n("", varied.len())
            .chain(quantities.iter().map(|quantity| quantity.meaning))
            .collect(),
    }
}

fn meanings(quantities: &[&Quantity]) -> ReportTable {
    let mut table = Table::new(["column", "unit", "meaning"].map(|name| (name, "", Align::Left)));
    for quantity in quantities {
        table.row([quantity.name, quantity.unit, quantity.meaning].map(String::from));
    }
    ReportTable {
        content: table.into_content(),
        named: 1,
        meanings: vec![],
    }
}
