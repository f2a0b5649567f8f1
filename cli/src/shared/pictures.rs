//! Pictures of plane sections.

use anyhow::ensure;
use solidmap::energy::{EnergyOptions, densities};
use solidmap::geometry::{Axis, AxisPlane, PlaneSection, distance_field};
use solidmap::map::VolumeMap;
use solidmap::mesh::SurfaceMesh;

use crate::args::{ColoursKind, SectionArgs, UpKind};
use crate::drawing::{ColourBar, Colours, Panel, Scale, ValueRange};

/// Refuses a position of a section outside 0 to 1.
pub fn require_position(position: f64) -> anyhow::Result<()> {
    ensure!(
        (0.0..=1.0).contains(&position),
        "--position is {position}, but must be from 0 to 1"
    );
    Ok(())
}

/// The plane across an axis at a position from 0 to 1 along a solid's box.
pub fn plane_across(axis: Axis, position: f64, solid: &SurfaceMesh) -> AxisPlane {
    let (low, high) = solid.bounding_box().unwrap_or_default();
    let (low, high) = (low[axis.index()], high[axis.index()]);
    let position = low + position * (high - low);
    AxisPlane { axis, position }
}

/// The cross-section of a solid that was asked for; where no axis was named, the largest of those across each axis.
pub fn largest_section(asked: &SectionArgs, domain: &SurfaceMesh, pixels: usize) -> anyhow::Result<PlaneSection> {
    let up = Axis::from(asked.up);
    let across = |axis| PlaneSection::new(domain, plane_across(axis, asked.position(), domain), up, pixels);
    if let Some(axis) = asked.axis {
        return Ok(across(Axis::from(axis))?);
    }
    // `max_by` takes the last of equal sections: z before y before x.
    let sections = [Axis::X, Axis::Y].map(across).into_iter().flatten();
    let last = across(Axis::Z);
    let largest = sections
        .chain(last.iter().cloned())
        .max_by(|a, b| a.area().total_cmp(&b.area()));
    Ok(largest.map_or(last, Ok)?)
}

impl SectionArgs {
    /// Refuses a position outside 0 to 1.
    pub fn require_valid(&self) -> anyhow::Result<()> {
        require_position(self.position())
    }

    /// The colours of amounts.
    pub fn colours(&self) -> Colours {
        match self.colours {
            ColoursKind::Viridis => Colours::Amount,
            ColoursKind::Rainbow => Colours::Rainbow,
        }
    }

    /// The plane through a solid.
    pub fn plane(&self, solid: &SurfaceMesh) -> AxisPlane {
        plane_across(self.axis.map_or(Axis::Z, Axis::from), self.position(), solid)
    }
}

/// Name of the distance field's colour bar.
const DISTANCE: &str = "distance from the boundary";

/// A map between two solids, to be pictured.
pub struct Pictured<'a> {
    /// The map.
    pub map: &'a dyn VolumeMap,
    /// Boundary of its domain.
    pub domain: &'a SurfaceMesh,
    /// Boundary of its target.
    pub target: &'a SurfaceMesh,
    /// How energies are measured.
    pub options: EnergyOptions,
    /// What points up in pictures.
    pub up: UpKind,
    /// The colours of what is pictured.
    pub colours: Colours,
}

impl Pictured<'_> {
    /// Harmonic energy density, deformation energy density, and the target's distance field pulled back by the map, on
    /// a cross-section of the domain: figures 2 (c)–(e) and 7 (d) of the paper.
    pub fn section(&self, plane: AxisPlane, pixels: usize) -> anyhow::Result<Vec<Panel>> {
        let section = PlaneSection::new(self.domain, plane, self.up.into(), pixels)?;
        let volumes = [self.domain.volume(), self.target.volume()];
        let densities = densities(self.map, section.points(), volumes[0], volumes[1], &self.options)?;
        // A few points at creases have densities far above all others; the colour bar says that it clamps them.
        let most = ValueRange::Quantiles(0.0, 0.99);
        let distances = distance_field(self.target, &self.map.evaluate(section.points()))?;
        let from_zero = from_zero(&distances);
        let fields = [
            (["harmonic energy density", "‖J‖²"], densities.harmonic, most),
            (["deformation energy density", "½ σ:ε"], densities.deformation, most),
            (["target's distance field, transferred", DISTANCE], distances, from_zero),
        ];
        fields
            .iter()
            .map(|(name, values, range)| {
                Ok(self
                    .panel(&section, *name, values, *range)?
                    .turned_if(self.up.is_upside_down()))
            })
            .collect()
    }

    /// The target's own distance field on a cross-section of the target.
    pub fn target_section(&self, plane: AxisPlane, pixels: usize) -> anyhow::Result<Panel> {
        let section = PlaneSection::new(self.target, plane, self.up.into(), pixels)?;
        let distances = distance_field(self.target, section.points())?;
        let range = from_zero(&distances);
        let panel = self.panel(&section, ["distance field of the target", DISTANCE], &distances, range)?;
        Ok(panel.turned_if(self.up.is_upside_down()))
    }

    fn panel(
        &self,
        section: &PlaneSection,
        [name, label]: [&str; 2],
        values: &[f64],
        range: ValueRange,
    ) -> anyhow::Result<Panel> {
        let bar = ColourBar::new(label, values.iter().copied(), range, Scale::Linear)?.in_colours(self.colours);
        Ok(Panel::of_section(section, values, &bar)?.titled(name).with_bar(&bar))
    }
}

/// Fields by their names on one section, with a common colour bar, at the last. `asked` says what points up, and the colours.
pub fn panels_with_one_bar(
    (section, asked): (&PlaneSection, &SectionArgs),
    fields: &[(String, Vec<f64>)],
    label: &str,
    range: ValueRange,
    scale: Scale,
) -> anyhow::Result<Vec<Panel>> {
    let all = fields.iter().flat_map(|(_, values)| values.iter().copied());
    let bar = ColourBar::new(label, all, range, scale)?.in_colours(asked.colours());
    let panel = |(k, (name, values)): (usize, &(String, Vec<f64>))| {
        let panel = Panel::of_section(section, values, &bar)?;
        let panel = panel.turned_if(asked.up.is_upside_down()).titled(name);
        Ok(if k + 1 == fields.len() {
            panel.with_bar(&bar)
        } else {
            panel
        })
    };
    fields.iter().enumerate().map(panel).collect()
}

/// From 0, the value at the boundary: points that the boundary error puts outside are below, and clamped.
fn from_zero(distances: &[f64]) -> ValueRange {
    ValueRange::Fixed(0.0, distances.iter().copied().fold(0.0, f64::max).max(f64::EPSILON))
}
