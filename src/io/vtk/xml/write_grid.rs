//! Writing unstructured grids: inline base64, uncompressed.

use std::{
    io::{self, Write},
    path::Path,
};

use base64::{engine::general_purpose::STANDARD, write::EncoderWriter};
use quick_xml::escape::escape;

use super::super::cells::vtk_type;
use crate::{
    Point,
    io::{Cells, Field, IoError, VtkFields, atomic_write, fields::check},
};

/// Writes an unstructured grid with double-precision coordinates and fields.
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
         header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<Points>",
        points.len(),
        cells.count()
    )?;
    let coordinates = points.iter().flat_map(|p| p.iter().map(|x| x.to_le_bytes()));
    write_array(writer, "Float64", "Points", 3, 3 * points.len(), coordinates)?;
    writeln!(writer, "</Points>\n<Cells>")?;
    let connectivity = cells.flat().iter().map(|&v| i64::from(v).to_le_bytes());
    write_array(writer, "Int64", "connectivity", 1, cells.flat().len(), connectivity)?;
    let offsets = (1..=cells.count()).map(|k| ((k * corners) as i64).to_le_bytes());
    write_array(writer, "Int64", "offsets", 1, cells.count(), offsets)?;
    let types = (0..cells.count()).map(|_| [vtk_type(cells)]);
    write_array(writer, "UInt8", "types", 1, cells.count(), types)?;
    writeln!(writer, "</Cells>")?;
    write_fields(writer, "PointData", &fields.point)?;
    write_fields(writer, "CellData", &fields.cell)?;
    writeln!(writer, "</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

fn write_fields(writer: &mut dyn Write, element: &str, fields: &[Field]) -> io::Result<()> {
    writeln!(writer, "<{element}>")?;
    for field in fields {
        let (name, count) = (escape(field.name.as_str()), field.values.len());
        let bytes = field.values.iter().map(|x| x.to_le_bytes());
        write_array(writer, "Float64", &name, field.components, count, bytes)?;
    }
    writeln!(writer, "</{element}>")
}

fn write_array<const N: usize>(
    writer: &mut dyn Write,
    kind: &str,
    name: &str,
    components: usize,
    count: usize,
    values: impl Iterator<Item = [u8; N]>,
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
    let mut encoder = EncoderWriter::new(&mut *writer, &STANDARD);
    encoder.write_all(&((count * N) as u64).to_le_bytes())?;
    for value in values {
        encoder.write_all(&value)?;
    }
    encoder.finish()?;
    drop(encoder);
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
