//! Pages to look into maps, meshes, sequences, studies and comparisons: one file with all data and scripts in it, which a
//! browser opens from the disk.
//!
//! three.js draws. It, the page's own modules and all arrays are deflated and written as base64 into elements of the page;
//! [`library::START`] unpacks them with the browser's own `DecompressionStream`, and gives the modules addresses of their
//! own (`blob:`) by an import map. What the page is about is a JSON object beside them. The page's content security policy
//! forbids the browser to load anything.

mod arrays;
mod field;
mod framing;
mod library;
mod palettes;
mod table;

use std::fmt::Write;
use std::path::Path;

use serde::Serialize;
use solidmap::files::Provenance;

pub use arrays::PackedArray;
pub use field::{PageField, Palette};
pub use framing::Framing;
pub use table::NumberTable;

use super::output::write_file;
use palettes::Palettes;

/// Extensions of pages.
pub const EXTENSIONS: [&str; 2] = ["html", "htm"];

/// A page without the arrays: what scripts read as JSON.
#[derive(Serialize)]
struct PageData<'p, T> {
    title: &'p str,
    program: String,
    command: String,
    files: &'p [Provenance],
    notes: &'p [String],
    tables: &'p [NumberTable],
    arrays: &'p [PackedArray],
    palettes: Palettes,
    #[serde(flatten)]
    content: &'p T,
}

/// What a page shows.
pub struct Page {
    /// Its title.
    pub title: String,
    /// The files that it is made from.
    pub files: Vec<Provenance>,
    /// What readers must know to read it rightly.
    pub notes: Vec<String>,
    /// Numbers of reports.
    pub tables: Vec<NumberTable>,
    /// The arrays that scripts read.
    pub arrays: Vec<PackedArray>,
}

impl Page {
    /// The text of the page. `content` is what its scripts need besides arrays: an object with a field `kind`.
    pub fn html(&self, content: &impl Serialize) -> serde_json::Result<String> {
        let data = PageData {
            title: &self.title,
            program: concat!("solidmap ", env!("CARGO_PKG_VERSION")).into(),
            command: command(std::env::args_os().map(|word| word.to_string_lossy().into_owned())),
            files: &self.files,
            notes: &self.notes,
            tables: &self.tables,
            arrays: &self.arrays,
            palettes: Palettes::new(),
            content,
        };
        let data = in_script(&serde_json::to_string(&data)?);
        let [from, to] = library::CORE_IMPORT;
        let mut packed = String::new();
        for module in &library::MODULES {
            let text = arrays::deflated(module.text.replace(from, to).as_bytes());
            let name = module.name;
            let _ = writeln!(
                packed,
                "<script type=\"text/x-packed\" data-module=\"{name}\">{text}</script>"
            );
        }
        for array in &self.arrays {
            let (name, text) = (array.name(), array.text());
            let _ = writeln!(
                packed,
                "<script type=\"text/x-packed\" data-array=\"{name}\">{text}</script>"
            );
        }
        let parts = [
            ("TITLE", escaped(&self.title)),
            ("STYLE", library::STYLE.to_owned()),
            ("VERSION", library::THREE_VERSION.to_owned()),
            ("LICENCE", escaped(library::THREE_LICENCE)),
            ("DATA", data),
            ("PACKED", packed),
            ("START", library::START.to_owned()),
        ];
        Ok(filled(library::TEMPLATE, &parts))
    }
}

/// A number of bytes in megabytes.
pub fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

/// Writes a page, whole or not at all.
pub fn write(path: &Path, html: &str) -> anyhow::Result<()> {
    write_file(path, html.as_bytes())
}

/// The template with each `{{NAME}}` replaced once; what is filled in is not looked at again, whatever it contains.
fn filled(template: &str, parts: &[(&str, String)]) -> String {
    let mut text = String::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        text.push_str(before);
        let (name, after) = after.split_once("}}").expect("a name in the template ends");
        let part = parts.iter().find(|(part, _)| *part == name);
        text.push_str(&part.expect("a part for each name of the template").1);
        rest = after;
    }
    text + rest
}

/// JSON as it may stand in a script element: no `<`, which could end the element or begin a comment.
fn in_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// Text as it may stand in an element or an attribute.
fn escaped(text: &str) -> String {
    text.chars().fold(String::new(), |mut all, character| {
        match character {
            '&' => all.push_str("&amp;"),
            '<' => all.push_str("&lt;"),
            '>' => all.push_str("&gt;"),
            '"' => all.push_str("&quot;"),
            '\'' => all.push_str("&#39;"),
            other => all.push(other),
        }
        all
    })
}

/// The command line that makes a page again, with words quoted as shells want them.
fn command(arguments: impl Iterator<Item = String>) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    let mut words = vec!["solidmap".to_owned()];
    words.extend(arguments.skip(1).map(|word| {
        if !word.is_empty() && word.chars().all(is_plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', "'\\''"))
        }
    }));
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_their_place() {
        let hostile = "</script><script>alert(\"'&{{DATA}}";
        let page = Page {
            title: hostile.into(),
            files: vec![],
            notes: vec![hostile.into()],
            tables: vec![],
            arrays: vec![PackedArray::indices("a", [1, 2])],
        };
        let html = page.html(&serde_json::json!({"kind": "none"})).unwrap();
        assert!(!html.contains("<script>alert"), "{hostile}");
        let title = "<title>&lt;/script&gt;&lt;script&gt;alert(&quot;&#39;&amp;{{DATA}}</title>";
        assert!(html.contains(title));
        assert!(html.contains(r#"\u003c/script>\u003cscript>alert(\"'&{{DATA}}"#));
        // Each element ends once: modules, arrays, the data, the script that starts.
        let elements = library::MODULES.len() + 3;
        assert_eq!(html.matches("</script>").count(), elements);
    }

    #[test]
    fn a_command_is_written_as_a_shell_reads_it() {
        let words = ["/usr/bin/solidmap", "view", "a b.map", "it's", "-o", "x.html"].map(String::from);
        assert_eq!(
            command(words.into_iter()),
            r"solidmap view 'a b.map' 'it'\''s' -o x.html"
        );
    }
}
