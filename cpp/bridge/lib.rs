//! The outward bridge (feature `cpp`): what the C++ package in `cpp/` calls.
//!
//! Users of the package see `cpp/include`, never this. Here every entry that can fail returns a [`error::Error`] with a
//! category, and no panic leaves it: both arrive in C++ as one exception type. Arrays come in as slices and go out in
//! bulk, three numbers a point.

mod bridge;
mod error;
mod maps;
mod measures;
mod meshes;
mod solids;

use solidmap::Point;

/// What the program and the package say about the licence of this build.
fn licence() -> String {
    solidmap::LICENCE.into()
}

fn version() -> String {
    env!("CARGO_PKG_VERSION").into()
}

fn has_native() -> bool {
    cfg!(feature = "native")
}

/// Points as plain numbers, three each.
fn flat(points: &[Point]) -> &[f64] {
    // SAFETY: a `Point` is three doubles and nothing else, by `repr(C)` and `repr(transparent)` all the way down; the
    // size is checked at compile time.
    const { assert!(size_of::<Point>() == 3 * size_of::<f64>() && align_of::<Point>() == align_of::<f64>()) };
    unsafe { std::slice::from_raw_parts(points.as_ptr().cast(), 3 * points.len()) }
}

/// Plain numbers as points; what does not make up a point is left out.
fn points(numbers: &[f64]) -> &[Point] {
    let whole = numbers.as_chunks::<3>().0;
    // SAFETY: as in `flat`, the other way round.
    unsafe { std::slice::from_raw_parts(whole.as_ptr().cast(), whole.len()) }
}

/// A path in the bytes of the system.
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
