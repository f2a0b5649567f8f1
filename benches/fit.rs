//! The pipeline by stage, on the polycube of the demonstration.

use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::boundary_map::{BoundaryMap, examples};
use solidmap::energy::{AdaptiveOptions, EnergyOptions, GridResolution, adaptive_energies, clipped_grid, energies};
use solidmap::fit::{DomainFactor, FitMethod, FitOptions, FrameEvaluator, fit};
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::{SurfaceMesh, SurfacePoint, shapes};
use solidmap::solver::{Decomposition, DenseOptions};
use solidmap::{Point, Vector};

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
        Point::new(squeezed * p.x, p.y, p.z + 0.1 * squeezed * p.x * p.x)
    });
    BoundaryMap::new(domain, image.vertices().to_vec()).expect("the meshes match")
}

fn dense(decomposition: Decomposition, sources: usize) -> FitOptions {
    FitOptions {
        max_sources: sources,
        method: FitMethod::Dense {
            placement: FitMethod::default().placement(),
            options: DenseOptions {
                decomposition,
                ..DenseOptions::default()
            },
        },
        ..FitOptions::dense()
    }
}

fn factored(pair: &BoundaryMap, options: &FitOptions) -> DomainFactor {
    DomainFactor::new(pair.domain(), options, &|_| {}).expect("the pair is sound")
}

fn fitted(pair: &BoundaryMap) -> HarmonicMap {
    let factor = factored(pair, &dense(Decomposition::Qr, 1000));
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

/// Boundary values that are harmonic polynomials, at all points of the triangles, to several tolerances.
pub fn smooth(criterion: &mut Criterion) {
    let polynomials = |p: &Point| {
        Point::new(
            p.x * p.x - p.y * p.y + p.z,
            p.x * p.y * p.z + p.y,
            p.x.powi(3) - 3.0 * p.x * p.z * p.z,
        )
    };
    let mut group = criterion.benchmark_group("fit/smooth");
    group.sample_size(10);
    let domain = shapes::bumpy_sphere(FREQUENCIES[2]);
    let places: Vec<Point> = domain.vertices().iter().map(polynomials).collect();
    let image = SurfaceMesh::new(places, domain.triangles().to_vec()).expect("the same triangles");
    let bounds = image.bounding_box().expect("it has vertices");
    let surface = domain.clone();
    let value = move |p: &SurfacePoint| polynomials(&p.position(&surface, surface.vertices()));
    let pair = BoundaryMap::by_function(domain, bounds, value).expect("it is finite");
    for tolerance in [1e-3, 1e-4, 1e-5, 1e-6] {
        let options = FitOptions {
            tolerance,
            ..FitOptions::default()
        };
        group.bench_function(BenchmarkId::new("tolerance", tolerance), |b| {
            b.iter(|| fit(&pair, &options, &|_| {}));
        });
    }
    group.finish();
}

/// Checking, placing points and factoring. The dense systems have three rows for each column.
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
    for (name, decomposition, sizes) in [
        ("qr", Decomposition::Qr, &[500, 1000, 2000][..]),
        ("svd", Decomposition::Svd, &[500, 1000][..]),
    ] {
        for &sources in sizes {
            group.throughput(Throughput::Elements(sources as u64));
            group.bench_function(BenchmarkId::new(name, sources), |b| {
                b.iter(|| factored(&pair, &dense(decomposition, sources)));
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
        let factor = factored(&pair, &dense(Decomposition::Qr, sources));
        group.throughput(Throughput::Elements(sources as u64));
        group.bench_function(BenchmarkId::new("qr", sources), |b| {
            b.iter(|| factor.solve(&pair, &|_| {}))
        });
    }
    group.finish();
}

/// The frames of a sequence on a kept factorisation, together and one by one: of a swimming solid, whose frames are
/// made of few basis modes, and of one whose vertices tremble as well, so that no frame is made of others.
pub fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fit/frames");
    group.sample_size(10);
    group.throughput(Throughput::Elements(FRAMES as u64));
    let domain = shapes::bumpy_sphere(32);
    let factor = DomainFactor::new(&domain, &FitOptions::default(), &|_| {}).expect("the domain is sound");
    for (name, tremor) in [("swimming", 0.0), ("trembling", 0.002)] {
        let frames: Vec<BoundaryMap> = (0..FRAMES).map(|frame| swimming(&domain, frame, tremor)).collect();
        let vertices = domain.vertices().len();
        group.bench_function(format!("{name} together/{vertices}"), |b| {
            b.iter(|| factor.solve_block(&frames, &|_| {}))
        });
        group.bench_function(format!("{name} one by one/{vertices}"), |b| {
            b.iter(|| {
                frames
                    .iter()
                    .map(|frame| factor.solve(frame, &|_| {}))
                    .collect::<Vec<_>>()
            });
        });
    }
    group.finish();
}

/// Images of 20 000 fixed points in frames of a swimming solid, after those of a whole cycle.
pub fn frames_at_points(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("fit/frames_at_points");
    let domain = shapes::bumpy_sphere(32);
    let factor = DomainFactor::new(&domain, &FitOptions::default(), &|_| {}).expect("the domain is sound");
    let point = |i: usize| {
        let (t, r) = (i as f64, 0.6 * (i as f64 / 20_000.0).cbrt());
        Point::new(
            r * t.cos(),
            r * t.sin() * (0.3 * t).cos(),
            r * t.sin() * (0.3 * t).sin(),
        )
    };
    let points: Vec<Point> = (0..20_000).map(point).collect();
    let mut evaluator = FrameEvaluator::new(Arc::new(factor), &points, 300).expect("there are few points");
    let frames: Vec<Vec<Point>> = (0..3 * FRAMES)
        .map(|frame| swimming(&domain, frame, 0.0).image().to_vec())
        .collect();
    for frame in &frames {
        evaluator.evaluate(frame.clone(), &|_| {}).expect("the frame is sound");
    }
    let name = format!("{} modes/{} vertices", evaluator.modes(), domain.vertices().len());
    let mut next = frames.iter().cycle();
    group.bench_function(name, |b| {
        b.iter(|| evaluator.evaluate(next.next().expect("it is endless").clone(), &|_| {}));
    });
    group.finish();
}

/// A wave runs along the solid, which bends and twists.
fn swimming(domain: &SurfaceMesh, frame: usize, tremor: f64) -> BoundaryMap {
    let time = 0.2 * frame as f64;
    let noise = |seed: f64| (seed * 12.9898).sin() * 43758.5453;
    let swum = |(v, p): (usize, &Point)| {
        let (bend, twist) = (
            0.35 * p.x * (2.0 * p.x - time).sin(),
            0.5 * (1.5 * p.x - 0.7 * time).cos(),
        );
        let (cosine, sine) = (twist.cos(), twist.sin());
        let moved = Point::new(
            p.x - 0.1 * bend * bend,
            cosine * p.y - sine * p.z + bend,
            sine * p.y + cosine * p.z,
        );
        let tremble = |axis: usize| tremor * (noise((3 * v + axis) as f64 + 0.37 * frame as f64).fract() - 0.5);
        moved + Vector::new(tremble(0), tremble(1), tremble(2))
    };
    let image = domain.vertices().iter().enumerate().map(swum).collect();
    BoundaryMap::new(domain.clone(), image).expect("an image for each vertex")
}

/// Images and Jacobians of points of the domain's grid.
pub fn evaluate(criterion: &mut Criterion) {
    let pair = pair();
    let map = fitted(&pair);
    let grid = clipped_grid(pair.domain(), GridResolution::CellsAlongLongestSide(32)).expect("the domain is closed");
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
        let resolution_of = GridResolution::CellsAlongLongestSide(resolution);
        group.bench_function(BenchmarkId::new("grid", resolution), |b| {
            b.iter(|| clipped_grid(pair.domain(), resolution_of));
        });
        let grid = clipped_grid(pair.domain(), resolution_of).expect("the domain is closed");
        let (volume, target) = (grid.volume(), pair.target().volume());
        group.bench_function(BenchmarkId::new("both", resolution), |b| {
            b.iter(|| energies(&map, &grid, volume, target, &EnergyOptions::default()));
        });
        let accuracy = AdaptiveOptions {
            resolution: resolution_of,
            ..AdaptiveOptions::default()
        };
        group.bench_function(BenchmarkId::new("adaptive", resolution), |b| {
            b.iter(|| adaptive_energies(&map, pair.domain(), target, &EnergyOptions::default(), &accuracy));
        });
    }
    group.finish();
}
