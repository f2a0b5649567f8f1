//! Bijective maps: there and back within rounding, the boundary where the boundary map has it, and errors where there is none.

#[cfg(feature = "native")]
use crate::common::models;
use crate::common::{boundary_map, interior_points, tets_of};
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::bijective::{Bijective, BijectiveError, BijectiveMap, BoundaryProof, make_bijective};
use solidmap::boundary_map::BoundaryMap;
#[cfg(feature = "native")]
use solidmap::fit::{FitOptions, fit};
use solidmap::inverse::PreimageStatus;
use solidmap::map::VolumeMap;
use solidmap::mesh::{SurfaceMesh, TetMesh, shapes};
use solidmap::remesh::RemeshOptions;
use solidmap::{Matrix3, Point, Vector};

/// A map by a formula.
struct Formula<F: Fn(&Point) -> Point + Sync>(F);

impl<F: Fn(&Point) -> Point + Sync> VolumeMap for Formula<F> {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(&self.0).collect()
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        points.iter().map(|_| Matrix3::identity()).collect()
    }
}

/// The cube from -1 to 1, and a mesh of it.
fn cube(cells: usize) -> (SurfaceMesh, TetMesh) {
    let surface = shapes::cube(2.0, 4);
    let mesh = tets_of(&surface, cells);
    (surface, mesh)
}

/// Stretched to 1000 at one end and squeezed to 1/1000 at the other: one to one.
fn graded(p: &Point) -> Point {
    Point::new(
        (3.0 * p.x).exp() * (1.0 + 0.2 * p.y),
        2.0 * p.y + 0.3 * p.x,
        p.z + 0.1 * p.y * p.y,
    )
}

/// The same on the boundary of the cube, and folded inside.
fn folded(p: &Point) -> Point {
    let bump = (1.0 - p.x * p.x) * (1.0 - p.y * p.y) * (1.0 - p.z * p.z);
    graded(p) + bump * Vector::new(4.0 * (9.0 * p.y).sin(), (7.0 * p.z).sin(), (8.0 * p.x).cos())
}

fn made(boundary: &BoundaryMap, map: &dyn VolumeMap, mesh: TetMesh) -> Result<Bijective, BijectiveError> {
    make_bijective(boundary, map, mesh, &RemeshOptions::default(), None, &|_| {})
}

#[test]
fn a_folded_map_becomes_one_that_goes_there_and_back_within_rounding() {
    let (surface, mesh) = cube(8);
    let boundary = boundary_map(&surface, graded);
    let Bijective { map, report } = made(&boundary, &Formula(folded), mesh.clone()).unwrap();
    assert!(report.inverted_as_mapped > 100, "{report:?}");
    assert!(report.difference_max > 0.01 && report.difference_rms < report.difference_max);
    assert_eq!(report.boundary, BoundaryProof::NotChecked);
    // The boundary is where the boundary map has it: at the vertices of the domain, which are nodes, exactly.
    for (p, image) in surface.vertices().iter().zip(boundary.image()) {
        assert_eq!(map.evaluate(&[*p])[0], *image);
    }
    let mut inside = interior_points(&surface, 100_000, 7);
    // On edges, on faces and at nodes, too.
    let mut random = StdRng::seed_from_u64(1);
    for _ in 0..2000 {
        let corners = map.domain().corners(random.random_range(0..map.domain().tets().len()));
        let [a, b] = [0, 0].map(|_| random.random_range(0..4));
        inside.push(nalgebra::center(&corners[a], &corners[b]));
    }
    let images = map.evaluate(&inside);
    let (found, report) = map.preimages(&images);
    assert_eq!(report.ok, inside.len(), "{report:?}");
    assert!(report.round_trip_max <= 1e-12, "{report:?}");
    let domain = surface.diagonal();
    for ((p, preimage), jacobian) in inside.iter().zip(&found).zip(map.jacobian(&inside)) {
        // An image is rounded, and the inverse stretches that by the inverse of the least singular value.
        let stretch = 1.0 / jacobian.singular_values().min();
        let bound = 1e-14 * (domain + stretch * 50.0) * 10.0;
        assert!(
            (preimage.point - p).norm() <= bound,
            "{p}: {} off, {bound:e} allowed",
            (preimage.point - p).norm()
        );
    }
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(one.install(|| map.evaluate(&inside)), images);
}

#[test]
fn an_affine_map_is_kept_and_its_jacobian_is_exact() {
    let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
    let affine = move |p: &Point| Point::from(matrix * p.coords + Vector::new(5.0, 0.0, -3.0));
    let (surface, mesh) = cube(6);
    let Bijective { map, report } = made(&boundary_map(&surface, affine), &Formula(affine), mesh).unwrap();
    assert!(report.difference_max < 1e-15 && report.inverted_as_mapped == 0 && report.gap < 1e-14);
    let points = interior_points(&surface, 500, 2);
    for ((p, image), jacobian) in points.iter().zip(map.evaluate(&points)).zip(map.jacobian(&points)) {
        assert!((image - affine(p)).norm() < 1e-14 && (jacobian - matrix).norm() < 1e-13);
    }
}

#[test]
fn points_outside_are_told_and_those_in_the_gap_have_the_nearest_preimage() {
    let (surface, mesh) = cube(4);
    let identity = |p: &Point| *p;
    let Bijective { map, .. } = made(&boundary_map(&surface, identity), &Formula(identity), mesh).unwrap();
    let points = [[0.3, 0.2, 1.0], [0.3, 0.2, 1.05], [0.3, 0.2, 1.2], [f64::NAN, 0.0, 0.0]].map(Point::from);
    use PreimageStatus::{NotFinite, Ok, Outside};
    for (gap, expected) in [
        (0.0, [Ok, Outside, Outside, NotFinite]),
        (0.1, [Ok, Ok, Outside, NotFinite]),
    ] {
        let (found, report) = map.clone().with_gap(gap).preimages(&points);
        assert_eq!(found.iter().map(|p| p.status).collect::<Vec<_>>(), expected);
        assert_eq!((report.ok + report.outside, report.not_finite), (3, 1));
        for preimage in &found[..3] {
            assert!((preimage.point - Point::new(0.3, 0.2, 1.0)).norm() < 1e-15);
        }
        assert!((found[1].round_trip - 0.05 / surface.diagonal()).abs() < 1e-12);
    }
    assert!(map.evaluate(&[points[3]])[0].iter().all(|c| c.is_nan()));
}

#[test]
fn what_is_not_one_to_one_is_refused_and_says_where() {
    let (surface, mesh) = cube(4);
    let mirrored = |p: &Point| Point::new(-p.x, p.y, p.z);
    let error = made(&boundary_map(&surface, mirrored), &Formula(mirrored), mesh.clone()).unwrap_err();
    assert!(error.to_string().contains("mirrors the solid"), "{error}");
    // One vertex drawn through the opposite face: a corner of its tetrahedra is inverted, and nothing inside can help.
    let pulled = |p: &Point| {
        if p.x == 1.0 && p.y == 0.0 && p.z == 0.0 {
            Point::new(-3.0, 0.0, 0.0)
        } else {
            *p
        }
    };
    let error = made(&boundary_map(&surface, pulled), &Formula(|p: &Point| *p), mesh.clone()).unwrap_err();
    assert!(matches!(error, BijectiveError::NotRepaired { .. }), "{error}");

    let mut images = mesh.vertices().to_vec();
    let inner = (0..images.len()).find(|&v| images[v].coords.amax() < 0.1).unwrap();
    images[inner] += Vector::new(3.0, 0.0, 0.0);
    let error = BijectiveMap::new(mesh.clone(), images.clone()).unwrap_err();
    assert!(
        matches!(
            error,
            BijectiveError::Inverted {
                solid: "target",
                count: 1..,
                ..
            }
        ),
        "{error}"
    );
    images.pop();
    assert!(matches!(
        BijectiveMap::new(mesh, images),
        Err(BijectiveError::ImageCount { .. })
    ));
    let empty = BijectiveMap::new(TetMesh::new(vec![], vec![]).unwrap(), vec![]);
    assert!(matches!(empty, Err(BijectiveError::NoTets)));
}

/// A rod bent into more than a full turn, whose ends overlap: no tetrahedron is inverted, and yet two points meet.
#[cfg(feature = "native")]
#[test]
fn a_boundary_that_meets_itself_is_found_although_no_tetrahedron_is_inverted() {
    let rod = |turn: f64| {
        move |p: &Point| {
            let (angle, radius) = (turn * p.x, 3.0 - 0.3 * p.y);
            Point::new(radius * angle.sin(), radius * angle.cos(), 0.3 * p.z)
        }
    };
    let find = |mesh: &SurfaceMesh| solidmap::cgal_tetgen::self_intersections(mesh).map_err(|error| error.to_string());
    let (_, mesh) = cube(12);
    for (turn, is_one_to_one) in [(2.5, true), (3.5, false)] {
        let images: Vec<Point> = mesh.vertices().iter().map(rod(turn)).collect();
        let map = BijectiveMap::new(mesh.clone(), images).unwrap();
        let certificate = map.certificate(Some(&find));
        assert_eq!(certificate.is_one_to_one(), is_one_to_one, "{certificate:?}");
        assert_eq!(certificate.target_problems.is_empty(), is_one_to_one);
        assert!(certificate.domain_problems.is_empty() && certificate.boundary_checked);
    }
}

/// A real body, bent: its harmonic map need not be one to one, the result is.
#[cfg(feature = "native")]
#[test]
fn a_bent_model_has_a_bijective_map_that_is_proved() {
    let Some(models) = models() else { return };
    let domain = solidmap::io::read_surface(models.join("surfaces/spot_uv_2k9.obj")).unwrap();
    let boundary = boundary_map(&domain, |p| {
        let (s, c) = (1.5 * p.z).sin_cos();
        Point::new(c * p.x - s * p.y, s * p.x + c * p.y, p.z)
    });
    let map = fit(&boundary, &FitOptions::default(), &|_| {}).unwrap().map;
    let mesh = solidmap::cgal_tetgen::tetrahedralize(&domain, &Default::default()).unwrap();
    let find = |mesh: &SurfaceMesh| solidmap::cgal_tetgen::self_intersections(mesh).map_err(|error| error.to_string());
    let options = RemeshOptions::default();
    let Bijective { map, report } = make_bijective(&boundary, &map, mesh, &options, Some(&find), &|_| {}).unwrap();
    assert_eq!(report.boundary, BoundaryProof::OneToOne);
    let (_, back) = map.preimages(&map.evaluate(&interior_points(&domain, 20_000, 3)));
    assert_eq!(back.ok, 20_000);
    assert!(back.round_trip_max <= 1e-12, "{back:?}");
}
