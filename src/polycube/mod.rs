//! Polycubes of solids: deformations of a model's tetrahedra after which every boundary triangle lies across an axis.
//!
//! Boundary triangles get one of six directions by a graph cut (Livesu, Vining, Sheffer, Gregson, Scateni, *PolyCut*, 2013),
//! and the tetrahedra are deformed so that the triangles of each chart, a connected part with one direction, share one
//! coordinate (foldover-free energy of Garanzha et al. 2021). The polycube has the model's own triangulation, so that a map of
//! the boundaries and one of the insides come with it, for solids of any genus. What is returned is checked exactly.

mod attempt;
mod best_attempt;
mod chart_place;
mod charts;
mod cut;
mod descent;
mod effort;
mod energy;
mod face_graph;
mod features;
mod flatten;
mod given_labels;
mod label_repair;
mod lattice;
mod layout;
mod local_repair;
mod max_flow;
mod orientation;
mod solid;
mod sphere_labels;
mod voxels;

use std::collections::HashMap;

use nalgebra::Rotation3;

use crate::Point;
use crate::boundary_map::SurfaceDistortion;
use crate::mesh::{MeshError, SurfaceMesh, TetMesh};
use crate::progress::{ProgressResponse, ProgressSender, run_cancellable};
use crate::remesh::CellSize;

pub use best_attempt::{BadPlace, BestAttempt};
pub use chart_place::ChartPlace;
pub use features::FeatureReport;
pub use given_labels::LabelProblem;
pub use orientation::Orientation;
pub use voxels::{VoxelPolycube, VoxelPolycubeError};

use attempt::{Attempt, attempt, graph_of, snapped};
use given_labels::GivenLabels;
use solid::Solid;

/// The axis of a label: labels are counted as -x, +x, -y, +y, -z, +z.
fn axis_of(label: u8) -> usize {
    usize::from(label / 2 % 3)
}

/// Options of [`make_polycube`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolycubeOptions {
    /// How much borders between charts count against the deviation of triangles from the axes: a larger value gives fewer
    /// charts. Where no polycube is found, others are tried. For scale: 33, 26, 20 and 8 charts with 0.005, 0.01, 0.02 and
    /// 0.04 on one model.
    pub smoothness: f64,
    /// Angle between the normals beside an edge of the model, in degrees, from which borders between charts cost nothing along it, so that
    /// they follow the edge: between 0 and 180. Edges count that form curves which end nowhere. Without one, borders cost 0.3 to 1 of what
    /// they do where the model is flat, less the sharper the edge is. [`PolycubeReport::features`] says how many became borders.
    pub feature_angle: Option<f64>,
    /// Largest number of tetrahedra that splitting may add, as a part of those given; 1000 more are always allowed.
    pub most_added: f64,
    /// Largest number of attempts, each with labels of its own; there are no more than 5, or twice as many with
    /// [`Orientation::Best`]. With 0 no labels are found.
    pub attempts: usize,
    /// Work after which the deformation of an attempt ends although cells stay inverted: iterations of descent for each tetrahedron,
    /// in the mean. Models of fewer than 20 000 get as much as one of so many.
    pub effort: f64,
    /// Cells of a lattice that the planes of the polycube are put on where that is possible: a regular mesh then has boxes of
    /// this size everywhere.
    pub lattice: Option<CellSize>,
    /// How the model is turned before labels are sought. The polycube stays turned; the model is returned as it was given.
    pub orientation: Orientation,
}

/// The default of [`PolycubeOptions::effort`]. For scale: deformations that ended well took 50 to 1100 for most models, and 6000 and
/// 9000 for a hand and a horse.
pub const DEFAULT_EFFORT: f64 = 2e4;

impl Default for PolycubeOptions {
    fn default() -> Self {
        Self {
            smoothness: 0.02,
            feature_angle: None,
            most_added: 1.0,
            attempts: WAYS.len(),
            effort: DEFAULT_EFFORT,
            lattice: None,
            orientation: Orientation::Given,
        }
    }
}

/// The current step of [`make_polycube`], for progress callbacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolycubePhase {
    /// Another attempt begins, with other labels.
    Attempting {
        /// Which, from 1.
        attempt: usize,
    },
    /// Charts are found, and the model is flattened towards them.
    Labelling {
        /// Which round, from 1.
        round: usize,
    },
    /// The model is deformed to the polycube.
    Deforming {
        /// Inverted tetrahedra, and triangles that face against their direction.
        inverted: usize,
    },
    /// The planes of the polycube are put on the lattice.
    Snapping,
}

/// Why there is no polycube.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MakePolycubeError {
    /// The angle of features is not between 0 and 180 degrees.
    #[error("the angle of sharp edges is {0} degrees, but must be between 0 and 180")]
    FeatureAngle(f64),
    /// The smoothness is not positive and finite.
    #[error("the smoothness is {0}, but must be positive and finite")]
    Smoothness(f64),
    /// The size of the lattice's cells is not positive and finite.
    #[error("the lattice has cells of size {0}, but that must be positive and finite")]
    Lattice(f64),
    /// The mesh has no cells, or names nodes that it does not have.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// There are no tetrahedra.
    #[error("there are no tetrahedra")]
    Empty,
    /// The surface of the tetrahedra touches itself.
    #[error("the surface of the tetrahedra touches itself at a vertex or an edge; it has to be a manifold")]
    NotManifold,
    /// A tetrahedron is flat.
    #[error("tetrahedron {0} (0-based) is flat; every one needs a volume")]
    Flat(u32),
    /// A node is not finite.
    #[error("node {0} (0-based) has a coordinate that is not finite")]
    NotFinite(usize),
    /// No labels were found that could be those of a polycube.
    #[error(
        "no polycube was found: no directions of the triangles can be those of a polycube's faces; try another smoothness, or turn \
         the model"
    )]
    NoLabels,
    /// The label that was given for a triangle cannot be one of a polycube's.
    #[error("the labels cannot be those of a polycube: triangle {triangle} (0-based) {problem}")]
    Labels {
        /// Which of the triangles, in the order in which they were given.
        triangle: usize,
        /// Why.
        problem: LabelProblem,
    },
    /// A boundary triangle was given no label.
    #[error("the boundary triangle of nodes {}, {} and {} (0-based) has no label", .0[0], .0[1], .0[2])]
    MissingLabel([u32; 3]),
    /// Along all three axes most triangles face against the labels that were given.
    #[error(
        "along all axes triangles face against their labels: positive and negative directions seem to be exchanged. Labels are 0 to \
         5 for -x, +x, -y, +y, -z, +z; some programs count +x, -x and so on"
    )]
    MirroredLabels,
    /// No attempt ended with a valid polycube.
    #[error(
        "no polycube was found: in the best of {attempts} attempts {inverted} cells stay inverted, with {charts} charts, and \
         {crossings} pairs of boundary triangles pass through each other{}",
        best.text()
    )]
    NotFound {
        /// Inverted tetrahedra, and triangles that face against their direction, in the best attempt.
        inverted: usize,
        /// Pairs of its boundary triangles that pass through each other.
        crossings: usize,
        /// Its charts.
        charts: usize,
        /// Attempts made.
        attempts: usize,
        /// What it ended with.
        best: Box<BestAttempt>,
    },
    /// The progress callback cancelled the work.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

/// Where the directions of the boundary triangles came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LabelSource {
    /// Graph cuts.
    #[default]
    Cut,
    /// The map of the boundary to the sphere: the six faces of a cube around it. Always possible for a solid of genus 0, with
    /// much distortion at limbs.
    Sphere,
    /// The user ([`make_polycube_with_labels`]).
    Given,
}

/// What was done to find a polycube.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct PolycubeReport {
    /// Where the directions came from.
    pub labels: LabelSource,
    /// The smoothness with which a cut found them; 0 for others.
    pub smoothness: f64,
    /// How many sharp edges are borders; `None` unless [`PolycubeOptions::feature_angle`] asks for it.
    pub features: Option<FeatureReport>,
    /// Attempts made.
    pub attempts: usize,
    /// The rows of the rotation by which the model was turned before it was deformed; `None` if it was not.
    pub turn: Option<[[f64; 3]; 3]>,
    /// Charts: connected parts of the boundary with one direction.
    pub charts: usize,
    /// Corners, where three or more charts meet.
    pub corners: usize,
    /// Distinct planes of charts across each axis.
    pub planes: [usize; 3],
    /// Size of the cells of the lattice that the planes are on, in the units of the model; `None` if none was asked for, or no
    /// polycube was found with its planes there.
    pub lattice: Option<f64>,
    /// Tetrahedra that were given.
    pub tets_given: usize,
    /// Tetrahedra, with those that splitting added.
    pub tets: usize,
    /// Inverted tetrahedra and triangles where the descent began.
    pub inverted_at_start: usize,
    /// Those that the first descent of the whole polycube left to local repair.
    pub inverted_after_descent: usize,
    /// Inverted tetrahedra and triangles: none in a result.
    pub inverted: usize,
    /// Pairs of boundary triangles of the polycube that pass through each other, and parts of the solid that lie within another:
    /// none in a result.
    pub crossings: usize,
    /// Energy per volume and area: 7 for a polycube that is its own.
    pub energy: f64,
    /// How the boundary is distorted from the model to the polycube.
    pub distortion: Option<SurfaceDistortion>,
}

/// A polycube with the model that it was made of.
#[derive(Debug, Clone)]
pub struct PolycubeMap {
    /// The model's tetrahedra, right-handed, with nodes and cells that splitting added: the nodes of the mesh that was given
    /// come first.
    pub model: TetMesh,
    /// The same tetrahedra in the polycube, about as large as the model.
    pub polycube: TetMesh,
    /// Boundary triangles, facing outward.
    pub boundary: Vec<[u32; 3]>,
    /// The direction of each boundary triangle in the polycube: 0 to 5 for -x, +x, -y, +y, -z, +z.
    pub labels: Vec<u8>,
    /// The boundary triangles of the mesh that was given, facing outward, each with the direction of all its parts.
    pub given_labels: Vec<([u32; 3], u8)>,
    /// What was done.
    pub report: PolycubeReport,
}

impl PolycubeMap {
    /// The boundaries of the polycube and of the model, with the same triangles over the boundary nodes alone.
    pub fn surfaces(&self) -> [SurfaceMesh; 2] {
        surfaces(&self.boundary, [self.polycube.vertices(), self.model.vertices()])
    }

    /// [`Self::given_labels`] of triangles in another order, their corners too. A triangle that has none gets 0.
    pub fn given_labels_of(&self, triangles: &[[u32; 3]]) -> Vec<u8> {
        let sorted = |mut corners: [u32; 3]| {
            corners.sort_unstable();
            corners
        };
        let by_corners: HashMap<[u32; 3], u8> =
            self.given_labels.iter().map(|&(t, label)| (sorted(t), label)).collect();
        let label = |t: &[u32; 3]| by_corners.get(&sorted(*t)).copied().unwrap_or_default();
        triangles.iter().map(label).collect()
    }
}

/// Surfaces with the same triangles, without nodes that no triangle names.
fn surfaces<const N: usize>(boundary: &[[u32; 3]], positions: [&[Point]; N]) -> [SurfaceMesh; N] {
    let mut ids: Vec<u32> = boundary.iter().flatten().copied().collect();
    ids.sort_unstable();
    ids.dedup();
    let number = |v: u32| ids.binary_search(&v).unwrap_or_default() as u32;
    let triangles: Vec<[u32; 3]> = boundary.iter().map(|t| t.map(number)).collect();
    positions.map(|nodes| {
        let vertices = ids.iter().map(|&v| nodes[v as usize]).collect();
        SurfaceMesh::new(vertices, triangles.clone()).unwrap_or_default()
    })
}

/// A polycube of a solid that is filled with tetrahedra, of any genus.
///
/// Labels are sought with the smoothness of the options, then with others, and for a solid of genus 0 last from its map to the
/// sphere ([`PolycubeOptions::attempts`]). The first polycube is returned in which every tetrahedron is right-handed, every
/// boundary triangle faces along its direction (both decided exactly), the nodes of each chart have one coordinate bit for
/// bit, no boundary triangles pass through each other, and no part of the solid lies within another. The result is the same
/// from run to run and for any number of threads.
///
/// An attempt takes about a second for every 10 000 tetrahedra where labels are good, and up to ten times that where local
/// repair and splitting are needed.
///
/// # Errors
///
/// [`MakePolycubeError::NotFound`] and [`MakePolycubeError::NoLabels`] where no attempt succeeds; others for meshes that cannot be used.
pub fn make_polycube<R: ProgressResponse>(
    mesh: &TetMesh,
    options: &PolycubeOptions,
    progress: &dyn Fn(PolycubePhase) -> R,
) -> Result<PolycubeMap, MakePolycubeError> {
    let control = |phase| progress(phase).control();
    run_cancellable(&control, |monitor| make(mesh, None, options, monitor)).unwrap_or(Err(MakePolycubeError::Cancelled))
}

/// A polycube with these labels of the boundary triangles, as [`make_polycube`] makes it with those that it finds.
///
/// `labels` are the triangles of the boundary by their nodes in `mesh`, with corners in any order, and the direction of each in
/// the polycube: 0 to 5 for -x, +x, -y, +y, -z, +z. They are used as they are, in a single attempt: nothing is repaired. With
/// [`PolycubeMap::given_labels`] of a polycube by a cut it is made again, bit for bit.
///
/// # Errors
///
/// As [`make_polycube`]; [`MakePolycubeError::Labels`], [`MakePolycubeError::MissingLabel`] and
/// [`MakePolycubeError::MirroredLabels`] for labels that cannot be those of a polycube, before anything is deformed to one.
pub fn make_polycube_with_labels<R: ProgressResponse>(
    mesh: &TetMesh,
    labels: &[([u32; 3], u8)],
    options: &PolycubeOptions,
    progress: &dyn Fn(PolycubePhase) -> R,
) -> Result<PolycubeMap, MakePolycubeError> {
    let control = |phase| progress(phase).control();
    run_cancellable(&control, |monitor| make(mesh, Some(labels), options, monitor))
        .unwrap_or(Err(MakePolycubeError::Cancelled))
}

/// How an attempt gets its labels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way<'a> {
    /// By cuts, with the smoothness times this.
    Cut(f64),
    /// From the map to the sphere.
    Sphere,
    /// The user's.
    Given(&'a GivenLabels<'a>),
}

/// Ways in the order in which they are tried.
const WAYS: [Way<'static>; 5] = [Way::Cut(1.0), Way::Cut(1.5), Way::Cut(0.7), Way::Cut(2.25), Way::Sphere];

fn make(
    mesh: &TetMesh,
    labels: Option<&[([u32; 3], u8)]>,
    options: &PolycubeOptions,
    monitor: &ProgressSender<PolycubePhase>,
) -> Result<PolycubeMap, MakePolycubeError> {
    let is_usable = options.smoothness > 0.0 && options.smoothness.is_finite();
    if !is_usable {
        return Err(MakePolycubeError::Smoothness(options.smoothness));
    }
    if let Some(degrees) = options.feature_angle
        && !(degrees > 0.0 && degrees < 180.0)
    {
        return Err(MakePolycubeError::FeatureAngle(degrees));
    }
    if let Some(CellSize::Length(size)) = options.lattice
        && !(size > 0.0 && size.is_finite())
    {
        return Err(MakePolycubeError::Lattice(size));
    }
    if options.lattice == Some(CellSize::Along(0)) {
        return Err(MakePolycubeError::Lattice(f64::INFINITY));
    }
    let mut solid = Solid::new(mesh.clone())?;
    let scale = scale_to_unit(&mut solid);
    let most_added = (options.most_added.max(0.0) * solid.tets().len() as f64) as usize;
    let most_added = most_added.saturating_add(1000);
    solid.split_between_boundary_nodes(most_added);
    let labels = labels.map(|labels| GivenLabels::new(&graph_of(&solid)?, mesh.vertices(), labels));
    let labels = labels.transpose()?;
    let ways = match &labels {
        Some(labels) => vec![Way::Given(labels)],
        None => WAYS.into_iter().take(options.attempts).collect(),
    };
    let mut best: Option<Attempt> = None;
    let mut attempts = 0;
    let turns = options.orientation.turns(&solid);
    let starts: Vec<Solid> = turns.into_iter().map(|turn| solid.turned(turn)).collect();
    for way in ways {
        for start in &starts {
            let _ = monitor.send(PolycubePhase::Attempting { attempt: attempts + 1 });
            let Some(found) = attempt(start, way, options, most_added, monitor)? else {
                continue;
            };
            attempts += 1;
            if best.as_ref().is_none_or(|best| found.is_better_than(best)) {
                best = Some(found);
            }
        }
        if best.as_ref().is_some_and(|best| best.faults() == 0) {
            break;
        }
    }
    let Some(Attempt {
        mut solid,
        mut report,
        mut given,
    }) = best
    else {
        return Err(MakePolycubeError::NoLabels);
    };
    if report.inverted + report.crossings > 0 {
        report.attempts = attempts;
        let (inverted, crossings, charts) = (report.inverted, report.crossings, report.charts);
        let best = BestAttempt::new(Attempt { solid, report, given }, scale)?;
        return Err(MakePolycubeError::NotFound {
            inverted,
            crossings,
            charts,
            attempts,
            best: Box::new(best),
        });
    }
    report.attempts = attempts;
    let rows = |turn: Rotation3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn.matrix()[(i, j)]));
    report.turn = (solid.turn != Rotation3::identity()).then(|| rows(solid.turn));
    if let Some(size) = options.lattice.map(|size| lattice_size(size, &solid, scale)) {
        let found = Attempt { solid, report, given };
        let on_lattice = snapped(&found, size, options, most_added, monitor)?;
        let is_on_lattice = on_lattice.is_some();
        Attempt { solid, report, given } = on_lattice.unwrap_or(found);
        report.lattice = is_on_lattice.then_some(size / scale);
    }
    if let Some(degrees) = options.feature_angle {
        report.features = Some(FeatureReport::of(&solid, &graph_of(&solid)?, degrees, scale));
    }
    report.tets_given = mesh.tets().len();
    report.tets = solid.tets().len();
    let [polycube, model] = surfaces(&solid.mesh.boundary, [&solid.x, &solid.mesh.nodes]);
    report.distortion = SurfaceDistortion::of(&model, polycube.vertices());
    let unscaled = |nodes: &[Point]| -> Vec<Point> { nodes.iter().map(|p| p / scale).collect() };
    let (nodes, images) = (unscaled(&solid.mesh.nodes), unscaled(&solid.x));
    let labels = solid.labels();
    let tets = solid.tets().to_vec();
    Ok(PolycubeMap {
        model: TetMesh::new(nodes, tets.clone())?,
        polycube: TetMesh::new(images, tets)?,
        boundary: solid.mesh.boundary,
        labels,
        given_labels: given,
        report,
    })
}

/// The size of the cells of a lattice for a polycube that is scaled by `scale`.
fn lattice_size(size: CellSize, solid: &Solid, scale: f64) -> f64 {
    let side = |axis: usize| {
        let at = solid.mesh.boundary.iter().flatten().map(|&v| solid.x[v as usize][axis]);
        let (low, high) = at.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        high - low
    };
    match size {
        CellSize::Length(length) => length * scale,
        CellSize::Along(count) => [0, 1, 2].map(side).into_iter().fold(0.0, f64::max) / count as f64,
    }
}

/// Scales a solid to a diagonal between a half and one, by a power of two, so that nothing is rounded.
fn scale_to_unit(solid: &mut Solid) -> f64 {
    let surface = SurfaceMesh::new(solid.mesh.nodes.clone(), solid.mesh.boundary.clone());
    let diagonal = surface.map_or(1.0, |surface| surface.diagonal());
    let scale = (-diagonal.log2().ceil()).exp2();
    let scale = if scale.is_normal() { scale } else { 1.0 };
    solid.mesh.nodes.iter_mut().for_each(|p| *p *= scale);
    solid.x.clone_from(&solid.mesh.nodes);
    scale
}

#[cfg(test)]
mod tests;
