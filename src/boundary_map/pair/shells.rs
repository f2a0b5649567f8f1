//! Solids of several shells, which are components or cavities: shells are matched from the outside in, and each is mapped by itself.
//!
//! A shell matches one of its genus with matching shells inside. Of these, outer shells go where an alignment of the whole solids puts
//! them, and shells inside another where its map carries them: by the affine map that fits it best near by, "moving least squares"
//! (Levin 1998; Schaefer, McPhail, Warren 2006). A shell inside is then mapped as if it lay where it is carried, so that it turns with
//! the shell around it.

use std::collections::BTreeMap;
use std::time::Instant;

use rayon::prelude::*;

use super::{
    AlignError, Alignment, AlignmentSurface, LandmarkCurve, Landmarks, PairAlternative, PairError, PairMaps,
    PairMethod, PairOptions, PairPhase, PairReport, PairTimings, ShellReport, Stretch, align, distortion, map_pair,
    map_pair_with_alternatives, over_surface, product_of_quantiles,
};
use crate::boundary_map::{BoundaryMap, ShellMap};
use crate::check::{ShellSurface, shells_of};
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, shapes};
use crate::progress::{ProgressControl, ProgressResponse};
use crate::sampling::Collocation;
use crate::spherical::{SphericalError, genus};
use crate::{Matrix3, Point, Vector};

/// Points of a shell by which those inside are carried.
const SAMPLES: usize = 2000;
const SEED: u64 = 1;
/// Weight of the square of the logarithm of a ratio of sizes, beside the square of a distance over the target's diagonal.
const SIZE_WEIGHT: f64 = 0.05;
/// Shells inside are where they belong when a map takes them this near; see [`ShellPairing::off_inside`].
const NEAR: f64 = 0.03;
/// A warning says so when the best map takes them farther than this.
const FAR: f64 = 0.1;
/// Weight of that distance beside the distortion, where maps are compared.
const OFF_WEIGHT: f64 = 20.0;
/// What else is tried: maps of up to this many times the least energy, and alignments of the whole solids.
const MOST_ENERGY: f64 = 2.0;
const MOST_ALTERNATIVES: usize = 4;
const MOST_ALIGNMENTS: usize = 2;

/// A shell, and what is compared to find its partner.
struct Kind {
    shell: ShellSurface,
    genus: u64,
    /// Genus, and the same of the shells inside.
    signature: String,
    /// The shells inside, not those inside of them.
    inside: Vec<usize>,
    centre: Point,
    /// Cube root of the volume.
    size: f64,
}

/// A solid and its shells.
struct Side {
    surface: SurfaceMesh,
    kinds: Vec<Kind>,
    outermost: Vec<usize>,
    /// Cube root of the volume of all outermost shells.
    size: f64,
}

/// A pair of shells to be mapped.
struct Waiting {
    pair: [usize; 2],
    /// Where the vertices of the domain's are carried by the map of the shell around it.
    carried: Option<Vec<Point>>,
}

/// Pairs of shells, and how far they are from each other.
type Matched = (Vec<[usize; 2]>, f64);

/// Maps every shell, and puts the maps together.
pub(super) fn map_shells<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let refused = [
        (options.start.is_some(), "a map to start from"),
        (options.alternatives > 0, "other maps"),
    ];
    if let Some((_, option)) = refused.into_iter().find(|(is_given, _)| *is_given) {
        return Err(PairError::NotWithShells { option });
    }
    let begin = Instant::now();
    let sides = [Side::of("domain", domain)?, Side::of("target", target)?];
    let pairing = ShellPairing::new(&sides, options)?;
    let mut found: Vec<Option<(ShellMap, PairReport)>> = sides[0].kinds.iter().map(|_| None).collect();
    let mut waiting = pairing.outermost()?;
    let (mut count, of) = (0, found.len());
    while let Some(next) = waiting.pop() {
        let [shell, to] = next.pair;
        count += 1;
        if progress(PairPhase::Shell { shell: count, of }).control() == ProgressControl::Cancel {
            return Err(PairError::Cancelled);
        }
        let in_shell = |error| match error {
            PairError::Cancelled => error,
            error => PairError::Shell {
                shell,
                error: Box::new(error),
            },
        };
        let (map, report) = pairing.mapped_with_inside(&next, progress).map_err(in_shell)?;
        waiting.extend(pairing.inside(next.pair, &map)?);
        found[shell] = Some((ShellMap { target: to, map }, report));
    }
    let (maps, reports): (Vec<ShellMap>, Vec<PairReport>) = found.into_iter().flatten().unzip();
    let shells = pairing.shell_reports(&maps, &reports);
    let map = BoundaryMap::by_shells(&sides[0].surface, &sides[1].surface, maps)?;
    let mut report = pairing.report(&map, reports, shells)?;
    report.timings.total = begin.elapsed().as_secs_f64();
    Ok(PairMaps {
        map,
        report,
        alternatives: vec![],
    })
}

impl Side {
    fn of(side: &'static str, surface: &SurfaceMesh) -> Result<Self, PairError> {
        let of_side = |error| PairError::Sphere { side, error };
        match genus(surface) {
            Ok(_) | Err(SphericalError::Components { components: 2.. }) => {}
            Err(error) => return Err(of_side(error)),
        }
        let (surface, shells) = shells_of(surface).map_err(|error| PairError::Shells { side, error })?;
        let inside_of = |around: Option<usize>| {
            let kinds = shells.iter().enumerate();
            kinds
                .filter(|(_, shell)| shell.inside == around)
                .map(|(k, _)| k)
                .collect()
        };
        let outermost: Vec<usize> = inside_of(None);
        let inside: Vec<Vec<usize>> = (0..shells.len()).map(|shell| inside_of(Some(shell))).collect();
        let genera = shells.iter().map(|shell| genus(&shell.surface));
        let genera: Result<Vec<u64>, _> = genera.collect();
        let genera = genera.map_err(of_side)?;
        let unreferenced = Topology::new(&surface).unreferenced_vertices();
        if let Some(&first) = unreferenced.first() {
            let count = unreferenced.len();
            return Err(of_side(SphericalError::Unreferenced { count, first }));
        }
        let volume: f64 = outermost.iter().map(|&k| shells[k].surface.volume()).sum();
        let kinds = shells.into_iter().enumerate().map(|(k, shell)| Kind {
            genus: genera[k],
            signature: signature(k, &genera, &inside),
            inside: inside[k].clone(),
            centre: centre_of(&shell.surface),
            size: shell.surface.volume().cbrt(),
            shell,
        });
        Ok(Self {
            surface,
            kinds: kinds.collect(),
            outermost,
            size: volume.cbrt(),
        })
    }

    /// The shell that has all these vertices.
    fn shell_of_all(&self, path: &[u32]) -> Option<usize> {
        let shell = self.shell_of(*path.first()?)?;
        path.iter().all(|&v| self.shell_of(v) == Some(shell)).then_some(shell)
    }

    fn shell_of(&self, vertex: u32) -> Option<usize> {
        let holds = |kind: &Kind| kind.shell.vertices.binary_search(&vertex).is_ok();
        self.kinds.iter().position(holds)
    }
}

fn signature(shell: usize, genera: &[u64], inside: &[Vec<usize>]) -> String {
    let mut of_inner: Vec<String> = inside[shell].iter().map(|&k| signature(k, genera, inside)).collect();
    of_inner.sort();
    format!("{}({})", genera[shell], of_inner.concat())
}

/// Centre of mass of the surface.
fn centre_of(surface: &SurfaceMesh) -> Point {
    let (mut sum, mut total) = (Vector::zeros(), 0.0);
    for t in 0..surface.triangles().len() {
        let area = surface.area_vector(t).norm();
        sum += surface.corners(t).iter().map(|p| p.coords).sum::<Vector>() * (area / 3.0);
        total += area;
    }
    Point::from(sum / total)
}

/// How shells of both solids are matched and mapped.
struct ShellPairing<'a> {
    sides: &'a [Side; 2],
    options: &'a PairOptions,
    /// For shells of the domain with landmarks or curves the shell of the target that these are on.
    joined: BTreeMap<usize, usize>,
}

impl<'a> ShellPairing<'a> {
    fn new(sides: &'a [Side; 2], options: &'a PairOptions) -> Result<Self, PairError> {
        let [domain, target] = sides;
        if domain.kinds.len() != target.kinds.len() {
            return Err(PairError::UnequalShells {
                domain: domain.kinds.len(),
                target: target.kinds.len(),
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
            join(sides, &mut joined, [from, to])?;
        }
        for (index, curve) in options.curves.iter().enumerate() {
            let paths = [(domain, &curve.domain), (target, &curve.target)];
            let [Some(from), Some(to)] = paths.map(|(side, path)| side.shell_of_all(path)) else {
                return Err(unmatched(format!("curve {index} is not in one shell of each solid")));
            };
            join(sides, &mut joined, [from, to])?;
        }
        Ok(Self { sides, options, joined })
    }

    fn outermost(&self) -> Result<Vec<Waiting>, PairError> {
        let [domain, target] = self.sides;
        let outermost = [&domain.outermost[..], &target.outermost[..]];
        let sizes = [domain.size, target.size];
        let (pairs, _) = if self.options.aligned || domain.outermost.len() == 1 {
            self.matched(outermost, sizes, &|p| *p)?
        } else {
            let alignments = self.alignments()?;
            let tried = alignments
                .iter()
                .map(|found| self.matched(outermost, sizes, &|p| found.similarity.apply(p)));
            let tried: Vec<Matched> = tried.collect::<Result<_, _>>()?;
            let least = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
            least.ok_or_else(|| unmatched("no alignment was found".into()))?
        };
        let waiting = pairs.into_iter().map(|pair| Waiting { pair, carried: None });
        Ok(waiting.collect())
    }

    /// The pairs of shells inside a pair, whose map carries them.
    fn inside(&self, [from, to]: [usize; 2], map: &BoundaryMap) -> Result<Vec<Waiting>, PairError> {
        let around = [&self.sides[0].kinds[from], &self.sides[1].kinds[to]];
        if around[0].inside.is_empty() {
            return Ok(vec![]);
        }
        let carrier = Carrier::of(map);
        let inside = around.map(|kind| &kind.inside[..]);
        let (pairs, _) = self.matched(inside, around.map(|kind| kind.size), &|p| carrier.carried(p))?;
        let waiting = pairs.into_iter().map(|pair| {
            let vertices = self.sides[0].kinds[pair[0]].shell.surface.vertices();
            Waiting {
                pair,
                carried: Some(vertices.par_iter().map(|p| carrier.carried(p)).collect()),
            }
        });
        Ok(waiting.collect())
    }

    /// The best pairs of these shells, of which those of the domain are carried; `sizes` are those of what they are parts of.
    fn matched(
        &self,
        shells: [&[usize]; 2],
        sizes: [f64; 2],
        carried: &dyn Fn(&Point) -> Point,
    ) -> Result<Matched, PairError> {
        let [domain, target] = self.sides;
        let places: BTreeMap<usize, Point> = shells[0]
            .iter()
            .map(|&k| (k, carried(&domain.kinds[k].centre)))
            .collect();
        let diagonal = target.surface.diagonal();
        let cost = |[from, to]: [usize; 2]| {
            let (a, b) = (&domain.kinds[from], &target.kinds[to]);
            let distance = (places[&from] - b.centre).norm() / diagonal;
            let ratio = (a.size / sizes[0]) / (b.size / sizes[1]);
            distance.powi(2) + SIZE_WEIGHT * ratio.ln().powi(2)
        };
        let [mut from, mut to] = shells.map(<[usize]>::to_vec);
        let mut pairs = Vec::new();
        for (&a, &b) in &self.joined {
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
                alike.entry(&self.sides[side].kinds[k].signature).or_default()[side].push(k);
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

    /// As [`Self::mapped`]; where the map takes the shells inside elsewhere than they are in the target, as a wrong one of a ball
    /// does, other maps are tried: those that the search found beside it, and those from alignments of the whole solids.
    fn mapped_with_inside<A: ProgressResponse>(
        &self,
        waiting: &Waiting,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<(BoundaryMap, PairReport), PairError> {
        let (map, mut report) = self.mapped(waiting, progress)?;
        let [from, to] = [0, 1].map(|side| &self.sides[side].kinds[waiting.pair[side]]);
        let first = self.off_inside(waiting.pair, &map)?;
        if waiting.carried.is_some() || first <= NEAR || report.concluded {
            return Ok((map, report));
        }
        let options = self.options_of([from, to])?;
        let surfaces = [&from.shell.surface, &to.shell.surface];
        let mut tried = vec![map];
        // What cannot be mapped another way has a map all the same.
        let others =
            |options: &PairOptions| match map_pair_with_alternatives(surfaces[0], surfaces[1], options, progress) {
                Err(PairError::Cancelled) => Err(PairError::Cancelled),
                found => Ok(found.ok()),
            };
        let as_good = |other: &&PairAlternative| other.energy_ratio <= MOST_ENERGY;
        let with_alternatives = PairOptions {
            alternatives: report
                .alternatives
                .iter()
                .filter(as_good)
                .count()
                .min(MOST_ALTERNATIVES),
            ..options.clone()
        };
        if with_alternatives.alternatives > 0 {
            tried.extend(
                others(&with_alternatives)?
                    .into_iter()
                    .flat_map(|found| found.alternatives),
            );
        }
        let is_free = !options.aligned && options.landmarks.pairs().is_empty() && options.curves.is_empty();
        if is_free && from.genus == 0 && options.method == PairMethod::SoftTargets {
            for alignment in self.alignments()?.iter().take(MOST_ALIGNMENTS) {
                let moved = surfaces[0].vertices().iter().map(|p| alignment.similarity.apply(p));
                let from_alignment = PairOptions {
                    start: Some(BoundaryMap::new(surfaces[0].clone(), moved.collect())?),
                    ..options.clone()
                };
                tried.extend(others(&from_alignment)?.map(|found| found.map));
            }
        }
        let mut rated = Vec::new();
        for map in tried {
            let found = distortion(&map).ok_or_else(no_area)?;
            let off = self.off_inside(waiting.pair, &map)?;
            rated.push((
                product_of_quantiles(&found).cbrt() * (1.0 + OFF_WEIGHT * off),
                map,
                found,
                off,
            ));
        }
        let best = (0..rated.len())
            .min_by(|&a, &b| rated[a].0.total_cmp(&rated[b].0))
            .unwrap_or_default();
        let (_, map, found, off) = rated.swap_remove(best);
        if best > 0 {
            (report.before, report.after) = (found, found);
            report.stretch = Stretch::of(&map, self.options.most_stretched).ok_or_else(no_area)?;
            (report.isometry_defect, report.nearer_isometry, report.is_reversed) = (None, None, false);
            let warning =
                "a map of another start was taken, because that of least distortion takes the shells inside elsewhere";
            report.warnings.push(warning.into());
        }
        if off > FAR {
            report.warnings.push(format!(
                "the shells inside are taken {:.0} % of the target's diagonal from those of the target: the volume is stretched there, or the \
                 map is not the one that you want; then give landmarks",
                100.0 * off
            ));
        }
        Ok((map, report))
    }

    /// How far a map takes the shells inside, and those inside of them, from where they are in the target: root mean square of the
    /// distances of their centres, over the target's diagonal.
    fn off_inside(&self, pair: [usize; 2], map: &BoundaryMap) -> Result<f64, PairError> {
        let [domain, target] = self.sides;
        let carrier = Carrier::of(map);
        let (mut open, mut count, mut sum) = (vec![pair], 0, 0.0);
        while let Some([from, to]) = open.pop() {
            let around = [&domain.kinds[from], &target.kinds[to]];
            let inside = around.map(|kind| &kind.inside[..]);
            let (pairs, _) = self.matched(inside, around.map(|kind| kind.size), &|p| carrier.carried(p))?;
            for &[from, to] in &pairs {
                let image = carrier.carried(&domain.kinds[from].centre);
                sum += (image - target.kinds[to].centre).norm_squared();
            }
            count += pairs.len();
            open.extend(pairs);
        }
        Ok((sum / count.max(1) as f64).sqrt() / target.surface.diagonal())
    }

    /// The best alignments of the two solids with all their shells.
    fn alignments(&self) -> Result<Vec<Alignment>, PairError> {
        let [domain, target] = self.sides;
        let from = AlignmentSurface::new(&domain.surface, "domain")?;
        let to = AlignmentSurface::new(&target.surface, "target")?;
        Ok(align(&from, &to).best)
    }

    /// The map of a pair of shells. A shell that is carried is mapped as if it lay there.
    fn mapped<A: ProgressResponse>(
        &self,
        waiting: &Waiting,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<(BoundaryMap, PairReport), PairError> {
        let [from, to] = [0, 1].map(|side| &self.sides[side].kinds[waiting.pair[side]]);
        let (surface, target) = (&from.shell.surface, &to.shell.surface);
        let options = self.options_of([from, to])?;
        let Some(carried) = &waiting.carried else {
            return map_pair(surface, target, &options, progress);
        };
        // Conformal maps do not know where a shell lies.
        let in_place = PairOptions {
            method: PairMethod::SoftTargets,
            aligned: true,
            up: None,
            ..options
        };
        // Where the map around it folds, a shell may be turned inside out.
        let carried = surface
            .with_vertices(carried.clone())
            .filter(|carried| carried.volume() > 0.0);
        let moved = || {
            let scale = to.size / from.size;
            shapes::deformed(surface, |p| to.centre + scale * (p - from.centre))
        };
        let (onto, mut report) = map_pair(&carried.unwrap_or_else(moved), target, &in_place, progress)?;
        let map = over_surface(&onto, surface.clone())?;
        report.after = distortion(&map).ok_or_else(no_area)?;
        report.stretch = Stretch::of(&map, self.options.most_stretched).ok_or_else(no_area)?;
        Ok((map, report))
    }

    /// The options for a pair of shells: with its landmarks and curves.
    fn options_of(&self, [from, to]: [&Kind; 2]) -> Result<PairOptions, PairError> {
        let own = |kind: &Kind, v: u32| kind.shell.vertices.binary_search(&v).ok().map(|own| own as u32);
        let pairs = self.options.landmarks.pairs().iter();
        let pairs: Vec<[u32; 2]> = pairs.filter_map(|&[v, w]| Some([own(from, v)?, own(to, w)?])).collect();
        let path = |kind: &Kind, path: &[u32]| path.iter().map(|&v| own(kind, v)).collect::<Option<Vec<u32>>>();
        let curves = self.options.curves.iter().filter_map(|curve| {
            Some(LandmarkCurve {
                domain: path(from, &curve.domain)?,
                target: path(to, &curve.target)?,
            })
        });
        // Maps through a flat torus take no directions.
        let up = self.options.up.filter(|_| from.genus != 1);
        Ok(PairOptions {
            landmarks: Landmarks::new(pairs, from.shell.vertices.len(), to.shell.vertices.len())?,
            curves: curves.collect(),
            up,
            ..self.options.clone()
        })
    }

    fn shell_reports(&self, maps: &[ShellMap], reports: &[PairReport]) -> Vec<ShellReport> {
        let shells = self.sides[0].kinds.iter().zip(maps).zip(reports);
        let shells = shells.map(|((kind, found), report)| ShellReport {
            target: found.target,
            is_cavity: kind.shell.is_cavity,
            genus: kind.genus,
            vertices: kind.shell.vertices.len(),
            target_vertices: self.sides[1].kinds[found.target].shell.vertices.len(),
            method: report.method,
            distortion: report.after,
            stretched: report.stretch.share,
        });
        shells.collect()
    }

    fn report(
        &self,
        map: &BoundaryMap,
        mut reports: Vec<PairReport>,
        shells: Vec<ShellReport>,
    ) -> Result<PairReport, PairError> {
        let of_shell = |(shell, report): (usize, &PairReport)| {
            let warnings = report.warnings.iter();
            warnings
                .map(|warning| format!("shell {shell}: {warning}"))
                .collect::<Vec<String>>()
        };
        let warnings = reports.iter().enumerate().flat_map(of_shell).collect();
        let seconds = |of: fn(&PairTimings) -> f64| reports.iter().map(|report| of(&report.timings)).sum();
        let timings = PairTimings {
            sphere: seconds(|t| t.sphere),
            align: seconds(|t| t.align),
            coarse: seconds(|t| t.coarse),
            improve: seconds(|t| t.improve),
            reversed: seconds(|t| t.reversed),
            total: seconds(|t| t.total),
        };
        let landmarks = reports.iter().map(|report| report.landmarks).sum();
        let of_target = |shell: &ShellReport| self.sides[1].kinds[shell.target].shell.surface.diagonal();
        let landmark_errors = reports.iter().zip(&shells);
        let landmark_errors = landmark_errors.map(|(report, shell)| report.landmark_error * of_target(shell));
        let landmark_error = landmark_errors.fold(0.0, f64::max) / self.sides[1].surface.diagonal();
        let concluded = reports.iter().any(|report| report.concluded);
        let size = |&shell: &usize| self.sides[0].kinds[shell].size;
        let outermost = self.sides[0].outermost.iter().copied();
        let largest = outermost.max_by(|a, b| size(a).total_cmp(&size(b)));
        Ok(PairReport {
            landmarks,
            landmark_error,
            alternatives: vec![],
            after: distortion(map).ok_or_else(no_area)?,
            stretch: Stretch::of(map, self.options.most_stretched).ok_or_else(no_area)?,
            shells,
            timings,
            concluded,
            warnings,
            ..reports.swap_remove(largest.unwrap_or_default())
        })
    }
}

/// Records that landmarks take a shell to another, and so the shells around it to those around that.
///
/// # Errors
///
/// When that cannot be.
fn join(sides: &[Side; 2], joined: &mut BTreeMap<usize, usize>, pair: [usize; 2]) -> Result<(), PairError> {
    let mut next = Some(pair);
    while let Some([from, to]) = next {
        let [a, b] = [&sides[0].kinds[from], &sides[1].kinds[to]];
        if a.genus > 0 {
            let (shell, genus) = (from, a.genus);
            let error = Box::new(PairError::NotWithHandles {
                option: "landmarks",
                genus,
            });
            return Err(PairError::Shell { shell, error });
        }
        let is_taken = joined.iter().any(|(&shell, &other)| (shell == from) != (other == to));
        if is_taken || a.signature != b.signature {
            return Err(unmatched(format!(
                "landmarks take shell {from} of the domain to shell {to} of the target, and another one to it or it to another one, or \
                 the two have other handles or shells inside"
            )));
        }
        joined.insert(from, to);
        next = match [a.shell.inside, b.shell.inside] {
            [Some(from), Some(to)] => Some([from, to]),
            [None, None] => None,
            _ => {
                return Err(unmatched(format!(
                    "landmarks take shell {from} of the domain to shell {to} of the target, of which one lies in another shell"
                )));
            }
        };
    }
    Ok(())
}

fn no_area() -> PairError {
    AlignError::NoArea { side: "domain" }.into()
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

/// Carries points inside a shell by its map.
struct Carrier {
    from: Vec<Point>,
    to: Vec<Point>,
}

impl Carrier {
    fn of(map: &BoundaryMap) -> Self {
        let samples = Collocation::even(map.domain(), SAMPLES, SEED).points;
        Self {
            from: map.positions(&samples),
            to: map.evaluate(&samples),
        }
    }

    /// Exact for affine maps.
    fn carried(&self, p: &Point) -> Point {
        let weights = self
            .from
            .iter()
            .map(|q| (q - p).norm_squared().max(f64::MIN_POSITIVE).recip().powi(2));
        let weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        let mean = |points: &[Point]| -> Vector {
            let weighted = points.iter().zip(&weights).map(|(q, w)| q.coords * (w / total));
            weighted.sum()
        };
        let (from, to) = (mean(&self.from), mean(&self.to));
        let (mut covariance, mut mixed) = (Matrix3::zeros(), Matrix3::zeros());
        for ((q, image), w) in self.from.iter().zip(&self.to).zip(&weights) {
            let (d, e) = (q.coords - from, image.coords - to);
            covariance += d * d.transpose() * (w / total);
            mixed += e * d.transpose() * (w / total);
        }
        let linear = covariance
            .try_inverse()
            .map_or_else(Matrix3::identity, |inverse| mixed * inverse);
        Point::from(to + linear * (p.coords - from))
    }
}
