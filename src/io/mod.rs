//! Meshes, fields and point lists in files.
//!
//! The extension names the format. Files are read whole and in their own order: no function here renumbers, merges
//! or drops vertices; only STL, which has no vertices, gets them by merging equal corner positions. NaN and infinite
//! coordinates are read as they are; [`crate::check`] finds them.
//!
//! | extension | read | written |
//! |---|---|---|
//! | `.obj` | surface; labels of a polycube's triangles | the same |
//! | `.ply` | surface (text, binary; faces or strips); labels of a polycube's triangles | the same (binary) |
//! | `.off` | surface | surface |
//! | `.stl` | surface (text, binary) | no: it would lose the order of vertices |
//! | `.mesh` | surface, tetrahedra, hexahedra | triangles, quads, tetrahedra, hexahedra; labels |
//! | `.msh` | as `.mesh` (Gmsh's formats 2.2 and 4.1, text) | as `.mesh`, in Gmsh's format 2.2 |
//! | `.vtk` | surface, tetrahedra, hexahedra; fields (text, binary) | triangles, quads, tetrahedra, hexahedra; fields |
//! | `.vtu` | surface, tetrahedra, hexahedra; fields (all encodings but LZ4 and LZMA) | as `.vtk` |
//! | `.vti` | fields on a grid (encodings as `.vtu`) | bytes on a grid, compressed |
//! | `.csv` | points; fields | tables |
//! | `.npy` | points | tables |
//! | `.pvd` | VTK files with their times ([`read_pvd`]) | the same ([`write_pvd`]) |
//!
//! Polygons become fans of triangles about their first corner, whatever their shape, so that two meshes with the same
//! faces get the same triangles. Files are written whole or not at all ([`atomic_write`]).

mod atomic;
mod cells;
mod error;
mod fields;
mod gmsh;
mod input;
mod labelled_surface;
mod medit;
mod node_images;
mod obj;
mod off;
mod ply;
mod points;
mod polygon;
mod pvd;
mod raw_mesh;
mod stl;
mod textured_obj;
mod triangle_labels;
mod vtk;

use std::{fs, path::Path};

use input::InputFile;
pub(crate) use input::printable;
use raw_mesh::RawMesh;

pub use atomic::{abandon_writes, atomic_write, sync_folder, try_abandon_writes};
pub use cells::{CellGroup, Cells};
pub use error::{IoError, Place};
pub use fields::{Field, VtkFields};
pub use labelled_surface::{holds_labelled_surface, write_labelled_surface};
pub use node_images::read_node_images;
pub use ply::write_coloured_ply;
pub use points::{write_csv, write_npy};
pub use pvd::{read_pvd, write_pvd};
pub use textured_obj::{TexturedSurface, read_textured_surface};
pub use triangle_labels::{read_triangle_labels, write_triangle_labels};
pub use vtk::{ImageGrid, VtkEncoding, write_vti, write_vtk, write_vtu};

use crate::{
    Point,
    mesh::{CellList, CellMesh, SurfaceMesh, TetMesh},
};

/// A solid, given by its surface or filled with tetrahedra or hexahedra.
#[derive(Debug, Clone, PartialEq)]
pub enum SolidMesh {
    /// A surface that bounds the solid.
    Surface(SurfaceMesh),
    /// Cells that fill the solid.
    Cells(CellMesh),
}

impl SolidMesh {
    /// The vertices of the surface, or the nodes of the cells.
    pub fn vertices(&self) -> &[Point] {
        match self {
            Self::Surface(surface) => surface.vertices(),
            Self::Cells(cells) => cells.nodes(),
        }
    }

    /// The triangles, or the cells.
    pub fn elements(&self) -> Cells<'_> {
        match self {
            Self::Surface(surface) => Cells::Triangles(surface.triangles()),
            Self::Cells(cells) => cells.cells().into(),
        }
    }

    /// The surface, or the boundary of the cells ([`CellMesh::boundary`]).
    pub fn into_surface(self) -> SurfaceMesh {
        match self {
            Self::Surface(surface) => surface,
            Self::Cells(cells) => cells.boundary().surface,
        }
    }

    /// The same elements over other positions of the vertices, such as their images. `None` when the count differs.
    pub fn with_vertices(&self, vertices: Vec<Point>) -> Option<Self> {
        match self {
            Self::Surface(surface) => surface.with_vertices(vertices).map(Self::Surface),
            Self::Cells(cells) => cells.with_nodes(vertices).map(Self::Cells),
        }
    }
}

/// Points with fields, and the mesh between them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldFile {
    /// The points, or the vertices of the mesh.
    pub points: Vec<Point>,
    /// Tetrahedra or hexahedra between them.
    pub cells: CellList,
    /// Triangles between them, in a file without cells.
    pub triangles: Vec<[u32; 3]>,
    /// Fields over the points.
    pub point: Vec<Field>,
    /// Fields over the cells.
    pub cell: Vec<Field>,
}

/// A surface with fields.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceFields {
    /// The surface.
    pub surface: SurfaceMesh,
    /// Fields over its vertices.
    pub point: Vec<Field>,
    /// Fields over its triangles.
    pub triangle: Vec<Field>,
}

/// Whether the extension is that of a mesh format.
pub fn is_mesh(path: impl AsRef<Path>) -> bool {
    let extension = extension(path.as_ref());
    MESH_FORMATS.iter().any(|format| format.extension == extension)
}

/// Reads a surface (`.obj`, `.ply`, `.off`, `.stl`, `.mesh`, `.msh`, `.vtk`, `.vtu`). Several objects in one file
/// become one mesh; unreferenced vertices stay.
///
/// Polygons are cut into triangles by the order of their corners alone, so that surfaces with the same faces have the same
/// triangles; but concave ones, and those with corners on straight sides, by their shape where that is needed for triangles
/// that do not overlap. [`read_surface_as`] reads the image of such a surface.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::WrongKind`] when the file holds tetrahedra or hexahedra.
pub fn read_surface(path: impl AsRef<Path>) -> Result<SurfaceMesh, IoError> {
    let path = path.as_ref();
    read_mesh(path, "a surface")?.into_surface(path)
}

/// As [`read_surface`], but cuts polygons into the triangles of another surface wherever that has been cut from the same
/// polygons: so a boundary map can go from one to the other whatever their shapes.
///
/// # Errors
///
/// As [`read_surface`].
pub fn read_surface_as(path: impl AsRef<Path>, other: &SurfaceMesh) -> Result<SurfaceMesh, IoError> {
    let path = path.as_ref();
    read_mesh(path, "a surface")?.into_surface_as(path, other)
}

/// Reads a tetrahedral mesh (`.mesh`, `.msh`, `.vtk`, `.vtu`), inverted tetrahedra included. Triangles, lines and
/// points are skipped.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::WrongKind`] when the file holds a surface, or hexahedra.
pub fn read_tets(path: impl AsRef<Path>) -> Result<TetMesh, IoError> {
    let path = path.as_ref();
    read_mesh(path, "a tetrahedral mesh")?.into_tets(path)
}

/// Reads a mesh of tetrahedra or of hexahedra (`.mesh`, `.msh`, `.vtk`, `.vtu`), inverted cells included. Regions are the
/// references of `.mesh` files and the physical groups of `.msh` files in format 2.2, and 0 in others. Everything but
/// the cells is skipped.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::WrongKind`] when the file holds faces alone,
/// [`IoError::Unsupported`] when its cells are of several kinds or of another kind.
pub fn read_cells(path: impl AsRef<Path>) -> Result<CellMesh, IoError> {
    let path = path.as_ref();
    const PURPOSE: &str = "a mesh of tetrahedra or hexahedra";
    match read_mesh(path, PURPOSE) {
        // A surface format is parsed all the same, to say what the file holds, but the error does not suggest one.
        Err(IoError::UnknownExtension { .. }) => Err(unknown_extension(path, PURPOSE, CELL_MESH_EXTENSIONS)),
        raw => raw?.into_cells(path),
    }
}

/// Reads a surface, or a mesh of tetrahedra or of hexahedra, by content: a file with cells is a mesh of cells even if it
/// has triangles too. Regions are as in [`read_cells`], but all 0 where a reference in the file is not a 32-bit integer.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::Unsupported`] when the cells are of several kinds or of another kind.
pub fn read_solid(path: impl AsRef<Path>) -> Result<SolidMesh, IoError> {
    let path = path.as_ref();
    read_mesh(path, "a solid")?.into_solid(path)
}

/// Reads points: the columns `x`, `y`, `z` of a CSV table, an NPY array of shape `n × 3`, or the vertices of a mesh
/// file of any kind, also one without faces.
///
/// # Errors
///
/// Any [`IoError`] but those of writing.
pub fn read_points(path: impl AsRef<Path>) -> Result<Vec<Point>, IoError> {
    let formats = MESH_FORMATS.iter().chain(&POINT_FORMATS);
    read(path.as_ref(), "points", formats).map(|raw| raw.vertices)
}

/// Reads points with fields: the columns beside `x`, `y` and `z` of a CSV table (three in a row whose names differ only
/// in a final x, y and z are a vector), or the point and cell data of a `.vtk` or `.vtu` file of tetrahedra, hexahedra,
/// triangles or points, and of at most 2²² structured points in a `.vtk` or `.vti` file, whose cells become six
/// tetrahedra each. Cell data of triangles and of flat grids are skipped. All other formats have no fields; labels in a
/// `.mesh` are not read as fields.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::ValueCount`] unless a field has one value for each point or cell,
/// [`IoError::Unsupported`] also for a field of more than 4096 components.
pub fn read_fields(path: impl AsRef<Path>) -> Result<FieldFile, IoError> {
    let path = path.as_ref();
    let has_fields = |other: &&Format| FIELD_FORMATS.iter().any(|format| format.extension == other.extension);
    let others = MESH_FORMATS
        .iter()
        .chain(&POINT_FORMATS)
        .filter(move |other| !has_fields(other));
    read(path, "fields", FIELD_FORMATS.iter().chain(others))?.into_fields(path)
}

/// Reads a surface with its fields (`.vtk`, `.vtu`). Cell data are kept where all cells of the file are triangles or polygons,
/// whose triangles get the polygon's value.
///
/// # Errors
///
/// As [`read_surface`] and [`read_fields`].
pub fn read_surface_with_fields(path: impl AsRef<Path>) -> Result<SurfaceFields, IoError> {
    let path = path.as_ref();
    let formats = FIELD_FORMATS
        .iter()
        .filter(|format| ["vtk", "vtu"].contains(&format.extension));
    read(path, "a surface with fields", formats)?.into_surface_with_fields(path)
}

/// Writes a surface (`.obj`, `.ply`, `.off`, `.mesh`, `.msh`, `.vtk`, `.vtu`, `.stl`). Coordinates read back to the same
/// bits, but from `.stl`, which has them in single precision, and no vertices that triangles share.
///
/// # Errors
///
/// [`IoError::UnknownExtension`], [`IoError::Write`], also for coordinates that are finite in double precision only.
pub fn write_surface(path: impl AsRef<Path>, mesh: &SurfaceMesh) -> Result<(), IoError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => atomic_write(path, |writer| obj::write(writer, mesh)),
        "ply" => atomic_write(path, |writer| ply::write(writer, mesh)),
        "off" => atomic_write(path, |writer| off::write(writer, mesh)),
        "stl" => atomic_write(path, |writer| stl::write(writer, mesh)),
        "msh" => {
            let cells = Cells::Triangles(mesh.triangles());
            let labels = &vec![1; cells.count()];
            let names = &[];
            write_groups(path, mesh.vertices(), &[CellGroup { cells, labels, names }], "")
        }
        extension if CELL_EXTENSIONS.contains(&extension) => {
            write_cells(path, mesh.vertices(), Cells::Triangles(mesh.triangles()))
        }
        _ => {
            let known = ["obj", "ply", "off", "stl", "msh"].into_iter().chain(CELL_EXTENSIONS);
            Err(unknown_extension(path, "writing a surface", known))
        }
    }
}

/// Writes a tetrahedral mesh (`.mesh`, `.vtk`, `.vtu`). Coordinates read back to the same bits.
///
/// # Errors
///
/// [`IoError::UnknownExtension`], [`IoError::Write`].
pub fn write_tets(path: impl AsRef<Path>, mesh: &TetMesh) -> Result<(), IoError> {
    write_cells(path, mesh.vertices(), Cells::Tets(mesh.tets()))
}

/// Writes a solid: a surface as [`write_surface`], cells as [`write_cell_mesh`].
///
/// # Errors
///
/// As the two.
pub fn write_solid(path: impl AsRef<Path>, solid: &SolidMesh) -> Result<(), IoError> {
    match solid {
        SolidMesh::Surface(surface) => write_surface(path, surface),
        SolidMesh::Cells(cells) => write_cell_mesh(path, cells),
    }
}

/// Writes a mesh of tetrahedra or hexahedra: `.mesh` and `.msh` with its regions, as [`write_groups`]; `.vtk` and `.vtu`
/// without, as [`write_cells`]. Coordinates read back to the same bits.
///
/// # Errors
///
/// [`IoError::UnknownExtension`], [`IoError::Write`].
pub fn write_cell_mesh(path: impl AsRef<Path>, mesh: &CellMesh) -> Result<(), IoError> {
    let path = path.as_ref();
    let cells = Cells::from(mesh.cells());
    match extension(path).as_str() {
        "mesh" | "msh" => {
            let (labels, names) = (mesh.regions(), &[]);
            write_groups(path, mesh.nodes(), &[CellGroup { cells, labels, names }], "")
        }
        "vtk" | "vtu" => write_cells(path, mesh.nodes(), cells),
        _ => Err(unknown_extension(path, "writing cells", CELL_MESH_EXTENSIONS)),
    }
}

/// Writes points and cells (`.mesh`; `.vtk` in binary; `.vtu`). Coordinates read back to the same bits.
///
/// # Errors
///
/// [`IoError::UnknownExtension`], [`IoError::IndexOutOfRange`], [`IoError::Write`].
pub fn write_cells(path: impl AsRef<Path>, points: &[Point], cells: Cells) -> Result<(), IoError> {
    let path = path.as_ref();
    let no_fields = VtkFields::default();
    match extension(path).as_str() {
        "mesh" => {
            fields::check(path, points, cells, &no_fields)?;
            let group = CellGroup {
                cells,
                labels: &vec![0; cells.count()],
                names: &[],
            };
            atomic_write(path, |writer| medit::write(writer, points, &[group], ""))
        }
        "vtk" => write_vtk(path, points, cells, &no_fields, VtkEncoding::Binary),
        "vtu" => write_vtu(path, points, cells, &no_fields),
        _ => Err(unknown_extension(path, "writing cells", CELL_EXTENSIONS)),
    }
}

/// Writes groups of cells with their labels: as references in `.mesh`, as physical groups with names in Gmsh's `.msh`
/// (format 2.2), where labels that are not positive get the smallest unused ones. `comment` is written to the head of
/// the file.
///
/// # Errors
///
/// [`IoError::UnknownExtension`], [`IoError::IndexOutOfRange`], [`IoError::ValueCount`] unless there is one label
/// for each cell, [`IoError::Write`].
pub fn write_groups(
    path: impl AsRef<Path>,
    points: &[Point],
    groups: &[CellGroup],
    comment: &str,
) -> Result<(), IoError> {
    let path = path.as_ref();
    for group in groups {
        fields::check(path, points, group.cells, &VtkFields::default())?;
        if group.labels.len() != group.cells.count() {
            let (expected, found) = (group.cells.count(), group.labels.len());
            return Err(IoError::value_count(path, "labels", expected, found));
        }
    }
    match extension(path).as_str() {
        "mesh" => atomic_write(path, |writer| medit::write(writer, points, groups, comment)),
        "msh" => atomic_write(path, |writer| gmsh::write(writer, points, groups, comment)),
        _ => Err(unknown_extension(path, "writing cells with labels", ["mesh", "msh"])),
    }
}

/// A format that can be read.
struct Format {
    extension: &'static str,
    name: &'static str,
    parse: fn(&InputFile) -> Result<RawMesh, IoError>,
}

const fn format(
    extension: &'static str,
    name: &'static str,
    parse: fn(&InputFile) -> Result<RawMesh, IoError>,
) -> Format {
    Format { extension, name, parse }
}

static MESH_FORMATS: [Format; 8] = [
    format("obj", "OBJ", obj::parse),
    format("ply", "PLY", ply::parse),
    format("off", "OFF", off::parse),
    format("stl", "STL", stl::parse),
    format("mesh", "Medit mesh", medit::parse),
    format("msh", "Gmsh mesh", gmsh::parse),
    format("vtk", "VTK", |file| vtk::parse_legacy(file, false)),
    format("vtu", "VTU", |file| vtk::parse_vtu(file, false)),
];

static POINT_FORMATS: [Format; 2] = [
    format("csv", "CSV", points::parse_csv),
    format("npy", "NPY", points::parse_npy),
];

/// The formats with fields; they take precedence over those without.
static FIELD_FORMATS: [Format; 4] = [
    format("csv", "CSV", points::parse_csv_with_fields),
    format("vtk", "VTK", |file| vtk::parse_legacy(file, true)),
    format("vtu", "VTU", |file| vtk::parse_vtu(file, true)),
    format("vti", "VTI", vtk::parse_vti),
];

/// The formats of meshes of tetrahedra or hexahedra.
const CELL_MESH_EXTENSIONS: [&str; 4] = ["mesh", "msh", "vtk", "vtu"];

/// The formats that any kind of cell is written to without labels.
const CELL_EXTENSIONS: [&str; 3] = ["mesh", "vtk", "vtu"];

fn read_mesh(path: &Path, purpose: &'static str) -> Result<RawMesh, IoError> {
    read(path, purpose, MESH_FORMATS.iter())
}

fn read(
    path: &Path,
    purpose: &'static str,
    mut formats: impl Iterator<Item = &'static Format> + Clone,
) -> Result<RawMesh, IoError> {
    let extension = extension(path);
    let known = formats.clone().map(|format| format.extension);
    let Some(format) = formats.find(|format| format.extension == extension) else {
        return Err(unknown_extension(path, purpose, known));
    };
    let bytes = read_bytes(path)?;
    let file = InputFile {
        path,
        format: format.name,
        bytes: &bytes,
    };
    // The header of a binary STL file may begin with any bytes.
    if extension != "stl" && (bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff")) {
        return Err(file.unsupported("text in UTF-16", "save it as UTF-8"));
    }
    (format.parse)(&file)
}

/// The content of a file.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, IoError> {
    fs::read(path).map_err(|source| IoError::Read {
        path: path.to_owned(),
        source,
    })
}

/// The extension in lower case; empty when there is none.
fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}

fn unknown_extension(path: &Path, purpose: &'static str, known: impl IntoIterator<Item = &'static str>) -> IoError {
    let known: Vec<String> = known.into_iter().map(|extension| format!(".{extension}")).collect();
    IoError::UnknownExtension {
        path: path.to_owned(),
        purpose,
        known: known.join(", "),
    }
}

/// Files from memory, for the tests of the formats.
#[cfg(test)]
mod testing {
    use super::*;

    pub fn surface(extension: &str, bytes: &[u8]) -> Result<SurfaceMesh, IoError> {
        parse(extension, bytes)?.into_surface(&file(extension))
    }

    pub fn tets(extension: &str, bytes: &[u8]) -> Result<TetMesh, IoError> {
        parse(extension, bytes)?.into_tets(&file(extension))
    }

    pub fn cells(extension: &str, bytes: &[u8]) -> Result<CellMesh, IoError> {
        parse(extension, bytes)?.into_cells(&file(extension))
    }

    pub fn solid(extension: &str, bytes: &[u8]) -> Result<SolidMesh, IoError> {
        parse(extension, bytes)?.into_solid(&file(extension))
    }

    pub fn points(extension: &str, bytes: &[u8]) -> Result<Vec<Point>, IoError> {
        parse(extension, bytes).map(|raw| raw.vertices)
    }

    pub fn place_of<T>(result: Result<T, IoError>) -> Place {
        match result {
            Err(IoError::Malformed { place, .. }) => place,
            Err(error) => panic!("not malformed: {error}"),
            Ok(_) => panic!("not an error"),
        }
    }

    fn parse(extension: &str, bytes: &[u8]) -> Result<RawMesh, IoError> {
        let mut formats = MESH_FORMATS.iter().chain(&POINT_FORMATS);
        let format = formats.find(|format| format.extension == extension).unwrap();
        (format.parse)(&InputFile {
            path: &file(extension),
            format: format.name,
            bytes,
        })
    }

    fn file(extension: &str) -> std::path::PathBuf {
        format!("a.{extension}").into()
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    /// A small valid file of each kind: its extension and content.
    fn small_files() -> Vec<(String, Vec<u8>)> {
        let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Point::from);
        let surface = SurfaceMesh::new(points.to_vec(), vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).unwrap();
        let tets = TetMesh::new(points.to_vec(), vec![[0, 1, 2, 3]]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mut files = Vec::new();
        let mut add_written = |extension: &str, write: &dyn Fn(&Path) -> Result<(), IoError>| {
            let path = folder.path().join(format!("a.{extension}"));
            write(&path).unwrap();
            files.push((extension.to_owned(), fs::read(&path).unwrap()));
        };
        for extension in ["obj", "ply", "off", "mesh", "msh", "vtk", "vtu"] {
            add_written(extension, &|path| write_surface(path, &surface));
        }
        for extension in CELL_EXTENSIONS {
            add_written(extension, &|path| write_tets(path, &tets));
        }
        let (cells, no_fields) = (Cells::Tets(tets.tets()), VtkFields::default());
        add_written("vtk", &|path| {
            write_vtk(path, &points, cells, &no_fields, VtkEncoding::Text)
        });
        add_written("csv", &|path| {
            write_csv(path, &["x", "y", "z"], &[1., 2., 3., 4., 5., 6.])
        });
        add_written("npy", &|path| write_npy(path, 3, &[1., 2., 3., 4., 5., 6.]));

        let mut text = String::from("solid a\n");
        let mut binary = vec![b' '; 80];
        binary.extend((surface.triangles().len() as u32).to_le_bytes());
        for triangle in 0..surface.triangles().len() {
            let corners = surface.corners(triangle);
            let vertices = corners.map(|p| format!("vertex {} {} {}\n", p.x, p.y, p.z)).concat();
            text += &format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n");
            binary.extend([0; 12]);
            binary.extend(
                corners
                    .iter()
                    .flat_map(|p| p.iter().flat_map(|&x| (x as f32).to_le_bytes())),
            );
            binary.extend([0; 2]);
        }
        files.push(("stl".to_owned(), (text + "endsolid a\n").into_bytes()));
        files.push(("stl".to_owned(), binary));
        let strips = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                       element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n\
                       0 0 1\n7 0 2 1 3 -1 0 2\n";
        files.push(("ply".to_owned(), strips.to_vec()));
        files
    }

    /// Reads a file in every way.
    fn read_without_panic(extension: &str, bytes: &[u8]) {
        let read = || {
            let _ = testing::surface(extension, bytes);
            let _ = testing::tets(extension, bytes);
            let _ = testing::solid(extension, bytes);
            let _ = testing::cells(extension, bytes);
        };
        if catch_unwind(AssertUnwindSafe(read)).is_err() {
            panic!(".{extension}: {}", bytes.escape_ascii());
        }
    }

    #[test]
    fn a_file_cut_off_anywhere_is_an_error_or_complete() {
        for (extension, whole) in small_files() {
            let content = testing::solid(&extension, &whole).ok();
            for length in 0..whole.len() {
                let cut = &whole[..length];
                read_without_panic(&extension, cut);
                // OBJ and CSV files do not announce their length.
                if !matches!(extension.as_str(), "obj" | "csv")
                    && let Ok(read) = testing::solid(&extension, cut)
                {
                    assert_eq!(Some(read), content, "{extension} cut to {length}");
                }
            }
        }
    }

    #[test]
    fn flipped_bits_never_panic() {
        let mut random = StdRng::seed_from_u64(20);
        for (extension, whole) in small_files() {
            for _ in 0..1000 {
                let mut corrupted = whole.clone();
                for _ in 0..random.random_range(1..5) {
                    let at = random.random_range(0..corrupted.len());
                    corrupted[at] ^= 1 << random.random_range(0..8);
                }
                read_without_panic(&extension, &corrupted);
            }
        }
    }
}
