//! How far apart the vertices of a boundary's image are, which says how large an error is there.

use crate::boundary_map::BoundaryMap;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// Mean length of the image's edges at each vertex, as a fraction of the target's diagonal.
pub(super) struct ImageSpacing(Vec<f64>);

/// Where the image is a single point, it counts as this large.
const LEAST: f64 = 1e-9;

impl ImageSpacing {
    /// The spacing of a boundary map's image, over a target with this diagonal.
    pub fn of(boundary: &BoundaryMap, diagonal: f64) -> Self {
        let image = boundary.image();
        let mut sums = vec![(0.0, 0.0); image.len()];
        for [a, b, c] in boundary.domain().triangles() {
            // An edge inside counts once in each of its two triangles.
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let length = (image[*from as usize] - image[*to as usize]).norm() / diagonal;
                for end in [from, to] {
                    let (sum, count) = &mut sums[*end as usize];
                    *sum += length;
                    *count += 1.0;
                }
            }
        }
        // A vertex without triangles has no edges, and is never asked for.
        Self(
            sums.into_iter()
                .map(|(sum, count)| sum / f64::max(count, 1.0))
                .collect(),
        )
    }

    /// The spacing around a point of the domain's surface: linear between its triangle's vertices.
    pub fn at(&self, domain: &SurfaceMesh, point: &SurfacePoint) -> f64 {
        let corners = domain.triangles()[point.triangle as usize].iter();
        let weighted = corners.zip(point.barycentric).map(|(&v, b)| b * self.0[v as usize]);
        weighted.sum::<f64>().max(LEAST)
    }
}
