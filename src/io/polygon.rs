//! Cuts polygons into triangles: by the order of their corners where that gives no triangle that lies the wrong way
//! round, else by their shape.

use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use crate::{Point, Vector};

/// Triangles of a polygon, as numbers of its corners.
pub(super) type Triangles = Vec<[u32; 3]>;

/// A triangle whose area along the polygon's normal is below this fraction of the polygon's is flat or lies the wrong way
/// round.
const FLAT: f64 = 1e-9;
/// Coordinates of a polygon of size 1 below this are rounding errors, and too small for exact predicates.
const ROUNDING: f64 = 1e-25;

/// Cuts off every second corner, and so on with the polygon that is left, so that few triangles meet at a corner. In a fan
/// about one corner all of them do: for TetGen, a face of 1000 corners then takes 14 times as long. There must be three
/// corners.
pub(super) fn cut_by_order(corners: usize) -> Triangles {
    let mut triangles = Vec::with_capacity(corners - 2);
    let mut left: Vec<u32> = (0..corners as u32).collect();
    while left.len() > 3 {
        let mut kept = Vec::with_capacity(left.len() / 2 + 1);
        for two in left.chunks(2) {
            kept.push(two[0]);
            if let &[a, b] = two {
                let next = left.get(2 * kept.len());
                triangles.push(next.map_or([left[0], a, b], |&next| [a, b, next]));
            }
        }
        left = kept;
    }
    if let &[a, b, c] = left.as_slice() {
        triangles.push([a, b, c]);
    }
    triangles
}

/// The cut of a polygon that [`cut_by_order`] does not suit: a Delaunay triangulation of its inside, projected along its
/// normal (the mean of Newell's formula). `None` where the cut by order does, and where the projected polygon crosses or
/// touches itself, so that it has no inside.
pub(super) fn cut_by_shape(corners: &[Point]) -> Option<Triangles> {
    let count = corners.len();
    let origin = *corners.first()?;
    let relative: Vec<Vector> = corners.iter().map(|p| p - origin).collect();
    let size = relative.iter().map(|p| p.amax()).fold(0.0, f64::max);
    if count < 4 || !(size > 0.0 && size.is_finite()) {
        return None;
    }
    let relative: Vec<Vector> = relative.iter().map(|p| p / size).collect();
    let normal: Vector = (0..count).map(|k| relative[k].cross(&relative[(k + 1) % count])).sum();
    let twice_area = normal.norm();
    let normal = normal.try_normalize(FLAT)?;
    let along_normal = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|k| relative[k as usize]);
        (b - a).cross(&(c - a)).dot(&normal)
    };
    if cut_by_order(count)
        .into_iter()
        .all(|t| along_normal(t) > FLAT * twice_area)
    {
        return None;
    }
    let (u, v) = across(&normal);
    let snapped = |x: f64| if x.abs() < ROUNDING { 0.0 } else { x };
    let mut plane = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut vertices = Vec::with_capacity(count);
    for (corner, p) in relative.iter().enumerate() {
        let vertex = plane.insert(Point2::new(snapped(p.dot(&u)), snapped(p.dot(&v)))).ok()?;
        // A corner where another one is replaces it.
        if vertex.index() != corner {
            return None;
        }
        vertices.push(vertex);
    }
    for k in 0..count {
        let added = plane.try_add_constraint(vertices[k], vertices[(k + 1) % count]);
        if added.len() != 1 {
            return None;
        }
    }
    let inside = inner_triangles(&plane);
    (inside.len() == count - 2 && inside.iter().all(|&t| along_normal(t) > 0.0)).then_some(inside)
}

/// Two unit vectors that make a right-handed frame with a third one, which is last.
fn across(normal: &Vector) -> (Vector, Vector) {
    let axis = Vector::ith(normal.iamin(), 1.0);
    let u = axis.cross(normal).normalize();
    (u, normal.cross(&u))
}

/// The triangles on the inner side of a closed line of constraints, sorted.
fn inner_triangles(plane: &ConstrainedDelaunayTriangulation<Point2<f64>>) -> Triangles {
    // From the outside inward: a face is inside if an odd number of constraints is on the way.
    let mut is_inside: Vec<Option<bool>> = vec![None; plane.num_all_faces()];
    is_inside[plane.outer_face().index()] = Some(false);
    let mut next: Vec<_> = plane.convex_hull().map(|edge| edge.rev().fix()).collect();
    next.extend(plane.convex_hull().map(|edge| edge.fix()));
    while let Some(edge) = next.pop() {
        let edge = plane.directed_edge(edge);
        let (from, to) = (edge.face().index(), edge.rev().face().index());
        let (Some(inside), None) = (is_inside[from], is_inside[to]) else {
            continue;
        };
        is_inside[to] = Some(inside != edge.is_constraint_edge());
        if let Some(face) = edge.rev().face().as_inner() {
            next.extend(face.adjacent_edges().map(|edge| edge.fix()));
        }
    }
    let mut triangles: Triangles = plane
        .inner_faces()
        .filter(|face| is_inside[face.index()] == Some(true))
        .map(|face| face.vertices().map(|vertex| vertex.index() as u32))
        .collect();
    triangles.iter_mut().for_each(|t| {
        let least = (0..3).min_by_key(|&k| t[k]).unwrap_or(0);
        t.rotate_left(least);
    });
    triangles.sort_unstable();
    triangles
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// That every edge of the polygon is there once, and every other one twice, in opposite directions.
    fn assert_fits(triangles: &Triangles, corners: u32) {
        assert_eq!(triangles.len() as u32, corners - 2);
        let edges = || triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let is_border = |[a, b]: &[u32; 2]| (a + 1) % corners == *b;
        let borders: BTreeSet<[u32; 2]> = edges().filter(is_border).collect();
        let inner: BTreeSet<[u32; 2]> = edges().filter(|edge| !is_border(edge)).collect();
        assert_eq!(
            borders.len() + inner.len(),
            3 * triangles.len(),
            "an edge twice in one direction"
        );
        assert_eq!(borders.len() as u32, corners);
        assert!(inner.iter().all(|&[a, b]| inner.contains(&[b, a])));
    }

    #[test]
    fn a_polygon_of_any_size_is_cut_so_that_few_triangles_meet() {
        for corners in 3..200_u32 {
            let triangles = cut_by_order(corners as usize);
            assert_fits(&triangles, corners);
            let most = (0..corners).map(|v| triangles.iter().flatten().filter(|&&corner| corner == v).count());
            let levels = 1 + corners.ilog2() as usize;
            assert!(most.max().unwrap() <= 2 * levels, "{corners} corners");
        }
        assert_eq!(cut_by_order(4), [[0, 1, 2], [0, 2, 3]]);
    }

    fn area(corners: &[Point], triangles: &Triangles) -> f64 {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| corners[k as usize]);
            (b - a).cross(&(c - a)).norm() / 2.0
        };
        triangles.iter().map(of).sum()
    }

    /// A polygon in the plane, tilted, with the same area.
    fn tilted(corners: &[[f64; 2]]) -> Vec<Point> {
        let turn = nalgebra::Rotation3::new(Vector::new(0.3, -1.1, 2.0));
        corners
            .iter()
            .map(|&[x, y]| turn * Point::new(x, y, 0.0) + Vector::new(5.0, 1.0, -2.0))
            .collect()
    }

    #[test]
    fn concave_polygons_are_cut_into_triangles_that_do_not_overlap() {
        let letter = [[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 4.], [0., 4.]];
        let dart = [[0., 0.], [2., 3.], [0., 1.], [-2., 3.]];
        let other_dart = [dart[1], dart[2], dart[3], dart[0]];
        let gear: Vec<[f64; 2]> = (0..400)
            .map(|k| {
                let (angle, r) = (
                    f64::from(k) * std::f64::consts::TAU / 400.0,
                    if k % 4 < 2 { 1.0 } else { 0.8 },
                );
                [r * angle.cos(), r * angle.sin()]
            })
            .collect();
        let shoelace = |p: &[[f64; 2]]| {
            let n = p.len();
            (0..n)
                .map(|k| p[k][0] * p[(k + 1) % n][1] - p[k][1] * p[(k + 1) % n][0])
                .sum::<f64>()
                / 2.0
        };
        for flat in [&letter[..], &dart, &other_dart, &gear] {
            for reversed in [false, true] {
                let mut corners = tilted(flat);
                if reversed {
                    corners.reverse();
                }
                let by_shape = cut_by_shape(&corners);
                assert!(
                    by_shape.is_some() || flat.len() == 4,
                    "by order, only a dart may be cut well"
                );
                let triangles = by_shape.unwrap_or_else(|| cut_by_order(flat.len()));
                assert_fits(&triangles, flat.len() as u32);
                assert!((area(&corners, &triangles) / shoelace(flat) - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn corners_on_straight_sides_get_triangles_with_an_area() {
        // A square with the middle of every side: by order, all four triangles cut off would be flat.
        let square = [
            [0., 0.],
            [1., 0.],
            [2., 0.],
            [2., 1.],
            [2., 2.],
            [1., 2.],
            [0., 2.],
            [0., 1.],
        ];
        let corners: Vec<Point> = square.iter().map(|&[x, y]| Point::new(x, y, 0.5)).collect();
        let triangles = cut_by_shape(&corners).unwrap();
        assert_fits(&triangles, 8);
        assert!(triangles.iter().all(|t| area(&corners, &vec![*t]) > 0.1));
    }

    #[test]
    fn others_are_left_to_the_cut_by_order() {
        let convex: Vec<[f64; 2]> = (0..7).map(|k| [f64::from(k).cos(), f64::from(k).sin()]).collect();
        assert_eq!(cut_by_shape(&tilted(&convex[..6])), None);
        // A figure of eight, a repeated corner, a slit, no area, no coordinates.
        assert_eq!(
            cut_by_shape(&tilted(&[[0., 0.], [2., 2.], [2., 0.], [0., 2.], [-1., 1.]])),
            None
        );
        assert_eq!(
            cut_by_shape(&tilted(&[[0., 0.], [2., 0.], [1., 1.], [2., 2.], [0., 2.], [1., 1.]])),
            None
        );
        assert_eq!(cut_by_shape(&[Point::origin(); 5]), None);
        assert_eq!(
            cut_by_shape(&[[0.; 3], [f64::NAN; 3], [1.; 3], [2.; 3]].map(Point::from)),
            None
        );
        assert_eq!(
            cut_by_shape(&[[0.; 3], [1e300; 3], [-1e300; 3], [0., 1., 2.]].map(Point::from)),
            None
        );
        assert_eq!(cut_by_shape(&[]), None);
    }
}
