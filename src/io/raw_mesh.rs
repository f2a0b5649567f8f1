//! The unchecked content of any mesh file, and its conversion to a surface, a volume mesh or points with fields.

use std::path::Path;

use super::{Field, FieldFile, IoError, SolidMesh, input::excerpt};
use crate::{
    Point,
    mesh::{CellList, CellMesh, MeshError, SurfaceMesh, TetMesh},
};

/// The vertices, faces and cells of a file in file order; indices are 0-based and not yet checked.
#[derive(Debug, Default)]
pub(super) struct RawMesh {
    pub vertices: Vec<Point>,
    pub polygons: CornerLists,
    pub tets: Vec<[i64; 4]>,
    pub hexes: Vec<[i64; 8]>,
    /// Labels of the tetrahedra and of the hexahedra, empty in formats without them.
    pub labels: [Vec<i64>; 2],
    /// Unsupported three-dimensional cells: the first kind found, in the plural, and their number.
    pub other_cells: Option<(String, usize)>,
    /// The file's index of the first vertex, 0 or 1, for messages.
    pub base: i64,
    /// The index of each tetrahedron or hexahedron among all cells of the file, in formats with cell fields; in order
    /// where all are of one kind.
    pub cell_of_volume: Vec<usize>,
    /// Number of cells of any kind so far.
    pub cells: usize,
    /// Fields over the vertices and over all cells of the file, if they were asked for.
    pub point_fields: Vec<Field>,
    pub cell_fields: Vec<Field>,
}

/// The corners of faces or cells, any number for each.
#[derive(Debug, Default)]
pub(super) struct CornerLists {
    pub corners: Vec<i64>,
    /// The end of each list in `corners`.
    pub ends: Vec<usize>,
}

/// More components per value are taken for an error in the file's header.
const MAX_COMPONENTS: usize = 4096;

impl CornerLists {
    pub fn push(&mut self, corners: impl IntoIterator<Item = i64>) {
        self.corners.extend(corners);
        self.ends.push(self.corners.len());
    }

    /// The triangles of a strip, whose orientation alternates. A negative index starts a new strip. Triangles with a
    /// repeated vertex only connect strips and are left out.
    pub fn push_strip(&mut self, corners: &[i64]) {
        for strip in corners.split(|&v| v < 0) {
            for (k, triangle) in strip.windows(3).enumerate() {
                let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
                if a != b && b != c && c != a {
                    self.push(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
                }
            }
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = &[i64]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.corners[start..end])
    }
}

impl RawMesh {
    pub fn add_other_cells(&mut self, kind: &str, count: usize) {
        let (name, total) = self.other_cells.get_or_insert_with(|| (kind.to_owned(), 0));
        if name == kind {
            *total += count;
        }
    }

    pub fn into_surface(self, path: &Path) -> Result<SurfaceMesh, IoError> {
        self.refuse_other_cells(path)?;
        if self.has_cells() {
            return Err(IoError::WrongKind {
                path: path.to_owned(),
                found: self.cell_counts(),
                wanted: "a surface is needed here; extract the boundary of the cells",
            });
        }
        let triangles = self.triangles(path)?;
        if triangles.is_empty() {
            return Err(self.no_geometry(path));
        }
        SurfaceMesh::new(self.vertices, triangles).map_err(|error| with_path(error, path))
    }

    pub fn into_tets(self, path: &Path) -> Result<TetMesh, IoError> {
        self.refuse_other_cells(path)?;
        if !self.hexes.is_empty() {
            return Err(IoError::WrongKind {
                path: path.to_owned(),
                found: self.cell_counts(),
                wanted: "a mesh of tetrahedra alone is needed here; tetrahedralise its boundary, or cut its hexahedra \
                         into tetrahedra",
            });
        }
        if self.tets.is_empty() && !self.polygons.ends.is_empty() {
            return Err(IoError::WrongKind {
                path: path.to_owned(),
                found: format!("{} faces and no tetrahedra", self.polygons.ends.len()),
                wanted: "a tetrahedral mesh is needed here; tetrahedralise the surface",
            });
        }
        if self.tets.is_empty() {
            return Err(self.no_geometry(path));
        }
        let tets = self.cells_in_range(path, "tetrahedron", &self.tets)?;
        TetMesh::new(self.vertices, tets).map_err(|error| with_path(error, path))
    }

    pub fn into_cells(self, path: &Path) -> Result<CellMesh, IoError> {
        if self.other_cells.is_none() && !self.has_cells() && !self.polygons.ends.is_empty() {
            return Err(IoError::WrongKind {
                path: path.to_owned(),
                found: format!("{} faces and no cells", self.polygons.ends.len()),
                wanted: "a mesh of tetrahedra or hexahedra is needed here",
            });
        }
        let cells = self.cells_of_one_kind(path)?;
        let regions = self.regions(&cells).ok_or_else(|| {
            let found = "a cell whose reference is not a 32-bit integer";
            IoError::unsupported(path, found, "number the regions by smaller integers")
        })?;
        CellMesh::new(self.vertices, cells, regions).map_err(|error| with_path(error, path))
    }

    pub fn into_solid(self, path: &Path) -> Result<SolidMesh, IoError> {
        if !self.has_cells() {
            return self.into_surface(path).map(SolidMesh::Surface);
        }
        let cells = self.cells_of_one_kind(path)?;
        let regions = self.regions(&cells).unwrap_or_else(|| vec![0; cells.len()]);
        let mesh = CellMesh::new(self.vertices, cells, regions).map_err(|error| with_path(error, path));
        mesh.map(SolidMesh::Cells)
    }

    fn has_cells(&self) -> bool {
        !(self.tets.is_empty() && self.hexes.is_empty())
    }

    /// How many tetrahedra and hexahedra there are, in words.
    fn cell_counts(&self) -> String {
        match (self.tets.len(), self.hexes.len()) {
            (tets, 0) => format!("{tets} tetrahedra"),
            (0, hexes) => format!("{hexes} hexahedra"),
            (tets, hexes) => format!("{tets} tetrahedra and {hexes} hexahedra"),
        }
    }

    /// The cells, which must be there and all tetrahedra or all hexahedra.
    fn cells_of_one_kind(&self, path: &Path) -> Result<CellList, IoError> {
        self.refuse_other_cells(path)?;
        match (self.tets.len(), self.hexes.len()) {
            (0, 0) => Err(self.no_geometry(path)),
            (_, 0) => Ok(CellList::Tets(self.cells_in_range(path, "tetrahedron", &self.tets)?)),
            (0, _) => Ok(CellList::Hexes(self.cells_in_range(path, "hexahedron", &self.hexes)?)),
            _ => {
                let remedy = "give a mesh of tetrahedra or of hexahedra alone, or the boundary as a surface";
                Err(IoError::unsupported(path, self.cell_counts(), remedy))
            }
        }
    }

    /// The regions of the cells, 0 in formats without labels; `None` when a label is not a 32-bit integer.
    fn regions(&self, cells: &CellList) -> Option<Vec<i32>> {
        let labels = &self.labels[usize::from(matches!(cells, CellList::Hexes(_)))];
        if labels.len() != cells.len() {
            return Some(vec![0; cells.len()]);
        }
        labels.iter().map(|&label| i32::try_from(label).ok()).collect()
    }

    /// Points with their fields, and the cells or else the triangles. Cell fields are kept only for cells.
    pub fn into_fields(mut self, path: &Path) -> Result<FieldFile, IoError> {
        let point = std::mem::take(&mut self.point_fields);
        let cell = std::mem::take(&mut self.cell_fields);
        let cell_of_volume = std::mem::take(&mut self.cell_of_volume);
        let (vertices, cells) = (self.vertices.len(), self.cells);
        if let Some(field) = point.iter().chain(&cell).find(|f| f.components > MAX_COMPONENTS) {
            let (name, components) = (excerpt(field.name.as_bytes()), field.components);
            let found = format!("the field `{name}` of {components} components");
            let remedy = "leave it out, or cut it into fields of at most 4096 components";
            return Err(IoError::unsupported(path, found, remedy));
        }
        let over_vertices = point.iter().map(|f| (f, vertices));
        for (field, count) in over_vertices.chain(cell.iter().map(|f| (f, cells))) {
            let (expected, found) = (count * field.components, field.values.len());
            if found != expected {
                let name = excerpt(field.name.as_bytes());
                return Err(IoError::value_count(path, name, expected, found));
            }
        }
        self.refuse_other_cells(path)?;
        if !self.has_cells() {
            let triangles = self.triangles(path)?;
            return Ok(FieldFile {
                points: self.vertices,
                triangles,
                point,
                ..FieldFile::default()
            });
        }
        let of_volumes = |field: Field| {
            let value = |&c: &usize| &field.values[c * field.components..][..field.components];
            let values = cell_of_volume.iter().flat_map(value).copied().collect();
            Field { values, ..field }
        };
        let cells = self.cells_of_one_kind(path)?;
        let regions = vec![0; cells.len()];
        let mesh = CellMesh::new(self.vertices, cells, regions).map_err(|error| with_path(error, path))?;
        let (points, cells, _) = mesh.into_parts();
        Ok(FieldFile {
            points,
            cells,
            point,
            cell: cell.into_iter().map(of_volumes).collect(),
            ..FieldFile::default()
        })
    }

    /// Cuts polygons into triangles: every second corner is cut off, and so on with the polygon that is left, so that few
    /// triangles meet at a corner. In a fan about one corner all of them do: for TetGen, a face of 1000 corners then takes
    /// 14 times as long.
    ///
    /// The cut depends only on the order of the corners, not on positions, so that two meshes with the same faces, as
    /// in a boundary map, get the same triangles. A strongly concave polygon therefore gets overlapping triangles.
    fn triangles(&self, path: &Path) -> Result<Vec<[u32; 3]>, IoError> {
        let mut triangles = Vec::with_capacity(self.polygons.ends.len());
        for (face, corners) in self.polygons.iter().enumerate() {
            if corners.len() < 3 {
                return Err(IoError::FewCorners {
                    path: path.to_owned(),
                    face,
                    corners: corners.len(),
                });
            }
            for triangle in cut_into_triangles(corners) {
                triangles.push(self.in_range(path, "face", face, triangle)?);
            }
        }
        Ok(triangles)
    }

    fn cells_in_range<const N: usize>(
        &self,
        path: &Path,
        element: &'static str,
        cells: &[[i64; N]],
    ) -> Result<Vec<[u32; N]>, IoError> {
        let cells = cells.iter().enumerate();
        cells
            .map(|(index, cell)| self.in_range(path, element, index, *cell))
            .collect()
    }

    fn in_range<const N: usize>(
        &self,
        path: &Path,
        element: &'static str,
        index: usize,
        corners: [i64; N],
    ) -> Result<[u32; N], IoError> {
        let vertices = self.vertices.len();
        let missing = |v: &i64| usize::try_from(*v).map_or(true, |v| v >= vertices);
        match corners.into_iter().find(missing) {
            Some(vertex) => Err(IoError::IndexOutOfRange {
                path: path.to_owned(),
                element,
                index,
                vertex: vertex.saturating_add(self.base),
                vertices,
                base: self.base,
            }),
            // The cast may truncate, but more than 31 bits are refused when the mesh is built.
            None => Ok(corners.map(|v| v as u32)),
        }
    }

    fn refuse_other_cells(&self, path: &Path) -> Result<(), IoError> {
        match &self.other_cells {
            Some((kind, count)) => {
                let remedy = "cut its cells into linear tetrahedra, or give the boundary as a surface";
                Err(IoError::unsupported(path, format!("{count} {kind}"), remedy))
            }
            None => Ok(()),
        }
    }

    fn no_geometry(&self, path: &Path) -> IoError {
        IoError::NoGeometry {
            path: path.to_owned(),
            vertices: self.vertices.len(),
        }
    }
}

/// A polygon's triangles, from three corners on.
fn cut_into_triangles(polygon: &[i64]) -> Vec<[i64; 3]> {
    let mut triangles = Vec::with_capacity(polygon.len() - 2);
    let mut left = polygon.to_vec();
    while left.len() > 3 {
        let mut kept = Vec::with_capacity(left.len() / 2 + 1);
        for two in left.chunks(2) {
            kept.push(two[0]);
            if let &[a, b] = two {
                let next = left.get(2 * kept.len());
                triangles.push(next.map_or([left[0], a, b], |&next| [a, b, next]));
            }
        }
        left = kept;
    }
    if let &[a, b, c] = left.as_slice() {
        triangles.push([a, b, c]);
    }
    triangles
}

fn with_path(error: MeshError, path: &Path) -> IoError {
    let path = path.to_owned();
    match error {
        MeshError::TooLarge { element, count } => IoError::TooLarge {
            path,
            element: match element {
                "vertex" => "vertices",
                "triangle" => "triangles",
                "hexahedron" => "hexahedra",
                _ => "tetrahedra",
            },
            count,
        },
        MeshError::IndexOutOfRange {
            element,
            index,
            vertex,
            vertices,
        } => IoError::IndexOutOfRange {
            path,
            element,
            index,
            vertex: i64::from(vertex),
            vertices,
            base: 0,
        },
        MeshError::RegionCount { cells, regions } => IoError::value_count(&path, "regions", cells, regions),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn too_many_elements_are_named_with_the_file() {
        let error = MeshError::TooLarge {
            element: "vertex",
            count: 3_000_000_000,
        };
        let message = with_path(error, Path::new("a.ply")).to_string();
        let expected = "`a.ply` holds 3000000000 vertices, more than the 2147483647 that 31-bit indices can name";
        assert_eq!(message, expected);
    }

    /// Two points of 2⁶³ components need 2⁶⁴ values, which wraps to 0, the number that there are.
    #[test]
    fn absurdly_many_components_are_refused() {
        let raw = RawMesh {
            vertices: vec![Point::origin(); 2],
            point_fields: vec![Field {
                name: "a".into(),
                components: 1 << 63,
                values: vec![],
            }],
            ..RawMesh::default()
        };
        let message = raw.into_fields(Path::new("a.vtu")).unwrap_err().to_string();
        let expected = "`a.vtu` holds the field `a` of 9223372036854775808 components, which is not supported: leave it \
                        out, or cut it into fields of at most 4096 components";
        assert_eq!(message, expected);
    }

    #[test]
    fn the_cut_of_a_polygon_depends_on_its_corners_alone() {
        let polygons = || {
            let mut polygons = CornerLists::default();
            polygons.push([2, 4, 3, 1, 0]);
            polygons
        };
        let surface = |height: f64| {
            let raw = RawMesh {
                vertices: (0..5)
                    .map(|k| Point::new(f64::from(k), height * f64::from(k % 2), 0.0))
                    .collect(),
                polygons: polygons(),
                ..RawMesh::default()
            };
            raw.into_surface(Path::new("a.obj")).unwrap()
        };
        let [flat, bent] = [surface(0.0), surface(7.0)];
        assert_eq!(flat.triangles(), [[2, 4, 3], [3, 1, 0], [2, 3, 0]]);
        assert_eq!(flat.triangles(), bent.triangles());
    }

    #[test]
    fn a_polygon_of_any_size_is_cut_so_that_few_triangles_meet() {
        for corners in 3..200_i64 {
            let polygon: Vec<i64> = (0..corners).collect();
            let triangles = cut_into_triangles(&polygon);
            assert_eq!(triangles.len() as i64, corners - 2);
            // Every edge of the polygon once, and every other edge twice, in opposite directions.
            let edges = || triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
            let is_border = |[a, b]: &[i64; 2]| (a + 1) % corners == *b;
            let borders: BTreeSet<[i64; 2]> = edges().filter(is_border).collect();
            let inner: BTreeSet<[i64; 2]> = edges().filter(|edge| !is_border(edge)).collect();
            assert_eq!(
                borders.len() + inner.len(),
                3 * triangles.len(),
                "an edge twice in one direction"
            );
            assert_eq!(borders.len() as i64, corners);
            assert!(inner.iter().all(|&[a, b]| inner.contains(&[b, a])));
            let most = (0..corners).map(|v| triangles.iter().flatten().filter(|&&corner| corner == v).count());
            let levels = 1 + corners.ilog2() as usize;
            assert!(most.max().unwrap() <= 2 * levels, "{corners} corners");
        }
        assert_eq!(cut_into_triangles(&[5, 6, 7, 8]), [[5, 6, 7], [5, 7, 8]]);
    }
}
