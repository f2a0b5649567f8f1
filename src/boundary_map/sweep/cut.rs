//! Triangles cut into parts, which see the surface of the target between the images of corners.

use std::collections::HashMap;

use nalgebra::Matrix3x2;

use crate::spherical::RestShape;
use crate::{Point, Vector};

/// A triangle cut into `k × k` parts: barycentric coordinates of their corners, and the corners of each in the order of those of
/// the triangle.
#[derive(Debug, Clone)]
pub(crate) struct Cut {
    pub cuts: usize,
    pub samples: Vec<[f64; 3]>,
    pub parts: Vec<[usize; 3]>,
}

impl Cut {
    pub fn new(cuts: usize) -> Self {
        let (mut samples, mut index) = (Vec::new(), HashMap::new());
        for j in 0..=cuts {
            for i in 0..=cuts - j {
                index.insert((i, j), samples.len());
                samples.push([cuts - i - j, i, j].map(|count| count as f64 / cuts as f64));
            }
        }
        let mut parts = Vec::new();
        for j in 0..cuts {
            for i in 0..cuts - j {
                parts.push([(i, j), (i + 1, j), (i, j + 1)].map(|at| index[&at]));
                if i + j + 2 <= cuts {
                    parts.push([(i + 1, j + 1), (i, j + 1), (i + 1, j)].map(|at| index[&at]));
                }
            }
        }
        Self { cuts, samples, parts }
    }

    /// The rest shape of a part.
    pub fn part_of(&self, rest: &RestShape) -> RestShape {
        RestShape {
            area: rest.area / (self.cuts * self.cuts) as f64,
            ..*rest
        }
    }
}

/// The derivative of the linear map from a triangle in the plane to these images, times the area of the triangle, and that area;
/// both doubled.
pub(crate) fn secant(places: [&Vector; 3], images: [&Point; 3]) -> (Matrix3x2<f64>, f64) {
    let (p, q) = (places[1] - places[0], places[2] - places[0]);
    let (y, z) = (images[1] - images[0], images[2] - images[0]);
    let slope = Matrix3x2::from_columns(&[y * q.y - z * p.y, z * p.x - y * q.x]);
    (slope, p.x * q.y - p.y * q.x)
}
