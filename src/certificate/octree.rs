//! The octree, built from the whole box down, with an expansion of the map in each cell.
//!
//! A source at distance `d` from the centre of a cell with circumradius `r` is absorbed into the cell's expansion once
//! `q = r / d` is small. The expansion to degree `p` omits at most this of its gradient,
//!
//! ```text
//! |w| / (4π d²) Σ_{n > p} n qⁿ⁻¹ = |w| / (4π d²) q^p (p + 1 − p q) / (1 − q)²
//! ```
//!
//! anywhere in the ball around the cell. The balls of its children lie in that ball, and polynomials are expanded about
//! other centres exactly, so that the bound holds for the children too: each source is absorbed once. Sources that are
//! not absorbed are passed to the children; to test a cell, they are expanded as well as far as the expansion
//! converges.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::bounds::{JacobianTest, RegularityBounds, size_at_centre, test_cell};
use super::harmonics::{Batch, LANES, ORDER, TERMS, harmonics, translation};
use super::volume::{CellClipper, InsidePart};
use crate::map::HarmonicMap;
use crate::{Point, Vector};

/// Largest `q` of sources that are absorbed.
const ABSORBED: f64 = 0.3;
/// Largest `q` of sources that are expanded to test a cell. Beyond it the remainder is far too large.
const EXPANDED: f64 = 0.75;
/// At most this many cells per task, divided together so that translations are matrix products.
const MAX_CELLS_PER_TASK: usize = 16;
/// At least this many tasks per level, if it has as many cells.
const TASKS: usize = 64;
/// Half the spacing of floating-point numbers above 1.
const UNIT_ROUNDOFF: f64 = f64::EPSILON / 2.0;
/// Rounding errors of a term in a coefficient, besides those of the sum over sources: some hundred in the recurrences
/// of the harmonics, and 3 `TERMS` in each of up to 20 translations, each relative to a bound of all terms.
const ROUNDINGS_OF_A_TERM: f64 = 16_384.0;
/// Rounding errors of the positions of source and centre, in units of the roundoff, times their amplification in the
/// gradient.
const SHIFTS: f64 = 16.0;

/// The position of a cell: `steps` cells of its level from the lowest corner of the box. The default is the whole box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct CellIndex {
    pub(super) level: u8,
    pub(super) steps: [u32; 3],
}

impl CellIndex {
    fn child(&self, octant: usize) -> Self {
        Self {
            level: self.level + 1,
            steps: std::array::from_fn(|k| 2 * self.steps[k] + (octant >> k & 1) as u32),
        }
    }
}

/// A cell that may be divided.
pub(super) struct OpenCell {
    index: CellIndex,
    /// Volume inside the domain, in cubes of the box's side.
    pub(super) volume: f64,
    triangles: Vec<u32>,
    /// Coefficients of the three coordinates, in units of the circumradius.
    expansion: Vec<f64>,
    /// Sources that are not in the expansion.
    sources: Vec<u32>,
    /// Bound of the spectral norm of what the expansion omits of the Jacobian.
    remainder: f64,
    /// Sum of the norms of all terms of the Jacobian, to which rounding errors are relative.
    magnitude: f64,
}

/// A cell that is not divided further.
pub(super) struct ClosedCell {
    pub(super) index: CellIndex,
    pub(super) volume: f64,
    /// The determinant at the centre and lower bounds, if the sign is proved.
    pub(super) found: Option<(f64, RegularityBounds)>,
}

/// Cells that are not divided further, and cells that may be.
#[derive(Default)]
pub(super) struct Subdivision {
    pub(super) closed: Vec<ClosedCell>,
    pub(super) open: Vec<OpenCell>,
}

impl Subdivision {
    pub(super) fn of(cell: OpenCell) -> Self {
        Self {
            closed: Vec::new(),
            open: vec![cell],
        }
    }

    /// Closes all open cells.
    pub(super) fn close_all(&mut self) {
        self.closed.extend(self.open.drain(..).map(ClosedCell::from));
        self.open.shrink_to_fit();
    }

    pub(super) fn append(&mut self, mut other: Self) {
        self.closed.append(&mut other.closed);
        self.open.append(&mut other.open);
    }
}

impl From<OpenCell> for ClosedCell {
    /// An undecided cell.
    fn from(cell: OpenCell) -> Self {
        Self {
            index: cell.index,
            volume: cell.volume,
            found: None,
        }
    }
}

/// What all cells of the octree share.
pub(super) struct OctreeBuilder {
    low: Point,
    pub(super) side: f64,
    clipper: CellClipper,
    /// Positions of the sources relative to the lowest corner: domains far from the origin lose no accuracy.
    positions: Vec<Vector>,
    /// Coefficients over 4π, and their norms.
    weights: Vec<[f64; 4]>,
    translations: Vec<Vec<f64>>,
    rounding: f64,
}

impl OctreeBuilder {
    /// For the cube with this lowest corner and side.
    pub(super) fn new(map: &HarmonicMap, clipper: CellClipper, low: Point, side: f64) -> Self {
        let weight = |w: &[f64; 3]| {
            let [x, y, z] = w.map(|w| w / (4.0 * std::f64::consts::PI));
            [x, y, z, Vector::new(x, y, z).norm()]
        };
        // A child's centre is a quarter of the side away along each axis, here in units of the parent's circumradius.
        let quarter = 0.5 / 3f64.sqrt();
        let translations = (0..8).into_par_iter().map(|octant: usize| {
            let offset = Vector::from_fn(|k, _| if octant >> k & 1 == 1 { quarter } else { -quarter });
            translation(&offset, 0.5)
        });
        Self {
            low,
            side,
            clipper,
            positions: map.sources().iter().map(|p| p - low).collect(),
            weights: map.coefficients().sources.iter().map(weight).collect(),
            translations: translations.collect(),
            rounding: UNIT_ROUNDOFF * (map.sources().len() as f64 + ROUNDINGS_OF_A_TERM),
        }
    }

    /// The whole box, with the affine part of the map.
    pub(super) fn root(&self, map: &HarmonicMap) -> OpenCell {
        let index = CellIndex::default();
        let (_, radius) = self.ball(&index);
        let mut expansion = vec![0.0; 3 * TERMS];
        for (coordinate, terms) in expansion.chunks_mut(TERMS).enumerate() {
            // The harmonics of degree 1 are z, x, y.
            for (term, axis) in [2, 0, 1].into_iter().enumerate() {
                terms[term] = map.coefficients().affine[axis + 1][coordinate] * radius;
            }
        }
        let all: Vec<u32> = (0..self.positions.len() as u32).collect();
        let magnitude = size_at_centre(&expansion) / radius;
        let inside_part = self.inside_part(&index, &self.clipper.triangles());
        self.absorbed(index, inside_part, expansion, &all, [0.0, magnitude])
    }

    /// Lowest corner and side of a cell.
    pub(super) fn cube(&self, index: &CellIndex) -> (Point, f64) {
        let side = self.side / 2f64.powi(index.level.into());
        (self.low + Vector::from(index.steps.map(f64::from)) * side, side)
    }

    /// Centre relative to the lowest corner of the box, and circumradius.
    fn ball(&self, index: &CellIndex) -> (Vector, f64) {
        let side = self.side / 2f64.powi(index.level.into());
        let centre = index.steps.map(|step| (f64::from(step) + 0.5) * side);
        (Vector::from(centre), 0.5 * 3f64.sqrt() * side)
    }

    /// The children of cells of one level that intersect the domain, in order. All are closed if they are the `last`.
    pub(super) fn divide(&self, cells: &[OpenCell], last: bool) -> Subdivision {
        // Where cells are few, each has many sources, and one is enough for a task. Tasks do not depend on the number
        // of threads.
        let task = (cells.len() / TASKS).clamp(1, MAX_CELLS_PER_TASK);
        let tasks: Vec<Subdivision> = cells
            .par_chunks(task)
            .map(|cells| self.divide_task(cells, last))
            .collect();
        let mut parts = Subdivision::default();
        tasks.into_iter().for_each(|task| parts.append(task));
        parts
    }

    fn divide_task(&self, cells: &[OpenCell], last: bool) -> Subdivision {
        let expansions: Vec<f64> = cells.iter().flat_map(|cell| &cell.expansion).copied().collect();
        let translated: Vec<Vec<f64>> = self.translations.iter().map(|t| translated(t, &expansions)).collect();
        let mut parts = Subdivision::default();
        for (i, parent) in cells.iter().enumerate() {
            for (octant, translated) in translated.iter().enumerate() {
                let index = parent.index.child(octant);
                let inside_part = self.inside_part(&index, &parent.triangles);
                if inside_part.is_empty() {
                    continue;
                }
                let expansion = translated[3 * TERMS * i..][..3 * TERMS].to_vec();
                let inherited = [parent.remainder, parent.magnitude];
                let cell = self.absorbed(index, inside_part, expansion, &parent.sources, inherited);
                match self.test(&cell) {
                    Some(JacobianTest { det, regular }) if regular.is_some() || last => parts.closed.push(ClosedCell {
                        found: regular.map(|regular| (det, regular)),
                        ..cell.into()
                    }),
                    None if last => parts.closed.push(cell.into()),
                    _ => parts.open.push(cell),
                }
            }
        }
        parts
    }

    /// The part of a cell inside the domain, from the triangles of its parent; without any the cell is inside as a
    /// whole.
    fn inside_part(&self, index: &CellIndex, triangles: &[u32]) -> InsidePart {
        let side = 0.5f64.powi(index.level.into());
        let low = Point::from(Vector::from(index.steps.map(f64::from)) * side);
        if triangles.is_empty() {
            return InsidePart::whole();
        }
        self.clipper.inside_part(&low, side, triangles)
    }

    /// A cell with this expansion, after absorbing those of `sources` that are far enough. Remainder and magnitude are
    /// those of the expansion so far.
    fn absorbed(
        &self,
        index: CellIndex,
        inside_part: InsidePart,
        mut expansion: Vec<f64>,
        sources: &[u32],
        [remainder, magnitude]: [f64; 2],
    ) -> OpenCell {
        let (centre, radius) = self.ball(&index);
        let nearest = radius / ABSORBED;
        let is_far = |s: &&u32| (self.positions[**s as usize] - centre).norm_squared() >= nearest * nearest;
        let (far, near): (Vec<u32>, Vec<u32>) = sources.iter().partition(is_far);
        let [further, larger] = self.remainder_and_magnitude(&far, &centre, radius);
        self.expand(&far, &centre, radius, &mut expansion);
        OpenCell {
            index,
            volume: inside_part.fraction * 0.125f64.powi(index.level.into()),
            triangles: inside_part.triangles,
            expansion,
            sources: near,
            remainder: remainder + further,
            magnitude: magnitude + larger,
        }
    }

    /// Tests a cell; `None` if it is too large for its nearest sources.
    fn test(&self, cell: &OpenCell) -> Option<JacobianTest> {
        let (centre, radius) = self.ball(&cell.index);
        let nearest = radius / EXPANDED;
        let is_near = |&s: &u32| (self.positions[s as usize] - centre).norm_squared() < nearest * nearest;
        if cell.sources.iter().any(is_near) {
            return None;
        }
        let [remainder, magnitude] = self.remainder_and_magnitude(&cell.sources, &centre, radius);
        let remainder = cell.remainder + remainder + self.rounding * (cell.magnitude + magnitude);
        let mut expansion = cell.expansion.clone();
        self.expand(&cell.sources, &centre, radius, &mut expansion);
        // Back from units of the circumradius.
        Some(test_cell(&expansion, remainder * radius).scaled(1.0 / radius))
    }

    /// Bounds of what the expansion of these sources omits of the Jacobian, and of the sum of its terms' norms.
    fn remainder_and_magnitude(&self, sources: &[u32], centre: &Vector, radius: f64) -> [f64; 2] {
        let p = ORDER as f64;
        let (mut remainder, mut magnitude) = (0.0, 0.0);
        for &s in sources {
            let position = &self.positions[s as usize];
            let squared = (position - centre).norm_squared();
            let distance = squared.sqrt();
            let q = radius / distance;
            let all = self.weights[s as usize][3] / (squared * (1.0 - q) * (1.0 - q));
            // Positions have rounding errors relative to their size, and gradients four times that over the distance.
            let shifted = SHIFTS * (position.norm() + self.side) / distance;
            magnitude += all * (1.0 + shifted * UNIT_ROUNDOFF / self.rounding);
            remainder += all * q.powi(ORDER as i32) * (p + 1.0 - p * q);
        }
        [remainder, magnitude]
    }

    /// Adds these sources to an expansion.
    fn expand(&self, sources: &[u32], centre: &Vector, radius: f64, expansion: &mut [f64]) {
        if sources.is_empty() {
            return;
        }
        let mut sums = Box::new([[[0.0; LANES]; 3]; TERMS]);
        for sources in sources.chunks(LANES) {
            let mut inverted = [[0.0; LANES]; 3];
            let mut weights = [[0.0; LANES]; 3];
            for (lane, &s) in sources.iter().enumerate() {
                let away = (self.positions[s as usize] - centre) / radius;
                let squared = away.norm_squared();
                let scale = 1.0 / (radius * squared.sqrt());
                for k in 0..3 {
                    inverted[k][lane] = away[k] / squared;
                    weights[k][lane] = self.weights[s as usize][k] * scale;
                }
            }
            add_products(&inverted, &weights, &mut sums);
        }
        for (coordinate, terms) in expansion.chunks_mut(TERMS).enumerate() {
            for (term, sums) in terms.iter_mut().zip(sums.iter()) {
                *term += sums[coordinate].iter().sum::<f64>();
            }
        }
    }
}

/// The expansions about the centre of a child.
fn translated(translation: &[f64], expansions: &[f64]) -> Vec<f64> {
    let columns = expansions.len() / TERMS;
    let mut children = vec![0.0; expansions.len()];
    matmul(
        MatMut::from_column_major_slice_mut(&mut children, TERMS, columns),
        Accum::Replace,
        MatRef::from_column_major_slice(translation, TERMS, TERMS),
        MatRef::from_column_major_slice(expansions, TERMS, columns),
        1.0,
        Par::Seq,
    );
    children
}

fn add_products(points: &[Batch; 3], weights: &[Batch; 3], sums: &mut [[Batch; 3]; TERMS]) {
    let mut values = [[0.0; LANES]; TERMS];
    harmonics(points, &mut values);
    for (value, sums) in values.iter().zip(sums) {
        for (weight, sum) in weights.iter().zip(sums) {
            for l in 0..LANES {
                sum[l] += weight[l] * value[l];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::Matrix3;
    use crate::map::VolumeMap;
    use crate::mesh::shapes;
    use crate::solver::Coefficients;

    /// A map of the cube of side 1 about the origin, with sources from near its boundary to far away.
    fn random_map(sources: usize, rng: &mut StdRng) -> HarmonicMap {
        let mut positions = Vec::new();
        while positions.len() < sources {
            let p = Point::from(Vector::from_fn(|_, _| rng.random_range(-1.5..1.5)));
            if p.coords.amax() > 0.55 {
                positions.push(p);
            }
        }
        let weights = (0..sources)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect();
        let affine = std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        let coefficients = Coefficients {
            sources: weights,
            affine,
        };
        HarmonicMap::new(positions, coefficients).unwrap()
    }

    /// The Jacobian of an expansion, by central differences of the harmonics: they err by `h²` times third derivatives.
    fn jacobian(expansion: &[f64], x: &Vector) -> Matrix3 {
        let step = 1e-4;
        let values = |p: Vector| {
            let mut out = [[0.0; LANES]; TERMS];
            harmonics(&[[p.x; LANES], [p.y; LANES], [p.z; LANES]], &mut out);
            Vector::from_fn(|i, _| (0..TERMS).map(|t| expansion[i * TERMS + t] * out[t][0]).sum())
        };
        let column = |axis| (values(x + Vector::ith(axis, step)) - values(x - Vector::ith(axis, step))) / (2.0 * step);
        Matrix3::from_columns(&[column(0), column(1), column(2)])
    }

    fn largest_error(map: &HarmonicMap, builder: &OctreeBuilder, cell: &OpenCell, rng: &mut StdRng) -> f64 {
        let (centre, radius) = builder.ball(&cell.index);
        let centre = builder.low + centre;
        // Only what is in the expansion is compared.
        let kept: Vec<usize> = (0..map.sources().len())
            .filter(|&s| !cell.sources.contains(&(s as u32)))
            .collect();
        let coefficients = Coefficients {
            sources: kept.iter().map(|&s| map.coefficients().sources[s]).collect(),
            affine: map.coefficients().affine,
        };
        let absorbed = HarmonicMap::new(kept.iter().map(|&s| map.sources()[s]).collect(), coefficients).unwrap();
        let mut directions: Vec<Vector> = (0..200)
            .map(|_| Vector::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize())
            .collect();
        directions.extend(kept.iter().map(|&s| (map.sources()[s] - centre).normalize()));
        let points: Vec<Point> = directions.iter().map(|x| centre + x * radius).collect();
        let errors = directions.iter().zip(absorbed.jacobian(&points)).map(|(x, exact)| {
            let found = jacobian(&cell.expansion, x) / radius;
            (exact - found).singular_values().max()
        });
        errors.fold(0.0, f64::max)
    }

    /// Over four levels, with many sources of random signs: the bound is a sum of absolute values, and so too large by
    /// what cancels. With one source it is sharp where that was just absorbed.
    #[test]
    fn remainders_bound_what_expansions_leave_out() {
        let mut rng = StdRng::seed_from_u64(9);
        let domain = shapes::cube(1.0, 1);
        let (low, side) = (Point::new(-0.5, -0.5, -0.5), 1.0);
        for (sources, factor) in [(1, 1.5), (60, 8.0)] {
            let map = random_map(sources, &mut rng);
            let builder = OctreeBuilder::new(&map, CellClipper::new(&domain, &low, side), low, side);
            let mut cells = vec![builder.root(&map)];
            let mut closest = f64::INFINITY;
            for _ in 0..4 {
                for cell in cells.iter().step_by(cells.len().div_ceil(20)) {
                    let error = largest_error(&map, &builder, cell, &mut rng);
                    // Central differences err by 1e-8 of third derivatives, the sums of the map by 1e-9.
                    assert!(
                        error <= cell.remainder + 3e-7 * cell.magnitude,
                        "{error:e} > {:e}",
                        cell.remainder
                    );
                    if cell.remainder > 0.0 {
                        closest = closest.min(cell.remainder / error);
                    }
                }
                cells = cells
                    .iter()
                    .flat_map(|cell| {
                        let translated: Vec<_> = builder
                            .translations
                            .iter()
                            .map(|t| translated(t, &cell.expansion))
                            .collect();
                        let children = translated.into_iter().enumerate().map(|(octant, expansion)| {
                            let inherited = [cell.remainder, cell.magnitude];
                            let index = cell.index.child(octant);
                            builder.absorbed(index, InsidePart::whole(), expansion, &cell.sources, inherited)
                        });
                        children.collect::<Vec<_>>()
                    })
                    .collect();
            }
            assert!(closest < factor, "the bound is at least {closest} times too large");
        }
    }
}
