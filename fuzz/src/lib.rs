//! What the fuzz targets share: files and surfaces made of the fuzzer's bytes, and every way to read a file.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use solidmap::Point;
use solidmap::check::{check, close_holes, repair};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};

/// Hands `read` the path of a file that holds `bytes`. Each process has one file of its own in the temporary folder,
/// which is best in memory.
pub fn with_file<T>(extension: &str, bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    thread_local! { static FILE: OnceCell<PathBuf> = const { OnceCell::new() }; }
    let name = || std::env::temp_dir().join(format!("solidmap-fuzz-{}.{extension}", std::process::id()));
    FILE.with(|file| {
        let path = file.get_or_init(name).with_extension(extension);
        std::fs::write(&path, bytes).expect("the temporary folder can be written");
        read(&path)
    })
}

/// Reads a mesh file as everything it could be. A message has to name the file.
pub fn read_mesh(extension: &str, bytes: &[u8]) {
    with_file(extension, bytes, |path| {
        named(path, io::read_solid(path));
        named(path, io::read_cells(path));
        named(path, io::read_fields(path));
        named(path, io::read_surface_with_fields(path));
    });
}

/// The value, or `None` for an error, whose message must name the file.
pub fn named<T, E: std::error::Error>(path: &Path, result: Result<T, E>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            let message = error.to_string();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            assert!(message.contains(&*name), "no file is named: {message}");
            assert!(message.len() < 2000, "too long: {message}");
            None
        }
    }
}

/// Runs all of `check`: the check itself, the repair, and the closing of holes of at most `most_edges` edges.
pub fn examine(surface: &SurfaceMesh, most_edges: usize) {
    let report = check(surface, None);
    assert!(!report.to_string().is_empty());
    let (repaired, _) = repair(surface);
    let again = check(&repaired, None);
    assert_eq!(
        report.is_solvable(),
        again.is_solvable(),
        "repair makes no difference to what is solvable"
    );
    assert!(repair(&repaired).1.is_empty(), "what is repaired needs no repair");
    if let Ok((closed, holes)) = close_holes(surface, most_edges) {
        assert_eq!(holes.is_empty(), closed.triangles().len() == surface.triangles().len());
    }
}

/// Extreme coordinates.
const ODD: [f64; 16] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    -0.0,
    1e300,
    -1e300,
    1e-300,
    f64::MAX,
    f64::MIN_POSITIVE,
    5e-324,
    1e155,
    1e-155,
    1e16,
    1.0 + f64::EPSILON,
    1e8,
    -1e-8,
];

/// A surface made of bytes. If the first is below 64, it is the number of vertices less one, and a byte for each
/// coordinate and three for each triangle follow. Else it selects a closed solid, and each pair of bytes that follows
/// gives a coordinate another value.
pub fn surface(bytes: &[u8]) -> Option<SurfaceMesh> {
    let (&kind, rest) = bytes.split_first()?;
    if kind >= 64 {
        return Some(changed(&solid(kind), rest));
    }
    let count = 1 + usize::from(kind);
    let (coordinates, corners) = rest.split_at_checked(3 * count)?;
    let vertices = coordinates.as_chunks::<3>().0.iter();
    let vertices = vertices.map(|p| Point::from(p.map(number))).collect();
    let triangles = corners.as_chunks::<3>().0.iter();
    let triangles = triangles.map(|t| t.map(|v| u32::from(v) % count as u32)).collect();
    SurfaceMesh::new(vertices, triangles).ok()
}

fn number(byte: u8) -> f64 {
    match byte {
        0xf0.. => ODD[usize::from(byte & 0xf)],
        _ => f64::from(byte) / 8.0 - 15.0,
    }
}

fn solid(kind: u8) -> SurfaceMesh {
    match kind % 7 {
        0 => shapes::geodesic_sphere(1.0, 1),
        1 => shapes::cube(2.0, 1),
        2 => shapes::torus(2.0, 0.5, 5, 4),
        3 => shapes::spherical_shell(1.0, 0.5, 0),
        4 => shapes::joined(&shapes::cube(2.0, 1), &shapes::cube(1.0, 1)),
        5 => shapes::double_torus(1),
        _ => shapes::polycube(&[[0, 0, 0], [1, 0, 0], [1, 1, 0]], 1),
    }
}

fn changed(surface: &SurfaceMesh, changes: &[u8]) -> SurfaceMesh {
    let mut vertices = surface.vertices().to_vec();
    let count = 3 * vertices.len();
    for &[place, value] in changes.as_chunks::<2>().0 {
        let place = usize::from(place) % count;
        vertices[place / 3][place % 3] = number(value);
    }
    SurfaceMesh::new(vertices, surface.triangles().to_vec()).expect("the same triangles")
}

/// A safetensors file: bytes that begin with a brace are its header, up to the first line feed, and its data. So the
/// fuzzer need not get the header's length right.
pub fn tensor_file(bytes: &[u8]) -> Vec<u8> {
    if bytes.first() != Some(&b'{') {
        return bytes.to_vec();
    }
    let end = bytes.iter().position(|&b| b == b'\n').unwrap_or(bytes.len());
    let (header, data) = bytes.split_at(end);
    let length = header.len().next_multiple_of(8);
    let mut file = (length as u64).to_le_bytes().to_vec();
    file.extend(header);
    file.resize(8 + length, b' ');
    file.extend(data.get(1..).unwrap_or_default());
    file
}
