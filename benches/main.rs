//! Benchmarks, named `group/stage/size` with throughput in elements: `cargo bench -- kernel/potential`.

use criterion::{criterion_group, criterion_main};

mod fit;
mod inputs;
mod kernel;

criterion_group!(
    benches,
    kernel::potential,
    kernel::gradient,
    kernel::assemble,
    fit::factor,
    fit::solve,
    fit::evaluate,
    fit::energy
);
criterion_main!(benches);
