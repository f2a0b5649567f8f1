//! The frames of a sequence mapped by one method, each frame timed.

use std::path::PathBuf;

use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::{ComparedMethod, frame_timings};
use solidmap::io;

use super::job::{Job, SequenceFigures};
use super::worker::{build_options, tell};
use crate::shared::input;
use crate::shared::output::{describe, peak_rss_bytes};

/// Maps the domain to one frame after the other.
pub fn sequence(
    job: &Job,
    boundary: &BoundaryMap,
    method: ComparedMethod,
    frames: &[PathBuf],
) -> anyhow::Result<SequenceFigures> {
    let mut skipped = Vec::new();
    let mut maps = Vec::new();
    for path in frames {
        let read = input::read_image(path, boundary.domain())
            .and_then(|s| Ok(BoundaryMap::between(boundary.domain().clone(), &s)?));
        match read {
            Ok(map) => maps.push(map),
            Err(error) => skipped.push(format!("`{}`: {}", path.display(), describe(&error))),
        }
    }
    anyhow::ensure!(!maps.is_empty(), "none of the {} frames can be used", frames.len());
    let given = job.given.as_ref().map(io::read_tets).transpose()?;
    let timings = frame_timings(
        boundary,
        &maps,
        &build_options(job, boundary, method, given.as_ref()),
        &tell,
    )?;
    Ok(SequenceFigures {
        timings,
        skipped,
        peak_rss_bytes: peak_rss_bytes(),
    })
}
