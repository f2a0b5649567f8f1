//! The pipeline by stage, on the polycube of the demonstration.

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::boundary_map::{BoundaryMap, examples};
use solidmap::energy::{EnergyOptions, Resolution, clipped_grid, energies};
use solidmap::fit::{DomainFactor, FitOptions, Solver, fit};
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::shapes;
use solidmap::solver::{DenseOptions, Method};

/// Frequencies of the bumpy sphere: 2.6k, 10k, 32k and 100k vertices.
const FREQUENCIES: [usize; 4] = [16, 32, 57, 100];
/// Boundary maps solved together.
const FRAMES: usize = 30;

fn pair() -> BoundaryMap {
    examples::polycube_to_animal(4)
}

/// A solid of `10·f² + 2` vertices, mapped to a sphere that is squeezed more in later frames.
fn bumpy(frequency: usize, frame: usize) -> BoundaryMap {
    let domain = shapes::bumpy_sphere(frequency);
    let squeezed = 1.0 - 0.01 * frame as f64;
    let image = shapes::projected_to_sphere(&domain, 1.0);
    let image = shapes::deformed(&image, |p| {
        solidmap::Point::new(squeezed * p.x, p.y, p.z + 0.1 * squeezed * p.x * p.x)
    });
    BoundaryMap::new(domain, image.vertices().to_vec()).expect("the meshes match")
}

fn dense(method: Method, sources: usize) -> FitOptions {
    FitOptions {
        max_sources: sources,
        solver: Solver::Dense(DenseOptions {
            method,
            ..DenseOptions::default()
        }),
        ..FitOptions::dense()
    }
}

fn factored(pair: &BoundaryMap, options: &FitOptions) -> DomainFactor {
    DomainFactor::new(pair.domain(), options, &|_| {}).expect("the pair is sound")
}

fn fitted(pair: &BoundaryMap) -> HarmonicMap {
    let factor = factored(pair, &dense(Method::Qr, 1000));
    factor.solve(pair, &|_| {}).expect("the pair is sound").map
}

/// Everything: checking, placing points, factoring, solving, measuring.
pub fn whole(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fit/whole");
    group.sample_size(10);
    for frequency in FREQUENCIES {
        let pair = bumpy(frequency, 0);
        let vertices = pair.domain().vertices().len();
        group.throughput(Throughput::Elements(vertices as u64));
        group.bench_function(BenchmarkId::new("schwarz", vertices), |b| {
            b.iter(|| fit(&pair, &FitOptions::default(), &|_| {}));
        });
    }
    group.finish();
}

/// Checking, placing points and factoring; three rows for a column.
pub fn factor(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fit/factor");
    group.sample_size(10);
    for frequency in FREQUENCIES {
        let pair = bumpy(frequency, 0);
        let vertices = pair.domain().vertices().len();
        group.throughput(Throughput::Elements(vertices as u64));
        group.bench_function(BenchmarkId::new("schwarz", vertices), |b| {
            b.iter(|| factored(&pair, &FitOptions::default()));
        });
    }
    let pair = pair();
    for (name, method, sizes) in [
        ("qr", Method::Qr, &[500, 1000, 2000][..]),
        ("svd", Method::Svd, &[500, 1000][..]),
    ] {
        for &sources in sizes {
            group.throughput(Throughput::Elements(sources as u64));
            group.bench_function(BenchmarkId::new(name, sources), |b| {
                b.iter(|| factored(&pair, &dense(method, sources)));
            });
        }
    }
    group.finish();
}

/// A new boundary map on a kept factorisation, with its error measured.
pub fn solve(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fit/solve");
    group.sample_size(10);
    for frequency in FREQUENCIES {
        let (first, second) = (bumpy(frequency, 0), bumpy(frequency, 1));
        let vertices = first.domain().vertices().len();
        let factor = factored(&first, &FitOptions::default());
        group.throughput(Throughput::Elements(vertices as u64));
        group.bench_function(BenchmarkId::new("schwarz", vertices), |b| {
            b.iter(|| factor.solve(&second, &|_| {}));
        });
    }
    let pair = pair();
    for sources in [500, 1000, 2000] {
        let factor = factored(&pair, &dense(Method::Qr, sources));
        group.throughput(Throughput::Elements(sources as u64));
        group.bench_function(BenchmarkId::new("qr", sources), |b| {
            b.iter(|| factor.solve(&pair, &|_| {}))
        });
    }
    group.finish();
}

/// The frames of a sequence on a kept factorisation, together and one by one.
pub fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fit/frames");
    group.sample_size(10);
    group.throughput(Throughput::Elements(FRAMES as u64));
    let frames: Vec<BoundaryMap> = (0..FRAMES).map(|frame| bumpy(32, frame)).collect();
    let factor = factored(&frames[0], &FitOptions::default());
    group.bench_function("together/10242", |b| b.iter(|| factor.solve_block(&frames, &|_| {})));
    group.bench_function("one by one/10242", |b| {
        b.iter(|| {
            frames
                .iter()
                .map(|frame| factor.solve(frame, &|_| {}))
                .collect::<Vec<_>>()
        });
    });
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
