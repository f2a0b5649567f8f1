//! Adaptive quadrature: cells of a clipped grid are divided where densities vary, until integrals are accurate enough.
//!
//! A density of a harmonic map is steep in a thin layer below the boundary and flat elsewhere, and a slender solid is
//! hardly more than that layer. So one cell size suits no solid. Here a cell and its eight parts each give an integral by
//! the centroid rule of [`clipped_grid`]. The rule is of second order, so that their difference says what error the parts
//! leave (Richardson 1911). Those parts are divided again whose error matters most (Dörfler 1996).
//!
//! Parts of a cell that the surface cuts are clipped anew, so that volumes stay exact and no point is outside.
//!
//! [`clipped_grid`]: super::clipped_grid

use std::collections::HashMap;
use std::ops::Range;

use super::clipped_grid::{CellPoints, GridClipper, GridResolution, base_grid, most_halvings};
use super::quadrature::{CellLayout, Grid, Quadrature, QuadratureError, sum};
use crate::Point;
use crate::mesh::SurfaceMesh;

/// Default limit on the number of points, as a multiple of those of the undivided grid.
const POINTS_FACTOR: usize = 32;
/// The default limit is never below this: an undivided grid has few points in a slender solid, where folds and steep
/// layers are as small as elsewhere. Evaluating a map so often takes about a second.
const LEAST_LIMIT: usize = 100_000;
/// Fewest points of the undivided grid: a difference between few cells says little about their error. On a cat, grids of 1
/// to 244 points were off by up to 1.4 times their estimate or had none, and those of 586 and more were not.
const FEWEST_POINTS: usize = 1000;
/// The error of the parts as a fraction of the difference between them and the whole: twice that of a rule of second
/// order, because densities are less than smooth near the edges of a boundary map that is linear over triangles.
const ERROR_OF_PARTS: f64 = 2.0 / 3.0;
/// What dividing once more leaves of an error, for a rule of second order.
const LEFT: f64 = 0.25;
/// Fraction of the error that a round aims to leave where the tolerance is further away.
const AIM: f64 = 0.4;

/// Settings of an [`adaptive_quadrature`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdaptiveOptions {
    /// The grid whose cells are divided. Where it has fewer than 1000 points, its cells are halved first.
    pub resolution: GridResolution,
    /// Largest error of each integral, as a fraction of it.
    pub tolerance: f64,
    /// Largest number of points; `None` for 32 times those of the undivided grid, and at least 100 000.
    pub max_points: Option<usize>,
}

impl Default for AdaptiveOptions {
    /// 48 cells along the longest side, and an accuracy of 1 %.
    fn default() -> Self {
        Self {
            resolution: GridResolution::CellsAlongLongestSide(48),
            tolerance: 0.01,
            max_points: None,
        }
    }
}

impl AdaptiveOptions {
    /// Largest number of points at which densities are evaluated, if the undivided grid has so many.
    pub fn point_limit(&self, undivided: usize) -> usize {
        self.max_points
            .unwrap_or(POINTS_FACTOR.saturating_mul(undivided).max(LEAST_LIMIT))
    }
}

/// Points and weights, with estimates of the errors that they leave.
#[derive(Debug, Clone, PartialEq)]
pub struct AdaptiveQuadrature {
    /// The points and weights. The cells are those of the undivided grid; a divided one has many points.
    pub quadrature: Quadrature,
    /// Where the densities at each point stand in the order in which they were asked for.
    pub rows: Vec<u32>,
    /// Estimated error of the integral of each density.
    pub errors: Vec<f64>,
    /// Whether all errors are within the tolerance. If not, there would have been too many points, or cells too small.
    pub is_converged: bool,
}

/// A cell with the part of the solid inside it.
#[derive(Clone)]
struct Cell {
    level: usize,
    index: u64,
    points: Range<usize>,
    /// The cell of the level above that it is a part of.
    whole: Option<usize>,
    /// The cells of the next level inside it; none if it is not divided.
    parts: Range<usize>,
}

/// Evaluates densities at points: a list for each density, with a value for each point.
type Densities<'a, E> = dyn FnMut(&[Point]) -> Result<Vec<Vec<f64>>, E> + 'a;

/// Cells of all levels. Those of level 0 are twice as large as those of the undivided grid, which is level 1.
#[derive(Clone)]
pub(super) struct Refinement<'a> {
    surface: &'a SurfaceMesh,
    grids: Vec<Grid>,
    /// How many densities there are.
    columns: usize,
    cells: Vec<Cell>,
    /// Integral of each density over each cell, a row for each cell.
    integrals: Vec<f64>,
    /// For each cell that is divided, the error that its parts leave, as [`Self::integrals`].
    errors: Vec<f64>,
    points: Vec<Point>,
    volumes: Vec<f64>,
}

/// Quadrature over the inside of a closed surface that integrates given densities to a relative tolerance.
///
/// `densities` is called several times, with points inside the solid. It returns a list for each density, with a value for
/// each point, and always for as many densities as `negligible` has entries. Where the error of an integral is at most its
/// entry, it counts as accurate, so that a density that is zero up to rounding is not pursued.
///
/// Where no cell is divided, this costs about 1.2 times as many evaluations as a [`clipped_grid`] of the same resolution.
///
/// # Errors
///
/// [`QuadratureError`] as for [`clipped_grid`], and what `densities` returns.
///
/// [`clipped_grid`]: super::clipped_grid()
pub fn adaptive_quadrature<E: From<QuadratureError>>(
    surface: &SurfaceMesh,
    options: &AdaptiveOptions,
    negligible: &[f64],
    densities: &mut impl FnMut(&[Point]) -> Result<Vec<Vec<f64>>, E>,
) -> Result<AdaptiveQuadrature, E> {
    let start = AdaptiveStart::new(surface, options)?;
    let values = densities(start.points())?;
    Ok(start.refined(negligible, &values, densities)?.0)
}

/// The grid whose cells an [`adaptive_quadrature`] divides, and the quadrature by its cells.
pub(crate) fn undivided_grid(
    surface: &SurfaceMesh,
    resolution: GridResolution,
) -> Result<(Grid, Quadrature), QuadratureError> {
    let mut grid = base_grid(surface, resolution)?;
    let mut undivided = GridClipper::new(surface, grid).quadrature()?;
    while undivided.points().len() < FEWEST_POINTS && most_halvings(&grid) > 2 {
        let Ok(finer) = base_grid(surface, GridResolution::CellSize(grid.cell_size / 2.0)) else {
            break;
        };
        grid = finer;
        undivided = GridClipper::new(surface, grid).quadrature()?;
    }
    Ok((grid, undivided))
}

/// The undivided grid, and the grid of twice its cell size: where every adaptive quadrature of a solid begins.
pub(super) struct AdaptiveStart<'a> {
    options: AdaptiveOptions,
    volume: f64,
    limit: usize,
    refinement: Refinement<'a>,
}

impl<'a> AdaptiveStart<'a> {
    pub(super) fn new(surface: &'a SurfaceMesh, options: &AdaptiveOptions) -> Result<Self, QuadratureError> {
        if options.tolerance.is_nan() || options.tolerance <= 0.0 {
            return Err(QuadratureError::Tolerance(options.tolerance));
        }
        let (grid, undivided) = undivided_grid(surface, options.resolution)?;
        Ok(Self {
            options: *options,
            volume: undivided.volume(),
            limit: options.point_limit(undivided.points().len()),
            refinement: Refinement::new(surface, grid, &undivided),
        })
    }

    /// Where densities are needed first.
    pub(super) fn points(&self) -> &[Point] {
        &self.refinement.points
    }

    /// Divides cells until the integrals are accurate; `values` are those at [`Self::points`]. Also returns the cells of
    /// all levels.
    pub(super) fn refined<E>(
        &self,
        negligible: &[f64],
        values: &[Vec<f64>],
        densities: &mut Densities<E>,
    ) -> Result<(AdaptiveQuadrature, Refinement<'a>), E> {
        let mut refinement = self.refinement.clone();
        refinement.begin(values);
        loop {
            let (totals, errors) = (refinement.totals(), refinement.total_errors());
            let allowed = totals.iter().zip(negligible);
            let tolerance = self.options.tolerance;
            let allowed: Vec<f64> = allowed.map(|(i, least)| (tolerance * i.abs()).max(*least)).collect();
            let is_converged = errors.iter().zip(&allowed).all(|(error, allowed)| error <= allowed);
            let marked = refinement.marked(&errors, &allowed, self.limit);
            if is_converged || !refinement.divide(&marked, densities)? {
                let (quadrature, rows) = refinement.leaves(self.volume);
                let adapted = AdaptiveQuadrature {
                    quadrature,
                    rows,
                    errors,
                    is_converged,
                };
                return Ok((adapted, refinement));
            }
        }
    }
}

impl<'a> Refinement<'a> {
    fn new(surface: &'a SurfaceMesh, grid: Grid, undivided: &Quadrature) -> Self {
        let double = Grid {
            origin: grid.origin,
            cell_size: 2.0 * grid.cell_size,
            dims: grid.dims.map(|count| count.div_ceil(2)),
        };
        let mut refinement = Self {
            surface,
            grids: vec![double, grid],
            columns: 0,
            cells: Vec::new(),
            integrals: Vec::new(),
            errors: Vec::new(),
            points: Vec::new(),
            volumes: Vec::new(),
        };
        refinement.add_cells(0, GridClipper::new(surface, double).all_cells());
        let parts = CellPoints {
            points: undivided.points().to_vec(),
            volumes: undivided.weights().to_vec(),
            cells: undivided.cells().iter().map(|&cell| cell.into()).collect(),
        };
        refinement.add_cells(1, parts);
        refinement
    }

    /// Integrates the densities with these values at the points over the first two levels.
    fn begin(&mut self, values: &[Vec<f64>]) {
        self.columns = values.len();
        self.integrate(0, values);
        let wholes = self.cells.partition_point(|cell| cell.level == 0);
        self.assign_parts(0..wholes, wholes..self.cells.len());
    }

    /// Divides the parts of cells once more; false when none can be.
    fn divide<E>(&mut self, marked: &[usize], densities: &mut Densities<E>) -> Result<bool, E> {
        let first = self.cells.len();
        let mut divided = Vec::new();
        for level in 1..=most_halvings(&self.grids[1]).min(self.grids.len() - 1) {
            let of_level = marked.iter().filter(|&&cell| self.cells[cell].level + 1 == level);
            let wholes: Vec<usize> = of_level.flat_map(|&cell| self.cells[cell].parts.clone()).collect();
            if wholes.is_empty() {
                continue;
            }
            let whole = self.grids[level];
            if level + 1 == self.grids.len() {
                self.grids.push(Grid {
                    origin: whole.origin,
                    cell_size: whole.cell_size / 2.0,
                    dims: whole.dims.map(|count| 2 * count),
                });
            }
            let steps = wholes.iter().map(|&cell| whole.steps_of(self.cells[cell].index));
            let clipper = GridClipper::new(self.surface, self.grids[level + 1]);
            let found = clipper.cells_inside(&steps.collect::<Vec<_>>());
            divided.push((wholes, self.add_cells(level + 1, found)));
        }
        if let Some(cell) = self.cells.get(first) {
            let values = densities(&self.points[cell.points.start..])?;
            self.integrate(first, &values);
        }
        for (wholes, parts) in divided {
            self.assign_parts(wholes, parts);
        }
        Ok(self.cells.len() > first)
    }

    /// Adds cells of a level, ordered by the cells of the level above that they are in; returns their numbers.
    fn add_cells(&mut self, level: usize, found: CellPoints) -> Range<usize> {
        let first = self.cells.len();
        let mut start = 0;
        let runs = found.cells.chunk_by(|a, b| a == b).map(|run| {
            start += run.len();
            (run[0], start - run.len()..start)
        });
        let mut runs: Vec<(u64, Range<usize>)> = runs.collect();
        if level > 0 {
            runs.sort_by_key(|&(index, _)| self.parent(level, index));
        }
        for (index, run) in runs {
            let start = self.points.len();
            self.points.extend(&found.points[run.clone()]);
            self.volumes.extend(&found.volumes[run]);
            self.cells.push(Cell {
                level,
                index,
                points: start..self.points.len(),
                whole: None,
                parts: 0..0,
            });
        }
        first..self.cells.len()
    }

    /// Index in the level above of the cell that contains a cell.
    fn parent(&self, level: usize, index: u64) -> u64 {
        let steps = self.grids[level].steps_of(index);
        self.grids[level - 1].index_of(steps.map(|step| step / 2))
    }

    /// Integrates densities over all cells from `first` on, from the values at their points.
    fn integrate(&mut self, first: usize, values: &[Vec<f64>]) {
        let start = self.cells.get(first).map_or(0, |cell| cell.points.start);
        for cell in &self.cells[first..] {
            let volumes = &self.volumes[cell.points.clone()];
            for column in values {
                let values = &column[cell.points.start - start..cell.points.end - start];
                self.integrals
                    .push(values.iter().zip(volumes).map(|(value, volume)| value * volume).sum());
            }
        }
        self.errors.resize(self.integrals.len(), 0.0);
    }

    /// Tells cells which parts they have, and how much the integrals over them differ. `parts` are ordered by the cells
    /// that they are in. A cell that is too small to have had points may have parts: these have no estimate of their
    /// error.
    fn assign_parts(&mut self, wholes: impl IntoIterator<Item = usize>, parts: Range<usize>) {
        let Some(level) = self.cells.get(parts.start).map(|cell| cell.level) else {
            return;
        };
        let mut wholes: Vec<usize> = wholes.into_iter().collect();
        wholes.sort_unstable_by_key(|&cell| self.cells[cell].index);
        let mut wholes = wholes.into_iter().peekable();
        let mut first = parts.start;
        while first < parts.end {
            let parent = self.parent(level, self.cells[first].index);
            let is_inside = |&part: &usize| self.parent(level, self.cells[part].index) == parent;
            let own = first..first + (first..parts.end).take_while(is_inside).count();
            first = own.end;
            while wholes.next_if(|&cell| self.cells[cell].index < parent).is_some() {}
            let Some(whole) = wholes.next_if(|&cell| self.cells[cell].index == parent) else {
                continue;
            };
            for column in 0..self.columns {
                let integral = |cell: usize| self.integrals[cell * self.columns + column];
                let difference = own.clone().map(integral).sum::<f64>() - integral(whole);
                self.errors[whole * self.columns + column] = ERROR_OF_PARTS * difference.abs();
            }
            self.cells[own.clone()]
                .iter_mut()
                .for_each(|part| part.whole = Some(whole));
            self.cells[whole].parts = own;
        }
    }

    /// The cells that are not divided, of which the solid consists.
    fn undivided(&self) -> impl Iterator<Item = usize> {
        (0..self.cells.len()).filter(|&cell| self.cells[cell].level > 0 && self.cells[cell].parts.is_empty())
    }

    /// The cells that are divided, but whose parts are not.
    fn divided_last(&self) -> impl Iterator<Item = usize> {
        let is_whole = |part: usize| self.cells[part].parts.is_empty();
        let divided = (0..self.cells.len()).filter(|&cell| !self.cells[cell].parts.is_empty());
        divided.filter(move |&cell| self.cells[cell].parts.clone().all(is_whole))
    }

    /// Integral of each density.
    fn totals(&self) -> Vec<f64> {
        let of_column = |column| {
            sum(self
                .undivided()
                .map(|cell| self.integrals[cell * self.columns + column]))
        };
        (0..self.columns).map(of_column).collect()
    }

    /// Estimated error of each integral.
    fn total_errors(&self) -> Vec<f64> {
        let of_column = |column| {
            sum(self
                .divided_last()
                .map(|cell| self.errors[cell * self.columns + column]))
        };
        (0..self.columns).map(of_column).collect()
    }

    /// How much of the volume may be on the other side of zero than the points say, as a fraction; `values` are those of a
    /// continuous function at all points that were asked for.
    ///
    /// The function is taken to vary over a part by as much as over the points of the cell that was divided into it: twice
    /// as much as a linear function would. Where its value is smaller than that, it may change sign on up to half of the
    /// part.
    pub(super) fn sign_error(&self, values: &[f64]) -> f64 {
        let is_leaf = |part: &usize| self.cells[*part].parts.is_empty();
        let mut doubtful = 0.0;
        for whole in self.cells.iter().filter(|cell| !cell.parts.is_empty()) {
            let parts = || whole.parts.clone();
            let of_parts = parts().flat_map(|part| self.cells[part].points.clone());
            let samples = whole.points.clone().chain(of_parts).map(|point| values[point]);
            let (low, high) = samples.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            });
            let variation = high - low;
            for point in parts().filter(is_leaf).flat_map(|part| self.cells[part].points.clone()) {
                let size = values[point].abs();
                if size < variation {
                    doubtful += 0.5 * (1.0 - size / variation) * self.volumes[point];
                }
            }
        }
        let points = self.undivided().flat_map(|cell| self.cells[cell].points.clone());
        doubtful / sum(points.map(|point| self.volumes[point]))
    }

    /// The cells whose parts are to be divided: for each density as few as leave little more than the allowed error, and
    /// no more than the limit of points has room for.
    fn marked(&self, errors: &[f64], allowed: &[f64], limit: usize) -> Vec<usize> {
        let candidates: Vec<usize> = self.divided_last().collect();
        let mut urgency = vec![0.0_f64; self.cells.len()];
        for column in 0..self.columns {
            let error = |cell: usize| self.errors[cell * self.columns + column];
            let aim = allowed[column].max(AIM * errors[column]);
            let mut order = candidates.clone();
            order.sort_by(|&a, &b| error(b).total_cmp(&error(a)));
            let mut left = errors[column];
            for cell in order {
                if left <= aim || errors[column] <= allowed[column] {
                    break;
                }
                left -= (1.0 - LEFT) * error(cell);
                urgency[cell] = urgency[cell].max(error(cell) / allowed[column]);
            }
        }
        self.spread(&candidates, &mut urgency);
        let mut marked = candidates;
        marked.retain(|&cell| urgency[cell] > 0.0);
        marked.sort_by(|&a, &b| urgency[b].total_cmp(&urgency[a]));
        let mut room = limit.saturating_sub(self.points.len());
        marked.retain(|&cell| {
            let parts = self.cells[cell].parts.clone();
            let needed = 8 * parts.map(|part| self.cells[part].points.len()).sum::<usize>();
            let fits = needed <= room;
            room = room.saturating_sub(needed);
            fits
        });
        marked
    }

    /// Extends what is urgent to neighbours whose parts would be four times as large: a steep density is not flat beyond
    /// the next face, though the points there may have missed it.
    fn spread(&self, candidates: &[usize], urgency: &mut [f64]) {
        let key = |cell: usize| (self.cells[cell].level, self.cells[cell].index);
        let undivided: HashMap<(usize, u64), usize> = self.undivided().map(|cell| (key(cell), cell)).collect();
        for &cell in candidates
            .iter()
            .filter(|&&cell| urgency[cell] > 0.0)
            .collect::<Vec<_>>()
        {
            let Cell { level, index, .. } = self.cells[cell];
            let grid = self.grids[level];
            let steps = grid.steps_of(index);
            for axis in 0..3 {
                for step in [steps[axis].wrapping_sub(1), steps[axis] + 1] {
                    let mut next = steps;
                    next[axis] = step;
                    let is_inside = step < grid.dims[axis];
                    let neighbour = is_inside
                        .then(|| undivided.get(&(level, grid.index_of(next))))
                        .flatten();
                    if let Some(whole) = neighbour.and_then(|&neighbour| self.cells[neighbour].whole) {
                        urgency[whole] = urgency[whole].max(urgency[cell]);
                    }
                }
            }
        }
    }

    /// The quadrature by all cells that are not divided, and where its points stand among all points.
    fn leaves(&self, volume: f64) -> (Quadrature, Vec<u32>) {
        let undivided = self.grids[1];
        let base = |cell: usize| {
            let Cell { level, index, .. } = self.cells[cell];
            undivided.index_of(self.grids[level].steps_of(index).map(|step| step >> (level - 1)))
        };
        let mut leaves: Vec<(u64, usize)> = self.undivided().map(|cell| (base(cell), cell)).collect();
        leaves.sort_unstable();
        let mut rows = Vec::new();
        let mut cells = Vec::new();
        for (base, leaf) in leaves {
            let points = self.cells[leaf].points.clone();
            cells.extend(points.clone().map(|_| base as u32));
            rows.extend(points.map(|point| point as u32));
        }
        let kept = sum(rows.iter().map(|&row| self.volumes[row as usize]));
        let scale = volume / kept;
        let quadrature = Quadrature::new(
            rows.iter().map(|&row| self.points[row as usize]).collect(),
            rows.iter().map(|&row| self.volumes[row as usize] * scale).collect(),
            cells,
            CellLayout::Grid(undivided),
        );
        (quadrature, rows)
    }
}

#[cfg(test)]
mod tests;
