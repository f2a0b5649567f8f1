//! Transfer of fields: exact where it can be, and never a label that was not there.

use crate::common::boundary_map;
use solidmap::energy::{GridResolution, clipped_grid};
use solidmap::inverse::{InverseMap, InverseOptions, lattice_mesh};
use solidmap::map::VolumeMap;
use solidmap::mesh::{CellList, HEXAHEDRON, SurfaceMesh, TetMesh, shapes};
use solidmap::transfer::{
    FieldKind, FieldMesh, FieldSampler, TransferError, TransferField, distribution_check, label_shares, push_forward,
    resample, volume_check,
};
use solidmap::{Matrix3, Point, Vector};

/// `A x + b`.
struct Affine(Matrix3, Vector);

impl VolumeMap for Affine {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|p| Point::from(self.0 * p.coords + self.1)).collect()
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        vec![self.0; points.len()]
    }
}

fn stretch() -> Affine {
    let matrix = Matrix3::new(2.0, 0.3, 0.0, -0.1, 1.0, 0.4, 0.2, 0.0, 0.8);
    Affine(matrix, Vector::new(1.0, -2.0, 0.5))
}

fn rotation() -> Affine {
    Affine(
        *nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0).matrix(),
        Vector::zeros(),
    )
}

fn field(name: &str, components: usize, kind: FieldKind, values: Vec<f64>) -> TransferField {
    TransferField {
        name: name.into(),
        components,
        values,
        kind,
    }
}

fn linear(p: &Point) -> f64 {
    3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 1.0
}

/// Whole numbers by octant of the ball.
fn octant(p: &Point) -> f64 {
    (0..3).map(|k| if p[k] > 0.0 { f64::from(1 << k) } else { 0.0 }).sum()
}

fn ball() -> SurfaceMesh {
    shapes::sphere(1.0, 3)
}

/// A tet mesh of the ball with fields of all kinds.
fn carrier() -> FieldMesh {
    let mesh: TetMesh = lattice_mesh(&ball(), 2000).unwrap();
    let points = mesh.vertices().to_vec();
    let over_points = |f: &dyn Fn(&Point) -> f64| points.iter().map(f).collect::<Vec<f64>>();
    let swirl = points.iter().flat_map(|p| [-p.y, p.x, 0.5]).collect();
    let sizes = (0..mesh.tets().len()).map(|t| t as f64).collect();
    FieldMesh {
        point_fields: vec![
            field("linear", 1, FieldKind::Values, over_points(&linear)),
            field("swirl", 3, FieldKind::Vector, swirl),
            field("octant", 1, FieldKind::Label, over_points(&octant)),
        ],
        cell_fields: vec![field("number", 1, FieldKind::Label, sizes)],
        cells: CellList::Tets(mesh.tets().to_vec()),
        points,
    }
}

#[test]
fn carrying_keeps_values_and_connectivity_and_moves_points_exactly() {
    let (map, given) = (stretch(), carrier());
    let carried = push_forward(&map, &given).unwrap();
    assert_eq!(carried.points, map.evaluate(&given.points));
    assert_eq!(carried.cells, given.cells);
    assert_eq!(carried.point_fields[0], given.point_fields[0]);
    assert_eq!(carried.cell_fields, given.cell_fields);
    for (before, after) in given.point_fields[1]
        .values
        .chunks(3)
        .zip(carried.point_fields[1].values.chunks(3))
    {
        let pushed = map.0 * Vector::from_column_slice(before);
        assert!((pushed - Vector::from_column_slice(after)).amax() < 1e-15 * 8.0);
    }
}

#[test]
fn the_identity_changes_nothing() {
    let given = carrier();
    assert_eq!(
        push_forward(&Affine(Matrix3::identity(), Vector::zeros()), &given).unwrap(),
        given
    );
}

#[test]
fn a_rotation_keeps_the_lengths_of_vectors() {
    let given = carrier();
    let carried = push_forward(&rotation(), &given).unwrap();
    let lengths = |carrier: &FieldMesh| -> Vec<f64> {
        let vectors = carrier.point_fields[1].values.chunks(3);
        vectors.map(|v| Vector::from_column_slice(v).norm()).collect()
    };
    let pairs = lengths(&given).into_iter().zip(lengths(&carried));
    assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-14));
    assert_ne!(given.point_fields[1], carried.point_fields[1]);
}

/// Interpolation of a linear field is exact, and the inverse errs by 1e-10 of a diagonal of 5, times a slope of 4.
#[test]
fn resampling_a_linear_field_through_an_affine_map_is_exact() {
    let (map, given, domain) = (stretch(), carrier(), ball());
    let boundary = boundary_map(&domain, |p| Point::from(map.0 * p.coords + map.1));
    let inverse = InverseMap::new(&map, &boundary, &InverseOptions::default()).unwrap();
    let places: Vec<Point> = crate::common::interior_points(&domain, 500, 7)
        .iter()
        .map(|p| p * 0.85)
        .collect();
    let mut at = map.evaluate(&places);
    at.push(Point::new(100.0, 0.0, 0.0));
    let found = resample(&map, &inverse, &given, &at).unwrap();
    let names: Vec<&str> = found.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["linear", "swirl", "octant", "number"]);
    for (i, place) in places.iter().enumerate() {
        assert!((found.fields[0].values[i] - linear(place)).abs() < 2e-9);
        let swirl = map.0 * Vector::new(-place.y, place.x, 0.5);
        assert!((swirl - Vector::from_column_slice(&found.fields[1].values[3 * i..][..3])).amax() < 1e-8);
        let label = found.fields[2].values[i];
        assert!(label.fract() == 0.0 && (0.0..8.0).contains(&label));
        assert_eq!(found.fields[3].values[i].fract(), 0.0);
    }
    assert!(found.fields.iter().all(|field| field.values.last().unwrap().is_nan()));
    assert_eq!(
        (found.inverse.ok, found.inverse.outside, found.outside_mesh),
        (500, 1, 0)
    );
}

#[test]
fn without_tetrahedra_values_are_those_of_the_nearest_point() {
    let points = vec![
        Point::new(0.0, 0.0, 0.0),
        Point::new(1.0, 0.0, 0.0),
        Point::new(f64::NAN, 0.5, 0.0),
    ];
    let carrier = FieldMesh {
        points,
        point_fields: vec![field("a", 1, FieldKind::Values, vec![5.0, 7.0, 9.0])],
        ..FieldMesh::default()
    };
    let asked = [0.1, 0.6, -4.0, f64::NAN].map(|x| Point::new(x, 0.0, 0.0));
    let (fields, beyond) = FieldSampler::new(&carrier).unwrap().sample(&asked);
    assert_eq!(fields[0].values[..3], [5.0, 7.0, 5.0]);
    assert!(fields[0].values[3].is_nan());
    assert_eq!(beyond, [false; 4]);
}

/// The unit cube of 27 cells, each cut into six tetrahedra, with a linear field and labels.
fn cube() -> (TetMesh, FieldMesh) {
    let at = |i: u32| [i % 4, i / 4 % 4, i / 16];
    let points: Vec<Point> = (0..64)
        .map(|i| Point::from(at(i).map(|k| f64::from(k) / 3.0)))
        .collect();
    let mut tets = vec![];
    for first in (0..64).filter(|&i| at(i).iter().all(|&k| k < 3)) {
        for [a, b, c] in [[1, 4, 16], [4, 16, 1], [16, 1, 4]] {
            let end = first + 21;
            tets.push([first, first + a, first + a + b, end]);
            tets.push([first, first + a + c, first + a, end]);
        }
    }
    let carrier = FieldMesh {
        point_fields: vec![field(
            "linear",
            1,
            FieldKind::Values,
            points.iter().map(linear).collect(),
        )],
        cell_fields: vec![field(
            "number",
            1,
            FieldKind::Label,
            (0..tets.len()).map(|t| t as f64).collect(),
        )],
        cells: CellList::Tets(tets.clone()),
        points: points.clone(),
    };
    (TetMesh::new(points, tets).unwrap(), carrier)
}

#[test]
fn a_little_outside_the_field_is_that_of_the_closest_boundary_point() {
    let (_, carrier) = cube();
    let sampler = FieldSampler::new(&carrier).unwrap();
    let sides = [
        Point::new(1.0, 0.21, 0.67),
        Point::new(0.4, 0.9, 0.0),
        Point::new(0.12, 1.0, 1.0),
    ];
    let outward = [Vector::x(), -Vector::z(), Vector::new(0.0, 1.0, 2.0)];
    for (far, is_beyond) in [(0.0, false), (1e-13, false), (1e-7, false), (1e-3, true), (5.0, true)] {
        let asked: Vec<Point> = sides.iter().zip(&outward).map(|(p, n)| p + n * far).collect();
        let (fields, beyond) = sampler.sample(&asked);
        assert_eq!(beyond, [is_beyond; 3], "{far}");
        for (side, value) in sides.iter().zip(&fields[0].values) {
            assert!((value - linear(side)).abs() < 1e-12, "{far}: {value}");
        }
    }
    // Fields over tetrahedra are those of the tetrahedron behind the side.
    let inside = sampler.sample(&[Point::new(0.99, 0.21, 0.67)]).0;
    let outside = sampler.sample(&[Point::new(1.01, 0.21, 0.67)]).0;
    assert_eq!(inside[1].values, outside[1].values);
}

/// As inside: the inverse errs by 1e-10 of a diagonal of 3, times a slope of 4.
#[test]
fn resampling_a_linear_field_is_exact_on_the_boundary_too() {
    let (map, (mesh, given)) = (stretch(), cube());
    let domain = mesh.boundary().surface;
    let boundary = boundary_map(&domain, |p| Point::from(map.0 * p.coords + map.1));
    let inverse = InverseMap::new(&map, &boundary, &InverseOptions::default()).unwrap();
    let weights = [[1.0, 0.0, 0.0], [0.3, 0.7, 0.0], [0.2, 0.5, 0.3]];
    let places: Vec<Point> = (0..domain.triangles().len())
        .flat_map(|t| {
            let corners = domain.corners(t);
            weights.map(|w| Point::from((0..3).map(|k| corners[k].coords * w[k]).sum::<Vector>()))
        })
        .collect();
    let found = resample(&map, &inverse, &given, &map.evaluate(&places)).unwrap();
    assert_eq!(found.outside_mesh, 0);
    for (place, value) in places.iter().zip(&found.fields[0].values) {
        assert!((value - linear(place)).abs() < 2e-9, "{place}: {value}");
    }
}

#[test]
fn volumes_and_shares_of_labels_add_up() {
    let (map, domain) = (stretch(), ball());
    let quadrature = clipped_grid(&domain, GridResolution::CellsAlongLongestSide(16)).unwrap();
    let target = domain.volume() * map.0.determinant();
    let (check, after) = volume_check(&map, &quadrature, target);
    assert!(check.relative_error.abs() < 1e-12 && (check.carried - target).abs() < 1e-10);
    assert_eq!(check.folded_share, 0.0);
    let labels: Vec<f64> = quadrature.points().iter().map(octant).collect();
    let shares = label_shares(&labels, quadrature.weights(), &after);
    assert_eq!(
        shares.iter().map(|s| s.label).collect::<Vec<_>>(),
        (0..8).map(f64::from).collect::<Vec<_>>()
    );
    assert!((shares.iter().map(|s| s.before).sum::<f64>() - 1.0).abs() < 1e-12);
    assert!((shares.iter().map(|s| s.after).sum::<f64>() - 1.0).abs() < 1e-12);
    // An affine map keeps shares of volume, and octants are equal.
    assert!(
        shares
            .iter()
            .all(|s| (s.before - s.after).abs() < 1e-12 && (s.before - 0.125).abs() < 2e-3)
    );
}

/// One point of the quadrature at a source must not spoil the others.
#[test]
fn jacobians_that_are_not_finite_are_counted_apart() {
    struct Spoilt(Affine);
    impl VolumeMap for Spoilt {
        fn evaluate(&self, points: &[Point]) -> Vec<Point> {
            self.0.evaluate(points)
        }

        fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
            let mut all = self.0.jacobian(points);
            all[5] *= f64::NAN;
            all[7] *= f64::INFINITY;
            all
        }
    }
    let domain = ball();
    let quadrature = clipped_grid(&domain, GridResolution::CellsAlongLongestSide(16)).unwrap();
    let (check, after) = volume_check(&Spoilt(stretch()), &quadrature, domain.volume());
    let lost: f64 = [5, 7].map(|i| quadrature.weights()[i]).iter().sum();
    let expected = (domain.volume() - lost) * stretch().0.determinant();
    assert_eq!((check.not_finite, check.folded_share), (2, 0.0));
    assert!((check.carried - expected).abs() < 1e-10);
    assert_eq!((after[5], after[7]), (0.0, 0.0));
}

#[test]
fn distributions_shift_with_the_volume() {
    let values = [3.0, 1.0, 2.0, f64::NAN];
    let same = distribution_check(&values, &[1.0; 4], &[2.0; 4]).unwrap();
    assert!(same.largest_shift < 1e-15 && same.before == same.after && same.before.mean == 2.0);
    // The value 1 has 1/10 of the image and 1/3 of the domain.
    let moved = distribution_check(&values, &[1.0; 4], &[4.5, 1.0, 4.5, 1.0]).unwrap();
    assert!((moved.largest_shift - (1.0 / 3.0 - 0.1)).abs() < 1e-12);
    assert!((moved.after.mean - 2.35).abs() < 1e-12);
    assert!(distribution_check(&[f64::NAN], &[1.0], &[1.0]).is_none());
}

#[test]
fn fields_that_do_not_fit_are_refused() {
    let mut wrong = carrier();
    wrong.point_fields[0].components = usize::MAX;
    assert!(matches!(
        push_forward(&stretch(), &wrong),
        Err(TransferError::ValueCount { .. })
    ));
    let mut wrong = carrier();
    wrong.point_fields[0].values.pop();
    assert!(matches!(
        push_forward(&stretch(), &wrong),
        Err(TransferError::ValueCount { .. })
    ));
    let mut wrong = carrier();
    wrong.point_fields[0].kind = FieldKind::Vector;
    assert!(matches!(
        push_forward(&stretch(), &wrong),
        Err(TransferError::NotAVector { components: 1, .. })
    ));
    let mut wrong = carrier();
    let CellList::Tets(tets) = &mut wrong.cells else {
        panic!("hexahedra")
    };
    tets[3][1] = 1_000_000;
    assert!(matches!(
        FieldSampler::new(&wrong).err(),
        Some(TransferError::IndexOutOfRange { cell: 3, .. })
    ));
    assert_eq!(
        FieldSampler::new(&FieldMesh::default()).err(),
        Some(TransferError::Empty)
    );
}

/// The unit cube of 27 deformed hexahedra, some listed upside down, with a linear field and labels.
#[test]
fn fields_on_hexahedra_are_interpolated_pushed_forward_and_kept_on_hexahedra() {
    let at = |i: u32| [i % 4, i / 4 % 4, i / 16];
    let points: Vec<Point> = (0..64)
        .map(|i| Point::from(at(i).map(|k| f64::from(k) / 3.0)))
        .map(|p| Point::new(p.x + 0.05 * (7.0 * p.y).sin(), p.y, p.z + 0.04 * p.x * p.y))
        .collect();
    let mut hexes: Vec<[u32; 8]> = (0..64)
        .filter(|&i| at(i).iter().all(|&k| k < 3))
        .map(|first| HEXAHEDRON.map(|[i, j, k]| first + u32::from(i) + 4 * u32::from(j) + 16 * u32::from(k)))
        .collect();
    hexes.iter_mut().step_by(4).for_each(|hex| hex.rotate_left(4));
    let carrier = FieldMesh {
        point_fields: vec![field(
            "linear",
            1,
            FieldKind::Values,
            points.iter().map(linear).collect(),
        )],
        cell_fields: vec![field("number", 1, FieldKind::Label, (0..27).map(f64::from).collect())],
        cells: CellList::Hexes(hexes.clone()),
        points: points.clone(),
    };
    let mean = |hex: &[u32; 8]| Point::from(hex.iter().map(|&v| points[v as usize].coords).sum::<Vector>() / 8.0);
    let centres: Vec<Point> = hexes.iter().map(mean).collect();
    let (fields, beyond) = FieldSampler::new(&carrier).unwrap().sample(&centres);
    for (k, centre) in centres.iter().enumerate() {
        assert!((fields[0].values[k] - linear(centre)).abs() < 1e-12 && !beyond[k]);
        assert_eq!(fields[1].values[k], k as f64);
    }
    let carried = push_forward(&stretch(), &carrier).unwrap();
    assert_eq!(
        (carried.cells, carried.cell_fields),
        (carrier.cells.clone(), carrier.cell_fields.clone())
    );
    let mut wrong = carrier;
    wrong.cell_fields[0].values.pop();
    let message = FieldSampler::new(&wrong).err().unwrap().to_string();
    assert!(message.contains("27 hexahedra"), "{message}");
}
