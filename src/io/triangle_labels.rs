//! Labels of triangles of a polycube: text with one of -x, +x, -y, +y, -z, +z in each line, in the order of the triangles, or beside a
//! surface.

use std::io;
use std::path::Path;

use super::input::{InputFile, excerpt};
use super::{IoError, Place, atomic_write, labelled_surface, read_bytes};
use crate::mesh::DIRECTION_NAMES;

/// Reads the labels of `count` triangles: in each line one of -x, +x, -y, +y, -z, +z, or its number, 0 to 5 in this order.
/// Blanks around it do not matter, nor do empty lines at the end. Of a surface file they are the numbers of the property `label` of faces
/// (.ply), or the materials or groups of these names (.obj), and a polygon's are those of all its triangles.
///
/// # Errors
///
/// [`IoError::Read`], and [`IoError::Malformed`] with the line: for other words, and where there are more or fewer labels.
pub fn read_triangle_labels(path: impl AsRef<Path>, count: usize) -> Result<Vec<u8>, IoError> {
    let path = path.as_ref();
    if labelled_surface::holds_labelled_surface(path) {
        let labels = labelled_surface::labels_of(path)?;
        return match labels.len() == count {
            true => Ok(labels),
            false => Err(IoError::value_count(path, "label", count, labels.len())),
        };
    }
    let bytes = read_bytes(path)?;
    let file = InputFile {
        path,
        format: "text of labels",
        bytes: &bytes,
    };
    let mut labels = Vec::new();
    let lines: Vec<&[u8]> = bytes.trim_ascii_end().split(|&b| b == b'\n').collect();
    let lines = if bytes.trim_ascii().is_empty() { vec![] } else { lines };
    for (number, line) in (1..).zip(&lines) {
        let malformed = |found: String| file.malformed_at(Place::Line(number), found);
        if number > count {
            return Err(malformed(format!(
                "one label more than the {count} triangles; there has to be one for each, in their order"
            )));
        }
        let word = line.trim_ascii();
        let label = label(word).ok_or_else(|| {
            let wanted = "one of -x, +x, -y, +y, -z, +z, or its number from 0 to 5";
            malformed(format!("found `{}` instead of {wanted}", excerpt(word)))
        })?;
        labels.push(label);
    }
    if labels.len() < count {
        let found = format!(
            "the labels end here, after {} of {count}; there has to be one for each triangle, in their order",
            labels.len()
        );
        return Err(file.malformed_at(Place::Line(lines.len().max(1)), found));
    }
    Ok(labels)
}

/// The label of this name or number.
pub(super) fn label(word: &[u8]) -> Option<u8> {
    match word {
        [digit @ b'0'..=b'5'] => Some(digit - b'0'),
        _ => (0..)
            .zip(DIRECTION_NAMES)
            .find(|(_, name)| name.as_bytes() == word)
            .map(|(label, _)| label),
    }
}

/// Writes labels, 0 to 5 for -x, +x, -y, +y, -z, +z, as [`read_triangle_labels`] reads them.
///
/// # Errors
///
/// [`IoError::Write`], also for other labels.
pub fn write_triangle_labels(path: impl AsRef<Path>, labels: &[u8]) -> Result<(), IoError> {
    atomic_write(path, |writer| {
        for &label in labels {
            let name = DIRECTION_NAMES.get(usize::from(label));
            let name = name.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a label is above 5"))?;
            writeln!(writer, "{name}")?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, count: usize) -> Result<Vec<u8>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("labels.txt");
        std::fs::write(&path, text).unwrap();
        read_triangle_labels(&path, count).map_err(|error| error.to_string())
    }

    #[test]
    fn labels_are_words_or_numbers_and_read_back() {
        let all = [0, 1, 2, 3, 4, 5];
        assert_eq!(read("-x\n+x\n-y\n+y\n-z\n+z\n", 6).unwrap(), all);
        assert_eq!(read("0\r\n 1\n2 \n3\n4\n5\n\n\n", 6).unwrap(), all);
        assert!(read("", 0).unwrap().is_empty());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("labels.txt");
        write_triangle_labels(&path, &all).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "-x\n+x\n-y\n+y\n-z\n+z\n");
        assert_eq!(read_triangle_labels(&path, 6).unwrap(), all);
        assert!(write_triangle_labels(&path, &[6]).is_err());
        assert_eq!(
            read_triangle_labels(&path, 6).unwrap(),
            all,
            "a failure leaves the file as it was"
        );
    }

    #[test]
    fn other_lines_and_other_counts_are_refused_with_the_line() {
        for wrong in ["x", "6", "+X", "-x +x", "", "# +x", "+x,", "01"] {
            let error = read(&format!("+x\n{wrong}\n+x\n"), 3).unwrap_err();
            assert!(error.contains("line 2") && error.contains("labels.txt"), "{error}");
        }
        let error = read("+x\n+x\n+x\n", 2).unwrap_err();
        assert!(error.contains("line 3") && error.contains("2 triangles"), "{error}");
        let error = read("+x\n+x\n", 3).unwrap_err();
        assert!(error.contains("line 2") && error.contains("2 of 3"), "{error}");
        let error = read("\n", 1).unwrap_err();
        assert!(error.contains("line 1") && error.contains("0 of 1"), "{error}");
    }
}
