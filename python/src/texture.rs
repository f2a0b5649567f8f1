//! Colours of surfaces, extended into solids.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{
    PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use serde_json::json;
use solidmap::Point;
use solidmap::files::{self, MapFile, TextureFile, TextureMetadata};
use solidmap::fit::FitOptions;
use solidmap::inverse::InverseOptions;
use solidmap::io::{self, ImageGrid};
use solidmap::texture::{
    ColouredSurface, ExtendedQuantity, Picture, SolidTexture, TextureOptions, VoxelGrid, VoxelTexture, Wrap, decoded,
    to_srgb,
};

use crate::arrays::{Points, copy_of_corners, copy_of_rows, rows};
use crate::boundary::{Inputs, provenance, value_of};
use crate::error::Failure;
use crate::fit::fit_step;
use crate::map::{Kind, Map, PreparedInverse, boundary_of};
use crate::meshes::Surface;
use crate::run::{part, run, step};

/// Default of the largest number of sources, as in the program.
const MOST_SOURCES: usize = 100_000;

/// The program's options of textures.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TextureArguments {
    checker: Option<usize>,
    wrap: String,
    uv: bool,
    across_seams: bool,
    sources: Option<usize>,
    tolerance: Option<f64>,
    max_sources: Option<usize>,
}

/// A surface in an OBJ file, with its texture coordinates at the corners of triangles and its colours of vertices.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "parts of a file")]
pub fn read_textured_surface(
    py: Python<'_>,
    path: PathBuf,
) -> PyResult<(
    Surface,
    Option<Bound<'_, PyArray3<f64>>>,
    Option<Bound<'_, PyArray2<f64>>>,
)> {
    let read = run(py, None, None, move |_| {
        let is_obj = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"));
        Ok(match is_obj {
            true => io::read_textured_surface(&path)?,
            // Other formats are read without colours.
            false => io::TexturedSurface {
                surface: io::read_solid(&path)?.into_surface(),
                uv: None,
                colours: None,
            },
        })
    })?;
    Ok((
        Surface::of(read.surface),
        read.uv.map(|uv| copy_of_corners(py, &uv)),
        read.colours.map(|colours| copy_of_rows(py, &colours)),
    ))
}

/// A solid texture.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Texture(Arc<TextureFile>);

#[pymethods]
impl Texture {
    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Self> {
        run(py, None, None, move |_| Ok(Self(Arc::new(files::read_texture(&path)?))))
    }

    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let file = Arc::clone(&self.0);
        run(py, None, None, move |_| Ok(files::write_texture(&path, &file)?))
    }

    #[getter]
    fn surface(&self) -> Surface {
        Surface::of(self.0.texture.coloured_surface().surface().clone())
    }

    #[getter]
    fn report_json(&self, py: Python) -> PyResult<String> {
        let file = Arc::clone(&self.0);
        run(py, None, None, move |_| {
            let texture = &file.texture;
            let options = FitOptions::default();
            let mut all = json!({ "fit": value_of(texture.report())? });
            all["extended"] = value_of(&texture.extended())?;
            all["seams"] = value_of(&texture.coloured_surface().seams())?;
            all["layer_thickness"] = json!(texture.layer_thickness());
            all["harmonic_error"] = value_of(&texture.harmonic_error(options.held_out, options.seed))?;
            all["surface_error"] = value_of(&texture.surface_error(options.held_out, options.seed))?;
            Ok(all.to_string())
        })
    }

    /// 8-bit sRGB colours of points, and whether each has one. With a map, the points are in its target.
    #[pyo3(signature = (points, through=None, kind=None))]
    #[allow(clippy::type_complexity, reason = "columns of a table")]
    fn colours<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        through: Option<&Map>,
        kind: Option<&str>,
    ) -> PyResult<(Bound<'py, PyArray2<u8>>, Bound<'py, PyArray1<bool>>)> {
        let (file, points) = (Arc::clone(&self.0), Points::of("points", &points)?);
        let through = Through::of(through, kind)?;
        let light = run(py, None, None, move |_| match through {
            None => Ok(file.texture.sample(&points)),
            Some(through) => Ok(file.texture.sample_through(through.prepared()?.inverse(), &points).0),
        })?;
        let has_colour: Vec<bool> = light.iter().map(|light| light.iter().all(|c| c.is_finite())).collect();
        let colours: Vec<u8> = light
            .iter()
            .zip(&has_colour)
            .flat_map(|(&light, &has)| match has {
                true => to_srgb(light),
                false => [0; 3],
            })
            .collect();
        Ok((
            PyArray1::from_vec(py, colours).reshape([has_colour.len(), 3])?,
            PyArray1::from_vec(py, has_colour),
        ))
    }

    /// A volume of voxels: the centre of the first, their side, their colours in 8-bit sRGB with opacity (layers along z, rows
    /// along y, voxels along x), and how many are in the solid. With a map, it is that of the map's target.
    #[pyo3(signature = (resolution, through=None, kind=None, progress=None))]
    #[allow(clippy::type_complexity, reason = "parts of a volume")]
    fn volume<'py>(
        &self,
        py: Python<'py>,
        resolution: usize,
        through: Option<&Map>,
        kind: Option<&str>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<([f64; 3], f64, Bound<'py, PyArray4<u8>>, usize)> {
        let (file, through) = (Arc::clone(&self.0), Through::of(through, kind)?);
        let volume = run(py, progress, None, move |watch| {
            let texture = &file.texture;
            let of_voxels = |grid: &VoxelGrid| {
                let voxels = grid.voxels();
                move |done| watch.tell_or_unwind(|| part("sampling voxels", done, voxels))
            };
            Ok(match through {
                None => {
                    let grid = VoxelGrid::of(texture.coloured_surface().surface(), resolution)?;
                    texture.volume(&grid, &of_voxels(&grid))
                }
                Some(through) => {
                    let grid = VoxelGrid::of(&boundary_of(&through.file)?.outward_target(), resolution)?;
                    let prepared = through.prepared()?;
                    let sample = |centres: &[Point]| texture.sample_through(prepared.inverse(), centres).0;
                    VoxelTexture::sampled(&grid, sample, &of_voxels(&grid))
                }
            })
        })?;
        let VoxelGrid { origin, spacing, size } = volume.grid;
        let [width, height, depth] = size;
        let bytes = PyArray1::from_vec(py, volume.rgba.into_flattened());
        let colours = bytes.reshape([depth, height, width, 4])?;
        Ok(([origin.x, origin.y, origin.z], spacing, colours, volume.inside))
    }
}

/// Writes a volume of voxels, as [`Texture::volume`] makes it.
#[pyfunction]
pub fn write_volume(
    py: Python,
    path: PathBuf,
    origin: [f64; 3],
    spacing: f64,
    rgba: PyReadonlyArray4<u8>,
) -> PyResult<()> {
    let bytes = rgba
        .as_slice()
        .map_err(|_| Failure::invalid("rgba is not in C order"))?;
    let bytes = bytes.to_vec();
    let [depth, height, width] = [0, 1, 2].map(|axis| rgba.shape()[axis]);
    let grid = ImageGrid {
        origin: Point::from(origin),
        spacing,
        size: [width, height, depth],
    };
    run(py, None, None, move |_| {
        Ok(io::write_vti(&path, &grid, "rgba", 4, &bytes)?)
    })
}

/// A map whose domain is the solid, and whose target has the colours of preimages.
struct Through {
    file: Arc<MapFile>,
    kind: Kind,
    kept: Option<Arc<PreparedInverse>>,
}

impl Through {
    fn of(map: Option<&Map>, kind: Option<&str>) -> Result<Option<Self>, Failure> {
        let of = |map: &Map| {
            let kind = map.kind(kind)?;
            let kept = map.kept_inverse(kind, InverseOptions::default().tolerance);
            let file = Arc::clone(&map.file);
            Ok(Self { file, kind, kept })
        };
        map.map(of).transpose()
    }

    fn prepared(&self) -> Result<Arc<PreparedInverse>, Failure> {
        boundary_of(&self.file)?;
        match &self.kept {
            Some(kept) => Ok(Arc::clone(kept)),
            None => {
                let tolerance = InverseOptions::default().tolerance;
                Ok(Arc::new(PreparedInverse::new(
                    Arc::clone(&self.file),
                    self.kind,
                    tolerance,
                )?))
            }
        }
    }
}

fn picture_of(image: &PyReadonlyArray3<'_, u8>) -> Result<Picture, Failure> {
    let [height, width, channels] = [0, 1, 2].map(|axis| image.shape()[axis]);
    if channels != 3 {
        return Err(Failure::invalid(format!(
            "image has {channels} channels, but must have 3: red, green and blue"
        )));
    }
    let slice = image
        .as_slice()
        .map_err(|_| Failure::invalid("image is not in C order"))?;
    Ok(Picture::new(width, height, slice.as_chunks::<3>().0.to_vec())?)
}

/// Extends the colours of a surface into the solid.
#[pyfunction]
#[pyo3(signature = (surface, arguments, inputs, coordinates=None, image=None, colours=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "it is called from Python, by keywords")]
pub fn texture(
    py: Python,
    surface: &Surface,
    arguments: TextureArguments,
    inputs: Inputs,
    coordinates: Option<PyReadonlyArray3<f64>>,
    image: Option<PyReadonlyArray3<u8>>,
    colours: Option<PyReadonlyArray2<f64>>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Texture> {
    let picture = match (&image, arguments.checker) {
        (Some(image), _) => Some(picture_of(image)?),
        (None, Some(squares)) => Some(Picture::checker(squares).map_err(Failure::from)?),
        (None, None) => None,
    };
    let wrap = match arguments.wrap.as_str() {
        "clamp" => Wrap::Clamp,
        _ => Wrap::Repeat,
    };
    let coloured = match (picture, coordinates, colours) {
        (Some(picture), Some(uv), _) => {
            let slice = uv
                .as_slice()
                .map_err(|_| Failure::invalid("coordinates is not in C order"))?;
            let uv = slice.as_chunks::<2>().0.as_chunks::<3>().0.to_vec();
            ColouredSurface::from_picture(&surface.0, uv, picture, wrap)
        }
        (_, _, Some(colours)) => {
            let colours = rows::<f64, 3>("colours", &colours)?;
            ColouredSurface::from_vertex_colours(&surface.0, colours.iter().map(|&code| decoded(code)).collect())
        }
        _ => {
            return Err(Failure::invalid(
                "there is nothing to extend: give colours of the vertices, or coordinates with an image or a checker",
            )
            .into());
        }
    };
    let coloured = coloured.map_err(Failure::from)?;
    let by_default = TextureOptions::default();
    let max_sources = arguments.max_sources.unwrap_or(MOST_SOURCES);
    let options = TextureOptions {
        extended: match arguments.uv {
            true => ExtendedQuantity::Coordinates,
            false => ExtendedQuantity::Colours,
        },
        across_seams: arguments.across_seams,
        least_sources: arguments.sources.unwrap_or(by_default.least_sources.min(max_sources)),
        fit: FitOptions {
            refine: arguments.tolerance.is_some(),
            tolerance: arguments.tolerance.unwrap_or(by_default.fit.tolerance),
            max_sources,
            max_source_ratio: f64::INFINITY,
            ..by_default.fit
        },
    };
    run(py, progress, None, move |watch| {
        let _ = watch.tell(|| step("extending colours"));
        let texture = SolidTexture::fit(coloured, &options, &|phase| watch.tell_or_unwind(|| fit_step(phase)))?;
        let metadata = TextureMetadata::new(texture.report().clone(), provenance(&inputs)?);
        Ok(Texture(Arc::new(TextureFile { texture, metadata })))
    })
}
