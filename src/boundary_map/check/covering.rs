//! The degree of a map, and which triangles it inverts.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use nalgebra::{Matrix4, Vector4};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use robust::{Coord, orient2d};
use serde::Serialize;

use crate::geometry::{ClosestPoint, SurfaceQuery, orientation};
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;
use crate::spherical::check_embedding;
use crate::{Point, Vector};

/// What an image was compared with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "surface")]
pub enum ComparedWith {
    /// The sphere that all its vertices lie on: decided exactly, by geodesic triangles.
    Sphere {
        /// Its centre.
        centre: [f64; 3],
        /// Its radius.
        radius: f64,
    },
    /// The target surface that was given.
    Target,
    /// Nothing but itself.
    Itself,
}

/// How often, with sign, a map covers its target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Degree {
    /// The degree: 1 for a bijection, −1 if it reverses the orientation.
    pub value: i64,
    /// Fraction of the points inside that have this winding number; below 1 where the image overlaps itself.
    pub agreement: f64,
    /// Number of points inside; 0 for a map onto or through a sphere, whose degree is a sum of solid angles.
    pub points: usize,
}

/// The degree of a map, and its defective triangles.
pub(super) struct Covering {
    pub compared_with: ComparedWith,
    /// How many triangles there are.
    pub triangles: usize,
    pub degree: Option<Degree>,
    /// Inverted triangles, ascending.
    pub flipped: Vec<u32>,
    /// Triangles with an area whose images have none.
    pub degenerate: Vec<u32>,
    /// Triangles of the domain without an area, ascending.
    pub flat_in_domain: Vec<u32>,
}

/// Edges at which an image is folded.
pub(super) struct FoldedEdges {
    pub edges: Vec<[u32; 2]>,
    /// Triangles at these edges that face against the triangles around them.
    pub reversed: Vec<u32>,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Facing {
    Outward,
    Inward,
    Flat,
}

/// Number of points inside a target at which winding numbers are taken.
const INSIDE: usize = 256;
/// Random points of the bounding box that points inside are selected from.
const TRIED: usize = 20_000;
/// Number of the deepest points, which are used when none is deep enough.
const DEEPEST: usize = 32;
/// Distance from a sphere, over its radius, that counts as rounding of coordinates in files.
const ON_SPHERE: f64 = 1e-6;

impl Covering {
    /// `off` is how far the image may be from the target, as a fraction of the target's diagonal.
    pub fn new(
        domain: &SurfaceMesh,
        (image, image_query): (&SurfaceMesh, &SurfaceQuery),
        target: Option<(&SurfaceMesh, &SurfaceQuery)>,
        folded: &FoldedEdges,
        off: f64,
        seed: u64,
    ) -> Self {
        let sphere = common_sphere(image, target.map(|(mesh, _)| mesh));
        let (compared_with, mut facings, degree) = match (sphere, target) {
            (Some((centre, radius)), _) => {
                let compared_with = ComparedWith::Sphere {
                    centre: centre.into(),
                    radius,
                };
                let directions: Vec<Vector> = image.vertices().iter().map(|p| p - centre).collect();
                let degree = Degree {
                    value: check_embedding(image.triangles(), &directions).degree.round() as i64,
                    agreement: 1.0,
                    points: 0,
                };
                (compared_with, facings_on_sphere(image, &directions), degree)
            }
            (None, Some((mesh, query))) => {
                let points = deep(points_inside(query, seed), query, off * mesh.diagonal());
                let facings = facings_on_target(image, mesh, query);
                (ComparedWith::Target, facings, degree(&points, image_query))
            }
            (None, None) => {
                let mut facings = vec![Facing::Outward; image.triangles().len()];
                for &t in &folded.reversed {
                    facings[t as usize] = Facing::Inward;
                }
                let degree = degree(&points_inside(image_query, seed), image_query);
                (ComparedWith::Itself, facings, degree)
            }
        };
        facings.par_iter_mut().enumerate().for_each(|(t, facing)| {
            if is_flat(&image.corners(t)) {
                *facing = Facing::Flat;
            }
        });
        let triangles = (0..domain.triangles().len()).into_par_iter();
        let flat_in_domain: Vec<bool> = triangles.map(|t| is_flat(&domain.corners(t))).collect();
        let with_area = |which: Facing| {
            let mut found = triangles_facing(which, &facings);
            found.retain(|&t| !flat_in_domain[t as usize]);
            found
        };
        Self {
            compared_with,
            triangles: domain.triangles().len(),
            degree: bounds_a_solid(domain).then_some(degree),
            flipped: with_area(Facing::Inward),
            degenerate: with_area(Facing::Flat),
            flat_in_domain: (0..)
                .zip(&flat_in_domain)
                .filter(|(_, flat)| **flat)
                .map(|(t, _)| t)
                .collect(),
        }
    }

    /// Triangles that face the other way than the map as a whole: those that are not inverted, where it reverses the
    /// orientation. Compared with itself alone, an image has no way that its triangles should face.
    pub fn facing_wrong_way(&self) -> Vec<u32> {
        if !self.is_mirrored() || matches!(self.compared_with, ComparedWith::Itself) {
            return self.flipped.clone();
        }
        let lists = [&self.flipped, &self.degenerate, &self.flat_in_domain];
        let is_listed = |t: &u32| lists.iter().any(|list| list.binary_search(t).is_ok());
        (0..self.triangles as u32).filter(|t| !is_listed(t)).collect()
    }

    /// Whether the map reverses the orientation.
    pub fn is_mirrored(&self) -> bool {
        self.degree.is_some_and(|degree| degree.value < 0)
    }
}

impl FoldedEdges {
    pub fn find(domain: &SurfaceMesh, image: &SurfaceMesh) -> Self {
        let topology = Topology::new(image);
        let normals = |mesh: &SurfaceMesh| -> Vec<Vector> {
            let count = mesh.triangles().len();
            (0..count).into_par_iter().map(|t| mesh.area_vector(t)).collect()
        };
        let (before, after) = (normals(domain), normals(image));
        let is_folded = |e: &usize| match topology.sides(*e) {
            [first, second] if topology.runs_forward(*first) != topology.runs_forward(*second) => {
                let pair = [first.triangle as usize, second.triangle as usize];
                turns_back(&after, pair) && !turns_back(&before, pair)
            }
            _ => false,
        };
        let folded: Vec<usize> = (0..topology.edges().len()).filter(is_folded).collect();
        let mut around = vec![Vector::zeros(); image.vertices().len()];
        for (triangle, normal) in image.triangles().iter().zip(&after) {
            triangle.iter().for_each(|&v| around[v as usize] += normal);
        }
        let opposes = |t: u32| {
            let corners = image.triangles()[t as usize];
            let own = after[t as usize];
            let others = corners.iter().map(|&v| around[v as usize]).sum::<Vector>() - 3.0 * own;
            own.dot(&others) < 0.0
        };
        let sides = folded.iter().flat_map(|&e| topology.sides(e));
        let mut reversed: Vec<u32> = sides.map(|side| side.triangle).filter(|&t| opposes(t)).collect();
        reversed.sort_unstable();
        reversed.dedup();
        Self {
            edges: folded.iter().map(|&e| topology.edges()[e]).collect(),
            reversed,
        }
    }
}

/// The triangles with this facing, ascending.
pub(super) fn triangles_facing(facing: Facing, facings: &[Facing]) -> Vec<u32> {
    let has_facing = |t: &u32| facings[*t as usize] == facing;
    (0..facings.len() as u32).filter(has_facing).collect()
}

/// Whether the normals of two triangles differ by more than 150°.
fn turns_back(normals: &[Vector], [a, b]: [usize; 2]) -> bool {
    const COSINE: f64 = -0.866_025_403_784_438_6;
    let (a, b) = (normals[a], normals[b]);
    a.dot(&b) < COSINE * (a.norm() * b.norm())
}

/// Whether the mesh is closed and consistently oriented.
pub(super) fn bounds_a_solid(mesh: &SurfaceMesh) -> bool {
    let topology = Topology::new(mesh);
    topology.is_closed() && topology.orientation().inconsistent_edges.is_empty()
}

/// Whether the corners are exactly on a line, as they are if their projections to the three coordinate planes are.
pub(super) fn is_flat(corners: &[Point; 3]) -> bool {
    (0..3).all(|k| {
        let [a, b, c] = corners.map(|p| Coord {
            x: p[k],
            y: p[(k + 1) % 3],
        });
        orient2d(a, b, c) == 0.0
    })
}

/// Centre and radius of the sphere that the vertices of the image, and of the target if there is one, lie on.
fn common_sphere(image: &SurfaceMesh, target: Option<&SurfaceMesh>) -> Option<(Point, f64)> {
    let (centre, radius) = fitted_sphere(image)?;
    let lies_on = |mesh: &SurfaceMesh| {
        let mut used = mesh.triangles().iter().flatten().map(|&v| mesh.vertices()[v as usize]);
        used.all(|p| ((p - centre).norm() - radius).abs() <= ON_SPHERE * radius)
    };
    (lies_on(image) && target.is_none_or(lies_on)).then_some((centre, radius))
}

/// The least-squares sphere through the triangles' corners: `|p|² − 2 c·p = r² − |c|²` is linear in the unknowns.
fn fitted_sphere(mesh: &SurfaceMesh) -> Option<(Point, f64)> {
    let (low, high) = mesh.bounding_box()?;
    let (origin, size) = (nalgebra::center(&low, &high), (high - low).amax());
    let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for &v in mesh.triangles().iter().flatten() {
        let p = (mesh.vertices()[v as usize] - origin) / size;
        let row = Vector4::new(2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0);
        matrix += row * row.transpose();
        right += row * p.norm_squared();
    }
    let solution = matrix.cholesky()?.solve(&right);
    let centre = solution.xyz();
    let radius = (solution.w + centre.norm_squared()).sqrt();
    (radius.is_finite() && radius > 0.0).then(|| (origin + centre * size, radius * size))
}

/// How each geodesic triangle faces, decided exactly.
pub(super) fn facings_on_sphere(mesh: &SurfaceMesh, directions: &[Vector]) -> Vec<Facing> {
    let facing = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| Point::from(directions[v as usize]));
        match orientation(&Point::origin(), &a, &b, &c) {
            Some(Ordering::Greater) => Facing::Outward,
            Some(Ordering::Less) => Facing::Inward,
            _ => Facing::Flat,
        }
    };
    mesh.triangles().par_iter().map(facing).collect()
}

/// A triangle faces inward if it faces against the target's normals at the points closest to all four of its samples.
/// All four must agree because a triangle may span a crease of the target.
pub(super) fn facings_on_target(image: &SurfaceMesh, target: &SurfaceMesh, query: &SurfaceQuery) -> Vec<Facing> {
    const SAMPLES: [[f64; 3]; 4] = {
        let (far, near) = (1.0 / 6.0, 2.0 / 3.0);
        [[1.0 / 3.0; 3], [near, far, far], [far, near, far], [far, far, near]]
    };
    let samples = |t: usize| {
        let [a, b, c] = image.corners(t).map(|p| p.coords);
        SAMPLES.map(|[l, m, n]| Point::from(a * l + b * m + c * n))
    };
    let places: Vec<Point> = (0..image.triangles().len()).flat_map(samples).collect();
    let closest = query.closest_points(&places);
    let facing = |(t, closest): (usize, &[ClosestPoint])| {
        let normal = image.area_vector(t);
        let faces_against = |c: &ClosestPoint| target.area_vector(c.triangle).dot(&normal) < 0.0;
        if closest.iter().all(faces_against) {
            Facing::Inward
        } else {
            Facing::Outward
        }
    };
    closest.chunks_exact(SAMPLES.len()).enumerate().map(facing).collect()
}

/// Random points of the bounding box with a winding number other than 0.
fn points_inside(query: &SurfaceQuery, seed: u64) -> Vec<Point> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let bounds = query.bounds();
    let tried: Vec<Point> = (0..TRIED)
        .map(|_| {
            let t = Vector::from_fn(|_, _| random.random::<f64>());
            bounds.low + bounds.extent().component_mul(&t)
        })
        .collect();
    let is_inside = |p: &Point| query.winding_number(p).abs() > 0.5;
    tried.into_par_iter().filter(is_inside).collect()
}

/// Points that are further from the surface than `off`: an image within this distance of the surface can be deformed
/// onto it without changing their winding number. When there are none, the deepest points.
fn deep(points: Vec<Point>, query: &SurfaceQuery, off: f64) -> Vec<Point> {
    let depths = query.closest_points(&points).into_iter().map(|c| c.distance);
    let mut ordered: Vec<(f64, Point)> = depths.zip(points).collect();
    let far = ordered.iter().filter(|(depth, _)| *depth > off).map(|(_, p)| *p);
    let far: Vec<Point> = far.take(INSIDE).collect();
    if !far.is_empty() {
        return far;
    }
    ordered.sort_by(|a, b| b.0.total_cmp(&a.0));
    ordered.into_iter().take(DEEPEST).map(|(_, p)| p).collect()
}

/// The most frequent of the winding numbers about these points.
fn degree(points: &[Point], image: &SurfaceQuery) -> Degree {
    let mut counts = BTreeMap::new();
    for p in points {
        *counts.entry(image.winding_number(p).round() as i64).or_insert(0usize) += 1;
    }
    let most = counts.iter().max_by_key(|(_, count)| **count);
    Degree {
        value: most.map_or(0, |(value, _)| *value),
        agreement: most.map_or(1.0, |(_, count)| *count as f64 / points.len() as f64),
        points: points.len(),
    }
}
