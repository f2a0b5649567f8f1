//! Builds the C++ behind `src/cgal_tetgen` when the feature `native` is on.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "native")]
    native::build();
}

/// Lints link nothing, so they need not wait minutes for the C++ to build.
#[cfg(feature = "native")]
fn is_lint() -> bool {
    println!("cargo::rerun-if-env-changed=RUSTC_WORKSPACE_WRAPPER");
    std::env::var("RUSTC_WORKSPACE_WRAPPER").is_ok_and(|wrapper| wrapper.contains("clippy"))
}

#[cfg(feature = "native")]
fn watch(folder: &str) {
    for entry in std::fs::read_dir(folder)
        .unwrap_or_else(|error| panic!("{folder} is part of the source tree: {error}"))
        .flatten()
    {
        println!("cargo::rerun-if-changed={}", entry.path().display());
    }
}

#[cfg(feature = "native")]
mod native {
    use std::path::{Path, PathBuf};
    use std::process::Command;

    const SOURCES: &str = "src/cgal_tetgen/cpp";
    const ADVICE: &str = "install what the feature `native` needs with `apt-get install cmake g++ libcgal-dev \
        libtet1.5-dev libeigen3-dev`, or build without it: `cargo build --no-default-features`";

    pub fn build() {
        if super::is_lint() {
            return;
        }
        super::watch(SOURCES);
        println!("cargo::rerun-if-changed=src/cgal_tetgen/bridge.rs");

        if Command::new("cmake").arg("--version").output().is_err() {
            fail("cmake is missing");
        }
        // CGAL unoptimised is a hundred times slower, so its library is a release build in every cargo profile.
        let mut config = cmake::Config::new(SOURCES);
        config.profile("Release").out_dir(folder());
        let library = std::panic::catch_unwind(move || config.build())
            .unwrap_or_else(|_| fail("the C++ of the feature `native` did not build (see above)"));

        // Before the library that it calls: static archives are searched in this order.
        cxx_build::bridge("src/cgal_tetgen/bridge.rs")
            .file("src/cgal_tetgen/cpp/glue.cpp")
            .include(SOURCES)
            .std("c++17")
            .compile("solidmap_native_glue");
        println!("cargo::rustc-link-search=native={}", library.join("lib").display());
        println!("cargo::rustc-link-lib=static=solidmap_native");
        for shared in ["tet", "mpfr", "gmp", "stdc++"] {
            println!("cargo::rustc-link-lib=dylib={shared}");
        }
    }

    /// One folder per profile: cargo has one for each set of features, and the templates would be compiled in each.
    fn folder() -> PathBuf {
        let own = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets it"));
        // target/release/build/solidmap-0123456789abcdef/out
        let mut above = own.ancestors().skip(2);
        let (build, profile) = (above.next(), above.next());
        match (build.and_then(Path::file_name), profile) {
            (Some(name), Some(profile)) if name == "build" => {
                profile.join(format!("solidmap-native-{:016x}", checkout_hash()))
            }
            _ => own,
        }
    }

    /// FNV-1a hash of the package's path, which tells checkouts that share a target folder apart.
    fn checkout_hash() -> u64 {
        let folder = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
        folder.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
    }

    fn fail(what: &str) -> ! {
        println!("cargo::error={what}; {ADVICE}");
        std::process::exit(1);
    }
}
