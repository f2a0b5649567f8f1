//! Makes the bijective map of a fitted one, for `bijective` and `fit --bijective`.

use anyhow::Context;
use serde::Serialize;
use solidmap::bijective::{
    Bijective, BijectiveError, BijectiveReport, BoundaryProof, BoundaryRefinement, RefinementOptions, make_bijective,
    refined_at_boundary,
};
use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::self_intersection_finder;
use solidmap::io::SolidMesh;
use solidmap::map::HarmonicMap;
use solidmap::mesh::{CellList, SurfaceMesh, TetMesh};
use solidmap::remesh::{RemeshOptions, RepairStart};

use super::output::Output;
use super::remeshing::show_phase;
use crate::drawing::significant;

/// How the map is made.
pub struct Making {
    /// Mesh of the domain; TetGen makes one where there is none.
    pub mesh: Option<TetMesh>,
    pub refinement: RefinementOptions,
    pub split_stuck: Option<usize>,
    pub effort: f64,
    pub memory: Option<u64>,
}

/// What reports say of a bijective map.
#[derive(Debug, Clone, Serialize)]
pub struct BijectiveSummary {
    #[serde(flatten)]
    pub report: BijectiveReport,
    /// How the mesh was refined at its boundary before it was carried.
    pub refinement: BoundaryRefinement,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    pub seconds: f64,
}

/// The bijective map; an error in `Ok` says why none was found.
pub fn make(
    map: &HarmonicMap,
    boundary: &BoundaryMap,
    making: Making,
    output: &Output,
) -> anyhow::Result<Result<(Bijective, BijectiveSummary), BijectiveError>> {
    let start = std::time::Instant::now();
    let options = RemeshOptions {
        most_added: making.split_stuck,
        effort: making.effort,
        memory: making.memory,
        ..RemeshOptions::default()
    };
    let progress = |phase| show_phase(phase, "", output);
    let mesh = filled(boundary.domain(), making.mesh, making.memory, output)?;
    output.progress("refining the boundary");
    let (mesh, refinement) = match refined_at_boundary(boundary, mesh, &making.refinement, self_intersection_finder()) {
        Ok(refined) => refined,
        Err(error) => return Ok(Err(error)),
    };
    if refinement.deviation > making.refinement.tolerance {
        output.warn(format!(
            "the boundary map bends by up to {:.1e} of the target's diagonal within the {} triangles of the boundary, and \
             {:.1e} was to be reached; a finer mesh (--mesh) helps",
            refinement.deviation, refinement.triangles, making.refinement.tolerance
        ));
    }
    let found = make_bijective(boundary, map, mesh, &options, self_intersection_finder(), &progress);
    Ok(found.map(|bijective| {
        let summary = BijectiveSummary {
            report: bijective.report.clone(),
            refinement,
            seconds: start.elapsed().as_secs_f64(),
        };
        (bijective, summary)
    }))
}

/// The tetrahedra of a solid that was given by them.
pub fn own_tets(solid: SolidMesh) -> anyhow::Result<Option<TetMesh>> {
    let SolidMesh::Cells(mesh) = solid else { return Ok(None) };
    Ok(match mesh.into_parts() {
        (nodes, CellList::Tets(tets), _) => Some(TetMesh::new(nodes, tets)?),
        _ => None,
    })
}

/// Tetrahedra that fill a domain: the given ones, or TetGen's.
pub fn filled(
    domain: &SurfaceMesh,
    given: Option<TetMesh>,
    memory: Option<u64>,
    output: &Output,
) -> anyhow::Result<TetMesh> {
    if let Some(mesh) = given {
        return Ok(mesh);
    }
    output.progress("tetrahedralising");
    tetrahedra(domain, memory).context("cannot fill the domain with tetrahedra")
}

#[cfg(feature = "native")]
fn tetrahedra(domain: &SurfaceMesh, memory: Option<u64>) -> anyhow::Result<TetMesh> {
    use solidmap::cgal_tetgen::{TetOptions, tetrahedralize};
    let options = TetOptions {
        memory,
        ..TetOptions::default()
    };
    Ok(tetrahedralize(domain, &options)?)
}

#[cfg(not(feature = "native"))]
fn tetrahedra(_: &SurfaceMesh, _: Option<u64>) -> anyhow::Result<TetMesh> {
    anyhow::bail!(
        "it needs TetGen, and this solidmap was built without it; give a tet mesh of the domain, with --mesh or in place of its surface"
    )
}

/// Whether an error says that no bijective map was found, and not that the input cannot be used.
pub fn is_verdict(error: &BijectiveError) -> bool {
    use BijectiveError::{Boundary, Inverted, NotRepaired};
    matches!(error, NotRepaired { .. } | Boundary { .. } | Inverted { .. })
}

/// The rows of a summary.
pub fn rows(summary: &BijectiveSummary) -> Vec<[String; 2]> {
    let found = &summary.report;
    let mut rows = vec![[
        "bijective map".to_owned(),
        format!(
            "linear over {} tetrahedra, {} nodes, {} of them on the boundary",
            found.tets, found.nodes, found.boundary_nodes
        ),
    ]];
    let refinement = &summary.refinement;
    if refinement.nodes_added > 0 {
        rows.push([
            "boundary".into(),
            format!(
                "{} nodes added; the boundary map bends by {:.1e} of the target's diagonal at most within triangles",
                refinement.nodes_added, refinement.deviation
            ),
        ]);
    }
    let start = match found.start {
        RepairStart::AsMapped => "as mapped",
        RepairStart::FiniteElements => "as mapped; repaired from finite elements, which inverted fewer",
    };
    rows.push([
        "inverted".into(),
        format!(
            "0 now, decided exactly; {} {start}; {} tetrahedra added",
            found.inverted_as_mapped, found.cells_added
        ),
    ]);
    rows.push([
        "scaled Jacobian".into(),
        format!("at least {}", significant(found.min_scaled_jacobian, 3)),
    ]);
    rows.push([
        "one to one".into(),
        match found.boundary {
            BoundaryProof::OneToOne => {
                "proved: no tetrahedron is inverted, and the boundary does not meet itself".into()
            }
            BoundaryProof::NotChecked => {
                "if the boundary does not meet itself: that was not looked for, which needs CGAL".into()
            }
        },
    ]);
    let [x, y, z] = found.difference_place.map(|c| significant(c, 4));
    rows.push([
        "from harmonic".into(),
        format!(
            "{:.1e} rms, {:.1e} at most, of the target's diagonal; most at ({x}, {y}, {z}) in the domain",
            found.difference_rms, found.difference_max
        ),
    ]);
    rows.push([
        "target".into(),
        format!(
            "its surface is {:.1e} of the diagonal away from the image at most",
            found.gap
        ),
    ]);
    rows.push(["time".into(), format!("{:.2} s", summary.seconds)]);
    rows
}
