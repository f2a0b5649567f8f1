//! Frames measured by one-to-one maps: the reference is filled with tetrahedra once, and over these the harmonic map of
//! every frame is repaired. The map of a frame is linear over the tetrahedra, so that sums over them are its energies.

use super::{BYTES_PER_POINT, FrameMap, FrameMeasurement, Sequence, SequenceError};
use crate::bijective::{BijectiveError, make_bijective};
use crate::boundary_map::BoundaryMap;
use crate::check::FindSelfIntersections;
use crate::energy::{EnergyError, energies, tet_quadrature};
use crate::fit::{Phase, boundary_error};
use crate::mesh::{CellMesh, TetMesh};
use crate::remesh::{RemeshError, RemeshOptions, RemeshPhase, given_mesh};

/// Points of a tetrahedron's quadrature.
const POINTS: u64 = 4;
/// Bytes that a frame keeps for each tetrahedron besides those of its points: two meshes, and a tree over each.
const BYTES_PER_TET: u64 = 400;

/// The reference of a [`Sequence`] filled with tetrahedra, and how maps over them are repaired.
pub struct FilledReference<'a> {
    mesh: TetMesh,
    options: RemeshOptions,
    find: Option<FindSelfIntersections<'a>>,
}

/// The current step of [`Sequence::measure_bijective`], for showing progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SequencePhase {
    /// The harmonic maps of all frames are fitted.
    Fit(Phase),
    /// The map of a frame is repaired.
    Repair {
        /// Index of the frame among those that are measured together.
        frame: usize,
        /// The step of its repair.
        phase: RemeshPhase,
    },
}

impl<'a> FilledReference<'a> {
    /// Takes a mesh of [`Sequence::domain`]. `find` finds self-intersections of a frame's surface, as CGAL does in builds
    /// with the feature `native`; without, frames that pass through themselves are not refused.
    ///
    /// # Errors
    ///
    /// [`SequenceError::Bijective`] for a mesh that is not one of the domain.
    pub fn new(
        sequence: &Sequence,
        mesh: TetMesh,
        options: RemeshOptions,
        find: Option<FindSelfIntersections<'a>>,
    ) -> Result<Self, SequenceError> {
        // Found out once, and not for every frame.
        given_mesh(CellMesh::from(mesh.clone()), sequence.domain())
            .map_err(|error| Box::new(BijectiveError::from(RemeshError::from(error))))?;
        Ok(Self { mesh, options, find })
    }

    /// The mesh.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }
}

/// Refuses a frame that passes through itself: it has no one-to-one map, and a repair would take long to find none. Where
/// that cannot be looked for, the map's own boundary is examined.
fn require_no_intersection(frame: &BoundaryMap, find: Option<FindSelfIntersections>) -> Result<(), BijectiveError> {
    let found = find.and_then(|find| find(&frame.outward_target()).ok());
    let pairs = found.unwrap_or_default();
    pairs.first().map_or(Ok(()), |[a, b]| {
        let count = pairs.len();
        let problem = format!("{count} pairs of triangles intersect, the first {a} and {b}");
        Err(BijectiveError::Boundary { problem })
    })
}

impl Sequence {
    /// As [`Sequence::measure`], by maps that are one to one: the harmonic map of each frame is carried to the tetrahedra
    /// of the reference and repaired ([`make_bijective`]), so that nothing is folded. Energies are sums over tetrahedra,
    /// without errors of integration. They are larger than those of the harmonic maps, the more the coarser the mesh is.
    ///
    /// A frame for which no such map is found, a mirror image among them, has [`SequenceError::Bijective`].
    ///
    /// Memory grows with the number of frames: see [`Self::frames_per_block_of`].
    pub fn measure_bijective(
        &mut self,
        filled: &FilledReference,
        frames: &[BoundaryMap],
        progress: &dyn Fn(SequencePhase),
    ) -> Vec<Result<FrameMeasurement, SequenceError>> {
        let solved = self.solve(frames, &|phase| progress(SequencePhase::Fit(phase)));
        let solved = solved.into_iter().zip(frames).enumerate();
        let measured = solved.map(|(frame, (solved, boundary))| {
            let (harmonic, _) = solved?;
            let show = |phase| progress(SequencePhase::Repair { frame, phase });
            require_no_intersection(boundary, filled.find).map_err(Box::new)?;
            let (mesh, options) = (filled.mesh.clone(), &filled.options);
            let made = make_bijective(boundary, &harmonic, mesh, options, filled.find, &show);
            let made = made.map_err(Box::new)?;
            let fit = &self.options.fit;
            let error = boundary_error(&made.map, boundary, fit.held_out, fit.seed)?;
            let quadrature = tet_quadrature(made.map.domain()).map_err(EnergyError::from)?;
            let (own, volume) = (quadrature.volume(), boundary.target_volume());
            let energy = energies(&made.map, &quadrature, own, volume, &self.energy_options())?;
            self.measured(FrameMap::Bijective(Box::new(made)), error, volume, (quadrature, energy))
        });
        measured.collect()
    }

    /// [`Self::frames_per_block`] for [`Self::measure_bijective`].
    pub fn frames_per_block_of(&self, filled: &FilledReference) -> usize {
        let tets = filled.mesh.tets().len() as u64;
        self.frames_that_fit(tets.saturating_mul(POINTS * BYTES_PER_POINT + BYTES_PER_TET))
    }
}
