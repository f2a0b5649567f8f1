//! Text that the reports of this module and of boundary maps share.

use std::fmt::{self, Formatter};

use super::Severity;

/// Ids shown of a list, at most.
const SHOWN: usize = 8;

/// What a finding begins with.
pub(crate) fn label_of(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "note",
    }
}

/// A line with the first of the listed ids, where there are any; `count` is how many there are in all.
pub(crate) fn write_ids(f: &mut Formatter, name: &str, ids: &[impl ToString], count: usize) -> fmt::Result {
    if ids.is_empty() {
        return Ok(());
    }
    let shown: Vec<String> = ids.iter().take(SHOWN).map(ToString::to_string).collect();
    let more = if count > shown.len() { ", ..." } else { "" };
    writeln!(f, "  {name}: {}{more}", shown.join(", "))
}

/// Lines of 100 characters, the first begun by `label` and the others indented as far.
pub(crate) fn write_wrapped(f: &mut Formatter, label: &str, text: &str) -> fmt::Result {
    let mut line = label.to_string();
    for word in text.split_whitespace() {
        if line.len() + word.len() > 100 && line.len() > label.len() {
            writeln!(f, "{}", line.trim_end())?;
            line = " ".repeat(label.len());
        }
        line += word;
        line += " ";
    }
    writeln!(f, "{}", line.trim_end())
}

/// A number with a noun that takes an s in the plural.
pub(crate) fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
