//! The model: a texture file, or a surface with its picture or colours.

use std::path::Path;

use anyhow::{Context, bail};
use solidmap::files::{self, TextureFile};
use solidmap::io::{self, TexturedSurface};
use solidmap::texture::{ColouredSurface, Picture, Wrap, decoded};

use crate::args::{TextureArgs, WrapKind};
use crate::shared::input::{self, extension};
use crate::shared::picture_file::read_picture;

pub fn is_texture_file(path: &Path) -> bool {
    extension(path) == "safetensors"
}

/// Where the colours come from.
pub enum Model {
    Textured(Box<TextureFile>),
    Coloured(ColouredSurface),
}

impl Model {
    pub fn read(args: &TextureArgs) -> anyhow::Result<Self> {
        Ok(if is_texture_file(&args.model) {
            Self::Textured(Box::new(files::read_texture(&args.model)?))
        } else {
            Self::Coloured(read_coloured_surface(args)?)
        })
    }

    pub fn coloured_surface(&self) -> &ColouredSurface {
        match self {
            Self::Textured(file) => file.texture.coloured_surface(),
            Self::Coloured(surface) => surface,
        }
    }
}

/// The model with its picture, checker or colours.
fn read_coloured_surface(args: &TextureArgs) -> anyhow::Result<ColouredSurface> {
    let shown = args.model.display();
    let TexturedSurface { surface, uv, colours } = match args.model.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("obj") => io::read_textured_surface(&args.model)?,
        // Other formats are read without colours; the errors below say what is missing.
        _ => TexturedSurface {
            surface: input::read_surface(&args.model)?,
            uv: None,
            colours: None,
        },
    };
    let wrap = match args.wrap {
        None | Some(WrapKind::Repeat) => Wrap::Repeat,
        Some(WrapKind::Clamp) => Wrap::Clamp,
    };
    let picture = match (&args.image, args.checker) {
        (Some(path), _) => Some(read_picture(path)?),
        (None, Some(squares)) => Some(Picture::checker(squares)?),
        (None, None) => None,
    };
    let coloured = match (picture, uv, colours) {
        (Some(picture), Some(uv), _) => ColouredSurface::from_picture(&surface, uv, picture, wrap),
        (Some(_), None, _) => bail!(
            "`{shown}` has no texture coordinates, so that no picture can be laid on it: unwrap it and save it as OBJ \
             with them (`vt`)"
        ),
        (None, _, Some(_)) if args.wrap.is_some() => bail!(
            "--wrap says what is beyond the edges of a picture, but `{shown}` is coloured by its vertices: leave it \
             out, or name a picture with --image"
        ),
        (None, _, Some(colours)) => {
            require_codes(&colours).with_context(|| format!("cannot texture `{shown}`"))?;
            ColouredSurface::from_vertex_colours(&surface, colours.into_iter().map(decoded).collect())
        }
        (None, Some(_), None) => bail!(
            "`{shown}` has texture coordinates but no colours of its own: name a picture with --image, or take a \
             --checker"
        ),
        (None, None, None) => bail!(
            "`{shown}` has neither texture coordinates nor colours: give an OBJ with `vt` and a picture (--image), or \
             with coloured vertices (`v x y z r g b`)"
        ),
    };
    coloured.with_context(|| format!("cannot texture `{shown}`"))
}

/// How far colours of vertices may be outside 0 to 1, as rounding leaves them.
const CODE_SLACK: f64 = 1e-3;

/// Refuses colours that [`decoded`] would clamp.
fn require_codes(colours: &[[f64; 3]]) -> anyhow::Result<()> {
    let allowed = -CODE_SLACK..=1.0 + CODE_SLACK;
    let beyond = |colour: &[f64; 3]| !colour.iter().all(|code| allowed.contains(code));
    if let Some(vertex) = colours.iter().position(beyond) {
        let [r, g, b] = colours[vertex];
        bail!(
            "the colour of vertex {vertex} (0-based) is {r} {g} {b}, but red, green and blue go from 0 to 1; divide \
             colours that go to 255 by 255"
        );
    }
    Ok(())
}
