//! Quadrature on a regular grid whose cells are clipped by the solid: Li, Guo, Wang, He, Gu & Qin, *Harmonic volumetric
//! mapping for solid modeling applications* (2007), equation (3), with the exact volume of every clipped cell.
//!
//! A point lies in the solid when more upward than downward triangles are above it. So the volume of a cell is the
//! signed sum, over the surface pieces `Q` above its square, of the prisms that they cut from it,
//!
//! ```text
//! vol(cell ∩ M) = Σ_Q sign(n_z) ∫_{proj Q} clamp(z_Q(x, y) − z₀, 0, size) dx dy,
//! ```
//!
//! and the first moments likewise. Triangles are cut along the grid planes, so that the integrand is a polynomial on
//! every part: a part inside the cell adds its own prism, one above it adds the full height over its projection, one
//! below it nothing. Each column is swept once from the top with the projections summed so far. Vertical triangles have
//! no projection and drop out; faces on grid planes need no special case, because the prism of a part on the floor of
//! one cell equals that of a part on the ceiling of the next.
//!
//! The map's singularities lie just outside the solid, so a density must not be taken outside. Every cell is evaluated
//! at the centroid of its clipped part (exact for linear densities); where that is outside, because the part is not
//! convex or not connected, the cell is divided and each piece gets its own point.

use std::collections::{HashMap, HashSet};

use rayon::prelude::*;

use super::{
    quadrature::{CellLayout, Grid, Quadrature, QuadratureError, sum},
    tet_quadrature::require_finite,
};
use crate::{
    Point, Vector,
    geometry::clip::{Polygon, between, fan, projected_area, split},
    mesh::SurfaceMesh,
};

/// How fine a grid is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GridResolution {
    /// Cells along the longest side of the bounding box; 32 to 128 is usual.
    CellsAlongLongestSide(usize),
    /// Edge length of a cell. It grows by up to 10⁻⁹ of itself where a side is a multiple of it up to rounding.
    CellSize(f64),
}

impl std::fmt::Display for GridResolution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::CellsAlongLongestSide(cells) => write!(f, "{cells} cells along its longest side"),
            Self::CellSize(size) => write!(f, "cells of size {size}"),
        }
    }
}

/// Quadrature on a regular grid over the bounding box of a closed surface, every weight the exact volume of the part
/// of a cell that the surface encloses.
///
/// Takes any closed, consistently oriented surface: several components, cavities, handles, faces on grid planes. Where
/// components overlap, the overlap counts twice, as in [`SurfaceMesh::volume`]. The weights sum up to that volume up to
/// rounding. Linear densities are integrated exactly where no cell needs a fallback point, smooth ones with an error of
/// second order in the cell size. Parts below 10⁻⁹ of a cell are distributed over the others. The result does not
/// depend on the number of threads.
///
/// The cost is linear in the triangles, the cells that the surface crosses and the cells of the grid.
///
/// # Errors
///
/// [`QuadratureError`], for surfaces that bound no solid and grids of no or too many cells. Holes in walls parallel to
/// z change no volume and are not noticed.
pub fn clipped_grid(surface: &SurfaceMesh, resolution: GridResolution) -> Result<Quadrature, QuadratureError> {
    GridClipper::new(surface, base_grid(surface, resolution)?).quadrature()
}

/// The grid around a surface whose coordinates are finite.
pub(super) fn base_grid(surface: &SurfaceMesh, resolution: GridResolution) -> Result<Grid, QuadratureError> {
    if surface.triangles().is_empty() {
        return Err(QuadratureError::Empty { element: "triangle" });
    }
    require_finite(surface.vertices(), surface.triangles())?;
    grid_around(surface, resolution)
}

/// How often the cells of a grid can be halved.
pub(super) fn most_halvings(grid: &Grid) -> usize {
    let longest = grid.dims.into_iter().max().unwrap_or(1) as u64;
    (MAX_CELLS_ALONG_AXIS / longest.max(1)).checked_ilog2().unwrap_or(0) as usize
}

/// Parts below this fraction of a cell cannot be distinguished from rounding errors: coordinates are in units of cells,
/// up to `2¹⁶`, with an error of at most `10⁻¹¹`.
const NEGLIGIBLE: f64 = 1e-9;
/// Largest net projected area, in cells, in a column of a closed surface; unwelded seams of single-precision files stay
/// below it.
const OPENING: f64 = 1e-6;
/// Largest fraction of negative cell volumes that counts as rounding or as a harmless self-intersection.
const INSIDE_OUT: f64 = 1e-6;
/// How often a cell with its centroid outside is halved before its point is put on the surface.
const MAX_DIVISIONS: u32 = 5;
/// Largest number of cells: some 8 GB of points and densities if all are inside.
const MAX_CELLS: u64 = 1 << 26;
const MAX_CELLS_ALONG_AXIS: u64 = 1 << 16;

/// The part of a triangle in a column, in grid units (the grid's origin at 0, cells of size 1).
struct SurfacePiece {
    triangle: u32,
    polygon: Polygon,
}

/// A stack of cells over a square, and all surface pieces over that square at its floor or above.
struct CellColumn {
    corner: Point,
    size: f64,
    pieces: Vec<SurfacePiece>,
}

/// Volume of the part of a cell inside the solid, and its first moments about the cell's lowest corner.
#[derive(Clone, Default)]
struct Moments {
    volume: f64,
    first: Vector,
}

/// Signed area of the projection of surface pieces along z, and its first moments about the column's corner.
#[derive(Clone, Copy, Default)]
struct ProjectedMoments {
    area: f64,
    first: [f64; 2],
}

/// Points in cells of a grid, and the volume that each represents. Those of a cell follow each other.
#[derive(Default)]
pub(super) struct CellPoints {
    pub(super) points: Vec<Point>,
    pub(super) volumes: Vec<f64>,
    /// The cell of each point, numbered as by [`Grid::index_of`].
    pub(super) cells: Vec<u64>,
}

/// Which cells are asked for.
enum Selection {
    All,
    /// Those inside of given cells of a grid half as fine: the steps along z for each pair of steps along x and y.
    Inside(HashMap<[usize; 2], HashSet<usize>>),
}

/// The points between two neighbouring grid planes across the x axis, in grid units.
#[derive(Default)]
struct Slab {
    found: CellPoints,
    /// Sum over all cells, including those without points.
    volume: f64,
    negative: f64,
    /// A column, as `[i, j]`, where the surface is not closed.
    open: Option<[usize; 2]>,
}

/// Clips the cells of a grid by a closed surface.
pub(super) struct GridClipper<'a> {
    grid: Grid,
    triangles: &'a [[u32; 3]],
    /// All vertices in grid units.
    vertices: Vec<Point>,
}

fn grid_around(surface: &SurfaceMesh, resolution: GridResolution) -> Result<Grid, QuadratureError> {
    // Only vertices in use: unused ones would waste cells.
    let mut used = surface
        .triangles()
        .iter()
        .flatten()
        .map(|&v| surface.vertices()[v as usize]);
    let first = used.next().ok_or(QuadratureError::Empty { element: "triangle" })?;
    let (low, high) = used.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
    let sides = high - low;
    let longest = sides.max();
    if !(longest > 0.0 && longest.is_finite()) {
        return Err(QuadratureError::NoVolume {
            volume: surface.volume(),
        });
    }

    let wanted = match resolution {
        GridResolution::CellsAlongLongestSide(cells) if cells > 0 => longest / cells as f64,
        GridResolution::CellSize(size) if size > 0.0 && size.is_finite() => size,
        impossible => return Err(QuadratureError::NoCells(impossible)),
    };
    // Rounding must not add a cell to a side that is a whole number of cells.
    let cells = sides.map(|side| (side / wanted * (1.0 - 1e-9)).ceil().max(1.0));
    if cells.product() > MAX_CELLS as f64 || cells.max() > MAX_CELLS_ALONG_AXIS as f64 {
        return Err(QuadratureError::TooManyCells {
            cells: cells.data.0[0].map(|c| c as u64),
            limit: MAX_CELLS,
            axis_limit: MAX_CELLS_ALONG_AXIS,
        });
    }
    let cell_size = sides.component_div(&cells).max().max(wanted);
    Ok(Grid {
        origin: low + (sides - cells * cell_size) / 2.0,
        cell_size,
        dims: cells.data.0[0].map(|c| c as usize),
    })
}

/// The quadrature of all slabs, in model units.
fn assembled(slabs: &[Slab], grid: Grid) -> Result<Quadrature, QuadratureError> {
    if let Some([i, j]) = slabs.iter().find_map(|slab| slab.open) {
        let centre = grid.origin + Vector::new(i as f64 + 0.5, j as f64 + 0.5, 0.0) * grid.cell_size;
        return Err(QuadratureError::Open {
            x: centre.x,
            y: centre.y,
        });
    }
    let cell_volume = grid.cell_size.powi(3);
    let volume = sum(slabs.iter().map(|slab| slab.volume));
    let kept = sum(slabs.iter().flat_map(|slab| slab.found.volumes.iter().copied()));
    let negative = sum(slabs.iter().map(|slab| slab.negative));
    let (volume_here, negative_here) = (volume * cell_volume, negative * cell_volume);
    if !(volume > 0.0 && kept > 0.0 && volume_here > 0.0) {
        return Err(QuadratureError::NoVolume { volume: volume_here });
    }
    if negative < -INSIDE_OUT * volume {
        return Err(QuadratureError::InsideOut {
            negative: negative_here,
            volume: volume_here,
        });
    }

    let found = in_model_units(slabs, grid, volume / kept);
    Ok(Quadrature::new(
        found.points,
        found.volumes,
        found.cells.into_iter().map(|cell| cell as u32).collect(),
        CellLayout::Grid(grid),
    ))
}

/// The points of all slabs, their volumes times a factor.
fn in_model_units(slabs: &[Slab], grid: Grid, factor: f64) -> CellPoints {
    let scale = grid.cell_size.powi(3) * factor;
    let found = || slabs.iter().map(|slab| &slab.found);
    let points = found().flat_map(|slab| &slab.points);
    CellPoints {
        points: points.map(|p| grid.origin + p.coords * grid.cell_size).collect(),
        volumes: found().flat_map(|slab| &slab.volumes).map(|w| w * scale).collect(),
        cells: found().flat_map(|slab| &slab.cells).copied().collect(),
    }
}

impl<'a> GridClipper<'a> {
    pub(super) fn new(surface: &'a SurfaceMesh, grid: Grid) -> Self {
        let in_grid = |p: &Point| Point::from((p - grid.origin) / grid.cell_size);
        Self {
            vertices: surface.vertices().iter().map(in_grid).collect(),
            triangles: surface.triangles(),
            grid,
        }
    }

    /// A point for every cell, with a check that the surface bounds a solid. Cells are numbered by 32 bits.
    pub(super) fn quadrature(&self) -> Result<Quadrature, QuadratureError> {
        assembled(&self.slabs(&Selection::All), self.grid)
    }

    /// The points of all cells, unchecked.
    pub(super) fn all_cells(&self) -> CellPoints {
        in_model_units(&self.slabs(&Selection::All), self.grid, 1.0)
    }

    /// The points of the cells inside of cells, given by their steps, of a grid half as fine.
    pub(super) fn cells_inside(&self, wholes: &[[usize; 3]]) -> CellPoints {
        let mut columns: HashMap<[usize; 2], HashSet<usize>> = HashMap::new();
        for &[i, j, k] in wholes {
            columns.entry([i, j]).or_default().insert(k);
        }
        in_model_units(&self.slabs(&Selection::Inside(columns)), self.grid, 1.0)
    }

    fn slabs(&self, selection: &Selection) -> Vec<Slab> {
        let triangles = self.triangles_by_slab();
        let slabs = triangles.par_iter().enumerate();
        slabs.map(|(i, slab)| self.slab(i, slab, selection)).collect()
    }

    fn corners(&self, triangle: u32) -> [Point; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices[v as usize])
    }

    fn triangles_by_slab(&self) -> Vec<Vec<u32>> {
        let mut slabs = vec![Vec::new(); self.grid.dims[0]];
        for triangle in 0..self.triangles.len() as u32 {
            let (first, last) = steps_covered(&self.corners(triangle), 0, self.grid.dims[0]);
            slabs[first..=last].iter_mut().for_each(|slab| slab.push(triangle));
        }
        slabs
    }

    fn slab(&self, i: usize, triangles: &[u32], selection: &Selection) -> Slab {
        let [_, ny, nz] = self.grid.dims;
        if !(0..ny).any(|j| selection.has_column(i, j)) {
            return Slab::default();
        }
        let mut columns: Vec<Vec<SurfacePiece>> = (0..ny).map(|_| Vec::new()).collect();
        for &triangle in triangles {
            let corners = Polygon::from_slice(&self.corners(triangle));
            let mut rest = between(corners, 0, i as f64, (i + 1) as f64);
            let (first, last) = steps_covered(&rest, 1, ny);
            for (j, column) in columns.iter_mut().enumerate().take(last + 1).skip(first) {
                let (polygon, beyond) = split(rest, 1, (j + 1) as f64);
                if polygon.len() >= 3 && selection.has_column(i, j) {
                    column.push(SurfacePiece { triangle, polygon });
                }
                rest = beyond;
            }
        }

        let mut slab = Slab::default();
        for (j, pieces) in columns.into_iter().enumerate().filter(|(_, pieces)| !pieces.is_empty()) {
            let corner = Point::new(i as f64, j as f64, 0.0);
            let column = CellColumn {
                corner,
                size: 1.0,
                pieces,
            };
            let (cells, below) = column.cells(nz);
            if below.area.abs() > OPENING {
                slab.open.get_or_insert([i, j]);
            }
            let selected = cells.iter().enumerate().filter(|(k, _)| selection.has_cell(i, j, *k));
            for (k, moments) in selected {
                slab.volume += moments.volume;
                if moments.volume < -NEGLIGIBLE {
                    slab.negative += moments.volume;
                }
                let cell = self.grid.index_of([i, j, k]);
                self.place(&column, k as f64, moments, cell, 0, &mut slab.found);
            }
        }
        slab
    }

    /// Adds the points of the cell of `column` whose floor is at `floor`.
    fn place(
        &self,
        column: &CellColumn,
        floor: f64,
        moments: &Moments,
        cell: u64,
        divisions: u32,
        found: &mut CellPoints,
    ) {
        let full = column.size.powi(3);
        if moments.volume <= NEGLIGIBLE * full {
            return;
        }
        let corner = Point::new(column.corner.x, column.corner.y, floor);
        let centroid = corner + (moments.first / moments.volume).map(|m| m.clamp(0.0, column.size));
        let mut push = |point| {
            found.points.push(point);
            found.volumes.push(moments.volume);
            found.cells.push(cell);
        };
        if moments.volume >= (1.0 - NEGLIGIBLE) * full || self.is_inside(&column.pieces, &centroid) {
            push(centroid);
        } else if divisions == MAX_DIVISIONS {
            if let Some(point) = column.nearest_surface_point(floor, &centroid) {
                push(point);
            }
        } else {
            for quarter in column.quarters(floor) {
                let (cells, _) = quarter.cells(2);
                for (k, moments) in cells.iter().enumerate() {
                    let floor = floor + k as f64 * quarter.size;
                    self.place(&quarter, floor, moments, cell, divisions + 1, found);
                }
            }
        }
    }

    /// Whether more upward than downward triangles of a column are above a point of it.
    fn is_inside(&self, pieces: &[SurfacePiece], point: &Point) -> bool {
        let above = pieces.iter().map(|piece| {
            let corners = self.corners(piece.triangle);
            let [a, b, c] = corners;
            let normal = (b - a).cross(&(c - a));
            if normal.z == 0.0 || !covers(&corners, point) {
                return 0;
            }
            let z = a.z - (normal.x * (point.x - a.x) + normal.y * (point.y - a.y)) / normal.z;
            if z <= point.z { 0 } else { normal.z.signum() as i32 }
        });
        above.sum::<i32>() > 0
    }
}

impl Selection {
    fn has_column(&self, i: usize, j: usize) -> bool {
        match self {
            Self::All => true,
            Self::Inside(columns) => columns.contains_key(&[i / 2, j / 2]),
        }
    }

    fn has_cell(&self, i: usize, j: usize, k: usize) -> bool {
        match self {
            Self::All => true,
            Self::Inside(columns) => columns
                .get(&[i / 2, j / 2])
                .is_some_and(|steps| steps.contains(&(k / 2))),
        }
    }
}

impl CellColumn {
    /// Moments of the lowest `count` cells, and the projection of all pieces, which has no area below a closed surface.
    fn cells(&self, count: usize) -> (Vec<Moments>, ProjectedMoments) {
        let mut cells = vec![Moments::default(); count];
        let mut projections = vec![ProjectedMoments::default(); count + 1];
        let mut below_floor = ProjectedMoments::default();
        for piece in &self.pieces {
            let mut rest: Polygon = piece.polygon.iter().map(|p| Point::from(p - self.corner)).collect();
            let lowest = rest.iter().fold(f64::INFINITY, |low, p| low.min(p.z));
            if lowest < 0.0 {
                let (under, above) = split(rest, 2, 0.0);
                below_floor.add(&under);
                rest = above;
            }
            let first = ((lowest / self.size).max(0.0) as usize).min(count);
            for k in first..count {
                let (part, above) = split(rest, 2, (k + 1) as f64 * self.size);
                cells[k].add_prisms(&part, k as f64 * self.size);
                projections[k].add(&part);
                rest = above;
                if rest.is_empty() {
                    break;
                }
            }
            projections[count].add(&rest);
        }

        let mut projection = projections[count];
        for k in (0..count).rev() {
            cells[k].add_full_height(&projection, self.size);
            projection += projections[k];
        }
        projection += below_floor;
        (cells, projection)
    }

    /// The column over each quarter of the square, from `floor` up.
    fn quarters(&self, floor: f64) -> [CellColumn; 4] {
        let size = self.size / 2.0;
        [[0.0, 0.0], [0.0, size], [size, 0.0], [size, size]].map(|[x, y]| {
            let corner = Point::new(self.corner.x + x, self.corner.y + y, floor);
            let above_floor = |piece: &&SurfacePiece| piece.polygon.iter().any(|p| p.z >= floor);
            let pieces = self.pieces.iter().filter(above_floor).filter_map(|piece| {
                let strip = between(piece.polygon.clone(), 0, corner.x, corner.x + size);
                let polygon = between(strip, 1, corner.y, corner.y + size);
                let triangle = piece.triangle;
                (polygon.len() >= 3).then_some(SurfacePiece { triangle, polygon })
            });
            CellColumn {
                corner,
                size,
                pieces: pieces.collect(),
            }
        })
    }

    /// Among the midpoints of the pieces inside the cell at `floor`, the one nearest to `point`.
    fn nearest_surface_point(&self, floor: f64, point: &Point) -> Option<Point> {
        self.pieces
            .iter()
            .map(|piece| between(piece.polygon.clone(), 2, floor, floor + self.size))
            .filter(|part| !part.is_empty())
            .map(|part| Point::from(part.iter().map(|p| p.coords).sum::<Vector>() / part.len() as f64))
            .min_by(|a, b| (a - point).norm_squared().total_cmp(&(b - point).norm_squared()))
    }
}

impl Moments {
    /// Adds the prisms between a surface part and the floor of the cell, in coordinates about the column's corner.
    fn add_prisms(&mut self, part: &[Point], floor: f64) {
        for [a, b, c] in fan(part) {
            let [p, q, r] = [a, b, c].map(|p| p.coords - Vector::new(0.0, 0.0, floor));
            let area = projected_area(&a, &b, &c);
            let sum = p + q + r;
            // ∫ u v over a triangle of linear u and v is area / 12 · (Σ u Σ v + Σ u v).
            let with_height = (sum * sum.z + p * p.z + q * q.z + r * r.z) * (area / 12.0);
            self.volume += area * sum.z / 3.0;
            self.first += Vector::new(with_height.x, with_height.y, with_height.z / 2.0);
        }
    }

    /// Adds the cell's full height over the projection of what is above it.
    fn add_full_height(&mut self, projection: &ProjectedMoments, size: f64) {
        self.volume += projection.area * size;
        self.first += Vector::new(projection.first[0], projection.first[1], projection.area * size / 2.0) * size;
    }
}

impl ProjectedMoments {
    fn add(&mut self, part: &[Point]) {
        for [a, b, c] in fan(part) {
            let area = projected_area(&a, &b, &c);
            *self += Self {
                area,
                first: [a.x + b.x + c.x, a.y + b.y + c.y].map(|sum| area * sum / 3.0),
            };
        }
    }
}

impl std::ops::AddAssign for ProjectedMoments {
    fn add_assign(&mut self, other: Self) {
        self.area += other.area;
        self.first[0] += other.first[0];
        self.first[1] += other.first[1];
    }
}

/// First and last of `count` unit steps along an axis that the points reach over.
fn steps_covered(points: &[Point], axis: usize, count: usize) -> (usize, usize) {
    let step = |x: f64| (x.max(0.0) as usize).min(count - 1);
    points
        .iter()
        .map(|p| step(p[axis]))
        .fold((count - 1, 0), |(low, high), s| (low.min(s), high.max(s)))
}

/// Whether the projection of a triangle along z covers a point. On an edge exactly one of the two neighbours does.
fn covers(corners: &[Point; 3], point: &Point) -> bool {
    let crossed = (0..3).filter(|&n| {
        let (p, q) = (&corners[n], &corners[(n + 1) % 3]);
        let (low, high) = if p.y < q.y { (p, q) } else { (q, p) };
        let straddles = low.y <= point.y && point.y < high.y;
        straddles && point.x < low.x + (point.y - low.y) * ((high.x - low.x) / (high.y - low.y))
    });
    crossed.count() % 2 == 1
}

#[cfg(test)]
mod tests;
