//! The fields that are carried, and their names.

use std::path::Display;

use anyhow::{Context, bail, ensure};
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::geometry::distance_field;
use solidmap::inverse::lattice_mesh;
use solidmap::io::{self, FieldFile};
use solidmap::mesh::CellList;
use solidmap::transfer::{FieldKind, FieldMesh, TransferField};

use crate::args::TransferArgs;
use crate::shared::fields::MeshWithFields;
use crate::shared::points::is_table;

/// Nodes of the mesh that carries the distance field when no FIELD is given.
const MESH_NODES: usize = 60_000;
/// Name of the field of `--distance`.
const DISTANCE: &str = "distance";
/// Name of the field that says what was found for a point of `--at`.
pub const STATUS: &str = "status";

/// Reads the fields to carry; refuses those that the output cannot hold.
pub fn read(args: &TransferArgs, boundary: &BoundaryMap) -> anyhow::Result<MeshWithFields> {
    let file = match &args.field {
        Some(path) => io::read_fields(path)?,
        None => {
            let mesh = lattice_mesh(boundary.domain(), MESH_NODES)?;
            FieldFile {
                points: mesh.vertices().to_vec(),
                cells: CellList::Tets(mesh.tets().to_vec()),
                ..FieldFile::default()
            }
        }
    };
    let mut given = MeshWithFields::new(file, &args.label, args.plain_vectors.as_deref());
    let carrier = &mut given.carrier;
    let shown = shown(args);
    if args.distance {
        let values = distance_field(boundary.domain(), &carrier.points)?;
        carrier.point_fields.push(TransferField {
            name: DISTANCE.into(),
            components: 1,
            values,
            kind: FieldKind::Values,
        });
    }
    let names: Vec<&str> = all_fields(carrier).map(|(_, field)| field.name.as_str()).collect();
    ensure!(
        !names.is_empty(),
        "`{shown}` has no fields; give a .csv with columns beside x, y and z, or a .vtu or .vtk with point or cell \
         data, or ask for --distance"
    );
    for name in args.label.iter().chain(args.plain_vectors.iter().flatten()) {
        ensure!(
            names.contains(&name.as_str()),
            "`{shown}` has no field `{name}`; its fields are {}",
            names.join(", ")
        );
    }
    carrier.check().with_context(|| format!("cannot carry `{shown}`"))?;
    require_matching_output(args, &given)?;
    require_distinct_names(args, &given.carrier)?;
    Ok(given)
}

/// The file that the fields come from, for messages; the map file where there is none.
pub fn shown(args: &TransferArgs) -> Display<'_> {
    args.field.as_deref().unwrap_or(&args.map).display()
}

/// Refuses a mesh format where there is no mesh.
fn require_matching_output(args: &TransferArgs, given: &MeshWithFields) -> anyhow::Result<()> {
    let has_mesh = match &args.at {
        Some(at) => !is_table(at),
        None => !(given.carrier.cells.is_empty() && given.triangles.is_empty()),
    };
    if !has_mesh && !is_table(&args.output) {
        bail!(
            "`{}` would hold points without a mesh; write them to .csv",
            args.output.display()
        );
    }
    Ok(())
}

/// Refuses several fields of one name.
fn require_distinct_names(args: &TransferArgs, carrier: &FieldMesh) -> anyhow::Result<()> {
    let status = args.at.iter().map(|_| STATUS.to_owned());
    let names = all_fields(carrier).map(|(_, field)| field.name.clone());
    let mut all = vec![names.chain(status.clone()).collect::<Vec<_>>()];
    if is_table(&args.output) {
        let field_columns = all_fields(carrier).flat_map(|(_, field)| columns(&field.name, field.components));
        all.push(
            ["x", "y", "z"]
                .map(String::from)
                .into_iter()
                .chain(field_columns)
                .chain(status)
                .collect(),
        );
    }
    for mut names in all {
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            bail!(
                "the name `{}` would stand for two fields (point and cell data, `{DISTANCE}` of --distance, \
                 `{STATUS}` of --at and the columns of a table share their names); rename one in `{}`",
                pair[0],
                shown(args)
            );
        }
    }
    Ok(())
}

/// The index in [`all_fields`] of the field for the picture.
pub fn drawn(args: &TransferArgs, carrier: &FieldMesh) -> anyhow::Result<usize> {
    let scalars = || {
        let all = all_fields(carrier).enumerate();
        all.filter(|(_, (_, field))| field.components == 1)
    };
    let shown = scalars().find(|(_, (_, field))| is_distance(args, field));
    let (which, _) = shown
        .or_else(|| scalars().next())
        .context("there is no field of one component to draw; leave out --png and --html, or add --distance")?;
    Ok(which)
}

/// Whether the field is that of `--distance`.
pub fn is_distance(args: &TransferArgs, field: &TransferField) -> bool {
    args.distance && field.name == DISTANCE
}

/// The distance from the boundary of the domain, exact also between the nodes of a carrier. Preimages outside the
/// domain, by no more than the boundary error, have distance 0.
pub fn distances(boundary: &BoundaryMap, points: &[Point]) -> anyhow::Result<Vec<f64>> {
    let distances = distance_field(boundary.domain(), points)?;
    // Not `f64::max`, which would turn NaN into 0.
    Ok(distances.into_iter().map(|d| if d < 0.0 { 0.0 } else { d }).collect())
}

/// The columns of a field in a table: `name`, `name_x` to `name_z`, or `name_0` onward.
pub fn columns(name: &str, components: usize) -> Vec<String> {
    match components {
        1 => vec![name.to_owned()],
        3 => ["x", "y", "z"].map(|axis| format!("{name}_{axis}")).to_vec(),
        n => (0..n).map(|k| format!("{name}_{k}")).collect(),
    }
}

/// Every field, and whether it is over points or cells.
pub fn all_fields(carrier: &FieldMesh) -> impl Iterator<Item = (&'static str, &TransferField)> {
    let over_points = carrier.point_fields.iter().map(|field| ("point", field));
    over_points.chain(carrier.cell_fields.iter().map(|field| ("cell", field)))
}
