//! The discrete harmonic map of a tetrahedral mesh by descent from an initial map: the variational method of Wang, Gu,
//! Thompson & Yau, *3D harmonic mapping and tetrahedral meshing of brain imaging data* (2004).
//!
//! They hold the boundary, start with all other vertices in the middle of the target, and move each of these along its
//! discrete Laplacian, `f(v) += δt Σ_u k_uv (f(u) − f(v))`, until the energy of [`super::stiffness`] falls by less than a
//! threshold `δE` in a step. They leave `δt` to the user. Here each step has the length that lowers the energy most along
//! the same direction, which costs no more, needs no tuning and cannot diverge: in the long run it converges as fast as
//! the best constant step would (Akaike, *On a successive transformation of probability distribution*, Ann. Inst. Stat.
//! Math. 11, 1959). The threshold is a fraction of the energy, so that it means the same for every solid.

use std::sync::Arc;

use super::conjugate_gradients::{add_scaled, dot};
use super::dirichlet::{Dirichlet, UnknownValues, sum_of_parts};
use super::{BaselineError, TetMap, check_fraction, check_images};
use crate::mesh::TetMesh;
use crate::{Point, Vector};

/// Along which directions the energy is lowered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DescentDirection {
    /// The negative gradient.
    #[default]
    Steepest,
    /// Conjugate gradients (Hestenes & Stiefel, 1952), without preconditioning.
    ConjugateGradients,
}

/// Settings of a descent.
#[derive(Debug, Clone, PartialEq)]
pub struct DescentOptions {
    /// Along which directions the energy is lowered.
    pub descent: DescentDirection,
    /// The descent ends with the step that lowers the energy by less than this fraction of it. The energy is then above
    /// its minimum by more than that, by a factor that grows with the number of vertices: hundreds for steepest descent
    /// on usual meshes.
    pub threshold: f64,
    /// Steps after which the descent ends in any case.
    pub most_iterations: usize,
    /// Images of all vertices to start from, those of the boundary being replaced by the boundary map's. `None` starts
    /// with all vertices off the boundary at the centroid of the target's boundary.
    pub initial: Option<Vec<Point>>,
}

impl Default for DescentOptions {
    fn default() -> Self {
        Self {
            descent: DescentDirection::Steepest,
            threshold: 1e-6,
            most_iterations: 10_000,
            initial: None,
        }
    }
}

/// Why a descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DescentStop {
    /// A step lowered the energy by less than the threshold.
    Threshold,
    /// As many steps were made as were allowed.
    Iterations,
}

/// A map found by descent.
#[derive(Debug, Clone)]
pub struct Descended {
    /// The map.
    pub map: TetMap,
    /// Energy `½ ∫ ‖J‖²` of the initial map, and after each step.
    pub energies: Vec<f64>,
    /// Why it ended.
    pub stop: DescentStop,
}

/// The energy of a mesh, ready for descents with any boundary data.
#[derive(Debug, Clone)]
pub struct TetLaplacian {
    system: Dirichlet,
}

impl TetLaplacian {
    /// Assembles the energy of a mesh.
    ///
    /// # Errors
    ///
    /// [`BaselineError`]: for a mesh without tetrahedra, with flat ones, with vertices that are not finite or with parts
    /// that have no boundary.
    pub fn new(mesh: TetMesh) -> Result<Self, BaselineError> {
        let system = Dirichlet::new(mesh)?;
        Ok(Self { system })
    }

    /// The mesh of the domain.
    pub fn mesh(&self) -> &TetMesh {
        &self.system.solid.mesh
    }

    /// The vertices whose images are given: [`super::boundary_vertices`].
    pub fn boundary_vertices(&self) -> &[u32] {
        &self.system.fixed
    }

    /// Descends to the map that carries each of [`Self::boundary_vertices`] to its image. `progress` receives the number
    /// of steps made and the energy, also of the initial map.
    ///
    /// # Errors
    ///
    /// [`BaselineError::ImageCount`] and [`BaselineError::NonFiniteImage`], for the images of the boundary and for an
    /// initial map; [`BaselineError::Option`].
    pub fn solve(
        &self,
        boundary_images: &[Point],
        options: &DescentOptions,
        progress: &dyn Fn(usize, f64),
    ) -> Result<Descended, BaselineError> {
        check_fraction("threshold", options.threshold)?;
        let system = &self.system;
        let (mean, boundary) = system.centred(boundary_images)?;
        let mut values: UnknownValues = match &options.initial {
            Some(images) => {
                check_images(images, self.mesh().vertices().len())?;
                let image = |&v: &u32| images[v as usize].coords - mean;
                system.free.iter().map(image).collect()
            }
            None => vec![self.centroid(&boundary); system.free.len()],
        };
        let (energies, stop) = self.descend(&mut values, &boundary, options, progress);
        let images = system.images(&mean, &values, boundary_images);
        Ok(Descended {
            map: TetMap::of(Arc::clone(&system.solid), images),
            energies,
            stop,
        })
    }

    /// Lowers the energy, `E = xᵀ A x − 2 bᵀ x + …` in the unknowns `x`, whose gradient is twice `A x − b`.
    fn descend(
        &self,
        values: &mut UnknownValues,
        boundary: &[Vector],
        options: &DescentOptions,
        progress: &dyn Fn(usize, f64),
    ) -> (Vec<f64>, DescentStop) {
        let system = &self.system;
        let mut energy = system.energy(values, boundary);
        let mut energies = vec![energy];
        progress(0, energy);
        let mut downhill = system.right_hand_side(boundary);
        add_scaled(&mut downhill, &Vector::repeat(-1.0), &system.times(values));
        let mut squares = dot(&downhill, &downhill).sum();
        let mut direction = downhill.clone();
        for iteration in 1..=options.most_iterations {
            let image = system.times(&direction);
            let curvature = dot(&direction, &image).sum();
            let slope = dot(&downhill, &direction).sum();
            let length = if curvature > 0.0 { slope / curvature } else { 0.0 };
            add_scaled(values, &Vector::repeat(length), &direction);
            add_scaled(&mut downhill, &Vector::repeat(-length), &image);
            let fall = slope * length;
            energy -= fall;
            energies.push(energy);
            progress(iteration, energy);
            if fall <= options.threshold * energy.abs() {
                return (energies, DescentStop::Threshold);
            }
            let before = std::mem::replace(&mut squares, dot(&downhill, &downhill).sum());
            let beta = match options.descent {
                DescentDirection::Steepest => 0.0,
                DescentDirection::ConjugateGradients => squares / before,
            };
            direction.iter_mut().for_each(|d| *d *= beta);
            add_scaled(&mut direction, &Vector::repeat(1.0), &downhill);
        }
        (energies, DescentStop::Iterations)
    }

    /// The mean of the target's boundary, each triangle counting by its area; of its vertices where it has none.
    fn centroid(&self, boundary: &[Vector]) -> Vector {
        let faces = &self.system.faces;
        let weighted = sum_of_parts(faces.len(), |f| {
            let [a, b, c] = faces[f].map(|i| boundary[i as usize]);
            let area = (b - a).cross(&(c - a)).norm();
            ((a + b + c) * (area / 3.0)).push(area)
        });
        if weighted.w > 0.0 {
            weighted.xyz() / weighted.w
        } else {
            Vector::zeros()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, cube};
    use std::cell::RefCell;

    fn bend(p: &Point) -> Point {
        Point::new(p.x + p.y * p.z, 2.0 * p.y + 7.0, p.z - p.x * p.x)
    }

    fn images(laplacian: &TetLaplacian) -> Vec<Point> {
        let vertices = laplacian.boundary_vertices().iter();
        vertices
            .map(|&v| bend(&laplacian.mesh().vertices()[v as usize]))
            .collect()
    }

    #[test]
    fn energy_never_rises_and_is_reported() {
        let laplacian = TetLaplacian::new(ball(6)).unwrap();
        for descent in [DescentDirection::Steepest, DescentDirection::ConjugateGradients] {
            let options = DescentOptions {
                descent,
                ..Default::default()
            };
            let reported = RefCell::new(Vec::new());
            let progress = |iteration, energy| reported.borrow_mut().push((iteration, energy));
            let found = laplacian.solve(&images(&laplacian), &options, &progress).unwrap();
            assert!(found.energies.windows(2).all(|pair| pair[1] <= pair[0]));
            let expected: Vec<_> = found.energies.iter().copied().enumerate().collect();
            assert_eq!(reported.into_inner(), expected);
            assert_eq!(found.stop, DescentStop::Threshold);
            let [.., before, last] = found.energies[..] else {
                panic!("no step was made");
            };
            assert!(before - last <= 1e-6 * last);
        }
    }

    #[test]
    fn conjugate_gradients_take_fewer_steps() {
        let laplacian = TetLaplacian::new(ball(8)).unwrap();
        let steps = |descent| {
            let options = DescentOptions {
                descent,
                threshold: 1e-12,
                ..Default::default()
            };
            laplacian
                .solve(&images(&laplacian), &options, &|_, _| {})
                .unwrap()
                .energies
                .len()
        };
        let (steepest, conjugate) = (
            steps(DescentDirection::Steepest),
            steps(DescentDirection::ConjugateGradients),
        );
        assert!(3 * conjugate < steepest, "{conjugate} against {steepest}");
    }

    /// One unknown: the first step along the gradient ends in the minimum, which is the mean weighted by `k`.
    #[test]
    fn a_single_unknown_is_found_in_one_step() {
        let laplacian = TetLaplacian::new(cube(2)).unwrap();
        let images = images(&laplacian);
        let options = DescentOptions {
            most_iterations: 1,
            ..Default::default()
        };
        let found = laplacian.solve(&images, &options, &|_, _| {}).unwrap();
        assert_eq!((found.stop, found.energies.len()), (DescentStop::Iterations, 2));
        let centre = 13;
        let stiffness = crate::baseline::TetStiffness::new(laplacian.mesh()).unwrap();
        let (neighbours, weights) = stiffness.edges_of(centre);
        let place = |u: u32| laplacian.boundary_vertices().binary_search(&u).unwrap();
        let sum: Vector = neighbours
            .iter()
            .zip(weights)
            .map(|(&u, &k)| images[place(u)].coords * k)
            .sum();
        let mean = sum / weights.iter().sum::<f64>();
        assert!((found.map.images()[centre].coords - mean).norm() < 1e-14);
    }

    #[test]
    fn starts_at_the_centroid_of_the_targets_boundary_or_where_given() {
        let laplacian = TetLaplacian::new(cube(4)).unwrap();
        // Bounded by planes, the box has its centroid in its middle however it is triangulated.
        let stretched: Vec<Point> = laplacian
            .boundary_vertices()
            .iter()
            .map(|&v| laplacian.mesh().vertices()[v as usize])
            .map(|p| Point::new(p.x * p.x * 4.0, p.y, p.z + 3.0))
            .collect();
        let mut options = DescentOptions {
            most_iterations: 0,
            ..Default::default()
        };
        let start = laplacian.solve(&stretched, &options, &|_, _| {}).unwrap();
        let centre = laplacian.mesh().vertices().len() / 2;
        assert!((start.map.images()[centre] - Point::new(2.0, 0.5, 3.5)).norm() < 1e-13);

        let given: Vec<Point> = laplacian.mesh().vertices().iter().map(bend).collect();
        options.initial = Some(given.clone());
        let start = laplacian.solve(&stretched, &options, &|_, _| {}).unwrap();
        assert!((start.map.images()[centre] - given[centre]).norm() < 1e-13);
        assert_eq!(start.map.images()[0], stretched[0]);
    }

    #[test]
    fn meshes_without_inner_vertices_end_at_once() {
        let laplacian = TetLaplacian::new(cube(1)).unwrap();
        let found = laplacian
            .solve(&images(&laplacian), &DescentOptions::default(), &|_, _| {})
            .unwrap();
        assert_eq!(found.stop, DescentStop::Threshold);
        assert_eq!(found.map.images().len(), 8);
    }

    #[test]
    fn rejects_data_that_do_not_fit() {
        assert_eq!(
            TetLaplacian::new(TetMesh::default()).unwrap_err(),
            BaselineError::NoTets
        );
        let laplacian = TetLaplacian::new(cube(3)).unwrap();
        let good = images(&laplacian);
        let error =
            |images: &[Point], options: &DescentOptions| laplacian.solve(images, options, &|_, _| {}).unwrap_err();
        let plain = DescentOptions::default();
        assert!(matches!(
            error(&good[..9], &plain),
            BaselineError::ImageCount { expected: 56, found: 9 }
        ));
        let mut bad = good.clone();
        bad[0].y = f64::NAN;
        assert!(matches!(
            error(&bad, &plain),
            BaselineError::NonFiniteImage { index: 0, .. }
        ));
        let short = DescentOptions {
            initial: Some(good.clone()),
            ..Default::default()
        };
        assert!(matches!(
            error(&good, &short),
            BaselineError::ImageCount {
                expected: 64,
                found: 56
            }
        ));
        let never = DescentOptions {
            threshold: f64::NAN,
            ..Default::default()
        };
        assert!(matches!(
            error(&good, &never),
            BaselineError::Option {
                option: "threshold",
                ..
            }
        ));
    }
}
