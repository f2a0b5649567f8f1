//! Options of [`map_pair`](super::map_pair).

use serde::Serialize;

use super::stretch::MOST_STRETCHED;
use super::{LandmarkCurve, Landmarks};
use crate::Vector;
use crate::boundary_map::BoundaryMap;

/// How the domain is embedded on the target's sphere or torus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PairMethod {
    /// Pulled towards the closest points of the target, after the solids have been aligned.
    #[serde(rename = "targets")]
    SoftTargets,
    /// Centred conformal maps of both surfaces to the sphere, and the rotation under which their area distortions
    /// correlate best: the method of Li et al. (2007).
    Conformal,
    /// Both are laid out on flat tori: what is done with solids of genus 1, also by [`Self::SoftTargets`]. Solids of another
    /// genus are refused.
    #[serde(rename = "tori")]
    FlatTori,
    /// Both are laid out on a hyperbolic surface: what is done with solids of genus 2 and more, also by [`Self::SoftTargets`].
    #[serde(rename = "hyperbolic")]
    HyperbolicSurface,
}

/// How a pair is mapped.
#[derive(Debug, Clone)]
pub struct PairOptions {
    /// How the domain is embedded on the target's sphere.
    pub method: PairMethod,
    /// Vertices of the domain that must go to given vertices of the target.
    pub landmarks: Landmarks,
    /// `None`: landmarks are met exactly. Otherwise they are soft, with this weight: a landmark that is a tenth of the root of
    /// the target's area away from where it is to be costs as much as a rise of the mean energy by this many percent of
    /// that of an isometry.
    pub landmarks_weight: Option<f64>,
    /// Paths that are to go to paths of the target, as near as their distortion allows.
    pub curves: Vec<LandmarkCurve>,
    /// As `landmarks_weight`, for all vertices of the curves together.
    pub curves_weight: f64,
    /// For solids with handles: closed paths, whose last vertex is joined to the first, that are to go to closed paths of the target, up to a
    /// deformation along the surface. They decide which handle goes to which, in which direction, and how often it is twisted. With several
    /// handles, one around the hole of each is needed, none of which meets itself or another; what further ones say is checked.
    pub loops: Vec<LandmarkCurve>,
    /// Shells of the domain, which are components and cavities, that go to given shells of the target. They count from 0 in the order of
    /// their first triangles, as the components of [`CheckReport`](crate::check::CheckReport::components) do. Shells around them then
    /// go to each other; all others find their partners by themselves.
    pub components: Vec<[usize; 2]>,
    /// Directions of the domain and of the target that correspond roughly, within 60°: which way is up.
    pub up: Option<[Vector; 2]>,
    /// A map of this domain to start from: nothing else is sought. One that was composed with an embedding of this target is
    /// the start itself; of others the images of vertices are soft targets. Of solids with several shells each starts from its own part,
    /// and goes where that takes it.
    pub start: Option<BoundaryMap>,
    /// Number of other maps that are wanted, for [`map_pair_with_alternatives`](super::map_pair_with_alternatives).
    pub alternatives: usize,
    /// Share of the domain's area above which the map counts as wrong when it is stretched or compressed by more than
    /// [a factor](super::Stretch::factor) there. Of the target's area it is four times as much, at most 1.
    pub most_stretched: f64,
    /// Whether the solids lie in the same place, with the same size and pose, so that no alignment is sought.
    /// [`PairMethod::Conformal`] does not look at it.
    pub aligned: bool,
    /// Whether the distortion of the map is minimised.
    pub improve: bool,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            method: PairMethod::SoftTargets,
            landmarks: Landmarks::default(),
            landmarks_weight: None,
            curves: vec![],
            curves_weight: 1000.0,
            loops: vec![],
            components: vec![],
            up: None,
            start: None,
            alternatives: 0,
            most_stretched: MOST_STRETCHED,
            aligned: false,
            improve: true,
        }
    }
}
