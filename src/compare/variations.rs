//! What is varied to see how accurate maps become, and how much they depend on meshes and source distances.

use super::{ComparedMethod, MapFigures, MeshSpec, TetMesher};
use crate::mesh::SurfaceMesh;

/// Tighter tolerances of the method of fundamental solutions, as fractions of the one asked for.
const TIGHTER: [f64; 2] = [0.5, 0.25];
/// Refinements of finite elements at most, each to about twice the tetrahedra.
const MOST_REFINEMENTS: usize = 14;
/// Source distances in a study, over the sources' spacing.
const ALPHAS: [f64; 4] = [0.8, 1.0, 1.25, 1.5];
/// Radius-edge ratios of TetGen's meshes in a study.
const QUALITIES: [f64; 3] = [2.0, 1.414, 1.15];

/// A map to make, and what is special about it.
#[derive(Debug, Clone)]
pub struct Variation {
    /// How it is made.
    pub method: ComparedMethod,
    /// What is varied, for tables.
    pub what: String,
    /// Boundary error that the method of fundamental solutions aims at.
    pub tolerance: f64,
    /// Distance of its sources from the surface, over their spacing.
    pub alpha: f64,
    /// How the domain is meshed.
    pub mesh: MeshSpec,
}

impl Variation {
    /// The map by `method` itself.
    pub fn of(method: ComparedMethod, tolerance: f64, mesh: MeshSpec) -> Self {
        Self {
            method,
            what: format!("tolerance {tolerance:.1e}"),
            tolerance,
            alpha: 1.0,
            mesh,
        }
    }

    /// Four maps by the same method that should hardly differ: on several meshes, or with sources at several distances.
    pub fn study(&self) -> Vec<Self> {
        if self.method == ComparedMethod::Mfs {
            let at = |alpha| Self {
                what: format!("sources at {alpha} spacings"),
                alpha,
                ..self.clone()
            };
            return ALPHAS.map(at).to_vec();
        }
        let on = |what: String, source, quality| Self {
            what,
            mesh: MeshSpec {
                source,
                quality,
                ..self.mesh
            },
            ..self.clone()
        };
        let by_tetgen = QUALITIES.map(|quality| on(format!("TetGen, quality {quality}"), TetMesher::Tetgen, quality));
        let by_mesh3 = on("Mesh_3".into(), TetMesher::Mesh3, self.mesh.quality);
        by_tetgen.into_iter().chain([by_mesh3]).collect()
    }
}

/// Runs maps by fundamental solutions at tighter tolerances than `base` has; then finer and finer finite elements, until
/// their difference to the reference inside is at most `goal`, or one has none. `figures` are those of a row that `run`
/// returned, if it has any. Meshes that came out as the one before are left out.
pub fn equal_accuracy<R>(
    domain: &SurfaceMesh,
    base: &Variation,
    goal: f64,
    run: &mut dyn FnMut(&Variation) -> R,
    figures: fn(&R) -> Option<&MapFigures>,
) -> Vec<(Variation, R)> {
    let mut steps = Vec::new();
    for factor in TIGHTER {
        let tighter = Variation::of(ComparedMethod::Mfs, factor * base.tolerance, base.mesh);
        let row = run(&tighter);
        steps.push((tighter, row));
    }
    for k in 0..MOST_REFINEMENTS {
        let (what, mesh) = finer_mesh(domain, &base.mesh, k);
        let finer = Variation {
            method: ComparedMethod::Fem,
            what,
            mesh,
            ..base.clone()
        };
        let row = run(&finer);
        let found = figures(&row);
        let difference = found.and_then(|found| found.interior_difference);
        let is_last = difference.is_none_or(|difference| difference.rms <= goal);
        let tets = found.map(|found| found.tets);
        let is_as_before = steps.last().is_some_and(|(before, row): &(Variation, R)| {
            before.method == ComparedMethod::Fem && figures(row).map(|found| found.tets) == tets
        });
        if !is_last && is_as_before {
            continue;
        }
        steps.push((finer, row));
        if is_last {
            break;
        }
    }
    steps
}

/// The mesh of refinement `k`, and what it is: coarse inside at first, then with edges so much shorter that the tetrahedra
/// double. A mesh keeps the triangles of the surface, which are cut when they are larger than the tetrahedra.
fn finer_mesh(domain: &SurfaceMesh, spec: &MeshSpec, k: usize) -> (String, MeshSpec) {
    if k == 0 {
        return ("as coarse as can be".into(), MeshSpec { edge: None, ..*spec });
    }
    let coarsest = MeshSpec::of(domain).edge.unwrap_or(0.1);
    let edge = coarsest * 0.5f64.powf((k - 1) as f64 / 3.0);
    let surface = 0.5 * coarsest;
    let subdivisions = (surface / edge).log2().ceil().max(0.0) as u32;
    let spec = MeshSpec {
        subdivisions,
        edge: Some(edge),
        ..*spec
    };
    (format!("edge {edge:.2e}"), spec)
}
