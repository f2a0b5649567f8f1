//! Regular meshes of polycubes: conforming, carried exactly, and with no cell inverted, counted independently.

use std::collections::HashMap;
use std::path::Path;

use crate::common::models;
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::baseline::{HarmonicOptions, TetHarmonic, TetMap};
use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{FitOptions, fit};
use solidmap::geometry::SurfaceQuery;
use solidmap::io::{self, SolidMesh};
use solidmap::map::VolumeMap;
use solidmap::mesh::{CellList, CellMesh, SurfaceMesh, TetMesh, shapes};
use solidmap::remesh::{
    BoundedMesh, CellKind, CellSize, DEFAULT_EFFORT, GivenMeshError, InversionCause, PolishOutcome, Polycube,
    PolycubeError, RemeshError, RemeshOptions, RemeshSource, Remeshed, RepairStart, cell_count, given_mesh,
    grid_points, invalid_cells, inversion_causes, memory_estimate, regular_mesh, remesh,
};
use solidmap::{Matrix3, Point, Vector};

const KINDS: [CellKind; 2] = [CellKind::Tets, CellKind::Hexes];

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

fn bent(p: &Point) -> Point {
    Point::new(
        p.x + 0.1 * p.y * p.y,
        1.2 * p.y + 0.1 * (2.0 * p.z).sin(),
        0.9 * p.z + 0.05 * p.x * p.y,
    )
}

fn sized(kind: CellKind, size: CellSize) -> RemeshSource {
    RemeshSource::Regular {
        kind,
        size,
        most_cells: 20_000_000,
    }
}

fn grid(kind: CellKind, cells: usize) -> RemeshSource {
    sized(kind, CellSize::Along(cells))
}

fn run(boundary: &BoundaryMap, map: &dyn VolumeMap, source: RemeshSource) -> Remeshed {
    run_with(boundary, map, source, &RemeshOptions::default())
}

fn run_with(boundary: &BoundaryMap, map: &dyn VolumeMap, source: RemeshSource, options: &RemeshOptions) -> Remeshed {
    remesh(boundary, map, source, options, &|_| ()).unwrap()
}

/// The images under the map, without repair or polish.
const UNREPAIRED: RemeshOptions = RemeshOptions {
    repair: false,
    most_added: None,
    effort: DEFAULT_EFFORT,
    slide: true,
    keep_boundary_map: false,
    polish: 0,
    polish_valid: false,
    memory: None,
};

/// A polish even where nothing is inverted.
fn polished() -> RemeshOptions {
    RemeshOptions {
        polish_valid: true,
        ..RemeshOptions::default()
    }
}

/// The surface of the boxes with these indices in the grid of `planes`, each quad cut into `cuts` by `cuts`.
fn surface_of_boxes(boxes: &[[usize; 3]], planes: [&[f64]; 3], cuts: usize) -> SurfaceMesh {
    let is_box = |at: [isize; 3]| boxes.iter().any(|b| (0..3).all(|k| b[k] as isize == at[k]));
    let mut vertices: HashMap<[usize; 3], u32> = HashMap::new();
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for b in boxes {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut beyond = b.map(|i| i as isize);
                beyond[axis] += 2 * side as isize - 1;
                if is_box(beyond) {
                    continue;
                }
                let mut vertex = |i: usize, j: usize| {
                    let mut at = b.map(|i| i * cuts);
                    at[axis] += side * cuts;
                    at[(axis + 1) % 3] += i;
                    at[(axis + 2) % 3] += j;
                    *vertices.entry(at).or_insert_with(|| {
                        points.push(Point::from(Vector::from_fn(|k, _| {
                            let (plane, cut) = (at[k] / cuts, at[k] % cuts);
                            let next = planes[k].get(plane + 1).unwrap_or(&0.0);
                            planes[k][plane] + (next - planes[k][plane]) * cut as f64 / cuts as f64
                        })));
                        points.len() as u32 - 1
                    })
                };
                for i in 0..cuts {
                    for j in 0..cuts {
                        let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                        triangles.extend(if side == 1 {
                            [[a, b, c], [a, c, d]]
                        } else {
                            [[a, c, b], [a, d, c]]
                        });
                    }
                }
            }
        }
    }
    SurfaceMesh::new(points, triangles).unwrap()
}

/// A box with three others on its faces, between unevenly spaced planes.
fn stairs() -> SurfaceMesh {
    let boxes = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]];
    surface_of_boxes(&boxes, [&[0.0, 0.7, 0.75], &[-1.0, 0.1, 1.3], &[0.0, 0.31, 1.0]], 3)
}

/// Faces of all cells, as sorted corners with how often they occur; quads by their corners.
fn faces(mesh: &BoundedMesh) -> HashMap<Vec<u32>, u32> {
    let mut count = HashMap::new();
    let mut add = |cell: &[u32], face: &[usize]| {
        let mut key: Vec<u32> = face.iter().map(|&k| cell[k]).collect();
        key.sort_unstable();
        *count.entry(key).or_default() += 1;
    };
    match mesh.cells() {
        CellList::Tets(tets) => {
            for t in tets {
                [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
                    .iter()
                    .for_each(|f| add(t, f));
            }
        }
        CellList::Hexes(hexes) => {
            const FACES: [[usize; 4]; 6] = [
                [0, 1, 2, 3],
                [4, 5, 6, 7],
                [0, 1, 5, 4],
                [1, 2, 6, 5],
                [2, 3, 7, 6],
                [3, 0, 4, 7],
            ];
            for h in hexes {
                FACES.iter().for_each(|f| add(h, f));
            }
        }
    }
    count
}

#[test]
fn meshes_conform_fill_the_solid_and_have_no_cell_on_the_boundary_alone() {
    for surface in [shapes::cube(2.0, 2), stairs()] {
        let polycube = Polycube::of(&surface).unwrap();
        for kind in KINDS {
            let mesh = regular_mesh(&polycube, 0.2, kind, 100_000).unwrap();
            let faces = faces(&mesh);
            assert!(faces.values().all(|&n| n <= 2));
            let outer: Vec<&Vec<u32>> = faces.iter().filter(|(_, n)| **n == 1).map(|(f, _)| f).collect();
            let on = |v: &u32| mesh.on_boundary()[*v as usize];
            assert!(outer.iter().all(|f| f.iter().all(on)));
            let per_face = if kind == CellKind::Tets { 1 } else { 2 };
            assert_eq!(outer.len() * per_face, mesh.boundary().len());
            let boundary = SurfaceMesh::new(mesh.nodes().to_vec(), mesh.boundary().to_vec()).unwrap();
            assert!(
                (boundary.volume() - surface.volume()).abs() < 1e-12 * surface.volume(),
                "outward, and all of it"
            );
            assert!((boundary.area() - surface.area()).abs() < 1e-12 * surface.area());
            let bad = invalid_cells(mesh.cells(), mesh.nodes());
            match mesh.cells() {
                CellList::Tets(tets) => {
                    assert_eq!(bad.cells, [] as [u32; 0]);
                    assert!(tets.iter().all(|t| !t.iter().all(on)));
                    // Boundary triangles are faces of tetrahedra, not other diagonals.
                    for t in mesh.boundary() {
                        let mut key = t.to_vec();
                        key.sort_unstable();
                        assert_eq!(faces.get(&key), Some(&1));
                    }
                }
                CellList::Hexes(hexes) => {
                    assert_eq!(bad.cells, [] as [u32; 0]);
                    assert!(hexes.iter().all(|h| h.iter().filter(|v| on(v)).count() <= 4));
                }
            }
        }
    }
}

#[test]
fn planes_of_a_polycube_are_found() {
    let polycube = Polycube::of(&stairs()).unwrap();
    for (found, expected) in polycube
        .planes()
        .iter()
        .zip([[0.0, 0.7, 0.75], [-1.0, 0.1, 1.3], [0.0, 0.31, 1.0]])
    {
        assert_eq!(found.len(), 3);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15));
    }
    assert!(polycube.contains([0, 0, 1]) && !polycube.contains([1, 1, 0]) && !polycube.contains([-1, 0, 0]));
}

#[test]
fn surfaces_that_are_not_polycubes_are_refused() {
    let skew = Polycube::of(&shapes::sphere(1.0, 1));
    assert!(matches!(skew, Err(PolycubeError::NotAligned { .. })), "{skew:?}");
    let cube = shapes::cube(1.0, 2);
    let open = SurfaceMesh::new(cube.vertices().to_vec(), cube.triangles()[1..].to_vec()).unwrap();
    assert!(matches!(Polycube::of(&open), Err(PolycubeError::Different { .. })));
    let inward = SurfaceMesh::new(
        cube.vertices().to_vec(),
        cube.triangles().iter().map(|[a, b, c]| [*a, *c, *b]).collect(),
    );
    assert!(matches!(Polycube::of(&inward.unwrap()), Err(PolycubeError::Inward)));
    // Faces that lean a little, and two boxes with a face between them.
    let leaning = shapes::deformed(&cube, |p| Point::new(p.x + 3e-4 * p.y, p.y - 3e-4 * p.x, p.z));
    assert!(matches!(Polycube::of(&leaning), Err(PolycubeError::NotAligned { .. })));
    let touching = shapes::joined(&cube, &shapes::deformed(&cube, |p| p + Vector::x()));
    let touching = Polycube::of(&touching);
    assert!(matches!(touching, Err(PolycubeError::Different { .. })), "{touching:?}");
    let steps: &[f64] = &[0.0, 1.0, 2.0];
    for boxes in [[[0, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 1]]] {
        let pinched = Polycube::of(&surface_of_boxes(&boxes, [steps; 3], 1));
        assert!(matches!(pinched, Err(PolycubeError::Pinched { .. })), "{pinched:?}");
    }
    let boundary = BoundaryMap::new(cube.clone(), cube.vertices().to_vec()).unwrap();
    let identity = Formula(|p: &Point| *p);
    let made = |source| remesh(&boundary, &identity, source, &RemeshOptions::default(), &|_| ());
    for length in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let size = CellSize::Length(length);
        let refused = made(sized(CellKind::Tets, size));
        assert!(matches!(refused, Err(RemeshError::Size(_))), "{refused:?}");
    }
    // Six tetrahedra of 64 boxes; hexahedra that need no padding.
    for (kind, count) in [(CellKind::Tets, 384), (CellKind::Hexes, 64)] {
        let with = |most_cells| {
            made(RemeshSource::Regular {
                kind,
                size: CellSize::Along(4),
                most_cells,
            })
        };
        assert_eq!(with(count).unwrap().report.cells, count);
        assert!(matches!(with(count - 1), Err(RemeshError::TooMany { .. })));
    }
    let refused = made(sized(CellKind::Hexes, CellSize::Length(1e-9)));
    assert!(matches!(refused, Err(RemeshError::TooMany { .. })), "{refused:?}");
}

#[test]
fn nodes_are_exactly_where_a_smooth_map_puts_them() {
    // The grid's boundary nodes are vertices of the domain, so that the boundary map has nothing to interpolate.
    let domain = shapes::cube(2.0, 8);
    let image = domain.vertices().iter().map(bent).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    for kind in KINDS {
        let unmoved = RemeshOptions {
            polish: 0,
            ..RemeshOptions::default()
        };
        let result = run_with(&boundary, &Formula(bent), grid(kind, 8), &unmoved);
        assert_eq!(result.report.before.cells, [] as [u32; 0]);
        for (node, found) in result.mesh.nodes().iter().zip(&result.images) {
            assert!((bent(node) - found).norm() < 1e-14);
        }
        assert_eq!(result.report.largest_shift, 0.0);
        let polished = run_with(&boundary, &Formula(bent), grid(kind, 8), &polished());
        let report = &polished.report;
        assert!((report.volume - report.target_volume).abs() < 1e-2 * report.target_volume);
        assert!(report.repair.polish.iterations > 0);
        // The vertices of the target are nodes. Between them the triangles of the two surfaces are not the same.
        let surface = SurfaceMesh::new(polished.images.clone(), polished.mesh.boundary().to_vec()).unwrap();
        let at_vertices = SurfaceQuery::new(&surface).unwrap();
        let target = boundary.target();
        let distances = target.vertices().iter().map(|p| at_vertices.closest_point(p).distance);
        assert!(distances.fold(0.0, f64::max) < 1e-14);
        assert!(
            report.target_to_mesh.max < 0.01 && report.mesh_to_target.max < 0.01,
            "{report:?}"
        );
    }
}

#[test]
fn any_inner_nodes_are_untangled_and_the_boundary_stays() {
    let domain = shapes::cube(2.0, 8);
    let image: Vec<Point> = domain.vertices().iter().map(bent).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let collapsed = Formula(|_: &Point| Point::new(0.1, 0.0, 0.2));
    let scattered = Formula(|p: &Point| {
        let seed = p
            .iter()
            .fold(0, |s, c| (s ^ c.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut random = StdRng::seed_from_u64(seed);
        Point::from(Vector::from_fn(|_, _| random.random_range(-0.8..0.8)))
    });
    for kind in KINDS {
        for map in [&collapsed as &dyn VolumeMap, &scattered] {
            let result = run(&boundary, map, grid(kind, 8));
            let report = &result.report;
            assert!(report.before.cells.len() > report.cells / 3, "{kind:?}");
            assert_eq!(report.after.cells, [] as [u32; 0], "{kind:?}");
            assert!(report.quality.unwrap().min_scaled_jacobian > 0.1);
            let without = run_with(&boundary, map, grid(kind, 8), &UNREPAIRED);
            assert_eq!(without.report.before, without.report.after);
            for (v, &on) in result.mesh.on_boundary().iter().enumerate() {
                if on {
                    assert_eq!(result.images[v], without.images[v]);
                }
            }
        }
    }
}

#[test]
fn cells_that_cannot_be_repaired_are_counted() {
    // Inside out: no inner node can help the cells at the boundary.
    let domain = shapes::cube(2.0, 4);
    let image = domain.vertices().iter().map(|p| Point::new(-p.x, p.y, p.z)).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let nowhere = Formula(|_: &Point| Point::new(f64::NAN, 0.0, 0.0));
    for kind in KINDS {
        let reflection = Formula(|p: &Point| Point::new(-p.x, p.y, p.z));
        let mirrored = run_with(&boundary, &reflection, grid(kind, 4), &UNREPAIRED).report;
        assert_eq!(mirrored.before.cells.len(), mirrored.cells);
        assert_eq!(mirrored.after.cells.len(), mirrored.cells);
        let repaired = remesh(
            &boundary,
            &reflection,
            grid(kind, 4),
            &RemeshOptions::default(),
            &|_| (),
        );
        assert!(matches!(repaired, Err(RemeshError::Mirrored)));
        let lost = run_with(&boundary, &nowhere, grid(kind, 4), &UNREPAIRED).report;
        assert_eq!(
            lost.after.cells.len(),
            lost.cells,
            "cells at nodes without an image are invalid"
        );
    }
}

#[test]
fn results_are_the_same_for_any_number_of_threads() {
    let domain = shapes::cube(2.0, 8);
    let image: Vec<Point> = domain.vertices().iter().map(bent).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let collapsed = Formula(|_: &Point| Point::origin());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let given = || run(&boundary, &collapsed, RemeshSource::Given(kuhn(8))).images;
        pool.install(|| {
            (
                KINDS.map(|kind| run(&boundary, &collapsed, grid(kind, 20)).images),
                given(),
            )
        })
    };
    assert!(with(1) == with(2) && with(2) == with(3));
}

#[test]
fn a_ring_of_boxes_becomes_a_round_ring() {
    // Genus 1: eight of nine boxes in a square.
    let boxes: Vec<[usize; 3]> = (0..9).filter(|i| *i != 4).map(|i| [i % 3, i / 3, 0]).collect();
    let planes: &[f64] = &[-1.5, -0.5, 0.5, 1.5];
    let domain = surface_of_boxes(&boxes, [planes, planes, &[-0.5, 0.5]], 6);
    // Squares about the axis become circles; the section, a square too, becomes a disc.
    let disc = |u: f64, v: f64| [u * (1.0 - 0.5 * v * v).sqrt(), v * (1.0 - 0.5 * u * u).sqrt()];
    let round = |p: &Point| {
        let square = p.x.abs().max(p.y.abs());
        let angle = p.y.atan2(p.x);
        let [u, v] = disc(2.0 * (square - 1.0), 2.0 * p.z);
        let radius = 1.0 + 0.4 * u;
        Point::new(radius * angle.cos(), radius * angle.sin(), 0.4 * v)
    };
    let image = domain.vertices().iter().map(round).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let fit = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    for kind in KINDS {
        let report = run(&boundary, &fit.map, grid(kind, 24)).report;
        assert_eq!(report.after.cells, [] as [u32; 0], "{kind:?}: {report:?}");
        let chords = report.volume / report.target_volume;
        assert!((chords - 1.0).abs() < 0.05, "{chords}");
        let exact = 2.0 * std::f64::consts::PI.powi(2) * 0.16;
        assert!((report.volume / exact - 1.0).abs() < 0.05);
    }
}

/// Boxes in a cube of side 2, each cut into six tetrahedra in the same way: at edges and corners of the cube,
/// tetrahedra have all their nodes on the boundary. Regions are the halves of the cube.
fn kuhn(boxes: usize) -> CellMesh {
    let side = boxes + 1;
    let at = |i: usize| 2.0 * i as f64 / boxes as f64 - 1.0;
    let nodes = (0..side.pow(3))
        .map(|n| Point::new(at(n % side), at(n / side % side), at(n / side / side)))
        .collect();
    let (mut tets, mut regions) = (vec![], vec![]);
    for n in 0..boxes.pow(3) {
        let [i, j, k] = [n % boxes, n / boxes % boxes, n / boxes / boxes];
        for [a, b] in [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]] {
            let steps = [1, side, side * side];
            let first = i + side * (j + side * k);
            let corners = [0, steps[a], steps[a] + steps[b], 1 + side + side * side];
            tets.push(corners.map(|step| (first + step) as u32));
            regions.push(i32::from(2 * k >= boxes));
        }
    }
    CellMesh::new(nodes, CellList::Tets(tets), regions).unwrap()
}

#[test]
fn given_meshes_are_carried_and_untangled() {
    let domain = shapes::cube(2.0, 4);
    let image: Vec<Point> = domain.vertices().iter().map(bent).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let collapsed = Formula(|_: &Point| Point::new(0.1, 0.0, 0.2));
    let result = run(&boundary, &collapsed, RemeshSource::Given(kuhn(4)));
    assert_eq!(result.report.after.cells, [] as [u32; 0], "{:?}", result.report);
    assert!(result.report.repair.split.cells_added == 0 && result.report.off_surface < 1e-15);
    assert_eq!(result.report.repair.start, RepairStart::FiniteElements);
    // Named by where they face in the domain.
    let mut names = result.mesh.part_names().to_vec();
    names.iter_mut().for_each(|name| *name = name.split_off(7));
    names.sort_unstable();
    assert_eq!(names, ["(+x)", "(+y)", "(+z)", "(-x)", "(-y)", "(-z)"]);
    // A box of hexahedra, upside down.
    let side = |i: usize| 0.5 * i as f64 - 1.0;
    let nodes = (0..125)
        .map(|n| Point::new(side(n % 5), side(n / 5 % 5), side(n / 25)))
        .collect();
    let hexes = (0..64)
        .map(|n| [n % 4, n / 4 % 4, n / 16])
        .map(|[i, j, k]| [25, 26, 31, 30, 0, 1, 6, 5].map(|step| i + 5 * j + 25 * k + step))
        .collect();
    let hexes = CellMesh::new(nodes, CellList::Hexes(hexes), (0..64).collect()).unwrap();
    let result = run(&boundary, &collapsed, RemeshSource::Given(hexes));
    assert_eq!(result.mesh.regions(), (0..64).collect::<Vec<i32>>());
    assert_eq!(result.report.after.cells, [] as [u32; 0], "{:?}", result.report);
}

/// A cube of hexahedra, the smaller the nearer to one of its corners: the largest have 8³ times the volume of the
/// smallest.
fn graded(boxes: usize) -> CellMesh {
    let side = boxes + 1;
    // Sizes in a geometric series.
    let ratio = 8f64.powf(1.0 / (boxes - 1) as f64);
    let at = |i: usize| 2.0 * (ratio.powi(i as i32) - 1.0) / (ratio.powi(boxes as i32) - 1.0) - 1.0;
    let nodes = (0..side.pow(3))
        .map(|n| Point::new(at(n % side), at(n / side % side), at(n / side / side)))
        .collect();
    let hexes = (0..boxes.pow(3))
        .map(|n| [n % boxes, n / boxes % boxes, n / boxes / boxes])
        .map(|[i, j, k]| {
            let first = i + side * (j + side * k);
            let layer = side * side;
            [0, 1, side + 1, side, layer, layer + 1, layer + side + 1, layer + side].map(|step| (first + step) as u32)
        })
        .collect();
    CellMesh::new(nodes, CellList::Hexes(hexes), vec![0; boxes.pow(3)]).unwrap()
}

/// Moves points inside the cube by up to `size`, in no order.
fn shaken(p: &Point, size: f64) -> Point {
    let seed = p
        .iter()
        .fold(1, |s, c| (s ^ c.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut random = StdRng::seed_from_u64(seed);
    p + Vector::from_fn(|_, _| random.random_range(-size..size))
}

#[test]
fn a_mesh_without_inverted_cells_is_moved_only_if_a_polish_is_asked_for() {
    let domain = shapes::cube(2.0, 8);
    let image: Vec<Point> = domain.vertices().iter().map(bent).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    for source in [
        RemeshSource::Given(graded(6)),
        RemeshSource::Given(kuhn(4)),
        grid(CellKind::Tets, 8),
        grid(CellKind::Hexes, 8),
    ] {
        let kept = run(&boundary, &Formula(bent), source.clone());
        assert_eq!(kept.report.before.cells, [] as [u32; 0]);
        assert_eq!(kept.images, kept.carried);
        assert_eq!(kept.report.quality, kept.report.quality_as_mapped);
        assert_eq!(kept.report.repair.polish.outcome, PolishOutcome::NothingInverted);
        let asked = run_with(&boundary, &Formula(bent), source, &polished());
        assert!(asked.report.repair.polish.iterations > 0);
    }
}

#[test]
fn a_polish_lowers_neither_the_least_scaled_jacobian_nor_its_quantile() {
    let domain = shapes::cube(2.0, 8);
    let image: Vec<Point> = domain.vertices().iter().map(bent).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    // As good as it gets, shaken a little, and with inverted cells.
    for (size, is_inverted) in [(0.0, false), (0.02, false), (0.2, true)] {
        let map = Formula(|p: &Point| bent(&shaken(p, size + f64::MIN_POSITIVE)));
        for source in [
            RemeshSource::Given(graded(8)),
            RemeshSource::Given(kuhn(8)),
            grid(CellKind::Tets, 8),
            grid(CellKind::Hexes, 8),
        ] {
            let unpolished = RemeshOptions {
                polish: 0,
                ..RemeshOptions::default()
            };
            let before = run_with(&boundary, &map, source.clone(), &unpolished).report;
            let after = run_with(&boundary, &map, source, &polished()).report;
            assert_eq!(!before.before.cells.is_empty(), is_inverted, "{size}: {before:?}");
            assert_eq!(after.after.cells, [] as [u32; 0]);
            let [old, new] = [before.quality.unwrap(), after.quality.unwrap()];
            assert!(
                new.min_scaled_jacobian >= old.min_scaled_jacobian
                    && new.p01_scaled_jacobian >= old.p01_scaled_jacobian,
                "{size}: {old:?} {new:?}"
            );
            let moved = after.quality != before.quality;
            assert_eq!(
                moved,
                after.repair.polish.outcome == PolishOutcome::Kept,
                "{:?}",
                after.repair
            );
            assert_eq!(moved, after.repair.polish.kept_iterations > 0);
            if is_inverted {
                assert!(
                    moved && new.min_scaled_jacobian > old.min_scaled_jacobian,
                    "{old:?} {new:?}"
                );
            }
        }
    }
}

#[test]
fn a_polish_keeps_the_sizes_of_a_graded_mesh() {
    let domain = shapes::cube(2.0, 8);
    let boundary = BoundaryMap::new(domain.clone(), domain.vertices().to_vec()).unwrap();
    let mesh = graded(8);
    // Inner nodes move by up to a tenth of the smallest edge about them.
    let smallest = 2.0 * (8f64.powf(1.0 / 7.0) - 1.0) / (8f64.powf(8.0 / 7.0) - 1.0);
    let map = Formula(|p: &Point| shaken(p, 0.2 * smallest));
    let result = run_with(&boundary, &map, RemeshSource::Given(mesh.clone()), &polished());
    let [old, new] = [result.report.quality_as_mapped.unwrap(), result.report.quality.unwrap()];
    assert_eq!(result.report.repair.polish.outcome, PolishOutcome::Kept);
    assert!(
        new.min_scaled_jacobian > 0.95 && old.min_scaled_jacobian < 0.9,
        "{old:?} {new:?}"
    );
    let CellList::Hexes(hexes) = mesh.cells() else {
        panic!("hexahedra")
    };
    for h in hexes {
        let diagonal = |x: &[Point]| (x[h[6] as usize] - x[h[0] as usize]).norm();
        let ratio = diagonal(&result.images) / diagonal(mesh.nodes());
        assert!((0.9..1.1).contains(&ratio), "{ratio}");
    }
}

#[test]
fn a_repair_that_cannot_succeed_ends_at_its_limit_of_effort_and_leaves_no_more_inverted() {
    // A corner in the middle of the cube is drawn far through a side, so that cells at the boundary stay inverted.
    let domain = shapes::cube(2.0, 6);
    let pulled = |p: &Point| {
        if p.x == 1.0 && p.y.abs() < 0.5 && p.z.abs() < 0.5 {
            Point::new(-4.0, p.y, p.z)
        } else {
            *p
        }
    };
    let image = domain.vertices().iter().map(pulled).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let fixed = |effort: f64| RemeshOptions {
        slide: false,
        effort,
        ..RemeshOptions::default()
    };
    let least = |effort: f64| {
        let map = Formula(|p: &Point| *p);
        run_with(&boundary, &map, RemeshSource::Given(kuhn(6)), &fixed(effort)).report
    };
    let long = least(50.0);
    let short = least(1e-3);
    for report in [&long, &short] {
        assert!(!report.after.cells.is_empty() && report.after.cells.len() <= report.before.cells.len());
        assert!(report.repair.exhausted, "{:?}", report.repair);
    }
    assert!(
        short.repair.work < long.repair.work,
        "{:?} {:?}",
        short.repair,
        long.repair
    );
    // A repair that succeeds is not reported as ended by its limit, however low that is.
    let sound = BoundaryMap::new(shapes::cube(2.0, 6), shapes::cube(2.0, 6).vertices().to_vec()).unwrap();
    let swirl = Formula(|p: &Point| {
        let inside = (1.0 - p.x * p.x) * (1.0 - p.y * p.y) * (1.0 - p.z * p.z);
        p + 3.0 * inside * Vector::new(p.y, -p.x, p.z)
    });
    let repaired = run_with(&sound, &swirl, RemeshSource::Given(kuhn(6)), &fixed(1e-3)).report;
    assert!(!repaired.before.cells.is_empty());
    assert_eq!(repaired.repair.exhausted, !repaired.after.cells.is_empty());
}

#[test]
fn boundary_nodes_may_slide_after_tetrahedra_of_a_given_mesh_were_split() {
    // All nodes are on the boundary, so that there are inner ones only after splitting; a corner is pulled through the
    // opposite side, which no inner node can repair.
    let domain = shapes::cube(2.0, 1);
    let pulled = |p: &Point| {
        if *p == Point::new(1.0, 1.0, 1.0) {
            Point::new(-1.3, -0.6, -0.6)
        } else {
            *p
        }
    };
    let image = domain.vertices().iter().map(pulled).collect();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let report = run(&boundary, &Formula(|p: &Point| *p), RemeshSource::Given(kuhn(1))).report;
    // What splitting adds is given back where it leaves more inverted cells.
    let left = report.after.cells.len();
    assert!(0 < left && left <= report.before.cells.len(), "{report:?}");
    assert_eq!((report.repair.split.cells_added, report.cells), (0, 6));
}

#[test]
fn boundary_nodes_slide_even_if_there_are_no_inner_nodes() {
    // A plate of one layer. One quad of its upper side is folded by the boundary map.
    let count = 24;
    let side = count + 1;
    let nodes: Vec<Point> = (0..2 * side * side)
        .map(|n| Point::new((n % side) as f64, (n / side % side) as f64, (n / side / side) as f64))
        .collect();
    let hexes = (0..count * count)
        .map(|n| n % count + side * (n / count))
        .map(|first| {
            let layer = side * side;
            [0, 1, side + 1, side, layer, layer + 1, layer + side + 1, layer + side].map(|step| (first + step) as u32)
        })
        .collect();
    let mesh = CellMesh::new(nodes, CellList::Hexes(hexes), vec![0; count * count]).unwrap();
    let domain = surface_of(&mesh);
    let folded = |p: &Point| {
        if *p == Point::new(12.0, 12.0, 1.0) {
            Point::new(13.3, 13.3, 1.0)
        } else {
            *p
        }
    };
    let image = domain.vertices().iter().map(folded).collect();
    let target = domain.clone();
    let boundary = BoundaryMap::new(domain, image).unwrap();
    let result = run(&boundary, &Formula(|p: &Point| *p), RemeshSource::Given(mesh.clone())).report;
    assert!(!result.before.cells.is_empty());
    assert_eq!(result.after.cells, [] as [u32; 0], "{result:?}");
    assert!(result.slid_nodes > 0 && (result.volume - target.volume()).abs() < 1e-9 * target.volume());
    let fixed = RemeshOptions {
        slide: false,
        ..RemeshOptions::default()
    };
    let fixed = run_with(&boundary, &Formula(|p: &Point| *p), RemeshSource::Given(mesh), &fixed).report;
    assert_eq!(fixed.before, fixed.after);
}

#[test]
fn the_memory_limit_counts_the_whole_grid_of_a_domain_that_fills_little_of_it() {
    // Three arms of length 60 along the axes: 1/1000 of their box.
    let arms: Vec<[usize; 3]> = vec![[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]];
    let planes: &[f64] = &[0.0, 1.0, 60.0];
    let domain = surface_of_boxes(&arms, [planes; 3], 2);
    let boundary = BoundaryMap::new(domain.clone(), domain.vertices().to_vec()).unwrap();
    let polycube = Polycube::of(&domain).unwrap();
    let points = grid_points(&polycube, 0.25);
    assert_eq!(points, 241usize.pow(3));
    let cells = cell_count(&polycube, 0.25, CellKind::Hexes, usize::MAX).unwrap();
    let [with, without] = [points, 0].map(|points| memory_estimate(CellKind::Hexes, cells, points, &domain));
    // An index and a flag at every point.
    assert!(with - without >= 5 * points as u64, "{with} {without}");
    let limited = |memory| RemeshOptions {
        memory: Some(memory),
        ..UNREPAIRED
    };
    let made = |memory| {
        let source = sized(CellKind::Hexes, CellSize::Length(0.25));
        remesh(&boundary, &Formula(|p: &Point| *p), source, &limited(memory), &|_| ())
    };
    let refused = made(with - 1);
    assert!(
        matches!(refused, Err(RemeshError::TooLarge { need, .. }) if need == with),
        "{refused:?}"
    );
    assert_eq!(made(with).unwrap().report.memory_estimate, with);
}

#[test]
fn meshes_that_cannot_be_carried_are_refused() {
    let cube = shapes::cube(2.0, 2);
    let whole = kuhn(2);
    let CellList::Tets(tets) = whole.cells().clone() else {
        panic!("tets")
    };
    let refused = |nodes: Vec<Point>, tets: Vec<[u32; 4]>| {
        let regions = vec![0; tets.len()];
        given_mesh(CellMesh::new(nodes, CellList::Tets(tets), regions).unwrap(), &cube).unwrap_err()
    };
    let nodes = || whole.nodes().to_vec();
    assert!(matches!(refused(nodes(), vec![]), GivenMeshError::Empty));
    let mut lost = nodes();
    lost[5].y = f64::NAN;
    assert!(matches!(
        refused(lost, tets.clone()),
        GivenMeshError::NotFinite { node: 5, .. }
    ));
    let mut collapsed = tets.clone();
    collapsed[9][3] = collapsed[9][1];
    assert!(matches!(
        refused(nodes(), collapsed),
        GivenMeshError::Collapsed { cell: 9, .. }
    ));
    // All of its faces inside then have three cells.
    let twice = [tets.clone(), vec![tets[20]]].concat();
    assert!(matches!(
        refused(nodes(), twice),
        GivenMeshError::NotConforming { count: 3, .. }
    ));
    let moved = nodes().iter().map(|p| p + Vector::repeat(0.1)).collect();
    assert!(matches!(
        refused(moved, tets.clone()),
        GivenMeshError::OtherPlace { .. }
    ));
    let half = tets
        .iter()
        .zip(whole.regions())
        .filter(|(_, r)| **r == 0)
        .map(|(t, _)| *t)
        .collect();
    let half = refused(nodes(), half);
    assert!(
        matches!(half, GivenMeshError::OtherPlace { distance, .. } if distance > 0.2),
        "{half:?}"
    );
    // Between four corners of the cube.
    let corners = [[-1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]];
    let part = refused(corners.map(Point::from).into(), vec![[0, 1, 2, 3]]);
    assert!(
        matches!(part, GivenMeshError::OtherVolume { mesh, .. } if (mesh - 8.0 / 3.0).abs() < 1e-12),
        "{part:?}"
    );
    // Two hexahedra of which the second crosses two edges of their common face.
    let nodes: Vec<Point> = (0..12)
        .map(|n| Point::new((n % 2) as f64, (n / 2 % 2) as f64, (n / 4) as f64))
        .collect();
    let hexes =
        |cells: [[u32; 8]; 2]| CellMesh::new(nodes.clone(), CellList::Hexes(cells.to_vec()), vec![0; 2]).unwrap();
    let tower = shapes::deformed(&shapes::cube(1.0, 1), |p| {
        Point::new(p.x + 0.5, p.y + 0.5, 2.0 * p.z + 1.0)
    });
    // The upper one is given upside down.
    let straight = given_mesh(hexes([[0, 1, 3, 2, 4, 5, 7, 6], [8, 9, 11, 10, 4, 5, 7, 6]]), &tower).unwrap();
    assert_eq!(
        invalid_cells(straight.mesh.cells(), straight.mesh.nodes()).cells,
        [] as [u32; 0]
    );
    let crossed = given_mesh(hexes([[0, 1, 3, 2, 4, 5, 7, 6], [4, 7, 5, 6, 8, 11, 9, 10]]), &tower);
    assert!(
        matches!(crossed, Err(GivenMeshError::OtherQuad { cells: [0, 1] })),
        "{crossed:?}"
    );
}

#[test]
fn what_blocks_a_repair_is_proved() {
    // A mirrored tetrahedron, and one that is cut into four: the node in its middle has no valid position.
    let mut nodes = vec![
        Point::origin(),
        Point::new(1.0, 0.0, 0.0),
        Point::new(0.0, 1.0, 0.0),
        Point::new(0.0, 0.0, 1.0),
    ];
    let domain = SurfaceMesh::new(nodes.clone(), vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).unwrap();
    let mesh = CellMesh::new(nodes.clone(), CellList::Tets(vec![[0, 1, 2, 3]]), vec![0]).unwrap();
    nodes.push(Point::new(0.25, 0.25, 0.25));
    let parts = [[4, 1, 2, 3], [0, 4, 2, 3], [0, 1, 4, 3], [0, 1, 2, 4]];
    let cut = CellMesh::new(nodes, CellList::Tets(parts.to_vec()), vec![0; 4]).unwrap();
    for (mesh, counts, cause) in [
        (mesh, (0, 1), InversionCause::Boundary),
        (cut, (1, 0), InversionCause::BlockedNode),
    ] {
        let given = given_mesh(mesh, &domain).unwrap().mesh;
        let unmoved = inversion_causes(&given, given.nodes());
        assert_eq!((unmoved.blocked_nodes, unmoved.boundary_cells), (0, 0));
        let mirrored: Vec<Point> = given.nodes().iter().map(|p| Point::new(-p.x, p.y, p.z)).collect();
        let found = inversion_causes(&given, &mirrored);
        assert_eq!((found.blocked_nodes, found.boundary_cells), counts);
        assert!(found.of_cells.iter().all(|of_cell| *of_cell == cause));
    }
    // The corners of a cube of hexahedra without padding are the boundary's alone.
    let nodes: Vec<Point> = (0..27)
        .map(|n| Point::new((n % 3) as f64, (n / 3 % 3) as f64, (n / 9) as f64))
        .collect();
    let hexes = (0..8)
        .map(|n| [n % 2, n / 2 % 2, n / 4])
        .map(|[i, j, k]| [0, 1, 4, 3, 9, 10, 13, 12].map(|step| i + 3 * j + 9 * k + step))
        .collect();
    let mesh = CellMesh::new(nodes, CellList::Hexes(hexes), vec![0; 8]).unwrap();
    let cube = shapes::deformed(&shapes::cube(2.0, 2), |p| p + Vector::repeat(1.0));
    let given = given_mesh(mesh, &cube).unwrap().mesh;
    assert_eq!(inversion_causes(&given, given.nodes()).boundary_cells, 0);
    // A corner of the cube pushed in beyond the plane of its neighbours.
    let mut pushed = given.nodes().to_vec();
    pushed[0] = Point::new(0.7, 0.7, 0.7);
    let found = inversion_causes(&given, &pushed);
    assert_eq!(found.of_cells[0], InversionCause::Boundary);
    assert_eq!(found.boundary_cells, 1);
}

#[test]
fn padding_is_proved_impossible_where_faces_look_both_ways() {
    // A chain of four boxes: at their common corner faces look both ways along the same axis.
    let boxes = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]];
    let planes: &[f64] = &[0.0, 1.0, 2.0];
    let domain = surface_of_boxes(&boxes, [planes; 3], 2);
    let polycube = Polycube::of(&domain).unwrap();
    let padded = regular_mesh(&polycube, 0.25, CellKind::Hexes, 100_000).unwrap();
    let unmoved = inversion_causes(&padded, padded.nodes());
    assert_eq!(unmoved.blocked_nodes, 1);
    assert!(!invalid_cells(padded.cells(), padded.nodes()).cells.is_empty());
    assert!(unmoved.of_cells.contains(&InversionCause::BlockedNode));
    // Boxes that stay boxes need none.
    let boundary = BoundaryMap::new(domain.clone(), domain.vertices().to_vec()).unwrap();
    let identity = Formula(|p: &Point| *p);
    let fixed = RemeshOptions {
        slide: false,
        ..RemeshOptions::default()
    };
    let hexes = run_with(&boundary, &identity, grid(CellKind::Hexes, 8), &fixed).report;
    assert_eq!(hexes.padding.map(|padding| padding.quads), Some(0));
    assert_eq!((hexes.before.cells.len(), hexes.invalid_in_domain), (0, 0));
    let tets = run_with(&boundary, &identity, grid(CellKind::Tets, 8), &fixed).report;
    assert_eq!((tets.before.cells.len(), tets.causes_before.blocked_nodes), (0, 0));
    assert_eq!(tets.padding, None);
}

/// With a layer below the ends as well, the quads at the corners of the square would have both their edges along the rim.
#[test]
fn a_cylinder_gets_an_o_grid_and_its_rim_is_met() {
    let cube = shapes::cube(2.0, 16);
    let image = |p: &Point| {
        // The square to the disk, along rays.
        let scale = match p.x == 0.0 && p.y == 0.0 {
            true => 0.0,
            false => p.x.abs().max(p.y.abs()) / p.x.hypot(p.y),
        };
        Point::new(p.x * scale, p.y * scale, p.z)
    };
    let boundary = BoundaryMap::new(cube.clone(), cube.vertices().iter().map(image).collect()).unwrap();
    let polished = RemeshOptions {
        polish_valid: true,
        ..RemeshOptions::default()
    };
    let result = run_with(&boundary, &Formula(image), grid(CellKind::Hexes, 8), &polished);
    let report = &result.report;
    let padding = report.padding.unwrap();
    assert_eq!((padding.quads, padding.of), (4 * 64, 6 * 64));
    assert_eq!(report.cells, 512 + 4 * 64);
    assert_eq!(report.after.cells, [] as [u32; 0]);
    let quality = report.quality.unwrap();
    assert!(
        quality.min_scaled_jacobian > 0.6 && quality.mean_scaled_jacobian > 0.9,
        "{quality:?}"
    );
    // The rims are borders of the cube's faces: chords of the circle and the polygon that the rim is are all that is between them.
    let sagitta = 1.0 - (std::f64::consts::PI / 32.0).cos();
    assert!(
        report.farthest() * boundary.target_diagonal() < 2.0 * sagitta + 0.01,
        "{report:?}"
    );
}

#[test]
fn meshes_from_elsewhere_are_carried_without_an_inverted_cell() {
    let Some(models) = models() else { return };
    let twisted = |p: &Point, size: f64| {
        let angle = 0.6 * p.z / size;
        let (sin, cos) = angle.sin_cos();
        Point::new(
            cos * p.x - sin * p.y,
            sin * p.x + cos * p.y,
            p.z + 0.1 * p.x * p.x / size,
        )
    };
    // Both have a handle. One is of tetrahedra, some of them on the boundary alone, one of hexahedra.
    for name in ["cup_g1_tet.mesh", "rockerarm_g1_hex.mesh"] {
        let mesh = io::read_cells(models.join("volumes").join(name)).unwrap();
        let surface = surface_of(&mesh);
        let size = surface.diagonal();
        let image = surface.vertices().iter().map(|p| twisted(p, size)).collect();
        let boundary = BoundaryMap::new(surface, image).unwrap();
        let options = FitOptions {
            tolerance: 1e-2,
            ..FitOptions::default()
        };
        let fit = fit(&boundary, &options, &|_| ()).unwrap();
        let result = run(&boundary, &fit.map, RemeshSource::Given(mesh));
        assert_eq!(result.report.after.cells, [] as [u32; 0], "{name}: {:?}", result.report);
    }
}

/// The outer faces of a mesh, with its nodes.
fn surface_of(mesh: &CellMesh) -> SurfaceMesh {
    let mut outer: HashMap<Vec<u32>, Option<Vec<u32>>> = HashMap::new();
    let mut add = |face: Vec<u32>| {
        let mut key = face.clone();
        key.sort_unstable();
        outer.entry(key).and_modify(|f| *f = None).or_insert(Some(face));
    };
    match mesh.cells() {
        CellList::Tets(tets) => {
            for t in tets {
                let [a, b, c, d] = t.map(|v| mesh.nodes()[v as usize]);
                let is_inverted = (b - a).dot(&(c - a).cross(&(d - a))) < 0.0;
                for f in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]] {
                    let [a, b, c] = f.map(|k: usize| t[k]);
                    add(if is_inverted { vec![a, c, b] } else { vec![a, b, c] });
                }
            }
        }
        CellList::Hexes(hexes) => {
            for h in hexes {
                for f in [
                    [0, 3, 2, 1],
                    [4, 5, 6, 7],
                    [0, 1, 5, 4],
                    [1, 2, 6, 5],
                    [2, 3, 7, 6],
                    [3, 0, 4, 7],
                ] {
                    add(f.map(|k: usize| h[k]).to_vec());
                }
            }
        }
    }
    let mut faces: Vec<Vec<u32>> = outer.into_values().flatten().collect();
    faces.sort_unstable();
    let (mut number, mut points, mut triangles) = (HashMap::new(), vec![], vec![]);
    for face in faces {
        let face: Vec<u32> = face
            .iter()
            .map(|&v| {
                *number.entry(v).or_insert_with(|| {
                    points.push(mesh.nodes()[v as usize]);
                    points.len() as u32 - 1
                })
            })
            .collect();
        triangles.extend((2..face.len()).map(|k| [face[0], face[k - 1], face[k]]));
    }
    let surface = SurfaceMesh::new(points, triangles).unwrap();
    if surface.volume() > 0.0 {
        surface
    } else {
        surface.reversed()
    }
}

#[test]
fn the_bird_has_no_bad_hexahedron_once_boundary_nodes_slide() {
    let Some(boundary) = pair("bird_polycube.vtk", "bird_object.vtk") else {
        return;
    };
    let fit = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    // Not by luck with one size: which nodes lie on edges of the target, and get over them or not, changes with it.
    let of_size = |size: f64| sized(CellKind::Hexes, CellSize::Length(size));
    for size in [0.026, 0.027, 0.028, 0.029, 0.031, 0.032] {
        let report = run(&boundary, &fit.map, of_size(size)).report;
        assert_eq!(report.after.cells, [] as [u32; 0], "{size}");
        let quality = report.quality.unwrap();
        assert!(quality.min_scaled_jacobian > 0.3, "{size}: {quality:?}");
    }
    let hexes = || of_size(0.03);
    let free = run(&boundary, &fit.map, hexes());
    assert_eq!(free.report.after.cells, [] as [u32; 0], "{:?}", free.report);
    assert!(free.report.slid_nodes > 0 && free.report.largest_slide_in_cells < 2.0);
    assert!(free.report.quality.unwrap().min_scaled_jacobian > 0.3);
    let options = RemeshOptions {
        slide: false,
        ..RemeshOptions::default()
    };
    let fixed = run_with(&boundary, &fit.map, hexes(), &options);
    assert!(!fixed.report.after.cells.is_empty() && fixed.report.after.cells.len() < 10);
    // Those that are inverted at a corner stand on quads that the boundary map folds.
    let why = &fixed.report.causes_after.of_cells;
    let known = |c: &&u32| why[**c as usize] != InversionCause::Unknown;
    let known = fixed.report.after.cells.iter().filter(known).count();
    assert!(
        known >= fixed.report.after.inverted,
        "{known}: {:?}",
        fixed.report.after
    );
    assert_eq!((fixed.report.slid_nodes, fixed.report.largest_slide), (0, 0.0));
    // Nodes slide on the target, and no other boundary nodes move.
    let query = SurfaceQuery::new(&boundary.target()).unwrap();
    let mut moved = 0;
    for (v, &on) in free.mesh.on_boundary().iter().enumerate() {
        if on {
            moved += usize::from(free.images[v] != fixed.images[v]);
            assert!(query.closest_point(&free.images[v]).distance < 1e-12);
        }
    }
    assert_eq!(moved, free.report.slid_nodes);
}

#[test]
fn a_coarse_grid_of_the_bird_is_relaxed_until_its_boundary_is_simple_and_no_cell_inverted() {
    let Some(boundary) = pair("bird_polycube.vtk", "bird_object.vtk") else {
        return;
    };
    let fit = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    let query = SurfaceQuery::new(&boundary.target()).unwrap();
    // Tetrahedra may not be split, which comes first.
    let unsplit = RemeshOptions {
        most_added: Some(0),
        ..RemeshOptions::default()
    };
    for kind in [CellKind::Tets, CellKind::Hexes] {
        let found = run_with(&boundary, &fit.map, grid(kind, 16), &unsplit);
        let report = &found.report;
        assert_eq!(report.after.cells, [] as [u32; 0], "{report:?}");
        assert!(report.slid_nodes > 0, "{report:?}");
        // One box between planes that are close, where there were two, and hexahedra need no relaxation here any more.
        assert!(report.repair.relax.nodes > 0 || kind == CellKind::Hexes, "{report:?}");
        for (p, _) in found.images.iter().zip(found.mesh.on_boundary()).filter(|(_, on)| **on) {
            assert!(query.closest_point(p).distance < 1e-12);
        }
        // As near to the target as the chords of the grid as it is mapped.
        let unrepaired = run_with(&boundary, &fit.map, grid(kind, 16), &UNREPAIRED).report;
        for [now, mapped] in [
            [report.target_to_mesh, unrepaired.target_to_mesh],
            [report.mesh_to_target, unrepaired.mesh_to_target],
        ] {
            assert!(now.max < 1.1 * mapped.max, "{now:?} {mapped:?}");
        }
        #[cfg(feature = "native")]
        {
            let [as_mapped, result] = crossings(&found);
            assert!(result == 0 && (as_mapped > 0 || kind == CellKind::Hexes), "{kind:?}");
        }
        let options = RemeshOptions {
            slide: false,
            ..RemeshOptions::default()
        };
        let fixed = run_with(&boundary, &fit.map, grid(kind, 16), &options).report;
        assert_eq!((fixed.slid_nodes, fixed.repair.relax.nodes), (0, 0));
        assert!(!fixed.after.cells.is_empty() || kind == CellKind::Hexes);
    }
}

fn pair(domain: &str, image: &str) -> Option<BoundaryMap> {
    let models = models()?.join("maps");
    let [domain, image] = [domain, image].map(|name| match io::read_solid(models.join(name)).unwrap() {
        SolidMesh::Cells(cells) => cells,
        SolidMesh::Surface(_) => panic!("{name} is a surface"),
    });
    Some(BoundaryMap::between_cells(&domain, &image).unwrap())
}

#[test]
fn max_planck_has_no_inverted_cell_with_its_boundary_fixed() {
    let Some(boundary) = pair("max_planck_cube.mesh", "max_planck_object.mesh") else {
        return;
    };
    let fit = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    for (kind, flips, least) in [(CellKind::Tets, 200, 0.005), (CellKind::Hexes, 100, 0.05)] {
        let report = run(&boundary, &fit.map, grid(kind, 16)).report;
        assert!(report.before.cells.len() > flips, "{report:?}");
        assert_eq!(report.after.cells, [] as [u32; 0]);
        assert!(report.quality.unwrap().min_scaled_jacobian > least, "{report:?}");
        // Chords of a grid of 16 boxes: a percent of the volume, and the mesh nears the target as it is refined.
        // As mapped: boundary nodes that slide in the polish bring coarse meshes nearer, too.
        let [coarse, finer] =
            [16, 32].map(|cells| run_with(&boundary, &fit.map, grid(kind, cells), &UNREPAIRED).report);
        assert!((report.volume / report.target_volume - 1.0).abs() < 0.03);
        assert!(finer.target_to_mesh.mean < 0.6 * coarse.target_to_mesh.mean);
        assert!((finer.volume - finer.target_volume).abs() < 0.6 * (coarse.volume - coarse.target_volume).abs());
    }
}

#[test]
fn the_bird_has_no_inverted_tetrahedron_with_its_boundary_fixed() {
    let Some(boundary) = pair("bird_polycube.vtk", "bird_object.vtk") else {
        return;
    };
    let fit = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    let tets = sized(CellKind::Tets, CellSize::Length(0.03));
    let report = run(&boundary, &fit.map, tets).report;
    assert!(!report.before.cells.is_empty());
    assert_eq!(report.after.cells, [] as [u32; 0], "{report:?}");
}

/// A cube pressed to a wave. Along its middle it is thinner than the chords of a coarse grid are high, which begin and end
/// at different places below and above.
fn wave(p: &Point) -> Point {
    let along = p.x + 0.125 * p.z;
    let thickness = 0.02 + 0.5 * p.y * p.y;
    Point::new(along, p.y, thickness * p.z + 0.3 * (std::f64::consts::PI * along).sin())
}

#[test]
fn a_boundary_that_passes_through_itself_because_it_is_coarse_is_split_until_it_does_not() {
    let cube = shapes::cube(2.0, 32);
    let image = cube.vertices().iter().map(wave).collect();
    let (boundary, map) = (BoundaryMap::new(cube, image).unwrap(), Formula(wave));
    let tets = || grid(CellKind::Tets, 4);
    let enough = RemeshOptions {
        most_added: Some(20_000),
        ..RemeshOptions::default()
    };
    let result = run_with(&boundary, &map, tets(), &enough);
    let found = result.report.repair.boundary_split;
    assert!(found.crossings_before > 0 && found.crossings_after == 0, "{found:?}");
    assert!(found.edges > 0 && found.triangles_added == 2 * found.edges && found.cells_added >= 2 * found.edges);
    assert_eq!(result.report.after.cells, [] as [u32; 0]);
    assert_eq!(result.report.slid_nodes, 0);
    let whole = 6 * 4 * 4 * 4;
    let inside = result.report.repair.split.cells_added;
    assert_eq!(result.mesh.cells().len(), whole + found.cells_added + inside);

    // New nodes of the boundary are on the cube, and where the boundary map sends them.
    let query = SurfaceQuery::new(&boundary.target()).unwrap();
    for (v, p) in result.mesh.nodes().iter().enumerate() {
        let is_outside = p.iter().any(|x| x.abs() == 1.0);
        assert_eq!(is_outside, result.mesh.on_boundary()[v]);
        assert!(!is_outside || query.closest_point(&result.images[v]).distance < 1e-12);
    }
    assert!(invalid_cells(result.mesh.cells(), result.mesh.nodes()).cells.is_empty());
    let nodes = result.mesh.nodes().to_vec();
    let outside = SurfaceMesh::new(nodes, result.mesh.boundary().to_vec()).unwrap();
    assert!((outside.volume() - 8.0).abs() < 1e-12);
    let outer = faces(&result.mesh).into_values().filter(|cells| *cells == 1).count();
    assert_eq!(outer, result.mesh.boundary().len());
    assert_eq!(result.mesh.parts().len(), result.mesh.boundary().len());

    for options in [
        RemeshOptions {
            slide: false,
            ..RemeshOptions::default()
        },
        RemeshOptions {
            most_added: Some(0),
            ..RemeshOptions::default()
        },
    ] {
        let fixed = run_with(&boundary, &map, tets(), &options);
        assert_eq!(
            (fixed.report.repair.boundary_split.edges, fixed.mesh.cells().len()),
            (0, whole)
        );
    }
    // Where nothing passes through itself, nothing is split.
    let fine = run(&boundary, &map, grid(CellKind::Tets, 16))
        .report
        .repair
        .boundary_split;
    assert_eq!((fine.crossings_before, fine.edges), (0, 0));
}

#[test]
fn the_bird_with_few_cells_has_no_inverted_tetrahedron_once_its_boundary_is_split() {
    let Some(boundary) = pair("bird_polycube.vtk", "bird_object.vtk") else {
        return;
    };
    let fit = fit(&boundary, &FitOptions::default(), &|_| ()).unwrap();
    let tets = || grid(CellKind::Tets, 16);
    let report = run(&boundary, &fit.map, tets()).report;
    assert_eq!(report.after.cells, [] as [u32; 0], "{report:?}");
    let found = report.repair.boundary_split;
    assert!(
        found.crossings_before > 0 && found.crossings_after == 0 && found.edges < 20,
        "{found:?}"
    );
    let options = RemeshOptions {
        slide: false,
        ..RemeshOptions::default()
    };
    let fixed = run_with(&boundary, &fit.map, tets(), &options).report;
    assert!(!fixed.after.cells.is_empty(), "{fixed:?}");
}

/// A case of VOLMAP's group G1: the map by finite elements, and the mesh.
fn volmap_case(folder: &Path, case: &str) -> (BoundaryMap, TetMap, CellMesh) {
    let (model, _) = case.rsplit_once('_').unwrap();
    let mesh = solidmap::io::read_cells(folder.join(format!("{model}.mesh"))).unwrap();
    let CellList::Tets(tets) = mesh.cells() else {
        panic!("tetrahedra")
    };
    // Some of them are left-handed as a whole.
    let mut tets = TetMesh::new(mesh.nodes().to_vec(), tets.clone()).unwrap();
    if tets.volume() < 0.0 {
        let reversed = tets.tets().iter().map(|&[a, b, c, d]| [b, a, c, d]).collect();
        tets = TetMesh::new(mesh.nodes().to_vec(), reversed).unwrap();
    }
    let images = solidmap::io::read_node_images(folder.join(format!("{case}.txt"))).unwrap();
    let images: HashMap<u32, Point> = images.into_iter().collect();
    let harmonic = TetHarmonic::new(tets.clone(), &HarmonicOptions::default()).unwrap();
    let outer: Vec<Point> = harmonic.boundary_vertices().iter().map(|v| images[v]).collect();
    let map = harmonic.solve(&outer).unwrap();
    let boundary = BoundaryMap::new(tets.boundary().surface, outer).unwrap();
    let (nodes, tets) = tets.into_parts();
    let regions = vec![0; tets.len()];
    (
        boundary,
        map,
        CellMesh::new(nodes, CellList::Tets(tets), regions).unwrap(),
    )
}

/// In the first two cells stay inverted as long as none is split, in the second also all edges between boundary nodes.
#[test]
fn cases_of_volmap_are_repaired_with_the_boundary_as_it_is() {
    let Some(models) = models() else { return };
    let volmap = models.join("volmap");
    for (case, is_split) in [("bone_cube", true), ("bone_star", true), ("duck_star", false)] {
        let (boundary, map, mesh) = volmap_case(&volmap, case);
        let options = RemeshOptions {
            slide: false,
            ..RemeshOptions::default()
        };
        let carried = |options: &RemeshOptions| {
            let source = RemeshSource::Given(mesh.clone());
            remesh(&boundary, &map, source, options, &|_| {}).unwrap()
        };
        let found = carried(&options);
        let report = &found.report;
        assert_eq!(report.after.cells, [] as [u32; 0], "{case}");
        assert!(report.before.inverted > 0 && report.slid_nodes == 0, "{case}");
        let added = report.repair.split.cells_added;
        assert_eq!(added > 0, is_split, "{case}: {added} added");
        assert!(added <= mesh.cells().len() / 3, "{case}: {added} added");
        // Nodes keep their indices, and those of the boundary their images.
        assert_eq!(found.mesh.nodes()[..mesh.nodes().len()], *mesh.nodes());
        let outer = (0..found.images.len()).filter(|&v| found.mesh.on_boundary()[v]);
        for v in outer {
            assert!(
                v < mesh.nodes().len() && found.images[v] == found.carried[v],
                "{case}: node {v}"
            );
        }
        let in_domain = invalid_cells(found.mesh.cells(), found.mesh.nodes());
        assert_eq!(in_domain.cells, [] as [u32; 0], "{case}");
        let quality = report.quality.unwrap();
        assert!(quality.min_scaled_jacobian > 1e-6, "{case}: {quality:?}");

        let unsplit = carried(&RemeshOptions {
            most_added: Some(0),
            ..options
        });
        assert_eq!(unsplit.mesh.cells(), mesh.cells());
        assert_eq!(unsplit.report.after.inverted > 0, is_split, "{case}");
        assert!(unsplit.report.after.inverted <= unsplit.report.before.inverted);
    }
}

#[test]
fn repairs_do_not_depend_on_the_number_of_threads() {
    let Some(models) = models() else { return };
    let (boundary, map, mesh) = volmap_case(&models.join("volmap"), "bone_cube");
    let images = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let source = RemeshSource::Given(mesh.clone());
        let found = pool.install(|| remesh(&boundary, &map, source, &RemeshOptions::default(), &|_| {}).unwrap());
        found.images
    };
    assert_eq!(images(1), images(3));
}

/// From a solid from -1/2 to 1/2 to an ellipsoid, cubes to balls, with a full turn of its top: chords between the nodes of a coarse
/// grid cut through the inside.
fn turned_to_ellipsoid(p: &Point) -> Point {
    let (sin, cos) = (std::f64::consts::TAU * p.z).sin_cos();
    let q = Vector::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z).normalize() * 2.0 * p.coords.amax();
    Point::new(q.x, 1.3 * q.y, 1.6 * q.z)
}

#[cfg(feature = "native")]
fn crossings(found: &Remeshed) -> [usize; 2] {
    let find =
        |surface: &SurfaceMesh| solidmap::cgal_tetgen::self_intersections(surface).map_err(|error| error.to_string());
    match found.boundary_intersections(Some(&find)) {
        solidmap::remesh::BoundaryIntersections::Counted { as_mapped, result } => [as_mapped, result],
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_grid_that_the_boundary_map_spoils_is_carried_by_another_one() {
    let domain = shapes::cube(1.0, 16);
    let images: Vec<Point> = domain.vertices().iter().map(turned_to_ellipsoid).collect();
    let boundary = BoundaryMap::new(domain, images).unwrap();
    let target = SurfaceQuery::new(&boundary.target()).unwrap();
    let map = Formula(turned_to_ellipsoid);
    for kind in KINDS {
        let given = RemeshOptions {
            keep_boundary_map: true,
            ..RemeshOptions::default()
        };
        let kept = run_with(&boundary, &map, grid(kind, 4), &given);
        assert_eq!(kept.report.other_boundary, None);
        let found = run(&boundary, &map, grid(kind, 4));
        assert_eq!(found.report.after.inverted, 0, "{kind:?}");
        #[cfg(feature = "native")]
        assert_eq!(crossings(&found)[1], 0, "{kind:?}");
        assert!(kept.report.after.inverted > 0, "{kind:?}: the test shows nothing");
        let other = found.report.other_boundary.unwrap();
        assert!(0.0 < other.mean_shift && other.mean_shift <= other.largest_shift && other.largest_shift <= 1.0);
        // The nodes are on the target all the same.
        for (p, _) in found.images.iter().zip(found.mesh.on_boundary()).filter(|(_, on)| **on) {
            assert!(target.closest_point(p).distance < 1e-12, "{kind:?}: {p}");
        }
        let repeated = run(&boundary, &map, grid(kind, 4));
        assert_eq!(repeated.images, found.images);
        let fixed = RemeshOptions {
            slide: false,
            ..RemeshOptions::default()
        };
        let fixed = run_with(&boundary, &map, grid(kind, 4), &fixed);
        assert_eq!(fixed.report.other_boundary, None);
    }
}

/// The cavity pokes through the outer surface of the target, which keeps another boundary map from being found. By the share of
/// triangles that cross, a tenth of the effort comes first.
#[cfg(feature = "native")]
#[test]
fn a_grid_without_another_boundary_map_gets_the_whole_effort_under_its_own() {
    let thirds = [-0.5, -1.0 / 6.0, 1.0 / 6.0, 0.5];
    let boxes: Vec<[usize; 3]> = (0..27)
        .map(|i| [i / 9, i / 3 % 3, i % 3])
        .filter(|b| *b != [1; 3])
        .collect();
    let domain = surface_of_boxes(&boxes, [&thirds; 3], 4);
    let poking = |p: &Point| {
        let is_of_cavity = p.coords.amax() < 0.2;
        turned_to_ellipsoid(p) + Vector::x() * if is_of_cavity { 0.8 } else { 0.0 }
    };
    let images: Vec<Point> = domain.vertices().iter().map(poking).collect();
    let boundary = BoundaryMap::new(domain, images).unwrap();
    let map = Formula(poking);
    let with = |effort: f64, keep_boundary_map: bool| {
        let options = RemeshOptions {
            effort,
            keep_boundary_map,
            ..RemeshOptions::default()
        };
        run_with(&boundary, &map, grid(CellKind::Tets, 3), &options)
    };
    let (found, kept, with_a_tenth) = (with(20.0, false), with(20.0, true), with(2.0, true));
    assert!(
        100 * crossings(&kept)[0] > found.mesh.boundary().len(),
        "no tenth comes first"
    );
    assert_ne!(with_a_tenth.images, kept.images, "the test shows nothing");
    assert_eq!(found.report.other_boundary, None);
    assert_eq!(found.images, kept.images);
}
