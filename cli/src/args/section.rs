//! Arguments of commands that make pictures of sections.

use clap::{Args, ValueEnum};
use solidmap::geometry::Axis;

/// Where pictures cut the domain.
#[derive(Debug, Args)]
pub struct SectionArgs {
    /// Axis perpendicular to the cross-section [default: z; for `sequence` that of the largest cross-section]
    #[arg(long, value_enum)]
    pub axis: Option<AxisKind>,
    /// Axis that points up in pictures
    #[arg(long, value_enum, default_value_t = AxisKind::Z)]
    pub up: AxisKind,
    /// Position of the cross-section along the axis, from 0 to 1 across the domain's bounding box
    #[arg(long, default_value_t = 0.5, value_name = "FRACTION")]
    pub position: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AxisKind {
    X,
    Y,
    Z,
}

/// The direction that points up in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UpKind {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
}

impl UpKind {
    /// The axis, and whether its negative end points up.
    pub fn axis(self) -> (Axis, bool) {
        match self {
            Self::X => (Axis::X, false),
            Self::Y => (Axis::Y, false),
            Self::Z => (Axis::Z, false),
            Self::MinusX => (Axis::X, true),
            Self::MinusY => (Axis::Y, true),
            Self::MinusZ => (Axis::Z, true),
        }
    }
}

impl From<AxisKind> for Axis {
    fn from(kind: AxisKind) -> Self {
        match kind {
            AxisKind::X => Self::X,
            AxisKind::Y => Self::Y,
            AxisKind::Z => Self::Z,
        }
    }
}
