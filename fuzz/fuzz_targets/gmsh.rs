#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| solidmap_fuzz::read_mesh("msh", bytes));
