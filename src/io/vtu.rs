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
    errors::IllFormedError,
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
    read(source, false)
}

/// As [`parse`], with the fields that all pieces have.
pub(super) fn parse_with_fields(source: &Source) -> Result<Contents, IoError> {
    read(source, true)
}

fn read(source: &Source, with_fields: bool) -> Result<Contents, IoError> {
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
        let place = document.place(type_array);
        sort_cells(source, place, &mut contents, types.into_iter().zip(lists))?;
    }
    if with_fields {
        contents.point_fields = document.fields(|piece| &piece.point_data)?;
        contents.cell_fields = document.fields(|piece| &piece.cell_data)?;
    }
    Ok(contents)
}

/// A part of the grid with points of its own.
struct Piece<'a> {
    point_count: u64,
    cell_count: u64,
    points: Option<Array<'a>>,
    cells: Vec<Array<'a>>,
    point_data: Vec<Array<'a>>,
    cell_data: Vec<Array<'a>>,
}

struct Array<'a> {
    name: Cow<'a, str>,
    scalar: Scalar,
    components: usize,
    encoding: Encoding,
    /// What stands between the tags, up to elements that VTK adds after the numbers.
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
    /// Where in the appended data any array begins.
    offsets: Vec<usize>,
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
            offsets: vec![],
        };
        // The reader would leave out a byte order mark, but not count it.
        let shift = if xml.starts_with('\u{feff}') { 3 } else { 0 };
        let mut reader = Reader::from_str(&xml[shift..]);
        let (mut rooted, mut ended) = (false, false);
        // The element whose arrays are wanted.
        let mut section = String::new();
        loop {
            let at = shift + reader.buffer_position() as usize;
            let event = reader.read_event();
            let event = event.map_err(|error| xml_error(source, shift + reader.error_position() as usize, &error))?;
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
            let offset = tag.attribute("offset")?;
            document
                .offsets
                .extend(offset.and_then(|offset| offset.trim().parse::<usize>().ok()));
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
                    point_data: vec![],
                    cell_data: vec![],
                }),
                name @ ("Points" | "Cells" | "PointData" | "CellData") if !empty => section = name.to_owned(),
                "DataArray" if !section.is_empty() => {
                    let start = shift + reader.buffer_position() as usize;
                    let mut end = start;
                    if !empty {
                        let span = reader.read_to_end(tag.tag.name());
                        let span = span.map_err(|error| xml_error(source, start, &error))?;
                        end = shift + span.end as usize;
                    }
                    let array = tag.array(start..end);
                    let Some(piece) = document.pieces.last_mut() else {
                        continue;
                    };
                    match section.as_str() {
                        "Points" => piece.points = Some(array?),
                        "Cells" => piece.cells.push(array?),
                        // Of fields those of numbers count; others, such as texts, are passed over.
                        "PointData" => piece.point_data.extend(array.ok()),
                        _ => piece.cell_data.extend(array.ok()),
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

    /// The fields that every piece has, one piece after the other.
    fn fields<'d>(&'d self, data: impl Fn(&'d Piece<'a>) -> &'d Vec<Array<'a>>) -> Result<Vec<Field>, IoError> {
        let mut fields = Vec::new();
        for first in self.pieces.first().map(&data).into_iter().flatten() {
            let is_same = |array: &&Array| array.name == first.name && array.components == first.components;
            let arrays: Option<Vec<&Array>> = self
                .pieces
                .iter()
                .map(|piece| data(piece).iter().find(is_same))
                .collect();
            let mut values = Vec::new();
            let Some(arrays) = arrays else { continue };
            for array in arrays {
                values.extend(self.floats(array)?);
            }
            fields.push(Field {
                name: first.name.to_string(),
                components: first.components,
                values,
            });
        }
        Ok(fields)
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
                    let next = self.offsets.iter().filter(|&&next| next > offset).min();
                    let length = next.map_or(data.len(), |next| data.len().min(next - offset));
                    Cow::Owned(decode_base64(&data[..length]).map_err(invalid)?)
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

/// What is not closed at the end of the file was cut off.
fn xml_error(source: &Source, position: usize, error: &quick_xml::Error) -> IoError {
    match error {
        quick_xml::Error::Syntax(_) | quick_xml::Error::IllFormed(IllFormedError::MissingEndTag(_)) => {
            source.truncated("the XML structure")
        }
        _ => source.malformed(position, error.to_string()),
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
        let length = padding.max(1).next_multiple_of(4).min(rest.len());
        let (part, tail) = rest.split_at(length);
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
        let inner = &self.source.bytes[text.clone()];
        let length = inner.iter().position(|&b| b == b'<').unwrap_or(inner.len());
        let components = self.attribute("NumberOfComponents")?;
        Ok(Array {
            name: self.attribute("Name")?.unwrap_or_default(),
            components: components.and_then(|n| n.trim().parse().ok()).unwrap_or(1),
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
            text: text.start..text.start + length,
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
    writeln!(writer, "<?xml version=\"1.0\"?>")?;
    if !fields.comment.is_empty() {
        // Two hyphens beside each other would end a comment.
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

#[cfg(test)]
mod tests {
    use flate2::{Compression, write::ZlibEncoder};

    use super::*;
    use crate::io::{
        Solid,
        testing::{place_of, solid, surface, tets},
    };

    /// How a test file stores its arrays.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Storage {
        Text,
        Inline,
        AppendedRaw,
        AppendedBase64,
    }

    /// Writes the arrays of a file in any of the ways that VTK has.
    struct Builder {
        storage: Storage,
        order: ByteOrder,
        wide_header: bool,
        /// Bytes in a compressed block.
        block: Option<usize>,
        appended: Vec<u8>,
    }

    impl Builder {
        fn turned(&self, mut bytes: Vec<u8>) -> Vec<u8> {
            if self.order == ByteOrder::Big {
                bytes.reverse();
            }
            bytes
        }

        fn lengths(&self, lengths: &[usize]) -> Vec<u8> {
            let bytes = |&n: &usize| match self.wide_header {
                true => self.turned((n as u64).to_le_bytes().to_vec()),
                false => self.turned((n as u32).to_le_bytes().to_vec()),
            };
            lengths.iter().flat_map(bytes).collect()
        }

        fn array(&mut self, attributes: &str, values: &[f64]) -> String {
            let bytes: Vec<u8> = values
                .iter()
                .flat_map(|&x| {
                    self.turned(match attributes {
                        a if a.contains("Float64") => x.to_le_bytes().to_vec(),
                        a if a.contains("Float32") => (x as f32).to_le_bytes().to_vec(),
                        a if a.contains("Int64") => (x as i64).to_le_bytes().to_vec(),
                        a if a.contains("Int32") => (x as i32).to_le_bytes().to_vec(),
                        _ => vec![x as u8],
                    })
                })
                .collect();
            let (head, data) = match self.block {
                None => (self.lengths(&[bytes.len()]), bytes),
                Some(size) => {
                    let zip = |block: &[u8]| {
                        let mut encoder = ZlibEncoder::new(vec![], Compression::default());
                        encoder.write_all(block).unwrap();
                        encoder.finish().unwrap()
                    };
                    let blocks: Vec<_> = bytes.chunks(size).map(zip).collect();
                    let mut lengths = vec![blocks.len(), size, bytes.len() % size];
                    lengths.extend(blocks.iter().map(Vec::len));
                    (self.lengths(&lengths), blocks.concat())
                }
            };
            let base64 = || STANDARD.encode(&head) + &STANDARD.encode(&data);
            let (format, offset) = match self.storage {
                Storage::Text => ("ascii", None),
                Storage::Inline => ("binary", None),
                _ => ("appended", Some(self.appended.len())),
            };
            let text = match self.storage {
                Storage::Text => values.iter().map(|x| format!("{x} ")).collect(),
                Storage::Inline => format!("\n  {}\n", base64()),
                _ => String::new(),
            };
            match self.storage {
                Storage::AppendedRaw => self.appended.extend([head, data].concat()),
                Storage::AppendedBase64 => self.appended.extend(base64().as_bytes()),
                _ => {}
            }
            let offset = offset.map_or(String::new(), |offset| format!(" offset=\"{offset}\""));
            match text.as_str() {
                "" => format!("<DataArray {attributes} format=\"{format}\"{offset}/>\n"),
                // VTK adds the norms of an array after its numbers.
                text => format!("<DataArray {attributes} format=\"{format}\">{text}<InformationKey/></DataArray>\n"),
            }
        }

        /// Two pieces: a tetrahedron with a triangle, and a tetrahedron of the other hand.
        fn file(mut self) -> Vec<u8> {
            let order = if self.order == ByteOrder::Big {
                "BigEndian"
            } else {
                "LittleEndian"
            };
            let header = if self.wide_header {
                " header_type=\"UInt64\""
            } else {
                ""
            };
            let zlib = if self.block.is_some() {
                " compressor=\"vtkZLibDataCompressor\""
            } else {
                ""
            };
            let mut xml = format!(
                "<?xml version=\"1.0\"?>\n<!-- <Points> -->\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
                 byte_order=\"{order}\"{header}{zlib}>\n<UnstructuredGrid>\n<FieldData>\n"
            );
            xml += &self.array("type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\"", &[0.5]);
            let float = "type=\"Float32\" Name=\"Points\" NumberOfComponents=\"3\"";
            let double = float.replace("32", "64");
            let points = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
            let odd = [0., 0., f64::NAN, 1., 0., f64::INFINITY, 0., 1., 0., 0., 0., -1.5];
            for (kind, points, connectivity, offsets, types) in [
                (
                    float,
                    points,
                    &[0., 1., 2., 3., 0., 1., 2.][..],
                    &[4., 7.][..],
                    &[10., 5.][..],
                ),
                (&double, odd, &[1., 0., 2., 3.], &[4.], &[10.]),
            ] {
                xml += &format!(
                    "</FieldData>\n<Piece NumberOfPoints='4' NumberOfCells='{}'>\n<PointData>\n",
                    types.len()
                );
                xml += &self.array("type=\"Float64\" Name=\"connectivity\"", &[1., 2., 3., 4.]);
                xml += &format!(
                    "</PointData>\n<Points>\n{}</Points>\n<Cells>\n",
                    self.array(kind, &points)
                );
                xml += &self.array("type=\"UInt8\" Name=\"types\"", types);
                xml += &self.array("type=\"Int32\" Name=\"offsets\"", offsets);
                xml += &self.array("type=\"Int64\" Name=\"connectivity\"", connectivity);
                xml += "</Cells>\n</Piece>\n<FieldData>\n";
            }
            xml += "</FieldData>\n</UnstructuredGrid>\n";
            let mut bytes = xml.into_bytes();
            if matches!(self.storage, Storage::AppendedRaw | Storage::AppendedBase64) {
                let encoding = if self.storage == Storage::AppendedRaw {
                    "raw"
                } else {
                    "base64"
                };
                bytes.extend(format!("<AppendedData encoding=\"{encoding}\">\n   _").bytes());
                bytes.extend(self.appended);
                bytes.extend(b"\n</AppendedData>\n");
            }
            bytes.extend(b"</VTKFile>\n");
            bytes
        }
    }

    /// Every way of storing numbers, each as a file of the same grid.
    fn all_files() -> Vec<(String, Vec<u8>)> {
        let mut files = Vec::new();
        for storage in [
            Storage::Text,
            Storage::Inline,
            Storage::AppendedRaw,
            Storage::AppendedBase64,
        ] {
            for order in [ByteOrder::Little, ByteOrder::Big] {
                for wide_header in [false, true] {
                    for block in [None, Some(1 << 15), Some(10)] {
                        let builder = Builder {
                            storage,
                            order,
                            wide_header,
                            block,
                            appended: vec![],
                        };
                        files.push((format!("{storage:?} {order:?} {wide_header} {block:?}"), builder.file()));
                    }
                }
            }
        }
        files
    }

    #[test]
    fn every_encoding_byte_order_and_compression_reads_the_same() {
        for (name, bytes) in all_files() {
            let mesh = tets("vtu", &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(mesh.tets(), [[0, 1, 2, 3], [5, 4, 6, 7]], "{name}");
            assert_eq!(mesh.vertices()[3], Point::new(0., 0., 1.), "{name}");
            assert!(
                mesh.vertices()[4].z.is_nan() && mesh.vertices()[5].z == f64::INFINITY,
                "{name}"
            );
            assert_eq!(mesh.vertices()[7].z, -1.5, "{name}");
            assert!(matches!(solid("vtu", &bytes), Ok(Solid::Tets(_))));
        }
    }

    #[test]
    fn padding_without_digits_is_refused() {
        assert_eq!(decode_base64(b" AAEC Aw== BA== <").unwrap(), [0, 1, 2, 3, 4]);
        assert!(decode_base64(b"====").is_err());
        assert!(decode_base64(b"AAEC=").is_err());
        assert!(decode_base64(b"AAE").is_err());
    }

    #[test]
    fn a_byte_order_mark_is_passed_over() {
        for (name, bytes) in all_files() {
            let marked = [b"\xef\xbb\xbf", bytes.as_slice()].concat();
            assert_eq!(tets("vtu", &marked).unwrap().tets().len(), 2, "{name}");
        }
    }

    #[test]
    fn lengths_and_data_may_be_encoded_together() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtu");
        let points = [[0., 0., 0.], [1., 0., 0.], [0., 0.1, 0.]].map(Point::from);
        write_vtu(&path, &points, Cells::Triangles(&[[2, 1, 0]]), &VtkFields::default()).unwrap();
        let mesh = surface("vtu", &std::fs::read(&path).unwrap()).unwrap();
        assert_eq!((mesh.vertices(), mesh.triangles()), (&points[..], &[[2, 1, 0]][..]));
    }

    #[test]
    fn names_of_fields_are_escaped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtu");
        let fields = VtkFields {
            point: vec![Field {
                name: "|f| < \"1\" & more".into(),
                components: 1,
                values: vec![1., 2., 3.],
            }],
            comment: "from <a>--b---c-".into(),
            ..VtkFields::default()
        };
        write_vtu(&path, &[Point::origin(); 3], Cells::Triangles(&[[0, 1, 2]]), &fields).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(surface("vtu", &bytes).is_ok());
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains("Name=\"|f| &lt; &quot;1&quot; &amp; more\""));
        assert!(text.contains("<!-- from <a>- -b- - -c- -->"), "{text}");
    }

    #[test]
    fn faults_are_named() {
        let files = all_files();
        let text = String::from_utf8(files[0].1.clone()).unwrap();
        let read = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            tets("vtu", text.replacen(from, to, 1).as_bytes())
        };
        assert!(read("LittleEndian", "LittleEndian").is_ok());
        assert_eq!(
            place_of(tets("vtu", text.replace("VTKFile", "File").as_bytes())),
            Place::Line(1)
        );
        assert_eq!(place_of(read("NumberOfPoints='4'", "")), Place::Line(8));
        assert_eq!(
            place_of(read("NumberOfPoints='4'", "NumberOfPoints='four'")),
            Place::Line(8)
        );
        let before = text.split("</UnstructuredGrid>").next().unwrap();
        let line = Place::Line(before.split('\n').count());
        assert_eq!(place_of(read("</UnstructuredGrid>", "</Grid>")), line);
        assert!(matches!(
            read("NumberOfPoints='4'", "NumberOfPoints='5'"),
            Err(IoError::Malformed { .. })
        ));
        assert!(matches!(
            read("NumberOfCells='2'", "NumberOfCells='999999999999'"),
            Err(IoError::Malformed { .. })
        ));
        assert!(matches!(read("Float32", "Float31"), Err(IoError::Malformed { .. })));
        assert!(matches!(
            read("0 1 2 3 0 1 2", "0 1 2 three 0 1 2"),
            Err(IoError::Malformed { .. })
        ));
        assert!(matches!(read(">4 7 <", ">4 8 <"), Err(IoError::Malformed { .. })));
        assert!(matches!(
            read("0 1 2 3 0 1 2", "0 1 2 9 0 1 2"),
            Err(IoError::IndexOutOfRange { vertex: 9, .. })
        ));
        assert!(matches!(read(">10 5 <", ">14 5 <"), Err(IoError::Unsupported { .. })));
        assert!(matches!(
            read("type=\"UnstructuredGrid\"", "type=\"ImageData\""),
            Err(IoError::Unsupported { .. })
        ));
        assert!(matches!(
            read("version=\"1.0\" byte", "compressor=\"vtkLZ4DataCompressor\" byte"),
            Err(IoError::Unsupported { .. })
        ));
        assert!(matches!(
            tets("vtu", &files[0].1[..text.len() - 15]),
            Err(IoError::Truncated { .. })
        ));
        assert!(matches!(tets("vtu", b"hello"), Err(IoError::Malformed { .. })));

        let inline = &files[13].1;
        let spoiled = String::from_utf8(inline.clone()).unwrap().replacen("\n  ", "\n  !", 3);
        assert!(matches!(
            tets("vtu", spoiled.as_bytes()),
            Err(IoError::Malformed { .. })
        ));
        let (name, raw) = &files[24];
        assert_eq!(name, "AppendedRaw Little false None");
        assert!(matches!(
            tets("vtu", &raw[..raw.len() - 70]),
            Err(IoError::Truncated { .. })
        ));
    }

    #[test]
    fn a_cut_or_spoiled_file_is_an_error_or_read_never_a_panic() {
        use rand::{Rng, SeedableRng, rngs::StdRng};

        const CLOSING_TAGS: usize = 30;
        let mut random = StdRng::seed_from_u64(7);
        for (_, bytes) in all_files().into_iter().step_by(5) {
            for end in (0..bytes.len() - CLOSING_TAGS).step_by(7) {
                assert!(solid("vtu", &bytes[..end]).is_err(), "{end}");
            }
            for _ in 0..200 {
                let mut spoiled = bytes.clone();
                for _ in 0..random.random_range(1..4) {
                    let at = random.random_range(0..spoiled.len());
                    spoiled[at] ^= 1 << random.random_range(0..8);
                }
                let _ = solid("vtu", &spoiled);
            }
        }
    }
}
