//! The input doctor: what is wrong with a surface, where, and how to mend it.
//!
//! A surface can be solved on when it bounds a solid: closed, every edge between two triangles, orientable, with finite
//! coordinates and a volume. Everything else is reported and borne. [`check`] examines, [`mend`] turns triangles so that
//! solids face outward and cavities inward; neither moves, adds or removes anything. [`close_holes`] adds triangles over
//! small holes.

mod anatomy;
mod display;
mod examine;
mod holes;
mod mend;

use serde::Serialize;

#[cfg(test)]
mod tests;

pub use examine::check;
pub use holes::{ClosedHole, HoleError, MOST_RIM_EDGES, close_holes};
pub use mend::{Mending, MendingKind, mend};

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
    /// Neighbours across an edge agree which side is out.
    pub consistently_oriented: bool,
    /// Solids face outward and cavities into the cavity.
    pub outward: bool,
    /// Number of pairs of triangles that intersect.
    pub self_intersections: SelfIntersections,
    /// Total area of the triangles with finite corners.
    pub area: f64,
    /// Volume of the solid, cavities taken out, once mended; `None` when the surface bounds none.
    pub volume: Option<f64>,
    /// Lowest and highest corner of the box of all finite vertices.
    pub bounding_box: Option<[[f64; 3]; 2]>,
    /// Its diagonal.
    pub diagonal: f64,
    /// Parts that hang together across edges, in the order of their lowest triangles.
    pub components: Vec<ComponentReport>,
    /// What is wrong, errors first.
    pub findings: Vec<Finding>,
}

/// A part of the surface that hangs together across edges.
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
    /// Volume it encloses, positive when it faces outward. Of a component that disagrees with itself: with the fewer
    /// triangles turned. `None` when it encloses none.
    pub volume: Option<f64>,
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
    /// Nothing: it is open, not manifold, not orientable or not finite; or one of a crowd
    /// ([`FindingKind::CrowdedComponents`]).
    NotAShell,
}

/// Whether triangles intersect.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "status")]
pub enum SelfIntersections {
    /// Nobody looked.
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

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What sort of thing.
    pub kind: FindingKind,
    /// How bad.
    pub severity: Severity,
    /// How many of them there are.
    pub count: usize,
    /// The first vertices concerned, 20 at most.
    pub vertices: Vec<u32>,
    /// The first edges concerned, 20 at most, by their vertices.
    pub edges: Vec<[u32; 2]>,
    /// The first triangles concerned, 20 at most.
    pub faces: Vec<u32>,
    /// What was found and where.
    pub message: String,
    /// How to mend it.
    pub advice: String,
}

/// Whether a finding stands in the way of a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// There is no solid to solve on.
    Error,
    /// Borne, or mended by [`mend`].
    Warning,
}

/// Sorts of findings.
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
    /// Components that have one side only.
    NonOrientable,
    /// Closed components, so many of them within each other's boxes that it was not found out which enclose which.
    CrowdedComponents,
    /// Closed components that enclose nothing.
    ZeroVolume,
    /// Edges whose two triangles disagree.
    InconsistentOrientation,
    /// Solids that face inward.
    Inward,
    /// Cavities that face away from the cavity.
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
    /// Whether the surface, once mended, bounds a solid.
    pub fn is_solvable(&self) -> bool {
        self.errors().next().is_none()
    }

    /// Findings that stand in the way of a solve.
    pub fn errors(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Error)
    }

    /// Findings that do not.
    pub fn warnings(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Warning)
    }
}
