//! All figures of one map, as tables show them.

use super::{
    BuildOptions, BuildTimings, BuiltMap, CompareError, FoldCount, InteriorImages, MapDifference, MapEvaluator,
    carried, mesh_for,
};
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::energy::{DensityQuantiles, Determinants, DistortionMetrics, EnergyErrors};
use crate::fit::BoundaryError;
use crate::mesh::TetMesh;

/// The figures of a map.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct MapFigures {
    /// Seconds by phase.
    pub seconds: BuildTimings,
    /// Tetrahedra that the map is linear over, or that were carried to count inverted ones.
    pub tets: Option<usize>,
    /// How many of them are inverted.
    pub inverted_tets: Option<usize>,
    /// Unknowns per coordinate.
    pub unknowns: usize,
    /// Iterations of the solver, where it has any.
    pub iterations: Option<usize>,
    /// At held-out points.
    pub boundary_error: BoundaryError,
    /// Difference to the reference.
    pub interior_difference: Option<MapDifference>,
    /// With both solids at unit volume, as the deformation energy.
    pub harmonic_energy: f64,
    /// Deformation energy.
    pub deformation_energy: f64,
    /// Estimated errors of the energies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub errors: Option<EnergyErrors>,
    /// Distribution of the harmonic energy's density.
    pub harmonic_density: DensityQuantiles,
    /// The smallest `det J`.
    pub min_det_jacobian: f64,
    /// Distribution of `det J`.
    pub det_jacobian: Option<Determinants>,
    /// Fraction of the volume where the map is folded.
    pub folded_fraction: f64,
    /// Means over the volume where the map is not folded, the target scaled to the domain's volume.
    pub distortion: Option<DistortionMetrics>,
    /// The same as computed by VOLMAP's program.
    pub volmap: Option<DistortionMetrics>,
    /// Points of the quadrature.
    pub quadrature_points: usize,
    /// What could not be measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

impl MapFigures {
    /// Seconds to make the map, without evaluation.
    pub fn total_seconds(&self) -> f64 {
        self.seconds.mesh + self.seconds.factor + self.seconds.solve
    }
}

/// A map with its figures, and what they were measured at.
pub struct MeasuredMap {
    /// The figures.
    pub figures: MapFigures,
    /// The map. Its `tets` are in `on_tets`.
    pub built: BuiltMap,
    /// Images of the evaluator's points inside.
    pub interior: InteriorImages,
    /// A tet mesh of the domain, the map's own where it has one, and the images of its vertices; `None` where none could be
    /// made, which `remarks` tells.
    pub on_tets: Option<(TetMesh, Vec<Point>)>,
}

/// Measures a map that [`build`](super::build) made with these options; `progress` is called with what is done.
///
/// # Errors
///
/// Those of [`MapEvaluator::measure`]. That no tetrahedra can be carried to count inverted ones is
/// only a remark.
pub fn measured_map(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    mut built: BuiltMap,
    evaluator: &MapEvaluator,
    reference: Option<&InteriorImages>,
    progress: &dyn Fn(String),
) -> Result<MeasuredMap, CompareError> {
    progress(format!(
        "measuring from {} points on",
        evaluator.quadrature().points().len()
    ));
    let found = evaluator.measure(&*built.map)?;
    built.seconds.evaluate = found.evaluate_seconds;
    let interior = evaluator.interior_images(&*built.map)?;
    let mut remarks = Vec::new();
    if found.energy.errors.is_none() {
        remarks.push("no error of the energies: the map has no values at points of a finer grid".into());
    }
    // A mesh to count inverted tets of; without a mesher there are no counts.
    let on_tets = built.tets.take().map_or_else(
        || {
            progress("carrying a tet mesh".into());
            let (mesh, boundary) = mesh_for(boundary, &options.mesh, options.given)?;
            let images = carried(&mesh, &boundary, &*built.map)?;
            Ok((mesh, images))
        },
        Ok,
    );
    let on_tets = on_tets
        .map_err(|error: CompareError| remarks.push(format!("no tets could be carried: {error}")))
        .ok();
    let folds = on_tets.as_ref().map(|(mesh, images)| FoldCount::of(mesh, images));
    let determinants = found.distortion.determinants;
    let figures = MapFigures {
        seconds: built.seconds,
        tets: folds.map(|folds| folds.tets),
        inverted_tets: folds.map(|folds| folds.flipped),
        unknowns: built.unknowns,
        iterations: built.iterations,
        boundary_error: found.boundary_error,
        interior_difference: reference.map(|reference| evaluator.difference(&interior, reference)),
        harmonic_energy: found.energy.harmonic,
        deformation_energy: found.energy.deformation,
        errors: found.energy.errors,
        harmonic_density: found.energy.harmonic_density,
        min_det_jacobian: determinants.map_or(f64::NAN, |d| d.min),
        det_jacobian: determinants,
        folded_fraction: found.energy.folded.fraction,
        distortion: found.distortion.mean_normalized,
        volmap: found.distortion.volmap,
        quadrature_points: found.quadrature_points,
        remarks,
    };
    Ok(MeasuredMap {
        figures,
        built,
        interior,
        on_tets,
    })
}
