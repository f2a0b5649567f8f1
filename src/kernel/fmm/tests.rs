use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::*;
use crate::Vector;
use crate::kernel::{laplace_gradient, laplace_potential};

/// How the points of a test lie.
#[derive(Debug, Clone, Copy)]
enum Cloud {
    Cube,
    Sphere,
    /// Distances from the origin from 1e-4 to 1.
    Graded,
    /// Two balls of radius 1e-5 at a distance of 1.
    Clusters,
    Line,
    Plane,
}

const CLOUDS: [Cloud; 6] = [
    Cloud::Cube,
    Cloud::Sphere,
    Cloud::Graded,
    Cloud::Clusters,
    Cloud::Line,
    Cloud::Plane,
];

impl Cloud {
    fn points(self, count: usize, rng: &mut StdRng) -> Vec<Point> {
        let point = |i: usize| {
            let v = Vector::from_fn(|_, _| rng.random_range(-1.0..1.0));
            match self {
                Self::Cube => v,
                Self::Sphere => v.normalize(),
                Self::Graded => v.normalize() * 1e-4f64.powf(rng.random()),
                Self::Clusters => v * 1e-5 + Vector::repeat((i % 2) as f64),
                Self::Line => Vector::new(1.0, 0.5, 0.25) * v.x,
                Self::Plane => Vector::new(v.x, v.y, 0.0),
            }
        };
        (0..count).map(point).map(Point::from).collect()
    }
}

fn weights(count: usize, rng: &mut StdRng) -> Vec<f64> {
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// A tree with so few points in a leaf that sums of a few hundred points use all lists.
fn with_small_leaves(sources: &[Point], targets: &[Point], accuracy: f64) -> Fmm {
    let capacity = Capacity { sources: 6, targets: 9 };
    Fmm::with_capacity(
        sources,
        targets,
        resolution_for(accuracy),
        capacity,
        Thresholds { pairs: 0, points: 0 },
    )
    .unwrap()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Distance between the two, relative to the second.
fn relative_error(found: &[f64], expected: &[f64]) -> f64 {
    distance(found, expected) / distance(expected, &vec![0.0; expected.len()])
}

/// Norms over all targets and columns of `Σ_j |w_j| G` and `Σ_j |w_j| |∇G|`.
fn absolute_sums(sources: &[Point], weights: &[f64], columns: usize, targets: &[Point]) -> [f64; 2] {
    let mut squares = [0.0; 2];
    for target in targets {
        for column in 0..columns {
            let mut sums = [0.0; 2];
            for (source, row) in sources.iter().zip(weights.chunks(columns)) {
                sums[0] += row[column].abs() * laplace_potential(*target, *source);
                sums[1] += row[column].abs() * laplace_gradient(*target, *source).norm();
            }
            squares = [squares[0] + sums[0] * sums[0], squares[1] + sums[1] * sums[1]];
        }
    }
    squares.map(f64::sqrt)
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn reaches_its_accuracy_with_every_list_in_use(
        sources in prop::sample::select(CLOUDS.to_vec()),
        targets in prop::sample::select(CLOUDS.to_vec()),
        source_count in 50usize..400,
        target_count in 50usize..400,
        columns in prop::sample::select(vec![1, 2, 3, 5, 8]),
        accuracy in prop::sample::select(vec![1e-3, 1e-4, 1e-6, 1e-9]),
        seed in any::<u64>(),
    ) {
        let rng = &mut StdRng::seed_from_u64(seed);
        let (sources, targets) = (sources.points(source_count, rng), targets.points(target_count, rng));
        let weights = weights(source_count * columns, rng);
        let fmm = with_small_leaves(&sources, &targets, accuracy);
        let expected = direct::sum_columns(&sources, &weights, columns, &targets, true).unwrap();
        // Leaves this small leave little to the near part, which is exact, and sums of few points may cancel: so five
        // times the accuracy, relative to sums of absolute values.
        let sizes = absolute_sums(&sources, &weights, columns, &targets);
        let potential = fmm.potential(&weights, columns).unwrap();
        prop_assert!(distance(&potential, &expected.0) <= 5.0 * accuracy * sizes[0]);
        let (potential, gradient) = fmm.potential_and_gradient(&weights, columns).unwrap();
        prop_assert!(distance(&potential, &expected.0) <= 5.0 * accuracy * sizes[0]);
        prop_assert!(distance(&gradient, &expected.1) <= 50.0 * accuracy * sizes[1]);
    }

    #[test]
    fn never_panics_and_agrees_on_what_is_finite(
        exponents in prop::array::uniform2(prop::sample::select(vec![-300, -160, -20, 0, 20, 160, 300])),
        counts in prop::array::uniform2(0usize..40),
        seed in any::<u64>(),
    ) {
        let rng = &mut StdRng::seed_from_u64(seed);
        let mut cloud = |i: usize| -> Vec<Point> {
            let points = Cloud::Cube.points(counts[i], rng);
            points.into_iter().map(|p| p * 10f64.powi(exponents[i])).collect()
        };
        let (sources, targets) = (cloud(0), cloud(1));
        for (columns, accuracy) in [(1, 1e-6), (1, 1e-3), (8, 1e-3)] {
            let weights = weights(counts[0] * columns, rng);
            let fmm = with_small_leaves(&sources, &targets, accuracy);
            let alone = fmm.potential(&weights, columns).unwrap();
            let (potential, gradient) = fmm.potential_and_gradient(&weights, columns).unwrap();
            let expected = direct::sum_columns(&sources, &weights, columns, &targets, true).unwrap();
            let twice = expected.0.iter().chain(&expected.0).chain(&expected.1);
            for (found, expected) in alone.iter().chain(&potential).chain(&gradient).zip(twice) {
                prop_assert_eq!(found.is_finite(), expected.is_finite());
            }
            // Squares of such values may leave the range of f64.
            let largest = expected.0.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for (found, expected) in alone.iter().chain(&potential).zip(expected.0.iter().chain(&expected.0)) {
                prop_assert!((found - expected).abs() <= 10.0 * accuracy * largest);
            }
        }
    }
}

#[test]
fn reaches_its_accuracy_on_thousands_of_points_with_leaves_of_the_default_size() {
    let rng = &mut StdRng::seed_from_u64(2);
    for cloud in CLOUDS {
        let (sources, targets) = (cloud.points(6000, rng), cloud.points(5000, rng));
        let weights = weights(6000 * 3, rng);
        let expected = direct::sum_columns(&sources, &weights, 3, &targets, true).unwrap();
        let fmm = Fmm::new(&sources, &targets, 1e-4).unwrap();
        for accuracy in [1e-3, 1e-4, 1e-6, 1e-7, 1e-9] {
            let fmm = fmm.with_accuracy(accuracy);
            let alone = relative_error(&fmm.potential(&weights, 3).unwrap(), &expected.0);
            let (potential, gradient) = fmm.potential_and_gradient(&weights, 3).unwrap();
            let error = relative_error(&potential, &expected.0).max(alone);
            assert!(error <= accuracy, "{cloud:?} {accuracy:e}: {error:e}");
            let error = relative_error(&gradient, &expected.1);
            assert!(error <= 10.0 * accuracy, "{cloud:?} {accuracy:e}: gradient {error:e}");
        }
    }
}

#[test]
fn small_leaves_fill_all_lists() {
    let rng = &mut StdRng::seed_from_u64(3);
    let mut sources = Cloud::Graded.points(300, rng);
    sources.extend(Cloud::Plane.points(300, rng));
    let targets = Cloud::Sphere.points(500, rng);
    let lists = &with_small_leaves(&sources, &targets, 1e-2).geometry.lists;
    assert!(!lists.translations.is_empty());
    assert!((0..lists.leaves.len()).any(|leaf| !lists.near.row(leaf).is_empty()));
    assert!((0..lists.leaves.len()).any(|leaf| !lists.finer.row(leaf).is_empty()));
    assert!((0..lists.target_cells.len()).any(|slot| !lists.coarser.row(slot).is_empty()));
}

#[test]
fn results_do_not_depend_on_threads() {
    let rng = &mut StdRng::seed_from_u64(4);
    let (sources, targets) = (Cloud::Sphere.points(5000, rng), Cloud::Graded.points(6000, rng));
    for columns in [3, 8] {
        let weights = weights(5000 * columns, rng);
        let on_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let fmm = Fmm::new(&sources, &targets, 1e-4).unwrap();
                let (potential, gradient) = fmm.potential_and_gradient(&weights, columns).unwrap();
                [
                    bits(&fmm.potential(&weights, columns).unwrap()),
                    bits(&potential),
                    bits(&gradient),
                ]
            })
        };
        assert_eq!(on_threads(1), on_threads(2));
    }
}

#[test]
fn only_targets_that_are_sources_are_not_finite() {
    let rng = &mut StdRng::seed_from_u64(5);
    let sources = Cloud::Sphere.points(700, rng);
    let mut targets = Cloud::Cube.points(600, rng);
    for i in (0..600).step_by(7) {
        targets[i] = sources[i];
    }
    for (columns, accuracy) in [(1, 1e-6), (8, 1e-6), (1, 1e-4), (8, 1e-4)] {
        let mut weights = weights(700 * columns, rng);
        weights[7 * columns..8 * columns].fill(0.0);
        let fmm = with_small_leaves(&sources, &targets, accuracy);
        let (potential, gradient) = fmm.potential_and_gradient(&weights, columns).unwrap();
        let alone = fmm.potential(&weights, columns).unwrap();
        for (i, row) in potential.chunks(columns).enumerate() {
            let gradients = &gradient[3 * i * columns..][..3 * columns];
            for value in row.iter().chain(&alone[i * columns..][..columns]).chain(gradients) {
                assert_eq!(value.is_finite(), i % 7 != 0, "target {i}");
            }
        }
    }
}

/// Positions in single precision have seven digits: a distance that is a millionth of the leaf's size would have one.
#[test]
fn sources_close_to_a_target_are_summed_in_double_precision() {
    let rng = &mut StdRng::seed_from_u64(8);
    let sources = Cloud::Sphere.points(3000, rng);
    let mut targets = Cloud::Sphere.points(2000, rng);
    for i in (0..2000).step_by(400) {
        targets[i] = sources[i] + Vector::new(3e-7, -1e-7, 2e-7);
    }
    let weights = weights(3000, rng);
    let fmm = Fmm::new(&sources, &targets, 1e-4).unwrap();
    let found = fmm.potential(&weights, 1).unwrap();
    let (expected, _) = direct::sum_columns(&sources, &weights, 1, &targets, false).unwrap();
    for i in (0..2000).step_by(400) {
        let error = (found[i] / expected[i] - 1.0).abs();
        assert!(error < 1e-7, "target {i}: {error:e}");
    }
}

/// Values of the kernel are rounded to seven digits, and so are distances of a hundredth of the leaf to five: little
/// beside an accuracy of `1e-4`. Where nothing is translated across the tree, there is no other error.
#[test]
fn near_sums_with_a_kernel_in_single_precision_are_right_to_six_digits_and_linear_to_all() {
    let rng = &mut StdRng::seed_from_u64(9);
    let (sources, mut targets) = (Cloud::Sphere.points(2000, rng), Cloud::Sphere.points(1500, rng));
    targets.iter_mut().for_each(|p| *p *= 0.9);
    let capacity = Capacity {
        sources: 3000,
        targets: 3000,
    };
    let fmm = Fmm::with_capacity(&sources, &targets, resolution_for(1e-4), capacity, THRESHOLDS).unwrap();
    let weights = weights(2000 * 2, rng);
    let found = fmm.potential(&weights, 2).unwrap();
    let (expected, _) = direct::sum_columns(&sources, &weights, 2, &targets, false).unwrap();
    let error = relative_error(&found, &expected);
    // Not the bits of double precision, so that this is what is tested.
    assert!(error > 1e-12 && error < 2e-6, "{error:e}");
    let nearly: Vec<f64> = weights.iter().map(|w| w * (1.0 + 1e-9)).collect();
    let nearly: Vec<f64> = fmm
        .potential(&nearly, 2)
        .unwrap()
        .iter()
        .map(|v| v / (1.0 + 1e-9))
        .collect();
    let error = relative_error(&nearly, &found);
    assert!(error < 1e-13, "{error:e}");
}

#[test]
fn degenerate_sets_are_summed_as_directly() {
    let rng = &mut StdRng::seed_from_u64(6);
    let cube = Cloud::Cube.points(50, rng);
    let heap = vec![cube[0]; 500];
    let mut bad = cube.clone();
    bad[3].y = f64::NAN;
    bad[4].z = f64::INFINITY;
    let mut far = cube.clone();
    far[5] = Point::new(1e300, 0.0, -1e300);
    far[6] = Point::new(1e-310, 0.0, 0.0);
    let sets = [&vec![], &cube[..1].to_vec(), &cube, &heap, &bad, &far];
    for sources in sets {
        for targets in sets {
            let weights = weights(sources.len() * 2, rng);
            let fmm = with_small_leaves(sources, targets, 1e-9);
            let (potential, gradient) = fmm.potential_and_gradient(&weights, 2).unwrap();
            let expected = direct::sum_columns(sources, &weights, 2, targets, true).unwrap();
            for (found, expected) in potential
                .iter()
                .chain(&gradient)
                .zip(expected.0.iter().chain(&expected.1))
            {
                assert_eq!(found.is_finite(), expected.is_finite());
                assert!(!found.is_finite() || (found - expected).abs() <= 1e-7 * (1.0 + expected.abs()));
            }
        }
    }
}

#[test]
fn weights_of_any_size_are_within_single_precision() {
    let rng = &mut StdRng::seed_from_u64(7);
    let (sources, targets) = (Cloud::Cube.points(400, rng), Cloud::Cube.points(400, rng));
    let weights = weights(400, rng);
    let fmm = with_small_leaves(&sources, &targets, 1e-4);
    let expected = fmm.potential(&weights, 1).unwrap();
    for scale in [2f64.powi(-600), 2f64.powi(600)] {
        let scaled: Vec<f64> = weights.iter().map(|w| w * scale).collect();
        let found: Vec<f64> = fmm.potential(&scaled, 1).unwrap().iter().map(|v| v / scale).collect();
        assert_eq!(bits(&found), bits(&expected));
    }
}

#[test]
fn rejects_weights_of_another_number_of_sources() {
    let fmm = Fmm::new(&[Point::origin(); 3], &[Point::origin()], 1e-4).unwrap();
    let error = fmm.potential(&[1.0; 5], 2).unwrap_err();
    assert_eq!(error.to_string(), "5 weights of sources were given where 6 are needed");
}
