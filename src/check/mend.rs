use std::fmt;

use serde::Serialize;

use super::anatomy::Anatomy;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::NONE;

/// What [`mend`] did to a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Mending {
    /// Which component, as [`super::CheckReport::components`] counts them.
    pub component: usize,
    /// How many triangles were turned over.
    pub faces: usize,
    /// Why.
    pub kind: MendingKind,
}

/// Why triangles were turned over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MendingKind {
    /// They disagreed with their neighbours.
    MadeConsistent,
    /// A solid faced inward.
    TurnedOutward,
    /// A cavity faced away from the cavity.
    TurnedIntoCavity,
}

impl fmt::Display for Mending {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { component, faces, .. } = self;
        match self.kind {
            MendingKind::MadeConsistent => write!(
                f,
                "component {component}: turned over {faces} triangles that disagreed with their neighbours"
            ),
            MendingKind::TurnedOutward => {
                write!(
                    f,
                    "component {component}: turned over all {faces} triangles to face outward"
                )
            }
            MendingKind::TurnedIntoCavity => {
                write!(
                    f,
                    "component {component}: turned over all {faces} triangles to face into the cavity"
                )
            }
        }
    }
}

/// The surface with triangles turned over so that each closed component agrees with itself, solids face outward and
/// cavities into the cavity; and what was done, if anything.
///
/// Vertices and triangles keep their numbers; `[a, b, c]` becomes `[a, c, b]`. Components that bound nothing (open, not
/// manifold, not orientable, not finite) are left alone: [`super::check`] reports them.
pub fn mend(mesh: &SurfaceMesh) -> (SurfaceMesh, Vec<Mending>) {
    let anatomy = Anatomy::of(mesh);
    let mut mendings = Vec::new();
    let mut disagreeing = vec![0; anatomy.shells.len()];
    for triangle in anatomy.triangles_where(|t, shell| shell.is_sound && anatomy.orientation.flip[t]) {
        disagreeing[anatomy.components.of_triangle[triangle as usize] as usize] += 1;
    }
    for (component, shell) in anatomy.shells.iter().enumerate() {
        let mut record = |faces, kind| {
            mendings.push(Mending { component, faces, kind });
        };
        if disagreeing[component] > 0 {
            record(disagreeing[component], MendingKind::MadeConsistent);
        }
        if shell.faces_wrong_way() {
            let kind = if shell.is_cavity() {
                MendingKind::TurnedIntoCavity
            } else {
                MendingKind::TurnedOutward
            };
            record(anatomy.components.shapes[component].triangles, kind);
        }
    }
    if mendings.is_empty() {
        return (mesh.clone(), mendings);
    }
    (turned(&anatomy), mendings)
}

fn turned(anatomy: &Anatomy) -> SurfaceMesh {
    let mesh = anatomy.mesh;
    let turn = |(t, &[a, b, c]): (usize, &[u32; 3])| {
        let component = anatomy.components.of_triangle[t];
        let shell = (component != NONE).then(|| &anatomy.shells[component as usize]);
        let over = shell.is_some_and(|s| s.is_sound && anatomy.orientation.flip[t] != s.faces_wrong_way());
        if over { [a, c, b] } else { [a, b, c] }
    };
    let triangles = mesh.triangles().iter().enumerate().map(turn).collect();
    SurfaceMesh::new(mesh.vertices().to_vec(), triangles).expect("the triangles name the vertices they named")
}
