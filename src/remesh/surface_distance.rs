//! How far two surfaces are from each other, at points of both.

use crate::geometry::{QueryError, SurfaceQuery};
use crate::mesh::SurfaceMesh;
use crate::{Point, Vector};

/// Distances from one surface to another, as fractions of the target's diagonal.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SurfaceDistances {
    /// Largest, at the vertices and at points half as far from each other as the boundary edges of the mesh are long in the mean.
    /// Between them the distance may be larger, by less than they are apart.
    pub max: f64,
    /// Mean over the area.
    pub mean: f64,
}

/// From the first surface to the second and back, over `diagonal`, at vertices and at points about `spacing` apart.
pub(super) fn distances_both_ways(
    one: &SurfaceMesh,
    other: &SurfaceMesh,
    spacing: f64,
    diagonal: f64,
) -> Result<[SurfaceDistances; 2], QueryError> {
    let there = distances(one, other, spacing, diagonal)?;
    Ok([there, distances(other, one, spacing, diagonal)?])
}

fn distances(
    from: &SurfaceMesh,
    to: &SurfaceMesh,
    spacing: f64,
    diagonal: f64,
) -> Result<SurfaceDistances, QueryError> {
    /// Samples of a surface, about, where the spacing asks for more: a mesh may be squeezed into a small part of a target.
    const MOST_SAMPLES: f64 = 5e5;
    let spacing = spacing.max((from.area() / MOST_SAMPLES).sqrt());
    let mut samples: Vec<(Point, f64)> = Vec::new();
    for t in 0..from.triangles().len() {
        sample(from.corners(t), spacing, &mut samples);
    }
    let inside = samples.len();
    let mut is_used = vec![false; from.vertices().len()];
    from.triangles()
        .as_flattened()
        .iter()
        .for_each(|&v| is_used[v as usize] = true);
    let vertices = from.vertices().iter().zip(is_used).filter(|(_, used)| *used);
    samples.extend(vertices.map(|(p, _)| (*p, 0.0)));
    let points: Vec<Point> = samples.iter().map(|(p, _)| *p).collect();
    let found = SurfaceQuery::with_winding_sign(to)?.closest_points(&points);
    let (mut max, mut sum, mut area) = (0.0f64, 0.0, 0.0);
    for (place, (_, weight)) in found.iter().zip(&samples) {
        // NaN must not be lost.
        max = if max.is_nan() || max > place.distance {
            max
        } else {
            place.distance
        };
        sum += weight * place.distance;
        area += weight;
    }
    // Without any area, the mean over the triangles.
    let mean = match area > 0.0 {
        true => sum / area,
        false => found[..inside].iter().map(|place| place.distance).sum::<f64>() / inside as f64,
    };
    Ok(SurfaceDistances {
        max: max / diagonal,
        mean: mean / diagonal,
    })
}

/// Points of a triangle in rows along its longest side, about `spacing` apart, and the area that each stands for. There are as many as
/// `spacing` squared goes into the area, and `spacing` into the side, at most.
fn sample([a, b, c]: [Point; 3], spacing: f64, samples: &mut Vec<(Point, f64)>) {
    /// Rows, and points of a row, at most.
    const MOST: f64 = 1000.0;
    let count = |length: f64| (length / spacing).ceil().clamp(1.0, MOST);
    let sides = [[a, b, c], [b, c, a], [c, a, b]];
    let length = |[p, q, _]: &[Point; 3]| (q - p).norm();
    let [p, q, apex] = sides
        .into_iter()
        .max_by(|x, y| length(x).total_cmp(&length(y)))
        .unwrap_or([a, b, c]);
    let (base, area) = ((q - p).norm(), 0.5 * (q - p).cross(&(apex - p)).norm());
    let height = if base > 0.0 { 2.0 * area / base } else { 0.0 };
    let rows = count(height);
    for row in 0..rows as usize {
        // The share of the area that is in this row, whose middle is at this height.
        let at = (row as f64 + 0.5) / rows;
        let share = 2.0 * (1.0 - at) / rows;
        let [from, to]: [Vector; 2] = [p, q].map(|end| end.coords * (1.0 - at) + apex.coords * at);
        let columns = count(base * (1.0 - at));
        for column in 0..columns as usize {
            let along = (column as f64 + 0.5) / columns;
            samples.push((Point::from(from + (to - from) * along), area * share / columns));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn samples_weigh_as_much_as_the_triangle() {
        let corners = [
            Point::new(0.0, 0.0, 0.0),
            Point::new(3.0, 0.0, 0.0),
            Point::new(1.0, 2.0, 0.0),
        ];
        for spacing in [10.0, 0.7, 0.05] {
            let mut samples = vec![];
            sample(corners, spacing, &mut samples);
            let sum = |value: &dyn Fn(&Point) -> f64| samples.iter().map(|(p, w)| w * value(p)).sum::<f64>();
            assert!((sum(&|_| 1.0) - 3.0).abs() < 1e-12);
            // The integral of y is the area times that of the centre: the rule is exact along a row, of second order across.
            assert!(
                (sum(&|p| p.y) - 2.0).abs() < 0.6 * spacing.min(2.0).powi(2),
                "{spacing}"
            );
        }
    }

    #[test]
    fn concentric_spheres_are_as_far_apart_as_their_radii_differ() {
        let [small, large] = [1.0, 1.25].map(|radius| shapes::geodesic_sphere(radius, 24));
        let both = distances_both_ways(&small, &large, 0.05, 1.0).unwrap();
        for found in both {
            assert!(
                (found.max - 0.25).abs() < 0.02 && (found.mean - 0.25).abs() < 0.02,
                "{found:?}"
            );
        }
    }

    /// The vertices of a plate lie on the roof over it; what is between them does not.
    #[test]
    fn what_lies_between_vertices_counts() {
        let p = |x: f64, y: f64, z: f64| Point::new(x, y, z);
        let mut vertices = vec![p(0.0, 0.0, 0.0), p(4.0, 0.0, 0.0), p(4.0, 4.0, 0.0), p(0.0, 4.0, 0.0)];
        let plate = SurfaceMesh::new(vertices.clone(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        vertices.push(p(2.0, 2.0, 1.0));
        let roof = SurfaceMesh::new(vertices, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]).unwrap();
        let [from_plate, from_roof] = distances_both_ways(&plate, &roof, 0.1, 1.0).unwrap();
        // The plate's middle is 2/√5 below the sides of the roof, whose own vertex is 1 above the plate.
        assert!((from_plate.max - 2.0 / 5f64.sqrt()).abs() < 0.05, "{from_plate:?}");
        assert_eq!(from_roof.max, 1.0);
        assert!((from_roof.mean - 1.0 / 3.0).abs() < 0.01, "{from_roof:?}");
    }
}
