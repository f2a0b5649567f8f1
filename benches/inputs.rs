//! Seeded inputs shared by all benchmarks.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use solidmap::{Point, Vector};

/// Points on a sphere of radius 1.1 about the origin, as sources lie around a domain.
pub fn sources(count: usize) -> Vec<Point> {
    let rng = &mut StdRng::seed_from_u64(1);
    (0..count).map(|_| Point::from(1.1 * direction(rng))).collect()
}

/// Points in the unit ball.
pub fn targets(count: usize) -> Vec<Point> {
    let rng = &mut StdRng::seed_from_u64(2);
    (0..count)
        .map(|_| Point::from(rng.random::<f64>().cbrt() * direction(rng)))
        .collect()
}

/// Coefficients of random sign.
pub fn weights(count: usize) -> Vec<[f64; 3]> {
    let rng = &mut StdRng::seed_from_u64(3);
    (0..count)
        .map(|_| [0; 3].map(|_| rng.random_range(-1.0..1.0)))
        .collect()
}

fn direction(rng: &mut StdRng) -> Vector {
    loop {
        let v = Vector::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if (1e-3..1.0).contains(&v.norm()) {
            return v.normalize();
        }
    }
}
