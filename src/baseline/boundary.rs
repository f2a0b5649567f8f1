//! The boundary of a tetrahedral mesh, and where a boundary map takes it.

use rayon::prelude::*;

use super::BaselineError;
use super::stiffness::{Incidence, check_vertices};
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::geometry::{ClosestPoint, SurfaceQuery};
use crate::mesh::TetMesh;

/// Images of the boundary vertices of a tetrahedral mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryImages {
    /// The boundary vertices: [`boundary_vertices`].
    pub vertices: Vec<u32>,
    /// Their images.
    pub images: Vec<Point>,
    /// How many of them are vertices of the domain's surface, of the same index and at the same place.
    pub shared: usize,
    /// Largest distance of the others from the domain's surface, in model units: rounding errors with a mesher that
    /// keeps the surface, and the distance between the two surfaces with one that makes its own.
    pub farthest: f64,
}

/// The vertices of the triangles that belong to one tetrahedron only, ascending: those of [`TetMesh::boundary`], several
/// times faster.
pub fn boundary_vertices(mesh: &TetMesh) -> Vec<u32> {
    vertices_of(&boundary_faces(mesh, &Incidence::new(mesh)))
}

/// Images of the boundary vertices of a mesh of the domain.
///
/// A mesh whose first vertices are the domain's, as TetGen writes it, takes their images as they are. Any other boundary
/// vertex goes where the boundary map sends the closest point of the domain's surface.
///
/// # Errors
///
/// [`BaselineError::NoTets`], [`BaselineError::NonFiniteVertex`], and [`BaselineError::Domain`] when the domain's surface
/// has no closest points.
pub fn boundary_images(mesh: &TetMesh, boundary: &BoundaryMap) -> Result<BoundaryImages, BaselineError> {
    check_vertices(mesh)?;
    let vertices = boundary_vertices(mesh);
    let known = boundary.domain().vertices();
    let is_shared = |v: u32| known.get(v as usize) == Some(&mesh.vertices()[v as usize]);
    let others: Vec<u32> = vertices.iter().copied().filter(|&v| !is_shared(v)).collect();

    let mut farthest = 0.0;
    let mut of_others = Vec::new();
    if !others.is_empty() {
        let positions: Vec<Point> = others.iter().map(|&v| mesh.vertices()[v as usize]).collect();
        let closest = SurfaceQuery::new(boundary.domain())?.closest_points(&positions);
        farthest = closest.iter().map(|c| c.distance).fold(0.0, f64::max);
        let on_surface = closest.iter().map(ClosestPoint::surface_point);
        of_others = boundary.evaluate(&on_surface.collect::<Vec<_>>());
    }
    let shared = vertices.len() - others.len();
    let mut of_others = of_others.into_iter();
    let image = |&v: &u32| {
        if is_shared(v) {
            boundary.image()[v as usize]
        } else {
            of_others.next().expect("one image for each of the others")
        }
    };
    let images = vertices.iter().map(image).collect();
    Ok(BoundaryImages {
        vertices,
        images,
        shared,
        farthest,
    })
}

/// The triangles that belong to one tetrahedron only, their corners ascending.
pub(super) fn boundary_faces(mesh: &TetMesh, incidence: &Incidence) -> Vec<[u32; 3]> {
    let of_lowest = |faces: &mut Vec<[u32; 2]>, lowest: u32| {
        faces.clear();
        for &t in incidence.of(lowest) {
            let mut corners = mesh.tets()[t as usize];
            corners.sort_unstable();
            let [a, b, c, d] = corners;
            if a == lowest {
                faces.extend([[b, c], [b, d], [c, d]]);
            } else if b == lowest {
                faces.push([c, d]);
            }
        }
        faces.sort_unstable();
        let alone = faces.chunk_by(|f, g| f == g).filter(|same| same.len() == 1);
        alone.map(|same| [lowest, same[0][0], same[0][1]]).collect::<Vec<_>>()
    };
    (0..mesh.vertices().len() as u32)
        .into_par_iter()
        .with_min_len(1024)
        .map_init(Vec::new, of_lowest)
        .flatten_iter()
        .collect()
}

/// The vertices of these triangles, ascending.
pub(super) fn vertices_of(faces: &[[u32; 3]]) -> Vec<u32> {
    let mut vertices = faces.as_flattened().to_vec();
    vertices.par_sort_unstable();
    vertices.dedup();
    vertices
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, cube, torus};
    use crate::mesh::shapes;

    #[test]
    fn boundary_vertices_are_those_of_the_boundary_surface() {
        for mesh in [cube(3), ball(4), torus(5)] {
            assert_eq!(boundary_vertices(&mesh), mesh.boundary().vertex_ids);
            let reversed = mesh.tets().iter().map(|&[a, b, c, d]| [c, b, a, d]).collect();
            let reversed = TetMesh::new(mesh.vertices().to_vec(), reversed).unwrap();
            assert_eq!(boundary_vertices(&reversed), mesh.boundary().vertex_ids);
        }
        assert!(boundary_vertices(&TetMesh::default()).is_empty());
    }

    fn bend(p: &Point) -> Point {
        Point::new(p.x + p.y * p.z, 2.0 * p.y, p.z - p.x * p.x)
    }

    #[test]
    fn shared_vertices_have_exactly_their_images() {
        let mesh = ball(4);
        let surface = mesh.boundary();
        // The surface's vertices first, as a mesher that keeps the surface has them.
        let mut order = surface.vertex_ids.clone();
        order.extend((0..mesh.vertices().len() as u32).filter(|v| surface.vertex_ids.binary_search(v).is_err()));
        let mut place = vec![0; order.len()];
        order
            .iter()
            .enumerate()
            .for_each(|(new, &old)| place[old as usize] = new as u32);
        let vertices = order.iter().map(|&v| mesh.vertices()[v as usize]).collect();
        let tets = mesh.tets().iter().map(|t| t.map(|v| place[v as usize])).collect();
        let renumbered = TetMesh::new(vertices, tets).unwrap();

        let image: Vec<Point> = surface.surface.vertices().iter().map(bend).collect();
        let map = BoundaryMap::new(surface.surface, image.clone()).unwrap();
        let found = boundary_images(&renumbered, &map).unwrap();
        assert_eq!(found.images, image);
        assert_eq!((found.shared, found.farthest), (image.len(), 0.0));

        // With other indices they are found by their positions.
        let found = boundary_images(&mesh, &map).unwrap();
        assert!(found.shared < image.len() && found.farthest == 0.0);
        for (a, b) in found.images.iter().zip(&image) {
            assert!((a - b).norm() < 1e-15);
        }
    }

    #[test]
    fn vertices_of_a_finer_surface_are_interpolated() {
        let domain = shapes::cube(1.0, 2);
        let linear = |p: &Point| Point::new(p.x + 2.0 * p.y, p.y - p.z, 0.5 * p.z + 3.0);
        let map = BoundaryMap::between(domain.clone(), &shapes::deformed(&domain, linear)).unwrap();
        let mesh = cube(5);
        let centred: Vec<Point> = mesh.vertices().iter().map(|p| p - crate::Vector::repeat(0.5)).collect();
        let mesh = mesh.with_vertices(centred).unwrap();
        let found = boundary_images(&mesh, &map).unwrap();
        assert!(found.farthest < 1e-15);
        for (&v, image) in found.vertices.iter().zip(&found.images) {
            assert!((linear(&mesh.vertices()[v as usize]) - image).norm() < 1e-14);
        }
    }

    #[test]
    fn rejects_meshes_without_tetrahedra() {
        let map = BoundaryMap::new(shapes::cube(1.0, 1), shapes::cube(2.0, 1).vertices().to_vec()).unwrap();
        assert_eq!(boundary_images(&TetMesh::default(), &map), Err(BaselineError::NoTets));
    }
}
