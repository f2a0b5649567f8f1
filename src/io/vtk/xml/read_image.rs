//! Reading image data: fields on a lattice.

use super::{
    super::lattice::Lattice,
    document::{Array, DataSet, Document, Image, XmlPiece},
};
use crate::{
    Point, Vector,
    io::{Field, IoError, input::InputFile, raw_mesh::RawMesh},
};

/// The points of the single piece with their fields, and six tetrahedra per cell. The axes may be rotated.
pub(in crate::io) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    let document = Document::parse(file, DataSet::ImageData)?;
    let image = document
        .image
        .ok_or_else(|| file.truncated("the element `ImageData`"))?;
    let [piece] = document.pieces.as_slice() else {
        let found = format!("image data in {} pieces", document.pieces.len());
        return Err(file.unsupported(found, "save it in one piece"));
    };
    if piece.point_data.is_empty() && piece.cell_data.is_empty() {
        return Err(file.unsupported(
            "image data without an array of numbers",
            "give it the values that are wanted, at its points or in its cells",
        ));
    }
    let lattice = lattice(file, &image, piece)?;
    lattice.check_size(file)?;
    let [points, cells] = lattice.sizes();
    let mut raw = RawMesh {
        point_fields: fields(&document, &piece.point_data, points)?,
        cell_fields: fields(&document, &piece.cell_data, cells)?,
        ..RawMesh::default()
    };
    lattice.fill(&mut raw);
    Ok(raw)
}

fn lattice(file: &InputFile, image: &Image, piece: &XmlPiece) -> Result<Lattice, IoError> {
    let ends = |extent: &[i32; 6], k: usize| [extent[2 * k], extent[2 * k + 1]].map(i64::from);
    let mut counts = [0; 3];
    for (k, count) in counts.iter_mut().enumerate() {
        let ([first, last], [lowest, highest]) = (ends(&piece.extent, k), ends(&image.whole, k));
        if first < lowest || last > highest || last < first {
            let (piece, whole) = (piece.extent, image.whole);
            let found = format!("the piece's Extent {piece:?} is empty or outside the WholeExtent {whole:?}");
            return Err(file.malformed(0, found));
        }
        *count = (last - first + 1) as usize;
    }
    let [d, spacing] = [&image.direction[..], &image.spacing[..]];
    Ok(Lattice {
        counts,
        first: [0, 1, 2].map(|k| ends(&piece.extent, k)[0]),
        origin: Point::from(image.origin),
        steps: [0, 1, 2].map(|k| Vector::new(d[k], d[3 + k], d[6 + k]) * spacing[k]),
    })
}

/// Arrays with values for `count` points or cells each.
fn fields(document: &Document, arrays: &[Array], count: usize) -> Result<Vec<Field>, IoError> {
    let field = |array: &Array| {
        let values = document.floats(array)?;
        let expected = (count as u64).checked_mul(array.components as u64);
        document.expect_length(array, values.len() as u64, expected)?;
        Ok(Field {
            name: array.name.to_string(),
            components: array.components,
            values,
        })
    };
    arrays.iter().map(field).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{super::test_files::Builder, *};
    use crate::{
        io::{FieldFile, ImageGrid, Place, read_fields, write_vti},
        mesh::CellMesh,
    };

    const AXES: &str = "WholeExtent='-1 1 2 3 0 1' Origin='1 2 3' Spacing='0.5 2 4'";

    /// 3 × 2 × 2 points with a vector and a scalar field, and two cells with a scalar field.
    fn file(mut builder: Builder, image: &str) -> Vec<u8> {
        let steps: Vec<f64> = (0..12).map(f64::from).collect();
        let vectors: Vec<f64> = steps.iter().flat_map(|x| [*x, -x, 0.5]).collect();
        let mut xml = format!("<ImageData {image}>\n<Piece Extent='-1 1 2 3 0 1'>\n<PointData>\n");
        xml += &builder.array("type=\"Float32\" Name=\"v\" NumberOfComponents=\"3\"", &vectors);
        xml += &builder.array("type=\"Int32\" Name=\"n\"", &steps);
        xml += "<Array type=\"String\" Name=\"words\" format=\"ascii\">97 0</Array></PointData>\n<CellData>\n";
        xml += &builder.array("type=\"UInt8\" Name=\"cell\"", &[7., 8.]);
        xml += "</CellData>\n</Piece>\n</ImageData>\n";
        builder.file("ImageData", &xml)
    }

    fn text(image: &str) -> String {
        let (_, builder) = Builder::all().next().unwrap();
        String::from_utf8(file(builder, image)).unwrap()
    }

    fn read(bytes: &[u8]) -> Result<FieldFile, IoError> {
        let path = Path::new("a.vti");
        let file = InputFile {
            path,
            format: "VTI",
            bytes,
        };
        parse(&file)?.into_fields(path)
    }

    fn volumes(read: &FieldFile) -> Vec<f64> {
        let mesh = CellMesh::new(read.points.clone(), read.cells.clone(), vec![0; read.cells.len()]).unwrap();
        (0..read.cells.len()).map(|t| mesh.signed_volume(t)).collect()
    }

    #[test]
    fn every_encoding_reads_the_same_fields_at_the_same_points() {
        for (name, builder) in Builder::all() {
            let read = read(&file(builder, AXES)).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(read.points[0], Point::new(0.5, 6.0, 3.0), "{name}");
            assert_eq!(read.points[1] - read.points[0], Vector::new(0.5, 0.0, 0.0), "{name}");
            assert_eq!(read.points[3] - read.points[0], Vector::new(0.0, 2.0, 0.0), "{name}");
            assert_eq!(read.points[11], Point::new(1.5, 8.0, 7.0), "{name}");
            assert_eq!((read.points.len(), read.cells.len()), (12, 12), "{name}");
            assert!(volumes(&read).iter().all(|v| (v - 4.0 / 6.0).abs() < 1e-12), "{name}");
            assert_eq!((read.point.len(), read.cell.len()), (2, 1), "{name}");
            assert_eq!(
                (read.point[0].name.as_str(), read.point[0].components),
                ("v", 3),
                "{name}"
            );
            assert_eq!(read.point[0].values[33..], [11.0, -11.0, 0.5], "{name}");
            assert_eq!(
                read.point[1].values,
                (0..12).map(f64::from).collect::<Vec<_>>(),
                "{name}"
            );
            assert_eq!(read.cell[0].values, [[7.0; 6], [8.0; 6]].concat(), "{name}");
        }
    }

    #[test]
    fn the_direction_turns_the_axes() {
        // A quarter turn about z: x goes to y, y to -x.
        let turned = read(text(&format!("{AXES} Direction='0 -1 0 1 0 0 0 0 1'")).as_bytes()).unwrap();
        let plain = read(text(AXES).as_bytes()).unwrap();
        for (p, q) in plain.points.iter().zip(&turned.points) {
            let from_origin = p - Point::new(1.0, 2.0, 3.0);
            let expected = Point::new(1.0 - from_origin.y, 2.0 + from_origin.x, p.z);
            assert!((q - expected).norm() < 1e-12, "{p}: {q}");
        }
        assert!(volumes(&turned).iter().all(|v| (v - 4.0 / 6.0).abs() < 1e-12));
    }

    #[test]
    fn written_images_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("volume.vti");
        let grid = ImageGrid {
            origin: Point::new(-1.0, 0.1, 2.0),
            spacing: 0.25,
            size: [5, 4, 3],
        };
        let bytes: Vec<u8> = (0..240).map(|k| (37 * k % 256) as u8).collect();
        write_vti(&path, &grid, "rgba", 4, &bytes).unwrap();
        let read = read_fields(&path).unwrap();
        let place = |i: usize| [i % 5, i / 5 % 4, i / 20].map(|k| 0.25 * k as f64);
        for (i, p) in read.points.iter().enumerate() {
            assert_eq!(*p, grid.origin + Vector::from(place(i)));
        }
        assert_eq!(read.cells.len(), 6 * 4 * 3 * 2);
        assert_eq!((read.point.len(), read.point[0].components), (1, 4));
        assert!(
            read.point[0]
                .values
                .iter()
                .zip(&bytes)
                .all(|(x, b)| *x == f64::from(*b))
        );

        // A flat grid has no tetrahedra.
        let flat = ImageGrid {
            size: [20, 3, 1],
            ..grid
        };
        write_vti(&path, &flat, "rgba", 4, &bytes).unwrap();
        let read = read_fields(&path).unwrap();
        assert_eq!(
            (read.points.len(), read.cells.len(), read.point[0].values.len()),
            (60, 0, 240)
        );
    }

    #[test]
    fn faults_are_named() {
        let whole = text(AXES);
        let with = |from: &str, to: &str| {
            assert!(whole.contains(from), "{from}");
            read(whole.replacen(from, to, 1).as_bytes()).unwrap_err()
        };
        for (from, to, fragments) in [
            (
                "type=\"ImageData\"",
                "type=\"RectilinearGrid\"",
                ["RectilinearGrid", "save it as image data"],
            ),
            ("WholeExtent", "Extent", ["ImageData", "`WholeExtent`"]),
            ("<Piece Extent", "<Piece Part", ["`Piece`", "`Extent`"]),
            ("0.5 2 4", "0.5 2", ["Spacing=\"0.5 2\"", "line 4"]),
            ("Origin='1 2 3'", "Origin='1 2 x'", ["Origin=\"1 2 x\"", "line 4"]),
            (
                "Extent='-1 1 2 3",
                "Extent='0 1 2 3",
                ["[-1, 1, 2, 3, 0, 1]", "WholeExtent"],
            ),
            (
                "<Piece Extent='-1 1",
                "<Piece Extent='1 -1",
                ["[1, -1, 2, 3, 0, 1]", "WholeExtent"],
            ),
            ("<Piece Extent='-1 1", "<Piece Extent='0 1", ["36 values", "needs 24"]),
            (
                "</Piece>",
                "</Piece><Piece Extent='0 0 0 0 0 0'/>",
                ["2 pieces", "one piece"],
            ),
            (">7 8 <", ">7 8 9 <", ["3 values", "needs 2"]),
            (">7 8 <", ">7 eight <", ["eight", "a number"]),
            (
                "NumberOfComponents=\"3\"",
                "NumberOfComponents=\"4\"",
                ["36 values", "needs 48"],
            ),
        ] {
            let message = with(from, to).to_string();
            assert!(fragments.iter().all(|f| message.contains(f)), "{to}: {message}");
        }
        let none = "<ImageData WholeExtent='0 150 0 150 0 150'><Piece Extent='0 150 0 150 0 150'/></ImageData>";
        let (_, builder) = Builder::all().next().unwrap();
        let message = read(&builder.file("ImageData", none)).unwrap_err().to_string();
        assert!(message.contains("without an array of numbers"), "{message}");
        let many = whole.replace(
            "Extent='-1 1 2 3 0 1'",
            "Extent='0 2000000000 0 2000000000 0 2000000000'",
        );
        let message = read(many.as_bytes()).unwrap_err().to_string();
        assert!(message.contains("at most 4194304"), "{message}");
        assert!(matches!(
            read(b"hello"),
            Err(IoError::Malformed {
                place: Place::Line(1),
                ..
            })
        ));
        assert!(matches!(
            read(&whole.as_bytes()[..whole.len() - 15]),
            Err(IoError::Truncated { .. })
        ));
    }

    #[test]
    fn truncated_files_are_errors_and_corrupted_ones_never_panic() {
        use rand::{Rng, SeedableRng, rngs::StdRng};

        const CLOSING_TAGS: usize = 30;
        let mut random = StdRng::seed_from_u64(11);
        for (name, builder) in Builder::all().step_by(5) {
            let bytes = file(builder, AXES);
            for end in 0..bytes.len() - CLOSING_TAGS {
                assert!(read(&bytes[..end]).is_err(), "{name}: {end}");
            }
            for _ in 0..300 {
                let mut corrupted = bytes.clone();
                for _ in 0..random.random_range(1..4) {
                    let at = random.random_range(0..corrupted.len());
                    corrupted[at] ^= 1 << random.random_range(0..8);
                }
                let _ = read(&corrupted);
            }
        }
    }
}
