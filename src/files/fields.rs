//! Fields of maps for ParaView: what is known of a map at points, on triangles, in cells. Files are .vtu, or .vtk for the
//! legacy format.

use std::path::Path;

use crate::boundary_map::{BoundaryMap, TriangleDistortion, triangle_distortions};
use crate::certificate::{Certificate, CertificateCell, Verdict};
use crate::energy::{CellLayout, Densities, Quadrature};
use crate::io::{self, Cells, Field, IoError, VtkEncoding, VtkFields};
use crate::map::VolumeMap;
use crate::mesh::{CellList, CellMesh};
use crate::polycube::BestAttempt;

/// Writes points, cells between them, and fields.
///
/// # Errors
///
/// Those of [`io::write_vtu`] and [`io::write_vtk`].
pub fn write_fields(path: &Path, points: &[crate::Point], cells: Cells, fields: &VtkFields) -> Result<(), IoError> {
    match path.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("vtk") => {
            io::write_vtk(path, points, cells, fields, VtkEncoding::Binary)
        }
        _ => io::write_vtu(path, points, cells, fields),
    }
}

/// Writes the domain's surface with the image of each vertex by the boundary map and by the map, and their distance.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_fit_fields(path: &Path, boundary: &BoundaryMap, map: &dyn VolumeMap) -> Result<(), IoError> {
    let domain = boundary.domain();
    let mapped = map.evaluate(domain.vertices());
    let errors = mapped.iter().zip(boundary.image()).map(|(f, exact)| (f - exact).norm());
    let fields = VtkFields {
        point: vec![
            Field::positions("image", boundary.image()),
            Field::positions("mapped", &mapped),
            Field::scalar("error", errors.collect()),
        ],
        ..VtkFields::default()
    };
    write_fields(path, domain.vertices(), Cells::Triangles(domain.triangles()), &fields)
}

/// Writes the domain's surface with the image of each vertex and the distortion of each triangle.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_boundary_fields(path: &Path, map: &BoundaryMap) -> Result<(), IoError> {
    let domain = map.domain();
    let distortions = triangle_distortions(domain, map.image());
    let distortions = distortions.unwrap_or_else(|| vec![None; domain.triangles().len()]);
    let per_triangle = |name: &str, of: fn(&TriangleDistortion) -> f64| {
        let values = distortions.iter().map(|d| d.as_ref().map_or(f64::NAN, of));
        Field::scalar(name, values.collect())
    };
    let fields = VtkFields {
        point: vec![Field::positions("image", map.image())],
        cell: vec![
            per_triangle("area ratio", TriangleDistortion::area_ratio),
            per_triangle("angle distortion", TriangleDistortion::angle),
        ],
        ..VtkFields::default()
    };
    write_fields(path, domain.vertices(), Cells::Triangles(domain.triangles()), &fields)
}

/// The fields of a map at the points of a quadrature: its energies, and the target's distance field pulled back by it.
pub fn energy_fields<'a>(densities: &'a Densities, distances: &'a [f64]) -> [(&'static str, &'a [f64]); 4] {
    [
        ("harmonic_energy", &densities.harmonic),
        ("deformation_energy", &densities.deformation),
        ("det_jacobian", &densities.det_jacobian),
        ("transferred_distance", distances),
    ]
}

/// Writes the cell means of fields given at the points of a quadrature. Cells are those of the mesh that it is over, or
/// boxes of a grid, which are written whole where the surface cuts them.
///
/// # Errors
///
/// When the file cannot be written.
///
/// # Panics
///
/// If the quadrature is over the cells of a mesh, and there is none.
pub fn write_cell_means(
    path: &Path,
    quadrature: &Quadrature,
    mesh: Option<&CellMesh>,
    fields: &[(&str, &[f64])],
) -> Result<(), IoError> {
    let means = |values| quadrature.cell_means(values).iter().map(|c| c.mean).collect();
    let cells = quadrature.cell_means(quadrature.weights());
    let volumes = Field::scalar("volume_inside", cells.iter().map(|c| c.volume).collect());
    let cells: Vec<u32> = cells.iter().map(|c| c.cell).collect();
    let means = fields.iter().map(|&(name, values)| Field::scalar(name, means(values)));
    let fields = VtkFields {
        cell: means.chain([volumes]).collect(),
        ..VtkFields::default()
    };
    if let CellLayout::Grid(grid) = quadrature.layout() {
        let (points, hexes) = grid.hexahedra(&cells);
        return write_fields(path, &points, Cells::Hexes(&hexes), &fields);
    }
    let mesh = mesh.expect("a quadrature over the cells of a mesh comes with the mesh");
    let with_points = match mesh.cells() {
        CellList::Tets(tets) => CellList::Tets(cells.iter().map(|&c| tets[c as usize]).collect()),
        CellList::Hexes(hexes) => CellList::Hexes(cells.iter().map(|&c| hexes[c as usize]).collect()),
    };
    write_fields(path, mesh.nodes(), Cells::from(&with_points), &fields)
}

/// What is proved in each cell of a certificate: `verdict` (1 regular, 0 undecided, -1 folded), the bounds, the level and the
/// volume inside.
pub fn certificate_fields(certificate: &Certificate) -> Vec<Field> {
    let field = |name: &str, value: fn(&CertificateCell) -> f64| {
        Field::scalar(name, certificate.cells().iter().map(value).collect())
    };
    vec![
        field("verdict", |leaf| match leaf.verdict {
            Verdict::Positive => 1.0,
            Verdict::Undecided => 0.0,
            Verdict::Folded => -1.0,
        }),
        field("sigma_min_bound", |leaf| short(leaf.sigma_min)),
        field("det_bound", |leaf| short(leaf.det_bound)),
        field("det_centre", |leaf| short(leaf.det_centre)),
        field("level", |leaf| f64::from(leaf.level)),
        field("volume_inside", |leaf| leaf.volume),
    ]
}

/// A number cut off to single precision, towards zero: a lower bound stays one, and the file is compressed better.
fn short(x: f64) -> f64 {
    f64::from_bits(x.to_bits() >> 29 << 29)
}

/// What is known of the tetrahedra of an attempt at a polycube: whether each is `bad`, and the `label` of its boundary
/// triangle, -1 inside.
pub fn attempt_fields(best: &BestAttempt) -> Vec<Field> {
    let bad = best.bad.iter().map(|&bad| f64::from(u8::from(bad)));
    let labels = best.cell_labels.iter().map(|label| label.map_or(-1.0, f64::from));
    vec![
        Field::scalar("bad", bad.collect()),
        Field::scalar("label", labels.collect()),
    ]
}
