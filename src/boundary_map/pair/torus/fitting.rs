//! The torus of revolution that keeps angles best where a solid with one handle is mapped to it.

use crate::mesh::{SurfaceMesh, shapes};
use crate::toroidal::{Periods, ToroidalError, TorusSurface};

/// A torus of revolution whose flat torus is as long, against its width, as that of a solid.
///
/// The flat torus of a surface is the parallelogram with glued sides to which the surface maps without distortion of angles. That of
/// a torus of revolution is a rectangle, √(ρ² − 1) times as long around the handle as around the tube, where ρ is the ratio of
/// its radii. So a solid has its angles kept best by the ratio √(1 + h²), where h is the height of its parallelogram over the side
/// that bounds a disk in the solid; that the parallelogram leans is a shear that no torus of revolution takes away.
#[derive(Debug, Clone, PartialEq)]
pub struct FittingTorus {
    /// The torus about the z axis, its centre at the origin, with the volume of the solid.
    pub surface: SurfaceMesh,
    /// Radius of the circle around which the tube runs.
    pub major: f64,
    /// Radius of the tube.
    pub minor: f64,
    /// The period of a loop around the handle over that of one that bounds a disk, as a complex number: how far the parallelogram
    /// leans, by half of its width at most, and its height. Known as far as the surface was laid out without distortion of angles.
    pub modulus: [f64; 2],
}

/// Fewest and most vertices of the torus, which has about as many as the solid between.
const VERTICES: [usize; 2] = [1000, 20_000];
/// The least ratio of the radii, below which the hole is closed but for slivers, and fewest vertices around the tube or along it.
const LEAST_RATIO: f64 = 1.05;
const FEWEST: usize = 12;

/// The torus for a solid of genus 1. Takes as long as the search of [`map_pair`](crate::boundary_map::pair::map_pair) takes to lay out
/// a surface: a second for 10 000 vertices.
///
/// # Errors
///
/// As of [`ToroidalError`]: when the solid has another genus, passes through itself, or has a knotted hole.
pub fn fitting_torus(solid: &SurfaceMesh) -> Result<FittingTorus, ToroidalError> {
    let torus = TorusSurface::new(solid)?;
    let (_, layout) = torus.layouts(usize::MAX)?;
    let embedding = torus.embedded(&layout)?;
    torus.require_unknotted(&embedding)?;
    let (periods, _) = Periods::of_embedding(&embedding).upright();
    let modulus = periods.modulus();
    let ratio = (1.0 + modulus[1].powi(2)).sqrt().max(LEAST_RATIO);
    // 2π² ρ r³ is the volume.
    let volume = torus.surface().volume();
    let minor = (volume / (2.0 * std::f64::consts::PI.powi(2) * ratio)).cbrt();
    let vertices = solid.vertices().len().clamp(VERTICES[0], VERTICES[1]) as f64;
    let across = ((vertices / ratio).sqrt().round() as usize).max(FEWEST);
    let around = ((vertices / across as f64).round() as usize).max(FEWEST);
    Ok(FittingTorus {
        surface: shapes::torus(ratio * minor, minor, around, across),
        major: ratio * minor,
        minor,
        modulus,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;
    use crate::boundary_map::pair::{PairOptions, map_pair};
    use crate::mesh::shapes::deformed;

    #[test]
    fn a_torus_of_revolution_fits_itself_wherever_it_lies() {
        for ratio in [1.4, 2.5, 6.0] {
            let torus = shapes::torus(ratio, 1.0, 80, 40);
            let turned = deformed(&torus, |p| Point::new(3.0 + 5.0 * p.z, 5.0 * p.x, 5.0 * p.y));
            let found = [&torus, &turned].map(|solid| fitting_torus(solid).unwrap());
            for (fitting, size) in found.iter().zip([1.0, 5.0]) {
                // The layout bounds the distortion of areas, too, at the cost of some of angles.
                assert!(
                    (fitting.major / fitting.minor / ratio - 1.0).abs() < 0.05,
                    "{ratio}: {fitting:?}"
                );
                assert!((fitting.minor / size - 1.0).abs() < 0.05, "{ratio}");
                assert!(fitting.modulus[0].abs() < 0.02, "{ratio}");
                let volume = fitting.surface.volume() / (size.powi(3) * torus.volume());
                assert!((volume - 1.0).abs() < 0.02, "{volume}");
            }
        }
    }

    #[test]
    fn the_map_to_it_is_one_to_one_and_distorts_less_than_that_to_another_ring() {
        let solid = deformed(&shapes::torus(1.6, 1.0, 48, 32), |p| {
            Point::new(p.x + 0.2 * p.y * p.y, 1.3 * p.y, p.z + 0.2 * p.x)
        });
        let fitting = fitting_torus(&solid).unwrap();
        let thin = shapes::torus(5.0, 0.5, 80, 16);
        let [near, far] = [&fitting.surface, &thin].map(|target| {
            let (map, report) = map_pair(&solid, target, &PairOptions::default(), &|_| ()).unwrap();
            assert!(map.is_linear() || map.composition().is_some());
            report.after.symmetric_dirichlet.p50
        });
        assert!(near < 5.0 && near < 0.7 * far, "{near} {far}");
    }

    #[test]
    fn other_solids_are_refused() {
        let error = fitting_torus(&shapes::sphere(1.0, 2)).unwrap_err();
        assert!(matches!(error, ToroidalError::Genus { genus: 0 }), "{error}");
    }
}
