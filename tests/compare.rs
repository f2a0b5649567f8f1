//! Every method on one boundary map: where theory says how far their maps may be apart, and which energy is the least.

use std::f64::consts::PI;

use crate::common::{boundary_map, largest_distance, solids};
use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::{
    BuildOptions, BuiltMap, CompareError, ComparedMethod, EvaluationOptions, FoldCount, InteriorImages, MapEvaluator,
    MeshSpec, build, make_mesh, spread,
};
#[cfg(feature = "native")]
use solidmap::compare::{TetMesher, carried};
use solidmap::energy::harmonic_density;
use solidmap::fit::FitOptions;
use solidmap::geometry::SurfaceQuery;
use solidmap::map::VolumeMap;
use solidmap::mesh::topology::Topology;
use solidmap::mesh::{SurfaceMesh, SurfacePoint, TetMesh, shapes};
use solidmap::sampling;
use solidmap::{Matrix3, Point, Vector};

const SIDE: f64 = 1.5;

/// Harmonic, of degree 2 and 3, and one to one over the cube of this side.
fn polynomials(p: &Point) -> Point {
    let (x, y, z) = (p.x, p.y, p.z);
    Point::new(
        x + 0.2 * (x * x - y * y),
        y + 0.15 * (x * x * x - 3.0 * x * z * z),
        z + 0.3 * x * y,
    )
}

fn affine(p: &Point) -> Point {
    Point::new(
        1.0 + 2.0 * p.x - 0.5 * p.y,
        0.3 * p.x + p.y - 4.0,
        0.7 * p.z + 0.2 * p.y,
    )
}

fn options(method: ComparedMethod, domain: &SurfaceMesh) -> BuildOptions<'static> {
    BuildOptions {
        method,
        fit: FitOptions::default(),
        harmonic: Default::default(),
        descent: Default::default(),
        mesh: MeshSpec::of(domain),
        given: None,
    }
}

fn built(boundary: &BoundaryMap, options: &BuildOptions) -> BuiltMap {
    build(boundary, options, &|_| {}).unwrap()
}

fn evaluator(boundary: &BoundaryMap, resolution: usize) -> MapEvaluator<'_> {
    let options = EvaluationOptions {
        resolution,
        interior: 500,
        held_out: 5000,
        seed: 3,
    };
    MapEvaluator::new(boundary, &options).unwrap()
}

/// A cube of `n³` cells of six tetrahedra each, around the origin.
fn cube_of_tets(n: u32) -> TetMesh {
    let m = n + 1;
    let place = |i: u32| f64::from(i) / f64::from(n) * SIDE - SIDE / 2.0;
    let index = |[i, j, k]: [u32; 3]| (i * m + j) * m + k;
    let lattice = |n: u32| (0..n).flat_map(move |i| (0..n).flat_map(move |j| (0..n).map(move |k| [i, j, k])));
    let vertices = lattice(m).map(|cell| Point::from(cell.map(place))).collect();
    let paths = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let tets = lattice(n).flat_map(|cell| {
        paths.iter().enumerate().map(move |(k, path)| {
            let mut at = cell;
            let mut tet = [index(cell); 4];
            for (corner, &axis) in tet[1..].iter_mut().zip(path) {
                at[axis] += 1;
                *corner = index(at);
            }
            // Odd permutations of the axes give the opposite orientation.
            if k >= 3 {
                tet.swap(2, 3);
            }
            tet
        })
    });
    let mesh = TetMesh::new(vertices, tets.collect()).unwrap();
    assert!((0..mesh.tets().len()).all(|t| mesh.signed_volume(t).abs() > 0.0));
    let first = mesh.signed_volume(0).signum();
    assert!((0..mesh.tets().len()).all(|t| mesh.signed_volume(t).signum() == first));
    mesh
}

/// `∫ ‖J‖²` over the tetrahedra, without a quadrature.
fn energy_on_tets(mesh: &TetMesh, images: &[Point]) -> f64 {
    let of = |t: usize| {
        let edges = |points: &[Point]| {
            let [a, b, c, d] = mesh.tets()[t].map(|v| points[v as usize]);
            Matrix3::from_columns(&[b - a, c - a, d - a])
        };
        let jacobian = edges(images) * edges(mesh.vertices()).try_inverse().unwrap();
        mesh.signed_volume(t).abs() * jacobian.norm_squared()
    };
    (0..mesh.tets().len()).map(of).sum()
}

fn rms_distance(a: &[Point], b: &[Point]) -> f64 {
    assert_eq!(a.len(), b.len());
    (a.iter().zip(b).map(|(p, q)| (p - q).norm_squared()).sum::<f64>() / a.len() as f64).sqrt()
}

/// Any map by a formula.
struct Formula(fn(&Point) -> (Point, Matrix3));

impl VolumeMap for Formula {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|p| self.0(p).0).collect()
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        points.iter().map(|p| self.0(p).1).collect()
    }
}

/// On tets of a lattice, so that the edges are halved exactly: linear elements are of second order inside, and so are
/// the boundary data. Four is the limit; three is required.
#[test]
fn finite_elements_approach_the_exact_map_at_second_order() {
    let inside = crate::common::interior_points(&shapes::cube(0.95 * SIDE, 1), 300, 4);
    let exact: Vec<Point> = inside.iter().map(polynomials).collect();
    let errors = [4, 8, 16].map(|n| {
        let mesh = cube_of_tets(n);
        let boundary = boundary_map(&mesh.boundary().surface, polynomials);
        let options = BuildOptions {
            given: Some(&mesh),
            ..options(ComparedMethod::Fem, boundary.domain())
        };
        rms_distance(&built(&boundary, &options).map.evaluate(&inside), &exact)
    });
    for pair in errors.windows(2) {
        assert!(pair[1] < pair[0] / 3.0, "{errors:?}");
    }
    assert!(errors[2] < 1e-3, "{errors:?}");
}

/// As above, on TetGen's meshes and against the method of fundamental solutions too. Its error is bounded by that of
/// the boundary, which is of second order as well.
#[cfg(feature = "native")]
#[test]
fn methods_approach_the_exact_map_together() {
    let inside = crate::common::interior_points(&shapes::cube(0.95 * SIDE, 1), 300, 4);
    let exact: Vec<Point> = inside.iter().map(polynomials).collect();
    for method in [ComparedMethod::Mfs, ComparedMethod::Fem, ComparedMethod::Variational] {
        let errors = [5, 10].map(|n| {
            let boundary = boundary_map(&shapes::cube(SIDE, n), polynomials);
            let mut options = options(method, boundary.domain());
            options.fit.refine = false;
            options.descent.threshold = 1e-10;
            rms_distance(&built(&boundary, &options).map.evaluate(&inside), &exact)
        });
        assert!(errors[1] < errors[0] / 3.0, "{method:?}: {errors:?}");
    }
}

/// A finer fit of the same piecewise linear data. By the maximum principle two harmonic maps are inside no farther
/// apart than on the boundary, where each is known to be near the data.
#[test]
fn the_fit_and_its_reference_differ_by_no_more_than_their_boundary_errors() {
    for (name, domain) in solids(0) {
        let boundary = boundary_map(&domain, polynomials);
        let evaluator = evaluator(&boundary, 8);
        let finer = boundary.subdivided().subdivided();
        let mut fine = options(ComparedMethod::Mfs, finer.domain());
        fine.fit.tolerance = 1e-4;
        fine.fit.refine = false;
        let reference = built(&finer, &fine);
        let map = built(&boundary, &options(ComparedMethod::Mfs, &domain));
        let [of_map, of_reference] = [&map, &reference].map(|built| evaluator.measure(&*built.map).unwrap());
        let bound = of_map.boundary_error.max + of_reference.boundary_error.max;
        let [a, b] = [&map, &reference].map(|built| evaluator.interior_images(&*built.map).unwrap());
        let found = evaluator.difference(&a, &b);
        assert!(found.max <= bound, "{name}: {found:?} above {bound:e}");
        assert!(
            0.0 < found.rms && found.rms <= found.p99 && found.p99 <= found.max,
            "{name}: {found:?}"
        );
        assert!(
            of_reference.boundary_error.rms < of_map.boundary_error.rms,
            "{name}: a reference that is no better"
        );
    }
}

/// Finer and finer meshes of the same boundary data, as for equal accuracy: their map is that of the reference in the
/// limit. The kinks of the data along edges take some of the second order; half of it is required.
#[cfg(feature = "native")]
#[test]
fn finite_elements_approach_the_reference_as_surface_and_inside_are_refined() {
    let boundary = boundary_map(&shapes::sphere(1.0, 1), polynomials);
    let evaluator = evaluator(&boundary, 8);
    let finer = boundary.subdivided().subdivided().subdivided();
    let mut fine = options(ComparedMethod::Mfs, finer.domain());
    fine.fit.refine = false;
    let reference = evaluator.interior_images(&*built(&finer, &fine).map).unwrap();
    let default = MeshSpec::of(boundary.domain());
    let differences = [0, 1, 2].map(|k| {
        let mut options = options(ComparedMethod::Fem, boundary.domain());
        options.mesh = MeshSpec {
            subdivisions: k,
            edge: default.edge.map(|edge| edge * 0.5f64.powi(k as i32)),
            ..default
        };
        let built = built(&boundary, &options);
        evaluator
            .difference(&evaluator.interior_images(&*built.map).unwrap(), &reference)
            .rms
    });
    for pair in differences.windows(2) {
        assert!(pair[1] < pair[0] / 2.0, "{differences:?}");
    }
}

#[test]
fn affine_maps_are_reproduced_with_one_energy() {
    for (name, domain) in solids(0) {
        let boundary = boundary_map(&domain, affine);
        let evaluator = evaluator(&boundary, 10);
        let exact: Vec<Point> = evaluator.interior().iter().map(affine).collect();
        let mut energies = Vec::new();
        for method in ComparedMethod::ALL {
            if method.is_on_tets() && cfg!(not(feature = "native")) {
                continue;
            }
            let mut options = options(method, &domain);
            // What is missing in the energy is the square of what is missing in the map.
            options.descent.descent = solidmap::baseline::DescentDirection::ConjugateGradients;
            options.descent.threshold = 1e-24;
            let built = built(&boundary, &options);
            let error = largest_distance(&evaluator.interior_images(&*built.map).unwrap().images, &exact);
            assert!(error < 1e-9, "{name}, {method:?}: {error:e}");
            let measured = evaluator.measure(&*built.map).unwrap();
            assert!(measured.boundary_error.max < 1e-9, "{name}, {method:?}");
            energies.push(measured.energy.harmonic);
        }
        // `‖J‖²` of the affine map, both volumes scaled to one.
        let jacobian = Matrix3::new(2.0, -0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.2, 0.7);
        let expected = jacobian.norm_squared() / jacobian.determinant().powf(2.0 / 3.0);
        for energy in energies {
            assert!(
                (energy / expected - 1.0).abs() < 1e-9,
                "{name}: {energy} for {expected}"
            );
        }
    }
}

/// For `v` that vanishes on the boundary of a cube of side `L`, `∫ v² ≤ ∫ |∇v|² L² / 3π²`; and since the finite-element
/// map minimises, `∫ |∇v|²` of its difference to any other map with the same data is the difference of their energies.
#[test]
fn descents_end_above_the_energy_of_the_direct_solve_and_as_near_as_the_energies_say() {
    let mesh = cube_of_tets(8);
    let boundary = boundary_map(&mesh.boundary().surface, polynomials);
    let made = |method, descent, threshold| {
        let mut options = BuildOptions {
            given: Some(&mesh),
            ..options(method, boundary.domain())
        };
        options.descent.descent = descent;
        options.descent.threshold = threshold;
        let built = built(&boundary, &options);
        let (mesh, images) = built.tets.clone().unwrap();
        (energy_on_tets(&mesh, &images), built)
    };
    use solidmap::baseline::DescentDirection::{ConjugateGradients, Steepest};
    let (least, fem) = made(ComparedMethod::Fem, Steepest, 0.0);
    let (conjugate, _) = made(ComparedMethod::Variational, ConjugateGradients, 1e-12);
    let rounding = 1e-12 * least;
    assert!(least <= conjugate + rounding && conjugate <= least * (1.0 + 1e-6));
    let inside = evaluator(&boundary, 8);
    let inside = inside.interior();
    let mut before = f64::INFINITY;
    for threshold in [1e-3, 1e-5, 1e-7] {
        let (energy, built) = made(ComparedMethod::Variational, Steepest, threshold);
        assert!(
            least <= energy + rounding && energy < before,
            "{threshold}: {energy} for {least}"
        );
        before = energy;
        let squares = (energy - least) * SIDE.powi(2) / (3.0 * PI.powi(2)) / SIDE.powi(3);
        let found = rms_distance(&built.map.evaluate(inside), &fem.map.evaluate(inside));
        // The mean square over hundreds of random points: an error of a tenth would be four standard deviations.
        assert!(
            found <= 1.1 * squares.sqrt() + 1e-12,
            "{threshold}: {found:e} above {:e}",
            squares.sqrt()
        );
        // `energies` are half the integral.
        let last = *built.energies.last().unwrap();
        assert!((2.0 * last / energy - 1.0).abs() < 1e-9, "{last} for {energy}");
        assert_eq!(built.iterations, Some(built.energies.len() - 1));
    }
    assert!(before <= least * (1.0 + 1e-4));
}

/// Undivided, eight cells along a rod have no point where the densities are high.
#[test]
fn energies_on_slender_solids_are_within_their_error() {
    let rod = shapes::deformed(&shapes::cube(1.0, 6), |p| Point::new(p.x, 0.02 * p.y, 0.02 * p.z));
    let boundary = boundary_map(&rod, |p| *p);
    let steep = Formula(|p| {
        let at = 40.0 * (p.x - 0.3);
        let slope = 3.0 * (-at * at).exp();
        (*p, Matrix3::new(1.0 + slope, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    });
    // ∫ 2 + (1 + s)² over the length, by the error function, which is ±1 at its ends.
    let (first, second) = (3.0 * PI.sqrt() / 40.0, 9.0 * (PI / 2.0).sqrt() / 40.0);
    let exact = 3.0 + 2.0 * first + second;
    let measured = evaluator(&boundary, 8).measure(&steep).unwrap();
    let error = measured.energy.errors.unwrap().harmonic;
    assert!(
        (measured.energy.harmonic - exact).abs() <= error && error <= 0.05 * exact,
        "{} ± {error} for {exact}",
        measured.energy.harmonic
    );
}

/// Dirichlet's principle: of all maps with the same boundary data, the harmonic one has the least energy. The fit has
/// its data up to the boundary error `δ`, which may lower its energy by no more than `2 ∮ |∂f/∂n| |δ|`; the
/// quadrature's own error is what half its resolution changes.
#[test]
fn no_map_has_less_energy_than_the_harmonic_one() {
    for (name, domain) in [("cube", shapes::cube(SIDE, 6)), ("ball", shapes::sphere(1.0, 2))] {
        let boundary = boundary_map(&domain, |p| {
            polynomials(p) + 0.1 * Vector::new(0.0, (3.0 * p.z).sin(), (2.5 * p.x).cos())
        });
        let measured = |method| {
            let mut options = options(method, &domain);
            options.fit.tolerance = 1e-4;
            let built = built(&boundary, &options);
            let [coarse, fine] = [16, 32].map(|resolution| {
                let evaluator = evaluator(&boundary, resolution);
                let quadrature = evaluator.quadrature();
                let jacobians = built.map.jacobian(quadrature.points());
                let densities: Vec<f64> = jacobians.iter().map(harmonic_density).collect();
                quadrature.integrate(&densities)
            });
            let measured = evaluator(&boundary, 16).measure(&*built.map).unwrap();
            let scale = (domain.volume() / boundary.target().volume()).cbrt().powi(2) / domain.volume();
            let error = measured.energy.errors.unwrap().harmonic + (fine - coarse).abs() * scale;
            assert!(
                (measured.energy.harmonic - fine * scale).abs() <= error,
                "{name}, {method:?}"
            );
            (fine, (fine - coarse).abs(), measured)
        };
        let (least, unsure, fit) = measured(ComparedMethod::Mfs);
        let steepest = (fit.energy.harmonic_density.max * least / fit.energy.harmonic / domain.volume()).sqrt();
        let off_data = 2.0 * steepest * domain.area() * fit.boundary_error.rms * boundary.target_diagonal();
        for method in ComparedMethod::ALL.into_iter().skip(1) {
            if method.is_on_tets() && cfg!(not(feature = "native")) {
                continue;
            }
            let (energy, also_unsure, _) = measured(method);
            let margin = unsure + also_unsure + off_data;
            assert!(margin < 0.02 * least, "{name}: {margin:e} of {least:e} says little");
            assert!(
                energy >= least - margin,
                "{name}, {method:?}: {energy} below {least} by more than {margin:e}"
            );
        }
    }
}

/// A harmonic map with these data would be no farther from the fit inside than the fit is from the data.
#[test]
fn mean_values_are_not_harmonic() {
    let domain = shapes::cube(SIDE, 6);
    let boundary = boundary_map(&domain, |p| {
        p + 0.15 * Vector::new((4.0 * p.y).sin(), (4.0 * p.z).sin(), (4.0 * p.x).sin())
    });
    let evaluator = evaluator(&boundary, 8);
    let [fit, mean_value] =
        [ComparedMethod::Mfs, ComparedMethod::MeanValue].map(|method| built(&boundary, &options(method, &domain)).map);
    let off_data = evaluator.measure(&*fit).unwrap().boundary_error;
    let [a, b] = [&fit, &mean_value].map(|map| evaluator.interior_images(&**map).unwrap());
    let apart = evaluator.difference(&a, &b);
    assert!(
        apart.max > 1.5 * off_data.max,
        "{apart:?} with data off by {off_data:?}"
    );
}

#[test]
fn subdivision_keeps_the_boundary_map() {
    for (name, domain) in solids(0) {
        let boundary = boundary_map(&domain, polynomials);
        let finer = boundary.subdivided();
        let old = domain.vertices().len();
        assert_eq!(finer.domain().triangles().len(), 4 * domain.triangles().len(), "{name}");
        assert_eq!(&finer.domain().vertices()[..old], domain.vertices(), "{name}");
        assert_eq!(&finer.image()[..old], boundary.image(), "{name}");
        assert!(Topology::new(finer.domain()).is_closed(), "{name}");
        let report = solidmap::check::check(finer.domain(), None);
        assert!(report.is_solvable(), "{name}: {report}");
        for (coarse, fine) in [
            (domain.volume(), finer.domain().volume()),
            (domain.area(), finer.domain().area()),
            (boundary.target().volume(), finer.target().volume()),
        ] {
            assert!((fine / coarse - 1.0).abs() < 1e-12, "{name}: {coarse} to {fine}");
        }
        let points = sampling::held_out(finer.domain(), 500, 500, 6);
        let query = SurfaceQuery::new(&domain).unwrap();
        let found: Vec<_> = query.closest_points(&finer.positions(&points));
        assert!(found.iter().all(|c| c.distance < 1e-12), "{name}");
        let on_coarse: Vec<_> = found
            .iter()
            .map(|c| SurfacePoint {
                triangle: c.triangle as u32,
                barycentric: c.barycentric,
            })
            .collect();
        let apart = largest_distance(&boundary.evaluate(&on_coarse), &finer.evaluate(&points));
        assert!(apart < 1e-12, "{name}: {apart:e}");
    }
}

#[test]
fn spread_is_the_distance_from_the_mean_map() {
    let images: Vec<Point> = (0..50).map(|i| Point::new(f64::from(i), -1.0, 0.5)).collect();
    let moved = |by: [f64; 3]| InteriorImages {
        images: images.iter().map(|p| p + Vector::from(by)).collect(),
    };
    let same = moved([0.0; 3]);
    assert_eq!(spread(&[], 1.0), None);
    assert_eq!(spread(std::slice::from_ref(&same), 1.0), None);
    let none = spread(&[same.clone(), same.clone(), same.clone()], 1.0).unwrap();
    assert!(none.max < 1e-14, "{none:?}");
    // Displaced by (3, 0, 4): five apart, each 2.5 from the mean, over a diagonal of 10.
    let two = spread(&[same.clone(), moved([3.0, 0.0, 4.0])], 10.0).unwrap();
    for value in [two.rms, two.p99, two.max] {
        assert!((value - 0.25).abs() < 1e-12, "{two:?}");
    }
    // One of three is off by 3: two are 1 from the mean and one is 2.
    let three = spread(&[same.clone(), same, moved([0.0, 3.0, 0.0])], 1.0).unwrap();
    assert!(
        (three.max - 2.0).abs() < 1e-12 && (three.rms - 2f64.sqrt()).abs() < 1e-12,
        "{three:?}"
    );
}

/// Along x, two thirds of the cube go forth, one sixth back and the rest forth again; kinks are on planes of the
/// lattice.
fn pleat(p: &Point) -> (Point, Matrix3) {
    let (x, slope) = match p.x {
        x if x < -0.25 => (x, 1.0),
        x if x < 0.0 => (-0.5 - x, -1.0),
        x => (x - 0.5, 1.0),
    };
    (
        Point::new(x, p.y, p.z),
        Matrix3::from_diagonal(&Vector::new(slope, 1.0, 1.0)),
    )
}

#[test]
fn folds_of_a_pleated_cube_are_all_counted() {
    let mesh = cube_of_tets(6);
    let images = Formula(pleat).evaluate(mesh.vertices());
    let tets = mesh.tets().len();
    assert_eq!(
        FoldCount::of(&mesh, &images),
        FoldCount {
            tets,
            flipped: tets / 6
        }
    );
    assert_eq!(FoldCount::of(&mesh, mesh.vertices()), FoldCount { tets, flipped: 0 });
    // A mirrored solid is not folded; a pleated one is, whichever way round.
    let mirrored: Vec<Point> = mesh.vertices().iter().map(|p| Point::new(-p.x, p.y, p.z)).collect();
    let turned: Vec<Point> = images.iter().map(|p| Point::new(-p.x, p.y, p.z)).collect();
    let found = [&mirrored, &turned].map(|images| FoldCount::of(&mesh, images).flipped);
    assert_eq!(found, [0, tets / 6]);
    let flat: Vec<Point> = images.iter().map(|p| Point::new(p.x, p.y, 0.0)).collect();
    assert_eq!(FoldCount::of(&mesh, &flat).flipped, tets);
    assert_eq!(FoldCount::of(&mesh, &images[1..]).flipped, tets);

    let boundary = boundary_map(&shapes::cube(SIDE, 6), |p| pleat(p).0);
    let measured = evaluator(&boundary, 12).measure(&Formula(pleat)).unwrap();
    assert!((measured.energy.folded.fraction - 1.0 / 6.0).abs() < 1e-12);
    assert_eq!(measured.energy.det_jacobian.min, -1.0);
    let determinants = measured.distortion.determinants.unwrap();
    assert!(
        (determinants.negative_volume - SIDE.powi(3) / 6.0).abs() < 1e-12,
        "{determinants:?}"
    );
    assert!(measured.boundary_error.max < 1e-12);
}

/// The boundary of a pleated cube: every method's map of it is folded, and none hides it.
#[cfg(feature = "native")]
#[test]
fn folds_of_a_carried_mesh_are_those_of_the_map() {
    let domain = shapes::cube(SIDE, 6);
    let boundary = boundary_map(&domain, |p| pleat(p).0);
    let (mesh, of_mesh) = make_mesh(&boundary, &MeshSpec::of(&domain)).unwrap();
    assert_eq!(of_mesh.image(), boundary.image());
    for method in ComparedMethod::ALL {
        if method == ComparedMethod::Bijective {
            let refused = build(&boundary, &options(method, &domain), &|_| {});
            assert!(
                matches!(refused, Err(CompareError::Bijective(_))),
                "the boundary map folds"
            );
            continue;
        }
        let built = built(&boundary, &options(method, &domain));
        let found = FoldCount::of(&mesh, &carried(&mesh, &of_mesh, &*built.map).unwrap());
        assert_eq!(found.tets, mesh.tets().len());
        assert!(0 < found.flipped && found.flipped < found.tets, "{method:?}: {found:?}");
        if let Some((mesh, images)) = &built.tets {
            assert_eq!(FoldCount::of(mesh, images), found, "{method:?}");
        }
    }
    let unfolded = boundary_map(&domain, affine);
    let map = built(&unfolded, &options(ComparedMethod::MeanValue, &domain)).map;
    let found = FoldCount::of(&mesh, &carried(&mesh, &unfolded, &*map).unwrap());
    assert_eq!(found.flipped, 0);
}

#[cfg(feature = "native")]
#[test]
fn meshes_keep_to_their_specification() {
    let domain = shapes::sphere(1.0, 2);
    let boundary = boundary_map(&domain, polynomials);
    let spec = MeshSpec::of(&domain);
    let tets = |spec: MeshSpec| make_mesh(&boundary, &spec).unwrap().0.tets().len();
    let finer = MeshSpec {
        edge: spec.edge.map(|e| e / 2.0),
        ..spec
    };
    // Eight times as many inside, fewer where the surface already asks for small ones.
    assert!(tets(finer) > 2 * tets(spec));
    let cut = MeshSpec {
        subdivisions: 1,
        ..spec
    };
    let (mesh, of_mesh) = make_mesh(&boundary, &cut).unwrap();
    assert_eq!(mesh.boundary().surface.triangles().len(), 4 * domain.triangles().len());
    assert_eq!(of_mesh, boundary.subdivided());
    let mesh3 = MeshSpec {
        source: TetMesher::Mesh3,
        ..spec
    };
    let volume = make_mesh(&boundary, &mesh3).unwrap().0.volume();
    assert!((volume / domain.volume() - 1.0).abs() < 0.05);
}

#[test]
fn meshes_that_are_impossible_are_refused_with_a_reason() {
    let domain = shapes::sphere(1.0, 2);
    let boundary = boundary_map(&domain, polynomials);
    let spec = MeshSpec::of(&domain);
    let error = |spec: MeshSpec| make_mesh(&boundary, &spec).unwrap_err();
    let few = error(MeshSpec { most_tets: 10, ..spec });
    assert!(matches!(few, CompareError::TooManyTets { most: 10, .. }), "{few}");
    for quality in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let found = error(MeshSpec { quality, ..spec });
        assert!(matches!(found, CompareError::Option { .. }), "{found}");
    }
    for edge in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let edge = Some(edge);
        let found = error(MeshSpec { edge, ..spec });
        assert!(matches!(found, CompareError::Option { .. }), "{found}");
    }
    // A solid of another size, and one elsewhere.
    let cube = cube_of_tets(4);
    let shifted = cube.vertices().iter().map(|p| p + Vector::new(5.0, 0.0, 0.0)).collect();
    let shifted = cube.with_vertices(shifted).unwrap();
    let of_cube = boundary_map(&shapes::cube(SIDE, 4), polynomials);
    for (boundary, given) in [(&boundary, &cube), (&of_cube, &shifted)] {
        for method in [ComparedMethod::Fem, ComparedMethod::Variational] {
            let options = BuildOptions {
                given: Some(given),
                ..options(method, boundary.domain())
            };
            let found = build(boundary, &options, &|_| {})
                .err()
                .expect("another solid was taken");
            match boundary.domain().triangles().len() {
                192 => assert!(matches!(found, CompareError::Elsewhere { .. }), "{found}"),
                _ => assert!(matches!(found, CompareError::OtherSolid { .. }), "{found}"),
            }
        }
    }
}
