use nalgebra::Rotation3;
use rand::{Rng, SeedableRng, rngs::StdRng};

use super::*;
use crate::geometry::test_models;
use crate::mesh::{SurfaceMesh, shapes};

/// A ball with bumps and two horns of different length: no symmetry.
fn horned(frequency: usize) -> SurfaceMesh {
    let horn = |p: &Point, axis: Vector, height: f64| {
        let cosine = p.coords.normalize().dot(&axis.normalize());
        height * (8.0 * (cosine - 1.0)).exp()
    };
    shapes::deformed(&shapes::bumpy_sphere(frequency), |p| {
        let longer = horn(p, Vector::new(1.0, 0.2, 0.3), 1.2) + horn(p, Vector::new(-0.2, 1.0, 0.5), 0.6);
        Point::from(p.coords.component_mul(&Vector::new(1.1, 0.9, 0.8)) * (1.0 + longer))
    })
}

fn prepared(surface: &SurfaceMesh) -> AlignmentSurface {
    AlignmentSurface::new(surface, "domain").unwrap()
}

fn random_similarity(seed: u64) -> Similarity {
    let mut random = StdRng::seed_from_u64(seed);
    let mut vector = || Vector::from_fn(|_, _| random.random_range(-1.0..1.0));
    Similarity {
        scale: 10f64.powf(3.0 * vector().x),
        rotation: Rotation3::new(vector() * PI).into_inner(),
        translation: vector() * 10.0,
    }
}

fn moved(surface: &SurfaceMesh, by: &Similarity) -> SurfaceMesh {
    shapes::deformed(surface, |p| by.apply(p))
}

fn largest_difference(surface: &SurfaceMesh, a: &Similarity, b: &Similarity) -> f64 {
    let gaps = surface.vertices().iter().map(|p| (a.apply(p) - b.apply(p)).norm());
    gaps.fold(0.0, f64::max) / (b.scale * surface.diagonal())
}

#[test]
fn recovers_a_moved_turned_and_scaled_copy() {
    let surface = horned(10);
    for seed in 0..6 {
        let (first, second) = (random_similarity(seed), random_similarity(100 + seed));
        let (domain, target) = (moved(&surface, &first), moved(&surface, &second));
        let found = align(&prepared(&domain), &prepared(&target));
        let best = found.best[0];
        let error = largest_difference(&domain, &best.similarity, &second.after(&first.inverse()));
        assert!(error < 1e-8, "seed {seed}: {error:e}");
        assert!(best.residual < 1e-8 && !found.is_ambiguous() && !found.looks_mirrored());
    }
}

/// Sides are a ninth of the radius here, so that a chord is off a bump of a third of it by `h² / 8r` = 0.5 % of the
/// radius, which is a fifth of the diagonal.
#[test]
fn recovers_a_copy_of_other_connectivity_to_the_error_of_the_meshes() {
    let (domain, target) = (horned(9), moved(&horned(13), &random_similarity(5)));
    let found = align(&prepared(&domain), &prepared(&target));
    let error = largest_difference(&domain, &found.best[0].similarity, &random_similarity(5));
    assert!(error < 5e-3, "{error:e}");
    assert!(!found.looks_mirrored());
}

#[test]
fn detects_a_mirror_image() {
    let surface = horned(9);
    let mirrored = shapes::deformed(&surface, |p| Point::new(-p.x, p.y, p.z)).reversed();
    let found = align(&prepared(&surface), &prepared(&moved(&mirrored, &random_similarity(4))));
    assert!(found.looks_mirrored() && found.mirrored.residual < 1e-8);
    assert!(found.best.iter().all(|a| a.similarity.rotation.determinant() > 0.0));
    assert!(found.mirrored.similarity.rotation.determinant() < 0.0);
}

#[test]
fn symmetric_solids_have_ambiguous_alignments() {
    let brick = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 2.0 * p.y, 3.0 * p.z));
    let found = align(&prepared(&brick), &prepared(&brick));
    assert!(found.best.iter().filter(|a| a.residual < EXACT).count() == 4 && found.is_ambiguous());
    let cube = shapes::cube(1.0, 4);
    let turned = moved(&cube, &random_similarity(9));
    let found = align(&prepared(&cube), &prepared(&turned));
    assert!(found.best.len() == FINALISTS && found.is_ambiguous() && !found.looks_mirrored());
    assert!(found.best[1].residual < EXACT);
    let (fine, coarse) = (shapes::sphere(1.0, 3), shapes::sphere(2.0, 2));
    let found = align(&prepared(&fine), &prepared(&coarse));
    assert!(found.best[0].distance < 1e-2 && found.best[1].distance < 1e-2);
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let (a, b) = (
        prepared(&horned(7)),
        prepared(&shapes::polycube(&[[0, 0, 0], [1, 0, 0], [1, 1, 0]], 4)),
    );
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| align(&a, &b))
    };
    assert_eq!(with(1), with(4));
}

/// To the rounding of coordinates up to a thousand times as large as the solid, which the steps may amplify.
#[test]
fn is_equivariant_under_similarities_of_the_solids() {
    let bent = |p: &Point| Point::new(p.x + 0.2 * p.y * p.y, 1.3 * p.y, p.z + 0.1 * p.x * p.x);
    let (a, b) = (horned(7), shapes::deformed(&horned(8), bent));
    let (first, second) = (random_similarity(1), random_similarity(2));
    let plain = align(&prepared(&a), &prepared(&b)).best[0];
    let other = align(&prepared(&moved(&a, &first)), &prepared(&moved(&b, &second))).best[0];
    let expected = second.after(&plain.similarity);
    let error = largest_difference(&a, &other.similarity.after(&first), &expected);
    assert!(error < 1e-6, "{error:e}");
    assert!((plain.residual - other.residual).abs() < 1e-6);
}

#[test]
fn flat_and_thin_solids_are_aligned_and_those_without_area_refused() {
    let flat = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 2.0 * p.y, 0.0));
    let found = align(&prepared(&flat), &prepared(&horned(5)));
    assert!(found.best[0].residual.is_finite());
    let needle = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 1e-4 * p.y, 1e-4 * p.z));
    assert!(align(&prepared(&needle), &prepared(&needle)).best[0].residual < 1e-6);
    let line = shapes::deformed(&shapes::cube(1.0, 2), |p| Point::new(p.x, 0.0, 0.0));
    assert!(matches!(
        AlignmentSurface::new(&line, "target"),
        Err(AlignError::NoArea { side: "target" })
    ));
    assert!(matches!(
        AlignmentSurface::new(&SurfaceMesh::default(), "domain"),
        Err(AlignError::NoArea { .. })
    ));
    let bad = shapes::deformed(&shapes::cube(1.0, 2), |p| Point::new(p.x, f64::INFINITY, 0.0));
    assert!(matches!(
        AlignmentSurface::new(&bad, "domain"),
        Err(AlignError::NonFinite { side: "domain" })
    ));
}

#[test]
fn landmarks_decide_among_the_alignments_of_a_symmetric_solid() {
    let brick = shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(p.x, 2.0 * p.y, 3.0 * p.z));
    let half_turn = Rotation3::new(Vector::z() * PI).into_inner();
    let pairs: Vec<(Point, Point)> = brick.vertices()[..3].iter().map(|p| (*p, half_turn * p)).collect();
    let found = align_by_landmarks(&prepared(&brick), &prepared(&brick), &pairs).unwrap();
    assert!((found.best[0].similarity.rotation - half_turn).amax() < 1e-6);
}

#[test]
fn landmarks_that_leave_a_rotation_free_are_refused() {
    let b = prepared(&shapes::sphere(1.0, 2));
    let line: Vec<(Point, Point)> = (0..4)
        .map(|k| (Point::new(f64::from(k), 0.0, 0.0), Point::new(0.0, f64::from(k), 0.0)))
        .collect();
    assert_eq!(
        align_by_landmarks(&b, &b, &line[..2]),
        Err(AlignError::FewLandmarks { count: 2 })
    );
    assert!(matches!(
        align_by_landmarks(&b, &b, &line),
        Err(AlignError::CollinearLandmarks { side: "domain" })
    ));
}

/// The hands differ in the pose of their fingers by up to a tenth of the diagonal.
#[test]
fn shape_alone_brings_the_landmarks_of_two_hands_together() {
    let hands = ["pairs/hand_plain.obj", "pairs/hand_vulcan.obj"].map(test_models::load);
    let [Some(plain), Some(vulcan)] = hands else {
        return;
    };
    let found = align(&prepared(&plain), &prepared(&vulcan));
    assert!(!found.looks_mirrored() && !found.is_ambiguous());
    for (a, b) in [(1191, 5864), (658, 5319), (205, 4772), (2751, 4053), (1512, 3166)] {
        let gap = found.best[0].similarity.apply(&plain.vertices()[a]) - vulcan.vertices()[b];
        assert!(gap.norm() < 0.15 * vulcan.diagonal(), "{a} {b} {}", gap.norm());
    }
}

#[test]
fn a_surface_gets_the_extents_of_another() {
    let brick =
        |x: f64, y: f64, z: f64| shapes::deformed(&shapes::cube(1.0, 4), |p| Point::new(x * p.x, y * p.y, z * p.z));
    let (long, wide) = (brick(4.0, 1.0, 1.0), brick(1.0, 2.5, 3.0));
    let [from, to] = [&long, &wide].map(prepared);
    assert!(from.variances[1] < 0.5 * to.variances[1]);
    let stretched = prepared(&from.with_extents_of(&to, &long));
    for k in 0..3 {
        // Not equal: where a stretch changes areas, it changes their weights.
        let ratio = stretched.variances[k] / to.variances[k];
        assert!((0.75..1.33).contains(&ratio), "{k}: {ratio}");
    }
    // A flat surface stays flat, and one is made flatter by no more than a factor.
    let flat = brick(2.0, 1.0, 0.0);
    let squeezed = prepared(&flat).with_extents_of(&to, &flat);
    assert!(squeezed.vertices().iter().all(|p| p.iter().all(|c| c.is_finite())));
    let flattened = from.with_extents_of(&prepared(&flat), &long);
    assert!(flattened.volume() > 0.0);
}
