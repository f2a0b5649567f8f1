//! The report on a transfer, in words.

use super::TransferSummary;
use crate::drawing::significant;
use crate::shared::output::{two_columns, written_row};

/// The report as text.
pub fn text(report: &TransferSummary) -> String {
    let volume = &report.volume;
    let cells = match (report.tets, report.hexes) {
        (tets, 0) => format!("{tets} tetrahedra"),
        (_, hexes) => format!("{hexes} hexahedra"),
    };
    let mut rows = vec![
        [
            "points".into(),
            format!(
                "{} with {cells}; {} written in {:.3} s",
                report.points, report.written_points, report.seconds
            ),
        ],
        written_row([Some(&report.output), report.picture.as_ref(), report.page.as_ref()]),
        [
            "volume".into(),
            format!(
                "{} → {}, the target has {} ({:+.2e}); {:.2} % folded",
                significant(volume.domain, 6),
                significant(volume.carried, 6),
                significant(volume.target, 6),
                volume.relative_error,
                100.0 * volume.folded_share
            ),
        ],
    ];
    if report.volume_beyond_field > 0.0 {
        let share = 100.0 * report.volume_beyond_field;
        rows.push([
            "beyond FIELD".into(),
            format!("{share:.2} % of the domain's volume, left out below"),
        ]);
    }
    if report.inverse.is_some() {
        rows.push(["without value".into(), report.without_value.to_string()]);
        rows.push(["points beyond FIELD".into(), report.beyond_carrier.to_string()]);
    }
    for field in &report.fields {
        let lost = if field.written { "" } else { ", not written" };
        let name = format!("`{}` ({} {}{lost})", field.name, field.over, field.carry);
        if let Some(check) = &field.distribution {
            rows.push([
                name,
                format!(
                    "median {} → {}, mean {} → {}, largest shift of the distribution {:.3}",
                    significant(check.before.quantiles[2], 4),
                    significant(check.after.quantiles[2], 4),
                    significant(check.before.mean, 4),
                    significant(check.after.mean, 4),
                    check.largest_shift
                ),
            ]);
        } else if let Some(labels) = &field.labels {
            let shares = labels.iter().take(8).map(|share| {
                format!(
                    "{}: {:.1} % → {:.1} %",
                    share.label,
                    100.0 * share.before,
                    100.0 * share.after
                )
            });
            let more = if labels.len() > 8 { ", …" } else { "" };
            rows.push([name, format!("{}{more}", shares.collect::<Vec<_>>().join(", "))]);
        } else {
            rows.push([name, format!("{} components", field.components)]);
        }
    }
    two_columns(rows)
}
