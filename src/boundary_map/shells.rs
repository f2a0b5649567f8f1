//! Maps between solids of several shells, which are components or cavities: each shell of the domain goes to one of the target's by a
//! composition of its own.

use std::sync::Arc;

use super::composition::{Composition, before_subdivision};
use super::{BoundaryMap, BoundaryMapError};
use crate::Point;
use crate::check::{ShellSurface, shells_of};
use crate::mesh::{SurfaceMesh, SurfacePoint};

/// The map of a shell of the domain.
#[derive(Debug, Clone, PartialEq)]
pub struct ShellMap {
    /// The shell of the target that it goes to. Shells count from 0 in the order of their first triangles.
    pub target: usize,
    /// The map between both shells, as surfaces of their own that face outward: those of cavities are reversed. It goes through the
    /// sphere, a flat torus or a hyperbolic surface.
    pub map: BoundaryMap,
}

/// The maps of all shells. Copies share them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ShellMaps {
    maps: Arc<Vec<ShellMap>>,
    /// The domain, as it was before subdivision, and the target.
    sides: [Arc<Side>; 2],
    /// How often each triangle of the domain was cut into four since.
    subdivisions: u32,
}

/// A surface and its shells.
#[derive(Debug, Clone, PartialEq)]
struct Side {
    surface: SurfaceMesh,
    /// For each triangle its shell, and its index there.
    places: Vec<[u32; 2]>,
    /// For each shell its triangles, and whether they are reversed in it.
    shells: Vec<(Vec<u32>, bool)>,
}

impl Side {
    fn new(surface: SurfaceMesh, shells: Vec<ShellSurface>) -> Self {
        let mut places = vec![[0; 2]; surface.triangles().len()];
        for (shell, found) in shells.iter().enumerate() {
            for (own, &t) in found.triangles.iter().enumerate() {
                places[t as usize] = [shell as u32, own as u32];
            }
        }
        let shells = shells.into_iter().map(|shell| (shell.triangles, shell.is_cavity));
        Self {
            surface,
            places,
            shells: shells.collect(),
        }
    }

    /// The shell of a point, and the point there.
    fn in_shell(&self, point: &SurfacePoint) -> (usize, SurfacePoint) {
        let [shell, triangle] = self.places[point.triangle as usize];
        let is_reversed = self.shells[shell as usize].1;
        let barycentric = turned(point.barycentric, is_reversed);
        (shell as usize, SurfacePoint { triangle, barycentric })
    }

    /// The point of the surface that is this one of a shell.
    fn of_shell(&self, shell: usize, point: &SurfacePoint) -> SurfacePoint {
        let (triangles, is_reversed) = &self.shells[shell];
        SurfacePoint {
            triangle: triangles[point.triangle as usize],
            barycentric: turned(point.barycentric, *is_reversed),
        }
    }
}

fn turned([l, m, n]: [f64; 3], is_reversed: bool) -> [f64; 3] {
    if is_reversed { [l, n, m] } else { [l, m, n] }
}

impl ShellMaps {
    /// # Errors
    ///
    /// [`BoundaryMapError::Shells`] when the shells of a surface cannot be told apart, or the maps are not of them.
    pub fn new(domain: &SurfaceMesh, target: &SurfaceMesh, maps: Vec<ShellMap>) -> Result<Self, BoundaryMapError> {
        let refused = |problem: String| BoundaryMapError::Shells { problem };
        let of = |solid: &str, surface| shells_of(surface).map_err(|error| refused(format!("the {solid}: {error}")));
        let [(domain, domain_shells), (target, target_shells)] = [of("domain", domain)?, of("target", target)?];
        let mut is_taken = vec![false; target_shells.len()];
        if maps.len() != domain_shells.len() || maps.len() != target_shells.len() {
            let counts = format!(
                "there are {} maps for {} shells of the domain and {} of the target",
                maps.len(),
                domain_shells.len(),
                target_shells.len()
            );
            return Err(refused(counts));
        }
        for (shell, ShellMap { target: to, map }) in maps.iter().enumerate() {
            let own = map.composition().filter(|composition| composition.subdivisions() == 0);
            let surfaces = own.and_then(|own| Some([own.domain().surface(), own.target()?.surface()]));
            let wanted = target_shells
                .get(*to)
                .map(|to| [&domain_shells[shell].surface, &to.surface]);
            if surfaces.is_none() || surfaces != wanted {
                return Err(refused(format!(
                    "map {shell} is not one of shell {shell} to shell {to}"
                )));
            }
            if std::mem::replace(&mut is_taken[*to], true) {
                return Err(refused(format!("shell {to} of the target is taken twice")));
            }
            // So that solids go to solids, and cavities to cavities.
            let inside = domain_shells[shell].inside.map(|around| maps[around].target);
            if inside != target_shells[*to].inside {
                return Err(refused(format!(
                    "shell {shell} and shell {to} lie in shells that do not correspond"
                )));
            }
        }
        Ok(Self {
            maps: Arc::new(maps),
            sides: [Side::new(domain, domain_shells), Side::new(target, target_shells)].map(Arc::new),
            subdivisions: 0,
        })
    }

    /// The same shells with other maps between them, before subdivision.
    ///
    /// # Errors
    ///
    /// When these are not maps between the same surfaces.
    pub fn with_maps(&self, maps: &[BoundaryMap]) -> Result<Self, BoundaryMapError> {
        fn surfaces(map: &BoundaryMap) -> Option<[&SurfaceMesh; 2]> {
            let composition = map.composition()?;
            Some([composition.domain().surface(), composition.target()?.surface()])
        }
        let is_same =
            |(own, map): (&ShellMap, &BoundaryMap)| map.subdivisions() == 0 && surfaces(&own.map) == surfaces(map);
        if maps.len() != self.maps.len() || !self.maps.iter().zip(maps).all(is_same) {
            let problem = "the maps are not those of the same shells".into();
            return Err(BoundaryMapError::Shells { problem });
        }
        let maps = self.maps.iter().zip(maps).map(|(own, map)| ShellMap {
            target: own.target,
            map: map.clone(),
        });
        Ok(Self {
            maps: Arc::new(maps.collect()),
            sides: self.sides.clone(),
            subdivisions: 0,
        })
    }

    /// The vertices of each shell of the domain before subdivision, ascending, as those of its own surface.
    pub fn vertices(&self) -> Vec<Vec<u32>> {
        let side = &self.sides[0];
        let of_shell = |(triangles, _): &(Vec<u32>, bool)| {
            let corners = triangles.iter().flat_map(|&t| side.surface.triangles()[t as usize]);
            let mut vertices: Vec<u32> = corners.collect();
            vertices.sort_unstable();
            vertices.dedup();
            vertices
        };
        side.shells.iter().map(of_shell).collect()
    }

    pub fn maps(&self) -> &[ShellMap] {
        &self.maps
    }

    /// The domain as it was before subdivision.
    pub fn domain(&self) -> &SurfaceMesh {
        &self.sides[0].surface
    }

    pub fn target(&self) -> &SurfaceMesh {
        &self.sides[1].surface
    }

    pub fn subdivisions(&self) -> u32 {
        self.subdivisions
    }

    /// The same map over a domain whose triangles are each cut into four.
    pub fn subdivided(&self) -> Self {
        Self {
            subdivisions: self.subdivisions + 1,
            ..self.clone()
        }
    }

    /// The map back to the domain as it was before subdivision.
    pub fn inverse(&self) -> Option<Self> {
        let mut maps: Vec<Option<ShellMap>> = vec![None; self.maps.len()];
        for (shell, ShellMap { target, map }) in self.maps.iter().enumerate() {
            let map = map.inverse()?;
            maps[*target] = Some(ShellMap { target: shell, map });
        }
        let [domain, target] = self.sides.clone();
        Some(Self {
            maps: Arc::new(maps.into_iter().collect::<Option<_>>()?),
            sides: [target, domain],
            subdivisions: 0,
        })
    }

    /// For each shell its map as a composition, and its triangles in the domain.
    pub fn compositions(&self) -> impl Iterator<Item = (&Composition, &[u32])> {
        let shells = self.maps.iter().zip(&self.sides[0].shells);
        shells.filter_map(|(shell, (triangles, _))| Some((shell.map.composition()?, &triangles[..])))
    }

    /// The image on the target's surface.
    pub fn on_target(&self, point: &SurfacePoint) -> Option<SurfacePoint> {
        let (shell, point) = self.sides[0].in_shell(&before_subdivision(point, self.subdivisions));
        let ShellMap { target, map } = &self.maps[shell];
        let found = map.composition()?.on_target(&point)?;
        Some(self.sides[1].of_shell(*target, &found))
    }

    pub fn image(&self, point: &SurfacePoint) -> Point {
        let target = self.target();
        // Made of compositions with a target, all of which find one.
        self.on_target(point).map_or(Point::from([f64::NAN; 3]), |found| {
            found.position(target, target.vertices())
        })
    }
}
