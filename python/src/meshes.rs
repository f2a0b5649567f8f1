//! Surfaces, and meshes of tetrahedra or hexahedra.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::prelude::*;
use serde::Serialize;
use solidmap::Point;
use solidmap::check;
use solidmap::fit::self_intersection_finder;
use solidmap::geometry::SurfaceQuery;
use solidmap::io::{self, SolidMesh};
use solidmap::mesh::{CellList, CellMesh, SurfaceMesh, TetMesh, shapes};
use solidmap::remesh::{determinants, invalid_cells, quality, scaled_jacobians};

use crate::arrays::{Points, copy_of_points, copy_of_rows, entries, rows};
use crate::error::{ErrorKind, Failure};
use crate::run::{run, run_briefly};

/// A report as the program prints it with `--json`.
pub fn json(report: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string(report).map_err(|error| Failure::new(ErrorKind::Internal, error.to_string()))
}

/// A triangle mesh.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Surface(pub Arc<SurfaceMesh>);

impl Surface {
    pub fn of(surface: SurfaceMesh) -> Self {
        Self(Arc::new(surface))
    }
}

#[pymethods]
impl Surface {
    /// `name` is the argument's that the arrays came in, for messages.
    #[new]
    fn new(name: &str, vertices: PyReadonlyArray2<f64>, triangles: PyReadonlyArray2<u32>) -> PyResult<Self> {
        let points = Points::of(name, &vertices)?.to_vec();
        let triangles = rows::<u32, 3>(name, &triangles)?.to_vec();
        let surface = SurfaceMesh::new(points, triangles);
        Ok(Self::of(
            surface.map_err(|error| Failure::invalid(format!("{name}: {error}")))?,
        ))
    }

    /// The surface in a file, or the boundary of the cells in it.
    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Self> {
        run(py, None, None, move |_| {
            Ok(Self::of(io::read_solid(path)?.into_surface()))
        })
    }

    /// A surface in a file with the faces of another, its polygons cut like that one's.
    #[staticmethod]
    fn read_image(py: Python, path: PathBuf, domain: &Self) -> PyResult<Self> {
        let domain = Arc::clone(&domain.0);
        run(py, None, None, move |_| {
            let read = io::read_solid(&path)?.into_surface();
            let is_cut_otherwise =
                read.triangles().len() == domain.triangles().len() && read.triangles() != domain.triangles();
            Ok(Self::of(match is_cut_otherwise {
                true => io::read_surface_as(&path, &domain)?,
                false => read,
            }))
        })
    }

    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let surface = Arc::clone(&self.0);
        run(py, None, None, move |_| Ok(io::write_surface(path, &surface)?))
    }

    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_points(py, self.0.vertices())
    }

    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u32>> {
        copy_of_rows(py, self.0.triangles())
    }

    #[getter]
    fn area(&self) -> f64 {
        self.0.area()
    }

    #[getter]
    fn volume(&self) -> f64 {
        self.0.volume()
    }

    #[getter]
    fn diagonal(&self) -> f64 {
        self.0.diagonal()
    }

    /// The report, and its text.
    fn check(&self, py: Python, progress: Option<&Bound<'_, PyAny>>) -> PyResult<(String, String, bool)> {
        let surface = Arc::clone(&self.0);
        run(py, progress, None, move |_| {
            let report = check::check(&surface, self_intersection_finder());
            Ok((json(&report)?, report.to_string(), report.is_solvable()))
        })
    }

    /// The surface with solids facing outward, and what was done.
    fn repaired(&self, py: Python) -> PyResult<(Self, Vec<String>)> {
        let surface = Arc::clone(&self.0);
        run(py, None, None, move |_| {
            let (repaired, repairs) = check::repair(&surface);
            Ok((Self::of(repaired), repairs.iter().map(ToString::to_string).collect()))
        })
    }

    /// Signed distances, negative inside.
    fn signed_distance<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (surface, points) = (Arc::clone(&self.0), Points::of("points", &points)?);
        let found = run(py, None, None, move |_| {
            // Also right where parts of the surface overlap.
            Ok(SurfaceQuery::with_winding_sign(&surface)?.signed_distances(&points))
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    #[staticmethod]
    fn sphere(py: Python, radius: f64, levels: u32) -> PyResult<Self> {
        run_briefly(py, || Self::of(shapes::sphere(radius, levels)))
    }

    #[staticmethod]
    fn cube(py: Python, size: f64, divisions: usize) -> PyResult<Self> {
        run_briefly(py, || Self::of(shapes::cube(size, divisions)))
    }

    #[staticmethod]
    fn torus(py: Python, major: f64, minor: f64, around: usize, across: usize) -> PyResult<Self> {
        run_briefly(py, || Self::of(shapes::torus(major, minor, around, across)))
    }

    #[staticmethod]
    fn polycube(py: Python, cubes: Vec<[i32; 3]>, divisions: usize) -> PyResult<Self> {
        run_briefly(py, || Self::of(shapes::polycube(&cubes, divisions)))
    }
}

/// A mesh of tetrahedra or hexahedra.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Cells(pub Arc<CellMesh>);

impl Cells {
    pub fn of(mesh: CellMesh) -> Self {
        Self(Arc::new(mesh))
    }

    /// The tetrahedra; an error for a mesh of hexahedra.
    pub fn tets(&self, name: &str) -> Result<TetMesh, Failure> {
        tets_of((*self.0).clone(), name)
    }
}

/// The tetrahedra of a mesh; an error for one of hexahedra.
pub fn tets_of(mesh: CellMesh, name: &str) -> Result<TetMesh, Failure> {
    match mesh.into_parts() {
        (nodes, CellList::Tets(tets), _) => Ok(TetMesh::new(nodes, tets)?),
        _ => Err(Failure::invalid(format!(
            "{name} has hexahedra, but must be a mesh of tetrahedra"
        ))),
    }
}

/// The cells of an array with four or eight columns.
pub fn cell_list(name: &str, cells: &PyReadonlyArray2<u32>) -> Result<CellList, Failure> {
    use numpy::PyUntypedArrayMethods;
    Ok(match cells.shape()[1] {
        4 => CellList::Tets(rows::<u32, 4>(name, cells)?.to_vec()),
        8 => CellList::Hexes(rows::<u32, 8>(name, cells)?.to_vec()),
        n => {
            return Err(Failure::invalid(format!(
                "{name} has cells of {n} corners, but they must have 4 (tetrahedra) or 8 (hexahedra)"
            )));
        }
    })
}

#[pymethods]
impl Cells {
    /// `name` is the argument's that the arrays came in, for messages.
    #[new]
    #[pyo3(signature = (name, points, cells, regions=None))]
    fn new(
        name: &str,
        points: PyReadonlyArray2<f64>,
        cells: PyReadonlyArray2<u32>,
        regions: Option<PyReadonlyArray1<i32>>,
    ) -> PyResult<Self> {
        let (points, cells) = (Points::of(name, &points)?.to_vec(), cell_list(name, &cells)?);
        let regions = match regions {
            Some(regions) => entries("regions", &regions)?,
            None => vec![1; cells.len()],
        };
        let mesh = CellMesh::new(points, cells, regions);
        Ok(Self::of(
            mesh.map_err(|error| Failure::invalid(format!("{name}: {error}")))?,
        ))
    }

    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Self> {
        run(py, None, None, move |_| Ok(Self::of(io::read_cells(path)?)))
    }

    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let mesh = Arc::clone(&self.0);
        run(py, None, None, move |_| Ok(io::write_cell_mesh(path, &mesh)?))
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_points(py, self.0.nodes())
    }

    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u32>> {
        match self.0.cells() {
            CellList::Tets(tets) => copy_of_rows(py, tets),
            CellList::Hexes(hexes) => copy_of_rows(py, hexes),
        }
    }

    #[getter]
    fn regions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i32>> {
        self.0.regions().to_pyarray(py)
    }

    #[getter]
    fn volume(&self) -> f64 {
        self.0.volume()
    }

    /// The boundary surface.
    fn boundary(&self, py: Python) -> PyResult<Surface> {
        let mesh = Arc::clone(&self.0);
        run_briefly(py, move || Surface::of(mesh.boundary().surface))
    }

    /// The quality of all cells together, `null` without any.
    fn quality(&self, py: Python) -> PyResult<String> {
        let mesh = Arc::clone(&self.0);
        run(py, None, None, move |_| json(&quality(mesh.cells(), mesh.nodes())))
    }

    fn scaled_jacobians<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mesh = Arc::clone(&self.0);
        let found = run(py, None, None, move |_| {
            Ok(scaled_jacobians(mesh.cells(), mesh.nodes()))
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// The cells that are inverted or flat, decided exactly.
    fn inverted<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let mesh = Arc::clone(&self.0);
        let found = run(py, None, None, move |_| {
            Ok(invalid_cells(mesh.cells(), mesh.nodes()).cells)
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// The determinants of the cells' maps from this mesh to the same cells with other points.
    fn determinants<'py>(
        &self,
        py: Python<'py>,
        images: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (mesh, images) = (Arc::clone(&self.0), Points::of("images", &images)?);
        if images.len() != mesh.nodes().len() {
            let (found, expected) = (images.len(), mesh.nodes().len());
            return Err(Failure::invalid(format!("images has {found} rows for {expected} points")).into());
        }
        let found = run(py, None, None, move |_| {
            Ok(determinants(mesh.cells(), mesh.nodes(), &images))
        })?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// The report on the cells, its text, and whether they are valid.
    fn check(&self, py: Python, progress: Option<&Bound<'_, PyAny>>) -> PyResult<(String, String, bool)> {
        let mesh = Arc::clone(&self.0);
        run(py, progress, None, move |_| {
            let report = check::examine_cells(&mesh);
            Ok((json(&report)?, report.to_string(), report.is_valid()))
        })
    }
}

/// What a file holds: a surface or cells.
#[pyfunction]
pub fn read_solid(py: Python, path: PathBuf) -> PyResult<(Option<Surface>, Option<Cells>)> {
    run(py, None, None, move |_| {
        Ok(match io::read_solid(path)? {
            SolidMesh::Surface(surface) => (Some(Surface::of(surface)), None),
            SolidMesh::Cells(mesh) => (None, Some(Cells::of(mesh))),
        })
    })
}

/// The points of a table or mesh.
#[pyfunction]
pub fn read_points(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let points: Vec<Point> = run(py, None, None, move |_| Ok(io::read_points(path)?))?;
    crate::arrays::from_points(py, points)
}
