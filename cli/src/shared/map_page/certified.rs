//! What a certificate proves of a map, as its page shows it: boxes where the map is folded, and where that is undecided.

use solidmap::Point;
use solidmap::certificate::{Certificate, CertificateCell, Verdict};

use crate::drawing::significant;
use crate::shared::page::{Framing, NumberTable, PackedArray};
use crate::shared::places::percent;

/// Most boxes of either kind: the largest are in the page.
const MOST_BOXES: usize = 30_000;

/// The cells with a verdict, the largest first.
fn cells(certificate: &Certificate, verdict: Verdict) -> Vec<&CertificateCell> {
    let mut cells: Vec<&CertificateCell> = certificate
        .cells()
        .iter()
        .filter(|cell| cell.verdict == verdict)
        .collect();
    cells.sort_by(|a, b| b.size.total_cmp(&a.size));
    cells
}

/// Arrays of boxes: centre and side of each, in the view.
pub fn boxes(certificate: &Certificate, framing: Framing) -> [PackedArray; 2] {
    [("folded", Verdict::Folded), ("undecided", Verdict::Undecided)].map(|(name, verdict)| {
        let placed = |cell: &CertificateCell| {
            let low: Point = cell.low;
            let ends = [low, low.map(|x| x + cell.size)];
            let places: Vec<f64> = framing.place(&ends).collect();
            let side = places[3] - places[0];
            [
                places[0] + side / 2.0,
                places[1] + side / 2.0,
                places[2] + side / 2.0,
                side,
            ]
        };
        let cells = cells(certificate, verdict).into_iter().take(MOST_BOXES);
        PackedArray::floats(name, cells.flat_map(placed))
    })
}

/// What is proved, in numbers.
pub fn table(certificate: &Certificate) -> NumberTable {
    let report = &certificate.report;
    let mut table = NumberTable::new("Certificate");
    let totals = [
        (
            "locally one to one",
            &report.positive,
            "proved to preserve the orientation of the target",
        ),
        ("folded", &report.folded, "proved to be inverted: magenta boxes"),
        ("undecided", &report.undecided, "neither is proved: grey boxes"),
    ];
    for (name, total, meaning) in totals {
        table.row(
            name,
            format!("{}, {} cells", percent(total.fraction), total.cells),
            "of the volume",
            meaning,
        );
    }
    if let Some(sigma) = report.sigma_min_99 {
        table.row(
            "smallest singular value",
            significant(sigma, 3),
            "",
            "of J: a lower bound over 99 % of the volume",
        );
    }
    table
}

/// That boxes are left out.
pub fn note(certificate: &Certificate) -> Option<String> {
    let most = [Verdict::Folded, Verdict::Undecided].map(|verdict| cells(certificate, verdict).len());
    let is_over = most.iter().any(|&count| count > MOST_BOXES);
    is_over.then(|| {
        format!("Of the certificate the largest {MOST_BOXES} boxes of each kind are shown; numbers are of all.")
    })
}
