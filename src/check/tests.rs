use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::StdRng};

use super::*;
use crate::geometry::test_models;
use crate::mesh::shapes;
use crate::{Point, Vector};

const SEED: u64 = 31;

#[test]
fn sound_solids_have_no_findings() {
    for (mesh, genus) in [
        (shapes::sphere(1.0, 3), 0),
        (shapes::torus(1.0, 0.3, 20, 10), 1),
        (shapes::double_torus(2), 2),
        (shapes::cube(1.0, 2), 0),
    ] {
        let report = check(&mesh, Some(&|_| Ok(vec![])));
        assert_eq!(report.findings, []);
        assert!(report.is_solvable() && report.outward && report.closed && report.vertex_manifold);
        assert_eq!(report.components.len(), 1);
        let component = &report.components[0];
        assert_eq!((component.genus, component.kind), (Some(genus), ComponentKind::Solid));
        assert_eq!(component.euler_characteristic, 2 - 2 * genus as i64);
        assert!((report.volume.unwrap() - mesh.volume()).abs() < 1e-12 * mesh.volume());
        assert!((report.area - mesh.area()).abs() < 1e-12 * mesh.area());
        assert_eq!(report.diagonal, mesh.diagonal());
        assert!(repair(&mesh).1.is_empty());
    }
}

#[test]
fn a_missing_triangle_is_three_open_edges() {
    let whole = shapes::cube(1.0, 1);
    let (vertices, mut triangles) = whole.clone().into_parts();
    let gone = triangles.remove(7);
    let report = check_alone(vertices, triangles, FindingKind::OpenEdges, Severity::Error);
    let mut edges = [[gone[0], gone[1]], [gone[1], gone[2]], [gone[2], gone[0]]].map(sorted);
    edges.sort_unstable();
    assert_eq!(
        (report.findings[0].count, &report.findings[0].edges[..]),
        (3, &edges[..])
    );
    assert!(report.findings[0].message.contains("1 hole"));
    assert_eq!(report.components[0].kind, ComponentKind::NotAShell);
    assert_eq!((report.volume, report.closed), (None, false));
}

#[test]
fn a_fin_makes_its_edge_non_manifold() {
    let (mut vertices, mut triangles) = shapes::sphere(1.0, 1).into_parts();
    let [a, b, _] = triangles[9];
    triangles.push([a, b, vertices.len() as u32]);
    vertices.push(Point::new(3.0, 3.0, 3.0));
    let report = check(&mesh(vertices, triangles), None);
    let found = finding(&report, FindingKind::NonManifoldEdges);
    assert_eq!(
        (found.count, found.severity, &found.edges[..]),
        (1, Severity::Error, &[sorted([a, b])][..])
    );
    assert_eq!(finding(&report, FindingKind::OpenEdges).count, 2);
    assert!(!report.edge_manifold);
}

#[test]
fn a_pinch_is_a_warning() {
    let tetrahedron = |tip: u32, base: u32| {
        let [a, b, c] = [base, base + 1, base + 2];
        [[a, b, c], [b, a, tip], [c, b, tip], [a, c, tip]]
    };
    let mut vertices = vec![Point::origin()];
    vertices.extend([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0], [-1.0, -1.0, -1.0]].map(Point::from));
    vertices.extend([[1.0, 0.0, 1.0], [-1.0, -1.0, 1.0], [0.0, 1.0, 1.0]].map(Point::from));
    let triangles = [
        tetrahedron(0, 1).map(|[a, b, c]| [a, c, b]),
        tetrahedron(0, 4).map(|[a, b, c]| [a, c, b]),
    ]
    .concat();
    let report = check_alone(vertices, triangles, FindingKind::NonManifoldVertices, Severity::Warning);
    assert_eq!(
        (report.findings[0].count, &report.findings[0].vertices[..]),
        (1, &[0][..])
    );
    assert!(report.is_solvable() && !report.vertex_manifold && report.outward);
    assert_eq!(report.components.len(), 2);
}

#[test]
fn a_moebius_strip_and_a_klein_bottle_are_not_orientable() {
    // A torus whose tube is glued to itself mirrored: a Klein bottle, closed and manifold, but it bounds nothing.
    let (around, across) = (12, 8);
    let at = |i: u32, j: u32| {
        if i < around {
            i * across + j % across
        } else {
            (across - j % across) % across
        }
    };
    let squares = (0..around).flat_map(|i| (0..across).map(move |j| (i, j)));
    let triangles: Vec<[u32; 3]> = squares
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let vertices = shapes::torus(1.0, 0.3, around as usize, across as usize).into_parts().0;
    let bottle = check(&mesh(vertices.clone(), triangles.clone()), None);
    assert!(bottle.closed && bottle.edge_manifold && bottle.vertex_manifold && !bottle.is_solvable());
    assert_eq!(finding(&bottle, FindingKind::NonOrientable).count, 1);
    assert_eq!((bottle.components[0].genus, bottle.components[0].volume), (None, None));

    let strip = triangles
        .into_iter()
        .filter(|t| t.iter().all(|v| ![3, 4, 5].contains(&(v % across))))
        .collect();
    let strip = check(&mesh(vertices, strip), None);
    assert_eq!(finding(&strip, FindingKind::NonOrientable).severity, Severity::Error);
    assert!(strip.findings.iter().any(|f| f.kind == FindingKind::OpenEdges));
}

#[test]
fn reversed_triangles_are_found_and_repaired() {
    let whole = shapes::sphere(1.0, 2);
    let (vertices, mut triangles) = whole.clone().into_parts();
    let turned = [5, 6, 200];
    turned.iter().for_each(|&t| triangles[t as usize].swap(1, 2));
    let report = check_alone(
        vertices.clone(),
        triangles.clone(),
        FindingKind::InconsistentOrientation,
        Severity::Warning,
    );
    assert_eq!(report.findings[0].faces, turned);
    assert!(!report.consistently_oriented && !report.outward && report.is_solvable());
    assert!((report.volume.unwrap() - whole.volume()).abs() < 1e-12);
    let (repaired, repairs) = repair(&mesh(vertices, triangles));
    assert_eq!(repaired, whole);
    let expected = AppliedRepair {
        component: 0,
        faces: 3,
        kind: RepairKind::MadeConsistent,
    };
    assert_eq!(repairs, [expected]);
    assert_eq!(
        expected.to_string(),
        "component 0: reversed 3 triangles oriented unlike their neighbours"
    );
}

#[test]
fn an_inward_sphere_is_turned_outward() {
    let inward = shapes::sphere(1.0, 2).reversed();
    let (vertices, triangles) = inward.clone().into_parts();
    let report = check_alone(vertices, triangles, FindingKind::Inward, Severity::Warning);
    assert_eq!(report.findings[0].faces, (0..20).collect::<Vec<u32>>());
    assert!(report.components[0].volume.unwrap() < 0.0 && report.volume.unwrap() > 0.0 && !report.outward);
    let (repaired, repairs) = repair(&inward);
    assert_eq!(repaired, shapes::sphere(1.0, 2));
    assert_eq!(
        repairs,
        [AppliedRepair {
            component: 0,
            faces: 320,
            kind: RepairKind::TurnedOutward
        }]
    );
}

#[test]
fn nested_shells_alternate_between_solids_and_cavities() {
    // In no particular order, all oriented like solids, and one apart from the others.
    let ball = |radius, x| shapes::deformed(&shapes::sphere(radius, 2), |p| p + Vector::new(x, 0.0, 0.0));
    let parts = [
        ball(0.5, 0.0),
        ball(2.0, 0.0),
        ball(0.7, 9.0),
        ball(1.0, 0.0),
        ball(0.2, 1.5),
    ];
    let all = parts
        .iter()
        .skip(1)
        .fold(parts[0].clone(), |all, part| shapes::joined(&all, part));
    let report = check(&all, None);
    let found: Vec<_> = report.components.iter().map(|c| (c.kind, c.depth, c.inside)).collect();
    use ComponentKind::{Cavity, Solid};
    assert_eq!(
        found,
        [
            (Solid, Some(2), Some(3)),
            (Solid, Some(0), None),
            (Solid, Some(0), None),
            (Cavity, Some(1), Some(1)),
            (Cavity, Some(1), Some(1)),
        ]
    );
    let found = finding(&report, FindingKind::CavityOrientation);
    assert_eq!((found.count, found.severity), (2, Severity::Warning));
    assert_eq!(found.faces, (960..980).collect::<Vec<u32>>());
    assert_eq!(report.findings.len(), 1);

    let (repaired, repairs) = repair(&all);
    let kinds: Vec<_> = repairs.iter().map(|m| (m.component, m.kind)).collect();
    assert_eq!(
        kinds,
        [(3, RepairKind::TurnedIntoCavity), (4, RepairKind::TurnedIntoCavity)]
    );
    let sound = check(&repaired, None);
    assert!(sound.findings.is_empty() && sound.outward);
    assert!((sound.volume.unwrap() - repaired.volume()).abs() < 1e-12 * repaired.volume());
    assert_eq!(sound.volume, report.volume);
}

#[test]
fn overlapping_balls_are_told_apart_from_nested_ones() {
    let other = shapes::deformed(&shapes::sphere(0.5, 2), |p| p + Vector::new(1.0, 0.0, 0.0));
    let (vertices, triangles) = shapes::joined(&shapes::sphere(1.0, 2), &other).into_parts();
    let report = check_alone(vertices, triangles, FindingKind::OverlappingShells, Severity::Warning);
    assert!(
        report
            .components
            .iter()
            .all(|c| c.kind == ComponentKind::Solid && c.depth == Some(0))
    );
    assert!(report.outward);
}

#[test]
fn a_doubled_triangle_has_no_volume() {
    let vertices = vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0)];
    let report = check(&mesh(vertices, vec![[0, 1, 2], [0, 2, 1]]), None);
    let found = finding(&report, FindingKind::ZeroVolume);
    assert_eq!((found.severity, &found.faces[..]), (Severity::Error, &[0, 1][..]));
    assert_eq!(finding(&report, FindingKind::DuplicateFaces).faces, [1]);
    assert_eq!(report.volume, None);
}

#[test]
fn triangles_without_area_are_warnings() {
    let (mut vertices, mut triangles) = shapes::cube(1.0, 2).into_parts();
    let [a, b, c] = triangles[0];
    let middle = vertices.len() as u32;
    vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
    triangles[0] = [a, middle, c];
    triangles.extend([[middle, b, c], [a, b, middle]]);
    let flat = triangles.len() as u32 - 1;
    let report = check_alone(vertices, triangles, FindingKind::DegenerateFaces, Severity::Warning);
    assert_eq!(
        (report.findings[0].count, &report.findings[0].faces[..]),
        (1, &[flat][..])
    );
    assert!((report.volume.unwrap() - 1.0).abs() < 1e-15);
}

#[test]
fn triangles_that_name_a_vertex_twice_are_warnings() {
    let (vertices, mut triangles) = shapes::cube(1.0, 2).into_parts();
    triangles.insert(3, [4, 5, 4]);
    triangles.insert(6, [1, 1, 1]);
    let report = check_alone(vertices, triangles, FindingKind::RepeatedCornerFaces, Severity::Warning);
    assert_eq!(report.findings[0].faces, [3, 6]);
}

#[test]
fn doubled_and_unused_vertices_are_warnings() {
    let (mut vertices, triangles) = shapes::cube(1.0, 1).into_parts();
    let used = vertices.len() as u32;
    vertices.extend([Point::new(9.0, 9.0, 9.0), vertices[2]]);
    let report = check(&mesh(vertices, triangles), None);
    assert_eq!(
        finding(&report, FindingKind::UnreferencedVertices).vertices,
        [used, used + 1]
    );
    assert_eq!(finding(&report, FindingKind::DuplicateVertices).vertices, [used + 1]);
    assert!(report.is_solvable() && report.errors().count() == 0 && report.warnings().count() == 2);
}

#[test]
fn the_advice_for_a_triangle_soup_is_to_merge_vertices() {
    let cube = shapes::cube(1.0, 1);
    let vertices: Vec<Point> = (0..12).flat_map(|t| cube.corners(t)).collect();
    let report = check(
        &mesh(vertices, (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect()),
        None,
    );
    let found = finding(&report, FindingKind::OpenEdges);
    assert_eq!(found.count, 36);
    assert!(found.advice.contains("that closes the surface"), "{}", found.advice);
    assert_eq!(finding(&report, FindingKind::DuplicateVertices).count, 28);
}

#[test]
fn vertices_that_are_not_finite_are_errors() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let (mut vertices, triangles) = shapes::sphere(1.0, 1).into_parts();
        vertices[11].y = bad;
        let report = check_alone(vertices, triangles, FindingKind::NonFiniteVertices, Severity::Error);
        assert_eq!(report.findings[0].vertices, [11]);
        assert!(report.area.is_finite() && report.diagonal.is_finite() && report.volume.is_none());
    }
}

#[test]
fn no_triangles_are_an_error() {
    let nothing = check_alone(vec![], vec![], FindingKind::Empty, Severity::Error);
    assert_eq!(
        (nothing.bounding_box, nothing.outward, nothing.closed),
        (None, false, false)
    );
    let points = check(&mesh(vec![Point::origin(); 2], vec![[0, 1, 0]]), None);
    assert_eq!(finding(&points, FindingKind::Empty).severity, Severity::Error);
}

#[test]
fn the_finder_of_self_intersections_gets_no_bad_triangles() {
    let (mut vertices, mut triangles) = shapes::cube(1.0, 1).into_parts();
    vertices.insert(0, Point::new(f64::NAN, 0.0, 0.0));
    triangles.iter_mut().for_each(|t| *t = t.map(|v| v + 1));
    triangles.insert(0, [1, 1, 2]);
    triangles.insert(5, [0, 3, 4]);
    let whole = mesh(vertices, triangles);
    let find = |given: &SurfaceMesh| {
        assert!(given.vertices().iter().all(|p| p.x.is_finite()));
        assert_eq!((given.vertices().len(), given.triangles().len()), (8, 12));
        for (t, original) in (0..12).zip((1..5).chain(6..14)) {
            assert_eq!(given.corners(t), whole.corners(original));
        }
        Ok(vec![[0, 4], [3, 11], [99, 0]])
    };
    let report = check(&whole, Some(&find));
    let found = finding(&report, FindingKind::SelfIntersections);
    assert_eq!(
        (found.count, found.severity, &found.faces[..]),
        (2, Severity::Warning, &[1, 4, 6, 13][..])
    );
    assert_eq!(report.self_intersections, SelfIntersections::Checked { pairs: 2 });
}

#[test]
fn the_report_says_why_self_intersections_were_not_checked() {
    let sphere = shapes::sphere(1.0, 1);
    let reason = "CGAL ran out of memory";
    let report = check(&sphere, Some(&|_| Err(reason.to_string())));
    assert_eq!(
        report.self_intersections,
        SelfIntersections::NotChecked {
            reason: reason.to_string()
        }
    );
    assert!(report.to_string().contains(reason));
    assert!(
        check(&sphere, None)
            .to_string()
            .contains("not checked: built without `native`")
    );
}

#[test]
fn the_report_reads_as_text_and_as_json() {
    let (vertices, mut triangles) = shapes::sphere(1.0, 1).into_parts();
    triangles.remove(0);
    let report = check(&mesh(vertices, triangles), None);
    let text = report.to_string();
    for line in [
        "Not solvable: 1 error.",
        "  closed                 NO",
        "error: 3 open edges around 1 hole",
        "  repair: fill the holes",
    ] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
    assert!(
        text.lines().all(|line| line.len() <= 100 || line.starts_with("error")),
        "{text}"
    );
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["findings"][0]["kind"], "open_edges");
    assert_eq!(json["findings"][0]["severity"], "error");
    assert_eq!(json["components"][0]["kind"], "not_a_shell");
    assert_eq!(json["self_intersections"]["status"], "not_checked");
    assert_eq!(json["volume"], serde_json::Value::Null);
}

/// Counts as in MODELS.md beside the models.
#[test]
fn bad_models_have_their_known_findings() {
    use FindingKind::*;
    let known: [(&str, &[(FindingKind, usize)]); 13] = [
        (
            "teapot_utah",
            &[(OpenEdges, 1036), (NonManifoldVertices, 38), (DuplicateVertices, 403)],
        ),
        ("bunny_open", &[(OpenEdges, 223), (UnreferencedVertices, 1113)]),
        ("happy_buddha_g6_selfint", &[(Inward, 1)]),
        (
            "camel_ref_nonmanifold",
            &[
                (OpenEdges, 5),
                (NonManifoldEdges, 26),
                (NonManifoldVertices, 3),
                (DuplicateFaces, 14),
            ],
        ),
        (
            "bunny_degenerate_faces",
            &[(DegenerateFaces, 16), (DuplicateVertices, 7)],
        ),
        ("self_intersect", &[]),
        ("hull_mask_3parts", &[]),
        ("box_not_manifold", &[(OpenEdges, 4)]),
        ("joined_tetrahedra", &[(NonManifoldEdges, 3), (DuplicateFaces, 1)]),
        (
            "chair_doubled",
            &[
                (NonManifoldEdges, 9545),
                (DuplicateFaces, 6382),
                (DuplicateVertices, 28),
            ],
        ),
        ("hourglass_pinched_vertex", &[(NonManifoldVertices, 1)]),
        (
            "moebius",
            &[(OpenEdges, 112), (NonOrientable, 1), (InconsistentOrientation, 4)],
        ),
        ("fan3", &[(OpenEdges, 6), (NonManifoldEdges, 1)]),
    ];
    for (name, expected) in known {
        let Some(model) = test_models::load(&format!("bad/{name}.obj")) else {
            return;
        };
        let report = check(&model, None);
        let found: Vec<_> = report.findings.iter().map(|f| (f.kind, f.count)).collect();
        assert_eq!(found, expected, "{name}");
        let (repaired, repairs) = repair(&model);
        assert_eq!(
            (repaired == model, repaired.vertices()),
            (repairs.is_empty(), model.vertices()),
            "{name}"
        );
    }
    let buddha = test_models::load("bad/happy_buddha_g6_selfint.obj").unwrap();
    assert_eq!(check(&buddha, None).components[0].genus, Some(6));
    assert!(check(&repair(&buddha).0, None).findings.is_empty());
    check(&test_models::load("bad/wallhole_line_continuation.obj").unwrap(), None);
}

#[test]
fn good_models_are_healthy() {
    for (name, genus) in [
        ("kitten_g1_9k", 1),
        ("three_holes_g3_uv_2k", 3),
        ("double_torus_g2_3k", 2),
        ("bunny_50k", 0),
    ] {
        let Some(model) = test_models::load(&format!("surfaces/{name}.obj")) else {
            return;
        };
        let report = check(&model, None);
        assert_eq!(report.findings, [], "{name}");
        assert_eq!(report.components[0].genus, Some(genus), "{name}");
    }
}

#[test]
fn repair_undoes_any_reversal_of_triangles() {
    let solid = shapes::joined(&shapes::spherical_shell(1.0, 0.5, 2), &shapes::sphere(0.2, 1));
    let mut random = StdRng::seed_from_u64(SEED);
    for _ in 0..5 {
        let mut triangles = solid.triangles().to_vec();
        let share = random.random_range(0.0..1.0);
        for triangle in triangles.iter_mut().filter(|_| random.random_bool(share)) {
            triangle.swap(1, 2);
        }
        assert_eq!(repair(&mesh(solid.vertices().to_vec(), triangles)).0, solid);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// Random triangles must not make it panic, and repairing changes the order of corners alone.
    #[test]
    fn random_triangles_are_checked_and_repaired_without_a_panic(
        triangles in prop::collection::vec(prop::array::uniform3(0..9u32), 0..40),
        coordinates in prop::collection::vec(prop::sample::select(vec![0.0, 1.0, -1.0, 0.3, 1e-300, 1e300, f64::NAN, f64::INFINITY]), 27),
    ) {
        let vertices = coordinates.chunks(3).map(|x| Point::new(x[0], x[1], x[2])).collect();
        let tangle = mesh(vertices, triangles);
        let report = check(&tangle, Some(&|_| Ok(vec![])));
        let _ = report.to_string();
        serde_json::to_string(&report).unwrap();
        let (repaired, _) = repair(&tangle);
        for (before, after) in tangle.triangles().iter().zip(repaired.triangles()) {
            prop_assert!(before == after || [before[0], before[2], before[1]] == *after);
        }
        prop_assert!(repair(&repaired).1.is_empty());
    }
}

/// A report with this finding and no other.
fn check_alone(vertices: Vec<Point>, triangles: Vec<[u32; 3]>, kind: FindingKind, severity: Severity) -> CheckReport {
    let report = check(&mesh(vertices, triangles), None);
    let found: Vec<_> = report.findings.iter().map(|f| (f.kind, f.severity)).collect();
    assert_eq!(found, [(kind, severity)]);
    assert_eq!(report.is_solvable(), severity == Severity::Warning);
    report
}

fn finding(report: &CheckReport, kind: FindingKind) -> &Finding {
    let found = report.findings.iter().find(|f| f.kind == kind);
    found.unwrap_or_else(|| panic!("no {kind:?} in {report}"))
}

fn mesh(vertices: Vec<Point>, triangles: Vec<[u32; 3]>) -> SurfaceMesh {
    SurfaceMesh::new(vertices, triangles).unwrap()
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
