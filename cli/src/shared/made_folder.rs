//! Folders for results: a command that ends early leaves none that are empty.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::interrupt;

/// A folder that is there. When this is dropped, and by an interrupt, it is removed again if it was made for this command
/// and is empty, and so are the folders that it is in.
pub struct MadeFolder {
    /// The folders that were made, inner ones first.
    made: Vec<PathBuf>,
}

impl MadeFolder {
    /// Makes the folder, and those that it is in, where they do not exist.
    pub fn new(folder: &Path) -> anyhow::Result<Self> {
        let missing = folder.ancestors().take_while(|outer| {
            // The last ancestor of a relative path is empty, and stands for the working folder.
            !outer.as_os_str().is_empty() && !outer.exists()
        });
        let made: Vec<PathBuf> = missing.map(Path::to_owned).collect();
        interrupt::remove_empty_folders_too(&made);
        let folders = Self { made };
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder `{}`", folder.display()))?;
        Ok(folders)
    }
}

impl Drop for MadeFolder {
    fn drop(&mut self) {
        remove_empty(&self.made);
    }
}

/// Removes folders as far as they are empty, inner ones first.
pub fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        // Fails for one that is not empty.
        let _ = fs::remove_dir(folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_that_stay_empty_are_removed_and_others_stay() {
        let place = tempfile::tempdir().unwrap();
        let [outer, inner] = ["a", "a/b"].map(|name| place.path().join(name));
        drop(MadeFolder::new(&inner).unwrap());
        assert!(!outer.exists() && place.path().exists());

        let made = MadeFolder::new(&inner).unwrap();
        fs::write(outer.join("result"), b"").unwrap();
        drop(made);
        assert!(outer.exists() && !inner.exists());

        drop(MadeFolder::new(&outer).unwrap());
        assert!(outer.exists());
        fs::remove_file(outer.join("result")).unwrap();
        drop(MadeFolder::new(&outer).unwrap());
        assert!(outer.exists(), "it was there before");
    }
}
