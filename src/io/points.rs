//! Point lists and tables: CSV with a header, and NumPy's NPY.
//!
//! NPY is our own code: `npyz` allocates by an unchecked length in the header, and depends on a parser of Python
//! literals.

use std::fmt::Write as _;
use std::path::Path;

use rayon::prelude::*;

use super::{
    Field, IoError, Place, atomic_write,
    input::{ByteOrder, InputFile, Scalar, excerpt, parsed, printable},
    raw_mesh::RawMesh,
};
use crate::Point;

/// Writes a table as CSV: a header with the `names` of the columns, then `values`, row-major. Numbers read back to
/// the same bits.
///
/// # Errors
///
/// [`IoError::ValueCount`] when the values do not fill whole rows, [`IoError::Write`].
pub fn write_csv(path: impl AsRef<Path>, names: &[&str], values: &[f64]) -> Result<(), IoError> {
    check_rows(path.as_ref(), names.len(), values.len())?;
    atomic_write(path, |writer| {
        csv::Writer::from_writer(&mut *writer).write_record(names)?;
        // Formatting takes longer than writing.
        let columns = names.len().max(1);
        for rows in values.chunks(ROWS_AT_ONCE * columns) {
            let texts: Vec<String> = rows
                .par_chunks(ROWS_PER_TASK * columns)
                .map(|rows| rows.chunks_exact(columns).map(csv_row).collect())
                .collect();
            texts.iter().try_for_each(|text| writer.write_all(text.as_bytes()))?;
        }
        Ok(())
    })
}

const ROWS_PER_TASK: usize = 1 << 10;
const ROWS_AT_ONCE: usize = 1 << 16;

/// A line of numbers, which need no quotes.
fn csv_row(row: &[f64]) -> String {
    let mut line = String::with_capacity(20 * row.len());
    for (k, x) in row.iter().enumerate() {
        let comma = if k > 0 { "," } else { "" };
        // Writing into a string cannot fail.
        let _ = write!(line, "{comma}{x:?}");
    }
    line.push('\n');
    line
}

/// Writes `values`, row-major with this number of `columns`, as a little-endian NPY array of double precision.
///
/// # Errors
///
/// [`IoError::ValueCount`] when the values do not fill whole rows, [`IoError::Write`].
pub fn write_npy(path: impl AsRef<Path>, columns: usize, values: &[f64]) -> Result<(), IoError> {
    check_rows(path.as_ref(), columns, values.len())?;
    let rows = values.len() / columns.max(1);
    atomic_write(path, |writer| {
        let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
        // The header ends with a line feed, and the data begin at a multiple of 64 bytes.
        let length = (MAGIC.len() + 4 + header.len() + 1).next_multiple_of(64) - MAGIC.len() - 4;
        writer.write_all(MAGIC)?;
        writer.write_all(&[1, 0])?;
        writer.write_all(&(length as u16).to_le_bytes())?;
        writeln!(writer, "{header:width$}", width = length - 1)?;
        values.iter().try_for_each(|x| writer.write_all(&x.to_le_bytes()))
    })
}

/// The columns `x`, `y` and `z` of a CSV table, in any position.
pub(super) fn parse_csv(file: &InputFile) -> Result<RawMesh, IoError> {
    let header = csv_reader(file)
        .byte_headers()
        .map_err(|error| csv_error(file, &error))?
        .clone();
    let mut columns = [0; 3];
    for (column, name) in columns.iter_mut().zip(["x", "y", "z"]) {
        let found = header
            .iter()
            .position(|field| field.eq_ignore_ascii_case(name.as_bytes()));
        *column = found.ok_or_else(|| {
            let found = excerpt(file.bytes.split(|&b| b == b'\n').next().unwrap_or_default());
            let found = format!("found the header `{found}`, which needs columns x, y and z");
            file.malformed_at(Place::Line(1), found)
        })?;
    }
    let values = csv_values(file, &columns, |_| String::new())?;
    Ok(RawMesh {
        vertices: values.chunks_exact(3).map(Point::from_slice).collect(),
        ..RawMesh::default()
    })
}

fn csv_reader<'a>(file: &InputFile<'a>) -> csv::Reader<&'a [u8]> {
    csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file.bytes)
}

/// The numbers in some columns of a CSV table, row by row. `place` names a column in error messages.
fn csv_values(file: &InputFile, columns: &[usize], place: impl Fn(usize) -> String) -> Result<Vec<f64>, IoError> {
    let (mut reader, mut values) = (csv_reader(file), Vec::new());
    let mut record = csv::ByteRecord::new();
    while reader
        .read_byte_record(&mut record)
        .map_err(|error| csv_error(file, &error))?
    {
        for &column in columns {
            let field = record.get(column).unwrap_or_default();
            values.push(parsed(field).ok_or_else(|| {
                let line = record.position().map_or(0, |p| p.line() as usize);
                let (found, place) = (excerpt(field), place(column));
                let found = format!("found `{found}`{place} where a number was expected");
                file.malformed_at(Place::Line(line), found)
            })?);
        }
    }
    Ok(values)
}

/// As [`parse_csv`], with the other columns as fields: three consecutive ones whose names differ only in a final x, y
/// and z are a vector.
pub(super) fn parse_csv_with_fields(file: &InputFile) -> Result<RawMesh, IoError> {
    let mut raw = parse_csv(file)?;
    let mut reader = csv_reader(file);
    let header = reader.byte_headers().map_err(|error| csv_error(file, &error))?;
    let names: Vec<String> = header
        .iter()
        .map(|name| String::from_utf8_lossy(name).into_owned())
        .collect();
    // As in `parse_csv`: the first column of each name.
    let is_coordinate = |k: usize| {
        let is_named = |wanted: &str| names[k].eq_ignore_ascii_case(wanted);
        let is_first = || !names[..k].iter().any(|name| name.eq_ignore_ascii_case(&names[k]));
        ["x", "y", "z"].into_iter().any(is_named) && is_first()
    };
    let columns: Vec<usize> = (0..names.len()).filter(|&k| !is_coordinate(k)).collect();
    let values = csv_values(file, &columns, |column| {
        format!(" in the column `{}`", excerpt(names[column].as_bytes()))
    })?;
    let mut k = 0;
    while k < columns.len() {
        let three = columns[k..].iter().take(3).map(|&column| names[column].as_str());
        let (name, components) = match vector_name(&three.collect::<Vec<_>>()) {
            Some(name) => (name, 3),
            None => (names[columns[k]].clone(), 1),
        };
        let rows = values.chunks_exact(columns.len());
        raw.point_fields.push(Field {
            name,
            components,
            values: rows.flat_map(|row| &row[k..k + components]).copied().collect(),
        });
        k += components;
    }
    Ok(raw)
}

/// The common part of names such as `vx, vy, vz` or `v_x, v_y, v_z`.
fn vector_name(names: &[&str]) -> Option<String> {
    let &[x, y, z] = names else { return None };
    let stem = x.strip_suffix(['x', 'X'])?;
    let is_alike = y.strip_suffix(['y', 'Y']) == Some(stem) && z.strip_suffix(['z', 'Z']) == Some(stem);
    let name = stem.trim_end_matches(['_', '.', ' ', ':']);
    (is_alike && !name.is_empty()).then(|| name.to_owned())
}

const MAGIC: &[u8] = b"\x93NUMPY";

/// The rows of an NPY array of shape `n × 3`, in single or double precision.
pub(super) fn parse_npy(file: &InputFile) -> Result<RawMesh, IoError> {
    let (header, data) = npy_parts(file)?;
    let wrong = |found: String| file.malformed_at(Place::Byte(MAGIC.len() + 4), found);
    let entry = |key: &str| {
        let value = npy_entry(header, key);
        let header = || excerpt(header.as_bytes());
        value.ok_or_else(|| wrong(format!("the header `{}` has no entry `{key}`", header())))
    };

    let kind = entry("descr")?;
    let (scalar, order) = match kind.trim_matches(['\'', '"']) {
        "<f8" => (Scalar::F64, ByteOrder::Little),
        "<f4" => (Scalar::F32, ByteOrder::Little),
        ">f8" => (Scalar::F64, ByteOrder::Big),
        ">f4" => (Scalar::F32, ByteOrder::Big),
        _ => {
            let found = format!("an array of type {}", excerpt(kind.as_bytes()));
            return Err(file.unsupported(found, "save it as float64"));
        }
    };
    let by_columns = entry("fortran_order")? == "True";
    let shape = entry("shape")?;
    let sizes: Option<Vec<u64>> = shape
        .trim_matches(['(', ')'])
        .split_terminator(',')
        .map(|size| size.trim().parse().ok())
        .collect();
    let Some([rows, 3]) = sizes.as_deref() else {
        let shape = excerpt(shape.as_bytes());
        return Err(wrong(format!("found an array of shape {shape}, not n × 3")));
    };

    let size = scalar.size();
    let rows = file.checked_count(*rows, "rows of three numbers", 3 * size, data.len())?;
    let at = |k: usize| scalar.float(&data[k * size..], order);
    let point = |row: usize| {
        let place = |column: usize| {
            if by_columns {
                column * rows + row
            } else {
                3 * row + column
            }
        };
        Point::from([0, 1, 2].map(|column| at(place(column))))
    };
    Ok(RawMesh {
        vertices: (0..rows).map(point).collect(),
        ..RawMesh::default()
    })
}

/// The text of the header, and the data.
fn npy_parts<'a>(file: &InputFile<'a>) -> Result<(&'a str, &'a [u8]), IoError> {
    let Some(rest) = file.bytes.strip_prefix(MAGIC) else {
        return Err(file.malformed_at(Place::Byte(0), "the file does not begin with \\x93NUMPY"));
    };
    let cut_off = || file.truncated("the header");
    let (scalar, rest) = match rest {
        [1, _, rest @ ..] => (Scalar::U16, rest),
        [2 | 3, _, rest @ ..] => (Scalar::U32, rest),
        [] | [_] => return Err(cut_off()),
        [version, ..] => {
            return Err(file.unsupported(format!("NPY version {version}"), "save it with a current NumPy"));
        }
    };
    let (length, rest) = rest.split_at_checked(scalar.size()).ok_or_else(cut_off)?;
    let length = scalar.integer(length, ByteOrder::Little) as usize;
    let (header, data) = rest.split_at_checked(length).ok_or_else(cut_off)?;
    let header = std::str::from_utf8(header)
        .map_err(|_| file.malformed_at(Place::Byte(MAGIC.len() + 4), "the header is not text"))?;
    Ok((header, data))
}

/// The value of an entry of a Python dictionary of plain values and tuples.
fn npy_entry<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, after) = header.split_once(&format!("'{key}'"))?;
    let value = after.trim_start().strip_prefix(':')?.trim_start();
    let end = if value.starts_with('(') {
        value.find(')')? + 1
    } else {
        value.find([',', '}'])?
    };
    Some(value[..end].trim_end())
}

fn check_rows(path: &Path, columns: usize, values: usize) -> Result<(), IoError> {
    if columns > 0 && values.is_multiple_of(columns) || values == 0 {
        return Ok(());
    }
    let expected = values.next_multiple_of(columns.max(1));
    Err(IoError::value_count(
        path,
        format!("table of {columns} columns"),
        expected,
        values,
    ))
}

fn csv_error(file: &InputFile, error: &csv::Error) -> IoError {
    let line = error.position().map_or(1, |p| p.line() as usize);
    let found = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("found {len} columns where the header has {expected_len}")
        }
        _ => printable(error),
    };
    file.malformed_at(Place::Line(line), found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::testing::{place_of, points};

    fn npy(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn csv_columns_may_stand_in_any_order_among_others() {
        let bytes = b"\xef\xbb\xbfname, Z ,x,note,y\na,3,1,\"b, c\",2\r\n\xff,nan, -inf ,,1e-3\n";
        let points = points("csv", bytes).unwrap();
        assert_eq!(points[0], Point::new(1., 2., 3.));
        assert!(points[1].x == f64::NEG_INFINITY && points[1].y == 1e-3 && points[1].z.is_nan());
        assert_eq!(points.len(), 2);
    }

    #[test]
    fn csv_faults_are_named_by_their_line() {
        let read = |text: &str| points("csv", text.as_bytes());
        assert_eq!(read("x,y,z\n").unwrap(), []);
        assert_eq!(place_of(read("x,y\n1,2\n")), Place::Line(1));
        assert_eq!(place_of(read("")), Place::Line(1));
        assert_eq!(place_of(read("x,y,z\n1,2,3\n1,two,3\n")), Place::Line(3));
        assert_eq!(place_of(read("x,y,z\n1,2,3\n1,2\n")), Place::Line(3));
        let message = read("1,2,3\n4,5,6\n").unwrap_err().to_string();
        assert!(
            message.contains("`1,2,3`") && message.contains("x, y and z"),
            "{message}"
        );
    }

    #[test]
    fn npy_arrays_of_either_precision_and_order_are_read() {
        let expected = [Point::new(1., 2., 3.), Point::new(4., 5., 6.5)];
        let rows = [1., 2., 3., 4., 5., 6.5f64];
        let columns = [1., 4., 2., 5., 3., 6.5f64];
        let doubles = |values: [f64; 6]| values.map(f64::to_le_bytes).concat();
        let singles = rows.map(|x| (x as f32).to_be_bytes()).concat();
        for bytes in [
            npy(
                1,
                "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }  \n",
                &doubles(rows),
            ),
            npy(
                2,
                "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }\n",
                &doubles(columns),
            ),
            npy(3, "{'shape':(2,3),'fortran_order':False,'descr':\">f4\"}", &singles),
        ] {
            assert_eq!(points("npy", &bytes).unwrap(), expected);
        }
    }

    #[test]
    fn npy_faults_are_named() {
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }\n";
        let good = npy(1, header, &[0; 48]);
        assert_eq!(points("npy", &good).unwrap().len(), 2);
        let read = |from: &str, to: &str| points("npy", &npy(1, &header.replace(from, to), &[0; 48]));
        assert!(matches!(read("<f8", "<i8"), Err(IoError::Unsupported { .. })));
        assert!(matches!(read("(2, 3)", "(3, 2)"), Err(IoError::Malformed { .. })));
        assert!(matches!(read("(2, 3)", "(6,)"), Err(IoError::Malformed { .. })));
        assert!(matches!(read("(2, 3)", "(2, 3"), Err(IoError::Malformed { .. })));
        assert!(matches!(read("shape", "form"), Err(IoError::Malformed { .. })));
        assert!(matches!(
            read("(2, 3)", "(99999999999999, 3)"),
            Err(IoError::CountExceedsFile { .. })
        ));
        assert!(matches!(
            points("npy", &good[..good.len() - 1]),
            Err(IoError::CountExceedsFile { .. })
        ));
        assert!(matches!(points("npy", &good[..30]), Err(IoError::Truncated { .. })));
        assert!(matches!(
            points("npy", &npy(9, header, &[])),
            Err(IoError::Unsupported { .. })
        ));
        assert_eq!(place_of(points("npy", b"x,y,z\n1,2,3\n")), Place::Byte(0));
    }

    #[test]
    fn values_must_fill_whole_rows() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_csv(folder.path().join("a.csv"), &["a", "b"], &[1., 2., 3.]).unwrap_err();
        assert!(matches!(
            error,
            IoError::ValueCount {
                expected: 4,
                found: 3,
                ..
            }
        ));
        assert!(write_npy(folder.path().join("a.npy"), 0, &[1.]).is_err());
        assert!(write_npy(folder.path().join("a.npy"), 4, &[]).is_ok());
    }
}
