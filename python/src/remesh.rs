//! Meshes carried by maps, and bijective maps.

use std::sync::Arc;

use numpy::PyArray2;
use pyo3::prelude::*;
use serde_json::json;
use solidmap::bijective::{RefinementOptions, make_bijective, refined_at_boundary};
use solidmap::fit::self_intersection_finder;
use solidmap::mesh::CellMesh;
use solidmap::remesh::{
    CellKind, CellSize, InversionCause, RemeshOptions, RemeshPhase, RemeshReport, RemeshSource, Remeshed, remesh,
};

use crate::arrays::copy_of_points;
use crate::boundary::value_of;
use crate::error::Failure;
use crate::map::{Map, boundary_of};
use crate::meshes::{Cells, json as to_json};
use crate::native::filled;
use crate::run::{Step, of, run, step};

/// The program's options of carried meshes.
#[derive(FromPyObject, Clone)]
#[pyo3(from_item_all)]
pub struct RemeshArguments {
    pub kind: String,
    pub cells: usize,
    pub cell_size: Option<f64>,
    pub no_repair: bool,
    pub polish: Option<usize>,
    pub fix_boundary: bool,
    pub keep_boundary_map: bool,
    pub split_stuck: Option<usize>,
    pub effort: f64,
    pub max_cells: usize,
    pub memory: Option<u64>,
    pub worst: usize,
}

impl RemeshArguments {
    pub fn kind(&self) -> CellKind {
        match self.kind.as_str() {
            "hex" => CellKind::Hexes,
            _ => CellKind::Tets,
        }
    }

    pub fn size(&self) -> Result<CellSize, Failure> {
        match (self.cell_size, self.cells) {
            (Some(length), _) => Ok(CellSize::Length(length)),
            (None, 0) => Err(Failure::invalid("cells is 0, but must be at least 1")),
            (None, cells) => Ok(CellSize::Along(cells)),
        }
    }

    pub fn options(&self) -> RemeshOptions {
        RemeshOptions {
            repair: !self.no_repair,
            slide: !self.fix_boundary,
            keep_boundary_map: self.keep_boundary_map,
            most_added: self.split_stuck,
            effort: self.effort,
            polish: self.polish.unwrap_or(RemeshOptions::default().polish),
            polish_valid: self.polish.is_some(),
            memory: self.memory.or_else(solidmap::memory::default_budget),
        }
    }
}

pub fn remesh_step(phase: RemeshPhase) -> Step {
    match phase {
        RemeshPhase::Meshing => step("meshing"),
        RemeshPhase::Mapping { nodes } => step(&format!("mapping {nodes} nodes")),
        RemeshPhase::MappingBoundary => step("mapping boundary"),
        RemeshPhase::Repairing { round, inverted } => {
            of("repairing", None, format!("round {round}, {inverted} cells inverted"))
        }
        RemeshPhase::Verifying => step("verifying"),
    }
}

/// A mesh carried into the target.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct CarriedMesh {
    remeshed: Arc<Remeshed>,
    worst: usize,
}

impl CarriedMesh {
    pub fn of(remeshed: Remeshed, worst: usize) -> Self {
        Self {
            remeshed: Arc::new(remeshed),
            worst,
        }
    }

    fn with_nodes(&self, nodes: &[solidmap::Point]) -> PyResult<Cells> {
        let mesh = &self.remeshed.mesh;
        let made = CellMesh::new(nodes.to_vec(), mesh.cells().clone(), mesh.regions().to_vec());
        Ok(Cells::of(made.map_err(Failure::from)?))
    }
}

/// How many cells stay inverted, by their cause.
fn reasons(report: &RemeshReport) -> serde_json::Value {
    let count = |cause: InversionCause| {
        let cells = report.after.cells.iter();
        cells
            .filter(|&&cell| report.causes_after.of_cells[cell as usize] == cause)
            .count()
    };
    json!({
        "boundary": count(InversionCause::Boundary),
        "blocked_node": count(InversionCause::BlockedNode),
        "folded_quad": count(InversionCause::FoldedQuad),
        "winding_ring": count(InversionCause::WindingRing),
        "unknown": count(InversionCause::Unknown),
    })
}

#[pymethods]
impl CarriedMesh {
    /// The mesh of the target.
    fn mesh(&self) -> PyResult<Cells> {
        self.with_nodes(&self.remeshed.images)
    }

    /// The same cells in the domain.
    fn domain_mesh(&self) -> PyResult<Cells> {
        self.with_nodes(self.remeshed.mesh.nodes())
    }

    /// Nodes as the map puts them, before any repair.
    fn as_mapped<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_points(py, &self.remeshed.carried)
    }

    /// The report, as `remesh --json` prints it.
    fn report_json(&self, py: Python) -> PyResult<String> {
        let (remeshed, worst) = (Arc::clone(&self.remeshed), self.worst);
        run(py, None, None, move |_| {
            let report = &remeshed.report;
            let mut all = value_of(report)?;
            all["inverted_cells"] = json!(report.after.cells.len());
            all["reasons"] = reasons(report);
            all["min_scaled_jacobian"] = json!(report.quality.map(|quality| quality.min_scaled_jacobian));
            all["crossings"] = value_of(&remeshed.boundary_intersections(self_intersection_finder()))?;
            all["worst_places"] = value_of(&remeshed.worst_places(worst))?;
            Ok(all.to_string())
        })
    }
}

/// A regular mesh of the domain, or the given one, carried by the harmonic map.
#[pyfunction]
#[pyo3(signature = (map, arguments, mesh=None, progress=None))]
pub fn carry(
    py: Python,
    map: &Map,
    arguments: RemeshArguments,
    mesh: Option<&Cells>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<CarriedMesh> {
    let file = Arc::clone(&map.file);
    let source = match mesh {
        Some(mesh) => RemeshSource::Given((*mesh.0).clone()),
        None => RemeshSource::Regular {
            kind: arguments.kind(),
            size: arguments.size()?,
            most_cells: arguments.max_cells,
        },
    };
    run(py, progress, None, move |watch| {
        let report = |phase| watch.tell(|| remesh_step(phase));
        let found = remesh(boundary_of(&file)?, &file.map, source, &arguments.options(), &report)?;
        Ok(CarriedMesh::of(found, arguments.worst))
    })
}

/// The program's options of bijective maps.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct BijectiveArguments {
    tolerance: Option<f64>,
    split_stuck: Option<usize>,
    effort: f64,
    memory: Option<u64>,
}

/// The map with its bijective one beside it, and how the boundary was refined for that.
#[pyfunction]
#[pyo3(signature = (map, arguments, mesh=None, progress=None))]
pub fn with_bijective(
    py: Python,
    map: &Map,
    arguments: BijectiveArguments,
    mesh: Option<&Cells>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Map, String)> {
    let (file, report) = (Arc::clone(&map.file), map.report().cloned());
    let given = mesh.map(|mesh| mesh.tets("mesh")).transpose()?;
    run(py, progress, None, move |watch| {
        let boundary = boundary_of(&file)?;
        let memory = arguments.memory.or_else(solidmap::memory::default_budget);
        let mesh = match given {
            Some(mesh) => mesh,
            None => filled(boundary.domain(), memory, watch)?,
        };
        let by_default = RefinementOptions::default();
        let refinement = RefinementOptions {
            tolerance: arguments.tolerance.unwrap_or(by_default.tolerance),
            ..by_default
        };
        let options = RemeshOptions {
            most_added: arguments.split_stuck,
            effort: arguments.effort,
            memory,
            ..RemeshOptions::default()
        };
        let _ = watch.tell(|| step("refining the boundary"));
        let (mesh, refined) = refined_at_boundary(boundary, mesh, &refinement, self_intersection_finder())?;
        let made = make_bijective(
            boundary,
            &file.map,
            mesh,
            &options,
            self_intersection_finder(),
            &|phase| watch.tell(|| remesh_step(phase)),
        )?;
        let both = (*file).clone().with_bijective(made);
        Ok((Map::of_file(both, report), to_json(&refined)?))
    })
}
