//! The pipeline by stage, on the polycube of the demonstration.

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::boundary_map::{BoundaryMap, examples};
use solidmap::energy::{EnergyOptions, Resolution, clipped_grid, energies};
use solidmap::fit::{DomainFactor, FitOptions, Placement};
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::solver::{DenseOptions, Method};

fn pair() -> BoundaryMap {
    examples::polycube_to_animal(4)
}

fn options(method: Method, sources: usize) -> FitOptions {
    let solver = DenseOptions {
        method,
        ..DenseOptions::default()
    };
    FitOptions {
        placement: Placement::Adaptive { alpha: 1.0 },
        max_sources: sources,
        solver,
        ..FitOptions::default()
    }
}

fn fitted(pair: &BoundaryMap) -> HarmonicMap {
    let factor = DomainFactor::new(pair.domain(), &options(Method::Qr, 1000), &|_| {}).expect("the pair is sound");
    factor.solve(pair, &|_| {}).expect("the pair is sound").map
}

/// Checking, placing points, assembling and decomposing; three rows for a column.
pub fn factor(criterion: &mut Criterion) {
    let pair = pair();
    let mut group = criterion.benchmark_group("fit/factor");
    group.sample_size(10);
    for (name, method, sizes) in [
        ("qr", Method::Qr, &[500, 1000, 2000][..]),
        ("svd", Method::Svd, &[500, 1000][..]),
    ] {
        for &sources in sizes {
            group.throughput(Throughput::Elements(sources as u64));
            group.bench_function(BenchmarkId::new(name, sources), |b| {
                b.iter(|| DomainFactor::new(pair.domain(), &options(method, sources), &|_| {}));
            });
        }
    }
    group.finish();
}

/// A new boundary map on a kept decomposition, with its error measured.
pub fn solve(criterion: &mut Criterion) {
    let pair = pair();
    let mut group = criterion.benchmark_group("fit/solve");
    group.sample_size(10);
    for sources in [500, 1000, 2000] {
        let factor = DomainFactor::new(pair.domain(), &options(Method::Qr, sources), &|_| {});
        let factor = factor.expect("the pair is sound");
        group.throughput(Throughput::Elements(sources as u64));
        group.bench_function(BenchmarkId::new("qr", sources), |b| {
            b.iter(|| factor.solve(&pair, &|_| {}))
        });
    }
    group.finish();
}

/// Images and Jacobians of points of the domain's grid.
pub fn evaluate(criterion: &mut Criterion) {
    let pair = pair();
    let map = fitted(&pair);
    let grid = clipped_grid(pair.domain(), Resolution::CellsAlongLongestSide(32)).expect("the domain is closed");
    let mut group = criterion.benchmark_group("map");
    group.throughput(Throughput::Elements(grid.points().len() as u64));
    group.bench_function("evaluate/1000", |b| b.iter(|| map.evaluate(grid.points())));
    group.bench_function("jacobian/1000", |b| b.iter(|| map.jacobian(grid.points())));
    group.finish();
}

/// The quadrature of a clipped grid, and both energies on it.
pub fn energy(criterion: &mut Criterion) {
    let pair = pair();
    let map = fitted(&pair);
    let mut group = criterion.benchmark_group("energy");
    group.sample_size(10);
    for resolution in [32, 64] {
        let resolution_of = Resolution::CellsAlongLongestSide(resolution);
        group.bench_function(BenchmarkId::new("grid", resolution), |b| {
            b.iter(|| clipped_grid(pair.domain(), resolution_of));
        });
        let grid = clipped_grid(pair.domain(), resolution_of).expect("the domain is closed");
        let (volume, target) = (grid.volume(), pair.target().volume());
        group.bench_function(BenchmarkId::new("both", resolution), |b| {
            b.iter(|| energies(&map, &grid, volume, target, &EnergyOptions::default()));
        });
    }
    group.finish();
}
