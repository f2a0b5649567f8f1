//! Writing files completely or not at all.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use super::IoError;

/// Writes a file so that `path` holds either all that `write` wrote or what it held before, also after a crash of the
/// system: into a temporary file in the same folder, which is renamed when it is on the disk. The writer is buffered.
///
/// A new file gets the default permissions under the umask; a replaced file's permissions are kept. A symbolic link is
/// followed; a device or pipe is written directly.
///
/// # Errors
///
/// [`IoError::Write`], also when `write` fails; the temporary file is then removed. A killed process may leave it
/// behind, as `.NAME.XXXXXX.tmp`; a program that handles interrupts itself should call [`abandon_writes`].
pub fn atomic_write(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), IoError> {
    let path = path.as_ref();
    replace(path, write).map_err(|source| IoError::Write {
        path: path.to_owned(),
        source: without_path(source),
    })
}

/// Removes the temporary files of all [`atomic_write`]s in progress and blocks them and later ones for ever. For a
/// program that is about to exit, as after an interrupt.
pub fn abandon_writes() {
    abandon(unfinished());
}

/// As [`abandon_writes`], unless a file is being made or renamed right now. For a program that has no memory left: it
/// neither waits nor, with names of usual lengths, allocates.
pub fn try_abandon_writes() {
    if let Ok(unfinished) = UNFINISHED.try_lock() {
        abandon(unfinished);
    }
}

fn abandon(unfinished: MutexGuard<'static, Vec<PathBuf>>) {
    for path in unfinished.iter() {
        // It may have been removed already.
        let _ = fs::remove_file(path);
    }
    // Locked for ever, so that no unfinished file is renamed and no new one is made.
    std::mem::forget(unfinished);
}

/// Temporary files in progress. Files are made, renamed and removed under this lock.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The system's own error: `tempfile` adds the temporary name, which means nothing to the user.
fn without_path(error: io::Error) -> io::Error {
    let system = error
        .get_ref()
        .and_then(|wrapped| wrapped.source())
        .and_then(|e| e.downcast_ref::<io::Error>());
    match system.and_then(io::Error::raw_os_error) {
        Some(code) => io::Error::from_raw_os_error(code),
        None => error,
    }
}

/// Characters of the name that the temporary name repeats: names have at most 255 bytes, and a character up to four.
const NAME_CHARACTERS: usize = 50;

fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    // Renaming onto a symbolic link would replace the link, and onto `/dev/stdout` the device.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&target).ok();
    if existing.as_ref().is_some_and(|m| !m.is_file() && !m.is_dir()) {
        return write_buffered(&mut File::options().write(true).open(&target)?, write);
    }

    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let name = target
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"))?;
    let name: String = name.to_string_lossy().chars().take(NAME_CHARACTERS).collect();
    let mut temporary = Temporary::new(&format!(".{name}."), folder)?;
    if let Some(existing) = existing.filter(|m| m.is_file()) {
        temporary.file().set_permissions(existing.permissions())?;
    }
    write_buffered(temporary.file(), write)?;
    // Some file systems put the new name on the disk before the content.
    temporary.file().sync_all()?;
    temporary.persist(&target)?;
    sync_folder(folder);
    Ok(())
}

/// Has the system write the names in a folder to the disk, after files were renamed in it. Where it cannot, as on some
/// network file systems, nothing is lost but after a crash.
pub fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// A temporary file registered in [`UNFINISHED`]. Removed on drop.
struct Temporary(Option<tempfile::NamedTempFile>);

impl Temporary {
    fn new(prefix: &str, folder: &Path) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(prefix).suffix(".tmp");
        // `tempfile` makes files that only their owner can read; the umask cuts this mode down to the usual one.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut unfinished = unfinished();
        let file = builder.tempfile_in(folder)?;
        unfinished.push(file.path().to_owned());
        Ok(Self(Some(file)))
    }

    fn file(&mut self) -> &mut File {
        self.0
            .as_mut()
            .expect("the file is there until it is persisted")
            .as_file_mut()
    }

    fn persist(mut self, target: &Path) -> io::Result<()> {
        self.end(|file| file.persist(target).map(drop).map_err(io::Error::from))
    }

    fn end(&mut self, end: impl FnOnce(tempfile::NamedTempFile) -> io::Result<()>) -> io::Result<()> {
        let mut unfinished = unfinished();
        let Some(file) = self.0.take() else { return Ok(()) };
        unfinished.retain(|path| path != file.path());
        end(file)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // There is nobody to report a failure to.
        let _ = self.end(tempfile::NamedTempFile::close);
    }
}

fn write_buffered(file: &mut File, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    write(&mut writer)?;
    writer.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failure_leaves_the_old_content_and_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        atomic_write(&path, |w| w.write_all(b"old")).unwrap();
        let error = atomic_write(&path, |w| {
            w.write_all(b"new")?;
            Err(io::Error::other("disk on fire"))
        })
        .unwrap_err();
        assert!(error.to_string().contains("disk on fire") && error.to_string().contains("a.txt"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn missing_folder_is_an_error_that_names_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let error = atomic_write(folder.path().join("none/a.txt"), |_| Ok(())).unwrap_err();
        assert!(matches!(error, IoError::Write { path, .. } if path.ends_with("none/a.txt")));
        assert!(atomic_write(folder.path(), |_| Ok(())).is_err());
        assert!(atomic_write("", |_| Ok(())).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_a_plain_or_of_the_replaced_file() {
        use std::os::unix::fs::PermissionsExt;

        let folder = tempfile::tempdir().unwrap();
        let [plain, atomic] = ["plain", "atomic"].map(|name| folder.path().join(name));
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        fs::write(&plain, b"").unwrap();
        atomic_write(&atomic, |_| Ok(())).unwrap();
        assert_eq!(mode(&atomic), mode(&plain));

        fs::set_permissions(&atomic, fs::Permissions::from_mode(0o640)).unwrap();
        atomic_write(&atomic, |_| Ok(())).unwrap();
        assert_eq!(mode(&atomic) & 0o777, 0o640);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_only_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [real, link, socket] = ["real", "link", "socket"].map(|name| folder.path().join(name));
        fs::write(&real, b"old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        atomic_write(&link, |w| w.write_all(b"new")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&real).unwrap(), b"new");

        // A socket stands for devices here: it cannot be opened, and must survive the attempt.
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        assert!(atomic_write(&socket, |w| w.write_all(b"gone")).is_err());
        assert!(!fs::metadata(&socket).unwrap().is_file());
    }
}
