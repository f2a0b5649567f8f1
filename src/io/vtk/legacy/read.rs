//! Reading legacy files: unstructured grids, polygonal data and structured points.

use super::{
    super::{
        cells::{add_cells, list_ends},
        lattice::Lattice,
    },
    arrays::LegacyReader,
};
use crate::{
    Point, Vector,
    io::{
        IoError, Place,
        input::{InputFile, Scalar, excerpt},
        raw_mesh::{CornerLists, RawMesh},
    },
};

/// The points and cells of an unstructured grid or of polygonal data, in file order. With fields, also structured
/// points, whose cells are split into six tetrahedra each.
pub(in crate::io) fn parse(file: &InputFile, with_fields: bool) -> Result<RawMesh, IoError> {
    let mut reader = LegacyReader::new(file)?;
    let mut raw = RawMesh::default();
    let mut cells: Option<CornerLists> = None;
    let mut types: Option<Vec<i64>> = None;
    let mut end_of_types = Place::Byte(0);
    let (mut grid, mut datasets) = (true, 0);
    while let Some(word) = reader.tokens.next() {
        datasets += usize::from(word == b"DATASET");
        match word {
            b"DATASET" if datasets > 1 => {
                return Err(reader.malformed("found a second DATASET; give it a file of its own"));
            }
            b"DATASET" if with_fields && reader.tokens.peek() == Some(b"STRUCTURED_POINTS") => {
                reader.structured_points(&mut raw)?;
                grid = false;
            }
            b"DATASET" => grid = reader.dataset_is_grid()?,
            b"METADATA" => reader.skip_metadata(),
            b"FIELD" => drop(reader.field_arrays()?),
            b"POINTS" => raw.vertices = reader.points()?,
            b"CELLS" if grid => cells = Some(reader.cell_lists("cells")?),
            b"CELL_TYPES" if grid => {
                types = Some(reader.cell_types()?);
                end_of_types = Place::Byte(reader.tokens.position());
            }
            b"POLYGONS" if !grid => {
                let polygons = reader.cell_lists("polygons")?;
                polygons.iter().for_each(|p| raw.polygons.push(p.iter().copied()));
            }
            b"TRIANGLE_STRIPS" if !grid => {
                let strips = reader.cell_lists("triangle strips")?;
                strips.iter().for_each(|s| raw.polygons.push_strip(s));
            }
            b"VERTICES" | b"LINES" if !grid => drop(reader.cell_lists("vertices and lines")?),
            b"POINT_DATA" | b"CELL_DATA" if with_fields => {
                reader.all_fields(word == b"POINT_DATA", &mut raw)?;
                break;
            }
            b"POINT_DATA" | b"CELL_DATA" => break,
            _ => return Err(reader.tokens.unexpected(word, "a keyword")),
        }
    }
    if !grid {
        return Ok(raw);
    }
    let Some((cells, types)) = cells.zip(types) else {
        return Err(file.truncated("an unstructured grid without CELLS or CELL_TYPES"));
    };
    if cells.ends.len() != types.len() {
        let found = format!("{} cells have {} cell types", cells.ends.len(), types.len());
        return Err(file.malformed_at(end_of_types, found));
    }
    add_cells(file, end_of_types, &mut raw, types.into_iter().zip(cells.iter()))?;
    Ok(raw)
}

impl LegacyReader<'_> {
    fn dataset_is_grid(&mut self) -> Result<bool, IoError> {
        match self.tokens.word("the kind of data set")?.as_str() {
            "UNSTRUCTURED_GRID" => Ok(true),
            "POLYDATA" => Ok(false),
            other => {
                let found = format!("a VTK data set of kind `{}`", excerpt(other.as_bytes()));
                let remedy = "save it as an unstructured grid or as polygonal data";
                Err(self.file.unsupported(found, remedy))
            }
        }
    }

    /// Points on a lattice, and the tetrahedra of its cells.
    fn structured_points(&mut self, raw: &mut RawMesh) -> Result<(), IoError> {
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
        let (total, available) = (total.unwrap_or(u64::MAX), self.tokens.rest().len());
        self.file
            .checked_count(total, "values of structured points", 1, available)?;
        let lattice = Lattice {
            counts,
            first: [0; 3],
            origin,
            steps: [0, 1, 2].map(|k| Vector::ith(k, spacing[k])),
        };
        lattice.check_size(self.file)?;
        lattice.fill(raw);
        Ok(())
    }

    /// The point and cell fields up to the end of the file; `at_points` says which of them the first section has.
    fn all_fields(&mut self, mut at_points: bool, raw: &mut RawMesh) -> Result<(), IoError> {
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
                    return Err(self.file.unsupported(found, "save it as SCALARS, VECTORS or FIELD"));
                }
            };
            if at_points {
                raw.point_fields.extend(fields);
            } else {
                raw.cell_fields.extend(fields);
            }
        }
        Ok(())
    }

    fn points(&mut self) -> Result<Vec<Point>, IoError> {
        let count = self.tokens.count("points", 3)?;
        let scalar = self.scalar()?;
        let coordinates = self.floats(scalar, 3 * count as u64, "coordinates")?;
        Ok(coordinates.chunks_exact(3).map(Point::from_slice).collect())
    }

    /// Lists of corners, each preceded by its length (up to VTK 4), or as offsets and corners (from VTK 5).
    fn cell_lists(&mut self, element: &str) -> Result<CornerLists, IoError> {
        let cells = self.tokens.count(element, 1)?;
        let size = self.tokens.count(element, 1)?;
        if self.tokens.rest().trim_ascii_start().starts_with(b"OFFSETS") {
            return self.offset_lists(cells, size, element);
        }
        let values = self.integers(Scalar::I32, size as u64, element)?;
        let mut lists = CornerLists {
            corners: Vec::with_capacity(values.len()),
            ends: Vec::with_capacity(cells.min(values.len())),
        };
        let mut rest = values.as_slice();
        for cell in 0..cells {
            let list = rest
                .split_first()
                .and_then(|(&length, tail)| tail.split_at_checked(usize::try_from(length).ok()?));
            let Some((corners, tail)) = list else {
                let found = format!(
                    "the corners of number {cell} (0-based) of the {element} exceed the {size} values announced"
                );
                return Err(self.malformed(found));
            };
            lists.corners.extend_from_slice(corners);
            lists.ends.push(lists.corners.len());
            rest = tail;
        }
        Ok(lists)
    }

    fn offset_lists(&mut self, offsets: usize, corners: usize, element: &str) -> Result<CornerLists, IoError> {
        self.tokens.next();
        let scalar = self.scalar()?;
        let offsets = self.integers(scalar, offsets as u64, element)?;
        if self.tokens.word(element)? != "CONNECTIVITY" {
            return Err(self.malformed("CONNECTIVITY was expected after OFFSETS"));
        }
        let scalar = self.scalar()?;
        let corners = self.integers(scalar, corners as u64, element)?;
        match list_ends(offsets.into_iter().skip(1), corners.len()) {
            Some(ends) => Ok(CornerLists { corners, ends }),
            None => Err(self.malformed(format!("the offsets of {element} do not ascend within CONNECTIVITY"))),
        }
    }

    fn cell_types(&mut self) -> Result<Vec<i64>, IoError> {
        let count = self.tokens.count("cell types", 1)?;
        self.integers(Scalar::I32, count as u64, "cell types")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{
        SolidMesh,
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
            assert!(matches!(solid("vtk", &bytes), Ok(SolidMesh::Cells(_))));
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
        assert!(matches!(solid("vtk", text.as_bytes()), Ok(SolidMesh::Surface(_))));
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
}
