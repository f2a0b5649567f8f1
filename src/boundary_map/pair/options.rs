//! Options of [`map_pair`](super::map_pair).

use serde::Serialize;

use super::Landmarks;

/// How the domain is embedded on the target's sphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PairMethod {
    /// Pulled towards the closest points of the target, after the solids have been aligned.
    #[serde(rename = "targets")]
    SoftTargets,
    /// Centred conformal maps of both surfaces to the sphere, and the rotation under which their area distortions
    /// correlate best: the method of Li et al. (2007).
    Conformal,
}

/// How a pair is mapped.
#[derive(Debug, Clone, PartialEq)]
pub struct PairOptions {
    /// How the domain is embedded on the target's sphere.
    pub method: PairMethod,
    /// Vertices of the domain that must go to given vertices of the target.
    pub landmarks: Landmarks,
    /// Whether the solids lie in the same place, with the same size and pose, so that no alignment is sought. Three landmarks or
    /// more, and [`PairMethod::Conformal`], do not look at it.
    pub aligned: bool,
    /// Whether the distortion of the map is minimised.
    pub improve: bool,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            method: PairMethod::SoftTargets,
            landmarks: Landmarks::default(),
            aligned: false,
            improve: true,
        }
    }
}
