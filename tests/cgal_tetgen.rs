//! CGAL and TetGen through the bridge: right answers on solids with known ones, and an error for every input that
//! would end the process if either library saw it.

use std::f64::consts::PI;
use std::path::Path;

use crate::common::models;
use solidmap::cgal_tetgen::{
    CgalTetgenError, InputDefect, Mesh3Options, OffsetOptions, SignedDistanceField, TetOptions, offset_surface,
    self_intersections, self_test, tetrahedralize, tetrahedralize_mesh3,
};
use solidmap::io::{SolidMesh, read_solid};
use solidmap::mesh::{SurfaceMesh, TetMesh, shapes};
use solidmap::{Point, Vector};

fn moved(surface: &SurfaceMesh, by: [f64; 3]) -> SurfaceMesh {
    shapes::deformed(surface, |p| p + Vector::from(by))
}

fn scaled(surface: &SurfaceMesh, by: f64) -> SurfaceMesh {
    shapes::deformed(surface, |p| p * by)
}

fn with_triangles(surface: &SurfaceMesh, edit: impl FnOnce(&mut Vec<[u32; 3]>)) -> SurfaceMesh {
    let (vertices, mut triangles) = surface.clone().into_parts();
    edit(&mut triangles);
    SurfaceMesh::new(vertices, triangles).unwrap()
}

/// Solids of every kind, and of several components.
fn solids() -> Vec<(&'static str, SurfaceMesh)> {
    let two = shapes::joined(&shapes::sphere(1.0, 2), &moved(&shapes::cube(1.0, 3), [3.0, 0.0, 0.0]));
    let nested = shapes::joined(&shapes::spherical_shell(1.0, 0.6, 3), &shapes::sphere(0.3, 2));
    let mut solids = crate::common::solids(1);
    solids.extend([("ball in a shell", nested), ("ball beside a cube", two)]);
    solids
}

/// A cylinder over a regular polygon, with all triangles of its bottom and of its top about one corner.
fn fans(corners: u32) -> SurfaceMesh {
    let angle = |k: u32| 2.0 * PI * f64::from(k) / f64::from(corners);
    let circle = |z| (0..corners).map(move |k| Point::new(angle(k).cos(), angle(k).sin(), z));
    let fan = (1..corners - 1).flat_map(|k| [[0, k + 1, k], [corners, corners + k, corners + k + 1]]);
    let walls = (0..corners).flat_map(|a| {
        let b = (a + 1) % corners;
        [[a, b, b + corners], [a, b + corners, a + corners]]
    });
    SurfaceMesh::new(circle(0.0).chain(circle(1.0)).collect(), fan.chain(walls).collect()).unwrap()
}

/// TetGen recurses over the triangles about a vertex, and overflows the stack of a test's thread (2 MiB) on this one.
#[test]
fn a_fan_of_500_triangles_does_not_overflow_the_stack() {
    let surface = fans(500);
    let mesh = tetrahedralize(&surface, &TetOptions::default()).unwrap();
    assert_fills("a cylinder of fans", &mesh, &surface);
}

/// What [`tetrahedralize`] promises, checked independently of it.
fn assert_fills(name: &str, mesh: &TetMesh, surface: &SurfaceMesh) {
    assert!(
        (mesh.volume() - surface.volume().abs()).abs() < 1e-9 * surface.volume().abs(),
        "{name}"
    );
    assert!(
        (0..mesh.tets().len()).all(|t| mesh.signed_volume(t) > 0.0),
        "{name}: an inverted tetrahedron"
    );
    assert_eq!(
        &mesh.vertices()[..surface.vertices().len()],
        surface.vertices(),
        "{name}"
    );
    let boundary = mesh.boundary();
    let ids = (0..surface.vertices().len() as u32).collect::<Vec<_>>();
    assert_eq!(boundary.vertex_ids, ids, "{name}: vertices on the boundary");
    let sorted = |surface: &SurfaceMesh| {
        let mut keys = surface.triangles().to_vec();
        keys.iter_mut().for_each(|t| t.sort_unstable());
        keys.sort_unstable();
        keys
    };
    assert_eq!(sorted(&boundary.surface), sorted(surface), "{name}: boundary triangles");
}

#[test]
fn errors_of_tetgen_are_reported_as_errors() {
    self_test().unwrap();
}

#[test]
fn tetgen_fills_the_solid_and_keeps_its_boundary() {
    for (name, surface) in solids() {
        for radius_edge_ratio in [None, Some(1.414)] {
            let options = TetOptions {
                radius_edge_ratio,
                ..TetOptions::default()
            };
            assert_fills(name, &tetrahedralize(&surface, &options).unwrap(), &surface);
        }
    }
}

/// Tetrahedra at the boundary, which may not be split, cannot all keep the bound.
#[test]
fn tetgen_refines_to_the_volume_aimed_for() {
    let surface = shapes::cube(1.0, 4);
    let median = |bound: f64| {
        let options = TetOptions {
            max_volume: Some(bound),
            ..TetOptions::default()
        };
        let mesh = tetrahedralize(&surface, &options).unwrap();
        assert_fills("cube", &mesh, &surface);
        let mut volumes: Vec<f64> = (0..mesh.tets().len()).map(|t| mesh.signed_volume(t)).collect();
        volumes.sort_unstable_by(f64::total_cmp);
        volumes[volumes.len() / 2]
    };
    assert!(median(1e-3) < 1e-3 && median(1e-4) < 1e-4);
}

#[test]
fn orientation_of_the_surface_does_not_matter() {
    let surface = shapes::sphere(1.0, 2);
    let mixed = with_triangles(&surface, |t| t.iter_mut().step_by(3).for_each(|t| t.swap(0, 1)));
    let want = tetrahedralize(&surface, &TetOptions::default()).unwrap();
    for other in [surface.reversed(), mixed] {
        let mesh = tetrahedralize(&other, &TetOptions::default()).unwrap();
        assert!((mesh.volume() - want.volume()).abs() < 1e-12);
        assert!((0..mesh.tets().len()).all(|t| mesh.signed_volume(t) > 0.0));
    }
}

#[test]
fn neither_size_nor_place_matters() {
    let surface = shapes::torus(1.0, 0.3, 24, 12);
    for (scale, shift) in [(1e12, 0.0), (1e-9, 0.0), (1.0, 1e6)] {
        let surface = moved(&scaled(&surface, scale), [shift; 3]);
        let mesh = tetrahedralize(&surface, &TetOptions::default()).unwrap();
        assert!((mesh.volume() / surface.volume() - 1.0).abs() < 1e-9, "{scale} {shift}");
    }
}

/// Two cubes that share an edge: four triangles meet there, but the inside is well defined.
#[test]
fn a_non_manifold_edge_is_accepted_by_tetgen_alone() {
    let surface = shapes::polycube(&[[0, 0, 0], [1, 1, 0]], 2);
    let mesh = tetrahedralize(&surface, &TetOptions::default()).unwrap();
    assert!((mesh.volume() - 2.0).abs() < 1e-12);
    let refused = tetrahedralize_mesh3(&surface, &Mesh3Options::default()).unwrap_err();
    assert!(matches!(
        refused,
        CgalTetgenError::InvalidInput(InputDefect::NonManifoldEdge { triangles: 4, .. })
    ));
}

#[test]
fn mesh3_fills_the_solid_to_its_tolerance() {
    for (name, surface) in solids() {
        let options = Mesh3Options {
            facet_distance: Some(0.01),
            cell_size: Some(0.2),
            ..Mesh3Options::default()
        };
        let mesh = tetrahedralize_mesh3(&surface, &options).unwrap();
        // If every facet were off by the largest distance, on the same side.
        let tolerance = 0.01 * surface.area();
        assert!(
            (mesh.volume() - surface.volume()).abs() < tolerance,
            "{name}: {}",
            mesh.volume()
        );
        assert!((0..mesh.tets().len()).all(|t| mesh.signed_volume(t) > 0.0), "{name}");
    }
}

#[test]
fn mesh3_stops_when_its_time_is_over() {
    let options = Mesh3Options {
        cell_size: Some(0.02),
        time_limit: std::time::Duration::from_millis(50),
        ..Mesh3Options::default()
    };
    let refused = tetrahedralize_mesh3(&shapes::sphere(1.0, 3), &options);
    assert!(matches!(refused, Err(CgalTetgenError::Stopped(_))));
}

#[test]
fn mesh3_keeps_sharp_edges() {
    let surface = shapes::double_torus(2);
    let mesh = tetrahedralize_mesh3(&surface, &Mesh3Options::default()).unwrap();
    assert!((mesh.volume() - 13.0).abs() < 1e-9);
}

#[test]
fn results_repeat_to_the_last_bit() {
    let surface = shapes::torus(1.0, 0.3, 24, 12);
    let meshes = || {
        let tetgen = tetrahedralize(&surface, &TetOptions::default()).unwrap();
        let mesh3 = tetrahedralize_mesh3(&surface, &Mesh3Options::default()).unwrap();
        let offset = offset_surface(&surface, 0.1, &OffsetOptions::default()).unwrap();
        (tetgen, mesh3, offset)
    };
    assert_eq!(meshes(), meshes());
}

/// Grids whose points are nearly coplanar make TetGen use its exact predicates, whose globals two runs at a time would
/// overwrite: without the lock this aborts.
#[test]
fn threads_may_mesh_at_the_same_time() {
    let grid = |scale: f64| {
        let cube = scaled(&shapes::cube(1.0, 6), scale);
        shapes::deformed(&cube, |p| p + Vector::new(p.y, p.z, p.x) * 1e-13)
    };
    let mesh = |k: i32| tetrahedralize(&grid(10f64.powi(k)), &TetOptions::default()).unwrap();
    let alone: Vec<TetMesh> = (0..4).map(|k| mesh(3 * k - 4)).collect();
    std::thread::scope(|scope| {
        for k in 0..4 {
            let alone = &alone[k];
            scope.spawn(move || (0..8).for_each(|_| assert_eq!(&mesh(3 * k as i32 - 4), alone)));
        }
    });
}

fn defect(surface: &SurfaceMesh) -> InputDefect {
    let from_tetgen = tetrahedralize(surface, &TetOptions::default()).unwrap_err();
    let from_mesh3 = tetrahedralize_mesh3(surface, &Mesh3Options::default()).unwrap_err();
    assert_eq!(from_tetgen, from_mesh3);
    match from_tetgen {
        CgalTetgenError::InvalidInput(defect) => defect,
        other => panic!("{other}"),
    }
}

#[test]
fn rejects_an_empty_surface() {
    let empty = SurfaceMesh::default();
    assert_eq!(defect(&empty), InputDefect::Empty);
    let refused = |error: CgalTetgenError| error == CgalTetgenError::InvalidInput(InputDefect::Empty);
    assert!(refused(
        offset_surface(&empty, 1.0, &OffsetOptions::default()).unwrap_err()
    ));
    assert!(refused(SignedDistanceField::new(&empty).err().unwrap()));
    assert!(refused(self_intersections(&empty).unwrap_err()));
}

#[test]
fn rejects_coordinates_that_are_not_finite_or_out_of_scale() {
    let ball = shapes::sphere(1.0, 1);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut vertices = ball.vertices().to_vec();
        vertices[5].y = bad;
        let surface = ball.with_vertices(vertices).unwrap();
        let want = InputDefect::NotFinite { vertex: 5 };
        assert_eq!(defect(&surface), want);
        let want = CgalTetgenError::InvalidInput(want);
        assert_eq!(
            offset_surface(&surface, 1.0, &OffsetOptions::default()).unwrap_err(),
            want
        );
        assert_eq!(SignedDistanceField::new(&surface).err().unwrap(), want);
        assert_eq!(self_intersections(&surface).unwrap_err(), want);
    }
    for scale in [1e200, 1e-200] {
        assert!(matches!(defect(&scaled(&ball, scale)), InputDefect::OutOfScale { .. }));
    }
}

#[test]
fn rejects_an_open_surface() {
    let open = with_triangles(&shapes::cube(1.0, 2), |t| t.truncate(47));
    assert!(matches!(defect(&open), InputDefect::Open { edges: 3, .. }));
    for error in [
        offset_surface(&open, 1.0, &OffsetOptions::default()).unwrap_err(),
        SignedDistanceField::new(&open).err().unwrap(),
    ] {
        assert!(matches!(
            error,
            CgalTetgenError::InvalidInput(InputDefect::Open { edges: 3, .. })
        ));
    }
}

#[test]
fn rejects_flat_surfaces() {
    let cube = shapes::cube(1.0, 1);
    let tetrahedron = SurfaceMesh::new(
        vec![
            Point::origin(),
            Point::new(1., 0., 0.),
            Point::new(0., 1., 0.),
            Point::new(1., 1., 0.),
        ],
        vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    )
    .unwrap();
    assert_eq!(defect(&tetrahedron), InputDefect::Flat);
    let tilted = shapes::deformed(&tetrahedron, |p| Point::new(p.x, p.y, 0.3 * p.x - 0.7 * p.y));
    assert_eq!(defect(&tilted), InputDefect::Flat);
    let squashed = shapes::deformed(&cube, |p| Point::new(p.x, p.y, 0.0));
    assert!(matches!(defect(&squashed), InputDefect::CoincidentVertices { .. }));
}

#[test]
fn rejects_degenerate_and_repeated_elements() {
    let cube = shapes::cube(1.0, 1);
    let twice = with_triangles(&cube, |t| t[3] = [t[3][0], t[3][0], t[3][1]]);
    assert_eq!(defect(&twice), InputDefect::DegenerateTriangle { triangle: 3 });

    let repeated = with_triangles(&cube, |t| t.push([t[2][1], t[2][0], t[2][2]]));
    assert_eq!(
        defect(&repeated),
        InputDefect::RepeatedTriangle { first: 2, second: 12 }
    );

    let mut vertices = cube.vertices().to_vec();
    vertices.push(vertices[4]);
    let split = with_triangles(&SurfaceMesh::new(vertices, cube.triangles().to_vec()).unwrap(), |t| {
        let corner = t.last_mut().unwrap().iter_mut().find(|v| **v == 4);
        if let Some(v) = corner {
            *v = 8;
        }
    });
    assert_eq!(defect(&split), InputDefect::CoincidentVertices { first: 4, second: 8 });

    let mut vertices = cube.vertices().to_vec();
    vertices.push(Point::new(9.0, 9.0, 9.0));
    let unused = SurfaceMesh::new(vertices, cube.triangles().to_vec()).unwrap();
    assert_eq!(defect(&unused), InputDefect::UnreferencedVertex { vertex: 8 });

    // A vertex on the middle of an edge, and the sliver that closes the gap: no area, and no repeated corner.
    let mut vertices = cube.vertices().to_vec();
    let [a, b, c] = cube.triangles()[0];
    vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
    let sliver = with_triangles(&SurfaceMesh::new(vertices, cube.triangles().to_vec()).unwrap(), |t| {
        t[0] = [a, 8, c];
        t.extend([[8, b, c], [a, b, 8]]);
    });
    assert_eq!(defect(&sliver), InputDefect::DegenerateTriangle { triangle: 13 });
}

#[test]
fn rejects_surfaces_that_pass_through_themselves() {
    let ball = shapes::sphere(1.0, 2);
    let two = shapes::joined(&ball, &moved(&ball, [0.8, 0.1, 0.2]));
    let pairs = self_intersections(&two).unwrap();
    assert!(pairs.len() > 50 && pairs.windows(2).all(|p| p[0] < p[1]));
    assert!(
        pairs.iter().all(|&[s, t]| s < 320 && t >= 320),
        "each ball by itself is clean"
    );
    let want = CgalTetgenError::SelfIntersection {
        pairs: pairs.len(),
        first: pairs[0],
    };
    assert_eq!(tetrahedralize(&two, &TetOptions::default()).unwrap_err(), want);
    assert_eq!(tetrahedralize_mesh3(&two, &Mesh3Options::default()).unwrap_err(), want);

    // A vertex pushed through the far side.
    let mut vertices = ball.vertices().to_vec();
    vertices[0] = Point::from(vertices[0].coords * -1.5);
    let folded = ball.with_vertices(vertices).unwrap();
    assert!(matches!(
        tetrahedralize(&folded, &TetOptions::default()),
        Err(CgalTetgenError::SelfIntersection { .. })
    ));
}

#[test]
fn rejects_what_cannot_be_oriented() {
    // Two cubes that share an edge, a triangle of one flipped: where four triangles meet, neighbours are ambiguous.
    let flipped = with_triangles(&shapes::polycube(&[[0, 0, 0], [1, 1, 0]], 1), |t| t[0].swap(0, 1));
    assert!(matches!(defect(&flipped), InputDefect::NotOrientable { .. }));
}

#[test]
fn rejects_options_out_of_range() {
    let ball = shapes::sphere(1.0, 1);
    let refused = |options: TetOptions| tetrahedralize(&ball, &options).unwrap_err();
    for (options, name) in [
        (
            TetOptions {
                radius_edge_ratio: Some(0.5),
                ..TetOptions::default()
            },
            "radius_edge_ratio",
        ),
        (
            TetOptions {
                radius_edge_ratio: Some(f64::NAN),
                ..TetOptions::default()
            },
            "radius_edge_ratio",
        ),
        (
            TetOptions {
                min_dihedral: 60.0,
                ..TetOptions::default()
            },
            "min_dihedral",
        ),
        (
            TetOptions {
                max_volume: Some(0.0),
                ..TetOptions::default()
            },
            "max_volume",
        ),
    ] {
        assert!(matches!(refused(options), CgalTetgenError::InvalidOption { name: n, .. } if n == name));
    }
    let tiny = TetOptions {
        max_volume: Some(1e-12),
        ..TetOptions::default()
    };
    assert!(matches!(refused(tiny), CgalTetgenError::TooFine { .. }));
    let tiny = Mesh3Options {
        cell_size: Some(1e-6),
        ..Mesh3Options::default()
    };
    assert!(matches!(
        tetrahedralize_mesh3(&ball, &tiny),
        Err(CgalTetgenError::TooFine { .. })
    ));
    for distance in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refused = offset_surface(&ball, distance, &OffsetOptions::default());
        assert!(matches!(
            refused,
            Err(CgalTetgenError::InvalidOption { name: "distance", .. })
        ));
    }
    let refused = offset_surface(&ball, 1e-6, &OffsetOptions::default());
    assert!(matches!(refused, Err(CgalTetgenError::TooFine { .. })));
}

#[test]
fn shapes_do_not_intersect_themselves() {
    for (name, surface) in solids() {
        assert_eq!(self_intersections(&surface).unwrap(), Vec::<[u32; 2]>::new(), "{name}");
    }
}

#[test]
fn self_intersections_take_any_soup() {
    let p = |x: f64, y: f64, z: f64| Point::new(x, y, z);
    let vertices = vec![
        p(0., 0., 0.),
        p(2., 0., 0.),
        p(0., 2., 0.),
        p(0.5, 0.5, -1.),
        p(0.5, 0.5, 1.),
        p(3., 3., 0.),
        p(2., 0., 0.),
        p(1., 1., 0.),
        p(-1., -1., 1.),
    ];
    let pairs = |triangles: &[[u32; 3]]| {
        self_intersections(&SurfaceMesh::new(vertices.clone(), triangles.to_vec()).unwrap()).unwrap()
    };
    assert_eq!(pairs(&[[0, 1, 2], [3, 4, 5]]), [[0, 1]], "one pierces the other");
    assert_eq!(
        pairs(&[[0, 1, 2], [0, 4, 8]]),
        Vec::<[u32; 2]>::new(),
        "a common corner alone"
    );
    assert_eq!(pairs(&[[0, 1, 2], [0, 3, 4]]), [[0, 1]], "a common corner and more");
    assert_eq!(
        pairs(&[[0, 1, 2], [0, 1, 4]]),
        Vec::<[u32; 2]>::new(),
        "a common side alone"
    );
    assert_eq!(pairs(&[[0, 1, 2], [1, 0, 7]]), [[0, 1]], "folded flat upon itself");
    assert_eq!(pairs(&[[0, 1, 2], [2, 1, 0]]), [[0, 1]], "the same triangle twice");
    assert_eq!(
        pairs(&[[0, 1, 2], [0, 6, 4]]),
        Vec::<[u32; 2]>::new(),
        "a seam of repeated vertices"
    );
    assert_eq!(
        pairs(&[[0, 1, 2], [0, 0, 4], [1, 2, 7]]),
        Vec::<[u32; 2]>::new(),
        "triangles without area"
    );
    assert_eq!(
        pairs(&[[0, 1, 4], [0, 1, 3], [1, 0, 2]]),
        Vec::<[u32; 2]>::new(),
        "three triangles on one edge"
    );
}

#[test]
fn distance_is_negative_inside_and_exact_for_a_cube() {
    let cube = shapes::cube(2.0, 3);
    for surface in [cube.reversed(), cube] {
        let field = SignedDistanceField::new(&surface).unwrap();
        let points = [
            [0., 0., 0.],
            [0.5, 0.2, 0.1],
            [3., 0., 0.],
            [2., 2., 2.],
            [1., 0.3, 0.2],
            [-1.5, 0.9, 0.],
        ];
        let want = [-1.0, -0.5, 2.0, 3f64.sqrt(), 0.0, 0.5];
        for (distance, want) in field.distance(&points.map(Point::from)).iter().zip(want) {
            assert!((distance - want).abs() < 1e-15, "{distance} for {want}");
        }
    }
}

#[test]
fn distance_is_positive_in_cavities_and_answers_any_point() {
    let field = SignedDistanceField::new(&shapes::spherical_shell(1.0, 0.5, 4)).unwrap();
    let far = [
        [0.0; 3],
        [0.75, 0., 0.],
        [1e200, 0., 0.],
        [f64::NAN, 0., 0.],
        [f64::INFINITY, 0., 0.],
    ];
    let distance = field.distance(&far.map(Point::from));
    // Sagitta of an icosahedral sphere of level 4.
    assert!((distance[0] - 0.5).abs() < 2e-3 && (distance[1] + 0.25).abs() < 2e-3);
    assert!(distance[2] >= 1e199 && distance[3].is_nan() && distance[4] == f64::INFINITY);
}

#[test]
fn a_distance_field_can_be_shared_between_threads() {
    let field = SignedDistanceField::new(&shapes::torus(1.0, 0.3, 64, 32)).unwrap();
    let points: Vec<Point> = (0..4000)
        .map(|k| Point::from([0.1, 0.7, 1.3].map(|s| (k as f64 * s).sin() * 1.5)))
        .collect();
    let want: Vec<f64> = points.iter().flat_map(|p| field.distance(&[*p])).collect();
    assert_eq!(field.distance(&points), want);
    let exact = |p: &Point| (p.x.hypot(p.y) - 1.0).hypot(p.z) - 0.3;
    // Sagittas of the two circles: 1.3 (1 - cos(pi / 64)) and 0.3 (1 - cos(pi / 32)).
    assert!(
        points
            .iter()
            .zip(&want)
            .all(|(p, d)| (exact(p) - d).abs() < 1.3 * 1.3e-3 + 0.3 * 4.9e-3)
    );
}

#[test]
fn offset_of_a_ball_is_a_ball() {
    let result = offset_surface(&shapes::sphere(1.0, 4), 0.1, &OffsetOptions::default()).unwrap();
    assert_eq!(
        (result.genus, result.model_genus, result.components, result.retries),
        (0, Some(0), 1, 0)
    );
    assert!(!result.raw_wrap);
    assert!(result.vertex_error < 1e-12, "{}", result.vertex_error);
    // The model's own facets lie up to 1.2e-3 within the ball.
    assert!(
        result
            .mesh
            .vertices()
            .iter()
            .all(|p| (p.coords.norm() - 1.1).abs() < 1.5e-3)
    );
    // The centroid of a regular triangle of edge e lies e² / 6r below its sphere; no edge is longer than 2 alpha.
    assert!(
        result.centroid_error < 0.1 * 0.1 / 6.0 / 1.1,
        "{}",
        result.centroid_error
    );
    let volume = 4.0 / 3.0 * PI * 1.1f64.powi(3);
    assert!((result.mesh.volume() / volume - 1.0).abs() < 5e-3);
}

#[test]
fn offset_of_a_torus_closes_its_hole_when_it_is_wide() {
    let torus = shapes::torus(1.0, 0.3, 64, 32);
    for (distance, genus) in [(0.1, 1), (0.4, 1), (0.8, 0)] {
        let result = offset_surface(&torus, distance, &OffsetOptions::default()).unwrap();
        assert_eq!((result.genus, result.model_genus), (genus, Some(1)), "{distance}");
        if genus == 1 {
            let exact = |p: &Point| (p.x.hypot(p.y) - 1.0).hypot(p.z) - 0.3;
            let worst = result
                .mesh
                .vertices()
                .iter()
                .map(|p| (exact(p) - distance).abs())
                .fold(0.0, f64::max);
            // What the model's facets deviate from the torus, as above.
            assert!(worst < 1.3 * 1.3e-3 + 0.3 * 4.9e-3, "{worst}");
        }
    }
}

#[test]
fn offset_of_a_plate_keeps_its_holes_while_they_are_wider() {
    let plate = shapes::double_torus(2);
    let result = offset_surface(&plate, 0.2, &OffsetOptions::default()).unwrap();
    assert_eq!((result.genus, result.model_genus), (2, Some(2)));
    assert!(result.min_distance > 0.1);
    let filled = offset_surface(&plate, 0.6, &OffsetOptions::default()).unwrap();
    assert_eq!((filled.genus, filled.model_genus), (0, Some(2)));
}

#[test]
fn a_genus_that_is_impossible_is_an_error() {
    let options = OffsetOptions {
        genus: Some(3),
        retries: 0,
        ..OffsetOptions::default()
    };
    let refused = offset_surface(&shapes::sphere(1.0, 3), 0.2, &options).unwrap_err();
    assert_eq!(refused, CgalTetgenError::Topology { got: 0, want: 3 });
}

#[test]
fn finer_wraps_are_tried_until_the_genus_is_right() {
    let options = OffsetOptions {
        alpha: Some(0.3),
        genus: Some(1),
        retries: 3,
        ..OffsetOptions::default()
    };
    let result = offset_surface(&shapes::torus(1.0, 0.3, 48, 24), 0.5, &options).unwrap();
    assert_eq!(result.genus, 1);
    assert!(result.retries > 0 && result.alpha < 0.3);
}

#[test]
fn a_wrap_without_rounds_is_raw_and_a_percent_off() {
    let options = OffsetOptions {
        rounds: 0,
        ..OffsetOptions::default()
    };
    let result = offset_surface(&shapes::sphere(1.0, 3), 0.1, &options).unwrap();
    assert!(result.raw_wrap && result.vertex_error < 0.02 * 0.1);
}

#[test]
fn offset_of_a_tangled_model_surrounds_all_of_it() {
    let ball = shapes::sphere(1.0, 3);
    let two = shapes::joined(&ball, &moved(&ball, [0.8, 0.1, 0.2]));
    let result = offset_surface(&two, 0.2, &OffsetOptions::default()).unwrap();
    assert_eq!((result.components, result.genus), (1, 0));
    assert!(result.min_distance > 0.1);
}

#[test]
fn offset_of_a_shell_is_outside_only() {
    let result = offset_surface(&shapes::spherical_shell(1.0, 0.5, 3), 0.1, &OffsetOptions::default()).unwrap();
    assert_eq!((result.components, result.genus, result.model_genus), (1, 0, Some(0)));
}

/// The surface in a file, or the boundary of its tetrahedra.
fn read(folder: &Path, name: &str) -> SurfaceMesh {
    match read_solid(folder.join(name)).unwrap_or_else(|error| panic!("{error}")) {
        SolidMesh::Surface(surface) => surface,
        SolidMesh::Cells(cells) => cells.boundary().surface,
    }
}

#[test]
fn real_models_are_filled_by_both_meshers() {
    let Some(folder) = models() else { return };
    for name in [
        "volumes/cup_g1_tet.mesh",
        "volumes/m1_g9_tet.mesh",
        "surfaces/cad_knot_g1.stl",
        "surfaces/spot_uv_2k9.obj",
    ] {
        let surface = read(&folder, name);
        let start = std::time::Instant::now();
        let tetgen = tetrahedralize(&surface, &TetOptions::default()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        assert_fills(name, &tetgen, &surface);
        let start = std::time::Instant::now();
        let mesh3 = tetrahedralize_mesh3(&surface, &Mesh3Options::default()).unwrap();
        eprintln!(
            "{name}: {} triangles; TetGen {} tets {seconds:.2} s; Mesh_3 {} tets {:.2} s, volume off by {:.1e}",
            surface.triangles().len(),
            tetgen.tets().len(),
            mesh3.tets().len(),
            start.elapsed().as_secs_f64(),
            mesh3.volume() / surface.volume() - 1.0
        );
    }
}

#[test]
fn real_models_have_offsets() {
    let Some(folder) = models() else { return };
    for (name, genus) in [
        ("surfaces/kitten_g1_9k.obj", 1),
        ("surfaces/spot_uv_2k9.obj", 0),
        ("surfaces/cad_knot_g1.stl", 1),
    ] {
        let surface = read(&folder, name);
        let distance = 0.03 * surface.diagonal();
        let start = std::time::Instant::now();
        let result = offset_surface(&surface, distance, &OffsetOptions::default()).unwrap();
        assert_eq!(result.model_genus, Some(genus));
        assert!(result.min_distance >= 0.5 * distance);
        eprintln!(
            "{name}: {} triangles, genus {}, errors {:.1e} and {:.1e} of the distance, retries {}, raw {}, {:.2} s",
            result.mesh.triangles().len(),
            result.genus,
            result.vertex_error / distance,
            result.centroid_error / distance,
            result.retries,
            result.raw_wrap,
            start.elapsed().as_secs_f64()
        );
    }
}

/// Against the counts of another implementation (libigl, exact predicates, by vertex indices) on the same files. Where
/// they differ, it counts triangles that touch in a seam of repeated vertices, or that have no area.
#[test]
fn intersecting_pairs_are_as_many_as_counted_elsewhere() {
    let Some(folder) = models() else { return };
    for (name, want) in [
        ("surfaces/kitten_g1_9k.obj", 0),
        ("surfaces/cad_knot_g1.stl", 0),
        ("bad/bunny_open.obj", 0),
        ("bad/happy_buddha_g6_selfint.obj", 83),
        ("bad/camel_ref_nonmanifold.obj", 14),
        ("bad/self_intersect.obj", 338),
        ("bad/joined_tetrahedra.obj", 1),
        ("bad/soup.stl", 1248),
        ("bad/fan3.obj", 0),
        ("bad/box_not_manifold.obj", 0),
        ("bad/hourglass_pinched_vertex.obj", 0),
        ("pairs/hand_vulcan.obj", 10),
        ("sequences/horse_poses/horse-07.obj", 128),
        // 3263 elsewhere: 403 vertices repeat others.
        ("bad/teapot_utah.obj", 161),
        // 96 elsewhere: 16 triangles have no area.
        ("bad/bunny_degenerate_faces.obj", 0),
    ] {
        assert_eq!(self_intersections(&read(&folder, name)).unwrap().len(), want, "{name}");
    }
}

/// Every bad model through every operation: errors are welcome, the end of the process is not.
#[test]
fn no_bad_model_ends_the_process() {
    let Some(folder) = models() else { return };
    for (name, offset) in [
        ("bad/bunny_open.obj", false),
        ("bad/bunny_degenerate_faces.obj", true),
        ("bad/camel_ref_nonmanifold.obj", false),
        ("bad/box_not_manifold.obj", false),
        ("bad/teapot_utah.obj", false),
        ("bad/soup.stl", false),
        ("bad/fan3.obj", false),
        ("bad/happy_buddha_g6_selfint.obj", true),
        ("bad/self_intersect.obj", true),
        ("bad/hull_mask_3parts.obj", true),
        ("bad/joined_tetrahedra.obj", true),
        ("bad/hourglass_pinched_vertex.obj", true),
        ("bad/cad_24_connected_pinched.stl", true),
        ("bad/chair_doubled.obj", true),
    ] {
        let surface = read(&folder, name);
        let say = |what: &str, result: Result<String, CgalTetgenError>| {
            eprintln!("{name}: {what}: {}", result.unwrap_or_else(|error| error.to_string()));
        };
        let tets = |mesh: TetMesh| format!("{} tetrahedra", mesh.tets().len());
        say("tetgen", tetrahedralize(&surface, &TetOptions::default()).map(tets));
        let brief = Mesh3Options {
            time_limit: std::time::Duration::from_secs(1),
            ..Mesh3Options::default()
        };
        say("mesh3", tetrahedralize_mesh3(&surface, &brief).map(tets));
        let field = SignedDistanceField::new(&surface);
        let origin = |field: SignedDistanceField| format!("{:?}", field.distance(&[Point::origin()]));
        say("distance", field.map(origin));
        let result = offset_surface(&surface, 0.05 * surface.diagonal(), &OffsetOptions::default());
        assert_eq!(result.is_ok(), offset, "{name}");
        say(
            "offset",
            result.map(|r| format!("{} triangles, raw {}", r.mesh.triangles().len(), r.raw_wrap)),
        );
    }
}

/// Balls and tori with vertices rounded to a coarse lattice: closed and manifold in their connectivity, and full of
/// coplanar, cospherical, folded and touching triangles, on which TetGen's assertions fail if anywhere.
#[test]
fn degenerate_positions_give_a_mesh_or_an_error() {
    use rand::{Rng, SeedableRng};
    let mut rng = rand::rngs::StdRng::seed_from_u64(7);
    let bases = [
        shapes::sphere(1.0, 1),
        shapes::sphere(1.0, 2),
        shapes::torus(1.0, 0.4, 10, 6),
        shapes::cube(1.5, 3),
    ];
    let mut meshed = 0;
    for round in 0..400 {
        let noise = [0.0, 0.05, 0.2][round % 3];
        let lattice = [8.0, 16.0, 64.0, 1e9][round / 3 % 4];
        let base = &bases[round % bases.len()];
        let mut rounded = |c: f64| ((c + rng.random_range(-1.0..=1.0) * noise) * lattice).round() / lattice;
        let vertices = base.vertices().iter().map(|p| p.map(&mut rounded)).collect();
        let surface = base.with_vertices(vertices).unwrap();
        if let Ok(mesh) = tetrahedralize(&surface, &TetOptions::default()) {
            meshed += 1;
            assert!(mesh.tets().len() > 1);
        }
        if round % 20 == 0 {
            let options = Mesh3Options {
                cell_size: Some(0.5),
                time_limit: std::time::Duration::from_millis(300),
                ..Mesh3Options::default()
            };
            let _ = tetrahedralize_mesh3(&surface, &options);
        }
    }
    assert!(meshed > 100, "{meshed} of 400");
}

#[test]
fn self_intersections_of_crowded_triangles_stop_early() {
    // All triangles of the fan have its first corner, and so do their boxes.
    let fan = |corners: u32| {
        let angle = |k: u32| 2.0 * PI * f64::from(k) / f64::from(corners);
        let vertices = (0..corners).map(|k| Point::new(angle(k).cos(), angle(k).sin(), 0.0));
        SurfaceMesh::new(vertices.collect(), (2..corners).map(|k| [0, k - 1, k]).collect()).unwrap()
    };
    assert_eq!(self_intersections(&fan(1000)), Ok(vec![]));
    assert_eq!(
        self_intersections(&fan(8000)),
        Err(CgalTetgenError::Crowded { pairs: 0 })
    );
}
