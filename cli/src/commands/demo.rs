//! `solidmap demo`: maps, energies, carried meshes, pictures and pages of built-in models.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::{BoundaryMap, examples};
use solidmap::energy::{AdaptiveOptions, EnergyOptions, EnergyReport, adaptive_energies};
use solidmap::files::{self, MapFile, MapMetadata};
use solidmap::fit::{FitOptions, FitReport};
use solidmap::geometry::{Axis, distance_field, flipped_tets};
use solidmap::io;
use solidmap::map::{HarmonicMap, VolumeMap};
use solidmap::mesh::{SurfaceMesh, TetMesh};
use solidmap::remesh::{CellKind, CellSize, RemeshOptions, RemeshReport, RemeshSource, remesh};

use crate::CommandOutcome;
use crate::args::{DemoArgs, PageArgs, UpKind};
use crate::drawing::{Align, Camera, Colours, Edges, Figure, Panel, Shading, SurfaceStyle, Table};
use crate::shared::chosen_map::ChosenMap;
use crate::shared::fitting::fit_with_progress;
use crate::shared::json::FileName;
use crate::shared::made_folder::MadeFolder;
use crate::shared::map_page::MapPage;
use crate::shared::output::{Output, mebibytes, peak_rss_bytes, write_file};
use crate::shared::pictures::{Pictured, plane_across};
use crate::shared::{carried_mesh_file, carried_mesh_picture, mesh_page, page, remeshing};

/// Hexahedra along the longest side of a polycube.
const HEXES: usize = 32;
/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 560;
/// Width and height of a view.
const VIEW_PIXELS: [usize; 2] = [640, 560];

/// A built-in pair of solids and how to look at it.
struct DemoPair {
    name: &'static str,
    title: &'static str,
    boundary: BoundaryMap,
    camera: Camera,
    up: UpKind,
    /// Axis that sections are perpendicular to, through the middle of the domain.
    section: Axis,
    /// Axis perpendicular to the cut through the tet meshes.
    cut: Axis,
    is_polycube: bool,
}

impl DemoPair {
    fn with_up(self, up: UpKind) -> Self {
        let (axis, upside_down) = up.axis();
        let camera = Camera {
            up: axis,
            upside_down,
            ..self.camera
        };
        Self { camera, up, ..self }
    }
}

fn pairs() -> [DemoPair; 2] {
    [
        DemoPair {
            name: "animal",
            title: "From a polycube to a free-form solid",
            boundary: examples::polycube_to_animal(4),
            camera: Camera {
                azimuth: 35.0,
                elevation: 22.0,
                up: Axis::Z,
                upside_down: false,
            },
            up: UpKind::Z,
            section: Axis::Y,
            cut: Axis::Y,
            is_polycube: true,
        },
        DemoPair {
            name: "knot",
            title: "From a solid ring to a solid trefoil knot",
            boundary: examples::ring_to_knot(96, 24),
            camera: Camera {
                azimuth: 20.0,
                elevation: 50.0,
                up: Axis::Z,
                upside_down: false,
            },
            up: UpKind::Z,
            section: Axis::Z,
            cut: Axis::Z,
            is_polycube: false,
        },
    ]
}

/// What `demo --json` prints.
#[derive(Serialize)]
struct DemoSummary {
    folder: FileName,
    pairs: Vec<DemoPairSummary>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

#[derive(Serialize)]
struct DemoPairSummary {
    name: &'static str,
    fit: FitReport,
    energy: EnergyReport,
    /// Tetrahedra of the carried mesh; absent without CGAL and TetGen.
    tets: Option<usize>,
    inverted_tets: Option<usize>,
    /// The hexahedra that the domain is meshed with, where it is a polycube.
    remesh: Option<RemeshReport>,
}

/// Maps the built-in pairs, measures, pictures and writes everything.
pub fn run(args: &DemoArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    let mut reports = Vec::new();
    for pair in pairs().map(|pair| pair.with_up(args.up)) {
        let folder = args.out.join(pair.name);
        let _made = MadeFolder::new(&folder)?;
        reports.push(map_and_write(&pair, &folder, output).with_context(|| format!("cannot map the {}", pair.name))?);
    }
    let report = DemoSummary {
        folder: (&args.out).into(),
        pairs: reports,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    Ok(CommandOutcome::Done)
}

fn map_and_write(pair: &DemoPair, folder: &Path, output: &Output) -> anyhow::Result<DemoPairSummary> {
    output.note(format!(
        "{}: {} boundary vertices",
        pair.title,
        pair.boundary.domain().vertices().len()
    ));
    let fit = fit_with_progress(&pair.boundary, &FitOptions::default(), output)?;
    fit.report
        .warnings
        .iter()
        .for_each(|warning| output.warn_of_fit(warning));

    output.progress("integrating");
    let (domain, target) = (pair.boundary.domain(), pair.boundary.target());
    let options = EnergyOptions::default();
    let accuracy = AdaptiveOptions::default();
    let (quadrature, energy) = adaptive_energies(&fit.map, domain, target.volume(), &options, &accuracy)?;

    output.progress("writing");
    io::write_surface(folder.join("domain.obj"), domain)?;
    io::write_surface(folder.join("image.obj"), &target)?;
    let distances = distance_field(&target, &fit.map.evaluate(quadrature.points()))?;
    let fields = files::energy_fields(&energy.densities, &distances);
    files::write_cell_means(&folder.join("energy.vtu"), &quadrature, None, &fields)?;

    output.progress("drawing");
    let pictured = Pictured {
        map: &fit.map,
        domain,
        target: &target,
        options,
        up: pair.up,
        colours: Colours::default(),
    };
    let mut panels = pictured.section(plane_across(pair.section, 0.5, domain), SECTION_PIXELS)?;
    panels.push(pictured.target_section(plane_across(pair.section, 0.5, &target), SECTION_PIXELS)?);
    let rows = panels.chunks(2).map(<[_]>::to_vec).collect();
    save(&folder.join("sections.png"), &Figure::grid(rows).titled(pair.title))?;

    output.progress("carrying a tet mesh");
    let carried = carry(domain, &fit.map)?;
    let mut views = vec![surface_views(pair, domain, &target)?];
    if let Some(carried) = &carried {
        io::write_tets(folder.join("domain_tets.vtu"), &carried.before)?;
        io::write_tets(folder.join("carried_tets.vtu"), &carried.after)?;
        views.push(cut_views(pair, carried)?);
    }
    save(&folder.join("map.png"), &Figure::grid(views).titled(pair.title))?;

    let remesh = if pair.is_polycube {
        Some(hexahedra(pair, &fit.map, folder, output)?)
    } else {
        None
    };

    let metadata = MapMetadata::new(fit.report.clone(), vec![]);
    let file = MapFile {
        map: fit.map,
        boundary: Some(fit.boundary),
        bijective: None,
        metadata,
    };
    let path = folder.join("map.safetensors");
    files::write_map(&path, &file)?;
    let page = MapPage {
        path: &path,
        chosen: ChosenMap::Harmonic(&file.map),
        boundary: &pair.boundary,
        metadata: &file.metadata,
        energy: &energy,
        options,
        up: pair.up,
        certificate: None,
        carried: None,
    };
    page::write(&folder.join("map.html"), &page.make(&PageArgs::default(), output)?.html)?;
    output.finish();
    Ok(DemoPairSummary {
        name: pair.name,
        fit: fit.report,
        energy,
        tets: carried.as_ref().map(|c| c.before.tets().len()),
        inverted_tets: carried.as_ref().and_then(CarriedTets::flipped),
        remesh,
    })
}

/// A regular mesh of the polycube, carried and repaired.
fn hexahedra(pair: &DemoPair, map: &HarmonicMap, folder: &Path, output: &Output) -> anyhow::Result<RemeshReport> {
    let source = RemeshSource::Regular {
        kind: CellKind::Hexes,
        size: CellSize::Along(HEXES),
        most_cells: 1_000_000,
    };
    let progress = |phase| remeshing::show_phase(phase, "", output);
    let meshed = remesh(&pair.boundary, map, source, &RemeshOptions::default(), &progress)?;
    let origin = concat!("solidmap ", env!("CARGO_PKG_VERSION"), ": mesh of `solidmap demo`");
    let path = folder.join("hexahedra.vtu");
    carried_mesh_file::write(&path, &meshed, &meshed.images, origin)?;
    mesh_page::write_of_file(
        &folder.join("hexahedra.html"),
        &path,
        pair.up,
        &PageArgs::default().size,
    )?;
    let figure = carried_mesh_picture::figure(&meshed, "Repaired", [pair.up; 2])?;
    save(&folder.join("hexahedra.png"), &figure.titled(pair.title))?;
    Ok(meshed.report)
}

/// A tet mesh of the domain, and the same mesh with its vertices mapped.
struct CarriedTets {
    before: TetMesh,
    after: TetMesh,
}

impl CarriedTets {
    fn flipped(&self) -> Option<usize> {
        let found = flipped_tets(&self.before, self.after.vertices())?;
        Some(found.against_most(self.before.tets().len()))
    }
}

#[cfg(feature = "native")]
fn carry(domain: &SurfaceMesh, map: &HarmonicMap) -> anyhow::Result<Option<CarriedTets>> {
    let before = solidmap::cgal_tetgen::tetrahedralize(domain, &solidmap::cgal_tetgen::TetOptions::default())?;
    let images = map.evaluate(before.vertices());
    let after = before
        .with_vertices(images)
        .context("the map gave another number of images than points")?;
    Ok(Some(CarriedTets { before, after }))
}

#[cfg(not(feature = "native"))]
fn carry(_: &SurfaceMesh, _: &HarmonicMap) -> anyhow::Result<Option<CarriedTets>> {
    Ok(None)
}

fn surface_views(pair: &DemoPair, domain: &SurfaceMesh, target: &SurfaceMesh) -> anyhow::Result<Vec<Panel>> {
    let style = SurfaceStyle {
        edges: Edges::All,
        ..SurfaceStyle::default()
    };
    let view = |surface| Panel::of_surface(surface, &style, &pair.camera, VIEW_PIXELS);
    Ok(vec![view(domain)?.titled("Domain"), view(target)?.titled("Target")])
}

/// The tetrahedra of one half of the domain, and their images.
fn cut_views(pair: &DemoPair, carried: &CarriedTets) -> anyhow::Result<Vec<Panel>> {
    let axis = pair.cut.index();
    let (low, high) = carried.before.bounding_box().context("the tet mesh is empty")?;
    let middle = (low[axis] + high[axis]) / 2.0;
    let is_in_front = pair.camera.towards_viewer()[axis] > 0.0;
    let half: Vec<[u32; 4]> = (0..carried.before.tets().len())
        .filter(|&t| {
            let height = carried.before.corners(t).iter().map(|p| p[axis]).sum::<f64>() / 4.0;
            // The half behind the cut.
            if is_in_front { height < middle } else { height > middle }
        })
        .map(|t| carried.before.tets()[t])
        .collect();
    let kept = TetMesh::new(carried.before.vertices().to_vec(), half)?.boundary();
    let images = kept
        .vertex_ids
        .iter()
        .map(|&v| carried.after.vertices()[v as usize])
        .collect();
    let after = kept
        .surface
        .with_vertices(images)
        .context("the boundary lost vertices")?;
    let style = SurfaceStyle {
        edges: Edges::All,
        shading: Shading::Flat,
        ..SurfaceStyle::default()
    };
    let view = |surface| Panel::of_surface(surface, &style, &pair.camera, VIEW_PIXELS);
    Ok(vec![
        view(&kept.surface)?.titled("Tetrahedra of one half"),
        view(&after)?.titled("The same, carried by the map"),
    ])
}

fn save(path: &Path, figure: &Figure) -> anyhow::Result<()> {
    write_file(path, &figure.to_png()?)
}

fn summary(report: &DemoSummary) -> String {
    let mut table = Table::new([
        ("pair", "", Align::Left),
        ("vertices", "", Align::Right),
        ("boundary error", "rms", Align::Right),
        ("", "99 %", Align::Right),
        ("", "max", Align::Right),
        ("harmonic", "energy", Align::Right),
        ("deformation", "energy", Align::Right),
        ("tets", "", Align::Right),
        ("flipped", "", Align::Right),
        ("hexes", "", Align::Right),
        ("inverted", "mapped", Align::Right),
        ("", "now", Align::Right),
        ("fit", "s", Align::Right),
    ]);
    let or_dash = |n: Option<usize>| n.map_or("-".into(), |n| n.to_string());
    for pair in &report.pairs {
        let error = pair.fit.boundary_error;
        table.row([
            pair.name.into(),
            pair.fit.vertices.to_string(),
            format!("{:.1e}", error.rms),
            format!("{:.1e}", error.p99),
            format!("{:.1e}", error.max),
            format!("{:.4}", pair.energy.harmonic),
            format!("{:.4}", pair.energy.deformation),
            or_dash(pair.tets),
            or_dash(pair.inverted_tets),
            or_dash(pair.remesh.as_ref().map(|r| r.cells)),
            or_dash(pair.remesh.as_ref().map(|r| r.before.cells.len())),
            or_dash(pair.remesh.as_ref().map(|r| r.after.cells.len())),
            pair.fit.seconds.map_or(String::new(), |s| format!("{:.2}", s.total)),
        ]);
    }
    format!(
        "{table}\nErrors at held-out boundary points, as fractions of the target's diagonal; energies with both \
         solids at unit volume.\nEverything took {:.1} s and {:.0} MiB. Look at {}",
        report.seconds,
        mebibytes(report.peak_rss_bytes),
        report.folder.join("*").join("map.html").display()
    )
}
