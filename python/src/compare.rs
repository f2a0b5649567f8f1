//! Maps of one boundary map by several methods, measured alike.

use std::sync::Arc;
use std::time::Instant;

use pyo3::prelude::*;
use serde_json::{Value, json};
use solidmap::baseline::{DescentOptions, HarmonicOptions};
use solidmap::boundary_map::BoundaryMap;
use solidmap::check;
use solidmap::compare::{
    BuildOptions, ComparedMethod, EvaluationOptions, FoldCount, InteriorImages, MapEvaluator, MeshSpec, TetMesher,
    build, carried, mesh_for,
};
use solidmap::fit::FitOptions;
use solidmap::mesh::TetMesh;

use crate::boundary::{Boundary, value_of};
use crate::error::Failure;
use crate::meshes::Cells;
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

/// One row of figures for each method. Those that cannot make a map have an `error`.
#[pyfunction]
#[pyo3(signature = (boundary, arguments, mesh=None, progress=None))]
pub fn compare(
    py: Python,
    boundary: &Boundary,
    arguments: CompareArguments,
    mesh: Option<&Cells>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (file, given) = (Arc::clone(&boundary.0), mesh.map(|mesh| mesh.tets("mesh")).transpose()?);
    let methods: Vec<ComparedMethod> = arguments
        .methods
        .iter()
        .map(|name| method_of(name))
        .collect::<Result<_, _>>()?;
    run(py, progress, None, move |watch| {
        let (repaired, repairs) = check::repair(file.boundary.domain());
        let boundary = match repairs.is_empty() {
            true => file.boundary.clone(),
            false => file.boundary.over(repaired)?,
        };
        watch.tell_or_unwind(|| step("placing sample points"));
        let options = EvaluationOptions {
            resolution: arguments.resolution,
            interior: arguments.interior,
            seed: arguments.seed,
            ..EvaluationOptions::default()
        };
        let evaluator = MapEvaluator::new(&boundary, &options)?;
        let mut first: Option<InteriorImages> = None;
        let mut rows = vec![];
        for method in methods {
            let compared = Compared {
                boundary: &boundary,
                arguments: &arguments,
                given: given.as_ref(),
                evaluator: &evaluator,
            };
            let mut row = match compared.measured(method, &mut first, watch) {
                Ok(row) => row,
                Err(failure) if watch.is_cancelled() => return Err(failure),
                Err(failure) => json!({ "error": failure.message() }),
            };
            row["name"] = json!(method.name());
            rows.push(row);
        }
        Ok(Value::from(rows).to_string())
    })
}

struct Compared<'a> {
    boundary: &'a BoundaryMap,
    arguments: &'a CompareArguments,
    given: Option<&'a TetMesh>,
    evaluator: &'a MapEvaluator<'a>,
}

impl Compared<'_> {
    /// The figures of a method; `first` has the images of the first method that made a map.
    fn measured(
        &self,
        method: ComparedMethod,
        first: &mut Option<InteriorImages>,
        watch: &Watch,
    ) -> Result<Value, Failure> {
        let spec = self.arguments.spec(self.boundary);
        let options = BuildOptions {
            method,
            fit: FitOptions {
                tolerance: self.arguments.tolerance,
                memory: self.arguments.memory,
                seed: self.arguments.seed,
                ..FitOptions::default()
            },
            harmonic: HarmonicOptions::default(),
            descent: DescentOptions {
                threshold: self.arguments.threshold,
                ..DescentOptions::default()
            },
            mesh: spec,
            given: self.given,
        };
        let tell = |what: String| watch.tell_or_unwind(|| step(&format!("{}: {what}", method.name())));
        let started = Instant::now();
        let mut made = build(self.boundary, &options, &tell)?;
        let total = started.elapsed().as_secs_f64();
        tell("measuring".into());
        let found = self.evaluator.measure(&*made.map)?;
        made.seconds.evaluate = found.evaluate_seconds;
        let images = self.evaluator.interior_images(&*made.map)?;
        let difference = first.as_ref().map(|first| self.evaluator.difference(&images, first));
        first.get_or_insert(images);
        let mut remarks = vec![];
        let on_tets = made.tets.take().map(Ok).unwrap_or_else(|| {
            let (mesh, boundary) = mesh_for(self.boundary, &spec, self.given)?;
            let images = carried(&mesh, &boundary, &*made.map)?;
            Ok((mesh, images))
        });
        let folds = match on_tets {
            Ok((mesh, images)) => Some(FoldCount::of(&mesh, &images)),
            Err(error) => {
                let failure: Failure = {
                    let error: solidmap::compare::CompareError = error;
                    error.into()
                };
                remarks.push(format!("no tets could be carried: {}", failure.message()));
                None
            }
        };
        Ok(json!({
            "seconds": value_of(&made.seconds)?,
            "total_seconds": total,
            "tets": folds.map(|folds| folds.tets),
            "inverted_tets": folds.map(|folds| folds.flipped),
            "unknowns": made.unknowns,
            "iterations": made.iterations,
            "boundary_error": value_of(&found.boundary_error)?,
            "interior_difference": value_of(&difference)?,
            "harmonic_energy": found.energy.harmonic,
            "deformation_energy": found.energy.deformation,
            "errors": value_of(&found.energy.errors)?,
            "harmonic_density": value_of(&found.energy.harmonic_density)?,
            "det_jacobian": value_of(&found.distortion.determinants)?,
            "folded_fraction": found.energy.folded.fraction,
            "distortion": value_of(&found.distortion.mean_normalized)?,
            "volmap": value_of(&found.distortion.volmap)?,
            "quadrature_points": found.quadrature_points,
            "remarks": remarks,
        }))
    }
}
