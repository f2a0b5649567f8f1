//! Boundary triangles that pass through each other, found exactly, also in builds without CGAL.

use std::cmp::Ordering;

use rayon::prelude::*;

use crate::Point;
use crate::geometry::{Aabb, Bvh, orientation};

/// Pairs of triangles that pass through each other: an edge of one meets the other, apart from their common corner.
/// Triangles with a common edge, in one plane, or with corners that are not finite are passed over.
pub(crate) fn crossing_triangles(triangles: &[[u32; 3]], x: &[Point]) -> Vec<[u32; 2]> {
    let corners = |t: u32| triangles[t as usize].map(|v| x[v as usize]);
    let is_finite = |t: &u32| corners(*t).iter().flat_map(Point::iter).all(|x| x.is_finite());
    let ids: Vec<u32> = (0..triangles.len() as u32).filter(is_finite).collect();
    let boxes: Vec<Aabb> = ids.iter().map(|&t| Aabb::around(&corners(t))).collect();
    let tree = Bvh::new(&boxes);
    let crossing = |k: usize| {
        let (mut pairs, mut at) = (Vec::new(), 0);
        while let Some(node) = tree.nodes().get(at) {
            let apart = !overlap(&node.bounds, &boxes[k]);
            if node.is_leaf() && !apart {
                let others = tree.order()[node.items()].iter().map(|&other| other as usize);
                let others = others.filter(|&other| other > k && overlap(&boxes[other], &boxes[k]));
                let pair = others.map(|other| [ids[k], ids[other]]);
                pairs.extend(pair.filter(|[a, b]| cross(triangles[*a as usize], triangles[*b as usize], x)));
            }
            at += if apart { node.size() } else { 1 };
        }
        pairs.sort_unstable();
        pairs
    };
    (0..ids.len()).into_par_iter().flat_map_iter(crossing).collect()
}

fn overlap(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|k| a.low[k] <= b.high[k] && b.low[k] <= a.high[k])
}

fn cross(a: [u32; 3], b: [u32; 3], x: &[Point]) -> bool {
    if a.iter().filter(|v| b.contains(v)).count() > 1 {
        return false;
    }
    let meets = |a: [u32; 3], b: [u32; 3]| {
        // At a common corner an edge touches the other triangle for good.
        let edges = [[a[0], a[1]], [a[1], a[2]], [a[2], a[0]]];
        let mut apart = edges.iter().filter(|edge| !edge.iter().any(|v| b.contains(v)));
        apart.any(|edge| edge_meets(edge.map(|v| x[v as usize]), b.map(|v| x[v as usize])))
    };
    meets(a, b) || meets(b, a)
}

/// Whether an edge with its ends on different sides of a triangle's plane meets the triangle.
fn edge_meets([p, q]: [Point; 2], [a, b, c]: [Point; 3]) -> bool {
    let ends = [orientation(&a, &b, &c, &p), orientation(&a, &b, &c, &q)];
    if ends[0] == ends[1] {
        return false;
    }
    let sides = [
        orientation(&p, &q, &a, &b),
        orientation(&p, &q, &b, &c),
        orientation(&p, &q, &c, &a),
    ];
    let has = |side: Ordering| sides.contains(&Some(side));
    !(has(Ordering::Less) && has(Ordering::Greater))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn two_spheres_cross_only_where_they_overlap_and_a_cube_nowhere() {
        let cube = shapes::cube(1.0, 3);
        assert!(crossing_triangles(cube.triangles(), cube.vertices()).is_empty());
        for (shift, crosses) in [(0.5, true), (1.9, true), (2.1, false)] {
            let sphere = shapes::sphere(1.0, 2);
            let other = shapes::deformed(&sphere, |p| p + crate::Vector::new(shift, 0.01, 0.003));
            let both = shapes::joined(&sphere, &other);
            let pairs = crossing_triangles(both.triangles(), both.vertices());
            assert_eq!(!pairs.is_empty(), crosses, "{shift}");
            let of_first = sphere.triangles().len() as u32;
            assert!(pairs.iter().all(|[a, b]| *a < of_first && *b >= of_first), "{pairs:?}");
        }
    }

    #[test]
    fn triangles_with_a_common_corner_cross_where_one_pierces_the_other() {
        let x: Vec<Point> = [
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.4, 0.4, 1.0],
            [0.4, 0.4, -1.0],
            [2.0, 2.0, 1.0],
        ]
        .map(Point::from)
        .into();
        assert_eq!(crossing_triangles(&[[0, 1, 2], [0, 3, 4]], &x), [[0, 1]]);
        assert!(crossing_triangles(&[[0, 1, 2], [0, 3, 5]], &x).is_empty());
        let mut lost = x.clone();
        lost[3].y = f64::NAN;
        assert!(crossing_triangles(&[[0, 1, 2], [0, 3, 4]], &lost).is_empty());
    }
}
