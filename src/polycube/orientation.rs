//! The rotation of a model in which its boundary faces along the axes as much as possible.
//!
//! The area-weighted mean of the sums of fourth powers of the normals' components is largest there; for a box it is 1 if its
//! sides are across the axes. It is a form of degree four in each axis of the rotated frame, with one symmetric tensor of the whole
//! surface, so that a step of the ascent takes no longer for a large model. It may have many maxima: Newton's method starts
//! from the model as it is, from the principal axes of its surface, and from rotations all over those that the symmetry of a cube
//! leaves.

use nalgebra::{Rotation3, Unit, UnitQuaternion};

use super::solid::Solid;
use crate::{Matrix3, Point, Vector};

/// Which way up a model is deformed to a polycube.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Orientation {
    /// As it is given.
    #[default]
    Given,
    /// Turned so that its normals are as close to the axes as possible, and otherwise as little as possible.
    Principal,
    /// Every attempt in both orientations; where both lead to a polycube, the one with less energy is taken.
    Best,
}

impl Orientation {
    /// The rotations in which attempts are made. Only one where the model cannot be turned to advantage.
    pub(super) fn turns(self, solid: &Solid) -> Vec<Rotation3<f64>> {
        let given = Rotation3::identity();
        match self {
            Self::Given => vec![given],
            Self::Principal => vec![principal_turn(solid).unwrap_or(given)],
            Self::Best => [Some(given), principal_turn(solid)].into_iter().flatten().collect(),
        }
    }
}

/// Steps of Newton's method from each start, and halvings of a step.
const MOST_STEPS: usize = 60;
const MOST_HALVINGS: usize = 30;
/// A step in radians after which the next would be below rounding.
const LAST_STEP: f64 = 1e-5;
/// Starts along each coordinate of the vectors of Rodrigues, tan(angle/2) times axis, of which those that a cube's symmetry leaves
/// have components up to tan(45°/2).
const STARTS: i32 = 2;
const LARGEST: f64 = 0.41;
/// A gain relative to the largest possible value that is none, and an angle in radians that no model is turned by.
const NO_GAIN: f64 = 1e-9;
const NO_ANGLE: f64 = 1e-9;

/// Sums of products of four components of normals, with shares of the area.
type Tensor = [[[[f64; 3]; 3]; 3]; 3];

/// The rotation, of the 24 that exchange axes of the polycube the smallest; none if no rotation is better than none.
fn principal_turn(solid: &Solid) -> Option<Rotation3<f64>> {
    let tensor = tensor(&solid.mesh.boundary, &solid.mesh.nodes)?;
    let given = Rotation3::identity();
    let mut best = (value(&tensor, &given), given);
    let principal = principal_axes(&solid.mesh.boundary, &solid.mesh.nodes);
    for start in principal.into_iter().chain(grid()).chain([given]) {
        let turn = climbed(&tensor, start);
        let reached = value(&tensor, &turn);
        if reached > best.0 + NO_GAIN {
            best = (reached, turn);
        }
    }
    let turn = smallest(&best.1);
    (turn.angle() > NO_ANGLE).then_some(turn)
}

fn grid() -> impl Iterator<Item = Rotation3<f64>> {
    let at = |k: i32| LARGEST * f64::from(k) / f64::from(STARTS);
    let all = (-STARTS..=STARTS).flat_map(|i| (-STARTS..=STARTS).map(move |j| [i, j]));
    let all = all.flat_map(|[i, j]| (-STARTS..=STARTS).map(move |k| [i, j, k]));
    all.filter_map(move |steps| {
        let vector = Vector::from(steps.map(at));
        let axis = Unit::try_new(vector, 0.0)?;
        Some(Rotation3::from_axis_angle(&axis, 2.0 * vector.norm().atan()))
    })
}

/// `None` for a surface without area.
fn tensor(triangles: &[[u32; 3]], nodes: &[Point]) -> Option<Tensor> {
    let mut sums = Tensor::default();
    let mut total = 0.0;
    for t in triangles {
        let [a, b, c] = t.map(|v| nodes[v as usize]);
        let vector = (b - a).cross(&(c - a));
        let Some(n) = vector.try_normalize(0.0) else { continue };
        let area = vector.norm();
        total += area;
        for (i, si) in sums.iter_mut().enumerate() {
            for (j, sj) in si.iter_mut().enumerate() {
                for (k, sk) in sj.iter_mut().enumerate() {
                    (0..3).for_each(|l| sk[l] += area * n[i] * n[j] * n[k] * n[l]);
                }
            }
        }
    }
    let is_usable = total > 0.0 && total.is_finite();
    let shares = sums.as_flattened_mut().as_flattened_mut().as_flattened_mut();
    shares.iter_mut().for_each(|sum| *sum /= total);
    is_usable.then_some(sums)
}

/// The form's matrix of second derivatives at an axis, but for a factor of 12.
fn contracted(tensor: &Tensor, r: &Vector) -> Matrix3 {
    let mut matrix = Matrix3::zeros();
    for i in 0..3 {
        for j in 0..3 {
            matrix += Matrix3::from_fn(|k, l| tensor[i][j][k][l]) * (r[i] * r[j]);
        }
    }
    matrix
}

/// The axes of the turned frame in the model.
fn axes(turn: &Rotation3<f64>) -> [Vector; 3] {
    [0, 1, 2].map(|k| turn.matrix().row(k).transpose())
}

/// The share of fourth powers: 1 if all normals are along axes, and never below a third.
fn value(tensor: &Tensor, turn: &Rotation3<f64>) -> f64 {
    let along = |r: &Vector| r.dot(&(contracted(tensor, r) * r));
    axes(turn).iter().map(along).sum()
}

/// Ascent from a start by Newton's method, along the gradient where the form is not concave.
fn climbed(tensor: &Tensor, start: Rotation3<f64>) -> Rotation3<f64> {
    let mut turn = start;
    for _ in 0..MOST_STEPS {
        let mut gradient = Vector::zeros();
        let mut second = Matrix3::zeros();
        for r in axes(&turn) {
            let matrix = contracted(tensor, &r);
            let g = matrix * r;
            gradient += 4.0 * r.cross(&g);
            let across = -r.cross_matrix();
            second += 2.0 * (g * r.transpose() + r * g.transpose()) - Matrix3::identity() * (4.0 * g.dot(&r))
                + 12.0 * across.transpose() * matrix * across;
        }
        // Of the negative matrix, which has a decomposition where the form is concave.
        let newton = (-second).cholesky().map(|of| of.solve(&gradient));
        let newton = newton.filter(|step| step.norm() < 1.0);
        let moved = |step: Vector| turn * Rotation3::new(-step);
        // The value has too few digits to show the gain of the last step.
        if let Some(last) = newton.filter(|step| step.norm() < LAST_STEP) {
            return moved(last);
        }
        let mut step = newton.unwrap_or(gradient);
        let before = value(tensor, &turn);
        let is_higher = |step: Vector| value(tensor, &moved(step)) > before;
        let mut halvings = 0;
        while halvings < MOST_HALVINGS && !is_higher(step) {
            step *= 0.5;
            halvings += 1;
        }
        if halvings == MOST_HALVINGS {
            break;
        }
        turn = moved(step);
        turn.renormalize();
    }
    turn
}

/// The principal axes of the surface.
fn principal_axes(triangles: &[[u32; 3]], nodes: &[Point]) -> Option<Rotation3<f64>> {
    let parts: Vec<(f64, Vector)> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| nodes[v as usize]);
            let centre = (a.coords + b.coords + c.coords) / 3.0;
            ((b - a).cross(&(c - a)).norm(), centre)
        })
        .collect();
    let total: f64 = parts.iter().map(|(area, _)| area).sum();
    let mean = parts.iter().map(|(area, p)| p * *area).sum::<Vector>() / total;
    let spread: Matrix3 = parts
        .iter()
        .map(|(area, p)| (p - mean) * (p - mean).transpose() * *area)
        .sum();
    let is_usable = total > 0.0 && spread.iter().all(|x| x.is_finite());
    is_usable.then(|| {
        let mut frame = spread.symmetric_eigen().eigenvectors.transpose();
        if frame.determinant() < 0.0 {
            frame.row_mut(2).neg_mut();
        }
        Rotation3::from_matrix_unchecked(frame)
    })
}

/// The rotation nearest to none of those that differ by one of a cube, the first of equal ones.
fn smallest(turn: &Rotation3<f64>) -> Rotation3<f64> {
    let mut best = *turn;
    for axes in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
        for signs in 0..8_u8 {
            let sign = |k: usize| if signs >> k & 1 == 1 { -1.0 } else { 1.0 };
            let cube = Matrix3::from_fn(|i, j| if axes[i] == j { sign(i) } else { 0.0 });
            if cube.determinant() > 0.0 {
                let other = Rotation3::from_matrix_unchecked(cube) * turn;
                if other.matrix().trace() > best.matrix().trace() + NO_GAIN {
                    best = other;
                }
            }
        }
    }
    // Free of what rounding left of a rotation.
    UnitQuaternion::from_rotation_matrix(&best).to_rotation_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes;
    use crate::mesh::TetMesh;

    fn turned(mesh: &TetMesh, turn: &Rotation3<f64>) -> Solid {
        let nodes = mesh.vertices().iter().map(|p| turn * p).collect();
        Solid::new(mesh.with_vertices(nodes).unwrap()).unwrap()
    }

    #[test]
    fn a_cube_is_turned_back_to_the_nearest_of_its_orientations() {
        let cube = test_meshes::cube(2);
        assert!(principal_turn(&turned(&cube, &Rotation3::identity())).is_none());
        for angles in [[0.3, -0.2, 0.1], [0.6, 0.4, 0.0], [2.0, 0.5, -1.0], [0.0, 0.0, 0.78]] {
            let turn = Rotation3::new(Vector::from(angles));
            let solid = turned(&cube, &turn);
            let found = principal_turn(&solid).unwrap();
            // Together they are a rotation of the cube: entries are 0, 1 and -1.
            let both = found * turn;
            assert!(
                both.matrix().iter().all(|x| (x.abs() - x.abs().round()).abs() < 1e-7),
                "{both}"
            );
            // No rotation to the nearest orientation of a cube is by more than this (Heinz, Neumann, 1991).
            assert!(found.angle() < 62.9_f64.to_radians());
            let tensor = tensor(&solid.mesh.boundary, &solid.mesh.nodes).unwrap();
            assert!((value(&tensor, &found) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_value_found_does_not_depend_on_the_orientation() {
        let torus = test_meshes::torus(2);
        let squeezed = torus
            .vertices()
            .iter()
            .map(|p| Point::new(p.x, 0.6 * p.y + 0.3 * p.x, p.z + 0.2 * p.y * p.x));
        let model = torus.with_vertices(squeezed.collect()).unwrap();
        let best = |angles: [f64; 3]| {
            let solid = turned(&model, &Rotation3::new(Vector::from(angles)));
            let tensor = tensor(&solid.mesh.boundary, &solid.mesh.nodes).unwrap();
            let turn = principal_turn(&solid).unwrap_or_else(Rotation3::identity);
            value(&tensor, &turn)
        };
        let first = best([0.0; 3]);
        for angles in [[0.5, 0.1, -0.4], [-1.3, 2.0, 0.3], [0.0, 0.7, 0.0]] {
            assert!((best(angles) - first).abs() < 1e-9, "{} {first}", best(angles));
        }
    }

    #[test]
    fn the_ascent_ends_at_a_maximum() {
        let torus = test_meshes::torus(2);
        let solid = turned(&torus, &Rotation3::new(Vector::new(0.4, -0.3, 0.7)));
        let tensor = tensor(&solid.mesh.boundary, &solid.mesh.nodes).unwrap();
        let turn = climbed(&tensor, Rotation3::identity());
        let top = value(&tensor, &turn);
        for k in 0..6 {
            let mut step = Vector::zeros();
            step[k / 2] = if k % 2 == 0 { 1e-3 } else { -1e-3 };
            assert!(value(&tensor, &(turn * Rotation3::new(step))) <= top + 1e-15);
        }
    }
}
