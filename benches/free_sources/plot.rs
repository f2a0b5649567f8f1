//! The results as a picture (SVG): the boundary error over the number of sources, and over the processor seconds, logarithmic.

use std::fmt::Write;

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

const WIDTH: f64 = 380.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 70.0;
const TOP: f64 = 40.0;
const BETWEEN: f64 = 70.0;
/// Okabe & Ito's colours, which colour-blind readers can tell apart.
const COLOURS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00"];

/// A line of points, dashed for fixed sources.
struct Curve {
    points: Vec<(f64, f64)>,
    colour: &'static str,
    is_free: bool,
}

pub fn svg(rows: &[Row]) -> String {
    let mut models: Vec<&str> = rows.iter().map(|row| row.model.as_str()).collect();
    models.dedup();
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        LEFT + 2.0 * WIDTH + BETWEEN + 190.0,
        TOP + HEIGHT + 60.0
    );
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
    let (x_low, x_high) = decades(points().map(|point| point.0));
    let (y_low, y_high) = decades(points().map(|point| point.1));
    let x_of = |v: f64| left + WIDTH * (v.log10() - x_low) / (x_high - x_low);
    let y_of = |v: f64| TOP + HEIGHT * (y_high - v.log10()) / (y_high - y_low);
    let _ = writeln!(
        out,
        "<text x=\"{left}\" y=\"{}\" font-weight=\"bold\">boundary error, root mean square</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{what}</text>\n\
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
    for curve in curves {
        let (colour, dash) = (curve.colour, if curve.is_free { "none" } else { "5 4" });
        let places: Vec<String> = curve
            .points
            .iter()
            .map(|(x, y)| format!("{:.1},{:.1}", x_of(*x), y_of(*y)))
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
                x_of(*x),
                y_of(*y)
            );
        }
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
