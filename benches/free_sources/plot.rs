//! The results as a picture (SVG): the boundary error over the number of sources, and over the processor seconds, logarithmic.

use std::fmt::Write;

use crate::shared::chart::{COLOURS, LEFT, Panel, TOP, WIDTH, head};

/// What is drawn of a fit with fixed and with free sources.
pub struct Row {
    pub model: String,
    pub sources: usize,
    /// Boundary errors, root mean square.
    pub fixed: f64,
    pub free: f64,
    pub fixed_seconds: f64,
    pub free_seconds: f64,
}

const BETWEEN: f64 = 70.0;

/// A line of points, dashed for fixed sources.
struct Curve {
    points: Vec<(f64, f64)>,
    colour: &'static str,
    is_free: bool,
}

pub fn svg(rows: &[Row]) -> String {
    let mut models: Vec<&str> = rows.iter().map(|row| row.model.as_str()).collect();
    models.dedup();
    let mut out = head(BETWEEN);
    let curves = |x: fn(&Row, bool) -> f64| {
        let of_model = |(k, model): (usize, &&str)| {
            [false, true].map(|is_free| Curve {
                points: rows
                    .iter()
                    .filter(|row| row.model == *model)
                    .map(|row| (x(row, is_free), if is_free { row.free } else { row.fixed }))
                    .collect(),
                colour: COLOURS[k % COLOURS.len()],
                is_free,
            })
        };
        models.iter().enumerate().flat_map(of_model).collect::<Vec<Curve>>()
    };
    panel(&mut out, 0, "sources", &curves(|row, _| row.sources as f64));
    panel(
        &mut out,
        1,
        "processor seconds",
        &curves(|row, is_free| if is_free { row.free_seconds } else { row.fixed_seconds }.max(0.01)),
    );
    let x = LEFT + 2.0 * WIDTH + BETWEEN + 25.0;
    for (k, model) in models.iter().enumerate() {
        for (j, (dash, kind)) in [("5 4", "fixed"), ("none", "free")].into_iter().enumerate() {
            let y = TOP + 15.0 + 22.0 * (2 * k + j) as f64;
            let _ = writeln!(
                out,
                "<line x1=\"{x}\" x2=\"{}\" y1=\"{y}\" y2=\"{y}\" stroke=\"{}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>\
                 <text x=\"{}\" y=\"{}\">{model}, {kind}</text>",
                x + 28.0,
                COLOURS[k % COLOURS.len()],
                x + 36.0,
                y + 4.5
            );
        }
    }
    out.push_str("</svg>\n");
    out
}

fn panel(out: &mut String, number: usize, what: &str, curves: &[Curve]) {
    let left = LEFT + number as f64 * (WIDTH + BETWEEN);
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let titles = ["boundary error, root mean square", what];
    let panel = Panel::new(
        out,
        left,
        titles,
        points().map(|point| point.0),
        points().map(|point| point.1),
    );
    for curve in curves {
        let (colour, dash) = (curve.colour, if curve.is_free { "none" } else { "5 4" });
        let places: Vec<String> = curve
            .points
            .iter()
            .map(|(x, y)| format!("{:.1},{:.1}", panel.x_of(*x), panel.y_of(*y)))
            .collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>",
            places.join(" ")
        );
        for (x, y) in &curve.points {
            let _ = writeln!(
                out,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\" fill=\"{colour}\"/>",
                panel.x_of(*x),
                panel.y_of(*y)
            );
        }
    }
}
