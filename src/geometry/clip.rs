//! Convex planar polygons cut by planes across the axes.

use smallvec::SmallVec;

use crate::Point;

/// The corners of a convex planar polygon, in order. A triangle cut by six planes has at most nine.
pub(crate) type Polygon = SmallVec<[Point; 9]>;

/// The part of a polygon between two planes across an axis.
pub(crate) fn between(polygon: Polygon, axis: usize, low: f64, high: f64) -> Polygon {
    split(split(polygon, axis, low).1, axis, high).0
}

/// The parts of a polygon below and above a plane across an axis; one that lies in the plane is below.
pub(crate) fn split(polygon: Polygon, axis: usize, at: f64) -> (Polygon, Polygon) {
    if polygon.iter().all(|p| p[axis] <= at) {
        return (polygon, Polygon::new());
    }
    if polygon.iter().all(|p| p[axis] >= at) {
        return (Polygon::new(), polygon);
    }
    let (mut below, mut above) = (Polygon::new(), Polygon::new());
    for (n, p) in polygon.iter().enumerate() {
        let q = &polygon[(n + 1) % polygon.len()];
        if p[axis] <= at {
            below.push(*p);
        }
        if p[axis] >= at {
            above.push(*p);
        }
        // From the lower end, so that neighbours cut their common edge in the same point, bit for bit.
        let (low, high) = if p[axis] < q[axis] { (p, q) } else { (q, p) };
        if low[axis] < at && at < high[axis] {
            let mut cut = low + (high - low) * ((at - low[axis]) / (high[axis] - low[axis]));
            cut[axis] = at;
            below.push(cut);
            above.push(cut);
        }
    }
    (below, above)
}

/// The triangles of a polygon about its first corner.
pub(crate) fn fan(polygon: &[Point]) -> impl Iterator<Item = [Point; 3]> {
    polygon.windows(2).skip(1).map(|edge| [polygon[0], edge[0], edge[1]])
}

/// Area of the projection of a triangle along z, positive where it faces up.
pub(crate) fn projected_area(a: &Point, b: &Point, c: &Point) -> f64 {
    ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(polygon: &Polygon) -> f64 {
        fan(polygon).map(|[a, b, c]| projected_area(&a, &b, &c)).sum()
    }

    #[test]
    fn a_triangle_cut_by_a_square_keeps_the_area_within() {
        let corners = [[-1.0, 0.25, 0.0], [2.0, 0.25, 3.0], [0.5, 3.25, 1.5]].map(Point::from);
        let whole = Polygon::from_slice(&corners);
        let inside = between(between(whole.clone(), 0, 0.0, 1.0), 1, 0.0, 1.0);
        // The sides rise by 2 for 1 and meet x = 0 and x = 1 above 1: all of the square above y = 0.25.
        assert!((area(&inside) - 0.75).abs() < 1e-14, "{inside:?}");
        assert!(inside.iter().all(|p| (p.z - p.x - 1.0).abs() < 1e-14), "{inside:?}");
        let (below, above) = split(whole.clone(), 1, 1.0);
        assert!((area(&below) + area(&above) - area(&whole)).abs() < 1e-14);
        let flat = Polygon::from_slice(&corners.map(|p| Point::new(p.x, p.y, 1.0)));
        assert_eq!(split(flat.clone(), 2, 1.0), (flat, Polygon::new()));
    }
}
