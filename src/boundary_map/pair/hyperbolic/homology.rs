//! Whether a class of maps between surfaces is one of the solids, and the one that is asked for: loops that bound in the domain have
//! to go to loops that bound in the target, and given loops to their partners. Which loops bound is told by linking numbers, and where
//! they go by their homology.

use std::collections::HashSet;
use std::sync::Arc;

use nalgebra::{DMatrix, RowDVector};

use super::super::LoopError;
use super::super::loops::LoopPair;
use crate::hyperbolic::{HyperbolicEmbedding, Relator};
use crate::mesh::SurfaceMesh;
use crate::toroidal::{HandleLoop, LiftedRings, crossings_with_duals, handle_loops, outer_linking};

/// Rounding of products of small whole numbers.
const ROUNDING: f64 = 1e-6;

/// A basis of the loops of a surface, and their linking numbers with those outside.
struct Loops {
    all: Vec<HandleLoop>,
    /// `None` where they cannot be told: a surface passes through itself, or nearly.
    linking: Option<DMatrix<f64>>,
    /// Loops that are given, as combinations of the basis.
    given: Vec<RowDVector<f64>>,
}

impl Loops {
    fn new<'a>(surface: &SurfaceMesh, given: impl Iterator<Item = &'a [u32]>) -> Self {
        let all = handle_loops(surface);
        let linking = outer_linking(surface, &all);
        let of_loop = |walk| {
            let crossings = crossings_with_duals(surface, &all, walk).into_iter();
            RowDVector::from_iterator(all.len(), crossings.map(f64::from))
        };
        Self {
            linking: linking.map(|rows| DMatrix::from_fn(all.len(), all.len(), |j, k| f64::from(rows[j][k]))),
            given: given.map(of_loop).collect(),
            all,
        }
    }

    /// How often each loop crosses the sides of each generator, with signs: its homology.
    fn homology(&self, rings: &LiftedRings<Arc<Relator>>) -> DMatrix<f64> {
        let count = self.all.len();
        let mut sums = DMatrix::zeros(count, count);
        for (j, of_loop) in self.all.iter().enumerate() {
            let walk = &of_loop.loop_vertices;
            for (v, w) in walk.iter().zip(walk.iter().cycle().skip(1)) {
                let step = rings.of(*v).iter().find(|r| r.0 == *w);
                for &letter in step.iter().flat_map(|step| step.1.0.iter()) {
                    sums[(j, usize::from(letter.unsigned_abs()) - 1)] += f64::from(letter.signum());
                }
            }
        }
        sums
    }

    /// Combinations of loops that bound in the solid, as rows.
    fn bounding(&self, linking: &DMatrix<f64>) -> DMatrix<f64> {
        let count = self.all.len();
        // Row vectors c with c L = 0: the eigenvectors of L Lᵀ of eigenvalue 0, half of them.
        let eigen = (linking * linking.transpose()).symmetric_eigen();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let rows: Vec<_> = order[..count / 2]
            .iter()
            .map(|&k| eigen.eigenvectors.column(k).transpose())
            .collect();
        DMatrix::from_rows(&rows)
    }

    /// Whether a given loop bounds in the solid.
    fn bounds(&self, index: usize) -> Option<bool> {
        Some((&self.given[index] * self.linking.as_ref()?).amax() < ROUNDING)
    }
}

/// The loops of a pair.
pub(super) struct Homology {
    domain: Loops,
    target: Loops,
    /// That of the target's loops, by the generators of its group.
    of_target: DMatrix<f64>,
}

impl Homology {
    /// # Errors
    ///
    /// When a given loop goes round nothing, or bounds in one solid alone.
    pub fn new(domain: &SurfaceMesh, target: &HyperbolicEmbedding, given: &[LoopPair]) -> Result<Self, LoopError> {
        let domain = Loops::new(domain, given.iter().map(|pair| &pair.domain[..]));
        let on_target = Loops::new(target.surface(), given.iter().map(|pair| &pair.target[..]));
        for index in 0..given.len() {
            for (side, loops) in [("domain", &domain), ("target", &on_target)] {
                if loops.given[index].amax() == 0.0 {
                    return Err(LoopError::NoHandle { index, side });
                }
            }
            match [&domain, &on_target].map(|loops| loops.bounds(index)) {
                [Some(true), Some(false)] => return Err(LoopError::Bounds { index, side: "domain" }),
                [Some(false), Some(true)] => return Err(LoopError::Bounds { index, side: "target" }),
                _ => {}
            }
        }
        Ok(Self {
            of_target: on_target.homology(&target.lifted_rings()),
            domain,
            target: on_target,
        })
    }

    /// Loops of the given ones that meet neither themselves nor each other, as many as there are handles, along which the surfaces do not fall
    /// apart when they are cut; fewer where there are none.
    pub fn cutting<'a>(&self, given: &'a [LoopPair]) -> Vec<&'a LoopPair> {
        let handles = self.domain.all.len() / 2;
        let (mut taken, mut rows): (Vec<&LoopPair>, Vec<RowDVector<f64>>) = (vec![], vec![]);
        let mut met = [HashSet::new(), HashSet::new()];
        for (index, pair) in given.iter().enumerate() {
            let walks = [&pair.domain, &pair.target];
            let is_free = |side: usize| {
                let mut own = HashSet::new();
                walks[side].iter().all(|v| own.insert(*v) && !met[side].contains(v))
            };
            // Disjoint loops cut nothing off if they are independent.
            rows.push(self.domain.given[index].clone());
            if taken.len() < handles
                && is_free(0)
                && is_free(1)
                && DMatrix::from_rows(&rows).rank(ROUNDING) == rows.len()
            {
                (0..2).for_each(|side| met[side].extend(walks[side].iter().copied()));
                taken.push(pair);
            } else {
                rows.pop();
            }
        }
        taken
    }

    /// Linking numbers of domain and target, and the map from the homology of loops of the target to combinations of its basis.
    fn linking(&self) -> Option<[DMatrix<f64>; 3]> {
        let linking = [&self.domain, &self.target].map(|loops| loops.linking.clone());
        let [Some(domain), Some(target)] = linking else {
            return None;
        };
        Some([domain, target, self.of_target.clone().try_inverse()?])
    }

    /// Whether it is known which loops bound.
    pub fn knows_bounding(&self) -> bool {
        self.linking().is_some()
    }

    /// Whether the domain with these lifted rings takes all loops that bound in it to such in the target, as far as that is known, and the
    /// given loops to their partners.
    pub fn is_kept(&self, rings: &LiftedRings<Arc<Relator>>) -> bool {
        let images = self.domain.homology(rings);
        let is_small = |numbers: DMatrix<f64>| numbers.iter().all(|number| number.abs() < ROUNDING);
        let keeps_bounding = self.linking().is_none_or(|[domain, target, in_basis]| {
            is_small(self.domain.bounding(&domain) * &images * in_basis * target)
        });
        let mut given = self.domain.given.iter().zip(&self.target.given);
        keeps_bounding && given.all(|(from, to)| (from * &images - to * &self.of_target).amax() < ROUNDING)
    }
}
