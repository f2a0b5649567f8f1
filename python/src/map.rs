//! Fitted maps: images, Jacobians, preimages, and their files.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::prelude::*;
use solidmap::bijective::BijectiveMap;
use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, MapFile, MapMetadata, Provenance};
use solidmap::fit::{Fit, FitReport, FitTimings, worst_places};
use solidmap::inverse::{Inverse, InverseMap, InverseOptions, InverseReport, Preimage};
use solidmap::map::{HarmonicMap, VolumeMap, with_cancellation};
use solidmap::{Matrix3, Point};

use crate::arrays::{Points, copy_of_points, copy_of_rows, from_matrices, from_points};
use crate::boundary::Boundary;
use crate::error::{ErrorKind, Failure};
use crate::meshes::{Cells, json};
use crate::run::{Watch, part, run, run_briefly, step};

/// Which map of a file is used.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Harmonic,
    Bijective,
}

/// A fitted map, with all that its file holds.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Map {
    pub file: Arc<MapFile>,
    /// The report with timings, which the file leaves out.
    report: Option<FitReport>,
    /// What finds preimages, made when it is first needed.
    inverse: Mutex<Option<Arc<PreparedInverse>>>,
}

impl Map {
    pub fn of(fit: Fit, inputs: Vec<Provenance>) -> Self {
        let Fit {
            map, boundary, report, ..
        } = fit;
        let file = MapFile {
            map,
            boundary: Some(boundary),
            bijective: None,
            metadata: MapMetadata::new(report.clone(), inputs),
        };
        Self::of_file(file, Some(report))
    }

    pub fn of_file(file: MapFile, report: Option<FitReport>) -> Self {
        Self {
            file: Arc::new(file),
            report,
            inverse: Mutex::new(None),
        }
    }

    pub fn report(&self) -> Option<&FitReport> {
        self.report.as_ref()
    }

    /// The map that was asked for: by default the bijective one, where the file has it.
    pub fn kind(&self, name: Option<&str>) -> Result<Kind, Failure> {
        match (name, &self.file.bijective) {
            (Some("harmonic"), _) | (None, None) => Ok(Kind::Harmonic),
            (_, Some(_)) => Ok(Kind::Bijective),
            (_, None) => Err(Failure::new(
                ErrorKind::Unsupported,
                "there is no bijective map; make_bijective makes one",
            )),
        }
    }

    /// What finds preimages, if it was made before.
    pub fn kept_inverse(&self, kind: Kind, tolerance: f64) -> Option<Arc<PreparedInverse>> {
        let kept = self.inverse.lock().unwrap_or_else(PoisonError::into_inner).clone();
        kept.filter(|kept| kept.serves(kind, tolerance))
    }

    pub fn keep_inverse(&self, made: Arc<PreparedInverse>) {
        *self.inverse.lock().unwrap_or_else(PoisonError::into_inner) = Some(made);
    }
}

/// One of the maps of a file.
pub fn chosen(file: &MapFile, kind: Kind) -> &dyn VolumeMap {
    match (&file.bijective, kind) {
        (Some(bijective), Kind::Bijective) => &bijective.map,
        _ => &file.map,
    }
}

/// The boundary map of a file, which everything but evaluation needs.
pub fn boundary_of(file: &MapFile) -> Result<&BoundaryMap, Failure> {
    file.boundary.as_ref().ok_or_else(|| {
        Failure::new(
            ErrorKind::Unsupported,
            "the map's file holds no boundary map, so its domain is not known: another program wrote it",
        )
    })
}

/// What finds preimages under a map.
pub struct PreparedInverse {
    tolerance: f64,
    search: Search,
}

enum Search {
    Newton(Box<NewtonSearch>),
    Location(Box<BijectiveMap>),
}

/// By Newton's method.
struct NewtonSearch {
    /// Borrows from the two others. Declared first, so that it is dropped first.
    inverse: InverseMap<'static>,
    _map: Box<HarmonicMap>,
    _file: Arc<MapFile>,
}

impl PreparedInverse {
    pub fn new(file: Arc<MapFile>, kind: Kind, tolerance: f64) -> Result<Self, Failure> {
        if let (Some(bijective), Kind::Bijective) = (&file.bijective, kind) {
            let search = Search::Location(Box::new(bijective.map.clone()));
            return Ok(Self { tolerance, search });
        }
        let options = InverseOptions {
            tolerance,
            ..InverseOptions::default()
        };
        // Sums as accurate as Newton's method needs.
        let exact = Box::new(file.map.clone().with_error(0.0));
        let map: *const HarmonicMap = &raw const *exact;
        let boundary: *const BoundaryMap = boundary_of(&file)?;
        // SAFETY: both are on the heap, do not move when the struct does, are never written to, and are dropped after what
        // borrows from them.
        let (map, boundary) = unsafe { (&*map, &*boundary) };
        let search = Search::Newton(Box::new(NewtonSearch {
            inverse: InverseMap::new(map, boundary, &options)?,
            _map: exact,
            _file: file,
        }));
        Ok(Self { tolerance, search })
    }

    fn serves(&self, kind: Kind, tolerance: f64) -> bool {
        match self.search {
            Search::Newton(..) => kind == Kind::Harmonic && self.tolerance == tolerance,
            Search::Location(_) => kind == Kind::Bijective,
        }
    }

    pub fn inverse(&self) -> &dyn Inverse {
        match &self.search {
            Search::Newton(search) => &search.inverse,
            Search::Location(map) => &**map,
        }
    }

    fn preimages(&self, points: &[Point], watch: &Watch) -> Result<(Vec<Preimage>, InverseReport), Failure> {
        match &self.search {
            Search::Newton(search) => Ok(search.inverse.preimages_with_progress(points, &|done| {
                watch.tell(|| part("searching preimages", done, points.len()))
            })?),
            Search::Location(map) => Ok(map.preimages(points)),
        }
    }
}

/// Points times sources up to which a map is evaluated on the calling thread: less than some milliseconds.
const BRIEF: usize = 2_000_000;

impl Map {
    /// Values of the map at points, by `f`: at once, or on another thread where it takes long enough to be interrupted.
    fn at_points<T: Send + 'static>(
        &self,
        py: Python<'_>,
        points: &PyReadonlyArray2<'_, f64>,
        kind: Kind,
        f: impl Fn(&dyn VolumeMap, &[Point]) -> T + Send + Sync + 'static,
    ) -> PyResult<T> {
        let points = Points::of("points", points)?;
        let work = points.len().saturating_mul(self.file.map.sources().len().max(1));
        if work <= BRIEF {
            return run_briefly(py, || f(chosen(&self.file, kind), &points));
        }
        let file = Arc::clone(&self.file);
        run(py, None, None, move |_| Ok(f(chosen(&file, kind), &points)))
    }
}

#[pymethods]
impl Map {
    /// A map file. `seconds` are the timings of the fit, as JSON, where they are known.
    #[staticmethod]
    #[pyo3(signature = (path, seconds=None))]
    fn read(py: Python, path: PathBuf, seconds: Option<String>) -> PyResult<Self> {
        run(py, None, None, move |_| {
            let file = files::read_map(&path)?;
            let seconds: Option<FitTimings> = seconds.and_then(|seconds| serde_json::from_str(&seconds).ok());
            let report = file.metadata.fit.clone().map(|report| FitReport { seconds, ..report });
            Ok(Self::of_file(file, report))
        })
    }

    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let file = Arc::clone(&self.file);
        run(py, None, None, move |_| Ok(files::write_map(&path, &file)?))
    }

    #[pyo3(signature = (points, map=None))]
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        map: Option<&str>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let kind = self.kind(map)?;
        let images = self.at_points(py, &points, kind, |map, points| map.evaluate(points))?;
        from_points(py, images)
    }

    #[pyo3(signature = (points, map=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        map: Option<&str>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let kind = self.kind(map)?;
        let found: Vec<Matrix3> = self.at_points(py, &points, kind, |map, points| map.jacobian(points))?;
        from_matrices(py, found)
    }

    /// Preimages (NaN where there is none), their status, their round trips, how many there are, and the report.
    #[pyo3(signature = (points, tolerance, map=None, progress=None))]
    #[allow(clippy::type_complexity, reason = "columns of a table")]
    fn preimages<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        tolerance: f64,
        map: Option<&str>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<u8>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<u32>>,
        String,
    )> {
        let (kind, points) = (self.kind(map)?, Points::of("points", &points)?);
        let kept = self.kept_inverse(kind, tolerance);
        let file = Arc::clone(&self.file);
        let (prepared, (found, report)) = run(py, progress, None, move |watch| {
            let _ = watch.tell(|| step("mapping the seed mesh"));
            let prepared = match kept {
                Some(kept) => kept,
                None => Arc::new(PreparedInverse::new(file, kind, tolerance)?),
            };
            let found = prepared.preimages(&points, watch)?;
            Ok((prepared, found))
        })?;
        self.keep_inverse(prepared);
        Ok((
            from_points(py, found.iter().map(Preimage::position).collect())?,
            PyArray1::from_vec(py, found.iter().map(|p| p.status as u8).collect()),
            PyArray1::from_vec(py, found.iter().map(|p| p.round_trip).collect()),
            PyArray1::from_vec(py, found.iter().map(|p| p.preimages as u32).collect()),
            json(&report)?,
        ))
    }

    #[getter]
    fn sources<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_points(py, self.file.map.sources())
    }

    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_rows(py, &self.file.map.coefficients().sources)
    }

    #[getter]
    fn affine<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_rows(py, &self.file.map.coefficients().affine)
    }

    #[getter]
    fn boundary(&self) -> PyResult<Boundary> {
        Ok(Boundary::of(
            boundary_of(&self.file)?.clone(),
            self.file.metadata.inputs.clone(),
        ))
    }

    /// The report of the fit, if the file has one.
    #[getter]
    fn report_json(&self) -> PyResult<Option<String>> {
        Ok(self.report().map(json).transpose()?)
    }

    #[getter]
    fn metadata_json(&self) -> PyResult<String> {
        Ok(json(&self.file.metadata)?)
    }

    #[getter]
    fn has_bijective(&self) -> bool {
        self.file.bijective.is_some()
    }

    #[getter]
    fn bijective_json(&self) -> PyResult<Option<String>> {
        Ok(self
            .file
            .bijective
            .as_ref()
            .map(|found| json(&found.report))
            .transpose()?)
    }

    /// The tetrahedra of the bijective map, in the domain and in the target.
    fn bijective_tets(&self) -> PyResult<(Cells, Cells)> {
        let found = self.file.bijective.as_ref();
        let found = found.ok_or_else(|| Failure::new(ErrorKind::Unsupported, "there is no bijective map"))?;
        let [domain, target] = [found.map.domain(), found.map.target()].map(|mesh| Cells::of(mesh.clone().into()));
        Ok((domain, target))
    }

    /// Writes the domain's surface with both images of each vertex and their distance.
    #[pyo3(signature = (path, map=None))]
    fn write_fields(&self, py: Python, path: PathBuf, map: Option<&str>) -> PyResult<()> {
        let (file, kind) = (Arc::clone(&self.file), self.kind(map)?);
        run(py, None, None, move |_| {
            Ok(files::write_fit_fields(
                &path,
                boundary_of(&file)?,
                chosen(&file, kind),
            )?)
        })
    }

    /// Where the boundary error is largest.
    fn worst_places(&self, py: Python, most: usize) -> PyResult<String> {
        let file = Arc::clone(&self.file);
        run(py, None, None, move |watch| {
            let boundary = boundary_of(&file)?;
            let found = with_cancellation(&file.map, &|| watch.tell(|| step("measuring")), |_| {
                worst_places(&file.map, boundary, most)
            })?;
            json(&found)
        })
    }
}
