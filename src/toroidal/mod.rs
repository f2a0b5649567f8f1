//! Embeddings of surfaces of genus 1 in flat tori: bijections, certified exactly.
//!
//! A [`ToroidalEmbedding`] gives every vertex of a surface a position in the unit square whose opposite sides are glued, such
//! that the triangles cover the torus once. Loops that bound in the solid are told from others by linking numbers, so that
//! a loop that bounds a disk runs along the first side of the square.

mod embedding;
mod handles;
mod knot;
mod layout;
mod linking;
mod locate;
mod rings;
mod springs;

pub use embedding::{ToroidalEmbedding, ToroidalError, require_genus_1};
pub(crate) use handles::{HandleLoop, crossings_with_duals, handle_loops};
pub(crate) use layout::{LatticeMap, PartialLayout, Periods, TORUS_AREA, TorusSurface, place_in_kernel};
pub(crate) use linking::outer_linking;
pub(crate) use locate::ToroidalLocator;
pub(crate) use rings::{DeckGroup, LiftedRings, Shift, Translations};

/// Embeddings for tests.
#[cfg(test)]
pub(crate) mod testing {
    use super::ToroidalEmbedding;
    use crate::mesh::shapes;

    /// A ring whose tube has `across` vertices around, by its two angles.
    pub fn square_torus(around: usize, across: usize) -> ToroidalEmbedding {
        let surface = shapes::torus(1.0, 0.4, around, across);
        let turns = |y: f64, x: f64| y.atan2(x) / std::f64::consts::TAU;
        let positions = surface.vertices().iter().map(|p| {
            let r = p.x.hypot(p.y);
            [turns(p.z, r - 1.0), -turns(p.y, p.x)]
        });
        let positions: Vec<[f64; 2]> = positions.collect();
        let near = |t: &[u32; 3]| {
            let [first, ..] = t.map(|v| positions[v as usize]);
            t.map(|v| [0, 1].map(|axis| (first[axis] - positions[v as usize][axis]).round() as i32))
        };
        let translations: Vec<_> = surface.triangles().iter().map(near).collect();
        ToroidalEmbedding::new(surface, &positions, &translations).unwrap()
    }
}
