#![no_main]

use solidmap_fuzz::{named, with_file};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file("png", bytes, |path| {
    named(path, solidmap_cli::read_picture(path));
}));
