//! Polycubes of solids that are their own, of balls and of a torus, checked from what is returned alone.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use super::*;
use crate::baseline::test_meshes;
use crate::geometry::flipped_tets;
use crate::mesh::shapes;
use crate::mesh::topology::Topology;
use crate::remesh::{CellKind, Polycube, regular_mesh};
use crate::{Matrix3, Vector};

fn made(mesh: &TetMesh) -> PolycubeMap {
    make_polycube(mesh, &PolycubeOptions::default(), &|_| {}).unwrap()
}

/// Tetrahedra of boxes.
fn boxes(cubes: &[[i32; 3]], size: f64) -> TetMesh {
    let polycube = Polycube::of(&shapes::polycube(cubes, 1)).unwrap();
    let mesh = regular_mesh(&polycube, size, CellKind::Tets, 1_000_000).unwrap();
    match mesh.cells() {
        crate::mesh::CellList::Tets(tets) => TetMesh::new(mesh.nodes().to_vec(), tets.clone()).unwrap(),
        crate::mesh::CellList::Hexes(_) => panic!("tetrahedra were asked for"),
    }
}

/// Everything that is promised of a polycube, except that it is found.
fn check(found: &PolycubeMap, model: &TetMesh) {
    assert_eq!(found.model.tets(), found.polycube.tets());
    assert_eq!(&found.model.vertices()[..model.vertices().len()], model.vertices());
    assert!((found.model.volume() - model.volume()).abs() < 1e-12 * model.volume());
    assert_eq!(
        flipped_tets(&found.model, found.polycube.vertices()).unwrap().count(),
        0
    );
    assert!(
        found
            .polycube
            .tets()
            .iter()
            .enumerate()
            .all(|(t, _)| found.polycube.signed_volume(t) > 0.0)
    );
    let [polycube, own] = found.surfaces();
    assert_eq!(polycube.triangles(), own.triangles());
    let given = model.boundary().surface;
    assert!((own.area() - given.area()).abs() < 1e-12 * given.area());
    let shape = |surface: &SurfaceMesh| {
        let components = Topology::new(surface).components();
        components
            .shapes
            .iter()
            .map(|shape| (shape.genus(), shape.closed))
            .collect::<Vec<_>>()
    };
    assert_eq!(shape(&polycube), shape(&given));
    // The remesher finds the planes, and a volume that is the surface's.
    Polycube::of(&polycube).unwrap();
    assert!((polycube.volume() - found.polycube.volume()).abs() < 1e-12 * polycube.volume());
    let mut planes: [BTreeMap<u64, usize>; 3] = Default::default();
    for (t, &label) in (0..).zip(&found.labels) {
        let [a, b, c] = found.boundary[t].map(|v| found.polycube.vertices()[v as usize]);
        let axis = usize::from(label / 2);
        assert!(a[axis].to_bits() == b[axis].to_bits() && b[axis].to_bits() == c[axis].to_bits());
        let area = (b - a).cross(&(c - a))[axis];
        assert!(area != 0.0 && (area > 0.0) == (label % 2 == 1));
        *planes[axis].entry(a[axis].to_bits()).or_default() += 1;
    }
    assert_eq!(found.report.planes, planes.map(|across| across.len()));
    assert_eq!((found.report.inverted, found.report.crossings), (0, 0));
}

#[test]
fn boxes_an_l_and_a_ring_return_themselves() {
    let ring: Vec<[i32; 3]> = (0..9).filter(|k| *k != 4).map(|k| [k % 3, k / 3, 0]).collect();
    for (cubes, charts, corners) in [
        (vec![[0, 0, 0]], 6, 8),
        (vec![[0, 0, 0], [1, 0, 0], [0, 1, 0]], 8, 12),
        (ring, 10, 16),
    ] {
        let model = boxes(&cubes, 0.25);
        let found = made(&model);
        check(&found, &model);
        let report = &found.report;
        assert_eq!((report.charts, report.corners, report.attempts), (charts, corners, 1));
        assert!((report.energy - 7.0).abs() < 1e-6, "{}", report.energy);
        assert_eq!(report.labels, LabelSource::Cut);
        let shift = found.polycube.vertices()[0] - found.model.vertices()[0];
        let pairs = found.polycube.vertices().iter().zip(found.model.vertices());
        let most = pairs.map(|(a, b)| (a - b - shift).norm()).fold(0.0, f64::max);
        assert!(most < 1e-3, "{most}");
    }
}

#[test]
fn a_ball_becomes_a_cube_and_a_torus_stays_one() {
    let ball = test_meshes::ball(5);
    let found = made(&ball);
    check(&found, &ball);
    assert_eq!(found.report.charts, 6);
    let distortion = found.report.distortion.unwrap();
    assert!(
        distortion.angle.p99 < 3.5 && distortion.area.p99 < 4.0,
        "{distortion:?}"
    );

    let torus = test_meshes::torus(3);
    let found = made(&torus);
    check(&found, &torus);
    assert!(found.report.charts >= 10, "{}", found.report.charts);
}

#[test]
fn planes_are_put_on_a_lattice_and_everything_else_still_holds() {
    let boxes = boxes(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], 0.25);
    for (model, size) in [
        (test_meshes::ball(4), CellSize::Along(7)),
        (test_meshes::torus(3), CellSize::Length(0.21)),
        (boxes, CellSize::Along(9)),
    ] {
        let options = PolycubeOptions {
            lattice: Some(size),
            ..PolycubeOptions::default()
        };
        let found = make_polycube(&model, &options, &|_| {}).unwrap();
        check(&found, &model);
        let cell = found.report.lattice.unwrap();
        if let CellSize::Length(length) = size {
            assert!((cell - length).abs() < 1e-12);
        }
        for (corners, label) in found.boundary.iter().zip(&found.labels) {
            let height = found.polycube.vertices()[corners[0] as usize][axis_of(*label)] / cell;
            assert!((height - height.round()).abs() < 1e-9, "{height}");
        }
        // No boxes but those of the lattice, and none of them lost: faces keep a cell between them.
        let polycube = Polycube::of(&found.surfaces()[0]).unwrap();
        for across in polycube.planes() {
            assert!(across.windows(2).all(|w| w[1] - w[0] > 0.99 * cell));
        }
        assert!((found.polycube.volume() / model.volume() - 1.0).abs() < 0.3);
    }
    // No lattice has as many cells: the polycube is not on it, and nothing overflows.
    for size in [1e-300, 1e-12] {
        let options = PolycubeOptions {
            lattice: Some(CellSize::Length(size)),
            ..PolycubeOptions::default()
        };
        let found = make_polycube(&test_meshes::ball(3), &options, &|_| {}).unwrap();
        assert_eq!(found.report.lattice, None);
    }
}

#[test]
fn size_does_not_matter_and_axes_may_be_exchanged() {
    let ball = test_meshes::ball(4);
    let first = made(&ball);
    for scale in [1024.0, 1.0 / 4096.0] {
        let moved = ball.with_vertices(ball.vertices().iter().map(|p| p * scale).collect());
        let other = made(&moved.unwrap());
        let pairs = first.polycube.vertices().iter().zip(other.polycube.vertices());
        assert!(pairs.clone().count() > 0 && pairs.clone().all(|(a, b)| (a * scale - b).norm() == 0.0));
    }
    let turn = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
    let turned = ball
        .with_vertices(ball.vertices().iter().map(|p| turn * p).collect())
        .unwrap();
    let other = made(&turned);
    check(&other, &turned);
    assert_eq!(other.report.charts, first.report.charts);
}

#[test]
fn two_runs_give_the_same_and_left_handed_cells_are_turned() {
    let torus = test_meshes::torus(2);
    let first = made(&torus);
    assert_eq!(made(&torus).polycube, first.polycube);
    let (nodes, mut tets) = torus.clone().into_parts();
    tets.iter_mut().step_by(2).for_each(|t| t.swap(0, 1));
    let other = made(&TetMesh::new(nodes, tets).unwrap());
    check(&other, &torus);
}

#[test]
fn a_twisted_bar_has_a_polycube_from_some_source() {
    // A screw: its sides turn through all directions.
    let bar = boxes(&(0..6).map(|k| [0, 0, k]).collect::<Vec<_>>(), 0.34);
    let twisted = |p: &Point| {
        let (sin, cos) = (1.1 * p.z).sin_cos();
        let (x, y) = (p.x - 0.5, p.y - 0.5);
        Point::new(cos * x - sin * y, sin * x + cos * y, p.z)
    };
    let model = bar.with_vertices(bar.vertices().iter().map(twisted).collect()).unwrap();
    let found = made(&model);
    check(&found, &model);
    assert_eq!(
        found.report.labels == LabelSource::Sphere,
        found.report.smoothness == 0.0
    );
}

/// An attempt from the map to the sphere alone.
fn from_the_sphere(mesh: &TetMesh) -> Option<Attempt> {
    let respond = |_: PolycubePhase| crate::progress::ProgressControl::Continue;
    let work = |monitor: &ProgressSender<PolycubePhase>| {
        let mut solid = Solid::new(mesh.clone()).unwrap();
        scale_to_unit(&mut solid);
        solid.split_between_boundary_nodes(10_000);
        attempt(&solid, Way::Sphere, &PolycubeOptions::default(), 10_000, monitor).unwrap()
    };
    run_cancellable(&respond, work).unwrap()
}

#[test]
fn the_map_to_the_sphere_gives_six_charts_and_none_for_a_torus() {
    let bar = boxes(&[[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0]], 0.34);
    let found = from_the_sphere(&bar).unwrap();
    assert_eq!((found.faults(), found.report.charts, found.report.corners), (0, 6, 8));
    assert_eq!(found.report.labels, LabelSource::Sphere);
    assert!(from_the_sphere(&test_meshes::torus(2)).is_none());
}

#[test]
fn turned_boxes_return_boxes_where_they_are_turned_back() {
    for (cubes, charts) in [(vec![[0, 0, 0]], 6), (vec![[0, 0, 0], [1, 0, 0], [0, 1, 0]], 8)] {
        let model = boxes(&cubes, 0.34);
        for angles in [[0.6, 0.42, 0.1], [-0.3, 1.9, 0.7], [2.5, -0.4, -1.2]] {
            let turn = nalgebra::Rotation3::new(Vector::from(angles));
            let turned = model.vertices().iter().map(|p| turn * p).collect();
            let turned = model.with_vertices(turned).unwrap();
            let make = |orientation| {
                let options = PolycubeOptions {
                    orientation,
                    ..PolycubeOptions::default()
                };
                make_polycube(&turned, &options, &|_| {}).unwrap()
            };
            let found = make(Orientation::Principal);
            check(&found, &turned);
            assert_eq!((found.report.charts, found.report.attempts), (charts, 1));
            assert!((found.report.energy - 7.0).abs() < 1e-6, "{}", found.report.energy);
            // The labels are those of the box, with its axes by other names.
            let own = labels_of_boxes(&model);
            let name_of = |label: u8| {
                let same = own.iter().filter(|(_, own)| *own == label).map(|(t, _)| t);
                let of = |t: &[u32; 3]| found.given_labels.iter().find(|(other, _)| is_same(t, other));
                let mut names: Vec<u8> = same.filter_map(of).map(|(_, label)| *label).collect();
                names.dedup();
                names
            };
            let mut names: Vec<u8> = (0..6).flat_map(name_of).collect();
            assert_eq!(names.len(), 6, "{names:?}");
            names.sort_unstable();
            assert_eq!(names, [0, 1, 2, 3, 4, 5]);
            // The rotation that is reported takes the model to the polycube.
            let rows = found.report.turn.unwrap();
            let back = Matrix3::from_fn(|i, j| rows[i][j]);
            let shift = found.polycube.vertices()[0] - back * found.model.vertices()[0];
            for (image, p) in found.polycube.vertices().iter().zip(found.model.vertices()) {
                assert!((image - back * p - shift).norm() < 1e-3);
            }
            assert!(make(Orientation::Best).report.energy <= found.report.energy);
        }
        // What is along the axes stays, bit for bit.
        let [given, principal] = [Orientation::Given, Orientation::Principal].map(|orientation| {
            let options = PolycubeOptions {
                orientation,
                ..PolycubeOptions::default()
            };
            make_polycube(&model, &options, &|_| {}).unwrap()
        });
        assert_eq!((given.polycube, principal.report.turn), (principal.polycube, None));
    }
}

#[test]
fn the_best_attempt_says_where_it_is_bad() {
    // Stairs around a tower that always rise: every chart and corner is possible, but no heights of the steps are.
    let cubes: Vec<[i32; 3]> = (0..9).map(|k| [k % 3, k / 3, 0]).chain([[1, 1, 1]]).collect();
    let model = boxes(&cubes, 1.0 / 3.0);
    let riser = |p: &Vector| {
        let (x, y) = (p.x, p.y);
        let is_between = |c: f64| (4.0 / 3.0..5.0 / 3.0).contains(&c);
        match (is_between(x), is_between(y)) {
            (true, _) if y < 1.0 => Some(0),
            (_, true) if x > 2.0 => Some(2),
            (true, _) if y > 2.0 => Some(1),
            (_, true) if x < 1.0 => Some(3),
            _ => None,
        }
    };
    let stairs = |&(t, label): &([u32; 3], u8)| {
        let centre = t.iter().map(|&v| model.vertices()[v as usize].coords).sum::<Vector>() / 3.0;
        let is_step = label == 5 && centre.z < 1.5;
        (t, riser(&centre).filter(|_| is_step).unwrap_or(label))
    };
    let labels: Vec<_> = labels_of_boxes(&model).iter().map(stairs).collect();
    let error = with_labels(&model, &labels).map(|_| ()).unwrap_err();
    let MakePolycubeError::NotFound {
        inverted,
        crossings,
        charts,
        attempts,
        best,
    } = &error
    else {
        panic!("{error}")
    };
    assert!(inverted + crossings > 0);
    // Four steps, four risers, the tower's top and sides, the other sides and the bottom.
    assert_eq!((*charts, *attempts, best.report.labels), (18, 1, LabelSource::Given));
    assert_eq!(best.model.tets(), best.polycube.tets());
    assert_eq!(&best.model.vertices()[..model.vertices().len()], model.vertices());
    // All that is inverted is bad, and each bad cell is in one place.
    let flipped = flipped_tets(&best.model, best.polycube.vertices()).unwrap();
    assert!(flipped.count() <= best.bad.iter().filter(|bad| **bad).count());
    for t in 0..best.polycube.tets().len() {
        assert!(best.bad[t] || best.polycube.signed_volume(t) > 0.0);
    }
    let in_places: usize = best.places.iter().map(|place| place.cells).sum();
    assert_eq!(in_places, best.bad.iter().filter(|bad| **bad).count());
    assert!(best.places.windows(2).all(|pair| pair[0].cells >= pair[1].cells));
    assert_eq!(best.cell_labels.iter().flatten().count() > 0, !best.labels.is_empty());
    // What is said of a place is so: charts of the boundary, whose triangles add up, near where it is.
    for place in &best.places {
        assert!(!place.charts.is_empty());
        for chart in &place.charts {
            let of_label = best.labels.iter().filter(|label| **label == chart.label).count();
            assert!((1..=of_label).contains(&chart.triangles), "{chart}");
            let [x, y, z] = chart.position;
            assert!(
                [x, y].iter().all(|c| (0.0..=3.0).contains(c)) && (0.0..=2.0).contains(&z),
                "{chart}"
            );
        }
        let [x, y, z] = place.position;
        assert!(
            [x, y].iter().all(|c| (0.0..=3.0).contains(c)) && (0.0..=2.0).contains(&z),
            "{place:?}"
        );
    }
    // A riser is at one of them.
    let risers = best.places.iter().flat_map(|place| &place.charts);
    assert!(
        risers.clone().any(|chart| chart.label < 4 && chart.position[2] > 0.99),
        "{error}"
    );
    let (said, first) = (error.to_string(), &best.places[0]);
    assert!(said.contains(&format!("{} near (", first.cells)), "{said}");
    assert!(
        said.contains(&first.charts[0].to_string()) && said.contains("Other labels"),
        "{said}"
    );
}

/// Whether two triangles have the same corners.
fn is_same(a: &[u32; 3], b: &[u32; 3]) -> bool {
    a.iter().all(|v| b.contains(v))
}

/// The boundary triangles of a mesh, by its nodes.
fn boundary_of(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let boundary = mesh.boundary();
    let node = |v: u32| boundary.vertex_ids[v as usize];
    boundary.surface.triangles().iter().map(|t| t.map(node)).collect()
}

fn with_labels(mesh: &TetMesh, labels: &[([u32; 3], u8)]) -> Result<PolycubeMap, MakePolycubeError> {
    make_polycube_with_labels(mesh, labels, &PolycubeOptions::default(), &|_| {})
}

/// Labels of boxes by where their triangles face.
fn labels_of_boxes(mesh: &TetMesh) -> Vec<([u32; 3], u8)> {
    let label = |t: [u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.vertices()[v as usize]);
        let area = (b - a).cross(&(c - a));
        let axis = area.iamax();
        (t, (2 * axis + usize::from(area[axis] > 0.0)) as u8)
    };
    boundary_of(mesh).into_iter().map(label).collect()
}

#[test]
fn labels_of_a_polycube_make_it_again_bit_for_bit() {
    for model in [test_meshes::ball(4), test_meshes::torus(2)] {
        let found = made(&model);
        let mut sorted = boundary_of(&model);
        let mut given: Vec<[u32; 3]> = found.given_labels.iter().map(|(t, _)| *t).collect();
        for triangles in [&mut sorted, &mut given] {
            triangles.iter_mut().for_each(|t| t.sort_unstable());
            triangles.sort_unstable();
        }
        assert_eq!(sorted, given);
        assert!(found.boundary.len() > given.len(), "some triangles were split");
        // Neither the order of the triangles nor that of their corners matters.
        let mut labels = found.given_labels.clone();
        labels.reverse();
        labels.iter_mut().for_each(|(t, _)| t.swap(0, 2));
        let again = with_labels(&model, &labels).unwrap();
        check(&again, &model);
        assert_eq!(again.polycube, found.polycube);
        assert_eq!((&again.boundary, &again.labels), (&found.boundary, &found.labels));
        assert_eq!((again.report.labels, again.report.attempts), (LabelSource::Given, 1));
    }
}

#[test]
fn boxes_with_labels_return_themselves() {
    for cubes in [vec![[0, 0, 0]], vec![[0, 0, 0], [1, 0, 0], [0, 1, 0]]] {
        let model = boxes(&cubes, 0.34);
        let found = with_labels(&model, &labels_of_boxes(&model)).unwrap();
        check(&found, &model);
        assert!((found.report.energy - 7.0).abs() < 1e-6, "{}", found.report.energy);
    }
}

#[test]
fn impossible_labels_are_refused_by_the_triangle_at_fault() {
    let model = boxes(&[[0, 0, 0]], 0.25);
    let good = labels_of_boxes(&model);
    let centre = |t: [u32; 3]| {
        let corners = t.map(|v| model.vertices()[v as usize].coords);
        corners.iter().sum::<Vector>() / 3.0
    };
    let refused = |labels: &[([u32; 3], u8)]| with_labels(&model, labels).map(|_| ()).unwrap_err();
    let problem = |labels: &[([u32; 3], u8)]| match refused(labels) {
        MakePolycubeError::Labels { triangle, problem } => (triangle, problem),
        other => panic!("{other}"),
    };
    // Those that do not fit the boundary.
    let mut labels = good.clone();
    labels[7].1 = 6;
    assert_eq!(problem(&labels), (7, LabelProblem::Unknown(6)));
    labels[7] = labels[3];
    assert_eq!(problem(&labels), (7, LabelProblem::Repeated));
    labels[7] = ([0, 1, u32::MAX], 0);
    assert_eq!(problem(&labels), (7, LabelProblem::NotOnBoundary));
    let missing = good.last().unwrap().0;
    assert_eq!(
        refused(&good[..good.len() - 1]),
        MakePolycubeError::MissingLabel(missing)
    );
    assert!(matches!(refused(&[]), MakePolycubeError::MissingLabel(_)));
    // Positive and negative directions exchanged.
    let mirrored: Vec<_> = good.iter().map(|&(t, label)| (t, label ^ 1)).collect();
    assert_eq!(refused(&mirrored), MakePolycubeError::MirroredLabels);

    // One triangle in the middle of +z: towards -z, or a chart with a border without corners.
    let in_middle = |&(t, label): &([u32; 3], u8)| {
        let p = centre(t);
        label == 5 && (0.3..0.7).contains(&p.x) && (0.3..0.7).contains(&p.y)
    };
    let k = good.iter().position(in_middle).unwrap();
    let mut labels = good.clone();
    labels[k].1 = 4;
    let (triangle, found) = problem(&labels);
    let LabelProblem::Opposite { label, other } = found else {
        panic!("{found}")
    };
    assert_eq!(labels[triangle].1, label);
    assert_eq!((labels[other].1 ^ 1, triangle == k || other == k), (label, true));
    labels[k].1 = 1;
    let (triangle, found) = problem(&labels);
    let LabelProblem::FewCorners { chart, corners } = &found else {
        panic!("{found}")
    };
    assert_eq!(*corners, 0);
    assert!((triangle == k && chart.triangles == 1) || (labels[triangle].1 == 5 && chart.label == 5));
    assert!(found.to_string().contains("0 corners"), "{found}");

    // Two triangles that meet at a node alone.
    let meet = |a: [u32; 3], b: [u32; 3]| a.iter().filter(|v| b.contains(v)).count() == 1;
    let is_inside = |t: [u32; 3]| (0.2..0.8).contains(&centre(t).x) && (0.2..0.8).contains(&centre(t).y);
    let second = good
        .iter()
        .position(|other| other.1 == 5 && is_inside(other.0) && meet(other.0, good[k].0));
    let mut labels = good.clone();
    let second = second.unwrap();
    (labels[k].1, labels[second].1) = (1, 1);
    let (triangle, found) = problem(&labels);
    assert_eq!(found, LabelProblem::Crowded { borders: 4 });
    let [a, b] = [good[k].0, good[second].0];
    let corner = a.iter().find(|v| b.contains(v)).unwrap();
    assert!(labels[triangle].0.contains(corner));

    // A single chart.
    let all: Vec<_> = good.iter().map(|&(t, _)| (t, 5)).collect();
    let (triangle, found) = problem(&all);
    assert!(
        triangle == 0 && matches!(&found, LabelProblem::Whole(chart) if chart.triangles == all.len()),
        "{found}"
    );
}

#[test]
fn labels_without_a_layout_are_refused_by_their_chart() {
    // The sides of a bump exchanged along one axis: every chart and corner is possible, but they are in the wrong order.
    let cubes: Vec<[i32; 3]> = (0..9).map(|k| [k % 3, k / 3, 0]).chain([[1, 1, 1]]).collect();
    let model = boxes(&cubes, 0.5);
    let good = labels_of_boxes(&model);
    with_labels(&model, &good).unwrap();
    let is_side = |t: [u32; 3]| {
        let heights = t.map(|v| model.vertices()[v as usize].z);
        heights.iter().all(|&z| z > 0.99) && heights.iter().any(|&z| z > 1.01) && heights.iter().any(|&z| z < 1.99)
    };
    let exchange = |&(t, label): &([u32; 3], u8)| (t, if is_side(t) && label < 2 { label ^ 1 } else { label });
    let bad: Vec<_> = good.iter().map(exchange).collect();
    assert_ne!(bad, good);
    let error = with_labels(&model, &bad).map(|_| ()).unwrap_err();
    let MakePolycubeError::Labels { triangle, problem } = &error else {
        panic!("{error}")
    };
    let LabelProblem::NoLayout(charts) = problem else {
        panic!("{error}")
    };
    assert_eq!(bad[*triangle].1, charts[0].label);
    // It is the one around the bump: the corners of its hole turn to both sides.
    assert_eq!(
        (charts.len(), charts[0].label, charts[0].position[2]),
        (1, 5, 1.0),
        "{error}"
    );
}

#[test]
fn parts_within_another_are_found() {
    let (mut nodes, mut tets) = test_meshes::cube(2).into_parts();
    let count = nodes.len() as u32;
    let inner: Vec<Point> = nodes
        .iter()
        .map(|p| Point::new(5.0, 0.0, 0.0) + 0.1 * p.coords)
        .collect();
    nodes.extend(inner);
    tets.extend(tets.clone().iter().map(|t| t.map(|v| v + count)));
    let mut solid = Solid::new(TetMesh::new(nodes, tets).unwrap()).unwrap();
    assert_eq!(solid.nested_parts(), 0);
    for p in &mut solid.x[count as usize..] {
        *p -= Vector::new(4.57, -0.41, -0.43);
    }
    assert_eq!(solid.nested_parts(), 1);
}

/// A cube with a roof on it, whose ridge has one direction on both sides.
#[test]
fn sharp_edges_are_edges_of_the_polycube_unless_both_sides_face_along_one_axis() {
    let cube = test_meshes::cube(4);
    let [low, high] = [f64::min, f64::max].map(|of: fn(f64, f64) -> f64| {
        let x = cube.vertices().iter().map(|p| p.x);
        x.reduce(of).unwrap()
    });
    let (middle, side) = (0.5 * (low + high), high - low);
    let up = |p: &Point| Point::new(p.x, p.y, p.z + 0.3 * (0.5 * side - (p.x - middle).abs()));
    let house = TetMesh::new(cube.vertices().iter().map(up).collect(), cube.tets().to_vec()).unwrap();
    let features = |mesh: &TetMesh, degrees: f64| {
        let options = PolycubeOptions {
            feature_angle: Some(degrees),
            ..PolycubeOptions::default()
        };
        make_polycube(mesh, &options, &|_| {}).unwrap().report.features.unwrap()
    };
    let of_cube = features(&cube, 60.0);
    assert!(
        (of_cube.length - 12.0 * side).abs() < 1e-9 && of_cube.on_borders == of_cube.length,
        "{of_cube:?}"
    );
    assert_eq!(features(&cube, 91.0).length, 0.0);
    // The ridge and the valley below it have an angle of 33°, the slopes are longer than the sides that they replace.
    let around = (8.0 + 4.0 * (1.0 + 0.3f64.powi(2)).sqrt()) * side;
    let sharp = features(&house, 40.0);
    assert!(
        (sharp.length - around).abs() < 1e-9 && sharp.on_borders == sharp.length,
        "{sharp:?}"
    );
    let all = features(&house, 30.0);
    assert!((all.length - around - 2.0 * side).abs() < 1e-9, "{all:?}");
    assert!((all.on_borders - around).abs() < 1e-9, "{all:?}");
    for degrees in [0.0, -1.0, 180.0, f64::NAN] {
        let options = PolycubeOptions {
            feature_angle: Some(degrees),
            ..PolycubeOptions::default()
        };
        let refused = make_polycube(&cube, &options, &|_| {}).map(|_| ());
        assert!(
            matches!(refused, Err(MakePolycubeError::FeatureAngle(_))),
            "{refused:?}"
        );
    }
}

#[test]
fn meshes_and_options_that_cannot_be_used_are_refused() {
    let make = |mesh: &TetMesh, smoothness: f64| {
        let options = PolycubeOptions {
            smoothness,
            ..PolycubeOptions::default()
        };
        make_polycube(mesh, &options, &|_| {}).map(|_| ())
    };
    let cube = test_meshes::cube(2);
    for size in [CellSize::Length(-1.0), CellSize::Length(f64::NAN), CellSize::Along(0)] {
        let options = PolycubeOptions {
            lattice: Some(size),
            ..PolycubeOptions::default()
        };
        let refused = make_polycube(&cube, &options, &|_| {}).map(|_| ());
        assert!(matches!(refused, Err(MakePolycubeError::Lattice(_))), "{refused:?}");
    }
    for smoothness in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(make(&cube, smoothness), Err(MakePolycubeError::Smoothness(_))));
    }
    assert_eq!(make(&TetMesh::default(), 0.02), Err(MakePolycubeError::Empty));
    let mut vertices = cube.vertices().to_vec();
    vertices[3].y = f64::NAN;
    let with = |vertices: Vec<Point>| TetMesh::new(vertices, cube.tets().to_vec()).unwrap();
    assert_eq!(make(&with(vertices), 0.02), Err(MakePolycubeError::NotFinite(3)));
    let flat = cube.vertices().iter().map(|p| Point::new(p.x, p.y, 0.0)).collect();
    assert_eq!(make(&with(flat), 0.02), Err(MakePolycubeError::Flat(0)));
    // Two tetrahedra that share an edge alone.
    let corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0]];
    let corners: Vec<Point> = corners.map(|p| Point::from(p.map(f64::from))).into();
    let pinched = TetMesh::new(corners, vec![[0, 1, 2, 3], [0, 4, 5, 3]]).unwrap();
    assert_eq!(make(&pinched, 0.02), Err(MakePolycubeError::NotManifold));
}

#[test]
fn the_callback_sees_all_phases_and_cancels() {
    let ball = test_meshes::ball(4);
    let phases = std::cell::RefCell::new(vec![]);
    let options = PolycubeOptions::default();
    make_polycube(&ball, &options, &|phase| phases.borrow_mut().push(phase)).unwrap();
    let phases = phases.into_inner();
    assert!(phases.contains(&PolycubePhase::Attempting { attempt: 1 }));
    assert!(phases.contains(&PolycubePhase::Deforming { inverted: 0 }));
    for number in 0..3 {
        let calls = std::cell::Cell::new(0);
        let cancelling = |_| {
            calls.set(calls.get() + 1);
            if calls.get() > number {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let ended = make_polycube(&ball, &options, &cancelling);
        assert_eq!(ended.map(|_| ()), Err(MakePolycubeError::Cancelled));
        assert_eq!(calls.get(), number + 1);
    }
}
