//! Which files a result was made from.

use std::path::Path;

use sha2::{Digest, Sha256};

/// An input file by name and content.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Provenance {
    /// `"domain"`, `"image"` and so on.
    pub role: String,
    /// File name without its folder.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

impl Provenance {
    /// Name and hash of a file.
    ///
    /// # Errors
    ///
    /// When the file cannot be read.
    pub fn of(role: &str, path: &Path) -> std::io::Result<Self> {
        let digest = Sha256::digest(std::fs::read(path)?);
        let sha256 = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self {
            role: role.into(),
            file,
            sha256,
        })
    }
}
