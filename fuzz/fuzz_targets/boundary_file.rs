#![no_main]

use solidmap_fuzz::{named, tensor_file, with_file};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file("boundary", &tensor_file(bytes), |path| {
    named(path, solidmap::files::read_boundary(path));
}));
