//! What is varied in the studies of placements and ratios.

use serde::Serialize;
use solidmap::fit::Placement;

use crate::args::PlacementKind;
use crate::drawing::significant;

/// A place and numbers of sources and collocation points: one row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Setting {
    #[serde(serialize_with = "name_of_kind")]
    pub placement: PlacementKind,
    /// The paper's R-Ratio or O-Distance, or the distance over the local spacing.
    pub parameter: f64,
    /// Sources per boundary point.
    pub s_ratio: f64,
    /// Collocation points per boundary point.
    pub c_ratio: f64,
}

impl Setting {
    /// Names of its columns.
    pub const COLUMNS: [&'static str; 4] = ["placement", "parameter", "s_ratio", "c_ratio"];

    /// The cells of its columns.
    pub fn cells(&self) -> [String; 4] {
        let numbers = [self.parameter, self.s_ratio, self.c_ratio].map(|value| value.to_string());
        let [parameter, s_ratio, c_ratio] = numbers;
        [name(self.placement).into(), parameter, s_ratio, c_ratio]
    }

    /// The same in words.
    pub fn label(&self) -> String {
        let [parameter, s_ratio, c_ratio] =
            [self.parameter, self.s_ratio, self.c_ratio].map(|value| significant(value, 4));
        format!(
            "{} {parameter}, s-ratio {s_ratio}, c-ratio {c_ratio}",
            name(self.placement)
        )
    }

    /// Where the library places the sources.
    pub fn library_placement(&self) -> Placement {
        match self.placement {
            PlacementKind::Sphere => Placement::Sphere { radius: self.parameter },
            PlacementKind::Offset => Placement::Offset {
                distance: self.parameter,
            },
            PlacementKind::Adaptive => Placement::Adaptive { alpha: self.parameter },
        }
    }
}

/// The name of a placement, as its option has it.
pub fn name(kind: PlacementKind) -> &'static str {
    match kind {
        PlacementKind::Sphere => "sphere",
        PlacementKind::Offset => "offset",
        PlacementKind::Adaptive => "adaptive",
    }
}

/// What the parameter of a placement is, for axes.
pub fn parameter_name(kind: PlacementKind) -> &'static str {
    match kind {
        PlacementKind::Sphere => "R-Ratio (radius / diagonal)",
        PlacementKind::Offset => "O-Distance (distance / diagonal)",
        PlacementKind::Adaptive => "distance / local spacing",
    }
}

/// Where sources stand, for titles.
pub fn place_name(kind: PlacementKind) -> &'static str {
    match kind {
        PlacementKind::Sphere => "Sources on a sphere",
        PlacementKind::Offset => "Sources on an offset surface",
        PlacementKind::Adaptive => "Adaptive placement",
    }
}

fn name_of_kind<S: serde::Serializer>(kind: &PlacementKind, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(name(*kind))
}

/// All combinations, each once: values of the parameters of each placement, of the ratio of sources, and of that of
/// collocation points.
pub fn grid(placements: &[(PlacementKind, &[f64])], s_ratios: &[f64], c_ratios: &[f64]) -> Vec<Setting> {
    let mut settings: Vec<Setting> = Vec::new();
    for &(placement, parameters) in placements {
        for &parameter in parameters {
            for &c_ratio in c_ratios {
                for &s_ratio in s_ratios {
                    let setting = Setting {
                        placement,
                        parameter,
                        s_ratio,
                        c_ratio,
                    };
                    if !settings.iter().any(|other| other.cells() == setting.cells()) {
                        settings.push(setting);
                    }
                }
            }
        }
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_has_each_setting_once_and_labels_tell_them_apart() {
        let placements = [
            (PlacementKind::Sphere, &[1.0, 2.0, 1.0][..]),
            (PlacementKind::Adaptive, &[f64::NAN, f64::NAN]),
        ];
        let settings = grid(&placements, &[0.6, 0.3], &[1.0]);
        assert_eq!(settings.len(), 6);
        let labels: std::collections::BTreeSet<String> = settings.iter().map(Setting::label).collect();
        assert_eq!(labels.len(), 6);
        assert_eq!(settings[1].label(), "sphere 1, s-ratio 0.3, c-ratio 1");
    }
}
