//! Maps of one boundary map by several methods, measured alike.

use std::sync::Arc;

use pyo3::prelude::*;
use serde_json::{Value, json};
use solidmap::baseline::{DescentOptions, HarmonicOptions};
use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::{
    BuildOptions, CompareError, ComparedMethod, EvaluationOptions, InteriorImages, MapEvaluator, MapFigures, MeshSpec,
    Reference, TetMesher, Variation, build, equal_accuracy, frame_timings, measured_map, outward, reference, spread,
};
use solidmap::energy::volmap_metrics;
use solidmap::fit::{FitMethod, FitOptions};
use solidmap::mesh::{SurfaceMesh, TetMesh};
use solidmap::solver::SchwarzOptions;

use crate::boundary::{Boundary, value_of};
use crate::error::Failure;
use crate::meshes::{Cells, Surface, json as to_json};
use crate::run::{Watch, run, step};

/// The program's options of comparisons.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct CompareArguments {
    methods: Vec<String>,
    mesh_size: Option<f64>,
    quality: f64,
    mesher: String,
    tolerance: f64,
    resolution: usize,
    interior: usize,
    threshold: f64,
    seed: u64,
    max_tets: usize,
    memory: Option<u64>,
    no_reference: bool,
    equal_accuracy: bool,
    mesh_study: bool,
}

fn method_of(name: &str) -> Result<ComparedMethod, Failure> {
    let found = ComparedMethod::ALL.into_iter().find(|method| method.name() == name);
    found.ok_or_else(|| {
        let names: Vec<&str> = ComparedMethod::ALL.iter().map(|method| method.name()).collect();
        Failure::invalid(format!("methods has \"{name}\", but knows only {}", names.join(", ")))
    })
}

impl CompareArguments {
    fn spec(&self, boundary: &BoundaryMap) -> MeshSpec {
        let usual = MeshSpec::of(boundary.domain());
        MeshSpec {
            source: match self.mesher.as_str() {
                "cgal" => TetMesher::Mesh3,
                _ => TetMesher::Tetgen,
            },
            edge: self.mesh_size.or(usual.edge),
            quality: self.quality,
            most_tets: self.max_tets,
            ..usual
        }
    }
}

/// Maps by several methods, and what was asked for beside: the reference, finer maps, studies of meshes, the time of frames.
/// Methods that cannot make a map have an `error`.
#[pyfunction]
#[pyo3(signature = (boundary, arguments, mesh=None, frames=None, progress=None))]
pub fn compare(
    py: Python,
    boundary: &Boundary,
    arguments: CompareArguments,
    mesh: Option<&Cells>,
    frames: Option<Vec<PyRef<'_, Surface>>>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (file, given) = (Arc::clone(&boundary.0), mesh.map(|mesh| mesh.tets("mesh")).transpose()?);
    let methods: Vec<ComparedMethod> = arguments
        .methods
        .iter()
        .map(|name| method_of(name))
        .collect::<Result<_, _>>()?;
    let frames = frames.unwrap_or_default();
    let frames: Vec<Arc<SurfaceMesh>> = frames.iter().map(|frame| Arc::clone(&frame.0)).collect();
    run(py, progress, None, move |watch| {
        let boundary = outward(file.boundary.clone())?;
        let frames = Frames::of(boundary.domain(), &frames)?;
        watch.tell_or_unwind(|| step("placing sample points"));
        let options = EvaluationOptions {
            resolution: arguments.resolution,
            interior: arguments.interior,
            seed: arguments.seed,
            ..EvaluationOptions::default()
        };
        let evaluator = MapEvaluator::new(&boundary, &options)?;
        let mut compared = Compared {
            boundary: &boundary,
            spec: arguments.spec(&boundary),
            arguments: &arguments,
            given: given.as_ref(),
            evaluator: &evaluator,
            reference: None,
            watch,
        };
        let mut found = json!({ "reference": null, "warnings": [] });
        if !arguments.no_reference {
            match compared.or_text(compared.make_reference())? {
                Ok((images, report)) => {
                    compared.reference = Some(images);
                    found["reference"] = value_of(&report)?;
                }
                Err(error) => {
                    let warning = format!("no reference could be made, so maps are not compared inside: {error}");
                    found["warnings"] = json!([warning]);
                }
            }
        }
        let rows: Vec<Row> = methods
            .iter()
            .map(|&method| compared.row(&compared.variation(method)))
            .collect::<Result<_, _>>()?;
        found["methods"] = rows.iter().map(Row::value).collect::<Result<_, _>>()?;
        found["equal_accuracy"] = compared.equal_accuracy(&rows)?;
        found["mesh_study"] = compared.mesh_study(&methods)?;
        found["sequence"] = compared.sequence(&methods, &frames)?;
        Ok(found.to_string())
    })
}

/// Boundary maps to frames, and why other frames were skipped.
struct Frames {
    maps: Vec<BoundaryMap>,
    skipped: Vec<String>,
}

impl Frames {
    /// None at all, or some that can be used.
    fn of(domain: &SurfaceMesh, frames: &[Arc<SurfaceMesh>]) -> Result<Self, Failure> {
        let (mut maps, mut skipped) = (vec![], vec![]);
        for (number, frame) in frames.iter().enumerate() {
            match BoundaryMap::between(domain.clone(), frame) {
                Ok(map) => maps.push(map),
                Err(error) => skipped.push(format!("frame {number}: {error}")),
            }
        }
        if maps.is_empty() && !skipped.is_empty() {
            return Err(Failure::invalid(format!(
                "frames has none that can be used: {}",
                skipped.join("; ")
            )));
        }
        Ok(Self { maps, skipped })
    }
}

/// A method, and its figures or why there are none.
struct Row {
    method: ComparedMethod,
    found: Result<(MapFigures, InteriorImages), String>,
}

impl Row {
    fn figures(&self) -> Option<&MapFigures> {
        self.found.as_ref().ok().map(|(figures, _)| figures)
    }

    fn value(&self) -> Result<Value, Failure> {
        let mut row = match &self.found {
            Ok((figures, _)) => value_of(figures)?,
            Err(error) => json!({ "error": error }),
        };
        row["name"] = json!(self.method.name());
        row["total_seconds"] = json!(self.figures().map(MapFigures::total_seconds));
        Ok(row)
    }

    fn value_with(&self, what: &str) -> Result<Value, Failure> {
        let mut row = self.value()?;
        row["what"] = json!(what);
        Ok(row)
    }
}

struct Compared<'a> {
    boundary: &'a BoundaryMap,
    spec: MeshSpec,
    arguments: &'a CompareArguments,
    given: Option<&'a TetMesh>,
    evaluator: &'a MapEvaluator<'a>,
    reference: Option<InteriorImages>,
    watch: &'a Watch,
}

impl Compared<'_> {
    /// A method as it is run for the table.
    fn variation(&self, method: ComparedMethod) -> Variation {
        Variation::of(method, self.arguments.tolerance, self.spec)
    }

    fn options(&self, varied: &Variation) -> BuildOptions<'_> {
        BuildOptions {
            method: varied.method,
            fit: FitOptions {
                tolerance: varied.tolerance,
                method: FitMethod::Schwarz {
                    alpha: varied.alpha,
                    options: SchwarzOptions::default(),
                },
                memory: self.arguments.memory,
                seed: self.arguments.seed,
                ..FitOptions::default()
            },
            harmonic: HarmonicOptions::default(),
            descent: DescentOptions {
                threshold: self.arguments.threshold,
                ..DescentOptions::default()
            },
            mesh: varied.mesh,
            given: self.given,
        }
    }

    /// What a call found, or its error as a text, unless the work was cancelled.
    fn or_text<T>(&self, found: Result<T, impl Into<Failure>>) -> Result<Result<T, String>, Failure> {
        match found.map_err(Into::into) {
            Ok(found) => Ok(Ok(found)),
            Err(failure) if self.watch.is_cancelled() => Err(failure),
            Err(failure) => Ok(Err(failure.message().to_owned())),
        }
    }

    fn make_reference(&self) -> Result<(InteriorImages, Reference), CompareError> {
        let fit = self.options(&self.variation(ComparedMethod::Mfs)).fit;
        let tell = |what: String| self.watch.tell_or_unwind(|| step(&format!("reference: {what}")));
        let (made, report) = reference(self.boundary, &fit, self.evaluator, &tell)?;
        Ok((self.evaluator.interior_images(&made.map)?, report))
    }

    fn row(&self, varied: &Variation) -> Result<Row, Failure> {
        let method = varied.method;
        let tell = |what: String| {
            let name = format!("{}, {}: {what}", method.name(), varied.what);
            self.watch.tell_or_unwind(|| step(&name));
        };
        let options = self.options(varied);
        let made = build(self.boundary, &options, &tell).and_then(|built| {
            let reference = self.reference.as_ref();
            measured_map(self.boundary, &options, built, self.evaluator, reference, &tell)
        });
        let found = self.or_text(made.map(|made| (made.figures, made.interior)))?;
        Ok(Row { method, found })
    }

    fn equal_accuracy(&self, rows: &[Row]) -> Result<Value, Failure> {
        if !self.arguments.equal_accuracy {
            return Ok(json!([]));
        }
        let of_mfs = rows.iter().find(|row| row.method == ComparedMethod::Mfs);
        let goal = of_mfs.and_then(|row| Some((row, row.figures()?.interior_difference?.rms)));
        // The map by mfs or the reference failed, which is told there.
        let Some((mfs, goal)) = goal else {
            return Ok(json!([]));
        };
        let base = self.variation(ComparedMethod::Mfs);
        let mut run = |varied: &Variation| self.row(varied);
        fn figures(row: &Result<Row, Failure>) -> Option<&MapFigures> {
            row.as_ref().ok().and_then(Row::figures)
        }
        let mut steps = vec![mfs.value_with(&base.what)?];
        for (varied, row) in equal_accuracy(self.boundary.domain(), &base, goal, &mut run, figures) {
            steps.push(row?.value_with(&varied.what)?);
        }
        Ok(Value::from(steps))
    }

    fn mesh_study(&self, methods: &[ComparedMethod]) -> Result<Value, Failure> {
        let mut studies = vec![];
        let studied = methods.iter().filter(|method| method.is_prepared());
        for &method in studied.filter(|_| self.arguments.mesh_study) {
            let (mut runs, mut images) = (vec![], vec![]);
            for varied in self.variation(method).study() {
                let row = self.row(&varied)?;
                runs.push(row.value_with(&varied.what)?);
                images.extend(row.found.ok().map(|(_, images)| images));
            }
            let spread = spread(&images, self.boundary.target_diagonal());
            studies.push(json!({ "method": method.name(), "runs": runs, "spread": value_of(&spread)? }));
        }
        Ok(Value::from(studies))
    }

    fn sequence(&self, methods: &[ComparedMethod], frames: &Frames) -> Result<Value, Failure> {
        if frames.maps.is_empty() {
            return Ok(json!([]));
        }
        let mut rows = vec![];
        for &method in methods.iter().filter(|method| method.is_prepared()) {
            let tell = |what: String| {
                self.watch
                    .tell_or_unwind(|| step(&format!("sequence, {}: {what}", method.name())))
            };
            let options = self.options(&self.variation(method));
            let mut row = match self.or_text(frame_timings(self.boundary, &frames.maps, &options, &tell))? {
                Ok(timings) => value_of(&timings)?,
                Err(error) => json!({ "error": error }),
            };
            row["method"] = json!(method.name());
            row["skipped"] = json!(frames.skipped);
            rows.push(row);
        }
        Ok(Value::from(rows))
    }
}

/// The metrics of VOLMAP of the map from one mesh of tetrahedra to another.
#[pyfunction]
pub fn mesh_metrics(py: Python, domain: &Cells, image: &Cells) -> PyResult<String> {
    let (domain, image) = (domain.tets("domain")?, image.tets("image")?);
    if domain.tets() != image.tets() || domain.vertices().len() != image.vertices().len() {
        return Err(
            Failure::invalid("domain and image are not meshes of the same tetrahedra in the same order").into(),
        );
    }
    run(py, None, None, move |_| {
        to_json(&volmap_metrics(&domain, image.vertices())?)
    })
}
