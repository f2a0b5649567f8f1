//! Meshes, fields and point lists in files.
//!
//! The extension names the format. Files are read whole and in their own order: no function here renumbers, merges
//! or drops vertices, except that STL, which has none, gets its vertices from equal corner positions. Coordinates
//! that are NaN or infinite are read as they are; to find them is for [`crate::check`].
//!
//! | extension | read | written |
//! |---|---|---|
//! | `.obj` | surface | surface |
//! | `.ply` | surface (text, binary; faces or strips) | surface (binary) |
//! | `.off` | surface | surface |
//! | `.stl` | surface (text, binary) | no: it would lose the order of vertices |
//! | `.mesh` | surface, tetrahedra | triangles, tetrahedra, hexahedra |
//! | `.vtk` | surface, tetrahedra (text, binary) | triangles, tetrahedra, hexahedra; fields |
//! | `.vtu` | surface, tetrahedra (all encodings but LZ4 and LZMA) | triangles, tetrahedra, hexahedra; fields |
//! | `.csv`, `.npy` | points | tables |
//!
//! Polygons become fans of triangles about their first corner, whatever their shape, so that two meshes with the same
//! faces get the same triangles. Files are written whole or not at all ([`atomic_write`]).

mod atomic;
mod contents;
mod error;
mod map_file;
mod medit;
mod obj;
mod off;
mod ply;
mod points;
mod source;
mod stl;
mod vtk;
mod vtu;

use std::{fs, path::Path};

use contents::Contents;
use source::Source;

pub use atomic::atomic_write;
pub use error::{IoError, Place};
pub use map_file::{MapFile, MapFileError, MapMetadata, Provenance, read_map, write_map};
pub use points::{write_csv, write_npy};
pub use vtk::{Cells, Field, VtkEncoding, VtkFields, write_vtk};
pub use vtu::write_vtu;

use crate::{
    Point,
    mesh::{SurfaceMesh, TetMesh},
};

/// What a mesh file may hold.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// A surface that bounds the solid.
    Surface(SurfaceMesh),
    /// A solid filled with tetrahedra.
    Tets(TetMesh),
}

/// Reads a surface (`.obj`, `.ply`, `.off`, `.stl`, `.mesh`, `.vtk`, `.vtu`). Several objects in one file become one
/// mesh; unreferenced vertices stay.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::WrongKind`] when the file holds tetrahedra.
pub fn read_surface(path: impl AsRef<Path>) -> Result<SurfaceMesh, IoError> {
    let path = path.as_ref();
    read_mesh(path, "a surface")?.into_surface(path)
}

/// Reads a tetrahedral mesh (`.mesh`, `.vtk`, `.vtu`), both hands of tetrahedra as they are. Triangles, lines and
/// points beside the tetrahedra are passed over.
///
/// # Errors
///
/// Any [`IoError`] but those of writing; [`IoError::WrongKind`] when the file holds a surface.
pub fn read_tets(path: impl AsRef<Path>) -> Result<TetMesh, IoError> {
    let path = path.as_ref();
    read_mesh(path, "a tetrahedral mesh")?.into_tets(path)
}

/// Reads a surface or a tetrahedral mesh, as the content has it: a file with tetrahedra is a tetrahedral mesh even
/// when it lists triangles too.
///
/// # Errors
///
/// Any [`IoError`] but those of writing.
pub fn read_solid(path: impl AsRef<Path>) -> Result<Solid, IoError> {
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
    read(path.as_ref(), "points", formats).map(|contents| contents.vertices)
}

/// Writes a surface (`.obj`, `.ply`, `.off`, `.mesh`, `.vtk`, `.vtu`). Coordinates read back to the same bits.
///
/// # Errors
///
/// [`IoError::UnknownExtension`], [`IoError::Write`].
pub fn write_surface(path: impl AsRef<Path>, mesh: &SurfaceMesh) -> Result<(), IoError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => atomic_write(path, |writer| obj::write(writer, mesh)),
        "ply" => atomic_write(path, |writer| ply::write(writer, mesh)),
        "off" => atomic_write(path, |writer| off::write(writer, mesh)),
        extension if CELL_EXTENSIONS.contains(&extension) => {
            write_cells(path, mesh.vertices(), Cells::Triangles(mesh.triangles()))
        }
        _ => {
            let known = ["obj", "ply", "off"].into_iter().chain(CELL_EXTENSIONS);
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
            vtk::check(path, points, cells, &no_fields)?;
            atomic_write(path, |writer| medit::write(writer, points, cells))
        }
        "vtk" => write_vtk(path, points, cells, &no_fields, VtkEncoding::Binary),
        "vtu" => write_vtu(path, points, cells, &no_fields),
        _ => Err(unknown_extension(path, "writing cells", CELL_EXTENSIONS)),
    }
}

/// A format that can be read.
struct Format {
    extension: &'static str,
    name: &'static str,
    parse: fn(&Source) -> Result<Contents, IoError>,
}

const fn format(
    extension: &'static str,
    name: &'static str,
    parse: fn(&Source) -> Result<Contents, IoError>,
) -> Format {
    Format { extension, name, parse }
}

static MESH_FORMATS: [Format; 7] = [
    format("obj", "OBJ", obj::parse),
    format("ply", "PLY", ply::parse),
    format("off", "OFF", off::parse),
    format("stl", "STL", stl::parse),
    format("mesh", "Medit mesh", medit::parse),
    format("vtk", "VTK", vtk::parse),
    format("vtu", "VTU", vtu::parse),
];

static POINT_FORMATS: [Format; 2] = [
    format("csv", "CSV", points::parse_csv),
    format("npy", "NPY", points::parse_npy),
];

/// The formats that hold any kind of cell.
const CELL_EXTENSIONS: [&str; 3] = ["mesh", "vtk", "vtu"];

fn read_mesh(path: &Path, purpose: &'static str) -> Result<Contents, IoError> {
    read(path, purpose, MESH_FORMATS.iter())
}

fn read(
    path: &Path,
    purpose: &'static str,
    mut formats: impl Iterator<Item = &'static Format> + Clone,
) -> Result<Contents, IoError> {
    let extension = extension(path);
    let known = formats.clone().map(|format| format.extension);
    let Some(format) = formats.find(|format| format.extension == extension) else {
        return Err(unknown_extension(path, purpose, known));
    };
    let bytes = fs::read(path).map_err(|source| IoError::Read {
        path: path.to_owned(),
        source,
    })?;
    (format.parse)(&Source {
        path,
        format: format.name,
        bytes: &bytes,
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
