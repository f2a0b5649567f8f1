//! Charts of the studies of placements and ratios, after figure 5 of the paper.

use super::measured::Measured;
use super::results::Row;
use super::setting::{Setting, parameter_name, place_name};
use super::sweep::SweepKind;
use crate::args::PlacementKind;
use crate::drawing::{Curve, Figure, LineChart, Panel, Scale, significant};

/// Width and height of a chart in pixels.
const CHART: [usize; 2] = [460, 300];
/// Values that span more than this factor are drawn on a logarithmic axis, where the scale is to be chosen.
const WIDE: f64 = 20.0;
/// The same for the quantity that is varied.
const WIDE_ACROSS: f64 = 10.0;

/// What a chart shows.
struct Charted {
    name: &'static str,
    /// The scale; `None` to choose it by the values.
    scale: Option<Scale>,
    of: fn(&Measured) -> Option<f64>,
    /// A second value, dashed, and what the first and the second are measured at.
    beside: Option<Beside>,
}

struct Beside {
    of: fn(&Measured) -> Option<f64>,
    names: [&'static str; 2],
}

const CHARTED: [Charted; 6] = [
    Charted {
        name: "C-Error",
        scale: Some(Scale::Log),
        of: |m| Some(m.c_error),
        beside: None,
    },
    Charted {
        name: "error, rms / diagonal",
        scale: Some(Scale::Log),
        of: |m| Some(m.boundary_error.rms),
        beside: Some(Beside {
            of: |m| Some(m.residual_rms),
            names: ["at held-out points", "at collocation points"],
        }),
    },
    Charted {
        name: "harmonic energy",
        scale: None,
        of: |m| Some(m.harmonic_energy),
        beside: None,
    },
    Charted {
        name: "deformation energy",
        scale: None,
        of: |m| Some(m.deformation_energy),
        beside: None,
    },
    Charted {
        name: "condition number",
        scale: Some(Scale::Log),
        of: |m| m.condition,
        beside: None,
    },
    Charted {
        name: "rank / unknowns",
        scale: Some(Scale::Linear),
        of: Measured::kept_fraction,
        beside: None,
    },
];

/// What the figure shows, for who does not see it.
pub fn in_words(kind: SweepKind) -> &'static str {
    match kind {
        SweepKind::Placement => {
            "Charts of errors, energies, condition number and rank over the distance of the sources, a column for each \
             placement; the table below has the numbers"
        }
        SweepKind::Ratios => {
            "Charts of errors, energies, condition number and rank over the number of sources, a curve for each number of \
             collocation points; the table below has the numbers"
        }
    }
}

/// One chart for each quantity: of placements a column for each of them, with a curve for each number of sources; of ratios
/// over the number of sources, with a curve for each number of collocation points.
pub fn figure(kind: SweepKind, rows: &[Row<Setting>]) -> anyhow::Result<Figure> {
    let panels = match kind {
        SweepKind::Placement => {
            let mut placements: Vec<PlacementKind> = Vec::new();
            for row in rows {
                if !placements.contains(&row.setting.placement) {
                    placements.push(row.setting.placement);
                }
            }
            let of = |placement| {
                rows.iter()
                    .filter(|row| row.setting.placement == placement)
                    .collect::<Vec<_>>()
            };
            let columns: Vec<(PlacementKind, Vec<&Row<Setting>>)> = placements
                .into_iter()
                .map(|placement| (placement, of(placement)))
                .collect();
            let line = |(k, charted): (usize, &Charted)| {
                let common = Common::of(charted, rows);
                let panel = |(placement, rows): &(PlacementKind, Vec<&Row<Setting>>)| {
                    let panel = chart(kind, charted, &common, rows, parameter_name(*placement))?;
                    let title = if k == 0 { place_name(*placement) } else { "" };
                    anyhow::Ok(panel.titled(title))
                };
                columns.iter().map(panel).collect::<anyhow::Result<Vec<_>>>()
            };
            CHARTED
                .iter()
                .enumerate()
                .map(line)
                .collect::<anyhow::Result<Vec<_>>>()?
        }
        SweepKind::Ratios => {
            let all: Vec<&Row<Setting>> = rows.iter().collect();
            let panel = |charted: &Charted| {
                let common = Common::of(charted, rows);
                chart(kind, charted, &common, &all, "s-ratio (sources / boundary points)")
            };
            let panels: Vec<Panel> = CHARTED.iter().map(panel).collect::<anyhow::Result<_>>()?;
            panels.chunks(3).map(<[Panel]>::to_vec).collect()
        }
    };
    Ok(Figure::grid(panels))
}

/// The vertical axis that the charts of one quantity share.
struct Common {
    scale: Scale,
    heights: Option<[f64; 2]>,
}

impl Common {
    fn of(charted: &Charted, rows: &[Row<Setting>]) -> Self {
        let found = || rows.iter().filter_map(|row| row.found.as_ref());
        let first = found().filter_map(charted.of);
        let beside = charted.beside.iter();
        let second = beside.flat_map(|beside| found().filter_map(beside.of));
        let values: Vec<f64> = first.chain(second).filter(|value| value.is_finite()).collect();
        let ends = |values: &mut dyn Iterator<Item = f64>| {
            let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
            values.for_each(|value| ends = [ends[0].min(value), ends[1].max(value)]);
            ends
        };
        let [low, high] = ends(&mut values.iter().copied());
        let scale = charted.scale.unwrap_or(if low > 0.0 && high > WIDE * low {
            Scale::Log
        } else {
            Scale::Linear
        });
        let heights = match scale {
            Scale::Log => ends(&mut values.iter().copied().filter(|value| *value > 0.0)),
            Scale::Linear if charted.scale.is_some() => [0.0, high.max(1.0)],
            Scale::Linear => [low, high],
        };
        let [low, high] = heights;
        Self {
            scale,
            // A single value has the range that its chart gives it.
            heights: (high > low * (1.0 + 1e-6) && low.is_finite()).then_some(heights),
        }
    }
}

/// What a chart has across it, or a curve for each value of.
type OfSetting = fn(&Setting) -> f64;

fn chart(
    kind: SweepKind,
    charted: &Charted,
    common: &Common,
    rows: &[&Row<Setting>],
    across: &str,
) -> anyhow::Result<Panel> {
    let (place, curve_of, name): (OfSetting, OfSetting, &str) = match kind {
        SweepKind::Placement => (|s| s.parameter, |s| s.s_ratio, "s-ratio"),
        SweepKind::Ratios => (|s| s.s_ratio, |s| s.c_ratio, "c-ratio"),
    };
    let mut values: Vec<f64> = rows.iter().map(|row| curve_of(&row.setting)).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let points = |value: f64, of: fn(&Measured) -> Option<f64>| {
        let curve = rows
            .iter()
            .filter(|row| curve_of(&row.setting).total_cmp(&value).is_eq());
        let mut points: Vec<[f64; 2]> = curve
            .map(|row| {
                let height = row.found.as_ref().and_then(of).unwrap_or(f64::NAN);
                [place(&row.setting), height]
            })
            .collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points
    };
    let lone = values.len() == 1;
    let mut curves = Vec::new();
    for (colour, &value) in values.iter().enumerate() {
        let label = format!("{name} {}", significant(value, 4));
        curves.push(Curve {
            name: match &charted.beside {
                _ if !lone => label,
                Some(beside) => beside.names[0].into(),
                None => String::new(),
            },
            points: points(value, charted.of),
            colour,
            dashed: false,
        });
    }
    for (colour, &value) in values.iter().enumerate() {
        let Some(beside) = &charted.beside else { break };
        curves.push(Curve {
            // One name stands for all dashed curves.
            name: if colour == 0 {
                beside.names[1].into()
            } else {
                String::new()
            },
            points: points(value, beside.of),
            colour,
            dashed: true,
        });
    }
    let places: Vec<f64> = rows.iter().map(|row| place(&row.setting)).collect();
    let (low, high) = (
        places.iter().copied().fold(f64::INFINITY, f64::min),
        places.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    );
    let is_wide = low > 0.0 && high >= WIDE_ACROSS * low;
    let missing = rows.iter().filter(|row| row.error.is_some());
    let missing = missing.map(|row| place(&row.setting)).filter(|x| !is_wide || *x > 0.0);
    let scale = if is_wide { Scale::Log } else { Scale::Linear };
    let mut chart =
        LineChart::new(curves, [across, charted.name], [scale, common.scale]).with_missing(missing.collect());
    if let Some(heights) = common.heights {
        chart = chart.with_heights(heights);
    }
    Ok(Panel::of_line_chart(&chart, CHART)?)
}

#[cfg(test)]
mod tests {
    use super::super::measured::tests::sample;
    use super::super::setting::grid;
    use super::*;

    fn rows(found: Option<Measured>) -> Vec<Row<Setting>> {
        let placements = [
            (PlacementKind::Sphere, &[0.6, 1.0][..]),
            (PlacementKind::Offset, &[0.01, f64::NAN, 0.4, -1.0]),
        ];
        let row = |setting| Row {
            setting,
            reused: false,
            error: found.is_none().then(|| "no".into()),
            found: found.clone(),
        };
        grid(&placements, &[0.6, 0.3], &[1.0, 2.0])
            .into_iter()
            .map(row)
            .collect()
    }

    #[test]
    fn charts_are_drawn_whatever_is_missing() {
        for kind in [SweepKind::Placement, SweepKind::Ratios] {
            for found in [None, Some(sample())] {
                let png = figure(kind, &rows(found)).unwrap().titled("a → b").to_png().unwrap();
                assert!(png.len() > 1000);
            }
        }
    }

    #[test]
    fn an_axis_is_logarithmic_where_values_are_wide_apart() {
        let mut rows = rows(Some(sample()));
        let energy = &CHARTED[2];
        assert_eq!(Common::of(energy, &rows).scale, Scale::Linear);
        rows[0].found.as_mut().unwrap().harmonic_energy = 1e5;
        let common = Common::of(energy, &rows);
        assert_eq!((common.scale, common.heights), (Scale::Log, Some([3.25, 1e5])));
    }
}
