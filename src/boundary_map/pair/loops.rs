//! Loops of the domain that are to go to loops of the target: they decide which handle goes to which, and how often it is twisted.

use super::Landmarks;
use super::curves::{self, CurveError, CurvePoint, LandmarkCurve, Path};
use crate::mesh::SurfaceMesh;

/// Why loops do not decide on a class of maps. Loops count from 0, in the order given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LoopError {
    /// The solids have no handles.
    #[error("loops say which handle goes to which, and the solids have no handles; leave the loops out")]
    NoHandles,
    /// They are no paths on these solids.
    #[error("of the loops, {0}")]
    Path(#[from] CurveError),
    /// A loop that cuts the surface in two, or can be drawn together to a point: it says nothing on handles.
    #[error(
        "loop {index} goes around no handle of the {side}, nor along one: give vertices so close together that the shortest paths \
         between them go the way that is meant"
    )]
    NoHandle {
        /// The loop.
        index: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
    },
    /// A loop bounds inside one of the solids, as around a handle, and its partner does not, as along a handle: no map of solids
    /// takes one to the other.
    #[error(
        "loop {index} bounds a part of a plane or other surface inside the {side}, and its partner bounds none inside the other \
         solid: no map of the insides takes one to the other"
    )]
    Bounds {
        /// The loop.
        index: usize,
        /// The solid in which it bounds.
        side: &'static str,
    },
    /// No bijection of the solids takes all the loops to their partners.
    #[error(
        "no map of the solids takes all loops of the domain to their partners: do they cross each other as often on both solids, \
         and is each given in the direction of its partner?"
    )]
    Contradiction,
    /// No map that was found takes all the loops to their partners.
    #[error(
        "of {tried} maps of the handles that were tried, none takes the loops to their partners: give one for each hole, around it, such \
         that no loop meets itself or another, in the direction of its partner and from a vertex that corresponds"
    )]
    NotFound {
        /// Maps that were tried.
        tried: usize,
    },
}

/// A closed walk along edges of the domain, and that of the target to which it is to go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct LoopPair {
    pub domain: Vec<u32>,
    pub target: Vec<u32>,
}

/// The loops, and the vertices of the domain along them with their places on the target: those at the same share of the length.
pub(super) fn traced(
    loops: &[LandmarkCurve],
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
) -> Result<(Vec<LoopPair>, Vec<CurvePoint>), LoopError> {
    let closed = |path: &[u32]| path.iter().chain(path.first()).copied().collect::<Vec<u32>>();
    let closed: Vec<LandmarkCurve> = loops
        .iter()
        .map(|one| LandmarkCurve {
            domain: closed(&one.domain),
            target: closed(&one.target),
        })
        .collect();
    let walk = |path: &[u32], surface, side, index| -> Result<Vec<u32>, CurveError> {
        let mut vertices = Path::along(path, surface, side, index)?.vertices;
        vertices.pop();
        Ok(vertices)
    };
    let pair = |(index, one): (usize, &LandmarkCurve)| {
        Ok(LoopPair {
            domain: walk(&one.domain, domain, "domain", index)?,
            target: walk(&one.target, target, "target", index)?,
        })
    };
    let pairs = closed.iter().enumerate().map(pair).collect::<Result<_, CurveError>>()?;
    Ok((pairs, curves::traced(&closed, &Landmarks::none(), domain, target)?))
}

/// For solids without handles.
pub(super) fn require_none(loops: &[LandmarkCurve]) -> Result<(), LoopError> {
    match loops {
        [] => Ok(()),
        _ => Err(LoopError::NoHandles),
    }
}
