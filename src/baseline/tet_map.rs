use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::stiffness::{ScaledTet, check_vertices};
use super::{BaselineError, check_images};
use crate::geometry::{TetLocator, TetPoint, morton_order};
use crate::map::VolumeMap;
use crate::mesh::TetMesh;
use crate::{Matrix3, Point, Vector};

/// A map of a tetrahedral mesh that is linear over each tetrahedron: it is given by the images of the vertices.
///
/// It is continuous, and its Jacobian is constant in each tetrahedron; on a face between two, that of either. A point
/// outside of the mesh, such as one of a curved boundary, has the image of the closest point of the mesh and the
/// Jacobian of the tetrahedron there. Flat tetrahedra are skipped: their points have the image of the closest point
/// of another. At points that are not finite, image and Jacobian are NaN.
///
/// A tree over the tetrahedra is built at the first evaluation, some tenths of a second per million, and shared by the
/// maps of one [`super::TetHarmonic`] or [`super::TetLaplacian`].
#[derive(Debug, Clone)]
pub struct TetMap {
    solid: Arc<SharedMesh>,
    images: Vec<Point>,
}

/// A mesh with its locator, which is built when first needed.
#[derive(Debug)]
pub(super) struct SharedMesh {
    pub mesh: TetMesh,
    locator: OnceLock<TetLocator>,
}

impl SharedMesh {
    pub fn new(mesh: TetMesh) -> Self {
        let locator = OnceLock::new();
        Self { mesh, locator }
    }
}

/// Points per task.
const RUN: usize = 512;

impl TetMap {
    /// The map that carries vertex `v` of the mesh to `images[v]`.
    ///
    /// # Errors
    ///
    /// [`BaselineError::NoTets`], [`BaselineError::NonFiniteVertex`] for a vertex of a tetrahedron,
    /// [`BaselineError::ImageCount`], [`BaselineError::NonFiniteImage`], and [`BaselineError::NoVolume`] when all
    /// tetrahedra are flat.
    pub fn new(mesh: TetMesh, images: Vec<Point>) -> Result<Self, BaselineError> {
        check_vertices(&mesh)?;
        check_images(&images, mesh.vertices().len())?;
        let tets = mesh.tets().len();
        if !(0..tets).any(|t| ScaledTet::new(&mesh.corners(t)).is_some()) {
            return Err(BaselineError::NoVolume { tets });
        }
        Ok(Self::of(Arc::new(SharedMesh::new(mesh)), images))
    }

    /// As [`Self::new`], for what has been checked.
    pub(super) fn of(solid: Arc<SharedMesh>, images: Vec<Point>) -> Self {
        Self { solid, images }
    }

    /// The mesh of the domain.
    pub fn mesh(&self) -> &TetMesh {
        &self.solid.mesh
    }

    /// The image of each vertex.
    pub fn images(&self) -> &[Point] {
        &self.images
    }

    /// The image of the mesh: the same tetrahedra over the images of the vertices.
    pub fn target(&self) -> TetMesh {
        self.mesh()
            .with_vertices(self.images.clone())
            .expect("one image per vertex")
    }

    /// The Jacobian in each tetrahedron; NaN in flat ones.
    pub fn jacobians(&self) -> Vec<Matrix3> {
        let tets = 0..self.mesh().tets().len() as u32;
        tets.into_par_iter().map(|t| self.jacobian_in(t)).collect()
    }

    fn jacobian_in(&self, tet: u32) -> Matrix3 {
        let Some(frame) = ScaledTet::new(&self.mesh().corners(tet as usize)) else {
            return Matrix3::repeat(f64::NAN);
        };
        let [a, b, c, d] = self.mesh().tets()[tet as usize].map(|v| self.images[v as usize]);
        Matrix3::from_columns(&[b - a, c - a, d - a]) * frame.inverse()
    }

    /// The value at each point, found along a space-filling curve, so that neighbours read the same part of the tree;
    /// `undefined` at points that are not finite.
    fn at_points<T: Copy + Send + Sync>(
        &self,
        points: &[Point],
        undefined: T,
        value: impl Fn(&TetPoint) -> T + Sync,
    ) -> Vec<T> {
        let locator = self.solid.locator.get_or_init(|| {
            let mesh = &self.solid.mesh;
            TetLocator::new(mesh, |t| ScaledTet::new(&mesh.corners(t)).is_some())
        });
        let order = morton_order(points);
        let found: Vec<T> = order
            .par_chunks(RUN)
            .flat_map_iter(|run| {
                let locate = |&i: &u32| locator.locate_by(&self.solid.mesh, &points[i as usize], weights_inside);
                run.iter().map(locate).map(|at| at.as_ref().map_or(undefined, &value))
            })
            .collect();
        let mut values = vec![undefined; points.len()];
        for (&i, value) in order.iter().zip(found) {
            values[i as usize] = value;
        }
        values
    }
}

impl VolumeMap for TetMap {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        self.at_points(points, Point::from(Vector::repeat(f64::NAN)), |at| {
            let corners = self.mesh().tets()[at.tet as usize].map(|v| self.images[v as usize].coords);
            let weighted = corners.iter().zip(at.barycentric).map(|(image, weight)| image * weight);
            Point::from(weighted.sum::<Vector>())
        })
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        self.at_points(points, Matrix3::repeat(f64::NAN), |at| self.jacobian_in(at.tet))
    }
}

/// Weights of the corners at `p`, if none is negative.
fn weights_inside(corners: &[Point; 4], p: &Point) -> Option<[f64; 4]> {
    let [second, third, fourth] = (ScaledTet::new(corners)?.inverse() * (p - corners[0])).into();
    let weights: [f64; 4] = [1.0 - second - third - fourth, second, third, fourth];
    weights.iter().all(|&w| w >= 0.0).then_some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, cube, torus};
    use rand::{Rng, SeedableRng, rngs::StdRng};

    fn linear() -> (Matrix3, Vector) {
        let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        (matrix, Vector::new(3.0, -1.0, 0.5))
    }

    fn affine_map(mesh: TetMesh) -> TetMap {
        let (matrix, shift) = linear();
        let images = mesh.vertices().iter().map(|p| matrix * p + shift).collect();
        TetMap::new(mesh, images).unwrap()
    }

    fn points_in(mesh: &TetMesh, count: usize) -> Vec<Point> {
        let mut random = StdRng::seed_from_u64(7);
        let mut point = || {
            let corners = mesh.corners(random.random_range(0..mesh.tets().len()));
            let weights: [f64; 4] = std::array::from_fn(|_| -random.random::<f64>().ln());
            let weighted = corners.iter().zip(weights).map(|(c, w)| c.coords * w);
            Point::from(weighted.sum::<Vector>() / weights.iter().sum::<f64>())
        };
        (0..count).map(|_| point()).collect()
    }

    #[test]
    fn linear_maps_are_reproduced_everywhere_inside() {
        let (matrix, shift) = linear();
        for mesh in [cube(4), ball(4), torus(3)] {
            let points = points_in(&mesh, 2000);
            let map = affine_map(mesh);
            for (p, image) in points.iter().zip(map.evaluate(&points)) {
                assert!((image - (matrix * p + shift)).norm() < 1e-13);
            }
            assert!(map.jacobian(&points).iter().all(|j| (j - matrix).norm() < 1e-12));
            assert!(map.jacobians().iter().all(|j| (j - matrix).norm() < 1e-12));
        }
    }

    #[test]
    fn vertices_have_their_images() {
        let mesh = torus(4);
        let image = |p: &Point| Point::new(p.x * p.y, p.z.exp(), p.x - p.z * p.z);
        let images: Vec<Point> = mesh.vertices().iter().map(image).collect();
        let map = TetMap::new(mesh.clone(), images.clone()).unwrap();
        for (found, image) in map.evaluate(mesh.vertices()).iter().zip(&images) {
            assert!((found - image).norm() < 1e-13);
        }
        assert_eq!(map.target().vertices(), images);
    }

    #[test]
    fn jacobian_is_the_slope_within_a_tetrahedron() {
        let mesh = ball(3);
        let image = |p: &Point| Point::new(p.x * p.y, p.z.exp(), p.x - p.z * p.z);
        let map = TetMap::new(mesh.clone(), mesh.vertices().iter().map(image).collect()).unwrap();
        let jacobians = map.jacobians();
        for (t, tet) in mesh.tets().iter().enumerate() {
            let [a, b, c, d] = tet.map(|v| v as usize);
            for v in [b, c, d] {
                let step = jacobians[t] * (mesh.vertices()[v] - mesh.vertices()[a]);
                assert!((step - (map.images()[v] - map.images()[a])).norm() < 1e-13);
            }
            let middle = nalgebra::center(
                &nalgebra::center(&mesh.vertices()[a], &mesh.vertices()[b]),
                &nalgebra::center(&mesh.vertices()[c], &mesh.vertices()[d]),
            );
            assert_eq!(map.jacobian(&[middle])[0], jacobians[t]);
        }
    }

    #[test]
    fn points_outside_have_the_image_of_the_closest_point() {
        let map = affine_map(cube(3));
        let (matrix, shift) = linear();
        let outside = [[1.3, 0.4, 0.2], [-2.0, 0.5, 0.7], [1.5, 1.5, 0.4], [7.0, -3.0, 2.0]].map(Point::from);
        for (p, image) in outside.iter().zip(map.evaluate(&outside)) {
            let clamped = p.map(|c| c.clamp(0.0, 1.0));
            assert!((image - (matrix * clamped + shift)).norm() < 1e-13);
        }
        assert!(map.jacobian(&outside).iter().all(|j| (j - matrix).norm() < 1e-13));
    }

    #[test]
    fn flat_tetrahedra_are_skipped() {
        let mesh = cube(2);
        let flat = [[0, 1, 2, 2], [0, 2, 6, 8], [4, 4, 4, 4]];
        let tets = [&flat, mesh.tets()].concat();
        let with_flat = TetMesh::new(mesh.vertices().to_vec(), tets).unwrap();
        let map = affine_map(with_flat);
        let points = [points_in(&mesh, 200), mesh.vertices().to_vec()].concat();
        let (matrix, shift) = linear();
        for (p, image) in points.iter().zip(map.evaluate(&points)) {
            assert!((image - (matrix * p + shift)).norm() < 1e-13);
        }
        assert!(map.jacobian(&points).iter().all(|j| (j - matrix).norm() < 1e-12));
        assert!(map.jacobians()[..3].iter().all(|j| j.iter().all(|x| x.is_nan())));
    }

    #[test]
    fn points_that_are_not_finite_have_no_image() {
        let map = affine_map(cube(2));
        let points = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(|x| Point::new(x, 0.5, 0.5));
        assert!(map.evaluate(&points).iter().all(|p| p.iter().all(|c| c.is_nan())));
        assert!(map.jacobian(&points).iter().all(|j| j.iter().all(|c| c.is_nan())));
        assert!(map.evaluate(&[]).is_empty());
    }

    #[test]
    fn results_do_not_depend_on_threads_or_other_points() {
        let map = affine_map(ball(5));
        let points = [points_in(map.mesh(), 3000), map.mesh().vertices().to_vec()].concat();
        let together = (map.evaluate(&points), map.jacobian(&points));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| (map.evaluate(&points), map.jacobian(&points))), together);
        for i in (0..points.len()).step_by(97) {
            assert_eq!(map.evaluate(&points[i..=i])[0], together.0[i]);
            assert_eq!(map.jacobian(&points[i..=i])[0], together.1[i]);
        }
    }

    #[test]
    fn rejects_invalid_meshes_and_images() {
        let mesh = cube(1);
        let images = mesh.vertices().to_vec();
        let error = |mesh: &TetMesh, images: &[Point]| TetMap::new(mesh.clone(), images.to_vec()).unwrap_err();
        assert_eq!(error(&TetMesh::default(), &[]), BaselineError::NoTets);
        assert_eq!(
            error(&mesh, &images[1..]),
            BaselineError::ImageCount { expected: 8, found: 7 }
        );
        let mut broken = images.clone();
        broken[5].z = f64::NAN;
        assert!(matches!(
            error(&mesh, &broken),
            BaselineError::NonFiniteImage { index: 5, .. }
        ));
        let non_finite = mesh.with_vertices(broken).unwrap();
        assert!(matches!(
            error(&non_finite, &images),
            BaselineError::NonFiniteVertex { vertex: 5, .. }
        ));
        let flat = mesh.with_vertices(vec![Point::origin(); 8]).unwrap();
        assert_eq!(error(&flat, &images), BaselineError::NoVolume { tets: 6 });
    }
}
