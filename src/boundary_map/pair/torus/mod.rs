//! A bijective boundary map between two solids of genus 1: the composition of two embeddings in one flat torus.
//!
//! 1. Both surfaces are laid out on tori, such that loops that bound a disk in the solid run along the first side.
//! 2. Classes of maps and translations are compared on coarse meshes, the best of them after optimisation ([`search`]).
//! 3. The best layout of the domain is refined, and at every level optimised for low distortion of the map from surface to
//!    surface ([`energy`], [`sweep`](crate::boundary_map::sweep)). Another class that is nearly as good is refined as far as
//!    [`RIVAL_VERTICES`], where the better one is taken.
//!
//! No step inverts a triangle in the plane.

pub(super) mod energy;
mod fitting;
pub(super) mod search;

pub use fitting::{FittingTorus, fitting_torus};
use rayon::prelude::*;

use super::{
    LoopError, PairAlternative, PairError, PairMapping, PairMaps, PairMethod, PairPhase, PairReport, PairStartKind,
    PairTimings, Stretch, TorusReport, distortion, is_lower,
};
use crate::boundary_map::sweep::TargetTorus;
use crate::boundary_map::{BoundaryMap, SurfaceDistortion};
use crate::toroidal::{PartialLayout, Shift, ToroidalEmbedding, ToroidalError, TorusSurface};
use search::{
    COARSE_SOFTNESS, Candidate, Classes, Effort, FINE_SOFTNESS, Rating, Stage, candidates, compared_energy, optimise,
    sort,
};

/// Vertices of the domain when classes are compared, and when the best are compared again.
const SEARCH_VERTICES: usize = 300;
const COMPARED_VERTICES: usize = 600;
/// Candidates are compared again when their energy is at most this times the least, and this many.
const AS_GOOD_COARSE: f64 = 1.25;
const MOST_COMPARED: usize = 3;
/// Maps the other way are sought, too, when the least energy is above this.
const HARD: f64 = 2.0;
/// The best map of another class is compared once more when its energy is at most this times the least, with this many vertices.
const AS_GOOD_COMPARED: f64 = 1.15;
const RIVAL_VERTICES: usize = 2400;
/// Rounds at the end, and the relative decrease of the energy below which one is the last.
const LAST_ROUNDS: usize = 6;
const LEAST_DECREASE: f64 = 3e-3;
/// A warning says that another class is as good when its energy is at most this times that of the one that was taken.
const AS_GOOD: f64 = 1.03;

/// The effort at a level with this many vertices.
fn effort(vertices: usize) -> Effort {
    match vertices {
        ..1500 => Effort {
            cuts: 3,
            softness: COARSE_SOFTNESS,
            new_sweeps: 2,
            sweeps: 4,
            newton: 4,
        },
        1500..6000 => Effort {
            cuts: 2,
            softness: FINE_SOFTNESS,
            new_sweeps: 2,
            sweeps: 2,
            newton: 2,
        },
        _ => Effort {
            cuts: 1,
            softness: FINE_SOFTNESS,
            new_sweeps: 2,
            sweeps: 2,
            newton: 1,
        },
    }
}

/// A search for maps of one surface to another.
struct Search<'a> {
    domain: &'a Laid,
    target: &'a TargetTorus,
    classes: Classes,
    /// Whether it is from the pair's target to its domain.
    is_reversed: bool,
}

/// A surface with its own embedding.
struct Laid {
    torus: TorusSurface,
    coarse: PartialLayout,
    fine: PartialLayout,
    embedding: ToroidalEmbedding,
}

impl Laid {
    fn new(surface: &crate::mesh::SurfaceMesh) -> Result<Self, ToroidalError> {
        let torus = TorusSurface::new(surface)?;
        let (coarse, fine) = torus.layouts(SEARCH_VERTICES)?;
        let embedding = torus.embedded(&fine)?;
        torus.require_unknotted(&embedding)?;
        Ok(Self {
            torus,
            coarse,
            fine,
            embedding,
        })
    }
}

/// The map of the best class that a search found, measured.
struct MadeMap {
    /// The best of each class, the best class first.
    classes: Vec<Candidate>,
    map: BoundaryMap,
    /// Before and after optimisation.
    distortions: [SurfaceDistortion; 2],
    stretch: Stretch,
}

impl PairMapping<'_> {
    /// The map through a flat torus.
    pub(super) fn by_tori(&self) -> Result<PairMaps, PairError> {
        self.report(PairPhase::Tori)?;
        let (domain, target) = rayon::join(|| Laid::new(self.domain), || Laid::new(self.target));
        let of_side = |side| move |error| PairError::Torus { side, error };
        let (domain, target) = (domain.map_err(of_side("domain"))?, target.map_err(of_side("target"))?);
        let laid = self.elapsed();

        let onto_target = TargetTorus::new(&target.embedding, target.fine.periods);
        let there = Search {
            domain: &domain,
            target: &onto_target,
            classes: self.classes([&domain.torus, &target.torus])?,
            is_reversed: false,
        };
        let ranked = self.searched(&there)?;
        // Maps are as good as their inverses, and coarse triangles see more of a plain surface between their samples than of one
        // with thin walls.
        let onto_domain = TargetTorus::new(&domain.embedding, domain.fine.periods);
        let back = Search {
            domain: &target,
            target: &onto_domain,
            classes: there.classes.inverted(),
            is_reversed: true,
        };
        let least = |ranked: &[Candidate]| ranked.first().map_or(f64::INFINITY, Candidate::energy);
        let reversed = match least(&ranked) > HARD {
            true => Some(self.searched(&back)?),
            false => None,
        };
        let compared = self.elapsed();
        let is_back_better = reversed.as_ref().is_some_and(|others| least(others) < least(&ranked));
        let (mut search, ranked, other, other_ranked) = match (is_back_better, reversed) {
            (true, Some(reversed)) => (&back, reversed, &there, Some(ranked)),
            (_, reversed) => (&there, ranked, &back, reversed),
        };
        let mut found = self.made_by(search, ranked)?;
        let improved = self.elapsed();
        let mut searched_again = 0.0;
        // A small part of the domain that covers much of the target hardly counts in the energy of maps of the domain, and much in that
        // of maps of the target.
        if found.stretch.looks_wrong() && self.options.improve && self.reporter.should_improve() {
            let ranked = match other_ranked {
                Some(ranked) => Ok(ranked),
                None => self.searched(other),
            };
            match ranked.and_then(|ranked| self.made_by(other, ranked)) {
                Ok(again) if again.stretch.worst_share() < found.stretch.worst_share() => {
                    (search, found) = (other, again)
                }
                Err(PairError::Cancelled) => return Err(PairError::Cancelled),
                _ => {}
            }
            searched_again = self.elapsed() - improved;
        }
        let MadeMap {
            classes,
            map,
            distortions,
            stretch,
        } = found;
        let coarse_embeddings = classes.len();
        let (best, others) = classes.split_first().ok_or(PairError::NoEmbedding)?;
        let through = |layout: &PartialLayout| self.through_torus(search, layout);

        let mut warnings = Vec::new();
        let runner_up = others.first().map(|other| other.energy_ratio(best));
        if runner_up.is_some_and(|ratio| ratio <= AS_GOOD) {
            warnings.push(format!(
                "another class of maps is nearly as good (its energy was {:.3} times this one's), as of symmetric bodies and \
                 of thin handles that may be twisted: look at the alternatives if this map is not the one that you want",
                runner_up.unwrap_or_default()
            ));
        }
        let diagonal = search.target.diagonal();
        let mut alternatives = Vec::new();
        for other in others.iter().take(self.options.alternatives) {
            alternatives.push(through(&self.completed_on_torus(search, other)?)?);
        }
        let report = PairReport {
            coarse_embeddings,
            alternatives: others
                .iter()
                .map(|other| PairAlternative {
                    shell: None,
                    kind: PairStartKind::Class,
                    energy_ratio: other.energy_ratio(best),
                    isometry_defect: None,
                    distance: distance(other, best, search.target) / diagonal,
                })
                .collect(),
            torus: Some(TorusReport {
                compared: search.classes.compared_at_first(),
                is_turned: best.layout.map.is_turned,
                twist: if search.is_reversed {
                    -best.layout.map.twist
                } else {
                    best.layout.map.twist
                },
                runner_up,
            }),
            timings: PairTimings {
                sphere: laid,
                align: 0.0,
                coarse: compared - laid,
                improve: improved - compared,
                reversed: searched_again,
                total: self.elapsed(),
            },
            is_reversed: search.is_reversed,
            concluded: self.reporter.should_conclude(),
            warnings,
            ..PairReport::of(PairMethod::FlatTori, distortions, stretch)
        };
        Ok(PairMaps {
            map,
            report,
            alternatives,
        })
    }

    /// The map of the best class that a search found.
    fn made_by(&self, search: &Search, ranked: Vec<Candidate>) -> Result<MadeMap, PairError> {
        // The best of each class.
        let mut classes: Vec<Candidate> = Vec::new();
        for candidate in ranked {
            if classes.iter().all(|kept| kept.layout.map != candidate.layout.map) {
                classes.push(candidate);
            }
        }
        if self.options.improve {
            self.compare_rivals(search, &mut classes);
        }
        let best = classes.first().ok_or(PairError::NoEmbedding)?;
        let before = search
            .domain
            .fine
            .mapped(&search.target.periods, best.layout.map, best.by);
        let after = match self.options.improve {
            true => self.completed_on_torus(search, best)?,
            false => before.clone(),
        };
        let through = |layout: &PartialLayout| self.through_torus(search, layout);
        let (map, distortions, stretch) = self.measured_on_torus(through, &before, &after)?;
        Ok(MadeMap {
            classes,
            map,
            distortions,
            stretch,
        })
    }

    /// The classes of maps that the loops allow.
    fn classes(&self, tori: [&TorusSurface; 2]) -> Result<Classes, PairError> {
        let domain = tori[0].turns(self.loops.iter().map(|pair| &pair.domain[..]));
        let target = tori[1].turns(self.loops.iter().map(|pair| &pair.target[..]));
        for (index, (from, to)) in domain.iter().zip(&target).enumerate() {
            for (side, turns) in [("domain", from), ("target", to)] {
                if *turns == [0; 2] {
                    return Err(LoopError::NoHandle { index, side }.into());
                }
            }
            // Loops that bound in the solid run along the first side of the square.
            match [from, to].map(|turns| turns[1] == 0) {
                [true, false] => return Err(LoopError::Bounds { index, side: "domain" }.into()),
                [false, true] => return Err(LoopError::Bounds { index, side: "target" }.into()),
                _ => {}
            }
        }
        let classes = Classes::new(domain.into_iter().zip(target).map(<[Shift; 2]>::from).collect());
        match classes.all().is_empty() {
            true => Err(LoopError::Contradiction.into()),
            false => Ok(classes),
        }
    }

    /// The candidates of a search, the best of them refined and compared again.
    fn searched(&self, search: &Search) -> Result<Vec<Candidate>, PairError> {
        if search.is_reversed {
            self.report(PairPhase::Reversed)?;
        }
        self.report(PairPhase::CoarseEmbeddings {
            vertices: search.domain.coarse.inserted.len(),
            done: 0,
            of: search.classes.compared_at_first(),
        })?;
        let rating = if self.options.aligned {
            Rating::Distance
        } else {
            Rating::Energy
        };
        let Search {
            domain,
            target,
            classes,
            ..
        } = search;
        let mut ranked = candidates(
            &domain.coarse,
            target,
            domain.torus.surface().vertices(),
            rating,
            classes,
        );
        let Some(most) = ranked.first().map(|best| AS_GOOD_COARSE * best.energy()) else {
            return Ok(ranked);
        };
        let again = ranked.iter().take(MOST_COMPARED).filter(|c| c.energy() <= most).count();
        let points = domain.torus.surface().vertices();
        let refine = |candidate: &mut Candidate| {
            let refined = candidate.layout.refine(&domain.torus, COMPARED_VERTICES, |layout| {
                optimise(layout, target, points, &effort(layout.inserted.len()));
            });
            let energy = match refined {
                Some(()) => compared_energy(&candidate.layout, target, points),
                None => f64::INFINITY,
            };
            candidate.set_energy(Stage::Compared, energy);
        };
        ranked[..again].par_iter_mut().for_each(refine);
        sort(&mut ranked[..again]);
        self.report(PairPhase::Refining {
            vertices: ranked[0].layout.inserted.len(),
            total: points.len(),
            energy: super::ISOMETRY_ENERGY * ranked[0].energy(),
        })?;
        Ok(ranked)
    }

    /// Refines the best of each class further if the second is nearly as good. The better one comes first.
    fn compare_rivals(&self, search: &Search, classes: &mut [Candidate]) {
        let [best, other, ..] = &*classes else {
            return;
        };
        if !self.reporter.should_improve() || other.energy_ratio(best) > AS_GOOD_COMPARED {
            return;
        }
        let points = search.domain.torus.surface().vertices();
        let refine = |candidate: &mut Candidate| {
            // One that is too fine loses.
            let energy = match self.refined_on_torus(search, &mut candidate.layout, RIVAL_VERTICES) {
                Ok(()) => compared_energy(&candidate.layout, search.target, points),
                Err(_) => f64::INFINITY,
            };
            candidate.set_energy(Stage::Refined, energy);
        };
        classes[..2].par_iter_mut().for_each(refine);
        if classes[1].energy() < classes[0].energy() {
            classes.swap(0, 1);
        }
    }

    /// Inserts vertices until there are `enough`, and lowers the distortion at every level.
    fn refined_on_torus(&self, search: &Search, layout: &mut PartialLayout, enough: usize) -> Result<(), PairError> {
        let points = search.domain.torus.surface().vertices();
        let refined = layout.refine(&search.domain.torus, enough, |layout| {
            let vertices = layout.inserted.len();
            if self.reporter.should_improve() {
                let energy = optimise(layout, search.target, points, &effort(vertices));
                // A cancellation takes effect at the next level.
                let _ = self.report(PairPhase::Refining {
                    vertices,
                    total: points.len(),
                    energy: super::ISOMETRY_ENERGY * energy / crate::toroidal::TORUS_AREA,
                });
            }
        });
        refined.ok_or(PairError::Torus {
            side: "domain",
            error: ToroidalError::TooFine,
        })
    }

    /// A candidate with the rest of the vertices, and its distortion lowered.
    fn completed_on_torus(&self, search: &Search, coarse: &Candidate) -> Result<PartialLayout, PairError> {
        let points = search.domain.torus.surface().vertices();
        let mut layout = coarse.layout.clone();
        self.refined_on_torus(search, &mut layout, usize::MAX)?;
        let last = Effort {
            new_sweeps: 0,
            sweeps: 2,
            newton: 3,
            cuts: if points.len() > 12_000 { 1 } else { 2 },
            softness: FINE_SOFTNESS,
        };
        let mut energy = f64::INFINITY;
        for round in 0..LAST_ROUNDS {
            if !self.reporter.should_improve() {
                break;
            }
            self.report(PairPhase::Improving {
                rounds: round,
                most_rounds: LAST_ROUNDS,
            })?;
            let lowered = optimise(&mut layout, search.target, points, &last);
            if lowered > (1.0 - LEAST_DECREASE) * energy {
                break;
            }
            energy = lowered;
        }
        Ok(layout)
    }

    /// The map of a layout of all vertices, turned round if the target was laid out on the domain's torus.
    fn through_torus(&self, search: &Search, layout: &PartialLayout) -> Result<BoundaryMap, PairError> {
        let side = if search.is_reversed { "target" } else { "domain" };
        let embedding = search.domain.torus.embedded(layout);
        let embedding = embedding.map_err(|error| PairError::Torus { side, error })?;
        let onto = search.target.embedding.clone();
        Ok(match search.is_reversed {
            true => BoundaryMap::through_torus(onto, embedding)?,
            false => BoundaryMap::through_torus(embedding, onto)?,
        })
    }

    /// The better one of the maps before and after optimisation, with the distortion of both, and how far it stretches.
    fn measured_on_torus(
        &self,
        through: impl Fn(&PartialLayout) -> Result<BoundaryMap, PairError>,
        before: &PartialLayout,
        after: &PartialLayout,
    ) -> Result<(BoundaryMap, [SurfaceDistortion; 2], Stretch), PairError> {
        self.report(PairPhase::Measuring { done: 0, of: 2 })?;
        let no_area = || PairError::from(super::AlignError::NoArea { side: "domain" });
        let last = through(after)?;
        let of_last = distortion(&last).ok_or_else(no_area)?;
        self.report(PairPhase::Measuring { done: 1, of: 2 })?;
        // Without optimisation, thin triangles may be too fine under a twist.
        let first = through(before).ok();
        let of_first = first.as_ref().and_then(distortion);
        let (map, distortions) = match first.zip(of_first) {
            Some((first, of_first)) if !is_lower(&of_last, &of_first) => (first, [of_first; 2]),
            _ => (last, [of_first.unwrap_or(of_last), of_last]),
        };
        let stretch = Stretch::of(&map, self.options.most_stretched).ok_or_else(no_area)?;
        Ok((map, distortions, stretch))
    }
}

/// The mean distance of the images of the vertices that both have.
fn distance(a: &Candidate, b: &Candidate, target: &TargetTorus) -> f64 {
    let count = a.layout.inserted.len().min(b.layout.inserted.len());
    let shared = &a.layout.inserted[..count];
    let of_vertex = |&v: &u32| {
        let [a, b] = [a, b].map(|c| target.position(&c.layout.places[v as usize]));
        (a - b).norm()
    };
    shared.iter().map(of_vertex).sum::<f64>() / count.max(1) as f64
}

/// What does not apply to solids with handles: refused by name.
pub(super) fn require_options(options: &super::PairOptions, genus: u64) -> Result<(), PairError> {
    let given = [
        (!options.landmarks.pairs().is_empty(), "landmarks"),
        (!options.curves.is_empty(), "landmark curves"),
        (genus == 1 && options.up.is_some(), "directions that point up"),
        (options.start.is_some(), "a map to start from"),
        (options.method == PairMethod::Conformal, "conformal maps to the sphere"),
    ];
    match given.into_iter().find(|(is_given, _)| *is_given) {
        Some((_, option)) => Err(PairError::NotWithHandles { option, genus }),
        None => Ok(()),
    }
}
