//! The commands: one file or folder each, none of which imports another. What they share is in [`crate::shared`].

pub mod bijective;
pub mod boundary;
pub mod certify;
pub mod check;
pub mod compare;
pub mod demo;
pub mod energy;
pub mod eval;
pub mod fit;
pub mod hexmesh;
#[cfg(feature = "native")]
pub mod offset;
pub mod polycube;
pub mod remesh;
pub mod sequence;
pub mod study;
#[cfg(feature = "native")]
pub mod tet;
pub mod texture;
pub mod transfer;
pub mod view;
