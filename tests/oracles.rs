//! Queries of this crate against those of CGAL and TetGen.

use crate::common::{models, solids};
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::Point;
use solidmap::cgal_tetgen::{Mesh3Options, SignedDistanceField, TetOptions, tetrahedralize, tetrahedralize_mesh3};
use solidmap::geometry::SurfaceQuery;
use solidmap::mesh::SurfaceMesh;

/// Points in a box a fifth larger than the surface's, and as many near the surface.
fn probes(surface: &SurfaceMesh, count: usize) -> Vec<Point> {
    let (low, high) = surface.bounding_box().unwrap();
    let mut random = StdRng::seed_from_u64(11);
    let margin = (high - low) * 0.1;
    let mut points: Vec<Point> = (0..count)
        .map(|_| {
            Point::from(std::array::from_fn::<f64, 3, _>(|k| {
                random.random_range(low[k] - margin[k]..high[k] + margin[k])
            }))
        })
        .collect();
    let size = surface.diagonal();
    let near = solidmap::sampling::held_out(surface, count, 0, 5);
    points.extend(near.iter().map(|p| {
        let shift = solidmap::Vector::from_fn(|_, _| random.random_range(-0.01..0.01) * size);
        p.position(surface, surface.vertices()) + shift
    }));
    points
}

fn assert_same_distances(name: &str, surface: &SurfaceMesh) {
    let points = probes(surface, 2000);
    let (ours, theirs) = (
        SurfaceQuery::new(surface).unwrap(),
        SignedDistanceField::new(surface).unwrap(),
    );
    let (a, b) = (ours.signed_distances(&points), theirs.distance(&points));
    let inside = ours.contains_all(&points);
    for ((p, (a, b)), inside) in points.iter().zip(a.iter().zip(&b)).zip(inside) {
        // Both are exact up to rounding of coordinates of the size of the model.
        assert!(
            (a - b).abs() < 1e-12 * surface.diagonal(),
            "{name} at {p}: {a} against {b}"
        );
        assert!(
            b.abs() < 1e-12 || inside == (*b < 0.0),
            "{name} at {p}: inside {inside}, but CGAL says {b}"
        );
    }
}

/// 20 000 points over five solids, cavity and handles included.
#[test]
fn signed_distance_and_inside_agree_with_cgal() {
    for (name, surface) in solids(1) {
        assert_same_distances(name, &surface);
    }
}

#[test]
fn signed_distance_and_inside_agree_with_cgal_on_real_models() {
    let Some(folder) = models() else { return };
    for file in [
        "surfaces/kitten_g1_9k.obj",
        "surfaces/cad_knot_g1.stl",
        "surfaces/three_holes_g3_uv_2k.obj",
    ] {
        assert_same_distances(file, &solidmap::io::read_surface(folder.join(file)).unwrap());
    }
}

#[test]
fn volume_agrees_with_cgal() {
    let mut surfaces = solids(1);
    if let Some(folder) = models() {
        for file in [
            "surfaces/kitten_g1_9k.obj",
            "surfaces/igea_15k.obj",
            "surfaces/three_holes_g3_uv_2k.obj",
        ] {
            surfaces.push((file, solidmap::io::read_surface(folder.join(file)).unwrap()));
        }
    }
    for (name, surface) in surfaces {
        let theirs = SignedDistanceField::new(&surface).unwrap().volume().unwrap();
        let ours = surface.volume();
        // Both sum as many terms as there are triangles; the rounding of a sum of n terms grows like √n at worst here.
        assert!((ours / theirs - 1.0).abs() < 1e-11, "{name}: {ours} against {theirs}");
    }
}

/// TetGen keeps the boundary, so its volume is the surface's to rounding; Mesh_3 makes its own, within the facet
/// distance that it is asked for.
#[test]
fn both_meshers_fill_the_volume() {
    for (name, surface) in solids(1) {
        let volume = surface.volume();
        let tetgen = tetrahedralize(&surface, &TetOptions::default()).unwrap();
        assert!(
            (tetgen.volume() / volume - 1.0).abs() < 1e-10,
            "{name}: TetGen {} of {volume}",
            tetgen.volume()
        );
        assert_eq!(
            &tetgen.vertices()[..surface.vertices().len()],
            surface.vertices(),
            "{name}"
        );

        let distance = 0.004 * surface.diagonal();
        let options = Mesh3Options {
            facet_distance: Some(distance),
            ..Mesh3Options::default()
        };
        let mesh3 = tetrahedralize_mesh3(&surface, &options).unwrap();
        let slack = distance * surface.area();
        assert!(
            (mesh3.volume() - volume).abs() < slack,
            "{name}: Mesh_3 {} of {volume} ± {slack}",
            mesh3.volume()
        );
    }
}
