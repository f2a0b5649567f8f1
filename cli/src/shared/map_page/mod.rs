//! The page of a map: domain and target side by side, cut anywhere, coloured by any of the map's densities.

mod certified;
mod fields;
mod lattice;
mod numbers;

use std::path::Path;

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::certificate::Certificate;
use solidmap::energy::{
    AdaptiveOptions, EnergyOptions, EnergyReport, Lame, UnitVolumeScale, adaptive_energies, cell_quadrature, energies,
};
use solidmap::files::MapMetadata;
use solidmap::geometry::Axis;
use solidmap::map::HarmonicMap;
use solidmap::mesh::CellMesh;

use super::chosen_map::{ChosenMap, MapName};
use super::input;
use super::output::Output;
use super::page::{Framing, NumberTable, PackedArray, Page, PageField, megabytes};
use crate::args::{PageArgs, UpKind};
pub use fields::{CarriedScalar, CarriedScalars};
use lattice::LatticeSamples;

/// A map to make a page of.
pub struct MapPage<'a> {
    /// Its file.
    pub path: &'a Path,
    /// The map.
    pub chosen: ChosenMap<'a>,
    /// The boundary map it was fitted to.
    pub boundary: &'a BoundaryMap,
    /// What the file says about it.
    pub metadata: &'a MapMetadata,
    /// Its energies, measured with `options`.
    pub energy: &'a EnergyReport,
    /// How energies are measured: with both solids at unit volume.
    pub options: EnergyOptions,
    /// What points up.
    pub up: UpKind,
    /// What is proved of it.
    pub certificate: Option<&'a Certificate>,
    /// What it carries.
    pub carried: Option<CarriedScalars<'a>>,
}

/// The energies of a map, for its page: a bijective one is integrated exactly by its own tetrahedra.
pub fn measured(chosen: ChosenMap, boundary: &BoundaryMap, options: &EnergyOptions) -> anyhow::Result<EnergyReport> {
    let target_volume = boundary.target_volume();
    if let ChosenMap::Bijective(map) = chosen {
        let quadrature = cell_quadrature(&CellMesh::from(map.domain().clone()))?;
        return Ok(energies(map, &quadrature, quadrature.volume(), target_volume, options)?);
    }
    let accuracy = AdaptiveOptions::default();
    let (_, report) = adaptive_energies(chosen.map(), boundary.domain(), target_volume, options, &accuracy)?;
    Ok(report)
}

/// A page, and what was left out to keep it small.
pub struct MadePage {
    /// Its text.
    pub html: String,
    /// Samples along the axes.
    pub samples: [usize; 3],
    /// Whether they are fewer than asked for.
    pub is_coarser: bool,
}

/// Most sources that are written to a page, which sums over them for the point under the pointer.
const MOST_SOURCES: usize = 500_000;
/// Fewest samples along the longest side that a page is made with, however small it must be.
const FEWEST_SAMPLES: usize = 8;

/// What the scripts of the page read, besides the arrays.
#[derive(Serialize)]
struct MapContent {
    kind: &'static str,
    map_kind: MapName,
    domain: Framing,
    target: Framing,
    lattice: LatticeContent,
    /// Factor of the Jacobian that brings both solids to unit volume.
    scale: f64,
    /// −1 where the target is a mirror image.
    orientation: f64,
    lame: Lame,
    fields: Vec<PageField>,
    /// Whether the map's sources are there, so that scripts evaluate it exactly.
    exact: bool,
    affine: [[f64; 3]; 4],
    /// The axis that points up, and whether it does so by its negative end.
    up: (usize, bool),
}

#[derive(Serialize)]
struct LatticeContent {
    low: [f64; 3],
    step: f64,
    counts: [usize; 3],
}

impl MapPage<'_> {
    /// The page, sampled more coarsely than asked for where it would be too large.
    pub fn make(&self, args: &PageArgs, output: &Output) -> anyhow::Result<MadePage> {
        let wanted = usize::from(args.samples);
        let common = self.surfaces();
        let mut cells = wanted;
        loop {
            output.progress(format!("sampling the map at {cells} points along the domain"));
            let (html, samples) = self.with_samples(&common, cells, wanted, args.size.max_size)?;
            let size = html.len() as u64;
            if size <= args.size.max_size {
                let is_coarser = cells < wanted;
                if is_coarser {
                    let [nx, ny, nz] = samples;
                    output.warn(format!(
                        "the map is sampled more coarsely than asked for, at {nx} × {ny} × {nz} points, to keep to --max-size"
                    ));
                }
                return Ok(MadePage {
                    html,
                    samples,
                    is_coarser,
                });
            }
            ensure!(
                cells > FEWEST_SAMPLES,
                "the page takes {:.1} MB even with {FEWEST_SAMPLES} samples along the domain, but --max-size is {:.1} MB; \
                 allow more",
                megabytes(size),
                megabytes(args.size.max_size)
            );
            // The samples take a size with the cube of their number, and the rest is constant: a little fewer than that
            // says, so that the next page is small enough.
            let share = (args.size.max_size as f64 / size as f64).cbrt();
            cells = ((0.97 * share * cells as f64) as usize).clamp(FEWEST_SAMPLES, cells - 1);
        }
    }

    /// The arrays that do not depend on the samples.
    fn surfaces(&self) -> Vec<PackedArray> {
        let (domain, image) = (self.boundary.domain(), self.boundary.image());
        let corners = domain.triangles().iter().flatten().copied();
        let mut arrays = vec![
            PackedArray::floats("domain", Framing::of(domain.vertices()).place(domain.vertices())),
            PackedArray::floats("image", self.target_framing().place(image)),
            PackedArray::indices("triangles", corners),
        ];
        if let Some(map) = self.exact() {
            let sources = map.sources().iter().flat_map(|p| [p.x, p.y, p.z]);
            arrays.push(PackedArray::doubles("sources", sources));
            let coefficients = map.coefficients().sources.iter().flatten().copied();
            arrays.push(PackedArray::doubles("coefficients", coefficients));
        }
        if let Some(certificate) = self.certificate {
            arrays.extend(certified::boxes(certificate, Framing::of(domain.vertices())));
        }
        arrays
    }

    fn target_framing(&self) -> Framing {
        Framing::of(self.boundary.target().vertices())
    }

    /// The map, where its sources are few enough to be written.
    fn exact(&self) -> Option<&HarmonicMap> {
        match self.chosen {
            ChosenMap::Harmonic(map) => Some(map).filter(|map| map.sources().len() <= MOST_SOURCES),
            ChosenMap::Bijective(_) => None,
        }
    }

    fn with_samples(
        &self,
        surfaces: &[PackedArray],
        cells: usize,
        wanted: usize,
        max_size: u64,
    ) -> anyhow::Result<(String, [usize; 3])> {
        let (domain, target) = (self.boundary.domain(), self.boundary.outward_target());
        let (map, path) = (self.chosen.map(), self.path.display());
        let samples =
            LatticeSamples::of(map, domain, cells).with_context(|| format!("cannot search the domain of `{path}`"))?;
        let target_volume = self.boundary.target_volume();
        let scale = UnitVolumeScale::new(domain.volume(), target_volume)?;
        let orientation = target_volume.signum();
        let (fields, field_arrays) =
            fields::fields(&samples, &target, &scale, orientation, &self.options, self.carried)?;

        let (framing, target_framing) = (Framing::of(domain.vertices()), self.target_framing());
        let images: Vec<Vec<f64>> = samples
            .images
            .iter()
            .map(|image| target_framing.place([image]).collect())
            .collect();
        let coordinates = (0..3).map(|k| {
            let values = samples.spread(images.iter().map(|image| image[k]));
            PackedArray::floats(format!("lattice-{k}"), values)
        });
        let lattice = &samples.lattice;
        let mut arrays = surfaces.to_vec();
        arrays.extend(coordinates);
        arrays.extend(field_arrays);

        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let tables = [
            self.certificate.map(certified::table),
            Some(numbers::energies(self.energy)),
            numbers::fit(self.metadata),
        ];
        let mut notes = notes(
            lattice.step,
            lattice.counts,
            self.exact().is_some(),
            (cells, wanted, max_size),
        );
        notes.extend(self.certificate.and_then(certified::note));
        let page = Page {
            title: format!(
                "{name}: {} map",
                if self.exact_kind() { "harmonic" } else { "bijective" }
            ),
            files: self.files()?,
            notes,
            tables: tables.into_iter().flatten().collect::<Vec<NumberTable>>(),
            arrays,
        };
        let content = MapContent {
            kind: "map",
            map_kind: self.chosen.name(),
            domain: framing,
            target: target_framing,
            lattice: LatticeContent {
                low: lattice.low.into(),
                step: lattice.step,
                counts: lattice.counts,
            },
            scale: scale.jacobian,
            orientation,
            lame: self.options.lame,
            fields,
            exact: self.exact().is_some(),
            affine: self.exact().map_or([[0.0; 3]; 4], |map| map.coefficients().affine),
            up: (Axis::from(self.up).index(), self.up.is_upside_down()),
        };
        Ok((page.html(&content)?, lattice.counts))
    }

    fn exact_kind(&self) -> bool {
        matches!(self.chosen, ChosenMap::Harmonic(_))
    }

    /// The map file, and those it was made from.
    fn files(&self) -> anyhow::Result<Vec<solidmap::files::Provenance>> {
        let mut files = vec![input::provenance("map", self.path)?];
        files.extend(self.metadata.inputs.iter().cloned());
        Ok(files)
    }
}

/// What a reader must know.
fn notes(step: f64, counts: [usize; 3], exact: bool, (cells, wanted, max_size): (usize, usize, u64)) -> Vec<String> {
    let [nx, ny, nz] = counts;
    let mut notes = vec![format!(
        "Cuts are drawn from samples of the map at {nx} × {ny} × {nz} nodes, {step:.4} model units apart, and linear \
         between them: what is thinner is not seen, folds neither. Boundaries are drawn with all their triangles."
    )];
    if cells < wanted {
        notes.push(format!(
            "Sampled more coarsely than asked for, {cells} instead of {wanted} samples along the domain, so that the page is \
             no larger than {:.0} MB (--max-size).",
            megabytes(max_size)
        ));
    }
    notes.push(if exact {
        "The values under the pointer are those of the map itself, summed over its sources.".into()
    } else {
        "The values under the pointer are interpolated between the samples.".into()
    });
    notes
}
