//! Queries on a wavy sphere of 82 000 triangles.

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::geometry::SurfaceQuery;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::{Point, sampling};

const QUERIES: usize = 20_000;

fn wavy_sphere() -> SurfaceMesh {
    let wave = |p: &Point| p * (1.0 + 0.1 * ((9.0 * p.x).sin() + (8.0 * p.y).cos() + (7.0 * p.z).sin()));
    shapes::deformed(&shapes::sphere(1.0, 6), wave)
}

/// Building the tree and the directions off the surface.
pub fn build(criterion: &mut Criterion) {
    let mesh = wavy_sphere();
    let mut group = criterion.benchmark_group("geometry/build");
    group.sample_size(10);
    group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
    group.bench_function("82k", |b| b.iter(|| SurfaceQuery::new(&mesh)));
    group.finish();
}

/// Distances of points within 0.02 of the surface, and of points in the box; one call for all.
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
