//! How much of a surface a map stretches or compresses so far that it is probably wrong.
//!
//! Maps that take limbs to other limbs, or turn about a limb, stretch a part of the surface by more than bodies of one kind
//! differ. The limits are from maps whose correspondence is known: see `docs/boundary_maps.md`.

use serde::Serialize;

use super::super::BoundaryMap;
use super::super::distortion::triangle_distortions;
use crate::mesh::triangle_area;
use crate::worst_places::{PlaceKind, WorstPlace, of_triangles};

/// The shares of both surfaces' areas that are stretched or compressed too far, and where.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stretch {
    /// Lengths that change by more than this factor count, beside the ratio of the sizes of the solids.
    pub factor: f64,
    /// The part of the domain that the map stretches or compresses too far.
    #[serde(flatten)]
    pub domain: StretchedArea,
    /// The part of the target that the inverse of the map stretches or compresses too far: a very small part of the domain may cover much
    /// of the target. Right maps have more of it than of the domain, since the distortion that is minimised is weighted by the domain's
    /// area; so the limit is four times as much, at most 1.
    pub target: StretchedArea,
}

/// The part of a surface that is stretched or compressed too far.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StretchedArea {
    /// Its share of the area.
    pub share: f64,
    /// The share above which the map counts as wrong.
    pub limit: f64,
    /// Where it is, the largest area first.
    pub places: Vec<WorstPlace>,
}

/// The default of [`PairOptions::most_stretched`](super::PairOptions::most_stretched).
pub(super) const MOST_STRETCHED: f64 = 0.0075;
/// The target's limit over the domain's.
const TARGET_LIMIT: f64 = 4.0;
/// See [`Stretch::factor`].
const FACTOR: f64 = 10.0;
/// Places that are listed.
const MOST_PLACES: usize = 5;

impl Stretch {
    /// Measures a map between two surfaces, and its inverse. `None` without area, and where there is no inverse.
    pub(super) fn of(map: &BoundaryMap, limit: f64) -> Option<Self> {
        let inverse = map.inverse()?;
        let (domain, target) = rayon::join(
            || StretchedArea::of(map, limit),
            || StretchedArea::of(&inverse, (TARGET_LIMIT * limit).min(1.0)),
        );
        Some(Self {
            factor: FACTOR,
            domain: domain?,
            target: target?,
        })
    }

    /// Whether more than the limit of the domain or the target is stretched too far.
    pub fn looks_wrong(&self) -> bool {
        self.domain.is_too_large() || self.target.is_too_large()
    }

    /// The larger of the two shares, that of the target in proportion to its limit.
    pub(super) fn worst_share(&self) -> f64 {
        self.domain.share.max(self.target.share / TARGET_LIMIT)
    }
}

impl StretchedArea {
    /// Measures the map itself, over triangles cut into four. `None` without area.
    fn of(map: &BoundaryMap, limit: f64) -> Option<Self> {
        let fine = map.subdivided();
        let surface = fine.domain();
        let distortions = triangle_distortions(surface, fine.image())?;
        let corners = |t: u32| surface.corners(t as usize);
        let area = |t: u32| triangle_area(&corners(t));
        let total: f64 = (0..distortions.len() as u32).map(area).sum();
        let stretched = distortions.iter().zip(0..).filter_map(|(found, t)| {
            let [largest, least] = found.as_ref()?.stretches;
            Some((t, largest.max(1.0 / least)))
        });
        let far: Vec<(u32, f64)> = stretched.filter(|(_, stretch)| *stretch > FACTOR).collect();
        // The sum of no areas is -0.
        let share = (0.0 + far.iter().map(|(t, _)| area(*t)).sum::<f64>()) / total;
        let mut places = of_triangles(PlaceKind::Stretched, corners, surface.triangles(), &far, total);
        places.truncate(MOST_PLACES);
        Some(Self { share, limit, places })
    }

    /// Whether it is more than the limit.
    pub fn is_too_large(&self) -> bool {
        self.share > self.limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};
    use crate::spherical::SphericalEmbedding;
    use crate::{Point, Vector};

    /// A sphere to itself: a cap of 2° goes to one of 25°, linearly in the angle from the pole, and so does what is left.
    fn from_a_speck() -> BoundaryMap {
        let target = shapes::sphere(1.0, 5);
        let directions: Vec<Vector> = target.vertices().iter().map(|p| p.coords).collect();
        let [small, large, most] = [2.0, 25.0, 180.0].map(f64::to_radians);
        let domain = shapes::deformed(&target, |p| {
            let angle = p.z.clamp(-1.0, 1.0).acos();
            let new = match angle < large {
                true => angle * small / large,
                false => most - (most - angle) * (most - small) / (most - large),
            };
            let around = Vector::new(p.x, p.y, 0.0).try_normalize(1e-12).unwrap_or_default();
            Point::from(around * new.sin() + Vector::z() * new.cos())
        });
        let embedded = |surface: SurfaceMesh| SphericalEmbedding::new(surface, &directions).unwrap();
        BoundaryMap::through_sphere(embedded(domain), embedded(target.clone())).unwrap()
    }

    #[test]
    fn a_speck_of_the_domain_that_covers_much_of_the_target_is_seen() {
        let cap = |degrees: f64| 0.5 * (1.0 - degrees.to_radians().cos());
        let map = from_a_speck();
        let [there, back] = [&map, &map.inverse().unwrap()].map(|map| Stretch::of(map, MOST_STRETCHED).unwrap());
        assert!(there.looks_wrong() && !there.domain.is_too_large(), "{there:?}");
        assert!(back.looks_wrong() && !back.target.is_too_large(), "{back:?}");
        // Up to half a row of triangles at the rim: 0.04° wide inside and 1.2° outside of it on the domain, 1° on the target.
        for (found, least, most) in [
            (&there.domain, 1.9, 3.2),
            (&there.target, 24.0, 26.0),
            (&back.domain, 24.0, 26.0),
        ] {
            assert!(
                (cap(least)..cap(most)).contains(&found.share),
                "{least}° to {most}°: {found:?}"
            );
        }
        let place = there.target.places[0];
        assert!(
            (Point::from(place.centre) - Point::new(0.0, 0.0, 1.0)).norm() < 0.1,
            "{place:?}"
        );
        assert!(back.worst_share() > there.worst_share());

        let bearable = Stretch::of(&map, cap(25.0) / TARGET_LIMIT * 1.2).unwrap();
        assert!(!bearable.looks_wrong());
        let all = Stretch::of(&map, 1.0).unwrap();
        assert_eq!((all.domain.limit, all.target.limit), (1.0, 1.0));
    }
}
