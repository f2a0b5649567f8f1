//! A boundary map to look at: one pattern on the domain and on its image, and where it distorts.

use solidmap::boundary_map::check::{Against, BoundaryCheck};
use solidmap::boundary_map::{BoundaryMap, TriangleDistortion, triangle_distortions};
use solidmap::check::mend;
use solidmap::mesh::SurfaceMesh;
use solidmap::report::{
    Axis, Camera, Checker, ColourBar, Figure, Panel, Pattern, Scale, SurfaceColour, SurfaceStyle, ValueRange,
};
use solidmap::statistics::weighted_quantiles;
use solidmap::{Point, Vector};

/// Width and height of a view.
const PIXELS: [usize; 2] = [560, 520];

/// Cells of the pattern along the longest side of the domain, or from pole to pole.
const CELLS: usize = 16;

/// The domain and its image side by side, from the front and from behind, painted with one chequered field, and with
/// how far areas and angles are distorted.
pub fn boundary(map: &BoundaryMap, check: &BoundaryCheck, up: Axis) -> anyhow::Result<Figure> {
    let domain = mend(map.domain()).0;
    let placed = SurfaceMesh::new(map.image().to_vec(), domain.triangles().to_vec())?;
    // A map that mirrors would show the inside of its image.
    let image = if placed.volume() < 0.0 {
        placed.reversed()
    } else {
        placed
    };
    let [front, back] = [30.0, 210.0].map(|azimuth| Camera {
        azimuth,
        elevation: 20.0,
        up,
    });
    let surfaces = Surfaces {
        domain: &domain,
        image: &image,
        name: match check.against {
            Against::Sphere { .. } => "Sphere",
            _ => "Image",
        },
    };
    let painted = SurfaceColour::Checker(checker(&domain, map.image(), check.against, up));
    let mut top = surfaces.views(&painted, &front, "")?;
    top.extend(surfaces.views(&painted, &back, ", from behind")?);
    let mut rows = vec![top];
    if let Some(distortions) = triangle_distortions(&domain, map.image()) {
        let areas: Vec<f64> = (0..domain.triangles().len())
            .map(|t| domain.area_vector(t).norm())
            .collect();
        let values = |of: fn(&TriangleDistortion) -> f64| -> Vec<f64> {
            distortions.iter().map(|d| d.as_ref().map_or(f64::NAN, of)).collect()
        };
        let ratio = values(TriangleDistortion::area_ratio);
        let most = bound(ratio.iter().map(|r| r.max(1.0 / r)), &areas);
        let area = ColourBar::new(
            "ratio of areas, 1 is the mean",
            ratio.iter().copied(),
            ValueRange::Fixed(1.0 / most, most),
            Scale::Log,
        )?;
        let stretch = values(TriangleDistortion::angle);
        let most = bound(stretch.iter().copied(), &areas);
        let angle = ColourBar::new(
            "σ₁/σ₂, 1 where angles are kept",
            stretch.iter().copied(),
            ValueRange::Fixed(1.0, most),
            Scale::Log,
        )?;
        let mut bottom = surfaces.measured(ratio, area, &front, "area")?;
        bottom.extend(surfaces.measured(stretch, angle, &front, "angle")?);
        rows.push(bottom);
    }
    Ok(Figure::grid(rows))
}

/// On a sphere its own longitudes and latitudes, else cubes around the domain.
fn checker(domain: &SurfaceMesh, image: &[Point], against: Against, up: Axis) -> Checker {
    match against {
        Against::Sphere { centre, .. } => Checker {
            places: image.iter().map(|p| Point::from(p - Point::from(centre))).collect(),
            pattern: Pattern::Graticule { pole: up, cells: CELLS },
        },
        Against::Target | Against::Itself => {
            let (low, high) = domain
                .bounding_box()
                .unwrap_or((Point::origin(), Point::from(Vector::repeat(1.0))));
            Checker {
                places: domain.vertices().to_vec(),
                pattern: Pattern::Cubes {
                    low,
                    high,
                    cells: CELLS,
                },
            }
        }
    }
}

/// What 99 % of the area do not exceed, within what colours can tell apart.
fn bound(values: impl Iterator<Item = f64>, areas: &[f64]) -> f64 {
    let values: Vec<f64> = values.collect();
    weighted_quantiles(&values, areas, [0.99]).map_or(1.05, |[most]| most.clamp(1.05, 1e3))
}

struct Surfaces<'a> {
    domain: &'a SurfaceMesh,
    image: &'a SurfaceMesh,
    name: &'static str,
}

impl Surfaces<'_> {
    fn views(&self, colour: &SurfaceColour, camera: &Camera, suffix: &str) -> anyhow::Result<Vec<Panel>> {
        let style = SurfaceStyle {
            colour: colour.clone(),
            ..SurfaceStyle::default()
        };
        let view = |surface, name| -> anyhow::Result<Panel> {
            Ok(Panel::of_surface(surface, &style, camera, PIXELS)?.titled(format!("{name}{suffix}")))
        };
        Ok(vec![view(self.domain, "Domain")?, view(self.image, self.name)?])
    }

    fn measured(&self, values: Vec<f64>, bar: ColourBar, camera: &Camera, what: &str) -> anyhow::Result<Vec<Panel>> {
        let colour = SurfaceColour::PerTriangle(values, bar.clone());
        let mut panels = self.views(&colour, camera, &format!(", distortion of {what}"))?;
        let last = panels.pop().map(|panel| panel.with_bar(&bar));
        panels.extend(last);
        Ok(panels)
    }
}
