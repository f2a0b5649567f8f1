#![no_main]

use solidmap::io::{read_fields, read_points};
use solidmap_fuzz::{named, with_file};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file("vti", bytes, |path| {
    named(path, read_points(path));
    named(path, read_fields(path));
}));
