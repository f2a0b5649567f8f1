//! Boundary maps that need no file: for the demonstration, examples and benchmarks.

use std::f64::consts::PI;
use std::ops::Range;

use super::BoundaryMap;
use crate::mesh::{SurfaceMesh, shapes};
use crate::{Point, Vector};

/// A solid ring carried onto a solid trefoil knot, `around × across` vertices. Both have genus 1, and no
/// deformation of space takes one to the other, since only the image is knotted.
///
/// # Panics
///
/// If `around` or `across` is less than 3.
pub fn ring_to_knot(around: usize, across: usize) -> BoundaryMap {
    let (major, minor, tube) = (1.0, 0.3, 0.5);
    let domain = shapes::torus(major, minor, around, across);
    let image = domain.vertices().iter().map(|p| {
        let angle = p.y.atan2(p.x);
        let (out, up) = ((p.x.hypot(p.y) - major) / minor, p.z / minor);
        let (centre, normal, binormal) = trefoil(angle);
        // Out, up and along are a left-handed frame on the ring; normal, binormal and tangent a right-handed one.
        centre + tube * (out * normal - up * binormal)
    });
    let image = image.collect();
    BoundaryMap::new(domain, image).expect("a knot is finite and extended")
}

/// A four-legged polycube carried onto a rounded, turning animal; each side of a cube is divided into `divisions`
/// squares.
///
/// # Panics
///
/// If `divisions` is 0.
pub fn polycube_to_animal(divisions: usize) -> BoundaryMap {
    let mut cubes = Vec::new();
    let mut add_box = |x: Range<i32>, y: Range<i32>, z: Range<i32>| {
        for i in x {
            for j in y.clone() {
                cubes.extend(z.clone().map(|k| [i, j, k]));
            }
        }
    };
    add_box(0..6, 0..3, 2..4);
    for (x, y) in [(0, 0), (0, 2), (5, 0), (5, 2)] {
        add_box(x..x + 1, y..y + 1, 0..2);
    }
    add_box(5..6, 1..2, 4..6);
    add_box(6..8, 1..2, 5..6);
    add_box(-2..0, 1..2, 3..4);
    let domain = shapes::polycube(&cubes, divisions);
    // The number of steps that rounds by a given length grows with the square of the resolution.
    let image = rounded(&domain, 5 * divisions * divisions).into_iter().map(pose);
    let image = image.collect();
    BoundaryMap::new(domain, image).expect("a rounded polycube is finite and extended")
}

/// Position, principal normal and binormal of a trefoil knot.
fn trefoil(t: f64) -> (Point, Vector, Vector) {
    let position = Point::new(
        t.sin() + 2.0 * (2.0 * t).sin(),
        t.cos() - 2.0 * (2.0 * t).cos(),
        -(3.0 * t).sin(),
    );
    let velocity = Vector::new(
        t.cos() + 4.0 * (2.0 * t).cos(),
        -t.sin() + 4.0 * (2.0 * t).sin(),
        -3.0 * (3.0 * t).cos(),
    );
    let acceleration = Vector::new(
        -t.sin() - 8.0 * (2.0 * t).sin(),
        -t.cos() + 8.0 * (2.0 * t).cos(),
        9.0 * (3.0 * t).sin(),
    );
    let binormal = velocity.cross(&acceleration).normalize();
    (position, binormal.cross(&velocity.normalize()), binormal)
}

/// Vertex positions after `steps` of smoothing that does not shrink (Taubin, *A signal processing approach to fair
/// surface design*, SIGGRAPH 1995; λ = 0.5, pass band 0.02).
fn rounded(mesh: &SurfaceMesh, steps: usize) -> Vec<Point> {
    let (smooth, pass_band) = (0.5, 0.02);
    let inflate = 1.0 / (pass_band - 1.0 / smooth);
    let mut neighbours = vec![Vec::new(); mesh.vertices().len()];
    for &[a, b, c] in mesh.triangles() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            // On a closed surface every edge is met once in each direction.
            neighbours[from as usize].push(to as usize);
        }
    }
    let mut positions = mesh.vertices().to_vec();
    for step in 0..2 * steps {
        let factor = if step % 2 == 0 { smooth } else { inflate };
        positions = (0..positions.len())
            .map(|v| {
                let sum: Vector = neighbours[v].iter().map(|&n| positions[n].coords).sum();
                let mean = Point::from(sum / neighbours[v].len() as f64);
                positions[v] + factor * (mean - positions[v])
            })
            .collect();
    }
    positions
}

/// Turns the spine to one side along its length and lets the back sag.
fn pose(p: Point) -> Point {
    let (length, middle) = (8.0, Vector::new(3.0, 1.5, 3.0));
    let q = p.coords - middle;
    let turn = 0.9 * PI * (q.x / length).powi(2) * q.x.signum() * 0.5;
    let (sine, cosine) = turn.sin_cos();
    let sag = -0.35 * (1.0 - (q.x / 3.5).powi(2)).max(0.0);
    Point::new(q.x * cosine - q.y * sine, q.x * sine + q.y * cosine, q.z + sag)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tube theorem: a tube of radius r about a curve of length L has volume πr²L. The knot's length by the
    /// trapezoidal rule, which converges beyond all orders for a periodic curve.
    #[test]
    fn the_knot_is_a_tube_of_constant_radius() {
        let n = 2000;
        let point = |k: usize| trefoil(2.0 * PI * k as f64 / n as f64).0;
        let length: f64 = (0..n).map(|k| (point(k + 1) - point(k)).norm()).sum();
        let volume = ring_to_knot(400, 100).target().volume();
        assert!(
            (volume / (PI * 0.25 * length) - 1.0).abs() < 3e-3,
            "{volume} against {}",
            PI * 0.25 * length
        );
    }

    #[test]
    fn the_animal_is_rounded_but_not_shrunk() {
        let map = polycube_to_animal(3);
        let (before, after) = (map.domain().volume(), map.target().volume());
        assert!((before - 50.0).abs() < 1e-9, "{before}");
        assert!(after > 0.8 * before && after < 1.05 * before, "{after}");
        let area_before = map.domain().area();
        assert!(map.target().area() < 0.9 * area_before);
    }
}
