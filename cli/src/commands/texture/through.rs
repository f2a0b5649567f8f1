//! The map that carries a texture to another solid.

use std::path::Path;

use anyhow::{Context, ensure};
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::MapFile;
use solidmap::geometry::{QueryError, SurfaceQuery};
use solidmap::inverse::InverseOptions;
use solidmap::mesh::SurfaceMesh;

use crate::args::{MapChoice, TextureArgs};
use crate::shared::chosen_map::{ChosenInverse, ChosenMap, MapName};
use crate::shared::input;

/// Largest distance between the surfaces of the model and the map's domain, as a fraction of the domain's diagonal: they may
/// be meshed differently.
const SAME_SURFACE: f64 = 0.01;

/// A map whose domain is the model.
pub struct ThroughMap<'a> {
    pub path: &'a Path,
    choice: MapChoice,
    file: MapFile,
    boundary: BoundaryMap,
}

impl<'a> ThroughMap<'a> {
    /// The map of `--through`, refused where the model is not its domain.
    pub fn read(args: &'a TextureArgs, model: &SurfaceMesh) -> anyhow::Result<Option<Self>> {
        let Some(path) = &args.through.through else {
            return Ok(None);
        };
        let (file, boundary) = input::read_fitted_map(path)?;
        let domain = boundary.domain();
        let off = distance_between(model, domain)
            .with_context(|| format!("cannot compare `{}` with `{}`", args.model.display(), path.display()))?;
        ensure!(
            off <= SAME_SURFACE * domain.diagonal(),
            "`{model}` is not the domain of the map `{map}`: their surfaces are up to {off:.3e} apart, {:.0} % of the domain's \
             diagonal; name a map that was fitted to `{model}`, in the same place and units",
            100.0 * off / domain.diagonal(),
            model = args.model.display(),
            map = path.display()
        );
        Ok(Some(Self {
            path,
            choice: MapChoice {
                map_kind: args.through.through_kind,
            },
            file,
            boundary,
        }))
    }

    /// The surface that the colours are carried to.
    pub fn target(&self) -> SurfaceMesh {
        self.boundary.outward_target()
    }

    /// What finds preimages, and the name of the map.
    pub fn inverse(&self) -> anyhow::Result<(ChosenInverse<'_>, MapName)> {
        let chosen = ChosenMap::of(&self.file, self.path, &self.choice)?;
        let inverse = ChosenInverse::of(chosen, &self.boundary, InverseOptions::default());
        Ok((inverse, chosen.name()))
    }
}

/// The largest distance of the vertices of each surface from the other surface.
fn distance_between(a: &SurfaceMesh, b: &SurfaceMesh) -> Result<f64, QueryError> {
    let farthest = |points: &[Point], surface: &SurfaceMesh| {
        let found = SurfaceQuery::with_winding_sign(surface)?.closest_points(points);
        Ok(found.iter().map(|closest| closest.distance).fold(0.0, f64::max))
    };
    Ok(farthest(a.vertices(), b)?.max(farthest(b.vertices(), a)?))
}
