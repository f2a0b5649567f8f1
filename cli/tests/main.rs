//! Tests of the program, run as its users run it, in one binary, so that they are linked once. Tests that isolate CGAL
//! and TetGen, which is a setting of the whole process, are in `isolation.rs`.

mod bad_input;
mod bijective;
mod boundary;
mod boundary_check;
mod budgets;
mod cells;
mod certify;
#[path = "../../tests/common/mod.rs"]
mod common;
#[cfg(feature = "native")]
mod compare;
mod inverse;
#[cfg(feature = "native")]
mod json;
mod models;
#[cfg(unix)]
mod no_loss;
mod polycube;
mod program;
mod remesh;
mod reproducible;
mod sequence;
mod small_files;
mod study;
mod texture;
mod transfer;
mod view_page;
mod workplace;
