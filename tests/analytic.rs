//! Fits of boundary maps whose harmonic extension is known.

use crate::common::{boundary_map, fitted, interior_points, largest_distance, models, solids};
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{DomainFactor, FitError, FitMethod, FitOptions, Placement, fit};
use solidmap::map::VolumeMap;
use solidmap::mesh::{SurfaceMesh, SurfacePoint, shapes};
use solidmap::sampling;
use solidmap::solver::{CollocationSystem, Decomposition, DenseFactor, DenseOptions};

fn dense(placement: Placement, decomposition: Decomposition) -> FitMethod {
    let options = DenseOptions {
        decomposition,
        ..DenseOptions::default()
    };
    FitMethod::Dense { placement, options }
}

/// Harmonic polynomials of degree 2, 3 and 4.
fn polynomials(p: &Point) -> Point {
    let (x, y, z) = (p.x, p.y, p.z);
    Point::new(
        x * x - y * y + z,
        x * x * x - 3.0 * x * z * z,
        y.powi(4) - 6.0 * y * y * z * z + z.powi(4),
    )
}

/// The potentials of point charges well outside of every solid here.
fn charges(p: &Point) -> Point {
    let potential = |x, y, z| 1.0 / (p - Point::new(x, y, z)).norm();
    Point::new(
        potential(4.0, 0.5, 0.3) - potential(-3.0, 1.0, 0.0),
        potential(0.3, 3.5, -0.5),
        potential(1.0, -1.0, 3.0) + 0.5 * potential(0.0, 0.0, -3.0),
    )
}

fn affine(p: &Point) -> Point {
    Point::new(
        1.0 + 2.0 * p.x - 0.5 * p.y,
        0.3 * p.x + p.y - 4.0,
        0.7 * p.z + 0.2 * p.y,
    )
}

/// Every placement, solver and collocation; the coarse solids have some 160 to 300 vertices, so 100 sources subsample.
#[test]
fn identity_and_affine_maps_are_reproduced() {
    let choices = [
        FitOptions::adaptive(),
        FitOptions::dense(),
        FitOptions {
            method: dense(FitMethod::default().placement(), Decomposition::Svd),
            ..FitOptions::dense()
        },
        FitOptions {
            max_sources: 100,
            ..FitOptions::adaptive()
        },
        FitOptions {
            max_sources: 100,
            ..FitOptions::dense()
        },
        FitOptions {
            method: dense(Placement::Sphere { radius: 1.0 }, Decomposition::Qr),
            ..FitOptions::dense()
        },
        #[cfg(feature = "native")]
        FitOptions::paper(),
    ];
    for (name, domain) in solids(0) {
        let inside = interior_points(&domain, 200, 1);
        for options in &choices {
            for f in [|p: &Point| *p, affine] {
                let fit = fitted(&boundary_map(&domain, f), options);
                let exact: Vec<Point> = inside.iter().map(f).collect();
                let error = largest_distance(&fit.map.evaluate(&inside), &exact);
                assert!(error < 1e-9, "{name}, {options:?}: {error:e}");
                assert!(
                    fit.report.boundary_error.max < 1e-9,
                    "{name}: {:?}",
                    fit.report.boundary_error
                );
            }
        }
    }
}

/// The images of the vertices are exact and those between them linear, so the data err by `h²/8 |f''|` and the map,
/// by the maximum principle, by no more: halving `h` divides the error by four. Three is required.
#[test]
fn error_inside_falls_with_the_square_of_the_spacing() {
    let unrefined = FitOptions {
        refine: false,
        ..FitOptions::adaptive()
    };
    let formulas: [fn(&Point) -> Point; 2] = [polynomials, charges];
    for ((name, coarse), (_, fine)) in solids(0).into_iter().zip(solids(1)) {
        // The coarse polyhedron is not the fine one: points well inside both.
        let query = solidmap::geometry::SurfaceQuery::new(&fine).unwrap();
        let inside: Vec<Point> = interior_points(&coarse, 300, 2)
            .into_iter()
            .filter(|p| query.signed_distance(p) < 0.0)
            .collect();
        for options in [&FitOptions::dense(), &unrefined, &FitOptions::adaptive()] {
            let refines = options.refine && options.method == FitOptions::adaptive().method;
            let errors = |domain: &SurfaceMesh| {
                // Without refinement one factorisation serves both formulas.
                let factor = (!refines).then(|| DomainFactor::new(domain, options, &|_| ()).unwrap());
                formulas.map(|f| {
                    let boundary = boundary_map(domain, f);
                    let fit = match &factor {
                        Some(factor) => factor.solve(&boundary, &|_| ()).unwrap(),
                        None => fitted(&boundary, options),
                    };
                    let exact: Vec<Point> = inside.iter().map(f).collect();
                    let error = largest_distance(&fit.map.evaluate(&inside), &exact) / boundary.target_diagonal();
                    let bound = fit.report.boundary_error.max + interpolation_error(&boundary, f);
                    assert!(error < bound, "{name}, {options:?}: {error:e} above {bound:e}");
                    error
                })
            };
            for (first, second) in errors(&coarse).into_iter().zip(errors(&fine)) {
                assert!(second < first / 3.0, "{name}, {options:?}: {first:e} to {second:e}");
                // With one source per vertex the map averages the piecewise linear data, and errs less than they do.
                if !refines {
                    assert!(second < 5e-3, "{name}, {options:?}: {second:e}");
                }
            }
        }
    }
}

/// The largest distance, over the target's diagonal, of the linear boundary map from the function it interpolates.
fn interpolation_error(boundary: &solidmap::boundary_map::BoundaryMap, f: fn(&Point) -> Point) -> f64 {
    let points = sampling::held_out(boundary.domain(), 20_000, 20_000, 8);
    let exact: Vec<Point> = boundary.positions(&points).iter().map(f).collect();
    largest_distance(&boundary.evaluate(&points), &exact) / boundary.target_diagonal()
}

/// With exact data at the collocation points nothing but the basis limits the fit: sources at a fixed distance from a
/// sphere converge exponentially in their spacing (Katsurada 1989), so doubling their number must gain much more than
/// any fixed order would.
#[test]
fn boundary_error_falls_as_sources_are_added() {
    let collocation = shapes::sphere(1.0, 3).vertices().to_vec();
    let held_out = sampling::bounding_sphere(Point::origin(), 1.0, 777);
    let weights = vec![1.0; collocation.len()];
    let data: Vec<[f64; 3]> = collocation.iter().map(|p| charges(p).into()).collect();
    let errors = [40, 80, 160, 320].map(|count| {
        let sources = sampling::bounding_sphere(Point::origin(), 1.8, count);
        let system = CollocationSystem {
            collocation: &collocation,
            row_weights: &weights,
            sources: &sources,
            affine: true,
        };
        let factor = DenseFactor::new(&system, &DenseOptions::default()).unwrap();
        let map = solidmap::map::HarmonicMap::new(sources.clone(), factor.solve(&data).unwrap()).unwrap();
        let exact: Vec<Point> = held_out.iter().map(charges).collect();
        largest_distance(&map.evaluate(&held_out), &exact)
    });
    assert!(errors.windows(2).all(|pair| pair[1] < pair[0] / 4.0), "{errors:?}");
    assert!(errors[3] < 1e-6, "{errors:?}");
}

/// The same with exact data on every solid, with sources that follow the spacing `h`. Seen from the boundary, a layer
/// of sources at `alpha · h` ripples with the relative amplitude `exp(−2π alpha)` whatever `h`, and the field of what
/// it ripples about shrinks with `h`: first order with a small constant. Four times the sources must halve the error;
/// 1.8 is required.
#[test]
fn boundary_error_falls_as_sources_are_added_to_any_solid() {
    for (name, domain) in solids(2) {
        let query = solidmap::geometry::SurfaceQuery::new(&domain).unwrap();
        let held_out: Vec<Point> = sampling::held_out(&domain, 1000, 0, 3)
            .iter()
            .map(|p| p.position(&domain, domain.vertices()))
            .collect();
        let exact: Vec<Point> = held_out.iter().map(charges).collect();
        let errors = [60, 240, 960].map(|count| {
            let anchors = sampling::Anchors::choose(&domain, count);
            let placed = sampling::adaptive_sources(&domain, &anchors, 1.5, &|balls| query.are_outside(balls));
            let around = sampling::Collocation::around(&domain, &anchors, 2, 1);
            let points: Vec<Point> = around
                .points
                .iter()
                .map(|p| p.position(&domain, domain.vertices()))
                .collect();
            let data: Vec<[f64; 3]> = points.iter().map(|p| charges(p).into()).collect();
            let weights = vec![1.0; points.len()];
            let system = CollocationSystem {
                collocation: &points,
                row_weights: &weights,
                sources: &placed.positions,
                affine: true,
            };
            let factor = DenseFactor::new(&system, &DenseOptions::default()).unwrap();
            let map = solidmap::map::HarmonicMap::new(placed.positions.clone(), factor.solve(&data).unwrap()).unwrap();
            largest_distance(&map.evaluate(&held_out), &exact)
        });
        assert!(
            errors[1] < errors[0] / 1.8 && errors[2] < errors[1] / 1.8,
            "{name}: {errors:?}"
        );
    }
}

/// The error of a fit is itself harmonic, so inside it is nowhere larger than on the boundary.
#[test]
fn interior_obeys_the_maximum_principle() {
    for (name, domain) in solids(0) {
        let fit = fitted(&boundary_map(&domain, polynomials), &FitOptions::default());
        let error = |points: &[Point]| {
            let exact: Vec<Point> = points.iter().map(polynomials).collect();
            largest_distance(&fit.map.evaluate(points), &exact)
        };
        let surface: Vec<Point> = sampling::held_out(&domain, 20_000, 20_000, 3)
            .iter()
            .map(|p: &SurfacePoint| p.position(&domain, domain.vertices()))
            .collect();
        let (inside, boundary) = (error(&interior_points(&domain, 2000, 4)), error(&surface));
        assert!(
            inside <= boundary,
            "{name}: {inside:e} inside, {boundary:e} on the boundary"
        );

        let values = fit.map.evaluate(&surface);
        for k in 0..3 {
            let low = values.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
            let high = values.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
            for p in fit.map.evaluate(&interior_points(&domain, 500, 5)) {
                assert!(
                    p[k] > low && p[k] < high,
                    "{name}: coordinate {k} is {} outside of {low} to {high}",
                    p[k]
                );
            }
        }
    }
}

/// Smooth data on a ball of 2562 vertices: the goal at 5k vertices is 1e-4.
#[test]
fn smooth_data_are_met_between_the_collocation_points() {
    let domain = shapes::sphere(1.0, 4);
    let fit = fitted(&boundary_map(&domain, charges), &FitOptions::default());
    assert!(fit.report.boundary_error.rms < 1e-4, "{:?}", fit.report.boundary_error);
}

/// A map by this function of positions, also within triangles.
fn by_function(domain: &SurfaceMesh, f: fn(&Point) -> Point) -> BoundaryMap {
    let points: Vec<Point> = domain.vertices().iter().map(f).collect();
    let bounds = points
        .iter()
        .fold((points[0], points[0]), |(low, high), p| (low.inf(p), high.sup(p)));
    let surface = domain.clone();
    let value = move |p: &SurfacePoint| f(&p.position(&surface, surface.vertices()));
    BoundaryMap::by_function(domain.clone(), bounds, value).unwrap()
}

/// Distant sources meet data that are harmonic far beyond the solid within any tolerance here; others need sources near it.
#[test]
fn smooth_data_need_few_sources_whatever_the_tolerance() {
    for domain in [shapes::bumpy_sphere(25), shapes::torus(0.8, 0.3, 80, 40)] {
        for function in [polynomials, charges] {
            for tolerance in [1e-3, 1e-5, 1e-6] {
                let options = FitOptions {
                    tolerance,
                    ..FitOptions::default()
                };
                let boundary = by_function(&domain, function);
                let fit = fitted(&boundary, &options);
                assert!(fit.report.sources < 300 && fit.report.sources == fit.map.sources().len());
                assert!(options.is_met_by(&fit.report));
                let points = interior_points(&domain, 500, 7);
                let error = largest_distance(
                    &fit.map.evaluate(&points),
                    &points.iter().map(function).collect::<Vec<_>>(),
                );
                assert!(error < tolerance * boundary.target_diagonal(), "{error:e}");
            }
        }
        let kinked = |p: &Point| Point::new(p.x.abs(), p.y, p.z);
        let fit = fitted(&by_function(&domain, kinked), &FitOptions::default());
        assert!(fit.report.sources > domain.vertices().len(), "{}", fit.report.sources);
    }
}

/// A small dent is in few of the points that distant sources are tried at, or none: sources near the solid then serve for all.
#[test]
fn smooth_data_with_a_dent_are_as_accurate_inside_as_their_report_says() {
    fn dented(p: &Point) -> Point {
        let dent = 0.05 * (-((p - Point::new(0.0, 0.0, p.z.max(0.0))).norm() / 0.02).powi(2)).exp();
        polynomials(p)
            + if p.z > 0.0 {
                solidmap::Vector::x() * dent
            } else {
                solidmap::Vector::zeros()
            }
    }
    let domain = shapes::bumpy_sphere(40);
    let boundary = by_function(&domain, dented);
    let points = interior_points(&domain, 500, 7);
    let exact: Vec<Point> = points.iter().map(polynomials).collect();
    for refine in [false, true] {
        let options = FitOptions {
            refine,
            ..FitOptions::default()
        };
        let fit = fitted(&boundary, &options);
        let error = largest_distance(&fit.map.evaluate(&points), &exact) / boundary.target_diagonal();
        assert!(error < options.tolerance, "{error:e} {}", fit.report.sources);
    }
}

/// Several boundary maps at once: smooth ones share the distant sources, and one that is not leaves none of them wrong.
#[test]
fn blocks_of_smooth_data_are_as_accurate_inside_as_one_by_one() {
    let domain = shapes::bumpy_sphere(25);
    let turned = |p: &Point| polynomials(&Point::new(p.y, p.z, p.x));
    let mixed = |p: &Point| Point::from(2.0 * polynomials(p).coords + charges(p).coords);
    let smooth: [fn(&Point) -> Point; 4] = [polynomials, charges, turned, mixed];
    let points = interior_points(&domain, 500, 7);
    let require_accurate = |f: fn(&Point) -> Point, map: &dyn VolumeMap, most: f64| {
        let exact: Vec<Point> = points.iter().map(f).collect();
        let error = largest_distance(&map.evaluate(&points), &exact);
        assert!(error < most, "{error:e}");
    };
    for tolerance in [1e-3, 1e-6] {
        let options = FitOptions {
            tolerance,
            refine: false,
            ..FitOptions::default()
        };
        let factor = DomainFactor::new(&domain, &options, &|_| {}).unwrap();
        let mut boundaries: Vec<BoundaryMap> = smooth.iter().map(|f| by_function(&domain, *f)).collect();
        let fits = factor.solve_block(&boundaries, &|_| {}).unwrap();
        for ((f, fit), boundary) in smooth.iter().zip(&fits).zip(&boundaries) {
            assert!(fit.map.sources().len() < 300 && options.is_met_by(&fit.report));
            require_accurate(*f, &fit.map, tolerance * boundary.target_diagonal());
        }
        boundaries.push(by_function(&domain, |p| Point::new(p.x.abs(), p.y, p.z)));
        let fits = factor.solve_block(&boundaries, &|_| {}).unwrap();
        for ((f, fit), boundary) in smooth.iter().zip(&fits).zip(&boundaries) {
            require_accurate(*f, &fit.map, 2e-3 * boundary.target_diagonal());
        }
    }
}

/// A repeated solve on a kept factorisation is the fit itself, where neither refines.
#[test]
fn one_factorisation_serves_many_boundary_maps() {
    let (_, domain) = solids(0).remove(1);
    let unrefined = FitOptions {
        refine: false,
        ..FitOptions::adaptive()
    };
    for options in [FitOptions::dense(), unrefined] {
        let factor = DomainFactor::new(&domain, &options, &|_| {}).unwrap();
        for f in [polynomials, charges] {
            let boundary = boundary_map(&domain, f);
            let (kept, fresh) = (factor.solve(&boundary, &|_| {}).unwrap(), fitted(&boundary, &options));
            assert!(kept.map.coefficients() == fresh.map.coefficients(), "{options:?}");
        }
        let other = boundary_map(&shapes::sphere(1.0, 1), affine);
        assert!(matches!(
            factor.solve(&other, &|_| {}),
            Err(solidmap::fit::FitError::OtherDomain)
        ));
    }
}

/// A model with more vertices than sources allowed is fitted all the same, and says so.
#[test]
fn too_many_vertices_are_subsampled_with_a_warning() {
    let domain = shapes::sphere(1.0, 4);
    let options = FitOptions {
        max_sources: 300,
        ..FitOptions::default()
    };
    let fit = fitted(&boundary_map(&domain, charges), &options);
    assert_eq!((fit.report.sources, fit.report.collocation), (300, 900));
    assert!(
        fit.report.warnings.iter().any(|w| w.contains("`max_sources`")),
        "{:?}",
        fit.report.warnings
    );
    assert!(fit.report.boundary_error.rms < 5e-4, "{:?}", fit.report.boundary_error);
}

/// The data are the potential of a charge at the cavity's centre, which sources around the outer surface alone cannot
/// represent. Every placement must therefore put sources in the cavity, also that on one sphere around everything.
#[test]
fn cavities_have_sources_whatever_the_placement() {
    let domain = shapes::spherical_shell(1.0, 0.5, 3);
    let boundary = boundary_map(&domain, |p| Point::new(1.0 / p.coords.norm(), p.y, p.z));
    for placement in [
        Placement::Adaptive { alpha: 1.0 },
        Placement::Sphere { radius: 0.6 },
        #[cfg(feature = "native")]
        Placement::Offset { distance: 0.1 },
    ] {
        let options = FitOptions {
            method: dense(placement, Decomposition::Qr),
            source_ratio: 1.0,
            collocation_ratio: 3.0,
            ..FitOptions::dense()
        };
        let rms = fitted(&boundary, &options).report.boundary_error.rms;
        assert!(rms < 3e-3, "{placement:?}: {rms:e}");
    }
}

/// Without affine columns the basis is the paper's, which cannot meet even the identity exactly.
#[test]
fn the_paper_basis_meets_the_identity_only_nearly() {
    let domain = shapes::sphere(1.0, 3);
    let options = FitOptions {
        method: dense(Placement::Sphere { radius: 0.6 }, Decomposition::Svd),
        affine: false,
        ..FitOptions::paper()
    };
    let fit = fitted(&boundary_map(&domain, |p| *p), &options);
    assert_eq!(fit.map.coefficients().affine, [[0.0; 3]; 4]);
    let rms = fit.report.boundary_error.rms;
    assert!(rms > 1e-12 && rms < 1e-3, "{rms:e}");
}

#[test]
fn real_models_meet_smooth_data() {
    let Some(folder) = models() else { return };
    for (file, bound) in [
        ("surfaces/kitten_g1_9k.obj", 1e-4),
        ("surfaces/double_torus_g2_3k.obj", 1e-4),
    ] {
        let domain = solidmap::io::read_surface(folder.join(file)).unwrap();
        let (low, high) = domain.bounding_box().unwrap();
        let (centre, size) = (nalgebra::center(&low, &high), (high - low).norm());
        let boundary = boundary_map(&domain, |p| charges(&Point::from((p - centre) * 1.5 / size)));
        let options = FitOptions {
            max_sources: 2500,
            ..FitOptions::default()
        };
        let fit = fitted(&boundary, &options);
        assert!(
            fit.report.boundary_error.rms < bound,
            "{file}: {:?}",
            fit.report.boundary_error
        );
    }
}

#[test]
fn sizes_whose_volumes_over_or_underflow_are_refused_and_others_fitted() {
    let sized = |size: f64| {
        let ball = shapes::sphere(size, 2);
        let boundary = BoundaryMap::new(ball.clone(), ball.vertices().to_vec()).unwrap();
        fit(&boundary, &FitOptions::default(), &|_| {})
    };
    for size in [1e-59, 1e59] {
        assert!(sized(size).unwrap().report.boundary_error.max < 1e-9, "{size:e}");
    }
    for size in [1e-61, 1e61] {
        assert!(matches!(sized(size), Err(FitError::OutOfScale { .. })), "{size:e}");
    }
}
