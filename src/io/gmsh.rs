//! Gmsh's mesh format 2.2 (`.msh`), in text: the version that all readers support.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use super::{CellGroup, Cells};
use crate::Point;

/// Writes groups of cells; their labels become physical groups. Labels without a name are named by their number.
pub(super) fn write(writer: &mut dyn Write, points: &[Point], groups: &[CellGroup], comment: &str) -> io::Result<()> {
    let comment = comment.replace(|c: char| c.is_control() || c == '$', " ");
    writeln!(writer, "$MeshFormat\n2.2 0 8\n$EndMeshFormat")?;
    writeln!(writer, "$Comments\n{comment}\n$EndComments")?;
    let physical: Vec<(u8, i32, String)> = groups.iter().flat_map(names).collect();
    writeln!(writer, "$PhysicalNames\n{}", physical.len())?;
    for (dimension, tag, name) in physical {
        writeln!(writer, "{dimension} {tag} \"{}\"", name)?;
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
        let tags = tags(group);
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

/// Gmsh's element type and dimension. The order of corners is that of VTK.
fn element(cells: Cells) -> [u8; 2] {
    match cells {
        Cells::Triangles(_) => [2, 2],
        Cells::Quads(_) => [3, 2],
        Cells::Tets(_) => [4, 3],
        Cells::Hexes(_) => [5, 3],
    }
}

/// The labels that occur, with their physical tags. Tags must be positive: labels that are not get the smallest unused
/// numbers.
fn tags(group: &CellGroup) -> BTreeMap<i32, i32> {
    let labels: BTreeSet<i32> = group.labels.iter().copied().collect();
    let mut free = (1..).filter(|tag| !labels.contains(tag));
    let mut tag = |label: &i32| if *label > 0 { Some(*label) } else { free.next() };
    labels.iter().filter_map(|label| Some((*label, tag(label)?))).collect()
}

/// Dimension, tag and name of the groups.
fn names(group: &CellGroup) -> Vec<(u8, i32, String)> {
    let [_, dimension] = element(group.cells);
    let names: BTreeMap<i32, &str> = group
        .names
        .iter()
        .map(|(label, name)| (*label, name.as_str()))
        .collect();
    let named = |(label, tag)| {
        let name = names
            .get(&label)
            .map_or_else(|| format!("label {label}"), |name| (*name).to_owned());
        (dimension, tag, name.replace(|c: char| c.is_control() || c == '"', " "))
    };
    tags(group).into_iter().map(named).collect()
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
                "2 1 \"label 0\"",
                "2 2 \"side\"",
                "3 4 \"label 4\"",
            ]
        );
        assert!(lines.contains(&"4 0.0 0.1 0.001"));
        assert!(lines.contains(&"1 2 2 1 1 1 3 2") && lines.contains(&"5 4 2 4 4 1 2 3 4"));
    }
}
