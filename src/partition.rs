//! Points cut into compact parts of nearly equal size by recursive coordinate bisection (Berger and Bokhari, *A
//! partitioning strategy for nonuniform problems on multiprocessors*, IEEE Trans. Comput. C-36, 1987).

use std::ops::Range;

use crate::Point;

/// Below this many points a part is cut on the same thread.
const POINTS_PER_TASK: usize = 1 << 14;

/// Points cut into parts.
#[derive(Debug, Clone)]
pub struct Partition {
    /// Indices of the points, part after part.
    order: Vec<u32>,
    root: Option<Box<Node>>,
    parts: Vec<Range<usize>>,
}

#[derive(Debug, Clone)]
struct Node {
    range: Range<usize>,
    bounds: Bounds,
    /// The largest reach of its points.
    reach: f64,
    children: Option<[Box<Node>; 2]>,
}

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The corner of least coordinates.
    pub low: Point,
    /// The corner of greatest coordinates.
    pub high: Point,
}

impl Bounds {
    /// The smallest box around the points; inverted when there are none.
    pub fn around(points: impl Iterator<Item = Point>) -> Self {
        let empty = Self {
            low: Point::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
            high: Point::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
        };
        points.fold(empty, |bounds, p| Self {
            low: bounds.low.inf(&p),
            high: bounds.high.sup(&p),
        })
    }

    fn distance_squared(&self, other: &Self) -> f64 {
        let gap = |axis: usize| {
            (self.low[axis] - other.high[axis])
                .max(other.low[axis] - self.high[axis])
                .max(0.0)
        };
        (0..3).map(|axis| gap(axis) * gap(axis)).sum()
    }

    fn longest_axis(&self) -> usize {
        let size = self.high - self.low;
        (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best })
    }
}

impl Partition {
    /// Parts of at most `most` points (at least one), equal to within one point or two, of points that reach as far as
    /// `radii` (as many as points). Costs `n log n`; the same points give the same parts.
    pub fn new(points: &[Point], radii: &[f64], most: usize) -> Self {
        debug_assert_eq!(points.len(), radii.len());
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let root = (!points.is_empty()).then(|| {
            let parts = points.len().div_ceil(most.max(1));
            Box::new(cut(points, radii, &mut order, 0, parts))
        });
        let mut parts = Vec::new();
        if let Some(root) = &root {
            collect_leaves(root, &mut parts);
        }
        Self { order, root, parts }
    }

    /// The parts: indices of points, each in exactly one part.
    pub fn parts(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        self.parts.iter().map(|range| &self.order[range.clone()])
    }

    /// The points `j` whose reach `radii[j]` touches the box, in increasing order. Both slices are those of [`Self::new`].
    pub fn reaching(&self, points: &[Point], radii: &[f64], bounds: &Bounds) -> Vec<u32> {
        let mut found = Vec::new();
        let mut pending: Vec<&Node> = self.root.as_deref().into_iter().collect();
        while let Some(node) = pending.pop() {
            if node.bounds.distance_squared(bounds) > node.reach * node.reach {
                continue;
            }
            match &node.children {
                Some(children) => pending.extend(children.iter().map(|child| &**child)),
                None => found.extend(self.order[node.range.clone()].iter().filter(|&&j| {
                    let (p, radius) = (points[j as usize], radii[j as usize]);
                    Bounds { low: p, high: p }.distance_squared(bounds) <= radius * radius
                })),
            }
        }
        found.sort_unstable();
        found
    }
}

fn cut(points: &[Point], radii: &[f64], order: &mut [u32], start: usize, parts: usize) -> Node {
    let bounds = Bounds::around(order.iter().map(|&i| points[i as usize]));
    let reach = order.iter().map(|&i| radii[i as usize]).fold(0.0, f64::max);
    let range = start..start + order.len();
    let children = (parts > 1).then(|| {
        let axis = bounds.longest_axis();
        let middle = order.len() * (parts / 2) / parts;
        order.select_nth_unstable_by(middle, |&a, &b| {
            let [pa, pb] = [a, b].map(|i| points[i as usize][axis]);
            pa.total_cmp(&pb).then(a.cmp(&b))
        });
        let large = order.len() > POINTS_PER_TASK;
        let (left, right) = order.split_at_mut(middle);
        let mut left = || cut(points, radii, left, start, parts / 2);
        let mut right = || cut(points, radii, right, start + middle, parts - parts / 2);
        let (left, right) = if large {
            rayon::join(left, right)
        } else {
            (left(), right())
        };
        [Box::new(left), Box::new(right)]
    });
    Node {
        range,
        bounds,
        reach,
        children,
    }
}

fn collect_leaves(node: &Node, parts: &mut Vec<Range<usize>>) {
    match &node.children {
        Some(children) => children.iter().for_each(|child| collect_leaves(child, parts)),
        None => parts.push(node.range.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn every_point_is_in_one_part_of_the_right_size() {
        let points = shapes::sphere(1.0, 4).vertices().to_vec();
        for most in [1, 7, 120, 10_000] {
            let partition = Partition::new(&points, &vec![0.0; points.len()], most);
            let mut all: Vec<u32> = partition.parts().flatten().copied().collect();
            all.sort_unstable();
            assert!(all.iter().enumerate().all(|(i, &j)| i == j as usize) && all.len() == points.len());
            let sizes: Vec<usize> = partition.parts().map(<[u32]>::len).collect();
            let (least, largest) = (sizes.iter().min().unwrap(), sizes.iter().max().unwrap());
            assert!(
                *largest <= most && largest - least <= 2,
                "{least} to {largest} of {most}"
            );
        }
        assert_eq!(Partition::new(&[], &[], 5).parts().len(), 0);
        assert_eq!(Partition::new(&[Point::origin(); 10], &[0.0; 10], 3).parts().len(), 4);
    }

    #[test]
    fn points_that_reach_a_box_are_those_found_one_by_one() {
        let points = shapes::torus(1.0, 0.4, 40, 20).vertices().to_vec();
        let radii: Vec<f64> = (0..points.len()).map(|i| 0.02 * (i % 17) as f64).collect();
        let partition = Partition::new(&points, &radii, 11);
        for part in partition.parts().take(9) {
            let bounds = Bounds::around(part.iter().map(|&i| points[i as usize]));
            let reaches = |j: &u32| {
                let p = points[*j as usize];
                let nearest = p.inf(&bounds.high).sup(&bounds.low);
                (p - nearest).norm() <= radii[*j as usize]
            };
            let expected: Vec<u32> = (0..points.len() as u32).filter(reaches).collect();
            assert_eq!(partition.reaching(&points, &radii, &bounds), expected);
        }
    }
}
