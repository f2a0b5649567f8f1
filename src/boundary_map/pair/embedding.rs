//! Draws the domain on the target's sphere, towards wanted places, and makes the map to the target distort less.
//!
//! Coarse to fine, as Schmidt, Pieper, Kobbelt, *Surface maps via adaptive triangulations*, 2023: on a coarse level far
//! moves are cheap, and every level starts from the solution of a coarser one.

use rayon::prelude::*;

use super::lift::{Lift, Lifted, LiftedEnergy};
use crate::Vector;
use crate::mesh::SurfaceMesh;
use crate::spherical::{Drawing, Hierarchy, Newton, NewtonError, NewtonOptions, Relaxation, RestShapes, Weights};

/// Where vertices of the domain are wanted on the target's sphere.
pub(crate) struct Guide {
    /// A direction per vertex, and how much it is to be trusted, from 0 to 1.
    pub wanted: Vec<Option<(Vector, f64)>>,
}

/// How a drawing is led towards its guide before distortion decides.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Schedule {
    /// Strength of the springs to the wanted places: the energy of springs of length 1, over that of undistorted triangles.
    pub pull: f64,
    /// Number of vertices up to which the springs pull.
    pub until: usize,
}

/// When to stop taking turns.
struct Turns {
    most: usize,
    /// Fall of the energy in a turn, as a fraction, below which there is no other.
    gain: f64,
}

/// Vertices that must stand at given directions.
pub(crate) struct Pins {
    pairs: Vec<(u32, Vector)>,
    /// The pin of each vertex, [`NO_PIN`] for most.
    of_vertex: Vec<u32>,
}

const NO_PIN: u32 = u32::MAX;

/// A drawing and what is known of it.
#[derive(Clone)]
pub(crate) struct Sketch {
    pub drawing: Drawing,
    /// Which of the pins are reached.
    pub pinned: Vec<bool>,
    /// Mean symmetric Dirichlet energy of the map to the target, 1 of an isometry.
    pub energy: f64,
}

/// Draws a domain on the sphere of a target.
pub(crate) struct Embedding<'a> {
    domain: &'a SurfaceMesh,
    hierarchy: &'a Hierarchy,
    lift: &'a Lift<'a>,
    pins: Pins,
    /// Asked again and again; once the answer is no, what comes out is of no use.
    goes_on: &'a (dyn Fn() -> bool + Sync),
}

/// Rounds of relaxation towards the guide on each level.
const GUIDED_SWEEPS: usize = 20;
/// Weights of angles and areas against the springs.
const GUIDED: Weights = Weights { angle: 0.1, area: 0.1 };
/// Rounds for the vertices that a level brought, and for all.
const NEW_SWEEPS: usize = 10;
const SWEEPS: usize = 4;
/// Triangles with more energy than this, in units of an isometry's, are seen to until there are none, or this often.
const DISTORTED: f64 = 8.0;
const MOST_REPAIRS: usize = 10;
/// Newton's method and rounds of relaxation take turns: the one moves all together but no farther than the first triangle
/// allows; the other frees such triangles.
const NEWTON_STEPS: usize = 5;
/// While drawings are chosen and refined, and at the end, where the minimum is to be met so well that it does not tell how
/// the solids lay.
const COARSE: Turns = Turns { most: 3, gain: 1e-3 };
const LAST: Turns = Turns { most: 30, gain: 1e-5 };
/// Drawings of each guide that go on to the next size, and energy over the best at which they do not.
const KEPT: usize = 3;
const HOPELESS: f64 = 1.4;
/// Rounds of dragging pins over a drawing that is whole.
const MOST_DRAGS: usize = 40;
/// Spring of a pin that is not reached, over that of a wanted place.
const PIN: f64 = 30.0;

impl Pins {
    /// Pins of vertices below `vertices`, no two of the same.
    pub fn new(pairs: Vec<(u32, Vector)>, vertices: usize) -> Self {
        let mut of_vertex = vec![NO_PIN; vertices];
        for (i, pair) in pairs.iter().enumerate() {
            of_vertex[pair.0 as usize] = i as u32;
        }
        Self { pairs, of_vertex }
    }

    fn of(&self, vertex: u32) -> Option<usize> {
        let pin = self.of_vertex[vertex as usize];
        (pin != NO_PIN).then_some(pin as usize)
    }
}

impl<'a> Embedding<'a> {
    pub fn new(
        domain: &'a SurfaceMesh,
        hierarchy: &'a Hierarchy,
        lift: &'a Lift<'a>,
        pins: Pins,
        goes_on: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        Self {
            domain,
            hierarchy,
            lift,
            pins,
            goes_on,
        }
    }

    /// A drawing with at least `enough` vertices. `None` when rounding leaves no place for one.
    pub fn sketch(&self, guide: &Guide, schedule: &Schedule, enough: usize) -> Option<Sketch> {
        let wanted = |v: u32| match self.pins.of(v) {
            Some(i) => Some(self.pins.pairs[i].1),
            None => guide.wanted[v as usize].map(|wanted| wanted.0),
        };
        let sketch = Sketch {
            drawing: Drawing::of_base(self.hierarchy, wanted),
            pinned: vec![false; self.pins.pairs.len()],
            energy: f64::INFINITY,
        };
        self.refine(sketch, guide, schedule, enough, &|_, _| ())
    }

    /// A drawing of all vertices that only its guide leads.
    pub fn guided(&self, guide: &Guide, schedule: &Schedule) -> Option<Sketch> {
        let led = Schedule {
            until: usize::MAX,
            ..*schedule
        };
        self.sketch(guide, &led, usize::MAX)
    }

    /// The drawing with at least `enough` vertices. `progress` gets the number of vertices and the energy of each level.
    pub fn refine(
        &self,
        mut sketch: Sketch,
        guide: &Guide,
        schedule: &Schedule,
        enough: usize,
        progress: &dyn Fn(usize, f64),
    ) -> Option<Sketch> {
        let Sketch {
            drawing,
            pinned,
            energy,
        } = &mut sketch;
        let mut lifted = Lifted::new(self.lift, self.domain);
        drawing.refine(self.hierarchy, enough, |drawing| {
            if !(self.goes_on)() {
                return;
            }
            let is_guided = drawing.there.len() < schedule.until;
            if is_guided || !pinned.iter().all(|&is| is) {
                self.guide(drawing, pinned, guide, schedule);
            }
            if !is_guided {
                lifted.locate(drawing);
                *energy = self.improve(drawing, &mut lifted, pinned, &COARSE);
                progress(drawing.there.len(), *energy);
            }
        })?;
        Some(sketch)
    }

    /// A drawing of all vertices that is not made here; pins are put where they belong as far as triangles allow.
    pub fn sketch_of(&self, directions: &[Vector]) -> Sketch {
        let mut sketch = Sketch {
            drawing: Drawing::of(self.domain, directions),
            pinned: vec![false; self.pins.pairs.len()],
            energy: f64::INFINITY,
        };
        let nowhere = Guide {
            wanted: vec![None; directions.len()],
        };
        let springs = Schedule { pull: 1.0, until: 0 };
        self.drag(&mut sketch.drawing, &mut sketch.pinned);
        for _ in 0..MOST_DRAGS {
            if sketch.pinned.iter().all(|&is| is) || !(self.goes_on)() {
                break;
            }
            self.guide(&mut sketch.drawing, &mut sketch.pinned, &nowhere, &springs);
        }
        sketch
    }

    /// The energy of a drawing of all vertices.
    pub fn energy_of(&self, drawing: &Drawing) -> f64 {
        let mut lifted = Lifted::new(self.lift, self.domain);
        lifted.locate(drawing);
        lifted.find_hidden(drawing);
        lifted.energy(drawing)
    }

    /// The finest drawing, improved until there is little to gain.
    pub fn finish(&self, sketch: &mut Sketch) {
        let mut lifted = Lifted::new(self.lift, self.domain);
        lifted.locate(&sketch.drawing);
        sketch.energy = self.improve(&mut sketch.drawing, &mut lifted, &sketch.pinned, &LAST);
    }

    /// Pins that are not reached, by their number.
    pub fn missed(&self, sketch: &Sketch) -> Vec<usize> {
        (0..sketch.pinned.len()).filter(|&i| !sketch.pinned[i]).collect()
    }

    /// Relaxation with springs to the wanted places.
    fn guide(&self, drawing: &mut Drawing, pinned: &mut [bool], guide: &Guide, schedule: &Schedule) {
        let spring = schedule.pull * 4.0 * std::f64::consts::PI / drawing.there.len() as f64;
        for _ in 0..GUIDED_SWEEPS / 4 {
            self.drag(drawing, pinned);
            let pull = |v: u32| match self.pins.of(v) {
                Some(i) => Some((self.pins.pairs[i].1, PIN * spring.max(0.1))),
                None => guide.wanted[v as usize].map(|(to, trust)| (to, trust * spring)),
            };
            let is_fixed = |v: u32| self.pins.of(v).is_some_and(|i| pinned[i]);
            let relaxation = Relaxation {
                points: self.domain.vertices(),
                weights: GUIDED,
                pull: &pull,
                is_fixed: &is_fixed,
            };
            if (self.goes_on)() {
                relaxation.run(drawing, 4);
            }
        }
        self.drag(drawing, pinned);
    }

    /// Puts pins where they belong, as soon as all their triangles stay positive.
    fn drag(&self, drawing: &mut Drawing, pinned: &mut [bool]) {
        for (i, &(v, to)) in self.pins.pairs.iter().enumerate() {
            let is_there = !drawing.neighbours.of(v).is_empty();
            if is_there && !pinned[i] && drawing.fits(v, &to) {
                drawing.directions[v as usize] = to;
                pinned[i] = true;
            }
        }
    }

    /// Lowers the distortion of the map to the target; returns its energy.
    fn improve(&self, drawing: &mut Drawing, lifted: &mut Lifted, pinned: &[bool], turns: &Turns) -> f64 {
        let is_fixed = |v: u32| self.pins.of(v).is_some_and(|i| pinned[i]);
        let there = drawing.there.clone();
        let arrived = &there[drawing.arrived..];
        lifted.find_hidden(drawing);
        for _ in 0..NEW_SWEEPS {
            lifted.sweep(drawing, arrived, &is_fixed);
        }
        for _ in 0..SWEEPS {
            lifted.sweep(drawing, &there, &is_fixed);
        }
        let fixed: Vec<u32> = there.iter().copied().filter(|&v| is_fixed(v)).collect();
        let triangles = drawing.neighbours.triangles();
        let shapes = RestShapes::new(&triangles, self.domain.vertices());
        let mut newton = Newton::new(&triangles, &fixed).ok();
        for turn in 0..turns.most {
            if !(self.goes_on)() {
                break;
            }
            // Looked for again only where there was some to see: it takes as long as a step.
            if turn > 0 && lifted.hides() {
                lifted.find_hidden(drawing);
            }
            let before = lifted.energy(drawing);
            self.repair(drawing, lifted, &is_fixed);
            let stepped = newton
                .as_mut()
                .map(|newton| self.step(newton, drawing, lifted, &shapes));
            if stepped.is_some_and(|result| result.is_err()) {
                newton = None;
            }
            lifted.sweep(drawing, &there, &is_fixed);
            if lifted.energy(drawing) > (1.0 - turns.gain) * before {
                break;
            }
        }
        if lifted.hides() {
            lifted.find_hidden(drawing);
        }
        lifted.energy(drawing)
    }

    fn step(
        &self,
        newton: &mut Newton,
        drawing: &mut Drawing,
        lifted: &mut Lifted,
        shapes: &RestShapes,
    ) -> Result<(), NewtonError> {
        let energy = LiftedEnergy::new(lifted, shapes);
        let options = NewtonOptions {
            most_iterations: NEWTON_STEPS,
            tolerance: 1e-4,
        };
        newton.minimise(&energy, &mut drawing.directions, &options, self.goes_on)?;
        lifted.locate(drawing);
        Ok(())
    }

    fn repair(&self, drawing: &mut Drawing, lifted: &mut Lifted, is_fixed: &dyn Fn(u32) -> bool) {
        for _ in 0..MOST_REPAIRS {
            let distorted = lifted.distorted(drawing, DISTORTED);
            if distorted.is_empty() {
                break;
            }
            for _ in 0..3 {
                lifted.sweep(drawing, &distorted, is_fixed);
            }
        }
    }
}

/// The best of all combinations of guides and schedules: all are drawn coarsely, the better ones of each guide less so.
///
/// Returns the sketch, which guide and schedule it had, and the last energy of each guide's best.
pub(crate) fn best_sketch(
    embedding: &Embedding,
    guides: &[Guide],
    schedules: &[Schedule],
    sizes: &[usize],
) -> Option<(Sketch, [usize; 2], Vec<f64>)> {
    let all = (0..guides.len()).flat_map(|g| (0..schedules.len()).map(move |s| [g, s]));
    let mut choices: Vec<(Option<Sketch>, [usize; 2])> = all.map(|choice| (None, choice)).collect();
    let mut energies = vec![f64::INFINITY; guides.len()];
    for &size in sizes {
        let draw = |(sketch, [g, s]): (Option<Sketch>, [usize; 2])| {
            let (guide, schedule) = (&guides[g], &schedules[s]);
            let drawn = match sketch {
                Some(sketch) => embedding.refine(sketch, guide, schedule, size, &|_, _| ()),
                None => embedding.sketch(guide, schedule, size),
            };
            let mut drawn = drawn?;
            // Small surfaces are whole before distortion has had a say.
            if !drawn.energy.is_finite() {
                embedding.finish(&mut drawn);
            }
            Some((Some(drawn), [g, s]))
        };
        choices = choices.into_par_iter().filter_map(draw).collect();
        choices.sort_by(|a, b| {
            let (a, b) = (rating(&a.0), rating(&b.0));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let best = rating(&choices.first()?.0);
        for (sketch, [g, _]) in choices.iter().rev() {
            energies[*g] = rating(sketch).1;
        }
        let mut kept = vec![0; guides.len()];
        choices.retain(|(sketch, [g, _])| {
            let (missed, energy) = rating(sketch);
            kept[*g] += 1;
            kept[*g] <= KEPT && missed == best.0 && energy <= HOPELESS * best.1
        });
    }
    let (sketch, choice) = choices.into_iter().next()?;
    Some((sketch?, choice, energies))
}

/// Missed pins, of which the fewest are best, and the energy.
fn rating(sketch: &Option<Sketch>) -> (usize, f64) {
    sketch.as_ref().map_or((usize::MAX, f64::INFINITY), |sketch| {
        (sketch.pinned.iter().filter(|&&is| !is).count(), sketch.energy)
    })
}
