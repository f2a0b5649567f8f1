//! Measurements of maps, the same for all methods.

use std::time::Instant;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::CompareError;
use super::build::images_of;
use crate::boundary_map::BoundaryMap;
use crate::energy::{
    AdaptiveOptions, DistortionReport, EnergyOptions, EnergyReport, GridResolution, Quadrature, adaptive_energies,
    clipped_grid, distortion_of_jacobians, energies,
};
use crate::fit::BoundaryError;
use crate::geometry::{SurfaceQuery, flipped_tets};
use crate::map::VolumeMap;
use crate::mesh::TetMesh;
use crate::statistics::Summary;
use crate::{Point, Vector};

/// Options of [`MapEvaluator`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvaluationOptions {
    /// Cells of the grid along the longest side of the domain, which maps are evaluated on, and whose cells are divided
    /// until a map's energies are accurate to 1 %.
    pub resolution: usize,
    /// Points inside at which maps are compared.
    pub interior: usize,
    /// Boundary points at which the boundary error is averaged.
    pub held_out: usize,
    /// Seed of all random points.
    pub seed: u64,
}

impl Default for EvaluationOptions {
    fn default() -> Self {
        Self {
            resolution: 40,
            interior: 5000,
            held_out: 20_000,
            seed: 1,
        }
    }
}

/// Measures all maps of one boundary map in the same way.
pub struct MapEvaluator<'a> {
    boundary: &'a BoundaryMap,
    accuracy: AdaptiveOptions,
    quadrature: Quadrature,
    interior: Vec<Point>,
    /// Boundary points to average over, and their seed: not that of a fit, which may have used its points to decide
    /// when to stop.
    held_out: usize,
    seed: u64,
}

/// Distances between two maps at the points inside, as fractions of the target's diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct MapDifference {
    /// Root mean square.
    pub rms: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

/// Measurements of a map.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MapMeasurements {
    /// Distance from the boundary map at points of the boundary that no method was fitted to. By the maximum principle
    /// a harmonic map errs no more inside than at its worst point of the boundary.
    pub boundary_error: BoundaryError,
    /// Energies, with their errors: by the grid that all maps share, its cells divided where this map needs it. Without
    /// errors by that grid as it is, if points of divided cells have no values.
    pub energy: EnergyReport,
    /// Distortion, by the same quadrature.
    pub distortion: DistortionReport,
    /// Seconds for images and Jacobians at the points of [`MapEvaluator::quadrature`].
    pub evaluate_seconds: f64,
    /// Points that the energies were integrated with.
    pub quadrature_points: usize,
}

/// Images of the points inside.
#[derive(Debug, Clone, PartialEq)]
pub struct InteriorImages {
    /// In the order of [`MapEvaluator::interior`].
    pub images: Vec<Point>,
}

/// Tetrahedra that a map inverts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FoldCount {
    /// Tetrahedra of the mesh.
    pub tets: usize,
    /// Those that are flat or have the opposite orientation to the whole, decided exactly: a map that mirrors the solid
    /// as a whole folds nothing.
    pub flipped: usize,
}

/// Largest number of points that energies are integrated with, as a multiple of those of the grid, and at least: fewer than
/// for one map alone, since a map by mean value coordinates takes as long for each point as the surface is large.
const POINTS_FACTOR: usize = 4;
const LEAST_LIMIT: usize = 20_000;
/// Largest number of random points to try for each point inside.
const TRIES: usize = 1000;

impl<'a> MapEvaluator<'a> {
    /// Chooses the quadrature and the points.
    ///
    /// # Errors
    ///
    /// When the domain is open or too thin.
    pub fn new(boundary: &'a BoundaryMap, options: &EvaluationOptions) -> Result<Self, CompareError> {
        let domain = boundary.domain();
        let resolution = GridResolution::CellsAlongLongestSide(options.resolution);
        let quadrature = clipped_grid(domain, resolution)?;
        Ok(Self {
            accuracy: AdaptiveOptions {
                resolution,
                max_points: Some((POINTS_FACTOR * quadrature.points().len()).max(LEAST_LIMIT)),
                ..AdaptiveOptions::default()
            },
            quadrature,
            interior: interior_points(boundary, options.interior, options.seed)?,
            held_out: options.held_out,
            seed: options.seed.wrapping_add(1),
            boundary,
        })
    }

    /// Points inside the domain, uniform by volume.
    pub fn interior(&self) -> &[Point] {
        &self.interior
    }

    /// The grid that all maps are evaluated on.
    pub fn quadrature(&self) -> &Quadrature {
        &self.quadrature
    }

    /// Measures a map.
    ///
    /// # Errors
    ///
    /// When the map is not finite somewhere.
    pub fn measure(&self, map: &dyn VolumeMap) -> Result<MapMeasurements, CompareError> {
        let start = Instant::now();
        std::hint::black_box(map.jacobian(self.quadrature.points()));
        let images = map.evaluate(self.quadrature.points());
        let evaluate_seconds = start.elapsed().as_secs_f64();
        require_finite(&images)?;
        let (domain, target) = (self.boundary.domain(), self.boundary.target_volume());
        let options = EnergyOptions::default();
        let (quadrature, energy) = match adaptive_energies(map, domain, target, &options, &self.accuracy) {
            Ok(found) => found,
            // Where a surface crosses itself, parts of cells may have points without values.
            Err(_) => {
                let undivided = self.quadrature.clone();
                let energy = energies(map, &undivided, undivided.volume(), target, &options)?;
                (undivided, energy)
            }
        };
        let jacobians = map.jacobian(quadrature.points());
        Ok(MapMeasurements {
            boundary_error: boundary_error(map, self.boundary, self.held_out, self.seed)?,
            energy,
            distortion: distortion_of_jacobians(&jacobians, &quadrature, quadrature.volume(), target)?,
            evaluate_seconds,
            quadrature_points: quadrature.points().len(),
        })
    }

    /// Images of the points inside.
    ///
    /// # Errors
    ///
    /// When one is not finite.
    pub fn interior_images(&self, map: &dyn VolumeMap) -> Result<InteriorImages, CompareError> {
        let images = map.evaluate(&self.interior);
        require_finite(&images)?;
        Ok(InteriorImages { images })
    }

    /// The distance between two maps at the points inside.
    pub fn difference(&self, a: &InteriorImages, b: &InteriorImages) -> MapDifference {
        let diagonal = self.boundary.target_diagonal();
        let pairs = a.images.iter().zip(&b.images);
        let distances: Vec<f64> = pairs.map(|(p, q)| (p - q).norm() / diagonal).collect();
        MapDifference::of(&distances).unwrap_or_default()
    }
}

impl MapDifference {
    fn of(distances: &[f64]) -> Option<Self> {
        let Summary { rms, p99, max, .. } = Summary::of(distances)?;
        Some(Self { rms, p99, max })
    }
}

/// Distance of a map from the boundary map at points of the boundary that depend on the seed: averages over `even`
/// points, the largest also over one in each triangle.
///
/// # Errors
///
/// When the map is not finite at one.
pub fn boundary_error(
    map: &dyn VolumeMap,
    boundary: &BoundaryMap,
    even: usize,
    seed: u64,
) -> Result<BoundaryError, CompareError> {
    crate::fit::boundary_error(map, boundary, even, seed).map_err(|_| CompareError::NonFiniteBoundary)
}

impl FoldCount {
    /// Counts inverted tetrahedra, from a mesh and the images of its vertices.
    pub fn of(mesh: &TetMesh, images: &[Point]) -> Self {
        let tets = mesh.tets().len();
        let flipped = flipped_tets(mesh, images).map_or(tets, |found| {
            let image = mesh.with_vertices(images.to_vec());
            let volume = |image: TetMesh| -> f64 {
                let signed = |t| image.signed_volume(t) * mesh.signed_volume(t).signum();
                (0..tets).map(signed).sum()
            };
            if image.map_or(0.0, volume) < 0.0 {
                tets - found.negative - found.flat_in_domain
            } else {
                found.count()
            }
        });
        Self { tets, flipped }
    }
}

/// Images of the vertices of a mesh of the domain: on its boundary by the boundary map, inside by the map.
///
/// # Errors
///
/// When the mesh or the domain has no boundary, or the two boundaries are too far apart.
pub fn carried(mesh: &TetMesh, boundary: &BoundaryMap, map: &dyn VolumeMap) -> Result<Vec<Point>, CompareError> {
    let mut images = map.evaluate(mesh.vertices());
    let fixed = images_of(mesh, boundary)?;
    for (&vertex, image) in fixed.vertices.iter().zip(&fixed.images) {
        images[vertex as usize] = *image;
    }
    Ok(images)
}

/// The distance of the maps of one method from their mean, over all maps and points, as a fraction of `diagonal`.
/// `None` for fewer than two maps.
pub fn spread(samples: &[InteriorImages], diagonal: f64) -> Option<MapDifference> {
    let [first, _, ..] = samples else { return None };
    let points = first.images.len();
    let count = samples.len() as f64;
    let distances = |i: usize| {
        let mean: Vector = samples.iter().map(|s| s.images[i].coords / count).sum();
        let distance = move |s: &InteriorImages| (s.images[i].coords - mean).norm() / diagonal;
        samples.iter().map(distance)
    };
    let distances: Vec<f64> = (0..points).flat_map(distances).collect();
    MapDifference::of(&distances)
}

fn interior_points(boundary: &BoundaryMap, count: usize, seed: u64) -> Result<Vec<Point>, CompareError> {
    let domain = boundary.domain();
    let query = SurfaceQuery::with_winding_sign(domain)?;
    let (low, high) = domain.bounding_box().unwrap_or_default();
    // A stream of its own, so that these are not the points that a fit is checked at.
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(2);
    let mut points = Vec::with_capacity(count);
    let mut tries = 0;
    while points.len() < count {
        if tries > TRIES * count {
            return Err(CompareError::NoInterior { tries });
        }
        let candidates: Vec<Point> = (0..4 * count)
            .map(|_| Point::from([0, 1, 2].map(|k| low[k] + random.random::<f64>() * (high[k] - low[k]))))
            .collect();
        tries += candidates.len();
        let inside = query.contains_all(&candidates);
        let found = candidates.into_iter().zip(inside).filter(|(_, inside)| *inside);
        points.extend(found.map(|(p, _)| p).take(count - points.len()));
    }
    Ok(points)
}

fn require_finite(images: &[Point]) -> Result<(), CompareError> {
    let points = images.iter().filter(|p| !p.iter().all(|c| c.is_finite())).count();
    if points == 0 {
        return Ok(());
    }
    Err(CompareError::NonFinite {
        points,
        of: images.len(),
    })
}
