//! The native module of the Python package: what the classes in `python/solidmap` call.
//!
//! It takes arrays of one type and layout each, and options as dictionaries with all entries; what users may give instead,
//! and the defaults, are Python's part. Reports cross as the JSON that the program prints. Errors become exceptions
//! ([`error`]); all that takes time runs without Python's lock ([`run`]).

mod arrays;
mod boundary;
mod compare;
mod error;
mod fit;
mod map;
mod measures;
mod meshes;
mod native;
mod polycube;
mod remesh;
mod run;
mod sequence;
mod texture;
mod transfer;

/// See `solidmap/_solidmap.pyi` for the types.
#[pyo3::pymodule]
mod _solidmap {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::boundary::{
        Boundary, boundary_improve, boundary_pair, boundary_sphere, boundary_torus, boundary_unfold,
    };
    #[pymodule_export]
    use crate::compare::{compare, mesh_metrics};
    #[pymodule_export]
    use crate::fit::{Factor, FrameEvaluator, fit, fit_memory};
    #[pymodule_export]
    use crate::map::Map;
    #[pymodule_export]
    use crate::measures::{certificate, distortions, energy, energy_densities};
    #[pymodule_export]
    use crate::meshes::{Cells, Surface, read_points, read_solid};
    #[pymodule_export]
    use crate::native::{isolate, offset_surface, serve_calls, tetrahedralise};
    #[pymodule_export]
    use crate::polycube::{Hexmesh, Polycube, hexmesh, polycube_of, read_labels, write_labels};
    #[pymodule_export]
    use crate::remesh::{CarriedMesh, carry, with_bijective};
    #[pymodule_export]
    use crate::run::{keep_freed_memory, set_threads, threads};
    #[pymodule_export]
    use crate::sequence::Sequence;
    #[pymodule_export]
    use crate::texture::{Texture, read_textured_surface, texture, write_volume};
    #[pymodule_export]
    use crate::transfer::{read_fields, transfer};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("LICENCE", solidmap::LICENCE)?;
        module.add("HAS_NATIVE", cfg!(feature = "native"))
    }
}
