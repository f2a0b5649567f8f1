//! Maps to the sphere: of a bumpy ball, and of the scan Igea when `SOLIDMAP_MODELS` names the models.

use criterion::{BenchmarkId, Criterion, Throughput};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::{SphereEnergy, SphereOptions, map_to_sphere};

/// From the surface to the checked map.
pub fn sphere(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("boundary/sphere");
    group.sample_size(10);
    for (name, surface) in [("10k", Some(shapes::bumpy_sphere(32))), ("igea_134k", igea())] {
        let Some(surface) = surface else { continue };
        group.throughput(Throughput::Elements(surface.vertices().len() as u64));
        for (kept, energy) in [
            ("balanced", SphereEnergy::Balanced),
            ("conformal", SphereEnergy::Conformal),
        ] {
            let options = SphereOptions {
                energy,
                ..SphereOptions::default()
            };
            group.bench_function(BenchmarkId::new(kept, name), |b| {
                b.iter(|| map_to_sphere(&surface, &options, &|_| {}));
            });
        }
    }
    group.finish();
}

fn igea() -> Option<SurfaceMesh> {
    let Some(models) = std::env::var_os("SOLIDMAP_MODELS") else {
        eprintln!("SKIPPED: SOLIDMAP_MODELS does not name the folder of real models");
        return None;
    };
    io::read_surface(std::path::Path::new(&models).join("surfaces/igea_134k.ply")).ok()
}
