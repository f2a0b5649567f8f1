//! Embeddings of surfaces of genus 2 and more in closed hyperbolic surfaces: bijections, certified.
//!
//! A [`HyperbolicEmbedding`] gives every vertex of a surface a place in the hyperbolic plane, and every triangle the deck transformations
//! that bring its corners together, such that the triangles cover a closed surface of curvature −1 once.

mod cut;
mod embedding;
mod layout;
mod locate;
mod minkowski;
mod polygon;
mod word;

pub(crate) use embedding::require_genus_2_or_more;
pub use embedding::{HyperbolicEmbedding, HyperbolicError};
pub(crate) use layout::{HyperbolicLayout, HyperbolicSurface};
pub(crate) use locate::{HyperbolicLocator, Located};
pub(crate) use minkowski::Chart;
pub use word::Letter;
pub(crate) use word::{Relator, Word};

/// Surfaces for tests.
#[cfg(test)]
pub(crate) mod testing {
    use crate::mesh::{SurfaceMesh, shapes};

    /// A plate of cubes with holes in a row.
    pub fn plate_with_holes(holes: i32, divisions: usize) -> SurfaceMesh {
        let across = 2 * holes + 1;
        let cells: Vec<[i32; 3]> = (0..across)
            .flat_map(|i| (0..3).map(move |j| [i, j, 0]))
            .filter(|[i, j, _]| !(i % 2 == 1 && *j == 1))
            .collect();
        shapes::polycube(&cells, divisions)
    }
}
