//! Pictures of boundary maps: one pattern on the domain and on its image, and where the map distorts.

use crate::drawing::{
    Camera, Checker, ColourBar, Colours, Figure, Panel, Pattern, PlaneDrawing, Scale, SurfaceColour, SurfaceStyle,
    ValueRange,
};
use solidmap::boundary_map::check::{BoundaryCheck, ComparedWith};
use solidmap::boundary_map::{BoundaryMap, FundamentalDomain, TriangleDistortion, triangle_distortions};
use solidmap::check::repair;
use solidmap::mesh::SurfaceMesh;
use solidmap::spherical::SphericalEmbedding;
use solidmap::statistics::weighted_quantiles;
use solidmap::{Point, Vector};

use crate::args::UpKind;

/// Width and height of a view.
const PIXELS: [usize; 2] = [560, 520];

/// Cells of the pattern along the longest side of the domain, or from pole to pole.
const CELLS: usize = 16;

/// Surfaces are subdivided up to this many triangles, so that the map is drawn between vertices too.
const TRIANGLES: usize = 100_000;

/// A surface to show, with what it is coloured by.
struct Shown {
    name: &'static str,
    mesh: SurfaceMesh,
    /// Where each vertex is in the pattern.
    places: Vec<Point>,
    distortion: Option<ShownDistortion>,
}

/// Distortion of the map, per triangle of a surface.
struct ShownDistortion {
    area: Vec<f64>,
    angle: Vec<f64>,
}

/// The domain and its image side by side, from the front and from behind, with one chequered pattern, and coloured by
/// the distortion of areas and angles. For a composition of spherical embeddings the target itself is shown, painted by
/// the inverse map, and below it the sphere.
/// `ups` point up in pictures of the domain and of the target.
pub fn boundary(map: &BoundaryMap, check: &BoundaryCheck, ups: [UpKind; 2]) -> anyhow::Result<Figure> {
    // For each of the two solids, from the front and from behind.
    let cameras = ups.map(cameras);
    let pair = match (map.inverse(), map.domain_embedding()) {
        (Some(back), _) => composed(map, back),
        (None, Some(_)) => onto_sphere(map),
        (None, None) => straight(map, check.compared_with)?,
    };
    let pattern = match check.compared_with {
        ComparedWith::Sphere { .. } => Pattern::Graticule {
            pole: ups[0].into(),
            cells: CELLS,
        },
        ComparedWith::Target | ComparedWith::Itself => cubes(&pair[0].mesh),
    };
    let mut top = vec![];
    for (side, suffix) in ["", ", from behind"].into_iter().enumerate() {
        for (shown, cameras) in pair.iter().zip(&cameras) {
            top.push(shown.painted(pattern, &cameras[side], suffix)?);
        }
    }
    let mut rows = vec![top];
    if let Some(bars) = bars(&pair[0])? {
        let mut bottom = vec![];
        for (kind, bar) in [DistortionKind::Area, DistortionKind::Angle].into_iter().zip(&bars) {
            let [first, last] = &pair;
            bottom.extend(first.measured(kind, bar, &cameras[0][0])?);
            bottom.extend(
                last.measured(kind, bar, &cameras[1][0])?
                    .map(|panel| panel.with_bar(bar)),
            );
        }
        rows.push(bottom);
    }
    if let (Some(domain), Some(target)) = (map.domain_embedding(), map.target_embedding()) {
        rows.push(sphere_row([domain, target], pattern, &cameras[0])?);
    }
    Ok(Figure::grid(rows))
}

fn straight(map: &BoundaryMap, against: ComparedWith) -> anyhow::Result<[Shown; 2]> {
    let domain = repair(map.domain()).0;
    let placed = SurfaceMesh::new(map.image().to_vec(), domain.triangles().to_vec())?;
    let (name, places) = match against {
        ComparedWith::Sphere { centre, .. } => {
            let from_centre = |p: &Point| Point::from(p - Point::from(centre));
            ("Sphere", map.image().iter().map(from_centre).collect())
        }
        ComparedWith::Target | ComparedWith::Itself => ("Image", domain.vertices().to_vec()),
    };
    // The image by a map that mirrors would be seen from its inside.
    let image = if placed.volume() < 0.0 {
        placed.reversed()
    } else {
        placed
    };
    Ok([("Domain", domain.clone()), (name, image)].map(|(name, mesh)| Shown {
        name,
        mesh,
        places: places.clone(),
        distortion: ShownDistortion::of(&domain, map.image(), |ratio| ratio),
    }))
}

fn onto_sphere(map: &BoundaryMap) -> [Shown; 2] {
    let fine = refined(map.clone());
    [("Domain", fine.domain().clone()), ("Sphere", fine.target())].map(|(name, mesh)| Shown {
        name,
        mesh,
        places: fine.image().to_vec(),
        distortion: ShownDistortion::of(fine.domain(), fine.image(), |ratio| ratio),
    })
}

fn composed(map: &BoundaryMap, back: BoundaryMap) -> [Shown; 2] {
    let [fine, back] = [map.clone(), back].map(refined);
    [
        Shown {
            name: "Domain",
            mesh: fine.domain().clone(),
            places: fine.domain().vertices().to_vec(),
            distortion: ShownDistortion::of(fine.domain(), fine.image(), |ratio| ratio),
        },
        Shown {
            name: "Target",
            mesh: back.domain().clone(),
            places: back.image().to_vec(),
            distortion: ShownDistortion::of(back.domain(), back.image(), |ratio| 1.0 / ratio),
        },
    ]
}

/// The sphere, with the pattern of the domain, and coloured by how the areas of either surface are distorted on it.
fn sphere_row(
    surfaces: [&SphericalEmbedding; 2],
    pattern: Pattern,
    [front, back]: &[Camera; 2],
) -> anyhow::Result<Vec<Panel>> {
    let mut spheres = vec![];
    let (mut values, mut weights) = (vec![], vec![]);
    for surface in surfaces {
        let fine = refined(BoundaryMap::onto_sphere(surface.clone())?);
        let distortion = ShownDistortion::of(fine.domain(), fine.image(), |ratio| ratio);
        if let Some(distortion) = &distortion {
            values.extend_from_slice(&distortion.area);
            let areas = areas(fine.domain());
            let total: f64 = areas.iter().sum();
            weights.extend(areas.iter().map(|area| area / total));
        }
        spheres.push(Shown {
            name: "Sphere",
            mesh: fine.target(),
            places: fine.domain().vertices().to_vec(),
            distortion,
        });
    }
    let mut panels = vec![
        spheres[0].painted(pattern, front, "")?,
        spheres[0].painted(pattern, back, ", from behind")?,
    ];
    // One scale for both, at the end of the row.
    let bar = area_bar(&values, &weights)?;
    for (sphere, title) in spheres
        .iter()
        .zip(["Sphere, area from domain", "Sphere, area from target"])
    {
        let panel = sphere.measured(DistortionKind::Area, &bar, front)?;
        panels.extend(panel.map(|panel| panel.titled(title)));
    }
    let last = panels.pop().map(|panel| panel.with_bar(&bar));
    panels.extend(last);
    Ok(panels)
}

/// A surface with handles, from the front and from behind, and where it is laid out in the plane, with one pattern.
pub fn unfolded(domain: &FundamentalDomain, up: UpKind) -> anyhow::Result<Figure> {
    let pattern = cubes(&domain.surface);
    let shown = Shown {
        name: "Surface",
        mesh: domain.surface.clone(),
        places: domain.surface.vertices().to_vec(),
        distortion: None,
    };
    let [front, back] = cameras(up);
    let places: Vec<[Point; 3]> = (0..domain.triangles.len()).map(|t| domain.surface.corners(t)).collect();
    let outline: Vec<[[f64; 2]; 2]> = domain
        .sides
        .iter()
        .flat_map(|side| side.windows(2).map(|ends| [ends[0], ends[1]]))
        .collect();
    let drawing = PlaneDrawing {
        triangles: &domain.triangles,
        places: &places,
        pattern,
        outline: &outline,
    };
    let title = match domain.genus {
        1 => "Parallelogram, opposite sides glued",
        _ => "Polygon of the hyperbolic disk, sides glued in pairs",
    };
    Ok(Figure::row(vec![
        shown.painted(pattern, &front, "")?,
        shown.painted(pattern, &back, ", from behind")?,
        drawing.panel(PIXELS)?.titled(title),
    ]))
}

/// From the front and from behind.
fn cameras(up: UpKind) -> [Camera; 2] {
    let (up, upside_down) = up.axis();
    [30.0, 210.0].map(|azimuth| Camera {
        azimuth,
        elevation: 20.0,
        up,
        upside_down,
    })
}

fn refined(map: BoundaryMap) -> BoundaryMap {
    let mut fine = map;
    while 4 * fine.domain().triangles().len() <= TRIANGLES {
        fine = fine.subdivided();
    }
    fine
}

fn cubes(mesh: &SurfaceMesh) -> Pattern {
    let (low, high) = mesh
        .bounding_box()
        .unwrap_or((Point::origin(), Point::from(Vector::repeat(1.0))));
    Pattern::Cubes {
        low,
        high,
        cells: CELLS,
    }
}

/// Colour bars for areas and angles, over the values of 99 % of the surface's area.
fn bars(shown: &Shown) -> anyhow::Result<Option<[ColourBar; 2]>> {
    let Some(ShownDistortion { area, angle }) = &shown.distortion else {
        return Ok(None);
    };
    let areas = areas(&shown.mesh);
    let most = bound(angle.iter().copied(), &areas);
    let of_angle = ColourBar::new(
        "σ₁/σ₂, 1 where angles are kept",
        angle.iter().copied(),
        ValueRange::Fixed(1.0, most),
        Scale::Log,
    )?;
    Ok(Some([area_bar(area, &areas)?, of_angle]))
}

fn area_bar(ratios: &[f64], weights: &[f64]) -> anyhow::Result<ColourBar> {
    let most = bound(ratios.iter().map(|r| r.max(1.0 / r)), weights);
    Ok(ColourBar::new(
        "ratio of areas, 1 is the mean",
        ratios.iter().copied(),
        ValueRange::Fixed(1.0 / most, most),
        Scale::Log,
    )?
    .in_colours(Colours::Ratio))
}

fn areas(mesh: &SurfaceMesh) -> Vec<f64> {
    (0..mesh.triangles().len())
        .map(|t| mesh.area_vector(t).norm())
        .collect()
}

/// The 99 % quantile by area, within limits that colours can show.
fn bound(values: impl Iterator<Item = f64>, areas: &[f64]) -> f64 {
    let values: Vec<f64> = values.collect();
    weighted_quantiles(&values, areas, [0.99]).map_or(1.05, |[most]| most.clamp(1.05, 1e3))
}

#[derive(Clone, Copy)]
enum DistortionKind {
    Area,
    Angle,
}

impl ShownDistortion {
    /// `area` gives the ratio of areas to show from the ratio of image to domain.
    fn of(domain: &SurfaceMesh, image: &[Point], area: fn(f64) -> f64) -> Option<Self> {
        let found = triangle_distortions(domain, image)?;
        let values = |of: &dyn Fn(&TriangleDistortion) -> f64| -> Vec<f64> {
            found.iter().map(|d| d.as_ref().map_or(f64::NAN, of)).collect()
        };
        Some(Self {
            area: values(&|d| area(d.area_ratio())),
            angle: values(&|d| d.angle()),
        })
    }
}

impl Shown {
    fn painted(&self, pattern: Pattern, camera: &Camera, suffix: &str) -> anyhow::Result<Panel> {
        let checker = Checker {
            places: self.places.clone(),
            pattern,
        };
        self.view(SurfaceColour::Checker(checker), camera, suffix)
    }

    fn measured(&self, kind: DistortionKind, bar: &ColourBar, camera: &Camera) -> anyhow::Result<Option<Panel>> {
        let Some(ShownDistortion { area, angle }) = &self.distortion else {
            return Ok(None);
        };
        let (values, suffix) = match kind {
            DistortionKind::Area => (area, ", distortion of area"),
            DistortionKind::Angle => (angle, ", distortion of angle"),
        };
        let colour = SurfaceColour::PerTriangle(values.clone(), bar.clone());
        self.view(colour, camera, suffix).map(Some)
    }

    fn view(&self, colour: SurfaceColour, camera: &Camera, suffix: &str) -> anyhow::Result<Panel> {
        let style = SurfaceStyle {
            colour,
            ..SurfaceStyle::default()
        };
        Ok(Panel::of_surface(&self.mesh, &style, camera, PIXELS)?.titled(format!("{}{suffix}", self.name)))
    }
}
