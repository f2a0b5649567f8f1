//! Reading unstructured grids.

use super::{
    super::cells::{add_cells, list_ends},
    document::{DataSet, Document},
};
use crate::{
    Point,
    io::{
        IoError,
        input::InputFile,
        raw_mesh::{CornerLists, RawMesh},
    },
};

/// The points and cells of all pieces, concatenated in file order, with or without the fields that all pieces have.
pub(in crate::io) fn parse(file: &InputFile, with_fields: bool) -> Result<RawMesh, IoError> {
    let document = Document::parse(file, DataSet::UnstructuredGrid)?;
    let mut raw = RawMesh::default();
    for piece in &document.pieces {
        let first = raw.vertices.len() as i64;
        let within = |kind: &str| file.truncated(format!("a piece without {kind}"));
        let points = piece.points.as_ref().ok_or_else(|| within("Points"))?;
        let cell_array = |name: &str| {
            let named = piece.cells.iter().find(|array| array.name == name);
            named.ok_or_else(|| within(name))
        };

        let coordinates = document.floats(points)?;
        document.expect_length(points, coordinates.len() as u64, piece.point_count.checked_mul(3))?;
        raw.vertices.extend(coordinates.chunks_exact(3).map(Point::from_slice));

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
            return Err(file.malformed_at(place, "the offsets do not ascend within the connectivity"));
        };
        let lists = CornerLists { corners, ends };
        let place = document.place(type_array);
        add_cells(file, place, &mut raw, types.into_iter().zip(lists.iter()))?;
    }
    if with_fields {
        raw.point_fields = document.fields(|piece| &piece.point_data)?;
        raw.cell_fields = document.fields(|piece| &piece.cell_data)?;
    }
    Ok(raw)
}

#[cfg(test)]
mod tests {
    use super::{super::test_files::Builder, *};
    use crate::io::{
        Cells, Field, Place, SolidMesh, VtkFields,
        testing::{place_of, solid, surface, tets},
        write_vtu,
    };

    /// Two pieces: a tetrahedron with a triangle, and an inverted tetrahedron.
    fn file(mut builder: Builder) -> Vec<u8> {
        let mut xml = String::from("<UnstructuredGrid>\n<FieldData>\n");
        xml += &builder.array("type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\"", &[0.5]);
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
            xml += &builder.array("type=\"Float64\" Name=\"connectivity\"", &[1., 2., 3., 4.]);
            xml += &format!(
                "</PointData>\n<Points>\n{}</Points>\n<Cells>\n",
                builder.array(kind, &points)
            );
            xml += &builder.array("type=\"UInt8\" Name=\"types\"", types);
            xml += &builder.array("type=\"Int32\" Name=\"offsets\"", offsets);
            xml += &builder.array("type=\"Int64\" Name=\"connectivity\"", connectivity);
            xml += "</Cells>\n</Piece>\n<FieldData>\n";
        }
        xml += "</FieldData>\n</UnstructuredGrid>\n";
        builder.file("UnstructuredGrid", &xml)
    }

    /// Every way of storing numbers, each as a file of the same grid.
    fn all_files() -> Vec<(String, Vec<u8>)> {
        Builder::all().map(|(name, builder)| (name, file(builder))).collect()
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
            assert!(matches!(solid("vtu", &bytes), Ok(SolidMesh::Cells(_))));
        }
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
    fn written_grids_are_compressed_and_read_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtu");
        // Arrays of several blocks, none of whose sizes divides them.
        let count = 100_003;
        let points: Vec<Point> = (0..count)
            .map(|k| Point::new((f64::from(k)).sin(), 1.0, f64::from(k)))
            .collect();
        let tets: Vec<[u32; 4]> = (0..count as u32 - 3).map(|k| [k, k + 1, k + 2, k + 3]).collect();
        let values: Vec<f64> = (0..count).map(|k| f64::from(k % 7)).collect();
        let fields = VtkFields {
            point: vec![Field {
                name: "phase".into(),
                components: 1,
                values: values.clone(),
            }],
            ..VtkFields::default()
        };
        write_vtu(&path, &points, Cells::Tets(&tets), &fields).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let uncompressed = 24 * points.len() + 8 * (4 * tets.len() + tets.len() + points.len()) + tets.len();
        assert!(2 * bytes.len() < uncompressed, "{} of {uncompressed}", bytes.len());
        let read = crate::io::read_fields(&path).unwrap();
        assert!(
            read.points == points
                && read.cells == crate::mesh::CellList::Tets(tets.clone())
                && read.point[0].values == values
        );
        write_vtu(&path, &[], Cells::Tets(&[]), &VtkFields::default()).unwrap();
        let empty = String::from_utf8(std::fs::read(&path).unwrap()).unwrap();
        assert!(empty.contains("vtkZLibDataCompressor"), "{empty}");
    }

    #[test]
    fn fields_are_read_with_their_surface() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtu");
        let points = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]].map(Point::from);
        let fields = VtkFields {
            point: vec![Field::positions("place", &points)],
            cell: vec![Field::scalar("density", vec![3.])],
            ..VtkFields::default()
        };
        write_vtu(&path, &points, Cells::Quads(&[[0, 1, 2, 3]]), &fields).unwrap();
        let read = crate::io::read_surface_with_fields(&path).unwrap();
        assert_eq!(read.surface.triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(read.point, fields.point);
        assert_eq!(read.triangle, [Field::scalar("density", vec![3., 3.])]);
        // A strip is one cell of several triangles.
        let strip = "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0 1 0 0 0 1 0 1 1 0\n\
                     CELLS 2 7\n4 0 1 2 3\n1 0\nCELL_TYPES 2\n6 1\nCELL_DATA 2\nSCALARS d double 1\nLOOKUP_TABLE default\n1 2\n";
        let path = folder.path().join("a.vtk");
        std::fs::write(&path, strip).unwrap();
        let read = crate::io::read_surface_with_fields(&path).unwrap();
        assert_eq!((read.surface.triangles().len(), read.triangle), (2, vec![]));
        let tets = [[0, 1, 2, 3]];
        write_vtu(
            path.with_extension("vtu"),
            &points,
            Cells::Tets(&tets),
            &VtkFields::default(),
        )
        .unwrap();
        let refused = crate::io::read_surface_with_fields(path.with_extension("vtu"));
        assert!(matches!(refused, Err(IoError::WrongKind { .. })));
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
        let corrupted = String::from_utf8(inline.clone()).unwrap().replacen("\n  ", "\n  !", 3);
        assert!(matches!(
            tets("vtu", corrupted.as_bytes()),
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
    fn truncated_files_are_errors_and_corrupted_ones_never_panic() {
        use rand::{Rng, SeedableRng, rngs::StdRng};

        const CLOSING_TAGS: usize = 30;
        let mut random = StdRng::seed_from_u64(7);
        for (_, bytes) in all_files().into_iter().step_by(5) {
            for end in (0..bytes.len() - CLOSING_TAGS).step_by(7) {
                assert!(solid("vtu", &bytes[..end]).is_err(), "{end}");
            }
            for _ in 0..200 {
                let mut corrupted = bytes.clone();
                for _ in 0..random.random_range(1..4) {
                    let at = random.random_range(0..corrupted.len());
                    corrupted[at] ^= 1 << random.random_range(0..8);
                }
                let _ = solid("vtu", &corrupted);
            }
        }
    }
}
