//! Checks of surfaces before they go to C++. CGAL's preconditions are compiled out and TetGen's are assertions that end
//! the process, so everything that either relies on is checked here.

use super::calls::{self, Mesh, Operation};
use super::error::{CgalTetgenError, InputDefect};
use crate::Point;
use crate::geometry::{Aabb, solid_angle};
use crate::mesh::topology::{NONE, Topology};
use crate::mesh::{SurfaceMesh, lowest_coincident_vertices};

/// Measures of what a closed surface without self-intersections encloses by the even-odd rule.
pub(super) struct EnclosedSolid {
    /// Volume inside an odd number of shells.
    pub volume: f64,
    /// Sum of the genera of the outer shells, without cavities. `None` when one of them is non-manifold.
    pub outer_genus: Option<u64>,
}

/// Coordinates in one array, as the bridge takes them.
pub(super) fn flat(points: &[Point]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

/// Points of an array of coordinates.
pub(super) fn points(xyz: &[f64]) -> Vec<Point> {
    xyz.chunks_exact(3).map(Point::from_slice).collect()
}

/// A surface that C++ returned.
pub(super) fn surface(mesh: &Mesh) -> Result<SurfaceMesh, CgalTetgenError> {
    let (corners, _) = mesh.corners.as_chunks::<3>();
    Ok(SurfaceMesh::new(points(&mesh.xyz), corners.to_vec())?)
}

/// What every operation needs: triangles, finite coordinates, and a size whose products do not overflow.
pub(super) fn check_numbers(surface: &SurfaceMesh) -> Result<(), InputDefect> {
    if surface.triangles().is_empty() {
        return Err(InputDefect::Empty);
    }
    let finite = |p: &Point| p.iter().all(|c| c.is_finite());
    if let Some(vertex) = surface.vertices().iter().position(|p| !finite(p)) {
        return Err(InputDefect::NotFinite { vertex });
    }
    let largest = surface.vertices().iter().map(|p| p.coords.amax()).fold(0.0, f64::max);
    let diagonal = surface.diagonal();
    for size in [largest, diagonal] {
        if size > 1e30 || (size > 0.0 && size < 1e-30) {
            return Err(InputDefect::OutOfScale { size });
        }
    }
    Ok(())
}

/// An even number of triangles at every edge. [`Topology::is_closed`] is weaker: it accepts three.
pub(super) fn check_closed(topology: &Topology) -> Result<(), InputDefect> {
    let mut open = (0..topology.edges().len()).filter(|&edge| topology.sides(edge).len() % 2 == 1);
    match open.next() {
        Some(first) => Err(InputDefect::Open {
            edge: topology.edges()[first],
            edges: 1 + open.count(),
        }),
        None => Ok(()),
    }
}

/// At most two triangles at every edge.
pub(super) fn check_manifold(topology: &Topology) -> Result<(), InputDefect> {
    match (0..topology.edges().len()).find(|&edge| topology.sides(edge).len() > 2) {
        Some(edge) => Err(InputDefect::NonManifoldEdge {
            edge: topology.edges()[edge],
            triangles: topology.sides(edge).len(),
        }),
        None => Ok(()),
    }
}

/// No degenerate or repeated triangles, and no unreferenced or coincident vertices.
fn check_elements(surface: &SurfaceMesh, topology: &Topology) -> Result<(), InputDefect> {
    let triangles = surface.triangles();
    if let Some(triangle) = (0..triangles.len()).find(|&t| topology.edges_of_triangle(t).is_none()) {
        return Err(InputDefect::DegenerateTriangle { triangle });
    }
    if let Some((first, second)) = first_repeated(triangles) {
        return Err(InputDefect::RepeatedTriangle { first, second });
    }
    let lowest = lowest_coincident_vertices(surface.vertices());
    if let Some(second) = (0..lowest.len()).find(|&v| lowest[v] as usize != v) {
        let first = lowest[second] as usize;
        return Err(InputDefect::CoincidentVertices { first, second });
    }
    match topology.unreferenced_vertices().first() {
        Some(&vertex) => Err(InputDefect::UnreferencedVertex {
            vertex: vertex as usize,
        }),
        None => Ok(()),
    }
}

/// Checks everything that the tetrahedral meshers need; a surface that passes encloses a solid.
pub(super) fn check_solid(surface: &SurfaceMesh, topology: &Topology) -> Result<EnclosedSolid, CgalTetgenError> {
    check_numbers(surface)?;
    check_elements(surface, topology)?;
    check_closed(topology)?;
    // Before self-intersections: a flat surface has them too, and that message would not help.
    let shells = shells(surface, topology)?;

    let pairs = intersecting_triangles(surface, f64::INFINITY)?;
    if let Some(pair) = pairs.iter().find(|pair| pair[0] == pair[1]) {
        let triangle = pair[0] as usize;
        return Err(InputDefect::DegenerateTriangle { triangle }.into());
    }
    match pairs.first() {
        Some(&first) => Err(CgalTetgenError::SelfIntersection {
            pairs: pairs.len(),
            first,
        }),
        None => Ok(solid_of_shells(&shells)),
    }
}

/// Pairs of triangles that meet in more than a common corner or side; a triangle without area is paired with itself.
/// Tests at most `max_tested` pairs with overlapping boxes.
pub(super) fn intersecting_triangles(surface: &SurfaceMesh, max_tested: f64) -> Result<Vec<[u32; 2]>, CgalTetgenError> {
    let pairs = calls::call_on(Operation::Intersections, surface, &[max_tested])?.corners;
    Ok(pairs.as_chunks::<2>().0.to_vec())
}

/// Volume and genus by the even-odd rule, whatever the shells' orientations. Meaningful only when shells do not
/// intersect.
pub(super) fn enclosed_solid(surface: &SurfaceMesh, topology: &Topology) -> Result<EnclosedSolid, InputDefect> {
    Ok(solid_of_shells(&shells(surface, topology)?))
}

fn solid_of_shells(shells: &[ClosedShell]) -> EnclosedSolid {
    let mut solid = EnclosedSolid {
        volume: 0.0,
        outer_genus: Some(0),
    };
    for (k, shell) in shells.iter().enumerate() {
        let others = shells.iter().enumerate().filter(|&(j, _)| j != k);
        let around = others.filter(|(_, other)| other.encloses(&shell.surface_point));
        if around.count() % 2 == 0 {
            solid.volume += shell.volume;
            solid.outer_genus = solid.outer_genus.zip(shell.genus).map(|(sum, genus)| sum + genus);
        } else {
            solid.volume -= shell.volume;
        }
    }
    solid
}

struct ClosedShell {
    triangles: Vec<[Point; 3]>,
    bounds: Aabb,
    volume: f64,
    genus: Option<u64>,
    /// A point in the interior of one of its triangles, which no other shell touches.
    surface_point: Point,
}

impl ClosedShell {
    fn encloses(&self, p: &Point) -> bool {
        let angles = self.triangles.iter().map(|corners| solid_angle(p, corners));
        self.bounds.contains(p) && angles.sum::<f64>().abs() > 2.0 * std::f64::consts::PI
    }
}

/// The components of the surface, each consistently oriented.
fn shells(surface: &SurfaceMesh, topology: &Topology) -> Result<Vec<ClosedShell>, InputDefect> {
    let flipped = triangles_to_flip(topology)?;
    let (low, high) = surface.bounding_box().ok_or(InputDefect::Empty)?;
    let centre = nalgebra::center(&low, &high);
    let components = topology.components();
    let empty = |genus| ClosedShell {
        triangles: Vec::new(),
        bounds: Aabb::empty(),
        volume: 0.0,
        genus,
        surface_point: centre,
    };
    let mut shells: Vec<ClosedShell> = components.shapes.iter().map(|shape| empty(shape.genus())).collect();
    for (t, &component) in components.of_triangle.iter().enumerate() {
        if component == NONE {
            continue;
        }
        let [a, b, c] = surface.corners(t);
        let corners = if flipped[t] { [a, c, b] } else { [a, b, c] };
        let shell = &mut shells[component as usize];
        shell.bounds = shell.bounds.union(&Aabb::around(&corners));
        let [a, b, c] = corners.map(|p| p - centre);
        shell.volume += a.dot(&b.cross(&c)) / 6.0;
        shell.surface_point = centre + (a + b + c) / 3.0;
        shell.triangles.push(corners);
    }
    shells.iter_mut().for_each(|shell| shell.volume = shell.volume.abs());
    // Rounding alone gives a flat surface a volume of about 1e-16 times area and diagonal.
    let volume: f64 = shells.iter().map(|shell| shell.volume).sum();
    if volume <= 1e-14 * surface.area() * surface.diagonal() {
        return Err(InputDefect::Flat);
    }
    Ok(shells)
}

/// Which triangles to flip so that neighbours agree. At an edge of more than two triangles neighbours are ambiguous, so
/// a non-manifold surface must be consistently oriented already: each edge is used as often in one direction as in the
/// other.
fn triangles_to_flip(topology: &Topology) -> Result<Vec<bool>, InputDefect> {
    let orientation = topology.orientation();
    let inconsistent = if topology.is_edge_manifold() {
        orientation.twisted_edges.first().map(|&edge| edge as usize)
    } else {
        (0..topology.edges().len()).find(|&edge| !is_balanced(topology, edge))
    };
    match inconsistent {
        Some(edge) => Err(InputDefect::NotOrientable {
            edge: topology.edges()[edge],
        }),
        None => Ok(orientation.flip),
    }
}

fn is_balanced(topology: &Topology, edge: usize) -> bool {
    let sides = topology.sides(edge);
    let forward = sides.iter().filter(|&&side| topology.runs_forward(side));
    2 * forward.count() == sides.len()
}

pub(super) fn sorted<const N: usize>(mut corners: [u32; N]) -> [u32; N] {
    corners.sort_unstable();
    corners
}

/// The first triangle with the corners of an earlier one, with that one's index before its own.
fn first_repeated(triangles: &[[u32; 3]]) -> Option<(usize, usize)> {
    let triangles = triangles.iter().enumerate();
    let mut order: Vec<([u32; 3], usize)> = triangles.map(|(t, &corners)| (sorted(corners), t)).collect();
    order.sort_unstable();
    let repeats = order.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    let pairs = repeats.map(|pair| (pair[0].1, pair[1].1));
    pairs.min_by_key(|&(_, second)| second)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn solid_in(surface: &SurfaceMesh) -> EnclosedSolid {
        enclosed_solid(surface, &Topology::new(surface)).unwrap()
    }

    fn volume(surface: &SurfaceMesh) -> f64 {
        solid_in(surface).volume
    }

    #[test]
    fn genus_is_that_of_the_shapes() {
        for (surface, genus) in [
            (shapes::sphere(1.0, 2), 0),
            (shapes::torus(1.0, 0.3, 12, 8), 1),
            (shapes::double_torus(2), 2),
        ] {
            assert_eq!(solid_in(&surface).outer_genus, Some(genus));
        }
    }

    #[test]
    fn cubes_that_touch_in_a_vertex_are_two_shells() {
        let tip = shapes::cube(1.0, 1);
        let moved = shapes::deformed(&tip, |p| p + crate::Vector::repeat(1.0));
        let both = shapes::joined(&tip, &moved);
        let shared = both.vertices()[..8]
            .iter()
            .position(|p| *p == Point::new(0.5, 0.5, 0.5))
            .unwrap() as u32;
        let twin = both.vertices()[8..]
            .iter()
            .position(|p| *p == Point::new(0.5, 0.5, 0.5))
            .unwrap() as u32
            + 8;
        let triangles = both
            .triangles()
            .iter()
            .map(|t| t.map(|v| if v == twin { shared } else { v }))
            .collect();
        let pinched = SurfaceMesh::new(both.vertices().to_vec(), triangles).unwrap();
        assert_eq!(Topology::new(&pinched).non_manifold_vertices(), [shared]);
        assert_eq!(solid_in(&pinched).outer_genus, Some(0));
        assert!((volume(&pinched) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn volume_is_even_odd_whatever_the_orientation() {
        let shell = shapes::spherical_shell(1.0, 0.5, 2);
        let want = shell.volume();
        let outward_twice = shapes::joined(&shapes::sphere(1.0, 2), &shapes::sphere(0.5, 2));
        let mut mixed = shell.triangles().to_vec();
        mixed.iter_mut().step_by(3).for_each(|t| t.swap(0, 1));
        let mixed = SurfaceMesh::new(shell.vertices().to_vec(), mixed).unwrap();
        for surface in [shell.reversed(), outward_twice, mixed, shell] {
            assert!((volume(&surface) - want).abs() < 1e-12);
        }
    }

    #[test]
    fn a_shell_inside_a_cavity_adds_volume() {
        let nested = shapes::joined(&shapes::spherical_shell(1.0, 0.5, 2), &shapes::sphere(0.25, 2));
        assert!((volume(&nested) - nested.volume()).abs() < 1e-12);
    }

    #[test]
    fn a_projective_plane_has_no_inside() {
        let vertices = (0..6).map(|k| Point::new(f64::from(k), f64::from(k * k), f64::from(k * k * k)));
        let around = |k: u32| [1 + k % 5, 1 + (k + 1) % 5, 1 + (k + 3) % 5];
        let triangles = (0..5).flat_map(|k| [[0, around(k)[0], around(k)[1]], around(k)]);
        let plane = SurfaceMesh::new(vertices.collect(), triangles.collect()).unwrap();
        let topology = Topology::new(&plane);
        assert_eq!(check_closed(&topology).and(check_manifold(&topology)), Ok(()));
        let refused = enclosed_solid(&plane, &topology).err();
        assert!(matches!(refused, Some(InputDefect::NotOrientable { .. })));
    }
}
