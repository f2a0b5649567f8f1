//! Whether geodesic triangles cover the sphere once.

use std::cmp::Ordering;

use rayon::prelude::*;

use crate::geometry::{orientation, solid_angle};
use crate::{Point, Vector};

/// Whether a map of a closed, consistently oriented surface to the unit sphere is an embedding.
///
/// Positive triangles make a covering, whose number of sheets is the degree: with degree 1 it is a bijection.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct EmbeddingCheck {
    /// Number of geodesic triangles that are inverted, flat, or have a corner that is not finite; decided exactly for
    /// the directions as given.
    pub flipped: usize,
    /// The first of them.
    pub first_flipped: Option<u32>,
    /// Signed sum of the triangles' solid angles over 4π: how often the sphere is covered, up to rounding.
    pub degree: f64,
}

impl EmbeddingCheck {
    /// Whether no triangle is flipped and the sphere is covered once.
    pub fn is_bijective(&self) -> bool {
        self.flipped == 0 && (self.degree - 1.0).abs() < 0.5
    }
}

/// Checks directions, of any positive length, of the vertices of these triangles.
///
/// # Panics
///
/// When a triangle has a vertex without a direction.
pub fn check_embedding(triangles: &[[u32; 3]], directions: &[Vector]) -> EmbeddingCheck {
    let corners = |t: &[u32; 3]| t.map(|v| Point::from(directions[v as usize]));
    let is_flipped = |t: &[u32; 3]| {
        let [a, b, c] = corners(t);
        orientation(&Point::origin(), &a, &b, &c) != Some(Ordering::Greater)
    };
    let all = (0..triangles.len() as u32).into_par_iter();
    let flipped: Vec<u32> = all.filter(|&t| is_flipped(&triangles[t as usize])).collect();
    // In order, so that the sum is the same for any number of threads.
    let angle = |t: &[u32; 3]| solid_angle(&Point::origin(), &corners(t));
    let angles: Vec<f64> = triangles.par_iter().map(angle).collect();
    EmbeddingCheck {
        flipped: flipped.len(),
        first_flipped: flipped.first().copied(),
        degree: angles.iter().sum::<f64>() / (4.0 * std::f64::consts::PI),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_sphere_covers_itself_once_and_its_mirror_image_is_all_flipped() {
        let sphere = shapes::sphere(1.0, 2);
        let directions: Vec<Vector> = sphere.vertices().iter().map(|p| p.coords).collect();
        let whole = check_embedding(sphere.triangles(), &directions);
        assert!(whole.is_bijective() && (whole.degree - 1.0).abs() < 1e-12, "{whole:?}");
        let mirrored: Vec<Vector> = directions.iter().map(|x| -x).collect();
        let inside_out = check_embedding(sphere.triangles(), &mirrored);
        assert_eq!(inside_out.flipped, sphere.triangles().len());
        assert!((inside_out.degree + 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_vertex_pulled_over_its_ring_flips_triangles_and_keeps_the_degree() {
        let sphere = shapes::sphere(1.0, 2);
        let mut directions: Vec<Vector> = sphere.vertices().iter().map(|p| p.coords).collect();
        directions[20] = (directions[20] + Vector::new(0.5, -0.4, 0.3)).normalize();
        let folded = check_embedding(sphere.triangles(), &directions);
        assert!(folded.flipped > 0 && !folded.is_bijective());
        assert!((folded.degree - 1.0).abs() < 1e-9);
        directions[20].x = f64::NAN;
        assert!(check_embedding(sphere.triangles(), &directions).flipped >= 5);
    }
}
