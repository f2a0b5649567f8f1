//! `solidmap hexmesh`: a model's mesh of hexahedra, by its polycube.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::files::{self, MapFile, MapMetadata};
use solidmap::fit::{Fit, FitOptions, FitReport};
use solidmap::hexmesh::{Hexmesh, HexmeshOptions, HexmeshPhase, make_hexmesh};
use solidmap::io;
use solidmap::model_polycube::{Polycube, PolycubeKind};
use solidmap::polycube::{PolycubeMap, PolycubeOptions};
use solidmap::remesh::{CellSize, RemeshOptions};

use crate::CommandOutcome;
use crate::args::HexmeshArgs;
use crate::drawing::significant;
use crate::shared::carried_mesh_report::{self, CarriedMeshReport};
use crate::shared::json::{FileName, file_name};
use crate::shared::made_folder::MadeFolder;
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns, write_file, written_row};
use crate::shared::places::with_places;
use crate::shared::polycubes::{self, PolycubeSummary};
use crate::shared::remeshing::remesh_options;
use crate::shared::{carried_mesh_file, carried_mesh_picture, fitting, input, mesh_page, page, remeshing};

/// Extensions of meshes that can be written.
const OUTPUTS: [&str; 4] = ["msh", "mesh", "vtu", "vtk"];

/// What is written into the folder of `--keep`.
struct Kept;

impl Kept {
    const POLYCUBE: &str = "polycube.obj";
    const MODEL: &str = "model.obj";
    const POLYCUBE_TETS: &str = "polycube_tets.vtu";
    const MODEL_TETS: &str = "model_tets.vtu";
    const DOMAIN: &str = "domain.vtu";
    const MAP: &str = "map.safetensors";

    const fn names() -> [&'static str; 6] {
        [
            Self::POLYCUBE,
            Self::MODEL,
            Self::POLYCUBE_TETS,
            Self::MODEL_TETS,
            Self::DOMAIN,
            Self::MAP,
        ]
    }
}

/// Their extensions.
const KEPT: &[&str] = &["obj", "vtu", "safetensors"];

/// What `hexmesh --json` prints.
#[derive(Serialize)]
struct HexmeshSummary {
    model: FileName,
    /// None where no polycube was found.
    output: Option<FileName>,
    /// The folder of `--keep`.
    keep: Option<FileName>,
    /// The picture; none where there was nothing to draw.
    picture: Option<FileName>,
    page: Option<FileName>,
    /// Why no polycube was found.
    problem: Option<String>,
    #[serde(flatten)]
    polycube: PolycubeSummary,
    fit: Option<FitReport>,
    /// As `remesh` reports it.
    mesh: Option<CarriedMeshReport>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Makes the mesh, and writes it.
pub fn run(args: &HexmeshArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let outputs: [(Option<&PathBuf>, &[&str]); 3] = [
        (Some(&args.output), &OUTPUTS),
        (args.png.as_ref(), &["png"]),
        (args.html.as_ref(), &page::EXTENSIONS),
    ];
    input::require_all_writable(&outputs, &[&args.model])?;
    ensure!(args.cells > 0, "--cells is 0, but must be at least 1");
    ensure!(
        args.max_distance > 0.0,
        "--max-distance is {}, but must be positive",
        args.max_distance
    );
    let folder = args.keep.as_deref().map(MadeFolder::new).transpose()?;
    if let Some(folder) = &args.keep {
        let others: Vec<&Path> = [
            Some(&args.model),
            Some(&args.output),
            args.png.as_ref(),
            args.html.as_ref(),
        ]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
        let kept = Kept::names().map(|name| folder.join(name));
        let kept = kept.each_ref().map(|path| (Some(path), KEPT));
        input::require_all_writable(&kept, &others)?;
    }
    output.progress("reading");
    let start = Instant::now();
    let tets = polycubes::tetrahedra(&args.model, output)?;
    let options = options(args);
    let attempt = Cell::new(1);
    let progress = |phase| match phase {
        HexmeshPhase::Polycube(phase) => polycubes::show_phase(phase, &attempt, output),
        HexmeshPhase::Fitting(phase) => fitting::show_phase(phase, "", output),
        HexmeshPhase::Remeshing(phase) => remeshing::show_phase(phase, "", output),
    };
    let made = match make_hexmesh(&tets, &options, &progress) {
        Ok(made) => Ok(made),
        Err(error) if error.is_without_polycube() => Err(error.to_string()),
        Err(error) => {
            let hint = match args.polycube.into() {
                PolycubeKind::Voxels => " by voxels (`--polycube deformed` or `auto` may do)",
                _ => "",
            };
            return Err(error).with_context(|| format!("cannot mesh `{}`{hint}", args.model.display()));
        }
    };
    let summary = HexmeshSummary {
        model: (&args.model).into(),
        output: None,
        keep: None,
        picture: None,
        page: None,
        problem: None,
        polycube: PolycubeSummary::default(),
        fit: None,
        mesh: None,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: 0,
    };
    let summary = match made {
        Ok(made) => written(made, args, &options, summary, output)?,
        Err(problem) => {
            output.warn(format!("nothing was written: {problem}"));
            HexmeshSummary {
                problem: Some(problem),
                peak_rss_bytes: peak_rss_bytes(),
                ..summary
            }
        }
    };
    drop(folder);
    let places = summary.mesh.as_ref().map_or(&[][..], |mesh| &mesh.worst_places);
    output.result(&summary, || with_places(two_columns(rows(&summary)), places))?;
    let is_valid = |mesh: &CarriedMeshReport| mesh.is_valid() && is_close(mesh, args);
    let is_valid = summary.mesh.as_ref().is_some_and(is_valid);
    Ok(CommandOutcome::from_check(is_valid))
}

/// Whether neither the mesh misses a part of the model, nor sticks out of it.
fn is_close(mesh: &CarriedMeshReport, args: &HexmeshArgs) -> bool {
    mesh.remesh.farthest() <= args.max_distance
}

/// Relative change of the volume that is warned of.
const MOST_VOLUME_CHANGE: f64 = 0.1;

/// The library's options, from the arguments.
fn options(args: &HexmeshArgs) -> HexmeshOptions {
    let polycube = PolycubeOptions::default();
    HexmeshOptions {
        kind: args.kind.into(),
        size: match args.cell_size {
            Some(length) => CellSize::Length(length),
            None => CellSize::Along(args.cells),
        },
        most_cells: args.repair.max_cells,
        max_distance: args.max_distance,
        most_vertices: args.max_vertices,
        polycube_kind: args.polycube.into(),
        polycube: PolycubeOptions {
            smoothness: args.smoothness.smoothness,
            feature_angle: args.smoothness.features,
            orientation: args.orient.orient.into(),
            ..polycube
        },
        fit: FitOptions {
            tolerance: args.tolerance,
            memory: args.repair.memory,
            ..FitOptions::adaptive()
        },
        remesh: RemeshOptions {
            polish: args.polish,
            polish_valid: args.polish > 0,
            ..remesh_options(&args.repair)
        },
    }
}

/// Writes all files, warns of what is wrong, and adds both to the summary.
fn written(
    made: Hexmesh,
    args: &HexmeshArgs,
    options: &HexmeshOptions,
    summary: HexmeshSummary,
    output: &Output,
) -> anyhow::Result<HexmeshSummary> {
    output.progress("writing");
    let model = input::provenance("model", &args.model)?;
    let hash = model.sha256.get(..16).unwrap_or(&model.sha256);
    let origin = format!(
        "solidmap {}: mesh of {} (SHA-256 {hash})",
        env!("CARGO_PKG_VERSION"),
        model.file
    );
    let Hexmesh {
        polycube,
        fit,
        remeshed,
    } = made;
    carried_mesh_file::write(&args.output, &remeshed, &remeshed.images, &origin)?;
    let deformed = match &polycube {
        Polycube::Deformed(found, _) => Some(found.as_ref()),
        Polycube::Voxels(..) => None,
    };
    if deformed.is_some_and(|found| found.report.lattice.is_none()) {
        output.warn(
            "no polycube was found with its faces on the lattice of the cells: between faces that are close there are thin \
             cells. Smaller cells may help",
        );
    }
    if !options.fit.is_met_by(&fit.report) {
        output.warn(format!(
            "the map meets the model's surface only to {:.1e} of its diagonal, and the tolerance is {:.1e}; the mesh's boundary is \
             on the surface all the same",
            fit.report.boundary_error.p99, args.tolerance
        ));
    }
    fit.report
        .warnings
        .iter()
        .for_each(|warning| output.warn_of_fit(warning));
    let mesh = CarriedMeshReport::new(&remeshed, args.places.worst);
    mesh.warn(&args.output, args.repair.split_stuck != Some(0), true, output);
    if !is_close(&mesh, args) {
        let [missed, beyond] =
            [&mesh.remesh.target_to_mesh, &mesh.remesh.mesh_to_target].map(|to| significant(to.max, 2));
        output.warn(format!(
            "the mesh is not close to the model: a point of the model is {missed} of the diagonal away from it, and a point of its \
             boundary {beyond} from the model; {} are allowed (--max-distance). Smaller cells or another --polycube may help",
            args.max_distance
        ));
    }
    let hint = "Another number of cells or --orient principal may help";
    if let Some(warning) = carried_mesh_report::poor_cells(&remeshed, hint) {
        output.warn(warning);
    }
    let change = mesh.remesh.volume / mesh.remesh.target_volume - 1.0;
    if change.abs() > MOST_VOLUME_CHANGE {
        output.warn(format!(
            "the mesh has a volume {} % {} than the model's: parts of the model are thinner than the cells. Smaller cells help",
            significant(100.0 * change.abs(), 2),
            if change > 0.0 { "larger" } else { "smaller" }
        ));
    }
    if let Some(folder) = &args.keep {
        keep(folder, deformed, &fit)?;
        carried_mesh_file::write(&folder.join(Kept::DOMAIN), &remeshed, remeshed.mesh.nodes(), &origin)?;
        let file = MapFile {
            map: fit.map,
            boundary: Some(fit.boundary),
            bijective: None,
            metadata: MapMetadata::new(fit.report.clone(), vec![model]),
        };
        files::write_map(&folder.join(Kept::MAP), &file)?;
    }
    let ups = [args.up, args.up];
    let draw = || carried_mesh_picture::png(&remeshed, false, ups, output);
    let picture = args.png.as_ref().zip(args.png.as_ref().and_then(|_| draw()));
    if let Some((path, png)) = &picture {
        write_file(path, png)?;
    }
    if let Some(path) = &args.html {
        mesh_page::write_of_file(path, &args.output, args.up, &args.page)?;
    }
    Ok(HexmeshSummary {
        output: Some((&args.output).into()),
        keep: file_name(args.keep.as_ref()),
        picture: file_name(picture.map(|(path, _)| path)),
        page: file_name(args.html.as_ref()),
        polycube: PolycubeSummary::of(&polycube),
        fit: Some(fit.report),
        mesh: Some(mesh),
        peak_rss_bytes: peak_rss_bytes(),
        ..summary
    })
}

/// Writes the polycube and the model, with the same triangles, and tetrahedra if the polycube has any.
fn keep(folder: &Path, polycube: Option<&PolycubeMap>, fit: &Fit) -> anyhow::Result<()> {
    for (name, surface) in [
        (Kept::POLYCUBE, fit.boundary.domain()),
        (Kept::MODEL, &fit.boundary.target()),
    ] {
        io::write_surface(folder.join(name), surface)?;
    }
    let Some(polycube) = polycube else { return Ok(()) };
    for (name, tets) in [
        (Kept::POLYCUBE_TETS, &polycube.polycube),
        (Kept::MODEL_TETS, &polycube.model),
    ] {
        io::write_tets(folder.join(name), tets)?;
    }
    Ok(())
}

fn rows(summary: &HexmeshSummary) -> Vec<[String; 2]> {
    let mut rows = summary.polycube.rows();
    if let Some(fit) = &summary.fit {
        rows.push([
            "fit".into(),
            format!(
                "{} sources, boundary error {} over 99 % of the area, of the model's diagonal",
                fit.sources,
                significant(fit.boundary_error.p99, 2)
            ),
        ]);
    }
    if let Some(mesh) = &summary.mesh {
        rows.extend(carried_mesh_report::rows(mesh, false));
    }
    rows.push(["in all".into(), format!("{:.1} s", summary.seconds)]);
    rows.push(memory_row(summary.peak_rss_bytes));
    if summary.output.is_some() {
        let files = [&summary.output, &summary.keep, &summary.picture, &summary.page];
        rows.push(written_row(files.map(Option::as_ref)));
    }
    rows
}
