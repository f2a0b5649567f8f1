//! Whether the boundary of a remeshing passes through itself: no cell need be inverted for that.

use serde::Serialize;
use solidmap::Point;
use solidmap::remesh::Remeshed;

/// Pairs of boundary triangles that meet in more than a corner or side common to both. Quads count as two triangles.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Crossings {
    Counted {
        /// With the nodes where the boundary map sends them.
        as_mapped: usize,
        /// With the nodes of the result.
        result: usize,
    },
    NotCounted {
        reason: String,
    },
}

impl Crossings {
    pub fn of(remeshed: &Remeshed) -> Self {
        let count = || {
            let as_mapped = crossing_pairs(remeshed, &remeshed.carried)?;
            let slid = remeshed.report.slid_nodes > 0;
            let result = if slid {
                crossing_pairs(remeshed, &remeshed.images)?
            } else {
                as_mapped
            };
            Ok(Self::Counted { as_mapped, result })
        };
        count().unwrap_or_else(|reason| Self::NotCounted { reason })
    }

    /// Whether the boundary of the result is known to pass through itself.
    pub fn found(&self) -> bool {
        matches!(self, Self::Counted { result, .. } if *result > 0)
    }

    /// What there is to warn of.
    pub fn warning(&self) -> Option<String> {
        match self {
            Self::Counted { as_mapped, result } if result > as_mapped => Some(format!(
                "the boundary of the mesh passes through itself: {result} pairs of triangles, {as_mapped} before nodes \
                 slid along the target. `--fix-boundary` keeps them where they are mapped; smaller cells need less sliding"
            )),
            Self::Counted { result, .. } if *result > 0 => Some(format!(
                "the boundary of the mesh passes through itself where the boundary map sends it: {result} pairs of \
                 triangles. Smaller cells follow the target more closely"
            )),
            _ => None,
        }
    }

    /// For the table.
    pub fn words(&self) -> String {
        match self {
            Self::Counted {
                as_mapped: 0,
                result: 0,
            } => "none: the boundary does not pass through itself".into(),
            Self::Counted { as_mapped, result } => {
                format!("{result} pairs of boundary triangles now, {as_mapped} as mapped")
            }
            Self::NotCounted { reason } => format!("of the boundary not looked for: {reason}"),
        }
    }
}

#[cfg(feature = "native")]
fn crossing_pairs(remeshed: &Remeshed, positions: &[Point]) -> Result<usize, String> {
    let surface = solidmap::mesh::SurfaceMesh::new(positions.to_vec(), remeshed.mesh.boundary().to_vec())
        .map_err(|error| error.to_string())?;
    let pairs = solidmap::cgal_tetgen::self_intersections(&surface).map_err(|error| error.to_string())?;
    Ok(pairs.len())
}

#[cfg(not(feature = "native"))]
fn crossing_pairs(_: &Remeshed, _: &[Point]) -> Result<usize, String> {
    Err("it takes CGAL, which this build is without".into())
}
