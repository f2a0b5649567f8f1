//! The discrete harmonic map of a tetrahedral mesh by a sparse solve: linear finite elements.
//!
//! It minimises the energy of [`super::stiffness`], as [`super::TetLaplacian`] does, but at once. What depends on the
//! mesh alone is done once and kept: a further boundary map costs one pair of triangular solves. The factor is faer's
//! supernodal Cholesky factorisation, in the order of approximate minimum degree (Amestoy, Davis & Duff, *Algorithm 837:
//! AMD*, ACM Trans. Math. Softw. 30, 2004).

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use faer::{Conj, Mat, Par, Side, Spec};

use super::conjugate_gradients::{self, IncompleteCholesky};
use super::dirichlet::{Dirichlet, UnknownValues};
use super::{BaselineError, TetMap, check_fraction};
use crate::mesh::TetMesh;
use crate::{Point, Vector};

/// How the linear system is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum HarmonicSolver {
    /// [`HarmonicSolver::Direct`] up to [`MOST_DIRECT`] unknowns, [`HarmonicSolver::Iterative`] above.
    #[default]
    Auto,
    /// A sparse Cholesky factorisation, kept: costly once, then cheap for every boundary map.
    Direct,
    /// Conjugate gradients preconditioned by an incomplete Cholesky factorisation: cheapest for a single map and for
    /// large meshes.
    Iterative,
}

/// Vertices off the boundary up to which [`HarmonicSolver::Auto`] factors, which takes seconds and half a gibibyte
/// there. Both grow faster than linearly.
pub const MOST_DIRECT: usize = 50_000;

/// How the map is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HarmonicOptions {
    /// How the linear system is solved.
    pub solver: HarmonicSolver,
    /// Norm of the residual over that of the data at which the iterative solver ends; the direct one ignores it.
    pub tolerance: f64,
    /// Iterations after which the iterative solver gives up.
    pub most_iterations: usize,
}

impl Default for HarmonicOptions {
    fn default() -> Self {
        Self {
            solver: HarmonicSolver::Auto,
            tolerance: 1e-10,
            most_iterations: 10_000,
        }
    }
}

/// The linear system for harmonic maps of a mesh, assembled and factored. Solves for any boundary data.
#[derive(Debug)]
pub struct TetHarmonic {
    system: Dirichlet,
    factor: HarmonicFactor,
    options: HarmonicOptions,
}

#[derive(Debug)]
enum HarmonicFactor {
    Complete(Box<SparseCholesky>),
    Incomplete(IncompleteCholesky),
}

impl TetHarmonic {
    /// Assembles the energy of a mesh and factors its matrix.
    ///
    /// # Errors
    ///
    /// [`BaselineError`]: for a mesh without tetrahedra, with flat ones, with vertices that are not finite or with parts
    /// that have no boundary, for a factorisation that does not fit into memory, and for a tolerance out of range.
    pub fn new(mesh: TetMesh, options: &HarmonicOptions) -> Result<Self, BaselineError> {
        check_fraction("tolerance", options.tolerance)?;
        let system = Dirichlet::new(mesh)?;
        let direct = match options.solver {
            HarmonicSolver::Auto => system.free.len() <= MOST_DIRECT,
            HarmonicSolver::Direct => true,
            HarmonicSolver::Iterative => false,
        };
        let factor = if direct {
            HarmonicFactor::Complete(Box::new(SparseCholesky::new(&system)?))
        } else {
            HarmonicFactor::Incomplete(IncompleteCholesky::new(&system))
        };
        Ok(Self {
            system,
            factor,
            options: *options,
        })
    }

    /// The mesh of the domain.
    pub fn mesh(&self) -> &TetMesh {
        &self.system.solid.mesh
    }

    /// The vertices whose images are given: [`super::boundary_vertices`].
    pub fn boundary_vertices(&self) -> &[u32] {
        &self.system.fixed
    }

    /// Vertices whose images are computed.
    pub fn unknowns(&self) -> usize {
        self.system.free.len()
    }

    /// The map that carries each of [`Self::boundary_vertices`] to its image and has the least energy.
    ///
    /// Vertices that no tetrahedron uses go to the mean of the images.
    ///
    /// # Errors
    ///
    /// [`BaselineError::ImageCount`], [`BaselineError::NonFiniteImage`], and [`BaselineError::NotConverged`] from the
    /// iterative solver.
    pub fn solve(&self, boundary_images: &[Point]) -> Result<TetMap, BaselineError> {
        let mut maps = self.solve_block(&[boundary_images])?;
        Ok(maps.pop().expect("one map for one set of images"))
    }

    /// The map for each of several boundary maps, as [`Self::solve`]. The direct solver reads its factor once for all
    /// of them.
    ///
    /// # Errors
    ///
    /// As [`Self::solve`], for the first set of images that has one.
    pub fn solve_block(&self, boundary_images: &[impl AsRef<[Point]>]) -> Result<Vec<TetMap>, BaselineError> {
        let system = &self.system;
        let centred = boundary_images.iter().map(|images| system.centred(images.as_ref()));
        let centred: Vec<(Vector, UnknownValues)> = centred.collect::<Result<_, _>>()?;
        let right_hand_sides = centred.iter().map(|(_, images)| system.right_hand_side(images));
        let right_hand_sides: Vec<UnknownValues> = right_hand_sides.collect();
        let solutions = match &self.factor {
            HarmonicFactor::Complete(factor) => factor.solve(&right_hand_sides)?,
            HarmonicFactor::Incomplete(factor) => {
                let solve = |right_hand_side: &UnknownValues| {
                    let (solution, _) = conjugate_gradients::solve(system, factor, right_hand_side, &self.options)?;
                    Ok(solution)
                };
                right_hand_sides
                    .iter()
                    .map(solve)
                    .collect::<Result<_, BaselineError>>()?
            }
        };
        let all = boundary_images.iter().zip(centred).zip(solutions);
        let maps = all.map(|((images, (mean, _)), values)| {
            let images = system.images(&mean, &values, images.as_ref());
            TetMap::of(Arc::clone(&system.solid), images)
        });
        Ok(maps.collect())
    }
}

/// A sparse Cholesky factorisation.
#[derive(Debug)]
struct SparseCholesky {
    symbolic: SymbolicCholesky<u32>,
    values: Vec<f64>,
}

impl SparseCholesky {
    fn new(system: &Dirichlet) -> Result<Self, BaselineError> {
        let out_of_memory = || BaselineError::OutOfMemory {
            unknowns: system.free.len(),
        };
        let matrix = lower_triangle(system);
        let params = CholeskySymbolicParams::default();
        let symbolic = factorize_symbolic_cholesky(matrix.symbolic(), Side::Lower, SymmetricOrdering::Amd, params);
        let symbolic = symbolic.map_err(|_| out_of_memory())?;
        let mut values = Vec::new();
        values
            .try_reserve_exact(symbolic.len_val())
            .map_err(|_| out_of_memory())?;
        values.resize(symbolic.len_val(), 0.0);
        let par = Par::rayon(0);
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(par, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| out_of_memory())?;
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LltRegularization::default(),
                par,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .map_err(|_| BaselineError::NotPositiveDefinite)?;
        Ok(Self { symbolic, values })
    }

    fn solve(&self, right_hand_sides: &[UnknownValues]) -> Result<Vec<UnknownValues>, BaselineError> {
        let (rows, columns) = (self.symbolic.nrows(), 3 * right_hand_sides.len());
        let mut unknowns = Mat::from_fn(rows, columns, |i, c| right_hand_sides[c / 3][i][c % 3]);
        let par = Par::rayon(0);
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(columns, par);
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| BaselineError::OutOfMemory { unknowns: rows })?;
        let factor = LltRef::new(&self.symbolic, &self.values);
        factor.solve_in_place_with_conj(Conj::No, unknowns.as_mut(), par, MemStack::new(&mut memory));
        let value = |m: usize, i: usize| Vector::from_fn(|c, _| unknowns[(i, 3 * m + c)]);
        let solution = |m: usize| (0..rows).map(|i| value(m, i)).collect();
        Ok((0..right_hand_sides.len()).map(solution).collect())
    }
}

fn lower_triangle(system: &Dirichlet) -> SparseColMat<u32, f64> {
    let count = system.free.len();
    let entries = system.inner.len() / 2 + count;
    let mut begin = Vec::with_capacity(count + 1);
    let (mut rows, mut values) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
    begin.push(0);
    for j in 0..count {
        rows.push(j as u32);
        values.push(system.diagonal[j]);
        for (i, k) in system.inner.row(j).filter(|&(i, _)| i > j) {
            rows.push(i as u32);
            values.push(-k);
        }
        begin.push(rows.len() as u32);
    }
    SparseColMat::new(
        SymbolicSparseColMat::new_checked(count, count, begin, None, rows),
        values,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, cube, torus};
    use crate::baseline::{TetLaplacian, TetStiffness, boundary_vertices};
    use crate::map::VolumeMap;
    use crate::{Matrix3, baseline::DescentDirection, baseline::DescentOptions};

    const DIRECT: HarmonicOptions = HarmonicOptions {
        solver: HarmonicSolver::Direct,
        tolerance: 1e-12,
        most_iterations: 1000,
    };
    const ITERATIVE: HarmonicOptions = HarmonicOptions {
        solver: HarmonicSolver::Iterative,
        ..DIRECT
    };

    /// Coordinates that are harmonic and neither linear nor quadratic: linear elements on regular meshes tend to be exact
    /// for quadratic ones.
    fn harmonic(p: &Point) -> Point {
        let source = Point::new(0.4, -0.3, 3.2);
        Point::new(
            p.x.exp() * p.y.sin(),
            1.0 / (p - source).norm(),
            p.z * p.z * p.z - 3.0 * p.z * p.x * p.x + p.y,
        )
    }

    fn on_boundary(mesh: &TetMesh, f: impl Fn(&Point) -> Point) -> Vec<Point> {
        let vertices = boundary_vertices(mesh);
        vertices.iter().map(|&v| f(&mesh.vertices()[v as usize])).collect()
    }

    /// The L² error over the solid, so that the interpolation error in tetrahedra at the boundary counts too.
    fn error(mesh: TetMesh) -> f64 {
        let images = on_boundary(&mesh, harmonic);
        let map = TetHarmonic::new(mesh, &DIRECT).unwrap().solve(&images).unwrap();
        let rule = crate::energy::tet_quadrature(map.mesh()).unwrap();
        let found = map.evaluate(rule.points());
        let errors = rule.points().iter().zip(found);
        let squares: Vec<f64> = errors.map(|(p, image)| (image - harmonic(p)).norm_squared()).collect();
        rule.integrate(&squares).sqrt()
    }

    #[test]
    fn converges_with_second_order_on_cube_ball_and_torus() {
        let order = |coarse, fine| (error(coarse) / error(fine)).log2();
        let orders = [
            order(cube(6), cube(12)),
            order(ball(10), ball(20)),
            order(torus(4), torus(8)),
        ];
        assert!(orders.iter().all(|order| (order - 2.0).abs() < 0.15), "{orders:?}");
    }

    #[test]
    fn linear_maps_are_reproduced() {
        let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        let shift = Vector::new(10.0, -20.0, 5.0);
        for mesh in [cube(6), ball(6), torus(4)] {
            for options in [DIRECT, ITERATIVE] {
                let harmonic = TetHarmonic::new(mesh.clone(), &options).unwrap();
                let map = harmonic.solve(&on_boundary(&mesh, |p| matrix * p + shift)).unwrap();
                for (p, image) in mesh.vertices().iter().zip(map.images()) {
                    assert!((image - (matrix * p + shift)).norm() < 1e-11);
                }
                assert!(
                    map.jacobian(&mesh.vertices()[..50])
                        .iter()
                        .all(|j| (j - matrix).norm() < 1e-10)
                );
            }
        }
    }

    #[test]
    fn iterative_solver_agrees_with_the_direct_one() {
        for mesh in [cube(10), ball(10), torus(5)] {
            let images = on_boundary(&mesh, harmonic);
            let solve = |options| TetHarmonic::new(mesh.clone(), options).unwrap().solve(&images).unwrap();
            let (direct, iterative) = (solve(&DIRECT), solve(&ITERATIVE));
            for (a, b) in direct.images().iter().zip(iterative.images()) {
                assert!((a - b).norm() < 1e-8);
            }
        }
    }

    #[test]
    fn descent_reaches_the_energy_of_the_direct_solution() {
        for mesh in [cube(6), ball(6), torus(3)] {
            let images = on_boundary(&mesh, harmonic);
            let direct = TetHarmonic::new(mesh.clone(), &DIRECT).unwrap().solve(&images).unwrap();
            let stiffness = TetStiffness::new(&mesh).unwrap();
            let least = stiffness.energy(direct.images()).unwrap();
            let descending = TetLaplacian::new(mesh).unwrap();
            for descent in [DescentDirection::Steepest, DescentDirection::ConjugateGradients] {
                let options = DescentOptions {
                    descent,
                    threshold: 1e-10,
                    ..Default::default()
                };
                let found = descending.solve(&images, &options, &|_, _| {}).unwrap();
                let energy = stiffness.energy(found.map.images()).unwrap();
                assert!(energy >= least * (1.0 - 1e-13) && energy <= least * (1.0 + 1e-6));
                assert!((found.energies.last().unwrap() / energy - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn boundary_vertices_have_their_images_exactly() {
        let mesh = ball(5);
        let images = on_boundary(&mesh, harmonic);
        let map = TetHarmonic::new(mesh, &DIRECT).unwrap();
        let solved = map.solve(&images).unwrap();
        for (&v, image) in map.boundary_vertices().iter().zip(&images) {
            assert_eq!(solved.images()[v as usize], *image);
        }
    }

    /// The discrete maximum principle needs weights that are not negative, as on the cube.
    #[test]
    fn images_off_the_boundary_stay_within_those_on_it() {
        let mesh = cube(8);
        let images = on_boundary(&mesh, |p| {
            Point::new((9.0 * p.x).sin(), (7.0 * p.y * p.z).cos(), p.x * p.y)
        });
        let map = TetHarmonic::new(mesh, &DIRECT).unwrap().solve(&images).unwrap();
        let bounds = crate::geometry::Aabb::around(&images);
        assert!(map.images().iter().all(|p| bounds.contains(p)));
    }

    #[test]
    fn the_energy_cannot_be_lowered() {
        let mesh = torus(3);
        let solved = TetHarmonic::new(mesh.clone(), &DIRECT).unwrap();
        let map = solved.solve(&on_boundary(&mesh, harmonic)).unwrap();
        let stiffness = TetStiffness::new(&mesh).unwrap();
        let least = stiffness.energy(map.images()).unwrap();
        for v in (0..mesh.vertices().len()).filter(|v| solved.boundary_vertices().binary_search(&(*v as u32)).is_err())
        {
            for axis in 0..3 {
                let mut moved = map.images().to_vec();
                moved[v][axis] += 1e-3;
                assert!(stiffness.energy(&moved).unwrap() > least);
            }
        }
    }

    #[test]
    fn a_kept_factor_gives_what_a_fresh_one_gives() {
        let mesh = ball(7);
        let first = on_boundary(&mesh, harmonic);
        let second = on_boundary(&mesh, |p| Point::new(p.y * p.z, p.x.cos(), p.z + 4.0));
        for options in [DIRECT, ITERATIVE] {
            let kept = TetHarmonic::new(mesh.clone(), &options).unwrap();
            let _ = kept.solve(&first).unwrap();
            let again = kept.solve(&second).unwrap();
            let fresh = TetHarmonic::new(mesh.clone(), &options)
                .unwrap()
                .solve(&second)
                .unwrap();
            assert_eq!(again.images(), fresh.images());
            let block = kept.solve_block(&[&first, &second, &first]).unwrap();
            assert_eq!(block.len(), 3);
            for (a, b) in block[1].images().iter().zip(fresh.images()) {
                assert!((a - b).norm() < 1e-12);
            }
            assert_eq!(kept.solve_block(&[] as &[&[Point]]).unwrap().len(), 0);
        }
    }

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        let mesh = ball(12);
        let images = on_boundary(&mesh, harmonic);
        for options in [DIRECT, ITERATIVE] {
            let solve = || {
                TetHarmonic::new(mesh.clone(), &options)
                    .unwrap()
                    .solve(&images)
                    .unwrap()
            };
            let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let (here, there) = (solve(), one.install(solve));
            for (a, b) in here.images().iter().zip(there.images()) {
                assert!((a - b).norm() < 1e-13);
            }
        }
    }

    #[test]
    fn rotating_and_scaling_the_images_rotates_and_scales_the_map() {
        let mesh = ball(6);
        let motion = nalgebra::Rotation3::new(Vector::new(0.3, -1.2, 2.0));
        let solved = TetHarmonic::new(mesh.clone(), &DIRECT).unwrap();
        let here = solved.solve(&on_boundary(&mesh, harmonic)).unwrap();
        let there = solved
            .solve(&on_boundary(&mesh, |p| motion * harmonic(p) * 1e6))
            .unwrap();
        for (a, b) in here.images().iter().zip(there.images()) {
            assert!((motion * a - b * 1e-6).norm() < 1e-12);
        }
    }

    #[test]
    fn meshes_without_inner_vertices_and_in_parts_are_mapped() {
        let single = cube(1);
        let far = cube(4)
            .vertices()
            .iter()
            .map(|p| p + Vector::new(5.0, 0.0, 0.0))
            .collect();
        let far = cube(4).with_vertices(far).unwrap();
        let shift = |t: &[u32; 4]| t.map(|v| v + 9);
        // A vertex between the parts that no tetrahedron uses.
        let unused = Point::new(3.0, 3.0, 3.0);
        let vertices = [single.vertices(), &[unused], far.vertices()].concat();
        let tets = single
            .tets()
            .iter()
            .copied()
            .chain(far.tets().iter().map(shift))
            .collect();
        let parts = TetMesh::new(vertices, tets).unwrap();
        for (mesh, unknowns) in [(single, 0), (parts, 27)] {
            for options in [DIRECT, ITERATIVE] {
                let solved = TetHarmonic::new(mesh.clone(), &options).unwrap();
                assert_eq!(solved.unknowns(), unknowns);
                let map = solved.solve(&on_boundary(&mesh, |p| p * 2.0)).unwrap();
                for (p, image) in mesh.vertices().iter().zip(map.images()) {
                    assert!(*p == unused || (image - p * 2.0).norm() < 1e-12);
                    assert!(image.iter().all(|c| c.is_finite()));
                }
            }
        }
    }

    #[test]
    fn rejects_data_that_do_not_fit() {
        let mesh = cube(3);
        let solved = TetHarmonic::new(mesh.clone(), &HarmonicOptions::default()).unwrap();
        let mut images = on_boundary(&mesh, harmonic);
        assert!(matches!(
            solved.solve(&images[1..]),
            Err(BaselineError::ImageCount {
                expected: 56,
                found: 55
            })
        ));
        images[9].x = f64::INFINITY;
        assert!(matches!(
            solved.solve(&images),
            Err(BaselineError::NonFiniteImage { index: 9, .. })
        ));
        let error = |mesh: TetMesh, options: &HarmonicOptions| TetHarmonic::new(mesh, options).unwrap_err();
        assert_eq!(error(TetMesh::default(), &DIRECT), BaselineError::NoTets);
        let tolerance = HarmonicOptions {
            tolerance: f64::NAN,
            ..DIRECT
        };
        assert!(matches!(
            error(mesh.clone(), &tolerance),
            BaselineError::Option {
                option: "tolerance",
                ..
            }
        ));
        let few = HarmonicOptions {
            most_iterations: 1,
            ..ITERATIVE
        };
        let hasty = TetHarmonic::new(ball(6), &few).unwrap();
        assert!(matches!(
            hasty.solve(&on_boundary(&ball(6), harmonic)),
            Err(BaselineError::NotConverged { iterations: 1, .. })
        ));
    }
}
