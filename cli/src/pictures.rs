//! The pictures that commands share.

use crate::drawing::{Axis, ColourBar, Panel, Plane, Scale, Section, ValueRange};
use anyhow::ensure;
use solidmap::energy::{EnergyOptions, deformation_density, harmonic_density};
use solidmap::geometry::SurfaceQuery;
use solidmap::map::VolumeMap;
use solidmap::mesh::SurfaceMesh;
use solidmap::{Matrix3, Point};

use super::args::SectionArgs;

impl SectionArgs {
    /// Refuses a place that is none.
    pub fn require_valid(&self) -> anyhow::Result<()> {
        ensure!(
            (0.0..=1.0).contains(&self.position),
            "--position is {}, but must be from 0 to 1",
            self.position
        );
        Ok(())
    }

    /// The plane through a domain.
    pub fn plane(&self, domain: &SurfaceMesh) -> Plane {
        self.plane_across(self.axis.map_or(Axis::Z, Axis::from), domain)
    }

    /// The plane through a domain across this axis.
    pub fn plane_across(&self, axis: Axis, domain: &SurfaceMesh) -> Plane {
        let (low, high) = domain.bounding_box().unwrap_or_default();
        let (low, high) = (low[axis.index()], high[axis.index()]);
        let position = low + self.position * (high - low);
        Plane { axis, position }
    }
}

const DISTANCE: &str = "distance from the boundary";

/// A map between two solids, as pictures need it.
pub struct Pictured<'a> {
    /// The map.
    pub map: &'a dyn VolumeMap,
    /// Boundary of its domain.
    pub domain: &'a SurfaceMesh,
    /// Boundary of its target.
    pub target: &'a SurfaceMesh,
    /// How energies are measured.
    pub options: EnergyOptions,
    /// The axis that points up in pictures.
    pub up: Axis,
}

impl Pictured<'_> {
    /// Harmonic energy density, deformation energy density, and the target's distance field seen through the map, on a
    /// cross-section of the domain: figures 2 (c)–(e) and 7 (d) of the paper.
    pub fn section(&self, plane: Plane, pixels: usize) -> anyhow::Result<Vec<Panel>> {
        let section = Section::with_up(self.domain, plane, self.up, pixels)?;
        let scale = self.jacobian_scale();
        let jacobians: Vec<Matrix3> = self.map.jacobian(section.points()).iter().map(|j| j * scale).collect();
        let lame = self.options.lame;
        // A few points at creases have densities far above all others; the bar says that it clamps.
        let most = ValueRange::Quantiles(0.0, 0.99);
        let energies = [
            (
                ["harmonic energy density", "‖J‖²"],
                jacobians.iter().map(harmonic_density).collect::<Vec<_>>(),
            ),
            (
                ["deformation energy density", "½ σ:ε"],
                jacobians.iter().map(|j| deformation_density(j, &lame)).collect(),
            ),
        ];
        let mut panels = Vec::new();
        for (name, values) in energies {
            panels.push(panel(&section, name, &values, most)?);
        }
        let depth = depths(self.target, &self.map.evaluate(section.points()))?;
        panels.push(panel(
            &section,
            ["target's distance field, transferred", DISTANCE],
            &depth,
            from_zero(&depth),
        )?);
        Ok(panels)
    }

    /// The target's own distance field on a cross-section of the target.
    pub fn target_section(&self, plane: Plane, pixels: usize) -> anyhow::Result<Panel> {
        let section = Section::with_up(self.target, plane, self.up, pixels)?;
        let depth = depths(self.target, section.points())?;
        panel(
            &section,
            ["distance field of the target", DISTANCE],
            &depth,
            from_zero(&depth),
        )
    }

    fn jacobian_scale(&self) -> f64 {
        if self.options.normalize {
            (self.domain.volume() / self.target.volume()).abs().cbrt()
        } else {
            1.0
        }
    }
}

/// Distance of each point from the boundary, negative outside.
pub fn depths(surface: &SurfaceMesh, points: &[Point]) -> anyhow::Result<Vec<f64>> {
    // A target may overlap itself where its boundary map folds; the winding number keeps the sign right there.
    let query = SurfaceQuery::with_winding_sign(surface)?;
    Ok(query.signed_distances(points).into_iter().map(|d| -d).collect())
}

/// Blue is the boundary; the boundary error puts some points a little outside of it.
fn from_zero(depth: &[f64]) -> ValueRange {
    ValueRange::Fixed(0.0, depth.iter().copied().fold(0.0, f64::max).max(f64::EPSILON))
}

fn panel(section: &Section, [name, label]: [&str; 2], values: &[f64], range: ValueRange) -> anyhow::Result<Panel> {
    let bar = ColourBar::new(label, values.iter().copied(), range, Scale::Linear)?;
    Ok(Panel::of_section(section, values, &bar)?.titled(name).with_bar(&bar))
}
