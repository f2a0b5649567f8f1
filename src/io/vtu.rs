//! VTK's XML format for unstructured grids (`.vtu`), which ParaView reads and writes.
//!
//! Reading: numbers as text, base64 or appended (raw or base64), plain or compressed by zlib. Writing: base64 in
//! place, uncompressed, which every reader of the format takes and which is valid XML.

use std::{
    borrow::Cow,
    io::{self, Read, Write},
    ops::Range,
    path::Path,
};

use base64::{Engine, engine::general_purpose::STANDARD, write::EncoderWriter};
use flate2::read::ZlibDecoder;
use quick_xml::{
    Reader,
    escape::escape,
    events::{BytesStart, Event},
};

use super::{
    Cells, Field, IoError, Place, VtkFields, atomic_write,
    contents::Contents,
    source::{ByteOrder, Scalar, Source, excerpt},
    vtk::{check, list_ends, sort_cells},
};
use crate::Point;

/// Writes an unstructured grid with double-precision coordinates and fields.
///
/// # Errors
///
/// [`IoError::IndexOutOfRange`], [`IoError::ValueCount`] for a field that does not fit the mesh, [`IoError::Write`].
pub fn write_vtu(path: impl AsRef<Path>, points: &[Point], cells: Cells, fields: &VtkFields) -> Result<(), IoError> {
    check(path.as_ref(), points, cells, fields)?;
    atomic_write(path, |writer| write(writer, points, cells, fields))
}

/// The points and cells of all pieces, one after the other, in file order. Fields are passed over.
pub(super) fn parse(source: &Source) -> Result<Contents, IoError> {
    let document = Document::parse(source)?;
    let mut contents = Contents::default();
    for piece in &document.pieces {
        let first = contents.vertices.len() as i64;
        let within = |kind: &str| source.truncated(format!("a piece without {kind}"));
        let points = piece.points.as_ref().ok_or_else(|| within("Points"))?;
        let cell_array = |name: &str| {
            let named = piece.cells.iter().find(|array| array.name == name);
            named.ok_or_else(|| within(name))
        };

        let coordinates = document.floats(points)?;
        document.expect_length(points, coordinates.len() as u64, piece.point_count.checked_mul(3))?;
        let triples = coordinates.chunks_exact(3);
        contents.vertices.extend(triples.map(|p| Point::new(p[0], p[1], p[2])));

        let offset_array = cell_array("offsets")?;
        let offsets = document.integers(offset_array)?;
        document.expect_length(offset_array, offsets.len() as u64, Some(piece.cell_count))?;
        let type_array = cell_array("types")?;
        let types = document.integers(type_array)?;
        document.expect_length(type_array, types.len() as u64, Some(piece.cell_count))?;
        let mut corners = document.integers(cell_array("connectivity")?)?;
        corners.iter_mut().for_each(|v| *v = v.saturating_add(first));
        let Some(ends) = list_ends(offsets, corners.len()) else {
            let place = document.place(offset_array);
            return Err(source.malformed_at(place, "the offsets do not ascend within the connectivity"));
        };
        let starts = std::iter::once(0).chain(ends.iter().copied());
        let lists = starts.zip(&ends).map(|(start, &end)| &corners[start..end]);
        sort_cells(source, &mut contents, types.into_iter().zip(lists))?;
    }
    Ok(contents)
}

/// A part of the grid with points of its own.
struct Piece<'a> {
    point_count: u64,
    cell_count: u64,
    points: Option<Array<'a>>,
    cells: Vec<Array<'a>>,
}

struct Array<'a> {
    name: Cow<'a, str>,
    scalar: Scalar,
    encoding: Encoding,
    /// What stands between the tags.
    text: Range<usize>,
}

enum Encoding {
    Text,
    Base64,
    /// At this offset in the appended data.
    Appended(usize),
}

/// The structure of a file, before any numbers are decoded.
struct Document<'a> {
    source: &'a Source<'a>,
    order: ByteOrder,
    /// The type of the lengths before each block of binary data.
    header: Scalar,
    compressed: bool,
    pieces: Vec<Piece<'a>>,
    /// Appended data after the `_`, and whether they are in base64.
    appended: Option<(&'a [u8], bool)>,
}

impl<'a> Document<'a> {
    fn parse(source: &'a Source<'a>) -> Result<Self, IoError> {
        let (xml, appended) = split_appended(source)?;
        let mut document = Self {
            source,
            order: ByteOrder::Little,
            header: Scalar::U32,
            compressed: false,
            pieces: vec![],
            appended: None,
        };
        let mut reader = Reader::from_str(xml);
        let (mut rooted, mut ended) = (false, false);
        // The element whose arrays are wanted: `Points` or `Cells`.
        let mut section = String::new();
        loop {
            let at = reader.buffer_position() as usize;
            let event = reader.read_event();
            let event = event.map_err(|error| source.malformed(reader.error_position() as usize, error.to_string()))?;
            let (tag, empty) = match event {
                Event::Start(tag) => (tag, false),
                Event::Empty(tag) => (tag, true),
                Event::End(tag) => {
                    ended |= tag.name().as_ref() == "VTKFile";
                    if tag.name().as_ref() == section {
                        section.clear();
                    }
                    continue;
                }
                Event::Eof => break,
                _ => continue,
            };
            let tag = Tag { source, tag, at };
            match tag.tag.name().as_ref() {
                "VTKFile" => {
                    document.read_root(&tag)?;
                    rooted = true;
                }
                "Piece" => document.pieces.push(Piece {
                    point_count: tag.count("NumberOfPoints")?,
                    cell_count: tag.count("NumberOfCells")?,
                    points: None,
                    cells: vec![],
                }),
                name @ ("Points" | "Cells") if !empty => section = name.to_owned(),
                "DataArray" if !section.is_empty() => {
                    let start = reader.buffer_position() as usize;
                    let mut end = start;
                    if !empty {
                        let span = reader.read_to_end(tag.tag.name());
                        let span = span.map_err(|error| source.malformed(start, error.to_string()))?;
                        end = span.end as usize;
                    }
                    let array = tag.array(start..end)?;
                    match document.pieces.last_mut() {
                        Some(piece) if section == "Points" => piece.points = Some(array),
                        Some(piece) => piece.cells.push(array),
                        None => {}
                    }
                }
                "AppendedData" => {
                    let base64 = tag.attribute("encoding")?.is_some_and(|encoding| encoding == "base64");
                    document.appended = appended.map(|data| (data, base64));
                    ended = true;
                    break;
                }
                _ => {}
            }
        }
        if !rooted {
            return Err(source.malformed(0, "there is no element `VTKFile`"));
        }
        if !ended || document.pieces.is_empty() {
            return Err(source.truncated("the XML structure"));
        }
        Ok(document)
    }

    fn read_root(&mut self, tag: &Tag<'a>) -> Result<(), IoError> {
        let attribute = |name: &str| tag.attribute(name).map(Option::unwrap_or_default);
        let kind = attribute("type")?;
        if kind != "UnstructuredGrid" {
            let found = format!("a VTK data set of type `{}`", excerpt(kind.as_bytes()));
            return Err(self.source.unsupported(found, "save it as an unstructured grid"));
        }
        self.order = match attribute("byte_order")?.as_ref() {
            "BigEndian" => ByteOrder::Big,
            _ => ByteOrder::Little,
        };
        self.header = match attribute("header_type")?.as_ref() {
            "UInt64" => Scalar::U64,
            _ => Scalar::U32,
        };
        self.compressed = match attribute("compressor")?.as_ref() {
            "" => false,
            "vtkZLibDataCompressor" => true,
            other => {
                let found = format!("data compressed by `{}`", excerpt(other.as_bytes()));
                return Err(self
                    .source
                    .unsupported(found, "save it with ZLib or without compression"));
            }
        };
        Ok(())
    }

    fn floats(&self, array: &Array) -> Result<Vec<f64>, IoError> {
        if let Encoding::Text = array.encoding {
            let mut tokens = self.source.tokens_in(array.text.clone());
            let mut values = Vec::new();
            while tokens.peek().is_some() {
                values.push(tokens.float("a DataArray")?);
            }
            return Ok(values);
        }
        let bytes = self.decoded(array)?;
        let values = bytes.chunks_exact(array.scalar.size());
        Ok(values.map(|b| array.scalar.float(b, self.order)).collect())
    }

    fn integers(&self, array: &Array) -> Result<Vec<i64>, IoError> {
        if let Encoding::Text = array.encoding {
            let mut tokens = self.source.tokens_in(array.text.clone());
            let mut values = Vec::new();
            while tokens.peek().is_some() {
                values.push(tokens.integer("a DataArray")?);
            }
            return Ok(values);
        }
        let bytes = self.decoded(array)?;
        let values = bytes.chunks_exact(array.scalar.size());
        Ok(values.map(|b| array.scalar.integer(b, self.order)).collect())
    }

    /// The bytes of an array, decoded and decompressed.
    fn decoded(&self, array: &Array) -> Result<Cow<'a, [u8]>, IoError> {
        let invalid = |found: String| self.source.malformed_at(self.place(array), found);
        let cut_off = || {
            self.source
                .truncated(format!("the array `{}`", excerpt(array.name.as_bytes())))
        };
        let stored = match array.encoding {
            Encoding::Appended(offset) => {
                let (data, base64) = self
                    .appended
                    .ok_or_else(|| self.source.truncated("the appended data"))?;
                let data = data.get(offset..).ok_or_else(cut_off)?;
                if base64 {
                    Cow::Owned(decode_base64(data).map_err(invalid)?)
                } else {
                    Cow::Borrowed(data)
                }
            }
            _ => Cow::Owned(decode_base64(&self.source.bytes[array.text.clone()]).map_err(invalid)?),
        };
        // An empty array may lack even its length.
        if stored.is_empty() {
            return Ok(stored);
        }
        if self.compressed {
            return Ok(Cow::Owned(
                self.decompressed(&stored).ok_or_else(cut_off)?.map_err(invalid)?,
            ));
        }
        let start = self.header.size();
        let length = self.length(&stored, 0).ok_or_else(cut_off)?;
        let range = start..start.checked_add(length).ok_or_else(cut_off)?;
        match stored {
            Cow::Borrowed(bytes) => bytes.get(range).map(Cow::Borrowed),
            Cow::Owned(mut bytes) => (range.end <= bytes.len()).then(|| {
                bytes.truncate(range.end);
                bytes.drain(..start);
                Cow::Owned(bytes)
            }),
        }
        .ok_or_else(cut_off)
    }

    /// Lengths (number of blocks, size of a block, size of the last or 0, compressed size of each) and then the blocks.
    /// `None` when they end early.
    fn decompressed(&self, stored: &[u8]) -> Option<Result<Vec<u8>, String>> {
        let blocks = self.length(stored, 0)?;
        let (full, last) = (self.length(stored, 1)?, self.length(stored, 2)?);
        let mut rest = stored.get(blocks.checked_add(3)?.checked_mul(self.header.size())?..)?;
        let mut bytes = Vec::new();
        for block in 0..blocks {
            let (compressed, tail) = rest.split_at_checked(self.length(stored, 3 + block)?)?;
            rest = tail;
            let expected = if block + 1 == blocks && last > 0 { last } else { full };
            let before = bytes.len();
            let mut decoder = ZlibDecoder::new(compressed).take(expected as u64 + 1);
            if let Err(error) = decoder.read_to_end(&mut bytes) {
                return Some(Err(format!("a compressed block cannot be read: {error}")));
            }
            if bytes.len() - before != expected {
                return Some(Err(format!(
                    "a compressed block does not hold the {expected} bytes announced"
                )));
            }
        }
        Some(Ok(bytes))
    }

    /// The `k`-th number of the header of binary data.
    fn length(&self, stored: &[u8], k: usize) -> Option<usize> {
        let size = self.header.size();
        let bytes = stored.get(k.checked_mul(size)?..)?.get(..size)?;
        usize::try_from(self.header.integer(bytes, self.order)).ok()
    }

    fn expect_length(&self, array: &Array, found: u64, expected: Option<u64>) -> Result<(), IoError> {
        if expected == Some(found) {
            return Ok(());
        }
        let wanted = expected.map_or_else(|| "too many".to_owned(), |n| n.to_string());
        let found = format!("the array holds {found} values, but its piece needs {wanted}");
        Err(self.source.malformed_at(self.place(array), found))
    }

    fn place(&self, array: &Array) -> Place {
        Place::Byte(array.text.start)
    }
}

/// The XML up to and including the tag `AppendedData`, and what follows its `_`.
fn split_appended<'a>(source: &Source<'a>) -> Result<(&'a str, Option<&'a [u8]>), IoError> {
    const TAG: &[u8] = b"<AppendedData";
    let bytes = source.bytes;
    let (xml, appended) = match bytes.windows(TAG.len()).position(|window| window == TAG) {
        None => (bytes, None),
        Some(start) => {
            let find = |from: usize, wanted: u8| {
                let found = bytes[from..].iter().position(|&b| b == wanted).map(|k| from + k + 1);
                found.ok_or_else(|| source.truncated("the appended data"))
            };
            let tag_end = find(start, b'>')?;
            (&bytes[..tag_end], Some(&bytes[find(tag_end, b'_')?..]))
        }
    };
    match std::str::from_utf8(xml) {
        Ok(xml) => Ok((xml, appended)),
        Err(error) => Err(source.malformed_at(Place::Byte(error.valid_up_to()), "the XML is not UTF-8 text")),
    }
}

/// Decodes base64 up to the first `<` or the end. Lengths and data may be encoded apart, so that padding stands in
/// the middle.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let text = text.split(|&b| b == b'<').next().unwrap_or_default();
    let text: Vec<u8> = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let mut rest = text.as_slice();
    while !rest.is_empty() {
        let padding = rest.iter().position(|&b| b == b'=').unwrap_or(rest.len());
        let (part, tail) = rest.split_at(padding.next_multiple_of(4).min(rest.len()));
        STANDARD
            .decode_vec(part, &mut bytes)
            .map_err(|error| format!("base64: {error}"))?;
        rest = tail;
    }
    Ok(bytes)
}

/// A start tag at the byte `at`.
struct Tag<'a> {
    source: &'a Source<'a>,
    tag: BytesStart<'a>,
    at: usize,
}

impl<'a> Tag<'a> {
    fn attribute(&self, name: &str) -> Result<Option<Cow<'a, str>>, IoError> {
        let found = self.tag.try_get_attribute(name);
        let found = found.map_err(|error| self.source.malformed(self.at, error.to_string()))?;
        Ok(found.map(|attribute| Cow::Owned(attribute.value.into_owned())))
    }

    fn required(&self, name: &str) -> Result<Cow<'a, str>, IoError> {
        self.attribute(name)?.ok_or_else(|| {
            let tag = excerpt(self.tag.name().as_ref().as_bytes());
            self.source
                .malformed(self.at, format!("the element `{tag}` lacks the attribute `{name}`"))
        })
    }

    fn count(&self, name: &str) -> Result<u64, IoError> {
        let value = self.required(name)?;
        value.trim().parse().map_err(|_| self.refused(name, &value))
    }

    fn array(&self, text: Range<usize>) -> Result<Array<'a>, IoError> {
        let kind = self.required("type")?;
        let format = self.required("format")?;
        Ok(Array {
            name: self.attribute("Name")?.unwrap_or_default(),
            scalar: scalar(&kind).ok_or_else(|| self.refused("type", &kind))?,
            encoding: match format.as_ref() {
                "ascii" => Encoding::Text,
                "binary" => Encoding::Base64,
                "appended" => {
                    let offset = self.required("offset")?;
                    Encoding::Appended(offset.trim().parse().map_err(|_| self.refused("offset", &offset))?)
                }
                _ => return Err(self.refused("format", &format)),
            },
            text,
        })
    }

    fn refused(&self, name: &str, value: &str) -> IoError {
        let value = excerpt(value.as_bytes());
        self.source
            .malformed(self.at, format!("the attribute {name}=\"{value}\" has no meaning"))
    }
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "Int8" => Scalar::I8,
        "UInt8" => Scalar::U8,
        "Int16" => Scalar::I16,
        "UInt16" => Scalar::U16,
        "Int32" => Scalar::I32,
        "UInt32" => Scalar::U32,
        "Int64" => Scalar::I64,
        "UInt64" => Scalar::U64,
        "Float32" => Scalar::F32,
        "Float64" => Scalar::F64,
        _ => return None,
    })
}

fn write(writer: &mut dyn Write, points: &[Point], cells: Cells, fields: &VtkFields) -> io::Result<()> {
    let corners = cells.flat().len() / cells.count().max(1);
    writeln!(
        writer,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
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
    let types = (0..cells.count()).map(|_| [cells.vtk_type()]);
    write_array(writer, "UInt8", "types", 1, cells.count(), types)?;
    writeln!(writer, "</Cells>")?;
    write_fields(writer, "PointData", &fields.point)?;
    write_fields(writer, "CellData", &fields.cell)?;
    writeln!(writer, "</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

fn write_fields(writer: &mut dyn Write, element: &str, fields: &[Field]) -> io::Result<()> {
    writeln!(writer, "<{element}>")?;
    for Field {
        name,
        components,
        values,
    } in fields
    {
        let bytes = values.iter().map(|x| x.to_le_bytes());
        write_array(
            writer,
            "Float64",
            &escape(name.as_str()),
            *components,
            values.len(),
            bytes,
        )?;
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
    write!(
        writer,
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">"
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
