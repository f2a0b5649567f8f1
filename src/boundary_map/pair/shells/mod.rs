//! Solids of several shells, which are components or cavities: shells are matched from the outside in, and each is mapped by itself.
//!
//! A shell matches one of its genus with matching shells inside. Of these, outer shells go where an alignment of the whole solids puts
//! them, and shells inside another where its map carries them: by the affine map that fits it best near by, "moving least squares"
//! (Levin 1998; Schaefer, McPhail, Warren 2006). A shell inside is then mapped as if it lay where it is carried, so that it turns with
//! the shell around it.

mod matching;
mod moving_least_squares;
mod solid;

use std::time::Instant;

use matching::{Matching, Waiting};
use moving_least_squares::MovingLeastSquares;
use solid::{Shell, Solid};

use super::{
    AlignError, LandmarkCurve, Landmarks, PairAlternative, PairError, PairMaps, PairMethod, PairOptions, PairPhase,
    PairReport, ShellReport, Stretch, distortion, map_pair, map_pair_with_alternatives, over_surface,
    product_of_quantiles,
};
use crate::boundary_map::{BoundaryMap, ShellMap};
use crate::mesh::{SurfaceMesh, shapes};
use crate::progress::{ProgressControl, ProgressResponse};

/// Shells inside are where they belong when a map takes them this near; see [`Matching::off_inside`].
const NEAR: f64 = 0.03;
/// A warning says so when the best map takes them farther than this.
const FAR: f64 = 0.1;
/// Weight of that distance beside the distortion, where maps are compared.
const OFF_WEIGHT: f64 = 20.0;
/// What else is tried: maps of up to this many times the least energy, and alignments of the whole solids.
const MOST_ENERGY: f64 = 2.0;
const MOST_ALTERNATIVES: usize = 4;
const MOST_ALIGNMENTS: usize = 2;

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
    let solids = [Solid::of("domain", domain)?, Solid::of("target", target)?];
    let matching = Matching::new(&solids, options)?;
    let mapper = ShellMapper {
        matching: &matching,
        options,
    };
    let mut found: Vec<Option<(ShellMap, PairReport)>> = solids[0].shells.iter().map(|_| None).collect();
    let mut waiting = matching.outermost()?;
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
        let (map, report) = mapper.mapped_with_inside(&next, progress).map_err(in_shell)?;
        waiting.extend(matching.inside(next.pair, &map)?);
        found[shell] = Some((ShellMap { target: to, map }, report));
    }
    let (maps, reports): (Vec<ShellMap>, Vec<PairReport>) = found.into_iter().flatten().unzip();
    let shells = mapper.shell_reports(&maps, &reports);
    let map = BoundaryMap::by_shells(&solids[0].surface, &solids[1].surface, maps)?;
    let mut report = mapper.report(&map, reports, shells)?;
    report.timings.total = begin.elapsed().as_secs_f64();
    Ok(PairMaps {
        map,
        report,
        alternatives: vec![],
    })
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

    /// As [`Self::mapped`]; where the map takes the shells inside elsewhere than they are in the target, as a wrong one of a ball
    /// does, other maps are tried: those that the search found beside it, and those from alignments of the whole solids.
    fn mapped_with_inside<A: ProgressResponse>(
        &self,
        waiting: &Waiting,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<(BoundaryMap, PairReport), PairError> {
        let (map, mut report) = self.mapped(waiting, progress)?;
        let [from, to] = self.pair(waiting.pair);
        let first = self.matching.off_inside(waiting.pair, &map)?;
        if waiting.carried.is_some() || first <= NEAR || report.concluded {
            return Ok((map, report));
        }
        let options = self.options_of([from, to])?;
        let surfaces = [&from.surface, &to.surface];
        let mut tried = vec![map];
        let mut timings = vec![report.timings];
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
        if with_alternatives.alternatives > 0
            && let Some(found) = others(&with_alternatives)?
        {
            tried.extend(found.alternatives);
            timings.push(found.report.timings);
        }
        let is_free = !options.aligned && options.landmarks.pairs().is_empty() && options.curves.is_empty();
        if is_free && from.genus == 0 && options.method == PairMethod::SoftTargets {
            for alignment in self.matching.alignments()?.iter().take(MOST_ALIGNMENTS) {
                let moved = surfaces[0].vertices().iter().map(|p| alignment.similarity.apply(p));
                let from_alignment = PairOptions {
                    start: Some(BoundaryMap::new(surfaces[0].clone(), moved.collect())?),
                    ..options.clone()
                };
                if let Some(found) = others(&from_alignment)? {
                    tried.push(found.map);
                    timings.push(found.report.timings);
                }
            }
        }
        report.timings = timings.into_iter().sum();
        let mut rated = Vec::new();
        for map in tried {
            let found = distortion(&map).ok_or_else(no_area)?;
            let off = self.matching.off_inside(waiting.pair, &map)?;
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

    /// The map of a pair of shells. A shell that is carried is mapped as if it lay there.
    fn mapped<A: ProgressResponse>(
        &self,
        waiting: &Waiting,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<(BoundaryMap, PairReport), PairError> {
        let [from, to] = self.pair(waiting.pair);
        let (surface, target) = (&from.surface, &to.surface);
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
    fn options_of(&self, [from, to]: [&Shell; 2]) -> Result<PairOptions, PairError> {
        let own = |shell: &Shell, v: u32| shell.vertices.binary_search(&v).ok().map(|own| own as u32);
        let pairs = self.options.landmarks.pairs().iter();
        let pairs: Vec<[u32; 2]> = pairs.filter_map(|&[v, w]| Some([own(from, v)?, own(to, w)?])).collect();
        let path = |shell: &Shell, path: &[u32]| path.iter().map(|&v| own(shell, v)).collect::<Option<Vec<u32>>>();
        let curves = self.options.curves.iter().filter_map(|curve| {
            Some(LandmarkCurve {
                domain: path(from, &curve.domain)?,
                target: path(to, &curve.target)?,
            })
        });
        // Maps through a flat torus take no directions.
        let up = self.options.up.filter(|_| from.genus != 1);
        Ok(PairOptions {
            landmarks: Landmarks::new(pairs, from.vertices.len(), to.vertices.len())?,
            curves: curves.collect(),
            up,
            ..self.options.clone()
        })
    }

    fn shell_reports(&self, maps: &[ShellMap], reports: &[PairReport]) -> Vec<ShellReport> {
        let shells = self.matching.solids[0].shells.iter().zip(maps).zip(reports);
        let shells = shells.map(|((shell, found), report)| ShellReport {
            target: found.target,
            is_cavity: shell.is_cavity,
            genus: shell.genus,
            vertices: shell.vertices.len(),
            target_vertices: self.matching.solids[1].shells[found.target].vertices.len(),
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

fn no_area() -> PairError {
    AlignError::NoArea { side: "domain" }.into()
}
