//! The bridge from C++ to Rust: what the classes in `cpp/src` call.
//!
//! Users of the package see `cpp/include`, never this. Every function that can fail returns an [`error::Error`] with a
//! category, and lets no panic through: both arrive in C++ as one exception type. Arrays are passed as slices, three
//! coordinates per point.

mod bijective;
mod bridge;
mod error;
mod hexmesh;
mod maps;
mod measures;
mod meshes;
mod model_polycube;
mod polycube;
mod solids;

use solidmap::Point;

fn licence() -> String {
    solidmap::LICENCE.into()
}

fn version() -> String {
    env!("CARGO_PKG_VERSION").into()
}

fn has_native() -> bool {
    cfg!(feature = "native")
}

/// Points as coordinates, three each.
fn flat(points: &[Point]) -> &[f64] {
    // SAFETY: a `Point` is three doubles and nothing else, by `repr(C)` and `repr(transparent)` at every level; size
    // and alignment are checked at compile time.
    const { assert!(size_of::<Point>() == 3 * size_of::<f64>() && align_of::<Point>() == align_of::<f64>()) };
    unsafe { std::slice::from_raw_parts(points.as_ptr().cast(), 3 * points.len()) }
}

/// Coordinates as points; one or two left over at the end are ignored.
fn points(coordinates: &[f64]) -> &[Point] {
    let whole = coordinates.as_chunks::<3>().0;
    // SAFETY: as in `flat`, the other way round.
    unsafe { std::slice::from_raw_parts(whole.as_ptr().cast(), whole.len()) }
}

/// A path from its bytes, in the system's own encoding; UTF-8 on Windows.
fn path(bytes: &[u8]) -> Result<std::path::PathBuf, error::Error> {
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        Ok(std::ffi::OsStr::from_bytes(bytes).into())
    }
    #[cfg(not(unix))]
    {
        let text = std::str::from_utf8(bytes);
        text.map(Into::into)
            .map_err(|_| error::Error::invalid("the path is not valid UTF-8"))
    }
}
