//! The page of a sequence.

use super::Shown;
use crate::args::ViewArgs;
use crate::shared::output::Output;
use crate::shared::sequence_page;

/// The text of the page.
pub fn page(args: &ViewArgs, output: &Output) -> anyhow::Result<(String, Shown)> {
    output.progress("reading the frames");
    let made = sequence_page::make(&args.file, &[], args.up, &args.page.size)?;
    let shown = Shown::Sequence {
        frames: made.frames,
        shown: made.shown,
        faces: made.faces,
    };
    Ok((made.html, shown))
}
