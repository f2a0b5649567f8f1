//! A fit of any surface to any image gives a map or an error.
#![no_main]

use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{FitOptions, fit};
use solidmap_fuzz::surface;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let half = bytes.len() / 2;
    if let Some(domain) = surface(&bytes[..half])
        && let Some(image) = surface(&bytes[half..])
    {
        let images = image.vertices().iter().cycle().take(domain.vertices().len());
        let images = images.zip(domain.vertices()).map(|(q, p)| p + q.coords * 0.1).collect();
        let Ok(boundary) = BoundaryMap::new(domain, images) else {
            return;
        };
        let options = FitOptions {
            max_sources: 60,
            refine: false,
            held_out: 50,
            ..FitOptions::default()
        };
        let _ = fit(&boundary, &options, &|_| {});
    }
});
