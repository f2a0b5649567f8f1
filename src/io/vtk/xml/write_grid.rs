//! Writing unstructured grids: inline base64, compressed.

use std::{
    io::{self, Write},
    path::Path,
};

use quick_xml::escape::escape;

use super::super::cells::vtk_type;
use super::compress::write_values;
use crate::{
    Point,
    io::{Cells, Field, IoError, VtkFields, atomic_write, fields::check},
};

/// Writes an unstructured grid with double-precision coordinates and fields, compressed by zlib.
///
/// # Errors
///
/// [`IoError::IndexOutOfRange`], [`IoError::ValueCount`] for a field that does not fit the mesh, [`IoError::Write`].
pub fn write_vtu(path: impl AsRef<Path>, points: &[Point], cells: Cells, fields: &VtkFields) -> Result<(), IoError> {
    check(path.as_ref(), points, cells, fields)?;
    atomic_write(path, |writer| write(writer, points, cells, fields))
}

fn write(writer: &mut dyn Write, points: &[Point], cells: Cells, fields: &VtkFields) -> io::Result<()> {
    let corners = cells.corners();
    writeln!(writer, "<?xml version=\"1.0\"?>")?;
    if !fields.comment.is_empty() {
        // Two consecutive hyphens would end the comment.
        let mut comment = String::new();
        for c in fields.comment.chars() {
            if c == '-' && comment.ends_with('-') {
                comment.push(' ');
            }
            comment.push(if c.is_control() { ' ' } else { c });
        }
        writeln!(writer, "<!-- {comment} -->")?;
    }
    writeln!(
        writer,
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<Points>",
        points.len(),
        cells.count()
    )?;
    let coordinate = |k: usize| points[k / 3][k % 3].to_le_bytes();
    write_array(writer, "Float64", "Points", 3, 3 * points.len(), &coordinate)?;
    writeln!(writer, "</Points>\n<Cells>")?;
    let corner = |k: usize| i64::from(cells.flat()[k]).to_le_bytes();
    write_array(writer, "Int64", "connectivity", 1, cells.flat().len(), &corner)?;
    let end = |k: usize| (((k + 1) * corners) as i64).to_le_bytes();
    write_array(writer, "Int64", "offsets", 1, cells.count(), &end)?;
    write_array(writer, "UInt8", "types", 1, cells.count(), &|_| [vtk_type(cells)])?;
    writeln!(writer, "</Cells>")?;
    write_fields(writer, "PointData", &fields.point)?;
    write_fields(writer, "CellData", &fields.cell)?;
    writeln!(writer, "</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

fn write_fields(writer: &mut dyn Write, element: &str, fields: &[Field]) -> io::Result<()> {
    writeln!(writer, "<{element}>")?;
    for field in fields {
        let (name, count) = (escape(field.name.as_str()), field.values.len());
        let value = |k: usize| field.values[k].to_le_bytes();
        write_array(writer, "Float64", &name, field.components, count, &value)?;
    }
    writeln!(writer, "</{element}>")
}

fn write_array<const N: usize>(
    writer: &mut dyn Write,
    kind: &str,
    name: &str,
    components: usize,
    count: usize,
    value: &(dyn Fn(usize) -> [u8; N] + Sync),
) -> io::Result<()> {
    // One component is the default. Where it is written, meshio reads scalars as arrays of shape (n, 1), not (n,).
    let components = match components {
        1 => String::new(),
        _ => format!(" NumberOfComponents=\"{components}\""),
    };
    write!(
        writer,
        "<DataArray type=\"{kind}\" Name=\"{name}\"{components} format=\"binary\">"
    )?;
    write_values(writer, count, value)?;
    writeln!(writer, "</DataArray>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_arrays_of_several_components_say_how_many() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tet.vtu");
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point::from);
        let field = |name: &str, components: usize| Field {
            name: name.into(),
            components,
            values: vec![1.0; components],
        };
        let fields = VtkFields {
            cell: vec![field("scalar", 1), field("vector", 3)],
            ..VtkFields::default()
        };
        write_vtu(&path, &points, Cells::Tets(&[[0, 1, 2, 3]]), &fields).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("Name=\"scalar\" format"), "{text}");
        assert!(
            text.contains("Name=\"vector\" NumberOfComponents=\"3\" format"),
            "{text}"
        );
    }
}
