//! `check`, with surfaces of any shape and any coordinates.
#![no_main]

use solidmap_fuzz::{examine, surface};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Some((&most_edges, bytes)) = bytes.split_first()
        && let Some(surface) = surface(bytes)
    {
        examine(&surface, usize::from(most_edges));
    }
});
