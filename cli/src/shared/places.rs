//! Worst places and shares in summaries.

use solidmap::worst_places::{PlaceTable, WorstPlace};

/// A summary with the table of the worst places below it, if there are any.
pub fn with_places(summary: String, places: &[WorstPlace]) -> String {
    if places.is_empty() {
        return summary;
    }
    format!("{}\n\n{}", summary.trim_end(), PlaceTable(places))
}

/// A percentage; shares near 0 and 100 % keep their digits.
pub fn percent(fraction: f64) -> String {
    match 100.0 * fraction {
        0.0 => "0 %".into(),
        share if share < 0.01 => format!("{share:.1e} %"),
        share if share > 99.99 && share < 100.0 => format!("{:.6} %", share.min(99.999_999)),
        share => format!("{share:.3} %"),
    }
}
