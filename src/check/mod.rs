//! Examines surfaces and meshes of cells: what is wrong with one, where, and how to repair it.
//!
//! A surface can be solved on when it bounds a solid: closed, every edge between two triangles, orientable, with finite
//! coordinates and a volume. Every other defect is a warning. [`check()`] examines; [`repair()`] reorients triangles so
//! that solids face outward and cavities into the cavity, and neither moves, adds or removes anything. [`close_holes`]
//! adds triangles over small holes.
//!
//! [`examine_cells`] examines the cells of a mesh of tetrahedra or hexahedra; its boundary
//! ([`crate::mesh::CellMesh::boundary`]) is a surface for [`check()`].

mod anatomy;
mod cell_report;
mod cells;
mod display;
mod examine;
mod hanging_nodes;
mod holes;
mod repair;
mod shells;
#[cfg(test)]
mod tests;
pub(crate) mod text;

use serde::Serialize;

pub use cell_report::{BodyReport, CellFinding, CellFindingKind, CellReport};
pub use cells::{SLIVER, examine_cells};
pub use examine::check;
pub use holes::{ClosedHole, HoleError, MOST_RIM_EDGES, close_holes};
pub use repair::{AppliedRepair, RepairKind, repair};
pub use shells::ShellsError;
pub(crate) use shells::{ShellSurface, shells_of};

use crate::mesh::SurfaceMesh;

/// Finds the pairs of triangles that intersect beyond what they share, or says why it could not.
pub type FindSelfIntersections<'a> = &'a dyn Fn(&SurfaceMesh) -> Result<Vec<[u32; 2]>, String>;

/// What [`check`] found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckReport {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub faces: usize,
    /// Every edge has two triangles or more.
    pub closed: bool,
    /// No edge has more than two triangles.
    pub edge_manifold: bool,
    /// The triangles at each vertex form one fan.
    pub vertex_manifold: bool,
    /// Triangles with a common edge have the same orientation.
    pub consistently_oriented: bool,
    /// Solids face outward and cavities into the cavity.
    pub outward: bool,
    /// Whether triangles intersect.
    pub self_intersections: SelfIntersections,
    /// Total area of the triangles with finite corners.
    pub area: f64,
    /// Volume of the solid less its cavities, after [`repair()`]; `None` when the surface bounds none.
    pub volume: Option<f64>,
    /// Lowest and highest corner of the box of all finite vertices.
    pub bounding_box: Option<[[f64; 3]; 2]>,
    /// Its diagonal.
    pub diagonal: f64,
    /// Edge-connected components, in the order of their lowest triangles.
    pub components: Vec<ComponentReport>,
    /// What is wrong, errors first.
    pub findings: Vec<Finding>,
}

/// An edge-connected component of the surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComponentReport {
    /// Number of triangles.
    pub faces: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// `V - E + F`.
    pub euler_characteristic: i64,
    /// Number of handles; `None` unless it is a closed manifold.
    pub genus: Option<u64>,
    /// Area.
    pub area: f64,
    /// Volume it encloses, positive when it faces outward, after making its orientation consistent by reversing as few
    /// triangles as possible. `None` when it encloses none.
    pub volume: Option<f64>,
    /// Centre of its bounding box; `None` where that is not finite.
    pub centre: Option<[f64; 3]>,
    /// What it bounds.
    pub kind: ComponentKind,
    /// How many other components enclose it: cavities lie at odd depth. `None` for [`ComponentKind::NotAShell`].
    pub depth: Option<usize>,
    /// The innermost component that encloses it.
    pub inside: Option<usize>,
}

/// What a component bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ComponentKind {
    /// A solid, or an island in a cavity.
    Solid,
    /// A cavity in the component that it is inside of.
    Cavity,
    /// Nothing: it is open, not manifold, not orientable or not finite; or its nesting is undecided
    /// ([`FindingKind::CrowdedComponents`]).
    NotAShell,
}

/// Whether triangles intersect.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "status")]
pub enum SelfIntersections {
    /// Not looked for.
    NotChecked {
        /// Why not.
        reason: String,
    },
    /// All triangles with area and finite corners were tested.
    Checked {
        /// Intersecting pairs.
        pairs: usize,
    },
}

/// The pairs of triangles that `find` returns, and what a report says of them.
pub(crate) fn look_for_self_intersections(
    mesh: &SurfaceMesh,
    find: Option<impl Fn(&SurfaceMesh) -> Result<Vec<[u32; 2]>, String>>,
) -> (SelfIntersections, Vec<[u32; 2]>) {
    let not_checked = |reason: String| (SelfIntersections::NotChecked { reason }, Vec::new());
    match find.map(|find| find(mesh)) {
        None => not_checked("built without `native`".to_string()),
        Some(Err(reason)) => not_checked(reason),
        Some(Ok(pairs)) => (SelfIntersections::Checked { pairs: pairs.len() }, pairs),
    }
}

/// A defect of the surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Kind of defect.
    pub kind: FindingKind,
    /// Whether it prevents a solve.
    pub severity: Severity,
    /// Number of occurrences.
    pub count: usize,
    /// The first vertices concerned, 20 at most.
    pub vertices: Vec<u32>,
    /// The first edges concerned, 20 at most, by their vertices.
    pub edges: Vec<[u32; 2]>,
    /// The first triangles concerned, 20 at most.
    pub faces: Vec<u32>,
    /// What was found and where.
    pub message: String,
    /// How to repair it.
    pub advice: String,
}

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// There is no solid to solve on, or cells are not valid.
    Error,
    /// Does not prevent a solve, or is repaired by [`repair()`] first.
    Warning,
    /// Worth knowing, but no defect.
    Note,
}

/// Kinds of findings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FindingKind {
    /// No triangles with three different corners.
    Empty,
    /// Vertices with infinite or NaN coordinates.
    NonFiniteVertices,
    /// Edges with one triangle.
    OpenEdges,
    /// Edges with more than two triangles.
    NonManifoldEdges,
    /// Components that are not orientable.
    NonOrientable,
    /// So many closed components within each other's bounding boxes that their nesting was not determined.
    CrowdedComponents,
    /// Closed components that enclose nothing.
    ZeroVolume,
    /// Edges whose two triangles are oriented differently.
    InconsistentOrientation,
    /// Solids that face inward.
    Inward,
    /// Cavities whose triangles face away from the cavity.
    CavityOrientation,
    /// Pairs of components each of which is partly inside the other.
    OverlappingShells,
    /// Pairs of triangles that intersect.
    SelfIntersections,
    /// Vertices where several fans of triangles meet.
    NonManifoldVertices,
    /// Triangles over the vertices of an earlier triangle.
    DuplicateFaces,
    /// Triangles that name a vertex twice.
    RepeatedCornerFaces,
    /// Triangles with three corners and no area.
    DegenerateFaces,
    /// Vertices at the place of an earlier one.
    DuplicateVertices,
    /// Vertices that no triangle names.
    UnreferencedVertices,
}

impl CheckReport {
    /// Whether the surface bounds a solid after [`repair()`].
    pub fn is_solvable(&self) -> bool {
        self.errors().next().is_none()
    }

    /// Findings that prevent a solve.
    pub fn errors(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Error)
    }

    /// Findings that do not.
    pub fn warnings(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Warning)
    }
}
