//! Polycubes of a ball and a torus, and the maps from their boundaries to the model's.

use std::ops::ControlFlow;

use super::*;
use crate::baseline::test_meshes;
use crate::geometry::SurfaceQuery;
use crate::mesh::SurfacePoint;
use crate::spherical::genus;

/// Requires triangles across the axes, a positive volume, as many handles, and a map of every point onto the model's surface, one to
/// one.
fn require_polycube(model: &TetMesh, made: &ModelPolycube) {
    let domain = made.boundary.domain();
    let labels = made.labels();
    for (t, label) in domain.triangles().iter().zip(&labels) {
        let axis = usize::from(label / 2);
        let [a, b, c] = t.map(|v| domain.vertices()[v as usize]);
        assert!(a[axis] == b[axis] && b[axis] == c[axis]);
        let is_positive = (b - a).cross(&(c - a))[axis] > 0.0;
        assert_eq!(is_positive, label % 2 == 1);
    }
    assert!(domain.volume() > 0.0);
    let surface = model.boundary().surface;
    assert_eq!(genus(domain), genus(&surface));
    let point = |triangle: usize| SurfacePoint {
        triangle: triangle as u32,
        barycentric: [0.2, 0.3, 0.5],
    };
    let points: Vec<SurfacePoint> = (0..domain.triangles().len()).map(point).collect();
    let images = made.boundary.evaluate(&points);
    let query = SurfaceQuery::new(&surface).unwrap();
    let farthest = images
        .iter()
        .map(|p| query.closest_point(p).distance)
        .fold(0.0, f64::max);
    assert!(farthest < 1e-9 * surface.diagonal(), "{farthest}");
    if let Some(back) = made.boundary.inverse() {
        let there = made.boundary.evaluate_on_target(&points).unwrap();
        let again = back.evaluate(&there);
        let positions = made.boundary.positions(&points);
        let farthest = again
            .iter()
            .zip(&positions)
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(farthest < 1e-9 * domain.diagonal(), "{farthest}");
    }
}

fn by_voxels() -> ModelPolycubeOptions {
    ModelPolycubeOptions {
        kind: PolycubeKind::Voxels,
        ..ModelPolycubeOptions::default()
    }
}

#[test]
fn a_ball_and_a_ring_are_deformed_or_get_voxels() {
    for model in [test_meshes::ball(4), test_meshes::torus(4)] {
        let made = make_model_polycube(&model, &ModelPolycubeOptions::default(), &|_| {}).unwrap();
        let Polycube::Deformed(polycube, None) = &made.polycube else {
            panic!("not deformed")
        };
        assert_eq!(made.labels(), polycube.labels);
        let (triangles, labels): (Vec<_>, Vec<_>) = polycube.given_labels.iter().copied().unzip();
        assert_eq!(made.labels_of(&model, &triangles), Some(labels));
        require_polycube(&model, &made);
        let made = make_model_polycube(&model, &by_voxels(), &|_| {}).unwrap();
        assert!(matches!(&made.polycube, Polycube::Voxels(_, report) if report.missed == 0));
        require_polycube(&model, &made);
    }
}

#[cfg(feature = "native")]
#[test]
fn a_large_model_is_simplified_and_the_map_goes_to_the_model_itself() {
    let model = test_meshes::ball(6);
    let options = ModelPolycubeOptions {
        most_vertices: model.boundary().surface.vertices().len() / 2,
        ..ModelPolycubeOptions::default()
    };
    let made = make_model_polycube(&model, &options, &|_| {}).unwrap();
    let Polycube::Deformed(polycube, Some(report)) = &made.polycube else {
        panic!("not simplified")
    };
    assert_eq!(polycube.surfaces()[0].vertices().len(), report.vertices);
    require_polycube(&model, &made);
}

/// Opposite faces of the polycube of a ball are on opposite sides of the ball.
#[test]
fn labels_of_the_model_are_those_of_the_faces_its_triangles_go_to() {
    let ball = test_meshes::ball(4);
    let made = make_model_polycube(&ball, &by_voxels(), &|_| {}).unwrap();
    let boundary = ball.boundary();
    let surface = &boundary.surface;
    let node = |v: u32| boundary.vertex_ids[v as usize];
    let triangles: Vec<[u32; 3]> = surface.triangles().iter().map(|t| t.map(node)).collect();
    let labels = made.labels_of(&ball, &triangles).unwrap();
    let normals = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|v| ball.vertices()[v as usize]);
        (b - a).cross(&(c - a)).normalize()
    });
    let labelled: Vec<(u8, crate::Vector)> = labels.into_iter().zip(normals).collect();
    assert_eq!(made.labels_of(&ball, &[[0, 0, 0]]), None);
    for label in 0..6u8 {
        let axis = usize::from(label / 2);
        let sign = if label % 2 == 1 { 1.0 } else { -1.0 };
        let along: Vec<f64> = labelled
            .iter()
            .filter(|(l, _)| *l == label)
            .map(|(_, n)| sign * n[axis])
            .collect();
        // More than half of them face along it.
        let towards = along.iter().filter(|x| **x > 0.5).count();
        assert!(2 * towards > along.len(), "{label}: {towards} of {}", along.len());
    }
}

#[test]
fn voxels_follow_where_nothing_is_deformed_and_every_phase_cancels() {
    let ball = test_meshes::ball(4);
    let none = ModelPolycubeOptions {
        deformation: PolycubeOptions {
            attempts: 0,
            lattice: Some(CellSize::Length(0.25)),
            ..PolycubeOptions::default()
        },
        ..ModelPolycubeOptions::default()
    };
    let made = make_model_polycube(&ball, &none, &|_| {}).unwrap();
    let Polycube::Voxels(polycube, report) = &made.polycube else {
        panic!("no voxels")
    };
    // On the lattice that was asked for.
    assert_eq!(polycube.size, 0.25 * report.cells as f64);
    let only = ModelPolycubeOptions {
        kind: PolycubeKind::Deformed,
        ..none.clone()
    };
    let error = make_model_polycube(&ball, &only, &|_| {}).unwrap_err();
    assert!(error.is_without_polycube() && !error.is_cancelled(), "{error}");
    // With a fine lattice, the edge of a voxel is many cells long.
    let fine = ModelPolycubeOptions {
        deformation: PolycubeOptions {
            lattice: Some(CellSize::Length(1e-7)),
            ..none.deformation
        },
        ..none.clone()
    };
    let made = make_model_polycube(&ball, &fine, &|_| {}).unwrap();
    assert!(matches!(&made.polycube, Polycube::Voxels(_, report) if report.cells > 100_000));
    // Voxels of this size show no hole: both reasons are given.
    let large = ModelPolycubeOptions {
        deformation: PolycubeOptions {
            lattice: Some(CellSize::Length(1e6)),
            ..none.deformation
        },
        ..none.clone()
    };
    let error = make_model_polycube(&test_meshes::torus(3), &large, &|_| {}).unwrap_err();
    assert!(matches!(error, ModelPolycubeError::Neither { .. }), "{error}");
    let deforming = |phase: ModelPolycubePhase| match phase {
        ModelPolycubePhase::Deforming(_) => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let options = ModelPolycubeOptions::default();
    assert!(
        make_model_polycube(&ball, &options, &deforming)
            .unwrap_err()
            .is_cancelled()
    );
    let pairing = |phase: ModelPolycubePhase| match phase {
        ModelPolycubePhase::Pairing(_) => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    assert!(make_model_polycube(&ball, &none, &pairing).unwrap_err().is_cancelled());
    let flat: Vec<crate::Point> = ball
        .vertices()
        .iter()
        .map(|p| crate::Point::new(p.x, p.y, 0.0))
        .collect();
    let flat = TetMesh::new(flat, ball.tets().to_vec()).unwrap();
    let error = make_model_polycube(&flat, &by_voxels(), &|_| {}).unwrap_err();
    assert!(matches!(error, ModelPolycubeError::NoVolume), "{error}");
}
