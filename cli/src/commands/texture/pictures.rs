//! Pictures of a texture: the solid cut open, and sections.

use solidmap::geometry::{Axis, AxisPlane, PlaneSection, SectionError};
use solidmap::mesh::SurfaceMesh;
use solidmap::texture::{SolidTexture, to_srgb};
use solidmap::{Point, Vector};

use super::painted::PaintedSurface;
use crate::args::TextureOutputArgs;
use crate::drawing::{Camera, Figure, Panel, Rgb, SurfaceColour, SurfaceStyle};
use crate::shared::output::Output;
use crate::shared::pictures::plane_across;

/// Pixels along the longer side of a section, and width and height of a view.
const SECTION: usize = 480;
const VIEW: [usize; 2] = [520, 480];

/// Triangles that the surface is cut into for views, so that the picture is sharp.
const TRIANGLES: usize = 400_000;

/// The surface, the solid cut open, and sections across the three axes.
pub fn figure(texture: &SolidTexture, args: &TextureOutputArgs, output: &Output) -> anyhow::Result<Figure> {
    let (up, upside_down) = args.up.axis();
    let axes = [Axis::X, Axis::Y, Axis::Z];
    let mut panels = vec![];
    for axis in axes {
        match section(texture, axis, up, args.position, SECTION) {
            Ok(section) => panels.push(painted(texture, &section)?.turned_if(upside_down)),
            // The middle of a ring is empty.
            Err(error @ (SectionError::PlaneMissesSolid { .. } | SectionError::BelowPixel { .. })) => {
                output.warn(format!("left out of the picture: {error} (--position)"));
            }
            Err(error) => return Err(error.into()),
        }
    }
    let whole = painted_surface(texture);
    let cut = largest_cut(texture, up, args.position);
    let camera = Camera {
        azimuth: cut.as_ref().map_or(FRONT, |cut| cut.azimuth),
        elevation: 22.0,
        up,
        upside_down,
    };
    let mut views = vec![view(&whole, &camera)?.titled("Surface")];
    if let Some(CutOpenView { section, towards, .. }) = cut {
        let axis = section.plane().axis;
        let open = joined(whole.behind(section.plane(), towards), cap(texture, &section, towards));
        views.push(view(&open, &camera)?.titled(format!("Cut open across {axis}")));
    }
    Ok(Figure::grid(vec![views, panels]))
}

/// Where the solid is cut open, and from where that is seen.
struct CutOpenView {
    section: PlaneSection,
    /// On which side along the axis the viewer is: 1 or -1.
    towards: f64,
    azimuth: f64,
}

/// Azimuths of the camera in degrees, which show more of the front, or more of the right side.
const FRONT: f64 = 32.0;
const RIGHT: f64 = 58.0;

/// The larger one of the two upright sections, seen from the front or from the right.
fn largest_cut(texture: &SolidTexture, up: Axis, position: f64) -> Option<CutOpenView> {
    let sides = match up {
        Axis::X => [(Axis::Z, -1.0, FRONT), (Axis::Y, 1.0, RIGHT)],
        Axis::Y => [(Axis::Z, 1.0, FRONT), (Axis::X, 1.0, RIGHT)],
        Axis::Z => [(Axis::Y, -1.0, FRONT), (Axis::X, 1.0, RIGHT)],
    };
    let cuts = sides.into_iter().filter_map(|(axis, towards, azimuth)| {
        Some(CutOpenView {
            section: section(texture, axis, up, position, 2 * SECTION).ok()?,
            towards,
            azimuth,
        })
    });
    cuts.max_by(|a, b| a.section.area().total_cmp(&b.section.area()))
}

fn section(
    texture: &SolidTexture,
    axis: Axis,
    up: Axis,
    position: f64,
    pixels: usize,
) -> Result<PlaneSection, SectionError> {
    let surface = texture.coloured_surface().surface();
    PlaneSection::new(surface, plane_across(axis, position, surface), up, pixels)
}

fn colours(texture: &SolidTexture, points: &[Point]) -> Vec<Rgb> {
    texture.sample(points).into_iter().map(to_srgb).collect()
}

fn painted(texture: &SolidTexture, section: &PlaneSection) -> anyhow::Result<Panel> {
    Ok(Panel::of_painted_section(section, &colours(texture, section.points()))?)
}

/// A surface with the colours of its corners.
struct Painted {
    mesh: SurfaceMesh,
    colours: Vec<[Rgb; 3]>,
}

fn view(painted: &Painted, camera: &Camera) -> anyhow::Result<Panel> {
    let style = SurfaceStyle {
        colour: SurfaceColour::PerCorner(painted.colours.clone()),
        ..SurfaceStyle::default()
    };
    Ok(Panel::of_surface(&painted.mesh, &style, camera, VIEW)?)
}

/// The surface in small triangles, painted with the picture.
fn painted_surface(texture: &SolidTexture) -> Painted {
    let painted = PaintedSurface::of(texture.coloured_surface(), TRIANGLES);
    Painted {
        colours: painted.by_corners(),
        mesh: painted.mesh,
    }
}

impl Painted {
    /// The part behind a plane, seen from the side of its axis that `towards` points to. Triangles across the plane are
    /// flattened onto it.
    fn behind(&self, plane: AxisPlane, towards: f64) -> Self {
        let k = plane.axis.index();
        let depth = |p: &Point| towards * (plane.position - p[k]);
        let mut vertices = self.mesh.vertices().to_vec();
        let kept = (0..self.mesh.triangles().len()).filter(|&t| self.mesh.corners(t).iter().any(|p| depth(p) > 0.0));
        let kept: Vec<usize> = kept.collect();
        for p in &mut vertices {
            if depth(p) < 0.0 {
                p[k] = plane.position;
            }
        }
        let triangles = kept.iter().map(|&t| self.mesh.triangles()[t]).collect();
        Self {
            mesh: SurfaceMesh::new(vertices, triangles).expect("corners are vertices"),
            colours: kept.iter().map(|&t| self.colours[t]).collect(),
        }
    }
}

/// A section as a surface: a square for each of its pixels.
fn cap(texture: &SolidTexture, section: &PlaneSection, towards: f64) -> Painted {
    let plane = section.plane();
    let [right, upward] = section
        .axes()
        .map(|axis| Vector::ith(axis.index(), 0.5 * section.pixel()));
    let along = Vector::ith(plane.axis.index(), towards);
    let colours = colours(texture, section.points());
    let (mut vertices, mut triangles, mut painted) = (vec![], vec![], vec![]);
    let faces_viewer = right.cross(&upward).dot(&along) > 0.0;
    for (p, rgb) in section.points().iter().zip(colours) {
        let first = vertices.len() as u32;
        vertices.extend([
            p - right - upward,
            p + right - upward,
            p + right + upward,
            p - right + upward,
        ]);
        for three in [[0, 1, 2], [0, 2, 3]] {
            let [a, b, c] = three.map(|k: u32| first + k);
            triangles.push(if faces_viewer { [a, b, c] } else { [a, c, b] });
            painted.push([rgb; 3]);
        }
    }
    Painted {
        mesh: SurfaceMesh::new(vertices, triangles).expect("corners are vertices"),
        colours: painted,
    }
}

fn joined(first: Painted, second: Painted) -> Painted {
    let (mut vertices, mut triangles) = first.mesh.into_parts();
    let offset = vertices.len() as u32;
    let (more, corners) = second.mesh.into_parts();
    vertices.extend(more);
    triangles.extend(corners.into_iter().map(|t| t.map(|v| v + offset)));
    Painted {
        mesh: SurfaceMesh::new(vertices, triangles).expect("corners are vertices"),
        colours: [first.colours, second.colours].concat(),
    }
}
