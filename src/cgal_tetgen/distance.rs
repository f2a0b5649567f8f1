use std::sync::Arc;

use rayon::prelude::*;

use super::bridge::ffi;
use super::calls::check_outcome;
use super::error::{CallFailure, CgalTetgenError};
use super::input::{check_closed, check_numbers, flat, points};
use super::worker::{Connection, Message, Operation, connection};
use crate::Point;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// Points per call into C++, and per task.
const CHUNK: usize = 512;

/// Coordinates beyond this would overflow when squared.
const FAR: f64 = 1e100;

/// The signed distance to a closed surface: negative inside, positive outside.
///
/// The closest point comes from an AABB tree, the sign from counting the triangles that a ray crosses (even-odd,
/// exact), so the orientation of the triangles does not matter.
pub struct SignedDistanceField(Location);

/// Where the AABB tree lives.
enum Location {
    InProcess(LocalField),
    InWorker(RemoteField),
}

impl SignedDistanceField {
    /// The distance to `surface`. Builds the tree: about 2 µs per triangle.
    ///
    /// # Errors
    ///
    /// [`CgalTetgenError::InvalidInput`] when the surface is empty, not finite or open, so that it has no inside;
    /// [`CgalTetgenError::Cgal`] when all its triangles are degenerate.
    pub fn new(surface: &SurfaceMesh) -> Result<Self, CgalTetgenError> {
        check_numbers(surface)?;
        check_closed(&Topology::new(surface))?;
        Ok(Self(match connection() {
            None => Location::InProcess(LocalField::new(surface)?),
            Some(connection) => Location::InWorker(RemoteField::new(connection, surface)?),
        }))
    }

    /// Signed distances of `points`, in model units: negative inside. NaN for points with a NaN coordinate, or when
    /// CGAL fails. Uses all of rayon's threads.
    pub fn distance(&self, points: &[Point]) -> Vec<f64> {
        self.try_distance(points)
            .unwrap_or_else(|_| vec![f64::NAN; points.len()])
    }

    /// The closest points of the surface. A point with a NaN coordinate is returned as it is; one with a coordinate
    /// beyond 1e100 gets the point closest to the centre of the bounding box. NaN when CGAL fails.
    pub fn closest_points(&self, points: &[Point]) -> Vec<Point> {
        let nowhere = || vec![Point::from([f64::NAN; 3]); points.len()];
        self.try_closest_points(points).unwrap_or_else(|_| nowhere())
    }

    /// The volume that the surface encloses, by CGAL; positive when its triangles face outward.
    ///
    /// # Errors
    ///
    /// [`CgalTetgenError::Cgal`] when CGAL fails.
    pub fn volume(&self) -> Result<f64, CgalTetgenError> {
        match &self.0 {
            Location::InProcess(field) => Ok(field.volume()?),
            Location::InWorker(field) => Ok(field.query(Operation::Volume, Vec::new(), 1)?[0]),
        }
    }

    /// [`Self::distance`], or why the worker failed.
    pub(super) fn try_distance(&self, points: &[Point]) -> Result<Vec<f64>, CgalTetgenError> {
        match &self.0 {
            Location::InProcess(field) => Ok(field.distance(points)),
            Location::InWorker(field) => field.query(Operation::Distance, flat(points), points.len()),
        }
    }

    /// [`Self::closest_points`], or why the worker failed.
    pub(super) fn try_closest_points(&self, sought: &[Point]) -> Result<Vec<Point>, CgalTetgenError> {
        match &self.0 {
            Location::InProcess(field) => Ok(field.closest_points(sought)),
            Location::InWorker(field) => {
                let found = field.query(Operation::Closest, flat(sought), 3 * sought.len())?;
                Ok(points(&found))
            }
        }
    }
}

/// A field in a worker, lost when the worker ends.
struct RemoteField {
    connection: Arc<Connection>,
    worker: u64,
    field: u32,
}

impl RemoteField {
    fn new(connection: Arc<Connection>, surface: &SurfaceMesh) -> Result<Self, CgalTetgenError> {
        let request = Message {
            reals: flat(surface.vertices()),
            integers: surface.triangles().as_flattened().to_vec(),
            ..Message::default()
        };
        let (reply, worker) = connection.call(Operation::NewField, None, request)?;
        let field = reply.integers.first().copied();
        let field = field.ok_or_else(|| CgalTetgenError::Unknown("the worker made no field".into()))?;
        Ok(Self {
            connection,
            worker,
            field,
        })
    }

    fn call(&self, operation: Operation, reals: Vec<f64>) -> Result<Vec<f64>, CgalTetgenError> {
        let request = Message {
            reals,
            integers: vec![self.field],
            ..Message::default()
        };
        let (reply, _) = self.connection.call(operation, Some(self.worker), request)?;
        Ok(reply.reals)
    }

    /// The reply must have `count` values.
    fn query(&self, operation: Operation, reals: Vec<f64>, count: usize) -> Result<Vec<f64>, CgalTetgenError> {
        let found = self.call(operation, reals)?;
        let fits = found.len() == count;
        fits.then_some(found)
            .ok_or_else(|| CgalTetgenError::Unknown("the worker's reply has the wrong length".into()))
    }
}

impl Drop for RemoteField {
    fn drop(&mut self) {
        // Where the worker has ended, the field has too.
        let _ = self.call(Operation::DropField, Vec::new());
    }
}

/// A field in this process.
pub(super) struct LocalField {
    field: cxx::UniquePtr<ffi::DistanceField>,
    centre: Point,
}

// SAFETY: the C++ object is complete when its constructor returns (the trees are built there), all its queries are
// const, and it refers to nothing outside itself.
unsafe impl Send for LocalField {}
// SAFETY: as above; const queries of CGAL's AABB tree do not write once the trees are built.
unsafe impl Sync for LocalField {}

impl LocalField {
    /// `surface` must have been checked.
    pub fn new(surface: &SurfaceMesh) -> Result<Self, CallFailure> {
        let mut outcome = ffi::Outcome {
            code: 0,
            message: String::new(),
        };
        let triangles = surface.triangles().as_flattened();
        let field = ffi::new_distance_field(&flat(surface.vertices()), triangles, &mut outcome);
        check_outcome(outcome)?;
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
    pub fn volume(&self) -> Result<f64, CallFailure> {
        let mut volume = f64::NAN;
        check_outcome(ffi::enclosed_volume(&self.field, &mut volume))?;
        Ok(volume)
    }

    fn distance_of_chunk(&self, chunk: &[Point]) -> Vec<f64> {
        let mut inside = vec![0u8; chunk.len()];
        let safe = self.within_reach(chunk);
        let known = check_outcome(ffi::points_inside(&self.field, &safe, &mut inside)).is_ok();
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
        let known = check_outcome(ffi::closest_points(&self.field, &safe, &mut closest)).is_ok();
        let nan = Point::from([f64::NAN; 3]);
        let answer = |(p, c): (&Point, Point)| match () {
            () if p.iter().any(|x| x.is_nan()) => *p,
            () if known => c,
            () => nan,
        };
        chunk.iter().zip(points(&closest)).map(answer).collect()
    }

    /// Coordinates that CGAL can work with: points that are not finite or too far are replaced by the model's centre.
    fn within_reach(&self, chunk: &[Point]) -> Vec<f64> {
        let reachable = |p: &Point| p.iter().all(|c| c.abs() < FAR);
        let safe = chunk.iter().map(|p| if reachable(p) { *p } else { self.centre });
        flat(&safe.collect::<Vec<_>>())
    }
}
