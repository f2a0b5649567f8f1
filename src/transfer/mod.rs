//! Fields that go from the domain of a map to its target: Li, Guo, Wang, He, Gu & Qin, *Harmonic volumetric mapping for
//! solid modeling applications* (2007), section 5.1.
//!
//! [`push_forward`] moves what carries the field, points or a mesh: exact at the nodes. [`resample`] asks for the field at given
//! points of the target, by way of the inverse map and linear interpolation where the field is known. [`volume_check`] and
//! [`distribution_check`] say what the map does to volumes, and so to how much of the solid has which value.

mod checks;
mod sampler;

use crate::inverse::{InverseMap, InverseReport, Preimage};
use crate::map::VolumeMap;
use crate::{Matrix3, Point, Vector};

pub use checks::{
    DistributionCheck, LabelShare, ValueDistribution, VolumeCheck, distribution_check, label_shares, volume_check,
};
pub use sampler::FieldSampler;

/// How the values of a field go to the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FieldKind {
    /// As they are; linear between nodes.
    Values,
    /// Three components that are pushed forward, `J v`: velocities, fibres, directions that move with the material.
    Vector,
    /// As they are, and between nodes those of the corner that has the largest weight: never averaged.
    Label,
}

/// A field with a value for every point or every tetrahedron.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferField {
    /// Its name.
    pub name: String,
    /// Numbers in a value.
    pub components: usize,
    /// `n × components`, row-major.
    pub values: Vec<f64>,
    /// How it goes to the target.
    pub kind: FieldKind,
}

/// Points with fields, and the tetrahedra between them, if any.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldMesh {
    /// The points, in the domain or in the target.
    pub points: Vec<Point>,
    /// Tetrahedra over the points; may be empty.
    pub tets: Vec<[u32; 4]>,
    /// Fields over the points.
    pub point_fields: Vec<TransferField>,
    /// Fields over the tetrahedra.
    pub cell_fields: Vec<TransferField>,
}

/// Why a field cannot be transferred.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError {
    /// A field has not a value for each point or tetrahedron.
    #[error("the field `{name}` has {found} numbers, but {expected} are needed for {count} {element}")]
    ValueCount {
        /// Name of the field.
        name: String,
        /// Points or tetrahedra.
        element: &'static str,
        /// How many of them.
        count: usize,
        /// Numbers that they need.
        expected: usize,
        /// Numbers that there are.
        found: usize,
    },
    /// A vector field whose values have not three components.
    #[error("the field `{name}` has {components} components, but a vector that is pushed forward has 3")]
    NotAVector {
        /// Name of the field.
        name: String,
        /// Its components.
        components: usize,
    },
    /// A tetrahedron names a point that is not there.
    #[error("tetrahedron {tet} names point {point} of {points}")]
    IndexOutOfRange {
        /// The tetrahedron.
        tet: usize,
        /// The point.
        point: u32,
        /// How many points there are.
        points: usize,
    },
    /// Nothing has a value.
    #[error("no point with finite coordinates carries the fields")]
    Empty,
}

/// Fields at points of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct ResampledFields {
    /// The mesh's fields over points, then those over its tetrahedra; NaN at points without preimage.
    pub fields: Vec<TransferField>,
    /// Where the points come from.
    pub preimages: Vec<Preimage>,
    /// What the inverse map has to say.
    pub inverse: InverseReport,
    /// Preimages beyond the mesh's tetrahedra, which got what is at the closest point of their boundary; 0 without
    /// tetrahedra.
    pub outside_mesh: usize,
}

impl FieldMesh {
    /// Whether indices and counts fit.
    ///
    /// # Errors
    ///
    /// [`TransferError`] with the first that does not.
    pub fn check(&self) -> Result<(), TransferError> {
        for (tet, corners) in self.tets.iter().enumerate() {
            if let Some(&point) = corners.iter().find(|&&v| v as usize >= self.points.len()) {
                return Err(TransferError::IndexOutOfRange {
                    tet,
                    point,
                    points: self.points.len(),
                });
            }
        }
        let over_points = self
            .point_fields
            .iter()
            .map(|field| (field, "points", self.points.len()));
        let over_tets = self
            .cell_fields
            .iter()
            .map(|field| (field, "tetrahedra", self.tets.len()));
        over_points.chain(over_tets).try_for_each(|(field, element, count)| {
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
        let centroid = |tet: &[u32; 4]| {
            let sum: Vector = tet.iter().map(|&v| self.points[v as usize].coords).sum();
            Point::from(sum / 4.0)
        };
        self.tets.iter().map(centroid).collect()
    }
}

/// The mesh in the target: every point at its image, with its values, and the same tetrahedra. Vectors over tetrahedra are
/// pushed forward at the centroids.
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
    let in_tets = match has_vectors(&field_mesh.cell_fields) {
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
        tets: field_mesh.tets.clone(),
        point_fields: pushed(&field_mesh.point_fields, &jacobians),
        cell_fields: pushed(&field_mesh.cell_fields, &in_tets),
    })
}

/// The mesh's fields at points of the target: what is at their preimages.
///
/// # Errors
///
/// As [`FieldSampler::new`].
pub fn resample(
    map: &dyn VolumeMap,
    inverse: &InverseMap,
    field_mesh: &FieldMesh,
    points: &[Point],
) -> Result<ResampledFields, TransferError> {
    let sampler = FieldSampler::new(field_mesh)?;
    let (preimages, report) = inverse.preimages(points);
    let places: Vec<Point> = preimages.iter().map(Preimage::position).collect();
    let (mut fields, beyond) = sampler.sample(&places);
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
        outside_mesh: beyond.iter().filter(|&&beyond| beyond).count(),
    })
}

fn push_forward_vectors(field: &TransferField, jacobians: &[Matrix3]) -> TransferField {
    let vectors = field.values.as_chunks::<3>().0.iter().zip(jacobians);
    TransferField {
        values: vectors
            .flat_map(|(&vector, jacobian)| <[f64; 3]>::from(jacobian * Vector::from(vector)))
            .collect(),
        ..field.clone()
    }
}
