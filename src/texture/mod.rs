//! Solid textures: the picture on a surface extended into the solid (section 5.4 and figure 11 of Li et al., *Harmonic
//! volumetric mapping for solid modeling applications*, 2007).
//!
//! The boundary values are colours, or texture coordinates, instead of positions, and the method of fundamental
//! solutions extends them harmonically. Its sources resolve details down to their spacing. The remainder of a finer
//! picture is added in a thin layer under the surface, so that the solid texture equals the picture there:
//!
//! `c(x) = H(x) + w(d/h) · (picture(p) − H(p))`
//!
//! with `H` the harmonic function, `p` the point of the surface closest to `x` at the distance `d`, and `h` the spacing
//! of the sources at `p`: also their distance from the surface. `w` falls from 1 to 0 as Wendland's function `(1 − s)⁴
//! (4s + 1)` (*Piecewise polynomial, positive definite and compactly supported radial functions of minimal degree*,
//! Adv. Comput. Math. 4, 1995), about as fast as the harmonic extension of the coarsest wave that sources with spacing
//! `h` do not resolve, `exp(−πd/h)`. Deeper than `h` the texture is harmonic.
//!
//! Where the solid is thinner than two spacings, the closest point jumps inside the layer, and with it the texture, by
//! at most `w` times twice the error of the harmonic part.

mod colour;
mod coloured_surface;
mod error;
mod picture;
mod solid;
mod volume;

pub use colour::{LinearRgb, decoded, from_srgb, to_srgb};
pub use coloured_surface::{ColourSource, ColouredSurface, SeamReport};
pub use error::TextureError;
pub use picture::{Picture, Wrap};
pub use solid::{ColourError, ExtendedQuantity, SolidTexture, TextureOptions};
pub use volume::{VoxelGrid, VoxelTexture};
