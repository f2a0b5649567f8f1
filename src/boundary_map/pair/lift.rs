//! The map to the target that a drawing of the domain on the target's sphere makes, and how to make it distort less.
//!
//! A vertex of the domain at the direction `x` goes to the point of the target that is drawn there. What is minimised is
//! the symmetric Dirichlet energy `|J|² + |J⁻¹|²` of the triangles between these points (Schreiner, Asirvatham, Praun,
//! Hoppe, *Inter-surface mapping*, 2004; Smith and Schaefer, *Bijective parameterization with free boundaries*, 2015),
//! over drawings whose triangles are all positive: bijections.

use std::collections::HashMap;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;
use smallvec::SmallVec;

use crate::mesh::SurfaceMesh;
use crate::spherical::{
    Drawing, Element, Energy, Hessian, Locator, Objective, Pull, Rest, RestShapes, SphericalMap, Weights, det,
    newton_step, positive_det, semidefinite,
};
use crate::{Matrix3, Point, Vector};

/// Weight of the shapes of the triangles on the sphere. It keeps drawings away from flat triangles, which the energy
/// alone would come up against where triangles between points of the target cut corners.
const BARRIER: f64 = 1e-3;

/// Parts of the target that are told apart when looking for limbs.
const MOST_PARTS: usize = 20_000;
/// Parts looked up for each triangle of a drawing, at most.
const PARTS_PER_TRIANGLE: usize = 4;
/// A triangle hides something if it covers at least this many parts, and this many times the area of its straight image.
const FEWEST_PARTS: usize = 4;
const HIDING: f64 = 1.5;
/// Areas count this many times as large at most.
const MOST_HIDDEN: f64 = 100.0;

/// The target, drawn on the sphere, as seen by drawings of domains.
pub(crate) struct Lift<'a> {
    target: &'a SphericalMap,
    locator: &'a Locator,
    /// Lengths of the target are multiplied by this, so that its area is 4π.
    scale: f64,
    /// Directions that stand for parts of the target, and the areas of these.
    parts: Vec<(Vector, f64)>,
}

/// The image of a vertex.
#[derive(Debug, Clone, Copy)]
struct Image {
    /// In the units of area 4π.
    point: Point,
    /// Triangle of the target.
    triangle: u32,
}

/// A drawing of the domain on the target's sphere, with the points of the target that its vertices go to.
pub(crate) struct Lifted<'a> {
    lift: &'a Lift<'a>,
    domain: &'a [Point],
    /// Areas of the domain's triangles are multiplied by this.
    unit: f64,
    images: Vec<Image>,
    /// By how much the part of the target that a triangle covers is larger than the straight triangle between the images
    /// of its corners, where that is a lot: a limb may stick out of it. Its image counts as that much larger, so that
    /// vertices are drawn onto the limb. Triangles start with their lowest vertex.
    hidden: HashMap<[u32; 3], f64>,
}

struct Corner {
    direction: Vector,
    image: Point,
    /// Of the triangle with the next corner.
    triangle: Weighed,
}

/// A triangle of the domain against the target.
#[derive(Debug, Clone, Copy)]
struct Weighed {
    /// Its shape, and its area.
    rest: Rest,
    /// Its area over [`hidden`](Lifted::hidden): what its image is held against.
    reduced: f64,
}

type Star = SmallVec<[Corner; 10]>;

impl<'a> Lift<'a> {
    pub fn new(target: &'a SphericalMap, locator: &'a Locator) -> Self {
        let surface = target.surface();
        let scale = (4.0 * std::f64::consts::PI / surface.area()).sqrt();
        let count = surface.triangles().len();
        let stride = count.div_ceil(MOST_PARTS);
        let part = |t: usize| {
            let middle = surface.triangles()[t].map(|v| target.directions()[v as usize]);
            let area = surface.area_vector(t).norm() * scale * scale;
            (middle.iter().sum::<Vector>().normalize(), stride as f64 * area)
        };
        Self {
            target,
            locator,
            scale,
            parts: (0..count).step_by(stride).map(part).collect(),
        }
    }

    fn image(&self, x: &Vector, hint: u32) -> Image {
        let place = self.locator.locate_from(x, hint);
        let point = place.position(self.target.surface(), self.target.surface().vertices());
        Image {
            point: point * self.scale,
            triangle: place.triangle,
        }
    }

    /// Derivative of the image by the direction.
    fn derivative(&self, x: &Vector, image: &Image) -> Matrix3 {
        let corners = self.target.surface().triangles()[image.triangle as usize];
        let [a, b, c] = corners.map(|v| self.target.directions()[v as usize]);
        let [p, q, r] = corners.map(|v| self.target.surface().vertices()[v as usize] * self.scale);
        let weights = [det(x, &b, &c), det(x, &c, &a), det(x, &a, &b)];
        let total: f64 = weights.iter().sum();
        let slopes = [b.cross(&(c - b)), c.cross(&(a - c)), a.cross(&(b - a))];
        let parts = slopes.iter().zip([p, q, r]);
        parts
            .map(|(slope, corner)| (corner - image.point) * slope.transpose() / total)
            .sum()
    }
}

impl<'a> Lifted<'a> {
    pub fn new(lift: &'a Lift, domain: &'a SurfaceMesh) -> Self {
        let nowhere = Image {
            point: Point::origin(),
            triangle: 0,
        };
        Self {
            lift,
            domain: domain.vertices(),
            unit: 1.0,
            images: vec![nowhere; domain.vertices().len()],
            hidden: HashMap::new(),
        }
    }

    /// Finds the triangles that cover more of the target than shows between the images of their corners.
    pub fn find_hidden(&mut self, drawing: &Drawing) {
        self.hidden.clear();
        let triangles = drawing.neighbours.triangles();
        let mut number = vec![0; drawing.directions.len()];
        for (i, &v) in drawing.there.iter().enumerate() {
            number[v as usize] = i as u32;
        }
        let directions: Vec<Vector> = drawing.there.iter().map(|&v| drawing.directions[v as usize]).collect();
        let points = directions.iter().map(|x| Point::from(*x)).collect();
        let numbered = triangles.iter().map(|t| t.map(|v| number[v as usize])).collect();
        let surface = SurfaceMesh::new(points, numbered).expect("every vertex of a drawing is there");
        let locator = Locator::of_drawing(&surface, &directions);
        // As many as are needed to tell: coarse drawings are many.
        let stride = (self.lift.parts.len() / (PARTS_PER_TRIANGLE * triangles.len())).max(1);
        let parts: Vec<(Vector, f64)> = self.lift.parts.iter().step_by(stride).copied().collect();
        let middles: Vec<Vector> = parts.iter().map(|part| part.0).collect();
        let mut covered = vec![(0, 0.0); triangles.len()];
        for (place, (_, area)) in locator.locate_all(&middles).iter().zip(&parts) {
            let (count, sum) = &mut covered[place.triangle as usize];
            *count += 1;
            *sum += stride as f64 * area;
        }
        for (t, (count, area)) in triangles.iter().zip(covered) {
            let [y, a, b] = t.map(|v| self.images[v as usize].point);
            let straight = 0.5 * (a - y).cross(&(b - y)).norm();
            if count >= FEWEST_PARTS && area > HIDING * straight {
                self.hidden.insert(*t, (area / straight).min(MOST_HIDDEN));
            }
        }
    }

    /// Whether any triangle hides something.
    pub fn hides(&self) -> bool {
        !self.hidden.is_empty()
    }

    fn weighed(&self, t: [u32; 3]) -> Weighed {
        let rest = Rest::of(t.map(|v| &self.domain[v as usize]), self.unit);
        let hidden = if self.hidden.is_empty() {
            None
        } else {
            self.hidden.get(&lowest_first(t))
        };
        Weighed {
            rest,
            reduced: rest.area / hidden.unwrap_or(&1.0),
        }
    }

    /// Looks up the images of the vertices of a drawing anew.
    pub fn locate(&mut self, drawing: &Drawing) {
        self.unit = drawing.area_unit(self.domain);
        for &v in &drawing.there {
            self.images[v as usize] = self
                .lift
                .image(&drawing.directions[v as usize], self.images[v as usize].triangle);
        }
    }

    /// Moves each of these vertices, unless it is fixed, once to where its triangles are distorted less. Returns how many
    /// moved.
    pub fn sweep(&mut self, drawing: &mut Drawing, vertices: &[u32], is_fixed: &dyn Fn(u32) -> bool) -> usize {
        let mut star = Star::new();
        let mut moved = 0;
        for &v in vertices.iter().filter(|&&v| !is_fixed(v)) {
            self.gather(drawing, v, &mut star);
            let x = drawing.directions[v as usize];
            if let Some((x, image)) = self.better_place(&x, &self.images[v as usize], &star) {
                drawing.directions[v as usize] = x;
                self.images[v as usize] = image;
                moved += 1;
            }
        }
        moved
    }

    /// Vertices whose triangles have more than `limit` times the energy of an isometry, with their neighbours; ascending.
    pub fn distorted(&self, drawing: &Drawing, limit: f64) -> Vec<u32> {
        let mut found = Vec::new();
        let mut star = Star::new();
        for &v in &drawing.there {
            self.gather(drawing, v, &mut star);
            let area: f64 = star.iter().map(|corner| corner.triangle.rest.area).sum();
            let value = self.value(&drawing.directions[v as usize], &self.images[v as usize].point, &star);
            if value.is_none_or(|value| value > limit * area) {
                found.push(v);
                found.extend_from_slice(drawing.neighbours.of(v));
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    fn gather(&self, drawing: &Drawing, v: u32, star: &mut Star) {
        let ring = drawing.neighbours.of(v);
        star.clear();
        star.extend(ring.iter().enumerate().map(|(i, &r)| {
            let next = ring[(i + 1) % ring.len()];
            Corner {
                direction: drawing.directions[r as usize],
                image: self.images[r as usize].point,
                triangle: self.weighed([v, r, next]),
            }
        }));
    }

    /// Energy over all triangles per area, 1 of an isometry.
    pub fn energy(&self, drawing: &Drawing) -> f64 {
        let mut sum = [0.0; 2];
        for t in drawing.neighbours.triangles() {
            let triangle = self.weighed(t);
            let [y, a, b] = t.map(|v| self.images[v as usize].point);
            let (s, c, _) = stretches(&y, &a, &b, &triangle);
            let e = 0.25 * (s + s / (c * c));
            sum[0] += triangle.rest.area;
            sum[1] += triangle.rest.area * e;
        }
        let mean = sum[1] / sum[0];
        if mean.is_nan() { f64::INFINITY } else { mean }
    }

    fn value(&self, x: &Vector, y: &Point, star: &Star) -> Option<f64> {
        let mut value = 0.0;
        for (i, a) in star.iter().enumerate() {
            let b = &star[(i + 1) % star.len()];
            let d = positive_det(x, &a.direction, &b.direction)?;
            let (s, c, _) = stretches(y, &a.image, &b.image, &a.triangle);
            let rest = &a.triangle.rest;
            let shape = chords(x, &a.direction, &b.direction, rest) / (2.0 * d);
            value += rest.area * (0.25 * (s + s / (c * c)) + BARRIER * shape);
        }
        // Where two sheets of the target are folded flat, areas vanish and the energy is infinite.
        (!value.is_nan()).then_some(value)
    }

    fn better_place(&self, x: &Vector, image: &Image, star: &Star) -> Option<(Vector, Image)> {
        let before = self.value(x, &image.point, star)?;
        let y = image.point;
        let (mut slope, mut bend) = (Vector::zeros(), Matrix3::zeros());
        let (mut gradient, mut hessian) = (Vector::zeros(), Matrix3::zeros());
        for (i, a) in star.iter().enumerate() {
            let b = &star[(i + 1) % star.len()];
            let Weighed { rest, reduced } = a.triangle;
            let [_, ca, cb] = rest.cotangents;
            let (s, c, normal) = stretches(&y, &a.image, &b.image, &a.triangle);
            let ds = (ca * (y - b.image) + cb * (y - a.image)) / reduced;
            let dc = normal.cross(&(b.image - a.image)) / (2.0 * reduced);
            let w = 0.25 * rest.area;
            let (c2, c3) = (c * c, c * c * c);
            slope += w * ((1.0 + 1.0 / c2) * ds - 2.0 * s / c3 * dc);
            let cross = ds * dc.transpose();
            bend += w
                * (Matrix3::identity() * ((ca + cb) / reduced * (1.0 + 1.0 / c2))
                    - (cross + cross.transpose()) * (2.0 / c3)
                    + dc * dc.transpose() * (6.0 * s / (c2 * c2)));
            let d = det(x, &a.direction, &b.direction);
            let n = a.direction.cross(&(b.direction - a.direction));
            let q = chords(x, &a.direction, &b.direction, &rest);
            let dq = 2.0 * (ca * (x - b.direction) + cb * (x - a.direction));
            let w = 0.5 * BARRIER * rest.area;
            let cross = dq * n.transpose();
            gradient += w * (dq / d - q / (d * d) * n);
            hessian += w
                * (Matrix3::identity() * (2.0 * (ca + cb) / d) - (cross + cross.transpose()) / (d * d)
                    + n * n.transpose() * (2.0 * q / (d * d * d)));
        }
        let chain = self.lift.derivative(x, image);
        gradient += chain.transpose() * slope;
        hessian += chain.transpose() * bend * chain;
        let step = newton_step(x, &gradient, &hessian)?;
        let step_to = |share: f64| {
            let to = (x + share * step).normalize();
            let there = self.lift.image(&to, image.triangle);
            let value = self.value(&to, &there.point, star)?;
            (value < before).then_some((value, (to, there)))
        };
        let mut share = 1.0;
        let mut best = None;
        for _ in 0..8 {
            best = step_to(share);
            if best.is_some() {
                break;
            }
            share *= 0.4;
        }
        // Out of a narrow triangle Newton's steps are too short by far.
        while let Some((value, _)) = best {
            share *= 2.5;
            match step_to(share) {
                Some(farther) if farther.0 < value && share < 1e3 => best = Some(farther),
                _ => break,
            }
        }
        best.map(|(_, place)| place)
    }
}

/// Squared norm of the Jacobian, its determinant, and the unit normal of the triangle in space.
fn stretches(y: &Point, a: &Point, b: &Point, triangle: &Weighed) -> (f64, f64, Vector) {
    let [cy, ca, cb] = triangle.rest.cotangents;
    let (ya, yb) = (a - y, b - y);
    let s = (cy * (b - a).norm_squared() + ca * yb.norm_squared() + cb * ya.norm_squared()) / (2.0 * triangle.reduced);
    let cross = ya.cross(&yb);
    let area = cross.norm();
    (s, area / (2.0 * triangle.reduced), cross / area)
}

/// Four times the Dirichlet energy of the map to the chords of a triangle on the sphere.
fn chords(x: &Vector, a: &Vector, b: &Vector, rest: &Rest) -> f64 {
    let [cx, ca, cb] = rest.cotangents;
    cx * (b - a).norm_squared() + ca * (b - x).norm_squared() + cb * (a - x).norm_squared()
}

/// The energy as a function of all directions at once, for Newton's method.
pub(crate) struct LiftedEnergy<'a> {
    lift: &'a Lift<'a>,
    weighed: Vec<Weighed>,
    shapes: &'a RestShapes,
    /// Where vertices were found last; only the time of the next search depends on it.
    hints: Vec<AtomicU32>,
}

impl<'a> LiftedEnergy<'a> {
    pub fn new(lifted: &Lifted<'a>, shapes: &'a RestShapes) -> Self {
        Self {
            lift: lifted.lift,
            weighed: shapes.triangles().iter().map(|t| lifted.weighed(*t)).collect(),
            shapes,
            hints: lifted
                .images
                .iter()
                .map(|image| AtomicU32::new(image.triangle))
                .collect(),
        }
    }

    fn barrier(&self) -> Energy<'_> {
        Energy {
            rest: self.shapes,
            weights: Weights {
                angle: BARRIER,
                area: 0.0,
            },
            pulls: &[],
        }
    }

    fn images(&self, x: &[Vector]) -> Vec<Image> {
        let of_vertex = |(x, hint): (&Vector, &AtomicU32)| {
            if *x == Vector::zeros() {
                return Image {
                    point: Point::origin(),
                    triangle: 0,
                };
            }
            let image = self.lift.image(x, hint.load(Relaxed));
            hint.store(image.triangle, Relaxed);
            image
        };
        x.par_iter().zip(&self.hints).map(of_vertex).collect()
    }
}

impl Objective for LiftedEnergy<'_> {
    fn triangles(&self) -> &[[u32; 3]] {
        self.shapes.triangles()
    }

    fn pulls(&self) -> &[Pull] {
        &[]
    }

    fn value(&self, x: &[Vector]) -> f64 {
        let barrier = self.barrier().value(x);
        if !barrier.is_finite() {
            return f64::INFINITY;
        }
        let images = self.images(x);
        let of_triangle = |(t, triangle): (&[u32; 3], &Weighed)| {
            let [y, a, b] = t.map(|v| images[v as usize].point);
            let (s, c, _) = stretches(&y, &a, &b, triangle);
            0.25 * triangle.rest.area * (s + s / (c * c))
        };
        let values: Vec<f64> = self
            .triangles()
            .par_iter()
            .zip(&self.weighed)
            .map(of_triangle)
            .collect();
        let sum = values.iter().sum::<f64>() + barrier;
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    fn elements(&self, x: &[Vector], frames: &[[Vector; 2]]) -> Vec<Element> {
        let images = self.images(x);
        let chain = |v: usize| {
            let derivative = if x[v] == Vector::zeros() {
                Matrix3::zeros()
            } else {
                self.lift.derivative(&x[v], &images[v])
            };
            frames[v].map(|tangent| derivative * tangent)
        };
        let chains: Vec<[Vector; 2]> = (0..x.len()).into_par_iter().map(chain).collect();
        let mut elements = self.barrier().elements(x, frames);
        let parts = elements.par_iter_mut().zip(self.triangles()).zip(&self.weighed);
        parts.for_each(|((element, t), triangle)| {
            let points = t.map(|v| images[v as usize].point);
            add_lifted(element, &points, &t.map(|v| chains[v as usize]), triangle);
        });
        elements
    }
}

fn add_lifted(element: &mut Element, [y, a, b]: &[Point; 3], chains: &[[Vector; 2]; 3], triangle: &Weighed) {
    let Weighed { rest, reduced } = triangle;
    let [cy, ca, cb] = rest.cotangents;
    let (s, c, normal) = stretches(y, a, b, triangle);
    let ds = [
        ca * (y - b) + cb * (y - a),
        cb * (a - y) + cy * (a - b),
        cy * (b - a) + ca * (b - y),
    ];
    let ds = ds.map(|v| v / *reduced);
    let dc = [b - a, y - b, a - y].map(|v| normal.cross(&v) / (2.0 * reduced));
    let (c2, c3) = (c * c, c * c * c);
    let w = 0.25 * rest.area;
    let tangent = |g: &[Vector; 3]| -> [f64; 6] { std::array::from_fn(|i| g[i / 2].dot(&chains[i / 2][i % 2])) };
    let (gs, gc) = (tangent(&ds), tangent(&dc));
    // Cotangent of the angle opposite to two corners.
    let opposite = |m: usize, n: usize| rest.cotangents[3 - m - n];
    let mut bend = Hessian::zeros();
    for i in 0..6 {
        element.gradient[i] += w * ((1.0 + 1.0 / c2) * gs[i] - 2.0 * s / c3 * gc[i]);
        for j in 0..6 {
            let (m, n) = (i / 2, j / 2);
            let weight = if m == n {
                opposite(m, (m + 1) % 3) + opposite(m, (m + 2) % 3)
            } else {
                -opposite(m, n)
            };
            let metric = weight / reduced * chains[m][i % 2].dot(&chains[n][j % 2]);
            let cross = gs[i] * gc[j] + gc[i] * gs[j];
            bend[(i, j)] = w * ((1.0 + 1.0 / c2) * metric - 2.0 / c3 * cross + 6.0 * s / (c2 * c2) * gc[i] * gc[j]);
        }
    }
    element.hessian += semidefinite(bend);
}

fn lowest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::spherical::tangents;

    fn by_rays(surface: &SurfaceMesh) -> SphericalMap {
        let directions: Vec<Vector> = surface.vertices().iter().map(|p| p.coords).collect();
        SphericalMap::new(surface.clone(), &directions).unwrap()
    }

    /// A ball with a horn that the triangles of a coarse drawing hide, and a coarse domain. Drawn by rays, no vertex of one
    /// is where the other has an edge and the map a crease.
    fn horned() -> (SphericalMap, SurfaceMesh) {
        let turn = nalgebra::Rotation3::from_euler_angles(0.31, 0.47, 0.59);
        let target = shapes::deformed(&shapes::sphere(1.0, 4), |p| {
            p * (1.0 + 3.0 * (-30.0 * (p - Point::new(0.6, 0.0, 0.8)).norm_squared()).exp())
        });
        let domain = shapes::deformed(&shapes::sphere(1.0, 1), |p| {
            turn * Point::new(p.x + 0.2 * p.y * p.z, 0.8 * p.y, 1.2 * p.z + 0.1 * p.x)
        });
        (by_rays(&target), domain)
    }

    #[test]
    fn gradient_matches_central_differences_also_where_something_is_hidden() {
        let (target, domain) = horned();
        let locator = Locator::new(&target);
        let lift = Lift::new(&target, &locator);
        let drawing = Drawing::of(&domain, by_rays(&domain).directions());
        let mut lifted = Lifted::new(&lift, &domain);
        lifted.locate(&drawing);
        for hides in [false, true] {
            if hides {
                lifted.find_hidden(&drawing);
            }
            assert_eq!(lifted.hides(), hides);
            let triangles = drawing.neighbours.triangles();
            let shapes = RestShapes::new(&triangles, domain.vertices());
            let energy = LiftedEnergy::new(&lifted, &shapes);
            let x = drawing.directions.clone();
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
    fn sweeps_never_raise_the_energy_and_turn_nothing() {
        let (target, domain) = horned();
        let locator = Locator::new(&target);
        let lift = Lift::new(&target, &locator);
        let mut drawing = Drawing::of(&domain, by_rays(&domain).directions());
        let mut lifted = Lifted::new(&lift, &domain);
        lifted.locate(&drawing);
        lifted.find_hidden(&drawing);
        let triangles = drawing.neighbours.triangles();
        let shapes = RestShapes::new(&triangles, domain.vertices());
        let there = drawing.there.clone();
        let start = LiftedEnergy::new(&lifted, &shapes).value(&drawing.directions);
        let mut last = start;
        for _ in 0..10 {
            let moved = lifted.sweep(&mut drawing, &there, &|v| v == 7);
            let value = LiftedEnergy::new(&lifted, &shapes).value(&drawing.directions);
            assert!(value <= last * (1.0 + 1e-14), "{value} {last} {moved}");
            last = value;
        }
        assert!(last < 0.98 * start, "{start} {last}");
        assert_eq!(drawing.directions[7], by_rays(&domain).directions()[7]);
    }
}
