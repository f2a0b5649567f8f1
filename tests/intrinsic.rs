//! Correspondences by intrinsic shape: limbs in any pose, never by a reflection.

use nalgebra::Rotation3;
use solidmap::intrinsic::{Correspondence, IntrinsicShape, correspondences};
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::SphericalEmbedding;
use solidmap::{Point, Vector};

/// Directions and lengths of five limbs without symmetry.
const LIMBS: [([f64; 3], f64); 5] = [
    ([1.0, 0.1, 0.2], 2.4),
    ([-0.8, 0.6, 0.1], 1.9),
    ([-0.2, -1.0, 0.3], 1.4),
    ([0.1, 0.3, 1.0], 2.1),
    ([0.3, 0.5, -1.0], 1.6),
];

/// A ball with limbs, and the directions of its vertices: it is star-shaped.
fn star() -> (SurfaceMesh, Vec<Vector>) {
    let ball = shapes::sphere(1.0, 4);
    let directions = ball.vertices().iter().map(|p| p.coords).collect();
    let grown = |p: &Point| {
        let limb = |(direction, length): &([f64; 3], f64)| {
            length * (-18.0 * (1.0 - p.coords.dot(&Vector::from(*direction).normalize()))).exp()
        };
        p * (1.0 + LIMBS.iter().map(limb).sum::<f64>())
    };
    (shapes::deformed(&ball, grown), directions)
}

/// Limbs bent to one side, the farther out the more.
fn bent(surface: &SurfaceMesh) -> SurfaceMesh {
    shapes::deformed(surface, |p| {
        let angle = 0.25 * (p.coords.norm() - 1.0).max(0.0);
        Rotation3::new(Vector::new(0.3, -0.2, 1.0).normalize() * angle) * p
    })
}

fn found(domain: &SurfaceMesh, target: &SurfaceMesh, directions: &[Vector]) -> Vec<Correspondence> {
    let shape = |surface| IntrinsicShape::new(surface, 100, &|| true).unwrap();
    let embedding = SphericalEmbedding::new(target.clone(), directions).unwrap();
    correspondences(&shape(domain), &shape(target), &embedding, &[], 4, &|| true)
}

/// Mean distance of the images from the vertices of the same number, as a fraction of the diagonal.
fn error(correspondence: &Correspondence, target: &SurfaceMesh) -> f64 {
    let pairs = correspondence.targets.iter().enumerate();
    let distances: Vec<f64> = pairs
        .filter_map(|(v, found)| found.map(|(w, _)| (target.vertices()[v] - target.vertices()[w as usize]).norm()))
        .collect();
    assert!(distances.len() > correspondence.targets.len() / 2);
    distances.iter().sum::<f64>() / (distances.len() as f64 * target.diagonal())
}

#[test]
fn limbs_go_to_the_same_limbs_when_they_are_bent_and_a_body_to_itself() {
    let (star, directions) = star();
    for target in [star.clone(), bent(&star)] {
        let found = found(&star, &target, &directions);
        let best = &found[0];
        assert!((best.coverage - 1.0).abs() < 0.1, "{}", best.coverage);
        assert_eq!(best.extremities.len(), LIMBS.len());
        for &[v, w] in &best.extremities {
            let apart = (target.vertices()[v as usize] - target.vertices()[w as usize]).norm();
            assert!(apart < 0.1 * target.diagonal(), "{v} {w}: {apart}");
        }
        let error = error(best, &target);
        assert!(error < 0.03, "{error}");
    }
}

#[test]
fn a_mirror_image_is_never_matched_by_the_reflection() {
    let (star, directions) = star();
    let mirror = |p: &Point| Point::new(-p.x, p.y, p.z);
    let mirrored = shapes::deformed(&star, mirror).reversed();
    let directions: Vec<Vector> = directions.iter().map(|x| Vector::new(-x.x, x.y, x.z)).collect();
    for correspondence in found(&star, &mirrored, &directions) {
        assert!(
            (correspondence.coverage - 1.0).abs() < 0.5,
            "{}",
            correspondence.coverage
        );
        // The reflection, an isometry, would have an error of 0.
        assert!(error(&correspondence, &mirrored) > 0.05);
    }
}

#[test]
fn a_rigid_motion_and_another_scale_change_nothing() {
    let (star, directions) = star();
    let turn = Rotation3::from_euler_angles(0.4, 1.2, -2.0);
    let moved = shapes::deformed(&bent(&star), |p| turn * p * 7.0 + Vector::new(3.0, 1.0, -20.0));
    let (as_is, moved) = (
        found(&star, &bent(&star), &directions),
        found(&star, &moved, &directions),
    );
    assert_eq!(as_is[0].extremities, moved[0].extremities);
    assert!(
        (as_is[0].defect - moved[0].defect).abs() < 1e-3,
        "{} {}",
        as_is[0].defect,
        moved[0].defect
    );
}

#[test]
fn bodies_without_limbs_have_no_correspondence() {
    let ball = shapes::sphere(1.0, 4);
    let directions: Vec<Vector> = ball.vertices().iter().map(|p| p.coords).collect();
    assert_eq!(found(&ball, &ball, &directions), []);
}
