//! Collections of VTK files with times (`.pvd`), which ParaView opens as an animation.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use quick_xml::Reader;
use quick_xml::escape::{escape, unescape};
use quick_xml::events::{BytesStart, Event};

use super::input::{InputFile, excerpt, printable};
use super::{IoError, Place, atomic_write, read_bytes};

/// Reads a collection: times and files in the order of the file, a relative path taken from the collection's folder.
/// Whether the files exist is not looked at.
///
/// # Errors
///
/// [`IoError::Read`], [`IoError::Malformed`], [`IoError::Truncated`].
pub fn read_pvd(path: impl AsRef<Path>) -> Result<Vec<(f64, PathBuf)>, IoError> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    parse(&InputFile {
        path,
        format: "PVD",
        bytes: &bytes,
    })
}

fn parse(file: &InputFile) -> Result<Vec<(f64, PathBuf)>, IoError> {
    let text = std::str::from_utf8(file.bytes)
        .map_err(|error| file.malformed_at(Place::Byte(error.valid_up_to()), "the XML is not UTF-8 text"))?;
    let mut reader = Reader::from_str(text.trim_start_matches('\u{feff}'));
    let folder = file.path.parent().unwrap_or(Path::new(""));
    let mut steps = Vec::new();
    let (mut begun, mut ended) = (false, false);
    loop {
        let at = reader.buffer_position() as usize;
        let event = reader
            .read_event()
            .map_err(|error| file.malformed(at, printable(&error)))?;
        match event {
            Event::Start(tag) | Event::Empty(tag) => match tag.name().as_ref() {
                "VTKFile" => {
                    let kind = attribute(file, &tag, at, "type")?.unwrap_or_default();
                    if kind != "Collection" {
                        let found = format!("a VTK file of type `{}`, not a collection", excerpt(kind.as_bytes()));
                        return Err(file.malformed(at, found));
                    }
                    begun = true;
                }
                "DataSet" if begun => {
                    let name = attribute(file, &tag, at, "file")?;
                    let name = name.ok_or_else(|| file.malformed(at, "a data set without `file`"))?;
                    // ParaView takes the number of the step where there is no time.
                    let time = match attribute(file, &tag, at, "timestep")? {
                        None => steps.len() as f64,
                        Some(time) => time.trim().parse().map_err(|_| {
                            let time = excerpt(time.as_bytes());
                            file.malformed(at, format!("the time `{time}` is no number"))
                        })?,
                    };
                    steps.push((time, folder.join(name)));
                }
                _ => {}
            },
            Event::End(tag) => ended |= tag.name().as_ref() == "VTKFile",
            Event::Eof if !begun => return Err(file.malformed(0, "there is no element `VTKFile`")),
            Event::Eof if !ended => return Err(file.truncated("the XML structure")),
            Event::Eof => return Ok(steps),
            _ => {}
        }
    }
}

/// The text of an attribute, with entities resolved.
fn attribute(file: &InputFile, tag: &BytesStart, at: usize, name: &str) -> Result<Option<String>, IoError> {
    // Checking for duplicate attributes takes quadratic time.
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|error| file.malformed(at, printable(&error)))?;
        if attribute.key.as_ref() == name {
            let value = unescape(&attribute.value).map_err(|error| file.malformed(at, printable(&error)))?;
            return Ok(Some(value.into_owned()));
        }
    }
    Ok(None)
}

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

    fn read(text: &str) -> Result<Vec<(f64, PathBuf)>, IoError> {
        parse(&InputFile {
            path: Path::new("folder/a.pvd"),
            format: "PVD",
            bytes: text.as_bytes(),
        })
    }

    #[test]
    fn a_collection_is_read_as_it_was_written() {
        let mut bytes = Vec::new();
        let steps = [(0.0, "a/f0.vtu".to_owned()), (0.04, "a/\"<&>.vtu".into())];
        write(&mut bytes, &steps).unwrap();
        let found = read(std::str::from_utf8(&bytes).unwrap()).unwrap();
        assert_eq!(found, steps.map(|(time, name)| (time, Path::new("folder").join(name))));
    }

    #[test]
    fn faults_are_named() {
        let with = |inner: &str| {
            read(&format!(
                "<VTKFile type=\"Collection\">\n<Collection>{inner}</Collection>\n</VTKFile>"
            ))
        };
        assert_eq!(with("").unwrap(), []);
        assert_eq!(with("<DataSet file=\"b\"/>").unwrap()[0].0, 0.0);
        let malformed = |result: Result<_, IoError>| matches!(result, Err(IoError::Malformed { .. }));
        assert!(malformed(with("<DataSet timestep=\"1\"/>")));
        assert!(malformed(with("<DataSet timestep=\"one\" file=\"b\"/>")));
        assert!(malformed(with("<DataSet file=\"&none;\"/>")));
        assert!(malformed(read("")) && malformed(read("<VTKFile type=\"UnstructuredGrid\"/>")));
        let cut = "<VTKFile type=\"Collection\">\n<Collection><DataSet file=\"b\"/>";
        assert!(matches!(
            read(cut),
            Err(IoError::Truncated { .. } | IoError::Malformed { .. })
        ));
    }

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
