//! Where a harmonic map is proved to be one to one, and where it is proved to fold.
//!
//! The Jacobian `J` of a [`HarmonicMap`] is known in closed form, and with it bounds over whole regions. An octree is laid
//! over the domain; in the ball around a cell the map is a harmonic polynomial, and what that leaves out has a
//! bound. Where the bounds exclude `det J = 0` from a cell, the map is regular everywhere in it, and the sign at its
//! centre is that of all of it. Other cells are divided, down to a smallest size.
//!
//! # What is proved
//!
//! In a cell that is [`Verdict::Positive`] every point has a neighbourhood that the map carries one to one, with the
//! orientation of the target; in one that is [`Verdict::Folded`] every point has one that is carried inside out. The
//! bounds are those of real numbers. Rounding of the sums is allowed for by `(N + 2¹⁴) 2⁻⁵³` of the sum of
//! the absolute terms, for `N` sources: that is meant to be more than the roundings on a term's way, and is no
//! interval arithmetic. Nothing is proved by samples.
//!
//! If no cell is folded or undecided, and the boundary map has degree one, then every point of the target that
//! is farther from its boundary than the largest boundary error of the map has exactly one preimage: the map and its
//! boundary map are homotopic without meeting the point, so that the signs of its preimages add up to one. Nearer to the
//! boundary this says nothing. Where cells stay undecided, and nothing is folded, it holds for points outside of their
//! images. The boundary error itself is measured by samples, not here. If a connected domain has positive and
//! folded cells, the map is not one to one: one that is has the same orientation everywhere.
//!
//! # References
//!
//! Greengard & Rokhlin, *A fast algorithm for particle simulations*, J. Comput. Phys. 73 (1987), for local expansions
//! and their translation; Ostrowski & Taussky, *On the variation of the determinant of a positive definite matrix*,
//! Indag. Math. 13 (1951).

mod bounds;
mod harmonics;
mod octree;
mod volume;

use std::collections::HashMap;

use octree::{CellIndex, ClosedCell, OctreeBuilder, OpenCell, Subdivision};
use volume::CellClipper;

use crate::Point;
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{HEXAHEDRON, SurfaceMesh};

/// How far a certificate goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CertificateOptions {
    /// Cells along the longest side of the domain at the finest level; rounded up to a power of two, 2 to 2²⁰.
    pub finest: usize,
    /// Limit on the number of cells: no level is begun that could bring more. A cell takes some 2 KB while it may be
    /// divided, 200 bytes afterwards.
    pub max_cells: usize,
    /// Ends when no larger share of the volume than this is undecided.
    pub undecided: f64,
}

impl Default for CertificateOptions {
    fn default() -> Self {
        Self {
            finest: 4096,
            max_cells: 1_000_000,
            undecided: 0.0,
        }
    }
}

/// What is known of the sign of `det J` in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It is that of the target's orientation everywhere in the cell.
    Positive,
    /// It is the other one everywhere in the cell.
    Folded,
    /// Neither is proved.
    Undecided,
}

/// A cell of the octree that was not divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CertificateCell {
    /// Lowest corner.
    pub low: Point,
    /// Side of the cube.
    pub size: f64,
    /// How often the box was halved.
    pub level: u8,
    /// The part of its volume in the domain.
    pub volume: f64,
    /// What is proved, of the whole cube.
    pub verdict: Verdict,
    /// Lower bound of the least singular value of `J` in the cell; 0 where undecided.
    pub sigma_min: f64,
    /// Lower bound of `|det J|` in the cell; 0 where undecided.
    pub det_bound: f64,
    /// `det J` at the centre, negative where it is folded, also for maps that reflect; no bound. Undecided cells may have
    /// their centre outside the domain, where it means little.
    pub det_centre: f64,
    steps: [u32; 3],
}

impl CertificateCell {
    /// Its centre.
    pub fn centre(&self) -> Point {
        self.low.map(|x| x + 0.5 * self.size)
    }
}

/// Cells with one verdict.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct VerdictTotals {
    /// How many.
    pub cells: usize,
    /// Their volume in the domain.
    pub volume: f64,
    /// That volume over the domain's.
    pub fraction: f64,
}

/// Why no cell was divided further.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// None is undecided.
    AllDecided,
    /// No more than [`CertificateOptions::undecided`] is.
    EnoughDecided,
    /// Those undecided have the size of [`CertificateOptions::finest`].
    Finest,
    /// There would be more than [`CertificateOptions::max_cells`].
    CellLimit,
}

/// What a certificate says as a whole.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CertificateReport {
    /// Volume of the domain.
    pub volume: f64,
    /// Cells proved to keep the orientation.
    pub positive: VerdictTotals,
    /// Cells proved to be turned inside out.
    pub folded: VerdictTotals,
    /// All others.
    pub undecided: VerdictTotals,
    /// Fraction of the domain's volume in undecided cells with `det J` negative at their centre: likely to be folded.
    pub undecided_negative: f64,
    /// Least lower bound of `|det J|` over the positive cells; `None` without any.
    pub det_bound: Option<f64>,
    /// Least lower bound of the smallest singular value over the positive cells; `None` without any.
    pub sigma_min: Option<f64>,
    /// The smallest singular value is at least this over 99 % of the domain's volume, where it keeps the orientation;
    /// `None` where less is proved.
    pub sigma_min_99: Option<f64>,
    /// Side of the smallest cell.
    pub finest_cell: f64,
    /// How often the box was halved for it.
    pub levels: u8,
    /// Why it ended there.
    #[serde(rename = "ending")]
    pub stop_reason: StopReason,
    /// Volumes of all cells over the domain's volume, less one.
    pub volume_error: f64,
}

/// The leaves of an octree over a domain, with what is proved in each.
#[derive(Debug, Clone)]
pub struct Certificate {
    /// The summary.
    pub report: CertificateReport,
    low: Point,
    side: f64,
    leaves: Vec<CertificateCell>,
}

/// How far the work is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CertificateProgress {
    /// The level whose cells are made.
    pub level: u8,
    /// Cells of the level above that have been divided.
    pub done: usize,
    /// Cells of the level above to divide.
    pub of: usize,
    /// Fraction of the volume that the level above left undecided.
    pub undecided: f64,
}

/// Why nothing can be certified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CertificateError {
    /// The map has a number that is none.
    #[error("source {source_index} of the map, or its coefficients, are not finite; fit the map again")]
    NonFiniteSource {
        /// Which source.
        source_index: usize,
    },
    /// The affine part has a number that is none.
    #[error("the affine part of the map is not finite; fit the map again")]
    NonFiniteAffine,
    /// The domain is no solid.
    #[error("the domain has a volume of {volume}; give a closed surface that is oriented outward")]
    NoVolume {
        /// Its volume.
        volume: f64,
    },
    /// The domain has holes.
    #[error(
        "the domain does not close: its volume is {volume}, that under its triangles {found}; `solidmap check` says where"
    )]
    Open {
        /// By the divergence theorem.
        volume: f64,
        /// By prisms between the triangles and the floor of the box.
        found: f64,
    },
    /// The orientation of the target decides which sign of `det J` is a fold.
    #[error("the target has a volume of {volume}, and so no orientation; give the signed volume of a solid")]
    NoOrientation {
        /// The volume that was given.
        volume: f64,
    },
    /// An option is out of its range.
    #[error("{name} is {value}, but must be {range}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is possible.
        range: &'static str,
    },
}

/// Deepest level: three coordinates of a cell share 64 bits.
const MOST_LEVELS: u8 = 20;
/// Cells that are divided between two reports of progress.
const GROUP: usize = 4096;
/// Relative difference between two ways to measure the volume of a closed surface.
const OPEN: f64 = 1e-6;

/// Certifies the sign of `det J` over a domain, as far as `options` allow.
///
/// `target_volume` is the signed volume of the target, negative when the map reflects
/// ([`crate::boundary_map::BoundaryMap::target_volume`]). Cells across the boundary are certified as a whole, also where
/// they reach out of the domain; their volume is exactly that of the part inside. The result does not depend on the number
/// of threads.
///
/// Some 20 µs for every cell. Cells have to be smaller than the distance to the nearest source, so that their number
/// grows with that of the sources; where `det J` has zeros it grows fourfold with every level.
///
/// # Errors
///
/// [`CertificateError`].
pub fn certify(
    map: &HarmonicMap,
    domain: &SurfaceMesh,
    target_volume: f64,
    options: &CertificateOptions,
    progress: &dyn Fn(CertificateProgress),
) -> Result<Certificate, CertificateError> {
    require_finite(map)?;
    require_options(options)?;
    if target_volume == 0.0 || !target_volume.is_finite() {
        return Err(CertificateError::NoOrientation { volume: target_volume });
    }
    let (low, side) = cube_around(domain)?;
    let builder = OctreeBuilder::new(map, CellClipper::new(domain, &low, side), low, side);
    let root = builder.root(map);
    let (volume, found) = (domain.volume(), root.volume * side.powi(3));
    if (found / volume - 1.0).abs() > OPEN {
        return Err(CertificateError::Open { volume, found });
    }

    let (ended, stop_reason) = descend(&builder, root, options, progress);
    let mut leaves: Vec<CertificateCell> = ended
        .iter()
        .map(|ended| leaf(&builder, ended, target_volume.signum()))
        .collect();
    leaves.sort_unstable_by_key(|leaf| curve_key(leaf.level, leaf.steps));
    look_into_undecided(map, target_volume.signum(), &mut leaves);
    Ok(Certificate {
        report: summary(&leaves, volume, stop_reason),
        low,
        side,
        leaves,
    })
}

impl Certificate {
    /// All cells that reach into the domain, along a space-filling curve.
    pub fn cells(&self) -> &[CertificateCell] {
        &self.leaves
    }

    /// The cell that a point is in. `None` where no cell reaches into the domain.
    pub fn cell_at(&self, point: &Point) -> Option<&CertificateCell> {
        let within = (point - self.low) / self.side;
        if within.iter().any(|x| !(0.0..=1.0).contains(x)) {
            return None;
        }
        let most = 2f64.powi(MOST_LEVELS.into());
        let steps = within.map(|x| (x * most).min(most - 1.0) as u32);
        let key = curve_key(MOST_LEVELS, steps.into());
        let after = self
            .leaves
            .partition_point(|leaf| curve_key(leaf.level, leaf.steps) <= key);
        let leaf = &self.leaves[..after].last()?;
        let cells = 1u64 << (3 * (MOST_LEVELS - leaf.level));
        (key - curve_key(leaf.level, leaf.steps) < cells).then_some(leaf)
    }

    /// The leaves as hexahedra in VTK's order of corners; equal corners are one point.
    pub fn hexahedra(&self) -> (Vec<Point>, Vec<[u32; 8]>) {
        let unit = self.side / 2f64.powi(MOST_LEVELS.into());
        let (mut index, mut points) = (HashMap::new(), Vec::new());
        let hexahedra = self.leaves.iter().map(|leaf| {
            HEXAHEDRON.map(|corner| {
                let key: [u32; 3] =
                    std::array::from_fn(|k| (leaf.steps[k] + u32::from(corner[k])) << (MOST_LEVELS - leaf.level));
                *index.entry(key).or_insert_with(|| {
                    points.push(Point::from(std::array::from_fn(|k| {
                        self.low[k] + f64::from(key[k]) * unit
                    })));
                    (points.len() - 1) as u32
                })
            })
        });
        let hexahedra = hexahedra.collect();
        (points, hexahedra)
    }
}

fn require_finite(map: &HarmonicMap) -> Result<(), CertificateError> {
    let coefficients = map.coefficients();
    if !coefficients.affine.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(CertificateError::NonFiniteAffine);
    }
    let is_finite = |(p, w): (&Point, &[f64; 3])| p.iter().chain(w).all(|x| x.is_finite());
    let mut sources = map.sources().iter().zip(&coefficients.sources);
    match sources.position(|source| !is_finite(source)) {
        Some(source_index) => Err(CertificateError::NonFiniteSource { source_index }),
        None => Ok(()),
    }
}

fn require_options(options: &CertificateOptions) -> Result<(), CertificateError> {
    let refuse = |name, value, range| Err(CertificateError::Option { name, value, range });
    if options.finest < 2 || options.finest > 1 << MOST_LEVELS {
        return refuse("the number of finest cells", options.finest as f64, "from 2 to 1048576");
    }
    if options.max_cells < 8 {
        return refuse("the limit on cells", options.max_cells as f64, "at least 8");
    }
    if !(0.0..1.0).contains(&options.undecided) {
        return refuse("the undecided share", options.undecided, "from 0 to less than 1");
    }
    Ok(())
}

/// Lowest corner and side of the cube from the lowest corner of the domain: on a domain that is a cube, no cell reaches
/// across its boundary.
fn cube_around(domain: &SurfaceMesh) -> Result<(Point, f64), CertificateError> {
    let volume = domain.volume();
    let no_volume = CertificateError::NoVolume { volume };
    if !(volume > 0.0 && volume.is_finite()) {
        return Err(no_volume);
    }
    let used = || {
        domain
            .triangles()
            .iter()
            .flatten()
            .map(|&v| domain.vertices()[v as usize])
    };
    let low = used().reduce(|a, b| a.inf(&b)).ok_or_else(|| no_volume.clone())?;
    let high = used().reduce(|a, b| a.sup(&b)).ok_or_else(|| no_volume.clone())?;
    let side = (high - low).max();
    // Neither volumes nor their reciprocals may leave the range of numbers.
    if side.powi(3).is_normal() && side.powi(-3).is_normal() {
        Ok((low, side))
    } else {
        Err(no_volume)
    }
}

/// Divides level by level.
fn descend(
    builder: &OctreeBuilder,
    root: OpenCell,
    options: &CertificateOptions,
    progress: &dyn Fn(CertificateProgress),
) -> (Vec<ClosedCell>, StopReason) {
    let levels = options.finest.next_power_of_two().ilog2() as u8;
    let volume = root.volume;
    let (mut found, mut last) = (Subdivision::of(root), false);
    for level in 1..=levels {
        let cells = std::mem::take(&mut found.cells);
        let undecided = cells.iter().map(|cell| cell.volume).sum::<f64>() / volume;
        if cells.is_empty() || undecided <= options.undecided {
            found.cells = cells;
            break;
        }
        last |= level == levels;
        for (group, some) in cells.chunks(GROUP).enumerate() {
            progress(CertificateProgress {
                level,
                done: group * GROUP,
                of: cells.len(),
                undecided,
            });
            found.append(builder.divide(some, last));
            if found.ended.len() + 8 * found.cells.len() > options.max_cells {
                // There is no further level, so that nothing is kept for it.
                last = true;
                found.end();
            }
        }
        if last && level < levels {
            let stop_reason = ending_of(&found, StopReason::CellLimit);
            return (found.ended, stop_reason);
        }
    }
    let stop_reason = ending_of(
        &found,
        if last {
            StopReason::Finest
        } else {
            StopReason::EnoughDecided
        },
    );
    found.end();
    (found.ended, stop_reason)
}

fn ending_of(found: &Subdivision, otherwise: StopReason) -> StopReason {
    let all = found.cells.is_empty() && found.ended.iter().all(|cell| cell.found.is_some());
    if all { StopReason::AllDecided } else { otherwise }
}

fn leaf(builder: &OctreeBuilder, ended: &ClosedCell, orientation: f64) -> CertificateCell {
    let CellIndex { level, steps } = ended.place;
    let (low, size) = builder.cube(&ended.place);
    let cube = builder.cube(&CellIndex {
        level: 0,
        steps: [0; 3],
    });
    let (verdict, det_centre, bounds) = match ended.found {
        Some((det, bounds)) if det * orientation > 0.0 => (Verdict::Positive, det, Some(bounds)),
        Some((det, bounds)) => (Verdict::Folded, det, Some(bounds)),
        None => (Verdict::Undecided, f64::NAN, None),
    };
    CertificateCell {
        low,
        size,
        level,
        volume: ended.volume * cube.1.powi(3),
        verdict,
        sigma_min: bounds.map_or(0.0, |b| b.sigma_min),
        det_bound: bounds.map_or(0.0, |b| b.det),
        det_centre: det_centre * orientation,
        steps,
    }
}

/// Determinants at the centres of undecided cells, which many of them are too large to expand.
fn look_into_undecided(map: &HarmonicMap, orientation: f64, leaves: &mut [CertificateCell]) {
    let mut undecided: Vec<&mut CertificateCell> = leaves
        .iter_mut()
        .filter(|leaf| leaf.verdict == Verdict::Undecided)
        .collect();
    let centres: Vec<Point> = undecided.iter().map(|leaf| leaf.centre()).collect();
    for (leaf, jacobian) in undecided.iter_mut().zip(map.jacobian(&centres)) {
        leaf.det_centre = jacobian.determinant() * orientation;
    }
}

fn summary(leaves: &[CertificateCell], volume: f64, stop_reason: StopReason) -> CertificateReport {
    let with = |verdict| leaves.iter().filter(move |leaf| leaf.verdict == verdict);
    let share = |verdict| {
        let found = total(&mut with(verdict));
        VerdictTotals {
            cells: with(verdict).count(),
            volume: found,
            fraction: found / volume,
        }
    };
    let least = |value: fn(&CertificateCell) -> f64| with(Verdict::Positive).map(value).reduce(f64::min);
    let finest = leaves.iter().max_by_key(|leaf| leaf.level);
    let mut negative = with(Verdict::Undecided).filter(|leaf| leaf.det_centre < 0.0);
    CertificateReport {
        volume,
        positive: share(Verdict::Positive),
        folded: share(Verdict::Folded),
        undecided: share(Verdict::Undecided),
        undecided_negative: total(&mut negative) / volume,
        det_bound: least(|leaf| leaf.det_bound),
        sigma_min: least(|leaf| leaf.sigma_min),
        sigma_min_99: bound_over(0.99 * volume, with(Verdict::Positive)),
        finest_cell: finest.map_or(0.0, |leaf| leaf.size),
        levels: finest.map_or(0, |leaf| leaf.level),
        stop_reason,
        volume_error: total(&mut leaves.iter()) / volume - 1.0,
    }
}

/// The largest bound of singular values that holds over this volume.
fn bound_over<'a>(volume: f64, leaves: impl Iterator<Item = &'a CertificateCell>) -> Option<f64> {
    let mut leaves: Vec<&CertificateCell> = leaves.collect();
    leaves.sort_by(|a, b| b.sigma_min.total_cmp(&a.sigma_min));
    let mut covered = 0.0;
    let reaches = |leaf: &&&CertificateCell| {
        covered += leaf.volume;
        covered >= volume
    };
    leaves.iter().find(reaches).map(|leaf| leaf.sigma_min)
}

/// Volume of cells in the domain.
fn total(leaves: &mut dyn Iterator<Item = &CertificateCell>) -> f64 {
    leaves.fold(0.0, |sum, leaf| sum + leaf.volume)
}

/// Position of a cell's lowest corner along Morton's curve through the cells of the deepest level.
fn curve_key(level: u8, steps: [u32; 3]) -> u64 {
    let mut key = 0;
    for (axis, step) in steps.into_iter().enumerate() {
        let step = step << (MOST_LEVELS - level);
        for bit in 0..MOST_LEVELS {
            key |= u64::from(step >> bit & 1) << (3 * u32::from(bit) + axis as u32);
        }
    }
    key
}
