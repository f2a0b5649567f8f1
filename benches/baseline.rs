//! The other methods: finite elements on a tet mesh, descent on the same mesh, and mean value coordinates.

use criterion::{Criterion, Throughput};
use solidmap::baseline::MeanValueMap;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{GridResolution, clipped_grid};
use solidmap::map::VolumeMap;
use solidmap::mesh::shapes;

/// A solid of 2562 vertices, mapped to a sphere.
fn pair() -> BoundaryMap {
    let domain = shapes::bumpy_sphere(16);
    let image = shapes::projected_to_sphere(&domain, 1.0).vertices().to_vec();
    BoundaryMap::new(domain, image).expect("an image for each vertex")
}

/// Assembling and factoring, a solve on the kept factor, and a descent to the same energy.
#[cfg(feature = "native")]
pub fn finite_elements(criterion: &mut Criterion) {
    use solidmap::baseline::{DescentOptions, HarmonicOptions, TetHarmonic, TetLaplacian, boundary_images};
    use solidmap::compare::{MeshSpec, make_mesh};
    let pair = pair();
    let (mesh, pair) = make_mesh(&pair, &MeshSpec::of(pair.domain())).expect("the solid is sound");
    let images = boundary_images(&mesh, &pair).expect("the mesh is the domain's").images;
    let options = HarmonicOptions::default();
    let tets = mesh.tets().len();
    let mut group = criterion.benchmark_group("baseline");
    group.sample_size(10);
    group.throughput(Throughput::Elements(tets as u64));
    group.bench_function(format!("fem factor/{tets} tets"), |b| {
        b.iter(|| TetHarmonic::new(mesh.clone(), &options))
    });
    let factor = TetHarmonic::new(mesh.clone(), &options).expect("no tetrahedron is flat");
    group.bench_function(format!("fem solve/{tets} tets"), |b| b.iter(|| factor.solve(&images)));
    let descent = TetLaplacian::new(mesh).expect("no tetrahedron is flat");
    group.bench_function(format!("descent/{tets} tets"), |b| {
        b.iter(|| descent.solve(&images, &DescentOptions::default(), &|_, _| {}))
    });
    group.finish();
}

/// Nothing without a mesher.
#[cfg(not(feature = "native"))]
pub fn finite_elements(_: &mut Criterion) {}

/// Images and Jacobians of points of the domain's grid.
pub fn mean_values(criterion: &mut Criterion) {
    let pair = pair();
    let grid = clipped_grid(pair.domain(), GridResolution::CellsAlongLongestSide(16)).expect("the domain is closed");
    let map = MeanValueMap::new(&pair).expect("the domain is closed");
    let pairs = grid.points().len() * pair.domain().triangles().len();
    let mut group = criterion.benchmark_group("baseline");
    group.sample_size(10);
    group.throughput(Throughput::Elements(pairs as u64));
    group.bench_function("mean values", |b| b.iter(|| map.evaluate(grid.points())));
    group.bench_function("mean value Jacobians", |b| b.iter(|| map.jacobian(grid.points())));
    group.finish();
}
