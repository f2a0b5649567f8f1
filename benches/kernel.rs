//! Sums and matrices of the kernel; an element is a pair of a source and a target.
//!
//! The fastest instructions of the machine run under the size alone, the others under `size/instructions`. Set
//! `RAYON_NUM_THREADS=1` for rates per core.

use std::hint::black_box;

use criterion::{Criterion, SamplingMode, Throughput};
use solidmap::Point;
use solidmap::kernel::direct::{self, Instructions, Sources};
use solidmap::kernel::fmm::Fmm;

use crate::inputs;

const SIZES: [(usize, usize); 3] = [(300, 300), (2_000, 2_000), (50_000, 2_000)];

pub fn potential(criterion: &mut Criterion) {
    sums(criterion, "kernel/potential", |instructions, sources, targets| {
        black_box(direct::potential_with(instructions, sources, targets));
    });
}

pub fn gradient(criterion: &mut Criterion) {
    sums(criterion, "kernel/gradient", |instructions, sources, targets| {
        black_box(direct::potential_and_gradient_with(instructions, sources, targets));
    });
}

/// The matrix is allocated once: the first touch of fresh memory costs more than the kernel.
pub fn assemble(criterion: &mut Criterion) {
    each(
        criterion,
        "kernel/assemble",
        &[(300, 1_000), (3_000, 5_000)],
        |sources, targets| {
            let (sources, targets) = (inputs::sources(sources), inputs::targets(targets));
            let mut matrix = vec![0.0; sources.len() * targets.len()];
            move |instructions| {
                let filled = direct::fill_matrix_with(instructions, &targets, &sources, black_box(&mut matrix));
                filled.expect("the matrix has an entry for each pair");
            }
        },
    );
}

/// One pass of three columns through a tree built beforehand, at two accuracies; an element is a target.
pub fn fast(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kernel/fast");
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    for (sources, targets) in [(10_000, 10_000), (100_000, 100_000), (134_000, 403_000)] {
        group.throughput(Throughput::Elements(targets as u64));
        let (points, places) = (inputs::sources(sources), inputs::targets(targets));
        let weights: Vec<f64> = inputs::weights(sources).into_iter().flatten().collect();
        for accuracy in [1e-4, 1e-6] {
            let fmm = Fmm::new(&points, &places, accuracy).expect("few enough points");
            group.bench_function(format!("{sources}x{targets}/{accuracy:e}"), |bencher| {
                bencher.iter(|| black_box(fmm.potential(&weights, 3).expect("a weight for each source")));
            });
            group.bench_function(format!("{sources}x{targets}/{accuracy:e}/gradient"), |bencher| {
                bencher.iter(|| {
                    black_box(
                        fmm.potential_and_gradient(&weights, 3)
                            .expect("a weight for each source"),
                    )
                });
            });
        }
    }
}

/// Sorting points into a tree; an element is a point.
pub fn tree(criterion: &mut Criterion) {
    let (sources, targets) = (inputs::sources(100_000), inputs::targets(100_000));
    let mut group = criterion.benchmark_group("kernel/tree");
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.throughput(Throughput::Elements(200_000));
    group.bench_function("100000x100000", |bencher| {
        bencher.iter(|| black_box(Fmm::new(&sources, &targets, 1e-6).expect("few enough points")));
    });
}

fn sums(criterion: &mut Criterion, name: &str, sum: impl Fn(Instructions, &Sources, &[Point])) {
    each(criterion, name, &SIZES, |sources, targets| {
        let packed = Sources::new(&inputs::sources(sources), &inputs::weights(sources)).expect("as many weights");
        let (targets, sum) = (inputs::targets(targets), &sum);
        move |instructions| sum(instructions, &packed, &targets)
    });
}

fn each<R: FnMut(Instructions)>(
    criterion: &mut Criterion,
    name: &str,
    sizes: &[(usize, usize)],
    prepare: impl Fn(usize, usize) -> R,
) {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(20).sampling_mode(SamplingMode::Flat);
    for &(sources, targets) in sizes {
        group.throughput(Throughput::Elements((sources * targets) as u64));
        let mut routine = prepare(sources, targets);
        for (i, instructions) in Instructions::available().enumerate() {
            let size = format!("{sources}x{targets}");
            let id = if i == 0 {
                size
            } else {
                format!("{size}/{}", instructions.name())
            };
            group.bench_function(id, |bencher| bencher.iter(|| routine(instructions)));
        }
    }
}
