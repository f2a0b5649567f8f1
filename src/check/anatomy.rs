//! What a surface consists of, and which way each part should face. Shared by the examination and the mending.

use std::cell::OnceCell;

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
    /// Pairs of shells that are partly inside each other, as far as the vertices looked at tell.
    pub overlaps: Vec<[usize; 2]>,
}

/// A component, as what it may bound.
#[derive(Debug, Clone, Default)]
pub(super) struct Shell {
    /// Closed, edge-manifold, orientable and finite: it has an inside.
    pub is_sound: bool,
    pub area: f64,
    /// With neighbours made to agree.
    pub volume: f64,
    /// How many others enclose it.
    pub depth: usize,
    pub inside: Option<usize>,
}

/// Vertices of a shell by which its place among the others is judged.
const WITNESSES: usize = 32;

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

    /// Its normals point into what it should enclose, or away from the cavity.
    pub fn faces_wrong_way(&self) -> bool {
        self.has_volume() && (self.volume > 0.0) == self.is_cavity()
    }
}

impl<'a> Anatomy<'a> {
    pub fn of(mesh: &'a SurfaceMesh) -> Self {
        let topology = Topology::new(mesh);
        let orientation = topology.orientation();
        let components = topology.components();
        let mut shells = measured_shells(mesh, &topology, &orientation, &components);
        let overlaps = nest(mesh, &orientation.flip, &components, &mut shells);
        Self {
            mesh,
            topology,
            orientation,
            components,
            shells,
            overlaps,
        }
    }

    /// Triangles of a component, for which `wanted` holds.
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
) -> Vec<Shell> {
    let bounds = boxes(mesh, components);
    let sound = |(shape, bounds): (&ComponentShape, &Aabb)| Shell {
        is_sound: shape.closed && is_finite(&bounds.low) && is_finite(&bounds.high),
        ..Shell::default()
    };
    let mut shells: Vec<Shell> = components.shapes.iter().zip(&bounds).map(sound).collect();
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
        // About the component's own centre: far from the origin the volume would drown in rounding.
        let bounds = &bounds[component as usize];
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

/// Finds which sound shells enclose which, and returns those that do so in part.
fn nest(mesh: &SurfaceMesh, flip: &[bool], components: &Components, shells: &mut [Shell]) -> Vec<[usize; 2]> {
    let sound: Vec<usize> = (0..shells.len()).filter(|&s| shells[s].is_sound).collect();
    if sound.len() < 2 {
        return Vec::new();
    }
    let all_boxes = boxes(mesh, components);
    let sound_boxes: Vec<Aabb> = sound.iter().map(|&s| all_boxes[s]).collect();
    let tree = Bvh::new(&sound_boxes);
    let triangles = triangles_by_component(components);
    let queries = vec![OnceCell::new(); sound.len()];
    let winding_number = |other: usize, p: &Point| {
        let part = || part_of(mesh, flip, &triangles[sound[other]]);
        let query = queries[other].get_or_init(|| SurfaceQuery::with_winding_sign(&part()).ok());
        query.as_ref().map_or(0.0, |query| query.winding_number(p).abs())
    };
    let mut overlaps = Vec::new();
    let mut enclosing: Vec<Vec<usize>> = vec![Vec::new(); shells.len()];
    for (own, &shell) in sound.iter().enumerate() {
        let witnesses = witnesses(mesh, &triangles[shell]);
        let mut votes: Vec<(usize, f64)> = Vec::new();
        for p in &witnesses {
            let others = items_around(&tree, &sound_boxes, p)
                .into_iter()
                .filter(|&other| other != own);
            votes.extend(others.map(|other| (other, winding_number(other, p))));
        }
        votes.sort_by_key(|vote| vote.0);
        for votes in votes.chunk_by(|a, b| a.0 == b.0) {
            let other = sound[votes[0].0];
            // Where they touch, the winding number is about a half and says nothing.
            let within = votes.iter().filter(|vote| vote.1 > 0.75).count();
            let beyond_box = witnesses.len() - votes.len();
            let without = votes.iter().filter(|vote| vote.1 < 0.25).count() + beyond_box;
            if within > 0 && without == 0 {
                enclosing[shell].push(other);
            } else if within > 0 {
                overlaps.push([shell.min(other), shell.max(other)]);
            }
        }
    }
    for (shell, enclosing) in enclosing.iter().enumerate() {
        shells[shell].depth = enclosing.len();
    }
    for (shell, enclosing) in enclosing.iter().enumerate() {
        let innermost = enclosing.iter().copied().max_by_key(|&other| shells[other].depth);
        shells[shell].inside = innermost;
    }
    overlaps.sort_unstable();
    overlaps.dedup();
    overlaps
}

fn triangles_by_component(components: &Components) -> Vec<Vec<u32>> {
    let mut triangles = vec![Vec::new(); components.shapes.len()];
    for (triangle, &component) in components.of_triangle.iter().enumerate() {
        if component != NONE {
            triangles[component as usize].push(triangle as u32);
        }
    }
    triangles
}

/// Vertices of these triangles, evenly through the list.
fn witnesses(mesh: &SurfaceMesh, triangles: &[u32]) -> Vec<Point> {
    let step = triangles.len().div_ceil(WITNESSES).max(1);
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

/// These triangles, with neighbours made to agree.
fn part_of(mesh: &SurfaceMesh, flip: &[bool], triangles: &[u32]) -> SurfaceMesh {
    let corners = |&t: &u32| {
        let [a, b, c] = mesh.corners(t as usize);
        if flip[t as usize] { [a, c, b] } else { [a, b, c] }
    };
    let numbers = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    SurfaceMesh::new(triangles.iter().flat_map(corners).collect(), numbers.collect()).expect("three corners each")
}
