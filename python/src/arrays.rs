//! Arrays of numpy as points, and back, without copies where that is possible.

use numpy::ndarray::{ArrayView2, ArrayView3};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods, ToPyArray,
};
use pyo3::prelude::*;
use solidmap::{Matrix3, Point};

use crate::error::Failure;

/// A point is three doubles and nothing else, by `repr(C)` and `repr(transparent)` at every level.
const _: () = assert!(size_of::<Point>() == 3 * size_of::<f64>() && align_of::<Point>() == align_of::<f64>());
/// So is a matrix nine, column by column.
const _: () = assert!(size_of::<Matrix3>() == 9 * size_of::<f64>() && align_of::<Matrix3>() == align_of::<f64>());

/// The points of an array of `n × 3` doubles in C order. It is kept alive, and not copied, while other threads read it.
pub struct Points {
    _array: Py<PyArray2<f64>>,
    first: *const Point,
    count: usize,
}

// SAFETY: the memory is the array's, which lives as long; nothing here writes to it. As with every function of numpy that
// works without Python's lock, what a program writes to the array meanwhile may or may not be seen.
unsafe impl Send for Points {}
unsafe impl Sync for Points {}

impl Points {
    /// `name` is the argument's, for messages.
    pub fn of(name: &str, array: &PyReadonlyArray2<'_, f64>) -> Result<Self, Failure> {
        let slice = rows::<f64, 3>(name, array)?;
        Ok(Self {
            _array: (**array).clone().unbind(),
            first: slice.as_ptr().cast(),
            count: slice.len(),
        })
    }
}

impl std::ops::Deref for Points {
    type Target = [Point];

    fn deref(&self) -> &[Point] {
        // SAFETY: see above; an array without rows has a dangling, aligned pointer, as slices do.
        unsafe { std::slice::from_raw_parts(self.first, self.count) }
    }
}

/// The rows of an array in C order.
pub fn rows<'a, T: numpy::Element, const N: usize>(
    name: &str,
    array: &'a PyReadonlyArray2<'_, T>,
) -> Result<&'a [[T; N]], Failure> {
    if array.shape()[1] != N {
        let [rows, columns] = [array.shape()[0], array.shape()[1]];
        return Err(Failure::invalid(format!(
            "{name} has the shape ({rows}, {columns}), but must be (n, {N})"
        )));
    }
    let is_aligned = array.data().cast_const().is_aligned();
    let slice = array.as_slice().ok().filter(|_| array.is_c_contiguous() && is_aligned);
    let slice = slice.ok_or_else(|| Failure::invalid(format!("{name} is not in C order, or not aligned")))?;
    Ok(slice.as_chunks::<N>().0)
}

/// The entries of an array.
pub fn entries<T: numpy::Element + Clone>(name: &str, array: &PyReadonlyArray1<'_, T>) -> Result<Vec<T>, Failure> {
    let slice = array
        .as_slice()
        .map_err(|_| Failure::invalid(format!("{name} is not in C order")))?;
    Ok(slice.to_vec())
}

/// A vector of arrays as a vector of their entries, in the same memory.
fn flat<T, const N: usize>(rows: Vec<T>) -> Vec<f64> {
    const { assert!(size_of::<T>() == N * size_of::<f64>() && align_of::<T>() == align_of::<f64>()) };
    let mut rows = std::mem::ManuallyDrop::new(rows);
    let (first, length, capacity) = (rows.as_mut_ptr(), rows.len(), rows.capacity());
    // SAFETY: size and alignment are checked above, so that the allocation is one of `N * capacity` doubles.
    unsafe { Vec::from_raw_parts(first.cast(), N * length, N * capacity) }
}

/// Points as an array of `n × 3`, which takes their memory over.
pub fn from_points(py: Python<'_>, points: Vec<Point>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let count = points.len();
    PyArray1::from_vec(py, flat::<Point, 3>(points)).reshape([count, 3])
}

/// Matrices as an array of `n × 3 × 3`, row by row, in their own memory.
pub fn from_matrices(py: Python<'_>, mut matrices: Vec<Matrix3>) -> PyResult<Bound<'_, PyArray3<f64>>> {
    // Matrices are stored by columns.
    matrices.iter_mut().for_each(Matrix3::transpose_mut);
    let count = matrices.len();
    PyArray1::from_vec(py, flat::<Matrix3, 9>(matrices)).reshape([count, 3, 3])
}

/// A copy of points as an array.
pub fn copy_of_points<'py>(py: Python<'py>, points: &[Point]) -> Bound<'py, PyArray2<f64>> {
    // SAFETY: see the assertion at the top.
    let flat = unsafe { std::slice::from_raw_parts(points.as_ptr().cast::<f64>(), 3 * points.len()) };
    let view = ArrayView2::from_shape((points.len(), 3), flat).expect("three coordinates for each point");
    view.to_pyarray(py)
}

/// A copy of rows as an array.
pub fn copy_of_rows<'py, T: numpy::Element + Copy, const N: usize>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> Bound<'py, PyArray2<T>> {
    let view = ArrayView2::from_shape((rows.len(), N), rows.as_flattened()).expect("N entries in each row");
    view.to_pyarray(py)
}

/// A copy of pairs of coordinates at the corners of triangles.
pub fn copy_of_corners<'py>(py: Python<'py>, corners: &[[[f64; 2]; 3]]) -> Bound<'py, PyArray3<f64>> {
    let flat = corners.as_flattened().as_flattened();
    let view = ArrayView3::from_shape((corners.len(), 3, 2), flat).expect("six entries for each triangle");
    view.to_pyarray(py)
}
