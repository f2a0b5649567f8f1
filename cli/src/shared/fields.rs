//! Fields on points and meshes: read from files, carried by maps, and written.

use std::path::Path;

use anyhow::{Context, ensure};
use solidmap::files;
use solidmap::io::{self, Cells, Field, FieldFile, VtkFields};
use solidmap::map::VolumeMap;
use solidmap::transfer::{FieldKind, FieldMesh, TransferField, push_forward};

/// Names, in lower case, of fields of three components that are not pushed forward as vectors.
const NOT_VECTORS: [&str; 7] = ["rgb", "color", "colors", "colour", "colours", "normal", "normals"];

/// A mesh with fields: points and cells that carry them, and triangles between the points where there are no cells.
pub struct MeshWithFields {
    pub carrier: FieldMesh,
    pub triangles: Vec<[u32; 3]>,
}

impl MeshWithFields {
    /// The fields of a file. `labels` and `plain_vectors` name those that are labels, or not pushed forward (all when
    /// empty).
    pub fn new(file: FieldFile, labels: &[String], plain_vectors: Option<&[String]>) -> Self {
        let is_plain = |name: &String| {
            plain_vectors.is_some_and(|names| names.is_empty() || names.contains(name))
                || NOT_VECTORS.contains(&name.to_lowercase().as_str())
        };
        let named = |field: Field| TransferField {
            kind: match field.components {
                _ if labels.contains(&field.name) => FieldKind::Label,
                3 if !is_plain(&field.name) => FieldKind::Vector,
                _ => FieldKind::Values,
            },
            name: field.name,
            components: field.components,
            values: field.values,
        };
        Self {
            carrier: FieldMesh {
                points: file.points,
                cells: file.cells,
                point_fields: file.point.into_iter().map(named).collect(),
                cell_fields: file.cell.into_iter().map(named).collect(),
            },
            triangles: file.triangles,
        }
    }

    /// Reads a mesh with fields.
    pub fn read_mesh(path: &Path) -> anyhow::Result<Self> {
        let given = Self::new(io::read_fields(path)?, &[], None);
        let (carrier, shown) = (&given.carrier, path.display());
        ensure!(
            !(carrier.cells.is_empty() && given.triangles.is_empty()),
            "`{shown}` has no triangles and no cells between its points; give a .vtu or .vtk that has"
        );
        carrier.check().with_context(|| format!("cannot carry `{shown}`"))?;
        Ok(given)
    }

    /// The mesh and its fields, carried by a map.
    pub fn carried(&self, map: &dyn VolumeMap) -> anyhow::Result<Self> {
        Ok(Self {
            carrier: push_forward(map, &self.carrier)?,
            triangles: self.triangles.clone(),
        })
    }

    /// Writes the mesh with its fields, and with `more` fields at its points.
    pub fn write_mesh(&self, path: &Path, more: Vec<Field>) -> anyhow::Result<()> {
        let fields = VtkFields {
            point: fields_of(&self.carrier.point_fields).chain(more).collect(),
            cell: fields_of(&self.carrier.cell_fields).collect(),
            ..VtkFields::default()
        };
        let cells = match self.carrier.cells.is_empty() {
            true => Cells::Triangles(&self.triangles),
            false => Cells::from(&self.carrier.cells),
        };
        Ok(files::write_fields(path, &self.carrier.points, cells, &fields)?)
    }
}

/// Fields as files have them.
pub fn fields_of(fields: &[TransferField]) -> impl Iterator<Item = Field> {
    fields.iter().map(|field| Field {
        name: field.name.clone(),
        components: field.components,
        values: field.values.clone(),
    })
}
