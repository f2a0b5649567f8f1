//! Which extremity of the target each extremity of the domain goes to: assignments ranked by geodesic distances.
//!
//! Poses keep distances, so that those between matched extremities should agree. They cannot tell a solid's left from its
//! right: only a list of good assignments is found here.

/// Distances that assignments are ranked by, where the area is 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TipDistances {
    /// The average geodesic distance at each extremity.
    pub average: Vec<f64>,
    /// Distances between extremities.
    pub between: Vec<Vec<f64>>,
    /// Distances from each extremity to each landmark.
    pub to_landmarks: Vec<Vec<f64>>,
}

/// Added to both distances of a ratio: distances below are small, whatever their ratio.
const SMALL: f64 = 0.02;
/// Partial assignments that are kept.
const BEAM: usize = 4096;
/// An extremity this close to a landmark goes to one that is within [`NEAR_ENOUGH`] of the other landmark.
const AT_LANDMARK: f64 = 0.1;
const NEAR_ENOUGH: f64 = 0.3;

/// A partial assignment.
#[derive(Debug, Clone)]
struct Partial {
    /// Sum and number of the terms of the cost.
    sum: f64,
    terms: u32,
    /// For each extremity of the smaller side so far, its partner.
    partners: Vec<Option<u8>>,
}

/// The best assignments of extremities, the best first: pairs of places in the lists of the domain's and the target's. All
/// extremities of the side that has fewer have a partner, unless landmarks forbid it.
///
/// The cost of an assignment is the mean of `|log|` of the ratios of corresponding distances. A beam search: exact for up
/// to six extremities on either side.
pub(super) fn assignments(domain: &TipDistances, target: &TipDistances, most: usize) -> Vec<Vec<[usize; 2]>> {
    let is_swapped = domain.average.len() > target.average.len();
    let (few, many) = if is_swapped { (target, domain) } else { (domain, target) };
    let mut beam = vec![Partial {
        sum: 0.0,
        terms: 0,
        partners: Vec::new(),
    }];
    for tip in 0..few.average.len() {
        let mut longer = Vec::new();
        for partial in &beam {
            let is_free = |j: &usize| !partial.partners.contains(&Some(*j as u8));
            let partners = (0..many.average.len())
                .filter(is_free)
                .filter(|&j| may_match(few, tip, many, j));
            let before = longer.len();
            longer.extend(partners.map(|j| partial.with(few, tip, many, j)));
            if longer.len() == before {
                let mut alone = partial.clone();
                alone.partners.push(None);
                longer.push(alone);
            }
        }
        longer.sort_by(|a, b| a.cost().total_cmp(&b.cost()).then_with(|| a.partners.cmp(&b.partners)));
        longer.truncate(BEAM);
        beam = longer;
    }
    beam.truncate(most);
    let pairs = |partial: &Partial| {
        let matched = partial
            .partners
            .iter()
            .enumerate()
            .filter_map(|(i, &j)| Some((i, usize::from(j?))));
        let mut pairs: Vec<[usize; 2]> = matched.map(|(i, j)| if is_swapped { [j, i] } else { [i, j] }).collect();
        pairs.sort_unstable();
        pairs
    };
    beam.iter().map(pairs).collect()
}

impl Partial {
    fn cost(&self) -> f64 {
        self.sum / f64::from(self.terms.max(1))
    }

    fn with(&self, few: &TipDistances, tip: usize, many: &TipDistances, partner: usize) -> Self {
        let mut sum = self.sum + misfit(few.average[tip], many.average[partner]);
        let mut terms = self.terms + 1;
        for (other, its_partner) in self.partners.iter().enumerate() {
            if let &Some(j) = its_partner {
                sum += misfit(few.between[tip][other], many.between[partner][usize::from(j)]);
                terms += 1;
            }
        }
        for (a, b) in few.to_landmarks[tip].iter().zip(&many.to_landmarks[partner]) {
            sum += misfit(*a, *b);
            terms += 1;
        }
        let mut partners = self.partners.clone();
        partners.push(Some(partner as u8));
        Self { sum, terms, partners }
    }
}

/// Whether two extremities are near the same landmarks.
fn may_match(few: &TipDistances, tip: usize, many: &TipDistances, partner: usize) -> bool {
    let mut pairs = few.to_landmarks[tip].iter().zip(&many.to_landmarks[partner]);
    pairs.all(|(a, b)| a.min(*b) > AT_LANDMARK || a.max(*b) < NEAR_ENOUGH)
}

fn misfit(a: f64, b: f64) -> f64 {
    ((a + SMALL) / (b + SMALL)).ln().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tips of a star in the plane with these lengths of limbs, and landmarks at distances along some of them.
    fn star(lengths: &[f64], landmarks: &[(usize, f64)]) -> TipDistances {
        let n = lengths.len();
        let to_landmark = |i: usize, &(limb, at): &(usize, f64)| {
            if i == limb { lengths[i] - at } else { lengths[i] + at }
        };
        TipDistances {
            average: lengths.iter().map(|length| length + 0.5).collect(),
            between: (0..n)
                .map(|i| {
                    (0..n)
                        .map(|j| if i == j { 0.0 } else { lengths[i] + lengths[j] })
                        .collect()
                })
                .collect(),
            to_landmarks: (0..n)
                .map(|i| landmarks.iter().map(|l| to_landmark(i, l)).collect())
                .collect(),
        }
    }

    #[test]
    fn tips_of_different_distances_are_matched_in_any_order() {
        let domain = star(&[1.0, 0.8, 0.65, 0.5, 0.4, 0.3], &[]);
        let target = star(&[0.31, 0.66, 1.02, 0.49, 0.8, 0.41], &[]);
        let found = assignments(&domain, &target, 16);
        assert_eq!(found.len(), 16);
        assert_eq!(found[0], [[0, 2], [1, 4], [2, 1], [3, 3], [4, 5], [5, 0]]);
    }

    #[test]
    fn the_side_with_fewer_tips_is_matched_whole() {
        let domain = star(&[1.0, 0.8, 0.5], &[]);
        let target = star(&[0.1, 0.5, 1.0, 0.3, 0.8], &[]);
        assert_eq!(assignments(&domain, &target, 1), [[[0, 2], [1, 4], [2, 1]]]);
        assert_eq!(assignments(&target, &domain, 1), [[[1, 2], [2, 0], [4, 1]]]);
    }

    #[test]
    fn twelve_alike_on_either_side_are_no_burden() {
        let alike = star(&[1.0; 12], &[]);
        let found = assignments(&alike, &alike, 16);
        assert_eq!(found.len(), 16);
        assert!(found.iter().all(|pairs| pairs.len() == 12));
        assert_eq!(found[0], (0..12).map(|i| [i, i]).collect::<Vec<_>>());
        assert!(assignments(&star(&[], &[]), &alike, 16)[0].is_empty());
    }

    #[test]
    fn landmarks_decide_between_tips_that_distances_do_not_tell_apart() {
        let (domain, target) = (star(&[1.0; 4], &[(1, 0.98)]), star(&[1.0; 4], &[(3, 0.9)]));
        let found = assignments(&domain, &target, 100);
        assert_eq!(found.len(), 6);
        assert!(found.iter().all(|pairs| pairs[1] == [1, 3]));
    }
}
