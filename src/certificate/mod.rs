//! Certificates: where a harmonic map is proved to be locally one to one, and where it is proved to fold.
//!
//! The Jacobian `J` of a [`HarmonicMap`] is known in closed form, and with it bounds over whole regions. An octree is
//! laid over the domain; in the ball around a cell the map is a harmonic polynomial plus a remainder with a known
//! bound. Where the bounds exclude `det J = 0` from a cell, the map is regular everywhere in it, with the sign of its
//! centre. Other cells are divided, down to a smallest size.
//!
//! # What is proved
//!
//! In a cell that is [`Verdict::Positive`] the map is locally one to one with the orientation of the target; in one
//! that is [`Verdict::Folded`] it is locally one to one with the opposite orientation. The bounds hold in exact
//! arithmetic. Rounding of the sums is allowed for by `(N + 2¹⁴) 2⁻⁵³` of the sum of the absolute terms, for `N`
//! sources: this is meant to exceed the rounding errors of each term, but is not interval arithmetic. Nothing is proved
//! by samples.
//!
//! If no cell is folded or undecided, and the boundary map has degree one, then every point of the target that is
//! farther from its boundary than the largest boundary error of the map has exactly one preimage: the map and its
//! boundary map are homotopic without meeting the point, so that the signs of its preimages add up to one. Nearer to
//! the boundary this says nothing. Where cells stay undecided, and nothing is folded, it holds for points outside of
//! their images. The boundary error itself is measured by samples, not here. If a connected domain has positive and
//! folded cells, the map is not one to one: one that is has the same orientation everywhere.
//!
//! # References
//!
//! Greengard & Rokhlin, *A fast algorithm for particle simulations*, J. Comput. Phys. 73 (1987), for local expansions
//! and their translation; Ostrowski & Taussky, *On the variation of the determinant of a positive definite matrix*,
//! Indag. Math. 13 (1951).

mod bounds;
mod harmonics;
mod mirrored;
mod octree;
mod places;
mod volume;

use std::collections::HashMap;
use std::ops::ControlFlow;

use octree::{CellIndex, ClosedCell, OctreeBuilder, OpenCell, Subdivision};
use volume::CellClipper;

use crate::Point;
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{HEXAHEDRON, SurfaceMesh};
use crate::progress::ProgressResponse;

/// Options of [`certify`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CertificateOptions {
    /// Cells along the longest side of the domain at the finest level; rounded up to a power of two, 2 to 2²⁰.
    pub finest: usize,
    /// Limit on the number of cells: no level is started that could exceed it. A cell takes some 2 KB while it may be
    /// divided, 200 bytes afterwards.
    pub max_cells: usize,
    /// Stops when at most this fraction of the volume is undecided.
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

/// What is proved about the sign of `det J` in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// `det J` has the sign of the target's orientation everywhere in the cell.
    Positive,
    /// `det J` has the opposite sign everywhere in the cell.
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
    /// Volume of the part inside the domain.
    pub volume: f64,
    /// What is proved for the whole cube.
    pub verdict: Verdict,
    /// Lower bound of the least singular value of `J` in the cell; 0 where undecided.
    pub sigma_min: f64,
    /// Lower bound of `|det J|` in the cell; 0 where undecided.
    pub det_bound: f64,
    /// `det J` at the centre, negative in folded cells, also for maps that reflect; not a bound. Undecided cells may
    /// have their centre outside the domain, where it means little.
    pub det_centre: f64,
    steps: [u32; 3],
}

impl CertificateCell {
    /// Its centre.
    pub fn centre(&self) -> Point {
        self.low.map(|x| x + 0.5 * self.size)
    }
}

/// The cells with the same verdict.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct VerdictTotals {
    /// How many.
    pub cells: usize,
    /// Their volume in the domain.
    pub volume: f64,
    /// That volume as a fraction of the domain's.
    pub fraction: f64,
}

/// Why the subdivision stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// No cell is undecided.
    AllDecided,
    /// At most the fraction [`CertificateOptions::undecided`] is undecided.
    EnoughDecided,
    /// Undecided cells have the size of [`CertificateOptions::finest`].
    Finest,
    /// There would be more than [`CertificateOptions::max_cells`].
    CellLimit,
}

/// Summary of a certificate.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CertificateReport {
    /// Volume of the domain.
    pub volume: f64,
    /// Cells proved to preserve the orientation.
    pub positive: VerdictTotals,
    /// Cells proved to be folded: `det J` has not the sign of the target's orientation anywhere in them.
    pub folded: VerdictTotals,
    /// All others.
    pub undecided: VerdictTotals,
    /// Fraction of the domain's volume in undecided cells with `det J` negative at their centre: likely to be folded.
    pub undecided_negative: f64,
    /// Least lower bound of `|det J|` over the positive cells; `None` without any.
    pub det_bound: Option<f64>,
    /// Least lower bound of the smallest singular value over the positive cells; `None` without any.
    pub sigma_min: Option<f64>,
    /// The smallest singular value is at least this, and the orientation preserved, over 99 % of the domain's volume;
    /// `None` where less is proved.
    pub sigma_min_99: Option<f64>,
    /// Side of the smallest cell.
    pub finest_cell: f64,
    /// Level of the smallest cell.
    pub levels: u8,
    /// Why the subdivision stopped.
    pub stop_reason: StopReason,
    /// Volumes of all cells over the domain's volume, less one.
    pub volume_error: f64,
    /// Parts of the domain that the map turns inside out as a whole; only looked for where a cell is proved folded.
    pub mirrored: MirroredParts,
}

/// Parts of a domain whose orientation a map reverses: everything in them is folded, though nothing in them folds over.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct MirroredParts {
    /// How many.
    pub count: usize,
    /// Parts of the domain; 0 where they were not looked for.
    pub parts: usize,
    /// Volume of the mirrored ones as a fraction of that of all, cavities included in both.
    pub fraction: f64,
}

/// The leaf cells of an octree over a domain, with what is proved in each.
#[derive(Debug, Clone)]
pub struct Certificate {
    /// The summary.
    pub report: CertificateReport,
    low: Point,
    side: f64,
    /// Sign of the target's volume.
    orientation: f64,
    cells: Vec<CertificateCell>,
}

/// Progress of [`certify`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CertificateProgress {
    /// The level whose cells are being made.
    pub level: u8,
    /// Cells of the level above that are divided already.
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
    /// A source or its coefficients are not finite.
    #[error("source {source_index} of the map, or its coefficients, are not finite; fit the map again")]
    NonFiniteSource {
        /// Which source.
        source_index: usize,
    },
    /// The affine part is not finite.
    #[error("the affine part of the map is not finite; fit the map again")]
    NonFiniteAffine,
    /// The domain does not bound a solid.
    #[error("the domain has a volume of {volume}; give a closed surface that is oriented outward")]
    NoVolume {
        /// Its volume.
        volume: f64,
    },
    /// The domain is not closed.
    #[error(
        "the domain is not closed: its volume is {volume} by the divergence theorem, but {found} by vertical prisms; \
         `solidmap check` says where it is open"
    )]
    Open {
        /// Volume by the divergence theorem.
        volume: f64,
        /// Volume of the prisms between the triangles and the floor of the box.
        found: f64,
    },
    /// The target has no volume, whose sign decides which sign of `det J` is a fold.
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
    /// A progress callback cancelled the work.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

/// Deepest level: the three coordinates of a cell fit into 64 bits.
const MAX_LEVELS: u8 = 20;
/// Cells that are divided between two reports of progress.
const GROUP: usize = 4096;
/// Relative difference between two ways to compute the volume beyond which a surface is not closed.
const OPEN: f64 = 1e-6;

/// Proves the sign of `det J` over a domain, as far as `options` allow.
///
/// `target_volume` is the signed volume of the target, negative when the map reflects
/// ([`crate::boundary_map::BoundaryMap::target_volume`]). Cells across the boundary are certified as a whole, also
/// where they reach out of the domain; their volume is exactly that of the part inside. The result does not depend on
/// the number of threads.
///
/// Takes some 20 µs per cell. Cells have to be smaller than the distance to the nearest source, so that their number
/// grows with that of the sources; where `det J` has zeros it grows fourfold with every level.
///
/// # Errors
///
/// [`CertificateError`]; [`CertificateError::Cancelled`] when `progress` cancels it ([`ProgressResponse`]).
pub fn certify<A: ProgressResponse>(
    map: &HarmonicMap,
    domain: &SurfaceMesh,
    target_volume: f64,
    options: &CertificateOptions,
    progress: &dyn Fn(CertificateProgress) -> A,
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

    let report = |progress_made| progress(progress_made).control_flow();
    let (closed, stop_reason) = descend(&builder, root, options, &report).ok_or(CertificateError::Cancelled)?;
    let orientation = target_volume.signum();
    let mut cells: Vec<CertificateCell> = closed
        .iter()
        .map(|closed| certificate_cell(&builder, closed, orientation))
        .collect();
    cells.sort_unstable_by_key(|cell| curve_key(cell.level, cell.steps));
    // By the map itself: many undecided cells are too large for an expansion.
    let undecided = cells.iter_mut().filter(|cell| cell.verdict == Verdict::Undecided);
    set_determinants(map, orientation, undecided);
    let mut report = summary(&cells, volume, stop_reason);
    if report.folded.cells > 0 {
        report.mirrored = MirroredParts::find(map, domain, orientation);
    }
    Ok(Certificate {
        report,
        low,
        side,
        orientation,
        cells,
    })
}

impl Certificate {
    /// All cells that intersect the domain, along a space-filling curve.
    pub fn cells(&self) -> &[CertificateCell] {
        &self.cells
    }

    /// The cell that contains a point; `None` where no cell intersects the domain.
    pub fn cell_at(&self, point: &Point) -> Option<&CertificateCell> {
        let within = (point - self.low) / self.side;
        if within.iter().any(|x| !(0.0..=1.0).contains(x)) {
            return None;
        }
        let most = 2f64.powi(MAX_LEVELS.into());
        let steps = within.map(|x| (x * most).min(most - 1.0) as u32);
        let key = curve_key(MAX_LEVELS, steps.into());
        let after = self
            .cells
            .partition_point(|cell| curve_key(cell.level, cell.steps) <= key);
        let cell = &self.cells[..after].last()?;
        let cells = 1u64 << (3 * (MAX_LEVELS - cell.level));
        (key - curve_key(cell.level, cell.steps) < cells).then_some(cell)
    }

    /// The cells as hexahedra in VTK's order of corners; equal corners are one point.
    pub fn hexahedra(&self) -> (Vec<Point>, Vec<[u32; 8]>) {
        let unit = self.side / 2f64.powi(MAX_LEVELS.into());
        let (mut index, mut points) = (HashMap::new(), Vec::new());
        let hexahedra = self.cells.iter().map(|cell| {
            HEXAHEDRON.map(|corner| {
                let key: [u32; 3] =
                    std::array::from_fn(|k| (cell.steps[k] + u32::from(corner[k])) << (MAX_LEVELS - cell.level));
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
    if options.finest < 2 || options.finest > 1 << MAX_LEVELS {
        return refuse(
            "the number of finest cells along the longest side",
            options.finest as f64,
            "from 2 to 1048576",
        );
    }
    if options.max_cells < 8 {
        return refuse("the limit on cells", options.max_cells as f64, "at least 8");
    }
    if !(0.0..1.0).contains(&options.undecided) {
        return refuse("the undecided fraction", options.undecided, "from 0 to less than 1");
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
    let corners = domain.triangles().iter().flatten();
    let used = corners.map(|&v| domain.vertices()[v as usize]);
    let low = used.clone().reduce(|a, b| a.inf(&b));
    let Some((low, high)) = low.zip(used.reduce(|a, b| a.sup(&b))) else {
        return Err(no_volume);
    };
    let side = (high - low).max();
    // Neither volumes nor their reciprocals may overflow or vanish.
    if side.powi(3).is_normal() && side.powi(-3).is_normal() {
        Ok((low, side))
    } else {
        Err(no_volume)
    }
}

/// Divides cells level by level; `None` when cancelled.
fn descend(
    builder: &OctreeBuilder,
    root: OpenCell,
    options: &CertificateOptions,
    progress: &dyn Fn(CertificateProgress) -> ControlFlow<()>,
) -> Option<(Vec<ClosedCell>, StopReason)> {
    let levels = options.finest.next_power_of_two().ilog2() as u8;
    let volume = root.volume;
    let (mut found, mut last) = (Subdivision::of(root), false);
    for level in 1..=levels {
        let cells = std::mem::take(&mut found.open);
        let undecided = cells.iter().map(|cell| cell.volume).sum::<f64>() / volume;
        if cells.is_empty() || undecided <= options.undecided {
            found.open = cells;
            break;
        }
        last |= level == levels;
        for (group, some) in cells.chunks(GROUP).enumerate() {
            let so_far = CertificateProgress {
                level,
                done: group * GROUP,
                of: cells.len(),
                undecided,
            };
            if progress(so_far).is_break() {
                return None;
            }
            found.append(builder.divide(some, last));
            if found.closed.len() + 8 * found.open.len() > options.max_cells {
                // No further level follows, so that nothing is kept for it.
                last = true;
                found.close_all();
            }
        }
        if last && level < levels {
            let stop_reason = stop_reason_of(&found, StopReason::CellLimit);
            return Some((found.closed, stop_reason));
        }
    }
    let otherwise = if last {
        StopReason::Finest
    } else {
        StopReason::EnoughDecided
    };
    let stop_reason = stop_reason_of(&found, otherwise);
    found.close_all();
    Some((found.closed, stop_reason))
}

fn stop_reason_of(found: &Subdivision, otherwise: StopReason) -> StopReason {
    let all = found.open.is_empty() && found.closed.iter().all(|cell| cell.found.is_some());
    if all { StopReason::AllDecided } else { otherwise }
}

fn certificate_cell(builder: &OctreeBuilder, closed: &ClosedCell, orientation: f64) -> CertificateCell {
    let CellIndex { level, steps } = closed.index;
    let (low, size) = builder.cube(&closed.index);
    let (verdict, det_centre, bounds) = match closed.found {
        Some((det, bounds)) if det * orientation > 0.0 => (Verdict::Positive, det, Some(bounds)),
        Some((det, bounds)) => (Verdict::Folded, det, Some(bounds)),
        None => (Verdict::Undecided, f64::NAN, None),
    };
    CertificateCell {
        low,
        size,
        level,
        volume: closed.volume * builder.side.powi(3),
        verdict,
        sigma_min: bounds.map_or(0.0, |b| b.sigma_min),
        det_bound: bounds.map_or(0.0, |b| b.det),
        det_centre: det_centre * orientation,
        steps,
    }
}

/// Sets the determinants at the centres of these cells, by the map itself.
fn set_determinants<'a>(map: &HarmonicMap, orientation: f64, cells: impl Iterator<Item = &'a mut CertificateCell>) {
    let mut cells: Vec<&mut CertificateCell> = cells.collect();
    let centres: Vec<Point> = cells.iter().map(|cell| cell.centre()).collect();
    for (cell, jacobian) in cells.iter_mut().zip(map.jacobian(&centres)) {
        cell.det_centre = jacobian.determinant() * orientation;
    }
}

fn summary(cells: &[CertificateCell], volume: f64, stop_reason: StopReason) -> CertificateReport {
    let with = |verdict| cells.iter().filter(move |cell| cell.verdict == verdict);
    let share = |verdict| {
        let found = total(&mut with(verdict));
        VerdictTotals {
            cells: with(verdict).count(),
            volume: found,
            fraction: found / volume,
        }
    };
    let least = |value: fn(&CertificateCell) -> f64| with(Verdict::Positive).map(value).reduce(f64::min);
    let finest = cells.iter().max_by_key(|cell| cell.level);
    let mut negative = with(Verdict::Undecided).filter(|cell| cell.det_centre < 0.0);
    CertificateReport {
        volume,
        positive: share(Verdict::Positive),
        folded: share(Verdict::Folded),
        undecided: share(Verdict::Undecided),
        undecided_negative: total(&mut negative) / volume,
        det_bound: least(|cell| cell.det_bound),
        sigma_min: least(|cell| cell.sigma_min),
        sigma_min_99: bound_over(0.99 * volume, with(Verdict::Positive)),
        finest_cell: finest.map_or(0.0, |cell| cell.size),
        levels: finest.map_or(0, |cell| cell.level),
        stop_reason,
        volume_error: total(&mut cells.iter()) / volume - 1.0,
        mirrored: MirroredParts::default(),
    }
}

/// The largest bound of singular values that holds over this volume.
fn bound_over<'a>(volume: f64, cells: impl Iterator<Item = &'a CertificateCell>) -> Option<f64> {
    let mut cells: Vec<&CertificateCell> = cells.collect();
    cells.sort_by(|a, b| b.sigma_min.total_cmp(&a.sigma_min));
    let mut covered = 0.0;
    let reaches = |cell: &&&CertificateCell| {
        covered += cell.volume;
        covered >= volume
    };
    cells.iter().find(reaches).map(|cell| cell.sigma_min)
}

/// Volume of cells in the domain.
fn total(cells: &mut dyn Iterator<Item = &CertificateCell>) -> f64 {
    cells.fold(0.0, |sum, cell| sum + cell.volume)
}

/// Position of a cell's lowest corner along Morton's curve through the cells of the deepest level.
fn curve_key(level: u8, steps: [u32; 3]) -> u64 {
    let mut key = 0;
    for (axis, step) in steps.into_iter().enumerate() {
        let step = step << (MAX_LEVELS - level);
        for bit in 0..MAX_LEVELS {
            key |= u64::from(step >> bit & 1) << (3 * u32::from(bit) + axis as u32);
        }
    }
    key
}
