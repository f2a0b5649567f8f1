//! The folder of results. New ones are written to a hidden folder, so that those of an earlier run stay until all are
//! complete.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use solidmap::io::sync_folder;

use crate::shared::interrupt;
use crate::shared::made_folder::MadeFolder;

/// Folders of the series, and names of their collections.
pub const CELLS: &str = "cells";
pub const SURFACE: &str = "surface";
pub const MATERIAL: &str = "material";
pub const SERIES: [&str; 3] = [CELLS, SURFACE, MATERIAL];
/// What is written beside the series and their collections.
const FILES: [&str; 3] = ["energy.csv", "energy.png", "sections.png"];

/// The name of a frame's file in the folder of a series.
pub fn frame_name(frame: usize) -> String {
    format!("frame_{frame:05}.vtu")
}

/// The name of a series' collection.
pub fn collection_name(series: &str) -> String {
    format!("{series}.pvd")
}

/// Where results go, and a hidden folder in it where they are gathered.
pub struct ResultFolder {
    folder: PathBuf,
    /// Removed when it is dropped, and by an interrupt.
    scratch: tempfile::TempDir,
    /// Dropped after the folder that it holds.
    _made: MadeFolder,
    /// Files of the series that an earlier run has left.
    earlier: Vec<PathBuf>,
}

impl ResultFolder {
    /// Makes the folder. Refuses inputs that would be overwritten, and frames of the `written_series` that would
    /// replace files not made by an earlier run.
    pub fn new<'p>(
        folder: &Path,
        inputs: impl Iterator<Item = &'p PathBuf>,
        written_series: &[&str],
        frames: usize,
    ) -> anyhow::Result<Self> {
        let shown = folder.display();
        let made = MadeFolder::new(folder)?;
        let earlier: Vec<PathBuf> = SERIES.into_iter().flat_map(|series| earlier(folder, series)).collect();
        let written = written(folder, written_series, frames);
        let canonical = |path: &Path| fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let taken: Vec<PathBuf> = earlier.iter().chain(&written).map(|path| canonical(path)).collect();
        for input in inputs {
            ensure!(
                !taken.contains(&canonical(input)),
                "`{}` would be overwritten: give another folder with --output",
                input.display()
            );
        }
        for path in &written {
            let is_foreign_frame = path.extension().is_some_and(|kind| kind == "vtu") && !earlier.contains(path);
            ensure!(
                !(path.is_dir() || is_foreign_frame && path.exists()),
                "`{}` is there already, and not by an earlier run: move it, or give another folder with --output",
                path.display()
            );
        }
        // Before the work, not after it.
        for inner in written_series.iter().map(|series| folder.join(series)) {
            if inner.exists() {
                tempfile::tempfile_in(&inner)
                    .with_context(|| format!("cannot write to the folder `{}`", inner.display()))?;
            }
        }
        let scratch = tempfile::Builder::new().prefix(".sequence-").tempdir_in(folder);
        let scratch = scratch.with_context(|| format!("cannot write to the folder `{shown}`"))?;
        interrupt::remove_folder_too(scratch.path());
        Ok(Self {
            folder: folder.to_owned(),
            scratch,
            _made: made,
            earlier,
        })
    }

    /// Where to write.
    pub fn scratch(&self) -> &Path {
        self.scratch.path()
    }

    /// Moves what was written into place, replacing the results of an earlier run, and removes the rest of those.
    pub fn publish(self) -> anyhow::Result<()> {
        interrupt::hold_off(|| {
            let mut moved = Vec::new();
            for series in SERIES {
                // There is no folder of a series that was not written.
                for entry in fs::read_dir(self.scratch().join(series)).into_iter().flatten() {
                    let name = Path::new(series).join(entry?.file_name());
                    moved.push(self.move_into_place(&name)?);
                }
            }
            let collections = SERIES.map(collection_name);
            for name in FILES.into_iter().chain(collections.iter().map(String::as_str)) {
                if self.scratch().join(name).exists() {
                    moved.push(self.move_into_place(Path::new(name))?);
                }
            }
            for folder in SERIES
                .map(|series| self.folder.join(series))
                .iter()
                .chain([&self.folder])
            {
                sync_folder(folder);
            }
            for left in self.earlier.iter().filter(|path| !moved.contains(path)) {
                // The user may have removed it meanwhile.
                if left.exists() {
                    fs::remove_file(left).with_context(|| format!("cannot remove `{}`", left.display()))?;
                }
            }
            Ok(())
        })
    }

    /// Moves a file into place, and returns its path there.
    fn move_into_place(&self, name: &Path) -> anyhow::Result<PathBuf> {
        let place = self.folder.join(name);
        let context = || format!("cannot write `{}`", place.display());
        if let Some(folder) = place.parent() {
            fs::create_dir_all(folder).with_context(context)?;
        }
        fs::rename(self.scratch().join(name), &place).with_context(context)?;
        Ok(place)
    }
}

/// All files that a run of so many frames may write.
fn written(folder: &Path, written_series: &[&str], frames: usize) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = FILES.iter().map(|name| folder.join(name)).collect();
    for series in written_series {
        files.push(folder.join(collection_name(series)));
        files.extend((0..frames).map(|frame| folder.join(series).join(frame_name(frame))));
    }
    files
}

/// The frames that an earlier run's collection lists, and the collection; empty where there is none.
fn earlier(folder: &Path, series: &str) -> Vec<PathBuf> {
    let collection = folder.join(collection_name(series));
    let text = fs::read_to_string(&collection).unwrap_or_default();
    let names = text.split("file=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let ours = names.filter_map(|name| {
        let name = name.strip_prefix(series)?.strip_prefix('/')?;
        let number = name.strip_prefix("frame_")?.strip_suffix(".vtu")?.parse().ok()?;
        (name == frame_name(number)).then(|| folder.join(series).join(name))
    });
    let mut files: Vec<PathBuf> = ours.collect();
    if !files.is_empty() {
        files.push(collection);
    }
    files
}
