//! A boundary map given by a function of surface points.

use std::fmt;
use std::sync::Arc;

use rayon::prelude::*;

use super::composition::before_subdivision;
use crate::Point;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// A function of the points of a surface, which may have been subdivided since, and the box that is
/// used in place of the target's bounding box.
#[derive(Clone)]
pub(super) struct PointFunction {
    image: Arc<dyn Fn(&SurfacePoint) -> Point + Send + Sync>,
    target_box: (Point, Point),
    subdivisions: u32,
}

impl PointFunction {
    pub fn new(image: impl Fn(&SurfacePoint) -> Point + Send + Sync + 'static, target_box: (Point, Point)) -> Self {
        Self {
            image: Arc::new(image),
            target_box,
            subdivisions: 0,
        }
    }

    pub fn target_box(&self) -> (Point, Point) {
        self.target_box
    }

    pub fn image(&self, point: &SurfacePoint) -> Point {
        (self.image)(&before_subdivision(point, self.subdivisions))
    }

    /// Images of all vertices, each as a corner of its first triangle; a corner of the box for vertices without
    /// triangles.
    pub fn images_of_vertices(&self, domain: &SurfaceMesh) -> Vec<Point> {
        let mut places = vec![None; domain.vertices().len()];
        for (t, corners) in domain.triangles().iter().enumerate() {
            for (k, &v) in corners.iter().enumerate() {
                places[v as usize].get_or_insert_with(|| SurfacePoint::corner(t as u32, k));
            }
        }
        let image = |place: &Option<SurfacePoint>| place.as_ref().map_or(self.target_box.0, |p| self.image(p));
        places.par_iter().with_min_len(256).map(image).collect()
    }

    /// The same function over a domain whose triangles are each cut into four.
    pub fn subdivided(&self) -> Self {
        Self {
            subdivisions: self.subdivisions + 1,
            ..self.clone()
        }
    }
}

impl fmt::Debug for PointFunction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PointFunction")
            .field("target_box", &self.target_box)
            .field("subdivisions", &self.subdivisions)
            .finish_non_exhaustive()
    }
}

/// Equal if they are the same closure.
impl PartialEq for PointFunction {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.image, &other.image)
            && (self.target_box, self.subdivisions) == (other.target_box, other.subdivisions)
    }
}
