//! The results as a picture (SVG): time and the least scaled Jacobian over the number of tetrahedra, both logarithmic.

use std::fmt::Write;

/// What is drawn of a case.
pub struct Row {
    /// `cube`, `tet`, ...
    pub target: String,
    pub tets: usize,
    pub seconds: f64,
    pub least: f64,
}

const WIDTH: f64 = 380.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 70.0;
const TOP: f64 = 40.0;
const BETWEEN: f64 = 110.0;
/// Okabe & Ito's colours, which colour-blind readers can tell apart.
const COLOURS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00"];

pub fn svg(rows: &[Row]) -> String {
    let mut targets: Vec<&str> = rows.iter().map(|row| row.target.as_str()).collect();
    targets.sort_unstable();
    targets.dedup();
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        LEFT + 2.0 * WIDTH + BETWEEN + 120.0,
        TOP + HEIGHT + 60.0
    );
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
    let (x_low, x_high) = decades(rows.iter().map(|row| row.tets as f64));
    let (y_low, y_high) = decades(rows.iter().map(&value));
    let x_of = |v: f64| left + WIDTH * (v.log10() - x_low) / (x_high - x_low);
    let y_of = |v: f64| TOP + HEIGHT * (y_high - v.log10()) / (y_high - y_low);
    let _ = writeln!(
        out,
        "<text x=\"{left}\" y=\"{}\" font-weight=\"bold\">{title}</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">tetrahedra</text>\n\
         <rect x=\"{left}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"none\" stroke=\"#444\"/>",
        TOP - 14.0,
        left + WIDTH / 2.0,
        TOP + HEIGHT + 45.0
    );
    for exponent in x_low as i32..=x_high as i32 {
        let x = x_of(10f64.powi(exponent));
        let _ = writeln!(
            out,
            "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            TOP + HEIGHT + 20.0,
            power(exponent)
        );
    }
    for exponent in y_low as i32..=y_high as i32 {
        let y = y_of(10f64.powi(exponent));
        let _ = writeln!(
            out,
            "<line x1=\"{left}\" x2=\"{}\" y1=\"{y}\" y2=\"{y}\" stroke=\"#ddd\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            left + WIDTH,
            left - 8.0,
            y + 4.5,
            power(exponent)
        );
    }
    for row in rows {
        let colour = targets.iter().position(|target| *target == row.target).unwrap_or(0);
        let _ = writeln!(
            out,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{}\" fill-opacity=\"0.75\"/>",
            x_of(row.tets as f64),
            y_of(value(row)),
            COLOURS[colour % COLOURS.len()]
        );
    }
}

/// The whole powers of ten around values, as exponents.
fn decades(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    let (low, high) = (low.log10().floor(), high.log10().ceil());
    if low < high {
        (low, high)
    } else {
        (low - 1.0, low + 1.0)
    }
}

fn power(exponent: i32) -> String {
    format!("10<tspan dy=\"-5\" font-size=\"10\">{exponent}</tspan>")
}
