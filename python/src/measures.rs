//! Energies, distortion and certificates of maps.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use serde_json::json;
use solidmap::certificate::{CertificateOptions, CertificateProgress, StopReason, certify};
use solidmap::energy::{
    AdaptiveOptions, EnergyOptions, GridResolution, Lame, Quadrature, adaptive_energies, cell_quadrature, clipped_grid,
    densities, distortion, domain_mesh_quadrature, energies, worst_places,
};
use solidmap::files;
use solidmap::fit::self_intersection_finder;
use solidmap::geometry::distance_field;
use solidmap::io::Field;
use solidmap::map::{VolumeMap, with_cancellation};
use solidmap::mesh::{CellList, CellMesh};

use crate::arrays::Points;
use crate::boundary::value_of;
use crate::error::Failure;
use crate::map::{Kind, Map, boundary_of, chosen};
use crate::meshes::{Cells, json as to_json};
use crate::run::{Step, of, run, step};

/// The program's options of energies.
#[derive(FromPyObject, Clone)]
#[pyo3(from_item_all)]
pub struct EnergyArguments {
    pub resolution: usize,
    pub energy_tolerance: f64,
    pub no_normalize: bool,
    pub lame: [f64; 2],
    pub worst: usize,
}

/// The material; refused where it is none, whose energy can be negative.
pub fn lame_of([lambda, mu]: [f64; 2]) -> Result<Lame, Failure> {
    if lambda.is_finite() && mu.is_finite() && mu > 0.0 && 3.0 * lambda + 2.0 * mu > 0.0 {
        return Ok(Lame { lambda, mu });
    }
    Err(Failure::invalid(format!(
        "lame is ({lambda}, {mu}), but both must be finite, mu positive, and 3 lambda + 2 mu too"
    )))
}

impl EnergyArguments {
    fn options(&self) -> Result<EnergyOptions, Failure> {
        Ok(EnergyOptions {
            normalize: !self.no_normalize,
            lame: lame_of(self.lame)?,
        })
    }
}

/// The energies, and with them what they were integrated over.
#[pyfunction]
#[pyo3(signature = (map, arguments, mesh=None, kind=None, vtu=None, progress=None))]
pub fn energy(
    py: Python,
    map: &Map,
    arguments: EnergyArguments,
    mesh: Option<&Cells>,
    kind: Option<&str>,
    vtu: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (file, kind, options) = (Arc::clone(&map.file), map.kind(kind)?, arguments.options()?);
    let given = mesh.map(|mesh| Arc::clone(&mesh.0));
    run(py, progress, None, move |watch| {
        let boundary = boundary_of(&file)?;
        let target_volume = boundary.target_volume();
        let accuracy = AdaptiveOptions {
            resolution: GridResolution::CellsAlongLongestSide(arguments.resolution),
            tolerance: arguments.energy_tolerance,
            max_points: None,
        };
        // Its own tetrahedra integrate a map exactly that is linear over them.
        let own = match (&file.bijective, kind, &given) {
            (Some(bijective), Kind::Bijective, None) => Some(CellMesh::from(bijective.map.domain().clone())),
            _ => None,
        };
        let mut warnings = vec![];
        let over = match (&given, &own) {
            (Some(mesh), _) => {
                let found = domain_mesh_quadrature(mesh, boundary.domain())?;
                warnings = found.warnings.iter().map(ToString::to_string).collect();
                Some(found.quadrature)
            }
            (None, Some(own)) => Some(cell_quadrature(own)?),
            (None, None) => None,
        };
        let integrating = || watch.tell(|| step("integrating"));
        let (quadrature, report) = with_cancellation(chosen(&file, kind), &integrating, |map| match over {
            Some(quadrature) => {
                let found = energies(map, &quadrature, quadrature.volume(), target_volume, &options);
                found.map(|report| (quadrature, report))
            }
            None => adaptive_energies(map, boundary.domain(), target_volume, &options, &accuracy),
        })??;
        let mesh = given.as_deref().or(own.as_ref());
        if let Some(path) = vtu {
            let _ = watch.tell(|| step("writing"));
            let images = chosen(&file, kind).evaluate(quadrature.points());
            let distances = distance_field(&boundary.outward_target(), &images)?;
            files::write_cell_means(
                &path,
                &quadrature,
                mesh,
                &files::energy_fields(&report.densities, &distances),
            )?;
        }
        let places = worst_places(&quadrature, &report.densities, target_volume, mesh, arguments.worst);
        let mut all = value_of(&report)?;
        all["map_kind"] = json!(kind_name(kind));
        all["cells"] = json!(quadrature.cell_means(&report.densities.harmonic).len());
        all["points"] = json!(quadrature.points().len());
        all["worst_places"] = value_of(&places)?;
        all["warnings"] = json!(warnings);
        Ok(all.to_string())
    })
}

pub fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Harmonic => "harmonic",
        Kind::Bijective => "bijective",
    }
}

/// Densities of both energies and `det J` at points.
#[pyfunction]
#[pyo3(signature = (map, points, arguments, kind=None))]
#[allow(clippy::type_complexity, reason = "columns of a table")]
pub fn energy_densities<'py>(
    py: Python<'py>,
    map: &Map,
    points: PyReadonlyArray2<'py, f64>,
    arguments: EnergyArguments,
    kind: Option<&str>,
) -> PyResult<(
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
)> {
    let (file, kind, options) = (Arc::clone(&map.file), map.kind(kind)?, arguments.options()?);
    let points = Points::of("points", &points)?;
    let found = run(py, None, None, move |watch| {
        let boundary = boundary_of(&file)?;
        let (volume, target_volume) = (boundary.domain().volume(), boundary.target_volume());
        let poll = || watch.tell(|| step("evaluating"));
        Ok(with_cancellation(chosen(&file, kind), &poll, |map| {
            densities(map, &points, volume, target_volume, &options)
        })??)
    })?;
    Ok((
        PyArray1::from_vec(py, found.harmonic),
        PyArray1::from_vec(py, found.deformation),
        PyArray1::from_vec(py, found.det_jacobian),
    ))
}

/// Means of the usual metrics of distortion.
#[pyfunction]
#[pyo3(signature = (map, resolution, mesh=None, kind=None, progress=None))]
pub fn distortions(
    py: Python,
    map: &Map,
    resolution: usize,
    mesh: Option<&Cells>,
    kind: Option<&str>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (file, kind) = (Arc::clone(&map.file), map.kind(kind)?);
    let mesh = mesh.map(|mesh| Arc::clone(&mesh.0));
    run(py, progress, None, move |watch| {
        let boundary = boundary_of(&file)?;
        let quadrature: Quadrature = match &mesh {
            Some(mesh) => domain_mesh_quadrature(mesh, boundary.domain())?.quadrature,
            None => clipped_grid(boundary.domain(), GridResolution::CellsAlongLongestSide(resolution))?,
        };
        let poll = || watch.tell(|| step("integrating"));
        let found = with_cancellation(chosen(&file, kind), &poll, |map: &dyn VolumeMap| {
            distortion(map, &quadrature, quadrature.volume(), boundary.target_volume())
        })??;
        to_json(&found)
    })
}

fn certifying(at: CertificateProgress) -> Step {
    let CertificateProgress {
        level,
        done,
        of: all,
        undecided,
    } = at;
    let fraction = (all > 0).then(|| done as f64 / all as f64);
    let detail = format!("level {level}, {:.2} % undecided", 100.0 * undecided);
    of("dividing cells", fraction, detail)
}

/// Cells, and fields with one value for each.
pub type CellsWithFields<'py> = (Cells, Vec<(String, Bound<'py, PyArray1<f64>>)>);

/// Scalar fields as arrays by their names.
pub fn arrays_of(py: Python<'_>, fields: Vec<Field>) -> Vec<(String, Bound<'_, PyArray1<f64>>)> {
    let of = |field: Field| (field.name, PyArray1::from_vec(py, field.values));
    fields.into_iter().map(of).collect()
}

/// What is proved of the map's orientation, and where; where they are asked for, with the cells and what is known of each.
#[pyfunction]
#[pyo3(signature = (map, finest, max_cells, undecided, worst, with_cells, kind=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "it is called from Python, by keywords")]
pub fn certificate<'py>(
    py: Python<'py>,
    map: &Map,
    finest: usize,
    max_cells: usize,
    undecided: f64,
    worst: usize,
    with_cells: bool,
    kind: Option<&str>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(String, Option<CellsWithFields<'py>>)> {
    let (file, kind) = (Arc::clone(&map.file), map.kind(kind)?);
    let options = CertificateOptions {
        finest,
        max_cells,
        undecided,
    };
    let (report, cells) = run(py, progress, None, move |watch| {
        if let (Some(bijective), Kind::Bijective) = (&file.bijective, kind) {
            let _ = watch.tell(|| step("checking tetrahedra"));
            let found = bijective.map.certificate(self_intersection_finder());
            let mut all = value_of(&found)?;
            all["map_kind"] = json!("bijective");
            all["one_to_one"] = json!(found.is_one_to_one());
            return Ok((all.to_string(), None));
        }
        let boundary = boundary_of(&file)?;
        let found = certify(
            &file.map,
            boundary.domain(),
            boundary.target_volume(),
            &options,
            &|at| watch.tell(|| certifying(at)),
        )?;
        let mut cells = None;
        if with_cells {
            let _ = watch.tell(|| step("collecting cells"));
            let merged = found.merged(&file.map);
            let (points, hexes) = merged.hexahedra();
            let regions = vec![1; hexes.len()];
            let mesh = CellMesh::new(points, CellList::Hexes(hexes), regions)?;
            cells = Some((mesh, files::certificate_fields(&merged)));
        }
        let (folded, undecided) = (found.folded_places(), found.undecided_places());
        let report = found.report;
        let mut all = value_of(&report)?;
        all["map_kind"] = json!("harmonic");
        all["cells"] = json!(found.cells().len());
        all["locally_one_to_one"] = json!(report.stop_reason == StopReason::AllDecided && report.folded.cells == 0);
        all["folded_places"] = json!(folded.len());
        all["undecided_places"] = json!(undecided.len());
        let places: Vec<_> = folded.into_iter().chain(undecided).take(worst).collect();
        all["worst_places"] = value_of(&places)?;
        Ok((all.to_string(), cells))
    })?;
    let cells = cells.map(|(mesh, fields)| (Cells::of(mesh), arrays_of(py, fields)));
    Ok((report, cells))
}
