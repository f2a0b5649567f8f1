//! CGAL and TetGen: tetrahedra and offset surfaces.

use pyo3::prelude::*;

use crate::error::Failure;
use crate::meshes::{Cells, Surface};
use crate::run::run;

/// What a surface's mesh is made with.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
#[cfg_attr(
    not(feature = "native"),
    expect(dead_code, reason = "there is nothing that uses them")
)]
pub struct TetArguments {
    mesher: String,
    quality: f64,
    max_volume: Option<f64>,
    memory: Option<u64>,
}

#[cfg(feature = "native")]
mod calls {
    use std::ffi::{c_int, c_void};
    use std::ops::ControlFlow;
    use std::path::PathBuf;
    use std::sync::Arc;

    use serde_json::json;
    use solidmap::cgal_tetgen::{
        self, Isolation, Mesh3Options, OffsetOptions, TetOptions, cancellable, regular_tet_circumradius,
        tetrahedralize, tetrahedralize_mesh3,
    };
    use solidmap::mesh::{CellMesh, SurfaceMesh, TetMesh};

    use super::*;
    use crate::error::ErrorKind;
    use crate::run::{Watch, step};

    /// TetGen's tetrahedra, as the program makes them where none are given.
    pub fn filled(surface: &SurfaceMesh, memory: Option<u64>, watch: &Watch) -> Result<TetMesh, Failure> {
        let surface = surface.clone();
        let options = TetOptions {
            memory: memory.or_else(solidmap::memory::default_budget),
            ..TetOptions::default()
        };
        let poll = || watch.tell(|| step("tetrahedralising"));
        Ok(cancellable(&poll, move || tetrahedralize(&surface, &options))?)
    }

    pub fn made(surface: Arc<SurfaceMesh>, arguments: TetArguments, watch: &Watch) -> Result<CellMesh, Failure> {
        let TetArguments {
            mesher,
            quality,
            max_volume,
            memory,
        } = arguments;
        if quality != 0.0 && (quality.is_nan() || quality < 1.1) {
            return Err(Failure::invalid(format!(
                "quality is {quality}, but must be 0 (no refinement) or at least 1.1"
            )));
        }
        let memory = memory.or_else(solidmap::memory::default_budget);
        let poll = || -> ControlFlow<()> { watch.tell(|| step("tetrahedralising")) };
        let mesh = match mesher.as_str() {
            "tetgen" => {
                let options = TetOptions {
                    radius_edge_ratio: (quality > 0.0).then_some(quality),
                    max_volume,
                    memory,
                    ..TetOptions::default()
                };
                cancellable(&poll, move || tetrahedralize(&surface, &options))?
            }
            _ => {
                let options = Mesh3Options {
                    cell_size: max_volume.map(regular_tet_circumradius),
                    memory,
                    ..Mesh3Options::default()
                };
                cancellable(&poll, move || tetrahedralize_mesh3(&surface, &options))?
            }
        };
        Ok(CellMesh::from(mesh))
    }

    pub fn offset(surface: Arc<SurfaceMesh>, distance: f64, watch: &Watch) -> Result<(Surface, String), Failure> {
        let poll = || watch.tell(|| step("wrapping"));
        let found = cancellable(&poll, move || {
            cgal_tetgen::offset_surface(&surface, distance, &OffsetOptions::default())
        })?;
        let report = json!({
            "distance": distance,
            "vertices": found.mesh.vertices().len(),
            "faces": found.mesh.triangles().len(),
            "vertex_error": found.vertex_error,
            "centroid_error": found.centroid_error,
            "min_distance": found.min_distance,
            "genus": found.genus,
            "model_genus": found.model_genus,
            "components": found.components,
            "raw_wrap": found.raw_wrap,
        });
        Ok((Surface::of(found.mesh), report.to_string()))
    }

    /// Makes CGAL and TetGen run in processes of their own, so that a crash does not end this one.
    pub fn isolate(program: PathBuf, arguments: Vec<String>) {
        cgal_tetgen::isolate(Some(Isolation {
            program,
            arguments,
            time_limit: None,
        }));
    }

    unsafe extern "C-unwind" {
        fn solidmap_tetgen_failed(code: c_int);
    }

    /// `terminatetetgen(tetgenmesh*, int)`, which TetGen calls on an error; its own ends the process, or frees the mesh
    /// twice. A module of Python exports what Rust marks for it and nothing from C++, so the library's replacement would
    /// not be found (`src/cgal_tetgen/cpp/tetgen.cpp`).
    ///
    /// # Safety
    ///
    /// For TetGen to call, with an error's code.
    #[unsafe(export_name = "_Z15terminatetetgenP10tetgenmeshi")]
    unsafe extern "C-unwind" fn terminatetetgen(_: *mut c_void, code: c_int) {
        // SAFETY: it only throws the code.
        unsafe { solidmap_tetgen_failed(code) }
    }

    pub fn serve() -> Result<(), Failure> {
        cgal_tetgen::serve_calls().map_err(|error| Failure::new(ErrorKind::Io, error.to_string()))
    }
}

#[cfg(not(feature = "native"))]
mod calls {
    use std::path::PathBuf;
    use std::sync::Arc;

    use solidmap::mesh::{CellMesh, SurfaceMesh, TetMesh};

    use super::*;
    use crate::run::Watch;

    pub fn filled(_: &SurfaceMesh, _: Option<u64>, _: &Watch) -> Result<TetMesh, Failure> {
        Err(Failure::needs_native(
            "filling a surface with tetrahedra",
            "give a tet mesh of it",
        ))
    }

    pub fn made(_: Arc<SurfaceMesh>, _: TetArguments, _: &Watch) -> Result<CellMesh, Failure> {
        Err(Failure::needs_native(
            "tetrahedralise",
            "make the mesh with another program",
        ))
    }

    pub fn offset(_: Arc<SurfaceMesh>, _: f64, _: &Watch) -> Result<(Surface, String), Failure> {
        Err(Failure::needs_native(
            "offset_surface",
            "make the surface with another program",
        ))
    }

    pub fn isolate(_: PathBuf, _: Vec<String>) {}

    pub fn serve() -> Result<(), Failure> {
        Err(Failure::needs_native("the worker", "leave it alone"))
    }
}

pub use calls::filled;

#[pyfunction]
pub fn tetrahedralise(
    py: Python,
    surface: &Surface,
    arguments: TetArguments,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Cells> {
    let surface = std::sync::Arc::clone(&surface.0);
    run(py, progress, None, move |watch| {
        Ok(Cells::of(calls::made(surface, arguments, watch)?))
    })
}

#[pyfunction]
pub fn offset_surface(
    py: Python,
    surface: &Surface,
    distance: f64,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Surface, String)> {
    let surface = std::sync::Arc::clone(&surface.0);
    run(py, progress, None, move |watch| calls::offset(surface, distance, watch))
}

/// `program` with `arguments` is to call [`serve_calls`].
#[pyfunction]
pub fn isolate(program: std::path::PathBuf, arguments: Vec<String>) {
    calls::isolate(program, arguments);
}

/// Serves calls of CGAL and TetGen to the process that started this one.
#[pyfunction]
pub fn serve_calls(py: Python) -> PyResult<()> {
    Ok(py.detach(calls::serve)?)
}
