//! Benchmarks, named `group/stage/size` with throughput in elements: `cargo bench -- kernel/potential`.

use criterion::{criterion_group, criterion_main};

mod applications;
mod baseline;
mod boundary;
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
    baseline::finite_elements,
    baseline::mean_values,
    boundary::sphere,
    boundary::pair,
    fit::whole,
    fit::smooth,
    fit::factor,
    fit::solve,
    fit::frames,
    fit::frames_at_points,
    fit::evaluate,
    fit::energy,
    geometry::build,
    geometry::query,
    geometry::prepare,
    applications::regular_meshes,
    applications::preimages,
    applications::certificates
);
criterion_main!(benches);
