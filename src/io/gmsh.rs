//! Gmsh's mesh formats (`.msh`), in text: 2.2 and 4.1 are read, 2.2 is written, which all readers support.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::{self, Write};

use super::{
    CellGroup, Cells, IoError,
    input::{InputFile, TEXT_NUMBER, Tokens, excerpt},
    raw_mesh::RawMesh,
};
use crate::Point;

/// Nodes, triangles, quadrilaterals, tetrahedra and hexahedra in file order. In format 2.2 labels are the physical groups
/// of cells; in 4.1 all are 0. Points and lines are skipped, as are all other sections.
pub(super) fn parse(file: &InputFile) -> Result<RawMesh, IoError> {
    let mut tokens = file.tokens();
    if tokens.next() != Some(b"$MeshFormat") {
        return Err(tokens.malformed("the first word is not $MeshFormat"));
    }
    let version = tokens.word("the version")?;
    let is_version_4 = match version.as_str() {
        "4.1" => true,
        _ if version.starts_with('2') => false,
        _ => {
            let found = format!("a mesh in Gmsh's format {}", excerpt(version.as_bytes()));
            return Err(file.unsupported(found, "save it in format 2.2 or 4.1"));
        }
    };
    if tokens.integer("the kind of file")? != 0 {
        return Err(file.unsupported("a binary mesh", "save it as text (Gmsh: Mesh.Binary = 0)"));
    }
    skip_to_end(file, &mut tokens, "MeshFormat")?;
    let mut reader = Reader {
        file,
        tokens,
        raw: RawMesh {
            base: 1,
            ..RawMesh::default()
        },
        numbers: NodeNumbers::default(),
    };
    while let Some(token) = reader.tokens.next() {
        let Some(section) = token.strip_prefix(b"$") else {
            return Err(reader.tokens.unexpected(token, "the beginning of a section"));
        };
        match (section, is_version_4) {
            (b"Nodes", false) => reader.nodes_2()?,
            (b"Nodes", true) => reader.nodes_4()?,
            (b"Elements", false) => reader.elements_2()?,
            (b"Elements", true) => reader.elements_4()?,
            _ => {}
        }
        skip_to_end(file, &mut reader.tokens, &String::from_utf8_lossy(section))?;
    }
    Ok(reader.raw)
}

fn skip_to_end(file: &InputFile, tokens: &mut Tokens, section: &str) -> Result<(), IoError> {
    let end = format!("$End{section}");
    while let Some(token) = tokens.next() {
        if token == end.as_bytes() {
            return Ok(());
        }
    }
    Err(file.truncated(format!("the section ${}", excerpt(section.as_bytes()))))
}

struct Reader<'a> {
    file: &'a InputFile<'a>,
    tokens: Tokens<'a>,
    raw: RawMesh,
    numbers: NodeNumbers,
}

/// The index of every node by its number in the file. Most files count from 1.
#[derive(Default)]
struct NodeNumbers {
    count: i64,
    /// Empty as long as the nodes are counted from 1 without gaps.
    others: HashMap<i64, i64>,
}

impl NodeNumbers {
    fn add(&mut self, number: i64) {
        if self.others.is_empty() && number != self.count + 1 {
            self.others = (0..self.count).map(|index| (index + 1, index)).collect();
            self.others.insert(number, self.count);
        } else if !self.others.is_empty() {
            self.others.insert(number, self.count);
        }
        self.count += 1;
    }

    fn index(&self, number: i64) -> Option<i64> {
        match self.others.is_empty() {
            true => Some(number.saturating_sub(1)),
            false => self.others.get(&number).copied(),
        }
    }
}

impl Reader<'_> {
    fn node(&mut self, number: i64) -> Result<(), IoError> {
        self.numbers.add(number);
        self.raw.vertices.push(self.tokens.point()?);
        Ok(())
    }

    fn nodes_2(&mut self) -> Result<(), IoError> {
        for _ in 0..self.tokens.count("nodes", 4 * TEXT_NUMBER)? {
            let number = self.tokens.integer("the number of a node")?;
            self.node(number)?;
        }
        Ok(())
    }

    fn nodes_4(&mut self) -> Result<(), IoError> {
        let blocks = self.tokens.count("blocks of nodes", 4 * TEXT_NUMBER)?;
        for _ in 0..3 {
            self.tokens.integer("the range of nodes")?;
        }
        for _ in 0..blocks {
            let dimension = self.tokens.integer("the dimension of an entity")?;
            self.tokens.integer("the number of an entity")?;
            let is_parametric = self.tokens.integer("whether nodes have parameters")? != 0;
            let count = self.tokens.count("nodes", 4 * TEXT_NUMBER)?;
            let mut numbers = Vec::with_capacity(count);
            for _ in 0..count {
                numbers.push(self.tokens.integer("the number of a node")?);
            }
            for number in numbers {
                self.node(number)?;
                for _ in 0..if is_parametric { dimension.clamp(0, 3) } else { 0 } {
                    self.tokens.float("a parameter of a node")?;
                }
            }
        }
        Ok(())
    }

    fn elements_2(&mut self) -> Result<(), IoError> {
        for _ in 0..self.tokens.count("elements", 3 * TEXT_NUMBER)? {
            self.tokens.integer("the number of an element")?;
            let kind = self.tokens.integer("the type of an element")?;
            let tags = self.tokens.count("tags of an element", TEXT_NUMBER)?;
            let mut label = 0;
            for k in 0..tags {
                let tag = self.tokens.integer("a tag of an element")?;
                if k == 0 {
                    label = tag;
                }
            }
            self.element(kind, label)?;
        }
        Ok(())
    }

    fn elements_4(&mut self) -> Result<(), IoError> {
        let blocks = self.tokens.count("blocks of elements", 4 * TEXT_NUMBER)?;
        for _ in 0..3 {
            self.tokens.integer("the range of elements")?;
        }
        for _ in 0..blocks {
            self.tokens.integer("the dimension of an entity")?;
            self.tokens.integer("the number of an entity")?;
            let kind = self.tokens.integer("the type of elements")?;
            for _ in 0..self.tokens.count("elements", 2 * TEXT_NUMBER)? {
                self.tokens.integer("the number of an element")?;
                self.element(kind, 0)?;
            }
        }
        Ok(())
    }

    /// Reads the nodes of an element and adds it.
    fn element(&mut self, kind: i64, label: i64) -> Result<(), IoError> {
        let Some((count, other)) = corners(kind) else {
            let remedy = "save the mesh with linear elements";
            return Err(self.file.unsupported(format!("elements of Gmsh's type {kind}"), remedy));
        };
        let mut nodes = [0; MOST_NODES];
        for node in &mut nodes[..count] {
            let number = self.tokens.integer("the nodes of an element")?;
            *node = match self.numbers.index(number) {
                Some(index) => index,
                None => {
                    return Err(self
                        .tokens
                        .malformed(format!("an element names node {number}, which is not there")));
                }
            };
        }
        let [a, b, c, d, e, f, g, h, ..] = nodes;
        match kind {
            2 => self.raw.polygons.push([a, b, c]),
            3 => self.raw.polygons.push([a, b, c, d]),
            4 => {
                self.raw.tets.push([a, b, c, d]);
                self.raw.labels[0].push(label);
            }
            5 => {
                self.raw.hexes.push([a, b, c, d, e, f, g, h]);
                self.raw.labels[1].push(label);
            }
            _ if !other.is_empty() => self.raw.add_other_cells(other, 1),
            _ => {}
        }
        Ok(())
    }
}

/// Most nodes of an element that is known.
const MOST_NODES: usize = 27;

/// Number of nodes of an element, and what it is called if it is an unsupported cell. Curved faces and lines are not
/// cells: they are skipped as points are.
fn corners(kind: i64) -> Option<(usize, &'static str)> {
    Some(match kind {
        1 => (2, ""),
        2 => (3, ""),
        3 | 4 => (4, ""),
        5 => (8, ""),
        6 => (6, "prisms"),
        7 => (5, "pyramids"),
        8 => (3, ""),
        9 => (6, ""),
        10 => (9, ""),
        11 => (10, "quadratic tetrahedra"),
        12 => (27, "quadratic hexahedra"),
        13 => (18, "quadratic prisms"),
        14 => (14, "quadratic pyramids"),
        15 => (1, ""),
        16 => (8, ""),
        17 => (20, "quadratic hexahedra"),
        18 => (15, "quadratic prisms"),
        19 => (13, "quadratic pyramids"),
        _ => return None,
    })
}

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
    use crate::io::{
        Place,
        testing::{cells, place_of, solid, surface, tets},
    };
    use crate::mesh::CellList;

    /// A cube and its bottom; nodes are numbered from 11, in reverse.
    const OLD: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Comments\n$ 5 any thing\n$EndComments\n$Nodes\n8\n\
                       18 0 0 0\n17 1 0 0\n16 1 1 0\n15 0 1 0\n14 0 0 1\n13 1 0 1\n12 1 1 1\n11 0 1 1\n$EndNodes\n\
                       $Elements\n3\n1 15 2 1 1 18\n2 3 2 7 1 18 15 16 17\n3 5 2 9 1 18 17 16 15 14 13 12 11\n\
                       $EndElements\n";

    /// Two tetrahedra, one in each entity, with parameters of the nodes on a surface.
    const NEW: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 1 1\n1 2 3\n$EndEntities\n$Nodes\n\
                       2 5 1 5\n2 1 1 3\n1\n2\n3\n0 0 0 0.5 0.5\n1 0 0 0.5 0.5\n0 1 0 0.5 0.5\n3 1 0 2\n4\n5\n0 0 1\n\
                       0 0 -1\n$EndNodes\n$Elements\n2 3 1 3\n2 1 2 1\n1 1 2 3\n3 1 4 2\n2 1 2 3 4\n3 2 1 3 5\n\
                       $EndElements\n";

    #[test]
    fn both_formats_are_read() {
        let cube = cells("msh", OLD.as_bytes()).unwrap();
        assert_eq!(*cube.cells(), CellList::Hexes(vec![[0, 1, 2, 3, 4, 5, 6, 7]]));
        assert_eq!((cube.regions(), cube.volume()), (&[9][..], 1.0));
        assert_eq!(
            tets("msh", NEW.as_bytes()).unwrap().tets(),
            [[0, 1, 2, 3], [1, 0, 2, 4]]
        );
        let faces = OLD
            .replace("3 5 2 9 1 18 17 16 15 14 13 12 11\n", "")
            .replace("$Elements\n3", "$Elements\n2");
        assert_eq!(
            surface("msh", faces.as_bytes()).unwrap().triangles(),
            [[0, 3, 2], [0, 2, 1]]
        );
    }

    #[test]
    fn faults_are_named() {
        let read = |text: &str, from: &str, to: &str| {
            assert!(text.contains(from));
            solid("msh", text.replace(from, to).as_bytes()).map(drop)
        };
        for (text, from, to, said) in [
            (OLD, "2.2 0", "2.2 1", "binary mesh"),
            (NEW, "4.1 0", "4.0 0", "format 4.0"),
            (OLD, "3 5 2", "3 6 2", "prisms"),
            (OLD, "3 5 2", "3 99 2", "type 99"),
            (NEW, "3 2 1 3 5", "3 2 1 3 6", "refers to vertex 6"),
        ] {
            let message = read(text, from, to).unwrap_err().to_string();
            assert!(message.contains(said), "{message}");
        }
        assert_eq!(place_of(read(OLD, "9 1 18 17", "9 1 18 19")), Place::Line(22));
        assert_eq!(place_of(read(OLD, "16 1 1 0", "16 1 ? 0")), Place::Line(11));
        assert!(matches!(
            read(OLD, "$Nodes\n8", "$Nodes\n80000000000"),
            Err(IoError::CountExceedsFile { .. })
        ));
        for end in (0..OLD.len() - 2).chain([0]) {
            assert!(solid("msh", &OLD.as_bytes()[..end]).is_err(), "{end}");
        }
        (0..NEW.len() - 2).for_each(|end| assert!(solid("msh", &NEW.as_bytes()[..end]).is_err(), "{end}"));
    }

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
        assert_eq!(
            *cells("msh", text.as_bytes()).unwrap().cells(),
            CellList::Tets(vec![[0, 1, 2, 3]])
        );
        assert_eq!(cells("msh", text.as_bytes()).unwrap().regions(), [4]);
        assert!(lines.contains(&"4 0.0 0.1 0.001"));
        assert!(lines.contains(&"1 2 2 1 1 1 3 2") && lines.contains(&"5 4 2 4 4 1 2 3 4"));
    }
}
