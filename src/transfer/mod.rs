//! Transfer of fields from the domain of a map to its target: Li, Guo, Wang, He, Gu & Qin, *Harmonic volumetric mapping
//! for solid modeling applications* (2007), section 5.1.
//!
//! [`push_forward`] maps the points or the mesh that a field is given on, and is exact at the nodes. [`resample`]
//! evaluates a field at given points of the target, by the inverse map and linear interpolation. [`volume_check`] and
//! [`distribution_check`] measure how the map changes volumes, and with them the distribution of a field's values.

mod checks;
mod sampler;

use crate::inverse::{Inverse, InverseReport, Preimage};
use crate::map::VolumeMap;
use crate::mesh::CellList;
use crate::{Matrix3, Point, Vector};

pub use checks::{
    DistributionCheck, LabelShare, ValueDistribution, VolumeCheck, distribution_check, label_shares, volume_check,
};
pub use sampler::FieldSampler;

/// How the values of a field are transferred.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FieldKind {
    /// Unchanged, and linear between nodes.
    Values,
    /// Vectors that are pushed forward, `J v`: velocities, fibres, directions that move with the material.
    Vector,
    /// Labels, unchanged and never averaged: between nodes that of the corner with the largest weight.
    Label,
}

/// A field with a value for every point or every cell.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferField {
    /// Its name.
    pub name: String,
    /// Components of a value.
    pub components: usize,
    /// `n × components`, row-major.
    pub values: Vec<f64>,
    /// How it is transferred.
    pub kind: FieldKind,
}

/// Points with fields, and tetrahedra or hexahedra over them, if any.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldMesh {
    /// The points, in the domain or in the target.
    pub points: Vec<Point>,
    /// Cells over the points; may be empty.
    pub cells: CellList,
    /// Fields over the points.
    pub point_fields: Vec<TransferField>,
    /// Fields over the cells.
    pub cell_fields: Vec<TransferField>,
}

/// Why a field cannot be transferred.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError {
    /// A field does not have a value for each point or cell.
    #[error("the field `{name}` has {found} entries, but {expected} are needed for {count} {element}")]
    ValueCount {
        /// Name of the field.
        name: String,
        /// Points, tetrahedra or hexahedra.
        element: &'static str,
        /// Number of them.
        count: usize,
        /// Entries that they need.
        expected: usize,
        /// Entries that there are.
        found: usize,
    },
    /// The values of a vector field do not have three components.
    #[error("the field `{name}` has {components} components, but a vector that is pushed forward has 3")]
    NotAVector {
        /// Name of the field.
        name: String,
        /// Its components.
        components: usize,
    },
    /// A cell refers to a point that is not there.
    #[error("{element} {cell} names point {point}, but there are only {points} points")]
    IndexOutOfRange {
        /// `"tetrahedron"` or `"hexahedron"`.
        element: &'static str,
        /// The cell.
        cell: usize,
        /// The point.
        point: u32,
        /// How many points there are.
        points: usize,
    },
    /// No point of the field mesh has finite coordinates.
    #[error("none of the points that carry the fields has finite coordinates")]
    Empty,
}

/// Fields at points of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct ResampledFields {
    /// The fields over points, then those over cells; NaN at points without preimage.
    pub fields: Vec<TransferField>,
    /// Preimages of the points.
    pub preimages: Vec<Preimage>,
    /// Report of the inverse map.
    pub inverse: InverseReport,
    /// Preimages outside the cells, which got the value at the closest point of their boundary; 0 without cells.
    pub outside_mesh: usize,
}

impl FieldMesh {
    /// Checks that indices are in range and that the counts fit.
    ///
    /// # Errors
    ///
    /// [`TransferError`] for the first that does not.
    pub fn check(&self) -> Result<(), TransferError> {
        for (cell, corners) in self.cells.iter().enumerate() {
            if let Some(&point) = corners.iter().find(|&&v| v as usize >= self.points.len()) {
                return Err(TransferError::IndexOutOfRange {
                    element: self.cells.element(),
                    cell,
                    point,
                    points: self.points.len(),
                });
            }
        }
        let (points, cells, elements) = (self.points.len(), self.cells.len(), self.cells.elements());
        let over_points = self.point_fields.iter().map(|f| (f, "points", points));
        let over_cells = self.cell_fields.iter().map(|f| (f, elements, cells));
        over_points.chain(over_cells).try_for_each(|(field, element, count)| {
            let (expected, found) = (count.saturating_mul(field.components), field.values.len());
            if found != expected {
                let name = field.name.clone();
                return Err(TransferError::ValueCount {
                    name,
                    element,
                    count,
                    expected,
                    found,
                });
            }
            if field.kind == FieldKind::Vector && field.components != 3 {
                let (name, components) = (field.name.clone(), field.components);
                return Err(TransferError::NotAVector { name, components });
            }
            Ok(())
        })
    }

    fn centroids(&self) -> Vec<Point> {
        let centroid = |corners: &[u32]| {
            let sum: Vector = corners.iter().map(|&v| self.points[v as usize].coords).sum();
            Point::from(sum / corners.len() as f64)
        };
        self.cells.iter().map(centroid).collect()
    }
}

/// Maps a mesh with its fields to the target: every point to its image, with its values, and the same cells. Vectors over
/// cells are pushed forward at the means of their corners.
///
/// # Errors
///
/// As [`FieldMesh::check`].
pub fn push_forward(map: &dyn VolumeMap, field_mesh: &FieldMesh) -> Result<FieldMesh, TransferError> {
    field_mesh.check()?;
    let has_vectors = |fields: &[TransferField]| fields.iter().any(|field| field.kind == FieldKind::Vector);
    let (points, jacobians) = if has_vectors(&field_mesh.point_fields) {
        map.evaluate_with_jacobian(&field_mesh.points)
    } else {
        (map.evaluate(&field_mesh.points), vec![])
    };
    let in_cells = match has_vectors(&field_mesh.cell_fields) {
        true => map.jacobian(&field_mesh.centroids()),
        false => vec![],
    };
    let pushed = |fields: &[TransferField], jacobians: &[Matrix3]| {
        let field = |field: &TransferField| match field.kind {
            FieldKind::Vector => push_forward_vectors(field, jacobians),
            _ => field.clone(),
        };
        fields.iter().map(field).collect()
    };
    Ok(FieldMesh {
        points,
        cells: field_mesh.cells.clone(),
        point_fields: pushed(&field_mesh.point_fields, &jacobians),
        cell_fields: pushed(&field_mesh.cell_fields, &in_cells),
    })
}

/// The fields at points of the target: their values at the preimages. `inverse` must be the inverse of `map`.
///
/// # Errors
///
/// As [`FieldSampler::new`].
pub fn resample(
    map: &dyn VolumeMap,
    inverse: &dyn Inverse,
    field_mesh: &FieldMesh,
    points: &[Point],
) -> Result<ResampledFields, TransferError> {
    let sampler = FieldSampler::new(field_mesh)?;
    let (preimages, report) = inverse.preimages(points);
    let places: Vec<Point> = preimages.iter().map(Preimage::position).collect();
    let (mut fields, outside) = sampler.sample(&places);
    if fields.iter().any(|field| field.kind == FieldKind::Vector) {
        let jacobians = map.jacobian(&places);
        for field in fields.iter_mut().filter(|field| field.kind == FieldKind::Vector) {
            *field = push_forward_vectors(field, &jacobians);
        }
    }
    Ok(ResampledFields {
        fields,
        preimages,
        inverse: report,
        outside_mesh: outside.iter().filter(|&&outside| outside).count(),
    })
}

fn push_forward_vectors(field: &TransferField, jacobians: &[Matrix3]) -> TransferField {
    let vectors = field.values.as_chunks::<3>().0.iter().zip(jacobians);
    let pushed = vectors.flat_map(|(&vector, jacobian)| <[f64; 3]>::from(jacobian * Vector::from(vector)));
    TransferField {
        values: pushed.collect(),
        ..field.clone()
    }
}
