//! Builds the C++ behind `src/native` when the feature `native` is on.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "native")]
    native::build();
}

#[cfg(feature = "native")]
mod native {
    use std::process::Command;

    const SOURCES: &str = "cpp/native";
    const ADVICE: &str = "install what the feature `native` needs with `apt-get install cmake g++ libcgal-dev \
        libtet1.5-dev libeigen3-dev`, or build without it: `cargo build --no-default-features --features cli`";

    pub fn build() {
        println!("cargo::rerun-if-env-changed=RUSTC_WORKSPACE_WRAPPER");
        // Lints link nothing, and would otherwise build minutes of templates a second time in a folder of their own.
        if std::env::var("RUSTC_WORKSPACE_WRAPPER").is_ok_and(|wrapper| wrapper.contains("clippy")) {
            return;
        }
        for entry in std::fs::read_dir(SOURCES)
            .expect("cpp/native is part of the source tree")
            .flatten()
        {
            println!("cargo::rerun-if-changed={}", entry.path().display());
        }
        println!("cargo::rerun-if-changed=src/native/bridge.rs");

        if Command::new("cmake").arg("--version").output().is_err() {
            fail("cmake is missing");
        }
        // CGAL unoptimised is a hundred times slower, so its library is a release build in every cargo profile.
        let library = std::panic::catch_unwind(|| cmake::Config::new(SOURCES).profile("Release").build())
            .unwrap_or_else(|_| fail("the C++ of the feature `native` did not build (see above)"));

        // Before the library that it calls: static archives are searched in this order.
        cxx_build::bridge("src/native/bridge.rs")
            .file("cpp/native/glue.cpp")
            .include(SOURCES)
            .std("c++17")
            .compile("solidmap_native_glue");
        println!("cargo::rustc-link-search=native={}", library.join("lib").display());
        println!("cargo::rustc-link-lib=static=solidmap_native");
        for shared in ["tet", "mpfr", "gmp", "stdc++"] {
            println!("cargo::rustc-link-lib=dylib={shared}");
        }
    }

    fn fail(what: &str) -> ! {
        println!("cargo::error={what}; {ADVICE}");
        std::process::exit(1);
    }
}
