//! Collections of VTK files with times (`.pvd`), which ParaView opens as an animation.

use std::io::{self, Write};
use std::path::Path;

use quick_xml::escape::escape;

use super::{IoError, atomic_write};

/// Writes a collection of ascending times and files, with paths relative to the collection's folder.
///
/// # Errors
///
/// [`IoError::Write`].
pub fn write_pvd(path: impl AsRef<Path>, steps: &[(f64, String)]) -> Result<(), IoError> {
    atomic_write(path, |writer| write(writer, steps))
}

fn write(writer: &mut dyn Write, steps: &[(f64, String)]) -> io::Result<()> {
    writeln!(writer, "<?xml version=\"1.0\"?>")?;
    writeln!(
        writer,
        "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">"
    )?;
    writeln!(writer, "  <Collection>")?;
    for (time, file) in steps {
        // Readers on other systems do not know Windows' separator.
        let file = file.replace('\\', "/");
        let file = escape(&file);
        writeln!(writer, "    <DataSet timestep=\"{time}\" part=\"0\" file=\"{file}\"/>")?;
    }
    writeln!(writer, "  </Collection>")?;
    writeln!(writer, "</VTKFile>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collection_names_its_files_and_times() {
        let mut bytes = Vec::new();
        write(&mut bytes, &[(0.0, "a\\f0.vtu".into()), (0.04, "a/\"<&>.vtu".into())]).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains("timestep=\"0\" part=\"0\" file=\"a/f0.vtu\""));
        assert!(text.contains("timestep=\"0.04\" part=\"0\" file=\"a/&quot;&lt;&amp;&gt;.vtu\""));
        let mut reader = quick_xml::Reader::from_str(&text);
        let mut sets = 0;
        loop {
            match reader.read_event().unwrap() {
                quick_xml::events::Event::Empty(tag) => sets += usize::from(tag.name().as_ref() == "DataSet"),
                quick_xml::events::Event::Eof => break,
                _ => {}
            }
        }
        assert_eq!(sets, 2);
    }
}
