//! The inter-surface map from a domain to a target that are embedded on the same sphere, and its distortion.
//!
//! A vertex of the domain at the direction `x` goes to the point of the target that has this direction. The energy is
//! the symmetric Dirichlet energy `|J|² + |J⁻¹|²` of the triangles between these points (Schreiner, Asirvatham, Praun,
//! Hoppe, *Inter-surface mapping*, 2004; Smith and Schaefer, *Bijective parameterization with free boundaries*, 2015),
//! minimised over embeddings of the domain whose triangles stay positive, so that the map stays a bijection.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use smallvec::SmallVec;

use super::bent::{
    BentImage, add_straight_of_corners, bent_energy, middles, moved_middles, pieces_energy, straight_energy,
};
use super::star::{StarTriangle, VertexStar};
use crate::geometry::morton_order;
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::spherical::{
    DistortionEnergy, ElementDerivatives, EnergyWeights, InsertedMesh, Locator, Objective, PartialEmbedding, RestShape,
    RestShapes, SphericalEmbedding, det,
};
use crate::{Matrix3, Point, Vector};

/// Weight of the angle distortion on the sphere. It acts as a barrier against flat triangles on the sphere: the energy
/// of the straight triangles between points of the target can be finite there.
pub(super) const BARRIER: f64 = 1e-3;

/// Largest number of samples of the target that the search for protrusions uses.
const MOST_SAMPLES: usize = 20_000;
/// Largest number of samples that it uses per triangle of the domain.
const SAMPLES_PER_TRIANGLE: usize = 4;
/// A triangle covers a protrusion if it covers at least this many samples, and this many times the area of its straight
/// image.
const FEWEST_SAMPLES: usize = 4;
const LEAST_AREA_RATIO: f64 = 1.5;
/// A triangle bends if its four pieces have this many times its energy.
const BENT: f64 = 1.2;
/// Vertices per task of a sweep.
const LEAST_SWEPT: usize = 64;
const UNCOLOURED: u8 = u8::MAX;
/// Area ratios are capped here.
const MOST_AREA_RATIO: f64 = 100.0;

/// The inverse of the target's spherical embedding: from directions to points of the target.
pub(crate) struct InverseEmbedding<'a> {
    target: &'a SphericalEmbedding,
    locator: &'a Locator,
    /// Lengths of the target are multiplied by this, so that its area is 4π.
    scale: f64,
    /// Directions of samples of the target, each near the next, and the areas that these represent.
    samples: Vec<(Vector, f64)>,
}

/// Pulls a vertex to a direction, with the energy `weight · |x − to|²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spring {
    pub to: Vector,
    pub weight: f64,
}

/// The image of a vertex.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct VertexImage {
    /// Scaled as [`InverseEmbedding::scale`] says.
    pub point: Point,
    /// Triangle of the target.
    pub triangle: u32,
}

/// The points of the target that the vertices of an embedded domain go to.
pub(crate) struct InterSurfaceMap<'a> {
    inverse: &'a InverseEmbedding<'a>,
    domain: &'a [Point],
    /// Areas of the domain's triangles are multiplied by this.
    area_scale: f64,
    images: Vec<VertexImage>,
    /// Area of the part of the target that a triangle covers, over the area of the straight triangle between the images
    /// of its corners, for triangles where it is large: they cover a protrusion (a limb) without a vertex on it. Their
    /// images count as that much larger, so that the energy draws vertices onto the protrusion. Keys start with the
    /// lowest vertex.
    protrusions: HashMap<[u32; 3], f64>,
    /// Whether triangles whose images bend are found, too.
    pub finds_bent: bool,
    /// These triangles, of all searches: those that straighten would bend again. Keys start with the lowest vertex.
    bent: HashSet<[u32; 3]>,
    /// The triangles of each inserted vertex and each of its neighbours in turn, as of the last search for protrusions.
    stars: Vec<SmallVec<[StarTriangle; 8]>>,
    /// Colours of the inserted vertices, such that neighbours differ, and their number: as of then.
    colours: Vec<u8>,
    colour_count: usize,
    /// Springs of vertices, part of the energy.
    pub springs: BTreeMap<u32, Spring>,
}

/// A triangle of the domain as the energy sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct DomainTriangle {
    pub rest: RestShape,
    /// Rest area divided by the [area ratio](InterSurfaceMap::protrusions): the area that counts in the Jacobian.
    pub reference_area: f64,
    /// Whether its energy is that of four pieces.
    pub is_bent: bool,
}

impl DomainTriangle {
    /// A quarter of it.
    pub fn piece(&self) -> Self {
        Self {
            rest: RestShape {
                area: 0.25 * self.rest.area,
                ..self.rest
            },
            reference_area: 0.25 * self.reference_area,
            is_bent: false,
        }
    }
}

impl<'a> InverseEmbedding<'a> {
    pub fn new(target: &'a SphericalEmbedding, locator: &'a Locator) -> Self {
        let surface = target.surface();
        let scale = (4.0 * std::f64::consts::PI / surface.area()).sqrt();
        let count = surface.triangles().len();
        let stride = count.div_ceil(MOST_SAMPLES);
        let sample = |t: usize| {
            let corners = surface.triangles()[t].map(|v| target.directions()[v as usize]);
            let area = surface.area_vector(t).norm() * scale * scale;
            (corners.iter().sum::<Vector>().normalize(), stride as f64 * area)
        };
        let samples: Vec<(Vector, f64)> = (0..count).step_by(stride).map(sample).collect();
        let ends: Vec<Point> = samples.iter().map(|sample| sample.0.into()).collect();
        Self {
            target,
            locator,
            scale,
            samples: morton_order(&ends).into_iter().map(|i| samples[i as usize]).collect(),
        }
    }

    /// The point of the target with this direction.
    pub fn position(&self, x: &Vector) -> Point {
        self.image(x, 0).point / self.scale
    }

    /// The corners of the target's triangle with this direction, and the barycentric coordinates in it.
    pub fn corners(&self, x: &Vector) -> ([u32; 3], [f64; 3]) {
        let place = self.locator.locate(x);
        let corners = self.target.surface().triangles()[place.triangle as usize];
        (corners, place.barycentric)
    }

    pub fn target(&self) -> &SphericalEmbedding {
        self.target
    }

    /// Diagonal of the target.
    pub fn diagonal(&self) -> f64 {
        self.target.surface().diagonal()
    }

    /// The ratio of lengths on the target, scaled, to those on the sphere around a direction: the root of the ratio of the
    /// areas of the triangle there.
    pub fn length_ratio(&self, x: &Vector) -> f64 {
        let triangle = self.locator.locate(x).triangle as usize;
        let surface = self.target.surface();
        let corners = surface.triangles()[triangle].map(|v| Point::from(self.target.directions()[v as usize]));
        let area = surface.area_vector(triangle).norm() * self.scale * self.scale;
        (area / triangle_area(&corners).max(f64::MIN_POSITIVE)).sqrt()
    }

    pub(super) fn image(&self, x: &Vector, hint: u32) -> VertexImage {
        let place = self.locator.locate_from(x, hint);
        let point = place.position(self.target.surface(), self.target.surface().vertices());
        VertexImage {
            point: point * self.scale,
            triangle: place.triangle,
        }
    }

    /// Derivative of the image with respect to the direction.
    pub(super) fn derivative(&self, x: &Vector, image: &VertexImage) -> Matrix3 {
        let corners = self.target.surface().triangles()[image.triangle as usize];
        let [a, b, c] = corners.map(|v| self.target.directions()[v as usize]);
        let [p, q, r] = corners.map(|v| self.target.surface().vertices()[v as usize] * self.scale);
        let weights = [det(x, &b, &c), det(x, &c, &a), det(x, &a, &b)];
        let total: f64 = weights.iter().sum();
        let slopes = [b.cross(&(c - b)), c.cross(&(a - c)), a.cross(&(b - a))];
        let part = |(slope, corner): (&Vector, Point)| (corner - image.point) * slope.transpose() / total;
        slopes.iter().zip([p, q, r]).map(part).sum()
    }
}

impl<'a> InterSurfaceMap<'a> {
    pub fn new(inverse: &'a InverseEmbedding, domain: &'a SurfaceMesh) -> Self {
        Self {
            inverse,
            domain: domain.vertices(),
            area_scale: 1.0,
            images: vec![VertexImage::default(); domain.vertices().len()],
            protrusions: HashMap::new(),
            finds_bent: false,
            bent: HashSet::new(),
            stars: domain.vertices().iter().map(|_| SmallVec::new()).collect(),
            colours: vec![0; domain.vertices().len()],
            colour_count: 0,
            springs: BTreeMap::new(),
        }
    }

    /// Finds the triangles that cover protrusions of the target. To be called before vertices are moved.
    pub fn find_protrusions(&mut self, embedding: &PartialEmbedding) {
        self.protrusions.clear();
        let mesh = embedding.inserted_mesh();
        let triangles: Vec<[u32; 3]> = mesh.corners().collect();
        let directions = mesh.of(&embedding.directions);
        let points = directions.iter().map(|x| Point::from(*x)).collect();
        let surface = SurfaceMesh::new(points, mesh.triangles).expect("corners of triangles have been inserted");
        let locator = Locator::of_directions(&surface, &directions);
        // Coarse embeddings are many, and need fewer samples.
        let stride = (self.inverse.samples.len() / (SAMPLES_PER_TRIANGLE * triangles.len())).max(1);
        let samples: Vec<(Vector, f64)> = self.inverse.samples.iter().step_by(stride).copied().collect();
        let sampled: Vec<Vector> = samples.iter().map(|sample| sample.0).collect();
        let mut covered = vec![(0, 0.0); triangles.len()];
        for (found, (_, area)) in locator.triangles_along(&sampled).iter().zip(&samples) {
            let (count, sum) = &mut covered[*found as usize];
            *count += 1;
            *sum += stride as f64 * area;
        }
        for (t, (count, area)) in triangles.iter().zip(covered) {
            let straight = triangle_area(&t.map(|v| self.images[v as usize].point));
            if count >= FEWEST_SAMPLES && area > LEAST_AREA_RATIO * straight {
                self.protrusions.insert(*t, (area / straight).min(MOST_AREA_RATIO));
            }
        }
        if self.finds_bent {
            let bent = self.bent_triangles(embedding, &triangles);
            self.bent.extend(bent);
        }
        for &v in &embedding.inserted {
            let ring = embedding.rings.of(v);
            let next = ring.iter().cycle().skip(1);
            let star = ring
                .iter()
                .zip(next)
                .map(|(&r, &next)| StarTriangle::new(self.domain_triangle([v, r, next])));
            self.stars[v as usize] = star.collect();
        }
        self.colour(embedding);
    }

    /// The triangles whose energy is a good deal larger in four pieces.
    fn bent_triangles(&self, embedding: &PartialEmbedding, triangles: &[[u32; 3]]) -> HashSet<[u32; 3]> {
        let is_bent = |t: &&[u32; 3]| {
            let rest = RestShape::of_triangle(t.map(|v| &self.domain[v as usize]), self.area_scale);
            let triangle = DomainTriangle {
                rest,
                reference_area: rest.area,
                is_bent: true,
            };
            let images = t.map(|v| &self.images[v as usize]);
            let hints = images.map(|image| image.triangle);
            let x = t.map(|v| &embedding.directions[v as usize]);
            let straight = straight_energy(images.map(|image| &image.point), &triangle);
            bent_energy(self.inverse, x, images, hints, &triangle) > BENT * straight
        };
        let found: Vec<[u32; 3]> = triangles.par_iter().filter(is_bent).map(|t| lowest_first(*t)).collect();
        found.into_iter().collect()
    }

    /// Colours vertices greedily in the order of their insertion.
    fn colour(&mut self, embedding: &PartialEmbedding) {
        self.colour_count = 0;
        embedding
            .inserted
            .iter()
            .for_each(|&v| self.colours[v as usize] = UNCOLOURED);
        for &v in &embedding.inserted {
            let ring = embedding.rings.of(v);
            let is_free = |colour: &u8| ring.iter().all(|&r| self.colours[r as usize] != *colour);
            // A vertex of very high valence may find none: then it is not swept.
            let colour = (0..UNCOLOURED).find(is_free).unwrap_or(UNCOLOURED);
            self.colours[v as usize] = colour;
            self.colour_count = self.colour_count.max(colour as usize + 1);
        }
    }

    /// Whether any triangle covers a protrusion, or bends.
    pub fn has_protrusions(&self) -> bool {
        !(self.protrusions.is_empty() && self.bent.is_empty())
    }

    fn domain_triangle(&self, t: [u32; 3]) -> DomainTriangle {
        let rest = RestShape::of_triangle(t.map(|v| &self.domain[v as usize]), self.area_scale);
        let key = lowest_first(t);
        let is_bent = self.bent.contains(&key);
        // The pieces see what the triangle covers.
        let area_ratio = if is_bent {
            &1.0
        } else {
            self.protrusions.get(&key).unwrap_or(&1.0)
        };
        DomainTriangle {
            rest,
            reference_area: rest.area / area_ratio,
            is_bent,
        }
    }

    /// Computes the images of all vertices from their directions.
    pub fn locate(&mut self, embedding: &PartialEmbedding) {
        self.area_scale = embedding.area_scale(self.domain);
        for &v in &embedding.inserted {
            let image = &mut self.images[v as usize];
            *image = self.inverse.image(&embedding.directions[v as usize], image.triangle);
        }
    }

    /// Moves each of these vertices, unless it is fixed, once to a direction where its triangles have less energy. Vertices of
    /// one colour have no edges between them and move at the same time.
    pub fn sweep(&mut self, embedding: &mut PartialEmbedding, vertices: &[u32], is_fixed: &dyn Fn(u32) -> bool) {
        let mut of_colour = vec![Vec::new(); self.colour_count];
        for &v in vertices.iter().filter(|&&v| !is_fixed(v)) {
            if let Some(group) = of_colour.get_mut(self.colours[v as usize] as usize) {
                group.push(v);
            }
        }
        for group in of_colour {
            let moved = |star: &mut VertexStar, &v: &u32| {
                self.gather(embedding, v, star);
                let spring = self.springs.get(&v);
                star.better_place(
                    self.inverse,
                    &embedding.directions[v as usize],
                    &self.images[v as usize],
                    spring,
                )
            };
            let chunks = group.par_iter().with_min_len(LEAST_SWEPT);
            let moved: Vec<Option<(Vector, VertexImage)>> = chunks.map_init(VertexStar::default, moved).collect();
            for (&v, moved) in group.iter().zip(moved) {
                if let Some((x, image)) = moved {
                    embedding.directions[v as usize] = x;
                    self.images[v as usize] = image;
                }
            }
        }
    }

    /// Vertices whose triangles have more than `limit` times the energy of an isometry, with their neighbours;
    /// ascending.
    pub fn distorted(&self, embedding: &PartialEmbedding, limit: f64) -> Vec<u32> {
        let is_distorted = |star: &mut VertexStar, &v: &u32| {
            self.gather(embedding, v, star);
            let value = star.value(
                self.inverse,
                &embedding.directions[v as usize],
                &self.images[v as usize],
                None,
            );
            value.is_none_or(|value| value > limit * star.area())
        };
        let inserted = embedding.inserted.par_iter().with_min_len(LEAST_SWEPT);
        let is_distorted: Vec<bool> = inserted.map_init(VertexStar::default, is_distorted).collect();
        let mut found = Vec::new();
        for (&v, _) in embedding.inserted.iter().zip(is_distorted).filter(|(_, is)| *is) {
            found.push(v);
            found.extend_from_slice(embedding.rings.of(v));
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Fills `star` with the neighbours of a vertex.
    fn gather(&self, embedding: &PartialEmbedding, v: u32, star: &mut VertexStar) {
        let ring = embedding.rings.of(v);
        let corners = ring
            .iter()
            .map(|&r| (embedding.directions[r as usize], self.images[r as usize]));
        let x = &embedding.directions[v as usize];
        star.fill(self.inverse, x, corners.zip(&self.stars[v as usize]));
    }

    /// Mean energy over the domain's area, 1 for an isometry, with that of the springs.
    pub fn energy(&self, embedding: &PartialEmbedding) -> f64 {
        self.mean_energy(embedding, f64::INFINITY)
    }

    /// The same, but that no triangle counts with more than `most` times the energy of an isometry.
    pub fn mean_energy(&self, embedding: &PartialEmbedding, most: f64) -> f64 {
        let values = self.areas_and_energies(embedding);
        let mut sum = [0.0; 2];
        for (area, energy) in values {
            sum[0] += area;
            // Also where the image has no area, and the energy is not defined.
            sum[1] += if energy <= most * area { energy } else { most * area };
        }
        for (&v, spring) in &self.springs {
            sum[1] += spring.energy(&embedding.directions[v as usize]);
        }
        let mean = sum[1] / sum[0];
        if mean.is_nan() { f64::INFINITY } else { mean }
    }

    /// The share of the domain's area whose triangles have more than `limit` times the energy of an isometry.
    pub fn share_above(&self, embedding: &PartialEmbedding, limit: f64) -> f64 {
        let (mut above, mut total) = (0.0, 0.0);
        for (area, energy) in self.areas_and_energies(embedding) {
            total += area;
            // Also where it is not defined.
            above += if energy <= limit * area { 0.0 } else { area };
        }
        above / total
    }

    /// The area of every triangle and its energy, in which an isometry has its area.
    fn areas_and_energies(&self, embedding: &PartialEmbedding) -> Vec<(f64, f64)> {
        let of_triangle = |t: &[u32; 3]| {
            let triangle = self.domain_triangle(*t);
            let images = t.map(|v| &self.images[v as usize]);
            let energy = match triangle.is_bent {
                true => {
                    let x = t.map(|v| &embedding.directions[v as usize]);
                    bent_energy(self.inverse, x, images, images.map(|image| image.triangle), &triangle)
                }
                false => straight_energy(images.map(|image| &image.point), &triangle),
            };
            (triangle.rest.area, energy)
        };
        let triangles = embedding.rings.triangles();
        triangles
            .par_iter()
            .with_min_len(LEAST_SWEPT)
            .map(of_triangle)
            .collect()
    }
}

impl Spring {
    pub(super) fn energy(&self, x: &Vector) -> f64 {
        self.weight * (x - self.to).norm_squared()
    }
}

/// Squared norm of the Jacobian, its determinant, and the unit normal of the image triangle.
pub(super) fn jacobian_invariants(y: &Point, a: &Point, b: &Point, triangle: &DomainTriangle) -> (f64, f64, Vector) {
    let s = triangle.rest.dirichlet(&y.coords, &a.coords, &b.coords) / (2.0 * triangle.reference_area);
    let cross = (a - y).cross(&(b - y));
    let area = cross.norm();
    (s, area / (2.0 * triangle.reference_area), cross / area)
}

/// The energy as a function of the directions of all inserted vertices, for Newton's method.
pub(crate) struct InterSurfaceEnergy<'a> {
    inverse: &'a InverseEmbedding<'a>,
    domain_triangles: Vec<DomainTriangle>,
    shapes: &'a RestShapes,
    /// Springs, each with a triangle and the corner of it that it pulls.
    springs: Vec<(usize, usize, Spring)>,
    /// Triangle of the target in which each vertex was found last. Affects the time of the next search, not its result.
    hints: Vec<AtomicU32>,
    /// The same for the middles of the sides of triangles that bend.
    middle_hints: Vec<[AtomicU32; 3]>,
}

impl<'a> InterSurfaceEnergy<'a> {
    /// Over the inserted vertices alone, whose triangles have these shapes.
    pub fn new(map: &InterSurfaceMap<'a>, mesh: &InsertedMesh, shapes: &'a RestShapes) -> Self {
        let hint = |v: u32| AtomicU32::new(map.images[v as usize].triangle);
        let triangles: Vec<[u32; 3]> = mesh.corners().collect();
        Self {
            inverse: map.inverse,
            domain_triangles: triangles.iter().map(|t| map.domain_triangle(*t)).collect(),
            shapes,
            springs: springs_of_corners(&map.springs, &triangles),
            hints: mesh.vertices.iter().map(|&v| hint(v)).collect(),
            middle_hints: triangles.iter().map(|t| t.map(hint)).collect(),
        }
    }

    fn barrier(&self) -> DistortionEnergy<'_> {
        DistortionEnergy {
            rest: self.shapes,
            weights: EnergyWeights {
                angle: BARRIER,
                area: 0.0,
            },
        }
    }

    fn images(&self, x: &[Vector]) -> Vec<VertexImage> {
        let of_vertex = |(x, hint): (&Vector, &AtomicU32)| {
            let image = self.inverse.image(x, hint.load(Relaxed));
            hint.store(image.triangle, Relaxed);
            image
        };
        x.par_iter().zip(&self.hints).map(of_vertex).collect()
    }
}

impl Objective for InterSurfaceEnergy<'_> {
    fn triangles(&self) -> &[[u32; 3]] {
        self.shapes.triangles()
    }

    fn value(&self, x: &[Vector]) -> f64 {
        let barrier = self.barrier().value(x);
        if !barrier.is_finite() {
            return f64::INFINITY;
        }
        let images = self.images(x);
        let of_triangle = |((t, triangle), hints): ((&[u32; 3], &DomainTriangle), &[AtomicU32; 3])| {
            let images = t.map(|v| &images[v as usize]);
            if !triangle.is_bent {
                return straight_energy(images.map(|image| &image.point), triangle);
            }
            let middles = middles(
                self.inverse,
                t.map(|v| &x[v as usize]),
                hints.each_ref().map(|h| h.load(Relaxed)),
            );
            (0..3).for_each(|k| hints[k].store(middles[k].triangle, Relaxed));
            pieces_energy(
                images.map(|image| &image.point),
                middles.each_ref().map(|m| &m.point),
                triangle,
            )
        };
        let triangles = self
            .triangles()
            .par_iter()
            .zip(&self.domain_triangles)
            .zip(&self.middle_hints);
        let values: Vec<f64> = triangles.map(of_triangle).collect();
        let triangles = self.triangles();
        let spring = |&(t, corner, spring): &(usize, usize, Spring)| spring.energy(&x[triangles[t][corner] as usize]);
        let sum = values.iter().sum::<f64>() + barrier + self.springs.iter().map(spring).sum::<f64>();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    fn write_elements(&self, x: &[Vector], frames: &[[Vector; 2]], elements: &mut Vec<ElementDerivatives>) {
        let images = self.images(x);
        let chain = |v: usize| {
            let derivative = self.inverse.derivative(&x[v], &images[v]);
            frames[v].map(|tangent| derivative * tangent)
        };
        let chains: Vec<[Vector; 2]> = (0..x.len()).into_par_iter().map(chain).collect();
        self.barrier().write_convex_elements(x, frames, elements);
        let triangles = self
            .triangles()
            .par_iter()
            .zip(&self.domain_triangles)
            .zip(&self.middle_hints);
        elements
            .par_iter_mut()
            .zip(triangles)
            .for_each(|(element, ((t, triangle), hints))| {
                let corners = t.map(|v| v as usize);
                let mut gradient = SVector::zeros();
                let points = corners.map(|v| &images[v].point);
                let chains = corners.map(|v| &chains[v]);
                if triangle.is_bent {
                    let chains = [0, 1, 2].map(|k| in_columns(k, chains[k]));
                    let moves = [0, 1, 2].map(|k| in_columns(k, &frames[corners[k]]));
                    let hints = hints.each_ref().map(|hint| hint.load(Relaxed));
                    let middles = moved_middles(self.inverse, corners.map(|v| &x[v]), hints, &moves);
                    let (first, second) = BentImage::new(points, chains, middles).derivatives(triangle);
                    gradient = first;
                    element.hessian += second;
                } else {
                    add_straight_of_corners(points, chains, triangle, &mut gradient, &mut element.hessian);
                }
                element
                    .gradient
                    .iter_mut()
                    .zip(&gradient)
                    .for_each(|(sum, g)| *sum += g);
            });
        for &(t, corner, Spring { to, weight }) in &self.springs {
            let v = self.triangles()[t][corner] as usize;
            for (k, tangent) in frames[v].iter().enumerate() {
                let i = 2 * corner + k;
                elements[t].gradient[i] -= 2.0 * weight * to.dot(tangent);
                // On the sphere |x − to|² is 2 − 2 x · to, whose curvature is negative beyond a right angle.
                elements[t].hessian[(i, i)] += 2.0 * weight * x[v].dot(&to).max(0.0);
            }
        }
    }
}

/// Gives each spring a triangle at its vertex; those of vertices without triangles are left out.
fn springs_of_corners(springs: &BTreeMap<u32, Spring>, triangles: &[[u32; 3]]) -> Vec<(usize, usize, Spring)> {
    let mut left = springs.clone();
    let mut found = Vec::new();
    for (t, corners) in triangles.iter().enumerate() {
        if left.is_empty() {
            break;
        }
        for (corner, v) in corners.iter().enumerate() {
            if let Some(spring) = left.remove(v) {
                found.push((t, corner, spring));
            }
        }
    }
    found
}

/// Two derivatives of one corner among those by the coordinates of three.
fn in_columns(corner: usize, of_corner: &[Vector; 2]) -> SMatrix<f64, 3, 6> {
    let mut all = SMatrix::<f64, 3, 6>::zeros();
    all.set_column(2 * corner, &of_corner[0]);
    all.set_column(2 * corner + 1, &of_corner[1]);
    all
}

fn lowest_first(t: [u32; 3]) -> [u32; 3] {
    let [a, b, c] = t;
    [t, [b, c, a], [c, a, b]].into_iter().min().unwrap_or(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::spherical::tangents;

    fn radial(surface: &SurfaceMesh) -> SphericalEmbedding {
        let directions: Vec<Vector> = surface.vertices().iter().map(|p| p.coords).collect();
        SphericalEmbedding::new(surface.clone(), &directions).unwrap()
    }

    /// A ball with a horn that single triangles of a coarse domain cover, and such a domain, rotated so that no vertex
    /// of one is on an edge of the other, where the map is not differentiable.
    fn horned(sharpness: f64) -> (SphericalEmbedding, SurfaceMesh) {
        let turn = nalgebra::Rotation3::from_euler_angles(0.31, 0.47, 0.59);
        let target = shapes::deformed(&shapes::sphere(1.0, 4), |p| {
            p * (1.0 + 3.0 * (-sharpness * (p - Point::new(0.6, 0.0, 0.8)).norm_squared()).exp())
        });
        let domain = shapes::deformed(&shapes::sphere(1.0, 1), |p| {
            turn * Point::new(p.x + 0.2 * p.y * p.z, 0.8 * p.y, 1.2 * p.z + 0.1 * p.x)
        });
        (radial(&target), domain)
    }

    #[test]
    fn gradient_matches_central_differences_with_and_without_protrusions_springs_and_bent_triangles() {
        for (sharpness, with_protrusions, with_bent) in [(30.0, false, false), (30.0, true, false), (4.0, true, true)] {
            let (target, domain) = horned(sharpness);
            let locator = Locator::new(&target);
            let inverse = InverseEmbedding::new(&target, &locator);
            let embedding = PartialEmbedding::complete(&domain, radial(&domain).directions());
            let mut map = InterSurfaceMap::new(&inverse, &domain);
            map.locate(&embedding);
            if with_protrusions {
                map.finds_bent = with_bent;
                map.find_protrusions(&embedding);
                let to = Vector::new(0.1, -0.7, 0.7).normalize();
                map.springs = [(3, 0.5), (11, 20.0)]
                    .map(|(v, weight)| (v, Spring { to, weight }))
                    .into();
            }
            assert_eq!(map.has_protrusions(), with_protrusions);
            assert_eq!(!map.bent.is_empty(), with_bent);
            // All vertices are inserted: places are vertices.
            let mesh = embedding.inserted_mesh();
            let triangles = &mesh.triangles;
            let shapes = RestShapes::new(triangles, domain.vertices());
            let energy = InterSurfaceEnergy::new(&map, &mesh, &shapes);
            let x = embedding.directions.clone();
            let frames: Vec<[Vector; 2]> = x.iter().map(tangents).collect();
            let mut gradient = vec![[0.0; 2]; x.len()];
            for (t, element) in triangles.iter().zip(energy.elements(&x, &frames)) {
                for i in 0..6 {
                    gradient[t[i / 2] as usize][i % 2] += element.gradient[i];
                }
            }
            let size = gradient.iter().flatten().fold(0.0f64, |m, g| m.max(g.abs()));
            // Second order: truncation of some h², rounding of ε E / h.
            let h = 1e-6;
            for v in 0..x.len() {
                for k in 0..2 {
                    let at = |step: f64| {
                        let mut moved = x.clone();
                        moved[v] = (x[v] + step * frames[v][k]).normalize();
                        energy.value(&moved)
                    };
                    let slope = (at(h) - at(-h)) / (2.0 * h);
                    assert!(
                        (slope - gradient[v][k]).abs() < 1e-6 * size,
                        "{v} {k}: {slope} {:?}",
                        gradient[v]
                    );
                }
            }
        }
    }

    #[test]
    fn sweeps_never_raise_the_energy_and_keep_fixed_vertices() {
        for (sharpness, finds_bent) in [(30.0, false), (4.0, true)] {
            let (target, domain) = horned(sharpness);
            let locator = Locator::new(&target);
            let inverse = InverseEmbedding::new(&target, &locator);
            let mut embedding = PartialEmbedding::complete(&domain, radial(&domain).directions());
            let mut map = InterSurfaceMap::new(&inverse, &domain);
            map.locate(&embedding);
            map.finds_bent = finds_bent;
            map.find_protrusions(&embedding);
            assert_eq!(!map.bent.is_empty(), finds_bent);
            let mesh = embedding.inserted_mesh();
            let shapes = RestShapes::new(&mesh.triangles, domain.vertices());
            let vertices = embedding.inserted.clone();
            let start = InterSurfaceEnergy::new(&map, &mesh, &shapes).value(&embedding.directions);
            let mut last = start;
            for _ in 0..10 {
                map.sweep(&mut embedding, &vertices, &|v| v == 7);
                let value = InterSurfaceEnergy::new(&map, &mesh, &shapes).value(&embedding.directions);
                assert!(value <= last * (1.0 + 1e-14), "{value} {last}");
                last = value;
            }
            assert!(last < 0.98 * start, "{start} {last}");
            assert_eq!(embedding.directions[7], radial(&domain).directions()[7]);
        }
    }
}
