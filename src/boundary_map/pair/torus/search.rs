//! The search for the best map between two tori: which class of maps, and which translation.
//!
//! A map of solids takes the loop that bounds a disk in one to that in the other. So its class is a sign and a twist: how often
//! that loop is added to the one around the handle. Both layouts are near to conformal, so that translations tell most of the
//! rest; but only the energy after optimisation tells classes apart.

use rayon::prelude::*;

use super::energy::TorusEnergy;
use crate::boundary_map::sweep::{Cut, Sweeper, TargetTorus};
use crate::spherical::{Newton, NewtonOptions, Objective};
use crate::toroidal::{LatticeMap, PartialLayout, Shift};
use crate::{Point, Vector};

/// Translations along each side of the square.
const TRANSLATIONS: usize = 12;
/// Twists are tried from minus this.
const MOST_TWIST: i32 = 3;
/// Candidates that are optimised, of each class and of all; and those that are optimised further.
const MOST_OF_CLASS: usize = 3;
const MOST_OPTIMISED: usize = 20;
const MOST_CONTINUED: usize = 6;
/// Starts of one class are this far apart, in steps of translations.
const APART: usize = 2;
/// The most energy of a triangle, over that of an isometry, when maps are compared: a few bad triangles would decide otherwise.
const MOST_COMPARED: f64 = 25.0;
/// Softness of the energy where images of triangles are coarse, and where they are fine.
pub(in crate::boundary_map::pair) const COARSE_SOFTNESS: f64 = 0.02;
pub(in crate::boundary_map::pair) const FINE_SOFTNESS: f64 = 1e-3;
/// Parts along a side of a triangle when maps are compared.
const COMPARED_CUTS: usize = 3;

/// A layout of the domain on the target's torus.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub layout: PartialLayout,
    /// The translation that it started with.
    pub by: [f64; 2],
    /// Mean symmetric Dirichlet energy, 1 for an isometry, with the vertices of each [`Stage`] that it came to.
    energies: [Option<f64>; 3],
}

/// When maps are compared.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stage {
    Search,
    Compared,
    Refined,
}

impl Candidate {
    /// With the most vertices.
    pub fn energy(&self) -> f64 {
        self.energies
            .iter()
            .rev()
            .find_map(|energy| *energy)
            .unwrap_or(f64::INFINITY)
    }

    pub fn set_energy(&mut self, stage: Stage, energy: f64) {
        self.energies[stage as usize] = Some(energy);
    }

    /// Its energy over the other's, at the last stage that both came to.
    pub fn energy_ratio(&self, other: &Self) -> f64 {
        let pairs = self.energies.iter().zip(&other.energies);
        let mut ratios = pairs.rev().filter_map(|(own, other)| Some((*own)? / (*other)?));
        ratios.next().unwrap_or(f64::INFINITY)
    }
}

/// How much a layout is optimised.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Parts along a side of a triangle.
    pub cuts: usize,
    pub softness: f64,
    /// Rounds of sweeps over the vertices of the last level, and over all.
    pub new_sweeps: usize,
    pub sweeps: usize,
    /// Iterations of Newton's method after them.
    pub newton: usize,
}

const FIRST: Effort = Effort {
    cuts: 2,
    softness: COARSE_SOFTNESS,
    new_sweeps: 0,
    sweeps: 10,
    newton: 5,
};
const SECOND: Effort = Effort {
    cuts: 2,
    softness: COARSE_SOFTNESS,
    new_sweeps: 0,
    sweeps: 10,
    newton: 8,
};

/// Lowers the energy of a layout; returns it.
pub(super) fn optimise(layout: &mut PartialLayout, target: &TargetTorus, points: &[Point], effort: &Effort) -> f64 {
    let sweeper = Sweeper::new(target, layout, points, effort.cuts, effort.softness);
    (0..effort.new_sweeps).for_each(|_| sweeper.sweep(layout, layout.level_start));
    (0..effort.sweeps).for_each(|_| sweeper.sweep(layout, 0));
    let energy = TorusEnergy::new(target, layout, points, Cut::new(effort.cuts), effort.softness);
    if effort.newton == 0 {
        return energy.value(&layout.places);
    }
    let options = NewtonOptions {
        most_iterations: effort.newton,
        tolerance: 1e-4,
    };
    // Where it does not fit into memory, sweeps alone have to do.
    let found = Newton::new(energy.triangles(), &[])
        .and_then(|mut newton| newton.minimise(&energy, &mut layout.places, &options, &|| true));
    found.map_or_else(|_| energy.value(&layout.places), |report| report.energy_after)
}

/// The energy by which maps are compared.
pub(super) fn compared_energy(layout: &PartialLayout, target: &TargetTorus, points: &[Point]) -> f64 {
    let energy = TorusEnergy::new(target, layout, points, Cut::new(COMPARED_CUTS), FINE_SOFTNESS);
    energy.mean(&layout.places, MOST_COMPARED)
}

/// The classes that may be taken: those that take given loops to their partners.
#[derive(Debug, Clone)]
pub(super) struct Classes {
    /// By how many periods a loop goes round the domain's torus, and its partner round the target's.
    loops: Vec<[Shift; 2]>,
}

impl Classes {
    pub fn new(loops: Vec<[Shift; 2]>) -> Self {
        Self { loops }
    }

    /// Those of maps the other way.
    pub fn inverted(&self) -> Self {
        Self::new(self.loops.iter().map(|&[from, to]| [to, from]).collect())
    }

    fn allow(&self, map: LatticeMap) -> bool {
        self.loops.iter().all(|&[from, to]| map.apply(from) == to)
    }

    /// Those to be compared.
    pub fn all(&self) -> Vec<LatticeMap> {
        // A loop along the handle leaves one twist for each sign.
        let along = self.loops.iter().find(|[from, _]| from[1] != 0);
        let twists = |sign: i32| match along {
            Some(&[[i, j], [k, _]]) => {
                let twist = (sign * k).checked_sub(i).filter(|by| by % j == 0);
                twist.map(|by| by / j).into_iter().collect::<Vec<i32>>()
            }
            None => (-MOST_TWIST..=MOST_TWIST).collect(),
        };
        let of_sign = |is_turned: bool| {
            let maps = twists(if is_turned { -1 } else { 1 }).into_iter();
            maps.map(move |twist| LatticeMap { is_turned, twist })
        };
        let both = [false, true].into_iter().flat_map(of_sign);
        let mut allowed: Vec<LatticeMap> = both.filter(|map| self.allow(*map)).collect();
        allowed.sort_by_key(|map| map.twist);
        allowed
    }

    /// Number of maps whose energies are compared before any is optimised.
    pub fn compared_at_first(&self) -> usize {
        self.all().len() * TRANSLATIONS * TRANSLATIONS
    }
}

/// What classes and translations are rated by before any map is optimised.
#[derive(Debug, Clone, Copy)]
pub(super) enum Rating {
    Energy,
    /// The mean distance of vertices from their images, for solids in the same place.
    Distance,
}

/// The best candidates, each of another class or from another translation, best first.
pub(super) fn candidates(
    coarse: &PartialLayout,
    target: &TargetTorus,
    points: &[Point],
    rating: Rating,
    classes: &Classes,
) -> Vec<Candidate> {
    let starts = starts(coarse, target, points, rating, classes);
    let optimised = |mut layout: PartialLayout, by: [f64; 2], effort: &Effort| {
        optimise(&mut layout, target, points, effort);
        let energy = compared_energy(&layout, target, points);
        let mut candidate = Candidate {
            layout,
            by,
            energies: [None; 3],
        };
        candidate.set_energy(Stage::Search, energy);
        candidate
    };
    let mut first: Vec<Candidate> = starts
        .into_par_iter()
        .map(|(map, by)| optimised(coarse.mapped(&target.periods, map, by), by, &FIRST))
        .collect();
    sort(&mut first);
    first.truncate(MOST_CONTINUED);
    let further = |c: Candidate| optimised(c.layout, c.by, &SECOND);
    let mut ranked: Vec<Candidate> = first.into_par_iter().map(further).collect();
    sort(&mut ranked);
    let is_open = classes.all().len() > 1;
    // Twists of the best one, as long as they are better.
    while is_open && let Some(best) = ranked.first().cloned() {
        let tried = |twist: i32| {
            let map = LatticeMap {
                is_turned: false,
                twist,
            };
            let layout = best.layout.mapped(&target.periods, map, [0.0; 2]);
            further(optimised(layout, best.by, &FIRST))
        };
        let is_known = |c: &Candidate| {
            ranked
                .iter()
                .any(|r| r.layout.map == c.layout.map && r.energy() <= c.energy())
        };
        let twisted: Vec<Candidate> = [-1, 1].into_par_iter().map(tried).collect();
        let twisted: Vec<Candidate> = twisted.into_iter().filter(|c| classes.allow(c.layout.map)).collect();
        let is_better = twisted.iter().any(|c| c.energy() < best.energy());
        let new: Vec<Candidate> = twisted.into_iter().filter(|c| !is_known(c)).collect();
        ranked.extend(new);
        sort(&mut ranked);
        if !is_better {
            break;
        }
    }
    ranked
}

pub(super) fn sort(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| a.energy().total_cmp(&b.energy()));
}

/// Classes and translations of the least ratings.
fn starts(
    coarse: &PartialLayout,
    target: &TargetTorus,
    points: &[Point],
    rating: Rating,
    classes: &Classes,
) -> Vec<(LatticeMap, [f64; 2])> {
    let of_class = |map: LatticeMap| {
        let layout = coarse.mapped(&target.periods, map, [0.0; 2]);
        let energy = TorusEnergy::new(target, &layout, points, Cut::new(1), COARSE_SOFTNESS);
        let mut places = layout.places.clone();
        let of_step = move |step: usize| {
            let steps = [step / TRANSLATIONS, step % TRANSLATIONS];
            let translation = target.periods.place(translation(steps)) - Vector::z();
            for &v in &layout.inserted {
                places[v as usize] = layout.places[v as usize] + translation;
            }
            let rated = match rating {
                Rating::Distance => mean_distance(&layout.inserted, &places, target, points),
                Rating::Energy => energy.mean(&places, MOST_COMPARED),
            };
            (rated, map, steps)
        };
        (0..TRANSLATIONS * TRANSLATIONS).map(of_step).collect::<Vec<_>>()
    };
    let mut all: Vec<(f64, LatticeMap, [usize; 2])> = classes.all().into_par_iter().flat_map_iter(of_class).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept: Vec<(LatticeMap, [usize; 2])> = Vec::new();
    for (_, map, steps) in all {
        if kept.len() == MOST_OPTIMISED {
            break;
        }
        let alike = kept.iter().filter(|other| other.0 == map);
        let is_near = |other: &[usize; 2]| {
            let apart = |axis: usize| {
                let by = steps[axis].abs_diff(other[axis]);
                by.min(TRANSLATIONS - by)
            };
            apart(0).max(apart(1)) < APART
        };
        if alike.clone().count() < MOST_OF_CLASS && !alike.clone().any(|other| is_near(&other.1)) {
            kept.push((map, steps));
        }
    }
    kept.into_iter().map(|(map, steps)| (map, translation(steps))).collect()
}

fn translation(steps: [usize; 2]) -> [f64; 2] {
    steps.map(|count| count as f64 / TRANSLATIONS as f64)
}

/// The mean distance of these vertices from their images.
fn mean_distance(vertices: &[u32], places: &[Vector], target: &TargetTorus, points: &[Point]) -> f64 {
    let distance = |&v: &u32| (target.position(&places[v as usize]) - points[v as usize]).norm();
    vertices.iter().map(distance).sum::<f64>() / vertices.len() as f64
}
