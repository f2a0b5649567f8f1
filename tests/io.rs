//! Meshes and points through files: what is written reads back to the same bits, unusable files are errors, and real
//! models have their known counts.

use std::{fs, path::Path};

use crate::common::models;
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::{
    Point,
    io::{
        Cells, Field, IoError, SolidMesh, VtkEncoding, VtkFields, read_cells, read_points, read_solid, read_surface,
        read_tets, write_cells, write_csv, write_npy, write_surface, write_tets, write_vtk, write_vtu,
    },
    mesh::{CellList, SurfaceMesh, TetMesh},
};

const SEED: u64 = 20;

/// Coordinates of every magnitude, with both zeros and both infinities.
fn random_points(random: &mut StdRng, count: usize) -> Vec<Point> {
    let odd = [
        0.0,
        -0.0,
        f64::MIN_POSITIVE,
        5e-324,
        f64::MAX,
        f64::INFINITY,
        f64::NEG_INFINITY,
        0.1,
        1.0 / 3.0,
    ];
    let mut coordinate = || match random.random_range(0..4) {
        0 => odd[random.random_range(0..odd.len())],
        1 => random.random_range(-1.0..1.0),
        _ => f64::from_bits(random.random::<u64>() & !(1 << 62)),
    };
    (0..count)
        .map(|_| Point::new(coordinate(), coordinate(), coordinate()))
        .collect()
}

fn random_cells<const N: usize>(random: &mut StdRng, vertices: u32, count: usize) -> Vec<[u32; N]> {
    let mut cell = || std::array::from_fn(|_| random.random_range(0..vertices));
    (0..count).map(|_| cell()).collect()
}

fn random_surface(random: &mut StdRng) -> SurfaceMesh {
    let vertices = random_points(random, 50);
    let triangles = random_cells(random, 50, 80);
    SurfaceMesh::new(vertices, triangles).unwrap()
}

fn random_tets(random: &mut StdRng) -> TetMesh {
    let vertices = random_points(random, 50);
    let tets = random_cells(random, 50, 80);
    TetMesh::new(vertices, tets).unwrap()
}

fn bits(points: &[Point]) -> Vec<[u64; 3]> {
    points.iter().map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect()
}

#[test]
fn surfaces_read_back_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = random_surface(&mut StdRng::seed_from_u64(SEED));
    for extension in ["obj", "ply", "off", "mesh", "vtk", "vtu", "OBJ"] {
        let path = folder.path().join(format!("a.{extension}"));
        write_surface(&path, &mesh).unwrap();
        let read = read_surface(&path).unwrap();
        assert_eq!(bits(read.vertices()), bits(mesh.vertices()), "{extension}");
        assert_eq!(read.triangles(), mesh.triangles(), "{extension}");
        assert_eq!(bits(&read_points(&path).unwrap()), bits(mesh.vertices()), "{extension}");
        assert!(
            matches!(read_solid(&path).unwrap(), SolidMesh::Surface(_)),
            "{extension}"
        );
    }
}

#[test]
fn tets_read_back_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = random_tets(&mut StdRng::seed_from_u64(SEED));
    let read_back = |path: &Path| {
        let read = read_tets(path).unwrap();
        assert_eq!(bits(read.vertices()), bits(mesh.vertices()), "{path:?}");
        assert_eq!(read.tets(), mesh.tets(), "{path:?}");
        let SolidMesh::Cells(cells) = read_solid(path).unwrap() else {
            panic!("{path:?} was read as a surface");
        };
        assert!(matches!(cells.cells(), CellList::Tets(_)), "{path:?}");
    };
    for extension in ["mesh", "vtk", "vtu"] {
        let path = folder.path().join(format!("a.{extension}"));
        write_tets(&path, &mesh).unwrap();
        read_back(&path);
    }
    let path = folder.path().join("fields.vtk");
    let field = |components, count| Field {
        name: "a field".into(),
        components,
        values: vec![0.5; components * count],
    };
    let fields = VtkFields {
        point: vec![field(3, 50), field(1, 50)],
        cell: vec![field(9, 80)],
        ..VtkFields::default()
    };
    for encoding in [VtkEncoding::Text, VtkEncoding::Binary] {
        write_vtk(&path, mesh.vertices(), Cells::Tets(mesh.tets()), &fields, encoding).unwrap();
        read_back(&path);
    }
    let path = folder.path().join("fields.vtu");
    write_vtu(&path, mesh.vertices(), Cells::Tets(mesh.tets()), &fields).unwrap();
    read_back(&path);
}

#[test]
fn points_read_back_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let points = random_points(&mut StdRng::seed_from_u64(SEED), 100);
    let values: Vec<f64> = points.iter().flat_map(|p| p.iter().copied()).collect();
    let [csv, npy] = ["a.csv", "a.npy"].map(|name| folder.path().join(name));
    write_csv(&csv, &["x", "y", "z"], &values).unwrap();
    write_npy(&npy, 3, &values).unwrap();
    assert_eq!(bits(&read_points(&csv).unwrap()), bits(&points));
    assert_eq!(bits(&read_points(&npy).unwrap()), bits(&points));
    assert_eq!(
        fs::metadata(&npy).unwrap().len(),
        128 + 100 * 24,
        "data begin at a multiple of 64 bytes"
    );

    write_csv(
        &csv,
        &["x", "y", "z", "f, of x"],
        &[1., 2., 3., 4., 5., 6., 7., f64::NAN],
    )
    .unwrap();
    assert_eq!(
        read_points(&csv).unwrap(),
        [Point::new(1., 2., 3.), Point::new(5., 6., 7.)]
    );
    assert_eq!(
        fs::read_to_string(&csv).unwrap(),
        "x,y,z,\"f, of x\"\n1.0,2.0,3.0,4.0\n5.0,6.0,7.0,NaN\n"
    );
}

#[test]
fn hexahedra_are_read_as_a_solid_but_not_as_tetrahedra_or_a_surface() {
    let folder = tempfile::tempdir().unwrap();
    let points: Vec<Point> = (0..8)
        .map(|k| Point::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64))
        .collect();
    let hexes = Cells::Hexes(&[[0, 1, 3, 2, 4, 5, 7, 6]]);
    for extension in ["mesh", "vtk", "vtu"] {
        let path = folder.path().join(format!("a.{extension}"));
        write_cells(&path, &points, hexes).unwrap();
        for (error, advice) in [
            (
                read_tets(&path).map(drop).unwrap_err(),
                "cut its hexahedra into tetrahedra",
            ),
            (
                read_surface(&path).map(drop).unwrap_err(),
                "extract the boundary of the cells",
            ),
        ] {
            assert!(matches!(error, IoError::WrongKind { .. }), "{error}");
            let said = error.to_string();
            assert!(said.contains("1 hexahedra") && said.contains(advice), "{said}");
        }
        assert_eq!(read_points(&path).unwrap(), points);
        let read = read_cells(&path).unwrap();
        let solid = read_solid(&path).unwrap();
        assert_eq!(solid, SolidMesh::Cells(read.clone()));
        let boundary = solid.into_surface();
        assert_eq!(
            (boundary.triangles().len(), boundary.volume()),
            (12, 1.0),
            "{extension}"
        );
        assert_eq!(*read.cells(), CellList::Hexes(vec![[0, 1, 3, 2, 4, 5, 7, 6]]));
        assert_eq!(read.nodes(), points);
    }
}

#[test]
fn unknown_extensions_are_refused_with_the_known_ones() {
    let mesh = random_surface(&mut StdRng::seed_from_u64(SEED));
    for name in ["a.step", "a", "a.", ".obj"] {
        let message = read_surface(name).unwrap_err().to_string();
        assert!(
            message.contains(&format!("`{name}`")) && message.contains(".obj, .ply"),
            "{message}"
        );
        assert!(matches!(
            write_surface(name, &mesh),
            Err(IoError::UnknownExtension { .. })
        ));
    }
    assert!(read_points("a.txt").unwrap_err().to_string().contains(".csv, .npy"));
    assert!(matches!(read_surface("a.csv"), Err(IoError::UnknownExtension { .. })));
    assert!(matches!(
        write_surface("a.vti", &mesh),
        Err(IoError::UnknownExtension { .. })
    ));
    assert!(matches!(
        write_tets("a.obj", &TetMesh::default()),
        Err(IoError::UnknownExtension { .. })
    ));
}

#[test]
fn files_that_cannot_be_opened_are_named_with_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.obj");
    match read_surface(&missing).unwrap_err() {
        IoError::Read { path, source } => {
            assert_eq!((path, source.kind()), (missing, std::io::ErrorKind::NotFound));
        }
        other => panic!("{other}"),
    }
    let directory = folder.path().join("folder.ply");
    fs::create_dir(&directory).unwrap();
    assert!(matches!(read_surface(directory), Err(IoError::Read { .. })));
    let mesh = random_surface(&mut StdRng::seed_from_u64(SEED));
    assert!(matches!(
        write_surface(folder.path().join("none/a.obj"), &mesh),
        Err(IoError::Write { .. })
    ));
}

#[test]
fn real_surfaces_have_their_known_counts() {
    let Some(models) = models() else { return };
    for (name, vertices, triangles) in [
        ("surfaces/goathead_2k8.obj", 2763, 5522),
        ("surfaces/spot_uv_2k9.obj", 2930, 5856),
        ("surfaces/blub_uv_7k.obj", 7106, 14208),
        ("surfaces/armadillo_15k.obj", 14587, 29170),
        ("surfaces/igea_15k.obj", 15002, 30000),
        ("surfaces/moai_20k.obj", 20000, 39996),
        ("surfaces/max_planck_27k.obj", 27002, 54000),
        ("surfaces/bunny_50k.obj", 50000, 99996),
        ("surfaces/igea_134k.ply", 134_345, 268_686),
        ("surfaces/kitten_g1_9k.obj", 9447, 18894),
        ("surfaces/double_torus_g2_3k.obj", 3070, 6144),
        ("surfaces/three_holes_g3_uv_2k.obj", 1987, 3982),
        ("surfaces/cad_knot_g1.stl", 72, 144),
        ("maps/bone_labelled.obj", 1758, 3512),
        ("pairs/cat.obj", 8377, 16750),
        ("pairs/horse.obj", 9493, 18982),
        ("pairs/hand_plain.obj", 3202, 6400),
        ("pairs/hand_vulcan.obj", 6094, 12184),
        ("bad/teapot_utah.obj", 3644, 6320),
        ("bad/bunny_open.obj", 35947, 69451),
        ("bad/happy_buddha_g6_selfint.obj", 9990, 20000),
        ("bad/camel_ref_nonmanifold.obj", 21887, 43814),
        ("bad/bunny_degenerate_faces.obj", 19021, 38038),
        ("bad/self_intersect.obj", 8582, 17160),
        ("bad/hull_mask_3parts.obj", 3996, 7980),
        ("bad/box_not_manifold.obj", 9, 12),
        ("bad/joined_tetrahedra.obj", 5, 8),
        ("bad/soup.stl", 300, 100),
        ("bad/multibody.stl", 20, 32),
        ("bad/chair_doubled.obj", 3186, 12756),
        ("bad/cycloidal_assembly.ply", 21384, 43368),
        ("bad/hourglass_pinched_vertex.obj", 23, 40),
        // 224 quadrilaterals.
        ("bad/moebius.obj", 280, 448),
        ("bad/fan3.obj", 5, 3),
        ("bad/cad_24_connected_pinched.stl", 57, 96),
    ] {
        let mesh = read_surface(models.join(name)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(
            (mesh.vertices().len(), mesh.triangles().len()),
            (vertices, triangles),
            "{name}"
        );
    }
}

#[test]
fn frames_of_a_sequence_share_their_triangles() {
    let Some(models) = models() else { return };
    let horses = (1..=10).map(|k| format!("sequences/horse_poses/horse-{k:02}.obj"));
    let horses = std::iter::once("sequences/horse_poses/horse_ref.obj".to_owned()).chain(horses);
    let spheres = (0..10).map(|k| format!("sequences/deforming_sphere/defSphere{k}.ply"));
    for (frames, vertices, triangles) in [
        (horses.collect::<Vec<_>>(), 8431, 16843),
        (spheres.collect(), 513, 1022),
    ] {
        let frames: Vec<_> = frames
            .iter()
            .map(|name| read_surface(models.join(name)).unwrap())
            .collect();
        for frame in &frames {
            assert_eq!((frame.vertices().len(), frame.triangles().len()), (vertices, triangles));
            assert_eq!(frame.triangles(), frames[0].triangles());
        }
    }
}

#[test]
fn real_volumes_have_their_known_counts_and_orientations() {
    let Some(models) = models() else { return };
    for (name, vertices, tets, boundary, is_positive) in [
        ("volumes/cup_g1_tet.mesh", 7379, 30196, 10000, true),
        ("volumes/m1_g9_tet.mesh", 8055, 34098, 10020, true),
        ("volumes/b0_tet.mesh", 999, 4365, 992, true),
        ("maps/max_planck_object.mesh", 9867, 40076, 12508, true),
        ("maps/max_planck_cube.mesh", 9867, 40076, 12508, true),
        ("maps/bird_object.vtk", 5650, 20203, 8658, false),
        ("maps/bird_polycube.vtk", 5650, 20203, 8658, false),
    ] {
        let SolidMesh::Cells(mesh) = read_solid(models.join(name)).unwrap_or_else(|error| panic!("{error}")) else {
            panic!("{name} was read as a surface");
        };
        assert_eq!((mesh.nodes().len(), mesh.cells().len()), (vertices, tets), "{name}");
        assert_eq!(mesh.boundary().surface.triangles().len(), boundary, "{name}");
        assert_eq!(mesh.volume() > 0.0, is_positive, "{name}");
    }
    for [one, other] in [
        ["maps/bird_object.vtk", "maps/bird_polycube.vtk"],
        ["maps/max_planck_object.mesh", "maps/max_planck_cube.mesh"],
    ] {
        let [one, other] = [one, other].map(|name| read_tets(models.join(name)).unwrap());
        assert_eq!(one.tets(), other.tets());
    }
}

#[test]
fn unusable_models_are_refused_for_the_right_reason() {
    let Some(models) = models() else { return };
    let refused = |name: &str| read_solid(models.join(name)).map(drop).unwrap_err();
    let hexes = read_tets(models.join("volumes/rockerarm_g1_hex.mesh")).unwrap_err();
    assert!(
        matches!(&hexes, IoError::WrongKind { found, .. } if found == "10600 hexahedra"),
        "{hexes}"
    );
    let cells = read_cells(models.join("volumes/rockerarm_g1_hex.mesh")).unwrap();
    assert!(cells.cells().len() == 10600 && cells.regions().len() == 10600);
    let empty = refused("bad/empty.obj");
    assert!(matches!(empty, IoError::NoGeometry { vertices: 0, .. }), "{empty}");
    let two_corners = refused("bad/not_enough_indices.obj");
    assert!(
        matches!(
            two_corners,
            IoError::FewCorners {
                face: 0,
                corners: 2,
                ..
            }
        ),
        "{two_corners}"
    );
}

#[test]
fn lines_continued_by_backslashes_are_whole() {
    let Some(models) = models() else { return };
    let path = models.join("bad/wallhole_line_continuation.obj");
    let text = fs::read_to_string(&path)
        .unwrap()
        .replace("\\\r\n", " ")
        .replace("\\\n", " ");
    let statements = |key: &'static str| {
        text.lines()
            .filter(move |line| line.split_whitespace().next() == Some(key))
    };
    let corners: usize = statements("f").map(|line| line.split_whitespace().count() - 1).sum();
    let mesh = read_surface(&path).unwrap();
    assert_eq!(mesh.vertices().len(), statements("v").count());
    assert_eq!(mesh.triangles().len(), corners - 2 * statements("f").count());
    assert!(text.len() < fs::read(&path).unwrap().len(), "the model continues lines");
}
