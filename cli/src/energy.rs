//! `solidmap energy`

use std::path::{Path, PathBuf};

use crate::drawing::{Figure, significant};
use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::energy::{
    CellLayout, EnergyOptions, EnergyReport, GridResolution, Lame, Quadrature, clipped_grid, energies, tet_quadrature,
};
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::mesh::{HEXAHEDRON, SurfaceMesh, TetMesh};

use super::args::EnergyArgs;
use super::output::{Output, pairs};
use super::pictures::{Pictured, depths};
use super::{Outcome, input};

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 640;

/// What `energy --json` prints.
#[derive(Serialize)]
struct Report {
    map: PathBuf,
    cells: usize,
    points: usize,
    #[serde(flatten)]
    energy: EnergyReport,
}

/// Measures the energies of a map and writes their distribution.
pub fn run(args: &EnergyArgs, output: &Output) -> anyhow::Result<Outcome> {
    args.section.require_valid()?;
    ensure!(
        args.lame.iter().all(|constant| constant.is_finite()),
        "--lame is {} {}, but must be two finite numbers",
        args.lame[0],
        args.lame[1]
    );
    let inputs: Vec<&Path> = std::iter::once(&args.map)
        .chain(&args.mesh)
        .map(PathBuf::as_path)
        .collect();
    for (path, extension) in [(&args.vtu, "vtu"), (&args.png, "png")] {
        if let Some(path) = path {
            input::require_writable(path, &[extension], &inputs)?;
        }
    }
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let target = boundary.outward_target();
    let options = EnergyOptions {
        normalize: !args.no_normalize,
        lame: Lame {
            lambda: args.lame[0],
            mu: args.lame[1],
        },
    };
    let mesh = args.mesh.as_ref().map(io::read_tets).transpose()?;

    ensure!(
        args.no_normalize || target.volume() > 1e-12 * target.diagonal().powi(3),
        "the target of `{}` encloses no volume that could be scaled to one; use --no-normalize",
        args.map.display()
    );
    output.progress("integrating");
    let unfit = |what: &str, path: &Path| format!("cannot measure {what} `{}`", path.display());
    let quadrature = match (&mesh, &args.mesh) {
        (Some(mesh), Some(path)) => tet_quadrature(mesh).with_context(|| unfit("in", path))?,
        _ => clipped_grid(
            boundary.domain(),
            GridResolution::CellsAlongLongestSide(args.resolution),
        )
        .with_context(|| unfit("over the domain of", &args.map))?,
    };
    if let Some(path) = &args.mesh {
        require_same_solid(path, quadrature.volume(), boundary.domain())?;
    }
    let energy = energies(
        &file.map,
        &quadrature,
        quadrature.volume(),
        boundary.target_volume(),
        &options,
    )
    .with_context(|| format!("cannot measure `{}`", args.map.display()))?;

    if let Some(path) = &args.vtu {
        output.progress("writing");
        let deep = depths(
            &target,
            &solidmap::map::VolumeMap::evaluate(&file.map, quadrature.points()),
        )?;
        write_cells(path, &quadrature, mesh.as_ref(), &energy, &deep)?;
    }
    if let Some(path) = &args.png {
        output.progress("drawing");
        let pictured = Pictured {
            map: &file.map,
            domain: boundary.domain(),
            target: &target,
            options,
            up: args.section.up.into(),
        };
        let panels = pictured.section(args.section.plane(boundary.domain()), SECTION_PIXELS)?;
        let png = Figure::row(panels).to_png()?;
        io::atomic_write(path, |writer| writer.write_all(&png))?;
    }

    let cells = quadrature.cell_means(&energy.densities.harmonic).len();
    let report = Report {
        map: args.map.clone(),
        cells,
        points: quadrature.points().len(),
        energy,
    };
    output.result(&report, || pairs(energy_rows(&report.energy)))?;
    Ok(Outcome::Done)
}

/// The lines of the summary that say what energies a map has.
fn energy_rows(energy: &EnergyReport) -> Vec<[String; 2]> {
    let scaled = if energy.normalized {
        "both solids at unit volume"
    } else {
        "in model units"
    };
    let (harmonic, deformation, det) = (
        &energy.harmonic_density,
        &energy.deformation_density,
        &energy.det_jacobian,
    );
    let row = |name: &str, total: f64, d: &solidmap::energy::DensityQuantiles| {
        [
            name.to_owned(),
            format!(
                "{total:<12.6} density {:.3e} to {:.3e}, median {:.3e}",
                d.min, d.max, d.median
            ),
        ]
    };
    vec![
        row("harmonic energy", energy.harmonic, harmonic),
        row("deformation energy", energy.deformation, deformation),
        [String::new(), scaled.into()],
        [
            "volume".into(),
            format!(
                "{} → {}",
                significant(energy.volume, 6),
                significant(energy.target_volume, 6)
            ),
        ],
        [
            "det J".into(),
            format!("{:.3e} to {:.3e}, median {:.3e}", det.min, det.max, det.median),
        ],
        [
            "folded".into(),
            format!(
                "{} points, {:.2} % of the volume",
                energy.inverted_points,
                100.0 * energy.inverted_fraction
            ),
        ],
    ]
}

/// A mesh of another solid reaches beyond the domain, where the map means nothing.
fn require_same_solid(mesh: &Path, volume: f64, domain: &SurfaceMesh) -> anyhow::Result<()> {
    let expected = domain.volume();
    ensure!(
        (volume / expected - 1.0).abs() < 0.05,
        "`{}` has a volume of {volume:.6}, and the domain of the map {expected:.6}; give a tet mesh of the domain \
         (`solidmap tet`)",
        mesh.display()
    );
    Ok(())
}

/// Mean densities of all cells: boxes of the grid, whole also where the solid cuts them, or tetrahedra.
pub fn write_cells(
    path: &Path,
    quadrature: &Quadrature,
    mesh: Option<&TetMesh>,
    energy: &EnergyReport,
    depth: &[f64],
) -> anyhow::Result<()> {
    let densities = &energy.densities;
    let fields = [
        ("harmonic_energy", &densities.harmonic[..]),
        ("deformation_energy", &densities.deformation),
        ("det_jacobian", &densities.det_jacobian),
        ("transferred_distance", depth),
    ];
    let cells: Vec<u32> = quadrature
        .cell_means(&densities.harmonic)
        .iter()
        .map(|c| c.cell)
        .collect();
    let scalar = |name: &str, values| Field {
        name: name.into(),
        components: 1,
        values,
    };
    let means = |values| quadrature.cell_means(values).iter().map(|c| c.mean).collect();
    let mut cell: Vec<Field> = fields
        .iter()
        .map(|&(name, values)| scalar(name, means(values)))
        .collect();
    let volumes = quadrature
        .cell_means(&densities.harmonic)
        .iter()
        .map(|c| c.volume)
        .collect();
    cell.push(scalar("volume_inside", volumes));
    let fields = VtkFields {
        cell,
        ..VtkFields::default()
    };
    match (quadrature.layout(), mesh) {
        (CellLayout::Tets { .. }, Some(mesh)) => {
            let tets: Vec<_> = cells.iter().map(|&c| mesh.tets()[c as usize]).collect();
            io::write_vtu(path, mesh.vertices(), Cells::Tets(&tets), &fields)?;
        }
        (CellLayout::Grid(grid), _) => {
            let (points, hexes) = boxes(&grid, &cells);
            io::write_vtu(path, &points, Cells::Hexes(&hexes), &fields)?;
        }
        (CellLayout::Tets { .. }, None) => anyhow::bail!("a distribution over tetrahedra needs their mesh"),
    }
    Ok(())
}

/// Corners and hexahedra of boxes, corners shared.
pub fn boxes(grid: &solidmap::energy::Grid, cells: &[u32]) -> (Vec<Point>, Vec<[u32; 8]>) {
    let mut index = std::collections::HashMap::new();
    let mut points = Vec::new();
    let hexes = cells.iter().map(|&cell| {
        let steps = grid.steps(cell);
        HEXAHEDRON.map(|corner| {
            let key: [usize; 3] = std::array::from_fn(|k| steps[k] + usize::from(corner[k]));
            *index.entry(key).or_insert_with(|| {
                let along = |k: usize| grid.origin[k] + key[k] as f64 * grid.cell_size;
                points.push(Point::new(along(0), along(1), along(2)));
                (points.len() - 1) as u32
            })
        })
    });
    let hexes = hexes.collect();
    (points, hexes)
}
