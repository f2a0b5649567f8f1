//! A small valid file of every kind that is read: what the tests of bad input and the fuzzer begin with.

use std::path::Path;

use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{
    BoundaryFile, BoundaryMetadata, MapFile, MapMetadata, TextureFile, TextureMetadata, write_boundary, write_map,
    write_texture,
};
use solidmap::fit::{FitOptions, fit};
use solidmap::io::{
    Cells, Field, ImageGrid, VtkEncoding, VtkFields, write_cell_mesh, write_cells, write_csv, write_npy, write_surface,
    write_tets, write_vti, write_vtk, write_vtu,
};
use solidmap::mesh::{CellList, CellMesh, SurfaceMesh, TetMesh, shapes};
use solidmap::spherical::SphericalEmbedding;
use solidmap::texture::{ColouredSurface, Picture, SolidTexture, TextureOptions, Wrap};

/// A file that is read without complaint.
pub struct SmallFile {
    /// What is in it, as a name for a file.
    pub name: &'static str,
    /// How it is read.
    pub format: Format,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// The readers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum Format {
    Obj,
    Off,
    Ply,
    Stl,
    Medit,
    Gmsh,
    Vtk,
    Vtu,
    Vti,
    Csv,
    Npy,
    Landmarks,
    Map,
    Boundary,
    Texture,
    Picture,
}

impl Format {
    /// The extension by which the reader is chosen; from landmarks on, any will do.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Off => "off",
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Medit => "mesh",
            Self::Gmsh => "msh",
            Self::Vtk => "vtk",
            Self::Vtu => "vtu",
            Self::Vti => "vti",
            Self::Csv => "csv",
            Self::Npy => "npy",
            Self::Landmarks => "txt",
            Self::Map => "map",
            Self::Boundary => "boundary",
            Self::Texture => "texture",
            Self::Picture => "png",
        }
    }

    /// Whether it holds a mesh.
    pub fn is_mesh(self) -> bool {
        use Format::*;
        matches!(self, Obj | Off | Ply | Stl | Medit | Gmsh | Vtk | Vtu)
    }
}

/// The files, made in a folder that is gone afterwards.
pub fn small_files() -> Vec<SmallFile> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut files = Vec::new();
    let mut add = |name: &'static str, format: Format, write: &dyn Fn(&Path)| {
        let path = folder.path().join(format!("{name}.{}", format.extension()));
        write(&path);
        let bytes = std::fs::read(&path).expect("it was written");
        files.push(SmallFile { name, format, bytes });
    };
    meshes(&mut add);
    other_meshes(&mut add);
    fields(&mut add);
    tables(&mut add);
    tensor_files(&mut add);
    pictures(&mut add);
    files
}

type Add<'a> = dyn FnMut(&'static str, Format, &dyn Fn(&Path)) + 'a;

fn tetrahedron() -> SurfaceMesh {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.25, 1.5]].map(Point::from);
    SurfaceMesh::new(points.to_vec(), vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("indices in range")
}

fn meshes(add: &mut Add) {
    use Format::*;
    let surface = tetrahedron();
    for format in [Obj, Ply, Off, Medit, Vtk, Vtu] {
        add("surface", format, &|path| write_surface(path, &surface).unwrap());
    }
    let tets = TetMesh::new(surface.vertices().to_vec(), vec![[0, 1, 2, 3]]).unwrap();
    for format in [Medit, Vtk, Vtu] {
        add("tets", format, &|path| write_tets(path, &tets).unwrap());
    }
    let corners: Vec<Point> = (0..8)
        .map(|k| {
            Point::new(
                f64::from((k & 1) ^ (k >> 1 & 1)),
                f64::from(k >> 1 & 1),
                f64::from(k >> 2),
            )
        })
        .collect();
    for format in [Medit, Vtk, Vtu] {
        let cells = Cells::Hexes(&[[0, 1, 2, 3, 4, 5, 6, 7]]);
        add("hex", format, &|path| write_cells(path, &corners, cells).unwrap());
    }
    let hex = CellList::Hexes(vec![[0, 1, 2, 3, 4, 5, 6, 7]]);
    let hex = CellMesh::new(corners, hex, vec![5]).unwrap();
    add("hex", Gmsh, &|path| write_cell_mesh(path, &hex).unwrap());
    add("tets", Gmsh, &|path| {
        write_cell_mesh(path, &CellMesh::from(tets.clone())).unwrap()
    });
    add("blocks", Gmsh, &|path| std::fs::write(path, GMSH_4).unwrap());
}

/// A tetrahedron in Gmsh's format 4.1.
const GMSH_4: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n2 4 1 4\n2 1 1 3\n1\n2\n3\n0 0 0 0.5 0.5\n\
                      1 0 0 0.5 0.5\n0 1 0 0.5 0.5\n3 1 0 1\n4\n0 0 1\n$EndNodes\n$Elements\n2 2 1 2\n2 1 2 1\n1 1 2 3\n\
                      3 1 4 1\n2 1 2 3 4\n$EndElements\n";

/// Variants that other programs write and this one does not.
fn other_meshes(add: &mut Add) {
    use Format::*;
    let surface = tetrahedron();
    let mut text = String::from("solid a\n");
    let mut binary = vec![b' '; 80];
    binary.extend((surface.triangles().len() as u32).to_le_bytes());
    for triangle in 0..surface.triangles().len() {
        let corners = surface.corners(triangle);
        let vertices = corners.map(|p| format!("vertex {} {} {}\n", p.x, p.y, p.z)).concat();
        text += &format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n");
        binary.extend([0; 12]);
        let coordinates = corners.iter().flat_map(|p| p.iter());
        binary.extend(coordinates.flat_map(|&x| (x as f32).to_le_bytes()));
        binary.extend([0; 2]);
    }
    text += "endsolid a\n";
    let mut add_bytes = |name, format, bytes: &[u8]| {
        add(name, format, &|path| std::fs::write(path, bytes).unwrap());
    };
    add_bytes("text", Stl, text.as_bytes());
    add_bytes("binary", Stl, &binary);
    add_bytes(
        "textured",
        Obj,
        b"mtllib a.mtl\no a\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1 .5 .5 .5\nvt 0 0\nvt 1 0\nvt 0 1 0\n\
          vn 0 0 1\nusemtl a\ns off\nf 1/1/1 3/2/1 2/3/1\nf 1/1 2/2 4/3\nf -3/-3 -2/-2 -1/-1\nf 1/1 4/2 \\\n3/3\n",
    );
    add_bytes(
        "quads",
        Obj,
        b"# a cube\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 4 3 2 1\nf 5 6 7 8\n\
          f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n",
    );
    add_bytes(
        "coloured",
        Off,
        b"COFF\n4 4 6\n0 0 0 255 0 0 255\n1 0 0 0 1 0 1\n0 1 0 0 0 255 9\n0 0 1 1 1 1 1\n# faces\n3 0 2 1 0.5 0 0\n3 0 1 3\n\
          3 1 2 3\n3 0 3 2\n",
    );
    add_bytes(
        "strips",
        Ply,
        b"ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
          element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n\
          7 0 2 1 3 -1 0 2\n",
    );
    let mut big =
        b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nelement face 1\nproperty list uchar int vertex_index\nproperty short flags\nend_header\n"
            .to_vec();
    for vertex in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
        big.extend(vertex.iter().flat_map(|x| x.to_be_bytes()));
        big.push(200);
    }
    big.extend([3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 7]);
    add_bytes("big_endian", Ply, &big);
    add_bytes(
        "sections",
        Medit,
        b"MeshVersionFormatted 2\n# a comment\nDimension\n3\nVertices\n4\n0 0 0 1\n1 0 0 1\n0 1 0 2\n0 0 1 0\nCorners 2\n1\n2\n\
          Triangles\n2\n1 3 2 7\n1 2 4 7\nQuadrilaterals 1\n1 2 3 4 0\nTetrahedra 1\n1 2 3 4 5\nEnd\n",
    );
    add_bytes(
        "polydata",
        Vtk,
        b"# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\nPOLYGONS 2 8\n3 0 2 1\n\
          3 0 1 3\nTRIANGLE_STRIPS 1 5\n4 0 1 2 3\nMETADATA\nCOMPONENT_NAMES\n\nPOINT_DATA 4\nSCALARS s float 1\n\
          LOOKUP_TABLE default\n1 2 3 4\nVECTORS v double\n1 0 0 0 1 0 0 0 1 1 1 1\n",
    );
    add_bytes(
        "offsets",
        Vtk,
        b"# vtk DataFile Version 5.1\na\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 2 4\n\
          OFFSETS vtktypeint64\n0 4\nCONNECTIVITY vtktypeint64\n0 1 2 3\nCELL_TYPES 1\n10\nCELL_DATA 1\nFIELD FieldData 1\n\
          k 1 1 int\n5\n",
    );
    add_bytes(
        "lattice",
        Vtk,
        b"# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 .5\n\
          POINT_DATA 8\nSCALARS s float\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n",
    );
}

fn fields(add: &mut Add) {
    let surface = tetrahedron();
    let cells = Cells::Tets(&[[0, 1, 2, 3]]);
    let field = |name: &str, components: usize, count: usize| Field {
        name: name.into(),
        components,
        values: (0..components * count).map(|k| k as f64 / 3.0).collect(),
    };
    let fields = VtkFields {
        point: vec![field("t", 1, 4), field("v", 3, 4)],
        cell: vec![field("q", 9, 1)],
        comment: "made by hand".into(),
    };
    for (name, encoding) in [("fields_text", VtkEncoding::Text), ("fields", VtkEncoding::Binary)] {
        let write = |path: &Path| write_vtk(path, surface.vertices(), cells, &fields, encoding).unwrap();
        add(name, Format::Vtk, &write);
    }
    add("fields", Format::Vtu, &|path| {
        write_vtu(path, surface.vertices(), cells, &fields).unwrap()
    });
    add("text", Format::Vtu, &|path| {
        std::fs::write(path, vtu("ascii", "", &text_arrays())).unwrap()
    });
    let compressed = || vtu("binary", "compressor=\"vtkZLibDataCompressor\"", &compressed_arrays());
    add("zlib", Format::Vtu, &|path| std::fs::write(path, compressed()).unwrap());
    let grid = ImageGrid {
        origin: Point::origin(),
        spacing: 0.5,
        size: [2; 3],
    };
    let bytes: Vec<u8> = (0..8).collect();
    add("image", Format::Vti, &|path| {
        write_vti(path, &grid, "k", 1, &bytes).unwrap()
    });
    add("appended", Format::Vtu, &|path| {
        std::fs::write(path, appended()).unwrap()
    });
}

const POINTS: [f64; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

fn text_arrays() -> [String; 5] {
    let numbers = |values: &[f64]| values.iter().map(|x| format!("{x} ")).collect();
    [
        numbers(&POINTS),
        "0 1 2 3".into(),
        "4".into(),
        "10".into(),
        "1 2 3 4".into(),
    ]
}

/// The same numbers, each array in one block.
fn compressed_arrays() -> [String; 5] {
    use std::io::Write;

    use base64::{Engine, engine::general_purpose::STANDARD};
    raw_arrays().map(|bytes| {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        encoder.write_all(&bytes).unwrap();
        let block = encoder.finish().unwrap();
        let lengths = [1, bytes.len(), 0, block.len()].map(|n| (n as u32).to_le_bytes());
        STANDARD.encode(lengths.concat()) + &STANDARD.encode(block)
    })
}

fn raw_arrays() -> [Vec<u8>; 5] {
    let points = POINTS.iter().flat_map(|x| x.to_le_bytes()).collect();
    let connectivity = [0i32, 1, 2, 3].iter().flat_map(|v| v.to_le_bytes()).collect();
    let field = [1.0f64, 2.0, 3.0, 4.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    [points, connectivity, 4i32.to_le_bytes().to_vec(), vec![10], field]
}

/// A file of one tetrahedron with these contents of its arrays.
fn vtu(format: &str, root: &str, arrays: &[String; 5]) -> String {
    let [points, connectivity, offsets, types, field] = arrays;
    let array = |kind: &str, name: &str, more: &str, content: &str| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\" {more} format=\"{format}\">{content}</DataArray>\n")
    };
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\" {root}>\n\
         <UnstructuredGrid>\n<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">\n<PointData>\n{}</PointData>\n<Points>\n{}\
         </Points>\n<Cells>\n{}{}{}</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n",
        array("Float64", "t", "", field),
        array("Float64", "Points", "NumberOfComponents=\"3\"", points),
        array("Int32", "connectivity", "", connectivity),
        array("Int32", "offsets", "", offsets),
        array("UInt8", "types", "", types),
    )
}

/// As VTK writes it by itself: the arrays behind the XML, raw.
fn appended() -> Vec<u8> {
    let mut data = Vec::new();
    let offsets = raw_arrays().map(|bytes| {
        let offset = data.len();
        data.extend((bytes.len() as u32).to_le_bytes());
        data.extend(bytes);
        offset
    });
    let mut xml = vtu("appended", "", &std::array::from_fn(|_| String::new()));
    // The arrays stand in another order in the XML.
    for k in [4, 0, 1, 2, 3] {
        xml = xml.replacen(
            "format=\"appended\">",
            &format!("format=\"appended\" offset=\"{}\">", offsets[k]),
            1,
        );
    }
    let mut bytes = xml
        .replace("</VTKFile>\n", "<AppendedData encoding=\"raw\">\n_")
        .into_bytes();
    bytes.extend(data);
    bytes.extend(b"\n</AppendedData>\n</VTKFile>\n");
    bytes
}

fn tables(add: &mut Add) {
    let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.5];
    add("points", Format::Csv, &|path| {
        write_csv(path, &["x", "y", "z"], &values).unwrap()
    });
    add("fields", Format::Csv, &|path| {
        std::fs::write(
            path,
            "t,x,y,z,v_x,v_y,v_z,\"a, b\"\n1,2,3,4,5,6,7,8\n-1,nan,inf,1e300,1e-300,.5,0,-0\n",
        )
        .unwrap();
    });
    add("points", Format::Npy, &|path| write_npy(path, 3, &values).unwrap());
    add("pairs", Format::Landmarks, &|path| {
        std::fs::write(path, "# pairs\n1 12\n2,3\n7;19 # nose\n\n0\t4\n").unwrap()
    });
    add("vertices", Format::Landmarks, &|path| {
        std::fs::write(path, "3\n0\n12\n").unwrap()
    });
}

fn tensor_files(add: &mut Add) {
    let ball = shapes::geodesic_sphere(1.0, 1);
    let options = FitOptions {
        max_sources: 12,
        refine: false,
        held_out: 10,
        ..FitOptions::default()
    };
    let image = ball
        .vertices()
        .iter()
        .map(|p| Point::new(2.0 * p.x, p.y, p.z + 0.2 * p.x));
    let straight = BoundaryMap::new(ball.clone(), image.collect()).unwrap();
    let fitted = fit(&straight, &options, &|_| {}).unwrap();
    let by_rays = |surface: SurfaceMesh| {
        let directions: Vec<_> = surface.vertices().iter().map(|p| p.coords).collect();
        SphericalEmbedding::new(surface, &directions).unwrap()
    };
    let through = BoundaryMap::through_sphere(by_rays(ball.clone()), by_rays(shapes::cube(2.0, 1))).unwrap();
    for (name, boundary) in [("straight", straight), ("through", through)] {
        add(name, Format::Map, &|path| {
            let metadata = MapMetadata::new(fitted.report.clone(), vec![]);
            let boundary = Some(boundary.clone());
            let map = fitted.map.clone();
            write_map(
                path,
                &MapFile {
                    map,
                    boundary,
                    bijective: None,
                    metadata,
                },
            )
            .unwrap();
        });
        add(name, Format::Boundary, &|path| {
            let metadata = BoundaryMetadata::new(vec![]);
            let boundary = boundary.clone();
            write_boundary(path, &BoundaryFile { boundary, metadata }).unwrap();
        });
    }
    let colours = ball
        .vertices()
        .iter()
        .map(|p| [p.x.abs(), p.y.abs(), p.z.abs()])
        .collect();
    let uv = vec![[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]; ball.triangles().len()];
    let picture = Picture::checker(2).unwrap();
    for (name, skin) in [
        ("colours", ColouredSurface::from_vertex_colours(&ball, colours).unwrap()),
        (
            "picture",
            ColouredSurface::from_picture(&ball, uv, picture, Wrap::Repeat).unwrap(),
        ),
    ] {
        add(name, Format::Texture, &|path| {
            let options = TextureOptions {
                least_sources: 0,
                fit: options.clone(),
                ..TextureOptions::default()
            };
            let texture = SolidTexture::fit(skin.clone(), &options, &|_| {}).unwrap();
            let metadata = TextureMetadata::new(texture.report().clone(), vec![]);
            write_texture(path, &TextureFile { texture, metadata }).unwrap();
        });
    }
}

fn pictures(add: &mut Add) {
    let pixels: Vec<u8> = (0..48).map(|k| (5 * k) as u8).collect();
    let picture = image::RgbImage::from_raw(4, 4, pixels).unwrap();
    for (name, format) in [("png", image::ImageFormat::Png), ("jpeg", image::ImageFormat::Jpeg)] {
        add(name, Format::Picture, &|path| {
            picture.save_with_format(path, format).unwrap()
        });
    }
}
