//! Times of fits whose boundary values are harmonic polynomials at every point of the boundary, and their errors inside.
//!
//! `cargo run --release --example smooth_fits -- MODEL...` prints for each model and tolerance the sources, the median time of
//! three fits that take turns, in seconds, and the largest error at points inside, over the diagonal of the image.

use std::time::Instant;

use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{FitOptions, fit};
use solidmap::geometry::SurfaceQuery;
use solidmap::map::VolumeMap;
use solidmap::mesh::{SurfaceMesh, SurfacePoint};
use solidmap::{Point, io};

const TOLERANCES: [f64; 3] = [1e-3, 1e-5, 1e-6];
const REPETITIONS: usize = 3;
/// Points along each side of the grid of those inside.
const ALONG: usize = 12;

fn main() {
    for model in std::env::args().skip(1) {
        if let Err(error) = measure(&model) {
            eprintln!("error: {model}: {error}");
            std::process::exit(1);
        }
    }
}

fn measure(model: &str) -> Result<(), Box<dyn std::error::Error>> {
    let domain = io::read_surface(model)?;
    let (low, high) = domain.bounding_box().ok_or("no vertices")?;
    let (centre, half) = (nalgebra::center(&low, &high), (high - low).norm() / 2.0);
    let polynomials = move |p: &Point| {
        let (x, y, z) = (
            (p.x - centre.x) / half,
            (p.y - centre.y) / half,
            (p.z - centre.z) / half,
        );
        Point::new(x * x - y * y + 3.0 * x, 2.0 * x * y + 3.0 * y, 3.0 * z + 0.6 * x * z)
    };
    let places: Vec<Point> = domain.vertices().iter().map(polynomials).collect();
    let image = SurfaceMesh::new(places, domain.triangles().to_vec())?;
    let bounds = image.bounding_box().ok_or("no vertices")?;
    let surface = domain.clone();
    let value = move |p: &SurfacePoint| polynomials(&p.position(&surface, surface.vertices()));
    let query = SurfaceQuery::new(&domain)?;
    let along = |k: usize, i: usize| low[k] + (high[k] - low[k]) * (i as f64 + 0.5) / ALONG as f64;
    let inside: Vec<Point> = (0..ALONG.pow(3))
        .map(|i| {
            Point::new(
                along(0, i % ALONG),
                along(1, i / ALONG % ALONG),
                along(2, i / ALONG / ALONG),
            )
        })
        .filter(|p| query.contains(p))
        .collect();
    let exact: Vec<Point> = inside.iter().map(polynomials).collect();
    let vertices = domain.vertices().len();
    let boundary = BoundaryMap::by_function(domain, bounds, value)?;

    let mut seconds = [const { Vec::new() }; TOLERANCES.len()];
    let mut found = [(0, 0.0); TOLERANCES.len()];
    for _ in 0..REPETITIONS {
        for (k, tolerance) in TOLERANCES.into_iter().enumerate() {
            let options = FitOptions {
                tolerance,
                ..FitOptions::default()
            };
            let start = Instant::now();
            let fitted = fit(&boundary, &options, &|_| {})?;
            seconds[k].push(start.elapsed().as_secs_f64());
            let images = fitted.map.evaluate(&inside);
            let errors = images.iter().zip(&exact).map(|(image, exact)| (image - exact).norm());
            found[k] = (
                fitted.map.sources().len(),
                errors.fold(0.0, f64::max) / image.diagonal(),
            );
        }
    }
    for ((tolerance, mut seconds), (sources, error)) in TOLERANCES.into_iter().zip(seconds).zip(found) {
        seconds.sort_by(f64::total_cmp);
        let median = seconds[REPETITIONS / 2];
        println!(
            "{model}, {vertices} vertices, {tolerance:e}: {sources} sources, {median:.2} s, error inside {error:.1e}"
        );
    }
    Ok(())
}
