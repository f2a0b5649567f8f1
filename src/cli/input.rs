//! Files as the commands want them.

use std::path::Path;

use anyhow::Context;
use solidmap::boundary_map::BoundaryMap;
use solidmap::io::{self, MapFile, Solid};
use solidmap::mesh::SurfaceMesh;

/// A closed surface, or the boundary of a tet mesh.
pub fn read_surface(path: &Path) -> anyhow::Result<SurfaceMesh> {
    Ok(match io::read_solid(path)? {
        Solid::Surface(surface) => surface,
        Solid::Tets(tets) => tets.boundary().surface,
    })
}

/// The boundary map from one file to another of the same connectivity.
pub fn read_boundary_map(domain: &Path, image: &Path) -> anyhow::Result<BoundaryMap> {
    let map = match (io::read_solid(domain)?, io::read_solid(image)?) {
        (Solid::Tets(domain), Solid::Tets(image)) => BoundaryMap::between_tets(&domain, &image),
        (Solid::Tets(domain), Solid::Surface(image)) => BoundaryMap::between(domain.boundary().surface, &image),
        (Solid::Surface(domain), Solid::Tets(image)) => BoundaryMap::between(domain, &image.boundary().surface),
        (Solid::Surface(domain), Solid::Surface(image)) => BoundaryMap::between(domain, &image),
    };
    map.with_context(|| format!("cannot map `{}` to `{}`", domain.display(), image.display()))
}

/// A map file and the boundary map it was fitted to.
pub fn read_fitted_map(path: &Path) -> anyhow::Result<(MapFile, BoundaryMap)> {
    let file = io::read_map(path)?;
    let boundary = file
        .boundary
        .clone()
        .with_context(|| format!("`{}` holds a map without its domain; fit it again", path.display()))?;
    Ok((file, boundary))
}
