//! A carried mesh to look at: cut open in domain and target, before and after the repair, and how volumes are distributed.

use solidmap::mesh::SurfaceMesh;
use solidmap::remesh::{Remeshed, determinants, scaled_jacobians};
use solidmap::report::{
    Axis, Camera, ColourBar, Edges, Figure, Histogram, Panel, Scale, Shading, SurfaceColour, SurfaceStyle, ValueRange,
};
use solidmap::{Point, Vector};

use crate::cli::args::UpKind;

/// Width and height of a view.
const PIXELS: [usize; 2] = [620, 580];

/// Domain, target as mapped, and target as it is now, cut open along the same cells and coloured by their scaled Jacobian;
/// the whole of it from two sides; and the determinants of the map of the cells.
pub fn remeshed(remeshed: &Remeshed, up: UpKind) -> anyhow::Result<Figure> {
    let (up, upside_down) = up.axis();
    let [front, back] = [32.0, 212.0].map(|azimuth| Camera {
        azimuth,
        elevation: 18.0,
        up,
        upside_down,
    });
    let report = &remeshed.report;
    let kept = behind(remeshed, towards_front(up));
    let bar = ColourBar::new(
        "scaled Jacobian, 0 and less is inverted",
        scaled_jacobians(&remeshed.mesh.cells, &remeshed.images),
        ValueRange::Fixed(0.0, 1.0),
        Scale::Linear,
    )?;
    let open = |positions: &[Point]| view(remeshed, positions, Some(&kept), &bar, &front);
    let as_mapped = format!("As mapped: {} inverted", report.before.cells.len());
    let now = format!("Repaired: {} inverted", report.after.cells.len());
    let whole = |camera| view(remeshed, &remeshed.images, None, &bar, camera);
    let dets = [&remeshed.carried, &remeshed.images].map(|x| determinants(&remeshed.mesh, x));
    let histogram = Histogram::logarithmic(
        "det J of cells over its mean",
        &[("as mapped", &dets[0]), ("repaired", &dets[1])],
    )?;
    Ok(Figure::grid(vec![
        vec![
            open(&remeshed.mesh.nodes)?.titled("Domain, cut open"),
            open(&remeshed.carried)?.titled(as_mapped),
            open(&remeshed.images)?.titled(now).with_bar(&bar),
        ],
        vec![
            whole(&front)?.titled("Target"),
            whole(&back)?.titled("Target, from behind"),
            Panel::of_histogram(&histogram, PIXELS)?.titled("How volumes change"),
        ],
    ]))
}

/// Towards the viewer, level, as seen at azimuth 0.
fn towards_front(up: Axis) -> Vector {
    match up {
        Axis::X => -Vector::z(),
        Axis::Y => Vector::z(),
        Axis::Z => -Vector::y(),
    }
}

/// Cells of which the middle in the target lies behind its middle.
fn behind(remeshed: &Remeshed, front: Vector) -> Vec<bool> {
    let along = |v: u32| remeshed.images[v as usize].coords.dot(&front);
    let on_boundary = (0..).zip(&remeshed.mesh.on_boundary).filter(|(_, on)| **on);
    let (low, high) = on_boundary.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (v, _)| {
        (low.min(along(v)), high.max(along(v)))
    });
    remeshed
        .mesh
        .cells
        .iter()
        .map(|cell| cell.iter().map(|&v| along(v)).sum::<f64>() / cell.len() as f64 <= 0.5 * (low + high))
        .collect()
}

/// The faces of some cells, or of all, coloured by the quality of their cells.
fn view(
    remeshed: &Remeshed,
    positions: &[Point],
    kept: Option<&[bool]>,
    bar: &ColourBar,
    camera: &Camera,
) -> anyhow::Result<Panel> {
    let skin = remeshed.mesh.skin(|cell| kept.is_none_or(|kept| kept[cell as usize]));
    let quality = scaled_jacobians(&remeshed.mesh.cells, positions);
    let values = skin.cells.iter().map(|&cell| quality[cell as usize]).collect();
    let surface = SurfaceMesh::new(positions.to_vec(), skin.triangles)?;
    let style = SurfaceStyle {
        colour: SurfaceColour::PerTriangle(values, bar.clone()),
        shading: Shading::Flat,
        edges: Edges::Marked(skin.edges),
    };
    Ok(Panel::of_surface(&surface, &style, camera, PIXELS)?)
}
