//! Text that the reports of this module and of boundary maps share.

use std::fmt::{self, Formatter};

/// Ids shown in a list.
const SHOWN: usize = 8;

/// A line with the first of the listed ids, where there are any; `count` is how many there are in all.
pub(crate) fn write_ids(f: &mut Formatter, name: &str, ids: &[String], count: usize) -> fmt::Result {
    if ids.is_empty() {
        return Ok(());
    }
    let shown = ids.len().min(SHOWN);
    let more = if count > shown { ", ..." } else { "" };
    writeln!(f, "  {name}: {}{more}", ids[..shown].join(", "))
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
