//! Minimum cuts of networks in which every node has three neighbours, as the triangles of a closed surface have.
//!
//! Boykov and Kolmogorov, *An experimental comparison of min-cut/max-flow algorithms for energy minimization in
//! vision*, IEEE Trans. PAMI 26, 2004: one tree grows from the source and one from the sink; where they touch, flow is
//! pushed along the path, and the nodes that this cuts off are adopted by another parent or set free. Capacities are
//! integers, so that the cut is exact.

use std::collections::VecDeque;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tree {
    None,
    Source,
    Sink,
}

/// What a node hangs from in its tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Parent {
    None,
    Terminal,
    /// The neighbour in this place.
    Neighbour(u8),
}

/// A network whose nodes have three neighbours each; a node may be the same neighbour's more than once.
pub(super) struct CubicNetwork {
    /// Place `3 n + k` is that of node `n`'s arc to neighbour `k`; here is the place of the arc back.
    twins: Vec<u32>,
    /// What can still flow along each arc.
    residual: Vec<i64>,
    /// What can still flow from the source into each node; into the sink where negative.
    terminal: Vec<i64>,
    tree: Vec<Tree>,
    parent: Vec<Parent>,
    /// Arcs to the terminal, as known at the time that `checked` says.
    distance: Vec<u32>,
    checked: Vec<u32>,
    time: u32,
    active: VecDeque<u32>,
    is_active: Vec<bool>,
    orphans: VecDeque<u32>,
}

impl CubicNetwork {
    /// Without capacities; `twins` says of arc `3 n + k`, from node `n` to its neighbour `k`, which arc runs back.
    pub fn new(twins: Vec<u32>) -> Self {
        let nodes = twins.len() / 3;
        Self {
            residual: vec![0; twins.len()],
            terminal: vec![0; nodes],
            tree: vec![Tree::None; nodes],
            parent: vec![Parent::None; nodes],
            distance: vec![0; nodes],
            checked: vec![0; nodes],
            time: 0,
            active: VecDeque::new(),
            is_active: vec![false; nodes],
            orphans: VecDeque::new(),
            twins,
        }
    }

    /// The arc back.
    pub fn twin(&self, arc: usize) -> usize {
        self.twins[arc] as usize
    }

    /// Takes all capacities away.
    pub fn clear(&mut self) {
        self.residual.fill(0);
        self.terminal.fill(0);
    }

    /// Adds to the capacity from the source to a node, or takes from that to the sink, which is the same for the cut.
    pub fn add_from_source(&mut self, node: usize, capacity: i64) {
        self.terminal[node] += capacity;
    }

    /// Adds a capacity of an arc, not negative.
    pub fn add_to_arc(&mut self, arc: usize, capacity: i64) {
        self.residual[arc] += capacity;
    }

    /// The maximum flow; the capacities become the residual ones. Afterwards [`Self::is_on_source_side`] tells the
    /// smallest source side of all minimum cuts, which does not depend on the order of nodes.
    pub fn solve(&mut self) -> i64 {
        self.plant_trees();
        let mut flow = 0;
        while let Some(node) = self.active.pop_front() {
            self.is_active[node as usize] = false;
            // A node stays in turn for as long as it finds paths.
            while let Some(bridge) = self.grow(node as usize) {
                flow += self.augment(bridge);
                self.adopt_orphans();
            }
        }
        flow
    }

    /// Whether the source still reaches a node through residual capacities.
    pub fn is_on_source_side(&self, node: usize) -> bool {
        self.tree[node] == Tree::Source
    }

    fn plant_trees(&mut self) {
        self.time = 0;
        self.active.clear();
        for node in 0..self.terminal.len() {
            let (tree, parent) = match self.terminal[node].signum() {
                1 => (Tree::Source, Parent::Terminal),
                -1 => (Tree::Sink, Parent::Terminal),
                _ => (Tree::None, Parent::None),
            };
            self.tree[node] = tree;
            self.parent[node] = parent;
            self.distance[node] = 1;
            self.checked[node] = 0;
            self.is_active[node] = tree != Tree::None;
            if self.is_active[node] {
                self.active.push_back(node as u32);
            }
        }
    }

    fn activate(&mut self, node: usize) {
        if !self.is_active[node] {
            self.is_active[node] = true;
            self.active.push_back(node as u32);
        }
    }

    fn neighbour(&self, arc: usize) -> usize {
        self.twin(arc) / 3
    }

    /// What can flow along an arc of a node of this tree, outwards from the tree's root.
    fn outward(&self, tree: Tree, arc: usize) -> i64 {
        if tree == Tree::Source {
            self.residual[arc]
        } else {
            self.residual[self.twin(arc)]
        }
    }

    /// What can flow along an arc of a node of this tree, if the arc's end is nearer to the root.
    fn inward(&self, tree: Tree, arc: usize) -> i64 {
        if tree == Tree::Source {
            self.residual[self.twin(arc)]
        } else {
            self.residual[arc]
        }
    }

    /// Attaches free neighbours of a node to its tree. An arc from the source's to the sink's tree, if there is one.
    fn grow(&mut self, node: usize) -> Option<usize> {
        let tree = self.tree[node];
        if tree == Tree::None {
            return None;
        }
        for arc in 3 * node..3 * node + 3 {
            if self.outward(tree, arc) == 0 {
                continue;
            }
            let other = self.neighbour(arc);
            if self.tree[other] == Tree::None {
                self.tree[other] = tree;
                self.attach(other, self.twin(arc));
                self.activate(other);
            } else if self.tree[other] != tree {
                let bridge = if tree == Tree::Source { arc } else { self.twin(arc) };
                return Some(bridge);
            } else if self.checked[other] <= self.checked[node] && self.distance[other] > self.distance[node] + 1 {
                // A shorter way to the root.
                self.attach(other, self.twin(arc));
            }
        }
        None
    }

    /// Makes the end of one of a node's arcs its parent.
    fn attach(&mut self, node: usize, arc: usize) {
        let parent = self.neighbour(arc);
        self.parent[node] = Parent::Neighbour((arc - 3 * node) as u8);
        self.checked[node] = self.checked[parent];
        self.distance[node] = self.distance[parent] + 1;
    }

    /// Pushes what fits along the path through a bridge, and returns it.
    fn augment(&mut self, bridge: usize) -> i64 {
        let (from, to) = (bridge / 3, self.neighbour(bridge));
        let fits = self.residual[bridge].min(self.width(from)).min(self.width(to));
        self.push(bridge, fits);
        self.push_to_root(from, fits);
        self.push_to_root(to, fits);
        fits
    }

    /// The least capacity between a node and the root of its tree.
    fn width(&self, mut node: usize) -> i64 {
        let mut least = i64::MAX;
        while let Parent::Neighbour(place) = self.parent[node] {
            let arc = 3 * node + place as usize;
            least = least.min(self.inward(self.tree[node], arc));
            node = self.neighbour(arc);
        }
        least.min(self.terminal[node].abs())
    }

    fn push(&mut self, arc: usize, amount: i64) {
        self.residual[arc] -= amount;
        let back = self.twin(arc);
        self.residual[back] += amount;
    }

    /// Pushes along a node's way to the root of its tree, and collects the orphans that this makes.
    fn push_to_root(&mut self, mut node: usize, amount: i64) {
        let tree = self.tree[node];
        while let Parent::Neighbour(place) = self.parent[node] {
            let arc = 3 * node + place as usize;
            let along = if tree == Tree::Source { self.twin(arc) } else { arc };
            self.push(along, amount);
            if self.residual[along] == 0 {
                self.make_orphan(node);
            }
            node = self.neighbour(arc);
        }
        self.terminal[node] -= if tree == Tree::Source { amount } else { -amount };
        if self.terminal[node] == 0 {
            self.make_orphan(node);
        }
    }

    fn make_orphan(&mut self, node: usize) {
        self.parent[node] = Parent::None;
        self.orphans.push_back(node as u32);
    }

    fn adopt_orphans(&mut self) {
        self.time += 1;
        while let Some(orphan) = self.orphans.pop_front() {
            let orphan = orphan as usize;
            let tree = self.tree[orphan];
            let mut nearest = None;
            for arc in 3 * orphan..3 * orphan + 3 {
                let other = self.neighbour(arc);
                if self.tree[other] == tree
                    && self.inward(tree, arc) > 0
                    && let Some(distance) = self.distance_to_root(other)
                    && nearest.is_none_or(|(least, _)| distance < least)
                {
                    nearest = Some((distance, arc));
                }
            }
            match nearest {
                Some((_, arc)) => self.attach(orphan, arc),
                None => self.set_free(orphan, tree),
            }
        }
    }

    /// Arcs to the terminal, or `None` if the way ends at an orphan. Notes the distances on the way for later calls.
    fn distance_to_root(&mut self, node: usize) -> Option<u32> {
        let mut steps = 0;
        let mut at = node;
        let rest = loop {
            if self.checked[at] == self.time {
                break self.distance[at];
            }
            match self.parent[at] {
                Parent::None => return None,
                Parent::Terminal => break 1,
                Parent::Neighbour(place) => at = self.neighbour(3 * at + place as usize),
            }
            steps += 1;
        };
        let mut at = node;
        for done in 0..=steps {
            self.checked[at] = self.time;
            self.distance[at] = rest + steps - done;
            if let Parent::Neighbour(place) = self.parent[at] {
                at = self.neighbour(3 * at + place as usize);
            }
        }
        Some(rest + steps)
    }

    /// Takes an orphan out of its tree; its children become orphans, and who may attach it again becomes active.
    fn set_free(&mut self, orphan: usize, tree: Tree) {
        for arc in 3 * orphan..3 * orphan + 3 {
            let other = self.neighbour(arc);
            if other == orphan || self.tree[other] != tree {
                continue;
            }
            if self.inward(tree, arc) > 0 {
                self.activate(other);
            }
            if let Parent::Neighbour(place) = self.parent[other]
                && 3 * other + place as usize == self.twin(arc)
            {
                self.make_orphan(other);
            }
        }
        self.tree[orphan] = Tree::None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A repeatable sequence of numbers below `bound`.
    fn numbers(mut state: u64) -> impl FnMut(u64) -> u64 {
        move |bound| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % bound
        }
    }

    /// Arcs of a random network in which no node is its own neighbour.
    fn random_twins(nodes: usize, random: &mut impl FnMut(u64) -> u64) -> Vec<u32> {
        loop {
            let mut ends: Vec<u32> = (0..3 * nodes as u32).collect();
            for i in (1..ends.len()).rev() {
                ends.swap(i, random(i as u64 + 1) as usize);
            }
            let mut twins = vec![0; ends.len()];
            for pair in ends.chunks_exact(2) {
                twins[pair[0] as usize] = pair[1];
                twins[pair[1] as usize] = pair[0];
            }
            if (0..twins.len()).all(|arc| twins[arc] as usize / 3 != arc / 3) {
                return twins;
            }
        }
    }

    /// The capacity of the arcs and terminals that leave a set of nodes.
    fn capacity_of_cut(twins: &[u32], arcs: &[i64], terminal: &[i64], is_inside: impl Fn(usize) -> bool) -> i64 {
        let cut_arcs: i64 = (0..arcs.len())
            .filter(|&arc| is_inside(arc / 3) && !is_inside(twins[arc] as usize / 3))
            .map(|arc| arcs[arc])
            .sum();
        let cut_terminals: i64 = (0..terminal.len())
            .map(|n| {
                if is_inside(n) {
                    (-terminal[n]).max(0)
                } else {
                    terminal[n].max(0)
                }
            })
            .sum();
        cut_arcs + cut_terminals
    }

    #[test]
    fn flow_equals_the_least_cut_and_the_source_side_is_the_smallest() {
        let mut random = numbers(1);
        for trial in 0..400 {
            let nodes = 2 + 2 * random(6) as usize;
            let twins = random_twins(nodes, &mut random);
            // Small capacities, so that many cuts are equally good.
            let largest = if trial % 2 == 0 { 4 } else { 1000 };
            let arcs: Vec<i64> = twins.iter().map(|_| random(largest) as i64).collect();
            let terminal: Vec<i64> = (0..nodes)
                .map(|_| random(2 * largest) as i64 - largest as i64)
                .collect();
            let mut network = CubicNetwork::new(twins.clone());
            arcs.iter().enumerate().for_each(|(arc, &c)| network.add_to_arc(arc, c));
            terminal
                .iter()
                .enumerate()
                .for_each(|(n, &c)| network.add_from_source(n, c));
            let flow = network.solve();
            let cuts: Vec<i64> = (0..1_usize << nodes)
                .map(|set| capacity_of_cut(&twins, &arcs, &terminal, |n| set >> n & 1 == 1))
                .collect();
            let found = (0..nodes).fold(0, |set, n| set | usize::from(network.is_on_source_side(n)) << n);
            let least = *cuts.iter().min().unwrap();
            let smallest = (0..cuts.len())
                .filter(|&s| cuts[s] == least)
                .fold(usize::MAX, |all, s| all & s);
            assert_eq!((flow, found), (least, smallest), "trial {trial}");
        }
    }

    #[test]
    fn a_network_can_be_used_again() {
        let mut random = numbers(2);
        let twins = random_twins(40, &mut random);
        let mut used = CubicNetwork::new(twins.clone());
        for _ in 0..20 {
            let mut fresh = CubicNetwork::new(twins.clone());
            used.clear();
            for network in [&mut fresh, &mut used] {
                let mut same = numbers(3);
                (0..120).for_each(|arc| network.add_to_arc(arc, same(50) as i64));
                (0..40).for_each(|n| network.add_from_source(n, same(100) as i64 - 50));
            }
            assert_eq!(fresh.solve(), used.solve());
            assert!((0..40).all(|n| fresh.is_on_source_side(n) == used.is_on_source_side(n)));
        }
    }
}
