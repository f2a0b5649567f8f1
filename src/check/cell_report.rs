//! What is wrong with a mesh of cells, in numbers and in words.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;

use super::Severity;
use super::display::short;
use super::text::{counted, label_of, write_ids, write_wrapped};

/// Bodies listed one by one; the rest are counted.
const LISTED: usize = 12;

/// What [`super::examine_cells`] found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CellReport {
    /// `"tets"` or `"hexes"`.
    pub kind: &'static str,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of cells.
    pub cells: usize,
    /// Cells that are inverted.
    pub inverted_cells: usize,
    /// Cells that are exactly flat: tetrahedra, or a corner of a hexahedron.
    pub flat_cells: usize,
    /// Cells that are neither, with a scaled Jacobian below [`super::SLIVER`].
    pub slivers: usize,
    /// Least scaled Jacobian over the cells, negative for inverted ones; 1 for regular tetrahedra and cubes. `None`
    /// without a cell that has one.
    pub min_scaled_jacobian: Option<f64>,
    /// Its 1st percentile.
    pub p01_scaled_jacobian: Option<f64>,
    /// Its mean.
    pub mean_scaled_jacobian: Option<f64>,
    /// Parts connected across faces, in the order of their first cells.
    pub bodies: Vec<BodyReport>,
    /// What is wrong, errors first, notes last.
    pub findings: Vec<CellFinding>,
}

/// A part of the mesh whose cells are connected across faces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BodyReport {
    /// Number of cells.
    pub cells: usize,
    /// Sum of their volumes, inverted ones negative.
    pub volume: f64,
}

/// Something found in a mesh of cells.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CellFinding {
    /// What was found.
    pub kind: CellFindingKind,
    /// [`Severity::Error`] where the mesh is not valid; else [`Severity::Note`].
    pub severity: Severity,
    /// Number of occurrences.
    pub count: usize,
    /// The first cells concerned, 20 at most; of slivers the worst, of bodies the first cell of the largest.
    pub cells: Vec<u32>,
    /// The first vertices concerned, 20 at most.
    pub vertices: Vec<u32>,
    /// Where they are: the positions of `vertices`, or else the means of the corners of `cells`.
    pub places: Vec<[f64; 3]>,
    /// What was found and where.
    pub message: String,
    /// What to do about it.
    pub advice: String,
}

/// Kinds of findings in meshes of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum CellFindingKind {
    /// No cells.
    Empty,
    /// Vertices with infinite or NaN coordinates.
    NonFiniteVertices,
    /// Cells that name a vertex twice.
    RepeatedCornerCells,
    /// Cells of the wrong orientation.
    InvertedCells,
    /// Cells without volume; hexahedra with a corner without.
    FlatCells,
    /// Pairs of cells on the same side of a face, however cells are oriented.
    NonOrientable,
    /// Faces of more than two cells.
    CrowdedFaces,
    /// Pairs of hexahedra that connect the same four vertices to different faces.
    CrossedFaces,
    /// Cells over the vertices of an earlier one.
    DuplicateCells,
    /// Vertices inside a face or an edge of a cell.
    HangingNodes,
    /// Pairs of cells with faces that overlap and are not the same.
    MismatchedFaces,
    /// Cells that are almost flat.
    Slivers,
    /// Cells whose corners are listed in the other orientation than VTK's.
    LeftHandedCells,
    /// Parts that share no face.
    SeveralBodies,
    /// Vertices that no cell names.
    UnusedVertices,
}

impl CellReport {
    /// Whether no finding is an error: all cells are right side out, have a volume, and fit together.
    pub fn is_valid(&self) -> bool {
        self.findings.iter().all(|finding| finding.severity != Severity::Error)
    }

    fn verdict(&self) -> String {
        let count = |severity| self.findings.iter().filter(|f| f.severity == severity).count();
        let notes = match count(Severity::Note) {
            0 => String::new(),
            notes => format!(", with {}", counted(notes, "note")),
        };
        match count(Severity::Error) {
            0 => format!("Valid cells: none is inverted or flat, and they fit together{notes}."),
            errors => format!("NOT VALID: {} in the cells{notes}.", counted(errors, "error")),
        }
    }
}

impl Display for CellReport {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let elements = if self.kind == "tets" { "tetrahedra" } else { "hexahedra" };
        let number = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.3}"));
        writeln!(f, "{}\n", self.verdict())?;
        let quality = format!(
            "least {}, 1 % below {}, mean {}",
            number(self.min_scaled_jacobian),
            number(self.p01_scaled_jacobian),
            number(self.mean_scaled_jacobian)
        );
        for (name, fact) in [
            (elements, self.cells.to_string()),
            ("vertices", self.vertices.to_string()),
            ("volume", short(self.bodies.iter().map(|body| body.volume).sum())),
            ("inverted", self.inverted_cells.to_string()),
            ("flat", self.flat_cells.to_string()),
            ("slivers", self.slivers.to_string()),
            ("scaled Jacobian", quality),
            ("bodies", self.bodies.len().to_string()),
        ] {
            writeln!(f, "  {name:<22} {fact}")?;
        }
        if self.bodies.len() > 1 {
            writeln!(f, "\n  {:>9} {:>10} {:>11}", "body", "cells", "volume")?;
            for (number, body) in self.bodies.iter().take(LISTED).enumerate() {
                writeln!(f, "  {number:>9} {:>10} {:>11}", body.cells, short(body.volume))?;
            }
            if self.bodies.len() > LISTED {
                writeln!(f, "  ... and {} more", self.bodies.len() - LISTED)?;
            }
        }
        for finding in &self.findings {
            write!(f, "\n{finding}")?;
        }
        if !self.findings.is_empty() {
            writeln!(f, "\nVertices and cells are counted from 0, in the order of the file.")?;
        }
        Ok(())
    }
}

impl Display for CellFinding {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f, "{}: {}", label_of(self.severity), self.message)?;
        write_ids(f, "vertices", &self.vertices, self.count.max(self.vertices.len()))?;
        write_ids(f, "cells", &self.cells, self.count.max(self.cells.len()))?;
        // The first place is in the message.
        let others: Vec<String> = self.places.iter().skip(1).take(3).map(coordinates).collect();
        if !others.is_empty() {
            let more = if self.count > others.len() + 1 { ", ..." } else { "" };
            writeln!(f, "  the next: {}{more}", others.join(", "))?;
        }
        write_wrapped(f, "  repair: ", &self.advice)
    }
}

/// Coordinates to six digits.
pub(super) fn coordinates(p: &[f64; 3]) -> String {
    let number = |x: f64| {
        if x == 0.0 || (1e-4..1e7).contains(&x.abs()) {
            let decimals = (5 - x.abs().max(1e-4).log10().floor() as i32).clamp(0, 9) as usize;
            let text = format!("{x:.decimals$}");
            let trimmed = match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.'),
                false => &text,
            };
            trimmed.to_owned()
        } else {
            format!("{x:.5e}")
        }
    };
    let [x, y, z] = p.map(number);
    format!("({x}, {y}, {z})")
}
