//! Layouts of a surface in the hyperbolic plane, as the universal cover of a closed surface: from coarse to fine.
//!
//! Springs lay out a coarse mesh; its other vertices are inserted one by one, each inside the ring of its neighbours, and relaxed level by
//! level, as on a flat torus. All is measured in the charts at the vertices.

use std::sync::Arc;

use super::cut::cut;
use super::minkowski::{Chart, lifted, normalised, triangle_area};
use super::polygon::SurfaceGroup;
use super::word::{Relator, Word};
use super::{HyperbolicEmbedding, HyperbolicError};
use crate::mesh::{SurfaceMesh, triangle_area as area_in_space};
use crate::spherical::{Curvature, EnergyWeights, Hierarchy, RelaxationStar, RestShape, better_place};
use crate::toroidal::{DeckGroup, LiftedRings, place_in_kernel};
use crate::{Point, Vector};

/// Vertices of the coarsest mesh, and as many more for each handle: springs and the first sweeps settle the sooner, the fewer they are.
const BASE_VERTICES: usize = 100;
const WEIGHTS: EnergyWeights = EnergyWeights { angle: 1.0, area: 0.1 };
/// Rounds of relaxation of the coarsest mesh; for the vertices that a level has inserted, and for all.
const BASE_SWEEPS: usize = 100;
const NEW_SWEEPS: usize = 8;
const SWEEPS: usize = 3;
/// Rounds of the springs at most, and the least movement of a round, over the unit of length of the plane, that is followed by
/// another. Errors of a smooth layout fall by a fixed share in a round, about the inverse of the number of vertices.
const MOST_SPRING_ROUNDS: usize = 20_000;
const AT_REST: f64 = 1e-11;

/// A surface of genus 2 or more, its simplification, and the lifted rings of the simplified mesh.
#[derive(Debug, Clone)]
pub(crate) struct HyperbolicSurface {
    surface: SurfaceMesh,
    hierarchy: Hierarchy,
}

impl HyperbolicSurface {
    /// Simplifies a surface of this genus.
    pub fn new(surface: SurfaceMesh, genus: usize) -> Self {
        let least = BASE_VERTICES * (1 + genus);
        let hierarchy = Hierarchy::with_least(surface.vertices(), surface.triangles(), least);
        Self { surface, hierarchy }
    }

    pub fn surface(&self) -> &SurfaceMesh {
        &self.surface
    }

    pub fn hierarchy(&self) -> &Hierarchy {
        &self.hierarchy
    }

    /// The coarsest layout, on a group of its own.
    pub fn base_layout(&self) -> Result<HyperbolicLayout, HyperbolicError> {
        let points = self.surface.vertices();
        let base =
            SurfaceMesh::new(points.to_vec(), self.hierarchy.base.clone()).map_err(|_| HyperbolicError::Springs)?;
        let cut = cut(&base).ok_or(HyperbolicError::Springs)?;
        let relator = cut.group.relator.clone();
        let rings = LiftedRings::new(relator, points.len(), base.triangles(), &cut.corners);
        let mut layout = HyperbolicLayout::of_rings(Arc::new(cut.group), rings, points.len());
        layout.settle()?;
        layout.relax(points, 0, BASE_SWEEPS);
        Ok(layout)
    }

    /// The surface laid out for low distortion of angles, with that of areas bounded.
    pub fn laid_out(&self) -> Result<HyperbolicLayout, HyperbolicError> {
        let points = self.surface.vertices();
        let mut layout = self.base_layout()?;
        let relax = |layout: &mut HyperbolicLayout| {
            layout.relax(points, layout.level_start, NEW_SWEEPS);
            layout.relax(points, 0, SWEEPS);
        };
        layout.refine(&self.hierarchy, usize::MAX, relax)?;
        Ok(layout)
    }

    /// The embedding that a complete layout is.
    pub fn embedded(&self, layout: &HyperbolicLayout) -> Result<HyperbolicEmbedding, HyperbolicError> {
        let group = layout.group.clone();
        let relator = group.relator.clone();
        let word = |v: u32, w: u32| {
            let ring = layout.rings.of(v).iter();
            ring.clone().find(|r| r.0 == w).map(|r| r.1.clone()).unwrap_or_default()
        };
        let corners = |t: &[u32; 3]| [relator.identity(), word(t[0], t[1]), word(t[0], t[2])];
        let corners = self.surface.triangles().iter().map(corners).collect();
        HyperbolicEmbedding::of_places(self.surface.clone(), group, &layout.places, corners)
    }
}

/// A layout of a simplified mesh, some of whose vertices are still to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct HyperbolicLayout {
    pub group: Arc<SurfaceGroup>,
    pub rings: LiftedRings<Arc<Relator>>,
    /// The place of each inserted vertex on the hyperboloid.
    pub places: Vec<Vector>,
    /// The inserted vertices, in the order of their insertion.
    pub inserted: Vec<u32>,
    /// The vertices of the last level are `inserted[level_start..]`.
    pub level_start: usize,
    /// Number of levels inserted.
    levels: usize,
}

impl HyperbolicLayout {
    /// The complete layout that an embedding is.
    pub fn of_embedding(embedding: &HyperbolicEmbedding) -> Self {
        let places = embedding.positions().into_iter().map(lifted).collect();
        let (group, rings) = (embedding.group().clone(), embedding.lifted_rings());
        Self {
            places,
            ..Self::of_rings(group, rings, embedding.surface().vertices().len())
        }
    }

    /// All vertices that have rings, at the centre of the polygon.
    pub fn of_rings(group: Arc<SurfaceGroup>, rings: LiftedRings<Arc<Relator>>, count: usize) -> Self {
        let inserted = (0..count as u32).filter(|&v| !rings.of(v).is_empty()).collect();
        Self {
            group,
            rings,
            places: vec![Vector::z(); count],
            inserted,
            level_start: 0,
            levels: 0,
        }
    }

    /// The coarsest layout of a surface whose vertices have these lifted rings, from springs that start at these places.
    ///
    /// # Errors
    ///
    /// [`HyperbolicError::Springs`] where the triangles do not cover the surface once.
    pub fn collapsed(
        group: Arc<SurfaceGroup>,
        mut rings: LiftedRings<Arc<Relator>>,
        places: Vec<Vector>,
        hierarchy: &Hierarchy,
    ) -> Result<Self, HyperbolicError> {
        rings.collapse(hierarchy);
        let mut layout = Self {
            places,
            ..Self::of_rings(group, rings, hierarchy.vertices)
        };
        layout.settle()?;
        Ok(layout)
    }

    /// The places of the neighbours of a vertex next to it.
    pub fn ring_places(&self, v: u32) -> impl Iterator<Item = Vector> + '_ {
        let place = |(r, word): &(u32, Word)| self.group.moved(word, &self.places[*r as usize]);
        self.rings.of(v).iter().map(place)
    }

    /// Moves every vertex to the middle of its neighbours, until all are at rest: springs along the edges, whose layout has no
    /// flipped triangles. The energy of a spring is the hyperbolic cosine of its length, so that a vertex is in balance at the normalised
    /// sum of its neighbours.
    ///
    /// # Errors
    ///
    /// [`HyperbolicError::Springs`] where triangles are flipped all the same.
    pub fn settle(&mut self) -> Result<(), HyperbolicError> {
        // Over-relaxation, once the vertices are about where they belong.
        for round in 0..MOST_SPRING_ROUNDS {
            let factor: f64 = if round < 20 { 1.0 } else { 1.7 };
            let mut most: f64 = 0.0;
            for i in 0..self.inserted.len() {
                let v = self.inserted[i];
                let middle = normalised(&self.ring_places(v).sum());
                let x = self.places[v as usize];
                let chart = Chart::at(x);
                let step = chart.place(&middle) - Vector::z();
                let length = step.norm();
                most = most.max(length);
                let share = factor.min(0.9 / length.max(1e-300)).max(1.0);
                self.places[v as usize] = match length * share < 0.95 {
                    true => chart.point(&(Vector::z() + step * share)),
                    false => middle,
                };
            }
            if round % 16 == 15 {
                self.rebase();
            }
            if most.is_nan() {
                return Err(HyperbolicError::Springs);
            }
            if most < AT_REST {
                break;
            }
        }
        self.rebase();
        let (triangles, words) = self.rings.triangles();
        let area = |(t, words): (&[u32; 3], &[Word; 3])| {
            let [a, b, c] = [0, 1, 2].map(|k| self.group.moved(&words[k], &self.places[t[k] as usize]));
            triangle_area([&a, &b, &c])
        };
        let areas: Vec<f64> = triangles.iter().zip(&words).map(area).collect();
        let is_whole = (areas.iter().sum::<f64>() - self.group.area()).abs() < 1e-6;
        match is_whole && areas.iter().all(|&area| area > 0.0) {
            true => Ok(()),
            false => Err(HyperbolicError::Springs),
        }
    }

    /// Moves every vertex to its copy in the polygon.
    fn rebase(&mut self) {
        for i in 0..self.inserted.len() {
            let v = self.inserted[i];
            let (place, by) = self.group.in_polygon(&self.places[v as usize]);
            if !by.is_identity() {
                self.places[v as usize] = place;
                self.rings.move_vertex(v, &by);
            }
        }
    }

    /// Inserts vertices, level by level, until there are at least `enough`. After each level `improve` may move vertices,
    /// keeping all triangles positive.
    ///
    /// # Errors
    ///
    /// [`HyperbolicError::TooFine`] when rounding leaves no place for a vertex.
    pub fn refine(
        &mut self,
        hierarchy: &Hierarchy,
        enough: usize,
        mut improve: impl FnMut(&mut Self),
    ) -> Result<(), HyperbolicError> {
        for level in hierarchy.refinements().skip(self.levels) {
            if self.inserted.len() >= enough {
                break;
            }
            self.level_start = self.inserted.len();
            for insertion in level {
                let words = self.rings.as_of_first(&insertion);
                let around: Vec<Vector> = insertion
                    .ring
                    .iter()
                    .zip(&words)
                    .map(|(&r, word)| self.group.moved(word, &self.places[r as usize]))
                    .collect();
                let chart = Chart::around(around.iter());
                let in_chart: Vec<Vector> = around.iter().map(|x| chart.place(x)).collect();
                let place = place_in_kernel(&in_chart).ok_or(HyperbolicError::TooFine)?;
                self.places[insertion.vertex as usize] = chart.point(&place);
                self.rings.insert(&insertion, &words);
                self.inserted.push(insertion.vertex);
            }
            self.levels += 1;
            improve(self);
            self.rebase();
        }
        Ok(())
    }

    /// The factor that scales the area of the simplified mesh, with its vertices at `points`, to that of the hyperbolic surface.
    pub fn area_scale(&self, points: &[Point]) -> f64 {
        let mut total = 0.0;
        for &v in &self.inserted {
            let ring = self.rings.of(v);
            let next = ring.iter().cycle().skip(1);
            // Each triangle once.
            let own = ring.iter().zip(next).filter(|(a, b)| v < a.0 && v < b.0);
            total += own
                .map(|(a, b)| area_in_space(&[v, a.0, b.0].map(|u| points[u as usize])))
                .sum::<f64>();
        }
        self.group.area() / total.max(f64::MIN_POSITIVE)
    }

    /// Relaxes the inserted vertices from the one with index `first` on, `sweeps` times over.
    pub fn relax(&mut self, points: &[Point], first: usize, sweeps: usize) {
        let area_scale = self.area_scale(points);
        let mut star = RelaxationStar::new();
        for _ in 0..sweeps {
            for i in first..self.inserted.len() {
                let v = self.inserted[i];
                let chart = Chart::at(self.places[v as usize]);
                let ring = self.rings.of(v);
                star.clear();
                star.extend(self.ring_places(v).enumerate().map(|(k, place)| {
                    let corners = [v, ring[k].0, ring[(k + 1) % ring.len()].0].map(|u| &points[u as usize]);
                    (chart.place(&place), RestShape::of_triangle(corners, area_scale))
                }));
                if let Some(x) = better_place(Curvature::Flat, &Vector::z(), &star, WEIGHTS, None)
                    && x.xy().norm() < 0.9
                {
                    self.places[v as usize] = chart.point(&x);
                }
            }
        }
    }
}
