use super::*;
use crate::boundary_map::pair::{PairOptions, map_pair};
use crate::energy::{AdaptiveOptions, EnergyOptions, adaptive_energies};
use crate::fit::fit;
use crate::mesh::{SurfaceMesh, shapes};
use crate::spherical::SphericalEmbedding;
use crate::{Point, Vector};

/// A sphere whose directions are moved along it.
fn perturbed(levels: u32, by: f64) -> BoundaryMap {
    let surface = shapes::sphere(1.0, levels);
    let moved = |p: &Point| (p.coords + by * Vector::new(p.y * p.y, p.z * p.x, p.x)).normalize();
    let directions: Vec<Vector> = surface.vertices().iter().map(moved).collect();
    BoundaryMap::onto_sphere(SphericalEmbedding::new(surface, &directions).unwrap()).unwrap()
}

#[test]
fn the_energy_is_that_of_the_volume_and_its_slope_that_of_differences() {
    let map = perturbed(3, 0.3);
    let options = FitOptions::adaptive();
    let go_on = |_| ProgressControl::Continue;
    let (measure, found) = VolumeMeasure::new(&map, &options, &go_on).unwrap();
    let fitted = fit(&map, &options, &|_| ()).unwrap();
    let accuracy = AdaptiveOptions::default();
    let by_volume = adaptive_energies(
        &fitted.map,
        map.domain(),
        map.target_volume(),
        &EnergyOptions::default(),
        &accuracy,
    );
    let (_, report) = by_volume.unwrap();
    assert!(
        (found.harmonic / report.harmonic - 1.0).abs() < 0.01,
        "{} {}",
        found.harmonic,
        report.harmonic
    );
    // Along a smooth change of the images: linear over triangles, as the slope takes them to be.
    let domain = map.domain();
    let change: Vec<Vector> = domain
        .vertices()
        .iter()
        .map(|p| Vector::new(p.y, p.x * p.z, 0.4 * p.z))
        .collect();
    let at = |h: f64| {
        let image = map.image().iter().zip(&change).map(|(y, d)| y + d * h).collect();
        measure
            .of(&BoundaryMap::new(domain.clone(), image).unwrap(), &go_on)
            .unwrap()
    };
    let along = |slopes: &[Vector]| slopes.iter().zip(&change).map(|(s, d)| s.dot(d)).sum::<f64>();
    let (low, high) = (at(-0.01), at(0.01));
    let slope = (high.harmonic - low.harmonic) / 0.02;
    let expected = along(&at(0.0).slopes);
    assert!((slope / expected - 1.0).abs() < 0.01, "{slope} {expected}");
}

#[test]
fn the_energy_of_a_perturbed_ball_falls_at_bounded_distortion() {
    let map = perturbed(3, 0.5);
    let (improved, report) = improve_boundary(&map, &ImproveOptions::default(), &|_| ()).unwrap();
    let [first, .., last] = report.energies[..] else {
        panic!("{report:?}")
    };
    assert!(report.energies.windows(2).all(|pair| pair[1] < pair[0]));
    assert!(last < first);
    assert!(report.distortions[1] <= 1.5 * report.distortions[0]);
    assert_eq!(improved.domain(), map.domain());
}

/// The energy falls below that of the start, every map is a bijection of the same class, and the distortion is within its bound.
fn assert_improved(map: &BoundaryMap) -> BoundaryMap {
    let options = ImproveOptions {
        most_rounds: 8,
        ..ImproveOptions::default()
    };
    let (improved, report) = improve_boundary(map, &options, &|_| ()).unwrap();
    assert!(report.energies.len() > 1, "{report:?}");
    assert!(report.energies.windows(2).all(|pair| pair[1] < pair[0]), "{report:?}");
    assert!(report.distortions[1] <= 1.5 * report.distortions[0]);
    assert!(report.after.mean_symmetric_dirichlet <= 1.5 * report.before.mean_symmetric_dirichlet);
    assert_eq!(improved.domain(), map.domain());
    assert_eq!(improved.target_surface(), map.target_surface());
    improved
}

#[test]
fn maps_through_a_torus_and_a_hyperbolic_surface_are_improved() {
    let bent = |p: &Point| Point::new(p.x + 0.2 * p.y * p.y, p.y * (1.0 + 0.2 * p.x), p.z);
    let in_place = PairOptions {
        aligned: true,
        improve: false,
        ..PairOptions::default()
    };
    let ring = shapes::torus(1.0, 0.4, 24, 12);
    let bent_ring = shapes::deformed(&ring, bent);
    let [rings, finer] = [3, 5].map(shapes::double_torus);
    for (domain, target, genus) in [(ring, bent_ring, 1), (rings, finer, 2)] {
        let (map, _) = map_pair(&domain, &target, &in_place, &|_| ()).unwrap();
        let improved = assert_improved(&map);
        match genus {
            1 => {
                let [own, other] = [&map, &improved].map(|map| map.torus_embeddings().unwrap()[0].clone());
                assert!(other.check().is_bijective() && other != own);
            }
            _ => {
                let [own, other] = [&map, &improved].map(|map| map.hyperbolic_embeddings().unwrap()[0].clone());
                assert!(other.check().is_bijective() && other != own);
            }
        }
    }
}

/// A lumpy ball with a cavity, and a ring beside it: the surfaces move in the same rounds.
#[test]
fn all_shells_of_a_solid_are_improved() {
    let at = |surface: &SurfaceMesh, by: [f64; 3]| shapes::deformed(surface, |p| p + Vector::from(by));
    let cavity = shapes::deformed(&shapes::sphere(0.4, 2), |p| Point::new(p.x + 0.2, 0.8 * p.y, p.z)).reversed();
    let ring = at(&shapes::torus(1.0, 0.4, 20, 10), [4.0, 0.0, 0.0]);
    let domain = shapes::joined(&shapes::joined(&shapes::sphere(1.0, 3), &cavity), &ring);
    let bent = |p: &Point| Point::new(p.x + 0.2 * p.y * p.y, p.y * (1.0 + 0.15 * p.x), p.z + 0.3 * p.x * p.y);
    let target = shapes::deformed(&domain, bent);
    let in_place = PairOptions {
        improve: false,
        ..PairOptions::default()
    };
    let (map, _) = map_pair(&domain, &target, &in_place, &|_| ()).unwrap();
    let improved = assert_improved(&map);
    let (before, after) = (map.shells().unwrap(), improved.shells().unwrap());
    for (before, after) in before.iter().zip(after) {
        assert_eq!(before.target, after.target);
        assert_ne!(before.map, after.map);
        let [(first, high), (last, last_high)] = [before, after].map(|shell| distortions(&shell.map).unwrap());
        assert!(last.mean_symmetric_dirichlet <= 1.5 * first.mean_symmetric_dirichlet);
        assert!(last_high <= 1.5 * high);
    }
    let fine = improve_boundary(
        &map.subdivided(),
        &ImproveOptions {
            most_rounds: 0,
            ..ImproveOptions::default()
        },
        &|_| (),
    );
    assert_eq!(fine.unwrap().0, map.subdivided());
}

#[test]
fn subdivisions_stay_and_what_cannot_slide_is_refused() {
    let map = perturbed(2, 0.3).subdivided();
    let options = ImproveOptions {
        most_rounds: 1,
        ..ImproveOptions::default()
    };
    let (improved, report) = improve_boundary(&map, &options, &|_| ()).unwrap();
    assert_eq!((improved.domain(), improved.subdivisions()), (map.domain(), 1));
    assert_eq!((report.rounds, report.end), (1, ImproveEnd::Rounds));
    let given = BoundaryMap::new(map.domain().clone(), map.image().to_vec()).unwrap();
    assert!(matches!(
        improve_boundary(&given, &options, &|_| ()),
        Err(ImproveError::NoEmbedding)
    ));
    for most_distortion in [0.9, f64::NAN] {
        let options = ImproveOptions {
            most_distortion,
            ..ImproveOptions::default()
        };
        let error = improve_boundary(&map, &options, &|_| ()).map(|_| ());
        assert!(matches!(error, Err(ImproveError::Option { .. })), "{error:?}");
    }
    let cancel = |phase| match phase {
        ImprovePhase::Moving { .. } => ProgressControl::Cancel,
        ImprovePhase::Fitting(_) => ProgressControl::Continue,
    };
    assert!(improve_boundary(&map, &options, &cancel).is_err_and(|error| error.is_cancelled()));
    let conclude = |_| ProgressControl::Conclude;
    let (same, report) = improve_boundary(&map, &options, &conclude).unwrap();
    assert_eq!((report.end, report.rounds), (ImproveEnd::Concluded, 0));
    assert_eq!(same.image(), map.image());
}
