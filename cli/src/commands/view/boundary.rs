//! The page of a boundary map.

use solidmap::files::BoundaryFile;

use super::Shown;
use crate::args::ViewArgs;
use crate::shared::boundary_page;
use crate::shared::output::Output;

/// The text of the page.
pub fn page(args: &ViewArgs, file: &BoundaryFile, output: &Output) -> anyhow::Result<(String, Shown)> {
    output.progress("checking");
    let made = boundary_page::of_file(&args.file, file, args.up, &args.page.size)?;
    let shown = Shown::Boundary {
        faces: made.faces,
        flipped: made.flipped,
    };
    Ok((made.html, shown))
}
