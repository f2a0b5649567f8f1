//! The foldover-free energy of Garanzha, Kaporin, Kudryavtseva, Protais, Ray, Sokolov,
//! *Foldover-free maps in 50 lines of code*, ACM Transactions on Graphics 40 (2021), and its gradient.
//!
//! The energy of a linear map with Jacobian `J` and determinant `d` is `|J|² / χ^(2/3) + λ (d² + 1) / χ`, where `χ = (d
//! + √(ε² + d²)) / 2` is positive also for inverted cells, and tends to `d` or 0 as `ε` tends to 0. The energy is
//! finite for inverted cells, and grows without bound as `ε` decreases: minimising it for decreasing `ε` repairs them.

use std::sync::LazyLock;

use rayon::prelude::*;

use super::hex_corners::{CornerPenalty, HexCorners};
use super::lbfgs::DescentEnergy;
use super::quality::{HEX_AXES, HEX_CORNERS, is_positive, lesser, tet_scaled_jacobians, trilinear_gradients};
use super::tet_lanes::{TetEnergies, TetLanes};
use crate::simd::Instructions;
use crate::{Matrix3, Point, Vector};

/// The energy of a mesh. Each cell is a linear map of a reference shape, each hexahedron eight of them, one per corner.
#[derive(Debug)]
pub(crate) struct FoldoverEnergy {
    cells: ReferenceCells,
    /// Corners of cells at each node: those at node `v` are `uses[starts[v]..starts[v + 1]]`, each the index of a cell
    /// times its number of corners plus the corner.
    starts: Vec<u32>,
    uses: Vec<u32>,
}

#[derive(Debug)]
enum ReferenceCells {
    /// With reference edges scaled so that the mean determinant of all maps is 1, and weights of sum 1.
    Tets(TetLanes),
    /// Corners of hexahedra, relative to those of boxes.
    Hexes {
        corners: Vec<[u32; 8]>,
        /// One over the edge lengths of each box, along the axes of [`HEX_AXES`].
        scales: Vec<[f64; 3]>,
        /// Which hexahedra are evaluated inside too; empty for none.
        inside: Vec<bool>,
        /// What corners below a scaled Jacobian cost in addition.
        penalty: Option<CornerPenalty>,
    },
}

/// Weight of the determinant term relative to the shape term.
pub(super) const LAMBDA: f64 = 1.0;
/// Scaled Jacobian below which a tetrahedron is not used as a reference: far below that of cells that are thin on
/// purpose.
pub(super) const SLIVER: f64 = 2e-3;
/// Cells per task, a multiple of the lanes.
const RUN: usize = 2048;

/// The energy, the least determinant and how many are not positive.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EnergyValue {
    pub energy: f64,
    /// Least determinant, NaN if one is.
    pub least: f64,
    /// Determinants that are not positive.
    pub inverted: usize,
    /// Cells with such a determinant.
    pub inverted_cells: usize,
}

impl FoldoverEnergy {
    /// Tetrahedra relative to those between the nodes `reference` or, where these are slivers or inverted, relative to
    /// regular ones of the mean volume. `volume` is the sum of the signed volumes of the image.
    pub fn of_tets(tets: &[[u32; 4]], reference: &[Point], volume: f64) -> Self {
        let mut shapes: Vec<Matrix3> = tets
            .par_iter()
            .map(|t| edges(t.map(|v| reference[v as usize])))
            .collect();
        // The inverse of a sliver would be too large for any mesh to follow; an inverted reference would ask for
        // inversion.
        let quality = tet_scaled_jacobians(tets, reference);
        let sound = |t: usize| quality[t] > SLIVER;
        let volumes = shapes.iter().enumerate().filter(|(t, _)| sound(*t));
        let volumes: Vec<f64> = volumes.map(|(_, e)| e.determinant() / 6.0).collect();
        let mean = volumes.iter().sum::<f64>() / volumes.len().max(1) as f64;
        let regular = regular_edges() * length_or_one(mean.cbrt());
        let slivers = shapes.iter_mut().enumerate().filter(|(t, _)| !sound(*t));
        slivers.for_each(|(_, e)| *e = regular);
        let volumes: Vec<f64> = shapes.iter().map(|e| e.determinant().abs() / 6.0).collect();
        let total: f64 = volumes.iter().sum();
        // Scales the reference to the volume of the image.
        let scale = length_or_one((volume.abs() / total).cbrt());
        let inverse = |e: &Matrix3| e.try_inverse().unwrap_or_else(Matrix3::identity) / scale;
        let rest = shapes.iter().map(inverse).collect();
        let weights = volumes.iter().map(|v| v / total).collect();
        Self::of_weighted_tets(tets.to_vec(), rest, weights, reference.len())
    }

    /// Hexahedra relative to cubes, over `nodes` nodes.
    pub fn of_hexes(hexes: &[[u32; 8]], nodes: usize, volume: f64) -> Self {
        let side = length_or_one((volume.abs() / hexes.len() as f64).cbrt());
        Self::new(
            ReferenceCells::Hexes {
                corners: hexes.to_vec(),
                scales: vec![[side.recip(); 3]; hexes.len()],
                inside: vec![],
                penalty: None,
            },
            nodes,
        )
    }

    /// Tetrahedra that count the same, over `nodes` nodes; `rest` are the inverse matrices of the reference edges.
    pub fn of_tets_with(tets: Vec<[u32; 4]>, rest: Vec<Matrix3>, nodes: usize) -> Self {
        let weights = vec![1.0 / tets.len().max(1) as f64; tets.len()];
        Self::of_weighted_tets(tets, rest, weights, nodes)
    }

    /// Tetrahedra with these weights, over `nodes` nodes; `rest` are the inverse matrices of the reference edges.
    pub fn of_weighted_tets(corners: Vec<[u32; 4]>, rest: Vec<Matrix3>, weights: Vec<f64>, nodes: usize) -> Self {
        Self::new(ReferenceCells::Tets(TetLanes::new(corners, &rest, &weights)), nodes)
    }

    /// Hexahedra relative to boxes of these edge lengths, over `nodes` nodes.
    pub fn of_hexes_with(hexes: Vec<[u32; 8]>, lengths: &[[f64; 3]], nodes: usize) -> Self {
        Self::new(
            ReferenceCells::Hexes {
                corners: hexes,
                scales: lengths.iter().map(|box_| box_.map(f64::recip)).collect(),
                inside: vec![],
                penalty: None,
            },
            nodes,
        )
    }

    fn new(cells: ReferenceCells, nodes: usize) -> Self {
        let flat = cells.flat();
        let mut starts = vec![0u32; nodes + 1];
        for v in flat {
            starts[*v as usize + 1] += 1;
        }
        for v in 0..nodes {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut uses = vec![0; flat.len()];
        for (i, v) in flat.iter().enumerate() {
            let slot = &mut next[*v as usize];
            uses[*slot as usize] = i as u32;
            *slot += 1;
        }
        Self { cells, starts, uses }
    }

    /// Determinants of all maps, 1 in the mean.
    pub fn determinants(&self, x: &[Point]) -> Vec<f64> {
        match &self.cells {
            ReferenceCells::Tets(tets) => (0..tets.corners.len())
                .into_par_iter()
                .map(|t| tets.jacobian(t, x).determinant())
                .collect(),
            ReferenceCells::Hexes { corners, scales, .. } => corners
                .par_iter()
                .zip(scales)
                .flat_map_iter(|(h, [a, b, c])| {
                    HEX_CORNERS.map(|corner| edges(corner.map(|k| x[h[k] as usize])).determinant() * (a * b * c))
                })
                .collect(),
        }
    }

    /// From now on the energy is evaluated inside these hexahedra too: at the midpoints of their edges and faces, and
    /// at the centre. A trilinear map with positive corners need not be positive inside.
    pub fn check_inside(&mut self, cells: &[u32]) {
        if let ReferenceCells::Hexes { corners, inside, .. } = &mut self.cells {
            inside.resize(corners.len(), false);
            cells.iter().for_each(|&c| inside[c as usize] = true);
        }
    }

    /// From now on corners of hexahedra with a low scaled Jacobian cost more; nothing for tetrahedra.
    pub fn penalize(&mut self, corners: CornerPenalty) {
        if let ReferenceCells::Hexes { penalty, .. } = &mut self.cells {
            *penalty = Some(corners);
        }
    }

    /// Cells with a determinant that is not positive, ascending.
    pub fn inverted(&self, x: &[Point]) -> Vec<u32> {
        let dets = self.determinants(x);
        let per_cell = dets.len() / (self.uses.len() / self.cells.corners()).max(1);
        let bad = dets.chunks(per_cell.max(1)).enumerate();
        bad.filter(|(_, dets)| !dets.iter().all(|d| is_positive(*d)))
            .map(|(cell, _)| cell as u32)
            .collect()
    }

    /// The cells at these nodes, ascending.
    pub fn cells_at(&self, nodes: &[u32]) -> Vec<u32> {
        let corners = self.cells.corners() as u32;
        let around = nodes.iter().flat_map(|&v| {
            let uses = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
            self.uses[uses].iter().map(|use_| use_ / corners)
        });
        sorted_unique(around.collect())
    }

    /// Nodes of cells and of `rings` rings of cells around them, ascending.
    pub fn rings(&self, cells: &[u32], rings: usize) -> Vec<u32> {
        let (flat, corners) = (self.cells.flat(), self.cells.corners());
        let nodes = |cells: &[u32]| -> Vec<u32> {
            let of_cell = |&c: &u32| flat[c as usize * corners..(c as usize + 1) * corners].iter().copied();
            sorted_unique(cells.iter().flat_map(of_cell).collect())
        };
        let mut found = nodes(cells);
        for _ in 0..rings {
            found = nodes(&self.cells_at(&found));
        }
        found
    }
}

impl DescentEnergy for FoldoverEnergy {
    fn evaluate(
        &self,
        x: &[Point],
        epsilon: f64,
        free: &[u32],
        parts: &mut Vec<Vector>,
        gradient: &mut [Vector],
    ) -> EnergyValue {
        parts.resize(self.uses.len(), Vector::zeros());
        let per_run = RUN * self.cells.corners();
        let sum_at = |parts: &[Vector], (gradient, v): (&mut Vector, &u32)| {
            let range = self.starts[*v as usize] as usize..self.starts[*v as usize + 1] as usize;
            let mut sum = Vector::zeros();
            self.uses[range].iter().for_each(|&i| sum += parts[i as usize]);
            *gradient = sum;
        };
        if parts.len() <= per_run {
            // To share out so little takes longer than it does.
            let value = self.cells.evaluate(0, x, epsilon, parts);
            gradient.iter_mut().zip(free).for_each(|node| sum_at(parts, node));
            return value;
        }
        // Runs of fixed length, added in order: the result does not depend on the number of threads.
        let values: Vec<EnergyValue> = parts
            .par_chunks_mut(per_run)
            .enumerate()
            .map(|(run, parts)| self.cells.evaluate(run * RUN, x, epsilon, parts))
            .collect();
        let nodes = gradient.par_iter_mut().zip(free).with_min_len(512);
        nodes.for_each(|node| sum_at(parts, node));
        let mut sum = EnergyValue::NONE;
        for value in values {
            sum.energy += value.energy;
            sum.inverted += value.inverted;
            sum.inverted_cells += value.inverted_cells;
            sum.add_determinant(value.least);
        }
        sum
    }

    /// Without the curvature of `χ`: the energy is convex in the Jacobian, `d` and `χ` together, so that the blocks are
    /// positive semi-definite. Of hexahedra only their corners count.
    fn diagonal_blocks(&self, x: &[Point], epsilon: f64, free: &[u32]) -> Vec<Matrix3> {
        let per_cell = self.cells.corners();
        let block = |&v: &u32| {
            let uses = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
            let of_use = |&use_: &u32| {
                self.cells
                    .block(use_ as usize / per_cell, use_ as usize % per_cell, x, epsilon)
            };
            self.uses[uses].iter().map(of_use).sum()
        };
        free.par_iter().with_min_len(512).map(block).collect()
    }
}

/// The Hessian of the energy of a Jacobian `J + u sᵀ` with respect to `u`, without the curvature of `χ`.
fn block_of_jacobian(jacobian: &Matrix3, slope: &Vector, epsilon: f64) -> Matrix3 {
    let [a, b, c] = [0, 1, 2].map(|k| jacobian.column(k).into_owned());
    let cofactors = Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)]);
    let det = a.dot(&cofactors.column(0));
    let (chi, chi_slope) = chi(det, epsilon);
    let shape = cube_root(chi).powi(-2);
    // Derivatives with respect to u: of d, of χ, and of half of |J|².
    let by_det = cofactors * slope;
    let by_chi = by_det * chi_slope;
    let by_norm = jacobian * slope;
    let mixed = by_norm * by_chi.transpose();
    let norm = jacobian.norm_squared();
    let size = det * det + 1.0;
    let of_size = 2.0 / chi - 4.0 * det * chi_slope / (chi * chi) + 2.0 * size * chi_slope * chi_slope / chi.powi(3);
    Matrix3::identity() * (2.0 * shape * slope.norm_squared()) - (mixed + mixed.transpose()) * (4.0 / 3.0 * shape / chi)
        + by_chi * by_chi.transpose() * (10.0 / 9.0 * norm * shape / (chi * chi))
        + by_det * by_det.transpose() * (LAMBDA * of_size)
}

/// `χ` and its derivative.
#[inline]
pub(crate) fn chi(det: f64, epsilon: f64) -> (f64, f64) {
    let root = (det * det + epsilon * epsilon).sqrt();
    // Rewritten, because the sum would cancel.
    let chi = if det < 0.0 {
        epsilon * epsilon / (2.0 * (root - det))
    } else {
        0.5 * (det + root)
    };
    (chi, chi / root)
}

/// The cube root of a positive number, to 2e-14, which takes less time than [`f64::cbrt`], which rounds
/// correctly: a third of the exponent, and two steps of Halley's method.
#[inline]
fn cube_root(x: f64) -> f64 {
    /// Two thirds of the bits of 1, which makes the first error at most 3.3 %.
    const OFFSET: u64 = 0x2a9f_7893_0000_0000;
    if !(f64::MIN_POSITIVE..1e300).contains(&x) {
        return x.cbrt();
    }
    let mut root = f64::from_bits(x.to_bits() / 3 + OFFSET);
    for _ in 0..2 {
        let cube = root * root * root;
        root *= (cube + 2.0 * x) / (2.0 * cube + x);
    }
    root
}

impl ReferenceCells {
    /// The corners of all cells, one after the other.
    fn flat(&self) -> &[u32] {
        match self {
            Self::Tets(tets) => tets.corners.as_flattened(),
            Self::Hexes { corners, .. } => corners.as_flattened(),
        }
    }

    /// Corners per cell.
    fn corners(&self) -> usize {
        match self {
            Self::Tets(_) => 4,
            Self::Hexes { .. } => 8,
        }
    }

    /// The block of the Hessian for a corner of a cell.
    fn block(&self, cell: usize, corner: usize, x: &[Point], epsilon: f64) -> Matrix3 {
        match self {
            Self::Tets(tets) => {
                let (rest, weight) = tets.reference(cell);
                let jacobian = edges(tets.corners[cell].map(|v| x[v as usize])) * rest;
                // Moving the corner by u adds u sᵀ to the Jacobian.
                let slope = match corner {
                    0 => -(rest.row_sum().transpose()),
                    k => rest.row(k - 1).transpose(),
                };
                block_of_jacobian(&jacobian, &slope, epsilon) * weight
            }
            Self::Hexes {
                corners,
                scales,
                penalty,
                ..
            } => {
                let (p, scale) = (corners[cell].map(|v| x[v as usize]), &scales[cell]);
                let of_corner = |(c, axes): (&[usize; 4], &[usize; 3])| {
                    let place = c.iter().position(|&k| k == corner)?;
                    let sizes = Vector::from(axes.map(|axis| scale[axis]));
                    let mut jacobian = edges(c.map(|k| p[k]));
                    (0..3).for_each(|k| jacobian.column_mut(k).scale_mut(sizes[k]));
                    let slope = match place {
                        0 => -sizes,
                        k => Vector::ith(k - 1, sizes[k - 1]),
                    };
                    let mut block = block_of_jacobian(&jacobian, &slope, epsilon);
                    // Without the curvature of the scaled Jacobian.
                    if let Some((_, by_edges)) = penalty.and_then(|penalty| penalty.shortfall(&jacobian)) {
                        let by_corner = by_edges * slope;
                        let weight = penalty.map_or(0.0, |penalty| penalty.weight);
                        block += by_corner * by_corner.transpose() * (2.0 * weight);
                    }
                    Some(block)
                };
                let blocks: Matrix3 = HEX_CORNERS.iter().zip(&HEX_AXES).filter_map(of_corner).sum();
                blocks / (8 * corners.len()) as f64
            }
        }
    }

    /// Evaluates cells from `first` on, as many as there are `parts` for: the derivatives with respect to their
    /// corners.
    fn evaluate(&self, first: usize, x: &[Point], epsilon: f64, parts: &mut [Vector]) -> EnergyValue {
        let instructions = Instructions::detect();
        match self {
            Self::Tets(tets) => instructions.run(TetEnergies {
                tets,
                first,
                x,
                epsilon,
                parts,
            }),
            Self::Hexes {
                corners,
                scales,
                inside,
                penalty,
            } => {
                let mut value = EnergyValue::NONE;
                let weight = 1.0 / (8 * corners.len()) as f64;
                for (i, part) in parts.chunks_exact_mut(8).enumerate() {
                    let (p, scale) = (corners[first + i].map(|v| x[v as usize]), &scales[first + i]);
                    let inverted = value.inverted;
                    part.fill(Vector::zeros());
                    instructions.run(HexCorners {
                        nodes: &p,
                        scale,
                        weight,
                        epsilon,
                        gradient: part,
                        value: &mut value,
                    });
                    if let Some(penalty) = penalty {
                        for c in &HEX_CORNERS {
                            let Some((shortfall, by_edges)) = penalty.shortfall(&edges(c.map(|k| p[k]))) else {
                                continue;
                            };
                            let factor = weight * penalty.weight * shortfall;
                            value.energy += factor * shortfall;
                            for k in 0..3 {
                                let by_edge = by_edges.column(k) * (2.0 * factor);
                                part[c[k + 1]] -= by_edge;
                                part[c[0]] += by_edge;
                            }
                        }
                    }
                    if inside.get(first + i) == Some(&true) {
                        let scale = Vector::from_row_slice(scale);
                        for slopes in between_corners() {
                            let slopes = slopes.map(|slope| slope.component_mul(&scale));
                            let jacobian = (0..8).map(|k| p[k].coords * slopes[k].transpose()).sum();
                            let by_jacobian = value.add(&jacobian, weight, epsilon);
                            for k in 0..8 {
                                part[k] += by_jacobian * slopes[k];
                            }
                        }
                    }
                    value.inverted_cells += usize::from(value.inverted > inverted);
                }
                value
            }
        }
    }
}

impl EnergyValue {
    pub(super) const NONE: Self = Self {
        energy: 0.0,
        least: f64::INFINITY,
        inverted: 0,
        inverted_cells: 0,
    };

    /// Adds the energy of a Jacobian; returns the derivative with respect to it.
    #[inline]
    pub(super) fn add(&mut self, jacobian: &Matrix3, weight: f64, epsilon: f64) -> Matrix3 {
        let [a, b, c] = [0, 1, 2].map(|k| jacobian.column(k).into_owned());
        let cofactors = Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)]);
        let det = a.dot(&cofactors.column(0));
        let (chi, slope) = chi(det, epsilon);
        let norm = jacobian.norm_squared();
        let third = cube_root(chi);
        let shape = 1.0 / (third * third);
        let size = (det * det + 1.0) / chi;
        let by_det = -2.0 / 3.0 * norm * shape * slope / chi + LAMBDA * (2.0 * det - size * slope) / chi;
        self.energy += weight * (norm * shape + LAMBDA * size);
        self.inverted += usize::from(!is_positive(det));
        self.add_determinant(det);
        jacobian * (2.0 * weight * shape) + cofactors * (weight * by_det)
    }

    pub(crate) fn add_determinant(&mut self, det: f64) {
        self.least = lesser(self.least, det);
    }
}

/// Edges from the first corner to the others.
pub(crate) fn edges([a, b, c, d]: [Point; 4]) -> Matrix3 {
    Matrix3::from_columns(&[b - a, c - a, d - a])
}

/// Edges of a regular tetrahedron of volume 1.
pub(crate) fn regular_edges() -> Matrix3 {
    let side = (6.0 * std::f64::consts::SQRT_2).cbrt();
    let third = 3.0f64.sqrt() / 6.0;
    let columns = [
        Vector::x(),
        Vector::new(0.5, 3.0 * third, 0.0),
        Vector::new(0.5, third, (2.0f64 / 3.0).sqrt()),
    ];
    Matrix3::from_columns(&columns) * side
}

fn sorted_unique(mut ids: Vec<u32>) -> Vec<u32> {
    ids.sort_unstable();
    ids.dedup();
    ids
}

/// Gradients of the trilinear shape functions of a cube's corners at the midpoints of edges and faces, and at the
/// centre.
fn between_corners() -> &'static [[Vector; 8]] {
    static SLOPES: LazyLock<Vec<[Vector; 8]>> = LazyLock::new(|| {
        let lattice = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(|k| 0.5 * k as f64));
        let between = lattice.filter(|at| at.contains(&0.5));
        between.map(trilinear_gradients).collect()
    });
    &SLOPES
}

/// The length, or 1 if it is not positive and finite.
pub(crate) fn length_or_one(length: f64) -> f64 {
    if length > 0.0 && length.is_finite() {
        length
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tets() -> (FoldoverEnergy, Vec<Point>) {
        let x: Vec<Point> = [
            [0.0, 0.1, 0.0],
            [1.0, 0.0, 0.2],
            [0.1, 1.3, 0.0],
            [0.2, 0.1, 0.9],
            [0.4, 0.5, 1.1],
        ]
        .map(Point::from)
        .into();
        let mut reference = x.clone();
        reference[0].x -= 0.1;
        reference[4].z = -1.1;
        (
            FoldoverEnergy::of_tets(&[[0, 1, 2, 3], [1, 2, 3, 4], [0, 2, 1, 4]], &reference, 0.7),
            x,
        )
    }

    /// A cube with a corner pushed through it.
    fn hex() -> (FoldoverEnergy, Vec<Point>) {
        let corner = |k: usize| Point::new((k >> 1 & 1 ^ k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64);
        let mut x: Vec<Point> = (0..8).map(corner).collect();
        x[6] = Point::new(-0.2, 0.1, 0.3);
        x[1].y += 0.1;
        (FoldoverEnergy::of_hexes(&[[0, 1, 2, 3, 4, 5, 6, 7]], 8, 0.9), x)
    }

    #[test]
    fn gradient_matches_central_differences_even_for_inverted_cells() {
        let (mut checked_inside, x) = hex();
        checked_inside.check_inside(&[0]);
        let lengths = [[2.0, 0.7, 1.1]];
        let mut of_box = FoldoverEnergy::of_hexes_with(vec![[0, 1, 2, 3, 4, 5, 6, 7]], &lengths, 8);
        of_box.check_inside(&[0]);
        let (mut penalized, _) = hex();
        penalized.penalize(CornerPenalty {
            bound: 0.9,
            weight: 300.0,
        });
        let hexes = [(checked_inside, x.clone()), (of_box, x.clone()), (penalized, x)];
        for (energy, x) in [tets(), hex()].into_iter().chain(hexes) {
            let free: Vec<u32> = (0..x.len() as u32).collect();
            let mut gradient = vec![Vector::zeros(); x.len()];
            for epsilon in [1.0, 0.1, 1e-2] {
                let value = energy.evaluate(&x, epsilon, &free, &mut vec![], &mut gradient);
                let dets = energy.determinants(&x);
                // The value includes determinants inside, which `determinants` does not.
                let least = dets.iter().copied().fold(f64::INFINITY, f64::min);
                assert!(value.inverted >= dets.iter().filter(|d| **d <= 0.0).count());
                assert!(value.inverted > 0 && value.least < least + 1e-14);
                let size = gradient.iter().map(|g| g.amax()).fold(0.0, f64::max);
                let h = 1e-6;
                for v in 0..x.len() {
                    for k in 0..3 {
                        let at = |step: f64| {
                            let mut moved = x.clone();
                            moved[v][k] += step;
                            energy.evaluate(&moved, epsilon, &[], &mut vec![], &mut []).energy
                        };
                        let slope = (at(h) - at(-h)) / (2.0 * h);
                        assert!((slope - gradient[v][k]).abs() < 1e-6 * size, "{epsilon} {v} {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn diagonal_blocks_are_second_derivatives_but_for_the_curvature_of_chi() {
        let (energy, x) = tets();
        let free: Vec<u32> = (0..x.len() as u32).collect();
        // Without inverted cells and ε, χ is d, which is linear.
        let images: Vec<Point> = [[0.0; 3], [1.0, 0.1, 0.0], [0.2, 1.1, 0.1], [0.1, 0.2, 0.9]]
            .map(Point::from)
            .into();
        let single = FoldoverEnergy::of_tets(&[[0, 1, 2, 3]], &x, 0.2);
        let blocks = single.diagonal_blocks(&images, 1e-9, &[0, 1, 2, 3]);
        let gradient = |x: &[Point]| {
            let mut gradient = vec![Vector::zeros(); 4];
            single.evaluate(x, 1e-9, &[0, 1, 2, 3], &mut vec![], &mut gradient);
            gradient
        };
        let h = 1e-5;
        for v in 0..4 {
            for k in 0..3 {
                let at = |step: f64| {
                    let mut moved = images.clone();
                    moved[v][k] += step;
                    gradient(&moved)[v]
                };
                let column = (at(h) - at(-h)) / (2.0 * h);
                assert!(
                    (column - blocks[v].column(k)).norm() < 1e-5 * blocks[v].norm(),
                    "{v} {k}"
                );
            }
        }
        for epsilon in [1.0, 0.1, 1e-3] {
            for block in energy.diagonal_blocks(&x, epsilon, &free) {
                let least = block.symmetric_eigenvalues().min();
                assert!(least > -1e-12 * block.norm() && block.norm() > 0.0, "{block}");
            }
        }
    }

    #[test]
    fn diagonal_blocks_of_a_sound_hexahedron_are_second_derivatives() {
        let (_, mut x) = hex();
        x[6] = Point::new(1.1, 0.9, 1.2);
        let energy = FoldoverEnergy::of_hexes_with(vec![[0, 1, 2, 3, 4, 5, 6, 7]], &[[1.1, 0.9, 1.2]], 8);
        let free: Vec<u32> = (0..8).collect();
        let blocks = energy.diagonal_blocks(&x, 1e-9, &free);
        let gradient = |x: &[Point]| {
            let mut gradient = vec![Vector::zeros(); 8];
            energy.evaluate(x, 1e-9, &free, &mut vec![], &mut gradient);
            gradient
        };
        let h = 1e-5;
        for v in 0..8 {
            for k in 0..3 {
                let at = |step: f64| {
                    let mut moved = x.clone();
                    moved[v][k] += step;
                    gradient(&moved)[v]
                };
                let column = (at(h) - at(-h)) / (2.0 * h);
                let off = (column - blocks[v].column(k)).norm();
                assert!(off < 1e-5 * blocks[v].norm(), "{v} {k}: {off}");
            }
        }
    }

    #[test]
    fn cube_roots_are_those_of_the_standard_library() {
        for k in -1000..1000 {
            for x in [1.0, 1.37, 1.9999, 3.3, 7.999].map(|x: f64| x * 2f64.powi(k)) {
                assert!((cube_root(x) / x.cbrt() - 1.0).abs() < 2e-14, "{x:e}");
            }
        }
        for x in [0.0, 1e-320, f64::INFINITY, f64::MAX, -8.0] {
            assert_eq!(cube_root(x).to_bits(), x.cbrt().to_bits());
        }
        assert!(cube_root(f64::NAN).is_nan());
    }

    #[test]
    fn an_isometry_has_the_least_energy() {
        let (_, x) = tets();
        let energy = FoldoverEnergy::of_tets(&[[0, 1, 2, 3]], &x, 0.2);
        let size = edges([x[0], x[1], x[2], x[3]]).determinant() / 6.0;
        let scaled: Vec<Point> = x.iter().map(|p| p * (0.2 / size).cbrt()).collect();
        let mut gradient = [Vector::zeros(); 4];
        let value = energy.evaluate(&scaled, 1e-12, &[0, 1, 2, 3], &mut vec![], &mut gradient);
        assert!((value.energy - 5.0).abs() < 1e-12 && (value.least - 1.0).abs() < 1e-12);
        assert!(gradient.iter().all(|g| g.norm() < 1e-12));
    }

    #[test]
    fn determinants_that_are_not_finite_count_as_inverted() {
        let (energy, mut x) = tets();
        x[4].x = f64::NAN;
        let value = energy.evaluate(&x, 0.1, &[], &mut vec![], &mut []);
        assert!(value.energy.is_nan() && value.least.is_nan());
        assert_eq!(value.inverted, 2);
    }
}
