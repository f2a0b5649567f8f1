//! Which shell of the target a shell of the domain is mapped to: see [`super`].

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::super::{Alignment, AlignmentSurface, Landmarks, PairError, PairMethod, PairOptions, align};
use super::given::partners;
use super::solid::centre_of;
use super::starts::ShellStarts;
use super::{MovingLeastSquares, Solid};
use crate::Point;
use crate::boundary_map::BoundaryMap;

/// Weight of the square of the logarithm of a ratio of sizes, beside the square of a distance over the target's diagonal.
const SIZE_WEIGHT: f64 = 0.05;

/// A pair of shells to be mapped.
pub(super) struct Waiting {
    pub pair: [usize; 2],
    pub begin: Beginning,
}

/// What is known of the map of a pair of shells.
pub(super) enum Beginning {
    Unknown,
    /// Where the vertices of the domain's are carried by the map of the shell around it, or to the shell that they are to go to.
    Carried(Vec<Point>),
    /// A map to start from.
    Given(BoundaryMap),
}

/// Pairs of shells, and how far they are from each other.
type Matched = (Vec<[usize; 2]>, f64);

/// How the shells of two solids are matched.
pub(super) struct Matching<'a> {
    pub solids: &'a [Solid; 2],
    /// Whether outermost shells are matched where they lie, without an alignment.
    is_aligned: bool,
    /// Whether outermost shells are mapped as they lie, too.
    starts_in_place: bool,
    /// For shells of the domain with landmarks, curves or loops the shell of the target that these are on.
    joined: BTreeMap<usize, usize>,
    /// For shells of the domain that are to go to certain ones, and for those around them, the shell of the target.
    given: BTreeMap<usize, usize>,
    /// A map of all shells to start from.
    starts: Option<ShellStarts>,
}

impl<'a> Matching<'a> {
    pub fn new(solids: &'a [Solid; 2], options: &'a PairOptions) -> Result<Self, PairError> {
        let [domain, target] = solids;
        if domain.shells.len() != target.shells.len() {
            return Err(PairError::UnequalShells {
                domain: domain.shells.len(),
                target: target.shells.len(),
            });
        }
        let counts = [domain, target].map(|side| side.surface.vertices().len());
        let landmarks = options.landmarks.pairs();
        Landmarks::new(landmarks.to_vec(), counts[0], counts[1])?;
        let mut joined = BTreeMap::new();
        for &[v, w] in landmarks {
            let (Some(from), Some(to)) = (domain.shell_of(v), target.shell_of(w)) else {
                return Err(unmatched(format!("no shells have the landmarks {v} and {w}")));
            };
            require_no_handles(domain, from, "landmarks")?;
            join(solids, &mut joined, "landmarks", [from, to])?;
        }
        for (name, all, needs_genus_0, curves) in [
            ("curve", "landmark curves", true, &options.curves),
            ("loop", "loops", false, &options.loops),
        ] {
            for (index, curve) in curves.iter().enumerate() {
                let paths = [(domain, &curve.domain), (target, &curve.target)];
                let [Some(from), Some(to)] = paths.map(|(side, path)| side.shell_of_all(path)) else {
                    return Err(unmatched(format!("{name} {index} is not in one shell of each solid")));
                };
                if needs_genus_0 {
                    require_no_handles(domain, from, all)?;
                }
                join(solids, &mut joined, all, [from, to])?;
            }
        }
        Ok(Self {
            solids,
            is_aligned: options.aligned,
            starts_in_place: options.aligned && options.method != PairMethod::Conformal,
            given: partners(solids, &options.components, &joined)?,
            joined,
            starts: match &options.start {
                Some(start) => Some(ShellStarts::new(start, solids)?),
                None => None,
            },
        })
    }

    pub fn outermost(&self) -> Result<Vec<Waiting>, PairError> {
        let [domain, target] = self.solids;
        let outermost = [&domain.outermost[..], &target.outermost[..]];
        let sizes = [domain.size, target.size];
        if let Some(starts) = &self.starts {
            return self.started(outermost, sizes, starts);
        }
        let centre = |shell: usize| domain.shells[shell].centre;
        let (pairs, _) = if self.is_aligned || domain.outermost.len() == 1 {
            self.matched(outermost, sizes, &centre)?
        } else {
            let alignments = self.alignments()?;
            let tried = alignments
                .iter()
                .map(|found| self.matched(outermost, sizes, &|shell| found.similarity.apply(&centre(shell))));
            let tried: Vec<Matched> = tried.collect::<Result<_, _>>()?;
            let least = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
            least.ok_or_else(|| unmatched("no alignment was found".into()))?
        };
        let displaced = match self.starts_in_place {
            true => self.displaced(&pairs, outermost, sizes, &centre)?,
            false => vec![],
        };
        let waiting = pairs.into_iter().map(|pair| Waiting {
            pair,
            begin: match displaced.contains(&pair) {
                true => Beginning::Carried(self.moved_to_partner(pair, domain.shells[pair[0]].surface.vertices())),
                false => Beginning::Unknown,
            },
        });
        Ok(waiting.collect())
    }

    /// The pairs of shells inside a pair, whose map carries them.
    pub fn inside(&self, [from, to]: [usize; 2], map: &BoundaryMap) -> Result<Vec<Waiting>, PairError> {
        let around = [&self.solids[0].shells[from], &self.solids[1].shells[to]];
        if around[0].inside.is_empty() {
            return Ok(vec![]);
        }
        let inside = around.map(|shell| &shell.inside[..]);
        let sizes = around.map(|shell| shell.size);
        if let Some(starts) = &self.starts {
            return self.started(inside, sizes, starts);
        }
        let carrier = MovingLeastSquares::of(map);
        let place = |shell: usize| carrier.carried(&self.solids[0].shells[shell].centre);
        let (pairs, _) = self.matched(inside, sizes, &place)?;
        let displaced = self.displaced(&pairs, inside, sizes, &place)?;
        let waiting = pairs.into_iter().map(|pair| {
            let vertices = self.solids[0].shells[pair[0]].surface.vertices();
            let carried: Vec<Point> = vertices.par_iter().map(|p| carrier.carried(p)).collect();
            let carried = match displaced.contains(&pair) {
                true => self.moved_to_partner(pair, &carried),
                false => carried,
            };
            Waiting {
                pair,
                begin: Beginning::Carried(carried),
            }
        });
        Ok(waiting.collect())
    }

    /// The pairs of these shells by where a map takes them, each with its part of that map; moved where it goes elsewhere.
    fn started(&self, shells: [&[usize]; 2], sizes: [f64; 2], starts: &ShellStarts) -> Result<Vec<Waiting>, PairError> {
        let place = |shell: usize| starts.centres[shell];
        let (pairs, _) = self.matched(shells, sizes, &place)?;
        let displaced = self.displaced(&pairs, shells, sizes, &place)?;
        let waiting = pairs.into_iter().map(|pair| {
            let start = &starts.maps[pair[0]];
            let given = match displaced.contains(&pair) {
                true => BoundaryMap::new(start.domain().clone(), self.moved_to_partner(pair, start.image()))?,
                false => start.clone(),
            };
            Ok(Waiting {
                pair,
                begin: Beginning::Given(given),
            })
        });
        waiting.collect()
    }

    /// Images of a shell's vertices, moved and scaled to the place and size of its partner: shells that are to go elsewhere than they
    /// lie have no closest points there that could say how.
    fn moved_to_partner(&self, [from, to]: [usize; 2], images: &[Point]) -> Vec<Point> {
        let (shell, partner) = (&self.solids[0].shells[from], &self.solids[1].shells[to]);
        let image = shell.surface.with_vertices(images.to_vec());
        let image = image.filter(|image| image.volume() > 0.0);
        let image = image.as_ref().unwrap_or(&shell.surface);
        let (centre, scale) = (centre_of(image), partner.size / image.volume().cbrt());
        let moved = image.vertices().iter().map(|p| partner.centre + scale * (p - centre));
        moved.collect()
    }

    /// Those of the pairs that places alone would not make, and that therefore need another start than their places.
    fn displaced(
        &self,
        pairs: &[[usize; 2]],
        shells: [&[usize]; 2],
        sizes: [f64; 2],
        place: &dyn Fn(usize) -> Point,
    ) -> Result<Vec<[usize; 2]>, PairError> {
        if self.given.is_empty() {
            return Ok(vec![]);
        }
        let (by_place, _) = self.assigned(shells, sizes, place, &self.joined)?;
        Ok(pairs.iter().filter(|pair| !by_place.contains(pair)).copied().collect())
    }

    /// The best pairs of these shells, of which those of the domain lie at `place`; `sizes` are those of what they are parts of.
    fn matched(
        &self,
        shells: [&[usize]; 2],
        sizes: [f64; 2],
        place: &dyn Fn(usize) -> Point,
    ) -> Result<Matched, PairError> {
        let mut joined = self.joined.clone();
        joined.extend(&self.given);
        self.assigned(shells, sizes, place, &joined)
    }

    /// As [`Self::matched`], with these pairs that are not to be sought.
    fn assigned(
        &self,
        shells: [&[usize]; 2],
        sizes: [f64; 2],
        place: &dyn Fn(usize) -> Point,
        joined: &BTreeMap<usize, usize>,
    ) -> Result<Matched, PairError> {
        let [domain, target] = self.solids;
        let places: BTreeMap<usize, Point> = shells[0].iter().map(|&k| (k, place(k))).collect();
        let diagonal = target.surface.diagonal();
        let cost = |[from, to]: [usize; 2]| {
            let (a, b) = (&domain.shells[from], &target.shells[to]);
            let distance = (places[&from] - b.centre).norm() / diagonal;
            let ratio = (a.size / sizes[0]) / (b.size / sizes[1]);
            let is_elsewhere = self.starts.as_ref().is_some_and(|starts| starts.contradict(from, to));
            distance.powi(2) + SIZE_WEIGHT * ratio.ln().powi(2) + f64::from(is_elsewhere)
        };
        let [mut from, mut to] = shells.map(<[usize]>::to_vec);
        let mut pairs = Vec::new();
        for (&a, &b) in joined {
            if !from.contains(&a) {
                continue;
            }
            if !to.contains(&b) {
                let reason =
                    format!("landmarks take shell {a} of the domain to shell {b} of the target, which lies elsewhere");
                return Err(unmatched(reason));
            }
            from.retain(|&k| k != a);
            to.retain(|&k| k != b);
            pairs.push([a, b]);
        }
        let mut alike: BTreeMap<&str, [Vec<usize>; 2]> = BTreeMap::new();
        for (side, left) in [from, to].iter().enumerate() {
            for &k in left {
                alike.entry(&self.solids[side].shells[k].signature).or_default()[side].push(k);
            }
        }
        for [from, to] in alike.values() {
            if from.len() != to.len() {
                return Err(unmatched(format!(
                    "shells {from:?} of the domain have as many handles, and the same shells inside, as {to:?} of the target, which are not \
                     as many"
                )));
            }
            let row = |&a: &usize| to.iter().map(|&b| cost([a, b])).collect();
            let assigned = assignment(&from.iter().map(row).collect::<Vec<Vec<f64>>>());
            pairs.extend(from.iter().zip(assigned).map(|(&a, k)| [a, to[k]]));
        }
        let total = pairs.iter().map(|&pair| cost(pair)).sum();
        Ok((pairs, total))
    }

    /// How far a map takes the shells inside, and those inside of them, from where they are in the target: root mean square of the
    /// distances of their centres, over the target's diagonal.
    pub fn off_inside(&self, pair: [usize; 2], map: &BoundaryMap) -> Result<f64, PairError> {
        let [domain, target] = self.solids;
        let carrier = MovingLeastSquares::of(map);
        let (mut open, mut count, mut sum) = (vec![pair], 0, 0.0);
        while let Some([from, to]) = open.pop() {
            let around = [&domain.shells[from], &target.shells[to]];
            let inside = around.map(|shell| &shell.inside[..]);
            let place = |shell: usize| carrier.carried(&domain.shells[shell].centre);
            let (pairs, _) = self.matched(inside, around.map(|shell| shell.size), &place)?;
            for &[from, to] in &pairs {
                sum += (place(from) - target.shells[to].centre).norm_squared();
            }
            count += pairs.len();
            open.extend(pairs);
        }
        Ok((sum / count.max(1) as f64).sqrt() / target.surface.diagonal())
    }

    /// The best alignments of the two solids with all their shells.
    pub fn alignments(&self) -> Result<Vec<Alignment>, PairError> {
        let [domain, target] = self.solids;
        let from = AlignmentSurface::new(&domain.surface, "domain")?;
        let to = AlignmentSurface::new(&target.surface, "target")?;
        Ok(align(&from, &to).best)
    }
}

/// Refuses what only shells without handles can be given.
fn require_no_handles(domain: &Solid, shell: usize, option: &'static str) -> Result<(), PairError> {
    match domain.shells[shell].genus {
        0 => Ok(()),
        genus => {
            let error = Box::new(PairError::NotWithHandles { option, genus });
            Err(PairError::Shell { shell, error })
        }
    }
}

/// Records that something given, such as `"landmarks"`, takes a shell to another, and so the shells around it to those around that.
///
/// # Errors
///
/// When that cannot be.
fn join(solids: &[Solid; 2], joined: &mut BTreeMap<usize, usize>, by: &str, pair: [usize; 2]) -> Result<(), PairError> {
    let mut next = Some(pair);
    while let Some([from, to]) = next {
        let [a, b] = [&solids[0].shells[from], &solids[1].shells[to]];
        let is_taken = joined.iter().any(|(&shell, &other)| (shell == from) != (other == to));
        if is_taken || a.signature != b.signature {
            return Err(unmatched(format!(
                "{by} take shell {from} of the domain to shell {to} of the target, and another one to it or it to another one, or \
                 the two have other handles or shells inside"
            )));
        }
        joined.insert(from, to);
        next = match [a.around, b.around] {
            [Some(from), Some(to)] => Some([from, to]),
            [None, None] => None,
            _ => {
                return Err(unmatched(format!(
                    "{by} take shell {from} of the domain to shell {to} of the target, of which one lies in another shell"
                )));
            }
        };
    }
    Ok(())
}

fn unmatched(reason: String) -> PairError {
    PairError::NoMatchingShells { reason }
}

/// For each row a column of its own, of small total cost: the least of all pairs first, then exchanges while they help.
fn assignment(costs: &[Vec<f64>]) -> Vec<usize> {
    let count = costs.len();
    let mut all: Vec<[usize; 2]> = (0..count).flat_map(|a| (0..count).map(move |b| [a, b])).collect();
    all.sort_by(|x, y| costs[x[0]][x[1]].total_cmp(&costs[y[0]][y[1]]));
    let (mut column_of, mut is_taken) = (vec![usize::MAX; count], vec![false; count]);
    for [a, b] in all {
        if column_of[a] == usize::MAX && !is_taken[b] {
            (column_of[a], is_taken[b]) = (b, true);
        }
    }
    let mut is_improved = true;
    while is_improved {
        is_improved = false;
        for a in 0..count {
            for b in 0..a {
                let (of_a, of_b) = (column_of[a], column_of[b]);
                let gain = costs[a][of_a] + costs[b][of_b] - costs[a][of_b] - costs[b][of_a];
                // More than rounding, so that it ends.
                if gain > 1e-12 {
                    column_of.swap(a, b);
                    is_improved = true;
                }
            }
        }
    }
    column_of
}
