//! Labels with six charts for a solid of genus 0, from its map to the sphere: the faces of a cube around it.

use super::PolycubePhase;
use super::axis_of;
use super::face_graph::FaceGraph;
use super::label_repair::repair_labels;
use super::solid::Solid;
use crate::baseline::{HarmonicOptions, HarmonicSolver, TetHarmonic};
use crate::mesh::{SurfaceMesh, TetMesh};
use crate::progress::ProgressSender;
use crate::spherical::{SphereOptions, map_to_sphere};
use crate::{Point, Vector};

/// Gives the boundary the labels of the cube's faces, and puts it there; inner nodes follow by finite elements. `None` for a
/// solid that is not of genus 0, or not connected.
pub(super) fn put_on_cube(solid: &mut Solid, graph: &FaceGraph, monitor: &ProgressSender<PolycubePhase>) -> Option<()> {
    let turn = solid.turn;
    let directions: Vec<Vector> = directions(solid, monitor)?.iter().map(|d| turn * d).collect();
    let at = |v: u32| directions[v as usize];
    let label = |corners: &[u32; 3]| {
        let mean: Vector = corners.iter().map(|&v| at(v)).sum();
        let axis = mean.iamax();
        (2 * axis + usize::from(mean[axis] > 0.0)) as u8
    };
    let mut labels: Vec<u8> = graph.triangles.iter().map(label).collect();
    let on_sphere: Vec<Point> = directions.iter().map(|d| Point::from(*d)).collect();
    repair_labels(graph, &on_sphere, &on_sphere, &mut labels);
    solid.set_labels(&labels);
    // A cube as large as the solid is in the mean.
    let surface = SurfaceMesh::new(solid.mesh.nodes.clone(), graph.triangles.clone()).ok()?;
    let half = 0.5 * surface.volume().abs().cbrt();
    for (v, direction) in directions
        .iter()
        .enumerate()
        .filter(|(v, _)| solid.mesh.on_boundary[*v])
    {
        solid.x[v] = Point::from(direction * (half / direction.amax().max(f64::MIN_POSITIVE)));
    }
    for (corners, &label) in graph.triangles.iter().zip(&labels) {
        let side = if label % 2 == 1 { half } else { -half };
        corners.iter().for_each(|&v| solid.x[v as usize][axis_of(label)] = side);
    }
    place_inner_nodes(solid)
}

/// The direction of every boundary node on the sphere; zero for inner ones.
fn directions(solid: &Solid, monitor: &ProgressSender<PolycubePhase>) -> Option<Vec<Vector>> {
    let (mut compact, mut ids) = (vec![u32::MAX; solid.x.len()], vec![]);
    for &v in solid.mesh.boundary.iter().flatten() {
        if compact[v as usize] == u32::MAX {
            compact[v as usize] = ids.len() as u32;
            ids.push(v);
        }
    }
    let vertices = ids.iter().map(|&v| solid.mesh.nodes[v as usize]).collect();
    let triangles = solid
        .mesh
        .boundary
        .iter()
        .map(|t| t.map(|v| compact[v as usize]))
        .collect();
    let surface = SurfaceMesh::new(vertices, triangles).ok()?;
    let progress = |_| {
        let _ = monitor.send(PolycubePhase::Labelling { round: 1 });
        monitor.control()
    };
    let (embedding, _) = map_to_sphere(&surface, &SphereOptions::default(), &progress).ok()?;
    let mut directions = vec![Vector::zeros(); solid.x.len()];
    for (&v, direction) in ids.iter().zip(embedding.directions()) {
        directions[v as usize] = *direction;
    }
    Some(directions)
}

fn place_inner_nodes(solid: &mut Solid) -> Option<()> {
    let domain = TetMesh::new(solid.mesh.nodes.clone(), solid.tets().to_vec()).ok()?;
    let options = HarmonicOptions {
        solver: HarmonicSolver::Iterative,
        tolerance: 1e-6,
        ..HarmonicOptions::default()
    };
    let harmonic = TetHarmonic::new(domain, &options).ok()?;
    let boundary: Vec<Point> = harmonic
        .boundary_vertices()
        .iter()
        .map(|&v| solid.x[v as usize])
        .collect();
    solid.x = harmonic.solve(&boundary).ok()?.images().to_vec();
    Some(())
}
