//! The results as a picture (SVG): time and the least scaled Jacobian over the number of tetrahedra, both logarithmic.

use std::fmt::Write;

use crate::shared::chart::{COLOURS, LEFT, Panel, TOP, WIDTH, head};

/// What is drawn of a case.
pub struct Row {
    /// `cube`, `tet`, ...
    pub target: String,
    pub tets: usize,
    pub seconds: f64,
    pub least: f64,
}

const BETWEEN: f64 = 110.0;

pub fn svg(rows: &[Row]) -> String {
    let mut targets: Vec<&str> = rows.iter().map(|row| row.target.as_str()).collect();
    targets.sort_unstable();
    targets.dedup();
    let mut out = head(BETWEEN);
    panel(&mut out, 0, "processor seconds of the repair", rows, &targets, |row| {
        row.seconds.max(0.01)
    });
    panel(&mut out, 1, "least scaled Jacobian", rows, &targets, |row| {
        row.least.max(1e-12)
    });
    for (k, target) in targets.iter().enumerate() {
        let (x, y) = (LEFT + 2.0 * WIDTH + BETWEEN + 25.0, TOP + 15.0 + 22.0 * k as f64);
        let _ = writeln!(
            out,
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"4\" fill=\"{}\"/><text x=\"{}\" y=\"{}\">{target}</text>",
            COLOURS[k % COLOURS.len()],
            x + 12.0,
            y + 4.5
        );
    }
    out.push_str("</svg>\n");
    out
}

fn panel(out: &mut String, number: usize, title: &str, rows: &[Row], targets: &[&str], value: impl Fn(&Row) -> f64) {
    let left = LEFT + number as f64 * (WIDTH + BETWEEN);
    let tets = rows.iter().map(|row| row.tets as f64);
    let panel = Panel::new(out, left, [title, "tetrahedra"], tets, rows.iter().map(&value));
    for row in rows {
        let colour = targets.iter().position(|target| *target == row.target).unwrap_or(0);
        let _ = writeln!(
            out,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{}\" fill-opacity=\"0.75\"/>",
            panel.x_of(row.tets as f64),
            panel.y_of(value(row)),
            COLOURS[colour % COLOURS.len()]
        );
    }
}
