//! A solid, its shells, and which of them hold which others.

use crate::boundary_map::pair::PairError;
use crate::check::shells_of;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;
use crate::spherical::{SphericalError, genus};
use crate::{Point, Vector};

/// A shell, and what is compared to find its partner.
pub(super) struct Shell {
    pub surface: SurfaceMesh,
    /// The solid's number of each of its vertices, ascending.
    pub vertices: Vec<u32>,
    /// The shell that holds it; `None` for an outermost one.
    pub around: Option<usize>,
    pub is_cavity: bool,
    pub genus: u64,
    /// Genus, and the same of the shells inside.
    pub signature: String,
    /// The shells inside, not those inside of them.
    pub inside: Vec<usize>,
    pub centre: Point,
    /// Cube root of the volume.
    pub size: f64,
}

/// A solid and its shells.
pub(super) struct Solid {
    pub surface: SurfaceMesh,
    pub shells: Vec<Shell>,
    pub outermost: Vec<usize>,
    /// Cube root of the volume of all outermost shells.
    pub size: f64,
}

impl Solid {
    pub fn of(side: &'static str, surface: &SurfaceMesh) -> Result<Self, PairError> {
        let of_side = |error| PairError::Sphere { side, error };
        match genus(surface) {
            Ok(_) | Err(SphericalError::Components { components: 2.. }) => {}
            Err(error) => return Err(of_side(error)),
        }
        let (surface, shells) = shells_of(surface).map_err(|error| PairError::Shells { side, error })?;
        let inside_of = |around: Option<usize>| {
            let shells = shells.iter().enumerate();
            shells
                .filter(|(_, shell)| shell.inside == around)
                .map(|(k, _)| k)
                .collect()
        };
        let outermost: Vec<usize> = inside_of(None);
        let inside: Vec<Vec<usize>> = (0..shells.len()).map(|shell| inside_of(Some(shell))).collect();
        let genera = shells.iter().map(|shell| genus(&shell.surface));
        let genera: Result<Vec<u64>, _> = genera.collect();
        let genera = genera.map_err(of_side)?;
        let unreferenced = Topology::new(&surface).unreferenced_vertices();
        if let Some(&first) = unreferenced.first() {
            let count = unreferenced.len();
            return Err(of_side(SphericalError::Unreferenced { count, first }));
        }
        let volume: f64 = outermost.iter().map(|&k| shells[k].surface.volume()).sum();
        let shells = shells.into_iter().enumerate().map(|(k, shell)| Shell {
            genus: genera[k],
            signature: signature(k, &genera, &inside),
            inside: inside[k].clone(),
            centre: centre_of(&shell.surface),
            size: shell.surface.volume().cbrt(),
            around: shell.inside,
            is_cavity: shell.is_cavity,
            vertices: shell.vertices,
            surface: shell.surface,
        });
        Ok(Self {
            surface,
            shells: shells.collect(),
            outermost,
            size: volume.cbrt(),
        })
    }

    /// The shell that has all these vertices.
    pub fn shell_of_all(&self, path: &[u32]) -> Option<usize> {
        let shell = self.shell_of(*path.first()?)?;
        path.iter().all(|&v| self.shell_of(v) == Some(shell)).then_some(shell)
    }

    pub fn shell_of(&self, vertex: u32) -> Option<usize> {
        let holds = |shell: &Shell| shell.vertices.binary_search(&vertex).is_ok();
        self.shells.iter().position(holds)
    }
}

fn signature(shell: usize, genera: &[u64], inside: &[Vec<usize>]) -> String {
    let mut of_inner: Vec<String> = inside[shell].iter().map(|&k| signature(k, genera, inside)).collect();
    of_inner.sort();
    format!("{}({})", genera[shell], of_inner.concat())
}

/// Centre of mass of the surface.
pub(super) fn centre_of(surface: &SurfaceMesh) -> Point {
    let (mut sum, mut total) = (Vector::zeros(), 0.0);
    for t in 0..surface.triangles().len() {
        let area = surface.area_vector(t).norm();
        sum += surface.corners(t).iter().map(|p| p.coords).sum::<Vector>() * (area / 3.0);
        total += area;
    }
    Point::from(sum / total)
}
