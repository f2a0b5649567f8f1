//! What a page colours by.

use std::borrow::Cow;

use serde::Serialize;

/// A scalar, and how to show it; its values are in the array `field-KEY`.
#[derive(Debug, Clone, Serialize)]
pub struct PageField {
    /// By which scripts know it.
    pub key: Cow<'static, str>,
    /// What readers call it.
    pub label: Cow<'static, str>,
    /// Its unit; `×` for ratios.
    pub unit: &'static str,
    /// What it means, in one line.
    pub meaning: Cow<'static, str>,
    /// The colours.
    pub palette: Palette,
    /// Whether the scale is logarithmic.
    pub logarithmic: bool,
    /// The lower end of the colour scale.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// Whether some values are beyond the ends.
    pub clamps: bool,
}

/// A colour scale of [`super::palettes::Palettes`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Palette {
    /// The more, the brighter.
    Amount,
    /// With 1 in the middle.
    Ratio,
    /// The less, the brighter: what is bad stands out.
    Quality,
    /// Labels: whole numbers with a colour each.
    Labels,
}
