//! Where a map is folded or undecided: groups of cells across common faces; and fewer, larger cells for files.

use rayon::prelude::*;

use super::{Certificate, CertificateCell, MAX_LEVELS, Verdict, curve_key, set_determinants};
use crate::map::HarmonicMap;
use crate::worst_places::{BadPart, PlaceKind, WorstPlace, listed, places};

impl Certificate {
    /// The connected groups of cells proved folded, then those of undecided cells, the largest of each first; at most
    /// `most` in all. A part of the domain whose orientation the map reverses is one place.
    ///
    /// Some 2 % of the time that [`super::certify`] takes.
    pub fn worst_places(&self, most: usize) -> Vec<WorstPlace> {
        listed([self.folded_places(), self.undecided_places()], most)
    }

    /// All groups of cells proved folded, the largest first.
    pub fn folded_places(&self) -> Vec<WorstPlace> {
        self.places_with(Verdict::Folded, PlaceKind::Folded)
    }

    /// All groups of undecided cells, the largest first. A fold is surrounded by one.
    pub fn undecided_places(&self) -> Vec<WorstPlace> {
        self.places_with(Verdict::Undecided, PlaceKind::Undecided)
    }

    fn places_with(&self, verdict: Verdict, kind: PlaceKind) -> Vec<WorstPlace> {
        let cells: Vec<&CertificateCell> = self.cells.iter().filter(|cell| cell.verdict == verdict).collect();
        let parts: Vec<BadPart> = cells.iter().map(|cell| cell.bad_part()).collect();
        let keys: Vec<u64> = cells.par_iter().map(|cell| curve_key(cell.level, cell.steps)).collect();
        let touching = (0..cells.len()).into_par_iter().flat_map_iter(|number| {
            let cell = cells[number];
            // A neighbour that is smaller finds this cell itself.
            neighbours(cell).filter_map({
                let (cells, keys) = (&cells, &keys);
                move |key| {
                    let other = keys.partition_point(|other| *other <= key).checked_sub(1)?;
                    let inside = key - keys[other] < 1 << (3 * (MAX_LEVELS - cells[other].level));
                    inside.then_some([number as u32, other as u32])
                }
            })
        });
        let touching: Vec<[u32; 2]> = touching.collect();
        places(kind, &parts, touching, self.report.volume)
    }

    /// The same certificate in fewer cells: eight siblings with the same verdict become their parent, and so on upwards.
    /// Its bounds are the least of theirs, and so hold in all of it; `det_centre` is that of the map at its own centre.
    /// Siblings of which some lie outside of the domain stay. The report stays that of [`super::certify`].
    ///
    /// `map` must be the one that was certified.
    pub fn merged(&self, map: &HarmonicMap) -> Self {
        let mut cells: Vec<CertificateCell> = Vec::new();
        for &cell in &self.cells {
            cells.push(cell);
            while let Some(parent) = cells.last_chunk::<8>().and_then(parent_of) {
                cells.truncate(cells.len() - 8);
                cells.push(parent);
            }
        }
        let changed = cells.iter_mut().filter(|cell| cell.det_centre.is_nan());
        set_determinants(map, self.orientation, changed);
        Self {
            report: self.report,
            low: self.low,
            side: self.side,
            orientation: self.orientation,
            cells,
        }
    }
}

impl CertificateCell {
    fn bad_part(&self) -> BadPart {
        BadPart {
            point: self.centre(),
            low: self.low,
            high: self.low.map(|x| x + self.size),
            measure: self.volume,
            value: match self.verdict {
                Verdict::Folded => self.det_centre,
                Verdict::Positive | Verdict::Undecided => f64::NAN,
            },
        }
    }
}

/// Keys of the cells of the same size beyond the six faces, where the box has one.
fn neighbours(cell: &CertificateCell) -> impl Iterator<Item = u64> + use<> {
    let (level, steps) = (cell.level, cell.steps);
    (0..6).filter_map(move |face| {
        let (axis, forward) = (face / 2, face % 2 == 1);
        let mut next = steps;
        next[axis] = if forward {
            steps[axis] + 1
        } else {
            steps[axis].checked_sub(1)?
        };
        (next[axis] >> level == 0).then(|| curve_key(level, next))
    })
}

/// The parent of eight cells, with `det_centre` NaN, if they are all its children and have one verdict.
fn parent_of(cells: &[CertificateCell; 8]) -> Option<CertificateCell> {
    let first = cells[0];
    let is_sibling = |cell: &CertificateCell| {
        cell.level == first.level
            && cell.verdict == first.verdict
            && cell.steps.map(|step| step / 2) == first.steps.map(|step| step / 2)
    };
    let level = first.level.checked_sub(1)?;
    cells.iter().all(is_sibling).then(|| CertificateCell {
        low: first.low,
        size: 2.0 * first.size,
        level,
        volume: cells.iter().map(|cell| cell.volume).sum(),
        verdict: first.verdict,
        sigma_min: cells.iter().map(|cell| cell.sigma_min).fold(f64::INFINITY, f64::min),
        det_bound: cells.iter().map(|cell| cell.det_bound).fold(f64::INFINITY, f64::min),
        det_centre: f64::NAN,
        steps: first.steps.map(|step| step / 2),
    })
}
