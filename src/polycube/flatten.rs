//! Deformation as rigid as possible that turns the boundary triangles of tetrahedra towards the axes of their labels.
//!
//! Sorkine and Alexa, *As-rigid-as-possible surface modeling* (2007), over tetrahedra: local rotations and global linear
//! solves in turn. A penalty on the differences along each triangle's axis between its corners makes the charts flat.

use nalgebra::Rotation3;
use rayon::prelude::*;

use super::axis_of;
use super::solid::Solid;
use crate::remesh::SharedCoordinates;
use crate::remesh::foldover::edges;
use crate::{Matrix3, Point, Vector};

/// Steps of the iteration for a tetrahedron's rotation, which starts from the one before.
const ROTATION_STEPS: usize = 8;
/// Relative residual of the linear solves, and their iterations at most.
const TOLERANCE: f64 = 1e-3;
const MOST_ITERATIONS: usize = 200;

/// The deformation of a mesh of tetrahedra, started from where its nodes are.
pub(super) struct Flattening<'a> {
    tets: &'a [[u32; 4]],
    faces: &'a [[u32; 3]],
    /// Nodes at rest.
    rest: &'a [Point],
    /// Gradients of the barycentric coordinates of each tetrahedron, and its volume.
    gradients: Vec<[Vector; 4]>,
    volumes: Vec<f64>,
    rotations: Vec<Rotation3<f64>>,
    rows: SparseRows,
    /// The values of the stiffness matrix without penalties.
    stiffness: Vec<f64>,
    /// Volume over surface area.
    thickness: f64,
}

impl<'a> Flattening<'a> {
    /// The deformation of a solid from positions that are turned as it is.
    pub fn of(solid: &'a Solid) -> Self {
        let mut flattening = Self::new(solid.tets(), &solid.mesh.boundary, &solid.mesh.nodes);
        flattening.rotations.fill(solid.turn);
        flattening
    }

    /// Tetrahedra with positive volume between the nodes `rest`, and their boundary.
    pub fn new(tets: &'a [[u32; 4]], faces: &'a [[u32; 3]], rest: &'a [Point]) -> Self {
        let shape = |t: &[u32; 4]| {
            let edges = edges(t.map(|v| rest[v as usize]));
            let inverse = edges.try_inverse().unwrap_or_else(Matrix3::zeros);
            let [b, c, d] = [0, 1, 2].map(|k| inverse.row(k).transpose());
            ([-(b + c + d), b, c, d], edges.determinant().abs() / 6.0)
        };
        let (gradients, volumes): (Vec<_>, Vec<f64>) = tets.par_iter().map(shape).unzip();
        let rows = SparseRows::new(tets, rest.len());
        let mut stiffness = vec![0.0; rows.columns.len()];
        for ((t, gradients), volume) in tets.iter().zip(&gradients).zip(&volumes) {
            for i in 0..4 {
                for j in 0..4 {
                    stiffness[rows.entry(t[i], t[j])] += volume * gradients[i].dot(&gradients[j]);
                }
            }
        }
        let area: f64 = faces.iter().map(|f| area(f, rest)).sum();
        let thickness = volumes.iter().sum::<f64>() / area.max(f64::MIN_POSITIVE);
        Self {
            tets,
            faces,
            rest,
            rotations: vec![Rotation3::identity(); tets.len()],
            gradients,
            volumes,
            rows,
            stiffness,
            thickness,
        }
    }

    /// Deforms `x`: `turns` rounds of rotations and solves, with the penalty `weight` for each label. Shared coordinates
    /// stay equal.
    pub fn run(&mut self, x: &mut [Point], labels: &[u8], weight: f64, shared: &SharedCoordinates, turns: usize) {
        let matrices = [0, 1, 2].map(|axis| self.with_penalty(labels, weight, axis));
        for _ in 0..turns {
            self.rotate(x);
            let forces = self.forces();
            let solved: Vec<Vec<f64>> = (0..3usize)
                .into_par_iter()
                .map(|axis| {
                    let sets = shared.equal.iter().filter(|(along, _)| *along == axis);
                    let system = System {
                        rows: &self.rows,
                        values: &matrices[axis],
                        sets: sets.map(|(_, nodes)| nodes.as_slice()).collect(),
                    };
                    let start: Vec<f64> = x.iter().map(|p| p[axis]).collect();
                    let forces: Vec<f64> = forces.iter().map(|f| f[axis]).collect();
                    system.solve(start, &forces)
                })
                .collect();
            for (v, p) in x.iter_mut().enumerate() {
                *p = Point::new(solved[0][v], solved[1][v], solved[2][v]);
            }
        }
    }

    fn with_penalty(&self, labels: &[u8], weight: f64, axis: usize) -> Vec<f64> {
        let mut values = self.stiffness.clone();
        let faces = self.faces.iter().zip(labels);
        for (face, _) in faces.filter(|(_, label)| axis_of(**label) == axis) {
            let stiffness = weight * self.thickness * area(face, self.rest) / 3.0;
            for k in 0..3 {
                let [a, b] = [face[k], face[(k + 1) % 3]];
                let length = (self.rest[a as usize] - self.rest[b as usize]).norm_squared();
                let spring = stiffness / length.max(f64::MIN_POSITIVE);
                if spring.is_finite() {
                    values[self.rows.entry(a, a)] += spring;
                    values[self.rows.entry(b, b)] += spring;
                    values[self.rows.entry(a, b)] -= spring;
                    values[self.rows.entry(b, a)] -= spring;
                }
            }
        }
        values
    }

    /// The rotation nearest to each tetrahedron's Jacobian (Müller, Bender, Chentanez, Macklin, *A robust method to extract
    /// the rotational part of deformations*, 2016).
    fn rotate(&mut self, x: &[Point]) {
        let (tets, gradients) = (self.tets, &self.gradients);
        self.rotations.par_iter_mut().enumerate().for_each(|(t, rotation)| {
            let jacobian: Matrix3 = (0..4)
                .map(|k| x[tets[t][k] as usize].coords * gradients[t][k].transpose())
                .sum();
            *rotation = Rotation3::from_matrix_eps(&jacobian, 1e-6, ROTATION_STEPS, *rotation);
        });
    }

    fn forces(&self) -> Vec<Vector> {
        let mut forces = vec![Vector::zeros(); self.rest.len()];
        for (t, tet) in self.tets.iter().enumerate() {
            let scaled = self.rotations[t].matrix() * self.volumes[t];
            for k in 0..4 {
                forces[tet[k] as usize] += scaled * self.gradients[t][k];
            }
        }
        forces
    }
}

fn area(face: &[u32; 3], x: &[Point]) -> f64 {
    let [a, b, c] = face.map(|v| x[v as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// The pattern of a symmetric matrix over the nodes: nodes of a common cell.
struct SparseRows {
    starts: Vec<u32>,
    columns: Vec<u32>,
}

impl SparseRows {
    fn new(tets: &[[u32; 4]], nodes: usize) -> Self {
        let pairs = |t: &[u32; 4]| {
            let t = *t;
            t.into_iter().flat_map(move |a| t.map(|b| [a, b]))
        };
        let mut entries: Vec<[u32; 2]> = tets.iter().flat_map(pairs).collect();
        entries.par_sort_unstable();
        entries.dedup();
        let mut starts = vec![0; nodes + 1];
        entries.iter().for_each(|[row, _]| starts[*row as usize + 1] += 1);
        (0..nodes).for_each(|v| starts[v + 1] += starts[v]);
        Self {
            starts,
            columns: entries.into_iter().map(|[_, column]| column).collect(),
        }
    }

    fn row(&self, v: usize) -> std::ops::Range<usize> {
        self.starts[v] as usize..self.starts[v + 1] as usize
    }

    /// Where the entry of two nodes of a common cell is.
    fn entry(&self, row: u32, column: u32) -> usize {
        let range = self.row(row as usize);
        let first = range.start;
        first + self.columns[range].binary_search(&column).unwrap_or_default()
    }
}

/// A positive semi-definite system in the subspace in which the values of each set are equal.
struct System<'a> {
    rows: &'a SparseRows,
    values: &'a [f64],
    sets: Vec<&'a [u32]>,
}

impl System<'_> {
    /// The conjugate gradient method with Jacobi's preconditioner.
    fn solve(&self, start: Vec<f64>, right: &[f64]) -> Vec<f64> {
        let mut x = start;
        self.project(&mut x);
        let mut right = right.to_vec();
        self.project(&mut right);
        let mut residual = self.product(&x);
        residual.iter_mut().zip(&right).for_each(|(r, b)| *r = b - *r);
        let inverse = self.inverse_diagonal();
        let precondition =
            |residual: &[f64]| -> Vec<f64> { residual.iter().zip(&inverse).map(|(r, d)| r * d).collect() };
        let mut scaled = precondition(&residual);
        let mut direction = scaled.clone();
        let mut size = dot(&residual, &scaled);
        let enough = TOLERANCE * TOLERANCE * dot(&right, &precondition(&right));
        for _ in 0..MOST_ITERATIONS {
            if size <= enough {
                break;
            }
            let image = self.product(&direction);
            let curvature = dot(&direction, &image);
            // Written so that NaN ends the iteration, too.
            let is_convex = curvature > 0.0;
            if !is_convex {
                break;
            }
            let step = size / curvature;
            for k in 0..x.len() {
                x[k] += step * direction[k];
                residual[k] -= step * image[k];
            }
            scaled = precondition(&residual);
            let before = size;
            size = dot(&residual, &scaled);
            let ratio = size / before;
            direction.iter_mut().zip(&scaled).for_each(|(d, s)| *d = s + ratio * *d);
        }
        x
    }

    fn product(&self, x: &[f64]) -> Vec<f64> {
        let row = |v: usize| {
            let range = self.rows.row(v);
            let terms = self.values[range.clone()].iter().zip(&self.rows.columns[range]);
            terms.map(|(value, column)| value * x[*column as usize]).sum()
        };
        let mut product: Vec<f64> = (0..x.len()).map(row).collect();
        self.project(&mut product);
        product
    }

    /// The mean of each set for its members.
    fn project(&self, x: &mut [f64]) {
        for set in &self.sets {
            let mean = set.iter().map(|&v| x[v as usize]).sum::<f64>() / set.len().max(1) as f64;
            set.iter().for_each(|&v| x[v as usize] = mean);
        }
    }

    fn inverse_diagonal(&self) -> Vec<f64> {
        let nodes = self.rows.starts.len() - 1;
        let mut diagonal: Vec<f64> = (0..nodes)
            .map(|v| {
                if self.rows.row(v).is_empty() {
                    0.0
                } else {
                    self.values[self.rows.entry(v as u32, v as u32)]
                }
            })
            .collect();
        self.project(&mut diagonal);
        let inverse = |d: f64| if d > 0.0 { d.recip() } else { 0.0 };
        diagonal.into_iter().map(inverse).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
