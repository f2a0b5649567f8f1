//! Pairs of vertices of two surfaces that a map must send to each other.

use std::collections::HashMap;

use crate::Point;

/// Pairs of vertices: `pairs[k][0]` of the domain goes to `pairs[k][1]` of the target. No vertex is in two pairs,
/// and all are in range.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Landmarks {
    pairs: Vec<[u32; 2]>,
}

/// Why pairs of vertices are not valid landmarks. Pairs count from 0, in the order given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LandmarkError {
    /// A vertex that does not exist.
    #[error("pair {pair} names vertex {vertex} of the {side}, which has {vertices} vertices (counted from 0)")]
    OutOfRange {
        /// The pair.
        pair: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// One vertex in two pairs.
    #[error("pairs {first} and {second} both name vertex {vertex} of the {side}; remove one of them")]
    Duplicate {
        /// The earlier pair.
        first: usize,
        /// The later one.
        second: usize,
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The vertex.
        vertex: u32,
    },
}

impl Landmarks {
    pub(super) const fn none() -> Self {
        Self { pairs: Vec::new() }
    }

    /// Checks pairs against the numbers of vertices of the two surfaces.
    ///
    /// # Errors
    ///
    /// When a vertex is out of range, or in two pairs.
    pub fn new(pairs: Vec<[u32; 2]>, domain_vertices: usize, target_vertices: usize) -> Result<Self, LandmarkError> {
        for (at, (side, vertices)) in [("domain", domain_vertices), ("target", target_vertices)]
            .into_iter()
            .enumerate()
        {
            let mut named = HashMap::with_capacity(pairs.len());
            for (pair, vertex) in pairs.iter().map(|p| p[at]).enumerate() {
                if vertex as usize >= vertices {
                    return Err(LandmarkError::OutOfRange {
                        pair,
                        side,
                        vertex,
                        vertices,
                    });
                }
                if let Some(first) = named.insert(vertex, pair) {
                    return Err(LandmarkError::Duplicate {
                        first,
                        second: pair,
                        side,
                        vertex,
                    });
                }
            }
        }
        Ok(Self { pairs })
    }

    /// The pairs, in the order given.
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// Positions of the pairs, from those of the vertices of domain and target.
    ///
    /// # Panics
    ///
    /// When there are fewer vertices than the landmarks were checked against.
    pub fn positions(&self, domain: &[Point], target: &[Point]) -> Vec<(Point, Point)> {
        let position = |&[a, b]: &[u32; 2]| (domain[a as usize], target[b as usize]);
        self.pairs.iter().map(position).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_in_range_and_name_every_vertex_once() {
        let landmarks = Landmarks::new(vec![[0, 4], [2, 0]], 3, 5).unwrap();
        assert_eq!(landmarks.pairs(), [[0, 4], [2, 0]]);
        let out = Landmarks::new(vec![[0, 4], [3, 0]], 3, 5).unwrap_err();
        assert!(matches!(
            out,
            LandmarkError::OutOfRange {
                pair: 1,
                side: "domain",
                vertex: 3,
                vertices: 3
            }
        ));
        let twice = Landmarks::new(vec![[0, 4], [1, 2], [2, 4]], 3, 5).unwrap_err();
        assert!(matches!(
            twice,
            LandmarkError::Duplicate {
                first: 0,
                second: 2,
                side: "target",
                vertex: 4
            }
        ));
    }
}
