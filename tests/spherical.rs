//! Maps to the sphere: bijective on all models, equivariant under similarities, and of bounded distortion.

use std::path::Path;

use nalgebra::Rotation3;
use solidmap::boundary_map::SurfaceDistortion;
use solidmap::io::{self, SolidMesh};
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::{
    SphereEnergy, SphereOptions, SphereReport, SphereStart, SphericalEmbedding, SphericalError, check_embedding,
    map_to_sphere,
};
use solidmap::{Point, Vector};

const CLOSED: [&str; 31] = [
    "surfaces/goathead_2k8.obj",
    "surfaces/spot_uv_2k9.obj",
    "surfaces/blub_uv_7k.obj",
    "surfaces/armadillo_15k.obj",
    "surfaces/igea_15k.obj",
    "surfaces/moai_20k.obj",
    "surfaces/max_planck_27k.obj",
    "surfaces/bunny_50k.obj",
    "surfaces/igea_134k.ply",
    "pairs/cat.obj",
    "pairs/horse.obj",
    "pairs/hand_plain.obj",
    "pairs/hand_vulcan.obj",
    "maps/bird_object.vtk",
    "maps/bird_polycube.vtk",
    "maps/max_planck_object.mesh",
    "maps/max_planck_cube.mesh",
    "maps/bone_labelled.obj",
    "volumes/b0_tet.mesh",
    "bad/self_intersect.obj",
    "bad/bunny_degenerate_faces.obj",
    "sequences/deforming_sphere/defSphere0.ply",
    "sequences/deforming_sphere/defSphere1.ply",
    "sequences/deforming_sphere/defSphere2.ply",
    "sequences/deforming_sphere/defSphere3.ply",
    "sequences/deforming_sphere/defSphere4.ply",
    "sequences/deforming_sphere/defSphere5.ply",
    "sequences/deforming_sphere/defSphere6.ply",
    "sequences/deforming_sphere/defSphere7.ply",
    "sequences/deforming_sphere/defSphere8.ply",
    "sequences/deforming_sphere/defSphere9.ply",
];

fn surface(path: &Path) -> SurfaceMesh {
    match io::read_solid(path).unwrap() {
        SolidMesh::Surface(surface) => surface,
        SolidMesh::Cells(cells) => cells.boundary().surface,
    }
}

const BALANCED: SphereOptions = SphereOptions {
    energy: SphereEnergy::Balanced,
    start: SphereStart::Progressive,
    most_iterations: 20,
    tolerance: 1e-5,
};

const CONFORMAL: SphereOptions = SphereOptions {
    energy: SphereEnergy::Conformal,
    ..BALANCED
};

/// Run to convergence.
fn exactly(options: SphereOptions) -> SphereOptions {
    SphereOptions {
        most_iterations: 200,
        tolerance: 1e-13,
        ..options
    }
}

fn embedding(mesh: &SurfaceMesh, options: &SphereOptions) -> (SphericalEmbedding, SphereReport) {
    map_to_sphere(mesh, options, &|_| {}).unwrap()
}

/// The embedding, after an independent check.
fn checked_embedding(name: &str, mesh: &SurfaceMesh, options: &SphereOptions) -> (SphericalEmbedding, SphereReport) {
    let (map, report) = map_to_sphere(mesh, options, &|_| {}).unwrap_or_else(|e| panic!("{name}: {e}"));
    let check = check_embedding(map.surface().triangles(), map.directions());
    assert!(
        check.flipped == 0 && (check.degree - 1.0).abs() < 1e-9,
        "{name}: {check:?}"
    );
    assert!(
        map.directions().iter().all(|x| (x.norm() - 1.0).abs() < 1e-15),
        "{name}"
    );
    assert!(report.energy_after <= report.energy_before, "{name}: {report:?}");
    (map, report)
}

fn distortion(map: &SphericalEmbedding) -> SurfaceDistortion {
    let image: Vec<Point> = map.directions().iter().map(|&x| x.into()).collect();
    SurfaceDistortion::of(map.surface(), &image).unwrap()
}

fn farthest(a: &[Vector], b: impl Iterator<Item = Vector>) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max)
}

/// An egg with a dent: smooth, and without symmetries, under which the map would not be unique.
fn egg(level: u32) -> SurfaceMesh {
    shapes::deformed(&shapes::sphere(1.0, level), |p| {
        Point::new(
            1.3 * p.x + 0.2 * p.y * p.y,
            p.y + 0.15 * p.x * p.z,
            0.8 * p.z - 0.2 * p.x * p.x + 0.1 * p.y,
        )
    })
}

/// `self_intersect.obj` has the longest limbs of the models, and a largest area distortion of 63.
#[test]
fn every_closed_model_of_genus_0_is_embedded_with_bounded_area_distortion() {
    let Some(models) = crate::common::models() else { return };
    for name in CLOSED {
        let (map, _) = checked_embedding(name, &surface(&models.join(name)), &BALANCED);
        let area = distortion(&map).area;
        assert!(area.p50 < 5.0 && area.p99 < 100.0, "{name}: {area:?}");
    }
}

/// Long limbs have areas below rounding errors in a conformal embedding, which must be bijective all the same.
#[test]
fn conformal_embeddings_of_models_are_bijective_from_both_starts() {
    let Some(models) = crate::common::models() else { return };
    for name in CLOSED {
        let mesh = surface(&models.join(name));
        if mesh.vertices().len() > 8500 {
            continue;
        }
        let (map, _) = checked_embedding(name, &mesh, &CONFORMAL);
        let angle = distortion(&map).angle;
        assert!(angle.p50 < 1.25, "{name}: {angle:?}");
        let flowing = SphereOptions {
            start: SphereStart::Flow,
            ..CONFORMAL
        };
        checked_embedding(name, &mesh, &flowing);
    }
}

#[test]
fn spikes_plates_needles_fingers_and_faces_without_area_are_embedded() {
    for (name, mesh) in crate::common::stress::shapes_of_genus_0() {
        for energy in [SphereEnergy::Balanced, SphereEnergy::Conformal] {
            for start in [SphereStart::Progressive, SphereStart::Flow] {
                let options = SphereOptions {
                    energy,
                    start,
                    ..BALANCED
                };
                checked_embedding(&format!("{name}, {energy:?}, {start:?}"), &mesh, &options);
            }
        }
    }
}

#[test]
fn surfaces_without_area_have_an_embedding_or_an_error() {
    let sphere = shapes::sphere(1.0, 2);
    for flat in [
        shapes::deformed(&sphere, |p| Point::new(p.x, p.y, 0.0)),
        shapes::deformed(&sphere, |p| Point::new(p.x, 0.0, 0.0)),
        shapes::deformed(&sphere, |_| Point::new(1.0, 2.0, 3.0)),
        shapes::deformed(&sphere, |p| p * 1e-160),
        shapes::deformed(&sphere, |p| p * 1e150),
    ] {
        if let Ok((map, _)) = map_to_sphere(&flat, &BALANCED, &|_| {}) {
            assert!(check_embedding(map.surface().triangles(), map.directions()).is_bijective());
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let mesh = shapes::bumpy_sphere(20);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        [BALANCED, CONFORMAL].map(|options| pool.install(|| embedding(&mesh, &options)))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(2));
}

/// The optimum is the same, and the runs end when the energy falls by less than 1e-13 of itself, about the square of
/// the distance from the optimum.
#[test]
fn directions_are_equivariant_under_similarities() {
    let mesh = egg(3);
    let rotation = Rotation3::from_euler_angles(0.4, -1.2, 2.5);
    for options in [BALANCED, CONFORMAL].map(exactly) {
        let (still, _) = embedding(&mesh, &options);
        for size in [1e-3, 1.0, 1e4] {
            let moved = shapes::deformed(&mesh, |p| rotation * p * size + Vector::new(3.0, -7.0, 1.0) * size);
            let (moved, _) = embedding(&moved, &options);
            let off = farthest(moved.directions(), still.directions().iter().map(|x| rotation * x));
            assert!(off < 1e-5, "{options:?} {size}: {off:e}");
        }
    }
}

#[test]
fn a_mirrored_surface_has_the_mirrored_map_and_is_not_turned_inside_out() {
    let mesh = egg(3);
    let mirror = |p: &Vector| Vector::new(-p.x, p.y, p.z);
    let mirrored = shapes::deformed(&mesh, |p| Point::from(mirror(&p.coords)));
    assert!(mirrored.volume() < 0.0);
    let options = exactly(BALANCED);
    let (map, _) = embedding(&mesh, &options);
    let (image, _) = checked_embedding("mirrored", &mirrored, &options);
    assert!(image.surface().volume() > 0.0);
    let off = farthest(image.directions(), map.directions().iter().map(mirror));
    assert!(off < 1e-5, "{off:e}");
}

#[test]
fn a_sphere_stays_where_it_is() {
    let sphere = shapes::deformed(&shapes::sphere(2.5, 4), |p| p + Vector::new(1.0, 2.0, 3.0));
    let own: Vec<Vector> = shapes::sphere(1.0, 4).vertices().iter().map(|p| p.coords).collect();
    for options in [BALANCED, CONFORMAL].map(exactly) {
        let (map, _) = embedding(&sphere, &options);
        let off = farthest(map.directions(), own.iter().copied());
        // A hundredth of the size of the triangles, 0.07.
        assert!(off < 7e-4, "{options:?}: {off:e}");
    }
}

/// A map that is linear on triangles of size `h` follows a smooth one with derivatives off by `O(h)`.
#[test]
fn angles_are_kept_better_on_finer_meshes_of_a_smooth_surface() {
    let errors = [3, 4, 5].map(|level| {
        let angle = distortion(&embedding(&egg(level), &exactly(CONFORMAL)).0).angle;
        [angle.p50, angle.p99].map(|ratio| ratio - 1.0)
    });
    for pair in errors.windows(2) {
        for (coarse, fine) in pair[0].iter().zip(&pair[1]) {
            assert!(coarse / fine > 1.7, "{errors:?}");
        }
    }
    assert!(errors[2][1] < 0.05, "{errors:?}");
}

/// Conformal maps are unique up to Möbius transformations, and centring makes them unique up to rotation.
#[test]
fn a_conformal_map_does_not_depend_on_the_start() {
    let mesh = egg(4);
    let (progressive, _) = embedding(&mesh, &exactly(CONFORMAL));
    let flowing = SphereOptions {
        start: SphereStart::Flow,
        ..exactly(CONFORMAL)
    };
    let (flow, report) = embedding(&mesh, &flowing);
    assert_eq!(report.start, SphereStart::Flow);
    let off = farthest(progressive.directions(), flow.directions().iter().copied());
    assert!(off < 1e-3, "{off:e}");
    let areas = distortion(&progressive).area;
    assert!(areas.max < 5.0, "{areas:?}");
}

#[test]
fn files_of_other_topology_are_refused_with_the_reason() {
    let Some(models) = crate::common::models() else { return };
    let error = |name: &str| map_to_sphere(&surface(&models.join(name)), &BALANCED, &|_| {}).unwrap_err();
    assert!(matches!(
        error("bad/bunny_open.obj"),
        SphericalError::Open { open_edges: 223, .. }
    ));
    assert_eq!(error("surfaces/kitten_g1_9k.obj"), SphericalError::Genus { genus: 1 });
    assert_eq!(
        error("bad/hull_mask_3parts.obj"),
        SphericalError::Components { components: 3 }
    );
    for name in ["bad/hourglass_pinched_vertex.obj", "bad/joined_tetrahedra.obj"] {
        assert!(matches!(error(name), SphericalError::NotManifold { .. }), "{name}");
    }
    let mut vertices = shapes::sphere(1.0, 1).vertices().to_vec();
    vertices[7].y = f64::NAN;
    let bad = shapes::sphere(1.0, 1).with_vertices(vertices).unwrap();
    assert_eq!(
        map_to_sphere(&bad, &BALANCED, &|_| {}).unwrap_err(),
        SphericalError::NonFinite { vertex: 7 }
    );
}

#[test]
fn sizes_whose_areas_over_or_underflow_are_refused_and_others_embedded() {
    let sized = |size: f64| map_to_sphere(&shapes::sphere(size, 1), &BALANCED, &|_| {});
    assert!(sized(1e-59).is_ok() && sized(1e59).is_ok());
    for size in [1e-61, 1e61, 0.0] {
        assert!(
            matches!(sized(size), Err(SphericalError::OutOfScale { .. })),
            "{size:e}"
        );
    }
}
