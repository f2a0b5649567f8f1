//! A boundary map of a whole solid to start from, shell by shell.

use super::super::PairError;
use super::Solid;
use super::solid::centre_of;
use crate::Point;
use crate::boundary_map::BoundaryMap;

/// The parts of a boundary map.
pub(super) struct ShellStarts {
    /// The part that starts each shell of the domain.
    pub maps: Vec<BoundaryMap>,
    /// Centres of their images.
    pub centres: Vec<Point>,
    /// The shell of the target that each goes to, where it is a map between the shells of these solids.
    targets: Option<Vec<usize>>,
}

impl ShellStarts {
    /// # Errors
    ///
    /// When the images of a shell have no extent.
    pub fn new(start: &BoundaryMap, [domain, target]: &[Solid; 2]) -> Result<Self, PairError> {
        let is_same_target = start.target_surface() == Some(&target.surface);
        let own = start.shells().filter(|own| own.len() == domain.shells.len());
        let (mut maps, mut centres) = (Vec::new(), Vec::new());
        for (k, shell) in domain.shells.iter().enumerate() {
            let images = shell.vertices.iter().map(|&v| start.image()[v as usize]);
            let own = own.map(|own| &own[k].map).filter(|own| *own.domain() == shell.surface);
            let map = match own {
                Some(own) => own.clone(),
                None => BoundaryMap::new(shell.surface.clone(), images.collect())?,
            };
            centres.push(centre_of(&map.target()));
            maps.push(map);
        }
        Ok(Self {
            maps,
            centres,
            targets: own
                .filter(|_| is_same_target)
                .map(|own| own.iter().map(|shell| shell.target).collect()),
        })
    }

    /// Whether it takes a shell of the domain to another one of the target.
    pub fn contradict(&self, from: usize, to: usize) -> bool {
        self.targets.as_ref().is_some_and(|targets| targets[from] != to)
    }
}
