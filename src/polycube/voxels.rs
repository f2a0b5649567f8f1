//! A polycube of voxels: one voxel, grown by others that leave the whole a ball, and for a solid with handles by as many more that
//! close one each.
//!
//! Voxels are added only where the filled ones and the empty ones keep their topology (simple points; Bertrand, Malandain,
//! *A new characterization of three-dimensional simple points*, 1994) and where the boundary stays a manifold (well-composed
//! pictures; Latecki, *3D well-composed pictures*, 1997). A ball in a solid with a handle leaves a wall of empty voxels across it. The
//! deepest voxel between two parts of what is filled, around which there is one part of empty ones, is a handle if it is filled; the
//! rest of the wall can be filled then.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::geometry::{Aabb, QueryError, SurfaceQuery};
use crate::mesh::{SurfaceMesh, shapes};
use crate::{Point, Vector};

/// Voxels whose centres are this far outside, in voxels, are filled first: what is a little thinner than a voxel is not lost.
const OUTSIDE: f64 = 0.3;
/// Voxels with a centre farther outside than this do not touch the solid.
const FARTHEST_OUTSIDE: f64 = 0.87;
/// Vertices of the model that are no farther than this from the filled voxels, in voxels, are reached.
const REACHED: f64 = 0.75;
/// Those that are farther than this are missed.
const MISSED: f64 = 1.0;
/// Largest number of voxels of the grid, filled or not.
const MAX_GRID_VOXELS: f64 = 1e7;

/// Why there is no polycube of voxels.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VoxelPolycubeError {
    /// The size is not positive and finite, or there would be more than 10⁷ voxels.
    #[error(
        "voxels of size {0} are no grid around the model; the size has to be positive, and may not give more than 10^7 voxels"
    )]
    Size(f64),
    /// The handles of the solid are not those of voxels.
    #[error(
        "voxels of size {size} do not show the handles of the model, of which there are {handles}; it takes smaller ones"
    )]
    Handles {
        /// Size of the voxels.
        size: f64,
        /// Handles wanted.
        handles: u64,
    },
    /// No voxel touches the inside of the solid.
    #[error("no voxel of size {0} lies in the model; it takes smaller ones")]
    Thin(f64),
    /// The surface has no triangles, or is not finite.
    #[error(transparent)]
    Surface(#[from] QueryError),
}

/// A polycube of voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelPolycube {
    /// Corner of the grid.
    pub origin: Point,
    /// Edge length of a voxel.
    pub size: f64,
    /// Places of the filled voxels in the grid.
    pub voxels: Vec<[i32; 3]>,
    /// Vertices of the model that are farther than a voxel from all of them.
    pub missed: usize,
}

impl VoxelPolycube {
    /// Voxels of edge length `size` that fill most of a solid and reach its limbs, with a manifold boundary: a ball with this many
    /// handles, where the solid is deep. Where it has more, its holes are filled or cut open.
    ///
    /// # Errors
    ///
    /// For a size that gives no voxels or more than 10⁷, where the solid does not have as many handles that voxels of this size can
    /// have, and for surfaces that cannot be searched.
    pub fn new(model: &SurfaceMesh, handles: u64, size: f64) -> Result<Self, VoxelPolycubeError> {
        let query = SurfaceQuery::with_winding_sign(model)?;
        let bounds = query.bounds();
        let along = bounds.extent() / size;
        // Written so that NaN is not possible.
        let is_possible = size > 0.0 && along.map(|count| count.ceil() + 4.0).product() <= MAX_GRID_VOXELS;
        if !is_possible {
            return Err(VoxelPolycubeError::Size(size));
        }
        let grid = Grid::around(&bounds, size);
        let centres: Vec<Point> = (0..grid.len()).map(|voxel| grid.centre(voxel)).collect();
        let depths = query.signed_distances(&centres).into_iter().map(|d| -d / size);
        let mut growth = Growth::new(grid, depths.collect(), model.vertices());
        let closed = growth.run(handles);
        let filled = (0..growth.is_filled.len()).filter(|&voxel| growth.is_filled[voxel]);
        let voxels: Vec<[i32; 3]> = filled.map(|voxel| growth.grid.place(voxel).map(|k| k as i32)).collect();
        if voxels.is_empty() {
            return Err(VoxelPolycubeError::Thin(size));
        }
        if closed < handles {
            return Err(VoxelPolycubeError::Handles { size, handles });
        }
        Ok(Self {
            origin: growth.grid.origin,
            size,
            voxels,
            missed: growth.missed(),
        })
    }

    /// The boundary, each side of a voxel divided into `divisions`² squares of two triangles; empty without voxels.
    pub fn surface(&self, divisions: usize) -> SurfaceMesh {
        if self.voxels.is_empty() {
            return SurfaceMesh::default();
        }
        let of_units = shapes::polycube(&self.voxels, divisions.max(1));
        shapes::deformed(&of_units, |p| self.origin + p.coords * self.size)
    }
}

/// Voxels around a solid, at least one of them outside at each side: the surface lies in inner ones.
struct Grid {
    origin: Point,
    size: f64,
    counts: [usize; 3],
}

impl Grid {
    fn around(bounds: &Aabb, size: f64) -> Self {
        let counts = [0, 1, 2].map(|k| (bounds.extent()[k] / size).ceil() as usize + 4);
        // As much room on both sides.
        let middle = (bounds.low.coords + bounds.high.coords) / 2.0;
        Self {
            origin: Point::from(std::array::from_fn(|k| middle[k] - counts[k] as f64 * size / 2.0)),
            size,
            counts,
        }
    }

    fn len(&self) -> usize {
        self.counts.iter().product()
    }

    fn place(&self, voxel: usize) -> [usize; 3] {
        let [x, y, _] = self.counts;
        [voxel % x, voxel / x % y, voxel / x / y]
    }

    fn centre(&self, voxel: usize) -> Point {
        let place = self.place(voxel);
        Point::from(std::array::from_fn(|k| {
            self.origin[k] + (place[k] as f64 + 0.5) * self.size
        }))
    }

    fn is_inner(&self, voxel: usize) -> bool {
        let place = self.place(voxel);
        (0..3).all(|k| place[k] > 0 && place[k] + 1 < self.counts[k])
    }

    /// The voxel that a point lies in, if that is an inner one.
    fn at(&self, p: &Point) -> Option<usize> {
        let place: [usize; 3] = std::array::from_fn(|k| ((p[k] - self.origin[k]) / self.size) as usize);
        let [x, y, _] = self.counts;
        let is_within = (0..3).all(|k| place[k] < self.counts[k]);
        let voxel = place[0] + x * (place[1] + y * place[2]);
        (is_within && self.is_inner(voxel)).then_some(voxel)
    }

    /// The 27 voxels around an inner one, itself in the middle.
    fn around_voxel(&self, voxel: usize) -> [usize; 27] {
        let [x, y, _] = self.counts;
        let first = voxel - (1 + x + x * y);
        std::array::from_fn(|k| first + k % 3 + x * (k / 3 % 3) + x * y * (k / 9))
    }

    /// Distance of a point from a voxel, in voxels.
    fn distance(&self, p: &Point, voxel: usize) -> f64 {
        let away = (p - self.centre(voxel)) / self.size;
        Vector::from(away.map(|x| (x.abs() - 0.5).max(0.0))).norm()
    }
}

/// Voxels that are filled one after the other.
struct Growth<'a> {
    grid: Grid,
    /// How deep the centres of the voxels are in the solid, in voxels.
    depths: Vec<f64>,
    is_filled: Vec<bool>,
    vertices: &'a [Point],
    /// The vertices in each inner voxel.
    vertices_in: Vec<Vec<u32>>,
    is_reached: Vec<bool>,
}

impl<'a> Growth<'a> {
    fn new(grid: Grid, depths: Vec<f64>, vertices: &'a [Point]) -> Self {
        let mut vertices_in = vec![vec![]; grid.len()];
        for (v, p) in (0..).zip(vertices) {
            if let Some(voxel) = grid.at(p) {
                vertices_in[voxel].push(v);
            }
        }
        Self {
            is_filled: vec![false; grid.len()],
            grid,
            depths,
            vertices,
            vertices_in,
            is_reached: vec![false; vertices.len()],
        }
    }

    /// Fills the deepest voxel, all that are deep enough and leave it a ball, voxels that close up to `handles` handles, and then others
    /// for the limbs that are not reached yet. How many handles were closed.
    fn run(&mut self, handles: u64) -> u64 {
        let inner = (0..self.grid.len()).filter(|&voxel| self.grid.is_inner(voxel));
        let deepest = inner.max_by(|&a, &b| self.depths[a].total_cmp(&self.depths[b]).then(b.cmp(&a)));
        let Some(deepest) = deepest.filter(|&voxel| self.depths[voxel] > -FARTHEST_OUTSIDE) else {
            return 0;
        };
        self.fill(deepest);
        self.grow(&self.empty_around(deepest), OUTSIDE, false);
        let mut closed = self.close(handles, OUTSIDE, false);
        self.grow(&self.around_filled(), FARTHEST_OUTSIDE, true);
        // Those that are thinner than a voxel.
        closed += self.close(handles - closed, FARTHEST_OUTSIDE, true);
        closed
    }

    /// Fills voxels that close a handle, the deepest first, and grows from each. How many there were, up to `most`.
    fn close(&mut self, most: u64, outside: f64, reaching: bool) -> u64 {
        let mut closed = 0;
        while closed < most
            && let Some(voxel) = self.deepest_handle(outside)
        {
            self.fill(voxel);
            self.grow(&self.empty_around(voxel), outside, reaching);
            closed += 1;
        }
        closed
    }

    /// The deepest voxel that closes a handle.
    fn deepest_handle(&self, outside: f64) -> Option<usize> {
        let empty = (0..self.grid.len()).filter(|&v| self.depths[v] > -outside && !self.is_filled[v]);
        let closing = empty.filter(|&v| self.grid.is_inner(v) && self.can_be_filled(v, 2));
        closing.max_by(|&a, &b| self.depths[a].total_cmp(&self.depths[b]).then(b.cmp(&a)))
    }

    /// The empty voxels around filled ones, ascending.
    fn around_filled(&self) -> Vec<usize> {
        let filled = (0..self.grid.len()).filter(|&voxel| self.is_filled[voxel]);
        let mut around: Vec<usize> = filled.flat_map(|voxel| self.empty_around(voxel)).collect();
        around.sort_unstable();
        around.dedup();
        around
    }

    /// Fills voxels of `first` and then those around filled ones, deepest first; on request only those that reach a vertex
    /// that no other does.
    fn grow(&mut self, first: &[usize], outside: f64, reaching: bool) {
        let candidates = |growth: &Self, voxels: &[usize]| -> Vec<Candidate> {
            let wanted = voxels.iter().filter(|&&voxel| growth.depths[voxel] > -outside);
            wanted
                .map(|&voxel| Candidate {
                    depth: growth.depths[voxel],
                    voxel,
                })
                .collect()
        };
        let mut queue = BinaryHeap::from(candidates(self, first));
        while let Some(Candidate { voxel, .. }) = queue.pop() {
            let is_wanted = !self.is_filled[voxel] && (!reaching || self.reaches_more(voxel));
            if is_wanted && self.can_be_filled(voxel, 1) {
                self.fill(voxel);
                // Others that could not be filled before may be now.
                queue.extend(candidates(self, &self.empty_around(voxel)));
            }
        }
    }

    fn fill(&mut self, voxel: usize) {
        self.is_filled[voxel] = true;
        for near in self.grid.around_voxel(voxel) {
            for &v in &self.vertices_in[near] {
                self.is_reached[v as usize] |= self.grid.distance(&self.vertices[v as usize], voxel) <= REACHED;
            }
        }
    }

    fn missed(&self) -> usize {
        let is_missed = |&v: &usize| {
            let p = &self.vertices[v];
            let Some(voxel) = self.grid.at(p) else { return true };
            let near = self.grid.around_voxel(voxel).into_iter();
            // Voxels farther away than these are farther than one voxel.
            !near
                .into_iter()
                .any(|near| self.is_filled[near] && self.grid.distance(p, near) <= MISSED)
        };
        (0..self.vertices.len()).filter(is_missed).count()
    }

    fn reaches_more(&self, voxel: usize) -> bool {
        let near = self.grid.around_voxel(voxel).into_iter();
        near.flat_map(|near| &self.vertices_in[near])
            .any(|&v| !self.is_reached[v as usize] && self.grid.distance(&self.vertices[v as usize], voxel) <= REACHED)
    }

    fn empty_around(&self, voxel: usize) -> Vec<usize> {
        let around = self.grid.around_voxel(voxel).into_iter();
        around
            .filter(|&near| !self.is_filled[near] && self.grid.is_inner(near))
            .collect()
    }

    /// Whether an empty voxel can be filled so that the boundary stays a manifold: around it there are this many parts of filled voxels
    /// and one of empty ones, all joined by faces, and in each cube of eight voxels with it there is one of both. With one part the
    /// topology does not change, and with two a handle is closed, or two bodies are joined.
    fn can_be_filled(&self, voxel: usize, parts: usize) -> bool {
        let mut filled = self.grid.around_voxel(voxel).map(|near| self.is_filled[near]);
        let is_between =
            parts_at_faces(|k| filled[k] && distance(k, MIDDLE) < 3) == parts && parts_at_faces(|k| !filled[k]) == 1;
        filled[MIDDLE] = true;
        is_between && (0..8).all(|corner| is_well_composed(&filled, corner))
    }
}

/// The voxel in the middle of 27.
const MIDDLE: usize = 13;

/// Faces to cross from one of 27 voxels to another.
fn distance(a: usize, b: usize) -> usize {
    let place = |k: usize| [k % 3, k / 3 % 3, k / 9];
    let [p, q] = [place(a), place(b)];
    (0..3).map(|axis| p[axis].abs_diff(q[axis])).sum()
}

/// Parts, joined by faces, of those of the 26 voxels around the middle one that are members; only parts that share a face with
/// that one count.
fn parts_at_faces(is_member: impl Fn(usize) -> bool) -> usize {
    let mut is_reached = [false; 27];
    is_reached[MIDDLE] = true;
    let mut count = 0;
    for first in (0..27).filter(|&k| distance(k, MIDDLE) == 1) {
        if is_reached[first] || !is_member(first) {
            continue;
        }
        count += 1;
        let mut open = vec![first];
        is_reached[first] = true;
        while let Some(k) = open.pop() {
            for other in (0..27).filter(|&other| distance(k, other) == 1 && is_member(other)) {
                if !std::mem::replace(&mut is_reached[other], true) {
                    open.push(other);
                }
            }
        }
    }
    count
}

/// Whether in a cube of eight of the 27 voxels the filled ones are joined by faces, and the empty ones too: then no two of
/// them touch in an edge or a corner alone.
fn is_well_composed(filled: &[bool; 27], corner: usize) -> bool {
    let first = [corner & 1, corner >> 1 & 1, corner >> 2];
    let at = |k: usize| (first[0] + (k & 1)) + 3 * (first[1] + (k >> 1 & 1)) + 9 * (first[2] + (k >> 2));
    [true, false].into_iter().all(|wanted| {
        let members: u8 = (0..8).filter(|&k| filled[at(k)] == wanted).map(|k| 1u8 << k).sum();
        let mut reached = members & members.wrapping_neg();
        loop {
            let mut next = reached;
            for k in (0..8).filter(|k| reached >> k & 1 == 1) {
                [1, 2, 4].iter().for_each(|step| next |= 1 << (k ^ step));
            }
            next &= members;
            if next == reached {
                return reached == members;
            }
            reached = next;
        }
    })
}

/// A voxel to fill: the deepest first, of equally deep ones the first.
struct Candidate {
    depth: f64,
    voxel: usize,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.depth.total_cmp(&other.depth).then(other.voxel.cmp(&self.voxel))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::topology::Topology;

    /// Genus of the surface, which has to be one closed manifold.
    fn genus(surface: &SurfaceMesh) -> Option<u64> {
        let shapes = Topology::new(surface).components().shapes;
        match shapes.as_slice() {
            [one] => one.genus(),
            _ => None,
        }
    }

    #[test]
    fn voxels_of_a_box_are_the_box() {
        let cube = shapes::deformed(&shapes::cube(2.0, 4), |p| Point::new(p.x, 2.0 * p.y, 0.5 * p.z));
        let found = VoxelPolycube::new(&cube, 0, 0.25).unwrap();
        assert_eq!((found.voxels.len(), found.missed), (8 * 16 * 4, 0));
        let surface = found.surface(1);
        assert!((surface.volume() / cube.volume() - 1.0).abs() < 1e-12);
        assert_eq!(surface.bounding_box(), cube.bounding_box());
    }

    #[test]
    fn handles_are_closed_where_the_solid_is_deep() {
        let knotted = |p: &Point| Point::new(p.x + 0.3 * p.y * p.y, p.y, p.z + 0.4 * p.x);
        for (name, model, handles) in [
            ("torus", shapes::torus(2.0, 0.5, 40, 20), 1),
            ("thin", shapes::torus(2.0, 0.2, 60, 20), 1),
            ("bent", shapes::deformed(&shapes::torus(2.0, 0.5, 40, 20), knotted), 1),
            ("double torus", shapes::double_torus(4), 2),
        ] {
            for along in [14.0, 20.0, 31.0] {
                let (low, high) = model.bounding_box().unwrap();
                let size = (high - low).max() / along;
                let found = VoxelPolycube::new(&model, handles, size).unwrap();
                let surface = found.surface(1);
                assert_eq!(genus(&surface), Some(handles), "{name}, {along}");
                // The wall across the handle is filled.
                let ball = VoxelPolycube::new(&model, 0, size).unwrap();
                assert!(
                    found.voxels.len() > ball.voxels.len() && found.missed <= ball.missed,
                    "{name}, {along}"
                );
            }
        }
        let ball = shapes::sphere(1.0, 3);
        let error = VoxelPolycube::new(&ball, 1, 0.2).unwrap_err();
        assert!(
            matches!(error, VoxelPolycubeError::Handles { handles: 1, .. }),
            "{error}"
        );
    }

    #[test]
    fn any_solid_gets_a_ball() {
        for (name, model) in [
            ("ball", shapes::sphere(1.0, 3)),
            ("bumps", shapes::bumpy_sphere(20)),
            ("torus", shapes::torus(2.0, 0.5, 40, 20)),
            ("double torus", shapes::double_torus(4)),
            ("shell", shapes::spherical_shell(1.0, 0.5, 3)),
        ] {
            for along in [3.0, 7.5, 12.0, 20.0] {
                let (low, high) = model.bounding_box().unwrap();
                let found = VoxelPolycube::new(&model, 0, (high - low).max() / along).unwrap();
                let surface = found.surface(1);
                assert_eq!(genus(&surface), Some(0), "{name}, {along}");
                assert!(surface.volume() > 0.5 * model.volume(), "{name}, {along}");
            }
        }
    }

    #[test]
    fn limbs_thinner_than_a_voxel_are_reached() {
        // Two long needles, one of them oblique.
        let stretched = |p: &Point| {
            let long = |x: f64| if x > 0.9 { 0.9 + 40.0 * (x - 0.9) } else { x };
            Point::new(long(p.x) + 0.4 * (long(p.z) - p.z), p.y, long(p.z))
        };
        let model = shapes::deformed(&shapes::sphere(1.0, 5), stretched);
        let (low, high) = model.bounding_box().unwrap();
        let found = VoxelPolycube::new(&model, 0, (high - low).max() / 10.0).unwrap();
        assert_eq!(found.missed, 0);
        let (least, most) = found.surface(1).bounding_box().unwrap();
        assert!((high - most).max() < REACHED * found.size && (least - low).max() < REACHED * found.size);
        assert_eq!(genus(&found.surface(1)), Some(0));
    }

    #[test]
    fn what_has_no_voxels_is_an_error() {
        let ball = shapes::sphere(1.0, 2);
        let mut none = VoxelPolycube::new(&ball, 0, 0.5).unwrap();
        none.voxels.clear();
        assert!(none.surface(2).triangles().is_empty());
        for size in [1e-9, 0.0, f64::NAN, -1.0] {
            assert!(VoxelPolycube::new(&ball, 0, size).is_err(), "{size}");
        }
    }
}
