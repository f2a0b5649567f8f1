//! A triangulated surface of genus 1 laid out on a flat torus.

use std::cmp::Ordering;

use rayon::prelude::*;

use super::rings::{Shift, minus};
use crate::geometry::orientation;
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::spherical::{EmbeddingCheck, SphericalError, require_genus};
use crate::{Point, Vector};

/// A bijection of a closed surface of genus 1 with the flat torus, the square `[0, 1)²` whose opposite sides are glued: a
/// position per vertex, and for every triangle the whole numbers by which its corners are translated so that it lies in one
/// piece in the plane. Within each triangle the map is linear.
///
/// Positions are multiples of 2⁻⁴⁸. Translated corners are then exact, the triangles on both sides of an edge agree on it
/// exactly, and whether triangles are positive is decided exactly.
#[derive(Debug, Clone, PartialEq)]
pub struct ToroidalEmbedding {
    surface: SurfaceMesh,
    positions: Vec<[f64; 2]>,
    translations: Vec<[Shift; 3]>,
}

/// Positions are multiples of its inverse.
const RESOLUTION: f64 = (1u64 << 48) as f64;
/// Translations by more would not leave enough digits.
const MOST_TRANSLATION: i32 = 15;

/// Why a surface has no embedding in the flat torus, or positions are not one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ToroidalError {
    /// The surface is not one closed manifold.
    #[error(transparent)]
    Surface(SphericalError),
    /// The surface has another number of handles.
    #[error("the surface has genus {genus}, and only a surface of genus 1 maps to a flat torus one to one")]
    Genus {
        /// Number of handles.
        genus: u64,
    },
    /// The loop that bounds a disk in the solid cannot be told.
    #[error(
        "it cannot be told which loops bound in the solid: its surface passes through itself, or nearly; repair it first \
         (`solidmap check` shows where)"
    )]
    Crossing,
    /// The solid is a ball with a knotted hole.
    #[error(
        "its hole is knotted, so that no loop around its handle bounds a disk in the solid, and it is no image of a plain \
         ring; give a solid whose hole is not knotted"
    )]
    KnottedHole,
    /// There must be one position per vertex, and three translations per triangle.
    #[error(
        "the surface has {vertices} vertices and {triangles} triangles, and {positions} positions and {translations} rows \
         of translations were given"
    )]
    Count {
        /// Vertices of the surface.
        vertices: usize,
        /// Triangles of the surface.
        triangles: usize,
        /// Positions given.
        positions: usize,
        /// Triangles with translations.
        translations: usize,
    },
    /// The triangles on both sides of an edge translate its ends by different differences.
    #[error("the translations of the triangles at the edge between vertices {} and {} contradict each other", edge[0], edge[1])]
    Translations {
        /// The vertices of the first such edge.
        edge: [u32; 2],
    },
    /// Vertices come closer together on the torus than the resolution of coordinates.
    #[error(
        "the surface cannot be laid out on a torus: its vertices come too close together for the precision of \
         coordinates; use a coarser surface"
    )]
    TooFine,
    /// The linear systems need more memory than there is.
    #[error("the layout of {vertices} vertices does not fit into memory; use a coarser surface")]
    OutOfMemory {
        /// Vertices of the surface.
        vertices: usize,
    },
    /// Triangles on the torus are flipped, or cover it several times.
    #[error(
        "the map to the flat torus is not one to one: {} of its triangles are flipped, and it covers the torus {:.3} \
         times", .0.flipped, .0.degree
    )]
    NotBijective(EmbeddingCheck),
}

impl ToroidalEmbedding {
    /// The map that sends vertex `v` to `positions[v]`, where the corners of triangle `t` are translated by
    /// `translations[t]`. Positions are moved by whole numbers into the square, and rounded to multiples of 2⁻⁴⁸. Triangles
    /// of the surface must face outward.
    ///
    /// # Errors
    ///
    /// As [`require_genus_1`], and when the map is not a bijection; decided exactly.
    pub fn new(
        surface: SurfaceMesh,
        positions: &[[f64; 2]],
        translations: &[[Shift; 3]],
    ) -> Result<Self, ToroidalError> {
        let oriented = require_genus_1(&surface)?;
        if oriented.triangles() != surface.triangles() {
            let found = "its triangles do not face outward".into();
            return Err(ToroidalError::Surface(SphericalError::NotManifold { found }));
        }
        let (vertices, triangles) = (surface.vertices().len(), surface.triangles().len());
        if positions.len() != vertices || translations.len() != triangles {
            return Err(ToroidalError::Count {
                vertices,
                triangles,
                positions: positions.len(),
                translations: translations.len(),
            });
        }
        let rounded: Vec<[f64; 2]> = positions
            .iter()
            .map(|x| x.map(|c| (c * RESOLUTION).round() / RESOLUTION))
            .collect();
        let whole: Vec<Shift> = rounded.iter().map(|x| x.map(|c| c.floor() as i32)).collect();
        let positions: Vec<[f64; 2]> = rounded.iter().map(|x| x.map(|c| c - c.floor())).collect();
        // The first corner of each triangle is not translated.
        let moved = |(t, given): (&[u32; 3], &[Shift; 3])| {
            let corner = |k: usize| -> Option<[i64; 2]> {
                let whole = whole[t[k] as usize];
                Some([0, 1].map(|axis| i64::from(given[k][axis]) + i64::from(whole[axis])))
            };
            let [a, b, c] = [corner(0)?, corner(1)?, corner(2)?];
            let mut shifts = [[0; 2]; 3];
            for (shift, corner) in shifts.iter_mut().zip([a, b, c]) {
                for axis in 0..2 {
                    let by = corner[axis] - a[axis];
                    shift[axis] = i32::try_from(by).ok().filter(|by| by.abs() <= MOST_TRANSLATION)?;
                }
            }
            Some(shifts)
        };
        let translations: Option<Vec<[Shift; 3]>> = surface.triangles().iter().zip(translations).map(moved).collect();
        let embedding = Self {
            translations: translations.ok_or(ToroidalError::TooFine)?,
            surface,
            positions,
        };
        embedding.require_consistent()?;
        let check = embedding.check();
        if !check.is_bijective() {
            return Err(ToroidalError::NotBijective(check));
        }
        Ok(embedding)
    }

    /// The surface, its triangles facing outward.
    pub fn surface(&self) -> &SurfaceMesh {
        &self.surface
    }

    /// The position of each vertex in the square `[0, 1)²`. In embeddings that are made to be composed, the first coordinate
    /// runs once around along loops that bound a disk in the solid.
    pub fn positions(&self) -> &[[f64; 2]] {
        &self.positions
    }

    /// The whole numbers by which the corners of each triangle are translated; 0 for the first.
    pub fn translations(&self) -> &[[Shift; 3]] {
        &self.translations
    }

    /// The position of a point of the surface, in the square `[0, 1]²`.
    pub fn position(&self, point: &SurfacePoint) -> [f64; 2] {
        let t = point.triangle as usize;
        // A vertex has its own position, bit for bit.
        if let Some(k) = (0..3).find(|&k| (1..3).all(|step| point.barycentric[(k + step) % 3] == 0.0)) {
            return self.positions[self.surface.triangles()[t][k] as usize];
        }
        let corners = self.corners(t);
        let [l, m, n] = point.barycentric;
        let x = (l * corners[0] + m * corners[1] + n * corners[2]) / (l + m + n);
        [x.x, x.y].map(|c| c - c.floor())
    }

    /// The corners of a triangle, in one piece in the plane at height 1.
    pub(crate) fn corners(&self, triangle: usize) -> [Vector; 3] {
        let corners = self.surface.triangles()[triangle];
        let shifts = self.translations[triangle];
        std::array::from_fn(|k| {
            let [u, v] = self.positions[corners[k] as usize];
            let [i, j] = shifts[k];
            Vector::new(u + f64::from(i), v + f64::from(j), 1.0)
        })
    }

    /// Whether all triangles are positive, which is decided exactly, and how often they cover the torus.
    ///
    /// Angles of positive triangles around a vertex add up to a multiple of 2π, and those of all triangles to 2π per vertex,
    /// because a surface of genus 1 has twice as many triangles as vertices. So the map has no branch points: it is a covering,
    /// and with degree 1 a bijection.
    pub fn check(&self) -> EmbeddingCheck {
        let all = (0..self.surface.triangles().len()).into_par_iter();
        let is_flipped = |t: &usize| {
            let [a, b, c] = self.corners(*t).map(Point::from);
            orientation(&Point::origin(), &a, &b, &c) != Some(Ordering::Greater)
        };
        let flipped: Vec<usize> = all.clone().filter(is_flipped).collect();
        let area = |t: usize| {
            let [a, b, c] = self.corners(t);
            0.5 * (b - a).cross(&(c - a)).z
        };
        // In order, so that the sum is the same for any number of threads.
        let areas: Vec<f64> = all.map(area).collect();
        EmbeddingCheck {
            flipped: flipped.len(),
            first_flipped: flipped.first().map(|&t| t as u32),
            degree: areas.iter().sum(),
        }
    }

    /// # Errors
    ///
    /// [`ToroidalError::Translations`] when the triangles beside an edge differ by more than one translation. Where they do
    /// not, the translations from triangle to triangle around a vertex add up to nothing.
    fn require_consistent(&self) -> Result<(), ToroidalError> {
        let topology = Topology::new(&self.surface);
        for (e, &edge) in topology.edges().iter().enumerate() {
            let along = |t: u32| {
                let corners = self.surface.triangles()[t as usize];
                let of = |v: u32| {
                    corners
                        .iter()
                        .position(|&w| w == v)
                        .map(|k| self.translations[t as usize][k])
                };
                Some(minus(of(edge[1])?, of(edge[0])?))
            };
            let sides = topology.sides(e);
            if sides
                .iter()
                .any(|side| along(side.triangle) != along(sides[0].triangle))
            {
                return Err(ToroidalError::Translations { edge });
            }
        }
        Ok(())
    }
}

/// The surface with its triangles facing outward.
///
/// # Errors
///
/// Unless it is one closed, orientable manifold of genus 1 with finite vertices, all of them used.
pub fn require_genus_1(surface: &SurfaceMesh) -> Result<SurfaceMesh, ToroidalError> {
    require_genus(surface, 1).map_err(|error| match error {
        SphericalError::Genus { genus } => ToroidalError::Genus { genus },
        other => ToroidalError::Surface(other),
    })
}
