//! A map sampled at the nodes of a lattice over its domain: what a page cuts anywhere.
//!
//! A page draws cuts through the domain by interpolation between the eight nodes of a lattice cell, so that nodes outside the
//! domain are needed too, up to one cell away. A map need not be defined there: its image is continued linearly from the
//! nearest point of the boundary, and its values are those of a point just inside.

use solidmap::geometry::{QueryError, SurfaceQuery};
use solidmap::map::VolumeMap;
use solidmap::mesh::SurfaceMesh;
use solidmap::{Matrix3, Point};

/// A lattice of cubes over a box; `x` runs fastest in the order of the nodes.
#[derive(Debug, Clone)]
pub struct Lattice {
    /// The first node.
    pub low: Point,
    /// Distance between neighbours.
    pub step: f64,
    /// Nodes along each axis.
    pub counts: [usize; 3],
}

impl Lattice {
    /// As many cubes along the longest side of the solid's box as asked for.
    pub fn over(solid: &SurfaceMesh, cells: usize) -> Self {
        let (low, high) = solid.bounding_box().unwrap_or_default();
        let extent = high - low;
        let step = extent.amax() / cells as f64;
        let counts = [0, 1, 2].map(|k| ((extent[k] / step - 1e-9).ceil() as usize).max(1) + 1);
        let beyond = |k: usize| ((counts[k] - 1) as f64 * step - extent[k]) / 2.0;
        let low = Point::new(low.x - beyond(0), low.y - beyond(1), low.z - beyond(2));
        Self { low, step, counts }
    }

    /// How many nodes there are.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    fn nodes(&self) -> Vec<Point> {
        let [nx, ny, _] = self.counts;
        let at = |k: usize, i: usize| self.low[k] + i as f64 * self.step;
        (0..self.len())
            .map(|n| Point::new(at(0, n % nx), at(1, n / nx % ny), at(2, n / (nx * ny))))
            .collect()
    }
}

/// The images and Jacobians of the nodes in the domain, and of those near it.
pub struct LatticeSamples {
    /// Where the nodes are.
    pub lattice: Lattice,
    /// The nodes that have samples, in order.
    pub nodes: Vec<usize>,
    /// Whether each of them is inside the domain.
    pub is_inside: Vec<bool>,
    /// Where values are sampled: the nodes, for those outside a point just inside.
    pub points: Vec<Point>,
    /// Their images.
    pub images: Vec<Point>,
    /// Jacobians at the nodes, for those outside at a point just inside.
    pub jacobians: Vec<Matrix3>,
}

impl LatticeSamples {
    /// Samples a map.
    ///
    /// # Errors
    ///
    /// When the domain cannot be searched.
    pub fn of(map: &dyn VolumeMap, domain: &SurfaceMesh, cells: usize) -> Result<Self, QueryError> {
        let lattice = Lattice::over(domain, cells);
        let all = lattice.nodes();
        let query = SurfaceQuery::new(domain)?;
        let distances = query.signed_distances(&all);
        // The farthest corners of a cube that the domain touches.
        let reach = lattice.step * 3f64.sqrt();
        let nodes: Vec<usize> = (0..all.len()).filter(|&n| distances[n] <= reach).collect();
        let is_inside: Vec<bool> = nodes.iter().map(|&n| distances[n] <= 0.0).collect();
        let sampled = |(&n, &inside): (&usize, &bool)| {
            if inside {
                all[n]
            } else {
                just_inside(&query, &all[n], lattice.step)
            }
        };
        let points: Vec<Point> = nodes.iter().zip(&is_inside).map(sampled).collect();
        let (mut images, jacobians) = map.evaluate_with_jacobian(&points);
        for (k, image) in images.iter_mut().enumerate() {
            *image += jacobians[k] * (all[nodes[k]] - points[k]);
        }
        Ok(Self {
            lattice,
            nodes,
            is_inside,
            points,
            images,
            jacobians,
        })
    }

    /// Values of the sampled nodes as values of all, NaN elsewhere.
    pub fn spread(&self, values: impl IntoIterator<Item = f64>) -> Vec<f64> {
        let mut all = vec![f64::NAN; self.lattice.len()];
        for (&node, value) in self.nodes.iter().zip(values) {
            all[node] = value;
        }
        all
    }
}

/// A point inside, half a step behind the nearest point of the boundary; that point itself where the solid is thinner.
fn just_inside(query: &SurfaceQuery, outside: &Point, step: f64) -> Point {
    let nearest = query.closest_point(outside).point;
    let inward = (nearest - outside).try_normalize(0.0).unwrap_or_default();
    let behind = nearest + inward * (step / 2.0);
    if query.contains(&behind) { behind } else { nearest }
}

#[cfg(test)]
mod tests {
    use solidmap::mesh::shapes;

    use super::*;

    /// Affine, and nowhere defined outside the unit ball.
    struct InBall(Matrix3);

    impl VolumeMap for InBall {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            let image = |p: &Point| {
                if p.coords.norm() > 1.0 + 1e-9 {
                    Point::new(f64::NAN, 0.0, 0.0)
                } else {
                    self.0 * p
                }
            };
            points.iter().map(image).collect()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            vec![self.0; points.len()]
        }
    }

    #[test]
    fn nodes_outside_continue_the_map_and_every_cell_that_the_domain_touches_has_eight() {
        let ball = shapes::sphere(1.0, 3);
        let map = InBall(Matrix3::new(2.0, 0.1, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.5));
        let samples = LatticeSamples::of(&map, &ball, 16).unwrap();
        let nodes = samples.lattice.nodes();
        for (&node, image) in samples.nodes.iter().zip(&samples.images) {
            assert!((image - map.0 * nodes[node]).norm() < 1e-12, "{node}");
        }
        assert_eq!(samples.lattice.counts, [17; 3]);
        let has: Vec<bool> = samples
            .spread(samples.nodes.iter().map(|_| 1.0))
            .iter()
            .map(|x| *x == 1.0)
            .collect();
        let query = SurfaceQuery::new(&ball).unwrap();
        for k in 0..1000 {
            let at = |n: usize| 2.0 * ((k * n) as f64 * 0.618).fract() - 1.0;
            let point = Point::new(at(1), at(7), at(13));
            if query.contains(&point) {
                let cell = (point - samples.lattice.low) / samples.lattice.step;
                let [i, j, l] = [0, 1, 2].map(|a| cell[a].floor() as usize);
                for corner in 0..8 {
                    let node = i + (corner & 1) + 17 * (j + (corner >> 1 & 1) + 17 * (l + (corner >> 2)));
                    assert!(has[node], "{point}");
                }
            }
        }
    }
}
