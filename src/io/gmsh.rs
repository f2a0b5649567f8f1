//! Gmsh's mesh format 2.2 (`.msh`), in text: the version that all readers know.

use std::collections::{BTreeSet, HashMap};
use std::io::{self, Write};

use super::{CellGroup, Cells};
use crate::Point;

/// Writes groups of cells; their labels become physical groups. Labels that have no name in a group are named by their
/// number.
pub(super) fn write(writer: &mut dyn Write, points: &[Point], groups: &[CellGroup], comment: &str) -> io::Result<()> {
    let comment = comment.replace(|c: char| c.is_control() || c == '$', " ");
    writeln!(writer, "$MeshFormat\n2.2 0 8\n$EndMeshFormat")?;
    writeln!(writer, "$Comments\n{comment}\n$EndComments")?;
    let physical: Vec<(u8, i32, String)> = groups.iter().flat_map(names).collect();
    writeln!(writer, "$PhysicalNames\n{}", physical.len())?;
    for (dimension, tag, name) in physical {
        writeln!(writer, "{dimension} {tag} \"{}\"", name.replace('"', "'"))?;
    }
    writeln!(writer, "$EndPhysicalNames\n$Nodes\n{}", points.len())?;
    for (i, p) in points.iter().enumerate() {
        writeln!(writer, "{} {:?} {:?} {:?}", i + 1, p.x, p.y, p.z)?;
    }
    let count: usize = groups.iter().map(|group| group.cells.count()).sum();
    writeln!(writer, "$EndNodes\n$Elements\n{count}")?;
    let mut number = 0;
    for group in groups {
        let kind = element(group.cells)[0];
        let tags: HashMap<i32, i32> = labels(group)
            .into_iter()
            .map(|label| (label, tag(label, group)))
            .collect();
        for (cell, label) in group.cells.iter().zip(group.labels) {
            number += 1;
            let tag = tags[label];
            write!(writer, "{number} {kind} 2 {tag} {tag}")?;
            for &v in cell {
                write!(writer, " {}", u64::from(v) + 1)?;
            }
            writeln!(writer)?;
        }
    }
    writeln!(writer, "$EndElements")
}

/// Gmsh's number for a kind of cell, and its dimension. Corners are in the order of VTK.
fn element(cells: Cells) -> [u8; 2] {
    match cells {
        Cells::Triangles(_) => [2, 2],
        Cells::Quads(_) => [3, 2],
        Cells::Tets(_) => [4, 3],
        Cells::Hexes(_) => [5, 3],
    }
}

/// Physical groups have positive numbers: other labels come after the largest.
fn tag(label: i32, group: &CellGroup) -> i32 {
    let largest = group.labels.iter().copied().max().unwrap_or(0).max(0);
    if label > 0 {
        label
    } else {
        largest.saturating_add(1).saturating_sub(label)
    }
}

/// The labels that occur, with dimension, tag and name.
fn names(group: &CellGroup) -> Vec<(u8, i32, String)> {
    let [_, dimension] = element(group.cells);
    let named = |label: i32| {
        let name = group.names.iter().find(|(of, _)| *of == label);
        name.map_or_else(|| format!("label {label}"), |(_, name)| name.clone())
    };
    labels(group)
        .into_iter()
        .map(|label| (dimension, tag(label, group), named(label)))
        .collect()
}

fn labels(group: &CellGroup) -> BTreeSet<i32> {
    group.labels.iter().copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_cells_and_names_are_written() {
        let points: Vec<Point> = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.1, 1e-3]]
            .map(Point::from)
            .into();
        let boundary = CellGroup {
            cells: Cells::Triangles(&[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
            labels: &[0, 2, 2, 2],
            names: &[(2, "side".into())],
        };
        let solid = CellGroup {
            cells: Cells::Tets(&[[0, 1, 2, 3]]),
            labels: &[4],
            names: &[],
        };
        let mut bytes = Vec::new();
        write(&mut bytes, &points, &[boundary, solid], "from\na $Nodes").unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[..11],
            [
                "$MeshFormat",
                "2.2 0 8",
                "$EndMeshFormat",
                "$Comments",
                "from a  Nodes",
                "$EndComments",
                "$PhysicalNames",
                "3",
                "2 3 \"label 0\"",
                "2 2 \"side\"",
                "3 4 \"label 4\"",
            ]
        );
        assert!(lines.contains(&"4 0.0 0.1 0.001"));
        assert!(lines.contains(&"1 2 2 3 3 1 3 2") && lines.contains(&"5 4 2 4 4 1 2 3 4"));
    }
}
