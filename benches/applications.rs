//! What maps are for: regular meshes of the built-in polycube, preimages, and proofs that the map is one to one.

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::boundary_map::examples;
use solidmap::certificate::{CertificateOptions, certify};
use solidmap::fit::{Fit, FitOptions, fit};
use solidmap::inverse::{InverseMap, InverseOptions};
use solidmap::map::VolumeMap;
use solidmap::remesh::{CellKind, CellSize, RemeshOptions, RemeshSource, remesh};

use super::inputs;

fn animal() -> Fit {
    fit(&examples::polycube_to_animal(4), &FitOptions::default(), &|_| {}).expect("the built-in pair fits")
}

/// From the polycube to the mesh and its report, repair and polish included.
pub fn regular_meshes(criterion: &mut Criterion) {
    let fit = animal();
    let mut group = criterion.benchmark_group("applications/remesh");
    group.sample_size(10);
    for (name, kind) in [("tets", CellKind::Tets), ("hexes", CellKind::Hexes)] {
        for cells in [16, 32] {
            let source = RemeshSource::Regular {
                kind,
                size: CellSize::Along(cells),
                most_cells: 1_000_000,
            };
            let run = || {
                remesh(
                    &fit.boundary,
                    &fit.map,
                    source.clone(),
                    &RemeshOptions::default(),
                    &|_| {},
                )
            };
            let count = run().expect("the built-in domain is a polycube").report.cells;
            group.throughput(Throughput::Elements(count as u64));
            group.bench_function(BenchmarkId::new(name, cells), |b| b.iter(run));
        }
    }
    group.finish();
}

/// Preimages of images of points, with the seed mesh made beforehand.
pub fn preimages(criterion: &mut Criterion) {
    let fit = animal();
    let inverse = InverseMap::new(&fit.map, &fit.boundary, &InverseOptions::default()).expect("the target is closed");
    let mut group = criterion.benchmark_group("applications/preimages");
    group.sample_size(10);
    for count in [1_000, 10_000] {
        let points = fit.map.evaluate(&inputs::targets(count));
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::from_parameter(count), |b| {
            b.iter(|| inverse.preimages(&points))
        });
    }
    group.finish();
}

/// Proofs over an octree of at most `finest` cells along the longest side.
pub fn certificates(criterion: &mut Criterion) {
    let fit = animal();
    let volume = fit.boundary.target_volume();
    let mut group = criterion.benchmark_group("applications/certify");
    group.sample_size(10);
    for finest in [64, 256] {
        let options = CertificateOptions {
            finest,
            ..CertificateOptions::default()
        };
        group.bench_function(BenchmarkId::from_parameter(finest), |b| {
            b.iter(|| certify(&fit.map, fit.boundary.domain(), volume, &options, &|_| {}));
        });
    }
    group.finish();
}
