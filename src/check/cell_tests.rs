use rand::{Rng, SeedableRng, rngs::StdRng};

use super::*;
use crate::geometry::flipped_cells;
use crate::mesh::{HEXAHEDRON, tets_of_hex};

/// The nodes of `n³` cubes with unit edges, and the cubes.
fn lattice(n: u32) -> (Vec<Point>, Vec<[u32; 8]>) {
    let side = n + 1;
    let place = |k: u32| {
        Point::new(
            f64::from(k % side),
            f64::from(k / side % side),
            f64::from(k / side / side),
        )
    };
    let nodes = (0..side.pow(3)).map(place).collect();
    let cube = |c: u32| {
        let low = [c % n, c / n % n, c / n / n];
        HEXAHEDRON.map(|corner| {
            (0..3)
                .map(|k| (low[k] + u32::from(corner[k])) * side.pow(k as u32))
                .sum()
        })
    };
    (nodes, (0..n.pow(3)).map(cube).collect())
}

fn mesh_of(nodes: Vec<Point>, cells: CellList) -> CellMesh {
    let regions = vec![0; cells.len()];
    CellMesh::new(nodes, cells, regions).unwrap()
}

fn hexes(n: u32) -> CellMesh {
    let (nodes, hexes) = lattice(n);
    mesh_of(nodes, CellList::Hexes(hexes))
}

fn tets(n: u32) -> CellMesh {
    let (nodes, hexes) = lattice(n);
    mesh_of(nodes, CellList::Tets(hexes.iter().flat_map(tets_of_hex).collect()))
}

fn moved(mesh: &CellMesh, vertex: usize, to: Point) -> CellMesh {
    let mut nodes = mesh.nodes().to_vec();
    nodes[vertex] = to;
    mesh.with_nodes(nodes).unwrap()
}

fn kinds(report: &CellReport) -> Vec<CellFindingKind> {
    report.findings.iter().map(|finding| finding.kind).collect()
}

fn finding(report: &CellReport, kind: CellFindingKind) -> &CellFinding {
    let found = report.findings.iter().find(|finding| finding.kind == kind);
    found.unwrap_or_else(|| panic!("{kind:?} is not in {report}"))
}

#[test]
fn regular_meshes_have_no_findings() {
    for (mesh, cells, kind) in [(tets(3), 162, "tets"), (hexes(3), 27, "hexes")] {
        let report = examine_cells(&mesh);
        assert_eq!(report.findings, []);
        assert!(report.is_valid());
        assert_eq!((report.kind, report.cells, report.vertices), (kind, cells, 64));
        assert_eq!((report.bodies.len(), report.bodies[0].cells), (1, cells));
        assert!((report.bodies[0].volume - 27.0).abs() < 1e-12);
        assert!(report.to_string().starts_with("Valid cells"));
    }
}

#[test]
fn inverted_cells_are_those_that_exact_predicates_find() {
    for mesh in [tets(4), hexes(4)] {
        // The middle goes beyond the opposite corners of the cubes around it.
        let folded = moved(&mesh, 62, Point::new(3.2, 3.3, 3.1));
        let report = examine_cells(&folded);
        let expected = flipped_cells(&mesh, folded.nodes()).unwrap();
        assert_eq!(report.inverted_cells, expected.count());
        assert!(report.inverted_cells > 0 && !report.is_valid());
        assert!(report.min_scaled_jacobian.unwrap() < 0.0);
        let found = finding(&report, CellFindingKind::InvertedCells);
        assert_eq!((found.severity, found.count), (Severity::Error, expected.count()));
        assert_eq!(found.cells.len(), found.count.min(LISTED));
        assert_eq!(found.places[0], <[f64; 3]>::from(centre(&folded, found.cells[0])));
        assert!(
            found.message.contains(&format!("cell {} at (", found.cells[0])),
            "{}",
            found.message
        );
        assert!(found.advice.contains("solidmap remesh"));
    }
}

#[test]
fn cells_may_be_listed_in_either_orientation() {
    let turned = |mesh: &CellMesh, which: &dyn Fn(usize) -> bool| {
        let mut cells = mesh.cells().clone();
        match &mut cells {
            CellList::Tets(tets) => (0..tets.len()).filter(|t| which(*t)).for_each(|t| tets[t].swap(0, 1)),
            CellList::Hexes(hexes) => (0..hexes.len())
                .filter(|h| which(*h))
                .for_each(|h| hexes[h].rotate_left(4)),
        }
        mesh_of(mesh.nodes().to_vec(), cells)
    };
    for mesh in [tets(3), hexes(3)] {
        let all = examine_cells(&turned(&mesh, &|_| true));
        assert_eq!(kinds(&all), [CellFindingKind::LeftHandedCells]);
        assert!(
            all.is_valid()
                && all.findings[0]
                    .message
                    .starts_with("all cells list their corners left-handed")
        );
        let some = examine_cells(&turned(&mesh, &|cell| cell % 5 == 1));
        assert_eq!(kinds(&some), [CellFindingKind::LeftHandedCells]);
        assert_eq!(
            some.findings[0].count,
            (0..mesh.cells().len()).filter(|cell| cell % 5 == 1).count()
        );
        assert!((some.bodies[0].volume - 27.0).abs() < 1e-12);
    }
}

#[test]
fn two_cells_on_the_same_side_of_a_face_are_found_though_both_are_right_handed() {
    let nodes = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [0.2, 0.2, 2.]].map(Point::from);
    let mesh = mesh_of(nodes.to_vec(), CellList::Tets(vec![[0, 1, 2, 3], [0, 1, 2, 4]]));
    let report = examine_cells(&mesh);
    let found = finding(&report, CellFindingKind::InvertedCells);
    assert_eq!(found.count, 1);
    assert!(
        found.message.contains("at 1 face two cells lie on the same side"),
        "{}",
        found.message
    );
}

#[test]
fn a_ring_of_cells_with_a_twist_cannot_be_oriented() {
    let (nodes, _) = lattice(2);
    let cells = vec![
        [0, 1, 2, 3, 4, 5, 6, 7],
        [4, 5, 6, 7, 8, 9, 10, 11],
        [8, 9, 10, 11, 0, 3, 2, 1],
    ];
    let report = examine_cells(&mesh_of(nodes, CellList::Hexes(cells)));
    let found = finding(&report, CellFindingKind::NonOrientable);
    assert_eq!((found.severity, found.count), (Severity::Error, 1));
}

#[test]
fn flat_cells_are_errors_and_almost_flat_ones_notes() {
    let nodes = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0.3, 0.3, 0.]].map(Point::from);
    let mesh = mesh_of(nodes.to_vec(), CellList::Tets(vec![[0, 1, 2, 3]]));
    let flat = examine_cells(&mesh);
    assert_eq!(
        (flat.flat_cells, flat.slivers, kinds(&flat)),
        (1, 0, vec![CellFindingKind::FlatCells])
    );
    assert!(!flat.is_valid());
    let sliver = examine_cells(&moved(&mesh, 3, Point::new(0.3, 0.3, 1e-3)));
    assert_eq!(
        (sliver.flat_cells, sliver.slivers, kinds(&sliver)),
        (0, 1, vec![CellFindingKind::Slivers])
    );
    assert!(sliver.is_valid() && sliver.min_scaled_jacobian.unwrap() < SLIVER);

    // A corner of a cube in the plane of its neighbours, and then beyond it.
    let cube = hexes(1);
    let in_plane = examine_cells(&moved(&cube, 7, Point::new(2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0)));
    let beyond = examine_cells(&moved(&cube, 7, Point::new(0.5, 0.5, 0.5)));
    assert_eq!((beyond.inverted_cells, beyond.flat_cells), (1, 0));
    assert_eq!(in_plane.inverted_cells + in_plane.flat_cells, 1);
    let exactly = [
        [0., 0., 0.],
        [2., 0., 0.],
        [2., 2., 0.],
        [0., 2., 0.],
        [0., 0., 2.],
        [2., 0., 2.],
        [1., 1., 2.],
        [0., 2., 2.],
    ];
    let exactly = mesh_of(
        exactly.map(Point::from).to_vec(),
        CellList::Hexes(vec![[0, 1, 2, 3, 4, 5, 6, 7]]),
    );
    let exactly = examine_cells(&exactly);
    assert_eq!((exactly.inverted_cells, exactly.flat_cells), (0, 1));
}

#[test]
fn overlapping_and_repeated_cells_are_named() {
    let mesh = hexes(2);
    let CellList::Hexes(mut cells) = mesh.cells().clone() else {
        unreachable!()
    };
    cells.push(cells[3]);
    let report = examine_cells(&mesh_of(mesh.nodes().to_vec(), CellList::Hexes(cells.clone())));
    let again = finding(&report, CellFindingKind::DuplicateCells);
    assert_eq!((again.count, &again.cells[..]), (1, &[8][..]));
    assert!(
        again.message.contains("first cell 8 those of cell 3"),
        "{}",
        again.message
    );
    // Three faces inside the cube now have three cells.
    let crowded = finding(&report, CellFindingKind::CrowdedFaces);
    assert_eq!((crowded.severity, crowded.count), (Severity::Error, 3));
    // On the three outer faces, the cell and its copy are not neighbours on the same side.
    assert_eq!(report.inverted_cells, 0);

    cells.pop();
    let [a, b] = [cells[0][0], cells[0][1]];
    cells[0][1] = a;
    let collapsed = examine_cells(&mesh_of(mesh.nodes().to_vec(), CellList::Hexes(cells.clone())));
    assert_eq!(finding(&collapsed, CellFindingKind::RepeatedCornerCells).cells, [0]);
    cells[0][1] = b;
    // The upper face of the lowest cell, with two of its corners exchanged.
    cells[0].swap(4, 5);
    let crossed = examine_cells(&mesh_of(mesh.nodes().to_vec(), CellList::Hexes(cells)));
    assert!(finding(&crossed, CellFindingKind::CrossedFaces).cells.contains(&0));
}

/// A cube beside four of half its size, with their common corner at `bend` along x.
fn refined(bend: f64) -> CellMesh {
    let coarse = HEXAHEDRON.map(|c| Point::from(c.map(f64::from)));
    let mut nodes = coarse.to_vec();
    let corner = |y: f64, z: f64| 1.0 + bend * y * z;
    nodes[6].x = corner(1.0, 1.0);
    // The face x = 1 of the coarse cube, then the same farther out.
    for layer in 0..2 {
        for k in 0..9 {
            let (y, z) = (f64::from(k % 3) / 2.0, f64::from(k / 3) / 2.0);
            nodes.push(Point::new(corner(y, z) + f64::from(layer), y, z));
        }
    }
    // The corners of the coarse face are its own vertices.
    let near = |k: usize| [1, 9, 2, 11, 12, 13, 5, 15, 6][k];
    let far = |k: usize| 17 + k as u32;
    let fine = [0, 1, 3, 4].map(|k| {
        let around = [k, k + 1, k + 4, k + 3];
        let [a, b, c, d] = around.map(near);
        let [e, f, g, h] = around.map(far);
        [a, b, c, d, e, f, g, h]
    });
    mesh_of(
        nodes,
        CellList::Hexes([&[[0, 1, 2, 3, 4, 5, 6, 7]][..], &fine].concat()),
    )
}

#[test]
fn vertices_inside_faces_and_edges_of_larger_cells_are_found() {
    for bend in [0.0, 0.3] {
        let report = examine_cells(&refined(bend));
        let hanging = finding(&report, CellFindingKind::HangingNodes);
        assert_eq!(hanging.severity, Severity::Error);
        // The middles of the four edges, and of the face.
        assert_eq!(hanging.vertices, [9, 11, 12, 13, 15], "{report}");
        assert_eq!(hanging.cells, [0; 5]);
        assert!(finding(&report, CellFindingKind::SeveralBodies).severity == Severity::Note);
    }
}

#[test]
fn squares_cut_along_both_diagonals_do_not_fit_together() {
    let (nodes, cubes) = lattice(3);
    // One cube with its corners numbered from another one: its diagonals run the other way.
    let turned = |c: usize, [a, b, c_, d, e, f, g, h]: [u32; 8]| match c {
        13 => [b, c_, d, a, f, g, h, e],
        _ => [a, b, c_, d, e, f, g, h],
    };
    // Six tetrahedra about the diagonal from corner 0 to corner 6.
    let around = [[1, 2], [2, 3], [3, 7], [7, 4], [4, 5], [5, 1]];
    let cells = cubes.iter().enumerate().flat_map(|(c, &cube)| {
        let cube = turned(c, cube);
        around.map(|[k, l]| [cube[0], cube[k], cube[l], cube[6]])
    });
    let report = examine_cells(&mesh_of(nodes.clone(), CellList::Tets(cells.collect())));
    let found = finding(&report, CellFindingKind::MismatchedFaces);
    assert!(
        found.severity == Severity::Error && found.advice.contains("same diagonal"),
        "{report}"
    );
    // Tetrahedra 78 to 83 are those of the turned cube.
    assert!(
        found.cells.iter().any(|cell| (78..84).contains(cell)),
        "{:?}",
        found.cells
    );
    let mut cubes = cubes;
    cubes[13][4..].rotate_left(1);
    let report = examine_cells(&mesh_of(nodes, CellList::Hexes(cubes)));
    let found = finding(&report, CellFindingKind::MismatchedFaces);
    assert!(found.cells.contains(&13) && found.advice.contains("VTK"), "{report}");
    assert!(!report.is_valid());
}

#[test]
fn flat_hexahedra_count_in_the_quality() {
    let (mut nodes, cubes) = lattice(4);
    // A vertex inside comes to lie on its neighbour: edges of length zero.
    nodes[62] = nodes[63];
    let report = examine_cells(&mesh_of(nodes, CellList::Hexes(cubes)));
    assert!(report.flat_cells > 0, "{report}");
    assert!(report.min_scaled_jacobian.unwrap() <= 0.0, "{report}");
}

#[test]
fn bodies_are_counted_with_their_cells_and_volumes() {
    let (mut nodes, mut cells) = lattice(2);
    let count = nodes.len() as u32;
    nodes.extend(HEXAHEDRON.map(|c| Point::from(c.map(|x| 5.0 + 2.0 * f64::from(x)))));
    cells.push([0, 1, 2, 3, 4, 5, 6, 7].map(|k| k + count));
    nodes.push(Point::new(9.0, 9.0, 9.0));
    let report = examine_cells(&mesh_of(nodes, CellList::Hexes(cells)));
    assert_eq!(
        report.bodies,
        [
            BodyReport { cells: 8, volume: 8.0 },
            BodyReport { cells: 1, volume: 8.0 }
        ]
    );
    assert_eq!(
        kinds(&report),
        [CellFindingKind::SeveralBodies, CellFindingKind::UnusedVertices]
    );
    assert_eq!(report.findings[0].cells, [0, 8]);
    assert_eq!(
        (&report.findings[1].vertices[..], report.findings[1].places[0]),
        (&[count + 8][..], [9.0; 3])
    );
    assert!(report.is_valid());
}

#[test]
fn what_is_not_finite_or_not_there_is_an_error() {
    let report = examine_cells(&moved(&tets(2), 13, Point::new(0.5, f64::NAN, 0.5)));
    assert_eq!(kinds(&report), [CellFindingKind::NonFiniteVertices]);
    assert_eq!(report.findings[0].vertices, [13]);
    let empty = examine_cells(&mesh_of(vec![], CellList::default()));
    assert_eq!((kinds(&empty), empty.is_valid()), (vec![CellFindingKind::Empty], false));
    assert!(!empty.to_string().is_empty() && empty.min_scaled_jacobian.is_none());
}

#[test]
fn no_mesh_makes_the_check_panic() {
    let mut random = StdRng::seed_from_u64(3);
    for trial in 0..400 {
        let count = random.random_range(1..12);
        let coordinate = |random: &mut StdRng| match random.random_range(0..12) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => 1e300,
            _ => f64::from(random.random_range(-2..3)),
        };
        let nodes = (0..count)
            .map(|_| Point::from([0; 3].map(|_: i32| coordinate(&mut random))))
            .collect();
        let mut corner = || random.random_range(0..count as u32);
        let cells = if trial % 2 == 0 {
            CellList::Tets((0..8).map(|_| std::array::from_fn(|_| corner())).collect())
        } else {
            CellList::Hexes((0..5).map(|_| std::array::from_fn(|_| corner())).collect())
        };
        let mesh = mesh_of(nodes, cells);
        assert!(!examine_cells(&mesh).to_string().is_empty());
        mesh.boundary();
    }
}
