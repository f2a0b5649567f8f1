//! The inverse of a map of a solid: the point of the domain that is mapped to a given point of the target.
//!
//! Newton's method with the map's Jacobian (see [`VolumeMap`]), all points together. A mapped mesh of the domain
//! supplies the start points: a point in several mapped tetrahedra has several starts, so that folds larger than a cell
//! of that mesh are found. The signs of `det J` at its preimages sum up to the winding number of the boundary's image
//! about the point (the degree of the map); where they do not, and near folds, more starts are tried.
//!
//! A map has a boundary error. Between the image of the domain's boundary and that of the target there is a gap as wide
//! as this error, and points of the target in the gap have preimages slightly outside of the domain.

mod newton;
mod seeds;

use std::time::Instant;

use rayon::prelude::*;

use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::geometry::{ClosestPoint, QueryError, SurfaceQuery};
use crate::map::VolumeMap;
use crate::progress::{ProgressMonitor, ProgressResponse};

use newton::{NewtonEffort, NewtonLimits, NewtonRoot};
use seeds::{SeedMesh, is_finite};

pub(crate) use seeds::barycentric;
pub use seeds::lattice_mesh;

/// Options of [`InverseMap`].
#[derive(Debug, Clone, PartialEq)]
pub struct InverseOptions {
    /// Distance between `f(x)` and `y` at which `x` counts as the preimage, as a fraction of the target's diagonal, at
    /// most 1e-3. Never below the rounding errors of the target's coordinates; sums over many sources do
    /// not reach less than 1e-10.
    pub tolerance: f64,
    /// Nodes of the mesh that the search starts from, at most a million: folds smaller than its cells may be missed.
    pub seed_nodes: usize,
    /// Largest number of steps of Newton's method from each start.
    pub iterations: usize,
}

impl Default for InverseOptions {
    /// 1e-10, 30 000 nodes, 60 steps.
    fn default() -> Self {
        Self {
            tolerance: 1e-10,
            seed_nodes: 30_000,
            iterations: 60,
        }
    }
}

/// Result of the search for a preimage. In files and other languages it is the number of the variant, from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum PreimageStatus {
    /// One preimage, at which the map preserves the orientation, of a point of the target or of the gap at its
    /// boundary.
    Ok,
    /// Several preimages in the domain; or one at which the map has the opposite orientation to most of the domain; or
    /// one where there must be another, because the point is farther outside of the target than the boundary error
    /// allows, or the target overlaps itself there. Of several preimages, the one with the largest oriented `det J` is
    /// returned.
    Folded,
    /// Not in the target, and no preimage in the domain.
    Outside,
    /// In the target, but no preimage was found in the domain.
    NotConverged,
    /// A coordinate is NaN or infinite.
    NotFinite,
}

/// The result for one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preimage {
    /// The kind of result.
    pub status: PreimageStatus,
    /// The preimage. [`PreimageStatus::Outside`] and [`PreimageStatus::NotConverged`]: a point of the domain whose
    /// image is near; [`PreimageStatus::NotFinite`]: NaN.
    pub point: Point,
    /// `|f(x) − y|` over the target's diagonal at the preimage; infinite without one.
    pub round_trip: f64,
    /// Number of distinct preimages found in the domain or, if there is none, in the gap.
    pub preimages: usize,
    /// The preimage lies outside of the domain: the point is in the gap between the target's boundary and the image of
    /// the domain's, no farther from the latter than twice the boundary error there and its root mean square.
    pub beyond_boundary: bool,
}

impl Preimage {
    /// The preimage, NaN where there is none.
    pub fn position(&self) -> Point {
        match self.status {
            PreimageStatus::Ok | PreimageStatus::Folded => self.point,
            _ => Point::from([f64::NAN; 3]),
        }
    }
}

/// Summary of the search for many preimages.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct InverseReport {
    /// Points asked for.
    pub points: usize,
    /// Points with one preimage.
    pub ok: usize,
    /// Points with several preimages, or one that is inverted or cannot be the only one.
    pub folded: usize,
    /// Points with several preimages.
    pub several: usize,
    /// Points outside of the target.
    pub outside: usize,
    /// Points in the target without a preimage found.
    pub not_converged: usize,
    /// Points with NaN or infinite coordinates.
    pub not_finite: usize,
    /// Preimages outside of the domain, of points in the gap.
    pub beyond_boundary: usize,
    /// Largest distance of these from the domain, as a fraction of the domain's diagonal.
    pub farthest_beyond: f64,
    /// Largest error of the map at the domain's vertices, as a fraction of the target's diagonal.
    pub boundary_error: f64,
    /// Largest `|f(x) − y|` of points with one preimage, as a fraction of the target's diagonal.
    pub round_trip_max: f64,
    /// Root mean square of the same.
    pub round_trip_rms: f64,
    /// Rounds of Newton's method until all points were done.
    pub iterations: usize,
    /// Evaluations of the map, including the nodes of the seed mesh.
    pub evaluations: usize,
    /// Nodes of the seed mesh.
    pub seed_nodes: usize,
    /// Seconds, including those for the seed mesh.
    pub seconds: f64,
    /// Seconds for the seed mesh.
    pub seed_seconds: f64,
}

/// Why the map cannot be inverted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InverseError {
    /// The domain cannot be queried.
    #[error("the domain cannot be searched: {0}")]
    Domain(#[source] QueryError),
    /// The target cannot be queried.
    #[error("the target cannot be searched: {0}")]
    Target(#[source] QueryError),
    /// A setting is out of range.
    #[error("{option} is {value}, but must be {range}")]
    Option {
        /// The field of [`InverseOptions`].
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// A surface has no extent, or squares of its size overflow or vanish.
    #[error("the diagonal of the {surface}'s box is {diagonal}, but must be positive and finite; scale the model")]
    Extent {
        /// `"domain"` or `"target"`.
        surface: &'static str,
        /// Its diagonal.
        diagonal: f64,
    },
    /// No node of the domain has a finite image.
    #[error("the map is not finite anywhere in the domain; fit it again")]
    NoValues,
    /// A progress callback cancelled the search.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

/// What finds preimages: [`InverseMap`] for any map, [`crate::bijective::BijectiveMap`] for itself.
pub trait Inverse: Sync {
    /// Preimages of the points, in order, and a report.
    fn preimages(&self, points: &[Point]) -> (Vec<Preimage>, InverseReport);
}

/// The inverse of a map, prepared once and evaluated at many points.
pub struct InverseMap<'a> {
    map: &'a dyn VolumeMap,
    boundary: &'a BoundaryMap,
    domain: SurfaceQuery,
    target: SurfaceQuery,
    seeds: SeedMesh,
    /// Boundary error at the domain's vertices, in units of the target.
    gap_rms: f64,
    gap_max: f64,
    seed_seconds: f64,
    options: InverseOptions,
    domain_diagonal: f64,
    target_diagonal: f64,
    /// Residual of a preimage, in units of the target.
    tolerance: f64,
}

/// Points searched together: enough to share all costs, few enough to limit memory.
const BATCH: usize = 1 << 17;
/// Largest number of starts from the mapped tetrahedra that contain a point, and from the nearest mapped nodes.
const MAX_CONTAINING: usize = 8;
const MAX_NEAREST: usize = 6;
/// `det J` over its mean below which a fold may be so near that there are more preimages.
const NEAR_FOLD: f64 = 0.1;
/// Residual over the target's diagonal below which the last Jacobian is kept, because a new one costs as much as the
/// value; and the largest multiple of the tolerance for this.
const NEAR: f64 = 1e-5;
const NEAR_TOLERANCES: f64 = 1e5;
/// Largest tolerance: beyond it preimages are meaningless.
const MAX_TOLERANCE: f64 = 1e-3;
/// Beyond, the seed mesh takes more than a gigabyte and gains nothing.
const MAX_SEED_NODES: usize = 1_000_000;
/// Residual from rounding errors, over the target's largest coordinate.
const ROUNDING: f64 = 8.0 * f64::EPSILON;
/// Preimages closer than this, as a fraction of the domain's diagonal, are the same; so are those closer than this
/// multiple of their uncertainty.
const SAME: f64 = 1e-6;
const SAME_UNCERTAINTIES: f64 = 4.0;
/// Distance from the domain, over its diagonal, that counts as zero: residuals cause as much.
const ON_BOUNDARY: f64 = 1e-9;
/// Longest step over the domain's diagonal.
const LONGEST_STEP: f64 = 0.1;

impl<'a> InverseMap<'a> {
    /// Maps the seed mesh. `boundary` is the boundary map that the map was fitted to.
    ///
    /// A map that sums approximately, such as [`crate::map::HarmonicMap`] over many sources, must be as accurate as the
    /// tolerance.
    ///
    /// # Errors
    ///
    /// [`InverseError`]: surfaces without triangles, without extent or with NaN among their corners, options out of
    /// range, a map that is finite nowhere.
    pub fn new(
        map: &'a dyn VolumeMap,
        boundary: &'a BoundaryMap,
        options: &InverseOptions,
    ) -> Result<Self, InverseError> {
        let start = Instant::now();
        require_options(options)?;
        let domain = SurfaceQuery::new(boundary.domain()).map_err(InverseError::Domain)?;
        // A target may overlap itself where its boundary map folds.
        let target = SurfaceQuery::with_winding_sign(&boundary.outward_target()).map_err(InverseError::Target)?;
        let domain_diagonal = finite_diagonal("domain", &domain)?;
        let target_diagonal = finite_diagonal("target", &target)?;
        let seeds = SeedMesh::new(map, boundary.domain(), &domain, options.seed_nodes);
        if seeds.is_empty() {
            return Err(InverseError::NoValues);
        }
        let gaps = gaps_at_vertices(map, boundary);
        Ok(Self {
            map,
            boundary,
            domain_diagonal,
            target_diagonal,
            tolerance: (options.tolerance * target_diagonal).max(ROUNDING * largest_coordinate(&target)),
            domain,
            target,
            seeds,
            gap_rms: root_mean_square(&gaps),
            gap_max: gaps.into_iter().fold(0.0, f64::max),
            seed_seconds: start.elapsed().as_secs_f64(),
            options: options.clone(),
        })
    }

    /// Preimages of the points, in order, and a report. They do not depend on the number of threads, if the map does
    /// not.
    pub fn preimages(&self, points: &[Point]) -> (Vec<Preimage>, InverseReport) {
        self.preimages_while(points, &|_| true)
    }

    /// As [`Self::preimages`]. `progress` is called in every iteration of Newton's method, with the number of points that
    /// are done; 131 072 points are searched for together.
    ///
    /// # Errors
    ///
    /// [`InverseError::Cancelled`] when `progress` cancels the search ([`ProgressResponse`]).
    pub fn preimages_with_progress<A: ProgressResponse>(
        &self,
        points: &[Point],
        progress: &dyn Fn(usize) -> A,
    ) -> Result<(Vec<Preimage>, InverseReport), InverseError> {
        let report = |done| progress(done).control();
        let monitor = ProgressMonitor::new(0, &report);
        let found = self.preimages_while(points, &|done| {
            monitor.report(done);
            !monitor.is_cancelled()
        });
        (!monitor.is_cancelled())
            .then_some(found)
            .ok_or(InverseError::Cancelled)
    }

    /// Searches on while it should, asking with the number of points that are done; what was found is incomplete otherwise.
    fn preimages_while(
        &self,
        points: &[Point],
        should_continue: &dyn Fn(usize) -> bool,
    ) -> (Vec<Preimage>, InverseReport) {
        let start = Instant::now();
        let mut found = Vec::with_capacity(points.len());
        let mut effort = NewtonEffort::default();
        for batch in points.chunks(BATCH) {
            let done = found.len();
            if !should_continue(done) {
                break;
            }
            let (preimages, of_batch) = self.batch(batch, &|| should_continue(done));
            effort.iterations = effort.iterations.max(of_batch.iterations);
            effort.evaluations += of_batch.evaluations;
            found.extend(preimages);
        }
        let report = InverseReport {
            points: points.len(),
            farthest_beyond: self.farthest_beyond(&found),
            boundary_error: self.gap_max / self.target_diagonal,
            iterations: effort.iterations,
            evaluations: self.seeds.node_count() + effort.evaluations,
            seed_nodes: self.seeds.node_count(),
            seconds: self.seed_seconds + start.elapsed().as_secs_f64(),
            seed_seconds: self.seed_seconds,
            ..InverseReport::of(&found)
        };
        (found, report)
    }

    /// Searches first from the mapped tetrahedra that contain the points, then, where the preimages found do not sum up
    /// to the degree of the map, from the nodes with the nearest images.
    fn batch(&self, points: &[Point], should_continue: &dyn Fn() -> bool) -> (Vec<Preimage>, NewtonEffort) {
        let containing = |y: &Point| match is_finite(y) {
            true => self.seeds.containing(y, MAX_CONTAINING),
            false => vec![],
        };
        let starts: Vec<Vec<Point>> = points.par_iter().map(containing).collect();
        let (mut found, mut effort) = self.search(points, &starts, should_continue);
        let windings = self.windings(points);

        let doubtful = self.doubtful(points, &found, &windings);
        let ys = picked(points, &doubtful);
        let starts: Vec<Vec<Point>> = ys.par_iter().map(|y| self.seeds.nearest(y, MAX_NEAREST)).collect();
        let (more, further) = self.search(&ys, &starts, should_continue);
        effort.add(further);
        for (i, more) in doubtful.into_iter().zip(more) {
            more.into_iter().for_each(|new| self.add(&mut found[i], new));
            prefer_inside(&mut found[i]);
        }
        let incomplete = self.incomplete(points, &found, &windings);
        let preimages = (0..points.len())
            .into_par_iter()
            .map(|i| self.result(&points[i], &found[i], windings[i] != 0.0, incomplete[i]))
            .collect();
        (preimages, effort)
    }

    /// Winding number of the target's surface about each point: 1 inside and 0 outside, where it does not overlap
    /// itself.
    fn windings(&self, points: &[Point]) -> Vec<f64> {
        let bounds = self.target.bounds();
        let winding = |y: &Point| match bounds.contains(y) {
            true => self.target.winding_number(y).round(),
            false => 0.0,
        };
        points.par_iter().map(winding).collect()
    }

    /// Points whose preimages do not sum up to the winding number, or that are near a fold. Of points outside without a
    /// preimage only those that the boundary error could have moved there.
    fn doubtful(&self, points: &[Point], found: &[Vec<FoundPreimage>], windings: &[f64]) -> Vec<usize> {
        let is_near_fold = |f: &FoundPreimage| self.is_near_fold(self.oriented(&f.root));
        let adds_up = |i: usize| self.degree(&found[i]) == windings[i] && !found[i].iter().any(is_near_fold);
        let outer: Vec<usize> = (0..points.len())
            .filter(|&i| is_finite(&points[i]) && found[i].is_empty() && windings[i] == 0.0)
            .collect();
        let closest = self.target.closest_points(&picked(points, &outer));
        let near = outer.iter().zip(closest).filter(|(_, c)| c.distance <= self.gap_max);
        let near = near.map(|(&i, _)| i);
        let others = (0..points.len()).filter(|&i| is_finite(&points[i]) && !adds_up(i));
        let mut doubtful: Vec<usize> = near.chain(others).collect();
        doubtful.sort_unstable();
        doubtful
    }

    /// The distinct preimages that Newton's method finds from the starts of each point.
    fn search(
        &self,
        points: &[Point],
        starts: &[Vec<Point>],
        should_continue: &dyn Fn() -> bool,
    ) -> (Vec<Vec<FoundPreimage>>, NewtonEffort) {
        let pairs: Vec<(Point, Point)> = points
            .iter()
            .zip(starts)
            .flat_map(|(y, seeds)| seeds.iter().map(|seed| (*y, *seed)))
            .collect();
        let limits = NewtonLimits {
            tolerance: self.tolerance,
            near: (NEAR_TOLERANCES * self.tolerance).min(NEAR * self.target_diagonal),
            first_step: 2.0 * self.seeds.spacing,
            longest_step: LONGEST_STEP * self.domain_diagonal,
            iterations: self.options.iterations,
        };
        let (mut roots, mut effort) = newton::solve(self.map, &pairs, &limits, should_continue);
        effort.evaluations += self.update_jacobians(&mut roots);
        let (beyond, evaluations) = self.beyond(&pairs, &roots);
        effort.evaluations += evaluations;
        let mut all = roots.iter().zip(beyond);
        let distinct = |seeds: &Vec<Point>| {
            let mut found = Vec::new();
            for (root, beyond) in all.by_ref().take(seeds.len()) {
                if let Some(beyond) = beyond {
                    self.add(&mut found, FoundPreimage { root: *root, beyond });
                }
            }
            prefer_inside(&mut found);
            found
        };
        (starts.iter().map(distinct).collect(), effort)
    }

    /// Evaluates the Jacobian anew at roots near folds, where the last step may have changed its sign. Returns the
    /// number of evaluations.
    fn update_jacobians(&self, roots: &mut [NewtonRoot]) -> usize {
        let is_stale =
            |root: &&mut NewtonRoot| root.converged && !root.is_fresh && self.is_near_fold(self.oriented(root).abs());
        let stale: Vec<&mut NewtonRoot> = roots.iter_mut().filter(is_stale).collect();
        if stale.is_empty() {
            return 0;
        }
        let jacobians = self.map.jacobian(&stale.iter().map(|root| root.x).collect::<Vec<_>>());
        let count = stale.len();
        for (root, jacobian) in stale.into_iter().zip(jacobians) {
            root.jacobian = jacobian;
            root.is_fresh = true;
        }
        count
    }

    /// Distance of each root from the domain: 0 inside, `None` for roots that are not converged, or outside and not in
    /// the gap. Also the number of evaluations.
    fn beyond(&self, pairs: &[(Point, Point)], roots: &[NewtonRoot]) -> (Vec<Option<f64>>, usize) {
        let converged: Vec<usize> = (0..roots.len()).filter(|&i| roots[i].converged).collect();
        let places: Vec<Point> = converged.iter().map(|&i| roots[i].x).collect();
        let inside = self.domain.contains_all(&places);
        let mut beyond = vec![None; roots.len()];
        let mut outer = Vec::new();
        for (&i, inside) in converged.iter().zip(inside) {
            if inside {
                beyond[i] = Some(0.0);
            } else {
                outer.push(i);
            }
        }
        let places: Vec<Point> = outer.iter().map(|&i| roots[i].x).collect();
        let gaps = self.gaps_next_to(&places);
        for (gap, &i) in gaps.iter().zip(&outer) {
            if gap.distance <= ON_BOUNDARY * self.domain_diagonal {
                beyond[i] = Some(0.0);
            } else if (pairs[i].0 - gap.image).norm() <= gap.width + self.tolerance {
                beyond[i] = Some(gap.distance);
            }
        }
        (beyond, outer.len())
    }

    /// The gap at the points of the domain's boundary that are closest to `places`.
    fn gaps_next_to(&self, places: &[Point]) -> Vec<BoundaryGap> {
        let closest = self.domain.closest_points(places);
        let images = self.map.evaluate(&closest.iter().map(|c| c.point).collect::<Vec<_>>());
        let on_boundary = closest.iter().map(ClosestPoint::surface_point);
        let expected = self.boundary.evaluate(&on_boundary.collect::<Vec<_>>());
        let gap = |((closest, image), expected): ((&ClosestPoint, Point), Point)| BoundaryGap {
            distance: closest.distance,
            image,
            width: 2.0 * (expected - image).norm() + self.gap_rms,
        };
        closest.iter().zip(images).zip(expected).map(gap).collect()
    }

    /// Whether a point must have more preimages than the one found in the domain: the winding number of the target
    /// differs, and the point is farther from the target's boundary than the gap is wide there.
    fn incomplete(&self, points: &[Point], found: &[Vec<FoundPreimage>], windings: &[f64]) -> Vec<bool> {
        let is_alone = |i: usize| matches!(&found[i][..], [only] if only.beyond == 0.0);
        let suspects: Vec<usize> = (0..points.len())
            .filter(|&i| is_alone(i) && self.degree(&found[i]) != windings[i])
            .collect();
        let gaps = self.gaps_next_to(&suspects.iter().map(|&i| found[i][0].root.x).collect::<Vec<_>>());
        let surface = self.target.closest_points(&picked(points, &suspects));
        let slack = self.tolerance.max(ON_BOUNDARY * self.target_diagonal);
        let mut incomplete = vec![false; points.len()];
        for ((&i, gap), surface) in suspects.iter().zip(gaps).zip(surface) {
            incomplete[i] = surface.distance > gap.width + slack;
        }
        incomplete
    }

    /// Adds a preimage unless it is known already.
    fn add(&self, found: &mut Vec<FoundPreimage>, new: FoundPreimage) {
        // What the seed mesh resolves is different, however large the uncertainty at a fold.
        let reach = |root: &NewtonRoot| (SAME_UNCERTAINTIES * root.uncertainty()).min(self.seeds.spacing);
        let is_new = |known: &FoundPreimage| {
            let uncertain = reach(&known.root).max(reach(&new.root));
            (known.root.x - new.root.x).norm() > uncertain.max(SAME * self.domain_diagonal)
        };
        if found.iter().all(is_new) {
            found.push(new);
        }
    }

    /// `det J` relative to the orientation of most of the domain.
    fn oriented(&self, root: &NewtonRoot) -> f64 {
        self.seeds.orientation * root.jacobian.determinant()
    }

    fn is_near_fold(&self, det: f64) -> bool {
        det < NEAR_FOLD * self.seeds.mean_det
    }

    fn degree(&self, found: &[FoundPreimage]) -> f64 {
        found.iter().map(|f| self.oriented(&f.root).signum()).sum()
    }

    fn result(&self, y: &Point, found: &[FoundPreimage], in_target: bool, incomplete: bool) -> Preimage {
        let det = |f: &FoundPreimage| self.oriented(&f.root);
        let Some(best) = found.iter().max_by(|a, b| det(a).total_cmp(&det(b))) else {
            let (status, point) = match (is_finite(y), in_target) {
                (false, _) => (PreimageStatus::NotFinite, Point::from([f64::NAN; 3])),
                (true, true) => (PreimageStatus::NotConverged, self.seeds.nearest_node(y)),
                (true, false) => (PreimageStatus::Outside, self.seeds.nearest_node(y)),
            };
            return Preimage {
                status,
                point,
                round_trip: f64::INFINITY,
                preimages: 0,
                beyond_boundary: false,
            };
        };
        let one_to_one = found.len() == 1 && !incomplete && det(best) > 0.0;
        Preimage {
            status: if one_to_one {
                PreimageStatus::Ok
            } else {
                PreimageStatus::Folded
            },
            point: best.root.x,
            round_trip: best.root.residual / self.target_diagonal,
            preimages: found.len(),
            beyond_boundary: best.beyond > 0.0,
        }
    }

    /// Largest distance of preimages beyond the boundary, as a fraction of the domain's diagonal.
    fn farthest_beyond(&self, found: &[Preimage]) -> f64 {
        let beyond: Vec<Point> = found.iter().filter(|p| p.beyond_boundary).map(|p| p.point).collect();
        let closest = self.domain.closest_points(&beyond);
        closest.iter().map(|c| c.distance).fold(0.0, f64::max) / self.domain_diagonal
    }
}

impl Inverse for InverseMap<'_> {
    fn preimages(&self, points: &[Point]) -> (Vec<Preimage>, InverseReport) {
        self.preimages(points)
    }
}

impl InverseReport {
    /// Counts of the results, and their round trips; what depends on how they were found is left at 0.
    pub(crate) fn of(found: &[Preimage]) -> Self {
        let count = |status| found.iter().filter(|p| p.status == status).count();
        let ok = found.iter().filter(|p| p.status == PreimageStatus::Ok);
        let errors: Vec<f64> = ok.map(|p| p.round_trip).collect();
        Self {
            points: found.len(),
            ok: count(PreimageStatus::Ok),
            folded: count(PreimageStatus::Folded),
            outside: count(PreimageStatus::Outside),
            not_converged: count(PreimageStatus::NotConverged),
            not_finite: count(PreimageStatus::NotFinite),
            several: found.iter().filter(|p| p.preimages > 1).count(),
            beyond_boundary: found.iter().filter(|p| p.beyond_boundary).count(),
            round_trip_rms: root_mean_square(&errors),
            round_trip_max: errors.into_iter().fold(0.0, f64::max),
            ..Self::default()
        }
    }
}

/// A preimage in the domain, or outside of it in the gap.
struct FoundPreimage {
    root: NewtonRoot,
    beyond: f64,
}

/// The gap next to a point.
struct BoundaryGap {
    /// Distance of the point from the domain's boundary.
    distance: f64,
    /// Image of the closest point of the domain's boundary.
    image: Point,
    /// Twice the boundary error there and its root mean square, in units of the target.
    width: f64,
}

/// Drops preimages outside of the domain where there is one inside.
fn prefer_inside(found: &mut Vec<FoundPreimage>) {
    if found.iter().any(|f| f.beyond == 0.0) {
        found.retain(|f| f.beyond == 0.0);
    }
}

/// The diagonal of the surface's box.
fn finite_diagonal(surface: &'static str, query: &SurfaceQuery) -> Result<f64, InverseError> {
    let diagonal = query.bounds().extent().norm();
    if diagonal > 0.0 && diagonal.is_finite() {
        return Ok(diagonal);
    }
    Err(InverseError::Extent { surface, diagonal })
}

fn largest_coordinate(query: &SurfaceQuery) -> f64 {
    let bounds = query.bounds();
    bounds.low.coords.amax().max(bounds.high.coords.amax())
}

/// Boundary errors at the domain's vertices.
fn gaps_at_vertices(map: &dyn VolumeMap, boundary: &BoundaryMap) -> Vec<f64> {
    let images = map.evaluate(boundary.domain().vertices());
    let pairs = images.iter().zip(boundary.image());
    let gaps = pairs.map(|(found, expected)| (found - expected).norm());
    gaps.filter(|gap| gap.is_finite()).collect()
}

fn root_mean_square(values: &[f64]) -> f64 {
    // The sum of no values is -0.
    let squares: f64 = values.iter().map(|value| value * value).sum::<f64>() + 0.0;
    (squares / values.len().max(1) as f64).sqrt()
}

fn picked(points: &[Point], indices: &[usize]) -> Vec<Point> {
    indices.iter().map(|&i| points[i]).collect()
}

fn require_options(options: &InverseOptions) -> Result<(), InverseError> {
    let refuse = |option, value, range| Err(InverseError::Option { option, value, range });
    let tolerance = options.tolerance;
    if tolerance.is_nan() || tolerance <= 0.0 || tolerance > MAX_TOLERANCE {
        return refuse("tolerance", tolerance, "greater than 0 and at most 1e-3");
    }
    if !(1..=MAX_SEED_NODES).contains(&options.seed_nodes) {
        return refuse("seed_nodes", options.seed_nodes as f64, "from 1 to 1000000");
    }
    if options.iterations == 0 {
        return refuse("iterations", 0.0, "greater than 0");
    }
    Ok(())
}
