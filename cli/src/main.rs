//! The `solidmap` program.

fn main() -> std::process::ExitCode {
    solidmap_cli::run()
}
