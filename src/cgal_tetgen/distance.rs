use std::sync::Arc;

use rayon::prelude::*;

use super::bridge::ffi;
use super::calls::done;
use super::error::{CgalTetgenError, Failed};
use super::input::{check_closed, check_numbers, flat, points};
use super::worker::{Frame, Line, Operation, line};
use crate::Point;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// Queries per call into C++, and per task.
const CHUNK: usize = 512;

/// Beyond this coordinates' squares lose meaning, and a model is a point.
const FAR: f64 = 1e100;

/// The signed distance to a closed surface: negative inside, positive outside.
///
/// The closest point comes from an AABB tree, the sign from counting the triangles that a ray meets (even-odd, exact),
/// so the orientation of the triangles does not matter.
pub struct SignedDistanceField(Home);

/// Where the trees are.
enum Home {
    Here(LocalField),
    There(RemoteField),
}

impl SignedDistanceField {
    /// The distance to `surface`. Builds the trees: about 2 µs a triangle.
    ///
    /// # Errors
    ///
    /// [`CgalTetgenError::InvalidInput`] when the surface is empty, not finite or open, so that it has no inside;
    /// [`CgalTetgenError::Cgal`] when all its triangles are degenerate.
    pub fn new(surface: &SurfaceMesh) -> Result<Self, CgalTetgenError> {
        check_numbers(surface)?;
        check_closed(&Topology::new(surface))?;
        Ok(Self(match line() {
            None => Home::Here(LocalField::new(surface)?),
            Some(line) => Home::There(RemoteField::new(line, surface)?),
        }))
    }

    /// Signed distances of `points`, in model units: negative inside. Not a number where a coordinate is not, or where
    /// there is no answer. Runs on all of rayon's threads.
    pub fn distance(&self, points: &[Point]) -> Vec<f64> {
        self.try_distance(points)
            .unwrap_or_else(|_| vec![f64::NAN; points.len()])
    }

    /// The closest points of the surface; a point without finite coordinates is returned as it is.
    pub fn closest_points(&self, points: &[Point]) -> Vec<Point> {
        let nowhere = || vec![Point::from([f64::NAN; 3]); points.len()];
        self.try_closest_points(points).unwrap_or_else(|_| nowhere())
    }

    /// The volume that the surface encloses by CGAL's count, positive when its triangles face outward.
    ///
    /// # Errors
    ///
    /// [`CgalTetgenError::Cgal`] when CGAL cannot tell.
    pub fn volume(&self) -> Result<f64, CgalTetgenError> {
        match &self.0 {
            Home::Here(field) => Ok(field.volume()?),
            Home::There(field) => {
                let answer = field.ask(Operation::Volume, Vec::new(), 1)?;
                Ok(answer[0])
            }
        }
    }

    /// [`Self::distance`], or why the worker cannot tell.
    pub(super) fn try_distance(&self, points: &[Point]) -> Result<Vec<f64>, CgalTetgenError> {
        match &self.0 {
            Home::Here(field) => Ok(field.distance(points)),
            Home::There(field) => field.ask(Operation::Distance, flat(points), points.len()),
        }
    }

    /// [`Self::closest_points`], or why the worker cannot tell.
    pub(super) fn try_closest_points(&self, sought: &[Point]) -> Result<Vec<Point>, CgalTetgenError> {
        match &self.0 {
            Home::Here(field) => Ok(field.closest_points(sought)),
            Home::There(field) => Ok(points(&field.ask(
                Operation::Closest,
                flat(sought),
                3 * sought.len(),
            )?)),
        }
    }
}

/// A field in a worker, which lives as long as that does.
struct RemoteField {
    line: Arc<Line>,
    worker: u64,
    number: u32,
}

impl RemoteField {
    fn new(line: Arc<Line>, surface: &SurfaceMesh) -> Result<Self, CgalTetgenError> {
        let request = Frame {
            reals: flat(surface.vertices()),
            integers: surface.triangles().as_flattened().to_vec(),
            ..Frame::default()
        };
        let answer = line.call(Operation::NewField, None, request)?;
        let number = answer.frame.integers.first().copied();
        let number = number.ok_or_else(|| CgalTetgenError::Unknown("the worker made no field".into()))?;
        Ok(Self {
            line,
            worker: answer.worker,
            number,
        })
    }

    /// So many numbers.
    fn ask(&self, operation: Operation, reals: Vec<f64>, count: usize) -> Result<Vec<f64>, CgalTetgenError> {
        let request = Frame {
            reals,
            integers: vec![self.number],
            ..Frame::default()
        };
        let answer = self.line.call(operation, Some(self.worker), request)?.frame.reals;
        match answer.len() == count {
            true => Ok(answer),
            false => Err(CgalTetgenError::Unknown(
                "the worker's answer has another length".into(),
            )),
        }
    }
}

impl Drop for RemoteField {
    fn drop(&mut self) {
        self.line.drop_field(self.worker, self.number);
    }
}

/// A field in this process.
pub(super) struct LocalField {
    field: cxx::UniquePtr<ffi::DistanceField>,
    centre: Point,
}

// SAFETY: the C++ object is complete when its constructor returns (both trees are built there), all its queries are
// const, and it refers to nothing outside itself.
unsafe impl Send for LocalField {}
// SAFETY: as above; const queries of CGAL's AABB tree do not write once the trees are built.
unsafe impl Sync for LocalField {}

impl LocalField {
    /// Of a surface that has been checked.
    pub fn new(surface: &SurfaceMesh) -> Result<Self, Failed> {
        let mut outcome = ffi::Outcome {
            code: 0,
            message: String::new(),
        };
        let triangles = surface.triangles().as_flattened();
        let field = ffi::new_distance_field(&flat(surface.vertices()), triangles, &mut outcome);
        done(outcome)?;
        let (low, high) = surface.bounding_box().unwrap_or_default();
        let centre = nalgebra::center(&low, &high);
        Ok(Self { field, centre })
    }

    /// See [`SignedDistanceField::distance`].
    pub fn distance(&self, points: &[Point]) -> Vec<f64> {
        let chunks = points.par_chunks(CHUNK).map(|chunk| self.distance_of_chunk(chunk));
        chunks.flatten_iter().collect()
    }

    /// See [`SignedDistanceField::closest_points`].
    pub fn closest_points(&self, points: &[Point]) -> Vec<Point> {
        let chunks = points.par_chunks(CHUNK).map(|chunk| self.closest_of_chunk(chunk));
        chunks.flatten_iter().collect()
    }

    /// See [`SignedDistanceField::volume`].
    pub fn volume(&self) -> Result<f64, Failed> {
        let mut volume = f64::NAN;
        done(ffi::enclosed_volume(&self.field, &mut volume))?;
        Ok(volume)
    }

    fn distance_of_chunk(&self, chunk: &[Point]) -> Vec<f64> {
        let mut inside = vec![0u8; chunk.len()];
        let safe = self.within_reach(chunk);
        let known = done(ffi::points_inside(&self.field, &safe, &mut inside)).is_ok();
        let closest = self.closest_of_chunk(chunk);
        let signed = |((p, c), &inside): ((&Point, &Point), &u8)| match () {
            () if !known => f64::NAN,
            () if inside != 0 => -(p - c).norm(),
            () => (p - c).norm(),
        };
        chunk.iter().zip(&closest).zip(&inside).map(signed).collect()
    }

    fn closest_of_chunk(&self, chunk: &[Point]) -> Vec<Point> {
        let safe = self.within_reach(chunk);
        let mut closest = safe.clone();
        let known = done(ffi::closest_points(&self.field, &safe, &mut closest)).is_ok();
        let nan = Point::from([f64::NAN; 3]);
        let answer = |(p, c): (&Point, Point)| match () {
            () if p.iter().any(|x| x.is_nan()) => *p,
            () if known => c,
            () => nan,
        };
        chunk.iter().zip(points(&closest)).map(answer).collect()
    }

    /// Coordinates that CGAL can work with: the model's centre stands in for points that are nowhere or too far.
    fn within_reach(&self, chunk: &[Point]) -> Vec<f64> {
        let reachable = |p: &Point| p.iter().all(|c| c.abs() < FAR);
        let safe: Vec<Point> = chunk
            .iter()
            .map(|p| if reachable(p) { *p } else { self.centre })
            .collect();
        flat(&safe)
    }
}
