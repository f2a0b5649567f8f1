//! One attempt at a polycube: labels, and the deformation towards them.

use super::charts::{level, planes};
use super::cut::{BorderOptions, cut_labels};
use super::descent::{polish, untangle};
use super::effort::Effort;
use super::energy::{PolycubeEnergy, References};
use super::face_graph::{Charts, FaceGraph};
use super::features::feature_edges;
use super::flatten::Flattening;
use super::label_repair::repair_labels;
use super::lattice::{move_planes, on_lattice};
use super::layout::Layout;
use super::local_repair::repair;
use super::solid::Solid;
use super::sphere_labels::put_on_cube;
use super::{LabelSource, MakePolycubeError, PolycubeOptions, PolycubePhase, PolycubeReport, Way};
use crate::mesh::SurfaceMesh;
use crate::progress::ProgressSender;
use crate::remesh::{Polycube, SharedCoordinates, crossing_triangles};

/// Penalties of the rounds in which labels are found, and the smoothness of their cuts as a fraction of the last one's.
const ROUNDS: [(f64, f64); 4] = [(0.1, 0.5), (0.3, 0.5), (1.0, 0.5), (3.0, 1.0)];
/// Penalties with the final labels.
const FINAL_PENALTIES: [f64; 4] = [3.0, 10.0, 30.0, 100.0];
/// Turns of rotations and solves with each penalty, and with one unknown for each plane.
const TURNS: usize = 4;
const PLANE_TURNS: usize = 10;
/// How often cells around inverted ones are split.
const MOST_REFINEMENTS: usize = 4;
/// More inverted cells than this, and than a five-hundredth of all, are not cured by splitting.
const MOST_LEFT: usize = 30;
/// If more than this are left after splitting, and more than half of those before, splitting does not help.
const FEW_LEFT: usize = 8;
/// More than this, and than a two-hundredth of all, are not cured by local repair.
const MOST_LEFT_BY_DESCENT: usize = 60;

/// A polycube, or what came next to one.
#[derive(Clone)]
pub(super) struct Attempt {
    pub solid: Solid,
    pub report: PolycubeReport,
    /// Boundary triangles of the model, before any was split, and their labels.
    pub given: Vec<([u32; 3], u8)>,
}

impl Attempt {
    /// Whether it is nearer to a polycube, or if both are one, less distorted.
    pub fn is_better_than(&self, other: &Self) -> bool {
        let [faults, of_other] = [self.faults(), other.faults()];
        faults < of_other || faults + of_other == 0 && self.report.energy < other.report.energy
    }

    /// What keeps it from being a polycube.
    pub fn faults(&self) -> usize {
        self.report.inverted + self.report.crossings
    }
}

/// Labels in one way, and the deformation. `None` if the way is none for this solid, or the labels are those of no polycube.
pub(super) fn attempt(
    model: &Solid,
    way: Way,
    options: &PolycubeOptions,
    most_added: usize,
    monitor: &ProgressSender<PolycubePhase>,
) -> Result<Option<Attempt>, MakePolycubeError> {
    let graph = graph_of(model)?;
    let mut solid = model.clone();
    let mut report = PolycubeReport::default();
    match way {
        Way::Cut(factor) => {
            report.smoothness = factor * options.smoothness;
            let free_edges = options.feature_angle.map_or(vec![], |degrees| {
                feature_edges(&graph.triangles, &model.mesh.nodes, degrees)
            });
            let borders = BorderOptions {
                smoothness: report.smoothness,
                free_edges: &free_edges,
            };
            let labels = find_labels(model, &graph, &borders, monitor)?;
            solid.set_labels(&labels);
            flatten(&mut solid);
        }
        Way::Given(given) => {
            report.labels = LabelSource::Given;
            solid.set_labels(&given.labels);
            flatten(&mut solid);
            given.check_layout(&graph, &solid.x)?;
        }
        Way::Sphere => {
            report.labels = LabelSource::Sphere;
            if put_on_cube(&mut solid, &graph, monitor).is_none() {
                return Ok(None);
            }
        }
    }
    let given: Vec<([u32; 3], u8)> = graph.triangles.iter().copied().zip(solid.labels()).collect();
    let (refined, charts) = refine_at_borders(&mut solid, most_added)?;
    let planes = planes(&refined, &charts);
    let has_layout = || Layout::new(&refined, &charts, &solid.x).is_some_and(|layout| layout.is_possible());
    if way != Way::Sphere && !has_layout() {
        return Ok(None);
    }
    level(&mut solid.x, &planes);
    if way != Way::Sphere {
        relax(&mut solid, &planes);
    }
    report.charts = charts.labels.len();
    report.corners = (0..solid.x.len() as u32)
        .filter(|&v| refined.border_edges_at(v, &solid.labels()) > 2)
        .count();
    report.inverted_at_start = solid.inverted().count();
    let descent = Descent {
        planes_are_fixed: false,
        // The way from the sphere is long, and there is no other left.
        ends_early: way != Way::Sphere,
        most_added,
        effort: Effort::new(options.effort, model.tets().len()),
    };
    finished(Attempt { solid, report, given }, &descent, monitor).map(Some)
}

/// Deforms a solid with labels, and looks at what comes out.
fn finished(
    mut attempt: Attempt,
    descent: &Descent,
    monitor: &ProgressSender<PolycubePhase>,
) -> Result<Attempt, MakePolycubeError> {
    let Attempt { solid, report, .. } = &mut attempt;
    let planes = deform(solid, descent, monitor, report)?;
    report.planes = distinct(solid, &planes);
    report.crossings = crossing_triangles(&solid.mesh.boundary, &solid.x).len() + solid.nested_parts();
    if !monitor.should_continue() {
        return Err(MakePolycubeError::Cancelled);
    }
    Ok(attempt)
}

/// A polycube with its planes on a lattice with cells of `size`, if one was found from `found`.
pub(super) fn snapped(
    found: &Attempt,
    size: f64,
    options: &PolycubeOptions,
    most_added: usize,
    monitor: &ProgressSender<PolycubePhase>,
) -> Result<Option<Attempt>, MakePolycubeError> {
    let polycube_of = |solid: &Solid| {
        let surface = SurfaceMesh::new(solid.x.clone(), solid.mesh.boundary.clone());
        surface.ok().and_then(|surface| Polycube::of(&surface).ok())
    };
    let Some(polycube) = polycube_of(&found.solid) else {
        return Ok(None);
    };
    let graph = graph_of(&found.solid)?;
    let planes = planes(&graph, &graph.charts(&found.solid.labels()));
    let mut tried = None;
    for keeps_distance in [false, true] {
        let Some(coordinates) = on_lattice(&found.solid, &polycube, &planes, size, keeps_distance) else {
            continue;
        };
        if tried.as_ref() == Some(&coordinates) {
            continue;
        }
        if monitor.send(PolycubePhase::Snapping).is_break() {
            return Err(MakePolycubeError::Cancelled);
        }
        let mut moved = found.clone();
        move_planes(&mut moved.solid, &planes, &coordinates);
        let descent = Descent {
            planes_are_fixed: true,
            ends_early: true,
            most_added,
            effort: Effort::new(options.effort, found.solid.tets().len()),
        };
        let before = moved.report.inverted_after_descent;
        let mut moved = finished(moved, &descent, monitor)?;
        moved.report.inverted_after_descent = before;
        if moved.faults() == 0 && polycube_of(&moved.solid).is_some() {
            return Ok(Some(moved));
        }
        tried = Some(coordinates);
    }
    Ok(None)
}

/// How a solid is deformed.
struct Descent {
    /// Whether the planes of the charts stay where they are.
    planes_are_fixed: bool,
    /// Whether to give up where it seems hopeless.
    ends_early: bool,
    /// Largest number of tetrahedra that splitting may add each time.
    most_added: usize,
    effort: Effort,
}

/// Distinct coordinates of planes across each axis.
fn distinct(solid: &Solid, planes: &SharedCoordinates) -> [usize; 3] {
    [0, 1, 2].map(|axis| {
        let across = planes.equal.iter().filter(|(along, _)| *along == axis);
        let mut coordinates: Vec<u64> = across
            .filter_map(|(_, nodes)| nodes.first())
            .map(|&v| solid.x[v as usize][axis].to_bits())
            .collect();
        coordinates.sort_unstable();
        coordinates.dedup();
        coordinates.len()
    })
}

/// Labels by cuts on normals of a model that is flattened more and more.
fn find_labels(
    model: &Solid,
    graph: &FaceGraph,
    borders: &BorderOptions,
    monitor: &ProgressSender<PolycubePhase>,
) -> Result<Vec<u8>, MakePolycubeError> {
    let nodes = &model.mesh.nodes;
    let mut flattening = Flattening::of(model);
    let mut x = model.x.clone();
    let free = SharedCoordinates::default();
    let mut labels = vec![];
    for (round, (penalty, factor)) in ROUNDS.into_iter().enumerate() {
        let phase = PolycubePhase::Labelling { round: round + 1 };
        if monitor.send(phase).is_break() {
            return Err(MakePolycubeError::Cancelled);
        }
        let of_round = BorderOptions {
            smoothness: factor * borders.smoothness,
            ..*borders
        };
        cut_labels(graph, nodes, &x, &of_round, &mut labels);
        flattening.run(&mut x, &labels, penalty, &free, TURNS);
    }
    cut_labels(graph, nodes, &x, borders, &mut labels);
    repair_labels(graph, nodes, &x, &mut labels);
    Ok(labels)
}

/// Flattens the model towards its labels.
fn flatten(solid: &mut Solid) {
    let mut x = solid.x.clone();
    let labels = solid.labels();
    let mut flattening = Flattening::of(solid);
    for penalty in FINAL_PENALTIES {
        flattening.run(&mut x, &labels, penalty, &SharedCoordinates::default(), TURNS);
    }
    solid.x = x;
}

/// Makes the deformation as rigid as possible with charts in planes.
fn relax(solid: &mut Solid, planes: &SharedCoordinates) {
    let mut x = std::mem::take(&mut solid.x);
    let mut flattening = Flattening::of(solid);
    flattening.run(&mut x, &solid.labels(), 0.0, planes, PLANE_TURNS);
    level(&mut x, planes);
    solid.x = x;
}

pub(super) fn graph_of(solid: &Solid) -> Result<FaceGraph, MakePolycubeError> {
    FaceGraph::new(&solid.mesh.boundary, solid.x.len()).ok_or(MakePolycubeError::NotManifold)
}

/// Splits what a polycube with these labels would flatten.
fn refine_at_borders(solid: &mut Solid, most_added: usize) -> Result<(FaceGraph, Charts), MakePolycubeError> {
    let graph = graph_of(solid)?;
    let charts = graph.charts(&solid.labels());
    let edges = solid.surface_edges_to_split(&graph, &charts);
    solid.split_edges(&edges, &[], most_added);
    solid.split_between_boundary_nodes(most_added);
    let graph = graph_of(solid)?;
    let charts = graph.charts(&solid.labels());
    Ok((graph, charts))
}

/// Moves nodes until nothing is inverted, and splits cells where that does not suffice. Returns the planes.
fn deform(
    solid: &mut Solid,
    descent: &Descent,
    monitor: &ProgressSender<PolycubePhase>,
    report: &mut PolycubeReport,
) -> Result<SharedCoordinates, MakePolycubeError> {
    let mut refinement = 0;
    let mut left_before = usize::MAX;
    loop {
        let graph = graph_of(solid)?;
        let planes = planes(&graph, &graph.charts(&solid.labels()));
        let references = References::new(solid.tets(), &solid.mesh.boundary, &solid.mesh.nodes);
        let constraints = if descent.planes_are_fixed {
            planes.as_fixed()
        } else {
            planes.clone()
        };
        let energy = PolycubeEnergy::new(
            solid.tets().to_vec(),
            solid.mesh.boundary.clone(),
            &solid.labels(),
            references.clone(),
            solid.x.len(),
        );
        // New nodes have room where they were split: there may be nothing left to do for the whole.
        if refinement > 0 {
            repair(solid, &references, &descent.effort, monitor);
        }
        let cells = solid.tets().len();
        let most_left = MOST_LEFT_BY_DESCENT.max(cells / 200);
        let most_after_few = descent.ends_early.then_some(most_left);
        let end = untangle(
            &energy,
            &constraints,
            &mut solid.x,
            most_after_few,
            &descent.effort,
            monitor,
        );
        if refinement == 0 {
            report.inverted_after_descent = end.inverted;
        }
        let is_hopeless = end.inverted > most_left;
        let left = if is_hopeless {
            end.inverted
        } else {
            repair(solid, &references, &descent.effort, monitor)
        };
        report.energy = end.energy;
        if left == 0 {
            report.energy = polish(&energy, &constraints, &mut solid.x, monitor).unwrap_or(end.energy);
        }
        let splits_in_vain = descent.ends_early && left > FEW_LEFT.max(left_before / 2);
        left_before = left;
        let gives_up = refinement == MOST_REFINEMENTS
            || splits_in_vain
            || is_hopeless
            || left > MOST_LEFT.max(cells / 500)
            || descent.effort.is_spent();
        if left == 0 || gives_up || !monitor.should_continue() {
            // Counted again from the positions alone; a plane that is none would be a fault of the descent.
            report.inverted = solid.inverted().count() + usize::from(!solid.is_flat(&planes));
            return Ok(planes);
        }
        refinement += 1;
        let (outer, inner) = solid.edges_around(&solid.inverted());
        solid.split_edges(&outer, &inner, descent.most_added);
        solid.split_between_boundary_nodes(descent.most_added);
    }
}
