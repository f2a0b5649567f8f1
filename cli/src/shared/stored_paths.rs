//! Serialisation of paths for processes of this program: nothing is lost of names that are not UTF-8. For fields
//! `#[serde(with = "stored_paths")]` of one path, of an optional one, or of several.

use std::ffi::OsString;
use std::path::PathBuf;

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub fn serialize<P: Paths, S: Serializer>(paths: &P, serializer: S) -> Result<S::Ok, S::Error> {
    let names: Vec<OsString> = paths.list().iter().map(|path| path.into()).collect();
    names.serialize(serializer)
}

pub fn deserialize<'de, P: Paths, D: Deserializer<'de>>(deserializer: D) -> Result<P, D::Error> {
    let names = Vec::<OsString>::deserialize(deserializer)?;
    let paths = names.into_iter().map(PathBuf::from).collect();
    P::from_list(paths).ok_or_else(|| D::Error::custom("another number of paths was expected"))
}

/// Paths as a list.
pub trait Paths: Sized {
    fn list(&self) -> Vec<&PathBuf>;
    /// `None` when the list has the wrong length.
    fn from_list(paths: Vec<PathBuf>) -> Option<Self>;
}

impl Paths for PathBuf {
    fn list(&self) -> Vec<&PathBuf> {
        vec![self]
    }

    fn from_list(paths: Vec<PathBuf>) -> Option<Self> {
        <[PathBuf; 1]>::try_from(paths).ok().map(|[path]| path)
    }
}

impl Paths for Vec<PathBuf> {
    fn list(&self) -> Vec<&PathBuf> {
        self.iter().collect()
    }

    fn from_list(paths: Vec<PathBuf>) -> Option<Self> {
        Some(paths)
    }
}

impl<const N: usize> Paths for [PathBuf; N] {
    fn list(&self) -> Vec<&PathBuf> {
        self.iter().collect()
    }

    fn from_list(paths: Vec<PathBuf>) -> Option<Self> {
        paths.try_into().ok()
    }
}

impl<P: Paths> Paths for Option<P> {
    fn list(&self) -> Vec<&PathBuf> {
        self.as_ref().map(P::list).unwrap_or_default()
    }

    fn from_list(paths: Vec<PathBuf>) -> Option<Self> {
        if paths.is_empty() {
            Some(None)
        } else {
            P::from_list(paths).map(Some)
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::ffi::OsStringExt;

    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Stored {
        #[serde(with = "super")]
        one: PathBuf,
        #[serde(with = "super")]
        none: Option<PathBuf>,
        #[serde(with = "super")]
        two: Option<[PathBuf; 2]>,
        #[serde(with = "super")]
        several: Vec<PathBuf>,
    }

    #[test]
    fn names_that_are_not_utf8_survive() {
        let name = |byte: u8| PathBuf::from(OsString::from_vec(vec![b'a', byte]));
        let stored = Stored {
            one: name(0xff),
            none: None,
            two: Some([name(b'b'), name(0xfe)]),
            several: vec![name(0x80); 3],
        };
        let text = serde_json::to_string(&stored).unwrap();
        assert_eq!(serde_json::from_str::<Stored>(&text).unwrap(), stored);
        assert!(serde_json::from_str::<Stored>(&text.replacen("[{", "[{\"Unix\":[1]},{", 1)).is_err());
    }
}
