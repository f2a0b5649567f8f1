//! What several of the tests share.
#![allow(dead_code)]

pub mod stress;

use std::path::PathBuf;

use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::Point;
use solidmap::bijective::make_bijective;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{AdaptiveOptions, EnergyOptions, adaptive_energies};
use solidmap::fit::{Fit, FitOptions, fit};
use solidmap::geometry::SurfaceQuery;
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::{CellList, SurfaceMesh, SurfacePoint, TetMesh, shapes};
use solidmap::remesh::{CellKind, CellSize, Polycube, RemeshOptions, regular_mesh};

/// Solids of every kind the method must handle, coarse (`level` 0) to fine.
pub fn solids(level: u32) -> Vec<(&'static str, SurfaceMesh)> {
    let n = 1 << level;
    vec![
        ("ball", shapes::sphere(1.0, 2 + level)),
        ("torus", shapes::torus(1.0, 0.4, 20 * n, 9 * n)),
        ("cube", shapes::cube(1.5, 5 * n)),
        ("shell with a cavity", shapes::spherical_shell(1.0, 0.5, 2 + level)),
        ("genus 2", shapes::deformed(&shapes::double_torus(2 * n), |p| p * 0.5)),
    ]
}

/// The boundary map of a formula.
pub fn boundary_map(domain: &SurfaceMesh, f: impl Fn(&Point) -> Point) -> BoundaryMap {
    BoundaryMap::new(domain.clone(), domain.vertices().iter().map(f).collect()).unwrap()
}

/// A bend about the y axis that is harmonic: its two coordinates are `x + a (x² − z²)` and `z − 2 a x z`.
pub fn bent(a: f64) -> impl Fn(&Point) -> Point {
    move |p| Point::new(p.x + a * (p.x * p.x - p.z * p.z), p.y, p.z - 2.0 * a * p.x * p.z)
}

/// A box of 5 by 2 by 2 about the origin, its sides divided into eight.
pub fn rod() -> SurfaceMesh {
    shapes::deformed(&shapes::cube(2.0, 8), |p| Point::new(2.5 * p.x, p.y, p.z))
}

/// The rod of [`rod`] bent into a horseshoe of 290 degrees. Its harmonic map folds at the inner side: on the cross-section
/// the distance `f` from the axis has `Δf = f` and is `3 + y` on the boundary. Its slope there, 1 on the boundary, is
/// lowered by that of `Δg = -3`, `g = 0` on the boundary, some 0.6 · 3 in the middle of a side of a square of this size.
pub fn horseshoe(p: &Point) -> Point {
    let radius = 3.0 + p.y;
    Point::new(radius * p.x.sin(), radius * p.x.cos(), p.z)
}

/// A regular mesh of a polycube, of so many boxes along its longest side.
pub fn tets_of(polycube: &SurfaceMesh, cells: usize) -> TetMesh {
    let polycube = Polycube::of(polycube).unwrap();
    let size = CellSize::Along(cells).of(&polycube);
    let mesh = regular_mesh(&polycube, size, CellKind::Tets, 1_000_000).unwrap();
    let CellList::Tets(tets) = mesh.cells().clone() else {
        panic!("asked for tetrahedra");
    };
    TetMesh::new(mesh.nodes().to_vec(), tets).unwrap()
}

/// The mesh without its first triangle and that one's first neighbour: a hole of four edges.
pub fn with_hole(mesh: &SurfaceMesh) -> SurfaceMesh {
    let triangles = mesh.triangles();
    let shared = |t: usize| triangles[t].iter().filter(|v| triangles[0].contains(v)).count();
    let neighbour = (1..triangles.len()).find(|&t| shared(t) == 2).unwrap();
    let kept = (1..triangles.len()).filter(|&t| t != neighbour).map(|t| triangles[t]);
    SurfaceMesh::new(mesh.vertices().to_vec(), kept.collect()).unwrap()
}

/// A fit that must succeed, without progress.
pub fn fitted(boundary: &BoundaryMap, options: &FitOptions) -> Fit {
    fit(boundary, options, &|_| {}).unwrap()
}

/// Random points inside, seeded.
pub fn interior_points(domain: &SurfaceMesh, count: usize, seed: u64) -> Vec<Point> {
    let query = SurfaceQuery::new(domain).unwrap();
    let (low, high) = domain.bounding_box().unwrap();
    let mut random = StdRng::seed_from_u64(seed);
    let mut points = Vec::new();
    while points.len() < count {
        let p = Point::from(std::array::from_fn::<f64, 3, _>(|k| {
            random.random_range(low[k]..high[k])
        }));
        if query.contains(&p) {
            points.push(p);
        }
    }
    points
}

/// The largest distance between two lists of points.
pub fn largest_distance(a: &[Point], b: &[Point]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
}

/// The folder of real models; says on standard error when it is missing and tests are skipped.
pub fn models() -> Option<PathBuf> {
    let folder = std::env::var_os("SOLIDMAP_MODELS").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("SKIPPED: SOLIDMAP_MODELS does not name the folder of real models");
    }
    folder
}

/// There and back within 1e-9 of the diagonals: by the map and its inverse, at points of both surfaces.
pub fn assert_round_trips(map: &BoundaryMap) {
    let inverse = map.inverse().unwrap();
    let target = map.target_surface().unwrap();
    for (there, back, from) in [(map, &inverse, map.domain()), (&inverse, map, target)] {
        let points = points_of(from);
        let returned = back.evaluate(&there.evaluate_on_target(&points).unwrap());
        let farthest = largest_distance(&there.positions(&points), &returned);
        assert!(farthest < 1e-9 * from.diagonal(), "{farthest}");
    }
}

/// A corner of every triangle, the middle of a side, and a point inside.
pub fn points_of(surface: &SurfaceMesh) -> Vec<SurfacePoint> {
    let of_triangle = |triangle: u32| {
        [[1.0, 0.0, 0.0], [0.5, 0.0, 0.5], [0.2, 0.7, 0.1]].map(|barycentric| SurfacePoint { triangle, barycentric })
    };
    (0..surface.triangles().len() as u32).flat_map(of_triangle).collect()
}

/// A fitted map has energies over its domain, and becomes a bijection over this mesh: points go there and back.
pub fn assert_measured_and_bijective(boundary: &BoundaryMap, map: &HarmonicMap, mesh: TetMesh) {
    let (options, accuracy) = (EnergyOptions::default(), AdaptiveOptions::default());
    let energies = adaptive_energies(map, boundary.domain(), boundary.target_volume(), &options, &accuracy);
    let (_, energies) = energies.unwrap();
    // An isometry has 3; a much larger energy would mean that the fit or the boundary map is wrong.
    assert!((2.5..30.0).contains(&energies.harmonic), "{}", energies.harmonic);
    assert!(energies.deformation > 0.0);
    let made = make_bijective(boundary, map, mesh, &RemeshOptions::default(), None, &|_| {}).unwrap();
    let points = interior_points(boundary.domain(), 2000, 5);
    let (_, back) = made.map.preimages(&made.map.evaluate(&points));
    assert_eq!(back.ok, 2000, "{back:?}");
    assert!(back.round_trip_max <= 1e-12, "{back:?}");
}
