//! Where a function takes the points of a surface.

use std::fmt;
use std::sync::Arc;

use rayon::prelude::*;

use super::composition::undivided;
use crate::Point;
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// A function of the points of a surface that may have been subdivided since, and the box that its values are measured by.
#[derive(Clone)]
pub(super) struct Function {
    image: Arc<dyn Fn(&SurfacePoint) -> Point + Send + Sync>,
    target_box: (Point, Point),
    subdivisions: u32,
}

impl Function {
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
        (self.image)(&undivided(point, self.subdivisions))
    }

    /// Images of all vertices, each asked for at a corner of a triangle; a corner of the box for those without one.
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

impl fmt::Debug for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Function")
            .field("target_box", &self.target_box)
            .field("subdivisions", &self.subdivisions)
            .finish_non_exhaustive()
    }
}

/// Functions are equal when they are the same one.
impl PartialEq for Function {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.image, &other.image)
            && (self.target_box, self.subdivisions) == (other.target_box, other.subdivisions)
    }
}
