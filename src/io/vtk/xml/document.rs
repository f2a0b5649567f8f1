//! The structure of a file: pieces, arrays and the locations of their data.

use std::{borrow::Cow, cell::Cell, ops::Range, str::FromStr};

use quick_xml::{
    Reader,
    errors::IllFormedError,
    events::{BytesEnd, BytesStart, Event},
};

use crate::io::{
    IoError, Place,
    input::{ByteOrder, InputFile, Scalar, excerpt, printable},
};

/// The kinds of data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataSet {
    UnstructuredGrid,
    ImageData,
}

/// The lattice of image data.
#[derive(Debug, Clone, Copy)]
pub(super) struct Image {
    /// First and last index along each axis, over all pieces.
    pub whole: [i32; 6],
    /// The point with indices 0.
    pub origin: [f64; 3],
    pub spacing: [f64; 3],
    /// The 3 × 3 matrix whose columns are unit vectors along the axes, row by row.
    pub direction: [f64; 9],
}

/// A part of the data set with points of its own.
#[derive(Default)]
pub(super) struct XmlPiece<'a> {
    /// Numbers of points and cells, in unstructured grids.
    pub point_count: u64,
    pub cell_count: u64,
    /// First and last index along each axis, in image data.
    pub extent: [i32; 6],
    pub points: Option<Array<'a>>,
    pub cells: Vec<Array<'a>>,
    pub point_data: Vec<Array<'a>>,
    pub cell_data: Vec<Array<'a>>,
}

pub(super) struct Array<'a> {
    pub name: Cow<'a, str>,
    pub scalar: Scalar,
    pub components: usize,
    pub encoding: Encoding,
    /// The text between the tags, up to elements that VTK adds after the numbers.
    pub text: Range<usize>,
}

pub(super) enum Encoding {
    Text,
    Base64,
    /// At this offset in the appended data.
    Appended(usize),
}

/// The structure of a file, before any numbers are decoded.
pub(super) struct Document<'a> {
    pub file: &'a InputFile<'a>,
    pub order: ByteOrder,
    /// The type of the lengths before each block of binary data.
    pub header: Scalar,
    pub compressed: bool,
    pub image: Option<Image>,
    pub pieces: Vec<XmlPiece<'a>>,
    /// Appended data after the `_`, and whether they are in base64.
    pub appended: Option<(&'a [u8], bool)>,
    /// The offsets of all arrays in the appended data, ascending.
    pub offsets: Vec<usize>,
    /// Bytes that may still be allocated for unpacked data.
    budget: Cell<usize>,
}

/// Limit of unpacked data: [`MIN_BUDGET`] bytes, enough for three bytes at every point of an image, plus
/// [`MAX_EXPANSION`] times the size of the file. Meshes are compressed to a twentieth at best.
const MIN_BUDGET: usize = 128 << 20;
const MAX_EXPANSION: usize = 200;

impl<'a> Document<'a> {
    /// The structure of a file with this kind of data set.
    pub fn parse(file: &'a InputFile<'a>, data_set: DataSet) -> Result<Self, IoError> {
        let (xml, appended) = split_appended(file)?;
        let mut document = Self {
            file,
            order: ByteOrder::Little,
            header: Scalar::U32,
            compressed: false,
            image: None,
            pieces: vec![],
            appended: None,
            offsets: vec![],
            budget: Cell::new(unpacking_budget(file)),
        };
        let mut tags = Tags::new(file, xml);
        let (mut rooted, mut ended) = (false, false);
        let mut section = None;
        while let Some(step) = tags.next()? {
            let tag = match step {
                TagEvent::Begin(tag) => tag,
                TagEvent::End(tag) => {
                    let name = tag.name();
                    ended |= name.as_ref() == "VTKFile";
                    section = section.filter(|within| Section::of_name(name.as_ref()) != Some(*within));
                    continue;
                }
            };
            let offset = tag.attribute("offset")?;
            let offset = offset.and_then(|offset| offset.trim().parse::<usize>().ok());
            document.offsets.extend(offset);
            match (tag.tag.name().as_ref(), section) {
                ("VTKFile", _) => {
                    document.read_root(&tag, data_set)?;
                    rooted = true;
                }
                ("ImageData", _) => document.image = Some(tag.image()?),
                ("Piece", _) => document.pieces.push(tag.piece(data_set)?),
                ("DataArray", Some(section)) => {
                    let text = tags.inside(&tag)?;
                    if let Some(piece) = document.pieces.last_mut() {
                        piece.add(section, tag.array(text))?;
                    }
                }
                ("AppendedData", _) => {
                    let base64 = tag.attribute("encoding")?.is_some_and(|encoding| encoding == "base64");
                    document.appended = appended.map(|data| (data, base64));
                    ended = true;
                    break;
                }
                (name, _) if !tag.empty => section = Section::of_name(name).or(section),
                _ => {}
            }
        }
        if !rooted {
            return Err(file.malformed(0, "there is no element `VTKFile`"));
        }
        if !ended || document.pieces.is_empty() {
            return Err(file.truncated("the XML structure"));
        }
        document.offsets.sort_unstable();
        Ok(document)
    }

    /// Counts bytes that are about to be allocated against the limit.
    pub fn spend_budget(&self, bytes: usize) -> Result<(), IoError> {
        let budget = self.budget.get().checked_sub(bytes).ok_or_else(|| IoError::Expands {
            path: self.file.path.to_owned(),
            format: self.file.format,
            size: self.file.bytes.len(),
            limit: unpacking_budget(self.file),
        })?;
        self.budget.set(budget);
        Ok(())
    }

    fn read_root(&mut self, tag: &Tag<'a>, data_set: DataSet) -> Result<(), IoError> {
        let attribute = |name: &str| tag.attribute(name).map(Option::unwrap_or_default);
        let kind = attribute("type")?;
        let (wanted, remedy) = match data_set {
            DataSet::UnstructuredGrid => ("UnstructuredGrid", "save it as an unstructured grid"),
            DataSet::ImageData => ("ImageData", "save it as image data"),
        };
        if kind != wanted {
            let found = format!("a VTK data set of type `{}`", excerpt(kind.as_bytes()));
            return Err(self.file.unsupported(found, remedy));
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
                return Err(self.file.unsupported(found, "save it with ZLib or without compression"));
            }
        };
        Ok(())
    }
}

fn unpacking_budget(file: &InputFile) -> usize {
    let expanded = file.bytes.len().saturating_mul(MAX_EXPANSION);
    expanded.saturating_add(MIN_BUDGET)
}

/// The XML up to and including the tag `AppendedData`, and what follows its `_`.
fn split_appended<'a>(file: &InputFile<'a>) -> Result<(&'a str, Option<&'a [u8]>), IoError> {
    const TAG: &[u8] = b"<AppendedData";
    let bytes = file.bytes;
    let (xml, appended) = match bytes.windows(TAG.len()).position(|window| window == TAG) {
        None => (bytes, None),
        Some(start) => {
            let find = |from: usize, wanted: u8| {
                let found = bytes[from..].iter().position(|&b| b == wanted).map(|k| from + k + 1);
                found.ok_or_else(|| file.truncated("the appended data"))
            };
            let tag_end = find(start, b'>')?;
            (&bytes[..tag_end], Some(&bytes[find(tag_end, b'_')?..]))
        }
    };
    match std::str::from_utf8(xml) {
        Ok(xml) => Ok((xml, appended)),
        Err(error) => Err(file.malformed_at(Place::Byte(error.valid_up_to()), "the XML is not UTF-8 text")),
    }
}

/// An element whose arrays are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    Points,
    Cells,
    PointData,
    CellData,
}

impl Section {
    fn of_name(name: &str) -> Option<Self> {
        Some(match name {
            "Points" => Self::Points,
            "Cells" => Self::Cells,
            "PointData" => Self::PointData,
            "CellData" => Self::CellData,
            _ => return None,
        })
    }
}

impl<'a> XmlPiece<'a> {
    fn add(&mut self, section: Section, array: Result<Array<'a>, IoError>) -> Result<(), IoError> {
        match section {
            Section::Points => self.points = Some(array?),
            Section::Cells => self.cells.push(array?),
            // Fields that are not numeric, such as strings, are skipped.
            Section::PointData => self.point_data.extend(array.ok()),
            Section::CellData => self.cell_data.extend(array.ok()),
        }
        Ok(())
    }
}

/// Iterates over the tags of an XML text.
struct Tags<'a> {
    file: &'a InputFile<'a>,
    reader: Reader<&'a [u8]>,
    /// Bytes before the reader's start.
    shift: usize,
}

enum TagEvent<'a> {
    Begin(Tag<'a>),
    End(BytesEnd<'a>),
}

impl<'a> Tags<'a> {
    fn new(file: &'a InputFile<'a>, xml: &'a str) -> Self {
        // The reader would skip a byte order mark without counting it.
        let shift = if xml.starts_with('\u{feff}') { 3 } else { 0 };
        Self {
            file,
            reader: Reader::from_str(&xml[shift..]),
            shift,
        }
    }

    fn next(&mut self) -> Result<Option<TagEvent<'a>>, IoError> {
        loop {
            let at = self.position();
            let event = self.reader.read_event();
            let event = event.map_err(|error| {
                let position = self.shift + self.reader.error_position() as usize;
                xml_error(self.file, position, &error)
            })?;
            let (tag, empty) = match event {
                Event::Start(tag) => (tag, false),
                Event::Empty(tag) => (tag, true),
                Event::End(tag) => return Ok(Some(TagEvent::End(tag))),
                Event::Eof => return Ok(None),
                _ => continue,
            };
            let file = self.file;
            return Ok(Some(TagEvent::Begin(Tag { file, tag, empty, at })));
        }
    }

    /// Skips to the end of the element of `tag`, which was just read; returns the range of its content.
    fn inside(&mut self, tag: &Tag) -> Result<Range<usize>, IoError> {
        let start = self.position();
        if tag.empty {
            return Ok(start..start);
        }
        let span = self.reader.read_to_end(tag.tag.name());
        let span = span.map_err(|error| xml_error(self.file, start, &error))?;
        Ok(start..self.shift + span.end as usize)
    }

    fn position(&self) -> usize {
        self.shift + self.reader.buffer_position() as usize
    }
}

/// An element that is not closed at the end of the file means that the file was truncated.
fn xml_error(file: &InputFile, position: usize, error: &quick_xml::Error) -> IoError {
    match error {
        quick_xml::Error::Syntax(_) | quick_xml::Error::IllFormed(IllFormedError::MissingEndTag(_)) => {
            file.truncated("the XML structure")
        }
        _ => file.malformed(position, printable(error)),
    }
}

/// A start tag at the byte `at`.
struct Tag<'a> {
    file: &'a InputFile<'a>,
    tag: BytesStart<'a>,
    /// Whether the element is `<.../>`.
    empty: bool,
    at: usize,
}

impl<'a> Tag<'a> {
    fn attribute(&self, name: &str) -> Result<Option<Cow<'a, str>>, IoError> {
        // Checking for duplicate attributes takes quadratic time.
        for attribute in self.tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| self.file.malformed(self.at, printable(error)))?;
            if attribute.key.as_ref() == name {
                return Ok(Some(Cow::Owned(attribute.value.into_owned())));
            }
        }
        Ok(None)
    }

    fn required(&self, name: &str) -> Result<Cow<'a, str>, IoError> {
        self.attribute(name)?.ok_or_else(|| {
            let tag = excerpt(self.tag.name().as_ref().as_bytes());
            self.file
                .malformed(self.at, format!("the element `{tag}` lacks the attribute `{name}`"))
        })
    }

    fn count(&self, name: &str) -> Result<u64, IoError> {
        let value = self.required(name)?;
        value.trim().parse().map_err(|_| self.refused(name, &value))
    }

    /// Numbers separated by white space.
    fn numbers<T: FromStr, const N: usize>(&self, name: &str) -> Result<Option<[T; N]>, IoError> {
        let Some(value) = self.attribute(name)? else {
            return Ok(None);
        };
        let numbers: Option<Vec<T>> = value.split_ascii_whitespace().map(|n| n.parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
        numbers.ok_or_else(|| self.refused(name, &value)).map(Some)
    }

    fn extent(&self, name: &str) -> Result<[i32; 6], IoError> {
        self.required(name)?;
        Ok(self.numbers(name)?.unwrap_or_default())
    }

    fn image(&self) -> Result<Image, IoError> {
        Ok(Image {
            whole: self.extent("WholeExtent")?,
            origin: self.numbers("Origin")?.unwrap_or_default(),
            spacing: self.numbers("Spacing")?.unwrap_or([1.0; 3]),
            direction: self
                .numbers("Direction")?
                .unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        })
    }

    fn piece(&self, data_set: DataSet) -> Result<XmlPiece<'a>, IoError> {
        let mut piece = XmlPiece::default();
        match data_set {
            DataSet::UnstructuredGrid => {
                piece.point_count = self.count("NumberOfPoints")?;
                piece.cell_count = self.count("NumberOfCells")?;
            }
            DataSet::ImageData => piece.extent = self.extent("Extent")?,
        }
        Ok(piece)
    }

    fn array(&self, text: Range<usize>) -> Result<Array<'a>, IoError> {
        let kind = self.required("type")?;
        let format = self.required("format")?;
        let inner = &self.file.bytes[text.clone()];
        let length = inner.iter().position(|&b| b == b'<').unwrap_or(inner.len());
        let components = self.attribute("NumberOfComponents")?;
        Ok(Array {
            name: self.attribute("Name")?.unwrap_or_default(),
            // With 0 components an empty array would match any number of points.
            components: components
                .and_then(|n| n.trim().parse().ok())
                .filter(|&n| n > 0)
                .unwrap_or(1),
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
        self.file
            .malformed(self.at, format!("the attribute {name}=\"{value}\" is not understood"))
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
