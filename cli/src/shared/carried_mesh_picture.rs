//! Pictures of carried meshes: cut open in domain and target, before and after the repair, and how volumes are
//! distributed.

use crate::drawing::{
    Camera, ColourBar, Colours, Edges, Figure, Histogram, Panel, Scale, Shading, SurfaceColour, SurfaceStyle,
    ValueRange,
};
use solidmap::geometry::Axis;
use solidmap::mesh::SurfaceMesh;
use solidmap::remesh::{
    CellKind, CellSetBoundary, InvalidCells, Remeshed, determinants, invalid_cells, scaled_jacobians,
};
use solidmap::{Point, Vector};

use super::carried_mesh_file::least_of_cells;
use super::output::Output;
use crate::args::UpKind;

/// Width and height of a view.
const PIXELS: [usize; 2] = [620, 580];

/// The picture, with these axes up in domain and target. A mesh with nodes that are not finite has none, which is a warning
/// only.
pub fn png(remeshed: &Remeshed, no_repair: bool, ups: [UpKind; 2], output: &Output) -> Option<Vec<u8>> {
    let now = if no_repair {
        "Not repaired"
    } else if remeshed.images == remeshed.carried {
        "Unchanged"
    } else if remeshed.report.before.cells.is_empty() {
        "Polished"
    } else {
        "Repaired"
    };
    let drawn = figure(remeshed, now, ups).and_then(|figure| Ok(figure.to_png()?));
    drawn
        .inspect_err(|error| output.warn(format_args!("no picture: {error}")))
        .ok()
}

/// Domain, target as mapped, and target as it is now, cut open along the same cells and coloured by their scaled
/// Jacobian; the whole target from two sides; and histograms of the cells' determinants and scaled Jacobians. `now`
/// names the last state, as in "Repaired"; `ups` point up in pictures of the domain and of the target.
pub fn figure(remeshed: &Remeshed, now: &str, ups: [UpKind; 2]) -> anyhow::Result<Figure> {
    let camera = |up: UpKind, azimuth| Camera {
        azimuth,
        elevation: 18.0,
        up: up.into(),
        upside_down: up.is_upside_down(),
    };
    let [of_domain, front] = ups.map(|up| camera(up, 32.0));
    let back = camera(ups[1], 212.0);
    let up = Axis::from(ups[1]);
    let (mesh, report) = (&remeshed.mesh, &remeshed.report);
    let kept = behind(remeshed, towards_front(up));
    let open = mesh.boundary_of(|cell| kept[cell as usize]);
    let whole = mesh.boundary_of(|_| true);
    let places = [mesh.nodes(), &remeshed.carried, &remeshed.images];
    let qualities = places.map(|x| scaled_jacobians(mesh.cells(), x));
    let bar = ColourBar::new(
        "scaled Jacobian, 0 and less is inverted",
        qualities[2].iter().copied(),
        ValueRange::Fixed(0.0, 1.0),
        Scale::Linear,
    )?
    .in_colours(Colours::Quality);
    let cameras = [&of_domain, &front, &front];
    let [domain, as_mapped, repaired] = [0, 1, 2].map(|k| view(&open, places[k], &qualities[k], &bar, cameras[k]));
    let [from_front, from_behind] = [&front, &back].map(|camera| view(&whole, places[2], &qualities[2], &bar, camera));
    let mut below = vec![from_front?.titled("Target"), from_behind?.titled("Target, from behind")];
    // One value for each cell, and none that is positive for an inverted one, so that the counts are those above.
    let of_cells = |mut values: Vec<f64>, inverted: &InvalidCells| {
        inverted.cells.iter().for_each(|&cell| values[cell as usize] = f64::NAN);
        values
    };
    // Splitting has renumbered the cells.
    let as_mapped_now = invalid_cells(mesh.cells(), places[1]);
    let both = |of: &dyn Fn(usize) -> Vec<f64>| {
        [(1, &as_mapped_now), (2, &report.after)].map(|(k, cells)| of_cells(of(k), cells))
    };
    let dets = both(&|k| least_of_cells(mesh, &determinants(mesh.cells(), mesh.nodes(), places[k])));
    let shapes = both(&|k| qualities[k].clone());
    let what = match report.kind {
        CellKind::Tets => "det J of cells, 1 is that of the whole",
        CellKind::Hexes => "least det J at the corners of cells, 1 is the mean",
    };
    let now_in_words = now.to_lowercase();
    let [dets, shapes] = [&dets, &shapes].map(|[mapped, now]| [("as mapped", &mapped[..]), (&now_in_words, &now[..])]);
    let mut add = |histogram: Histogram, title: &str| -> anyhow::Result<()> {
        below.push(Panel::of_histogram(&histogram.counting("inverted"), PIXELS)?.titled(title));
        Ok(())
    };
    // A mesh with inverted cells alone has no histogram of determinants.
    if let Ok(histogram) = Histogram::logarithmic(what, &dets) {
        add(histogram, "How volumes change")?;
    }
    add(
        Histogram::from_0_to_1("scaled Jacobian of cells", &shapes),
        "How well cells are shaped",
    )?;
    let count = |words: &str, cells: &InvalidCells| match cells.cells.len() {
        1 => format!("{words}: 1 cell inverted"),
        count => format!("{words}: {count} cells inverted"),
    };
    let above = vec![
        domain?.titled("Domain, cut open"),
        as_mapped?.titled(count("As mapped", &report.before)),
        repaired?.titled(count(now, &report.after)).with_bar(&bar),
    ];
    Ok(Figure::grid(vec![above, below]))
}

/// The horizontal direction towards a viewer at azimuth 0.
fn towards_front(up: Axis) -> Vector {
    match up {
        Axis::X => -Vector::z(),
        Axis::Y => Vector::z(),
        Axis::Z => -Vector::y(),
    }
}

/// Whether each cell's middle lies behind that of the target; all count as behind if none does.
fn behind(remeshed: &Remeshed, front: Vector) -> Vec<bool> {
    let mesh = &remeshed.mesh;
    let along = |v: u32| remeshed.images[v as usize].coords.dot(&front);
    let on_boundary = (0..).zip(mesh.on_boundary()).filter(|(_, on)| **on);
    let (low, high) = on_boundary.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (v, _)| {
        (low.min(along(v)), high.max(along(v)))
    });
    let middle = |cell: &[u32]| cell.iter().map(|&v| along(v)).sum::<f64>() / cell.len() as f64;
    let behind: Vec<bool> = mesh
        .cells()
        .iter()
        .map(|cell| middle(cell) <= 0.5 * (low + high))
        .collect();
    if behind.contains(&true) {
        behind
    } else {
        vec![true; behind.len()]
    }
}

/// The faces of cells, coloured by their quality.
fn view(
    boundary: &CellSetBoundary,
    positions: &[Point],
    quality: &[f64],
    bar: &ColourBar,
    camera: &Camera,
) -> anyhow::Result<Panel> {
    let values = boundary.cells.iter().map(|&cell| quality[cell as usize]).collect();
    let surface = SurfaceMesh::new(positions.to_vec(), boundary.triangles.clone())?;
    let style = SurfaceStyle {
        colour: SurfaceColour::PerTriangle(values, bar.clone()),
        shading: Shading::Flat,
        edges: Edges::Marked(boundary.edges.clone()),
    };
    Ok(Panel::of_surface(&surface, &style, camera, PIXELS)?)
}
