/// Items in groups, each with one bit relative to its group's representative: which triangles must be turned over,
/// which tetrahedra lie inside.
pub(super) struct ParityForest {
    /// Parent and the bit relative to it.
    links: Vec<(u32, bool)>,
}

impl ParityForest {
    /// `count` items, each in a group of its own.
    pub fn new(count: usize) -> Self {
        Self {
            links: (0..count as u32).map(|i| (i, false)).collect(),
        }
    }

    /// The group's representative, and the item's bit relative to it.
    pub fn find(&mut self, item: usize) -> (usize, bool) {
        let (mut root, mut odd) = (item, false);
        while self.links[root].0 as usize != root {
            let (parent, bit) = self.links[root];
            root = parent as usize;
            odd ^= bit;
        }
        // Every item on the way now hangs on the root.
        let (mut at, mut left) = (item, odd);
        while at != root {
            let (parent, bit) = self.links[at];
            self.links[at] = (root as u32, left);
            at = parent as usize;
            left ^= bit;
        }
        (root, odd)
    }

    /// Joins the groups of two items whose bits differ by `odd`; false when they are known to differ otherwise.
    pub fn join(&mut self, a: usize, b: usize, odd: bool) -> bool {
        let ((root_a, odd_a), (root_b, odd_b)) = (self.find(a), self.find(b));
        let across = odd_a ^ odd_b ^ odd;
        if root_a == root_b {
            return !across;
        }
        // The lower index leads, so that groups do not depend on the order of joins.
        let (child, root) = (root_a.max(root_b), root_a.min(root_b));
        self.links[child] = (root as u32, across);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contradiction_is_reported_and_parities_add_up() {
        let mut forest = ParityForest::new(4);
        assert!(forest.join(3, 2, true));
        assert!(forest.join(2, 1, true));
        assert!(forest.join(1, 0, false));
        assert!(forest.join(0, 3, false));
        assert!(!forest.join(0, 3, true));
        assert_eq!(forest.find(3), (0, false));
        assert_eq!(forest.find(2), (0, true));
    }
}
