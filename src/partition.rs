//! Partition of points into compact parts of nearly equal size, by recursive coordinate bisection (Berger and Bokhari,
//! *A partitioning strategy for nonuniform problems on multiprocessors*, IEEE Trans. Comput. C-36, 1987).

use std::cmp::Ordering;
use std::ops::Range;

use crate::Point;

/// Parts with fewer points are divided on the same thread.
const POINTS_PER_TASK: usize = 1 << 14;

/// A partition of points, which may have radii.
#[derive(Debug, Clone)]
pub struct Partition<'a> {
    points: &'a [Point],
    radii: Vec<f64>,
    /// Indices of the points, part after part.
    order: Vec<u32>,
    root: Option<Node>,
    parts: Vec<Range<usize>>,
}

#[derive(Debug, Clone)]
struct Node {
    range: Range<usize>,
    bounds: Bounds,
    /// The largest radius of its points.
    reach: f64,
    children: Option<[Box<Node>; 2]>,
}

/// An axis-aligned box, by its corners of least and greatest coordinates.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: Point,
    high: Point,
}

impl Bounds {
    /// The smallest box around the points with these indices; inverted when there are none.
    fn around(points: &[Point], indices: &[u32]) -> Self {
        let empty = Self {
            low: Point::from([f64::INFINITY; 3]),
            high: Point::from([f64::NEG_INFINITY; 3]),
        };
        indices
            .iter()
            .map(|&i| points[i as usize])
            .fold(empty, |bounds, p| Self {
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

impl<'a> Partition<'a> {
    /// Parts of at most `most` points (at least one), equal to within one point or two. Costs `n log n`; deterministic.
    pub fn equal(points: &'a [Point], most: usize) -> Self {
        Self::new(points, vec![0.0; points.len()], most, None)
    }

    /// Parts of at most `most` points (at least one), for points with these radii. As [`Self::equal`], but parts with a
    /// gap wider than the radii on both sides, as between the two sheets of a flat solid, are divided there: their
    /// bounding boxes would be mostly empty.
    pub fn compact(points: &'a [Point], radii: Vec<f64>, most: usize) -> Self {
        debug_assert_eq!(points.len(), radii.len());
        Self::new(points, radii, most, Some(2.0))
    }

    fn new(points: &'a [Point], radii: Vec<f64>, most: usize, widest_gap: Option<f64>) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let root = (!points.is_empty()).then(|| {
            let parts = points.len().div_ceil(most.max(1));
            let bisection = Bisection {
                points,
                radii: &radii,
                widest_gap,
            };
            bisection.node(&mut order, 0, parts)
        });
        let mut parts = Vec::new();
        if let Some(root) = &root {
            collect_leaves(root, &mut parts);
        }
        Self {
            points,
            radii,
            order,
            root,
            parts,
        }
    }

    /// The parts: indices of points, each in exactly one part.
    pub fn parts(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        self.parts.iter().map(|range| &self.order[range.clone()])
    }

    /// The points within their radii of the box around a part, ascending; those of the part are among them.
    pub fn reaching(&self, part: &[u32]) -> Vec<u32> {
        let bounds = Bounds::around(self.points, part);
        let mut found = Vec::new();
        let mut pending: Vec<&Node> = self.root.iter().collect();
        while let Some(node) = pending.pop() {
            if node.bounds.distance_squared(&bounds) > node.reach * node.reach {
                continue;
            }
            match &node.children {
                Some(children) => pending.extend(children.iter().map(|child| &**child)),
                None => found.extend(self.order[node.range.clone()].iter().filter(|&&j| {
                    let (p, radius) = (self.points[j as usize], self.radii[j as usize]);
                    Bounds { low: p, high: p }.distance_squared(&bounds) <= radius * radius
                })),
            }
        }
        found.sort_unstable();
        found
    }
}

struct Bisection<'a> {
    points: &'a [Point],
    radii: &'a [f64],
    /// In units of a part's largest radius; `None` to leave gaps alone.
    widest_gap: Option<f64>,
}

impl Bisection<'_> {
    /// A subtree with `parts` leaves, or more where gaps divide them.
    fn node(&self, order: &mut [u32], start: usize, parts: usize) -> Node {
        let bounds = Bounds::around(self.points, order);
        let reach = order.iter().map(|&i| self.radii[i as usize]).fold(0.0, f64::max);
        let range = start..start + order.len();
        let middle = match parts {
            1 => self.widest_gap.and_then(|widest| self.gap(order, widest * reach)),
            _ => {
                let middle = order.len() * (parts / 2) / parts;
                order.select_nth_unstable_by(middle, self.along(bounds.longest_axis()));
                Some(middle)
            }
        };
        let children = middle.map(|middle| {
            let large = order.len() > POINTS_PER_TASK;
            let (left, right) = order.split_at_mut(middle);
            let mut left = || self.node(left, start, (parts / 2).max(1));
            let mut right = || self.node(right, start + middle, parts - parts / 2);
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

    /// Sorts the points along the axis of their widest gap and returns the index of the first point beyond the gap, if
    /// it is wider than `wider_than`.
    fn gap(&self, order: &mut [u32], wider_than: f64) -> Option<usize> {
        let mut widest = |axis: usize| {
            order.sort_unstable_by(self.along(axis));
            let coordinate = |i: u32| self.points[i as usize][axis];
            let gaps = order
                .windows(2)
                .map(|pair| coordinate(pair[1]) - coordinate(pair[0]))
                .enumerate();
            let gaps = gaps.map(|(i, gap)| (i + 1, axis, gap));
            gaps.max_by(|a, b| a.2.total_cmp(&b.2))
        };
        let widest_of_all = (0..3).filter_map(&mut widest).max_by(|a, b| a.2.total_cmp(&b.2));
        let (beyond, axis, _) = widest_of_all.filter(|(.., gap)| *gap > wider_than)?;
        order.sort_unstable_by(self.along(axis));
        Some(beyond)
    }

    fn along(&self, axis: usize) -> impl Fn(&u32, &u32) -> Ordering {
        let coordinate = move |i: u32| self.points[i as usize][axis];
        move |&a, &b| coordinate(a).total_cmp(&coordinate(b)).then(a.cmp(&b))
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
            let partition = Partition::equal(&points, most);
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
        assert_eq!(Partition::equal(&[], 5).parts().len(), 0);
        assert_eq!(Partition::equal(&[Point::origin(); 10], 3).parts().len(), 4);
    }

    #[test]
    fn points_within_reach_of_a_box_are_those_found_one_by_one() {
        let points = shapes::torus(1.0, 0.4, 40, 20).vertices().to_vec();
        let radii: Vec<f64> = (0..points.len()).map(|i| 0.02 * (i % 17) as f64).collect();
        let partition = Partition::compact(&points, radii.clone(), 11);
        for part in partition.parts().take(9) {
            let bounds = Bounds::around(&points, part);
            let reaches = |j: &u32| {
                let p = points[*j as usize];
                let nearest = p.inf(&bounds.high).sup(&bounds.low);
                (p - nearest).norm() <= radii[*j as usize]
            };
            let expected: Vec<u32> = (0..points.len() as u32).filter(reaches).collect();
            assert_eq!(partition.reaching(part), expected);
        }
    }

    #[test]
    fn parts_of_two_sheets_are_divided_between_them() {
        // With an odd number of equal parts, one would span both sheets.
        let sheet = |z: f64| (0..150).map(move |k| Point::new(f64::from(k % 15), f64::from(k / 15), z));
        let points: Vec<Point> = sheet(0.0).chain(sheet(100.0)).collect();
        let spans = |partition: &Partition| {
            let height = |part: &[u32]| {
                let bounds = Bounds::around(&points, part);
                bounds.high.z - bounds.low.z
            };
            partition.parts().map(height).fold(0.0, f64::max)
        };
        assert_eq!(spans(&Partition::equal(&points, 100)), 100.0);
        let partition = Partition::compact(&points, vec![3.0; 300], 100);
        assert_eq!(spans(&partition), 0.0);
        assert_eq!(partition.parts().map(<[u32]>::len).sum::<usize>(), 300);
        // Radii across the gap keep the sheets together.
        assert_eq!(Partition::compact(&points, vec![50.0; 300], 100).parts().len(), 3);
        // Without radii every gap divides.
        assert_eq!(Partition::compact(&points, vec![0.0; 300], 100).parts().len(), 300);
    }
}
