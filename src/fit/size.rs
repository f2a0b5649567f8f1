//! How much memory a fit will need, before any of it is taken.
//!
//! The constants are fitted to the peak resident set of whole runs of the program (x86-64, Linux), of which they are within
//! 30 %: Schwarz fits of 5k to 1M vertices at several ratios of sources and collocation points to vertices, refined ones
//! of up to six rounds, and dense ones of 100 to 4000 sources; one to sixteen threads.

use super::options::PointCounts;
use super::{FitError, FitMethod, FitOptions, RefinementEnd, distant};
use crate::memory::{readable, solver_addresses};
use crate::mesh::SurfaceMesh;
use crate::solver::{Decomposition, SchwarzOptions};

/// The size of a fit, as far as memory goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitSize {
    /// Boundary vertices of the domain.
    pub vertices: usize,
    /// Sources of all levels.
    pub sources: usize,
    /// Collocation points.
    pub collocation: usize,
    /// Boundary maps that are solved for at once.
    pub maps: usize,
    /// Rounds of refinement, each with a level of its own.
    pub refinements: usize,
    /// Entries of the factored patches of the Schwarz solver; `None` before points are placed, when they are estimated for
    /// uniformly spaced sources. A graded spacing makes them up to twice as many.
    pub patch_entries: Option<u64>,
    /// How the system is solved.
    pub method: FitMethod,
    /// Whether the sources are moved.
    pub free_sources: bool,
    /// Threads that work at once, each with room of its own.
    pub threads: usize,
}

impl FitSize {
    /// The size of a fit before refinement.
    pub fn of(domain: &SurfaceMesh, options: &FitOptions) -> Self {
        let counts = PointCounts::of(domain, options);
        let sources = match options.method {
            FitMethod::Schwarz { .. } => (counts.sources as f64 * WITH_COARSER_LEVELS) as usize,
            FitMethod::Dense { .. } => counts.sources,
        };
        Self {
            vertices: domain.vertices().len(),
            sources,
            collocation: counts.collocation,
            maps: 1,
            refinements: 0,
            patch_entries: None,
            method: options.method,
            free_sources: options.free_sources,
            threads: rayon::current_num_threads(),
        }
    }

    /// Peak memory in bytes, including the program and its input meshes.
    pub fn bytes(&self) -> u64 {
        let vertices = self.vertices as f64;
        let kept = PER_VERTEX * vertices + self.system_bytes();
        (PROGRAM + PER_THREAD * self.threads as f64 + kept.max(PER_VERTEX_CHECKED * vertices)) as u64
    }

    fn system_bytes(&self) -> f64 {
        let (rows, sources) = (self.collocation as f64, self.sources as f64);
        let others = self.maps.saturating_sub(1) as f64;
        let more_maps = PER_POINT_AND_MAP * others * (rows + sources);
        more_maps
            + match self.method {
                FitMethod::Schwarz { options, .. } => {
                    let rounds = self.refinements as f64;
                    let per_row = PER_ROW + PER_ROW_AND_ROUND * rounds;
                    let local = match self.patch_entries {
                        Some(entries) => 4.0 * entries as f64,
                        None => 4.0 * uniform_patch_sources(&options) * sources,
                    };
                    per_row * rows + PER_SOURCE * sources + local + coarsest(sources) + distant::BYTES
                }
                FitMethod::Dense { options, .. } => {
                    let (tall, square) = (8.0 * rows * sources, 8.0 * sources * sources);
                    let decomposed = match options.decomposition {
                        Decomposition::Qr => 1.15 * tall,
                        Decomposition::Svd => 3.3 * tall + 8.0 * square,
                    };
                    match self.free_sources {
                        // The decomposition at the start is kept meanwhile.
                        true => decomposed + moving_sources(tall, square),
                        false => decomposed,
                    }
                }
            }
    }

    /// How many sources, with collocation points in proportion, a budget has room for.
    fn fitting_sources(&self, allowed: u64) -> usize {
        let ratio = self.collocation as f64 / self.sources.max(1) as f64;
        let fits = |sources: usize| {
            let collocation = (ratio * sources as f64) as usize;
            let local = |entries: u64| (entries as f64 * sources as f64 / self.sources.max(1) as f64) as u64;
            let fewer = Self {
                sources,
                collocation,
                patch_entries: self.patch_entries.map(local),
                ..*self
            };
            fewer.bytes() <= allowed
        };
        let (mut enough, mut too_many) = (0, self.sources);
        while too_many - enough > 1 {
            let middle = enough + (too_many - enough) / 2;
            if fits(middle) {
                enough = middle
            } else {
                too_many = middle
            }
        }
        match self.method {
            FitMethod::Schwarz { .. } => (enough as f64 / WITH_COARSER_LEVELS) as usize,
            FitMethod::Dense { .. } => enough,
        }
    }

    /// Refuses what needs more memory than allowed.
    pub(super) fn require_memory(&self, options: &FitOptions) -> Result<(), FitError> {
        let Some(allowed) = options.memory else { return Ok(()) };
        let need = self.bytes();
        if need <= allowed {
            return Ok(());
        }
        Err(FitError::TooLarge {
            sources: self.sources,
            collocation: self.collocation,
            need,
            allowed,
            fitting: self.fitting_sources(allowed),
            addresses_are_short: solver_addresses().is_some_and(|left| left < need),
        })
    }

    /// The limit that a refined fit of this size exceeds, with a warning that says so.
    pub(super) fn exceeded_limit(&self, options: &FitOptions) -> Option<(RefinementEnd, String)> {
        let warning = |limit: String| {
            let sources = self.sources;
            format!("refinement ended before the tolerance was met: it calls for {sources} sources, {limit}")
        };
        let most = options.most_refined_sources(self.vertices);
        if self.sources > most {
            let (end, option) = match most < options.max_sources {
                true => (RefinementEnd::MaxSourceRatio, "`max_source_ratio`"),
                false => (RefinementEnd::MaxSources, "`max_sources`"),
            };
            let limit = format!("and {most} are allowed; {option} raises the limit");
            return Some((end, warning(limit)));
        }
        let (need, allowed) = (self.bytes(), options.memory?);
        (need > allowed).then(|| {
            let (need, allowed) = (readable(need), readable(allowed));
            let limit = format!("which need about {need}, and {allowed} are allowed; `memory` raises the limit");
            (RefinementEnd::Memory, warning(limit))
        })
    }
}

/// All sources over those of the finest level: each level has a twelfth of the next finer's.
const WITH_COARSER_LEVELS: f64 = 12.0 / 11.0;

/// Bytes of the program itself and the tables of the fast sums.
const PROGRAM: f64 = 20e6;
/// Bytes for each thread: what it works with, and what the allocator keeps for it.
const PER_THREAD: f64 = 10e6;
/// Bytes kept for each vertex and its two triangles: the domain, the image, and what sorts them in space.
const PER_VERTEX: f64 = 500.0;
/// Bytes taken for each vertex while the domain is checked; they are free again when the system is factored.
const PER_VERTEX_CHECKED: f64 = 1000.0;
/// Bytes for each collocation point: its part in the vectors of the iterations and in the trees of the fast sums.
const PER_ROW: f64 = 660.0;
/// Bytes for each collocation point in the tree that each round of refinement adds.
const PER_ROW_AND_ROUND: f64 = 100.0;
/// Bytes for each row and source and each further boundary map: ten vectors of three entries.
const PER_POINT_AND_MAP: f64 = 240.0;

/// Bytes for each source in trees and vectors.
const PER_SOURCE: f64 = 600.0;

/// Bytes for moving free sources, from those of a matrix of the system and of a square one of its sources: the derivatives or the step,
/// whichever takes more, and what the allocator does not give back of the other.
fn moving_sources(tall: f64, square: f64) -> f64 {
    let work = (4.0 * tall + 13.0 * square).max(tall + 28.0 * square);
    work + (0.7 * work).min(60e6)
}

/// Number of sources of a patch where they are uniformly spaced: the length of a column of its inverse.
fn uniform_patch_sources(options: &SchwarzOptions) -> f64 {
    ((options.core as f64).sqrt() + 2.0 * options.overlap).powi(2)
}

/// Bytes for the coarsest level, which is dense, with six rows per source, and a copy while it is decomposed. It has
/// usually some 560 sources; up to 1500 when there is no other level.
fn coarsest(sources: f64) -> f64 {
    let coarsest = sources.min(560.0);
    2.0 * 8.0 * 6.0 * coarsest * coarsest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::DenseOptions;

    fn dense(decomposition: Decomposition) -> FitMethod {
        FitMethod::Dense {
            placement: FitMethod::default().placement(),
            options: DenseOptions {
                decomposition,
                ..DenseOptions::default()
            },
        }
    }

    /// Vertices, sources, collocation points and the measured peak in MB.
    #[test]
    fn estimates_are_within_30_percent_of_measured_peaks() {
        let schwarz = FitMethod::default();
        let (qr, svd) = (dense(Decomposition::Qr), dense(Decomposition::Svd));
        let unrefined = [
            (schwarz, 4842, 5246, 14_522, 72.9),
            (schwarz, 15_002, 16_564, 45_002, 111.2),
            (schwarz, 50_412, 54_995, 151_232, 247.1),
            (schwarz, 50_412, 54_995, 302_277, 333.6),
            (schwarz, 50_412, 16_923, 151_232, 199.7),
            (schwarz, 134_345, 146_774, 403_031, 584.0),
            (schwarz, 134_345, 11_110, 30_000, 164.9),
            (schwarz, 316_842, 345_814, 950_522, 1207.2),
            (schwarz, 998_562, 1_089_289, 2_995_682, 3721.2),
            (qr, 134_345, 100, 300, 170.0),
            (qr, 15_002, 999, 3000, 59.6),
            (qr, 15_002, 4000, 11_996, 444.9),
            (svd, 15_002, 2000, 6000, 616.3),
        ];
        let refined = [
            (2, (schwarz, 4331, 10_812, 31_262, 126.3)),
            (2, (schwarz, 6256, 7416, 20_678, 122.3)),
            (2, (schwarz, 4331, 64_987, 193_787, 356.3)),
            (2, (schwarz, 6256, 94_938, 283_244, 458.2)),
            (3, (schwarz, 4331, 50_585, 150_581, 279.8)),
            (6, (schwarz, 6256, 52_225, 155_105, 318.9)),
        ];
        let fixed = unrefined.map(|run| (0, run)).into_iter().chain(refined);
        let free = [
            (qr, 2930, 300, 4800, 151.9),
            (qr, 2930, 600, 1800, 197.9),
            (qr, 2930, 900, 14_310, 675.8),
        ];
        let runs = fixed.map(|run| (false, run)).chain(free.map(|run| (true, (0, run))));
        for (free_sources, (refinements, run)) in runs {
            let (method, vertices, sources, collocation, measured) = run;
            let size = FitSize {
                vertices,
                sources,
                collocation,
                maps: 1,
                refinements,
                patch_entries: None,
                method,
                free_sources,
                threads: 2,
            };
            let ratio = size.bytes() as f64 / (measured * 1e6);
            assert!((0.7..1.3).contains(&ratio), "{size:?}: {ratio:.2}");
        }
    }

    #[test]
    fn the_number_of_sources_said_to_fit_fits() {
        let size = FitSize {
            vertices: 1_000_000,
            sources: 1_090_909,
            collocation: 3_000_000,
            maps: 1,
            refinements: 0,
            patch_entries: None,
            method: FitMethod::default(),
            free_sources: false,
            threads: 2,
        };
        let options = FitOptions {
            memory: Some(2_000_000_000),
            ..FitOptions::default()
        };
        let Err(FitError::TooLarge { need, fitting, .. }) = size.require_memory(&options) else {
            panic!("6 GB do not fit into 2");
        };
        assert_eq!(need, size.bytes());
        let fewer = FitSize {
            sources: (fitting as f64 * WITH_COARSER_LEVELS) as usize,
            collocation: 3 * fitting,
            ..size
        };
        assert!(fewer.require_memory(&options).is_ok());
        assert!(fitting > 100_000);
    }
}
