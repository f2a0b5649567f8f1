//! Files that appear whole or not at all.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

use super::IoError;

/// Writes a file so that `path` holds either all that `write` wrote or what it held before: into a temporary file in
/// the same folder, which is then renamed. The writer is buffered.
///
/// A new file gets the permissions of any file newly made under the umask; one that is replaced passes its own on. A
/// symbolic link is followed; a device or pipe, which has nothing to keep whole, is written directly.
///
/// # Errors
///
/// [`IoError::Write`], also when `write` fails; the temporary file is then removed. A kill may leave it behind, as
/// `.NAME.XXXXXX.tmp`.
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

/// The system's own error: `tempfile` wraps it to add the temporary name, which says nothing to the user.
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
    let mut temporary = temporary_file(&format!(".{}.", name.to_string_lossy()), folder)?;
    if let Some(existing) = existing.filter(|m| m.is_file()) {
        temporary.as_file().set_permissions(existing.permissions())?;
    }
    write_buffered(temporary.as_file_mut(), write)?;
    temporary.persist(&target)?;
    Ok(())
}

fn temporary_file(prefix: &str, folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(".tmp");
    // `tempfile` makes files that only their owner can read; the umask cuts this mode down to the usual one.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
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
    fn failure_leaves_the_old_content_and_no_litter() {
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
    fn permissions_are_those_of_a_plain_file_or_of_the_file_replaced() {
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
    fn links_are_followed_and_what_is_no_file_is_not_replaced() {
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
