//! Writing legacy files.

use std::{
    borrow::Cow,
    io::{self, Write},
    path::Path,
};

use super::super::cells::vtk_type;
use crate::{
    Point,
    io::{Cells, Field, IoError, VtkFields, atomic_write, fields::check},
};

/// The encoding of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VtkEncoding {
    /// Text; every number reads back to the same bits.
    Text,
    /// Big-endian bytes.
    Binary,
}

/// Writes a legacy VTK file (version 3.0, which all readers support) with double-precision coordinates and fields.
/// Blanks in field names become `_`.
///
/// # Errors
///
/// [`IoError::IndexOutOfRange`], [`IoError::ValueCount`] for a field that does not fit the mesh, [`IoError::Write`].
pub fn write_vtk(
    path: impl AsRef<Path>,
    points: &[Point],
    cells: Cells,
    fields: &VtkFields,
    encoding: VtkEncoding,
) -> Result<(), IoError> {
    check(path.as_ref(), points, cells, fields)?;
    atomic_write(path, |writer| {
        write(&mut LegacyWriter { writer, encoding }, points, cells, fields)
    })
}

struct LegacyWriter<'a> {
    writer: &'a mut dyn Write,
    encoding: VtkEncoding,
}

fn write(out: &mut LegacyWriter, points: &[Point], cells: Cells, fields: &VtkFields) -> io::Result<()> {
    let corners = cells.corners() as u32;
    let coordinates: Vec<f64> = points.iter().flat_map(|p| p.iter().copied()).collect();
    let encoding = match out.encoding {
        VtkEncoding::Text => "ASCII",
        VtkEncoding::Binary => "BINARY",
    };
    // The format's title: one line of at most 256 characters.
    let title = if fields.comment.is_empty() {
        "solidmap"
    } else {
        &fields.comment
    };
    let graphic = |c: char| if c.is_ascii_graphic() { c } else { ' ' };
    let title: String = title.chars().map(graphic).take(250).collect();
    writeln!(
        out.writer,
        "# vtk DataFile Version 3.0\n{title}\n{encoding}\nDATASET UNSTRUCTURED_GRID"
    )?;
    writeln!(out.writer, "POINTS {} double", points.len())?;
    out.floats(&coordinates, 3)?;
    let count = cells.count();
    writeln!(out.writer, "CELLS {count} {}", count + cells.flat().len())?;
    for cell in cells.iter() {
        out.integers(std::iter::once(corners).chain(cell.iter().copied()))?;
    }
    out.end_of_data()?;
    writeln!(out.writer, "CELL_TYPES {}", cells.count())?;
    for _ in 0..cells.count() {
        out.integers([u32::from(vtk_type(cells))])?;
    }
    out.end_of_data()?;
    out.fields("POINT_DATA", points.len(), &fields.point)?;
    out.fields("CELL_DATA", cells.count(), &fields.cell)
}

impl LegacyWriter<'_> {
    fn fields(&mut self, place: &str, count: usize, fields: &[Field]) -> io::Result<()> {
        if fields.is_empty() {
            return Ok(());
        }
        writeln!(self.writer, "{place} {count}\nFIELD FieldData {}", fields.len())?;
        for field in fields {
            let name = legacy_name(&field.name);
            writeln!(self.writer, "{name} {} {count} double", field.components)?;
            self.floats(&field.values, field.components)?;
        }
        Ok(())
    }

    fn floats(&mut self, values: &[f64], per_line: usize) -> io::Result<()> {
        match self.encoding {
            VtkEncoding::Binary => {
                for value in values {
                    self.writer.write_all(&value.to_be_bytes())?;
                }
            }
            VtkEncoding::Text => {
                for (k, value) in values.iter().enumerate() {
                    let end = if (k + 1) % per_line == 0 { '\n' } else { ' ' };
                    write!(self.writer, "{value:?}{end}")?;
                }
            }
        }
        self.end_of_data()
    }

    /// One line of text.
    fn integers(&mut self, values: impl IntoIterator<Item = u32>) -> io::Result<()> {
        for value in values {
            match self.encoding {
                VtkEncoding::Binary => self.writer.write_all(&value.to_be_bytes())?,
                VtkEncoding::Text => write!(self.writer, "{value} ")?,
            }
        }
        match self.encoding {
            VtkEncoding::Binary => Ok(()),
            VtkEncoding::Text => self.writer.write_all(b"\n"),
        }
    }

    fn end_of_data(&mut self) -> io::Result<()> {
        match self.encoding {
            VtkEncoding::Binary => self.writer.write_all(b"\n"),
            VtkEncoding::Text => Ok(()),
        }
    }
}

/// Names in a legacy file must be single words.
fn legacy_name(name: &str) -> Cow<'_, str> {
    if name.is_empty() {
        return Cow::Borrowed("_");
    }
    if name.contains(char::is_whitespace) {
        return Cow::Owned(name.replace(char::is_whitespace, "_"));
    }
    Cow::Borrowed(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_and_fields_that_do_not_fit_are_refused_before_writing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtk");
        let points = [Point::origin(); 4];
        let write = |cells, fields: &VtkFields| write_vtk(&path, &points, cells, fields, VtkEncoding::Text);
        let error = write(Cells::Tets(&[[0, 1, 2, 4]]), &VtkFields::default()).unwrap_err();
        assert!(matches!(error, IoError::IndexOutOfRange { vertex: 4, .. }));
        let fields = VtkFields {
            cell: vec![Field {
                name: "detJ".into(),
                components: 1,
                values: vec![1.0; 2],
            }],
            ..VtkFields::default()
        };
        let error = write(Cells::Tets(&[[0, 1, 2, 3]]), &fields).unwrap_err();
        assert!(
            matches!(
                error,
                IoError::ValueCount {
                    expected: 1,
                    found: 2,
                    ..
                }
            ),
            "{error}"
        );
        assert!(!path.exists());
    }

    #[test]
    fn written_text_is_what_the_format_asks_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtk");
        let points = [[0., 0., 0.], [1., 0., 0.], [0., 0.1, 0.]].map(Point::from);
        let field = |name: &str, components, values: Vec<f64>| Field {
            name: name.into(),
            components,
            values,
        };
        let fields = VtkFields {
            point: vec![field("a b", 1, vec![1., 2., 3.])],
            cell: vec![field("v", 3, vec![0.5, 0., 1e-300])],
            comment: "from\na file".into(),
        };
        write_vtk(
            &path,
            &points,
            Cells::Triangles(&[[0, 1, 2]]),
            &fields,
            VtkEncoding::Text,
        )
        .unwrap();
        let expected = "# vtk DataFile Version 3.0\nfrom a file\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 double\n\
                        0.0 0.0 0.0\n1.0 0.0 0.0\n0.0 0.1 0.0\nCELLS 1 4\n3 0 1 2 \nCELL_TYPES 1\n5 \nPOINT_DATA 3\n\
                        FIELD FieldData 1\na_b 1 3 double\n1.0\n2.0\n3.0\nCELL_DATA 1\nFIELD FieldData 1\nv 3 1 double\n\
                        0.5 0.0 1e-300\n";
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
    }
}
