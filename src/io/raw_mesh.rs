//! The unchecked content of any mesh file, and its conversion to a surface, a volume mesh or points with fields.

use std::collections::BTreeMap;
use std::path::Path;

use super::polygon::{self, Triangles};
use super::{Field, FieldFile, IoError, SolidMesh, SurfaceFields, input::excerpt};
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
    /// Whether some polygons are parts of strips, in formats with cell fields.
    pub has_strips: bool,
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

/// The triangles of some polygons, by their number in the file.
pub(super) type PolygonCuts = BTreeMap<usize, Triangles>;

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
        let cuts = self.cuts_by_shape();
        self.into_surface_cut(path, &cuts)
    }

    /// As [`Self::into_surface`], but with polygons cut into the triangles of another surface where it has the same ones.
    pub fn into_surface_as(self, path: &Path, other: &SurfaceMesh) -> Result<SurfaceMesh, IoError> {
        let cuts = self.cuts_as_in(other);
        self.into_surface_cut(path, &cuts)
    }

    /// As [`Self::into_surface`], but with polygons cut as said, and the others by the order of their corners.
    pub fn into_surface_cut(self, path: &Path, cuts: &PolygonCuts) -> Result<SurfaceMesh, IoError> {
        self.refuse_other_cells(path)?;
        if self.has_cells() {
            return Err(IoError::WrongKind {
                path: path.to_owned(),
                found: self.cell_counts(),
                wanted: "a surface is needed here; extract the boundary of the cells",
            });
        }
        let triangles = self.triangles(path, cuts)?;
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
        self.check_fields(path, &point, &cell)?;
        self.refuse_other_cells(path)?;
        if !self.has_cells() {
            let triangles = self.triangles(path, &self.cuts_by_shape())?;
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

    /// The surface with its fields; those over cells where every cell of the file is a polygon.
    pub fn into_surface_with_fields(mut self, path: &Path) -> Result<SurfaceFields, IoError> {
        let point = std::mem::take(&mut self.point_fields);
        let cell = std::mem::take(&mut self.cell_fields);
        self.check_fields(path, &point, &cell)?;
        let corners: Vec<usize> = self.polygons.iter().map(<[i64]>::len).collect();
        let all_are_polygons = !self.has_strips && corners.len() == self.cells;
        let surface = self.into_surface(path)?;
        let of_triangles = |field: Field| {
            let of_cell = field.values.chunks_exact(field.components.max(1)).zip(&corners);
            let values = of_cell.flat_map(|(value, corners)| std::iter::repeat_n(value, corners.saturating_sub(2)));
            let values = values.flatten().copied().collect();
            Field { values, ..field }
        };
        Ok(SurfaceFields {
            surface,
            point,
            triangle: match all_are_polygons {
                true => cell.into_iter().map(of_triangles).collect(),
                false => vec![],
            },
        })
    }

    /// Refuses fields that have not one value for each vertex or cell.
    fn check_fields(&self, path: &Path, point: &[Field], cell: &[Field]) -> Result<(), IoError> {
        let (vertices, cells) = (self.vertices.len(), self.cells);
        if let Some(field) = point.iter().chain(cell).find(|f| f.components > MAX_COMPONENTS) {
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
        Ok(())
    }

    /// How polygons are cut whose shape asks for it: see [`polygon::cut_by_shape`].
    pub fn cuts_by_shape(&self) -> PolygonCuts {
        let of_face = |(face, corners): (usize, &[i64])| {
            if corners.len() < 4 {
                return None;
            }
            let at = |&v: &i64| self.vertices.get(usize::try_from(v).ok()?).copied();
            let places: Vec<Point> = corners.iter().map(at).collect::<Option<_>>()?;
            Some((face, polygon::cut_by_shape(&places)?))
        };
        self.polygons.iter().enumerate().filter_map(of_face).collect()
    }

    /// How polygons are cut to get the triangles of another surface, as far as these are triangles of the same polygons, in
    /// order.
    fn cuts_as_in(&self, surface: &SurfaceMesh) -> PolygonCuts {
        let mut left = surface.triangles();
        let mut cuts = PolygonCuts::new();
        for (face, corners) in self.polygons.iter().enumerate() {
            let Some((own, others)) = left.split_at_checked(corners.len().saturating_sub(2)) else {
                break;
            };
            left = others;
            let corner = |v: u32| corners.iter().position(|&c| c == i64::from(v)).map(|k| k as u32);
            let cut = own.iter().map(|t| match t.map(corner) {
                [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                _ => None,
            });
            if let Some(cut) = cut.collect() {
                cuts.insert(face, cut);
            }
        }
        cuts
    }

    /// The triangles of all polygons, cut as said, and the others by the order of their corners.
    fn triangles(&self, path: &Path, cuts: &PolygonCuts) -> Result<Vec<[u32; 3]>, IoError> {
        let mut triangles = Vec::with_capacity(self.polygons.ends.len());
        for (face, corners) in self.polygons.iter().enumerate() {
            if corners.len() < 3 {
                return Err(IoError::FewCorners {
                    path: path.to_owned(),
                    face,
                    corners: corners.len(),
                });
            }
            let by_shape = cuts.get(&face).filter(|cut| cut.len() + 2 == corners.len());
            let by_order = by_shape.is_none().then(|| polygon::cut_by_order(corners.len()));
            for triangle in by_shape.or(by_order.as_ref()).into_iter().flatten() {
                let triangle = triangle.map(|k| corners[k as usize]);
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
    fn the_cut_of_a_convex_polygon_depends_on_its_corners_alone() {
        let surface = |height: f64| {
            let mut polygons = CornerLists::default();
            polygons.push([2, 4, 3, 1, 0]);
            let place = |k: i32| {
                let angle = [4.0, 3.0, 0.0, 2.0, 1.0][k as usize];
                Point::new(f64::cos(angle), f64::sin(angle), height * f64::from(k % 2))
            };
            let raw = RawMesh {
                vertices: (0..5).map(place).collect(),
                polygons,
                ..RawMesh::default()
            };
            raw.into_surface(Path::new("a.obj")).unwrap()
        };
        let [flat, bent] = [surface(0.0), surface(0.4)];
        assert_eq!(flat.triangles(), [[2, 4, 3], [3, 1, 0], [2, 3, 0]]);
        assert_eq!(flat.triangles(), bent.triangles());
    }

    #[test]
    fn an_image_is_cut_as_its_domain() {
        let raw = |reflex: f64| {
            let mut polygons = CornerLists::default();
            polygons.push([0, 1, 2]);
            polygons.push([0, 1, 2, 3]);
            polygons.push([3, 2, 1, 0]);
            let corners = [[0., 0., 0.], [2., -3., 0.], [reflex, 0., 0.], [2., 3., 0.]];
            RawMesh {
                vertices: corners.map(Point::from).to_vec(),
                polygons,
                ..RawMesh::default()
            }
        };
        let path = Path::new("a.obj");
        // Convex, and concave at corner 2: there the order from corner 3 on is not that of a good cut.
        let convex = raw(5.0).into_surface(path).unwrap();
        let own = raw(1.0).into_surface(path).unwrap();
        assert_eq!(own.triangles()[..3], [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        assert_eq!(convex.triangles()[..3], own.triangles()[..3]);
        assert_eq!(convex.triangles()[3..], [[3, 2, 1], [3, 1, 0]]);
        assert_ne!(own.triangles(), convex.triangles());
        let same = raw(1.0).into_surface_as(path, &convex).unwrap();
        assert_eq!(same.triangles(), convex.triangles());
        let back = raw(5.0).into_surface_as(path, &own).unwrap();
        assert_eq!(back.triangles(), own.triangles());
    }
}
