//! The parts of a surface and the way each should face, for [`super::check()`] and [`super::repair()`].

use rayon::prelude::*;

use crate::Point;
use crate::geometry::{Aabb, Bvh, SurfaceQuery};
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::{ComponentShape, Components, NONE, Orientation, Topology};

/// Connectivity, orientation and nesting of a surface.
pub(super) struct Anatomy<'a> {
    pub mesh: &'a SurfaceMesh,
    pub topology: Topology<'a>,
    pub orientation: Orientation,
    pub components: Components,
    /// One per component.
    pub shells: Vec<Shell>,
    /// Their boxes, one per component.
    pub boxes: Vec<Aabb>,
    /// Pairs of shells that are partly inside each other, as far as the vertices looked at tell.
    pub overlaps: Vec<[usize; 2]>,
    /// Number of sound shells, when so many are within each other's boxes that their nesting is too costly to
    /// determine. None of them counts as sound then.
    pub crowd: Option<usize>,
}

/// A component as the boundary of a solid or cavity.
#[derive(Debug, Clone, Default)]
pub(super) struct Shell {
    /// Closed, edge-manifold, orientable and finite: it has an inside.
    pub is_sound: bool,
    pub area: f64,
    /// After making its orientation consistent.
    pub volume: f64,
    /// How many others enclose it.
    pub depth: usize,
    pub inside: Option<usize>,
}

/// At most this many vertices of a shell are tested for being inside other shells.
const MAX_WITNESSES: usize = 32;

/// Limit on the cost of the nesting, in winding numbers of small shells: about a second.
const MAX_WORK: usize = 4_000_000;

/// Volume below this fraction of `area^(3/2)` is rounding.
const NO_VOLUME: f64 = 1e-12;

impl Shell {
    /// A sound shell that encloses something.
    pub fn has_volume(&self) -> bool {
        self.is_sound && self.volume.abs() > NO_VOLUME * self.area.powf(1.5)
    }

    pub fn is_cavity(&self) -> bool {
        self.depth % 2 == 1
    }

    /// A solid that faces inward, or a cavity that faces away from the cavity.
    pub fn faces_wrong_way(&self) -> bool {
        self.has_volume() && (self.volume > 0.0) == self.is_cavity()
    }
}

impl<'a> Anatomy<'a> {
    pub fn of(mesh: &'a SurfaceMesh) -> Self {
        let topology = Topology::new(mesh);
        let orientation = topology.orientation();
        let components = topology.components();
        let boxes = boxes(mesh, &components);
        let mut shells = measured_shells(mesh, &topology, &orientation, &components, &boxes);
        let nesting = nest(mesh, &orientation.flip, &components, &boxes, &mut shells);
        let sound = shells.iter().filter(|shell| shell.is_sound).count();
        let crowd = nesting.is_none().then_some(sound);
        if crowd.is_some() {
            shells.iter_mut().for_each(|shell| shell.is_sound = false);
        }
        let overlaps = nesting.unwrap_or_default();
        Self {
            mesh,
            topology,
            orientation,
            components,
            shells,
            boxes,
            overlaps,
            crowd,
        }
    }

    /// The triangles that belong to a component and for which `wanted` holds.
    pub fn triangles_where(&self, wanted: impl Fn(usize, &Shell) -> bool) -> impl Iterator<Item = u32> {
        let of_triangle = self.components.of_triangle.iter().enumerate();
        of_triangle
            .filter(move |&(t, &c)| c != NONE && wanted(t, &self.shells[c as usize]))
            .map(|(t, _)| t as u32)
    }
}

pub(super) fn is_finite(p: &Point) -> bool {
    p.coords.iter().all(|x| x.is_finite())
}

fn measured_shells(
    mesh: &SurfaceMesh,
    topology: &Topology,
    orientation: &Orientation,
    components: &Components,
    boxes: &[Aabb],
) -> Vec<Shell> {
    let sound = |(shape, bounds): (&ComponentShape, &Aabb)| Shell {
        is_sound: shape.closed && is_finite(&bounds.low) && is_finite(&bounds.high),
        ..Shell::default()
    };
    let mut shells: Vec<Shell> = components.shapes.iter().zip(boxes).map(sound).collect();
    for edge in 0..topology.edges().len() {
        let component = components.of_triangle[topology.sides(edge)[0].triangle as usize];
        shells[component as usize].is_sound &= topology.sides(edge).len() == 2;
    }
    for &edge in &orientation.twisted_edges {
        let component = components.of_triangle[topology.sides(edge as usize)[0].triangle as usize];
        shells[component as usize].is_sound = false;
    }
    for (triangle, &component) in components.of_triangle.iter().enumerate() {
        if component == NONE {
            continue;
        }
        let corners = mesh.corners(triangle);
        if !corners.iter().all(is_finite) {
            shells[component as usize].is_sound = false;
            continue;
        }
        let shell = &mut shells[component as usize];
        shell.area += mesh.area_vector(triangle).norm();
        // About the component's own centre: far from the origin the volume would be lost to rounding.
        let bounds = &boxes[component as usize];
        let [a, b, c] = corners.map(|p| p - nalgebra::center(&bounds.low, &bounds.high));
        let sign = if orientation.flip[triangle] { -1.0 } else { 1.0 };
        shell.volume += sign * a.dot(&b.cross(&c)) / 6.0;
    }
    shells
}

fn boxes(mesh: &SurfaceMesh, components: &Components) -> Vec<Aabb> {
    let mut boxes = vec![Aabb::empty(); components.shapes.len()];
    for (triangle, &component) in components.of_triangle.iter().enumerate() {
        if component != NONE {
            let own = &mut boxes[component as usize];
            *own = own.union(&Aabb::around(&mesh.corners(triangle)));
        }
    }
    boxes
}

/// Finds which sound shells enclose which, and returns the pairs that overlap; `None` when too many are within each
/// other's boxes.
fn nest(
    mesh: &SurfaceMesh,
    flip: &[bool],
    components: &Components,
    boxes: &[Aabb],
    shells: &mut [Shell],
) -> Option<Vec<[usize; 2]>> {
    let sound: Vec<usize> = (0..shells.len()).filter(|&s| shells[s].is_sound).collect();
    if sound.len() < 2 {
        return Some(Vec::new());
    }
    let sound_boxes: Vec<Aabb> = sound.iter().map(|&s| boxes[s]).collect();
    let tree = Bvh::new(&sound_boxes);
    let triangles = triangles_by_component(components);
    let others_around = |own: usize, p: &Point| {
        let mut others = items_around(&tree, &sound_boxes, p);
        others.retain(|&other| other != own);
        others
    };
    // The least possible cost: with one witness per shell.
    let mut work = 0;
    for (own, &shell) in sound.iter().enumerate() {
        let first = witnesses(mesh, &triangles[shell], 1);
        for other in first.iter().flat_map(|p| others_around(own, p)) {
            work += work_of(triangles[sound[other]].len());
        }
        if work > MAX_WORK {
            return None;
        }
    }
    let most = (MAX_WORK / work.max(1)).clamp(1, MAX_WITNESSES);
    let witnesses: Vec<Vec<Point>> = sound.iter().map(|&s| witnesses(mesh, &triangles[s], most)).collect();
    let around_each = |(own, witnesses): (usize, &Vec<Point>)| -> Vec<Vec<usize>> {
        witnesses.iter().map(|p| others_around(own, p)).collect()
    };
    let around: Vec<Vec<Vec<usize>>> = witnesses.par_iter().enumerate().map(around_each).collect();
    let mut is_asked = vec![false; sound.len()];
    for &other in around.iter().flatten().flatten() {
        is_asked[other] = true;
    }
    let query = |(&is_asked, &shell): (&bool, &usize)| {
        let query = || SurfaceQuery::with_winding_sign(&part_of(mesh, flip, &triangles[shell])).ok();
        is_asked.then(query).flatten()
    };
    let queries: Vec<Option<SurfaceQuery>> = is_asked.par_iter().zip(&sound).map(query).collect();
    let winding_number = |other: usize, p: &Point| {
        let query = queries[other].as_ref();
        query.map_or(0.0, |query| query.winding_number(p).abs())
    };
    let votes = |(witnesses, around): (&Vec<Point>, &Vec<Vec<usize>>)| {
        let asked = witnesses.iter().zip(around);
        let mut votes: Vec<(usize, f64)> = asked
            .flat_map(|(p, around)| around.iter().map(move |&other| (other, p)))
            .map(|(other, p)| (other, winding_number(other, p)))
            .collect();
        votes.sort_by_key(|vote| vote.0);
        Enclosure::of(&votes, witnesses.len())
    };
    let enclosures: Vec<Enclosure> = witnesses.par_iter().zip(&around).map(votes).collect();
    let mut overlaps = Vec::new();
    for (&shell, enclosure) in sound.iter().zip(&enclosures) {
        shells[shell].depth = enclosure.enclosing.len();
        for other in enclosure.overlapping.iter().map(|&other| sound[other]) {
            overlaps.push([shell.min(other), shell.max(other)]);
        }
    }
    for (&shell, enclosure) in sound.iter().zip(&enclosures) {
        let enclosing = enclosure.enclosing.iter().map(|&other| sound[other]);
        shells[shell].inside = enclosing.max_by_key(|&other| shells[other].depth);
    }
    overlaps.sort_unstable();
    overlaps.dedup();
    Some(overlaps)
}

/// The shells that enclose a shell, all of it or in part.
#[derive(Default)]
struct Enclosure {
    enclosing: Vec<usize>,
    overlapping: Vec<usize>,
}

impl Enclosure {
    /// From the winding numbers of other shells at the witnesses, sorted by shell; witnesses outside of a shell's box
    /// have no entry for it.
    fn of(votes: &[(usize, f64)], witnesses: usize) -> Self {
        let mut found = Self::default();
        for votes in votes.chunk_by(|a, b| a.0 == b.0) {
            // Where shells touch, the winding number is about a half and decides nothing.
            let within = votes.iter().filter(|vote| vote.1 > 0.75).count();
            let beyond_box = witnesses - votes.len();
            let without = votes.iter().filter(|vote| vote.1 < 0.25).count() + beyond_box;
            if within > 0 && without == 0 {
                found.enclosing.push(votes[0].0);
            } else if within > 0 {
                found.overlapping.push(votes[0].0);
            }
        }
        found
    }
}

/// Cost of a winding number of this many triangles, in units of that of a few triangles.
fn work_of(triangles: usize) -> usize {
    1 + (triangles / 32).min(64)
}

pub(super) fn triangles_by_component(components: &Components) -> Vec<Vec<u32>> {
    let mut triangles = vec![Vec::new(); components.shapes.len()];
    for (triangle, &component) in components.of_triangle.iter().enumerate() {
        if component != NONE {
            triangles[component as usize].push(triangle as u32);
        }
    }
    triangles
}

/// Up to `most` vertices of these triangles, evenly spaced in the list.
fn witnesses(mesh: &SurfaceMesh, triangles: &[u32], most: usize) -> Vec<Point> {
    let step = triangles.len().div_ceil(most).max(1);
    let corner = |&t: &u32| mesh.corners(t as usize)[0];
    triangles.iter().step_by(step).map(corner).collect()
}

fn items_around(tree: &Bvh, boxes: &[Aabb], p: &Point) -> Vec<usize> {
    let mut found = Vec::new();
    tree.visit_nearest(p, 0.0, |items, limit| {
        let items = tree.order()[items].iter().map(|&item| item as usize);
        found.extend(items.filter(|&item| boxes[item].contains(p)));
        limit
    });
    found
}

/// These triangles, oriented consistently.
fn part_of(mesh: &SurfaceMesh, flip: &[bool], triangles: &[u32]) -> SurfaceMesh {
    let corners = |&t: &u32| {
        let [a, b, c] = mesh.corners(t as usize);
        if flip[t as usize] { [a, c, b] } else { [a, b, c] }
    };
    let numbers = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    SurfaceMesh::new(triangles.iter().flat_map(corners).collect(), numbers.collect()).expect("three corners each")
}
