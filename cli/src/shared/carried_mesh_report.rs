//! What is said about a carried mesh: its part of the JSON report, warnings, and the lines of the summary.

use std::path::Path;

use serde::Serialize;
use solidmap::Vector;
use solidmap::fit::self_intersection_finder;
use solidmap::memory::readable;
use solidmap::mesh::CellList;
use solidmap::remesh::{
    BoundaryIntersections, CellKind, CellQuality, InvalidCells, InversionCause, InversionCauses, PolishOutcome,
    PolishReport, RemeshReport, Remeshed, RepairStart, scaled_jacobians,
};
use solidmap::worst_places::WorstPlace;

use super::input::extension;
use super::output::{Output, mebibytes};
use crate::drawing::significant;

/// How many cells stay inverted, by their cause.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Reasons {
    boundary: usize,
    blocked_node: usize,
    folded_quad: usize,
    winding_ring: usize,
    unknown: usize,
}

impl Reasons {
    pub fn of(report: &RemeshReport) -> Self {
        let mut reasons = Self::default();
        for &cell in &report.after.cells {
            match report.causes_after.of_cells[cell as usize] {
                InversionCause::Boundary => reasons.boundary += 1,
                InversionCause::BlockedNode => reasons.blocked_node += 1,
                InversionCause::FoldedQuad => reasons.folded_quad += 1,
                InversionCause::WindingRing => reasons.winding_ring += 1,
                InversionCause::Unknown => reasons.unknown += 1,
            }
        }
        reasons
    }

    /// In words; `repaired` when a repair was tried.
    pub fn words(&self, repaired: bool) -> String {
        let known = [
            (
                self.boundary,
                "with an inverted corner whose nodes are all on the boundary (proved)",
            ),
            (
                self.blocked_node,
                "at an inner node that has no right place while the boundary stays (proved)",
            ),
            (self.folded_quad, "on a folded boundary quad"),
            (
                self.winding_ring,
                "at an inner edge about which the boundary around it does not wind once",
            ),
            (
                self.unknown,
                if repaired {
                    "for an unknown reason"
                } else {
                    "that a repair may help (leave out --no-repair)"
                },
            ),
        ];
        let known = known.into_iter().filter(|(count, _)| *count > 0);
        let known: Vec<String> = known.map(|(count, words)| format!("{count} {words}")).collect();
        known.join(", ")
    }
}

/// What makes a repair impossible, in words; empty when nothing does.
fn obstacles(found: &InversionCauses) -> String {
    let of = [
        (
            "cells with an inverted corner whose nodes are all on the boundary",
            found.boundary_cells,
        ),
        ("inner nodes without a right place", found.blocked_nodes),
        ("folded boundary quads", found.folded_quads),
        (
            "inner edges about which the boundary does not wind once",
            found.winding_rings,
        ),
    ];
    let of = of.into_iter().filter(|(_, count)| *count > 0);
    let of: Vec<String> = of.map(|(words, count)| format!("{words}: {count}")).collect();
    of.join(", ")
}

/// A carried mesh in reports.
#[derive(Debug, Serialize)]
pub struct CarriedMeshReport {
    /// Inverted cells of the result.
    inverted_cells: usize,
    /// How many of them there are for each reason.
    reasons: Reasons,
    /// The least scaled Jacobian of the result.
    min_scaled_jacobian: Option<f64>,
    /// Where the boundary passes through itself.
    crossings: BoundaryIntersections,
    /// Where cells stay inverted, in the target.
    pub worst_places: Vec<WorstPlace>,
    #[serde(flatten)]
    pub remesh: RemeshReport,
}

impl CarriedMeshReport {
    /// The report of a mesh, with this many of its worst places.
    pub fn new(remeshed: &Remeshed, worst: usize) -> Self {
        Self {
            inverted_cells: remeshed.report.after.cells.len(),
            reasons: Reasons::of(&remeshed.report),
            min_scaled_jacobian: remeshed.report.quality.map(|q| q.min_scaled_jacobian),
            crossings: remeshed.boundary_intersections(self_intersection_finder()),
            worst_places: remeshed.worst_places(worst),
            remesh: remeshed.report.clone(),
        }
    }

    /// Whether nothing is inverted, and the boundary does not pass through itself.
    pub fn is_valid(&self) -> bool {
        self.inverted_cells == 0 && !self.crossings.found()
    }

    /// Warns of what keeps the mesh, written to `path`, from being valid. `may_split` unless splitting was forbidden, `repaired`
    /// when a repair was tried.
    pub fn warn(&self, path: &Path, may_split: bool, repaired: bool, output: &Output) {
        let inverted = self.inverted_cells;
        if inverted > 0 {
            output.warn(format!(
                "{}: {}. In {}, {}. {}",
                if inverted == 1 {
                    "1 cell stays inverted".into()
                } else {
                    format!("{inverted} cells stay inverted")
                },
                self.reasons.words(repaired),
                path.display(),
                match extension(path).as_str() {
                    "msh" => "groups called \"inverted\" hold them",
                    "mesh" => "their references are explained in its header",
                    _ => "`inverted` is 1 there",
                },
                match (may_split, self.remesh.kind) {
                    (false, CellKind::Tets) => "Leave out --split-stuck off: nodes that splitting adds may help",
                    _ if self.remesh.repair.exhausted => {
                        "The repair ended at its limit: more --effort may help, smaller cells, or a boundary map that distorts \
                         less there"
                    }
                    _ => "Smaller cells may help, or a boundary map that distorts less there",
                }
            ));
        }
        if let Some(other) = &self.remesh.other_boundary {
            output.warn(format!(
                "the mesh does not follow the map's boundary map, under which it could not be repaired, but another one of less \
                 distortion: nodes on the boundary are {} of the diagonal from where the given one sends them in the mean, {} at \
                 most. `--keep-boundary-map` forbids it",
                significant(other.mean_shift, 2),
                significant(other.largest_shift, 2)
            ));
        }
        if let Some(warning) = warning(&self.crossings) {
            output.warn(warning);
        }
    }
}

/// The scaled Jacobian below which hexahedra are warned of: too distorted for many solvers.
const POOR: f64 = 0.1;

/// A warning of hexahedra that are valid, but poor, with what may help; `None` where there are none.
pub fn poor_cells(remeshed: &Remeshed, hint: &str) -> Option<String> {
    let CellList::Hexes(hexes) = remeshed.mesh.cells() else {
        return None;
    };
    let scaled = scaled_jacobians(remeshed.mesh.cells(), &remeshed.images);
    let poor = scaled.iter().enumerate().filter(|(_, s)| (0.0..POOR).contains(*s));
    let count = poor.clone().count();
    let (cell, least) = poor.min_by(|a, b| a.1.total_cmp(b.1))?;
    let corners = hexes[cell].map(|v| remeshed.images[v as usize].coords);
    let [x, y, z] = (corners.into_iter().sum::<Vector>() / 8.0).into();
    Some(format!(
        "{count} {} a scaled Jacobian below {POOR}, the least {} near ({x:.4}, {y:.4}, {z:.4}): valid, but poor. {hint}",
        if count == 1 { "hexahedron has" } else { "hexahedra have" },
        significant(*least, 2)
    ))
}

/// The lines about the mesh.
pub fn rows(report: &CarriedMeshReport, is_given: bool) -> Vec<[String; 2]> {
    let found = &report.remesh;
    let (cells, per_cell) = match found.kind {
        CellKind::Tets => ("tetrahedra", ""),
        CellKind::Hexes => (
            "hexahedra",
            " at their corners, and by bounds on the determinant inside",
        ),
    };
    let seconds = found.seconds;
    let inverted = |found: &InvalidCells, when: &str| {
        let inside = match found.inverted_inside {
            0 => String::new(),
            count => format!(" (and {count} more inside, not at corners)"),
        };
        format!("{} {when}{inside}", found.inverted)
    };
    let mut rows = vec![
        [
            "mesh".to_owned(),
            format!(
                "{} {cells}, {} nodes, {} of them on the boundary",
                found.cells, found.nodes, found.boundary_nodes
            ),
        ],
        [
            "inverted".into(),
            format!(
                "{}, {}, decided exactly{per_cell}",
                inverted(&found.before, "as mapped"),
                inverted(&found.after, "now")
            ),
        ],
    ];
    if let Some(padding) = &found.padding {
        let words = match padding.quads {
            0 => "none: every cell is one of the grid".into(),
            quads if quads == padding.of => "a layer of cells below the whole boundary".into(),
            quads => format!(
                "a layer of cells below {quads} of the grid's {} boundary quads, where it makes angles better",
                padding.of
            ),
        };
        rows.push(["padding".into(), words]);
    }
    if is_given {
        let off = significant(found.off_surface, 2);
        rows.push([
            "given".into(),
            format!("boundary within {off} of the domain's diagonal"),
        ]);
    }
    let obstacles = obstacles(&found.causes_before);
    if !obstacles.is_empty() {
        rows.push(["obstacles".into(), obstacles]);
    }
    let quality = |q: &CellQuality| {
        format!(
            "at least {}, 1 % below {}, mean {}; dihedral angles {:.1}° to {:.1}°",
            significant(q.min_scaled_jacobian, 3),
            significant(q.p01_scaled_jacobian, 3),
            significant(q.mean_scaled_jacobian, 3),
            q.min_dihedral,
            q.max_dihedral
        )
    };
    for (name, of) in [
        ("scaled Jacobian", &found.quality),
        ("as mapped", &found.quality_as_mapped),
        ("in the domain", &found.domain_quality),
    ] {
        rows.extend(of.as_ref().map(|of| [name.to_owned(), quality(of)]));
    }
    if found.invalid_in_domain > 0 {
        let cells = format!(
            "{} cells of the padding are flat or inverted in the domain, where its faces look both ways along an axis",
            found.invalid_in_domain
        );
        rows.push([String::new(), cells]);
    }
    if let Some([least, _, low, middle, high, _, most]) = found.determinants {
        rows.push([
            "det J".into(),
            format!(
                "relative to the change of the whole volume: {} to {}, 10 % {}, 50 % {}, 90 % {}",
                significant(least, 3),
                significant(most, 3),
                significant(low, 3),
                significant(middle, 3),
                significant(high, 3)
            ),
        ]);
    }
    if found.repair.iterations + found.repair.polish.iterations > 0 {
        let repair = &found.repair;
        let start = match repair.start {
            RepairStart::AsMapped => "",
            RepairStart::FiniteElements => "from finite elements, which inverted fewer cells; ",
        };
        rows.push([
            "repair".into(),
            format!(
                "{start}{} rounds, {} iterations; inner nodes moved by {} of the diagonal at most, with the polish",
                repair.rounds + repair.slide.rounds,
                repair.iterations + repair.slide.iterations,
                significant(found.largest_shift, 2)
            ),
        ]);
        let outside = &repair.boundary_split;
        if outside.edges > 0 {
            rows.push([
                "boundary split".into(),
                format!(
                    "{} edges, {} cells added, where {} pairs of boundary triangles passed through each other ({} after \
                     that) or nodes were stuck; --fix-boundary forbids it",
                    outside.edges, outside.cells_added, outside.crossings_before, outside.crossings_after
                ),
            ]);
        }
        if repair.split.cells_added > 0 {
            let added = repair.split.cells_added;
            let share = significant(
                100.0 * added as f64 / (found.cells - added - outside.cells_added) as f64,
                2,
            );
            rows.push([
                "split".into(),
                format!("{added} cells added ({share} %), where nodes were stuck; --split-stuck off forbids it"),
            ]);
        }
        if let Some(other) = &found.other_boundary {
            rows.push([
                "boundary map".into(),
                format!(
                    "another one of less distortion, {} of the diagonal from the given one in the mean, {} at most; \
                     --keep-boundary-map forbids it",
                    significant(other.mean_shift, 2),
                    significant(other.largest_shift, 2)
                ),
            ]);
        }
        rows.push([
            "boundary".into(),
            match found.slid_nodes {
                0 => "every node exactly where the boundary map puts it".into(),
                slid => format!(
                    "{slid} nodes slid along the target{}, by {} of a cell at most, {} of the diagonal; the others did \
                     not move",
                    match repair.relax.nodes {
                        0 => "",
                        _ => ", relaxed where the boundary passed through itself or sliding left inverted cells",
                    },
                    significant(found.largest_slide_in_cells, 2),
                    significant(found.largest_slide, 2)
                ),
            },
        ]);
    }
    rows.extend(polish(&found.repair.polish).map(|words| ["polish".to_owned(), words]));
    rows.push(["crossings".into(), intersections(&report.crossings)]);
    rows.push([
        "target".into(),
        format!(
            "distance to the mesh {} of the diagonal at most, {} in the mean; from the mesh {} and {}; volume {} of {}",
            significant(found.target_to_mesh.max, 2),
            significant(found.target_to_mesh.mean, 2),
            significant(found.mesh_to_target.max, 2),
            significant(found.mesh_to_target.mean, 2),
            significant(found.volume, 5),
            significant(found.target_volume, 5)
        ),
    ]);
    rows.push([
        "time".into(),
        format!(
            "{:.1} s: mesh {:.1}, map {:.1}, repair {:.1}, counting {:.1}",
            seconds.total, seconds.mesh, seconds.map, seconds.repair, seconds.verify
        ),
    ]);
    rows
}

/// The line about memory, with what was estimated.
pub fn memory_row(report: &RemeshReport, peak_rss_bytes: u64) -> [String; 2] {
    [
        "memory".into(),
        format!(
            "{:.0} MiB at most, {} by the estimate beforehand",
            mebibytes(peak_rss_bytes),
            readable(report.memory_estimate)
        ),
    ]
}

/// What became of the polish, in words.
fn polish(polish: &PolishReport) -> Option<String> {
    let PolishReport {
        outcome,
        iterations,
        kept_iterations,
    } = polish;
    Some(match outcome {
        PolishOutcome::NotAsked => return None,
        PolishOutcome::NothingInverted => "none, as nothing was inverted; --polish asks for it".into(),
        PolishOutcome::CellsInverted => "none, as cells stay inverted".into(),
        PolishOutcome::NoGain => "no node has a better place".into(),
        PolishOutcome::Kept => format!(
            "{kept_iterations} of {iterations} iterations kept, as far as neither the least scaled Jacobian nor its \
             1 % quantile falls"
        ),
        PolishOutcome::Undone => {
            format!("undone: {iterations} iterations would have lowered the least scaled Jacobian or its 1 % quantile")
        }
    })
}

/// The warning about a boundary that passes through itself.
fn warning(crossings: &BoundaryIntersections) -> Option<String> {
    match crossings {
        BoundaryIntersections::Counted { as_mapped, result } if result > as_mapped => Some(format!(
            "the boundary of the mesh passes through itself: {result} pairs of triangles, {as_mapped} before nodes \
             slid along the target. `--fix-boundary` keeps them where they are mapped; smaller cells need less sliding"
        )),
        BoundaryIntersections::Counted { result, .. } if *result > 0 => Some(format!(
            "the boundary of the mesh passes through itself where the boundary map sends it: {result} pairs of \
             triangles. Smaller cells follow the target more closely"
        )),
        _ => None,
    }
}

fn intersections(crossings: &BoundaryIntersections) -> String {
    match crossings {
        BoundaryIntersections::Counted {
            as_mapped: 0,
            result: 0,
        } => "none: the boundary does not pass through itself".into(),
        BoundaryIntersections::Counted { as_mapped, result } => {
            format!("{result} pairs of boundary triangles now, {as_mapped} as mapped")
        }
        BoundaryIntersections::NotCounted { reason } => format!("not looked for: {reason}"),
    }
}
