//! The map follows motions and scalings of its domain and target.

use crate::common::{boundary_map, fitted, interior_points, largest_distance, solids};
use nalgebra::{Rotation3, Similarity3, UnitQuaternion};
use solidmap::fit::{Fit, FitOptions};
use solidmap::map::VolumeMap;
use solidmap::mesh::shapes;
use solidmap::{Point, Vector};

/// Rounding in the solution grows with the condition number; a factor of ten for the sizes of the terms.
fn tolerance(fit: &Fit) -> f64 {
    10.0 * f64::EPSILON * fit.report.condition.unwrap()
}

fn bent(p: &Point) -> Point {
    Point::new(
        p.x + 0.3 * p.y * p.y,
        p.y - 0.2 * (2.0 * p.z).sin(),
        p.z * (1.0 + 0.2 * p.x),
    )
}

fn motion(scale: f64) -> Similarity3<f64> {
    let rotation = UnitQuaternion::from_euler_angles(0.7, -1.1, 2.3);
    Similarity3::from_parts(Vector::new(3.0, -20.0, 7.0).into(), rotation, scale)
}

#[test]
fn moving_the_target_moves_the_map() {
    for (name, domain) in solids(0) {
        let inside = interior_points(&domain, 100, 1);
        let plain = fitted(&boundary_map(&domain, bent), &FitOptions::dense());
        let (tolerance, plain) = (tolerance(&plain), plain.map.evaluate(&inside));
        for scale in [1.0, 1e-3, 1e4] {
            let motion = motion(scale);
            let moved = fitted(&boundary_map(&domain, |p| motion * bent(p)), &FitOptions::dense());
            let expected: Vec<Point> = plain.iter().map(|p| motion * p).collect();
            let error = largest_distance(&moved.map.evaluate(&inside), &expected) / scale;
            // The shift of 20 costs digits when the target is a thousandth of its size.
            let rounding = tolerance.max(1e-13 * 20.0 / scale);
            assert!(error < rounding, "{name}, scale {scale}: {error:e}");
        }
    }
}

#[test]
fn moving_the_domain_moves_the_map() {
    for (name, domain) in solids(0) {
        let inside = interior_points(&domain, 100, 1);
        let plain = fitted(&boundary_map(&domain, bent), &FitOptions::dense());
        let expected = plain.map.evaluate(&inside);
        for scale in [1.0, 1e-3, 1e4] {
            let motion = motion(scale);
            let moved_domain = shapes::deformed(&domain, |p| motion * p);
            let back = motion.inverse();
            let moved = fitted(
                &boundary_map(&moved_domain, |p| bent(&(back * p))),
                &FitOptions::dense(),
            );
            let images = moved
                .map
                .evaluate(&inside.iter().map(|p| motion * p).collect::<Vec<_>>());
            let error = largest_distance(&images, &expected);
            // The shift costs the domain's coordinates digits, and the condition number multiplies what is lost.
            let lost = f64::EPSILON * (1.0 + 20.0 / scale);
            let rounding = 10.0 * lost * plain.report.condition.unwrap();
            assert!(error < rounding, "{name}, scale {scale}: {error:e}");
            let (a, b) = (plain.report.boundary_error.rms, moved.report.boundary_error.rms);
            assert!((a / b - 1.0).abs() < 1e-6, "{name}: boundary error {a:e} became {b:e}");
        }
    }
}

/// The Jacobian in a rotated frame: `J' = J Rᵀ`.
#[test]
fn jacobians_rotate_with_the_domain() {
    let domain = shapes::torus(1.0, 0.4, 20, 9);
    let inside = interior_points(&domain, 50, 3);
    let rotation = Rotation3::from_euler_angles(0.3, 0.5, -0.8);
    let plain = fitted(&boundary_map(&domain, bent), &FitOptions::dense())
        .map
        .jacobian(&inside);
    let rotated = shapes::deformed(&domain, |p| rotation * p);
    let fit = fitted(
        &boundary_map(&rotated, |p| bent(&(rotation.inverse() * p))),
        &FitOptions::dense(),
    );
    let jacobians = fit
        .map
        .jacobian(&inside.iter().map(|p| rotation * p).collect::<Vec<_>>());
    for (j, rotated) in plain.iter().zip(jacobians) {
        assert!((j * rotation.matrix().transpose() - rotated).amax() < 1e-8);
    }
}

/// Faces that look inward are flipped: the sources are on the same side, and the map is the same.
#[test]
fn an_inward_domain_gives_the_same_map() {
    let domain = shapes::sphere(1.0, 2);
    let inside = interior_points(&domain, 50, 3);
    let outward = fitted(&boundary_map(&domain, bent), &FitOptions::dense());
    let inward = fitted(&boundary_map(&domain.reversed(), bent), &FitOptions::dense());
    assert!(largest_distance(&outward.map.evaluate(&inside), &inward.map.evaluate(&inside)) < 1e-9);
    assert!(!inward.report.warnings.is_empty() && outward.report.warnings.is_empty());
}
