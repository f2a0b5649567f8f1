//! The solid texture: fit and evaluation.

use std::sync::Arc;

use rayon::prelude::*;

use super::TextureError;
use super::colour::LinearRgb;
use super::coloured_surface::{ColourSource, ColouredSurface, as_point};
use super::volume::{GIB, allowed_memory};
use crate::boundary_map::BoundaryMap;
use crate::fit::{FitMethod, FitOptions, FitReport, FitSize, Phase, Placement, fit};
use crate::geometry::{Aabb, ClosestPoint, SurfaceQuery};
use crate::inverse::{Inverse, InverseReport, Preimage};
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling;
use crate::solver::SchwarzOptions;
use crate::{Point, Vector};

/// The quantity that is extended into the solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExtendedQuantity {
    /// Linear colours, which mix towards the middle.
    #[default]
    Colours,
    /// Texture coordinates, as in the paper: the picture is looked up afterwards, and keeps its contrast to the middle.
    /// Only for coordinates that are continuous on the surface.
    Coordinates,
}

/// Settings of [`SolidTexture::fit`].
#[derive(Debug, Clone, PartialEq)]
pub struct TextureOptions {
    /// What is extended.
    pub extended: ExtendedQuantity,
    /// Whether coordinates are extended although they jump at seams.
    pub across_seams: bool,
    /// Least number of sources: triangles are divided into four until the surface has as many vertices. No more than
    /// [`FitOptions::max_sources`].
    pub least_sources: usize,
    /// How the harmonic function is fitted. A tolerance is a fraction of the diagonal of the cube of colours (√3), or
    /// of the box of the texture coordinates.
    pub fit: FitOptions,
}

/// Iterations stop when one leaves more than this fraction of the residual. Most of the residual is detail finer than
/// the sources, which hides the convergence deep inside: with the usual 0.85, colours there have twice the error.
const PLATEAU: f64 = 0.9998;

impl Default for TextureOptions {
    /// Colours, one source per vertex but at least 2000, no refinement.
    fn default() -> Self {
        Self {
            extended: ExtendedQuantity::Colours,
            across_seams: false,
            least_sources: 2000,
            fit: FitOptions {
                refine: false,
                method: FitMethod::Schwarz {
                    alpha: Placement::DEFAULT_ALPHA,
                    options: SchwarzOptions {
                        plateau: PLATEAU,
                        finest_plateau: PLATEAU,
                        ..SchwarzOptions::default()
                    },
                },
                ..FitOptions::adaptive()
            },
        }
    }
}

/// Error of the colours at points of the surface that the fit has not seen: the largest difference in red, green or
/// blue, in linear colours (1 from black to white). A point without colour has an infinite error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ColourError {
    /// Root mean square over the area.
    pub rms: f64,
    /// Value that 99 % of the area does not exceed.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

/// A colour at every point of a solid, on its surface that of the picture.
#[derive(Debug, Clone)]
pub struct SolidTexture {
    coloured_surface: Arc<ColouredSurface>,
    extended: ExtendedQuantity,
    map: HarmonicMap,
    report: FitReport,
    surface: SurfaceQuery,
    sources: SurfaceQuery,
    /// Upper bound of the layer's thickness.
    thickest: f64,
}

/// Distance from the surface, over the diagonal, up to which a point counts as being on it.
const ON_SURFACE: f64 = 1e-9;
/// The same over the largest coordinate: rounding error of a few products and sums for a point of a triangle.
const ROUNDED: f64 = 16.0 * f64::EPSILON;

impl SolidTexture {
    /// Extends the colours of a surface into the solid that it bounds.
    ///
    /// # Errors
    ///
    /// When the surface does not bound a solid, and as [`fit`]; [`TextureError::NoUv`] and [`TextureError::Seams`] when
    /// texture coordinates are to be extended and cannot be; [`TextureError::SourceLimit`] and
    /// [`TextureError::TooManySources`], before any triangle is divided.
    pub fn fit(
        coloured_surface: ColouredSurface,
        options: &TextureOptions,
        progress: &dyn Fn(Phase),
    ) -> Result<Self, TextureError> {
        let coloured_surface = Arc::new(coloured_surface);
        let subdivisions = subdivisions(coloured_surface.surface(), options)?;
        let boundary = boundary_values(&coloured_surface, options)?;
        let boundary = (0..subdivisions).fold(boundary, |map, _| map.subdivided());
        let fit = fit(&boundary, &options.fit, progress)?;
        Self::from_parts(coloured_surface, options.extended, fit.map, fit.report)
    }

    /// The texture with this harmonic part, as stored in a file.
    ///
    /// # Errors
    ///
    /// [`TextureError::NoUv`], [`TextureError::Inconsistent`] when there is no source, [`TextureError::Query`].
    pub fn from_parts(
        coloured_surface: impl Into<Arc<ColouredSurface>>,
        extended: ExtendedQuantity,
        map: HarmonicMap,
        report: FitReport,
    ) -> Result<Self, TextureError> {
        let coloured_surface = coloured_surface.into();
        if extended == ExtendedQuantity::Coordinates && coloured_surface.uv_box().is_none() {
            return Err(TextureError::NoUv);
        }
        if map.sources().is_empty() {
            return Err(TextureError::Inconsistent {
                problem: "it has no sources".into(),
            });
        }
        let surface = SurfaceQuery::with_winding_sign(coloured_surface.surface())?;
        let sources = points_query(map.sources())?;
        let thickest = thickest_layer(coloured_surface.surface(), &sources);
        Ok(Self {
            coloured_surface,
            extended,
            map,
            report,
            surface,
            sources,
            thickest,
        })
    }

    /// The surface and what colours it.
    pub fn coloured_surface(&self) -> &ColouredSurface {
        &self.coloured_surface
    }

    /// What was extended.
    pub fn extended(&self) -> ExtendedQuantity {
        self.extended
    }

    /// The harmonic part: linear red, green and blue, or texture coordinates and 0.
    pub fn map(&self) -> &HarmonicMap {
        &self.map
    }

    /// How the harmonic part was fitted.
    pub fn report(&self) -> &FitReport {
        &self.report
    }

    /// Linear colours of points; NaN outside of the solid and for points that are not finite. Points within rounding of
    /// the surface count as inside. On the surface the colours are those of [`ColouredSurface::colour`]. By the maximum
    /// principle they leave the range of the picture's colours by no more than the harmonic part does on the surface,
    /// and deeper by much less.
    pub fn sample(&self, points: &[Point]) -> Vec<LinearRgb> {
        let inside = self.inside(points);
        let at: Vec<Point> = inside.iter().map(|&k| points[k as usize]).collect();
        let mut colours = vec![[f64::NAN; 3]; points.len()];
        for (k, colour) in inside.iter().zip(self.sample_inside(&at)) {
            colours[*k as usize] = colour;
        }
        colours
    }

    /// Colours of the harmonic part alone, at points anywhere: the picture as far as the sources resolve it.
    pub fn harmonic(&self, points: &[Point]) -> Vec<LinearRgb> {
        let values = self.map.evaluate(points);
        values.par_iter().map(|value| self.colour_of(value)).collect()
    }

    /// Thickness of the layer under each point of the surface: the spacing of the sources there.
    pub fn layer(&self, surface_points: &[Point]) -> Vec<f64> {
        let nearest = self.sources.closest_points(surface_points);
        nearest.iter().map(|source| source.distance).collect()
    }

    /// How thick the layer is at the vertices of the surface, over its diagonal: at the median and at most.
    pub fn layer_thickness(&self) -> [f64; 2] {
        let surface = self.coloured_surface.surface();
        let mut thickness = self.layer(surface.vertices());
        thickness.sort_by(f64::total_cmp);
        let diagonal = surface.diagonal();
        let median = thickness.get(thickness.len() / 2).copied().unwrap_or_default();
        [median, thickness.last().copied().unwrap_or_default()].map(|t| t / diagonal)
    }

    /// Error of the harmonic part alone at `count` evenly spread points of the surface; `None` without any.
    ///
    /// The sum of both parts has only rounding errors; see [`Self::surface_error`].
    pub fn harmonic_error(&self, count: usize, seed: u64) -> Option<ColourError> {
        self.error(count, seed, |points| self.harmonic(points))
    }

    /// Error of the texture at `count` evenly spread points of the surface. At the seams of an atlas, the colour may be
    /// that of either side.
    pub fn surface_error(&self, count: usize, seed: u64) -> Option<ColourError> {
        self.error(count, seed, |points| self.sample(points))
    }

    fn error(&self, count: usize, seed: u64, colours: impl Fn(&[Point]) -> Vec<LinearRgb>) -> Option<ColourError> {
        let surface = self.coloured_surface.surface();
        let places = sampling::held_out(surface, count, 0, seed);
        let positions: Vec<Point> = places.iter().map(|p| p.position(surface, surface.vertices())).collect();
        let found = colours(&positions);
        let difference = |(place, found): (&SurfacePoint, &LinearRgb)| {
            let picture = self.coloured_surface.colour(place);
            let off = (0..3).map(|k| (picture[k] - found[k]).abs());
            off.fold(0.0, |most: f64, d| if d.is_nan() { f64::INFINITY } else { most.max(d) })
        };
        let mut differences: Vec<f64> = places.iter().zip(&found).map(difference).collect();
        let max = differences.iter().copied().fold(0.0, f64::max);
        differences.truncate(count);
        differences.sort_by(f64::total_cmp);
        let last = differences.len().checked_sub(1)?;
        let squares: f64 = differences.iter().map(|d| d * d).sum();
        Some(ColourError {
            rms: (squares / differences.len() as f64).sqrt(),
            p99: differences[(0.99 * last as f64).ceil() as usize],
            max,
        })
    }

    /// Indices of the points in the solid or on its surface.
    fn inside(&self, points: &[Point]) -> Vec<u32> {
        let bounds = self.surface.bounds();
        let farthest = bounds.low.coords.amax().max(bounds.high.coords.amax());
        let slack = (ON_SURFACE * self.coloured_surface.surface().diagonal()).max(ROUNDED * farthest);
        let slack_vector = Vector::repeat(slack);
        let wider = Aabb {
            low: bounds.low - slack_vector,
            high: bounds.high + slack_vector,
        };
        let is_near = |k: &u32| wider.contains(&points[*k as usize]);
        let candidates: Vec<u32> = (0..points.len() as u32).filter(is_near).collect();
        let at = |indices: &[u32]| indices.iter().map(|&k| points[k as usize]).collect::<Vec<_>>();
        let contained = self.surface.contains_all(&at(&candidates));
        let (mut inside, mut others) = (Vec::new(), Vec::new());
        for (&k, contained) in candidates.iter().zip(contained) {
            if contained { inside.push(k) } else { others.push(k) }
        }
        let is_off: Vec<(Point, f64)> = at(&others).into_iter().map(|p| (p, slack)).collect();
        let off = self.surface.are_outside(&is_off);
        inside.extend(others.iter().zip(off).filter(|(_, off)| !off).map(|(&k, _)| k));
        inside
    }

    /// Linear colours of points of the target of a map of the solid, those of their preimages: NaN where there is none.
    /// Preimages that lie beyond the surface, by a map's boundary error, have the colour of its closest point.
    pub fn sample_through(&self, inverse: &dyn Inverse, points: &[Point]) -> (Vec<LinearRgb>, InverseReport) {
        let (preimages, report) = inverse.preimages(points);
        let places: Vec<Point> = preimages.iter().map(Preimage::position).collect();
        let mut colours = self.sample(&places);
        let is_beyond = |k: &usize| colours[*k][0].is_nan() && places[*k].x.is_finite();
        let beyond: Vec<usize> = (0..places.len()).filter(is_beyond).collect();
        let at: Vec<Point> = beyond.iter().map(|&k| places[k]).collect();
        for (k, closest) in beyond.into_iter().zip(self.surface.closest_points(&at)) {
            colours[k] = self.coloured_surface.colour(&closest.surface_point());
        }
        (colours, report)
    }

    /// Colours of points that are in the solid or on its surface.
    pub(super) fn sample_inside(&self, points: &[Point]) -> Vec<LinearRgb> {
        let layer = self.in_layer(points);
        let closest_points = layer.iter().map(|(_, closest, _)| closest.point);
        let everywhere: Vec<Point> = points.iter().copied().chain(closest_points).collect();
        let mut values = self.map.evaluate(&everywhere);
        let harmonic_at_closest = values.split_off(points.len());
        for ((k, closest, weight), harmonic) in layer.iter().zip(harmonic_at_closest) {
            let place = closest.surface_point();
            values[*k as usize] += (boundary_value(&self.coloured_surface, self.extended, &place) - harmonic) * *weight;
        }
        values.par_iter().map(|value| self.colour_of(value)).collect()
    }

    /// The points in the layer, with the closest point of the surface and the weight of the correction.
    fn in_layer(&self, points: &[Point]) -> Vec<(u32, ClosestPoint, f64)> {
        let closest = self.surface.closest_points(points);
        let near = (0..)
            .zip(closest)
            .filter(|(_, closest)| closest.distance < self.thickest);
        let near: Vec<(u32, ClosestPoint)> = near.collect();
        let closest_points: Vec<Point> = near.iter().map(|(_, closest)| closest.point).collect();
        let thickness = self.layer(&closest_points);
        near.into_iter()
            .zip(thickness)
            .map(|((k, closest), thickness)| (k, closest, wendland(closest.distance / thickness)))
            .filter(|&(_, _, weight)| weight > 0.0)
            .collect()
    }

    /// The colour of an extended value.
    fn colour_of(&self, value: &Point) -> LinearRgb {
        match (self.extended, self.coloured_surface.colour_source()) {
            (ExtendedQuantity::Coordinates, ColourSource::Picture { picture, wrap, .. }) => {
                picture.light([value.x, value.y], *wrap)
            }
            _ => value.coords.into(),
        }
    }
}

/// How often triangles are divided into four until there are enough vertices for the sources.
fn subdivisions(surface: &SurfaceMesh, options: &TextureOptions) -> Result<usize, TextureError> {
    let (least, most) = (options.least_sources, options.fit.max_sources);
    if least > most {
        return Err(TextureError::SourceLimit { least, most });
    }
    // Each edge of a closed surface has two triangles.
    let (mut vertices, mut triangles, mut times) = (surface.vertices().len(), surface.triangles().len(), 0);
    let countable = u32::MAX as usize;
    while triangles > 0 && vertices < least.min(countable) {
        (vertices, triangles) = (vertices + (3 * triangles).div_ceil(2), 4 * triangles);
        times += 1;
    }
    let sources = ((options.fit.source_ratio * vertices as f64) as usize).min(most);
    let size = FitSize {
        vertices,
        sources,
        collocation: (options.fit.collocation_ratio / options.fit.source_ratio * sources as f64) as usize,
        maps: 1,
        refinements: 0,
        patch_entries: None,
        method: options.fit.method,
        free_sources: options.fit.free_sources,
        threads: rayon::current_num_threads(),
    };
    let need = size.bytes() as f64;
    let allowed = options.fit.memory.map_or_else(allowed_memory, |bytes| bytes as f64);
    if times > 0 && (need > allowed || vertices >= countable) {
        return Err(TextureError::TooManySources {
            sources: least,
            need: need / GIB,
            allowed: allowed / GIB,
        });
    }
    Ok(times)
}

/// The boundary map to the colours or texture coordinates.
fn boundary_values(
    coloured_surface: &Arc<ColouredSurface>,
    options: &TextureOptions,
) -> Result<BoundaryMap, TextureError> {
    let extended = options.extended;
    let target = match extended {
        ExtendedQuantity::Colours => (Point::origin(), Point::new(1.0, 1.0, 1.0)),
        ExtendedQuantity::Coordinates => {
            let [low, high] = coloured_surface.uv_box().ok_or(TextureError::NoUv)?;
            let seams = coloured_surface.seams();
            if seams.seams > 0 && !options.across_seams {
                return Err(TextureError::Seams {
                    seams: seams.seams,
                    edges: seams.edges,
                    jump: seams.largest_uv_jump,
                });
            }
            (Point::new(low[0], low[1], 0.0), Point::new(high[0], high[1], 0.0))
        }
    };
    let values = coloured_surface.clone();
    let function = move |place: &SurfacePoint| boundary_value(&values, extended, place);
    let surface = coloured_surface.surface().clone();
    Ok(BoundaryMap::by_function(surface, target, function)?)
}

fn boundary_value(coloured_surface: &ColouredSurface, extended: ExtendedQuantity, place: &SurfacePoint) -> Point {
    match (extended, coloured_surface.uv(place)) {
        (ExtendedQuantity::Coordinates, Some([u, v])) => Point::new(u, v, 0.0),
        _ => as_point(coloured_surface.colour(place)),
    }
}

/// Closest-point queries on points, as triangles without extent.
fn points_query(points: &[Point]) -> Result<SurfaceQuery, TextureError> {
    let triangles = (0..points.len() as u32).map(|k| [k; 3]).collect();
    let mesh = SurfaceMesh::new(points.to_vec(), triangles).map_err(|error| TextureError::Inconsistent {
        problem: error.to_string(),
    })?;
    Ok(SurfaceQuery::with_winding_sign(&mesh)?)
}

/// Upper bound of the distance to the nearest source over the surface: that distance is 1-Lipschitz, and no point of a
/// triangle is farther from a corner than its longest side.
fn thickest_layer(surface: &SurfaceMesh, sources: &SurfaceQuery) -> f64 {
    let at_vertices = sources.closest_points(surface.vertices());
    let sides = (0..surface.triangles().len()).flat_map(|t| {
        let [a, b, c] = surface.corners(t);
        [(a - b).norm(), (b - c).norm(), (c - a).norm()]
    });
    let farthest = at_vertices.iter().map(|source| source.distance).fold(0.0, f64::max);
    farthest + sides.fold(0.0, f64::max)
}

/// Wendland's function: from 1 at 0 to 0 at 1, twice continuously differentiable.
fn wendland(s: f64) -> f64 {
    if s < 1.0 {
        (1.0 - s).powi(4) * (4.0 * s + 1.0)
    } else {
        0.0
    }
}
