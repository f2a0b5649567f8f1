//! Where sources may stand when they are moved: outside the domain, and clear of its surface.

use super::FitError;
use super::unit_frame::UnitFrame;
use crate::geometry::SurfaceQuery;
use crate::mesh::SurfaceMesh;
use crate::{Point, Vector};

/// Least distance of a source from the surface, over the spacing of the collocation points nearest to it: from nearer, its
/// field would peak between them, where no equation sees it.
const CLEARANCE: f64 = 1.0;
/// The longest step, as a fraction of the distance from the surface: farther, the potential is far from linear.
const LONGEST_STEP: f64 = 0.5;
/// Sources stay this near to the centre of the domain, in its diagonals, or as near as they were. Their potentials on the
/// domain hardly change beyond.
const FARTHEST: f64 = 2.0;
/// Halvings of a step that leads too near to the surface, before the source stays where it is.
const HALVINGS: usize = 6;
/// By how much more than the least distance a source is moved off the surface, for rounding.
const SLACK: f64 = 1e-9;

/// The room outside a domain, in the unit frame.
pub(super) struct SourceRoom<'a> {
    query: SurfaceQuery,
    collocation: &'a [Point],
    /// Spacing of the collocation points: the square roots of their shares of the area.
    spacing: Vec<f64>,
    /// For each source: what it may not come nearer to the surface than, whatever the spacing. Sources in narrow gaps were
    /// nearer from the start.
    own: Vec<f64>,
    farthest: Vec<f64>,
}

impl<'a> SourceRoom<'a> {
    /// For sources that start at these positions, and collocation points with their shares of the area, in the unit frame.
    pub fn new(
        domain: &SurfaceMesh,
        collocation: &'a [Point],
        areas: &[f64],
        sources: &[Point],
    ) -> Result<Self, FitError> {
        let vertices = UnitFrame::of(domain).all_to_unit(domain.vertices());
        let unit = SurfaceMesh::new(vertices, domain.triangles().to_vec()).expect("as many vertices as before");
        let mut room = Self {
            query: SurfaceQuery::with_winding_sign(&unit)?,
            collocation,
            spacing: areas.iter().map(|area| area.sqrt()).collect(),
            own: Vec::new(),
            farthest: sources.iter().map(|q| q.coords.norm().max(FARTHEST)).collect(),
        };
        room.own = room.distances(sources);
        Ok(room)
    }

    /// Distances of points from the surface.
    pub fn distances(&self, points: &[Point]) -> Vec<f64> {
        let closest = self.query.closest_points(points);
        closest.iter().map(|closest| closest.distance).collect()
    }

    /// The least distance from the surface that each source may have at these positions.
    pub fn least(&self, sources: &[Point]) -> Vec<f64> {
        let least = |(p, own): (&Point, &f64)| own.min(CLEARANCE * self.spacing_near(p));
        sources.iter().zip(&self.own).map(least).collect()
    }

    /// Spacing of the collocation points about the one nearest to a point.
    fn spacing_near(&self, p: &Point) -> f64 {
        let distances = self.collocation.iter().map(|q| (q - p).norm_squared());
        let nearest = distances.zip(&self.spacing).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map_or(0.0, |(_, spacing)| *spacing)
    }

    /// The sources after steps, each shortened as far as the room calls for: `distances` are those from the surface. A
    /// source that would come too near slides along the surface, or goes a part of its way.
    pub fn moved(&self, sources: &[Point], distances: &[f64], steps: &[Vector]) -> Vec<Point> {
        let wanted = sources.iter().zip(steps).zip(distances).zip(&self.farthest);
        let wanted = wanted.map(|(((q, step), distance), farthest)| {
            let p = q + step.cap_magnitude(LONGEST_STEP * distance);
            Point::from(p.coords.cap_magnitude(*farthest))
        });
        let mut moved: Vec<Point> = wanted.collect();
        let mut blocked = self.blocked(&moved, (0..sources.len()).collect());
        let slid = self.slid(&moved, &blocked);
        let wanted = moved.clone();
        for (&s, p) in blocked.iter().zip(slid) {
            moved[s] = p;
        }
        blocked = self.blocked(&moved, blocked);
        let mut fraction = 0.5;
        for _ in 0..HALVINGS {
            for &s in &blocked {
                moved[s] = sources[s] + (wanted[s] - sources[s]) * fraction;
            }
            blocked = self.blocked(&moved, blocked);
            fraction *= 0.5;
        }
        for s in blocked {
            moved[s] = sources[s];
        }
        moved
    }

    /// Those of `which` sources that are not outside, or too near to the surface.
    fn blocked(&self, positions: &[Point], mut which: Vec<usize>) -> Vec<usize> {
        let least = self.least(positions);
        let balls: Vec<(Point, f64)> = which.iter().map(|&s| (positions[s], least[s])).collect();
        let mut free = self.query.are_outside(&balls).into_iter();
        which.retain(|_| !free.next().unwrap_or(false));
        which
    }

    /// Positions moved away from the surface by the least distance there; those inside the domain stay blocked.
    fn slid(&self, positions: &[Point], which: &[usize]) -> Vec<Point> {
        let least = self.least(positions);
        let points: Vec<Point> = which.iter().map(|&s| positions[s]).collect();
        let closest = self.query.closest_points(&points);
        let slide = |(s, closest): (&usize, crate::geometry::ClosestPoint)| {
            let away = positions[*s] - closest.point;
            let longer = (1.0 + SLACK) * least[*s] / closest.distance;
            match longer.is_finite() && longer > 1.0 {
                true => closest.point + away * longer,
                false => positions[*s],
            }
        };
        which.iter().zip(closest).map(slide).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::sampling::{Anchors, adaptive_sources};

    /// A domain in the unit frame, its vertices as collocation points, and sources as they are placed.
    struct Case {
        domain: SurfaceMesh,
        points: Vec<Point>,
        areas: Vec<f64>,
        sources: Vec<Point>,
    }

    impl Case {
        fn new(domain: &SurfaceMesh) -> Self {
            let vertices = UnitFrame::of(domain).all_to_unit(domain.vertices());
            let domain = SurfaceMesh::new(vertices, domain.triangles().to_vec()).unwrap();
            let query = SurfaceQuery::with_winding_sign(&domain).unwrap();
            let anchors = Anchors::choose(&domain, 40);
            let placed = adaptive_sources(&domain, &anchors, 1.0, &|balls| query.are_outside(balls));
            Self {
                points: domain.vertices().to_vec(),
                areas: domain.vertex_areas(),
                sources: placed.positions,
                domain,
            }
        }

        fn room(&self) -> SourceRoom<'_> {
            SourceRoom::new(&self.domain, &self.points, &self.areas, &self.sources).unwrap()
        }
    }

    /// Steps straight at the surface, across it, and in all directions, one after the other.
    #[test]
    fn sources_stay_outside_and_clear_of_the_surface() {
        for domain in [
            shapes::bumpy_sphere(10),
            shapes::torus(1.0, 0.4, 30, 14),
            shapes::spherical_shell(1.0, 0.5, 3),
        ] {
            let case = Case::new(&domain);
            let room = case.room();
            let mut sources = case.sources.clone();
            for round in 0..20 {
                let distances = room.distances(&sources);
                let closest = room.query.closest_points(&sources);
                let towards = |(k, (q, closest)): (usize, (&Point, crate::geometry::ClosestPoint))| {
                    let wave = |a: f64| (a * (k + 7 * round) as f64).sin();
                    match (k + round) % 3 {
                        0 => closest.point - q,
                        1 => 3.0 * (closest.point - q),
                        _ => 0.3 * Vector::new(wave(1.0), wave(1.7), wave(2.3)),
                    }
                };
                let steps: Vec<Vector> = sources.iter().zip(closest).enumerate().map(towards).collect();
                let moved = room.moved(&sources, &distances, &steps);
                let least = room.least(&moved);
                for ((p, least), distance) in moved.iter().zip(least).zip(room.distances(&moved)) {
                    assert!(!room.query.contains(p), "{p} is inside");
                    assert!(distance > least * (1.0 - 1e-12), "{distance} below {least}");
                }
                assert!(moved != sources, "round {round} moved nothing");
                sources = moved;
            }
        }
    }

    /// Nothing is in the way of a step outward, but its length and the distance from the domain.
    #[test]
    fn steps_are_as_long_as_the_distance_allows() {
        let case = Case::new(&shapes::sphere(1.0, 3));
        let room = case.room();
        let mut sources = case.sources.clone();
        let outward = |p: &Point| p.coords.normalize() * 10.0;
        for round in 0..10 {
            let distances = room.distances(&sources);
            let steps: Vec<Vector> = sources.iter().map(outward).collect();
            let moved = room.moved(&sources, &distances, &steps);
            for ((p, q), distance) in moved.iter().zip(&sources).zip(&distances) {
                let expected = (q.coords.norm() + LONGEST_STEP * distance).min(FARTHEST);
                assert!((p.coords.norm() - expected).abs() < 1e-12, "round {round}: {p}");
            }
            sources = moved;
        }
        assert!(sources.iter().all(|p| (p.coords.norm() - FARTHEST).abs() < 1e-12));
    }
}
