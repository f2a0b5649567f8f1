//! The inner loops in plain Rust, with the square root and division of the machine. Four lanes at a time, which compilers
//! turn into whatever vectors the target has by default.

use super::{Block, LANES, Lane, Lanes, Source};

const WIDTH: usize = 4;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Portable;

impl Lanes for Portable {
    fn add_potential(self, sources: &[Source], targets: &Block, sums: &mut [Lane; 3]) {
        for vector in 0..targets.vectors(WIDTH) {
            let x = load(&targets.coordinates, vector);
            let mut sum = [[0.0; WIDTH]; 3];
            for source in sources {
                for lane in 0..WIDTH {
                    let [x, y, z] = difference(&x, lane, source);
                    let g = reciprocal_sqrt(x * x + y * y + z * z);
                    for i in 0..3 {
                        sum[i][lane] += source[3 + i] * g;
                    }
                }
            }
            add(&sum, sums, vector);
        }
    }

    fn add_gradient(self, sources: &[Source], targets: &Block, sums: &mut [Lane; 12]) {
        for vector in 0..targets.vectors(WIDTH) {
            let x = load(&targets.coordinates, vector);
            let mut sum = [[0.0; WIDTH]; 12];
            for source in sources {
                for lane in 0..WIDTH {
                    let d = difference(&x, lane, source);
                    let g = reciprocal_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
                    let g3 = g * g * g;
                    for i in 0..3 {
                        let w = source[3 + i];
                        sum[i][lane] += w * g;
                        for k in 0..3 {
                            sum[3 + 3 * i + k][lane] += w * g3 * d[k];
                        }
                    }
                }
            }
            add(&sum, sums, vector);
        }
    }

    fn write_column(self, source: [f64; 3], factor: f64, targets: &[Block], column: &mut [f64]) -> bool {
        let mut check = 0.0;
        for (block, out) in targets.iter().zip(column.chunks_mut(LANES)) {
            let [xs, ys, zs] = &block.coordinates;
            for (((out, x), y), z) in out.iter_mut().zip(xs).zip(ys).zip(zs) {
                let [x, y, z] = [x - source[0], y - source[1], z - source[2]];
                *out = factor * reciprocal_sqrt(x * x + y * y + z * z);
                check += *out;
            }
        }
        check.is_finite()
    }
}

/// `1/√s`; NaN for infinity, which here means that a coordinate was not finite, not that a source is too far to matter.
fn reciprocal_sqrt(s: f64) -> f64 {
    1.0 / s.sqrt() + (s - s)
}

fn difference(x: &[[f64; WIDTH]; 3], lane: usize, source: &Source) -> [f64; 3] {
    [x[0][lane] - source[0], x[1][lane] - source[1], x[2][lane] - source[2]]
}

fn load(lanes: &[Lane; 3], vector: usize) -> [[f64; WIDTH]; 3] {
    lanes.each_ref().map(|lane| lane.as_chunks().0[vector])
}

fn add<const N: usize>(sum: &[[f64; WIDTH]; N], sums: &mut [Lane; N], vector: usize) {
    for (sum, lane) in sum.iter().zip(sums) {
        for (value, lane) in sum.iter().zip(&mut lane.as_chunks_mut::<WIDTH>().0[vector]) {
            *lane += value;
        }
    }
}
