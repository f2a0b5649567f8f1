//! A triangulated surface of genus 2 or more laid out on a closed hyperbolic surface.

use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::minkowski::{Chart, lifted, normalised, triangle_area};
use super::polygon::SurfaceGroup;
use super::word::{Letter, Relator, Word};
use crate::Vector;
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::spherical::{EmbeddingCheck, SphericalError, positive_det, require_genus};
use crate::toroidal::{DeckGroup, LiftedRings};

/// A bijection of a closed surface of genus 2 or more with a closed surface of curvature −1: the hyperbolic plane, where points are one
/// if a side pairing of a regular polygon with `4g` sides, or a product of some, takes one to the other.
///
/// Every vertex has a place on the hyperboloid `x² + y² − z² = −1`, and every triangle the words that take the places of its corners
/// to one copy of it. That these fit around every edge is decided exactly, on the words; places are rounded, so that the two triangles at an edge
/// agree on it up to rounding only.
#[derive(Debug, Clone, PartialEq)]
pub struct HyperbolicEmbedding {
    surface: SurfaceMesh,
    group: Arc<SurfaceGroup>,
    places: Vec<Vector>,
    corners: Vec<[Word; 3]>,
}

/// Why a surface has no embedding in a hyperbolic surface, or places are not one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HyperbolicError {
    /// The surface is not one closed manifold.
    #[error(transparent)]
    Surface(SphericalError),
    /// The surface has another number of handles.
    #[error("the surface has genus {genus}, and only surfaces of genus {least} to {most} map to a hyperbolic surface")]
    Genus {
        /// Number of handles.
        genus: u64,
        /// The least that is possible.
        least: u64,
        /// The most that are supported.
        most: u64,
    },
    /// There must be one place per vertex, and three words per triangle.
    #[error(
        "the surface has {vertices} vertices and {triangles} triangles, and {places} places and {words} rows of words were given"
    )]
    Count {
        /// Vertices of the surface.
        vertices: usize,
        /// Triangles of the surface.
        triangles: usize,
        /// Places given.
        places: usize,
        /// Triangles with words.
        words: usize,
    },
    /// The letters are not the relator of the surface's group, or a word has others.
    #[error("the letters of the side pairings are not those of a polygon of this genus")]
    Letters,
    /// The triangles on both sides of an edge contradict each other.
    #[error("the words of the triangles at the edge between vertices {} and {} contradict each other", edge[0], edge[1])]
    Words {
        /// The vertices of the first such edge.
        edge: [u32; 2],
    },
    /// The springs of the coarsest layout do not come to rest without flipped triangles.
    #[error("the surface cannot be laid out: its handles are too thin or too many for the precision of coordinates")]
    Springs,
    /// Vertices come closer together than the precision of coordinates.
    #[error(
        "the surface cannot be laid out on a hyperbolic surface: its vertices come too close together for the precision of \
         coordinates; use a coarser surface"
    )]
    TooFine,
    /// Triangles are flipped, or cover the hyperbolic surface several times.
    #[error(
        "the map to the hyperbolic surface is not one to one: {} of its triangles are flipped, and it covers the surface {:.3} \
         times", .0.flipped, .0.degree
    )]
    NotBijective(EmbeddingCheck),
}

/// Most handles: letters of side pairings are bytes.
const MOST_HANDLES: u64 = 60;

/// Most letters of a word that is given: shortening takes the square of their number. Layouts have some ten.
const MOST_LETTERS: usize = 1000;

/// # Errors
///
/// [`HyperbolicError::Genus`], [`HyperbolicError::Surface`].
pub(crate) fn require_genus_2_or_more(surface: &SurfaceMesh) -> Result<usize, HyperbolicError> {
    let genus = crate::spherical::genus(surface).map_err(HyperbolicError::Surface)?;
    match genus {
        2..=MOST_HANDLES => Ok(genus as usize),
        _ => Err(HyperbolicError::Genus {
            genus,
            least: 2,
            most: MOST_HANDLES,
        }),
    }
}

impl HyperbolicEmbedding {
    /// Lays out a surface of genus 2 or more, for low distortion of angles.
    ///
    /// # Errors
    ///
    /// When the surface is not one, or too fine for the precision of coordinates.
    pub fn of_surface(surface: &SurfaceMesh) -> Result<Self, HyperbolicError> {
        let genus = require_genus_2_or_more(surface)?;
        let oriented = require_genus(surface, genus as u64).map_err(HyperbolicError::Surface)?;
        let prepared = super::layout::HyperbolicSurface::new(oriented, genus);
        prepared.embedded(&prepared.laid_out()?)
    }

    /// The map that sends vertex `v` to the place of the hyperboloid with first coordinates `positions[v]`, where `corners[t]` has
    /// the words of triangle `t`, on the group with this relator: the letters of the polygons around a corner of the polygon, counter-clockwise.
    /// Letters are the generators from 1 on, and their inverses with a minus. Triangles of the surface must face outward.
    ///
    /// # Errors
    ///
    /// When the map is not a bijection.
    pub fn new(
        surface: SurfaceMesh,
        relator: &[Letter],
        positions: &[[f64; 2]],
        corners: &[[Vec<Letter>; 3]],
    ) -> Result<Self, HyperbolicError> {
        let genus = require_genus_2_or_more(&surface)?;
        let oriented = require_genus(&surface, genus as u64).map_err(HyperbolicError::Surface)?;
        if oriented.triangles() != surface.triangles() {
            let found = "its triangles do not face outward".into();
            return Err(HyperbolicError::Surface(SphericalError::NotManifold { found }));
        }
        let group = SurfaceGroup::new(relator).ok_or(HyperbolicError::Letters)?;
        if group.genus() != genus {
            return Err(HyperbolicError::Letters);
        }
        let generators = 2 * genus as i64;
        let is_letter = |&letter: &Letter| letter != 0 && i64::from(letter).abs() <= generators;
        let is_word = |word: &Vec<Letter>| word.len() <= MOST_LETTERS && word.iter().all(is_letter);
        if !corners.iter().flatten().all(is_word) {
            return Err(HyperbolicError::Letters);
        }
        let places: Vec<Vector> = positions.iter().map(|&x| lifted(x)).collect();
        let corners = corners
            .iter()
            .map(|words| [0, 1, 2].map(|k| Word(words[k].as_slice().into())))
            .collect();
        Self::of_places(surface, Arc::new(group), &places, corners)
    }

    /// The same for places on the hyperboloid of an oriented surface.
    pub(crate) fn of_places(
        surface: SurfaceMesh,
        group: Arc<SurfaceGroup>,
        places: &[Vector],
        corners: Vec<[Word; 3]>,
    ) -> Result<Self, HyperbolicError> {
        let (vertices, triangles) = (surface.vertices().len(), surface.triangles().len());
        if places.len() != vertices || corners.len() != triangles {
            return Err(HyperbolicError::Count {
                vertices,
                triangles,
                places: places.len(),
                words: corners.len(),
            });
        }
        // The first corner of each triangle is not moved.
        let moved = |words: &[Word; 3]| {
            let back = words[0].inverted();
            [0, 1, 2].map(|k| match k {
                0 => Word::default(),
                _ => group.relator.shortened(back.times(&words[k])),
            })
        };
        let embedding = Self {
            corners: corners.par_iter().map(moved).collect(),
            surface,
            places: places.iter().map(|x| lifted([x.x, x.y])).collect(),
            group,
        };
        embedding.require_consistent()?;
        let check = embedding.check();
        if !check.is_bijective() {
            return Err(HyperbolicError::NotBijective(check));
        }
        Ok(embedding)
    }

    /// The same places for another surface with these triangles.
    ///
    /// # Errors
    ///
    /// [`HyperbolicError::Count`] when its vertices or triangles are others.
    pub fn over(&self, surface: SurfaceMesh) -> Result<Self, HyperbolicError> {
        let is_alike = surface.vertices().len() == self.places.len() && surface.triangles() == self.surface.triangles();
        match is_alike {
            true => Ok(Self {
                surface,
                ..self.clone()
            }),
            false => Err(HyperbolicError::Count {
                vertices: surface.vertices().len(),
                triangles: surface.triangles().len(),
                places: self.places.len(),
                words: self.corners.len(),
            }),
        }
    }

    /// The same surface with its vertices at other places.
    ///
    /// # Errors
    ///
    /// [`HyperbolicError::NotBijective`].
    pub(crate) fn with_places(&self, places: &[Vector]) -> Result<Self, HyperbolicError> {
        Self::of_places(self.surface.clone(), self.group.clone(), places, self.corners.clone())
    }

    /// The surface, its triangles facing outward.
    pub fn surface(&self) -> &SurfaceMesh {
        &self.surface
    }

    pub(crate) fn group(&self) -> &Arc<SurfaceGroup> {
        &self.group
    }

    /// The letters of the polygons around a corner of the polygon, counter-clockwise: their product is the identity.
    pub fn relator(&self) -> &[Letter] {
        self.group.relator.letters()
    }

    /// The first two coordinates of each vertex's place on the hyperboloid.
    pub fn positions(&self) -> Vec<[f64; 2]> {
        self.places.iter().map(|x| [x.x, x.y]).collect()
    }

    /// The words of the corners of each triangle; without letters for the first.
    pub fn corner_letters(&self) -> impl Iterator<Item = [&[Letter]; 3]> {
        self.corners
            .iter()
            .map(|words| [0, 1, 2].map(|k| words[k].0.as_slice()))
    }

    /// The corners of a triangle in one copy, in the frame of its first corner.
    pub(crate) fn corners(&self, triangle: usize) -> [Vector; 3] {
        let (t, words) = (self.surface.triangles()[triangle], &self.corners[triangle]);
        std::array::from_fn(|k| self.group.moved(&words[k], &self.places[t[k] as usize]))
    }

    /// The corners of a triangle in the copy whose middle is in the polygon.
    pub(crate) fn triangle_in_polygon(&self, triangle: usize) -> [Vector; 3] {
        let corners = self.corners(triangle);
        let (_, word) = self.group.in_polygon(&normalised(&corners.iter().sum()));
        corners.map(|x| self.group.moved(&word, &x))
    }

    /// The place of a point of the surface, in the frame of the first corner of its triangle, or at a vertex in its own.
    pub(crate) fn place(&self, point: &SurfacePoint) -> Vector {
        let t = point.triangle as usize;
        // A vertex has its own place, bit for bit.
        if let Some(k) = (0..3).find(|&k| (1..3).all(|step| point.barycentric[(k + step) % 3] == 0.0)) {
            return self.places[self.surface.triangles()[t][k] as usize];
        }
        self.place_in_frame(point)
    }

    /// The place of a point of the surface in the frame of the first corner of its triangle.
    pub(crate) fn place_in_frame(&self, point: &SurfacePoint) -> Vector {
        let corners = self.corners(point.triangle as usize);
        let [l, m, n] = point.barycentric;
        normalised(&(l * corners[0] + m * corners[1] + n * corners[2]))
    }

    /// The rings of the vertices on the universal cover.
    pub(crate) fn lifted_rings(&self) -> LiftedRings<Arc<Relator>> {
        let (count, triangles) = (self.places.len(), self.surface.triangles());
        LiftedRings::new(self.group.relator.clone(), count, triangles, &self.corners)
    }

    /// For the sides of each triangle, from corner `k` to the next: the triangle on the other side, and the word that takes the frame
    /// of this triangle to that of the other.
    pub(crate) fn crossings(&self) -> Vec<[(u32, Word); 3]> {
        let topology = Topology::new(&self.surface);
        let of_side = |t: usize, side: usize| {
            let edge = topology.edges_of_triangle(t).expect("three vertices")[side];
            let mut sides = topology.sides(edge as usize).iter();
            let other = sides
                .find(|s| s.triangle as usize != t)
                .expect("a closed surface")
                .triangle;
            // The vertex that the side begins at, in both frames.
            let v = self.surface.triangles()[t][side];
            let place = self.surface.triangles()[other as usize].iter().position(|&w| w == v);
            let others = &self.corners[other as usize][place.expect("a shared edge")];
            (
                other,
                self.group.relator.product(others, &self.corners[t][side].inverted()),
            )
        };
        (0..self.corners.len())
            .into_par_iter()
            .map(|t| [0, 1, 2].map(|side| of_side(t, side)))
            .collect()
    }

    /// Whether all triangles are positive beyond rounding errors, and how often they cover the hyperbolic surface.
    ///
    /// Angles of positive triangles around a vertex add up to a multiple of 2π, and, by their areas (Gauss-Bonnet), those of all triangles to
    /// 2π per vertex exactly if the degree is 1. So the map has no branch points: it is a covering of degree 1, a bijection.
    pub fn check(&self) -> EmbeddingCheck {
        let measured = |t: usize| {
            let corners = self.corners(t);
            let chart = Chart::around(corners.iter());
            let [a, b, c] = corners.each_ref().map(|x| chart.place(x));
            let is_positive = positive_det(&a, &b, &c).is_some();
            (is_positive, triangle_area(corners.each_ref()))
        };
        let all: Vec<(bool, f64)> = (0..self.corners.len()).into_par_iter().map(measured).collect();
        EmbeddingCheck {
            flipped: all.iter().filter(|(is_positive, _)| !is_positive).count(),
            first_flipped: all.iter().position(|(is_positive, _)| !is_positive).map(|t| t as u32),
            degree: all.iter().map(|(_, area)| area).sum::<f64>() / self.group.area(),
        }
    }

    /// # Errors
    ///
    /// [`HyperbolicError::Words`].
    fn require_consistent(&self) -> Result<(), HyperbolicError> {
        let relator = &self.group.relator;
        let mut steps: HashMap<(u32, u32), Word> = HashMap::with_capacity(3 * self.corners.len());
        for (t, words) in self.surface.triangles().iter().zip(&self.corners) {
            for k in 0..3 {
                let next = (k + 1) % 3;
                let step = relator.product(&words[k].inverted(), &words[next]);
                let edge = (t[k], t[next]);
                if let Some(back) = steps.remove(&(edge.1, edge.0)) {
                    if !relator.product(&step, &back).is_identity() {
                        return Err(HyperbolicError::Words { edge: edge.into() });
                    }
                } else {
                    steps.insert(edge, step);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn surfaces_with_handles_are_laid_out_once_over_without_flips() {
        for surface in [shapes::double_torus(4), super::super::testing::plate_with_holes(3, 3)] {
            let embedding = HyperbolicEmbedding::of_surface(&surface).unwrap();
            let check = embedding.check();
            assert_eq!(check.flipped, 0);
            assert!((check.degree - 1.0).abs() < 1e-9, "{}", check.degree);
            // Neighbours agree on their edge.
            let corners: Vec<[Vec<Letter>; 3]> = embedding
                .corner_letters()
                .map(|words| words.map(<[Letter]>::to_vec))
                .collect();
            let again =
                HyperbolicEmbedding::new(surface.clone(), embedding.relator(), &embedding.positions(), &corners)
                    .unwrap();
            assert_eq!(again.corners, embedding.corners);
        }
    }
}
