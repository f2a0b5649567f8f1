//! Every surface that can be read goes to `check`. The first byte chooses the format.
#![no_main]

use solidmap::check::examine_cells;
use solidmap::io::{SolidMesh, read_solid};
use solidmap_fuzz::{examine, with_file};

const FORMATS: [&str; 8] = ["obj", "off", "ply", "stl", "mesh", "msh", "vtk", "vtu"];

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((&format, bytes)) = bytes.split_first() else {
        return;
    };
    let extension = FORMATS[usize::from(format) % FORMATS.len()];
    match with_file(extension, bytes, |path| read_solid(path)) {
        Ok(SolidMesh::Surface(surface)) => examine(&surface, 16),
        Ok(SolidMesh::Cells(cells)) => {
            let _ = examine_cells(&cells);
            examine(&cells.boundary().surface, 16);
        }
        Err(_) => {}
    }
});
