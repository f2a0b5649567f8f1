//! Real models for tests: the folder is named by `SOLIDMAP_MODELS`.

use crate::mesh::SurfaceMesh;

/// A surface; `None`, loudly, when no folder is named.
pub(crate) fn load(name: &str) -> Option<SurfaceMesh> {
    let Ok(folder) = std::env::var("SOLIDMAP_MODELS") else {
        eprintln!("SKIPPED: {name} is not tested; set SOLIDMAP_MODELS to the folder of models");
        return None;
    };
    let path = std::path::Path::new(&folder).join(name);
    Some(crate::io::read_surface(path).unwrap_or_else(|error| panic!("{error}")))
}
