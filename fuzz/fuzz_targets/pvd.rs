#![no_main]

use solidmap::io;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    solidmap_fuzz::with_file("pvd", bytes, |path| solidmap_fuzz::named(path, io::read_pvd(path)));
});
