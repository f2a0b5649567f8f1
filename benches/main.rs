//! Benchmarks, named `group/stage/size` with throughput in elements: `cargo bench -- kernel/potential`.

use criterion::{criterion_group, criterion_main};

mod inputs;
mod kernel;

criterion_group!(benches, kernel::potential, kernel::gradient, kernel::assemble);
criterion_main!(benches);
