//! The inner loops in plain Rust, with the square root and division of the machine. Four lanes at a time, which compilers
//! turn into whatever vectors the target has by default.

use std::array::from_fn;

use super::{BlockValues, LANES, Lanes, PackedSource, TargetBlock};

const WIDTH: usize = 4;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Portable;

/// A value for each target of a vector.
type Vector = [f64; WIDTH];

impl Lanes for Portable {
    fn add_potential(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 3]) {
        for vector in 0..targets.vectors(WIDTH) {
            let x = load(&targets.coordinates, vector);
            let mut sum = [[0.0; WIDTH]; 3];
            for source in sources {
                let g = reciprocal_norm(&difference(&x, source));
                for i in 0..3 {
                    add_scaled(&mut sum[i], source[3 + i], &g);
                }
            }
            add(&sum, sums, vector);
        }
    }

    fn add_gradient(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 12]) {
        for vector in 0..targets.vectors(WIDTH) {
            let x = load(&targets.coordinates, vector);
            let mut sum = [[0.0; WIDTH]; 12];
            for source in sources {
                let d = difference(&x, source);
                let g = reciprocal_norm(&d);
                let dg3 = d.map(|d| from_fn(|lane| d[lane] * (g[lane] * g[lane] * g[lane])));
                for i in 0..3 {
                    add_scaled(&mut sum[i], source[3 + i], &g);
                    for k in 0..3 {
                        add_scaled(&mut sum[3 + 3 * i + k], source[3 + i], &dg3[k]);
                    }
                }
            }
            add(&sum, sums, vector);
        }
    }

    fn write_column(self, source: [f64; 3], factor: f64, targets: &[TargetBlock], column: &mut [f64]) -> bool {
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
    1.0 / s.sqrt() + 0.0 * s
}

fn reciprocal_norm(d: &[Vector; 3]) -> Vector {
    let [x, y, z] = d;
    from_fn(|lane| reciprocal_sqrt(x[lane] * x[lane] + y[lane] * y[lane] + z[lane] * z[lane]))
}

fn difference(x: &[Vector; 3], source: &PackedSource) -> [Vector; 3] {
    from_fn(|axis| x[axis].map(|x| x - source[axis]))
}

fn add_scaled(sum: &mut Vector, factor: f64, values: &Vector) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += factor * value;
    }
}

fn load(lanes: &[BlockValues; 3], vector: usize) -> [Vector; 3] {
    lanes.each_ref().map(|lane| lane.as_chunks().0[vector])
}

fn add<const N: usize>(sum: &[Vector; N], sums: &mut [BlockValues; N], vector: usize) {
    for (sum, lane) in sum.iter().zip(sums) {
        add_scaled(&mut lane.as_chunks_mut().0[vector], 1.0, sum);
    }
}
