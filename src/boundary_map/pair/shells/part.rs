//! The landmarks, curves and loops of a pair of shells, out of those of the whole solids, in vertex numbers of the shells; and errors about
//! them, back in numbers of the solids.

use super::solid::Shell;
use crate::boundary_map::pair::{
    CurveError, LandmarkCurve, LandmarkError, Landmarks, LoopError, PairError, PairOptions,
};

/// A pair of shells, with what is given on both of them, and the places of that among all that is given.
pub(super) struct ShellPart<'a> {
    shells: [&'a Shell; 2],
    landmarks: Vec<(usize, [u32; 2])>,
    curves: Vec<(usize, LandmarkCurve)>,
    loops: Vec<(usize, LandmarkCurve)>,
}

impl<'a> ShellPart<'a> {
    /// Takes what lies on both shells out of the landmarks, curves and loops of the whole solids.
    pub fn new(shells: [&'a Shell; 2], given: &PairOptions) -> Self {
        let [from, to] = shells;
        let own = |shell: &Shell, v: u32| shell.vertices.binary_search(&v).ok().map(|own| own as u32);
        let path = |shell: &Shell, path: &[u32]| path.iter().map(|&v| own(shell, v)).collect::<Option<Vec<u32>>>();
        let own_pair = |&[v, w]: &[u32; 2]| Some([own(from, v)?, own(to, w)?]);
        let own_curve = |curve: &LandmarkCurve| {
            Some(LandmarkCurve {
                domain: path(from, &curve.domain)?,
                target: path(to, &curve.target)?,
            })
        };
        Self {
            shells,
            landmarks: placed(given.landmarks.pairs(), own_pair),
            curves: placed(&given.curves, own_curve),
            loops: placed(&given.loops, own_curve),
        }
    }

    /// The landmarks of the shells.
    ///
    /// # Errors
    ///
    /// As [`Landmarks::new`].
    pub fn landmarks(&self) -> Result<Landmarks, LandmarkError> {
        let pairs = self.landmarks.iter().map(|landmark| landmark.1).collect();
        let [from, to] = self.shells.map(|shell| shell.vertices.len());
        Landmarks::new(pairs, from, to)
    }

    /// The landmark curves of the shells.
    pub fn curves(&self) -> Vec<LandmarkCurve> {
        self.curves.iter().map(|curve| curve.1.clone()).collect()
    }

    /// The loops of the shells.
    pub fn loops(&self) -> Vec<LandmarkCurve> {
        self.loops.iter().map(|one| one.1.clone()).collect()
    }

    /// An error of mapping the shells, by the numbers that landmarks, curves, loops and vertices have in the solids.
    pub fn in_numbers_of_solids(&self, error: PairError) -> PairError {
        match error {
            PairError::LandmarksMissed {
                landmarks,
                missed,
                first: [v, w],
            } => PairError::LandmarksMissed {
                landmarks,
                missed: missed.iter().map(|&k| place(&self.landmarks, k)).collect(),
                first: [self.shells[0].vertices[v as usize], self.shells[1].vertices[w as usize]],
            },
            PairError::Curves(error) => PairError::Curves(of_path(error, &self.curves)),
            PairError::Loops(error) => PairError::Loops(match error {
                LoopError::Path(error) => LoopError::Path(of_path(error, &self.loops)),
                LoopError::NoHandle { index, side } => LoopError::NoHandle {
                    index: place(&self.loops, index),
                    side,
                },
                LoopError::Bounds { index, side } => LoopError::Bounds {
                    index: place(&self.loops, index),
                    side,
                },
                other => other,
            }),
            other => other,
        }
    }
}

/// What is on the shells, with its place among all.
fn placed<T>(all: &[T], own: impl Fn(&T) -> Option<T>) -> Vec<(usize, T)> {
    let placed = all.iter().enumerate().map(|(k, one)| Some((k, own(one)?)));
    placed.flatten().collect()
}

fn place<T>(of_shells: &[(usize, T)], own: usize) -> usize {
    of_shells.get(own).map_or(own, |one| one.0)
}

/// The error with the curve's number in the file. Curves with vertices out of range lie on no shell, and are refused before.
fn of_path(error: CurveError, curves: &[(usize, LandmarkCurve)]) -> CurveError {
    match error {
        CurveError::NoLength { curve, side } => CurveError::NoLength {
            curve: place(curves, curve),
            side,
        },
        out_of_range => out_of_range,
    }
}
