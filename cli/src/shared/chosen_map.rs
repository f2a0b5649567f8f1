//! The map of a file that a command uses: the harmonic one, or the bijective one.

use std::path::Path;

use anyhow::Context;
use serde::Serialize;
use solidmap::bijective::BijectiveMap;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::MapFile;
use solidmap::inverse::{Inverse, InverseMap, InverseOptions};
use solidmap::map::{HarmonicMap, VolumeMap};

use crate::args::{MapChoice, MapKind};

/// One of the maps of a file.
#[derive(Clone, Copy)]
pub enum ChosenMap<'a> {
    Harmonic(&'a HarmonicMap),
    Bijective(&'a BijectiveMap),
}

/// Its name in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MapName {
    Harmonic,
    Bijective,
}

impl From<MapKind> for MapName {
    fn from(kind: MapKind) -> Self {
        match kind {
            MapKind::Harmonic => Self::Harmonic,
            MapKind::Bijective => Self::Bijective,
        }
    }
}

impl<'a> ChosenMap<'a> {
    /// The map that was asked for: by default the bijective one, where the file has it.
    pub fn of(file: &'a MapFile, path: &Path, choice: &MapChoice) -> anyhow::Result<Self> {
        let bijective = file.bijective.as_ref().map(|bijective| &bijective.map);
        match (choice.map_kind, bijective) {
            (Some(MapKind::Harmonic), _) | (None, None) => Ok(Self::Harmonic(&file.map)),
            (_, Some(map)) => Ok(Self::Bijective(map)),
            (Some(MapKind::Bijective), None) => anyhow::bail!(
                "`{shown}` holds no bijective map; `solidmap bijective {shown}` adds one",
                shown = path.display()
            ),
        }
    }

    pub fn map(self) -> &'a dyn VolumeMap {
        match self {
            Self::Harmonic(map) => map,
            Self::Bijective(map) => map,
        }
    }

    pub fn name(self) -> MapName {
        match self {
            Self::Harmonic(_) => MapName::Harmonic,
            Self::Bijective(_) => MapName::Bijective,
        }
    }
}

/// What finds preimages under a chosen map.
pub enum ChosenInverse<'a> {
    /// By Newton's method, with sums that are as accurate as it asks for.
    Newton(Box<HarmonicMap>, &'a BoundaryMap, InverseOptions),
    Location(&'a BijectiveMap),
}

impl<'a> ChosenInverse<'a> {
    pub fn of(map: ChosenMap<'a>, boundary: &'a BoundaryMap, options: InverseOptions) -> Self {
        match map {
            ChosenMap::Harmonic(map) => Self::Newton(Box::new(map.clone().with_error(0.0)), boundary, options),
            ChosenMap::Bijective(map) => Self::Location(map),
        }
    }

    /// The map that is inverted.
    pub fn map(&self) -> &dyn VolumeMap {
        match self {
            Self::Newton(map, ..) => &**map,
            Self::Location(map) => *map,
        }
    }

    /// Prepares the search.
    pub fn prepared(&self, path: &Path) -> anyhow::Result<Box<dyn Inverse + '_>> {
        Ok(match self {
            Self::Newton(map, boundary, options) => Box::new(
                InverseMap::new(&**map, boundary, options)
                    .with_context(|| format!("cannot invert `{}`", path.display()))?,
            ),
            Self::Location(map) => Box::new((*map).clone()),
        })
    }
}
