//! The `solidmap` program.

#[global_allocator]
static ALLOCATOR: solidmap_cli::NotingAllocator = solidmap_cli::NotingAllocator;

fn main() -> std::process::ExitCode {
    solidmap_cli::run()
}
