#![no_main]

use solidmap::files::{read_components, read_landmark_curves, read_landmark_files, read_landmarks};
use solidmap_fuzz::{named, with_file};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file("txt", bytes, |path| {
    named(path, read_landmarks(path, 20, 1000));
    named(path, read_landmark_files(path, path, 1000, 20));
    named(path, read_landmark_curves(path));
    named(path, read_components(path));
}));
