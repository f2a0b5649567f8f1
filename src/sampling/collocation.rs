//! Points on the boundary: those where equations are posed, and those held out to measure the error.

use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::Anchors;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// Boundary points at which the map is fitted to its data, each with its share of the surface area.
#[derive(Debug, Clone, PartialEq)]
pub struct Collocation {
    /// The points.
    pub points: Vec<SurfacePoint>,
    /// Area that each point stands for; they sum to the surface's area.
    pub areas: Vec<f64>,
}

impl Collocation {
    /// The given vertices, all of the same weight: the paper's choice. Vertices without a triangle are left out.
    ///
    /// # Panics
    ///
    /// When an index is out of range.
    pub fn vertices(domain: &SurfaceMesh, chosen: &[u32]) -> Self {
        let corner_of = corner_of_vertex(domain);
        let points: Vec<_> = chosen.iter().filter_map(|&v| corner_of[v as usize]).collect();
        let areas = vec![domain.area() / points.len().max(1) as f64; points.len()];
        Self { points, areas }
    }

    /// Every vertex and every triangle's centroid, about three points per vertex. Half of each triangle's area is
    /// shared by its vertices, the other half is its centroid's.
    ///
    /// With the vertices alone, a map with as many sources as vertices interpolates them and oscillates in between: the
    /// held-out error is four times that with the centroids (square systems in `docs/method.md`).
    pub fn vertices_and_centroids(domain: &SurfaceMesh) -> Self {
        let mut vertex_areas = vec![0.0; domain.vertices().len()];
        let triangle_areas: Vec<f64> = (0..domain.triangles().len())
            .map(|t| domain.area_vector(t).norm())
            .collect();
        for (corners, area) in domain.triangles().iter().zip(&triangle_areas) {
            corners.iter().for_each(|&v| vertex_areas[v as usize] += area / 6.0);
        }
        let corner_of = corner_of_vertex(domain);
        let vertices = corner_of
            .iter()
            .zip(&vertex_areas)
            .filter_map(|(point, &area)| point.map(|p| (p, area)));
        let centroids = triangle_areas
            .iter()
            .enumerate()
            .map(|(t, area)| (centroid(t as u32), area / 2.0));
        let (points, areas) = vertices.chain(centroids).filter(|&(_, area)| area > 0.0).unzip();
        Self { points, areas }
    }

    /// Each anchor's vertex, and `extra` points at random in the triangles nearest to it, one in each of `extra` parts
    /// of equal area. Every source then has `1 + extra` equations near it, however uneven the anchors are: with points
    /// spread by area alone, crowded sources are undetermined and their coefficients explode.
    pub fn around(domain: &SurfaceMesh, anchors: &Anchors, extra: usize, seed: u64) -> Self {
        let mut regions = vec![Vec::new(); anchors.vertices.len()];
        for t in 0..domain.triangles().len() {
            if let Some(anchor) = anchor_of_triangle(domain, anchors, t) {
                regions[anchor as usize].push(t as u32);
            }
        }
        let corner_of = corner_of_vertex(domain);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (mut points, mut areas) = (Vec::new(), Vec::new());
        for ((vertex, spacing), region) in anchors.vertices.iter().zip(&anchors.spacing).zip(&regions) {
            let first = points.len();
            points.extend(corner_of[*vertex as usize]);
            points.extend(stratified(domain, region, extra, &mut random));
            let share = spacing * spacing / (points.len() - first).max(1) as f64;
            areas.resize(points.len(), share);
        }
        Self { points, areas }
    }

    /// `count` points spread evenly by area, one at random in each of `count` strips of equal area that follow the
    /// order of the triangles. Equal weights.
    pub fn even(domain: &SurfaceMesh, count: usize, seed: u64) -> Self {
        let all: Vec<u32> = (0..domain.triangles().len() as u32).collect();
        let points = stratified(domain, &all, count, &mut ChaCha8Rng::seed_from_u64(seed));
        let areas = vec![domain.area() / count.max(1) as f64; points.len()];
        Self { points, areas }
    }
}

/// Points for measuring the boundary error: `count` at random by area (stratified, so that averages over them are those
/// over the area), then one in each of up to `max_triangles` evenly chosen triangles (at least one), so that the
/// maximum includes the small triangles at creases. Averages are to be taken over the first `count` only.
pub fn held_out(domain: &SurfaceMesh, count: usize, max_triangles: usize, seed: u64) -> Vec<SurfacePoint> {
    let triangles = domain.triangles().len();
    let all: Vec<u32> = (0..triangles as u32).collect();
    // A stream of its own, so that no point is a collocation point of a fit with the same seed.
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(1);
    let mut points = stratified(domain, &all, count, &mut random);
    let step = triangles.div_ceil(max_triangles.max(1)).max(1);
    let each = (0..triangles).step_by(step);
    points.extend(each.map(|t| random_point(t as u32, &mut random)));
    points
}

fn corner_of_vertex(domain: &SurfaceMesh) -> Vec<Option<SurfacePoint>> {
    let mut corner_of = vec![None; domain.vertices().len()];
    for (t, corners) in domain.triangles().iter().enumerate() {
        for (k, &v) in corners.iter().enumerate() {
            corner_of[v as usize].get_or_insert_with(|| SurfacePoint::corner(t as u32, k));
        }
    }
    corner_of
}

fn centroid(triangle: u32) -> SurfacePoint {
    SurfacePoint {
        triangle,
        barycentric: [1.0 / 3.0; 3],
    }
}

/// The anchor nearest to the triangle's centroid, of those nearest to its corners.
fn anchor_of_triangle(domain: &SurfaceMesh, anchors: &Anchors, triangle: usize) -> Option<u32> {
    let centre = centroid(triangle as u32).position(domain, domain.vertices());
    let distance = |anchor: &u32| (domain.vertices()[anchors.vertices[*anchor as usize] as usize] - centre).norm();
    let candidates = domain.triangles()[triangle]
        .iter()
        .filter_map(|&v| anchors.nearest[v as usize]);
    candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// `count` points in these triangles, one at random in each of `count` parts of equal area.
fn stratified(domain: &SurfaceMesh, triangles: &[u32], count: usize, random: &mut ChaCha8Rng) -> Vec<SurfacePoint> {
    let mut cumulative = Vec::with_capacity(triangles.len());
    let mut total = 0.0;
    for &t in triangles {
        total += domain.area_vector(t as usize).norm();
        cumulative.push(total);
    }
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    (0..count)
        .map(|k| {
            let area = (k as f64 + random.random::<f64>()) / count as f64 * total;
            let triangle = cumulative.partition_point(|&c| c <= area).min(cumulative.len() - 1);
            random_point(triangles[triangle], random)
        })
        .collect()
}

fn random_point(triangle: u32, random: &mut ChaCha8Rng) -> SurfacePoint {
    let barycentric = random_barycentric(random);
    SurfacePoint { triangle, barycentric }
}

/// Uniform in a triangle (Turk, *Generating random points in triangles*, Graphics Gems, 1990).
pub(super) fn random_barycentric(random: &mut ChaCha8Rng) -> [f64; 3] {
    let (root, t) = (random.random::<f64>().sqrt(), random.random::<f64>());
    [1.0 - root, root * (1.0 - t), root * t]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use crate::mesh::shapes;

    #[test]
    fn areas_sum_to_that_of_the_surface() {
        let domain = shapes::torus(1.0, 0.4, 20, 10);
        let all: Vec<u32> = (0..domain.vertices().len() as u32).collect();
        for collocation in [
            Collocation::vertices(&domain, &all),
            Collocation::vertices_and_centroids(&domain),
            Collocation::even(&domain, 333, 1),
        ] {
            let total: f64 = collocation.areas.iter().sum();
            assert!((total / domain.area() - 1.0).abs() < 1e-12);
        }
    }

    /// A sphere dimpled at one pole, so that the density of vertices varies: each anchor must have its equations
    /// nearby.
    #[test]
    fn every_anchor_has_its_points_in_its_neighbourhood() {
        let fine = shapes::sphere(1.0, 5);
        let cap = shapes::deformed(&fine, |p| crate::Point::new(p.x, p.y, p.z + 0.9 * (1.0 - p.z * p.z)));
        let anchors = Anchors::choose(&cap, 9000);
        let collocation = Collocation::around(&cap, &anchors, 2, 1);
        assert!(collocation.points.len() > 29 * 900);
        assert!((collocation.areas.iter().sum::<f64>() / cap.area() - 1.0).abs() < 1e-9);
        let positions: Vec<_> = collocation
            .points
            .iter()
            .map(|p| p.position(&cap, cap.vertices()))
            .collect();
        for (&vertex, spacing) in anchors.vertices.iter().zip(&anchors.spacing).step_by(37) {
            let centre = cap.vertices()[vertex as usize];
            let near = positions
                .iter()
                .filter(|p| (*p - centre).norm() < 2.0 * spacing)
                .count();
            assert!(near >= 5, "only {near} points within two spacings");
        }
    }

    #[test]
    fn vertices_without_triangles_are_left_out() {
        let (mut vertices, triangles) = shapes::cube(1.0, 1).into_parts();
        vertices.push(crate::Point::new(5.0, 5.0, 5.0));
        let domain = SurfaceMesh::new(vertices, triangles).unwrap();
        assert_eq!(Collocation::vertices_and_centroids(&domain).points.len(), 8 + 12);
        assert_eq!(Collocation::vertices(&domain, &[8]).points.len(), 0);
    }

    /// Half of the area holds `n/2` of `n` stratified points, up to those in strips that the plane crosses: at most all
    /// `n` of them, each with a variance of at most 1/4.
    #[test]
    fn stratified_points_follow_the_area() {
        let domain = shapes::torus(1.0, 0.4, 60, 30);
        let points = held_out(&domain, 4000, 0, 7);
        let mean: Vector = points
            .iter()
            .map(|p| p.position(&domain, domain.vertices()).coords)
            .sum::<Vector>()
            / 4000.0;
        assert!(mean.norm() < 4.0 * 1.0 / 4000f64.sqrt());
        let upper = points
            .iter()
            .filter(|p| p.position(&domain, domain.vertices()).z > 0.0)
            .count() as f64;
        assert!((upper - 2000.0).abs() < 4.0 * (4000f64 / 4.0).sqrt());
    }

    #[test]
    fn held_out_points_visit_every_triangle_and_repeat_with_the_seed() {
        let domain = shapes::sphere(1.0, 2);
        let points = held_out(&domain, 10, 10_000, 3);
        assert_eq!(points.len(), 10 + domain.triangles().len());
        assert_eq!(points, held_out(&domain, 10, 10_000, 3));
        assert_ne!(points, held_out(&domain, 10, 10_000, 4));
    }
}
