//! Boundary maps, fits, fitted maps and their inverses.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, ErrorKind, guarded};
use super::meshes::{Surface, boxed, name_of, whole, whole_points};
use super::{flat, path};
use solidmap::boundary_map::pair::{
    LandmarkCurve, Landmarks, PairError, PairMethod, PairOptions, PairPhase, fitting_torus, map_pair,
};
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion};
use solidmap::files::{self, BoundaryFile, BoundaryMetadata, MapFile, MapMetadata};
use solidmap::fit::{
    self, DomainFactor, Fit, FitMethod, FitOptions, FitReport, FrameEvaluator, LocalError, Phase, Placement,
};
use solidmap::improve::{ImproveEnd, ImproveOptions, ImprovePhase, improve_boundary};
use solidmap::inverse::{InverseMap, InverseOptions, Preimage};
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::{SurfaceMesh, SurfacePoint};
use solidmap::solver::{Decomposition, DenseOptions, SchwarzOptions};
use solidmap::spherical::{SphereEnergy, SphereOptions, SpherePhase, map_to_sphere};
use solidmap::{Matrix3, Vector};

pub struct Boundary(pub BoundaryMap);

pub struct Boundaries(Vec<BoundaryMap>);

/// A fitted map, with all that its file holds.
#[derive(Clone)]
pub struct Map {
    file: Arc<MapFile>,
    /// The report with timings, which the file leaves out.
    report: Option<FitReport>,
}

pub struct Maps(Vec<Option<Fit>>);

/// The domain as it was given, and as it was factored.
pub struct Factored {
    domain: SurfaceMesh,
    factor: Arc<DomainFactor>,
    /// The map of the boundary map that it was refined for.
    first: Option<Fit>,
}

pub struct Frames(Mutex<FrameEvaluator>);

pub struct Inverse {
    /// Borrows from `_map` and `_file`. Declared first, so that it is dropped first.
    inverse: InverseMap<'static>,
    _map: Box<HarmonicMap>,
    _file: Arc<MapFile>,
}

// The C++ classes promise that their `const` functions may run on any number of threads at once.
const _: () = {
    const fn shared<T: Send + Sync>() {}
    shared::<Surface>();
    shared::<super::meshes::VolumeMesh>();
    shared::<Boundary>();
    shared::<Map>();
    shared::<Factored>();
    shared::<Frames>();
    shared::<Inverse>();
};

pub fn boundary_new(domain: &Surface, images: &[f64]) -> Result<Box<Boundary>, Error> {
    guarded(|| {
        boxed_boundary(BoundaryMap::new(
            domain.0.clone(),
            whole_points("images", images)?.to_vec(),
        )?)
    })
}

pub fn boundary_between(domain: &Surface, image: &Surface) -> Result<Box<Boundary>, Error> {
    guarded(|| boxed_boundary(BoundaryMap::between(domain.0.clone(), &image.0)?))
}

pub fn boundary_to_sphere(domain: &Surface, conformal: bool, watcher: &Watcher) -> Result<Box<Boundary>, Error> {
    guarded(|| {
        let options = SphereOptions {
            energy: if conformal {
                SphereEnergy::Conformal
            } else {
                SphereEnergy::Balanced
            },
            ..SphereOptions::default()
        };
        let progress = |phase| {
            let (step, fraction) = match phase {
                SpherePhase::Coarsening => ("coarsening", f64::NAN),
                SpherePhase::Embedding { vertices, total } => ("embedding", share(vertices, total)),
                SpherePhase::Flowing => ("flowing", f64::NAN),
                SpherePhase::Optimising {
                    iterations,
                    most_iterations,
                } => ("optimising", share(iterations, most_iterations)),
            };
            ask(watcher, step, fraction, "")
        };
        let (embedding, _) = map_to_sphere(&domain.0, &options, &progress)?;
        boxed_boundary(BoundaryMap::onto_sphere(embedding)?)
    })
}

pub fn boundary_to_torus(domain: &Surface, watcher: &Watcher) -> Result<Box<Boundary>, Error> {
    guarded(|| {
        let torus = fitting_torus(&domain.0).map_err(|error| PairError::Torus { side: "domain", error })?;
        let progress = |phase| on_pair_phase(watcher, phase);
        let (map, _) = map_pair(&domain.0, &torus.surface, &PairOptions::default(), &progress)?;
        boxed_boundary(map)
    })
}

pub fn boundary_pair(
    domain: &Surface,
    target: &Surface,
    landmarks: &[u32],
    components: &[u32],
    options: &ffi::PairOptions,
    watcher: &Watcher,
    report: &mut ffi::PairReport,
) -> Result<Box<Boundary>, Error> {
    guarded(|| {
        let pairs = whole::<u32, 2>("vertices of landmarks", landmarks)?.to_vec();
        let landmarks = Landmarks::new(pairs, domain.0.vertices().len(), target.0.vertices().len())
            .map_err(|error| Error::invalid(error.to_string()))?;
        let components = whole::<u32, 2>("components", components)?;
        let up = [options.domain_up, options.target_up].map(Vector::from);
        let mut left = &options.loop_vertices[..];
        let mut next_loop = |length: u32| {
            let (first, others) = left.split_at_checked(length as usize)?;
            left = others;
            Some(first.to_vec())
        };
        let loops = whole::<u32, 2>("lengths of loops", &options.loop_lengths)?
            .iter()
            .map(|[domain, target]| {
                Some(LandmarkCurve {
                    domain: next_loop(*domain)?,
                    target: next_loop(*target)?,
                })
            });
        let loops: Option<Vec<_>> = loops.collect();
        let options = PairOptions {
            method: if options.conformal {
                PairMethod::Conformal
            } else {
                PairMethod::SoftTargets
            },
            landmarks,
            loops: loops.ok_or_else(|| Error::invalid("loops have fewer vertices than they say"))?,
            landmarks_weight: (options.landmarks_weight != 0.0).then_some(options.landmarks_weight),
            components: components.iter().map(|pair| pair.map(|shell| shell as usize)).collect(),
            up: (up != [Vector::zeros(); 2]).then_some(up),
            most_stretched: options.most_stretched,
            aligned: options.aligned,
            improve: options.improve,
            ..PairOptions::default()
        };
        let progress = |phase| on_pair_phase(watcher, phase);
        let (boundary, found) = map_pair(&domain.0, &target.0, &options, &progress)?;
        let SurfaceDistortion { angle, area, .. } = &found.after;
        *report = ffi::PairReport {
            angle_median: angle.p50,
            angle_p99: angle.p99,
            area_median: area.p50,
            area_p99: area.p99,
            stretched: found.stretch.domain.share,
            target_stretched: found.stretch.target.share,
            looks_wrong: found.looks_wrong(),
            isometry_defect: found.isometry_defect.unwrap_or(f64::NAN),
            landmark_error: found.landmark_error,
            components: found.shells.iter().map(|shell| shell.target as u32).collect(),
            seconds: found.timings.total,
            warnings: found.warnings,
        };
        boxed_boundary(boundary)
    })
}

/// Tells the callback the phase of a pair, and asks it whether the work goes on.
pub fn on_pair_phase(watcher: &Watcher, phase: PairPhase) -> ControlFlow<()> {
    let (step, fraction) = match phase {
        PairPhase::Sphere("domain", _) => ("mapping the domain to the sphere", f64::NAN),
        PairPhase::Sphere(..) => ("mapping the target to the sphere", f64::NAN),
        PairPhase::Tori => ("laying both solids out on tori", f64::NAN),
        PairPhase::HyperbolicSurface => ("laying out on a hyperbolic surface", f64::NAN),
        PairPhase::Reversed => ("seeking a map from the target to the domain", f64::NAN),
        PairPhase::Shell { shell, of } => ("mapping the shells", share(shell - 1, of)),
        PairPhase::Aligning { done, of } => ("aligning", share(done, of)),
        PairPhase::Intrinsic { done, of } => ("finding correspondences by intrinsic shape", share(done, of)),
        PairPhase::CoarseEmbeddings { done, of, .. } => ("trying coarse embeddings", share(done, of)),
        PairPhase::Refining { vertices, total, .. } => ("refining the embedding", share(vertices, total)),
        PairPhase::Improving { rounds, most_rounds } => ("lowering the distortion", share(rounds, most_rounds)),
        PairPhase::Measuring { done, of } => ("measuring", share(done, of)),
    };
    ask(watcher, step, fraction, "")
}

pub fn boundary_load(bytes: &[u8]) -> Result<Box<Boundary>, Error> {
    guarded(|| boxed_boundary(files::read_boundary(&path(bytes)?)?.boundary))
}

impl Boundary {
    pub fn save(&self, bytes: &[u8]) -> Result<(), Error> {
        guarded(|| {
            let file = BoundaryFile {
                boundary: self.0.clone(),
                metadata: BoundaryMetadata::new(vec![]),
            };
            Ok(files::write_boundary(&path(bytes)?, &file)?)
        })
    }

    pub fn domain(&self) -> Result<Box<Surface>, Error> {
        guarded(|| boxed(self.0.domain().clone()))
    }

    pub fn target(&self) -> Result<Box<Surface>, Error> {
        guarded(|| boxed(self.0.outward_target()))
    }

    pub fn images(&self) -> &[f64] {
        flat(self.0.image())
    }

    pub fn target_volume(&self) -> Result<f64, Error> {
        guarded(|| Ok(self.0.target_volume()))
    }

    pub fn target_diagonal(&self) -> Result<f64, Error> {
        guarded(|| Ok(self.0.target_diagonal()))
    }

    pub fn evaluate(&self, triangles: &[u32], barycentric: &[f64], images: &mut [f64]) -> Result<(), Error> {
        guarded(|| {
            let barycentric = whole::<f64, 3>("barycentric coordinates", barycentric)?;
            let faces = self.0.domain().triangles().len();
            if let Some(far) = triangles.iter().find(|t| **t as usize >= faces) {
                return Err(Error::invalid(format!(
                    "triangle {far} was asked for, and the domain has {faces}, counted from 0"
                )));
            }
            let points: Vec<SurfacePoint> = triangles
                .iter()
                .zip(barycentric)
                .map(|(&triangle, &barycentric)| SurfacePoint { triangle, barycentric })
                .collect();
            write(images, flat(&self.0.evaluate(&points)))
        })
    }

    pub fn inverse(&self) -> Result<Box<Boundary>, Error> {
        guarded(|| match self.0.inverse() {
            Some(inverse) => boxed_boundary(inverse),
            None => Err(Error::new(
                ErrorKind::Unsupported,
                "only a boundary map composed of two spherical embeddings (BoundaryMap::pair) has an inverse",
            )),
        })
    }
}

impl Boundary {
    pub fn improved(
        &self,
        options: &ffi::ImproveOptions,
        watcher: &Watcher,
        report: &mut ffi::ImproveReport,
    ) -> Result<Box<Self>, Error> {
        guarded(|| {
            let mut how = ImproveOptions {
                most_distortion: options.max_distortion,
                most_rounds: options.rounds,
                ..ImproveOptions::default()
            };
            how.fit.tolerance = options.tolerance;
            let progress = |phase| match phase {
                ImprovePhase::Fitting(phase) => on_phase(watcher, phase),
                ImprovePhase::Moving {
                    rounds, most_rounds, ..
                } => ask(watcher, "lowering the energy", share(rounds, most_rounds), ""),
            };
            let (improved, found) = improve_boundary(&self.0, &how, &progress)?;
            *report = ffi::ImproveReport {
                energies: found.energies,
                rounds: found.rounds,
                end: match found.end {
                    ImproveEnd::Distortion => 0,
                    ImproveEnd::Converged => 1,
                    // Callbacks of C++ continue or cancel.
                    ImproveEnd::Rounds | ImproveEnd::Concluded => 2,
                },
                distortion_before: found.distortions[0],
                distortion_after: found.distortions[1],
                boundary_error_before: found.boundary_errors[0],
                boundary_error_after: found.boundary_errors[1],
                warnings: found.warnings,
            };
            boxed_boundary(improved)
        })
    }
}

pub fn no_boundaries() -> Box<Boundaries> {
    Box::new(Boundaries(vec![]))
}

impl Boundaries {
    pub fn push(&mut self, boundary: &Boundary) -> Result<(), Error> {
        guarded(|| {
            self.0.push(boundary.0.clone());
            Ok(())
        })
    }
}

/// The options of a preset: 0 adaptive, 1 dense, 2 the paper's, 3 with free sources.
pub fn fit_defaults(preset: u8) -> ffi::FitOptions {
    fit_for_cpp(&match preset {
        0 => FitOptions::adaptive(),
        1 => FitOptions::dense(),
        3 => FitOptions::with_free_sources(),
        _ => FitOptions::paper(),
    })
}

/// The options as C++ knows them.
pub fn fit_for_cpp(options: &FitOptions) -> ffi::FitOptions {
    let (placement, placement_value) = match options.method.placement() {
        Placement::Adaptive { alpha } => (0, alpha),
        Placement::Offset { distance } => (1, distance),
        Placement::Sphere { radius } => (2, radius),
    };
    let (schwarz, dense) = (SchwarzOptions::default(), DenseOptions::default());
    let (solver, truncation) = match options.method {
        FitMethod::Schwarz { .. } => (0, dense.truncation),
        FitMethod::Dense { options: dense, .. } => (
            if dense.decomposition == Decomposition::Qr { 1 } else { 2 },
            dense.truncation,
        ),
    };
    ffi::FitOptions {
        placement,
        placement_value,
        source_ratio: options.source_ratio,
        collocation_ratio: options.collocation_ratio,
        max_sources: options.max_sources,
        max_source_ratio: options.max_source_ratio,
        affine: options.affine,
        solver,
        most_iterations: schwarz.most_iterations,
        truncation,
        tolerance: options.tolerance,
        max_error_ratio: options.max_error_ratio,
        max_local_error: options.max_local_error,
        refine: options.refine,
        free_sources: options.free_sources,
        memory: options.memory.unwrap_or(0),
        held_out: options.held_out,
        seed: options.seed,
    }
}

pub fn fit(boundary: &Boundary, options: &ffi::FitOptions, watcher: &Watcher) -> Result<Box<Map>, Error> {
    guarded(|| {
        let fit = fit::fit(&boundary.0, &fit_options(options)?, &|phase| on_phase(watcher, phase))?;
        Ok(Box::new(Map::of(fit)))
    })
}

pub fn map_load(bytes: &[u8]) -> Result<Box<Map>, Error> {
    guarded(|| {
        let file = files::read_map(&path(bytes)?)?;
        Ok(Box::new(Map {
            report: file.metadata.fit.clone(),
            file: Arc::new(file),
        }))
    })
}

impl Map {
    pub fn of(fit: Fit) -> Self {
        let Fit {
            map, boundary, report, ..
        } = fit;
        let metadata = MapMetadata::new(report.clone(), vec![]);
        let boundary = Some(boundary);
        Self {
            file: Arc::new(MapFile {
                map,
                boundary,
                bijective: None,
                metadata,
            }),
            report: Some(report),
        }
    }

    pub fn map(&self) -> &HarmonicMap {
        &self.file.map
    }

    pub fn file(&self) -> &MapFile {
        &self.file
    }

    pub fn has_bijective(&self) -> bool {
        self.file.bijective.is_some()
    }

    /// The boundary map, which everything but evaluation needs.
    pub fn boundary_map(&self) -> Result<&BoundaryMap, Error> {
        boundary_of(&self.file)
    }

    pub fn save(&self, bytes: &[u8]) -> Result<(), Error> {
        guarded(|| Ok(files::write_map(&path(bytes)?, &self.file)?))
    }

    pub fn evaluate(&self, points: &[f64], images: &mut [f64]) -> Result<(), Error> {
        guarded(|| {
            require_room(images, points.len(), 3)?;
            write(images, flat(&self.map().evaluate(whole_points("points", points)?)))
        })
    }

    pub fn jacobian(&self, points: &[f64], jacobians: &mut [f64]) -> Result<(), Error> {
        guarded(|| {
            require_room(jacobians, 3 * points.len(), 9)?;
            write_rows(jacobians, &self.map().jacobian(whole_points("points", points)?))
        })
    }

    pub fn evaluate_with_jacobian(
        &self,
        points: &[f64],
        images: &mut [f64],
        jacobians: &mut [f64],
    ) -> Result<(), Error> {
        guarded(|| {
            require_room(images, points.len(), 3)?;
            require_room(jacobians, 3 * points.len(), 9)?;
            let (values, derivatives) = self.map().evaluate_with_jacobian(whole_points("points", points)?);
            write(images, flat(&values))?;
            write_rows(jacobians, &derivatives)
        })
    }

    pub fn boundary(&self) -> Result<Box<Boundary>, Error> {
        guarded(|| boxed_boundary(self.boundary_map()?.clone()))
    }

    pub fn report(&self) -> Result<ffi::FitReport, Error> {
        let Some(report) = &self.report else {
            return Err(Error::new(
                ErrorKind::Unsupported,
                "the map's file has no report of a fit: another program wrote it",
            ));
        };
        let seconds = report.seconds.unwrap_or_default();
        let local = report.local_error.unwrap_or(LocalError {
            p99: f64::NAN,
            max: f64::NAN,
        });
        let free = report.free_sources;
        let before = free.map(|free| free.boundary_error_before).unwrap_or_default();
        Ok(ffi::FitReport {
            vertices: report.vertices,
            triangles: report.faces,
            sources: report.sources,
            collocation: report.collocation,
            method: report.method.clone(),
            iterations: report.iterations,
            refinements: report.refinements,
            refinement_end: report.refinement_end.as_ref().map(name_of).unwrap_or_default(),
            has_free_sources: free.is_some(),
            free_rounds: free.map_or(0, |free| free.rounds),
            free_end: free.map(|free| name_of(&free.end)).unwrap_or_default(),
            free_residual_before: free.map_or(f64::NAN, |free| free.residual_before),
            free_residual_after: free.map_or(f64::NAN, |free| free.residual_after),
            free_rms_before: before.rms,
            free_p99_before: before.p99,
            free_max_before: before.max,
            free_kept: free.is_some_and(|free| free.kept),
            rms: report.boundary_error.rms,
            p99: report.boundary_error.p99,
            max: report.boundary_error.max,
            local_p99: local.p99,
            local_max: local.max,
            residual_rms: report.residual_rms,
            c_error: report.c_error,
            seconds_total: seconds.total,
            seconds_sampling: seconds.sampling,
            seconds_factor: seconds.factor,
            seconds_solve: seconds.solve,
            seconds_check: seconds.check,
            warnings: report.warnings.clone(),
        })
    }

    pub fn metadata(&self) -> Result<String, Error> {
        guarded(|| {
            serde_json::to_string(&self.file.metadata)
                .map_err(|error| Error::new(ErrorKind::Internal, error.to_string()))
        })
    }

    pub fn sources(&self) -> &[f64] {
        flat(self.map().sources())
    }

    pub fn coefficients(&self) -> &[f64] {
        self.map().coefficients().sources.as_flattened()
    }

    pub fn affine(&self) -> &[f64] {
        self.map().coefficients().affine.as_flattened()
    }
}

impl Maps {
    pub fn len(&self) -> usize {
        self.0.len()
    }

    pub fn take(&mut self, index: usize) -> Result<Box<Map>, Error> {
        let fit = self.0.get_mut(index).and_then(Option::take);
        let fit = fit.ok_or_else(|| Error::new(ErrorKind::Internal, "a map was taken twice"))?;
        Ok(Box::new(Map::of(fit)))
    }
}

pub fn factor_new(domain: &Surface, options: &ffi::FitOptions, watcher: &Watcher) -> Result<Box<Factored>, Error> {
    guarded(|| {
        let factor = DomainFactor::new(&domain.0, &fit_options(options)?, &|phase| on_phase(watcher, phase))?;
        Ok(Box::new(Factored {
            domain: domain.0.clone(),
            factor: Arc::new(factor),
            first: None,
        }))
    })
}

pub fn factor_refined(
    boundary: &Boundary,
    options: &ffi::FitOptions,
    watcher: &Watcher,
) -> Result<Box<Factored>, Error> {
    guarded(|| {
        let domain = boundary.0.domain();
        let mut factor = DomainFactor::new(domain, &fit_options(options)?, &|phase| on_phase(watcher, phase))?;
        let first = factor.solve_refined(&boundary.0, &|phase| on_phase(watcher, phase))?;
        Ok(Box::new(Factored {
            domain: domain.clone(),
            factor: Arc::new(factor),
            first: Some(first),
        }))
    })
}

impl Factored {
    pub fn domain(&self) -> Result<Box<Surface>, Error> {
        guarded(|| boxed(self.domain.clone()))
    }

    pub fn first(&self) -> Result<Box<Map>, Error> {
        guarded(|| match &self.first {
            Some(fit) => Ok(Box::new(Map::of(fit.clone()))),
            None => Err(Error::invalid(
                "the factor was made without a boundary map, so that it has no first map",
            )),
        })
    }

    pub fn solve(&self, boundary: &Boundary, watcher: &Watcher) -> Result<Box<Map>, Error> {
        guarded(|| self.solved(&boundary.0, watcher))
    }

    pub fn solve_images(&self, images: &[f64], watcher: &Watcher) -> Result<Box<Map>, Error> {
        guarded(|| {
            let images = whole_points("images", images)?.to_vec();
            self.solved(&BoundaryMap::new(self.domain.clone(), images)?, watcher)
        })
    }

    pub fn solve_many(&self, boundaries: &Boundaries, watcher: &Watcher) -> Result<Box<Maps>, Error> {
        guarded(|| self.solved_together(&boundaries.0, watcher))
    }

    pub fn solve_many_images(&self, images: &[f64], watcher: &Watcher) -> Result<Box<Maps>, Error> {
        guarded(|| {
            let (images, vertices) = (whole_points("images", images)?, self.domain.vertices().len());
            if vertices == 0 || images.len() % vertices != 0 {
                return Err(Error::invalid(format!(
                    "{} images were given for a domain of {vertices} vertices; give as many for every frame",
                    images.len()
                )));
            }
            let frames = images.chunks_exact(vertices);
            let frames = frames.map(|images| BoundaryMap::new(self.domain.clone(), images.to_vec()));
            let frames = frames.collect::<Result<Vec<_>, _>>()?;
            self.solved_together(&frames, watcher)
        })
    }

    fn solved(&self, boundary: &BoundaryMap, watcher: &Watcher) -> Result<Box<Map>, Error> {
        let fit = self.factor.solve(boundary, &|phase| on_phase(watcher, phase))?;
        Ok(Box::new(Map::of(fit)))
    }

    fn solved_together(&self, boundaries: &[BoundaryMap], watcher: &Watcher) -> Result<Box<Maps>, Error> {
        let fits = self.factor.solve_block(boundaries, &|phase| on_phase(watcher, phase))?;
        Ok(Box::new(Maps(fits.into_iter().map(Some).collect())))
    }
}

pub fn frames_new(factored: &Factored, points: &[f64], most_modes: usize) -> Result<Box<Frames>, Error> {
    guarded(|| {
        let points = whole_points("points", points)?;
        let frames = FrameEvaluator::new(Arc::clone(&factored.factor), points, most_modes)?;
        Ok(Box::new(Frames(Mutex::new(frames))))
    })
}

impl Frames {
    pub fn modes(&self) -> Result<usize, Error> {
        guarded(|| Ok(self.locked().modes()))
    }

    pub fn evaluate(&self, images: &[f64], watcher: &Watcher) -> Result<ffi::FrameImages, Error> {
        guarded(|| {
            let images = whole_points("images", images)?.to_vec();
            let frame = self.locked().evaluate(images, &|phase| on_phase(watcher, phase))?;
            Ok(ffi::FrameImages {
                images: frame.images.iter().flat_map(|p| p.coords.data.0[0]).collect(),
                boundary_rms: frame.boundary_rms,
                left_out: frame.left_out,
                solved: frame.solved,
            })
        })
    }

    /// Modes are added whole, so that they are sound after a panic, too.
    fn locked(&self) -> MutexGuard<'_, FrameEvaluator> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

pub fn inverse_new(map: &Map, tolerance: f64, seed_nodes: usize, iterations: usize) -> Result<Box<Inverse>, Error> {
    guarded(|| {
        let options = InverseOptions {
            tolerance,
            seed_nodes,
            iterations,
        };
        let file = Arc::clone(&map.file);
        // Sums as accurate as Newton's method needs.
        let exact = Box::new(file.map.clone().with_error(0.0));
        let map: *const HarmonicMap = &raw const *exact;
        let boundary: *const BoundaryMap = boundary_of(&file)?;
        // SAFETY: both are on the heap, do not move when the struct does, are never written to, and are dropped after
        // what borrows from them.
        let (map, boundary) = unsafe { (&*map, &*boundary) };
        Ok(Box::new(Inverse {
            inverse: InverseMap::new(map, boundary, &options)?,
            _map: exact,
            _file: file,
        }))
    })
}

impl Inverse {
    pub fn preimages(&self, points: &[f64], watcher: &Watcher) -> Result<Vec<ffi::Preimage>, Error> {
        guarded(|| {
            let points = whole_points("points", points)?;
            let progress = |done| ask(watcher, "searching", share(done, points.len()), "");
            let (found, _) = self.inverse.preimages_with_progress(points, &progress)?;
            Ok(preimages_of(found))
        })
    }
}

pub fn preimages_of(found: Vec<Preimage>) -> Vec<ffi::Preimage> {
    let converted = found.into_iter().map(|preimage| ffi::Preimage {
        point: preimage.point.into(),
        round_trip: preimage.round_trip,
        preimages: preimage.preimages,
        status: preimage.status as u8,
        beyond_boundary: preimage.beyond_boundary,
    });
    converted.collect()
}

fn boundary_of(file: &MapFile) -> Result<&BoundaryMap, Error> {
    file.boundary.as_ref().ok_or_else(|| {
        Error::new(
            ErrorKind::Unsupported,
            "the map's file holds no boundary map, so its domain is not known: another program wrote it",
        )
    })
}

pub fn boxed_boundary(boundary: BoundaryMap) -> Result<Box<Boundary>, Error> {
    Ok(Box::new(Boundary(boundary)))
}

/// Refuses, before any work, an array for results of other than `entries` elements, `per_point` for each point.
pub fn require_room(out: &[f64], entries: usize, per_point: usize) -> Result<(), Error> {
    if out.len() == entries {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "there is room for {} results, and {} points are given",
        out.len() / per_point,
        entries / per_point
    )))
}

pub fn write(out: &mut [f64], found: &[f64]) -> Result<(), Error> {
    if out.len() != found.len() {
        return Err(Error::invalid(format!(
            "there is room for {} entries, and the result has {}",
            out.len(),
            found.len()
        )));
    }
    out.copy_from_slice(found);
    Ok(())
}

/// Writes Jacobians row by row: `∂f_i / ∂x_k` at `3 i + k`.
pub fn write_rows(out: &mut [f64], found: &[Matrix3]) -> Result<(), Error> {
    if out.len() != 9 * found.len() {
        return write(out, &vec![0.0; 9 * found.len()]);
    }
    for (rows, jacobian) in out.as_chunks_mut::<9>().0.iter_mut().zip(found) {
        *rows = std::array::from_fn(|i| jacobian[(i / 3, i % 3)]);
    }
    Ok(())
}

pub fn fit_options(options: &ffi::FitOptions) -> Result<FitOptions, Error> {
    let value = options.placement_value;
    let placement = match options.placement {
        0 => Placement::Adaptive { alpha: value },
        1 => Placement::Offset { distance: value },
        _ => Placement::Sphere { radius: value },
    };
    let dense = |decomposition| FitMethod::Dense {
        placement,
        options: DenseOptions {
            decomposition,
            truncation: options.truncation,
        },
    };
    let schwarz = SchwarzOptions {
        most_iterations: options.most_iterations,
        ..SchwarzOptions::default()
    };
    let method = match options.solver {
        0 => FitMethod::schwarz(placement, schwarz)?,
        1 => dense(Decomposition::Qr),
        _ => dense(Decomposition::Svd),
    };
    Ok(FitOptions {
        method,
        source_ratio: options.source_ratio,
        collocation_ratio: options.collocation_ratio,
        max_sources: options.max_sources,
        max_source_ratio: options.max_source_ratio,
        affine: options.affine,
        tolerance: options.tolerance,
        max_error_ratio: options.max_error_ratio,
        max_local_error: options.max_local_error,
        refine: options.refine,
        free_sources: options.free_sources,
        memory: (options.memory > 0).then_some(options.memory),
        held_out: options.held_out,
        seed: options.seed,
    })
}

/// Tells the callback the phase of a fit, and asks it whether the work goes on.
pub fn on_phase(watcher: &Watcher, phase: Phase) -> ControlFlow<()> {
    let (step, fraction, detail) = match phase {
        Phase::Checking => ("checking", f64::NAN, String::new()),
        Phase::Sampling => ("sampling", f64::NAN, String::new()),
        Phase::Decomposing { rows, columns } => ("decomposing", f64::NAN, format!("{rows} x {columns}")),
        Phase::Factoring { done, of } => ("factoring", share(done, of), format!("{done} of {of}")),
        Phase::Solving => ("solving", f64::NAN, String::new()),
        Phase::Iterating { iteration, residual } => (
            "iterating",
            f64::NAN,
            format!("iteration {iteration}, residual {residual:.2e}"),
        ),
        Phase::Measuring => ("measuring", f64::NAN, String::new()),
        Phase::MovingSources { round, residual } => (
            "moving sources",
            f64::NAN,
            format!("round {round}, residual {residual:.2e}"),
        ),
        Phase::Refining { round, error, sources } => (
            "refining",
            f64::NAN,
            format!("round {round}, boundary error {error:.2e}, {sources} sources"),
        ),
    };
    ask(watcher, step, fraction, &detail)
}

/// Asks the callback whether the work goes on.
pub fn ask(watcher: &Watcher, step: &str, fraction: f64, detail: &str) -> ControlFlow<()> {
    match watcher.goes_on(step, fraction, detail) {
        true => ControlFlow::Continue(()),
        false => ControlFlow::Break(()),
    }
}

pub fn share(done: usize, of: usize) -> f64 {
    done as f64 / of.max(1) as f64
}
