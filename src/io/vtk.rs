//! The legacy VTK format (`.vtk`), in text and binary, and what it shares with the XML format.
//!
//! Own code: `vtkio` allocates by unchecked counts of the file, and its errors name neither file nor place.

use std::{
    borrow::Cow,
    io::{self, Write},
    path::Path,
};

use super::{
    IoError, Place, atomic_write,
    contents::Contents,
    source::{ByteOrder, Scalar, Source, TEXT_NUMBER, Tokens, excerpt},
};
use crate::{Point, mesh::CellList};

/// Cells of one kind, by their 0-based corners.
#[derive(Debug, Clone, Copy)]
pub enum Cells<'a> {
    /// Triangles, counter-clockwise from outside.
    Triangles(&'a [[u32; 3]]),
    /// Quadrilaterals, counter-clockwise from outside.
    Quads(&'a [[u32; 4]]),
    /// Tetrahedra.
    Tets(&'a [[u32; 4]]),
    /// Hexahedra: four corners around the bottom, counter-clockwise seen from above, then the four over them.
    Hexes(&'a [[u32; 8]]),
}

impl<'a> From<&'a CellList> for Cells<'a> {
    fn from(cells: &'a CellList) -> Self {
        match cells {
            CellList::Tets(cells) => Self::Tets(cells),
            CellList::Hexes(cells) => Self::Hexes(cells),
        }
    }
}

/// Cells of one kind, with labels.
#[derive(Debug, Clone, Copy)]
pub struct CellGroup<'a> {
    /// The cells.
    pub cells: Cells<'a>,
    /// A label for each cell.
    pub labels: &'a [i32],
    /// Names of labels, for formats that have them.
    pub names: &'a [(i32, String)],
}

impl<'a> Cells<'a> {
    /// How many cells there are.
    pub fn count(self) -> usize {
        self.flat().len() / self.corners()
    }

    /// The corners of each cell.
    pub fn iter(self) -> impl Iterator<Item = &'a [u32]> {
        self.flat().chunks_exact(self.corners())
    }

    fn corners(self) -> usize {
        match self {
            Self::Triangles(_) => 3,
            Self::Quads(_) | Self::Tets(_) => 4,
            Self::Hexes(_) => 8,
        }
    }

    /// The corners of all cells, one cell after the other.
    pub(super) fn flat(self) -> &'a [u32] {
        match self {
            Self::Triangles(cells) => cells.as_flattened(),
            Self::Quads(cells) | Self::Tets(cells) => cells.as_flattened(),
            Self::Hexes(cells) => cells.as_flattened(),
        }
    }

    /// The number that VTK gives this kind of cell.
    pub(super) fn vtk_type(self) -> u8 {
        match self {
            Self::Triangles(_) => TRIANGLE,
            Self::Quads(_) => QUADRILATERAL,
            Self::Tets(_) => TETRAHEDRON,
            Self::Hexes(_) => HEXAHEDRON,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Triangles(_) => "triangle",
            Self::Quads(_) => "quadrilateral",
            Self::Tets(_) => "tetrahedron",
            Self::Hexes(_) => "hexahedron",
        }
    }
}

/// Values at the points or in the cells of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// The name shown by viewers.
    pub name: String,
    /// Values per point or cell: 1 for a scalar, 3 for a vector, 9 for a matrix in row-major order.
    pub components: usize,
    /// `n × components`, row-major.
    pub values: Vec<f64>,
}

/// The fields that go with a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VtkFields {
    /// Fields with values at the points.
    pub point: Vec<Field>,
    /// Fields with values in the cells.
    pub cell: Vec<Field>,
    /// Where all of it comes from, in one line at the head of the file.
    pub comment: String,
}

/// How numbers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VtkEncoding {
    /// As text, of which every number reads back to the same bits.
    Text,
    /// As big-endian bytes, as the format has it.
    Binary,
}

/// Writes a legacy VTK file (version 3.0, which all readers know) with double-precision coordinates and fields.
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

/// Refuses cells that name missing points and fields that do not fit: viewers crash on such files.
pub(super) fn check(path: &Path, points: &[Point], cells: Cells, fields: &VtkFields) -> Result<(), IoError> {
    let missing = |v: &&u32| **v as usize >= points.len();
    for (index, cell) in cells.iter().enumerate() {
        if let Some(&vertex) = cell.iter().find(missing) {
            return Err(IoError::IndexOutOfRange {
                path: path.to_owned(),
                element: cells.name(),
                index,
                vertex: i64::from(vertex),
                vertices: points.len(),
                base: 0,
            });
        }
    }
    let point_fields = fields.point.iter().map(|field| (field, points.len()));
    let cell_fields = fields.cell.iter().map(|field| (field, cells.count()));
    for (field, count) in point_fields.chain(cell_fields) {
        let expected = count.saturating_mul(field.components);
        if field.values.len() != expected {
            return Err(IoError::ValueCount {
                path: path.to_owned(),
                name: field.name.clone(),
                expected,
                found: field.values.len(),
            });
        }
    }
    Ok(())
}

/// The points and cells of an unstructured grid or of polygonal data, in file order. Fields are passed over.
pub(super) fn parse(source: &Source) -> Result<Contents, IoError> {
    read(source, false)
}

/// As [`parse`], with the fields; also structured points, whose cells become six tetrahedra each.
pub(super) fn parse_with_fields(source: &Source) -> Result<Contents, IoError> {
    read(source, true)
}

fn read(source: &Source, with_fields: bool) -> Result<Contents, IoError> {
    let mut reader = LegacyReader::new(source)?;
    let mut contents = Contents::default();
    let mut cells: Option<CellLists> = None;
    let mut types: Option<Vec<i64>> = None;
    let mut end_of_types = Place::Byte(0);
    let mut grid = true;
    while let Some(word) = reader.tokens.next() {
        match word {
            b"DATASET" if with_fields && reader.tokens.peek() == Some(b"STRUCTURED_POINTS") => {
                reader.structured_points(&mut contents)?;
                grid = false;
            }
            b"DATASET" => grid = reader.dataset_is_grid()?,
            b"METADATA" => reader.skip_metadata(),
            b"FIELD" => drop(reader.field_arrays()?),
            b"POINTS" => contents.vertices = reader.points()?,
            b"CELLS" if grid => cells = Some(reader.cell_lists("cells")?),
            b"CELL_TYPES" if grid => {
                types = Some(reader.cell_types()?);
                end_of_types = Place::Byte(reader.tokens.position());
            }
            b"POLYGONS" if !grid => {
                let polygons = reader.cell_lists("polygons")?;
                polygons.iter().for_each(|p| contents.polygons.push(p.iter().copied()));
            }
            b"TRIANGLE_STRIPS" if !grid => {
                let strips = reader.cell_lists("triangle strips")?;
                strips.iter().for_each(|s| contents.polygons.push_strip(s));
            }
            b"VERTICES" | b"LINES" if !grid => drop(reader.cell_lists("vertices and lines")?),
            b"POINT_DATA" | b"CELL_DATA" if with_fields => {
                reader.all_fields(word == b"POINT_DATA", &mut contents)?;
                break;
            }
            b"POINT_DATA" | b"CELL_DATA" => break,
            _ => {
                let found = excerpt(word);
                return Err(reader
                    .tokens
                    .malformed(format!("found `{found}` where a keyword was expected")));
            }
        }
    }
    if !grid {
        return Ok(contents);
    }
    let Some((cells, types)) = cells.zip(types) else {
        return Err(source.truncated("an unstructured grid without CELLS or CELL_TYPES"));
    };
    if cells.ends.len() != types.len() {
        let found = format!("{} cells have {} cell types", cells.ends.len(), types.len());
        return Err(source.malformed_at(end_of_types, found));
    }
    sort_cells(source, end_of_types, &mut contents, types.into_iter().zip(cells.iter()))?;
    Ok(contents)
}

/// Structured points become tetrahedra, which take up to two kilobytes a point by the time they are searched.
const MAX_STRUCTURED: usize = 1 << 22;

const TRIANGLE: u8 = 5;
const QUADRILATERAL: u8 = 9;
const TETRAHEDRON: u8 = 10;
const HEXAHEDRON: u8 = 12;

/// Adds cells, each with its VTK type, to the polygons and tetrahedra. Points and lines are passed over; `place` is
/// where the types stand.
pub(super) fn sort_cells<'c>(
    source: &Source,
    place: Place,
    contents: &mut Contents,
    cells: impl Iterator<Item = (i64, &'c [i64])>,
) -> Result<(), IoError> {
    for (index, (kind, corners)) in cells.enumerate() {
        contents.cells += 1;
        match (kind, corners) {
            (1..=4 | 21, _) => {}
            (5, &[a, b, c]) => contents.polygons.push([a, b, c]),
            (6, strip) => contents.polygons.push_strip(strip),
            (7, polygon) => contents.polygons.push(polygon.iter().copied()),
            // A pixel goes row by row, not around.
            (8, &[a, b, c, d]) => contents.polygons.push([a, b, d, c]),
            (9, &[a, b, c, d]) => contents.polygons.push([a, b, c, d]),
            (10, &[a, b, c, d]) => {
                contents.tets.push([a, b, c, d]);
                contents.cell_of_tet.push(contents.cells - 1);
            }
            (12, &[a, b, c, d, e, f, g, h]) => contents.hexes.push([a, b, c, d, e, f, g, h]),
            (5 | 8..=10 | 12, _) => {
                let found = format!("cell {index} has VTK type {kind} but {} corners", corners.len());
                return Err(source.malformed_at(place, found));
            }
            (11, _) => contents.add_other_cells("voxels", 1),
            (13, _) => contents.add_other_cells("wedges", 1),
            (14, _) => contents.add_other_cells("pyramids", 1),
            (24, _) => contents.add_other_cells("quadratic tetrahedra", 1),
            (42, _) => contents.add_other_cells("polyhedra", 1),
            _ => contents.add_other_cells(&format!("cells of VTK type {kind}"), 1),
        }
    }
    Ok(())
}

/// Cells as the lists of their corners.
struct CellLists {
    corners: Vec<i64>,
    ends: Vec<usize>,
}

impl CellLists {
    fn iter(&self) -> impl Iterator<Item = &[i64]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.corners[start..end])
    }
}

/// Turns offsets as VTK stores them into the ends of lists over `corners` entries; `None` when they are none.
pub(super) fn list_ends(offsets: impl IntoIterator<Item = i64>, corners: usize) -> Option<Vec<usize>> {
    let mut last = 0;
    offsets
        .into_iter()
        .map(|offset| {
            let end = usize::try_from(offset).ok()?;
            let valid = last <= end && end <= corners;
            last = end;
            valid.then_some(end)
        })
        .collect()
}

struct LegacyReader<'a> {
    source: &'a Source<'a>,
    tokens: Tokens<'a>,
    binary: bool,
}

impl<'a> LegacyReader<'a> {
    /// Reads the version, the title and the encoding.
    fn new(source: &'a Source<'a>) -> Result<Self, IoError> {
        let mut tokens = source.tokens();
        let first = tokens.line();
        if !first.starts_with(b"# vtk DataFile Version") {
            let found = excerpt(first);
            return Err(tokens.malformed(format!("found `{found}` where `# vtk DataFile Version` was expected")));
        }
        tokens.line();
        if tokens.rest().is_empty() {
            return Err(source.truncated("the header"));
        }
        let binary = match tokens.line().trim_ascii() {
            b"ASCII" => false,
            b"BINARY" => true,
            other => {
                let found = excerpt(other);
                return Err(tokens.malformed(format!("found `{found}` where ASCII or BINARY was expected")));
            }
        };
        Ok(Self { source, tokens, binary })
    }

    fn dataset_is_grid(&mut self) -> Result<bool, IoError> {
        match self.tokens.word("the kind of data set")?.as_str() {
            "UNSTRUCTURED_GRID" => Ok(true),
            "POLYDATA" => Ok(false),
            other => Err(self.source.unsupported(
                format!("a VTK data set of kind `{}`", excerpt(other.as_bytes())),
                "save it as an unstructured grid or as polygonal data",
            )),
        }
    }

    /// Points on a lattice, the first coordinate running fastest, and the tetrahedra of its cells.
    fn structured_points(&mut self, contents: &mut Contents) -> Result<(), IoError> {
        self.tokens.next();
        let (mut counts, mut origin, mut spacing) = ([0; 3], Point::origin(), Point::new(1.0, 1.0, 1.0));
        while let Some(word) = self.tokens.peek() {
            match word {
                b"DIMENSIONS" | b"ORIGIN" | b"SPACING" | b"ASPECT_RATIO" => drop(self.tokens.next()),
                _ => break,
            }
            match word {
                b"DIMENSIONS" => {
                    for count in &mut counts {
                        *count = self.tokens.count("points along an axis", 0)?;
                    }
                }
                b"ORIGIN" => origin = self.tokens.point()?,
                _ => spacing = self.tokens.point()?,
            }
        }
        let total = counts.iter().try_fold(1u64, |total, &n| total.checked_mul(n as u64));
        let available = self.tokens.rest().len();
        let total = total.unwrap_or(u64::MAX);
        let total = self
            .source
            .checked_count(total, "values of structured points", 1, available)?;
        if total > MAX_STRUCTURED {
            let found = format!("{total} structured points");
            return Err(self.source.unsupported(
                found,
                "at most 4194304 are read, since six tetrahedra a cell take up to two kilobytes a point; take every \
                 second point along each axis",
            ));
        }
        let [nx, ny, nz] = counts;
        let at = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
        let place = |i: usize| {
            Point::from(std::array::from_fn::<f64, 3, _>(|k| {
                origin[k] + at(i)[k] as f64 * spacing[k]
            }))
        };
        contents.vertices = (0..total).map(place).collect();
        let cells = counts.iter().map(|n| n.saturating_sub(1)).product::<usize>();
        contents.tets.reserve_exact(6 * cells);
        contents.cell_of_tet.reserve_exact(6 * cells);
        let is_first = |i: &usize| at(*i)[0] + 1 < nx && at(*i)[1] + 1 < ny && at(*i)[2] + 1 < nz;
        for first in (0..total).filter(is_first) {
            let [x, y, z] = [1, nx, nx * ny];
            // Kuhn's split: every order of the axes from one corner to the opposite one, all of one hand.
            for [a, b, c] in [[x, y, z], [y, z, x], [z, x, y]] {
                let end = first + a + b + c;
                for tet in [
                    [first, first + a, first + a + b, end],
                    [first, first + a + c, first + a, end],
                ] {
                    contents.tets.push(tet.map(|v| v as i64));
                    contents.cell_of_tet.push(contents.cells);
                }
            }
            contents.cells += 1;
        }
        Ok(())
    }

    /// Skips lines to the next blank one.
    fn skip_metadata(&mut self) {
        self.tokens.line();
        while !self.tokens.rest().is_empty() && !self.tokens.line().is_empty() {}
    }

    /// The fields over points and cells up to the end of the file, first those over points or cells as `at_points` says.
    fn all_fields(&mut self, mut at_points: bool, contents: &mut Contents) -> Result<(), IoError> {
        let mut count = self.tokens.count("values of a field", 0)?;
        while let Some(word) = self.tokens.next() {
            let fields = match word {
                b"POINT_DATA" | b"CELL_DATA" => {
                    at_points = word == b"POINT_DATA";
                    count = self.tokens.count("values of a field", 0)?;
                    continue;
                }
                b"METADATA" => {
                    self.skip_metadata();
                    continue;
                }
                b"FIELD" => self.field_arrays()?,
                b"SCALARS" => vec![self.scalars(count)?],
                b"VECTORS" | b"NORMALS" => vec![self.attribute(3, count)?],
                b"TENSORS" => vec![self.attribute(9, count)?],
                _ => {
                    let found = format!("a field of the kind `{}`", excerpt(word));
                    return Err(self.source.unsupported(found, "save it as SCALARS, VECTORS or FIELD"));
                }
            };
            if at_points {
                contents.point_fields.extend(fields);
            } else {
                contents.cell_fields.extend(fields);
            }
        }
        Ok(())
    }

    fn attribute(&mut self, components: usize, count: usize) -> Result<Field, IoError> {
        let name = self.tokens.word("a field")?;
        let scalar = self.scalar()?;
        let values = self.floats(
            scalar,
            (components as u64).saturating_mul(count as u64),
            "values of a field",
        )?;
        Ok(Field {
            name,
            components,
            values,
        })
    }

    /// Scalars name their colours before their values.
    fn scalars(&mut self, count: usize) -> Result<Field, IoError> {
        let name = self.tokens.word("a field")?;
        let scalar = self.scalar()?;
        let mut components = 1;
        if self.tokens.peek().is_some_and(|word| word != b"LOOKUP_TABLE") {
            components = self.tokens.count("components", 0)?;
        }
        for _ in 0..2 {
            self.tokens.word("LOOKUP_TABLE")?;
        }
        let values = self.floats(
            scalar,
            (components as u64).saturating_mul(count as u64),
            "values of a field",
        )?;
        Ok(Field {
            name,
            components,
            values,
        })
    }

    fn field_arrays(&mut self) -> Result<Vec<Field>, IoError> {
        let mut fields = Vec::new();
        self.tokens.word("a field")?;
        for _ in 0..self.tokens.count("field arrays", 4 * TEXT_NUMBER)? {
            let mut name = self.tokens.word("a field")?;
            while name == "METADATA" {
                self.skip_metadata();
                name = self.tokens.word("a field")?;
            }
            let components = self.tokens.count("components", 0)?;
            let tuples = self.tokens.count("tuples", 0)?;
            let scalar = self.scalar()?;
            let count = (components as u64).saturating_mul(tuples as u64);
            let values = self.floats(scalar, count, "values of a field")?;
            fields.push(Field {
                name,
                components,
                values,
            });
        }
        Ok(fields)
    }

    fn points(&mut self) -> Result<Vec<Point>, IoError> {
        let count = self.tokens.count("points", 3)?;
        let scalar = self.scalar()?;
        let coordinates = self.floats(scalar, 3 * count as u64, "coordinates")?;
        Ok(coordinates
            .chunks_exact(3)
            .map(|p| Point::new(p[0], p[1], p[2]))
            .collect())
    }

    /// Lists of corners, each after its length (to VTK 4) or as offsets and corners (from VTK 5).
    fn cell_lists(&mut self, element: &str) -> Result<CellLists, IoError> {
        let cells = self.tokens.count(element, 1)?;
        let size = self.tokens.count(element, 1)?;
        if self.tokens.rest().trim_ascii_start().starts_with(b"OFFSETS") {
            return self.offset_lists(cells, size, element);
        }
        let values = self.integers(Scalar::I32, size as u64, element)?;
        let mut lists = CellLists {
            corners: Vec::with_capacity(values.len()),
            ends: Vec::with_capacity(cells.min(values.len())),
        };
        let mut rest = values.as_slice();
        for cell in 0..cells {
            let list = rest
                .split_first()
                .and_then(|(&length, tail)| tail.split_at_checked(usize::try_from(length).ok()?));
            let Some((corners, tail)) = list else {
                let found = format!("{element}: the list of corners of number {cell} exceeds the {size} values given");
                return Err(self.tokens.malformed(found));
            };
            lists.corners.extend_from_slice(corners);
            lists.ends.push(lists.corners.len());
            rest = tail;
        }
        Ok(lists)
    }

    fn offset_lists(&mut self, offsets: usize, corners: usize, element: &str) -> Result<CellLists, IoError> {
        self.tokens.next();
        let scalar = self.scalar()?;
        let offsets = self.integers(scalar, offsets as u64, element)?;
        if self.tokens.word(element)? != "CONNECTIVITY" {
            return Err(self.tokens.malformed("CONNECTIVITY was expected after OFFSETS"));
        }
        let scalar = self.scalar()?;
        let corners = self.integers(scalar, corners as u64, element)?;
        match list_ends(offsets.into_iter().skip(1), corners.len()) {
            Some(ends) => Ok(CellLists { corners, ends }),
            None => Err(self
                .tokens
                .malformed(format!("the offsets of {element} do not ascend within CONNECTIVITY"))),
        }
    }

    fn cell_types(&mut self) -> Result<Vec<i64>, IoError> {
        let count = self.tokens.count("cell types", 1)?;
        self.integers(Scalar::I32, count as u64, "cell types")
    }

    fn scalar(&mut self) -> Result<Scalar, IoError> {
        let name = self.tokens.word("a data type")?;
        match name.to_ascii_lowercase().as_str() {
            "char" | "signed_char" | "vtktypeint8" => Ok(Scalar::I8),
            "unsigned_char" | "vtktypeuint8" => Ok(Scalar::U8),
            "short" | "vtktypeint16" => Ok(Scalar::I16),
            "unsigned_short" | "vtktypeuint16" => Ok(Scalar::U16),
            "int" | "vtktypeint32" => Ok(Scalar::I32),
            "unsigned_int" | "vtktypeuint32" => Ok(Scalar::U32),
            "long" | "vtktypeint64" => Ok(Scalar::I64),
            // VTK writes its ids as 32-bit integers to legacy files, however wide they are in memory.
            "vtkidtype" => Ok(Scalar::I32),
            "unsigned_long" | "vtktypeuint64" => Ok(Scalar::U64),
            "float" => Ok(Scalar::F32),
            "double" => Ok(Scalar::F64),
            _ => {
                let found = excerpt(name.as_bytes());
                Err(self
                    .tokens
                    .malformed(format!("found `{found}` where a data type was expected")))
            }
        }
    }

    fn floats(&mut self, scalar: Scalar, count: u64, element: &str) -> Result<Vec<f64>, IoError> {
        self.values(
            scalar,
            count,
            element,
            |b| scalar.float(b, ByteOrder::Big),
            |t| t.float(element),
        )
    }

    fn integers(&mut self, scalar: Scalar, count: u64, element: &str) -> Result<Vec<i64>, IoError> {
        self.values(
            scalar,
            count,
            element,
            |b| scalar.integer(b, ByteOrder::Big),
            |t| t.integer(element),
        )
    }

    fn values<T>(
        &mut self,
        scalar: Scalar,
        count: u64,
        element: &str,
        from_bytes: impl Fn(&[u8]) -> T,
        from_text: impl Fn(&mut Tokens<'a>) -> Result<T, IoError>,
    ) -> Result<Vec<T>, IoError> {
        if self.binary {
            // The data begin after the line of the keyword, even when there are none.
            self.tokens.line();
            let available = self.tokens.rest().len();
            let count = self.source.checked_count(count, element, scalar.size(), available)?;
            let bytes = self.tokens.take(count * scalar.size(), element)?;
            Ok(bytes.chunks_exact(scalar.size()).map(from_bytes).collect())
        } else {
            let available = self.tokens.rest().len() + 1;
            let count = self.source.checked_count(count, element, TEXT_NUMBER, available)?;
            (0..count).map(|_| from_text(&mut self.tokens)).collect()
        }
    }
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
    let title: String = if fields.comment.is_empty() {
        "solidmap"
    } else {
        &fields.comment
    }
    .chars()
    .map(|c| if c.is_ascii_graphic() { c } else { ' ' })
    .take(250)
    .collect();
    writeln!(
        out.writer,
        "# vtk DataFile Version 3.0\n{title}\n{encoding}\nDATASET UNSTRUCTURED_GRID"
    )?;
    writeln!(out.writer, "POINTS {} double", points.len())?;
    out.floats(&coordinates, 3)?;
    writeln!(
        out.writer,
        "CELLS {} {}",
        cells.count(),
        cells.count() + cells.flat().len()
    )?;
    for cell in cells.iter() {
        out.integers(std::iter::once(corners).chain(cell.iter().copied()))?;
    }
    out.end_of_data()?;
    writeln!(out.writer, "CELL_TYPES {}", cells.count())?;
    for _ in 0..cells.count() {
        out.integers([u32::from(cells.vtk_type())])?;
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
            VtkEncoding::Binary => values
                .iter()
                .try_for_each(|x| self.writer.write_all(&x.to_be_bytes()))?,
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

/// Names in a legacy file are single words.
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
    use crate::io::{
        Solid,
        testing::{place_of, solid, surface, tets},
    };

    const OLD: &str = "# vtk DataFile Version 2.0\nby hand\nASCII\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\n\
                       TIME 1 2 double\n0.5 nan\nPOINTS 5 float\n0 0 0 1 0 0\n0 1 0\n0 0 1 nan inf -inf\n\n\
                       METADATA\nINFORMATION 1\nNAME L2 LOCATION vtkDataArray\n\nCELLS 4 15\n4 0 1 2 3\n4 1 0 2 3\n\
                       1 4\n2 0 1\nCELL_TYPES 4\n10\n10\n1\n3\nPOINT_DATA 5\nSCALARS anything\n";

    const NEW: &str = "# vtk DataFile Version 5.1\nvtk output\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n\
                       0 0 0 1 0 0 0 1 0 0 0 1 nan inf -inf \nCELLS 5 11\nOFFSETS vtktypeint64\n0 4 8 9 11 \n\
                       CONNECTIVITY vtktypeint64\n0 1 2 3 1 0 2 3 4 0 1\nCELL_TYPES 4\n10\n10\n1\n3\n";

    /// The same file with its numbers in binary.
    fn binary(text: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut kind = "text";
        for line in text.replace("ASCII", "BINARY").lines() {
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let is_number = |word: &&str| word.parse::<f64>().is_ok();
            if kind == "text" || !words.iter().all(is_number) || words.is_empty() {
                kind = match words.first() {
                    Some(&"TIME") => "double",
                    Some(&"POINTS" | &"OFFSETS" | &"CONNECTIVITY") => words[words.len() - 1],
                    Some(&"CELL_TYPES" | &"POLYGONS" | &"TRIANGLE_STRIPS" | &"VERTICES") => "int",
                    Some(&"CELLS") if !text.contains("OFFSETS") => "int",
                    _ => "text",
                };
                bytes.extend(line.bytes().chain([b'\n']));
                continue;
            }
            for word in words {
                let value: f64 = word.parse().unwrap();
                match kind {
                    "float" => bytes.extend((value as f32).to_be_bytes()),
                    "double" => bytes.extend(value.to_be_bytes()),
                    "int" => bytes.extend((value as i32).to_be_bytes()),
                    _ => bytes.extend((value as i64).to_be_bytes()),
                }
            }
        }
        bytes
    }

    #[test]
    fn old_and_new_grids_are_read_in_text_and_binary() {
        for bytes in [OLD.into(), NEW.into(), binary(OLD), binary(NEW)] {
            let shown = String::from_utf8_lossy(&bytes).into_owned();
            let mesh = tets("vtk", &bytes).unwrap_or_else(|error| panic!("{error}: {shown}"));
            assert_eq!(mesh.tets(), [[0, 1, 2, 3], [1, 0, 2, 3]]);
            assert_eq!(mesh.vertices()[3], Point::new(0., 0., 1.));
            let odd = mesh.vertices()[4];
            assert!(odd.x.is_nan() && odd.y == f64::INFINITY && odd.z == f64::NEG_INFINITY);
            assert!(matches!(solid("vtk", &bytes), Ok(Solid::Tets(_))));
            assert!(matches!(surface("vtk", &bytes), Err(IoError::WrongKind { .. })));
        }
    }

    #[test]
    fn faces_of_every_kind_are_a_surface() {
        let text = "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0 1 0 0 0 1 0 \
                    1 1 0\nCELLS 5 23\n3 0 1 2\n4 0 1 2 3\n4 0 1 3 2\n4 0 1 2 3\n3 3 2 1\nCELL_TYPES 5\n5\n8\n9\n6\n7\n";
        let quad = [[0, 1, 3], [0, 3, 2]];
        let mesh = surface("vtk", text.as_bytes()).unwrap();
        let strip = [[0, 1, 2], [2, 1, 3]];
        assert_eq!(
            mesh.triangles(),
            [&[[0, 1, 2]], &quad[..], &quad, &strip, &[[3, 2, 1]]].concat()
        );
        assert!(matches!(solid("vtk", text.as_bytes()), Ok(Solid::Surface(_))));
        assert!(matches!(tets("vtk", text.as_bytes()), Err(IoError::WrongKind { .. })));
    }

    #[test]
    fn polygonal_data_are_a_surface() {
        let text = "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 1 1 0\n\
                    VERTICES 1 2\n1 0\nPOLYGONS 2 9\n3 0 1 2\n4 0 1 3 2\nTRIANGLE_STRIPS 1 5\n4 0 1 2 3\nCELL_DATA 4\n";
        for bytes in [text.into(), binary(text)] {
            let triangles = [[0, 1, 2], [0, 1, 3], [0, 3, 2], [0, 1, 2], [2, 1, 3]];
            assert_eq!(surface("vtk", &bytes).unwrap().triangles(), triangles);
        }
    }

    #[test]
    fn faults_are_named() {
        let read = |from: &str, to: &str| {
            assert!(OLD.contains(from));
            solid("vtk", OLD.replace(from, to).as_bytes()).map(drop)
        };
        assert_eq!(place_of(read("# vtk", "# VTK")), Place::Line(1));
        assert_eq!(place_of(read("ASCII", "UTF8")), Place::Line(3));
        assert_eq!(place_of(read("0 1 0\n0", "0 l 0\n0")), Place::Line(10));
        assert_eq!(place_of(read("float", "complex")), Place::Line(8));
        assert_eq!(place_of(read("CELLS 4 15", "CELLS 4 14")), Place::Line(21));
        assert!(matches!(
            read("4 1 0 2 3", "4 1 0 2 5"),
            Err(IoError::IndexOutOfRange {
                index: 1,
                vertex: 5,
                ..
            })
        ));
        assert!(matches!(read("10\n1\n", "13\n1\n"), Err(IoError::Unsupported { .. })));
        assert!(matches!(read("10\n1\n", "9\n1\n").map(drop), Ok(())));
        assert!(matches!(
            read("10\n10\n1\n", "10\n5\n1\n"),
            Err(IoError::Malformed { .. })
        ));
        assert!(matches!(
            read("UNSTRUCTURED", "RECTILINEAR"),
            Err(IoError::Unsupported { .. })
        ));
        assert!(matches!(
            read("POINTS 5", "POINTS 5000000000"),
            Err(IoError::CountExceedsFile { .. })
        ));
        assert!(matches!(
            read("CELL_TYPES 4\n10\n10\n1\n3\n", ""),
            Err(IoError::Truncated { .. })
        ));
        assert!(matches!(
            read("CELL_TYPES 4\n10\n10\n1\n3\n", "CELL_TYPES 3\n10\n10\n1\n"),
            Err(IoError::Malformed { .. })
        ));
        let descending = NEW.replace("0 4 8 9 11", "0 4 3 9 11");
        assert!(matches!(
            tets("vtk", descending.as_bytes()),
            Err(IoError::Malformed { .. })
        ));
        let cut = binary(NEW);
        assert!(matches!(
            tets("vtk", &cut[..200]),
            Err(IoError::CountExceedsFile { .. })
        ));
    }

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
