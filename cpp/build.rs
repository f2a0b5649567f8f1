//! Compiles the package's C++ together with the bridge, so that the crate's static library contains both.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Lints link nothing, and need no C++.
    println!("cargo::rerun-if-env-changed=RUSTC_WORKSPACE_WRAPPER");
    if std::env::var("RUSTC_WORKSPACE_WRAPPER").is_ok_and(|wrapper| wrapper.contains("clippy")) {
        return;
    }
    for watched in ["src", "include/solidmap", "bridge/bridge.rs"] {
        println!("cargo::rerun-if-changed={watched}");
    }
    let mut sources: Vec<_> = std::fs::read_dir("src")
        .expect("cpp/src is part of the source tree")
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "cpp"))
        .collect();
    sources.sort();
    cxx_build::bridge("bridge/bridge.rs")
        .files(sources)
        .include("include")
        .include("src")
        .std("c++17")
        .compile("solidmap_cpp");
}
