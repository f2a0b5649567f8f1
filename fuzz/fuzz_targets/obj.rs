#![no_main]

use solidmap::io::{read_solid, read_textured_surface};
use solidmap_fuzz::{named, with_file};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file("obj", bytes, |path| {
    named(path, read_solid(path));
    named(path, read_textured_surface(path));
}));
