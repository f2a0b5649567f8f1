//! Tests of the library through its public interface, in one program, which links once.

mod analytic;
mod architecture;
mod bijective;
mod cancel;
mod certificate;
#[cfg(feature = "native")]
mod cgal_tetgen;
mod common;
mod compare;
mod free_sources;
mod hyperbolic;
mod intrinsic;
mod invariance;
mod inverse;
mod io;
#[cfg(feature = "native")]
mod oracles;
mod pair;
mod remesh;
mod schwarz;
mod sequence;
mod shells;
mod spherical;
mod texture;
mod torus;
mod transfer;
