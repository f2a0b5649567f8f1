//! A bijective boundary map between two solids of one genus, 2 or more: the composition of two embeddings in one hyperbolic surface.
//!
//! 1. The target is laid out on a hyperbolic surface.
//! 2. The solids are aligned, and each alignment's closest points tell a class of maps ([`lifting`]): springs lay out a coarse domain in
//!    that class. Loops that are given tell a class, too ([`cut_open`]). Those that cover the target once and take loops where they are to
//!    go ([`homology`]) are optimised and compared.
//! 3. The best layout of the domain is refined, and at every level optimised for low distortion of the map from surface to surface.
//!
//! No step inverts a triangle in the hyperbolic plane.

pub(super) mod both_ways;
mod cut_open;
mod homology;
mod lifting;

use rayon::prelude::*;

use super::starts::{ClosestPoints, PairAlignments};
use super::torus::search::{COARSE_SOFTNESS, FINE_SOFTNESS};
use super::{
    AlignmentSurface, HyperbolicReport, LoopError, PairAlternative, PairError, PairMapping, PairMaps, PairMethod,
    PairPhase, PairReport, PairStart, PairStartKind, PairTimings, Stretch, distortion, is_lower,
};
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::boundary_map::sweep::{HyperbolicTarget, Sweeper, mean_energy};
use crate::hyperbolic::{HyperbolicError, HyperbolicLayout, HyperbolicSurface};
use crate::mesh::SurfaceMesh;
use homology::Homology;
use lifting::{Lifted, TargetPaths, lifted};

/// Vertices of the domain, for each handle, when the best classes are compared again.
const COMPARED_VERTICES: usize = 400;
/// They are compared again when their energy with the coarsest layout is at most this times the least, and this many.
const AS_GOOD_COARSE: f64 = 1.25;
const MOST_COMPARED_AGAIN: usize = 3;
/// The most energy of a triangle, over that of an isometry, when maps are compared.
const MOST_COMPARED: f64 = 25.0;
const COMPARED_CUTS: usize = 3;
/// Sweeps of the coarsest layout when classes are compared first.
const FIRST_SWEEPS: usize = 15;
/// Rounds of sweeps of the coarsest layout when they are compared again, at most, and the sweeps of each; rounds end when the energy falls
/// by less than this share. Many handles take many: springs place them far from where they belong.
const BASE_ROUNDS: usize = 5;
const BASE_SWEEPS: usize = 10;
const LEAST_BASE_DECREASE: f64 = 0.01;
/// Rounds at the end, at most, the sweeps of each, and the relative decrease of the energy below which one is the last.
const LAST_ROUNDS: usize = 6;
const SWEEPS_PER_ROUND: usize = 5;
const LEAST_DECREASE: f64 = 3e-3;

/// Sweeps at a level.
struct Effort {
    cuts: usize,
    softness: f64,
    new_sweeps: usize,
    sweeps: usize,
}

/// The effort at a level with this many vertices.
fn effort(vertices: usize) -> Effort {
    match vertices {
        ..1500 => Effort {
            cuts: 3,
            softness: COARSE_SOFTNESS,
            new_sweeps: 2,
            sweeps: 10,
        },
        1500..6000 => Effort {
            cuts: 2,
            softness: FINE_SOFTNESS,
            new_sweeps: 2,
            sweeps: 5,
        },
        _ => Effort {
            cuts: 1,
            softness: FINE_SOFTNESS,
            new_sweeps: 2,
            sweeps: 3,
        },
    }
}

/// A layout of the domain in one class of maps.
#[derive(Clone)]
struct Candidate {
    layout: HyperbolicLayout,
    kind: PairStartKind,
    /// Mean symmetric Dirichlet energy, 1 for an isometry.
    energy: f64,
}

/// What the alignments led to.
struct Candidates {
    /// Best first.
    ranked: Vec<Candidate>,
    /// Alignments that lead to no map.
    unmapped: Vec<PairStart>,
    warnings: Vec<String>,
}

/// What the layouts of a search have in common.
struct Search {
    domain: HyperbolicSurface,
    target: HyperbolicTarget,
}

impl Search {
    fn points(&self) -> &[Point] {
        self.domain.surface().vertices()
    }

    fn optimise(&self, layout: &mut HyperbolicLayout, effort: &Effort) {
        let sweeper = Sweeper::new(&self.target, layout, self.points(), effort.cuts, effort.softness);
        (0..effort.new_sweeps).for_each(|_| sweeper.sweep(layout, layout.level_start));
        (0..effort.sweeps).for_each(|_| sweeper.sweep(layout, 0));
    }

    fn energy(&self, layout: &HyperbolicLayout) -> f64 {
        mean_energy(
            layout,
            &self.target,
            self.points(),
            COMPARED_CUTS,
            FINE_SOFTNESS,
            MOST_COMPARED,
        )
    }
}

impl PairMapping<'_> {
    /// The map through a hyperbolic surface of this genus.
    pub(super) fn by_hyperbolic_surface(&self, genus: usize) -> Result<PairMaps, PairError> {
        self.report(PairPhase::HyperbolicSurface)?;
        let of_side = |side| move |error| PairError::Hyperbolic { side, error };
        let laid_out = |surface: &SurfaceMesh| {
            let prepared = HyperbolicSurface::new(surface.clone(), genus);
            prepared.embedded(&prepared.laid_out()?)
        };
        let embedding = laid_out(self.target).map_err(of_side("target"))?;
        let search = Search {
            domain: HyperbolicSurface::new(self.domain.clone(), genus),
            target: HyperbolicTarget::new(embedding),
        };
        let laid = self.elapsed();
        let PairAlignments {
            all: mut alignments,
            mut warnings,
        } = self.alignments_of_solids()?;
        // Whoever gives loops has said what goes where.
        if !self.loops.is_empty() {
            warnings.clear();
        }
        let aligned = self.elapsed();

        let mut found = self.candidates(&search, &alignments, genus, true)?;
        if found.ranked.is_empty() && !self.options.aligned && self.reporter.should_improve() {
            let PairAlignments { all, .. } = self.alignments_by_extents()?;
            let again = self.candidates(&search, &all, genus, false)?;
            found.ranked = again.ranked;
            found.unmapped.extend(again.unmapped);
            alignments.extend(all);
        }
        let Candidates {
            mut ranked,
            unmapped,
            warnings: of_homology,
        } = found;
        warnings.extend(of_homology);
        let compared = self.elapsed();
        if ranked.is_empty() {
            let tried = alignments.len();
            return Err(match self.loops {
                [] => PairError::NoClass { tried },
                _ => LoopError::NotFound { tried }.into(),
            });
        }
        let count = ranked.len();
        let others = ranked.split_off(1);
        let best = &ranked[0];
        let before = self.completed_on_hyperbolic_surface(&search, best, false)?;
        let after = match self.options.improve {
            true => self.completed_on_hyperbolic_surface(&search, best, true)?,
            false => before.clone(),
        };
        let improved = self.elapsed();
        let through = |layout: &HyperbolicLayout| -> Result<BoundaryMap, PairError> {
            let embedding = search.domain.embedded(layout).map_err(of_side("domain"))?;
            Ok(BoundaryMap::through_hyperbolic_surface(
                embedding,
                search.target.embedding.clone(),
            )?)
        };
        self.report(PairPhase::Measuring { done: 0, of: 2 })?;
        let no_area = || PairError::from(super::AlignError::NoArea { side: "domain" });
        let mut map = through(&after)?;
        let of_after = distortion(&map).ok_or_else(no_area)?;
        self.report(PairPhase::Measuring { done: 1, of: 2 })?;
        let first = through(&before).ok();
        let of_before = first.as_ref().and_then(distortion).unwrap_or(of_after);
        let mut distortions = [of_before, of_after];
        if let Some(first) = first.filter(|_| !is_lower(&of_after, &of_before)) {
            (map, distortions) = (first, [of_before; 2]);
        }
        let stretch = Stretch::of(&map, self.options.most_stretched).ok_or_else(no_area)?;
        let mut alternatives = Vec::new();
        for other in others.iter().take(self.options.alternatives) {
            alternatives.push(through(&self.completed_on_hyperbolic_surface(&search, other, true)?)?);
        }
        let diagonal = search.target.embedding.surface().diagonal();
        let summary = |candidate: &Candidate| PairStart {
            kind: candidate.kind,
            energy: super::ISOMETRY_ENERGY * candidate.energy,
            vertices: candidate.layout.inserted.len(),
        };
        let report = PairReport {
            coarse_embeddings: count,
            starts: ranked.iter().chain(&others).map(summary).chain(unmapped).collect(),
            alternatives: others
                .iter()
                .map(|other| PairAlternative {
                    shell: None,
                    kind: other.kind,
                    energy_ratio: other.energy / best.energy,
                    isometry_defect: None,
                    distance: distance(other, best, &search.target) / diagonal,
                })
                .collect(),
            hyperbolic: Some(HyperbolicReport {
                genus,
                alignments: alignments.len(),
                classes: count,
                runner_up: others.first().map(|other| other.energy / best.energy),
            }),
            timings: PairTimings {
                sphere: laid,
                align: aligned - laid,
                coarse: compared - aligned,
                improve: improved - compared,
                reversed: 0.0,
                total: self.elapsed(),
            },
            concluded: self.reporter.should_conclude(),
            warnings,
            ..PairReport::of(PairMethod::HyperbolicSurface, distortions, stretch)
        };
        Ok(PairMaps {
            map,
            report,
            alternatives,
        })
    }

    fn alignments_of_solids(&self) -> Result<PairAlignments, PairError> {
        if !self.options.aligned {
            self.report(PairPhase::Aligning { done: 0, of: 0 })?;
        }
        self.alignments()
    }

    /// Alignments of the domain stretched to the target's extents along its principal axes: holes that are in a row in one and around
    /// a corner in the other come closer to each other.
    fn alignments_by_extents(&self) -> Result<PairAlignments, PairError> {
        let from = AlignmentSurface::new(self.domain, "domain")?;
        let to = AlignmentSurface::new(self.target, "target")?;
        let stretched = from.with_extents_of(&to, self.domain);
        let stretched = PairMapping {
            domain: &stretched,
            ..*self
        };
        stretched.alignments()
    }

    /// Layouts of the domain by loops, if these are to be used, and by the closest points of each alignment.
    fn candidates(
        &self,
        search: &Search,
        alignments: &[(PairStartKind, ClosestPoints)],
        genus: usize,
        uses_loops: bool,
    ) -> Result<Candidates, PairError> {
        let embedding = &search.target.embedding;
        let paths = TargetPaths::new(embedding);
        let homology = Homology::new(self.domain, embedding, self.loops)?;
        let warnings = match homology.knows_bounding() {
            true => vec![],
            false => vec![
                "which loops bound a disk in the solids is not known, as of surfaces that pass through themselves: loops of one solid that \
                 do may go to loops of the other that do not"
                    .into(),
            ],
        };
        let mut found: Vec<Candidate> = Vec::new();
        let mut unmapped = Vec::new();
        let cutting = homology.cutting(self.loops);
        let by_loops = match uses_loops && cutting.len() == genus {
            true => self.lifted_by_loops(&cutting, embedding)?,
            false => None,
        };
        let by_loops = by_loops.map(|lifted| (PairStartKind::Loops, Some(lifted)));
        let of_alignment = |(kind, closest): &(PairStartKind, ClosestPoints)| {
            let found = closest.of_all().into_iter().map(|target| target.map(|t| t.place));
            let mut places: Vec<_> = found.collect();
            for point in self.curves {
                places[point.vertex as usize] = Some(point.place);
            }
            let corners = paths.corner_words(self.domain, &places);
            let lifted: Option<Lifted> = corners.map(|corners| lifted(self.domain, embedding, &corners, &places));
            (*kind, lifted)
        };
        let tried = alignments.len() + usize::from(by_loops.is_some());
        let all = by_loops.into_iter().chain(alignments.iter().map(of_alignment));
        for (done, (kind, lifted)) in all.enumerate() {
            self.report(PairPhase::CoarseEmbeddings {
                vertices: COMPARED_VERTICES * genus,
                done,
                of: tried,
            })?;
            let laid = || {
                let (rings, starts) = lifted?;
                if !homology.is_kept(&rings) {
                    return None;
                }
                let group = embedding.group().clone();
                HyperbolicLayout::collapsed(group, rings, starts, search.domain.hierarchy()).ok()
            };
            let Some(mut layout) = laid() else {
                unmapped.push(PairStart {
                    kind,
                    energy: f64::INFINITY,
                    vertices: 0,
                });
                continue;
            };
            let first = Effort {
                cuts: 2,
                softness: COARSE_SOFTNESS,
                new_sweeps: 0,
                sweeps: FIRST_SWEEPS,
            };
            search.optimise(&mut layout, &first);
            let energy = search.energy(&layout);
            found.push(Candidate { layout, kind, energy });
        }
        found.sort_by(|a, b| a.energy.total_cmp(&b.energy));
        let most = found.first().map_or(0.0, |best| AS_GOOD_COARSE * best.energy);
        let again = found.iter().take(MOST_COMPARED_AGAIN);
        let again = again.filter(|c| c.energy <= most).count();
        let refine = |candidate: &mut Candidate| {
            let layout = &mut candidate.layout;
            let base = Effort {
                sweeps: BASE_SWEEPS,
                ..effort(0)
            };
            let mut energy = candidate.energy;
            for _ in 0..BASE_ROUNDS {
                if !self.reporter.should_improve() {
                    break;
                }
                search.optimise(layout, &base);
                let lowered = search.energy(layout);
                if lowered > (1.0 - LEAST_BASE_DECREASE) * energy {
                    break;
                }
                energy = lowered;
            }
            let refined = layout.refine(search.domain.hierarchy(), COMPARED_VERTICES * genus, |layout| {
                if self.reporter.should_improve() {
                    search.optimise(layout, &effort(layout.inserted.len()));
                }
            });
            candidate.energy = match refined {
                Ok(()) => search.energy(layout),
                Err(_) => f64::INFINITY,
            };
        };
        found[..again].par_iter_mut().for_each(refine);
        found[..again].sort_by(|a, b| a.energy.total_cmp(&b.energy));
        Ok(Candidates {
            ranked: found,
            unmapped,
            warnings,
        })
    }

    /// A candidate with the rest of the vertices, its distortion lowered or as it comes.
    fn completed_on_hyperbolic_surface(
        &self,
        search: &Search,
        coarse: &Candidate,
        improve: bool,
    ) -> Result<HyperbolicLayout, PairError> {
        let points = search.points();
        let mut layout = coarse.layout.clone();
        let refined = layout.refine(search.domain.hierarchy(), usize::MAX, |layout| {
            let vertices = layout.inserted.len();
            if improve && self.reporter.should_improve() {
                search.optimise(layout, &effort(vertices));
                let energy = mean_energy(layout, &search.target, points, 1, FINE_SOFTNESS, MOST_COMPARED);
                // A cancellation takes effect at the next level.
                let _ = self.report(PairPhase::Refining {
                    vertices,
                    total: points.len(),
                    energy: super::ISOMETRY_ENERGY * energy,
                });
            }
        });
        let side = "domain";
        refined.map_err(|error: HyperbolicError| PairError::Hyperbolic { side, error })?;
        if !improve {
            return Ok(layout);
        }
        let last = Effort {
            new_sweeps: 0,
            sweeps: SWEEPS_PER_ROUND,
            cuts: if points.len() > 12_000 { 1 } else { 2 },
            softness: FINE_SOFTNESS,
        };
        let energy_of = |layout: &HyperbolicLayout| {
            mean_energy(layout, &search.target, points, last.cuts, FINE_SOFTNESS, f64::INFINITY)
        };
        let mut energy = energy_of(&layout);
        for round in 0..LAST_ROUNDS {
            if !self.reporter.should_improve() {
                break;
            }
            self.report(PairPhase::Improving {
                rounds: round,
                most_rounds: LAST_ROUNDS,
            })?;
            search.optimise(&mut layout, &last);
            let lowered = energy_of(&layout);
            if lowered > (1.0 - LEAST_DECREASE) * energy {
                break;
            }
            energy = lowered;
        }
        Ok(layout)
    }
}

/// The mean distance of the images of the vertices that both have.
fn distance(a: &Candidate, b: &Candidate, target: &HyperbolicTarget) -> f64 {
    let count = a.layout.inserted.len().min(b.layout.inserted.len());
    let of_vertex = |&v: &u32| {
        let [a, b] = [a, b].map(|c| target.position(&c.layout.places[v as usize]));
        (a - b).norm()
    };
    let distances: Vec<f64> = a.layout.inserted[..count].par_iter().map(of_vertex).collect();
    distances.iter().sum::<f64>() / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::{PairOptions, map_pair};
    use crate::hyperbolic::testing::plate_with_holes;
    use crate::mesh::shapes;
    use crate::progress::ProgressControl;

    /// In place, so that closest points are right: a map near to an isometry, of which every vertex stays where it is, about.
    #[test]
    fn a_finer_copy_in_place_is_nearly_an_isometry() {
        for (coarse, fine) in [
            (shapes::double_torus(3), shapes::double_torus(5)),
            (plate_with_holes(3, 2), plate_with_holes(3, 4)),
        ] {
            let options = PairOptions {
                aligned: true,
                ..PairOptions::default()
            };
            let (map, report) = map_pair(&coarse, &fine, &options, &|_| ProgressControl::Continue).unwrap();
            let mean = report.after.mean_symmetric_dirichlet / super::super::ISOMETRY_ENERGY;
            assert!(mean < 1.1, "{mean}");
            let off = map.image().iter().zip(coarse.vertices()).map(|(q, p)| (q - p).norm());
            let mean = off.sum::<f64>() / coarse.vertices().len() as f64;
            assert!(mean < 0.02 * coarse.diagonal(), "{mean}");
        }
    }
}
