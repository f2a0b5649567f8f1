use std::fmt;

use serde::Serialize;

use super::anatomy::Anatomy;
use super::text::counted;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::NONE;

/// What [`repair()`] has done to a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct AppliedRepair {
    /// Which component, as [`super::CheckReport::components`] counts them.
    pub component: usize,
    /// How many triangles were reversed.
    pub faces: usize,
    /// Why.
    pub kind: RepairKind,
}

/// Why triangles were reversed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RepairKind {
    /// Their orientation was not that of their neighbours.
    MadeConsistent,
    /// A solid faced inward.
    TurnedOutward,
    /// A cavity's triangles faced away from the cavity.
    TurnedIntoCavity,
}

impl fmt::Display for AppliedRepair {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (component, triangles) = (self.component, counted(self.faces, "triangle"));
        let reversed = match self.kind {
            RepairKind::MadeConsistent => format!("{triangles} oriented unlike their neighbours"),
            RepairKind::TurnedOutward => format!("all {triangles} to face outward"),
            RepairKind::TurnedIntoCavity => format!("all {triangles} to face into the cavity"),
        };
        write!(f, "component {component}: reversed {reversed}")
    }
}

/// The surface with triangles reversed so that each closed component is oriented consistently, solids face outward and
/// cavities into the cavity; and the repairs, if any.
///
/// Vertices and triangles keep their indices; `[a, b, c]` becomes `[a, c, b]`. Components that bound nothing (open, not
/// manifold, not orientable, not finite) are left alone: [`super::check`] reports them.
pub fn repair(mesh: &SurfaceMesh) -> (SurfaceMesh, Vec<AppliedRepair>) {
    let anatomy = Anatomy::of(mesh);
    let mut repairs = Vec::new();
    let mut disagreeing = vec![0; anatomy.shells.len()];
    for triangle in anatomy.triangles_where(|t, shell| shell.is_sound && anatomy.orientation.flip[t]) {
        disagreeing[anatomy.components.of_triangle[triangle as usize] as usize] += 1;
    }
    for (component, shell) in anatomy.shells.iter().enumerate() {
        let mut record = |faces, kind| {
            repairs.push(AppliedRepair { component, faces, kind });
        };
        if disagreeing[component] > 0 {
            record(disagreeing[component], RepairKind::MadeConsistent);
        }
        if shell.faces_wrong_way() {
            let kind = if shell.is_cavity() {
                RepairKind::TurnedIntoCavity
            } else {
                RepairKind::TurnedOutward
            };
            record(anatomy.components.shapes[component].triangles, kind);
        }
    }
    if repairs.is_empty() {
        return (mesh.clone(), repairs);
    }
    (oriented(&anatomy), repairs)
}

pub(super) fn oriented(anatomy: &Anatomy) -> SurfaceMesh {
    let mesh = anatomy.mesh;
    let orient = |(t, &[a, b, c]): (usize, &[u32; 3])| {
        let component = anatomy.components.of_triangle[t];
        let shell = (component != NONE).then(|| &anatomy.shells[component as usize]);
        let reverse = shell.is_some_and(|s| s.is_sound && anatomy.orientation.flip[t] != s.faces_wrong_way());
        if reverse { [a, c, b] } else { [a, b, c] }
    };
    let triangles = mesh.triangles().iter().enumerate().map(orient).collect();
    SurfaceMesh::new(mesh.vertices().to_vec(), triangles).expect("the triangles name the vertices they named")
}
