use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::loops::TILE;
use super::*;
use crate::Vector;
use crate::kernel::laplace::norm;
use crate::kernel::laplace_gradient;

/// How a random point of a test is placed.
#[derive(Debug, Clone, Copy)]
enum Cloud {
    Cube { scale: f64 },
    FarFromOrigin,
    Clustered,
    ManyScales,
}

const CLOUDS: [Cloud; 8] = [
    Cloud::Cube { scale: 1.0 },
    Cloud::Cube { scale: 1e-150 },
    Cloud::Cube { scale: 1e-25 },
    Cloud::Cube { scale: 1e25 },
    Cloud::Cube { scale: 1e150 },
    Cloud::FarFromOrigin,
    Cloud::Clustered,
    Cloud::ManyScales,
];

impl Cloud {
    fn points(self, count: usize, rng: &mut StdRng) -> Vec<Point> {
        let mut cube = |half: f64| Vector::from_fn(|_, _| rng.random_range(-half..half));
        (0..count)
            .map(|i| match self {
                Self::Cube { scale } => cube(1.0) * scale,
                Self::FarFromOrigin => Vector::new(1e6, -1e6, 3e6) + cube(1.0),
                // Eight corners with points 1e-9 from each other.
                Self::Clustered => Vector::from_fn(|axis, _| (i >> axis & 1) as f64) + cube(1e-9),
                // Distances from 1 to 1e-140: beyond what single precision can square, and within double.
                Self::ManyScales => cube(1.0) * 10f64.powi(-20 * (i as i32 % 8)),
            })
            .map(Point::from)
            .collect()
    }
}

fn weights(count: usize, rng: &mut StdRng) -> Vec<[f64; 3]> {
    (0..count)
        .map(|_| [0; 3].map(|_| rng.random_range(-1.0..1.0)))
        .collect()
}

/// The sums and the sums of absolute values of their terms, straight from the definition.
struct Plain {
    potential: Vector,
    potential_size: Vector,
    jacobian: Matrix3,
    jacobian_size: Vector,
}

fn plain(points: &[Point], weights: &[[f64; 3]], target: Point) -> Plain {
    let mut sums = Plain {
        potential: Vector::zeros(),
        potential_size: Vector::zeros(),
        jacobian: Matrix3::zeros(),
        jacobian_size: Vector::zeros(),
    };
    for (point, &w) in points.iter().zip(weights) {
        let (w, g, gradient) = (
            Vector::from(w),
            laplace_potential(target, *point),
            laplace_gradient(target, *point),
        );
        sums.potential += w * g;
        sums.potential_size += w.abs() * g;
        sums.jacobian += w * gradient.transpose();
        // Not `gradient.norm()`, whose squares underflow.
        sums.jacobian_size += w.abs() * norm(gradient);
    }
    sums
}

fn assert_agrees_with_plain_sum(points: &[Point], weights: &[[f64; 3]], targets: &[Point]) {
    // Each term is within a few units of 2⁻⁵³ and so is each of the at most 1,200 additions, but those are random.
    const TOLERANCE: f64 = 1e-13;
    let sources = Sources::new(points, weights).unwrap();
    for instructions in Instructions::available() {
        let name = instructions.name();
        let values = potential_with(instructions, &sources, targets);
        let (values_too, jacobians) = potential_and_gradient_with(instructions, &sources, targets);
        assert_eq!(
            (values.len(), values_too.len(), jacobians.len()),
            (targets.len(), targets.len(), targets.len())
        );
        for (t, target) in targets.iter().enumerate() {
            let expected = plain(points, weights, *target);
            for i in 0..3 {
                for value in [values[t][i], values_too[t][i]] {
                    let error = (value - expected.potential[i]).abs();
                    assert!(
                        error <= TOLERANCE * expected.potential_size[i],
                        "{name} {t} {i}: {value}, off by {error:e}"
                    );
                }
                let error = (jacobians[t].row(i) - expected.jacobian.row(i)).amax();
                assert!(
                    error <= TOLERANCE * expected.jacobian_size[i],
                    "{name} {t} {i}: off by {error:e}"
                );
            }
        }
    }
}

fn assert_bitwise_equal<const N: usize>(left: &[[f64; N]], right: &[[f64; N]]) {
    let bits = |rows: &[[f64; N]]| rows.iter().map(|row| row.map(f64::to_bits)).collect::<Vec<_>>();
    assert_eq!(bits(left), bits(right));
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn agrees_with_the_plain_sum(
        cloud in prop::sample::select(CLOUDS.to_vec()),
        source_count in 0usize..80,
        target_count in 0usize..80,
        seed: u64,
    ) {
        let rng = &mut StdRng::seed_from_u64(seed);
        let points = cloud.points(source_count, rng);
        let targets = cloud.points(target_count, rng);
        assert_agrees_with_plain_sum(&points, &weights(source_count, rng), &targets);
    }

    #[test]
    fn matrix_has_the_kernel_of_each_pair(
        cloud in prop::sample::select(CLOUDS.to_vec()),
        rows in 0usize..80,
        columns in 0usize..20,
        seed: u64,
    ) {
        let rng = &mut StdRng::seed_from_u64(seed);
        let (targets, sources) = (cloud.points(rows, rng), cloud.points(columns, rng));
        for instructions in Instructions::available() {
            let mut matrix = vec![f64::NAN; rows * columns];
            fill_matrix_with(instructions, &targets, &sources, &mut matrix).unwrap();
            for (i, entry) in matrix.iter().enumerate() {
                let expected = laplace_potential(targets[i % rows], sources[i / rows]);
                prop_assert!((entry / expected - 1.0).abs() < 1e-15, "{}: {entry} for {expected}", instructions.name());
            }
        }
    }
}

#[test]
fn agrees_with_the_plain_sum_over_several_tiles_and_chunks() {
    let rng = &mut StdRng::seed_from_u64(2);
    let cloud = Cloud::Cube { scale: 1.0 };
    let points = cloud.points(2 * TILE + 77, rng);
    let targets = cloud.points(2 * LANES * BLOCKS + 5, rng);
    assert_agrees_with_plain_sum(&points, &weights(points.len(), rng), &targets);
}

#[test]
fn agrees_with_the_plain_sum_where_targets_and_sources_differ_in_scale() {
    let rng = &mut StdRng::seed_from_u64(3);
    for (source_scale, target_scale) in [(1.0, 1e30), (1e30, 1.0), (1e-200, 1.0), (1.0, 1e-200), (1e-300, 1e100)] {
        let points = Cloud::Cube { scale: source_scale }.points(20, rng);
        let targets = Cloud::Cube { scale: target_scale }.points(20, rng);
        assert_agrees_with_plain_sum(&points, &weights(20, rng), &targets);
    }
}

#[test]
fn keeps_its_digits_where_the_squared_distance_underflows() {
    let at = |x: f64, y: f64| Point::new(x, y, 0.0);
    let points = [at(1.0, 0.0), at(1e-158, 2e-158), at(0.0, 0.0)];
    let targets = [at(3e-158, 1e-158), at(0.0, 1e-161)];
    let sources = Sources::new(&points, &[[1.0, 2.0, 3.0]; 3]).unwrap();
    for instructions in Instructions::available() {
        for (value, target) in potential_with(instructions, &sources, &targets).iter().zip(targets) {
            let expected: f64 = points.iter().map(|p| laplace_potential(target, *p)).sum();
            for (value, weight) in value.iter().zip([1.0, 2.0, 3.0]) {
                assert!((value / (expected * weight) - 1.0).abs() < 1e-15);
            }
        }
        let mut matrix = [0.0; 6];
        fill_matrix_with(instructions, &targets, &points, &mut matrix).unwrap();
        for (i, entry) in matrix.iter().enumerate() {
            assert!((entry / laplace_potential(targets[i % 2], points[i / 2]) - 1.0).abs() < 1e-15);
        }
    }
}

#[test]
fn only_the_target_that_is_a_source_is_not_finite() {
    let rng = &mut StdRng::seed_from_u64(4);
    let cloud = Cloud::Cube { scale: 1.0 };
    let (points, targets) = (cloud.points(30, rng), cloud.points(30, rng));
    for weight in [[1.0, -2.0, 3.0], [0.0; 3]] {
        let mut weights = weights(30, rng);
        weights[7] = weight;
        let mut with_source = targets.clone();
        with_source[11] = points[7];
        let sources = Sources::new(&points, &weights).unwrap();
        for instructions in Instructions::available() {
            let undisturbed = potential_and_gradient_with(instructions, &sources, &targets);
            let mut values = potential_with(instructions, &sources, &with_source);
            let (mut values_too, mut jacobians) = potential_and_gradient_with(instructions, &sources, &with_source);
            assert!(values[11].iter().chain(&values_too[11]).all(|v| !v.is_finite()));
            assert!(jacobians[11].iter().all(|v| !v.is_finite()));

            values.remove(11);
            values_too.remove(11);
            jacobians.remove(11);
            let (mut expected, mut expected_jacobians) = undisturbed;
            expected.remove(11);
            expected_jacobians.remove(11);
            assert_bitwise_equal(&values_too, &expected);
            assert!(values.iter().flatten().all(|v| v.is_finite()));
            assert_eq!(jacobians, expected_jacobians);
        }
    }
    for instructions in Instructions::available() {
        let mut matrix = [0.0; 2];
        fill_matrix_with(instructions, &[points[0], points[1]], &[points[0]], &mut matrix).unwrap();
        assert_eq!(matrix[0], f64::INFINITY);
        assert!(matrix[1].is_finite());
    }
}

#[test]
fn is_not_finite_where_coordinates_are_not() {
    let points = [Point::new(0.0, 0.5, 1.0), Point::new(-1.0, 0.0, 0.0)];
    let sources = Sources::new(&points, &[[1.0, 2.0, 3.0]; 2]).unwrap();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let target = Point::new(0.0, bad, 0.0);
        for instructions in Instructions::available() {
            let (values, jacobians) = potential_and_gradient_with(instructions, &sources, &[target]);
            assert!(values[0].iter().all(|v| !v.is_finite()));
            assert!(jacobians[0].iter().all(|v| !v.is_finite()));
            let mut matrix = [0.0; 4];
            fill_matrix_with(instructions, &[target, points[1]], &[points[0], target], &mut matrix).unwrap();
            assert_eq!(matrix.map(f64::is_finite), [false, true, false, false]);
        }
    }
}

#[test]
fn sum_of_no_sources_is_zero_and_no_targets_have_no_values() {
    let none = Sources::new(&[], &[]).unwrap();
    let one = Sources::new(&[Point::origin()], &[[1.0; 3]]).unwrap();
    assert!(none.is_empty() && one.len() == 1);
    assert_eq!(potential(&none, &[Point::origin()]), [[0.0; 3]]);
    assert_eq!(potential_and_gradient(&none, &[Point::origin()]).1, [Matrix3::zeros()]);
    assert!(potential(&one, &[]).is_empty());
    assert!(fill_matrix(&[], &[Point::origin()], &mut []).is_ok());
}

#[test]
fn results_do_not_depend_on_threads_nor_on_the_other_targets() {
    let rng = &mut StdRng::seed_from_u64(5);
    let cloud = Cloud::Cube { scale: 1.0 };
    let (points, targets) = (cloud.points(3000, rng), cloud.points(300, rng));
    let sources = Sources::new(&points, &weights(3000, rng)).unwrap();
    let on_threads = |threads: usize, instructions| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| potential_and_gradient_with(instructions, &sources, &targets))
    };
    for instructions in Instructions::available() {
        let (values, jacobians) = on_threads(1, instructions);
        let (values_4, jacobians_4) = on_threads(4, instructions);
        assert_bitwise_equal(&values, &values_4);
        assert_eq!(jacobians, jacobians_4);
        for t in [0, 7, 100, 299] {
            let alone = potential_with(instructions, &sources, &targets[t..=t]);
            let among = potential_with(instructions, &sources, &targets);
            assert_bitwise_equal(&alone, &among[t..=t]);
        }
    }
}

/// Many columns go by products with the kernel's matrix, few by sums: over several tiles of sources and blocks of
/// targets, with a pair of points at a distance whose square underflows.
#[test]
fn sums_of_many_columns_are_those_of_each() {
    let rng = &mut StdRng::seed_from_u64(11);
    let (sources, targets) = (2 * PRODUCT_TILE + 37, PRODUCT_ROWS + 19);
    let mut points = |count: usize| -> Vec<Point> {
        let coordinate = |rng: &mut StdRng| rng.random_range(-1.0..1.0);
        (0..count)
            .map(|_| Point::new(coordinate(rng), coordinate(rng), coordinate(rng)))
            .collect()
    };
    let (mut from, mut to) = (points(sources), points(targets));
    from[5] = Point::origin();
    to[3] = Point::new(1e-170, 0.0, 0.0);
    let columns = MOST_TRIPLED + 2;
    let weight = |i: usize| (i as f64 * 0.37).sin();
    let weights: Vec<f64> = (0..sources * columns).map(weight).collect();
    let (together, _) = sum_columns(&from, &weights, columns, &to, false).unwrap();
    for column in 0..columns {
        let own: Vec<f64> = weights.iter().skip(column).step_by(columns).copied().collect();
        let (alone, _) = sum_columns(&from, &own, 1, &to, false).unwrap();
        let sizes: Vec<f64> = own.iter().map(|w| w.abs()).collect();
        let (bounds, _) = sum_columns(&from, &sizes, 1, &to, false).unwrap();
        for (t, (expected, bound)) in alone.iter().zip(&bounds).enumerate() {
            let found = together[t * columns + column];
            assert!(
                (found - expected).abs() <= 1e-13 * bound,
                "{found} and {expected} at {t}"
            );
        }
    }
}

#[test]
fn rejects_arrays_of_different_length() {
    let error = Sources::new(&[Point::origin()], &[]).unwrap_err();
    assert_eq!(error.to_string(), "0 weights of sources were given where 1 are needed");
    let error = fill_matrix(&[Point::origin(); 2], &[Point::origin(); 3], &mut [0.0; 5]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "5 entries of the matrix were given where 6 are needed"
    );
}
