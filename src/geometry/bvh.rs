//! A tree of boxes over any items that have boxes, split by the binned surface area heuristic (Wald, *On fast
//! construction of SAH-based bounding volume hierarchies*, 2007) and laid out in pre-order.

use std::ops::Range;

use super::Aabb;
use crate::Point;

/// A tree of axis-aligned boxes. The same boxes give the same tree, however many threads build it.
#[derive(Debug, Clone)]
pub struct Bvh {
    nodes: Vec<BvhNode>,
    order: Vec<u32>,
}

/// A node of a [`Bvh`]: one cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct BvhNode {
    /// The box of all items below.
    pub bounds: Aabb,
    begin: u32,
    end: u32,
    /// Nodes from this one to its second child; the first child is the next node. 0 in a leaf.
    second: u32,
    /// Nodes below and including this one.
    size: u32,
}

/// Items per leaf: with fewer than 4, boxes cost more than the triangles they save.
const LEAF: usize = 4;
const BINS: usize = 16;
/// Below this depth ranges are halved, so that no arrangement of boxes makes the tree deeper than [`STACK`].
const HALVING_DEPTH: usize = 48;
/// 48 levels and 31 halvings of 2³¹ items.
const STACK: usize = 80;
/// Ranges of fewer items are not worth a task of their own.
const PARALLEL: usize = 8192;

#[derive(Clone, Copy)]
struct BvhItem {
    bounds: Aabb,
    /// Twice the centre of the box.
    centre: Point,
    index: u32,
}

impl BvhNode {
    /// Its items, as a range of [`Bvh::order`].
    pub fn items(&self) -> Range<usize> {
        self.begin as usize..self.end as usize
    }

    /// Whether it has no children.
    pub fn is_leaf(&self) -> bool {
        self.second == 0
    }

    /// Number of nodes in its subtree, including itself.
    pub fn size(&self) -> usize {
        self.size as usize
    }
}

impl Bvh {
    /// A tree over these boxes, whose coordinates are finite.
    pub fn new(boxes: &[Aabb]) -> Self {
        let item = |(index, bounds): (usize, &Aabb)| BvhItem {
            bounds: *bounds,
            centre: bounds.low + bounds.high.coords,
            index: index as u32,
        };
        let mut items: Vec<BvhItem> = boxes.iter().enumerate().map(item).collect();
        let mut nodes = Vec::with_capacity(boxes.len());
        if !items.is_empty() {
            build(&mut items, 0, 0, &mut nodes);
        }
        let order = items.iter().map(|item| item.index).collect();
        Self { nodes, order }
    }

    /// The nodes in pre-order: the root first, and all of a node's first child before its second.
    pub fn nodes(&self) -> &[BvhNode] {
        &self.nodes
    }

    /// Indices of the items, in the order of the leaves.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Visits the leaves whose box is no farther from `p` than a squared distance `limit`, the nearer child of each
    /// node first. `visit` gets the items, as a range of [`Bvh::order`], and the limit, and returns the new limit.
    #[inline]
    pub fn visit_nearest(&self, p: &Point, mut limit: f64, mut visit: impl FnMut(Range<usize>, f64) -> f64) {
        let mut stack = [(0u32, 0.0f64); STACK];
        let mut waiting = 0;
        let Some(root) = self.nodes.first() else {
            return;
        };
        let (mut at, mut distance) = (0, root.bounds.distance_squared(p));
        loop {
            if distance <= limit {
                let node = &self.nodes[at];
                if node.is_leaf() {
                    limit = visit(node.items(), limit);
                } else {
                    let (first, second) = (at + 1, at + node.second as usize);
                    let to_first = self.nodes[first].bounds.distance_squared(p);
                    let to_second = self.nodes[second].bounds.distance_squared(p);
                    let far;
                    if to_second < to_first {
                        (at, distance) = (second, to_second);
                        far = (first as u32, to_first);
                    } else {
                        (at, distance) = (first, to_first);
                        far = (second as u32, to_second);
                    }
                    if far.1 <= limit {
                        stack[waiting] = far;
                        waiting += 1;
                    }
                    continue;
                }
            }
            if waiting == 0 {
                return;
            }
            waiting -= 1;
            let (next, its_distance) = stack[waiting];
            (at, distance) = (next as usize, its_distance);
        }
    }
}

/// Appends the nodes of the subtree over `items`, the first of which is item `begin` of all.
fn build(items: &mut [BvhItem], begin: usize, depth: usize, nodes: &mut Vec<BvhNode>) {
    let bounds = items.iter().fold(Aabb::empty(), |all, item| all.union(&item.bounds));
    let root = nodes.len();
    nodes.push(BvhNode {
        bounds,
        begin: begin as u32,
        end: (begin + items.len()) as u32,
        second: 0,
        size: 1,
    });
    if items.len() <= LEAF {
        return;
    }
    let middle = if depth < HALVING_DEPTH {
        split(items)
    } else {
        items.len() / 2
    };
    let (first, second) = items.split_at_mut(middle);
    if first.len() + second.len() < PARALLEL {
        build(first, begin, depth + 1, nodes);
        nodes[root].second = (nodes.len() - root) as u32;
        build(second, begin + middle, depth + 1, nodes);
    } else {
        let subtree = |items: &mut [BvhItem], begin| {
            let mut nodes = Vec::with_capacity(items.len());
            build(items, begin, depth + 1, &mut nodes);
            nodes
        };
        let (first, second) = rayon::join(|| subtree(first, begin), || subtree(second, begin + middle));
        nodes.extend(first);
        nodes[root].second = (nodes.len() - root) as u32;
        nodes.extend(second);
    }
    nodes[root].size = (nodes.len() - root) as u32;
}

/// Rearranges the items and returns where the second part begins: both parts have items.
fn split(items: &mut [BvhItem]) -> usize {
    let centres = items.iter().fold(Aabb::empty(), |all, item| Aabb {
        low: all.low.inf(&item.centre),
        high: all.high.sup(&item.centre),
    });
    let axis = centres.extent().imax();
    let (low, width) = (centres.low[axis], centres.extent()[axis]);
    let scale = BINS as f64 * (1.0 - f64::EPSILON) / width;
    let bin = |item: &BvhItem| ((item.centre[axis] - low) * scale) as usize;
    let Some(best) = cheapest_plane(items, |item| bin(item).min(BINS - 1)) else {
        return items.len() / 2;
    };
    let mut middle = 0;
    for i in 0..items.len() {
        if bin(&items[i]).min(BINS - 1) < best {
            items.swap(i, middle);
            middle += 1;
        }
    }
    middle
}

/// The bin at which to begin the second part, by the sum of box areas times items; `None` when one bin has them all.
fn cheapest_plane(items: &[BvhItem], bin: impl Fn(&BvhItem) -> usize) -> Option<usize> {
    let mut counts = [0usize; BINS];
    let mut boxes = [Aabb::empty(); BINS];
    for item in items {
        let bin = bin(item);
        counts[bin] += 1;
        boxes[bin] = boxes[bin].union(&item.bounds);
    }
    let mut cost_above = [0.0; BINS];
    let (mut count, mut bounds) = (0, Aabb::empty());
    for bin in (1..BINS).rev() {
        count += counts[bin];
        bounds = bounds.union(&boxes[bin]);
        cost_above[bin] = count as f64 * bounds.half_area();
    }
    let mut best = None;
    let mut least = f64::INFINITY;
    (count, bounds) = (0, Aabb::empty());
    for bin in 1..BINS {
        count += counts[bin - 1];
        bounds = bounds.union(&boxes[bin - 1]);
        let cost = count as f64 * bounds.half_area() + cost_above[bin];
        if count > 0 && count < items.len() && cost < least {
            (best, least) = (Some(bin), cost);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;
    use crate::Vector;

    const SEED: u64 = 7;

    #[test]
    fn children_partition_the_items_and_fit_their_boxes() {
        let boxes = random_boxes(5000);
        let bvh = Bvh::new(&boxes);
        let mut order = bvh.order().to_vec();
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &item)| item as usize == i));
        for (at, node) in bvh.nodes().iter().enumerate() {
            let items = bvh.order()[node.items()].iter();
            let union = items.fold(Aabb::empty(), |all, &i| all.union(&boxes[i as usize]));
            assert_eq!(union, node.bounds);
            if node.is_leaf() {
                assert!(node.items().len() <= LEAF && node.size() == 1);
            } else {
                let (first, second) = (&bvh.nodes()[at + 1], &bvh.nodes()[at + node.second as usize]);
                assert_eq!(first.items().end, second.items().start);
                assert_eq!(first.items().start..second.items().end, node.items());
                assert_eq!(node.size(), 1 + first.size() + second.size());
            }
        }
    }

    #[test]
    fn one_thread_and_many_build_the_same_tree() {
        let boxes = random_boxes(3 * PARALLEL);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let four = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let (a, b) = (one.install(|| Bvh::new(&boxes)), four.install(|| Bvh::new(&boxes)));
        assert_eq!(a.order(), b.order());
        assert_eq!(format!("{:?}", a.nodes()), format!("{:?}", b.nodes()));
    }

    #[test]
    fn no_arrangement_makes_the_tree_deeper_than_the_stack() {
        // Each box is half as far out as the one before, so that every plane splits off one.
        let nested = |i: i32| Aabb::around(&[Point::from(Vector::repeat(0.5f64.powi(i)))]);
        let same = Aabb::around(&[Point::origin(), Point::new(1.0, 1.0, 1.0)]);
        for boxes in [(0..1000).map(nested).collect(), vec![same; 1000]] {
            let bvh = Bvh::new(&boxes);
            let mut visited = 0;
            bvh.visit_nearest(&Point::origin(), f64::INFINITY, |items, limit| {
                visited += items.len();
                limit
            });
            assert_eq!(visited, 1000);
        }
        Bvh::new(&[]).visit_nearest(&Point::origin(), f64::INFINITY, |_, _| unreachable!());
    }

    fn random_boxes(count: usize) -> Vec<Aabb> {
        let mut random = StdRng::seed_from_u64(SEED);
        let mut point = || Point::from(Vector::from_fn(|_, _| random.random_range(0.0..1.0)));
        (0..count)
            .map(|_| {
                let p = point();
                Aabb::around(&[p, p + point().coords * 0.05])
            })
            .collect()
    }
}
