//! Start points for Newton's method: a mesh of the domain that needs no mesher, and its image.
//!
//! A lattice is laid over the domain. Every cell with a corner inside is divided into six tetrahedra by Kuhn's
//! subdivision, its outer corners moved to the closest point of the boundary. Where the Jacobian's determinant changes
//! its sign or nearly vanishes, tetrahedra are divided into eight, twice. The domain's vertices are added as isolated
//! nodes, so that parts too thin for the lattice have nodes. All nodes are mapped, and a tree over the mapped
//! tetrahedra finds those that contain a point.

use std::collections::HashMap;

use crate::geometry::{Aabb, Bvh, SurfaceQuery};
use crate::map::VolumeMap;
use crate::mesh::{KUHN, SurfaceMesh, TetMesh};
use crate::{Point, Vector};

use super::{InverseError, finite_diagonal, picked};

/// The mapped mesh.
pub(super) struct SeedMesh {
    mesh: MappedMesh,
    tet_tree: Bvh,
    node_tree: Bvh,
    /// Node of each item of `node_tree`.
    node_of_item: Vec<u32>,
    /// Length of a cell's edge.
    pub spacing: f64,
    /// 1 if the map preserves the orientation of most of the volume, -1 if it reverses it.
    pub orientation: f64,
    /// Volume of the image over that of the mesh, positive.
    pub mean_det: f64,
}

/// Nodes, their images, and tetrahedra over them; some nodes are isolated.
struct MappedMesh {
    nodes: Vec<Point>,
    images: Vec<Point>,
    det: Vec<f64>,
    tets: Vec<[u32; 4]>,
}

/// Largest number of lattice points over the domain's box: for thin domains the lattice is coarsened until it fits.
const MAX_LATTICE: f64 = 4e6;
/// Largest number of the domain's vertices that become nodes; of more, an even selection.
const MAX_BOUNDARY_NODES: usize = 40_000;
/// How often tetrahedra are divided into eight where the map may fold, and the largest number of all tetrahedra.
const REFINEMENTS: usize = 2;
const MAX_TETS: usize = 2_000_000;
/// `det J` may vanish in a tetrahedron if the least at its corners is below this fraction of the largest.
const VANISHING: f64 = 0.1;
/// Six times the volume of a mapped tetrahedron, over the product of three of its edges, that counts as zero.
const FLAT: f64 = 1e-14;
/// Negative barycentric coordinates up to this count as inside, so that no point falls between tetrahedra.
const SLACK: f64 = 1e-9;

/// The edges of a tetrahedron, and the eight tetrahedra that it is divided into, over its corners (0 to 3) and edge
/// midpoints (4 to 9).
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
const EIGHTHS: [[usize; 4]; 8] = [
    [0, 4, 5, 6],
    [4, 1, 7, 8],
    [5, 7, 2, 9],
    [6, 8, 9, 3],
    [4, 5, 6, 8],
    [4, 7, 5, 8],
    [5, 6, 8, 9],
    [5, 8, 7, 9],
];

impl SeedMesh {
    /// A mapped mesh with about `nodes` nodes inside of the domain, and finer where the map may fold.
    pub fn new(map: &dyn VolumeMap, domain: &SurfaceMesh, query: &SurfaceQuery, nodes: usize) -> Self {
        let lattice = SeedLattice::over(domain, query, nodes);
        let (mut nodes, tets) = lattice.tetrahedra(query);
        let stride = domain.vertices().len().div_ceil(MAX_BOUNDARY_NODES).max(1);
        nodes.extend(domain.vertices().iter().step_by(stride));
        let mut mesh = MappedMesh::new(map, nodes, tets);
        let mean_det = mesh.mean_det();
        let orientation = if mean_det < 0.0 { -1.0 } else { 1.0 };
        for _ in 0..REFINEMENTS {
            mesh.refine(map, orientation);
        }
        // Tetrahedra without volume contain nothing, and where a map is degenerate they would all be searched.
        let images = &mesh.images;
        mesh.tets.retain(|tet| !is_flat(&corners(images, tet)));

        let around_tet = |tet: &[u32; 4]| Aabb::around(&corners(&mesh.images, tet));
        let boxes: Vec<Aabb> = mesh.tets.iter().map(around_tet).collect();
        let image = |v: u32| mesh.images[v as usize];
        let node_of_item: Vec<u32> = (0..mesh.nodes.len() as u32).filter(|&v| is_finite(&image(v))).collect();
        let points: Vec<Aabb> = node_of_item.iter().map(|&v| Aabb::around(&[image(v)])).collect();
        Self {
            tet_tree: Bvh::new(&boxes),
            node_tree: Bvh::new(&points),
            node_of_item,
            spacing: lattice.size,
            orientation,
            mean_det: mean_det.abs(),
            mesh,
        }
    }

    /// How many nodes were mapped.
    pub fn node_count(&self) -> usize {
        self.mesh.nodes.len()
    }

    /// Whether no node has a finite image.
    pub fn is_empty(&self) -> bool {
        self.node_of_item.is_empty()
    }

    /// Preimages of `y` if the map were linear over each tetrahedron: one for every mapped tetrahedron that contains
    /// it, at most `most`.
    pub fn containing(&self, y: &Point, most: usize) -> Vec<Point> {
        let mut found = Vec::new();
        let (all, mut at) = (self.tet_tree.nodes(), 0);
        while at < all.len() && found.len() < most {
            let node = &all[at];
            if !node.bounds.contains(y) {
                at += node.size();
                continue;
            }
            if node.is_leaf() {
                let items = &self.tet_tree.order()[node.items()];
                found.extend(items.iter().filter_map(|&t| self.preimage_in(t, y)));
            }
            at += 1;
        }
        found.truncate(most);
        found
    }

    /// The nodes whose images are nearest to `y`, nearest first.
    pub fn nearest(&self, y: &Point, most: usize) -> Vec<Point> {
        let mut best: Vec<(f64, u32)> = Vec::with_capacity(most + 1);
        self.node_tree.visit_nearest(y, f64::INFINITY, |items, limit| {
            for &item in &self.node_tree.order()[items] {
                let node = self.node_of_item[item as usize];
                let candidate = ((self.mesh.images[node as usize] - y).norm_squared(), node);
                let place = best.partition_point(|known| known < &candidate);
                if place < most {
                    best.insert(place, candidate);
                    best.truncate(most);
                }
            }
            if best.len() == most { best[most - 1].0 } else { limit }
        });
        best.iter().map(|&(_, node)| self.mesh.nodes[node as usize]).collect()
    }

    /// The node whose image is nearest to `y`.
    pub fn nearest_node(&self, y: &Point) -> Point {
        self.nearest(y, 1).first().copied().unwrap_or(self.mesh.nodes[0])
    }

    fn preimage_in(&self, tet: u32, y: &Point) -> Option<Point> {
        let tet = &self.mesh.tets[tet as usize];
        let weights = barycentric(&corners(&self.mesh.images, tet), y)?;
        let places = corners(&self.mesh.nodes, tet);
        let place: Vector = weights.iter().zip(places).map(|(&w, place)| place.coords * w).sum();
        weights.iter().all(|&w| w >= -SLACK).then(|| Point::from(place))
    }
}

impl MappedMesh {
    /// Maps the nodes; leaves out tetrahedra with a corner whose image is not finite.
    fn new(map: &dyn VolumeMap, nodes: Vec<Point>, mut tets: Vec<[u32; 4]>) -> Self {
        let (images, jacobians) = map.evaluate_with_jacobian(&nodes);
        tets.retain(|tet| corners(&images, tet).iter().all(is_finite));
        Self {
            det: jacobians.iter().map(|jacobian| jacobian.determinant()).collect(),
            nodes,
            images,
            tets,
        }
    }

    /// Volume of the image over that of the mesh; negative if the map inverts most of it.
    fn mean_det(&self) -> f64 {
        let volumes = |tet: &[u32; 4]| [&self.nodes, &self.images].map(|points| six_volumes(&corners(points, tet)));
        let (mut whole, mut mapped) = (0.0, 0.0);
        for [before, after] in self.tets.iter().map(volumes) {
            whole += before.abs();
            mapped += before.signum() * after;
        }
        if whole > 0.0 { mapped / whole } else { 1.0 }
    }

    /// Whether the map has, or may have, the opposite orientation somewhere in the tetrahedron.
    fn may_fold(&self, tet: &[u32; 4], orientation: f64) -> bool {
        let det = tet.map(|v| orientation * self.det[v as usize]);
        let most = det.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let [before, after] = [&self.nodes, &self.images].map(|points| six_volumes(&corners(points, tet)));
        let is_small = |&d: &f64| d <= VANISHING * most || d.is_nan();
        det.iter().any(is_small) || orientation * before * after < 0.0
    }

    /// Divides the tetrahedra where the map may fold.
    fn refine(&mut self, map: &dyn VolumeMap, orientation: f64) {
        let tets = std::mem::take(&mut self.tets);
        let (doubtful, mut kept): (Vec<_>, Vec<_>) = tets.into_iter().partition(|tet| self.may_fold(tet, orientation));
        if kept.len() + EIGHTHS.len() * doubtful.len() > MAX_TETS {
            kept.extend(doubtful);
            self.tets = kept;
            return;
        }
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut nodes = Vec::new();
        let mut parts = Vec::with_capacity(EIGHTHS.len() * doubtful.len());
        for tet in doubtful {
            let middle = EDGES.map(|edge| {
                let [a, b] = edge.map(|k| tet[k]);
                *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    nodes.push(nalgebra::center(&self.nodes[a as usize], &self.nodes[b as usize]));
                    (self.nodes.len() + nodes.len() - 1) as u32
                })
            });
            let all: Vec<u32> = tet.into_iter().chain(middle).collect();
            parts.extend(EIGHTHS.map(|part| part.map(|k| all[k])));
        }
        let (images, jacobians) = map.evaluate_with_jacobian(&nodes);
        self.nodes.extend(nodes);
        self.images.extend(images);
        self.det.extend(jacobians.iter().map(|jacobian| jacobian.determinant()));
        parts.retain(|tet| corners(&self.images, tet).iter().all(is_finite));
        kept.extend(parts);
        self.tets = kept;
    }
}

fn corners(points: &[Point], tet: &[u32; 4]) -> [Point; 4] {
    tet.map(|v| points[v as usize])
}

pub(super) fn is_finite(p: &Point) -> bool {
    p.iter().all(|c| c.is_finite())
}

/// Six times the signed volume.
fn six_volumes([a, b, c, d]: &[Point; 4]) -> f64 {
    (b - a).dot(&(c - a).cross(&(d - a)))
}

fn is_flat([a, b, c, d]: &[Point; 4]) -> bool {
    let edges = (b - a).norm() * (c - a).norm() * (d - a).norm();
    six_volumes(&[*a, *b, *c, *d]).abs() <= FLAT * edges
}

/// Barycentric coordinates of `y` in a tetrahedron of either orientation; `None` if it has no volume.
pub(crate) fn barycentric(corners: &[Point; 4], y: &Point) -> Option<[f64; 4]> {
    let whole = six_volumes(corners);
    let weights = std::array::from_fn(|k| {
        let mut replaced = *corners;
        replaced[k] = *y;
        six_volumes(&replaced) / whole
    });
    weights.iter().all(|w: &f64| w.is_finite()).then_some(weights)
}

/// A mesh of the domain with about `nodes` nodes inside: the cells of a lattice that have a corner inside, each divided
/// into six tetrahedra, its outer corners moved to the closest point of the boundary. It approximates the boundary to
/// less than a cell, and tetrahedra there may be flat or inverted; parts thinner than a cell may be missing.
///
/// # Errors
///
/// [`InverseError::Domain`] as [`SurfaceQuery::new`]; [`InverseError::Extent`] when all vertices coincide or are too
/// far apart.
pub fn lattice_mesh(domain: &SurfaceMesh, nodes: usize) -> Result<TetMesh, InverseError> {
    let query = SurfaceQuery::new(domain).map_err(InverseError::Domain)?;
    finite_diagonal("domain", &query)?;
    let (nodes, tets) = SeedLattice::over(domain, &query, nodes).tetrahedra(&query);
    Ok(TetMesh::new(nodes, tets).expect("tetrahedra name nodes"))
}

/// A lattice over the domain's box, and which of its points are inside.
struct SeedLattice {
    origin: Point,
    size: f64,
    counts: [usize; 3],
    inside: Vec<bool>,
}

impl SeedLattice {
    /// The diagonal of the domain's box must be finite and not 0.
    fn over(domain: &SurfaceMesh, query: &SurfaceQuery, nodes: usize) -> Self {
        let bounds = query.bounds();
        let extent = bounds.extent();
        let longest = extent.max();
        let wanted = (domain.volume().abs() / nodes.max(1) as f64).cbrt();
        // Surfaces without volume get a lattice too; those whose volume overflows get the coarsest.
        let mut size = wanted.min(longest).max(longest / 512.0);
        // Two points more than the box needs, and the box in the middle, so that no plane of the lattice lies in a face
        // of the box.
        let count = |length: f64, size: f64| (length / size).ceil() + 2.0;
        while extent.iter().map(|&e| count(e, size)).product::<f64>() > MAX_LATTICE {
            size *= 1.1;
        }
        let counts: [usize; 3] = std::array::from_fn(|k| count(extent[k], size) as usize);
        let span = Vector::from_fn(|k, _| (counts[k] - 1) as f64 * size);
        let origin = bounds.low - 0.5 * (span - extent);
        let mut lattice = Self {
            origin,
            size,
            counts,
            inside: vec![],
        };
        let points: Vec<Point> = (0..counts.iter().product()).map(|i| lattice.point(i)).collect();
        lattice.inside = query.contains_all(&points);
        lattice
    }

    fn point(&self, index: usize) -> Point {
        let [nx, ny, _] = self.counts;
        let at = [index % nx, index / nx % ny, index / (nx * ny)];
        self.origin + Vector::from_fn(|k, _| at[k] as f64) * self.size
    }

    /// Nodes and tetrahedra of all cells with a corner inside.
    fn tetrahedra(&self, query: &SurfaceQuery) -> (Vec<Point>, Vec<[u32; 4]>) {
        let [nx, ny, nz] = self.counts;
        let mut number: HashMap<usize, u32> = HashMap::new();
        let (mut places, mut tets) = (Vec::new(), Vec::new());
        let cells = (0..nz - 1).flat_map(|k| (0..ny - 1).flat_map(move |j| (0..nx - 1).map(move |i| [i, j, k])));
        for [i, j, k] in cells {
            let corners: [usize; 8] =
                std::array::from_fn(|c| (i + (c & 1)) + nx * ((j + (c >> 1 & 1)) + ny * (k + (c >> 2))));
            if !corners.iter().any(|&c| self.inside[c]) {
                continue;
            }
            let corners = corners.map(|c| {
                *number.entry(c).or_insert_with(|| {
                    places.push(c);
                    places.len() as u32 - 1
                })
            });
            tets.extend(KUHN.map(|tet| tet.map(|c| corners[c])));
        }
        let mut nodes: Vec<Point> = places.iter().map(|&c| self.point(c)).collect();
        let outer: Vec<usize> = (0..places.len()).filter(|&v| !self.inside[places[v]]).collect();
        let closest = query.closest_points(&picked(&nodes, &outer));
        for (v, closest) in outer.into_iter().zip(closest) {
            nodes[v] = closest.point;
        }
        (nodes, tets)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix3;
    use crate::mesh::shapes;

    /// Maps everything to a plane.
    struct Flattening;

    impl VolumeMap for Flattening {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            points.iter().map(|p| Point::new(p.x, p.y, 0.3 * p.x + 0.1)).collect()
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            vec![Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.3, 0.0, 0.0); points.len()]
        }
    }

    #[test]
    fn tetrahedra_that_are_mapped_flat_are_left_out() {
        let domain = shapes::cube(1.0, 2);
        let query = SurfaceQuery::new(&domain).unwrap();
        let seeds = SeedMesh::new(&Flattening, &domain, &query, 200);
        assert!(seeds.mesh.tets.is_empty());
        let y = Point::new(0.1, 0.2, 0.13);
        assert!(seeds.containing(&y, 8).is_empty() && seeds.nearest(&y, 6).len() == 6);
    }

    #[test]
    fn domains_without_a_finite_extent_are_refused() {
        for size in [0.0, 1e-200, 1e200, 1e308] {
            let domain = shapes::deformed(&shapes::cube(1.0, 2), |p| p * size);
            let error = lattice_mesh(&domain, 100).unwrap_err();
            assert!(
                matches!(error, InverseError::Extent { surface: "domain", .. }),
                "{size}"
            );
        }
        // The volume is infinite, the diagonal is not.
        assert!(lattice_mesh(&shapes::deformed(&shapes::cube(1.0, 2), |p| p * 1e110), 100).is_ok());
    }

    #[test]
    fn eight_parts_fill_their_tetrahedron_and_have_its_orientation() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.1], [0.1, 0.3, 1.2]].map(Point::from);
        let middles = EDGES.map(|[a, b]| nalgebra::center(&corners[a], &corners[b]));
        let all: Vec<Point> = corners.into_iter().chain(middles).collect();
        let whole = six_volumes(&corners);
        for part in EIGHTHS {
            assert!((six_volumes(&part.map(|k| all[k])) - whole / 8.0).abs() < 1e-15);
        }
    }

    /// The lattice approximates the boundary to a fraction of a cell, and the volume to a fraction of a cell's size
    /// times the area.
    #[test]
    fn the_lattice_fills_a_solid_with_tetrahedra_nearly_all_of_one_orientation() {
        for domain in [
            shapes::cube(1.0, 4),
            shapes::sphere(1.0, 3),
            shapes::torus(1.0, 0.4, 40, 20),
        ] {
            let mesh = lattice_mesh(&domain, 4000).unwrap();
            let size = (domain.volume() / 4000.0).cbrt();
            let error = (mesh.volume() - domain.volume()).abs();
            assert!(error < 0.25 * size * domain.area(), "{error}");
            let inverted = (0..mesh.tets().len()).filter(|&t| mesh.signed_volume(t) < 0.0).count();
            assert!(inverted * 20 < mesh.tets().len(), "{inverted}");
        }
    }
}
