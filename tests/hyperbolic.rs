//! Maps between two solids of genus 2 and more: bijective, invertible, and from end to end.

use crate::common::{assert_measured_and_bijective, assert_round_trips, models, tets_of};
use nalgebra::Rotation3;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::check::{BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{
    LandmarkCurve, Landmarks, LoopError, PairError, PairMethod, PairOptions, PairPhase, PairReport, PairStartKind,
    map_pair, map_pair_with_alternatives,
};
use solidmap::files::{
    BoundaryFile, BoundaryMetadata, MapFile, MapMetadata, read_boundary, read_map, write_boundary, write_map,
};
use solidmap::fit::{FitOptions, fit};
use solidmap::hyperbolic::{HyperbolicEmbedding, HyperbolicError, Letter};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, SurfacePoint, shapes};
use solidmap::progress::ProgressControl;
use solidmap::remesh::{CellKind, CellSize, RemeshOptions, RemeshSource, remesh};
use solidmap::{Point, Vector};

fn pair(domain: &SurfaceMesh, target: &SurfaceMesh) -> (BoundaryMap, PairReport) {
    let (map, report) = map_pair(domain, target, &PairOptions::default(), &|_| ()).unwrap();
    assert_one_to_one(&map);
    (map, report)
}

/// Positive triangles on both embeddings, covered once, and there and back within 1e-9 of the diagonals.
fn assert_one_to_one(map: &BoundaryMap) {
    for embedding in map.hyperbolic_embeddings().unwrap() {
        let check = embedding.check();
        assert!(check.is_bijective() && (check.degree - 1.0).abs() < 1e-9, "{check:?}");
    }
    assert_round_trips(map);
}

/// A plate of cubes with holes in a row.
fn plate(holes: i32, divisions: usize) -> SurfaceMesh {
    let cells = (0..2 * holes + 1).flat_map(|i| (0..3).map(move |j| [i, j, 0]));
    let is_filled = |[i, j, _]: &[i32; 3]| !(i % 2 == 1 && *j == 1);
    shapes::polycube(&cells.filter(is_filled).collect::<Vec<_>>(), divisions)
}

/// A plate with two holes that is larger at one end and at one side, so that no turn takes it to itself, nor nearly.
fn uneven(divisions: usize) -> SurfaceMesh {
    shapes::deformed(&plate(2, divisions), |p| {
        Point::new(p.x + 0.08 * p.x * p.x, p.y + 0.15 * p.y * p.y, p.z * (1.0 + 0.1 * p.x))
    })
}

fn mean(report: &PairReport) -> f64 {
    report.after.mean_symmetric_dirichlet / 4.0
}

#[test]
fn a_turned_and_bent_plate_is_mapped_to_where_its_points_are() {
    let domain = uneven(3);
    let turn = Rotation3::new(Vector::new(0.4, -1.1, 0.7));
    let moved = |p: &Point| turn * Point::new(1.1 * p.x, p.y + 0.01 * p.x * p.x, p.z) + Vector::new(3.0, -1.0, 0.2);
    let target = shapes::deformed(&uneven(4), moved);
    let (map, report) = pair(&domain, &target);
    assert!(mean(&report) < 1.1, "{}", mean(&report));
    let off = map
        .image()
        .iter()
        .zip(domain.vertices())
        .map(|(q, p)| (q - moved(p)).norm());
    let off = off.sum::<f64>() / domain.vertices().len() as f64 / target.diagonal();
    assert!(off < 0.015, "{off}");
    let found = report.hyperbolic.unwrap();
    assert_eq!(found.genus, 2);
    assert!(found.classes >= 1 && found.classes <= found.alignments);
    let checked = check(&map, Some(&target), &BoundaryCheckOptions::default(), None).unwrap();
    let composition = checked.composition.unwrap();
    assert!(composition.through_hyperbolic_surface && !composition.through_torus);
    assert!(composition.round_trip.max < 1e-9);
}

/// A plate that is another shape seen in a mirror: turning it over does not bring it back.
#[test]
fn a_mirror_image_is_named() {
    let chiral = |p: &Point| Point::new(p.x, p.y, p.z + 0.15 * p.x * p.x + 0.1 * p.x * p.y);
    let domain = shapes::deformed(&uneven(3), chiral);
    let mirrored = shapes::deformed(&domain, |p| Point::new(p.x, p.y, -p.z)).reversed();
    for (target, is_mirrored) in [(domain.clone(), false), (mirrored, true)] {
        let (_, report) = pair(&domain, &target);
        let warned = report.warnings.iter().any(|warning| warning.contains("mirror image"));
        assert_eq!(warned, is_mirrored, "{:?}", report.warnings);
    }
}

#[test]
fn alternatives_are_bijections_and_options_without_meaning_are_refused() {
    let domain = plate(2, 2);
    let options = PairOptions {
        alternatives: 1,
        ..PairOptions::default()
    };
    // The plate fits itself in several ways.
    let made = map_pair_with_alternatives(&domain, &plate(2, 3), &options, &|_| ()).unwrap();
    assert_eq!(made.alternatives.len(), 1);
    assert_one_to_one(&made.alternatives[0]);
    assert!(made.alternatives[0] != made.map);
    assert!(made.report.hyperbolic.unwrap().runner_up.unwrap() >= 1.0);
    let landmarks = Landmarks::new(vec![[0, 0]], 50, 50).unwrap();
    let with_landmarks = PairOptions {
        landmarks,
        ..PairOptions::default()
    };
    let conformal = PairOptions {
        method: PairMethod::Conformal,
        ..PairOptions::default()
    };
    for options in [&with_landmarks, &conformal] {
        let error = map_pair(&domain, &domain, options, &|_| ()).map(|_| ());
        assert!(
            matches!(error, Err(PairError::NotWithHandles { genus: 2, .. })),
            "{error:?}"
        );
    }
}

#[test]
fn solids_whose_handles_do_not_fit_are_refused_by_name() {
    let refused = |domain: &SurfaceMesh, target: &SurfaceMesh| {
        map_pair(domain, target, &PairOptions::default(), &|_| ())
            .map(|_| ())
            .unwrap_err()
    };
    assert_eq!(
        refused(&plate(2, 2), &plate(3, 2)),
        PairError::UnequalGenus { domain: 2, target: 3 }
    );
    // Four holes in a row, and four in a square: no alignment takes each to one of the others.
    let square = slab([5, 5], &[[1, 1], [3, 1], [3, 3], [1, 3]]);
    let error = refused(&plate(4, 2), &square);
    assert!(matches!(error, PairError::NoClass { .. }), "{error:?}");
}

/// A plate of cells without these.
fn slab([width, height]: [i32; 2], holes: &[[i32; 2]]) -> SurfaceMesh {
    let cells = (0..width).flat_map(|x| (0..height).map(move |y| [x, y, 0]));
    let cells: Vec<[i32; 3]> = cells.filter(|&[x, y, _]| !holes.contains(&[x, y])).collect();
    shapes::polycube(&cells, 2)
}

/// Most alignments by shape take no row of holes to holes around a corner or on a diagonal. Those by extents do, some of them only from
/// the target to the domain.
#[test]
fn holes_in_a_row_go_to_holes_around_a_corner() {
    let diagonal = slab([5, 5], &[[1, 1], [3, 3]]);
    let corner = slab([5, 5], &[[1, 1], [3, 1], [3, 3]]);
    let options = PairOptions {
        alternatives: 1,
        ..PairOptions::default()
    };
    let mut reversed = 0;
    for (domain, target) in [
        (plate(2, 2), diagonal.clone()),
        (diagonal, plate(2, 2)),
        (plate(3, 2), corner.clone()),
        (corner, plate(3, 2)),
    ] {
        let made = map_pair_with_alternatives(&domain, &target, &options, &|_| ()).unwrap();
        let report = made.report;
        assert!(!report.looks_wrong() && mean(&report) < 2.0, "{}", mean(&report));
        for map in [&made.map].into_iter().chain(&made.alternatives) {
            assert_eq!(map.domain().triangles(), domain.triangles());
            assert_one_to_one(map);
        }
        reversed += usize::from(report.is_reversed);
    }
    assert!(reversed > 0);
}

/// The vertices at the corners of the hole of this cube, on top of a plate.
fn around_hole(plate: &SurfaceMesh, [x, y]: [f64; 2]) -> Vec<u32> {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let nearest = |corner: &[f64; 2]| {
        let p = Point::new(x + corner[0], y + corner[1], 1.0);
        let vertices = plate.vertices().iter().enumerate();
        let found = vertices.min_by(|(_, a), (_, b)| (*a - p).norm().total_cmp(&(*b - p).norm()));
        found.unwrap().0 as u32
    };
    corners.iter().map(nearest).collect()
}

/// How often a closed walk of vertices goes round a vertical line under a map.
fn turns_about(map: &BoundaryMap, walk: &[u32], [x, y]: [f64; 2]) -> f64 {
    let triangles = map.domain().triangles();
    let mut points = vec![];
    for (&a, &b) in walk.iter().zip(walk.iter().cycle().skip(1)) {
        let place = |v: u32, t: &[u32; 3]| t.iter().position(|&w| w == v);
        let mut found = triangles.iter().enumerate();
        let (triangle, i, j) = found
            .find_map(|(t, c)| Some((t as u32, place(a, c)?, place(b, c)?)))
            .unwrap();
        points.extend((0..40).map(|step| {
            let mut barycentric = [0.0; 3];
            barycentric[j] = f64::from(step) / 40.0;
            barycentric[i] = 1.0 - barycentric[j];
            SurfacePoint { triangle, barycentric }
        }));
    }
    let polygon = map.evaluate(&points);
    let angle = |(p, q): (&Point, &Point)| {
        let ([a, b], [c, d]) = ([p.x - x, p.y - y], [q.x - x, q.y - y]);
        (a * d - b * c).atan2(a * c + b * d)
    };
    let turned: f64 = polygon.iter().zip(polygon.iter().cycle().skip(1)).map(angle).sum();
    turned / std::f64::consts::TAU
}

/// Maps the first plate to the second such that the loops around its holes go to those around the others, and checks that they do.
fn assert_holes_go(domain: &SurfaceMesh, from: &[[f64; 2]], target: &SurfaceMesh, to: &[[f64; 2]]) -> PairReport {
    let pairs = from.iter().zip(to).map(|(from, to)| LandmarkCurve {
        domain: around_hole(domain, *from),
        target: around_hole(target, *to),
    });
    let options = PairOptions {
        loops: pairs.collect(),
        ..PairOptions::default()
    };
    let (map, report) = map_pair(domain, target, &options, &|_| ()).unwrap();
    assert_one_to_one(&map);
    for (i, hole) in from.iter().enumerate() {
        // Every vertex along the edges of the hole, on top.
        let corners = around_hole(domain, *hole);
        let [a, b] = [0, 1].map(|k| domain.vertices()[corners[k] as usize]);
        let middle = Point::new(0.5 * (a.x + b.x), a.y, a.z);
        let half = (middle - a).norm();
        let walk: Vec<u32> = (0..8)
            .map(|k| {
                let step = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]][k];
                let p = a + Vector::new(half * f64::from(step[0]), half * f64::from(step[1]), 0.0);
                domain.vertices().iter().position(|q| (q - p).norm() < 1e-9).unwrap() as u32
            })
            .collect();
        for (j, centre) in to.iter().enumerate() {
            let turns = turns_about(&map, &walk, [centre[0] + 0.5, centre[1] + 0.5]);
            let expected = if i == j { 1.0 } else { 0.0 };
            assert!((turns - expected).abs() < 1e-6, "hole {i} about {j}: {turns}");
        }
    }
    report
}

#[test]
fn loops_tell_where_handles_go_that_lie_elsewhere() {
    let row = plate(3, 2);
    let in_row = [[1.0, 1.0], [3.0, 1.0], [5.0, 1.0]];
    // In a row, and around a corner.
    let is_filled = |[x, y, _]: &[i32; 3]| ![[1, 1], [3, 1], [1, 3]].contains(&[*x, *y]) && (*x < 3 || *y < 3);
    let cells = (0..5).flat_map(|x| (0..5).map(move |y| [x, y, 0]));
    let corner = shapes::polycube(&cells.filter(is_filled).collect::<Vec<_>>(), 2);
    let report = assert_holes_go(&row, &in_row, &corner, &[[3.0, 1.0], [1.0, 1.0], [1.0, 3.0]]);
    assert!(mean(&report) < 1.5, "{}", mean(&report));
    assert_eq!(report.starts[0].kind, PairStartKind::Loops);
    assert_holes_go(&row, &in_row, &corner, &[[1.0, 3.0], [1.0, 1.0], [3.0, 1.0]]);
    // The hole at the end to that in the corner: with much distortion, but as it is told.
    assert_holes_go(&row, &in_row, &corner, &[[1.0, 1.0], [3.0, 1.0], [1.0, 3.0]]);
}

#[test]
fn loops_of_which_no_map_is_found_are_refused() {
    let two = plate(2, 2);
    let holes = [[1.0, 1.0], [3.0, 1.0]].map(|hole| around_hole(&two, hole));
    let refused = |pairs: &[[&Vec<u32>; 2]]| {
        let pairs = pairs.iter().map(|[domain, target]| LandmarkCurve {
            domain: (*domain).clone(),
            target: (*target).clone(),
        });
        let options = PairOptions {
            loops: pairs.collect(),
            ..PairOptions::default()
        };
        match map_pair(&two, &two, &options, &|_| ()).map(|_| ()) {
            Err(PairError::Loops(error)) => error,
            other => panic!("{other:?}"),
        }
    };
    // Both to the same hole.
    let error = refused(&[[&holes[0], &holes[0]], [&holes[1], &holes[0]]]);
    assert!(matches!(error, LoopError::NotFound { .. }), "{error:?}");
    // Around a hole, and around the bar beside it, which bounds.
    let bar = [
        Point::new(0.0, 0.0, 0.0),
        Point::new(1.0, 1.0, 0.0),
        Point::new(1.0, 1.0, 1.0),
        Point::new(0.0, 0.0, 1.0),
    ];
    let at = |p: &Point| two.vertices().iter().position(|q| (q - p).norm() < 1e-9).unwrap() as u32;
    let bar: Vec<u32> = bar.iter().map(at).collect();
    assert_eq!(
        refused(&[[&holes[0], &bar]]),
        LoopError::Bounds {
            index: 0,
            side: "target"
        }
    );
    let no_handle = LoopError::NoHandle {
        index: 0,
        side: "domain",
    };
    assert_eq!(refused(&[[&bar[..2].to_vec(), &holes[1]]]), no_handle);
}

#[test]
fn a_map_can_be_cancelled_or_concluded_at_any_phase() {
    let (domain, target) = (uneven(2), uneven(3));
    for k in 0..5 {
        let is_at = move |phase: PairPhase| match phase {
            PairPhase::HyperbolicSurface => k == 0,
            PairPhase::Aligning { .. } => k == 1,
            PairPhase::CoarseEmbeddings { .. } => k == 2,
            PairPhase::Refining { .. } | PairPhase::Improving { .. } => k == 3,
            PairPhase::Measuring { .. } => k == 4,
            _ => panic!("a phase of solids with fewer handles"),
        };
        let answer = move |with: ProgressControl| {
            let has_come = std::sync::atomic::AtomicBool::new(false);
            move |phase| {
                let order = std::sync::atomic::Ordering::SeqCst;
                if has_come.fetch_or(is_at(phase), order) || is_at(phase) {
                    with
                } else {
                    ProgressControl::Continue
                }
            }
        };
        let options = PairOptions::default();
        let (map, _) = map_pair(&domain, &target, &options, &answer(ProgressControl::Conclude)).unwrap();
        assert_one_to_one(&map);
        let cancelled = map_pair(&domain, &target, &options, &answer(ProgressControl::Cancel)).map(|_| ());
        assert_eq!(cancelled, Err(PairError::Cancelled), "phase {k}");
    }
}

#[test]
fn files_hold_the_same_map_and_damaged_ones_are_refused() {
    let (map, _) = pair(&uneven(2), &uneven(3));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pair.safetensors");
    for boundary in [map.clone(), map.subdivided()] {
        let file = BoundaryFile {
            boundary: boundary.clone(),
            metadata: BoundaryMetadata::new(vec![]),
        };
        write_boundary(&path, &file).unwrap();
        let read = read_boundary(&path).unwrap();
        assert_eq!(read.boundary, boundary);
        assert_eq!(read.metadata.format_version, "1.2");
    }
    // One letter becomes another, and triangles contradict each other.
    let mut bytes = std::fs::read(&path).unwrap();
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let words: serde_json::Value = serde_json::from_slice(&bytes[8..8 + header]).unwrap();
    let first = words["domain_letters"]["data_offsets"][0].as_u64().unwrap() as usize;
    bytes[8 + header + first] ^= 2;
    std::fs::write(&path, bytes).unwrap();
    let error = read_boundary(&path).unwrap_err().to_string();
    assert!(
        error.contains("domain_letters") || error.contains("domain_places"),
        "{error}"
    );
}

#[test]
fn a_plate_is_mapped_fitted_and_its_cells_are_carried_into_another() {
    let (domain, target) = (plate(2, 4), uneven(4));
    let (boundary, _) = pair(&domain, &target);
    let fitted = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    assert!(
        fitted.report.boundary_error.rms < 5e-3,
        "{:?}",
        fitted.report.boundary_error
    );
    let source = RemeshSource::Regular {
        kind: CellKind::Hexes,
        size: CellSize::Length(0.25),
        most_cells: 1_000_000,
    };
    let carried = remesh(&boundary, &fitted.map, source, &RemeshOptions::default(), &|_| ()).unwrap();
    assert_eq!(carried.report.after.cells, [] as [u32; 0]);
    assert!((carried.report.volume / target.volume() - 1.0).abs() < 0.05);
    assert_measured_and_bijective(&boundary, &fitted.map, tets_of(&domain, 20));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.safetensors");
    let file = MapFile {
        map: fitted.map,
        boundary: Some(boundary.clone()),
        bijective: None,
        metadata: MapMetadata::new(fitted.report, vec![]),
    };
    write_map(&path, &file).unwrap();
    let read = read_map(&path).unwrap();
    assert_eq!(read.boundary, Some(boundary));
    assert_eq!(read.metadata.format_version, "1.4");
}

#[test]
fn embeddings_with_flipped_triangles_or_foreign_letters_are_refused() {
    let surface = plate(2, 2);
    let embedding = HyperbolicEmbedding::of_surface(&surface).unwrap();
    let words: Vec<[Vec<Letter>; 3]> = embedding
        .corner_letters()
        .map(|words| words.map(<[Letter]>::to_vec))
        .collect();
    let again = |positions: &[[f64; 2]], words: &[[Vec<Letter>; 3]], relator: &[Letter]| {
        HyperbolicEmbedding::new(surface.clone(), relator, positions, words).map(|_| ())
    };
    let (positions, relator) = (embedding.positions(), embedding.relator());
    assert_eq!(again(&positions, &words, relator), Ok(()));
    let mut flipped = positions.clone();
    flipped[0] = [-flipped[0][0] + 0.3, flipped[0][1] - 1.0];
    let error = again(&flipped, &words, relator);
    assert!(matches!(error, Err(HyperbolicError::NotBijective(_))), "{error:?}");
    let mut foreign = words.clone();
    foreign[0][1] = vec![9];
    assert_eq!(again(&positions, &foreign, relator), Err(HyperbolicError::Letters));
    let mut other = words.clone();
    other[0][1].push(1);
    assert!(matches!(
        again(&positions, &other, relator),
        Err(HyperbolicError::Words { .. })
    ));
    assert_eq!(again(&positions, &words, &relator[1..]), Err(HyperbolicError::Letters));
    let ring = shapes::torus(1.0, 0.4, 20, 10);
    let error = HyperbolicEmbedding::of_surface(&ring).map(|_| ());
    assert!(matches!(error, Err(HyperbolicError::Genus { genus: 1, .. })));
}

#[test]
fn models_of_genus_2_and_3_go_to_turned_copies_of_themselves() {
    let Some(folder) = models() else { return };
    for name in ["double_torus_g2_3k.obj", "three_holes_g3_uv_2k.obj"] {
        let domain = io::read_surface(folder.join("surfaces").join(name)).unwrap();
        let turn = Rotation3::new(Vector::new(0.9, 0.2, -0.5));
        let target = shapes::deformed(&domain, |p| turn * p);
        let (_, report) = pair(&domain, &target);
        assert!(mean(&report) < 1.1, "{name}: {}", mean(&report));
    }
}
