use super::boundary_surface::{BoundarySurface, boundary_surface};
use super::surface_mesh::{MeshError, check_counts};
use super::tet_mesh::TetMesh;
use crate::Point;

/// Cells of one kind. None are tetrahedra by default.
#[derive(Debug, Clone, PartialEq)]
pub enum CellList {
    /// Tetrahedra; right-handed ones `[a, b, c, d]` have `det(b-a, c-a, d-a) > 0`.
    Tets(Vec<[u32; 4]>),
    /// Hexahedra: four corners around the bottom, counter-clockwise seen from above, then the four over them.
    Hexes(Vec<[u32; 8]>),
}

/// Steps along x, y and z from the first corner of an upright hexahedron to each, in the order of [`CellList::Hexes`].
pub const HEXAHEDRON: [[u8; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
    [0, 1, 1],
];

/// Faces of a right-handed tetrahedron, counter-clockwise seen from outside.
pub(crate) const TET_FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

/// Faces of a right-handed hexahedron, counter-clockwise seen from outside.
pub(crate) const HEX_FACES: [[usize; 4]; 6] = [
    [0, 3, 2, 1],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
];

/// Corners of a hexahedron, each with its neighbours in right-handed order.
pub(crate) const HEX_CORNERS: [[usize; 4]; 8] = [
    [0, 1, 3, 4],
    [1, 2, 0, 5],
    [2, 3, 1, 6],
    [3, 0, 2, 7],
    [4, 7, 5, 0],
    [5, 4, 6, 1],
    [6, 5, 7, 2],
    [7, 6, 4, 3],
];

impl Default for CellList {
    fn default() -> Self {
        Self::Tets(Vec::new())
    }
}

impl CellList {
    /// Number of cells.
    pub fn len(&self) -> usize {
        match self {
            Self::Tets(cells) => cells.len(),
            Self::Hexes(cells) => cells.len(),
        }
    }

    /// Some of the cells, in this order.
    pub(crate) fn select(&self, cells: &[u32]) -> Self {
        match self {
            Self::Tets(tets) => Self::Tets(cells.iter().map(|&cell| tets[cell as usize]).collect()),
            Self::Hexes(hexes) => Self::Hexes(cells.iter().map(|&cell| hexes[cell as usize]).collect()),
        }
    }

    /// The corners of each cell.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let (flat, corners) = match self {
            Self::Tets(cells) => (cells.as_flattened(), 4),
            Self::Hexes(cells) => (cells.as_flattened(), 8),
        };
        flat.chunks_exact(corners)
    }

    /// The corners of a cell.
    pub fn corners(&self, cell: usize) -> &[u32] {
        match self {
            Self::Tets(cells) => &cells[cell],
            Self::Hexes(cells) => &cells[cell],
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What a cell is called, in the singular: `"tetrahedron"` or `"hexahedron"`.
    pub fn element(&self) -> &'static str {
        match self {
            Self::Tets(_) => "tetrahedron",
            Self::Hexes(_) => "hexahedron",
        }
    }

    /// What cells are called, in the plural: `"tetrahedra"` or `"hexahedra"`.
    pub fn elements(&self) -> &'static str {
        match self {
            Self::Tets(_) => "tetrahedra",
            Self::Hexes(_) => "hexahedra",
        }
    }
}

/// A mesh of a solid by cells, each in a region.
#[derive(Debug, Clone, PartialEq)]
pub struct CellMesh {
    nodes: Vec<Point>,
    cells: CellList,
    regions: Vec<i32>,
}

impl CellMesh {
    /// A mesh of these nodes and cells (0-based), with the region that every cell belongs to.
    ///
    /// # Errors
    ///
    /// As [`super::SurfaceMesh::new`]; [`MeshError::RegionCount`] unless there is one region per cell.
    pub fn new(nodes: Vec<Point>, cells: CellList, regions: Vec<i32>) -> Result<Self, MeshError> {
        match &cells {
            CellList::Tets(tets) => check_counts(nodes.len(), "tetrahedron", tets)?,
            CellList::Hexes(hexes) => check_counts(nodes.len(), "hexahedron", hexes)?,
        }
        if regions.len() != cells.len() {
            return Err(MeshError::RegionCount {
                cells: cells.len(),
                regions: regions.len(),
            });
        }
        Ok(Self { nodes, cells, regions })
    }

    /// Positions of the nodes.
    pub fn nodes(&self) -> &[Point] {
        &self.nodes
    }

    /// The cells.
    pub fn cells(&self) -> &CellList {
        &self.cells
    }

    /// The region of every cell.
    pub fn regions(&self) -> &[i32] {
        &self.regions
    }

    /// The same cells over other positions of the nodes, such as their images. `None` when the count differs.
    pub fn with_nodes(&self, nodes: Vec<Point>) -> Option<Self> {
        (nodes.len() == self.nodes.len()).then(|| Self {
            nodes,
            cells: self.cells.clone(),
            regions: self.regions.clone(),
        })
    }

    /// Volume of a cell, positive when it is right-handed. That of a hexahedron is the volume of its trilinear map, whose
    /// faces are bilinear.
    pub fn signed_volume(&self, cell: usize) -> f64 {
        match &self.cells {
            CellList::Tets(tets) => tet_volume(&tets[cell].map(|v| self.nodes[v as usize])),
            CellList::Hexes(hexes) => hex_volume(&hexes[cell].map(|v| self.nodes[v as usize])),
        }
    }

    /// Sum of the signed volumes.
    pub fn volume(&self) -> f64 {
        (0..self.cells.len()).map(|cell| self.signed_volume(cell)).sum()
    }

    /// The faces that belong to one cell only, as triangles that face outward, in the order of the cells.
    ///
    /// A quad is split by the diagonal from the corner that it begins with in the order of [`CellList::Hexes`]: corner 0
    /// for three faces, 1 to 4 for one each. That depends on the order of the corners alone, not on positions, so that
    /// two meshes with the same cells, as in a boundary map, get the same triangles.
    ///
    /// Outward is decided for the mesh as a whole by the sign of its volume, so that a few inverted cells do not punch
    /// holes. Only in a mesh where neighbours are oriented inconsistently does each cell's own sign decide.
    pub fn boundary(&self) -> BoundarySurface {
        boundary_surface(&self.nodes, &self.cells, |cell| self.signed_volume(cell))
    }

    /// Nodes, cells and regions.
    pub fn into_parts(self) -> (Vec<Point>, CellList, Vec<i32>) {
        (self.nodes, self.cells, self.regions)
    }
}

impl From<TetMesh> for CellMesh {
    /// All cells are in region 0.
    fn from(mesh: TetMesh) -> Self {
        let (nodes, tets) = mesh.into_parts();
        let regions = vec![0; tets.len()];
        Self {
            nodes,
            cells: CellList::Tets(tets),
            regions,
        }
    }
}

/// Volume of a tetrahedron, positive when it is right-handed.
pub(super) fn tet_volume([a, b, c, d]: &[Point; 4]) -> f64 {
    (b - a).dot(&(c - a).cross(&(d - a))) / 6.0
}

/// Volume within the bilinear faces of a hexahedron. The flux through such a face is the mean of those through its two
/// splits into triangles.
fn hex_volume(corners: &[Point; 8]) -> f64 {
    let origin = corners[0];
    let flux = |face: [usize; 4]| {
        let [a, b, c, d] = face.map(|k| corners[k] - origin);
        let triangle = |[a, b, c]: [&crate::Vector; 3]| a.dot(&b.cross(c));
        triangle([&a, &b, &c]) + triangle([&a, &c, &d]) + triangle([&a, &b, &d]) + triangle([&b, &c, &d])
    };
    HEX_FACES.into_iter().map(flux).sum::<f64>() / 12.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two cubes side by side along x, with unit edges.
    fn two_cubes() -> CellMesh {
        let node = |k: u32| Point::new(f64::from(k % 3), f64::from(k / 3 % 2), f64::from(k / 6));
        let cube = |x: u32| HEXAHEDRON.map(|[i, j, k]| x + u32::from(i) + 3 * u32::from(j) + 6 * u32::from(k));
        let cells = CellList::Hexes(vec![cube(0), cube(1)]);
        CellMesh::new((0..12).map(node).collect(), cells, vec![0, 0]).unwrap()
    }

    #[test]
    fn the_boundary_of_hexahedra_is_closed_and_outward_however_they_are_listed() {
        let mesh = two_cubes();
        let upside_down = |cells: &[usize]| {
            let CellList::Hexes(mut hexes) = mesh.cells().clone() else {
                unreachable!()
            };
            cells.iter().for_each(|&cell| hexes[cell].rotate_left(4));
            CellMesh::new(mesh.nodes().to_vec(), CellList::Hexes(hexes), vec![0, 0]).unwrap()
        };
        for (mesh, volume) in [
            (mesh.clone(), 2.0),
            (upside_down(&[0, 1]), -2.0),
            (upside_down(&[1]), 0.0),
        ] {
            assert!((mesh.volume() - volume).abs() < 1e-14);
            let boundary = mesh.boundary();
            assert_eq!(boundary.surface.triangles().len(), 20);
            assert_eq!(boundary.vertex_ids.len(), 12);
            assert!((boundary.surface.volume() - 2.0).abs() < 1e-14);
            assert!(crate::mesh::topology::Topology::new(&boundary.surface).is_closed());
        }
    }

    #[test]
    fn the_split_of_boundary_quads_does_not_depend_on_positions() {
        let mesh = two_cubes();
        let moved = mesh
            .nodes()
            .iter()
            .map(|p| Point::new(p.x + 0.3 * p.y * p.z, p.y - 0.4 * p.x, p.z + 0.2 * p.x));
        let moved = mesh.with_nodes(moved.collect()).unwrap();
        assert_eq!(
            moved.boundary().surface.triangles(),
            mesh.boundary().surface.triangles()
        );
        // The bottom of the first cube, from its corner 0.
        assert_eq!(mesh.boundary().surface.triangles()[..2], [[0, 3, 4], [0, 4, 1]]);
    }

    /// The determinant of the trilinear map, integrated by Gauss points, is its volume.
    #[test]
    fn the_volume_of_a_hexahedron_is_that_of_its_trilinear_map() {
        let place = |[i, j, k]: [u8; 3]| {
            let [x, y, z] = [i, j, k].map(f64::from);
            Point::new(
                x + 0.2 * y * z,
                y + 0.3 * x * z - 0.1 * x,
                z * (1.0 + 0.5 * x * y) + 7.0,
            )
        };
        let corners = HEXAHEDRON.map(place);
        let nodes = corners.to_vec();
        let mesh = CellMesh::new(nodes, CellList::Hexes(vec![[0, 1, 2, 3, 4, 5, 6, 7]]), vec![0]).unwrap();
        let points = 24;
        let at = |k: usize| (k as f64 + 0.5) / points as f64;
        let trilinear = |[x, y, z]: [f64; 3]| {
            let mut sum = crate::Vector::zeros();
            for (corner, [i, j, k]) in corners.iter().zip(HEXAHEDRON) {
                let weight = |upper: u8, t: f64| if upper == 1 { t } else { 1.0 - t };
                sum += corner.coords * (weight(i, x) * weight(j, y) * weight(k, z));
            }
            sum
        };
        let mut volume = 0.0;
        for n in 0..points * points * points {
            let p = [n % points, n / points % points, n / (points * points)].map(at);
            let step = 1e-4;
            let slope = |axis: usize| {
                let shifted = |by: f64| {
                    let mut q = p;
                    q[axis] += by;
                    trilinear(q)
                };
                (shifted(step) - shifted(-step)) / (2.0 * step)
            };
            volume += slope(0).dot(&slope(1).cross(&slope(2)));
        }
        volume /= (points * points * points) as f64;
        // The midpoint rule errs by the order of 1/24².
        assert!(
            (mesh.signed_volume(0) - volume).abs() < 1e-3 * volume,
            "{} {volume}",
            mesh.signed_volume(0)
        );
    }
}
