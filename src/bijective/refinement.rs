//! Refinement of a tet mesh at its boundary until a boundary map is nearly linear over its triangles.

use std::collections::{HashMap, HashSet};

use super::BijectiveError;
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::check::FindSelfIntersections;
use crate::geometry::{ClosestPoint, SurfaceQuery};
use crate::mesh::{SurfaceMesh, SurfacePoint, TetMesh};
use crate::remesh::split_edges;

/// Settings of [`refined_at_boundary`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinementOptions {
    /// Largest distance of the boundary map from the linear one between the images of the vertices, as a fraction of the
    /// target's diagonal.
    pub tolerance: f64,
    /// Largest number of boundary triangles; `None` for four times those of the mesh, and 50 000.
    pub max_triangles: Option<usize>,
}

impl Default for RefinementOptions {
    /// 1e-3, the default tolerance of a fit.
    fn default() -> Self {
        Self {
            tolerance: 1e-3,
            max_triangles: None,
        }
    }
}

/// What a refinement of the boundary did.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct BoundaryRefinement {
    /// Nodes that were added, most of them on the boundary.
    pub nodes_added: usize,
    /// Boundary triangles now.
    pub triangles: usize,
    /// Largest distance found between the boundary map and the linear one, as a fraction of the target's diagonal: at
    /// twelve points of each triangle.
    pub deviation: f64,
}

/// Rounds of subdivision: edges become shorter by a factor of 1000.
const MOST_ROUNDS: usize = 10;
/// Rounds in which triangles whose images intersect are divided.
const CROSSING_ROUNDS: usize = 6;
/// Where a triangle is compared with the map: at quarters of its sides, and inside.
const SAMPLES: [[f64; 3]; 12] = [
    [0.5, 0.5, 0.0],
    [0.75, 0.25, 0.0],
    [0.25, 0.75, 0.0],
    [0.0, 0.5, 0.5],
    [0.0, 0.75, 0.25],
    [0.0, 0.25, 0.75],
    [0.5, 0.0, 0.5],
    [0.25, 0.0, 0.75],
    [0.75, 0.0, 0.25],
    [0.5, 0.25, 0.25],
    [0.25, 0.5, 0.25],
    [0.25, 0.25, 0.5],
];
/// Samples on each side, which come first.
const ON_SIDE: usize = 3;

/// The mesh with tetrahedra divided at the midpoints of their edges where the boundary map is not nearly linear over the
/// boundary's triangles, or where the images of these intersect (where `find` is given). Nodes are
/// added after those that there are; the mesh fills the same solid. Nothing is divided for a map that is linear over the
/// triangles of the boundary.
///
/// # Errors
///
/// [`BijectiveError::Option`] for a tolerance that is not positive, [`BijectiveError::Query`] for a domain that has no
/// triangles to look for points on.
pub fn refined_at_boundary(
    boundary: &BoundaryMap,
    mesh: TetMesh,
    options: &RefinementOptions,
    find: Option<FindSelfIntersections>,
) -> Result<(TetMesh, BoundaryRefinement), BijectiveError> {
    if options.tolerance.is_nan() || options.tolerance <= 0.0 {
        return Err(BijectiveError::Option {
            option: "tolerance",
            value: options.tolerance,
            range: "positive",
        });
    }
    let before = mesh.vertices().len();
    let triangles = mesh.boundary().surface.triangles().len();
    let mut refining = Refining {
        boundary,
        query: SurfaceQuery::with_winding_sign(boundary.domain())?,
        tolerance: options.tolerance * boundary.target_diagonal(),
        limit: options.max_triangles.unwrap_or(4 * triangles + 50_000),
        mesh,
        deviations: HashMap::new(),
        images: HashMap::new(),
    };
    refining.until_nearly_linear();
    if let Some(find) = find {
        refining.until_nothing_crosses(find);
    }
    let diagonal = boundary.target_diagonal();
    let (deviation, triangles) = refining.deviation();
    let report = BoundaryRefinement {
        nodes_added: refining.mesh.vertices().len() - before,
        triangles,
        deviation: deviation / diagonal,
    };
    Ok((refining.mesh, report))
}

struct Refining<'a> {
    boundary: &'a BoundaryMap,
    query: SurfaceQuery,
    /// In units of the target.
    tolerance: f64,
    limit: usize,
    mesh: TetMesh,
    /// Largest distance of the map from the linear one over boundary triangles, by their ascending corners.
    deviations: HashMap<[u32; 3], f64>,
    /// Images of nodes on the boundary.
    images: HashMap<u32, Point>,
}

/// The sides of a triangle, with the lower end first.
fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
}

fn ascending(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

impl Refining<'_> {
    /// The boundary's triangles by the nodes of the mesh.
    fn triangles(&self) -> Vec<[u32; 3]> {
        let found = self.mesh.boundary();
        let node = |v: u32| found.vertex_ids[v as usize];
        found.surface.triangles().iter().map(|t| t.map(node)).collect()
    }

    /// Largest distance of the map from the linear one, and how many triangles there are.
    fn deviation(&self) -> (f64, usize) {
        let triangles = self.triangles();
        let known = triangles.iter().filter_map(|t| self.deviations.get(&ascending(*t)));
        (known.copied().fold(0.0, f64::max), triangles.len())
    }

    /// Images of points of the boundary.
    fn images_of(&self, points: &[Point]) -> Vec<Point> {
        let found = self.query.closest_points(points);
        let places: Vec<SurfacePoint> = found.iter().map(ClosestPoint::surface_point).collect();
        self.boundary.evaluate(&places)
    }

    /// Adds the images of the nodes of these triangles that have none.
    fn map_nodes(&mut self, triangles: &[[u32; 3]]) {
        let nodes: HashSet<u32> = triangles.iter().flatten().copied().collect();
        let mut nodes: Vec<u32> = nodes.into_iter().filter(|v| !self.images.contains_key(v)).collect();
        nodes.sort_unstable();
        let points: Vec<Point> = nodes.iter().map(|&v| self.mesh.vertices()[v as usize]).collect();
        let images = self.images_of(&points);
        self.images.extend(nodes.into_iter().zip(images));
    }

    fn until_nearly_linear(&mut self) {
        for round in 0..=MOST_ROUNDS {
            let sides = self.bent_sides();
            if sides.is_empty() || round == MOST_ROUNDS || !self.divide(&sides) {
                break;
            }
        }
    }

    /// Sides to be divided: those over which the map is not nearly linear; all of a triangle that only its inside shows.
    fn bent_sides(&mut self) -> HashSet<[u32; 2]> {
        let is_open = |t: &[u32; 3]| self.deviations.get(&ascending(*t)).is_none_or(|d| *d > self.tolerance);
        let open: Vec<[u32; 3]> = self.triangles().into_iter().filter(is_open).collect();
        self.map_nodes(&open);
        let mean = |corners: [Point; 3], weights: &[f64; 3]| {
            let sum: crate::Vector = (0..3).map(|k| corners[k].coords * weights[k]).sum();
            Point::from(sum)
        };
        let corners = |t: &[u32; 3]| t.map(|v| self.mesh.vertices()[v as usize]);
        let points: Vec<Point> = open
            .iter()
            .flat_map(|t| SAMPLES.map(|weights| mean(corners(t), &weights)))
            .collect();
        let found = self.images_of(&points);
        let mut bent = HashSet::new();
        for (t, found) in open.iter().zip(found.as_chunks::<{ SAMPLES.len() }>().0) {
            let corners = t.map(|v| self.images[&v]);
            let linear = SAMPLES.iter().map(|weights| mean(corners, weights));
            let deviations: Vec<f64> = linear
                .zip(found)
                .map(|(linear, image)| (image - linear).norm())
                .collect();
            let most = deviations.iter().copied().fold(0.0, f64::max);
            self.deviations.insert(ascending(*t), most);
            if most <= self.tolerance {
                continue;
            }
            let is_bent = |k: &usize| deviations[ON_SIDE * k..][..ON_SIDE].iter().any(|d| *d > self.tolerance);
            let of_sides: Vec<[u32; 2]> = (0..3).filter(is_bent).map(|k| sides(*t)[k]).collect();
            bent.extend(if of_sides.is_empty() {
                sides(*t).to_vec()
            } else {
                of_sides
            });
        }
        bent
    }

    /// Divides triangles whose images intersect, as long as that leaves fewer pairs of them: where the map folds, it does not.
    fn until_nothing_crosses(&mut self, find: FindSelfIntersections) {
        let (mut pairs, mut sides) = self.crossings(find);
        for _ in 0..CROSSING_ROUNDS {
            let before = self.mesh.clone();
            if pairs == 0 || !self.divide(&sides) {
                break;
            }
            self.until_nearly_linear();
            let left = self.crossings(find);
            if left.0 >= pairs {
                self.mesh = before;
                break;
            }
            (pairs, sides) = left;
        }
    }

    /// Pairs of triangles whose images intersect, and the sides of these triangles. What cannot be looked for is found out
    /// when the result is certified.
    fn crossings(&mut self, find: FindSelfIntersections) -> (usize, HashSet<[u32; 2]>) {
        let triangles = self.triangles();
        self.map_nodes(&triangles);
        let image = |v: u32| self.images.get(&v).copied().unwrap_or_default();
        let images = (0..self.mesh.vertices().len() as u32).map(image).collect();
        let surface = SurfaceMesh::new(images, triangles.clone()).expect("triangles name nodes");
        let pairs = find(&surface).unwrap_or_default();
        let crossing: HashSet<u32> = pairs.iter().flatten().copied().collect();
        let of_crossing = crossing.into_iter().flat_map(|t| sides(triangles[t as usize]));
        (pairs.len(), of_crossing.collect())
    }

    /// Divides sides of the boundary's triangles at their midpoints, and all edges of the tetrahedra at these triangles: a
    /// node inside that sees many triangles of a bent boundary would have no right place. `false` if there would be too
    /// many triangles.
    fn divide(&mut self, bent: &HashSet<[u32; 2]>) -> bool {
        let triangles = self.triangles();
        // Each of the two triangles at a side becomes one more.
        if triangles.len() + 2 * bent.len() > self.limit {
            return false;
        }
        let is_bent = |t: &&[u32; 3]| sides(**t).iter().any(|side| bent.contains(side));
        let at_bent: HashSet<[u32; 3]> = triangles.iter().filter(is_bent).map(|t| ascending(*t)).collect();
        let outer: HashSet<[u32; 2]> = triangles.iter().flat_map(|t| sides(*t)).collect();
        let mut edges = bent.clone();
        for &[a, b, c, d] in self.mesh.tets() {
            let faces = [[b, c, d], [a, c, d], [a, b, d], [a, b, c]];
            if faces.into_iter().any(|face| at_bent.contains(&ascending(face))) {
                let all = faces.into_iter().flat_map(sides);
                edges.extend(all.filter(|edge| !outer.contains(edge)));
            }
        }
        let mesh = std::mem::take(&mut self.mesh);
        let before = mesh.vertices().len();
        self.mesh = split_edges(mesh, &edges);
        self.mesh.vertices().len() > before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes;
    use crate::mesh::shapes;

    /// A cube whose boundary goes to a ball, each point in its direction, and a mesh of the cube.
    fn cube_to_ball() -> (BoundaryMap, TetMesh) {
        let mesh = test_meshes::cube(2);
        let centred = mesh
            .vertices()
            .iter()
            .map(|p| Point::from((p.coords * 2.0).add_scalar(-1.0)));
        let mesh = mesh.with_vertices(centred.collect()).unwrap();
        let cube = shapes::cube(2.0, 1);
        let copy = cube.clone();
        let image = move |p: &SurfacePoint| Point::from(p.position(&copy, copy.vertices()).coords.normalize());
        let unit = (Point::new(-1.0, -1.0, -1.0), Point::new(1.0, 1.0, 1.0));
        (BoundaryMap::by_function(cube, unit, image).unwrap(), mesh)
    }

    #[test]
    fn a_mesh_is_divided_where_the_boundary_map_bends_until_it_is_nearly_linear() {
        let (boundary, mesh) = cube_to_ball();
        let mut before = f64::INFINITY;
        for tolerance in [1e-1, 1e-2, 1e-3] {
            let options = RefinementOptions {
                tolerance,
                max_triangles: Some(1_000_000),
            };
            let (refined, report) = refined_at_boundary(&boundary, mesh.clone(), &options, None).unwrap();
            assert!(report.deviation <= tolerance && report.deviation < before, "{report:?}");
            before = report.deviation;
            assert_eq!(refined.vertices()[..mesh.vertices().len()], *mesh.vertices());
            assert_eq!(refined.vertices().len(), mesh.vertices().len() + report.nodes_added);
            assert!((refined.volume().abs() - 8.0).abs() < 1e-12);
            assert!((0..refined.tets().len()).all(|t| refined.signed_volume(t) > 0.0));
            // A conforming mesh: the boundary is closed, with nothing of the inside in it.
            let surface = refined.boundary().surface;
            assert_eq!(surface.triangles().len(), report.triangles);
            assert!((surface.area() - 24.0).abs() < 1e-11);
            let images: Vec<Point> = surface.vertices().iter().map(|p| p.coords.normalize().into()).collect();
            let ball = surface.with_vertices(images).unwrap().volume() * 0.75 / std::f64::consts::PI;
            // Second order: between its vertices the image is off by the tolerance at most.
            assert!(
                (1.0 - ball.abs()) < 3.0 * tolerance * 12f64.sqrt(),
                "{ball} at {tolerance}"
            );
        }
    }

    #[test]
    fn the_limit_on_triangles_is_kept_and_linear_maps_divide_nothing() {
        let (boundary, mesh) = cube_to_ball();
        let options = RefinementOptions {
            tolerance: 1e-6,
            max_triangles: Some(500),
        };
        let (_, report) = refined_at_boundary(&boundary, mesh.clone(), &options, None).unwrap();
        assert!(report.triangles <= 500 && report.deviation > 1e-6);
        let surface = mesh.boundary().surface;
        let images = surface
            .vertices()
            .iter()
            .map(|p| Point::new(2.0 * p.x, p.y, p.z.exp()))
            .collect();
        let linear = BoundaryMap::new(surface, images).unwrap();
        let (same, report) = refined_at_boundary(&linear, mesh.clone(), &options, None).unwrap();
        assert_eq!((same, report.nodes_added), (mesh.clone(), 0));
        let invalid = RefinementOptions {
            tolerance: f64::NAN,
            ..options
        };
        assert!(refined_at_boundary(&boundary, mesh, &invalid, None).is_err());
    }
}
