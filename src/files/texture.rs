//! Solid textures in files: safetensors, so that other programs read them too.
//!
//! | tensor | type, shape | meaning |
//! |---|---|---|
//! | `sources`, `coefficients`, `affine` | f64 | the harmonic part, as in map files |
//! | `vertices`, `triangles` | f64 n × 3, u32 m × 3 | the surface |
//! | `u`, `v` | f64, m × 3 | with a picture: the texture coordinates of each triangle's corners |
//! | `picture` | u8, pixels × 3 | its pixels in sRGB, row by row from the top |
//! | `colours` | f64, n × 3 | without a picture: the linear RGB colour of each vertex, 0 to 1 |
//!
//! The metadata hold the quantity that was extended, the size of the picture and its wrap mode, and the report of the
//! fit.

use std::path::Path;

use super::tensor_file::{GENERATOR, Reader, TEXTURE, Tensor};
use super::{Provenance, TensorFileError, map};
use crate::fit::FitReport;
use crate::io::read_bytes;
use crate::mesh::SurfaceMesh;
use crate::texture::{ColourSource, ColouredSurface, ExtendedQuantity, Picture, SolidTexture, Wrap};

/// A solid texture as stored.
#[derive(Debug, Clone)]
pub struct TextureFile {
    /// The texture.
    pub texture: SolidTexture,
    /// What else the file says.
    pub metadata: TextureMetadata,
}

/// What a texture file says about its texture.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TextureMetadata {
    /// `major.minor` of the format.
    pub format_version: String,
    /// Program and version that wrote the file.
    pub generator: String,
    /// Report of the fit of the harmonic part, without the times it took.
    pub fit: FitReport,
    /// The files the texture was made from.
    #[serde(default)]
    pub inputs: Vec<Provenance>,
}

impl TextureMetadata {
    /// Metadata of a texture that this program has just made.
    pub fn new(fit: FitReport, inputs: Vec<Provenance>) -> Self {
        Self {
            format_version: TEXTURE.format_version(),
            generator: GENERATOR.into(),
            fit: FitReport { seconds: None, ..fit },
            inputs,
        }
    }
}

#[derive(serde::Serialize, serde::Deserialize)]
struct TextureHeader {
    #[serde(flatten)]
    metadata: TextureMetadata,
    extended: ExtendedQuantity,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    picture: Option<PictureHeader>,
}

#[derive(Clone, Copy, serde::Serialize, serde::Deserialize)]
struct PictureHeader {
    width: usize,
    height: usize,
    wrap: Wrap,
}

/// Writes a texture file. The same texture gives the same bytes.
///
/// # Errors
///
/// When the file cannot be written.
pub fn write_texture(path: &Path, file: &TextureFile) -> Result<(), TensorFileError> {
    let texture = &file.texture;
    let surface = texture.coloured_surface().surface();
    let mut tensors = Vec::from(map::tensors_of(texture.map()));
    tensors.push(Tensor::points("vertices", surface.vertices()));
    tensors.push(Tensor::triangles("triangles", surface.triangles()));
    let mut header = TextureHeader {
        metadata: file.metadata.clone(),
        extended: texture.extended(),
        picture: None,
    };
    match texture.coloured_surface().colour_source() {
        ColourSource::Picture { uv, picture, wrap } => {
            for (name, k) in [("u", 0), ("v", 1)] {
                let along: Vec<[f64; 3]> = uv.iter().map(|corners| corners.map(|uv| uv[k])).collect();
                tensors.push(Tensor::rows(name, along.iter()));
            }
            tensors.push(Tensor::bytes("picture", picture.pixels()));
            header.picture = Some(PictureHeader {
                width: picture.width(),
                height: picture.height(),
                wrap: *wrap,
            });
        }
        ColourSource::Vertices(colours) => tensors.push(Tensor::rows("colours", colours.iter())),
    }
    TEXTURE.write(path, &header, &tensors)
}

/// Reads a texture file.
///
/// # Errors
///
/// When it cannot be read, is not a complete texture file, or is of a newer major version.
pub fn read_texture(path: &Path) -> Result<TextureFile, TensorFileError> {
    let content = read_bytes(path)?;
    let reader = Reader::new(&TEXTURE, path, &content)?;
    let header: TextureHeader = reader.metadata()?;
    let map = map::read_tensors(&reader)?.with_error(header.metadata.fit.residual_rms);
    let coloured = read_coloured_surface(&reader, header.picture)?;
    let texture = SolidTexture::from_parts(coloured, header.extended, map, header.metadata.fit.clone())
        .map_err(|error| reader.problem("sources", format!("cannot be used: {error}")))?;
    Ok(TextureFile {
        texture,
        metadata: header.metadata,
    })
}

fn read_coloured_surface(reader: &Reader, picture: Option<PictureHeader>) -> Result<ColouredSurface, TensorFileError> {
    let surface = SurfaceMesh::new(reader.points("vertices")?, reader.triangles("triangles")?)
        .map_err(|error| reader.problem("triangles", format!("does not fit the vertices: {error}")))?;
    let Some(PictureHeader { width, height, wrap }) = picture else {
        let colours = reader.rows("colours")?;
        return ColouredSurface::from_vertex_colours(&surface, colours)
            .map_err(|error| reader.problem("colours", format!("cannot be used: {error}")));
    };
    let (u, v) = (reader.rows::<3>("u")?, reader.rows::<3>("v")?);
    if u.len() != v.len() {
        return Err(reader.problem("v", format!("has {} rows, and `u` {}", v.len(), u.len())));
    }
    let corners = u.iter().zip(&v).map(|(u, v)| std::array::from_fn(|k| [u[k], v[k]]));
    let picture = Picture::new(width, height, reader.bytes("picture")?)
        .map_err(|error| reader.problem("picture", format!("cannot be used: {error}")))?;
    ColouredSurface::from_picture(&surface, corners.collect(), picture, wrap)
        .map_err(|error| reader.problem("u", format!("cannot be used: {error}")))
}
