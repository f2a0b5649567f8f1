//! Arguments of commands that make pictures of sections.

use clap::{Args, ValueEnum};
use solidmap::geometry::Axis;

/// Where pictures cut the domain.
#[derive(Debug, Args)]
pub struct SectionArgs {
    /// Axis perpendicular to the cross-section [default: z; for `sequence` and `study` that of
    /// the largest cross-section]
    #[arg(long, value_enum)]
    pub axis: Option<AxisKind>,
    /// Axis that points up in pictures
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
    /// Position of the cross-section along the axis, from 0 to 1 across the domain's bounding box [default: 0.5; for
    /// `certify` through the worst place]
    #[arg(long, value_name = "FRACTION")]
    pub position: Option<f64>,
    /// Colours of amounts
    #[arg(long, value_enum, default_value_t = ColoursKind::Viridis)]
    pub colours: ColoursKind,
}

/// The colours of amounts in pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ColoursKind {
    /// Equal steps look equal, also to colour-blind readers
    Viridis,
    /// The paper's: from blue to red
    Rainbow,
}

impl SectionArgs {
    /// The position, by default the middle.
    pub fn position(&self) -> f64 {
        self.position.unwrap_or(0.5)
    }
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

/// What points up where the target is pictured beside the domain.
#[derive(Debug, Args)]
pub struct TargetUpArgs {
    /// Axis that points up in pictures of the target [default: that of --up]
    #[arg(long, value_enum, allow_hyphen_values = true, value_name = "UP")]
    target_up: Option<UpKind>,
}

impl TargetUpArgs {
    /// The direction, where that of the domain is `up`.
    pub fn or(&self, up: UpKind) -> UpKind {
        self.target_up.unwrap_or(up)
    }
}

impl UpKind {
    /// Whether pictures with the axis up have to be turned by 180°.
    pub fn is_upside_down(self) -> bool {
        self.axis().1
    }

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

impl From<UpKind> for Axis {
    fn from(up: UpKind) -> Self {
        up.axis().0
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
