//! Benchmarks, named `group/stage/size` with throughput in elements: `cargo bench -- kernel/potential`.

use criterion::{criterion_group, criterion_main};

mod fit;
mod geometry;
mod inputs;
mod kernel;

criterion_group!(
    benches,
    kernel::potential,
    kernel::gradient,
    kernel::assemble,
    kernel::tree,
    kernel::fast,
    fit::factor,
    fit::solve,
    fit::evaluate,
    fit::energy,
    geometry::build,
    geometry::query,
    geometry::prepare
);
criterion_main!(benches);
