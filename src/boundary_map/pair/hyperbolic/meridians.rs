//! Whether a class of maps between surfaces is one of the solids: loops that bound in the domain have to go to loops that bound in the
//! target. Which loops bound is told by linking numbers, and where they go by their homology.

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::hyperbolic::{HyperbolicEmbedding, Relator};
use crate::mesh::SurfaceMesh;
use crate::toroidal::{HandleLoop, LiftedRings, handle_loops, outer_linking};

/// Rounding of products of small whole numbers.
const ROUNDING: f64 = 1e-6;

/// A basis of the loops of a surface, and their linking numbers with those outside.
struct Loops {
    all: Vec<HandleLoop>,
    linking: DMatrix<f64>,
}

impl Loops {
    /// `None` where linking numbers cannot be told.
    fn new(surface: &SurfaceMesh) -> Option<Self> {
        let all = handle_loops(surface);
        let rows = outer_linking(surface, &all)?;
        let linking = DMatrix::from_fn(all.len(), all.len(), |j, k| f64::from(rows[j][k]));
        Some(Self { all, linking })
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
    fn bounding(&self) -> DMatrix<f64> {
        let count = self.all.len();
        // Row vectors c with c L = 0: the eigenvectors of L Lᵀ of eigenvalue 0, half of them.
        let eigen = (&self.linking * self.linking.transpose()).symmetric_eigen();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let rows: Vec<_> = order[..count / 2]
            .iter()
            .map(|&k| eigen.eigenvectors.column(k).transpose())
            .collect();
        DMatrix::from_rows(&rows)
    }
}

/// The loops of a pair.
pub(super) struct Meridians {
    domain: Loops,
    target: Loops,
    /// From the homology of loops of the target to combinations of its basis.
    in_basis: DMatrix<f64>,
}

impl Meridians {
    /// `None` where it cannot be told which loops bound: a surface passes through itself, or nearly.
    pub fn new(domain: &SurfaceMesh, target: &HyperbolicEmbedding) -> Option<Self> {
        let (domain, on_target) = (Loops::new(domain)?, Loops::new(target.surface())?);
        let in_basis = on_target.homology(&target.lifted_rings()).try_inverse()?;
        Some(Self {
            domain,
            target: on_target,
            in_basis,
        })
    }

    /// Whether the domain with these lifted rings takes all loops that bound in it to such in the target.
    pub fn are_kept(&self, rings: &LiftedRings<Arc<Relator>>) -> bool {
        let images = self.domain.bounding() * self.domain.homology(rings) * &self.in_basis * &self.target.linking;
        images.iter().all(|number| number.abs() < ROUNDING)
    }
}
