//! Fits by the Schwarz solver: how many iterations they take, what refinement reaches, and on which solids.

use crate::common::{boundary_map, fitted, interior_points, largest_distance, models};
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::boundary_map::{BoundaryMap, examples};
use solidmap::fit::{BoundaryError, DomainFactor, Fit, FitOptions, RefinementEnd, fit};
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::{SurfaceMesh, SurfacePoint, shapes};
use solidmap::sampling::{self, Anchors, Collocation};
use solidmap::solver::SchwarzStop;
use solidmap::worst_places::PlaceKind;
use solidmap::{Point, Vector};

fn radial(domain: &SurfaceMesh) -> BoundaryMap {
    let (low, high) = domain.bounding_box().unwrap();
    let centre = nalgebra::center(&low, &high);
    boundary_map(domain, |p| Point::from((p - centre).normalize()))
}

fn bent(p: &Point) -> Point {
    Point::new(
        p.x + 0.3 * p.y * p.y,
        p.y - 0.2 * (2.0 * p.z).sin(),
        p.z * (1.0 + 0.2 * p.x),
    )
}

/// No refinement, and a tolerance so tight that the iterations end at the optimum.
fn to_the_optimum() -> FitOptions {
    FitOptions {
        refine: false,
        tolerance: 1e-7,
        ..FitOptions::adaptive()
    }
}

fn with_tolerance(tolerance: f64) -> FitOptions {
    FitOptions {
        tolerance,
        ..FitOptions::adaptive()
    }
}

/// Errors at random points of the boundary, drawn one by one in proportion to area, unlike the fit's stratified sample.
fn sampled_errors(boundary: &BoundaryMap, map: &HarmonicMap, count: usize, seed: u64) -> Vec<f64> {
    let domain = boundary.domain();
    let mut random = StdRng::seed_from_u64(seed);
    let areas = (0..domain.triangles().len()).scan(0.0, |total, t| {
        *total += domain.area_vector(t).norm();
        Some(*total)
    });
    let cumulative: Vec<f64> = areas.collect();
    let all = cumulative[cumulative.len() - 1];
    let points: Vec<SurfacePoint> = (0..count)
        .map(|_| {
            let at = random.random_range(0.0..all);
            let triangle = cumulative.partition_point(|&a| a <= at) as u32;
            let (root, v): (f64, f64) = (random.random_range(0.0f64..1.0).sqrt(), random.random_range(0.0..1.0));
            SurfacePoint {
                triangle,
                barycentric: [1.0 - root, root * (1.0 - v), root * v],
            }
        })
        .collect();
    let diagonal = boundary.target_diagonal();
    let images = map.evaluate(&boundary.positions(&points));
    let pairs = images.iter().zip(boundary.evaluate(&points));
    pairs.map(|(f, exact)| (f - exact).norm() / diagonal).collect()
}

/// The reported error against the test's own sample of the same size. Both are means of `n` draws (the reported one is
/// stratified, so it scatters less): five standard deviations of their difference. Of the test's sample, 1 % exceeds
/// the reported p99, give or take five standard deviations of the difference of two binomial shares.
fn assert_measured(name: &str, fit: &Fit) {
    let n = FitOptions::adaptive().held_out;
    let errors = sampled_errors(&fit.boundary, &fit.map, n, 4711);
    let BoundaryError { rms, p99, max } = fit.report.boundary_error;
    let count = n as f64;
    let mean = errors.iter().map(|e| e * e).sum::<f64>() / count;
    let variance = errors.iter().map(|e| (e * e - mean).powi(2)).sum::<f64>() / count;
    let deviation = (2.0 * variance / count).sqrt();
    assert!(
        (mean - rms * rms).abs() < 5.0 * deviation,
        "{name}: {rms:e} reported, {:e} found",
        mean.sqrt()
    );
    let share = errors.iter().filter(|&&e| e > p99).count() as f64 / count;
    let deviation = (2.0 * 0.01 * 0.99 / count).sqrt();
    assert!(
        (share - 0.01).abs() < 5.0 * deviation,
        "{name}: {share} above the reported p99 {p99:e}"
    );
    assert!(max >= p99, "{name}");
}

#[test]
fn iterations_do_not_grow_with_the_number_of_sources() {
    let counts = [16, 32, 63].map(|frequency| {
        let domain = shapes::bumpy_sphere(frequency);
        let image = shapes::projected_to_sphere(&domain, 1.0);
        let boundary = BoundaryMap::between(domain, &image).unwrap();
        let fit = fitted(&boundary, &to_the_optimum());
        println!(
            "{} sources: {} iterations, {:?}, {:?}",
            fit.report.sources, fit.report.iterations, fit.report.stop, fit.report.boundary_error
        );
        assert_eq!(fit.report.stop, Some(SchwarzStop::Plateau));
        fit.report.iterations
    });
    assert!(
        counts.iter().all(|&count| count as f64 <= 1.5 * counts[0] as f64),
        "{counts:?}"
    );
}

/// The same shape at 5k, 10k, 50k and all of its 134k vertices.
#[test]
fn iterations_do_not_grow_with_the_number_of_sources_on_a_scan() {
    let Some(folder) = models() else { return };
    let boundary = radial(&solidmap::io::read_surface(folder.join("surfaces/igea_134k.ply")).unwrap());
    let counts = [5_000, 10_000, 50_000, 200_000].map(|max_sources| {
        let options = FitOptions {
            max_sources,
            ..to_the_optimum()
        };
        let fit = fitted(&boundary, &options);
        println!(
            "{} sources: {} iterations, {:?}, {:?}, {:?}",
            fit.report.sources, fit.report.iterations, fit.report.stop, fit.report.boundary_error, fit.report.seconds
        );
        assert_eq!(fit.report.stop, Some(SchwarzStop::Plateau));
        fit.report.iterations
    });
    assert!(
        counts.iter().all(|&count| count as f64 <= 1.5 * counts[0] as f64),
        "{counts:?}"
    );
}

/// Large enough for fast sums and several levels. Every sum has a fixed order but that of the dense coarsest level,
/// whose rounding the threads may change; its condition number is below 1e9 or so.
#[test]
fn the_map_does_not_depend_on_the_number_of_threads() {
    let domain = shapes::bumpy_sphere(32);
    let inside: Vec<Point> = interior_points(&shapes::sphere(0.7, 3), 500, 1);
    let boundary = BoundaryMap::between(domain.clone(), &shapes::projected_to_sphere(&domain, 1.0)).unwrap();
    let values = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fitted(&boundary, &with_tolerance(5e-4)).map.evaluate(&inside))
    });
    let diagonal = boundary.target_diagonal();
    for other in &values[1..] {
        let difference = largest_distance(&values[0], other) / diagonal;
        println!("threads: {difference:e}");
        assert!(difference < 1e-6, "{difference:e}");
    }
}

/// The cube of 12 triangles with creases in the map along its edges and diagonals.
fn creased_cube() -> BoundaryMap {
    let cube = shapes::cube(1.0, 1);
    boundary_map(&cube, |p| {
        if p.z > 0.0 {
            Point::new(0.7 * p.x - 0.5 * p.y, 0.5 * p.x + 0.7 * p.y, p.z + 0.2 * p.x)
        } else {
            *p
        }
    })
}

fn ell() -> BoundaryMap {
    let domain = shapes::polycube(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], 4);
    boundary_map(&domain, |p| {
        Point::new(p.x + 0.2 * p.y * p.y, p.y - 0.3 * p.z * p.x, p.z * (1.0 + 0.2 * p.x))
    })
}

#[test]
fn refinement_reaches_the_tolerance_on_polycubes() {
    for (name, boundary, tolerances) in [
        ("cube", creased_cube(), &[1e-2, 3e-3, 1e-3][..]),
        ("L", ell(), &[3e-3, 1e-3, 3e-4]),
        ("animal", examples::polycube_to_animal(3), &[3e-3, 1e-3]),
    ] {
        for &tolerance in tolerances {
            let fit = fitted(&boundary, &with_tolerance(tolerance));
            let report = &fit.report;
            println!(
                "{name} {tolerance:e}: {} sources, {} rounds, {:?}, {:?}",
                report.sources, report.refinements, report.boundary_error, report.seconds
            );
            assert!(
                report.boundary_error.p99 <= tolerance,
                "{name}, {tolerance:e}: {:?}",
                report.boundary_error
            );
            assert!(report.refinements > 0 || tolerance > 2e-3, "{name}, {tolerance:e}");
            assert_measured(name, &fit);
        }
    }
}

#[test]
fn refinement_reaches_the_tolerance_on_real_polycubes() {
    let Some(folder) = models() else { return };
    for (domain, image) in [
        ("max_planck_cube.mesh", "max_planck_object.mesh"),
        ("bird_polycube.vtk", "bird_object.vtk"),
    ] {
        let read = |file| solidmap::io::read_cells(folder.join("maps").join(file)).unwrap();
        let boundary = BoundaryMap::between_cells(&read(domain), &read(image)).unwrap();
        let fit = fitted(&boundary, &with_tolerance(1e-3));
        let report = &fit.report;
        println!(
            "{domain}: {} sources, {} rounds, {:?}, {:?}",
            report.sources, report.refinements, report.boundary_error, report.seconds
        );
        assert!(
            report.boundary_error.p99 <= 1e-3,
            "{domain}: {:?}",
            report.boundary_error
        );
        assert_measured(domain, &fit);
    }
}

/// How many sources meet the tolerance: with refinement, and with one source per vertex of a mesh whose triangles are
/// cut into four until they do.
fn graded_and_uniform(boundary: &BoundaryMap, tolerance: f64) -> (usize, usize) {
    let refined = fitted(boundary, &with_tolerance(tolerance)).report;
    assert!(refined.boundary_error.p99 <= tolerance);
    let unrefined = FitOptions {
        refine: false,
        ..with_tolerance(tolerance)
    };
    let (mut domain, mut image) = (boundary.domain().clone(), boundary.target());
    loop {
        let uniform = fitted(&BoundaryMap::between(domain.clone(), &image).unwrap(), &unrefined).report;
        println!(
            "graded {} {:?}; uniform {} {:?}",
            refined.sources, refined.boundary_error, uniform.sources, uniform.boundary_error
        );
        if uniform.boundary_error.p99 <= tolerance {
            return (refined.sources, uniform.sources);
        }
        (domain, image) = (shapes::quartered(&domain), shapes::quartered(&image));
    }
}

/// The map is the identity on all but some 3 % of the surface: few sources are needed elsewhere.
#[test]
fn sources_are_added_only_where_they_are_needed() {
    let domain = shapes::cube(1.0, 10);
    let boundary = boundary_map(&domain, |p| {
        let peak = (p - Point::new(0.5, 0.0, 0.0)).norm() < 0.12;
        if peak { p + Vector::new(0.15, 0.0, 0.0) } else { *p }
    });
    let (graded, uniform) = graded_and_uniform(&boundary, 1e-3);
    assert!(graded < uniform / 2, "{graded} graded, {uniform} uniform");
}

#[test]
fn refinement_takes_fewer_sources_than_a_uniform_mesh_on_polycubes() {
    for (name, boundary, tolerance) in [
        ("cube", creased_cube(), 3e-3),
        ("cube", creased_cube(), 1e-3),
        ("L", ell(), 3e-4),
        ("animal", examples::polycube_to_animal(3), 3e-3),
    ] {
        let (graded, uniform) = graded_and_uniform(&boundary, tolerance);
        assert!(graded < uniform, "{name}: {graded} graded, {uniform} uniform");
    }
}

#[test]
fn refinement_keeps_to_its_budget_and_says_so() {
    let boundary = creased_cube();
    let unrefined = fitted(
        &boundary,
        &FitOptions {
            refine: false,
            ..with_tolerance(1e-4)
        },
    )
    .report;
    for max_sources in [200, 1000] {
        let options = FitOptions {
            max_sources,
            ..with_tolerance(1e-4)
        };
        let report = fitted(&boundary, &options).report;
        assert!(report.sources <= max_sources && report.sources > unrefined.sources);
        assert!(report.boundary_error.p99 > 1e-4 && report.boundary_error.p99 < unrefined.boundary_error.p99);
        assert!(
            report.warnings.iter().any(|w| w.contains("`max_sources`")),
            "{:?}",
            report.warnings
        );
    }
}

/// With as many equations as sources the residual vanishes, whatever the map does between the collocation points.
#[test]
fn the_boundary_error_is_not_the_residual() {
    let boundary = ell();
    let options = FitOptions {
        collocation_ratio: 1.0,
        affine: false,
        ..FitOptions::dense()
    };
    let fit = fitted(&boundary, &options);
    assert!(fit.report.residual_rms < 1e-8, "{:e}", fit.report.residual_rms);
    assert!(fit.report.boundary_error.rms > 1e-4, "{:?}", fit.report.boundary_error);
    assert_measured("square system", &fit);
    for options in [to_the_optimum(), with_tolerance(1e-3)] {
        let fit = fitted(&boundary, &options);
        assert!(
            fit.report.residual_rms < fit.report.boundary_error.rms,
            "{:?}",
            fit.report
        );
        assert_measured("Schwarz", &fit);
    }
}

#[test]
fn errors_are_measured_where_nothing_was_fitted() {
    let domain = shapes::bumpy_sphere(16);
    let positions = |points: &[SurfacePoint]| -> Vec<[u64; 3]> {
        let bits = points.iter().map(|p| {
            let at = p.position(&domain, domain.vertices());
            [at.x, at.y, at.z].map(f64::to_bits)
        });
        bits.collect()
    };
    let seed = FitOptions::adaptive().seed;
    let mut fitted_at = positions(&Collocation::vertices_and_centroids(&domain).points);
    fitted_at.extend(positions(
        &Collocation::around(&domain, &Anchors::choose(&domain, 800), 2, seed).points,
    ));
    let fitted_at: std::collections::HashSet<_> = fitted_at.into_iter().collect();
    let held_out = positions(&sampling::held_out(&domain, 20_000, 100_000, seed));
    assert!(held_out.len() > 20_000);
    assert!(held_out.iter().all(|p| !fitted_at.contains(p)));
}

/// Frames that move alike are solved for by fewer basis modes, which costs a five-hundredth of the tolerance. By the
/// maximum principle their maps are then as near to those of single solves as the boundary errors of both allow.
#[test]
fn a_sequence_solved_by_its_modes_has_the_errors_of_single_solves() {
    let domain = shapes::bumpy_sphere(16);
    let inside = interior_points(&shapes::sphere(0.7, 3), 200, 2);
    let swum = |time: f64| {
        move |p: &Point| {
            let twist = 0.5 * (1.5 * p.x - time).cos();
            let (cosine, sine) = (twist.cos(), twist.sin());
            Point::new(p.x, cosine * p.y - sine * p.z, sine * p.y + cosine * p.z)
        }
    };
    let frames: Vec<_> = (0..16).map(|k| boundary_map(&domain, swum(0.2 * k as f64))).collect();
    let options = FitOptions::default();
    let factor = DomainFactor::new(&domain, &options, &|_| {}).unwrap();
    let block = factor.solve_block(&frames, &|_| {}).unwrap();
    for (k, (fit, frame)) in block.iter().zip(&frames).enumerate() {
        let single = factor.solve(frame, &|_| {}).unwrap();
        let (error, alone) = (fit.report.boundary_error, single.report.boundary_error);
        let lost = 0.002 * options.tolerance;
        assert!(
            error.rms < 1.1 * alone.rms + lost,
            "frame {k}: {} and {}",
            error.rms,
            alone.rms
        );
        let difference = largest_distance(&fit.map.evaluate(&inside), &single.map.evaluate(&inside));
        assert!(
            difference / frame.target_diagonal() < error.max + alone.max,
            "frame {k}: {difference:e}"
        );
    }
}

/// Frames of very different size and difficulty in one block: each must be as if solved alone, to a small part of its
/// own error. Two solves may end an iteration apart, and an iteration at the end gains about a hundredth.
#[test]
fn a_block_of_frames_gives_the_maps_of_single_solves() {
    let domain = shapes::bumpy_sphere(20);
    let inside = interior_points(&shapes::sphere(0.7, 3), 300, 1);
    let factor = DomainFactor::new(&domain, &to_the_optimum(), &|_| {}).unwrap();
    let frames = [
        radial(&domain),
        boundary_map(&domain, bent),
        boundary_map(&domain, |p| bent(&(p * 1e-3))),
        boundary_map(&domain, |p| Point::from(p.coords * 50.0) + Vector::new(300.0, 0.0, 0.0)),
    ];
    let block = factor.solve_block(&frames, &|_| {}).unwrap();
    for (k, (fit, frame)) in block.iter().zip(&frames).enumerate() {
        let single = factor.solve(frame, &|_| {}).unwrap();
        let difference =
            largest_distance(&fit.map.evaluate(&inside), &single.map.evaluate(&inside)) / frame.target_diagonal();
        println!(
            "frame {k}: {difference:e}; {} and {} iterations; {:e} and {:e}",
            fit.report.iterations,
            single.report.iterations,
            fit.report.boundary_error.rms,
            single.report.boundary_error.rms
        );
    }
    for (k, (fit, frame)) in block.iter().zip(&frames).enumerate() {
        let single = factor.solve(frame, &|_| {}).unwrap();
        let difference =
            largest_distance(&fit.map.evaluate(&inside), &single.map.evaluate(&inside)) / frame.target_diagonal();
        let error = single.report.boundary_error.rms;
        assert!(
            difference < 0.02 * error + 1e-12,
            "frame {k}: {difference:e}, {error:e}"
        );
        assert!(
            fit.report.boundary_error.rms < 1.01 * single.report.boundary_error.rms + 1e-9,
            "frame {k}"
        );
    }
    assert!(factor.solve_block(&[], &|_| {}).unwrap().is_empty());
}

/// The second map is the first, rotated, scaled and shifted: the sources refined for one serve the other as they are.
#[test]
fn refined_sources_serve_later_boundary_maps() {
    let boundary = ell();
    let options = with_tolerance(1e-3);
    let mut factor = DomainFactor::new(boundary.domain(), &options, &|_| {}).unwrap();
    let rotated = boundary
        .image()
        .iter()
        .map(|p| Point::new(2.0 * p.y, -2.0 * p.x, 2.0 * p.z + 5.0));
    let rotated = BoundaryMap::new(boundary.domain().clone(), rotated.collect()).unwrap();
    let before = factor.solve(&rotated, &|_| {}).unwrap().report;
    assert!(before.boundary_error.p99 > options.tolerance);
    let first = factor.solve_refined(&boundary, &|_| {}).unwrap().report;
    let after = factor.solve(&rotated, &|_| {}).unwrap().report;
    assert!(first.sources > before.sources && after.sources == first.sources);
    let ratio = after.boundary_error.rms / first.boundary_error.rms;
    // One solve started from the unrefined solution, the other from zero: they agree to what the plateau leaves open.
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
    let again = factor.solve_refined(&rotated, &|_| {}).unwrap().report;
    // The solver lowers the mean square, not the 99th percentile, which may miss the tolerance narrowly at first.
    assert!(again.sources < first.sources + first.sources / 4 && again.boundary_error.p99 <= options.tolerance);
    // Other data add sources of their own.
    let other = boundary_map(boundary.domain(), bent);
    let finest = factor.solve_refined(&other, &|_| {}).unwrap().report;
    assert!(
        finest.boundary_error.p99 <= options.tolerance,
        "{:?}",
        finest.boundary_error
    );
}

/// A thousand to a few thousand vertices each.
fn hostile() -> Vec<(&'static str, SurfaceMesh)> {
    let flat = |height: f64, shift: f64| {
        shapes::deformed(&shapes::cube(1.0, 10), |p| Point::new(p.x, p.y, height * p.z + shift))
    };
    let ball = |x: f64| shapes::deformed(&shapes::sphere(0.45, 3), |p| p + Vector::new(x, 0.0, 0.0));
    vec![
        ("thin plate", flat(0.01, 0.0)),
        ("narrow gap", shapes::joined(&flat(0.3, 0.1505), &flat(0.3, -0.1505))),
        ("cavity", shapes::spherical_shell(1.0, 0.5, 3)),
        ("needles", shapes::torus(1.0, 0.4, 12, 150)),
        (
            "three balls",
            shapes::joined(&shapes::joined(&ball(0.0), &ball(1.0)), &ball(-3.0)),
        ),
    ]
}

/// The conformal map of the sphere that scales the stereographic plane by the root of 300, after which the spacing at
/// one pole is 300 times that at the other.
fn uneven_sphere() -> SurfaceMesh {
    let scale = 300f64.sqrt();
    shapes::deformed(&shapes::sphere(1.0, 4), |p| {
        let (up, down) = (1.0 + p.z, (1.0 - p.z) * scale * scale);
        let z = (up - down) / (up + down);
        let across = p.x.hypot(p.y);
        let radius = (1.0 - z * z).max(0.0).sqrt();
        if across == 0.0 {
            Point::new(0.0, 0.0, z)
        } else {
            Point::new(p.x / across * radius, p.y / across * radius, z)
        }
    })
}

/// The ratio of the Schwarz solver's boundary error to the dense one's, the worse of smooth and radial data. The dense
/// solver has the finest level's sources only.
fn over_dense(name: &str, domain: &SurfaceMesh) -> f64 {
    let ratio = |boundary: BoundaryMap| {
        let dense = FitOptions {
            refine: false,
            ..FitOptions::dense()
        };
        let [schwarz, dense] = [to_the_optimum(), dense].map(|options| fitted(&boundary, &options).report);
        println!(
            "{name}: {:?} and dense {:?}",
            schwarz.boundary_error, dense.boundary_error
        );
        // Where the data are in the basis both are exact, to rounding.
        (schwarz.boundary_error.rms + 1e-12) / (dense.boundary_error.rms + 1e-12)
    };
    ratio(boundary_map(domain, bent)).max(ratio(radial(domain)))
}

#[test]
fn hostile_solids_are_fitted_as_well_as_by_the_dense_solver() {
    for (name, domain) in hostile() {
        let ratio = over_dense(name, &domain);
        assert!(ratio < 1.1, "{name}: {ratio}");
    }
}

/// What is known to be worse than the dense solver's: 1.5 and 1.23 times its error when this was written.
#[test]
fn thin_shells_and_steep_gradings_are_fitted_nearly_as_well_as_by_the_dense_solver() {
    for (name, domain) in [
        ("thin shell", shapes::spherical_shell(1.0, 0.95, 3)),
        ("spacing 1 to 300", uneven_sphere()),
    ] {
        let ratio = over_dense(name, &domain);
        assert!(ratio < 1.7, "{name}: {ratio}");
    }
}

/// The frame of the system is the same but for rounding of the coordinates, `ε` times the shift in diagonals; what it
/// does to the patches and trees is within the accuracy of the solver.
#[test]
fn size_and_place_of_the_domain_do_not_matter() {
    let domain = shapes::bumpy_sphere(20);
    let inside = interior_points(&shapes::sphere(0.7, 3), 300, 1);
    let plain = fitted(&boundary_map(&domain, bent), &FitOptions::adaptive());
    let expected = plain.map.evaluate(&inside);
    for (scale, shift) in [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e4), (1e-6, 1e4)] {
        let shift = Vector::new(1.0, -0.7, 0.3) * shift * domain.diagonal();
        let place = |p: &Point| Point::from((p.coords + shift) * scale);
        let moved = shapes::deformed(&domain, place);
        let image: Vec<Point> = domain.vertices().iter().map(|p| place(&bent(p))).collect();
        let fit = fitted(&BoundaryMap::new(moved, image).unwrap(), &FitOptions::adaptive());
        let at: Vec<Point> = inside.iter().map(place).collect();
        let back: Vec<Point> = fit
            .map
            .evaluate(&at)
            .iter()
            .map(|p| Point::from(p.coords / scale - shift))
            .collect();
        let difference = largest_distance(&back, &expected) / plain.boundary.target_diagonal();
        println!(
            "scale {scale:e}, shift {shift:?}: {difference:e}, {:?}",
            fit.report.boundary_error
        );
        assert!(difference < 1e-6, "scale {scale:e}, shift {shift:?}: {difference:e}");
        assert_eq!(fit.report.iterations, plain.report.iterations);
    }
}

/// The potentials of charges outside, restricted to the boundary. Between vertices the data are linear, and that error
/// is of second order; what the layer of sources adds at `alpha` spacings is of first order with a small constant
/// (`docs/method.md`). Halving the spacing must gain at least a factor of 1.8.
#[test]
fn the_error_falls_at_first_order_or_faster_in_the_spacing() {
    let charges = |p: &Point| {
        let potential = |x, y, z| 1.0 / (p - Point::new(x, y, z)).norm();
        Point::new(
            potential(2.5, 0.5, 0.3),
            potential(0.3, 2.2, -0.5),
            potential(1.0, -1.0, 2.0),
        )
    };
    let spheres = [2, 3, 4, 5].map(|level| shapes::sphere(1.0, level));
    let tori = [20, 40, 80, 160].map(|around| shapes::torus(1.0, 0.4, around, around * 9 / 20));
    for (name, domains) in [("sphere", spheres), ("torus", tori)] {
        let errors = domains.map(|domain| {
            let boundary = boundary_map(&domain, charges);
            fitted(&boundary, &to_the_optimum()).report.boundary_error.rms
        });
        println!(
            "{name}: {errors:?}, orders {:?}",
            errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect::<Vec<_>>()
        );
        assert!(
            errors.windows(2).all(|pair| pair[1] < pair[0] / 1.8),
            "{name}: {errors:?}"
        );
    }
}

/// A limb that grows out of 0.2 % of a ball's surface: 99 % of the area say nothing about it.
#[test]
fn sources_are_added_where_the_largest_error_is_though_99_per_cent_are_met() {
    let ball = shapes::sphere(1.0, 4);
    let limb = |p: &Point| {
        let across = (p.y * p.y + p.z * p.z) / 0.01;
        let out = if p.x > 0.0 { 0.6 * (-across * across).exp() } else { 0.0 };
        Point::new(p.x + out, p.y, p.z)
    };
    let image: Vec<Point> = ball.vertices().iter().map(limb).collect();
    let boundary = BoundaryMap::new(ball, image).unwrap();
    let fitted = |max_error_ratio: f64| {
        let options = FitOptions {
            tolerance: 2e-3,
            max_error_ratio,
            ..FitOptions::default()
        };
        let report = fit(&boundary, &options, &|_| {}).unwrap().report;
        let met = options.is_met_by(&report);
        assert_eq!(met, report.refinement_end == Some(RefinementEnd::Tolerance));
        report
    };
    let (loose, strict) = (fitted(f64::INFINITY), fitted(5.0));
    assert!(
        loose.boundary_error.p99 <= 2e-3 && loose.boundary_error.max > 1e-2,
        "{loose:?}"
    );
    assert!(
        strict.boundary_error.max <= 1e-2 && strict.sources > loose.sources,
        "{strict:?}"
    );
    assert!(strict.sources < 2 * loose.sources, "{strict:?}");
}

/// A patch of a ball that its image squeezes into a dot: an error far below the tolerance folds it.
#[test]
fn errors_beside_the_size_of_the_image_are_reported_with_their_place_and_lowered_on_request() {
    let ball = shapes::sphere(1.0, 4);
    // Around the pole of the x-axis, to a thousandth of the size, with a steep rim.
    let squeezed = |p: &Point| {
        let r = p.y.hypot(p.z);
        let factor = if p.x > 0.0 {
            ((r - 0.3) / 0.2).clamp(1e-3, 1.0)
        } else {
            1.0
        };
        Point::new(p.x, factor * p.y, factor * p.z)
    };
    let image: Vec<Point> = ball.vertices().iter().map(squeezed).collect();
    let boundary = BoundaryMap::new(ball, image).unwrap();
    let fitted = |max_local_error: f64| {
        let options = FitOptions {
            tolerance: 2e-2,
            source_ratio: 0.1,
            collocation_ratio: 0.3,
            max_local_error,
            ..FitOptions::default()
        };
        let found = fit(&boundary, &options, &|_| {}).unwrap();
        let met = options.is_met_by(&found.report);
        assert_eq!(met, found.report.refinement_end == Some(RefinementEnd::Tolerance));
        found
    };
    let loose = fitted(f64::INFINITY);
    let local = loose.report.local_error.unwrap();
    assert!(
        loose.report.boundary_error.p99 <= 2e-2 && local.max > 1.0,
        "{:?}",
        loose.report
    );
    let places = loose.worst_places(6);
    let place = places.iter().find(|place| place.kind == PlaceKind::LocalError).unwrap();
    let [x, y, z] = place.point;
    assert!(x > 0.8 && y.hypot(z) < 0.4, "{place:?}");
    assert!(
        (place.value.unwrap() - local.max).abs() < 1e-9 * local.max,
        "{place:?} {local:?}"
    );
    assert_eq!(places[0].kind, PlaceKind::BoundaryError);

    let strict = fitted(0.25 * local.max).report;
    assert!(
        strict.local_error.unwrap().max <= 0.25 * local.max && strict.sources > loose.report.sources,
        "{strict:?}"
    );
    assert!(strict.sources < 4 * loose.report.sources, "{strict:?}");
    // Multiples of a length: they do not depend on the unit.
    let scaled: Vec<Point> = boundary.image().iter().map(|p| p * 1000.0).collect();
    let scaled = BoundaryMap::new(boundary.domain().clone(), scaled).unwrap();
    let options = FitOptions {
        tolerance: 2e-2,
        source_ratio: 0.1,
        collocation_ratio: 0.3,
        ..FitOptions::default()
    };
    let again = fit(&scaled, &options, &|_| {}).unwrap().report.local_error.unwrap();
    assert!((again.max / local.max - 1.0).abs() < 1e-6 && (again.p99 / local.p99 - 1.0).abs() < 1e-6);
}
