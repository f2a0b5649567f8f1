//! Maps to the sphere, and between pairs without a given correspondence: of balls, and of real models when `SOLIDMAP_MODELS` names
//! them.

use criterion::{BenchmarkId, Criterion, SamplingMode, Throughput};
use solidmap::boundary_map::pair::{PairOptions, map_pair};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};
use solidmap::spherical::{SphereEnergy, SphereOptions, map_to_sphere};

/// From the surface to the checked map.
pub fn sphere(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("boundary/sphere");
    group.sample_size(10);
    for (name, surface) in [
        ("10k", Some(shapes::bumpy_sphere(32))),
        ("igea_134k", model("surfaces/igea_134k.ply")),
    ] {
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

/// From two surfaces to the map between them: the target's embedding, the search among coarse embeddings, and the refinement of the
/// best. Several seconds each.
pub fn pair(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("boundary/pair");
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    let balls = Some((shapes::bumpy_sphere(16), shapes::sphere(1.0, 4)));
    let real = |domain, target| model(domain).zip(model(target));
    for (name, pair) in [
        ("balls_3k", balls),
        ("cat_to_horse_8k", real("pairs/cat.obj", "pairs/horse.obj")),
        (
            "max_planck_to_igea_27k",
            real("surfaces/max_planck_27k.obj", "surfaces/igea_15k.obj"),
        ),
    ] {
        let Some((domain, target)) = pair else { continue };
        group.throughput(Throughput::Elements(domain.vertices().len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| map_pair(&domain, &target, &PairOptions::default(), &|_| {}));
        });
    }
    group.finish();
}

fn model(file: &str) -> Option<SurfaceMesh> {
    let Some(models) = std::env::var_os("SOLIDMAP_MODELS") else {
        eprintln!("SKIPPED: SOLIDMAP_MODELS does not name the folder of real models");
        return None;
    };
    io::read_surface(std::path::Path::new(&models).join(file)).ok()
}
