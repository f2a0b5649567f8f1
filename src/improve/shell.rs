//! The map of one shell, moved on the sphere, the flat torus or the hyperbolic surface that it goes through.

use rayon::prelude::*;

use super::{CUTS, ImproveError, SOFTNESS, SWEEPS};
use crate::boundary_map::BoundaryMap;
use crate::boundary_map::sweep::{
    HyperbolicTarget, Layout, ProximalTerm, SphereLayout, SphereTarget, Sweeper, TargetTorus, mean_energy,
};
use crate::hyperbolic::HyperbolicLayout;
use crate::mesh::SurfaceMesh;
use crate::spherical::{RestShape, SphericalEmbedding};
use crate::toroidal::{PartialLayout, Periods, ToroidalEmbedding};
use crate::{Point, Vector};

/// From places of layouts to points of a shell of the target.
pub(super) enum ShellTarget {
    Sphere(SphereTarget),
    Torus(TargetTorus),
    Hyperbolic(HyperbolicTarget),
}

impl ShellTarget {
    /// # Errors
    ///
    /// When the map is no composition of embeddings.
    pub fn new(map: &BoundaryMap) -> Result<Self, ImproveError> {
        if map.domain_embedding().is_some() {
            Ok(Self::Sphere(SphereTarget::new(map.target_embedding())))
        } else if let Some([_, target]) = map.torus_embeddings() {
            Ok(Self::Torus(TargetTorus::new(target, Periods::of_embedding(target))))
        } else if let Some([_, target]) = map.hyperbolic_embeddings() {
            Ok(Self::Hyperbolic(HyperbolicTarget::new(target.clone())))
        } else {
            Err(ImproveError::NoEmbedding)
        }
    }

    /// The map that was given to [`Self::new`], to be moved.
    ///
    /// # Errors
    ///
    /// When it is another map, which is none between surfaces of this kind.
    pub fn slider<'a>(&'a self, map: &'a BoundaryMap) -> Result<Box<dyn Sliding + 'a>, ImproveError> {
        match self {
            Self::Sphere(onto) => {
                let domain = map.domain_embedding().ok_or(ImproveError::NoEmbedding)?;
                let target = map.target_embedding();
                let through = move |layout: &SphereLayout| {
                    let domain = SphericalEmbedding::new(domain.surface().clone(), &layout.directions)?;
                    Ok(match target {
                        Some(target) => BoundaryMap::through_sphere(domain, target.clone())?,
                        None => BoundaryMap::onto_sphere(domain)?,
                    })
                };
                let layout = SphereLayout::new(domain);
                Ok(Slider::boxed(
                    layout,
                    onto,
                    onto.scale,
                    domain.surface(),
                    Box::new(through),
                ))
            }
            Self::Torus(onto) => {
                let [domain, target] = map.torus_embeddings().ok_or(ImproveError::NoEmbedding)?;
                let through = |layout: &PartialLayout| {
                    let positions: Vec<[f64; 2]> =
                        layout.places.iter().map(|x| layout.periods.coordinates(x)).collect();
                    let domain = ToroidalEmbedding::new(domain.surface().clone(), &positions, domain.translations())?;
                    Ok(BoundaryMap::through_torus(domain, target.clone())?)
                };
                let layout = PartialLayout::of_embedding(domain, onto.periods);
                Ok(Slider::boxed(
                    layout,
                    onto,
                    onto.scale,
                    domain.surface(),
                    Box::new(through),
                ))
            }
            Self::Hyperbolic(onto) => {
                let [domain, target] = map.hyperbolic_embeddings().ok_or(ImproveError::NoEmbedding)?;
                let through = |layout: &HyperbolicLayout| {
                    let domain = domain.with_places(&layout.places)?;
                    Ok(BoundaryMap::through_hyperbolic_surface(domain, target.clone())?)
                };
                let layout = HyperbolicLayout::of_embedding(domain);
                Ok(Slider::boxed(
                    layout,
                    onto,
                    onto.scale,
                    domain.surface(),
                    Box::new(through),
                ))
            }
        }
    }
}

/// How the energy of the volume changes with the images of a shell's vertices.
pub(super) struct ShellSlopes<'a> {
    /// Where it was measured.
    pub images: &'a [Point],
    /// By the image of each vertex.
    pub slopes: &'a [Vector],
    /// How much the energy counts for, beside that of the surface.
    pub weight: f64,
    /// The same for the quadratic form.
    pub of_form: f64,
}

/// The map of a shell, which slides on its target.
pub(super) trait Sliding {
    /// Symmetric Dirichlet energy of the surface, 1 for an isometry, times the area of what it is laid out on.
    fn energy(&self) -> f64;
    /// The factor of the area of the shell to that.
    fn area_scale(&self) -> f64;
    /// Moves vertices from where they were accepted; `go_on` is asked after each sweep.
    fn slide(&mut self, slopes: &ShellSlopes, go_on: &dyn Fn() -> Result<(), ImproveError>)
    -> Result<(), ImproveError>;
    /// The map as it was moved last, or as it was at first.
    ///
    /// # Errors
    ///
    /// When rounding has left no bijection.
    fn map(&self) -> Result<BoundaryMap, ImproveError>;
    /// The next moves begin where the last ones ended.
    fn accept(&mut self);
}

type Through<'a, L> = Box<dyn Fn(&L) -> Result<BoundaryMap, ImproveError> + 'a>;

struct Slider<'a, L: Layout> {
    accepted: L,
    moved: L,
    target: &'a L::Target,
    /// Of images, as the target gives them.
    scale: f64,
    points: &'a [Point],
    area: f64,
    sweeper: Sweeper<'a, L>,
    form: BoundaryForm,
    through: Through<'a, L>,
}

impl<'a, L: Layout + Clone + 'a> Slider<'a, L> {
    fn boxed(
        layout: L,
        target: &'a L::Target,
        scale: f64,
        domain: &'a SurfaceMesh,
        through: Through<'a, L>,
    ) -> Box<dyn Sliding + 'a> {
        let points = domain.vertices();
        Box::new(Self {
            moved: layout.clone(),
            target,
            scale,
            points,
            area: domain.area(),
            sweeper: Sweeper::new(target, &layout, points, CUTS, SOFTNESS),
            form: BoundaryForm::new(domain, &layout),
            through,
            accepted: layout,
        })
    }
}

impl<L: Layout + Clone> Sliding for Slider<'_, L> {
    fn energy(&self) -> f64 {
        let mean = mean_energy(&self.accepted, self.target, self.points, CUTS, SOFTNESS, f64::INFINITY);
        self.area_scale() * self.area * mean
    }

    fn area_scale(&self) -> f64 {
        self.accepted.area_scale(self.points)
    }

    fn slide(
        &mut self,
        slopes: &ShellSlopes,
        go_on: &dyn Fn() -> Result<(), ImproveError>,
    ) -> Result<(), ImproveError> {
        self.moved.clone_from(&self.accepted);
        self.sweeper.proximal = Some(self.form.term(slopes, self.scale));
        for _ in 0..SWEEPS {
            self.sweeper.sweep(&mut self.moved, 0);
            go_on()?;
        }
        Ok(())
    }

    fn map(&self) -> Result<BoundaryMap, ImproveError> {
        (self.through)(&self.moved)
    }

    fn accept(&mut self) {
        self.accepted.clone_from(&self.moved);
    }
}

/// `κ + L / κ` of a shell of the domain, lumped: a bound of twice the Dirichlet-to-Neumann operator.
struct BoundaryForm {
    masses: Vec<f64>,
    couplings: Vec<Vec<f64>>,
}

impl BoundaryForm {
    fn new<L: Layout>(domain: &SurfaceMesh, layout: &L) -> Self {
        let points = domain.vertices();
        let area = domain.area();
        // Both the smoothest functions, of frequencies about 1 / R, and the roughest, about 1 / h, are bounded equally well.
        let radius = (area / (4.0 * std::f64::consts::PI)).sqrt();
        let spacing = (area / points.len().max(1) as f64).sqrt();
        let frequency = 1.0 / (radius * spacing).sqrt();
        let of_vertex = |v: u32| -> (f64, Vec<f64>) {
            let ring: Vec<u32> = layout.ring(v).collect();
            let count = ring.len();
            let mut cotangents = vec![0.0; count];
            let mut mass = 0.0;
            for i in 0..count {
                let next = (i + 1) % count;
                let rest = RestShape::of_triangle([v, ring[i], ring[next]].map(|u| &points[u as usize]), 1.0);
                mass += rest.area / 3.0;
                cotangents[next] += 0.5 * rest.cotangents[1];
                cotangents[i] += 0.5 * rest.cotangents[2];
            }
            let couplings = cotangents.iter().map(|w| w.max(0.0) / frequency);
            (frequency * mass, couplings.collect())
        };
        let (masses, couplings) = (0..points.len() as u32).into_par_iter().map(of_vertex).unzip();
        Self { masses, couplings }
    }

    /// The energy of the volume, as a function of images near to those where it was measured, times `scale`.
    fn term(&self, at: &ShellSlopes, scale: f64) -> ProximalTerm {
        let bend = at.of_form / (scale * scale);
        ProximalTerm {
            images: at.images.iter().map(|y| Point::from(y.coords * scale)).collect(),
            slopes: at.slopes.iter().map(|slope| slope * (at.weight / scale)).collect(),
            masses: self.masses.iter().map(|mass| bend * mass).collect(),
            couplings: self
                .couplings
                .iter()
                .map(|of| of.iter().map(|w| bend * w).collect())
                .collect(),
        }
    }
}
