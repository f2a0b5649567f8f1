//! Hexahedra and tetrahedra of a ball and a torus, checked from their nodes alone.

use std::cell::RefCell;
use std::ops::ControlFlow;

use super::*;
use crate::Point;
use crate::baseline::test_meshes;
use crate::geometry::SurfaceQuery;
use crate::mesh::topology::Topology;
use crate::mesh::{CellList, SurfaceMesh};
use crate::polycube::{MakePolycubeError, PolycubeMap};
use crate::remesh::invalid_cells;

fn options(kind: CellKind, cells: usize) -> HexmeshOptions {
    HexmeshOptions {
        kind,
        size: CellSize::Along(cells),
        ..HexmeshOptions::default()
    }
}

fn deformed(made: &Hexmesh) -> &PolycubeMap {
    match &made.polycube {
        Polycube::Deformed(polycube, _) => polycube,
        Polycube::Voxels(..) => panic!("voxels"),
    }
}

/// Requires a boundary of this genus with its nodes on the model's, and the model's volume up to `volume_error`.
fn require_boundary_on(model: &TetMesh, made: &Hexmesh, genus: u64, volume_error: f64) {
    let (mesh, images) = (&made.remeshed.mesh, &made.remeshed.images);
    let surface = SurfaceMesh::new(images.clone(), mesh.boundary().to_vec()).unwrap();
    let shapes = Topology::new(&surface).components().shapes;
    assert_eq!(
        shapes.iter().map(|shape| shape.genus()).collect::<Vec<_>>(),
        [Some(genus)]
    );
    let given = model.boundary().surface;
    assert!((surface.volume() / given.volume() - 1.0).abs() < volume_error);
    let query = SurfaceQuery::new(&given).unwrap();
    let on_boundary = images.iter().zip(mesh.on_boundary()).filter(|(_, on)| **on);
    let farthest = on_boundary
        .map(|(p, _)| query.closest_point(p).distance)
        .fold(0.0, f64::max);
    assert!(farthest < 1e-9 * given.diagonal(), "{farthest}");
}

/// Its hole is open in the polycube as well.
#[test]
fn a_ring_gets_voxels_with_a_handle() {
    let torus = test_meshes::torus(4);
    let voxels = HexmeshOptions {
        polycube_kind: PolycubeKind::Voxels,
        ..options(CellKind::Hexes, 20)
    };
    let made = make_hexmesh(&torus, &voxels, &|_| {}).unwrap();
    assert!(matches!(&made.polycube, Polycube::Voxels(_, report) if report.missed == 0));
    assert_eq!(made.faults(), 0);
    require_boundary_on(&torus, &made, 1, 0.1);
}

#[cfg(feature = "native")]
#[test]
fn a_large_ring_is_simplified_too_and_one_of_twice_the_vertices_is_not() {
    let torus = test_meshes::torus(8);
    let vertices = torus.boundary().surface.vertices().len();
    let simplified = HexmeshOptions {
        most_vertices: vertices / 3,
        ..options(CellKind::Hexes, 12)
    };
    let kept = HexmeshOptions {
        most_vertices: vertices / 2,
        ..simplified.clone()
    };
    let own = make_hexmesh(&torus, &kept, &|_| {}).unwrap();
    assert!(matches!(own.polycube, Polycube::Deformed(_, None)));
    let made = make_hexmesh(&torus, &simplified, &|_| {}).unwrap();
    let Polycube::Deformed(_, Some(report)) = &made.polycube else {
        panic!("not simplified");
    };
    assert!(report.of == vertices && report.vertices < vertices, "{report:?}");
    assert_eq!(made.faults(), 0);
    require_boundary_on(&torus, &made, 1, 0.1);
    assert_eq!(
        made.fit.boundary.torus_embeddings().unwrap()[1]
            .surface()
            .vertices()
            .len(),
        vertices
    );
}

#[cfg(feature = "native")]
#[test]
fn a_large_model_is_simplified_and_its_mesh_is_on_the_model_itself() {
    let model = test_meshes::ball(6);
    let vertices = model.boundary().surface.vertices().len();
    let simplified = HexmeshOptions {
        most_vertices: vertices / 2,
        ..options(CellKind::Hexes, 8)
    };
    let made = make_hexmesh(&model, &simplified, &|_| {}).unwrap();
    let Polycube::Deformed(polycube, Some(report)) = &made.polycube else {
        panic!("not simplified");
    };
    assert!(report.of == vertices && report.vertices < vertices, "{report:?}");
    assert_eq!(polycube.surfaces()[0].vertices().len(), report.vertices);
    assert_eq!(
        invalid_cells(made.remeshed.mesh.cells(), &made.remeshed.images).cells,
        [] as [u32; 0]
    );
    require_boundary_on(&model, &made, 0, 0.1);
    // The map goes to the model, not to the simplified one.
    assert_eq!(
        made.fit.boundary.target_embedding().unwrap().surface().vertices().len(),
        vertices
    );
    let stopped = |phase| match phase {
        HexmeshPhase::Polycube(ModelPolycubePhase::Simplifying) => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    assert!(make_hexmesh(&model, &simplified, &stopped).unwrap_err().is_cancelled());
}

#[test]
fn models_of_genus_zero_and_one_get_valid_cells_on_a_lattice() {
    for (model, genus) in [(test_meshes::ball(4), 0), (test_meshes::torus(3), 1)] {
        for (kind, count) in [(CellKind::Hexes, 8), (CellKind::Tets, 8)] {
            let made = make_hexmesh(&model, &options(kind, count), &|_| {}).unwrap();
            let (mesh, images) = (&made.remeshed.mesh, &made.remeshed.images);
            assert_eq!(invalid_cells(mesh.cells(), images).cells, [] as [u32; 0]);
            require_boundary_on(&model, &made, genus, 0.1);
            // Every edge of the domain's hexahedra that is not of the padding has the lattice's length.
            let size = deformed(&made).report.lattice.unwrap();
            let planes = deformed(&made).polycube.vertices().iter();
            let heights: Vec<f64> = planes
                .zip(deformed(&made).model.vertices())
                .map(|(p, _)| p.x / size)
                .collect();
            assert!(heights.iter().any(|h| (h - h.round()).abs() < 1e-9));
            match mesh.cells() {
                CellList::Hexes(_) => assert_eq!(made.remeshed.report.cell_size, Some(size)),
                CellList::Tets(_) => assert_eq!(made.remeshed.report.cell_size, Some(size / 2.0)),
            }
        }
    }
}

#[test]
fn two_runs_give_the_same_and_a_length_is_that_of_the_cells() {
    let model = test_meshes::ball(3);
    let size = 0.3;
    let options = HexmeshOptions {
        size: CellSize::Length(size),
        ..HexmeshOptions::default()
    };
    let [first, second] = [(); 2].map(|()| make_hexmesh(&model, &options, &|_| {}).unwrap());
    assert_eq!(first.remeshed.images, second.remeshed.images);
    assert_eq!(deformed(&first).report.lattice, Some(size));
    let polycube = deformed(&first);
    for (axis, &plane) in polycube
        .labels
        .iter()
        .zip(&polycube.boundary)
        .map(|(l, f)| (l / 2, &f[0]))
    {
        let height = polycube.polycube.vertices()[plane as usize][usize::from(axis)] / size;
        assert!((height - height.round()).abs() < 1e-9, "{height}");
    }
}

#[test]
fn phases_come_in_order_any_of_them_cancels_and_wrong_options_are_refused() {
    let model = test_meshes::ball(3);
    let wanted = options(CellKind::Hexes, 6);
    let order = RefCell::new(vec![]);
    let number = |phase: &HexmeshPhase| match phase {
        HexmeshPhase::Polycube(ModelPolycubePhase::Deforming(_)) => 0,
        HexmeshPhase::Polycube(_) => panic!("voxels, or simplified"),
        HexmeshPhase::Fitting(_) => 1,
        HexmeshPhase::Remeshing(_) => 2,
    };
    make_hexmesh(&model, &wanted, &|phase| order.borrow_mut().push(number(&phase))).unwrap();
    let mut order = order.into_inner();
    assert!(order.is_sorted());
    order.dedup();
    assert_eq!(order, [0, 1, 2]);
    for stop in 0..3 {
        let cancel = |phase: HexmeshPhase| {
            if number(&phase) == stop {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let error = make_hexmesh(&model, &wanted, &cancel).unwrap_err();
        assert!(error.is_cancelled(), "{error}");
    }
    for size in [CellSize::Length(0.0), CellSize::Length(f64::NAN), CellSize::Along(0)] {
        let wrong = HexmeshOptions {
            size,
            ..HexmeshOptions::default()
        };
        let error = make_hexmesh(&model, &wrong, &|_| {}).unwrap_err();
        assert!(
            matches!(&error, HexmeshError::Polycube(error) if is_lattice(error)),
            "{error}"
        );
    }
    for max_distance in [0.0, -1.0, f64::NAN] {
        let wrong = HexmeshOptions {
            max_distance,
            ..wanted.clone()
        };
        let error = make_hexmesh(&model, &wrong, &|_| {}).unwrap_err();
        assert!(matches!(error, HexmeshError::MaxDistance(_)), "{error}");
    }
    let flat: Vec<Point> = model.vertices().iter().map(|p| Point::new(p.x, p.y, 0.0)).collect();
    let flat = TetMesh::new(flat, model.tets().to_vec()).unwrap();
    let voxels = HexmeshOptions {
        polycube_kind: PolycubeKind::Voxels,
        ..wanted.clone()
    };
    let error = make_hexmesh(&flat, &voxels, &|_| {}).unwrap_err();
    assert!(
        matches!(error, HexmeshError::Polycube(ModelPolycubeError::NoVolume)),
        "{error}"
    );
    let few = HexmeshOptions {
        most_cells: 10,
        ..wanted
    };
    let error = make_hexmesh(&model, &few, &|_| {}).unwrap_err();
    assert!(
        matches!(error, HexmeshError::Remesh(RemeshError::TooMany { .. })),
        "{error}"
    );
}

fn is_lattice(error: &ModelPolycubeError) -> bool {
    matches!(error, ModelPolycubeError::Deformation(MakePolycubeError::Lattice(_)))
}

fn is_without_labels(error: &ModelPolycubeError) -> bool {
    matches!(error, ModelPolycubeError::Deformation(MakePolycubeError::NoLabels))
}

/// No deformation is tried.
fn without_attempts(options: HexmeshOptions) -> HexmeshOptions {
    HexmeshOptions {
        polycube: PolycubeOptions {
            attempts: 0,
            ..options.polycube
        },
        ..options
    }
}

#[test]
fn voxels_take_over_where_no_deformation_is_found() {
    let ball = test_meshes::ball(4);
    for kind in [CellKind::Hexes, CellKind::Tets] {
        let wanted = without_attempts(options(kind, 16));
        let made = make_hexmesh(&ball, &wanted, &|_| {}).unwrap();
        assert_eq!(made.faults(), 0);
        let Polycube::Voxels(polycube, report) = &made.polycube else {
            panic!("{kind:?}: no voxels")
        };
        assert_eq!((report.missed, report.voxels), (0, polycube.voxels.len()));
        // A whole number of cells along a voxel.
        let cells = polycube.size / made.remeshed.report.cell_size.unwrap();
        assert!((cells - report.cells as f64).abs() < 1e-9);
        require_boundary_on(&ball, &made, 0, 0.05);
    }
    // Not where only deformations are wanted.
    let only = HexmeshOptions {
        polycube_kind: PolycubeKind::Deformed,
        ..without_attempts(options(CellKind::Hexes, 8))
    };
    let error = make_hexmesh(&ball, &only, &|_| {}).unwrap_err();
    assert!(matches!(&error, HexmeshError::Polycube(error) if is_without_labels(error)));
    let voxels = HexmeshOptions {
        polycube_kind: PolycubeKind::Voxels,
        ..options(CellKind::Hexes, 8)
    };
    // Both reasons are given where voxels fail as well.
    let few = HexmeshOptions {
        most_cells: 10,
        ..without_attempts(options(CellKind::Hexes, 8))
    };
    let error = make_hexmesh(&ball, &few, &|_| {}).unwrap_err();
    assert!(error.is_without_polycube() && !error.is_cancelled());
    let HexmeshError::Neither {
        deformed,
        voxels: other,
    } = &error
    else {
        panic!("{error}")
    };
    assert!(is_without_labels(deformed));
    assert!(
        matches!(**other, HexmeshError::Remesh(RemeshError::TooMany { .. })),
        "{other}"
    );
    for stop in [0, 2, 9] {
        let calls = RefCell::new(0);
        let cancel = |phase: HexmeshPhase| {
            *calls.borrow_mut() += usize::from(matches!(phase, HexmeshPhase::Polycube(ModelPolycubePhase::Pairing(_))));
            let is_late = *calls.borrow() > stop;
            if is_late {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        assert!(make_hexmesh(&ball, &voxels, &cancel).unwrap_err().is_cancelled());
    }
}
