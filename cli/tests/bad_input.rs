//! Files and surfaces that are wrong in every way thought of, and in those that the fuzzer found. They give a result or
//! an error that names the file, within seconds, and never a panic; no memory is taken for what a file merely declares.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::small_files::{Format, SmallFile, small_files};
use rand::{Rng, SeedableRng, rngs::StdRng};
use solidmap::files;
use solidmap::io;

const SEED: u64 = 7;
/// How long a read or a check may take on an idle machine.
const LONGEST: Duration = Duration::from_secs(10);
/// How much memory reading a file may hold at a time, in bytes, plus so much for each byte of the file.
const MOST_MEMORY: usize = 192 << 20;
const MOST_EXPANSION: usize = 400;

/// An allocator that counts the bytes that each thread holds.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let _ = HELD.try_with(|held| {
        held.set(held.get() + bytes);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
    });
}

// SAFETY: everything is left to the system's allocator; the counters allocate nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// [`LONGEST`], and longer on a machine under load.
fn longest() -> Duration {
    let load = std::fs::read_to_string("/proc/loadavg").ok();
    let load: Option<f64> = load.and_then(|text| text.split(' ').next()?.parse().ok());
    let cores = std::thread::available_parallelism().map_or(1.0, |n| n.get() as f64);
    LONGEST.mul_f64((load.unwrap_or(0.0) / cores).max(1.0))
}

/// Reads a file by every reader of its format; the messages of those that fail.
fn messages(format: Format, path: &Path) -> Vec<String> {
    fn said<T, E: Error>(result: Result<T, E>) -> Option<String> {
        result.err().map(|error| error.to_string())
    }
    let all = match format {
        Format::Csv | Format::Npy => vec![said(io::read_points(path)), said(io::read_fields(path))],
        Format::Landmarks => vec![
            said(files::read_landmarks(path, 20, 1000)),
            said(files::read_landmark_files(path, path, 1000, 20)),
        ],
        Format::Map => vec![said(files::read_map(path))],
        Format::Boundary => vec![said(files::read_boundary(path))],
        Format::Texture => vec![said(files::read_texture(path))],
        Format::Picture => vec![said(solidmap_cli::read_picture(path))],
        Format::Obj => vec![said(io::read_solid(path)), said(io::read_textured_surface(path))],
        Format::Vti => vec![said(io::read_points(path)), said(io::read_fields(path))],
        _ => vec![
            said(io::read_solid(path)),
            said(io::read_cells(path)),
            said(io::read_fields(path)),
        ],
    };
    all.into_iter().flatten().collect()
}

/// A folder in which one file after the other is tried.
struct Trial {
    folder: tempfile::TempDir,
}

impl Trial {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { folder }
    }

    /// Writes and reads these bytes; the messages, each of which names the file.
    fn read(&self, format: Format, bytes: &[u8]) -> Vec<String> {
        let path = self.folder.path().join(format!("spoiled.{}", format.extension()));
        std::fs::write(&path, bytes).unwrap();
        let shown = || bytes[..bytes.len().min(6000)].escape_ascii().to_string();
        let before = HELD.get();
        PEAK.set(before);
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| messages(format, &path)));
        let Ok(messages) = result else {
            panic!("{format:?} panics: {}", shown())
        };
        let taken = PEAK.get() - before;
        assert!(
            taken < (MOST_MEMORY + MOST_EXPANSION * bytes.len()) as isize,
            "{format:?} takes {taken} bytes: {}",
            shown()
        );
        let seconds = start.elapsed();
        assert!(seconds < longest(), "{format:?} takes {seconds:?}: {}", shown());
        for message in &messages {
            assert!(message.contains("spoiled."), "no file is named: {message}");
            // Control characters are escaped: a terminal would obey them.
            let is_plain = message.len() < 1500 && !message.chars().any(char::is_control);
            assert!(is_plain, "{message:?}");
        }
        messages
    }

    fn read_like(&self, file: &SmallFile, bytes: &[u8]) -> Vec<String> {
        self.read(file.format, bytes)
    }
}

/// At most so many numbers below `end`, evenly spaced.
fn some_of(end: usize, most: usize) -> impl Iterator<Item = usize> {
    (0..end).step_by(end.div_ceil(most).max(1))
}

#[test]
fn small_files_are_read() {
    let trial = Trial::new();
    for file in small_files() {
        let messages = trial.read_like(&file, &file.bytes);
        let count = match file.format {
            // Readers that fail on a valid file: landmarks are pairs or single numbers, not both; image data are no
            // list of points; a mesh may be no solid, no cells or no fields.
            Format::Landmarks | Format::Vti => 1,
            format if format.is_mesh() && format != Format::Obj => 2,
            _ => 0,
        };
        assert!(messages.len() <= count, "{} {:?}: {messages:?}", file.name, file.format);
    }
}

#[test]
fn cut_files_are_read_or_refused() {
    let trial = Trial::new();
    for file in small_files() {
        for length in some_of(file.bytes.len(), 250) {
            trial.read_like(&file, &file.bytes[..length]);
        }
    }
}

#[test]
fn flipped_bits_are_read_or_refused() {
    let trial = Trial::new();
    let mut random = StdRng::seed_from_u64(SEED);
    for file in small_files() {
        for _ in 0..400 {
            let mut bytes = file.bytes.clone();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..bytes.len());
                bytes[at] ^= 1 << random.random_range(0..8);
            }
            trial.read_like(&file, &bytes);
        }
    }
}

#[test]
fn absurd_binary_numbers_are_read_or_refused() {
    let trial = Trial::new();
    let patterns: [&[u8]; 8] = [
        &[0xff; 4],
        &[0xff; 8],
        &[0xff, 0xff, 0xff, 0x7f],
        &[0x7f, 0xff, 0xff, 0xff],
        &[0; 8],
        &[0, 0, 0, 0, 0, 0, 0, 0x80],
        &[0, 0, 0, 0, 0, 0, 0xf8, 0x7f],
        &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xef, 0x7f],
    ];
    for file in small_files() {
        for at in some_of(file.bytes.len(), 100) {
            for pattern in patterns {
                let mut bytes = file.bytes.clone();
                let end = (at + pattern.len()).min(bytes.len());
                bytes[at..end].copy_from_slice(&pattern[..end - at]);
                trial.read_like(&file, &bytes);
            }
        }
    }
}

#[test]
fn absurd_numbers_in_text_are_read_or_refused() {
    const ABSURD: [&str; 16] = [
        "18446744073709551615",
        "9223372036854775808",
        "-9223372036854775808",
        "99999999999999999999999999",
        "4294967295",
        "2147483648",
        "1000000000",
        "-1",
        "0",
        "1e300",
        "1e-300",
        "-1e999",
        "nan",
        "inf",
        "",
        "\u{fffd}",
    ];
    let trial = Trial::new();
    for file in small_files() {
        let numbers = numbers_in(&file.bytes);
        for k in some_of(numbers.len(), 60) {
            let (begin, end) = numbers[k];
            for absurd in ABSURD {
                let bytes = [&file.bytes[..begin], absurd.as_bytes(), &file.bytes[end..]].concat();
                trial.read_like(&file, &bytes);
            }
        }
    }
}

/// Where digits begin and end.
fn numbers_in(bytes: &[u8]) -> Vec<(usize, usize)> {
    let is_digit = |k: usize| bytes.get(k).is_some_and(|b| b.is_ascii_digit());
    let begins = (0..bytes.len()).filter(|&k| is_digit(k) && (k == 0 || !is_digit(k - 1)));
    begins
        .map(|k| (k, (k..).find(|&k| !is_digit(k)).unwrap_or(k)))
        .collect()
}

#[test]
fn lines_gone_twice_and_swapped_are_read_or_refused() {
    let trial = Trial::new();
    let mut random = StdRng::seed_from_u64(SEED);
    for file in small_files() {
        let lines: Vec<&[u8]> = file.bytes.split_inclusive(|&b| b == b'\n').collect();
        for k in some_of(lines.len(), 100) {
            let mut gone = lines.clone();
            gone.remove(k);
            trial.read_like(&file, &gone.concat());
            let mut twice = lines.clone();
            twice.insert(k, lines[k]);
            trial.read_like(&file, &twice.concat());
            let mut swapped = lines.clone();
            swapped.swap(k, random.random_range(0..lines.len()));
            trial.read_like(&file, &swapped.concat());
            let doubled = [lines[k].trim_ascii_end(), b" ", lines[k]].concat();
            let mut longer = lines.clone();
            longer[k] = &doubled;
            trial.read_like(&file, &longer.concat());
        }
    }
}

#[test]
fn words_of_other_kinds_are_read_or_refused() {
    let trial = Trial::new();
    let mut random = StdRng::seed_from_u64(SEED);
    for file in small_files() {
        let words: Vec<&[u8]> = file.bytes.split_inclusive(|b| b.is_ascii_whitespace()).collect();
        for _ in 0..200 {
            let mut mixed = words.clone();
            for _ in 0..random.random_range(1..4) {
                mixed[random.random_range(0..words.len())] = words[random.random_range(0..words.len())];
            }
            trial.read_like(&file, &mixed.concat());
        }
    }
}

#[test]
fn odd_bytes_and_line_ends_are_read_or_refused() {
    let trial = Trial::new();
    for file in small_files() {
        let bytes = &file.bytes;
        let replaced = |with: &[u8]| bytes.split(|&b| b == b'\n').collect::<Vec<_>>().join(with);
        let with_text = trial.read_like(&file, bytes);
        let crlf = trial.read_like(&file, &replaced(b"\r\n"));
        let is_text = bytes.is_ascii() && !bytes.contains(&0);
        if is_text {
            assert_eq!(crlf.len(), with_text.len(), "{} {:?}: {crlf:?}", file.name, file.format);
        }
        for odd in [
            replaced(b"\r"),
            replaced(b"\n\n\n"),
            replaced(b"\0\n"),
            replaced(b"\xff\xfe\n"),
            [b"\xef\xbb\xbf", bytes.as_slice()].concat(),
            // As UTF-16.
            bytes.iter().flat_map(|&b| [b, 0]).collect(),
            [bytes.as_slice(), bytes].concat(),
            [bytes.as_slice(), &[0; 100]].concat(),
            [&[0; 100], bytes.as_slice()].concat(),
            bytes.iter().rev().copied().collect(),
            bytes.to_ascii_uppercase(),
        ] {
            trial.read_like(&file, &odd);
        }
        for nothing in [
            &b""[..],
            b"\n",
            b" \t\r\n",
            b"\0",
            &[0; 1000],
            &[0xff; 1000],
            b"\xef\xbb\xbf",
        ] {
            let messages = trial.read_like(&file, nothing);
            let is_allowed = file.format == Format::Obj && messages.len() == 1;
            assert!(
                !messages.is_empty() || is_allowed,
                "{:?} of nothing: {messages:?}",
                file.format
            );
        }
    }
}

#[test]
fn files_of_one_kind_named_as_another_are_refused() {
    let trial = Trial::new();
    let files = small_files();
    for file in &files {
        for other in files.iter().filter(|other| other.format != file.format) {
            trial.read(other.format, &file.bytes);
        }
    }
}

/// The fuzzer's first files, one folder for each target (`fuzz/run.sh`).
#[test]
#[ignore = "writes files to the folder SOLIDMAP_SEEDS"]
fn seeds_for_the_fuzzer() {
    let folder = std::env::var_os("SOLIDMAP_SEEDS").expect("SOLIDMAP_SEEDS names a folder");
    let write = |target: &str, name: String, bytes: &[u8]| {
        let folder = Path::new(&folder).join(target);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), bytes).unwrap();
    };
    let formats = ["obj", "off", "ply", "stl", "mesh", "vtk", "vtu"];
    for (k, file) in small_files().into_iter().enumerate() {
        let (extension, name) = (file.format.extension(), format!("{}_{k}", file.name));
        let target = match file.format {
            Format::Medit => "medit",
            Format::Landmarks => "landmarks",
            Format::Map => "map_file",
            Format::Boundary => "boundary_file",
            Format::Texture => "texture_file",
            Format::Picture => "picture",
            _ => extension,
        };
        write(target, name.clone(), &file.bytes);
        if let Some(format) = formats.iter().position(|known| *known == extension) {
            write(
                "parse_and_check",
                name.clone(),
                &[&[format as u8], file.bytes.as_slice()].concat(),
            );
        }
        if target.ends_with("_file") {
            // As the fuzz targets take it: the header without its length, a line end, and the data.
            let length = u64::from_le_bytes(file.bytes[..8].try_into().unwrap()) as usize;
            let (header, data) = file.bytes[8..].split_at(length);
            write(target, format!("{name}_text"), &[header, b"\n", data].concat());
        }
    }
    // Four vertices and the faces of a tetrahedron; for `fit` twice, as domain and image.
    let tetrahedron = [
        3, 120, 120, 120, 128, 120, 120, 120, 128, 120, 120, 120, 128, 0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2,
    ];
    write("check", "tetrahedron".into(), &[&[8], &tetrahedron[..]].concat());
    write("fit", "tetrahedron".into(), &[tetrahedron, tetrahedron].concat());
    for kind in 70..77u8 {
        write("check", format!("solid_{kind}"), &[8, kind, 1, 130]);
        write("fit", format!("solid_{kind}"), &[kind, 1, 130, kind, 2, 140]);
    }
}

/// Small files that ask for much time or memory.
mod bombs {
    use std::io::Write;

    use base64::{Engine, engine::general_purpose::STANDARD};

    use super::*;

    fn file(name: &str, format: Format) -> Vec<u8> {
        let found = small_files()
            .into_iter()
            .find(|file| file.name == name && file.format == format);
        found.unwrap().bytes
    }

    fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
        let at = bytes
            .windows(from.len())
            .position(|window| window == from.as_bytes())
            .unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    }

    /// All readers of the format refuse it, for this reason.
    fn refused(format: Format, bytes: &[u8], reason: &str) {
        let messages = Trial::new().read(format, bytes);
        assert!(
            !messages.is_empty() && messages.iter().all(|m| m.contains(reason)),
            "{messages:?}"
        );
    }

    #[test]
    fn pictures_of_more_pixels_than_their_bytes_can_hold() {
        let mut png = file("png", Format::Picture);
        png[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
        let mut crc = flate2::Crc::new();
        crc.update(&png[12..29]);
        png[29..33].copy_from_slice(&crc.sum().to_be_bytes());
        refused(Format::Picture, &png, "16384 × 16384 pixels, which its");
        let mut jpeg = file("jpeg", Format::Picture);
        let frame = jpeg.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        jpeg[frame + 5..frame + 9].fill(0xff);
        refused(Format::Picture, &jpeg, "65535 × 65535 pixels");
    }

    /// As base64: the lengths of one block, and the block.
    fn deflated(bytes: &[u8]) -> String {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        encoder.write_all(bytes).unwrap();
        let block = encoder.finish().unwrap();
        let lengths = [1, bytes.len(), 0, block.len()].map(|n| (n as u32).to_le_bytes());
        STANDARD.encode(lengths.concat()) + &STANDARD.encode(block)
    }

    #[test]
    fn arrays_that_unpack_to_a_thousand_times_the_file() {
        let vtu = file("zlib", Format::Vtu);
        let text = String::from_utf8(vtu).unwrap();
        let begin = text.find("<Points>").unwrap();
        let (start, end) = [">", "</DataArray>"]
            .map(|end| text[begin + 9..].find(end).unwrap() + begin + 9)
            .into();
        let points = 6 << 20;
        let bomb = [&text[..=start], &deflated(&vec![0; 24 * points]), &text[end..]].concat();
        let bomb = bomb.replace("NumberOfPoints=\"4\"", &format!("NumberOfPoints=\"{points}\""));
        refused(Format::Vtu, bomb.as_bytes(), "unpacks to more than");
    }

    #[test]
    fn arrays_that_all_stand_in_the_same_place() {
        let count = 20_000;
        let arrays: String = (0..count)
            .map(|k| format!("<DataArray type=\"Float64\" Name=\"f{k}\" format=\"appended\" offset=\"8\"/>\n"))
            .collect();
        let points = 50_000;
        let mut bytes = format!(
            "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><UnstructuredGrid>\n<Piece \
             NumberOfPoints=\"{points}\" NumberOfCells=\"0\"><PointData>\n{arrays}</PointData><Points><DataArray \
             type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">{}</DataArray></Points><Cells>\n<DataArray \
             type=\"UInt8\" Name=\"types\" format=\"ascii\"/><DataArray type=\"UInt8\" Name=\"offsets\" format=\"ascii\"/>\
             <DataArray type=\"UInt8\" Name=\"connectivity\" format=\"ascii\"/></Cells></Piece></UnstructuredGrid>\n\
             <AppendedData encoding=\"raw\">_AAAABBBB",
            "0 ".repeat(3 * points)
        )
        .into_bytes();
        bytes.extend((8 * points as u32).to_le_bytes());
        bytes.extend(vec![0; 8 * points]);
        bytes.extend(b"</AppendedData></VTKFile>");
        let messages = Trial::new().read(Format::Vtu, &bytes);
        assert!(
            messages.iter().any(|m| m.contains("unpacks to more than")),
            "{messages:?}"
        );
    }

    #[test]
    fn subdivisions_that_make_millions_of_triangles() {
        let boundary = file("through", Format::Boundary);
        let name = "\\\"subdivisions\\\":";
        refused(
            Format::Boundary,
            &replaced(&boundary, &format!("{name}0"), &format!("{name}9")),
            "too many to be cut into four 9 times",
        );
    }

    #[test]
    fn counts_in_headers() {
        let npy = file("points", Format::Npy);
        refused(
            Format::Npy,
            &replaced(&npy, "(2, 3), }  ", "(9999, 3), }"),
            "promises 9999 rows",
        );
        let mut map = file("straight", Format::Map);
        map[..8].fill(0xff);
        refused(Format::Map, &map, "is not a map file");
        map[..8].copy_from_slice(&50_000_000u64.to_le_bytes());
        refused(Format::Map, &map, "is not a map file");
        let lattice = file("lattice", Format::Vtk);
        refused(
            Format::Vtk,
            &replaced(&lattice, "2 2 2", "4000000000 4000000000 4000000000"),
            "spoiled.vtk",
        );
        let twice = [
            lattice.as_slice(),
            &lattice[lattice.iter().position(|&b| b == b'D').unwrap()..],
        ]
        .concat();
        refused(Format::Vtk, &twice, "spoiled.vtk");
        let image = file("image", Format::Vti);
        let empty = replaced(&image, "NumberOfComponents=\"1\"", "NumberOfComponents=\"0\"");
        let many = String::from_utf8(empty)
            .unwrap()
            .replace("0 1 0 1 0 1", "0 100 0 100 0 100");
        refused(Format::Vti, many.as_bytes(), "spoiled.vti");
    }

    /// What would take time with the square of its length.
    #[test]
    fn long_headers_and_tags() {
        let trial = Trial::new();
        let columns: String = (0..200_000).map(|k| format!(",c{k}")).collect();
        let row = ",1".repeat(200_000);
        assert!(
            trial
                .read(Format::Csv, format!("x,y,z{columns}\n1,2,3{row}\n").as_bytes())
                .is_empty()
        );
        let text = String::from_utf8(file("text", Format::Vtu)).unwrap();
        let attributes: String = (0..200_000).map(|k| format!(" a{k}=\"\"")).collect();
        let long = text.replacen("<Piece", &format!("<Piece{attributes}"), 1);
        trial.read(Format::Vtu, long.as_bytes());
        let arrays: String = (0..100_000)
            .map(|k| format!("<DataArray type=\"Float64\" Name=\"f{k}\" format=\"ascii\">1 2 3 4</DataArray>"))
            .collect();
        let many = text.replacen("<PointData>", &format!("<PointData>{arrays}"), 1);
        trial.read(Format::Vtu, many.as_bytes());
        trial.read(Format::Obj, "v 0 0 0 \\\n".repeat(200_000).as_bytes());
        trial.read(
            Format::Obj,
            ["v 0 0 0\n", "f", &" 1".repeat(1_000_000)].concat().as_bytes(),
        );
        trial.read(Format::Off, ["OFF\n", &"#\n".repeat(500_000)].concat().as_bytes());
        trial.read(Format::Landmarks, "1 2\n".repeat(200_000).as_bytes());
    }

    #[test]
    fn deep_nesting() {
        let trial = Trial::new();
        let text = String::from_utf8(file("text", Format::Vtu)).unwrap();
        for (open, close) in [
            ("<a>", "</a>"),
            ("<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">", "</Piece>"),
        ] {
            let nested = open.repeat(100_000) + &close.repeat(100_000);
            trial.read(
                Format::Vtu,
                text.replacen("<PointData>", &(nested + "<PointData>"), 1).as_bytes(),
            );
            trial.read(
                Format::Vtu,
                text.replacen("<PointData>", &open.repeat(100_000), 1).as_bytes(),
            );
        }
        for nested in ["[".repeat(100_000), "{\"a\":".repeat(100_000)] {
            let header = format!("{{\"__metadata__\":{nested}");
            let bytes = [&(header.len() as u64).to_le_bytes(), header.as_bytes()].concat();
            refused(Format::Map, &bytes, "is not a map file");
            let inner = format!("{{\"__metadata__\":{{\"solidmap\":{:?}}}}}", nested);
            let bytes = [&(inner.len() as u64).to_le_bytes(), inner.as_bytes()].concat();
            refused(Format::Map, &bytes, "is not a map file");
        }
        let npy = file("points", Format::Npy);
        trial.read(Format::Npy, &replaced(&npy, "(2, 3), }  ", "((((((((((("));
    }

    #[test]
    fn compressed_files_are_refused_as_of_no_known_format() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.obj.gz");
        std::fs::write(&path, [0x1f, 0x8b, 8]).unwrap();
        let message = io::read_solid(&path).unwrap_err().to_string();
        assert!(
            message.contains("model.obj.gz") && message.contains(".obj, .ply"),
            "{message}"
        );
    }
}

/// Surfaces at the edge of what a solid can be.
mod surfaces {
    use solidmap::Point;
    use solidmap::boundary_map::BoundaryMap;
    use solidmap::check::{CheckReport, FindingKind, check, close_holes, repair};
    use solidmap::fit::{FitOptions, fit};
    use solidmap::mesh::{SurfaceMesh, shapes};

    use super::*;

    /// Check, repair, closing of holes and a fit, each in time; the report, and the fit's error.
    fn examined(surface: &SurfaceMesh) -> (CheckReport, Result<(), String>) {
        let in_time = |what: &str, start: Instant| {
            let taken = start.elapsed();
            eprintln!("{} triangles: {what} in {taken:.1?}", surface.triangles().len());
            assert!(taken < longest(), "{what} takes {taken:?}");
        };
        let start = Instant::now();
        let report = check(surface, None);
        assert!(!report.to_string().is_empty());
        in_time("checked", start);
        let start = Instant::now();
        let (repaired, _) = repair(surface);
        in_time("repaired", start);
        let start = Instant::now();
        let _ = close_holes(&repaired, 8);
        in_time("closed", start);
        let start = Instant::now();
        let fitted = fitted(surface);
        in_time("fitted or refused", start);
        (report, fitted)
    }

    /// A small fit to itself.
    fn fitted(surface: &SurfaceMesh) -> Result<(), String> {
        let options = FitOptions {
            max_sources: 500,
            refine: false,
            held_out: 200,
            ..FitOptions::default()
        };
        let boundary = BoundaryMap::new(surface.clone(), surface.vertices().to_vec()).map_err(|e| e.to_string())?;
        fit(&boundary, &options, &|_| {}).map(drop).map_err(|e| e.to_string())
    }

    fn has(report: &CheckReport, kind: FindingKind) -> bool {
        report.findings.iter().any(|finding| finding.kind == kind)
    }

    fn surface(vertices: impl IntoIterator<Item = [f64; 3]>, triangles: Vec<[u32; 3]>) -> SurfaceMesh {
        SurfaceMesh::new(vertices.into_iter().map(Point::from).collect(), triangles).unwrap()
    }

    /// So many tetrahedra.
    fn tetrahedra(count: u32, corners: impl Fn(f64) -> [[f64; 3]; 4]) -> SurfaceMesh {
        let faces = |k: u32| [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].map(|t| t.map(|v: u32| 4 * k + v));
        let corners = (0..count).flat_map(|k| corners(f64::from(k)));
        surface(corners, (0..count).flat_map(faces).collect())
    }

    /// A corner, and the points at this distance from it along the axes.
    fn corner([x, y, z]: [f64; 3], size: f64) -> [[f64; 3]; 4] {
        [[x, y, z], [x + size, y, z], [x, y + size, z], [x, y, z + size]]
    }

    #[test]
    fn nothing_and_one_triangle() {
        for surface in [
            SurfaceMesh::default(),
            surface([[0.0; 3]], vec![]),
            surface([[0.0; 3]; 3], vec![[0, 1, 2]]),
            surface([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]),
            surface([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2], [0, 2, 1]]),
            surface([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 1]; 9]),
        ] {
            let (report, fitted) = examined(&surface);
            assert!(!report.is_solvable(), "{report}");
            assert!(!fitted.unwrap_err().is_empty());
        }
    }

    #[test]
    fn a_million_triangles_that_share_nothing() {
        let corners = (0..1_000_000).flat_map(|k| {
            let [x, y] = [k % 1000, k / 1000].map(f64::from);
            [[x, y, 0.0], [x + 0.5, y, 0.0], [x, y + 0.5, 0.0]]
        });
        let surface = surface(corners, (0..1_000_000).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect());
        let (report, fitted) = examined(&surface);
        assert!(report.components.len() == 1_000_000 && has(&report, FindingKind::OpenEdges));
        assert!(fitted.is_err());
    }

    #[test]
    fn two_hundred_thousand_tiny_solids() {
        let place = |k: f64| corner([k % 100.0, (k / 100.0).floor() % 100.0, (k / 10_000.0).floor()], 0.5);
        let (report, _) = examined(&tetrahedra(200_000, place));
        assert!(report.components.len() == 200_000 && report.is_solvable());
    }

    #[test]
    fn solids_all_in_one_place() {
        let (report, fitted) = examined(&tetrahedra(100_000, |_| corner([0.0; 3], 1.0)));
        assert!(has(&report, FindingKind::CrowdedComponents), "{report}");
        assert!(fitted.is_err());
    }

    /// Each lies along the diagonal of nearly the same box.
    #[test]
    fn needles_side_by_side() {
        let needle = |k: f64| {
            let x = k * 1e-6;
            [
                [x, 0.0, 0.0],
                [x + 5e-7, 0.0, 0.0],
                [x, 1e-7, 1e-7],
                [x + 1.0, 1.0, 1.0],
            ]
        };
        let (report, fitted) = examined(&tetrahedra(100_000, needle));
        assert!(has(&report, FindingKind::CrowdedComponents), "{report}");
        assert!(fitted.is_err());
    }

    #[test]
    fn spheres_within_spheres() {
        let mut nested = shapes::sphere(1.0, 2);
        for k in 1..200 {
            nested = shapes::joined(&nested, &shapes::sphere(1.0 - f64::from(k) * 0.004, 2));
        }
        let (report, _) = examined(&nested);
        let depths: Vec<Option<usize>> = report.components.iter().map(|c| c.depth).collect();
        assert_eq!(depths, (0..200).map(Some).collect::<Vec<_>>());
        assert_eq!(report.components[150].inside, Some(149));
    }

    #[test]
    fn tetrahedra_within_tetrahedra() {
        let nested = |k: f64| corner([k * 1e-6; 3], 1.0 - 4.0 * k * 1e-6);
        let (report, _) = examined(&tetrahedra(1000, nested));
        assert_eq!(report.components[999].depth, Some(999));
        let (report, _) = examined(&tetrahedra(100_000, nested));
        assert!(has(&report, FindingKind::CrowdedComponents), "{report}");
    }

    #[test]
    fn a_book_of_a_million_pages() {
        let pages = 1_000_000u32;
        let vertex = |k: u32| [f64::from(k).cos(), f64::from(k).sin(), 0.5];
        let vertices = [[0.0; 3], [0.0, 0.0, 1.0]].into_iter().chain((0..pages).map(vertex));
        let (report, _) = examined(&surface(vertices, (0..pages).map(|k| [0, 1, k + 2]).collect()));
        assert!(has(&report, FindingKind::NonManifoldEdges), "{report}");
    }

    #[test]
    fn a_rim_of_a_million_edges() {
        let count = 1_000_000u32;
        let vertices = (0..count).map(|k| [f64::from(k / 2), f64::from(k % 2), 0.0]);
        let triangle = |k: u32| {
            if k.is_multiple_of(2) {
                [k, k + 1, k + 2]
            } else {
                [k + 1, k, k + 2]
            }
        };
        let (report, _) = examined(&surface(vertices, (0..count - 2).map(triangle).collect()));
        assert!(has(&report, FindingKind::OpenEdges), "{report}");
    }

    #[test]
    fn a_fan_around_one_vertex() {
        let count = 1_000_000u32;
        let vertex = |k: u32| [f64::from(k).cos(), f64::from(k).sin(), 0.0];
        let vertices = [[0.0; 3]].into_iter().chain((0..count).map(vertex));
        let (report, _) = examined(&surface(vertices, (1..count).map(|k| [0, k, k + 1]).collect()));
        assert!(has(&report, FindingKind::OpenEdges), "{report}");
    }

    #[test]
    fn coordinates_whose_powers_overflow_or_underflow() {
        let solids = [
            shapes::sphere(1.0, 2),
            shapes::cube(1.0, 2),
            shapes::spherical_shell(1.0, 0.5, 1),
        ];
        for solid in &solids {
            for scale in [
                1e300,
                1e-300,
                1e308,
                5e-324,
                1e155,
                1e-155,
                0.0,
                f64::NAN,
                f64::INFINITY,
            ] {
                let scaled = shapes::deformed(solid, |p| p * scale);
                let (_, fitted) = examined(&scaled);
                assert!(!fitted.unwrap_err().is_empty(), "{scale:e}");
                let mixed = |p: &Point| Point::new(p.x, p.y * scale, p.z);
                let _ = examined(&shapes::deformed(solid, mixed));
                let mut one = solid.vertices().to_vec();
                one[3] *= scale;
                let _ = examined(&SurfaceMesh::new(one, solid.triangles().to_vec()).unwrap());
            }
            for far in [1e16, 1e100, 1e300] {
                let _ = examined(&shapes::deformed(solid, |p| p + solidmap::Vector::repeat(far)));
            }
        }
    }
}

/// The program, which ends with 0, 1 or 2, in time, and without the words of a panic.
mod program {
    use std::path::PathBuf;

    use assert_cmd::Command;
    use solidmap::mesh::shapes;

    use super::*;

    /// Exit code and standard error.
    fn run(folder: &Path, words: &[&std::ffi::OsStr]) -> (i32, String) {
        let mut command = Command::cargo_bin("solidmap").unwrap();
        command
            .current_dir(folder)
            .env("RUST_BACKTRACE", "1")
            .args(words)
            .timeout(longest());
        let start = Instant::now();
        let output = command.output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        eprintln!("{words:?}: {:?} after {:.1?}", output.status.code(), start.elapsed());
        let Some(code @ 0..=2) = output.status.code() else {
            panic!("{words:?} ends with {:?}: {errors}", output.status)
        };
        for word in ["panicked", "RUST_BACKTRACE", "stack backtrace", "unwrap"] {
            assert!(!errors.contains(word), "{words:?}: {errors}");
        }
        assert_eq!(code == 2, errors.contains("error: "), "{words:?}: {errors}");
        (code, errors)
    }

    /// Checks a model and fits it to itself; the exit codes.
    fn check_and_fit(folder: &Path, model: &Path) -> [i32; 2] {
        let model = model.as_os_str();
        let (checked, _) = run(folder, &["check".as_ref(), model]);
        let words = [
            "fit",
            "--image",
            "-o",
            "out.map",
            "--max-sources",
            "2000",
            "--no-refine",
        ]
        .map(AsRef::as_ref);
        let [fit, image, rest @ ..] = words;
        let (fitted, _) = run(folder, &[&[fit, model, image, model], &rest[..]].concat());
        [checked, fitted]
    }

    #[test]
    fn bad_models_are_processed_or_refused() {
        let Some(models) = crate::common::models() else { return };
        let folder = tempfile::tempdir().unwrap();
        let entries = std::fs::read_dir(models.join("bad")).unwrap();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        files.sort();
        assert!(files.len() >= 20, "{files:?}");
        for file in files {
            check_and_fit(folder.path(), &file);
        }
    }

    #[test]
    fn spoiled_files_are_processed_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        for file in small_files().into_iter().filter(|file| file.format.is_mesh()) {
            for length in [0, file.bytes.len() / 2, file.bytes.len()] {
                let path = folder.path().join(format!("model.{}", file.format.extension()));
                std::fs::write(&path, &file.bytes[..length]).unwrap();
                let codes = check_and_fit(folder.path(), &path);
                assert!(length > 0 || codes == [2, 2], "{} {:?}", file.name, file.format);
            }
        }
    }

    #[test]
    fn absurd_sizes_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.ply");
        for scale in [1e300, 1e-300, f64::NAN] {
            let scaled = shapes::deformed(&shapes::sphere(1.0, 2), |p| p * scale);
            io::write_surface(&path, &scaled).unwrap();
            let [_, fitted] = check_and_fit(folder.path(), &path);
            assert_eq!(fitted, 2, "{scale}");
        }
    }
}
