//! Gmsh's mesh format 2.2 (`.msh`), in text: the version that all readers know.

use std::io::{self, Write};
use std::path::Path;

use super::{Cells, IoError, atomic_write, vtk};
use crate::Point;

/// Physical groups: the boundary is 1, the solid 2.
const GROUPS: [(u8, u8, &str); 2] = [(2, 1, "boundary"), (3, 2, "solid")];

/// Writes a solid's cells, and the triangles of its boundary, as two physical groups, `solid` and `boundary`.
/// `comment` may say where they come from; it is one line.
///
/// # Errors
///
/// [`IoError::IndexOutOfRange`], [`IoError::Write`].
pub fn write_msh(
    path: impl AsRef<Path>,
    points: &[Point],
    cells: Cells,
    boundary: &[[u32; 3]],
    comment: &str,
) -> Result<(), IoError> {
    let no_fields = vtk::VtkFields::default();
    vtk::check(path.as_ref(), points, cells, &no_fields)?;
    vtk::check(path.as_ref(), points, Cells::Triangles(boundary), &no_fields)?;
    atomic_write(path, |writer| write(writer, points, cells, boundary, comment))
}

fn write(
    writer: &mut dyn Write,
    points: &[Point],
    cells: Cells,
    boundary: &[[u32; 3]],
    comment: &str,
) -> io::Result<()> {
    let comment: String = comment.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    writeln!(writer, "$MeshFormat\n2.2 0 8\n$EndMeshFormat")?;
    writeln!(writer, "$Comments\n{}\n$EndComments", comment.replace('$', " "))?;
    writeln!(writer, "$PhysicalNames\n{}", GROUPS.len())?;
    for (dimension, tag, name) in GROUPS {
        writeln!(writer, "{dimension} {tag} \"{name}\"")?;
    }
    writeln!(writer, "$EndPhysicalNames\n$Nodes\n{}", points.len())?;
    for (i, p) in points.iter().enumerate() {
        writeln!(writer, "{} {:?} {:?} {:?}", i + 1, p.x, p.y, p.z)?;
    }
    writeln!(writer, "$EndNodes\n$Elements\n{}", boundary.len() + cells.count())?;
    let mut number = 0;
    for (cells, tag) in [(Cells::Triangles(boundary), 1), (cells, 2)] {
        // Gmsh orders the corners of triangles, tetrahedra and hexahedra as VTK does.
        let kind = match cells {
            Cells::Triangles(_) => 2,
            Cells::Tets(_) => 4,
            Cells::Hexes(_) => 5,
        };
        for cell in cells.iter() {
            number += 1;
            write!(writer, "{number} {kind} 2 {tag} {tag}")?;
            for &v in cell {
                write!(writer, " {}", u64::from(v) + 1)?;
            }
            writeln!(writer)?;
        }
    }
    writeln!(writer, "$EndElements")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_cells_and_boundary_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.msh");
        let points: Vec<Point> = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.1, 1e-3]]
            .map(Point::from)
            .into();
        let boundary = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        write_msh(
            &path,
            &points,
            Cells::Tets(&[[0, 1, 2, 3]]),
            &boundary,
            "from\na $Nodes",
        )
        .unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[..6],
            [
                "$MeshFormat",
                "2.2 0 8",
                "$EndMeshFormat",
                "$Comments",
                "from a  Nodes",
                "$EndComments"
            ]
        );
        assert!(lines.contains(&"3 2 \"solid\"") && lines.contains(&"4 0.0 0.1 0.001"));
        assert!(lines.contains(&"1 2 2 1 1 1 3 2") && lines.contains(&"5 4 2 2 2 1 2 3 4"));
        let wrong = write_msh(&path, &points, Cells::Tets(&[[0, 1, 2, 4]]), &[], "");
        assert!(matches!(wrong, Err(IoError::IndexOutOfRange { vertex: 4, .. })));
        let wrong = write_msh(&path, &points, Cells::Tets(&[]), &[[0, 1, 9]], "");
        assert!(matches!(wrong, Err(IoError::IndexOutOfRange { vertex: 9, .. })));
    }
}
