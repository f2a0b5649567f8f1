//! Queries on a wavy sphere of 82 000 triangles, and what sampling makes of a bumpy one of 100 000 vertices.

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::geometry::SurfaceQuery;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::sampling::{self, Anchors, SurfaceCells};
use solidmap::{Point, check};

const QUERIES: usize = 20_000;

fn wavy_sphere() -> SurfaceMesh {
    let wave = |p: &Point| p * (1.0 + 0.1 * ((9.0 * p.x).sin() + (8.0 * p.y).cos() + (7.0 * p.z).sin()));
    shapes::deformed(&shapes::sphere(1.0, 6), wave)
}

/// Building the tree and the pseudonormals.
pub fn build(criterion: &mut Criterion) {
    let mesh = wavy_sphere();
    let mut group = criterion.benchmark_group("geometry/build");
    group.sample_size(10);
    group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
    group.bench_function("82k", |b| b.iter(|| SurfaceQuery::new(&mesh)));
    group.finish();
}

/// Distances of points within 0.02 of the surface, and of points all over the unit ball (`box`); one call for all.
pub fn query(criterion: &mut Criterion) {
    let mesh = wavy_sphere();
    let query = SurfaceQuery::new(&mesh).expect("the sphere is closed");
    let near: Vec<Point> = sampling::held_out(&mesh, QUERIES, 0, 1)
        .iter()
        .enumerate()
        .map(|(k, p)| {
            let normal = mesh.area_vector(p.triangle as usize).normalize();
            p.position(&mesh, mesh.vertices()) + normal * 0.02 * (k as f64).sin()
        })
        .collect();
    let boxed = crate::inputs::targets(QUERIES);
    let mut group = criterion.benchmark_group("geometry");
    group.sample_size(10);
    group.throughput(Throughput::Elements(QUERIES as u64));
    for (name, points) in [("near", &near), ("box", &boxed)] {
        group.bench_function(BenchmarkId::new("signed_distance", name), |b| {
            b.iter(|| query.signed_distances(points));
        });
        group.bench_function(BenchmarkId::new("contains", name), |b| {
            b.iter(|| query.contains_all(points))
        });
    }
    group.finish();
}

/// All that is done before a solve: the check, the choice of anchors, the sources, and a refinement of a tenth.
pub fn prepare(criterion: &mut Criterion) {
    let mesh = shapes::bumpy_sphere(100);
    let anchors = Anchors::choose(&mesh, usize::MAX);
    let query = SurfaceQuery::with_winding_sign(&mesh).expect("the sphere is finite");
    let cells = SurfaceCells::of_anchors(&mesh, &anchors);
    let marked: Vec<bool> = (0..cells.len()).map(|cell| cell % 10 == 0).collect();
    let mut group = criterion.benchmark_group("sampling");
    group.sample_size(10);
    group.throughput(Throughput::Elements(mesh.vertices().len() as u64));
    group.bench_function("check/100k", |b| {
        b.iter(|| (check::check(&mesh, None), check::repair(&mesh)))
    });
    group.bench_function("anchors/all", |b| b.iter(|| Anchors::choose(&mesh, usize::MAX)));
    group.bench_function("anchors/quarter", |b| b.iter(|| Anchors::choose(&mesh, 25_000)));
    group.bench_function("sources/100k", |b| {
        b.iter(|| sampling::adaptive_sources(&mesh, &anchors, 1.0, &|balls| query.are_outside(balls)));
    });
    group.bench_function("refine/tenth", |b| b.iter(|| cells.clone().refine(&mesh, &marked)));
    group.finish();
}
