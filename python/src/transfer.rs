//! Fields carried by maps.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use serde_json::json;
use solidmap::energy::{GridResolution, clipped_grid};
use solidmap::geometry::{count_outside, distance_field};
use solidmap::inverse::{InverseOptions, Preimage, lattice_mesh};
use solidmap::io::{self, Field};
use solidmap::map::with_cancellation;
use solidmap::mesh::CellList;
use solidmap::transfer::{
    FieldKind, FieldMesh, FieldSampler, TransferField, distribution_check, label_shares, push_forward, resample,
    volume_check,
};

use crate::arrays::{Points, copy_of_rows, entries, from_points};
use crate::boundary::value_of;
use crate::map::{Map, PreparedInverse, boundary_of, chosen};
use crate::measures::kind_name;
use crate::meshes::cell_list;
use crate::run::{run, step};

/// A field: its name, its components, its values row by row, and how it is carried.
pub type GivenField<'py> = (String, usize, PyReadonlyArray1<'py, f64>, String);
/// A field that was read or carried: its name, its components, and its values row by row.
pub type FoundField<'py> = (String, usize, Bound<'py, PyArray1<f64>>);

/// Nodes of the mesh that carries the distance field when no other is given, as in the program.
const MESH_NODES: usize = 60_000;

pub fn given(fields: Vec<GivenField>) -> PyResult<Vec<TransferField>> {
    let of = |(name, components, values, kind): GivenField| {
        Ok(TransferField {
            values: entries(&format!("fields[{name:?}]"), &values)?,
            kind: match kind.as_str() {
                "vector" => FieldKind::Vector,
                "label" => FieldKind::Label,
                _ => FieldKind::Values,
            },
            name,
            components,
        })
    };
    fields.into_iter().map(of).collect()
}

pub fn found(py: Python<'_>, fields: Vec<TransferField>) -> Vec<FoundField<'_>> {
    let of = |field: TransferField| (field.name, field.components, PyArray1::from_vec(py, field.values));
    fields.into_iter().map(of).collect()
}

/// The points, cells and fields of a file.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "parts of a file")]
pub fn read_fields(
    py: Python<'_>,
    path: PathBuf,
) -> PyResult<(
    Bound<'_, PyArray2<f64>>,
    Option<Bound<'_, PyArray2<u32>>>,
    Vec<FoundField<'_>>,
    Vec<FoundField<'_>>,
)> {
    let file = run(py, None, None, move |_| Ok(io::read_fields(path)?))?;
    let cells = match &file.cells {
        cells if cells.is_empty() && !file.triangles.is_empty() => Some(copy_of_rows(py, &file.triangles)),
        cells if cells.is_empty() => None,
        CellList::Tets(tets) => Some(copy_of_rows(py, tets)),
        CellList::Hexes(hexes) => Some(copy_of_rows(py, hexes)),
    };
    let of = |field: Field| (field.name, field.components, PyArray1::from_vec(py, field.values));
    Ok((
        from_points(py, file.points)?,
        cells,
        file.point.into_iter().map(of).collect(),
        file.cell.into_iter().map(of).collect(),
    ))
}

/// What carries the fields.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TransferArguments<'py> {
    points: Option<PyReadonlyArray2<'py, f64>>,
    cells: Option<PyReadonlyArray2<'py, u32>>,
    point_fields: Vec<GivenField<'py>>,
    cell_fields: Vec<GivenField<'py>>,
    at: Option<PyReadonlyArray2<'py, f64>>,
    distance: bool,
    resolution: usize,
}

/// Fields at the images of their points, or at given points of the target: points, cells, both kinds of fields, the
/// status of preimages, and the report.
#[pyfunction]
#[pyo3(signature = (map, arguments, kind=None, progress=None))]
#[allow(clippy::type_complexity, reason = "parts of a mesh")]
pub fn transfer<'py>(
    py: Python<'py>,
    map: &Map,
    arguments: TransferArguments<'py>,
    kind: Option<&str>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Option<Bound<'py, PyArray2<u32>>>,
    Vec<FoundField<'py>>,
    Vec<FoundField<'py>>,
    Option<Bound<'py, PyArray1<u8>>>,
    String,
)> {
    let (file, kind) = (Arc::clone(&map.file), map.kind(kind)?);
    let points = arguments.points.as_ref().map(|points| Points::of("points", points));
    let points = points.transpose()?.map(|points| points.to_vec());
    let cells = arguments
        .cells
        .as_ref()
        .map(|cells| cell_list("cells", cells))
        .transpose()?;
    let (point_fields, cell_fields) = (given(arguments.point_fields)?, given(arguments.cell_fields)?);
    let at = arguments.at.as_ref().map(|at| Points::of("at", at)).transpose()?;
    let (distance, resolution) = (arguments.distance, arguments.resolution);
    let tolerance = InverseOptions::default().tolerance;
    let kept = map.kept_inverse(kind, tolerance);
    let (carried, status, report) = run(py, progress, None, move |watch| {
        let boundary = boundary_of(&file)?;
        let is_given = points.is_some();
        let mut carrier = match points {
            Some(points) => FieldMesh {
                points,
                cells: cells.unwrap_or_default(),
                point_fields,
                cell_fields,
            },
            None => {
                let mesh = lattice_mesh(boundary.domain(), MESH_NODES)?;
                FieldMesh {
                    points: mesh.vertices().to_vec(),
                    cells: CellList::Tets(mesh.tets().to_vec()),
                    ..FieldMesh::default()
                }
            }
        };
        if distance {
            carrier.point_fields.push(TransferField {
                name: "distance".into(),
                components: 1,
                values: distance_field(boundary.domain(), &carrier.points)?,
                kind: FieldKind::Values,
            });
        }
        carrier.check()?;
        let (carried, status, inverse, beyond) = match &at {
            None => {
                let poll = || watch.tell(|| step("carrying points"));
                let pushed = with_cancellation(chosen(&file, kind), &poll, |map| push_forward(map, &carrier))??;
                (pushed, None, None, 0)
            }
            Some(at) => {
                let prepared = match kept {
                    Some(kept) => kept,
                    None => Arc::new(PreparedInverse::new(Arc::clone(&file), kind, tolerance)?),
                };
                let poll = || watch.tell(|| step("searching preimages"));
                let found = with_cancellation(chosen(&file, kind), &poll, |map| {
                    resample(map, prepared.inverse(), &carrier, at)
                })??;
                let status = found.preimages.iter().map(|p| p.status as u8).collect::<Vec<u8>>();
                let mut fields = found.fields;
                if distance && let Some(field) = fields.iter_mut().find(|field| field.name == "distance") {
                    // Exact also between the nodes; preimages outside, by no more than the boundary error, have 0.
                    let places: Vec<_> = found.preimages.iter().map(Preimage::position).collect();
                    let found = distance_field(boundary.domain(), &places)?;
                    field.values = found.into_iter().map(|d| if d < 0.0 { 0.0 } else { d }).collect();
                }
                let at_points = FieldMesh {
                    points: at.to_vec(),
                    point_fields: fields,
                    ..FieldMesh::default()
                };
                (at_points, Some(status), Some(found.inverse), found.outside_mesh)
            }
        };
        let outside = match is_given && at.is_none() {
            true => Some(count_outside(boundary.domain(), &carrier.points)?),
            false => None,
        };
        // Volumes and distributions, on a grid of the domain.
        let grid = clipped_grid(boundary.domain(), GridResolution::CellsAlongLongestSide(resolution))?;
        let poll = || watch.tell(|| step("checking volumes"));
        let target_volume = boundary.target_volume();
        let (volume, after) = with_cancellation(chosen(&file, kind), &poll, |map| {
            volume_check(map, &grid, target_volume)
        })?;
        let (sampled, is_beyond) = FieldSampler::new(&carrier)?.sample(grid.points());
        let before = grid.weights();
        let fields = sampled.iter().map(|field| {
            let mut values = field.values.clone();
            let rows = values.chunks_mut(field.components.max(1)).zip(&is_beyond);
            rows.filter(|(_, beyond)| **beyond)
                .for_each(|(row, _)| row.fill(f64::NAN));
            let is_scalar = field.components == 1;
            let is_label = field.kind == FieldKind::Label;
            let carry = match field.kind {
                FieldKind::Values => "values",
                FieldKind::Vector => "vector",
                FieldKind::Label => "label",
            };
            let distribution = (is_scalar && !is_label)
                .then(|| distribution_check(&values, before, &after))
                .flatten();
            let labels = (is_scalar && is_label).then(|| label_shares(&values, before, &after));
            Ok(json!({
                "name": field.name,
                "components": field.components,
                "carry": carry,
                "distribution": value_of(&distribution)?,
                "labels": value_of(&labels)?,
            }))
        });
        let fields = fields.collect::<Result<Vec<_>, crate::error::Failure>>()?;
        let without = match &status {
            Some(status) => status.iter().filter(|&&status| status > 1).count(),
            None => carried
                .points
                .iter()
                .filter(|p| !p.iter().all(|c| c.is_finite()))
                .count(),
        };
        let report = json!({
            "map_kind": kind_name(kind),
            "points": carrier.points.len(),
            "written_points": carried.points.len(),
            "without_value": without,
            "outside": outside,
            "fields": fields,
            "volume": value_of(&volume)?,
            "inverse": value_of(&inverse)?,
            "beyond_carrier": if is_given { beyond } else { 0 },
        });
        Ok((carried, status, report.to_string()))
    })?;
    let cells = match &carried.cells {
        cells if cells.is_empty() => None,
        CellList::Tets(tets) => Some(copy_of_rows(py, tets)),
        CellList::Hexes(hexes) => Some(copy_of_rows(py, hexes)),
    };
    Ok((
        from_points(py, carried.points)?,
        cells,
        found(py, carried.point_fields),
        found(py, carried.cell_fields),
        status.map(|status| PyArray1::from_vec(py, status)),
        report,
    ))
}
