//! Computes a map by any method, and times its phases.

use std::time::Instant;

use super::CompareError;
use crate::Point;
use crate::baseline::{
    BoundaryImages, DescentOptions, HarmonicOptions, MeanValueMap, TetHarmonic, TetLaplacian, TetMap, boundary_images,
};
use crate::bijective::{Bijective, RefinementOptions, make_bijective, refined_at_boundary};
use crate::boundary_map::BoundaryMap;
use crate::fit::{FitOptions, FitReport, Phase, fit};
use crate::map::VolumeMap;
use crate::mesh::{SurfaceMesh, TetMesh};
use crate::remesh::RemeshOptions;

/// A method that extends a boundary map to the solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ComparedMethod {
    /// The method of fundamental solutions: [`crate::fit`].
    Mfs,
    /// Linear finite elements with a factorisation that is kept: [`TetHarmonic`].
    Fem,
    /// The descent of Wang et al. 2004: [`TetLaplacian`].
    Variational,
    /// Mean value coordinates of Ju et al. 2005, which are not harmonic: [`MeanValueMap`].
    MeanValue,
    /// The fit, made one to one over tetrahedra: [`crate::bijective`].
    Bijective,
}

impl ComparedMethod {
    /// All methods, in the order of the tables.
    pub const ALL: [Self; 5] = [
        Self::Mfs,
        Self::Fem,
        Self::Variational,
        Self::MeanValue,
        Self::Bijective,
    ];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mfs => "mfs",
            Self::Fem => "fem",
            Self::Variational => "variational",
            Self::MeanValue => "mean_value",
            Self::Bijective => "bijective",
        }
    }

    /// Whether it needs a tetrahedral mesh.
    pub fn is_on_tets(self) -> bool {
        matches!(self, Self::Fem | Self::Variational | Self::Bijective)
    }

    /// Whether it keeps something of a domain that makes the next boundary map cheaper, and has settings to study.
    pub fn is_prepared(self) -> bool {
        !matches!(self, Self::MeanValue | Self::Bijective)
    }
}

/// The program that makes a tetrahedral mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TetMesher {
    /// TetGen, which keeps the domain's surface.
    Tetgen,
    /// CGAL's Mesh_3, which makes its own surface.
    Mesh3,
}

/// How the domain is meshed by tetrahedra.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MeshSpec {
    /// The mesher.
    pub source: TetMesher,
    /// Edge length of the inner tetrahedra, over the domain's diagonal; `None` for tetrahedra as large as their
    /// quality allows.
    pub edge: Option<f64>,
    /// Largest ratio of circumradius to shortest edge (TetGen).
    pub quality: f64,
    /// How often every triangle of the surface is divided into four first: the only way to refine the boundary of a
    /// mesh that keeps the surface.
    pub subdivisions: u32,
    /// Largest number of tetrahedra, by an estimate before meshing.
    pub most_tets: usize,
}

impl MeshSpec {
    /// By TetGen at its default quality, with inner edges twice as long as the mean edge of the surface.
    pub fn of(domain: &SurfaceMesh) -> Self {
        Self {
            source: TetMesher::Tetgen,
            edge: Some(2.0 * mean_edge(domain) / domain.diagonal()),
            quality: 1.414,
            subdivisions: 0,
            most_tets: 20_000_000,
        }
    }
}

/// Options of [`build`].
#[derive(Debug, Clone)]
pub struct BuildOptions<'a> {
    /// The method.
    pub method: ComparedMethod,
    /// Options of the method of fundamental solutions.
    pub fit: FitOptions,
    /// How the linear system of finite elements is solved.
    pub harmonic: HarmonicOptions,
    /// How the variational method descends.
    pub descent: DescentOptions,
    /// How the domain is meshed, for methods that need a mesh.
    pub mesh: MeshSpec,
    /// A mesh of the domain to use instead.
    pub given: Option<&'a TetMesh>,
}

/// Wall time of the phases, in seconds; zero for phases that a method does not have.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct BuildTimings {
    /// Making the tetrahedra.
    pub mesh: f64,
    /// What depends on the domain alone: placing points, assembling, factoring.
    pub factor: f64,
    /// What depends on the boundary map.
    pub solve: f64,
    /// Images and Jacobians at the points of the quadrature.
    pub evaluate: f64,
}

/// A map and its cost.
pub struct BuiltMap {
    /// The map.
    pub map: Box<dyn VolumeMap>,
    /// Tetrahedra over the domain and the images of their vertices, where the map is made of them.
    pub tets: Option<(TetMesh, Vec<Point>)>,
    /// Unknowns per coordinate.
    pub unknowns: usize,
    /// Number of iterations; `None` for methods without.
    pub iterations: Option<usize>,
    /// Energy `½ ∫ ‖J‖²` at the start of a descent and after each of its steps.
    pub energies: Vec<f64>,
    /// The report of a fit.
    pub fit: Option<FitReport>,
    /// All but `evaluate`.
    pub seconds: BuildTimings,
}

/// Computes a map. `progress` receives a description of each step.
///
/// # Errors
///
/// [`CompareError`] of the method.
pub fn build(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<BuiltMap, CompareError> {
    match options.method {
        ComparedMethod::Mfs => by_fundamental_solutions(boundary, options, progress),
        ComparedMethod::Fem => by_finite_elements(boundary, options, progress),
        ComparedMethod::Variational => by_descent(boundary, options, progress),
        ComparedMethod::MeanValue => by_mean_values(boundary),
        ComparedMethod::Bijective => by_repair(boundary, options, progress),
    }
}

/// The given mesh if there is one, else that of [`make_mesh`], and the boundary map that belongs to it.
///
/// # Errors
///
/// [`CompareError::OtherSolid`], and as [`make_mesh`].
pub fn mesh_for(
    boundary: &BoundaryMap,
    spec: &MeshSpec,
    given: Option<&TetMesh>,
) -> Result<(TetMesh, BoundaryMap), CompareError> {
    let Some(mesh) = given else {
        return make_mesh(boundary, spec);
    };
    let (found, expected) = (mesh.volume().abs(), boundary.domain().volume().abs());
    if (found / expected - 1.0).abs() <= MAX_VOLUME_DIFFERENCE {
        Ok((mesh.clone(), boundary.clone()))
    } else {
        Err(CompareError::OtherSolid { found, expected })
    }
}

/// Largest relative difference between the volumes of a given mesh and the domain.
const MAX_VOLUME_DIFFERENCE: f64 = 0.05;

/// A tetrahedral mesh of the boundary map's domain, and the boundary map that belongs to it.
///
/// # Errors
///
/// When it would have too many tetrahedra, this build has no mesher, or meshing fails.
pub fn make_mesh(boundary: &BoundaryMap, spec: &MeshSpec) -> Result<(TetMesh, BoundaryMap), CompareError> {
    let boundary = (0..spec.subdivisions).fold(boundary.clone(), |map, _| map.subdivided());
    let domain = boundary.domain();
    let positive = |what, value: f64, range| {
        if value > 0.0 && value.is_finite() {
            Ok(())
        } else {
            Err(CompareError::Option { what, value, range })
        }
    };
    positive("quality of the mesh", spec.quality, "a ratio of at least 1.1")?;
    if let Some(edge) = spec.edge {
        let range = "a positive fraction of the domain's diagonal";
        positive("edge length of the mesh", edge, range)?;
        let edge = edge * domain.diagonal();
        let tets = domain.volume().abs() / tet_volume(edge);
        if tets > spec.most_tets as f64 {
            let most = spec.most_tets;
            return Err(CompareError::TooManyTets { tets, edge, most });
        }
    }
    Ok((mesh_of(domain, spec)?, boundary))
}

#[cfg(feature = "native")]
fn mesh_of(domain: &SurfaceMesh, spec: &MeshSpec) -> Result<TetMesh, CompareError> {
    use crate::cgal_tetgen::{Mesh3Options, TetOptions, tetrahedralize, tetrahedralize_mesh3};
    let edge = spec.edge.map(|edge| edge * domain.diagonal());
    Ok(match spec.source {
        TetMesher::Tetgen => {
            let options = TetOptions {
                radius_edge_ratio: Some(spec.quality),
                max_volume: edge.map(tet_volume),
                ..TetOptions::default()
            };
            tetrahedralize(domain, &options)?
        }
        TetMesher::Mesh3 => {
            let options = Mesh3Options {
                // The circumradius of a regular tetrahedron.
                cell_size: edge.map(|edge| edge * 0.375f64.sqrt()),
                ..Mesh3Options::default()
            };
            tetrahedralize_mesh3(domain, &options)?
        }
    })
}

#[cfg(not(feature = "native"))]
fn mesh_of(_: &SurfaceMesh, _: &MeshSpec) -> Result<TetMesh, CompareError> {
    Err(CompareError::NoMesher)
}

/// Volume of a regular tetrahedron.
fn tet_volume(edge: f64) -> f64 {
    edge.powi(3) / (6.0 * 2f64.sqrt())
}

fn mean_edge(domain: &SurfaceMesh) -> f64 {
    let lengths = domain.triangles().iter().flat_map(|t| {
        let [a, b, c] = t.map(|v| domain.vertices()[v as usize]);
        [(b - a).norm(), (c - b).norm(), (a - c).norm()]
    });
    lengths.sum::<f64>() / (3 * domain.triangles().len()).max(1) as f64
}

fn by_fundamental_solutions(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<BuiltMap, CompareError> {
    let told = |phase: Phase| {
        progress(match phase {
            Phase::Refining { round, .. } => format!("refining, round {round}"),
            _ => "fitting".into(),
        });
    };
    let fitted = fit(boundary, &options.fit, &told)?;
    let seconds = fitted.report.seconds.unwrap_or_default();
    Ok(BuiltMap {
        map: Box::new(fitted.map),
        tets: None,
        unknowns: fitted.report.sources + if fitted.report.affine { 4 } else { 0 },
        iterations: Some(fitted.report.iterations),
        energies: Vec::new(),
        seconds: BuildTimings {
            factor: seconds.sampling + seconds.factor,
            // Refinement needs the error that the check measures, so that the check is part of it.
            solve: seconds.solve + seconds.check,
            ..BuildTimings::default()
        },
        fit: Some(fitted.report),
    })
}

/// The mesh for a method on tetrahedra, and the images of its boundary vertices.
fn meshed(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<(TetMesh, Vec<Point>), CompareError> {
    progress("meshing".into());
    let (mesh, boundary) = mesh_for(boundary, &options.mesh, options.given)?;
    let images = images_of(&mesh, &boundary)?.images;
    Ok((mesh, images))
}

/// A result, and the seconds it took.
fn timed<T, E>(work: impl FnOnce() -> Result<T, E>) -> Result<(T, f64), E> {
    let start = Instant::now();
    let found = work()?;
    Ok((found, start.elapsed().as_secs_f64()))
}

/// Largest distance of the boundary of a mesh from the domain's surface, as a fraction of the diagonal.
const MAX_DISTANCE: f64 = 0.05;

/// Images of the boundary vertices of a mesh of the domain.
///
/// # Errors
///
/// When its boundary is too far from the domain's surface.
pub(super) fn images_of(mesh: &TetMesh, boundary: &BoundaryMap) -> Result<BoundaryImages, CompareError> {
    let images = boundary_images(mesh, boundary)?;
    let (distance, diagonal) = (images.farthest, boundary.domain().diagonal());
    if distance > MAX_DISTANCE * diagonal {
        return Err(CompareError::Elsewhere { distance, diagonal });
    }
    Ok(images)
}

fn by_finite_elements(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<BuiltMap, CompareError> {
    let ((mesh, images), meshing) = timed(|| meshed(boundary, options, progress))?;
    progress("assembling and factoring".into());
    let (system, factor) = timed(|| TetHarmonic::new(mesh, &options.harmonic))?;
    progress("solving".into());
    let (map, solve) = timed(|| system.solve(&images))?;
    let seconds = [meshing, factor, solve];
    Ok(on_tets(map, system.unknowns(), None, Vec::new(), seconds))
}

fn by_descent(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<BuiltMap, CompareError> {
    let ((mesh, images), meshing) = timed(|| meshed(boundary, options, progress))?;
    progress("assembling".into());
    let (system, factor) = timed(|| TetLaplacian::new(mesh))?;
    let told = |iteration: usize, energy: f64| {
        if iteration.is_multiple_of(50) {
            progress(format!("descending, step {iteration}, energy {energy:.6}"));
        }
    };
    let (found, solve) = timed(|| system.solve(&images, &options.descent, &told))?;
    let unknowns = system.mesh().vertices().len() - system.boundary_vertices().len();
    let steps = found.energies.len() - 1;
    let seconds = [meshing, factor, solve];
    Ok(on_tets(found.map, unknowns, Some(steps), found.energies, seconds))
}

fn on_tets(
    map: TetMap,
    unknowns: usize,
    iterations: Option<usize>,
    energies: Vec<f64>,
    [mesh, factor, solve]: [f64; 3],
) -> BuiltMap {
    BuiltMap {
        tets: Some((map.mesh().clone(), map.images().to_vec())),
        map: Box::new(map),
        unknowns,
        iterations,
        energies,
        fit: None,
        seconds: BuildTimings {
            mesh,
            factor,
            solve,
            evaluate: 0.0,
        },
    }
}

fn by_repair(
    boundary: &BoundaryMap,
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<BuiltMap, CompareError> {
    let fitted = by_fundamental_solutions(boundary, options, progress)?;
    progress("meshing".into());
    let ((mesh, boundary), meshing) = timed(|| mesh_for(boundary, &options.mesh, options.given))?;
    progress("making it one to one".into());
    let (found, repair) = timed(|| {
        let (mesh, _) = refined_at_boundary(&boundary, mesh, &RefinementOptions::default(), None)?;
        make_bijective(&boundary, &*fitted.map, mesh, &RemeshOptions::default(), None, &|_| {})
    })
    .map_err(Box::new)?;
    let Bijective { map, report } = found;
    Ok(BuiltMap {
        tets: Some((map.domain().clone(), map.target().vertices().to_vec())),
        map: Box::new(map),
        unknowns: report.nodes - report.boundary_nodes,
        seconds: BuildTimings {
            mesh: meshing,
            solve: fitted.seconds.solve + repair,
            ..fitted.seconds
        },
        ..fitted
    })
}

fn by_mean_values(boundary: &BoundaryMap) -> Result<BuiltMap, CompareError> {
    let (map, factor) = timed(|| MeanValueMap::new(boundary))?;
    Ok(BuiltMap {
        map: Box::new(map),
        tets: None,
        unknowns: 0,
        iterations: None,
        energies: Vec::new(),
        fit: None,
        seconds: BuildTimings {
            factor,
            ..BuildTimings::default()
        },
    })
}
