//! Panels with two logarithmic axes, as SVG.

use std::fmt::Write;

pub const WIDTH: f64 = 380.0;
pub const HEIGHT: f64 = 300.0;
pub const LEFT: f64 = 70.0;
pub const TOP: f64 = 40.0;
/// Okabe & Ito's colours, which colour-blind readers can tell apart.
pub const COLOURS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00"];

/// The head of a picture with two panels this far apart, and a legend to the right of them.
pub fn head(between: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        LEFT + 2.0 * WIDTH + between + 190.0,
        TOP + HEIGHT + 60.0
    )
}

/// A panel, by which values become places in the picture.
pub struct Panel {
    left: f64,
    x: (f64, f64),
    y: (f64, f64),
}

impl Panel {
    /// Draws the frame of a panel for these values, with a title and what the horizontal axis has.
    pub fn new(
        out: &mut String,
        left: f64,
        [title, axis]: [&str; 2],
        x: impl Iterator<Item = f64>,
        y: impl Iterator<Item = f64>,
    ) -> Self {
        let panel = Self {
            left,
            x: decades(x),
            y: decades(y),
        };
        let _ = writeln!(
            out,
            "<text x=\"{left}\" y=\"{}\" font-weight=\"bold\">{title}</text>\n\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{axis}</text>\n\
             <rect x=\"{left}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"none\" stroke=\"#444\"/>",
            TOP - 14.0,
            left + WIDTH / 2.0,
            TOP + HEIGHT + 45.0
        );
        for exponent in panel.x.0 as i32..=panel.x.1 as i32 {
            let x = panel.x_of(10f64.powi(exponent));
            let _ = writeln!(
                out,
                "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                TOP + HEIGHT + 20.0,
                power(exponent)
            );
        }
        for exponent in panel.y.0 as i32..=panel.y.1 as i32 {
            let y = panel.y_of(10f64.powi(exponent));
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
        panel
    }

    pub fn x_of(&self, value: f64) -> f64 {
        let (low, high) = self.x;
        self.left + WIDTH * (value.log10() - low) / (high - low)
    }

    pub fn y_of(&self, value: f64) -> f64 {
        let (low, high) = self.y;
        TOP + HEIGHT * (high - value.log10()) / (high - low)
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
