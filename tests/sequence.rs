//! Sequences: known energies and cycles, and frames measured in blocks as well as alone.

use std::f64::consts::TAU;

use crate::common::{bent, horseshoe, models, rod, tets_of, with_hole};
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::boundary_map::{BoundaryMap, BoundaryMapError};
use solidmap::energy::{AdaptiveOptions, GridResolution, Lame, deformation_density};
use solidmap::fit::{FitOptions, FitSize};
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::remesh::RemeshOptions;
use solidmap::sequence::{
    FilledReference, FrameMeasurement, Sequence, SequenceError, SequenceOptions, SequencePhase, cycles,
};
use solidmap::{Matrix3, Point, Vector};

fn options() -> SequenceOptions {
    SequenceOptions {
        quadrature: AdaptiveOptions {
            resolution: GridResolution::CellsAlongLongestSide(14),
            ..AdaptiveOptions::default()
        },
        ..SequenceOptions::default()
    }
}

fn prepared(reference: &SurfaceMesh, options: &SequenceOptions) -> Sequence {
    Sequence::new(reference, options, &|_| {}).unwrap()
}

fn frames(sequence: &Sequence, reference: &SurfaceMesh, images: &[Vec<Point>]) -> Vec<BoundaryMap> {
    let frame = |image: &Vec<Point>| {
        sequence
            .frame(&reference.with_vertices(image.clone()).unwrap())
            .unwrap()
    };
    images.iter().map(frame).collect()
}

fn measured(reference: &SurfaceMesh, options: &SequenceOptions, images: &[Vec<Point>]) -> Vec<FrameMeasurement> {
    let mut sequence = prepared(reference, options);
    let frames = frames(&sequence, reference, images);
    sequence
        .measure(&frames, &|_| {})
        .into_iter()
        .map(Result::unwrap)
        .collect()
}

fn images(reference: &SurfaceMesh, f: impl Fn(&Point) -> Point) -> Vec<Point> {
    reference.vertices().iter().map(f).collect()
}

fn jacobian_of_bend(a: f64, p: &Point) -> Matrix3 {
    Matrix3::new(
        1.0 + 2.0 * a * p.x,
        0.0,
        -2.0 * a * p.z,
        0.0,
        1.0,
        0.0,
        -2.0 * a * p.z,
        0.0,
        1.0 - 2.0 * a * p.x,
    )
}

#[test]
fn rigid_frames_have_no_energy_even_among_others() {
    let reference = shapes::torus(1.0, 0.4, 30, 14);
    let moved = |turn: f64| {
        let rotation = nalgebra::Rotation3::new(Vector::new(turn, -0.4 * turn, 1.0));
        images(&reference, |p| rotation * p + Vector::new(30.0 * turn, 2.0, -1.0))
    };
    let images = [
        moved(0.3),
        images(&reference, bent(0.15)),
        moved(2.0),
        reference.vertices().to_vec(),
    ];
    let found = measured(&reference, &options(), &images);
    for k in [0, 2, 3] {
        // Strains err by some ulp of positions of size 60 over a solid of size 1, and the energy is their square.
        assert!(found[k].deformation < 1e-24, "{k}: {:e}", found[k].deformation);
        assert!((found[k].harmonic - 3.0).abs() < 1e-11);
        assert!(found[k].boundary_error.max < 1e-13 && found[k].folded_fraction == 0.0);
    }
    assert!(found[1].deformation > 1e-3);
}

#[test]
fn an_affine_stretch_has_the_energy_of_its_matrix() {
    let reference = shapes::sphere(2.0, 3);
    let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
    let image = images(&reference, |p| {
        Point::from(matrix * p.coords) + Vector::new(1.0, 2.0, 3.0)
    });
    let lame = Lame { lambda: 0.7, mu: 0.2 };
    let plain = SequenceOptions { lame, ..options() };
    let expected = deformation_density(&matrix, &lame);
    let found = &measured(&reference, &plain, std::slice::from_ref(&image))[0];
    assert!((found.deformation / expected - 1.0).abs() < 1e-12);

    let own_volume = SequenceOptions {
        own_volume: true,
        ..plain
    };
    let expected = deformation_density(&(matrix / matrix.determinant().cbrt()), &lame);
    let found = &measured(&reference, &own_volume, &[image])[0];
    assert!((found.deformation / expected - 1.0).abs() < 1e-12);
}

#[test]
fn a_scaled_frame_has_energy_unless_it_has_its_own_volume() {
    let reference = shapes::sphere(1.0, 2);
    let image = [images(&reference, |p| Point::from(1.1 * p.coords))];
    let expected = deformation_density(&Matrix3::from_diagonal_element(1.1), &Lame::default());
    assert!((measured(&reference, &options(), &image)[0].deformation / expected - 1.0).abs() < 1e-12);
    let own_volume = SequenceOptions {
        own_volume: true,
        ..options()
    };
    assert!(measured(&reference, &own_volume, &image)[0].deformation < 1e-26);
}

/// The boundary map is linear over triangles of size 0.15, so that it departs from the polynomial by `a h² / 4` and its
/// derivatives, which are of size `2a`, by a few percent near the surface. Energies are quadratic in them.
#[test]
fn a_harmonic_bend_has_the_energy_of_its_formula() {
    let reference = shapes::sphere(1.0, 3);
    let mut sequence = prepared(&reference, &options());
    let a = 0.2;
    let frame = frames(&sequence, &reference, &[images(&reference, bent(a))]);
    let found = sequence.measure(&frame, &|_| {}).remove(0).unwrap();
    let rule = &found.quadrature;
    let density = |p: &Point| deformation_density(&jacobian_of_bend(a, p), &Lame::default());
    let densities: Vec<f64> = rule.points().iter().map(density).collect();
    let expected = rule.integrate(&densities) / rule.volume();
    assert!(
        (found.deformation / expected - 1.0).abs() < 0.02,
        "{} {expected}",
        found.deformation
    );
    let inside = [Point::new(0.3, -0.2, 0.4), Point::origin()];
    for (found, p) in sequence.densities_at(&[&found], &inside)[0].iter().zip(&inside) {
        assert!((found - density(p)).abs() < 0.01 * expected);
    }
}

#[test]
fn frames_in_blocks_are_measured_as_frames_alone() {
    let reference = shapes::sphere(1.0, 3);
    let twisted = |t: f64| {
        images(&reference, |p| {
            let (sine, cosine) = (t * p.z).sin_cos();
            Point::new(
                cosine * p.x - sine * p.y,
                sine * p.x + cosine * p.y,
                p.z + 0.2 * t * p.x * p.x,
            )
        })
    };
    let images: Vec<Vec<Point>> = [0.3, 0.0, 0.8, 0.1, 1.2].map(twisted).into();
    let mut sequence = prepared(&reference, &options());
    let all = frames(&sequence, &reference, &images);
    let together: Vec<FrameMeasurement> = sequence
        .measure(&all, &|_| {})
        .into_iter()
        .map(Result::unwrap)
        .collect();
    let most = together.iter().map(|frame| frame.deformation).fold(0.0, f64::max);
    for (frame, together) in all.iter().zip(&together) {
        let alone = sequence
            .measure(std::slice::from_ref(frame), &|_| {})
            .remove(0)
            .unwrap();
        // Solvers end at a fiftieth of the tolerance of 1e-3; strains are then alike to some 1e-4.
        assert!((alone.deformation - together.deformation).abs() < 1e-3 * most);
        assert!((alone.harmonic - together.harmonic).abs() < 1e-3);
        assert_eq!(alone.volume, together.volume);
    }
    assert!(sequence.measure(&[], &|_| {}).is_empty());

    // With a dense decomposition a block is just a product with more columns.
    let dense = SequenceOptions {
        fit: FitOptions::dense(),
        ..options()
    };
    let together = measured(&reference, &dense, &images);
    for (image, together) in images.iter().zip(together) {
        let alone = &measured(&reference, &dense, std::slice::from_ref(image))[0];
        assert!(
            (alone.deformation / together.deformation.max(1e-20) - 1.0).abs() < 1e-6 || together.deformation < 1e-20
        );
    }
}

/// A ball that bends to one side and back four times, also with a growing amplitude and a noise of a twentieth of it.
#[test]
fn a_ball_that_bends_four_times_has_four_cycles() {
    let reference = shapes::sphere(1.0, 2);
    let mut random = StdRng::seed_from_u64(3);
    let mut amplitudes = |count: f64, drift: f64, noise: f64| -> Vec<f64> {
        let at = |k: usize| k as f64 / 40.0;
        (0..40)
            .map(|k| {
                0.15 * (1.0 - (TAU * count * at(k)).cos()) + drift * at(k) + noise * random.random_range(-1.0..1.0)
            })
            .collect()
    };
    let mut sequence = prepared(&reference, &options());
    let mut energies = |amplitudes: &[f64]| -> Vec<f64> {
        let images: Vec<Vec<Point>> = amplitudes.iter().map(|&a| images(&reference, bent(a))).collect();
        let frames = frames(&sequence, &reference, &images);
        let blocks = frames.chunks(16).flat_map(|block| sequence.measure(block, &|_| {}));
        blocks.map(|frame| frame.unwrap().deformation).collect()
    };
    for (drift, noise) in [(0.0, 0.0), (0.1, 0.015)] {
        let found = cycles(&energies(&amplitudes(4.0, drift, noise)), 1e-12).unwrap();
        assert_eq!(found.whole(), 4, "{found:?}");
        assert!((found.period - 10.0).abs() < 0.5 && found.strength > 0.8, "{found:?}");
    }
    let still = energies(&[0.2; 12]);
    assert!(cycles(&still, 1e-12).is_err());
    let rising: Vec<f64> = (0..40).map(|k| 0.3 * k as f64 / 40.0).collect();
    assert!(cycles(&energies(&rising), 1e-12).is_err());
}

#[test]
fn unusable_frames_are_refused_with_the_reason() {
    let reference = shapes::sphere(1.0, 2);
    let sequence = prepared(&reference, &options());
    let other = shapes::sphere(1.0, 1);
    assert!(matches!(
        sequence.frame(&other),
        Err(SequenceError::Frame(BoundaryMapError::VertexCount {
            domain: 162,
            image: 42
        }))
    ));
    let mut triangles = reference.triangles().to_vec();
    triangles.swap(0, 1);
    let swapped = SurfaceMesh::new(reference.vertices().to_vec(), triangles).unwrap();
    assert!(matches!(
        sequence.frame(&swapped),
        Err(SequenceError::Frame(BoundaryMapError::Connectivity { .. }))
    ));
    let with = |f: fn(&Point) -> Point| reference.with_vertices(images(&reference, f)).unwrap();
    assert!(matches!(
        sequence.frame(&with(|p| Point::new(p.x.ln(), p.y, p.z))),
        Err(SequenceError::Frame(BoundaryMapError::NonFinite { .. }))
    ));
    assert!(matches!(
        sequence.frame(&with(|p| Point::new(p.x, p.y, 0.0))),
        Err(SequenceError::Collapsed { .. })
    ));
    assert!(matches!(
        sequence.frame(&with(|_| Point::origin())),
        Err(SequenceError::Frame(BoundaryMapError::NoExtent { .. }))
    ));
    let open = SurfaceMesh::new(reference.vertices().to_vec(), reference.triangles()[1..].to_vec()).unwrap();
    assert!(matches!(
        Sequence::new(&open, &options(), &|_| {}),
        Err(SequenceError::Fit(_))
    ));
}

#[test]
fn a_reference_with_a_slit_is_closed_in_all_frames_alike() {
    let whole = shapes::sphere(1.0, 3);
    let open = with_hole(&whole);
    let closing = SequenceOptions {
        close_holes: Some(8),
        ..options()
    };
    let image = images(&whole, bent(0.2));
    let closed = &measured(&open, &closing, std::slice::from_ref(&image))[0];
    let expected = &measured(&whole, &options(), &[image])[0];
    assert!((closed.deformation / expected.deformation - 1.0).abs() < 0.02);
    assert!((closed.volume / expected.volume - 1.0).abs() < 1e-3);
    assert!(matches!(
        Sequence::new(
            &open,
            &SequenceOptions {
                close_holes: Some(3),
                ..options()
            },
            &|_| {}
        ),
        Err(SequenceError::Hole(_))
    ));
}

#[test]
fn poses_of_the_horse_are_measured_after_its_slit_is_closed() {
    let Some(models) = models() else { return };
    let folder = models.join("sequences/horse_poses");
    let reference = solidmap::io::read_surface(folder.join("horse_ref.obj")).unwrap();
    let coarse = SequenceOptions {
        close_holes: Some(64),
        fit: FitOptions {
            tolerance: 3e-3,
            held_out: 5000,
            ..FitOptions::default()
        },
        ..options()
    };
    let mut sequence = prepared(&reference, &coarse);
    let mut edges: Vec<usize> = sequence.holes().iter().map(|hole| hole.rim.len()).collect();
    edges.sort_unstable();
    assert_eq!(edges, [3, 16]);
    let read = |name: &str| {
        sequence
            .frame(&solidmap::io::read_surface(folder.join(name)).unwrap())
            .unwrap()
    };
    let frames = [read("horse_ref.obj"), read("horse-10.obj")];
    let found: Vec<FrameMeasurement> = sequence
        .measure(&frames, &|_| {})
        .into_iter()
        .map(Result::unwrap)
        .collect();
    assert!(found[0].deformation < 1e-24);
    assert!((1e-3..4e-3).contains(&found[1].deformation), "{}", found[1].deformation);
}

/// Two pairs of these poses are in the wrong order on an undivided grid of 48 cells, by 3 and 8 %.
#[test]
fn poses_of_the_horse_are_ranked_as_by_a_finer_grid() {
    const POSES: [&str; 4] = ["02", "06", "08", "09"];
    let Some(models) = models() else { return };
    let folder = models.join("sequences/horse_poses");
    let read = |name: &str| solidmap::io::read_surface(folder.join(name)).unwrap();
    let reference = read("horse_ref.obj");
    // Deformation energies and their errors.
    let energies = |quadrature| -> Vec<(f64, f64)> {
        let options = SequenceOptions {
            close_holes: Some(64),
            quadrature,
            ..SequenceOptions::default()
        };
        let mut sequence = prepared(&reference, &options);
        let frame = |pose: &str| sequence.frame(&read(&format!("horse-{pose}.obj"))).unwrap();
        let frames = POSES.map(frame);
        let found = sequence.measure(&frames, &|_| {}).into_iter().map(Result::unwrap);
        found
            .map(|frame| (frame.deformation, frame.errors.deformation))
            .collect()
    };
    let finer = AdaptiveOptions {
        resolution: GridResolution::CellsAlongLongestSide(96),
        ..AdaptiveOptions::default()
    };
    let undivided = AdaptiveOptions {
        tolerance: f64::INFINITY,
        ..AdaptiveOptions::default()
    };
    let ranked = |energies: &[(f64, f64)]| {
        let mut poses: Vec<_> = POSES.iter().zip(energies).collect();
        poses.sort_by(|(_, a), (_, b)| a.0.total_cmp(&b.0));
        poses.into_iter().map(|(pose, _)| *pose).collect::<Vec<_>>()
    };
    let (found, finer) = (energies(AdaptiveOptions::default()), energies(finer));
    assert_eq!(ranked(&found), ["06", "08", "09", "02"]);
    assert_eq!(ranked(&finer), ["06", "08", "09", "02"]);
    for (&(energy, error), (finer, finer_error)) in found.iter().zip(finer) {
        assert!(error < 0.02 * energy, "{energy} ± {error}");
        let difference = (energy - finer).abs();
        assert!(
            difference < error + finer_error,
            "{energy} ± {error}, {finer} ± {finer_error}"
        );
    }
    assert_eq!(ranked(&energies(undivided)), ["08", "06", "02", "09"]);
}

#[test]
fn blocks_leave_room_for_the_densities_of_their_frames() {
    let reference = shapes::sphere(1.0, 2);
    let undivided = prepared(&reference, &options()).quadrature().points().len();
    let points = options().quadrature.point_limit(undivided) as u64;
    let mut work = FitSize::of(&reference, &FitOptions::default());
    work.maps = 32;
    // 60 bytes for each point and frame; blocks are halved from 32 frames, so that room for 20 gives 16.
    let with_memory = |memory: u64| {
        let fit = FitOptions {
            memory: Some(memory),
            ..FitOptions::default()
        };
        prepared(&reference, &SequenceOptions { fit, ..options() }).frames_per_block()
    };
    assert_eq!(with_memory(work.bytes() + 32 * 60 * points), 32);
    assert_eq!(with_memory(work.bytes() + 20 * 60 * points), 16);
}

fn filled(sequence: &Sequence, cells: usize) -> FilledReference<'static> {
    let mesh = tets_of(sequence.domain(), cells);
    FilledReference::new(sequence, mesh, RemeshOptions::default(), None).unwrap()
}

#[test]
fn one_to_one_maps_have_the_energy_of_their_matrix_and_no_errors_of_integration() {
    let reference = rod();
    let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
    for own_volume in [false, true] {
        let mut sequence = prepared(
            &reference,
            &SequenceOptions {
                own_volume,
                ..options()
            },
        );
        let filled = filled(&sequence, 6);
        let image = images(&reference, |p| Point::from(matrix * p.coords));
        let frame = frames(&sequence, &reference, &[image]);
        let found = sequence.measure_bijective(&filled, &frame, &|_| {}).remove(0).unwrap();
        let scale = if own_volume { matrix.determinant().cbrt() } else { 1.0 };
        let expected = deformation_density(&(matrix / scale), &Lame::default());
        // Jacobians of tetrahedra that are a tenth of the solid have rounding errors of some ulp.
        assert!((found.deformation / expected - 1.0).abs() < 1e-12, "{own_volume}");
        assert!((found.deformation_density.max / found.deformation_density.min - 1.0).abs() < 1e-12);
        assert_eq!((found.errors.deformation, found.errors.harmonic), (0.0, 0.0));
        assert!(found.boundary_error.max < 1e-14 && found.folded_fraction == 0.0);
        assert!((found.volume / found.quadrature.volume() / matrix.determinant() - 1.0).abs() < 1e-13);
        let densities = sequence.densities_at(&[&found], &[Point::new(0.3, 0.1, -0.2)]);
        assert!((densities[0][0] / expected - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_frame_whose_harmonic_map_folds_is_one_to_one_when_repaired() {
    let reference = rod();
    let mut sequence = prepared(&reference, &options());
    let filled = filled(&sequence, 16);
    let all = [
        images(&reference, horseshoe),
        images(&reference, |p| Point::new(-p.x, p.y, p.z)),
        images(&reference, bent(0.05)),
    ];
    let frames = frames(&sequence, &reference, &all);
    let harmonic = sequence.measure(&frames[..1], &|_| {}).remove(0).unwrap();
    assert!(harmonic.folded_fraction > 0.005, "{}", harmonic.folded_fraction);
    let repaired = std::cell::RefCell::new(Vec::new());
    let found = sequence.measure_bijective(&filled, &frames, &|phase| {
        if let SequencePhase::Repair { frame, .. } = phase {
            repaired.borrow_mut().push(frame);
        }
    });
    repaired.borrow_mut().dedup();
    assert_eq!(*repaired.borrow(), [0, 1, 2]);
    let horseshoe = found[0].as_ref().unwrap();
    assert_eq!(horseshoe.folded_fraction, 0.0);
    assert!(horseshoe.densities.det_jacobian.iter().all(|det| *det > 0.0));
    let report = &horseshoe.map.bijective().unwrap().report;
    assert!(report.inverted_as_mapped > 0, "{report:?}");
    // Dirichlet's principle.
    assert!(horseshoe.harmonic > harmonic.harmonic);
    // The boundary of the mesh has its own triangles, which are chords of arcs: 2 rad / 16 of radius 4 at most.
    assert!(horseshoe.boundary_error.max < 0.02, "{:?}", horseshoe.boundary_error);
    // A mirror image has no such map, and does not stop the others.
    let error = found[1].as_ref().unwrap_err();
    assert!(matches!(error, SequenceError::Bijective(_)), "{error}");
    assert!(error.to_string().contains("mirrors the solid"), "{error}");
    assert!(found[2].as_ref().unwrap().deformation > 0.0);
}

#[test]
fn a_mesh_of_another_solid_is_refused_before_any_frame() {
    let sequence = prepared(&rod(), &options());
    let other = tets_of(&shapes::cube(2.0, 2), 4);
    let refused = FilledReference::new(&sequence, other, RemeshOptions::default(), None);
    let error = refused.err().unwrap().to_string();
    assert!(error.contains("the given mesh cannot be used"), "{error}");
}
