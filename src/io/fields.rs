//! Fields on a mesh.

use std::path::Path;

use super::{Cells, IoError};
use crate::Point;

/// Values at the points or in the cells of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// The name shown by viewers.
    pub name: String,
    /// Values per point or cell: 1 for a scalar, 3 for a vector, 9 for a matrix in row-major order.
    pub components: usize,
    /// `n × components`, row-major.
    pub values: Vec<f64>,
}

impl Field {
    /// A field of one component.
    pub fn scalar(name: &str, values: Vec<f64>) -> Self {
        Self {
            name: name.into(),
            components: 1,
            values,
        }
    }

    /// A field of points.
    pub fn positions(name: &str, points: &[Point]) -> Self {
        Self {
            name: name.into(),
            components: 3,
            values: points.iter().flat_map(|p| [p.x, p.y, p.z]).collect(),
        }
    }
}

/// The fields of a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VtkFields {
    /// Fields with values at the points.
    pub point: Vec<Field>,
    /// Fields with values in the cells.
    pub cell: Vec<Field>,
    /// Where the data come from, written to the head of the file.
    pub comment: String,
}

/// Refuses cells with missing points and fields of the wrong length: viewers crash on such files.
pub(super) fn check(path: &Path, points: &[Point], cells: Cells, fields: &VtkFields) -> Result<(), IoError> {
    let missing = |v: &&u32| **v as usize >= points.len();
    for (index, cell) in cells.iter().enumerate() {
        if let Some(&vertex) = cell.iter().find(missing) {
            return Err(IoError::IndexOutOfRange {
                path: path.to_owned(),
                element: cells.name(),
                index,
                vertex: i64::from(vertex),
                vertices: points.len(),
                base: 0,
            });
        }
    }
    let point_fields = fields.point.iter().map(|field| (field, points.len()));
    let cell_fields = fields.cell.iter().map(|field| (field, cells.count()));
    for (field, count) in point_fields.chain(cell_fields) {
        let expected = count.saturating_mul(field.components);
        if field.values.len() != expected {
            return Err(IoError::value_count(path, &field.name, expected, field.values.len()));
        }
    }
    Ok(())
}
