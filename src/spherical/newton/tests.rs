use super::*;
use crate::mesh::{SurfaceMesh, shapes};
use crate::spherical::check_embedding;
use crate::spherical::distortion_energy::{DistortionEnergy, EnergyWeights};
use crate::spherical::rest_shape::RestShapes;
use crate::{Point, statistics};

const BALANCED: EnergyWeights = EnergyWeights { angle: 1.0, area: 1.0 };
const CONFORMAL: EnergyWeights = EnergyWeights { angle: 1.0, area: 0.0 };
const EXACT: NewtonOptions = NewtonOptions {
    most_iterations: 100,
    tolerance: 1e-12,
};

fn directions(mesh: &SurfaceMesh) -> Vec<Vector> {
    mesh.vertices().iter().map(|p| p.coords.normalize()).collect()
}

fn minimise(mesh: &SurfaceMesh, weights: EnergyWeights, x: &mut [Vector], options: &NewtonOptions) -> NewtonReport {
    let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
    let energy = DistortionEnergy { rest: &rest, weights };
    let mut newton = Newton::new(mesh.triangles(), &[]).unwrap();
    newton.minimise(&energy, x, options, &|| true).unwrap()
}

/// Vertices moved at random, as far as no triangle inverts, by a seeded linear congruential generator.
fn shaken(mesh: &SurfaceMesh, size: f64) -> Vec<Vector> {
    let mut state = 12345u64;
    let mut random = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut x = directions(mesh);
    for v in 0..x.len() {
        let before = x[v];
        x[v] = (before + size * Vector::from_fn(|_, _| random())).normalize();
        if !check_embedding(mesh.triangles(), &x).is_bijective() {
            x[v] = before;
        }
    }
    x
}

#[test]
fn energy_never_rises_and_no_triangle_inverts() {
    let mesh = shapes::deformed(&shapes::bumpy_sphere(8), |p| Point::new(p.x, 0.4 * p.y, 2.0 * p.z));
    let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
    let mut newton = Newton::new(mesh.triangles(), &[]).unwrap();
    for weights in [BALANCED, CONFORMAL] {
        let energy = DistortionEnergy { rest: &rest, weights };
        let mut x = shaken(&mesh, 0.2);
        let mut last = energy.value(&x);
        let one = NewtonOptions {
            most_iterations: 1,
            tolerance: 0.0,
        };
        for _ in 0..30 {
            let report = newton.minimise(&energy, &mut x, &one, &|| true).unwrap();
            assert!(report.energy_before == last && report.energy_after <= last);
            assert_eq!(energy.value(&x), report.energy_after);
            assert!(check_embedding(mesh.triangles(), &x).is_bijective());
            assert!(x.iter().all(|x| (x.norm() - 1.0).abs() < 1e-15));
            last = report.energy_after;
        }
    }
}

#[test]
fn a_shaken_sphere_returns_to_itself() {
    let mesh = shapes::sphere(2.0, 3);
    let mut still = directions(&mesh);
    minimise(&mesh, BALANCED, &mut still, &EXACT);
    // The minimum is not quite the sphere itself: chords are shorter than arcs, by a fraction of up to the square of
    // the triangles' size, 0.15.
    let original = directions(&mesh);
    let mut x = shaken(&mesh, 0.15);
    assert!(check_embedding(mesh.triangles(), &x).is_bijective() && distance(&x, &original) > 0.1);
    minimise(&mesh, BALANCED, &mut x, &EXACT);
    assert!(distance(&x, &original) < 0.02);
    assert!(distance(&x, &still) < 1e-5);
}

/// Largest difference between the dot products of some pairs of vertices: invariant under rotations.
fn distance(x: &[Vector], y: &[Vector]) -> f64 {
    let count = x.len();
    let difference = |(i, j): (usize, usize)| (x[i].dot(&x[j]) - y[i].dot(&y[j])).abs();
    let pairs = (0..count).flat_map(|i| (1..8).map(move |k| (i, (i + 37 * k) % count)));
    pairs.map(difference).fold(0.0, f64::max)
}

#[test]
fn angles_converge_under_refinement_where_the_map_is_smooth() {
    let error = |levels| {
        let mesh = shapes::deformed(&shapes::sphere(1.0, levels), |p| Point::new(1.5 * p.x, p.y, 0.7 * p.z));
        let mut x = directions(&mesh);
        minimise(
            &mesh,
            CONFORMAL,
            &mut x,
            &NewtonOptions {
                tolerance: 1e-9,
                ..EXACT
            },
        );
        let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
        // q / 2d − 1 is half the square of the relative difference of the stretches.
        let errors: Vec<f64> = rest
            .distortions(&x)
            .iter()
            .map(|[angle, _]| (2.0 * (angle - 1.0)).sqrt())
            .collect();
        statistics::quantiles(&errors, [0.5, 0.99]).unwrap()
    };
    let errors = [2, 3, 4].map(error);
    // First order in the size of triangles, which halves: gradients of linear elements.
    for pair in errors.windows(2) {
        for (coarse, fine) in pair[0].iter().zip(pair[1]) {
            assert!(coarse / fine > 1.7, "{errors:?}");
        }
    }
}

#[test]
fn ends_with_quadratic_convergence() {
    let mesh = shapes::deformed(&shapes::sphere(1.0, 3), |p| Point::new(1.3 * p.x, p.y, 0.8 * p.z));
    let mut x = directions(&mesh);
    let report = minimise(&mesh, BALANCED, &mut x, &EXACT);
    assert!(
        report.stop != NewtonStop::MaxIterations && report.iterations <= 10,
        "{report:?}"
    );
}

#[test]
fn fixed_vertices_stay_and_others_move() {
    let mesh = shapes::bumpy_sphere(6);
    let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
    let start = directions(&mesh);
    let mut newton = Newton::new(mesh.triangles(), &[3, 50, 4_000_000]).unwrap();
    let energy = DistortionEnergy {
        rest: &rest,
        weights: BALANCED,
    };
    let mut x = start.clone();
    newton.minimise(&energy, &mut x, &EXACT, &|| true).unwrap();
    assert!(x[3] == start[3] && x[50] == start[50] && x[100] != start[100]);
    assert!(check_embedding(mesh.triangles(), &x).is_bijective());
}

#[test]
fn all_vertices_may_be_fixed_and_some_unused() {
    let mesh = shapes::sphere(1.0, 1);
    let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
    let energy = DistortionEnergy {
        rest: &rest,
        weights: BALANCED,
    };
    let mut x = directions(&mesh);
    x.extend([Vector::repeat(7.0), Vector::z()]);
    let all: Vec<u32> = (0..42).collect();
    let before = x.clone();
    let mut still = Newton::new(mesh.triangles(), &all).unwrap();
    let report = still.minimise(&energy, &mut x, &EXACT, &|| true).unwrap();
    assert!(report.iterations == 0 && x == before);
    Newton::new(mesh.triangles(), &[])
        .unwrap()
        .minimise(&energy, &mut x, &EXACT, &|| true)
        .unwrap();
    assert_eq!(x[42..], before[42..]);
    let none = RestShapes::new(&[], &[]);
    let energy = DistortionEnergy {
        rest: &none,
        weights: BALANCED,
    };
    Newton::new(&[], &[])
        .unwrap()
        .minimise(&energy, &mut x, &EXACT, &|| true)
        .unwrap();
}

#[test]
fn results_are_the_same_for_any_number_of_threads() {
    let mesh = shapes::deformed(&shapes::bumpy_sphere(30), |p| Point::new(p.x, 0.6 * p.y, 1.4 * p.z));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut x = directions(&mesh);
            let few = NewtonOptions {
                most_iterations: 4,
                tolerance: 0.0,
            };
            minimise(&mesh, BALANCED, &mut x, &few);
            x
        })
    };
    assert!(run(1) == run(2) && run(2) == run(3));
}

#[test]
fn degenerate_rest_triangles_leave_a_bijection_of_lower_energy() {
    let sphere = shapes::sphere(1.0, 3);
    let mesh = shapes::deformed(&sphere, |p| {
        let thin = if p.z > 0.5 { 1e-6 } else { 1.0 };
        if p.x > 0.7 {
            Point::new(0.7, 0.0, 0.0)
        } else if p.y > 0.9 {
            Point::new(f64::NAN, 0.0, 1.0)
        } else {
            Point::new(p.x, thin * p.y, p.z)
        }
    });
    for weights in [BALANCED, CONFORMAL] {
        let mut x = directions(&sphere);
        let options = NewtonOptions {
            most_iterations: 50,
            tolerance: 1e-6,
        };
        let report = minimise(&mesh, weights, &mut x, &options);
        assert!(report.energy_after < report.energy_before);
        assert!(check_embedding(mesh.triangles(), &x).is_bijective());
    }
}

#[test]
fn refuses_what_it_cannot_start_from() {
    let mesh = shapes::sphere(1.0, 2);
    let rest = RestShapes::new(mesh.triangles(), mesh.vertices());
    let mut newton = Newton::new(mesh.triangles(), &[]).unwrap();
    let good = directions(&mesh);
    let mut refused = |weights: EnergyWeights, x: &[Vector]| {
        let energy = DistortionEnergy { rest: &rest, weights };
        let mut moved = x.to_vec();
        let error = newton.minimise(&energy, &mut moved, &EXACT, &|| true).unwrap_err();
        assert!(
            moved
                .iter()
                .flatten()
                .map(|c| c.to_bits())
                .eq(x.iter().flatten().map(|c| c.to_bits()))
        );
        error
    };
    let count = NewtonError::Count {
        vertex: 161,
        directions: 100,
    };
    assert_eq!(refused(BALANCED, &good[..100]), count);
    for angle in [f64::NAN, f64::INFINITY] {
        assert_eq!(
            refused(EnergyWeights { angle, area: 0.0 }, &good),
            NewtonError::NotFinite
        );
    }
    for bad in [-good[5], Vector::repeat(f64::NAN), good[6]] {
        let mut x = good.clone();
        x[5] = bad;
        assert!(matches!(refused(BALANCED, &x), NewtonError::Flipped { .. }));
    }
}

#[test]
fn the_first_root_is_bounded_closely_from_below() {
    let close = |cubic: [f64; 4], root: f64| {
        let found = first_root(&cubic);
        assert!(found <= root * (1.0 + 1e-12) && found > 0.95 * root, "{found} {root}");
    };
    close([1.0, -2.0, 0.0, 0.0], 0.5);
    close([1.0, 0.0, 0.0, -8.0], 0.5);
    // (1 − 2t)(1 − t)(1 + t), and a double root, where the sign does not even change.
    close([1.0, -2.0, -1.0, 2.0], 0.5);
    assert!(first_root(&[1.0, -4.0, 4.0, 0.0]) <= 0.5);
    assert_eq!(first_root(&[1.0, -1.0, 0.25, 0.0]), f64::INFINITY);
    assert_eq!(first_root(&[1.0, 3.0, 2.0, 1.0]), f64::INFINITY);
    assert_eq!(first_root(&[1.0, f64::NAN, 2.0, 1.0]), 0.0);
}
