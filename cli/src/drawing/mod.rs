//! Pictures, charts and plain-text tables.
//!
//! Pictures are cross-sections coloured by any field, in the manner of figures 2 and 7 of Li et al., *Harmonic
//! volumetric mapping for solid modeling applications* (2007), and shaded views of surfaces; a [`Figure`] sets them
//! side by side. Everything is drawn in memory and returned as the bytes of a PNG file, the same on every run.
//!
//! ```
//! use solidmap::mesh::shapes;
//! use solidmap::geometry::{Axis, AxisPlane, PlaneSection};
//! use solidmap_cli::drawing::{ColourBar, Figure, Panel, Scale, ValueRange};
//!
//! let solid = shapes::spherical_shell(1.0, 0.4, 3);
//! let section = PlaneSection::new(&solid, AxisPlane { axis: Axis::Z, position: 0.1 }, Axis::Z, 200)?;
//! let field: Vec<f64> = section.points().iter().map(|p| p.coords.norm()).collect();
//! let bar = ColourBar::new("distance", field.iter().copied(), ValueRange::Quantiles(0.01, 0.99), Scale::Linear)?;
//! let panel = Panel::of_section(&section, &field, &bar)?.titled("Shell");
//! let png: Vec<u8> = Figure::row(vec![panel]).with_bar(&bar).to_png()?;
//! # assert!(!png.is_empty());
//! # Ok::<(), solidmap_cli::drawing::DrawingError>(())
//! ```
//!
//! Text is set in DejaVu Sans, embedded in the binary under the Bitstream Vera font licence (permissive; its notice
//! must accompany copies of the font, and so of the binary).

mod canvas;
mod chart;
mod checker;
mod colour_bar;
mod colour_map;
mod figure;
mod histogram;
mod light;
mod line_chart;
mod number;
mod panel;
mod plane;
mod plot;
mod png;
mod surface_render;
mod table;
mod text;
mod ticks;

pub use canvas::Rgb;
pub use chart::Chart;
pub use checker::{Checker, Pattern};
pub use colour_map::{ColourBar, Colours, Scale, ValueRange};
pub use figure::Figure;
pub use histogram::Histogram;
pub use line_chart::{Curve, LineChart};
pub use number::significant;
pub use panel::Panel;
pub use plane::PlaneDrawing;
pub use surface_render::{Camera, Edges, Shading, SurfaceColour, SurfaceStyle};
pub use table::{Align, Table, TableColumn, TableContent};

use solidmap::geometry::SectionError;

/// Why a picture cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawingError {
    /// There is no section to draw.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// A vertex has a coordinate that cannot be drawn.
    #[error("vertex {vertex} has a coordinate that is not a number, infinite or beyond 1e70 (0-based)")]
    NotFinite {
        /// Its index.
        vertex: usize,
    },
    /// There is no triangle to draw.
    #[error("the surface has no triangles, so there is nothing to draw")]
    EmptySurface,
    /// A figure without panels, or a panel with too few pixels.
    #[error("a picture needs at least one panel, each of at least {least} × {least} pixels")]
    TooSmall {
        /// The least width and height of a panel.
        least: usize,
    },
    /// A picture too large for memory or for viewers.
    #[error("a picture of {width} × {height} pixels is beyond the limit of {limit} pixels; ask for fewer pixels")]
    TooLarge {
        /// Wanted width.
        width: usize,
        /// Wanted height.
        height: usize,
        /// Most pixels allowed.
        limit: usize,
    },
    /// The number of values is not that of the points, vertices or triangles.
    #[error("{found} values were given, but {expected} are needed, one for each {element}")]
    ValueCount {
        /// `"section point"`, `"vertex"`, `"triangle"`.
        element: &'static str,
        /// How many of those there are.
        expected: usize,
        /// How many values were given.
        found: usize,
    },
    /// A field without any value that could span a colour bar.
    #[error("no value of `{label}` is finite, so there is no range to colour")]
    NoFiniteValue {
        /// The name of the field.
        label: String,
    },
    /// A logarithmic bar over values that have no logarithm.
    #[error("no value of `{label}` is positive, so it has no logarithmic colour scale; use the linear one")]
    NoPositiveValue {
        /// The name of the field.
        label: String,
    },
    /// A range that is empty, or that the scale cannot show.
    #[error("the colour range of `{label}` from {low} to {high} is not an interval that its scale can show")]
    BadRange {
        /// The name of the field.
        label: String,
        /// Wanted lower end (a value, or a quantile's fraction).
        low: f64,
        /// Wanted upper end.
        high: f64,
    },
    /// The encoder refused the picture.
    #[error("cannot encode the picture as PNG")]
    Encode(#[from] ::png::EncodingError),
}
