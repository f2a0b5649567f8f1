//! Solids of several shells, which are components or cavities: shells are matched from the outside in, and each is mapped by itself.
//!
//! A shell matches one of its genus with matching shells inside. Of these, outer shells go where an alignment of the whole solids puts
//! them, and shells inside another where its map carries them: by the affine map that fits it best near by, "moving least squares"
//! (Levin 1998; Schaefer, McPhail, Warren 2006). A shell inside is then mapped as if it lay where it is carried, so that it turns with
//! the shell around it. Which shells go to which may also be given ([`PairOptions::components`]), in part or for all.

mod given;
mod matching;
mod moving_least_squares;
mod others;
mod part;
mod solid;
mod starts;

use std::time::Instant;

pub(super) use given::require_pairs;
pub use given::{ComponentMismatch, ComponentsError};
use matching::{Beginning, Matching, Waiting};
use moving_least_squares::MovingLeastSquares;
use others::{RatedMap, distinct};
use part::ShellPart;
use solid::{Shell, Solid};

use super::{
    AlignError, PairAlternative, PairError, PairMaps, PairMethod, PairOptions, PairPhase, PairReport, ShellReport,
    Stretch, distortion, map_pair, map_pair_with_alternatives, over_surface,
};
use crate::boundary_map::{BoundaryMap, ShellMap};
use crate::mesh::{SurfaceMesh, shapes};
use crate::progress::{ProgressControl, ProgressResponse};

/// Shells inside are where they belong when a map takes them this near; see [`Matching::off_inside`].
const NEAR: f64 = 0.03;
/// A warning says so when the best map takes them farther than this.
const FAR: f64 = 0.1;

/// Maps every shell, and puts the maps together.
pub(super) fn map_shells<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let begin = Instant::now();
    let solids = [Solid::of("domain", domain)?, Solid::of("target", target)?];
    let matching = Matching::new(&solids, options)?;
    let mapper = ShellMapper {
        matching: &matching,
        options,
    };
    let mut found: Found = solids[0].shells.iter().map(|_| None).collect();
    let mut others = mapper.map_all(matching.outermost()?, &mut found, progress)?;
    let map = mapper.joined(&found)?;
    let mut report = mapper.report(&map, &found)?;
    others.sort_by(|a, b| a.found.energy_ratio.total_cmp(&b.found.energy_ratio));
    let mut alternatives = Vec::new();
    for other in others.into_iter().take(options.alternatives) {
        let (alternative, found) = mapper.with_other(other, &found, &map, progress)?;
        alternatives.push(alternative);
        report.alternatives.push(found);
    }
    report.timings.total = begin.elapsed().as_secs_f64();
    Ok(PairMaps {
        map,
        report,
        alternatives,
    })
}

/// For each shell of the domain its map and what was found, once it is mapped.
type Found = Vec<Option<(ShellMap, PairReport)>>;

/// Another map of a pair of outermost shells.
struct OtherMap {
    pair: [usize; 2],
    map: BoundaryMap,
    found: PairAlternative,
}

/// Maps pairs of shells.
struct ShellMapper<'a> {
    matching: &'a Matching<'a>,
    options: &'a PairOptions,
}

impl ShellMapper<'_> {
    fn pair(&self, [from, to]: [usize; 2]) -> [&Shell; 2] {
        let [domain, target] = self.matching.solids;
        [&domain.shells[from], &target.shells[to]]
    }

    /// Maps these shells, and all inside them; returns other maps of outermost ones.
    fn map_all<A: ProgressResponse>(
        &self,
        mut waiting: Vec<Waiting>,
        found: &mut Found,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<Vec<OtherMap>, PairError> {
        let mut others = Vec::new();
        let of = found.len();
        while let Some(next) = waiting.pop() {
            let [shell, target] = next.pair;
            let mapped = found.iter().flatten().count();
            let phase = PairPhase::Shell {
                shell: (mapped + 1).min(of),
                of,
            };
            if progress(phase).control() == ProgressControl::Cancel {
                return Err(PairError::Cancelled);
            }
            let in_shell = |error| match error {
                PairError::Cancelled => error,
                error => PairError::Shell {
                    shell,
                    error: Box::new(ShellPart::new(self.pair(next.pair), self.options).in_numbers_of_solids(error)),
                },
            };
            let (map, report, of_shell) = self.mapped_with_inside(&next, progress).map_err(in_shell)?;
            waiting.extend(self.matching.inside(next.pair, &map)?);
            found[shell] = Some((ShellMap { target, map }, report));
            others.extend(of_shell);
        }
        Ok(others)
    }

    /// The maps of all shells as one.
    fn joined(&self, found: &Found) -> Result<BoundaryMap, PairError> {
        let [domain, target] = self.matching.solids;
        let maps = found.iter().flatten().map(|(map, _)| map.clone());
        Ok(BoundaryMap::by_shells(
            &domain.surface,
            &target.surface,
            maps.collect(),
        )?)
    }

    /// The map of all shells with another one of an outermost shell, to which those inside it are mapped anew.
    fn with_other<A: ProgressResponse>(
        &self,
        other: OtherMap,
        found: &Found,
        taken: &BoundaryMap,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<(BoundaryMap, PairAlternative), PairError> {
        let [shell, target] = other.pair;
        let mut found = found.clone();
        let inside = self.matching.inside(other.pair, &other.map)?;
        if let Some((own, _)) = &mut found[shell] {
            *own = ShellMap { target, map: other.map };
        }
        self.map_all(inside, &mut found, progress)?;
        let map = self.joined(&found)?;
        let found = PairAlternative {
            shell: Some(shell),
            distance: mean_distance(&map, taken) / self.matching.solids[1].surface.diagonal(),
            ..other.found
        };
        Ok((map, found))
    }

    /// As [`Self::mapped`]; where the map takes the shells inside elsewhere than they are in the target, as a wrong one of a ball
    /// does, other maps are tried: those that the search found beside it, and those from alignments of the whole solids.
    fn mapped_with_inside<A: ProgressResponse>(
        &self,
        waiting: &Waiting,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<(BoundaryMap, PairReport, Vec<OtherMap>), PairError> {
        let PairMaps {
            map,
            mut report,
            alternatives,
        } = self.mapped(waiting, progress)?;
        let pair = waiting.pair;
        let first = self.matching.off_inside(pair, &map)?;
        if !matches!(waiting.begin, Beginning::Unknown) || first <= NEAR || report.concluded {
            let others = alternatives.into_iter().zip(&report.alternatives);
            let others = others.map(|(map, &found)| OtherMap { pair, map, found }).collect();
            return Ok((map, report, others));
        }
        let tried = self.tried(pair, map, &mut report, progress)?;
        let rated = tried.into_iter().map(|(kind, map)| self.rated(pair, kind, map));
        let mut rated = rated.collect::<Result<Vec<RatedMap>, _>>()?;
        let best = (0..rated.len())
            .min_by(|&a, &b| rated[a].rating.total_cmp(&rated[b].rating))
            .unwrap_or_default();
        let taken = rated.swap_remove(best);
        let others = match self.options.alternatives {
            0 => vec![],
            _ => distinct(&taken, rated, self.pair(pair)[1].surface.diagonal()),
        };
        let others = others.into_iter().map(|(map, found)| OtherMap { pair, map, found });
        let RatedMap {
            map,
            distortion: found,
            off,
            ..
        } = taken;
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
        Ok((map, report, others.collect()))
    }

    /// The map of a pair of shells, and others where nothing is known of it. A shell that is carried is mapped as if it lay there.
    fn mapped<A: ProgressResponse>(
        &self,
        waiting: &Waiting,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<PairMaps, PairError> {
        let [from, to] = self.pair(waiting.pair);
        let (surface, target) = (&from.surface, &to.surface);
        let options = self.options_of([from, to])?;
        let alone = |(map, report)| PairMaps {
            map,
            report,
            alternatives: vec![],
        };
        let carried = match &waiting.begin {
            Beginning::Unknown => return map_pair_with_alternatives(surface, target, &options, progress),
            Beginning::Given(start) => {
                let from_start = PairOptions {
                    start: Some(start.clone()),
                    ..options
                };
                return map_pair(surface, target, &from_start, progress).map(alone);
            }
            Beginning::Carried(carried) => carried,
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
        Ok(alone((map, report)))
    }

    /// The options for a pair of shells: with its landmarks and curves.
    fn options_of(&self, [from, to]: [&Shell; 2]) -> Result<PairOptions, PairError> {
        let part = ShellPart::new([from, to], self.options);
        // Maps through a flat torus take no directions.
        let up = self.options.up.filter(|_| from.genus != 1);
        Ok(PairOptions {
            landmarks: part.landmarks()?,
            curves: part.curves(),
            loops: part.loops(),
            components: vec![],
            start: None,
            up,
            ..self.options.clone()
        })
    }

    fn shell_reports(&self, found: &Found) -> Vec<ShellReport> {
        let shells = self.matching.solids[0].shells.iter().zip(found.iter().flatten());
        let shells = shells.map(|(shell, (found, report))| ShellReport {
            target: found.target,
            is_cavity: shell.is_cavity,
            genus: shell.genus,
            vertices: shell.vertices.len(),
            target_vertices: self.matching.solids[1].shells[found.target].vertices.len(),
            method: report.method,
            distortion: report.after,
            stretched: report.stretch.domain.share,
            target_stretched: report.stretch.target.share,
        });
        shells.collect()
    }

    fn report(&self, map: &BoundaryMap, found: &Found) -> Result<PairReport, PairError> {
        let shells = self.shell_reports(found);
        let mut reports: Vec<PairReport> = found.iter().flatten().map(|(_, report)| report.clone()).collect();
        let of_shell = |(shell, report): (usize, &PairReport)| {
            let warnings = report.warnings.iter();
            warnings
                .map(|warning| format!("shell {shell}: {warning}"))
                .collect::<Vec<String>>()
        };
        let warnings = reports.iter().enumerate().flat_map(of_shell).collect();
        let timings = reports.iter().map(|report| report.timings).sum();
        let landmarks = reports.iter().map(|report| report.landmarks).sum();
        let of_target = |shell: &ShellReport| self.matching.solids[1].shells[shell.target].surface.diagonal();
        let landmark_errors = reports.iter().zip(&shells);
        let landmark_errors = landmark_errors.map(|(report, shell)| report.landmark_error * of_target(shell));
        let landmark_error = landmark_errors.fold(0.0, f64::max) / self.matching.solids[1].surface.diagonal();
        let concluded = reports.iter().any(|report| report.concluded);
        let size = |&shell: &usize| self.matching.solids[0].shells[shell].size;
        let outermost = self.matching.solids[0].outermost.iter().copied();
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

/// Mean distance of the images of vertices.
fn mean_distance(a: &BoundaryMap, b: &BoundaryMap) -> f64 {
    let distances = a.image().iter().zip(b.image()).map(|(p, q)| (p - q).norm());
    distances.sum::<f64>() / a.image().len().max(1) as f64
}

fn no_area() -> PairError {
    AlignError::NoArea { side: "domain" }.into()
}
