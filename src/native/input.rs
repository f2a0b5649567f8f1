//! What a surface must be before C++ may see it. CGAL's preconditions are compiled out and TetGen's are assertions
//! that end the process, so everything either relies on is checked here.

use super::bridge::ffi;
use super::error::{InputDefect, NativeError, check};
use super::parity::ParityForest;
use crate::Point;
use crate::mesh::SurfaceMesh;

/// A closed surface without self-intersections, read by the even-odd rule.
pub(super) struct Solid {
    /// Volume inside an odd number of shells.
    pub volume: f64,
    /// Handles of the shells that bound the solid from outside, summed; cavities do not count.
    pub outer_genus: usize,
}

/// The connectivity of a surface.
pub(super) struct Topology {
    /// An edge with an odd number of triangles, and how many there are.
    pub open: Option<([u32; 2], usize)>,
    /// An edge of more than two triangles, with their number.
    pub non_manifold: Option<([u32; 2], usize)>,
    /// An edge that its triangles do not run through equally often in both directions.
    pub unbalanced: Option<[u32; 2]>,
    /// Vertices where several fans of triangles meet in a point.
    pub pinched: usize,
    /// The part of each triangle, numbered from 0 in order of their first triangles.
    pub shell_of: Vec<u32>,
    /// Euler characteristic of each part, pinched vertices taken apart.
    pub euler: Vec<i64>,
}

impl Topology {
    pub fn of(surface: &SurfaceMesh) -> Self {
        let edges = sorted_edges(surface);
        let mut topology = Self {
            open: None,
            non_manifold: None,
            unbalanced: None,
            pinched: 0,
            shell_of: Vec::new(),
            euler: Vec::new(),
        };
        let triangles = surface.triangles();
        let mut shells = ParityForest::new(triangles.len());
        let mut fans = ParityForest::new(3 * triangles.len());
        for uses in edges.chunk_by(|a, b| a.ends == b.ends) {
            let edge = uses[0].ends;
            if uses.len() % 2 == 1 {
                topology.open.get_or_insert((edge, 0)).1 += 1;
            }
            if uses.len() > 2 {
                topology.non_manifold.get_or_insert((edge, uses.len()));
            }
            if 2 * uses.iter().filter(|u| u.forward).count() != uses.len() {
                topology.unbalanced.get_or_insert(edge);
            }
            for pair in uses.windows(2) {
                let [s, t] = [pair[0].triangle as usize, pair[1].triangle as usize];
                shells.join(s, t, false);
                for end in edge {
                    fans.join(
                        3 * s + corner(triangles[s], end),
                        3 * t + corner(triangles[t], end),
                        false,
                    );
                }
            }
        }
        topology.count(surface, &edges, &mut shells, &mut fans);
        topology
    }

    fn count(&mut self, surface: &SurfaceMesh, edges: &[EdgeUse], shells: &mut ParityForest, fans: &mut ParityForest) {
        let triangles = surface.triangles();
        let mut number = vec![u32::MAX; triangles.len()];
        for t in 0..triangles.len() {
            let (root, _) = shells.find(t);
            if number[root] == u32::MAX {
                number[root] = self.euler.len() as u32;
                self.euler.push(0);
            }
            self.shell_of.push(number[root]);
            self.euler[number[root] as usize] += 1;
        }
        for uses in edges.chunk_by(|a, b| a.ends == b.ends) {
            self.euler[self.shell_of[uses[0].triangle as usize] as usize] -= 1;
        }
        let mut seen = vec![false; surface.vertices().len()];
        for (t, triangle) in triangles.iter().enumerate() {
            for (k, &v) in triangle.iter().enumerate() {
                if fans.find(3 * t + k).0 == 3 * t + k {
                    self.euler[self.shell_of[t] as usize] += 1;
                    self.pinched += usize::from(std::mem::replace(&mut seen[v as usize], true));
                }
            }
        }
    }

    /// Handles of a part. Means something for closed manifold parts only.
    pub fn genus(&self, shell: usize) -> usize {
        usize::try_from((2 - self.euler[shell]) / 2).unwrap_or(0)
    }

    /// Closed, two triangles at every edge, one fan at every vertex, all of one orientation.
    pub fn is_oriented_manifold(&self) -> bool {
        self.open.is_none() && self.non_manifold.is_none() && self.unbalanced.is_none() && self.pinched == 0
    }
}

/// Coordinates in one row, as the bridge takes them.
pub(super) fn flat(points: &[Point]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

/// Points of a row of coordinates.
pub(super) fn points(xyz: &[f64]) -> Vec<Point> {
    xyz.chunks_exact(3).map(Point::from_slice).collect()
}

/// A surface that C++ returned.
pub(super) fn surface(mesh: &ffi::Mesh) -> Result<SurfaceMesh, NativeError> {
    let (corners, _) = mesh.corners.as_chunks::<3>();
    Ok(SurfaceMesh::new(points(&mesh.xyz), corners.to_vec())?)
}

/// Triangles, finite coordinates, and a size whose products stay numbers: what every operation needs.
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

/// An even number of triangles at every edge.
pub(super) fn check_closed(topology: &Topology) -> Result<(), InputDefect> {
    match topology.open {
        Some((edge, edges)) => Err(InputDefect::Open { edge, edges }),
        None => Ok(()),
    }
}

/// At most two triangles at every edge.
pub(super) fn check_manifold(topology: &Topology) -> Result<(), InputDefect> {
    match topology.non_manifold {
        Some((edge, triangles)) => Err(InputDefect::NonManifoldEdge { edge, triangles }),
        None => Ok(()),
    }
}

/// A proper triangle everywhere, and every vertex used and alone in its place.
pub(super) fn check_elements(surface: &SurfaceMesh) -> Result<(), InputDefect> {
    let repeats = |t: &[u32; 3]| t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
    if let Some(triangle) = surface.triangles().iter().position(repeats) {
        return Err(InputDefect::DegenerateTriangle { triangle });
    }
    if let Some((first, second)) = first_repeated(surface.triangles().iter().map(|&t| sorted(t))) {
        return Err(InputDefect::RepeatedTriangle { first, second });
    }
    // Adding 0.0 makes one zero of both.
    let places = surface
        .vertices()
        .iter()
        .map(|p| [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits()));
    if let Some((first, second)) = first_repeated(places) {
        return Err(InputDefect::CoincidentVertices { first, second });
    }
    let mut used = vec![false; surface.vertices().len()];
    surface
        .triangles()
        .iter()
        .flatten()
        .for_each(|&v| used[v as usize] = true);
    match used.iter().position(|&u| !u) {
        Some(vertex) => Err(InputDefect::UnreferencedVertex { vertex }),
        None => Ok(()),
    }
}

/// Everything that the tetrahedral meshers need.
pub(super) fn check_solid(surface: &SurfaceMesh, topology: &Topology) -> Result<Solid, NativeError> {
    check_numbers(surface)?;
    check_elements(surface)?;
    check_closed(topology)?;
    // A flat surface intersects itself too, and to say so would not help.
    let shells = shells(surface, topology)?;

    let pairs = meeting_triangles(surface)?;
    if let Some(pair) = pairs.iter().find(|pair| pair[0] == pair[1]) {
        let triangle = pair[0] as usize;
        return Err(InputDefect::DegenerateTriangle { triangle }.into());
    }
    match pairs.first() {
        Some(&first) => Err(NativeError::SelfIntersection {
            pairs: pairs.len(),
            first,
        }),
        None => Ok(solid_of(&shells, topology)),
    }
}

/// Pairs of triangles that meet in more than a common corner or side, and a triangle twice when it has no area.
pub(super) fn meeting_triangles(surface: &SurfaceMesh) -> Result<Vec<[u32; 2]>, NativeError> {
    let mut pairs = Vec::new();
    let triangles = surface.triangles().as_flattened();
    check(ffi::intersecting_pairs(
        &flat(surface.vertices()),
        triangles,
        &mut pairs,
    ))?;
    Ok(pairs.as_chunks::<2>().0.to_vec())
}

/// Volume and handles by the even-odd rule: the shells' own orientations are mended, so they do not matter. Means
/// something only where shells do not intersect.
pub(super) fn solid(surface: &SurfaceMesh, topology: &Topology) -> Result<Solid, InputDefect> {
    Ok(solid_of(&shells(surface, topology)?, topology))
}

fn solid_of(shells: &[Shell], topology: &Topology) -> Solid {
    let mut solid = Solid {
        volume: 0.0,
        outer_genus: 0,
    };
    for (k, shell) in shells.iter().enumerate() {
        let around = shells
            .iter()
            .enumerate()
            .filter(|&(j, other)| j != k && other.encloses(&shell.witness));
        if around.count() % 2 == 0 {
            solid.volume += shell.volume;
            solid.outer_genus += topology.genus(k);
        } else {
            solid.volume -= shell.volume;
        }
    }
    solid
}

struct Shell {
    triangles: Vec<[Point; 3]>,
    low: Point,
    high: Point,
    volume: f64,
    /// A point of the shell that no other shell touches.
    witness: Point,
}

impl Shell {
    fn encloses(&self, p: &Point) -> bool {
        let in_box = (0..3).all(|k| self.low[k] < p[k] && p[k] < self.high[k]);
        in_box && self.solid_angle(p).abs() > 2.0 * std::f64::consts::PI
    }

    /// Van Oosterom & Strackee, *The solid angle of a plane triangle*, IEEE Trans. Biomed. Eng. 30 (1983).
    fn solid_angle(&self, p: &Point) -> f64 {
        let of_triangle = |corners: &[Point; 3]| {
            let [a, b, c] = corners.map(|q| q - p);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let above = a.dot(&b.cross(&c));
            let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            2.0 * above.atan2(below)
        };
        self.triangles.iter().map(of_triangle).sum()
    }
}

/// The parts of the surface, each oriented alike within itself.
fn shells(surface: &SurfaceMesh, topology: &Topology) -> Result<Vec<Shell>, InputDefect> {
    let turned = turned_triangles(surface, topology)?;
    let (low, high) = surface.bounding_box().ok_or(InputDefect::Empty)?;
    let centre = nalgebra::center(&low, &high);
    let mut shells: Vec<Shell> = (0..topology.euler.len())
        .map(|_| Shell {
            triangles: Vec::new(),
            low: high,
            high: low,
            volume: 0.0,
            witness: centre,
        })
        .collect();
    for (t, &turn) in turned.iter().enumerate() {
        let [a, b, c] = surface.corners(t);
        let corners = if turn { [a, c, b] } else { [a, b, c] };
        let shell = &mut shells[topology.shell_of[t] as usize];
        for p in &corners {
            shell.low = shell.low.inf(p);
            shell.high = shell.high.sup(p);
        }
        let [a, b, c] = corners.map(|p| p - centre);
        shell.volume += a.dot(&b.cross(&c)) / 6.0;
        shell.witness = centre + (a + b + c) / 3.0;
        shell.triangles.push(corners);
    }
    shells.iter_mut().for_each(|shell| shell.volume = shell.volume.abs());
    // Each volume is a sum of products of lengths, with a unit error of 1e-16; a real plate has more.
    let volume: f64 = shells.iter().map(|shell| shell.volume).sum();
    if volume <= 1e-14 * surface.area() * surface.diagonal() {
        return Err(InputDefect::Flat);
    }
    Ok(shells)
}

/// Which triangles to turn over so that neighbours agree.
fn turned_triangles(surface: &SurfaceMesh, topology: &Topology) -> Result<Vec<bool>, InputDefect> {
    let count = surface.triangles().len();
    let Some(edge) = topology.unbalanced else {
        return Ok(vec![false; count]);
    };
    if topology.non_manifold.is_some() {
        return Err(InputDefect::NotOrientable { edge });
    }
    let mut sides = ParityForest::new(count);
    for uses in sorted_edges(surface).chunk_by(|a, b| a.ends == b.ends) {
        for pair in uses.windows(2) {
            let same_direction = pair[0].forward == pair[1].forward;
            if !sides.join(pair[0].triangle as usize, pair[1].triangle as usize, same_direction) {
                return Err(InputDefect::NotOrientable { edge: uses[0].ends });
            }
        }
    }
    Ok((0..count).map(|t| sides.find(t).1).collect())
}

#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct EdgeUse {
    ends: [u32; 2],
    triangle: u32,
    forward: bool,
}

fn sorted_edges(surface: &SurfaceMesh) -> Vec<EdgeUse> {
    let of_triangle = |(t, &[a, b, c]): (usize, &[u32; 3])| {
        [[a, b], [b, c], [c, a]].map(|[from, to]| EdgeUse {
            ends: [from.min(to), from.max(to)],
            triangle: t as u32,
            forward: from < to,
        })
    };
    let proper = |edge: &EdgeUse| edge.ends[0] != edge.ends[1];
    let mut edges: Vec<EdgeUse> = surface
        .triangles()
        .iter()
        .enumerate()
        .flat_map(of_triangle)
        .filter(proper)
        .collect();
    edges.sort_unstable();
    edges
}

fn corner(triangle: [u32; 3], vertex: u32) -> usize {
    triangle.iter().position(|&v| v == vertex).unwrap_or(0)
}

pub(super) fn sorted<const N: usize>(mut corners: [u32; N]) -> [u32; N] {
    corners.sort_unstable();
    corners
}

/// The first item that an earlier one equals, with that one's index before its own.
fn first_repeated<K: Ord>(items: impl Iterator<Item = K>) -> Option<(usize, usize)> {
    let mut order: Vec<(K, usize)> = items.enumerate().map(|(k, item)| (item, k)).collect();
    order.sort_unstable();
    let repeats = order.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    repeats
        .map(|pair| (pair[0].1, pair[1].1))
        .min_by_key(|&(_, second)| second)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn volume(surface: &SurfaceMesh) -> f64 {
        solid(surface, &Topology::of(surface)).unwrap().volume
    }

    #[test]
    fn genus_is_that_of_the_shapes() {
        for (surface, genus) in [
            (shapes::sphere(1.0, 2), 0),
            (shapes::torus(1.0, 0.3, 12, 8), 1),
            (shapes::double_torus(2), 2),
        ] {
            let topology = Topology::of(&surface);
            assert!(topology.is_oriented_manifold());
            assert_eq!(topology.euler.len(), 1);
            assert_eq!(topology.genus(0), genus);
        }
    }

    #[test]
    fn a_pinched_vertex_is_counted_and_taken_apart() {
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
        let topology = Topology::of(&pinched);
        assert_eq!(topology.pinched, 1);
        assert_eq!((topology.genus(0), topology.genus(1)), (0, 0));
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
    fn a_body_inside_a_cavity_counts() {
        let nested = shapes::joined(&shapes::spherical_shell(1.0, 0.5, 2), &shapes::sphere(0.25, 2));
        assert!((volume(&nested) - nested.volume()).abs() < 1e-12);
    }
}
