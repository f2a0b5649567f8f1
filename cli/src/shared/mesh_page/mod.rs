//! The page of a mesh of tetrahedra or hexahedra: cells peeled off by quality, depth and a plane.

mod neighbours;

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::ensure;
use serde::Serialize;
use solidmap::Point;
use solidmap::check::{CellReport, examine_cells};
use solidmap::geometry::{Axis, SurfaceQuery};
use solidmap::io::{self, Field};
use solidmap::mesh::{CellList, CellMesh, SurfaceMesh};
use solidmap::remesh::{invalid_cells, scaled_jacobians};
use solidmap::statistics::quantiles;

use super::input;
use super::page::{Framing, NumberTable, PackedArray, Page, PageField, Palette, megabytes};
use crate::args::{PageSizeArgs, UpKind};
use crate::drawing::significant;
use neighbours::{boundary_triangles, neighbours};

/// The most different values of a field that is taken for labels.
const MOST_LABELS: usize = 64;
/// Pages have single precision, which holds every whole number up to this one.
const LARGEST_LABEL: f64 = 16_777_216.0;

/// A page of a mesh.
pub struct MadeMeshPage {
    /// Its text.
    pub html: String,
    /// Cells of the mesh.
    pub cells: usize,
    /// How many of them are inverted.
    pub inverted_cells: usize,
}

/// What the scripts of the page read, besides the arrays.
#[derive(Serialize)]
struct MeshContent {
    kind: &'static str,
    /// `tets` or `hexes`.
    cells: &'static str,
    elements: &'static str,
    framing: Framing,
    fields: Vec<PageField>,
    /// The greatest depth of a cell.
    deepest: f64,
    up: (usize, bool),
}

/// Writes the page of a mesh that has just been written.
pub fn write_of_file(page: &Path, path: &Path, up: UpKind, args: &PageSizeArgs) -> anyhow::Result<()> {
    super::page::write(page, &make(path, io::read_cells(path)?, up, args)?.html)
}

/// The page of the mesh in a file.
pub fn make(path: &Path, mesh: CellMesh, up: UpKind, args: &PageSizeArgs) -> anyhow::Result<MadeMeshPage> {
    ensure!(!mesh.cells().is_empty(), "`{}` has no cells to look at", path.display());
    let mut notes = vec![];
    let mesh = if mesh.volume() < 0.0 {
        notes.push(
            "Most cells are left-handed: all are taken the other way round, so that inverted ones are the others."
                .into(),
        );
        mirrored(&mesh)?
    } else {
        mesh
    };
    let (nodes, cells) = (mesh.nodes(), mesh.cells());
    let report = examine_cells(&mesh);
    let inverted = invalid_cells(cells, nodes).cells;
    let across = neighbours(cells);
    let depths = depths(nodes, cells, boundary_triangles(cells, &across))?;
    let deepest = depths.iter().copied().fold(0.0, f64::max);

    let quality = scaled_jacobians(cells, nodes);
    let mut scalars = vec![
        (
            PageField {
                key: "quality".into(),
                label: "scaled Jacobian".into(),
                unit: "",
                meaning: "1 for cubes and regular tetrahedra, 0 for flat cells, negative for inverted ones".into(),
                palette: Palette::Quality,
                logarithmic: false,
                low: 0.0,
                high: 1.0,
                clamps: quality.iter().any(|value| *value < 0.0),
            },
            quality,
        ),
        (
            amount(
                "depth",
                "depth",
                "distance of the cell's middle from the boundary of the mesh",
                "model units",
                &depths,
            ),
            depths,
        ),
    ];
    scalars.extend(fields_of_file(path, cells.len()));
    let (fields, arrays): (Vec<PageField>, Vec<PackedArray>) = scalars
        .into_iter()
        .map(|(field, values)| {
            let array = PackedArray::floats(format!("field-{}", field.key), values);
            (field, array)
        })
        .unzip();

    let framing = Framing::of(nodes);
    let mut arrays = arrays;
    arrays.push(PackedArray::floats("nodes", framing.place(nodes)));
    arrays.push(PackedArray::indices("cells", cells.iter().flatten().copied()));
    arrays.push(PackedArray::indices("neighbours", across));
    arrays.push(PackedArray::indices("inverted", inverted.iter().copied()));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let page = Page {
        title: format!("{name}: {} {}", cells.len(), cells.elements()),
        files: vec![input::provenance("mesh", path)?],
        notes,
        tables: vec![numbers(&report, inverted.len())],
        arrays,
    };
    let content = MeshContent {
        kind: "mesh",
        cells: report.kind,
        elements: cells.elements(),
        framing,
        fields,
        deepest,
        up: (Axis::from(up).index(), up.is_upside_down()),
    };
    let html = page.html(&content)?;
    let size = html.len() as u64;
    ensure!(
        size <= args.max_size,
        "the page of all {} cells takes {:.1} MB, but --max-size is {:.1} MB; allow more",
        cells.len(),
        megabytes(size),
        megabytes(args.max_size)
    );
    Ok(MadeMeshPage {
        html,
        cells: cells.len(),
        inverted_cells: inverted.len(),
    })
}

/// The mesh with the corners of its cells in the other orientation.
fn mirrored(mesh: &CellMesh) -> anyhow::Result<CellMesh> {
    let cells = match mesh.cells() {
        CellList::Tets(tets) => CellList::Tets(tets.iter().map(|&[a, b, c, d]| [a, c, b, d]).collect()),
        CellList::Hexes(hexes) => CellList::Hexes(
            hexes
                .iter()
                .map(|&[a, b, c, d, e, f, g, h]| [e, f, g, h, a, b, c, d])
                .collect(),
        ),
    };
    Ok(CellMesh::new(mesh.nodes().to_vec(), cells, mesh.regions().to_vec())?)
}

/// The distance of each cell's middle from the boundary.
fn depths(nodes: &[Point], cells: &CellList, boundary: Vec<[u32; 3]>) -> anyhow::Result<Vec<f64>> {
    let query = SurfaceQuery::new(&SurfaceMesh::new(nodes.to_vec(), boundary)?)?;
    let middles: Vec<Point> = cells
        .iter()
        .map(|corners| {
            let sum = corners
                .iter()
                .fold(Point::origin(), |sum, &v| sum + nodes[v as usize].coords);
            sum / corners.len() as f64
        })
        .collect();
    Ok(query
        .closest_points(&middles)
        .into_iter()
        .map(|closest| closest.distance)
        .collect())
}

/// The scalars that the file has for its cells.
fn fields_of_file(path: &Path, cells: usize) -> Vec<(PageField, Vec<f64>)> {
    if !["vtk", "vtu"].contains(&input::extension(path).as_str()) {
        return vec![];
    }
    // The mesh has been read: fields that cannot be read are no reason not to show it.
    let fields = io::read_fields(path).map(|file| file.cell).unwrap_or_default();
    let is_scalar = |field: &Field| field.components == 1 && field.values.len() == cells;
    let scalars = fields.into_iter().filter(is_scalar).enumerate();
    scalars
        .map(|(k, field)| {
            let meaning = format!("`{}` of the file", field.name);
            let shown = amount(format!("file-{k}"), field.name, meaning, "", &field.values);
            let shown = match are_labels(&field.values) {
                true => PageField {
                    palette: Palette::Labels,
                    ..shown
                },
                false => shown,
            };
            (shown, field.values)
        })
        .collect()
}

/// Whether values look like labels: few different whole numbers.
fn are_labels(values: &[f64]) -> bool {
    let mut different = BTreeSet::new();
    values.iter().all(|&value| {
        value.fract() == 0.0 && value.abs() <= LARGEST_LABEL && {
            different.insert(value as i64);
            different.len() <= MOST_LABELS
        }
    })
}

/// A scalar coloured from its least to its largest value.
fn amount(
    key: impl Into<std::borrow::Cow<'static, str>>,
    label: impl Into<std::borrow::Cow<'static, str>>,
    meaning: impl Into<std::borrow::Cow<'static, str>>,
    unit: &'static str,
    values: &[f64],
) -> PageField {
    let [low, high] = quantiles(values, [0.0, 1.0]).unwrap_or_default();
    PageField {
        key: key.into(),
        label: label.into(),
        unit,
        meaning: meaning.into(),
        palette: Palette::Amount,
        logarithmic: false,
        low,
        high: if high > low { high } else { low + 1.0 },
        clamps: false,
    }
}

/// What the mesh is.
fn numbers(report: &CellReport, inverted: usize) -> NumberTable {
    let mut table = NumberTable::new("Mesh");
    let quality = |value: Option<f64>| value.map_or("-".into(), |value| significant(value, 4));
    table.row("cells", report.cells.to_string(), "", "all are in this page");
    table.row("nodes", report.vertices.to_string(), "", "");
    table.row(
        "inverted cells",
        inverted.to_string(),
        "",
        "tetrahedra that are not right-handed; hexahedra that are not proved to have a positive determinant everywhere",
    );
    table.row(
        "scaled Jacobian, least",
        quality(report.min_scaled_jacobian),
        "",
        "1 is best, 0 flat",
    );
    table.row(
        "scaled Jacobian, 1 %",
        quality(report.p01_scaled_jacobian),
        "",
        "1 % of the cells have less",
    );
    table.row("scaled Jacobian, mean", quality(report.mean_scaled_jacobian), "", "");
    let volume: f64 = report.bodies.iter().map(|body| body.volume).sum();
    table.row(
        "volume",
        significant(volume, 4),
        "model units³",
        "inverted cells count negatively",
    );
    table.row(
        "bodies",
        report.bodies.len().to_string(),
        "",
        "parts connected across faces",
    );
    table
}
