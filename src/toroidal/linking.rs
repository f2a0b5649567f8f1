//! Linking numbers of loops on a surface, and from them the class of loops that bounds in the solid.
//!
//! By Alexander duality a loop on the surface bounds in the solid if and only if it links no loop outside. Loops outside
//! are dual loops pushed off the surface. The Gauss integral of two polygons is a sum of areas of spherical quadrilaterals
//! (Klenin & Langowski, *Computation of writhe in modeling of supercoiled DNA*, Biopolymers 54, 2000), so that the sum is an
//! integer up to rounding.

use rayon::prelude::*;

use super::handles::HandleLoop;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;
use crate::{Point, Vector};

/// Dual loops are pushed off the surface by this fraction of the lengths of edges around.
const PUSH: f64 = 1e-3;
/// How far a computed linking number may be from an integer.
const ROUNDING: f64 = 1e-3;

/// Side of the surface that a loop is pushed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Push {
    Outward,
    Inward,
}

/// The coefficients of the class that bounds in a solid of genus 1 by the two loops of its surface: coprime, the first that
/// is not 0 positive. `None` where the linking numbers contradict each other, so that the surface passes through itself or
/// comes closer to itself than a thousandth of its edges.
pub(crate) fn meridian_class(surface: &SurfaceMesh, loops: &[HandleLoop]) -> Option<[i32; 2]> {
    let outer = outer_linking(surface, loops)?;
    // Row vectors c with c L = 0: L has rank 1.
    let [[a, b], [c, d]] = [0, 1].map(|j| [0, 1].map(|k| outer[j][k]));
    if a * d != b * c {
        return None;
    }
    let (p, q) = if (a, c) != (0, 0) { (c, -a) } else { (d, -b) };
    let divisor = gcd(p.abs(), q.abs());
    if divisor == 0 {
        return None;
    }
    let sign = if (p, q) < (0, 0) { -1 } else { 1 };
    Some([sign * p / divisor, sign * q / divisor])
}

/// Entry `j, k`: the linking number of loop `j` with dual loop `k`, pushed outward. A combination of loops bounds in the solid if and
/// only if it links none. `None` where the numbers contradict each other, as in [`meridian_class`].
pub(crate) fn outer_linking(surface: &SurfaceMesh, loops: &[HandleLoop]) -> Option<Vec<Vec<i32>>> {
    let outer = linking_matrix(surface, loops, Push::Outward)?;
    let inner = linking_matrix(surface, loops, Push::Inward)?;
    // Pushing a dual loop through the surface changes its linking number with a loop by the crossings of the two.
    let is_unit = |sign: i32| {
        let entry = |j: usize, k: usize| outer[j][k] - inner[j][k] == sign * i32::from(j == k);
        (0..loops.len()).all(|j| (0..loops.len()).all(|k| entry(j, k)))
    };
    (is_unit(1) || is_unit(-1)).then_some(outer)
}

fn gcd(a: i32, b: i32) -> i32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Entry `j, k`: the linking number of loop `j` with dual loop `k`, pushed off the surface.
fn linking_matrix(surface: &SurfaceMesh, loops: &[HandleLoop], push: Push) -> Option<Vec<Vec<i32>>> {
    let topology = Topology::new(surface);
    let pushed: Vec<Vec<Point>> = loops.iter().map(|l| pushed_dual(surface, &topology, l, push)).collect();
    let own = loops.iter().map(|l| -> Vec<Point> {
        let vertices = l.loop_vertices.iter();
        vertices.map(|&v| surface.vertices()[v as usize]).collect()
    });
    let own: Vec<Vec<Point>> = own.collect();
    let mut matrix = vec![vec![0; loops.len()]; loops.len()];
    for (row, own) in matrix.iter_mut().zip(&own) {
        for (entry, pushed) in row.iter_mut().zip(&pushed) {
            let number = linking_number(own, pushed);
            if (number - number.round()).abs() > ROUNDING || !number.is_finite() {
                return None;
            }
            *entry = number.round() as i32;
        }
    }
    Some(matrix)
}

/// Centres of the triangles of a dual loop and middles of the sides between them, off the surface.
fn pushed_dual(surface: &SurfaceMesh, topology: &Topology, found: &HandleLoop, push: Push) -> Vec<Point> {
    let sign = match push {
        Push::Outward => PUSH,
        Push::Inward => -PUSH,
    };
    let normal = |t: u32| surface.area_vector(t as usize).try_normalize(0.0).unwrap_or_default();
    let mut points = Vec::with_capacity(2 * found.dual.len());
    for &(t, side) in &found.dual {
        let corners = surface.corners(t as usize);
        let (a, b) = (corners[side], corners[(side + 1) % 3]);
        let shortest = (0..3).map(|k| (corners[(k + 1) % 3] - corners[k]).norm());
        let shortest = shortest.fold(f64::INFINITY, f64::min);
        let edge = topology.edges_of_triangle(t as usize).expect("three vertices")[side];
        let sides = topology.sides(edge as usize);
        let between: Vector = sides.iter().map(|side| normal(side.triangle)).sum();
        let between = between.try_normalize(0.0).unwrap_or_default();
        let centre = Point::from(corners.iter().map(|p| p.coords).sum::<Vector>() / 3.0);
        points.push(centre + sign * shortest * normal(t));
        points.push(nalgebra::center(&a, &b) + sign * shortest * between);
    }
    points
}

/// How often one closed polygon winds about another, up to rounding.
pub(super) fn linking_number(first: &[Point], second: &[Point]) -> f64 {
    let next = |polygon: &[Point], i: usize| polygon[(i + 1) % polygon.len()];
    let of_side = |i: usize| {
        let (a, b) = (first[i], next(first, i));
        let with = |j: usize| {
            let (c, d) = (second[j], next(second, j));
            let corners = [c - a, c - b, d - b, d - a];
            solid_angle([&corners[0], &corners[1], &corners[2]]) + solid_angle([&corners[0], &corners[2], &corners[3]])
        };
        (0..second.len()).map(with).sum::<f64>()
    };
    // In order, so that the sum is the same for any number of threads.
    let parts: Vec<f64> = (0..first.len()).into_par_iter().map(of_side).collect();
    parts.iter().sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Signed area of the spherical triangle of three directions (van Oosterom & Strackee, 1983).
fn solid_angle([u, v, w]: [&Vector; 3]) -> f64 {
    let [a, b, c] = [u.norm(), v.norm(), w.norm()];
    let denominator = a * b * c + u.dot(v) * c + v.dot(w) * a + w.dot(u) * b;
    2.0 * u.dot(&v.cross(w)).atan2(denominator)
}

#[cfg(test)]
mod tests {
    use super::super::handles::{handle_loops, value_on};
    use super::*;
    use crate::mesh::shapes;

    fn circle(count: usize, at: impl Fn(f64) -> Point) -> Vec<Point> {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / count as f64;
        (0..count).map(|i| at(angle(i))).collect()
    }

    #[test]
    fn linked_circles_link_as_often_as_one_winds_about_the_other() {
        let first = circle(40, |t| Point::new(t.cos(), t.sin(), 0.0));
        for turns in [0, 1, 2, 5] {
            let second = circle(200, |t| {
                let (r, angle) = (0.3, t * f64::from(turns));
                Point::new(
                    (1.0 + r * angle.cos()) * t.cos(),
                    (1.0 + r * angle.cos()) * t.sin(),
                    r * angle.sin(),
                )
            });
            let number = linking_number(&first, &second);
            assert!((number.abs() - f64::from(turns)).abs() < 1e-10, "{number}");
        }
    }

    #[test]
    fn the_meridian_of_a_ring_is_the_loop_around_its_tube_and_of_its_complement_the_other() {
        let surface = shapes::torus(1.0, 0.4, 31, 11);
        for (surface, winds) in [(surface.clone(), 0), (surface.reversed(), 1)] {
            let loops = handle_loops(&surface);
            let [p, q] = meridian_class(&surface, &loops).unwrap();
            // The turns about the axis of a loop with these coefficients.
            let turns = |walk: &[u32]| -> f64 {
                let angle = |v: u32| surface.vertices()[v as usize].y.atan2(surface.vertices()[v as usize].x);
                let next = walk.iter().cycle().skip(1);
                let steps = walk.iter().zip(next).map(|(&a, &b)| (angle(b) - angle(a)).sin().asin());
                steps.sum::<f64>() / std::f64::consts::TAU
            };
            let [a, b] = [&loops[0], &loops[1]].map(|l| turns(&l.loop_vertices).round() as i32);
            assert_eq!((p * a + q * b).abs(), winds);
            let topology = Topology::new(&surface);
            assert_eq!(
                value_on(&surface, &topology, &loops[0].cochain, &loops[0].loop_vertices),
                1
            );
        }
    }
}
