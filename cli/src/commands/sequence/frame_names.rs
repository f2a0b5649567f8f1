//! Whether frames are in the order of the numbers in their names.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// For files in alphabetical order, the first two neighbours that are not in the order of the numbers in their names.
pub fn misordered(files: &[PathBuf]) -> Option<[&Path; 2]> {
    let is_alphabetical = files.is_sorted();
    let pair = files
        .windows(2)
        .find(|pair| by_numbers(&pair[0], &pair[1]) == Ordering::Greater)?;
    is_alphabetical.then_some([pair[0].as_path(), pair[1].as_path()])
}

/// Natural order: digits in the names are compared as numbers, all else by characters.
fn by_numbers(a: &Path, b: &Path) -> Ordering {
    let parts = |path: &Path| {
        let name = path.to_string_lossy().into_owned();
        let mut parts: Vec<(bool, String)> = Vec::new();
        for character in name.chars() {
            let digit = character.is_ascii_digit();
            match parts.last_mut() {
                Some((is_number, part)) if *is_number == digit => part.push(character),
                _ => parts.push((digit, character.into())),
            }
        }
        parts
    };
    let (a, b) = (parts(a), parts(b));
    for ((a_number, a), (b_number, b)) in a.iter().zip(&b) {
        let order = if *a_number && *b_number {
            let [a, b] = [a, b].map(|digits| digits.trim_start_matches('0'));
            a.len().cmp(&b.len()).then_with(|| a.cmp(b))
        } else {
            a.cmp(b)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    a.len().cmp(&b.len())
}
